#!/usr/bin/env python3
"""Measure what README and the pages state, and write the tables to scripts/results.

    .venv/bin/python scripts/dev/facts.py                    all but the studies: about a minute and a half
    .venv/bin/python scripts/dev/facts.py --fmu              only what the FMUs compute and what their variables are: some seconds
    .venv/bin/python scripts/dev/facts.py --study NAME ...   a Monte-Carlo study, or all: it goes on where it was interrupted

What validators and other clients say of the FMUs: tests/fmu/importers.py.

That README's numbers are those of scripts/results: tests/test_readme.py. Pages take the tables in by `python -m docsite.fill`.
"""

import argparse
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "scripts" / "results"
FMUS = ROOT / "build" / "fmu" / "fmu"
FORMATS = ("double", "float", "fixed")
STUDIES = {  # table: runs of each case, study, and where not all of it is run, the cases
    "accuracy": (24, "accuracy"),
    "stress": (24, "stress"),
    "peers": (20, "peers"),
    "regimes-road": (24, "regimes", "road-0.7,road-0.3"),
    "false-alarms": (24, "false-alarms", "false-alarms"),
    "paper": (200, "paper"),
    "robust": (16, "robust"),
}
PICTURES = ("paper",)

# Of the variables of each FMU: what the table for readers lists one by one. Of the others it names the groups.
MAIN = {
    "TireStiffnessEstimator": r"\w+|estimate\.c[xy]_(front|rear)(_sd|_spread|_valid|_reason)?|"
    r"estimate\.relative\.c[xy]_(front|rear)|estimate\.(sideslip|valid|status)",
    "SingleTrackVehicle": r"\w+|sensor\.\w+|true\.(vel_[xy]|c[xy]_(front|rear))",
}


def output(*command: str | Path) -> str:
    return subprocess.run(
        [str(c) for c in command], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout


def sizes() -> str:
    """Bytes that a caller provides, from tests/sizes.c compiled per format and capacity."""
    found: dict[int, dict[str, int]] = {}
    for preset, real in zip(("release", "float", "fixed"), FORMATS, strict=True):
        output("cmake", "--preset", preset, f"-DFETCHCONTENT_SOURCE_DIR_UNITY={ROOT / '.venv/share/unity'}")
        text = output("cmake", "--build", "--preset", preset, "--target", "sizes")
        for capacity, size, large in re.findall(
            r"(\d+) particles: tse_filter +(\d+), tse_filter_paper +(\d+)", text
        ):
            found.setdefault(0, {})[real] = int(size)
            found.setdefault(int(capacity), {})[real] = int(large)
    lines = ["| | double | float | fixed |", "|---|---:|---:|---:|"]
    for n, sizes in sorted(found.items()):
        name = f"`tse_filter_paper`, {n} particles" if n else "`tse_filter`: the default form"
        lines.append(f"| {name} | {' | '.join(f'{sizes[r]:,} B' if r in sizes else '-' for r in FORMATS)} |")
    return "\n".join(lines) + "\n"


def fmu_variables(model: str, folder: Path) -> str:
    """The main variables of an FMU as modelDescription.xml has them. What the three stiffnesses share word for word is one row."""
    rows: dict[tuple[str, str, str], list[ET.Element]] = {}
    others: dict[tuple[str, str], list[str]] = {}
    description = ET.parse(folder / model / "modelDescription.xml").getroot()
    for v in description.iter("ScalarVariable"):
        name, role = v.attrib["name"], v.attrib["causality"]
        if re.fullmatch(MAIN[model], name):
            rows.setdefault(
                (role, re.sub("c[xy]_(front|rear)", "", name), v.attrib["description"]), []
            ).append(v)
        else:
            group, _, last = name.partition(".") if role == "parameter" else name.rpartition(".")
            others.setdefault((role, group), []).append(last)
    lines = [f"| {model} | | unit | |", "|---|---|---|---|"]
    for (role, _, text), same in rows.items():
        units = dict.fromkeys(v[0].attrib.get("unit", v[0].tag) for v in same)
        names = ", ".join(f"`{v.attrib['name']}`" for v in same)
        lines.append(f"| {names} | {role} | {', '.join(units)} | {text} |")
    for (role, group), names in others.items():
        more = f"{len(names)}: {', '.join(names[:4])}{' ...' if len(names) > 4 else ''}"
        lines.append(f"| `{group}.*` | {role}s | | {more} |")
    lines.append(f"| GUID | | | `{description.attrib['guid']}`: a hash of the whole description |")
    return "\n".join(lines)


def fmus() -> None:
    print("FMUs ...", flush=True)
    output("cmake", "--preset", "fmu", f"-DFETCHCONTENT_SOURCE_DIR_FMI2={ROOT / '.venv/share/fmi2'}")
    output("cmake", "--build", "--preset", "fmu")
    (RESULTS / "fmu_variables.md").write_text(
        "\n\n".join(fmu_variables(model, FMUS) for model in MAIN) + "\n"
    )
    (RESULTS / "fmu.md").write_text(output(sys.executable, ROOT / "tests" / "fmu" / "pictures.py"))


def study(name: str) -> None:
    """Run what is not yet in build/studies; copy the table, and the picture that a page shows."""
    runs, base, *cases = STUDIES[name]
    print(f"{name}: {runs} runs of each case", flush=True)
    out = ROOT / "build" / "studies" / name
    only = ["--cases", cases[0]] if cases else []
    output(ROOT / ".venv/bin/tselab", "montecarlo", "--study", base, "--runs", str(runs), "--out", out, *only)
    for end in ("md", "png") if name in PICTURES else ("md",):
        shutil.copy(out / f"{base}.{end}", RESULTS / f"{name}.{end}")


def measure() -> None:
    RESULTS.mkdir(exist_ok=True)
    tselab = ROOT / ".venv" / "bin" / "tselab"
    print("sizes, time ...", flush=True)
    (RESULTS / "bench.md").write_text(sizes() + "\n" + output(ROOT / "scripts" / "dev" / "bench.sh"))
    print("picture ...", flush=True)
    output(tselab, "demo", "--out", ROOT / "demo-output")
    (RESULTS / "demo.png").write_bytes((ROOT / "demo-output" / "demo.png").read_bytes())
    (RESULTS / "gap.png").write_bytes((ROOT / "demo-output" / "gap" / "gap.png").read_bytes())
    fmus()


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--fmu", action="store_true")
    parser.add_argument("--study", nargs="*", choices=list(STUDIES), metavar="NAME", help=", ".join(STUDIES))
    options = parser.parse_args()
    if options.study is not None:
        for name in options.study or STUDIES:
            study(name)
    else:
        fmus() if options.fmu else measure()
    return 0


if __name__ == "__main__":
    sys.exit(main())
