"""tselab gap check, plan; the optional columns."""

import numpy as np
import pandas as pd
import pytest

from conftest import RAN, tselab_here
from gap_logs import DRIVES, car, write_log
from tse.impl.core import Config, Replay
from tse.impl.gap.catalogue import catalogue
from tse.impl.gap.drives import library, prepared
from tse.impl.gap.problem import Problem
from tse.impl.gap.run import plan as planning
from tse.impl.gap.run.check import check
from tse.impl.logs.log import read_log
from tse.impl.results import IN_PART
from tse.impl.rows import average
from tse.impl.vehicle import read_vehicle


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("plan")


@pytest.fixture(scope="module")
def vehicle(folder):
    return car(folder)


@pytest.fixture
def few(monkeypatch):
    """Three manoeuvres instead of all."""
    monkeypatch.setattr(planning, "library", lambda config: [c for c in library(config) if c.name in DRIVES.values()])


# ---- plan


def test_exact_aliases_cannot_be_separated(few, vehicle):
    found = planning.plan("mass,yaw_inertia", vehicle)
    assert not found.separable and len(found.options) == len(DRIVES)
    assert all(o.shows > 8 for o in found.options if "sweep" in o.name)  # each shows; they are only not told apart
    assert "cannot be separated by any" in found.text(3)


def test_relaxation_and_steering_lag_are_told_apart_by_quick_steering(few, vehicle):
    found = planning.plan("relaxation,steering_lag", vehicle)
    assert found.separable and found.options[0].nats > 8
    nats = {o.name: o.nats for o in found.options}
    assert nats[DRIVES["sweep"]] > 10 * nats[DRIVES["brakes"]]
    assert "steering" in found.text(1).splitlines()[0]


def test_time_needed_is_that_of_8_nats(few, vehicle):
    option = planning.plan("imu_delay,steering_delay", vehicle).options[0]
    assert option.needed == pytest.approx(8 * option.seconds / option.nats)


def test_plan_does_not_depend_on_the_jobs(few, vehicle):
    one, three = (planning.plan("conicity,steering_offset", vehicle, jobs).options for jobs in (1, 3))
    assert one == three


def test_manoeuvres_ask_of_the_car_what_their_names_say(vehicle):
    config = Config(read_vehicle(vehicle).values)
    candidates = library(config)
    assert len({c.name for c in candidates}) == len(candidates) > 30
    for c in candidates:
        problem = Problem(prepared(c, config), config)
        ay = problem.channels({}, ("accel_y",))["accel_y"]
        assert np.all(np.isfinite(ay)) and np.max(np.abs(ay)) < 9, c.name
        if "straight" in c.name:
            assert np.max(np.abs(ay)) < 1e-6, c.name
        elif "ramps to 6 m/s2" in c.name:
            assert 5.0 < np.max(np.abs(ay)) < 6.5, c.name


def test_axles_do_not_brace_in_bends(vehicle):
    """The nominal car goes at the speed of the manoeuvre, and neither axle brakes against the other one: 46 N at most, in turns of
    0.3 rad. One wheel speed for both axles would be 1.9 % of speed and 2.9 kN."""
    c = Config()
    assert c.exact_kinematics_share == 1.0
    for candidate in library(c):
        for log, (_, speed) in zip(prepared(candidate, c), candidate.pieces, strict=True):
            n, torques = len(log.time), ("wheel_torque_front", "wheel_torque_rear")
            found = Replay(("vel_x", *torques), dt=np.full(n, 0.01), **log.inputs).run(
                c, wheel_inertia_front=0.0, wheel_inertia_rear=0.0
            )
            front, rear = found[torques[0]] / c.wheel_radius_front, found[torques[1]] / c.wheel_radius_rear
            stiff = c.longitudinal_stiffness_front, c.longitudinal_stiffness_rear
            bracing = (front * stiff[1] - rear * stiff[0]) / sum(stiff)
            used = log.stretches[0].used
            assert np.max(np.abs(bracing[used])) < 100, candidate.name
            assert np.max(np.abs(found["vel_x"] / speed[:n] - 1)[used]) < 0.001, candidate.name


# ---- check


def test_check_sees_what_quick_steering_shows_and_names_what_is_missing(folder, vehicle):
    found = check([write_log(folder / "sweep.csv", vehicle, "sweep", {}, 1)], vehicle)
    effects = {d.id: d for d in found.effects}
    assert set(effects) == set(catalogue())
    assert effects["relaxation"].visible and effects["imu_delay"].visible
    assert not effects["rolling_resistance"].visible and not effects["combined_slip"].visible
    assert effects["steering_compliance"].absorbed > 0.9 > effects["imu_lever_arm"].absorbed
    assert found.code == IN_PART


def test_check_prints_a_table(folder, vehicle):
    log = write_log(folder / "print.csv", vehicle, "sweep", {}, 1, seconds=12.0)
    done = tselab_here("gap", "check", log, "--vehicle", vehicle)
    assert done.code == 3 and "smallest that shows" in done.out and "would show in" in done.out, done.err


# ---- optional columns


def test_optional_columns_are_kept_checked_and_averaged(folder, vehicle):
    path = write_log(folder / "extra.csv", vehicle, "sweep", {}, 1, seconds=6.0, vehicle_speed=0.05, wheel_torque_front=5.0)
    table = pd.read_csv(path)
    table.loc[3, "vehicle_speed"] = 500.0
    table["wheel_torque_rear"] = "n/a at all"
    table.to_csv(path, index=False)
    log = read_log(path)
    assert list(log.extra) == ["vehicle_speed", "wheel_torque_front"]
    assert np.isnan(log.extra["vehicle_speed"][3]) and log.extra["vehicle_speed"][4] == table["vehicle_speed"][4]
    assert any("1 values outside" in n for n in log.notes) and any("wheel_torque_rear is not numeric" in n for n in log.notes)
    assert average(log, 0.1).extra["wheel_torque_front"][5] == pytest.approx(table["wheel_torque_front"][50:60].mean())


def test_column_in_other_units_is_not_used_and_the_log_is_not_refused(folder, vehicle):
    path = write_log(folder / "kmh.csv", vehicle, "sweep", {}, 1, seconds=6.0, vehicle_speed=0.05)
    table = pd.read_csv(path)
    table["vehicle_speed"] *= 3.6 * 2
    table.to_csv(path, index=False)
    log = read_log(path)
    assert log.extra.empty and any("divide by 3.6" in n for n in log.notes)
    assert tselab_here("estimate", path, "--vehicle", vehicle, "--out", folder / "kmh.est.csv").code in RAN
