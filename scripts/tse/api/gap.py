"""Find effects that the model lacks, from the differences between logs and simulation:
gap(), gap_check(), gap_plan() and their results."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from tse.api.log import LogLike, PathLike, collect_logs, read_known_road
from tse.api.shown import Shown
from tse.api.vehicle import VehicleLike, get_vehicle_file, read_vehicle
from tse.car.vehicle import Vehicle
from tse.gaps.run import check, pictures, plan, stages, workflow
from tse.gaps.run.output import WrittenFiles, write_all
from tse.gaps.run.output import describe_gain as gain_words
from tse.library.files import make_directory
from tse.log.rows import Reading
from tse.report import results
from tse.roads.road import Road


class Gap(Shown):
    """Result of gap(): the verdict, i.e. the physical effects (such as tyre relaxation)
    that the car of the vehicle file lacks, and the written files."""

    def __init__(self, result: workflow.GapResult, written: WrittenFiles, folder: Path, keep: Any):
        self._result, self._written, self._keep = result, written, keep
        self.folder = folder
        """Folder with verdict.json, report.html, vehicle_improved.toml, residuals.parquet
        ... It is temporary if gap() was called without `out`."""
        self.files = tuple(written.files)
        """Paths of the files that were written."""
        self.verdict = result.verdict
        """ "none", "named", "possible" or "not_in_catalogue"."""
        self.exit_code = result.exit_code
        """Exit code of `tselab gap`."""
        self.notes = tuple(result.notes)
        """Sentences about what was unusual in the logs or in the fit."""
        self.undetectable = tuple(d.id for d in result.undetectable)
        """Ids of the effects that would not be detected in these logs
        even at their typical size."""

    @property
    def words(self) -> tuple[str, ...]:
        """The verdict in sentences."""
        return tuple(self._result.words)

    @property
    def answer(self) -> tuple[str, ...]:
        """The sentences of `words`, except those about the residuals that remain after
        the named effects are added to the model. For the residuals, see `stages`."""
        return tuple(line for line in self._result.words if not line.startswith("Still left: "))

    @property
    def stages(self) -> tuple[str, ...]:
        """Sentences about the residuals (measured minus simulated channels) of three
        simulations: with the car of the vehicle file, with the calibrated car, and with
        the calibrated car and the named effects."""
        return tuple(
            stages.describe_stages(
                self._result.stages, lambda part: "fitted logs" if part == workflow.FIT else "held-out logs"
            )
        )

    @property
    def short_stages(self) -> tuple[str, ...]:
        """Lines of a table of the residuals in the three `stages`, for the held-out logs
        or, if there are none, for the fitted logs."""
        held = next((part for part in self._result.stages if part != workflow.FIT), workflow.FIT)
        title = "fitted logs" if held == workflow.FIT else "held-out logs"
        found = self._result.stages.get(held)
        return tuple(stages.describe_channels(found, title)) if found is not None else ()

    @property
    def gain(self) -> tuple[str, ...]:
        """A sentence for each stiffness, with two numbers: the share of the time [%] in
        which its estimate is valid with the user's vehicle file, and the share with
        vehicle_improved.toml."""
        return tuple(gain_words(self._written.gain))

    @property
    def rms(self) -> dict[str, dict[str, tuple[float, float]]]:
        """Ratios of the rms residual to the sensor noise. `rms[part][channel]` is a pair:
        the ratio without the named effects, and the ratio with them. `part` is "fit" for
        the fitted logs, or "held_out"."""
        fit = {c: (x, self._result.fit_after[c]) for c, x in self._result.fit_before.items()}
        held = {c: (x.before, x.after) for c, x in self._result.held_out.items()}
        return {"fit": fit, "held_out": held}

    @property
    def vehicle(self) -> Vehicle:
        """The car with the named effects, to be used in estimate(),
        simulate() and replay()."""
        return read_vehicle(self.folder / "vehicle_improved.toml")

    def to_dict(self) -> dict[str, Any]:
        """Return the content of verdict.json."""
        found: dict[str, Any] = json.loads((self.folder / "verdict.json").read_text(encoding="utf-8"))
        return found

    def to_frame(self) -> pd.DataFrame:
        """Return a table with a row for each named effect, and a row for each channel in
        which a delay was found."""
        verdict = self.to_dict()
        late = [{"id": s.pop("id"), "parameters": {"time": s}} for s in verdict["sensors"]]
        return pd.DataFrame([*verdict["effects"], *late])

    def plot(self) -> Any:
        """Return a plotly figure: ratio of residual to sensor noise for each channel,
        without and with the named effects."""
        return pictures.draw_gap_bars(self._written.changes)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write a copy of report.html."""
        shutil.copyfile(self.folder / "report.html", path)
        return Path(path)


def gap(
    logs: LogLike | Sequence[LogLike],
    vehicle: VehicleLike,
    *,
    hold_out: LogLike | Sequence[LogLike] = (),
    out: PathLike | None = None,
    jobs: int = 1,
    formula: bool = False,
    road: PathLike | Road | None = None,
    reading: Reading | None = None,
    progress: Callable[[str], None] | None = None,
) -> Gap:
    """Compare a simulation with logs, and name the effects that the model lacks, as
    `tselab gap` does.

    The residuals are the measured minus the simulated channels. One or several effects of
    the catalogue (`tselab gap catalogue`) are named if there is enough evidence that they
    cause the residuals.

    Parameters
    ----------
    logs
        Files, data frames, or results of read_log(). A log that cannot be read, or whose
        channels contradict each other, is left out, with a note.
    vehicle
        A vehicle file, or a mapping with its keys.
    hold_out
        Logs that are not used for the fit. The residuals of these logs are computed
        without and with the named effects, to test whether the effects also explain logs
        that were not fitted.
    out
        Folder for the files, created if needed. None: a temporary folder.
    jobs
        Number of simulations that run in parallel.
    formula
        Whether to search for a formula (an effect that is not in the catalogue) even if
        the named effects explain the residuals completely.
    road
        Bank and grade of the road that all logs were driven on: a file road.csv, or a
        Road. None: they are estimated where the logs determine them.
    reading
        Options for reading files: signals, rate, strict, databases.
    progress
        Called with a sentence about the current step. The search takes some minutes.

    Returns
    -------
    Gap
        The result. `words` is the verdict, and `vehicle` the car with the named
        effects.
    """
    keep = None if out is not None else tempfile.TemporaryDirectory(prefix="tse-gap-")
    folder = Path(out) if out is not None else Path(keep.name if keep else "")
    make_directory(folder)
    say = progress if progress is not None else lambda _: None
    car, read = get_vehicle_file(vehicle, folder), read_vehicle(vehicle)
    fitted, held = collect_logs(logs, read), collect_logs(hold_out, read, 0)
    result = workflow.run_workflow(fitted, car, held, jobs, say, formula, reading, read_known_road(road))
    return Gap(result, write_all(folder, result, car, jobs, say), folder, keep)


class GapCheck:
    """Result of gap_check(): which effects would be detected in the logs."""

    def __init__(self, found: check.Check, logs: Sequence[Path]):
        self._found, self._logs = found, list(logs)
        self.exit_code = found.code
        """0: every effect would be named at its typical size; 3: only some
        would be; 4: none would be."""
        self.notes = tuple(found.notes)
        """Sentences about what was unusual in the logs."""

    @property
    def text(self) -> str:
        """A table with a row for each effect: the smallest size that would be detected in
        these logs, the typical size, and whether the typical size would be detected.
        Below the table are the effects that would not be detected at their typical size,
        each with the channels that the effect would change."""
        return self._found.text()

    def to_dict(self) -> dict[str, Any]:
        """Return what `tselab gap check --json` prints, as a dict."""
        found: dict[str, Any] = results.convert_to_plain(self._found.as_json())
        return found

    def to_frame(self) -> pd.DataFrame:
        """Return a table with a row per effect."""
        return pd.DataFrame(self.to_dict()["effects"])

    def write_table(self, path: PathLike) -> Path:
        """Write the table of `tselab gap check --table`: Parquet if `path` ends in
        .parquet, otherwise CSV."""
        logs = " ".join(map(str, self._logs))
        results.write_rows(Path(path), [{"logs": logs, **e} for e in self._found.as_json()["effects"]])
        return Path(path)


def gap_check(
    logs: PathLike | Sequence[PathLike],
    vehicle: VehicleLike,
    *,
    jobs: int = 1,
    reading: Reading | None = None,
    progress: Callable[[str], None] | None = None,
) -> GapCheck:
    """Find out which effects gap() would detect in these logs if the car had them, as
    `tselab gap check` does.

    Parameters
    ----------
    logs
        Files of logs.
    vehicle, jobs, reading, progress
        As in gap().

    Returns
    -------
    GapCheck
        For every effect its typical size, and the smallest size that would be detected.
    """
    paths = [Path(logs)] if isinstance(logs, str | os.PathLike) else [Path(p) for p in logs]
    say = progress if progress is not None else lambda _: None
    with tempfile.TemporaryDirectory(prefix="tse-gap-") as folder:
        found = check.check_model(paths, get_vehicle_file(vehicle, Path(folder)), jobs, say, reading)
    return GapCheck(found, paths)


class GapPlan:
    """Result of gap_plan(): manoeuvres that distinguish two effects, the best first."""

    def __init__(self, found: plan.ManeuverPlan):
        self._found = found
        self.separable = found.separable
        """Whether a manoeuvre exists that distinguishes the effects if it is driven for
        at most an hour."""

    def text(self, rows: int = 6) -> str:
        """Return a sentence about the best manoeuvre, i.e. the one that distinguishes the
        two effects in the shortest time, and a table of the `rows` best manoeuvres."""
        return self._found.text(rows)

    def to_dict(self) -> dict[str, Any]:
        """Return what `tselab gap plan --json` prints, as a dict."""
        rows = [{**vars(o), "needed": o.needed} for o in self._found.options]
        found: dict[str, Any] = results.convert_to_plain(
            {
                "effects": [self._found.first, self._found.second],
                "separable": self.separable,
                "manoeuvres": rows,
            }
        )
        return found

    def to_frame(self) -> pd.DataFrame:
        """Return a table with a row per manoeuvre."""
        return pd.DataFrame(self.to_dict()["manoeuvres"])


def gap_plan(
    effects: str, vehicle: VehicleLike, *, jobs: int = 1, progress: Callable[[str], None] | None = None
) -> GapPlan:
    """Find the manoeuvre that distinguishes two effects best, and how long it must be
    driven, as `tselab gap plan` does.

    Parameters
    ----------
    effects
        Ids of the two effects, such as "relaxation,steering_lag".
        tse.tables.effects() lists all.
    vehicle, jobs, progress
        As in gap().

    Returns
    -------
    GapPlan
        Every candidate manoeuvre, with the evidence [nat] that one run of it gives. Two
        cars are simulated, one with each effect. The evidence is for the effect of the
        car, against the other effect. The smaller of the two values is given.
    """
    say = progress if progress is not None else lambda _: None
    with tempfile.TemporaryDirectory(prefix="tse-gap-") as folder:
        return GapPlan(plan.make_plan(effects, get_vehicle_file(vehicle, Path(folder)), jobs, say))
