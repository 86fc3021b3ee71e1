"""The typed names of the Python API, from the tables of the C library: scripts/tse/_tables.py.

    .venv/bin/python scripts/dev/api_tables.py             write it
    .venv/bin/python scripts/dev/api_tables.py --check     say whether it is what the tables say; a test does

A file and not something made while Python runs: type checkers and editors read it, too.
"""

import argparse
import sys
import textwrap
from pathlib import Path

from tse.library.core import INPUT, OUTPUT, REASON, STATUS, STIFFNESS, Field, library

FILE = Path(__file__).resolve().parents[1] / "tse" / "_tables.py"
UNITS = {
    "cx_front": "N",
    "cy_front": "N/rad",
    "cy_rear": "N/rad",
}  # in which the API has what the library has relative to nominal
HEAD = '''\
"""Names, units and ranges of the library's tables, by scripts/dev/api_tables.py."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, TypedDict

from tse._base import EstimateBase
'''


WIDTH = 90  # columns, of which a docstring's indent and quotes take ten


def doc(text: str, unit: str = "") -> str:
    """Return the docstring of an attribute, at most WIDTH wide."""
    text = text[:1].upper() + text[1:] + (f" [{unit}]" if unit not in ("", "1") else "")
    lines = textwrap.wrap(text.replace('"', "'") + ("" if text.endswith(".") else "."), WIDTH - 10)
    return textwrap.indent('"""' + "\n".join(lines) + '"""', "    ")


def row_lines() -> list[str]:
    lines = []
    for f in library().fields(INPUT):
        if f.name in ("missing", "given"):
            continue
        if f.name == "dt":
            lines += [
                "    dt: float",
                doc(
                    "time since the row before; not needed in the first row. Or give `time`",
                    "s, above 0 .. 3600",
                ),
            ]
            lines += [
                "    time: float",
                doc("on any clock; `dt` is what it has gone on since the row before", "s"),
            ]
            continue
        lines += [f"    {f.name}: float", doc(f.text, f.range_text)]
    return lines


def stiffness_of(f: Field) -> str | None:
    return next((s for s in STIFFNESS if f.name == s or f.name.startswith(s + "_")), None)


def estimate_lines() -> list[str]:
    lines = ["    time: float", doc("of the row, on the clock of `time`; else the sum of `dt`", "s")]
    for f in library().fields(OUTPUT):
        stiffness = stiffness_of(f)
        if f.name.endswith("_valid"):
            judged = f.name.removesuffix("_valid")
            lines += [
                f"    {f.name}: bool",
                doc(f"whether {judged} may be used; {judged}_reason is the reason if not"),
            ]
            lines += [f"    {judged}_reason: Reason", doc(f"'valid', or the reason why {judged} is not")]
        elif f.name.endswith("_spread_seen"):
            lines += [
                f"    {f.name}: bool",
                doc("whether the spread is estimated; else it is below what sensors and excitation show"),
            ]
        elif f.name == "status":
            lines += ["    status: Status", doc("use of the row; `status_text` is a sentence")]
        elif f.name == "fault_channel":
            lines += [
                "    fault_channel: str | None",
                doc("the channel that is likeliest at fault; None: none"),
            ]
        elif f.is_integer:
            lines += [f"    {f.name}: int", doc(f.text)]
        else:
            unit = UNITS[stiffness] if stiffness and f.unit == "1" else f.unit
            lines += [f"    {f.name}: float", doc(f.text, unit)]
    return lines


def text() -> str:
    lib = library()
    status = []
    for code, f in sorted(lib.codes(STATUS).items()):
        status += [f"    {f.name.removeprefix('TSE_').removeprefix('W_')} = {code}", doc(f.text)]
    channels = ", ".join(f'"{f.name}"' for f in lib.channels)
    return "\n".join(
        [
            HEAD,
            f"CHANNELS = ({channels})",
            f"STIFFNESS = ({', '.join(repr(s) for s in STIFFNESS)})".replace("'", '"'),
            "Reason = Literal[",
            *(f'    "{f.name}",' for _, f in sorted(lib.codes(REASON).items())),
            "]",
            "",
            "",
            "class Status(IntEnum):",
            '    """Use of a row. Below 0: refused, nothing has changed; 0: used; above: used, with',
            '    this caution."""',
            "",
            *status,
            "",
            "",
            "class Row(TypedDict, total=False):",
            '    """One sample: SI units, ISO 8855 (x forward, y left, z up; angles and rates positive',
            '    to the left). A field that is left out, None or NaN is missing."""',
            "",
            *row_lines(),
            "",
            "",
            "@dataclass(frozen=True, slots=True)",
            "class Estimate(EstimateBase):",
            '    """Estimates after a row. SI units, stiffness per axle; `_sd`: standard deviation of',
            '    the mean."""',
            "",
            *estimate_lines(),
            "",
        ]
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="change nothing, fail when it differs")
    check = parser.parse_args().check
    there = FILE.read_text(encoding="utf-8") if FILE.exists() else ""
    if there == (new := text()):
        return 0
    if check:
        print(
            f"{FILE.name} is not what the library's tables say: run scripts/dev/api_tables.py",
            file=sys.stderr,
        )
        return 1
    FILE.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
