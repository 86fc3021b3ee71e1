"""What a disturbance at a place does to the channels, for many at once: the single-track model linearised about straight driving at
the speed of each moment, one step a block. Good enough to choose what is then simulated in full."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.linalg import expm

from tselab.gap.data import BLOCK, SLOWEST
from tselab.gap.problem import Problem
from tselab.gap.singletrack import SingleTrack

SIMULATED = ("vel_x", "vel_y", "true_yaw_rate", "accel_x", "accel_y")


def signals(problem: Problem, values: Mapping[str, float]) -> list[dict[str, np.ndarray]]:
    """Of each log, a value a block: what forms are made of, from inputs and simulation, by their names in formulas; and dt, s."""
    c, rows = problem.model(values), problem.rows
    simulated = problem.channels(values, SIMULATED)
    steer = problem.quantity("steer_angle")
    wheels = {a: problem.quantity(f"wheel_speed_{a}") * getattr(c, f"wheel_radius_{a}") for a in ("front", "rear")}
    found = []
    for i in range(len(problem.logs)):
        first = rows.group[rows.log == i].min() if (rows.log == i).any() else -1
        mine = rows.group == first
        s = {n: _filled(x[mine]) for n, x in simulated.items()}
        s["yaw_rate"] = s.pop("true_yaw_rate")
        s["steer_angle"] = _filled(steer[mine])
        v = np.maximum(s["vel_x"], SLOWEST)
        s["slip_angle_front"] = s["steer_angle"] - (s["vel_y"] + c.lf * s["yaw_rate"]) / v
        s["slip_angle_rear"] = (c.lr * s["yaw_rate"] - s["vel_y"]) / v
        for a in ("front", "rear"):
            s[f"slip_{a}"] = _filled(wheels[a][mine]) / v - 1.0
        time = rows.time[mine].astype(float)
        s["time"] = time
        s["dt"] = np.clip(np.diff(time, prepend=time[0] - BLOCK), 0.01, 1.0)
        found.append(s)
    return found


def _filled(x: np.ndarray) -> np.ndarray:
    """Blocks without a value get their neighbours'."""
    bad = ~np.isfinite(x)
    if bad.any() and not bad.all():
        x = x.copy()
        x[bad] = np.interp(np.flatnonzero(bad), np.flatnonzero(~bad), x[~bad])
    return np.nan_to_num(x)


def responses(
    problem: Problem, values: Mapping[str, float], at: list[dict[str, np.ndarray]], place: str, forms: list[np.ndarray]
) -> np.ndarray:
    """What a unit of each form at this place changes of the whitened residuals, shape (entries, forms).

    `at`: signals(); `forms`: of each log, shape (blocks, forms), in the unit of the place."""
    c, rows = problem.model(values), problem.rows
    change = np.zeros((len(rows.log), forms[0].shape[1]))
    for i, (s, u) in enumerate(zip(at, forms, strict=True)):
        k = problem.stiffness(values, i)
        along = (c.longitudinal_stiffness_front + c.longitudinal_stiffness_rear) * k["cx_front"]
        moved = _moved(SingleTrack.of(c, k), along, s, place, u)
        for channel, x in moved.items():
            mine = (rows.log == i) & rows.of(channel)
            if mine.any():
                change[mine] = x
    white = np.empty_like(change)
    for j in range(change.shape[1]):
        white[:, j] = problem.whiten(-change[:, j])
    return white


def _moved(
    car: SingleTrack, along: float, s: Mapping[str, np.ndarray], place: str, u: np.ndarray
) -> dict[str, np.ndarray]:
    if place in ("accel_x", "accel_y", "yaw_rate"):
        return {place: u}
    v, m = np.maximum(s["vel_x"], SLOWEST), car.mass
    if place == "force_x":  # the wheels hold the speed: v' = u - along v/(m v)
        x, out = np.zeros(u.shape[1]), np.empty_like(u)
        keep = np.exp(-along / (m * v) * s["dt"])
        for n in range(len(u)):
            x = keep[n] * x + (1.0 - keep[n]) * (m * v[n] / along) * 0.5 * (u[n] + u[n - 1] if n else u[n])
            out[n] = u[n] - along / (m * v[n]) * x
        return {"accel_x": out}
    across, turning = {
        "front_angle": car.pushed(car.front, car.lf),
        "rear_angle": car.pushed(car.rear, -car.lr),
        "force_y": (1.0, 0.0),
        "yaw_moment": (0.0, 1.0),
    }[place]
    yv, yr = car.side(v)
    a = np.zeros((len(v), 3, 3))
    car.fill(a, v, across, turning)
    f = expm(a * s["dt"][:, None, None])  # the input is its mean over the step
    x, y, r = np.zeros((2, u.shape[1])), np.empty_like(u), np.empty_like(u)
    for n in range(len(u)):
        x = f[n, :2, :2] @ x + f[n, :2, 2:] * (0.5 * (u[n] + u[n - 1]) if n else u[n])
        y[n] = yv[n] * x[0] + yr[n] * x[1] + across * u[n]
        r[n] = x[1]
    return {"accel_y": y, "yaw_rate": r}
