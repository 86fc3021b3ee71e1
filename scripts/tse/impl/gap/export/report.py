"""DIR/report.html of the gap workflow: one file that needs nothing else, readable offline; the verdict first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import pandas as pd
import plotly.graph_objects as go
import plotly.offline

from tse.impl import __version__
from tse.impl.core import STIFFNESS, library
from tse.impl.files import atomic
from tse.impl.gap.catalogue import catalogue
from tse.impl.gap.data import CHANNELS
from tse.impl.gap.export import pictures
from tse.impl.gap.export.gain import Gain
from tse.impl.gap.infer.show import Change
from tse.impl.gap.workflow import Result
from tse.impl.report import packed
from tse.impl.verdict import NAMES

HEADLINE = {
    "none": "Nothing is missing",
    "named": "Named",
    "possible": "Possible",
    "not_in_catalogue": "Not in the catalogue",
}
MOST_CONDITIONS = 12


@dataclass
class Shown:
    """All that the report shows."""

    result: Result
    vehicle: str
    table: pd.DataFrame
    parts: Mapping[str, Mapping[str, Change]]
    gain: Gain | None = None
    notes: list[str] = field(default_factory=list)


def write_report(path: Path, shown: Shown) -> None:
    """Write the report of a run."""
    result = shown.result
    claim = "" if result.naming.named else " Nothing was added: after is as before."
    sections = [
        ("The gap before and after", "1 is what the sensors' noise alone leaves. Bars: rms over the whole of the logs; "
         f"intervals: of the change, pairs of 2 s blocks resampled.{claim}", pictures.gap_bars(shown.parts)),
        ("Measured and simulated", "The simulation has the sensor biases of its log. Choose the log from the list; click "
         "a name to hide it.", pictures.overlay(shown.table)),
    ]  # fmt: skip
    write_page(
        path, "gap.html.j2", sections,
        title=HEADLINE[result.verdict], shown=shown, result=result, naming=result.naming, catalogue=catalogue(),
        most_conditions=MOST_CONDITIONS, gain=gain_rows(shown.gain) if shown.gain else [], facts=facts(shown),
        place=library().formula_places[result.formula.place].text if result.formula else "",
    )  # fmt: skip


def write_page(path: Path, template: str, sections: Sequence[tuple[str, str, go.Figure]], **values: Any) -> None:
    """Write a page. `sections`: title, text and figure of each; `values`: what else its template takes."""
    loader = jinja2.PackageLoader("tse.impl")
    environment = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"percent": percent, "number": number, "by_size": by_size}
    page = environment.get_template(template).render(
        sections=[
            {"id": f"plot{i}", "title": t, "text": x, "height": f.layout.height} for i, (t, x, f) in enumerate(sections)
        ],
        figures=packed("[" + ",".join(f.to_json() for _, _, f in sections) + "]"),
        plotly=packed(plotly.offline.get_plotlyjs()),
        library=library(),
        version=__version__,
        **values,
    )
    with atomic(path) as file:
        file.write(page)


def percent(x: float) -> str:
    return "> 99 %" if 0.99 < x <= 1.0 else f"{100 * max(0.0, x):.0f} %"


def number(x: float, unit: str = "", digits: int = 3) -> str:
    """A size with its unit; of what shows at no size: never."""
    return f"{x:.{digits}g} {'' if unit == '1' else unit}".strip() if np.isfinite(x) else "never"


def by_size(found: Sequence[Any]) -> list[Any]:
    """Effects by how small they show, over what is typical."""
    return sorted(found, key=lambda d: d.smallest / d.typical)


def gain_rows(gain: Gain) -> list[tuple[str, str, str]]:
    """What the estimator gains, in rows: what, before, after."""
    rows = [("log evidence per row [nat], mean over all logs", *(f"{x:.3f}" for x in gain.evidence))]
    for key in STIFFNESS:
        rows.append((f"{NAMES[key]}: valid", *(f"{100 * v[key]:.0f} % of the time" for v in gain.valid)))
    for key in STIFFNESS:
        cells = [f"{100 * s[key]:.1f} %" if np.isfinite(s[key]) else "too few logs know it" for s in gain.spread]
        rows.append((f"{NAMES[key]}: sd from log to log", *cells))
    for d in gain.drives:
        held = " (held out)" if d.part == "held_out" else ""
        rows.append((f"{d.log}{held}: log evidence per row [nat]", *(f"{x:.3f}" for x in d.evidence)))
    return rows


def facts(shown: Shown) -> list[tuple[str, str]]:
    problem, held = shown.result.problem, shown.result.held
    final, baseline = shown.result.final.values, shown.result.naming.baseline.values
    rows = [("Logs fitted", "; ".join(f"{x.name} ({x.seconds:.0f} s)" for x in problem.logs))]
    if held is not None:
        rows.append(("Logs held out", "; ".join(f"{x.name} ({x.seconds:.0f} s)" for x in held.logs)))
    noise = {c: [log.noise[c] for log in problem.logs if c in log.noise] for c in CHANNELS}
    said = [f"{c} {np.median(x):.3g} {pictures.CHANNEL_UNITS[c]}" for c, x in noise.items() if x]
    rows.append(("Sensor noise of one row, from the logs", ", ".join(said)))
    for key in STIFFNESS:
        rows.append((f"{NAMES[key]}, over the vehicle file's", f"{baseline[key]:.3f} before, {final[key]:.3f} after"))
    return rows
