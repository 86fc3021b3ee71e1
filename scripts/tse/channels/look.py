"""Prepare a log for the search for its channels (class Look), and describe the result.

A channel is a quantity that the library reads, e.g. wheel_speed_front. A Guess is the
signal of the log that is proposed for one channel. A Proposal has all guesses for a log.
A role is a quantity that a signal may measure, e.g. yaw_rate. Most roles have the name of
a channel. The role "wheel" stands for all wheel speeds, "speed" for the speed of the car.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from typing import TypeAlias

import numpy as np

from tse.channels.counters import find_modulo
from tse.channels.mapping import Clocks, Series
from tse.channels.physics import COMPARISON_RATE, smooth
from tse.channels.raster import find_rate, resample, select_entries
from tse.channels.vocabulary import join_words
from tse.log.units import is_unknown_unit, unit_kind
from tse.readers.recording import Channel, Recording
from tse.readers.table import find_unit_suffix

# role, i.e. quantity that a signal may measure -> kinds of units that the signal may have
ROLE_KINDS = {
    "yaw_rate": ("rate",),
    "accel_y": ("acceleration",),
    "accel_x": ("acceleration",),
    "steer_angle": ("angle",),
    "wheel": ("speed", "rate"),
    "speed": ("speed",),
}
WHEEL_PLACES = ("front_left", "front_right", "rear_left", "rear_right")
MAX_LOOK_TIME = 1500.0  # [s] Only this first part of a log is used to find the channels.
# Some buses send the magnitude of a quantity as one signal, and its sign as a bit, which
# is a second signal. The following limits are for the search for sign bits.
# min similarity, 0 .. 1 (difflib), of the names of a magnitude and its sign bit
MIN_SIGN_ALIKE = 0.6
MIN_SIGN_CHANGES = 4  # min number of changes of a sign bit
# [1] Min share of rows in which a sign bit is 1 and the magnitude is above half its mean.
# A sign bit has such rows in bends to one side. A flag for standstill also changes at
# small magnitudes, but has no such rows.
MIN_SIGN_SHARE = 0.02
# [1] A sign bit only changes while its magnitude is near 0. The median of the magnitude
# in the rows in which the bit changes must therefore be below this share of the mean of
# the magnitude over all rows.
MAX_AT_ZERO = 0.2
# A signal with more different values than this is a measured quantity, not a status.
MAX_STATES = 32
_STATUS = re.compile(r"_?(status|stat|state)$", re.IGNORECASE)
# Min score of a signal for a role, i.e. for a quantity such as yaw_rate. With less, the
# signal is not taken for this quantity. The name of the signal scores at most 3
# (vocabulary.py). wheels.py adds scores for its unit and for its agreement with physics.
MIN_NAME_SCORE = 1.0
MIN_PROOF_CORR = 0.9  # min correlation for a kinematic relation to count as proven


@dataclass
class Guess:
    """The signal proposed for one channel of the library."""

    channel: str
    name: tuple[str, ...]  # names of the signals; more than one: the channel is their mean
    unit: str
    unit_from: str  # source of the unit, in words
    sign: float = 1.0  # -1: the signal is positive to the right or backwards
    ratio: float | None = None  # steering ratio, divides the steering angle; None: 1
    latency: float = 0.0  # [s] delay from the measurement to its time in the log
    # [s] time by which the clock of the signal is ahead of the common clock of the log,
    # which align_clocks() in group_clocks.py chooses
    clock: float = 0.0
    # for a brake pressure or pedal position: value in `unit` above which the car brakes;
    # None: the signal is a brake switch (0 or 1), or is not a brake signal
    above: float | None = None
    sign_bit: str | None = None  # name of the bit with the sign, if the signal is a magnitude
    add: str | None = None  # name of a signal that is added: the fine part of a coarse value
    # name of the validity flag, and its value if the signal is valid
    valid: tuple[str, float] | None = None
    counter: tuple[str, int] | None = None  # name and modulo of the counter of the message
    # properties that were guessed but could not be tested: sign, unit, ...
    unsure: list[str] = field(default_factory=list)
    confidence: str = "unsure"  # sure, likely, unsure
    figures: list[str] = field(default_factory=list)  # evidence for the guess, in words


@dataclass
class Proposal:
    """The guesses for a log in the order of the library's channels, with warnings, and
    with the channels for which no signal was found."""

    guesses: list[Guess]
    warnings: list[str]
    missing: list[str]
    # missing channel -> signals whose name and unit fit it best, each with the reason why
    # it was rejected
    nearest: dict[str, list[str]] = field(default_factory=dict)

    def __getitem__(self, channel: str) -> Guess | None:
        return next((g for g in self.guesses if g.channel == channel), None)


def _hold_last(time: np.ndarray, own: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Return the last value at or before each of the times `time`.

    `own`: times of the values."""
    return value[np.clip(np.searchsorted(own, time, side="right") - 1, 0, len(value) - 1)]


def _find_sign_bit(
    name: str, time: np.ndarray, value: np.ndarray, bits: Mapping[str, tuple[str, np.ndarray, np.ndarray]]
) -> str | None:
    """Return the name of the bit that holds the sign of a magnitude; None if no bit does.

    The bit has a name similar to that of the magnitude. It changes while the magnitude is
    near 0, and it is 1 in some rows with a large magnitude. The last condition excludes a
    flag for standstill. `name`, `time`, `value`: name, times and values of the magnitude.
    `bits`: all signals with only two values, short name -> (name, times, values)."""
    there = value[np.isfinite(value)]
    if there.min() < 0:
        return None
    usual = float(np.mean(there))
    best: tuple[float, str] | None = None
    for short, (bit, own, flag) in bits.items():
        alike = SequenceMatcher(None, name.lower(), short.lower(), autojunk=False).ratio()
        if alike < MIN_SIGN_ALIKE or not set(np.unique(flag[np.isfinite(flag)])) <= {0.0, 1.0}:
            continue
        sign = _hold_last(time, own, flag)
        turns = np.flatnonzero(np.diff(sign))
        set_there = np.mean((sign == 1) & (value > 0.5 * usual))
        if len(turns) < MIN_SIGN_CHANGES or set_there < MIN_SIGN_SHARE:
            continue
        at = np.minimum(value[turns], value[turns + 1])
        if np.nanmedian(at) < MAX_AT_ZERO * usual and (best is None or alike > best[0]):
            best = alike, bit
    return best[1] if best else None


def _mask_invalid(recording: Recording, c: Channel, rows: int, flags: Flags) -> np.ndarray:
    """Return the first `rows` values of a channel, NaN where they are invalid.

    A value is invalid if the validity flag of the channel does not have the value that
    means valid, or if the value is a code for "not available"."""
    value = c.value[:rows]
    bad = mark_no_value(value)
    flag = find_flag(recording, c, flags)
    if flag is not None:
        bad = bad | (recording.channels[flag[0]].value[:rows] != flag[1])
    return np.where(bad, np.nan, value) if bad.any() else value


class Look:
    """The signals of a recording, resampled to one uniform raster for comparisons.

    Attributes
    ----------
    time : ndarray, (rows,)
        Times of the raster, s.
    x : dict of str to ndarray, (rows,)
        Signals by name, smoothed by a moving mean (physics.smooth()).
    fine : dict of str to ndarray, (rows,)
        Signals by name, not smoothed.
    raw : dict of str to (ndarray, ndarray)
        Times and values of each signal before resampling, NaN if invalid.
    rate : dict of str to float
        [Hz] New values per second of each signal. Repetitions are not counted.
    sign_bit : dict of str to str
        Name of a magnitude -> name of the bit with its sign.
    """

    def __init__(self, recording: Recording):
        clocks = Clocks()
        raw: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        # signals with only two different values: flags, switches
        bits: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        flags = find_flags(recording)
        for c in recording:
            time, value = clocks.straighten(c)
            # of a long log, copy only the first part
            rows = int(np.searchsorted(time, time[0] + 1.1 * MAX_LOOK_TIME)) if len(time) else 0
            # If the repair of the times dropped entries, the rows of `value` no longer
            # match the rows of the flag. Then the flag is not used.
            value = _mask_invalid(recording, c, rows, flags) if len(value) == len(c.value) else value[:rows]
            time = time[:rows]
            there = value[np.isfinite(value)]
            if len(there) > 3 and np.ptp(there) > 0 and len(time):
                two = np.all((there == there.min()) | (there == there.max()))
                (bits if two else raw)[c.name] = time, value
        short = {c.name: c.short for c in recording}
        self.sign_bit: dict[str, str] = {}
        for name, (time, value) in raw.items():
            if bit := _find_sign_bit(short[name], time, value, {short[b]: (b, *bits[b]) for b in bits}):
                self.sign_bit[name] = bit
                raw[name] = time, np.where(_hold_last(time, *bits[bit]) == 1, -value, value)
        self.raw = raw
        own = {name: select_entries(Series(name, time, value)) for name, (time, value) in raw.items()}
        self.channels: dict[str, Channel] = {c.name: c for c in recording if c.name in own}
        self._called: dict[str, str] = {}
        self._unit: dict[str, str] = {}
        self.rate = {n: find_rate(t) for n, (t, _) in own.items()}
        if not own:
            self.x, self.time = {}, np.zeros(0)
            return
        first = float(np.median([t[0] for t, _ in own.values()]))
        last = min(float(np.median([t[-1] for t, _ in own.values()])), first + MAX_LOOK_TIME)
        self.time = np.arange(first, max(last, first + 1.0), 1.0 / COMPARISON_RATE)
        self.fine = {n: resample(t, v, self.time, COMPARISON_RATE) for n, (t, v) in own.items()}
        self.x = {n: smooth(v) for n, v in self.fine.items()}

    def clean_name(self, name: str) -> str:
        """Return the name of a signal. A final "status" is removed if it is wrong.

        A signal with more than MAX_STATES different values is a measured quantity and not
        a status, even if its name ends in "status"."""
        if name not in self._called:
            plain = _STATUS.sub("", name)
            many = plain != name and len(np.unique(self.channels[name].value[:20000])) > MAX_STATES
            self._called[name] = plain if many else name
        return self._called[name]

    def find_unit(self, name: str) -> str:
        """Return the unit of a signal in the log. If the log has no known unit for it,
        return the unit at the end of its name; "": unknown."""
        if name not in self._unit:
            c = self.channels[name]
            self._unit[name] = (
                c.unit
                if unit_kind(c.unit) not in ("",) and not is_unknown_unit(c.unit)
                else find_unit_suffix(c.short)
            )
        return self._unit[name]


# ---- Find the companions of a measurement, i.e. other signals of its message that belong
# to it: its validity flag, the counter of the message, and the fine part of a value that
# is sent in coarse steps. In addition, warn if the log has tick counters of wheels
# (number of pulses of a wheel speed sensor) instead of wheel speeds.

FLAG_NAME = re.compile(
    r"qbit|valid|gueltig|g\u00fcltig|qual|\bqf\b|\bqs\b|quality|\bvld\b|\bok\b|"
    r"invalid|ungueltig|\berr|error|fehler|fault|\bfail|"
    r"status|\bsts\b|\bstat\b|\bstate\b|avail|plaus",
    re.IGNORECASE,
)
# pattern of the names of flags that may refer to all signals of their message
MESSAGE_FLAG_NAME = re.compile(r"qual|valid|gueltig|g\u00fcltig|\bqf\b|qbit|\bvld\b", re.IGNORECASE)
BAD_STATE_NAME = re.compile(
    r"inval|\bnot|\bno\b|err|fault|fail|fehl|ung(ue|ü)lt|init|sna|unavail|undef|reserv|nicht|"
    r"implaus|unplaus|degrad",
    re.IGNORECASE,
)
COUNTER_NAME = re.compile(
    r"\bbz\b|count|\bcntr?\b|rolling|zaehler|z\u00e4hler|alive|\bmc\b|sequence", re.IGNORECASE
)
REST_NAME = re.compile(r"fraction|\bfrac\b|\bfine\b|rest\b|remainder|offset", re.IGNORECASE)
TICK_NAME = re.compile(r"tick|puls|impuls|edge|\bcnt\b|count", re.IGNORECASE)
MAX_FLAG_VALUES = 8  # max number of different values of a flag
MIN_VALID_SHARE = 0.9  # [1] min share of rows in which a flag has the value for valid
MIN_FLAG_ALIKE = 0.5  # min similarity, 0 .. 1 (difflib), of the names of a flag and its signal
CODE_RATIO = 1.5  # [1] min ratio of the code for "no value" to the largest measured value
# [1] A signal is coarse if its quantisation step is at least this share of its largest
# magnitude, or at least 0.5 in the unit of the signal. Only for coarse signals, a fine
# part is searched for.
COARSE_STEP = 0.02
# [1] A signal is accepted as the fine part if the roughness of (coarse value + this
# signal) is below this share of the roughness of the coarse value alone. The roughness is
# the mean absolute second difference of successive values.
MAX_FILLED = 0.35

# Flags of a recording. Key: (name of the message, number of entries of the flag). The
# number is part of the key, since a flag applies to its signal entry by entry, so both
# must have the same number of entries. Value: list of (flag, value of the flag that means
# valid).
Flags: TypeAlias = Mapping[tuple[str, int], Sequence[tuple[Channel, float]]]


def find_flags(recording: Recording) -> Flags:
    """Return the flags of each message, each with the value that means valid."""
    found: dict[tuple[str, int], list[tuple[Channel, float]]] = {}
    for c in recording:
        if (v := _find_valid_value(c)) is not None:
            found.setdefault((_get_message_name(c), len(c)), []).append((c, v))
    return found


def find_flag(
    recording: Recording, mine: Channel, flags: Flags, taken: frozenset[str] | set[str] = frozenset()
) -> tuple[str, float] | None:
    """Return the validity flag of the signal `mine`, and the value that means valid.

    Only flags in the message of the signal are searched, except those in `taken`. If
    names of flags are similar to that of the signal (MIN_FLAG_ALIKE), return the flag
    with the most similar name. Otherwise, return the flag that belongs to all signals of
    the message; None if there are several or none."""
    found = sorted(
        (_compare_names(c, mine), c.name, v)
        for c, v in flags.get((_get_message_name(mine), len(mine)), ())
        if c.name not in taken and c is not mine
    )
    if found and found[-1][0] >= MIN_FLAG_ALIKE:
        return found[-1][1], found[-1][2]
    whole = [
        (n, v)
        for _, n, v in found
        if MESSAGE_FLAG_NAME.search(join_words(recording.channels[n].short))
        and not _is_of_another_signal(recording, n)
    ]
    return whole[0] if len(whole) == 1 and _get_message_name(mine) else None


def _is_of_another_signal(recording: Recording, flag: str) -> bool:
    """Return whether the name of a flag is similar to that of a signal of its message.

    Such a flag belongs to this signal alone, and not to all signals of the message."""
    mine = recording.channels[flag]
    message = _get_message_name(mine).replace("/", ".").rpartition(".")[2]
    plain = " ".join(
        w
        for w in join_words(mine.short).split()
        if not FLAG_NAME.search(w) and w not in join_words(message).split()
    )
    others = [
        join_words(c.short)
        for c in recording
        if c is not mine and _get_message_name(c) == _get_message_name(mine)
    ]
    return len(plain) > 3 and any(
        SequenceMatcher(None, plain, text, autojunk=False).ratio() >= MIN_FLAG_ALIKE
        for text in others
        if not FLAG_NAME.search(text)
    )


def mark_no_value(value: np.ndarray) -> np.ndarray:
    """Return a mask of the rows in which a signal has a code for "not available".

    The largest magnitude of the signal is taken as a code on two conditions. First, it
    exceeds CODE_RATIO times the next smaller magnitude. Second, it appears in at least
    two rows, but not in more than 10 % of all rows (1 - MIN_VALID_SHARE)."""
    size = np.abs(value)
    there = size[np.isfinite(size)]
    top = float(there.max()) if len(there) else 0.0
    is_top = size == top
    others = there[there < top]
    if top == 0 or not len(others) or is_top.sum() < 2 or is_top.mean() > 1.0 - MIN_VALID_SHARE:
        return np.zeros(len(value), bool)
    return is_top if top > CODE_RATIO * float(others.max()) else np.zeros(len(value), bool)


def find_companions(recording: Recording, guesses: list[Guess]) -> None:
    """Find validity flag, counter and fine part for the signal of each guess; set them in
    the guess.

    These companions are searched for by their names and values, in the same message as
    the signal of the guess."""
    taken = {n for g in guesses for n in (*g.name, g.sign_bit) if n}
    flags = find_flags(recording)
    for g in guesses:
        mine = recording.find(g.name[0], "")
        beside = [
            c
            for c in recording
            if c.name not in taken and _get_message_name(c) == _get_message_name(mine) and len(c) == len(mine)
        ]
        if flag := find_flag(recording, mine, flags, taken):
            g.valid = flag
            g.figures.append(f"valid if {flag[0]} is {flag[1]:g}, as in nearly all rows")
        elif mark_no_value(mine.value).any():
            top = float(np.nanmax(np.abs(mine.value)))
            g.figures.append(f"{top:g} seems to be a code for a missing value: check the extreme values")
            g.unsure.append("a code for a missing value")
        counters = [(c.name, n) for c in beside if (n := _count_modulo(c))] if _get_message_name(mine) else []
        if len(counters) == 1:
            g.counter = counters[0]
            g.figures.append(f"{counters[0][0]} counts its messages, modulo {counters[0][1]}")
        if g.channel == "steer_angle":
            _add_fine_part(g, mine, beside)


def _get_message_name(c: Channel) -> str:
    """Return the name of a signal's message: the part of the signal's full name before
    the last dot or slash.

    Return "" if the name has neither. For example, the columns of a table have no
    message."""
    return c.name.replace("/", ".").rpartition(".")[0]


def _compare_names(c: Channel, mine: Channel) -> float:
    """Return the similarity of the names of two signals, 0 .. 1."""
    return SequenceMatcher(None, c.short.lower(), mine.short.lower(), autojunk=False).ratio()


def _find_valid_value(c: Channel) -> float | None:
    """Return the value of a flag that means valid; None: unknown, or not a flag.

    If a database of the bus names bad states of the flag, e.g. "invalid", return the only
    logged value that is not a bad state; None if there are several or none. Without such
    names, return the value that at least MIN_VALID_SHARE of the rows, but not all, have;
    None if there is no such value."""
    if not FLAG_NAME.search(join_words(c.short)) and not FLAG_NAME.search(c.short):
        return None
    there = c.value[np.isfinite(c.value)]
    values, count = np.unique(there[:: max(len(there) // 100000, 1)], return_counts=True)
    if not 2 <= len(values) <= MAX_FLAG_VALUES or (values != np.round(values)).any():
        return None
    usual = int(count.argmax())
    if c.states and any(BAD_STATE_NAME.search(t.replace("_", " ")) for t in c.states.values()):
        good = [v for v in values if not BAD_STATE_NAME.search(c.states.get(float(v), "").replace("_", " "))]
        return float(good[0]) if len(good) == 1 else None
    return float(values[usual]) if MIN_VALID_SHARE <= count[usual] / count.sum() < 1.0 else None


def _count_modulo(c: Channel) -> int:
    """Return the modulo of a message counter; 0: the signal is no counter."""
    if not COUNTER_NAME.search(join_words(c.short)) and not COUNTER_NAME.search(c.short):
        return 0
    there = c.value[np.isfinite(c.value)][:100000]
    if len(there) < 50 or (there != np.round(there)).any() or there.min() < 0:
        return 0
    return find_modulo(there)


def _add_fine_part(g: Guess, mine: Channel, beside: list[Channel]) -> None:
    """Find the signal with the fine part of a coarsely sent value; add it to the guess.

    `mine`: the coarse signal. `beside`: the other signals of its message. The roughness
    (see MAX_FILLED) of coarse value + fine part must be below MAX_FILLED times the
    roughness of the coarse value alone."""
    x = mine.value
    step = _find_step(x)
    if not step or (step < COARSE_STEP * float(np.nanmax(np.abs(x))) and step < 0.5):
        return
    for c in beside:
        if not REST_NAME.search(join_words(c.short)) and not REST_NAME.search(c.short):
            continue
        rough, both = (float(np.nanmean(np.abs(np.diff(y, 2)))) for y in (x, x + c.value))
        if both < MAX_FILLED * rough and float(np.nanmax(np.abs(c.value))) <= step:
            g.add = c.name
            smoother = rough / max(both, 1e-12)
            g.figures.append(
                f"sent in steps of {step:g} {g.unit}: {c.name} has the part between the steps; the sum of "
                f"both is {smoother:.0f} times as smooth"
            )
            return
    g.figures.append(f"sent in steps of {step:g} {g.unit}")


def _find_step(x: np.ndarray) -> float:
    """Return the step in which a signal is quantised; 0: it has no constant step."""
    values = np.unique(x[np.isfinite(x)][:200000])
    if not 3 <= len(values) <= 2000:
        return 0.0
    steps = np.diff(values)
    least = float(steps.min())
    return least if np.all(np.abs(steps / least - np.round(steps / least)) < 1e-3) else 0.0


def warn_of_counting_wheels(recording: Recording) -> list[str]:
    """Return a warning if signals are tick counters of wheels, which only increase."""
    found = [
        c.name
        for c in recording
        if TICK_NAME.search(join_words(c.short))
        and len(c) > 50
        and float(np.mean(np.diff(c.value[:100000]) >= 0)) > 0.95
        and float(np.nanmax(c.value) - np.nanmin(c.value)) > 10
    ]
    if len(found) < 2:
        return []
    return [
        f"{', '.join(found[:4])} count up: tick counters of wheels are not read; convert them to speeds "
        "(2 pi x ticks per row / (ticks per turn x time between rows))"
    ]
