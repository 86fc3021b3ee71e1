"""What is done of a fleet, a file for each log, so that the same command goes on where it
was stopped; and the table of all."""

import base64
import contextlib
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tse.car.vehicle import read_vehicle
from tse.estimation.estimate import write_learnt
from tse.estimation.verdict import NAMES
from tse.library.files import atomic, make_directory, read_sealed, real, write_sealed
from tse.log.rows import Reading, files_of
from tse.report import results
from tse.runs.find import Drive
from tse.runs.work import Outcome, Task

TABLE, PAGE = "fleet.parquet", "fleet.html"
DONE, REPORTS, LEARNT, ESTIMATES, CALIBRATED = "logs", "reports", "learnt", "estimates", "calibrated"
LEAST_LOGS = 3  # of a car beside the one that is compared with them
STIFFER = 1.3  # times the median of the others: dry asphalt is as stiff as it gets, and warm tyres are softer
COLUMNS: dict[str, str] = {  # of the table: those of an estimate, and of which drive they are
    "car": "string",
    **{"log": "string", "start_time": "datetime64[us, UTC]", "start_from": "string", "seconds": "Float64"},
    **{k: v for k, v in results.COLUMNS.items() if k != "log"},
    "error": "string",
    "report": "string",
    "vehicle": "string",
}


@dataclass
class Done:
    """A log and what became of it. `report`: relative to the folder of the results."""

    drive: Drive
    outcome: Outcome
    report: str = ""


class Store:
    """The folder of the results."""

    def __init__(self, out: Path, restart: bool):
        self.out = out
        for folder in (out, *(out / name for name in (DONE, REPORTS, LEARNT))):
            make_directory(folder)
        if restart:
            for old in (out / DONE).glob("*.json"):
                old.unlink()

    def name(self, drive: Drive) -> str:
        """Of its files: for people, and of no other log."""
        return f"{_plain(drive.car)}-{_plain(drive.log.stem)}-{_digest(str(real(drive.log)))}"

    def estimates(self, drive: Drive) -> Path:
        (self.out / ESTIMATES).mkdir(exist_ok=True)
        return real(self.out / ESTIMATES / f"{self.name(drive)}.parquet")

    def calibrated(self, drive: Drive, text: str) -> Path:
        """Keep the vehicle file that was made of a drive's; what is there already stays
        as it is."""
        folder = self.out / CALIBRATED
        folder.mkdir(exist_ok=True)
        path = folder / f"{_of_car(drive.car)}-{_plain(drive.vehicle.stem if drive.vehicle else '')}.toml"
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            with atomic(path) as file:
                file.write(text)
        return path

    def load(self, drive: Drive, task: Task) -> Done | None:
        """What was kept of this log, if it was made of the same files and settings, by
        this user, and all of it is there."""
        with contextlib.suppress(ValueError):  # a vehicle file that cannot be read: the run says it
            kept = read_sealed(self.out / DONE / f"{self.name(drive)}.json")
            if (
                kept is None
                or kept["key"] != key_of(task)
                or (kept["report"] and not (self.out / kept["report"]).is_file())
            ):
                return None
            if task.estimates is not None and not kept["outcome"]["error"] and not task.estimates.is_file():
                return None
            said = kept["outcome"]
            learnt = base64.b64decode(said.pop("learnt")) or None
            return Done(drive, Outcome(**said, learnt=learnt), kept["report"])
        return None

    def save(self, drive: Drive, task: Task, outcome: Outcome) -> Done:
        """Keep what is done: first the report, then the word that it is done."""
        report = ""
        if outcome.report is not None:
            report = f"{REPORTS}/{self.name(drive)}.html"
            with atomic(self.out / report, "wb") as file:
                file.write(outcome.report)
            outcome.report = None
        said = {k: v for k, v in vars(outcome).items() if k != "report"}
        said["learnt"] = base64.b64encode(outcome.learnt or b"").decode()
        kept = results.plain({"key": key_of(task), "report": report, "outcome": said})
        write_sealed(self.out / DONE / f"{self.name(drive)}.json", kept)
        return Done(drive, outcome, report)

    def write(self, done: Sequence[Done]) -> pd.DataFrame:
        """The table of all logs, and each car's learnt state."""
        for car in {d.drive.car for d in done}:
            mine = [d for d in done if d.drive.car == car and d.outcome.learnt]
            if mine:
                write_learnt(self.out / LEARNT / f"{_of_car(car)}.tse", mine[-1].outcome.learnt or b"")
        frame = table(done)
        with atomic(self.out / TABLE, "wb") as file:
            frame.to_parquet(file, index=False)
        return frame


def table(done: Sequence[Done]) -> pd.DataFrame:
    """A row per log, stretch of road and stiffness; a log that cannot be used is one row
    with its error."""
    rows: list[dict[str, Any]] = []
    for d in done:
        about: Mapping[str, Any] = {
            "car": d.drive.car,
            "log": str(d.drive.log),
            "start_time": pd.Timestamp(d.drive.start, unit="s", tz="UTC"),
            "start_from": d.drive.start_from,
            "seconds": d.outcome.seconds,
            "report": d.report or None,
            "vehicle": str(d.drive.vehicle) if d.drive.vehicle else None,
        }
        if d.outcome.error or not d.outcome.rows:
            rows.append({**about, "error": d.outcome.error or "no row could be used", "usable": "no"})
        rows += [{**row, **about} for row in d.outcome.rows]
    frame = pd.DataFrame(rows, columns=list(COLUMNS)).astype(dict(COLUMNS))
    for log, text in unlike(frame).items():
        mine = frame["log"] == log
        before = frame.loc[mine, "warnings"]
        frame.loc[mine, "warnings"] = (before.fillna("") + "\n" + text).str.strip()
    return frame


def unlike(frame: pd.DataFrame) -> dict[str, str]:
    """By log what makes it unlike the other logs of its car: tyres that are stiffer than
    any road makes them. It may be of another car, with another load, on other tyres; or
    all the others were on snow. Softer is what wet roads and snow are."""
    valid = frame[frame["usable"].isin(["yes", "in part"]) & frame["value"].notna()]
    said: dict[str, str] = {}
    for (_, key), mine in valid.groupby(["car", "stiffness"]):
        size = np.log((mine["value"] / mine["nominal"]).astype(float)).groupby(mine["log"])
        most = size.max()
        if len(most) <= LEAST_LOGS:
            continue
        for log, x in most.items():
            others = float(np.median(most.drop(log)))
            row = mine.loc[size.idxmax()[log]]
            sure = float(row["sd"]) / float(row["value"]) if pd.notna(row["sd"]) else np.inf
            if x - others > np.log(STIFFER) + 2 * sure:
                text = f"{NAMES[str(key)].lower()} {np.exp(x - others):.1f} times"
                said[str(log)] = f"{said[str(log)]}, {text}" if str(log) in said else text
    return {
        log: f"unlike the other logs of this car, {text} theirs: another car, load or tyres?"
        for log, text in said.items()
    }


def key_of(task: Task) -> str:
    """Of all that an outcome depends on. Logs by size and time, for to read them all
    takes as long as to run them."""
    digest = hashlib.sha256()
    reading = Reading(task.signals, task.rate, task.strict, task.databases)
    others = [
        f
        for log, signals in task.others
        for f in (*files_of(log), *replace(reading, signals=signals).files(log))
    ]
    for path in sorted({*files_of(task.log), *reading.files(task.log), *others}):
        with contextlib.suppress(OSError):
            found = path.stat()
            digest.update(f"{path} {found.st_size} {found.st_mtime_ns}\n".encode())
    formula = read_vehicle(task.vehicle).formula_path
    for path in [p for p in (task.vehicle, formula, task.config) if p]:
        with contextlib.suppress(OSError):
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    said = [
        task.rate,
        task.strict,
        task.average,
        task.form,
        sorted(task.settings.items()),
        task.report,
        task.calibrate,
        task.code,
    ]
    digest.update(json.dumps([*said, str(task.estimates), round(task.age, 3)]).encode())
    digest.update(task.learnt or b"")
    return digest.hexdigest()


def _plain(name: str) -> str:
    """A name that any file system takes."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._")[:60] or "log"


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def _of_car(name: str) -> str:
    """The start of the names of a car's files: for people, and of no other car on any
    file system."""
    plain = _plain(name)
    return plain if plain == name.lower() else f"{plain}-{_digest(name)}"
