"""What goes wrong with a log. Each function changes the rows in place and returns which of them it made unusable."""

from __future__ import annotations

import numpy as np

from tse.impl.core import Config
from tse.impl.rows import MEASURES

LENGTHS = (0.1, 0.5, 2.0, 5.0)  # s, of a dropout or a stuck channel
FIRST, SLOT, JITTER = 15.0, 20.0, 2.0  # s: one corruption in each slot, and time to judge what it left
SLOTS_END = FIRST + SLOT * len(LENGTHS)


def _stretches(time: np.ndarray, rng: np.random.Generator) -> list[tuple[int, int]]:
    """Rows [a, b) of one corruption of each length, in random order at random times."""
    found = []
    for slot, length in enumerate(rng.permutation(LENGTHS)):
        start = FIRST + SLOT * slot + rng.uniform(0, JITTER)
        a, b = np.searchsorted(time, [start, start + length])
        found.append((int(a), int(b)))
    return found


def dropout(time: np.ndarray, rows: np.ndarray, rng: np.random.Generator, channel: str) -> np.ndarray:
    """The channel is missing for 0.1, 0.5, 2 and 5 s."""
    corrupted = np.zeros(len(time), bool)
    for a, b in _stretches(time, rng):
        rows[channel][a:b] = np.nan
        corrupted[a:b] = True
    return corrupted


def stuck(time: np.ndarray, rows: np.ndarray, rng: np.random.Generator, channel: str) -> np.ndarray:
    """The channel repeats its last value for 0.1, 0.5, 2 and 5 s."""
    corrupted = np.zeros(len(time), bool)
    for a, b in _stretches(time, rng):
        rows[channel][a:b] = rows[channel][a - 1]
        corrupted[a:b] = True
    return corrupted


def pause(time: np.ndarray, rows: np.ndarray, rng: np.random.Generator, at: float, length: float) -> np.ndarray:
    """The row at `at` says that it comes `length` after the one before: a logger that slept. The car is as it was."""
    rows["dt"][np.searchsorted(time, at - 1e-9)] = length
    return np.zeros(len(time), bool)


def outliers(time: np.ndarray, rows: np.ndarray, rng: np.random.Generator, share: float, sigmas: float) -> np.ndarray:
    """Single samples of the inertial channels are far off. An estimator has to live with them: no row is unusable."""
    default = Config()
    for channel in MEASURES:
        hit = rng.random(len(time)) < share
        sign = rng.choice([-1.0, 1.0], len(time))
        rows[channel] += np.where(hit, sign * sigmas * getattr(default, f"{channel}_sd"), 0.0)
    return np.zeros(len(time), bool)
