"""Linear and other filters of signals at every step: (steps,) or (steps, signals)."""

import numpy as np

from .model import STEP

BESSEL = (3.0, 3.0)  # s^2 T^2 + 3 s T + 3: second order, group delay T


def second_order(x: np.ndarray, w: float, z: float) -> np.ndarray:
    """w^2/(s^2 + 2 z w s + w^2), by the exact transition of the step with the input linear in between."""
    a = np.array([[0.0, 1.0], [-(w**2), -2 * z * w]])
    block = np.zeros((4, 4))  # x, dx, input, slope of the input
    block[:2, :2], block[1, 2], block[2, 3] = a, w**2, 1.0
    phi = _expm(block * STEP)[:2]
    y = np.empty_like(x, dtype=float)
    y[0], rate = x[0], 0.0 * x[0]
    for i in range(len(x) - 1):
        slope = (x[i + 1] - x[i]) / STEP
        y[i + 1] = phi[0, 0] * y[i] + phi[0, 1] * rate + phi[0, 2] * x[i] + phi[0, 3] * slope
        rate = phi[1, 0] * y[i] + phi[1, 1] * rate + phi[1, 2] * x[i] + phi[1, 3] * slope
    return y


def bessel(x: np.ndarray, delay: float) -> np.ndarray:
    """Two-pole Bessel low-pass."""
    w = np.sqrt(BESSEL[1]) / delay
    return second_order(x, w, BESSEL[0] / (2 * np.sqrt(BESSEL[1])))


def delayed(x: np.ndarray, delay: float) -> np.ndarray:
    """Pure delay, also of a fraction of a step; before the start the first value."""
    at = np.arange(len(x)) - delay / STEP
    return np.interp(at, np.arange(len(x)), x)


def backlash(x: np.ndarray, half: float) -> np.ndarray:
    """What follows x through a play of +-half."""
    y = np.empty_like(x)
    last = x[0]
    for i, value in enumerate(x.tolist()):
        last = min(max(last, value - half), value + half)
        y[i] = last
    return y


def sticking(x: np.ndarray, threshold: float) -> np.ndarray:
    """A sensor that stays until it is `threshold` off, then jumps to the value."""
    y = np.empty_like(x)
    last = x[0]
    for i, value in enumerate(x.tolist()):
        if abs(value - last) > threshold:
            last = value
        y[i] = last
    return y


def _expm(a: np.ndarray) -> np.ndarray:
    total, term = np.eye(len(a)), np.eye(len(a))
    for n in range(1, 30):
        term = term @ a / n
        total = total + term
    return total
