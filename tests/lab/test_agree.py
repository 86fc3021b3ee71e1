"""Channels that always contradict each other are wrong; a sliding car or a motorway is
not."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from tse.channels import agree
from tse.channels.agree import _check_velocity, check_lateral_delay, check_units
from tse.channels.log import read_frame
from tse.library.core import Config
from tse.library.errors import UserError
from tse.log.rows import Reading

WHEELBASE, RADIUS = 2.7, 0.31


def drive(seconds: float, speed: float, across: float, left: float = 0.0, seed: int = 1) -> pd.DataFrame:
    """Return a log by kinematics, with noise.

    `across`: lateral acceleration, m/s2 (rms). `left`: additional speed in bends to the
    left, m/s. The speed varies by 2 m/s."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, seconds, 0.02)
    bend = np.sin(0.35 * time) * np.sign(np.sin(0.043 * time + 0.5))
    v = speed + 2.0 * np.sin(0.2 * time) + left * bend
    curve = across * 2**0.5 / speed**2 * bend
    rate = v * curve
    exact = {
        "steer_angle": WHEELBASE * curve,
        "wheel_speed_front": v * (1.0 + 0.5 * (WHEELBASE * curve) ** 2) / RADIUS,
        "wheel_speed_rear": v / RADIUS,
        "accel_x": np.gradient(v, time),
        "accel_y": v * rate,
        "yaw_rate": rate,
    }
    noise = {"steer_angle": 1e-4, "accel_x": 0.05, "accel_y": 0.05, "yaw_rate": 0.002}
    return pd.DataFrame(
        {"time": time}
        | {n: x + noise.get(n, 0.01) * rng.standard_normal(len(time)) for n, x in exact.items()}
    )


def list_warnings(table: pd.DataFrame) -> list[str]:
    """Return the warnings about a log."""
    return check_units(read_frame(table), WHEELBASE, RADIUS, RADIUS, 15.0)


def test_a_car_that_slides_for_half_its_drive_has_its_steering_angle_the_right_way() -> None:
    """The car countersteers, with six times the lateral acceleration of the drive before.

    Over the whole log, steering angle and yaw rate have a negative correlation."""
    table, slide = drive(180.0, 15.0, 0.5), drive(180.0, 15.0, 3.0, seed=2)
    slide["steer_angle"] *= -1.0
    assert list_warnings(table) == [] and len(list_warnings(slide)) == 1
    late = table["time"] > 90.0
    table.loc[late] = slide.loc[late]
    assert list_warnings(table) == []


@pytest.mark.parametrize("channel", ["steer_angle", "yaw_rate", "accel_y"])
def test_a_sign_that_is_wrong_throughout_is_found(channel: str) -> None:
    table = drive(180.0, 15.0, 2.0)
    table[channel] *= -1.0
    (text,) = list_warnings(table)
    assert channel in text and "change its sign" in text


def test_a_motorway_on_which_radii_grow_with_speed_and_load_is_no_mistake() -> None:
    """At 33 m/s and 0.5 m/s2, faster in bends to the left, the front radius is 0.3 %
    larger.

    It changes by 2e-6 s2/m2 times the square of the speed, and with the load in bends."""
    table = drive(300.0, 33.0, 0.5, left=3.0)
    v = RADIUS * table["wheel_speed_rear"]
    front = 1.0 - 0.003 + 2e-6 * v**2 + 4e-4 * np.abs(table["accel_y"])
    table["wheel_speed_front"] *= front
    assert list_warnings(table) == []


def test_wheels_of_one_side_are_still_found() -> None:
    table = drive(180.0, 15.0, 2.0)
    table["wheel_speed_front"] += 1.5 * table["yaw_rate"] / 2 / RADIUS
    table["wheel_speed_rear"] -= 1.5 * table["yaw_rate"] / 2 / RADIUS
    (text,) = list_warnings(table)
    assert text.startswith("check the wheels")


STREET = Config(
    {
        "mass": 1800.0,
        "lf": 1.25,
        "lr": 1.45,
        "wheel_radius_front": RADIUS,
        "wheel_radius_rear": RADIUS,
        "cornering_stiffness_front": 1.1e5,
        "cornering_stiffness_rear": 1.4e5,
    }
)


@pytest.mark.parametrize(
    ("late", "ahead", "filtered", "wrong"),
    [
        (0.0, 0.0, False, ""),
        (0.05, 0.0, False, ""),
        (0.2, 0.0, False, "later"),
        (-0.2, 0.0, False, "earlier"),
        (0.0, -2.5, False, "later"),
        (0.0, 2.5, False, "earlier"),
        (0.0, 0.0, True, "later"),
    ],
)
def test_an_accel_y_that_is_late_against_the_yaw_rate_is_reported(
    late: float, ahead: float, filtered: bool, wrong: str
) -> None:
    """Late, low-passed at 1 Hz, or of an IMU metres away: no warning if the vehicle file
    states it."""
    table = drive(180.0, 15.0, 2.0)
    time = table["time"].to_numpy()
    v = RADIUS * table["wheel_speed_rear"]
    yaw = np.gradient(np.convolve(table["yaw_rate"], np.ones(21) / 21, "same"), time)
    slip = 1800.0 * 1.25 / (1.4e5 * 2.7) * v**2
    y = table["accel_y"] + (1.45 - slip + ahead) * yaw
    y = pd.Series(np.interp(time - late, time, y))
    table["accel_y"] = y.ewm(alpha=0.02 / (0.02 + 1 / (2 * np.pi))).mean() if filtered else y
    log = read_frame(table)
    said = check_lateral_delay(log, STREET)
    assert bool(said) == bool(wrong)
    if wrong:
        assert f" ms {wrong} than speed and yaw_rate" in said[0] and "stiffness is therefore wrong" in said[0]
    if late or ahead:
        stated = Config({**STREET.as_dict(), "accel_y_latency": max(late, 0.0), "imu_lever_arm_x": ahead})
        assert late < 0 or check_lateral_delay(log, stated) == []


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_course_of_the_compass_is_found(sense: float) -> None:
    table = drive(120.0, 15.0, 2.0)
    course = sense * np.cumsum(table["yaw_rate"]) * 0.02
    table["gnss_course"] = np.where(np.arange(len(table)) % 10 == 0, np.angle(np.exp(1j * course)), np.nan)
    assert bool(list_warnings(table)) == (sense < 0)
    assert sense > 0 or "gnss_course turns against yaw_rate" in list_warnings(table)[0]


@pytest.mark.parametrize("run", [1, 10])
def test_zeros_that_were_written_for_missing_values_are_missing(run: int) -> None:
    """Single zeros, or runs of 0.1 s. A channel that passes through 0 keeps its zeros."""
    table = drive(60.0, 15.0, 2.0)
    rng = np.random.default_rng(5)
    gone = np.repeat(rng.random(len(table) // run + 1) < 0.1, run)[: len(table)]
    coarse = table.assign(steer_angle=np.round(table["steer_angle"] / 0.002) * 0.002)
    kept = read_frame(coarse).data["steer_angle"]
    assert (kept == 0.0).any() and not kept.isna().any()
    log = read_frame(table.assign(steer_angle=np.where(gone, 0.0, table["steer_angle"])))
    assert (log.data["steer_angle"].isna().to_numpy() == gone).all()
    assert any("steer_angle is 0 in" in note for note in log.notes)


def test_the_delay_of_accel_y_is_that_of_a_car_whose_centre_of_gravity_is_far_in_front() -> None:
    """The rear axle is 3.5 m behind it, the front axle 0.5 m in front of it."""
    table = drive(180.0, 15.0, 2.0)
    v = RADIUS * table["wheel_speed_rear"]
    yaw = np.gradient(np.convolve(table["yaw_rate"], np.ones(21) / 21, "same"), table["time"].to_numpy())
    table["accel_y"] += (3.5 - 1800.0 * 0.5 / (1.4e5 * 4.0) * v**2) * yaw
    car = Config({**STREET.as_dict(), "lf": 0.5, "lr": 3.5})
    assert check_lateral_delay(read_frame(table), car) == []


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_course_that_wraps_between_its_entries_still_turns_with_the_yaw_rate(sense: float) -> None:
    """The car circles to the left, faster and slower: the course wraps each 15 s."""
    table = drive(120.0, 15.0, 2.0)
    table["yaw_rate"] = 0.4 + 0.1 * np.sin(0.5 * table["time"])
    course = sense * np.cumsum(table["yaw_rate"]) * 0.02
    table["gnss_course"] = np.where(np.arange(len(table)) % 10 == 0, np.angle(np.exp(1j * course)), np.nan)
    found = _check_velocity(read_frame(table), RADIUS, RADIUS)
    assert len(found) == (sense < 0) and all("gnss_course turns against" in x for x in found)


def test_a_log_that_is_left_out_is_named_in_one_line() -> None:
    wrong = read_frame(drive(60.0, 15.0, 2.0))

    def refuse(*_: object) -> list[str]:
        raise UserError("the first line\n  hint: the second one")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(agree, "check_car", refuse)
        with pytest.raises(UserError, match="the first line"):
            agree.read_agreeing([wrong], notes := [], Reading())
    assert notes == ["left out: the first line"]
