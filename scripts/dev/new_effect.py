#!/usr/bin/env python3
"""A contributor's first hour: the skeleton of an effect - its row, its function, its test, its place among the equations.

    python3 scripts/dev/new_effect.py brake_pull --hook BODY --parameter arm --unit m --low -0.5 --high 0.5 --typical 0.01 0.05

Afterwards everything builds, all tests pass but the new one, which says what to write. CONTRIBUTING.md, "Add an effect", explains
each part. Nothing is written where the name is taken or a value makes no sense; exit code 2, and a sentence says why.
Needs Python only.
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# hook -> where it acts, and its function: signature, what it begins with
HOOKS = {
    "CONSTANT": ("parameters", "void {id}_constant(tse_config *c)", "  /* c->mass += r_mul(c->mass, {at}); */\n  (void)c;"),
    "INPUT": (
        "front axle", "tse_real {id}_input(const tse_effects *e, tse_effect_memory *m, tse_real steer, tse_real dt)",
        "  (void)e;\n  (void)m;\n  (void)dt;\n  return steer; /* + {at} */",
    ),
    "SLIP": ("axles", "void {id}_slip(point *pt)", "  (void)pt; /* pt->s.a_rear += pt->p->effects.{at} ... */"),
    "STIFFNESS": ("axles", "void {id}_stiffness(point *pt)", "  (void)pt; /* pt->k.y_front *= ... pt->p->effects.{at} */"),
    "GRIP": ("axles", "void {id}_grip(point *pt)", "  (void)pt; /* pt->k.y_front *= ... pt->p->effects.{at} */"),
    "BODY": ("body", "void {id}_body(point *pt)", "  (void)pt; /* pt->force.y += ... over mass, by pt->p->effects.{at} */"),
    "SENSOR": ("sensors", "void {id}_sensor(reading *z)", "  (void)z; /* z->y[1] += z->pt->p->effects.{at} ... */"),
}  # fmt: skip
TEST = """/* tests/unit/model/test_effect_{id}.c <-> {id} of src/model/{laws}, against a formula that is not the code's. */
#include "unit_support.h"
#include "effect_support.h"

static void test_{id}_is_off_at_0_to_the_last_bit(void)
{{
  tse_config c = default_car();
  tse_real plain[400], with[400];
  straight(&c, 20, 0.01, 400);
  for (int i = 0; i < 400; i++) log_steer[i] = real(0.02 * sin(0.05 * i));
  replay(&c, 400);
  memcpy(plain, got_r, sizeof plain);
  c.{id}_{parameter} = setting(0);
  replay(&c, 400);
  memcpy(with, got_r, sizeof with);
  TEST_ASSERT_EQUAL_MEMORY(plain, with, sizeof plain);
}}

static void test_{id}_does_what_its_equation_says(void)
{{
  tse_config c = default_car();
  c.{id}_{parameter} = setting({large:g});
  straight(&c, 20, 0.01, 400);
  for (int i = 0; i < 400; i++) log_steer[i] = real(0.02);
  replay(&c, 400);
  /* Replace: what got_r, got_x, got_y (yaw rate, accel_x, accel_y of every row) are then, computed another way. */
  TEST_FAIL_MESSAGE("write the formula of {id} in src/model/{laws}, and here what it does, by another one");
}}
"""


def laws_of(hook: str) -> str:
    """Return the file in src/model that has the functions of a hook."""
    return "effects_constant.h" if hook == "CONSTANT" else "catalogue.h"


class Refused(Exception):
    """Why, in a sentence."""


def skeleton(asked: argparse.Namespace, root: Path = ROOT) -> dict[Path, str]:
    """Path -> text of every file that is new or changes.   Refused: the name is taken, or a value makes no sense"""
    table, equations = root / "src" / "tables" / "effects.toml", root / "src" / "EQUATIONS.md"
    rows = table.read_text(encoding="utf-8")
    if not re.fullmatch(r"[a-z][a-z0-9_]{2,39}", asked.name):
        raise Refused(f"{asked.name}: a name has 3 .. 40 small letters, digits and _, a letter first")
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,29}", asked.parameter):
        raise Refused(f"--parameter {asked.parameter}: 1 .. 30 small letters, digits and _")
    if f"\n[{asked.name}]\n" in rows:
        raise Refused(f"{asked.name}: there is such an effect in src/tables/effects.toml")
    small, large = asked.typical
    if (
        not asked.low <= 0 <= asked.high
        or not asked.low < asked.high
        or not 0 < small <= large <= max(asked.high, -asked.low)
    ):
        raise Refused(f"--low {asked.low:g} --high {asked.high:g} --typical {small:g} {large:g}: 0, which is off, must be in the "
                      "range, and the typical sizes, the smaller first, above 0 and in it")  # fmt: skip
    entry, signature, body = (
        part.format(id=asked.name, at=f"{asked.name}_{asked.parameter}") for part in HOOKS[asked.hook]
    )
    sign = 0 if asked.low < 0 < asked.high else 1 if asked.high > 0 else -1
    row = f"""
[{asked.name}]
hook = "{asked.hook}"
title = "{asked.name.replace("_", " ")}"
entry = "{entry}"
channels = "accel_y, yaw_rate"
alike = ""
estimator = "works"
parameter.{asked.parameter} = {{ role = "STRENGTH", default = 0.0, least = {asked.low!r}, most = {asked.high!r}, \
unit = "{asked.unit}", typical = [{small!r}, {large!r}], negligible = {small / 3:.3g}, sign = {sign}, \
text = "{asked.parameter.replace("_", " ")}: what it is, and which way is positive" }}
"""
    laws = root / "src" / "model" / laws_of(asked.hook)
    law = (
        f"/* {asked.name}: the equation, with units. Typical {asked.parameter} {small:g} .. {large:g} {asked.unit}. */\n"
        f"static inline {signature}\n{{\n{body}\n}}\n\n"
    )
    before, mark, after = laws.read_text(encoding="utf-8").partition("// clang-format off: table ")
    function, test = signature.split("(")[0].split()[-1], f"test_{asked.name}_does_what_its_equation_says"
    line = f"| {asked.name} | write it | `{function}` in src/model/{laws.name} | `{test}` |\n"
    text = equations.read_text(encoding="utf-8")
    last = list(re.finditer(r"^\| .* in src/model/(?:catalogue|effects_constant)\.h.*\n", text, re.M))
    at = last[-1].end() if last else len(text)
    return {
        table: rows + row,
        laws: before + law + mark + after,
        root / "tests" / "unit" / "model" / f"test_effect_{asked.name}.c": TEST.format(
            id=asked.name, parameter=asked.parameter, large=large, laws=laws.name
        ),
        equations: text[:at] + line + text[at:],
    }


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", help="the effect's id, for instance brake_pull")
    parser.add_argument(
        "--hook", choices=HOOKS, required=True, help="where the model calls it: see src/tables/effects.toml"
    )
    parser.add_argument("--parameter", default="strength", help="its strength; 0 is off")
    parser.add_argument("--unit", default="1")
    parser.add_argument("--low", type=float, default=-1.0, help="least value of the setting")
    parser.add_argument("--high", type=float, default=1.0, help="greatest")
    sizes = {"nargs": 2, "default": (0.05, 0.2), "metavar": ("LOW", "HIGH")}
    parser.add_argument("--typical", type=float, help="usual sizes on cars", **sizes)
    asked = parser.parse_args(arguments)
    try:
        files = skeleton(asked)
        for path in files:
            if path.exists() and path.name not in (
                "effects.toml",
                "catalogue.h",
                "effects_constant.h",
                "EQUATIONS.md",
            ):
                raise Refused(f"{path.relative_to(ROOT)} is there already")
    except Refused as error:
        print(f"new_effect: {error}", file=sys.stderr)
        return 2
    for path, text in files.items():
        path.write_text(text, encoding="utf-8")
    subprocess.run([sys.executable, ROOT / "scripts" / "dev" / "tables.py"], check=True)
    print("Written:", *(f"  {p.relative_to(ROOT)}" for p in files), "Next:", sep="\n")
    print(f"""  1. the equation and the formula, in src/model/{laws_of(asked.hook)}
  2. the texts of its row in src/tables/effects.toml: title, channels that show it, look-alikes
  3. the test: tests/unit/model/test_effect_{asked.name}.c; run it with
     cmake --preset dev && cmake --build --preset dev && ctest --preset dev -R test_effect_{asked.name}
  4. the row in src/EQUATIONS.md, .venv/bin/python scripts/dev/facts.py --fmu""")
    return 0


if __name__ == "__main__":
    sys.exit(main())
