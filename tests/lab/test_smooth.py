"""The smoothed stiffness of a stretch: against batch least squares of a random walk, on made-up tables, on drives with truth."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import make_smoothing_spline
from test_what_happened import NOMINAL, ROAD, table_of

import tse
from conftest import tselab_here
from tse.impl import results
from tse.impl.core import NOMINAL as SETTING
from tse.impl.core import STIFFNESS, Config
from tse.impl.estimate import Estimate
from tse.impl.identify.data import smoothing_spline
from tse.impl.regimes import changes
from tse.impl.smooth import backward, fixed, smooth
from tse.impl.verdict import findings

CAR = {"mass": 1900, "lf": 1.25, "lr": 1.5, "wheel_radius_front": 0.33, "wheel_radius_rear": 0.33}


def random_walk(rng, walk, noise, prior=0.3):
    """Draw a random walk, measure it (noise: variance of each row, inf: none), and estimate it with a Kalman filter.

    Returned: z, and mean and variance after each row."""
    true = np.cumsum(np.concatenate([[rng.normal(0, prior)], rng.normal(0, np.sqrt(walk))]))
    read = np.isfinite(noise)
    z = np.where(read, true + rng.normal(size=len(true)) * np.sqrt(np.where(read, noise, 0)), 0.0)
    mean, var, m, p = [], [], 0.0, prior**2
    for i, r in enumerate(noise):
        p += walk[i - 1] if i else 0.0
        gain = p / (p + r)
        m, p = m + gain * (z[i] - m), p * (1 - gain)
        mean.append(m)
        var.append(p)
    return z, np.array(mean), np.array(var)


def least_squares(z, walk, noise, prior=0.3):
    """All rows at once: prior, steps and measurements as one linear problem. Returned: means, variances."""
    n = len(z)
    step = np.diff(np.eye(n), axis=0)
    weight = np.concatenate([[1 / prior**2], 1 / walk, 1 / noise])
    A = np.concatenate([np.eye(1, n), step, np.eye(n)])
    b = np.concatenate([[0.0], np.zeros(n - 1), z])
    cov = np.linalg.inv(A.T @ (weight[:, None] * A))
    return cov @ (A.T @ (weight * b)), np.diag(cov)


@pytest.mark.parametrize("seed", range(5))
def test_it_is_batch_least_squares_of_the_random_walk(seed):
    rng = np.random.default_rng(seed)
    walk, noise = np.full(79, 1e-4), rng.uniform(0.01, 1.0, 80)
    noise[rng.random(80) < 0.3] = np.inf
    opened = walk.copy()
    opened[40], noise[41] = 0.2, np.inf  # the filter has opened the state here, and nobody says so but its variance
    z, mean, var = random_walk(rng, opened, noise)
    expected, expected_var = least_squares(z, opened, noise)
    found, found_var = backward(mean, var, walk)
    np.testing.assert_allclose(found, expected, atol=1e-10)
    np.testing.assert_allclose(found_var, expected_var, atol=1e-12)
    assert np.abs(mean - expected).max() > 0.01  # the filter alone is something else


def test_what_is_fixed_does_not_shrink_and_the_rest_is_least_squares():
    n, part, step = 100, 0.05, 0.1
    config = Config({"steady_walk": 0.05, **{setting: NOMINAL[key] for key, setting in SETTING.items()}})
    walk, noise = np.full(n - 1, config.steady_walk**2 * step), np.full(n, 0.04)
    z, mean, var = random_walk(np.random.default_rng(7), walk, noise)
    table = pd.DataFrame({"time": (np.arange(n) + 0.5) * step, "status": np.zeros(n, int)})
    told = {"one": np.zeros(3), "other": np.zeros(3)}
    for a, key in enumerate(STIFFNESS):
        table[key] = NOMINAL[key] * np.exp(mean)
        table[f"{key}_sd"] = table[key] * np.sqrt(var + part**2)
        told["one"][a], told["other"][a] = (np.exp(mean[-1]) * part * x for x in (0.6, 0.8))
    expected, expected_var = least_squares(z, walk, noise)
    for key, found in fixed(table, config, told).items():
        assert found == pytest.approx(part**2)
        value, sd = smooth(table, key, config, found)
        assert value == pytest.approx(NOMINAL[key] * np.exp(expected.mean()))
        assert (
            sd / value == pytest.approx(np.sqrt(expected_var.mean() + part**2 + expected.var())) and sd / value > part
        )
        more = table.loc[table.index.repeat(10)].assign(time=(np.arange(10 * n) + 0.5) * step / 10)
        assert smooth(more, key, config, found) == pytest.approx((value, sd))  # as often as it is read
        refused = pd.concat([table, table.assign(status=-1, time=99.0) * [1, 1, *[9] * 6]])
        assert smooth(refused, key, config, found) == pytest.approx((value, sd))


def test_each_stretch_has_its_own_and_what_comes_before_a_change_does_not_bend_it():
    """The filter is drawn to the other road for half a second before it believes in the change."""
    table = table_of(ROAD, valid=lambda t: t < 55)
    doubt = table["time"].between(35.5, 36.02)
    for key in STIFFNESS:
        table.loc[doubt, key] *= np.linspace(1, 0.75, doubt.sum())
        table.loc[doubt, f"{key}_sd"] = table.loc[doubt, key] * np.linspace(0.01, 0.15, doubt.sum())
    found = changes(table)
    one, two = findings(table, Config(), found)
    assert one.verdicts[1].value < 95  # of the last row
    for f, level in ((one, 1.0), (two, 0.7)):
        for v in f.verdicts:
            assert v.smoothed == pytest.approx(level * NOMINAL[v.key] / 1000, rel=0.01) and v.smoothed_reason == "valid"
    assert one.lines()[2].endswith("; smoothed over the stretch 119 ± 8, valid")
    rows = results.rows("log", Estimate(table, False), [one, two], found, ())
    assert [r["change_probability"] for r in rows[3:]] == pytest.approx([0.97] * 3)
    assert rows[3]["start"] == pytest.approx(36.03)
    assert rows[1]["smoothed_low"] < 1.2e5 < rows[1]["smoothed_high"] and rows[0]["change"] is None


@pytest.mark.parametrize(
    ("sd", "rows", "reason"),
    [(0.01, "valid", "valid"), (0.2, "valid", "uncertain"), (0.2, "parameters uncertain", "parameters uncertain"),
     (0.2, "held", "held"), (0.01, "not excited", "not excited")],
)  # fmt: skip
def test_it_is_valid_if_rows_are_and_its_own_interval_allows_it(sd, rows, reason):
    table = table_of([(0.0, 60.0, None)], valid=lambda t: np.full(len(t), rows == "valid"))
    for key in STIFFNESS:
        table[f"{key}_sd"], table[f"{key}_reason"] = sd * table[key], rows
    (found,) = findings(table, Config(), [])
    assert [v.smoothed_reason for v in found.verdicts] == [reason] * 3
    assert all(v.smoothed_band == pytest.approx(1.96 * sd * v.smoothed, rel=0.1) for v in found.verdicts)


def test_channels_that_contradict_each_other_leave_the_reason_and_refused_rows_nothing():
    table = table_of(ROAD)
    (found,) = findings(table, Config(), changes(table), ["a sign"])
    assert all(v.smoothed_reason == "contradicted" and np.isnan(v.smoothed) for v in found.verdicts)
    (found,) = findings(table.assign(status=-1), Config(), [])
    assert all(v.smoothed_reason == "" and np.isnan(v.smoothed) for v in found.verdicts)
    (found,) = findings(table_of([(0.0, 60.0, None)]), Config(Config.form("paper")), [])
    assert all(v.smoothed_reason == "" and "smoothed" not in v.text for v in found.verdicts)  # particles forget


@pytest.mark.parametrize(
    ("known", "before", "after"), [(False, 1.0, 0.7), (True, 0.9, 0.6)], ids=["uncalibrated", "exact"]
)
def test_the_interval_holds_on_simulated_drives_with_a_change_of_the_road(known, before, after, drive):
    car = drive.vehicle if known else CAR
    inside, errors = [], []
    for seed in (1, 2, 3):
        road = [(0, before), (30, after)]
        made = tse.simulate("double-lane-change", None if known else car, seed=seed, duration=60, road_changes=road)
        result = tse.estimate(made.log, car)
        table = result.stretches
        assert table["start"].tolist() == pytest.approx([0, 0, 0, 30, 30, 30], abs=3)
        told = (
            np.sqrt(sum(sd**2 for sd in result.uncertainty_sd.values())) / result.stiffness[-1]
        )  # over the nominal of each
        for n, row in enumerate(table.itertuples()):
            true = row.nominal * (before if n < 3 else after)
            inside.append(row.smoothed_low < true < row.smoothed_high)
            errors.append([abs(row.smoothed / true - 1), abs(row.value / true - 1)])
            assert row.smoothed_sd / row.smoothed >= told[n % 3] * row.nominal * 0.999
    smoothed, last = np.array(errors).mean(axis=0)
    assert np.mean(inside) >= 0.9 and smoothed < 1.1 * last, (inside, smoothed, last)  # both 1 % of a car known exactly


def test_a_log_with_no_valid_row_has_an_answer_with_its_reason(tmp_path):
    (tmp_path / "car.toml").write_text(
        "mass = 1500\nlf = 1.2\nlr = 1.5\nwheel_radius_front = 0.3\nwheel_radius_rear = 0.3\n"
    )
    made = ("simulate", "--maneuver", "straight", "--duration", 20, "--out", "log.csv")
    assert tselab_here(*made, "--vehicle", "car.toml", cwd=tmp_path).code == 0
    run = ("estimate", "log.csv", "--vehicle", "car.toml", "--out", "e.csv")
    done = tselab_here(*run, "--report", "r.html", "--table", "t.csv", cwd=tmp_path)
    assert done.code == 4, done.err
    lines = [x for x in done.out.splitlines() if "stiffness:" in x]
    assert len(lines) == 3 and all(
        "; smoothed over the log " in x and ", not valid: " in x.split("smoothed")[1] for x in lines
    )
    said = json.loads(tselab_here(*run, "--json", cwd=tmp_path).out)["stretches"][0]["stiffness"]
    table = pd.read_csv(tmp_path / "t.csv").set_index("stiffness")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    estimates = pd.read_csv(tmp_path / "e.csv")
    for key, v in said.items():
        assert not estimates[f"{key}_valid"].any() and v["valid"] == 0
        assert v["smoothed_low"] < v["smoothed"] < v["smoothed_high"] and v["smoothed_reason"] == "uncertain"
        assert table.loc[key, "smoothed"] == v["smoothed"] and table.loc[key, "smoothed_reason"] == "uncertain"
    assert "Smoothed over the log" in page and page.count(", not valid: uncertain") >= 3


# ---- splines


@pytest.fixture(scope="module")
def signal():
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.uniform(0.005, 0.02, 800))
    return time, np.sin(time) + 0.1 * rng.standard_normal(800)


@pytest.mark.parametrize("penalty", [0.0, 1e-8, 1e-5, 1e-3, 1.0])
def test_it_is_that_of_scipy(signal, penalty):
    time, y = signal
    between = np.linspace(time[0], time[-1], 3001)
    # scipy solves a system whose condition grows with the penalty: 1e-8 at a penalty of 1 s3
    assert smoothing_spline(time, y, penalty)(between) == pytest.approx(
        make_smoothing_spline(time, y, lam=penalty)(between), abs=1e-8
    )


def test_a_great_penalty_leaves_the_regression_line(signal):
    time, y = signal
    assert smoothing_spline(time, y, 1e9)(time) == pytest.approx(np.polyval(np.polyfit(time, y, 1), time), abs=1e-5)


def test_three_values_are_enough():
    assert smoothing_spline(np.array([0.0, 1.0, 3.0]), np.array([1.0, 2.0, 4.0]), 0.1)(2.0) == pytest.approx(3.0)
