"""Test whether the tests find the faults of faults.toml.

    .venv/bin/python tests/proof/faults.py [--write] [--only TEXT]

Each fault is put into the source and compiled. The unit tests and the golden replay run
until one fails, those of the file first, as in tests/proof/mutation.py. If none fails,
the tests of the file run with sanitizers. Exit code 1: fewer than MIN_FOUND faults are
found, or a fault cannot be put in.
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
MIN_FOUND = 28


def read_faults() -> list[tuple[str, mutation.Fault]]:
    """Return each fault with its sentence.

    Raises
    ------
    ValueError
        The text to replace does not stand in its file exactly once.
    """
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


def judge_faults(
    chosen: list[tuple[str, mutation.Fault]], compiler: str
) -> list[tuple[str, mutation.Fault, str]]:
    """Return each fault with found, found by sanitizers, survived, stillborn or same."""
    court, done = mutation.Court(mutation.ROOT / "build" / "faults", compiler), []
    for what, fault in chosen:
        verdict = court.judge(fault)
        print(f"{verdict}: src/{fault.file}:{fault.line}: {what}", flush=True)
        done.append((what, fault, verdict))
    return done


def format_table(done: list[tuple[str, mutation.Fault, str]]) -> str:
    """Return the table in Markdown."""
    found = sum(v.startswith("found") for *_, v in done)
    lines = [
        "# Faults put in by hand",
        "",
        f"`.venv/bin/python tests/proof/faults.py --write`: {len(done)} faults of "
        "faults.toml, in the default filter and its",
        "model, each tried by the unit tests and the golden replay.",
        "",
        f"**{found} of {len(done)} found.**",
        "",
        "| file and line | fault | |",
        "|---|---|---|",
    ]
    lines += [f"| src/{f.file}:{f.line} | {what} | {v} |" for what, f, v in done]
    return "\n".join(lines) + "\n"


def main() -> int:
    """Judge the faults and write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="", help="faults of which the sentence or file contains this")
    parser.add_argument("--compiler", default="gcc")
    parser.add_argument("--write", action="store_true", help=f"make {REPORT.relative_to(mutation.ROOT)} anew")
    given: Any = parser.parse_args()
    chosen = [(what, f) for what, f in read_faults() if given.only in what or given.only in f.file]
    done = judge_faults(chosen, given.compiler)
    if given.write and not given.only:
        REPORT.write_text(format_table(done), encoding="utf-8")
    missed = sum(not v.startswith("found") for *_, v in done)
    return 0 if missed <= len(read_faults()) - MIN_FOUND else 1


if __name__ == "__main__":
    sys.exit(main())
