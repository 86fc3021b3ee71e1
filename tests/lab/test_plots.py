"""The report's figures: thinned without losing a peak, and such as plotly takes them."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from test_what_happened import CALM, ROAD, table_of

from tse.impl import plots
from tse.impl.core import STIFFNESS, Config
from tse.impl.regimes import REGIMES, changes, spells
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
    from tse.impl.gap.run.pictures import overlay

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


# ---- The report of a drive on which something happened, from made-up tables.


def drive(told, seconds: float = 200.0):
    """Log and estimates with all columns that the report draws."""
    table = table_of(told, seconds)
    log, other = made_up(len(table))
    rest = other[[c for c in other if c not in table]]
    return log, pd.concat(
        [table, rest.assign(**{f"discrepancy_{c}": 0.1 for c in ("accel_x", "accel_y", "yaw_rate")})], axis=1
    )


def test_the_strip_shows_the_least_usual_row_and_its_probabilities_add_up():
    log, table = drive(ROAD)
    table.loc[12345, ["p_steady", "p_fault"]] = [0.1, 0.9]
    data = plots.Data(log)
    data.add(table)
    p = np.array([data.line(name) for name in REGIMES])
    assert data.stride == 8 and p.shape[1] == len(data.time) and np.allclose(p.sum(axis=0), 1)
    assert data.line("p_fault").max() == pytest.approx(0.9)
    parts = plots.Data(log)
    for start in range(0, len(table), 2048):
        parts.add(table.iloc[start : start + 2048])
    assert all(np.array_equal(parts.line(name), data.line(name)) for name in REGIMES)


def test_the_plot_names_what_happened_and_plotly_takes_it():
    import plotly.graph_objects as go

    log, table = drive(ROAD)
    table.loc[2000:2200, ["p_steady", "p_fault", "fault_channel"]] = [0.05, 0.95, 6]
    data = plots.Data(log)
    data.add(table)
    figure = plots.stiffness_figure(data, table, Config(), changes(table), spells(table))
    go.Figure(figure.as_dict())
    texts = [a["text"] for a in figure.layout["annotations"]]
    assert "road changed at 36.03 s, 97 %" in texts and "yaw_rate at fault 20.00 .. 22.00 s, 95 %" in texts
    assert set(REGIMES.values()) <= {t["name"] for t in figure.data}
    lines = [s for s in figure.layout["shapes"] if s["type"] == "line"]
    assert [s["x0"] for s in lines] == [pytest.approx(36.03)]
    health = plots.health_figure(data)
    go.Figure(health.as_dict())
    assert {"discrepancy_accel_x", "discrepancy_yaw_rate"} <= {t["name"] for t in health.data}


def test_the_report_speaks_of_every_stretch_and_lists_what_happened(tmp_path):
    from tse.impl.estimate import Estimate
    from tse.impl.report import write_report
    from tse.impl.vehicle import default_vehicle

    log, table = drive([(0, 36.1, None), (36.1, 120, (36.03, 1, 0.97, 0.7)), (120, 200, (119.9, 2, 0.93, 1.2))])
    write_report(tmp_path / "r.html", Estimate(table, False), log, default_vehicle(), Config(), [])
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    for text in ("What happened", "<td>road changed</td>", "36.03 s", "97 %", "front cornering x 0.70", "From 0.0 .. 36.0 s",
                 "From 36.0 .. 119.9 s", "From 119.9 .. 200.0 s", "<td>front axle changed</td>"):  # fmt: skip
        assert text in page, text
    assert "<h3>Grip</h3>" not in page  # a setting, no estimate
    calm = drive(CALM)[1]
    write_report(tmp_path / "calm.html", Estimate(calm, False), log, default_vehicle(), Config({"grip_sd": 0.2}), [])
    page = (tmp_path / "calm.html").read_text(encoding="utf-8")
    assert "<h3>Grip</h3>" in page and "<h3>Sideslip angle</h3>" in page
    assert "What happened</h2>" not in page and "<th>Stretch</th>" not in page
