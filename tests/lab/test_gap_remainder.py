"""What of a residual is the sensors' own."""

import numpy as np
import pytest
from scipy.signal import lfilter

from tselab.gap.data import BLOCK
from tselab.gap.localise.remainder import is_noise, without_spikes, without_walk

LOG = np.repeat(np.arange(4), 750)  # four logs of 30 s


def white(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(len(LOG))


def low_pass(x: np.ndarray, seconds: float) -> np.ndarray:
    a = np.exp(-BLOCK / seconds)
    return lfilter([np.sqrt(1 - a * a)], [1.0, -a], x)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("seconds", [0.001, 0.02, 0.03])
def test_noise_behind_the_low_pass_of_a_sensor_is_noise(seconds: float, seed: int) -> None:
    assert is_noise(1.7 * low_pass(white(seed), seconds), LOG)


@pytest.mark.parametrize("seed", range(5))
def test_what_lasts_swings_or_comes_and_goes_is_not(seed: int) -> None:
    t = BLOCK * np.arange(len(LOG))
    assert not is_noise(white(seed) + low_pass(white(seed + 100), 0.3), LOG)  # gusts
    assert not is_noise(white(seed) + 1.2 * np.sin(2 * np.pi * 5.5 * t), LOG)  # an axle
    assert not is_noise(white(seed) * np.where(np.sin(0.4 * t) > 0.5, 3.0, 1.0), LOG)  # where something is done


@pytest.mark.parametrize("seed", range(5))
def test_a_walk_of_the_bias_is_taken_out_and_little_else(seed: int) -> None:
    step = 0.05
    walk = np.concatenate([np.cumsum(step * white(seed + 10 + i)[:750]) for i in range(4)])
    rest = without_walk(white(seed) + walk, LOG, step)
    assert np.sqrt(np.mean(rest**2)) < 1.05
    swing = np.sin(2 * np.pi * 0.5 * BLOCK * np.arange(len(LOG)))
    assert np.sqrt(np.mean(without_walk(swing, LOG, step) ** 2)) > 0.85 * np.sqrt(np.mean(swing**2))


def test_a_bias_that_stays_is_no_walk() -> None:
    np.testing.assert_array_equal(without_walk(white(1), LOG, 0.0), white(1))


def test_lone_spikes_go_and_what_lasts_two_blocks_stays() -> None:
    x = white(3)
    spiked = x.copy()
    spiked[[100, 800, 1600]] += 15.0
    spiked[2000:2003] += 15.0
    rest = without_spikes(spiked, LOG)
    assert np.abs(rest[[100, 800, 1600]]).max() < 3.0
    np.testing.assert_array_equal(rest[2000:2003], spiked[2000:2003])
    assert np.mean(rest != spiked) < 0.005
