"""Brake switch and wheel torques from the log to the filter: src/tables/sensors.toml, tse.impl.logs.log, config, units, logs."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.cars import make_logs
from tests.cars.logs import PEDALS
from tse.impl.config import make_config
from tse.impl.core import Filter, library
from tse.impl.errors import UserError
from tse.impl.identify.data import prepare
from tse.impl.logs.agree import check_units
from tse.impl.logs.log import read_frame, read_log
from tse.impl.logs.proposal import propose, toml_text
from tse.impl.logs.readers import read_recording
from tse.impl.logs.recording import How
from tse.impl.logs.signals import read_signals
from tse.impl.rows import MEASURES, Log, Reading, average
from tse.impl.vehicle import Vehicle, read_vehicle


@pytest.fixture(scope="module")
def made():
    return make_logs("mountain", 1.2, 1, seed=5, pedals=True)[0]


@pytest.fixture(scope="module")
def drive(made) -> pd.DataFrame:
    return pd.DataFrame(made.log)


@pytest.fixture(scope="module")
def vehicle(made, tmp_path_factory) -> Vehicle:
    folder = tmp_path_factory.mktemp("car")
    made.write(folder, "mountain")
    return read_vehicle(folder / "car.toml")


def said(log: Log, made) -> list[str]:
    v = made.vehicle
    return check_units(log, v["wheelbase"], v["wheel_radius_front"], v["wheel_radius_rear"], v["steering_ratio"], mass=v["mass"])


def test_columns_are_bits_of_a_row_where_they_have_a_number(drive: pd.DataFrame) -> None:
    assert [f.name for f in library().optional][4:] == list(PEDALS)
    log = read_frame(drive.assign(brake=drive.brake.where(drive.index > 9)))
    rows = log.rows()
    assert (rows["given"][:10] == 96).all() and (rows["given"][10:] == 112).all()
    for name in PEDALS:
        np.testing.assert_array_equal(rows[name][10:], drive[name][10:])


def test_generated_torques_are_those_of_force_and_of_both_axles(made) -> None:
    """Rolling resistance is a hundredth of the load, spin-up a tenth of the force at most."""
    r, p = made.reference, made.car.parameters
    fast = (r["vel_x"] > 5) & (np.abs(r["road_wheel"]) < 0.02)
    for axle, radius in (("front", p["radius_front"]), ("rear", p["radius_rear"])):
        force = r[f"fx_{axle}"][fast] + 0.5 * p["mass"] * 9.81 * p["rolling_resistance"]
        torque = r[f"wheel_torque_{axle}"][fast] / radius
        slope, corr = np.polyfit(force, torque, 1)[0], np.corrcoef(force, torque)[0, 1]
        assert corr > 0.95 and slope == pytest.approx(1.0, abs=0.15), axle
    assert r["brake"].mean() == pytest.approx(made.log["brake"].mean(), abs=0.02)


def test_the_filter_uses_them_and_without_them_has_the_bits_it_had(vehicle, drive: pd.DataFrame) -> None:
    plain = read_frame(drive.drop(columns=list(PEDALS)))
    config, _ = make_config(vehicle, plain)

    def out(log: Log) -> np.ndarray:
        step = Filter(config)
        rows, found = step.inputs(len(log)), step.outputs(len(log))
        given = log.rows()
        for name in rows.dtype.names:
            rows[name] = given[name]
        step.step_into(rows, found)
        return found

    base = out(plain)
    missing = read_frame(drive.assign(**dict.fromkeys(PEDALS, np.nan)))
    assert missing.optional == [] and out(missing).tobytes() == base.tobytes()
    for names in (PEDALS[:1], PEDALS[1:]):
        other = out(read_frame(drive.drop(columns=[c for c in PEDALS if c not in names])))
        assert (other["cx_front"] != base["cx_front"]).any(), names


def test_forms_that_do_not_use_them_refuse_them(vehicle, drive: pd.DataFrame) -> None:
    with pytest.raises(UserError, match="column brake, wheel_torque_front, wheel_torque_rear: only the default filter"):
        make_config(vehicle, read_frame(drive), form="paper")


def test_a_setting_without_its_channel_is_refused(vehicle, drive: pd.DataFrame) -> None:
    with pytest.raises(UserError, match="wheel_torque_least without effect: the log has none of wheel_torque_front"):
        make_config(vehicle, read_frame(drive.drop(columns=list(PEDALS[1:]))), options={"wheel_torque_least": 90.0})
    config, _ = make_config(vehicle, read_frame(drive), options={"wheel_torque_least": 90.0})
    assert config.wheel_torque_least == 90.0


def test_a_pressure_in_the_column_is_not_used_and_a_note_says_how(drive: pd.DataFrame) -> None:
    log = read_frame(drive.assign(brake=30.0 * drive.brake))
    assert "brake" not in log.optional
    assert any("column brake is not used: allowed are 0 .. 1" in n and "above =" in n for n in log.notes), log.notes


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, []),
        ({"brake": lambda d: 1.0 - d.brake}, ["brake is on in"]),
        ({"brake": lambda d: 0.0 * d.brake}, ["brake is off in"]),
        ({"wheel_torque_front": lambda d: -d.wheel_torque_front, "wheel_torque_rear": lambda d: -d.wheel_torque_rear}, ["make -"]),
        ({"wheel_torque_front": lambda d: d.wheel_torque_front / 1000, "wheel_torque_rear": lambda d: d.wheel_torque_rear / 1000},
         ["times the force of mass x accel_x"]),
    ],
)  # fmt: skip
def test_what_contradicts_the_speed_or_the_acceleration_is_said(made, drive: pd.DataFrame, change, words) -> None:
    found = said(read_frame(drive.assign(**change)), made)
    for word in words:
        assert any(word in line for line in found), found
    assert bool(found) == bool(words), found


def test_gap_compares_no_torque_switch_or_velocity(vehicle, drive: pd.DataFrame) -> None:
    log = read_frame(drive.assign(ins_vel_x=20.0))
    config, _ = make_config(vehicle, log)
    assert set(prepare(log, config).measured) == {*MEASURES}


def test_a_switch_that_is_averaged_is_a_share(drive: pd.DataFrame) -> None:
    log = average(read_frame(drive), 0.05)
    assert set(np.unique(log.extra["brake"])) <= {0.0, 0.2, 0.4, 0.6, 0.8, 1.0}
    assert log.extra["brake"].mean() == pytest.approx(drive.brake.mean(), abs=0.01)


def test_a_pressure_becomes_a_switch_by_signals_toml(vehicle, drive: pd.DataFrame, tmp_path: Path) -> None:
    """Proposed by name and by what the speed does, written, read, and 1 where the pressure is above."""
    pressure = np.where(drive.brake > 0, 5.0 + 40.0 * np.maximum(-drive.accel_x, 0.0), 0.1)
    units = {f.name: f"{f.name} [{f.unit}]" for f in library().channels}
    other = drive.rename(columns={**units, "wheel_torque_front": "FrontAxleTorque [Nm]", "brake": "unused"})
    other["Brake_Pressure [bar]"], other["ParkBrake"] = pressure, 1.0 * (drive.index % 500 > 250)
    other.drop(columns=["unused", "wheel_torque_rear"]).to_csv(tmp_path / "drive.csv", index=False)
    recording = read_recording(tmp_path / "drive.csv", How())
    proposal = propose(recording)
    brake, torque = proposal["brake"], proposal["wheel_torque_front"]
    assert brake is not None and brake.name == ("Brake_Pressure",) and brake.confidence == "sure" and 0.1 < brake.above < 5.1
    assert torque is not None and torque.name == ("FrontAxleTorque",) and torque.unsure
    assert proposal["wheel_torque_rear"] is None
    path = tmp_path / "signals.toml"
    path.write_text(toml_text(recording, proposal), encoding="utf-8")
    assert read_signals(path).signals["brake"].above == pytest.approx(brake.above)
    log = read_log(tmp_path / "drive.csv", reading=Reading(signals=path, car=vehicle))
    wrong = log.extra["brake"].to_numpy() != drive.brake.to_numpy()[: len(log)]
    assert np.mean(wrong) < 0.02, np.mean(wrong)


def test_above_is_for_the_brake_alone(tmp_path: Path) -> None:
    path = tmp_path / "signals.toml"
    path.write_text('[signals.accel_x]\nname = "a"\nabove = 2.0\n', encoding="utf-8")
    with pytest.raises(UserError, match="above: is for brake"):
        read_signals(path)
