"""The smoothing spline against scipy's, and against what it must do at both ends of the penalty."""

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from tselab.spline import smoothing_spline


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
