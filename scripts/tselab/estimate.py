"""Running the filter over a log, and the table that comes out."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from tselab.core import NOMINAL, OUTPUT, REASON, STIFFNESS, Config, Field, Filter, library
from tselab.files import atomic
from tselab.learnt import Learnt
from tselab.log import Log

CHUNK = 64  # rows between two looks at Ctrl-C and the progress bar


@dataclass
class Estimate:
    """Estimates row by row, as they go into EST.csv, and how the run ended."""

    table: pd.DataFrame
    interrupted: bool
    learnt: bytes | None = None  # what it taught, for Filter.load_learnt(); None without a row

    def __len__(self) -> int:
        return len(self.table)


def est_fields() -> list[Field]:
    """Outputs of the library as EST.csv has them: what came later stands last, so that columns keep their places."""
    fields = library().fields(OUTPUT)
    later = [f for f in fields if f.name.endswith("_spread_seen") or f.name.startswith("noise_")]
    return [f for f in fields if f not in later] + later


def est_columns() -> list[str]:
    """Columns of EST.csv, in order."""
    return ["time", *(f.name for f in est_fields()), *(f"{s}_reason" for s in STIFFNESS)]


def estimate(log: Log, config: Config, progress: bool = False, learnt: Learnt | None = None) -> Estimate:
    """Run the filter over a log, from what an earlier one taught. Ctrl-C ends the run early; what is done is kept."""
    filter_, rows = Filter(config), log.rows()
    if learnt is not None:
        learnt.load(filter_)
    outputs = filter_.outputs(len(rows))
    done = 0
    with (
        _stop_flag() as stopped,
        tqdm(
            total=len(rows),
            unit="row",
            unit_scale=True,
            disable=not progress,
            file=sys.stderr,
            leave=False,
            desc="estimate",
        ) as bar,
    ):
        while done < len(rows) and not stopped():
            last = min(done + CHUNK, len(rows))
            filter_.step_into(rows, outputs, done, last)
            bar.update(last - done)
            done = last
    table = to_table(log.time[:done], outputs[:done], config)
    return Estimate(table, interrupted=done < len(rows), learnt=filter_.save_learnt())


def to_table(time: np.ndarray, outputs: np.ndarray, config: Config) -> pd.DataFrame:
    """Outputs of the library as the columns of EST.csv: stiffness in N and N/rad, validity as 1 or 0, reasons in words."""
    words = {code: f.name for code, f in library().codes(REASON).items()}
    refused = outputs["status"] < 0
    columns: dict[str, np.ndarray] = {"time": time}
    for f in library().fields(OUTPUT):
        value = outputs[f.name]
        stiffness = next((s for s in STIFFNESS if f.name == s or f.name.startswith(s + "_")), None)
        if stiffness and f.name.endswith("_valid"):
            columns[f.name] = ((value == 0) & ~refused).astype(int)
        elif stiffness and f.unit == "1":
            columns[f.name] = value * getattr(config, NOMINAL[stiffness])
        else:
            columns[f.name] = value
    for s in STIFFNESS:
        reason = np.array([words.get(int(c), "unknown") for c in outputs[f"{s}_valid"]], object)
        columns[f"{s}_reason"] = np.where(refused, "row refused", reason)
    return pd.DataFrame(columns)[est_columns()]


def write_table(table: pd.DataFrame, path: Path) -> None:
    """CSV with the shortest digits that give the same bits back."""
    with atomic(path) as file:
        table.to_csv(file, index=False, lineterminator="\n")


@contextmanager
def _stop_flag() -> Iterator[Callable[[], bool]]:
    """While open, the first Ctrl-C only raises a flag; the second acts as usual."""
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    seen = threading.Event()

    def on_interrupt(_signal: int, _frame: object) -> None:
        seen.set()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, on_interrupt)
    try:
        yield seen.is_set
    finally:
        signal.signal(signal.SIGINT, before)
