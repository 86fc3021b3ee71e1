"""Run Frama-C's EVA on tse_prepare(), tse_learnt_load() and tse_step() with any input
bits.

    scripts/dev/proof.sh eva

The assertions of eva.c are proven but for the alarms that eva.toml explains one by one.
An alarm without an explanation is a failure, and so is an explanation without an alarm.
Infinite numbers and NaN raise no alarm: EVA checks memory, shifts, integers, and
conversions of reals to integers. A run is repeated only if a file that it reads has
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
TARGETS = {  # name: functions and their inputs
    "prepare": "tse_config_check: any bits as settings; tse_prepare, then tse_reset: any real settings",
    "learnt": "tse_learnt_load: any bytes, 0 .. 536 of them, any age, any form",
    "small": "tse_step, default form, built with TSE_SMALL: any row, filter and parameters with any reals",
    "step": "the same, of a whole build, with no velocity measured yet",
    "velocity": "the same, with a measured velocity",
    "particles": "tse_step, form 1, without effects: the same",
    "numbers": "product, quotient, root: any sums of fifteen results; the other targets assume their ranges",
}
BUILDS = {  # definitions of targets with another build of the library
    "step": ["TSE_NO_EFFECTS", "TSE_NO_PARTICLES"],
    "velocity": ["TSE_NO_EFFECTS", "TSE_NO_PARTICLES"],
    "small": ["TSE_SMALL", "TSE_NO_EFFECTS", "TSE_NO_PARTICLES", "TSE_NO_VELOCITY"],
}
ASKED = {  # targets by number format
    "double": ["prepare", "learnt", "small", "step", "velocity"],
    "float": ["prepare", "learnt", "small", "step"],
    "fixed": ["prepare", "learnt", "numbers"],
}
SHORT = ["learnt"]  # for the tests
# Functions whose refusals are separate cases. The star stands for the suffix of the
# number format.
REFUSE = [
    "tse_input_check_*",
    "tse_input_decode_*",
    "tse_decode_row_*",
    "tse_align_row_*",
    "tse_config_check_*",
    "first_outside",
    "tse_prepare_*",
    "tse_check_latencies_*",
]
FOLLOWED = {  # function: number of cases kept apart, such as early returns
    "tse_step_row_*": 2, "step_late": 8, "tse_step_*": 8, "tse_input_decode_*": 8, "tse_align_row_*": 8,
    "tse_decode_row_*": 8, "first_outside": 400, "compute_vehicle_fingerprint": 400, "mix_effect": 60,
    "tse_config_check_*": 8, "tse_check_latencies_*": 8, "tse_prepare_*": 8, "prove_prepare": 8,
}  # fmt: skip
# TSE_FIXED_HALVES: products of 32-bit halves, because Frama-C has no type of 128 bits;
# test_real_ops.c checks that both give the same result. TSE_FIXED_CALLS: product,
# quotient and root are functions; those of eva.c return any result.
UNROLLED = 60  # loops with at most so many iterations are followed one by one
# Iterations of a loop that are followed one by one: each event stays a case of its own.
APART = 8
# The same in the default filter: each state that a loop writes is then known.
APART_STEP = 32


def list_sources(target: str) -> list[str]:
    """Return the sources of a target."""
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


def make_key(command: list[str], files: list[str]) -> str:
    """Return the command, and a hash of all files that it reads, after the preprocessor.

    eva.c is hashed as it is, with its annotations.
    """
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


def find_alarms(target: str, form: str) -> tuple[Counter, list[tuple[str, str, str, str]], float]:
    """Run a target.

    Returns numbers of the run, alarms as (file, function, kind, property), and seconds.
    """
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
        callers = f"decode:60,find_wrong_value:200,tse_learnt_load_{end}:8"
        apart = ["-eva-split-return-function", "decode:0,find_wrong_value:0", "-eva-slevel-function", callers]
    numbers = "-DTSE_FIXED_HALVES" if target == "numbers" else "-DTSE_FIXED_CALLS=1"
    defined = "".join(f" -D{name}=1" for name in BUILDS.get(target, []))
    command = [
        "frama-c",
        "-machdep",
        "gcc_x86_64",
        f"-cpp-extra-args=-Iinclude -Isrc -DTSE_REAL_{form.upper()}=1 -DTSE_MAX_PARTICLES=512 {numbers} "
        f"-DPROVE_{target.upper()}{defined}",
        "tests/proof/eva.c",
        *list_sources(target),
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
    reads = make_key(command, list_sources(target))
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


def read_explanations() -> list[dict]:
    """Return the explanations of eva.toml."""
    return tomllib.loads(EXPLAINED.read_text()).get("alarm", []) if EXPLAINED.exists() else []


def find_explanation(target: str, alarm: tuple[str, str, str, str], rows: list[dict]) -> int | None:
    """Return the index of the explanation of an alarm, for its target or for any."""
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


def list_omissions(results: list) -> list[str]:
    """Return a line for each target that was not run in a number format."""
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


def format_page(results: list, rows: list[dict], used: dict[int, set], targets: list[str]) -> str:
    """Return the page with its table."""
    version = subprocess.run(["frama-c", "-version"], capture_output=True, text=True).stdout.strip()
    out = [
        "# Proof of memory safety and integer ranges",
        "",
        f"`{' '.join(['scripts/dev/proof.sh eva --write', *targets])}`; Frama-C {version}, EVA, 64-bit x86.",
        "",
        "No alarm means: no access outside an object or to uninitialised memory, no overflow or shift that C",
        "does not define, no integer division by 0, no conversion of a real number to an integer that cannot",
        "hold it. Assumptions:",
        "",
        "- Real numbers of settings, parameters, filter and row have any bits, including NaN and infinity.",
        "- Integers of parameters and filter are in the ranges that tse_prepare() and tse_filter_check()",
        "  enforce. After the row they are proven to be in these ranges again.",
        "- Fixed point: a number has any magnitude up to FIXED_MOST. So has the result of a product, a",
        "  quotient or a root, which is proven separately (last line).",
        "- tse_config_check() checks ranges in a loop over a table. EVA does not follow this. tse_prepare()",
        "  is therefore analysed with integers (in fixed point also real numbers) in these ranges.",
        "- The first row with a measured velocity is analysed up to the point where the filter begins to use",
        "  the velocity. From there on, the analysis of a filter that uses a velocity applies.",
        "",
        f"Not analysed: {'; '.join(list_omissions(results))}; effects, simulator and replay.",
        "",
        "| analysed | format | functions | statements reached | alarms | explained alarms | "
        "integer ranges proven |",
        "|---|---|---|---|---|---|---|",
    ]
    for target, form, numbers, found, open_ in results:
        out.append(
            f"| {TARGETS[target]} | {form} | {numbers['functions']} | {numbers['reached']} "
            f"of {numbers['statements']} | "
            f"{len(found)} | {len(found) - len(open_)} | {numbers['asserted']} |"
        )
    out += [
        "",
        "## Explained alarms (tests/proof/eva.toml)",
        "",
        "| file | function | alarms | why the error cannot occur |",
        "|---|---|---|---|",
    ]
    for k, row in enumerate(rows):
        if used[k]:
            out.append(
                f"| {row['file']} | {row['function'].replace('|', ', ')} | {len(used[k])} | {row['why']} |"
            )
    return "\n".join(out) + "\n"


def main() -> int:
    """Run the targets and check their alarms."""
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
    rows, used, results, wrong = read_explanations(), defaultdict(set), [], 0
    for form in given.format or SUFFIX:
        for target in given.target or ASKED[form]:
            numbers, found, seconds = find_alarms(target, form)
            open_ = []
            for alarm in found:
                k = find_explanation(target, alarm, rows)
                if k is None:
                    open_.append(alarm)
                    print(f"eva: {target}, {form}: {' | '.join(alarm)}", file=sys.stderr)
                else:
                    used[k].add(alarm)
            wrong += len(open_)
            results.append((target, form, numbers, found, open_))
            print(
                f"eva: {target}, {form}: {len(found)} alarms, {len(open_)} of them not "
                f"explained; {seconds:.0f} s",
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
        REPORT.write_text(format_page(results, rows, used, given.target))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
