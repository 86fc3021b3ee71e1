"""Tyres of one wheel each: magic formula, load sensitivity, combined slip (Pacejka, Tire and Vehicle Dynamics, ch. 4)."""

from __future__ import annotations

import numpy as np

LATERAL_C, LONGITUDINAL_C = 1.35, 1.6  # shape factors of the magic formula
COMBINED_C = 1.1  # of the weighting of side force by longitudinal slip
TRAIL_B, TRAIL_C = 8.0, 1.1  # of the pneumatic trail
DEGRESSIVE = 0.5  # static load over the load at which cornering stiffness is largest


def magic_formula(slip: np.ndarray, stiffness: np.ndarray, peak: np.ndarray, c: float, e: np.ndarray) -> np.ndarray:
    """Force at a slip; `stiffness` is its slope at zero, `peak` its largest value."""
    x = stiffness / (c * peak) * slip
    return peak * np.sin(c * np.arctan(x - e * (x - np.arctan(x))))


def load_factor(load: np.ndarray, ratio: float = DEGRESSIVE) -> np.ndarray:
    """Cornering stiffness over that at static load; `load` relative to static: sin(2 atan(Fz/Fz_max)), normalised."""
    return load * (1 + ratio**2) / (1 + (ratio * load) ** 2)


def side_force_weight(slip: np.ndarray, b: np.ndarray) -> np.ndarray:
    """What longitudinal slip leaves of the side force."""
    return np.cos(COMBINED_C * np.arctan(b * slip))


def trail_weight(slip_angle: np.ndarray) -> np.ndarray:
    """Pneumatic trail over that at zero slip angle."""
    return np.cos(TRAIL_C * np.arctan(TRAIL_B * slip_angle))
