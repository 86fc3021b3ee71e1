"""Generate scripts/tse/_tables.py, the typed names of the Python API.

    .venv/bin/python scripts/dev/api_tables.py
        write the file
    .venv/bin/python scripts/dev/api_tables.py --check
        fail if the file is out of date; a test runs this

The names come from the tables of the C library. They are written to a file because type
checkers and editors read files: names that are made at run time are invisible to them.
"""

import argparse
import sys
import textwrap
from pathlib import Path

from tse.library.core import INPUT, OUTPUT, REASON, STATUS, STIFFNESS, Field, library

FILE = Path(__file__).resolve().parents[1] / "tse" / "_tables.py"
# Key: stiffness. Value: its unit in the Python API. In the C library, stiffnesses have no
# unit: they are relative to their nominal values.
UNITS = {"cx_front": "N", "cy_front": "N/rad", "cy_rear": "N/rad"}
HEAD = '''\
"""Names, units and ranges of the C library. scripts/dev/api_tables.py wrote it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, TypedDict

from tse._base import EstimateBase
'''


WIDTH = 90  # max columns of a docstring line, including ten for indent and quotes


def format_docstring(text: str, unit: str = "") -> str:
    """Return the docstring of a class attribute as code of at most WIDTH columns."""
    text = text[:1].upper() + text[1:] + (f" [{unit}]" if unit not in ("", "1") else "")
    lines = textwrap.wrap(text.replace('"', "'") + ("" if text.endswith(".") else "."), WIDTH - 10)
    return textwrap.indent('"""' + "\n".join(lines) + '"""', "    ")


def write_row() -> list[str]:
    """Return the lines of code that declare the members of class Row, one sample."""
    lines = []
    for f in library().fields(INPUT):
        if f.name in ("missing", "given"):
            continue
        if f.name == "dt":
            lines += [
                "    dt: float",
                format_docstring(
                    "time since the previous row; not needed in the first row, or if `time` is given",
                    "s, above 0 .. 3600",
                ),
            ]
            lines += [
                "    time: float",
                format_docstring(
                    "time of the row on any clock; `dt` is then its difference to the previous row", "s"
                ),
            ]
            continue
        lines += [f"    {f.name}: float", format_docstring(f.text, f.range_text)]
    return lines


def find_stiffness(f: Field) -> str | None:
    """Return the stiffness to which an output belongs. Example: cy_rear for cy_rear_sd.

    Return None if the output does not belong to a stiffness."""
    return next((s for s in STIFFNESS if f.name == s or f.name.startswith(s + "_")), None)


def write_estimate() -> list[str]:
    """Return the lines of code that declare the members of class Estimate."""
    lines = [
        "    time: float",
        format_docstring("time of the row: its `time` or, if rows have none, the sum of `dt`", "s"),
    ]
    for f in library().fields(OUTPUT):
        stiffness = find_stiffness(f)
        if f.name.endswith("_valid"):
            judged = f.name.removesuffix("_valid")
            lines += [
                f"    {f.name}: bool",
                format_docstring(f"whether {judged} may be used; if not, {judged}_reason is the reason"),
            ]
            lines += [
                f"    {judged}_reason: Reason",
                format_docstring(f"'valid', or the reason why {judged} may not be used"),
            ]
        elif f.name.endswith("_spread_seen"):
            lines += [
                f"    {f.name}: bool",
                format_docstring(
                    "whether the spread is estimated; if not, it is the setting, or too small to observe"
                ),
            ]
        elif f.name == "status":
            lines += [
                "    status: Status",
                format_docstring("use of the row; `status_text` describes it in words"),
            ]
        elif f.name == "fault_channel":
            lines += [
                "    fault_channel: str | None",
                format_docstring("the channel that is most probably faulty; None if no channel is"),
            ]
        elif f.is_integer:
            lines += [f"    {f.name}: int", format_docstring(f.text)]
        else:
            unit = UNITS[stiffness] if stiffness and f.unit == "1" else f.unit
            lines += [f"    {f.name}: float", format_docstring(f.text, unit)]
    return lines


def write_module() -> str:
    """Return the text of scripts/tse/_tables.py."""
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
            '    """What the filter did with a row. Below 0: it refused the row, and the estimates are',
            '    unchanged. 0: it used the row. Above 0: it used the row. The code is a warning."""',
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
            '    """Estimates after a row. SI units. A stiffness is the sum over both tyres of an axle.',
            '    `_sd` is the standard deviation of an estimate."""',
            "",
            *write_estimate(),
            "",
        ]
    )


def main() -> int:
    """Write scripts/tse/_tables.py, or check that it is up to date."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--check", action="store_true", help="change nothing; fail if the file is out of date"
    )
    check = parser.parse_args().check
    there = FILE.read_text(encoding="utf-8") if FILE.exists() else ""
    if there == (new := write_module()):
        return 0
    if check:
        print(
            f"{FILE.name} differs from the library's tables: run scripts/dev/api_tables.py", file=sys.stderr
        )
        return 1
    FILE.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
