#!/usr/bin/env python3
"""Measure the numbers that README and the web pages state. Write tables of these numbers
to scripts/results.

    .venv/bin/python scripts/dev/facts.py
        measure sizes and times, draw the pictures of `tselab demo`, and do what --fmu
        does: about 90 s
    .venv/bin/python scripts/dev/facts.py --fmu
        write only the tables of outputs and variables of the FMUs: a few seconds
    .venv/bin/python scripts/dev/facts.py --study NAME ...
        run Monte-Carlo studies, all if no name is given; resume an interrupted study

Afterwards, `python -m docsite.fill` copies the tables into the pages, and
tests/test_readme.py compares README with scripts/results. One result is not from this
script: tests/fmu/importers.py writes what validators of FMUs, and programs that import
FMUs, report on the FMUs of tse.
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
# Key: name of a table in scripts/results. Value: number of runs of each case; name of a
# study of `tselab montecarlo`; cases of this study to run, separated by commas. If the
# cases are left out, all cases of the study are run.
STUDIES = {
    "accuracy": (24, "accuracy"),
    "stress": (24, "stress"),
    "peers": (20, "peers"),
    "regimes-road": (24, "regimes", "road-0.7,road-0.3"),
    "false-alarms": (24, "false-alarms", "false-alarms"),
    "paper": (200, "paper"),
    "robust": (16, "robust"),
}
PICTURES = ("paper",)  # keys of STUDIES whose study also draws a picture

# Key: name of an FMU. Value: regular expression of its main variables. The table of the
# FMU describes each main variable. Other variables are not described: for each group of
# them, such as vehicle.*, the table states their number and the first four names.
MAIN = {
    "TireStiffnessEstimator": r"\w+|estimate\.c[xy]_(front|rear)(_sd|_spread|_valid|_reason)?|"
    r"estimate\.relative\.c[xy]_(front|rear)|estimate\.(sideslip|valid|status)",
    "SingleTrackVehicle": r"\w+|sensor\.\w+|true\.(vel_[xy]|c[xy]_(front|rear))",
}


def run_command(*command: str | Path) -> str:
    """Run a command in the folder of the repository. Return its output."""
    return subprocess.run(
        [str(c) for c in command], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout


def measure_sizes() -> str:
    """Return a table of the sizes of a filter, by number format and number of particles.

    tests/sizes.c prints the sizes."""
    found: dict[int, dict[str, int]] = {}
    for preset, real in zip(("release", "float", "fixed"), FORMATS, strict=True):
        run_command(
            "cmake", "--preset", preset, f"-DFETCHCONTENT_SOURCE_DIR_UNITY={ROOT / '.venv/share/unity'}"
        )
        text = run_command("cmake", "--build", "--preset", preset, "--target", "sizes")
        for capacity, size, large in re.findall(
            r"(\d+) particles: tse_filter +(\d+), tse_filter_paper +(\d+)", text
        ):
            found.setdefault(0, {})[real] = int(size)
            found.setdefault(int(capacity), {})[real] = int(large)
    lines = ["| struct | double | float | fixed |", "|---|---:|---:|---:|"]
    for n, sizes in sorted(found.items()):
        name = f"`tse_filter_paper`, {n} particles" if n else "`tse_filter`: the default form"
        lines.append(f"| {name} | {' | '.join(f'{sizes[r]:,} B' if r in sizes else '-' for r in FORMATS)} |")
    return "\n".join(lines) + "\n"


def list_fmu_variables(model: str, folder: Path) -> str:
    """Return a table of the variables of an FMU, as modelDescription.xml describes them.

    Variables with the same description share a row. Example: the valid flags of the
    three stiffnesses.
    """
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


def describe_fmus() -> None:
    """Build the FMUs, and write the tables of their outputs and variables."""
    print("FMUs ...", flush=True)
    run_command("cmake", "--preset", "fmu", f"-DFETCHCONTENT_SOURCE_DIR_FMI2={ROOT / '.venv/share/fmi2'}")
    run_command("cmake", "--build", "--preset", "fmu")
    (RESULTS / "fmu_variables.md").write_text(
        "\n\n".join(list_fmu_variables(model, FMUS) for model in MAIN) + "\n"
    )
    (RESULTS / "fmu.md").write_text(run_command(sys.executable, ROOT / "tests" / "fmu" / "pictures.py"))


def run_study(name: str) -> None:
    """Run a study in build/studies, and copy its table and picture to scripts/results.

    If an earlier call was interrupted, the runs that it has finished are not repeated."""
    runs, base, *cases = STUDIES[name]
    print(f"{name}: {runs} runs of each case", flush=True)
    out = ROOT / "build" / "studies" / name
    only = ["--cases", cases[0]] if cases else []
    run_command(
        ROOT / ".venv/bin/tselab", "montecarlo", "--study", base, "--runs", str(runs), "--out", out, *only
    )
    for end in ("md", "png") if name in PICTURES else ("md",):
        shutil.copy(out / f"{base}.{end}", RESULTS / f"{name}.{end}")


def measure() -> None:
    """Measure sizes and times, draw the pictures of the demo, and describe the FMUs."""
    RESULTS.mkdir(exist_ok=True)
    tselab = ROOT / ".venv" / "bin" / "tselab"
    print("sizes, time ...", flush=True)
    (RESULTS / "bench.md").write_text(
        measure_sizes() + "\n" + run_command(ROOT / "scripts" / "dev" / "bench.sh")
    )
    print("picture ...", flush=True)
    run_command(tselab, "demo", "--out", ROOT / "demo-output")
    (RESULTS / "demo.png").write_bytes((ROOT / "demo-output" / "demo.png").read_bytes())
    (RESULTS / "gap.png").write_bytes((ROOT / "demo-output" / "gap" / "gap.png").read_bytes())
    describe_fmus()


def main() -> int:
    """Run studies (--study), describe the FMUs (--fmu), or measure sizes and times."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--fmu", action="store_true")
    parser.add_argument("--study", nargs="*", choices=list(STUDIES), metavar="NAME", help=", ".join(STUDIES))
    options = parser.parse_args()
    if options.study is not None:
        for name in options.study or STUDIES:
            run_study(name)
    else:
        describe_fmus() if options.fmu else measure()
    return 0


if __name__ == "__main__":
    sys.exit(main())
