"""What is known of a log while its signals are guessed, and the guesses."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import SequenceMatcher

import numpy as np

from tse.impl.logs.mapping import Clocks, Series
from tse.impl.logs.names import unit_at_end
from tse.impl.logs.physics import RATE, smoothed
from tse.impl.logs.propose.companions import flag_of, no_value
from tse.impl.logs.raster import entries, rate_of, resample
from tse.impl.logs.recording import Channel, Recording
from tse.impl.logs.units import kind

KINDS = {"yaw_rate": ("rate",), "accel_y": ("acceleration",), "accel_x": ("acceleration",), "steer_angle": ("angle",),
    "wheel": ("speed", "rate"),
         "speed": ("speed",)}  # fmt: skip
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
AXLES = ("front", "rear")
LONGEST = 1500.0  # s of a log that are looked at
ALIKE = 0.6  # of names of a magnitude and its sign: difflib's ratio
FEWEST_TURNS = 4  # of a sign, to be compared with where the magnitude is 0
LEAST_SET = 0.02  # share of the rows in which a sign is set beside a magnitude of half the usual: bends to that side
AT_ZERO = 0.2  # of the usual magnitude: the lesser one beside a turn of the sign, median
MOST_STATES = 32  # values that a status has at most; a measured quantity that is called one has more
_STATUS = re.compile(r"_?(status|stat|state)$", re.IGNORECASE)
NAMED, TURNED = 1.0, 0.9  # a name that says something; a correlation that proves something


@dataclass
class Guess:
    """One channel of the library. `figures`: what speaks for it, in words."""

    channel: str
    name: tuple[str, ...]
    unit: str
    unit_from: str
    sign: float = 1.0
    ratio: float | None = None
    latency: float = 0.0
    above: float | None = None  # of a pressure: the car brakes above it
    sign_bit: str | None = None
    add: str | None = None
    valid: tuple[str, float] | None = None  # a flag of its message, and the value of it that means valid
    counter: tuple[str, int] | None = None  # of its message, and how far it counts
    unsure: list[str] = field(default_factory=list)  # what of it was not tested
    confidence: str = "unsure"  # sure, likely, unsure
    figures: list[str] = field(default_factory=list)


@dataclass
class Proposal:
    """The guesses, in the order of the library, and what contradicts them or is odd."""

    guesses: list[Guess]
    warnings: list[str]
    missing: list[str]

    def __getitem__(self, channel: str) -> Guess | None:
        return next((g for g in self.guesses if g.channel == channel), None)


def _held(time: np.ndarray, own: np.ndarray, value: np.ndarray) -> np.ndarray:
    """A signal at other times: the last entry before each."""
    return value[np.clip(np.searchsorted(own, time, side="right") - 1, 0, len(value) - 1)]


def _sign_bit(
    name: str, time: np.ndarray, value: np.ndarray, bits: Mapping[str, tuple[str, np.ndarray, np.ndarray]]
) -> str | None:
    """Which bit is the sign of a magnitude: one of a name alike that changes where the magnitude goes through zero, and is set
    where it is not (a flag of standstill is set where it is). None: none, or no magnitude."""
    there = value[np.isfinite(value)]
    if there.min() < 0:
        return None
    usual = float(np.mean(there))
    best: tuple[float, str] | None = None
    for short, (bit, own, flag) in bits.items():
        alike = SequenceMatcher(None, name.lower(), short.lower(), autojunk=False).ratio()
        if alike < ALIKE or not set(np.unique(flag[np.isfinite(flag)])) <= {0.0, 1.0}:
            continue
        sign = _held(time, own, flag)
        turns = np.flatnonzero(np.diff(sign))
        set_there = np.mean((sign == 1) & (value > 0.5 * usual))
        if len(turns) < FEWEST_TURNS or set_there < LEAST_SET:
            continue
        at = np.minimum(value[turns], value[turns + 1])
        if np.nanmedian(at) < AT_ZERO * usual and (best is None or alike > best[0]):
            best = alike, bit
    return best[1] if best else None


def _without_invalid(recording: Recording, c: Channel, rows: int) -> np.ndarray:
    """Its first values, NaN where a flag of its message calls them invalid or they are the number for "no value"."""
    value = c.value[:rows]
    bad = no_value(value)
    flag = flag_of(recording, c)
    if flag is not None:
        bad = bad | (recording.channels[flag[0]].value[:rows] != flag[1])
    return np.where(bad, np.nan, value) if bad.any() else value


class Look:
    """A recording on one even raster, smoothed, for comparisons. `x`: by name, (rows,)."""

    def __init__(self, recording: Recording):
        clocks = Clocks()
        raw: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        bits: dict[str, tuple[np.ndarray, np.ndarray]] = {}  # a signal of two values is no measurement
        for c in recording:
            time, value = clocks.of(c)
            rows = (
                int(np.searchsorted(time, time[0] + 1.1 * LONGEST)) if len(time) else 0
            )  # of ten hours no more is copied
            # where all of them have a time
            value = _without_invalid(recording, c, rows) if len(value) == len(c.value) else value[:rows]
            time = time[:rows]
            there = value[np.isfinite(value)]
            if len(there) > 3 and np.ptp(there) > 0 and len(time):
                two = np.all((there == there.min()) | (there == there.max()))
                (bits if two else raw)[c.name] = time, value
        short = {c.name: c.short for c in recording}
        self.sign_bit: dict[str, str] = {}
        for name, (time, value) in raw.items():
            if bit := _sign_bit(short[name], time, value, {short[b]: (b, *bits[b]) for b in bits}):
                self.sign_bit[name] = bit
                raw[name] = time, np.where(_held(time, *bits[bit]) == 1, -value, value)
        own = {name: entries(Series(name, time, value)) for name, (time, value) in raw.items()}
        self.channels: dict[str, Channel] = {c.name: c for c in recording if c.name in own}
        self._called: dict[str, str] = {}
        self.rate = {n: rate_of(t) for n, (t, _) in own.items()}
        if not own:
            self.x, self.time = {}, np.zeros(0)
            return
        first = float(np.median([t[0] for t, _ in own.values()]))
        last = min(float(np.median([t[-1] for t, _ in own.values()])), first + LONGEST)
        self.time = np.arange(first, max(last, first + 1.0), 1.0 / RATE)
        self.fine = {n: resample(t, v, self.time, RATE) for n, (t, v) in own.items()}
        self.x = {n: smoothed(v) for n, v in self.fine.items()}

    def called(self, name: str) -> str:
        """The name; without a "status" at its end where it has more values than a status has."""
        if name not in self._called:
            plain = _STATUS.sub("", name)
            many = plain != name and len(np.unique(self.channels[name].value[:20000])) > MOST_STATES
            self._called[name] = plain if many else name
        return self._called[name]

    def unit(self, name: str) -> str:
        """As the log says, or the end of the name."""
        c = self.channels[name]
        return c.unit if kind(c.unit) not in ("",) else unit_at_end(c.short)
