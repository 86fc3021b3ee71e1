"""Write the HTML page of a calibration: the numbers found, their intervals, and the
misfit of the model before and after the calibration."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from tse.calibration.result import CalibrationResult, Proof
from tse.identify.unknowns import MEASURED
from tse.report.plots import BLUE, CHANNEL_UNITS, GREY, ORANGE, set_layout
from tse.report.report import write_page


def write(path: Path, result: CalibrationResult, words: Sequence[str]) -> None:
    """Write the page of a calibration. `words` are the sentences at its top."""
    sections: list[tuple[str, str, go.Figure]] = [
        (
            "Numbers found, compared with their prior",
            "Difference of each number from its prior mean, in units of the prior sd, with its 95 % "
            "interval. The prior is that of ordinary cars or of an earlier calibration; its 95 % range is "
            "-2 to 2. Grey: these logs do not determine the number.",
            draw_bands(result),
        ),
        (
            "Measured minus simulated, before and after",
            "Rms about the mean of each log. Before: the car of the vehicle file. After: the calibrated "
            "car. Fitted logs are simulated on the road that was found, held-out logs on a road whose "
            "superelevation in curves is fitted.",
            draw_misfit(result.proofs),
        ),
    ]
    converged = result.fit.converged
    write_page(
        path, "calibrate.html.j2", sections,
        title="Calibrated" if converged else "Calibrated, but the search has not converged",
        converged=converged, vehicle=result.vehicle.name, words=words, notes=result.notes,
        groups=result.groups, facts=_list_facts(result),
    )  # fmt: skip


def _list_facts(result: CalibrationResult) -> list[tuple[str, str]]:
    """Return the facts of the run as (name, text): logs, search, errors that the model
    does not explain, quantisation, noise."""
    rows = [("Logs", "; ".join(f"{log.name} ({log.seconds:.0f} s)" for log in result.problem.logs))]
    rows.append(
        ("Search", f"{result.fit.steps} steps, {'converged' if result.fit.converged else 'not converged'}")
    )
    for c, left in result.problem.measure_lasting(result.fit.level).items():
        unit = (
            "m/s" if c == "accel_x" else CHANNEL_UNITS[c]
        )  # the residual of accel_x is integrated to a speed
        text = (
            f"an error of {np.sqrt(left.power):.2g} {unit} that lasts 1 s, and a random walk with sd "
            f"{left.walk:.2g} {unit}/sqrt(s)"
        )
        rows.append((f"Not explained on level roads, {c}", text))
    steps = ", ".join(f"{c} {step:.3g}" for c, step in result.steps.items() if step > 0)
    rows.append(("Quantised in steps of", f"{steps} (rad, rad/s, m/s2)" if steps else "no visible steps"))
    rows.append(("Noise of wheel speeds", f"{result.sensors['wheel_noise_sd']:.3g} rad/s"))
    return rows


def draw_bands(result: CalibrationResult) -> go.Figure:
    """Return a figure with a point for each fitted parameter: (posterior mean - prior
    mean) / prior sd, with the 95 % interval in the same unit."""
    rows = [f for g in result.groups for f in g.members][::-1]
    figure = go.Figure()
    figure.add_vrect(x0=-2, x1=2, fillcolor="#eef2f6", line_width=0, layer="below")
    for shown, colour, title in (
        (True, BLUE, "shown by these logs"),
        (False, GREY, "not shown by these logs"),
    ):
        mine = [f for f in rows if f.shown == shown]
        if mine:
            figure.add_trace(
                go.Scatter(
                    x=[(f.value - f.prior) / f.prior_sd for f in mine],
                    y=[f.name for f in mine],
                    mode="markers",
                    name=title,
                    marker={"color": colour, "size": 8},
                    hovertext=[f.words for f in mine],
                    hoverinfo="text",
                    error_x={
                        "type": "data",
                        "array": [1.96 * f.sd / f.prior_sd for f in mine],
                        "color": colour,
                        "thickness": 2,
                    },
                )
            )
    figure.update_yaxes(categoryorder="array", categoryarray=[f.name for f in rows], automargin=True)
    figure.update_xaxes(title="difference from the prior mean, in prior sds")
    return set_layout(figure, 160 + 20 * len(rows), title_text=None)


def draw_misfit(proofs: Sequence[Proof]) -> go.Figure:
    """Return a bar chart: rms residual of each log before and after the calibration."""
    names = [p.log + (" (held out)" if p.held_out else "") for p in proofs]
    figure = make_subplots(
        1, len(MEASURED), subplot_titles=[f"{c} [{CHANNEL_UNITS[c]}]" for c in MEASURED], shared_yaxes=True
    )
    for column, c in enumerate(MEASURED, 1):
        mine = [p.channels.get(c) for p in proofs]
        for title, colour, values in (
            ("before", ORANGE, [x.before if x else np.nan for x in mine]),
            ("after", BLUE, [x.after if x else np.nan for x in mine]),
            ("noise of the sensor", GREY, [x.noise if x else np.nan for x in mine]),
        ):
            bars = go.Bar(
                x=values, y=names, orientation="h", name=title, legendgroup=title, showlegend=column == 1,
                marker_color=colour,
            )  # fmt: skip
            figure.add_trace(bars, row=1, col=column)
    figure.update_yaxes(autorange="reversed", automargin=True)
    return set_layout(figure, 190 + 44 * len(names), bargap=0.3)
