"""Residuals of logs (identify/problem.py), knots and laps of roads (knots.py, laps.py),
the slow part of residuals (lasting.py), on logs of a few seconds made by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.lab.test_identify_data import make_checked, make_prepared
from tse.car.vehicle import make_default_vehicle
from tse.identify import knots, laps, lasting, problem, unknowns
from tse.identify.data import FitStretch, PreparedLog
from tse.identify.knots import Knots
from tse.identify.lasting import Lasting, Piece
from tse.identify.problem import CarProblem
from tse.identify.unknowns import Prior
from tse.library.core import Config
from tse.library.errors import UserError
from tse.roads.road import make_road

ROWS = 1202  # at 100 Hz: blocks from row 104 to 200 ms before the end, 269 of 4 rows
SETTINGS = {"wheel_radius_front": 0.30, "wheel_radius_rear": 0.40}


def make_problem(*logs: PreparedLog, names: tuple[str, ...] = (), settings: dict | None = None, **how):
    config = Config.exact(SETTINGS | (settings or {}))
    logs = logs or (make_log(),)
    velocity = any(c in log.measured for log in logs for c in unknowns.VELOCITY)
    prior = unknowns.make_prior(make_default_vehicle(), config, velocity).select(names)
    return CarProblem(logs, config, prior, **({"road": False} | how))


def make_log(**measured: np.ndarray) -> PreparedLog:
    used = np.arange(ROWS) >= 104
    log = make_prepared(ROWS, stretches=[FitStretch(0, ROWS, used)])
    return replace(log, measured={**log.measured, **measured})


# ---- unknowns and their prior


def test_names_are_those_of_the_car_then_leans_then_the_biases_of_each_log() -> None:
    second = make_log(accel_y=np.full(ROWS, np.nan), gnss_speed=np.full(ROWS, 12.0))
    p = make_problem(make_log(), replace(make_log(), stretches=[]), second, names=("cy_rear",))
    assert len(p.logs) == 2 and p.logs[1].measured is second.measured  # one has no stretch
    assert p.names == (
        "cy_rear", "superelevation@0", "superelevation@1",
        "accel_x~0", "accel_y~0", "yaw_rate~0", "accel_x~1", "yaw_rate~1",
    )  # fmt: skip
    assert (p.car, p.leans, p.channels) == (1, 2, ("accel_x", "accel_y", "yaw_rate", "gnss_speed"))
    np.testing.assert_allclose(p.mean[1:], [0.12, 0.12, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(p.sd[1:], [0.05, 0.05, 0.5, 0.5, 0.02, 0.5, 0.02])
    np.testing.assert_allclose(p.high - p.mean, np.append(np.exp(1.8) - 1, 6 * p.sd[1:]))
    np.testing.assert_allclose(p.mean - p.low, np.append(1 - np.exp(-1.8), 6 * p.sd[1:]))
    np.testing.assert_allclose(p.information @ p.covariance, np.eye(8), atol=1e-12)


def test_a_compliance_has_the_inverse_mean_and_covariances_of_the_other_sign() -> None:
    config = Config.exact(SETTINGS)
    covariance = np.array([[0.04, 0.01, 0.002], [0.01, 0.09, 0.03], [0.002, 0.03, 0.25]])
    prior = Prior(("cx_front", "cy_front", "relaxation_length"), np.array([0.1, 0.3, 0.5]), covariance,
                  np.array([-1.0, -1.5, 0.0]), np.array([1.2, 1.0, 3.0]))  # fmt: skip
    p = CarProblem([make_log()], config, prior, road=False, lean=False)
    by = np.diag([1.0, -np.exp(-0.3), 1.0])
    np.testing.assert_allclose(p.mean[:3], [0.1, np.exp(-0.3), 0.5])
    np.testing.assert_allclose(p.covariance[:3, :3], by @ covariance @ by)
    np.testing.assert_allclose(p.low[:3], [-1.0, np.exp(-1.0), 0.0])
    np.testing.assert_allclose(p.high[:3], [1.2, np.exp(1.5), 3.0])
    x = np.array([0.2, 0.8, 0.6, 0.01, 0.02, 0.03])
    np.testing.assert_allclose(p.to_ln(x), [0.2, -np.log(0.8), 0.6, 0.01, 0.02, 0.03])
    np.testing.assert_allclose(p.compute_ln_slope(x), [1, -1 / 0.8, 1, 1, 1, 1])


def test_a_log_with_a_measured_road_has_neither_knots_nor_leans() -> None:
    known = replace(make_log(), road={"bank": np.full(ROWS, 0.05)})
    p = make_problem(make_log(), known, road=None, settings={"bank_superelevation": 0.2})
    assert p.road is False and p.knots == 0 and p.leans == 0
    assert p.nominal["bank_superelevation"] == 0.0  # a bank is not counted twice
    level = make_problem(known, lean=False, settings={"bank_superelevation": 0.2})
    assert level.nominal["bank_superelevation"] == 0.0
    assert make_problem(settings={"bank_superelevation": 0.2}).mean[0] == 0.2
    p = make_problem(road=None, lean=False, settings={"bank_superelevation": 0.2})
    assert p.leans == 0 and p.nominal["bank_superelevation"] == 0.2
    assert p.knots == len(p.road) == 2 * (int(12 * 12.01 / 40) + 2)


# ---- groups of residuals


def test_a_value_of_accel_x_is_ten_blocks_and_of_the_others_one() -> None:
    p = make_problem()
    time = {c: t for (_, c), t in zip(p.groups, p.time, strict=True)}
    assert (len(time["yaw_rate"]), len(time["accel_x"])) == (269, 26)
    np.testing.assert_allclose(time["yaw_rate"][[0, -1]], [1.055, 1.055 + 268 * 0.04])
    np.testing.assert_allclose(time["accel_x"][[0, -1]], [1.235, 1.235 + 25 * 0.4])
    x, y, yaw = range(3)
    assert (p.get_step(x), p.get_step(y)) == pytest.approx((0.4, 0.04))
    p.time[y] = p.time[y][:1]
    assert p.get_step(y) == 0.04
    assert len(p.get_measured(yaw)) == 269


@pytest.mark.parametrize(("blocks", "compared"), [(24, False), (25, True)])
def test_a_channel_with_fewer_than_25_blocks_is_not_compared(blocks: int, compared: bool) -> None:
    some = np.where(np.arange(ROWS) < 104 + 4 * blocks, 0.1, np.nan)
    assert make_problem(make_log(yaw_rate=some)).channels == (
        ("accel_x", "accel_y", "yaw_rate") if compared else ("accel_x", "accel_y")
    )
    # of accel_x, 25 blocks are two values; pieces of 9 blocks are too short for a value
    rest = np.where(np.arange(ROWS) % 40 < 36, 0.1, np.nan)
    assert make_problem(make_log(accel_x=rest)).channels == ("accel_y", "yaw_rate")


def test_a_block_with_at_most_half_of_the_usual_values_is_not_used() -> None:
    x = np.arange(ROWS, dtype=float)
    x[108:110], x[112:115] = np.nan, np.nan  # two of four, and one of four
    x[116] = np.nan  # three of four
    p = make_problem(make_log(yaw_rate=x))
    g = p.channels.index("yaw_rate")
    np.testing.assert_allclose(p.get_measured(g)[:3], [105.5, 118.0, 121.5])
    assert len(p.time[g]) == 267


def test_noise_of_a_value_is_that_of_a_row_over_the_root_of_the_rows_in_a_block() -> None:
    held = np.where(np.arange(ROWS) % 4 == 1, 0.1, np.nan)
    log = make_log(accel_y=held)
    log.noise = {"accel_x": 0.3, "accel_y": 0.06, "yaw_rate": 0.004}
    p = make_problem(log)
    assert p.compute_noise(2) == pytest.approx(0.002)
    assert p.compute_noise(1) == pytest.approx(0.06)


def test_noise_of_a_value_of_accel_x_is_that_of_its_blocks_through_the_integral() -> None:
    """The last value answers to a unit in each block before it; errors of blocks are
    independent."""
    p = make_problem(settings={"mass": 1500.0, "longitudinal_stiffness_front": 2e4,
                               "longitudinal_stiffness_rear": 1e4})  # fmt: skip
    p.logs[0].noise["accel_x"] = 0.3
    answers = [p._average_groups(0, one)[-1] for one in np.eye(len(p._time[0]))]
    expected = 0.3 / 2 * np.sqrt(np.sum(np.square(answers)))  # four rows in a block
    assert p.compute_noise(0) == pytest.approx(expected, rel=1e-3)
    count = p._count[2]
    count[p._together[2][:100, 0]] = 1  # the mean of variances, not of sds
    mean_square = 0.01**2 * (100 + 169 / 4) / 269
    assert p.compute_noise(2) == pytest.approx(np.sqrt(mean_square))


def test_blocks_that_are_not_used_add_nothing_to_the_integral_of_accel_x(monkeypatch) -> None:
    """Block 12 has a single row, which is far off. The signal is that of the other
    blocks, about their own mean."""
    accel = np.where(np.arange(ROWS) < 600, 0.5, -0.3)
    accel[104 + 48 : 104 + 52] = [np.nan, np.nan, np.nan, 1e6]
    p = make_problem(make_log(accel_x=accel))
    monkeypatch.setattr(problem, "simulate", lambda config, log, channels, *_: {
        c: np.zeros(ROWS) for c in channels})  # fmt: skip
    blocks = np.array([0.5] * 124 + [-0.3] * 145)
    keep, slip_time = np.exp(-0.04), p.compute_slip_time()

    def transform(difference: np.ndarray) -> np.ndarray:
        speed, found = 0.0, []
        for d in difference:
            speed = speed * keep + d * (1 - keep)
            found.append(speed + slip_time * 12.0 * d)
        return np.array(found)

    used = np.arange(269) != 12
    groups = [np.arange(k, k + 10) for k in (0, *range(13, 260, 10))]

    def average(difference: np.ndarray) -> list[float]:
        return [transform(np.where(used, difference, 0.0))[g].mean() for g in groups]

    np.testing.assert_allclose(p.compute_residuals(p.mean, np.zeros(0))[0], average(blocks), rtol=1e-9)
    signal = np.array(average(blocks - blocks[used].mean()))
    np.testing.assert_allclose(p._compute_signal(0), signal, rtol=1e-9)
    table = p.compute_slopes(p.mean, np.zeros(0), p.compute_residuals(p.mean, np.zeros(0)))[0]
    bias = table[:, p.names.index("accel_x~0")]
    np.testing.assert_allclose(bias, average(np.full(269, -1.0)), rtol=1e-9)


def test_the_usual_number_of_values_is_that_of_the_blocks_that_have_any() -> None:
    """Two thirds of the blocks have no value. Of the others, one has a single value."""
    x = np.arange(ROWS, dtype=float)
    x[104 + 4 * 89 :] = np.nan
    x[104:107] = np.nan
    p = make_problem(make_log(yaw_rate=x))
    assert len(p.get_measured(p.channels.index("yaw_rate"))) == 88


def test_the_slow_error_of_a_channel_is_a_share_of_its_signal_or_of_its_sensor() -> None:
    """Of two logs, without their biases: a sine of amplitude 0.4 has the rms
    0.4/sqrt(2)."""
    wave = 0.4 * np.sin(2 * np.pi * np.arange(ROWS) / 107.6)  # ten periods in 269 blocks
    logs = [make_log(yaw_rate=wave + bias, gnss_speed=12 + wave) for bias in (0.0, 5.0)]
    p = make_problem(*logs, settings={"gnss_speed_sd": 0.08, "ins_velocity_sd": 0.3})
    assert p.compute_lasting_error("accel_x") == 0.0
    assert p.compute_lasting_error("yaw_rate") == pytest.approx(0.01 * 0.4 / np.sqrt(2), rel=0.01)
    assert p.compute_lasting_error("gnss_speed") == pytest.approx(0.04)
    assert p.compute_lasting_error("ins_vel_y") == pytest.approx(0.15)


def test_the_place_of_a_value_is_the_mean_of_its_rows_and_none_off_the_road() -> None:
    log = make_log()
    place = np.where(np.arange(ROWS) < 300, np.nan, 12.0 * log.time)
    p = make_problem(log, road=Knots.lay([place]))
    x, y = p._place[0], p._place[1]
    assert np.isnan(y[:49]).all() and np.isfinite(y[49:]).all()  # block 49 begins in row 300
    np.testing.assert_allclose(y[49], 12 * 3.015)
    np.testing.assert_allclose(x[5], 12 * (3.04 + 0.195))
    assert np.isnan(x[:5]).all()


# ---- simulation


def capture(monkeypatch: pytest.MonkeyPatch) -> list[tuple]:
    """Replace the simulation by zeros, and return what it is called with."""
    calls: list[tuple] = []

    def run(config, log, channels, stiffness, profiles, later):
        calls.append((config, channels, stiffness, profiles, later))
        return {c: np.zeros(len(log.time)) for c in channels}

    monkeypatch.setattr(problem, "simulate", run)
    return calls


def test_latencies_are_relative_to_the_gyro_and_to_the_mean_of_the_wheels(monkeypatch) -> None:
    """Values that are held are older by their mean age, which rows with a new sample do
    not have."""
    calls, late = capture(monkeypatch), unknowns.LATENCIES
    log = replace(make_log(), held={"yaw_rate": 0.002, "accel_y": 0.005, "wheel_speed_rear": 0.004})
    p = make_problem(log, names=(*late, "cy_front", "yaw_inertia"), settings={"accel_x_latency": 0.1})
    x = p.mean.copy()
    x[:5] = [0.010, 0.020, 0.030, 0.040, 0.050]  # steering, front and rear wheels, accel_x, accel_y
    x[5:7] = [0.5, 1234.0]
    p.simulate(0, x, np.zeros(0))
    config, channels, stiffness, _, later = calls[0]
    own = {"steer_angle": 0.012, "wheel_speed_front": 0.022, "wheel_speed_rear": 0.028, "accel_x": 0.042}
    wheels = 0.025
    assert later == pytest.approx({
        "steer_angle": 0.012, "accel_y": 0.047, "accel_x": own["accel_x"] - wheels,
        "wheel_speed_front": own["wheel_speed_front"] - wheels,
        "wheel_speed_rear": own["wheel_speed_rear"] - wheels,
    })  # fmt: skip
    assert all(getattr(config, name) == 0.0 for name in late)
    assert config.yaw_inertia == 1234.0 and channels == ("accel_x", "accel_y", "yaw_rate")
    assert stiffness == pytest.approx({"cx_front": 1.0, "cy_front": 2.0, "cy_rear": 1.0})
    p = make_problem(settings={"accel_y_latency": 0.02})  # one that is not fitted is kept
    p.simulate(0, p.mean, np.zeros(0))
    assert calls[1][4]["accel_y"] == 0.02


def test_a_lean_raises_the_outer_side_of_a_curve_and_adds_to_the_bank_of_the_road(monkeypatch) -> None:
    """In a left curve of a(y) = 2 m/s2 the right, outer side is higher: the bank is
    negative."""
    calls = capture(monkeypatch)
    logs = [make_log(yaw_rate=np.full(ROWS, 2.0 / 12.0)), make_log(yaw_rate=np.full(ROWS, -1.0 / 12.0))]
    p = make_problem(*logs, road=Knots.lay([log.distance for log in logs], [0, 0]))
    z = np.zeros(p.knots)
    z[p.road.get_slice(0, "bank")], z[p.road.get_slice(0, "grade")] = 0.01, 0.03
    x = p.mean.copy()
    x[[p.names.index("superelevation@0"), p.names.index("superelevation@1")]] = 0.1, 0.2
    for i in (0, 1):
        p.simulate(i, x, z)
    np.testing.assert_allclose(calls[0][3]["bank"], 0.01 - 0.1 * 2.0 / 9.81, rtol=1e-9)
    np.testing.assert_allclose(calls[1][3]["bank"], 0.01 + 0.2 * 1.0 / 9.81, rtol=1e-9)
    np.testing.assert_allclose(calls[1][3]["grade"], 0.03)
    level = make_problem(*logs, lean=False)
    level.simulate(0, level.mean, np.zeros(0))
    assert calls[-1][3] == {}


def test_a_velocity_is_simulated_only_for_a_log_that_measures_one(monkeypatch) -> None:
    calls = capture(monkeypatch)
    p = make_problem(make_log(), make_log(ins_vel_y=np.zeros(ROWS)), names=("velocity_lever_x",))
    assert set(p.simulate(0, p.mean, np.zeros(0))) == {"accel_x", "accel_y", "yaw_rate"}
    assert "ins_vel_y" in p.simulate(1, p.mean, np.zeros(0))
    assert calls[0][1] == p.channels[:3] and set(calls[1][1]) > {"vel_x", "vel_y", "true_yaw_rate"}


def test_a_velocity_is_that_at_the_place_and_in_the_axes_of_its_sensor_delayed() -> None:
    """With complex numbers: v + i r (place), turned back by the heading."""
    log = make_log(ins_vel_x=np.zeros(ROWS), ins_vel_y=np.zeros(ROWS), gnss_speed=np.zeros(ROWS))
    t = log.time
    config = Config.exact({"velocity_lever_x": 1.5, "velocity_lever_y": -0.4, "velocity_heading": 0.3,
                           "velocity_latency": 0.05})  # fmt: skip
    found = problem.convert_velocities(
        {"vel_x": 10 + t, "vel_y": 2 - 0.3 * t, "true_yaw_rate": 0.5 + 0.1 * t}, config, log
    )
    s = t - 0.05
    speed = (10 + s) + 1j * (2 - 0.3 * s) + 1j * (0.5 + 0.1 * s) * (1.5 - 0.4j)
    seen = speed * np.exp(-0.3j)
    np.testing.assert_allclose(found["ins_vel_x"][10:], seen.real[10:], rtol=1e-9)
    np.testing.assert_allclose(found["ins_vel_y"][10:], seen.imag[10:], rtol=1e-9)
    np.testing.assert_allclose(found["gnss_speed"][10:], np.abs(seen)[10:], rtol=1e-4)
    alone = problem.convert_velocities(
        {"vel_x": t, "vel_y": t, "true_yaw_rate": t}, config, make_log(gnss_speed=np.zeros(ROWS))
    )
    assert set(alone) == {"gnss_speed"}


def test_residuals_are_measured_minus_simulated_minus_bias_of_the_rows_with_a_value(monkeypatch) -> None:
    def run(config, log, channels, stiffness, profiles, later):
        return {c: np.arange(ROWS, dtype=float) for c in channels}

    monkeypatch.setattr(problem, "simulate", run)
    measured = 5.0 + np.arange(ROWS)
    measured[105::4] = np.nan
    measured[108:112] = np.nan
    p = make_problem(make_log(accel_y=measured), make_log(accel_y=measured + 1))
    x = p.mean.copy()
    x[p.names.index("accel_y~0")], x[p.names.index("accel_y~1")] = 3.0, 7.0
    got = dict(zip(p.groups, p.compute_residuals(x, np.zeros(0)), strict=True))
    np.testing.assert_allclose(got[0, "accel_y"], 2.0)
    np.testing.assert_allclose(got[1, "accel_y"], -1.0)
    sensed = dict(zip(p.groups, p.compute_sensed_residuals(x, np.zeros(0)), strict=True))
    np.testing.assert_allclose(sensed[1, "accel_y"], -1.0)
    assert len(sensed[0, "accel_y"]) == 268
    x[p.names.index("accel_x~0")] = 1.0
    assert len(p.compute_sensed_residuals(x, np.zeros(0))[0]) == 269  # of accel_x, too, each block


# ---- accel_x as a speed


def test_a_lasting_difference_of_accel_x_is_the_speed_that_it_would_have_made() -> None:
    """From each gap on a leaky integral, a (1 - exp(-t/1 s)) 1 s, and slip, m v/C a."""
    p = make_problem(settings={"mass": 1500.0, "longitudinal_stiffness_front": 1e5,
                               "longitudinal_stiffness_rear": 2e5})  # fmt: skip
    t = 0.04 * np.arange(100.0)
    t[60:] += 0.1
    p._time[0], p._speed[0] = t, np.full(100, 20.0)
    assert p.compute_slip_time() == pytest.approx(1500 / 3e5)
    got = p.transform_difference(0, np.full(100, 0.5))
    ends = 0.04 * (np.append(np.arange(60), np.arange(40)) + 1)  # a block counts to its end
    np.testing.assert_allclose(got, 0.5 * (1 - np.exp(-ends)) + 0.005 * 20 * 0.5)
    np.testing.assert_array_equal(p.transform_difference(1, np.full(100, 0.5)), 0.5)
    p._together[0] = np.arange(100).reshape(10, 10)
    np.testing.assert_allclose(p._average_groups(0, np.full(100, 0.5)), got.reshape(10, 10).mean(axis=1))


@pytest.mark.parametrize(("follows", "rear"), [(0.0, 1.0), (1.0, 1.5), (0.5, 1.25)])
def test_the_slip_of_accel_x_is_that_of_the_prior_mean_of_both_axles(follows: float, rear: float) -> None:
    p = make_problem(names=("longitudinal_stiffness_rear", "cx_front"),
                     settings={"rear_longitudinal_follows_front": follows})  # fmt: skip
    c = p.config
    p.prior.mean[:] = 7e4, np.log(1.5)
    assert p.compute_slip_time() == pytest.approx(
        c.mass / (1.5 * c.longitudinal_stiffness_front + rear * 7e4)
    )


def test_a_yaw_rate_at_1_m_s2_is_one_over_the_speed_which_counts_from_5_m_s() -> None:
    p = make_problem()
    p._speed[2] = np.where(np.arange(len(p._speed[2])) < 100, 4.0, 16.0)
    np.testing.assert_allclose(p.compute_unit_yaw_rate(2)[[0, 150]], [1 / 5, 1 / 16])
    assert p.average_speed(0)[0] == 12.0  # 0.5 (0.3 x 40 + 0.4 x 30)


def test_the_speed_of_a_value_is_that_of_its_own_rows() -> None:
    """The car accelerates from 8 m/s on at 1.5 m/s2."""
    log = make_log()
    log.inputs = log.inputs | {f"wheel_speed_{a}": (8 + 1.5 * log.time) / SETTINGS[f"wheel_radius_{a}"]
                               for a in ("front", "rear")}  # fmt: skip
    p = make_problem(log)
    for g in (0, 2):
        np.testing.assert_allclose(p.average_speed(g), 8 + 1.5 * p.time[g])
    np.testing.assert_allclose(p.compute_unit_yaw_rate(2), 1 / (8 + 1.5 * p.time[2]))


# ---- partial derivatives


def test_slopes_are_differences_over_the_step_and_a_log_has_its_own_lean_and_bias(monkeypatch) -> None:
    """With residuals linear in x: a slope is exact, also at a bound, where the step is
    negative."""
    p = make_problem(make_log(), make_log(), names=("relaxation_length", "cy_front"))
    weights = np.arange(1.0, len(p.names) + 1)
    inside: list[bool] = []

    def residuals(x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        inside.append(bool(((p.low <= x) & (x <= p.high)).all()))
        return [np.full(len(t), 10.0 * g + weights @ x) for g, t in enumerate(p.time)]

    monkeypatch.setattr(p, "compute_residuals", residuals)
    x = p.mean.copy()
    x[0] = p.high[0]
    tables = p.compute_slopes(x, np.zeros(0), residuals(x, np.zeros(0)))
    assert all(inside)
    for (i, c), table in zip(p.groups, tables, strict=True):
        np.testing.assert_allclose(table[:, :2], np.tile([1.0, 2.0], (len(table), 1)), rtol=1e-6)
        # both leans move together by the same step: 3 + 4
        np.testing.assert_allclose(table[:, 2 + i], 7.0, rtol=1e-6)
        assert not table[:, 3 - i].any()
        bias = [n for n, name in enumerate(p.names) if "~" in name and name != f"{c}~{i}"]
        assert not table[:, bias].any()
        if c != "accel_x":
            np.testing.assert_array_equal(table[:, p.names.index(f"{c}~{i}")], -1.0)
        else:
            own = p._average_groups(p.groups.index((i, c)), np.full(len(p._time[0]), -1.0))
            np.testing.assert_allclose(table[:, p.names.index(f"{c}~{i}")][:20], own[:20])


def test_the_step_of_a_slope_is_a_share_of_the_prior_sd_a_smaller_one_for_a_compliance(monkeypatch) -> None:
    p = make_problem(names=("relaxation_length", "cy_front", "cx_front"))
    seen: list[np.ndarray] = []
    monkeypatch.setattr(p, "compute_residuals", lambda x, z: seen.append(x - p.mean) or p.time)
    p.compute_slopes(p.mean, np.zeros(0), p.time)
    moved = np.sum(seen, axis=0)
    np.testing.assert_allclose(moved[:4] / p.sd[:4], [0.005, 0.0005, 0.005, 0.005])


def test_slopes_of_the_road_are_of_the_value_that_acts_in_each_place(monkeypatch) -> None:
    log = make_log()
    p = make_problem(log, road=Knots.lay([log.distance]))
    n = p.knots

    def residuals(x: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
        return [np.full(len(t), float(np.arange(1.0, n + 1) @ z)) for t in p.time]

    monkeypatch.setattr(p, "compute_residuals", residuals)
    z = np.full(n, 0.002)
    for table, place in zip(p.compute_road_slopes(p.mean, z, residuals(p.mean, z)), p._place, strict=True):
        dense = table.toarray()
        assert dense.shape == (len(place), n)
        # there are five knots, so each is moved alone: from 40 m before it on it acts
        for k, at in enumerate(p.road.compute_places(0)):
            assert not dense[place < at - 40, k].any() and not dense[place < at - 40, 5 + k].any()
            np.testing.assert_allclose(dense[place >= at - 40, k], k + 1)
            np.testing.assert_allclose(dense[place >= at - 40, 5 + k], k + 6)
    level = make_problem(log)
    assert [t.shape for t in level.compute_road_slopes(level.mean, np.zeros(0), level.time)] == [
        (26, 0), (269, 0), (269, 0)
    ]  # fmt: skip


# ---- the car that is found


def test_a_known_car_has_the_stiffness_that_was_found_at_each_axle() -> None:
    names = ("cx_front", "cy_front", "cy_rear", "relaxation_length", "longitudinal_stiffness_rear")
    for follows, rear in ((1.0, 1.3), (0.5, 1.15), (0.0, 1.0)):
        p = make_problem(names=names, settings={"rear_longitudinal_follows_front": follows})
        x = p.mean.copy()
        x[:5] = np.log(1.3), 1 / 0.8, 1 / 1.2, 0.7, 5e4
        car, c = problem.make_known_car(p, x), p.config
        assert car.longitudinal_stiffness_front == pytest.approx(1.3 * c.longitudinal_stiffness_front)
        assert car.cornering_stiffness_front == pytest.approx(0.8 * c.cornering_stiffness_front)
        assert car.cornering_stiffness_rear == pytest.approx(1.2 * c.cornering_stiffness_rear)
        assert car.longitudinal_stiffness_rear == pytest.approx(rear * 5e4)
        assert car.relaxation_length == 0.7


def test_latencies_are_listed_by_channel_and_0_if_unknown() -> None:
    assert problem.list_latencies({"accel_y_latency": 0.01, "yaw_rate_latency": 0.5, "accel_y": 3.0}) == {
        "steer_angle": 0.0, "wheel_speed_front": 0.0, "wheel_speed_rear": 0.0, "accel_x": 0.0,
        "accel_y": 0.01,
    }  # fmt: skip


def test_the_size_of_a_channel_is_its_rms_over_a_second() -> None:
    step = np.where(np.arange(ROWS) < 104 + 4 * 100, 3.0, 4.0)
    p = make_problem(make_log(yaw_rate=step))
    piece = p.make_piece(2, np.arange(269.0))
    assert piece.size[80] == pytest.approx(3.0) and piece.size[120] == pytest.approx(4.0)
    assert piece.size[100] == pytest.approx(np.sqrt((9 * 12 + 16 * 13) / 25))
    np.testing.assert_array_equal(piece.residual, np.arange(269.0))
    np.testing.assert_array_equal(piece.time, p.time[2])


def test_the_size_of_accel_x_is_that_of_the_speed_that_it_would_have_made() -> None:
    """Of a constant 0.5 m/s2: 0.5 m/s after some time, and its slip; the mean over a
    value of ten blocks."""
    p = make_problem(make_log(accel_x=np.full(ROWS, 0.5)))
    speed = 0.5 * (1 - np.exp(-0.04 * np.arange(1, 270))) + 0.5 * 12 * p.compute_slip_time()
    piece = p.make_piece(0, np.zeros(26))
    window = [np.mean(speed[k - 12 : k + 13] ** 2) for k in range(60, 70)]
    assert piece.size[6] == pytest.approx(np.sqrt(np.mean(window)), rel=1e-6)


def test_what_lasts_is_measured_for_each_sensor_over_all_logs(monkeypatch) -> None:
    seen: list[list[Piece]] = []
    monkeypatch.setattr(problem, "measure_lasting", lambda pieces: seen.append(pieces) or Lasting(1.0, 2.0))
    p = make_problem(make_log(gnss_speed=np.full(ROWS, 12.0)), make_log())
    found = p.measure_lasting([np.full(len(t), float(g)) for g, t in enumerate(p.time)])
    assert list(found) == ["accel_x", "accel_y", "yaw_rate"]
    assert [[piece.residual[0] for piece in pieces] for pieces in seen] == [[0, 4], [1, 5], [2, 6]]


# ---- knots


PLACES = [np.array([10.0, 100.0, np.nan, 95.0]), np.array([0.0, 40.0]), np.array([250.0, 20.0])]
ROADS = Knots.lay(PLACES, [0, 1, 0])


def test_knots_of_a_road_cover_the_places_of_all_its_logs() -> None:
    assert ROADS.first == [10.0, 0.0] and ROADS.count == [8, 3]
    np.testing.assert_array_equal(ROADS.compute_places(0), 10.0 + 40.0 * np.arange(8))
    assert len(ROADS) == 2 * 11 and ROADS.kinds == ("bank", "grade")
    slices = [ROADS.get_slice(k, p) for k in (0, 1) for p in ("bank", "grade")]
    assert [(s.start, s.stop) for s in slices] == [(0, 8), (8, 16), (16, 19), (19, 22)]
    alone = Knots.lay(PLACES)
    assert alone.road == [0, 1, 2] and alone.first == [10.0, 0.0, 20.0] and alone.count == [4, 3, 7]
    bank = Knots.lay(PLACES, [0, 1, 0], ("grade",))
    assert len(bank) == 11 and bank.get_slice(1, "grade") == slice(8, 11)


def test_a_profile_is_interpolated_between_knots_and_level_off_the_road() -> None:
    z = np.zeros(22)
    z[ROADS.get_slice(0, "grade")] = 0.01 * np.arange(8)
    z[ROADS.get_slice(1, "bank")] = [0.0, 0.04, 0.08]
    first, second = ROADS.compute_profiles(0, z), ROADS.compute_profiles(1, z)
    np.testing.assert_allclose(first["grade"], 0.01 * np.array([0.0, 2.25, 0.0, 2.125]))
    np.testing.assert_array_equal(first["bank"], 0.0)
    np.testing.assert_allclose(second["bank"], [0.0, 0.04])
    np.testing.assert_allclose(ROADS.compute_profiles(2, z)["grade"], [0.06, 0.0025])


def test_moves_change_every_fifth_knot_of_one_profile_of_all_roads_and_each_knot_once() -> None:
    moves = ROADS.list_moves()
    assert len(moves) == 10
    np.testing.assert_allclose(sum(moves), 0.01)
    assert np.flatnonzero(moves[0]).tolist() == [0, 5, 16]
    assert np.flatnonzero(moves[6]).tolist() == [9, 14, 20]
    assert np.flatnonzero(moves[4]).tolist() == [4]


def test_the_value_that_acts_is_the_last_moved_knot_from_40_m_before_it_on() -> None:
    """Knots 1 and 6 of the first road are at 50 and 250 m."""
    move = ROADS.list_moves()[6]
    at = np.array([9.0, 11.0, 50.0, 209.0, 211.0, 300.0, np.nan])
    assert ROADS.find_acting(0, at, move).tolist() == [-1, 9, 9, 9, 14, 14, -1]
    assert ROADS.find_acting(2, at[1:2], move).tolist() == [9]
    assert ROADS.find_acting(1, np.array([0.0, 41.0]), move).tolist() == [20, 20]
    assert ROADS.find_acting(1, np.array([0.0, 39.0]), ROADS.list_moves()[4]).tolist() == [-1, -1]


def test_values_of_a_sparse_matrix_stand_in_their_row_and_column() -> None:
    got = knots.build_sparse([np.array([0, 2]), np.array([1])], [np.array([1, 0]), np.array([1])],
                             [np.array([5.0, 6.0]), np.array([7.0])], (3, 2))  # fmt: skip
    assert got.toarray().tolist() == [[0, 5], [0, 7], [6, 0]]


# ---- laps


def find_laps(monkeypatch, shares: dict[tuple[int, ...], list[float]]):
    """Find the laps of four logs. `shares`: for the logs that are compared, the share of
    the rows of each that lies on the common road; a missing key: they do not match."""
    logs = [make_checked(0.01 * np.arange(10)) for _ in range(4)]
    number = {id(log): i for i, log in enumerate(logs)}
    asked: list[tuple[int, ...]] = []

    def match(some, config):
        key = tuple(number[id(log)] for log in some)
        asked.append(key)
        if key not in shares:
            raise UserError("cannot be aligned")
        places = [np.where(np.arange(10) < 10 * share, 100.0 * i, np.nan) for i, share in
                  zip(key, shares[key], strict=True)]  # fmt: skip
        return places, f"road of {key}"

    monkeypatch.setattr(laps, "match_common", match)
    monkeypatch.setattr(laps, "derive_track", lambda log, _: SimpleNamespace(travelled=np.arange(10.0)))
    monkeypatch.setattr(laps, "_derive_path", lambda track: "own path")
    return laps.find_laps(logs, Config.exact()), asked


def test_logs_share_a_road_if_half_of_each_lies_on_it(monkeypatch) -> None:
    found, asked = find_laps(
        monkeypatch, {(0, 1): [1.0, 0.4], (0, 2): [0.5, 0.5], (0, 2, 3): [0.4, 1.0, 1.0]}
    )
    assert found.of == [0, 1, 0, 2]
    assert (found.count(0), found.count(1), found.count(2)) == (2, 1, 1)
    assert found.path == ["road of (0, 2)", "own path", "own path"]
    assert asked == [(0, 1), (0, 2), (0, 2, 3), (1, 3)]
    np.testing.assert_array_equal(found.distance[2], np.where(np.arange(10) < 5, 200.0, np.nan))
    np.testing.assert_array_equal(found.distance[1], np.arange(10.0))
    knots_of = found.lay_knots(("bank",))
    assert knots_of.road == [0, 1, 0, 2] and knots_of.kinds == ("bank",)


def test_a_log_joins_the_first_road_that_it_matches_and_moves_the_places_of_all(monkeypatch) -> None:
    found, asked = find_laps(monkeypatch, {(1, 2): [0.9, 0.9], (1, 2, 3): [0.6, 0.7, 0.8]})
    assert found.of == [0, 1, 1, 1]
    assert asked == [(0, 1), (0, 2), (1, 2), (0, 3), (1, 2, 3)]
    assert found.path == ["own path", "road of (1, 2, 3)"]
    assert [int(np.isfinite(d).sum()) for d in found.distance] == [10, 6, 7, 8]


@pytest.mark.parametrize(("closed", "kept"), [(False, True), (True, False), (None, False)])
def test_a_single_log_has_a_path_unless_it_is_a_circuit_or_hardly_moves(monkeypatch, closed, kept) -> None:
    road = SimpleNamespace(is_closed=closed)

    def derive(track: object) -> SimpleNamespace:
        if closed is None:
            raise UserError("the car hardly moves")
        return road

    monkeypatch.setattr(laps, "derive_road", derive)
    assert laps._derive_path(None) is (road if kept else None)


def test_the_profile_of_a_road_has_its_own_values_and_sds() -> None:
    s = np.arange(0.0, 101.0, 5.0)
    z, sd = np.arange(22.0) / 1000, np.arange(22.0) / 10000
    found = laps.make_profile(make_road(s, x=s, y=0 * s), ROADS, 1, z, sd)
    inside = s <= 80
    np.testing.assert_allclose(found.bank[inside], np.interp(s, [0, 40, 80], z[16:19])[inside])
    np.testing.assert_allclose(found.grade[inside], np.interp(s, [0, 40, 80], z[19:22])[inside])
    np.testing.assert_allclose(found.grade_sd[inside], np.interp(s, [0, 40, 80], sd[19:22])[inside])


# ---- slow part of residuals


def test_pairs_of_residuals_are_a_lag_apart_in_time() -> None:
    time = np.array([0.0, 0.04, 0.08, 0.50, 0.54, 0.58])
    e = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
    piece = Piece(time, e, e)
    combine = lasting._combine_lagged
    assert combine(piece, e, 1, 0.04, np.subtract).tolist() == [1.0, 2.0, 8.0, 16.0]
    assert combine(piece, e, 2, 0.04, np.multiply).tolist() == [4.0, 256.0]
    assert combine(piece, e, 0, 0.04, np.multiply).tolist() == (e**2).tolist()
    assert len(combine(piece, e, 6, 0.04, np.multiply)) == len(combine(piece, e, 9, 0.04, np.multiply)) == 0


@pytest.mark.parametrize(
    ("covariance", "expected"),
    [([3, -1, 2, -2, 5, 5], 2.0), ([3, -1, 1, 0.5, 4], 3.5), ([-1, 0.5, 9, 9], 0.0), ([1.0], 0.0), ([], 0.0)],
)
def test_covariances_are_summed_up_to_the_first_pair_that_is_not_positive(covariance, expected) -> None:
    assert lasting._sum_positive(np.array(covariance, float)) == expected


def test_power_and_walk_of_a_wave_are_those_of_its_definition() -> None:
    """A wave of 20 s: D(L) = A^2 (1 - cos wL), of two logs with different means."""
    time, w = 0.1 * np.arange(2000), 2 * np.pi / 20
    pieces = [Piece(time, time, 0.3 * np.sin(w * time) + mean) for mean in (0.0, 5.0)]
    found = lasting.measure_lasting(pieces)
    lags = np.arange(1.0, 10.01, 0.5)
    rise = 0.09 * (np.cos(w * 0.5) - np.cos(w * lags)) / (lags - 0.5)
    assert found.walk == pytest.approx(np.sqrt(2 * rise.max()), rel=0.02)
    # positive up to 4 s: step (c0/2 + c1 + ... + c40)
    c = 0.045 * np.cos(w * 0.1 * np.arange(41))
    assert found.power == pytest.approx(0.1 * (0.5 * c[0] + c[1:].sum()), rel=0.02)
    short = [replace(p, time=p.time[:15], size=p.size[:15], residual=p.residual[:15]) for p in pieces[:1]]
    assert lasting.measure_lasting(short) == Lasting(0.0, 0.0)


def test_a_walk_is_measured_at_lags_from_1_to_10_s_in_steps_of_half_a_second() -> None:
    """A wave of 1.6 s rises steeply from 0.5 to 0.6 s, a drift up to the longest lag: the
    mean square is (slope lag)^2."""
    time, w = 0.1 * np.arange(3000), 2 * np.pi / 1.6
    found = lasting.measure_lasting([Piece(time, time, 0.3 * np.sin(w * time))])
    lags = np.arange(1.0, 10.01, 0.5)
    rise = 0.09 * (np.cos(w * 0.5) - np.cos(w * lags)) / (lags - 0.5)
    assert found.walk == pytest.approx(np.sqrt(2 * rise.max()), rel=0.02)
    drift = lasting.measure_lasting([Piece(time, time, 0.02 * time)])
    assert drift.walk == pytest.approx(0.02 * np.sqrt(2 * (10**2 - 0.5**2) / 9.5))


def test_the_share_of_the_model_error_is_that_of_nine_of_ten_intervals(monkeypatch) -> None:
    """A power of 0.4 s times the variance; 11 intervals of 10 s with the variance k^2."""
    monkeypatch.setattr(lasting, "measure_lasting", lambda pieces: Lasting(0.4 * square, 0.0))
    time = 0.1 * np.arange(1100)
    k = 1.0 + np.arange(1100) // 100
    sign = np.where(np.arange(1100) % 2, -1.0, 1.0)
    square = float(np.mean(k**2))
    pieces = [Piece(time, np.full(1100, 4.0), sign * k + 70.0)]
    share, count = lasting.measure_share(pieces, [np.full(1100, 3.0)])
    assert share == pytest.approx(np.sqrt(0.4 * 10.0**2 / 25.0))
    assert count == pytest.approx(11 * 16 / 25)
    # an interval with few values does not count
    few = [Piece(time[:110], np.full(110, 4.0), pieces[0].residual[:110])]
    assert lasting.measure_share(few, [np.full(110, 3.0)])[1] == pytest.approx(16 / 25)
    least = [Piece(time[:15], np.full(15, 4.0), sign[:15])]
    assert lasting.measure_share(least, [np.full(15, 3.0)]) == (0.0, 0.0)


def test_an_interval_has_its_own_signal_floor_and_error_about_the_mean_of_its_log(monkeypatch) -> None:
    """Two logs of six intervals of 10 s, with a power of 0.4 s times the variance."""
    rng, time = np.random.default_rng(4), 0.1 * np.arange(600)
    by = rng.uniform(0.5, 3.0, (3, 2, 6)).repeat(100, axis=2)
    size, floor, residual = by * rng.uniform(0.2, 1.8, by.shape)
    residual = np.stack([residual[0], residual[1] + 20.0])
    square = float(np.mean((residual - residual.mean(axis=1, keepdims=True)) ** 2))
    monkeypatch.setattr(lasting, "measure_lasting", lambda pieces: Lasting(0.4 * square, 0.0))
    pieces = [Piece(time, s, r) for s, r in zip(size, residual, strict=True)]
    share, count = lasting.measure_share(pieces, list(floor))
    error = (residual - residual.mean(axis=1, keepdims=True)).reshape(12, 100)
    signal, least = (np.mean(x.reshape(12, 100) ** 2, axis=1) for x in (size, floor))
    ratios = 0.4 * np.mean(error**2, axis=1) / (signal + least)
    assert share == pytest.approx(np.sqrt(np.quantile(ratios, 0.9)))
    assert count == pytest.approx(np.sum(signal / (signal + least)))


def test_the_step_of_residuals_is_their_usual_one_whatever_gaps_there_are() -> None:
    """The power of a wave does not change if its halves are a thousand seconds apart."""
    time = 0.1 * np.arange(2000)
    wave = np.sin(2 * np.pi * time / 20)
    whole = lasting.measure_lasting([Piece(time, time, wave)])
    apart = lasting.measure_lasting([Piece(np.where(time < 100, time, time + 1000), time, wave)])
    assert apart.power == pytest.approx(whole.power, rel=0.03)
    assert apart.walk == pytest.approx(whole.walk, rel=0.03)
