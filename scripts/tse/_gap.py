"""What the model lacks, by which logs and simulation disagree."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from tse._log import LogLike, PathLike, all_checked, known_road
from tse._shown import Shown
from tse._vehicle import VehicleLike, read_vehicle, vehicle_file
from tse.car.vehicle import Vehicle
from tse.gaps.run import pictures, workflow
from tse.gaps.run.output import Written, write_all
from tse.roads.road import Road


class Gap(Shown):
    """What a run of `tselab gap` has found, and the folder with what it has written."""

    def __init__(self, result: workflow.Result, written: Written, folder: Path, keep: Any):
        self._result, self._written, self._keep = result, written, keep
        self.folder = folder
        """verdict.json, report.html, vehicle_improved.toml, residuals.parquet ...; temporary where gap() was given none."""
        self.verdict = result.verdict
        """ "none", "named", "possible", "not_in_catalogue"."""
        self.exit_code = result.exit_code
        """That of `tselab gap`."""
        self.notes = tuple(result.notes)
        """What was odd, in words."""

    @property
    def words(self) -> tuple[str, ...]:
        """The verdict in sentences."""
        return tuple(self._result.words)

    @property
    def vehicle(self) -> Vehicle:
        """The car with the effects that were named, for estimate(), simulate() and replay()."""
        return read_vehicle(self.folder / "vehicle_improved.toml")

    def to_frame(self) -> pd.DataFrame:
        """Return a row per named effect and late channel, as verdict.json has them; without rows where there is none."""
        verdict = json.loads((self.folder / "verdict.json").read_text(encoding="utf-8"))
        late = [{"id": s.pop("id"), "parameters": {"time": s}} for s in verdict["sensors"]]
        return pd.DataFrame([*verdict["effects"], *late])

    def plot(self) -> Any:
        """Return a figure of plotly: residuals over sensor noise by channel, before and after."""
        return pictures.gap_bars(self._written.changes)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the page of `tselab gap`."""
        shutil.copyfile(self.folder / "report.html", path)
        return Path(path)


def gap(
    logs: LogLike | Sequence[LogLike],
    vehicle: VehicleLike,
    *,
    hold_out: Sequence[LogLike] = (),
    out: PathLike | None = None,
    jobs: int = 1,
    formula: bool = False,
    road: PathLike | Road | None = None,
    progress: Callable[[str], None] | None = None,
) -> Gap:
    """Find where simulation and logs disagree, and name the effect that is missing, as `tselab gap` does.

    Parameters
    ----------
    logs
        Files, frames, or what read_log() returned.
    vehicle
        A vehicle file, or a mapping with its keys.
    hold_out
        Logs that are not fitted: they show whether what was named holds beyond.
    out
        Folder for what is written. None: a temporary one.
    jobs
        Simulations at once.
    formula
        Seek a formula also where names leave nothing.
    road
        road.csv, or what read_road() returned: bank and grade of the road of all logs.
        None: they are found where they show.
    progress
        Called with what is done now; some minutes pass.

    Returns
    -------
    Gap
        `words` is the verdict, `vehicle` the car with what was named.
    """
    keep = None if out is not None else tempfile.TemporaryDirectory(prefix="tse-gap-")
    folder = Path(out) if out is not None else Path(keep.name if keep else "")
    folder.mkdir(parents=True, exist_ok=True)
    say = progress or (lambda _: None)
    car, read = vehicle_file(vehicle, folder), read_vehicle(vehicle)
    result = workflow.run(
        all_checked(logs, read),
        car,
        all_checked(hold_out, read, 0),
        jobs,
        say,
        formula,
        road=known_road(road),
    )
    return Gap(result, write_all(folder, result, car, jobs, say), folder, keep)
