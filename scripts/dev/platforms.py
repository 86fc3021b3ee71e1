#!/usr/bin/env python3
"""Check on every installed machine and compiler that estimates are equal in all bits.

    python3 scripts/dev/platforms.py
        run all machines; write scripts/results/platforms.md
    python3 scripts/dev/platforms.py --short
        run a few machines that cover both byte orders, several word sizes and several
        compilers: half a minute. The tests do the same
    python3 scripts/dev/platforms.py --only TEXT
        run machines with TEXT in their name; write no file

The filter runs on a recorded drive. A machine passes if the hash of all bits of all
outputs of all rows equals the hash in tests/replay/golden_<format>.csv. All machines run
the default filter. Machines that are not emulated also run the particle filter, with each
method of resampling. Some machines have compiler flags that change bits, such as x87
arithmetic: there, the library must refuse to compile. The script fails if a hash differs,
or if the library compiles where it must refuse. `scripts/setup.sh machines` lists missing
tools. build/platforms.json keeps the result of each machine that has passed. A later call
without --short uses this result if sources, compiler and flags have not changed, so that
after an interruption only the remaining machines are run.
"""

import argparse
import hashlib
import json
import re
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import machines as m

RESULTS = m.ROOT / "scripts" / "results" / "platforms.md"
KEPT = m.ROOT / "build" / "platforms.json"
# [bytes] min RAM for the stack; with less, the program does not link. In float at -O2,
# tse_step() needs 4 476; the rest is for settings and outputs in main(). The format
# double needs more, but is run only on boards with 4 MB of RAM. There, the stack can use
# all free RAM.
STACK = 5_500
SAME, REFUSED = "yes", "refused, as it must be"
HEAD = """\
<!-- Written by `python3 scripts/dev/platforms.py`. -->

Are the estimates of the recorded drive (tests/replay, {rows} rows) equal in all bits? By
machine, compiler and number format: `yes` if the hash of all bits of all outputs of all rows
equals the golden hash. All are compiled with `-std=c99 {flags}`
from the two files of `scripts/dev/amalgamate.py`, without effects. Emulated machines run the
default filter, other machines also the robust and the paper's filter with all methods of
resampling. -: not run.

"""


@dataclass
class Result:
    """Verdict on one machine in one number format: are all bits as expected?"""

    machine: m.Machine
    real: str  # number format of the library, e.g. "double"
    says: str = ""  # verdict: SAME, REFUSED, or why it failed or was skipped; "": not run

    @property
    def is_fine(self) -> bool:
        """True if the machine passed or was skipped."""
        return self.says in (SAME, REFUSED) or self.says.startswith("skipped")


def list_options(machine: m.Machine) -> list[str]:
    """Return the options with which the library is compiled for a machine.

    Effects are always left out. Microcontrollers have only the default filter. For
    channels that arrive late, they keep 8 rows, the minimum. Machines without an emulator
    run all filters (ALL_FORMS).
    """
    if machine.board:
        without = ["-DTSE_NO_EFFECTS", "-DTSE_NO_PARTICLES", "-DTSE_NO_DESCRIBE"]
        return [*without, "-DTSE_MAX_PARTICLES=16", "-DTSE_LATENCY_ROWS=8"]
    return ["-DTSE_NO_EFFECTS"] if machine.run else ["-DTSE_NO_EFFECTS", "-DALL_FORMS"]


def find_reason(text: str) -> str:
    """Return the reason for a failed run: the line of its output that states the error.

    If the program is too large for the machine, return "skipped: " and the reason."""
    if why := m.explain_misfit(text):
        return f"skipped: {why} ({STACK:,} B)" if "stack" in why else f"skipped: {why}"
    lines = [
        x for x in text.splitlines() if "error" in x or "refused" in x or "fault" in x
    ] or text.splitlines()
    return lines[0][:200] if lines else "no output"


def replay(work: m.Work, machine: m.Machine, real: str) -> str:
    """Build the program that runs the filter on the recorded drive. Run it on a machine.

    Return the verdict as in Result.says."""
    name = "-".join((machine.name, machine.name_compiler(), *machine.flags))
    try:
        program = m.build_program(work, machine, real, "replay.c", name, *list_options(machine), stack=STACK)
    except m.Failed as error:
        if machine.refused and "#error" in str(error):
            return REFUSED
        return find_reason(str(error))
    if machine.refused:
        return "no: it compiles with flags that it must refuse, because they change bits"
    try:
        text = m.run_program(machine, program)
    except m.Failed as error:
        return f"no: {find_reason(str(error))}"
    found = {form: hash_ for hash_, form in re.findall(r"^hash (\w+) (.+)$", text, re.M)}
    expected = m.read_golden(real)
    if "default, scheme 0" not in found:  # scheme: number of the method of resampling
        return f"no: {find_reason(text)}"
    wrong = [form for form, hash_ in found.items() if expected.get(form) != hash_]
    return f"no: the bits differ: {', '.join(wrong)}" if wrong else SAME


def make_key(work: m.Work, machine: m.Machine, real: str) -> str:
    """Return a hash of everything on which a result depends.

    A result depends on sources, drive, golden hashes, compiler, emulator and flags."""
    files = [work.write_sources() / name for name in ("tse.c", "tse.h", "rows.h")]
    files += [m.HERE / "replay.c", m.HERE / machine.port]
    files += [
        m.HERE / "drive.h",
        m.HERE / "port.h",
        m.ROOT / "tests" / "replay" / "replay_hash.h",
        m.find_golden_file(real),
    ]
    said = repr(
        (machine, real, machine.read_version(), machine.name_emulator(), list_options(machine))
    ).replace(str(m.ROOT), "")
    return hashlib.sha256(b"".join(f.read_bytes() for f in files) + said.encode()).hexdigest()


def list_results(only: str, short: bool) -> list[Result]:
    """Return a Result without a verdict for each machine and format to run.

    Emulated machines come first, so that their failures are seen first. Only this script
    tests emulated machines. This computer is also tested by the presets of CMake."""
    out = []
    for machine in sorted(m.list_machines(), key=lambda x: not x.run):
        for real in m.read_formats():
            is_asked = (
                real not in machine.leaves
                and (not machine.only or real in machine.only)
                and only in machine.name
            )
            if is_asked and (real in machine.short or not short):
                out.append(Result(machine, real))
    return out


def run_missing(work: m.Work, results: list[Result], again: bool) -> Iterator[Result]:
    """Run each machine without a result in build/platforms.json. Yield all results.

    `again`: True runs all machines."""
    kept: dict[str, str] = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    for r in results:
        if why := r.machine.find_missing():
            r.says = f"skipped: {why}"
        else:
            r.says = "" if again else kept.get(make_key(work, r.machine, r.real), "")
    for r in sorted(results, key=lambda x: not x.says):
        start, machine, real = time.monotonic(), r.machine, r.real
        if not r.says:
            r.says = replay(work, machine, real)
            if r.is_fine:  # a failure is not kept, so that it runs again next time
                kept[make_key(work, machine, real)] = r.says
                KEPT.parent.mkdir(exist_ok=True)
                KEPT.write_text(json.dumps(kept))
        yield r
        flags, seconds = " ".join(list_flags(machine)), time.monotonic() - start
        print(
            f"{machine.name:28s} {machine.name_compiler():24s} {flags:42s} "
            f"{real:6s} {r.says} ({seconds:.0f} s)",
            flush=True,
        )


def list_flags(machine: m.Machine) -> list[str]:
    """Return the compiler flags of a machine for the table of results.

    -I, -D, and flags that all similar machines have, such as -mthumb, are left out."""
    return [
        f
        for f in machine.flags
        if not f.startswith(("-I", "-ffunction", "-fdata", "-fno-builtin", "-D", "-nostd", "-mthumb"))
    ]


def format_table(results: list[Result]) -> str:
    """Return the table of all results."""
    formats = m.read_formats()
    rows: dict[tuple[str, ...], dict[str, str]] = {}
    for r in results:
        x = r.machine
        version = f"{x.name_compiler()} {x.read_version()}" if not x.find_missing() else x.name_compiler()
        key = (
            x.name,
            version,
            f"`{' '.join(list_flags(x)) or '-'}`",
            x.name_emulator() if not x.find_missing() else "-",
        )
        rows.setdefault(key, {})[r.real] = r.says or "not run"
    lines = [
        f"| machine | compiler | flags | run by | {' | '.join(formats)} |",
        f"|---|---|---|---|{'---|' * len(formats)}",
    ]
    lines += [
        f"| {' | '.join(key)} | {' | '.join(of.get(real, '-') for real in formats)} |"
        for key, of in rows.items()
    ]
    ran = [r for r in results if r.says and not r.says.startswith("skipped")]
    same, all_ = sum(r.says == SAME for r in ran), sum(not r.machine.refused for r in ran)
    refused, left = sum(r.says == REFUSED for r in ran), sum(not r.says for r in results)
    lines += [
        "",
        f"{same} of {all_} builds that ran give the same bits; "
        f"{refused} that would give different bits are refused by the compiler.",
    ]
    if left:
        lines += [f"The run was interrupted: {left} builds have not run."]
    return "\n".join(lines) + "\n"


def main() -> int:
    """Run the filter on the machines, write the table of verdicts, print failures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--short", action="store_true", help="run only a few, very different machines, each in some formats"
    )
    parser.add_argument(
        "--only", default="", metavar="TEXT", help="run only machines with TEXT in their name; write no file"
    )
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        work = m.Work(Path(folder))
        results = list_results(args.only, args.short)
        head = HEAD.format(rows=m.write_rows().count("\n"), flags=" ".join(m.FLAGS))
        for _ in run_missing(work, results, args.short):
            if not args.short and not args.only:
                RESULTS.write_text(head + format_table(results))
    wrong = [r for r in results if not r.is_fine]
    for r in wrong:
        print(
            f"FAILED: {r.machine.name}, {r.machine.name_compiler()}, "
            f"{' '.join(r.machine.flags)}, {r.real}: {r.says}"
        )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
