"""Resample channels with their own times to common rows.

An entry is a value of a channel with its time. Channels that are faster than the rows are
low-passed. If a bus repeats the last value of a slow sensor, the repetitions are removed
before interpolation. Gaps are not filled.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from tse.channels.mapping import Series
from tse.log.noise import find_new_values
from tse.log.rows import DRIVES, MEASURES, SIDES, VELOCITY_COLUMNS
from tse.readers.recording import CHUNK_ROWS, MIN_ROW_BYTES, check_rows

# [Hz] max rate of the rows, unless the user chooses one. The filter is tuned for this
# rate. Faster signals of a bus mostly repeat their values.
MAX_DEFAULT_RATE = 100.0
MIN_OWN_RATE = 5.0  # [Hz] a slower channel does not determine the rate of the rows
# A step between two entries of a channel is a gap if it is longer than the limit
# min(max(GAP_STEPS x m, MIN_GAP), max(MAX_GAP, 2.5 x m)), with m: median step [s] of the
# channel. MIN_GAP and MAX_GAP are in s. Rows in a gap are NaN. Shorter steps are
# interpolated.
GAP_STEPS, MIN_GAP, MAX_GAP = 6.0, 0.25, 1.0
# [median steps] Entries closer together than this were sent in a burst and are averaged.
BURST_STEP = 0.25
# [median steps] Times are taken as equidistant if none deviates from an even raster by
# more than this.
EVEN_STEP = 0.01
PASS_BAND = 0.45  # [1] cut-off frequency of the low pass / rate of the rows
PASS_STEPS = 6  # [rows] half length of the kernel of the low pass
# [1] If rate of a low-passed channel / rate of the rows exceeds this, the channel is
# interpolated by a cubic through four entries instead of a spline. The cubic is then as
# accurate as the spline, and faster to compute.
DENSE_RATIO = 4.0
# [1] A column with values in less than this share of the rows of a table may have a lower
# rate than the rows. If the median distance of its values exceeds 1 row, the table is
# resampled. Otherwise, the rows of the table are kept.
MIN_FILLED = 0.8
# [entries] A value of a cubic spline depends only on the entries within this distance.
# The influence of an entry decays by the factor 0.27 per entry of distance, and 0.27 **
# 600 is 0 in double precision.
SPLINE_REACH = 600


@dataclass
class RasterRows:
    """Channels resampled to common rows."""

    time: np.ndarray  # [s]
    value: dict[str, np.ndarray]  # channel -> values, (rows,); NaN: missing
    rate: float  # [Hz] rate of the rows
    notes: list[str] = field(default_factory=list)
    # Original entries of the channels that are slower than the rows. Interpolation
    # smooths the noise of such a channel, so the noise is estimated from these entries.
    # Key: channel. Value: (times [s] of its entries, their values, their rate [Hz]).
    native: dict[str, tuple[np.ndarray, np.ndarray, float]] = field(default_factory=dict)


def select_entries(s: Series) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values of the entries that are new measurements.

    Missing values are left out, and so are held values, i.e. values that the bus repeats
    until the next measurement. Entries of a burst, i.e. entries that are closer together
    than BURST_STEP median steps, are averaged. If `s.hold` is True, the channel is only
    sent when it changes, and all its values are returned."""
    there = np.isfinite(s.value)
    time, value = (s.time, s.value) if there.all() else (s.time[there], s.value[there])
    if s.hold or len(time) < 3:
        return time, value
    new = find_new_values(value)
    time, value = (time, value) if new.all() else (time[new], value[new])
    step = np.diff(time)
    if len(step) and (step < BURST_STEP * np.median(step)).any():
        first = np.append(True, step >= BURST_STEP * np.median(step))
        starts = np.flatnonzero(first)
        count = np.diff(np.append(starts, len(time)))
        time, value = (np.add.reduceat(x, starts) / count for x in (time, value))
    return time, value


def find_rate(time: np.ndarray) -> float:
    """Return the rate of entries from their median step, Hz; 0: too few entries."""
    step = np.diff(time)
    step = step[step > 0]
    return 1.0 / float(np.median(step)) if len(step) else 0.0


def resample_channels(
    found: Mapping[str, Series], rate: float | None, path: Path | None = None
) -> RasterRows:
    """Resample all channels to common rows.

    Parameters
    ----------
    found : mapping of str to Series
        The channels.
    rate : float or None
        [Hz] Rate of the rows. None: it is chosen here. If the channels are columns of a
        table with the same times and few missing values, the rows of the table are kept.
        Otherwise, the rate is that of the fastest channel, at most MAX_DEFAULT_RATE.
    path : Path, optional
        The file. Its size limits the number of rows, see check_rows(). None: no limit.

    Raises
    ------
    UserError
        There are more rows than a file of this size can contain.
    """
    plain = _keep_table(found, rate)
    if plain is not None:
        if path is not None:
            check_rows(path, "it", len(plain.time), MIN_ROW_BYTES)
        return plain
    own, rates = {}, {}
    for name, s in found.items():
        own[name] = select_entries(s)
        rates[name] = find_rate(own[name][0])
    core = [n for n in found if is_core(n)]
    rate = choose_rate([rates[n] for n in core]) if rate is None else rate
    time = _make_times(own, rates, core, rate, path)
    rows = RasterRows(time, {}, rate)
    keep = np.zeros(len(time), bool) if core else np.ones(len(time), bool)
    for name, s in found.items():
        t, x = own[name]
        if name in VELOCITY_COLUMNS:  # the filter needs each measurement once: neither interpolated nor held
            rows.value[name] = _place_entries(t, x, time)
        else:
            held = s.hold or name == "brake"  # the brake is a switch: do not interpolate it
            rows.value[name] = hold(t, x, time) if held else resample(t, x, time, rate)
        if name in core:
            keep |= np.isfinite(rows.value[name])
        if not s.hold and 0 < rates[name] < 0.9 * rate and name not in VELOCITY_COLUMNS:
            rows.native[name] = t, x, rates[name]
    if not keep.all():
        rows.time = time[keep]
        rows.value = {name: x[keep] for name, x in rows.value.items()}
    _add_notes(rows, found, rates)
    return rows


def is_core(name: str) -> bool:
    """Return whether a channel is an input of the model, or measures an output of it."""
    return _find_axle(name) in (*DRIVES, *MEASURES)


def choose_rate(rates: Sequence[float]) -> float:
    """Return the default rate of the rows, Hz: the highest rate of a channel, but at most
    MAX_DEFAULT_RATE. If no channel reaches MIN_OWN_RATE, the default rate is 10 Hz.

    `rates`: rates of the channels for which is_core() is True, Hz."""
    rate = min(max((r for r in rates if r >= MIN_OWN_RATE), default=10.0), MAX_DEFAULT_RATE)
    return round(rate) if abs(rate - round(rate)) < 0.02 * rate else rate


def resample(t: np.ndarray, x: np.ndarray, time: np.ndarray, rate: float) -> np.ndarray:
    """Return a channel resampled to the times of the rows.

    Parameters
    ----------
    t, x : ndarray, (entries,)
        Times, s, and values of the channel.
    time : ndarray, (rows,)
        Times of the rows, s.
    rate : float
        Rate of the rows, Hz. A faster channel is low-passed. A slower one is interpolated
        by cubic splines.

    Returns
    -------
    ndarray, (rows,)
        Values; NaN in gaps, before the first entry and after the last one.
    """
    out = np.full(len(time), np.nan)
    if not len(t):
        return out
    usual = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    usual = usual or 1.0 / rate  # the median is 0 if times are so large that steps round to 0
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
        count = max(1, round(CHUNK_ROWS * min(1.0, rate * usual)))  # rows that need CHUNK_ROWS entries
        for begin in range(rows.start, rows.stop, count):
            piece = slice(begin, min(begin + count, rows.stop))
            out[piece] = between(part, value, np.clip(time[piece], part[0], part[-1]))
    return out


def find_longest_gap(usual: float) -> float:
    """Return the longest step between entries that is interpolated, s.

    `usual`: median step, s."""
    return min(max(GAP_STEPS * usual, MIN_GAP), max(MAX_GAP, 2.5 * usual))


def _interpolate_spline(t: np.ndarray, x: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the cubic spline through the entries (t, x) at increasing times `at`.

    Fewer than 4 entries are interpolated linearly. Only entries within SPLINE_REACH of
    the times are used, because the coefficients of a spline through all entries of a log
    of ten hours would need 300 MB."""
    if len(t) < 4:
        return np.interp(at, t, x)
    first, last = np.searchsorted(t, at[[0, -1]])
    part = slice(max(0, min(int(first) - SPLINE_REACH, len(t) - 4)), int(last) + SPLINE_REACH)
    own, value = t[part], x[part]
    if not (np.diff(own) > 0).all():  # times are so large that some steps round to 0
        new = np.append(True, np.diff(np.maximum.accumulate(own)) > 0)
        own, value = own[new], value[new]
        if len(own) < 4:
            return np.interp(at, own, value)
    from scipy.interpolate import CubicSpline

    try:
        return CubicSpline(own, value)(at)
    except ValueError:  # values are so large that their differences overflow
        return np.interp(at, own, value)


def _interpolate_cubic(t: np.ndarray, x: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Interpolate at each time by the cubic through the four nearest entries.

    The entries (t, x) are equidistant. If their rate is much higher than that of the rows
    (DENSE_RATIO), the result is as accurate as that of a spline."""
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
    """Return equidistant times with the step of the entries, and the low-passed signal.

    `rate`: [Hz] rate of the rows. The cut-off frequency is PASS_BAND x `rate`. The kernel
    is symmetric and causes no delay. `usual`: [s] median step of the entries."""
    n = max(2, round((t[-1] - t[0]) / usual) + 1)
    even = np.linspace(t[0], t[-1], n)
    value = x if n == len(t) and np.max(np.abs(t - even)) < EVEN_STEP * usual else np.interp(even, t, x)
    half = min(max(1, round(PASS_STEPS / (rate * usual))), max(1, (n - 1) // 2))
    kernel = np.sinc(2.0 * PASS_BAND * rate * usual * np.arange(-half, half + 1)) * np.hamming(2 * half + 1)
    kernel /= kernel.sum()
    of_kernel = np.zeros(0)
    # extend both ends by point reflection, so that a straight line stays straight
    before, after = 2 * value[0] - value[half:0:-1], 2 * value[-1] - value[-2 : -half - 2 : -1]
    longer, found = np.concatenate([before, value, after]), np.empty(n)
    for begin in range(0, n, CHUNK_ROWS):
        part = longer[begin : begin + CHUNK_ROWS + 2 * half]
        # drop the first 2 * half values, which are wrong, since the FFT wraps around
        size = 1 << (len(part) - 1).bit_length()
        if len(of_kernel) != size // 2 + 1:
            of_kernel = np.fft.rfft(kernel, size)
        both = np.fft.rfft(part, size) * of_kernel
        found[begin : begin + CHUNK_ROWS] = np.fft.irfft(both, size)[2 * half : len(part)]
    return even, found


def hold(t: np.ndarray, x: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the last value at or before each row; NaN before the first entry."""
    if not len(t):
        return np.full(len(time), np.nan)
    at = np.searchsorted(t, time + 1e-9, side="right") - 1
    return np.where(at >= 0, x[np.maximum(at, 0)], np.nan)


def _place_entries(t: np.ndarray, x: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return a column with each entry in the row nearest to it, NaN in all other rows.

    Entries more than one median step of the rows from their nearest row are dropped."""
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
    """Return the axle channel to which a wheel channel belongs; other names unchanged."""
    return next((axle for axle, pair in SIDES.items() if name in pair), name)


def _keep_table(found: Mapping[str, Series], rate: float | None) -> RasterRows | None:
    """Return the rows of a table as they are. Return None if they must be resampled.

    The rows are kept if all columns have the same times, no latency, no held values and
    few missing values, and if the rate of the rows is `rate` [Hz]. If `rate` is None, any
    rate up to 1.5 x MAX_DEFAULT_RATE is accepted."""
    first = next(iter(found.values()), None)
    if first is None or len(first.time) < 2 or any(s.hold or s.latency for s in found.values()):
        return None
    if not all(s.time is first.time or np.array_equal(s.time, first.time) for s in found.values()):
        return None
    own = find_rate(first.time)
    if (rate is not None and abs(rate - own) > 0.01 * own) or (own > 1.5 * MAX_DEFAULT_RATE and rate is None):
        return None
    full = [s for n, s in found.items() if n not in VELOCITY_COLUMNS]
    sparse = [s for s in full if np.isfinite(s.value).any() and np.isfinite(s.value).mean() < MIN_FILLED]
    if any(
        np.median(np.diff(np.flatnonzero(np.isfinite(s.value)))) > 1
        for s in sparse
        if np.isfinite(s.value).sum() > 1
    ):
        return None
    return RasterRows(first.time, {n: s.value for n, s in found.items()}, own)


def _make_times(
    own: Mapping[str, tuple[np.ndarray, np.ndarray]],
    rates: Mapping[str, float],
    core: list[str],
    rate: float,
    path: Path | None,
) -> np.ndarray:
    """Return the times of the rows, s.

    The rows cover the interval in which all inputs of the model (steering angle and wheel
    speeds) are present. If there is no such interval, they cover all entries of the
    channels in `core`. If a channel has the rate of the rows, the rows coincide with its
    entries, so that it need not be interpolated. If several channels have this rate,
    yaw_rate is preferred. If none has it, the first row is at the start of the interval.

    `own`: channel -> its times [s] and values. `rates`: channel -> its rate [Hz]. `core`:
    channels for which is_core() is True."""
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
        check_rows(path, f"from its first to its last value at {rate:g} Hz it", count, MIN_ROW_BYTES)
    return start + np.arange(count) / rate


def start_on_beat(
    times: Mapping[str, np.ndarray], rates: Mapping[str, float], rate: float, first: float
) -> float:
    """Return the time of the first row, s.

    If a channel has the rate of the rows, the first row is a whole number of steps away
    from an entry of this channel, so that rows and entries coincide. If no channel has
    this rate, the first row is at the time `first`.

    Parameters
    ----------
    times : mapping of str to ndarray, (entries,)
        [s] Times of the channels for which is_core() is True.
    rates : mapping of str to float
        Rates of these channels, Hz.
    rate : float
        Rate of the rows, Hz.
    first : float
        Earliest time of the first row, s.
    """
    names = [n for n in ("yaw_rate", "accel_y", "accel_x", *times) if n in times and len(times[n])]
    clock = next((times[n] for n in names if abs(rates[n] - rate) < 0.02 * rate), None)
    phase = first if clock is None else clock[np.searchsorted(clock, first).clip(0, len(clock) - 1)]
    return float(phase + np.ceil((first - phase) * rate - 1e-6) / rate)


def _add_notes(rows: RasterRows, found: Mapping[str, Series], rates: Mapping[str, float]) -> None:
    """Append notes to `rows.notes`: rates and latencies of the channels."""
    parts: dict[int, list[str]] = {}
    for n, r in rates.items():
        parts.setdefault(round(r), []).append(n)
    own = "; ".join(f"{', '.join(names)}: {r} Hz" for r, names in sorted(parts.items(), reverse=True))
    rows.notes.append(f"resampled to {rows.rate:g} Hz ({own})")
    late = {n: s.latency for n, s in found.items() if s.latency}
    if late:
        rows.notes.append(
            "moved earlier by their latency: " + ", ".join(f"{n} {1e3 * v:g} ms" for n, v in late.items())
        )
