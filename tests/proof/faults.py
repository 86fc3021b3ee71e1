"""Do the tests find the faults of faults.toml?   .venv/bin/python tests/proof/faults.py [--write] [--only TEXT]

Each is put into the source, compiled and tried by the unit tests and the golden replay, the file's own first, as
tests/proof/mutation.py does it, until one fails; what survives is tried by the file's own tests with sanitizers.
Exit code 1: fewer than LEAST are found, or one cannot be put in.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import tomllib

sys.path.insert(0, str(Path(__file__).resolve().parent))
import mutation

FAULTS = Path(__file__).with_name("faults.toml")
REPORT = mutation.ROOT / "scripts" / "results" / "faults.md"
LEAST = 28


def faults() -> list[tuple[str, mutation.Fault]]:
    """Each with its sentence. ValueError: what it replaces does not stand in its file exactly once."""
    found = []
    for row in tomllib.loads(FAULTS.read_text(encoding="utf-8"))["fault"]:
        text = (mutation.SRC / row["file"]).read_text(encoding="utf-8")
        if text.count(row["old"]) != 1:
            raise ValueError(
                f"src/{row['file']} has {row['old']!r} {text.count(row['old'])} times: {row['what']}"
            )
        at = text.index(row["old"])
        line = text.count("\n", 0, at) + 1
        found.append(
            (
                row["what"],
                mutation.Fault(row["file"], at, at + len(row["old"]), row["new"], "hand", line, row["old"]),
            )
        )
    return found


def judged(chosen: list[tuple[str, mutation.Fault]], compiler: str) -> list[tuple[str, mutation.Fault, str]]:
    """Each with found, found by sanitizers, survived, stillborn or same."""
    court, done = mutation.Court(mutation.ROOT / "build" / "faults", compiler), []
    for what, fault in chosen:
        verdict = court.judge(fault)
        print(f"{verdict}: src/{fault.file}:{fault.line}: {what}", flush=True)
        done.append((what, fault, verdict))
    return done


def table(done: list[tuple[str, mutation.Fault, str]]) -> str:
    """Markdown."""
    found = sum(v.startswith("found") for *_, v in done)
    lines = [
        "# Faults put in by hand", "",
        f"`.venv/bin/python tests/proof/faults.py --write`: {len(done)} faults of faults.toml, in the default filter and its",
        "model, each tried by the unit tests and the golden replay.", "", f"**{found} of {len(done)} found.**", "",
        "| file and line | fault | |", "|---|---|---|",
    ]  # fmt: skip
    lines += [f"| src/{f.file}:{f.line} | {what} | {v} |" for what, f, v in done]
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="", help="faults of which the sentence or file contains this")
    parser.add_argument("--compiler", default="gcc")
    parser.add_argument("--write", action="store_true", help=f"make {REPORT.relative_to(mutation.ROOT)} anew")
    given: Any = parser.parse_args()
    chosen = [(what, f) for what, f in faults() if given.only in what or given.only in f.file]
    done = judged(chosen, given.compiler)
    if given.write and not given.only:
        REPORT.write_text(table(done), encoding="utf-8")
    missed = sum(not v.startswith("found") for *_, v in done)
    return 0 if missed <= len(faults()) - LEAST else 1


if __name__ == "__main__":
    sys.exit(main())
