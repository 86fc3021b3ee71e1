"""What the estimator itself gains: the filter over every log with the vehicle as it was and as it is now.

Without truth there are two witnesses. Evidence: how well each row was foreseen, in nats. Valid: how much of the time it knows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pandas as pd

from tse.impl.config import make_config
from tse.impl.core import STIFFNESS
from tse.impl.estimate import estimate
from tse.impl.rows import Log
from tse.impl.vehicle import Vehicle
from tse.impl.verdict import NAMES

BOTH = ("before", "after")


def gain(
    logs: Sequence[tuple[str, str, Log]],
    before: Vehicle,
    after: Vehicle,
    jobs: int = 1,
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """For verdict.json: of all logs together and of each, before and after: nats per row, and share of the rows that are valid.
    `logs`: (part, name, log)."""

    def one(task: tuple[tuple[str, str, Log], Vehicle]) -> pd.DataFrame:
        (_, name, log), vehicle = task
        say(f"the estimator over {name}")
        return estimate(log, make_config(vehicle, log)[0]).table

    with ThreadPoolExecutor(max(1, jobs)) as pool:  # the library runs without Python's lock
        tables = list(pool.map(one, [(log, vehicle) for log in logs for vehicle in (before, after)]))
    drives = []
    for (part, name, _), *pair in zip(logs, tables[::2], tables[1::2], strict=True):
        # the same rows on both sides: where both used a measurement
        used = np.logical_and(*(np.isfinite(t["log_evidence"]) & (t["log_evidence"] != 0) for t in pair))
        drives.append({
            "log": name, "part": part, "evidence": _both(pair, lambda t, u=used: float(t.loc[u, "log_evidence"].mean())),
            "valid": _both(pair, lambda t: {k: float((t[f"{k}_valid"] == 1).mean()) for k in STIFFNESS}),
        })  # fmt: skip
    rows = [len(log) for _, _, log in logs]

    def mean(of: Callable[[dict[str, Any]], float]) -> float:
        return float(np.average([of(d) for d in drives], weights=rows))

    return {
        "log_evidence_per_row": {w: mean(lambda d, w=w: d["evidence"][w]) for w in BOTH},
        "valid": {w: {k: mean(lambda d, w=w, k=k: d["valid"][w][k]) for k in STIFFNESS} for w in BOTH},
        "logs": drives,
    }


def words(gained: Mapping[str, Any]) -> list[str]:
    """For the terminal."""
    shares = {k: [100 * gained["valid"][w][k] for w in BOTH] for k in STIFFNESS}
    return [
        f"The estimator's {NAMES[k][0].lower() + NAMES[k][1:]}: valid {old:.0f} -> {new:.0f} % of the time."
        for k, (old, new) in shares.items()
    ]


def _both(pair: Sequence[pd.DataFrame], of: Callable[[pd.DataFrame], Any]) -> dict[str, Any]:
    return dict(zip(BOTH, map(of, pair), strict=True))
