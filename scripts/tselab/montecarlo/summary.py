"""Rows become tables: one line per case and estimator, with intervals."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import stats

from tse.impl.core import STIFFNESS
from tse.impl.rows import MEASURES
from tse.impl.tables import markdown_table
from tselab.montecarlo import scores
from tselab.montecarlo.engine import Plan
from tselab.montecarlo.scores import DIVERGED_ERROR, DIVERGED_FOR

RESAMPLES = 2000  # of a bootstrap interval
LEVEL = 0.95
HEADS = {"cx_front": "Cx front", "cy_front": "Cy front", "cy_rear": "Cy rear"}


@dataclass(frozen=True)
class Table:
    """A table for people. All but the first `left` columns are numbers."""

    title: str
    head: list[str]
    rows: list[list[str]]
    left: int = 1
    text: str = ""

    def markdown(self) -> str:
        lines = [f"## {self.title}", "", *([self.text, ""] if self.text else [])]
        return "\n".join([*lines, *markdown_table(self.head, self.rows, self.left)])


# ---- intervals


def root_mean(squares: np.ndarray) -> np.ndarray:
    """RMS along the last axis."""
    return np.sqrt(squares.mean(axis=-1))


def bootstrap(values: np.ndarray, statistic: Callable[[np.ndarray], np.ndarray] = root_mean) -> tuple[float, float]:
    """Percentile interval of a statistic over the last axis, which holds the runs: they are drawn again as a whole."""
    values = np.asarray(values, float)
    n = values.shape[-1]
    if n < 2:
        return np.nan, np.nan
    picks = np.random.default_rng(0).integers(0, n, (RESAMPLES, n))
    low, high = np.quantile(statistic(values[..., picks]), [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def rms_ratio(pair: np.ndarray) -> np.ndarray:
    """RMS of the first row of squares over that of the second."""
    return root_mean(pair[0]) / root_mean(pair[1])


def mean_interval(values: Iterable[float]) -> tuple[float, float]:
    """Mean, and half the width of its t interval."""
    values = np.asarray(values, float)
    if len(values) < 2:
        return float(values.mean()) if len(values) else np.nan, np.nan
    return float(values.mean()), float(stats.t.ppf((1 + LEVEL) / 2, len(values) - 1) * stats.sem(values))


def clopper_pearson(k: int, n: int) -> tuple[float, float]:
    """Exact interval of a share."""
    interval = stats.binomtest(k, n).proportion_ci(LEVEL, method="exact")
    return float(interval.low), float(interval.high)


# ---- the table of all cases


def summarise(plan: Plan, runs: pd.DataFrame) -> pd.DataFrame:
    """One line per case and estimator. Percent, seconds."""
    lines = []
    for case in plan.study.cases:
        for name in case.estimators:
            part = of(runs, case.name, name)
            if len(part):
                lines.append({"case": case.name, "estimator": name, "title": case.title} | _line(part))
    return pd.DataFrame(lines)


def of(runs: pd.DataFrame, case: str, estimator: str) -> pd.DataFrame:
    """The rows of one estimator in one case, by seed."""
    return runs[(runs["case"] == case) & (runs["estimator"] == estimator)]


def _line(part: pd.DataFrame) -> dict[str, float]:
    n = len(part)
    line: dict[str, float] = {"runs": n, "first_seed": int(part["seed"].min()), "last_seed": int(part["seed"].max())}
    for name in ("diverged", "diverged_any"):
        if part[name].notna().all():
            low, high = clopper_pearson(int(part[name].sum()), n)
            line |= {name: int(part[name].sum()), f"{name}_low": 100 * low, f"{name}_high": 100 * high}
    line["recoveries"] = part["recoveries"].sum(min_count=1)
    for key in STIFFNESS:
        square = part[f"{key}_mean_square"].to_numpy()
        line[f"{key}_rms"] = np.sqrt(square.mean())
        line[f"{key}_rms_low"], line[f"{key}_rms_high"] = bootstrap(square)
        line[f"{key}_rms_median"] = np.sqrt(np.median(square))
        line[f"{key}_bias"], line[f"{key}_bias_half"] = mean_interval(part[f"{key}_bias"])
        line[f"{key}_covered"], line[f"{key}_covered_half"] = mean_interval(part[f"{key}_covered"])
        line[f"{key}_sd"] = np.sqrt(part[f"{key}_sd_square"].mean())
        line[f"{key}_spread"], line[f"{key}_spread_half"] = mean_interval(part[f"{key}_spread"].dropna())
        line[f"{key}_spread_seen"] = part[f"{key}_spread_seen"].mean()
        line[f"{key}_diverged"] = part[f"{key}_diverged"].sum(min_count=1)
        line[f"{key}_worst"] = part[f"{key}_worst"].max()
        line[f"{key}_judged"] = 100 * (part[f"{key}_judged"] / part["steps"]).mean()
        for settle in [c for c in part if c.startswith((f"{key}_settle_", f"{key}_stay_"))]:
            if part[settle].notna().any():
                line[settle], line[f"{settle}_90"] = part[settle].quantile([0.5, 0.9], interpolation="higher")
                line[f"{settle}_most"] = part[settle].max()
        for share in scores.SHARES:
            line[f"{key}_{share}"] = _pooled(part, [key], share)
    for name in ("changes", "false_changes"):
        line[name] = part[name].sum(min_count=1)
    line["hours"] = part["seconds"].sum() / 3600
    for name in [c for c in part if c.startswith(("detected_", "all_settle_", "valid_off_"))]:
        if part[name].notna().any():
            line[name], line[f"{name}_90"] = part[name].quantile([0.5, 0.9], interpolation="higher")
            line[f"{name}_most"] = part[name].max()
    for share in scores.SHARES:
        line[share] = _pooled(part, STIFFNESS, share)
    for channel in MEASURES:
        line[f"noise_{channel}"] = part[f"noise_{channel}"].mean()
    line["microseconds_per_step"] = 1e6 * (part["estimate_s"] / part["steps"]).median()
    line["simulate_s"], line["estimate_s"] = part["simulate_s"].median(), part["estimate_s"].median()
    return line


def _pooled(part: pd.DataFrame, keys: Iterable[str], share: str) -> float:
    """Share of all rows of all runs, percent; NaN when there is none."""
    count = sum(part[f"{k}_{share}"].sum() for k in keys)
    among = sum(part[f"{k}_{share}_of"].sum() for k in keys)
    return 100 * count / among if among else np.nan


# ---- for people


def number(value: float | None, digits: int = 2, sign: str = "") -> str:
    """A number; a dash where there is none."""
    if value is None or np.isnan(value):
        return "-"
    return "never" if np.isinf(value) else f"{value:{sign}.{digits}f}"


def three(line: pd.Series, what: str, digits: int = 1, sign: str = "") -> str:
    """The three stiffnesses in one cell."""
    return ", ".join(number(line.get(f"{k}_{what}", np.nan), digits, sign) for k in STIFFNESS)


def settled(line: pd.Series, event: int) -> list[str]:
    """Two cells: seconds until settled after an event, median and longest; the same for good. Of the slowest stiffness."""
    cells = []
    for kind in ("settle", "stay"):
        names = [f"{k}_{kind}_{event}" for k in STIFFNESS]
        median, most = (max(line.get(f"{n}{end}", np.nan) for n in names) for end in ("", "_most"))
        cells.append("-" if np.isnan(median) else f"{number(median, 1)} ({number(most, 1)})")
    return cells


def diverged(line: pd.Series) -> str:
    """Count and interval."""
    if np.isnan(line.get("diverged", np.nan)):
        return "-"
    return f"{line['diverged']:.0f} ({line['diverged_low']:.1f} .. {line['diverged_high']:.1f} %)"


def _rms(line: pd.Series, key: str) -> str:
    if np.isnan(line[f"{key}_rms"]):
        return "-"
    return f"{line[f'{key}_rms']:.2f} ({number(line[f'{key}_rms_low'])} .. {number(line[f'{key}_rms_high'])})"


WRONG = f"{100 * DIVERGED_ERROR:.0f} %"
LEGEND = (
    "Triples: Cx front, Cy front, Cy rear. In % of the true mean stiffness, in the score window of the case. Diverged: runs in "
    f"which the mean of a stiffness was wrong by more than {WRONG} on end, for more than {DIVERGED_FOR:g} s of rows from which "
    f"it could clearly be observed, {scores.SETTLE_AFTER:g} s after the start, a change or a disturbance; any: whether it could "
    "be observed or not. RMS and bias leave out refused rows, which have no estimate. Covered: share of rows whose 95 % interval "
    f"holds the truth. False valid: of the rows flagged valid, those wrong by more than {WRONG}. False invalid: of the rows from "
    f"which it could clearly be observed, and was within {100 * scores.CLOSE:.0f} %, those not flagged valid. Reason right: of "
    "the rows from which it clearly could not be observed, those that say so. Faults reported: of the rows with a missing or "
    "frozen channel, those not flagged valid or with the status that a measurement is missing. Seen: share of rows that say that "
    "the spread is learnt, not below what can be observed. Noise: sd as found over the setting, accel_x, accel_y, yaw_rate, "
    "mean. Intervals: 95 %, "
    "Clopper-Pearson for shares, bootstrap for RMS, t for means."
)


def overview(plan: Plan, summary: pd.DataFrame) -> Table:
    """One line per case and estimator: divergence, error, coverage, validity, spread."""
    several = any(len(c.estimators) > 1 for c in plan.study.cases)
    head = ["case", *(["estimator"] if several else []), "runs", "diverged (95 %)", "any",
            *(f"RMS {h} (95 %)" for h in HEADS.values()), "covered", "bias", "spread", "seen", "noise", "false valid",
            "false invalid", "reason right", "faults reported", "recoveries"]  # fmt: skip
    rows = [
        [
            f"{line['case']}: {line['title']}", *([line["estimator"]] if several else []), f"{line['runs']}", diverged(line),
            number(line.get("diverged_any"), 0), *(_rms(line, k) for k in HEADS), three(line, "covered", 0),
            three(line, "bias", 2, "+"), three(line, "spread"), three(line, "spread_seen", 0),
            ", ".join(number(line[f"noise_{c}"], 1) for c in MEASURES), number(line["false_valid"], 2),
            number(line["false_invalid"], 1), number(line["reason_right"], 1), number(line["corrupted_reported"], 1),
            number(line["recoveries"], 0),
        ]
        for _, line in summary.iterrows()
    ]  # fmt: skip
    return Table("All cases", head, rows, 2 if several else 1, LEGEND)
