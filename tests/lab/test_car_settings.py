"""Settings of a run and contents of a vehicle file, function by function: precedence,
limits, defaults, notes, and what is refused."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tse.car import config as module
from tse.car import vehicle as file
from tse.car.config import make_config
from tse.car.formula import Number, parse, write_formula
from tse.car.vehicle import Vehicle, make_filter_values, make_vehicle
from tse.library.core import Config, SettingError, library
from tse.library.errors import UserError
from tse.library.files import parse_toml
from tse.log.rows import CheckedLog, list_columns

CAR = {"mass": 1600.0, "lf": 1.0, "lr": 1.5, "wheel_radius_front": 0.3, "wheel_radius_rear": 0.36}
PATH = Path("car.toml")


def make(**keys) -> Vehicle:
    """Return a car. A key is one of the file, or a table."""
    return make_vehicle({n: dict(x) if isinstance(x, dict) else x for n, x in (CAR | keys).items()}, PATH)


def make_log(rows: int = 2000, step: float = 0.01, extra: dict | None = None, **channels) -> CheckedLog:
    time = np.arange(rows) * step
    data = pd.DataFrame({c: channels.get(c, np.zeros(rows)) for c in list_columns()[1:]})
    more = {"extra": pd.DataFrame(extra)} if extra else {}
    return CheckedLog(Path("x.csv"), time, data, pd.DataFrame(), np.arange(rows) + 2, step, **more)


def calibrate(names=("cx_front", "cy_front", "cy_rear"), sd=(0.1, 0.02, 0.05), mean=None, **more) -> dict:
    """Return a table [calibration]."""
    mean = [0.0] * len(names) if mean is None else mean
    return {"names": list(names), "mean": mean, "covariance": np.diag(np.square(sd)).tolist(), **more}


# ---- Settings of a run


def test_options_override_the_file_of_the_filter_and_this_the_car(tmp_path: Path) -> None:
    path = tmp_path / "filter.toml"
    path.write_text("mass = 1700.0\n[filter]\nlf = 1.1\ngrip = 0.9\n")
    assert module.read_filter_file(path) == {"mass": 1700.0, "lf": 1.1, "grip": 0.9}
    config, _ = make_config(make(), None, path, {"lf": 1.2, "grip": None, "lr": 1.4})
    assert (config.mass, config.lf, config.lr, config.grip) == (1700.0, 1.2, 1.4, 0.9)
    assert config.wheel_radius_rear == 0.36
    for text, message in (
        ("filter = 3", "filter must be a table"),
        ("grip = 1.0\n[filter]\ngrip = 1.0", "key grip appears twice"),
        ("[filter]\ngripp = 1.0", "key gripp: "),
        ("grip = 60.0", "key grip: "),
    ):
        path.write_text(text)
        with pytest.raises(UserError, match=re.escape(str(path)) + f": {message}"):
            module.read_filter_file(path)
    with pytest.raises(SettingError, match="option --max-gap"):
        make_config(make(), None, None, {"max_gap": 5.0})


def test_notes_are_asked_for_the_effects_of_the_file_and_all_settings_of_the_run(
    tmp_path, monkeypatch
) -> None:
    seen = []
    monkeypatch.setattr(module, "unused_notes", lambda config, *given: seen.append(given) or [])
    path = tmp_path / "filter.toml"
    path.write_text("grip = 0.9\n")
    car = make(effects={"tyre_saturation": {"shape": 0.6}})
    make_config(car, None, path, {"max_gap": 0.3, "seed": None})
    assert seen == [({file.SHAPE: 0.6, "grip": 0.9, "max_gap": 0.3}, False)]


def test_particles_have_the_values_of_the_file_without_the_prior_of_the_default_filter() -> None:
    car = make(calibration=calibrate(), sensors={"accel_y_sd": 0.2})
    config, _ = make_config(car, None, None, None, "robust")
    assert config.accel_y_sd == 0.2 and config.form == 1
    assert make_config(car, None)[0].accel_y_sd != 0.2


def test_a_stated_height_and_grade_of_a_calibrated_car_are_those_of_its_file() -> None:
    ordinary = file._compute_class_values(1600.0, 1.0, 1.5)
    car = make_filter_values(make(calibration=calibrate()))
    assert {n: car[n] for n in ("cg_height", "grade_sd")} == {
        n: ordinary[n] for n in ("cg_height", "grade_sd")
    }
    car = make_filter_values(make(calibration=calibrate(), cg_height=0.9))
    assert car["cg_height"] == 0.9


@pytest.mark.parametrize(
    ("step", "gap", "used", "longest", "notes"),
    [
        (0.01, 0.25, 0.01, 0.25, 0),
        (0.05, 0.25, 0.05, 0.25, 0),
        (0.08, 0.25, 0.08, 0.4, 0),  # five rows
        (0.01, 0.5, 0.01, 0.5, 0),  # the one that is set is longer
        (0.3, 0.25, 0.1, 1.0, 1),  # both are at their limits
        (0.0005, 0.25, 0.001, 0.25, 1),
    ],
)
def test_sampling_follows_from_the_log_within_its_limits(step, gap, used, longest, notes) -> None:
    config = Config({"max_gap": gap})
    said = module.set_sampling(config, step)
    assert config.sample_time == pytest.approx(used) and config.max_gap == pytest.approx(longest)
    assert len(said) == notes
    if notes:
        assert said[0].startswith(f"rows are {step:.3g} s apart") and said[0].endswith(f"is {used:g} s")


@pytest.mark.parametrize(
    ("front", "rear", "is_one"),
    [
        (60.0, 50.0, True),
        (1.0005, 1.0, True),
        ("slip", 50.0, False),  # 0.2 %
        (60.0, 4.9, False),  # too slow
        (-60.0, -50.0, True),  # backwards
    ],
)
def test_wheel_speeds_are_one_signal_if_their_ratio_is_constant(front, rear, is_one) -> None:
    n = 1000
    roll = np.linspace(50.0, 70.0, n) / 50.0
    a = 50.0 * roll * (1.0 + 0.002 * (np.arange(n) > 900)) if front == "slip" else front * roll
    b = rear * roll if abs(rear) != 1.0 else 60.0 * roll
    a = a if front != 1.0005 else b * np.linspace(1.0, 1.0005, n)
    b = np.full(n, 4.9) if rear == 4.9 else b
    log = make_log(n, wheel_speed_front=a, wheel_speed_rear=b)
    assert module.wheels_are_one(log) is is_one
    config, notes = make_config(make(), log)
    assert config.wheel_signals == (1 if is_one else 2) and (module.ONE_SPEED in notes) is is_one


def test_wheel_speeds_of_a_car_that_hardly_rolls_are_not_compared() -> None:
    slow = np.arange(1000) < 200
    rear = np.where(slow, 4.0, np.linspace(50.0, 70.0, 1000))
    assert module.wheels_are_one(
        make_log(1000, wheel_speed_front=np.where(slow, 9.0, rear), wheel_speed_rear=rear)
    )


def test_wheel_speeds_of_few_rows_are_not_judged() -> None:
    for rows, is_one in ((500, False), (501, True)):
        x = np.where(np.arange(1000) < rows, np.linspace(50.0, 70.0, 1000), np.nan)
        assert module.wheels_are_one(make_log(1000, wheel_speed_front=x, wheel_speed_rear=x)) is is_one


def test_a_filter_is_named_by_its_form_and_uses_its_own_settings() -> None:
    for form, name in (("default", "default"), ("paper", "paper"), ("robust", "paper")):
        config, notes = make_config(make(), None, form=form)
        assert module.filter_of(config) == name
        assert any(n.startswith(f"form {form} is the filter of the paper") for n in notes) == (
            name == "paper"
        )
        assert module.is_used("particles", config) is (name == "paper")
        assert module.is_used("model_sd", config) is (name == "default")
        assert module.is_used("mass", config) is True
    config = Config()
    assert module.filter_text(config) == "the car's Kalman filter"
    config.form = 1
    config.particles, config.forgetting, config.seed = 64, 0.95, 7
    assert module.filter_text(config) == "64 particles, forgetting 0.95, seed 7"


def test_a_setting_that_another_one_replaces_is_not_used() -> None:
    name = "tyre_saturation_inverse_friction"
    assert module.is_used(name, Config({"grip": 0.0})) and not module.is_used(name, Config({"grip": 1.0}))


@pytest.mark.parametrize(
    ("name", "form", "message"),
    [
        (
            "particles",
            "default",
            "particles has no effect with this form of the filter: it needs form robust",
        ),
        ("grip_sd", "paper", "grip_sd has no effect with this form of the filter: it needs form default"),
        ("particles", "paper", ""),
        ("grip_sd", "default", ""),
        ("mass", "paper", ""),
    ],
)
def test_a_setting_of_the_other_filter_is_refused_where_this_run_states_it(name, form, message) -> None:
    config = Config(Config.settings_of(form))
    config.set(name, {"particles": 64, "mass": 1700.0}.get(name, 0.3))
    module.check_effect([], config)  # nothing is stated
    if message:
        with pytest.raises(SettingError, match=message):
            module.check_effect([name], config)
    else:
        module.check_effect([name], config)
    module.check_effect([name], Config())  # its default value


@pytest.mark.parametrize(
    ("extra", "options", "form", "message"),
    [
        ({"brake": np.ones(2000)}, {}, "default", ""),
        ({"brake": np.ones(2000)}, {}, "paper", "column brake: only the default filter uses such columns"),
        (
            None,
            {"velocity_latency": 0.1},
            "default",
            "velocity_latency has no effect: the log has none of ins_vel_x",
        ),
        ({"ins_vel_y": np.ones(2000)}, {"velocity_latency": 0.1}, "default", ""),
        ({"brake": np.ones(2000)}, {"velocity_latency": 0.1}, "default", "velocity_latency has no effect"),
        (None, {"velocity_latency": 0.0}, "default", ""),  # its default value
        ({"vehicle_speed": np.ones(2000)}, {}, "paper", ""),  # no filter uses it
    ],
)
def test_a_setting_needs_the_channel_for_which_it_is(extra, options, form, message) -> None:
    log = make_log(extra=extra)
    if message:
        with pytest.raises(UserError, match=message):
            make_config(make(), log, options=options, form=form)
    else:
        make_config(make(), log, options=options, form=form)
    # the file of the car is for all its logs
    make_config(make(sensors={"velocity_latency": 0.1}), make_log())


def test_settings_of_optional_channels_are_those_of_their_tables() -> None:
    found = module.optional_settings()
    assert {k[0] for k in found} == {"ins_vel_x", "wheel_torque_front", "bank"}
    by = {k[0]: v for k, v in found.items()}
    assert "velocity_latency" in by["ins_vel_x"] and "velocity_lever_x" in by["ins_vel_x"]
    for first, table in (("ins_vel_x", "velocity"), ("wheel_torque_front", "pedals"), ("bank", "road")):
        assert all(library().settings[s].table == table for s in by[first]) and by[first]


def test_a_formula_and_effects_that_the_filter_has_not_are_named_once() -> None:
    config = Config()
    assert module.unused_notes(config, {}) == []
    (note,) = module.unused_notes(config, {"crosswind_speed": 5.0}, formula=True)
    assert note.startswith("effects.crosswind, formula: not used, since it is not in the filter's model")
    assert module.unused_notes(config, {"crosswind_speed": 0.0}) == []  # its default value


def test_settings_for_c_are_those_that_are_stated() -> None:
    text = module.c_settings(make(name="My */ car\u00e4", yaw_inertia=2500.0))
    assert text.startswith("/* My ?? car?. Written by tselab, not by hand. */\n")
    values = dict(re.findall(r"  c->(\w+) = (\S+); /\*", text))
    assert values["mass"] == "TSE_S(1600.0)" and values["yaw_inertia"] == "TSE_S(2500.0)"
    assert values["driven_axle"] == "1" and "particles" not in values
    config, _ = make_config(make(yaw_inertia=2500.0), None)
    for name, value in values.items():
        number = float(value.removeprefix("TSE_S(").removesuffix(")"))
        assert number == getattr(config, name), name
    assert set(config.changed()) <= set(values)
    assert "c->wheel_radius_rear = TSE_S(0.36); /* [m] */" in text
    assert module.c_settings(make_vehicle(dict(CAR), Path("x.toml"))).startswith("/* x. Written")


# ---- The vehicle file


@pytest.mark.parametrize(
    ("ratio", "wanted"), [(16.0, 16.0), (16, 16.0), (None, None), (0.0, None), (-3.0, None), ("16", None)]
)
def test_a_steering_ratio_is_a_positive_number_or_unknown(ratio: object, wanted: float | None) -> None:
    facts = {} if ratio is None else {"steering_ratio": ratio}
    assert Vehicle(None, "", {}, facts).steering_ratio == wanted


@pytest.mark.parametrize(("axle", "code"), [("front", 1), ("rear", 2), ("both", 0), (None, 1)])
def test_the_driven_axle_has_its_code(axle: str | None, code: int) -> None:
    car = make(**({} if axle is None else {"driven_axle": axle}), cg_height=0.7)
    assert make_filter_values(car)["driven_axle"] == code
    assert make_filter_values(car)["cg_height"] == 0.7
    assert make_config(car, None)[0].driven_axle == code


def test_a_car_is_exact_only_if_all_of_its_uncertainties_are_0() -> None:
    none = dict.fromkeys(file.list_uncertainty_settings(), 0.0)
    exact = make_filter_values(make(uncertainty=none))
    assert exact.get("grip", Config.exact().grip) == Config.exact().grip
    for name, value in Config.settings_of("exact").items():
        assert exact[name] == value or name in CAR or "stiffness" in name or name == "yaw_inertia", name
    one = make_filter_values(make(uncertainty=none | {"mass_sd": 0.01}))
    assert one["grip_sd"] == file._compute_class_values(1600.0, 1.0, 1.5)["grip_sd"]
    assert one["mass_sd"] == 0.01 and one["cg_sd"] == 0.0


def test_a_calibrated_car_has_no_wider_prior_than_its_class_and_no_smaller_model_sd() -> None:
    uncertainty = {"model_sd": 0.03}
    car = make_filter_values(make(calibration=calibrate(sd=(0.1, 0.02, 0.4)), uncertainty=uncertainty))
    plain = Config.exact()
    ordinary = file._compute_class_values(1600.0, 1.0, 1.5)
    assert car["initial_cx_sd"] == pytest.approx(min(0.1, plain.initial_cx_sd))
    assert car["initial_cy_front_sd"] == pytest.approx(0.02)
    assert car["initial_cy_rear_sd"] == ordinary["initial_cy_rear_sd"]
    assert car["model_sd"] == file.CALIBRATED_MODEL_SD == 0.05
    assert (car["cg_height"], car["grade_sd"]) == (ordinary["cg_height"], ordinary["grade_sd"])
    wide = make_filter_values(make(calibration=calibrate(), uncertainty={"model_sd": 0.3}))
    assert wide["model_sd"] == 0.3


@pytest.mark.parametrize(
    ("mean", "sd", "grip", "grip_sd"),
    [
        (1.25, 0.25, 0.8, 0.2),
        (1.25, 0.05, 0.8, 0.1),  # at least 0.1
        (0.1, 0.02, 5.0, 0.1),  # friction of at most 5
        (1.0, 3.0, 1.0, 1.0),  # at most 1
    ],
)
def test_the_grip_of_a_calibrated_car_is_its_friction_with_a_relative_sd(mean, sd, grip, grip_sd) -> None:
    table = calibrate((file.FRICTION,), (sd,), [mean])
    effects = {"tyre_saturation": {"inverse_friction": mean, "shape": 0.6}}
    car = make_filter_values(make(calibration=table, effects=effects))
    assert car["grip"] == pytest.approx(grip) and car["grip_sd"] == pytest.approx(grip_sd)
    assert car[file.SHAPE] == 0.6


def test_noise_that_a_calibration_found_is_not_that_of_the_filter_but_its_lever_is() -> None:
    found = dict.fromkeys(file.FOUND_SENSORS, 0.2) | {"velocity_lever_x": -1.0, "accel_y_bias_sd": 0.7}
    found |= {n: 0.01 for n in file.FOUND_SENSORS if "walk" in n}
    car = make_filter_values(make(calibration=calibrate(), sensors=found))
    ordinary, plain = file._compute_class_values(1600.0, 1.0, 1.5), Config.exact()
    for name in file.FOUND_SENSORS:
        assert car[name] == ordinary.get(name, getattr(plain, name)), name
    assert car["velocity_lever_x"] == -1.0 and car["accel_y_bias_sd"] == 0.7
    assert make_filter_values(make(sensors=found))["accel_y_sd"] == 0.2  # not calibrated: as stated


def test_stiffness_of_a_calibrated_car_has_a_95_percent_interval_by_a_factor() -> None:
    keys = {
        "cornering_stiffness_front": 90000.0,
        "cornering_stiffness_rear": 110000.0,
        "longitudinal_stiffness_front": 120000.0,
        "longitudinal_stiffness_rear": 60000.0,
    }
    table = calibrate(("cy_front", "cx_front", "cy_rear"), (0.05, 0.1, 0.02))
    car = make(calibration=table, **keys)
    known = file.list_known_stiffness(car)
    assert set(known) == {"cx_front", "cy_front", "cy_rear"}
    for key, value, sd in (("cx_front", 12e4, 0.1), ("cy_front", 9e4, 0.05), ("cy_rear", 11e4, 0.02)):
        by = np.exp(1.96 * sd)
        assert known[key] == pytest.approx((value, value / by, value * by)), key
    assert file.list_known_stiffness(make(**keys)) == {}
    assert file.describe_stiffness(car) == (
        "Stiffness at no slip, 95 % interval: front cornering 90 kN/rad (82 .. 99), rear cornering 110 "
        "kN/rad (106 .. 114), front longitudinal 120 kN (99 .. 146)."
    )
    rear = make(calibration=table, driven_axle="rear", **keys)
    assert "rear longitudinal 60 kN (49 .. 73)" in file.describe_stiffness(rear)


def test_latencies_have_the_names_of_their_channels() -> None:
    car = make(latency={"accel_y": 0.02})
    assert car.values["accel_y_latency"] == 0.02
    with pytest.raises(UserError, match=r"key latency\.yaw_rate is not known: it is the reference"):
        make(latency={"yaw_rate": 0.02})


def test_three_unknown_keys_are_listed_and_the_rest_counted() -> None:
    with pytest.raises(UserError) as error:
        make(xa=1, xb=2, xc=3)
    assert "key xc" in str(error.value) and "more" not in str(error.value)
    with pytest.raises(UserError, match=r"key xc is.*; and 1 more$"):
        make(xa=1, xb=2, xc=3, xd=4)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("mass", True, "key mass: True is not a number"),
        ("mass", "1", "key mass: '1' is not a number"),
        ("wheelbase", 2.511, "key wheelbase: 2.511 m does not agree with lf . lr = 2.5 m"),
        ("wheelbase", 2.489, "key wheelbase"),
        ("wheelbase", 2.509, ""),
        ("wheelbase", 2.491, ""),
        ("steering_ratio", 0, "key steering_ratio: 0 is not a number above 0 and below 1000"),
        ("steering_ratio", True, "key steering_ratio: True is not a number above 0 and below 1000"),
        ("track_rear", "1.5", "key track_rear: '1.5' is not a number above 0 and below 1000"),
        ("cg_height", -0.5, "key cg_height: -0.5 is not a number above 0 and below 1000"),
        ("track_front", 1000.0, "key track_front"),
        ("driven_axle", "all", "key driven_axle: 'all' is not known"),
        ("yaw_inertia", 0.0, "yaw_inertia = 0 is outside its range .*; if it is unknown, leave it out"),
        ("sensors", 3, "sensors must be a table"),
        ("effects", 3, "effects must be tables"),
        ("effects", {"crosswind": 3}, "effects.crosswind must be a table"),
        ("effects", {"crosswinds": {}}, "there is no effect 'crosswinds' .did you mean crosswind"),
        ("effects", {"crosswind": {"spede": 1}}, "key effects.crosswind.spede is not known"),
        ("latencies", {"a": 1}, "table .latencies. is not known .did you mean .latency."),
    ],
)
def test_a_value_that_no_car_has_is_refused(key: str, value: object, message: str) -> None:
    if not message:
        make(**{key: value})
        return
    with pytest.raises(UserError, match=f"^car.toml: .*{message}"):
        make(**{key: value})


def test_a_missing_key_is_named_with_its_range() -> None:
    keys = {n: x for n, x in CAR.items() if n not in ("lf", "wheel_radius_rear")}
    message = r"^car.toml: key lf, wheel_radius_rear is missing .allowed: lf: 0.1 .. 10 m; wheel_radius_rear"
    with pytest.raises(UserError, match=message):
        make_vehicle(keys, PATH)


def test_a_file_without_a_name_has_that_of_its_path() -> None:
    assert make().name == "car" and make(name="Ida").name == "Ida"
    assert file.make_default_vehicle().driven_axle == "front" and file.make_default_vehicle().values == {}


@pytest.mark.parametrize(
    ("change", "count"),
    [
        ({"mass": 1600.0}, 0),
        ({"mass": 1601.0}, 0),  # less than 0.1 %
        ({"mass": 1602.0}, 1),
        ({"mass": 1598.0}, 1),
        ({"lf": 1.01, "lr": 1.49}, 2),
    ],
)
def test_a_car_that_changed_since_its_calibration_is_noted(change: dict, count: int) -> None:
    table = calibrate(of={"mass": 1600.0, "lf": 1.0, "lr": 1.5, "yaw_inertia": 1.0, "name": "x"})
    notes = [n for n in make(calibration=table, **change).notes if "calibrate again" in n]
    assert len(notes) == count
    if change.get("mass") == 1602.0:
        assert notes[0].startswith("car.toml: mass = 1602 was 1600 when")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"mass": 70.1 * 6.25}, ""),
        ({"mass": 69.9 * 6.25}, "is little for lf + lr = 2.5 m"),
        ({"mass": 419.9 * 6.25}, ""),
        ({"mass": 420.1 * 6.25}, "is much for"),
        ({"lf": 1.29, "lr": 1.23}, ""),
        ({"lf": 1.30, "lr": 1.23}, "lf and lr exchanged"),
        ({"lf": 1.30, "lr": 1.23, "driven_axle": "both"}, ""),
    ],
)
def test_what_hardly_any_car_has_is_noted_as_wrong(values: dict, words: str) -> None:
    car = make(**values)
    assert len(car.wrong) == bool(words) and all(words in w and w in car.notes for w in car.wrong)


@pytest.mark.parametrize(
    ("covariance", "is_allowed"),
    [
        ([[1.0, 0.9], [0.9, 1.0]], True),
        ([[1e-6, 0.0], [0.0, 1e6]], True),
        ([[1.0, 1.0], [1.0, 1.0]], False),  # not positive definite
        ([[1.0, 1.1], [1.1, 1.0]], False),
        ([[1.0, 0.2], [0.3, 1.0]], False),  # not symmetric
        ([[1.0, float("nan")], [float("nan"), 1.0]], False),
        ([[-1.0, 0.0], [0.0, 1.0]], False),
        ([[1e-12, 1e-9], [3e-9, 1.0]], False),  # correlations of 0.001 and 0.003
        ([[1.0, 0.0]], False),
    ],
)
def test_a_covariance_is_symmetric_and_positive_definite(covariance: list, is_allowed: bool) -> None:
    table = {"names": ["a", "b"], "mean": [0.0, 0.0], "covariance": covariance}
    if is_allowed:
        assert make(calibration=table).calibration["covariance"] == covariance
    else:
        with pytest.raises(UserError, match=r"car.toml: \[calibration\]: "):
            make(calibration=table)
    for wrong in ({"names": ["a", "a"]}, {"mean": [0.0]}, {"mean": ["x", 1]}):
        with pytest.raises(UserError, match=r"\[calibration\]"):
            make(calibration={**table, "covariance": np.eye(2).tolist()} | wrong)


def test_a_calibration_is_written_as_it_is_read() -> None:
    covariance = np.array([[0.01, 0.002], [0.0020000004, 1 / 3]])
    lines = file.format_calibration_table(["a", "b"], np.array([0.0, 2 / 3]), covariance, True, CAR)
    assert lines[0] == "[calibration]" and lines[1] == "of = { mass = 1600, lf = 1, lr = 1.5 }"
    assert lines[2].startswith("own = true") and lines[4] == "mean = [0.0, 0.666666667]"
    assert lines[6] == "  [0.01, 0.0020000002],"  # the mean of both halves
    table = parse_toml("\n".join(lines))["calibration"]
    read = make(calibration=table).calibration
    assert read["own"] is True and read["of"]["lr"] == 1.5 and read["names"] == ["a", "b"]
    assert make(calibration=calibrate()).calibration["own"] is False
    plain = file.format_calibration_table(["a"], np.zeros(1), np.eye(1))
    assert not any(line.startswith(("own", "of")) for line in plain)


def test_the_formula_of_a_car_is_in_its_folder(tmp_path: Path) -> None:
    formula = parse("play", "a play", "front_angle", "w*2", [Number("w", 0.002, "rad")], gain=0.5)
    path = tmp_path / "play.toml"
    write_formula(path, formula)
    text = file.format_formula_table(formula, path)
    assert text == '\n[formula]  # w*2, at front_angle\nfile = "play.toml"\n'
    car = make_vehicle(CAR | {"formula": {"file": "play.toml"}}, tmp_path / "car.toml")
    assert car.formula == formula and car.formula_path == path
    assert car.values["formula_gain"] == 0.5 and car.values["formula_a"] == 0.002
    for wrong in (
        {"file": "../play.toml"},
        {"file": 3},
        {"name": "play.toml"},
        {"file": "play.toml", "x": 1},
    ):
        with pytest.raises(UserError, match=r"\[formula\] needs exactly one key, file"):
            make_vehicle(CAR | {"formula": wrong}, tmp_path / "car.toml")


def test_effects_become_their_settings_and_differ_from_their_defaults() -> None:
    car = make(effects={"body_roll": {"gain": 0.004}})
    assert car.values["body_roll_gain"] == 0.004
    effects = library().effects
    assert file.is_set(Config.exact(), effects["body_roll"]) is False
    assert file.is_set(Config.exact({"body_roll_gain": 0.004}), effects["body_roll"]) is True
    assert file.is_set(Config.exact(), effects["exact_kinematics"]) is False


def test_filled_values_are_named_with_unit_and_rule() -> None:
    car = make(yaw_inertia=2000.0, uncertainty={"mass_sd": 0.01})
    assert not any(f.startswith("yaw_inertia") for f in car.filled)
    stiffness = car.values["cornering_stiffness_front"]
    assert f"cornering_stiffness_front = {stiffness:.0f} N/rad (rule: an ordinary car of its" in car.filled[2]
    assert car.given_uncertainty == ["mass_sd"]
    assert car.values["mass_sd"] == 0.01 and car.values["cg_sd"] == file.get_unknown_car()["cg_sd"]
    assert file.get_ordinary_car(Config(CAR))["yaw_inertia"] == pytest.approx(1600.0 * 1.5)


def test_noise_of_a_mean_of_n_samples_is_smaller_by_the_root_of_n() -> None:
    car = make(sensors={"accel_y_sd": 0.4, "yaw_rate_sd": 0.001, "accel_x_bias_sd": 0.3})
    log = make_log()
    file.average_sensors(car, log)
    assert car.values["accel_y_sd"] == 0.4 and car.notes == []  # each row is a sample
    log.averaged = 4
    file.average_sensors(car, log)
    assert car.values["accel_y_sd"] == pytest.approx(0.2) and car.values["accel_x_bias_sd"] == 0.3
    low = Config().fields["yaw_rate_sd"].low
    assert car.values["yaw_rate_sd"] == pytest.approx(max(0.0005, low))
    assert "accel_y_sd: 0.4 m/s2 for one sample is 0.2 m/s2 for a mean of 4" in car.notes
    assert "accel_x_sd" not in car.values


def test_missing_noise_is_that_of_the_log_and_biases_are_at_least_those_of_the_class() -> None:
    """accel_x has an offset of 0.5 m/s2 against the kinematics.

    Noise: 0.1 m/s2 along, 0.2 m/s2 across, 0.004 rad/s, 0.003 rad/s in front, 0.006 in
    the rear."""
    rng, n = np.random.default_rng(3), 4000
    noise = {
        "accel_x": 0.1,
        "accel_y": 0.2,
        "yaw_rate": 0.004,
        "wheel_speed_front": 0.003,
        "wheel_speed_rear": 0.006,
    }
    level = {"accel_x": 0.5, "accel_y": 0.0, "wheel_speed_front": 60.0, "wheel_speed_rear": 50.0}
    channels = {c: level.get(c, 0.0) + sd * rng.standard_normal(n) for c, sd in noise.items()}
    car = make()
    file.fill_sensors(car, make_log(n, **channels))
    v, ordinary = car.values, file._compute_class_values(1600.0, 1.0, 1.5)
    for c in ("accel_x", "accel_y", "yaw_rate"):
        assert v[f"{c}_sd"] == pytest.approx(noise[c], rel=0.35), c
    assert v["wheel_noise_sd"] == pytest.approx(0.006, rel=0.1)  # the noisier axle
    assert any(f.startswith("wheel_noise_sd") and "from the log, rear axle" in f for f in car.filled)
    assert v["accel_x_bias_sd"] == pytest.approx(0.5, rel=0.35)
    assert v["accel_y_bias_sd"] == ordinary["accel_y_bias_sd"]
    assert v["yaw_rate_bias_sd"] == ordinary["yaw_rate_bias_sd"]
    assert "yaw_rate_bias_walk" not in v and v["accel_x_bias_walk"] >= Config().accel_x_bias_walk
    assert "slow residual" in next(f for f in car.filled if f.startswith("accel_x_bias_sd"))
    assert "without stated bias" in next(f for f in car.filled if f.startswith("accel_y_bias_sd"))


def test_a_log_without_a_channel_or_too_short_gives_no_noise_of_it() -> None:
    car = make(sensors={"accel_x_sd": 0.7})
    file.fill_sensors(car, make_log(40, accel_y=np.full(40, np.nan)))
    assert "accel_y_sd" not in car.values and car.values["accel_x_sd"] == 0.7
    assert "yaw_rate_sd" not in car.values and "accel_x_bias_sd" not in car.values
    (text,) = [f for f in car.filled if f.startswith("yaw_rate_sd")]
    assert text.endswith("(default: the log is too short)")


def test_noise_is_that_of_the_rows_in_which_the_car_moves() -> None:
    """It stands for most of the log, with a tenth of the noise; a value is missing."""
    rng, n = np.random.default_rng(5), 4000
    roll = np.where(np.arange(n) < 2800, 0.0, 50.0)
    across = np.where(roll > 0, 0.3, 0.03) * rng.standard_normal(n)
    across[7] = np.nan
    car = make()
    file.fill_sensors(car, make_log(n, accel_y=across, wheel_speed_front=roll, wheel_speed_rear=roll))
    assert car.values["accel_y_sd"] == pytest.approx(0.3, rel=0.2)
