"""The smoothed stiffness of a stretch: against batch least squares of a random walk."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from test_what_happened import NOMINAL

from tselab.core import NOMINAL as SETTING
from tselab.core import STIFFNESS, Config
from tselab.smooth import backward, fixed, smooth


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
