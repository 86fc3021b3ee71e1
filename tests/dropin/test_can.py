"""scripts/dropin/can, the example of a control loop, in every number format.

tests/embedded runs it on a microcontroller.
"""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

PROGRAM = r"""
#include <stdio.h>
#include "control_loop.h"
#include "tse/convert.h"

static void send(control_loop *loop, uint16_t id, int32_t first, int32_t second)
{
  const can_frame f = { id, { first & 255, first >> 8 & 255, first >> 16 & 255,
                              second & 255, second >> 8 & 255, second >> 16 & 255, 0, 0 } };
  loop_received(loop, &f);
}

int main(void)
{
  static control_loop loop;
  tse_config c;
  const char *wrong = "";
  tse_config_default(&c);
  c.mass = TSE_S(1900);
  printf("start %d\n", (int)loop_start(&loop, &c, &wrong));
  for (int k = 0; k < 500; k++) {
    /* row 200 is far out of range and is refused */
    send(&loop, CAN_STEERING, k == 200 ? 400000 : k % 100 < 50 ? 1000 : -1000, 0);
    send(&loop, CAN_WHEELS, 60606, 60606);
    send(&loop, CAN_ACCEL, 12, -1500);
    send(&loop, CAN_GYRO, -7500, 0);
    loop_period(&loop);
    if (k % 7 == 3) loop_period(&loop); /* a period in which nothing came */
    loop_work(&loop);
    if (k == 200) printf("lost %.9f\n", tse_double_of(loop.lost));
    if (k == 201) printf("dt %.9f\n", tse_double_of(loop.row.dt));
  }
  printf("rows %u refused %u overruns %u\n", (unsigned)loop.rows, (unsigned)loop.refused,
         (unsigned)loop.overruns);
  printf("read %.6f %.6f %.6f %.6f\n", tse_double_of(loop.row.steer_angle),
         tse_double_of(loop.row.wheel_speed_front), tse_double_of(loop.row.accel_y),
         tse_double_of(loop.row.yaw_rate));
  printf("speed %.2f\n", tse_double_of(loop.estimate.vel_x));
  return 0;
}
"""


def run_command(*command: str | Path, cwd: Path | None = None, env: dict[str, str] | None = None) -> str:
    """Run a command; return its output."""
    done = subprocess.run(
        [str(c) for c in command],
        cwd=cwd,
        env=os.environ | (env or {}),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, (
        f"{' '.join(map(str, command))}: {done.returncode}\n{done.stdout[-3000:]}{done.stderr[-3000:]}"
    )
    return done.stdout


def find_tool(name: str) -> Path:
    """Return the path of a program; skip the test if it is not installed."""
    found = shutil.which(name)
    if not found:
        pytest.skip(f"{name} is not installed")
    return Path(found)


@pytest.mark.slow
@pytest.mark.parametrize("real", ["DOUBLE", "FLOAT", "FIXED"])
def test_readings_and_times_are_those_of_the_bus(real: str, tmp_path: Path) -> None:
    (tmp_path / "main.c").write_text(PROGRAM)
    (tmp_path / "tse.h").write_text('#include "tse/tse.h"\n')
    sources = [ROOT / "scripts/dropin/can/control_loop.c", *sorted((ROOT / "src").rglob("*.c"))]
    folders = (tmp_path, ROOT / "include", ROOT / "src", ROOT / "scripts/dropin/can")
    command = [
        "cc",
        "-std=c99",
        "-O1",
        "-ffp-contract=off",
        f"-DTSE_REAL_{real}=1",
        *(f"-I{f}" for f in folders),
    ]
    run_command(*command, tmp_path / "main.c", *sources, "-o", tmp_path / "loop", "-lm")
    said = dict(line.split(" ", 1) for line in run_command(tmp_path / "loop").splitlines())
    assert said["start"] == "0"
    assert said["rows"] == "500 refused 1 overruns 0"
    assert float(said["lost"]) == pytest.approx(0.02, abs=1e-8)  # row 200 came a period late
    assert float(said["dt"]) == pytest.approx(0.03, abs=1e-8)
    assert [float(x) for x in said["read"].split()] == pytest.approx([-0.01, 60.606, -1.5, -0.075], abs=1e-5)
    assert float(said["speed"]) == pytest.approx(60.606 * 0.33, rel=0.01)


# ---- `cmake -S . -B build` without a network: the library; a message on tests and FMUs


NOWHERE = dict.fromkeys(("http_proxy", "https_proxy", "HTTPS_PROXY", "all_proxy"), "http://127.0.0.1:9") | {
    "GIT_CONFIG_GLOBAL": os.devnull,
    "GIT_CONFIG_NOSYSTEM": "1",
    "no_proxy": "",
}
SHARE = ROOT / ".venv" / "share"
GIVEN = [f"-DFETCHCONTENT_SOURCE_DIR_{name}={SHARE / name.lower()}" for name in ("UNITY", "FMI2")]


def read_cache(build: Path) -> dict[str, str]:
    """Return the variables of CMakeCache.txt."""
    rows = [x for x in (build / "CMakeCache.txt").read_text().splitlines() if x.startswith("TSE_BUILD_")]
    return {name.partition(":")[0]: value for name, value in (x.split("=", 1) for x in rows)}


@pytest.mark.slow
@pytest.mark.parametrize("option", [[], ["-DFETCHCONTENT_FULLY_DISCONNECTED=ON"]])
def test_a_plain_configure_builds_the_library(option: list[str], tmp_path: Path) -> None:
    said = run_command(
        find_tool("cmake"), "-S", ROOT, "-B", tmp_path, "-DCMAKE_BUILD_TYPE=Debug", *option, env=NOWHERE
    )
    assert "the tests are not built" in said
    assert "FETCHCONTENT_SOURCE_DIR_UNITY" in said
    assert "the FMUs are not built" in said
    assert "FETCHCONTENT_SOURCE_DIR_FMI2" in said
    assert read_cache(tmp_path) == {
        "TSE_BUILD_TESTS": "OFF",
        "TSE_BUILD_FMU": "OFF",
        "TSE_BUILD_BENCH": "OFF",
        "TSE_BUILD_FUZZ": "OFF",
    }
    if option:
        run_command(find_tool("cmake"), "--build", tmp_path)
        assert list((tmp_path / "src").glob("*tse.*"))


@pytest.mark.slow
@pytest.mark.parametrize("compiler", [{}, {"CXX": "/nowhere/c++"}], ids=["", "no C++"])
def test_tests_and_fmus_are_built_where_their_sources_are_given(
    compiler: dict[str, str], tmp_path: Path
) -> None:
    if not (SHARE / "unity/src/unity.c").is_file() or not (SHARE / "fmi2/headers/fmi2Functions.h").is_file():
        pytest.skip("scripts/setup.sh has not put Unity and the FMI headers into .venv/share")
    said = run_command(
        find_tool("cmake"),
        "-S",
        ROOT,
        "-B",
        tmp_path,
        *GIVEN,
        "-DFETCHCONTENT_FULLY_DISCONNECTED=ON",
        env=NOWHERE | compiler,
    )
    assert "not built" not in said
    assert ("no C++ compiler" in said) == (bool(compiler) or not shutil.which("c++"))
    assert read_cache(tmp_path) == {
        "TSE_BUILD_TESTS": "ON",
        "TSE_BUILD_FMU": "ON",
        "TSE_BUILD_BENCH": "OFF",
        "TSE_BUILD_FUZZ": "OFF",
    }


@pytest.mark.parametrize(
    ("wanted", "named"), [("TESTS", "FETCHCONTENT_SOURCE_DIR_UNITY"), ("FMU", "FETCHCONTENT_SOURCE_DIR_FMI2")]
)
def test_what_is_asked_for_is_not_left_out(wanted: str, named: str, tmp_path: Path) -> None:
    options = [
        "-DTSE_BUILD_TESTS=OFF",
        "-DTSE_BUILD_FMU=OFF",
        f"-DTSE_BUILD_{wanted}=ON",
        "-DFETCHCONTENT_FULLY_DISCONNECTED=ON",
    ]
    command = [str(x) for x in (find_tool("cmake"), "-S", ROOT, "-B", tmp_path, *options)]
    done = subprocess.run(command, env=os.environ | NOWHERE, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert named in done.stderr
