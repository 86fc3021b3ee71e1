"""What CONTRIBUTING says of adding an effect is true: its row and its file, and nothing else, put into a copy of the sources,
make an effect that is described, is a setting, and acts in the simulator. And the headers made of the table are up to date."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = "model/integrator.c", "estimator/prepare.c", "host/describe.c", "host/simulate.c"
PROGRAM = r"""
#include <stdio.h>
#include "tse/describe.h"
#include "tse/simulate.h"

static double turned(double arm) /* yaw rate after a second of braking straight on */
{
  tse_config c;
  tse_sim_config s;
  static tse_sim sim;
  tse_sim_input u = { 0 };
  tse_sim_output y;
  tse_config_default(&c);
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


def table_headers(folder: Path) -> dict[str, str]:
    return {name: (folder / "src" / "model" / name).read_text() for name in ("effects_constant.h", "effects_acting.h")}


def write_headers(folder: Path) -> None:
    subprocess.run(["cmake", f"-Dtse_source={folder}", "-P", folder / "cmake" / "effects.cmake"], check=True)


@pytest.fixture
def copy(tmp_path):
    for folder in ("src", "include", "cmake"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    return tmp_path


def test_the_headers_made_of_the_table_are_up_to_date(copy):
    write_headers(copy)
    assert table_headers(copy) == table_headers(ROOT)


@pytest.mark.skipif(not shutil.which("cc"), reason="there is no compiler cc")
def test_the_example_of_contributing_is_all_that_an_effect_needs(copy):
    text = (ROOT / "CONTRIBUTING.md").read_text().partition("## Add an effect")[2].partition("\n## ")[0]
    row, function = (re.sub("^   ", "", block, flags=re.M) for block in re.findall(r"```c\n(.*?)```", text, re.S))
    table = copy / "include" / "tse" / "effects.def"
    table.write_text(table.read_text().replace("\n#undef EFFECT\n", f"\n{row.strip()}\n#undef EFFECT\n"))
    (copy / "src" / "model" / "effects" / "brake_pull.h").write_text(function)
    write_headers(copy)
    assert '#include "model/effects/brake_pull.h"' in table_headers(copy)["effects_acting.h"]
    (copy / "main.c").write_text(PROGRAM)
    subprocess.run(
        ["cc", "-std=c99", "-O0", "-DTSE_REAL_DOUBLE=1", "-DTSE_MAX_PARTICLES=64", "-Iinclude", "-Isrc", "main.c",
         *(f"src/{name}" for name in SOURCES), "-lm", "-o", "run"],
        cwd=copy, check=True,
    )  # fmt: skip
    name, without, with_it = subprocess.run([copy / "run"], check=True, capture_output=True, text=True).stdout.split()
    assert name == "brake_pull"
    assert float(without) == 0
    assert abs(float(with_it)) > 0.001


def test_a_row_without_its_file_is_refused_by_name(copy):
    (copy / "src" / "model" / "effects" / "bank.h").unlink()
    command = ["cmake", f"-Dtse_source={copy}", "-P", copy / "cmake" / "effects.cmake"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode != 0 and "src/model/effects/bank.h" in done.stderr
