"""A formula that is compiled in gives the bits that its interpreter gives, in the C that tselab writes for it."""

import shutil
import struct
import subprocess
from pathlib import Path

import pytest

from tselab.formula import Number, c_header, parse

ROOT = Path(__file__).resolve().parents[2]
SOURCES = "model/integrator.c", "estimator/prepare.c", "host/replay.c"
PROGRAM = r"""
#include <stdio.h>
#include "tse/replay.h"
#define ROWS 2000
static double dt[ROWS], steer[ROWS], front[ROWS], rear[ROWS], x[ROWS], y[ROWS], r[ROWS];
int main(void)
{
  tse_config c;
  tse_params p;
  tse_replay_start start;
  tse_replay_log log = { 0 };
  tse_replay_out out = { 0 };
  int32_t wrong;
  unsigned random = 1;
  tse_config_default(&c);
  SETTINGS
  if (tse_prepare(&c, &p, NULL) < 0) return 1;
  for (int i = 0; i < ROWS; i++) {
    random = random * 1664525u + 1013904223u;
    dt[i] = 0.01;
    steer[i] = (i ? steer[i - 1] : 0) * 0.98 + 0.004 * ((double)(random >> 8) / 8388608.0 - 1.0);
    front[i] = rear[i] = (15 + 5 * (double)i / ROWS) / 0.3;
  }
  log.dt = dt; log.steer_angle = steer; log.wheel_speed_front = front; log.wheel_speed_rear = rear;
  out.accel_x = x; out.accel_y = y; out.yaw_rate = r;
  tse_replay_start_default(&start);
  if (tse_replay(&p, &log, ROWS, &start, &out, &wrong) < 0) return 2;
  fwrite(x, sizeof x, 1, stdout); fwrite(y, sizeof y, 1, stdout); fwrite(r, sizeof r, 1, stdout);
  return 0;
}
"""
FORMULA = parse(
    "play_and_lag", "a play, softened with the speed", "front_angle",
    "k*(play(steer_angle, w) - steer_angle)*(1 + soft((vel_x - v0)/vw)) + j*lag(accel_y, T)",
    [Number("k", 0.9, "1"), Number("w", 0.002, "rad"), Number("v0", 17.0, "m/s"), Number("vw", 2.0, "m/s"),
     Number("j", 2e-4, "s2/m"), Number("T", 0.1, "s")],
)  # fmt: skip


def run(folder: Path, settings: dict[str, float], *flags: str) -> bytes:
    folder.mkdir(exist_ok=True)
    lines = " ".join(f"c.{k} = {v!r};" for k, v in settings.items())
    (folder / "main.c").write_text(PROGRAM.replace("SETTINGS", lines))
    build = ["cc", "-std=c99", "-O1",
             "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wno-float-conversion",
             "-Werror", "-DTSE_REAL_DOUBLE=1", "-DTSE_MAX_PARTICLES=64", *flags]  # fmt: skip
    build += [
        f"-I{ROOT / 'include'}",
        f"-I{ROOT / 'src'}",
        "main.c",
        *(str(ROOT / "src" / name) for name in SOURCES),
        "-lm",
        "-o",
        "run",
    ]
    subprocess.run(build, cwd=folder, check=True)
    return subprocess.run([folder / "run"], check=True, capture_output=True).stdout


@pytest.mark.skipif(not shutil.which("cc"), reason="there is no compiler cc")
def test_compiled_in_and_interpreted_are_the_same_bits(tmp_path):
    settings = FORMULA.settings()
    interpreted = run(tmp_path / "interpreted", settings)
    (tmp_path / "compiled").mkdir()
    (tmp_path / "compiled" / "tse_formula.h").write_text(c_header(FORMULA))
    numbers = {k: v for k, v in settings.items() if not k.startswith(("formula_code", "formula_place"))}
    compiled = run(tmp_path / "compiled", numbers, "-DTSE_FORMULA=1", "-I.")
    assert len(interpreted) == 3 * 2000 * 8
    assert compiled == interpreted
    without = run(tmp_path / "without", {})
    assert without != interpreted
    last = struct.unpack("<6000d", interpreted)[-1] - struct.unpack("<6000d", without)[-1]
    assert abs(last) > 1e-4  # it does something, and not of the size of rounding


@pytest.mark.skipif(not shutil.which("cc"), reason="there is no compiler cc")
def test_a_build_with_a_formula_compiled_in_takes_no_other(tmp_path):
    (tmp_path / "compiled").mkdir()
    (tmp_path / "compiled" / "tse_formula.h").write_text(c_header(FORMULA))
    with pytest.raises(subprocess.CalledProcessError) as refused:
        run(tmp_path / "compiled", FORMULA.settings(), "-DTSE_FORMULA=1", "-I.")
    assert refused.value.returncode == 1  # tse_prepare()
