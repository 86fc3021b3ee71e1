"""A disturbance that enters at a known place is located there.

The residuals are made by scipy's matrix exponential of a separate linear single-track
model, not by the filter that looks for them.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter

from gap_logs import STIFFNESS, make_problem, write_car, write_log
from tse.gaps.fit import fit_parameters
from tse.gaps.infer import where
from tse.gaps.infer.remainder import is_noise, remove_spikes, remove_walk
from tse.gaps.problem import STIFFNESS_PARAMETERS as PARAMETERS
from tse.identify.data import BLOCK_TIME
from tse.library.core import Config

STEP = 0.04  # s, a block


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """Two logs of the car as the vehicle file says, and their fit_parameters."""
    folder = tmp_path_factory.mktemp("where")
    vehicle = write_car(folder)
    paths = [
        write_log(folder / f"{d}.csv", vehicle, d, {}, seed) for seed, d in enumerate(("sweep", "steps"), 31)
    ]
    problem = make_problem(vehicle, *paths)
    return problem, fit_parameters(problem, PARAMETERS, {})


def draw_drift(n: int, tau: float, rng: np.random.Generator) -> np.ndarray:
    """Draw an Ornstein-Uhlenbeck process of unit variance."""
    x, keep = np.zeros(n), np.exp(-STEP / tau)
    for k in range(1, n):
        x[k] = keep * x[k - 1] + np.sqrt(1 - keep**2) * rng.standard_normal()
    return x


def compute_response(
    config: Config, speed: float, place: str, d: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the change of lateral acceleration and yaw rate by a disturbance.

    The disturbance is in N, N m, m/s2 or rad/s. The stiffness is that of the logs.
    """
    if place == "sensor accel_y":
        return d, np.zeros_like(d)
    if place == "sensor yaw_rate":
        return np.zeros_like(d), d
    m, inertia = config.mass, config.yaw_inertia
    cf = config.cornering_stiffness_front * STIFFNESS["cy_front"]
    cr = config.cornering_stiffness_rear * STIFFNESS["cy_rear"]
    a, b = config.lf, config.lr
    matrix = np.array([
        [-(cf + cr) / (m * speed), -(a * cf - b * cr) / (m * speed) - speed],
        [-(a * cf - b * cr) / (inertia * speed), -(a**2 * cf + b**2 * cr) / (inertia * speed)],
    ])  # fmt: skip
    push = {
        "front axle": (1 / m, a / inertia), "rear axle": (1 / m, -b / inertia), "side force": (1 / m, 0.0),
        "yaw moment": (0.0, 1 / inertia), "road (bank)": (1.0, 0.0),
    }[place]  # fmt: skip
    whole = np.zeros((3, 3))
    whole[:2, :2], whole[:2, 2] = matrix, push
    f = expm(whole * STEP)
    x, ay, r = np.zeros(2), [], []
    for value in d:
        force = (
            value / m if place in ("front axle", "rear axle", "side force") else 0.0
        )  # an accelerometer feels no gravity
        ay.append(matrix[0] @ x + speed * x[1] + force)
        r.append(x[1])
        x = f[:2, :2] @ x + f[:2, 2] * value
    return np.array(ay), np.array(r)


def make_disturbed(clean, place: str, size: float, make) -> list[where.Entry]:
    """Return entries for residuals of noise, a wrong stiffness and a disturbance."""
    problem, baseline = clean
    rng = np.random.default_rng(7)
    residuals = rng.standard_normal(len(baseline.residuals)) + baseline.jacobian @ [0.02, -0.03, 0.02]
    speed = problem.average_quantity("wheel_speed_front") * problem.config.wheel_radius_front
    for i in range(len(problem.logs)):
        ay_rows = (problem.rows.log == i) & problem.rows.of("accel_y")
        r_rows = (problem.rows.log == i) & problem.rows.of("yaw_rate")
        ay, r = compute_response(
            problem.config, float(speed[ay_rows].mean()), place, size * make(i, int(ay_rows.sum()), rng)
        )
        residuals[ay_rows] += problem.weight[ay_rows] * ay
        residuals[r_rows] += problem.weight[r_rows] * r
    return where.find_entries(problem, replace(baseline, residuals=residuals))


@pytest.mark.parametrize(("place", "size"), [
    ("front axle", 300.0), ("rear axle", 300.0), ("side force", 400.0), ("yaw moment", 600.0),
    ("road (bank)", 0.3), ("sensor accel_y", 0.2), ("sensor yaw_rate", 0.01),
])  # fmt: skip
def test_disturbance_is_found_where_it_enters(clean, place, size):
    found = make_disturbed(clean, place, size, lambda i, n, rng: draw_drift(n, 0.6, rng))
    assert found[0].place == place
    assert found[0].nats > found[1].nats + 8  # as a name needs it
    c = clean[0].config
    unit = {
        "front axle": STIFFNESS["cy_front"] * c.cornering_stiffness_front,
        "rear axle": STIFFNESS["cy_rear"] * c.cornering_stiffness_rear,
        "side force": c.mass,
        "yaw moment": c.yaw_inertia,
    }.get(place, 1.0)  # of a formula's places
    assert size / 3 < found[0].size * unit < size * 3


def test_what_follows_the_steering_is_not_the_road(clean):
    """With a rolling body the accelerometer leans with the car's own turning.

    A bank of the road does not.
    """
    problem, baseline = clean
    turning = problem.simulate_channels(baseline.values, ("accel_y",))["accel_y"]

    def roll(i, n, rng):
        ay = turning[(problem.rows.log == i) & problem.rows.of("accel_y")]
        return np.convolve(ay, np.exp(-np.arange(20) * STEP / 0.1) * (1 - np.exp(-STEP / 0.1)))[:n]

    found = make_disturbed(clean, "sensor accel_y", 0.1, roll)
    assert found[0].place == "sensor accel_y" and found[-1].place == "road (bank)"


def test_nothing_gives_no_entry_evidence(clean):
    problem, baseline = clean
    assert max(e.nats for e in where.find_entries(problem, baseline)) < 8


# ---- the remainder


LOG = np.repeat(np.arange(4), 750)  # four logs of 30 s


def draw_white(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(len(LOG))


def filter_low_pass(x: np.ndarray, seconds: float) -> np.ndarray:
    a = np.exp(-BLOCK_TIME / seconds)
    return lfilter([np.sqrt(1 - a * a)], [1.0, -a], x)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("seconds", [0.001, 0.02, 0.03])
def test_noise_behind_the_low_pass_of_a_sensor_is_noise(seconds: float, seed: int) -> None:
    assert is_noise(1.7 * filter_low_pass(draw_white(seed), seconds), LOG)


@pytest.mark.parametrize("seed", range(5))
def test_what_lasts_swings_or_comes_and_goes_is_not(seed: int) -> None:
    t = BLOCK_TIME * np.arange(len(LOG))
    assert not is_noise(draw_white(seed) + filter_low_pass(draw_white(seed + 100), 0.3), LOG)  # gusts
    assert not is_noise(draw_white(seed) + 1.2 * np.sin(2 * np.pi * 5.5 * t), LOG)  # an axle
    assert not is_noise(
        draw_white(seed) * np.where(np.sin(0.4 * t) > 0.5, 3.0, 1.0), LOG
    )  # where something is done


@pytest.mark.parametrize("seed", range(5))
def test_a_walk_of_the_bias_is_taken_out_and_little_else(seed: int) -> None:
    step = 0.05
    walk = np.concatenate([np.cumsum(step * draw_white(seed + 10 + i)[:750]) for i in range(4)])
    rest = remove_walk(draw_white(seed) + walk, LOG, step)
    assert np.sqrt(np.mean(rest**2)) < 1.05
    swing = np.sin(2 * np.pi * 0.5 * BLOCK_TIME * np.arange(len(LOG)))
    assert np.sqrt(np.mean(remove_walk(swing, LOG, step) ** 2)) > 0.85 * np.sqrt(np.mean(swing**2))


def test_a_bias_that_stays_is_no_walk() -> None:
    np.testing.assert_array_equal(remove_walk(draw_white(1), LOG, 0.0), draw_white(1))


def test_lone_spikes_go_and_what_lasts_two_blocks_stays() -> None:
    x = draw_white(3)
    spiked = x.copy()
    spiked[[100, 800, 1600]] += 15.0
    spiked[2000:2003] += 15.0
    rest = remove_spikes(spiked, LOG)
    assert np.abs(rest[[100, 800, 1600]]).max() < 3.0
    np.testing.assert_array_equal(rest[2000:2003], spiked[2000:2003])
    assert np.mean(rest != spiked) < 0.005
