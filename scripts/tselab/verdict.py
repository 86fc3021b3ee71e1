"""One plain sentence per stiffness: what the log says about it. Used by the terminal and the report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from tselab.core import NOMINAL, STIFFNESS, Config, library
from tselab.log import MEASURES

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
WHY = {
    "starting": "the log is shorter than the filter's memory",
    "uncertain": "there was excitement, but not enough to bring the uncertainty below the limit",
    "diverging": "the measurements contradicted what was learnt",
    "held": "the car stood still, crawled, reversed or steered far",
    "input invalid": "inputs or measurements were missing",
    "row refused": "the rows were refused",
}
UNSEEN = "spread below what this drive can show"
LOUD = 1.25  # noise found over the setting's: from here on it is remarked
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
            f"measurements contradicted what was learnt {often}, in {_percent(float(off.mean()))} of the log: not valid there"
        )
    return found


def _verdict(table: pd.DataFrame, config: Config, key: str) -> Verdict:
    valid = table[f"{key}_valid"].to_numpy() == 1
    share = float(valid.mean()) if len(valid) else 0.0
    nominal, unit, name = getattr(config, NOMINAL[key]) / 1000, UNITS[key], NAMES[key]
    others = table.loc[~valid, f"{key}_reason"].value_counts()
    reason = str(others.index[0]) if len(others) else ""
    reason_share = float(others.iloc[0] / len(valid)) if len(others) else 0.0
    nan = float("nan")
    if share < FEW:
        start = getattr(config, f"initial_{key}") * nominal
        last = float(table[key].iloc[-1]) / 1000 if len(table) else nan
        why = QUIET[key] if reason == "not excited" else WHY.get(reason, reason)
        text = (
            f"{reason or 'no rows'}: {why} in {_percent(reason_share)} of the log; the value shown ({last:.0f} {unit}, "
            f"started at {start:.0f}) says {'little' if share else 'nothing'} about the tyres"
        )
        return Verdict(key, name, "none", unit, nan, nan, nan, nan, nan, False, nominal, share, reason, reason_share, text)

    mean, sd, spread = (table.loc[valid, c].to_numpy() / 1000 for c in (key, f"{key}_sd", f"{key}_spread"))
    value, band = float(np.median(mean)), float(1.96 * np.median(sd))
    low, high = (float(q) for q in np.quantile(mean, [0.05, 0.95]))
    relative = value / nominal - 1
    parts = [
        f"{value:.0f} {unit} ± {max(band, 0.5):.0f} (95 %), valid {_percent(share)} of the time",
        f"{100 * abs(relative):.0f} % {'above' if relative > 0 else 'below'} nominal"
        if abs(relative) >= 0.02
        else "as nominal",
    ]
    if high - low > 3 * band:
        parts.append(
            f"it changed during the log, from {mean[0]:.0f} to {mean[-1]:.0f} (90 % within {low:.0f} .. {high:.0f})"
        )
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


def _percent(share: float) -> str:
    if 0 < share < 0.01:
        return "under 1 %"
    return "over 99 %" if 0.995 <= share < 1 else f"{share * 100:.0f} %"
