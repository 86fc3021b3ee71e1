"""The catalogue of effects in Python: read from the library, in vehicle files, in the replay of a log."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from conftest import RAN, tselab_here
from tselab.core import REPLAY_LOG, Config, Replay, SettingError, SimConfig, Simulator, library
from tselab.errors import UserError
from tselab.vehicle import effects_toml, read_vehicle

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


def straight(rows=300, speed=20.0, **more):
    wheels = np.full(rows, speed / 0.33)
    return {
        "dt": np.full(rows, 0.01),
        "steer_angle": np.zeros(rows),
        "wheel_speed_front": wheels,
        "wheel_speed_rear": wheels,
    } | more


def test_every_effect_has_strengths_that_are_settings_and_off_but_the_kinematics():
    config = Config()
    catalogue = library().effects
    assert len(catalogue) == 33
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


def test_effects_of_a_vehicle_file_are_settings(tmp_path):
    car = read(tmp_path, "[effects.body_roll]\ngain = 0.008\nfrequency = 1.4\n[effects.relaxation]\nlength = 0.5\n")
    assert car.values["body_roll_gain"] == 0.008
    assert car.values["body_roll_frequency"] == 1.4
    assert car.values["relaxation_length"] == 0.5
    assert not car.notes


def test_written_effects_are_read_as_they_were(tmp_path):
    config = Config({"body_roll_gain": 0.0123, "conicity_rear": -77.0, "body_roll_frequency": 1.3})
    text = effects_toml(config)
    assert text.count("[effects.") == 2
    car = read(tmp_path, text)
    for name, value in config.changed().items():
        assert car.values[name] == value
    assert effects_toml(Config({"body_roll_frequency": 1.3})) == ""  # a shape of what is off
    assert "[effects.exact_kinematics]" in effects_toml(Config({"exact_kinematics_share": 0.0}))


def test_wrong_effects_are_refused_with_file_and_key(tmp_path):
    with pytest.raises(UserError, match=r"car.toml: there is no effect 'body_rol' \(did you mean body_roll"):
        read(tmp_path, "[effects.body_rol]\ngain = 1\n")
    with pytest.raises(UserError, match=r"key effects.relaxation.length: .* is outside its range"):
        read(tmp_path, "[effects.relaxation]\nlength = 30\n")
    with pytest.raises(UserError, match="must be a table"):
        read(tmp_path, "[effects]\nrelaxation = 0.4\n")
    with pytest.raises(UserError, match="effects must be tables"):
        read(tmp_path, "effects = 3\n")
    with pytest.raises(UserError, match=r"key effects.relaxation.lenght is not known \(did you mean length\?\)"):
        read(tmp_path, "[effects.relaxation]\nlenght = 0.3\n")
    with pytest.raises(UserError, match=r"key effects.relaxation.colour is not known \(allowed: length"):
        read(tmp_path, "[effects.relaxation]\nlength = 0.3\ncolour = 1\n")


def test_simulate_and_estimate_take_effects_from_the_vehicle_file(tmp_path):
    car = tmp_path / "car.toml"
    car.write_text(BARE + "[effects.steering_ratio]\nchange = 0.1\n")
    plain = tmp_path / "plain.toml"
    plain.write_text(BARE)
    log = tmp_path / "log.csv"
    done = tselab_here("simulate", "--maneuver", "square-waves", "--duration", 20, "--vehicle", car, "--out", log)
    assert done.code == 0, done.err
    stiffness = {}
    for name in (car, plain):
        out = tmp_path / f"{name.stem}.csv"
        done = tselab_here("estimate", log, "--vehicle", name, "--out", out, "--particles", 64)
        assert done.code in RAN, done.err
        stiffness[name.stem] = pd.read_csv(out)["cy_front"].iloc[-1]
    assert stiffness["plain"] > 1.05 * stiffness["car"]  # 10 % more steering looks like a stiffer front axle


def test_replay_reads_what_the_simulator_simulates():
    config = Config({"body_roll_gain": 0.01, "relaxation_length": 0.5, "steering_delay_time": 0.02})
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
    untold = replay.run(Config())
    for channel in ("accel_x", "accel_y", "yaw_rate"):
        residual = np.std(told[channel] - outputs[channel])
        assert residual < 0.01 * np.std(outputs[channel])
        if channel != "accel_x":
            assert residual < 0.05 * np.std(untold[channel] - outputs[channel])


def test_replay_takes_profiles_and_gives_optional_channels():
    replay = Replay(("accel_x", "vel_x", "wheel_torque_front", "wheel_torque_rear"), **straight())
    flat = {k: v.copy() for k, v in replay.run(Config()).items()}
    replay.set("grade", np.full(300, 0.03))
    hill = {k: v.copy() for k, v in replay.run(Config()).items()}
    assert hill["accel_x"][-1] - flat["accel_x"][-1] == pytest.approx(9.81 * np.sin(0.03), rel=1e-4)
    total = hill["wheel_torque_front"][-1] + hill["wheel_torque_rear"][-1]
    assert total == pytest.approx(1900 * 9.81 * np.sin(0.03) * 0.33, rel=1e-3)
    replay.set("grade", None)
    assert np.array_equal(replay.run(Config())["vel_x"], flat["vel_x"])


def test_replay_starts_as_told_and_refuses_what_makes_no_sense():
    replay = Replay(("vel_y", "yaw_rate", "accel_y"), **straight(5))
    out = replay.run(Config(), vel_y=0.5, bias_yaw_rate=0.25)
    assert (out["vel_y"][0], out["yaw_rate"][0]) == (0.5, 0.25)
    with pytest.raises(ValueError, match="wheel_speed_rear is needed"):
        Replay(dt=np.ones(3), steer_angle=np.zeros(3), wheel_speed_front=np.zeros(3))
    with pytest.raises(ValueError, match="shape"):
        replay.set("bank", np.zeros(4))
    with pytest.raises(UserError, match="refused row 3"):
        Replay(**straight(5, steer_angle=np.array([0, 0, 3.0, 0, 0]))).run(Config())
    config = Config()
    with pytest.raises(SettingError):
        config.relaxation_length = -1
    assert {f.name for f in library().fields(REPLAY_LOG) if f.kind == "p"} == {
        "dt", "steer_angle", "wheel_speed_front", "wheel_speed_rear"
    }  # fmt: skip
