"""A wrong unit is the commonest error: the run says so."""

from __future__ import annotations

import pytest

from conftest import tselab_here


@pytest.fixture(scope="module")
def lively(tmp_path_factory):
    """A log that turns, brakes and accelerates enough for the channels to be compared."""
    path = tmp_path_factory.mktemp("units") / "log.csv"
    assert tselab_here("simulate", "--maneuver", "double-lane-change", "--duration", 36, "--out", path).code == 0
    return path


def warnings(lively, **scale):
    from tselab.log import read_log
    from tselab.units import check_units

    log = read_log(lively)
    for name, factor in scale.items():
        log.data[name] *= factor
    return " | ".join(check_units(log, 2.75, 0.33, 0.33, 16.0))


def test_a_good_log_gives_no_warning(lively):
    assert warnings(lively) == ""


@pytest.mark.parametrize(
    ("scale", "hint"),
    [
        ({"yaw_rate": 57.3}, "yaw_rate is in deg/s"),
        ({"steer_angle": 16.0}, "steer_angle is the steering-wheel angle"),
        ({"steer_angle": 57.3}, "steer_angle is in degrees"),
        ({"accel_y": 1 / 9.81}, "accel_y is in g"),
        ({"accel_x": 1 / 9.81}, "accel_x is in g"),
        ({"wheel_speed_front": 0.33, "wheel_speed_rear": 0.33}, "the wheel speeds are in m/s"),
        ({"wheel_speed_front": 9.55, "wheel_speed_rear": 9.55}, "the wheel speeds are in rpm"),
        ({"steer_angle": -1.0}, "positive to the right"),
        ({"accel_y": -1.0}, "positive to the right"),
        ({"accel_x": -1.0}, "accel_x is positive to the rear"),
        ({"wheel_speed_rear": 2.0}, "front and rear wheels roll at"),
    ],
)
def test_wrong_units_and_signs_are_named(lively, scale, hint):
    assert hint in warnings(lively, **scale)


def test_the_warning_reaches_the_terminal(lively, drive, tmp_path):
    import pandas as pd

    table = pd.read_csv(lively)
    table["accel_y"] /= 9.81
    table.to_csv(tmp_path / "log.csv", index=False)
    done = tselab_here("estimate", "log.csv", "--vehicle", drive.vehicle, "--particles", 32, cwd=tmp_path)
    assert done.code == 0 and "warning: check the units: accel_y is in g" in done.err
