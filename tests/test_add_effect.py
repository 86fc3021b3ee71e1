"""Add an effect, a threshold and an output in the files that CONTRIBUTING names.

The change is made in a copy of the sources. scripts/dev/tables.py writes the other files,
and the library built from them has the new parts.
"""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tse.library.files import read_toml

ROOT = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.skipif(not shutil.which("cc"), reason="there is no compiler cc")
HEAD = """
#include <stdio.h>
#include <string.h>
#include "tse/describe.h"
#include "tse/simulate.h"
"""
EFFECT = r"""
static double turned(double arm) /* yaw rate after a second of braking straight on */
{
  tse_config c;
  tse_sim_config s;
  static tse_sim sim;
  tse_sim_input u = { 0 };
  tse_sim_output y;
  tse_config_exact(&c);
  tse_sim_config_default(&s);
  c.brake_pull_arm = arm;
  u.dt = 0.01;
  u.road_level = 1;
  u.brake_torque_front = 500;
  if (tse_sim_reset(&sim, &c, &s, NULL) < 0) return -1;
  for (int k = 0; k < 101; k++)
    if (tse_sim_step(&sim, &u, &y) < 0) return -1;
  return y.yaw_rate;
}

int main(void)
{
  int32_t count;
  const tse_effect_row *const e = tse_describe_effects(&count);
  printf("%s %g %g\n", e[count - 1].id, turned(0.0), turned(0.05));
  return 0;
}
"""
ROW = r"""
int main(void)
{
  static tse_filter f;
  tse_config c;
  tse_params p;
  tse_input u = { 0 };
  tse_output y;
  int32_t count;
  const tse_field *const row = tse_describe(TSE_STRUCT_OUTPUT, &count, NULL);
  tse_config_exact(&c);
  u.dt = 0.01;
  u.wheel_speed_front = u.wheel_speed_rear = 60;
  if (tse_prepare(&c, &p, NULL) < 0 || tse_reset(&p, &f, sizeof f) < 0) return 1;
  if (tse_step(&p, &f, &u, &y) < 0) return 1;
  for (int32_t i = 0; i < count; i++) {
    double x;
    memcpy(&x, (const char *)&y + row[i].offset, sizeof x);
    if (strcmp(row[i].name, "speed_of_news") == 0) printf("%s %g %g\n", row[i].unit, x, y.vel_x);
  }
  return 0;
}
"""


@pytest.fixture
def copy(tmp_path):
    for folder in ("src", "include", "scripts", "fmu", "tests/replay", "tests/unit"):
        shutil.copytree(
            ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("results", "__pycache__")
        )
    return tmp_path


ESTIMATE = r"""
static double front(double strength) /* cornering stiffness after 4 s of slalom */
{
  static tse_filter f;
  tse_config c;
  tse_params p;
  tse_input u = { 0 };
  tse_output y;
  tse_config_exact(&c);
  c.NAME_strength = strength;
  u.dt = 0.01;
  u.wheel_speed_front = u.wheel_speed_rear = 60;
  if (tse_prepare(&c, &p, NULL) < 0 || tse_reset(&p, &f, sizeof f) < 0) return -1;
  for (int k = 0; k < 400; k++) {
    u.steer_angle = 0.02 * ((k / 50) % 2 ? 1 : -1);
    u.accel_y = 150 * u.steer_angle;
    u.yaw_rate = 8 * u.steer_angle;
    if (tse_step(&p, &f, &u, &y) < 0) return -1;
  }
  return y.stiffness[TSE_CY_FRONT];
}

int main(void)
{
  printf("%.17g %.17g\n", front(0.0), front(0.2));
  return 0;
}
"""
# What a hook's function may do, in place of its first body; without it, a call that has
# no effect.
ACTS = {
    "CONSTANT": ("(void)c;", "c->mass += r_mul(c->mass, c->NAME_strength);"),
    "INPUT": ("return steer;", "return steer + e->NAME_strength;"),
    "BODY": ("(void)pt;", "pt->force.y += pt->p->effects.NAME_strength;"),
    "SENSOR": ("(void)z;", "z->y[1] += z->pt->p->effects.NAME_strength;"),
}


def edit_file(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert text.count(old) == 1, f"{path.name}: {old}"
    path.write_text(text.replace(old, new))


def list_written(folder: Path) -> list[str]:
    """Run scripts/dev/tables.py; return the files that it changes."""

    def there() -> dict[Path, str]:
        return {p: p.read_text() for p in folder.rglob("*.[ch]")}

    before = there()
    subprocess.run([sys.executable, "scripts/dev/tables.py"], cwd=folder, check=True)
    return sorted(p.relative_to(folder).as_posix() for p, text in there().items() if before[p] != text)


def run_program(folder: Path, program: str) -> list[str]:
    """Compile a program with these sources; return the words of its output."""
    (folder / "main.c").write_text(HEAD + program)
    sources = [p.relative_to(folder).as_posix() for p in sorted((folder / "src").rglob("*.c"))]
    options = ["-std=c99", "-O0", "-DTSE_REAL_DOUBLE=1", "-DTSE_MAX_PARTICLES=64", "-Iinclude", "-Isrc"]
    subprocess.run(["cc", *options, "main.c", *sources, "-lm", "-o", "run"], cwd=folder, check=True)
    return subprocess.run([folder / "run"], check=True, capture_output=True, text=True).stdout.split()


def test_an_effect_is_a_row_and_its_function_word_for_word_as_contributing_says(copy):
    """A test of the effect is the third file that a person writes."""
    text = (ROOT / "CONTRIBUTING.md").read_text().partition("## Add an effect")[2].partition("\n## ")[0]
    blocks = re.findall(r"```(?:toml|c)\n(.*?)```", text, re.S)
    row, function = (re.sub("^   ", "", block, flags=re.M) for block in blocks)
    with (copy / "src" / "tables" / "effects.toml").open("a") as file:
        file.write("\n" + row)
    edit_file(
        copy / "src" / "model" / "catalogue.h",
        "// clang-format off: table ",
        function + "\n// clang-format off: table ",
    )
    assert "src/model/catalogue.h" in list_written(copy)
    name, without, with_it = run_program(copy, EFFECT)
    assert name == "brake_pull"
    assert float(without) == 0
    assert abs(float(with_it)) > 0.001


def test_a_threshold_is_a_row_and_the_line_that_uses_it(copy):
    edit_file(copy / "src" / "tables" / "constants.toml", '["process noise"]\n',
         '["process noise"]\nNEWS = { value = 0.25, unit = "1", why = "a share", test = "-" }\n')  # fmt: skip
    edit_file(
        copy / "src" / "filter" / "output.c",
        "out->log_evidence = ",
        "out->n_eff = NEWS;\n  out->log_evidence = ",
    )
    assert list_written(copy) == ["src/tables/constants.h"]
    subprocess.run(
        ["cc", "-std=c99", "-fsyntax-only", "-Wall", "-Werror", "-Iinclude", "-Isrc", "src/filter/output.c"],
        cwd=copy,
        check=True,
    )


def test_an_output_is_a_row_and_the_line_that_fills_it(copy):
    table = copy / "src" / "tables" / "output.toml"
    edit_file(table, "[column]\n", '[column]\nspeed_of_news = { unit = "m/s", text = "twice vel_x" }\n')
    edit_file(
        table,
        "fault_factor = { unit",
        'speed_of_news = { unit = "m/s", text = "twice vel_x" }\nfault_factor = { unit',
    )
    edit_file(
        copy / "src" / "filter" / "output.c",
        "out->log_evidence = ",
        "out->speed_of_news = out->vel_x + out->vel_x;\n  out->log_evidence = ",
    )
    assert "include/tse/output.h" in list_written(copy)
    unit, x, half = run_program(copy, ROW)
    assert unit == "m/s" and float(x) == 2 * float(half) > 0


# ---- scripts/dev/new_effect.py: its skeleton builds without a warning in every hook


UNITY = ROOT / ".venv" / "share" / "unity" / "src"
HOOKS = ("CONSTANT", "INPUT", "SLIP", "STIFFNESS", "GRIP", "BODY", "SENSOR")


def run_new_effect(folder, *arguments):
    command = [sys.executable, "scripts/dev/new_effect.py", *map(str, arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def test_every_hook_compiles_without_a_warning_beside_the_others(copy):
    for hook in HOOKS:
        done = run_new_effect(copy, f"try_{hook.lower()}", "--hook", hook)
        assert done.returncode == 0, done.stderr
    flags = [
        "-std=c99",
        "-fsyntax-only",
        "-Wall",
        "-Wextra",
        "-Wconversion",
        "-Wshadow",
        "-Werror",
        "-DTSE_REAL_DOUBLE=1",
        "-DTSE_MAX_PARTICLES=64",
        "-Iinclude",
        "-Isrc",
    ]
    subprocess.run(
        [
            "cc",
            *flags,
            "src/model/integrator.c",
            "src/estimator/settings.c",
            "src/estimator/prepare.c",
            "src/host/replay.c",
        ],
        cwd=copy,
        check=True,
    )


@pytest.mark.slow
@pytest.mark.parametrize("hook", ACTS)
def test_its_row_says_which_filters_use_it(copy, hook):
    name = f"try_{hook.lower()}"
    assert run_new_effect(copy, name, "--hook", hook).returncode == 0
    laws = copy / "src" / "model" / ("effects_constant.h" if hook == "CONSTANT" else "catalogue.h")
    before, mark, law = laws.read_text().partition(f"/* {name}: ")
    stub, acts = ACTS[hook]
    assert stub in law
    laws.write_text(before + mark + law.replace(stub, acts.replace("NAME", name), 1))
    without, with_it = run_program(copy, ESTIMATE.replace("NAME", name))
    row = read_toml(copy / "src" / "tables" / "effects.toml")[name]
    assert row["filter"] == ("none" if float(without) == float(with_it) else "both")
    ledger = " ".join((copy / "src" / "EQUATIONS.md").read_text().split())
    listed = ledger.split("Not applied: ")[1].partition("Simulator and")[0]
    assert (f"`{name}`" in listed) == (row["filter"] == "none")


def run_its_test(copy: Path) -> str:
    """Return the output of the test that new_effect.py has written for brake_pull."""
    sources = [str(p.relative_to(copy)) for p in sorted((copy / "src").rglob("*.c"))]
    test = copy / "tests/unit/model/test_effect_brake_pull.c"
    subprocess.run(
        ["cmake", f"-DSOURCE={test}", "-DRUNNER=run.c", "-P", "tests/unit/runner.cmake"], cwd=copy, check=True
    )
    subprocess.run(
        ["cc", "-std=c99", "-O0", "-DTSE_REAL_DOUBLE=1", "-DTSE_MAX_PARTICLES=64", "-DUNITY_INCLUDE_DOUBLE",
         "-Iinclude", "-Isrc", "-Itests/unit",
         f"-I{UNITY}", "run.c", str(UNITY / "unity.c"), *sources, "-lm", "-o", "run"],
        cwd=copy, check=True,
    )  # fmt: skip
    return subprocess.run([copy / "run"], capture_output=True, text=True).stdout


@pytest.mark.slow
@pytest.mark.skipif(not UNITY.is_dir(), reason="Unity is not there: scripts/setup.sh")
def test_its_test_fails_in_one_place_which_says_what_to_write_and_finds_a_jump_at_0(copy):
    done = run_new_effect(
        copy,
        "brake_pull",
        "--hook",
        "BODY",
        "--parameter",
        "arm",
        "--unit",
        "m",
        "--low",
        -0.5,
        "--high",
        0.5,
        "--typical",
        0.01,
        0.05,
    )
    assert done.returncode == 0 and "test_effect_brake_pull.c" in done.stdout
    output = run_its_test(copy)
    assert "2 Tests 1 Failures" in output and "write the formula of brake_pull" in output
    row = re.search(r"^\| brake_pull .*$", (copy / "src" / "EQUATIONS.md").read_text(), re.M)[0]
    assert "`brake_pull_body`" in row and "`test_brake_pull_does_what_its_equation_says`" in row
    laws = copy / "src" / "model" / "catalogue.h"
    before, mark, law = laws.read_text().partition("/* brake_pull: ")
    laws.write_text(before + mark + law.replace("(void)pt;", "pt->force.y += TSE_R(1);", 1))
    output = run_its_test(copy)
    assert "2 Tests 2 Failures" in output and "test_brake_pull_vanishes_with_its_strength:FAIL" in output


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("mass", "--hook", "BODY"), "there is such an effect"),
        (("Brake-Pull", "--hook", "BODY"), "small letters"),
        (
            ("brake_pull", "--hook", "BODY", "--low", "0.1", "--high", "1"),
            "0, which is off, must be in the range",
        ),
        (("brake_pull", "--hook", "BODY", "--typical", "2", "3"), "must be in the range"),
        (("brake_pull", "--hook", "WHEEL"), "invalid choice"),
    ],
)
def test_what_makes_no_sense_writes_nothing(copy, arguments, said):
    before = {p: p.read_bytes() for p in copy.rglob("*") if p.is_file()}
    done = run_new_effect(copy, *arguments)
    assert done.returncode == 2 and said in done.stderr and "Traceback" not in done.stderr
    assert {p: p.read_bytes() for p in copy.rglob("*") if p.is_file()} == before
