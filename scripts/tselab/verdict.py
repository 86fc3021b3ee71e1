"""One plain sentence per stiffness: what the log says about it. Used by the terminal and the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from tselab.core import NOMINAL, STIFFNESS, Config, library
from tselab.log import MEASURES
from tselab.regimes import Change, Stretch, percent, spoken_of, stretches

NAMES = {
    "cx_front": "Front longitudinal stiffness",
    "cy_front": "Front cornering stiffness",
    "cy_rear": "Rear cornering stiffness",
}
UNITS = {"cx_front": "kN", "cy_front": "kN/rad", "cy_rear": "kN/rad"}
QUIET = {
    "cx_front": "driving and braking were too weak or too steady",
    "cy_front": "the steering was too quiet",
    "cy_rear": "the steering was too quiet",
}
CONTRADICTED = "contradicted"  # a reason that no row has
WHY = {
    "starting": "too little was seen since the start",
    "uncertain": "there was excitement, but not enough to bring the uncertainty below the limit",
    "diverging": "a sensor was probably at fault",
    "held": "the car stood still, crawled, reversed or steered far",
    "input invalid": "inputs or measurements were missing",
    "told loosely": "what is told of the car ([uncertainty] in the vehicle file) is not certain enough: calibrate, or tell it",
    "does not fit": "the sensors say what the model does not explain: calibrate, or look for what is missing (tselab gap)",
    "row refused": "the rows were refused",
    CONTRADICTED: "the channels contradict each other (see the warning); with that put right the log may tell it",
}
UNSEEN = "spread below what this drive can show"
LOUD = 1.25  # noise found over the setting's: from here on it is remarked
RECENT = 1.0  # s: what was valid so long before the end counts as valid at the end
OF_TOLD = 0.5  # share of the variance from which a band is said to come of what is told of the car
LEAST_TOLD = 0.02  # ... and its sd, relative
FEW = 0.005  # below this share of valid rows a value is not given


@dataclass(frozen=True)
class Verdict:
    """The finding on one stiffness. Values in the unit of `unit`; NaN where there is none."""

    key: str
    name: str
    level: str  # good, partly, none
    unit: str
    value: float
    band: float  # 95 %
    low: float  # of the valid means, 5 % and 95 % quantile
    high: float
    spread: float  # sample to sample, share of the mean
    spread_seen: bool  # else it is below what sensors and excitation can show
    nominal: float
    valid: float  # share of the rows
    reason: str  # the commonest reason for not being valid
    reason_share: float
    text: str

    @property
    def detail(self) -> str:
        """The text without the value it starts with."""
        return self.text.split(" (95 %), ", 1)[-1]


def verdicts(table: pd.DataFrame, config: Config) -> list[Verdict]:
    """The finding on each stiffness."""
    return [_verdict(table, config, key) for key in STIFFNESS]


@dataclass(frozen=True)
class Finding:
    """What is known of the tyres on a stretch of road; without a stretch on the whole log."""

    stretch: Stretch | None
    verdicts: list[Verdict]

    @property
    def title(self) -> str:
        return f"From {self.stretch.title}" if self.stretch else ""

    @property
    def nothing(self) -> str:
        """Why no stiffness is known, in words; empty if one is."""
        if any(v.level != "none" for v in self.verdicts):
            return ""
        reasons = dict.fromkeys(v.reason for v in self.verdicts if v.reason)
        return "no stiffness is valid" + (f", mostly {' or '.join(reasons)}" if reasons else "")

    def lines(self) -> list[str]:
        """For the terminal."""
        found = [f"{v.name}: {v.text}" for v in self.verdicts]
        if not self.stretch:
            return found
        return (
            [f"{self.title}: {self.nothing}"] if self.nothing else [f"{self.title}:", *(f"  {line}" for line in found)]
        )


def findings(
    table: pd.DataFrame, config: Config, found: Sequence[Change], contradictions: Sequence[str] = ()
) -> list[Finding]:
    """The finding on each stretch of road between changes; one on the whole log where nothing changed.

    A mean over two roads is true of neither. On a stretch the filter does not forget: what it knows last is what it knows
    best, and is given with the uncertainty that it has then.

    `contradictions`: what the channels say against each other (units.check_units). The filter takes a channel that is wrong all
    the time for a car that is otherwise, surely; so of such a log no stiffness is known."""
    if contradictions:
        return [Finding(None, [_contradicted(v) for v in verdicts(table, config)])]
    parts = stretches(table, found)
    if len(parts) < 2:
        return [Finding(None, verdicts(table, config))]
    return [Finding(s, [_verdict(table.iloc[s.rows], config, key, whole=False) for key in STIFFNESS]) for s in parts]


def _contradicted(v: Verdict) -> Verdict:
    nan = float("nan")
    text = f"{CONTRADICTED}: {WHY[CONTRADICTED]}"
    return replace(v, level="none", value=nan, band=nan, low=nan, high=nan, spread=nan, spread_seen=False, reason=CONTRADICTED,
                   reason_share=1.0, text=text)  # fmt: skip


def remarks(table: pd.DataFrame) -> list[str]:
    """What the filter found out about the sensors and about what it had learnt, in words."""
    found = []
    learnt = table[table["status"].between(0, library().status("TSE_W_MISSING_CHANNEL"))]
    for channel in MEASURES:
        ratio = float(learnt[f"noise_{channel}"].median()) if len(learnt) else 1.0
        if ratio > LOUD:
            found.append(f"{channel} is noisier than the settings say: x{ratio:.1f}")
    off = np.any([table[f"{key}_reason"] == "diverging" for key in STIFFNESS], axis=0)
    times = int((np.diff(off.astype(int), prepend=0) == 1).sum())
    if times:
        often = "once" if times == 1 else f"{times} times"
        found.append(
            f"measurements contradicted what was learnt {often}, in {percent(float(off.mean()))} of the log: not valid there"
        )
    return found


def of_what_is_told(table: pd.DataFrame, config: Config, told: Mapping[str, np.ndarray]) -> list[str]:
    """Where most of a band at the end comes of what is told of the car: of which quantities, the largest first."""
    found = []
    for a, key in enumerate(STIFFNESS):
        last = table[[key, f"{key}_sd"]].iloc[-1] / getattr(config, NOMINAL[key]) if len(table) else None
        parts = {name: float(sd[a]) for name, sd in told.items()}
        whole = np.sqrt(sum(sd**2 for sd in parts.values()))
        if (
            last is None
            or not whole**2 > OF_TOLD * float(last.iloc[1]) ** 2
            or not whole > LEAST_TOLD * float(last.iloc[0])
        ):
            continue
        most = sorted(parts, key=parts.__getitem__, reverse=True)[:3]
        mean, sd = (float(x) for x in last)
        band, names = (
            percent(1.96 * sd / mean),
            ", ".join(f"{name} {percent(1.96 * parts[name] / mean)}" for name in most),
        )
        found.append(
            f"{NAMES[key].lower()}: of the band at the end, ± {band}, most comes of what is told of the car: {names} "
            "(tselab calibrate finds most of it; known better, say so in [uncertainty])"
        )
    return found


def _verdict(table: pd.DataFrame, config: Config, key: str, whole: bool = True) -> Verdict:
    """Over a whole log the medians of the valid rows, over a stretch its last valid row."""
    of = "the log" if whole else "the stretch"
    valid = table[f"{key}_valid"].to_numpy() == 1
    share = float(valid.mean()) if len(valid) else 0.0
    nominal, unit, name = getattr(config, NOMINAL[key]) / 1000, UNITS[key], NAMES[key]
    others = table.loc[~valid, f"{key}_reason"].value_counts()  # of categories also those that are not there
    others = others[others > 0]
    reason = str(others.index[0]) if len(others) else ""
    reason_share = float(others.iloc[0] / len(valid)) if len(others) else 0.0
    nan = float("nan")
    if share < FEW:
        start = getattr(config, f"initial_{key}") * nominal if whole else float(table[key].iloc[0]) / 1000
        last = float(table[key].iloc[-1]) / 1000 if len(table) else nan
        why = QUIET[key] if reason == "not excited" else WHY.get(reason, reason)
        text = (
            f"{reason or 'no rows'}: {why} in {percent(reason_share)} of {of}; the value shown ({last:.0f} {unit}, "
            f"started at {start:.0f}) says {'little' if share else 'nothing'} about the tyres"
        )
        return Verdict(
            key, name, "none", unit, nan, nan, nan, nan, nan, False, nominal, share, reason, reason_share, text
        )

    mean, sd, spread = (table.loc[valid, c].to_numpy() / 1000 for c in (key, f"{key}_sd", f"{key}_spread"))
    value, band = (
        (float(np.median(mean)), float(1.96 * np.median(sd))) if whole else (float(mean[-1]), float(1.96 * sd[-1]))
    )
    low, high = (float(q) for q in np.quantile(mean, [0.05, 0.95]))
    relative = value / nominal - 1
    parts = [
        f"{value:.0f} {unit} ± {max(band, 0.5):.0f} (95 %), valid {percent(share)} of the time",
        f"{100 * abs(relative):.0f} % {'above' if relative > 0 else 'below'} nominal"
        if abs(relative) >= 0.02
        else "as nominal",
    ]
    if high - low > 3 * band if whole else abs(mean[-1] - mean[0]) > 3 * 1.96 * sd[0]:
        parts.append(
            f"it changed during {of}, from {mean[0]:.0f} to {mean[-1]:.0f} (90 % within {low:.0f} .. {high:.0f})"
        )
    if not whole and (end := _last_valid(spoken_of(table), valid)) is not None:
        parts.append(f"last valid at {end:.1f} s")
    if reason and share < 0.8:
        why = QUIET[key] if reason == "not excited" else WHY.get(reason, reason)
        parts.append(f"otherwise mostly {reason}: {why}")
    seen = bool(table.loc[valid, f"{key}_spread_seen"].mean() >= 0.5)
    scatter = float(np.median(spread) / value)
    parts.append(f"spread {100 * scatter:.0f} % from sample to sample" if seen else UNSEEN)
    level = "good" if share >= 0.3 else "partly"
    return Verdict(
        key,
        name,
        level,
        unit,
        value,
        band,
        low,
        high,
        scatter,
        seen,
        nominal,
        share,
        reason,
        reason_share,
        "; ".join(parts),
    )


def _last_valid(time: np.ndarray, valid: np.ndarray) -> float | None:
    """When a stiffness was valid last, if that is a while before the end."""
    last = float(time[np.flatnonzero(valid)[-1]])
    return last if time[-1] - last > RECENT else None
