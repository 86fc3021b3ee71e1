"""Convert the frames of a bus to rows while they arrive.

Signals, validity flags, units and resampling are treated as for a log. An entry is a
value of a signal with its time. The values of a row are interpolated between entries
before and after the row. So a row is returned when each channel has an entry after it, or
after a limited wait.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from tse.channels.mapping import Series, map_signals
from tse.channels.raster import (
    BURST_STEP,
    choose_rate,
    find_longest_gap,
    find_rate,
    hold,
    is_core,
    resample,
    select_entries,
    start_on_beat,
)
from tse.channels.signals import SignalsFile, SignalSource
from tse.library.core import library
from tse.library.errors import UserError, suggest_names
from tse.log.noise import find_new_values
from tse.log.rows import DRIVES, MEASURES, OPTIONAL_COLUMNS, SIDES, VELOCITY_COLUMNS
from tse.readers.bus_text import CanFrame
from tse.readers.read_can import decode_signals, drop_codes, make_key, read_messages, read_states
from tse.readers.recording import Channel, Recording

# For each signal, the entries of the last KEPT_TIME [s] are kept, but at least the last
# MIN_KEPT entries. These entries suffice to interpolate the signal by a spline, and to
# find repeated counters and held values.
KEPT_TIME, MIN_KEPT = 2.0, 64
# [s] The first rows are made this long after the first frame with a signal of
# signals.toml. By then, the rates of the channels are known. If no rate of the rows is
# stated, it is chosen from these rates.
LISTEN_TIME = 1.0
# [s] If a needed channel is missing after LISTEN_TIME, the rows begin when this channel
# has arrived. If it does not arrive, they begin without it after this time.
MAX_LISTEN_TIME = 3.0
# A row is returned when each channel has an entry after the row. But the row waits for a
# channel at most for WAIT_STEPS median intervals between the channel's entries +
# WAIT_TIME [s] + latency of the channel.
WAIT_STEPS, WAIT_TIME = 1.5, 0.02
# A channel is silent if no entry has arrived for SILENT_STEPS median intervals between
# its entries and for MIN_SILENCE [s]. Rows do not wait for a silent channel.
SILENT_STEPS, MIN_SILENCE = 6.0, 0.25
# [entries] The spline uses only this many of the last entries of a channel. Earlier
# entries hardly influence it: the influence of an entry on a cubic spline decreases by
# the factor 0.27 per entry of distance.
SPLINE_ENTRIES = 48
CHECK_INTERVAL = 1.0  # [s] interval at which rates and held values are determined anew
# [1] A channel is low-passed if (rate of its entries) / (rate of the rows) exceeds this,
# as in raster.resample().
LOW_PASS_RATIO = 1.2
# [rows] additional time for which a row waits for a low-passed channel, because the low
# pass needs entries after the row
LOW_PASS_ROWS = 2.0
MAX_STEP_BACK = 0.5  # [s] a larger backward step of time stamps means that the clock was set
# One call of make_rows() returns at most this number of rows. If there are more, the
# oldest are dropped.
MAX_NEW_ROWS = 1000


@dataclass
class _Signal:
    """The last entries of a signal of the bus."""

    message: Any  # message in the database
    signal: Any  # signal in the database
    time: list[float] = field(default_factory=list)  # [s] times of the entries
    value: list[float] = field(default_factory=list)

    def trim(self) -> None:
        """Delete the older half of the entries if the newer half has more than MIN_KEPT
        entries and is longer than KEPT_TIME."""
        count = len(self.time)
        if count > 2 * MIN_KEPT and self.time[count // 2] < self.time[-1] - KEPT_TIME:
            del self.time[: count // 2], self.value[: count // 2]


@dataclass(frozen=True)
class _Heard:
    """The channels received so far."""

    now: float  # [s] time of the bus
    found: dict[str, Series]  # channel -> its entries
    # channel -> times and values of its new measurements: the entries in `found`, without
    # missing values and without repetitions of the last value (Stream._select_entries())
    own: dict[str, tuple[np.ndarray, np.ndarray]]
    rates: dict[str, float]  # channel -> [Hz] rate of its entries
    core: list[str]  # channels for which is_core() is True


class Stream:
    """Converts frames of a bus to rows.

    Parameters
    ----------
    databases : sequence of Path
        Databases of the bus.
    signals : SignalsFile
        Signal of each channel.
    car : Vehicle
        Car, with the radii of the wheels.
    rate : float, optional
        [Hz] Rate of the rows. None: `signals.rate`; if this is None, too, the rate of the
        fastest channel, at most 100 Hz.

    Raises
    ------
    UserError
        A signal is in none of the databases or in several messages. Or steer_angle,
        all speeds, or both accel_y and yaw_rate are not assigned.
    """

    def __init__(self, databases: Sequence[Path], signals: SignalsFile, car: Any, rate: float | None = None):
        self.notes: list[str] = []
        self._car, self._all = car, signals
        self._rate = rate or signals.rate
        self._messages = read_messages(databases, self.notes)
        self._kept: dict[str, _Signal] = {}
        self._of_key: dict[int, list[_Signal]] = {}
        for key, message in self._messages.items():
            wanted = [
                s
                for s in message.signals
                if signals.wants(s.name) or signals.wants(f"{message.name}.{s.name}")
            ]
            for s in wanted:
                kept = self._kept.setdefault(f"{message.name}.{s.name}", _Signal(message, s))
                self._of_key.setdefault(key, []).append(kept)
        self._resolve_names(databases)
        # identifier of frames that are in no database -> number of such frames so far
        self.unknown: dict[int, int] = {}
        self.known = 0  # number of frames whose messages are in the databases
        self._shift = 0.0  # [s] sum of the backward steps of the clock, added to all times
        self._last = -math.inf  # [s] time of the last frame
        self._first = math.nan  # [s] time of the first frame with a needed signal
        self._sent = 0  # number of rows returned
        self._start = math.nan  # [s] time of the first row
        # axle -> [sum of (right - left wheel speed) x yaw rate, sum of (yaw rate)^2] over
        # all rows. Their quotient is the least-squares estimate of (right - left) / yaw
        # rate, with which _average_axle() replaces a missing wheel speed.
        self._turns: dict[str, list[float]] = {}
        # velocity channel -> [s] time of its last entry that was put into a row
        self._given_until: dict[str, float] = {}
        # channel -> (rate [Hz], True: no held values or bursts) in the last check
        self._usual: dict[str, tuple[float, bool]] = {}
        self._looked = -math.inf  # [s] time at which `_usual` was last determined
        self._noted: set[str] = set()  # notes on unknown units that `notes` already has
        self.last: dict[str, float] = {}  # channel -> [s] time of its last value

    def _resolve_names(self, databases: Sequence[Path]) -> None:
        """Complete signal names to MESSAGE.SIGNAL. Raise UserError if a name is unknown
        or ambiguous, or if a channel that the filter needs is not assigned."""
        source = str(self._all.path or "the database")
        whole: dict[str, str] = {}
        for s in self._all.signals.values():
            for name in _list_names(s):
                alike = [n for n in self._kept if n == name or n.endswith(f".{name}")]
                if len(alike) > 1 and name not in self._kept:
                    raise UserError(
                        f"{source}: [signals.{s.channel}]: {name!r} is in the database {len(alike)} times: "
                        f"choose one: {', '.join(alike[:6])}"
                    )
                if not alike:
                    there = [f"{m.name}.{x.name}" for m in self._messages.values() for x in m.signals]
                    files = ", ".join(p.name for p in databases)
                    raise UserError(
                        f"{source}: [signals.{s.channel}]: there is no {name!r} in {files}"
                        f"{suggest_names(name, there)}"
                    )
                whole[name] = name if name in self._kept else alike[0]
        self._all = replace(
            self._all, signals={c: _rename_sources(s, whole) for c, s in self._all.signals.items()}
        )
        have = set(self._all.signals)
        wheels = {axle for axle, pair in SIDES.items() if axle in have or set(pair) <= have}
        if "steer_angle" not in have:
            raise UserError(
                f"{source}: steer_angle is missing: without the steering angle the tyres cannot be estimated"
            )
        if not wheels and "vehicle_speed" not in have:
            raise UserError(
                f"{source}: assigns no wheel speed, and no vehicle_speed that could be used instead"
            )
        if not {"accel_y", "yaw_rate"} & have:
            raise UserError(
                f"{source}: accel_y and yaw_rate are missing: the tyres cannot be estimated without "
                "one of them"
            )
        self._stand_in = (
            next((axle for axle in SIDES if axle not in wheels), None) if wheels else "wheel_speed_rear"
        )
        names = [have & {axle, *pair} for axle, pair in SIDES.items()]
        sources = [{n for c in x for n in self._all.signals[c].name} for x in names]
        # True: both axles have their wheel speed from the same signal, so slip is unknown
        self.one_speed = self._stand_in is not None or sources[0] == sources[1]
        if self._stand_in:
            self.notes.append(
                f"{self._stand_in} is not on the bus: the speed of the other axle is used instead; accel_x "
                "is not used and cx_front not estimated"
            )

    @property
    def rate(self) -> float | None:
        """Rate of the rows, Hz. None: unknown, since too few frames have arrived."""
        return self._rate if math.isfinite(self._start) else None

    def list_columns(self) -> list[str]:
        """Return the names of the columns of the rows, without time."""
        optional = [c for c in OPTIONAL_COLUMNS if c in self._all.signals]
        return [*DRIVES, *MEASURES, *optional]

    def find_message(self, channel: str) -> str:
        """Return the name of the message that contains a channel; "": no message does."""
        name = next(
            (s.name[0] for c, s in self._all.signals.items() if c == channel or channel in SIDES.get(c, ())),
            "",
        )
        return str(self._kept[name].message.name) if name else ""

    def add(self, frames: Sequence[CanFrame]) -> list[str]:
        """Add frames in the order of their arrival; return warnings about the clock."""
        said = []
        groups: dict[int, tuple[list[float], list[bytes]]] = {}
        for f in frames:
            time = f.time + self._shift
            if time < self._last - MAX_STEP_BACK:
                said.append(
                    f"the clock of the bus was set back by {self._last - time:.3g} s: times continue from "
                    "before the step"
                )
                self._shift += self._last - time
                time = self._last
            self._last = max(time, self._last)
            key = int(make_key(f.identifier, f.extended))
            if key not in self._messages:
                self.unknown[f.identifier] = self.unknown.get(f.identifier, 0) + 1
                continue
            self.known += 1
            if key in self._of_key:
                self._first = time if math.isnan(self._first) else self._first
                times, data = groups.setdefault(key, ([], []))
                times.append(time)
                data.append(f.data)
        for key, (times, data) in groups.items():
            self._decode_frames(self._of_key[key], times, data)
        return said

    def _decode_frames(self, kept: list[_Signal], times: list[float], data: list[bytes]) -> None:
        """Decode frames of one message, and append the values to its signals `kept`.

        `times`: [s] times of the frames. `data`: their bytes."""
        of = {k.signal.name: k for k in kept}
        for s, have, value in decode_signals(kept[0].message, [k.signal for k in kept], data):
            k = of[s.name]
            value = drop_codes(s.name, s, value, read_states(s), [])
            for i, x in zip(have.tolist(), value.tolist(), strict=True):
                if not k.time or times[i] > k.time[-1]:
                    k.time.append(times[i])
                    k.value.append(x)
            k.trim()

    @property
    def time(self) -> float:
        """Time of the last frame, s; -inf before the first one. If the clock of the bus
        was set back, the time continues from before the step."""
        return self._last

    def _build_series(self) -> dict[str, Series]:
        """Return all channels whose signals have entries, in SI units."""
        times: dict[tuple[str, int, float, float], np.ndarray] = {}
        channels = {}
        for n, k in self._kept.items():
            if k.time:
                same = (k.message.name, len(k.time), k.time[0], k.time[-1])
                if same not in times:
                    times[same] = np.array(k.time)
                channels[n] = Channel(n, times[same], np.array(k.value), k.signal.unit or "", "", {})
        recording = Recording(Path("the bus"), "bus", channels)
        now = {c: s for c, s in self._all.signals.items() if all(n in channels for n in _list_names(s))}
        found = map_signals(recording, SignalsFile(self._all.path, now), self._car, notes := [], max_lost=1.0)
        # map_signals() repeats its notes in each call. Add only new ones on unknown
        # units.
        new = {n for n in notes if "(neither in the log nor in signals.toml)" in n} - self._noted
        self.notes += sorted(new)
        self._noted |= new
        if "vehicle_speed" in found and not any(c.startswith("wheel_speed") for c in self._all.signals):
            speed = found["vehicle_speed"]
            radius = self._car.values["wheel_radius_front"]
            found["wheel_speed_front"] = Series(
                "wheel_speed_front", speed.time, speed.value / radius, speed.latency, speed.hold
            )
        return found

    def make_rows(self, now: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return the rows that have become complete since the last call.

        `now` is the time of the bus, s. A row is complete if each channel has an entry
        after it or need not be waited for (_find_row_limit()).

        Returns
        -------
        ndarray, (rows,)
            [s] Times.
        dict of str to ndarray, (rows,)
            Values by channel. NaN: missing.
        """
        if not self._may_have_rows(now):
            return self._make_empty()
        heard = self._receive(now)
        if math.isnan(self._start) and not self._start_rows(heard):
            return self._make_empty()
        until = self._find_row_limit(heard)
        rate = float(self._rate or 1.0)
        last = math.floor((until - self._start) * rate + 1e-6) if math.isfinite(until) else -1
        if last < self._sent:
            return self._make_empty()
        first, self._sent = max(self._sent, last + 1 - MAX_NEW_ROWS), last + 1
        time = self._start + np.arange(first, last + 1) / rate
        value = self._resample(heard, time)
        core = [value[n] for n in heard.core]
        some = np.any(np.isfinite(core), axis=0) if core else np.zeros(len(time), bool)
        return time[some], {n: x[some] for n, x in self._finish_columns(value, len(time)).items()}

    def _receive(self, now: float) -> _Heard:
        """Return the channels received so far. Update `last`, the time of each channel's
        last value."""
        found = self._build_series()
        anew = now > self._looked + CHECK_INTERVAL or set(found) != set(self._usual)
        if anew:
            self._looked = now
        own = {n: self._select_entries(n, s, anew) for n, s in found.items()}
        rates = {n: self._usual[n][0] for n in found}
        for n, s in found.items():
            there = np.isfinite(s.value)
            if there.any():
                self.last[n] = float(s.time[len(there) - 1 - int(there[::-1].argmax())]) + s.latency
        core = [n for n in found if is_core(n) and len(own[n][0])]
        return _Heard(now, found, own, rates, core)

    def _resample(self, heard: _Heard, time: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values of all channels at the times of the rows."""
        rate = float(self._rate or 1.0)
        value: dict[str, np.ndarray] = {}
        # id of an array of times -> channels whose entries have these times. These
        # channels are interpolated together, which is faster.
        even: dict[int, list[str]] = {}
        for n, s in heard.found.items():
            t, x = heard.own[n]
            if n in VELOCITY_COLUMNS:
                value[n] = self._place_measurements(n, t, x, time)
            elif s.hold or n == "brake":
                value[n] = hold(t, x, time)
            elif (
                len(t) > SPLINE_ENTRIES
                and 0 < heard.rates[n] <= LOW_PASS_RATIO * rate
                and t[-SPLINE_ENTRIES] < time[0]
                and time[-1] <= t[-1]
            ):
                even.setdefault(id(t), []).append(n)
            else:
                value[n] = resample(t, x, time, rate)
        for names in even.values():
            value |= self._interpolate_together(names, heard.own, time, rate)
        return value

    def _select_entries(self, name: str, s: Series, anew: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return times and values of the entries that are new measurements.

        raster.select_entries() leaves out repetitions of the last measurement (held
        values) and averages entries sent in a burst. It is slow, so it is called only if
        `anew` is True, or if held values or bursts are likely: the last call with `anew`
        found some, or two entries are as close as in a burst. Otherwise, only missing
        values are left out."""
        if not anew:
            rate, plain = self._usual[name]
            if plain and (rate == 0 or len(s.time) < 2 or float(np.diff(s.time).min()) >= BURST_STEP / rate):
                there = np.isfinite(s.value)
                return (s.time, s.value) if there.all() else (s.time[there], s.value[there])
            return select_entries(s)
        time, value = select_entries(s)
        self._usual[name] = find_rate(time), len(time) == int(np.isfinite(s.value).sum())
        return time, value

    def _interpolate_together(
        self, names: list[str], own: dict[str, tuple[np.ndarray, np.ndarray]], time: np.ndarray, rate: float
    ) -> dict[str, np.ndarray]:
        """Resample channels whose entries have the same times, by cubic splines.

        One call for all channels is faster than resample() for each. resample() is called
        only if there is a gap between entries. `own`: as in _Heard. `time`: [s] times of
        the rows. `rate`: [Hz] rate of the rows."""
        t = own[names[0]][0][-SPLINE_ENTRIES:]
        if np.diff(t).max() > find_longest_gap(1.0 / self._usual[names[0]][0]):
            return {n: resample(*own[n], time, rate) for n in names}
        values = make_interp_spline(t, np.column_stack([own[n][1][-SPLINE_ENTRIES:] for n in names]))(time)
        return {n: values[:, i] for i, n in enumerate(names)}

    def _make_empty(self) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return empty columns, as make_rows() does if no row is complete."""
        return np.zeros(0), {c: np.zeros(0) for c in self.list_columns()}

    def _start_rows(self, heard: _Heard) -> bool:
        """Set the rate of the rows and the time of the first row. Return False if too few
        frames have arrived for this."""
        wanted = [
            c
            for c, s in self._all.signals.items()
            for c in (SIDES.get(c, (c,)) if len(s.name) > 1 else (c,))
            if is_core(c)
        ]
        whole = all(c in heard.core and heard.rates[c] > 0 for c in wanted)
        if not heard.core or heard.now < self._first + (LISTEN_TIME if whole else MAX_LISTEN_TIME):
            return False
        # Use mean rates instead of rates from median steps. The computer adds the time
        # stamp when it receives a frame, so single steps jitter, but their mean does not.
        if self._rate is None:
            self._rate = choose_rate([find_mean_rate(heard.found[n]) for n in heard.core])
        drives = [n for n in heard.core if n not in MEASURES] or heard.core
        first = max(float(heard.own[n][0][0]) for n in drives)
        self._start = start_on_beat({n: heard.own[n][0] for n in heard.core}, heard.rates, self._rate, first)
        return True

    def _may_have_rows(self, now: float) -> bool:
        """Return False if the next row must wait for a channel, True if it may be
        complete.

        Most frames complete no row. For these, this fast check avoids the exact but
        slower one, _find_row_limit()."""
        if math.isnan(self._start) or now > self._looked + CHECK_INTERVAL:
            return True
        rate = float(self._rate or 1.0)
        due = self._start + self._sent / rate
        for c, s in self._all.signals.items():
            part = SIDES.get(c, (c,))[0] if len(s.name) > 1 else c
            usual = 1.0 / self._usual[part][0] if self._usual.get(part, (0.0,))[0] > 0 else 0.0
            if not is_core(c) or not usual:
                continue
            last = min(self._kept[n].time[-1] for n in s.name) - s.latency - s.clock
            silent = last < now - s.latency - max(SILENT_STEPS * usual, MIN_SILENCE)
            if (
                last < due - 0.01 / rate
                and now - s.latency - WAIT_STEPS * usual - WAIT_TIME < due
                and not silent
            ):
                return False
        return True

    def _find_row_limit(self, heard: _Heard) -> float:
        """Return the time up to which rows are complete, s.

        A row is complete if each channel has an entry after the row, or is silent, or is
        no longer waited for (WAIT_STEPS, WAIT_TIME). Return -inf if all channels are
        silent."""
        until = []
        rate = float(self._rate or 1.0)
        for n in heard.core:
            usual = 1.0 / heard.rates[n] if heard.rates[n] > 0 else 1.0
            last = float(heard.own[n][0][-1])
            due = heard.now - heard.found[n].latency
            if last < due - max(SILENT_STEPS * usual, MIN_SILENCE):
                continue
            ahead = LOW_PASS_ROWS / rate if heard.rates[n] > LOW_PASS_RATIO * rate else 0.0
            until.append(max(last - ahead, due - WAIT_STEPS * usual - WAIT_TIME))
        return min(until) if until else -math.inf

    def _place_measurements(self, name: str, t: np.ndarray, x: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Return a column with each new entry in the nearest row, and NaN in other rows.

        The filter must use each velocity measurement once, so these channels are neither
        interpolated nor held. If an earlier call has already returned the nearest row,
        the first row of this call gets the entry."""
        out = np.full(len(time), np.nan)
        half = 0.5 / float(self._rate or 1.0)
        new = (t > self._given_until.get(name, -math.inf)) & (t <= time[-1] + half)
        if new.any():
            out[np.clip(np.searchsorted(time, t[new] - half), 0, len(time) - 1)] = x[new]
            self._given_until[name] = float(t[new][-1])
        return out

    def _finish_columns(self, value: dict[str, np.ndarray], rows: int) -> dict[str, np.ndarray]:
        """Return the columns of the rows, with one speed for each axle.

        Values out of range become NaN. If only one axle has a wheel speed, the wheels of
        the other axle get the same circumferential speed (wheel speed x radius). The slip
        is then unknown, so accel_x cannot give the longitudinal stiffness, and becomes
        NaN."""
        nothing = np.full(rows, np.nan)
        for f in library().channels:
            for n in (f.name, *SIDES.get(f.name, ())):
                if n in value:
                    value[n] = _mask_outside(value[n], f.low, f.high)
        yaw = value.get("yaw_rate", nothing)
        columns = {}
        for axle, pair in SIDES.items():
            if axle not in value and any(s in value for s in pair):
                value[axle] = self._average_axle(axle, *(value.get(s, nothing) for s in pair), yaw)
        for c in self.list_columns():
            x = value.get(c, nothing)
            columns[c] = _mask_outside(x, *OPTIONAL_COLUMNS[c][1:3]) if c in OPTIONAL_COLUMNS else x
        if self._stand_in:
            other = next(axle for axle in SIDES if axle != self._stand_in)
            front, rear = (self._car.values[f"wheel_radius_{a}"] for a in ("front", "rear"))
            columns[self._stand_in] = columns[other] * (
                rear / front if self._stand_in.endswith("front") else front / rear
            )
            columns["accel_x"] = nothing
        return columns

    def _average_axle(self, axle: str, left: np.ndarray, right: np.ndarray, yaw: np.ndarray) -> np.ndarray:
        """Return the mean wheel speed of an axle.

        If the speed of one wheel is missing, it is computed from the speed of the other
        wheel and the yaw rate, with the factor (right - left speed) / yaw rate. This
        factor is fitted to all rows so far."""
        turn = self._turns.setdefault(axle, [0.0, 0.0])
        both = np.isfinite(left) & np.isfinite(right) & np.isfinite(yaw)
        turn[0] += float(np.sum((right - left)[both] * yaw[both]))
        turn[1] += float(np.sum(yaw[both] ** 2))
        mean = 0.5 * (left + right)
        alone = np.isnan(mean) & np.isfinite(yaw) & bool(turn[1] > 0)
        if alone.any():
            half = 0.5 * turn[0] / turn[1] * yaw
            mean = np.where(alone, np.where(np.isfinite(left), left + half, right - half), mean)
        return mean


def find_mean_rate(s: Series) -> float:
    """Return the mean rate at which a channel gets new values, Hz."""
    span = float(s.time[-1] - s.time[0]) if len(s.time) > 1 else 0.0
    return (int(find_new_values(s.value).sum()) - 1) / span if span > 0 else 0.0


def _list_names(s: SignalSource) -> list[str]:
    """Return the names of all signals from which a channel is made."""
    needed = [*s.name, s.add, s.sign_bit, s.valid and s.valid.name, s.counter and s.counter.name]
    return [n for n in needed if n]


def _rename_sources(s: SignalSource, whole: Mapping[str, str]) -> SignalSource:
    """Return the source with its signals named MESSAGE.SIGNAL.

    `whole`: name in signals.toml -> MESSAGE.SIGNAL."""
    return replace(
        s,
        name=tuple(whole[n] for n in s.name),
        add=s.add and whole[s.add],
        sign_bit=s.sign_bit and whole[s.sign_bit],
        valid=s.valid and replace(s.valid, name=whole[s.valid.name]),
        counter=s.counter and replace(s.counter, name=whole[s.counter.name]),
    )


def _mask_outside(x: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the values, with NaN in place of those outside low .. high."""
    return np.where((x >= low) & (x <= high), x, np.nan)
