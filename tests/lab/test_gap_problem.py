"""The base of the gap workflow against numbers by hand: catalogue, comparison of logs
with simulations, fit, planned drives, and responses in the linear model.

Logs are a few seconds long and have no files.
"""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gap_logs import NOISE, make_groups, make_parameter, make_prepared
from tse.gaps import drives, respond
from tse.gaps import fit as fitting
from tse.gaps.catalogue import Own, list_signed_delays, load_catalogue
from tse.gaps.parallel import run_in_processes
from tse.gaps.problem import STIFFNESS_PARAMETERS, Problem
from tse.identify.data import COMPARED_CHANNELS, FitStretch, simulate
from tse.library.core import Config
from tse.library.files import read_toml

ROOT = Path(__file__).resolve().parents[2]
CAR = Config.exact()
AX, AY, YAW = range(3)  # indices of COMPARED_CHANNELS


def average(x: np.ndarray) -> np.ndarray:
    """Return the means over blocks of 4 rows, without the first second."""
    return np.nanmean(x[100:].reshape(-1, 4), axis=1)


# ---- catalogue


@pytest.mark.parametrize(
    ("typical", "limits", "scale"),
    [
        ((0.1, 0.3), (-1.0, 1.0), 0.2),
        ((-0.3, -0.1), (-1.0, 1.0), 0.2),
        ((-0.15, 0.15), (-1.0, 1.0), 0.15),
        ((0.0, 1.0), (-4.0, 1.0), 0.5),
        ((0.0, 0.0), (-0.4, 0.1), 0.4),
        ((0.0, 0.0), (-0.1, 0.4), 0.4),
    ],
)
def test_the_scale_of_a_parameter_is_its_typical_magnitude_or_its_wider_limit(typical, limits, scale):
    p = make_parameter(typical=typical, limits=limits)
    assert p.scale == pytest.approx(scale)
    assert p.step == pytest.approx(0.02 * scale)


def test_the_catalogue_has_the_numbers_of_the_table_under_their_names():
    rows = read_toml(ROOT / "src" / "tables" / "effects.toml")
    found = load_catalogue()
    assert list(found) == [i for i in rows if rows[i]["occurrence"] != "IN_MODEL"]
    for e in found.values():
        row = rows[e.id]
        early = row.get("early", {"title": "", "below": 0.0})
        assert (e.title, e.channels, e.occurrence) == (row["title"], row["channels"], row["occurrence"])
        assert (e.early, e.early_below) == (early["title"], pytest.approx(early["below"]))
        assert list(e.relatives) == [a for a in row["alike"].split(", ") if a in found]
        for p in e.parameters:
            own = row["parameter"][p.key]
            assert p.name == f"{e.id}_{p.key}"
            assert (p.strength, p.given) == (own["role"] == "STRENGTH", own["role"] == "GIVEN")
            assert (p.unit, p.sign, p.text) == (own["unit"], own["sign"], own["text"])
            numbers = [own["default"], own["least"], own["most"], *own["typical"], own["negligible"]]
            values = [p.default, p.low, p.high, p.typical_low, p.typical_high, p.negligible]
            assert values == pytest.approx(numbers, rel=1e-6)
            assert p.prior is None


def test_what_is_fitted_of_an_effect_is_its_sizes_and_then_the_shapes_that_logs_show():
    wind = load_catalogue()["crosswind"]
    assert [p.key for p in wind.strengths] == ["speed"]
    assert [p.key for p in wind.shapes] == ["arm"]  # not heading and coefficient, which are given
    assert [p.key for p in wind.fitted] == ["speed", "arm"]
    assert [p.key for p in load_catalogue()["imu_lever_arm"].fitted] == ["x", "y"]


def test_delays_of_messages_may_be_negative_and_the_lag_of_the_steering_may_not():
    assert list_signed_delays() == {"steering_delay_time", "imu_delay_time"}


# ---- logs as a residual vector


def make_two_logs() -> Problem:
    """Return three logs: of all sensors, without a stretch, and without accel_x."""
    missing = np.zeros(300)
    missing[100:102] = np.nan  # half of the first block
    missing[104] = np.nan  # a quarter of the second
    missing[108:112] = np.nan  # all of the third
    first = make_prepared("first", notes=["a note"])
    empty = make_prepared("empty", stretches=[], notes=["no stretch"])
    other = {"accel_y": missing + np.arange(300.0), "yaw_rate": 0.0}
    third = make_prepared("third", measured=other, quiet={"accel_y": 0.5})
    return Problem([first, empty, third], CAR)


def test_each_residual_has_its_log_channel_time_and_group():
    p = make_two_logs()
    assert [log.name for log in p.logs] == ["first", "third"]
    assert p.notes == ["a note", "no stretch"]
    rows = p.rows
    np.testing.assert_array_equal(rows.log, np.repeat([0, 1], [150, 100]))
    np.testing.assert_array_equal(rows.channel, np.repeat([AX, AY, YAW, AY, YAW], 50))
    np.testing.assert_array_equal(rows.group, np.repeat(np.arange(5), 50))
    first, second = np.arange(50), np.arange(50, 100)  # the channels of a log share its blocks
    np.testing.assert_array_equal(rows.block, np.concatenate([first, first, first, second, second]))
    np.testing.assert_allclose(rows.time, np.tile(1.015 + 0.04 * np.arange(50), 5))  # middle of a block
    np.testing.assert_array_equal(np.flatnonzero(rows.of("accel_x")), np.arange(50))


def test_blocks_are_numbered_through_all_logs():
    """Logs of 3, 4 and 3 s, of which the first second of each is not compared."""
    logs = [make_prepared(rows=n, measured={"yaw_rate": 0.0}) for n in (300, 400, 300)]
    np.testing.assert_array_equal(Problem(logs, CAR).rows.block, np.arange(50 + 75 + 50))


def test_a_block_has_the_weight_of_its_values_and_none_if_half_of_them_are_missing():
    p = make_two_logs()
    np.testing.assert_allclose(p.weight[:50], np.sqrt(4) / NOISE["accel_x"])
    np.testing.assert_allclose(p.weight[150:154], np.array([0, np.sqrt(3), 0, 2]) / NOISE["accel_y"])
    np.testing.assert_allclose(p.weight[200:], np.sqrt(4) / NOISE["yaw_rate"])
    np.testing.assert_array_equal(p.measured[150:154], [np.nan, 106.0, np.nan, 113.5])
    assert [c for c, _ in p.used()] == list(COMPARED_CHANNELS)
    used = dict(p.used())
    assert used["accel_x"].sum() == 50 and used["accel_y"].sum() == 98 and used["yaw_rate"].sum() == 100


def test_noise_below_the_lower_limit_counts_with_its_own_size():
    p = make_two_logs()
    energy = np.ones(250)
    energy[150:200] = 0.25
    energy[[150, 152]] = 0.0  # blocks without a weight
    np.testing.assert_allclose(p.noise_energy, energy)


def test_the_drift_of_the_stiffness_lasts_as_long_as_the_longest_log():
    long, short = make_prepared(rows=400), make_prepared(rows=300)
    for logs in ([long, short], [short, long]):
        assert Problem(logs, CAR).nominal["stiffness_drift_time"] == pytest.approx(3.99)


def test_a_problem_without_a_log_is_empty():
    p = Problem([make_prepared(stretches=[])], CAR, jobs=0)
    assert p.logs == [] and len(p.weight) == 0 and len(p.noise_energy) == 0
    assert list(p.used()) == [] and p.jobs == 1
    assert p.nominal["stiffness_drift_time"] == CAR.stiffness_drift_time


def test_a_problem_of_other_logs_has_its_car_and_what_is_held_stays_with_a_copy():
    p = Problem([make_prepared()], CAR, jobs=3)
    other = p.of([make_prepared("other")])
    assert other.config is p.config and other.jobs == 3 and other.logs[0].name == "other"
    first = p.holding({"cy_rear": 0.9, "mass_change": 0.1})
    second = first.holding({"cy_rear": 0.8})
    assert p.fixed == {} and first.fixed == {"cy_rear": 0.9, "mass_change": 0.1}
    assert second.fixed == {"cy_rear": 0.8, "mass_change": 0.1}
    assert second.get_stiffness_ratios({}) == {"cx_front": 1.0, "cy_front": 1.0, "cy_rear": 0.8}
    assert second.get_stiffness_ratios({"cy_rear": 0.7})["cy_rear"] == 0.7
    assert second.make_config({}).mass_change == 0.1
    assert second.make_config({"mass_change": 0.2}).mass_change == 0.2


def test_an_input_is_averaged_over_blocks_for_each_channel_of_a_log():
    p = make_two_logs()
    ramp = np.arange(300.0)
    p.logs[1].inputs["steer_angle"] = ramp
    found = p.average_quantity("steer_angle")
    np.testing.assert_allclose(found[:150], 0.0)
    np.testing.assert_allclose(found[150:], np.tile(average(ramp), 2))
    measured = p.average_quantity("accel_y")[150:154]
    np.testing.assert_allclose(measured, [102.5, 106.0, np.nan, 113.5])  # what no value has is missing


# ---- simulation


def steer_log(**more) -> Problem:
    steer = 0.02 * np.sin(4.0 * 0.01 * np.arange(300))
    return Problem([make_prepared(steer=steer, **more)], CAR)


def test_a_simulation_is_averaged_over_the_rows_that_were_measured():
    measured = {"accel_y": np.zeros(300), "yaw_rate": np.zeros(300)}
    measured["yaw_rate"][100::4] = np.nan
    p = steer_log(measured=measured)
    values = {"cy_front": 0.9, "mass_change": 0.1, "accel_y_latency": 0.02, Own("bank", 0, 1): 0.02}
    knots = np.interp(p.logs[0].distance, [0.0, 40.0, 80.0], [0.0, 0.02, 0.0])
    ratios = {"cx_front": 1.0, "cy_front": 0.9, "cy_rear": 1.0}
    heavy = Config.exact(CAR.as_dict() | {"mass_change": 0.1, "stiffness_drift_time": 2.99})
    channels = ("accel_y", "yaw_rate")
    x = simulate(heavy, p.logs[0], channels, ratios, {"bank": knots}, {"accel_y": 0.02})
    x["yaw_rate"] = np.where(np.isnan(measured["yaw_rate"]), np.nan, x["yaw_rate"])
    np.testing.assert_allclose(p.predict(values), np.concatenate([average(x[c]) for c in channels]))


def test_what_one_log_lacks_does_not_act_on_another():
    steer = 0.02 * np.sin(4.0 * 0.01 * np.arange(300))
    gap = np.where(np.arange(300) % 4 == 1, np.nan, 0.0)
    logs = [
        make_prepared("whole", steer=steer, measured={"yaw_rate": 0.0}),
        make_prepared("holes", steer=steer, measured={"yaw_rate": gap}),
    ]
    whole, holes = Problem(logs, CAR).predict({}).reshape(2, -1)
    np.testing.assert_allclose(whole, Problem(logs[:1], CAR).predict({}))
    np.testing.assert_allclose(holes, Problem(logs[1:], CAR).predict({}))
    assert np.abs(whole - holes).max() > 1e-4


def test_a_slope_is_at_the_values_of_all_other_parameters():
    p = steer_log()
    asked = [make_parameter("mass_change"), make_parameter("gyro_scale_error")]
    values = {"mass_change": 0.1, "gyro_scale_error": 0.2, "cy_front": 0.7}
    base = p.compute_residuals(values)
    found = p.compute_jacobian(values, base, asked)
    for j, x in enumerate(asked):
        moved = p.compute_residuals(values | {x.name: values[x.name] + x.step})
        np.testing.assert_allclose(found[:, j], (moved - base) / x.step, rtol=1e-9, atol=1e-9)
        assert found[:, j].any()


def test_quantities_of_a_simulation_are_repeated_for_each_channel_of_their_log():
    """The IMU is 50 ms early, and the second log has a bank."""
    steer = 0.02 * np.sin(4.0 * 0.01 * np.arange(300))
    bend = make_prepared("bend", steer=steer, measured={"accel_y": 0.0, "yaw_rate": 0.0})
    p = Problem([make_prepared("straight", speed=10.0), bend], CAR)
    values = {"cy_rear": 1.2, "imu_delay_time": -0.05, Own("bank", 1, 1): 0.05}
    found = p.simulate_channels(values, ("vel_x", "accel_y"))
    ratios = {"cx_front": 1.0, "cy_front": 1.0, "cy_rear": 1.2}
    later = dict.fromkeys(("steer_angle", "wheel_speed_front", "wheel_speed_rear"), 0.05)
    config = Config.exact(CAR.as_dict() | {"stiffness_drift_time": 2.99})
    bank = np.interp(bend.distance, [0.0, 40.0, 80.0], [0.0, 0.05, 0.0])
    x = [
        simulate(config, log, ("vel_x", "accel_y"), ratios, road, later)
        for log, road in zip(p.logs, ({}, {"bank": bank}), strict=True)
    ]
    for name in ("vel_x", "accel_y"):
        parts = [np.tile(average(x[0][name]), 3), np.tile(average(x[1][name]), 2)]
        np.testing.assert_allclose(found[name], np.concatenate(parts), atol=1e-12)


def test_results_for_several_sets_of_values_come_back_in_their_order():
    p = steer_log()
    p.jobs = 2
    asked = [{"cy_front": k} for k in (0.8, 1.0, 1.2)]
    for found, values in zip(p.predict_all(asked), asked, strict=True):
        np.testing.assert_array_equal(found, p.predict(values))


def test_delays_become_latencies_of_inputs_with_the_opposite_sign():
    """Latencies are relative to the delays of the vehicle file."""
    given = {"imu_delay_time": 0.01, "steering_delay_time": 0.02}
    p = Problem([make_prepared()], Config.exact(CAR.as_dict() | given))
    values = {
        "imu_delay_time": 0.03,
        "steering_delay_time": 0.05,
        "wheel_speed_latency": 0.004,
        "accel_x_latency": 0.001,
    }
    expected = {
        "steer_angle": -0.05,
        "wheel_speed_front": -0.016,
        "wheel_speed_rear": -0.016,
        "accel_x": 0.001,
        "accel_y": 0.0,
    }
    assert p.get_latencies(values) == pytest.approx(expected)
    assert p.holding(values).get_latencies({}) == pytest.approx(expected)
    only = p.get_latencies({"accel_y_latency": 0.007})
    assert only == pytest.approx(dict.fromkeys(expected, 0.0) | {"accel_y": 0.007})
    assert p.get_latencies({"cy_front": 0.9}) == {}


def test_a_road_profile_is_that_of_its_log_and_linear_between_knots():
    p = Problem([make_prepared(), make_prepared(speed=30.0)], CAR)
    values = {Own("bank", 1, 1): 0.04, Own("grade", 1, 2): -0.02, Own("grade", 0, 0): 0.0}
    at = p.logs[1].distance  # 0 .. 89.7 m
    found = p.interpolate_profiles(values, 1)
    np.testing.assert_allclose(found["bank"], np.interp(at, [0, 40, 80, 120], [0, 0.04, 0, 0]))
    np.testing.assert_allclose(found["grade"], np.interp(at, [0, 40, 80, 120], [0, 0, -0.02, 0]))
    assert p.interpolate_profiles(values, 0) == {}  # a level road has no profile
    held = p.holding(values).interpolate_profiles({Own("bank", 1, 1): 0.08}, 1)
    np.testing.assert_allclose(held["bank"], 2 * found["bank"])
    np.testing.assert_allclose(held["grade"], found["grade"])


def test_a_road_has_a_strength_at_every_knot_of_every_log():
    p = Problem([make_prepared("a"), make_prepared("b", speed=30.0)], CAR)  # 59.8 m and 89.7 m
    knots = p.strengths(load_catalogue()["grade"])
    assert [str(k.name) for k in knots] == [
        *(f"grade@0:{k}" for k in range(3)),
        *(f"grade@1:{k}" for k in range(4)),
    ]
    one = knots[4]
    assert (one.default, one.low, one.high, one.unit) == (
        0.0,
        pytest.approx(-0.35),
        pytest.approx(0.35),
        "rad",
    )
    assert one.prior == 0.03 and one.scale == pytest.approx(0.015) and one.strength
    assert one.text.endswith("b at 40 m")
    assert p.strengths(load_catalogue()["mass"]) == load_catalogue()["mass"].strengths


def test_simulated_measurements_leave_a_thousandth_of_the_noise():
    steer = 0.02 * np.sin(4.0 * 0.01 * np.arange(300))
    gap = np.zeros(300)
    gap[100:104] = np.nan
    p = Problem([make_prepared(steer=steer, measured={"accel_y": gap, "yaw_rate": 0.0})], CAR)
    p.measure({"cy_front": 0.8})
    left = p.compute_residuals({"cy_front": 0.8})
    assert np.std(left[p.weight > 0]) == pytest.approx(1e-3, rel=0.3)
    assert left[0] == 0.0  # a block without a measurement
    assert np.std(p.compute_residuals({})) > 0.1


# ---- residuals


def test_the_bias_of_each_log_and_channel_is_its_weighted_mean():
    p = make_two_logs()
    difference = np.random.default_rng(1).standard_normal(250) + 3.0 * p.rows.group
    expected = np.zeros(250)
    for g in range(5):
        mine = p.rows.group == g
        expected[mine] = difference[mine] - np.average(difference[mine], weights=p.weight[mine] ** 2)
    np.testing.assert_allclose(p.subtract_bias(difference), expected)
    np.testing.assert_allclose(p.whiten(difference), expected * p.weight)
    p._measured = p.predict({}) + difference
    np.testing.assert_allclose(p.compute_residuals({}), expected * p.weight, atol=1e-9)


def test_a_slope_is_a_difference_within_the_limits_over_the_step_asked_for():
    p = steer_log()
    low, high = (make_parameter("mass_change", (0.1, 0.2), limits) for limits in ((-0.5, 1.0), (-0.5, 0.3)))
    values = {"mass_change": 0.3}
    base = p.compute_residuals(values)
    for parameter, sign in ((low, 1.0), (high, -1.0)):  # at its upper limit, one step back
        for reach in (1.0, 10.0):
            h = sign * reach * 0.02 * 0.15
            moved = p.compute_residuals({"mass_change": 0.3 + h})
            found = p.compute_jacobian(values, base, [parameter], reach)[:, 0]
            np.testing.assert_allclose(found, (moved - base) / h, rtol=1e-9, atol=1e-9)


def test_knots_of_all_logs_are_changed_at_once_and_act_in_their_own():
    steer = 0.01 * np.sin(3.0 * 0.01 * np.arange(300))
    p = Problem([make_prepared(steer=steer), make_prepared(steer=-steer)], CAR)
    asked = [*p.strengths(load_catalogue()["bank"]), load_catalogue()["mass"].strengths[0]]
    base = p.compute_residuals({})
    assert len(list(p.generate_moves({}, asked))) == 4  # three knots, and the mass
    found = p.compute_jacobian({}, base, asked)
    for j, parameter in enumerate(asked[:6]):
        h = parameter.step
        alone = (p.compute_residuals({parameter.name: h}) - base) / h
        np.testing.assert_allclose(found[:, j], alone, atol=1e-6 * np.abs(alone).max())
        assert not found[p.rows.log != parameter.name.log, j].any()


# ---- fit


class Linear:
    """A problem whose residuals are y - a x, for parameters p0, p1, ..."""

    def __init__(self, a: np.ndarray, y: np.ndarray):
        self.a, self.y = a, y

    def compute_residuals(self, values):
        return self.y - self.a @ [values[f"p{k}"] for k in range(self.a.shape[1])]

    def compute_jacobian(self, values, base, parameters):
        return -self.a


def make_linear() -> Linear:
    rng = np.random.default_rng(4)
    a = rng.standard_normal((30, 3))
    return Linear(a, a @ [0.3, -0.2, 0.5] + 0.3 * rng.standard_normal(30))


def test_a_fit_is_least_squares_with_its_priors_as_further_rows():
    p = make_linear()
    asked = [make_parameter("p0"), make_parameter("p1", default=0.4, prior=0.05), make_parameter("p2")]
    found = fitting.fit_parameters(p, asked, {}, tolerance=1e-12, most=50)
    table, y = np.vstack([p.a, [0, 1 / 0.05, 0]]), np.append(p.y, 0.4 / 0.05)
    best = np.linalg.lstsq(table, y, rcond=None)[0]
    assert list(found.values) == ["p0", "p1", "p2"]
    np.testing.assert_allclose(list(found.values.values()), best, atol=1e-5)
    np.testing.assert_allclose(found.residuals, p.y - p.a @ best, atol=1e-4)  # without rows of priors
    np.testing.assert_array_equal(found.jacobian, -p.a)
    assert found.parameters == asked


def test_a_fit_starts_where_it_is_asked_to_else_at_the_default_and_within_limits():
    asked = [make_parameter("p0", default=0.1), make_parameter("p1", default=0.4), make_parameter("p2")]
    found = fitting.fit_parameters(make_linear(), asked, {"p1": -0.6, "p2": 7.0}, most=1).values
    assert found == pytest.approx({"p0": 0.1, "p1": -0.6, "p2": 1.0}, abs=1e-6)


def test_a_fit_keeps_the_limits():
    asked = [make_parameter("p0", limits=(-1.0, 0.1)), make_parameter("p1"), make_parameter("p2")]
    assert fitting.fit_parameters(make_linear(), asked, {}).values["p0"] == pytest.approx(0.1, abs=1e-3)


@pytest.mark.parametrize(
    ("groups", "length"),
    [
        ([[1, 1, 1, 1]], 4.0),  # autocorrelations 3/4, 2/4, 1/4
        ([[1, 1, 1, 1], [1, 1, 1, 1]], 4.0),  # of two logs: no pair across their border
        ([[1, 1, 0, 0]], 2.0),
        ([[1, -1, 1, -1]], 1.0),  # at least one block
        ([[2, 2, 0, 0], [0, 0, 1, -1]], 1.0 + 2.0 * (4 - 1) / 10),
        ([[0, 0, 0, 0]], 1.0),
    ],
)
def test_residuals_count_as_one_for_as_long_as_they_are_alike(groups, length):
    problem, residuals = make_groups(*(("accel_y", x) for x in groups))
    assert fitting.compute_correlation_lengths(problem, residuals) == {"accel_y": pytest.approx(length)}


def test_autocorrelations_end_after_four_seconds():
    problem, residuals = make_groups(("accel_y", [1.0] * 1000))
    length = fitting.compute_correlation_lengths(problem, residuals)["accel_y"]
    assert length == pytest.approx(1.0 + 2.0 * sum(1.0 - k / 1000 for k in range(1, 101)))


def test_the_gap_is_the_rms_of_a_channel_and_its_excess_is_above_the_noise():
    problem, e = make_groups(("accel_x", [3, 4]), ("accel_y", [2, -2]), ("yaw_rate", [0.5, 0.5]))
    problem.noise_energy[2:4] = 0.25
    assert fitting.compute_gap(problem, e) == pytest.approx(
        {"accel_x": np.sqrt(12.5), "accel_y": 2.0, "yaw_rate": 0.5}
    )
    excess = {"accel_x": 23.0, "accel_y": 7.5, "yaw_rate": 0.0}  # never below 0
    assert fitting.compute_channel_excess(problem, e) == pytest.approx(excess)
    assert fitting.compute_excess(problem, e) == pytest.approx(30.5)
    problem.weight[1] = 0.0  # a block that is not used
    assert fitting.compute_gap(problem, e)["accel_x"] == pytest.approx(3.0)
    assert fitting.compute_channel_excess(problem, e)["accel_x"] == pytest.approx(8.0)


def test_the_covariance_of_a_fit_is_that_of_its_residuals_not_of_the_noise():
    """A channel of rms 2 whose blocks are independent, one of rms 3 with four alike."""
    problem, e = make_groups(("accel_x", [2, -2] * 20), ("accel_y", [3, 3, 3, 3]))
    a = np.random.default_rng(2).standard_normal((44, 2))
    parameters = [make_parameter("a"), make_parameter("b", prior=0.2)]
    fit = fitting.Fit(parameters, {}, e, a)
    prior = np.diag([0.0, 25.0])
    bread = np.linalg.inv(a.T @ a + prior)
    meat = 4.0 * a[:40].T @ a[:40] + 4.0 * 9.0 * a[40:].T @ a[40:] + prior
    np.testing.assert_allclose(fitting.compute_covariance(problem, fit), bread @ meat @ bread)


def test_two_models_are_compared_by_their_rms_with_an_interval():
    problem, _ = make_groups(("accel_x", [0.0] * 500), ("accel_y", [0.0] * 500))
    before, after = np.ones(1000), np.ones(1000)
    before[500:], after[500:] = 2.0, 1.0
    found = fitting.compare_models(problem, before, after)
    same, better = found["accel_x"], found["accel_y"]
    assert (same.before, same.after, same.change, same.ci95) == (1.0, 1.0, 0.0, (0.0, 0.0))
    assert (better.before, better.after, better.change, better.ci95) == (2.0, 1.0, -0.5, (-0.5, -0.5))
    assert better.better and not same.better
    worse = fitting.compare_models(problem, after, before)["accel_y"]
    assert worse.change == 1.0 and not worse.better


def test_the_interval_of_a_change_is_that_of_blocks_of_two_seconds_of_each_log():
    """Two logs of 200 s: what one of them has in a block, the other has not."""
    problem, _ = make_groups(("yaw_rate", [0.0] * 5000), ("yaw_rate", [0.0] * 5000))
    block = (problem.rows.time // 2.0).astype(int)
    square = np.where(block % 2 == problem.rows.log, 1.5, 0.5)
    found = fitting.compare_models(problem, np.ones(10000), np.sqrt(square))["yaw_rate"]
    half = 1.96 * 0.5 * 0.5 / np.sqrt(200)  # of the root of a mean of 200 blocks of 1 +- 0.5
    assert found.change == pytest.approx(0.0, abs=1e-9)
    assert found.ci95 == (pytest.approx(-half, rel=0.1), pytest.approx(half, rel=0.1))
    assert not found.better


def test_both_models_are_drawn_in_the_same_blocks():
    """Residuals that are halved everywhere are halved for certain."""
    problem, _ = make_groups(("yaw_rate", [0.0] * 1000))
    before = 1.0 + np.arange(1000.0) // 50
    found = fitting.compare_models(problem, before, 0.5 * before)["yaw_rate"]
    assert found.ci95 == pytest.approx((-0.5, -0.5)) and found.change == pytest.approx(-0.5)


def test_a_fit_that_fails_is_its_start(monkeypatch):
    asked = [make_parameter("p0", default=0.1), make_parameter("p1", prior=0.5), make_parameter("p2")]
    failed = SimpleNamespace(x=np.full(3, np.nan), fun=np.full(31, np.nan), jac=np.full((31, 3), np.nan))
    monkeypatch.setattr(fitting, "least_squares", lambda *_, **__: failed)
    p = make_linear()
    found = fitting.fit_parameters(p, asked, {"p1": 0.2})
    assert found.values == pytest.approx({"p0": 0.1, "p1": 0.2, "p2": 0.0})
    np.testing.assert_allclose(found.residuals, p.y - p.a @ [0.1, 0.2, 0.0])
    np.testing.assert_array_equal(found.jacobian, -p.a)


def test_what_one_process_returns_is_whole():
    assert run_in_processes(1, lambda x: (x, "large"), [3, 4], lambda pair: pair[0]) == [
        (3, "large"),
        (4, "large"),
    ]


# ---- planned drives


@pytest.fixture(scope="module")
def planned() -> dict[str, drives.Candidate]:
    return {c.name: c for c in drives.make_candidates(CAR)}


def compute_steady_angle(v: float, ay: float) -> float:
    """Return the steering angle of a steady turn from the force balance of both axles."""
    length = CAR.lf + CAR.lr
    front = CAR.mass * ay * CAR.lr / length / CAR.cornering_stiffness_front
    rear = CAR.mass * ay * CAR.lf / length / CAR.cornering_stiffness_rear
    return length * ay / v**2 + front - rear


def count_turns(x: np.ndarray) -> int:
    sign = np.sign(x[np.abs(x) > 1e-12])
    return int(np.count_nonzero(np.diff(sign)))


@pytest.mark.parametrize("v", [10.0, 20.0, 30.0])
def test_steering_has_the_frequency_and_the_acceleration_of_its_name(planned, v):
    for ay in (2, 4):
        ((steer, speed),) = planned[f"steering sine sweep 0.2 .. 3 Hz, {ay} m/s2, at {v:g} m/s"].pieces
        assert np.all(speed == v) and len(steer) == len(speed) == 3001
        assert np.abs(steer).max() == pytest.approx(compute_steady_angle(v, ay), rel=1e-2)
        rate = np.log(15.0) / 30.0
        assert count_turns(steer) == int(2 * 2.8 / rate)  # each half period of a log sweep
        turn = np.flatnonzero(np.diff(np.sign(steer[1:])))[0] * 0.01
        assert turn == pytest.approx(np.log(1 + 0.5 * rate / 0.2) / rate, abs=0.02)  # it begins slowly
    for ay in (3, 6):
        ((steer, _),) = planned[f"steering steps to {ay} m/s2, at {v:g} m/s"].pieces
        angle = compute_steady_angle(v, ay)
        np.testing.assert_allclose(steer[[100, 300, 500, 700, 1100]] / angle, [0, 1, 0, -1, 1], atol=1e-6)
        assert steer[200] == pytest.approx(0.5 * angle, rel=0.1)  # a hand takes some time
        assert steer[212] < 0.99 * angle < steer[225]
    for f in (0.5, 1, 2):
        ((steer, _),) = planned[f"slalom of {f:g} Hz, at {v:g} m/s"].pieces
        assert count_turns(steer[:-1]) == 2 * f * 30 - 1
        assert steer.max() == pytest.approx(compute_steady_angle(v, 2.5), rel=5e-3)
    ((steer, _),) = planned[f"slow steering ramps to 6 m/s2, at {v:g} m/s"].pieces
    angle = compute_steady_angle(v, 6.0)
    np.testing.assert_allclose(
        steer[[0, 675, 1350, 1500, 2850, 3000]] / angle, [0, 0.5, 1, 0, -1, 0], atol=1e-9
    )


@pytest.mark.parametrize("v", [10.0, 20.0, 30.0])
def test_brakes_have_the_depth_and_the_mean_speed_of_their_name(planned, v):
    for depth in (1.5, 3.0):
        ((steer, speed),) = planned[
            f"steps of brake and throttle, {depth:g} m/s2, straight, about {v:g} m/s"
        ].pieces
        pull = np.gradient(speed, 0.01)
        assert not steer.any() and speed.mean() == pytest.approx(v) and speed.min() >= 3.5
        np.testing.assert_allclose(pull[[75, 225, 375]], [depth, -depth, depth], rtol=1e-3)
    ((steer, speed),) = planned[f"brake and throttle of 3 m/s2 in turns of 3 m/s2, about {v:g} m/s"].pieces
    angle = compute_steady_angle(v, 3.0)
    np.testing.assert_allclose(steer[[300, 900, 1500]] / angle, [1, -1, 1], rtol=1e-3)
    assert np.gradient(speed, 0.01)[75] == pytest.approx(3.0, rel=1e-3)
    ((steer, speed),) = planned[f"straight on at {v:g} m/s"].pieces
    assert not steer.any() and np.all(speed == v)


def test_drives_of_two_speeds_have_a_piece_for_each(planned):
    sweep = planned["steering sine sweep 0.2 .. 3 Hz, 3 m/s2, half at 10 and half at 30 m/s"]
    steps = planned["steering steps to 4 m/s2, half at 10 and half at 30 m/s"]
    for one, ay in ((sweep, 3.0), (steps, 4.0)):
        assert [float(speed[0]) for _, speed in one.pieces] == [10.0, 30.0]
        for (steer, speed), v in zip(one.pieces, (10.0, 30.0), strict=True):
            assert np.all(speed == v) and len(steer) == 1501
            assert np.abs(steer).max() == pytest.approx(compute_steady_angle(v, ay), rel=1e-2)
        assert one.seconds == pytest.approx(2 * 15.0 - 2 * 1.0)  # of each piece less its burn-in
    ((steer, speed),) = planned["straight on from 10 to 30 m/s"].pieces
    assert not steer.any() and speed[[0, 1500, 3000]] == pytest.approx([10.0, 20.0, 30.0])
    ((steer, speed),) = planned["tight turns of 0.3 rad at 5 m/s"].pieces
    assert np.all(speed == 5.0) and steer[[250, 750]] == pytest.approx([0.3, -0.3], rel=1e-3)


def test_a_planned_drive_is_a_log_for_each_piece():
    """Two pieces of 3 s, the second of which accelerates by 2 m/s2, straight on."""
    n = 303
    pieces = ((np.zeros(n), np.full(n, 20.0)), (np.zeros(n), 10.0 + 0.02 * np.arange(n)))
    logs = drives.prepare_candidate(drives.Candidate("drive", pieces), CAR)
    assert [log.name for log in logs] == ["drive 1", "drive 2"]
    for log in logs:
        assert len(log.time) == 300 and log.rows_per_block == 4 and log.step == pytest.approx(0.01)
        assert log.noise == {c: getattr(CAR, f"{c}_sd") for c in COMPARED_CHANNELS}
        (s,) = log.stretches
        assert (s.first, s.last) == (0, 300) and not s.used[:100].any() and s.used[100:].all()
        assert all(not x.any() for x in log.measured.values())
    assert logs[0].distance[[0, 100]] == pytest.approx([0.0, 20.0])
    assert logs[1].distance[100] == pytest.approx(10.0 + 0.5 * 2.0)
    front, rear = (logs[1].inputs[f"wheel_speed_{a}"] * 0.33 for a in ("front", "rear"))
    slip = CAR.mass * 2.0 / (CAR.longitudinal_stiffness_front + CAR.longitudinal_stiffness_rear)
    np.testing.assert_allclose(front, (10.0 + 0.02 * np.arange(300)) * (1 + slip), rtol=1e-6)
    np.testing.assert_allclose(rear, front)
    assert logs[0].inputs["wheel_speed_front"] * 0.33 == pytest.approx(20.0)


def test_the_front_wheels_go_round_a_longer_way_and_pull_against_their_side_force():
    """A steady turn, in which the geometry of the circles is exact."""
    n, v = 1000, 10.0
    steer = np.full(n, 0.1)
    found = drives._compute_wheel_speeds(CAR, steer, np.full(n, v))
    out = simulate(
        CAR, make_prepared(rows=n, steer=steer, speed=v), ("vel_y", "true_yaw_rate", "accel_y"), {}, {}
    )
    vy, r, ay = (out[c][-1] for c in ("vel_y", "true_yaw_rate", "accel_y"))
    way = v * np.cos(0.1) + (vy + CAR.lf * r) * np.sin(0.1)
    pull = CAR.lr * CAR.mass * ay / (CAR.lf + CAR.lr) * np.sin(0.1) - CAR.mass * vy * r
    slip = pull / (CAR.longitudinal_stiffness_front + CAR.longitudinal_stiffness_rear)
    assert slip > 2e-4
    assert found["wheel_speed_front"][-1] * 0.33 == pytest.approx(way * (1 + slip), rel=5e-5)
    assert found["wheel_speed_rear"][-1] * 0.33 == pytest.approx(v * (1 + slip), rel=5e-5)


# ---- responses in the linear model


def test_missing_blocks_of_a_signal_are_interpolated():
    x = np.array([np.nan, 1.0, np.nan, 3.0, np.nan])
    np.testing.assert_array_equal(respond._fill_gaps(x), [1.0, 1.0, 2.0, 3.0, 3.0])
    assert np.isnan(x).sum() == 3  # in a copy
    np.testing.assert_array_equal(respond._fill_gaps(np.full(3, np.nan)), np.zeros(3))


def test_signals_of_formulas_are_those_of_the_single_track_model():
    """A steady turn to the left, in the second of two logs, with a pause of 2 s."""
    cut = [FitStretch(0, 400, np.arange(400) >= 100), FitStretch(400, 800, np.arange(400) >= 100)]
    bend = make_prepared(rows=800, steer=0.02, speed=15.0, stretches=cut)
    bend.inputs["wheel_speed_rear"] = 1.01 * bend.inputs["wheel_speed_front"]
    p = Problem([make_prepared(), bend], CAR)
    straight, s = respond.compute_signals(p, {"cy_front": 0.9})
    assert len(straight["time"]) == 50 and len(s["time"]) == 150
    out = simulate(p.make_config({}), bend, respond.SIMULATED, p.get_stiffness_ratios({"cy_front": 0.9}), {})
    x = {c: out[c][399] for c in out}
    v = x["vel_x"]
    assert s["time"][[0, 74, 75]] == pytest.approx([1.015, 3.975, 5.015])
    assert s["dt"][[0, 1, 75]] == pytest.approx([0.04, 0.04, 1.0])  # at most a second
    for name in ("vel_x", "vel_y", "accel_x", "accel_y"):
        assert s[name][74] == pytest.approx(x[name], rel=1e-3, abs=1e-4)
    assert s["yaw_rate"][74] == pytest.approx(x["true_yaw_rate"], rel=1e-3)
    front = 0.02 - (x["vel_y"] + CAR.lf * x["true_yaw_rate"]) / v
    rear = (CAR.lr * x["true_yaw_rate"] - x["vel_y"]) / v
    assert front > 0.001 and rear > 0.001
    assert s["slip_angle_front"][74] == pytest.approx(front, rel=1e-2)
    assert s["slip_angle_rear"][74] == pytest.approx(rear, rel=1e-2)
    assert s["slip_front"][74] == pytest.approx(15.0 / v - 1, abs=1e-6)
    assert s["slip_rear"][74] == pytest.approx(15.15 / v - 1, abs=1e-6)
    assert s["steer_angle"] == pytest.approx(0.02) and not straight["steer_angle"].any()


def test_each_axle_rolls_on_its_own_wheels():
    """Straight on at 20 m/s with front wheels of 30 cm and rear wheels of 36 cm."""
    car = Config.exact(CAR.as_dict() | {"wheel_radius_front": 0.3, "wheel_radius_rear": 0.36})
    found = drives._compute_wheel_speeds(car, np.zeros(300), np.full(300, 20.0))
    for axle, radius in (("front", 0.3), ("rear", 0.36)):
        np.testing.assert_allclose(found[f"wheel_speed_{axle}"] * radius, 20.0, rtol=1e-6)
    log = make_prepared()
    log.inputs.update(found)
    (s,) = respond.compute_signals(Problem([log], car), {})
    np.testing.assert_allclose([s["slip_front"], s["slip_rear"]], 0.0, atol=1e-5)
    assert s["vel_x"] == pytest.approx(20.0, rel=1e-4)


PLACES = ("front_angle", "rear_angle", "force_y", "yaw_moment", respond.ROAD_BANK)


@pytest.mark.parametrize("place", PLACES)
def test_a_lasting_disturbance_ends_in_the_steady_turn_of_statics(place):
    """Forces and moments of both axles balance what is added."""
    n, v, k = 300, 20.0, {"cx_front": 1.0, "cy_front": 0.8, "cy_rear": 1.1}
    at = {"vel_x": np.full(n, v), "dt": np.full(n, 0.04)}
    size = {"front_angle": 0.01, "rear_angle": 0.01}.get(place, 0.2)
    u = size * np.column_stack([np.ones(n), -2 * np.ones(n)])
    found = respond._move_simulation(CAR, k, at, place, u)
    front, rear = CAR.cornering_stiffness_front * 0.8, CAR.cornering_stiffness_rear * 1.1
    force = {"front_angle": front * size, "rear_angle": rear * size, "force_y": CAR.mass * size}.get(
        place, 0.0
    )
    moment = {
        "front_angle": CAR.lf * front * size,
        "rear_angle": -CAR.lr * rear * size,
        "yaw_moment": CAR.yaw_inertia * size,
    }.get(place, 0.0)
    gravity = CAR.mass * size if place == respond.ROAD_BANK else 0.0
    # unknowns: side forces of the axles and the yaw rate r; v_y from both slip angles
    # f = front (-(vy + lf r)/v), b = rear (lr r - vy)/v, f + b + force + gravity = m v r
    matrix = np.array([
        [1.0, 0.0, front / v, front * CAR.lf / v],
        [0.0, 1.0, rear / v, -rear * CAR.lr / v],
        [1.0, 1.0, 0.0, -CAR.mass * v],
        [CAR.lf, -CAR.lr, 0.0, 0.0],
    ])  # fmt: skip
    f, b, _, r = np.linalg.solve(matrix, [0.0, 0.0, -force - gravity, -moment])
    assert found.keys() == {"accel_y", "yaw_rate"}
    np.testing.assert_allclose(found["yaw_rate"][-1], [r, -2 * r], rtol=1e-6)
    felt = (f + b + force) / CAR.mass  # by an accelerometer, which gravity does not move
    np.testing.assert_allclose(found["accel_y"][-1], [felt, -2 * felt], rtol=1e-6, atol=1e-9)


def test_a_disturbance_acts_from_one_block_to_the_next_by_its_mean():
    """A yaw moment alone turns the car at first: the yaw rate is its integral."""
    at = {"vel_x": np.full(4, 20.0), "dt": np.full(4, 1e-4)}
    u = np.array([[0.0], [1.0], [1.0], [0.0]])
    found = respond._move_simulation(
        CAR, {"cx_front": 1.0, "cy_front": 1.0, "cy_rear": 1.0}, at, "yaw_moment", u
    )
    np.testing.assert_allclose(found["yaw_rate"][:, 0], 1e-4 * np.array([0.0, 0.5, 1.5, 2.0]), rtol=1e-2)


def test_a_push_is_held_by_the_longitudinal_stiffness_of_both_axles():
    """Of a car whose front tyres have a third of their stiffness."""
    at = {"vel_x": np.array([20.0, 10.0]), "dt": np.array([0.04, 0.04])}
    k = {"cx_front": 0.3, "cy_front": 1.0, "cy_rear": 1.0}
    found = respond._move_simulation(CAR, k, at, "force_x", np.ones((2, 1)))["accel_x"][:, 0]
    along = 0.3 * (CAR.longitudinal_stiffness_front + CAR.longitudinal_stiffness_rear) / CAR.mass
    x, expected = 0.0, []
    for v in at["vel_x"]:  # dx/dt = 1 - along x / v, in small steps
        for _ in range(4000):
            x += 1e-5 * (1.0 - along * x / v)
        expected.append(1.0 - along * x / v)
    np.testing.assert_allclose(found, expected, rtol=1e-2)


def test_the_response_of_a_sensor_is_in_its_own_channel_and_log():
    p = Problem([make_prepared(), make_prepared("b", measured={"accel_y": 0.0})], CAR)
    at = [{"vel_x": np.full(50, 20.0), "dt": np.full(50, 0.04)}] * 2
    rise = np.linspace(0.0, 1.0, 50)
    forms = [np.column_stack([rise, 0 * rise]), np.column_stack([0 * rise, 2 * rise])]
    found = respond.compute_responses(p, {}, at, "accel_y", forms)
    first, second = ((p.rows.log == i) & p.rows.of("accel_y") for i in (0, 1))
    sd = NOISE["accel_y"] / 2  # of a mean of 4 rows
    np.testing.assert_allclose(found[first, 0], -(rise - 0.5) / sd, atol=1e-9)  # less than was measured
    np.testing.assert_allclose(found[second, 1], -2 * (rise - 0.5) / sd, atol=1e-9)
    found[first, 0] = found[second, 1] = 0.0
    assert not found.any()
    turned = respond.compute_responses(p, {}, at, "yaw_rate", forms)
    assert turned[p.rows.of("yaw_rate"), 0].any() and not turned[~p.rows.of("yaw_rate")].any()


def test_stiffness_is_fitted_as_a_ratio_between_a_tenth_and_five():
    for p, name in zip(STIFFNESS_PARAMETERS, ("cx_front", "cy_front", "cy_rear"), strict=True):
        assert (p.name, p.default, p.low, p.high, p.unit) == (name, 1.0, 0.1, 5.0, "1")
        assert p.scale == pytest.approx(1.25) and p.negligible == 0.02 and p.prior is None
