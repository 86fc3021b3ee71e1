"""The catalogue of effects in Python: read from the library, in vehicle files, in the
replay of a log.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import least_squares
from test_consider import DT, ROWS, delay_by, make_log

from conftest import RAN, simulated, tselab_here
from tse.car.vehicle import is_set, read_vehicle
from tse.gaps.catalogue import list_signed_delays
from tse.identify.knots import PROFILES
from tse.library.core import (
    REPLAY_LOG,
    STIFFNESS,
    Config,
    NativeFilter,
    Replay,
    SettingError,
    SimConfig,
    Simulator,
    library,
)
from tse.library.errors import UserError
from tse.library.files import read_toml

ROOT = Path(__file__).resolve().parents[2]
BARE = """mass = 1900.0
lf = 1.25
lr = 1.5
wheel_radius_front = 0.33
wheel_radius_rear = 0.33
"""


def read(tmp_path, text):
    path = tmp_path / "car.toml"
    path.write_text(BARE + text, encoding="utf-8")
    return read_vehicle(path)


def make_straight_rows(rows=300, speed=20.0, **more):
    wheels = np.full(rows, speed / 0.33)
    return {
        "dt": np.full(rows, 0.01),
        "steer_angle": np.zeros(rows),
        "wheel_speed_front": wheels,
        "wheel_speed_rear": wheels,
    } | more


def test_every_effect_has_strengths_that_are_settings_and_off_but_the_kinematics():
    config = Config.exact()
    catalogue = library().effects
    assert list(catalogue) == list(read_toml(ROOT / "src" / "tables" / "effects.toml"))
    for effect in catalogue.values():
        assert effect.strengths
        for p in effect.parameters:
            assert p.setting == f"{effect.id}_{p.name}" in config
            assert p.low <= p.typical[0] <= p.typical[1] <= p.high
            assert getattr(config, p.setting) == pytest.approx(p.default, rel=1e-6)
            usual = 1 if effect.id == "exact_kinematics" else 0
            assert not p.strength or (p.default == usual and 0 < p.negligible < p.typical[0])


def test_look_alikes_are_effects_or_are_known_otherwise():
    others = {"accel_x bias", "cornering_stiffness_front", "cornering_stiffness_rear"}
    for effect in library().effects.values():
        for alike in effect.look_alikes:
            assert alike in library().effects or alike in others, (effect.id, alike)
            if alike in library().effects:
                assert effect.id in library().effects[alike].look_alikes, (alike, effect.id)


def test_roads_with_a_profile_are_those_of_the_catalogue():
    assert {e.id for e in library().effects.values() if e.occurrence == "ROAD"} == set(PROFILES)
    known = {"SENSOR", "EVERY_CAR", "SOME_CARS", "ROAD", "ABSORBED", "IN_MODEL"}
    assert {e.occurrence for e in library().effects.values()} == known


def test_effects_that_are_early_below_a_size_have_a_title_for_it():
    early = {e.id: e.early_below for e in library().effects.values() if e.early}
    assert early == {"steering_delay": 0.0, "steering_lag": 0.02, "imu_delay": 0.0}
    assert list_signed_delays() == {"steering_delay_time", "imu_delay_time"}


def test_effects_of_a_vehicle_file_are_settings(tmp_path):
    car = read(
        tmp_path, "[effects.body_roll]\ngain = 0.008\nfrequency = 1.4\n[effects.relaxation]\nlength = 0.5\n"
    )
    assert car.values["body_roll_gain"] == 0.008
    assert car.values["body_roll_frequency"] == 1.4
    assert car.values["relaxation_length"] == 0.5
    assert not car.notes


def test_an_effect_is_set_by_its_strength_and_not_by_a_shape():
    def effects(**values):
        config = Config.exact(values)
        return [e.id for e in library().effects.values() if is_set(config, e)]

    assert effects(body_roll_gain=0.0123, conicity_rear=-77.0, body_roll_frequency=1.3) == [
        "conicity",
        "body_roll",
    ]
    assert effects(body_roll_frequency=1.3) == [] and effects(exact_kinematics_share=0.0) == [
        "exact_kinematics"
    ]


def test_wrong_effects_are_refused_with_file_and_key(tmp_path):
    with pytest.raises(UserError, match=r"car.toml: there is no effect 'body_rol' \(did you mean body_roll"):
        read(tmp_path, "[effects.body_rol]\ngain = 1\n")
    with pytest.raises(UserError, match=r"key effects.relaxation.length: .* is outside its range"):
        read(tmp_path, "[effects.relaxation]\nlength = 30\n")
    with pytest.raises(UserError, match="must be a table"):
        read(tmp_path, "[effects]\nrelaxation = 0.4\n")
    with pytest.raises(UserError, match="effects must be tables"):
        read(tmp_path, "effects = 3\n")
    with pytest.raises(
        UserError, match=r"key effects.relaxation.lenght is not known \(did you mean length\?\)"
    ):
        read(tmp_path, "[effects.relaxation]\nlenght = 0.3\n")
    with pytest.raises(UserError, match=r"key effects.relaxation.colour is not known \(allowed: length"):
        read(tmp_path, "[effects.relaxation]\nlength = 0.3\ncolour = 1\n")


def test_simulate_and_estimate_take_effects_from_the_vehicle_file(tmp_path):
    car = tmp_path / "car.toml"
    car.write_text(BARE + "[effects.steering_ratio]\nchange = 0.1\n")
    plain = tmp_path / "plain.toml"
    plain.write_text(BARE)
    log = tmp_path / "log.csv"
    done = tselab_here(
        "simulate", "--maneuver", "square-waves", "--duration", 20, "--vehicle", car, "--out", log
    )
    assert done.code == 0, done.err
    stiffness = {}
    for name in (car, plain):
        out = tmp_path / f"{name.stem}.csv"
        done = tselab_here("estimate", log, "--vehicle", name, "--out", out)
        assert done.code in RAN, done.err
        stiffness[name.stem] = pd.read_csv(out)["cy_front"].iloc[-1]
    # 10 % more steering looks like a stiffer front axle
    assert stiffness["plain"] > 1.05 * stiffness["car"]


def test_replay_reads_what_the_simulator_simulates():
    config = Config.exact({"body_roll_gain": 0.01, "relaxation_length": 0.5, "steering_delay_time": 0.02})
    quiet = {"noise": 0, "spread_cx_front": 0, "spread_cy_front": 0, "spread_cy_rear": 0}
    sim = Simulator(config, SimConfig(quiet))
    n = 1000
    inputs, outputs = sim.inputs(n), sim.outputs(n)
    inputs["dt"], inputs["road_level"] = 0.01, 1
    inputs["steer_angle"] = 0.03 * np.sin(np.arange(n) * 0.06)
    inputs["wheel_torque_front"] = 300 * np.sin(np.arange(n) * 0.02)
    for i in range(n):
        sim.step_into(inputs, outputs, i)
    replay = Replay(
        dt=inputs["dt"], **{c: outputs[c] for c in ("steer_angle", "wheel_speed_front", "wheel_speed_rear")}
    )
    told = {k: v.copy() for k, v in replay.run(config).items()}
    untold = replay.run(Config.exact())
    for channel in ("accel_x", "accel_y", "yaw_rate"):
        residual = np.std(told[channel] - outputs[channel])
        assert residual < 0.01 * np.std(outputs[channel])
        if channel != "accel_x":
            assert residual < 0.05 * np.std(untold[channel] - outputs[channel])


def test_replay_takes_profiles_and_gives_optional_channels():
    replay = Replay(("accel_x", "vel_x", "wheel_torque_front", "wheel_torque_rear"), **make_straight_rows())
    flat = {k: v.copy() for k, v in replay.run(Config.exact()).items()}
    replay.set("grade", np.full(300, 0.03))
    hill = {k: v.copy() for k, v in replay.run(Config.exact()).items()}
    assert hill["accel_x"][-1] - flat["accel_x"][-1] == pytest.approx(9.81 * np.sin(0.03), rel=1e-4)
    total = hill["wheel_torque_front"][-1] + hill["wheel_torque_rear"][-1]
    assert total == pytest.approx(1900 * 9.81 * np.sin(0.03) * 0.33, rel=1e-3)
    replay.set("grade", None)
    assert np.array_equal(replay.run(Config.exact())["vel_x"], flat["vel_x"])


def test_replay_starts_as_told_and_refuses_what_makes_no_sense():
    replay = Replay(("vel_y", "yaw_rate", "accel_y"), **make_straight_rows(5))
    out = replay.run(Config.exact(), vel_y=0.5, bias_yaw_rate=0.25)
    assert (out["vel_y"][0], out["yaw_rate"][0]) == (0.5, 0.25)
    with pytest.raises(ValueError, match="wheel_speed_rear is needed"):
        Replay(dt=np.ones(3), steer_angle=np.zeros(3), wheel_speed_front=np.zeros(3))
    with pytest.raises(ValueError, match="shape"):
        replay.set("bank", np.zeros(4))
    with pytest.raises(UserError, match="refused row 3"):
        Replay(**make_straight_rows(5, steer_angle=np.array([0, 0, 3.0, 0, 0]))).run(Config.exact())
    config = Config.exact()
    with pytest.raises(SettingError):
        config.relaxation_length = -1
    assert {f.name for f in library().fields(REPLAY_LOG) if f.kind == "p"} == {
        "dt", "steer_angle", "wheel_speed_front", "wheel_speed_rear"
    }  # fmt: skip


# ---- friction of each axle: 1.0 in front, 1.3 behind


UNLIKE = {"tyre_saturation_inverse_friction": (1 / 1.0 + 1 / 1.3) / 2, "tyre_saturation_balance": 0.3 / 2.3}


@pytest.fixture(scope="module")
def at_the_limit() -> np.ndarray:
    """Rows of the simulator without noise: 25 s of slalom at 0.2 Hz, growing until the
    front slides.
    """
    t = DT * np.arange(2500)
    quiet = {"noise": 0, "spread_cx_front": 0, "spread_cy_front": 0, "spread_cy_rear": 0, "speed": 25.0}
    return simulated(UNLIKE, quiet, DT, steer_angle=0.008 * t * np.sin(2 * np.pi * 0.2 * t))


def compute_brush_force(angle: np.ndarray, stiffness: float, end: float) -> np.ndarray:
    """Return the force of a brush tyre with parabolic pressure (Pacejka 2012, 3.1), at
    most `end`.
    """
    z = np.minimum(stiffness * np.abs(angle) / (3 * end), 1)
    return np.sign(angle) * end * (1 - (1 - z) ** 3)


def test_friction_of_each_axle_is_found_again_by_least_squares(at_the_limit):
    """Forces of the axles by the balances of force and moment, slip angles by kinematics,
    a brush tyre for each axle. Its four numbers come out within 0.2 %: the yaw
    acceleration is a difference over two rows.
    """
    rows, car = at_the_limit, Config.exact(UNLIKE)
    vx, vy, r, steer = (rows[name] for name in ("true_vel_x", "true_vel_y", "true_yaw_rate", "steer_angle"))
    side, turn = car.mass * rows["accel_y"], car.yaw_inertia * np.gradient(r, DT)
    base = car.lf + car.lr
    # nothing drives or brakes
    front_force = (car.lr * side + turn) / base / np.cos(steer)
    rear_force = (car.lf * side - turn) / base
    front = steer - np.arctan2(vy + car.lf * r, vx)
    rear = -np.arctan2(vy - car.lr * r, vx)
    loads = car.mass * 9.81 * np.array([car.lr, car.lf]) / base
    assert np.max(np.abs(front_force)) > 0.95 * loads[0]

    def misfit(u: np.ndarray) -> np.ndarray:
        """Given: stiffness [1e5 N/rad] and friction, in front and behind."""
        ends = u[1::2] * loads
        left_front = compute_brush_force(front, 1e5 * u[0], ends[0]) - front_force
        left_rear = compute_brush_force(rear, 1e5 * u[2], ends[1]) - rear_force
        return np.r_[left_front, left_rear] / 1000

    found = least_squares(misfit, [1.0, 1.1, 1.0, 1.1]).x
    expected = [car.cornering_stiffness_front / 1e5, 1.0, car.cornering_stiffness_rear / 1e5, 1.3]
    assert found == pytest.approx(expected, rel=0.002)
    inverse = 1 / found[1::2]
    balance = (inverse[0] - inverse[1]) / sum(inverse)
    assert balance == pytest.approx(UNLIKE["tyre_saturation_balance"], abs=0.001)


def test_replay_finds_friction_and_balance_of_a_log_with_noise(at_the_limit):
    """Fit both numbers of the model in the library, driven by the log, to noise of 0.1
    m/s2 and 0.005 rad/s: within four sds. The fit ends before the front axle slides:
    beyond, a model with less friction behind spins.
    """
    rows, random = at_the_limit[:800], np.random.default_rng(7)
    sd = {"accel_y": 0.1, "yaw_rate": 0.005}
    log = {name: rows[name] + s * random.standard_normal(len(rows)) for name, s in sd.items()}
    drive = {name: rows[name] for name in ("steer_angle", "wheel_speed_front", "wheel_speed_rear")}
    replay = Replay(tuple(sd), dt=np.full(len(rows), DT), **drive)

    def misfit(u: np.ndarray) -> np.ndarray:
        out = replay.run(Config.exact(dict(zip(UNLIKE, u, strict=True))), vel_x=25.0)
        return np.concatenate([(out[name] - log[name]) / s for name, s in sd.items()])

    fit = least_squares(misfit, [0.8, 0.0], x_scale=0.1, diff_step=1e-4)
    spread = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    assert np.all(np.abs(fit.x - list(UNLIKE.values())) < 4 * spread), (fit.x, spread)
    assert spread[1] < 0.1 * UNLIKE["tyre_saturation_balance"]
    even = least_squares(lambda u: misfit(np.array([u[0], 0.0])), [0.8], x_scale=0.1, diff_step=1e-4)
    # chi square of as many values
    assert 2 * fit.cost == pytest.approx(2 * len(rows), rel=0.15)
    assert even.cost > 2 * fit.cost  # what one friction for both axles leaves


def test_the_filter_with_the_balance_keeps_the_stiffness_of_a_car_at_the_limit(at_the_limit):
    """Its grip is that of both axles.

    Without the balance the end of an axle is taken for another stiffness. Both wheel
    speeds are one signal here, which shows no slip.
    """
    settings = {"grip": 1 / UNLIKE["tyre_saturation_inverse_friction"], "driven_axle": 1.0}
    told = estimate_rows(at_the_limit, tyre_saturation_balance=UNLIKE["tyre_saturation_balance"], **settings)
    untold = estimate_rows(at_the_limit, **settings)
    off = [max(abs(y["cy_front"] - 1), abs(y["cy_rear"] - 1)) for y in (told, untold)]
    assert off[0] < 0.02 and off[1] > 1.5 * off[0], off


# ---- lags


IMU = ("accel_x", "accel_y", "yaw_rate")


@pytest.fixture(scope="module")
def driven() -> np.ndarray:
    """Rows of the simulator: steering sweeps to 1.5 Hz, torque steps smoothed over 0.1 s,
    nothing late.
    """
    t = DT * np.arange(ROWS)
    steer, torque = (
        0.03 * np.sin(2 * np.pi * 0.9 * t + 8 * np.sin(0.25 * t)),
        1000 * np.tanh(6 * np.sin(1.3 * t)),
    )
    return simulated({}, {"seed": 3, "speed": 20.0}, DT, steer_angle=steer, wheel_torque_front=torque)


def estimate_rows(rows: np.ndarray, **settings: float) -> np.void:
    filter_ = NativeFilter(Config.exact({"driven_axle": 1.0} | settings))
    out = filter_.outputs(len(rows))
    filter_.step_into(rows, out)
    return out[-1]


# What acts, and what is found: the steering column early by 20 ms acts 20 ms late; an IMU
# that is late makes all else early.
CASES = {
    "nothing": ({}, 0.0),
    "steering acts late": ({"steer_angle": -0.02}, 0.02),
    "IMU late": (dict.fromkeys(IMU, 0.01), 0.01),
    "steering logged late": ({"steer_angle": 0.01}, -0.01),
}


@pytest.mark.parametrize("case", CASES)
def test_a_lag_is_found_and_costs_no_stiffness(driven, case):
    """3 ms: 1.3 that tyres take to relax where the car's do at once, 1 of the row in one
    substep, 0.7 for three times the sd. How late the IMU is behind the wheels is in
    the longitudinal stiffness.
    """
    by, steer = CASES[case]
    last = estimate_rows(make_log(driven, {name: delay_by(x) for name, x in by.items()}))
    assert last["lag_steer"] == pytest.approx(steer, abs=0.003)
    assert last["lag_steer_sd"] < 0.002
    for key in STIFFNESS[1:] if case == "IMU late" else STIFFNESS:
        assert last[key] == pytest.approx(1.0, abs=0.08 if key == "cx_front" else 0.03), (case, key)
        assert abs(last[key] - 1) < 2.6 * last[f"{key}_sd"]
        assert last[f"{key}_valid"] == 0


def test_where_no_lag_is_allowed_it_is_taken_for_another_stiffness(driven):
    """So that the test above shows what the lags do."""
    last = estimate_rows(make_log(driven, {"steer_angle": delay_by(-0.02)}), steer_lag_sd=0.0)
    assert abs(last["lag_steer"]) < 1e-6 and last["lag_steer_sd"] < 1e-6
    assert abs(last["cy_rear"] - 1) > 0.05


def test_what_nothing_excites_stays_unknown(driven):
    last = estimate_rows(np.repeat(make_log(driven)[:1], 1000))
    assert last["lag_steer"] == pytest.approx(0, abs=0.01) and last["lag_steer_sd"] == pytest.approx(
        0.02, rel=0.3
    )
