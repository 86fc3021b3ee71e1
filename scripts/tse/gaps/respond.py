"""Compute how a disturbance at one place of the model changes the simulated channels. A
place is a quantity of the model to which a disturbance is added, such as the yaw moment.
The disturbances are the values of formulas (formula_search.py), or hat functions of time
(where.py). Many disturbances are computed at once.

The single-track model is linearised about straight driving at the current speed, and
integrated with one step per block, i.e. per interval of 40 ms over which signals are
averaged. This is accurate enough to compare disturbances with each other. The formula
search then simulates the best formulas with the full model.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.linalg import expm

from tse.gaps.problem import Problem
from tse.identify.data import BLOCK_TIME, MIN_FIT_SPEED
from tse.library.core import Config

# Place of a disturbance that is the lateral component of gravity [m/s2] on a banked road.
# It accelerates the car sideways, but accelerometers do not measure it. A formula cannot
# be added at this place.
ROAD_BANK = "bank"
# quantities of the simulation that compute_signals() uses
SIMULATED = ("vel_x", "vel_y", "true_yaw_rate", "accel_x", "accel_y")


def compute_signals(problem: Problem, values: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
    """Return the signals that formulas may use, as one dict for each log: name of the
    signal in formulas -> array with one value for each block. The dict also has the time
    of each block, `time` [s], and the time since the previous block, `dt` [s].

    The signals are computed from inputs and simulation, not from measurements.
    """
    c, rows = problem.make_config(values), problem.rows
    simulated = problem.simulate_channels(values, SIMULATED)
    steer = problem.average_quantity("steer_angle")
    wheels = {
        a: problem.average_quantity(f"wheel_speed_{a}") * getattr(c, f"wheel_radius_{a}")
        for a in ("front", "rear")
    }
    found = []
    for i in range(len(problem.logs)):
        first = rows.group[rows.log == i].min() if (rows.log == i).any() else -1
        mine = rows.group == first
        s = {n: _fill_gaps(x[mine]) for n, x in simulated.items()}
        s["yaw_rate"] = s.pop("true_yaw_rate")
        s["steer_angle"] = _fill_gaps(steer[mine])
        v = np.maximum(s["vel_x"], MIN_FIT_SPEED)
        s["slip_angle_front"] = s["steer_angle"] - (s["vel_y"] + c.lf * s["yaw_rate"]) / v
        s["slip_angle_rear"] = (c.lr * s["yaw_rate"] - s["vel_y"]) / v
        for a in ("front", "rear"):
            s[f"slip_{a}"] = _fill_gaps(wheels[a][mine]) / v - 1.0
        time = rows.time[mine].astype(float)
        s["time"] = time
        s["dt"] = np.clip(np.diff(time, prepend=time[0] - BLOCK_TIME), 0.01, 1.0)
        found.append(s)
    return found


def _fill_gaps(x: np.ndarray) -> np.ndarray:
    """Return a signal whose missing blocks (NaN) are interpolated linearly."""
    bad = ~np.isfinite(x)
    if bad.any() and not bad.all():
        x = x.copy()
        x[bad] = np.interp(np.flatnonzero(bad), np.flatnonzero(~bad), x[~bad])
    return np.nan_to_num(x)


def compute_responses(
    problem: Problem,
    values: Mapping[str, float],
    at: list[dict[str, np.ndarray]],
    place: str,
    forms: list[np.ndarray],
) -> np.ndarray:
    """Return how the whitened residuals change if a form acts as a disturbance at
    `place`, for each of several forms. A form is a formula without its coefficient.

    The result has a row for each residual and a column for each form. `values` are the
    fitted parameters, and `at` is the result of compute_signals(). `place` is the
    quantity of the model to which the disturbance is added, such as "yaw_moment". `forms`
    has one array for each log, with the shape (blocks, forms). It contains the values of
    the forms in each block of 40 ms, in the unit of the disturbance.
    """
    c, rows = problem.make_config(values), problem.rows
    change = np.zeros((len(rows.log), forms[0].shape[1]))
    for i, (s, u) in enumerate(zip(at, forms, strict=True)):
        for channel, x in _move_simulation(c, problem.get_stiffness_ratios(values), s, place, u).items():
            mine = (rows.log == i) & rows.of(channel)
            if mine.any():
                change[mine] = x
    white = np.empty_like(change)
    for j in range(change.shape[1]):
        white[:, j] = problem.whiten(-change[:, j])
    return white


def _move_simulation(
    c: Config, k: Mapping[str, float], s: Mapping[str, np.ndarray], place: str, u: np.ndarray
) -> dict[str, np.ndarray]:
    """Return how disturbances `u` at the quantity `place` of the model change the
    simulated channels of one log. The result is a dict: channel -> array of the shape of
    `u`, (blocks, disturbances).

    `k` has the ratio of each stiffness to its value in `c`. `s` has the signals of the
    log from compute_signals().
    """
    if place in ("accel_x", "accel_y", "yaw_rate"):
        return {place: u}
    v, m = np.maximum(s["vel_x"], MIN_FIT_SPEED), c.mass
    # row i: mean of each disturbance over the time from block i - 1 to block i
    mean = np.concatenate([u[:1], 0.5 * (u[1:] + u[:-1])])
    if place == "force_x":
        # u is the disturbance [m/s2], x the change of the car's speed that it causes. The
        # wheel speeds are prescribed, so x changes the slip by -x / v. The tyre force of
        # this slip counteracts the change: dx/dt = u - along x / (m v). `along` is the
        # sum of the longitudinal stiffnesses of both axles.
        along = (c.longitudinal_stiffness_front + c.longitudinal_stiffness_rear) * k["cx_front"]
        x, out = np.zeros(u.shape[1]), np.empty_like(u)
        keep = np.exp(-along / (m * v) * s["dt"])
        for n in range(len(u)):
            x = keep[n] * x + (1.0 - keep[n]) * (m * v[n] / along) * mean[n]
            out[n] = u[n] - along / (m * v[n]) * x
        return {"accel_x": out}
    front, rear = c.cornering_stiffness_front * k["cy_front"], c.cornering_stiffness_rear * k["cy_rear"]
    turn, square = c.lf * front - c.lr * rear, c.lf**2 * front + c.lr**2 * rear
    across, turning = {  # lateral [m/s2] and yaw acceleration [rad/s2] that a disturbance of 1 causes
        "front_angle": (front / m, c.lf * front / c.yaw_inertia),
        "rear_angle": (rear / m, -c.lr * rear / c.yaw_inertia),
        "force_y": (1.0, 0.0),
        "yaw_moment": (0.0, 1.0),
        ROAD_BANK: (1.0, 0.0),
    }[place]
    yv, yr = -(front + rear) / (m * v), -turn / (m * v)
    a = np.zeros((len(v), 3, 3))
    a[:, 0, 0], a[:, 0, 1], a[:, 0, 2] = yv, yr - v, across
    a[:, 1, 0], a[:, 1, 1], a[:, 1, 2] = -turn / (c.yaw_inertia * v), -square / (c.yaw_inertia * v), turning
    f = expm(a * s["dt"][:, None, None])
    # The lateral component of gravity on a banked road accelerates the car, but
    # accelerometers do not measure it.
    felt = 0.0 if place == ROAD_BANK else across
    x, y, r = np.zeros((2, u.shape[1])), np.empty_like(u), np.empty_like(u)
    for n in range(len(u)):
        x = f[n, :2, :2] @ x + f[n, :2, 2:] * mean[n]
        y[n] = yv[n] * x[0] + yr[n] * x[1] + felt * u[n]
        r[n] = x[1]
    return {"accel_y": y, "yaw_rate": r}
