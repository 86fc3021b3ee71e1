"""Estimate many logs of many cars."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from tse._filter import Form
from tse._log import PathLike
from tse._shown import Shown, make_figure
from tse._vehicle import VehicleLike, get_vehicle_file, read_vehicle
from tse.estimation.answer import WHERE
from tse.library.errors import UserError
from tse.log.rows import Reading
from tse.report import results
from tse.runs import find, page
from tse.runs.keep import PAGE, TABLE, Done, Store
from tse.runs.run import FleetPlan, run_drives


class Fleet(Shown):
    """All cars, and the folder with the files."""

    def __init__(self, done: Sequence[Done], table: pd.DataFrame, folder: Path):
        self._done, self._table = done, table
        self._cars = page.list_cars(done, table)
        self.folder = folder
        """fleet.parquet, fleet.html, reports, learnt states, calibrated vehicle files."""
        self.files = (folder / TABLE, folder / PAGE)
        """Table and page."""
        self.errors = tuple(d.outcome.error for d in done if d.outcome.error)
        """Of logs that cannot be read."""

    def __len__(self) -> int:
        return len(self._done)

    @property
    def hours(self) -> float:
        """Duration of all logs."""
        return sum(d.outcome.seconds for d in self._done) / 3600

    @property
    def counts(self) -> dict[str, int]:
        """Number of logs that are usable: "yes", "in part", "no"; "error": they cannot be
        read."""
        read = [d.outcome.code for d in self._done if not d.outcome.error]
        return {word: read.count(code) for code, word in results.CODES.items()} | {"error": len(self.errors)}

    @property
    def exit_code(self) -> int:
        """Exit code of `tselab fleet`: 0 all logs are usable, 3 in part, 4 nothing usable
        in any."""
        codes = {results.NOTHING if d.outcome.error else d.outcome.code for d in self._done}
        return codes.pop() if len(codes) == 1 else results.IN_PART if codes else results.USABLE

    @property
    def ranking(self) -> tuple[tuple[str, str], ...]:
        """Name of each car, the softest first, and its softest stiffness, or why nothing
        is known."""
        return tuple((c.name, c.reason) for c in self._cars)

    @property
    def words(self) -> tuple[str, ...]:
        """A sentence for each car with its last stiffnesses, the softest car first."""
        return tuple(
            f"{c.name}: {len(c.done)} logs, {c.hours:.1f} h"
            + "".join(
                f"; {WHERE[k]} {v.shown} {'kN' if k == 'cx_front' else 'kN/rad'}" for k, v in c.last.items()
            )
            + ("" if c.last else f"; {c.reason}")
            for c in self._cars
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the document of `tselab fleet --json`."""
        logs = [
            {
                "car": d.drive.car,
                "log": d.drive.log,
                "start": d.drive.start,
                "start_from": d.drive.start_from,
                "seconds": d.outcome.seconds,
                "usable": results.CODES[d.outcome.code] if not d.outcome.error else "no",
                "error": d.outcome.error or None,
                "notes": d.outcome.notes,
                "report": d.report or None,
            }
            for d in self._done
        ]
        cars = [
            {
                "car": c.name,
                "logs": len(c.done),
                "hours": c.hours,
                "place_by": c.reason,
                "why_not": c.why,
                "last": {
                    k: {
                        "value": v.value,
                        "band": v.band,
                        "of_nominal": v.of_nominal,
                        "time": v.when.isoformat(),
                    }
                    for k, v in c.last.items()
                },
            }
            for c in self._cars
        ]
        code = self.exit_code
        found: dict[str, Any] = results.convert_to_plain(
            {"logs": logs, "cars": cars, "usable": results.CODES[code], "exit_code": code}
        )
        return found

    def to_frame(self) -> pd.DataFrame:
        """Return a row per log, stretch of road and stiffness, as fleet.parquet has it;
        of a log that cannot be read its error."""
        return self._table

    def plot(self) -> Any:
        """Return a figure of plotly: the last estimate of each car with its 95 %
        interval, the softest first."""
        return make_figure(page.draw_distribution(self._cars))

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the page of `tselab fleet`. Its links lead to reports in `folder`."""
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
    config: PathLike | None = None,
    form: Form = "default",
    average: float | None = None,
    reading: Reading | None = None,
    learn: bool = True,
    calibrate: bool = True,
    reports: bool = True,
    estimates: bool = False,
    restart: bool = False,
    jobs: int = 1,
    isolate: bool = False,
    scheduler: str | None = None,
    bar: bool = False,
) -> Fleet:
    """Estimate many logs of many cars, as `tselab fleet` does.

    Parameters
    ----------
    logs
        Files, folders and patterns.
    vehicle
        As in estimate(), of all cars: each folder below is a car, or all are the one
        `car`.
    out
        Folder for the files; made if needed. The same call continues from there, and runs
        new and changed logs.
    vehicles
        A table with a row per log, in place of `vehicle`: columns log, vehicle, car,
        signals.
    car
        Name of the car that all logs belong to.
    settings
        Any settings by name; they win over `config` and the vehicles.
    config, form, average
        As in estimate().
    reading
        How the logs are read: signals, rate, strict, databases.
    learn
        Start each drive from the learnt state of the drive of the same car before it.
    calibrate
        Calibrate cars that nobody has calibrated on their first logs.
    reports
        Write a page for each log.
    estimates
        Keep the estimates of each log, row by row, as Parquet.
    restart
        Run all logs again, also those that are done.
    jobs
        Processes of this machine; 1: this process.
    isolate
        Run the logs in another process also with one job: if it dies, that is an error of
        its log.
    scheduler
        Address of a Dask cluster that runs the logs, such as "tcp://host:8786".
    bar
        Show a progress bar on standard error.

    Returns
    -------
    Fleet
        A log that cannot be read is one of its `errors`, and does not end the call.

    Raises
    ------
    Error
        A folder without a log, a vehicle file or a table that is wrong; a ValueError.
    Interrupted
        Ctrl-C; the text says how many logs are done.
    """
    if (vehicle is None) == (vehicles is None):
        raise ValueError("give vehicle, the car of all logs, or vehicles, a table with one for each log")
    if car is not None and vehicles is not None:
        raise UserError("car: the table `vehicles` says which car a log is of")
    folder = Path(out)
    car_file = None if vehicle is None else get_vehicle_file(vehicle, folder)
    words = [os.fspath(logs)] if isinstance(logs, str | os.PathLike) else [os.fspath(p) for p in logs]
    drives = find.find_drives(words, car_file, None if vehicles is None else Path(vehicles), car, folder)
    for path in dict.fromkeys(d.vehicle for d in drives if d.vehicle is not None):
        read_vehicle(path)  # refuse a wrong one before anything is run
    store = Store(folder, restart)
    plan = FleetPlan(
        reading if reading is not None else Reading(),
        None if config is None else Path(config),
        average,
        form,
        dict(settings or {}),
        learn,
        reports,
        estimates,
        calibrate,
    )
    done = run_drives(drives, plan, store, jobs if jobs > 1 or isolate else 0, scheduler, bar)
    table = store.write(done)
    page.write_fleet_page(folder / PAGE, done, table, folder.resolve().name)
    return Fleet(done, table, folder)
