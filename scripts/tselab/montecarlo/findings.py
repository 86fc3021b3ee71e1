"""The tables that only one study has: what it is about."""

from __future__ import annotations

import numpy as np
import pandas as pd
from scipy import stats

from tselab.core import STIFFNESS
from tselab.montecarlo.engine import Plan
from tselab.montecarlo.estimators import DEPARTURES, TEXTS, WITHOUT
from tselab.montecarlo.scores import SETTLED_FOR
from tselab.montecarlo.summary import (
    HEADS,
    Table,
    bootstrap,
    diverged,
    mean_interval,
    number,
    of,
    rms_ratio,
    root_mean,
    settled,
    three,
)
from tselab.study import clopper_pearson

SETTLING = (
    f"Settling: until the error is below 10 % for {SETTLED_FOR:g} s; for good: until it stays below up to the next change or the "
    "end of the run. Of several stiffnesses the slowest."
)
SECONDS = (1, 2, 5, 10, 15, 20, 25, 30, 35, 39)  # of the bound's table


def findings(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> list[Table]:
    """What the study is about."""
    of_study = {"fig1": _fig1, "fig2": _fig2, "bound": _bound, "peers": _peers, "departures": _departures}
    make = of_study.get(plan.study.name)
    return make(plan, runs, summary) if make else []


def _fig1(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> list[Table]:
    rows = [
        [head, number(line[f"{key}_rms"]), number(line[f"{key}_spread"], 1),
         *(number(line[f"{key}_{kind}_{n}"], 1) for n in (0, 1) for kind in ("settle", "stay"))]
        for _, line in summary.iterrows()
        for key, head in HEADS.items()
    ]  # fmt: skip
    head = ["stiffness", "RMS error, %", "spread, %", "s to 10 % from the start", "for good", "s to 10 % after the change",
            "for good"]  # fmt: skip
    return [Table("Error, spread, settling", head, rows, 1, SETTLING)]


def changes(plan: Plan, summary: pd.DataFrame) -> list[Table]:
    """How soon each change of a case is followed."""
    rows = [
        [case.name, line["estimator"], f"{event:g} s", *settled(line, n)]
        for case in plan.study.cases
        for _, line in summary[summary["case"] == case.name].iterrows()
        for n, event in enumerate(case.events, 1)
    ]
    head = ["case", "estimator", "change at", "s to 10 %, median (longest)", "for good"]
    return [Table("After a change of road", head, rows, 2, SETTLING)] if rows else []


def _fig2(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> list[Table]:
    rows = []
    for key, head in HEADS.items():
        x = runs[f"{key}_bias"].to_numpy()
        mean, half = mean_interval(x)
        row = [head, f"{mean:+.3f} ± {number(half, 3)}", number(x.std(ddof=1) if len(x) > 1 else np.nan, 3),
               number(np.abs(x).max())]  # fmt: skip
        n, rest = len(x), ["-"] * 4
        if n >= 8:  # below, neither test says anything
            shapiro = stats.shapiro(x)
            anderson, p = anderson_darling(x)
            rest = [f"{shapiro.statistic:.3f}", f"{shapiro.pvalue:.3f}", f"{anderson:.3f}", f"{p:.3f}"]
        rows.append([*row, *rest])
    head = ["stiffness", "mean (95 %)", "sd", "largest", "Shapiro-Wilk W", "p", "Anderson-Darling A²", "p"]
    text = (
        f"Time mean of the error of each run over the score window, {len(runs)} runs, % of the true mean stiffness. A small p "
        "speaks against a normal distribution."
    )
    return [Table("Mean error and its normality", head, rows, 1, text)]


def anderson_darling(x: np.ndarray) -> tuple[float, float]:
    """A² with the correction for estimated mean and sd, and its p (D'Agostino & Stephens 1986, table 4.9)."""
    n = len(x)
    z = np.sort((x - x.mean()) / x.std(ddof=1))
    i = np.arange(1, n + 1)
    a = -n - np.mean((2 * i - 1) * (stats.norm.logcdf(z) + stats.norm.logsf(z[::-1])))
    a *= 1 + 0.75 / n + 2.25 / n**2
    if a >= 0.6:
        p = np.exp(1.2937 - 5.709 * a + 0.0186 * a**2)
    elif a >= 0.34:
        p = np.exp(0.9177 - 4.279 * a - 1.38 * a**2)
    elif a >= 0.2:
        p = 1 - np.exp(-8.318 + 42.796 * a - 59.938 * a**2)
    else:
        p = 1 - np.exp(-13.436 + 101.14 * a - 223.73 * a**2)
    return float(a), float(np.clip(p, 0, 1))


def _bound(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> list[Table]:
    tables = []
    for case in plan.study.cases:
        for key, head in HEADS.items():
            rows = []
            for second in SECONDS:
                error = {e: of(runs, case.name, e)[f"{key}_ms_{second}"].to_numpy() for e in ("tse", "ekf")}
                sd = {e: of(runs, case.name, e)[f"{key}_vs_{second}"].to_numpy() for e in ("bound", "crb")}
                pair = np.stack([error["tse"], sd["bound"]])
                low, high = bootstrap(pair, rms_ratio)
                rows.append([
                    f"{second} .. {second + 1}", *(number(float(root_mean(v))) for v in (*error.values(), *sd.values())),
                    f"{rms_ratio(pair):.2f} ({number(low)} .. {number(high)})",
                ])  # fmt: skip
            columns = ["time, s", "tse, RMS", "EKF, RMS", "forgetting bound", "Cramer-Rao", "tse over the bound (95 %)"]
            tables.append(Table(f"{head}, % of the true mean stiffness", columns, rows))
    return tables


def _peers(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> list[Table]:
    rows = []
    for case in plan.study.cases:
        ekf = of(runs, case.name, "ekf")
        for name in case.estimators:
            part = of(runs, case.name, name)
            line = summary[(summary["case"] == case.name) & (summary["estimator"] == name)].iloc[0]
            ratios = []
            for key in STIFFNESS:
                pair = np.stack([p[f"{key}_mean_square"].to_numpy() for p in (part, ekf)])
                low, high = bootstrap(pair, rms_ratio)
                ratios.append("1" if name == "ekf" else f"{rms_ratio(pair):.2f} ({number(low)} .. {number(high)})")
            time = line["microseconds_per_step"]
            base = summary[(summary["case"] == case.name) & (summary["estimator"] == "ekf")].iloc[0]
            rows.append([
                case.name, name, diverged(line), three(line, "rms", 2), *ratios, three(line, "bias", 2, "+"),
                three(line, "covered", 0), settled(line, 1)[0], number(time, 1),
                number(time / base["microseconds_per_step"]),
            ])  # fmt: skip
    head = ["case", "estimator", "diverged", "RMS error", *(f"{h} over EKF" for h in HEADS.values()), "bias", "covered",
            "s to 10 % after the change", "µs a step", "over EKF"]  # fmt: skip
    text = (
        "RMS over 15 .. 30 s, ratios on the same data with paired bootstrap intervals (95 %). After the change: until the "
        "slowest stiffness is within 10 % for 1 s, median run (longest). EKF and UKF are Python here; what they would cost in C "
        "is not in this table. "
        + "; ".join(f"{e}: {TEXTS[e]}" for e in ("ekf", "ukf"))
        + "."
    )
    return [Table("Against EKF and UKF", head, rows, 2, text)]


def _departures(plan: Plan, runs: pd.DataFrame, summary: pd.DataFrame) -> list[Table]:
    texts = TEXTS | {WITHOUT + name: f"without: {text}" for name, text, _ in DEPARTURES}
    rows, wrong = [], []
    for name in plan.study.cases[0].estimators:
        lines = [summary[(summary["case"] == c.name) & (summary["estimator"] == name)].iloc[0] for c in plan.study.cases]
        rms = [number(max(line[f"{k}_rms"] for k in STIFFNESS), 1) for line in lines]
        counts = [f" [{line['diverged']:.0f}]" if line["diverged"] else "" for line in lines]
        rows.append([name, texts.get(name, ""), *(r + c for r, c in zip(rms, counts, strict=True))])
        wrong.append([name, *(number(line["false_valid"], 2) for line in lines)])
    head = ["estimator", "what it is", *(c.name for c in plan.study.cases)]
    text = (
        f"RMS error of the worst of the three stiffnesses, %; in brackets how many of the {plan.runs} runs diverged, if any did "
        f"({_resolution(plan.runs)}). All estimators on the same data."
    )
    safety = "Of the rows flagged valid those that are wrong by more than 20 %, all three stiffnesses, in %."
    return [
        Table("What each departure buys: error", head, rows, 2, text),
        Table("What each departure buys: false valid", [head[0], *head[2:]], wrong, 1, safety),
    ]


def _resolution(runs: int) -> str:
    return f"none: below {100 * clopper_pearson(0, runs)[1]:.1f} % with 95 % confidence"
