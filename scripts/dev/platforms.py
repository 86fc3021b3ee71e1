#!/usr/bin/env python3
"""Compare the bits of the recorded drive on every installed machine and compiler.

    python3 scripts/dev/platforms.py
        run all; write scripts/results/platforms.md
    python3 scripts/dev/platforms.py --short
        run the machines that differ most, half a minute, as the tests do
    python3 scripts/dev/platforms.py --only TEXT
        run machines with this text in their name; write no file

A machine passes if the hash of every bit of every output of every row equals that of
tests/replay/golden_<format>.csv. The default filter runs everywhere. The particle filter
runs with each way of resampling where nothing is emulated. The command fails if a hash
differs, or if a build compiles that would lose bits. `scripts/setup.sh machines` lists
missing tools. build/platforms.json keeps the results: an interrupted run is resumed, and
nothing runs twice with the same sources, compiler and flags.
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
# Bytes of stack below main(): tse_step() takes 4 476 in float at -O2, settings and
# outputs the rest. Double takes more.
STACK = 5_500
SAME, REFUSED = "yes", "refused, as it must be"
HEAD = """\
<!-- Written by `python3 scripts/dev/platforms.py`. -->

Does the recorded drive (tests/replay, {rows} rows) have the same bits? Hash of every bit of
every output of every row against the golden one, by machine, compiler and number format.
All with `-std=c99 {flags}`, of the two
files of `scripts/dev/amalgamate.py` without effects. Not emulated: default, robust and
paper's filter with all ways of resampling; emulated: the default filter. -: not run.

"""


@dataclass
class Result:
    """Result of one machine in one number format."""

    machine: m.Machine
    real: str
    says: str = ""

    @property
    def is_fine(self) -> bool:
        return self.says in (SAME, REFUSED) or self.says.startswith("skipped")


def list_options(machine: m.Machine) -> list[str]:
    """Return the options of the library.

    A microcontroller has the default filter only, with the smallest buffer for late
    channels.
    """
    if machine.board:
        without = ["-DTSE_NO_EFFECTS", "-DTSE_NO_PARTICLES", "-DTSE_NO_DESCRIBE"]
        return [*without, "-DTSE_MAX_PARTICLES=16", "-DTSE_LATENCY_ROWS=8"]
    return ["-DTSE_NO_EFFECTS"] if machine.run else ["-DTSE_NO_EFFECTS", "-DALL_FORMS"]


def find_reason(text: str) -> str:
    """Return the line of an output that states the error."""
    if why := m.explain_misfit(text):
        return f"skipped: {why} ({STACK:,} B)" if "stack" in why else f"skipped: {why}"
    lines = [
        x for x in text.splitlines() if "error" in x or "refused" in x or "fault" in x
    ] or text.splitlines()
    return lines[0][:200] if lines else "no output"


def replay(work: m.Work, machine: m.Machine, real: str) -> str:
    """Build and run the drive; return the verdict."""
    name = "-".join((machine.name, machine.name_compiler(), *machine.flags))
    try:
        program = m.build_program(work, machine, real, "replay.c", name, *list_options(machine), stack=STACK)
    except m.Failed as error:
        if machine.refused and "#error" in str(error):
            return REFUSED
        return find_reason(str(error))
    if machine.refused:
        return "it compiles, and loses bits"
    try:
        text = m.run_program(machine, program)
    except m.Failed as error:
        return f"no: {find_reason(str(error))}"
    found = {form: hash_ for hash_, form in re.findall(r"^hash (\w+) (.+)$", text, re.M)}
    expected = m.read_golden(real)
    if "default, scheme 0" not in found:
        return f"no: {find_reason(text)}"
    wrong = [form for form, hash_ in found.items() if expected.get(form) != hash_]
    return f"no: other bits of {', '.join(wrong)}" if wrong else SAME


def make_key(work: m.Work, machine: m.Machine, real: str) -> str:
    """Return a hash of sources, drive, golden hashes, compiler and flags."""
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
    """Return the results to find. Emulated machines, which no preset runs, come first."""
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
    """Run what build/platforms.json does not have; yield each result."""
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
            if r.is_fine:  # failures run again next time
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
    """Return the flags that matter to a reader."""
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
        f"{same} of {all_} builds that ran have the same bits; "
        f"{refused} that would lose some do not compile.",
    ]
    if left:
        lines += [f"The run was interrupted: {left} are left."]
    return "\n".join(lines) + "\n"


def main() -> int:
    """Run the machines and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--short", action="store_true", help="the machines that differ most, in the format that each is for"
    )
    parser.add_argument(
        "--only", default="", metavar="TEXT", help="machines with this in their name; no table is written"
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
