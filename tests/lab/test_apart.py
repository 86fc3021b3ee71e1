"""Wheel speeds in two messages: calibrate finds how much later one is, of a drive that nothing of the library has made."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import PchipInterpolator

from tselab.calibrate.along import APART_SD, wheels_apart
from tselab.core import Config
from tselab.identify.fit import Fit
from tselab.log import Log, read_frame

DT, SECONDS, DRAG, ROLLING, TYRES = 0.01, 240.0, 0.4, 0.01, 120e3
NAMES = [
    "wheel_speed_front_latency",
    "wheel_speed_rear_latency",
    "rolling_resistance_coefficient",
    "aero_drag_coefficient",
]


def drive(driven: str, later: float, seed: int) -> Log:
    """Return a log of a car that speeds up and coasts, its driven axle slipping by force over stiffness; front wheels later."""
    config, rng = Config(), np.random.default_rng(seed)
    t = DT * np.arange(round(SECONDS / DT))
    knots = np.arange(0.0, SECONDS + 8.0, 8.0)
    v = PchipInterpolator(knots, np.where(np.arange(len(knots)) % 2, 1, 0) * rng.uniform(6, 16, len(knots)) + 6.0)(t)
    gains = np.gradient(v, DT)
    force = config.mass * (gains + 9.81 * ROLLING) + DRAG * v**2
    speed = {driven: v * (1 + force / TYRES), "rear" if driven == "front" else "front": v}
    frame = {"time": t, "steer_angle": 0.002 * np.sin(t), "accel_x": gains + 0.1 * rng.standard_normal(len(t))}
    frame |= {"accel_y": 0 * t, "yaw_rate": 0.001 * rng.standard_normal(len(t))}
    for axle in ("front", "rear"):
        late = later if axle == "front" else 0.0
        turned = np.interp(t - late, t, speed[axle]) / getattr(config, f"wheel_radius_{axle}")
        frame[f"wheel_speed_{axle}"] = turned + 0.03 * rng.standard_normal(len(t))
    return read_frame(pd.DataFrame(frame))


def searched() -> tuple[Any, Fit]:
    """Return what a search leaves that saw nothing of it."""
    made = Fit(np.array([0.004, 0.004, ROLLING, DRAG]), {}, np.zeros((4, 4)))
    return SimpleNamespace(config=Config(), names=NAMES), made


@pytest.mark.parametrize("driven", ["front", "rear"])
@pytest.mark.parametrize("later", [-0.008, 0.0, 0.008])
def test_how_much_later_the_front_wheel_speed_is_is_found(driven: str, later: float) -> None:
    """To 2.5 ms: 0.3 ms of scatter, and 1 ms of 8 because the slip is as late as the speed, which the regression leaves out."""
    problem, fit = searched()
    found = wheels_apart(problem, fit, [drive(driven, later, 1), drive(driven, later, 2)], driven).x
    assert found[0] - found[1] == pytest.approx(later, abs=0.0025)
    assert 0.5 * (found[0] + found[1]) == pytest.approx(0.004)
    np.testing.assert_array_equal(found[2:], fit.x[2:])


def test_what_logs_do_not_show_is_left_as_it_was() -> None:
    """Four driven wheels, a car that does not accelerate."""
    problem, fit = searched()
    log = drive("front", 0.008, 1)
    assert wheels_apart(problem, fit, [log], "both") is fit
    steady = replace(log, data=log.data.assign(accel_x=0.0))
    assert wheels_apart(problem, fit, [steady], "front") is fit


def test_what_they_hardly_show_is_shrunk() -> None:
    """A single minute of noisy wheels: nearer to nothing than to what is true, or within what is known before."""
    problem, fit = searched()
    log = drive("front", 0.03, 3)
    rng = np.random.default_rng(4)
    loud = log.data.assign(wheel_speed_front=log.data["wheel_speed_front"] + 3.0 * rng.standard_normal(len(log.data)))
    found = wheels_apart(problem, fit, [replace(log, data=loud)], "front").x
    assert abs(found[0] - found[1]) < 3 * APART_SD
