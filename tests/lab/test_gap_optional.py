"""Speed over ground and wheel torques in a log: what of them is taken as the sensor's own, and what the noise of inputs does."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import interp1d
from scipy.optimize import least_squares

from gap_logs import DRIVES, STIFFNESS, candidate, car, write_log
from tse.impl.core import Config
from tse.impl.gap import optional
from tse.impl.gap.data import prepare, renewed
from tse.impl.gap.drives import prepared
from tse.impl.gap.fit import fit, gap
from tse.impl.gap.problem import STIFFNESS as FITTED
from tse.impl.gap.problem import Problem
from tse.impl.gap.simulate import simulate
from tse.impl.logs.log import read_log
from tse.impl.vehicle import read_vehicle

CHANNELS = {"vehicle_speed": 0.05, "wheel_torque_front": 8.0, "wheel_torque_rear": 8.0}
TORQUES = ("wheel_torque_front", "wheel_torque_rear")
SEED = 3
TIME = 0.04 * np.arange(700)


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory) -> Path:
    return car(tmp_path_factory.mktemp("optional"))


@pytest.fixture(scope="module")
def table(vehicle) -> pd.DataFrame:
    """A log of a clean car with all channels."""
    return pd.read_csv(write_log(vehicle.parent / "clean.csv", vehicle, "brakes", {}, SEED, **CHANNELS))


def problem_of(table: pd.DataFrame, vehicle: Path, name: str) -> Problem:
    path = vehicle.parent / f"{name}.csv"
    table.to_csv(path, index=False, float_format="%.9g")
    config = Config(read_vehicle(vehicle).values)
    return Problem([prepare(read_log(path), config)], config)


def late(table: pd.DataFrame, name: str, seconds: float) -> np.ndarray:
    return np.interp(table["time"] - seconds, table["time"], table[name])


def test_reading_is_that_of_a_general_optimiser():
    """Seed 5. Scales, latencies and bracing of both torques, against scipy's least_squares with another interpolation."""
    rng = np.random.default_rng(5)
    wave = 900 * np.sin(1.3 * TIME) + 400 * np.sin(3.1 * TIME + 1)
    predicted = {"wheel_torque_front": wave, "wheel_torque_rear": 0.5 * np.minimum(wave, 0) + 100 * np.sin(2 * TIME)}
    truth = {"wheel_torque_front": (0.06, -0.09, 0.07), "wheel_torque_rear": (0.03, 0.05, -0.04)}
    braced = 60.0

    def reading(c: str, driving: float, braking: float, latency: float, constant: float) -> np.ndarray:
        x = interp1d(TIME, predicted[c], "cubic", bounds_error=False, fill_value="extrapolate")(TIME - latency)
        return x + driving * np.maximum(x, 0) + braking * np.minimum(x, 0) + constant

    measured = {c: reading(c, *truth[c], sign * braced) + 4 * rng.standard_normal(len(TIME))
                for c, sign in zip(TORQUES, (1, -1), strict=True)}  # fmt: skip
    weight = {c: np.where((TIME > 1) & (TIME < 27), 0.25, 0.0) for c in TORQUES}
    found, readings = optional.read(TIME, predicted, measured, weight)

    def misfit(x: np.ndarray) -> np.ndarray:
        read = [reading(c, *x[3 * i : 3 * i + 3], (1 - 2 * i) * 100 * x[6]) for i, c in enumerate(TORQUES)]
        return np.concatenate([weight[c] * (measured[c] - r) for c, r in zip(TORQUES, read, strict=True)])

    best = least_squares(misfit, np.zeros(7), xtol=1e-12).x
    mine = [r.value for r in readings if r.key != "braced"]
    np.testing.assert_allclose(mine, best[:6], atol=5e-4)  # the other one knows no prior
    assert next(r.value for r in readings if r.key == "braced") == pytest.approx(100 * best[6], abs=0.3)
    for r, true in zip(
        (r for r in readings if r.key != "braced"), (*truth[TORQUES[0]], *truth[TORQUES[1]]), strict=True
    ):
        assert abs(r.value - true) < 4 * r.sd, r
    rms = np.sqrt(np.mean([(weight[c] * (measured[c] - found[c]))[weight[c] > 0] ** 2 for c in TORQUES]))
    assert rms == pytest.approx(1.0, abs=0.05)


def test_common_constant_of_the_torques_is_the_cars_and_so_is_what_is_beyond_a_plausible_scale():
    wave = 900 * np.sin(1.3 * TIME)
    predicted = dict.fromkeys(TORQUES, wave)
    weight = dict.fromkeys(TORQUES, np.full(len(TIME), 0.25))

    def left(measured: dict[str, np.ndarray]) -> float:
        found, _ = optional.read(TIME, predicted, measured, weight)
        return float(np.sqrt(np.mean([(measured[c] - found[c]) ** 2 for c in TORQUES])))

    assert left({"wheel_torque_front": wave + 50, "wheel_torque_rear": wave - 50}) < 0.1
    common = left({"wheel_torque_front": wave + 50, "wheel_torque_rear": wave + 50})
    assert common == pytest.approx(50 * np.sqrt(1 - 8 / np.pi**2), rel=0.03)  # of a constant what is not like |sine|
    assert left(dict.fromkeys(TORQUES, 1.14 * wave)) < 0.1
    beyond = left(dict.fromkeys(TORQUES, 1.25 * wave))  # a tenth of the wave: 900/sqrt(2)/10
    assert beyond == pytest.approx(0.1 * 900 / np.sqrt(2), rel=0.02)


def test_what_smoothing_leaves_of_the_wheel_speeds_noise_is_known(vehicle, table):
    """Against the truth: the same car driven by the wheel speeds as they were before noise was put on them."""
    problem = problem_of(table, vehicle, "blur")
    log, config = problem.logs[0], problem.config
    true = prepared(candidate(config, DRIVES["brakes"]), config)[0].inputs
    clean = {k: x[: len(log.time)] for k, x in true.items()}
    smooth = simulate(config, log, TORQUES, STIFFNESS, {})
    log.inputs = clean
    exact = simulate(config, log, TORQUES, STIFFNESS, {})
    used = np.concatenate([np.arange(s.first, s.last)[s.used] for s in log.stretches])
    for c in TORQUES:
        error = float(np.sqrt(np.mean((smooth[c] - exact[c])[used] ** 2)))
        told = float(np.sqrt(np.mean(log.blur[c][used] ** 2)))
        assert error > 4.0  # as much as the sensor's own noise of 8 Nm leaves of a block: not to be left out
        assert 0.6 < told / error < 1.5, c


def test_channels_that_are_late_and_out_of_scale_leave_no_gap_and_are_told(vehicle, table):
    changed = table.copy()
    held = np.floor(table["time"] / 0.1 + 1e-6) * 0.1  # a GNSS at 10 Hz, its last value held
    changed["vehicle_speed"] = 1.03 * np.interp(held - 0.1, table["time"], table["vehicle_speed"])
    changed["wheel_torque_front"] = 1.10 * late(table, "wheel_torque_front", 0.05)
    changed["wheel_torque_rear"] = 0.92 * late(table, "wheel_torque_rear", 0.05) - 40.0
    changed["wheel_torque_front"] += 40.0
    clean = problem_of(table, vehicle, "as_it_is")
    before = fit(clean, FITTED, {})
    assert optional.words(clean.readings(before.values)) == []
    problem = problem_of(changed, vehicle, "misread")
    baseline = fit(problem, FITTED, {})
    gaps = [gap(p, f.residuals) for p, f in ((clean, before), (problem, baseline))]
    for c in gaps[0]:
        assert gaps[1][c] < gaps[0][c] + 0.1, (c, gaps)
    for p, true in STIFFNESS.items():  # and none of it went into the tyres
        assert baseline.values[p] == pytest.approx(true, rel=0.03)
    said = " ".join(optional.words(problem.readings(baseline.values)))
    assert "vehicle_speed reads +3.0 %" in said and re.search(r"vehicle_speed reads 0\.1[01] s late", said), said
    assert "wheel_torque_front reads 0.05 s late" in said and "wheel_torque_front reads +1" in said, said


def test_held_values_are_not_samples():
    x = np.repeat(np.arange(5.0), 4)
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(renewed(x))), [0, 4, 8, 12, 16])
    rng = np.random.default_rng(1)
    noisy = np.round(rng.standard_normal(200), 1)  # now and then the same twice
    np.testing.assert_array_equal(renewed(noisy), noisy)
