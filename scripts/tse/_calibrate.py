"""Calibrate a car on its logs."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from tse._log import LogLike, PathLike, collect_logs, read_known_road
from tse._shown import Shown
from tse._vehicle import VehicleLike, read_vehicle
from tse.calibration import output, page, workflow
from tse.calibration.result import MIN_RELIABLE_SECONDS, CalibrationResult, describe_result, summarise_result
from tse.car.vehicle import Vehicle, describe_stiffness, make_vehicle
from tse.library.files import parse_toml
from tse.log.rows import Reading
from tse.report import results
from tse.roads.road import Road

NOT_CONVERGED = 12  # exit code


class Calibration(Shown):
    """A calibrated car, and the evidence of its logs."""

    def __init__(self, result: CalibrationResult, logs: Sequence[Path]):
        self._result, self._logs = result, list(logs)
        self.converged = bool(result.fit.converged)
        """False: the search stopped before it converged, and the numbers are those of its
        last step."""
        self.notes = tuple(result.notes)
        """What was odd, in words."""

    @property
    def vehicle(self) -> Vehicle:
        """The calibrated car, for estimate() of other logs."""
        car = self._result.vehicle
        text = output.format_calibrated(self._result, self._names, car.formula_path or Path("formula.toml"))
        made = make_vehicle(parse_toml(text), car.path or Path("vehicle"))
        made.path, made.formula, made.formula_path = None, car.formula, car.formula_path
        return made

    @property
    def _names(self) -> list[str]:
        return [p.name for p in self._logs]

    @property
    def stiffness(self) -> str:
        """The three stiffnesses with their 95 % intervals, as a sentence."""
        return describe_stiffness(self.vehicle)

    @property
    def words(self) -> tuple[str, ...]:
        """Stiffness, how the search ended, and which numbers these logs do not show."""
        return (self.stiffness, *describe_result(self._result))

    @property
    def answer(self) -> tuple[str, ...]:
        """The result in a few sentences, as `tselab calibrate` ends."""
        return tuple(summarise_result(self._result, self.stiffness))

    @property
    def shown_words(self) -> tuple[str, ...]:
        """A sentence for each number that these logs show, those with most evidence
        first."""
        return tuple(f.words for group in self._result.groups for f in group.members if f.shown)

    @property
    def exit_code(self) -> int:
        """Exit code of the command: 0 usable, 4 nothing usable, 12 not converged."""
        if not self.converged:
            return NOT_CONVERGED
        is_usable = self._result.seconds >= MIN_RELIABLE_SECONDS and any(
            f.shown for f in self._result.findings
        )
        return results.USABLE if is_usable else results.NOTHING

    def to_frame(self) -> pd.DataFrame:
        """Return a row per number of the car: name, unit, before, value, sd, shown (the
        logs show it), words ..."""
        return pd.DataFrame([f.as_json() for f in self._result.findings])

    def to_dict(self) -> dict[str, Any]:
        """Return all numbers, as the JSON file beside the calibrated vehicle file has
        them."""
        found: dict[str, Any] = results.convert_to_plain(output.to_json(self._result))
        return found

    def plot(self) -> Any:
        """Return a figure of plotly: numbers with their 95 % intervals and priors."""
        return page.draw_bands(self._result)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the page of `tselab calibrate`."""
        page.write(Path(path), self._result, self.words)
        return Path(path)

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the calibrated vehicle file, and beside it all numbers as JSON, and its
        formula if it has one."""
        output.write(Path(path), self._result, self._names)
        return Path(path)

    def write_table(self, path: str | os.PathLike[str]) -> Path:
        """Write the table of the command, .parquet or .csv by the name."""
        logs = " ".join(map(str, self._logs))
        results.write_rows(Path(path), [{"logs": logs, **f.as_json()} for f in self._result.findings])
        return Path(path)


def calibrate(
    logs: LogLike | Sequence[LogLike],
    vehicle: VehicleLike,
    *,
    hold_out: LogLike | Sequence[LogLike] = (),
    road: PathLike | Road | None = None,
    reading: Reading | None = None,
    steps: int | None = None,
    jobs: int = 1,
    progress: Callable[[str], None] | None = None,
) -> Calibration:
    """Calibrate a car on logs of ordinary driving, as `tselab calibrate` does.

    Parameters
    ----------
    logs
        A log or several: files, frames, or what read_log() returned. Half an hour with
        bends and some braking is a good start. A log that cannot be read, or whose
        channels contradict each other, is left out, with a note.
    vehicle
        As in estimate().
    hold_out
        Logs that are not fitted: the calibrated car is compared with them.
    road
        road.csv, or what read_road() returned: bank and grade of the road of all logs.
        None: they are found with the car.
    reading
        How files are read: signals, rate, strict, databases.
    steps
        Maximum number of steps of the search; None: 40.
    jobs
        Simulations that run at once.
    progress
        Called with a sentence about the current step; a minute or two pass.

    Returns
    -------
    Calibration
        `vehicle` is for estimate() of other logs of this car.

    Raises
    ------
    Error
        No log can be compared with a simulation, or the channels of all contradict each
        other; a ValueError.
    """
    car = read_vehicle(vehicle)
    fitted, held = collect_logs(logs, car), collect_logs(hold_out, car, 0)
    say = progress if progress is not None else lambda _: None
    result = workflow.run(fitted, car, held, jobs, say, steps, reading, read_known_road(road))
    return Calibration(result, [x if isinstance(x, Path) else x.path for x in fitted])
