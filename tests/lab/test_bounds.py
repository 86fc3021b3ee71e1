"""The bounds, held against sums over all samples at once."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from test_peers import Window, drive

from tselab import bounds, peers
from tselab.core import NOMINAL, STIFFNESS, Config, Filter
from tselab.log import MEASURES


def test_cramer_rao_is_the_inverse_of_the_fisher_information_of_all_samples_at_once():
    """25 rows; information of (x0, mu, b0, every eps, every step of the biases) from the reference's model, prior and
    measurements in one sum; its inverse's block of mu, for horizons of 1, 10 and all rows."""
    window = Window(1.0)
    x = window.trajectory(np.zeros((len(window.sd), 1)))[0][..., 0]
    mean = dict(zip(STIFFNESS, 1 + window.mu, strict=True))
    truth = pd.DataFrame({f"true_{name}": x[:, i] for i, name in enumerate(peers.STATES)})
    truth = truth.assign(**{f"true_{s}": getattr(window.config, NOMINAL[s]) * v for s, v in mean.items()})
    y = np.zeros((window.ROWS, 3))
    y[7, 0] = y[9:12, 1] = np.nan  # missing
    use = np.isfinite(y)
    use[0, 2] = False  # the filters start from the first yaw rate

    bound = bounds.cramer_rao(window.rows(y), truth, window.config, window.known)

    window.step = 1e-4  # of an sd: the derivative at the truth, not over a whole sd
    for rows in (1, 10, window.ROWS):
        until = use & (np.arange(window.ROWS) < rows)[:, None]
        covariance = np.linalg.inv(window.information(until)[1])
        expected = window.sd[3:6] * np.sqrt(np.diag(covariance)[3:6]) / list(mean.values())
        np.testing.assert_allclose(bound[rows - 1], expected, rtol=2e-5)
    assert (bound[-1] < 0.7 * bound[0]).sum() >= 2  # it taught something


@pytest.mark.parametrize("case", [{}, {"noise": 3.0}, {"low": True}])
def test_without_forgetting_both_bounds_are_one(case):
    """Gains are optimal then, and what the filter believes is what it does."""
    d = drive(duration=5.0, forgetting=1.0, **case)
    d.rows["accel_y"][100:150] = np.nan
    d.rows["wheel_speed_rear"][200:240] = np.nan  # states start again
    args = d.rows, d.truth, d.config, d.known
    np.testing.assert_allclose(bounds.forgetting_bound(*args), bounds.cramer_rao(*args), rtol=1e-6)


def still_regressors(n: int, rng: np.random.Generator) -> tuple[Config, np.ndarray, pd.DataFrame, np.ndarray]:
    """Rows so far apart that the states start again at each, and are then known exactly; without biases. What is left are
    two scalar regressions, Cx on accel_x and Cy front on accel_y. Also their regressors."""
    settings = {f"initial_{k}_sd": 0.0 for k in ("vel_x", "vel_y", "yaw_rate")}
    settings |= {f"{m}_bias_{what}": 0.0 for m in MEASURES for what in ("sd", "walk")}
    config = Config({**settings, "sample_time": 0.02, "max_gap": 0.01})
    rows = Filter(config).inputs(n)
    v, yaw = 20.0, rng.uniform(0.1, 0.3, n)
    slip = rng.uniform(0.005, 0.02, n)
    rows["dt"] = 0.02
    rows["wheel_speed_front"] = rows["wheel_speed_rear"] = v / (1 - slip) / 0.33
    c = config
    truth = pd.DataFrame({"true_vel_x": np.full(n, v), "true_vel_y": c.lr * yaw, "true_yaw_rate": yaw})
    for s in STIFFNESS:
        truth[f"true_{s}"] = 0.8 * getattr(c, NOMINAL[s])
    kx = (c.longitudinal_stiffness_front + c.longitudinal_stiffness_rear) / c.mass
    alpha = -(c.lr + c.lf) * yaw / v  # none at the rear
    return c, rows, truth, np.array([kx * slip, c.cornering_stiffness_front / c.mass * alpha]).T


def test_the_forgetting_bound_is_that_of_least_squares_with_weights_lambda_to_the_age():
    """mu^ = sum lambda^age phi y / sum lambda^age phi^2 (in units of the noise, with the prior as sample 0): the variance
    of a weighted mean has the squares of its weights."""
    rate = 0.95
    c, rows, truth, phi = still_regressors(120, np.random.default_rng(2))
    known = peers.Known((0.05, 0.1, 0.05), (0.15, 0.2, 0.01), rate)
    args = rows, truth, c, known
    actual, believed = bounds.forgetting_bound(*args), bounds.reported(*args)
    variance = np.array([0.15, 0.2]) ** 2 + (phi * [0.05, 0.1]) ** 2  # eps is noise of its own
    information = np.concatenate([np.full((1, 2), 1 / c.initial_mean_sd**2), phi**2 / variance])
    for k in (0, 20, 119):
        weight = rate ** np.maximum(k - np.arange(-1, k + 1), 0)[:, None]
        weight[0] = rate**k  # the prior is as old as the first sample
        total = (weight * information[: k + 2]).sum(0)
        expected = np.sqrt((weight**2 * information[: k + 2]).sum(0)) / total
        np.testing.assert_allclose(actual[k, :2], expected / 0.8, rtol=1e-9)
        np.testing.assert_allclose(believed[k, :2], 1 / np.sqrt(total) / 0.8, rtol=1e-9)
    np.testing.assert_allclose((actual[-1, :2] / believed[-1, :2]) ** 2, 1 / (1 + rate), rtol=0.1)
    np.testing.assert_allclose(actual[:, 2], c.initial_mean_sd / 0.8)  # nothing shows it


def test_the_bound_falls_with_memory_and_rises_with_noise():
    d = drive(duration=8.0)

    def at(known: peers.Known) -> np.ndarray:
        return bounds.forgetting_bound(d.rows, d.truth, d.config, known)[d.time > 5].mean(0)

    sensors = d.known.noise_sd
    nominal = at(d.known)
    assert (at(peers.Known(d.known.spread, sensors, 0.995)) < 0.9 * nominal).all()
    assert (at(peers.Known(d.known.spread, tuple(3 * s for s in sensors))) > 1.5 * nominal).all()
    assert (at(peers.Known((0.15,) * 3, sensors)) > 1.1 * nominal).all()
    best = bounds.cramer_rao(d.rows, d.truth, d.config, d.known)[d.time > 5].mean(0)
    assert (best < nominal).all()
