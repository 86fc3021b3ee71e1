"""Find where simulation and measurement disagree: under which conditions of driving the
residual of a channel is large, and at which place of the model a disturbance explains the
residuals of accel_y and yaw_rate best. A place is a quantity of the model to which a
disturbance can be added, such as the slip angle of the front axle (PLACES).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import false_discovery_control, spearmanr

from tse.gaps.fit import Fit
from tse.gaps.problem import Problem
from tse.gaps.respond import ROAD_BANK, compute_responses, compute_signals
from tse.identify.data import BLOCK_TIME
from tse.library.core import library

RESIDUAL_WINDOW_TIME = 1.0  # [s] length of the windows in which the mean square of a residual is computed
# max expected share of reported conditions that are due to chance (Benjamini-Hochberg)
FALSE_DISCOVERIES = 0.01
# min |rank correlation| between a signal and the mean square of the residual, for which
# "high" or "low" values of the signal are reported as a condition
MIN_CORRELATION = 0.15
# min number of windows (RESIDUAL_WINDOW_TIME) with residuals of a channel, for which
# conditions of this channel are reported
MIN_WINDOWS = 20
# Max squared correlation between the bank of the road, estimated as a disturbance, and
# the car's lateral acceleration. If it is larger, the disturbance follows the motion of
# the car. So it comes from the car, not from the road, and the bank is ranked last.
MAX_FOLLOWED = 0.5
# [blocks of BLOCK_TIME] Time between the points at which a disturbance is estimated.
# Between two points it is interpolated linearly, so it is a sum of triangular functions
# (hats).
HAT = 10
# name of a place in the report -> argument `place` of compute_responses()
PLACES = {
    "front axle": "front_angle",
    "rear axle": "rear_angle",
    "side force": "force_y",
    "yaw moment": "yaw_moment",
    "road (bank)": ROAD_BANK,
    "sensor accel_y": "accel_y",
    "sensor yaw_rate": "yaw_rate",
}


@dataclass(frozen=True)
class Condition:
    """A condition of driving under which the residual of a channel is large."""

    channel: str
    condition: str  # for example "high speed"
    strength: float  # rank correlation of the signal with the mean square of the residual


@dataclass(frozen=True)
class Entry:
    """A place of the model (PLACES), and how well a disturbance there explains the
    residuals of accel_y and yaw_rate.
    """

    place: str
    nats: float  # [nat] ln of the Bayes factor of a disturbance at this place against none
    share: float  # share of the sum of squared residuals that the disturbance explains
    size: float  # sd of the disturbance, in `unit`
    unit: str


def compute_features(problem: Problem, values: dict[str, float]) -> dict[str, np.ndarray]:
    """Return the signals whose high or low values can be a condition under which a
    residual is large (Condition). The result is a dict: name -> array of means
    over blocks of BLOCK_TIME, with one element for each element of the residual vector.
    The signals come from inputs and simulation.

    No measurement is used as a signal. A residual contains the noise of its measurement,
    so the two would be correlated even if the model were perfect.
    """
    predicted = problem.simulate_channels(values, ("accel_x", "accel_y", "vel_x"))
    steer = problem.average_quantity("steer_angle")
    front = problem.average_quantity("wheel_speed_front") * problem.config.wheel_radius_front
    rate = np.gradient(steer) / BLOCK_TIME
    return {
        "speed": predicted["vel_x"],
        "|accel_y|": np.abs(predicted["accel_y"]),
        "|accel_x|": np.abs(predicted["accel_x"]),
        "|steering angle|": np.abs(steer),
        "|steering rate|": np.abs(rate),
        "|slip|": np.abs(front / np.maximum(predicted["vel_x"], 1.0) - 1.0),
        "time": problem.rows.time.astype(float),
    }


def find_conditions(problem: Problem, residuals: np.ndarray, values: dict[str, float]) -> list[Condition]:
    """Return the conditions under which the residual is large, the strongest first.

    They are found by Spearman's rank correlation between a signal and the mean square of
    the residual in windows. Conditions that may be due to chance are removed by the
    procedure of Benjamini and Hochberg.
    """
    rows, found, p = problem.rows, [], []
    at = compute_features(problem, values)
    for c, mine in problem.used():
        key = rows.log[mine] * 10_000_000 + (rows.time[mine] // RESIDUAL_WINDOW_TIME).astype(np.int64)
        _, index, count = np.unique(key, return_inverse=True, return_counts=True)
        enough = count >= 0.5 * count.max(initial=0)
        if enough.sum() < MIN_WINDOWS:
            continue
        energy, *table = (
            (np.bincount(index, x) / count)[enough]
            for x in (residuals[mine] ** 2, *(np.nan_to_num(x[mine]) for x in at.values()))
        )
        for name, x in zip(at, table, strict=True):
            if np.ptp(x) > 1e-9 * (1 + np.abs(x).max()):
                rho, chance = spearmanr(x, energy)
                found.append(Condition(c, f"{'high' if rho > 0 else 'low'} {name}", float(rho)))
                p.append(max(float(chance), 1e-300))
    kept = false_discovery_control(p) < FALSE_DISCOVERIES if p else ()
    found = [c for c, k in zip(found, kept, strict=True) if k and abs(c.strength) >= MIN_CORRELATION]
    return sorted(found, key=lambda c: -abs(c.strength))


def find_entries(problem: Problem, last: Fit) -> list[Entry]:
    """Return each place of PLACES with the evidence for a disturbance there, the best
    place first.

    A disturbance is a sum of triangular functions (hats), one every HAT blocks. The
    amplitudes of the hats are unknown and have a normal prior with mean 0. Several prior
    sds are tried, and the one with the largest evidence is used. The parameters of `last`
    are unknown as well: the part of the residuals that they could explain is projected
    out.

    The residuals are linear in the amplitudes, and prior and noise are normal. So the ln
    evidence has a closed form: a sum with one term for each singular value of the matrix
    of responses to the hats (compute_responses()).
    """
    at, units = compute_signals(problem, last.values), library().formula_places
    lateral = [
        (problem.rows.log == i) & (problem.rows.of("accel_y") | problem.rows.of("yaw_rate"))
        for i in range(len(at))
    ]
    there = [i for i, log in enumerate(problem.logs) if {"accel_y", "yaw_rate"} <= set(log.channels)]
    if not there:
        return []
    hats = [
        np.maximum(
            0.0, 1.0 - np.abs(np.arange(len(s["dt"]))[:, None] / HAT - np.arange(len(s["dt"]) // HAT + 2))
        )
        for s in at
    ]
    widest = max(h.shape[1] for h in hats)
    hats = [np.pad(h, ((0, 0), (0, widest - h.shape[1]))) for h in hats]
    found = []
    for place, id_ in PLACES.items():
        change = compute_responses(problem, last.values, at, id_, hats)
        # Project the part that the fitted parameters could explain out of responses and
        # residuals. For each log, `parts` then has: singular values and right singular
        # vectors of the responses; components, along the left singular vectors, of the
        # residuals with opposite sign, because the responses must cancel the residuals;
        # sum of squared residuals.
        parts = []
        for i in there:
            q, _ = np.linalg.qr(last.jacobian[lateral[i]])
            own, r = (x - q @ (q.T @ x) for x in (change[lateral[i]], last.residuals[lateral[i]]))
            u, s, v = np.linalg.svd(own, full_matrices=False)
            parts.append((s, v, -(u.T @ r), float(r @ r)))
        unit = np.sqrt(
            sum(map(np.count_nonzero, lateral)) / max(sum(float(s @ s) for s, *_ in parts), 1e-300)
        )
        sizes = unit * 2.0 ** np.arange(-3, 6)

        def compute_nats(size: float, parts: list = parts) -> float:
            shares = ((c, (size * s) ** 2) for s, _, c, _ in parts)
            return 0.5 * sum(float(np.sum(c * c * x / (1 + x) - np.log1p(x))) for c, x in shares)

        size = max(sizes, key=compute_nats)
        means = [v.T @ (size**2 * s / (1 + (size * s) ** 2) * c) for s, v, c, _ in parts]
        taken = sum(float(np.sum(c * c * (size * s) ** 2 / (1 + (size * s) ** 2))) for s, _, c, _ in parts)
        seen = np.concatenate([hats[i] @ x for i, x in zip(there, means, strict=True)])
        follows = (
            np.corrcoef(seen, np.concatenate([at[i]["accel_y"] for i in there]))[0, 1] ** 2
            if seen.any()
            else 0.0
        )
        # A disturbance that follows the lateral acceleration of the car comes from the
        # car, not from the bank of the road (MAX_FOLLOWED). So the bank is ranked last.
        last_of_all = id_ == ROAD_BANK and follows > MAX_FOLLOWED
        share = taken / max(sum(rr for *_, rr in parts), 1e-300)
        entry = Entry(
            place, compute_nats(size), share, float(size), "m/s2" if id_ == ROAD_BANK else units[id_].unit
        )
        found.append((last_of_all, -entry.nats, entry))
    return [e for *_, e in sorted(found, key=lambda x: x[:2])]
