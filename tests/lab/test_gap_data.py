"""Logs as the gap workflow takes them: which rows hold something new."""

import numpy as np
import pytest

from tselab.gap.data import Smoother, fresh

TIME = 0.005 * np.arange(4000)
SIGNAL = np.sin(1.7 * TIME) + 0.3 * np.sin(11.0 * TIME)


@pytest.mark.parametrize("hold", [2, 4, 10])
def test_a_slow_signal_held_in_a_fast_log_is_taken_where_it_is_new(hold: int) -> None:
    held = np.repeat(SIGNAL[3::hold], hold)[: len(TIME) - 3]
    held = np.append(np.full(3, SIGNAL[0]), held)
    found = fresh(held)
    assert found[1:].mean() == pytest.approx(1.0 / hold, abs=2e-3)
    np.testing.assert_array_equal(held[found][2:], SIGNAL[found][2:])
    late = np.abs(Smoother(TIME, held).of(held) - SIGNAL)[50:-50].max()
    assert late < 0.003  # held as it is: late by half of the hold, 0.01 and more


def test_the_same_value_again_is_new_at_its_beat() -> None:
    slow = np.round(SIGNAL[::4], 1)
    assert fresh(np.repeat(slow, 4))[4:].mean() == pytest.approx(0.25, abs=0.01)


@pytest.mark.parametrize("step", [0.0, 0.01, 0.2])
def test_a_fast_signal_is_new_in_every_row_however_coarse(step: float) -> None:
    noisy = SIGNAL + 0.02 * np.random.default_rng(1).standard_normal(len(TIME))
    assert fresh(np.round(noisy / step) * step if step else noisy).all()


def test_a_sensor_that_stands_still_is_no_slow_one() -> None:
    stuck = SIGNAL.copy()
    stuck[1000:1300] = stuck[1000]
    assert fresh(stuck).all()
    assert fresh(np.zeros(100)).all()
