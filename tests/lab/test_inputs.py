"""Small inputs that were once misread: each gives the estimate of the clean log."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from conftest import tselab_here

INPUTS = Path(__file__).parents[3] / "shared" / "inputs"
ODD = (
    "05a-comment-without-signal",
    "05b-comment-without-kind",
    "05c-value-table-of-no-signal",
    "05d-name-with-digit",
    "05e-factor-point-25",
    "05f-one-id-too-long",
    "10-unit-km^h",
    "car",
)
SAME = {  # the log, and the database of a bus
    **{name: ("05-10-16-frames.log", f"{name}.dbc") for name in ODD},
    **{name: (name, "car.dbc") for name in ("18-asc-relative.asc", "19-asc-negative.asc")},
    **{
        name: (name, "")
        for name in (
            "01-vbox.vbo",
            "18a-wheels-5s-off.mf4",
            "18b-wheels-absolute.mf4",
            "19b-time-in-ms.mf4",
            "25-three-header-rows.csv",
            "27-quoted-decimal-comma.csv",
            "28-hhmmss.csv",
        )
    },
}
STIFFNESS = ["cx_front", "cy_front", "cy_rear"]


@pytest.fixture(scope="module", autouse=True)
def beside():
    """Skip the tests without the inputs."""
    if not (INPUTS / "known.toml").is_file():
        pytest.skip("the inputs are not beside this checkout")


def estimate_stiffness(folder: Path, log: Path) -> pd.Series:
    """Return the stiffness at the end of a log."""
    done = tselab_here("estimate", log, "--vehicle", INPUTS / "known.toml", "--out", folder / "est.csv")
    assert done.code in (0, 3), done.err
    assert "messages are lost" not in done.err and "gap" not in done.err, done.err
    return pd.read_csv(folder / "est.csv").iloc[-200:][STIFFNESS].mean()


@pytest.fixture(scope="module")
def wanted(tmp_path_factory, beside):
    """Return the stiffness of the clean log."""
    return estimate_stiffness(tmp_path_factory.mktemp("clean"), INPUTS / "si.csv")


@pytest.mark.parametrize("name", SAME)
def test_an_input_gives_what_the_clean_log_gives(name, wanted, tmp_path):
    log, database = SAME[name]
    for file in filter(None, (log, database)):
        shutil.copy(INPUTS / file, tmp_path / file)
    done = tselab_here(
        "signals", tmp_path / log, "--vehicle", INPUTS / "known.toml", "--write", tmp_path / "signals.toml"
    )
    assert done.code == 0, done.err
    assert ("warning: the unit 'km^h'" in done.out) == (name == "10-unit-km^h")
    if name in ("27-quoted-decimal-comma.csv", "28-hhmmss.csv"):
        (tmp_path / "signals.toml").unlink()  # the log has the names of the library
    np.testing.assert_allclose(estimate_stiffness(tmp_path, tmp_path / log) / wanted, 1.0, atol=0.03)


def test_a_long_table_and_one_without_accel_y_are_read_as_far_as_they_go():
    done = tselab_here("signals", INPUTS / "26-long-table.csv", "--vehicle", INPUTS / "known.toml")
    assert (
        "yaw_rate = yaw_rate: deg/s" in done.out
        and "one value per row" in done.out
        and "not found: wheel_speed_front\n" in done.out
    )
    done = tselab_here("signals", INPUTS / "11-kmph-omega.csv", "--vehicle", INPUTS / "known.toml")
    assert "warning" not in done.out and "yaw_rate = omega" in done.out and "not found: accel_y\n" in done.out


def test_a_gear_is_no_steering_angle():
    done = tselab_here("signals", INPUTS / "32-gear-as-steering.csv")
    assert (
        done.code == 3
        and "steer_angle = " not in done.out
        and "  steer_angle: no signal has a similar name" in done.out
    )
