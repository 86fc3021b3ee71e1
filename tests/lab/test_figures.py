"""Figures of the report: which values are drawn, at which times, in which units.

A drive of a few rows is drawn, and each line compared with its column.
"""

import sys
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pandas as pd
import pytest

from tse.estimation.regimes import REGIMES, Change, Spell
from tse.library.core import NOMINAL, STATUS, STIFFNESS, Config, library
from tse.library.errors import UserError
from tse.log.rows import MEASURES, CheckedLog, list_columns
from tse.report import plots

N = 60
TIME = 100.0 + 0.1 * np.arange(N)


def make_log(n: int = N, step: float = 0.1) -> CheckedLog:
    """Return a log whose columns are 1, 2, 3 ... plus the number of the row."""
    names = list_columns()[1:]
    data = pd.DataFrame({c: k + 1.0 + np.arange(n) for k, c in enumerate(names)})
    ref = {"ref_vel_x": 21.0, "ref_cy_front_a": 0.9e5, "ref_cy_front_b": 1.0e5, "ref_beta": 0.02}
    ref |= {"ref_wheel_rl": 66.0, "ref_yaw_rate": 0.3, "ref_throttle": 0.5}
    return CheckedLog(
        Path("x.csv"),
        100.0 + step * np.arange(n),
        data,
        pd.DataFrame({k: np.full(n, v) for k, v in ref.items()}),
        np.arange(n),
        step,
    )


def make_table(n: int = N, step: float = 0.1, **columns: object) -> pd.DataFrame:
    """Return estimates that are valid from row 20 on."""
    valid = np.arange(n) >= 20
    table: dict[str, object] = {"time": 100.0 + step * np.arange(n), "status": np.full(n, 1)}
    for k, name in enumerate((*plots.WITH_BAND, *plots.PLAIN)):
        table.setdefault(name, np.full(n, 0.1 * (k + 1)))
    table |= {f"{name}_sd": np.full(n, 0.01) for name in plots.WITH_BAND}
    for k, key in enumerate(STIFFNESS):
        table |= {key: np.full(n, 1e5 + 1e4 * k), f"{key}_sd": np.full(n, 2e3)}
        table |= {f"{key}_spread": np.full(n, 5e3), f"{key}_valid": valid.astype(int)}
        table[f"{key}_reason"] = np.where(valid, "valid", "not excited")
    table |= {"grip_valid": np.ones(n, int), "grip_reason": np.full(n, "valid"), "n_eff": np.ones(n)}
    table |= {f"noise_{c}": np.ones(n) for c in MEASURES}
    table |= {"sideslip": np.full(n, 0.05), "sideslip_sd": np.full(n, 0.01)}
    return pd.DataFrame(table | columns)


def make_data(table: pd.DataFrame | None = None, log: CheckedLog | None = None) -> plots.Data:
    data = plots.Data(log or make_log())
    data.add(make_table() if table is None else table)
    return data


def find_traces(figure: plots.Figure, name: str, row: int | None = None) -> list[dict]:
    axis = None if row is None else f"y{figure.axis(row)}"
    return [t for t in figure.data if t["name"] == name and axis in (None, t["yaxis"])]


def get_y(figure: plots.Figure, name: str, row: int | None = None) -> np.ndarray:
    (trace,) = find_traces(figure, name, row)
    return np.asarray(trace["y"], float)


# ---- thinning


def test_lines_are_thinned_each_by_itself():
    y = np.array([[1.0, 4, 2, 3, 8, 9, 7, 6, 5], [9, 1, 1, 1, 2, 2, 2, 7, np.nan]])
    expected = [[1, 4, 9, 6, 5, 5], [9, 1, 2, 7, np.nan, np.nan]]
    assert np.array_equal(plots.thin_rows(y, 4), expected, equal_nan=True)


@pytest.mark.parametrize(
    ("rows", "stride", "expected"),
    [(3, 1, [0, 1, 2]), (9, 4, [0, 2, 4, 6, 8, 8]), (8, 4, [0, 2, 4, 6]), (5, 3, [0, 1, 3, 4])],
)
def test_the_two_values_of_a_block_are_drawn_at_its_begin_and_in_its_middle(rows, stride, expected):
    assert plots.pick_rows(rows, stride).tolist() == expected


@pytest.mark.parametrize(
    ("rows", "points", "stride"), [(10, 10, 1), (11, 10, 3), (100, 10, 20), (101, 10, 21), (5, 10, 1)]
)
def test_a_stride_gives_no_more_points_than_asked(rows, points, stride):
    assert plots.find_stride(rows, points) == stride


@pytest.mark.parametrize(
    ("rows", "stride"), [(8000, 1), (8001, 4), (16_000, 4), (16_001, 8), (10**9, plots.BLOCK)]
)
def test_the_stride_of_a_log_divides_a_block_of_its_estimates(rows, stride):
    assert plots.find_block_stride(rows) == stride and plots.BLOCK % stride == 0


def test_a_line_is_broken_at_each_hole_and_nowhere_else():
    time = np.array([0.0, 1.0, 2.0, 4.5, 5.5, 9.0])
    x, y = plots.thin_line(time, np.arange(6.0), 100, 1.0)
    assert x.tolist() == [0, 1, 2, 4.5, 4.5, 5.5, 9, 9]
    assert np.array_equal(y, [0, 1, 2, np.nan, 3, 4, np.nan, 5], equal_nan=True)


def test_the_least_steady_row_of_a_block_stands_for_it():
    y = np.array([0.9, 0.5, 0.7, np.nan, 0.3, 0.6])
    assert plots.find_min_rows(y, 4).tolist() == [1, 1, 4, 4]
    assert plots.find_min_rows(y, 1).tolist() == [0, 1, 2, 3, 4, 5]
    assert plots.find_min_rows(y[:3], 3).tolist() == [1, 1]


# ---- lines and times


def test_lines_are_in_the_units_of_the_plots_with_intervals_of_95_percent():
    lines = plots.compute_drawn_lines({k: np.asarray(v) for k, v in make_table().items()})
    expected = {
        "cy_front": 110.0, "cy_front_low": 110 - 3.92, "cy_front_high": 110 + 3.92,
        "cy_rear_spread_low": 120 - 9.8, "cy_rear_spread_high": 120 + 9.8,
        "sideslip": np.degrees(0.05), "sideslip_low": np.degrees(0.05 - 0.0196),
        "vel_x_high": 0.4 + 0.0196, "status": 1.0,
    }  # fmt: skip
    for name, value in expected.items():
        assert lines[name][30] == pytest.approx(value), name
    assert np.isnan(lines["cx_front_valid"][:20]).all() and (lines["cx_front_valid"][20:] == 100).all()
    assert (lines["cx_front_other"][:20] == 100).all() and np.isnan(lines["cx_front_other"][20:]).all()
    assert "lag_steer" not in lines


def test_estimates_are_drawn_earlier_than_their_rows_where_channels_are_late():
    data = make_data()
    assert data.time is not None and (data.time == TIME).all() and "estimate_age" not in data
    late = make_data(make_table(estimate_age=np.where(np.arange(N) < 5, np.nan, 0.25)))
    assert late.time == pytest.approx(np.where(np.arange(N) < 5, TIME, TIME - 0.25))
    assert (late.logged_time == TIME).all()
    assert (late.logged("yaw_rate") == make_log().data["yaw_rate"]).all()


def test_a_point_says_its_value_interval_and_reason():
    text = make_data().hover("cy_rear")
    assert (text[0], text[-1]) == ("120.0 ± 3.9 kN/rad, not excited", "120.0 ± 3.9 kN/rad, valid")
    assert make_data().hover("cx_front")[0].startswith("100.0 ± 3.9 kN, ") and len(text) == N


def test_thinned_blocks_keep_their_own_rows_reasons_and_least_steady_probabilities(monkeypatch):
    monkeypatch.setattr(plots, "find_block_stride", lambda rows: 4)
    row = np.arange(16)
    steady = np.where(row % 4 == 1, 0.1 + row / 100, 0.9)
    table = make_table(16, cy_rear_reason=[f"r{i}" for i in row], **dict.fromkeys(REGIMES, row / 16))
    table["p_steady"] = steady
    data = make_data(table[:8], make_log(16))
    assert len(data.logged("yaw_rate")) == len(data.time) == 4  # only of the rows so far
    data.add(table[8:])
    assert data.rows == 16 and data.time == pytest.approx(100 + 0.1 * row[::2])
    assert [x.split()[-1] for x in data.hover("cy_rear")] == [f"r{i}" for i in row[::2]]
    assert data.line("p_steady") == pytest.approx(np.repeat(steady[1::4], 2))
    other = next(p for p in REGIMES if p != "p_steady")
    assert data.line(other) == pytest.approx(np.repeat(row[1::4] / 16, 2))


@pytest.mark.parametrize(
    ("column", "quantity"),
    [
        ("ref_beta", "sideslip"),
        ("ref_beta_2", "sideslip"),
        ("ref_betamax", None),
        ("ref_speed_gps", "vel_x"),
        ("ref_accel_xyz", None),
        ("ref_steer_angle", "steer_angle"),
        ("ref_wheel_speed_rl", "wheel_speed_rear"),
        ("ref_wheel_speed_front", "wheel_speed_front"),
        ("ref_wheel_x", None),
        ("vel_x", None),
    ],
)
def test_a_reference_is_found_by_its_whole_name(column, quantity):
    assert plots.match_reference(column) == quantity


def test_references_are_those_of_the_quantity_and_the_rest_have_a_figure():
    data = make_data()
    assert data.references("cy_front") == ["ref_cy_front_a", "ref_cy_front_b"]
    assert data.references(None) == ["ref_throttle"]
    figure = plots.draw_other_references(data)
    assert figure is not None and (get_y(figure, "ref_throttle", 1) == 0.5).all()
    log = make_log()
    assert plots.draw_other_references(make_data(log=CheckedLog(
        log.path, log.time, log.data, log.ref[["ref_vel_x"]], log.line, 0.1))) is None  # fmt: skip


# ---- shades and labels


def shade(time: np.ndarray, where: list[int]) -> list[tuple[float, float]]:
    figure = plots.Figure(["a", "b"], [100, 100])
    plots.shade_intervals(figure, 2, time, np.array(where, bool))
    assert all((s["xref"], s["yref"]) == ("x2", "y2 domain") for s in figure.layout["shapes"])
    return [(s["x0"], s["x1"]) for s in figure.layout["shapes"]]


def test_a_shade_goes_from_its_first_row_to_the_row_after_it():
    t = np.arange(8.0)
    assert shade(t, [1, 1, 0, 0, 1, 0, 1, 1]) == [(0, 2), (4, 5), (6, 7)]
    assert shade(t, [0] * 8) == [] and shade(t, [1] * 8) == [(0, 7)]


def test_of_too_many_shades_those_with_the_shortest_gaps_are_joined(monkeypatch):
    monkeypatch.setattr(plots, "MAX_SHADES", 3)
    where = [1, 0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0]  # gaps of 1, 3, 2 and 4 rows
    assert shade(np.arange(16.0), where) == [(0, 3), (6, 10), (14, 15)]
    where = [1] * 6 + [0, 1, 0, 0, 1, 0, 0, 0, 1, 0]  # the first one is long
    assert shade(np.arange(16.0), where) == [(0, 8), (10, 11), (14, 15)]


def mark(changes: list[Change], spells: list[Spell], row: int = 1) -> tuple[list[float], list[tuple]]:
    figure = plots.Figure(["a", "b"], [100, 100])
    before = len(figure.layout["annotations"])
    plots.mark_events(figure, row, changes, spells)
    notes = figure.layout["annotations"][before:]
    assert [n["y"] for n in notes[:4]] == pytest.approx([0.95, 0.65, 0.35, 0.95][: len(notes)])
    assert {n["xref"] for n in notes} <= {f"x{figure.axis(row)}"}
    return [s["x0"] for s in figure.layout["shapes"]], [(n["x"], n["text"]) for n in notes]


def test_changes_have_lines_and_labels_in_order_of_time():
    lines, notes = mark(
        [Change(30.0, 1, 0.9, {}), Change(10.0, 2, 0.95, {})], [Spell("sliding", 20.0, 21.0, 0.99)], 2
    )
    assert lines == [30.0, 10.0]
    assert notes == [
        (10.0, "front axle changed at 10.00 s"),
        (20.0, "sliding 20.00 .. 21.00 s, 99 %"),
        (30.0, "road changed at 30.00 s"),
    ]


def test_of_too_many_events_the_likeliest_changes_and_the_longest_spells_have_labels(monkeypatch):
    monkeypatch.setattr(plots, "MAX_LABELS", 3)
    changes = [Change(float(t), 1, p, {}) for t, p in ((1, 0.95), (2, 0.91))]
    spells = [Spell("sliding", float(t), t + d, 0.99) for t, d in ((5, 0.5), (6, 2.0), (9, 1.0))]
    lines, notes = mark(changes, spells)
    assert [x for x, _ in notes] == [1, 2, 6] and lines == [1, 2]
    changes += [Change(float(t), 1, p, {}) for t, p in ((3, 0.99), (4, 0.97))]
    lines, notes = mark(changes, spells)
    assert [x for x, _ in notes] == [1, 3, 4] and len(lines) == 4


# ---- figures


def test_plots_are_as_high_as_asked_and_share_the_time_axis():
    figure = plots.Figure(["a", "b", "c"], [100, 200, 100])
    assert figure.height == 470 and [figure.axis(k) for k in (1, 2, 3)] == ["", "2", "3"]
    heights = [np.diff(figure.y_axis(k)["domain"])[0] for k in (1, 2, 3)]
    assert heights[1] == pytest.approx(2 * heights[0]) and heights[0] == pytest.approx(heights[2])
    assert figure.y_axis(1)["domain"][1] == 1 and figure.y_axis(3)["domain"][0] == pytest.approx(0, abs=1e-9)
    layout = figure.layout
    assert [layout[f"xaxis{k}"].get("matches") for k in ("", "2", "3")] == ["x3", "x3", None]
    assert layout["xaxis3"]["title"]["text"] == "time [s]"
    assert [a["y"] for a in layout["annotations"]] == [figure.y_axis(k)["domain"][1] for k in (1, 2, 3)]


def test_each_stiffness_is_drawn_with_interval_nominal_reference_and_where_it_is_not_valid():
    config = Config.exact()
    figure = plots.draw_stiffness(make_data(), make_table(), config)
    for row, key in enumerate(STIFFNESS, 1):
        value = 100 + 10 * (row - 1)
        nominal = getattr(config, NOMINAL[key]) / 1000
        assert get_y(figure, "mean, valid", row)[20:] == pytest.approx(value)
        assert get_y(figure, "not valid", row)[:20] == pytest.approx(value)
        low, high = find_traces(figure, "95 % interval", row)
        assert (low["y"][0], high["y"][0]) == pytest.approx((value - 3.92, value + 3.92))
        assert (low["fill"], high["fill"]) == ("none", "tonexty")
        assert get_y(figure, "nominal", row) == pytest.approx([nominal] * 2)
        assert find_traces(figure, "nominal", row)[0]["x"].tolist() == [TIME[0], TIME[-1]]
        assert find_traces(figure, "estimate", row)[0]["text"][0].endswith("not excited")
        assert figure.y_axis(row)["range"] == [0, pytest.approx(max(1.5 * nominal, 1.25 * value))]
    assert [float(t["y"][0]) for t in find_traces(figure, "reference")] == pytest.approx([90, 100])
    shapes = figure.layout["shapes"]
    assert [(s["x0"], s["x1"], s["yref"]) for s in shapes] == [
        (100.0, pytest.approx(102.0), f"y{k} domain") for k in ("", "2", "3")
    ]
    assert not find_traces(figure, "spread, 95 % of samples") and len(figure.layout["annotations"]) == 3


def test_shades_and_labels_are_at_the_times_of_the_estimates_and_of_every_event():
    table = make_table(estimate_age=0.25)
    spell = Spell("sliding", 102.0, 103.0, 0.99)
    figure = plots.draw_stiffness(make_data(table), table, Config.exact(), [], [spell])
    assert figure.layout["shapes"][0]["x0"] == pytest.approx(99.75)
    assert figure.layout["annotations"][-1]["text"] == spell.label


def test_a_filter_of_particles_has_the_spread_besides_and_no_value_is_cut_off():
    table = make_table()
    table["cy_rear"] = 4e5
    table["cx_front"] = np.nan
    table["cy_front"] = np.where(np.arange(N) > 30, 5e6, 1e5)
    config = Config.exact({"form": 1})
    figure = plots.draw_stiffness(make_data(table), table, config)
    low, high = find_traces(figure, "spread, 95 % of samples", 3)
    assert (low["y"][0], high["y"][0]) == pytest.approx((400 - 9.8, 400 + 9.8))
    assert figure.y_axis(3)["range"][1] == pytest.approx(500)
    nominal = [getattr(config, NOMINAL[k]) / 1000 for k in STIFFNESS]
    assert figure.y_axis(1)["range"][1] == pytest.approx(2 * nominal[0])  # no value
    assert figure.y_axis(2)["range"][1] == pytest.approx(6 * nominal[1])  # limit


def test_probabilities_are_stacked_below_the_stiffnesses():
    shares = dict(zip(REGIMES, (0.5, 0.2, 0.1, 0.1, 0.06, 0.04), strict=True))
    table = make_table(**{p: np.full(N, x) for p, x in shares.items()})
    figure = plots.draw_stiffness(make_data(table), table, Config.exact(), [Change(101.0, 1, 0.95, {})], [])
    for p, title in REGIMES.items():
        (trace,) = find_traces(figure, title, 4)
        assert trace["stackgroup"] == "regimes" and trace["y"] == pytest.approx(np.full(N, shares[p]))
    assert figure.layout["annotations"][-1]["xref"] == "x4" and figure.y_axis(4)["range"] == [0, 1]


def test_states_have_their_references_in_their_units():
    figure = plots.draw_states(make_data())
    assert len(figure.layout["annotations"]) == 4
    assert get_y(figure, "estimate", 4) == pytest.approx(np.full(N, np.degrees(0.05)))
    assert get_y(figure, "ref_beta", 4) == pytest.approx(np.full(N, np.degrees(0.02)))
    assert (get_y(figure, "ref_vel_x", 1) == 21).all() and get_y(figure, "ref_yaw_rate", 3)[0] == np.float32(
        0.3
    )
    assert (get_y(figure, "measured", 3) == make_log().data["yaw_rate"]).all()
    low, high = find_traces(figure, "95 % interval", 4)
    assert high["y"][0] - low["y"][0] == pytest.approx(2 * np.degrees(0.0196), rel=1e-5)
    figure = plots.draw_states(make_data(), True)
    names = (*plots.WITH_BAND, *plots.PLAIN)
    assert get_y(figure, "estimate", 5)[0] == pytest.approx(0.1 * (names.index("grip") + 1), rel=1e-6)


def test_inputs_are_the_channels_of_the_log():
    figure, log = plots.draw_inputs(make_data()), make_log()
    rows = {"steer_angle": 1, "wheel_speed_front": 2, "wheel_speed_rear": 2, "accel_x": 3, "accel_y": 3}
    for name, row in rows.items():
        assert (get_y(figure, name, row) == log.data[name]).all(), name
    (reference,) = find_traces(figure, "ref_wheel_rl", 2)
    assert reference["visible"] == "legendonly" and (np.asarray(reference["y"]) == 66).all()


def get_titles(figure: plots.Figure) -> list[str]:
    return [a["text"].partition(" [")[0].partition(".")[0] for a in figure.layout["annotations"]]


def test_health_has_biases_evidence_innovations_and_status_with_its_sentence():
    table = make_table(log_evidence=np.where(np.arange(N) == 9, -500.0, np.linspace(-1, 1, N)))
    for k, c in enumerate(MEASURES):
        table[f"nis_{c}"] = 1.0 + k
        table[f"bias_{c}"], table[f"bias_{c}_sd"] = 0.1 * k, 0.01
    figure = plots.draw_health(make_data(table))
    assert get_titles(figure) == [
        "Accelerometer biases",
        "Gyro bias",
        "Log-likelihood of each row",
        "Normalised innovation squared",
        "Status",
    ]
    for row, k in ((1, 0), (1, 1), (2, 2)):
        assert get_y(figure, f"bias_{MEASURES[k]}", row) == pytest.approx(np.full(N, 0.1 * k))
        low, high = find_traces(figure, f"bias_{MEASURES[k]} 95 %", row)
        assert (high["y"][0], low["y"][0]) == pytest.approx((0.1 * k + 0.0196, 0.1 * k - 0.0196), abs=1e-6)
    assert [get_y(figure, f"nis_{c}", 4)[0] for c in MEASURES] == [1, 2, 3]
    (status,) = find_traces(figure, "status", 5)
    assert set(status["text"]) == {library().codes(STATUS)[1].text} and status["line"]["shape"] == "hv"
    low, high = -500 + 0.005 * 59 * 499, 1 - 0.06 * 2 / 59  # 0.5 and 99.9 % of the rows
    more = 0.1 * (high - low) + 1
    assert figure.y_axis(3)["range"] == pytest.approx([low - more, high + more], rel=2e-3)
    assert get_y(figure, "log_evidence", 3)[9] == -500
    empty = plots.draw_health(make_data(make_table(log_evidence=np.full(N, np.nan))))
    assert "range" not in empty.y_axis(3)


def test_health_of_particles_has_their_number():
    figure = plots.draw_health(make_data(make_table(n_eff=np.linspace(50, 80, N))))
    assert get_titles(figure)[3] == "Effective particles"
    assert get_y(figure, "n_eff", 4)[0] == 50 and not find_traces(figure, "nis_accel_x")


@pytest.mark.parametrize(
    ("noise", "rows", "drawn"),
    [
        (1.39, slice(None), False),
        (1.5, slice(None), True),
        (1.5, slice(0, 20), False),
        (1.5, slice(40, 41), True),
    ],
)
def test_noise_is_drawn_if_a_channel_has_more_after_the_filter_has_settled(noise, rows, drawn):
    table = make_table()
    table.loc[table.index[rows], "noise_yaw_rate"] = noise
    table["discrepancy_yaw_rate"], table["lag_steer"], table["discrepancy_accel_x"] = 0.02, -0.01, 0.1
    figure = plots.draw_health(make_data(table))
    titles = get_titles(figure)
    assert ("Ratio of the estimated noise to the settings" in titles) == drawn
    assert titles[5 + drawn :] == [
        "Model discrepancy of the yaw rate, sd",
        "Estimated lag of the steering angle",
    ]
    assert get_y(figure, "discrepancy_yaw_rate", 6 + drawn)[0] == pytest.approx(0.02)
    assert get_y(figure, "lag_steer", 7 + drawn)[0] == pytest.approx(-0.01)
    if drawn:
        assert get_y(figure, "noise_yaw_rate", 6).max() == pytest.approx(noise)
        assert (get_y(figure, "noise_accel_x", 6) == 1).all()


def test_curves_of_a_replay_lie_below_each_other():
    t = np.arange(3.0)
    figure = plots.draw_lines([("a", [("x", t, t), ("y", t, 2 * t)]), ("b", [("z", t, 3 * t)])])
    assert [(d.name, d.yaxis, d.y[2]) for d in figure.data] == [("x", "y", 2), ("y", "y", 4), ("z", "y2", 6)]
    assert figure.layout.height == 440 and figure.layout.xaxis2.title.text == "time [s]"
    assert [a.text for a in figure.layout.annotations] == ["a", "b"]


def test_a_picture_is_written_at_the_end_of_its_style_and_needs_matplotlib(tmp_path, monkeypatch):
    """pyplot is made up: its import takes a second. Whole runs draw with the real one."""
    pyplot = MagicMock()
    pyplot.savefig.side_effect = lambda file, **_: file.write(b"picture")
    monkeypatch.setitem(sys.modules, "matplotlib", SimpleNamespace(use=MagicMock(), pyplot=pyplot))
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", pyplot)
    with plots.open_picture(tmp_path / "p.png", {"font.size": 5}) as plt:
        assert plt is pyplot and pyplot.rc_context.call_args.args == ({"font.size": 5},)
        assert not (tmp_path / "p.png").exists() and not pyplot.close.called
    assert (tmp_path / "p.png").read_bytes() == b"picture" and pyplot.close.called
    assert pyplot.savefig.call_args.kwargs["format"] == "png"
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UserError, match="pip install 'tse"), plots.open_picture(tmp_path / "q.png"):
        pass
