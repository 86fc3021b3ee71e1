"""What the estimator itself gains: the particle filter over every log with the vehicle as it was and as it is now.

Without truth there are three witnesses. Evidence: how well each row was foreseen, in nats. Valid: how much of the time it
knows. And agreement: stiffness of one car on one road is one number, so estimates that differ from log to log by more than
their bands are wrong somewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import pandas as pd

from tse.impl.config import make_config
from tse.impl.core import STIFFNESS
from tse.impl.estimate import estimate
from tse.impl.rows import Log
from tse.impl.vehicle import Vehicle
from tse.impl.verdict import NAMES

FEWEST_VALID = 50  # rows; fewer do not show a log's stiffness
# of the rows, with the improved vehicle: a log that knows a stiffness for less was not driven to show it
LEAST_VALID = 0.5


@dataclass(frozen=True)
class Drive:
    """The estimator over one log, before and after."""

    log: str
    part: str  # fit, held_out
    evidence: tuple[float, float]  # nats per row
    valid: tuple[dict[str, float], dict[str, float]]  # share of the rows
    stiffness: tuple[dict[str, float], dict[str, float]]  # median of the valid means, N and N/rad; NaN: none


@dataclass(frozen=True)
class Gain:
    """All logs together."""

    drives: list[Drive]
    evidence: tuple[float, float]
    valid: tuple[dict[str, float], dict[str, float]]
    spread: tuple[
        dict[str, float], dict[str, float]
    ]  # sd over the logs, share of the mean; NaN: fewer than two show it

    def words(self) -> list[str]:
        """For the terminal."""
        lines = []
        for key in STIFFNESS:
            spread, valid = [s[key] for s in self.spread], [v[key] for v in self.valid]
            text = f"valid {100 * valid[0]:.0f} -> {100 * valid[1]:.0f} % of the time"
            if np.isfinite(spread).all():
                text = f"differs between logs that show it by {100 * spread[0]:.1f} -> {100 * spread[1]:.1f} % (sd), {text}"
            lines.append(f"The estimator's {NAMES[key][0].lower() + NAMES[key][1:]}: {text}.")
        return lines


def gain(
    logs: Sequence[tuple[str, str, Log]],
    before: Vehicle,
    after: Vehicle,
    jobs: int = 1,
    say: Callable[[str], None] = lambda _: None,
) -> Gain:
    """`logs`: (part, name, log)."""
    tasks = [(part, name, log, vehicle) for part, name, log in logs for vehicle in (before, after)]

    def one(task: tuple[str, str, Log, Vehicle]) -> pd.DataFrame:
        _, name, log, vehicle = task
        say(f"the estimator over {name}")
        return estimate(log, make_config(vehicle, log)[0]).table

    with ThreadPoolExecutor(max(1, jobs)) as pool:  # the library runs without Python's lock
        tables = list(pool.map(one, tasks))
    drives = []
    for i, (part, name, _) in enumerate(logs):
        pair = tables[2 * i], tables[2 * i + 1]
        # the same rows on both sides: where both used a measurement
        used = np.logical_and(*(np.isfinite(t["log_evidence"]) & (t["log_evidence"] != 0) for t in pair))
        drives.append(
            Drive(
                name,
                part,
                tuple(float(t.loc[used, "log_evidence"].mean()) if used.any() else float("nan") for t in pair),
                tuple({k: float((t[f"{k}_valid"] == 1).mean()) for k in STIFFNESS} for t in pair),
                tuple(_stiffness(t) for t in pair),
            )
        )
    rows = np.array([len(log) for _, _, log in logs], float)
    evidence = tuple(float(np.average([d.evidence[k] for d in drives], weights=rows)) for k in (0, 1))
    valid = tuple(
        {s: float(np.average([d.valid[k][s] for d in drives], weights=rows)) for s in STIFFNESS} for k in (0, 1)
    )
    return Gain(drives, evidence, valid, _spread(drives))


def _stiffness(table: pd.DataFrame) -> dict[str, float]:
    found = {}
    for key in STIFFNESS:
        valid = table[f"{key}_valid"] == 1
        found[key] = float(table.loc[valid, key].median()) if valid.sum() >= FEWEST_VALID else float("nan")
    return found


def _spread(drives: Sequence[Drive]) -> tuple[dict[str, float], dict[str, float]]:
    """Over the logs that show a stiffness, and know it both before and after."""
    spreads: tuple[dict[str, float], dict[str, float]] = ({}, {})
    for key in STIFFNESS:
        values = np.array([[d.stiffness[k][key] for k in (0, 1)] for d in drives if d.valid[1][key] >= LEAST_VALID])
        values = values[np.isfinite(values).all(axis=1)] if len(values) else values
        for k in (0, 1):
            enough = len(values) >= 2
            spreads[k][key] = float(np.std(values[:, k], ddof=1) / np.mean(values[:, k])) if enough else float("nan")
    return spreads
