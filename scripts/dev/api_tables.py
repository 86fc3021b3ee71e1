"""Write the typed names of the Python API, scripts/tse/_tables.py, from tables of the C
library.

    .venv/bin/python scripts/dev/api_tables.py
        write the file
    .venv/bin/python scripts/dev/api_tables.py --check
        fail if the file differs from the tables; a test runs this

A file instead of names made at run time: type checkers and editors read it, too.
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
}  # units of the API; the library has these values relative to nominal
HEAD = '''\
"""Names, units and ranges of the library's tables, by scripts/dev/api_tables.py."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, TypedDict

from tse._base import EstimateBase
'''


WIDTH = 90  # columns; the indent and quotes of a docstring take ten


def format_docstring(text: str, unit: str = "") -> str:
    """Return the docstring of an attribute, at most WIDTH wide."""
    text = text[:1].upper() + text[1:] + (f" [{unit}]" if unit not in ("", "1") else "")
    lines = textwrap.wrap(text.replace('"', "'") + ("" if text.endswith(".") else "."), WIDTH - 10)
    return textwrap.indent('"""' + "\n".join(lines) + '"""', "    ")


def write_row() -> list[str]:
    """Return the lines of the typed row."""
    lines = []
    for f in library().fields(INPUT):
        if f.name in ("missing", "given"):
            continue
        if f.name == "dt":
            lines += [
                "    dt: float",
                format_docstring(
                    "time since the row before; not needed in the first row. Or give `time`",
                    "s, above 0 .. 3600",
                ),
            ]
            lines += [
                "    time: float",
                format_docstring("on any clock; `dt` is what it has gone on since the row before", "s"),
            ]
            continue
        lines += [f"    {f.name}: float", format_docstring(f.text, f.range_text)]
    return lines


def find_stiffness(f: Field) -> str | None:
    """Return the stiffness that a field belongs to, or None."""
    return next((s for s in STIFFNESS if f.name == s or f.name.startswith(s + "_")), None)


def write_estimate() -> list[str]:
    """Return the lines of the class of estimates."""
    lines = [
        "    time: float",
        format_docstring("of the row, on the clock of `time`; else the sum of `dt`", "s"),
    ]
    for f in library().fields(OUTPUT):
        stiffness = find_stiffness(f)
        if f.name.endswith("_valid"):
            judged = f.name.removesuffix("_valid")
            lines += [
                f"    {f.name}: bool",
                format_docstring(f"whether {judged} may be used; {judged}_reason is the reason if not"),
            ]
            lines += [
                f"    {judged}_reason: Reason",
                format_docstring(f"'valid', or the reason why {judged} is not"),
            ]
        elif f.name.endswith("_spread_seen"):
            lines += [
                f"    {f.name}: bool",
                format_docstring(
                    "whether the spread is estimated; else it is below what sensors and excitation show"
                ),
            ]
        elif f.name == "status":
            lines += ["    status: Status", format_docstring("use of the row; `status_text` is a sentence")]
        elif f.name == "fault_channel":
            lines += [
                "    fault_channel: str | None",
                format_docstring("the channel that is likeliest at fault; None: none"),
            ]
        elif f.is_integer:
            lines += [f"    {f.name}: int", format_docstring(f.text)]
        else:
            unit = UNITS[stiffness] if stiffness and f.unit == "1" else f.unit
            lines += [f"    {f.name}: float", format_docstring(f.text, unit)]
    return lines


def write_module() -> str:
    """Return the text of the module."""
    lib = library()
    status = []
    for code, f in sorted(lib.codes(STATUS).items()):
        status += [f"    {f.name.removeprefix('TSE_').removeprefix('W_')} = {code}", format_docstring(f.text)]
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
            *write_row(),
            "",
            "",
            "@dataclass(frozen=True, slots=True)",
            "class Estimate(EstimateBase):",
            '    """Estimates after a row. SI units, stiffness per axle; `_sd`: standard deviation of',
            '    the mean."""',
            "",
            *write_estimate(),
            "",
        ]
    )


def main() -> int:
    """Write the file, or check it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="change nothing, fail when it differs")
    check = parser.parse_args().check
    there = FILE.read_text(encoding="utf-8") if FILE.exists() else ""
    if there == (new := write_module()):
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
