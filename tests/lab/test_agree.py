"""Channels that contradict each other throughout are wrong; a car that slides, or a motorway, is not."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from tse.impl.logs.agree import check_units
from tse.impl.logs.log import read_frame

WHEELBASE, RADIUS = 2.7, 0.31


def drive(seconds: float, speed: float, across: float, left: float = 0.0, seed: int = 1) -> pd.DataFrame:
    """Return a drive by kinematics: bends of so much lateral acceleration [m/s2, rms], speed that
    comes and goes by 2 m/s and is larger by so much in bends to the left, noise."""
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
    return pd.DataFrame({"time": time} | {n: x + noise.get(n, 0.01) * rng.standard_normal(len(time)) for n, x in exact.items()})


def said(table: pd.DataFrame) -> list[str]:
    return check_units(read_frame(table), WHEELBASE, RADIUS, RADIUS, 15.0)


def test_a_car_that_slides_for_half_its_drive_has_its_steering_angle_the_right_way() -> None:
    """It steers against the bend, as a car whose rear slides does, six times as hard as it
    drove before: over the whole log the steering angle goes against the yaw rate."""
    table, slide = drive(180.0, 15.0, 0.5), drive(180.0, 15.0, 3.0, seed=2)
    slide["steer_angle"] *= -1.0
    assert said(table) == [] and len(said(slide)) == 1
    late = table["time"] > 90.0
    table.loc[late] = slide.loc[late]
    assert said(table) == []


@pytest.mark.parametrize("channel", ["steer_angle", "yaw_rate", "accel_y"])
def test_a_sign_that_is_wrong_throughout_is_found(channel: str) -> None:
    table = drive(180.0, 15.0, 2.0)
    table[channel] *= -1.0
    (text,) = said(table)
    assert channel in text and "change its sign" in text


def test_a_motorway_on_which_radii_grow_with_speed_and_load_is_no_mistake() -> None:
    """33 m/s and 0.5 m/s2, faster in the bends to the left: front wheels are 0.3 % larger, and
    smaller by 2e-6 s2/m2 of the square of the speed and by the load in a bend."""
    table = drive(300.0, 33.0, 0.5, left=3.0)
    v = RADIUS * table["wheel_speed_rear"]
    front = 1.0 - 0.003 + 2e-6 * v**2 + 4e-4 * np.abs(table["accel_y"])
    table["wheel_speed_front"] *= front
    assert said(table) == []


def test_wheels_of_one_side_are_still_found() -> None:
    table = drive(180.0, 15.0, 2.0)
    table["wheel_speed_front"] += 1.5 * table["yaw_rate"] / 2 / RADIUS
    table["wheel_speed_rear"] -= 1.5 * table["yaw_rate"] / 2 / RADIUS
    (text,) = said(table)
    assert text.startswith("check the wheels")
