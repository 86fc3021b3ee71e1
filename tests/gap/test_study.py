"""A seeded part of the study: the whole workflow on logs of the independent generator.

Also how the study judges, its long logs (whose runs take minutes, scale.py), and its
multi-body car against its own equations.
"""

import importlib
import json
import math
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest
from generator import Spec, make_cases

from tests.gap import scale, study
from tse.gaps.catalogue import load_catalogue
from tse.gaps.run.workflow import run_workflow

# the cases of a study; only scripts/results depends on them
pytestmark = pytest.mark.slow

MANOEUVRES = ("sine_sweep", "steps_slow", "brake_in_turn", "brake_throttle")
FEW = ("sine_sweep", "brake_in_turn")
HELD_OUT = ("slalom",)


def run_on_logs(
    tmp_path: Path,
    effects: dict[str, float],
    seed: int,
    manoeuvres: tuple[str, ...],
    hold_out: tuple[str, ...] = HELD_OUT,
) -> tuple[dict, dict, int]:
    """Run the workflow on 20 s of each manoeuvre.

    Few logs find the hidden effect. Many logs are the harder case for finding nothing
    else. With held-out logs the search runs twice.
    """
    case = next(
        make_cases([Spec("case", effects, seed, manoeuvres=manoeuvres, hold_out=hold_out, duration=20)])
    )
    folder = case.write(tmp_path / "case")
    result = run_workflow(
        sorted(folder.glob("log_*.csv")), folder / "car.toml", sorted(folder.glob("hold_out_*.csv")), jobs=2
    )
    return result.as_json(), case.truth, result.exit_code


@pytest.mark.slow
def test_a_clean_car_gets_no_name(tmp_path: Path) -> None:
    verdict, _, code = run_on_logs(tmp_path, {}, 101, MANOEUVRES)
    assert verdict["verdict"] == "none" and code == 0 and verdict["effects"] == []
    assert max(verdict["gap"]["fit"]["after"].values()) < 1.2
    # no speed, no torque in the log
    assert {"aero_drag", "rolling_resistance"} <= {d["id"] for d in verdict["undetectable"]}


# 15 %: the forms of the generator differ from the catalogue's
@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "key"), [("relaxation", "length"), ("wheel_radius", "change"), ("pitch_leak", "gain")]
)
def test_a_hidden_effect_is_named_with_its_size(tmp_path: Path, effect: str, key: str) -> None:
    verdict, truth, code = run_on_logs(tmp_path, {effect: 1.0}, 2, FEW)
    assert verdict["verdict"] == "named", json.dumps(verdict["words"])
    named = max(verdict["effects"], key=lambda e: e["evidence"])
    assert named["id"] == effect and code in (10, 11)
    true = next(iter(truth["effects"][0]["parameters"].values()))
    assert named["parameters"][key]["value"] == pytest.approx(true, rel=0.15)
    assert verdict["closed"] > 0.85
    assert max(verdict["gap"]["held_out"]["after"].values()) < 1.2


@pytest.mark.slow
def test_a_patch_of_low_grip_is_none_of_the_catalogue(tmp_path: Path) -> None:
    verdict, _, code = run_on_logs(tmp_path, {"low_grip_patch": 2.0}, 1, FEW, ())
    assert verdict["verdict"] != "named" or verdict["closed"] < 0.5, verdict["words"]
    assert code in (0, 20)


def test_a_part_of_the_study_does_not_take_the_place_of_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study, "RESULTS", tmp_path / "results")
    found = {"gap.md": "a table\n", "more.md": "cases\n"}
    assert study.write(found, False, None) == [] and not any(tmp_path.iterdir())
    assert study.write(found, False, tmp_path / "mine") == [tmp_path / "mine" / name for name in found]
    assert not (tmp_path / "results").exists()
    study.write(found, True, None)
    assert {p.name: p.read_text() for p in (tmp_path / "results").iterdir()} == found


def test_an_interval_holds_a_size_or_does_not() -> None:
    """By hand: size, interval and truth, either sign."""
    case = {
        "truth": [{"id": "body_roll", "parameters": {"gain": 0.008}}],
        "named": [{"id": "body_roll", "parameters": {"gain": {"value": 0.009, "ci95": [0.0085, 0.0095]}}}],
    }
    assert study.get_size(case) == (0.009, 0.0085, 0.0095, 0.008)
    assert study.compute_size_error(case) == pytest.approx(0.125)
    case["named"][0]["parameters"]["gain"] = {"value": -0.009, "ci95": [-0.010, -0.007]}
    assert study.get_size(case) == (0.009, 0.007, 0.010, 0.008)
    assert study.get_size({**case, "named": []}) is None and math.isnan(
        study.compute_size_error({**case, "named": []})
    )


# ---- long logs


@pytest.mark.slow
def test_logs_are_as_many_and_as_long_as_the_table_says(tmp_path: Path) -> None:
    scale.write_long_logs(tmp_path / "long", 12.0)
    assert len(list((tmp_path / "long").glob("log_*.csv"))) == 6
    assert len(list((tmp_path / "long").glob("hold_out_*.csv"))) == 2
    scale.write_many_logs(tmp_path / "many", 6.0)
    many = sorted((tmp_path / "many").glob("*.csv"))
    assert len(many) == 20
    for path in many:
        step = pd.read_csv(path)["time"].diff().dropna()
        assert step.min() > 0.0 and scale.measure_minutes(path) == pytest.approx(0.1, rel=0.01)


def test_memory_is_that_of_one_process() -> None:
    """Not the maximum of earlier ones.

    Measured in a small process: a process that starts another gives it its own size.
    """
    code = (
        "import sys; from scripts.dev.measured import measure_command\n"
        "for mb in (400, 1):\n"
        "    code = f'x = bytearray({mb} << 20); raise SystemExit(10)'\n"
        "    print(*measure_command(sys.executable, '-c', code, codes=[10]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=scale.ROOT, capture_output=True, text=True, check=True
    )
    large, small = ([float(x) for x in line.split()] for line in done.stdout.splitlines())
    assert large[0] == small[0] == 10
    assert 0.4e9 < large[3] < 0.6e9 and small[3] < 0.1e9


def test_a_row_of_the_table() -> None:
    row = scale.Row("long", "6, and 2 held out", 30.0, 10.0, 123.4, 1.234, "named: body_roll")
    assert (
        scale.make_table([row], 2).splitlines()[-1]
        == "| long | 6, and 2 held out | 30.0 | 10.0 | 123 | 1.23 | named: body_roll |"
    )


# ---- the multi-body car


@pytest.fixture(scope="module")
def multibody() -> ModuleType:
    pytest.importorskip("vehiclemodels", reason="the package commonroad-vehicle-models is not installed")
    return importlib.import_module("tests.gap.multibody")


def test_our_wheel_forces_are_those_of_the_package(multibody):
    """check(): the relative difference between both is rounding only."""
    car = multibody.make_parameters(2)
    x = multibody.hold_steering(car, 20.0, 0.03, 2.0)
    assert multibody.check(car, x) < 1e-9


def test_a_steady_turn_rolls_by_the_gain_of_the_truth(multibody):
    """Roll over lateral acceleration, driven against linearised: 5 %, at 3 m/s2."""
    car = multibody.make_parameters(2)
    roll, _, _, force = multibody.compute_outputs(car, multibody.hold_steering(car, 20.0, 0.02, 6.0))[:4]
    assert 1.0 < abs(force) < 5.0
    assert abs(roll / force) == pytest.approx(multibody.measure_roll_gain(car), rel=0.05)


def test_the_truth_has_every_effect_that_may_be_missing_and_no_other(multibody):
    """Exact kinematics is the model: a table that expects its name would be wrong."""
    car = multibody.make_parameters(2)
    ids = [e["id"] for e in multibody.make_truth(car)["effects"]]
    assert sorted(ids) == sorted(load_catalogue())


def test_the_table_says_sizes_beside_the_cars(multibody):
    truth = {"effects": [{"id": "body_roll", "parameter": "gain", "value": 0.016}]}
    effects = [
        {"id": "body_roll", "parameters": {"gain": {"value": 0.015}}},
        {"id": "mass", "parameters": {"change": {"value": 0.1}}},
    ]
    channels = ("accel_x", "accel_y", "yaw_rate")
    gap = {"held_out": {"before": dict.fromkeys(channels, 4.0), "after": dict.fromkeys(channels, 1.0)}}
    text = multibody.make_table({1: ({"effects": effects, "formula": None, "gap": gap}, truth)})
    assert "body_roll 0.015 (0.016), mass 0.1 (not there)" in text and text.count("4.00 -> 1.00, -75 %") == 3
