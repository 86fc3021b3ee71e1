#!/usr/bin/env python3
"""Write the skeleton of a new effect: table row, function, test, line in EQUATIONS.md.

    python3 scripts/dev/new_effect.py brake_pull --hook BODY --parameter arm --unit m \\
        --low -0.5 --high 0.5 --typical 0.01 0.05

An effect is a deviation of a car from the plain model: here, a brake that pulls to one
side. CONTRIBUTING.md, "Add an effect", explains each part of the skeleton.

The library with the skeleton builds, but two tests fail. The new test fails until you
write the formula. A test of the table of effects fails until the row names at least one
look-alike, i.e. an effect that changes the same channels in a similar way.

--hook selects the place in the model at which the new function is called. The simulator
and the replay call the function. (The replay computes the motion of the car from the
inputs in a log.) The filters do not call the function. Nevertheless, an effect with the
hook CONSTANT influences the filters, because it changes settings that they read.

If an effect NAME exists already or a value is not allowed, the script writes nothing,
prints the reason and ends with exit code 2. It needs Python only.
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# Key: hook, the place in the model at which the function of an effect is called. Value:
# part of the model that the effect changes (column `entry` of effects.toml), signature of
# its function, and body of its function, which changes nothing until the user writes the
# formula
HOOKS = {
    "CONSTANT": (
        "parameters",
        "void {id}_constant(tse_config *c)",
        "  /* c->mass += r_mul(c->mass, {at}); */\n  (void)c;",
    ),
    "INPUT": (
        "front axle",
        "tse_real {id}_input(const tse_effects *e, tse_effect_memory *m, tse_real steer, tse_real dt)",
        "  (void)e;\n  (void)m;\n  (void)dt;\n  return steer; /* + {at} */",
    ),
    "SLIP": (
        "axles",
        "void {id}_slip(point *pt)",
        "  (void)pt; /* pt->s.a_rear += pt->p->effects.{at} ... */",
    ),
    "STIFFNESS": (
        "axles",
        "void {id}_stiffness(point *pt)",
        "  (void)pt; /* pt->k.y_front *= ... pt->p->effects.{at} */",
    ),
    "GRIP": (
        "axles",
        "void {id}_grip(point *pt)",
        "  (void)pt; /* pt->k.y_front *= ... pt->p->effects.{at} */",
    ),
    "BODY": (
        "body",
        "void {id}_body(point *pt)",
        "  (void)pt; /* pt->force.y += ... over mass, by pt->p->effects.{at} */",
    ),
    "SENSOR": (
        "sensors",
        "void {id}_sensor(reading *z)",
        "  (void)z; /* z->y[1] += z->pt->p->effects.{at} ... */",
    ),
}
TEST = """/* tests/unit/model/test_effect_{id}.c <-> {id} of src/model/{laws}, against another formula. */
#include "unit_support.h"
#include "effect_support.h"

enum {{ ROWS_OF_LOG = 400 }};

/* Replay a drive at 20 m/s with sines of the steering angle. */
static void drive(tse_config *c, double strength)
{{
  c->{id}_{parameter} = setting(strength);
  straight(c, 20, 0.01, ROWS_OF_LOG);
  for (int i = 0; i < ROWS_OF_LOG; i++) log_steer[i] = real(0.02 * sin(0.05 * i));
  replay(c, ROWS_OF_LOG);
}}

/* The model is continuous at strength 0: a millionth of a typical size changes almost nothing. */
static void test_{id}_vanishes_with_its_strength(void)
{{
  tse_config c = default_car();
  drive(&c, 0);
  keep_readings();
  drive(&c, {tiny:g});
  for (int i = 0; i < ROWS_OF_LOG; i++) {{
    TEST_ASSERT_DOUBLE_WITHIN(0.001, number(kept_x[i]), number(got_x[i]));
    TEST_ASSERT_DOUBLE_WITHIN(0.001, number(kept_y[i]), number(got_y[i]));
    TEST_ASSERT_DOUBLE_WITHIN(0.0001, number(kept_r[i]), number(got_r[i]));
  }}
}}

static void test_{id}_does_what_its_equation_says(void)
{{
  tse_config c = default_car();
  drive(&c, {large:g});
  /* Replace this line: compare got_r, got_x, got_y (yaw rate, accel_x, accel_y of every row) with the
   * results of a different formula for the effect. */
  TEST_FAIL_MESSAGE("write the formula of {id} in src/model/{laws}, and a different one for its effect here");
}}
"""


def find_laws(hook: str) -> str:
    """Return the file in src/model to which the function of the effect is added.

    `hook`: the place in the model at which the function is called."""
    return "effects_constant.h" if hook == "CONSTANT" else "catalogue.h"


class Refused(Exception):
    """The skeleton of the new effect cannot be written. The message is the reason."""


def check_asked(asked: argparse.Namespace, rows: str) -> None:
    """Raise Refused if a name is wrong or exists, or a value is not allowed.

    Parameters
    ----------
    asked : argparse.Namespace
        Options of the script.
    rows : str
        Text of effects.toml.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]{2,39}", asked.name):
        raise Refused(f"{asked.name}: a name begins with a letter and has 3 .. 40 small letters, digits or _")
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,29}", asked.parameter):
        raise Refused(
            f"--parameter {asked.parameter}: a name begins with a letter and has 1 .. 30 small letters, "
            "digits or _"
        )
    if f"\n[{asked.name}]\n" in rows:
        raise Refused(f"{asked.name}: there is such an effect in src/tables/effects.toml; use another name")
    small, large = asked.typical
    in_range = asked.low <= 0 <= asked.high and asked.low < asked.high
    if not in_range or not 0 < small <= large <= max(asked.high, -asked.low):
        raise Refused(
            f"--low {asked.low:g} --high {asked.high:g} --typical {small:g} {large:g}: 0, which is off, "
            "must be in the range; the typical sizes must be above 0, in ascending order, and in the range"
        )


def write_row(asked: argparse.Namespace, entry: str) -> str:
    """Return the section of effects.toml for the effect.

    `asked`: options of the script; `entry`: part of the model that the effect changes."""
    small, large = asked.typical
    sign = 0 if asked.low < 0 < asked.high else 1 if asked.high > 0 else -1
    return f"""
[{asked.name}]
hook = "{asked.hook}"
title = "{asked.name.replace("_", " ")}"
entry = "{entry}"
channels = "accel_y, yaw_rate"
alike = ""
filter = "{find_filter(asked.hook)}"
occurrence = "SOME_CARS"
parameter.{asked.parameter} = {{ role = "STRENGTH", default = 0.0, least = {asked.low!r}, \
most = {asked.high!r}, unit = "{asked.unit}", typical = [{small!r}, {large!r}], \
negligible = {small / 3:.3g}, sign = {sign}, \
text = "{asked.parameter.replace("_", " ")}: what it is, and which way is positive" }}
"""


def find_filter(hook: str) -> str:
    """Return the column `filter` of a new effect: which filters use it.

    A CONSTANT effect changes settings, which both filters read. Any other effect is used
    by a filter only if src/model/car.c has its equation, which a skeleton does not write.
    """
    return "both" if hook == "CONSTANT" else "none"


def write_skeleton(asked: argparse.Namespace, root: Path = ROOT) -> dict[Path, str]:
    """Return the text of each new or changed file, with the path as key.

    Parameters
    ----------
    asked : argparse.Namespace
        Options of the script.
    root : Path
        Folder of the repository.

    Raises
    ------
    Refused
        The name is wrong or exists, or a value is not allowed.
    """
    table, equations = root / "src" / "tables" / "effects.toml", root / "src" / "EQUATIONS.md"
    rows = table.read_text(encoding="utf-8")
    check_asked(asked, rows)
    entry, signature, body = (
        part.format(id=asked.name, at=f"{asked.name}_{asked.parameter}") for part in HOOKS[asked.hook]
    )
    small, large = asked.typical
    laws = root / "src" / "model" / find_laws(asked.hook)
    law = (
        f"/* {asked.name}: the equation, with units. "
        f"Typical {asked.parameter} {small:g} .. {large:g} {asked.unit}. */\n"
        f"static inline {signature}\n{{\n{body}\n}}\n\n"
    )
    before, mark, after = laws.read_text(encoding="utf-8").partition("// clang-format off: table ")
    function, test = signature.split("(")[0].split()[-1], f"test_{asked.name}_does_what_its_equation_says"
    line = f"| {asked.name} | write it | `{function}` in src/model/{laws.name} | `{test}` |\n"
    text = equations.read_text(encoding="utf-8")
    if find_filter(asked.hook) == "none":
        text = text.replace("Not applied: ", f"Not applied: `{asked.name}`, ", 1)
    last = list(re.finditer(r"^\| .* in src/model/(?:catalogue|effects_constant)\.h.*\n", text, re.M))
    at = last[-1].end() if last else len(text)
    return {
        table: rows + write_row(asked, entry),
        laws: before + law + mark + after,
        root / "tests" / "unit" / "model" / f"test_effect_{asked.name}.c": TEST.format(
            id=asked.name, parameter=asked.parameter, tiny=1e-6 * small, large=large, laws=laws.name
        ),
        equations: text[:at] + line + text[at:],
    }


def main(arguments: list[str] | None = None) -> int:
    """Write the skeleton of a new effect, and print what the user must do next."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", help="id of the effect, for example brake_pull")
    parser.add_argument(
        "--hook",
        choices=HOOKS,
        required=True,
        help="where the model calls the function; see src/tables/effects.toml",
    )
    parser.add_argument("--parameter", default="strength", help="name of its strength; 0 is off (strength)")
    parser.add_argument("--unit", default="1", help="unit of the parameter (1)")
    parser.add_argument("--low", type=float, default=-1.0, help="lower end of the range of the parameter")
    parser.add_argument("--high", type=float, default=1.0, help="upper end of the range of the parameter")
    sizes = {"nargs": 2, "default": (0.05, 0.2), "metavar": ("LOW", "HIGH")}
    parser.add_argument("--typical", type=float, help="typical sizes on cars", **sizes)
    asked = parser.parse_args(arguments)
    try:
        files = write_skeleton(asked)
        for path in files:
            if path.exists() and path.name.startswith("test_"):
                raise Refused(f"{path.relative_to(ROOT)} exists already; use another name")
    except Refused as error:
        print(f"new_effect: {error}", file=sys.stderr)
        return 2
    for path, text in files.items():
        path.write_text(text, encoding="utf-8")
    subprocess.run([sys.executable, ROOT / "scripts" / "dev" / "tables.py"], check=True)
    print("Written:", *(f"  {p.relative_to(ROOT)}" for p in files), "Next:", sep="\n")
    print(f"""  1. in src/model/{find_laws(asked.hook)}: write the equation into the comment of the new
     function, and the code that computes it into the function
  2. complete the section [{asked.name}] of src/tables/effects.toml: title; channels that show the effect
     (channels); effects that change the same channels in a similar way (alike; enter {asked.name} in
     their sections as well); in which cars the effect occurs (occurrence)
  3. write the test, tests/unit/model/test_effect_{asked.name}.c, and run it:
     cmake --preset dev && cmake --build --preset dev && ctest --preset dev -R test_effect_{asked.name}
  4. complete the line in src/EQUATIONS.md; then run .venv/bin/python scripts/dev/facts.py --fmu
     and cd scripts && ../.venv/bin/python -m docsite.fill""")
    return 0


if __name__ == "__main__":
    sys.exit(main())
