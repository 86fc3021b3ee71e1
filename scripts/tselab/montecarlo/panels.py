"""Pictures as data, drawn twice: by matplotlib for paper, by plotly for the report."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tselab.files import atomic
from tselab.plots import BLUE, GREEN, GREY, INK, ORANGE, PURPLE

if TYPE_CHECKING:
    import plotly.graph_objects as go

COLOURS = (BLUE, ORANGE, GREEN, PURPLE, "#b8860b", "#5a9bd4", "#8b1a4a", "#3d5a3d")
GAP = 85  # px between rows: title of one, labels of the other
GRID, EDGE = "#edf0f3", "#c8ced4"


@dataclass
class Line:
    x: np.ndarray
    y: np.ndarray
    name: str = ""
    colour: str = BLUE
    dash: bool = False
    width: float = 1.6


@dataclass
class Dots:
    """Values with intervals, along x, at the categories of the panel."""

    at: np.ndarray
    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    name: str = ""
    colour: str = BLUE


@dataclass
class Bars:
    """A histogram."""

    edges: np.ndarray
    height: np.ndarray
    name: str = ""
    colour: str = BLUE


@dataclass
class Panel:
    """One set of axes."""

    title: str
    x: str = ""
    y: str = ""
    marks: list = field(default_factory=list)  # Line, Dots, Bars
    categories: tuple[str, ...] = ()  # names along y, from the top
    at: tuple[float, ...] = ()  # vertical lines
    log_x: bool = False
    y_range: tuple[float, float] | None = None


@dataclass
class Picture:
    """Panels in rows of `columns`."""

    panels: list[Panel]
    columns: int = 1
    height: int = 250  # px of a row

    @property
    def rows(self) -> int:
        return -(-len(self.panels) // self.columns)


def _rgba(colour: str, strength: float) -> str:
    r, g, b = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({r},{g},{b},{strength:g})"


# ---- paper


def draw_png(picture: Picture, path: Path) -> bool:
    """Write the picture; False without matplotlib."""
    try:
        import matplotlib
    except ImportError:
        return False
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    style = {"font.size": 10, "font.family": "DejaVu Sans", "axes.edgecolor": EDGE, "text.color": INK, "axes.labelcolor": INK,
             "xtick.color": "#52606d", "ytick.color": "#52606d"}  # fmt: skip
    with plt.rc_context(style):
        size = (max(8.0, 3.6 * picture.columns), picture.rows * picture.height / 90 + 0.6)
        figure, axes = plt.subplots(
            picture.rows, picture.columns, figsize=size, dpi=130, layout="constrained", squeeze=False
        )
        handles: dict[str, object] = {}
        for axis, panel in zip(axes.flat, picture.panels, strict=False):
            _panel_png(axis, panel, handles)
        for axis in axes.flat[len(picture.panels) :]:
            axis.set_visible(False)
        for row in axes:
            for axis, panel in zip(row[1:], picture.panels, strict=False):
                if panel.categories and picture.rows == 1:  # the names stand at the first column
                    axis.set_yticklabels([])
        if handles:
            letters = max(map(len, handles)) + 8
            fits = max(1, min(len(handles), int(14 * size[0] / letters)))
            figure.legend(handles.values(), handles.keys(), loc="outside upper right", ncols=fits, frameon=False)
        with atomic(path, "wb") as file:
            figure.savefig(file, format="png", metadata={"Software": None})
        plt.close(figure)
    return True


def _panel_png(axis: object, panel: Panel, handles: dict[str, object]) -> None:
    for m in panel.marks:
        if isinstance(m, Line):
            drawn = axis.plot(m.x, m.y, color=m.colour, lw=m.width, ls=(0, (5, 2)) if m.dash else "-")[0]
        elif isinstance(m, Bars):
            drawn = axis.bar(m.edges[:-1], m.height, np.diff(m.edges), align="edge", color=m.colour, alpha=0.55,
                             edgecolor="white")  # fmt: skip
        else:
            error = np.abs(np.stack([m.value - m.low, m.high - m.value]))
            error = np.where(np.isfinite(error), error, 0.0)
            drawn = axis.errorbar(m.value, m.at, xerr=error, color=m.colour, fmt="o", ms=4, lw=1.2)
        if m.name:
            handles.setdefault(m.name, drawn)
    for x in panel.at:
        axis.axvline(x, color=GREY, lw=0.9)
    if panel.categories:
        axis.set_yticks(range(len(panel.categories)), panel.categories)
        axis.set_ylim(len(panel.categories) - 0.5, -0.5)
    elif panel.y_range:
        axis.set_ylim(*panel.y_range)
    if panel.log_x:
        axis.set_xscale("log")
    axis.set_title(panel.title, loc="left", fontsize=10, fontweight="bold", pad=4)
    axis.set_xlabel(panel.x)
    axis.set_ylabel(panel.y)
    axis.grid(color=GRID, lw=0.8)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)


# ---- screen


def draw_plotly(picture: Picture) -> go.Figure:
    """The same, interactive."""
    from plotly.subplots import make_subplots

    names = bool(picture.panels and picture.panels[0].categories and picture.rows == 1)
    figure = make_subplots(
        rows=picture.rows,
        cols=picture.columns,
        subplot_titles=[p.title for p in picture.panels],
        shared_yaxes=names,
        vertical_spacing=GAP / (picture.rows * picture.height),
        horizontal_spacing=0.03 if names else 0.3 / (picture.columns + 3),
    )
    shown: set[str] = set()
    for i, panel in enumerate(picture.panels):
        row, col = i // picture.columns + 1, i % picture.columns + 1
        for m in panel.marks:
            for trace in _traces(m):
                legend = trace.pop("legend", True) and bool(m.name) and m.name not in shown
                shown |= {m.name} if legend else set()
                figure.add_trace(
                    trace | {"showlegend": legend, "legendgroup": m.name, "name": m.name}, row=row, col=col
                )
        for x in panel.at:
            figure.add_vline(x, row=row, col=col, line={"color": GREY, "width": 1})
        figure.update_xaxes(title_text=panel.x, type="log" if panel.log_x else None, row=row, col=col)
        figure.update_yaxes(title_text=panel.y, row=row, col=col)
        if panel.categories:
            ticks = {"tickvals": list(range(len(panel.categories))), "ticktext": list(panel.categories)}
            figure.update_yaxes(**ticks, range=[len(panel.categories) - 0.5, -0.5], automargin=True, row=row, col=col)
        elif panel.y_range:
            figure.update_yaxes(range=list(panel.y_range), row=row, col=col)
    figure.update_layout(
        height=picture.rows * picture.height + 110, margin={"l": 70, "r": 18, "t": 80, "b": 50}, paper_bgcolor="white",
        plot_bgcolor="white", font={"family": "system-ui, sans-serif", "size": 13, "color": INK}, barmode="overlay",
        legend={"orientation": "h", "yref": "container", "y": 0.995, "yanchor": "top", "x": 0, "xanchor": "left"},
    )  # fmt: skip
    figure.update_xaxes(gridcolor=GRID, zeroline=False, linecolor=EDGE)
    figure.update_yaxes(gridcolor=GRID, zeroline=False, linecolor=EDGE, title_standoff=6)
    for note in figure.layout.annotations:
        note.update(font={"size": 13, "color": INK})
    return figure


def _traces(m: Line | Dots | Bars) -> list[dict]:
    def single(y: np.ndarray) -> np.ndarray:
        return np.asarray(y, np.float32)

    if isinstance(m, Line):
        line = {"color": m.colour, "width": m.width, **({"dash": "dash"} if m.dash else {})}
        return [{"type": "scatter", "x": m.x, "y": single(m.y), "mode": "lines", "line": line}]
    if isinstance(m, Bars):
        middle = (m.edges[:-1] + m.edges[1:]) / 2
        look = {"color": _rgba(m.colour, 0.55), "line": {"color": "white", "width": 1}}
        return [{"type": "bar", "x": middle, "y": m.height, "width": np.diff(m.edges), "marker": look}]
    error = {"type": "data", "symmetric": False, "array": np.nan_to_num(m.high - m.value),
             "arrayminus": np.nan_to_num(m.value - m.low), "thickness": 1.2, "width": 2}  # fmt: skip
    dots = {"type": "scatter", "mode": "markers", "marker": {"color": m.colour, "size": 7}}
    return [dots | {"x": m.value, "y": m.at, "error_x": error}]
