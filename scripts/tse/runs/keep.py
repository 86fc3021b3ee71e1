"""Store the results of a fleet, a file for each log, so that the same command
continues from there; and the table of all logs."""

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
from tse.library.files import make_directory, read_sealed, resolve_path, write_atomically, write_sealed
from tse.log.rows import Reading, list_log_files
from tse.report import results
from tse.runs.find import Drive
from tse.runs.work import Outcome, Task

TABLE, PAGE = "fleet.parquet", "fleet.html"
DONE, REPORTS, LEARNT, ESTIMATES, CALIBRATED = "logs", "reports", "learnt", "estimates", "calibrated"
MIN_LOGS = 3  # other logs of a car that one is compared with
# Of a stiffness over the median of the other logs: dry asphalt is stiffest, warm tyres
# are softer
MAX_RATIO = 1.3
COLUMNS: dict[str, str] = {  # of the table: those of an estimate, and of its drive
    "car": "string",
    **{"log": "string", "start_time": "datetime64[us, UTC]", "start_from": "string", "seconds": "Float64"},
    **{k: v for k, v in results.COLUMNS.items() if k != "log"},
    "error": "string",
    "report": "string",
    "vehicle": "string",
}


@dataclass
class Done:
    """A log and its outcome. `report`: relative to the folder of the results."""

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
        """Return the name of the files of a log: readable, and unique."""
        digest = _shorten_digest(str(resolve_path(drive.log)))
        return f"{_clean_name(drive.car)}-{_clean_name(drive.log.stem)}-{digest}"

    def estimates(self, drive: Drive) -> Path:
        (self.out / ESTIMATES).mkdir(exist_ok=True)
        return resolve_path(self.out / ESTIMATES / f"{self.name(drive)}.parquet")

    def calibrated(self, drive: Drive, text: str) -> Path:
        """Write the vehicle file that was calibrated from that of a drive. An
        identical file stays as it is."""
        folder = self.out / CALIBRATED
        folder.mkdir(exist_ok=True)
        path = (
            folder
            / f"{_name_car_files(drive.car)}-{_clean_name(drive.vehicle.stem if drive.vehicle else '')}.toml"
        )
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            with write_atomically(path) as file:
                file.write(text)
        return path

    def load(self, drive: Drive, task: Task) -> Done | None:
        """Return the stored outcome of a log; None unless it was made of the same
        files and settings, by this user, and all its files are there."""
        with contextlib.suppress(ValueError):  # a wrong vehicle file is reported by the run
            kept = read_sealed(self.out / DONE / f"{self.name(drive)}.json")
            if (
                kept is None
                or kept["key"] != compute_key(task)
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
        """Store an outcome: first the report, then the record that the log is done."""
        report = ""
        if outcome.report is not None:
            report = f"{REPORTS}/{self.name(drive)}.html"
            with write_atomically(self.out / report, "wb") as file:
                file.write(outcome.report)
            outcome.report = None
        said = {k: v for k, v in vars(outcome).items() if k != "report"}
        said["learnt"] = base64.b64encode(outcome.learnt or b"").decode()
        kept = results.convert_to_plain({"key": compute_key(task), "report": report, "outcome": said})
        write_sealed(self.out / DONE / f"{self.name(drive)}.json", kept)
        return Done(drive, outcome, report)

    def write(self, done: Sequence[Done]) -> pd.DataFrame:
        """Write the table of all logs, and the learnt state of each car. Return the
        table."""
        for car in {d.drive.car for d in done}:
            mine = [d for d in done if d.drive.car == car and d.outcome.learnt]
            if mine:
                write_learnt(
                    self.out / LEARNT / f"{_name_car_files(car)}.tse", mine[-1].outcome.learnt or b""
                )
        frame = make_table(done)
        with write_atomically(self.out / TABLE, "wb") as file:
            frame.to_parquet(file, index=False)
        return frame


def make_table(done: Sequence[Done]) -> pd.DataFrame:
    """Return a row per log, stretch of road and stiffness; for a log that cannot be
    read one row with its error."""
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
    for log, text in find_unlike_tyres(frame).items():
        mine = frame["log"] == log
        before = frame.loc[mine, "warnings"]
        frame.loc[mine, "warnings"] = (before.fillna("") + "\n" + text).str.strip()
    return frame


def find_unlike_tyres(frame: pd.DataFrame) -> dict[str, str]:
    """Return a sentence for each log whose tyres are much stiffer than in the other logs
    of its car.

    Dry asphalt gives the largest stiffness, so the log may be of another car, load or
    tyres; or all others were on snow. Softer tyres are no sign: wet roads and snow are
    soft."""
    valid = frame[frame["usable"].isin(["yes", "in part"]) & frame["value"].notna()]
    said: dict[str, str] = {}
    for (_, key), mine in valid.groupby(["car", "stiffness"]):
        size = np.log((mine["value"] / mine["nominal"]).astype(float)).groupby(mine["log"])
        most = size.max()
        if len(most) <= MIN_LOGS:
            continue
        for log, x in most.items():
            others = float(np.median(most.drop(log)))
            row = mine.loc[size.idxmax()[log]]
            sure = float(row["sd"]) / float(row["value"]) if pd.notna(row["sd"]) else np.inf
            if x - others > np.log(MAX_RATIO) + 2 * sure:
                text = f"{NAMES[str(key)].lower()} {np.exp(x - others):.1f} times"
                said[str(log)] = f"{said[str(log)]}, {text}" if str(log) in said else text
    return {
        log: f"unlike the other logs of this car, {text} theirs: another car, load or tyres?"
        for log, text in said.items()
    }


def compute_key(task: Task) -> str:
    """Return a digest of everything that an outcome depends on. Logs count by size and
    time: to read them takes as long as to run them."""
    digest = hashlib.sha256()
    reading = Reading(task.signals, task.rate, task.strict, task.databases)
    others = [
        f
        for log, signals in task.others
        for f in (*list_log_files(log), *replace(reading, signals=signals).files(log))
    ]
    for path in sorted({*list_log_files(task.log), *reading.files(task.log), *others}):
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


def _clean_name(name: str) -> str:
    """Return a name that any file system accepts."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._")[:60] or "log"


def _shorten_digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def _name_car_files(name: str) -> str:
    """Return the start of the names of the files of a car: readable, and unique on any
    file system."""
    plain = _clean_name(name)
    return plain if plain == name.lower() else f"{plain}-{_shorten_digest(name)}"
