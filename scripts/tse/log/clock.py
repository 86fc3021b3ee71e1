"""Repair the times of a log, and describe each repair in a note for the user.

Equal times, times in the wrong order and jumps of the clock are repaired. An entry is a
row, frame or sample of a log."""

import numpy as np

DAY = 86400.0  # [s]
# An entry whose time is below T, the highest time before it, is "late" (delayed in a
# buffer) if its time is at least T - MAX_LATE_TIME and one of the next MAX_LATE_ROWS / 2
# entries has a time above T. Otherwise the clock was set back.
MAX_LATE_ROWS = 8
MAX_LATE_TIME = 0.5  # [s]
# [s] longest step between rows that the C library accepts. A longer step is taken as a
# jump of the clock
MAX_TIME_GAP = 3600.0
BRIDGED_GAP = 60.0  # [s] gap that replaces a jump beyond MAX_TIME_GAP; longer than any transient of a car


def straighten_time(time: np.ndarray, together: bool = False) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Repair times, so that they increase from entry to entry.

    Parameters
    ----------
    time : ndarray, (entries,)
        [s] Times in the order of the file. NaN: missing.
    together : bool
        True: successive entries may have the same time, as frames of a bus do. These
        times are not repaired.

    Returns
    -------
    ndarray, (kept entries,)
        [s] Repaired times of the kept entries.
    ndarray of bool, (entries,)
        True for the kept entries.
    list of str
        Notes about the repairs.

    Notes
    -----
    - Entries without a time and late entries (see MAX_LATE_TIME) are dropped.
    - Where the clock was set back or has overflowed, all later times are shifted, so that
      the step becomes the median of all positive steps.
    - Of entries with the same time, the last one is kept, unless `together` is True. But
      if more than 20 % of the entries have the time of the next entry (coarse clock), all
      are kept and spread evenly up to the next time.
    - A jump ahead by more than MAX_TIME_GAP becomes a gap of BRIDGED_GAP.
    """
    notes: list[str] = []
    keep = np.isfinite(time)
    if len(time) > 1 and keep.all():  # the usual case, without copies
        step = np.diff(time)
        if (step.min() > 0 or (together and step.min() == 0)) and step.max() <= MAX_TIME_GAP:
            return time, keep, notes
    if not keep.all():
        notes.append(f"{(~keep).sum()} entries without a time are left out")
    at = np.flatnonzero(keep)
    t = time[at].astype(float)
    if len(t) < 2:
        return t, keep, notes
    step = np.diff(t)
    if ((step > 0) | (together & (step == 0))).all() and step.max() <= MAX_TIME_GAP:
        return t, keep, notes
    ahead = step[step > 0]
    usual = float(np.median(ahead)) if len(ahead) else 0.01
    t, late, sets = _unwind_clock(t, usual)
    if sets:
        first = sets[0]
        notes.append(
            f"the clock goes back {len(sets)} time{'s' if len(sets) > 1 else ''} "
            f"(first by {first[1]:.3g} s at {first[0]:.3f} s): all later times are shifted, "
            "to continue one usual step later"
        )
    if late.any():
        notes.append(f"{late.sum()} entries are out of order: left out")
    at, t = at[~late], t[~late]
    same = np.append(np.diff(t) == 0, False)
    if same.any() and not together:
        if same.mean() > 0.2:
            t = _spread_over_ticks(t)
            notes.append(
                f"the resolution of the clock is too coarse ({100 * same.mean():.0f} % of the entries have "
                "the time of the next one): entries are spread evenly up to the next time"
            )
        else:
            notes.append(
                f"{same.sum()} entries have the same time as the next entry "
                f"(first at {t[same.argmax()]:.3f} s): left out"
            )
            at, t = at[~same], t[~same]
    jump = np.diff(t)
    far = jump > MAX_TIME_GAP
    if far.any():
        i = int(far.argmax())
        notes.append(
            f"the clock jumps ahead by {jump[i]:.4g} s at {t[i]:.3f} s: "
            f"replaced by a gap of {BRIDGED_GAP:g} s"
        )
        t = t - np.append(0.0, np.cumsum(np.where(far, jump - BRIDGED_GAP, 0.0)))
    kept = np.zeros(len(time), bool)
    kept[at] = True
    return t, kept, notes


def _unwind_clock(t: np.ndarray, usual: float) -> tuple[np.ndarray, np.ndarray, list[tuple[float, float]]]:
    """Shift all times after each fall of the clock (place where it was set back).

    Parameters
    ----------
    t : ndarray, (entries,)
        [s] Finite times.
    usual : float
        [s] Median of the positive steps. After the shift, the first time after a fall is
        the highest time before it plus `usual`.

    Returns
    -------
    ndarray, (entries,)
        Times that never fall, except at late entries.
    ndarray of bool, (entries,)
        True for late entries.
    list of (float, float)
        [s] For each fall of the clock: the highest time before it, and the size of the
        fall.
    """
    late, added = np.zeros(len(t), bool), np.zeros(len(t))
    sets: list[tuple[float, float]] = []
    falls = np.append(np.flatnonzero(np.diff(t) < 0) + 1, len(t))
    highest, shift = float(t[0]), 0.0  # [s] highest shifted time before entry i; shift to add from i on
    i = 0
    while i < len(t):
        if t[i] + shift >= highest:
            i = int(falls[np.searchsorted(falls, i, side="right")])
            highest = float(t[i - 1]) + shift
            continue
        back = highest - float(t[i]) - shift
        again = np.flatnonzero(t[i + 1 : i + 1 + MAX_LATE_ROWS] + shift > highest)
        if back <= MAX_LATE_TIME and len(again) and again[0] < MAX_LATE_ROWS // 2:
            late[i] = True
        else:
            sets.append((highest, back))
            added[i] = back + usual
            shift += added[i]
            highest = float(t[i]) + shift
        i += 1
    return t + np.cumsum(added), late, sets


def _spread_over_ticks(t: np.ndarray) -> np.ndarray:
    """Spread entries that have the same time evenly up to the next time, but over at most
    twice the median step between different times."""
    ticks, first, count = np.unique(t, return_index=True, return_counts=True)
    following = np.append(ticks[1:], ticks[-1] + (np.median(np.diff(ticks)) if len(ticks) > 1 else 0.01))
    length = np.minimum(following - ticks, 2 * np.median(following - ticks))
    place = np.arange(len(t)) - np.repeat(first, count)
    return np.repeat(ticks, count) + place * np.repeat(length / count, count)
