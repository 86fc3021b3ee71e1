"""The steps of tselab gap, check and plan, each by itself.

Verdict and words, roads of the held-out logs, stages, posterior, files of the improved
car, and the rating of manoeuvres.

Problems are made of manoeuvres of a few seconds, or made up; nothing long is fitted.
"""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gap_logs import CAR
from tse.car.formula import Formula, Number
from tse.car.vehicle import GRAVITY, read_vehicle
from tse.gaps.catalogue import Own, load_catalogue
from tse.gaps.drives import BURN_IN, Candidate, prepare_candidate
from tse.gaps.fit import ChannelChange, Fit
from tse.gaps.infer.detect import Detectable
from tse.gaps.infer.hypotheses import make_hypotheses, make_latencies
from tse.gaps.infer.naming import Named, Naming
from tse.gaps.infer.remainder import Remainder
from tse.gaps.infer.where import Condition, Entry
from tse.gaps.problem import STIFFNESS_PARAMETERS, Problem
from tse.gaps.run import add, check, plan, posterior, stages, workflow
from tse.identify.data import simulate
from tse.identify.knots import KNOT_DISTANCE
from tse.library.core import Config
from tse.library.errors import UserError
from tse.log.rows import MEASURES

LEFT = Remainder("yaw_rate", 3.0, "disturbance", "yaw_rate is left.")
NOISE = Remainder("accel_x", 1.5, "noise", "accel_x is noise.")


@pytest.fixture(scope="module")
def vehicle_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("car") / "car.toml"
    path.write_text(CAR, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def config(vehicle_path):
    return Config.exact(read_vehicle(vehicle_path).values)


def make_candidate(seconds: float = 5.0, pieces: int = 1, angle: float = 0.03) -> Candidate:
    """Return a slalom of 1 Hz at 15 m/s."""
    t = 0.01 * np.arange(round(seconds / 0.01) + 1)
    piece = (angle * np.sin(2 * np.pi * t), np.full(len(t), 15.0))
    return Candidate("slalom", (piece,) * pieces)


def make_problem(config: Config, pieces: int = 1) -> Problem:
    return Problem(prepare_candidate(make_candidate(pieces=pieces), config), config)


def make_fit(problem: Problem | None = None, values: dict | None = None, size: float = 1.0) -> Fit:
    n = 0 if problem is None else len(problem.weight)
    return Fit([], dict(values or {}), np.full(n, size), np.zeros((n, 0)))


def name_effect(effect: str = "body_roll", probability: float = 0.99, value: float = 0.01, **more) -> Named:
    p = load_catalogue()[effect].strengths[0].name
    values, ci95 = {p: value}, {p: (0.9 * value, 1.1 * value)}
    return Named(load_catalogue()[effect], values, ci95, **({"share": 0.6, "evidence": 40.0} | more),
                 probability=probability)  # fmt: skip


def make_naming(*named: Named, closed: float | None = None, possible=(), fit: Fit | None = None) -> Naming:
    fit = fit or make_fit()
    share = sum(n.share for n in named) if closed is None else closed
    return Naming(fit, fit, list(named), share, list(possible), [], True)


FORMULA = Formula("a1", "a formula", "yaw_moment", "k * vel_y", (Number("k", 2.0, "rad/s/m", 0.1, "factor"),))


def find_formula(**more) -> SimpleNamespace:
    known = {
        "formula": FORMULA,
        "fit": None,
        "words": ["A formula."],
        "share": 0.3,
        "nats": 12.0,
        "tried": [],
    }
    return SimpleNamespace(**(known | more))


def judge(*named: Named, left=(), elsewhere=(), entries=(), discovery=None, **naming) -> tuple:
    found = workflow.Found(make_naming(*named, **naming), discovery)
    return workflow.judge_run(found, entries, list(left), elsewhere)


# ---- verdict and words


@pytest.mark.parametrize(
    ("sure", "code"),
    [
        ([0.95], 10),
        ([0.9], 10),
        ([0.899], 11),
        ([0.95, 0.97], 10),
        ([0.95, 0.6], 11),
        ([0.6, 0.95], 11),
        ([0.6, 0.5], 11),
    ],
)
def test_one_uncertain_name_makes_the_verdict_uncertain(sure, code):
    named = [name_effect(e, p) for e, p in zip(("body_roll", "relaxation"), sure, strict=False)]
    assert judge(*named)[:2] == ("named", code)


@pytest.mark.parametrize(("alike", "code"), [((["a"],), 11), ((["a"], ["b"]), 11), ((["a"], []), 10)])
def test_only_if_every_name_has_look_alikes_is_the_verdict_uncertain(alike, code):
    named = [name_effect(e, look_alikes=a) for e, a in zip(("body_roll", "relaxation"), alike, strict=False)]
    assert judge(*named)[1] == code


@pytest.mark.parametrize(
    ("possible", "verdict", "code"), [(0.5, "possible", 11), (0.499, "none", 0), (None, "none", 0)]
)
def test_an_effect_as_likely_as_not_is_possible(possible, verdict, code):
    maybe = [] if possible is None else [{"id": "mass", "probability": possible, "why": "below 90 %"}]
    found = judge(possible=maybe)
    assert found[:2] == (verdict, code)
    if verdict == "possible":
        assert found[2] == ["Possible, but not named: mass, probability 50 % (below 90 %)."]
    else:
        assert found[2][0].startswith("Nothing is missing that these logs could show")


def test_of_possible_effects_the_first_is_said_and_any_of_them_counts():
    maybe = [{"id": "mass", "probability": 0.4, "why": "x"}, {"id": "cg", "probability": 0.6, "why": "y"}]
    verdict, _, words = judge(possible=maybe)
    assert verdict == "possible" and words == ["Possible, but not named: mass, probability 40 % (x)."]


def test_noise_of_a_sensor_is_nothing_that_is_left():
    assert judge(left=[NOISE])[:2] == ("none", 0)
    assert judge(left=[NOISE, LEFT])[0] == "not_in_catalogue"
    assert workflow.drop_noise([NOISE, LEFT, NOISE]) == [LEFT]


def test_what_is_left_is_said_with_the_place_where_it_acts():
    entries = [Entry("yaw moment", 12.0, 0.4, 100.0, "N m"), Entry("front axle", 8.0, 0.3, 50.0, "N")]
    verdict, code, words = judge(left=[LEFT, NOISE], entries=entries)
    assert (verdict, code) == ("not_in_catalogue", 20)
    assert words == [
        "Something is missing that no effect of the catalogue explains.",
        "The missing effect acts like a disturbance at: yaw moment.",
        "yaw_rate is left.",
    ]
    for none in ([], [replace(entries[0], nats=0.0)]):
        assert not any("disturbance at" in w for w in judge(left=[LEFT], entries=none)[2])


def test_names_that_leave_something_say_how_much_they_close():
    words = judge(name_effect(share=0.62), left=[LEFT])[2]
    assert words[1:] == [
        "Together the named effects close 62 % of the gap; no effect of the catalogue explains the "
        "remainder.",
        "yaw_rate is left.",
    ]
    words = judge(name_effect(share=0.06), left=[LEFT])[2]
    assert "a further effect is missing that is not in the catalogue." in words[1]
    assert len(judge(name_effect())[2]) == 1


def test_a_formula_is_said_and_what_it_leaves_is_still_left():
    verdict, code, words = judge(left=[LEFT], discovery=find_formula())
    assert (verdict, code) == ("not_in_catalogue", 20)
    assert words[1:] == ["A formula.", "Still left: yaw_rate is left."]
    maybe = [{"id": "mass", "probability": 0.6, "why": "x"}]
    assert not any("Possible" in w for w in judge(discovery=find_formula(), possible=maybe)[2])
    assert judge(discovery=find_formula())[2] == [
        "Something is missing that no effect of the catalogue explains.",
        "A formula.",
    ]
    none = find_formula(formula=None, words=["No formula."])  # a search that proposed none
    assert judge(left=[LEFT], discovery=none, possible=maybe)[2][1:] == [
        "Possible, but not named: mass, probability 60 % (x).",
        "No formula.",
        "yaw_rate is left.",
    ]


def test_held_out_logs_that_are_not_explained_are_said_by_channel():
    there = [replace(LEFT, gap=2.5), Remainder("accel_y", 1.75, "localised", "x")]
    verdict, code, words = judge(elsewhere=there)
    assert (verdict, code) == ("not_in_catalogue", 20)
    assert words[0].startswith("Something is missing: the residuals of the fitted logs are sensor noise")
    assert words[-1] == (
        "The model does not explain the held-out logs: yaw_rate 2.50 times the sensor noise, "
        "accel_y 1.75 times the sensor noise."
    )
    words = judge(left=[LEFT], elsewhere=there)[2]  # a channel that is left in the fitted logs, too
    assert words[-1].endswith("held-out logs: accel_y 1.75 times the sensor noise.")
    assert judge(name_effect(), elsewhere=there)[:2] == ("named", 10)


def test_a_name_beside_a_formula_that_fails_elsewhere_is_not_the_answer():
    assert judge(name_effect(), discovery=find_formula())[:2] == ("named", 10)
    entries = [Entry("yaw moment", 12.0, 0.4, 100.0, "N m")]
    doubtful = name_effect(probability=0.6)
    verdict, code, words = judge(doubtful, discovery=find_formula(), elsewhere=[LEFT], entries=entries)
    assert (verdict, code) == ("not_in_catalogue", 20)
    assert words[1:] == [
        "Together the named effects close 60 % of the gap; a further effect is missing that is not in "
        "the catalogue.",
        "The missing effect acts like a disturbance at: yaw moment.",
        "A formula.",
        "The model does not explain the held-out logs: yaw_rate 3.00 times the sensor noise.",
    ]
    words = judge(name_effect(), left=[LEFT], entries=entries)[2]
    assert not any("disturbance at" in w for w in words)  # the names close most of the gap


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({}, "; probability 99 %, it closes 60 % of the gap."),
        ({"probability": 0.995}, "; probability above 99 %, it closes 60 % of the gap."),
        ({"share": 0.005}, ", it closes 0 % of the gap."),
        ({"share": 0.004, "alone": 0.3}, "it closes 30 % of the gap that the other named effects leave."),
        ({"share": 0.004}, "; probability 99 %."),
        ({"look_alikes": ["mass", "cg"]}, "gap. These logs cannot exclude mass, cg in its place."),
    ],
)
def test_a_name_is_said_with_its_size_share_and_look_alikes(more, said):
    text = workflow._describe_name(name_effect(**more))
    assert text.endswith(said)
    title = load_catalogue()["body_roll"].title
    assert text.startswith(f"{title} (body_roll): gain 0.01 rad s2/m (0.009 .. 0.011); probability")


def test_only_strengths_are_said_and_no_unit_of_pure_numbers():
    roll = load_catalogue()["rear_roll_steer"]
    values = {"rear_roll_steer_gain": 0.05, "rear_roll_steer_frequency": 1.5}
    n = Named(roll, values, {k: (v, v) for k, v in values.items()}, 0.5, 40.0, 0.85)
    text = workflow._describe_name(n)
    assert text.startswith(f"possibly {roll.title} (rear_roll_steer): gain 0.05 (0.05 .. 0.05); ")
    assert workflow._convert_name(n)["parameters"] == {
        "gain": {"value": 0.05, "ci95": [0.05, 0.05], "unit": "1"},
        "frequency": {"value": 1.5, "ci95": [1.5, 1.5], "unit": "Hz"},
    }


def test_each_axle_is_said_with_its_own_friction():
    """1.25 times 1.2 is 1 / 0.67, and 1.25 times 0.8 is 1."""
    saturation = load_catalogue()["tyre_saturation"]
    values = {"tyre_saturation_inverse_friction": 1.25, "tyre_saturation_balance": 0.2}
    named = Named(saturation, values, {k: (v, v) for k, v in values.items()}, 0.5, 40.0, 0.95)
    assert ", friction 0.67 in front and 1.00 in the rear; probability" in workflow._describe_name(named)
    for alike in (
        values | {"tyre_saturation_balance": 0.0},
        {"tyre_saturation_inverse_friction": 1.25},
        {"tyre_saturation_balance": 0.2},
    ):
        assert workflow._describe_axle_friction(replace(named, values=alike)) == ""


def name_road(effect: str, size: float) -> Named:
    key = f"{effect}_angle"
    ci95 = {key: (size - 0.002, size + 0.004)}
    return Named(load_catalogue()[effect], {key: size}, ci95, 0.42, 40.0, 0.97)


def test_a_road_is_said_in_degrees_with_its_laps_and_what_one_lap_cannot_tell():
    assert workflow._describe_name(name_road("bank", 0.02)) == (
        "The road banks by 1.1 degrees rms (95 %: 1 .. 1.4) (bank); probability 97 %, "
        "it closes 42 % of the gap."
    )
    assert workflow._describe_name(name_road("grade", 0.03)) == (
        "The road climbs and falls by 1.7 degrees rms (95 %: 1.6 .. 1.9) (grade); probability 97 %, "
        "it closes 42 % of the gap. One lap cannot exclude that the accel_x bias varies by 0.29 m/s2."
    )
    laps = SimpleNamespace(path=[None], count=[0, 0, 0].count)
    found = workflow.Found(make_naming(name_road("grade", 0.03)), roads=SimpleNamespace(laps=laps))
    _, code, (said,) = workflow.judge_run(found, [], [])
    assert "1.9), the same on 3 laps (grade);" in said and said.endswith("of the gap.") and code == 10


def test_a_latency_of_two_names_has_the_interval_of_both(config):
    """The IMU is early by 20 +- 3 ms, the wheels are late by 10 +- 4 ms beside it."""
    effects = {e.id: e for e in make_latencies()} | {"imu_delay": load_catalogue()["imu_delay"]}
    named = []
    for i, key, x, half in (
        ("imu_delay", "imu_delay_time", -0.02, 0.003),
        ("wheel_speed_latency", "wheel_speed_latency", 0.01, 0.004),
    ):
        named.append(Named(effects[i], {key: x}, {key: (x - half, x + half)}, 0.5, 40.0))
    values = {k: v for n in named for k, v in n.values.items()}
    found = workflow.list_sensor_corrections(
        make_problem(config), make_naming(*named, fit=make_fit(None, values))
    )
    wheel = (pytest.approx(0.03), pytest.approx([0.025, 0.035]))
    assert {s["id"]: (s["value"], s["ci95"]) for s in found} == {
        "steer_angle_latency": (pytest.approx(0.02), pytest.approx([0.017, 0.023])),
        "wheel_speed_front_latency": wheel,
        "wheel_speed_rear_latency": wheel,
    }


def test_a_low_pass_of_the_imu_is_a_correction_of_the_sensors_and_a_slow_steering_is_none(config):
    problem = make_problem(config)

    def correct(time: float) -> list[dict]:
        named = name_effect("steering_lag", value=time)
        return workflow.list_sensor_corrections(problem, make_naming(named, fit=make_fit(None, named.values)))

    assert correct(0.01) == [
        {"id": "low_pass", "value": 0.01, "ci95": pytest.approx([0.009, 0.011]), "unit": "s"}
    ]
    assert correct(0.03) == []
    late = next(e for e in make_latencies() if e.id == "accel_y_latency")
    values = {"accel_y_latency": 0.02}
    named = Named(late, values, {"accel_y_latency": (0.015, 0.025)}, 0.5, 40.0)
    (found,) = workflow.list_sensor_corrections(problem, make_naming(named, fit=make_fit(None, values)))
    assert (found["id"], found["value"]) == ("accel_y_latency", 0.02)
    assert found["ci95"] == pytest.approx([0.015, 0.025])


# ---- results of a run


def test_the_result_is_that_with_the_formula_if_there_is_one():
    naming = make_naming(fit=make_fit(None, {"cy_front": 1.1}))
    bare = workflow.Found(naming)
    assert (bare.formula, bare.final, bare.after) == (None, naming.final, {"cy_front": 1.1})
    assert workflow.Found(naming, find_formula(formula=None)).final is naming.final
    fit = make_fit(None, {"cy_front": 1.2})
    found = workflow.Found(naming, find_formula(fit=fit))
    assert found.final is fit and found.after == {"cy_front": 1.2} | FORMULA.settings()
    assert FORMULA.settings()


@pytest.mark.parametrize(("of", "most"), [([0, 0, 1], 2), ([0, 1, 1, 1], 3), ([0], 1)])
def test_the_most_laps_are_those_of_the_road_that_most_logs_share(of, most):
    laps = SimpleNamespace(path=[None] * (max(of) + 1), count=of.count)
    found = workflow.Found(make_naming(), roads=SimpleNamespace(laps=laps))
    assert found.most_laps == most
    assert workflow.Found(make_naming(), roads=SimpleNamespace(laps=None)).most_laps == 1
    assert workflow.Found(make_naming()).most_laps == 1


def make_result(config: Config, **more) -> workflow.GapResult:
    problem = make_problem(config)
    late = name_effect("steering_lag", value=0.01)
    known = {
        "naming": make_naming(name_effect(), late, fit=make_fit(problem, late.values)),
        "verdict": "named", "exit_code": 10, "words": ["w"], "problem": problem, "level": problem,
        "stages": {}, "conditions": [Condition("accel_x", "brakes", 0.5), Condition("yaw_rate", "rain", 0.4)],
        "entries": [Entry("yaw moment", 12.0, 0.4, 1.0, "N m")], "remainders": [LEFT], "elsewhere": [],
        "fit_before": {"yaw_rate": 2.0}, "fit_after": {"yaw_rate": 1.0},
        "held_out": {"yaw_rate": ChannelChange(3.0, 1.5, -0.5, (-0.6, -0.4))}, "undetectable": [],
        "detectable": [],
    }  # fmt: skip
    return workflow.GapResult(**(known | more))


def test_the_document_tells_effects_from_sensors_and_before_from_after(config):
    found = make_result(config, discovery=find_formula(tried=[{"place": "p"}])).as_json()
    assert [e["id"] for e in found["effects"]] == ["body_roll"]
    assert [s["id"] for s in found["sensors"]] == ["low_pass"]
    assert found["gap"]["fit"] == {"before": {"yaw_rate": 2.0}, "after": {"yaw_rate": 1.0}}
    assert found["gap"]["held_out"] == {
        "before": {"yaw_rate": 3.0}, "after": {"yaw_rate": 1.5}, "change_ci95": {"yaw_rate": (-0.6, -0.4)},
    }  # fmt: skip
    assert [w["entry_point"] for w in found["where"]] == ["longitudinal", "yaw moment"]
    assert found["formula"] == {
        "proposed": {
            "id": "a1", "place": "yaw_moment", "formula": "k * vel_y", "share": 0.3, "nats": 12.0,
            "numbers": {"k": {"value": 2.0, "sd": 0.1, "unit": "rad/s/m"}},
        },
        "tried": [{"place": "p"}],
    }  # fmt: skip
    assert found["closed"] == pytest.approx(1.2) and found["remainder"][0]["channel"] == "yaw_rate"


def test_a_document_without_a_place_or_a_formula_says_so(config):
    entry = Entry("yaw moment", 0.0, 0.4, 1.0, "N m")
    for entries in ([], [entry]):
        found = make_result(config, entries=entries).as_json()
        assert found["where"][1]["entry_point"] == "unknown" and found["formula"] is None
    none = make_result(config, discovery=find_formula(formula=None)).as_json()
    assert none["formula"] == {"proposed": None, "tried": []}


def test_the_document_has_each_list_under_its_own_name(config):
    named = name_effect(probability=0.91, share=0.6, alone=0.7, whole=0.95, look_alikes=["cg"])
    naming = make_naming(named, closed=0.55, possible=[{"id": "mass", "probability": 0.2, "why": "x"}])
    naming.sets = [{"ids": ["body_roll"], "probability": 0.9}]
    first, second = stages.Stage(1.0, 2.0, 3.0, 4.0, 5.0), stages.Stage(6.0, 7.0, 8.0, 9.0, 10.0)
    found = make_result(
        config,
        naming=naming,
        stages={"fit": {"yaw_rate": first}, "held_out": {"accel_y": second}},
        undetectable=[make_detectable("mass", 2.0)],
        detectable=[make_detectable("relaxation", 0.5)],
        rivals=["a rival"],
        notes=["a note"],
        elsewhere=[NOISE],
    ).as_json()
    assert found["effects"] == [
        {
            "id": "body_roll",
            "probability": 0.91,
            "parameters": {
                "gain": {"value": 0.01, "ci95": pytest.approx([0.009, 0.011]), "unit": "rad s2/m"}
            },
            "share_of_gap_closed": 0.6,
            "evidence": 40.0,
            "look_alikes": ["cg"],
        }
    ]
    assert (found["possible"], found["sets"], found["closed"]) == (naming.possible, naming.sets, 0.55)
    names = ("signal", "filed", "calibrated", "named", "noise")
    assert found["stages"] == {
        "fit": {"yaw_rate": dict(zip(names, (1.0, 2.0, 3.0, 4.0, 5.0), strict=True))},
        "held_out": {"accel_y": dict(zip(names, (6.0, 7.0, 8.0, 9.0, 10.0), strict=True))},
    }
    assert [d["id"] for d in found["undetectable"]] == ["mass"] and found["sensors"] == []
    assert (found["rivals"], found["notes"], found["words"]) == (["a rival"], ["a note"], ["w"])
    assert [r["channel"] for r in found["remainder"]] == ["yaw_rate"] and found["verdict"] == "named"


# ---- steps of a run


def test_sensors_that_the_file_leaves_out_are_those_of_the_first_log(monkeypatch, vehicle_path):
    car, seen = read_vehicle(vehicle_path), []
    monkeypatch.setattr(workflow, "read_agreeing", lambda paths, notes, reading: [*paths, reading.car])
    monkeypatch.setattr(workflow, "fill_sensors", lambda vehicle, log: seen.append(log))
    logs, config = workflow.read_logs(["one", "two"], car)
    assert seen == ["one"] and logs == ["one", "two", car] and config.mass == car.values["mass"]
    with pytest.raises(UserError, match="no logs to fit"):
        workflow.read_logs([], car)


@pytest.mark.parametrize(("on_roads", "closes"), [(1.5, True), (2.5, False), (2.0, False)])
def test_roads_are_kept_if_they_make_the_gap_smaller(config, monkeypatch, on_roads, closes):
    problem = make_problem(config)
    monkeypatch.setattr(workflow.name, "fit_plain_car", lambda p: make_fit(p, size=on_roads))
    assert workflow.closes_part(problem, problem, make_fit(problem, size=2.0)) == closes


def test_a_held_out_log_gets_the_first_road_that_it_is_on(config, monkeypatch):
    ready = prepare_candidate(make_candidate(pieces=3), config)
    logs = [SimpleNamespace(path=Path(f"{k}.csv")) for k in "abc"]
    on = {"a.csv": ("second", "third"), "b.csv": (), "c.csv": ("first",)}
    n = len(ready[0].time)

    def match(road: str, log: SimpleNamespace, given: Config) -> SimpleNamespace:
        assert given is config
        if road not in on[log.path.name]:
            raise UserError("not on it")
        bank = np.full(n, {"first": 0.01, "second": 0.02, "third": 0.03}[road])
        grade = np.where(np.arange(n) < 9, np.nan, -0.05)
        return SimpleNamespace(bank=bank, grade=grade, describe=lambda: f"the {road}")

    monkeypatch.setattr(workflow, "match_log", match)
    held, notes = Problem(ready, config), ["before"]
    placed = workflow.place_on_roads(["first", "second", "third"], held, ready, logs, config, notes)
    a, b, c = placed.logs
    assert (a.road["bank"] == 0.02).all() and (c.road["bank"] == 0.01).all() and b.road == {}
    assert a.road["grade"][0] == 0 and a.road["grade"][9] == -0.05 and not ready[0].road
    assert notes == [
        "before",
        "a.csv is on the same road as fitted logs: the second",
        "c.csv is on the same road as fitted logs: the first",
    ]
    marked = Path("in time")
    monkeypatch.setattr(workflow, "remove_latencies", lambda log, _: replace(log, path=marked))
    placed = workflow.place_on_roads(["first"], held, ready, logs, config, notes)
    assert [log.path for log in placed.logs] == [marked] * 3 and placed.logs[1].road == {}


@pytest.mark.parametrize(("size", "left"), [(0.0, True), (0.01, False)])
def test_names_leave_something_if_a_channel_of_the_held_out_logs_has_more_than_noise(config, size, left):
    """The held-out car has body roll of 0.01. Roads of the fitted logs do not count."""
    held = make_problem(config)
    held.measure({"body_roll_gain": 0.01})
    values = {"body_roll_gain": size, Own("bank", 0, 0): 0.3, Own("bank", 0, 1): -0.3}
    naming = make_naming(name_effect(), fit=make_fit(None, values))
    assert workflow.leaves_something(held, naming) == left
    assert not workflow.leaves_something(None, naming)
    assert not workflow.leaves_something(held, make_naming(fit=make_fit(None, values)))


def test_the_length_of_the_logs_is_their_sum(config):
    assert workflow._count_seconds(make_problem(config, 2)) == pytest.approx(2 * (5.0 - BURN_IN), abs=0.1)


# ---- stages


def test_stages_are_rms_of_the_errors_in_the_units_of_the_channels(config):
    """The car has body roll, which the file lacks; the names have half of it."""
    true = Config.exact(config.as_dict() | {"body_roll_gain": 0.01})
    ready = []
    for log in prepare_candidate(make_candidate(pieces=2), config):
        measured = simulate(true, log, MEASURES, {}, {})
        bias = 0.3 + len(ready)
        ready.append(replace(log, measured=measured | {"accel_y": measured["accel_y"] + bias}))
    level = Problem(ready, config)
    found = stages.compute_stages(level, ready, true, (level, {"body_roll_gain": 0.005}))
    rolls = level.predict({"body_roll_gain": 0.01}) - level.predict({})
    rows = level.rows.of("accel_y")
    alone = rolls[rows].reshape(2, -1)
    alone = float((alone - alone.mean(axis=1, keepdims=True)).std())
    ay = found["accel_y"]
    assert alone > 0.05 and ay.filed == pytest.approx(alone) and ay.named == pytest.approx(alone / 2, rel=0.1)
    assert ay.calibrated == pytest.approx(0, abs=1e-6)
    signal = level.measured[rows].reshape(2, -1)
    assert ay.signal == pytest.approx((signal - signal.mean(axis=1, keepdims=True)).std())
    assert ay.noise == pytest.approx(0.06 / np.sqrt(4))  # 4 rows in a block
    assert ay.explained == pytest.approx(1 - (ay.named / ay.signal) ** 2)
    assert set(found) == set(MEASURES) and found["yaw_rate"].noise == pytest.approx(0.001)


def test_the_named_effects_are_simulated_on_the_estimated_roads(config):
    """A bank of 0.02 rad in the second half explains what a level road leaves."""
    (log,) = prepare_candidate(make_candidate(), config)
    road = {"bank": np.where(np.arange(len(log.time)) < 250, 0.0, 0.02)}
    log = replace(log, measured=simulate(config, replace(log, road=road), MEASURES, {}, {}))
    level, banked = Problem([log], config), Problem([replace(log, road=road)], config)
    found = stages.compute_stages(level, [log], config, (banked, {}))["accel_y"]
    assert found.filed == pytest.approx(found.calibrated) and found.filed > 0.02
    assert found.named == pytest.approx(0.0, abs=1e-6)


def test_the_calibrated_car_is_simulated_with_the_latencies_that_were_found(config):
    """The steering angle is logged 40 ms late, which the vehicle file does not say."""
    late = Config.exact(config.as_dict() | {"steer_angle_latency": 0.04})
    ready = []
    for log in prepare_candidate(make_candidate(pieces=1), config):
        measured = simulate(config, log, MEASURES, {}, {})
        steer = np.interp(log.time - 0.04, log.time, log.inputs["steer_angle"])
        ready.append(replace(log, measured=measured, inputs=log.inputs | {"steer_angle": steer}))
    level = Problem(ready, config)
    yaw = stages.compute_stages(level, ready, late, (level, {}))["yaw_rate"]
    assert yaw.filed > 0.003 and yaw.calibrated < 0.1 * yaw.filed


def test_stages_are_said_in_their_order_with_noise_and_what_is_explained():
    yaw = stages.Stage(0.2, 0.02, 0.01, 0.004, 0.001)
    assert yaw.explained == pytest.approx(0.9996) and stages.Stage(0, 0, 0, 0, 0).explained == 1
    (line,) = stages.describe_stages({"fit": {"yaw_rate": yaw}}, {"fit": "fitted logs"}.get)
    assert line == (
        "yaw_rate of fitted logs: rms error 0.02 rad/s with the vehicle file, 0.01 calibrated, 0.004 with "
        "the named effects; sensor noise 0.001. The model explains 100.0 % of the signal's mean square."
    )
    head, line = stages.describe_channels({"yaw_rate": yaw}, "held-out logs")
    assert "held-out logs" in head and line.split() == [
        "yaw_rate,",
        "rad/s",
        "0.02",
        "0.01",
        "0.004",
        "(0.001)",
    ]


# ---- posterior and improved car

KNOWN = posterior.Posterior(
    ("cx_front", "cy_front", "cy_rear", "body_roll_gain", "imu_scale_ay_error", "relaxation_length"),
    np.array([1.1, 0.9, 0.8, 0.01, 0.02, 0.5]),
    np.diag(np.square([0.11, 0.09, 0.04, 0.002, 0.03, 0.2])),
    0.07,
)


def test_the_sd_of_a_scale_of_accel_y_is_that_of_its_sum_with_body_roll():
    assert KNOWN.compute_sd("cy_front") == pytest.approx(0.09)
    assert KNOWN.compute_sd("body_roll_gain") == pytest.approx(0.002)
    assert KNOWN.compute_sd("imu_scale_ay_error") == pytest.approx(np.hypot(0.03, GRAVITY * 0.002))
    covariance = KNOWN.covariance.copy()
    covariance[3, 4] = covariance[4, 3] = -0.9 * 0.03 * 0.002
    both = replace(KNOWN, covariance=covariance)
    by = GRAVITY * 0.002
    assert both.compute_sd("imu_scale_ay_error") == pytest.approx(
        np.sqrt(0.03**2 + by**2 - 2 * 0.9 * 0.03 * by)
    )
    assert KNOWN.stiffness == {"cx_front": 1.1, "cy_front": 0.9, "cy_rear": 0.8}


def test_the_uncertainty_is_that_of_the_posterior_but_not_below_what_a_model_can_be(vehicle_path):
    car = read_vehicle(vehicle_path)
    least = posterior.MIN_SD
    car.values |= {
        "relaxation_sd": 0.4,
        "lean_sd": 0.05,
        "mass_sd": 0.06,
        "trail_sd": 0.3,
        "gyro_scale_sd": 0.002,
    }
    found = KNOWN.make_uncertainty(car)
    assert found["relaxation_sd"] == pytest.approx(0.2)  # of the posterior
    tight = replace(KNOWN, covariance=KNOWN.covariance / 1e4)
    assert tight.make_uncertainty(car)["relaxation_sd"] == least["relaxation_sd"] == 0.12
    assert found["gyro_scale_sd"] == 0.002 < least["gyro_scale_sd"]  # the user's own
    assert found["lean_sd"] == 0.05  # of no parameter of the posterior
    assert found["trail_sd"] == least["trail_sd"]
    assert (found["mass_sd"], found["model_sd"]) == (0.06, 0.07)
    exact = read_vehicle(vehicle_path)
    assert set(KNOWN.make_uncertainty(exact).values()) == {0.0}


def test_a_calibration_has_the_stiffness_as_logarithm_about_0():
    found = KNOWN.make_calibration()
    names = found["names"]
    assert names[:3] == ["cx_front", "cy_front", "cy_rear"]
    sd = dict(zip(names, np.sqrt(np.diagonal(found["covariance"])), strict=True))
    mean = dict(zip(names, found["mean"], strict=True))
    assert (mean["cy_rear"], sd["cy_rear"]) == (0.0, pytest.approx(0.05))
    assert (mean["relaxation_length"], sd["relaxation_length"]) == (0.5, pytest.approx(0.2))
    covariance = KNOWN.covariance.copy()
    covariance[1, 5] = covariance[5, 1] = 0.006
    found = replace(KNOWN, covariance=covariance).make_calibration()
    k = names.index("relaxation_length")
    assert found["covariance"][1, k] == pytest.approx(0.006 / 0.9)


class MadeUpSpace:
    """The unknowns of a fit that is made up; each has the sd 0.5."""

    names = (
        "cx_front", "cy_front", "cy_rear", "gyro_scale_error", "relaxation_length", "body_roll_gain",
    )  # fmt: skip

    def __init__(self, problem, effects, ids):
        self.problem, self.ids = problem, ids
        self.parameters = [SimpleNamespace(name=n) for n in self.names]
        self.sd = np.full(6, 0.5)

    def to_search(self, values):
        return values


@pytest.mark.parametrize("gap", [1.2, 1.21])
def test_the_posterior_is_that_of_what_is_fitted_and_of_what_has_a_prior(monkeypatch, config, gap):
    """Body roll has no prior sd and is not fitted, so it is left out."""
    spaces, asked, rng = [], [], np.random.default_rng(2)
    root = rng.standard_normal((6, 6))
    own = 1e-3 * root @ root.T

    def fit(space, mean, max_steps, near):
        spaces.append((space, mean))
        assert max_steps == 0 and near
        return SimpleNamespace(covariance=own.copy(), residuals=len(spaces))

    class Car:
        def __init__(self, fixed):
            self.config, self.fixed = config, fixed
            self.nominal = {"relaxation_length": 0.3, "body_roll_gain": 0.0}

        def holding(self, values):
            return Car(self.fixed | values)

    monkeypatch.setattr(posterior, "Space", MadeUpSpace)
    monkeypatch.setattr(posterior.engine, "fit", fit)
    monkeypatch.setattr(posterior, "compute_gap", lambda *_: {"accel_x": gap, "yaw_rate": 9.0})
    monkeypatch.setattr(posterior, "estimate_model_sd", lambda *x: asked.append(x) or 0.06)
    monkeypatch.setattr(
        posterior, "estimate_longitudinal", lambda c, fixed, logs, car: (np.log(1.2 if logs else 9), 0.05)
    )
    car = SimpleNamespace(
        values={"mass_sd": 0.1, "gyro_scale_sd": 0.03, "relaxation_sd": 0.2, "model_sd": 0.04}
    )
    gyro = load_catalogue()["gyro_scale"].strengths[0]
    values = {"cx_front": 1.1, "cy_front": 0.9, "gyro_scale_error": 0.02}
    last = Fit([*STIFFNESS_PARAMETERS, gyro], values, np.zeros(0), np.zeros((0, 4)))
    spread = np.diag([0.0, 0.01, 0.02])
    found = posterior.compute_posterior(Car({}), last, car, {"formula_gain": 2.0}, ["a log"], spread)
    assert found.names == MadeUpSpace.names[:5] and found.model_sd == 0.06
    (space, mean), (bare, _) = spaces
    assert set(space.ids) == {"gyro_scale", "relaxation"}
    assert space.problem.fixed == values | {"formula_gain": 2.0} and bare.problem.fixed == values
    assert asked == [(bare, 2, 0.04)]  # what a formula explains is an error of the filter's model
    np.testing.assert_allclose(space.sd, [0.5, 0.5, 0.5, 0.5, 0.2, 0.5])
    np.testing.assert_allclose(mean, [1.1, 0.9, 1.0, 0.02, 0.3, 0.0])
    np.testing.assert_allclose(space.information, np.diag([4.0, 4.0, 4.0, 4.0, 25.0, 4.0]))
    expected, x = own[:5, :5].copy(), np.array([1.1, 0.9, 1.0, 0.02, 0.3])
    if gap > 1.2:  # what the simulation does not explain shows no longitudinal stiffness
        x[0] = 1.2
        expected[0] = expected[:, 0] = 0.0
        expected[0, 0] = (0.05 * 1.2) ** 2
    np.testing.assert_allclose(found.values, x)
    scale = np.outer(x[:3], x[:3])
    expected[:3, :3] += (0.1**2 + spread) * scale
    np.testing.assert_allclose(found.covariance, expected)


def test_a_fitted_stiffness_is_its_ratio_times_the_setting_within_its_limits(config):
    found = add.convert_stiffness(config, {"cx_front": 1.2, "cy_front": 0.9})
    expected = {
        "longitudinal_stiffness_front": 1.2 * 180e3,
        "cornering_stiffness_front": 0.9 * 110e3,
        "cornering_stiffness_rear": 130e3,
        "longitudinal_stiffness_rear": 160e3 * (1 + 0.2 * config.rear_longitudinal_follows_front),
    }
    assert found == pytest.approx(expected)
    half = Config.exact(config.as_dict() | {"rear_longitudinal_follows_front": 0.5})
    assert add.convert_stiffness(half, {"cx_front": 1.2})["longitudinal_stiffness_rear"] == pytest.approx(
        176e3
    )
    limits = config.fields["cornering_stiffness_rear"]
    for ratio, limit in ((1e4, limits.high), (1e-9, limits.low)):
        assert add.convert_stiffness(config, {"cy_rear": ratio})["cornering_stiffness_rear"] == limit


def make_improved(monkeypatch, vehicle, problem: Problem, *named: Named, discovery=None, fit=None) -> str:
    monkeypatch.setattr(add, "compute_posterior", lambda *_: KNOWN)
    values = {k: v for n in named for k, v in n.values.items()}
    result = workflow.Found(make_naming(*named, fit=fit or make_fit(problem, values)), discovery)
    return add.make_vehicle_toml(vehicle, problem, result)


def test_the_improved_file_has_the_effects_with_intervals_and_look_alikes(
    monkeypatch, vehicle_path, config, tmp_path
):
    problem = make_problem(config)
    roll = name_effect(look_alikes=["mass"])
    bank = name_effect("bank", value=0.02)
    text = make_improved(monkeypatch, read_vehicle(vehicle_path), problem, roll, bank)
    (tmp_path / "new.toml").write_text(text, encoding="utf-8")
    new = read_vehicle(tmp_path / "new.toml")
    assert new.values["body_roll_gain"] == 0.01 and new.values["cornering_stiffness_rear"] == pytest.approx(
        104e3
    )
    assert not new.values.get("bank_angle") and new.formula is None
    lines = text.splitlines()
    assert lines[0].startswith("# car.toml, improved by tselab gap") and lines[0].endswith(
        problem.logs[0].path.name
    )
    assert lines[1] == "# Fitted together: stiffness, body_roll."
    (gain,) = [x for x in lines if x.startswith("gain = ")]
    assert gain.endswith("95 %: 0.009 .. 0.011")
    (rear,) = [x for x in lines if x.startswith("cornering_stiffness_rear = ")]
    (follows,) = [x for x in lines if x.startswith("longitudinal_stiffness_rear = ")]
    assert follows.endswith(", follows the front one")
    by = np.exp(1.96 * 0.04 / 0.8)
    assert rear.endswith(f"95 %: {104e3 / by:.4g} .. {104e3 * by:.4g}")
    assert "closes 60 % of the gap, evidence 40 nats" in text
    assert "These logs cannot exclude mass in its place." in text
    assert "not written: a profile over the distance belongs to the road" in text


def test_the_posterior_of_the_improved_file_is_of_the_fitted_logs_with_the_formula(
    monkeypatch, vehicle_path, config
):
    asked, problem = [], make_problem(config)
    monkeypatch.setattr(add, "compute_posterior", lambda *x: asked.append(x) or KNOWN)
    monkeypatch.setattr(posterior.Posterior, "make_uncertainty", lambda *_: {"relaxation_sd": 0.123})
    lean = Named(
        next(h.effect for h in make_hypotheses() if h.id == "superelevation"),
        {"bank_superelevation": 0.1}, {"bank_superelevation": (0.08, 0.12)}, 0.3, 20.0,
    )  # fmt: skip
    naming = make_naming(lean, fit=make_fit(problem, lean.values))
    naming.spread = np.eye(3)
    car = read_vehicle(vehicle_path)
    found = workflow.Found(naming, find_formula(fit=make_fit(problem, lean.values | {"cy_front": 1.1})))
    found.read = [("fit", "a"), ("held_out", "b"), ("fit", "c")]
    text = add.make_vehicle_toml(car, problem, found)
    ((given, fit, vehicle, settings, logs, spread),) = asked
    assert given is problem and fit is found.final and vehicle is car and spread is naming.spread
    assert settings == FORMULA.settings() and logs == ["a", "c"]
    (line,) = [x for x in text.splitlines() if x.startswith("superelevation = ")]
    assert line.startswith("superelevation = 0.1 ") and line.endswith("95 %: 0.08 .. 0.12")
    assert "closes 30 % of the gap, evidence 20 nats" in text
    assert [x for x in text.splitlines() if x.startswith("relaxation_sd = 0.123")]
    assert "# Fitted together: stiffness, superelevation, a formula." in text


def test_the_files_of_the_car_have_the_same_values_and_no_formula_of_an_earlier_run(
    monkeypatch, vehicle_path, config, tmp_path
):
    monkeypatch.setattr(add, "compute_posterior", lambda *_: KNOWN)
    problem = make_problem(config)
    naming = make_naming(name_effect(), fit=make_fit(problem, {"body_roll_gain": 0.01}))
    fit = make_fit(problem, {"body_roll_gain": 0.01})
    paths = add.write_vehicle(tmp_path, vehicle_path, problem, workflow.Found(naming, find_formula(fit=fit)))
    assert [p.name for p in paths] == ["vehicle_improved.toml", "effects.h"]
    there = [tmp_path / "formula.toml", tmp_path / "tse_formula.h"]
    assert add.write_formula_files(tmp_path, paths[0]) == there and all(p.exists() for p in there)
    first = read_vehicle(paths[0])
    assert first.formula.text == FORMULA.text and "k * vel_y" in there[0].read_text(encoding="utf-8")
    assert paths[1].read_text(encoding="utf-8") == add.make_header(first)
    again = tmp_path / "again"
    again.mkdir()
    kept, _ = add.write_vehicle(again, paths[0], problem, workflow.Found(naming))  # its own formula
    assert read_vehicle(kept).formula.text == FORMULA.text
    bare, _ = add.write_vehicle(tmp_path, vehicle_path, problem, workflow.Found(naming))
    assert read_vehicle(bare).formula is None and not any(p.exists() for p in there)


def test_an_improved_file_without_effects_says_so(monkeypatch, vehicle_path, config):
    problem = make_problem(config)
    text = make_improved(monkeypatch, read_vehicle(vehicle_path), problem)
    assert text.splitlines()[1] == "# Stiffness fitted, nothing added." and "closes" not in text
    text = make_improved(monkeypatch, read_vehicle(vehicle_path), problem, discovery=find_formula())
    assert text.splitlines()[1] == "# Fitted together: stiffness, a formula."


def test_the_header_sets_each_setting_below_its_heading(vehicle_path):
    vehicle = read_vehicle(vehicle_path)
    vehicle.name = "My */ Car \\ 2"
    vehicle.values["body_roll_gain"] = 0.01
    text = add.make_header(vehicle)
    lines = text.splitlines()
    assert "#ifndef TSE_EFFECTS_MY_CAR_2_H" in lines
    assert "static inline void tse_config_my_car_2(tse_config *c) {" in lines
    assert text.count("*/") == text.count("/*") and "\\" not in text and "car.toml" in text
    roll = next(k for k, x in enumerate(lines) if "c->body_roll_gain" in x)
    assert "(tse_setting)0.01;  /* rad s2/m: roll angle / lateral acceleration" in lines[roll]
    heading = [x for x in lines[:roll] if x.startswith("  /*")][-1]
    assert heading == f"  /* effect body_roll: {load_catalogue()['body_roll'].title} */"
    (axle,) = [x for x in lines if "c->driven_axle" in x]
    assert " = 0;  /* driven axle" in axle
    vehicle.name = "//"
    assert "tse_config_car(" in add.make_header(vehicle)


@pytest.mark.parametrize(
    ("key", "group"),
    [
        ("mass", "vehicle"),
        ("mass_sd", "uncertainty of the parameters"),
        ("accel_y_latency", "latencies of the channels"),
        ("accel_y_sd", "sensors and initial values of the filter"),
    ],
)
def test_a_setting_has_its_heading(key, group):
    assert add._find_group(key) == group


def test_formula_files_are_listed_if_the_improved_file_has_a_formula(vehicle_path, tmp_path):
    assert add.write_formula_files(tmp_path, vehicle_path) == []


# ---- check


def make_detectable(i: str, smallest: float, typical: float = 1.0, absorbed: float = 0.25) -> Detectable:
    p = load_catalogue()[i].strengths[0]
    return Detectable(i, p.name, p.unit, smallest, typical, absorbed)


ABSORBED = next(i for i, e in load_catalogue().items() if e.occurrence == "ABSORBED")


@pytest.mark.parametrize(
    ("sizes", "code"),
    [
        ({"body_roll": 0.5, "relaxation": 1.0}, 0),
        ({"body_roll": 0.5, "relaxation": 1.1}, 3),
        ({"body_roll": 2.0, "relaxation": 2.0}, 4),
        ({"body_roll": 0.5, ABSORBED: 2.0}, 0),  # nothing is searched that the stiffness absorbs
        ({}, 4),
    ],
)
def test_a_check_is_usable_if_every_effect_that_is_searched_is_visible(sizes, code):
    found = check.Check([make_detectable(i, x) for i, x in sizes.items()], {}, [])
    assert found.code == code


def test_a_check_lists_the_most_visible_effect_first_and_where_the_others_would_be():
    effects = [
        make_detectable("relaxation", np.inf, absorbed=-0.1),
        make_detectable("body_roll", 0.008, 0.01, 0.376),
        make_detectable("rear_roll_steer", 0.01, 0.05),
        make_detectable("steering_lag", 0.09, 0.04),
        make_detectable("steering_ratio", 0.05, 0.04),
    ]
    found = check.Check(effects, {"accel_y": 1.234, "yaw_rate": 0.99}, ["a note"])
    lines = found.text().splitlines()
    assert [x.split()[0] for x in lines[1:6]] == [
        "rear_roll_steer",
        "body_roll",
        "steering_ratio",
        "steering_lag",
        "relaxation",
    ]
    assert lines[1].split()[1:] == ["gain", "0.01", "0.05", "yes", "25", "%"]
    assert lines[2].split()[1:] == ["gain", "0.008", "rad", "s2/m", "0.01", "rad", "s2/m", "yes", "38", "%"]
    assert lines[5].split()[1:] == ["length", "never", "1", "m", "no", "0", "%"]
    assert lines[7].startswith("2 of 5 effects would be named at their typical size (")
    assert [x.partition(":")[0].strip() for x in lines[9:12]] == [
        "steering_ratio",
        "steering_lag",
        "relaxation",
    ]
    assert load_catalogue()["relaxation"].channels in lines[11]
    assert "ratio of residual to sensor noise: accel_y 1.23, yaw_rate 0.99;" in lines[-2]
    assert lines[-1] == "note: a note"
    document = found.as_json()
    assert [e["visible"] for e in document["effects"]] == [False, True, True, False, False]
    assert document["usable"] == "in part" and document["notes"] == ["a note"]


# ---- plan


def make_option(name: str = "m", nats: float = 16.0, shows: float = 40.0, share: float = 0.4, seconds=20.0):
    return plan.Option(name, seconds, nats, shows, share)


@pytest.mark.parametrize(
    ("nats", "needed", "separable"),
    [
        (16.0, 10.0, True),
        (4.0, 40.0, True),
        (8 * 20 / 3600, 3600, True),
        (0.04, 4000, False),
        (0.0, np.inf, False),
    ],
)
def test_two_effects_are_separable_if_the_best_manoeuvre_takes_an_hour_at_most(nats, needed, separable):
    option = make_option(nats=nats)
    assert option.needed == pytest.approx(needed)
    assert plan.ManeuverPlan("a", "b", [option]).separable == separable
    assert not plan.ManeuverPlan("a", "b", []).separable


def test_a_plan_says_how_long_to_drive_and_rates_the_others():
    options = [make_option("best", 4.0), make_option("next", 0.05, share=0.05), make_option("third", 0.03)]
    lines = plan.ManeuverPlan("a", "b", options).text(2).splitlines()
    assert lines[0] == "To separate a and b, drive: best, for 40 s, 2 times. An evidence of 8 nats is enough."
    assert lines[2].split("  ")[1].strip() == "nats in 20 s"
    assert lines[3].split() == ["best", "4.0", "40", "40", "%"] and len(lines) == 5
    assert lines[4].split() == ["next", "0.1", "3200", "5", "%"]
    last = plan.ManeuverPlan("a", "b", options).text(3).splitlines()[-1]
    assert last.split() == ["third", "0.0", "over", "an", "hour", "40", "%"]
    lines = plan.ManeuverPlan("a", "b", [make_option("best", 8.0)]).text(3).splitlines()
    assert lines[0].startswith("To separate a and b, drive: best, once (20 s).") and "one run" in lines[3]
    lines = plan.ManeuverPlan("a", "b", [make_option("best", 3.0)]).text(3).splitlines()
    assert lines[0].startswith("To separate a and b, drive: best, for 53 s, 3 times.")  # not 2.67 times


@pytest.mark.parametrize(("share", "warns"), [(0.09, True), (0.1, False)])
def test_a_plan_warns_of_a_small_share_of_the_evidence(share, warns):
    text = plan.ManeuverPlan("a", "b", [make_option(share=share)]).text(1)
    assert ("is only 9 % of the evidence" in text) == warns == ("needs 10 %" in text)


@pytest.mark.parametrize(
    ("shows", "why"),
    [((7.9, 8.0), "the other effect explains the same residual"), ((7.9, 0.0), "no manoeuvre in which both")],
)
def test_a_plan_says_why_effects_cannot_be_separated(shows, why):
    options = [make_option(nats=0.0, shows=x) for x in shows]
    text = plan.ManeuverPlan("a", "b", options).text(1)
    assert text.startswith("a and b cannot be separated by any of the 2 manoeuvres:") and why in text


def test_the_best_manoeuvre_gives_most_evidence_a_second(monkeypatch, vehicle_path):
    rates = {"long": (30.0, 60.0), "short": (10.0, 10.0), "other": (10.0, 10.0), "none": (0.0, 5.0)}
    monkeypatch.setattr(plan, "make_candidates", lambda _: [SimpleNamespace(name=n) for n in rates])
    asked = []

    def judge_one(candidate, config, first, second):
        asked.append((first.id, second.id))
        nats, seconds = rates[candidate.name]
        return make_option(candidate.name, nats, seconds=seconds)

    monkeypatch.setattr(plan, "compute_worth", judge_one)
    found = plan.make_plan("relaxation, body_roll", vehicle_path)
    assert [o.name for o in found.options] == ["other", "short", "long", "none"]
    assert (found.first, found.second) == ("relaxation", "body_roll") and set(asked) == {
        ("relaxation", "body_roll")
    }


@pytest.mark.parametrize("pair", ["relaxation", "relaxation,relaxation", "relaxation,body_roll,mass", ""])
def test_a_plan_is_for_two_different_effects(pair):
    with pytest.raises(UserError, match="is not two effects"):
        plan.read_pair(pair)
    assert [e.id for e in plan.read_pair(" body_roll ,mass,")] == ["body_roll", "mass"]


def test_the_evidence_is_half_of_each_channel_s_rows_times_the_logarithm_of_its_mean_square(config):
    problem = make_problem(config)
    n = len(problem.weight) // 3
    residuals = np.zeros(3 * n)
    residuals[problem.rows.of("accel_y")] = 2.0
    residuals[problem.rows.of("yaw_rate")] = 0.5
    expected = 0.5 * n * (np.log(1 + 4) + np.log(1 + 0.25))
    assert plan.compute_expected_nats(problem, residuals) == pytest.approx(expected)
    assert plan.compute_expected_nats(problem, np.zeros(3 * n)) == 0


def test_typical_values_have_the_plausible_sign_and_lie_within_the_limits(config):
    problem = make_problem(config)
    roll = load_catalogue()["rear_roll_steer"]
    found = plan.make_typical_values(problem, roll)
    assert found == pytest.approx(
        {"rear_roll_steer_gain": 0.065, "rear_roll_steer_frequency": 1.5, "rear_roll_steer_damping": 0.3}
    )
    down = replace(roll, parameters=tuple(replace(p, sign=-1) for p in roll.parameters))
    assert plan.make_typical_values(problem, down)["rear_roll_steer_gain"] == pytest.approx(-0.065)
    narrow = replace(roll, parameters=tuple(replace(p, high=0.04) for p in roll.strengths))
    assert plan.make_typical_values(problem, narrow) == {"rear_roll_steer_gain": 0.04}
    free = replace(roll, parameters=tuple(replace(p, sign=0) for p in roll.strengths))
    assert plan.make_typical_values(problem, free)["rear_roll_steer_gain"] > 0


def test_a_typical_road_is_a_sine_of_400_m_with_the_typical_rms(config):
    problem = make_problem(config)
    bank = load_catalogue()["bank"]
    found = plan.make_typical_values(problem, bank)
    scale = bank.strengths[0].scale
    assert found == pytest.approx({
        Own("bank", 0, k): np.sqrt(2) * scale * np.sin(2 * np.pi * k * KNOT_DISTANCE / 400)
        for k in range(len(found))
    })  # fmt: skip
    assert len(found) == 3  # of 75 m


def test_a_manoeuvre_that_excites_nothing_separates_nothing(config):
    straight = make_candidate(angle=0.0)
    pair = load_catalogue()["relaxation"], load_catalogue()["steering_lag"]
    found = plan.compute_worth(straight, config, *pair)
    assert (found.nats, found.shows, found.share) == (0.0, 0.0, 0.0)
    assert (found.name, found.seconds) == ("slalom", pytest.approx(4.0))


@pytest.mark.parametrize(
    ("left", "nats", "shows", "share"),
    [  # left of: plain car, car with the other effect; of the second hidden effect the same
        ([4.0, 1.0, 2.0, 1.5], 1.0, 2.0, (1.0, 4.0)),
        ([2.0, 1.5, 4.0, 1.0], 1.0, 2.0, (1.0, 4.0)),
        ([2.0, 3.0, 2.0, 2.5], 2.0, 2.0, (2.0, 2.0)),  # no more than the plain car
        ([4.0, 0.02, 2.0, 1.0], 0.0, 2.0, (0.0, 4.0)),  # below 2 % of it: of the integration
    ],
)
def test_of_both_hidden_effects_the_one_that_is_harder_to_separate_counts(
    config, monkeypatch, left, nats, shows, share
):
    pair = load_catalogue()["relaxation"], load_catalogue()["steering_lag"]
    made, asked = iter(left), []

    def fit(problem, parameters, *_, **__):
        hidden = [
            e.id
            for e in pair
            if np.abs(problem.compute_residuals(plan.make_typical_values(problem, e))).max() < 0.1
        ]
        asked.append((hidden, [p.name for p in parameters if p not in STIFFNESS_PARAMETERS]))
        return make_fit(problem, size=next(made))

    monkeypatch.setattr(plan, "fit_parameters", fit)
    found = plan.compute_worth(make_candidate(), config, *pair)
    n = len(make_problem(config).weight)
    worth = {x: 0.5 * n * np.log1p(x**2) for x in (0.0, 1.0, 2.0, 4.0)}
    assert (found.nats, found.shows) == pytest.approx((worth[nats], worth[shows]))
    assert found.share == pytest.approx(worth[share[0]] / worth[share[1]])
    assert asked == [
        (["relaxation"], []),
        (["relaxation"], ["steering_lag_time", "steering_lag_second"]),
        (["steering_lag"], []),
        (["steering_lag"], ["relaxation_length"]),
    ]


def test_the_other_effect_is_fitted_from_its_typical_size_with_shapes_of_the_typical_range(
    config, monkeypatch
):
    pair, given = (load_catalogue()["relaxation"], load_catalogue()["rear_roll_steer"]), []

    def fit(problem, parameters, start, most=12, tolerance=1e-4):
        given.append((list(parameters), dict(start), most, tolerance))
        return make_fit(problem, {"cy_front": 0.9})

    monkeypatch.setattr(plan, "fit_parameters", fit)
    plan.compute_worth(make_candidate(), config, *pair)
    plain, roll, _, relaxation = given
    assert plain == (list(STIFFNESS_PARAMETERS), {}, 12, 1e-6)
    problem = make_problem(config)
    for found, other in ((roll, pair[1]), (relaxation, pair[0])):
        assert found[1:] == ({"cy_front": 0.9} | plan.make_typical_values(problem, other), 30, 1e-6)
    shapes = roll[0][-2:]
    assert [p.name for p in shapes] == [p.name for p in pair[1].shapes]
    assert [(p.low, p.high) for p in shapes] == [(1.2, 2.0), (0.2, 0.4)]  # of Hz, and of damping
    assert roll[0][-3] == pair[1].strengths[0]


# ---- a whole run, whose slow steps are made up


@pytest.fixture
def whole(monkeypatch, vehicle_path, config):
    """Return a function that runs the workflow, and what its steps were given.

    The car has body roll, which is named; the logs are one slalom, fitted and held out.
    """
    ready = {
        name: replace(prepare_candidate(make_candidate(), config)[0], notes=[f"note of {name}"])
        for name in ("fitted", "held", "bare")
    }
    ready["bare"] = replace(ready["bare"], stretches=[])
    car, seen = read_vehicle(vehicle_path), {}
    roll = name_effect(look_alikes=["imu_scale_ay"])
    naming = make_naming(roll, fit=make_fit(Problem([ready["fitted"]], config), roll.values))
    naming.baseline = make_fit(Problem([ready["fitted"]], config), {"cy_front": 1.2}, 3.0)

    def record(key, result):
        return lambda *given, **_: seen.setdefault(key, []).append(given) or result(*given)

    results = {
        "read_vehicle": lambda _: car,
        "read_logs": lambda logs, *_: (list(logs), config),
        "read_agreeing": lambda logs, *_: list(logs),
        "prepare": lambda log, _: ready[log],
        "find_roads": lambda logs, *_: workflow.Roads(logs, ["a profile"]),
        "closes_part": lambda *_: True,
        "place_on_roads": lambda roads, held, *_: held.of(held.logs),
        "explain_remainder": lambda few, held, before, say: (find_formula(formula=None), before, ["a rival"]),
        "calibrate_every_car": lambda *_: "every car",
        "compute_stages": lambda level, *_: {"yaw_rate": level.logs[0].notes},
        "leaves_something": lambda *_: False,
        "is_long": lambda _: False,
    }
    for key, result in results.items():
        monkeypatch.setattr(workflow, key, record(key, result))
    steps = {
        (workflow.name, "fit_plain_car"): lambda p: make_fit(p, size=2.0),
        (workflow.name, "name_effects"): lambda *_: naming,
        (workflow.where, "find_conditions"): lambda *_: [],
        (workflow.where, "find_entries"): lambda *_: [],
        (workflow.remainder, "find_remainders"): lambda *_: [],
        (workflow.detect, "compute_detectable"): lambda *_: [
            make_detectable("relaxation", 0.5), make_detectable("mass", 2.0),
            make_detectable("imu_scale_ay", 3.0),
        ],
    }  # fmt: skip
    for (module, key), result in steps.items():
        monkeypatch.setattr(module, key, record(key, result))

    def run(*logs, **more):
        return workflow.run_workflow(logs or ["fitted"], vehicle_path, **more)

    return SimpleNamespace(run=run, seen=seen, car=car, naming=naming, patch=monkeypatch, config=config)


def test_a_run_without_held_out_logs_has_one_part_and_no_search_for_a_formula(whole):
    found = whole.run()
    assert (found.verdict, found.held, found.held_level, found.held_out) == ("named", None, None, {})
    assert list(found.stages) == ["fit"] and found.read == [("fit", "fitted")] and found.discovery is None
    assert "explain_remainder" not in whole.seen and found.notes == ["note of fitted"]
    assert found.fit_before == pytest.approx(dict.fromkeys(MEASURES, 3.0))
    assert found.fit_after == pytest.approx(dict.fromkeys(MEASURES, 1.0))
    assert found.roads.found == ["a profile"] and whole.seen["name_effects"][0][4] == ["a profile"]


def test_effects_are_visible_or_not_among_those_that_are_not_named(whole):
    found = whole.run()
    _, fit, effects = whole.seen["compute_detectable"][0]
    assert fit is whole.naming.final and {e.id for e in effects} == set(load_catalogue()) - {"body_roll"}
    assert [d.id for d in found.undetectable] == ["mass"]  # no look-alike of a name
    assert [d.id for d in found.detectable] == ["relaxation", "mass", "imu_scale_ay"]


def test_held_out_logs_are_compared_before_and_after_in_the_stages_and_in_the_verdict(whole):
    whole.patch.setattr(
        workflow.Problem,
        "compute_residuals",
        lambda self, values: np.full(len(self.weight), 4.0 if "cy_front" in values else 1.5),
    )
    whole.patch.setattr(
        workflow.remainder, "find_remainders", lambda p, r, v, limit: [LEFT] if r.max() == 1.5 else []
    )
    found = whole.run(hold_out=["held"])
    change = found.held_out["yaw_rate"]
    assert (change.before, change.after) == pytest.approx((4.0, 1.5))
    assert found.stages == {
        "fit": {"yaw_rate": ["note of fitted"]},
        "held_out": {"yaw_rate": ["note of held"]},
    }
    assert found.read == [("fit", "fitted"), ("held_out", "held")] and found.elsewhere == [LEFT]
    assert found.remainders == [] and found.notes == ["note of fitted", "note of held"]
    assert any("does not explain the held-out logs" in w for w in found.words)
    fitted, held = whole.seen["compute_stages"]
    assert [part[1][0].notes for part in (fitted, held)] == [["note of fitted"], ["note of held"]]
    assert held[0] is found.held_level is not found.held is held[3][0] and fitted[0] is found.level
    assert fitted[2] == held[2] == "every car" and fitted[3][1] == held[3][1] == whole.naming.final.values
    assert whole.run(hold_out=["bare"]).held is None


@pytest.mark.parametrize("cause", ["asked", "held", "left"])
def test_a_formula_is_searched_for_if_asked_for_or_if_something_is_left(whole, cause):
    if cause == "held":
        whole.patch.setattr(workflow, "leaves_something", lambda *_: True)
    if cause == "left":
        whole.patch.setattr(workflow, "find_excess_remainders", lambda *_: [LEFT])
    found = whole.run(formula=cause == "asked")
    assert found.discovery is not None and found.rivals == ["a rival"]
    assert len(whole.seen["explain_remainder"]) == 1
    whole.car.formula = FORMULA
    again = whole.run(formula=True)
    assert again.discovery is None and len(whole.seen["explain_remainder"]) == 1
    assert "the formula a1 of the vehicle file is kept, so no formula is searched for" in again.notes


def test_a_formula_moves_the_sizes_that_were_fitted_with_it(whole):
    later = make_fit(
        Problem(prepare_candidate(make_candidate(), whole.config), whole.config), {"body_roll_gain": 0.013}
    )
    discovery = find_formula(fit=later)
    whole.patch.setattr(workflow, "explain_remainder", lambda few, held, before, say: (discovery, before, []))
    (named,) = whole.run(formula=True).naming.named
    assert named.values["body_roll_gain"] == 0.013
    assert named.ci95["body_roll_gain"] == pytest.approx((0.012, 0.014))


def test_roads_that_explain_nothing_are_level(whole):
    whole.patch.setattr(workflow, "closes_part", lambda *_: False)
    found = whole.run()
    assert found.problem is found.level and found.roads.found == []
    whole.patch.setattr(workflow, "closes_part", lambda *_: True)
    assert whole.run().problem is not found.level


def test_a_road_that_is_known_is_that_of_all_logs(whole):
    asked, other = [], {"fitted": "held", "held": "fitted"}
    whole.patch.setattr(
        workflow, "add_road", lambda log, road, config: asked.append((log, road)) or (other[log], None)
    )
    found = whole.run(hold_out=["held"], road="way")
    assert asked == [("fitted", "way"), ("held", "way")]
    assert found.read == [("fit", "held"), ("held_out", "fitted")]
    assert found.level.logs[0].notes == ["note of held"] and found.held.logs[0].notes == ["note of fitted"]


def test_each_log_is_compared_without_its_latencies(whole):
    marked = Path("in time")
    whole.patch.setattr(workflow, "remove_latencies", lambda log, _: replace(log, path=marked))
    found = whole.run(hold_out=["held"])
    for problem in (found.level, found.problem, found.held_level):
        assert [log.path for log in problem.logs] == [marked]
    roads, held, ready, logs, config, notes = whole.seen["place_on_roads"][0]
    assert (ready[0].notes, logs, config) == (["note of held"], ["held"], whole.config)
    assert held is found.held_level and ready[0].path != marked and roads == [] and notes is found.notes


def test_a_formula_of_an_excerpt_is_fitted_to_all_logs_and_acts_in_all_that_is_said(whole):
    """Excerpts of the fitted and of the held-out logs are searched.

    The road of the fitted logs and what the formula explains are told apart.
    """
    (log,) = prepare_candidate(make_candidate(3.0), whole.config)
    few = Problem([replace(log, road={"bank": np.zeros(len(log.time))})], whole.config)
    few_held, excerpts = few.of([log]), []

    def choose(problem, fit):
        excerpts.append(problem)
        return (few, few_held)[len(excerpts) - 1]

    first, later = find_formula(), find_formula()
    last = make_naming(name_effect(value=0.02), fit=make_fit(None, {"body_roll_gain": 0.02}))
    refits, simulated = [], []

    def refit(problem, final, discovery):
        refits.append((final, discovery))
        values = {"body_roll_gain": 0.03, Own("bank", 0, 0): 0.1}
        later.fit = make_fit(problem, values, 1.7)
        return later

    def simulate_again(problem, values):
        simulated.append((problem, dict(values)))
        return np.full(len(problem.weight), 1.0 + len(simulated))

    last.baseline = make_fit(Problem(prepare_candidate(make_candidate(), whole.config), whole.config),
                             {"cy_front": 1.3}, 2.5)  # fmt: skip
    whole.patch.setattr(workflow, "is_long", lambda _: True)
    whole.patch.setattr(workflow, "choose_excerpt", choose)
    whole.patch.setattr(
        workflow.name, "fit_plain_car", lambda p: make_fit(p, {"on": bool(p.logs[0].road)}, 2.0)
    )
    whole.patch.setattr(workflow.name, "refit_on_all", lambda *_: last)
    whole.patch.setattr(workflow.search, "refit_on_all", refit)
    whole.patch.setattr(workflow.Problem, "compute_residuals", simulate_again)
    explained = []
    whole.patch.setattr(
        workflow, "explain_remainder", lambda *x: explained.append(x) or (first, whole.naming, ["a rival"])
    )
    whole.patch.setattr(workflow, "leaves_something", lambda held, naming: held is few_held)
    found = whole.run(hold_out=["held"])
    assert excerpts == [found.problem, found.held] and explained[0][:2] == (few, few_held)
    problem, baseline = whole.seen["find_entries"][0]
    assert problem is few and baseline.values == {"on": False}
    assert len(baseline.residuals) == len(few.weight)
    assert whole.seen["find_conditions"][0][0] is found.level
    assert refits == [(last.final, first)] and found.discovery is later and found.naming is not last
    settings = {"body_roll_gain": 0.03} | FORMULA.settings()
    assert simulated == [(found.held, settings), (found.held_level, {"cy_front": 1.3})]
    change = found.held_out["yaw_rate"]
    assert (change.before, change.after) == pytest.approx((3.0, 2.0))
    fitted, held = whole.seen["compute_stages"]
    assert fitted[3] == (found.problem, settings | {Own("bank", 0, 0): 0.1})
    assert held[3] == (found.held, settings)
    assert found.fit_after == pytest.approx(dict.fromkeys(MEASURES, 1.7))
    assert found.fit_before == pytest.approx(dict.fromkeys(MEASURES, 2.5))
    problem, residuals, values, limit = whole.seen["find_remainders"][-1]
    assert problem is found.problem and residuals is later.fit.residuals
    assert values is later.fit.values and limit == 1.2
    assert found.naming.named[0].values == {"body_roll_gain": 0.03}


def test_a_fit_that_has_not_converged_is_said_and_a_log_that_cannot_be_compared_is_refused(whole):
    whole.naming.converged = False
    assert whole.run().notes[-1].startswith("the last fit has not converged")
    with pytest.raises(UserError, match="note of bare"):
        whole.run("bare")


def test_of_long_logs_an_excerpt_is_searched_and_all_is_fitted_at_the_end(whole):
    short = Problem(prepare_candidate(make_candidate(3.0), whole.config), whole.config)
    whole.patch.setattr(workflow, "is_long", lambda _: True)
    whole.patch.setattr(workflow, "choose_excerpt", lambda problem, fit: short)
    last = make_naming(name_effect(value=0.02), fit=make_fit(None, {"body_roll_gain": 0.02}))
    last.final = last.baseline = make_fit(
        Problem(prepare_candidate(make_candidate(), whole.config), whole.config), {}
    )
    whole.patch.setattr(workflow.name, "refit_on_all", lambda problem, naming, baseline: last)
    found = whole.run()
    assert whole.seen["name_effects"][0][0] is short and whole.seen["compute_detectable"][0][0] is short
    assert found.naming is last and found.problem.logs[0].seconds > short.logs[0].seconds
    assert "the search for effects uses the most informative 2 s of 4 s" in found.notes


def test_a_check_of_logs_that_cannot_be_compared_says_why(monkeypatch, vehicle_path, config):
    (log,) = prepare_candidate(make_candidate(), config)
    log = replace(log, stretches=[], notes=["too slow"])
    monkeypatch.setattr(
        check.workflow, "read_logs", lambda *_: ([SimpleNamespace(notes=["of the log"])], config)
    )
    monkeypatch.setattr(check, "prepare_all", lambda *_: [log])
    with pytest.raises(UserError, match=r"^too slow$"):
        check.check_model([Path("x")], vehicle_path)


def test_a_check_has_the_gap_of_the_fitted_car_and_the_notes_of_the_logs(monkeypatch, vehicle_path, config):
    log = replace(prepare_candidate(make_candidate(), config)[0], notes=["of the problem"])
    monkeypatch.setattr(
        check.workflow, "read_logs", lambda *_: ([SimpleNamespace(notes=["of the log"])], config)
    )
    monkeypatch.setattr(check, "prepare_all", lambda *_: [log])
    monkeypatch.setattr(
        check, "fit_parameters", lambda problem, parameters, start: make_fit(problem, size=1.25)
    )
    monkeypatch.setattr(check.detect, "compute_detectable", lambda problem, fit, effects: [len(effects)])
    found = check.check_model([Path("x")], vehicle_path)
    assert found.gap == pytest.approx(dict.fromkeys(MEASURES, 1.25))
    assert found.notes == ["of the log", "of the problem"] and found.effects == [len(load_catalogue())]


def test_what_every_car_has_is_calibrated(vehicle_path, config):
    """The steering angle is logged 30 ms late, and the front tyres are 20 % softer."""
    ready = []
    for log in prepare_candidate(make_candidate(pieces=2), config):
        measured = simulate(config, log, MEASURES, {"cy_front": 0.8}, {})
        late = np.interp(log.time - 0.03, log.time, log.inputs["steer_angle"])
        ready.append(replace(log, measured=measured, inputs=log.inputs | {"steer_angle": late}))
    bare = replace(ready[0], stretches=[])
    found = stages.calibrate_every_car([*ready, bare], config, read_vehicle(vehicle_path), 1)
    assert found.steer_angle_latency == pytest.approx(0.03, abs=0.003)
    assert found.cornering_stiffness_front == pytest.approx(0.8 * 110e3, rel=0.03)
    assert found.mass == config.mass and found.body_roll_gain == 0
