"""Run the filter on the frames of a CAN bus while driving, and record the drive.

A channel is an input of the filter, such as yaw_rate. A row is the set of all channels at
one time, interpolated from the signals in the frames. The filter makes one step for each
row. Events, such as a failure of the bus, are reported to the user as sentences of text.
After a failure of the bus the filter continues as soon as frames arrive again.
"""

from __future__ import annotations

import gc
import re
import shutil
import tempfile
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
import pandas as pd

from tse.car.config import set_sampling
from tse.car.vehicle import Vehicle
from tse.channels.agree import check_car, select_certain
from tse.channels.look import Proposal
from tse.channels.proposal import format_headline, format_signals, propose
from tse.channels.signals import SignalsFile, read_signals
from tse.channels.stream import Stream
from tse.estimation import regimes
from tse.estimation.estimate import (
    MAX_SUMMARY,
    SUMMARY,
    Estimates,
    Learnt,
    convert_to_single,
    make_block,
    make_csv_header,
    make_csv_rows,
    mark_implausible,
)
from tse.estimation.regimes import Change
from tse.estimation.verdict import Finding, Verdict, describe_implausible, make_findings
from tse.library.core import INPUT, NOMINAL, OUTPUT, REASON, STIFFNESS, Config, NativeFilter, library
from tse.library.errors import UserError
from tse.library.files import make_directory
from tse.log.rows import check_log, fill_optional, select_liveliest
from tse.log.units import unit_factor
from tse.readers.bus_text import CanFrame
from tse.readers.read_can import Bus
from tse.readers.recording import ReadOptions, Recording, import_optional, list_names

TICK = 0.002  # [s] min time between two calls that process frames
# [s] time without a frame from the bus, or without a value of a channel, after which this
# is reported to the user
SILENT = 1.0
REOPENED = 1.0  # [s] time between two attempts to open a bus that failed
# [s] time after the first frame. If the databases define none of the frames received
# until then, a sentence informs the user that the databases describe a different bus
FOREIGN = 2.0
SAID_AGAIN = 10.0  # [s] min time between two sentences about error frames
# At intervals, check_car() compares the channels with each other. It finds
# contradictions, such as a yaw rate with the wrong sign or unit. The first check is made
# FIRST_CHECK [s] after time 0 of the record. CHECKED: [s] time between two checks
FIRST_CHECK, CHECKED = 10.0, 20.0
MAX_CHECKED = 60_000  # max number of rows that a check uses: ten minutes at 100 Hz
# If the user names no signals, propose() searches the received frames for the signal of
# each channel. LISTENED: [s] time for which frames are collected before the first search,
# and between two searches. MAX_LISTENED: [s] max time between the first and the last of
# the frames that are kept for the searches
LISTENED, MAX_LISTENED = 20.0, 600.0
# [s] max time from the first to the last of the frames that are processed together.
# Frames from a longer time are split into several pieces by _cut_pieces()
MAX_PIECE_TIME = 0.2
WRITE_INTERVAL = 1.0  # [s] time between two writes of rows
# Only the last EVENT_SEARCH_TIME [s] of the drive are searched for events. A change of
# the stiffness is reported if it began more than MIN_EVENT_AGE [s] ago, a fault of a
# sensor or sliding if it lasted longer than MIN_EVENT_AGE
EVENT_SEARCH_TIME, MIN_EVENT_AGE = 20.0, 0.5
BUS_OFF, RESTARTED = 0x40, 0x100  # bits in the identifier of an error frame of SocketCAN

Say = Callable[[str], None]


# ---- The bus


@dataclass(frozen=True)
class Arrived:
    """A received frame."""

    frame: CanFrame
    at: float  # [s] time of arrival, time.monotonic()


class Reader(threading.Thread):
    """Thread that reads a bus. If the bus fails, the thread opens it again.

    Parameters
    ----------
    open_bus : callable
        Returns an open bus of python-can.
    say : callable
        Called with a sentence for each event of the bus.
    record : callable
        Called with each message of python-can.
    """

    def __init__(self, open_bus: Callable[[], Any], say: Say, record: Callable[[Any], None]):
        super().__init__(daemon=True, name="bus")
        self._open, self._say, self._record = open_bus, say, record
        self._bus = open_bus()  # not in the thread, so that the caller gets an error of open_bus()
        self._came: deque[Arrived] = deque()
        self._there, self._ended = threading.Event(), threading.Event()
        self.count = 0
        self.errors = 0

    def take(self, timeout: float) -> list[Arrived]:
        """Return the frames received since the last call. If there are none, wait for up
        to `timeout` s."""
        self._there.wait(timeout)
        self._there.clear()
        found = []
        while self._came:
            found.append(self._came.popleft())
        return found

    def stop(self) -> None:
        """Stop the thread, and close the bus."""
        self._ended.set()
        if self.is_alive():
            self.join(2.0)
        if self._bus is not None:
            self._bus.shutdown()

    def run(self) -> None:
        """Read frames until stop() is called. If the bus fails, open it again."""
        said_errors = -SAID_AGAIN
        while not self._ended.is_set():
            try:
                if self._bus is None:
                    self._bus = self._open()
                    self._say("the bus is open again")
                message = self._bus.recv(0.2)
            except Exception as error:  # the type of the error depends on the CAN driver
                self._fail(error)
                continue
            if message is None:
                continue
            if message.is_error_frame:
                self.errors += 1
                if message.arbitration_id & BUS_OFF and not message.arbitration_id & RESTARTED:
                    self._say(
                        "the bus is off: the CAN controller has disconnected after too many errors: check "
                        "bit rate and wiring; the filter goes on when the controller reconnects"
                    )
                elif time.monotonic() - said_errors > SAID_AGAIN:
                    said_errors = time.monotonic()
                    self._say(
                        f"{self.errors} error frame{'s' if self.errors > 1 else ''} on the bus so far: "
                        "check bit rate and wiring"
                    )
                continue
            if message.is_remote_frame:
                continue
            self.count += 1
            self._record(message)
            bus = str(message.channel or 0)
            frame = CanFrame(
                message.timestamp, message.arbitration_id, message.is_extended_id, bus, bytes(message.data)
            )
            self._came.append(Arrived(frame, time.monotonic()))
            self._there.set()

    def _fail(self, error: Exception) -> None:
        """Report an error of the bus, close the bus, and wait REOPENED seconds before the
        next attempt to open it."""
        if self._bus is not None and not self._ended.is_set():
            self._say(
                f"the bus failed ({str(error)[:120] or type(error).__name__}): tselab tries "
                "each second to open the bus again; filter and recording then go on"
            )
        try:
            if self._bus is not None:
                self._bus.shutdown()
        except Exception:  # the failure of the bus has already been reported
            pass
        self._bus = None
        self._ended.wait(REOPENED)


def make_bus_opener(interface: str, channel: str | None, **more: Any) -> Callable[[], Any]:
    """Return a function that opens a bus of python-can. If the bus cannot be opened, that
    function raises UserError with the message of the CAN driver.

    `more`: further options of the interface."""
    can = import_optional("can", "can", f"live, interface {interface}")

    def opened() -> Any:
        try:
            return can.Bus(interface=interface, channel=channel, **more)
        except Exception as error:  # the type of the error depends on the CAN driver
            raise UserError(
                f"interface {interface}, channel {channel}: cannot be opened: "
                f"{str(error)[:200] or type(error).__name__}"
            ) from None

    return opened


# ---- The record


class Record:
    """Folder in which a drive is recorded: received frames, rows of the
    filter, estimates and events.

    If the folder cannot be written, `say` is called with a sentence about it, recording
    ends, and the filter goes on. If `folder` is None, nothing is recorded."""

    def __init__(self, folder: Path | None, say: Say):
        self._own = tempfile.TemporaryDirectory(prefix="tselab-") if folder is None else None
        self.folder = Path(self._own.name) if self._own is not None else Path(str(folder))
        if folder is not None:
            make_directory(folder)
            if any(folder.iterdir()):
                raise UserError(f"{folder}: is not empty: give a new or empty folder for the drive")
        self._say = say
        self._frames: Any = None
        self._files: dict[str, IO[bytes]] = {}
        self._lock = threading.Lock()
        self._failed = folder is None

    def frame(self, message: Any) -> None:
        """Record a message of python-can."""
        if self._frames is None and not self._failed:
            can = import_optional("can", "can", "live")
            self._run_guarded(
                lambda: setattr(self, "_frames", can.BLFWriter(str(self.folder / "frames.blf")))
            )
        if self._frames is not None and not self._failed:
            self._run_guarded(lambda: self._frames.on_message_received(message))

    def write(self, name: str, data: bytes) -> None:
        """Append to a file of the folder."""

        def append() -> None:
            with self._lock:
                if name not in self._files:
                    self._files[name] = open(self.folder / name, "ab")  # noqa: SIM115 - until close()
                self._files[name].write(data)
                self._files[name].flush()

        if not self._failed:
            self._run_guarded(append)

    def _run_guarded(self, act: Callable[[], None]) -> None:
        """Call a function that writes. If it fails, report it and end recording."""
        try:
            act()
        except OSError as error:
            self._failed = True
            self._say(
                f"{self.folder}: cannot be written ({error.strerror or error}): the filter goes on, but "
                "the drive is no longer recorded"
            )

    def close(self) -> None:
        """Close all files. Delete the folder if it is temporary."""
        if self._frames is not None:
            self._run_guarded(self._frames.stop)
        for file in self._files.values():
            file.close()
        if self._own is not None:
            self._own.cleanup()


# ---- The drive


@dataclass
class DriveState:
    """Progress of a drive, for display."""

    rows: int = 0
    frames: int = 0
    first: float = 0.0  # [s] time of the first row
    time: float = 0.0  # [s] time of the last row
    # [s] delay from the arrival of a frame to the estimate: max over the last second
    delay: float = 0.0
    # [s] delay of each row, from the arrival of a frame to the estimate. Rows made from
    # frames that were collected before the signals were known are left out
    delays: list[float] = field(default_factory=list)
    statuses: Counter[int] = field(default_factory=Counter)  # number of rows for each status
    contradicted: list[str] = field(default_factory=list)  # sentences on contradicting channels


class LiveDrive:
    """A drive: reads a bus, makes rows from the frames, runs the filter, and records.

    Parameters
    ----------
    open_bus : callable
        Returns an open bus of python-can (make_bus_opener()).
    databases : sequence of Path
        Databases that define the frames.
    vehicle : Vehicle
        The car.
    config : Config
        Settings of the filter.
    signals : SignalsFile or None
        Assignment of signals to channels; None: propose() derives it from the received
        frames.
    folder : Path or None
        Folder in which the drive is recorded; None: it is not recorded.
    learnt : Learnt, optional
        State that the filter saved after an earlier drive, and from which this drive
        starts: stiffness, grip, sensor biases, and offset, ratio and latency of the
        steering. None: the filter starts from the settings.
    rate : float, optional
        [Hz] Rate of the rows. By default, the rate of the fastest channel, at most 100.
    say : callable
        Called with a sentence for each event.
    """

    def __init__(
        self,
        open_bus: Callable[[], Any],
        databases: Sequence[Path],
        vehicle: Vehicle,
        config: Config,
        signals: SignalsFile | None,
        folder: Path | None,
        learnt: Learnt | None = None,
        rate: float | None = None,
        say: Say = lambda _: None,
    ):
        self.vehicle, self.config, self.databases = vehicle, config, tuple(databases)
        self._tell, self._signals, self._rate, self._learnt = say, signals, rate, learnt
        self._plain = config.as_dict()
        self.said: list[tuple[float, str]] = []
        self.drive = DriveState()
        self._bus: Bus | None = None
        self.stream: Stream | None = None
        self._notes_of_bus: list[str] = []
        if signals is not None:
            self.stream = Stream(self.databases, signals, vehicle, rate)
        else:
            self._bus = Bus(Path("the bus"), self.databases, ReadOptions())
        if learnt is not None:
            # load() raises UserError if the state is damaged or of another vehicle. It is
            # called here, so that this error comes before the drive begins
            learnt.load(NativeFilter(config))
        self.filter: NativeFilter | None = None
        self._valid = dict.fromkeys(STIFFNESS, 0)  # number of rows in which each stiffness was valid
        self.reader = Reader(open_bus, self.say, lambda message: self.record.frame(message))
        try:
            self.record = Record(folder, self.say)
        except BaseException:
            self.reader.stop()
            raise
        self._copy_inputs()
        self._proposing: threading.Thread | None = None
        self._proposed: SignalsFile | None = None
        self._listened: list[Arrived] = []
        self._next_proposal = LISTENED
        self._origin = float("nan")  # [s] time of the bus at time 0 of the record
        # rows that are not written yet: times, columns, outputs
        self._pending: deque[tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]] = deque()
        self._written = 0  # number of written rows
        # the last written rows: for each call of _write() a dict of columns
        self._columns: deque[dict[str, np.ndarray]] = deque()
        # every `_stride`-th written row: dicts of the columns that are listed in SUMMARY
        self._table: list[dict[str, Any]] = []
        self._stride = 1
        self._ended = threading.Event()
        self._keeper = threading.Thread(target=self._run_keeper, daemon=True, name="record")
        self._next_check = FIRST_CHECK
        self._said_once: set[str] = set()
        self._silent: dict[str, float] = {}
        self._happened: list[tuple[str, float]] = []
        self._last_frame = time.monotonic()
        self._first_frame = float("inf")
        self._quiet = self._foreign = False
        self._last_tick = 0.0
        self._recent: deque[tuple[float, float]] = deque()
        self.last: np.ndarray | None = None  # output of the last row
        self.closed = False
        _warm_up(config)
        gc.collect()
        # exclude the objects loaded so far from garbage collection: scanning them would
        # take longer than the time between two rows
        gc.freeze()
        self.reader.start()
        self._keeper.start()

    @property
    def started_from(self) -> str | None:
        """Path and age of the learnt state from which the filter started, as a string.
        None: the filter started without a learnt state."""
        return self._learnt.note if self._learnt is not None else None

    def _copy_inputs(self) -> None:
        """Copy databases, signals and learnt state to the folder of the record, so that
        `tselab estimate` can estimate the recorded frames later."""
        folder = self.record.folder
        for p in self.databases:
            shutil.copyfile(p, folder / p.name)
        if self._signals is not None and self._signals.path is not None:
            text = self._signals.path.read_text(encoding="utf-8-sig")
            text = re.sub(r"(?m)^\s*databases\s*=.*\n", "", text)  # the databases are now in the same folder
            self.record.write("frames.signals.toml", text.encode())
        if self._learnt is not None:
            self.record.write("before.tse", self._learnt.data)

    # ---- sentences that report events to the user

    def say(self, text: str) -> None:
        """Report an event as a sentence, and record it."""
        at = self.drive.time
        self.said.append((at, text))
        self.record.write("events.txt", f"{at:.2f} s: {text}\n".encode())
        self._tell(text)

    def _say_once(self, text: str) -> None:
        """Report an event, unless a sentence that differs only in its numbers has been
        reported before."""
        plain = re.sub(r"[\d.]+", "#", text)
        if plain not in self._said_once:
            self._said_once.add(plain)
            self.say(text)

    # ---- main loop: the caller repeats work() until the drive ends

    def work(self, timeout: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
        """Process the received frames; if there are none, wait for up to `timeout` s.
        Return times and outputs of the rows that were made from them."""
        came = self.reader.take(timeout)
        if came and (rest := self._last_tick + TICK - time.monotonic()) > 0:
            time.sleep(rest)
            came += self.reader.take(0.0)
        self._last_tick = now = time.monotonic()
        self.drive.frames += len(came)
        self._look_at_bus(came, now)
        if self.stream is None:
            self._listen(came, now)
            if self.stream is None:
                return np.zeros(0), self._make_no_outputs()
            came, self._listened = self._listened, []  # the signals are known: use all frames so far
        made = []
        for part in _cut_pieces(came) or [[]]:
            for text in self.stream.add([a.frame for a in part]):
                self.say(text)
            made.append(self._step(part, now))
        times, outputs = (np.concatenate([m[i] for m in made]) for i in (0, 1))
        self._look_at_channels()
        return times, outputs

    def _run_keeper(self) -> None:
        """Write rows, report events and check the channels at intervals, until the drive
        ends. Runs in a separate thread, so that the filter does not wait for it."""
        while not self._ended.wait(WRITE_INTERVAL):
            self._write()
            self._look_back()
            if self.drive.time > self._next_check and self._columns:
                self._next_check = self.drive.time + CHECKED
                self._check_channels(list(self._columns))

    def _make_no_outputs(self) -> np.ndarray:
        return np.zeros(0, library().dtype(OUTPUT))

    def _look_at_bus(self, came: Sequence[Arrived], now: float) -> None:
        """Report if no frame has arrived for SILENT seconds, if frames arrive again after
        that, and if no frame of the bus is in the databases.

        `came`: frames since the last call. `now`: [s] time.monotonic()."""
        if came:
            if self._quiet:
                self.say(f"frames arrive again, after {now - self._last_frame:.1f} s without a frame")
            self._last_frame, self._quiet = now, False
            self._first_frame = min(self._first_frame, now)
        elif not self._quiet and now > self._last_frame + SILENT:
            self._quiet = True
            self.say("no frame for a second: the bus may be asleep or off; check interface and channel")
        if self._foreign or now < self._first_frame + FOREIGN:
            return
        known, unknown = (self.stream.known, self.stream.unknown) if self.stream else self._count()
        if unknown and not known:
            self._foreign = True
            few = list_names(f"{i:#x}" for i in sorted(unknown))
            names = ", ".join(p.name for p in self.databases)
            self.say(
                f"none of the {len(unknown)} identifiers ({few}) is in {names}: the databases describe "
                "a different bus"
            )

    def _count(self) -> tuple[int, dict[int, int]]:
        """Return the number of frames whose identifier is in a database, and for each
        other identifier the number of its frames. Only used while the signals of the
        channels are not known. Afterwards, self.stream exists and counts the frames."""
        seen = Counter(a.frame.identifier for a in self._listened)
        known = sum(n for i, n in seen.items() if self._bus is not None and self._bus.knows(i))
        return known, {i: n for i, n in seen.items() if self._bus is None or not self._bus.knows(i)}

    # ---- proposed signals

    def _listen(self, came: Sequence[Arrived], now: float) -> None:
        """Collect frames. At intervals start a thread that searches the collected frames
        for the signal of each channel. When the thread has found the signals, begin to
        make rows."""
        self._listened += came
        if self._listened and self._listened[-1].frame.time - self._listened[0].frame.time > MAX_LISTENED:
            del self._listened[: len(self._listened) // 2]
        if self._proposing is not None:
            if self._proposing.is_alive():
                return
            self._proposing = None
            if self._proposed is not None:
                self._begin_with(self._proposed)
            return
        if now > self._first_frame + self._next_proposal:
            self._next_proposal = now - self._first_frame + LISTENED
            self._proposing = threading.Thread(
                target=self._propose, args=(list(self._listened),), daemon=True
            )
            self._proposing.start()

    def _propose(self, came: list[Arrived]) -> None:
        """Search the received frames for the signal of each channel, and write the result
        to frames.signals.toml. Runs in a separate thread."""
        try:
            notes: list[str] = []
            bus = Bus(Path("the bus"), self.databases, ReadOptions())
            frames = [a.frame for a in came]
            bus.add(
                np.array([f.identifier for f in frames], np.int64),
                np.array([f.extended for f in frames], bool),
                [f.bus for f in frames],
                [f.data for f in frames],
            )
            times = np.maximum.accumulate(np.array([f.time for f in frames]))
            recording = Recording(Path("the bus"), "bus", bus.channels(times, None, notes), notes)
            proposal = propose(recording.since_start(), self.vehicle)
            missing = [c for c in proposal.missing if c not in ("accel_x",)]
            if missing:
                self.say(
                    f"no signal found so far for {', '.join(missing)}: drive some bends, so that the next "
                    f"search has more frames to compare{_find_nearest(proposal, missing)}"
                )
                return
            path = self.record.folder / "frames.signals.toml"
            path.write_text(format_signals(recording, proposal, None, self.record.folder), encoding="utf-8")
            self._proposed = read_signals(path)
            for g in proposal.guesses:
                self.say(f"proposed: {format_headline(g)}")
            self.say(
                f"the signals are guessed by names, units and physics: check the file {path}, and give this "
                "file with --signals for the next drive"
            )
        except UserError as error:
            self._say_once(str(error).splitlines()[0])
        except Exception as error:  # report any error: otherwise the user would wait for signals in vain
            self._say_once(
                f"the search for signals failed ({type(error).__name__}: {str(error)[:100]}): the next "
                "search uses more frames"
            )

    def _begin_with(self, signals: SignalsFile) -> None:
        self._signals = signals
        self.stream = Stream(self.databases, signals, self.vehicle, self._rate)
        for text in self.stream.notes:
            self.say(text)
        self.stream.notes.clear()

    # ---- rows of the filter, made from the frames

    def _step(self, came: Sequence[Arrived], now: float) -> tuple[np.ndarray, np.ndarray]:
        """Make the rows that are complete after the frames `came`, and run the filter on
        them. Return times and outputs of the rows."""
        stream = self.stream
        assert stream is not None
        behind = 0.0 if came else now - self._last_frame
        times, columns = stream.make_rows(stream.time + behind)
        for text in stream.notes:
            self._say_once(text)
        stream.notes.clear()
        if not len(times):
            return times, self._make_no_outputs()
        if self.filter is None:
            self._start(float(times[0]))
        times = times - self._origin
        rows = self._make_inputs(times, columns)
        outputs = self.filter.outputs(len(rows))
        self.filter.step_into(rows, outputs)
        if self.drive.contradicted:
            mark_implausible(outputs)
        took = time.monotonic()
        # Rows of half a second or more in one call come from frames that were collected
        # before the signals were known. Their wait is not a delay of the filter, so their
        # delays are not recorded.
        if came and len(times) < 0.5 / self.config.sample_time:
            self.drive.delays += [took - came[0].at] * len(times)
            self._recent.append((took, took - came[0].at))
        while self._recent and self._recent[0][0] < took - 1.0:
            self._recent.popleft()
        self.drive.delay = max((d for _, d in self._recent), default=0.0)
        self.drive.rows += len(times)
        self.drive.time = float(times[-1])
        self.drive.statuses.update(outputs["status"].tolist())
        for s in STIFFNESS:
            self._valid[s] += int(((outputs[f"{s}_valid"] == 0) & (outputs["status"] >= 0)).sum())
        self.last = outputs[-1]
        self._pending.append((times, columns, outputs))
        return times, outputs

    def _start(self, first: float) -> None:
        """Create the filter before the first row, whose time on the bus is `first`, and
        record its settings."""
        stream = self.stream
        assert stream is not None and stream.rate is not None
        self._origin = float(np.floor(first)) if first > 1e6 else 0.0
        for text in set_sampling(self.config, 1.0 / stream.rate):
            self.say(text)
        if stream.one_speed:
            self.config.wheel_signals = 1
        self.filter = NativeFilter(self.config)
        if self._learnt is not None:
            self._learnt.load(self.filter)
        changed = {
            k: v
            for k, v in self.config.as_dict().items()
            if v != self._plain[k] or k in ("sample_time", "max_gap")
        }
        lines = ["# Settings with which this drive was estimated, for tselab estimate --config."]
        self.record.write(
            "filter.toml", "\n".join([*lines, *(f"{k} = {v!r}" for k, v in changed.items()), ""]).encode()
        )

    def _make_inputs(self, times: np.ndarray, columns: dict[str, np.ndarray]) -> np.ndarray:
        """Return the rows as inputs of the library."""
        lib = library()
        rows = np.zeros(len(times), lib.dtype(INPUT))
        if not self.drive.rows:
            self.drive.first = float(times[0])
        before = self.drive.time if self.drive.rows else times[0] - self.config.sample_time
        rows["dt"] = np.diff(times, prepend=before)
        for f in lib.channels:
            rows[f.name] = columns[f.name]
        fill_optional(rows, columns)
        return rows

    def _look_at_channels(self) -> None:
        """Report each channel that has received no value for SILENT seconds, and each
        channel that receives values again."""
        stream = self.stream
        assert stream is not None
        bus_now = stream.time
        if self._quiet or stream.rate is None:
            return
        for c, last in stream.last.items():
            gone = bus_now - last > SILENT
            if gone and c not in self._silent:
                self._silent[c] = last
                self.say(
                    f"{c}: no value for a second (message {stream.find_message(c)}): the filter runs without "
                    "this channel until its next value"
                )
            elif not gone and c in self._silent:
                self.say(
                    f"{c}: values arrive again, after {bus_now - self._silent.pop(c):.1f} s without a value"
                )

    # ---- rows and estimates written to files

    def _write(self) -> None:
        """Write the pending rows and their estimates. Keep a summary of the estimates."""
        new = [self._pending.popleft() for _ in range(len(self._pending))]
        if not new:
            return
        times, outputs = np.concatenate([t for t, _, _ in new]), np.concatenate([o for _, _, o in new])
        columns = {"time": times, **{n: np.concatenate([c[n] for _, c, _ in new]) for n in new[0][1]}}
        rows = zip(*(x.tolist() for x in columns.values()), strict=True)
        block = make_block(times, outputs, self.config)
        if not self._written:
            self.record.write("rows.csv", (",".join(columns) + "\n").encode())
            self.record.write("rows.est.csv", make_csv_header(block))
        self.record.write(
            "rows.csv", "".join(",".join(_format_cell(x) for x in row) + "\n" for row in rows).encode()
        )
        self.record.write("rows.est.csv", make_csv_rows(convert_to_single(block)))
        self._columns.append(columns)
        while sum(len(x["time"]) for x in self._columns) > MAX_CHECKED:
            self._columns.popleft()
        part = slice(-self._written % self._stride, None, self._stride)
        self._written += len(times)
        self._table.append({n: block[n][part] for n in block if n in SUMMARY})
        if self._written > self._stride * MAX_SUMMARY:
            self._stride *= 2
            whole = self.table()
            self._table = [{str(n): whole[n].iloc[::2].array for n in whole}]

    def table(self) -> pd.DataFrame:
        """Return all written rows or, for a long drive, every `_stride`-th written row,
        with the columns listed in SUMMARY."""
        frames = [pd.DataFrame(x) for x in self._table]
        nothing = make_block(np.zeros(0), self._make_no_outputs(), self.config)
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame(nothing)

    # ---- events

    def _look_back(self) -> None:
        """Report the changes of the stiffness, the faults of sensors, and the sliding
        that the filter has found in the last EVENT_SEARCH_TIME seconds, each only
        once."""
        tail: list[dict[str, Any]] = []
        for x in reversed(self._table):
            tail.insert(0, x)
            if len(x["time"]) and x["time"][0] < self.drive.time - EVENT_SEARCH_TIME:
                break
        if not tail or self.drive.contradicted or not any(_has_event(x) for x in tail):
            return
        table = pd.concat([pd.DataFrame(x) for x in tail], ignore_index=True)
        table = table[table["time"] > self.drive.time - EVENT_SEARCH_TIME].reset_index(drop=True)
        for c in regimes.find_changes(table):
            if c.time < self.drive.time - MIN_EVENT_AGE and not self._is_reported(c.what, c.time):
                self.say(f"{c.label}{': ' if c.effect else ''}{c.effect}")
        for s in regimes.find_spells(table):
            goes_on = s.end > self.drive.time - MIN_EVENT_AGE
            if s.end - s.start > MIN_EVENT_AGE and not self._is_reported(s.name, s.start, s.end):
                self.say(
                    f"{s.name} since {s.start:.2f} s, probability {regimes.format_percent(s.probability)}"
                    if goes_on
                    else s.label
                )

    def _is_reported(self, what: str, start: float, end: float | None = None) -> bool:
        """Return whether an event has already been reported. If not, mark it as reported.
        An event also counts as reported if it starts at most 1 s after the end of a
        reported event of the same name.

        `what`: name of the event. `start`, `end`: [s] times at which the event begins and
        ends. `end` None: the event has no duration."""
        for i, (name, until) in enumerate(self._happened):
            if name == what and start <= until + 1.0:
                self._happened[i] = (name, max(until, end or start))
                return True
        self._happened = [(n, u) for n, u in self._happened if n != what] + [(what, end or start)]
        return False

    # ---- check of the channels against each other

    def _check_channels(self, columns: list[dict[str, np.ndarray]]) -> None:
        """Check whether the channels contradict each other, by the same method as for a
        log, and report contradictions.

        `columns`: the last written rows, in several dicts of columns."""
        try:
            data = {n: np.concatenate([c[n] for c in columns]) for n in columns[0]}
            time_ = data.pop("time")
            notes: list[str] = []
            data = {n: x for n, x in data.items() if np.isfinite(x).any()}
            log = check_log(Path("the bus"), time_, data, np.arange(len(time_)), notes, place="row")
            for text in (n for n in notes if "measures nothing" in n or "computed" in n or "no value" in n):
                self._say_once(text)
            said = check_car(select_liveliest(log, MAX_CHECKED), self.vehicle, self.config)
            for text in said:
                self._say_once(f"warning: {text}")
            self.drive.contradicted = select_certain(said)
        except UserError as error:
            self._say_once(str(error).splitlines()[0])
        except Exception as error:  # a failed check is reported, and does not end the drive
            self._say_once(
                f"the channels could not be checked against each other ({type(error).__name__}: "
                f"{str(error)[:100]})"
            )

    # ---- results and end of the drive

    def result(self) -> tuple[Estimates, list[Finding], list[Change], list[str]]:
        """Return the results of the drive so far, as `tselab estimate` would find them in
        the recorded rows: the estimates; for each stretch of road a Finding (value of
        each stiffness, and whether it is usable); the changes of the stiffness; sentences
        on contradictions between channels."""
        table = self.table()
        sd = self.filter.uncertainty_sd() if self.filter is not None else {}
        against = list(self.drive.contradicted)
        if not len(table):
            return Estimates(table, False), [], [], against
        if not against and (said := describe_implausible(table)):
            against.append(said)
        changes = regimes.find_changes(table)
        learnt = self.filter.save_learnt() if self.filter is not None and not against else None
        est = Estimates(table, False, learnt, sd, dict(self.drive.statuses))
        return est, make_findings(table, self.config, changes, against, sd), changes, against

    def now(self) -> list[Finding]:
        """Return the three stiffnesses after the last row, in one Finding. Return an
        empty list before the first row."""
        if self.last is None:
            return []
        words = {code: f.name for code, f in library().codes(REASON).items()}
        found = []
        for s in STIFFNESS:
            nominal = getattr(self.config, NOMINAL[s]) / 1000
            valid = int(self.last[f"{s}_valid"]) == 0 and int(self.last["status"]) >= 0
            value, sd = float(self.last[s]) * nominal, float(self.last[f"{s}_sd"]) * nominal
            reason = "" if valid else words.get(int(self.last[f"{s}_valid"]), "")
            unit = "kN" if s == "cx_front" else "kN/rad"
            found.append(
                Verdict(
                    s,
                    s,
                    "good" if valid else "none",
                    unit,
                    value,
                    1.96 * sd,
                    float("nan"),
                    nominal,
                    self._valid[s] / max(self.drive.rows, 1),
                    reason,
                    1.0,
                    "",
                )
            )
        return [Finding(None, found)]

    def close(self) -> None:
        """End the drive: stop reading, process the last frames,
        and complete the record."""
        if self.closed:
            return
        self.closed = True
        self.reader.stop()
        self._ended.set()
        self._keeper.join(30.0)
        if self._proposing is not None:
            self._proposing.join(30.0)
        came = self.reader.take(0.0)
        if self.stream is not None:
            self.drive.frames += len(came)
            for part in _cut_pieces(came):
                self.stream.add([a.frame for a in part])
                self._step(part, self._last_frame)
        self._write()
        if self._columns:
            self._check_channels(list(self._columns))
        self._look_back()
        self.record.close()
        gc.unfreeze()

    def numbers(self) -> str:
        """Return a sentence with the number of frames and of rows, the rate of the rows,
        and the delay of the estimates."""
        d = self.drive
        late = np.array(d.delays) * 1e3
        if not d.rows or not len(late):
            return f"{d.frames} frames, {d.rows} rows"
        return (
            f"{d.frames} frames, {d.rows} rows, {d.rows / max(d.time - d.first, 1e-3):.0f} rows per second; "
            f"delay from a frame to its estimate: median {np.median(late):.0f} ms, for 99 % of the rows at "
            f"most {np.quantile(late, 0.99):.0f} ms, max {late.max():.0f} ms"
        )


def _has_event(x: dict[str, Any]) -> bool:
    """Return whether the rows have an event: a change of the stiffness in the last
    EVENT_SEARCH_TIME seconds, or a fault of a sensor or sliding of the wheels with a
    probability of at least MIN_EVENT_PROBABILITY.

    `x`: columns of the rows."""
    if "change_kind" not in x or not len(x["time"]):
        return False
    return bool(
        np.any((x["change_kind"] > 0) & (x["change_age"] < EVENT_SEARCH_TIME))
        or any(np.any(x[p] >= regimes.MIN_EVENT_PROBABILITY) for p in regimes.SPELLS)
    )


def _cut_pieces(came: Sequence[Arrived]) -> list[list[Arrived]]:
    """Split frames into pieces of at most MAX_PIECE_TIME, to be processed one after the
    other. The stream that makes rows from frames keeps the values of a channel only for a
    short time, so a longer piece would lose values."""
    pieces: list[list[Arrived]] = []
    for a in came:
        if not pieces or abs(a.frame.time - pieces[-1][0].frame.time) > MAX_PIECE_TIME:
            pieces.append([])
        pieces[-1].append(a)
    return pieces


def _warm_up(config: Config) -> None:
    """Call the functions that load modules and tables when they are first called, so that
    the first frame does not wait for this loading."""
    for wanted in ("rad", "rad/s", "m/s2"):
        unit_factor(wanted, wanted)
    make_csv_rows(convert_to_single(make_block(np.zeros(1), np.zeros(1, library().dtype(OUTPUT)), config)))


def _format_cell(x: float) -> str:
    return "" if x != x else repr(x)


def _find_nearest(proposal: Proposal, missing: Sequence[str]) -> str:
    """Return a hint to append to a message: the signal that fits a missing channel best
    by name and unit, and why it was not proposed; or that no signal fits. The channel is
    the first in `missing` for which `proposal` has a hint. Return "" if there is no such
    channel."""
    said = [x for c in missing for x in proposal.nearest.get(c, ())[:1]]
    return f" (most similar signal: {said[0]})" if said else ""
