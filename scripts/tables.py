#!/usr/bin/env python3
"""Write the public header of a log row, and the rows that the sources include, from src/tables/input.toml.

scripts/tables.py            write
scripts/tables.py --check    change nothing; fails, and names the files, where something would be
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "src" / "tables" / "input.toml"
WRITTEN = "Written from src/tables/input.toml by scripts/tables.py, not by hand."
Row = dict[str, Any]

HEADER = """\
/* tse/input.h - one log row. {written} */
#ifndef TSE_INPUT_H
#define TSE_INPUT_H

#include <stdint.h>

#include "tse/real.h"

/* A channel is missing when it is NaN or its bit is set in `missing`. Velocities and what the pedals do are the other way
 * round: what is not given is not there, so that a row of zeros measures none. Set the struct to zero before it is filled. */
typedef struct tse_input {{
{members}
}} tse_input;

enum {{ /* bits of tse_input.missing: TSE_MISSING(accel_x) */
{channels}
  TSE_CHANNELS
}};
#define TSE_MISSING(name) (1u << TSE_CHANNEL_##name)

enum {{ /* bits of tse_input.given: TSE_GIVEN(gnss_speed) */
{optionals}
  TSE_OPTIONALS
}};
#define TSE_GIVEN(name) (1u << TSE_OPTIONAL_##name)
#define TSE_VELOCITIES {count} /* the first of them are velocities, the others what the pedals do */
#define TSE_GIVEN_VELOCITIES ((1u << TSE_VELOCITIES) - 1u) /* all bits of the velocities */

#endif
"""

INPUT_ROWS = """\
/* tse/input.def - INPUT(name, min, max, unit, kind, text) of each channel. {written}
 * kind D: drives the model (out of range: refused)   kind M: is measured (out of range: treated as missing) */
{channels}
#undef INPUT
"""

OPTIONAL_ROWS = """\
/* tse/optional.def - the channels that count where their bit of tse_input.given is set. {written}
 * OPTIONAL(name, min, max, unit, text) of all, or VELOCITY and PEDAL alike of some; out of range: not there */
#ifdef OPTIONAL
#define VELOCITY OPTIONAL
#define PEDAL OPTIONAL
#endif
#ifdef VELOCITY
{velocities}
#endif
#ifdef PEDAL
{pedals}
#endif
#undef VELOCITY
#undef PEDAL
#undef OPTIONAL
"""


def member(row: Row, outside: str) -> str:
    """Return the member of the struct with what one has to know of it on the same line."""
    about = f"[{row['unit']}] {row['least']:g} .. {row['most']:g}, {outside}; {row['text']}"
    return f"  tse_real {row['name'] + ';':<19} /* {about} */"


def macro(name: str, row: Row) -> str:
    """Return the row as a call of a macro, for the sources that still include rows."""
    kind = {"drives": "D, ", "measured": "M, "}[row["kind"]] if "kind" in row else ""
    quoted = json.dumps(row["unit"]), json.dumps(row["text"])
    return f"{name}({row['name']}, {row['least']!r}, {row['most']!r}, {quoted[0]}, {kind}{quoted[1]})"


def written() -> dict[Path, str]:
    """Return the files that follow from the table, and their text."""
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    channels, velocities, pedals = table["channel"], table["velocity"], table["pedal"]
    outside = {"drives": "else refused", "measured": "else missing"}
    members = [
        "  tse_real dt;                 /* [s] time since the previous row, (0, 3600]; ignored after tse_reset()"
        " up to the first row with all inputs */",
        *(member(x, outside[x["kind"]]) for x in channels),
        "  uint32_t missing;            /* bits TSE_MISSING(accel_x) of the channels above */",
        "  uint32_t given;              /* bits TSE_GIVEN(ins_vel_y) of those below that were measured;"
        " 0: none, then they are not read */",
        *(member(x, "else not there") for x in velocities + pedals),
    ]
    tse = ROOT / "include" / "tse"
    return {
        tse / "input.h": HEADER.format(
            written=WRITTEN,
            members="\n".join(members),
            channels="\n".join(f"  TSE_CHANNEL_{x['name']}," for x in channels),
            count=len(velocities),
            optionals="\n".join(f"  TSE_OPTIONAL_{x['name']}," for x in velocities + pedals),
        ),
        tse / "input.def": INPUT_ROWS.format(written=WRITTEN, channels="\n".join(macro("INPUT", x) for x in channels)),
        tse / "optional.def": OPTIONAL_ROWS.format(
            written=WRITTEN,
            velocities="\n".join(macro("VELOCITY", x) for x in velocities),
            pedals="\n".join(macro("PEDAL", x) for x in pedals),
        ),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description="Write the headers that follow from src/tables.")
    parser.add_argument("--check", action="store_true", help="change nothing; fail where something would be")
    check = parser.parse_args().check
    status = 0
    for path, text in written().items():
        if path.exists() and path.read_text(encoding="utf-8") == text:
            continue
        if check:
            print(f"tables: {path.relative_to(ROOT)} is not what src/tables says: scripts/tables.py", file=sys.stderr)
            status = 1
        else:
            path.write_text(text, encoding="utf-8")
    return status


if __name__ == "__main__":
    sys.exit(main())
