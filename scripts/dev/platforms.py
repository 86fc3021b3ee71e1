#!/usr/bin/env python3
"""The same bits everywhere: the recorded drive on every machine and with every compiler that is installed, in every number format.

    python3 scripts/dev/platforms.py              all; writes scripts/results/platforms.md
    python3 scripts/dev/platforms.py --short      those that differ most, half a minute: in the tests
    python3 scripts/dev/platforms.py --only TEXT  those with this in their name; prints, writes nothing

A machine agrees when the hash of every bit of every output of every row is that of tests/replay/golden_<format>.csv: of the default
form everywhere, and of the form with particles, in each way of resampling, where nothing is emulated. Fails when one does not, and
when a build that would lose bits compiles. Tools: `scripts/setup.sh machines` says which are missing. What has run is kept in
build/platforms.json: a run that was interrupted goes on, and nothing runs twice with the same sources, compiler and flags.
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
STACK = 5_500  # bytes below main(): 4 476 of tse_step() in float at -O2, then settings and outputs; of double more
SAME, REFUSED = "yes", "refused, as it must be"
HEAD = """\
<!-- Written by `python3 scripts/dev/platforms.py`. -->

Does the recorded drive (tests/replay, {rows} rows) have the same bits? Hash of every bit of every output of every row against the
golden one, by machine, compiler and number format. All with `-std=c99 {flags}`, of the two
files of `scripts/dev/amalgamate.py` without effects. Nothing emulated: default, robust and paper's form with all ways of resampling;
emulated: the default form. -: not asked of it.

"""


@dataclass
class Result:
    machine: m.Machine
    real: str
    says: str = ""

    @property
    def is_fine(self) -> bool:
        return self.says in (SAME, REFUSED) or self.says.startswith("skipped")


def capacities(machine: m.Machine) -> list[str]:
    """Options of the library: a microcontroller holds the default form and the fewest rows for channels that are logged late."""
    if machine.board:
        without = ["-DTSE_NO_EFFECTS", "-DTSE_NO_PARTICLES", "-DTSE_NO_DESCRIBE"]
        return [*without, "-DTSE_MAX_PARTICLES=16", "-DTSE_LATENCY_ROWS=8"]
    return ["-DTSE_NO_EFFECTS"] if machine.run else ["-DTSE_NO_EFFECTS", "-DALL_FORMS"]


def reason(text: str) -> str:
    """One line of what a compiler or a program said."""
    if why := m.does_not_fit(text):
        return f"skipped: {why} ({STACK:,} B)" if "stack" in why else f"skipped: {why}"
    lines = [
        x for x in text.splitlines() if "error" in x or "refused" in x or "fault" in x
    ] or text.splitlines()
    return lines[0][:200] if lines else "it says nothing"


def replay(work: m.Work, machine: m.Machine, real: str) -> str:
    name = "-".join((machine.name, machine.compiler(), *machine.flags))
    try:
        program = m.build(work, machine, real, "replay.c", name, *capacities(machine), stack=STACK)
    except m.Failed as error:
        if machine.refused and "#error" in str(error):
            return REFUSED
        return reason(str(error))
    if machine.refused:
        return "it compiles, and loses bits"
    try:
        text = m.run(machine, program)
    except m.Failed as error:
        return f"no: {reason(str(error))}"
    found = {form: hash_ for hash_, form in re.findall(r"^hash (\w+) (.+)$", text, re.M)}
    expected = m.golden(real)
    if "default, scheme 0" not in found:
        return f"no: {reason(text)}"
    wrong = [form for form, hash_ in found.items() if expected.get(form) != hash_]
    return f"no: other bits of {', '.join(wrong)}" if wrong else SAME


def name_of(work: m.Work, machine: m.Machine, real: str) -> str:
    """Of all that decides a result: sources, drive, golden hashes, compiler, flags."""
    files = [work.sources() / name for name in ("tse.c", "tse.h", "rows.h")]
    files += [m.HERE / "replay.c", m.HERE / machine.port]
    files += [
        m.HERE / "drive.h",
        m.HERE / "port.h",
        m.ROOT / "tests" / "replay" / "replay_hash.h",
        m.golden_file(real),
    ]
    said = repr((machine, real, machine.version(), machine.emulator(), capacities(machine))).replace(
        str(m.ROOT), ""
    )
    return hashlib.sha256(b"".join(f.read_bytes() for f in files) + said.encode()).hexdigest()


def asked(only: str, short: bool) -> list[Result]:
    """What is to be found out; what no preset of CMake runs, because it is emulated, comes first."""
    out = []
    for machine in sorted(m.machines(), key=lambda x: not x.run):
        for real in m.formats():
            is_asked = (
                real not in machine.leaves
                and (not machine.only or real in machine.only)
                and only in machine.name
            )
            if is_asked and (real in machine.short or not short):
                out.append(Result(machine, real))
    return out


def find_out(work: m.Work, results: list[Result], again: bool) -> Iterator[Result]:
    """Fill in what each says."""
    kept: dict[str, str] = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    for r in results:
        if why := r.machine.missing():
            r.says = f"skipped: {why}"
        else:
            r.says = "" if again else kept.get(name_of(work, r.machine, r.real), "")
    for r in sorted(results, key=lambda x: not x.says):
        start, machine, real = time.monotonic(), r.machine, r.real
        if not r.says:
            r.says = replay(work, machine, real)
            if r.is_fine:  # what is not is asked again
                kept[name_of(work, machine, real)] = r.says
                KEPT.parent.mkdir(exist_ok=True)
                KEPT.write_text(json.dumps(kept))
        yield r
        flags, seconds = " ".join(shown(machine)), time.monotonic() - start
        print(
            f"{machine.name:28s} {machine.compiler():24s} {flags:42s} {real:6s} {r.says} ({seconds:.0f} s)",
            flush=True,
        )


def shown(machine: m.Machine) -> list[str]:
    """The flags that matter to a reader."""
    return [
        f
        for f in machine.flags
        if not f.startswith(("-I", "-ffunction", "-fdata", "-fno-builtin", "-D", "-nostd", "-mthumb"))
    ]


def table(results: list[Result]) -> str:
    formats = m.formats()
    rows: dict[tuple[str, ...], dict[str, str]] = {}
    for r in results:
        x = r.machine
        version = f"{x.compiler()} {x.version()}" if not x.missing() else x.compiler()
        key = (x.name, version, f"`{' '.join(shown(x)) or '-'}`", x.emulator() if not x.missing() else "-")
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
        f"{same} of {all_} builds that ran have the same bits; {refused} that would lose some do not compile.",
    ]
    if left:
        lines += [f"The run was interrupted: {left} are left."]
    return "\n".join(lines) + "\n"


def main() -> int:
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
        results = asked(args.only, args.short)
        head = HEAD.format(rows=m.rows().count("\n"), flags=" ".join(m.FLAGS))
        for _ in find_out(work, results, args.short):
            if not args.short and not args.only:
                RESULTS.write_text(head + table(results))
    wrong = [r for r in results if not r.is_fine]
    for r in wrong:
        print(
            f"FAILED: {r.machine.name}, {r.machine.compiler()}, {' '.join(r.machine.flags)}, {r.real}: {r.says}"
        )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
