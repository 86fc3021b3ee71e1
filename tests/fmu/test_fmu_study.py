"""The paper's study (Sec. IV-A) with the two FMUs in a loop, against the same study through the library."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import pytest
from fmu_support import CHANNELS, Instance, Log, expect_same_rows, expected_outputs, parameters_of, unit

from tse.impl import maneuvers
from tse.impl.core import Config, SimConfig
from tse.impl.simulate import simulate

SEEDS = (1, 2, 3)
DURATION, WINDOW, STEP = 40.0, 20.0, 0.01  # s
STIFFNESS = ("cx_front", "cy_front", "cy_rear")
START = {f"initial_{s}": 0.7 for s in STIFFNESS}


def square(time: float, period: float) -> float:
    return 1.0 if (time / period + 1e-9) % 1.0 < 0.5 else -1.0


@dataclass
class Study:
    """What the estimator was given and put out, row by row; per stiffness mean error [%], mean square error [%^2], share of the
    time that it is called valid [%]."""

    log: Log
    rows: list[dict[str, float]]
    result: dict[str, tuple[float, float, float]]


@functools.cache
def study(seed: int, ramp: bool = True) -> Study:
    """Run both."""
    vehicle, estimator = unit("SingleTrackVehicle"), unit("TireStiffnessEstimator")
    n = round(DURATION / STEP) + 1
    errors, valid, channels, rows = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, len(CHANNELS))), []

    def driver(k: int) -> dict[str, float]:
        return {"steer_angle": 0.02 * square(k * STEP, 4.0), "wheel_torque_front": 700.0 * square(k * STEP, 5.0)}

    with Instance(vehicle, "vehicle") as car, Instance(estimator, "estimator") as filter_:
        car.start({"simulation.seed": seed, "ramp": ramp}, driver(0))
        filter_.start(parameters_of({"seed": seed, **START}, estimator))
        for k in range(n):
            row = car.get([f"sensor.{c}" for c in CHANNELS] + [f"true.{s}" for s in STIFFNESS])
            channels[k] = [row[f"sensor.{c}"] for c in CHANNELS]
            filter_.set({c: row[f"sensor.{c}"] for c in CHANNELS})
            filter_.step(k * STEP, STEP)
            rows.append(filter_.get())
            for a, s in enumerate(STIFFNESS):
                errors[k, a] = 100 * (rows[-1][f"estimate.{s}"] / row[f"true.{s}"] - 1)
                valid[k, a] = rows[-1][f"estimate.{s}_valid"]
            # with ramp: where the driver is at the end of the step; held: what he did at its start
            car.set(driver(k + 1 if ramp else k))
            car.step(k * STEP, STEP)
    late = np.arange(n) * STEP >= WINDOW
    result = {
        s: (errors[late, a].mean(), np.mean(errors[late, a] ** 2), 100 * valid[late, a].mean())
        for a, s in enumerate(STIFFNESS)
    }
    return Study(Log(np.arange(n) * STEP, channels), rows, result)


@pytest.mark.parametrize("seed", SEEDS)
def test_each_run_is_the_run_of_the_library(seed: int) -> None:
    """The vehicle drives as the simulator does, but for the last bit of the time steps; of what it logged the estimator makes what
    the library makes."""
    run, settings = study(seed), {"seed": seed, **START}
    config = Config(settings)
    maneuver = maneuvers.build("square-waves", config, sample_time=STEP, duration=DURATION)
    log = simulate(maneuver, config, SimConfig({"seed": seed})).log
    assert np.abs(log[CHANNELS].to_numpy(float) - run.log.channels).max() < 1e-9
    expect_same_rows(run.rows, (expected_outputs(row, config) for row in run.log.through_library(settings)))


def test_estimates_leave_the_start_for_the_truth() -> None:
    """They start 30 % too low."""
    for s in STIFFNESS:
        mean, square_, valid = np.array([study(seed).result[s] for seed in SEEDS]).T
        print(f"{s}: mean error {mean.mean():+.2f} %, RMS {np.sqrt(square_).mean():.2f} %, valid {valid.mean():.0f} %")
        assert np.sqrt(square_).max() < 15 and valid.min() > 50, s


def test_held_inputs_cost_the_stiffness_little() -> None:
    """src/host/simulate.c, between(): held inputs lead the logged rows by half a row, and the estimator can only interpolate. Hence
    `ramp` is true by default."""
    for s in STIFFNESS:
        cost = np.array([study(seed, ramp=False).result[s][0] - study(seed).result[s][0] for seed in SEEDS])
        print(f"{s}: ramp=false moves the mean error by {cost.mean():+.2f} % ({cost.min():+.2f} .. {cost.max():+.2f})")
        assert 0 < np.abs(cost).max() < 5, s


def test_a_first_row_of_zeros_is_forgotten() -> None:
    """What importers hand on that connect outputs one step late (fmu/connect.html). Soon estimates are about those without it."""
    run, estimator = study(1), unit("TireStiffnessEstimator")
    channels = run.log.channels[:2000].copy()
    channels[0] = 0.0
    with Instance(estimator) as instance:
        instance.start(parameters_of({"seed": 1, **START}, estimator))
        rows = Log(run.log.time[:2000], channels).through_fmu(instance)
    for k in (499, 999, 1999):
        for s in STIFFNESS:
            off = rows[k][f"estimate.{s}"] - run.rows[k][f"estimate.{s}"]
            assert abs(off) < 1.96 * run.rows[k][f"estimate.{s}_sd"], (k, s)
