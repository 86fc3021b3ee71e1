"""Many logs of many cars."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from tse._log import PathLike
from tse._shown import Shown, drawn
from tse._vehicle import VehicleLike, read_vehicle, vehicle_file
from tse.estimation.answer import WHERE
from tse.log.rows import Reading
from tse.runs import find, page
from tse.runs.keep import PAGE, Done, Store
from tse.runs.run import Plan, run


class Fleet(Shown):
    """All cars, and the folder with what was written."""

    def __init__(self, done: Sequence[Done], table: pd.DataFrame, folder: Path):
        self._done, self._table = done, table
        self.folder = folder
        """fleet.parquet, fleet.html, reports, learnt states, calibrated vehicle files."""
        self.errors = tuple(d.outcome.error for d in done if d.outcome.error)
        """Of logs that cannot be read."""

    @property
    def words(self) -> tuple[str, ...]:
        """A sentence for each car, the softest first: the last that is known of it."""
        return tuple(
            f"{c.name}: {len(c.done)} logs, {c.hours:.1f} h"
            + "".join(
                f"; {WHERE[k]} {v.shown} {'kN' if k == 'cx_front' else 'kN/rad'}" for k, v in c.last.items()
            )
            + ("" if c.last else f"; {c.reason}")
            for c in page.cars(self._done, self._table)
        )

    def to_frame(self) -> pd.DataFrame:
        """Return a row per log, stretch of road and stiffness, as fleet.parquet has it; error of a log that cannot be read."""
        return self._table

    def plot(self) -> Any:
        """Return a figure of plotly: the last estimate of each car with its 95 % interval, the softest first."""
        return drawn(page.distribution(page.cars(self._done, self._table)))

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the page of `tselab fleet`. Its links are to reports in `folder`."""
        shutil.copyfile(self.folder / PAGE, path)
        return Path(path)


def fleet(
    logs: PathLike | Sequence[PathLike],
    vehicle: VehicleLike | None = None,
    *,
    out: PathLike,
    vehicles: PathLike | None = None,
    car: str | None = None,
    settings: Mapping[str, float] | None = None,
    learn: bool = True,
    calibrate: bool = True,
    reports: bool = True,
    jobs: int = 1,
    scheduler: str | None = None,
) -> Fleet:
    """Estimate many logs of many cars, as `tselab fleet` does.

    Parameters
    ----------
    logs
        Files, folders and patterns.
    vehicle
        As in estimate(), of all cars: each folder below is a car, or all are the one `car`.
    out
        Folder for what is written. The same call goes on from there, and runs new and changed logs.
    vehicles
        A table with a row per log, in place of `vehicle`: columns log, vehicle, car, signals.
    car
        The name of the car that all logs are of.
    settings
        Any settings by name; they win.
    learn
        Each drive starts from what the one of the same car before it taught.
    calibrate
        Cars that nobody has calibrated, on their first logs.
    reports
        A page for each log.
    jobs, scheduler
        Processes of this machine, or the address of a Dask cluster.

    Returns
    -------
    Fleet
        A log that cannot be read is an error in it, and none of the call.
    """
    if (vehicle is None) == (vehicles is None):
        raise ValueError("give vehicle, the car of all logs, or vehicles, a table with one for each log")
    folder = Path(out)
    store = Store(folder, False)
    car_file = None if vehicle is None else vehicle_file(vehicle, folder)
    words = [os.fspath(logs)] if isinstance(logs, str | os.PathLike) else [os.fspath(p) for p in logs]
    drives = find.drives(words, car_file, None if vehicles is None else Path(vehicles), car, folder)
    for path in dict.fromkeys(d.vehicle for d in drives if d.vehicle is not None):
        read_vehicle(path)  # one that is wrong is refused before anything is run
    plan = Plan(Reading(), settings=dict(settings or {}), learn=learn, reports=reports, calibrate=calibrate)
    done = run(drives, plan, store, jobs if jobs > 1 else 0, scheduler)
    table = store.write(done)
    page.write(folder / PAGE, done, table, folder.resolve().name)
    return Fleet(done, table, folder)
