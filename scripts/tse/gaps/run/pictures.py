"""Draw the figures of the gap report (plotly), one function for each section,
and gap.png (matplotlib).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from tse.gaps.fit import ChannelChange
from tse.report.plots import BLUE, CHANNEL_UNITS, GREY, INK, ORANGE, open_picture, set_layout, thin_line

SOURCE = {"measured": INK, "before": ORANGE, "after": BLUE}
MAX_GAP_POINTS = 3000  # max number of points of a line; longer lines are thinned, but keep their peaks
# [s] Max time between two points that a line connects. If the time is longer, the channel
# was not logged in between, and the line is interrupted.
HOLE = 1.0
# Max number of logs that can be chosen in the figure. If there are more logs, the figure
# has those with the largest residuals.
MAX_DRAWN_LOGS = 12
PICTURE_SECONDS = 8.0  # [s] length of the interval in gap.png


def _list_channels(table: pd.DataFrame) -> list[str]:
    return [c for c in table["channel"].cat.categories if (table["channel"] == c).any()]


def _list_logs(table: pd.DataFrame) -> list[tuple[str, str]]:
    """Return (part, name) of each log. If there are more than MAX_DRAWN_LOGS logs, return
    those with the largest residuals."""
    energy = table.assign(e=table["residual_before"] ** 2).groupby(["part", "log"], observed=True)["e"].mean()
    worst = energy.sort_values(ascending=False).head(MAX_DRAWN_LOGS).index
    return [key for key in energy.index if key in set(worst)]


def draw_overlay(table: pd.DataFrame) -> go.Figure:
    """Plot three lines for each channel: measured, simulated before, and simulated after
    effects were added. The reader chooses the log from a list.
    """
    channels, logs = _list_channels(table), _list_logs(table)
    figure = make_subplots(
        len(channels),
        1,
        shared_xaxes=True,
        vertical_spacing=0.05,
        subplot_titles=[f"{c} [{CHANNEL_UNITS[c]}]" for c in channels],
    )
    owner = []  # index of the log of each line
    for n, (part, log) in enumerate(logs):
        mine = table[(table["part"] == part) & (table["log"] == log)]
        for row, channel in enumerate(channels, 1):
            t = mine[mine["channel"] == channel].sort_values("time")
            for source, colour in SOURCE.items():
                y = t["measured" if source == "measured" else f"predicted_{source}"].to_numpy(np.float32)
                time, y = thin_line(t["time"].to_numpy(), y, MAX_GAP_POINTS, HOLE)
                figure.add_trace(
                    go.Scatter(
                        x=np.round(time, 3),
                        y=y,
                        name=source,
                        mode="lines",
                        legendgroup=source,
                        showlegend=row == 1,
                        visible=n == 0,
                        line={"color": colour, "width": 2.0 if source == "measured" else 1.3},
                        opacity=0.45 if source == "measured" else 1.0,
                        connectgaps=False,
                    ),
                    row=row,
                    col=1,
                )
                owner.append(n)
    buttons = [
        {
            "label": f"{log}{' (held out)' if part == 'held_out' else ''}",
            "method": "update",
            "args": [{"visible": [o == n for o in owner]}, {}],
        }
        for n, (part, log) in enumerate(logs)
    ]
    set_layout(figure, 210 * len(channels) + 90, hovermode="x unified")
    for note in figure.layout.annotations:
        note.update(x=0, xanchor="left")
    menu = {"x": 0, "xanchor": "left", "y": 1.0, "yanchor": "bottom", "pad": {"b": 24}, "bgcolor": "white"}
    figure.update_layout(margin_t=104, updatemenus=[menu | {"buttons": buttons}])
    figure.update_xaxes(title_text="time [s]", row=len(channels), col=1)
    return figure


def draw_gap_bars(parts: Mapping[str, Mapping[str, ChannelChange]]) -> go.Figure:
    """Plot the ratio of residual rms to sensor noise for each channel, before and after
    effects were added.

    The error bars show the 95 % interval of the relative change from before to after,
    from a bootstrap that uses the same blocks of residuals for both.
    """
    figure = make_subplots(
        1,
        len(parts),
        shared_yaxes=True,
        horizontal_spacing=0.06,
        subplot_titles=[_make_part_title(p) for p in parts],
    )
    for col, changes in enumerate(parts.values(), 1):
        names = list(changes)
        before = np.array([c.before for c in changes.values()])
        after = np.array([c.after for c in changes.values()])
        low = before * (1 + np.array([c.ci95[0] for c in changes.values()]))
        high = before * (1 + np.array([c.ci95[1] for c in changes.values()]))
        figure.add_trace(
            go.Bar(
                x=names,
                y=before,
                name="before",
                marker_color=ORANGE,
                legendgroup="before",
                showlegend=col == 1,
                texttemplate="%{y:.2f}",
            ),
            row=1,
            col=col,
        )
        figure.add_trace(
            go.Bar(
                x=names,
                y=after,
                name="after",
                marker_color=BLUE,
                legendgroup="after",
                showlegend=col == 1,
                texttemplate="%{y:.2f}",
                error_y={
                    "type": "data",
                    "symmetric": False,
                    "array": np.maximum(high - after, 0),
                    "arrayminus": np.maximum(after - low, 0),
                    "color": INK,
                    "thickness": 1.2,
                },
            ),
            row=1,
            col=col,
        )
        figure.add_hline(y=1.0, line={"color": GREY, "dash": "dash", "width": 1.2}, row=1, col=col)
    figure.update_yaxes(title_text="rms of residual / sensor noise", rangemode="tozero", row=1, col=1)
    return set_layout(figure, 360, barmode="group")


def _make_part_title(part: str) -> str:
    return {"fit": "fitted logs", "held_out": "held-out logs"}[part]


# ---- gap.png


def draw_picture(path: Path, table: pd.DataFrame, title: str) -> None:
    """Draw gap.png: the channel, log and interval in which adding the effects reduced the
    residuals most.
    """
    with open_picture(path) as plt:
        figure, (above, below) = plt.subplots(
            2, 1, figsize=(9, 5), dpi=120, layout="constrained", sharex=True, height_ratios=[2.1, 1]
        )
        moment, channel, where = find_best_moment(table)
        time = moment["time"]
        above.plot(
            time, moment["measured"], color=INK, lw=3.2, alpha=0.35, label="measured", solid_capstyle="round"
        )
        above.plot(time, moment["predicted_before"], color=ORANGE, lw=1.5, label="simulated before")
        above.plot(time, moment["predicted_after"], color=BLUE, lw=1.5, label="simulated after")
        above.set_title(f"{channel} in {where}", loc="left", fontsize=11, fontweight="bold")
        above.set_ylabel(CHANNEL_UNITS[channel])
        above.legend(frameon=False, ncols=3, loc="upper right", fontsize=9.5)
        low, high = above.get_ylim()
        above.set_ylim(low, high + 0.16 * (high - low))
        below.axhspan(-2, 2, color=GREY, alpha=0.15, lw=0)
        below.plot(time, moment["residual_before"], color=ORANGE, lw=1.1)
        below.plot(time, moment["residual_after"], color=BLUE, lw=1.1)
        below.set_ylabel("residual /\nnoise")
        below.set_xlabel("time [s]")
        for axis in (above, below):
            axis.grid(color="#edf0f3", lw=0.8)
            axis.set_axisbelow(True)
            axis.spines[["top", "right"]].set_visible(False)
        figure.suptitle(title, x=0.01, ha="left", fontsize=12.5, fontweight="bold")


def find_best_moment(table: pd.DataFrame) -> tuple[pd.DataFrame, str, str]:
    """Return the rows of one interval, its channel, and the name of its log. It is the
    interval in which the effects that were added reduced the sum of squared residuals
    most.

    If there are held-out logs, the interval is from one of them. If no residual changed,
    the interval with the largest residuals is returned.
    """
    t = table[table["part"] == "held_out"] if (table["part"] == "held_out").any() else table
    won = (t["residual_before"] ** 2 - t["residual_after"] ** 2).fillna(0.0)
    t = t.assign(won=won, window=np.floor(t["time"] / PICTURE_SECONDS))
    if not t["won"].abs().sum() > 0:
        t["won"] = t["residual_before"].fillna(0.0) ** 2
    channel, log, window = t.groupby(["channel", "log", "window"], observed=True)["won"].sum().idxmax()
    found = t[(t["channel"] == channel) & (t["log"] == log) & (t["window"] == window)].sort_values("time")
    return found, str(channel), f"{log}{', held out' if found['part'].iloc[0] == 'held_out' else ''}"
