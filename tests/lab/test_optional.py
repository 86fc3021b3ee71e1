"""Optional channels of a log (input.toml): velocity, brake switch and wheel torques.

They are followed from columns to the filter. Settings without effect are reported.
Without the channels no bit changes.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import tse
from conftest import simulated
from tests.cars.cache import make_logs_once
from tests.cars.logs import PEDALS
from tse.car.config import make_config
from tse.car.vehicle import Vehicle, make_vehicle, read_vehicle
from tse.channels.agree import check_units
from tse.channels.log import read_frame, read_log
from tse.channels.proposal import format_signals, propose
from tse.channels.raster import _place_entries
from tse.channels.signals import read_signals
from tse.estimation.estimate import estimate
from tse.identify.data import prepare
from tse.library.core import NativeFilter, library
from tse.library.errors import UserError
from tse.log.rows import MEASURES, CheckedLog, Reading, average
from tse.readers.readers import read_recording
from tse.readers.recording import ReadOptions

ROWS, DT = 4000, 0.01
CAR: dict[str, Any] = {
    "mass": 1900.0,
    "lf": 1.25,
    "lr": 1.5,
    "wheel_radius_front": 0.33,
    "wheel_radius_rear": 0.33,
    "driven_axle": "front",
}


@pytest.fixture(scope="module")
def drive() -> pd.DataFrame:
    """The simulator's car in slaloms, with the truth beside its channels."""
    t = DT * np.arange(ROWS)
    sim = {"seed": 4, "speed": 20.0, "noise": 1.0}
    out = simulated({"sample_time": DT}, sim, DT, steer_angle=0.03 * np.sin(2 * np.pi * 0.5 * t))
    table = pd.DataFrame({"time": t, **{f.name: out[f.name] for f in library().channels}})
    return table.assign(ref_vel_x=out["true_vel_x"], ref_vel_y=out["true_vel_y"])


def make_car(**sensors: float):
    return make_vehicle({**CAR, **({"sensors": sensors} if sensors else {})}, Path("car.toml"))


def make_gnss_columns(drive: pd.DataFrame) -> pd.DataFrame:
    """Return the drive with speed and course at 10 Hz; the course has any zero."""
    heading = np.cumsum(drive.yaw_rate) * DT + 3.0
    course = heading + np.arctan2(drive.ref_vel_y, drive.ref_vel_x)
    new = np.arange(len(drive)) % 10 == 0
    wrapped = (course + np.pi) % (2 * np.pi) - np.pi
    return drive.assign(
        gnss_speed=np.hypot(drive.ref_vel_x, drive.ref_vel_y).where(new), gnss_course=wrapped.where(new)
    )


def test_the_library_names_the_velocities_behind_the_channels() -> None:
    assert [f.name for f in library().channels][-1] == "yaw_rate"
    assert [f.name for f in library().optional] == [
        "ins_vel_x",
        "ins_vel_y",
        "gnss_speed",
        "gnss_course",
        "brake",
        "wheel_torque_front",
        "wheel_torque_rear",
        "bank",
        "grade",
    ]


def test_a_log_gives_what_is_in_its_cells_and_nothing_else(drive: pd.DataFrame) -> None:
    log = read_frame(make_gnss_columns(drive))
    rows = log.rows()
    assert log.optional == ["gnss_speed", "gnss_course"]
    assert set(rows["given"][::10]) == {12}
    assert (rows["given"][np.arange(ROWS) % 10 != 0] == 0).all()
    assert (read_frame(drive).rows()["given"] == 0).all()
    assert (rows["gnss_speed"][1::10] == 0).all()


def test_a_csv_reads_as_the_frame(drive: pd.DataFrame, tmp_path: Path) -> None:
    table = make_gnss_columns(drive)
    table.to_csv(tmp_path / "log.csv", index=False)
    rows, same = read_log(tmp_path / "log.csv").rows(), read_frame(table).rows()
    assert (rows["given"] == same["given"]).all()
    assert np.allclose(rows["gnss_course"], same["gnss_course"], 0, 1e-9)


def test_columns_of_other_names_change_no_bit(drive: pd.DataFrame) -> None:
    """vel_y, speed, course may be anything; only the library's names are measurements."""
    config, _ = make_config(make_car(), read_frame(drive))
    plain = estimate(read_frame(drive), config).table
    named = estimate(read_frame(drive.assign(vel_y=9.0, speed=99.0, course=1.0)), config).table
    pd.testing.assert_frame_equal(plain, named)


def test_a_measured_speed_across_is_followed(drive: pd.DataFrame) -> None:
    """Of a car of its class, whose stiffness nobody knows."""
    table = drive.assign(ins_vel_x=drive.ref_vel_x, ins_vel_y=drive.ref_vel_y)
    off = {}
    for name, frame in (("without", drive), ("with", table), ("gnss", make_gnss_columns(drive))):
        log = read_frame(frame)
        config, _ = make_config(make_car(), log)
        found = estimate(log, config).table
        late = found.time > 20
        off[name] = np.sqrt(np.mean((found.vel_y - drive.ref_vel_y)[late] ** 2))
    assert off["with"] < 0.6 * off["without"]
    assert off["gnss"] < 1.1 * off["without"]


def test_a_row_of_a_filter_has_them_too(drive: pd.DataFrame) -> None:
    log = read_frame(make_gnss_columns(drive).head(300))
    config, _ = make_config(make_car(), log)
    found = estimate(log, config).table
    step = tse.Filter({**CAR}, sample_time=DT)
    for row in make_gnss_columns(drive).head(300).to_dict("records"):
        y = step.step(row)
    assert y.vel_y == pytest.approx(found.vel_y.iloc[-1], abs=1e-12)
    nothing = tse.Filter({**CAR}, sample_time=DT)
    for row in drive.head(300).to_dict("records"):
        z = nothing.step(row, ins_vel_x=None, gnss_course=float("nan"))
    assert z.vel_y != y.vel_y
    assert nothing._row["given"][0] == 0


def test_a_channel_left_out_is_named(drive: pd.DataFrame) -> None:
    wrong = drive.ref_vel_y.where(np.arange(ROWS) < 2000, drive.ref_vel_y + 4.0)
    step = tse.Filter({**CAR}, sample_time=DT)
    names = {
        step.step({**row, "ins_vel_y": v}).fault_channel
        for row, v in zip(drive.to_dict("records"), wrong, strict=True)
    }
    assert names == {None, "ins_vel_y"}


@pytest.mark.parametrize(
    ("along", "across", "words"),
    [
        (1.0, 1.0, ()),
        (3.6, 3.6, ("ins_vel_x is 3.6 times the speed of the wheels",)),
        (1.0, -1.0, ("ins_vel_y changes in the opposite direction to accel_y",)),
        (1 / 2.237, 1.0, ("ins_vel_x is 0.44",)),
    ],
)
def test_a_velocity_in_another_unit_or_of_another_sign_is_said(
    drive: pd.DataFrame, along: float, across: float, words: tuple[str, ...]
) -> None:
    log = read_frame(drive.assign(ins_vel_x=along * drive.ref_vel_x, ins_vel_y=across * drive.ref_vel_y))
    found = check_units(log, CAR["lf"] + CAR["lr"], 0.33, 0.33, None)
    assert len(found) == len(words) and all(w in f for w, f in zip(words, found, strict=True)), found


def test_settings_without_a_velocity_are_refused_where_this_run_asks_for_them(drive: pd.DataFrame) -> None:
    """A vehicle file that was calibrated with an INS is of logs without one, too."""
    with pytest.raises(UserError, match=r"velocity_lever_x has no effect: the log has none of ins_vel_x"):
        make_config(make_car(), read_frame(drive), options={"velocity_lever_x": 1.0})
    make_config(make_car(velocity_lever_x=1.0), read_frame(drive))
    config, _ = make_config(make_car(velocity_lever_x=1.0), read_frame(make_gnss_columns(drive)))
    assert config.velocity_lever_x == 1.0


def test_forms_that_do_not_use_a_velocity_refuse_it(drive: pd.DataFrame) -> None:
    with pytest.raises(UserError, match=r"column gnss_speed, gnss_course: only the default filter"):
        make_config(make_car(), read_frame(make_gnss_columns(drive)), form="paper")


def test_a_course_that_wraps_is_averaged_along_the_shorter_way(drive: pd.DataFrame) -> None:
    course = np.full(ROWS, np.pi - 0.01)
    course[1::2] = -np.pi + 0.01
    log = average(read_frame(drive.assign(gnss_course=course)), 0.04)
    given = log.rows()["given"] == 8
    assert given.all()
    assert (np.abs(np.abs(log.rows()["gnss_course"]) - np.pi) < 0.011).all()


def test_on_a_raster_each_entry_is_in_one_row() -> None:
    time = np.arange(100) * 0.01
    t = np.array([0.003, 0.1049, 0.2, 0.305, 5.0])
    out = _place_entries(t, np.arange(5.0), time)
    assert np.flatnonzero(np.isfinite(out)).tolist() in ([0, 10, 20, 30], [0, 10, 20, 31])
    assert np.nanmax(out) == 3


@pytest.fixture(scope="module")
def made():
    return make_logs_once("mountain", 1.2, 1, seed=5, pedals=True)[0]


@pytest.fixture(scope="module")
def driven(made) -> pd.DataFrame:
    return pd.DataFrame(made.log)


@pytest.fixture(scope="module")
def its_car(made, tmp_path_factory) -> Vehicle:
    folder = tmp_path_factory.mktemp("car")
    made.write(folder, "mountain")
    return read_vehicle(folder / "car.toml")


def list_notes(log: CheckedLog, made) -> list[str]:
    v = made.vehicle
    return check_units(
        log,
        v["wheelbase"],
        v["wheel_radius_front"],
        v["wheel_radius_rear"],
        v["steering_ratio"],
        mass=v["mass"],
    )


@pytest.mark.slow
def test_columns_are_bits_of_a_row_where_they_have_a_number(driven: pd.DataFrame) -> None:
    assert [f.name for f in library().optional][4:7] == list(PEDALS)
    log = read_frame(driven.assign(brake=driven.brake.where(driven.index > 9)))
    rows = log.rows()
    assert (rows["given"][:10] == 96).all() and (rows["given"][10:] == 112).all()
    for name in PEDALS:
        np.testing.assert_array_equal(rows[name][10:], driven[name][10:])


@pytest.mark.slow
def test_generated_torques_are_those_of_force_and_of_both_axles(made) -> None:
    """Rolling resistance: a hundredth of the load; spin-up: at most 0.1 of the force."""
    r, p = made.reference, made.car.parameters
    fast = (r["vel_x"] > 5) & (np.abs(r["road_wheel"]) < 0.02)
    for axle, radius in (("front", p["radius_front"]), ("rear", p["radius_rear"])):
        force = r[f"fx_{axle}"][fast] + 0.5 * p["mass"] * 9.81 * p["rolling_resistance"]
        torque = r[f"wheel_torque_{axle}"][fast] / radius
        slope, corr = np.polyfit(force, torque, 1)[0], np.corrcoef(force, torque)[0, 1]
        assert corr > 0.95 and slope == pytest.approx(1.0, abs=0.15), axle
    assert r["brake"].mean() == pytest.approx(made.log["brake"].mean(), abs=0.02)


@pytest.mark.slow
def test_the_filter_uses_them_and_without_them_has_the_bits_it_had(its_car, driven: pd.DataFrame) -> None:
    plain = read_frame(driven.drop(columns=list(PEDALS)))
    config, _ = make_config(its_car, plain)

    def out(log: CheckedLog) -> np.ndarray:
        step = NativeFilter(config)
        rows, found = step.inputs(len(log)), step.outputs(len(log))
        given = log.rows()
        for name in rows.dtype.names:
            rows[name] = given[name]
        step.step_into(rows, found)
        return found

    base = out(plain)
    missing = read_frame(driven.assign(**dict.fromkeys(PEDALS, np.nan)))
    assert missing.optional == [] and out(missing).tobytes() == base.tobytes()
    for names in (PEDALS[:1], PEDALS[1:]):
        other = out(read_frame(driven.drop(columns=[c for c in PEDALS if c not in names])))
        assert (other["cx_front"] != base["cx_front"]).any(), names


@pytest.mark.slow
def test_a_setting_without_its_channel_is_refused(its_car, driven: pd.DataFrame) -> None:
    with pytest.raises(
        UserError, match="wheel_torque_least has no effect: the log has none of wheel_torque_front"
    ):
        make_config(
            its_car, read_frame(driven.drop(columns=list(PEDALS[1:]))), options={"wheel_torque_least": 90.0}
        )
    config, _ = make_config(its_car, read_frame(driven), options={"wheel_torque_least": 90.0})
    assert config.wheel_torque_least == 90.0


@pytest.mark.slow
def test_a_pressure_in_the_column_is_not_used_and_a_note_says_how(driven: pd.DataFrame) -> None:
    log = read_frame(driven.assign(brake=30.0 * driven.brake))
    assert "brake" not in log.optional
    assert any(
        "column brake is not used" in n and "the allowed range 0 .. 1" in n and "above =" in n
        for n in log.notes
    ), log.notes


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, []),
        ({"brake": lambda d: 1.0 - d.brake}, ["brake is on in"]),
        ({"brake": lambda d: 0.0 * d.brake}, ["brake is off in"]),
        (
            {
                "wheel_torque_front": lambda d: -d.wheel_torque_front,
                "wheel_torque_rear": lambda d: -d.wheel_torque_rear,
            },
            ["wheel_torque_rear is -"],
        ),
        (
            {
                "wheel_torque_front": lambda d: d.wheel_torque_front / 1000,
                "wheel_torque_rear": lambda d: d.wheel_torque_rear / 1000,
            },
            ["times mass x accel_x"],
        ),
    ],
)
def test_what_contradicts_the_speed_or_the_acceleration_is_said(
    made, driven: pd.DataFrame, change, words
) -> None:
    found = list_notes(read_frame(driven.assign(**change)), made)
    for word in words:
        assert any(word in line for line in found), found
    assert bool(found) == bool(words), found


@pytest.mark.slow
def test_gap_compares_no_torque_switch_or_velocity(its_car, driven: pd.DataFrame) -> None:
    log = read_frame(driven.assign(ins_vel_x=20.0))
    config, _ = make_config(its_car, log)
    assert set(prepare(log, config).channels) == {*MEASURES}


@pytest.mark.slow
def test_a_switch_that_is_averaged_is_a_share(driven: pd.DataFrame) -> None:
    log = average(read_frame(driven), 0.05)
    assert set(np.unique(log.extra["brake"])) <= {0.0, 0.2, 0.4, 0.6, 0.8, 1.0}
    assert log.extra["brake"].mean() == pytest.approx(driven.brake.mean(), abs=0.01)


@pytest.mark.slow
def test_a_pressure_becomes_a_switch_by_signals_toml(its_car, driven: pd.DataFrame, tmp_path: Path) -> None:
    """The switch is proposed by its name and by the change of speed, written and read.

    It is 1 where the pressure is above the threshold.
    """
    pressure = np.where(driven.brake > 0, 5.0 + 40.0 * np.maximum(-driven.accel_x, 0.0), 0.1)
    units = {f.name: f"{f.name} [{f.unit}]" for f in library().channels}
    other = driven.rename(columns={**units, "wheel_torque_front": "FrontAxleTorque [Nm]", "brake": "unused"})
    other["Brake_Pressure [bar]"], other["ParkBrake"] = pressure, 1.0 * (driven.index % 500 > 250)
    other.drop(columns=["unused", "wheel_torque_rear"]).to_csv(tmp_path / "drive.csv", index=False)
    recording = read_recording(tmp_path / "drive.csv", ReadOptions())
    proposal = propose(recording)
    brake, torque = proposal["brake"], proposal["wheel_torque_front"]
    assert (
        brake is not None
        and brake.name == ("Brake_Pressure",)
        and brake.confidence == "sure"
        and 0.1 < brake.above < 5.1
    )
    assert torque is not None and torque.name == ("FrontAxleTorque",) and torque.unsure
    assert proposal["wheel_torque_rear"] is None
    path = tmp_path / "signals.toml"
    path.write_text(format_signals(recording, proposal), encoding="utf-8")
    assert read_signals(path).signals["brake"].above == pytest.approx(brake.above)
    log = read_log(tmp_path / "drive.csv", reading=Reading(signals=path, car=its_car))
    wrong = log.extra["brake"].to_numpy() != driven.brake.to_numpy()[: len(log)]
    assert np.mean(wrong) < 0.02, np.mean(wrong)


def test_above_is_for_the_brake_alone(tmp_path: Path) -> None:
    path = tmp_path / "signals.toml"
    path.write_text('[signals.accel_x]\nname = "a"\nabove = 2.0\n', encoding="utf-8")
    with pytest.raises(UserError, match="above: is allowed for brake only"):
        read_signals(path)
