"""Convert the signals of a log to the channels of the library, as signals.toml states.

Values are in SI units, with sign, steering ratio and latency corrected. Each channel
keeps its own time stamps.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tse.channels.counters import find_modulo
from tse.channels.signals import Counter, Flag, SignalsFile, SignalSource, find_unit
from tse.library.errors import UserError
from tse.log.clock import straighten_time
from tse.log.rows import SIDES
from tse.log.units import unit_factor
from tse.readers.recording import Channel, Recording

# modulo of a message counter (4 bits) if signals.toml states none and the log shows none
USUAL_MODULO = 16
# [1] max share of values that a flag marks as invalid; above it, an error is raised. Also
# max share of entries in which a counter does not change; above it, the counter is not
# used. Such a flag or counter was probably misinterpreted.
MAX_LOST = 0.5


@dataclass(frozen=True)
class Series:
    """Times and values of a channel of the library, or of one wheel, before
    resampling."""

    channel: str
    time: np.ndarray  # [s]
    value: np.ndarray  # SI units; NaN: missing
    latency: float = 0.0  # [s] delay of the measurement; already subtracted from `time`
    hold: bool = False  # True: sent only if the value changes, so the last value is held


@dataclass
class Clocks:
    """Corrected times of a recording. Channels with the same logged times share an array
    of corrected times."""

    notes: list[str] = field(default_factory=list)
    # id() of an array of logged times -> this array, corrected times, mask of kept
    # entries
    _done: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=dict)
    # (id() of an array of times, latency [s]) -> times - latency
    _earlier: dict[tuple[int, float], np.ndarray] = field(default_factory=dict)

    def straighten(self, channel: Channel) -> tuple[np.ndarray, np.ndarray]:
        """Return the times of a channel, corrected so that they increase, and its values.

        Entries that the correction drops, e.g. those without a time, are left out."""
        if id(channel.time) not in self._done:
            time, keep, said = straighten_time(channel.time)
            self._done[id(channel.time)] = channel.time, time, keep
            self.notes += [x for x in said if x not in self.notes]
        _, time, keep = self._done[id(channel.time)]
        value = channel.value if keep.all() else channel.value[keep]
        return time, value

    def subtract_latency(self, time: np.ndarray, latency: float) -> np.ndarray:
        """Return `time` - `latency`. Calls with the same arguments return the same array
        object, so that channels with the same times still share an array."""
        if not latency:
            return time
        if (id(time), latency) not in self._earlier:
            self._earlier[id(time), latency] = time - latency
        return self._earlier[id(time), latency]


def map_signals(
    recording: Recording, signals: SignalsFile, car: Any | None, notes: list[str], max_lost: float = MAX_LOST
) -> dict[str, Series]:
    """Return all channels that signals.toml assigns: name of the channel -> its series.

    If signals.toml assigns two signals to an axle, the result has a series for its left
    and one for its right wheel. Two signals of steer_angle (the angles of left and right
    front wheel) are averaged.

    Parameters
    ----------
    recording : Recording
        The log.
    signals : SignalsFile
        Contents of signals.toml.
    car : Vehicle or None
        Car, with the radii of the wheels.
    notes : list of str
        The function appends its notes.
    max_lost : float
        Max share of values that a flag may mark as invalid. 1 for a short piece of a
        drive, whose values may all be invalid.

    Raises
    ------
    UserError
        A name is not in the log, a unit is wrong, or the wheel radius that is needed to
        convert a speed to rad/s is missing.
    """
    clocks = Clocks()
    found: dict[str, Series] = {}
    for channel, signal in signals.signals.items():
        parts = SIDES.get(channel, (channel, channel)) if len(signal.name) == 2 else (channel,)
        made = [
            _map_part(recording, signal, n, part, signals, clocks, car, notes, max_lost)
            for n, part in zip(signal.name, parts, strict=True)
        ]
        if channel == "steer_angle" and len(made) == 2:  # left and right front wheel
            at = made[0].time
            other = (
                made[1].value
                if np.array_equal(at, made[1].time)
                else np.interp(at, made[1].time, made[1].value)
            )
            made = [Series(channel, at, 0.5 * (made[0].value + other), made[0].latency, made[0].hold)]
        found |= {s.channel: s for s in made}
    notes += clocks.notes
    return found


def _map_part(
    recording: Recording,
    signal: SignalSource,
    name: str,
    part: str,
    signals: SignalsFile,
    clocks: Clocks,
    car: Any | None,
    notes: list[str],
    max_lost: float,
) -> Series:
    """Make one channel, or one wheel of an axle, from the signal `name`.

    `part`: name of the channel or wheel that is returned. `signal`: table of the channel
    in signals.toml. `max_lost`: as in map_signals()."""
    source = (
        f"{signals.path}: [signals.{signal.channel}] name" if signals.path else f"channel {signal.channel}"
    )
    channel = recording.find(name, source)
    time, value = clocks.straighten(channel)
    if signal.add is not None:
        value = value + _hold_last(
            clocks, recording.find(signal.add, source.replace("] name", "] add")), time
        )
    per = _find_factor(signal, channel, part, car, source, notes)
    if signal.offset:
        value = value - signal.offset
    if (gain := per * signal.scale * signal.sign) != 1.0:
        value = value * gain
    if signal.sign_bit is not None:
        bit = recording.find(signal.sign_bit, source.replace("] name", "] sign_bit"))
        value = np.where(_hold_last(clocks, bit, time) > 0.5, -value, value)
    if signal.above is not None:
        value = np.where(np.isfinite(value), 1.0 * (value > signal.above), np.nan)
    if signal.ratio is not None:
        value = value / (
            signal.ratio if isinstance(signal.ratio, float) else _interpolate_ratio(signal, value, per)
        )
    value = value.copy()
    if signal.valid is not None:
        _drop_invalid(recording, clocks, signal.valid, time, value, source, part, notes, max_lost)
    if signal.counter is not None:
        _drop_repeated(recording, clocks, signal.counter, time, value, source, part, notes)
    value[~np.isfinite(value)] = np.nan
    return Series(
        part, clocks.subtract_latency(time, signal.latency + signal.clock), value, signal.latency, signal.hold
    )


def _find_factor(
    signal: SignalSource, channel: Channel, part: str, car: Any | None, source: str, notes: list[str]
) -> float:
    """Return the factor from the unit of a signal to the SI unit of the channel `part`.

    If neither signals.toml nor the log states a unit, return 1 and append a note. A
    unit that cannot be converted raises UserError. A reference (ref_*) and a signal
    with a threshold (`signal.above`) are not converted: return 1."""
    if part.startswith("ref_") or signal.above is not None:
        return 1.0
    wanted = find_unit(part)
    unit = signal.unit if signal.unit is not None else channel.unit
    if not unit:
        notes.append(
            f"{part}: the unit of {channel.name!r} is unknown (neither in the log nor in signals.toml): "
            f"{wanted} is assumed"
        )
        return 1.0
    radius = signal.radius
    if radius is None and car is not None and "wheel_speed" in part:
        radius = car.values.get("wheel_radius_front" if "front" in part else "wheel_radius_rear")
    per = unit_factor(unit, wanted, radius)
    if per is None:
        where = "" if signal.unit is not None else f" (of {channel.name!r} in the log)"
        if "wheel_speed" in part and unit_factor(unit, wanted, 1.0) is not None:
            raise UserError(
                f"{source}: to convert {unit}{where} to {wanted}, the radius of the wheel is needed: give a "
                "vehicle file (--vehicle), or state the radius in m next to the unit, e.g. radius = 0.31"
            )
        raise UserError(
            f"{source}: unit {unit!r}{where} cannot be converted to {wanted}; if the log is wrong, state the "
            'correct unit: unit = "..."'
        )
    return per


def _interpolate_ratio(signal: SignalSource, value: np.ndarray, per: float) -> np.ndarray:
    """Return the steering ratio at each angle of the steering wheel.

    The ratio is interpolated linearly in the table signal.ratio, whose rows are (angle of
    the steering wheel, ratio). `value`: [rad] angles of the steering wheel. `per`: factor
    from the unit of the angles in the table to rad; its sign is ignored."""
    angles, ratios = np.array(signal.ratio, float).T
    return np.interp(value / abs(per), angles, ratios)


def _hold_last(clocks: Clocks, channel: Channel, time: np.ndarray) -> np.ndarray:
    """Return the last value of a channel at or before each of the times `time`."""
    own, value = clocks.straighten(channel)
    if not len(own):
        return np.full(len(time), np.nan)
    return value[np.clip(np.searchsorted(own, time + 1e-9, side="right") - 1, 0, len(own) - 1)]


def _drop_invalid(
    recording: Recording,
    clocks: Clocks,
    flag: Flag,
    time: np.ndarray,
    value: np.ndarray,
    source: str,
    part: str,
    notes: list[str],
    max_lost: float,
) -> None:
    """Set to NaN the values that a flag marks as invalid."""
    state = _hold_last(clocks, recording.find(flag.name, source.replace("] name", "] valid")), time)
    bad = (state == 0) if flag.values is None else ~np.isin(state, flag.values)
    bad |= ~np.isfinite(state)
    if not bad.any():
        return
    if bad.mean() > max_lost:
        is_now = ", ".join(f"{v:g}" for v in np.unique(state[np.isfinite(state)])[:5])
        raise UserError(
            f"{source.replace('] name', '] valid')}: {flag.name!r} marks {100 * bad.mean():.0f} % of {part} "
            "as invalid; it has the "
            f"values {is_now}: "
            'state which of them mean valid: {name = "...", is = [0]}'
        )
    value[bad] = np.nan
    notes.append(f"{part}: {bad.sum()} values that {flag.name} marks as invalid are treated as missing")


def _drop_repeated(
    recording: Recording,
    clocks: Clocks,
    counter: Counter,
    time: np.ndarray,
    value: np.ndarray,
    source: str,
    part: str,
    notes: list[str],
) -> None:
    """Set to NaN the values of repeated messages; append a note on lost messages.

    The counter increases by 1 (modulo its range) with each new message. If it equals that
    of the message before, the message is a repetition. If it increases by n > 1, n - 1
    messages were lost."""
    state = _hold_last(clocks, recording.find(counter.name, source.replace("] name", "] counter")), time)
    modulo = counter.modulo or find_modulo(state) or USUAL_MODULO
    step = np.mod(np.diff(state), modulo)
    again = np.append(False, step == 0)
    if again.mean() > MAX_LOST:
        notes.append(
            f"{part}: the counter {counter.name} does not count in {100 * again.mean():.0f} % of the "
            "entries: not used"
        )
        return
    lost = int(np.nansum(np.where(step > 1, step - 1, 0)))
    if again.any():
        value[again] = np.nan
        notes.append(
            f"{part}: {again.sum()} entries with the same counter {counter.name} as the entry before are "
            "treated as missing"
        )
    if lost:
        notes.append(f"{part}: {lost} messages are lost according to the counter {counter.name}")
