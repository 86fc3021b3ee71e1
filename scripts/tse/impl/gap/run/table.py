"""Residuals before and after as one table: DIR/residuals.parquet, and what the report draws."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from tse.impl.files import atomic
from tse.impl.gap.infer.show import of_the_car
from tse.impl.gap.problem import Problem
from tse.impl.identify.data import CHANNELS

FIT, HELD_OUT = "fit", "held_out"
COLUMNS = (
    "part", "log", "channel", "time", "block", "measured", "predicted_before", "predicted_after", "residual_before",
    "residual_after", "noise",
)  # fmt: skip


def table(parts: Mapping[str, Problem], before: Mapping[str, float], after: Mapping[str, float]) -> pd.DataFrame:
    """Every block of 40 ms of every log and channel. predicted_*: with the bias of the log; residual_*: measured less predicted
    over `noise`, which is what the sensor's noise leaves of a block: 1 is nothing but noise. NaN: not measured."""
    frames = []
    for part, problem in parts.items():
        rows = problem.rows
        columns: dict[str, object] = {
            "part": part,
            "log": pd.Categorical.from_codes(rows.log, log_names(problem)),
            "channel": pd.Categorical.from_codes(rows.channel, list(CHANNELS)),
            "time": rows.time.astype(float),
            "block": rows.block.astype(np.int64),
            "measured": problem.measured,
        }
        mine = after if part == FIT else of_the_car(problem, after)
        for when, values in (("before", before), ("after", mine)):
            measured = np.nan_to_num(problem.measured)
            left = problem.unbiased(measured - problem.predict(values))
            columns[f"predicted_{when}"] = measured - left
            columns[f"residual_{when}"] = np.where(problem.weight > 0, problem.weight * left, np.nan)
        columns["noise"] = np.where(problem.weight > 0, 1.0 / np.where(problem.weight > 0, problem.weight, 1.0), np.nan)
        frames.append(pd.DataFrame(columns))
    found = pd.concat(frames, ignore_index=True)
    for name in ("part", "log", "channel"):
        found[name] = found[name].astype("category")
    return found[list(COLUMNS)]


def log_names(problem: Problem) -> list[str]:
    """Names of the logs; the same name from another folder gets a number."""
    seen: dict[str, int] = {}
    names = []
    for log in problem.logs:
        n = seen[log.name] = seen.get(log.name, 0) + 1
        names.append(log.name if n == 1 else f"{log.name} ({n})")
    return names


def write(path: Path, found: pd.DataFrame) -> None:
    with atomic(path, "wb") as file:
        found.to_parquet(file, engine="pyarrow", index=False, compression="zstd")
