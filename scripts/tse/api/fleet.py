"""Estimate many logs of many cars: fleet() and its result."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from tse.api.filter import Form
from tse.api.log import PathLike
from tse.api.shown import Shown, make_figure
from tse.api.vehicle import VehicleLike, get_vehicle_file, read_vehicle
from tse.estimation.answer import WHERE
from tse.library.errors import UserError
from tse.log.rows import Reading
from tse.report import results
from tse.runs import find, page
from tse.runs.keep import PAGE, TABLE, Done, Store
from tse.runs.run import FleetPlan, run_drives


class Fleet(Shown):
    """Result of fleet(): the stiffness estimates of all cars, and the written files."""

    def __init__(self, done: Sequence[Done], table: pd.DataFrame, folder: Path):
        self._done, self._table = done, table
        self._cars = page.list_cars(done, table)
        self.folder = folder
        """Folder with fleet.parquet, fleet.html, reports, learnt states and
        calibrated vehicle files."""
        self.files = (folder / TABLE, folder / PAGE)
        """Paths of the table fleet.parquet and of the page fleet.html."""
        self.errors = tuple(d.outcome.error for d in done if d.outcome.error)
        """Error messages of the logs that could not be estimated."""

    def __len__(self) -> int:
        return len(self._done)

    @property
    def hours(self) -> float:
        """[h] Total duration of all logs."""
        return sum(d.outcome.seconds for d in self._done) / 3600

    @property
    def counts(self) -> dict[str, int]:
        """Number of logs for each outcome: "yes" (usable), "in part" (usable in part),
        "no" (not usable), "error" (could not be estimated)."""
        read = [d.outcome.code for d in self._done if not d.outcome.error]
        return {word: read.count(code) for code, word in results.CODES.items()} | {"error": len(self.errors)}

    @property
    def exit_code(self) -> int:
        """Exit code of `tselab fleet`: 0 every log is usable, 4 no
        log is usable, 3 otherwise."""
        codes = {results.NOTHING if d.outcome.error else d.outcome.code for d in self._done}
        return codes.pop() if len(codes) == 1 else results.IN_PART if codes else results.USABLE

    @property
    def ranking(self) -> tuple[tuple[str, str], ...]:
        """A pair for each car: its name, and a sentence.

        The order of the cars, and what the sentence states:
        1. cars with a known cornering stiffness: the latest, of the softer axle
        2. cars with only a known longitudinal stiffness: the latest
        3. cars without a known stiffness: the reason

        In groups 1 and 2, the car with the smallest such stiffness comes first."""
        return tuple((c.name, c.reason) for c in self._cars)

    @property
    def words(self) -> tuple[str, ...]:
        """A sentence for each car, in the order of `ranking`: number and total duration
        of the logs of the car, and its latest stiffnesses."""
        return tuple(
            f"{c.name}: {len(c.done)} logs, {c.hours:.1f} h"
            + "".join(
                f"; {WHERE[k]} {v.shown} {'kN' if k == 'cx_front' else 'kN/rad'}" for k, v in c.last.items()
            )
            + ("" if c.last else f"; {c.reason}")
            for c in self._cars
        )

    def to_dict(self) -> dict[str, Any]:
        """Return what `tselab fleet --json` prints, as a dict."""
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
        """Return the table of fleet.parquet. Each log has three rows (one per stiffness)
        for each stretch of road, i.e. for each part of the drive from one detected change
        of the stiffness to the next. A log that could not be estimated has one row with
        its error."""
        return self._table

    def plot(self) -> Any:
        """Return a plotly figure: the latest estimates of each car with 95 % intervals,
        in the order of `ranking`."""
        return make_figure(page.draw_distribution(self._cars))

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write a copy of the page fleet.html. The page has relative links to the
        reports of the logs. So the links only work if the copy is in the folder
        `folder`."""
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
        Files, folders and glob patterns.
    vehicle
        Vehicle of all logs, as in estimate(). If `car` is None, the logs of each folder
        belong to a separate car with the name of the folder. Deeper folders do not make
        cars: with logs="all", the log all/a/may/1.csv belongs to the car a.
    out
        Folder for the files, created if needed. A later call with the same folder
        estimates only logs that are new or have changed.
    vehicles
        A CSV table that assigns a vehicle file to each log. It is given instead of
        `vehicle`. Its columns are log, vehicle, car and signals.
    car
        Name of the car that all logs belong to.
    settings
        Any settings by name. They override `config` and the vehicles.
    config, form, average
        As in estimate().
    reading
        Options for reading the logs: signals, rate, strict, databases.
    learn
        Whether each drive starts from the learnt state of the previous drive of the car.
    calibrate
        True: a car whose vehicle file has neither a table [calibration] nor a table
        [uncertainty] is first calibrated, on its first four logs together. If `learn` is
        False, it is calibrated on each log separately. False: no calibration.
    reports
        Whether an HTML page is written for each log.
    estimates
        Whether the estimates of every row are kept, in a Parquet file for each log.
    restart
        Whether logs that an earlier call has already estimated are estimated again.
    jobs
        Number of processes on this machine, each of which estimates one log at a time. 1:
        only the calling process estimates logs.
    isolate
        Whether logs are estimated in a separate process even if `jobs` is 1. If this
        process dies, its log gets an error, and the call goes on with the next log.
    scheduler
        Address of a Dask cluster that estimates the logs, such as "tcp://host:8786".
    bar
        Show a progress bar on standard error.

    Returns
    -------
    Fleet
        The result. A log that cannot be read does not end the call;
        its message is in `errors`.

    Raises
    ------
    Error
        A folder contains no log, or a vehicle file or the table is wrong. The error is
        also a ValueError.
    Interrupted
        Ctrl-C was pressed. The message says how many logs are done.
    """
    if (vehicle is None) == (vehicles is None):
        raise ValueError(
            "give either `vehicle` (for all logs) or `vehicles` (a table with the vehicle of each log)"
        )
    if car is not None and vehicles is not None:
        raise UserError("car: is not allowed together with `vehicles`, whose column car names the cars")
    folder = Path(out)
    car_file = None if vehicle is None else get_vehicle_file(vehicle, folder)
    words = [os.fspath(logs)] if isinstance(logs, str | os.PathLike) else [os.fspath(p) for p in logs]
    drives = find.find_drives(words, car_file, None if vehicles is None else Path(vehicles), car, folder)
    for path in dict.fromkeys(d.vehicle for d in drives if d.vehicle is not None):
        read_vehicle(path)  # raises UserError if the file is wrong, before any log is estimated
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
