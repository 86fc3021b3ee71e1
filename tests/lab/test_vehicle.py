"""Vehicle files, and the rules that fill them in."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from conftest import tselab
from tse.car.config import make_config
from tse.car.vehicle import (
    REQUIRED,
    fill_sensors,
    format_calibration_table,
    get_unknown_car,
    list_latency_settings,
    list_sensor_settings,
    list_uncertainty_settings,
    list_vehicle_settings,
    make_filter_values,
    make_vehicle,
    read_vehicle,
)
from tse.identify.unknowns import UNKNOWNS
from tse.library.core import Config, library
from tse.library.errors import UserError
from tse.library.files import parse_toml, read_toml
from tse.log.noise import NOISE_FLOOR, estimate_channel_noise
from tse.log.rows import CheckedLog, list_columns

BARE = """name = "bare"
mass = 1600.0
lf = 1.0
lr = 1.5
wheel_radius_front = 0.3
wheel_radius_rear = 0.31
"""


def read(tmp_path, text):
    path = tmp_path / "car.toml"
    path.write_text(text, encoding="utf-8")
    return read_vehicle(path)


def get_class_constant(name):
    """Return a constant of src/tables/uncalibrated.toml."""
    table = read_toml(Path(__file__).resolve().parents[2] / "src" / "tables" / "uncalibrated.toml")
    return {**table["setting"], **table["class"]}[name]["value"]


def test_missing_stiffness_is_filled_in_from_the_axle_load(tmp_path):
    car = read(tmp_path, BARE)
    front, rear = 1600 * 9.81 * 1.5 / 2.5, 1600 * 9.81 * 1.0 / 2.5
    assert car.values["cornering_stiffness_front"] == pytest.approx(
        get_class_constant("cornering_front") * front
    )
    assert car.values["cornering_stiffness_rear"] == pytest.approx(
        get_class_constant("cornering_rear") * rear
    )
    for axle, load in (("front", front), ("rear", rear)):
        slip = get_class_constant("longitudinal") * load
        assert car.values[f"longitudinal_stiffness_{axle}"] == pytest.approx(slip)
    assert car.values["yaw_inertia"] == pytest.approx(1600 * 1.0 * 1.5)
    assert sum("rule" in line for line in car.filled) == 6


def test_the_filter_has_the_prior_of_the_class_where_the_file_says_nothing(tmp_path):
    bare = make_filter_values(read(tmp_path, BARE))
    for name in (
        "initial_cy_front_sd",
        "grip",
        "grip_sd",
        "relaxation_length",
        "body_roll_gain",
        "accel_y_sd",
        "model_sd",
    ):
        assert bare[name] == get_class_constant(name), name
    assert bare["driven_axle"] == 1
    told = BARE + "[sensors]\naccel_y_sd = 0.5\n[effects.body_roll]\ngain = 0.004\n"
    said = make_filter_values(read(tmp_path, 'driven_axle = "rear"\n' + told))
    assert (said["driven_axle"], said["accel_y_sd"], said["body_roll_gain"]) == (2, 0.5, 0.004)
    exact = read(tmp_path, tselab("vehicle", "--simulated").out)
    # known exactly: nothing is added
    assert Config(make_filter_values(exact)).as_dict() == Config.exact({"driven_axle": 1}).as_dict()


def test_what_the_filter_does_not_apply_is_said(tmp_path):
    windy = read(tmp_path, BARE + "[effects.crosswind]\nspeed = 10.0\n[effects.body_roll]\ngain = 0.004\n")
    (note,) = make_config(windy, None)[1]
    assert note.startswith("effects.crosswind: not used, since it is not in the filter's model")
    for late in ("steering_delay", "imu_delay"):  # the prior of a state
        assert make_config(read(tmp_path, BARE + f"[effects.{late}]\ntime = 0.02\n"), None)[1] == []
    assert make_config(read(tmp_path, BARE + "[effects.body_roll]\ngain = 0.004\n"), None)[1] == []
    slips = BARE + "[effects.combined_slip]\nfactor = 100.0\n"
    assert "effects.combined_slip" in make_config(read(tmp_path, slips), None)[1][0]
    found = '[calibration]\nnames = ["combined_slip_factor"]\nmean = [100.0]\ncovariance = [[25.0]]\n'
    assert make_config(read(tmp_path, slips + "[uncertainty]\nmodel_sd = 0.03\n" + found), None)[1] == []
    grip = BARE + "[effects.tyre_saturation]\ninverse_friction = 1.25\n"
    (note,) = make_config(read(tmp_path, grip), None)[1]
    assert note == (
        "effects.tyre_saturation.inverse_friction = 1.25: not used, since grip = 1 replaces it; "
        "set grip = 0 to use it"
    )
    assert make_config(read(tmp_path, grip), None, options={"grip": 0.0})[1] == []
    text = (Path(__file__).resolve().parents[2] / "src" / "EQUATIONS.md").read_text()
    listed = text.split("Not applied: ")[1].split("Simulator and replay")[0]
    effects = library().effects.values()
    unused = {e.id for e in effects if e.filter == "none"} - {"exact_kinematics"}  # that is always there
    assert {e.id for e in effects if f"`{e.id}`" in listed} == unused


def test_after_a_calibration_the_filter_has_its_posterior(tmp_path):
    names = '["cy_front", "cy_rear", "tyre_saturation_inverse_friction"]'
    covariance = "[[0.0004, 0, 0], [0, 1.0, 0], [0, 0, 0.0001]]"
    found = f"[calibration]\nnames = {names}\nmean = [0.0, 0.0, 1.25]\ncovariance = {covariance}\n"
    car = make_filter_values(read(tmp_path, BARE + "[uncertainty]\nmodel_sd = 0.03\n" + found))
    assert car["initial_cy_front_sd"] == pytest.approx(0.02)
    assert car["initial_cy_rear_sd"] == get_class_constant("initial_cy_rear_sd")  # no worse than the class
    assert car["grip"] == pytest.approx(0.8, rel=0.01) and 0 < car["grip_sd"] < get_class_constant("grip_sd")
    stated = "[sensors]\nvelocity_latency = 0.1\nvelocity_lever_x = -1.2\nyaw_rate_sd = 0.05\n"
    car = make_filter_values(read(tmp_path, BARE + stated + found))
    assert car["velocity_lever_x"] == -1.2 and car["velocity_latency"] == 0.1  # not part of a calibration
    assert car["accel_x_bias_sd"] == get_class_constant("accel_x_bias_sd")  # missing in the file
    # the filter finds it; the file has the residual of the search
    assert car["yaw_rate_sd"] == get_class_constant("yaw_rate_sd")


def test_a_calibration_bends_tyres_as_the_filter_does(tmp_path):
    """Search, filter of a calibrated car and filter of its class have one curve and
    prior."""
    friction = next(u for u in UNKNOWNS if u.name == "tyre_saturation_inverse_friction")
    # relative
    assert friction.mean == 1 / get_class_constant(
        "grip"
    ) and friction.sd / friction.mean == get_class_constant("grip_sd")
    found = (
        '[calibration]\nnames = ["tyre_saturation_inverse_friction"]\nmean = [1.25]\ncovariance = [[0.04]]\n'
    )
    curve = BARE + "[effects.tyre_saturation]\ninverse_friction = 1.25\n"
    car = make_filter_values(read(tmp_path, curve + "shape = 0.5\n" + found))
    assert car["tyre_saturation_shape"] == 0.5  # the shape with which the friction was found
    assert car["grip"] == pytest.approx(1 / 1.25) and car["grip_sd"] == pytest.approx(0.2 / 1.25)
    # no limit of grip shows: inside the ranges of the settings
    hardly = make_filter_values(read(tmp_path, BARE + found.replace("1.25", "0.05")))
    assert hardly["grip"] == 5.0 and 0 < hardly["grip_sd"] <= 1.0
    make_config(read(tmp_path, BARE + found.replace("1.25", "0.05")), None)
    plain = make_filter_values(
        read(tmp_path, BARE + '[calibration]\nnames = ["cy_front"]\nmean = [0.0]\ncovariance = [[0.0004]]\n')
    )
    assert [plain[k] for k in ("tyre_saturation_shape", "grip")] == [
        get_class_constant("tyre_saturation_shape"),
        get_class_constant("grip"),
    ]


@pytest.mark.parametrize(("friction", "notes"), [(0.0, 0), (1.25, 1)])
def test_a_friction_of_a_car_that_nobody_has_calibrated_is_said_not_to_be_used(tmp_path, friction, notes):
    car = read(tmp_path, f"{BARE}[effects.tyre_saturation]\ninverse_friction = {friction}\n")
    _, said = make_config(car, None)
    named = [s for s in said if "effects.tyre_saturation.inverse_friction" in s]
    assert named == [s for s in said if "not used, since grip = 1 replaces it; set grip = 0 to use it" in s]
    assert len(named) == notes


@pytest.mark.parametrize(("friction", "notes"), [(1.25, 0), (0.95, 1)])
def test_a_friction_that_is_edited_beside_a_calibration_is_no_setting(tmp_path, friction, notes):
    names = '["tyre_saturation_inverse_friction"]'
    found = f"[calibration]\nnames = {names}\nmean = [1.25]\ncovariance = [[0.0001]]\n"
    car = read(tmp_path, f"{BARE}[effects.tyre_saturation]\ninverse_friction = {friction}\n{found}")
    assert [n.split(" = ")[1][:16] for n in car.notes if "inverse_friction" in n] == [
        "0.95 is not used"
    ] * notes


def test_stated_stiffness_is_kept_and_the_authors_guess_is_not_used(tmp_path):
    car = read(tmp_path, BARE + "cornering_stiffness_front = 90000.0\nauthor_stiffness_rear = 1.0\n")
    assert car.values["cornering_stiffness_front"] == 90000
    assert not any("cornering_stiffness_front" in line for line in car.filled)
    assert any("author_stiffness" in line and "not used" in line for line in car.notes)


def test_what_is_not_known_exactly_is_as_uncertain_as_of_any_car(tmp_path):
    bare, told = (
        read(tmp_path, BARE),
        read(tmp_path, BARE + "yaw_inertia = 2500.0\n[uncertainty]\ncg_sd = 0.0\nmass_sd = 0.01\n"),
    )
    assert {k: bare.values[k] for k in get_unknown_car()} == get_unknown_car()
    assert {k: told.values[k] for k in get_unknown_car()} == get_unknown_car() | {
        "cg_sd": 0.0,
        "mass_sd": 0.01,
    }
    assert told.given_uncertainty == ["mass_sd", "cg_sd"]
    line = next(line for line in told.filled if line.startswith("[uncertainty]"))
    assert (
        f"relaxation_sd = {get_unknown_car()['relaxation_sd']:g} m" in line
        and "cg_sd" not in line
        and "mass_sd" not in line
    )
    names = list(Config.exact().fields)  # the table of the file is that of the library
    assert set(list_uncertainty_settings()) == set(names[names.index("mass_sd") : names.index("accel_x_sd")])


def test_an_uncertainty_out_of_range_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"uncertainty.mass_sd.*0 \.\. 0\.5"):
        read(tmp_path, BARE + "[uncertainty]\nmass_sd = 5.0\n")
    with pytest.raises(UserError, match="must be a table"):
        read(tmp_path, "uncertainty = 1\n" + BARE)


def test_a_table_that_nobody_knows_is_a_notice_for_it_may_be_another_programs(tmp_path):
    car = read(tmp_path, BARE + "[source]\nrepo = 'x'\n[simulink]\nsolver = 'ode4'\n[[logger]]\nport = 1\n")
    assert [n for n in car.notes if "unknown and" in n] == [
        "car.toml: [simulink], [logger] is unknown and not used"
    ]


def make_log(**channels):
    n = len(next(iter(channels.values())))
    data = pd.DataFrame({c: channels.get(c, np.zeros(n)) for c in list_columns()[1:]})
    return CheckedLog(Path("x.csv"), np.arange(n) * 0.01, data, pd.DataFrame(), np.arange(n) + 2, 0.01)


def test_noise_of_a_white_channel_on_a_moving_signal_is_found():
    rng = np.random.default_rng(4)
    t = np.arange(5000) * 0.01
    noise = estimate_channel_noise("accel_x", 2 * np.sin(t) + 0.2 * rng.standard_normal(len(t)), t >= 0)
    assert noise.sd == pytest.approx(0.2, rel=0.07) and noise.hold == 1 and noise.step == 0


def test_coarse_channel_is_not_thought_free_of_noise():
    t = np.arange(5000) * 0.01
    noise = estimate_channel_noise("yaw_rate", np.round(0.03 * np.sin(0.3 * t) / 0.01) * 0.01, t >= 0)
    assert noise.step == pytest.approx(0.01)
    assert noise.sd >= 0.01 / np.sqrt(12)


def test_held_samples_count_once():
    rng = np.random.default_rng(4)
    t = np.arange(8000) * 0.01
    held = np.repeat(rng.standard_normal(2000), 4) * 0.1
    noise = estimate_channel_noise("accel_y", held, t >= 0)
    assert noise.hold == 4
    assert noise.sd > 0.1 * np.sqrt(4) * 0.9


def test_constant_channel_gets_the_floor():
    assert estimate_channel_noise("yaw_rate", np.zeros(500), np.ones(500, bool)).sd >= NOISE_FLOOR["yaw_rate"]


def test_accelerometer_that_disagrees_with_the_wheels_is_trusted_less(tmp_path):
    rng = np.random.default_rng(2)
    n = 6000
    wheel = np.full(n, 60.0)
    slow = np.repeat(rng.standard_normal(n // 20) * 0.3, 20)
    quiet, rough = read(tmp_path, BARE), read(tmp_path, BARE)
    base = 0.1 * rng.standard_normal(n)
    fill_sensors(
        quiet,
        make_log(
            wheel_speed_front=wheel, wheel_speed_rear=wheel, accel_x=base, accel_y=base, yaw_rate=0.01 * base
        ),
    )
    fill_sensors(
        rough,
        make_log(
            wheel_speed_front=wheel,
            wheel_speed_rear=wheel,
            accel_x=base + slow,
            accel_y=base,
            yaw_rate=0.01 * base,
        ),
    )
    assert quiet.values["accel_x_sd"] == pytest.approx(0.1, rel=0.3)
    assert rough.values["accel_x_sd"] > 3 * quiet.values["accel_x_sd"]
    assert any("residual of the kinematics" in line for line in rough.filled)


def test_wheel_noise_is_that_of_the_noisier_axle_and_zero_where_there_is_none(tmp_path):
    rng, n = np.random.default_rng(6), 4000
    t = np.arange(n) * 0.01
    roll = 60 + 10 * np.sin(0.2 * t)
    noisy = {"front": 0.02, "rear": 0.07}
    wheels = {f"wheel_speed_{a}": roll + sd * rng.standard_normal(n) for a, sd in noisy.items()}
    # one sample in five rows, interpolated
    fast = {a: np.interp(t, t[::5], w[::5]) for a, w in wheels.items()}
    coarse = {f"wheel_speed_{a}": np.round(roll / 0.3) * 0.3 for a in noisy}
    for channels, low, high in (
        (wheels, 0.065, 0.075),
        (fast, 0.09, 0.11),  # interpolation is smoother; the rest counts once in five
        (coarse, 0.3 / np.sqrt(12), 0.7),
        (dict.fromkeys(wheels, roll), 0, 1e-4),
    ):
        car = read(tmp_path, BARE)
        fill_sensors(car, make_log(**channels))
        assert low <= car.values["wheel_noise_sd"] <= high
        assert any(line.startswith("wheel_noise_sd = ") and "axle: " in line for line in car.filled)


def test_stated_noise_is_left_alone(tmp_path):
    car = read(
        tmp_path,
        BARE + "[sensors]\naccel_x_sd = 0.5\naccel_y_sd = 0.5\nyaw_rate_sd = 0.02\nwheel_noise_sd = 0.1\n",
    )
    before = dict(car.values)
    fill_sensors(car, make_log(accel_x=np.zeros(500)))
    assert car.values == before


def test_the_simulated_car_is_the_default_car(tmp_path):
    car = read(tmp_path, tselab("vehicle", "--simulated").out)
    assert Config.exact(car.values).as_dict() == Config.exact().as_dict()
    assert car.filled == car.notes == []


def test_the_example_says_no_more_than_a_minimal_file(tmp_path):
    """With other mass, axles and wheels, the example gives the bands of an
    uncalibrated car."""
    example = tselab("vehicle", "--example").out
    said = {
        line.split(" = ")[0] for line in example.splitlines() if line and not line.startswith(("#", "name"))
    }
    assert said == set(REQUIRED)
    car = read(tmp_path, example)
    bare = read(tmp_path, "\n".join(f"{key} = {car.values[key]!r}" for key in REQUIRED))
    assert car.values == bare.values
    assert car.filled == bare.filled
    assert car.notes == []


def test_every_line_of_the_example_can_be_taken_in(tmp_path):
    lines = tselab("vehicle", "--example").out.splitlines()
    is_toml = re.compile(r"# (\[[a-z_.]+\]|[a-z_]+ = .*)")
    whole = "\n".join(line[2:] if is_toml.fullmatch(line) else line for line in lines)
    car = read(tmp_path, whole)
    known = {
        *list_vehicle_settings(),
        *list_uncertainty_settings(),
        *list_sensor_settings(),
        *list_latency_settings().values(),
    }
    assert known <= set(car.values)
    assert car.filled == car.notes == []


def test_an_edited_car_that_is_told_exactly_is_spoken_of(tmp_path):
    car = read(
        tmp_path,
        re.sub(r"^mass = \S+", "mass = 1400.0", tselab("vehicle", "--simulated").out, flags=re.MULTILINE),
    )
    assert [n for n in car.notes if "[uncertainty] is 0 throughout" in n]


@pytest.mark.parametrize(
    ("car", "words"),
    [
        ({"mass": 3307.0, "lf": 1.1, "lr": 1.5}, "mass = 3307 kg is much"),  # lb
        ({"mass": 1900.0, "lf": 2.75, "lr": 5.5}, "mass = 1900 kg is little"),
        ({"mass": 1900.0, "lf": 1.55, "lr": 1.2}, "lf and lr exchanged"),
        ({"mass": 1900.0, "lf": 1.55, "lr": 1.2, "driven_axle": "rear"}, ""),
        ({"mass": 3500.0, "lf": 1.9, "lr": 1.8, "driven_axle": "rear"}, ""),  # a van
        ({"mass": 650.0, "lf": 1.1, "lr": 1.25}, ""),
    ],
)
def test_what_no_log_tells_of_a_car_is_spoken_of_where_hardly_any_car_has_it(car, words):
    notes = read_notes(car)
    assert (words in " ".join(notes)) if words else not notes


def read_notes(car):
    return make_vehicle(
        {**car, "wheel_radius_front": 0.33, "wheel_radius_rear": 0.33}, Path("car.toml")
    ).notes


def test_a_car_that_is_edited_after_its_calibration_is_spoken_of():
    lines = format_calibration_table(
        ["cx", "cy"], np.zeros(2), np.eye(2), of={"mass": 1900.0, "lf": 1.2, "lr": 1.5, "yaw_inertia": 3000.0}
    )
    table = parse_toml("\n".join(lines))
    assert not read_notes({"mass": 1900.0, "lf": 1.2, "lr": 1.5, **table})
    assert "mass = 2100 was 1900 when" in " ".join(
        read_notes({"mass": 2100.0, "lf": 1.2, "lr": 1.5, **table})
    )
