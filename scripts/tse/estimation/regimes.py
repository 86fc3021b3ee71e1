"""Find the events of a drive in the columns of EST.csv: changes of tyres or road, faults
of a channel, sliding wheels. Find the stretches of road between the changes.

A regime is a state of road, car or sensors, such as "sliding". REGIMES lists them. The
filter computes the probability of each regime in each row. If a table lacks the
columns of EVENT_COLUMNS, there are no events, and the whole drive is one stretch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from tse.library.core import STIFFNESS, library

# Column with the probability of a regime -> name of the regime. The sum of the
# probabilities in a row is 1.
REGIMES = {
    "p_steady": "as before",
    "p_changed": "road changed",
    "p_axle": "an axle changed",
    "p_fault": "fault of a channel",
    "p_sliding": "sliding",
    "p_restarted": "started over",
}
# Meaning of the values of the column change_kind. 0 means that nothing has changed yet, 4
# that the filter was reset to the prior or to the learnt state.
KINDS = {1: "road changed", 2: "front axle changed", 3: "rear axle changed", 4: "started over"}
# change_kind -> stiffnesses that a change of this kind affects. For each of them, the
# ratio (value after / value before) is reported.
TOUCHED = {1: STIFFNESS, 2: ("cy_front",), 3: ("cy_rear",), 4: ()}
# Regimes that are reported as intervals of time. Key: column with the probability of the
# regime. Value: name of the interval
SPELLS = {"p_fault": "fault", "p_sliding": "sliding"}
# Columns in which events are found -> smallest type that holds the values
EVENT_COLUMNS: dict[str, type] = {
    **dict.fromkeys(SPELLS, np.float32),
    "estimate_age": np.float32,
    "fault_channel": np.int8,
    "change_age": np.float32,
    "change_probability": np.float32,
    "change_kind": np.int8,
    **{f"change_{s}": np.float32 for s in STIFFNESS},
}
# Columns from which the sd of the ratio (stiffness after / before a change) is computed
SDS = {f"{s}{part}" for s in STIFFNESS for part in ("", "_sd")}
MIN_EVENT_PROBABILITY = 0.9  # min probability of a reported event
# [s] Each row reports the time of the last change. Two rows report the same change if the
# reported times differ by at most MAX_JOINED_GAP. Two intervals of sliding, or with the
# same channel at fault, are joined if the time between them is at most MAX_JOINED_GAP.
MAX_JOINED_GAP = 0.5
# A change is reported if a stiffness changes by more than this share of its value
MIN_CHANGE = 0.05
# [s] min length of a stretch, i.e. of the part of a drive between two changes of tyres or
# road. A shorter stretch is joined to its neighbour.
MIN_STRETCH = 2.0
# [1/s] Before the filter detects a change, the estimated stiffness already drifts towards
# its new value. The change begins where this drift begins (_find_begin()). A drift that
# covers less than this share of the way to the new value per second does not count.
CREEP = 0.01
SHORT_NAMES = {"cx_front": "front longitudinal", "cy_front": "front cornering", "cy_rear": "rear cornering"}


@dataclass(frozen=True)
class Change:
    """A change of the stiffness, of road or tyres, that the filter has detected.

    `time`: [s] begin of the change. The filter detects it later. `believed`: [s] time
    from which the estimates describe the new stiffness; None: from `time`. `ratio`: for
    each affected stiffness, value after / value before, and the sd of this ratio (NaN:
    unknown).

    `probability`: probability that no further change, sliding or sensor fault has begun
    since. It is low for a false change, because the filter undoes it by a further change.
    The filter does not estimate the probability that the change is real."""

    time: float
    kind: int
    probability: float
    ratio: Mapping[str, tuple[float, float]]
    believed: float | None = None

    @property
    def what(self) -> str:
        return KINDS.get(self.kind, "changed")

    @property
    def label(self) -> str:
        return f"{self.what} at {self.time:.2f} s"

    @property
    def effect(self) -> str:
        """The ratio (stiffness after / before the change) of each affected stiffness, as
        a string; empty if no stiffness is affected."""
        parts = []
        for key, (ratio, sd) in self.ratio.items():
            band = f" ± {sd:.2f}" if np.isfinite(sd) else ""
            parts.append(f"{SHORT_NAMES[key]} x {ratio:.2f}{band}")
        return ", ".join(parts)


@dataclass(frozen=True)
class Spell:
    """An interval of time in which a channel was at fault or the wheels slid."""

    what: str  # fault or sliding
    start: float  # [s]
    end: float  # [s]
    probability: float  # max probability in the rows of the interval
    channel: str = ""  # name of the channel at fault; empty if unknown, or if the wheels slid

    @property
    def name(self) -> str:
        return f"{self.channel} at fault" if self.channel else self.what

    @property
    def label(self) -> str:
        return f"{self.name} {self.start:.2f} .. {self.end:.2f} s, {format_percent(self.probability)}"


@dataclass(frozen=True)
class Stretch:
    """The part of a drive from one change of the stiffness to the next, from `start` [s]
    to `end` [s].

    `rows`: rows whose estimates describe this stretch. They begin at row 0 in the first
    stretch, otherwise at the time `believed` of the change at `start`. They end at `end`.
    If short stretches are joined to one, it has the `rows` of the longest of them."""

    start: float
    end: float
    rows: slice

    @property
    def title(self) -> str:
        # The start can be slightly negative, because the estimates in the first row can
        # refer to a time before the log. A small negative start is rounded to -0.0, and
        # adding 0.0 turns -0.0 into 0.0.
        start = round(self.start, 1) + 0.0
        return f"{start:.1f} .. {self.end:.1f} s"


def estimate_times(table: pd.DataFrame) -> np.ndarray:
    """Return the time [s] to which the estimates in each row refer.

    If channels are logged with a delay, this time is earlier than the time of the row."""
    time = table["time"].to_numpy()
    age = table["estimate_age"].to_numpy() if "estimate_age" in table else np.zeros(1)
    return time - np.nan_to_num(age) if np.any(age > 0) else time


def find_changes(table: pd.DataFrame) -> list[Change]:
    """Return the changes of a drive, in order of time.

    Each row reports the last detected change. Its time is the time of the row minus the
    column change_age. Rows report the same change if the times that they report differ by
    at most MAX_JOINED_GAP. The last of these rows gives kind and ratios.

    Change.probability is the larger of two values of the column change_probability: its
    median over these rows, and its value in the last of them. A change is left out if its
    probability is below MIN_EVENT_PROBABILITY, or if all its ratios differ from 1 by at
    most MIN_CHANGE. A change without ratios ("started over") is judged by its probability
    alone.

    The filter detects a change late. Change.time is when it began (_find_begin())."""
    if not {"change_age", "change_kind"} <= set(table) or table.empty:
        return []
    time, kind = estimate_times(table), table["change_kind"].to_numpy()
    rows = np.flatnonzero(kind > 0)
    at = time[rows] - table["change_age"].to_numpy()[rows]
    edges = np.flatnonzero(np.abs(np.diff(at)) > MAX_JOINED_GAP) + 1
    reports: list[tuple[float, np.ndarray]] = []  # time of each change, and the rows that report it
    for mine, when in zip(np.split(rows, edges), np.split(at, edges), strict=True):
        if not len(mine):
            continue
        middle = float(np.median(when))
        if reports and abs(reports[-1][0] - middle) <= MAX_JOINED_GAP:
            mine = np.concatenate([reports.pop()[1], mine])
        reports.append((middle, mine))
    columns = {name: table[name].to_numpy() for name in table if name in EVENT_COLUMNS or name in SDS}
    found: list[Change] = []
    for when, mine in reports:
        c = _make_change(columns, time, when, mine, float(found[-1].believed or 0.0) if found else -np.inf)
        if not c.probability < MIN_EVENT_PROBABILITY and (
            not c.ratio or any(abs(ratio - 1) > MIN_CHANGE for ratio, _ in c.ratio.values())
        ):
            found.append(c)
    return found


def _make_change(
    columns: Mapping[str, np.ndarray], times: np.ndarray, time: float, rows: np.ndarray, earliest: float
) -> Change:
    """Return the change that `rows` report.

    `time` is the time of the change according to these rows, and `earliest` the earliest
    time at which it can have begun. `times` is the result of estimate_times()."""
    first, last = int(rows[0]), int(rows[-1])
    kind = int(columns["change_kind"][last])
    probability = columns.get("change_probability", np.full(len(times), np.nan))
    before = max(0, min(first, int(np.searchsorted(times, time))) - 1)
    began = _find_begin(columns, times, kind, int(np.searchsorted(times, earliest)), before, last)
    ratio = {}
    for key in TOUCHED.get(kind, ()):
        value = float(columns[f"change_{key}"][last]) if f"change_{key}" in columns else float("nan")
        if np.isfinite(value):
            value = float(columns[key][last] / columns[key][began]) if began < before else value
            sd = float(
                np.hypot(_compute_relative_sd(columns, key, began), _compute_relative_sd(columns, key, last))
            )
            ratio[key] = (value, value * sd)
    likely = max(float(np.median(probability[rows])), float(probability[last]))
    return Change(float(times[began]) if began < before else time, kind, likely, ratio, time)


def _find_begin(
    columns: Mapping[str, np.ndarray], time: np.ndarray, kind: int, first: int, before: int, last: int
) -> int:
    """Return the row after which a change began, `first` .. `before`. The filter detected
    the change only after row `before`.

    Before the detection, the filter attributes the new samples to the old stiffness. So
    the estimate drifts towards its new value, the estimate in row `last`. The drift of
    row i is the share (0 .. 1) of the way from row i to the new value that the estimate
    has covered in row `before`. It is averaged over the affected stiffnesses. The result
    is the row i with the largest value of
        drift - CREEP * (time of `before` - time of i).
    So an earlier row is chosen only if it adds a drift of more than CREEP per second.

    The estimate also moves while the filter still learns the old stiffness. From row i to
    row `before`, this movement has the variance P_i - P_before (P: variance of the
    estimate). So only the movement beyond 1.96 sqrt(P_i - P_before) counts as drift.

    `columns`: columns of EST.csv. `time`: [s] time of each row. `kind`: change_kind."""
    keys = [key for key in TOUCHED.get(kind, ()) if {key, f"{key}_sd"} <= set(columns)]
    # Leave out rows more than 1 / CREEP seconds before row `before`. They cannot be the
    # result: since the drift is at most 1, drift - CREEP * (time of `before` - time of i)
    # is negative there, but 0 in row `before`.
    first = max(first, int(np.searchsorted(time, time[before] - 1 / CREEP)))
    drift = np.zeros(max(0, before + 1 - first))
    if not keys or not len(drift):
        return before
    for key in keys:
        mean, sd = (columns[name][first : before + 1].astype(float) for name in (key, f"{key}_sd"))
        log, var, to = np.log(mean), (sd / mean) ** 2, np.log(float(columns[key][last]))
        learnt = 1.96 * np.sqrt(np.maximum(var - var[-1], 0))
        share = np.maximum(np.sign(to - log[-1]) * (log[-1] - log) - learnt, 0) / np.maximum(
            np.abs(to - log), MIN_CHANGE
        )
        drift += np.nan_to_num(share) / len(keys)  # the share is NaN in refused rows
    return first + int(np.argmax(drift - CREEP * (time[before] - time[first : before + 1])))


def _compute_relative_sd(columns: Mapping[str, np.ndarray], key: str, row: int) -> float:
    mean = float(columns[key][row]) if key in columns else 0.0
    return float(columns[f"{key}_sd"][row]) / mean if f"{key}_sd" in columns and mean > 0 else float("nan")


def find_spells(table: pd.DataFrame) -> list[Spell]:
    """Return the intervals in which a channel was at fault or the wheels slid, in order
    of their start."""
    if table.empty:
        return []
    time = estimate_times(table)
    found: list[Spell] = []
    for column, what in SPELLS.items():
        if column not in table:
            continue
        p = table[column].to_numpy()
        likely = p >= MIN_EVENT_PROBABILITY
        if column == "p_fault" and "fault_channel" in table:
            channel = _fill_names(table["fault_channel"].to_numpy(), find_spans(time, likely))
            for number in np.unique(channel[likely]).tolist():
                found += _make_spells(time, p, likely & (channel == number), what, find_channel_name(number))
        else:
            found += _make_spells(time, p, likely, what, "")
    return sorted(found, key=lambda s: s.start)


def _fill_names(channel: np.ndarray, runs: Sequence[tuple[int, int]]) -> np.ndarray:
    """Return the number of the channel at fault in each row. Numbers that are missing at
    the start of a fault are filled in.

    In the first rows of a fault, the channel may still be unknown (0). Such a row gets
    the number of the next row of the same fault in which the channel is known. `runs` has
    a pair for each fault: its first row, and the row after its last row."""
    found = channel.copy()
    for first, after in runs:
        for i in range(after - 2, first - 1, -1):
            if found[i] == 0:
                found[i] = found[i + 1]
    return found


def find_spans(time: np.ndarray, where: np.ndarray) -> list[tuple[int, int]]:
    """Return a pair for each run of rows in which `where` is True: the first row of the
    run, and the row after its last row. Runs at most MAX_JOINED_GAP apart are joined."""
    found: list[tuple[int, int]] = []
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(np.int8), [0]])))
    for first, after in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        bridged = found and time[first] - time[found[-1][1] - 1] <= MAX_JOINED_GAP
        found.append((found.pop()[0] if bridged else first, after))
    return found


def _make_spells(time: np.ndarray, p: np.ndarray, where: np.ndarray, what: str, channel: str) -> list[Spell]:
    return [
        Spell(what, float(time[a]), float(time[b - 1]), float(p[a:b][where[a:b]].max()), channel)
        for a, b in find_spans(time, where)
    ]


def find_channel_name(number: int) -> str:
    """Return the name of the channel that has this number in the column fault_channel.
    Return an empty string for 0: there is no fault, or its channel is not yet known."""
    channels = [*library().channels, *library().optional]
    return channels[number - 1].name if 0 < number <= len(channels) else ""


def find_stretches(table: pd.DataFrame, found: Sequence[Change]) -> list[Stretch]:
    """Return the stretches of road between the changes `found`.

    If the rows of a stretch (Stretch.rows) last less than MIN_STRETCH, the stretch is
    joined to the next stretch. The last stretch is joined to the previous one instead."""
    if table.empty:
        return []
    time = estimate_times(table)
    inside = [c for c in found if time[0] < c.time <= time[-1]]
    ends = [float(time[0]), *(c.time for c in inside), float(time[-1])]
    firsts = [
        0,
        *np.searchsorted(time, [c.time if c.believed is None else c.believed for c in inside]).tolist(),
    ]
    afters = [*np.searchsorted(time, [c.time for c in inside], side="left").tolist(), len(time)]
    rows = [slice(i, max(i, j)) for i, j in zip(firsts, afters, strict=True)]
    pieces = [Stretch(a, b, of) for (a, b), of in zip(pairwise(ends), rows, strict=True)]
    i = 0
    while len(pieces) > 1 and i < len(pieces):
        longest = pieces[i].rows
        if time[min(longest.stop, len(time) - 1)] - time[longest.start] >= MIN_STRETCH:
            i += 1
            continue
        i = min(i, len(pieces) - 2)
        pieces[i : i + 2] = [_join_stretches(pieces[i], pieces[i + 1])]
    return pieces


def _join_stretches(one: Stretch, other: Stretch) -> Stretch:
    longest = max(one, other, key=lambda s: s.rows.stop - s.rows.start)
    return Stretch(one.start, other.end, longest.rows)


def describe_events(found: Sequence[Change], times: Sequence[Spell]) -> list[str]:
    """Return a line for each change, and a line for each kind of interval. If there is
    only one interval of a kind, its line states begin and end. If there are several
    intervals of a kind, their line states number and total length."""
    lines = [f"{c.label}{': ' if c.effect else ''}{c.effect}" for c in found]
    for name in dict.fromkeys(s.name for s in times):
        same = [s for s in times if s.name == name]
        if len(same) == 1:
            lines.append(same[0].label)
        else:
            total = sum(s.end - s.start for s in same)
            lines.append(f"{name} {len(same)} times, {total:.1f} s in all, first at {same[0].start:.2f} s")
    return lines


def format_percent(share: float) -> str:
    """Return a share as a string in percent; near 0 "under 1 %", near 1 "over 99 %"."""
    if 0 < share < 0.01:
        return "under 1 %"
    return "over 99 %" if 0.995 <= share < 1 else f"{share * 100:.0f} %"
