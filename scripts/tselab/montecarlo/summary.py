"""Make tables from the scores of all runs. All runs of one estimator in one case are
combined in one row, with means or RMS values, and confidence intervals."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy import stats

from tse.library.core import STIFFNESS, SimConfig
from tse.log.rows import MEASURES
from tse.report.tables import format_markdown_table
from tselab.montecarlo import scores
from tselab.montecarlo.engine import StudyPlan
from tselab.montecarlo.estimators import PEERS, TEXTS, VARIANTS
from tselab.montecarlo.scores import AFTER, DIVERGED_ERROR, DIVERGED_FOR, OFF, OFF_FOR, SETTLED_FOR, SURE

RESAMPLES = 2000  # number of resamples for a bootstrap interval
CONFIDENCE = 0.95  # confidence level of all intervals
HEADS = {"cx_front": "Cx front", "cy_front": "Cy front", "cy_rear": "Cy rear"}


@dataclass(frozen=True)
class Table:
    """A table in NAME.md, the file with the results of the study NAME."""

    title: str
    head: list[str]
    rows: list[list[str]]
    left: int = 1  # number of columns that are aligned left; the others are numbers
    text: str = ""  # explanation above the table

    def markdown(self) -> str:
        """Return title, explanation and table as Markdown."""
        lines = [f"## {self.title}", "", *([self.text, ""] if self.text else [])]
        return "\n".join([*lines, *format_markdown_table(self.head, self.rows, self.left)])


# ---- intervals


def compute_rms(squares: np.ndarray) -> np.ndarray:
    """Return the RMS along the last axis of an array of squared values."""
    return np.sqrt(squares.mean(axis=-1))


def bootstrap_interval(
    values: np.ndarray, statistic: Callable[[np.ndarray], np.ndarray] = compute_rms
) -> tuple[float, float]:
    """Return the ends of the 95 % bootstrap interval (percentile method) of a statistic.
    For fewer than two runs, both ends are NaN.

    `values`: one entry for each run along the last axis. Runs are resampled with
    replacement. If a run has several values, such as numerator and denominator of a
    ratio, these values are drawn together."""
    values = np.asarray(values, float)
    n = values.shape[-1]
    if n < 2:
        return np.nan, np.nan
    picks = np.random.default_rng(0).integers(0, n, (RESAMPLES, n))
    low, high = np.quantile(statistic(values[..., picks]), [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def compute_rms_ratio(pair: np.ndarray) -> np.ndarray:
    """Return the ratio of two RMS values.

    `pair`: squared values of the numerator, and of the denominator."""
    return compute_rms(pair[0]) / compute_rms(pair[1])


def compute_mean_interval(values: Iterable[float]) -> tuple[float, float]:
    """Return the mean, and half the width of its t interval. For a single value the width
    is NaN. For no values both are NaN."""
    values = np.asarray(values, float)
    if len(values) < 2:
        return float(values.mean()) if len(values) else np.nan, np.nan
    return float(values.mean()), float(stats.t.ppf((1 + CONFIDENCE) / 2, len(values) - 1) * stats.sem(values))


def compute_clopper_pearson(k: int, n: int) -> tuple[float, float]:
    """Return the exact confidence interval of the probability of an event that happened
    in k of n runs."""
    interval = stats.binomtest(k, n).proportion_ci(CONFIDENCE, method="exact")
    return float(interval.low), float(interval.high)


# ---- the table of all cases


def summarise(plan: StudyPlan, runs: pd.DataFrame) -> pd.DataFrame:
    """Return a table with a row for each pair of case and estimator. Errors are in
    percent of the true mean stiffness, shares in percent of runs or of log rows. Times
    are in seconds, unless the name of the column states another unit.

    `runs`: the scores of all runs, from engine.run_study()."""
    lines = []
    for case in plan.study.cases:
        for name in case.estimators:
            part = select_runs(runs, case.name, name)
            if len(part):
                lines.append(
                    {"case": case.name, "estimator": name, "title": case.title} | _summarise_case(part)
                )
    return pd.DataFrame(lines)


def select_runs(runs: pd.DataFrame, case: str, estimator: str) -> pd.DataFrame:
    """Return the runs of one estimator in one case."""
    return runs[(runs["case"] == case) & (runs["estimator"] == estimator)]


def _summarise_case(part: pd.DataFrame) -> dict[str, float]:
    """Return the scores of an estimator in a case, combined over all runs: one row of
    summarise().

    `part`: scores of these runs, a row for each run."""
    n = len(part)
    line: dict[str, float] = {
        "runs": n,
        "first_seed": int(part["seed"].min()),
        "last_seed": int(part["seed"].max()),
    }
    for name in ("diverged", "diverged_any"):
        if part[name].notna().all():
            low, high = compute_clopper_pearson(int(part[name].sum()), n)
            line |= {name: int(part[name].sum()), f"{name}_low": 100 * low, f"{name}_high": 100 * high}
    line["recoveries"] = part["recoveries"].sum(min_count=1)
    for key in STIFFNESS:
        square = part[f"{key}_mean_square"].to_numpy()
        line[f"{key}_rms"] = np.sqrt(square.mean())
        line[f"{key}_rms_low"], line[f"{key}_rms_high"] = bootstrap_interval(square)
        line[f"{key}_rms_median"] = np.sqrt(np.median(square))
        line[f"{key}_bias"], line[f"{key}_bias_half"] = compute_mean_interval(part[f"{key}_bias"])
        line[f"{key}_covered"], line[f"{key}_covered_half"] = compute_mean_interval(part[f"{key}_covered"])
        line[f"{key}_sd"] = np.sqrt(part[f"{key}_sd_square"].mean())
        line[f"{key}_spread"], line[f"{key}_spread_half"] = compute_mean_interval(
            part[f"{key}_spread"].dropna()
        )
        line[f"{key}_spread_seen"] = part[f"{key}_spread_seen"].mean()
        line[f"{key}_diverged"] = part[f"{key}_diverged"].sum(min_count=1)
        line[f"{key}_worst"] = part[f"{key}_worst"].max()
        line[f"{key}_judged"] = 100 * (part[f"{key}_judged"] / part["steps"]).mean()
        for settle in [c for c in part if c.startswith((f"{key}_settle_", f"{key}_stay_"))]:
            if part[settle].notna().any():
                line[settle], line[f"{settle}_90"] = part[settle].quantile([0.5, 0.9], interpolation="higher")
                line[f"{settle}_most"] = part[settle].max()
        for share in scores.SHARES:
            line[f"{key}_{share}"] = _pool_shares(part, [key], share)
    for name in ("changes", "false_changes"):
        line[name] = part[name].sum(min_count=1)
    line["hours"] = part["seconds"].sum() / 3600
    for name in [c for c in part if c.startswith(("detected_", "all_settle_", "valid_off_"))]:
        if part[name].notna().any():
            line[name], line[f"{name}_90"] = part[name].quantile([0.5, 0.9], interpolation="higher")
            line[f"{name}_most"] = part[name].max()
    for share in scores.SHARES:
        line[share] = _pool_shares(part, STIFFNESS, share)
    for channel in MEASURES:
        line[f"noise_{channel}"] = part[f"noise_{channel}"].mean()
    line["microseconds_per_step"] = 1e6 * (part["estimate_s"] / part["steps"]).median()
    line["simulate_s"], line["estimate_s"] = part["simulate_s"].median(), part["estimate_s"].median()
    return line


def _pool_shares(part: pd.DataFrame, keys: Iterable[str], share: str) -> float:
    """Return a share of log rows [%], pooled over all runs and over the stiffnesses
    `keys`: sum of the numerators / sum of the denominators. Return NaN if the sum of the
    denominators is 0.

    `share`: name of the share in scores.SHARES, e.g. "false_valid"."""
    count = sum(part[f"{k}_{share}"].sum() for k in keys)
    among = sum(part[f"{k}_{share}_of"].sum() for k in keys)
    return 100 * count / among if among else np.nan


# ---- numbers as text


def format_number(value: float | None, digits: int = 2, sign: str = "") -> str:
    """Format a number. NaN and None become "-", inf becomes "never"."""
    if value is None or np.isnan(value):
        return "-"
    return "never" if np.isinf(value) else f"{value:{sign}.{digits}f}"


def format_three(line: pd.Series, what: str, digits: int = 1, sign: str = "") -> str:
    """Return the text of one cell of a table: a score of each of the three stiffnesses.

    `line`: scores of a case and estimator. `what`: the score, e.g. "rms"."""
    return ", ".join(format_number(line.get(f"{k}_{what}", np.nan), digits, sign) for k in STIFFNESS)


def format_settling(line: pd.Series, event: int) -> list[str]:
    """Return two cells with settling times [s] after an event, i.e. a change of the true
    stiffness. First cell: time until the error stays below 10 % for 1 s (scores.CLOSE,
    scores.SETTLED_FOR). Second cell: time until the error stays below 10 % up to the next
    event. Each cell has the median of the runs and, in brackets, the max. Median and max
    are computed for each stiffness, and the largest of the three values is printed.

    `event`: number of the event in the case, from 1."""
    cells = []
    for kind in ("settle", "stay"):
        names = [f"{k}_{kind}_{event}" for k in STIFFNESS]
        median, most = (max(line.get(f"{n}{end}", np.nan) for n in names) for end in ("", "_most"))
        cells.append("-" if np.isnan(median) else f"{format_number(median, 1)} ({format_number(most, 1)})")
    return cells


def format_divergence(line: pd.Series) -> str:
    """Return as text the number of runs that diverged, and the confidence interval of the
    share of such runs."""
    if np.isnan(line.get("diverged", np.nan)):
        return "-"
    return f"{line['diverged']:.0f} ({line['diverged_low']:.1f} .. {line['diverged_high']:.1f} %)"


def _format_rms(line: pd.Series, key: str) -> str:
    if np.isnan(line[f"{key}_rms"]):
        return "-"
    low, high = (format_number(line[f"{key}_rms_{end}"]) for end in ("low", "high"))
    return f"{line[f'{key}_rms']:.2f} ({low} .. {high})"


WRONG = f"{100 * DIVERGED_ERROR:.0f} %"
LEGEND = (
    "Cells with three numbers: Cx front, Cy front, Cy rear. Errors are relative to the true mean stiffness, "
    "in the score window of the case.\n\n"
    f"- diverged runs: runs in which the error of a stiffness stayed above {WRONG} for more than "
    f"{DIVERGED_FOR:g} s. Not counted: rows in which the stiffness was not clearly observable, and rows less "
    f"than {scores.SETTLE_AFTER:g} s after the start, a change or a disturbance.\n"
    "- diverged runs, observable or not: the same, but rows in which the stiffness was not clearly "
    "observable count, too.\n"
    "- RMS error, bias: of the rows that the filter did not refuse.\n"
    "- spread: estimated sd of the stiffness from sample to sample; default filter: sd of the model "
    "discrepancy.\n"
    "- spread estimated: rows in which the spread is flagged as estimated.\n"
    "- noise / setting: estimated noise sd over the setting, for accel_x, accel_y, yaw_rate.\n"
    f"- false valid: of the rows flagged valid, share with an error above {WRONG}.\n"
    "- false invalid: of the rows in which the stiffness was clearly observable and its error below "
    f"{100 * scores.CLOSE:.0f} %, share not flagged valid.\n"
    "- reason right: of the rows in which the stiffness was clearly unobservable, share not flagged valid, "
    f"with the reason {', '.join(scores.UNKNOWN_REASONS[:-1])} or {scores.UNKNOWN_REASONS[-1]}.\n"
    "- faults reported: of the rows with a missing or frozen channel, share not flagged valid, or with the "
    "status that a measurement is missing.\n"
    "- restarts: rows in which the filter started over because its state was not finite.\n\n"
    "Intervals are 95 %: Clopper-Pearson for shares, bootstrap for RMS, t for means."
)


def make_overview(plan: StudyPlan, summary: pd.DataFrame) -> Table:
    """Return a table with a row for each pair of case and estimator. Its main columns are
    the number of runs that diverged, the errors of the stiffnesses, the coverage of their
    95 % intervals, the shares of rows whose flag "valid" is wrong, and the spread. LEGEND
    explains all columns.

    `summary`: from summarise()."""
    several = any(len(c.estimators) > 1 for c in plan.study.cases)
    head = [
        "case",
        *(["estimator"] if several else []),
        "runs",
        "diverged runs (95 %)",
        "diverged runs, observable or not",
        *(f"RMS error {h} [%] (95 %)" for h in HEADS.values()),
        "truth in 95 % interval [% of rows]",
        "bias [%]",
        "spread [%]",
        "spread estimated [% of rows]",
        "noise / setting",
        "false valid [%]",
        "false invalid [%]",
        "reason right [%]",
        "faults reported [%]",
        "restarts",
    ]
    rows = [
        [
            f"{line['case']}: {line['title']}",
            *([line["estimator"]] if several else []),
            f"{line['runs']}",
            format_divergence(line),
            format_number(line.get("diverged_any"), 0),
            *(_format_rms(line, k) for k in HEADS),
            format_three(line, "covered", 0),
            format_three(line, "bias", 2, "+"),
            format_three(line, "spread"),
            format_three(line, "spread_seen", 0),
            ", ".join(format_number(line[f"noise_{c}"], 1) for c in MEASURES),
            format_number(line["false_valid"], 2),
            format_number(line["false_invalid"], 1),
            format_number(line["reason_right"], 1),
            format_number(line["corrupted_reported"], 1),
            format_number(line["recoveries"], 0),
        ]
        for _, line in summary.iterrows()
    ]
    return Table("All cases", head, rows, 2 if several else 1, LEGEND)


# ---- tables that only one study has

SETTLING_NOTE = (
    "Time after the change until the error of the stiffness that settles last is below 10 % for "
    f"{SETTLED_FOR:g} s, and until this error stays below 10 % up to the next change or the end of the run: "
    "median run (longest run)."
)


def make_findings(plan: StudyPlan, runs: pd.DataFrame, summary: pd.DataFrame) -> list[Table]:
    """Return the tables that are made only for the study of `plan` and for no other.

    `runs`: the scores of all runs. `summary`: from summarise()."""
    of_study = {
        "paper": _tabulate_paper,
        "robust": _tabulate_robust,
        "peers": _tabulate_peers,
        "regimes": _tabulate_regimes,
        "false-alarms": _tabulate_false_alarms,
    }
    make = of_study.get(plan.study.base)
    return [t for t in make(plan, runs, summary) if t.rows] if make else []


def tabulate_changes(plan: StudyPlan, summary: pd.DataFrame) -> list[Table]:
    """Return a list with one table: the settling times after each change of the road
    surface (Case.events). The list is empty if no case has such a change."""
    rows = [
        [case.name, line["estimator"], f"{event:g} s", *format_settling(line, n)]
        for case in plan.study.cases
        for _, line in summary[summary["case"] == case.name].iterrows()
        for n, event in enumerate(case.events, 1)
    ]
    head = [
        "case",
        "estimator",
        "change at",
        "error below 10 % after [s]",
        "error stays below 10 % after [s]",
    ]
    return [Table("Settling time after a change of road", head, rows, 2, SETTLING_NOTE)] if rows else []


PAPERS = ("printed", "robust", "tse")


def _tabulate_paper(plan: StudyPlan, runs: pd.DataFrame, summary: pd.DataFrame) -> list[Table]:
    """Return a list with one table. It compares Fig. 1 .. 4 of the paper with the results
    of three filters: the paper's filter as printed, the same filter with settings that
    keep it from diverging ("robust"), and the default filter."""
    cases = {c.name: c for c in plan.study.cases}
    rows: list[list[str]] = []
    for name, inputs in (("iv-a", "linear"), ("iv-a-held", "held")):
        if name in cases:
            rows += _tabulate_waves(name, inputs, [select_runs(runs, name, e) for e in PAPERS])
    for name, prior in (("iv-b-20", "-20"), ("iv-b+20", "+20")):
        if name in cases:
            rows += _tabulate_lanes(prior, [select_runs(runs, name, e) for e in ("paper", *PAPERS[1:])])
    text = (
        f"{plan.runs} runs of each case.\n\n"
        "- Sec. IV-A (Fig. 1, 2): 500 particles; forgetting factor 0.99 (robust: covariance 0.998, mean "
        "0.98); initial stiffness 70 % of nominal; every stiffness changes to 70 % at 30 s; inputs linear or "
        "held between rows.\n"
        "- Sec. IV-B (Fig. 3, 4): simulation of the paper's experiment; forgetting factor 0.995 (robust: "
        "mean 0.98); initial stiffness (prior) 20 % too low or too high.\n"
        "- Cells with three numbers: Cx, Cy front, Cy rear, in % of the true mean. In brackets: 95 % "
        "intervals (bootstrap for rms, t for means, Clopper-Pearson for shares).\n"
        "- diverged: runs in which the error of a stiffness exceeds 20 % for more than 2 s in the window: 15 "
        ".. 30 s (before the change), 45 .. 60 s (after the change), 44 .. 48 s (Sec. IV-B).\n"
        "- Standard deviation: that of the stiffness from sample to sample. The default filter does not "
        "estimate it."
    )
    return [
        Table("The paper and three filters", ["", "paper", "as printed", "robust", "default"], rows, 2, text)
    ]


def _format_three_parts(parts: list[pd.DataFrame], cell: Callable[[pd.Series], str], what: str) -> list[str]:
    return [", ".join(cell(part[f"{k}_{what}"]) for k in STIFFNESS) for part in parts]


def _format_rms_of(x: pd.Series) -> str:
    interval = " .. ".join(map(format_number, bootstrap_interval(x.to_numpy())))
    return f"{compute_rms(x.to_numpy()):.2f} ({interval})"


def _format_mean_of(x: pd.Series) -> str:
    mean, half = compute_mean_interval(x)
    return f"{mean:+.2f} ± {format_number(half)}"


def _format_share_of(hit: pd.Series) -> str:
    low, high = compute_clopper_pearson(int(hit.sum()), len(hit))
    return f"{100 * hit.mean():.0f} ({100 * low:.0f} .. {100 * high:.0f}) %"


def _format_errors(parts: list[pd.DataFrame], window: int) -> list[str]:
    hits = [part[[f"{k}_off_w{window}" for k in STIFFNESS]].any(axis=1) for part in parts]
    return [f"{int(hit.sum())} of {len(hit)}; {_format_share_of(hit)}" for hit in hits]


def _tabulate_waves(case: str, inputs: str, parts: list[pd.DataFrame]) -> list[list[str]]:
    head = f"inputs {inputs}: "
    true = 100 * SimConfig().spread_cx_front
    particles = [100 * (part["cx_front_spread_w0"] / true - 1) for part in parts[:2]]
    fig1 = [
        [
            f"Fig. 1, {head}Cx, standard deviation of the median run relative to the truth, %",
            "within 5",
            *(f"{x.median():+.0f}" for x in particles),
            "-",
        ],
        [
            "... runs within 5 %, within 20 %",
            "1 of 1",
            *(f"{_format_share_of(x.abs() <= 5)}, {_format_share_of(x.abs() <= 20)}" for x in particles),
            "-",
        ],
    ]
    fig2 = [
        [
            f"Fig. 2, {head}Cy front, mean error, %",
            "close to 0",
            *(_format_mean_of(p["cy_front_bias_w0"]) for p in parts),
        ],
        [
            "... its sd; p value of the test for a normal distribution",
            "normal distribution",
            *(_format_normality(p["cy_front_bias_w0"]) for p in parts),
        ],
    ]
    rest = [
        [f"{head}rms error, 15 .. 30 s", "-", *_format_three_parts(parts, _format_rms_of, "mean_square_w0")],
        [f"{head}rms error, 45 .. 60 s", "-", *_format_three_parts(parts, _format_rms_of, "mean_square_w1")],
        [
            f"{head}95 % interval contains the truth, 15 .. 30 s",
            "-",
            *_format_three_parts(parts, lambda x: f"{x.mean():.0f}", "covered_w0"),
        ],
        [f"{head}diverged before the change", "-", *_format_errors(parts, 0)],
        [f"{head}diverged after it", "-", *_format_errors(parts, 1)],
    ]
    return [*fig1, *fig2, *rest]


def _format_normality(x: pd.Series) -> str:
    if len(x) < 8:  # too few runs for the test
        return format_number(x.std())
    return f"{x.std():.2f}; {compute_anderson_darling(x.to_numpy())[1]:.3f}"


def _tabulate_lanes(prior: str, parts: list[pd.DataFrame]) -> list[list[str]]:
    head = f"prior {prior} %: "
    throughout = [", ".join(_format_mean_of(part[f"{k}_bias_w0"]) for k in STIFFNESS) for part in parts]
    return [
        [f"Fig. 3, {head}mean error throughout", "-, 2.2, 0.2" if prior == "-20" else "-", *throughout],
        [
            f"{head}rms error at the end, 44 .. 48 s",
            "-",
            *_format_three_parts(parts, _format_rms_of, "mean_square_w1"),
        ],
        [f"{head}diverged at the end", "-", *_format_errors(parts, 1)],
        [
            f"Fig. 4, {head}rms error of vX, m/s; yaw rate, deg/s",
            "closely tracked",
            *(
                f"{np.sqrt(p['vel_x_square'].mean()):.3f}; "
                f"{np.degrees(np.sqrt(p['yaw_rate_square'].mean())):.3f}"
                for p in parts
            ),
        ],
    ]


def _tabulate_robust(plan: StudyPlan, runs: pd.DataFrame, summary: pd.DataFrame) -> list[Table]:
    """Return a table for each case, with the scores in each window. Each row of a
    table is the robust form of the paper's filter (tse_config_robust()) or one of its
    variants (VARIANTS of estimators.py)."""
    tables = []
    for case in plan.study.cases:
        rows = []
        for name in case.estimators:
            part = select_runs(runs, case.name, name)
            cells = []
            for n in range(len(case.windows)):
                cells += [
                    _format_errors([part], n)[0],
                    *_format_three_parts([part], _format_rms_of, f"mean_square_w{n}"),
                ]
            text = VARIANTS[name.partition("-")[2]][0] if "-" in name else "settings of `tse_config_robust()`"
            spread = ", ".join(f"{part[f'{k}_spread_w0'].median():.1f}" for k in STIFFNESS)
            rows.append([name, text, *cells, spread])
        spans = [f"{a:g} .. {b:.0f} s" for a, b in case.windows]
        head = [
            "estimator",
            "settings",
            *(f"{what}, {s}" for s in spans for what in ("diverged runs", "rms error [%]")),
            "spread, median run [%]",
        ]
        text = (
            f"Case: {case.title}; {plan.runs} runs. Cells with three numbers: Cx, Cy front, Cy rear, in % of "
            "the true mean, with 95 % intervals. Diverged runs: runs in which the error of a stiffness "
            "exceeds 20 % for more than 2 s of the window. Spread: estimated sd of a stiffness from sample "
            "to sample; the true value is 5 %."
        )
        tables.append(Table(case.name, head, rows, 2, text))
    return tables


def compute_anderson_darling(x: np.ndarray) -> tuple[float, float]:
    """Return A² of the Anderson-Darling test for a normal distribution, corrected for the
    estimated mean and sd, and its p value (D'Agostino & Stephens 1986, table 4.9)."""
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


def _tabulate_peers(plan: StudyPlan, runs: pd.DataFrame, summary: pd.DataFrame) -> list[Table]:
    rows = []
    for case in plan.study.cases:
        ekf = select_runs(runs, case.name, "ekf")
        for name in case.estimators:
            part = select_runs(runs, case.name, name)
            line = summary[(summary["case"] == case.name) & (summary["estimator"] == name)].iloc[0]
            ratios = []
            for key in STIFFNESS:
                pair = np.stack([p[f"{key}_mean_square"].to_numpy() for p in (part, ekf)])
                low, high = bootstrap_interval(pair, compute_rms_ratio)
                ratios.append(
                    "1"
                    if name == "ekf"
                    else f"{compute_rms_ratio(pair):.2f} ({format_number(low)} .. {format_number(high)})"
                )
            time = line["microseconds_per_step"]
            base = summary[(summary["case"] == case.name) & (summary["estimator"] == "ekf")].iloc[0]
            rows.append(
                [
                    case.name,
                    name,
                    format_divergence(line),
                    format_three(line, "rms", 2),
                    *ratios,
                    format_three(line, "bias", 2, "+"),
                    format_three(line, "covered", 0),
                    format_settling(line, 1)[0],
                    format_number(time, 1),
                    format_number(time / base["microseconds_per_step"]),
                ]
            )
    head = [
        "case",
        "estimator",
        "diverged runs (95 %)",
        "RMS error [%]",
        *(f"{h} / EKF" for h in HEADS.values()),
        "bias [%]",
        "truth in 95 % interval [% of rows]",
        "error below 10 % after [s]",
        "time per step [µs]",
        "time / EKF",
    ]
    text = (
        f"Estimators: ekf: {TEXTS['ekf']}; known: {TEXTS['known']}. Both are written in Python, tse in C: "
        "do not compare their times per step.\n\n"
        "- RMS error: of the rows in 15 .. 30 s.\n"
        "- Cx front / EKF ...: RMS error over the RMS error of ekf on the same data, with paired bootstrap "
        "intervals (95 %).\n"
        "- error below 10 % after: time after the change of the true stiffness until the error of the "
        "stiffness that settles last is below 10 % for 1 s, median run (longest run)."
    )
    return [Table("Comparison with an EKF", head, rows, 2, text)]


# ---- changes of the road


def tabulate_ratios(plan: StudyPlan, runs: pd.DataFrame, base: str) -> list[Table]:
    """Return a table of ratios: RMS error of an estimator / RMS error of the estimator
    `base`. It has a row for each case, estimator and window."""
    rows = []
    for case in plan.study.cases:
        below = select_runs(runs, case.name, base)
        for name in case.estimators:
            part = select_runs(runs, case.name, name)
            if name in (base, *PEERS) or not len(part) or not len(below):
                continue
            for n, (a, b) in enumerate(case.windows):
                pairs = [
                    np.stack([p[f"{k}_mean_square_w{n}"].to_numpy() for p in (part, below)])
                    for k in STIFFNESS
                ]
                if not np.isfinite(pairs).any(axis=(0, 2)).all():
                    continue  # one of the two estimators has no finite error in this window
                cells = [
                    f"{compute_rms_ratio(p):.2f} "
                    f"({' .. '.join(map(format_number, bootstrap_interval(p, compute_rms_ratio)))})"
                    for p in pairs
                ]
                rms = [", ".join(format_number(float(compute_rms(p[i]))) for p in pairs) for i in (0, 1)]
                rows.append([case.name, name, f"{a:g} .. {b:g}", *cells, *rms])
    ratio_heads = [f"{h} / {base}" for h in HEADS.values()]
    head = ["case", "estimator", "window [s]", *ratio_heads, "RMS error [%]", f"RMS error of {base} [%]"]
    text = (
        f"{base} is an {TEXTS[base]}. Cx front / {base} ...: RMS error of the estimator over that of {base} "
        "on the same data, with paired bootstrap intervals (95 %). Cells with three numbers: Cx front, Cy "
        "front, Cy rear."
    )
    return [Table(f"Ratio of the RMS error to that of {base}", head, rows, 2, text)] if rows else []


def _tabulate_regimes(plan: StudyPlan, runs: pd.DataFrame, summary: pd.DataFrame) -> list[Table]:
    return [
        *tabulate_ratios(plan, runs, "known"),
        _tabulate_after(plan, runs),
        tabulate_false_changes(plan, runs),
    ]


def _tabulate_false_alarms(plan: StudyPlan, runs: pd.DataFrame, summary: pd.DataFrame) -> list[Table]:
    return [tabulate_false_changes(plan, runs)]


def _format_median(values: pd.Series) -> str:
    """Return times [s], one for each run, as the text "median (max)". A time of inf means
    "never", e.g. that a change was not detected. If n > 0 times are inf, the text is
    "median (never: n)". NaN values are left out. Without other values the text is "-"."""
    x = values.dropna().to_numpy()
    if not len(x):
        return "-"
    middle, never = np.sort(x)[len(x) // 2], int(np.isinf(x).sum())
    longest = format_number(x.max(), 2) if not never else f"never: {never}"
    return f"{format_number(middle, 2)} ({longest})"


def _tabulate_after(plan: StudyPlan, runs: pd.DataFrame) -> Table:
    rows = [
        [
            case.name,
            name,
            f"{event:g} s",
            *(_format_median(part[f"{what}_{n}"]) for what in ("detected", "all_settle", "valid_off")),
        ]
        for case in plan.study.cases
        if not case.lasts
        for name in case.estimators
        if len(part := select_runs(runs, case.name, name))
        for n, event in enumerate(case.events, 1)
    ]
    head = [
        "case",
        "estimator",
        "change at",
        "detected after [s]",
        "all three errors below 10 % after [s]",
        f"valid, error above {100 * OFF:g} % [s]",
    ]
    text = (
        "Times: median run (longest run). Detected: the estimator reports the change of regime with a "
        f"probability above {100 * SURE:g} %. Errors below 10 %: for {SETTLED_FOR:g} s. Last column: total "
        f"time, within the {OFF_FOR:g} s after the change, in which a stiffness is flagged valid although "
        f"its error exceeds {100 * OFF:g} %."
    )
    return Table("Detection of a change of road", head, rows, 2, text)


def compute_poisson_interval(count: int, exposure: float) -> tuple[float, float]:
    """Return the exact 95 % interval of the rate of a Poisson process (Garwood 1936), in
    events per unit of `exposure`.

    `count`: number of events. `exposure`: time in which they were counted."""
    low = stats.chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    return float(low / exposure), float(stats.chi2.ppf(0.975, 2 * count + 2) / 2 / exposure)


def _format_rate(name: str, estimator: str, part: pd.DataFrame) -> list[str]:
    hours, count = part["seconds"].sum() / 3600, int(part["false_changes"].sum())
    low, high = compute_poisson_interval(count, hours)
    return [
        name,
        estimator,
        format_number(hours, 1),
        format_number(part["changes"].sum(), 0),
        str(count),
        f"{count / hours:.2f} ({low:.2f} .. {high:.2f})",
        str(int((part["false_changes"] > 0).sum())),
    ]


def tabulate_false_changes(plan: StudyPlan, runs: pd.DataFrame) -> Table:
    """Return a table of the changes of regime that the estimators reported, and of the
    false ones among them. A change of regime is a change of the stiffness of all tyres
    or of one axle, or a restart of the filter. A report is false if the true stiffness
    did not change at that time."""
    known = runs[runs["changes"].notna()]
    rows = [
        _format_rate(case.name, name, part)
        for case in plan.study.cases
        for name in case.estimators
        if len(part := select_runs(known, case.name, name))
    ]
    if len(rows) > 1:
        rows += [_format_rate("all", name, part) for name, part in known.groupby("estimator", sort=False)]
    head = [
        "case",
        "estimator",
        "driving time [h]",
        "changes reported",
        "false changes",
        "false changes per hour (95 %)",
        "runs with false changes",
    ]
    text = (
        "A change of regime is a change of the stiffness of all tyres or of one axle, or a restart of the "
        f"filter. It counts as reported if its probability is above {100 * SURE:g} %. It is false if the "
        f"true stiffness did not change in the {AFTER:g} s before it. Intervals are exact for a Poisson "
        "process."
    )
    return Table("Changes of regime", head, rows, 2, text)
