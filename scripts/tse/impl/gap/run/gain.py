"""What the estimator itself gains: the particle filter over every log with the vehicle as it was and as it is now.

Without truth there are three witnesses. Evidence: how well each row was foreseen, in nats. Valid: how much of the time it
knows. And agreement: stiffness of one car on one road is one number, so estimates that differ from log to log by more than
their bands are wrong somewhere.
"""

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

FEWEST_VALID = 50  # rows; fewer do not show a log's stiffness
# of the rows, with the improved vehicle: a log that knows a stiffness for less was not driven to show it
LEAST_VALID = 0.5


BOTH = ("before", "after")


def gain(
    logs: Sequence[tuple[str, str, Log]],
    before: Vehicle,
    after: Vehicle,
    jobs: int = 1,
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """For verdict.json: of all logs together and of each, before and after: nats per row, share of the rows that are valid, and
    stiffness: median of the valid means. `logs`: (part, name, log)."""

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
            "stiffness": _both(pair, lambda t: {k: _median(t.loc[t[f"{k}_valid"] == 1, k]) for k in STIFFNESS}),
        })  # fmt: skip
    rows = [len(log) for _, _, log in logs]

    def mean(of: Callable[[dict[str, Any]], float]) -> float:
        return float(np.average([of(d) for d in drives], weights=rows))

    return {
        "log_evidence_per_row": {w: mean(lambda d, w=w: d["evidence"][w]) for w in BOTH},
        "valid": {w: {k: mean(lambda d, w=w, k=k: d["valid"][w][k]) for k in STIFFNESS} for w in BOTH},
        "stiffness_sd_between_logs": {w: {k: _spread(drives, w, k) for k in STIFFNESS} for w in BOTH},
        "logs": drives,
    }


def words(gained: Mapping[str, Any]) -> list[str]:
    """For the terminal."""
    lines = []
    for key in STIFFNESS:
        spread, valid = ([gained[of][w][key] for w in BOTH] for of in ("stiffness_sd_between_logs", "valid"))
        text = f"valid {100 * valid[0]:.0f} -> {100 * valid[1]:.0f} % of the time"
        if np.isfinite(spread).all():
            text = f"differs between logs that show it by {100 * spread[0]:.1f} -> {100 * spread[1]:.1f} % (sd), {text}"
        lines.append(f"The estimator's {NAMES[key][0].lower() + NAMES[key][1:]}: {text}.")
    return lines


def _both(pair: Sequence[pd.DataFrame], of: Callable[[pd.DataFrame], Any]) -> dict[str, Any]:
    return dict(zip(BOTH, map(of, pair), strict=True))


def _median(valid: pd.Series) -> float:
    return float(valid.median()) if len(valid) >= FEWEST_VALID else float("nan")


def _spread(drives: Sequence[Mapping[str, Any]], when: str, key: str) -> float:
    """sd over the logs that show a stiffness and know it both before and after, share of the mean; NaN: fewer than two do."""
    known = [d["stiffness"] for d in drives if d["valid"]["after"][key] >= LEAST_VALID]
    values = [k[when][key] for k in known if all(np.isfinite(k[w][key]) for w in BOTH)]
    return float(np.std(values, ddof=1) / np.mean(values)) if len(values) >= 2 else float("nan")
