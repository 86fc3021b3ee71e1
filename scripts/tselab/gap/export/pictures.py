"""The gap report's figures (plotly), one function a section, and gap.png (matplotlib)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from tselab.core import NOMINAL, STIFFNESS, Config
from tselab.errors import UserError
from tselab.files import atomic
from tselab.gap.export.gain import Gain
from tselab.gap.export.table import log_names
from tselab.gap.infer.show import Change
from tselab.gap.localise.cross import Blocks, Curve, Response, handling, responses
from tselab.gap.localise.latent import Explained, Latent
from tselab.gap.localise.where import MOST_FOLLOWED, ROAD, Entry
from tselab.gap.problem import Problem
from tselab.plots import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, picks, stride_for, thin, thin_line
from tselab.verdict import NAMES, UNITS

SOURCE = {"measured": INK, "before": ORANGE, "after": BLUE}
CHANNEL_UNITS = {"accel_x": "m/s2", "accel_y": "m/s2", "yaw_rate": "rad/s", "vehicle_speed": "m/s",
                 "wheel_torque_front": "Nm", "wheel_torque_rear": "Nm"}  # fmt: skip
MOST_POINTS = 3000  # per line; longer logs are thinned, to their peaks
HOLE = 1.0  # s without a value from which a line is broken: a log may not have the channel all the time
MOST_LOGS = 12  # that can be chosen; of a fleet, the worst
WORST = 5.0  # rms over noise at which the colours of a map end
MOST_EFFECTS = 16  # in the ranking
PICTURE_SECONDS = 8.0
SHADE = "rgba(123,79,163,0.22)"  # PURPLE
SPEED_BIN, ACCEL_BIN = 2.5, 0.75  # m/s, m/s2, of the maps
FEWEST = 10  # blocks in a cell


def _layout(figure: go.Figure, height: int, **more: object) -> go.Figure:
    figure.update_layout(
        height=height,
        margin={"l": 66, "r": 18, "t": 64, "b": 48},
        font={"family": "system-ui, sans-serif", "size": 13, "color": INK},
        paper_bgcolor="white",
        plot_bgcolor="white",
        legend={"orientation": "h", "y": 0.995, "yanchor": "top", "x": 0, "xanchor": "left", "yref": "container"},
    )
    figure.update_layout(**more)
    axis = {"showgrid": True, "gridcolor": "#edf0f3", "zeroline": False, "linecolor": "#c8ced4", "title_font_size": 13}
    figure.update_xaxes(**axis, ticks="outside", tickcolor="#c8ced4")
    figure.update_yaxes(**axis, title_standoff=6)
    for note in figure.layout.annotations:
        note.update(font={"size": 13, "color": INK})
    return figure


def _channels(table: pd.DataFrame) -> list[str]:
    return [c for c in table["channel"].cat.categories if (table["channel"] == c).any()]


def _logs(table: pd.DataFrame) -> list[tuple[str, str]]:
    """Part and name of every log, or of the worst of many."""
    energy = table.assign(e=table["residual_before"] ** 2).groupby(["part", "log"], observed=True)["e"].mean()
    worst = energy.sort_values(ascending=False).head(MOST_LOGS).index
    return [key for key in energy.index if key in set(worst)]


def overlay(table: pd.DataFrame) -> go.Figure:
    """Measured, before, after, per channel; the log is chosen from a list."""
    channels, logs = _channels(table), _logs(table)
    figure = make_subplots(len(channels), 1, shared_xaxes=True, vertical_spacing=0.05,
                           subplot_titles=[f"{c} [{CHANNEL_UNITS[c]}]" for c in channels])  # fmt: skip
    owner = []
    for n, (part, log) in enumerate(logs):
        mine = table[(table["part"] == part) & (table["log"] == log)]
        for row, channel in enumerate(channels, 1):
            t = mine[mine["channel"] == channel].sort_values("time")
            for source, colour in SOURCE.items():
                y = t["measured" if source == "measured" else f"predicted_{source}"].to_numpy(np.float32)
                time, y = thin_line(t["time"].to_numpy(), y, MOST_POINTS, HOLE)
                figure.add_trace(
                    go.Scatter(
                        x=np.round(time, 3), y=y, name=source, mode="lines", legendgroup=source, showlegend=row == 1,
                        visible=n == 0, line={"color": colour, "width": 2.0 if source == "measured" else 1.3},
                        opacity=0.45 if source == "measured" else 1.0, connectgaps=False,
                    ),
                    row=row, col=1,
                )  # fmt: skip
                owner.append(n)
    buttons = [
        {"label": f"{log}{' (held out)' if part == 'held_out' else ''}", "method": "update",
         "args": [{"visible": [o == n for o in owner]}, {}]}
        for n, (part, log) in enumerate(logs)
    ]  # fmt: skip
    _layout(figure, 210 * len(channels) + 90, hovermode="x unified")
    for note in figure.layout.annotations:
        note.update(x=0, xanchor="left")
    menu = {"x": 0, "xanchor": "left", "y": 1.0, "yanchor": "bottom", "pad": {"b": 24}, "bgcolor": "white"}
    figure.update_layout(margin_t=104, updatemenus=[menu | {"buttons": buttons}])
    figure.update_xaxes(title_text="time [s]", row=len(channels), col=1)
    return figure


def gap_bars(parts: Mapping[str, Mapping[str, Change]]) -> go.Figure:
    """Rms over noise before and after, per channel; the interval is that of the change (paired blocks)."""
    figure = make_subplots(1, len(parts), shared_yaxes=True, horizontal_spacing=0.06,
                           subplot_titles=[_part_title(p) for p in parts])  # fmt: skip
    for col, changes in enumerate(parts.values(), 1):
        names = list(changes)
        before = np.array([c.before for c in changes.values()])
        after = np.array([c.after for c in changes.values()])
        low = before * (1 + np.array([c.ci95[0] for c in changes.values()]))
        high = before * (1 + np.array([c.ci95[1] for c in changes.values()]))
        figure.add_trace(go.Bar(x=names, y=before, name="before", marker_color=ORANGE, legendgroup="before", showlegend=col == 1,
                                texttemplate="%{y:.2f}"), row=1, col=col)  # fmt: skip
        figure.add_trace(
            go.Bar(x=names, y=after, name="after", marker_color=BLUE, legendgroup="after", showlegend=col == 1,
                   texttemplate="%{y:.2f}", error_y={"type": "data", "symmetric": False, "array": np.maximum(high - after, 0),
                            "arrayminus": np.maximum(after - low, 0), "color": INK, "thickness": 1.2}),
            row=1, col=col,
        )  # fmt: skip
        figure.add_hline(y=1.0, line={"color": GREY, "dash": "dash", "width": 1.2}, row=1, col=col)
    figure.update_yaxes(title_text="residual over sensor noise (rms)", rangemode="tozero", row=1, col=1)
    return _layout(figure, 360, barmode="group")


def _part_title(part: str) -> str:
    return {"fit": "fitted logs", "held_out": "held-out logs"}[part]


def maps(table: pd.DataFrame, state: pd.DataFrame) -> go.Figure:
    """Rms residual over noise where the car was: speed against lateral acceleration."""
    channels = _channels(table)
    figure = make_subplots(len(channels), 2, shared_xaxes=True, shared_yaxes=True, horizontal_spacing=0.04, vertical_spacing=0.08,
                           subplot_titles=[f"{c}, {when}" for c in channels for when in ("before", "after")])  # fmt: skip
    speed, accel = state["speed"].to_numpy(), np.abs(state["accel_y"].to_numpy())
    xs = np.arange(np.floor(np.nanmin(speed) / SPEED_BIN), np.ceil(np.nanmax(speed) / SPEED_BIN) + 1) * SPEED_BIN
    ys = np.arange(0.0, np.nanmax(accel) + ACCEL_BIN, ACCEL_BIN)
    for row, channel in enumerate(channels, 1):
        for col, when in enumerate(("before", "after"), 1):
            e = table[f"residual_{when}"].to_numpy()
            mine = (table["channel"] == channel).to_numpy() & np.isfinite(e)
            count = np.histogram2d(accel[mine], speed[mine], [ys, xs])[0]
            energy = np.histogram2d(accel[mine], speed[mine], [ys, xs], weights=e[mine] ** 2)[0]
            z = np.where(count >= FEWEST, np.sqrt(energy / np.maximum(count, 1)), np.nan)
            figure.add_trace(
                go.Heatmap(x=_middle(xs), y=_middle(ys), z=np.round(z, 3), coloraxis="coloraxis",
                           hovertemplate="%{x:.1f} m/s, %{y:.1f} m/s2: %{z:.2f} times the noise<extra></extra>"),
                row=row, col=col,
            )  # fmt: skip
        figure.update_yaxes(title_text="|accel_y| [m/s2]", row=row, col=1)
    figure.update_xaxes(title_text="speed [m/s]", row=len(channels))
    return _colours(_layout(figure, 210 * len(channels) + 90))


def _colours(figure: go.Figure) -> go.Figure:
    scale = [[0.0, "#eef3f8"], [1 / WORST, "#cfe0ef"], [0.4, "#f3d7a2"], [0.7, "#dd8a3c"], [1.0, "#8f2d04"]]
    bar = {"title": {"text": "rms over<br>noise", "font": {"size": 13}}, "thickness": 14}
    figure.update_layout(coloraxis={"colorscale": scale, "cmin": 0, "cmax": WORST, "colorbar": bar})
    return figure


def _middle(edges: np.ndarray) -> np.ndarray:
    return 0.5 * (edges[1:] + edges[:-1])


def over_time(table: pd.DataFrame) -> go.Figure:
    """Rms residual over noise second by second, a line of colour per log."""
    channels, logs = _channels(table), _logs(table)
    figure = make_subplots(len(channels), 2, shared_xaxes=True, shared_yaxes=True, horizontal_spacing=0.03, vertical_spacing=0.07,
                           subplot_titles=[f"{c}, {when}" for c in channels for when in ("before", "after")])  # fmt: skip
    second = np.floor(table["time"]).astype(int)
    last = int(second.max()) + 1
    step = max(1, last // 600)
    for row, channel in enumerate(channels, 1):
        mine = table["channel"] == channel
        for col, when in enumerate(("before", "after"), 1):
            z = np.full((len(logs), last // step + 1), np.nan)
            for k, (part, log) in enumerate(logs):
                rows = mine & (table["part"] == part) & (table["log"] == log)
                mean = (table.loc[rows, f"residual_{when}"] ** 2).groupby(second[rows] // step).mean()
                z[k, mean.index.to_numpy()] = np.sqrt(mean.to_numpy())
            figure.add_trace(
                go.Heatmap(x=(np.arange(z.shape[1]) + 0.5) * step, y=[_short(log, part) for part, log in logs], z=np.round(z, 2),
                           coloraxis="coloraxis", hovertemplate="%{y}, %{x} s: %{z:.2f} times the noise<extra></extra>"),
                row=row, col=col,
            )  # fmt: skip
    figure.update_xaxes(title_text="time [s]", row=len(channels))
    figure.update_yaxes(autorange="reversed", showgrid=False)
    _colours(_layout(figure, (40 + 24 * len(logs)) * len(channels) + 130))
    figure.update_layout(margin_l=190)
    return figure


def _short(log: str, part: str) -> str:
    text = log if len(log) <= 24 else log[:22] + "…"
    return text + (" *" if part == "held_out" else "")


def ranking(entries: Sequence[dict], named: Sequence[str], need: float) -> go.Figure:
    """Nats of every effect alone, with stiffness refitted; the line is what a name needs."""
    top = [e for e in entries if e["nats"] > 1.0][:MOST_EFFECTS] or list(entries[:3])
    top = top[::-1]
    colours = [BLUE if e["id"] in named else "#b6c4d2" for e in top]
    text = [f"{100 * e['share']:.0f} % of the gap" if "share" in e else "" for e in top]
    figure = go.Figure(
        go.Bar(x=[max(e["nats"], 1e-3) for e in top], y=[e["id"] for e in top], orientation="h", marker_color=colours, text=text,
               textposition="auto", hovertemplate="%{y}: %{x:.1f} nats<extra></extra>")
    )  # fmt: skip
    figure.add_vline(x=need, line={"color": INK, "dash": "dash", "width": 1.2})
    _layout(figure, 60 + 24 * len(top) + 60)
    figure.update_layout(margin_l=190, margin_t=24)
    most = np.log10(1.2 * max(need, *(e["nats"] for e in top)))
    figure.update_xaxes(
        title_text=f"evidence [nat]; dashed: {need:.1f}, which a name needs", type="log", range=[0, most]
    )
    return figure


def entry_points(entries: Sequence[Entry]) -> go.Figure | None:
    if not entries:
        return None
    top = list(entries)[::-1]
    names = [
        f"{e.place}: follows the steering" if e.place == ROAD and e.follows > MOST_FOLLOWED else e.place for e in top
    ]
    figure = go.Figure(
        go.Bar(x=[max(e.nats, 0.0) for e in top], y=names, orientation="h", marker_color=PURPLE,
               text=[f"{100 * e.share:.0f} %" for e in top], hovertemplate="%{y}: %{x:.0f} nats<extra></extra>")
    )  # fmt: skip
    _layout(figure, 60 + 24 * len(top) + 60)
    figure.update_layout(margin_l=220, margin_t=24)
    figure.update_xaxes(
        title_text="evidence for a disturbance that enters there [nat]; text: share of the gap that it takes up"
    )
    return figure


DASH = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")


def handling_figure(blocks: list[Blocks], wheelbase: float) -> go.Figure | None:
    """Yaw-rate gain and understeer angle over lateral acceleration."""
    gains, angles = handling(blocks, wheelbase)
    if not gains and not angles:
        return None
    figure = make_subplots(1, 2, horizontal_spacing=0.1,
                           subplot_titles=["Yaw-rate gain [1/s]", "Steering angle less wheelbase / radius [deg]"])  # fmt: skip
    shown: set[str] = set()
    bands = sorted({c.speed for c in gains + angles})
    dash = {v: DASH[i % len(DASH)] for i, v in enumerate(bands)}

    def draw(curves: list[Curve], col: int, factor: float) -> None:
        for c in curves:
            named = c.source == "after" and col == 1  # its speed, once
            figure.add_trace(
                go.Scatter(
                    x=c.accel_y, y=factor * c.value, name=c.source, legendgroup=c.source, showlegend=c.source not in shown,
                    mode="markers" if c.source == "measured" else "lines+markers" + ("+text" if named else ""),
                    text=[""] * (len(c.value) - 1) + [f" {c.speed:g} m/s"], textposition="middle right", textfont={"size": 11},
                    marker={"size": 9 if c.source == "measured" else 4, "color": SOURCE[c.source],
                            "symbol": bands.index(c.speed) % 6},
                    line={"color": SOURCE[c.source], "width": 1.6, "dash": dash[c.speed]},
                    cliponaxis=False, hovertemplate=f"{c.source}, {c.speed:g} m/s: %{{x:.2f}} m/s2, %{{y:.3f}}<extra></extra>",
                ),
                row=1, col=col,
            )  # fmt: skip
            shown.add(c.source)

    draw(gains, 1, 1.0)
    draw(angles, 2, 180 / np.pi)
    figure.update_xaxes(title_text="|accel_y| [m/s2]", rangemode="tozero")
    _layout(figure, 420)
    return figure.update_layout(margin_r=52)


def response_figure(blocks: list[Blocks]) -> tuple[go.Figure, str] | None:
    """Gain and phase over the frequency, and of which log."""
    found: list[Response] = responses(blocks)
    if not found:
        return None
    titles = [f"{t} of {r.channel} over steering" for t in ("Gain", "Phase") for r in found]
    figure = make_subplots(2, 2, shared_xaxes=True, horizontal_spacing=0.1, vertical_spacing=0.1, subplot_titles=titles)
    for col, r in enumerate(found, 1):
        for source, colour in SOURCE.items():
            for row, y in ((1, r.gain[source]), (2, r.phase[source])):
                figure.add_trace(
                    go.Scatter(x=r.frequency, y=y, name=source, legendgroup=source, showlegend=row == col == 1,
                               mode="markers" if source == "measured" else "lines", marker={"color": colour, "size": 7},
                               line={"color": colour, "width": 1.8}),
                    row=row, col=col,
                )  # fmt: skip
        unit = "1/s" if r.channel == "yaw_rate" else "m/s2/rad"
        figure.update_yaxes(title_text=unit, rangemode="tozero", row=1, col=col)
        figure.update_yaxes(title_text="deg", row=2, col=col)
    figure.update_xaxes(title_text="frequency [Hz]", row=2)
    return _layout(figure, 520), f"{found[0].log}, at {found[0].speed:.0f} m/s"


def stiffness_figure(gain: Gain, config: Config) -> go.Figure | None:
    """What the estimator says of each log, before and after: one car, so one height."""
    keys = [
        k
        for k in STIFFNESS
        if any(np.isfinite(d.stiffness[1][k]) or np.isfinite(d.stiffness[0][k]) for d in gain.drives)
    ]
    if not keys:
        return None
    titles = [f"{NAMES[k]} [{UNITS[k]}]" for k in keys]
    figure = make_subplots(1, len(keys), horizontal_spacing=0.08, subplot_titles=titles)
    names = [_short(d.log, d.part) for d in gain.drives]
    for col, key in enumerate(keys, 1):
        for k, (when, colour) in enumerate((("before", ORANGE), ("after", BLUE))):
            y = [d.stiffness[k][key] / 1000 for d in gain.drives]
            figure.add_trace(go.Scatter(x=names, y=y, mode="markers", name=when, legendgroup=when, showlegend=col == 1,
                                        marker={"color": colour, "size": 10, "symbol": "circle" if k else "circle-open",
                                                "line": {"width": 2, "color": colour}}), row=1, col=col)  # fmt: skip
        figure.add_hline(
            y=getattr(config, NOMINAL[key]) / 1000, line={"color": GREEN, "dash": "dot", "width": 1.2}, row=1, col=col
        )
    figure.update_xaxes(tickangle=40)
    return _layout(figure, 420, margin_b=130)


# ---- the picture


def picture(path: Path, table: pd.DataFrame, parts: Mapping[str, Mapping[str, Change]], title: str) -> None:
    """gap.png: the moment in which the gap closed most, and the gap per channel before and after."""
    try:
        import matplotlib
    except ImportError:
        raise UserError("the picture needs matplotlib: pip install 'tse[figures]'") from None
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    style = {"font.size": 11, "font.family": "DejaVu Sans", "axes.edgecolor": "#c8ced4", "axes.linewidth": 0.8,
             "text.color": INK, "axes.labelcolor": INK, "xtick.color": "#52606d", "ytick.color": "#52606d"}  # fmt: skip
    with plt.rc_context(style):
        figure = plt.figure(figsize=(10, 5.2), dpi=160, layout="constrained")
        grid = figure.add_gridspec(2, 2, width_ratios=[1.55, 1], height_ratios=[2.1, 1])
        above, below, bars = (figure.add_subplot(g) for g in (grid[0, 0], grid[1, 0], grid[:, 1]))
        moment, channel, where = best_moment(table)
        time = moment["time"]
        above.plot(time, moment["measured"], color=INK, lw=3.2, alpha=0.35, label="measured", solid_capstyle="round")
        above.plot(time, moment["predicted_before"], color=ORANGE, lw=1.5, label="simulated before")
        above.plot(time, moment["predicted_after"], color=BLUE, lw=1.5, label="simulated after")
        above.set_title(f"{channel} in {where}", loc="left", fontsize=11, fontweight="bold")
        above.set_ylabel(CHANNEL_UNITS[channel])
        above.legend(frameon=False, ncols=3, loc="upper right", fontsize=9.5)
        low, high = above.get_ylim()
        above.set_ylim(low, high + 0.16 * (high - low))
        above.tick_params(labelbottom=False)
        below.axhspan(-2, 2, color=GREY, alpha=0.15, lw=0)
        below.plot(time, moment["residual_before"], color=ORANGE, lw=1.1)
        below.plot(time, moment["residual_after"], color=BLUE, lw=1.1)
        below.set_ylabel("residual\nover noise")
        below.set_xlabel("time [s]")
        _draw_bars(bars, parts)
        for axis in (above, below, bars):
            axis.grid(color="#edf0f3", lw=0.8)
            axis.set_axisbelow(True)
            axis.spines[["top", "right"]].set_visible(False)
        bars.grid(axis="x", visible=False)
        figure.suptitle(title, x=0.01, ha="left", fontsize=12.5, fontweight="bold")
        with atomic(path, "wb") as file:
            figure.savefig(file, format="png", metadata={"Software": None})
        plt.close(figure)


def best_moment(table: pd.DataFrame) -> tuple[pd.DataFrame, str, str]:
    """The seconds in which most of the gap closed, on a held-out log if there is one; if none did, the worst."""
    t = table[table["part"] == "held_out"] if (table["part"] == "held_out").any() else table
    won = (t["residual_before"] ** 2 - t["residual_after"] ** 2).fillna(0.0)
    t = t.assign(won=won, window=np.floor(t["time"] / PICTURE_SECONDS))
    if not t["won"].abs().sum() > 0:
        t["won"] = t["residual_before"].fillna(0.0) ** 2
    channel, log, window = t.groupby(["channel", "log", "window"], observed=True)["won"].sum().idxmax()
    found = t[(t["channel"] == channel) & (t["log"] == log) & (t["window"] == window)].sort_values("time")
    return found, str(channel), f"{log}{', held out' if found['part'].iloc[0] == 'held_out' else ''}"


def _draw_bars(axis: object, parts: Mapping[str, Mapping[str, Change]]) -> None:
    labels, place = [], 0.0
    ticks = []
    top = max(c.before for changes in parts.values() for c in changes.values())
    for part, changes in parts.items():
        start = place
        for channel, c in changes.items():
            axis.bar(place - 0.2, c.before, 0.38, color=ORANGE)
            axis.bar(place + 0.2, c.after, 0.38, color=BLUE)
            low, high = c.before * (1 + c.ci95[0]), c.before * (1 + c.ci95[1])
            error = [[max(c.after - low, 0.0)], [max(high - c.after, 0.0)]]
            axis.errorbar(place + 0.2, c.after, yerr=error, color=INK, lw=1, capsize=2)
            labels.append(channel.replace("_", "\n", 1))
            ticks.append(place)
            place += 1.0
        middle = 0.5 * (start + place - 1.0)
        axis.text(
            middle,
            1.13 * top,
            {"fit": "fitted", "held_out": "held out"}[part],
            ha="center",
            color="#52606d",
            fontsize=10,
        )
        place += 0.5
    axis.axhline(1.0, color=INK, lw=1.1, ls=(0, (4, 3)))
    axis.set_xticks(ticks, labels, fontsize=9)
    axis.set_ylim(0, 1.22 * top)
    axis.set_title("Residual over noise (rms)", loc="left", fontsize=11, fontweight="bold")
    axis.set_xlabel("dashed: the sensors' noise alone", fontsize=9.5, color="#52606d")


def disturbance_figure(problem: Problem, latent: Latent, explained: list[Explained]) -> go.Figure | None:
    """The disturbance over the time of the log where it is largest, and over what explains it best; None: there is none."""
    _, moments = np.unique(problem.rows.block, return_index=True)
    moments = moments[np.isfinite(latent.value[moments])]
    if not len(moments):
        return None
    log = problem.rows.log[moments]
    worst = max(np.unique(log), key=lambda i: float(np.mean(latent.value[moments[log == i]] ** 2)))
    best = explained[0] if explained else None
    over = (
        f"over {best.name}: explains {100 * best.share:.0f} %" if best else "follows no quantity more than chance does"
    )
    titles = [f"{latent.place} in {log_names(problem)[worst]}", over]
    result = make_subplots(1, 2, column_widths=[0.6, 0.4], horizontal_spacing=0.1, subplot_titles=titles)
    mine = moments[log == worst]
    time = problem.rows.time[mine]
    for n, part in enumerate(np.split(mine, 1 + np.flatnonzero(np.diff(time) > HOLE))):
        stride = stride_for(len(mine), MOST_POINTS)
        t, value, sd = problem.rows.time[part][picks(len(part), stride)], latent.value[part], latent.sd[part]
        y, high, low = (thin(line, stride) for line in (value, value + 2 * sd, value - 2 * sd))
        band = np.append(high, low[::-1])
        result.add_trace(
            go.Scatter(x=np.round(np.append(t, t[::-1]), 3), y=band, name="± 2 sd", legendgroup="band", showlegend=n == 0,
                       mode="lines", fill="toself", fillcolor=SHADE, line={"width": 0}, hoverinfo="skip"),
            row=1, col=1,
        )  # fmt: skip
        result.add_trace(
            go.Scatter(x=np.round(t, 3), y=y, name="what is missing", legendgroup="value", showlegend=n == 0, mode="lines",
                       line={"color": PURPLE, "width": 1.6}),
            row=1, col=1,
        )  # fmt: skip
    result.add_hline(y=0.0, line={"color": GREY, "width": 1.0}, row=1, col=1)
    if best:
        shown = moments[:: max(1, -(-len(moments) // MOST_POINTS))]
        middle, mean, low, high = best.shape.T
        result.add_trace(
            go.Scatter(x=best.quantity[shown], y=latent.value[shown], name="blocks of 40 ms, all logs", mode="markers",
                       marker={"color": GREY, "size": 3}, opacity=0.35),
            row=1, col=2,
        )  # fmt: skip
        spread = {"symmetric": False, "array": high - mean, "arrayminus": mean - low, "color": INK, "thickness": 1.2}
        result.add_trace(
            go.Scatter(x=middle, y=mean, name="mean and quartiles", mode="lines+markers", line={"color": BLUE, "width": 2},
                       marker={"size": 6}, error_y=spread),
            row=1, col=2,
        )  # fmt: skip
        result.update_xaxes(title_text=f"{best.name} [{best.unit}]", row=1, col=2)
    result.update_xaxes(title_text="time [s]", row=1, col=1)
    result.update_yaxes(title_text=f"{latent.place} [{latent.unit}]", row=1, col=1)
    result.update_yaxes(title_text=f"[{latent.unit}]", row=1, col=2)
    return _layout(result, 420)
