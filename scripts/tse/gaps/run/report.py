"""Write DIR/report.html of the gap workflow: one self-contained file that begins with the
verdict.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tse.estimation.verdict import NAMES
from tse.gaps.catalogue import load_catalogue
from tse.gaps.fit import ChannelChange
from tse.gaps.run import pictures
from tse.gaps.run.workflow import GapResult
from tse.identify.data import COMPARED_CHANNELS
from tse.library.core import STIFFNESS, library
from tse.report.plots import CHANNEL_UNITS
from tse.report.report import write_page

HEADLINE = {
    "none": "Nothing is missing",
    "named": "Named",
    "possible": "Possible",
    "not_in_catalogue": "Not in the catalogue",
}
MAX_CONDITIONS = 12  # max number of conditions of driving with large residuals in the report


@dataclass
class ReportInput:
    """All data that the report shows."""

    result: GapResult
    vehicle: str
    table: pd.DataFrame  # result of output.make_table()
    # "fit" (fitted logs) or "held_out" -> channel -> change of its residuals by the run
    parts: Mapping[str, Mapping[str, ChannelChange]]
    gain: Mapping[str, Any]  # result of output.compute_gain()
    # stiffness -> ratio of its value in the improved vehicle file to its value in the
    # vehicle file of the user
    stiffness: Mapping[str, float]
    notes: list[str] = field(default_factory=list)


def write_report(path: Path, shown: ReportInput) -> None:
    """Write the report of a run."""
    result = shown.result
    nothing = not result.naming.named and result.formula is None
    claim = " Nothing was added, so after is the same as before." if nothing else ""
    sections = [
        (
            "The gap before and after",
            "Residual divided by sensor noise; 1 is noise alone. Bars: rms over all logs. Error bars: "
            "95 % interval of the change from before to after, from a bootstrap that draws the same blocks "
            f"of 2 s before and after.{claim}",
            pictures.draw_gap_bars(shown.parts),
        ),
        (
            "Measured and simulated",
            "The simulation includes the sensor biases found for its log. Choose the log from the list. "
            "Click a name in the legend to hide its line.",
            pictures.draw_overlay(shown.table),
        ),
    ]
    write_page(
        path,
        "gap.html.j2",
        sections,
        filters={"percent": format_percent, "number": format_size, "by_size": sort_by_size},
        title=HEADLINE[result.verdict],
        shown=shown,
        result=result,
        naming=result.naming,
        catalogue=load_catalogue(),
        most_conditions=MAX_CONDITIONS,
        gain=make_gain_rows(shown.gain),
        facts=list_facts(shown),
        place=library().formula_places[result.formula.place].text if result.formula else "",
    )


def format_percent(x: float) -> str:
    return "> 99 %" if 0.99 < x <= 1.0 else f"{100 * max(0.0, x):.0f} %"


def format_size(x: float, unit: str = "", digits: int = 3) -> str:
    """Return a number with its unit. Infinity becomes "never": if the smallest visible
    size of an effect is infinite, the effect is never visible.
    """
    return f"{x:.{digits}g} {'' if unit == '1' else unit}".strip() if np.isfinite(x) else "never"


def sort_by_size(found: Sequence[Any]) -> list[Any]:
    """Sort effects by the ratio of their smallest visible size to their typical size."""
    return sorted(found, key=lambda d: d.smallest / d.typical)


def make_gain_rows(gain: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the results of the estimator with two vehicle files, as rows of a table.

    Each row has a quantity, its value with the vehicle file of the user (before), and its
    value with the improved vehicle file (after). `gain` is the result of
    output.compute_gain().
    """

    def make_row(title: str, of: Mapping[str, Any], say: Callable[[Any], str]) -> tuple[str, ...]:
        return title, say(of["before"]), say(of["after"])

    rows = [
        make_row(
            "log evidence per row [nat], mean over all logs", gain["log_evidence_per_row"], "{:.3f}".format
        )
    ]
    for key in STIFFNESS:
        rows.append(
            make_row(
                f"{NAMES[key]}: valid", gain["valid"], lambda v, k=key: f"{100 * v[k]:.0f} % of the time"
            )
        )
    for d in gain["logs"]:
        held = " (held out)" if d["part"] == "held_out" else ""
        rows.append(make_row(f"{d['log']}{held}: log evidence per row [nat]", d["evidence"], "{:.3f}".format))
    return rows


def list_facts(shown: ReportInput) -> list[tuple[str, str]]:
    """Return the facts of the run as (name, value): logs, sensor noise, stiffness."""
    problem, held = shown.result.problem, shown.result.held
    baseline = shown.result.naming.baseline.values
    rows = [("Logs fitted", "; ".join(f"{x.name} ({x.seconds:.0f} s)" for x in problem.logs))]
    if held is not None:
        rows.append(("Logs held out", "; ".join(f"{x.name} ({x.seconds:.0f} s)" for x in held.logs)))
    noise = {c: [log.noise[c] for log in problem.logs if c in log.noise] for c in COMPARED_CHANNELS}
    said = [f"{c} {np.median(x):.3g} {CHANNEL_UNITS[c]}" for c, x in noise.items() if x]
    rows.append(("Sensor noise of one row, from the logs", ", ".join(said)))
    for key in STIFFNESS:
        rows.append(
            (
                f"{NAMES[key]}, ratio to the vehicle file",
                f"{baseline[key]:.3f} before, {shown.stiffness[key]:.3f} after",
            )
        )
    return rows
