"""tselab gap check and plan, and the optional columns.

The uncertainty that the improved vehicle file states for the car, and the estimator's
results with it.
"""

import re

import numpy as np
import pandas as pd
import pytest
from scipy.ndimage import gaussian_filter1d

from conftest import RAN, tselab_here
from gap_logs import CAR, DRIVES, STIFFNESS, make_problem, write_car, write_log
from tse.car.config import make_config
from tse.car.vehicle import get_unknown_car, read_vehicle
from tse.channels.log import read_log
from tse.estimation.estimate import estimate
from tse.gaps.catalogue import load_catalogue
from tse.gaps.drives import make_candidates, prepare_candidate
from tse.gaps.fit import fit_parameters
from tse.gaps.infer.naming import Naming
from tse.gaps.problem import STIFFNESS_PARAMETERS as PARAMETERS
from tse.gaps.problem import Problem
from tse.gaps.run import add, workflow
from tse.gaps.run import plan as planning
from tse.gaps.run.check import check_model
from tse.gaps.run.posterior import UNCERTAIN, compute_posterior
from tse.identify.data import prepare
from tse.identify.slip import estimate_longitudinal
from tse.identify.unknowns import make_prior
from tse.library.core import NOMINAL, Config, Replay
from tse.log.rows import average
from tse.report.results import IN_PART


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("plan")


@pytest.fixture(scope="module")
def vehicle(folder):
    return write_car(folder)


@pytest.fixture
def few(monkeypatch):
    """Three manoeuvres instead of all."""
    monkeypatch.setattr(
        planning,
        "make_candidates",
        lambda config: [c for c in make_candidates(config) if c.name in DRIVES.values()],
    )


# ---- plan


def test_exact_aliases_cannot_be_separated(few, vehicle):
    found = planning.make_plan("mass,yaw_inertia", vehicle)
    assert not found.separable and len(found.options) == len(DRIVES)
    assert all(
        o.shows > 8 for o in found.options if "sweep" in o.name
    )  # each shows; they are only not told apart
    assert "cannot be separated by any" in found.text(3)


def test_relaxation_and_steering_lag_are_told_apart_by_quick_steering(few, vehicle):
    found = planning.make_plan("relaxation,steering_lag", vehicle)
    assert found.separable and found.options[0].nats > 8
    nats = {o.name: o.nats for o in found.options}
    assert nats[DRIVES["sweep"]] > 10 * nats[DRIVES["brakes"]]
    assert "steering" in found.text(1).splitlines()[0]


def test_time_needed_is_that_of_8_nats(few, vehicle):
    option = planning.make_plan("imu_delay,steering_delay", vehicle).options[0]
    assert option.needed == pytest.approx(8 * option.seconds / option.nats)


def test_plan_does_not_depend_on_the_jobs(few, vehicle):
    one, three = (planning.make_plan("conicity,steering_offset", vehicle, jobs).options for jobs in (1, 3))
    assert one == three


def test_manoeuvres_ask_of_the_car_what_their_names_say(vehicle):
    config = Config.exact(read_vehicle(vehicle).values)
    candidates = make_candidates(config)
    assert len({c.name for c in candidates}) == len(candidates) > 30
    for c in candidates:
        problem = Problem(prepare_candidate(c, config), config)
        ay = problem.simulate_channels({}, ("accel_y",))["accel_y"]
        assert np.all(np.isfinite(ay)) and np.max(np.abs(ay)) < 9, c.name
        if "straight" in c.name:
            assert np.max(np.abs(ay)) < 1e-6, c.name
        elif "ramps to 6 m/s2" in c.name:
            assert 5.0 < np.max(np.abs(ay)) < 6.5, c.name


def test_axles_do_not_brace_in_bends(vehicle):
    """The nominal car keeps the manoeuvre's speed; the axles do not brake each other.

    The force is 46 N at most, in turns of 0.3 rad. With one wheel speed for both axles it
    would be 1.9 % of speed and 2.9 kN.
    """
    c = Config.exact()
    assert c.exact_kinematics_share == 1.0
    for candidate in make_candidates(c):
        for log, (_, speed) in zip(prepare_candidate(candidate, c), candidate.pieces, strict=True):
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
    found = check_model([write_log(folder / "sweep.csv", vehicle, "sweep", {}, 1)], vehicle)
    effects = {d.id: d for d in found.effects}
    assert set(effects) == set(load_catalogue())
    assert effects["relaxation"].visible and effects["imu_delay"].visible
    assert not effects["rolling_resistance"].visible and not effects["combined_slip"].visible
    assert effects["steering_compliance"].absorbed > 0.9 > effects["imu_lever_arm"].absorbed
    assert found.code == IN_PART


def test_check_prints_a_table(folder, vehicle):
    log = write_log(folder / "print.csv", vehicle, "sweep", {}, 1, seconds=12.0)
    done = tselab_here("gap", "check", log, "--vehicle", vehicle)
    assert done.code == 3 and "smallest visible" in done.out and "visible in these channels" in done.out, (
        done.err
    )


# ---- optional columns


def test_optional_columns_are_kept_checked_and_averaged(folder, vehicle):
    path = write_log(
        folder / "extra.csv", vehicle, "sweep", {}, 1, seconds=6.0, vehicle_speed=0.05, wheel_torque_front=5.0
    )
    table = pd.read_csv(path)
    table.loc[3, "vehicle_speed"] = 500.0
    table["wheel_torque_rear"] = "n/a at all"
    table.to_csv(path, index=False)
    log = read_log(path)
    assert list(log.extra) == ["vehicle_speed", "wheel_torque_front"]
    assert (
        np.isnan(log.extra["vehicle_speed"][3]) and log.extra["vehicle_speed"][4] == table["vehicle_speed"][4]
    )
    assert any("1 values outside" in n for n in log.notes) and any(
        "wheel_torque_rear is not numeric" in n for n in log.notes
    )
    assert average(log, 0.1).extra["wheel_torque_front"][5] == pytest.approx(
        table["wheel_torque_front"][50:60].mean()
    )


def test_column_in_other_units_is_not_used_and_the_log_is_not_refused(folder, vehicle):
    path = write_log(folder / "kmh.csv", vehicle, "sweep", {}, 1, seconds=6.0, vehicle_speed=0.05)
    table = pd.read_csv(path)
    table["vehicle_speed"] *= 3.6 * 2
    table.to_csv(path, index=False)
    log = read_log(path)
    assert log.extra.empty and any("divide by 3.6" in n for n in log.notes)
    assert tselab_here("estimate", path, "--vehicle", vehicle, "--out", folder / "kmh.est.csv").code in RAN


CLASS = re.sub(r"\[uncertainty\].*?\n\n", "", CAR, flags=re.DOTALL)  # nobody says how well it is known


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A car without any effect: stiffness is all that the file has wrong."""
    folder = tmp_path_factory.mktemp("posterior")
    vehicle = folder / "car.toml"
    vehicle.write_text(CLASS, encoding="utf-8")
    paths = [
        write_log(folder / f"{d}.csv", vehicle, d, {}, k, 20.0) for k, d in enumerate(("sweep", "brakes"), 5)
    ]
    problem = make_problem(vehicle, *paths)
    found = fit_parameters(problem, PARAMETERS, {})
    naming = Naming(found, found, [], 0.0, [], [], True)
    improved = folder / "improved.toml"
    improved.write_text(
        add.make_vehicle_toml(read_vehicle(vehicle), problem, workflow.Found(naming)), encoding="utf-8"
    )
    return folder, vehicle, problem, found, improved


def test_what_logs_show_is_known_better_and_what_they_do_not_as_before(case):
    _, vehicle, _, _, improved = case
    before, after = (read_vehicle(p).values for p in (vehicle, improved))
    for key in ("steer_ratio_sd", "relaxation_sd", "accel_delay_sd"):  # a sweep of the steering shows them
        assert after[key] < 0.9 * before[key], key
    for key in ("wheel_delay_sd", "lean_sd", "grade_sd"):
        assert after[key] == before[key], key
    assert after["mass_sd"] == before["mass_sd"]  # with inertia, which stiffness takes up


def test_what_no_log_shows_and_what_may_be_missing_instead_is_in_the_interval(case):
    """Mass with inertia and all stiffnesses may have a common factor.

    The variance of this factor is added to that between sets that share the probability.
    """
    _, vehicle, problem, found, _ = case
    light, heavy = read_vehicle(vehicle), read_vehicle(vehicle)
    light.values["mass_sd"], heavy.values["mass_sd"] = 0.0, 0.08
    spread = np.outer([0.01, 0.03, -0.02], [0.01, 0.03, -0.02])
    known = [
        compute_posterior(problem, found, car, {}, (), s)
        for car, s in ((light, None), (heavy, None), (light, spread))
    ]
    for i, key in enumerate(NOMINAL):
        alone, scaled, shared = (k.compute_sd(key) / found.values[key] for k in known)
        assert scaled == pytest.approx(np.hypot(alone, 0.08)), key
        assert shared == pytest.approx(np.hypot(alone, np.sqrt(spread[i, i]))), key
    assert known[1].make_uncertainty(heavy)["mass_sd"] == 0.08


def test_what_logs_do_not_show_moves_no_mean_and_widens_the_stiffness(case):
    _, vehicle, problem, found, improved = case
    alone = read_vehicle(vehicle)
    alone.values |= dict.fromkeys(UNCERTAIN, 0.0) | {"model_sd": 0.1}
    narrow, wide = (
        compute_posterior(problem, found, alone, {}),
        compute_posterior(problem, found, read_vehicle(vehicle), {}),
    )
    assert set(narrow.names) == set(STIFFNESS) < set(wide.names)
    for key, true in STIFFNESS.items():
        assert wide.compute_sd(key) > narrow.compute_sd(key)
        assert abs(found.values[key] - true) < 3 * wide.compute_sd(key)
    written = read_vehicle(improved)
    start = make_prior(written, Config.exact(written.values))
    for key in NOMINAL:
        k = start.names.index(key)
        assert start.mean[k] == 0.0 and start.sd[k] == pytest.approx(
            wide.compute_sd(key) / found.values[key], rel=1e-6
        )


def test_what_the_logs_leave_of_the_yaw_rate_is_the_model_s(case, tmp_path):
    """The uncertainty of the model is computed as in calibration.

    A fitted car whose log is explained gets no more. A car with another log gets more.
    """
    _, vehicle, problem, _, improved = case
    car = read_vehicle(vehicle)
    explained = read_vehicle(improved).values["model_sd"]
    assert explained < car.values.get("model_sd", get_unknown_car()["model_sd"])
    late = {"steering_lag_time": 0.1}
    path = write_log(tmp_path / "late.csv", vehicle, "sweep", late, 5, 20.0)
    other = problem.of([prepare(read_log(path), problem.config)])
    assert compute_posterior(other, fit_parameters(other, PARAMETERS, {}), car, {}).model_sd > 1.2 * explained
    found = fit_parameters(
        other.holding(late), PARAMETERS, {}
    )  # what a formula explains is what the estimator does not
    assert compute_posterior(other, found, car, late).model_sd > 1.2 * explained
    assert compute_posterior(other.holding(late), found, car, {}).model_sd == pytest.approx(
        explained, rel=0.3
    )


def test_tyres_that_smooth_uneven_wheels_are_no_soft_tyres(case, tmp_path):
    """The fit claims a third less, as on a RAV4's log.

    Nothing of it is written where accel_x is not explained.
    """
    _, vehicle, problem, _, _ = case
    table = pd.read_csv(write_log(tmp_path / "rough.csv", vehicle, "brakes", {}, 5, 24.0))
    rough = gaussian_filter1d(np.random.default_rng(1).standard_normal(len(table)), 8.0)
    for axle in ("front", "rear"):
        table[f"wheel_speed_{axle}"] += 0.5 * rough / rough.std()
    table.to_csv(tmp_path / "rough.csv", index=False)
    log, car = read_log(tmp_path / "rough.csv"), read_vehicle(vehicle)
    other = problem.of([prepare(log, problem.config)])
    found = fit_parameters(other, PARAMETERS, {})
    known = compute_posterior(other, found, car, {}, [log])
    assert found.values["cx_front"] < 0.7 * STIFFNESS["cx_front"]
    mean, sd = estimate_longitudinal(problem.config, found.values, [log], car)
    assert known.stiffness["cx_front"] == pytest.approx(np.exp(mean)) and sd > 0.3
    assert known.compute_sd("cx_front") == pytest.approx(np.hypot(sd, car.values["mass_sd"]) * np.exp(mean))
    assert known.stiffness["cy_front"] == found.values["cy_front"]


def test_an_exactly_known_car_stays_so(case):
    _, vehicle, problem, found, _ = case
    exact = read_vehicle(vehicle)
    exact.values |= dict.fromkeys(
        (k for k in exact.values if k in Config.exact().fields and k.endswith("_sd")), 0.0
    )
    assert set(compute_posterior(problem, found, exact, {}).make_uncertainty(exact).values()) == {0.0}


def test_the_estimator_is_better_and_valid_on_a_drive_that_nobody_fitted(case):
    folder, vehicle, _, _, improved = case
    log = read_log(write_log(folder / "unseen.csv", vehicle, "steps", {}, 9, 24.0))
    config = Config.exact(read_vehicle(vehicle).values)
    error, valid = [], []
    for path in (vehicle, improved):
        table = estimate(log, make_config(read_vehicle(path), log)[0]).table
        axles = ("cy_front", "cy_rear")
        over = [np.log(table[k] / (getattr(config, NOMINAL[k]) * STIFFNESS[k])) for k in axles]
        error.append(float(np.sqrt(np.mean(np.square(over)))))
        valid.append(float(np.mean([(table[f"{k}_valid"] == 1).mean() for k in axles])))
    assert error[1] < 0.7 * error[0] and valid[0] < 0.2 and valid[1] > 0.8, (error, valid)
