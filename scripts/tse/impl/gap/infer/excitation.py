"""What a set of logs excites, against what naming wants: sweep to 3 Hz, ramps or steps to 5-6 m/s2, braking in a turn, two
speeds, steps of brake and throttle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from tse.impl.gap.problem import Problem
from tse.impl.identify.data import BLOCK

FAST = 1.5  # Hz: steering above it is the upper part of a sweep
FAST_STEER = 0.003  # rad: rms of it that counts
HIGH_ACCEL = 4.5  # m/s2: 99 % of |accel_y| that a log with 5 to 6 m/s2 has
BRAKING = 1.5  # m/s2: at least, of braking in a turn
TURNING = 1.5  # m/s2: at least, of a turn in which it is braked
STEERED = 1.0  # m/s2: of accel_y from which it is steered
APART = 1.5  # ratio of the faster to the slower speed at which it is steered
JUMP = 2.0  # m/s2: within JUMP_TIME, of a step of brake or throttle
JUMP_TIME = 0.6  # s: of such a step
LEAST_SECONDS = 2.0  # s: of a manoeuvre that are enough
LEAST_JUMPS = 3  # steps of brake and throttle that are enough


@dataclass(frozen=True)
class Excitation:
    """One manoeuvre that is wanted: what there is of it, and whether that is enough."""

    title: str
    found: str
    enough: bool
    advice: str


def excitation(problem: Problem, values: dict[str, float]) -> list[Excitation]:
    """Every manoeuvre that naming wants, from steering, wheel speeds and the simulation."""
    speed, ax, ay, jumps, fast = [], [], [], 0, []
    state = problem.channels(values, ("vel_x", "accel_x", "accel_y"))
    angle = problem.quantity("steer_angle")
    for i in range(len(problem.logs)):
        mine = (problem.rows.log == i) & problem.rows.of("yaw_rate")
        x = {k: v[mine] for k, v in state.items()}
        s = angle[mine]
        band = butter(2, FAST, "highpass", fs=1 / BLOCK, output="sos")
        high = sosfiltfilt(band, s) if len(s) > 30 else np.zeros_like(s)
        fast.append(np.sqrt(np.convolve(high**2, np.ones(25) / 25, mode="same")))
        n = round(JUMP_TIME / BLOCK)
        rise = np.abs(x["accel_x"][n:] - x["accel_x"][:-n]) > JUMP if len(s) > n else np.zeros(0, bool)
        jumps += int((np.diff(rise.astype(int), prepend=0) == 1).sum())
        speed.append(x["vel_x"])
        ax.append(x["accel_x"])
        ay.append(x["accel_y"])
    v, long, lat, quick = (np.concatenate(p) for p in (speed, ax, ay, fast))
    sweep = BLOCK * float((quick > FAST_STEER).sum())
    top = float(np.quantile(np.abs(lat), 0.99))
    both = BLOCK * float(((long < -BRAKING) & (np.abs(lat) > TURNING)).sum())
    active = np.abs(lat) > STEERED
    slow, quickest = (float(q) for q in np.quantile(v[active], [0.1, 0.9])) if active.any() else (0.0, 0.0)
    return [
        Excitation("steering to 3 Hz", f"{sweep:.0f} s above {FAST:g} Hz", sweep >= LEAST_SECONDS,
                   "sine sweep or quick steps of the steering up to 3 Hz, 2-3 m/s2"),
        Excitation("lateral acceleration of 5-6 m/s2", f"up to {top:.1f} m/s2", top >= HIGH_ACCEL,
                   "slow ramps or steps of the steering to 5-6 m/s2"),
        Excitation("braking in a turn", f"{both:.0f} s", both >= LEAST_SECONDS,
                   "braking and accelerating with 3-4 m/s2 in a turn of 3-4 m/s2"),
        Excitation("steering at two speeds", f"{slow:.0f} .. {quickest:.0f} m/s", slow > 0 and quickest > APART * slow,
                   "the same steering at half and at twice the speed"),
        Excitation("steps of brake and throttle", f"{jumps}", jumps >= LEAST_JUMPS,
                   "steps of brake and throttle of 2-4 m/s2, straight on"),
    ]  # fmt: skip
