"""The engine of calibration, against drawn processes, definitions, and its own
simulator."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.linalg import toeplitz
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.sparse import csc_matrix

from tse.car.vehicle import make_default_vehicle, read_vehicle
from tse.channels.log import read_log
from tse.identify import advice
from tse.identify.data import (
    PreparedLog,
    compute_curve_accel,
    compute_speed,
    group_blocks,
    prepare,
    remove_latencies,
    simulate,
    smooth_values,
)
from tse.identify.fit import (
    HUBER,
    MIN_GAIN_NATS,
    MODEL_TIME,
    CarFit,
    NormalEquations,
    ResidualScale,
    build_normal,
    compute_cost,
    compute_covariance,
    compute_step,
    fit,
    measure_scales,
)
from tse.identify.knots import Knots
from tse.identify.lasting import Piece, measure_lasting
from tse.identify.problem import SPEED_TIME, CarProblem, convert_velocities
from tse.identify.unknowns import COMMON_SD, STIFFNESS, UNKNOWNS, make_prior
from tse.library.core import Config, Replay, SimConfig, Simulator
from tse.library.errors import UserError
from tse.log.rows import SlowChannel

DT = 0.01
LATE = {
    "steer_angle": -0.024,
    "wheel_speed_front": 0.013,
    "wheel_speed_rear": 0.013,
    "accel_x": 0.006,
    "accel_y": 0.006,
}
HIDDEN = {
    "steering_offset_angle": 0.004,
    "body_roll_gain": 0.009,
    "relaxation_length": 0.5,
    "imu_lever_arm_x": 0.4,
}
STIFF = {"cx_front": 0.9, "cy_front": 1.1, "cy_rear": 0.95}
QUIET = {"accel_x_sd": 0.03, "accel_y_sd": 0.03, "yaw_rate_sd": 0.001}


def make_drive_rows(
    seed: int,
    seconds: float = 40.0,
    late: dict[str, float] | None = None,
    hidden: dict[str, float] | None = None,
    steer: Callable[[np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Return rows of a drive with steering sweeps, driving and braking, of a car with
    effects.

    Late channels are interpolated linearly. `steer`: another steering angle, at a steady
    speed.
    """
    n = round(seconds / DT)
    settings = {f"true_{k}": v for k, v in STIFF.items()} | {f"spread_{k}": 0.0 for k in STIFF}
    simulator = Simulator(
        Config.exact(QUIET | (hidden or {})), SimConfig({"seed": seed, "speed": 18.0} | settings)
    )
    inputs, outputs = simulator.inputs(n), simulator.outputs(n)
    t = DT * np.arange(n)
    inputs["dt"], inputs["road_level"] = DT, 1.0
    inputs["steer_angle"] = (
        0.025 * np.sin(2 * np.pi * 0.3 * t + 4 * np.sin(0.2 * t + seed)) * (1 + 0.5 * np.sin(0.11 * t))
    )
    torque = 500 * np.tanh(4 * np.sin(0.9 * t + seed)) - 60
    if steer is not None:
        inputs["steer_angle"], torque = steer(t), np.zeros(n)
    inputs["wheel_torque_front"], inputs["brake_torque_rear"] = torque, np.where(torque < 0, 150.0, 0.0)
    for i in range(n):
        simulator.step_into(inputs, outputs, i)
    rows = {
        k: outputs[k].copy()
        for k in ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")
    }
    for k, by in (late or {}).items():
        rows[k] = np.interp(t - by, t, rows[k])
    return np.rec.fromarrays([t, *rows.values()], names=["time", *rows])


def write_rows(path: Path, rows: np.ndarray) -> Path:
    names = rows.dtype.names
    np.savetxt(
        path,
        np.column_stack([rows[n] for n in names]),
        delimiter=",",
        header=",".join(names),
        comments="",
        fmt="%.9g",
    )
    return path


def prepare_logs(folder: Path, config: Config, count: int = 2, **how: dict[str, float]) -> list[PreparedLog]:
    return [
        prepare(read_log(write_rows(folder / f"log{i}.csv", make_drive_rows(i + 1, **how))), config)
        for i in range(count)
    ]


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[CarProblem, CarFit]:
    """Fit two logs of 40 s."""
    config = Config.exact(QUIET)
    logs = prepare_logs(tmp_path_factory.mktemp("logs"), config, late=LATE, hidden=HIDDEN)
    problem = CarProblem(logs, config, make_prior(make_default_vehicle(), config), 2)
    return problem, fit(problem)


# ---- slow part of residuals


def draw_pieces(seed: int, covariance: Callable[[np.ndarray], np.ndarray], count: int = 40) -> list[Piece]:
    """Draw residuals of 100 s each, with this autocovariance over a lag [s]."""
    time = 0.04 * np.arange(2500)
    root = np.linalg.cholesky(toeplitz(covariance(time)) + 1e-9 * np.eye(len(time)))
    rng = np.random.default_rng(seed)
    return [Piece(time, np.ones(len(time)), root @ rng.standard_normal(len(time))) for _ in range(count)]


def make_autocovariance(size: float, time: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda t: size**2 * np.exp(-t / time) * (np.cos(t / time) + np.sin(t / time))


@pytest.mark.parametrize("time", [0.3, 1.2])
def test_the_power_of_what_lasts_is_the_integral_of_its_autocovariance(time: float) -> None:
    """size^2 x time. 10 %: scatter of 4,000 s, and the means of 100 s that are
    removed."""
    pieces = draw_pieces(4, lambda t: 0.25 * np.exp(-t / time))
    assert measure_lasting(pieces).power == pytest.approx(0.25 * time, rel=0.1)
    noise = [
        replace(p, residual=0.5 * np.random.default_rng(k).standard_normal(len(p.time)))
        for k, p in enumerate(pieces)
    ]
    assert measure_lasting(noise).power == pytest.approx(0.25 * 0.02, rel=0.2)  # half a step
    assert (
        measure_lasting(noise).walk
        < 0.3 * measure_lasting(draw_pieces(5, make_autocovariance(0.5, 3.0), 5)).walk
    )


@pytest.mark.parametrize("time", [2.0, 4.0])
def test_a_walk_is_the_smallest_with_no_less_than_hills_at_any_frequency(time: float) -> None:
    """Compare spectra: walk^2/w^2, and the transform of the covariance of hills, by a
    sum.

    15 %: scatter of 4,000 s.
    """
    lags, of = 0.02 * np.arange(8000), make_autocovariance(0.5, time)
    frequency = np.geomspace(0.01, 3.0, 400)
    spectrum = 0.02 * (2 * np.cos(np.outer(frequency, lags)) @ of(lags) - of(lags[:1]))
    walk = measure_lasting(draw_pieces(6, of)).walk
    assert walk == pytest.approx(np.sqrt((spectrum * frequency**2).max()), rel=0.15)


def test_nothing_is_counted_over_a_gap() -> None:
    """A step between two stretches adds no walk."""
    rng, time = np.random.default_rng(7), np.append(0.04 * np.arange(1000), 60.0 + 0.04 * np.arange(1000))
    p = Piece(time, np.ones(2000), 0.1 * rng.standard_normal(2000) + 3.0 * (time > 50.0))
    assert measure_lasting([p]).walk < 0.05


# ---- unknowns


def test_every_unknown_is_a_setting_within_its_range_and_has_a_prior_inside() -> None:
    fields = Config.exact().fields
    for u in UNKNOWNS:
        if u.name in fields and not u.relative:
            assert fields[u.name].low <= u.low <= u.mean <= u.high <= fields[u.name].high, u.name
        assert u.sd > 0


def test_the_prior_is_around_what_the_vehicle_file_tells_and_messages_are_late_together() -> None:
    vehicle = make_default_vehicle()
    vehicle.values["relaxation_length"] = 0.9
    config = Config.exact(vehicle.values)
    prior = make_prior(vehicle, config)
    at = prior.names.index
    assert prior.mean[at("relaxation_length")] == 0.9
    assert prior.mean[at("yaw_inertia")] == config.yaw_inertia
    front, rear = at("wheel_speed_front_latency"), at("wheel_speed_rear_latency")
    assert prior.covariance[front, rear] == pytest.approx(COMMON_SD["wheels"] ** 2)
    assert prior.covariance[front, front] + prior.covariance[rear, rear] - 2 * prior.covariance[
        front, rear
    ] == pytest.approx(2 * 0.0005**2)
    assert np.linalg.eigvalsh(prior.covariance / np.outer(prior.sd, prior.sd))[0] > 0


def test_what_the_file_says_of_an_uncertainty_is_the_prior_of_that_number() -> None:
    vehicle = make_default_vehicle()
    prior = make_prior(vehicle, Config.exact(vehicle.values))
    vehicle.values |= {"cg_sd": 0.05, "yaw_inertia_sd": 0.02, "steer_ratio_sd": 0.0, "relaxation_sd": 0.3}
    vehicle.given_uncertainty = ["cg_sd", "yaw_inertia_sd", "steer_ratio_sd"]
    config = Config.exact(vehicle.values)
    stated = make_prior(vehicle, config)
    at = prior.names.index
    assert stated.sd[at("cg_shift_distance")] == pytest.approx(0.05)
    assert stated.sd[at("yaw_inertia")] == pytest.approx(0.02 * config.yaw_inertia)
    assert 0 < stated.sd[at("steering_ratio_change")] < 1e-3  # known exactly: the sd stays positive
    # filled in by rule, not stated
    assert stated.sd[at("relaxation_length")] == prior.sd[at("relaxation_length")]


def test_an_earlier_calibration_is_the_prior_of_the_next(found: tuple[CarProblem, CarFit]) -> None:
    problem, first = found
    n = problem.car
    vehicle = make_default_vehicle()
    vehicle.calibration = {
        "names": list(problem.prior.names),
        "mean": first.x[:n].tolist(),
        "covariance": first.covariance[:n, :n].tolist(),
    }
    prior = make_prior(vehicle, Config.exact())
    np.testing.assert_allclose(prior.mean, first.x[:n])
    np.testing.assert_allclose(prior.covariance, first.covariance[:n, :n])


# ---- problem


def test_a_latency_moves_the_simulation_by_itself(found: tuple[CarProblem, CarFit]) -> None:
    problem, _ = found
    x = problem.mean.copy()
    x[problem.names.index("accel_y_latency")] = 0.03
    level = np.zeros(problem.knots)
    log, before, after = (
        problem.logs[0],
        *(problem.simulate(0, at, level)["accel_y"] for at in (problem.mean, x)),
    )
    rows = slice(log.stretches[0].first + 50, log.stretches[0].last - 50)
    # 30 ms are three rows
    np.testing.assert_allclose(after[rows], before[rows.start - 3 : rows.stop - 3], atol=1e-9)
    x = problem.mean.copy()
    x[problem.names.index("steer_angle_latency")] = 0.03
    early = problem.simulate(0, x, level)  # a late log is read later, so the car reacts earlier
    rows = slice(log.stretches[0].first + 300, log.stretches[0].last - 50)
    usual = problem.simulate(0, problem.mean, level)["yaw_rate"]
    apart = [
        float(np.mean((early["yaw_rate"][rows] - usual[rows.start + k : rows.stop + k]) ** 2))
        for k in range(7)
    ]
    assert int(np.argmin(apart)) == 3


def test_a_channel_is_simulated_as_late_as_the_vehicle_file_says(tmp_path: Path) -> None:
    """A latency of the search adds to it; both move that channel alone."""
    config = Config.exact(QUIET | {"accel_y_latency": 0.03})
    plain = prepare_logs(tmp_path, config, 1)[0]
    late = remove_latencies(plain, config)
    names = ("accel_y", "yaw_rate")
    before = simulate(config, plain, names, {}, {})
    rows = slice(late.stretches[0].first + 50, late.stretches[0].last - 50)
    for more, behind in (({}, 3), ({"accel_y": 0.02}, 5)):  # rows of DT
        after = simulate(config, late, names, {}, {}, more)
        moved = before["accel_y"][rows.start - behind : rows.stop - behind]
        # latencies are whole rows: nothing but the rounding of times is left
        np.testing.assert_allclose(after["accel_y"][rows], moved, atol=1e-9)
        np.testing.assert_array_equal(after["yaw_rate"], before["yaw_rate"])


def test_slopes_are_differences_of_the_residuals(found: tuple[CarProblem, CarFit]) -> None:
    problem, first = found
    base, x = problem.compute_residuals(first.search, first.z), first.search
    slopes = problem.compute_slopes(x, first.z, base)
    for name in (
        "cy_rear",
        "superelevation@1",
        "relaxation_length",
        "wheel_speed_front_latency",
        "yaw_rate~1",
        "accel_x~0",
    ):
        k = problem.names.index(name)
        h = 0.01 * problem.sd[k]
        there, back = x.copy(), x.copy()
        there[k] += h
        back[k] -= h
        for a, b, s in zip(
            problem.compute_residuals(there, first.z),
            problem.compute_residuals(back, first.z),
            slopes,
            strict=True,
        ):
            expected = (a - b) / (2 * h)
            np.testing.assert_allclose(
                s[:, k], expected, atol=0.03 * max(float(np.max(np.abs(expected))), 1e-9), err_msg=name
            )


def test_slopes_of_the_road_are_those_of_one_value_after_the_other(found: tuple[CarProblem, CarFit]) -> None:
    """Compare single knots with knots moved together: a car forgets a knot before the
    next."""
    problem, first = found
    x, z = first.search, first.z
    base = problem.compute_residuals(x, z)
    together = problem.compute_road_slopes(x, z, base)
    for profile in ("bank", "grade"):
        for k in range(
            problem.road.get_slice(1, profile).start + 2, problem.road.get_slice(1, profile).stop, 4
        ):
            moved = z.copy()
            moved[k] += 0.01
            for g, after in enumerate(problem.compute_residuals(x, moved)):
                expected = (after - base[g]) / 0.01
                scale = max(float(np.max(np.abs(expected))), 1e-6)
                np.testing.assert_allclose(together[g][:, k].toarray()[:, 0], expected, atol=0.02 * scale)


def test_stiffness_is_searched_as_compliance_and_its_prior_goes_with_it(
    found: tuple[CarProblem, CarFit],
) -> None:
    problem, first = found
    k = problem.names.index("cy_front")
    assert problem.mean[k] == pytest.approx(np.exp(-problem.prior.mean[k]))
    assert problem.sd[k] == pytest.approx(problem.prior.sd[k] * problem.mean[k])
    assert first.search[k] == pytest.approx(np.exp(-first.x[k]))
    np.testing.assert_allclose(problem.to_search(problem.to_ln(first.search)), first.search, rtol=1e-12)
    other = problem.names.index("relaxation_length")
    assert first.search[other] == first.x[other] and problem.mean[other] == problem.prior.mean[other]
    sd = np.sqrt(np.linalg.inv(first.equations.information)[k, k]) / first.search[k]
    assert np.sqrt(first.covariance[k, k]) == pytest.approx(sd)


def test_the_lean_of_roads_that_the_file_tells_is_where_each_log_starts_and_does_not_count_twice(
    tmp_path: Path,
) -> None:
    log = prepare(read_log(write_rows(tmp_path / "log.csv", make_drive_rows(1, 20.0))), Config.exact(QUIET))
    told = Config.exact(QUIET | {"bank_superelevation": 0.2})
    other, plain = (
        CarProblem([log], c, make_prior(make_default_vehicle(), c)) for c in (told, Config.exact(QUIET))
    )
    at = plain.names.index("superelevation@0")
    assert other.mean[at] == 0.2 and plain.mean[at] == pytest.approx(0.12)
    x = plain.mean.copy()
    x[at] = 0.2
    level = np.zeros(plain.knots)
    for channel, value in plain.simulate(0, x, level).items():
        np.testing.assert_array_equal(other.simulate(0, x, level)[channel], value)


def test_late_wheels_are_asked_of_accel_x_alone(found: tuple[CarProblem, CarFit]) -> None:
    problem, first = found
    x = first.search.copy()
    for name in ("wheel_speed_front_latency", "wheel_speed_rear_latency"):
        x[problem.names.index(name)] += 0.05
    before, after = problem.simulate(0, first.search, first.z), problem.simulate(0, x, first.z)
    for channel in ("accel_y", "yaw_rate"):
        # the mean of two latencies is rounded
        np.testing.assert_allclose(after[channel], before[channel], atol=1e-12)
    assert np.nanmax(np.abs(after["accel_x"] - before["accel_x"])) > 0.05


def test_accel_x_is_compared_as_the_wheel_speed_it_asks_for() -> None:
    """Compare with the differential equation, to second order of the blocks.

    A car follows its wheels with the lag m v/C, at constant C and v. The compared value
    is the difference of the wheels from those that its acceleration needs at the
    stiffness of the simulation.
    """
    config = Config.exact()
    t = 0.04 * np.arange(500)
    wheels = 0.3 * np.sin(0.7 * t)  # m/s about 20 m/s
    problem = CarProblem.__new__(CarProblem)
    problem.groups, problem._time, problem._speed, problem.config = (
        [(0, "accel_x")],
        [t],
        [np.full(500, 20.0)],
        config,
    )

    def accelerating(stiffness: float) -> np.ndarray:
        lag = config.mass * 20 / stiffness
        fine = np.arange(0, 20, 0.001)
        speed = np.zeros(len(fine))
        for k in range(1, len(fine)):
            speed[k] = speed[k - 1] + 0.001 / lag * (0.3 * np.sin(0.7 * fine[k - 1]) - speed[k - 1])
        return np.interp(t, fine, np.gradient(speed, 0.001))

    true, wrong = accelerating(4e5), accelerating(2e5)
    problem.compute_slip_time = lambda: config.mass / 2e5  # the wrong stiffness of the simulation
    got = problem.transform_difference(0, true - wrong)
    # wheels of the true acceleration at the wrong stiffness, less the true ones, with the
    # leak
    needed = np.cumsum(true) * 0.04 + config.mass * 20 / 2e5 * true - wheels
    leaking = lfilter([1, -1], [1, -np.exp(-0.04 / SPEED_TIME)], needed)
    # a sum of blocks is half a block early: 0.02 s of 0.7 rad/s. The leak changes the
    # first seconds
    rows = slice(100, 500)
    a, b = got[rows] - got[rows].mean(), leaking[rows] - leaking[rows].mean()
    assert np.corrcoef(a, b)[0, 1] > 0.98 and np.std(a) == pytest.approx(np.std(b), rel=0.1)


def test_noise_of_what_is_compared_is_that_of_the_sensor_through_the_comparison(
    found: tuple[CarProblem, CarFit],
) -> None:
    """Transform white noise of a thousand logs as long as the first: each rms to 3 %."""
    problem, rng = found[0], np.random.default_rng(7)
    for channel in ("accel_x", "yaw_rate"):
        g = problem.groups.index((0, channel))
        sd = problem.logs[0].noise[channel] / np.sqrt(problem._count[g])
        made_of = [
            problem.transform_difference(g, sd * rng.standard_normal(len(sd)))[problem._together[g]].mean(
                axis=1
            )
            for _ in range(1000)
        ]
        late = np.array(made_of)[:, 12:]  # after the start, which the leak still remembers
        assert np.sqrt(np.mean(late**2)) == pytest.approx(problem.compute_noise(g), rel=0.03), channel


def test_a_measured_velocity_is_that_of_its_place_in_its_axes(tmp_path: Path) -> None:
    """Compare with a rigid body: cross product, rotation matrix, and two rows of
    latency."""
    log = prepare(read_log(write_rows(tmp_path / "log.csv", make_drive_rows(1, 20.0))), Config.exact(QUIET))
    nothing = np.zeros(len(log.time))
    log.measured |= {"ins_vel_x": nothing, "ins_vel_y": nothing, "gnss_speed": nothing}
    place, turn = (1.2, -0.4), 0.03
    lever = {"velocity_lever_x": place[0], "velocity_lever_y": place[1]}
    config = Config.exact(lever | {"velocity_heading": turn, "velocity_latency": 0.02})
    rows = np.arange(len(log.time))
    motion = {"vel_x": 15 + 0.01 * rows, "vel_y": 0.002 * rows, "true_yaw_rate": 1e-4 * rows}
    got = convert_velocities(motion, config, log)
    at = 500
    spin = np.cross([0, 0, motion["true_yaw_rate"][at]], [*place, 0])[:2]
    of_place = np.array([motion["vel_x"][at], motion["vel_y"][at]]) + spin
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    np.testing.assert_allclose(
        [got["ins_vel_x"][at + 2], got["ins_vel_y"][at + 2]], axes @ of_place, rtol=1e-6
    )
    assert got["gnss_speed"][at + 2] == pytest.approx(np.linalg.norm(of_place), rel=1e-6)


def test_held_values_are_as_old_as_they_are_on_average(tmp_path: Path) -> None:
    """Wheels hold every fourth value: 0, 1, 2, 3 rows old, 15 ms on average."""
    rows = make_drive_rows(1, 20.0)
    at = np.arange(len(rows)) // 4 * 4
    for name in ("wheel_speed_front", "wheel_speed_rear"):
        rows[name] = rows[name][at]
    log = prepare(read_log(write_rows(tmp_path / "held.csv", rows)), Config.exact(QUIET))
    assert log.held == pytest.approx({"wheel_speed_front": 0.015, "wheel_speed_rear": 0.015}, abs=1e-4)


def test_noise_of_an_interpolated_channel_is_smoothed_as_that_of_its_entries(tmp_path: Path) -> None:
    """Smooth wheels at 50 Hz on rows of 100 Hz: as a spline through their own entries."""
    log, noise = read_log(write_rows(tmp_path / "log.csv", make_drive_rows(1, 40.0))), 0.05
    true = {n: log.data[n].to_numpy() for n in ("wheel_speed_front", "wheel_speed_rear")}
    time = log.time[::2]
    for k, (name, x) in enumerate(true.items()):
        own = x[::2] + noise * np.random.default_rng(k).standard_normal(len(time))
        log.data[name] = CubicSpline(time, own)(log.time)
        log.slower[name] = SlowChannel(time, own, 2.0)
    ready = prepare(log, Config.exact(QUIET))
    for name, x in true.items():
        own = smooth_values(time, log.slower[name].value)
        left, least = (float(np.std((a - b)[50:-50])) for a, b in ((ready.inputs[name], x), (own, x[::2])))
        assert left == pytest.approx(least, rel=0.05) and left < 0.6 * noise


# ---- preparation


def test_the_curvature_of_the_road_is_that_of_the_path_at_any_speed(tmp_path: Path) -> None:
    """Drive a clothoid at changing speed: smoothing by a symmetric kernel leaves it
    unchanged."""
    log = prepare(read_log(write_rows(tmp_path / "log.csv", make_drive_rows(1, 20.0))), Config.exact(QUIET))
    v = compute_speed(log.inputs, Config.exact())
    log.measured["yaw_rate"] = 1e-4 * log.distance * v
    found = compute_curve_accel(log, Config.exact())
    inner = (log.distance > 60) & (log.distance < log.distance[-1] - 60)
    np.testing.assert_allclose(found[inner], (1e-4 * log.distance * v**2)[inner], rtol=2e-3)


def test_blocks_are_put_together_only_where_none_is_missing() -> None:
    time = 0.04 * np.arange(12)
    time[8:] += 1.0
    used = np.ones(12, bool)
    used[3] = False
    assert group_blocks(time, used, 2).tolist() == [[0, 1], [4, 5], [6, 7], [8, 9], [10, 11]]
    assert group_blocks(time, used, 5).shape == (0, 5)


# ---- search


def test_a_step_goes_to_the_least_of_a_quadratic_within_bounds() -> None:
    """Compare with a brute-force grid in two dimensions; one is at its bound."""

    class Box:
        low, high, sd = np.array([-1.0, -1.0]), np.array([0.3, 1.0]), np.array([10.0, 10.0])

    information, gradient = np.array([[2.0, 0.8], [0.8, 1.0]]), np.array([-2.0, 0.1])
    got = compute_step(
        Box(), NormalEquations(information, gradient, np.zeros((0, 2)), np.zeros(0), None), np.zeros(2)
    )
    grid = np.stack(np.meshgrid(np.linspace(-1, 0.3, 1301), np.linspace(-1, 1, 2001), indexing="ij"), -1)
    value = 0.5 * np.einsum("...i,ij,...j", grid, information, grid) + grid @ gradient
    np.testing.assert_allclose(got, grid[np.unravel_index(np.argmin(value), value.shape)], atol=2e-3)


class Line:
    """Fit slope and offset of a line to noisy values: a problem without a simulation."""

    names, channels, groups = ("slope", "offset"), ("y",), [(0, "y")]
    knots, knot_sd = 0, 1.0
    mean, sd = np.array([0.3, 0.4]), np.array([1.0, 1.0])
    information = np.eye(2)

    def __init__(self, low: float, high: float):
        self.low, self.high = np.array([low, -9.0]), np.array([9.0, high])
        self.t = np.linspace(0.0, 1.0, 200)
        self.y = -0.5 * self.t + 0.9 + 0.02 * np.random.default_rng(2).standard_normal(200)
        self.asked: list[np.ndarray] = []

    def compute_residuals(self, x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        self.asked.append(x.copy())
        return [self.y - x[0] * self.t - x[1]]

    def compute_slopes(self, x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[np.ndarray]:
        return [-np.column_stack([self.t, np.ones(200)])]

    def compute_road_slopes(self, x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[csc_matrix]:
        return [csc_matrix((200, 0))]

    def compute_noise(self, g: int) -> float:
        return 0.02

    def get_step(self, g: int) -> float:
        return 0.04

    def compute_lasting_error(self, channel: str) -> float:
        return 0.0

    def to_ln(self, x: np.ndarray) -> np.ndarray:
        return x

    def compute_ln_slope(self, x: np.ndarray) -> np.ndarray:
        return np.ones(2)


def test_a_line_is_found_as_linear_least_squares_find_it() -> None:
    line = Line(-9.0, 9.0)
    ended = fit(line)
    a = np.vstack([np.column_stack([line.t, np.ones(200)]) / ended.scales["y"].sd, np.eye(2)])
    best = np.linalg.lstsq(a, np.append(line.y / ended.scales["y"].sd, line.mean), rcond=None)[0]
    assert ended.converged
    np.testing.assert_allclose(ended.x, best, atol=0.1 * np.sqrt(np.diag(ended.covariance)).min())
    np.testing.assert_allclose(ended.covariance, np.linalg.inv(a.T @ a), rtol=1e-6)


def test_a_search_stays_within_its_bounds_to_the_last_bit() -> None:
    """The library refuses a setting beyond its range, even by rounding.

    From 0.3, the step 0.05 - 0.3 leads to 0.04999999999999999.
    """
    assert 0.3 + (0.05 - 0.3) < 0.05
    line = Line(0.05, 0.7)
    ended = fit(line)
    assert all(((line.low <= x) & (x <= line.high)).all() for x in line.asked)
    assert ended.x[0] == 0.05


def test_eliminating_the_road_leaves_what_the_whole_normal_equations_say(
    found: tuple[CarProblem, CarFit],
) -> None:
    """Compare step and covariance of x with dense algebra over car and road."""
    problem, first = found
    x, z = first.search, first.z + 0.001
    residuals = problem.compute_residuals(x, z)
    tables, roads = problem.compute_slopes(x, z, residuals), problem.compute_road_slopes(x, z, residuals)
    got = build_normal(problem, first.scales, x, z, residuals, tables, roads)
    n = len(x)
    whole = np.zeros((n + len(z), n + len(z)))
    whole[:n, :n], whole[n:, n:] = problem.information, np.eye(len(z)) / problem.knot_sd**2
    gradient = np.concatenate([problem.information @ (x - problem.mean), z / problem.knot_sd**2])
    for e, j, r, (_, c) in zip(residuals, tables, roads, problem.groups, strict=True):
        both = np.hstack([j, r.toarray()])
        weight = np.minimum(1.0, HUBER * first.scales[c].rms / np.abs(e)) / first.scales[c].sd ** 2
        whole += both.T @ (weight[:, None] * both)
        gradient += both.T @ (weight * e)
    inverse = np.linalg.inv(whole)
    sd = np.sqrt(np.diag(inverse)[:n])
    np.testing.assert_allclose(
        np.linalg.inv(got.information) / np.outer(sd, sd), inverse[:n, :n] / np.outer(sd, sd), atol=1e-6
    )
    np.testing.assert_allclose(got.compute_road_sd(), np.sqrt(np.diag(inverse)[n:]), rtol=1e-6)
    by = np.linalg.solve(got.information, -got.gradient)
    # a condition number of 1e11 leaves five digits
    np.testing.assert_allclose(
        np.concatenate([by, got.solve_road(by)]), -inverse @ gradient, rtol=1e-4, atol=1e-6
    )


def test_a_fit_ends_where_scipy_does(tmp_path: Path) -> None:
    """Fit stiffness alone on level roads as scipy.optimize.least_squares does.

    Both have the final scales, the same residuals and prior. No residual is in the linear
    part of the loss.
    """
    config = Config.exact(QUIET)
    prior = make_prior(make_default_vehicle(), config).select(STIFFNESS)
    problem = CarProblem(
        prepare_logs(tmp_path, config, 1, hidden={"relaxation_length": 0.3}), config, prior, road=False
    )
    ended = fit(problem)
    root = np.linalg.cholesky(problem.information).T

    def weighted(x: np.ndarray) -> np.ndarray:
        parts = [
            e / ended.scales[c].sd
            for e, (_, c) in zip(problem.compute_residuals(x, np.zeros(0)), problem.groups, strict=True)
        ]
        return np.concatenate([*parts, root @ (x - problem.mean)])

    other = least_squares(weighted, problem.mean, x_scale=problem.sd, diff_step=1e-6)
    sd = np.sqrt(np.diag(np.linalg.inv(other.jac.T @ other.jac)))
    assert np.max(np.abs(ended.search - other.x) / sd) < 0.15  # a search ends at a step below 0.1
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(ended.equations.information))), sd, rtol=0.03)
    assert compute_cost(problem, ended.scales, ended.search, ended.z, ended.residuals) == pytest.approx(
        other.cost, rel=0.02
    )


def test_noise_counts_in_every_value_and_an_error_of_the_model_once_in_model_time() -> None:
    class One:
        channels, groups = ("yaw_rate",), [(0, "yaw_rate")]

        def compute_noise(self, g: int) -> float:
            return 0.01

        def get_step(self, g: int) -> float:
            return 0.04

        def compute_lasting_error(self, channel: str) -> float:
            return 0.0

    rng = np.random.default_rng(1)
    quiet = measure_scales(One(), [0.008 * rng.standard_normal(5000)])["yaw_rate"]
    assert quiet == ResidualScale(0.01, 0.01)
    loud = measure_scales(One(), [np.hypot(0.01, 0.03) * rng.standard_normal(50_000)])["yaw_rate"]
    assert loud.rms == pytest.approx(np.hypot(0.01, 0.03), rel=0.02)
    assert loud.sd**2 == pytest.approx(0.01**2 + 0.03**2 * MODEL_TIME / 0.04, rel=0.05)


def test_the_bank_of_a_road_is_found_and_the_car_with_it(tmp_path: Path) -> None:
    """The bank, 1.4 degrees rms, is no lean into curves. Without it the stiffness is
    wrong."""
    config, rows = Config.exact(QUIET), make_drive_rows(1, 80.0)
    log = prepare(read_log(write_rows(tmp_path / "log.csv", rows)), config)
    bank = 0.035 * np.sin(2 * np.pi * log.distance / 350)
    inputs = {n: log.inputs[n] for n in ("steer_angle", "wheel_speed_front", "wheel_speed_rear")}
    replay = Replay(("accel_x", "accel_y", "yaw_rate"), dt=np.full(len(rows), DT), bank=bank, **inputs)
    rng = np.random.default_rng(3)
    for name, x in replay.run(config, **STIFF).items():
        rows[name] = x + {"yaw_rate": 0.001}.get(name, 0.03) * rng.standard_normal(len(rows))
    banked = prepare(read_log(write_rows(tmp_path / "banked.csv", rows)), config)
    prior = make_prior(make_default_vehicle(), config).select(STIFFNESS)
    flat, whole = (fit(CarProblem([banked], config, prior, road=road)) for road in (False, None))
    road = Knots.lay([banked.distance])
    found = road.compute_profiles(0, whole.z)["bank"]
    inner = slice(300, -300)
    assert np.corrcoef(found[inner], bank[inner])[0, 1] > 0.98
    sd = np.sqrt(np.diag(whole.covariance))[:3]
    for k, name in enumerate(STIFFNESS):
        assert abs(whole.x[k] - np.log(STIFF[name])) < 3.5 * sd[k], name
    off = [abs(f.x[2] - np.log(STIFF["cy_rear"])) for f in (flat, whole)]
    assert off[1] < off[0]


def test_what_a_channel_tells_is_the_covariance_without_the_others(found: tuple[CarProblem, CarFit]) -> None:
    problem, first = found
    whole = compute_covariance(problem, first, problem.channels)
    np.testing.assert_allclose(whole, first.covariance, rtol=1e-6, atol=1e-12)
    few = compute_covariance(problem, first, ["accel_x"])
    k = problem.names.index("cy_front")
    # turned front wheels brake the car: only this shows cornering in accel_x
    assert few[k, k] > 10 * whole[k, k]
    assert np.all(np.diag(few) > 0.999 * np.diag(whole))


def test_a_search_simulates_few_slopes_and_ends_where_those_there_predict_little_gain(
    found: tuple[CarProblem, CarFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = found[0]
    asked: list[np.ndarray] = []
    inner = CarProblem.compute_slopes

    def recorded(self: CarProblem, x: np.ndarray, z: np.ndarray, base: list[np.ndarray]) -> list[np.ndarray]:
        asked.append(x)
        return inner(self, x, z, base)

    monkeypatch.setattr(CarProblem, "compute_slopes", recorded)
    ended = fit(problem)
    assert ended.converged and 2 <= len(asked) < ended.steps
    x, z = ended.search, ended.z
    slopes = inner(problem, x, z, ended.residuals), problem.compute_road_slopes(x, z, ended.residuals)
    there = build_normal(problem, ended.scales, x, z, ended.residuals, *slopes)
    inside = (x > problem.low + 1e-9) & (x < problem.high - 1e-9)
    gradient = there.gradient[inside]
    by = np.linalg.solve(there.information[np.ix_(inside, inside)], gradient)
    assert 0.5 * float(gradient @ by) < 5 * MIN_GAIN_NATS


def test_what_was_hidden_is_found(found: tuple[CarProblem, CarFit]) -> None:
    problem, first = found
    assert first.converged
    at = dict(zip(problem.names, first.x, strict=True))
    sd = dict(zip(problem.names, np.sqrt(np.diag(first.covariance)), strict=True))
    truth = {f"{k}_latency": v for k, v in LATE.items()} | HIDDEN | {k: np.log(v) for k, v in STIFF.items()}
    for name, value in truth.items():
        assert abs(at[name] - value) < 3.5 * sd[name], (name, at[name], value, sd[name])
    for name in ("steer_angle_latency", "relaxation_length", "steering_offset_angle"):
        assert sd[name] < 0.7 * problem.sd[problem.names.index(name)], name  # and shown


def test_a_search_from_elsewhere_ends_at_the_same_place(found: tuple[CarProblem, CarFit]) -> None:
    problem, whole = found
    part = fit(problem, max_steps=2)
    rest = fit(problem, part.search, part.z)
    assert rest.converged
    here, there = (compute_cost(problem, whole.scales, f.search, f.z, f.residuals) for f in (whole, rest))
    assert abs(here - there) < 1.0  # nat: as likely, in a valley of fifty unknowns


def test_what_a_manoeuvre_is_said_to_bring_it_brings(
    found: tuple[CarProblem, CarFit], tmp_path: Path
) -> None:
    """After a sine sweep, the sd of both axles is the predicted one, within 30 %."""
    problem, before = found
    said = advice.compute_sd_after(problem, before, advice.steer_sweep)
    rows = make_drive_rows(3, advice.MANOEUVRE_TIME, LATE, HIDDEN, advice.steer_sweep)
    more = prepare(read_log(write_rows(tmp_path / "sweep.csv", rows)), problem.config)
    after = fit(CarProblem([*problem.logs, more], problem.config, problem.prior, 2))
    for key, sd in said.items():
        k = problem.names.index(key)
        assert np.sqrt(after.covariance[k, k]) == pytest.approx(sd, rel=0.3), key
        assert sd < np.sqrt(before.covariance[k, k])


def test_offers_are_surer_than_now_and_said_in_percent(found: tuple[CarProblem, CarFit]) -> None:
    problem, ended = found
    now = advice.compute_axle_sd(problem, ended, advice._compute_car_information(problem, ended))
    k = problem.names.index("cy_rear")
    assert now["cy_rear"] == pytest.approx(float(np.sqrt(ended.covariance[k, k])), rel=1e-6)
    offered = advice.list_offers(problem, ended, make_default_vehicle())
    assert offered and all(min(o.sd[k] / now[k] for k in now) < advice.MAX_REMAINING for o in offered)
    assert all(o.sd[k] <= now[k] * 1.0001 for o in offered for k in now)
    first, *others = advice.describe_offers({"cy_front": 0.05, "cy_rear": 0.1}, offered[:1])
    assert "now +- 10 and +- 20 %. " in first and offered[0].what in others[0]
    assert advice.describe_offers(now, []) == []


def test_a_vehicle_file_with_a_broken_calibration_is_refused(tmp_path: Path) -> None:
    car = (
        "mass = 1500\nlf = 1.2\nlr = 1.5\nwheel_radius_front = 0.3\nwheel_radius_rear = 0.3\n[calibration]\n"
    )
    for text in (
        "names = ['a']",
        "names = ['a']\nmean = [1]\ncovariance = [[-1]]",
        "names = ['a', 'a']\nmean = [1, 2]\ncovariance = [[1, 0], [0, 1]]",
        "names = ['a', 'b']\nmean = [1]\ncovariance = [[1, 0], [0, 1]]",
        "names = ['a']\nmean = [nan]\ncovariance = [[1]]",
        "names = ['a', 'b']\nmean = [1, 2]\ncovariance = [[1, 2], [2, 1]]",
        "names = ['a', 'b']\nmean = [1, 2]\ncovariance = [[1, 0.5], [0.6, 1]]",
        "names = 3\nmean = 4\ncovariance = 5",
        "names = ['a']\nmean = ['x']\ncovariance = [[1]]",
    ):  # fmt: skip
        path = tmp_path / "car.toml"
        path.write_text(car + text, encoding="utf-8")
        with pytest.raises(UserError, match=r"\[calibration\]"):
            read_vehicle(path)
    # rounding of 0 is no contradiction: `tselab calibrate` writes such files
    path.write_text(
        car + "names = ['a', 'b']\nmean = [1, 2]\ncovariance = [[1, 1e-12], [2e-12, 1e-3]]", encoding="utf-8"
    )
    assert read_vehicle(path).calibration["names"] == ["a", "b"]


def test_a_simulation_that_diverges_is_bad_and_ends_no_search(
    found: tuple[CarProblem, CarFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, ended = found

    def refuse(*_args: object, **_start: float) -> dict[str, np.ndarray]:
        raise UserError("replay refused row 7")

    fits = compute_cost(problem, ended.scales, ended.search, ended.z, ended.residuals)
    monkeypatch.setattr(Replay, "run", refuse)
    left = problem.compute_residuals(ended.search, ended.z)
    assert all(np.isfinite(e).all() for e in left)
    assert compute_cost(problem, ended.scales, ended.search, ended.z, left) > 10 * fits
