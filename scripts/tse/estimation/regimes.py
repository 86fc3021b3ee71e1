"""Events of a drive from columns of EST.csv: changes of tyres or road, faults of a
channel, sliding wheels; and the stretches of road between the changes. A table without
these columns has no events and is one stretch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from tse.library.core import STIFFNESS, library

REGIMES = {  # probability of each at a row; their sum is 1
    "p_steady": "as before",
    "p_changed": "road changed",
    "p_axle": "an axle changed",
    "p_fault": "fault of a channel",
    "p_sliding": "sliding",
    "p_restarted": "started over",
}
KINDS = {
    1: "road changed",
    2: "front axle changed",
    3: "rear axle changed",
    4: "started over",
}  # change_kind; 0: none yet
# Stiffnesses that a change of this kind touches: their ratios are reported.
TOUCHED = {1: STIFFNESS, 2: ("cy_front",), 3: ("cy_rear",), 4: ()}
SPELLS = {"p_fault": "fault", "p_sliding": "sliding"}
COLUMNS: dict[str, type] = {  # of a table, in the smallest type that holds them
    **dict.fromkeys(SPELLS, np.float32),
    "estimate_age": np.float32,
    "fault_channel": np.int8,
    "change_age": np.float32,
    "change_probability": np.float32,
    "change_kind": np.int8,
    **{f"change_{s}": np.float32 for s in STIFFNESS},
}
# Columns from which the sd of a ratio follows.
SDS = {f"{s}{part}" for s in STIFFNESS for part in ("", "_sd")}
LIKELY = 0.9  # min probability of a reported event
MAX_GAP = 0.5  # s: changes nearer than this are one; shorter gaps in a spell are bridged
MIN_CHANGE = 0.05  # relative: a smaller change of every stiffness needs no reaction
MIN_STRETCH = 2.0  # s: a shorter stretch joins its neighbour
CREEP = 0.01  # 1/s: share of a change by which estimates may drift without a change
SHORT_NAMES = {"cx_front": "front longitudinal", "cy_front": "front cornering", "cy_rear": "rear cornering"}


@dataclass(frozen=True)
class Change:
    """A change of tyres or road.

    `time`: its begin. `believed`: time from which on the estimates describe the road
    after it; None: from its begin. `ratio`: stiffness after over before, with its sd (NaN
    if unknown), of each stiffness that the change touches."""

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
        known = f", {format_percent(self.probability)}" if np.isfinite(self.probability) else ""
        return f"{self.what} at {self.time:.2f} s{known}"

    @property
    def effect(self) -> str:
        """The ratios in words; empty if they are not known."""
        parts = []
        for key, (ratio, sd) in self.ratio.items():
            band = f" ± {sd:.2f}" if np.isfinite(sd) else ""
            parts.append(f"{SHORT_NAMES[key]} x {ratio:.2f}{band}")
        return ", ".join(parts)


@dataclass(frozen=True)
class Spell:
    """An interval of fault or sliding. `channel`: the channel at fault, if known."""

    what: str
    start: float
    end: float
    probability: float  # max
    channel: str = ""

    @property
    def name(self) -> str:
        return f"{self.channel} at fault" if self.channel else self.what

    @property
    def label(self) -> str:
        return f"{self.name} {self.start:.2f} .. {self.end:.2f} s, {format_percent(self.probability)}"


@dataclass(frozen=True)
class Stretch:
    """The road from one change to the next.

    `rows`: rows whose estimates describe it; they begin when the change is believed. If
    shorter stretches have joined it, those of its longest piece."""

    start: float
    end: float
    rows: slice

    @property
    def title(self) -> str:
        start = round(self.start, 1) + 0.0  # no -0.0, of a row whose estimates refer to a time before the log
        return f"{start:.1f} .. {self.end:.1f} s"


def estimate_times(table: pd.DataFrame) -> np.ndarray:
    """Return the times that the estimates refer to: earlier than their rows if channels
    are logged late."""
    time = table["time"].to_numpy()
    age = table["estimate_age"].to_numpy() if "estimate_age" in table else np.zeros(1)
    return time - np.nan_to_num(age) if np.any(age > 0) else time


def find_changes(table: pd.DataFrame) -> list[Change]:
    """Return the changes of a drive, in order of time.

    Every row reports the age of the last change that the filter believes in. Reports
    within MAX_GAP are one change; the last one counts. Changes are left out that are less
    probable than LIKELY in half of their rows and in the last, or that change no
    stiffness by MIN_CHANGE.

    The filter believes a change after it began, and the estimates may have followed it
    before: see _find_begin()."""
    if not {"change_age", "change_kind"} <= set(table) or table.empty:
        return []
    time, kind = estimate_times(table), table["change_kind"].to_numpy()
    rows = np.flatnonzero(kind > 0)
    at = time[rows] - table["change_age"].to_numpy()[rows]
    edges = np.flatnonzero(np.abs(np.diff(at)) > MAX_GAP) + 1
    reports: list[tuple[float, np.ndarray]] = []  # time of the change, rows that report it
    for mine, when in zip(np.split(rows, edges), np.split(at, edges), strict=True):
        if not len(mine):
            continue
        middle = float(np.median(when))
        if reports and abs(reports[-1][0] - middle) <= MAX_GAP:
            mine = np.concatenate([reports.pop()[1], mine])
        reports.append((middle, mine))
    columns = {name: table[name].to_numpy() for name in table if name in COLUMNS or name in SDS}
    found: list[Change] = []
    for when, mine in reports:
        c = _make_change(columns, time, when, mine, float(found[-1].believed or 0.0) if found else -np.inf)
        if not c.probability < LIKELY and (
            not c.ratio or any(abs(ratio - 1) > MIN_CHANGE for ratio, _ in c.ratio.values())
        ):
            found.append(c)
    return found


def _make_change(
    columns: Mapping[str, np.ndarray], times: np.ndarray, time: float, rows: np.ndarray, earliest: float
) -> Change:
    """Return a change. `time`: it is believed; `earliest`: its first possible begin."""
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
    """Find the row, of `first` to `before`, after which a change began that is believed
    after `before`.

    Before the change is believed, the filter attributes the new samples to the old road,
    and its means drift towards those of the new road, which row `last` has. The change
    began where the drift since then exceeds CREEP by most: the share of the whole step,
    mean of the stiffnesses that the change touches. A mean that moves while its variance
    falls has learnt: 1.96 sd of that do not count."""
    keys = [key for key in TOUCHED.get(kind, ()) if {key, f"{key}_sd"} <= set(columns)]
    first = max(first, int(np.searchsorted(time, time[before] - 1 / CREEP)))  # a share is at most 1
    gone = np.zeros(max(0, before + 1 - first))
    if not keys or not len(gone):
        return before
    for key in keys:
        mean, sd = (columns[name][first : before + 1].astype(float) for name in (key, f"{key}_sd"))
        log, var, to = np.log(mean), (sd / mean) ** 2, np.log(float(columns[key][last]))
        learnt = 1.96 * np.sqrt(np.maximum(var - var[-1], 0))
        way = np.maximum(np.sign(to - log[-1]) * (log[-1] - log) - learnt, 0) / np.maximum(
            np.abs(to - log), MIN_CHANGE
        )
        gone += np.nan_to_num(way) / len(keys)  # NaN in refused rows
    return first + int(np.argmax(gone - CREEP * (time[before] - time[first : before + 1])))


def _compute_relative_sd(columns: Mapping[str, np.ndarray], key: str, row: int) -> float:
    mean = float(columns[key][row]) if key in columns else 0.0
    return float(columns[f"{key}_sd"][row]) / mean if f"{key}_sd" in columns and mean > 0 else float("nan")


def find_spells(table: pd.DataFrame) -> list[Spell]:
    """Return the intervals in which a channel was at fault or wheels slid, by their
    start."""
    if table.empty:
        return []
    time = estimate_times(table)
    found: list[Spell] = []
    for column, what in SPELLS.items():
        if column not in table:
            continue
        p = table[column].to_numpy()
        likely = p >= LIKELY
        if column == "p_fault" and "fault_channel" in table:
            channel = _fill_names(table["fault_channel"].to_numpy(), find_spans(time, likely))
            for number in np.unique(channel[likely]).tolist():
                found += _make_spells(time, p, likely & (channel == number), what, find_channel_name(number))
        else:
            found += _make_spells(time, p, likely, what, "")
    return sorted(found, key=lambda s: s.start)


def _fill_names(channel: np.ndarray, runs: Sequence[tuple[int, int]]) -> np.ndarray:
    """Return the channel at fault by row: rows of a run before the channel is named get
    the name that follows."""
    found = channel.copy()
    for first, after in runs:
        for i in range(after - 2, first - 1, -1):
            if found[i] == 0:
                found[i] = found[i + 1]
    return found


def find_spans(time: np.ndarray, where: np.ndarray) -> list[tuple[int, int]]:
    """Return first row and row after the last of each run of rows; shorter gaps than
    MAX_GAP are bridged."""
    found: list[tuple[int, int]] = []
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(np.int8), [0]])))
    for first, after in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        bridged = found and time[first] - time[found[-1][1] - 1] <= MAX_GAP
        found.append((found.pop()[0] if bridged else first, after))
    return found


def _make_spells(time: np.ndarray, p: np.ndarray, where: np.ndarray, what: str, channel: str) -> list[Spell]:
    return [
        Spell(what, float(time[a]), float(time[b - 1]), float(p[a:b][where[a:b]].max()), channel)
        for a, b in find_spans(time, where)
    ]


def find_channel_name(number: int) -> str:
    """Return the name of the channel with this fault_channel; empty for 0."""
    channels = [*library().channels, *library().optional]
    return channels[number - 1].name if 0 < number <= len(channels) else ""


def find_stretches(table: pd.DataFrame, found: Sequence[Change]) -> list[Stretch]:
    """Return the stretches between changes. A stretch shorter than MIN_STRETCH joins the
    next one, the last one the one before it."""
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
        pieces[i : i + 2] = [_join(pieces[i], pieces[i + 1])]
    return pieces


def _join(one: Stretch, other: Stretch) -> Stretch:
    longest = max(one, other, key=lambda s: s.rows.stop - s.rows.start)
    return Stretch(one.start, other.end, longest.rows)


def describe_events(found: Sequence[Change], times: Sequence[Spell]) -> list[str]:
    """Return a line for each change, and for each kind of spell their number."""
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
    """Return a share in percent; "under 1 %" and "over 99 %" near the ends."""
    if 0 < share < 0.01:
        return "under 1 %"
    return "over 99 %" if 0.995 <= share < 1 else f"{share * 100:.0f} %"
