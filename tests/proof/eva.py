"""Frama-C's EVA on tse_prepare(), tse_learnt_load() and tse_step(), with any bits as input.   scripts/proof.sh eva

What eva.c asks is proven but for the alarms that eva.toml explains, one by one; an alarm that it does not explain is a failure,
and so is an explanation that no alarm needs. Infinite numbers and NaN are no alarm: what is asked is memory, shifts, whole numbers,
and what a real becomes that is made a whole number.
"""

import argparse
import csv
import re
import shutil
import subprocess
import sys
import time
from collections import Counter, defaultdict
from pathlib import Path

import tomllib

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
WORK = ROOT / "build" / "eva"
REPORT = ROOT / "scripts" / "results" / "proof.md"
EXPLAINED = HERE / "eva.toml"
SUFFIX = {"double": "f64", "float": "f32", "fixed": "fix"}
TARGETS = {  # name: what it asks
    "prepare": "tse_prepare, then tse_reset: any bits as settings",
    "learnt": "tse_learnt_load: any bytes, 0 .. 536 of them, any age, any form",
    "step": "tse_step, default form: any row, filter and parameters with any reals",
    "particles": "tse_step, form 1, without effects: the same",
}
SHORT = ["learnt"]  # for the tests
# What these refuse is told apart. Of what stands in a header with a suffix for its format, that is the star.
REFUSE = ["tse_input_check_*", "tse_input_decode_*", "tse_align_row_*", "tse_config_check_*", "tse_prepare_*", "latencies_fit"]
FOLLOWED = {  # functions in which so many cases are kept apart: refused or not, each early return
    "tse_step_row_*": 8, "step_late": 8, "tse_step_*": 8, "tse_input_decode_*": 8, "tse_align_row_*": 8,
    "tse_config_check_*": 2000, "latencies_fit": 8, "tse_prepare_*": 8, "prove_prepare": 8,
}  # fmt: skip
# TSE_FIXED_HALVES: products of 32-bit halves, for Frama-C knows no type of 128 bits; test_real_ops.c holds both to the same result.
UNROLLED = 40  # loops of a fixed number of turns up to this are followed turn by turn
APART = 8  # turns of any loop that are followed one by one: of events, so that each stays apart from the others


def sources() -> list[str]:
    listed = re.search(r"add_library\(tse\s([^)]*)\)", (ROOT / "src" / "CMakeLists.txt").read_text()).group(1)
    every = [x for x in re.sub(r"#.*", "", listed).split() if x.endswith(".c")]
    return [f"src/{x}" for x in every if not x.startswith("host/") or x == "host/learnt.c"]


def alarms(target: str, form: str) -> tuple[Counter, list[tuple[str, str, str, str]], float]:
    """(numbers of the run, alarms as (file, function, kind, property), seconds)"""
    WORK.mkdir(parents=True, exist_ok=True)
    name, end = f"{target}-{form}", SUFFIX[form]
    csv_file, log = WORK / f"{name}.csv", WORK / f"{name}.log"
    csv_file.unlink(missing_ok=True)
    split = ",".join(f"{f.replace('*', end)}:0" for f in REFUSE)
    callers = ",".join(f"{f.replace('*', end)}:{n}" for f, n in FOLLOWED.items())
    apart = ["-eva-split-return-function", split, "-eva-slevel-function", callers]
    if target == "learnt":  # small enough to keep every case apart
        apart = ["-eva-slevel", "60", "-eva-split-return", "full"]
    command = [
        "frama-c",
        "-machdep",
        "gcc_x86_64",
        f"-cpp-extra-args=-Iinclude -Isrc -DTSE_REAL_{form.upper()}=1 -DTSE_MAX_PARTICLES=512 -DTSE_FIXED_HALVES "
        f"-DPROVE_{target.upper()}",
        "tests/proof/eva.c",
        *sources(),
        "-eva",
        "-warn-special-float",
        "none",
        "-eva-min-loop-unroll",
        str(APART),
        "-eva-auto-loop-unroll",
        str(UNROLLED),
        *apart,
        "-then",
        "-report-csv",
        str(csv_file),
    ]
    began = time.monotonic()
    with log.open("w") as out:
        done = subprocess.run(command, cwd=ROOT, stdout=out, stderr=subprocess.STDOUT)
    said = log.read_text()
    if done.returncode or not csv_file.exists():
        raise SystemExit(f"eva: frama-c failed on {name}\n{said[-3000:]}")
    numbers = Counter()
    if m := re.search(r"(\d+) functions analyzed", said):
        numbers["functions"] = int(m.group(1))
    if m := re.search(r"(\d+) statements reached \(out of (\d+)\)", said):
        numbers["reached"], numbers["statements"] = int(m.group(1)), int(m.group(2))
    if m := re.search(r"Assertions\s+(\d+) valid\s+(\d+) unknown\s+(\d+) invalid", said):
        numbers["asserted"] = int(m.group(1))
    open_ = set()
    with csv_file.open() as rows:
        for row in csv.DictReader(rows, delimiter="\t"):
            if row["status"] in ("Valid", "Considered valid", "Dead", "Unreachable", "Valid under hyp."):
                continue
            if row["status"].startswith("Invalid"):
                raise SystemExit(f"eva: {name}: {row['file']}:{row['line']}: refuted: {row['property']}")
            open_.add(
                (
                    row["file"],
                    re.sub(r"(_f64|_f32|_fix)?(_\d+)?$", "", row["function"]),
                    row["property kind"],
                    re.sub(r"_f(64|32|ix)\b", "", row["property"]),
                )
            )
    return numbers, sorted(open_), time.monotonic() - began


def explanations() -> list[dict]:
    return tomllib.loads(EXPLAINED.read_text()).get("alarm", []) if EXPLAINED.exists() else []


def explained(alarm: tuple[str, str, str, str], rows: list[dict]) -> int | None:
    file, function, _, text = alarm
    for k, row in enumerate(rows):
        if row["file"] == file and re.fullmatch(row["function"], function) and re.search(row["property"], text):
            return k
    return None


def page(results: list, rows: list[dict], used: dict[int, set], targets: list[str]) -> str:
    version = subprocess.run(["frama-c", "-version"], capture_output=True, text=True).stdout.strip()
    out = [
        "# What is proven of memory and whole numbers",
        "",
        f"`{' '.join(['scripts/proof.sh eva --write', *targets])}`; Frama-C {version}, EVA, 64-bit x86.",
        "Every real number of settings, parameters, filter and",
        "row may be any bits, NaN and infinite, too; whole numbers of parameters and filter are in the ranges that tse_prepare()",
        "and tse_filter_check() hold them to, and are asserted to be there after the row; in fixed point a number is any that an",
        "operation gives (FIXED_MOST and below). No alarm: no access outside an object",
        "or of what was never written, no overflow or shift that C does not define, no division of whole numbers by 0, no real",
        "made a whole number that cannot hold it.",
        "",
        "| asked | format | functions | statements reached | alarms | of them explained | still in range, proven |",
        "|---|---|---|---|---|---|---|",
    ]
    for target, form, numbers, found, open_ in results:
        out.append(
            f"| {TARGETS[target]} | {form} | {numbers['functions']} | {numbers['reached']} of {numbers['statements']} | "
            f"{len(found)} | {len(found) - len(open_)} | {numbers['asserted']} |"
        )
    out += [
        "",
        "## Alarms that are explained (tests/proof/eva.toml)",
        "",
        "| file | function | alarms | why they cannot come true |",
        "|---|---|---|---|",
    ]
    for k, row in enumerate(rows):
        if used[k]:
            out.append(f"| {row['file']} | {row['function'].replace('|', ', ')} | {len(used[k])} | {row['why']} |")
    return "\n".join(out) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help=f"make {REPORT.relative_to(ROOT)} anew")
    parser.add_argument("--format", action="append", choices=list(SUFFIX), help="default: all three")
    parser.add_argument("target", nargs="*", help=f"default: {' '.join(TARGETS)}")
    given = parser.parse_args()
    if not shutil.which("frama-c"):
        print("eva: skipped, frama-c is not installed (scripts/setup.sh proof)")
        return 0
    rows, used, results, wrong = explanations(), defaultdict(set), [], 0
    for form in given.format or SUFFIX:
        for target in given.target or TARGETS:
            numbers, found, seconds = alarms(target, form)
            open_ = []
            for alarm in found:
                k = explained(alarm, rows)
                if k is None:
                    open_.append(alarm)
                    print(f"eva: {target}, {form}: {' | '.join(alarm)}", file=sys.stderr)
                else:
                    used[k].add(alarm)
            wrong += len(open_)
            results.append((target, form, numbers, found, open_))
            print(f"eva: {target}, {form}: {len(found)} alarms, {len(open_)} of them not explained; {seconds:.0f} s", flush=True)
    if not given.target:
        for k, row in enumerate(rows):
            if not used[k]:
                wrong += 1
                print(f"eva: no alarm needs {row['file']}, {row['function']}: {row['property']}", file=sys.stderr)
    if given.write:
        REPORT.write_text(page(results, rows, used, given.target))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
