"""From channels with times of their own to rows: band-limited, held values recognised, gaps kept."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from tse.channels.mapping import Series
from tse.log.noise import fresh
from tse.log.rows import DRIVES, MEASURES, SIDES, VELOCITIES
from tse.readers.recording import PIECE, ROW, check_rows

MAX_DEFAULT_RATE = 100.0  # Hz: of a raster nobody has asked for: the filter is tuned there, and above it rows of a bus are mostly held
MIN_OWN_RATE = 5.0  # Hz: a slower channel asks for no raster
GAP_STEPS, MIN_GAP, MAX_GAP = (
    6.0,
    0.25,
    1.0,
)  # a gap is so many usual steps of its channel, s at least, s at most
BURST_STEP = 0.25  # of a usual step: entries that are nearer than that are one, a burst of the bus
EVEN_STEP = 0.01  # of a step: times that are off an even beat by less are even
PASS_BAND, PASS_STEPS = (
    0.45,
    6,
)  # the low pass ends at so much of the new rate, and is so many new steps long on either side
DENSE_RATIO = (
    4.0  # times the rate that is asked for: of entries that are low-passed and as near to each other
)
MIN_FILLED = (
    0.8  # share of rows with a value below which a column of a table is of another rate, or an outer join's
)
SPLINE_REACH = 600  # entries over which a cubic spline feels another: 0.27 ** 600 is less than the smallest number beside 0
SAME = 1e-3  # of a step: a raster that meets the entries takes them as they are


@dataclass
class Rows:
    """Channels on one raster. `value`: by channel, (rows,), NaN missing."""

    time: np.ndarray
    value: dict[str, np.ndarray]
    rate: float
    notes: list[str] = field(default_factory=list)
    native: dict[str, tuple[np.ndarray, np.ndarray, float]] = field(
        default_factory=dict
    )  # slower channels: time, value, Hz


def select_entries(s: Series) -> tuple[np.ndarray, np.ndarray]:
    """Times and values that are new: without what is missing, held, or two in one burst."""
    there = np.isfinite(s.value)
    time, value = (s.time, s.value) if there.all() else (s.time[there], s.value[there])
    if s.hold or len(time) < 3:
        return time, value
    new = fresh(value)
    time, value = (time, value) if new.all() else (time[new], value[new])
    step = np.diff(time)
    if len(step) and (step < BURST_STEP * np.median(step)).any():
        first = np.append(True, step >= BURST_STEP * np.median(step))
        starts = np.flatnonzero(first)
        count = np.diff(np.append(starts, len(time)))
        time, value = (np.add.reduceat(x, starts) / count for x in (time, value))
    return time, value


def find_rate(time: np.ndarray) -> float:
    """Usual entries per second; 0: too few to tell."""
    step = np.diff(time)
    step = step[step > 0]
    return 1.0 / float(np.median(step)) if len(step) else 0.0


def resample_channels(found: Mapping[str, Series], rate: float | None, path: Path | None = None) -> Rows:
    """All channels on rows at `rate`, Hz; None: the fastest channel's, up to FASTEST. A table whose columns share an even, full
    time is left as it is. UserError: more rows than the file at `path` may have."""
    plain = _keep_table(found, rate)
    if plain is not None:
        if path is not None:
            check_rows(path, "it", len(plain.time), ROW)
        return plain
    own, rates = {}, {}
    for name, s in found.items():
        own[name] = select_entries(s)
        rates[name] = find_rate(own[name][0])
    core = [n for n in found if is_core(n)]
    rate = choose_rate([rates[n] for n in core]) if rate is None else rate
    time = _make_times(own, rates, core, rate, path)
    rows = Rows(time, {}, rate)
    keep = np.zeros(len(time), bool) if core else np.ones(len(time), bool)
    for name, s in found.items():
        t, x = own[name]
        if name in VELOCITIES:  # a measurement each: none is made of two, and none is held
            rows.value[name] = _place_entries(t, x, time)
        else:
            held = s.hold or name == "brake"  # a switch
            rows.value[name] = hold(t, x, time) if held else resample(t, x, time, rate)
        if name in core:
            keep |= np.isfinite(rows.value[name])
        if not s.hold and 0 < rates[name] < 0.9 * rate and name not in VELOCITIES:
            rows.native[name] = t, x, rates[name]
    if not keep.all():
        rows.time = time[keep]
        rows.value = {name: x[keep] for name, x in rows.value.items()}
    _add_notes(rows, found, rates)
    return rows


def is_core(name: str) -> bool:
    """Return whether a channel is one of those that rows are made for: what drives the model, and what is compared with it."""
    return _find_axle(name) in (*DRIVES, *MEASURES)


def choose_rate(rates: Sequence[float]) -> float:
    """Return the rate of a raster that nobody has asked for, Hz, from those of the channels in is_core()."""
    rate = min(max((r for r in rates if r >= MIN_OWN_RATE), default=10.0), MAX_DEFAULT_RATE)
    return round(rate) if abs(rate - round(rate)) < 0.02 * rate else rate


def resample(t: np.ndarray, x: np.ndarray, time: np.ndarray, rate: float) -> np.ndarray:
    """A channel with entries x at t, (entries,), at other times, (rows,), that come `rate` a second: low-passed where they are
    fewer, by cubic splines where they are more; NaN in gaps and before and after."""
    out = np.full(len(time), np.nan)
    if not len(t):
        return out
    usual = (
        float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    ) or 1.0 / rate  # 0: steps lost in the last digit
    cuts = np.append(0, np.append(1 + np.flatnonzero(np.diff(t) > find_longest_gap(usual)), len(t)))
    margin = 0.5 * usual
    for first, last in pairwise(cuts):
        part, value = t[first:last], x[first:last]
        rows = slice(*np.searchsorted(time, [part[0] - margin, part[-1] + margin + 1e-9]))
        if rows.start == rows.stop:
            continue
        between = _interpolate_spline
        if len(part) > 3 and 1.0 / usual > 1.2 * rate:
            part, value = _filter_low_pass(part, value, usual, rate)
            if len(part) > 3 and 1.0 / usual > DENSE_RATIO * rate:
                between = _interpolate_cubic
        count = max(1, round(PIECE * min(1.0, rate * usual)))  # rows of so many entries
        for begin in range(rows.start, rows.stop, count):
            piece = slice(begin, min(begin + count, rows.stop))
            out[piece] = between(part, value, np.clip(time[piece], part[0], part[-1]))
    return out


def find_longest_gap(usual: float) -> float:
    """Return how far entries that are usually so far apart may be, s, for a value in between."""
    return min(max(GAP_STEPS * usual, MIN_GAP), max(MAX_GAP, 2.5 * usual))


def _interpolate_spline(t: np.ndarray, x: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The cubic spline through x at t, (entries,), where it is asked for, (times,), increasing; of few entries straight lines.
    Only entries that it feels there are looked at: its coefficients for ten hours are 300 MB."""
    if len(t) < 4:
        return np.interp(at, t, x)
    first, last = np.searchsorted(t, at[[0, -1]])
    part = slice(max(0, min(int(first) - SPLINE_REACH, len(t) - 4)), int(last) + SPLINE_REACH)
    own, value = t[part], x[part]
    if not (np.diff(own) > 0).all():  # times so large that their steps are lost in their last digit
        new = np.append(True, np.diff(np.maximum.accumulate(own)) > 0)
        own, value = own[new], value[new]
        if len(own) < 4:
            return np.interp(at, own, value)
    from scipy.interpolate import CubicSpline

    try:
        return CubicSpline(own, value)(at)
    except ValueError:  # values so large that their slope is none
        return np.interp(at, own, value)


def _interpolate_cubic(t: np.ndarray, x: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The cubic through the four entries of an even grid around each time: as good as a spline where entries are DENSE."""
    s = (at - t[0]) * ((len(t) - 1) / (t[-1] - t[0]))
    i = np.clip(s.astype(int) - 1, 0, len(t) - 4)
    s -= i
    outer, inner = s * (s - 3.0), (s - 1.0) * (s - 2.0)
    return (s * inner * x[i + 3] - (s - 3.0) * inner * x[i]) / 6.0 + (
        (s - 2.0) * x[i + 1] - (s - 1.0) * x[i + 2]
    ) * outer / 2.0


def _filter_low_pass(
    t: np.ndarray, x: np.ndarray, usual: float, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """An even grid of the entries' own step, and what the signal is there below PASS of `rate`; no phase."""
    n = max(2, round((t[-1] - t[0]) / usual) + 1)
    even = np.linspace(t[0], t[-1], n)
    value = x if n == len(t) and np.max(np.abs(t - even)) < EVEN_STEP * usual else np.interp(even, t, x)
    half = min(max(1, round(PASS_STEPS / (rate * usual))), max(1, (n - 1) // 2))
    kernel = np.sinc(2.0 * PASS_BAND * rate * usual * np.arange(-half, half + 1)) * np.hamming(2 * half + 1)
    kernel /= kernel.sum()
    of_kernel = np.zeros(0)
    # ends go on as they are mirrored about their last value: a straight line stays one
    before, after = 2 * value[0] - value[half:0:-1], 2 * value[-1] - value[-2 : -half - 2 : -1]
    longer, found = np.concatenate([before, value, after]), np.empty(n)
    for begin in range(0, n, PIECE):
        part = longer[begin : begin + PIECE + 2 * half]
        size = 1 << (len(part) - 1).bit_length()  # enough: what goes round falls on what is left out
        if len(of_kernel) != size // 2 + 1:
            of_kernel = np.fft.rfft(kernel, size)
        both = np.fft.rfft(part, size) * of_kernel
        found[begin : begin + PIECE] = np.fft.irfft(both, size)[2 * half : len(part)]
    return even, found


def hold(t: np.ndarray, x: np.ndarray, time: np.ndarray) -> np.ndarray:
    if not len(t):
        return np.full(len(time), np.nan)
    at = np.searchsorted(t, time + 1e-9, side="right") - 1
    return np.where(at >= 0, x[np.maximum(at, 0)], np.nan)


def _place_entries(t: np.ndarray, x: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return each entry in the row that is nearest to it, (rows,), NaN in all others."""
    out = np.full(len(time), np.nan)
    if len(t) and len(time):
        at = (
            np.clip(np.searchsorted(time, t), 1, max(1, len(time) - 1))
            if len(time) > 1
            else np.zeros(len(t), int)
        )
        at = at - (t - time[at - 1] < time[at] - t) if len(time) > 1 else at
        near = np.abs(time[at] - t) <= (np.median(np.diff(time)) if len(time) > 1 else np.inf)
        out[at[near]] = x[near]
    return out


def _find_axle(name: str) -> str:
    return next((axle for axle, pair in SIDES.items() if name in pair), name)


def _keep_table(found: Mapping[str, Series], rate: float | None) -> Rows | None:
    """A table that needs nothing: one time, no latency, few holes, not too fast."""
    first = next(iter(found.values()), None)
    if first is None or len(first.time) < 2 or any(s.hold or s.latency for s in found.values()):
        return None
    if not all(s.time is first.time or np.array_equal(s.time, first.time) for s in found.values()):
        return None
    own = find_rate(first.time)
    if (rate is not None and abs(rate - own) > 0.01 * own) or (own > 1.5 * MAX_DEFAULT_RATE and rate is None):
        return None
    full = [s for n, s in found.items() if n not in VELOCITIES]
    sparse = [s for s in full if np.isfinite(s.value).any() and np.isfinite(s.value).mean() < MIN_FILLED]
    if any(
        np.median(np.diff(np.flatnonzero(np.isfinite(s.value)))) > 1
        for s in sparse
        if np.isfinite(s.value).sum() > 1
    ):
        return None
    return Rows(first.time, {n: s.value for n, s in found.items()}, own)


def _make_times(
    own: Mapping[str, tuple[np.ndarray, np.ndarray]],
    rates: Mapping[str, float],
    core: list[str],
    rate: float,
    path: Path | None,
) -> np.ndarray:
    """Rows from where the driver's channels begin to where the first of them ends, on the beat of the clock: the gyro, if it can.
    No row where no channel has an entry."""
    spans = {n: (own[n][0][0], own[n][0][-1]) for n in core if len(own[n][0])}
    if not spans:
        return np.zeros(0)
    drives = {n: s for n, s in spans.items() if _find_axle(n) in DRIVES} or spans
    first, last = max(s[0] for s in drives.values()), min(s[1] for s in drives.values())
    if last <= first:
        first, last = min(s[0] for s in spans.values()), max(s[1] for s in spans.values())
    start = start_on_beat({n: own[n][0] for n in core}, rates, rate, first)
    count = max(1, int(np.floor((last - start) * rate + 1e-6)) + 1)
    if path is not None:
        check_rows(path, f"from its first to its last value at {rate:g} Hz it", count, ROW)
    return start + np.arange(count) / rate


def start_on_beat(
    times: Mapping[str, np.ndarray], rates: Mapping[str, float], rate: float, first: float
) -> float:
    """Return the time of the first row, not before `first`, s: on the beat of a channel that has the rate of the rows.

    Parameters
    ----------
    times : mapping of str to ndarray, (entries,)
        Of the channels in is_core(), s.
    rates : mapping of str to float
        Their rates, Hz.
    rate : float
        Of the rows, Hz.
    first : float
        s.
    """
    names = [n for n in ("yaw_rate", "accel_y", "accel_x", *times) if n in times and len(times[n])]
    clock = next((times[n] for n in names if abs(rates[n] - rate) < 0.02 * rate), None)
    phase = first if clock is None else clock[np.searchsorted(clock, first).clip(0, len(clock) - 1)]
    return float(phase + np.ceil((first - phase) * rate - 1e-6) / rate)


def _add_notes(rows: Rows, found: Mapping[str, Series], rates: Mapping[str, float]) -> None:
    parts: dict[int, list[str]] = {}
    for n, r in rates.items():
        parts.setdefault(round(r), []).append(n)
    own = "; ".join(f"{', '.join(names)}: {r} Hz" for r, names in sorted(parts.items(), reverse=True))
    rows.notes.append(f"resampled to {rows.rate:g} Hz ({own})")
    late = {n: s.latency for n, s in found.items() if s.latency}
    if late:
        rows.notes.append(
            "taken earlier by their latency: " + ", ".join(f"{n} {1e3 * v:g} ms" for n, v in late.items())
        )
