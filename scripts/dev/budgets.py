#!/usr/bin/env python3
"""Measure the cost of the filter on microcontrollers.

The cost: instructions for a row of the log, bytes of flash, RAM and stack.

    python3 scripts/dev/budgets.py
        measure all targets; write scripts/results/budgets.md; fail if a limit is exceeded
    python3 scripts/dev/budgets.py --short
        measure the targets marked `short`, as the tests do
    python3 scripts/dev/budgets.py --profile FROM TO
        print how many instructions each function executes in rows FROM .. TO - 1 of the
        drive, on the first target

tests/budgets.toml has the targets and their limits. The programs run in the emulator
qemu. A count is the number of instructions that qemu executes. Clock cycles are not
measured. With -icount shift=6, each instruction takes 64 ns of emulated time. The timer
SysTick of the emulated processor measures the emulated time of a row. Divided by 64 ns,
this time is the number of instructions. To check the method, each run counts the
instructions of a loop of known length. Counts are the same in every run and on every
host.
"""

import argparse
import bisect
import collections
import math
import re
import sys
import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import machines as m

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

LIMITS = m.ROOT / "tests" / "budgets.toml"
RESULTS = m.ROOT / "scripts" / "results" / "budgets.md"
OPTIONS = (
    "-DTSE_NO_EFFECTS",
    "-DTSE_NO_PARTICLES",
    "-DTSE_NO_VELOCITY",
    "-DTSE_NO_DESCRIBE",
    "-DTSE_MAX_PARTICLES=16",
    "-DTSE_LATENCY_ROWS=8",
)
# Instructions of a row: "mean", maximum ("longest"), maximum / mean ("ratio"). Bytes:
# flash without the particle filter ("text"), flash with it ("all_forms"), "ram", "stack"
QUANTITIES = ("mean", "longest", "ratio", "text", "all_forms", "ram", "stack")
# options of qemu: each instruction takes 2^6 = 64 ns of emulated time
COUNTED = ("-icount", "shift=6")
CALIBRATION = 200_000  # instructions in the loop of known length that checks the count
# [bytes] assumed stack of a function of libc or libgcc, because the compiler reports no
# stack for these functions. The functions in use, such as memcpy and sqrt, need less.
EXTERNAL = 64


@dataclass
class Measured:
    """Cost of the filter on one target, and the limits of the target."""

    name: str
    # Key: quantity of QUANTITIES. Value: its "goal" and "limit", if there are any
    limits: dict[str, dict[str, float]]
    skipped: str = ""  # reason if the target was not measured, otherwise ""
    unfit: str = ""  # reason if the program does not fit into flash or RAM, otherwise ""
    values: dict[str, float] = field(default_factory=dict)  # key: quantity of QUANTITIES
    # Key: kind of rows. For example, "drive" are the rows of the recorded drive. KINDS
    # describes all kinds. Value: number of rows; mean and maximum of the number of
    # instructions of a row
    tallies: dict[str, tuple[int, int, int]] = field(default_factory=dict)
    stacks: dict[str, int] = field(default_factory=dict)  # [bytes] key: as described in STACKS

    def list_exceeded(self) -> list[str]:
        """Return a message for each limit that is exceeded."""
        if self.unfit and any("limit" in x for x in self.limits.values()):
            return [f"{self.name}: {self.unfit}"]
        over = [
            q for q in QUANTITIES if self.values.get(q, 0) > self.limits.get(q, {}).get("limit", math.inf)
        ]
        return [
            f"{self.name}: {q} {format_value(self.values[q])}, "
            f"the limit is {format_value(self.limits[q]['limit'])}"
            for q in over
        ]


def format_value(x: float) -> str:
    """Return a value with two decimals if it is below 100, otherwise as an integer."""
    return f"{x:.2f}" if x < 100 else f"{x:,.0f}"


# ---- measuring


def measure(work: m.Work, target: dict[str, Any]) -> Measured:
    """Build the programs of a target, run them, and return the cost of the filter."""
    out = Measured(target["name"], {q: target[q] for q in QUANTITIES if q in target})
    machine = next(x for x in m.list_machines() if x.name == target["machine"])
    if why := machine.find_missing():
        out.skipped = why
        return out
    defines = [f"-D{name}={value}" for name, value in target.get("define", {}).items()]
    flags = [*defines, *OPTIONS, "-fcallgraph-info=su"]
    folder = f"budgets-{target['name']}"
    try:
        fast = set_level(machine, target.get("level", "-O3"))
        program = m.build_program(
            work, fast, target["real"], "budgets.c", folder, *flags, stack=target.get("least_stack", 3072)
        )
        text = m.run_program(machine, program, *COUNTED)
        small = set_level(machine, "-Os")
        flash = {}
        for name, options in (
            ("text", OPTIONS),
            ("all_forms", [x for x in OPTIONS if x != "-DTSE_NO_PARTICLES"]),
        ):
            if name == "all_forms" and "TSE_SMALL" in target.get("define", {}):
                continue  # TSE_SMALL has no particles
            options = [*options, *defines]
            flash[name] = measure_flash(
                m.build_program(
                    work, small, target["real"], "smallest.c", f"{folder}-{name}", *options, stack=1024
                )
            )
    except m.Failed as error:
        if why := m.explain_misfit(str(error)):
            out.unfit = why
            return out
        raise SystemExit(f"{target['name']}: {error}") from error
    calibration = read_number(text, "calibration")
    if not 0 <= calibration - CALIBRATION < 10:
        raise SystemExit(
            f"{target['name']}: instruction count is wrong: {calibration} for a loop of {CALIBRATION}"
        )
    for name, rows, mean, longest in re.findall(
        r"^tally (\w+) rows (\d+) mean (\d+) longest (\d+)", text, re.M
    ):
        out.tallies[name] = int(rows), int(mean), int(longest)
    mean, longest = out.tallies["drive"][1], max(x[2] for x in out.tallies.values())
    out.stacks = {
        "written": read_number(text, "bytes stack_step"),
        "prepare": read_number(text, "bytes stack_prepare"),
    }
    out.stacks["deepest path"] = find_deepest_stack(program.parent, "tse_step")
    out.values = {
        "mean": mean,
        "longest": longest,
        "ratio": longest / mean,
        **flash,
        "ram": read_number(text, "bytes filter") + read_number(text, "bytes params"),
        "stack": max(out.stacks["written"], out.stacks["deepest path"]),
    }
    return out


def set_level(machine: m.Machine, level: str) -> m.Machine:
    """Return a copy of the machine with another optimisation level, such as "-Os"."""
    return replace(machine, flags=tuple(level if f in ("-O2", "-Os") else f for f in machine.flags))


def read_number(text: str, name: str) -> int:
    """Return the number in a program's output, from the line that begins with `name`."""
    return int(re.search(rf"^{name} (\d+)$", text, re.M)[1])


def measure_flash(program: Path) -> int:
    """Return the size [bytes] of a program in flash: code, constants, initial values."""
    said = m.run_command(["arm-none-eabi-size", "-A", str(program)])
    return sum(int(size) for size in re.findall(r"^\.(?:text|data|ARM\.exidx)\s+(\d+)", said, re.M))


def find_deepest_stack(folder: Path, name: str) -> int:
    """Return the stack [bytes] of the deepest chain of calls that starts in function
    `name`.

    gcc -fcallgraph-info=su writes .ci files with the stack of each function and with its
    calls. The stack of a chain is the sum over its functions. No chain is missed, because
    the library has no recursion and no calls through function pointers.
    """
    frames: dict[str, int] = {}
    calls: dict[str, set[str]] = collections.defaultdict(set)
    for path in folder.glob("*.ci"):
        text = path.read_text()
        for title, size in re.findall(
            r'node: \{ title: "([^"]+)" label: "[^"]*?\\n(\d+) bytes \(static', text
        ):
            frames[title] = int(size)
        for source, to in re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', text):
            calls[source].add(to)
    depth: dict[str, int] = {}

    def find_depth(title: str) -> int:
        if title not in depth:
            deepest = max((find_depth(x) for x in calls[title]), default=0)
            depth[title] = frames.get(title, EXTERNAL) + deepest
        return depth[title]

    start = [title for title in frames if re.fullmatch(rf"(.*:)?{name}(_\w+)?", title)]
    if len(start) != 1:
        raise SystemExit(f"{folder}: stack usage of {name} is missing in the compiler's .ci files")
    return find_depth(start[0])


@dataclass
class Flash:
    """Flash that the library needs on a Cortex-M4F, with number format float and -Os.

    The macros in `row` leave parts of the library out."""

    row: dict[str, Any]  # row `flash` of tests/budgets.toml: name, macros, limit [bytes]
    size: int = 0  # [bytes] flash that is needed; 0 if the compiler is not installed

    def list_exceeded(self) -> list[str]:
        """Return a list: one message if the limit is exceeded, otherwise empty."""
        over = self.size > self.row["limit"]
        return (
            [f"flash {self.row['name']}: {self.size:,}, the limit is {self.row['limit']:,}"] if over else []
        )


def measure_option(work: m.Work, row: dict[str, Any]) -> Flash:
    """Build the library for the Cortex-M4F, without the parts that `row` leaves out.
    Return its size in flash.

    `row`: a table [[flash]] of tests/budgets.toml. Its list `define` has the macros that
    leave out parts of the library."""
    machine = next(x for x in m.list_machines() if x.name == "Cortex-M4F")
    if machine.find_missing():
        return Flash(row)
    flags = ["-DTSE_NO_DESCRIBE", "-DTSE_MAX_PARTICLES=16", *(f"-D{x}" for x in row.get("define", []))]
    return Flash(
        row,
        measure_flash(
            m.build_program(
                work,
                set_level(machine, "-Os"),
                "float",
                "smallest.c",
                f"flash-{row['name']}",
                *flags,
                stack=1024,
            )
        ),
    )


# ---- instructions by function


def print_profile(work: m.Work, target: dict[str, Any], from_: int, to: int) -> None:
    """Print the 30 functions that execute the most instructions.

    Rows from_ to `to` - 1 of the drive are counted."""
    machine = next(x for x in m.list_machines() if x.name == target["machine"])
    flags = [f"-D{name}={value}" for name, value in target.get("define", {}).items()]
    fast = set_level(machine, target.get("level", "-O3"))
    program = m.build_program(work, fast, target["real"], "budgets.c", "profile", *OPTIONS, *flags)
    plugin, out = work.folder / "profile.so", work.folder / "profile.txt"
    m.run_command(["cc", "-O2", "-shared", "-fPIC", str(m.HERE / "profile.c"), "-o", str(plugin)])
    symbols = [line.split() for line in m.run_command(["arm-none-eabi-nm", "-n", str(program)]).splitlines()]
    functions = [
        (int(x[0], 16) & ~1, x[2]) for x in symbols if len(x) == 3 and x[1] in "tTwW" and x[2][0] != "$"
    ]
    mark = next(at for at, name in functions if re.fullmatch(r"tse_step(_\w+)?", name))
    m.run_program(
        machine, program, *COUNTED, "-plugin", f"{plugin},mark={mark},from={from_},to={to},out={out}"
    )
    count: collections.Counter[str] = collections.Counter()
    starts = [at for at, _ in functions]
    for line in out.read_text().splitlines():
        at, instructions, times = map(int, line.split())
        count[functions[bisect.bisect(starts, at) - 1][1]] += instructions * times
    rows = to - from_
    print(
        f"{target['name']}, rows {from_} .. {to - 1} of the drive: "
        f"{sum(count.values()) / rows:,.0f} instructions a row"
    )
    for name, of in count.most_common(30):
        print(f"{name:32s} {of / rows:10,.0f} {100 * of / sum(count.values()):5.1f} %")


# ---- the table

HEAD = """\
<!-- Written by `python3 scripts/dev/budgets.py`. -->

Cost of the default filter, compiled by {compiler}. Mean: instructions of a row, mean over
the recorded drive as an ordinary car. Longest: maximum over the drive and artificial rows.
Both are at -O3, as in CMakeLists.txt, unless the target names a different level. Flash: at
-Os without effects. Limits are from tests/budgets.toml. Bold: the goal is not met.

"""
KINDS = """\
Instructions of a row by kind of row, mean / longest. drive: the recorded drive; long: rows
of 0.1 s at 2.2 m/s and 9 m/s; slow: 2.2 m/s, rows of 10 ms; absurd: channels with wrong
values; breaks: pauses of 0.11 s and 100 s; missing: channels missing at random; late: the
drive with delayed steering angle and accel_x."""
FLASH = """\
Flash of the library on a Cortex-M4F, in float at -Os: settings, step and learnt state, with
the functions of libc that they call."""
STACKS = """\
Stack. written: bytes that `tse_step` overwrote in all these rows; deepest path: sum over the
deepest path of calls from `tse_step`; `tse_prepare`: bytes that it overwrote."""


def format_table(measured: list[Measured], flash: list[Flash]) -> str:
    """Return the tables of all targets in Markdown."""
    lines = [
        "| core, number format | mean [instructions] | longest [instructions] | longest / mean | flash [B] | "
        "flash with particle filter [B] | RAM [B] | stack [B] |",
        f"|---|{7 * '---:|'}",
    ]
    for x in measured:
        cells = []
        for q in QUANTITIES:
            limit = x.limits.get(q, {})
            goal = limit.get("goal")
            if q not in x.values:
                cells.append(f"- (goal {format_value(goal)})" if goal else "-")
                continue
            bold = "**" if goal and x.values[q] > goal else ""
            said = ", ".join(
                f"{name} {format_value(limit[name])}" for name in ("goal", "limit") if name in limit
            )
            cells.append(f"{bold}{format_value(x.values[q])}{bold}{f' ({said})' if said else ''}")
        lines.append(f"| {x.name} | {' | '.join(cells)} |")
    if skipped := [f"{x.name}: {x.skipped}" for x in measured if x.skipped]:
        lines += ["", f"Not measured: {'; '.join(skipped)}."]
    if unfit := [f"{x.name}: {x.unfit}" for x in measured if x.unfit]:
        lines += ["", f"Does not fit: {'; '.join(unfit)}."]
    lines += ["", KINDS, ""]
    kinds = ["drive", "long", "slow", "absurd", "breaks", "missing", "late"]
    lines += [f"| core, number format | {' | '.join(kinds)} |", f"|---|{'---:|' * len(kinds)}"]
    for x in measured:
        if x.tallies:
            lines.append(
                f"| {x.name} | {' | '.join(f'{x.tallies[k][1]:,} / {x.tallies[k][2]:,}' for k in kinds)} |"
            )
    lines += ["", STACKS, ""]
    lines += [
        "| core, number format | written [B] | deepest path [B] | `tse_prepare` [B] |",
        "|---|---:|---:|---:|",
    ]
    for x in measured:
        if x.stacks:
            lines.append(
                f"| {x.name} | {x.stacks['written']:,} | {x.stacks['deepest path']:,} "
                f"| {x.stacks['prepare']:,} |"
            )
    lines += ["", FLASH, "", "| build | flash [B] |", "|---|---:|"]
    for x in flash:
        said = ", ".join(f"{name} {x.row[name]:,}" for name in ("goal", "limit") if name in x.row)
        bold = "**" if x.size > x.row.get("goal", math.inf) else ""
        lines.append(f"| {x.row['name']} | {bold}{f'{x.size:,}' if x.size else '-'}{bold} ({said}) |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Measure the cost of the filter on each target, write tables, check the limits."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--short", action="store_true", help="measure only the targets that the tests measure; write no file"
    )
    parser.add_argument(
        "--only",
        default="",
        metavar="TEXT",
        help="measure only targets with TEXT in their name; write no file",
    )
    parser.add_argument(
        "--profile",
        nargs=2,
        type=int,
        metavar=("FROM", "TO"),
        help="print how many instructions each function executes in these rows",
    )
    args = parser.parse_args()
    limits = tomllib.loads(LIMITS.read_text())
    targets = limits["target"]
    targets = [t for t in targets if args.only in t["name"] and (t.get("short") or not args.short)]
    with tempfile.TemporaryDirectory() as folder:
        work = m.Work(Path(folder))
        if args.profile:
            print_profile(work, targets[0], *args.profile)
            return 0
        measured = [measure(work, t) for t in targets]
        flash = [measure_option(work, row) for row in limits["flash"] if not args.short and not args.only]
    text = HEAD.format(compiler=f"arm-none-eabi-gcc {m.read_version(('arm-none-eabi-gcc',))}") + format_table(
        measured, flash
    )
    print(text)
    if not args.short and not args.only:
        RESULTS.write_text(text)
        print(f"written: {RESULTS.relative_to(m.ROOT)}")
    passed = [line for x in [*measured, *flash] for line in x.list_exceeded()]
    for line in passed:
        print(f"FAILED: {line}")
    return 1 if passed else 0


if __name__ == "__main__":
    sys.exit(main())
