"""Store the results of a fleet, in a file for each log, so that a later call need not run
the logs again. Write the table of all logs."""

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
from tse.channels.signals import find_signals
from tse.estimation.estimate import write_learnt
from tse.estimation.verdict import NAMES
from tse.library.errors import UserError
from tse.library.files import make_directory, read_sealed, resolve_path, write_atomically, write_sealed
from tse.log.rows import Reading, list_log_files
from tse.readers.read_can import find_databases
from tse.report import results
from tse.runs.find import Drive
from tse.runs.work import Outcome, Task

TABLE, PAGE = "fleet.parquet", "fleet.html"
DONE, REPORTS, LEARNT, ESTIMATES, CALIBRATED = "logs", "reports", "learnt", "estimates", "calibrated"
# The stiffnesses of a log are compared with those of the other logs of the same car only
# if there are at least this many other logs
MIN_LOGS = 3
# Max ratio: stiffness in a log / median of this stiffness in the other logs of the car.
# Smaller ratios are normal even if all logs are on dry asphalt, because a tyre is stiffer
# when it is cold. There is a warning if ln(ratio) exceeds ln(MAX_STIFFNESS_RATIO) by more
# than 2 sd of ln(stiffness in the log)
MAX_STIFFNESS_RATIO = 1.3
# Columns of the table fleet.parquet, and their types. The columns of
# results.ESTIMATE_COLUMNS describe the estimate, the other columns describe the drive
FLEET_COLUMNS: dict[str, str] = {
    "car": "string",
    **{"log": "string", "start_time": "datetime64[us, UTC]", "start_from": "string", "seconds": "Float64"},
    **{k: v for k, v in results.ESTIMATE_COLUMNS.items() if k != "log"},
    "error": "string",
    "report": "string",
    "vehicle": "string",
}


@dataclass
class Done:
    """A log that has been estimated, or that cannot be estimated, and its outcome."""

    drive: Drive
    outcome: Outcome
    report: str = ""  # path of the report, relative to the folder of the results; empty: no report


class Store:
    """The folder of the results of a fleet.

    It stores the outcome of each log, i.e. the result of its run or its error (work.py).
    `restart`: delete the stored outcomes, so that all logs run again."""

    def __init__(self, out: Path, restart: bool):
        self.out = out
        for folder in (out, *(out / name for name in (DONE, REPORTS, LEARNT))):
            make_directory(folder)
        if restart:
            for old in (out / DONE).glob("*.json"):
                old.unlink()

    def name(self, drive: Drive) -> str:
        """Return the name of the files of a log, without suffix: the names of car and
        log, made unique by a digest of the path."""
        digest = _shorten_digest(str(resolve_path(drive.log)))
        return f"{_clean_name(drive.car)}-{_clean_name(drive.log.stem)}-{digest}"

    def estimates(self, drive: Drive) -> Path:
        """Return the path of the Parquet file for the estimates of a log."""
        (self.out / ESTIMATES).mkdir(exist_ok=True)
        return resolve_path(self.out / ESTIMATES / f"{self.name(drive)}.parquet")

    def calibrated(self, drive: Drive, text: str) -> Path:
        """Write the calibrated vehicle file of the car of `drive`, and return its path.

        `text`: content of the file. If the file has a different content, it is replaced.
        If it has this content already, it is not written again."""
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
        """Return the stored outcome of a log, or None if the log has to run. The log has
        to run if no outcome for the same files and settings is stored, if a different
        user wrote the stored outcome, or if one of the result files is missing."""
        with contextlib.suppress(ValueError):  # a wrong vehicle file is reported when the log is estimated
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
        """Store an outcome: first write its report, then record the log as done. If the
        process is killed between the two, the log is not done and runs again."""
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
        """Write the table of all logs, and for each car the state that the filter had
        learnt after the last drive of the car. Return the table."""
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
    """Return a table with a row for each log, stretch of road and stiffness. A log that
    could not be estimated has one row with its error."""
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
    frame = pd.DataFrame(rows, columns=list(FLEET_COLUMNS)).astype(dict(FLEET_COLUMNS))
    for log, text in find_unlike_tyres(frame).items():
        mine = frame["log"] == log
        before = frame.loc[mine, "warnings"]
        frame.loc[mine, "warnings"] = (before.fillna("") + "\n" + text).str.strip()
    return frame


def find_unlike_tyres(frame: pd.DataFrame) -> dict[str, str]:
    """Return a warning for each log in which a stiffness is much larger than in the other
    logs of its car.

    For each stiffness, the largest ratio to nominal in a log is compared with the median
    of this ratio over the other logs. Usually most of the other logs are on dry asphalt,
    where the stiffness is largest. A ratio much above the median then means that car,
    load or tyres differ. The warning is wrong if, for example, most of the other logs are
    on snow. A ratio below the median gives no warning, because a wet road explains it."""
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
            if x - others > np.log(MAX_STIFFNESS_RATIO) + 2 * sure:
                text = f"{NAMES[str(key)].lower()} {np.exp(x - others):.1f} times"
                said[str(log)] = f"{said[str(log)]}, {text}" if str(log) in said else text
    return {
        log: f"compared with the other logs of this car, {text} as large: check car, load and tyres"
        for log, text in said.items()
    }


def compute_key(task: Task) -> str:
    """Return a digest of everything that the outcome of a log depends on. It is stored
    with the outcome. If a later call finds a different digest, the log runs again.

    Of the log, its signals.toml and its CAN databases, the digest uses size and
    modification time instead of the content, because reading a log would take as long as
    estimating it."""
    digest = hashlib.sha256()
    reading = Reading(task.signals, task.rate, task.strict, task.databases)
    others = [f for log, signals in task.others for f in _list_inputs(log, replace(reading, signals=signals))]
    for path in sorted({*_list_inputs(task.log, reading), *others}):
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


def _list_inputs(log: Path, reading: Reading) -> list[Path]:
    """Return the files that determine the rows of a log: the files of the log itself, its
    signals.toml, and its CAN databases. The databases are those that an option or
    signals.toml names or, if neither names any, those in the folder of the log."""
    found = [*list_log_files(log), *reading.files(log)]
    with contextlib.suppress(UserError, OSError):  # a wrong file is reported by the run
        _, how = find_signals(log, reading.signals, reading.databases)
        found += find_databases(log, how, required=False)
    return found


def _clean_name(name: str) -> str:
    """Return a name that every file system allows: at most 60 letters, digits, "_", "-"
    and ".". All other characters become "_". If nothing is left, return "log"."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._")[:60] or "log"


def _shorten_digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def _name_car_files(name: str) -> str:
    """Return the name of a car for use in names of files. A digest makes it unique if
    _clean_name() changes it, or if it has capital letters, because some file systems do
    not distinguish capital from small letters."""
    plain = _clean_name(name)
    return plain if plain == name.lower() else f"{plain}-{_shorten_digest(name)}"
