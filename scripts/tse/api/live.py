"""Estimate tyre stiffness while driving, from a CAN bus: live() and its result."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from tse.api.estimate import read_learnt_state
from tse.api.filter import UNKNOWN_AGE, Convert, make_conversions
from tse.api.generated import Estimate
from tse.api.log import PathLike
from tse.api.vehicle import VehicleLike, check_names, read_vehicle
from tse.calibration.own import is_uncalibrated
from tse.car.config import check_effect, make_config
from tse.channels.signals import MAX_RATE, MIN_RATE, read_signals
from tse.estimation import regimes
from tse.estimation.answer import make_answer
from tse.estimation.estimate import Estimates, write_learnt
from tse.estimation.verdict import Finding
from tse.library.errors import UserError
from tse.report import results
from tse.streaming.drive import LiveDrive, make_bus_opener
from tse.streaming.page import Page

NOT_CALIBRATED = (
    "not calibrated: the filter assumes an ordinary car of its class; tselab calibrate makes the "
    "estimates more accurate"
)


class Live:
    """A running drive, as live() returns it. Iterate over it to get the estimates."""

    def __init__(
        self,
        drive: LiveDrive,
        duration: float | None,
        notes: Sequence[str],
        folder: Path | None,
        car: str = "",
    ):
        self._car = car
        self._drive = drive
        self._page: Page | None = None
        self._ended: tuple[Estimates, list[Finding], list[regimes.Change], list[str]] | None = None
        self._end = math.inf if duration is None else time.monotonic() + duration
        self._stopped = False
        self.notes = tuple(notes)
        """Sentences about the learnt state that the drive started from,
        and about unusual settings."""
        self.folder = folder
        """Folder in which the drive is recorded. None: it is not recorded."""

    def __iter__(self) -> Iterator[Estimate]:
        """Yield the estimates of each row as it arrives, until stop() is called or
        `duration` is over."""
        convert: list[Convert] = []
        while not self.ended:
            times, outputs = self._work()
            if len(times):
                convert = convert or make_conversions(self._drive.config)
            for t, raw in zip(times.tolist(), outputs, strict=True):
                yield _make_estimate(t, raw, convert)

    @property
    def ended(self) -> bool:
        """Whether stop() was called or `duration` is over."""
        return self._stopped or time.monotonic() >= self._end

    def poll(self) -> int:
        """Process the frames that have arrived, and return the number of rows made from
        them. If no frames have arrived, wait for up to 0.1 s.

        Use either this method in a loop, or iteration over the drive. This method is for
        programs that read only `answer` (the present stiffnesses), not the Estimate of
        each row."""
        return len(self._work()[0])

    def _work(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.void]]:
        times, outputs = self._drive.work()
        if self._page is not None and len(times):
            self._page.add(times, outputs)
        return times, outputs

    def serve(self, port: int = 0) -> str:
        """Serve a web page with plots of the drive on this machine, until close().

        Parameters
        ----------
        port
            TCP port; 0: any free one.

        Returns
        -------
        str
            URL of the page.
        """
        self._page = self._page or Page(self._drive, port, self._car)
        return self._page.url

    def __enter__(self) -> Live:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def stop(self) -> None:
        """End the iteration. Any thread may call this."""
        self._stopped = True

    def close(self) -> None:
        """End the drive: process the last frames, close the bus, and complete the files
        in which the drive is recorded."""
        self._drive.close()
        if self._page is not None:
            self._page.close()
            self._page = None

    @property
    def answer(self) -> tuple[str, ...]:
        """Three lines: each stiffness with its 95 % interval. During the drive, the
        values are the present estimates. After close(), they are the results of the whole
        drive."""
        found = self._get_result()[1] if self._drive.closed else self._drive.now()
        return tuple(make_answer(found, self._drive.config))

    @property
    def said(self) -> tuple[tuple[float, str], ...]:
        """Events of bus, road and sensors so far, as pairs (time [s], sentence). The time
        is on the same clock as Estimate.time."""
        return tuple(self._drive.said)

    @property
    def learnt(self) -> bytes | None:
        """After close(), the learnt state, to be passed as `learnt` for the next drive.
        None: nothing was learnt, or the channels contradict each other."""
        return self._get_result()[0].learnt

    def save_learnt(self, path: PathLike) -> Path:
        """Write the learnt state to a file, for the next drive. Raise
        Error if nothing was learnt."""
        learnt = self.learnt
        if learnt is None:
            raise UserError(
                f"nothing was learnt, so {path} is not written: no row was used, or channels contradict "
                "each other"
            )
        write_learnt(Path(path), learnt)
        return Path(path)

    @property
    def settings(self) -> dict[str, float | int]:
        """All settings of the filter by name."""
        return self._drive.config.as_dict()

    @property
    def rows(self) -> int:
        """Number of rows so far."""
        return self._drive.drive.rows

    @property
    def numbers(self) -> str:
        """Sentence with the number of frames and rows, the rate of the rows, and the
        delay of the estimates."""
        return self._drive.numbers()

    @property
    def exit_code(self) -> int:
        """After close(), the exit code of `tselab live`: 0 usable, 3 usable in part, 4
        nothing usable."""
        found = self._get_result()[1]
        return results.choose_exit_code(found) if found else results.NOTHING

    def to_dict(self) -> dict[str, Any]:
        """Return what `tselab live --json` prints, as a dict. Call close() first."""
        est, found, _, against = self._get_result()
        said: dict[str, Any] = {
            "vehicle": self._drive.vehicle.path,
            "record": self.folder,
            "frames": self._drive.drive.frames,
            "warnings": against,
            "started_from": self._drive.started_from,
            "events": [{"time": t, "text": text} for t, text in self.said],
        }
        log = self._get_rows_path()
        nothing = {"log": str(log), **said, "rows": 0, "usable": "no", "exit_code": results.NOTHING}
        document = results.make_document(log, est, found, self._drive.config, said) if found else nothing
        made: dict[str, Any] = results.convert_to_plain(document)
        return made

    def write_table(self, path: PathLike) -> Path:
        """Write the table of `tselab live --table`: Parquet if `path` ends in .parquet,
        otherwise CSV. Call close() first."""
        rows = results.make_rows(self._get_rows_path(), *self._get_result())
        results.write_rows(Path(path), rows, results.ESTIMATE_COLUMNS)
        return Path(path)

    def _get_rows_path(self) -> Path:
        return (self.folder if self.folder is not None else Path()) / "rows.csv"

    def _get_result(self) -> tuple[Estimates, list[Finding], list[regimes.Change], list[str]]:
        """Return the estimates so far, the findings about each stiffness, the detected
        changes of the stiffness, and sentences about channels that contradict each other.
        Before close(), each call computes them from all rows so far. After close(), they
        are computed only once."""
        if not self._drive.closed:
            return self._drive.result()
        self._ended = self._ended or self._drive.result()
        return self._ended


def live(
    vehicle: VehicleLike,
    *,
    database: PathLike | Sequence[PathLike],
    interface: str | None = None,
    channel: str | None = None,
    bus: Any = None,
    signals: PathLike | None = None,
    out: PathLike | None = None,
    settings: Mapping[str, float] | None = None,
    config: PathLike | None = None,
    learnt: bytes | os.PathLike[str] | None = None,
    age: float = UNKNOWN_AGE,
    rate: float | None = None,
    duration: float | None = None,
    say: Callable[[str], None] | None = None,
    **options: Any,
) -> Live:
    """Estimate tyre stiffness while driving, from a CAN bus.

        with tse.live("car.toml", database="car.dbc", interface="socketcan",
        channel="can0") as drive:
            for e in drive:
                if e.cy_front_valid:
                    print(e.time, e.cy_front, e.cy_front_sd)

    Parameters
    ----------
    vehicle
        A vehicle file, a mapping with its keys, or the result of read_vehicle().
    database
        One or several databases that define the frames: DBC, ARXML, KCD or SYM.
    interface, channel
        Interface and channel of python-can, for instance "socketcan" and "can0".
    bus
        An open bus of python-can, instead of `interface` and `channel`. It
        is shut down at the end.
    signals
        The file that assigns signals of the bus to channels. None: the file signals.toml
        in the folder of the database is used. If there is no such file, the signal of
        each channel is proposed from the received frames.
    out
        An empty or new folder in which the drive is recorded, as by `tselab live`. None:
        the drive is not recorded.
    settings
        Any settings by name. They override `config` and the vehicle.
    config
        A file of settings, such as FILTER.toml.
    learnt
        Learnt state of an earlier drive of this vehicle (Live.learnt or Result.learnt),
        or the Path of a file with it.
    age
        [s] Time since the drive on which `learnt` was learnt. By default, it is the age
        of the file if `learnt` is a Path, and unknown if `learnt` is bytes.
    rate
        [Hz] Number of rows per second. None: the rate of the fastest channel, but at most
        100 Hz.
    duration
        [s] Time after which the iteration ends. None: it ends at stop().
    say
        Called with a sentence for each event, such as a change of the road or a message
        that is no longer received. The call may come from any thread.
    **options
        Options of the interface, such as bitrate=500000.

    Returns
    -------
    Live
        The running drive. `tselab live` computes the same estimates bit by bit, and so
        does estimate() from the recorded rows with the same settings.

    Raises
    ------
    Error
        The bus cannot be opened, the databases lack a signal that `signals` names, a
        value is outside its range, or the folder `out` is not empty. The error is also a
        ValueError.
    """
    if (bus is None) == (interface is None):
        raise TypeError("live() needs either an interface or an open bus: give one of them")
    databases = (
        [Path(database)]
        if isinstance(database, str | Path) or hasattr(database, "__fspath__")
        else [*map(Path, database)]
    )
    if not databases:
        raise TypeError("live() needs a database, which defines the frames of the bus")
    if rate is not None and not MIN_RATE <= rate <= MAX_RATE:
        raise UserError(f"rate: {rate:g} is outside its range {MIN_RATE:g} .. {MAX_RATE:g} Hz")
    car = read_vehicle(vehicle)
    made, notes = make_config(car, None, None if config is None else Path(config))
    for name, value in check_names(settings).items():
        made.set(name, value)
    check_effect(settings or {}, made)
    signals_path = Path(signals) if signals is not None else databases[0].parent / "signals.toml"
    mapped = read_signals(signals_path) if signals is not None or signals_path.is_file() else None
    before = read_learnt_state(learnt, age)
    opened = (lambda: bus) if bus is not None else make_bus_opener(str(interface), channel, **options)
    tell = say if say is not None else lambda _: None
    folder = None if out is None else Path(out)
    drive = LiveDrive(opened, databases, car, made, mapped, folder, before, rate, tell)
    started = [f"started from: {before.note}"] if before is not None else []
    about = NOT_CALIBRATED if is_uncalibrated(car) else ""
    return Live(drive, duration, [*started, *([about] if about else []), *notes], folder, about)


def _make_estimate(time_: float, raw: np.void, convert: list[Convert]) -> Estimate:
    values: list[Any] = [time_]
    for value, make in zip(raw.item(), convert, strict=True):
        values.extend(make(value))
    return Estimate(*values)
