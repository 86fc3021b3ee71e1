"""The report's figures: thinned without losing a peak, and such as plotly takes them."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tse.impl import plots
from tse.impl.core import STIFFNESS, Config
from tse.impl.rows import Log, columns


def made_up(n: int) -> tuple[Log, pd.DataFrame]:
    """A log and estimates of n rows that nobody computed."""
    rng = np.random.default_rng(n)
    time = 0.01 * np.arange(n)
    data = pd.DataFrame({c: rng.standard_normal(n) for c in columns()[1:]})
    ref = pd.DataFrame(
        {"ref_vel_x": 20 + data["accel_x"], "ref_cy_rear": np.full(n, 1.4e5), "ref_throttle": data["accel_y"]}
    )
    log = Log(Path("made-up.csv"), time, data, ref, np.arange(n) + 2, 0.01)
    names = [c for c in (*plots.WITH_BAND, *plots.PLAIN) if c not in ("status",)]
    est = {"time": time, "status": (rng.random(n) < 0.1).astype(int)}
    est |= {c: rng.standard_normal(n) * 0.1 + (1.3e5 if c in STIFFNESS else 1) for c in names}
    est |= {f"{c}_sd": np.full(n, 0.1) for c in plots.WITH_BAND}
    for key in (*STIFFNESS, "grip"):
        valid = rng.random(n) < 0.7
        est |= {f"{key}_spread": np.full(n, 5e3)} if key in STIFFNESS else {}
        est |= {f"{key}_valid": valid.astype(int)}
        est |= {f"{key}_reason": np.where(valid, "valid", "not excited")}
    return log, pd.DataFrame(est)


def figures(data: plots.Data, table: pd.DataFrame) -> list[plots.Figure]:
    made = [plots.stiffness_figure(data, table, Config()), plots.states_figure(data), plots.inputs_figure(data),
            plots.health_figure(data), plots.others_figure(data)]  # fmt: skip
    return [f for f in made if f is not None]


@pytest.mark.parametrize(("n", "stride"), [(1, 4), (1000, 8), (1001, 8), (1007, 16)])
def test_every_peak_survives_in_its_place(n, stride):
    y = np.random.default_rng(n).standard_normal(n)
    y[n // 2] = 50.0
    y[n // 3] = -50.0
    thinned, at = plots.thin(y, stride), plots.picks(n, stride)
    assert len(thinned) == len(at) == 2 * -(-n // stride)
    assert np.all(np.diff(at) >= 0) and at[0] == 0 and at[-1] < n
    for i, value in enumerate(thinned):
        bucket = y[i // 2 * stride :][:stride]
        assert value in (bucket.min(), bucket.max())
        assert {bucket.min(), bucket.max()} == set(thinned[i // 2 * 2 :][:2])
        if bucket.argmin() < bucket.argmax():
            assert thinned[i // 2 * 2] == bucket.min()


def test_what_is_missing_leaves_a_gap_only_where_nothing_is_left():
    y = np.array([np.nan, 1.0, 2.0, np.nan, *[np.nan] * 4, 3.0, np.nan, np.nan, np.nan])
    assert np.array_equal(plots.thin(y, 4), [1, 2, np.nan, np.nan, 3, 3], equal_nan=True)


def test_what_a_screen_can_show_is_not_thinned():
    y = np.arange(7.0)
    assert plots.thin(y, plots.stride_of(plots.MOST_POINTS)) is y
    for n in (plots.MOST_POINTS + 1, 10**5, 360_000, 8 * 10**6):
        stride = plots.stride_of(n)
        assert stride & (stride - 1) == 0 and plots.MOST_POINTS / 2 * 0.9 < 2 * n / stride <= plots.MOST_POINTS


@pytest.mark.parametrize("n", [1, 500, 20001])
def test_figures_are_what_plotly_takes(n):
    import plotly.graph_objects as go

    log, table = made_up(n)
    data = plots.Data(log)
    data.add(table)
    for figure in figures(data, table):
        checked = go.Figure(figure.as_dict())  # refuses every key and value that it does not know
        assert checked.layout.height == figure.height
        for trace in checked.data:
            assert len(trace.x) == len(trace.y)
        domains = [figure.layout[k]["domain"] for k in figure.layout if k.startswith("yaxis")]
        assert all(0 <= low < high <= 1 for low, high in domains)
        assert all(below[1] < above[0] for above, below in pairwise(domains))


def test_drawn_block_by_block_is_drawn_as_a_whole():
    log, table = made_up(20001)
    whole, parts = plots.Data(log), plots.Data(log)
    whole.add(table)
    for start in range(0, len(table), 4096):
        parts.add(table.iloc[start : start + 4096])
    a, b = ([f.as_dict() for f in figures(d, table)] for d in (whole, parts))
    assert whole.stride == 8
    for x, y in zip(a, b, strict=True):
        assert x["layout"] == y["layout"]
        for one, other in zip(x["data"], y["data"], strict=True):
            assert np.array_equal(one["x"], other["x"]) and np.array_equal(one["y"], other["y"], equal_nan=True)


def test_an_interrupted_run_is_drawn_as_far_as_it_came():
    log, table = made_up(20001)
    data = plots.Data(log)
    data.add(table.iloc[:4096])
    data.add(table.iloc[4096:5000])
    for figure in figures(data, table.iloc[:5000]):
        for trace in figure.data:
            assert len(trace["x"]) == len(trace["y"]) and max(trace["x"]) <= log.time[4999]


def test_a_line_keeps_its_peak_and_is_broken_where_nothing_was_logged():
    time = 0.04 * np.arange(20_000)
    time[10_000:] += 5.0
    y = np.zeros(20_000)
    y[3_001], y[15_002] = 7.0, -9.0
    x, drawn = plots.thin_line(time, y, 3_000, 1.0)
    assert len(x) == len(drawn) <= 3_100
    assert np.nanmax(drawn) == 7.0 and np.nanmin(drawn) == -9.0
    assert abs(x[np.nanargmax(drawn)] - time[3_001]) < 0.04 * plots.stride_for(20_000, 3_000)
    assert np.isnan(drawn).sum() == 1 and np.all(np.diff(x) >= 0)
    same = plots.thin_line(time[:100], y[:100], 3_000, 1.0)
    assert np.array_equal(same[0], time[:100]) and np.array_equal(same[1], y[:100])


def test_a_peak_is_in_the_gap_reports_lines_of_a_long_log():
    """They were thinned to every n-th row: a spike of one block was gone in six of seven places."""
    from tse.impl.gap.export.pictures import overlay

    n = 21_000
    table = pd.DataFrame(
        {"part": "fit", "log": "long", "channel": pd.Categorical(["accel_y"] * n), "time": 0.04 * np.arange(n)}
    )
    for column in ("measured", "predicted_before", "predicted_after", "residual_before"):
        table[column] = 0.0
    table.loc[12_345, "measured"] = 30.0
    lines = {trace.name: np.asarray(trace.y, float) for trace in overlay(table).data}
    assert np.nanmax(lines["measured"]) == 30.0 and len(lines["measured"]) <= 3_100
    assert np.nanmax(lines["before"]) == 0.0
