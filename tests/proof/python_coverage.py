"""How much of the Python packages their tests reach: statements and branches by package, also of processes that the tests start.

    scripts/proof.sh python [--write] [PYTEST ARGUMENTS]     --write: the table of scripts/results anew; about half an hour

Nothing is refused for a figure: what a line that no test reaches is worth, nobody can say in general. They are for looking where to
test next. Tests of a full disk fail here, because what is measured cannot be written either.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RESULT = ROOT / "scripts" / "results" / "coverage-python.md"
CONFIG = """[run]
branch = true
parallel = true
patch = subprocess
source = {root}/scripts/tse
  {root}/scripts/tselab
data_file = {data}
"""
COUNTS = ("num_statements", "missing_lines", "num_branches", "missing_branches")


def package(file: str) -> str:
    """The package that a file is counted under."""
    parts = Path(file).relative_to("scripts").parts[:-1]
    return ".".join(parts[: 3 if parts[:2] == ("tse", "impl") else 2])


def table(report: dict[str, dict[str, dict[str, dict[str, int]]]], tests: str) -> str:
    """Markdown of what `coverage json` says."""
    sums: dict[str, dict[str, int]] = defaultdict(lambda: dict.fromkeys(COUNTS, 0))
    for file, found in report["files"].items():
        for name in (package(file), "all"):
            for count in COUNTS:
                sums[name][count] += found["summary"][count]
    lines = ["# What the tests reach of the Python packages", "", f"{tests}; processes that tests start included", ""]
    lines += ["| package | statements | reached | branches | reached |", "| --- | ---: | ---: | ---: | ---: |"]
    for name in sorted(sums, key=lambda n: (n == "all", n)):
        s = sums[name]
        shares = [
            f"{100 * (1 - s[missing] / s[of]):.1f} %" if s[of] else "-"
            for of, missing in (("num_statements", "missing_lines"), ("num_branches", "missing_branches"))
        ]
        lines.append(f"| {name} | {s['num_statements']} | {shares[0]} | {s['num_branches']} | {shares[1]} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    options, arguments = parser.parse_known_args()
    with tempfile.TemporaryDirectory() as folder:
        config, report = Path(folder, "coveragerc"), Path(folder, "report.json")
        config.write_text(CONFIG.format(root=ROOT, data=Path(folder, "data")), encoding="utf-8")
        env = {**os.environ, "COVERAGE_RCFILE": str(config)}
        coverage = [sys.executable, "-m", "coverage"]
        pytest = ["-m", "pytest", "-c", "scripts/pyproject.toml", "--rootdir", ".", "-q", "--dist", "loadfile",
                  "--max-worker-restart", "0", *(arguments or ["-n", "2", "tests"])]  # fmt: skip
        ran = subprocess.run([*coverage, "run", f"--rcfile={config}", *pytest], cwd=ROOT, env=env, check=False)
        for step in (["combine", "--quiet"], ["json", "--quiet", "-o", str(report)]):
            subprocess.run([*coverage, step[0], f"--rcfile={config}", *step[1:]], cwd=ROOT, env=env, check=True)
        text = table(
            json.loads(report.read_text()), f"`scripts/proof.sh python {' '.join(arguments)}`".replace(" `", "`")
        )
    print(text)
    if options.write:
        RESULT.write_text(text, encoding="utf-8")
    return ran.returncode


if __name__ == "__main__":
    sys.exit(main())
