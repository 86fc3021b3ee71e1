"""DIR/report.html of the gap workflow: one file that needs nothing else, readable offline; the verdict first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import jinja2
import numpy as np
import pandas as pd
import plotly.graph_objects as go
import plotly.offline

from tselab import __version__
from tselab.core import STIFFNESS, library
from tselab.files import atomic
from tselab.gap.catalogue import catalogue
from tselab.gap.data import CHANNELS
from tselab.gap.export import pictures
from tselab.gap.export.gain import Gain
from tselab.gap.infer.show import Change
from tselab.gap.workflow import Result
from tselab.report import packed
from tselab.verdict import NAMES

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
    result, table = shown.result, shown.table
    naming = result.naming
    claim = "" if naming.named else " Nothing was added: after is as before."
    sections: list[tuple[str, str, go.Figure]] = [
        ("The gap before and after", "1 is what the sensors' noise alone leaves. Bars: rms over the whole of the logs; "
         f"intervals: of the change, pairs of 2 s blocks resampled.{claim}", pictures.gap_bars(shown.parts)),
        ("Measured and simulated", "The simulation has the sensor biases of its log. Choose the log from the list; click "
         "a name to hide it.",
         pictures.overlay(table)),
    ]  # fmt: skip
    loader = jinja2.PackageLoader("tselab")
    environment = jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    page = environment.get_template("gap.html.j2").render(
        title=HEADLINE[result.verdict],
        verdict=result.verdict,
        vehicle=shown.vehicle,
        words=result.words,
        notes=[*result.notes, *shown.notes],
        effects=effect_rows(result),
        formula=result.formula,
        place=library().formula_places[result.formula.place].text if result.formula else "",
        numbers=number_rows(result),
        tried=tried_rows(result),
        conditions=[
            {"channel": c.channel, "condition": c.condition, "strength": f"{c.strength:+.2f}"}
            for c in result.conditions[:MOST_CONDITIONS]
        ],
        more_conditions=max(0, len(result.conditions) - MOST_CONDITIONS),
        remains=[r.words for r in result.remainders],
        undetectable=[_detectable(d) for d in sorted(result.undetectable, key=lambda d: d.smallest / d.typical)],
        detectable=[
            _detectable(d) for d in sorted(result.detectable, key=lambda d: d.smallest / d.typical) if d.visible
        ],
        possible=[
            {"id": p["id"], "probability": f"{100 * p['probability']:.0f} %", "why": p["why"]} for p in naming.possible
        ],
        rivals=[
            {
                "names": " + ".join(r["ids"]) or "no name",
                "formula": r["formula"] or "-",
                "probability": _percent(r["probability"]),
            }
            for r in result.rivals
        ],
        sets=[
            {"ids": " + ".join(s["ids"]) or "nothing", "probability": f"{100 * s['probability']:.1f} %"}
            for s in naming.sets
        ],
        gain=gain_rows(shown.gain) if shown.gain else [],
        held=bool(result.held_out),
        sections=[
            {"id": f"plot{i}", "title": t, "text": x, "height": f.layout.height} for i, (t, x, f) in enumerate(sections)
        ],
        figures=packed("[" + ",".join(f.to_json() for _, _, f in sections) + "]"),
        plotly=packed(plotly.offline.get_plotlyjs()),
        facts=facts(shown),
        library=library(),
        version=__version__,
    )
    with atomic(path) as file:
        file.write(page)


def effect_rows(result: Result) -> list[dict]:
    """Named effects as rows of a table, one per parameter."""
    rows: list[dict] = []
    for n in result.naming.named:
        units = {p.name: p for p in n.effect.parameters}
        for k, (key, value) in enumerate(n.values.items()):
            p = units[key]
            low, high = n.ci95[key]
            inside = p.typical_low <= abs(value) <= p.typical_high
            rows.append(
                {
                    "first": k == 0,
                    "span": len(n.values),
                    "id": n.effect.id,
                    "title": n.title,
                    "key": p.key,
                    "text": p.text,
                    "value": f"{value:.4g} {'' if p.unit == '1' else p.unit}".strip(),
                    "ci": f"{low:.3g} .. {high:.3g}",
                    "typical": f"{p.typical_low:g} .. {p.typical_high:g}",
                    "plausible": "typical" if inside else "not typical",
                    "share": f"{100 * max(0.0, n.share):.0f} %",
                    "evidence": f"{n.evidence:.0f}",
                    "look_alikes": ", ".join(n.look_alikes) or "none left",
                    "probability": "> 99 %" if n.probability > 0.99 else f"{100 * n.probability:.0f} %",
                }
            )
    return rows


def number_rows(result: Result) -> list[dict]:
    """The numbers of a proposed formula."""
    rows = []
    for n in result.formula.numbers if result.formula else ():
        unit = "" if n.unit in ("", "1") else f" {n.unit}"
        rows.append(
            {
                "name": n.name,
                "text": n.text,
                "value": f"{n.value:.4g}{unit}",
                "sd": "-" if n.sd is None else f"{n.sd:.2g}",
            }
        )
    return rows


def tried_rows(result: Result) -> list[dict]:
    """All formulas that were simulated."""
    tried = result.discovery.tried if result.discovery else []
    return [
        {
            **t,
            "nats": f"{t['nats']:.0f}",
            "share": f"{100 * max(0.0, t['share']):.0f} %",
            "held_out": "yes" if t["held_out"] else "no",
        }
        for t in tried
    ]


def _detectable(d: object) -> dict:
    smallest = "never" if not np.isfinite(d.smallest) else f"{d.smallest:.2g} {'' if d.unit == '1' else d.unit}".strip()
    return {
        "id": d.id,
        "parameter": d.parameter.removeprefix(d.id + "_"),
        "smallest": smallest,
        "typical": f"{d.typical:.2g} {'' if d.unit == '1' else d.unit}".strip(),
        "ratio": "-" if not np.isfinite(d.smallest) else f"{d.smallest / d.typical:.2g}",
        "absorbed": f"{100 * max(0.0, d.absorbed):.0f} %",
        "channels": catalogue()[d.id].channels,
    }


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
    noise: dict[str, list[float]] = {}
    for log in problem.logs:
        for c in log.channels:
            noise.setdefault(c, []).append(log.noise[c])
    said = [f"{c} {np.median(noise[c]):.3g} {pictures.CHANNEL_UNITS[c]}" for c in CHANNELS if c in noise]
    rows.append(("Sensor noise of one row, from the logs", ", ".join(said)))
    for key in STIFFNESS:
        rows.append((f"{NAMES[key]}, over the vehicle file's", f"{baseline[key]:.3f} before, {final[key]:.3f} after"))
    return rows


def _percent(probability: float) -> str:
    return f"{100 * probability:.1f} %"
