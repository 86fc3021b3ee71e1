"""Where simulation and measurement disagree: under which conditions the residual of a
channel is large, and at which place of the car a disturbance explains accel_y and
yaw_rate best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import false_discovery_control, spearmanr

from tse.gaps.fit import Fit
from tse.gaps.problem import Problem
from tse.gaps.respond import ROAD, compute_responses, compute_signals
from tse.identify.data import BLOCK_TIME
from tse.library.core import library

WINDOW = 1.0  # s: over which the energy of a residual is taken
# share of the conditions that may be there by chance (Benjamini-Hochberg)
FALSE_DISCOVERIES = 0.01
# of ranks: a condition that goes less with the energy is not worth words
MIN_CORRELATION = 0.15
MIN_WINDOWS = 20  # fewer do not show a channel's conditions
# a road does not know of the steering wheel: of a bank, no more of the variance goes with
# the car's own turning
MAX_FOLLOWED = 0.5
HAT = 10  # blocks: between two values of a disturbance, which is linear between them
PLACES = {
    "front axle": "front_angle",
    "rear axle": "rear_angle",
    "side force": "force_y",
    "yaw moment": "yaw_moment",
    "road (bank)": ROAD,
    "sensor accel_y": "accel_y",
    "sensor yaw_rate": "yaw_rate",
}


@dataclass(frozen=True)
class Condition:
    """The residual of a channel is large where something is."""

    channel: str
    condition: str
    strength: float  # rank correlation of its energy


@dataclass(frozen=True)
class Entry:
    """How well a disturbance at this place explains accel_y and yaw_rate."""

    place: str
    nats: float
    share: float  # of their energy that it takes up
    size: float  # sd of the disturbance
    unit: str


def compute_features(problem: Problem, values: dict[str, float]) -> dict[str, np.ndarray]:
    """Return the signals of conditions, from inputs and simulation.

    Measurements are not among them: their noise is in the residual, too.
    """
    predicted = problem.channels(values, ("accel_x", "accel_y", "vel_x"))
    steer = problem.quantity("steer_angle")
    front = problem.quantity("wheel_speed_front") * problem.config.wheel_radius_front
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
    """Return the conditions in which the residual is large, strongest first.

    Those that chance explains are left out (Spearman; Benjamini-Hochberg).
    """
    rows, found, p = problem.rows, [], []
    at = compute_features(problem, values)
    for c, mine in problem.used():
        key = rows.log[mine] * 10_000_000 + (rows.time[mine] // WINDOW).astype(np.int64)
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
    """Return every place with the evidence for a disturbance there, best first.

    It is fitted beside everything in `last`. A disturbance is a sum of hats, one every
    HAT blocks, of normal size. Residuals are linear in it, so its evidence is a sum over
    the singular values of the responses to the hats (compute_responses()).
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
        # of each log: singular values and directions, and how far the residual goes along
        # them
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

        def nats(size: float, parts: list = parts) -> float:
            shares = ((c, (size * s) ** 2) for s, _, c, _ in parts)
            return 0.5 * sum(float(np.sum(c * c * x / (1 + x) - np.log1p(x))) for c, x in shares)

        size = max(sizes, key=nats)
        means = [v.T @ (size**2 * s / (1 + (size * s) ** 2) * c) for s, v, c, _ in parts]
        taken = sum(float(np.sum(c * c * (size * s) ** 2 / (1 + (size * s) ** 2))) for s, _, c, _ in parts)
        seen = np.concatenate([hats[i] @ x for i, x in zip(there, means, strict=True)])
        follows = (
            np.corrcoef(seen, np.concatenate([at[i]["accel_y"] for i in there]))[0, 1] ** 2
            if seen.any()
            else 0.0
        )
        # a road does not know of the steering wheel: what follows the car's own turning
        # came in elsewhere
        last_of_all = id_ == ROAD and follows > MAX_FOLLOWED
        share = taken / max(sum(rr for *_, rr in parts), 1e-300)
        entry = Entry(place, nats(size), share, float(size), "m/s2" if id_ == ROAD else units[id_].unit)
        found.append((last_of_all, -entry.nats, entry))
    return [e for *_, e in sorted(found, key=lambda x: x[:2])]
