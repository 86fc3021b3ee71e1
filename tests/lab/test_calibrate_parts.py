"""The parts of a calibration: findings and sentences (result.py), the vehicle file
(output.py, vehicle_file.py), the page (page.py), sensors and tests on logs (workflow.py).
Nothing is fitted: a fit is a vector with a covariance."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.lab.test_identify_data import make_checked, make_prepared
from tse.calibration import output, page, result, workflow
from tse.calibration.result import CalibrationResult, FindingGroup, NumberFinding, Proof, ProofChannel
from tse.car.vehicle import HINT_ONLY, Vehicle, make_default_vehicle, make_vehicle
from tse.identify import unknowns, vehicle_file
from tse.identify.advice import Offer
from tse.identify.fit import CarFit
from tse.identify.lasting import Lasting
from tse.identify.unknowns import OF_VELOCITY, UNKNOWNS, Unknown
from tse.library.core import NOMINAL, STIFFNESS, Config, library
from tse.library.errors import UserError
from tse.library.files import parse_toml
from tse.log.rows import DRIVES, MEASURES
from tse.roads.road import make_road

CAR = {"mass": 1500.0, "lf": 1.2, "lr": 1.5, "wheel_radius_front": 0.3, "wheel_radius_rear": 0.31}


def make_result(
    values: dict[str, float] | None = None,
    sds: dict[str, float] | None = None,
    velocity: bool = False,
    leans: tuple[float, ...] = (),
    settings: dict[str, float] | None = None,
    **more: Any,
) -> CalibrationResult:
    """Return a result in which every unknown has its prior mean and a twentieth of its
    prior sd, but for those that are given."""
    vehicle = make_vehicle(dict(CAR), Path("car.toml"))
    config = Config.exact(vehicle.values | (settings or {}))
    prior = unknowns.make_prior(make_default_vehicle(), config, velocity)
    names = (*prior.names, *(f"superelevation@{i}" for i in range(len(leans))))
    mean = np.append(prior.mean, leans)
    prior_sd = np.append(prior.sd, np.full(len(leans), 0.05))
    x, sd = mean.copy(), 0.05 * prior_sd
    for k, name in enumerate(names):
        x[k], sd[k] = (values or {}).get(name, x[k]), (sds or {}).get(name, sd[k])
    problem = SimpleNamespace(
        names=names, prior=prior, mean=mean, sd=prior_sd, config=config, leans=len(leans),
        car=len(prior.names), channels=("accel_y", "yaw_rate"),
        logs=[SimpleNamespace(seconds=50.0, name="a", wheel_noise=0.1)],
        measure_lasting=lambda level: {"accel_x": Lasting(0.04, 0.3), "yaw_rate": Lasting(1e-4, 0.002)},
    )  # fmt: skip
    fit = CarFit(x, np.zeros(0), np.diag(sd**2), x, {}, [], ([], []), None, True, 7, 0.02)
    about = {"findings": [], "groups": [], "proofs": [], "sensors": {}, "steps": {}} | more
    made = CalibrationResult(vehicle, config, problem, fit, **about)
    if not made.findings:
        made.findings = result.list_findings(problem, fit, result.list_stated(config))
    return made


def get_finding(made: CalibrationResult, name: str) -> NumberFinding:
    return next(f for f in made.findings if f.name == name)


# ---- findings


def test_a_finding_has_value_and_prior_of_its_name_and_is_shown_below_70_percent_of_the_prior_sd() -> None:
    made = make_result({"relaxation_length": 0.7, "velocity_lever_x": 1.5},
                       {"relaxation_length": 0.69 * 0.25, "yaw_inertia": 1e9}, velocity=True)  # fmt: skip
    assert [f.name for f in made.findings] == [u.name for u in (*UNKNOWNS, *OF_VELOCITY)]
    found = get_finding(made, "relaxation_length")
    assert (found.value, found.prior, found.prior_sd) == (0.7, 0.4, 0.25)
    assert found.sd == pytest.approx(0.1725) and found.shown and found.unit == "m"
    assert found.before == made.config.relaxation_length and found.group == "relaxation"
    assert not get_finding(make_result(sds={"relaxation_length": 0.71 * 0.25}), "relaxation_length").shown
    assert not get_finding(made, "yaw_inertia").shown
    assert get_finding(made, "velocity_lever_x").value == 1.5
    inertia = made.config.yaw_inertia  # what is relative matters from 3 % of the file's value on
    small = make_result({"yaw_inertia": inertia + 20, "relaxation_length": 0.04},
                        {"yaw_inertia": 1.0, "relaxation_length": 0.001})  # fmt: skip
    assert get_finding(small, "yaw_inertia").words.endswith("or too near to matter")
    assert get_finding(small, "relaxation_length").words.endswith("or too small to matter")
    shapes = {f.name for f in made.findings if f.shape}
    assert shapes == {u.name for u in UNKNOWNS if u.worth == 0.0} and "body_roll_frequency" in shapes


@pytest.mark.parametrize(("follows", "factor"), [(1.0, 1.2), (0.5, 1.1), (0.0, 1.0)])
def test_the_rear_longitudinal_stiffness_is_that_of_the_fit_times_what_follows_from_the_front(
    follows: float, factor: float
) -> None:
    made = make_result(
        {"cx_front": np.log(1.2), "longitudinal_stiffness_rear": 5e4},
        settings={"rear_longitudinal_follows_front": follows},
    )
    assert result.compute_rear_factor(made.problem, made.fit) == pytest.approx(factor)
    rear = get_finding(made, "longitudinal_stiffness_rear")
    prior = made.config.longitudinal_stiffness_rear
    assert (rear.value, rear.prior) == (pytest.approx(5e4 * factor), pytest.approx(prior * factor))
    assert rear.sd == pytest.approx(0.05 * 0.15 * prior * factor)
    assert rear.prior_sd == pytest.approx(0.15 * prior * factor)
    assert get_finding(made, "relaxation_length").value == 0.4


LATE = next(u for u in UNKNOWNS if u.name == "steer_angle_latency")
NOT_ZERO = "less than 3 sd from 0, or too small to matter"
LENGTH = Unknown("relaxation_length", "relaxation", 0.4, 0.25, 0.0, 3.0, worth=0.05)
INERTIA = Unknown("yaw_inertia", "yaw inertia", 1.0, 0.1, 0.5, 2.0, relative=True, worth=0.03)
SHAPE = Unknown("body_roll_damping", "roll", 0.3, 0.1, 0.05, 2.0)


@pytest.mark.parametrize(
    ("u", "value", "sd", "before", "by", "words"),
    [
        (LATE, 0.01, 0.002, 0.0, 1.0, "steering angle: 10.0 ms behind the gyro, 95 % interval 6.1 .. 13.9"),
        (replace(LATE, name="wheel_speed_front_latency"), 0.01, 0.001, 0.0, 1.0,
         "front wheel speed: 10.0 ms behind the gyro, 95 % interval 8.0 .. 12.0"),
        (replace(LATE, name="wheel_speed_rear_latency"), 0.01, 0.001, 0.0, 1.0,
         "rear wheel speed: 10.0 ms behind the gyro, 95 % interval 8.0 .. 12.0"),
        (LATE, -0.01, 0.002, 0.0, 1.0, "-10.0 ms behind the gyro, 95 % interval -13.9 .. -6.1"),
        (LATE, -0.01, 0.005, 0.0, 1.0, f"-10.0 ms behind the gyro, 95 % interval -19.8 .. -0.2, {NOT_ZERO}"),
        (LATE, 0.0009, 0.0001, 0.0, 1.0, f"interval 0.7 .. 1.1, {NOT_ZERO}"),  # worth: 1 ms
        (LENGTH, 0.5, 0.02, 0.0, 1.0, "relaxation length: 0.5 m, 95 % interval 0.4608 .. 0.5392"),
        (LENGTH, 0.5, 0.2, 0.0, 1.0, f"0.892, {NOT_ZERO}"),
        (LENGTH, 0.04, 0.001, 0.0, 1.0, f"0.04196, {NOT_ZERO}"),  # worth: 0.05 m
        (LENGTH, 0.5, 0.02, 0.43, 1.0, "0.5392"),
        (LENGTH, 0.5, 0.02, 0.45, 1.0,
         "0.5392, less than 3 sd from 0.45 of the vehicle file, or too near to matter"),
        (INERTIA, 2000.0, 1.0, 1950.0, 2000.0,
         "2002, less than 3 sd from 1950 of the vehicle file, or too near to matter"),  # worth: 60
        (INERTIA, 2000.0, 1.0, 1930.0, 2000.0, "yaw inertia: 2000 kg m2, 95 % interval 1998 .. 2002"),
        (SHAPE, 0.5, 0.2, 0.3, 1.0, "body roll damping: 0.5, 95 % interval 0.108 .. 0.892"),
    ],
)  # fmt: skip
def test_a_number_is_reported_in_its_unit_and_if_it_is_not_significant_or_small(
    u, value, sd, before, by, words
) -> None:
    assert result._describe_finding(u, value, sd, True, before, by).endswith(words)
    hidden = f"{words.split(':')[0]}: these logs do not show its delay behind the gyro"
    if u is LATE:
        hidden = "steering angle: these logs do not show its delay behind the gyro"
    elif u.group != "latency":
        hidden = f"{u.name.replace('_', ' ')}: these logs do not show it"
    assert result._describe_finding(u, value, sd, False, before, by) == hidden


def make_finding(name: str, value: float = 0.0, sd: float = 1.0, **more: Any) -> NumberFinding:
    about = {
        "group": "g",
        "unit": "1",
        "before": 0.0,
        "prior": 0.0,
        "prior_sd": 1.0,
        "shown": True,
        "words": "",
    }
    return NumberFinding(name=name, value=value, sd=sd, **(about | more))


def test_evidence_is_half_the_squared_distance_of_the_numbers_that_are_shown() -> None:
    """Of a and b, with their correlation: half of off' covariance^-1 off."""
    covariance = np.diag([0.04, 0.09, 1.0, 1.0, 0.25])
    covariance[0, 1] = covariance[1, 0] = 0.03
    rows = [
        make_finding("a", 0.5, 0.2, before=0.1), make_finding("b", -0.6, 0.3),
        make_finding("hidden", 99.0, 1.0, shown=False), make_finding("shape", 99.0, 1.0, shape=True),
        make_finding("c", 3.0, 0.5, group="h"),
    ]  # fmt: skip
    fit = SimpleNamespace(covariance=covariance)
    first, second = result.group_findings(None, fit, rows)
    off = np.array([0.4, -0.6])
    assert (first.name, second.name) == ("h", "g")  # most evidence first
    assert first.nats == pytest.approx(18.0)
    assert second.nats == pytest.approx(0.5 * off @ np.linalg.solve(covariance[:2, :2], off))
    assert [f.name for f in second.members] == ["a", "b", "hidden", "shape"]
    (alone,) = result.group_findings(None, fit, rows[2:4])
    assert alone.nats == 0.0


def test_the_values_of_the_vehicle_file_are_those_of_its_settings_or_0() -> None:
    config = Config.exact({"relaxation_length": 0.33, "velocity_lever_y": -0.2})
    found = result.list_stated(config)
    assert found["relaxation_length"] == 0.33 and found["velocity_lever_y"] == -0.2
    assert found["yaw_inertia"] == config.yaw_inertia
    assert set(found) == {u.name for u in (*UNKNOWNS, *OF_VELOCITY)}


def test_only_a_number_that_the_vehicle_file_states_is_misstated_and_from_four_sd_on() -> None:
    one = make_finding("gyro_scale_error", 0.041, prior_sd=0.01, prior=0.0)
    assert result.describe_misstated([one]) == (
        "the scale of yaw_rate seems wrong: from the logs, gyro_scale_error is 0.041, expected is 0, a "
        "difference of 4 prior sd"
    )
    assert result.describe_misstated([replace(one, value=0.039)]) == ""
    assert result.describe_misstated([replace(one, value=-0.05)]).endswith("a difference of 5 prior sd")
    assert result.describe_misstated([replace(one, prior_sd=0.0)]) == ""
    other = make_finding("wheel_radius_rear", 0.35, prior=0.3, prior_sd=0.01)
    assert result.describe_misstated([replace(one, value=0.0), other]).startswith(
        "wheel_radius_rear seems wrong"
    )
    assert result.describe_misstated([other, one]).startswith("wheel_radius_rear")  # the first one
    imu = replace(other, name="imu_misalignment_angle")
    assert result.describe_misstated([imu]).startswith("the direction of the IMU seems wrong")
    assert make_result({"wheel_radius_front": 0.4}).misstated.startswith("wheel_radius_front seems wrong")


# ---- the result as a whole


ACCEL = ProofChannel(2.0, 1.0, 0.5, 0.1)


def make_proof(log: str = "a.csv", held: bool = False, **channels: ProofChannel) -> Proof:
    return Proof(log, held, channels)


def test_what_is_explained_is_the_share_of_the_mean_square() -> None:
    assert ACCEL.explained == pytest.approx((0.75, 0.9375))
    assert ProofChannel(0.0, 0.0, 0.0, 0.1).explained == (1.0, 1.0)


def test_logs_are_merged_by_mean_squares_where_they_have_the_channel() -> None:
    proofs = [make_proof(accel_y=ACCEL), make_proof(yaw_rate=ACCEL),
              make_proof(accel_y=ProofChannel(4.0, 3.0, 1.5, 0.7))]  # fmt: skip
    got = result.merge_channels(proofs, "accel_y")
    expected = np.sqrt(10), np.sqrt(5), np.sqrt(1.25), 0.5
    assert (got.signal, got.before, got.after, got.noise) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("channels", "named"),
    [
        ({"accel_y": ACCEL, "yaw_rate": ProofChannel(1, 1.0, 1.04, 0)}, False),
        ({"accel_y": ACCEL, "yaw_rate": ProofChannel(1, 1.0, 1.06, 0)}, True),
        ({"accel_y": ProofChannel(1, 1.0, 1.06, 0), "yaw_rate": ACCEL}, True),
        ({"accel_x": ProofChannel(1, 1.0, 9.0, 0), "accel_y": ACCEL}, False),
        ({}, False),
    ],
)
def test_a_log_contradicts_where_lateral_motion_fits_5_percent_worse(channels, named) -> None:
    found = result.list_contradicting([Proof("x.csv", False, channels)])
    assert [f.startswith("x.csv contradicts") for f in found] == [True] * named


def test_the_gain_by_a_velocity_compares_intervals_without_and_with_it(monkeypatch) -> None:
    made = make_result(sds={"cy_front": 0.011, "cy_rear": 0.02})
    assert result.describe_velocity_gain(made) == []
    made.problem.channels = ("yaw_rate", "gnss_speed")
    without = np.zeros_like(made.fit.covariance)
    for name, sd in (("cy_front", 0.05), ("cy_rear", 0.08)):
        k = made.problem.names.index(name)
        without[k, k] = sd**2
    asked: list[object] = []
    monkeypatch.setattr(result, "compute_covariance", lambda *a: asked.append(a[2]) or without)
    assert result.describe_velocity_gain(made) == [
        "The measured velocity narrows the intervals of the stiffness: front +- 10 -> +- 2.2 %, "
        "rear +- 16 -> +- 3.9 %."
    ]
    assert asked == [("accel_x", "accel_y", "yaw_rate")]


def test_the_whole_result_counts_logs_minutes_steps_and_what_is_not_shown() -> None:
    made = make_result(sds={"relaxation_length": 9.0, "yaw_inertia": 1e9})
    first, last = result.describe_result(made)
    assert first == "From 1 log, 0.8 minutes: converged after 7 steps."
    assert last == "Not shown by these logs: yaw_inertia, relaxation_length."
    made = make_result({"wheel_radius_front": 0.4}, proofs=[make_proof(yaw_rate=ProofChannel(1, 1, 2, 0))])
    made.fit.converged = False
    made.problem.logs = [SimpleNamespace(seconds=9.6)] * 2
    lines = result.describe_result(made)
    assert lines[0] == (
        "From 2 logs, 0.3 minutes: NOT converged after 7 steps (last step 0.02 sd); --steps allows more."
    )
    assert lines[2].startswith("a.csv contradicts") and lines[3].startswith(
        "Check the vehicle file: wheel_rad"
    )
    assert lines[4] == "Not reliable: 19 s can be compared with a simulation, 20 s are needed."
    made.problem.logs = [SimpleNamespace(seconds=20.0)]
    assert not any("Not reliable" in line for line in result.describe_result(made))


def test_the_misfit_of_fitted_and_held_out_logs_is_reported_apart_with_velocity_and_advice(
    monkeypatch,
) -> None:
    proofs = [
        make_proof(accel_y=ACCEL), make_proof("b.csv", True, accel_y=ProofChannel(2.0, 1.6, 1.2, 0.03)),
        make_proof("c.csv", yaw_rate=ProofChannel(0.5, 0.3, 0.1, 0.004)),
    ]  # fmt: skip
    made = make_result(proofs=proofs, offers=[Offer("steps", {"cy_front": 0.01, "cy_rear": 0.01})])
    monkeypatch.setattr(result, "describe_velocity_gain", lambda r: ["velocity"])
    lines = result.describe_result(made)
    assert lines[1:5] == [
        "accel_y of fitted logs: rms error 1 m/s2 before, 0.5 after, sensor noise 0.1 (75 % of the signal "
        "explained before, 94 % after).",
        "yaw_rate of fitted logs: rms error 0.3 rad/s before, 0.1 after, sensor noise 0.004 (64 % of the "
        "signal explained before, 96 % after).",
        "accel_y of held-out logs: rms error 1.6 m/s2 before, 1.2 after, sensor noise 0.03 (36 % of the "
        "signal explained before, 64 % after).",
        "velocity",
    ]
    assert lines[-2:] == made.advice and len(lines) == 7


def test_the_summary_ends_with_what_contradicts_and_what_to_check() -> None:
    worse = make_proof(accel_y=ProofChannel(1, 1, 2, 0))
    made = make_result({"wheel_radius_front": 0.4}, proofs=[worse, make_proof("b.csv", accel_y=ACCEL)])
    made.findings = [replace(f, before=f.prior) for f in made.findings]
    lines = result.summarise_result(made, "stiff")
    assert lines[-2].startswith("a.csv contradicts") and lines[-1].startswith("Check the vehicle file: wheel")
    assert "of the fitted logs: rms error of the simulation 1.5 m/s2, before 1;" in lines[3]  # of both


def test_a_group_differs_if_it_is_far_from_the_vehicle_file_whatever_its_prior() -> None:
    far = make_finding("a", 0.7, 0.2, before=0.0, prior=0.7)
    near = make_finding("b", 0.7, 0.2, before=0.7, prior=0.0)
    made = make_result(groups=[FindingGroup("roll", 9.0, (near,)), FindingGroup("pitch", 5.0, (far,))])
    assert result.summarise_result(made, "stiff")[1] == "Also found: pitch."


def test_the_summary_names_groups_that_differ_and_the_held_out_logs() -> None:
    far, near = make_finding("a", 0.7, 0.2), make_finding("b", 0.5, 0.2)
    groups = [
        FindingGroup("roll", 9.0, (near, far)), FindingGroup("pitch", 5.0, (near,)),
        FindingGroup("place", 4.0, (replace(far, value=-0.7),)),
        FindingGroup("tyres", 3.0, (replace(far, shown=False),)),
    ]  # fmt: skip
    proofs = [make_proof(accel_y=ACCEL), make_proof(held=True, accel_y=ProofChannel(1, 0.3, 0.2, 0.05))]
    offers = [Offer(f"offer {k}", {"cy_front": 0.01, "cy_rear": 0.01}) for k in range(3)]
    made = make_result(
        findings=[far, replace(near, shown=False)], groups=groups, proofs=proofs, offers=offers
    )
    lines = result.summarise_result(made, "stiff")
    assert lines[:4] == [
        "stiff", "Also found: roll, place.", "Not shown by these logs: 1 of 2 numbers.",
        "accel_y of held-out logs: rms error of the simulation 0.2 m/s2, before 0.3; sensor noise 0.05.",
    ]  # fmt: skip
    assert len(lines) == 6 and lines[5].startswith("  offer 0")
    made = make_result(findings=[far], groups=groups[1:2], proofs=proofs[:1])
    made.fit.converged = False
    lines = result.summarise_result(made, "stiff")
    assert lines[1] == "Also found: nothing that differs from the vehicle file."
    assert lines[3].startswith("accel_y of the fitted logs: rms error of the simulation 0.5 m/s2, before 1;")
    assert "NOT converged" in lines[4] and len(lines) == 5


def test_advice_begins_with_the_present_intervals_of_both_axles() -> None:
    made = make_result(sds={"cy_front": 0.05, "cy_rear": 0.1})
    made.offers = [Offer("steps", {"cy_front": 0.02, "cy_rear": 0.04})]
    head, first = made.advice
    assert "now +- 10 and +- 20 %" in head and first == "  steps: +- 4 and +- 8 %"
    made.problem.logs = [SimpleNamespace(seconds=30.0), SimpleNamespace(seconds=12.5)]
    assert made.seconds == 42.5


# ---- settings of the calibrated car


def test_settings_are_stiffness_in_n_per_rad_and_the_mean_lean_of_the_roads() -> None:
    made = make_result(
        {"cy_front": np.log(1.1), "cy_rear": np.log(0.8), "cx_front": 0.1, "accel_y_latency": 0.02,
         "steer_angle_latency": -0.01, "relaxation_length": 0.6}, leans=(0.1, 0.14),
    )  # fmt: skip
    c, found = made.config, output.collect_settings(made)
    assert found["cornering_stiffness_front"] == pytest.approx(1.1 * c.cornering_stiffness_front)
    assert found["cornering_stiffness_rear"] == pytest.approx(0.8 * c.cornering_stiffness_rear)
    assert found["longitudinal_stiffness_front"] == pytest.approx(
        np.exp(0.1) * c.longitudinal_stiffness_front
    )
    assert found["bank_superelevation"] == pytest.approx(0.12) and found["relaxation_length"] == 0.6
    assert not any("latency" in k for k in found)
    assert output.collect_latencies(made) == pytest.approx(
        {"steer_angle": -0.01, "accel_y": 0.02, "accel_x": 0, "wheel_speed_front": 0, "wheel_speed_rear": 0}
    )
    assert "bank_superelevation" not in output.collect_settings(make_result())
    high = c.fields["relaxation_length"].high
    assert output.collect_settings(make_result({"relaxation_length": high + 1}))["relaxation_length"] == high


def collect_uncertainty(monkeypatch, made: CalibrationResult, model_sd: float = 0.07) -> dict[str, float]:
    monkeypatch.setattr(output, "estimate_model_sd", lambda *a: model_sd)
    return output.collect_uncertainty(made)


def test_uncertainties_are_the_posterior_sds_of_their_numbers(monkeypatch) -> None:
    sds = {"cg_shift_distance": 0.03, "steering_ratio_change": 0.011, "accel_y_latency": 0.003,
           "relaxation_length": 0.2, "aligning_moment_trail": 0.03, "yaw_inertia": 50.0,
           "imu_scale_ay_error": 0.004, "body_roll_gain": 0.0003,
           "steering_offset_angle": 0.0001}  # fmt: skip
    made = make_result({"yaw_inertia": 2500.0}, sds, leans=(0.1, 0.5))
    found = collect_uncertainty(monkeypatch, made)
    expected = {  # of the last two, the least values
        "cg_sd": 0.03, "steer_ratio_sd": 0.011, "accel_delay_sd": 0.003, "relaxation_sd": 0.2,
        "trail_sd": 0.03, "yaw_inertia_sd": 0.02, "accel_y_scale_sd": np.hypot(0.004, 9.81 * 0.0003),
        "lean_sd": 0.2, "model_sd": 0.07, "steer_offset_sd": 0.0003, "gyro_scale_sd": 0.005,
    }  # fmt: skip
    assert {k: found[k] for k in expected} == pytest.approx(expected)
    i, k = (made.problem.names.index(n) for n in ("imu_scale_ay_error", "body_roll_gain"))
    made.fit.covariance[i, k] = made.fit.covariance[k, i] = -0.9 * 0.004 * 0.0003
    both = 0.004**2 + (9.81 * 0.0003) ** 2 - 2 * 0.9 * 0.004 * 9.81 * 0.0003  # only their sum is known
    assert collect_uncertainty(monkeypatch, made)["accel_y_scale_sd"] == pytest.approx(np.sqrt(both))


def test_the_uncertainty_of_the_radii_is_that_of_their_ratio(monkeypatch) -> None:
    """Relative sds of 1 and 2 %; an error in common does not change the ratio."""
    made = make_result({"wheel_radius_front": 0.5, "wheel_radius_rear": 0.25, "yaw_inertia": 4000.0},
                       {"wheel_radius_front": 0.005, "wheel_radius_rear": 0.005,
                        "yaw_inertia": 80.0})  # fmt: skip
    found = collect_uncertainty(monkeypatch, made)
    assert found["wheel_radius_sd"] == pytest.approx(np.hypot(0.01, 0.02))
    assert found["yaw_inertia_sd"] == pytest.approx(0.02)
    i, k = (made.problem.names.index(f"wheel_radius_{a}") for a in ("front", "rear"))
    made.fit.covariance[i, k] = made.fit.covariance[k, i] = 0.8 * 0.005**2
    expected = np.sqrt(0.01**2 + 0.02**2 - 2 * 0.8 * 0.01 * 0.02)
    assert collect_uncertainty(monkeypatch, made)["wheel_radius_sd"] == pytest.approx(expected)


def test_the_error_of_the_model_is_that_on_level_roads_joined_with_that_of_the_file(monkeypatch) -> None:
    made, asked = make_result(), []
    made.fit.level, made.fit.residuals = ["level"], ["on the road that was fitted"]
    made.vehicle.values["model_sd"] = 0.11
    monkeypatch.setattr(output, "estimate_model_sd", lambda *given: asked.append(given) or 0.07)
    output.collect_uncertainty(made)
    assert asked == [(made.problem, ["level"], 0.11)]
    seen: list[object] = []
    made.problem.measure_lasting = lambda residuals: seen.append(residuals) or {}
    made.sensors = {"wheel_noise_sd": 0.1}
    workflow._collect_sensors(made.problem, made.fit, [])
    output.to_json(made)
    page._list_facts(made)
    assert seen == [["level"]] * 3


def test_an_uncertainty_that_no_log_shows_is_that_of_the_file_or_of_any_car(monkeypatch) -> None:
    made = make_result()
    made.vehicle.values |= {"mass_sd": 0.013, "roll_steer_sd": 0.02, "model_sd": 0.3}
    found = collect_uncertainty(monkeypatch, made)
    assert (found["mass_sd"], found["roll_steer_sd"], found["model_sd"]) == (0.013, 0.02, 0.07)
    assert found["lean_sd"] == 0.1  # one value for roads that are not fitted
    del made.vehicle.values["roll_steer_sd"]
    assert collect_uncertainty(monkeypatch, made)["roll_steer_sd"] == 0.03  # of any car: 0.04
    made.own = True  # a short log does not make the model better than the file says
    assert collect_uncertainty(monkeypatch, made)["model_sd"] == 0.3
    assert collect_uncertainty(monkeypatch, made, 0.4)["model_sd"] == 0.4
    assert collect_uncertainty(monkeypatch, made, 99.0)["model_sd"] == made.config.fields["model_sd"].high


def test_the_place_of_a_velocity_sensor_has_the_larger_sd_of_both_axes() -> None:
    made = make_result(
        {"velocity_lever_x": 1.5, "velocity_lever_y": -0.3, "velocity_heading": 0.01},
        {"velocity_lever_x": 0.05, "velocity_lever_y": 0.02, "velocity_heading": 0.001}, velocity=True,
    )  # fmt: skip
    found = output._collect_velocity(made)
    assert (found["velocity_lever_x"], found["velocity_lever_y"], found["velocity_lever_sd"]) == (
        1.5,
        -0.3,
        0.05,
    )
    assert (found["velocity_heading"], found["velocity_heading_sd"]) == (0.01, 0.001)
    assert output._collect_velocity(make_result()) == {}


@pytest.mark.parametrize("own", [False, True])
def test_the_next_calibration_starts_from_the_values_that_are_written(own: bool) -> None:
    """A stiffness is relative to the file, so what the file has changed is subtracted. It
    changes less than the fit where a setting has reached its limit."""
    made = make_result({"cy_front": 0.2, "cx_front": 0.1, "longitudinal_stiffness_rear": 5e4}, velocity=True)
    made.own = own
    c = made.config
    rear = 5e4 * np.exp(0.1)
    written = {s: np.exp(0.05) * getattr(c, s) for s in NOMINAL.values()} | {
        "longitudinal_stiffness_rear": rear
    }
    names, mean, covariance = output._collect_start(made, written)
    assert names == [*(u.name for u in UNKNOWNS), *STIFFNESS]  # the sensor's place is not part of it
    at = dict(zip(names, mean, strict=True))
    assert at["cy_front"] == pytest.approx(0.15) and at["cy_rear"] == pytest.approx(-0.05)
    assert at["cx_front"] == pytest.approx(0.05) and at["relaxation_length"] == 0.4
    by = 1.0 if own else np.exp(0.1)
    assert at["longitudinal_stiffness_rear"] == pytest.approx(5e4 * by)
    sd = dict(zip(names, np.sqrt(np.diag(covariance)), strict=True))
    assert sd["longitudinal_stiffness_rear"] == pytest.approx(
        0.05 * 0.15 * c.longitudinal_stiffness_rear * by
    )
    assert sd["cy_rear"] == pytest.approx(0.025)
    assert made.fit.x[made.problem.names.index("cy_front")] == 0.2  # the fit is kept as it was


def test_a_comment_in_the_file_has_the_95_percent_interval() -> None:
    f = make_finding("a", 2.0, 0.5)
    assert output._format_band(f) == ", 95 % interval 1.02 .. 2.98"
    assert output._format_band(replace(f, shown=False)) == ", not shown by these logs"
    assert output.place_formula(Path("x/my.car.toml")) == Path("x/my.car.formula.toml")


def test_the_calibrated_file_has_what_was_found_beside_what_was_stated(monkeypatch) -> None:
    made = make_result(
        {"cy_front": np.log(1.1), "accel_y_latency": 0.02, "relaxation_length": 0.7},
        {"relaxation_length": 9.0}, sensors={"accel_y_sd": 0.3, "yaw_rate_sd": 0.004},
    )  # fmt: skip
    made.vehicle.values["yaw_rate_sd"] = 0.009  # stated: it is kept
    monkeypatch.setattr(output, "estimate_model_sd", lambda *a: 0.07)
    text = output.format_calibrated(made, ["a.csv", "b.csv"], Path("f.toml"))
    lines = text.splitlines()
    assert lines[0].startswith("# car.toml, calibrated by tselab ") and lines[0].endswith(
        " from a.csv, b.csv"
    )
    assert "NOT CONVERGED" not in text
    read = parse_toml(text)
    assert read["cornering_stiffness_front"] == pytest.approx(1.1 * made.config.cornering_stiffness_front)
    assert read["latency"]["accel_y"] == 0.02
    assert (read["sensors"]["accel_y_sd"], read["sensors"]["yaw_rate_sd"]) == (0.3, 0.009)
    assert "accel_x_sd" not in read["sensors"] and read["uncertainty"]["model_sd"] == 0.07
    band = next(line for line in lines if line.startswith("length = 0.7"))
    assert band.endswith(", not shown by these logs")
    again = make_vehicle(read, Path("c.toml"))
    assert again.calibration["of"] == {"mass": 1500.0, "lf": 1.2, "lr": 1.5} and not again.calibration["own"]
    made.fit.converged, made.vehicle.path, made.own = False, None, True
    lines = output.format_calibrated(made, ["a.csv"], Path("f.toml")).splitlines()
    assert lines[0].startswith("# the built-in car, calibrated") and lines[1].startswith("# NOT CONVERGED")
    assert "own = true" in "\n".join(lines)


def test_the_calibrated_file_has_the_place_of_the_velocity_sensor_and_comments_on_wheel_latencies(
    monkeypatch,
) -> None:
    made = make_result({"velocity_lever_x": 1.5, "velocity_latency": 0.04}, velocity=True)
    monkeypatch.setattr(output, "estimate_model_sd", lambda *a: 0.07)
    monkeypatch.setattr(
        output, "describe_wheel_latencies", lambda p, f: {"wheel_speed_rear_latency": ", estimated apart"}
    )
    text = output.format_calibrated(made, ["a.csv"], Path("f.toml"))
    read = make_vehicle(parse_toml(text), Path("c.toml"))
    assert (read.values["velocity_lever_x"], read.values["velocity_latency"]) == (1.5, 0.04)
    assert read.values["velocity_lever_sd"] == pytest.approx(0.05 * 0.1, rel=0.01)
    (line,) = (x for x in text.splitlines() if x.startswith("wheel_speed_rear = "))
    assert line.endswith(", estimated apart")


def test_the_json_file_has_findings_evidence_and_both_kinds_of_stiffness(monkeypatch, tmp_path) -> None:
    made = make_result(
        {"cy_rear": np.log(0.9)}, leans=(0.1,), proofs=[make_proof(accel_y=ACCEL)],
        sensors={"accel_y_sd": 0.3}, steps={"accel_x": 0.01}, notes=["a note"],
        offers=[Offer("steps", {"cy_front": 0.01})],
        groups=[FindingGroup("roll", 9.5, ())],
    )  # fmt: skip
    monkeypatch.setattr(output, "estimate_model_sd", lambda *a: 0.07)
    path = output.write(tmp_path / "out.toml", made, ["a.csv"])
    assert path == tmp_path / "out.json" and (tmp_path / "out.toml").is_file()
    found = json.loads(path.read_text())
    assert (found["converged"], found["steps"], found["seconds"]) == (True, 7, 50.0)
    assert found["evidence"] == {"roll": 9.5} and found["superelevation"] == [0.1]
    assert set(found["stiffness"]) == {*NOMINAL.values(), "longitudinal_stiffness_rear"}
    assert found["stiffness"]["cornering_stiffness_rear"] == pytest.approx(
        0.9 * made.config.cornering_stiffness_rear
    )
    assert found["left"]["accel_x"] == {"power": 0.04, "walk": 0.3}
    assert found["proof"][0]["channels"]["accel_y"]["after"] == 0.5
    assert found["next"] == [{"what": "steps", "sd": {"cy_front": 0.01}}] and found["notes"] == ["a note"]
    assert found["quantisation"] == {"accel_x": 0.01} and found["uncertainty"]["model_sd"] == 0.07


# ---- the vehicle file


def format_file(values: dict[str, float], notes: dict | None = None, **facts: Any) -> str:
    vehicle = Vehicle(Path("car.toml"), "car", {}, facts)
    return vehicle_file.format_vehicle(
        ["# title"], vehicle, CAR | values, {"mass_sd": 0.0123456}, ["[calibration]"],
        {"mass": ", weighed", "body_roll_gain": ", 95 %"}, notes or {}, Path("f.toml"),
    )  # fmt: skip


def test_a_vehicle_file_has_each_setting_in_its_table_with_unit_and_comment() -> None:
    text = format_file(
        {"accel_y_latency": 0.012, "yaw_rate_sd": 0.003, "body_roll_gain": 0.0081, "body_roll_height": 0.25},
        name='my "car"', steering_ratio=15.5, **{HINT_ONLY[0]: 5e4},
    )  # fmt: skip
    lines = text.splitlines()
    assert lines[:4] == ["# title", "", 'name = "my \\"car\\""', "steering_ratio = 15.5"]
    assert "mass = 1500.0  # kg, weighed" in lines and HINT_ONLY[0] not in text
    read = parse_toml(text)
    assert read["uncertainty"] == {"mass_sd": 0.0123} and read["latency"] == {"accel_y": 0.012}
    assert read["sensors"] == {"yaw_rate_sd": 0.003}
    assert set(read["effects"]) == {"body_roll"}
    assert (read["effects"]["body_roll"]["gain"], read["effects"]["body_roll"]["height"]) == (0.0081, 0.25)
    assert any(line.startswith("gain = 0.0081  #") and line.endswith(", 95 %") for line in lines)
    assert "formula" not in read and "calibration" in read
    assert list(read)[-1] == "calibration"


def test_a_note_on_an_effect_stands_below_its_heading_also_where_it_is_off() -> None:
    notes = {"body_roll": ["one", "two"], "pitch_leak": ["not found"]}
    lines = format_file({"body_roll_gain": 0.008}, notes).splitlines()
    titles = {k: e.title for k, e in library().effects.items()}
    k = lines.index(f"[effects.body_roll]  # {titles['body_roll']}")
    assert lines[k + 1 : k + 3] == ["# one", "# two"] and lines[k + 3].startswith("gain = 0.008")
    k = lines.index(f"# {titles['pitch_leak']}")
    assert lines[k - 1 : k + 2] == ["", f"# {titles['pitch_leak']}", "# not found"]


def test_a_vehicle_file_names_the_file_of_its_formula() -> None:
    formula = SimpleNamespace(text="a * b", place="front_angle")
    for given, file, there in ((formula, Path("x/f.toml"), True), (formula, None, False),
                               (None, Path("f.toml"), False)):  # fmt: skip
        vehicle = replace(Vehicle(Path("car.toml"), "car", {}, {"facts": [1, 2], "a": True}), formula=given)
        text = vehicle_file.format_vehicle(["# t"], vehicle, CAR, {}, ["[calibration]"], {}, {}, file)
        read = parse_toml(text)
        assert (read.get("formula") == {"file": "f.toml"}) == there and ("formula" in read) == there
        assert "facts" not in read and read["a"] is True and "latency" not in read


@pytest.mark.parametrize(
    ("left", "count", "expected"), [(0.3, 0.0, 0.1), (0.3, 2.0, np.sqrt(0.05)), (0.05, 180.0, 0.0507)]
)
def test_the_error_of_the_model_in_the_file_counts_as_two_intervals(
    monkeypatch, left, count, expected
) -> None:
    monkeypatch.setattr(vehicle_file, "measure_unexplained", lambda *_: (left, count))
    assert vehicle_file.estimate_model_sd(None, [], 0.1) == pytest.approx(expected, rel=0.01)
    monkeypatch.setattr(vehicle_file, "measure_unexplained", lambda *_: (1e6, 9.0))
    assert vehicle_file.estimate_model_sd(None, [], 0.1) == Config().fields["model_sd"].high


def test_what_is_unexplained_is_that_of_the_gyro_in_all_logs_against_half_a_metre_per_second_squared(
    monkeypatch,
) -> None:
    asked: list[tuple] = []
    monkeypatch.setattr(vehicle_file, "measure_share", lambda *given: asked.append(given) or (0.2, 3.0))
    p = SimpleNamespace(
        groups=[(0, "accel_y"), (0, "yaw_rate"), (1, "yaw_rate")],
        make_piece=lambda g, residual: (g, residual), compute_unit_yaw_rate=lambda g: np.full(3, 0.1 * g),
    )  # fmt: skip
    assert vehicle_file.measure_unexplained(p, ["a", "b", "c"]) == (0.2, 3.0)
    ((pieces, floor),) = asked
    assert pieces == [(1, "b"), (2, "c")]
    np.testing.assert_allclose(floor, [[0.05] * 3, [0.1] * 3])
    p.groups = p.groups[:1]
    assert vehicle_file.measure_unexplained(p, ["a"]) == (0.0, 0.0)


# ---- the page


def test_the_page_draws_each_number_in_prior_sds_from_its_prior() -> None:
    shown = make_finding("a", 3.0, 0.5, prior=1.0, prior_sd=4.0, words="a is 3")
    hidden = make_finding("b", 1.0, 2.0, prior=2.0, prior_sd=2.0, shown=False)
    other = make_finding("c", 2.0, 1.0, prior=2.0, prior_sd=2.0)
    made = make_result(groups=[FindingGroup("g", 2.0, (shown, hidden)), FindingGroup("h", 1.0, (other,))])
    figure = page.draw_bands(made)
    known, unknown = figure.data
    assert (known.name, unknown.name) == ("shown by these logs", "not shown by these logs")
    assert list(known.y) == ["c", "a"] and list(unknown.y) == ["b"]
    np.testing.assert_allclose(known.x, [0.0, 0.5])
    np.testing.assert_allclose(known.error_x.array, [0.98, 0.245])
    np.testing.assert_allclose([*unknown.x, *unknown.error_x.array], [-0.5, 1.96])
    assert list(figure.layout.yaxis.categoryarray) == ["c", "b", "a"]  # from below: the most evident on top
    assert known.hovertext[1] == "a is 3"


def test_the_page_draws_the_misfit_of_each_log_before_and_after_beside_the_noise() -> None:
    proofs = [make_proof(accel_y=ACCEL), make_proof("b.csv", True, yaw_rate=ProofChannel(0.5, 0.4, 0.3, 0.2))]
    bars = page.draw_misfit(proofs).data
    assert [b.name for b in bars[:3]] == ["before", "after", "noise of the sensor"] and len(bars) == 9
    assert list(bars[0].y) == ["a.csv", "b.csv (held out)"]
    columns = {bar.xaxis: [] for bar in bars}
    for bar in bars:
        columns[bar.xaxis].append(list(bar.x))
    x, y, yaw = columns.values()
    assert np.isnan(x).all()
    np.testing.assert_array_equal(y, [[1.0, np.nan], [0.5, np.nan], [0.1, np.nan]])
    np.testing.assert_array_equal(yaw, [[np.nan, 0.4], [np.nan, 0.3], [np.nan, 0.2]])
    assert [b.showlegend for b in bars] == [True] * 3 + [False] * 6


def test_the_facts_of_a_run_have_units_and_the_channels_that_are_quantised() -> None:
    made = make_result(steps={"accel_x": 0.01, "yaw_rate": 0.0}, sensors={"wheel_noise_sd": 0.0512})
    facts = dict(page._list_facts(made))
    assert facts["Logs"] == "a (50 s)" and facts["Search"] == "7 steps, converged"
    assert facts["Not explained on level roads, accel_x"] == (
        "an error of 0.2 m/s that lasts 1 s, and a random walk with sd 0.3 m/s/sqrt(s)"
    )
    assert facts["Not explained on level roads, yaw_rate"].startswith("an error of 0.01 rad/s that lasts 1 s")
    assert facts["Quantised in steps of"] == "accel_x 0.01 (rad, rad/s, m/s2)"
    assert facts["Noise of wheel speeds"] == "0.0512 rad/s"
    made.steps, made.fit.converged = {"accel_x": 0.0}, False
    facts = dict(page._list_facts(made))
    assert (
        facts["Quantised in steps of"] == "no visible steps" and facts["Search"] == "7 steps, not converged"
    )


# ---- sensors, logs, tests on logs


def make_noisy(seed: int, sd: float, stands: float = 0.0, speed: float = 40.0) -> Any:
    """Return 30 s of white noise on accel_y, 20 times as much while the car stands."""
    rng, time = np.random.default_rng(seed), 0.01 * np.arange(3000)
    still = time < stands
    noise = sd * np.where(still, 20.0, 1.0) * rng.standard_normal(3000)
    return make_checked(time, accel_y=noise, wheel_speed_rear=np.where(still, 0.0, speed), accel_x=np.nan)


@pytest.mark.parametrize("order", [(0.3, 0.1, 0.2), (0.1, 0.2, 0.3), (0.1, 0.3, 0.2)])
def test_of_several_logs_the_noisiest_has_the_noise_of_the_sensor_wherever_it_stands(order) -> None:
    """8 %: scatter of 3000 rows."""
    logs = [make_noisy(k, sd) for k, sd in enumerate(order)]
    found = workflow.measure_row_noise(logs, Config.exact(CAR))
    assert found["accel_y_sd"] == pytest.approx(0.3, rel=0.08)
    assert set(found) == {"accel_y_sd", "yaw_rate_sd"}  # none has accel_x


def test_noise_is_that_of_rows_in_which_the_car_moves_and_within_the_range_of_the_setting() -> None:
    config = Config.exact(CAR)
    for speed in (40.0, -40.0):
        found = workflow.measure_row_noise([make_noisy(1, 0.2, 20.0, speed)], config)
        assert found["accel_y_sd"] == pytest.approx(0.2, rel=0.15)
    assert (
        workflow.measure_row_noise([make_noisy(1, 1e3)], config)["accel_y_sd"]
        == config.fields["accel_y_sd"].high
    )
    assert workflow.measure_row_noise([make_checked(0.01 * np.arange(20))], config) == {}


def test_a_channel_is_quantised_if_it_has_enough_values_that_are_multiples_of_a_step() -> None:
    rng = np.random.default_rng(3)
    few = 0.5 * np.arange(10.0)  # 9 differences
    assert workflow.find_quantisation(few) == 0.0
    assert workflow.find_quantisation(np.append(few, [5.0, np.nan, 5.0])) == pytest.approx(0.5)
    holes = 0.02 * np.unique(rng.integers(0, 400, 120))
    assert workflow.find_quantisation(rng.permutation(holes)) == pytest.approx(0.02)
    assert workflow.find_quantisation(rng.uniform(0, 1, 300)) == 0.0


def collect_sensors(made: CalibrationResult, lasting: dict[str, Lasting]) -> dict[str, float]:
    made.problem.measure_lasting = lambda level: lasting
    return workflow._collect_sensors(made.problem, made.fit, [])


def test_walks_of_the_biases_are_those_of_the_residuals_and_that_of_a_gyro_is_small() -> None:
    made = make_result()
    made.problem.logs = [SimpleNamespace(wheel_noise=x) for x in (0.02, 0.05, 0.03)]
    found = collect_sensors(made, {"accel_x": Lasting(1, 0.02), "accel_y": Lasting(1, 0.03),
                                   "yaw_rate": Lasting(1, 0.02)})  # fmt: skip
    assert (found["accel_x_bias_walk"], found["accel_y_bias_walk"]) == (0.02, 0.03)
    assert found["yaw_rate_bias_walk"] == 0.001 and found["wheel_noise_sd"] == 0.05
    assert collect_sensors(made, {"yaw_rate": Lasting(1, 5e-4)})["yaw_rate_bias_walk"] == 5e-4


@pytest.mark.parametrize(("correlation", "sd"), [(0.0, 0.005), (0.9, 0.003), (-0.5, np.sqrt(37e-6))])
def test_the_sd_of_the_steering_delay_is_that_of_lag_minus_latency_and_at_least_3_ms(correlation, sd) -> None:
    """With sds of 4 and 3 ms. Logs show the difference better than each."""
    made = make_result(sds={"steering_lag_time": 0.004, "steer_angle_latency": 0.003})
    i, k = (made.problem.names.index(n) for n in ("steering_lag_time", "steer_angle_latency"))
    made.fit.covariance[i, k] = made.fit.covariance[k, i] = correlation * 12e-6
    assert collect_sensors(made, {})["steer_lag_sd"] == pytest.approx(sd)


def test_logs_are_prepared_and_what_cannot_be_compared_is_left_out_with_its_reason() -> None:
    time = 0.01 * np.arange(500)
    slow = make_checked(0.2 * np.arange(50))
    slow.path = Path("slow.csv")
    notes, said = ["before"], []
    ready = workflow._prepare_logs(
        [slow, make_checked(time, accel_x=np.nan)], Config.exact(CAR), notes, said.append
    )
    assert ready[0] is None and list(ready[1].measured) == list(MEASURES)
    assert said == ["smoothing slow.csv", "smoothing drive.csv"]
    assert notes[1].startswith("left out: slow.csv: rows are too far apart") and "has no accel_x" in notes[2]
    with pytest.raises(UserError, match="left out: slow"):
        workflow._make_problem([slow], make_vehicle(dict(CAR), Path("car.toml")), 1, [], print)


def turn_logs(count: int = 1, seconds: float = 8.0) -> list[Any]:
    """Return logs of noise."""
    rng, n = np.random.default_rng(5), round(seconds / 0.01)
    time = 0.01 * np.arange(n)
    return [
        make_checked(time, accel_x=0.1 * rng.standard_normal(n), accel_y=0.1 * rng.standard_normal(n),
                     yaw_rate=0.01 * rng.standard_normal(n), steer_angle=1e-3 * rng.standard_normal(n))
        for _ in range(count)
    ]  # fmt: skip


def test_a_problem_has_the_usable_logs_and_leaves_the_vehicle_as_it_was() -> None:
    vehicle = make_vehicle(dict(CAR), Path("car.toml"))
    before = dict(vehicle.values)
    fast, still, other = turn_logs(3)
    still.data["wheel_speed_front"] = still.data["wheel_speed_rear"] = 0.0
    other.extra = other.extra.assign(gnss_speed=10.5 + 0.1 * np.sin(other.time))
    notes: list[str] = []
    p = workflow._make_problem([fast, still, other], vehicle, 1, notes, lambda _: None)
    assert len(p.logs) == 2 and vehicle.values == before
    assert "velocity_heading" in p.prior.names and any("has no stretch" in n for n in notes)
    assert p.road.road == [0, 1]
    assert p.config.tyre_saturation_shape == workflow.get_ordinary_car(p.config)["tyre_saturation_shape"]
    vehicle.values["tyre_saturation_shape"] = 0.5
    q = workflow._make_problem([fast], vehicle, 1, [], lambda _: None)
    assert q.config.tyre_saturation_shape == 0.5 and "velocity_heading" not in q.prior.names
    fast.data[list(MEASURES)] = np.nan
    with pytest.raises(UserError, match="no log has enough samples of any of accel_x, accel_y, yaw_rate"):
        workflow._make_problem([fast], vehicle, 1, [], lambda _: None)


def test_a_calibration_needs_the_seconds_that_are_asked_for(monkeypatch) -> None:
    logs = [SimpleNamespace(seconds=30.4), SimpleNamespace(seconds=20.0)]
    monkeypatch.setattr(workflow, "_make_problem", lambda *a: SimpleNamespace(logs=logs))
    monkeypatch.setattr(workflow, "fit", lambda problem, say: "fitted")
    monkeypatch.setattr(workflow, "apply_slip_regression", lambda p, f, logs, v: (f, logs))
    monkeypatch.setattr(workflow, "_make_result", lambda v, p, f, logs, proofs, notes: (f, proofs, notes))
    vehicle = make_default_vehicle()
    with pytest.raises(
        UserError, match="50 s of the logs can be compared with a simulation, 51 s are needed"
    ):
        workflow.calibrate_logs([1], vehicle, min_seconds=51.0)
    assert workflow.calibrate_logs([1], vehicle, min_seconds=50.4, notes=("n",)) == (
        ("fitted", [1]),
        [],
        ["n"],
    )


def test_a_calibration_is_tested_on_fitted_logs_and_on_held_out_ones_that_can_be_used(monkeypatch) -> None:
    """Both kinds are read in the same way and lie on the same road."""
    seen: dict[str, Any] = {"read": []}
    vehicle = make_default_vehicle()
    problem = SimpleNamespace(config="config")
    monkeypatch.setattr(
        workflow, "read_agreeing", lambda logs, notes, r: seen["read"].append((logs, r)) or logs
    )
    monkeypatch.setattr(workflow, "place_on_known", lambda road, logs, car: [f"{x} on {road}" for x in logs])
    monkeypatch.setattr(workflow, "_make_problem", lambda *given: seen.update(problem=given) or problem)
    monkeypatch.setattr(workflow, "fit", lambda p, say, max_steps: f"fit of {max_steps} steps")
    monkeypatch.setattr(workflow, "apply_slip_regression", lambda p, f, logs, car: (f, tuple(logs)))
    monkeypatch.setattr(workflow, "_prove_fitted", lambda p, f: ["fitted"])
    monkeypatch.setattr(workflow, "_prepare_logs", lambda logs, config, notes, say: [None, *logs, config])
    monkeypatch.setattr(workflow, "_prove_held_out", lambda p, f, logs: [("held out", f, *logs)])
    monkeypatch.setattr(workflow, "_make_result", lambda car, p, f, logs, proofs, notes: (f, logs, proofs))
    said: list[str] = []
    found, read, proofs = workflow.run(["a", "b"], vehicle, ["c"], 3, said.append, 9, road="road")
    assert read == ["a on road", "b on road"] and found == ("fit of 9 steps", tuple(read))
    assert proofs == ["fitted", ("held out", found, "c on road", "config")]
    assert [logs for logs, _ in seen["read"]] == [["a", "b"], ["c"]]
    assert all(r.car is vehicle for _, r in seen["read"]) and said == ["testing the result"]
    assert seen["problem"][:3] == (read, vehicle, 3)
    assert workflow.run(["a"], vehicle, [], 1, said.append)[2] == ["fitted"]


def test_a_known_road_lies_under_every_log_and_none_changes_nothing() -> None:
    s = np.arange(0.0, 201.0, 5.0)
    road = make_road(s, x=s, y=0 * s).with_profile(s, grade=s / 1e4)
    time = 0.01 * np.arange(1000)
    log = make_checked(time)
    log.extra = log.extra.assign(gnss_latitude=0 * time)  # no position: it is east and north that count
    log.ref = log.data[[]].assign(ref_east=12.0 * time, ref_north=0 * time)
    vehicle = make_vehicle(dict(CAR), Path("car.toml"))
    assert workflow.place_on_known(None, (log,), vehicle) == [log]
    found = workflow.place_on_known(road, [log, log], vehicle)
    assert len(found) == 2
    np.testing.assert_allclose(found[1].extra["grade"].to_numpy()[50:-50], 12e-4 * time[50:-50], atol=1e-5)


class Proved:
    """A problem of two logs with residuals that are given."""

    def __init__(self, offset: float):
        log = make_prepared(400, noise={"accel_y": 0.2, "yaw_rate": 0.02})
        log.measured["accel_y"] = np.where(np.arange(400) % 2, 0.0, np.nan)  # two values a block of four
        self.logs = [replace(log, path=Path("x/a.csv")), replace(log, path=Path("x/b.csv"))]
        self.groups = [(0, "accel_y"), (0, "yaw_rate"), (1, "yaw_rate")]
        self.knots, self.offset, self.asked = 3, offset, []

    def compute_sensed_residuals(self, x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        self.asked.append((x, z))
        return [self.offset + k * np.array([1.0, -1.0, 1.0, -1.0]) for k in (1, 2, 3)]

    def get_measured(self, g: int) -> np.ndarray:
        return 5.0 + (g + 1) * np.array([10.0, -10.0])

    def to_search(self, x: np.ndarray) -> np.ndarray:
        return -x


def test_the_misfit_of_a_log_is_the_sd_of_its_residuals_in_the_unit_of_each_channel(monkeypatch) -> None:
    p, filed = Proved(7.0), Proved(3.0)
    assert workflow._measure_residuals(p, np.ones(2)) == {
        (0, "accel_y"): 1.0, (0, "yaw_rate"): 2.0, (1, "yaw_rate"): 3.0
    }  # fmt: skip
    np.testing.assert_array_equal(p.asked[0][1], np.zeros(3))
    filed.compute_sensed_residuals = lambda x, z: [10 * e for e in p.compute_sensed_residuals(x, z)]
    monkeypatch.setattr(workflow, "_make_filed", lambda problem: (filed, np.zeros(2)))
    fit = SimpleNamespace(x=np.ones(2), z=np.full(3, 0.5))
    first, second = workflow._prove_fitted(p, fit)
    assert (first.log, second.log, first.held_out) == ("a.csv", "b.csv", False)
    assert first.channels == {
        "accel_y": ProofChannel(10.0, 10.0, 1.0, pytest.approx(0.2 / np.sqrt(2))),
        "yaw_rate": ProofChannel(20.0, 20.0, 2.0, 0.01),
    }
    assert set(second.channels) == {"yaw_rate"} and second.channels["yaw_rate"].after == 3.0
    np.testing.assert_array_equal(p.asked[-1][0], -np.ones(2))
    np.testing.assert_array_equal(p.asked[-1][1], fit.z)


def test_the_car_of_the_vehicle_file_has_its_lean_and_no_road_that_was_fitted() -> None:
    logs = [workflow.prepare(log, Config.exact(CAR)) for log in turn_logs(2)]
    for lean in (0.0, 0.2):
        config = Config.exact(CAR | {"bank_superelevation": lean})
        p = workflow.CarProblem(logs, config, unknowns.make_prior(make_default_vehicle(), config))
        filed, x = workflow._make_filed(p)
        assert filed.car == 0 and filed.knots == 0 and filed.config is config
        assert filed.names[:2] == ("superelevation@0", "superelevation@1")
        np.testing.assert_array_equal(x[:2], lean)
        np.testing.assert_array_equal(x[2:], 0.0)


def test_to_a_held_out_log_only_lean_and_biases_are_fitted(monkeypatch) -> None:
    """Before: the car of the file. After: the calibrated car, with what was fitted."""
    (log,) = (workflow.prepare(log, Config.exact(CAR)) for log in turn_logs(1))
    config = Config.exact(CAR)
    p = workflow.CarProblem(
        [log, log], config, unknowns.make_prior(make_default_vehicle(), config).select(STIFFNESS)
    )
    fitted: list[Any] = []

    def fit(problem: Any) -> Any:
        fitted.append(problem)
        return SimpleNamespace(search=problem.mean + 0.5)

    monkeypatch.setattr(workflow, "fit", fit)
    monkeypatch.setattr(workflow, "_measure_residuals", lambda problem, x: {
        g: float(problem.config.cornering_stiffness_rear / config.cornering_stiffness_rear + 10 * x[1])
        for g in problem.groups})  # fmt: skip
    x = p.mean.copy()
    x[p.names.index("cy_rear")] = 1 / 1.5
    proofs = workflow._prove_held_out(p, SimpleNamespace(x=p.to_ln(x)), [log])
    (other,) = fitted
    assert other.car == 0 and other.knots == 0 and len(other.logs) == 1
    assert [(q.log, q.held_out) for q in proofs] == [("drive.csv", True)]
    assert proofs[0].channels["yaw_rate"].before == pytest.approx(1.0)
    assert proofs[0].channels["yaw_rate"].after == pytest.approx(1.5 + 5.0)


def test_a_result_has_the_coarsest_step_of_each_channel_and_notes_on_the_formula(monkeypatch) -> None:
    made = make_result()
    monkeypatch.setattr(workflow.advice, "list_offers", lambda *a: ["offer"])
    monkeypatch.setattr(workflow, "_collect_sensors", lambda *a: {"accel_y_sd": 0.1})
    time = 0.01 * np.arange(500)
    rng = np.random.default_rng(7)

    def quantise(step: float) -> np.ndarray:
        return step * np.round(rng.standard_normal(500) / step)

    logs = [
        make_checked(time, accel_y=quantise(0.05), steer_angle=quantise(0.1)),
        make_checked(time, accel_y=quantise(0.2), steer_angle=rng.standard_normal(500)),
    ]
    made.vehicle.formula = SimpleNamespace(id="lopsided")
    found = workflow._make_result(made.vehicle, made.problem, made.fit, logs, [], ["first"])
    assert set(found.steps) == {*DRIVES, *MEASURES}
    assert (found.steps["accel_y"], found.steps["steer_angle"]) == pytest.approx((0.2, 0.1))
    assert found.steps["accel_x"] == 0.0
    assert found.notes[0] == "first" and found.notes[1].startswith("the formula lopsided of the vehicle file")
    assert found.offers == ["offer"] and found.sensors == {"accel_y_sd": 0.1}
    assert [f.name for f in found.findings] == [u.name for u in UNKNOWNS]
    assert [g.nats for g in found.groups] == sorted((g.nats for g in found.groups), reverse=True)
