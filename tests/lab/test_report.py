"""The report: one file, nothing from outside, all that was promised in it."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from test_what_happened import CALM, ROAD
from test_what_happened import make_table as table_of_events

from conftest import tselab_here
from tse.car.vehicle import make_default_vehicle
from tse.estimation.estimate import Estimates
from tse.estimation.regimes import REGIMES, find_changes, find_spells
from tse.estimation.verdict import check_steering_lag, list_other_quantities, list_remarks, make_verdicts
from tse.gaps.run.pictures import draw_overlay
from tse.library.core import STIFFNESS, Config
from tse.log.rows import CheckedLog, list_columns
from tse.report import plots
from tse.report.plots import match_reference
from tse.report.report import read_figures, write_report


@pytest.fixture(scope="module")
def page(drive, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    vehicle = folder / "bare.toml"
    text = drive.vehicle.read_text().split("[sensors]")[0]
    vehicle.write_text(
        "\n".join(line for line in text.splitlines() if "stiffness_" not in line)
        + '\n["<b>red</b>"]\nshade = 1\n'
    )
    done = tselab_here(
        "estimate", "--verbose", drive.log, "--vehicle", vehicle, "--report", "r.html", cwd=folder
    )
    assert done.code == 0, done.err
    return (folder / "r.html").read_text(encoding="utf-8"), done


def test_loads_nothing_and_stays_small(page):
    html, _ = page
    assert not re.search(r"<(script|link|img|iframe)[^>]+(src|href)\s*=", html)
    assert not re.search(r"@import|url\(\s*['\"]?http", html)
    assert len(html) < 5_000_000


def test_figures_hold_stiffness_states_inputs_and_health(page):
    figures = read_figures(page[0])
    names = [{trace["name"] for trace in figure["data"]} for figure in figures]
    assert {"mean, valid", "95 % interval", "nominal", "reference"} <= names[0]
    assert {"estimate", "95 % interval", "measured", "ref_vel_x", "ref_vel_y", "ref_yaw_rate"} <= names[1]
    assert {"steer_angle", "wheel_speed_front", "accel_y"} <= names[2]
    assert {"log_evidence", "nis_accel_x", "nis_yaw_rate", "status", "bias_yaw_rate"} <= names[3]
    assert any(shape["type"] == "rect" for shape in figures[0]["layout"]["shapes"])


def test_says_verdict_rules_and_settings(page):
    html, done = page
    assert "Front cornering stiffness" in html and "valid" in html
    for line in (r for r in done.out.splitlines() if r.startswith("filled in: ")):
        assert line.removeprefix("filled in: ") in html
    assert "cornering_stiffness_front" in html and "rule: an ordinary car of its mass and axles" in html
    for text in ("<h3>Sideslip angle</h3>", "Smoothed over the log, with 95 % interval", "At its end"):
        assert text in html
    assert "settings that differ from the defaults" in html


def test_text_of_the_user_is_escaped(page):
    assert "<b>red</b>" not in page[0] and "&lt;b&gt;red&lt;/b&gt;" in page[0]


@pytest.mark.parametrize(
    ("column", "quantity"),
    [
        ("ref_vel_x", "vel_x"),
        ("ref_vehicle_speed", "vel_x"),
        ("ref_yaw_rate_phone", "yaw_rate"),
        ("ref_cy_rear", "cy_rear"),
        ("ref_cx_front_n", "cx_front"),
        ("ref_wheel_fl", "wheel_speed_front"),
        ("ref_wheel_rr", "wheel_speed_rear"),
        ("ref_throttle_pct", None),
        ("ref_vel_z", None),
        ("ref_steering_wheel", None),
    ],
)
def test_reference_columns_find_their_quantity(column, quantity):
    assert match_reference(column) == quantity


def make_table(valid: list[int], reason: str, mean: float = 98e3, seen: int = 1, noise: float = 1.0):
    rows = {"time": range(len(valid)), "status": [0 if v else 1 for v in valid]}
    rows |= {
        "noise_accel_x": [noise] * len(valid),
        "noise_accel_y": [1.0] * len(valid),
        "noise_yaw_rate": [1.0] * len(valid),
    }
    for key in ("cx_front", "cy_front", "cy_rear"):
        rows |= {
            key: [mean] * len(valid),
            f"{key}_sd": [1500.0] * len(valid),
            f"{key}_spread": [5000.0] * len(valid),
        }
        rows |= {f"{key}_spread_seen": [seen] * len(valid)}
        rows |= {f"{key}_valid": valid, f"{key}_reason": ["valid" if v else reason for v in valid]}
    return pd.DataFrame(rows)


def make_verdict(*args, **more):
    return make_verdicts(make_table(*args, **more), Config.exact())


def test_verdict_gives_value_band_share_and_distance_to_nominal():
    front = make_verdict([1] * 62 + [0] * 38, "not excited")[1]
    assert front.text.startswith("98 kN/rad ± 3 (95 %), valid 62 % of the time; 18 % below nominal")
    assert "too little steering excitation" in front.text and front.level == "good"
    assert "spread 5 % from sample to sample" in front.text


def test_a_spread_that_cannot_be_seen_is_not_given():
    (front,) = make_verdict([1] * 100, "", seen=0)[1:2]
    assert np.isnan(front.spread) and "spread" not in front.text


def test_the_value_is_that_at_the_end_of_particles_the_median():
    """The filter of the car knows most at the end; particles forget."""
    table = make_table([1] * 90 + [0] * 10, "uncertain")
    table["cy_front"] = 98e3 + 100.0 * np.arange(100)
    table["cy_front_sd"] = 3e3 - 10.0 * np.arange(100)
    end, median = (make_verdicts(table, Config.exact({"form": form}))[1] for form in (0, 1))
    assert end.value == pytest.approx(98 + 8.9) and end.band == pytest.approx(1.96 * (3 - 0.89))
    assert median.value == pytest.approx(98 + 4.45) and (end.low, end.high) == (
        end.value - end.band,
        end.value + end.band,
    )
    table["cy_front"] = np.where(np.arange(100) < 60, 98e3, 70e3)  # another road: no number is that of both
    assert make_verdicts(table, Config.exact({"form": 1}))[1].value == pytest.approx(70)


@pytest.mark.parametrize(
    ("reason", "level"), [("uncertain", "good"), ("implausible", "partly"), ("sensor fault", "partly")]
)
def test_a_log_that_ends_with_a_channel_at_fault_is_good_in_part(reason: str, level: str) -> None:
    assert make_verdict([1] * 60 + [0] * 40, reason)[1].level == level
    assert make_verdict([1] * 30 + [0] * 40 + [1] * 30, reason)[1].level == "good"


def test_grip_and_sideslip_have_their_intervals():
    table = make_table([1] * 100, "")
    assert list_other_quantities(table, Config.exact({"grip_sd": 0.2})) == []  # a table without them
    angle = np.where(np.arange(100) == 40, -0.05, 0.01)
    table = table.assign(
        grip=0.9, grip_sd=0.1, grip_valid=0, grip_reason="uncertain", sideslip=angle, sideslip_sd=0.002
    )
    table.loc[70, ["sideslip", "status"]] = [0.5, 4]  # held
    grip, slip = list_other_quantities(table, Config.exact({"grip_sd": 0.2}))
    assert (
        grip.line()
        == "Grip: 0.90 ± 0.20 (95 %), not valid: uncertain, the tyres were not driven near their limit"
    )
    assert (
        slip.line()
        == "Sideslip angle: -2.86 ± 0.22 deg (95 %), the largest, at 40.0 s; median interval ± 0.22"
    )
    assert [q.key for q in list_other_quantities(table, Config.exact())] == [
        "sideslip"
    ]  # a grip that is assumed exact is no estimate
    assert list_other_quantities(table, Config.exact({"grip_sd": 0.2, "form": 1})) == []
    known = list_other_quantities(
        table.assign(grip_valid=1, grip_reason="valid"), Config.exact({"grip_sd": 0.2})
    )[0]
    assert known.line() == "Grip: 0.90 ± 0.20 (95 %), valid 100 % of the time"


def test_remarks_name_noise_and_contradictions():
    assert list_remarks(make_table([1] * 100, "")) == list_remarks(make_table([1] * 100, "", noise=1.2)) == []
    assert list_remarks(make_table([1] * 100, "", noise=2.94)) == [
        "accel_x: the estimated noise sd is 2.9 times its setting"
    ]
    assert list_remarks(make_table([1] * 40 + [0] * 5 + [1] * 50 + [0] * 5, "sensor fault")) == [
        "a sensor was probably at fault 2 times, in 10 % of the log: not valid there"
    ]
    assert "at fault once, in under 1 % of" in list_remarks(make_table([1] * 400 + [0], "sensor fault"))[0]


@pytest.mark.parametrize(
    ("late", "said"), [(0.023, ""), (-0.023, ""), (-0.025, "25 ms later"), (0.025, "25 ms earlier")]
)
def test_a_steering_angle_that_is_not_as_late_as_calibrated_is_named(late, said):
    table = make_table([1] * 100, "")
    assert check_steering_lag(table, Config.exact({"steer_lag_sd": 0.008})) == []  # a table without it
    found = check_steering_lag(table.assign(lag_steer=late), Config.exact({"steer_lag_sd": 0.008}))
    assert [said in text for text in found] == ([True] if said else [])
    assert (
        check_steering_lag(table.assign(lag_steer=late), Config.exact({"steer_lag_sd": 0.0})) == []
    )  # known exactly: no state
    delayed = Config.exact(
        {"steer_lag_sd": 0.008, "steering_delay_time": 0.05, "imu_delay_time": 0.03}
    )  # the mean of the prior
    assert check_steering_lag(table.assign(lag_steer=0.08 + late), delayed) == found


def test_a_fault_that_lasts_while_the_car_stands_is_as_long_as_its_spell():
    """A row of a standing car is held, whatever its channels.

    The fault that the list names is in the share, too.
    """
    table = make_table([1] * 40 + [0] * 20 + [1] * 40, "sensor fault")
    for key in ("cx_front", "cy_front", "cy_rear"):
        table.loc[50:59, f"{key}_reason"] = "held"
    table = table.assign(p_fault=np.where(np.arange(100) // 20 == 2, 0.99, 0.01), fault_channel=4)
    (spell,) = find_spells(table)
    assert (spell.start, spell.end) == (table.time[40], table.time[59])
    assert list_remarks(table) == ["a sensor was probably at fault once, in 20 % of the log: not valid there"]


def test_noise_is_drawn_where_it_is_not_what_the_settings_say(drive, tmp_path):
    table = pd.read_csv(drive.log)
    table["accel_y"] += 0.6 * np.random.default_rng(1).standard_normal(len(table))
    table.to_csv(tmp_path / "noisy.csv", index=False)
    for log, noisy in ((drive.log, False), ("noisy.csv", True)):
        done = tselab_here(
            "estimate", "--verbose", log, "--vehicle", drive.vehicle, "--report", "r.html", cwd=tmp_path
        )
        assert done.code == 0, done.err
        page = (tmp_path / "r.html").read_text(encoding="utf-8")
        names = {trace["name"] for trace in read_figures(page)[3]["data"]}
        assert ("noise_accel_y" in names) == noisy
        for text in (done.err, page):
            assert ("accel_y: the estimated noise sd is" in text) == noisy


def test_where_no_row_is_valid_value_and_interval_are_given_and_why_not():
    for v in make_verdict([0] * 100, "not excited"):
        assert v.level == "none" and v.value == pytest.approx(98) and v.band == pytest.approx(1.96 * 1.5)
        assert "± 3 (95 %), not valid: not excited: " in v.text and v.detail.startswith("not valid")
    front = make_verdict([0] * 100, "parameters uncertain")[1]
    assert (
        "not valid: parameters uncertain, its sd 2 %, limit 10 %: the car's parameters are too uncertain"
        in front.text
    )

    refused = make_table([0] * 5, "row refused").assign(status=-3)
    assert [(v.level, v.text) for v in make_verdicts(refused, Config.exact())] == [
        ("none", "no value: row refused, the rows were refused")
    ] * 3


# ---- The report's figures: thinned without losing a peak, and such as plotly takes them.


def make_estimates(n: int) -> tuple[CheckedLog, pd.DataFrame]:
    """Make up a log and estimates of n rows."""
    rng = np.random.default_rng(n)
    time = 0.01 * np.arange(n)
    data = pd.DataFrame({c: rng.standard_normal(n) for c in list_columns()[1:]})
    ref = pd.DataFrame(
        {"ref_vel_x": 20 + data["accel_x"], "ref_cy_rear": np.full(n, 1.4e5), "ref_throttle": data["accel_y"]}
    )
    log = CheckedLog(Path("made-up.csv"), time, data, ref, np.arange(n) + 2, 0.01)
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


def test_the_card_says_what_held_and_beside_it_what_the_end_says(tmp_path):
    """Of a filter that doubts in its last rows."""
    log, table = make_estimates(6000)
    told = table_of_events(CALM)
    table = pd.concat([table.drop(columns=[c for c in table if c in told]), told], axis=1)
    table.loc[table.index[-20:], ["cy_front", "cy_front_sd"]] = [100e3, 30e3]
    sd = {"model_sd": np.full(3, 0.009)}
    write_report(
        tmp_path / "r.html",
        Estimates(table, False, uncertainty_sd=sd),
        log,
        make_default_vehicle(),
        Config.exact(),
        [],
    )
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    card = page.split("<h3>Front cornering stiffness</h3>")[1].split("</p>")[0]
    assert (
        re.search(r"120 <small>± \d kN/rad", card)
        and "; at the end 100 ± 59" in card
        and "smoothed" not in card
    )


def make_figures(data: plots.Data, table: pd.DataFrame) -> list[plots.Figure]:
    made = [
        plots.draw_stiffness(data, table, Config.exact()),
        plots.draw_states(data),
        plots.draw_inputs(data),
        plots.draw_health(data),
        plots.draw_other_references(data),
    ]
    return [f for f in made if f is not None]


@pytest.mark.parametrize(("n", "stride"), [(1, 4), (1000, 8), (1001, 8), (1007, 16)])
def test_every_peak_survives_in_its_place(n, stride):
    y = np.random.default_rng(n).standard_normal(n)
    y[n // 2] = 50.0
    y[n // 3] = -50.0
    thinned, at = plots.thin_rows(y, stride), plots.pick_rows(n, stride)
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
    assert np.array_equal(plots.thin_rows(y, 4), [1, 2, np.nan, np.nan, 3, 3], equal_nan=True)


def test_what_a_screen_can_show_is_not_thinned():
    y = np.arange(7.0)
    assert plots.thin_rows(y, plots.find_block_stride(plots.MAX_POINTS)) is y
    for n in (plots.MAX_POINTS + 1, 10**5, 360_000, 8 * 10**6):
        stride = plots.find_block_stride(n)
        assert stride & (stride - 1) == 0 and plots.MAX_POINTS / 2 * 0.9 < 2 * n / stride <= plots.MAX_POINTS


@pytest.mark.parametrize("n", [1, 500, 20001])
def test_figures_are_what_plotly_takes(n):
    import plotly.graph_objects as go

    log, table = make_estimates(n)
    data = plots.Data(log)
    data.add(table)
    for figure in make_figures(data, table):
        checked = go.Figure(figure.as_dict())  # refuses every key and value that it does not know
        assert checked.layout.height == figure.height
        for trace in checked.data:
            assert len(trace.x) == len(trace.y)
        domains = [figure.layout[k]["domain"] for k in figure.layout if k.startswith("yaxis")]
        assert all(0 <= low < high <= 1 for low, high in domains)
        assert all(below[1] < above[0] for above, below in pairwise(domains))


def test_drawn_block_by_block_is_drawn_as_a_whole():
    log, table = make_estimates(20001)
    whole, parts = plots.Data(log), plots.Data(log)
    whole.add(table)
    for start in range(0, len(table), 4096):
        parts.add(table.iloc[start : start + 4096])
    a, b = ([f.as_dict() for f in make_figures(d, table)] for d in (whole, parts))
    assert whole.stride == 8
    for x, y in zip(a, b, strict=True):
        assert x["layout"] == y["layout"]
        for one, other in zip(x["data"], y["data"], strict=True):
            assert np.array_equal(one["x"], other["x"]) and np.array_equal(
                one["y"], other["y"], equal_nan=True
            )


def test_an_interrupted_run_is_drawn_as_far_as_it_came():
    log, table = make_estimates(20001)
    data = plots.Data(log)
    data.add(table.iloc[:4096])
    data.add(table.iloc[4096:5000])
    for figure in make_figures(data, table.iloc[:5000]):
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
    assert abs(x[np.nanargmax(drawn)] - time[3_001]) < 0.04 * plots.find_stride(20_000, 3_000)
    assert np.isnan(drawn).sum() == 1 and np.all(np.diff(x) >= 0)
    same = plots.thin_line(time[:100], y[:100], 3_000, 1.0)
    assert np.array_equal(same[0], time[:100]) and np.array_equal(same[1], y[:100])


def test_a_peak_is_in_the_gap_reports_lines_of_a_long_log():
    """A spike of one block stays visible.

    When the lines were thinned to every n-th row, it was lost in six of seven places.
    """
    n = 21_000
    table = pd.DataFrame(
        {
            "part": "fit",
            "log": "long",
            "channel": pd.Categorical(["accel_y"] * n),
            "time": 0.04 * np.arange(n),
        }
    )
    for column in ("measured", "predicted_before", "predicted_after", "residual_before"):
        table[column] = 0.0
    table.loc[12_345, "measured"] = 30.0
    lines = {trace.name: np.asarray(trace.y, float) for trace in draw_overlay(table).data}
    assert np.nanmax(lines["measured"]) == 30.0 and len(lines["measured"]) <= 3_100
    assert np.nanmax(lines["before"]) == 0.0


# ---- The report of a drive on which something happened, from made-up tables.


def drive(told, seconds: float = 200.0):
    """Return a log and estimates with all columns that the report draws."""
    table = table_of_events(told, seconds)
    log, other = make_estimates(len(table))
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
    figure = plots.draw_stiffness(data, table, Config.exact(), find_changes(table), find_spells(table))
    go.Figure(figure.as_dict())
    texts = [a["text"] for a in figure.layout["annotations"]]
    assert "road changed at 36.03 s" in texts and "yaw_rate at fault 20.00 .. 22.00 s, 95 %" in texts
    assert set(REGIMES.values()) <= {t["name"] for t in figure.data}
    lines = [s for s in figure.layout["shapes"] if s["type"] == "line"]
    assert [s["x0"] for s in lines] == [pytest.approx(36.03)]
    health = plots.draw_health(data)
    go.Figure(health.as_dict())
    assert {"discrepancy_accel_x", "discrepancy_yaw_rate"} <= {t["name"] for t in health.data}


def test_the_report_speaks_of_every_stretch_and_lists_what_happened(tmp_path):
    log, table = drive(
        [(0, 36.1, None), (36.1, 120, (36.03, 1, 0.97, 0.7)), (120, 200, (119.9, 2, 0.93, 1.2))]
    )
    write_report(
        tmp_path / "r.html", Estimates(table, False), log, make_default_vehicle(), Config.exact(), []
    )
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    for text in (
        "What happened",
        "<td>road changed</td>",
        "36.03 s",
        "front cornering x 0.70",
        "From 0.0 .. 36.0 s",
        "From 36.0 .. 119.9 s",
        "From 119.9 .. 200.0 s",
        "<td>front axle changed</td>",
    ):
        assert text in page, text
    assert "<h3>Grip</h3>" not in page  # a setting, no estimate
    calm = drive(CALM)[1]
    write_report(
        tmp_path / "calm.html",
        Estimates(calm, False),
        log,
        make_default_vehicle(),
        Config.exact({"grip_sd": 0.2}),
        [],
    )
    page = (tmp_path / "calm.html").read_text(encoding="utf-8")
    assert "<h3>Grip</h3>" in page and "<h3>Sideslip angle</h3>" in page
    assert "What happened</h2>" not in page and "<th>Stretch</th>" not in page
