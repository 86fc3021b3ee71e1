"""How late the steering acts is found, and the stiffness is right all the same: logs of which columns are shifted."""

from __future__ import annotations

import numpy as np
import pytest

from tselab.core import STIFFNESS, Config, Filter, SimConfig, Simulator

ROWS, DT = 6000, 0.01
IMU = ("accel_x", "accel_y", "yaw_rate")


@pytest.fixture(scope="module")
def driven() -> np.ndarray:
    """Rows of the simulator: steering sweeps to 1.5 Hz, torque steps smoothed over 0.1 s, nothing late."""
    simulator = Simulator(Config(), SimConfig({"seed": 3, "speed": 20.0}))
    inputs, outputs = simulator.inputs(ROWS), simulator.outputs(ROWS)
    t = DT * np.arange(ROWS)
    inputs["dt"], inputs["road_level"] = DT, 1.0
    inputs["steer_angle"] = 0.03 * np.sin(2 * np.pi * 0.9 * t + 8 * np.sin(0.25 * t))
    inputs["wheel_torque_front"] = 1000 * np.tanh(6 * np.sin(1.3 * t))
    for i in range(ROWS):
        simulator.step_into(inputs, outputs, i)
    return outputs


def logged(driven: np.ndarray, late: dict[str, float]) -> np.ndarray:
    """The log in which columns are late by so many seconds."""
    rows = np.zeros(ROWS, Filter(Config()).inputs(1).dtype)
    t = DT * np.arange(ROWS)
    for name in rows.dtype.names:
        if name in driven.dtype.names:
            rows[name] = np.interp(t - late.get(name, 0.0), t, driven[name])
    rows["dt"] = DT
    return rows


def estimated(rows: np.ndarray, **settings: float) -> np.void:
    filter_ = Filter(Config({"driven_axle": 1.0} | settings))
    out = filter_.outputs(len(rows))
    filter_.step_into(rows, out)
    return out[-1]


# What acts, and what is found: the steering column early by 20 ms acts 20 ms late; an IMU that is late makes all else early.
CASES = {
    "nothing": ({}, 0.0),
    "steering acts late": ({"steer_angle": -0.02}, 0.02),
    "IMU late": (dict.fromkeys(IMU, 0.01), 0.01),
    "steering logged late": ({"steer_angle": 0.01}, -0.01),
}


@pytest.mark.parametrize("case", CASES)
def test_a_lag_is_found_and_costs_no_stiffness(driven, case):
    """2.5 ms: twice the sd that is claimed. How late the IMU is behind the wheels is in the longitudinal stiffness."""
    late, steer = CASES[case]
    last = estimated(logged(driven, late))
    assert last["lag_steer"] == pytest.approx(steer, abs=0.0025)
    assert last["lag_steer_sd"] < 0.002
    for key in STIFFNESS[1:] if case == "IMU late" else STIFFNESS:
        assert last[key] == pytest.approx(1.0, abs=0.08 if key == "cx_front" else 0.03), (case, key)
        assert abs(last[key] - 1) < 2.6 * last[f"{key}_sd"]
        assert last[f"{key}_valid"] == 0


def test_where_no_lag_is_allowed_it_is_taken_for_another_stiffness(driven):
    """So that the test above shows what the lags do."""
    last = estimated(logged(driven, CASES["steering acts late"][0]), steer_lag_sd=0.0)
    assert abs(last["lag_steer"]) < 1e-6 and last["lag_steer_sd"] < 1e-6
    assert abs(last["cy_rear"] - 1) > 0.05


def test_what_nothing_excites_stays_unknown(driven):
    rows = logged(driven, {})
    rows = np.repeat(rows[:1], 1000)
    last = estimated(rows)
    assert last["lag_steer"] == pytest.approx(0, abs=0.01) and last["lag_steer_sd"] == pytest.approx(0.02, rel=0.3)
