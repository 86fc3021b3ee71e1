"""Frama-C's EVA on tse_prepare(), tse_learnt_load() and tse_step(), with any bits as input.   scripts/dev/proof.sh eva

What eva.c asks is proven but for the alarms that eva.toml explains, one by one; an alarm that it does not explain is a failure,
and so is an explanation that no alarm needs. Infinite numbers and NaN are no alarm: what is asked is memory, shifts, whole numbers,
and what a real becomes that is made a whole number. What has been run before is not run again unless something that it reads has
changed.
"""

import argparse
import csv
import hashlib
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
    "prepare": "tse_config_check: any bits as settings; tse_prepare, then tse_reset: any real settings",
    "learnt": "tse_learnt_load: any bytes, 0 .. 536 of them, any age, any form",
    "small": "tse_step, default form, built with TSE_SMALL: any row, filter and parameters with any reals",
    "step": "the same, of a whole build, with no velocity measured yet",
    "velocity": "the same, with a measured velocity",
    "particles": "tse_step, form 1, without effects: the same",
    "numbers": "product, quotient, root: any sums of fifteen results; which are what every other row takes them to give",
}
BUILDS = {  # of another library than the default: definitions
    "step": ["TSE_NO_EFFECTS", "TSE_NO_PARTICLES"],
    "velocity": ["TSE_NO_EFFECTS", "TSE_NO_PARTICLES"],
    "small": ["TSE_SMALL", "TSE_NO_EFFECTS", "TSE_NO_PARTICLES", "TSE_NO_VELOCITY"],
}
ASKED = {  # by default, of each format
    "double": ["prepare", "learnt", "small", "step", "velocity"],
    "float": ["prepare", "learnt", "small", "step"],
    "fixed": ["prepare", "learnt", "numbers"],
}
SHORT = ["learnt"]  # for the tests
# What these refuse is told apart. Of what stands in a header with a suffix for its format, that is the star.
REFUSE = [
    "tse_input_check_*", "tse_input_decode_*", "tse_row_decode_*", "tse_align_row_*", "tse_config_check_*", "first_outside",
    "tse_prepare_*", "tse_check_latencies_*",
]  # fmt: skip
FOLLOWED = {  # functions in which so many cases are kept apart: refused or not, each early return
    "tse_step_row_*": 2, "step_late": 8, "tse_step_*": 8, "tse_input_decode_*": 8, "tse_align_row_*": 8,
    "tse_row_decode_*": 8, "first_outside": 400, "compute_vehicle_fingerprint": 400, "mix_effect": 60,
    "tse_config_check_*": 8, "tse_check_latencies_*": 8, "tse_prepare_*": 8, "prove_prepare": 8,
}  # fmt: skip
# TSE_FIXED_HALVES: products of 32-bit halves, for Frama-C knows no type of 128 bits; test_real_ops.c holds both to the same result.
# TSE_FIXED_CALLS: product, quotient and root are functions; those of eva.c, which give any result.
UNROLLED = 60  # loops of a fixed number of turns up to this are followed turn by turn
APART = (
    8  # turns of any loop that are followed one by one: of events, so that each stays apart from the others;
)
APART_STEP = 32  # of the default form: of states, so that what a loop writes is known to be written


def sources(target: str) -> list[str]:
    listed = re.search(r"add_library\(tse\s([^)]*)\)", (ROOT / "src" / "CMakeLists.txt").read_text()).group(1)
    every = [x for x in re.sub(r"#.*", "", listed).split() if x.endswith(".c")]
    if target == "numbers":
        return []
    left_out = ("host/", "number/", *(("paper/", "model/integrator.c") if target in BUILDS else ()))
    return [
        f"src/{x}"
        for x in every
        if not x.startswith(left_out) or (x == "host/learnt.c" and target == "learnt")
    ]


def what_it_reads(command: list[str], files: list[str]) -> str:
    """The command, and a hash of all that it reads, as the preprocessor leaves it; of eva.c as it is, with its annotations."""
    defined = (
        next(word for word in command if word.startswith("-cpp-extra-args="))
        .removeprefix("-cpp-extra-args=")
        .split()
    )
    seen = hashlib.sha256((HERE / "eva.c").read_bytes())
    for header in sorted((ROOT / "src" / "number").glob("*.h")):
        seen.update(header.read_bytes())
    for file in files:
        seen.update(
            subprocess.run(
                ["cc", "-E", "-P", *defined, file], cwd=ROOT, capture_output=True, check=True
            ).stdout
        )
    return "\n".join([*command, seen.hexdigest()])


def alarms(target: str, form: str) -> tuple[Counter, list[tuple[str, str, str, str]], float]:
    """(numbers of the run, alarms as (file, function, kind, property), seconds)"""
    WORK.mkdir(parents=True, exist_ok=True)
    name, end = f"{target}-{form}", SUFFIX[form]
    csv_file, log, started = WORK / f"{name}.csv", WORK / f"{name}.log", WORK / f"{name}.command"
    split = ",".join(f"{f.replace('*', end)}:0" for f in REFUSE)
    callers = ",".join(f"{f.replace('*', end)}:{n}" for f, n in FOLLOWED.items())
    apart = ["-eva-split-return-function", split, "-eva-slevel-function", callers]
    if target == "numbers":
        apart = ["-eva-slevel", "200", "-eva-split-return", "auto"]
    if target == "prepare":  # a loop over a table: where it stopped is one number behind it
        apart += ["-eva-slevel-merge-after-loop", "first_outside"]
    if target == "learnt":  # bytes that are refused, at each return; of loops over what is read each turn
        callers = f"decode:60,implausible:200,tse_learnt_load_{end}:8"
        apart = ["-eva-split-return-function", "decode:0,implausible:0", "-eva-slevel-function", callers]
    numbers = "-DTSE_FIXED_HALVES" if target == "numbers" else "-DTSE_FIXED_CALLS=1"
    defined = "".join(f" -D{name}=1" for name in BUILDS.get(target, []))
    command = [
        "frama-c",
        "-machdep",
        "gcc_x86_64",
        f"-cpp-extra-args=-Iinclude -Isrc -DTSE_REAL_{form.upper()}=1 -DTSE_MAX_PARTICLES=512 {numbers} "
        f"-DPROVE_{target.upper()}{defined}",
        "tests/proof/eva.c",
        *sources(target),
        "-eva",
        "-warn-special-float",
        "none",
        "-eva-min-loop-unroll",
        str(APART_STEP if target in BUILDS else APART),
        "-eva-auto-loop-unroll",
        str(UNROLLED),
        *apart,
        "-then",
        "-report-csv",
        str(csv_file),
    ]
    began = time.monotonic()
    reads = what_it_reads(command, sources(target))
    if not (csv_file.exists() and started.exists() and started.read_text() == reads):
        csv_file.unlink(missing_ok=True)
        started.write_text(reads)
        with log.open("w") as out:
            done = subprocess.run(command, cwd=ROOT, stdout=out, stderr=subprocess.STDOUT)
        if done.returncode or not csv_file.exists():
            csv_file.unlink(missing_ok=True)
            raise SystemExit(f"eva: frama-c failed on {name}\n{log.read_text()[-3000:]}")
    said = log.read_text()
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


def explained(target: str, alarm: tuple[str, str, str, str], rows: list[dict]) -> int | None:
    """Which row does: of any target, or of the one that it names."""
    file, function, _, text = alarm
    for k, row in enumerate(rows):
        if (
            row["file"] == file
            and row.get("target", target) == target
            and re.fullmatch(row["function"], function)
            and re.search(row["property"], text)
        ):
            return k
    return None


def not_asked(results: list) -> list[str]:
    """What the table leaves out: a target, and of which formats."""
    left = {
        target: [form for form in SUFFIX if (target, form) not in {r[:2] for r in results}]
        for target in TARGETS
        if target != "numbers"
    }
    names = {
        "prepare": "tse_prepare",
        "learnt": "tse_learnt_load",
        "small": "tse_step with TSE_SMALL",
        "step": "tse_step of a whole build",
    }
    names |= {"velocity": "the same with a measured velocity", "particles": "tse_step of form 1"}
    return [f"{names[t]} ({', '.join(forms)})" for t, forms in left.items() if forms]


def page(results: list, rows: list[dict], used: dict[int, set], targets: list[str]) -> str:
    version = subprocess.run(["frama-c", "-version"], capture_output=True, text=True).stdout.strip()
    out = [
        "# What is proven of memory and whole numbers",
        "",
        f"`{' '.join(['scripts/dev/proof.sh eva --write', *targets])}`; Frama-C {version}, EVA, 64-bit x86.",
        "Every real number of settings, parameters, filter and",
        "row may be any bits, NaN and infinite, too; whole numbers of parameters and filter are in the ranges that tse_prepare()",
        "and tse_filter_check() hold them to, and are asserted to be there after the row; in fixed point a number is any that an",
        "operation gives (FIXED_MOST and below); product, quotient and root give any such, and are asked by themselves.",
        "Two steps are by hand: tse_prepare() is given whole numbers (in fixed point real ones, too) in the ranges that",
        "tse_config_check() has just held them to by a loop over a table; and the row that brings a measured velocity into use is",
        "followed from there on by itself: what comes then is that of a filter that has one.",
        "No alarm: no access outside an object",
        "or of what was never written, no overflow or shift that C does not define, no division of whole numbers by 0, no real",
        "made a whole number that cannot hold it.",
        "",
        f"Not asked: {'; '.join(not_asked(results))}; effects, simulator and replay.",
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
            out.append(
                f"| {row['file']} | {row['function'].replace('|', ', ')} | {len(used[k])} | {row['why']} |"
            )
    return "\n".join(out) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--write", action="store_true", help=f"make {REPORT.relative_to(ROOT)} anew")
    parser.add_argument("--format", action="append", choices=list(SUFFIX), help="default: all three")
    parser.add_argument("target", nargs="*", help=f"of {', '.join(TARGETS)}; default: those of the table")
    given = parser.parse_args()
    if not shutil.which("frama-c"):
        print("eva: skipped, frama-c is not installed (scripts/setup.sh proof)")
        return 0
    rows, used, results, wrong = explanations(), defaultdict(set), [], 0
    for form in given.format or SUFFIX:
        for target in given.target or ASKED[form]:
            numbers, found, seconds = alarms(target, form)
            open_ = []
            for alarm in found:
                k = explained(target, alarm, rows)
                if k is None:
                    open_.append(alarm)
                    print(f"eva: {target}, {form}: {' | '.join(alarm)}", file=sys.stderr)
                else:
                    used[k].add(alarm)
            wrong += len(open_)
            results.append((target, form, numbers, found, open_))
            print(
                f"eva: {target}, {form}: {len(found)} alarms, {len(open_)} of them not explained; {seconds:.0f} s",
                flush=True,
            )
    if not given.target and not given.format:
        for k, row in enumerate(rows):
            if not used[k]:
                wrong += 1
                print(
                    f"eva: no alarm needs {row['file']}, {row['function']}: {row['property']}",
                    file=sys.stderr,
                )
    if given.write:
        REPORT.write_text(page(results, rows, used, given.target))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
