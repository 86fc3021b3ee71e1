"""A car calibrated on its logs."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from tse._log import LogLike, PathLike, all_checked, known_road
from tse._shown import Shown
from tse._vehicle import VehicleLike, read_vehicle
from tse.calibration import output, page, workflow
from tse.calibration.result import CalibrationResult, describe_result
from tse.car.vehicle import Vehicle, make_vehicle
from tse.channels.agree import read_agreeing
from tse.library.files import parse_toml
from tse.log.rows import Reading
from tse.roads.road import Road


class Calibration(Shown):
    """A calibrated car, and what its logs have shown of it."""

    def __init__(self, result: CalibrationResult, logs: Sequence[str]):
        self._result, self._logs = result, list(logs)
        self.converged = bool(result.fit.converged)
        """False: the numbers are where the search stood."""
        self.notes = tuple(result.notes)
        """What was odd, in words."""

    @property
    def vehicle(self) -> Vehicle:
        """The calibrated car, for estimate() of other logs."""
        car = self._result.vehicle
        text = output.format_calibrated(self._result, self._logs, car.formula_path or Path("formula.toml"))
        made = make_vehicle(parse_toml(text), car.path or Path("vehicle"))
        made.path, made.formula, made.formula_path = None, car.formula, car.formula_path
        return made

    @property
    def words(self) -> tuple[str, ...]:
        """Stiffness, how the search ended, and what these logs do not show."""
        return tuple(describe_result(self._result))

    def to_frame(self) -> pd.DataFrame:
        """Return a row per number of the car: name, unit, before, value, sd, shown (the logs tell it), words ..."""
        return pd.DataFrame([f.as_json() for f in self._result.findings])

    def plot(self) -> Any:
        """Return a figure of plotly: each number with its 95 % interval beside what was known before."""
        return page.draw_bands(self._result)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the page of `tselab calibrate`."""
        page.write(Path(path), self._result, self.words)
        return Path(path)

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the calibrated vehicle file, and beside it all numbers as JSON, and its formula if it has one."""
        output.write(Path(path), self._result, self._logs)
        return Path(path)


def calibrate(
    logs: LogLike | Sequence[LogLike],
    vehicle: VehicleLike,
    *,
    road: PathLike | Road | None = None,
    progress: Callable[[str], None] | None = None,
) -> Calibration:
    """Calibrate a car on logs of ordinary driving, as `tselab calibrate` does.

    Parameters
    ----------
    logs
        A log or several: files, frames, or what read_log() returned. Half an hour with bends and some braking is a good start.
    vehicle
        As in estimate().
    road
        road.csv, or what read_road() returned: bank and grade of the road of all logs. None: they
        are found with the car.
    progress
        Called with what is done now; a minute or two pass.

    Returns
    -------
    Calibration
        `vehicle` is for estimate() of other logs of this car.

    Raises
    ------
    Error
        No log can be compared with a simulation, or the channels of all contradict each other; a ValueError.
    """
    car = read_vehicle(vehicle)
    notes: list[str] = []
    read = read_agreeing(all_checked(logs, car), notes, Reading(car=car))
    read = workflow.place_on_known(known_road(road), read, car)
    result = workflow.calibrate_logs(read, car, progress or (lambda _: None), notes=notes)
    return Calibration(result, [log.path.name for log in read])
