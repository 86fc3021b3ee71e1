"""The regression of slip on straight rows (identify/slip.py): which rows it uses, what it
makes of them, and what it reports. Logs are a few seconds at a constant state."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.lab.test_identify_data import make_checked
from tse.car.vehicle import SHAPE, Vehicle, get_ordinary_car, make_default_vehicle
from tse.identify import slip, unknowns
from tse.identify.fit import CarFit
from tse.library.core import Config

CAR = {
    "mass": 1500.0, "lf": 1.0, "lr": 1.5, "wheel_radius_front": 0.30, "wheel_radius_rear": 0.40,
    "longitudinal_stiffness_front": 1e5, "longitudinal_stiffness_rear": 8e4,
}  # fmt: skip
CONFIG = Config.exact(CAR)
AT = {"aero_drag_coefficient": 0.4, "rolling_resistance_coefficient": 0.01}
HEIGHT = 0.5
TIME = 0.01 * np.arange(2000)


def make_vehicle(driven: str) -> Vehicle:
    return Vehicle(None, "car", {}, {"driven_axle": driven, "cg_height": HEIGHT})


def make_car(driven: str = "front", **more: float) -> slip._Car:
    return slip._Car(CONFIG, AT | more, make_vehicle(driven))


def count_samples(
    driven: str = "front", time: np.ndarray = TIME, extra: dict | None = None, **columns
) -> int:
    """Return how many samples a log has. Without `columns` the car drives straight on at
    12 m/s, with 0.3 m/s2."""
    log = make_checked(time, extra, **({"accel_x": 0.3} | columns))
    found = slip._select_samples(make_car(driven), log)
    return 0 if found is None else len(found.slip)


FIRST = TIME < 10  # the first half of the rows


# ---- the rows that are used


@pytest.mark.parametrize(
    ("columns", "samples"),
    [
        ({}, 200),
        ({"steer_angle": np.where(FIRST, 0.031, 0.029)}, 100),
        ({"steer_angle": np.where(FIRST, -0.031, -0.029)}, 100),
        ({"yaw_rate": np.where(FIRST, 0.086, 0.080)}, 100),  # 12 m/s x yaw rate
        ({"yaw_rate": np.where(FIRST, -0.086, -0.080)}, 100),
        ({"yaw_rate": np.nan}, 200),  # the steering angle alone shows that the road is straight
        ({"wheel_speed_rear": np.where(FIRST, 9.8, 10.2), "wheel_speed_front": 13.5}, 100),  # 4 m/s
        ({"accel_x": np.where(FIRST, -0.05, 0.05)}, 100),  # without a brake switch
        ({"accel_x": np.where(FIRST, np.nan, 0.3)}, 100),
        ({"accel_x": 4.5}, 0),  # more than half of the grip
        ({"accel_x": np.where(FIRST, -0.3, 0.3), "extra": {"brake": np.where(TIME > 15, 1.0, 0.0)}}, 150),
        ({"accel_x": 0.3, "extra": {"brake": np.where(FIRST, 0.51, 0.49)}}, 100),
        ({"accel_x": 0.3, "extra": {"brake": np.where(FIRST, np.nan, 0.0)}}, 100),  # may be on
        ({"accel_x": np.where(FIRST, -0.3, 0.3), "extra": {"brake": 0.0 * TIME}}, 100),  # never on
    ],
)
def test_samples_are_straight_fast_and_without_brakes(columns: dict, samples: int) -> None:
    """200 samples in 20 s. Means over 0.6 s move a limit by three samples at most."""
    assert count_samples(**columns) == pytest.approx(samples, abs=4 if 0 < samples < 200 else 0)


@pytest.mark.parametrize(("step", "every"), [(0.01, 10), (0.02, 5), (0.1, 1), (0.2, 1)])
def test_a_sample_is_taken_every_tenth_of_a_second(step: float, every: int) -> None:
    time = step * np.arange(400)
    assert count_samples(time=time) == 400 / every


def test_with_two_driven_axles_wheel_torques_and_brakes_must_be_known() -> None:
    torques = {"wheel_torque_front": 100.0 + 0 * TIME, "wheel_torque_rear": 100.0 + 0 * TIME}
    brake = {"brake": 0 * TIME}
    assert count_samples("both", extra=torques | brake) == 200
    assert count_samples("both", extra=torques) == 0
    assert count_samples("both", extra={"wheel_torque_front": 0 * TIME} | brake) == 0
    assert count_samples("rear") == 200


def test_rows_within_300_ms_of_a_braking_are_not_used_either() -> None:
    """A braking of one row: slip is a mean over 0.6 s, so six samples contain it."""
    switch = np.where(np.arange(2000) == 505, 1.0, 0.0)
    log = make_checked(TIME, {"brake": switch}, accel_x=0.3)
    weak = make_checked(TIME, {"brake": switch}, accel_x=np.where(np.arange(2000) == 505, -9.0, 0.3))
    found = slip._select_samples(make_car(), log)
    assert len(found.slip) == 194
    # what the braking does to the means is in none of the samples
    np.testing.assert_allclose(slip._select_samples(make_car(), weak).x[:, 0], found.x[:, 0], rtol=0.02)


@pytest.mark.parametrize("driven", ["front", "rear", "both"])
def test_errors_that_change_sign_in_every_row_have_no_influence_on_a_sample(driven: str) -> None:
    """All channels are used as means over 60 rows. The yaw rate would be too large, and
    the rear axle too slow, in every second row."""
    sign = np.where(np.arange(2000) % 2, 1.0, -1.0)
    car = make_car(driven)

    def select(size: float) -> slip._Samples:
        torques = {"wheel_torque_front": 100 + 90 * size * sign, "wheel_torque_rear": 100 - 40 * size * sign}
        columns = {"wheel_speed_front": 40.4 + 4 * size * sign, "wheel_speed_rear": 30 - 3 * size * sign,
                   "accel_x": 0.4 + 0.5 * size * sign, "yaw_rate": 0.2 * size * sign}  # fmt: skip
        log = make_checked(TIME, torques | {"brake": 0 * TIME}, steer_angle=0.02, **columns)
        return slip._select_samples(car, log)

    plain, noisy = select(0.0), select(1.0)
    assert len(noisy.slip) == len(plain.slip) == 200
    inside = slice(10, -10)
    np.testing.assert_allclose(noisy.x[inside], plain.x[inside], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(noisy.slip[inside], plain.slip[inside], rtol=1e-6)
    np.testing.assert_allclose(noisy.weight[inside], plain.weight[inside], rtol=1e-6)


@pytest.mark.parametrize("channel", ["accel_x", "wheel_speed_front", "wheel_speed_rear", "steer_angle"])
def test_a_sample_has_no_missing_value_wherever_a_channel_begins(channel: str) -> None:
    """Derivatives reach one row further than the values, so the first row is tried at
    each place between two samples."""
    plain = {"accel_x": 0.3, "wheel_speed_front": 40.0, "wheel_speed_rear": 30.0, "steer_angle": 0.0}
    time = TIME[:300]
    for first in range(100, 110):
        late = {channel: np.where(np.arange(300) < first, np.nan, plain[channel])}
        found = slip._select_samples(make_car(), make_checked(time, **({"accel_x": 0.3} | late)))
        assert np.isfinite(found.x).all() and np.isfinite(found.slip).all()
        assert 18 <= len(found.slip) <= 23


# ---- what a sample has


@pytest.mark.parametrize("driven", ["front", "rear"])
def test_a_sample_compares_the_driven_with_the_free_axle(driven: str) -> None:
    """The front wheels turn 1 % faster than the rear ones, at 12 m/s and 0.3 m/s2."""
    car = make_car(driven, imu_scale_ax_error=0.02, pitch_leak_gain=0.004)
    log = make_checked(TIME, wheel_speed_front=40.4, accel_x=0.3, steer_angle=0.02, yaw_rate=0.05)
    found = slip._select_samples(car, log)
    # the front axle is 2.5 m ahead of the rear one and moves to the left, too
    front, rear = 0.3 * 40.4, 12.0 * np.cos(0.02) + 2.5 * 0.05 * np.sin(0.02)
    push = 0.3 / (1.02 * (1 + 9.81 * 0.004)) + 9.81 * 0.01
    push += 0.4 * (12.0 if driven == "front" else front) ** 2 / 1500
    radii = (-1 if driven == "front" else 1) * car.give * push
    seen = (front - rear) / 12.0 if driven == "front" else (rear - front) / front
    np.testing.assert_allclose(found.slip, seen - radii, rtol=1e-6)
    axle = 0 if driven == "front" else 1
    slips, bends, _ = car.compute_slip(axle, np.array([push]), np.array([push]))
    speed = 12.0 if driven == "front" else front
    expected = [slips[0], 0.0, 0.0, speed**2 / (1e5 if driven == "front" else 8e4), bends[0] + radii]
    np.testing.assert_allclose(found.x, np.tile(expected, (200, 1)), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.weight, speed)
    assert found.block.tolist() == [0.0] * 100 + [1.0] * 100


def test_a_car_that_accelerates_spins_its_wheels_up_and_weighs_fast_rows_as_15_m_s() -> None:
    """From 10 m/s on at 1 m/s2. The wheels of an axle are 1.4 % of the mass."""
    speed = 10.0 + TIME
    log = make_checked(TIME, wheel_speed_front=speed / 0.3, wheel_speed_rear=speed / 0.4, accel_x=1.0)
    found = slip._select_samples(make_car(), log)
    k = 80  # after 8 s
    push = 1.0 + 0.0981 + 0.4 * 18.0**2 / 1500
    car = make_car()
    driven = car.compute_slip(0, np.array([push + 0.014]), np.array([push]))[0][0]
    free = car.compute_slip(1, np.array([-0.014]), np.array([push]))[0][0]
    np.testing.assert_allclose(found.x[k, :2], [driven - free, 1 / 18.0], rtol=1e-3)
    np.testing.assert_allclose(found.weight[[20, k]], [12.0, 15.0], rtol=1e-3)
    # slip grows with the drag of the air, 2 x 0.4 v/m a second; tyres bend a little
    assert found.x[k, 2] == pytest.approx(1500 / 1e5 * 0.8 * 18 / 1500, rel=0.2)


def test_an_acceleration_is_the_mean_over_600_ms_of_the_slope_of_the_mean_speed() -> None:
    """From 10 s on at 1 m/s2. The mean speed gains 1 m/s2 after 0.3 s, and the mean of
    that 7/8 of it."""
    speed = 10.0 + np.maximum(TIME - 10.0, 0.0)
    log = make_checked(TIME, wheel_speed_front=speed / 0.3, wheel_speed_rear=speed / 0.4, accel_x=1.0)
    found = slip._select_samples(make_car(), log)
    gains = found.x[:, 1] * found.weight
    np.testing.assert_allclose(gains[[94, 100, 103, 106]], [0.0, 0.5, 0.875, 1.0], atol=0.02)


def test_the_force_of_two_driven_axles_is_shared_as_their_torques() -> None:
    """400 and 100 Nm are 1333 and 250 N, so 0.722 m/s2 apart."""
    torques = {"wheel_torque_front": 400.0 + 0 * TIME, "wheel_torque_rear": 100.0 + 0 * TIME}
    car = make_car("both")
    found = slip._select_samples(car, make_checked(TIME, torques | {"brake": 0 * TIME}, accel_x=0.3))
    push = np.array([0.3 + 0.0981 + 0.4 * 144 / 1500])
    apart = (400 / 0.3 - 100 / 0.4) / 1500
    own = car.compute_slip(0, 0.5 * (push + apart), push)[0]
    other = car.compute_slip(1, 0.5 * (push - apart), push)[0]
    np.testing.assert_allclose(found.x[:, 0], (own - other)[0], rtol=1e-6)
    # the nonlinear part is that of both axles, besides the change of the radii
    bends = [car.compute_slip(k, 0.5 * (push + by * apart), push)[1][0] for k, by in ((0, 1), (1, -1))]
    np.testing.assert_allclose(found.x[:, 4], bends[0] - bends[1] - car.give * push[0], rtol=1e-6)


def test_noise_of_the_slip_is_that_of_the_mean_of_accel_x_over_600_ms() -> None:
    """60 rows of noise 0.2 m/s2 at 1500 kg and 100 kN. 10 %: scatter of 2000 rows."""
    noisy = 0.5 + 0.2 * np.random.default_rng(1).standard_normal(2000)
    found = slip._select_samples(make_car(), make_checked(TIME, accel_x=noisy))
    np.testing.assert_allclose(found.noise, 0.2**2 / 60 * (1500 / 1e5) ** 2, rtol=0.2)


@pytest.mark.parametrize(("driven", "stiffness"), [("front", 1e5), ("rear", 8e4)])
def test_noise_is_that_of_rows_with_speed_before_any_limit_and_of_the_axle_that_is_measured(
    driven: str, stiffness: float
) -> None:
    """Noise of 0.02 m/s2, below the limit of 0.05, at 12 m/s, and ten times as much at
    3 m/s. A mean over 0.6 s is one of 30 rows at 50 Hz. 20 %: scatter of 1500 rows."""
    time, slow = 0.02 * np.arange(3000), np.arange(3000) < 1500
    noisy = 0.5 + 0.02 * np.where(slow, 10.0, 1.0) * np.random.default_rng(2).standard_normal(3000)
    speed = {"wheel_speed_front": np.where(slow, 10.0, 40.0), "wheel_speed_rear": np.where(slow, 7.5, 30.0)}
    car = make_car(driven, imu_scale_ax_error=0.5)
    found = slip._select_samples(car, make_checked(time, accel_x=noisy, **speed))
    np.testing.assert_allclose(found.noise, 0.02**2 / 30 * (1500 / (1.5 * stiffness)) ** 2, rtol=0.2)


def test_the_noise_of_a_log_that_is_too_short_to_show_it_is_none() -> None:
    found = slip._select_samples(make_car(), make_checked(TIME[:20], accel_x=0.3))
    assert found.noise.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("shape", [0.0, 0.5, 1.0])
def test_slip_of_a_large_force_is_that_of_the_curve_of_the_tyre(shape: float) -> None:
    """Brush model: force/grip = 1 - (1 - s/3)^3; the other: s/(1 + s^2 + s^4)^(1/4), with
    the slip s of a linear tyre at the grip."""
    config = Config.exact(CAR | {SHAPE: shape})
    car = slip._Car(config, AT | {"tyre_saturation_inverse_friction": 1.25}, make_vehicle("front"))
    push = np.array([1.0, 1.0, 1.0, 1.0])
    for axle, stiffness, load in ((0, 1e5, 9.81 * 0.6), (1, 8e4, 9.81 * 0.4)):
        force = np.array([0.5, -1.0, 1.4, 2.0])
        found, bend, share = car.compute_slip(axle, force, push)
        s = np.abs(found) * stiffness / (1500 * 0.8 * load)
        brush, other = 1 - (1 - s / 3) ** 3, s / (1 + s**2 + s**4) ** 0.25
        np.testing.assert_allclose(share, (1 - shape) * brush + shape * other, rtol=1e-4)
        np.testing.assert_array_equal(np.sign(found), np.sign(force))
        np.testing.assert_allclose(bend, found - 1500 * force / stiffness)


def test_a_car_has_loads_curve_and_stiffness_of_its_axles() -> None:
    car = make_car("rear", longitudinal_stiffness_rear=7e4, imu_scale_ax_error=0.1, pitch_leak_gain=0.01)
    np.testing.assert_allclose(car.load, [9.81 * 1.5 / 2.5, 9.81 * 1.0 / 2.5])
    assert (car.height, car.base, car.driven) == (pytest.approx(0.2), 2.5, "rear")
    assert car.stiffness == (1e5, 7e4) and make_car().stiffness == (1e5, 8e4)
    # the load that moves, m a h/base, is the share h a/(g lr) in front, h a/(g lf) behind
    assert car.give == pytest.approx(0.005 * HEIGHT / 9.81 * (1 / 1.5 + 1 / 1.0))
    assert car.scale == pytest.approx(1.1 * (1 + 9.81 * 0.01))
    plain = slip._Car(CONFIG, AT, Vehicle(None, "car", {}, {}))
    assert plain.height == pytest.approx(get_ordinary_car(CONFIG)["cg_height"] / 2.5)
    assert plain.driven == "front" and plain.grip == get_ordinary_car(CONFIG)["grip"]
    known = slip._Car(CONFIG, AT | {"tyre_saturation_inverse_friction": 1.25}, make_vehicle("front"))
    assert known.grip == pytest.approx(0.8)


def test_slip_has_the_sign_of_the_force_and_a_share_of_the_grip_of_its_load() -> None:
    """Small forces: F/C. Load transfer acts on the share, not on the slip: stiffness and
    load are proportional."""
    car = make_car()
    force, push = np.array([0.01, -0.01, 0.01]), np.array([0.0, 0.0, 1.0])
    for axle, stiffness, load in ((0, 1e5, 9.81 * 0.6), (1, 8e4, 9.81 * 0.4)):
        found, bend, share = car.compute_slip(axle, force, push)
        loads = load + (-1 if axle == 0 else 1) * 0.2 * push
        np.testing.assert_allclose(found, 1500 * force / (stiffness * loads / load), rtol=0.01)
        np.testing.assert_allclose(share, 0.01 / (car.grip * loads))
        np.testing.assert_allclose(bend, found - 1500 * force / stiffness)
    # a load is at least a tenth of that at rest
    assert car.compute_slip(0, force[:1], np.array([99.0]))[2][0] == pytest.approx(0.01 / (car.grip * 0.5886))


# ---- the regression


def draw_samples(
    seed: int, b: np.ndarray, radius: float, blocks: int = 40, lasting: float = 0.0
) -> slip._Samples:
    """Draw 100 samples a block: slip = x b + radius + noise of 0.1/weight."""
    rng, n = np.random.default_rng(seed), 100 * blocks
    x, weight = rng.standard_normal((n, 5)) * [0.01, 0.05, 0.01, 0.001, 0.005], rng.uniform(5.0, 15.0, n)
    block = np.repeat(np.arange(blocks, dtype=float), 100)
    error = 0.01 * rng.standard_normal(n) / weight + lasting * rng.standard_normal(blocks).repeat(100)
    return slip._Samples(x, np.zeros(n), x @ b + radius + error, weight, block)


B = np.array([1.3, 0.004, -0.05, 0.08, 0.1])
PRIOR = np.array([*slip.PRIOR_SD, 0.01, 0.01])


def test_unknowns_of_all_logs_and_the_radius_of_each_are_found_with_their_sds() -> None:
    parts = [draw_samples(1, B, 0.004), draw_samples(2, B, -0.006)]
    found, sd = slip._solve(parts, PRIOR)
    truth = np.array([*B, 0.004, -0.006])
    assert (np.abs(found - truth) < 4 * sd).all()
    # white noise: weighted least squares with priors
    w = np.concatenate([p.weight for p in parts]) / 0.01
    x = np.vstack([np.column_stack([p.x, np.full(4000, 1.0 - n), np.full(4000, float(n))])
                   for n, p in enumerate(parts)])  # fmt: skip
    covariance = np.linalg.inv((x * w[:, None] ** 2).T @ x + np.diag(PRIOR**-2.0))
    np.testing.assert_allclose(sd, np.sqrt(np.diag(covariance)), rtol=0.4)
    assert (sd > 0.9 * np.sqrt(np.diag(covariance))).all()


def test_the_result_is_that_of_least_squares_with_weights_and_priors_where_no_error_is_large() -> None:
    """Errors of +- 0.01/weight, alternating: none is an outlier, none lasts. Weights of
    1 .. 16, and priors as sure as the log."""
    rng, n = np.random.default_rng(12), 4000
    weight = 2.0 ** rng.uniform(0.0, 4.0, n)
    x = rng.standard_normal((n, 5)) * [0.01, 0.05, 0.01, 0.001, 0.005]
    sign = np.where(np.arange(n) % 2, 1.0, -1.0) * np.where(rng.uniform(size=n // 2).repeat(2) < 0.5, 1, -1)
    part = slip._Samples(x, np.zeros(n), x @ B + 0.004 + 0.01 * sign / weight, weight, np.arange(n) // 50)
    prior = np.array([0.5, 0.002, 0.05, 0.1, 0.05, 0.0002])
    found, sd = slip._solve([part], prior)
    scaled = np.column_stack([x, np.ones(n)]) * (100 * weight)[:, None]
    whole, right = np.vstack([scaled, np.diag(1 / prior)]), np.append(part.slip * 100 * weight, np.zeros(6))
    np.testing.assert_allclose(found, np.linalg.lstsq(whole, right, rcond=None)[0], atol=0.03 * sd.min())
    covariance = np.linalg.inv(whole.T @ whole)
    assert (sd > 0.99 * np.sqrt(np.diag(covariance))).all()
    np.testing.assert_allclose(sd, np.sqrt(np.diag(covariance)), rtol=0.3)


@pytest.mark.parametrize(
    ("noise", "common", "known"), [(0.45, 0.0, True), (0.55, 0.0, False), (0.4, 0.5, False), (0.2, 0.5, True)]
)
def test_a_stiffness_is_unknown_if_noise_is_half_of_what_only_its_regressor_explains(
    noise: float, common: float, known: bool
) -> None:
    """`noise`: share of the variance of the slip. `common`: share of it that the second
    regressor explains."""
    p = draw_samples(8, B, 0.0)
    one, two = np.random.default_rng(9).standard_normal((2, len(p.slip)))
    p.x[:, 1] = 0.05 * one
    p.x[:, 0] = 0.01 * (np.sqrt(common) * one + np.sqrt(1 - common) * two)
    p = replace(p, noise=np.full(len(p.slip), noise * 1e-4))
    assert np.isfinite(slip._solve([p], PRIOR[:6])[1][0]) == known


def test_errors_that_last_a_block_make_the_sds_as_large_as_if_a_block_were_one_sample() -> None:
    """Errors of 0.005 in 40 blocks. The blocks of two logs are different ones."""
    parts = [draw_samples(3, B, 0.0, lasting=0.005), draw_samples(4, B, 0.0, lasting=0.005)]
    found, sd = slip._solve(parts, PRIOR)
    assert sd[5:] == pytest.approx(0.005 / np.sqrt(40), rel=0.3)
    assert (np.abs(found[5:]) < 4 * sd[5:]).all()
    apart = [parts[0], replace(parts[1], block=parts[1].block + 1000)]
    np.testing.assert_allclose(slip._solve(apart, PRIOR)[1], sd)
    # a prior as sure as the log halves what it shows
    strong = np.array([*slip.PRIOR_SD, 0.005 / np.sqrt(40)])
    assert slip._solve([draw_samples(3, B, 0.006, lasting=0.005)], strong)[0][5] == pytest.approx(
        0.003, rel=0.3
    )


def test_noise_of_the_first_regressor_does_not_make_its_coefficient_small() -> None:
    """Noise of half of the slip: without correction the coefficient is 20 % too small.
    8 %: Huber weights are lower where the noise is large. Where noise is most of the
    slip, the stiffness is unknown."""
    p = draw_samples(5, B, 0.0, blocks=200)
    rng = np.random.default_rng(6)

    def blur(by: float) -> slip._Samples:
        x = p.x.copy()
        x[:, 0] += by * rng.standard_normal(len(x))
        return slip._Samples(x, np.full(len(x), by**2), p.slip, p.weight, p.block)

    found, sd = slip._solve([blur(0.005)], PRIOR[:6])
    assert found[0] == pytest.approx(1.3, rel=0.08) and sd[0] < 0.02
    assert slip._solve([blur(0.02)], PRIOR[:6])[1][0] == np.inf


def test_outliers_hardly_move_the_result() -> None:
    p = draw_samples(7, B, 0.0)
    p.slip[::50] += 0.5
    found, _ = slip._solve([p], PRIOR[:6])
    assert found[0] == pytest.approx(1.3, rel=0.02) and abs(found[5]) < 0.001


def test_many_outliers_on_one_side_lose_their_influence_from_step_to_step() -> None:
    """One in ten is off by 0.5: a mean is off by 0.05."""
    p = draw_samples(10, B, 0.0)
    p.slip[::10] += 0.5
    found, _ = slip._solve([p], PRIOR[:6])
    assert abs(found[5]) < 0.002 and found[0] == pytest.approx(1.3, rel=0.05)


def test_errors_that_are_large_where_a_regressor_is_make_its_sd_larger_beside_its_prior() -> None:
    """40 blocks of 20 samples, of which each has a single error: 1 e-3 where the
    regressor is 1, in 24 blocks, 1.9 e-3 where it is 2. A prior as sure as the log."""
    size, sign = np.repeat([1.0, 2.0], [24, 16]), np.tile([1.0, -1.0], 20)
    error = 1e-3 * np.where(size > 1, 1.9, 1.0) * sign
    x = np.zeros((800, 5))
    x[:, 1] = size.repeat(20)
    part = slip._Samples(x, np.zeros(800), error.repeat(20), np.ones(800), np.arange(40).repeat(20))
    shown = np.sum(size**2) / np.mean(error**2)  # blocks count as one sample
    scores = np.sum((size * error / np.mean(error**2)) ** 2)
    prior = np.array([1e3, shown**-0.5, 0.1, 0.1, 0.25, 1e-9])
    found, sd = slip._solve([part], prior)
    assert found[1] == pytest.approx(0.0, abs=1e-9)
    assert sd[1] == pytest.approx(np.sqrt(scores + shown) / (2 * shown), rel=1e-3)
    assert sd[1] > 1.05 * (2 * shown) ** -0.5


def run(monkeypatch, driven: str, b0_sd: float = 0.1, blocks: tuple[int, int] = (3, 3), follows: float = 1.0):
    """Run the regression with a result of _solve() that is given: radii of two logs of 30
    and 10 samples a block are off by 2 and -1 %."""
    parts = [SimpleNamespace(block=np.repeat(np.arange(n), m), slip=np.zeros(n * m))
             for n, m in zip(blocks, (30, 10), strict=True)]  # fmt: skip
    left = iter([parts[0], None, parts[1]])
    monkeypatch.setattr(slip, "_select_samples", lambda car, log: next(left))
    seen: list[np.ndarray] = []

    def solve(got, prior_sd):
        assert got == parts
        seen.append(prior_sd)
        sd = np.array([b0_sd, 0.001, 1, 1, 1, 1, 1])
        return np.array([1.25, -0.004, 0, 0, 0, 0.02, -0.01]), sd

    monkeypatch.setattr(slip, "_solve", solve)
    config = Config.exact(CAR | {"rear_longitudinal_follows_front": follows})
    found = slip._run_regression(config, AT, [None, None, None], make_vehicle(driven))
    if seen:
        np.testing.assert_array_equal(seen[0], [1e3, 0.006, 0.1, 0.1, 0.25, 0.01, 0.01])
    return found


@pytest.mark.parametrize(("driven", "sign"), [("front", 1), ("rear", -1)])
def test_stiffness_latency_and_radii_follow_from_the_slip_of_the_driven_axle(
    monkeypatch, driven, sign
) -> None:
    """Slip 1/1.25 of the file's, driven wheels 4 ms late and 1.25 % too fast on average
    over the samples."""
    found = run(monkeypatch, driven)
    assert found.stiffness == pytest.approx(np.log(1.0125 / 1.25))
    assert found.stiffness_sd == pytest.approx(0.1 / 1.25)
    assert (found.later, found.later_sd) == (pytest.approx(0.004 * sign), 0.001)
    assert 1 + found.mismatch == pytest.approx(1.0125**sign)


def test_without_slip_blocks_or_a_common_stiffness_there_is_no_result(monkeypatch) -> None:
    assert run(monkeypatch, "front", blocks=(3, 3)) is not None  # six blocks
    assert run(monkeypatch, "front", blocks=(3, 2)) is None
    assert run(monkeypatch, "front", b0_sd=1.25 / 2.9) is None  # less than three sd
    assert run(monkeypatch, "front", b0_sd=1.25 / 3.1) is not None
    assert run(monkeypatch, "front", b0_sd=np.inf) is None
    assert run(monkeypatch, "rear", follows=0.5) is None  # cx_front is that of the free axle
    assert run(monkeypatch, "both", follows=0.5) is None
    assert run(monkeypatch, "front", follows=0.5) is not None


def test_the_posterior_of_the_stiffness_has_the_error_of_the_model_and_the_prior() -> None:
    assert slip._combine_with_prior(None, 0.3, 0.04) == (0.3, 0.04)
    found = slip._SlipFinding(0.5, 0.12, 0.0, 1.0, 0.0)
    mean, var = slip._combine_with_prior(found, 0.1, 0.04)
    weight = 1 / (0.12**2 + 0.05**2)  # sd 0.13
    assert var == pytest.approx(1 / (weight + 25)) and mean == pytest.approx((0.5 * weight + 2.5) * var)


def test_the_stiffness_without_a_log_is_the_prior_and_with_one_what_the_fit_has_is_used(monkeypatch) -> None:
    vehicle = make_default_vehicle()
    vehicle.calibration = {"names": ["cx_front"], "mean": [0.2], "covariance": [[0.09]]}
    config = Config.exact({SHAPE: 1.0})
    assert slip.estimate_longitudinal(config, {}, [], vehicle) == pytest.approx((0.2, 0.3))
    seen: list[dict] = []

    def regress(config, at, logs, vehicle):
        seen.append(at)
        return slip._SlipFinding(0.5, 0.12, 0.0, 1.0, 0.0)

    monkeypatch.setattr(slip, "_run_regression", regress)
    values = {"aero_drag_coefficient": 0.7, "nobody": 3.0, "mass": 9.0}
    mean, sd = slip.estimate_longitudinal(config, values, [None], vehicle)
    expected = slip._combine_with_prior(slip._SlipFinding(0.5, 0.12, 0.0, 1.0, 0.0), 0.2, 0.09)
    assert (mean, sd**2) == pytest.approx(expected)
    prior = unknowns.make_prior(vehicle, config)
    assert seen[0] == dict(zip(prior.names, prior.mean, strict=True)) | {"aero_drag_coefficient": 0.7}


# ---- what is applied and reported


def make_found(x: list[float], sd: float = 0.1) -> tuple[SimpleNamespace, CarFit]:
    """Return problem and fit of latencies and radii of both axles, and the stiffness."""
    names = ["wheel_speed_front_latency", "wheel_speed_rear_latency", "cx_front", "wheel_radius_front",
             "wheel_radius_rear"]  # fmt: skip
    problem = SimpleNamespace(
        names=names, config=CONFIG, mean=np.array([0.01, 0.02, 0.0, 0.3, 0.4]), sd=np.full(5, 0.5)
    )
    return problem, CarFit(
        np.array(x), np.zeros(0), np.diag([1, 1, sd**2, 1, 1]), None, {}, [], ([], []), None
    )


def test_radii_get_the_ratio_that_was_found_and_keep_their_product() -> None:
    """The ratio is against that of the file, whatever the fit has made of it."""
    for radii, mismatch in (((0.3, 0.4), 0.02), ((0.303, 0.396), -0.03), ((0.29, 0.41), 0.0)):
        front, rear = slip._apply_mismatch(CONFIG, np.array(radii), mismatch)
        assert rear / front == pytest.approx((1 + mismatch) * 0.4 / 0.3)
        assert rear * front == pytest.approx(radii[0] * radii[1])


@pytest.mark.parametrize(
    ("x", "words"),
    [
        ([0.01, 0.02, 0.0, 0.3, 0.4], []),
        ([0.013, 0.017, 0.0, 0.3, 0.4], ["the front axle is 6.0 ms later"]),
        ([0.008, 0.022, 0.0, 0.3, 0.4], ["the rear axle is 4.0 ms later"]),
        ([0.01, 0.02, 0.0, 0.3, 0.4036], []),  # 0.9 %
        ([0.01, 0.02, 0.0, 0.297, 0.404], ["rear / front is 2.0 % larger than in the vehicle file"]),
        ([0.01, 0.02, 0.0, 0.306, 0.396], ["rear / front is 2.9 % smaller than in the vehicle file"]),
    ],
)
def test_latencies_of_the_axles_and_a_ratio_of_the_radii_are_reported(x, words) -> None:
    problem, fit = make_found(x)
    found = slip.describe_slip(problem, fit)
    assert len(found) == len(words) and all(w in f for w, f in zip(words, found, strict=True))
    delayed = x[0] != 0.01
    comments = slip.describe_wheel_latencies(problem, fit)
    assert set(comments) == ({"wheel_speed_front_latency", "wheel_speed_rear_latency"} if delayed else set())


@pytest.mark.parametrize(("sd", "shown"), [(0.34, True), (0.36, False), (np.nan, False)])
def test_a_stiffness_that_the_logs_do_not_determine_is_reported(sd: float, shown: bool) -> None:
    """Limit: 0.7 of the prior sd of 0.5."""
    found = slip.describe_slip(*make_found([0.01, 0.02, 0.0, 0.3, 0.4], sd))
    assert [f.startswith("longitudinal stiffness: not shown") for f in found] == ([] if shown else [True])


@pytest.mark.parametrize(
    ("finding", "latencies", "ratio"),
    [
        (slip._SlipFinding(0.2, 0.1, 0.006, 0.0019, 0.0099), (0.013, 0.017), 1.0),
        (slip._SlipFinding(0.2, 0.1, -0.006, 0.0021, -0.0101), (0.01, 0.02), 0.9899),
        (slip._SlipFinding(0.2, 0.1, -0.006, 0.0019, 0.0101), (0.007, 0.023), 1.0101),
    ],
)
def test_a_latency_is_applied_from_three_sd_on_and_a_mismatch_from_1_percent(
    monkeypatch, finding, latencies, ratio
) -> None:
    problem, fit = make_found([0.5, 0.6, 0.7, 0.3, 0.4])
    problem.covariance = np.diag([0.01, 0.01, 0.25, 1, 1])
    problem.covariance[0, 1] = problem.covariance[1, 0] = 0.008
    full = np.full((5, 5), 0.001) + np.diag(np.full(5, 0.01))
    fit = CarFit(fit.x, fit.z, full, None, {}, [], ([], []), None)
    monkeypatch.setattr(slip, "_run_regression", lambda *_: finding)
    found = slip.apply_slip_regression(problem, fit, [], make_vehicle("front"))
    np.testing.assert_allclose(found.x[:2], latencies)
    assert found.x[4] / found.x[3] * 0.75 == pytest.approx(ratio)
    expected = full.copy()
    expected[:3, :] = expected[:, :3] = 0.0
    expected[:2, :2] = problem.covariance[:2, :2]
    found_mean, expected[2, 2] = slip._combine_with_prior(finding, 0.0, 0.25)
    assert found.x[2] == found_mean
    np.testing.assert_allclose(found.covariance, expected)
    assert fit.x[0] == 0.5 and fit.covariance[0, 2] == 0.001  # the search is kept as it was
