"""Draw the interactive figures of the report, one function for each section.

The figures are dictionaries in the format of plotly.js. plotly's Python classes are not
used, because they check every number of every line, which takes a hundred times as
long."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tse.estimation.estimate import BLOCK, Block
from tse.estimation.regimes import REGIMES, Change, Spell, estimate_times
from tse.estimation.verdict import NAMES, UNITS
from tse.library.core import GRIP, NOMINAL, STATUS, STIFFNESS, Config, library
from tse.library.errors import UserError
from tse.library.files import write_atomically
from tse.log.rows import MEASURES, CheckedLog

INK, BLUE, ORANGE, GREEN, PURPLE, GREY = "#1f2933", "#0b5fa5", "#c4570a", "#1a7f5a", "#7b4fa3", "#8a94a0"
BAND_FILL, SPREAD_FILL, SHADE_FILL = "rgba(11,95,165,0.28)", "rgba(11,95,165,0.10)", "rgba(90,100,110,0.13)"
# Number of rows of a column of the log that one call of thin_rows() thins. As a power of
# two, it is a multiple of the number of rows that thin_rows() replaces by two values
THIN_ROWS = 1 << 18
MAX_POINTS = 8000  # max number of points of a line; the lines of longer logs are thinned
# The noise ratio of a channel is its estimated noise sd / its noise sd in the settings.
# The noise ratios are drawn only if at least one of them exceeds this limit. The limit is
# above 1, because quick steering and quick changes of torque raise the estimated noise sd
# even if the setting is correct.
MAX_NOISE_RATIO = 1.4
NOISE_SETTLING_TIME = 2.0  # [s] the estimate of the noise is not usable before this time
CHANNEL_UNITS = {"accel_x": "m/s2", "accel_y": "m/s2", "yaw_rate": "rad/s"}
REGIME_COLOURS = {
    "p_steady": "#dfe4e9",
    "p_changed": BLUE,
    "p_axle": PURPLE,
    "p_fault": "#b3261e",
    "p_sliding": ORANGE,
    "p_restarted": INK,
}
# Max number of labels in a plot. Labels first name the detected changes of the stiffness
# (new road surface or tyres), the most probable ones first. The remaining labels name the
# longest intervals in which a sensor was at fault or the wheels slid. A change without a
# label is still marked by a line
MAX_LABELS = 16
# Max number of shaded intervals in a plot. If there are more, the shortest gaps between
# neighbouring intervals are shaded as well, until this number of intervals is left.
MAX_SHADES = 150


# Layout that all figures have in common
LOOKS = {
    "font": {"family": "system-ui, sans-serif", "size": 13, "color": INK},
    "paper_bgcolor": "white",
    "plot_bgcolor": "white",
    "legend": {
        "orientation": "h",
        "y": 0.995,
        "yanchor": "top",
        "x": 0,
        "xanchor": "left",
        "yref": "container",
    },
}
AXIS = {"gridcolor": "#edf0f3", "zeroline": False, "linecolor": "#c8ced4"}


def set_layout(figure: Any, height: int, **more: object) -> Any:
    """Apply the layout that all figures have in common (LOOKS, AXIS) to a plotly figure,
    and return the figure. `height`: [px]. `more`: further entries of plotly's layout."""
    figure.update_layout(height=height, margin={"l": 66, "r": 18, "t": 64, "b": 48}, **LOOKS)
    figure.update_layout(**more)
    axis = {**AXIS, "showgrid": True, "title_font_size": 13}
    figure.update_xaxes(**axis, ticks="outside", tickcolor="#c8ced4")
    figure.update_yaxes(**axis, title_standoff=6)
    for note in figure.layout.annotations:
        note.update(font={"size": 13, "color": INK})
    return figure


def draw_lines(rows: Sequence[tuple[str, Sequence[tuple[str, Any, Any]]]]) -> Any:
    """Return a figure with plots below each other. `rows` has for each plot its title and
    its lines. Each line is a tuple of name, times and values."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    figure = make_subplots(len(rows), 1, shared_xaxes=True, subplot_titles=[title for title, _ in rows])
    for row, (_, drawn_lines) in enumerate(rows, 1):
        for name, x, y in drawn_lines:
            figure.add_trace(go.Scattergl(x=x, y=y, name=name, mode="lines"), row=row, col=1)
    figure.update_xaxes(title="time [s]", row=len(rows), col=1)
    return figure.update_layout(height=180 * len(rows) + 80)


STYLE = {
    "font.size": 11,
    "font.family": "DejaVu Sans",
    "axes.edgecolor": "#c8ced4",
    "axes.linewidth": 0.8,
    "text.color": INK,
    "axes.labelcolor": INK,
    "xtick.color": "#52606d",
    "ytick.color": "#52606d",
}


@contextmanager
def open_picture(path: Path, style: Mapping[str, Any] = STYLE) -> Iterator[Any]:
    """Yield matplotlib's pyplot. At the end of the with block, write the figure that was
    drawn in it to a PNG file."""
    try:
        import matplotlib
    except ImportError:
        raise UserError("the picture needs matplotlib: pip install 'tse[figures]'") from None
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with plt.rc_context(style):
        yield plt
        with write_atomically(path, "wb") as file:
            plt.savefig(file, format="png", metadata={"Software": None})
        plt.close()


# A reference column (name ref_...) has the values of a more accurate sensor or of the
# simulator. No filter uses it: it is drawn beside the estimate of its quantity. Its name
# is ref_<quantity>, or one of this table (name -> quantity). Wheel speeds have ref_wheel_
# or ref_wheel_speed_ with f (front) or r (rear). A suffix can follow, as in ref_speed_2.
ALIASES = {"ref_vehicle_speed": "vel_x", "ref_speed": "vel_x", "ref_beta": "sideslip"}


def match_reference(column: str) -> str | None:
    """Return the quantity in whose plot a reference column (name ref_...) is drawn.
    Return None if the name of the column matches no quantity."""
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


def thin_rows(y: np.ndarray, stride: int) -> np.ndarray:
    """Thin lines such that peaks are kept: for each block of `stride` consecutive values,
    return its min and its max, in the order in which they occur. `y` is a line, or a
    matrix with a line in each row."""
    if stride == 1:
        return y
    missing = np.full((*y.shape[:-1], -y.shape[-1] % stride), np.nan)
    buckets = np.concatenate([y, missing], axis=-1).reshape(*y.shape[:-1], -1, stride)
    low, high = np.fmin.reduce(buckets, axis=-1), np.fmax.reduce(buckets, axis=-1)
    nan = np.isnan(buckets)
    falls = np.where(nan, -np.inf, buckets).argmax(axis=-1) < np.where(nan, np.inf, buckets).argmin(axis=-1)
    return np.stack([np.where(falls, high, low), np.where(falls, low, high)], axis=-1).reshape(
        *y.shape[:-1], -1
    )


def pick_rows(rows: int, stride: int) -> np.ndarray:
    """Return the indices of the rows whose times belong to the values of thin_rows().

    thin_rows() returns two values for each block of `stride` rows. The first value is
    drawn at the time of the first row of the block, the second at the time of the middle
    row. So the drawn points are evenly spaced. A value is displaced by less than the
    length of a block."""
    if stride == 1:
        return np.arange(rows)
    first = np.arange(0, rows, stride)
    return np.minimum(np.stack([first, first + stride // 2], axis=1).ravel(), rows - 1)


def find_stride(rows: int, points: int) -> int:
    """Return the `stride` with which thin_rows() thins a line of `rows` values to about
    `points` values."""
    return 1 if rows <= points else -(-2 * rows // points)


def thin_line(time: np.ndarray, y: np.ndarray, points: int, hole: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values of a line, thinned to about `points` points such that peaks
    are kept.

    If the time between two values is longer than `hole` [s], a NaN interrupts the line
    there."""
    stride = find_stride(len(y), points)
    xs, ys = [], []
    for part in np.split(np.arange(len(y)), 1 + np.flatnonzero(np.diff(time) > hole)):
        if xs:
            xs.append(time[part[:1]])
            ys.append(np.array([np.nan]))
        xs.append(time[part][pick_rows(len(part), stride)] if len(part) else time[part])
        ys.append(thin_rows(y[part], stride))
    return np.concatenate(xs), np.concatenate(ys)


def find_min_rows(y: np.ndarray, stride: int) -> np.ndarray:
    """Return for each block of `stride` rows the index of the row with the min of `y`,
    twice.

    The probabilities of all regimes are drawn at these rows, so that their sum is 1. `y`
    is the probability of the regime "steady". It is low during an event, so even a short
    event is drawn. Each index is returned twice, because thin_rows() gives two values for
    each block.
    """
    if stride == 1:
        return np.arange(len(y))
    rest = np.full(-len(y) % stride, np.inf)
    buckets = np.concatenate([np.nan_to_num(y, nan=np.inf), rest]).reshape(-1, stride)
    return np.repeat(buckets.argmin(axis=1) + stride * np.arange(len(buckets)), 2)


def find_block_stride(rows: int) -> int:
    """Return the stride of thin_rows() for a log with this number of rows: a power of two
    that divides BLOCK, the number of rows of a block of estimates."""
    return 1 if rows <= MAX_POINTS else min(BLOCK, 1 << int(np.ceil(np.log2(2 * rows / MAX_POINTS))))


class Data:
    """The lines of the figures, thinned to the resolution of a screen.

    A run adds its estimates block by block. `stride` rows are thinned to two values. So
    every block, except the last one, must have a multiple of `stride` rows."""

    def __init__(self, log: CheckedLog):
        self.stride = find_block_stride(len(log))
        self.rows = 0
        self._log = log
        self._lines: dict[str, list[np.ndarray]] = {}
        self._hover: dict[str, list[str]] = {key: [] for key in STIFFNESS}

    def add(self, block: Block | pd.DataFrame) -> None:
        """Thin a block of estimates, and append it to the lines. A block has the columns
        of EST.csv, the table of the estimates of a run."""
        columns = {name: np.asarray(column) for name, column in block.items() if not name.endswith("_reason")}
        count = len(columns["time"])
        at = pick_rows(count, self.stride)
        lines = compute_drawn_lines(columns)
        for name, y in zip(
            lines, thin_rows(np.array(list(lines.values())), self.stride).astype(np.float32), strict=True
        ):
            self._lines.setdefault(name, []).append(y)
        if all(p in columns for p in REGIMES):
            unusual = find_min_rows(columns["p_steady"], self.stride)
            for p in REGIMES:
                self._lines.setdefault(p, []).append(columns[p][unusual].astype(np.float32))
        for key in STIFFNESS:
            band = zip(
                columns[key][at] / 1000,
                1.96 * columns[f"{key}_sd"][at] / 1000,
                getattr(block[f"{key}_reason"], "array", block[f"{key}_reason"])[at],
                strict=True,
            )
            self._hover[key] += [f"{m:.1f} ± {s:.1f} {UNITS[key]}, {r}" for m, s, r in band]
        self.rows += count

    @property
    def logged_time(self) -> np.ndarray:
        """[s] Times at which the thinned columns of the log are drawn: the times of the
        rows that pick_rows() returns."""
        return self._log.time[pick_rows(self.rows, self.stride)]

    @property
    def time(self) -> np.ndarray:
        """[s] Times to which the estimates refer. If the filter waits for channels with a
        latency, the estimate in a row refers to a time before the time of the row."""
        time = self.logged_time
        age = np.nan_to_num(self.line("estimate_age")) if "estimate_age" in self else np.zeros(0)
        return time - age if np.any(age > 0) else time

    def line(self, name: str) -> np.ndarray:
        """Return the thinned values of a line. `name`: a name that compute_drawn_lines()
        returns, or the probability of a regime (REGIMES)."""
        return np.concatenate(self._lines[name])

    def __contains__(self, name: str) -> bool:
        return name in self._lines

    def hover(self, key: str) -> list[str]:
        """Return a text for each point of the line of a stiffness. It is shown when the
        mouse is over the point."""
        return self._hover[key]

    def logged(self, name: str) -> np.ndarray:
        """Return the thinned values of a column of the log: a channel that the filter
        uses, or a reference column (name ref_...)."""
        column = self._log.data[name] if name in self._log.data else self._log.ref[name]
        y = column.to_numpy()[: self.rows]
        return np.concatenate(
            [thin_rows(y[i : i + THIN_ROWS], self.stride) for i in range(0, max(len(y), 1), THIN_ROWS)]
        )

    def references(self, quantity: str | None) -> list[str]:
        """Return the names of the reference columns (ref_...) of a quantity. If
        `quantity` is None, return the reference columns that match no quantity."""
        return [c for c in self._log.ref if match_reference(c) == quantity]


# Column -> factor from its unit in EST.csv to its unit in the plots
FACTOR = {**dict.fromkeys(STIFFNESS, 1e-3), "sideslip": 180 / np.pi}
# Columns that are drawn with their 95 % interval
WITH_BAND = (
    *STIFFNESS,
    "vel_x",
    "vel_y",
    "yaw_rate",
    "sideslip",
    GRIP,
    "bias_accel_x",
    "bias_accel_y",
    "bias_yaw_rate",
)
# Columns that not every EST.csv has. If present, they are drawn without an interval
OPTIONAL = (*(f"discrepancy_{c}" for c in MEASURES), "lag_steer", "estimate_age")
# Columns of every EST.csv that are drawn without an interval
PLAIN = ("log_evidence", "n_eff", "status", *(f"{what}_{c}" for what in ("nis", "noise") for c in MEASURES))


def compute_drawn_lines(block: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the lines that are drawn from a block of EST.csv, as name -> values in the
    units of the plots.

    For a column x with an interval, the lines x_low and x_high are the ends of the 95 %
    interval. For a stiffness x, the line x_valid has the valid values, and x_other has
    the values that are not valid. x_spread_low is x - 1.96 * spread, and x_spread_high is
    x + 1.96 * spread. The spread (column x_spread of EST.csv) is the sd with which the
    stiffness in single samples scatters about its mean x."""
    lines = {}
    for name in (*WITH_BAND, *PLAIN, *(n for n in OPTIONAL if n in block)):
        lines[name] = block[name] * FACTOR.get(name, 1.0)
    for name in WITH_BAND:
        half = 1.96 * FACTOR.get(name, 1.0) * block[f"{name}_sd"]
        lines[f"{name}_low"], lines[f"{name}_high"] = lines[name] - half, lines[name] + half
    for key in STIFFNESS:
        half, valid = 1.96 * FACTOR[key] * block[f"{key}_spread"], block[f"{key}_valid"] == 1
        lines[f"{key}_spread_low"], lines[f"{key}_spread_high"] = lines[key] - half, lines[key] + half
        lines[f"{key}_valid"] = np.where(valid, lines[key], np.nan)
        lines[f"{key}_other"] = np.where(valid, np.nan, lines[key])
    return lines


class Figure:
    """A figure of plots below each other with a common time axis. `heights` has the
    height [px] of each plot."""

    def __init__(self, titles: Sequence[str], heights: Sequence[float]):
        self.height = sum(heights) + 70
        self.data: list[dict[str, Any]] = []
        rows, total = len(titles), sum(heights)
        gap = 0.11 / rows + 0.012
        axis = {**AXIS, "automargin": True}
        self.layout: dict[str, Any] = {
            "height": self.height,
            "margin": {"l": 62, "r": 18, "t": 70, "b": 40},
            **LOOKS,
            "hovermode": "x unified",
            "annotations": [],
            "shapes": [],
        }
        top = 1.0
        for row, (title, height) in enumerate(zip(titles, heights, strict=True), 1):
            bottom = max(0.0, top - height / total * (1 - gap * (rows - 1)))
            last = row == rows
            self.layout[f"xaxis{self.axis(row)}"] = {
                **axis,
                "anchor": f"y{self.axis(row)}",
                "domain": [0.0, 1.0],
                "ticks": "outside",
                "tickcolor": "#c8ced4",
                **(
                    {"title": {"text": "time [s]"}}
                    if last
                    else {"matches": f"x{self.axis(rows)}", "showticklabels": False}
                ),
            }
            self.layout[f"yaxis{self.axis(row)}"] = {
                **axis,
                "anchor": f"x{self.axis(row)}",
                "domain": [bottom, top],
                "title": {"standoff": 6},
            }
            self.layout["annotations"].append(
                {
                    "text": title,
                    "x": 0,
                    "xanchor": "left",
                    "xref": "paper",
                    "y": top,
                    "yanchor": "bottom",
                    "yref": "paper",
                    "showarrow": False,
                    "font": {"size": 14, "color": INK},
                }
            )
            top = bottom - gap

    @staticmethod
    def axis(row: int) -> str:
        """Return the suffix that the axes of plot number `row` have in plotly, which
        names the axes x, x2, x3 ..."""
        return "" if row == 1 else str(row)

    def y_axis(self, row: int) -> dict[str, Any]:
        return self.layout[f"yaxis{self.axis(row)}"]

    def add(self, row: int, **trace: Any) -> None:
        self.data.append(
            {"type": "scatter", "xaxis": f"x{self.axis(row)}", "yaxis": f"y{self.axis(row)}", **trace}
        )

    def as_dict(self) -> dict[str, Any]:
        return {"data": self.data, "layout": self.layout}


def _draw_line(
    figure: Figure, row: int, x: np.ndarray, y: Any, name: str, colour: str, legend: bool = True, **more: Any
) -> None:
    line = {"color": colour, "width": more.pop("width", 1.5)}
    for key, known in (("dash", "dash"), ("line_shape", "shape")):
        if key in more:
            line[known] = more.pop(key)
    figure.add(
        row,
        x=x,
        y=np.asarray(y, np.float32),
        name=name,
        line=line,
        mode="lines",
        legendgroup=name,
        showlegend=legend,
        connectgaps=False,
        **more,
    )


def _draw_band(
    figure: Figure,
    row: int,
    x: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    name: str,
    colour: str,
    legend: bool,
) -> None:
    for y, fill in ((low, "none"), (high, "tonexty")):
        figure.add(
            row,
            x=x,
            y=y,
            name=name,
            mode="lines",
            line={"width": 0, "color": colour},
            fill=fill,
            fillcolor=colour,
            hoverinfo="skip",
            legendgroup=name,
            showlegend=fill != "none" and legend,
        )


def shade_intervals(figure: Figure, row: int, time: np.ndarray, where: np.ndarray) -> None:
    """Shade the intervals in which `where` is True. If there are more than MAX_SHADES
    intervals, first join those with the shortest gaps between them."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(int), [0]])))
    starts, ends = edges[::2], edges[1::2]
    if len(starts) > MAX_SHADES:
        gaps = starts[1:] - ends[:-1]
        keep = np.sort(np.argsort(gaps)[::-1][: MAX_SHADES - 1])
        starts, ends = (
            np.concatenate([starts[:1], starts[1:][keep]]),
            np.concatenate([ends[:-1][keep], ends[-1:]]),
        )
    axis = figure.axis(row)
    figure.layout["shapes"] += [
        {
            "type": "rect",
            "xref": f"x{axis}",
            "yref": f"y{axis} domain",
            "x0": float(time[a]),
            "x1": float(time[min(b, len(time) - 1)]),
            "y0": 0,
            "y1": 1,
            "fillcolor": SHADE_FILL,
            "line": {"width": 0},
            "layer": "below",
        }
        for a, b in zip(starts, ends, strict=True)
    ]


def draw_stiffness(
    d: Data, table: pd.DataFrame, config: Config, changes: Sequence[Change] = (), spells: Sequence[Spell] = ()
) -> Figure:
    """Return the figure of the stiffnesses: means and their 95 % intervals.

    The particle filter also estimates the spread of a stiffness: the sd with which the
    stiffness scatters about its mean from row to row. For this filter, the interval
    mean +- 1.96 spread is drawn as well.

    Means that are not valid are grey. When the mouse is over a point, its value and the
    reason why it is not valid are shown.

    If the estimates have probabilities of the regimes (steady, changed, fault ...), they
    are drawn in a plot below the stiffnesses. `table`: estimates, with the columns
    SUMMARY of estimate.py; of a long log only every n-th row."""
    regimes = "p_steady" in d
    titles = [f"{NAMES[s]} [{UNITS[s]}]" for s in STIFFNESS] + ["What happened: probability"] * regimes
    figure = Figure(titles, [230] * 3 + [130] * regimes)
    time = estimate_times(table)
    for row, key in enumerate(STIFFNESS, 1):
        first = row == 1
        nominal = getattr(config, NOMINAL[key]) / 1000
        for part, name, colour in (
            ("spread_", "spread, 95 % of samples", SPREAD_FILL),
            ("", "95 % interval", BAND_FILL),
        ):
            if part and not config.form:
                continue
            _draw_band(
                figure,
                row,
                d.time,
                d.line(f"{key}_{part}low"),
                d.line(f"{key}_{part}high"),
                name,
                colour,
                first,
            )
        _draw_line(figure, row, d.time, d.line(f"{key}_other"), "not valid", GREY, first, hoverinfo="skip")
        _draw_line(
            figure,
            row,
            d.time,
            d.line(f"{key}_valid"),
            "mean, valid",
            BLUE,
            first,
            width=2.2,
            hoverinfo="skip",
        )
        text = d.hover(key)
        _draw_line(
            figure,
            row,
            d.time,
            d.line(key),
            "estimate",
            "rgba(0,0,0,0)",
            False,
            text=text,
            hovertemplate="%{text}",
        )
        ends, level = d.time[[0, -1]], [nominal, nominal]
        _draw_line(figure, row, ends, level, "nominal", GREY, first, dash="dot", width=1, hoverinfo="skip")
        for i, c in enumerate(d.references(key)):
            y = d.logged(c) / 1000
            _draw_line(
                figure, row, d.logged_time, y, "reference", ORANGE, first and i == 0, width=1.8, dash="dash"
            )
        shade_intervals(figure, row, time, table[f"{key}_valid"].to_numpy() != 1)
        mean = table[key].to_numpy() / 1000
        top = (
            np.nanmax([1.5 * nominal, 1.25 * np.nanquantile(mean, 0.99)])
            if np.isfinite(mean).any()
            else 2 * nominal
        )
        figure.y_axis(row)["range"] = [0, float(min(top, 6 * nominal))]
    if regimes:
        _draw_regimes(figure, len(STIFFNESS) + 1, d)
    mark_events(figure, len(titles), changes, spells)
    return figure


def _draw_regimes(figure: Figure, row: int, d: Data) -> None:
    """Draw the probabilities of the regimes as stacked areas, whose sum is 1."""
    for name, title in REGIMES.items():
        figure.add(
            row,
            x=d.time,
            y=d.line(name),
            name=title,
            mode="lines",
            stackgroup="regimes",
            fillcolor=REGIME_COLOURS[name],
            line={"width": 0, "color": REGIME_COLOURS[name], "shape": "hv"},
            legendgroup=name,
            showlegend=name != "p_steady",
            hovertemplate="%{y:.0%}",
        )
    figure.y_axis(row).update(range=[0, 1], tickformat=".0%", dtick=0.5)


def mark_events(figure: Figure, row: int, changes: Sequence[Change], spells: Sequence[Spell]) -> None:
    """Draw a vertical line through all plots at the time of each change of the stiffness.

    In the plot with the number `row`, label the most probable changes, at most
    MAX_LABELS. If there are fewer changes, use the remaining labels for the longest of
    `spells`, the intervals in which a sensor was at fault or the wheels slid."""
    figure.layout["shapes"] += [
        {
            "type": "line",
            "xref": "x",
            "yref": "paper",
            "x0": c.time,
            "x1": c.time,
            "y0": 0,
            "y1": 1,
            "line": {"color": INK, "width": 1, "dash": "dot"},
        }
        for c in changes
    ]
    longest = sorted(spells, key=lambda s: s.start - s.end)[: max(0, MAX_LABELS - len(changes))]
    likeliest = sorted(changes, key=lambda c: -c.probability)[:MAX_LABELS]
    labels = sorted([(c.time, c.label) for c in likeliest] + [(s.start, s.label) for s in longest])
    axis = figure.axis(row)
    figure.layout["annotations"] += [
        {
            "text": text,
            "x": time,
            "xref": f"x{axis}",
            "xanchor": "left",
            "y": 0.95 - 0.3 * (i % 3),
            "yref": f"y{axis} domain",
            "yanchor": "top",
            "showarrow": False,
            "font": {"size": 12, "color": INK},
            "bgcolor": "rgba(255,255,255,0.8)",
        }
        for i, (time, text) in enumerate(labels)
    ]


def draw_states(d: Data, grip: bool = False) -> Figure:
    """Return the figure of the states: estimates with 95 % intervals, reference columns,
    and the measured yaw rate. If `grip` is True, add a plot of the estimated friction
    coefficient (column GRIP)."""
    rows = [
        ("vel_x", "Longitudinal velocity [m/s]"),
        ("vel_y", "Lateral velocity [m/s]"),
        ("yaw_rate", "Yaw rate [rad/s]"),
        ("sideslip", "Sideslip angle [deg]"),
    ]
    if grip:
        rows.append((GRIP, "Grip [1]"))
    figure = Figure([title for _, title in rows], [180] * len(rows))
    for row, (key, _title) in enumerate(rows, 1):
        first = row == 1
        if key == "yaw_rate":
            _draw_line(figure, row, d.logged_time, d.logged("yaw_rate"), "measured", GREY, True, width=1)
        _draw_band(
            figure,
            row,
            d.time,
            d.line(f"{key}_low"),
            d.line(f"{key}_high"),
            "95 % interval",
            BAND_FILL,
            first,
        )
        _draw_line(figure, row, d.time, d.line(key), "estimate", BLUE, first, width=2)
        for c in d.references(key):
            _draw_line(
                figure,
                row,
                d.logged_time,
                d.logged(c) * FACTOR.get(key, 1.0),
                c,
                ORANGE,
                True,
                dash="dash",
                width=1.4,
            )
    return figure


def draw_inputs(d: Data) -> Figure:
    """Return the figure of the logged steering angle, wheel speeds and accelerations.
    draw_states() draws the logged yaw rate."""
    rows = [
        ("Steering angle [rad]", ["steer_angle"]),
        ("Wheel speeds [rad/s]", ["wheel_speed_front", "wheel_speed_rear"]),
        ("Specific force [m/s2]", ["accel_x", "accel_y"]),
    ]
    figure = Figure([title for title, _ in rows], [180] * len(rows))
    for row, (_, names) in enumerate(rows, 1):
        for name, colour in zip(names, (BLUE, GREEN), strict=False):
            _draw_line(figure, row, d.logged_time, d.logged(name), name, colour, width=1.2)
            for c in d.references(name):
                _draw_line(
                    figure,
                    row,
                    d.logged_time,
                    d.logged(c),
                    c,
                    ORANGE,
                    width=1,
                    dash="dot",
                    visible="legendonly",
                )
    return figure


NIS = tuple(f"nis_{channel}" for channel in MEASURES)
UNEXPLAINED = (
    ("Model discrepancy, sd [m/s2]", ("discrepancy_accel_x", "discrepancy_accel_y")),
    ("Model discrepancy of the yaw rate, sd [rad/s]", ("discrepancy_yaw_rate",)),
    ("Estimated lag of the steering angle [s]", ("lag_steer",)),
)


def draw_health(d: Data) -> Figure:
    """Return the figure that shows whether the filter works well: biases, log-likelihood,
    normalised innovations squared, and status. For a particle filter, the effective
    number of particles is drawn in place of the normalised innovations squared.

    The ratio of the estimated noise sd to the noise sd in the settings is drawn only if
    it exceeds MAX_NOISE_RATIO for at least one channel. The model discrepancy and the
    delay of the steering angle relative to the IMU are drawn only if the estimates have
    them."""
    particles = bool((d.line("n_eff") > 1).any())
    titles = [
        "Accelerometer biases [m/s2]",
        "Gyro bias [rad/s]",
        "Log-likelihood of each row [nat]",
        "Effective particles"
        if particles
        else "Normalised innovation squared. If its mean is far above 1, intervals are too narrow",
        "Status",
    ]
    noise = {name: d.line(name) for name in (f"noise_{channel}" for channel in MEASURES)}
    found = np.asarray(d.time) > d.time[0] + NOISE_SETTLING_TIME if len(d.time) else np.zeros(0, bool)
    noisy = any((x[found] > MAX_NOISE_RATIO).any() for x in noise.values())
    titles += ["Ratio of the estimated noise to the settings"] * noisy
    unexplained = [(title, names) for title, names in UNEXPLAINED if all(n in d for n in names)]
    titles += [title for title, _ in unexplained]
    figure = Figure(titles, [150] * len(titles))
    for row, names in ((1, ("bias_accel_x", "bias_accel_y")), (2, ("bias_yaw_rate",))):
        for name, colour, band in zip(names, (BLUE, GREEN), (BAND_FILL, "rgba(26,127,90,0.2)"), strict=False):
            _draw_band(
                figure,
                row,
                d.time,
                d.line(f"{name}_low"),
                d.line(f"{name}_high"),
                f"{name} 95 %",
                band,
                False,
            )
            _draw_line(figure, row, d.time, d.line(name), name, colour)
    evidence = d.line("log_evidence")
    _draw_line(figure, 3, d.time, evidence, "log_evidence", PURPLE, False, width=1)
    if np.isfinite(evidence).any():
        low, high = np.nanquantile(evidence, [0.005, 0.999])
        figure.y_axis(3)["range"] = [
            float(low - 0.1 * (high - low) - 1),
            float(high + 0.1 * (high - low) + 1),
        ]
    for name, colour in zip(("n_eff",) if particles else NIS, (BLUE, GREEN, PURPLE), strict=False):
        _draw_line(figure, 4, d.time, d.line(name), name, colour, False, width=1)
    texts = {code: f.text for code, f in library().codes(STATUS).items()}
    status = d.line("status")
    _draw_line(
        figure,
        5,
        d.time,
        status,
        "status",
        INK,
        False,
        text=[texts.get(int(s), "") for s in status],
        hovertemplate="%{y}: %{text}",
        line_shape="hv",
    )
    figure.y_axis(5).update(rangemode="tozero", dtick=1)
    for name, colour in zip(noise if noisy else (), (BLUE, GREEN, PURPLE), strict=False):
        _draw_line(figure, 6, d.time, noise[name], name, colour, width=1.2)
    for row, (_, names) in enumerate(unexplained, 6 + noisy):
        for name, colour in zip(names, (BLUE, GREEN), strict=False):
            _draw_line(figure, row, d.time, d.line(name), name, colour, width=1.2)
    return figure


def draw_other_references(d: Data) -> Figure | None:
    """Return the figure of the reference columns whose names match no quantity of the
    other figures (match_reference()). Return None if there is no such column."""
    names = d.references(None)
    if not names:
        return None
    figure = Figure(names, [130] * len(names))
    for row, name in enumerate(names, 1):
        _draw_line(figure, row, d.logged_time, d.logged(name), name, ORANGE, False, width=1.2)
    return figure
