"""Calibrate the parameters of a car on its logs: calibrate() and its result."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from tse.api.log import LogLike, PathLike, collect_logs, read_known_road
from tse.api.shown import Shown
from tse.api.vehicle import VehicleLike, read_vehicle
from tse.calibration import output, page, workflow
from tse.calibration.result import MIN_RELIABLE_SECONDS, CalibrationResult, describe_result, summarise_result
from tse.car.vehicle import Vehicle, describe_stiffness, make_vehicle
from tse.library.files import parse_toml
from tse.log.rows import Reading
from tse.report import results
from tse.roads.road import Road

NOT_CONVERGED = 12  # exit code if the fit did not converge


class Calibration(Shown):
    """Result of calibrate(): the car, and how well the logs determine its parameters."""

    def __init__(self, result: CalibrationResult, logs: Sequence[Path]):
        self._result, self._logs = result, list(logs)
        self.converged = bool(result.fit.converged)
        """Whether the fit converged. If not, the parameters
        are those of its last step."""
        self.notes = tuple(result.notes)
        """Sentences about what was unusual in the logs or in the fit."""

    @property
    def vehicle(self) -> Vehicle:
        """The calibrated car, to be used in estimate() of other logs."""
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
        """Sentences: the stiffnesses, whether the fit converged, and which parameters
        these logs do not determine."""
        return (self.stiffness, *describe_result(self._result))

    @property
    def answer(self) -> tuple[str, ...]:
        """The result in a few sentences: the last lines that `tselab calibrate`
        prints."""
        return tuple(summarise_result(self._result, self.stiffness))

    @property
    def shown_words(self) -> tuple[str, ...]:
        """A sentence for each parameter that these logs determine. The parameter with the
        strongest evidence comes first."""
        return tuple(f.words for group in self._result.groups for f in group.members if f.shown)

    @property
    def exit_code(self) -> int:
        """Exit code of `tselab calibrate`. 0: the logs determine a parameter of the car;
        4: they determine none, or are shorter than 20 s; 12: the fit did not converge."""
        if not self.converged:
            return NOT_CONVERGED
        is_usable = self._result.seconds >= MIN_RELIABLE_SECONDS and any(
            f.shown for f in self._result.findings
        )
        return results.USABLE if is_usable else results.NOTHING

    def to_frame(self) -> pd.DataFrame:
        """Return a table with a row per fitted parameter of the car.

        Columns: name, group, unit, before (value in the vehicle file), prior and prior_sd
        (prior mean and sd), value and sd (posterior mean and sd), shown (whether the logs
        determine the parameter), words (a sentence), shape (whether the parameter gives
        the shape of an effect, e.g. a time constant)."""
        return pd.DataFrame([f.as_json() for f in self._result.findings])

    def to_dict(self) -> dict[str, Any]:
        """Return the content of the JSON file that write() puts
        next to the vehicle file."""
        found: dict[str, Any] = results.convert_to_plain(output.to_json(self._result))
        return found

    def plot(self) -> Any:
        """Return a plotly figure: posterior mean and 95 % interval of each parameter, as
        differences from its prior mean, in prior sds."""
        return page.draw_bands(self._result)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the HTML page that `tselab calibrate` writes."""
        page.write(Path(path), self._result, self.words)
        return Path(path)

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the calibrated vehicle file. Next to it, write all parameters as JSON.
        If the car has a formula (an effect that the user added to the model), write the
        formula there, too."""
        output.write(Path(path), self._result, self._names)
        return Path(path)

    def write_table(self, path: str | os.PathLike[str]) -> Path:
        """Write the table of `tselab calibrate --table`: Parquet if `path` ends in
        .parquet, otherwise CSV."""
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
        One log or several: files, data frames, or results of read_log(). Half an hour
        with bends and some braking is a good start. A log that cannot be read, or whose
        channels contradict each other, is left out, with a note.
    vehicle
        A vehicle file, a mapping with its keys, or the result of read_vehicle().
    hold_out
        Logs that are not used for the fit. The calibrated car is validated on them.
    road
        Bank and grade of the road that all logs were driven on: a file road.csv, or a
        Road. None: they are estimated together with the parameters of the car.
    reading
        How files are read: Reading(signals=, rate=, strict=, databases=), the options of
        read_log(). None: their defaults.
    steps
        Maximum number of steps of the fit; None: 40.
    jobs
        Number of simulations that run in parallel.
    progress
        Called with a sentence about the current step. The fit takes a minute or two.

    Returns
    -------
    Calibration
        Its `vehicle` is the car to be used in estimate() of other logs.

    Raises
    ------
    Error
        No log can be compared with a simulation, or the channels of every log contradict
        each other. The error is also a ValueError.
    """
    car = read_vehicle(vehicle)
    fitted, held = collect_logs(logs, car), collect_logs(hold_out, car, 0)
    say = progress if progress is not None else lambda _: None
    result = workflow.run(fitted, car, held, jobs, say, steps, reading, read_known_road(road))
    return Calibration(result, [x if isinstance(x, Path) else x.path for x in fitted])
