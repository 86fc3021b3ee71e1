"""Slope of the road over distance: sums of sines with random phases, hence smooth and without a period in a log."""

from __future__ import annotations

import numpy as np

WAVES = 6
LENGTHS = {"grade": (120.0, 900.0), "bank": (80.0, 500.0)}  # m, wave lengths


def profile(rng: np.random.Generator, rms: float, mean: float, lengths: tuple[float, float]) -> np.ndarray:
    """Rows amplitude, wave number, phase of one profile; the constant is a wave without a wave number."""
    amplitude = rng.uniform(0.5, 1.5, WAVES)
    amplitude *= rms * np.sqrt(2) / np.sqrt((amplitude**2).sum())
    number = 2 * np.pi / np.exp(rng.uniform(*np.log(lengths), WAVES))
    phase = rng.uniform(0, 2 * np.pi, WAVES)
    return np.array([[*amplitude, mean], [*number, 0.0], [*phase, 0.5 * np.pi]])


def slope(waves: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Angle of slope at distance s, rad. `waves`: (3, waves, cars)."""
    return (waves[0] * np.sin(waves[1] * s + waves[2])).sum(0)
