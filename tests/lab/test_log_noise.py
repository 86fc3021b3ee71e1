"""Noise of sensors and units of a log, against drawn noise and a table of units."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm

from tse.log import noise
from tse.log.noise import compute_misfit, estimate_channel_noise, estimate_noise, find_new_values
from tse.log.rows import CheckedLog, SlowChannel, list_columns
from tse.log.units import is_known_unit, is_unknown_unit, unit_factor, unit_kind

EVERY = np.ones(4000, bool)


def make_log(time: np.ndarray, **columns: np.ndarray) -> CheckedLog:
    """Return a log with these columns; the others are 0."""
    data = pd.DataFrame({c: columns.get(c, np.zeros(len(time))) for c in list_columns()[1:]})
    step = float(np.median(np.diff(time))) if len(time) > 1 else None
    return CheckedLog(Path("log"), time, data, pd.DataFrame(), np.arange(len(time)), step)


def draw_white(sd: float, count: int = 4000, seed: int = 1) -> np.ndarray:
    return sd * np.random.default_rng(seed).standard_normal(count)


# ---- Noise of a channel


@pytest.mark.parametrize("sd", [0.2, 0.7])
def test_the_noise_is_that_beside_a_slow_signal_and_outliers_hardly_count(sd):
    slow = 3 * np.sin(0.005 * np.arange(4000)) + 0.001 * np.arange(4000)
    value = slow + draw_white(sd)
    value[::100] += 50
    found = estimate_channel_noise("accel_y", value, EVERY)
    assert found.sd == pytest.approx(sd, rel=0.08) and found.sd == found.unraised
    assert (found.hold, found.step) == (1, 0.0) and found.text.startswith("second differences")


def test_rows_that_stand_are_left_out_where_enough_rows_move():
    value = draw_white(0.2)
    value[2000:] *= 10
    moving = np.arange(4000) < 2000
    assert estimate_channel_noise("accel_x", value, moving).sd == pytest.approx(0.2, rel=0.08)
    # too few rows move, so all rows are used
    few = np.arange(4000) < noise.MIN_NOISE_ROWS - 1
    assert estimate_channel_noise("accel_x", value, few).sd > 0.4


def test_fewer_values_than_needed_give_no_noise_and_missing_ones_do_not_count():
    value = draw_white(0.2, 200)
    value[noise.MIN_NOISE_ROWS :] = np.nan
    assert estimate_channel_noise("accel_x", value, np.ones(200, bool)).sd == pytest.approx(0.2, rel=0.5)
    value[0] = np.nan
    assert estimate_channel_noise("accel_x", value, np.ones(200, bool)) is None


@pytest.mark.parametrize("hold", [2, 5])
@pytest.mark.parametrize("linear", [False, True])
def test_noise_of_repeated_samples_is_raised_by_the_root_of_their_number(hold, linear):
    """The rows of a sample together have the weight of one sample."""
    samples = draw_white(0.3, 2000)
    value = np.repeat(samples, hold)
    if linear:
        value = np.interp(np.arange(2000 * hold) / hold, np.arange(2000), samples)[: -hold + 1]
    found = estimate_channel_noise("accel_y", value, np.ones(len(value), bool))
    assert found.hold == hold and f"samples repeat over {hold} rows" in found.text
    if not linear:
        assert found.sd == pytest.approx(0.3 * np.sqrt(hold), rel=0.08)


def test_the_hold_is_that_of_the_samples_and_at_most_its_limit():
    white = draw_white(1.0)
    assert noise._find_hold(white, 1.0) == 1
    assert [noise._find_hold(np.repeat(white, k), 1.0) for k in (3, 10, 40)] == [3, 10, noise.MAX_HOLD]
    assert noise._find_hold(white, 1e5) == noise.MAX_HOLD  # changes below a thousandth of the scale


@pytest.mark.parametrize(
    ("value", "step"),
    [
        (np.tile([0.0, 0.1, 0.2, 0.5], 100), 0.1),  # the median distance
        (np.tile([0.0, 0.1], 4), 0.0),  # each value in fewer than 5 rows
        (np.zeros(100), 0.0),
        (np.append(np.tile([0.0, 0.1], 24), np.arange(52) + 0.37), 0.0),  # in fewer than half of the rows
        (np.append(np.tile([0.0, 0.1], 26), np.arange(48) + 0.37), 0.1),
    ],
)
def test_a_step_is_the_distance_of_values_that_are_frequent_in_half_of_the_rows(value, step):
    assert noise._find_step(value) == pytest.approx(step)


def test_of_a_step_above_the_scatter_its_share_counts_and_a_floor_is_stated():
    stairs = 0.1 * np.round(np.sin(0.002 * np.arange(4000)) / 0.1)
    found = estimate_channel_noise("wheel_speed_rear", stairs + 0.0, EVERY)
    base = 0.1 / np.sqrt(12)
    assert found.sd == pytest.approx(base * np.sqrt(found.hold)) and "steps of 0.1" in found.text
    quiet = estimate_channel_noise("yaw_rate", draw_white(1e-4), EVERY)
    assert quiet.sd == noise.NOISE_FLOOR["yaw_rate"] == 0.001
    assert quiet.unraised == pytest.approx(1e-4, rel=0.1) and "raised to the floor 0.001" in quiet.text


def test_a_wheel_speed_that_varies_much_but_slowly_has_a_new_value_in_each_row():
    """Its changes count, which are below a thousandth of its range."""
    speed = np.linspace(0.0, 100.0, 4000) + draw_white(0.005)
    found = estimate_channel_noise("wheel_speed_front", speed, EVERY)
    assert found.hold == 1 and found.sd == pytest.approx(0.005, rel=0.08)


def test_the_scale_of_a_channel_is_its_median_deviation_or_else_its_sd_or_one():
    assert noise._measure_scale(np.array([0.0, 1, 2, 3, 100])) == 1.0
    mostly = np.array([5.0] * 9 + [15.0])
    assert noise._measure_scale(mostly) == pytest.approx(3.0)
    assert noise._measure_scale(np.full(9, 5.0)) == 1.0


def test_noise_of_a_channel_that_was_interpolated_is_that_of_its_entries_in_motion():
    """An entry lasts four rows; the first tenth of the entries, in which the car stands,
    is rough."""
    t = 0.01 * np.arange(16000)
    own = draw_white(0.3)
    own[:400] *= 8
    own[2000] = np.nan
    log = make_log(t)
    log.slower = {"accel_y": SlowChannel(0.04 * np.arange(4000) + 0.001, own, 4.0)}
    found = estimate_noise(log, "accel_y", t > 16.0)
    assert found.sd == pytest.approx(2 * 0.3, rel=0.06) and found.unraised == found.sd
    assert "one entry per 4 rows: times 2" in found.text
    rough = estimate_noise(log, "accel_y", t < 16.0)
    assert rough.sd == pytest.approx(2 * 8 * 0.3, rel=0.2)
    assert estimate_noise(log, "accel_x", t > 16.0).hold == noise.MAX_HOLD  # of the rows, all 0
    log.slower["accel_y"] = SlowChannel(t[:20], own[:20], 4.0)
    assert estimate_noise(log, "accel_y", t > 16.0) is None


# ---- Misfit of the accelerometers to the kinematics

RADII = (0.30, 0.33)
T = 0.01 * np.arange(12000)
SPEED = 20 + 5 * np.sin(0.3 * T)
RATE = 0.2 * np.sin(0.5 * T)


def drive(speed: np.ndarray = SPEED, **changes: np.ndarray) -> CheckedLog:
    """Return a log whose accelerometers fit the kinematics, except for `changes`."""
    exact = {"accel_x": np.gradient(speed, T), "accel_y": speed * RATE}
    return make_log(
        T,
        wheel_speed_front=speed / RADII[0],
        wheel_speed_rear=speed / RADII[1],
        yaw_rate=RATE,
        **{c: x + changes.get(c, 0.0) for c, x in exact.items()},
    )


@pytest.mark.parametrize("channel", ["accel_x", "accel_y"])
def test_the_misfit_of_white_noise_is_its_sd_in_each_row(channel):
    other = {"accel_x": "accel_y", "accel_y": "accel_x"}[channel]
    found = compute_misfit(drive(**{channel: draw_white(0.4, len(T))}), *RADII)
    # the quantile 0.3 of windows of 10 independent averages is somewhat below the sd
    assert found[channel].sd == pytest.approx(0.4, rel=0.2)
    assert found[other].sd < 0.01 and found[other].bias < 0.01


def test_a_constant_misfit_is_a_bias_of_its_size_and_a_slow_one_walks():
    found = compute_misfit(drive(accel_x=-0.5, accel_y=0.2 * T / T[-1]), *RADII)
    assert found["accel_x"].bias == pytest.approx(0.5, abs=0.02) and found["accel_x"].walk < 0.02
    # a ramp of 0.2 over 120 s: its median is 0.1, its change in 1 s is 0.2 / 120
    ramp = np.linspace(-0.1, 0.1, 1001)
    bias = 0.1 + np.quantile(np.abs(ramp), 0.3) / norm.ppf(0.65)
    assert found["accel_y"].bias == pytest.approx(bias, rel=0.05)
    assert found["accel_y"].walk == pytest.approx(0.2 / 120 / norm.ppf(0.65), rel=0.1)


def test_rows_that_stand_do_not_count_for_the_misfit():
    speed = np.where(T < 100, 0.0, 20.0)
    rough = np.where(T < 99, 30.0 + draw_white(5.0, len(T)), 0.0)
    found = compute_misfit(drive(speed, accel_y=rough), *RADII)
    assert found["accel_y"].sd < 0.05 and found["accel_y"].bias < 0.05 and found["accel_y"].walk < 0.05


def test_a_misfit_needs_the_channel_and_five_windows_in_motion():
    empty = drive(accel_x=np.full(len(T), np.nan))
    assert list(compute_misfit(empty, *RADII)) == ["accel_y"]
    for seconds, known in ((9.0, False), (11.0, True)):
        speed = np.where(seconds > T, 20.0, 0.0)
        assert bool(compute_misfit(drive(speed), *RADII)) == known
    assert compute_misfit(drive(-SPEED), *RADII)  # backwards, the car moves, too
    assert compute_misfit(make_log(np.zeros(1)), *RADII) == {}


def test_gaps_are_filled_by_straight_lines_and_the_ends_by_the_nearest_value():
    nan = np.nan
    x = np.array([nan, 1.0, nan, nan, 4.0, nan])
    assert noise.fill_gaps(x).tolist() == [1, 1, 2, 3, 4, 4]
    assert np.isnan(noise.fill_gaps(np.full(3, nan))).all()


@pytest.mark.parametrize("n", [1, 3, 4])
def test_a_moving_average_has_the_mean_of_the_rows_around_and_keeps_the_length(n):
    x = np.array([1.0, 2, 4, 8, 16, 32])
    before, after = n // 2, n - 1 - n // 2
    wide = np.concatenate([np.full(before, 1.0), x, np.full(after, 32.0)])
    wanted = [wide[i : i + n].mean() for i in range(6)]
    np.testing.assert_allclose(noise.compute_moving_average(x, n), wanted)


def test_the_quiet_sd_is_that_of_the_normal_part():
    assert norm.ppf(0.5 + noise.QUIET_QUANTILE / 2) == pytest.approx(noise.NORMAL_QUIET, abs=1e-4)
    x = draw_white(0.3, 20000)
    x[::5] *= 30
    assert noise._compute_quiet_sd(x) == pytest.approx(0.3, rel=0.35)
    assert noise._compute_quiet_sd(draw_white(0.3, 20000)) == pytest.approx(0.3, rel=0.03)


@pytest.mark.parametrize("first", [1, 11])
def test_new_values_of_a_held_signal_are_every_beat_also_before_the_first_change(first):
    samples = np.round(np.sin(0.37 * np.arange(100)), 3)
    samples[40] = samples[39]  # an equal value is a new sample, too
    value = np.concatenate([np.full(first, samples[0]), np.repeat(samples[1:], 4)])
    wanted = (np.arange(len(value)) - first) % 4 == 0
    wanted[0] = True
    np.testing.assert_array_equal(find_new_values(value), wanted)


def test_equal_samples_of_a_held_signal_count_where_they_are_many_and_at_the_end():
    """A fifth of the samples equals the one before, and so do the last four."""
    samples = np.round(np.sin(0.37 * np.arange(120)), 3)
    samples[3:110:5] = samples[2:109:5]
    samples[-4:] = samples[-5]
    value = np.repeat(samples, 4)
    wanted = np.arange(480) % 4 == 0
    np.testing.assert_array_equal(find_new_values(value), wanted)


def test_changes_of_the_misfit_are_those_between_two_rows_in_motion():
    """While the car stands, accel_y drifts; it stops and starts again every 10 s."""
    speed = np.where(T % 20 < 14, 20.0, 0.0)
    rough = np.where(speed > 0, 0.0, 2.0)
    steady = compute_misfit(drive(speed, accel_y=rough), *RADII)["accel_y"]
    assert steady.walk < 0.02 and steady.sd < 0.02


# ---- Units


@pytest.mark.parametrize(
    ("unit", "wanted", "factor"),
    [
        ("rpm", "rad/s", np.pi / 30),
        ("U/min", "rad/s", np.pi / 30),
        ("deg/s", "rad/s", np.pi / 180),
        ("°/s", "rad/s", np.pi / 180),
        ("dps", "rad/s", np.pi / 180),
        ("unit_DegreOfArcPerSeco", "rad/s", np.pi / 180),
        ("Grad", "rad", np.pi / 180),
        ("[deg]", "rad", np.pi / 180),
        ("", "rad", 1.0),
        ("km/h", "m/s", 1 / 3.6),
        ("km / h", "m/s", 1 / 3.6),
        ("kph", "m/s", 1 / 3.6),
        ("mph", "m/s", 0.44704),
        ("knots", "m/s", 1852 / 3600),
        ("g", "m/s2", 9.80665),
        ("G", "m/s2", 9.80665),
        ("mg", "m/s2", 0.00980665),
        ("m/s²", "m/s2", 1.0),
        ("kNm", "Nm", 1000.0),
        ("N·m", "Nm", 1.0),
        ("ms", "s", 1e-3),
        ("µs", "s", 1e-6),
        ("ns", "s", 1e-9),
        ("min", "s", 60.0),
        ("none", "1", 1.0),
        ("kN", "Nm", None),
        ("g", "m/s", None),
        ("", "m/s", None),  # a number without unit is no speed
        ("rad", "rad/s", None),
        ("Hz", "s", None),
        ("m/s", "m/s2", None),
        ("s", "rad", None),
        ("km^h", "m/s", None),
        ("9^9^9^9", "1", None),
        ("km/h", "rad/s", None),  # without a wheel radius
    ],
)
def test_the_factor_of_a_unit_is_that_to_si(unit, wanted, factor):
    assert unit_factor(unit, wanted) == (factor if factor is None else pytest.approx(factor, rel=1e-9))


def test_a_speed_becomes_a_rate_of_the_wheel_by_its_radius_and_a_rate_stays():
    assert unit_factor("km/h", "rad/s", 0.25) == pytest.approx(4 / 3.6)
    assert unit_factor("rpm", "rad/s", 0.25) == pytest.approx(np.pi / 30)
    assert unit_factor("m/s", "rad/s", 0.0) is None
    assert unit_factor("km/h", "m/s", 0.25) == pytest.approx(1 / 3.6)


@pytest.mark.parametrize(
    ("unit", "kind", "known", "unknown"),
    [
        ("deg", "angle", True, False),
        ("rad", "angle", True, False),
        ("rpm", "rate", True, False),
        ("Hz", "rate", True, False),
        ("mph", "speed", True, False),
        ("mg", "acceleration", True, False),
        ("kNm", "torque", True, False),
        ("µs", "time", True, False),
        ("kN", "other", True, False),
        ("bar", "other", True, False),
        ("%", "other", False, False),
        ("-", "", False, False),
        ("", "", False, False),
        ("(null)", "", False, False),
        ("km^h", "other", False, True),
        ("Kunde", "other", False, True),
    ],
)
def test_a_unit_has_a_kind_and_may_be_unknown(unit, kind, known, unknown):
    assert (unit_kind(unit), is_known_unit(unit), is_unknown_unit(unit)) == (kind, known, unknown)
