"""A library of manoeuvres from which the next drive is planned. A manoeuvre consists of
noise-free inputs of the model: steering angle and wheel speeds.

The wheel speeds are those that the nominal car needs for the manoeuvre. Each axle rolls
along its own path through the bend. The slip of both axles provides a longitudinal force.
This force changes the speed, and balances the longitudinal component of the steered
wheels' side force.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import gaussian_filter1d

from tse.identify.data import BLOCK_TIME, BURN_IN, FitStretch, PreparedLog
from tse.library.core import Config, Replay
from tse.log.rows import DRIVES, MEASURES
from tse.simulation.maneuvers import compute_understeer, make_square

PLANNED_STEP = 0.01  # [s] time between the rows of a planned log
MANEUVER_TIME = 30.0  # [s] duration of a manoeuvre
# [s] sd of the Gaussian that smooths steps of steering and acceleration, because a driver
# cannot change them infinitely fast
HAND = 0.06
# Number of iterations in _compute_wheel_speeds(). Wheel speeds and lateral motion are
# computed in turn, because they depend on each other.
ROUNDS = 3


@dataclass(frozen=True)
class Candidate:
    """One manoeuvre, a candidate for the next drive. Its pieces are driven one after the
    other.
    """

    name: str
    # for each piece: arrays of steering angle [rad] and speed [m/s], with one value every
    # PLANNED_STEP seconds
    pieces: tuple[tuple[np.ndarray, np.ndarray], ...]

    @property
    def seconds(self) -> float:
        return sum(PLANNED_STEP * (len(steer) - 1) - BURN_IN for steer, _ in self.pieces)


def prepare_candidate(candidate: Candidate, config: Config) -> list[PreparedLog]:
    """Return a manoeuvre in the form of prepared logs, one for each piece. All
    measurements are 0; Problem.measure() later replaces them by simulated ones.
    """
    logs = []
    rows = round(BLOCK_TIME / PLANNED_STEP)
    for i, (steer, speed) in enumerate(candidate.pieces):
        n = len(steer) // rows * rows
        time = PLANNED_STEP * np.arange(n)
        inputs = {"steer_angle": steer[:n]} | _compute_wheel_speeds(config, steer[:n], speed[:n])
        assert set(inputs) == set(DRIVES)
        used = time >= BURN_IN
        noise = {c: getattr(config, f"{c}_sd") for c in MEASURES}
        distance = np.append(0.0, cumulative_trapezoid(speed[:n], dx=PLANNED_STEP))
        measured = {c: np.zeros(n) for c in MEASURES}
        name = Path(f"{candidate.name} {i + 1}")
        logs.append(
            PreparedLog(name, time, inputs, measured, noise, [FitStretch(0, n, used)], rows, distance)
        )
    return logs


def _compute_wheel_speeds(c: Config, steer: np.ndarray, speed: np.ndarray) -> dict[str, np.ndarray]:
    """Return the wheel speeds of the nominal car [rad/s] for a steering angle and a
    speed over time.

    The wheel speeds depend on the lateral motion, and the lateral motion on the wheel
    speeds. Both are found by iteration. The first iteration assumes no lateral motion.
    Each iteration computes wheel speeds from the lateral motion, and then simulates the
    model with these wheel speeds. The result is a more accurate lateral motion.
    """
    share, length = c.exact_kinematics_share, c.lf + c.lr
    # across: lateral velocity [m/s]; turning: yaw rate [rad/s]; side: lateral
    # acceleration [m/s2]
    across = turning = side = np.zeros(len(steer))
    for _ in range(ROUNDS):
        front = speed + share * (speed * (np.cos(steer) - 1.0) + (across + c.lf * turning) * np.sin(steer))
        # [N] side force of the steered front wheels
        steered = (c.lr * c.mass * side + c.yaw_inertia * np.gradient(turning, PLANNED_STEP)) / length
        braking = share * steered * np.sin(steer)  # [N] component of this force against the motion
        force = c.mass * (np.gradient(speed, PLANNED_STEP) - across * turning) + braking
        slip = np.clip(force / (c.longitudinal_stiffness_front + c.longitudinal_stiffness_rear), -0.05, 0.05)
        wheels = {
            "wheel_speed_front": front * (1.0 + slip) / c.wheel_radius_front,
            "wheel_speed_rear": speed * (1.0 + slip) / c.wheel_radius_rear,
        }
        model = Replay(
            ("vel_y", "true_yaw_rate", "accel_y"),
            dt=np.full(len(steer), PLANNED_STEP),
            steer_angle=steer,
            **wheels,
        )
        across, turning, side = model.run(c).values()
    return wheels


def make_candidates(config: Config) -> list[Candidate]:
    """Return all manoeuvres from which the next drive is planned, each at several speeds
    and amplitudes."""
    return list(_generate_candidates(config))


def _generate_candidates(c: Config) -> Iterator[Candidate]:
    t = np.arange(round(MANEUVER_TIME / PLANNED_STEP) + 1) * PLANNED_STEP
    short = np.arange(round(0.5 * MANEUVER_TIME / PLANNED_STEP) + 1) * PLANNED_STEP

    def steady(v: float, ay: float) -> float:
        """Return the steering angle [rad] with which the nominal car has the lateral
        acceleration `ay` [m/s2] in a steady turn at the speed `v` [m/s].
        """
        return ay * (c.lf + c.lr + compute_understeer(c) * v**2) / v**2

    def straight(time: np.ndarray) -> np.ndarray:
        return np.zeros(len(time))

    def at(v: float) -> Callable[[np.ndarray], np.ndarray]:
        return lambda time: np.full(len(time), v)

    def sweep(time: np.ndarray, v: float, ay: float) -> np.ndarray:
        low, high = 0.2, 3.0
        rate = np.log(high / low) / time[-1]
        return steady(v, ay) * np.sin(2 * np.pi * low * np.expm1(rate * time) / rate)

    def steps(time: np.ndarray, v: float, ay: float) -> np.ndarray:
        level = np.array([0.0, 1.0, 0.0, -1.0])[(time // 2.0).astype(int) % 4]
        return gaussian_filter1d(steady(v, ay) * level, HAND / PLANNED_STEP)

    def ramp(time: np.ndarray, v: float, ay: float) -> np.ndarray:
        return steady(v, ay) * np.interp(
            time, time[-1] * np.array([0, 0.45, 0.5, 0.95, 1.0]), [0, 1, 0, -1, 0]
        )

    def pulses(time: np.ndarray, v: float, depth: float) -> np.ndarray:
        """Return the speed [m/s] over time if the car alternately accelerates and brakes
        with `depth` [m/s2]. The mean speed is v, unless the speed would fall below
        3.5 m/s. It is then limited to 3.5 m/s.
        """
        acceleration = gaussian_filter1d(depth * make_square(time, 3.0), HAND / PLANNED_STEP)
        speed = v + cumulative_trapezoid(acceleration, dx=PLANNED_STEP, initial=0.0)
        return np.maximum(speed - speed.mean() + v, 3.5)

    for v in (10.0, 20.0, 30.0):
        for ay in (2.0, 4.0):
            yield Candidate(
                f"steering sine sweep 0.2 .. 3 Hz, {ay:g} m/s2, at {v:g} m/s", ((sweep(t, v, ay), at(v)(t)),)
            )
        for ay in (3.0, 6.0):
            yield Candidate(f"steering steps to {ay:g} m/s2, at {v:g} m/s", ((steps(t, v, ay), at(v)(t)),))
        yield Candidate(f"slow steering ramps to 6 m/s2, at {v:g} m/s", ((ramp(t, v, 6.0), at(v)(t)),))
        for f in (0.5, 1.0, 2.0):
            steer = steady(v, 2.5) * np.sin(2 * np.pi * f * t)
            yield Candidate(f"slalom of {f:g} Hz, at {v:g} m/s", ((steer, at(v)(t)),))
        for depth in (1.5, 3.0):
            yield Candidate(
                f"steps of brake and throttle, {depth:g} m/s2, straight, about {v:g} m/s",
                ((straight(t), pulses(t, v, depth)),),
            )
        turn = steady(v, 3.0) * make_square(t, 12.0)
        yield Candidate(
            f"brake and throttle of 3 m/s2 in turns of 3 m/s2, about {v:g} m/s",
            ((gaussian_filter1d(turn, 10 * HAND / PLANNED_STEP), pulses(t, v, 3.0)),),
        )
        yield Candidate(f"straight on at {v:g} m/s", ((straight(t), at(v)(t)),))
    for name, steer in (
        ("steering sine sweep 0.2 .. 3 Hz, 3 m/s2", sweep),
        ("steering steps to 4 m/s2", steps),
    ):
        pieces = tuple((steer(short, v, 3.0 if steer is sweep else 4.0), at(v)(short)) for v in (10.0, 30.0))
        yield Candidate(f"{name}, half at 10 and half at 30 m/s", pieces)
    tight = gaussian_filter1d(0.3 * make_square(t, 10.0), 10 * HAND / PLANNED_STEP)
    yield Candidate("tight turns of 0.3 rad at 5 m/s", ((tight, at(5.0)(t)),))
    speeds = 10.0 + 20.0 * t / t[-1]
    yield Candidate("straight on from 10 to 30 m/s", ((straight(t), speeds),))
