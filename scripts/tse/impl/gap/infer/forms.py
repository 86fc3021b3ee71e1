"""How what an effect does may differ from its form in the catalogue: to first order, a share of it, of its rate and of the rate of
that, each also in proportion to what the car does (Kennedy & O'Hagan 2001); and where it makes tyres act later, those of one axle
may do so more than those of the other. A filler that repairs the form of another effect is one way among these, and explains no
more than they do. Without this the study's relaxation-1x-1 gets rear_roll_steer beside relaxation.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tse.impl.gap.problem import Problem
from tse.impl.identify.data import BLOCK

SD = 0.05  # shares: so well forms are known
LAG = 0.03  # s: sd: so well is known how late an effect acts
# sd: of how late an effect makes tyres act, so much those of one axle differ: a relaxation length is stiffness of
# tread over carcass, and axles differ in load, pressure and tyres as their stiffness does
APART = 0.3
RATE_TIME = 0.1  # s: by which rates are multiplied: of motions of 1.6 Hz as large as what they are rates of
FAST = 20.0  # m/s: of a modulator that is about 1 where a driver goes hard
ALONG = 3.0  # m/s2: the same
ACROSS = 4.0  # m/s2: the same
STEERED = 0.05  # rad: the same
RATES = ("", "'", "''")
LATERAL = ("", " v", " |ay|", " ax", " |steer|")
LONGITUDINAL = ("", " v", " |ax|", " ax", " |ay|")
AXLES = "axles"  # shapes of all channels at once, one for each stiffness (space.py)
BY = {"accel_y": LATERAL, "yaw_rate": LATERAL, "accel_x": LONGITUDINAL}


def names(channel: str) -> list[str]:
    """The shapes of a channel."""
    return [f"{rate}{by}" for rate in RATES for by in BY.get(channel, ())]


def sd(name: str) -> float:
    """Prior sd of the share of a shape."""
    return LAG / RATE_TIME if name.startswith("'") else SD


def modulators(problem: Problem, values: Mapping[str, float]) -> dict[str, np.ndarray | float]:
    """What shapes are in proportion to, a value per entry of the residual vector, about 1 where a driver goes hard."""
    state = problem.channels(values, ("accel_x", "accel_y", "vel_x"))
    steer = np.nan_to_num(problem.quantity("steer_angle")) / STEERED
    along, across, fast = state["accel_x"] / ALONG, state["accel_y"] / ACROSS, state["vel_x"] / FAST - 1.0
    return {"": 1.0, " v": fast, " ax": along, " |ax|": np.abs(along), " |ay|": np.abs(across), " |steer|": np.abs(steer)}


def of(problem: Problem, signal: np.ndarray, by: Mapping[str, np.ndarray | float], channel: str) -> np.ndarray:
    """The shapes of a signal, a value per entry of the residual vector, a column for each of names()."""
    bases = [signal]
    for _ in RATES[1:]:
        bases.append(RATE_TIME * rate(problem, bases[-1]))
    return np.nan_to_num(np.column_stack([b * by[k] for b in bases for k in BY[channel]]))


def rate(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Per s, of a quantity that is given for every entry of the residual vector; 0 where blocks do not follow each other."""
    rows = problem.rows
    follows = (np.diff(rows.group) == 0) & (np.diff(rows.time.astype(float)) < 1.5 * BLOCK)
    step = np.where(follows, np.diff(x), 0.0) / BLOCK
    ahead, behind = np.append(step, 0.0), np.append(0.0, step)
    count = np.append(follows, False).astype(float) + np.append(False, follows)
    return (ahead + behind) / np.maximum(count, 1.0)
