"""The report: one file, nothing from outside, all that was promised in it."""

from __future__ import annotations

import re

import pandas as pd
import pytest

from conftest import tselab


@pytest.fixture(scope="module")
def page(drive, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    vehicle = folder / "bare.toml"
    text = drive.vehicle.read_text().split("[sensors]")[0]
    vehicle.write_text(
        "\n".join(line for line in text.splitlines() if "stiffness_" not in line) + '\ncolour = "<b>red</b>"\n'
    )
    done = tselab("estimate", drive.log, "--vehicle", vehicle, "--particles", 100, "--report", "r.html", cwd=folder)
    assert done.code == 0, done.err
    return (folder / "r.html").read_text(encoding="utf-8"), done


def test_loads_nothing_and_stays_small(page):
    html, _ = page
    assert not re.search(r"<(script|link|img|iframe)[^>]+(src|href)\s*=", html)
    assert not re.search(r"@import|url\(\s*['\"]?http", html)
    assert len(html) < 5_000_000


def test_figures_hold_stiffness_states_inputs_and_health(page):
    from tselab.report import figures_of

    figures = figures_of(page[0])
    names = [{trace["name"] for trace in figure["data"]} for figure in figures]
    assert {
        "mean, valid",
        "95 % band of the mean",
        "spread, 95 % of samples",
        "nominal",
        "reference",
    } <= names[0]
    assert {"estimate", "measured", "ref_vel_x", "ref_vel_y", "ref_yaw_rate"} <= names[1]
    assert {"steer_angle", "wheel_speed_front", "accel_y"} <= names[2]
    assert {"log_evidence", "n_eff", "status", "bias_yaw_rate"} <= names[3]
    assert any(shape["type"] == "rect" for shape in figures[0]["layout"]["shapes"])


def test_says_verdict_rules_and_settings(page):
    html, done = page
    assert "Front cornering stiffness" in html and "valid" in html
    for line in (r for r in done.out.splitlines() if r.startswith("filled in: ")):
        assert line.removeprefix("filled in: ") in html
    assert "accel_x_sd" in html and "rule: 12 x axle load" in html
    assert "settings that differ from the defaults" in html


def test_text_of_the_user_is_escaped(page):
    assert "<b>red</b>" not in page[0]


@pytest.mark.parametrize(
    ("column", "quantity"),
    [("ref_vel_x", "vel_x"), ("ref_vehicle_speed", "vel_x"), ("ref_yaw_rate_phone", "yaw_rate"), ("ref_cy_rear", "cy_rear"),
     ("ref_cx_front_n", "cx_front"), ("ref_wheel_fl", "wheel_speed_front"), ("ref_wheel_rr", "wheel_speed_rear"),
     ("ref_throttle_pct", None), ("ref_vel_z", None), ("ref_steering_wheel", None)],
)  # fmt: skip
def test_reference_columns_find_their_quantity(column, quantity):
    from tselab.plots import match_reference

    assert match_reference(column) == quantity


def verdict_of(valid: list[int], reason: str, mean: float = 98e3):
    from tselab.core import Config
    from tselab.verdict import verdicts

    rows = {"time": range(len(valid))}
    for key in ("cx_front", "cy_front", "cy_rear"):
        rows |= {key: [mean] * len(valid), f"{key}_sd": [1500.0] * len(valid), f"{key}_spread": [5000.0] * len(valid)}
        rows |= {f"{key}_valid": valid, f"{key}_reason": ["valid" if v else reason for v in valid]}
    return verdicts(pd.DataFrame(rows), Config())


def test_verdict_gives_value_band_share_and_distance_to_nominal():
    front = verdict_of([1] * 62 + [0] * 38, "not excited")[1]
    assert front.text.startswith("98 kN/rad ± 3 (95 %), valid 62 % of the time; 18 % below nominal")
    assert "the steering was too quiet" in front.text and front.level == "good"


def test_verdict_of_a_quiet_log_gives_no_value():
    for v in verdict_of([0] * 100, "not excited"):
        assert v.level == "none" and v.text.startswith("not excited") and "says nothing about the tyres" in v.text
