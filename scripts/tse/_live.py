"""The filter while driving: estimates from a CAN bus."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from tse._filter import UNKNOWN_AGE, Convert, _conversions
from tse._log import PathLike
from tse._tables import Estimate
from tse._vehicle import VehicleLike, named, read_vehicle
from tse.car.config import check_effect, make_config
from tse.channels.signals import read_signals
from tse.estimation.answer import answer
from tse.estimation.estimate import Learnt
from tse.streaming.drive import Live as _Live
from tse.streaming.drive import bus_opener


class Live:
    """A drive that goes on: iterate over it for its estimates. What live() returns."""

    def __init__(self, drive: _Live, duration: float | None):
        self._drive = drive
        self._end = math.inf if duration is None else time.monotonic() + duration
        self._stopped = False

    def __iter__(self) -> Iterator[Estimate]:
        """Yield the estimates of each row as it comes, until stop() or the end of `duration`."""
        convert: list[Convert] = []
        while not self._stopped and time.monotonic() < self._end:
            times, outputs = self._drive.work()
            if len(times):
                convert = convert or _conversions(self._drive.config)
            for t, raw in zip(times.tolist(), outputs, strict=True):
                yield _estimate(t, raw, convert)

    def __enter__(self) -> Live:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def stop(self) -> None:
        """End the iteration; from any thread."""
        self._stopped = True

    def close(self) -> None:
        """Let go of the bus, and finish the record."""
        self._drive.close()

    @property
    def answer(self) -> tuple[str, ...]:
        """Three lines: each stiffness now with its 95 % interval; after close() what the whole drive says."""
        found = self._drive.result()[1] if self._drive.closed else self._drive.now()
        return tuple(answer(found, self._drive.config))

    @property
    def said(self) -> tuple[tuple[float, str], ...]:
        """What happened, each with its time, s: of the bus, of the road, of the sensors."""
        return tuple(self._drive.said)

    @property
    def learnt(self) -> bytes | None:
        """What the drive taught, after close(), for the next one: the argument `learnt`. None: nothing, or its channels contradict
        each other."""
        return self._drive.result()[0].learnt

    @property
    def settings(self) -> dict[str, float | int]:
        """All settings, by name."""
        return self._drive.config.as_dict()


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
    learnt: bytes | None = None,
    age: float = UNKNOWN_AGE,
    rate: float | None = None,
    duration: float | None = None,
    say: Callable[[str], None] | None = None,
    **options: Any,
) -> Live:
    """Estimate tyre stiffness while driving, from a CAN bus.

        with tse.live("car.toml", database="car.dbc", interface="socketcan", channel="can0") as drive:
            for e in drive:
                if e.cy_front_valid:
                    print(e.time, e.cy_front, e.cy_front_sd)

    Parameters
    ----------
    vehicle
        A vehicle file, a mapping with its keys, or what read_vehicle() returned.
    database
        What the frames mean: DBC, ARXML, KCD, SYM; one, or several.
    interface, channel
        Of python-can: "socketcan" and "can0", for instance.
    bus
        A bus of python-can that is open, in their place; it is shut down at the end.
    signals
        signals.toml; None: the one beside the database, else signals are proposed from what comes.
    out
        An empty or new folder where the drive is recorded, as by `tselab live`; None: nowhere.
    settings
        Any settings by name; they win.
    learnt
        What an earlier drive has taught (Live.learnt, Result.learnt), of this vehicle.
    age
        s since that drive.
    rate
        Rows per second; None: those of the fastest channel, up to 100.
    duration
        s after which the iteration ends; None: at stop().
    say
        Is given a sentence when something happens: a road that changes, a message that stops. From any thread.
    **options
        Of the interface: bitrate=500000.

    Returns
    -------
    Live
        Its estimates have the bits of `tselab live`, and of estimate() over the rows of the record with its settings.

    Raises
    ------
    Error
        A bus that cannot be opened, a signal that no database has, a folder that is not empty; a ValueError.
    """
    if (bus is None) == (interface is None):
        raise TypeError("live() needs an interface, or a bus that is open")
    databases = (
        [Path(database)]
        if isinstance(database, str | Path) or hasattr(database, "__fspath__")
        else [*map(Path, database)]
    )
    if not databases:
        raise TypeError("live() needs a database: what the frames of the bus mean")
    car = read_vehicle(vehicle)
    config, _ = make_config(car, None)
    for name, value in named(settings).items():
        config.set(name, value)
    check_effect(settings or {}, config)
    beside = Path(signals) if signals is not None else databases[0].parent / "signals.toml"
    mapped = read_signals(beside) if signals is not None or beside.is_file() else None
    before = None if learnt is None else Learnt(Path("learnt"), learnt, age, True)
    opened = (lambda: bus) if bus is not None else bus_opener(str(interface), channel, **options)
    tell = say if say is not None else lambda _: None
    folder = None if out is None else Path(out)
    return Live(_Live(opened, databases, car, config, mapped, folder, before, rate, tell), duration)


def _estimate(time_: float, raw: np.void, convert: list[Convert]) -> Estimate:
    values: list[Any] = [time_]
    for value, make in zip(raw.item(), convert, strict=True):
        values.extend(make(value))
    return Estimate(*values)
