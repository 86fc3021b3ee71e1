"""The steps of a calibration on the log itself (calibration/own.py): when it is tried,
when its result is used, what is kept and what the user reads. The search and the filter
are replaced by results that are given."""

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tests.lab.test_identify_data import make_checked
from tse.calibration import output, own, workflow
from tse.calibration.own import OwnCalibration
from tse.car.vehicle import Vehicle, make_vehicle
from tse.library.errors import UserError
from tse.log.rows import CheckedLog, SlowChannel

CAR = {"mass": 1500.0, "lf": 1.2, "lr": 1.5, "wheel_radius_front": 0.3, "wheel_radius_rear": 0.4}
STIFFNESS = {
    "cy_front": {"value": 80e3, "low": 70e3, "high": 90e3, "sd_relative": 0.06},
    "cy_rear": {"value": 120e3, "low": 100e3, "high": 140e3, "sd_relative": 0.09},
}
FOUND = {"used": True, "seconds": 90.0, "stiffness": STIFFNESS, "latency": {}, "not_shown": []}


def make_car(**facts: Any) -> Vehicle:
    return make_vehicle(CAR | facts, Path("car.toml"))


def make_log(seconds: float = 100.0, rate: Any = 0.1, step: float = 0.1, **columns: Any) -> CheckedLog:
    """Return a log of a car that drives at 12 m/s, and turns at this yaw rate."""
    time = step * np.arange(round(seconds / step) + 1)
    return make_checked(time, yaw_rate=rate, **columns)


# ---- when it is tried


def test_a_car_is_uncalibrated_if_its_file_has_neither_a_calibration_nor_an_uncertainty() -> None:
    car = make_car()
    assert own.is_uncalibrated(car)
    assert not own.is_uncalibrated(replace(car, calibration={"names": []}))
    assert not own.is_uncalibrated(replace(car, given_uncertainty=["mass_sd"]))


@pytest.mark.parametrize(
    ("columns", "seconds"),
    [
        ({"rate": 0.084}, 100.1),  # 12 m/s x yaw rate: 1.008 m/s2
        ({"rate": 0.083}, 0.0),
        ({"rate": -0.084}, 100.1),
        ({"rate": np.where(np.arange(1001) < 300, 0.1, 0.0)}, 30.0),
        ({"rate": np.nan, "accel_y": np.where(np.arange(1001) < 200, -1.1, 0.9)}, 20.0),
        ({"rate": np.where(np.arange(1001) < 500, np.nan, 0.1), "accel_y": 9.0}, 50.1),
        ({"wheel_speed_rear": -30.0}, 100.1),
        ({"wheel_speed_front": 0.0, "wheel_speed_rear": 24.0}, 0.0),  # 9.6 m/s x 0.1 rad/s
    ],
)
def test_time_of_turning_is_that_with_more_than_1_m_s2_across(columns: dict, seconds: float) -> None:
    """Of speed times yaw rate, or of accel_y in a log without a gyro."""
    assert own._measure_turning(make_log(**columns), make_car()) == pytest.approx(seconds)


def run(monkeypatch, logs: list[CheckedLog], result: OwnCalibration | None = None, path: Path | None = None):
    """Run calibrate_once() with a search that is given; return its result, and the number
    of searches and the seconds of their logs."""
    asked: list[list[float]] = []

    def calibrate(vehicle: Vehicle, parts: list[CheckedLog], say: object) -> OwnCalibration:
        asked.append([float(p.time[-1] - p.time[0]) for p in parts])
        return result or OwnCalibration("text", ["found"], {"used": True})

    monkeypatch.setattr(own, "_calibrate_car", calibrate)
    monkeypatch.setattr(own, "_compute_key", lambda vehicle, parts: "key")
    monkeypatch.setattr(own, "_make_cache_path", lambda name: path and path / name)
    return own.calibrate_once(make_car(), logs), asked


@pytest.mark.parametrize(
    ("logs", "why"),
    [
        ([make_log(57.9)], "it lasts 57.9 s, 60 s are needed"),
        ([make_log(58.0)], None),
        ([make_log(30.0), make_log(28.0)], None),  # together
        ([make_log(30.0), make_log(27.9)], "it lasts 57.9 s, 60 s are needed"),
        ([make_log(60.0, 0.0)], "it hardly turns: 0.0 s above 1 m/s2 across, 2 s are needed"),
        (
            [make_log(60.0, np.where(np.arange(601) < 19, 0.1, 0.0))],
            "it hardly turns: 1.9 s above 1 m/s2 across",
        ),
        ([make_log(60.0, np.where(np.arange(601) < 20, 0.1, 0.0))], None),
        ([make_log(60.0, np.where(np.arange(601) < k, 0.1, 0.0)) for k in (9, 12)], None),
    ],
)
def test_a_log_must_be_long_and_turn_enough(monkeypatch, logs: list[CheckedLog], why: str | None) -> None:
    made, asked = run(monkeypatch, logs)
    assert len(asked) == (why is None)
    if why is not None:
        assert made.text == "" and made.words[0].startswith(f"not calibrated on the log itself: {why}")
        assert made.found["used"] is False and made.found["why"].startswith(why)


def test_ten_minutes_of_all_logs_together_are_used(monkeypatch) -> None:
    logs = [make_log(900.0), make_log(250.0), make_log(400.0)]
    (seconds,) = run(monkeypatch, logs)[1]
    assert seconds == pytest.approx([200.0, 200.0, 200.0], abs=0.2)
    (seconds,) = run(monkeypatch, logs[:1])[1]
    assert seconds == pytest.approx([600.0], abs=0.2)


# ---- what is kept


def test_a_result_is_kept_and_taken_again_and_a_damaged_one_is_replaced(monkeypatch, tmp_path) -> None:
    logs, path = [make_log()], tmp_path / "key.json"
    first, asked = run(monkeypatch, logs, path=tmp_path)
    assert len(asked) == 1 and first.words == ["found", f"kept for the next run: {path}"]
    second, asked = run(monkeypatch, logs, path=tmp_path)
    assert asked == [] and second.words == ["found", f"kept from an earlier run: {path}"]
    assert (second.text, second.found) == ("text", {"used": True})
    path.write_text(path.read_text().replace("text", "test", 1))
    third, asked = run(monkeypatch, logs, path=tmp_path)
    assert len(asked) == 1 and third.words == ["found", f"kept file was damaged, replaced: {path}"]
    assert [p.name for p in tmp_path.iterdir()] == ["key.json"]  # and no lock
    none, asked = run(monkeypatch, logs)  # there is no folder for it
    assert len(asked) == 1 and none.words == ["found"]


def test_a_result_for_another_key_is_not_taken_and_one_that_took_too_long_is_not_kept(
    monkeypatch, tmp_path
) -> None:
    own.write_sealed(tmp_path / "key.json", {"key": "other", "text": "x", "words": [], "found": {}})
    made, asked = run(monkeypatch, [make_log()], own.keep_class(own.TOO_LONG), tmp_path)
    assert len(asked) == 1 and len(made.words) == 1
    (tmp_path / "key.json").unlink()
    run(monkeypatch, [make_log()], own.keep_class(own.TOO_LONG), tmp_path)
    assert not list(tmp_path.iterdir())
    run(monkeypatch, [make_log()], own.keep_class("another reason"), tmp_path)
    assert (tmp_path / "key.json").is_file()


def test_results_are_kept_in_the_cache_of_the_user(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "local"))
    assert own.get_cache_folder() == tmp_path / "xdg" / "tselab" / "calibrated"
    assert own._make_cache_path("a.json") == own.get_cache_folder() / "a.json"
    assert own.get_cache_folder().is_dir()
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert own.get_cache_folder() == tmp_path / "local" / "tselab" / "calibrated"
    monkeypatch.delenv("LOCALAPPDATA")
    monkeypatch.setattr(Path, "home", lambda: tmp_path / "home")
    assert own.get_cache_folder() == tmp_path / "home" / ".cache" / "tselab" / "calibrated"
    (tmp_path / "home").write_text("a file, so no folder can be made in it")
    assert own._make_cache_path("a.json") is None

    def fail() -> Path:
        raise RuntimeError("no home folder")

    monkeypatch.setattr(Path, "home", fail)
    assert own._make_cache_path("a.json") is None


def test_whatever_changes_a_result_changes_its_key() -> None:
    car, log = make_car(), make_log(2.0)
    slow = SlowChannel(log.time[::2], log.time[::2], 2.0)
    entry = replace(log, slower={"accel_y": slow})
    cases = [
        (car, [log]), (make_car(name="other"), [log]), (make_car(cg_height=0.6), [log]),
        (replace(car, values=car.values | {"mass": 1501.0}), [log]), (car, [log, log]),
        (car, [make_log(2.0, 0.11)]), (car, [replace(log, time=log.time + 0.001 * log.time)]),
        (car, [replace(log, averaged=2)]), (car, [entry]), (car, [replace(log, slower={"accel_x": slow})]),
        (car, [replace(log, slower={"accel_y": replace(slow, value=slow.value + 1)})]),
        (car, [replace(log, extra=pd.DataFrame({"gnss_speed": np.full(len(log), 12.0)}))]),
    ]  # fmt: skip
    keys = [own._compute_key(*case) for case in cases]
    assert len(set(keys)) == len(cases)
    assert own._compute_key(make_car(), [make_log(2.0)]) == keys[0]
    even = make_log(2.0, step=0.125)  # a later log has the same steps, to the last bit
    assert own._compute_key(car, [even]) != own._compute_key(car, [replace(even, time=even.time + 4.0)])


# ---- when its result is used


def calibrate(
    monkeypatch,
    found: dict[str, Any] | None = None,
    error: Exception | None = None,
    converged: bool = True,
    misstated: str = "",
    outs: tuple[dict[str, float], ...] = (),
    logs: int = 1,
) -> tuple[OwnCalibration, dict[str, Any]]:
    """Calibrate with a search and a filter that are given. `outs`: what the last rows of
    the filter differ in, one entry for each run of the filter."""
    seen: dict[str, Any] = {"said": [], "cars": [], "runs": 0}

    def search(logs: object, car: Vehicle, report: Any, min_seconds: float) -> SimpleNamespace:
        seen.update(car=car, min_seconds=min_seconds)
        report("step 1")
        if error is not None:
            raise error
        return result

    class Filter:
        def __init__(self, config: object):
            pass

        def estimate_rows(self, rows: np.ndarray) -> np.ndarray:
            out = np.zeros(3, [("status", "i4"), ("change_kind", "i4"), ("cy_front", "f8"), ("mark", "i4")])
            out["mark"] = seen["runs"]
            for name, value in (outs[seen["runs"]] if seen["runs"] < len(outs) else {}).items():
                out[name][-1] = value
            seen["runs"] += 1
            return out

    def contradict(config: object, last: np.void, found: dict) -> str:
        seen.setdefault("contradicted", []).append(int(last["mark"]))
        return "they differ" if last["cy_front"] else ""

    @dataclass
    class Result:
        fit: Any
        misstated: str
        vehicle: Any = None
        own: bool = False

    result = Result(SimpleNamespace(converged=converged, steps=40), misstated)
    monkeypatch.setattr(workflow, "calibrate_logs", search)
    monkeypatch.setattr(own, "_collect_findings", lambda r: found or FOUND)
    monkeypatch.setattr(own, "_describe_result", lambda r, f: ["line"])
    monkeypatch.setattr(own, "_describe_contradiction", contradict)
    monkeypatch.setattr(own, "NativeFilter", Filter)
    monkeypatch.setattr(own, "make_config", lambda car, log: seen["cars"].append(car) or (None, []))
    monkeypatch.setattr(
        output, "format_calibrated", lambda r, names, _: seen.update(result=r, names=names) or "mass = 1"
    )
    monkeypatch.setattr(OwnCalibration, "apply_to", lambda self, before: "calibrated car")
    return own._calibrate_car(make_car(), [make_log(2.0)] * logs, seen["said"].append), seen


def test_a_calibration_that_passes_all_checks_is_used(monkeypatch) -> None:
    made, seen = calibrate(monkeypatch, logs=2)
    assert (made.text, made.words, made.found) == ("mass = 1", ["line"], FOUND)
    assert seen["min_seconds"] == 58.0 and seen["said"] == ["calibrating on the log itself: step 1"]
    assert seen["result"].own is True and seen["result"].vehicle.formula is None
    assert seen["names"] == ["drive.csv", "drive.csv"]
    # it runs over both logs with the car of the file, then with the calibrated one:
    assert [isinstance(c, Vehicle) for c in seen["cars"]] == [True, True, False, False]
    assert seen["contradicted"] == [0, 1]


@pytest.mark.parametrize(
    ("how", "why"),
    [
        ({"error": UserError("no log can be used")}, "no log can be used"),
        ({"error": np.linalg.LinAlgError("singular matrix")}, "singular matrix"),
        ({"converged": False}, "the search did not converge in 40 steps"),
        ({"outs": ({"change_kind": 1},)}, "the road or the tyres change during the log"),
        ({"outs": ({}, {"change_kind": 2})}, "the road or the tyres change during the log"),
        ({"outs": ({"cy_front": 1.0},)}, "they differ"),
        ({"outs": ({"status": -1, "change_kind": 1},)}, None),  # a refused row counts for nothing
        ({"outs": ({"status": -1, "cy_front": 1.0},)}, None),
        ({"outs": ({}, {"cy_front": 1.0})}, None),  # of the calibrated car it is no contradiction
    ],
)
def test_a_calibration_that_fails_a_check_is_not_used_and_the_reason_is_given(monkeypatch, how, why) -> None:
    made, _ = calibrate(monkeypatch, **how)
    assert made.text == ("" if why else "mass = 1")
    if why:
        assert made.found["why"] == why and made.found["used"] is False
        assert ("stiffness" in made.found) == ("error" not in how)
        assert made.words == [
            f"not calibrated on the log itself: {why}; the car is taken as an ordinary one of its class"
        ]


def test_a_vehicle_file_that_the_log_contradicts_is_to_be_checked(monkeypatch) -> None:
    """`wrong` is what the commands warn about."""
    made, seen = calibrate(monkeypatch, misstated="the steering ratio seems wrong")
    assert made.text == "" and seen["runs"] == 0
    assert made.found["wrong"] == made.found["why"] == "the steering ratio seems wrong"
    assert made.found["stiffness"] == STIFFNESS
    assert "wrong" not in calibrate(monkeypatch, converged=False)[0].found


@pytest.mark.parametrize(
    ("front", "rear", "used"), [(0.174, 0.9, True), (0.9, 0.174, True), (0.176, 0.176, False)]
)
def test_one_axle_that_the_log_shows_is_enough(monkeypatch, front: float, rear: float, used: bool) -> None:
    stiffness = {
        k: v | {"sd_relative": sd} for (k, v), sd in zip(STIFFNESS.items(), (front, rear), strict=True)
    }
    made, _ = calibrate(monkeypatch, FOUND | {"stiffness": stiffness})
    assert bool(made.text) == used
    if not used:
        assert made.found["why"] == "the log does not show the cornering stiffness"


def test_a_search_is_ended_after_its_time_at_the_next_step(monkeypatch) -> None:
    clock = iter([1000.0, 1300.1])
    monkeypatch.setattr(own.time, "monotonic", lambda: next(clock))
    made, seen = calibrate(monkeypatch)
    assert made.found == {"used": False, "why": own.TOO_LONG} and seen["said"] == []
    clock = iter([1000.0, 1299.9])
    assert calibrate(monkeypatch)[0].text


@pytest.mark.parametrize(
    ("front", "rear", "named"),
    [
        ((1.0, 0.0), (1.0, 0.0), ""),
        ((1.12, 0.0), (1.12, 0.0), ""),  # ln 1.12 = 0.113, limits 1.96 x 0.06 = 0.118 and 0.176
        ((1.13, 0.0), (1.13, 0.0), "front"),
        ((0.88, 0.0), (1.0, 0.0), "front"),
        ((1.0, 0.0), (1.2, 0.0), "rear"),
        ((1.13, 0.04), (1.0, 0.0), ""),  # hypot(0.06, 0.035) x 1.96 = 0.136
        ((1.16, 0.04), (1.0, 0.0), "front"),
    ],
)
def test_search_and_filter_contradict_each_other_from_1_96_sd_on(front, rear, named) -> None:
    """`front`, `rear`: ratio of the filter's value to that of the search, and its sd."""
    config = SimpleNamespace(cornering_stiffness_front=40e3, cornering_stiffness_rear=60e3)
    last = {"cy_front": 2.0 * front[0], "cy_front_sd": 2.0 * front[1],
            "cy_rear": 2.0 * rear[0], "cy_rear_sd": 2.0 * rear[1]}  # fmt: skip
    text = own._describe_contradiction(config, last, {"stiffness": STIFFNESS})
    assert text.startswith(f"the {named} cornering stiffness is ") if named else text == ""
    if front == (1.16, 0.04):
        assert text == (
            "the front cornering stiffness is 80 (70 .. 90) kN/rad by the calibration, 93 +- 6 by the filter "
            "on the same rows"
        )


# ---- what the user reads


def make_result(**more: Any) -> SimpleNamespace:
    finding = SimpleNamespace(name="steer_angle_latency", group="latency", value=-0.012, sd=0.002, shown=True)
    findings = [
        finding, SimpleNamespace(**(vars(finding) | {"name": "accel_y_latency", "shown": False})),
        SimpleNamespace(**(vars(finding) | {"name": "relaxation_length", "group": "relaxation"})),
        SimpleNamespace(**(vars(finding) | {"name": "yaw_inertia", "group": "yaw inertia", "shown": False})),
    ]  # fmt: skip
    about = {
        "problem": SimpleNamespace(names=["cy_rear", "cy_front"]), "seconds": 90.0, "findings": findings,
        "fit": SimpleNamespace(covariance=np.diag([0.01, 0.0025]), converged=True),
        "slip_lines": ["slip"], "advice": ["advice"],
    }  # fmt: skip
    return SimpleNamespace(**(about | more))


def test_what_was_found_has_95_percent_intervals_and_the_latencies_that_are_shown(monkeypatch) -> None:
    monkeypatch.setattr(output, "collect_settings", lambda r: {
        "cornering_stiffness_front": 80e3, "cornering_stiffness_rear": 120e3})  # fmt: skip
    found = own._collect_findings(make_result())
    by = np.exp(1.96 * 0.05)
    assert found["stiffness"]["cy_front"] == pytest.approx(
        {"value": 80e3, "low": 80e3 / by, "high": 80e3 * by, "sd_relative": 0.05}
    )
    assert found["stiffness"]["cy_rear"]["sd_relative"] == pytest.approx(0.1)
    assert found["stiffness"]["cy_rear"]["value"] == 120e3
    assert found["latency"] == {"steer_angle": {"value": -0.012, "sd": 0.002}}
    assert found["not_shown"] == ["accel_y_latency", "yaw_inertia"]
    assert (found["used"], found["seconds"], found["converged"]) == (True, 90.0, True)


def test_the_lines_have_kn_ms_and_the_groups_that_are_not_shown() -> None:
    found = {
        "stiffness": STIFFNESS,
        "seconds": 90.0,
        "latency": {"steer_angle": {"value": -0.012, "sd": 0.002}},
    }
    assert own._describe_result(make_result(), found) == [
        "calibrated on the log itself, 1.5 minutes of it: stiffness at no slip, 95 %: front 80 (70 .. 90), "
        "rear 120 (100 .. 140) kN/rad",
        "latency behind the gyro, ms, 95 %: steer_angle -12 +- 4",
        "slip",
        "not shown by the log: part of latency, yaw inertia",
        "advice",
    ]
    shown = [f for f in make_result().findings if f.shown]
    lines = own._describe_result(make_result(findings=shown), found | {"latency": {}})
    assert len(lines) == 3 and lines[1:] == ["slip", "advice"]


def test_a_result_is_applied_to_the_values_and_keeps_what_the_file_is() -> None:
    formula = SimpleNamespace(settings=lambda: {"formula_length": 3.0})
    before = replace(make_car(name="mine", cg_height=0.6), notes=["note"], formula=formula,
                     formula_path=Path("f.toml"))  # fmt: skip
    text = 'name = "x"\nmass = 1400\nlf = 1.3\nlr = 1.4\nwheel_radius_front = 0.3\nwheel_radius_rear = 0.3\n'
    made = OwnCalibration(text, ["line"], {}).apply_to(before)
    assert (made.values["mass"], made.values["lf"]) == (1400.0, 1.3)
    assert made.values["formula_length"] == 3.0 and made.formula is formula
    assert (made.name, made.path, made.formula_path) == ("mine", Path("car.toml"), Path("f.toml"))
    assert made.facts == before.facts and made.notes == ["note"] and made.found == ["line"]
    unused = OwnCalibration("", ["why"], {}).apply_to(before)
    assert unused.values == before.values and unused.found == ["why"] and before.found == []
