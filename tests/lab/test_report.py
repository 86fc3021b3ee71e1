"""The report: one file, nothing from outside, all that was promised in it."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest

from conftest import tselab_here


@pytest.fixture(scope="module")
def page(drive, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    vehicle = folder / "bare.toml"
    text = drive.vehicle.read_text().split("[sensors]")[0]
    vehicle.write_text(
        "\n".join(line for line in text.splitlines() if "stiffness_" not in line) + '\n["<b>red</b>"]\nshade = 1\n'
    )
    done = tselab_here(
        "estimate", drive.log, "--vehicle", vehicle, "--particles", 100, "--report", "r.html", cwd=folder
    )
    assert done.code == 0, done.err
    return (folder / "r.html").read_text(encoding="utf-8"), done


def test_loads_nothing_and_stays_small(page):
    html, _ = page
    assert not re.search(r"<(script|link|img|iframe)[^>]+(src|href)\s*=", html)
    assert not re.search(r"@import|url\(\s*['\"]?http", html)
    assert len(html) < 5_000_000


def test_figures_hold_stiffness_states_inputs_and_health(page):
    from tse.impl.report import figures_of

    figures = figures_of(page[0])
    names = [{trace["name"] for trace in figure["data"]} for figure in figures]
    assert {
        "mean, valid",
        "95 % interval",
        "nominal",
        "reference",
    } <= names[0]
    assert {"estimate", "95 % interval", "measured", "ref_vel_x", "ref_vel_y", "ref_yaw_rate"} <= names[1]
    assert {"steer_angle", "wheel_speed_front", "accel_y"} <= names[2]
    assert {"log_evidence", "nis", "status", "bias_yaw_rate"} <= names[3]
    assert any(shape["type"] == "rect" for shape in figures[0]["layout"]["shapes"])


def test_says_verdict_rules_and_settings(page):
    html, done = page
    assert "Front cornering stiffness" in html and "valid" in html
    for line in (r for r in done.out.splitlines() if r.startswith("filled in: ")):
        assert line.removeprefix("filled in: ") in html
    assert "cornering_stiffness_front" in html and "rule: an ordinary car of its mass and axles" in html
    for text in ("<h3>Sideslip angle</h3>", "Value and 95 % interval"):
        assert text in html
    assert "settings that differ from the defaults" in html


def test_text_of_the_user_is_escaped(page):
    assert "<b>red</b>" not in page[0] and "&lt;b&gt;red&lt;/b&gt;" in page[0]


@pytest.mark.parametrize(
    ("column", "quantity"),
    [("ref_vel_x", "vel_x"), ("ref_vehicle_speed", "vel_x"), ("ref_yaw_rate_phone", "yaw_rate"), ("ref_cy_rear", "cy_rear"),
     ("ref_cx_front_n", "cx_front"), ("ref_wheel_fl", "wheel_speed_front"), ("ref_wheel_rr", "wheel_speed_rear"),
     ("ref_throttle_pct", None), ("ref_vel_z", None), ("ref_steering_wheel", None)],
)  # fmt: skip
def test_reference_columns_find_their_quantity(column, quantity):
    from tse.impl.plots import match_reference

    assert match_reference(column) == quantity


def table_of(valid: list[int], reason: str, mean: float = 98e3, seen: int = 1, noise: float = 1.0):
    rows = {"time": range(len(valid)), "status": [0 if v else 1 for v in valid]}
    rows |= {
        "noise_accel_x": [noise] * len(valid),
        "noise_accel_y": [1.0] * len(valid),
        "noise_yaw_rate": [1.0] * len(valid),
    }
    for key in ("cx_front", "cy_front", "cy_rear"):
        rows |= {key: [mean] * len(valid), f"{key}_sd": [1500.0] * len(valid), f"{key}_spread": [5000.0] * len(valid)}
        rows |= {f"{key}_spread_seen": [seen] * len(valid)}
        rows |= {f"{key}_valid": valid, f"{key}_reason": ["valid" if v else reason for v in valid]}
    return pd.DataFrame(rows)


def verdict_of(*args, **more):
    from tse.impl.core import Config
    from tse.impl.verdict import verdicts

    return verdicts(table_of(*args, **more), Config())


def test_verdict_gives_value_band_share_and_distance_to_nominal():
    front = verdict_of([1] * 62 + [0] * 38, "not excited")[1]
    assert front.text.startswith("98 kN/rad ± 3 (95 %), valid 62 % of the time; 18 % below nominal")
    assert "too little steering excitation" in front.text and front.level == "good"
    assert "spread 5 % from sample to sample" in front.text


def test_a_spread_that_cannot_be_seen_is_not_given():
    (front,) = verdict_of([1] * 100, "", seen=0)[1:2]
    assert np.isnan(front.spread) and "spread" not in front.text


def test_the_value_is_that_at_the_end_of_particles_the_median():
    """The filter of the car knows most at the end; particles forget."""
    from tse.impl.core import Config
    from tse.impl.verdict import verdicts

    table = table_of([1] * 90 + [0] * 10, "uncertain")
    table["cy_front"] = 98e3 + 100.0 * np.arange(100)
    table["cy_front_sd"] = 3e3 - 10.0 * np.arange(100)
    end, median = (verdicts(table, Config({"form": form}))[1] for form in (0, 1))
    assert end.value == pytest.approx(98 + 8.9) and end.band == pytest.approx(1.96 * (3 - 0.89))
    assert median.value == pytest.approx(98 + 4.45) and (end.low, end.high) == (
        end.value - end.band,
        end.value + end.band,
    )


def test_grip_and_sideslip_have_their_intervals():
    from tse.impl.core import Config
    from tse.impl.verdict import others

    table = table_of([1] * 100, "")
    assert others(table, Config({"grip_sd": 0.2})) == []  # a table without them
    angle = np.where(np.arange(100) == 40, -0.05, 0.01)
    table = table.assign(
        grip=0.9, grip_sd=0.1, grip_valid=0, grip_reason="uncertain", sideslip=angle, sideslip_sd=0.002
    )
    table.loc[70, ["sideslip", "status"]] = [0.5, 4]  # held
    grip, slip = others(table, Config({"grip_sd": 0.2}))
    assert grip.line() == "Grip: 0.90 ± 0.20 (95 %), not valid: uncertain, the tyres were not driven near their limit"
    assert slip.line() == "Sideslip angle: -2.86 ± 0.22 deg (95 %), the largest, at 40.0 s; median interval ± 0.22"
    assert [q.key for q in others(table, Config())] == ["sideslip"]  # a grip that is assumed exact is no estimate
    assert others(table, Config({"grip_sd": 0.2, "form": 1})) == []
    known = others(table.assign(grip_valid=1, grip_reason="valid"), Config({"grip_sd": 0.2}))[0]
    assert known.line() == "Grip: 0.90 ± 0.20 (95 %), valid 100 % of the time"


def test_remarks_name_noise_and_contradictions():
    from tse.impl.verdict import remarks

    assert remarks(table_of([1] * 100, "")) == remarks(table_of([1] * 100, "", noise=1.2)) == []
    assert remarks(table_of([1] * 100, "", noise=2.94)) == ["accel_x is noisier than the settings say: x2.9"]
    assert remarks(table_of([1] * 40 + [0] * 5 + [1] * 50 + [0] * 5, "diverging")) == [
        "a sensor was probably at fault 2 times, in 10 % of the log: not valid there"
    ]
    assert "at fault once, in under 1 % of" in remarks(table_of([1] * 400 + [0], "diverging"))[0]


def test_a_fault_that_lasts_while_the_car_stands_is_as_long_as_its_spell():
    """A row of a car that stands is held, whatever its channels: the fault of which the list tells is in the share, too."""
    from tse.impl.regimes import spells
    from tse.impl.verdict import remarks

    table = table_of([1] * 40 + [0] * 20 + [1] * 40, "diverging")
    for key in ("cx_front", "cy_front", "cy_rear"):
        table.loc[50:59, f"{key}_reason"] = "held"
    table = table.assign(p_fault=np.where(np.arange(100) // 20 == 2, 0.99, 0.01), fault_channel=4)
    (spell,) = spells(table)
    assert (spell.start, spell.end) == (table.time[40], table.time[59])
    assert remarks(table) == ["a sensor was probably at fault once, in 20 % of the log: not valid there"]


def test_noise_is_drawn_where_it_is_not_what_the_settings_say(drive, tmp_path):
    from tse.impl.report import figures_of

    table = pd.read_csv(drive.log)
    table["accel_y"] += 0.6 * np.random.default_rng(1).standard_normal(len(table))
    table.to_csv(tmp_path / "noisy.csv", index=False)
    for log, noisy in ((drive.log, False), ("noisy.csv", True)):
        done = tselab_here(
            "estimate", log, "--vehicle", drive.vehicle, "--particles", 100, "--report", "r.html", cwd=tmp_path
        )
        assert done.code == 0, done.err
        page = (tmp_path / "r.html").read_text(encoding="utf-8")
        names = {trace["name"] for trace in figures_of(page)[3]["data"]}
        assert ("noise_accel_y" in names) == noisy
        for text in (done.err, page):
            assert ("accel_y is noisier than the settings say: x" in text) == noisy


def test_where_no_row_is_valid_value_and_interval_are_given_and_why_not():
    for v in verdict_of([0] * 100, "not excited"):
        assert v.level == "none" and v.value == pytest.approx(98) and v.band == pytest.approx(1.96 * 1.5)
        assert "± 3 (95 %), not valid: not excited: " in v.text and v.detail.startswith("not valid")
    front = verdict_of([0] * 100, "parameters uncertain")[1]
    assert "not valid: parameters uncertain, its sd 2 %, limit 10 %: too uncertain parameters of the car" in front.text
    from tse.impl.core import Config
    from tse.impl.verdict import verdicts

    refused = table_of([0] * 5, "row refused").assign(status=-3)
    assert [(v.level, v.text) for v in verdicts(refused, Config())] == [
        ("none", "no value: row refused, the rows were refused")
    ] * 3
