"""Find effects that the model lacks, by the difference of logs and simulation."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from tse._log import LogLike, PathLike, collect_logs, read_known_road
from tse._shown import Shown
from tse._vehicle import VehicleLike, get_vehicle_file, read_vehicle
from tse.car.vehicle import Vehicle
from tse.gaps.run import check, pictures, plan, stages, workflow
from tse.gaps.run.output import WrittenFiles, write_all
from tse.gaps.run.output import describe_gain as gain_words
from tse.library.files import make_directory
from tse.log.rows import Reading
from tse.report import results
from tse.roads.road import Road


class Gap(Shown):
    """Result of `tselab gap`, and the folder with its files."""

    def __init__(self, result: workflow.GapResult, written: WrittenFiles, folder: Path, keep: Any):
        self._result, self._written, self._keep = result, written, keep
        self.folder = folder
        """verdict.json, report.html, vehicle_improved.toml, residuals.parquet ...;
        temporary without `out`."""
        self.files = tuple(written.files)
        """The files that were written."""
        self.verdict = result.verdict
        """ "none", "named", "possible", "not_in_catalogue"."""
        self.exit_code = result.exit_code
        """Exit code of `tselab gap`."""
        self.notes = tuple(result.notes)
        """What was odd, in words."""
        self.undetectable = tuple(d.id for d in result.undetectable)
        """Effects that these logs could not have shown at their typical size."""

    @property
    def words(self) -> tuple[str, ...]:
        """The verdict in sentences."""
        return tuple(self._result.words)

    @property
    def answer(self) -> tuple[str, ...]:
        """The verdict without the remainder of each channel, which `stages` has."""
        return tuple(line for line in self._result.words if not line.startswith("Still left: "))

    @property
    def stages(self) -> tuple[str, ...]:
        """Residuals of the car as its file says, calibrated, and with the named effects,
        in sentences."""
        return tuple(
            stages.describe_stages(
                self._result.stages, lambda part: "fitted logs" if part == workflow.FIT else "held-out logs"
            )
        )

    @property
    def short_stages(self) -> tuple[str, ...]:
        """Residuals of the held-out logs, else of the fitted ones, as a table."""
        held = next((part for part in self._result.stages if part != workflow.FIT), workflow.FIT)
        title = "fitted logs" if held == workflow.FIT else "held-out logs"
        found = self._result.stages.get(held)
        return tuple(stages.describe_channels(found, title)) if found is not None else ()

    @property
    def gain(self) -> tuple[str, ...]:
        """Gain of the estimator by the improved vehicle, in sentences."""
        return tuple(gain_words(self._written.gain))

    @property
    def rms(self) -> dict[str, dict[str, tuple[float, float]]]:
        """Residuals over sensor noise before and after, by channel: of the logs "fit" and
        "held_out"."""
        fit = {c: (x, self._result.fit_after[c]) for c, x in self._result.fit_before.items()}
        held = {c: (x.before, x.after) for c, x in self._result.held_out.items()}
        return {"fit": fit, "held_out": held}

    @property
    def vehicle(self) -> Vehicle:
        """The car with the named effects, for estimate(), simulate() and replay()."""
        return read_vehicle(self.folder / "vehicle_improved.toml")

    def to_dict(self) -> dict[str, Any]:
        """Return verdict.json."""
        found: dict[str, Any] = json.loads((self.folder / "verdict.json").read_text(encoding="utf-8"))
        return found

    def to_frame(self) -> pd.DataFrame:
        """Return a row per named effect and late channel, as verdict.json has them."""
        verdict = self.to_dict()
        late = [{"id": s.pop("id"), "parameters": {"time": s}} for s in verdict["sensors"]]
        return pd.DataFrame([*verdict["effects"], *late])

    def plot(self) -> Any:
        """Return a figure of plotly: residuals over sensor noise by channel, before and
        after."""
        return pictures.draw_gap_bars(self._written.changes)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the page of `tselab gap`."""
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
    """Find where simulation and logs disagree, and name the effect that is missing, as
    `tselab gap` does.

    Parameters
    ----------
    logs
        Files, frames, or what read_log() returned. A log that cannot be read, or whose
        channels contradict each other, is left out, with a note.
    vehicle
        A vehicle file, or a mapping with its keys.
    hold_out
        Logs that are not fitted: they show whether the named effect holds beyond.
    out
        Folder for the files; made if needed. None: a temporary one.
    jobs
        Simulations that run at once.
    formula
        Seek a formula also where the named effects explain all.
    road
        road.csv, or what read_road() returned: bank and grade of the road of all logs.
        None: they are found where they show.
    reading
        How files are read: signals, rate, strict, databases.
    progress
        Called with a sentence about the current step; some minutes pass.

    Returns
    -------
    Gap
        `words` is the verdict, `vehicle` the car with the named effects.
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
    """Effects that logs can and cannot show."""

    def __init__(self, found: check.Check, logs: Sequence[Path]):
        self._found, self._logs = found, list(logs)
        self.exit_code = found.code
        """0: every effect would be named at its typical size; 3: some would; 4: none
        would."""
        self.notes = tuple(found.notes)
        """What was odd, in words."""

    @property
    def text(self) -> str:
        """A table of the effects, and where the others would show."""
        return self._found.text()

    def to_dict(self) -> dict[str, Any]:
        """Return the document of `tselab gap check --json`."""
        found: dict[str, Any] = results.convert_to_plain(self._found.as_json())
        return found

    def to_frame(self) -> pd.DataFrame:
        """Return a row per effect."""
        return pd.DataFrame(self.to_dict()["effects"])

    def write_table(self, path: PathLike) -> Path:
        """Write the table of the command, .parquet or .csv by the name."""
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
    """Say which effects these logs can and cannot show, before any is fitted, as `tselab
    gap check` does.

    Parameters
    ----------
    logs
        Files.
    vehicle, jobs, reading, progress
        As in gap().

    Returns
    -------
    GapCheck
        For every effect the smallest size that would be named, and its typical size.
    """
    paths = [Path(logs)] if isinstance(logs, str | os.PathLike) else [Path(p) for p in logs]
    say = progress if progress is not None else lambda _: None
    with tempfile.TemporaryDirectory(prefix="tse-gap-") as folder:
        found = check.check_model(paths, get_vehicle_file(vehicle, Path(folder)), jobs, say, reading)
    return GapCheck(found, paths)


class GapPlan:
    """Manoeuvres that tell two effects apart, the best first."""

    def __init__(self, found: plan.ManeuverPlan):
        self._found = found
        self.separable = found.separable
        """Whether an hour of a manoeuvre is enough."""

    def text(self, rows: int = 6) -> str:
        """Return the best manoeuvre in a sentence, and a table of the first `rows`."""
        return self._found.text(rows)

    def to_dict(self) -> dict[str, Any]:
        """Return the document of `tselab gap plan --json`."""
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
        """Return a row per manoeuvre."""
        return pd.DataFrame(self.to_dict()["manoeuvres"])


def gap_plan(
    effects: str, vehicle: VehicleLike, *, jobs: int = 1, progress: Callable[[str], None] | None = None
) -> GapPlan:
    """Find the manoeuvre that tells two effects apart, and how long it must be driven, as
    `tselab gap plan` does.

    Parameters
    ----------
    effects
        Ids of both, such as "relaxation,steering_lag"; tse.tables.effects() lists them.
    vehicle, jobs, progress
        As in gap().

    Returns
    -------
    GapPlan
        Each manoeuvre of a library, with the evidence that it gives.
    """
    say = progress if progress is not None else lambda _: None
    with tempfile.TemporaryDirectory(prefix="tse-gap-") as folder:
        return GapPlan(plan.make_plan(effects, get_vehicle_file(vehicle, Path(folder)), jobs, say))
