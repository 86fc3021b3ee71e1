"""Check MISRA C:2012 by the addon of cppcheck: hits by rule and their deviations.

    scripts/dev/proof.sh misra

Rules are named by number, because their texts are copyrighted. A deviation in misra.toml
states rule, files, lines (a pattern) and reason. A hit of a mandatory or required rule
without a deviation is a failure, and so is a deviation without a hit.
"""

import argparse
import re
import shutil
import subprocess
import sys
from collections import Counter, defaultdict
from fnmatch import fnmatch
from pathlib import Path

import tomllib

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
REPORT = ROOT / "scripts" / "results" / "misra.md"
DEVIATIONS = HERE / "misra.toml"
# Categories of the rules that are not "required" (MISRA C:2012 with amendment 1).
MANDATORY = {
    "9.1",
    "12.5",
    "13.6",
    "17.3",
    "17.4",
    "17.6",
    "19.1",
    "21.13",
    "21.17",
    "21.18",
    "21.19",
    "21.20",
    "22.2",
    "22.4",
    "22.5",
    "22.6",
}
ADVISORY = {
    "1.2",
    "2.3",
    "2.4",
    "2.5",
    "2.6",
    "2.7",
    "4.2",
    "5.9",
    "8.7",
    "8.9",
    "8.11",
    "8.13",
    "10.5",
    "11.4",
    "11.5",
    "12.1",
    "12.3",
    "12.4",
    "13.3",
    "13.4",
    "15.1",
    "15.4",
    "15.5",
    "17.5",
    "17.8",
    "18.4",
    "18.5",
    "19.2",
    "20.1",
    "20.5",
    "20.10",
    "21.12",
}
DEFINES = ["-DTSE_REAL_DOUBLE=1", "-DTSE_MAX_PARTICLES=512"]
SHORT = [
    "src/estimator/input.c",
    "src/filter/step.c",
    "src/paper/resample.c",
    "src/host/learnt.c",
]  # files for the tests


def find_category(rule: str) -> str:
    """Return the category of a rule."""
    return "mandatory" if rule in MANDATORY else "advisory" if rule in ADVISORY else "required"


def find_hits(files: list[str]) -> set[tuple[str, str, int]]:
    """Return (rule, file, line) of each hit."""
    command = [
        "cppcheck",
        "--addon=misra",
        "--std=c99",
        "--enable=style",
        "--inconclusive",
        "-q",
        "-Iinclude",
        "-Isrc",
        *DEFINES,
        "--template={file}:{line}:{id}",
        *files,
    ]
    said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    found = set()
    for line in said.stderr.splitlines() + said.stdout.splitlines():
        if m := re.fullmatch(r"(.+):(\d+):misra-c2012-(\d+\.\d+)", line):
            found.add((m.group(3), m.group(1), int(m.group(2))))
    if not found:
        raise SystemExit(f"misra: cppcheck and its addon said nothing at all\n{said.stderr[-2000:]}")
    return found


def read_deviations() -> list[dict]:
    """Return the deviations of misra.toml."""
    return tomllib.loads(DEVIATIONS.read_text())["deviation"]


def find_deviation(hit: tuple[str, str, int], rows: list[dict], lines: dict[str, list[str]]) -> int | None:
    """Return the index of the deviation that covers a hit, or None."""
    rule, file, line = hit
    text = lines.setdefault(file, (ROOT / file).read_text().splitlines())
    shown = text[line - 1] if 0 < line <= len(text) else ""
    for k, row in enumerate(rows):
        if (
            rule in row["rules"]
            and any(fnmatch(file, f) for f in row.get("files", ["*"]))
            and re.search(row.get("line", ""), shown)
        ):
            return k
    return None


def judge_hits(files: list[str]) -> tuple[list, Counter, dict, set]:
    """Return hits without a deviation, hits by deviation, counts by rule, all hits."""
    rows, lines, found = read_deviations(), {}, find_hits(files)
    without, used, by_rule = [], Counter(), defaultdict(Counter)
    for hit in sorted(found, key=lambda h: ([int(x) for x in h[0].split(".")], h[1:])):
        row = find_deviation(hit, rows, lines)
        by_rule[hit[0]]["all"] += 1
        if row is None:
            without.append(hit)
            by_rule[hit[0]]["without"] += 1
        else:
            used[row] += 1
    return without, used, by_rule, found


def format_page(without: list, used: Counter, by_rule: dict) -> str:
    """Return the page with its tables."""
    version = subprocess.run(["cppcheck", "--version"], capture_output=True, text=True).stdout.strip()
    sums = {
        c: [sum(n[k] for r, n in by_rule.items() if find_category(r) == c) for k in ("all", "without")]
        for c in ("mandatory", "required", "advisory")
    }
    out = [
        "# MISRA C:2012",
        "",
        f"`scripts/dev/proof.sh misra --write`; {version} with its addon, double, src/ and include/. "
        "Hit: a line that breaks a rule.",
        "",
        "| category | hits | hits without a deviation |",
        "|---|---|---|",
    ]
    out += [f"| {c} | {a} | {w} |" for c, (a, w) in sums.items()]
    out += ["", "| rule | category | hits | hits without a deviation |", "|---|---|---|---|"]
    out += [f"| {r} | {find_category(r)} | {n['all']} | {n['without']} |" for r, n in by_rule.items()]
    out += [
        "",
        "## Deviations (tests/proof/misra.toml)",
        "",
        "| rules | files | lines that match | hits | reason |",
        "|---|---|---|---|---|",
    ]
    for k, row in enumerate(read_deviations()):
        line = row.get("line", "")
        shown = f"`{line}`".replace("|", "\\|") if line else "any"
        out.append(
            f"| {', '.join(row['rules'])} | {', '.join(row.get('files', ['all']))} | {shown} "
            f"| {used[k]} | {row['why']} |"
        )
    left = [h for h in without if find_category(h[0]) == "advisory"]
    if left:
        out += ["", f"## Hits of advisory rules without a deviation: {len(left)}", ""]
        by = Counter(h[0] for h in left)
        out.append(", ".join(f"{r} ({n})" for r, n in by.items()))
    return "\n".join(out) + "\n"


def list_failures(without: list) -> list[str]:
    """Return a line for each hit that is a failure."""
    return [
        f"{file}:{line}: rule {rule} ({find_category(rule)}), in no deviation"
        for rule, file, line in without
        if find_category(rule) != "advisory"
    ]


def main() -> int:
    """Check the files and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--write", action="store_true", help=f"make {REPORT.relative_to(ROOT)} anew")
    parser.add_argument("files", nargs="*", help="default: all of src/")
    given = parser.parse_args()
    if not shutil.which("cppcheck"):
        print("misra: skipped, cppcheck is not installed (scripts/setup.sh proof)")
        return 0
    every = sorted(p.relative_to(ROOT).as_posix() for p in (ROOT / "src").rglob("*.c"))
    without, used, by_rule, found = judge_hits(given.files or every)
    if given.write:
        REPORT.write_text(format_page(without, used, by_rule))
    wrong = list_failures(without)
    if not given.files:
        wrong += [
            f"deviation {row['rules']} in {row.get('files', ['all'])} is of no use"
            for k, row in enumerate(read_deviations())
            if not used[k]
        ]
    for line in wrong:
        print(f"misra: {line}", file=sys.stderr)
    print(
        f"misra: {len(found)} hits of {len(by_rule)} rules; {len(wrong)} of mandatory or "
        "required rules without a deviation"
    )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
