"""The report's interactive figures (plotly), one function a section."""

from __future__ import annotations

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from tselab.core import NOMINAL, STATUS, STIFFNESS, Config, library
from tselab.log import MEASURES
from tselab.verdict import NAMES, UNITS

INK, BLUE, ORANGE, GREEN, PURPLE, GREY = "#1f2933", "#0b5fa5", "#c4570a", "#1a7f5a", "#7b4fa3", "#8a94a0"
BAND, SPREAD, SHADE = "rgba(11,95,165,0.28)", "rgba(11,95,165,0.10)", "rgba(90,100,110,0.13)"
MOST_POINTS = 5000  # per line; longer logs are thinned
QUIET = 1.05  # noise found over the setting's up to which there is nothing to see
MOST_SHADES = 150  # shaded intervals per plot; shorter gaps are bridged

# Reference columns: ref_<quantity> or ref_<quantity>_<anything>, and the names loggers use.
ALIASES = {"ref_vehicle_speed": "vel_x", "ref_speed": "vel_x", "ref_beta": "sideslip"}


def match_reference(column: str) -> str | None:
    """The quantity a ref_ column is drawn with, or None."""
    quantities = ("vel_x", "vel_y", "yaw_rate", "sideslip", "accel_x", "accel_y", "steer_angle", *STIFFNESS)
    for prefix, quantity in ALIASES.items():
        if column == prefix or column.startswith(prefix + "_"):
            return quantity
    for quantity in quantities:
        if column == f"ref_{quantity}" or column.startswith(f"ref_{quantity}_"):
            return quantity
    if column.startswith("ref_wheel_"):
        rest = column.removeprefix("ref_wheel_").removeprefix("speed_")
        return {"f": "wheel_speed_front", "r": "wheel_speed_rear"}.get(rest[:1])
    return None


class Data:
    """Estimates, log rows and reference columns, thinned to what a screen can show."""

    def __init__(self, table: pd.DataFrame, log: pd.DataFrame, ref: pd.DataFrame):
        self.stride = max(1, -(-len(table) // MOST_POINTS))
        pick = slice(None, None, self.stride)
        n = len(table)
        self.est, self.log, self.ref = (f.iloc[:n].iloc[pick] for f in (table, log, ref))
        self.time = self.est["time"].to_numpy()

    def references(self, quantity: str) -> list[str]:
        return [c for c in self.ref if match_reference(c) == quantity]


def _figure(rows: int, titles: list[str], height: int = 190) -> go.Figure:
    figure = make_subplots(
        rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.11 / rows + 0.012, subplot_titles=titles
    )
    figure.update_layout(
        height=height * rows + 70,
        margin={"l": 62, "r": 18, "t": 70, "b": 40},
        font={"family": "system-ui, sans-serif", "size": 13, "color": INK},
        paper_bgcolor="white",
        plot_bgcolor="white",
        hovermode="x unified",
        legend={
            "orientation": "h",
            "y": 0.995,
            "yanchor": "top",
            "x": 0,
            "xanchor": "left",
            "yref": "container",
        },
    )
    figure.update_xaxes(
        showgrid=True,
        gridcolor="#edf0f3",
        zeroline=False,
        linecolor="#c8ced4",
        ticks="outside",
        tickcolor="#c8ced4",
    )
    figure.update_yaxes(showgrid=True, gridcolor="#edf0f3", zeroline=False, linecolor="#c8ced4", title_standoff=6)
    figure.update_xaxes(title_text="time [s]", row=rows, col=1)
    for note in figure.layout.annotations:
        note.update(x=0, xanchor="left", font={"size": 14, "color": INK})
    return figure


def _line(
    figure: go.Figure,
    row: int,
    x: np.ndarray,
    y: pd.Series | np.ndarray,
    name: str,
    colour: str,
    legend: bool = True,
    **more,
) -> None:
    line = {"color": colour, "width": more.pop("width", 1.5)}
    if dash := more.pop("dash", None):
        line["dash"] = dash
    figure.add_trace(
        go.Scatter(
            x=x, y=np.asarray(y, np.float32), name=name, line=line, mode="lines", legendgroup=name, showlegend=legend,
            connectgaps=False, **more,
        ),
        row=row,
        col=1,
    )  # fmt: skip


def _band(
    figure: go.Figure,
    row: int,
    x: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    name: str,
    colour: str,
    legend: bool,
) -> None:
    for y, fill in ((low, None), (high, "tonexty")):
        figure.add_trace(
            go.Scatter(
                x=x, y=np.asarray(y, np.float32), name=name, mode="lines", line={"width": 0, "color": colour},
                fill=fill, fillcolor=colour, hoverinfo="skip", legendgroup=name, showlegend=bool(fill) and legend,
            ),
            row=row,
            col=1,
        )  # fmt: skip


def shade(figure: go.Figure, row: int, time: np.ndarray, where: np.ndarray) -> None:
    """Shade the stretches where `where` is true; the shortest gaps between them are bridged if there are too many."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(int), [0]])))
    starts, ends = edges[::2], edges[1::2]
    if len(starts) > MOST_SHADES:
        gaps = starts[1:] - ends[:-1]
        keep = np.sort(np.argsort(gaps)[::-1][: MOST_SHADES - 1])
        starts, ends = (
            np.concatenate([starts[:1], starts[1:][keep]]),
            np.concatenate([ends[:-1][keep], ends[-1:]]),
        )
    axis = "" if row == 1 else str(row)
    shapes = [
        {"type": "rect", "xref": f"x{axis}", "yref": f"y{axis} domain", "x0": float(time[a]),
         "x1": float(time[min(b, len(time) - 1)]), "y0": 0, "y1": 1, "fillcolor": SHADE, "line": {"width": 0}, "layer": "below"}
        for a, b in zip(starts, ends, strict=True)
    ]  # fmt: skip
    figure.update_layout(shapes=(*figure.layout.shapes, *shapes))


def stiffness_figure(d: Data, config: Config) -> go.Figure:
    """Mean, its 95 % band and the spread band; grey where not valid, with the reason on hover."""
    figure = _figure(3, [f"{NAMES[s]} [{UNITS[s]}]" for s in STIFFNESS], 230)
    for row, key in enumerate(STIFFNESS, 1):
        first = row == 1
        mean, sd, spread = (d.est[c].to_numpy() / 1000 for c in (key, f"{key}_sd", f"{key}_spread"))
        valid = d.est[f"{key}_valid"].to_numpy() == 1
        nominal = getattr(config, NOMINAL[key]) / 1000
        _band(
            figure,
            row,
            d.time,
            mean - 1.96 * spread,
            mean + 1.96 * spread,
            "spread, 95 % of samples",
            SPREAD,
            first,
        )
        _band(figure, row, d.time, mean - 1.96 * sd, mean + 1.96 * sd, "95 % band of the mean", BAND, first)
        _line(figure, row, d.time, np.where(valid, np.nan, mean), "not valid", GREY, first, hoverinfo="skip")
        _line(
            figure,
            row,
            d.time,
            np.where(valid, mean, np.nan),
            "mean, valid",
            BLUE,
            first,
            width=2.2,
            hoverinfo="skip",
        )
        text = [
            f"{m:.1f} ± {1.96 * s:.1f} {UNITS[key]}, {r}"
            for m, s, r in zip(mean, sd, d.est[f"{key}_reason"], strict=True)
        ]
        _line(figure, row, d.time, mean, "estimate", "rgba(0,0,0,0)", False, text=text, hovertemplate="%{text}")
        _line(
            figure,
            row,
            d.time[[0, -1]],
            [nominal, nominal],
            "nominal",
            GREY,
            first,
            dash="dot",
            width=1,
            hoverinfo="skip",
        )
        for i, c in enumerate(d.references(key)):
            _line(
                figure,
                row,
                d.time,
                d.ref[c] / 1000,
                "reference",
                ORANGE,
                first and i == 0,
                width=1.8,
                dash="dash",
            )
        shade(figure, row, d.time, ~valid)
        top = np.nanmax([1.5 * nominal, 1.25 * np.nanquantile(mean, 0.99)]) if np.isfinite(mean).any() else 2 * nominal
        figure.update_yaxes(range=[0, float(min(top, 6 * nominal))], row=row, col=1)
    return figure


def states_figure(d: Data) -> go.Figure:
    """States with their 95 % band, references and what was measured."""
    rows = [("vel_x", "Longitudinal velocity [m/s]", 1.0), ("vel_y", "Lateral velocity [m/s]", 1.0),
            ("yaw_rate", "Yaw rate [rad/s]", 1.0), ("sideslip", "Sideslip angle [deg]", 180 / np.pi)]  # fmt: skip
    figure = _figure(len(rows), [title for _, title, _ in rows], 180)
    for row, (key, _title, factor) in enumerate(rows, 1):
        first = row == 1
        mean = d.est[key].to_numpy() * factor
        if key == "yaw_rate":
            _line(figure, row, d.time, d.log["yaw_rate"], "measured", GREY, True, width=1)
        if key != "sideslip":
            sd = d.est[f"{key}_sd"].to_numpy()
            _band(figure, row, d.time, mean - 1.96 * sd, mean + 1.96 * sd, "95 % band", BAND, first)
        _line(figure, row, d.time, mean, "estimate", BLUE, first, width=2)
        for c in d.references(key):
            _line(figure, row, d.time, d.ref[c] * factor, c, ORANGE, True, dash="dash", width=1.4)
    return figure


def inputs_figure(d: Data) -> go.Figure:
    """The log as it was read."""
    rows = [("Steering angle [rad]", ["steer_angle"]), ("Wheel speeds [rad/s]", ["wheel_speed_front", "wheel_speed_rear"]),
            ("Specific force [m/s2]", ["accel_x", "accel_y"])]  # fmt: skip
    figure = _figure(len(rows), [title for title, _ in rows], 180)
    for row, (_, names) in enumerate(rows, 1):
        for name, colour in zip(names, (BLUE, GREEN), strict=False):
            _line(figure, row, d.time, d.log[name], name, colour, width=1.2)
            for c in d.references(name):
                _line(figure, row, d.time, d.ref[c], c, ORANGE, width=1, dash="dot", visible="legendonly")
    return figure


def health_figure(d: Data) -> go.Figure:
    """Biases, evidence, effective size, status; the noise found where it is not what the settings say."""
    titles = ["Accelerometer biases [m/s2]", "Gyro bias [rad/s]", "Log evidence per row [nat]", "Effective particles", "Status"]
    noise = d.est[[f"noise_{channel}" for channel in MEASURES]]
    noisy = bool((noise > QUIET).any(axis=None))
    figure = _figure(5 + noisy, titles + ["Noise found, over the settings'"] * noisy, 150)
    for row, names in ((1, ("bias_accel_x", "bias_accel_y")), (2, ("bias_yaw_rate",))):
        for name, colour, band in zip(names, (BLUE, GREEN), (BAND, "rgba(26,127,90,0.2)"), strict=False):
            mean, sd = d.est[name].to_numpy(), d.est[f"{name}_sd"].to_numpy()
            _band(figure, row, d.time, mean - 1.96 * sd, mean + 1.96 * sd, f"{name} 95 %", band, False)
            _line(figure, row, d.time, mean, name, colour)
    evidence = d.est["log_evidence"].to_numpy()
    _line(figure, 3, d.time, evidence, "log_evidence", PURPLE, False, width=1)
    if np.isfinite(evidence).any():
        low, high = np.nanquantile(evidence, [0.005, 0.999])
        figure.update_yaxes(
            range=[float(low - 0.1 * (high - low) - 1), float(high + 0.1 * (high - low) + 1)], row=3, col=1
        )
    _line(figure, 4, d.time, d.est["n_eff"], "n_eff", BLUE, False, width=1)
    texts = {code: f.text for code, f in library().codes(STATUS).items()}
    status = d.est["status"].to_numpy()
    _line(figure, 5, d.time, status, "status", INK, False, text=[texts.get(int(s), "") for s in status],
          hovertemplate="%{y}: %{text}", line_shape="hv")  # fmt: skip
    figure.update_yaxes(rangemode="tozero", dtick=1, row=5, col=1)
    for name, colour in zip(noise if noisy else (), (BLUE, GREEN, PURPLE), strict=False):
        _line(figure, 6, d.time, noise[name], name, colour, width=1.2)
    return figure


def others_figure(d: Data) -> go.Figure | None:
    """Reference columns that belong to no quantity of the estimator."""
    names = [c for c in d.ref if match_reference(c) is None]
    if not names:
        return None
    figure = _figure(len(names), names, 130)
    for row, name in enumerate(names, 1):
        _line(figure, row, d.time, d.ref[name], name, ORANGE, False, width=1.2)
    return figure
