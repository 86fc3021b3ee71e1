"""What is done to a log before it is fitted (identify/data.py): the rows that are used,
smoothing, latencies, blocks, noise and the simulation of a log. Logs are made by hand,
so that every expected value is a number of a few rows."""

from pathlib import Path
from typing import ClassVar

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import make_smoothing_spline
from scipy.ndimage import gaussian_filter1d

from tse.identify import data
from tse.identify.data import FitStretch, PreparedLog
from tse.library.core import Config, Replay
from tse.library.errors import UserError
from tse.log.rows import CheckedLog, SlowChannel

RADII = {"wheel_radius_front": 0.30, "wheel_radius_rear": 0.40}
CAR = Config.exact(RADII)
NAMES = ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")


def make_checked(
    time: np.ndarray, extra: dict[str, np.ndarray] | None = None, **columns: object
) -> CheckedLog:
    """Return a log without checks. Channels that are not given are those of a car that
    drives straight on at 12 m/s."""
    plain = {"steer_angle": 0.0, "wheel_speed_front": 40.0, "wheel_speed_rear": 30.0}
    table = {n: np.zeros(len(time)) + np.asarray(columns.get(n, plain.get(n, 0.0))) for n in NAMES}
    return CheckedLog(
        Path("drive.csv"), time, pd.DataFrame(table), pd.DataFrame(), np.arange(len(time)),
        float(np.median(np.diff(time))) if len(time) > 1 else None, extra=pd.DataFrame(extra or {}),
    )  # fmt: skip


def make_prepared(rows: int = 500, step: float = 0.01, **more: object) -> PreparedLog:
    """Return a prepared log with one stretch of all rows, in which the first second is
    not compared. The car drives straight on at 12 m/s."""
    time = step * np.arange(rows)
    inputs = {"steer_angle": 0.0 * time, "wheel_speed_front": 40.0 + 0.0 * time}
    inputs["wheel_speed_rear"] = 30.0 + 0.0 * time
    columns = {
        "path": Path("drive.csv"), "time": time, "inputs": inputs,
        "measured": dict.fromkeys(NAMES[3:], 0.0 * time), "noise": dict.fromkeys(NAMES[3:], 0.01),
        "stretches": [FitStretch(0, rows, time >= 1.0)], "rows_per_block": 4, "distance": 12.0 * time,
    }  # fmt: skip
    return PreparedLog(**(columns | more))


# ---- the rows that are used


def test_a_log_is_prepared_up_to_a_sample_time_of_a_tenth_of_a_second() -> None:
    slow = make_checked(0.1 * np.arange(100))
    slow.sample_time = 0.1
    assert data.prepare(slow, CAR).rows_per_block == 1
    slow.sample_time = 0.101
    with pytest.raises(UserError, match="rows are too far apart"):
        data.prepare(slow, CAR)
    slow.sample_time = None
    with pytest.raises(UserError, match="rows are too far apart"):
        data.prepare(slow, CAR)


@pytest.mark.parametrize(("step", "rows"), [(0.005, 8), (0.01, 4), (0.02, 2), (0.05, 1)])
def test_a_block_lasts_40_ms_at_every_sample_time(step: float, rows: int) -> None:
    log = data.prepare(make_checked(step * np.arange(round(6 / step))), CAR)
    assert log.rows_per_block == rows
    assert log.step == pytest.approx(step)


@pytest.mark.parametrize(
    ("columns", "ends"),
    [
        ({}, [(0, 800)]),
        # 0.40 m x 7.4 rad/s and 0.30 m x 10.1 rad/s: mean 2.995 m/s, both about 3 m/s
        ({"wheel_speed_front": 10.1, "wheel_speed_rear": 7.4}, []),
        ({"wheel_speed_front": 10.1, "wheel_speed_rear": 7.5}, [(0, 800)]),
        ({"wheel_speed_front": -40.0, "wheel_speed_rear": -30.0}, []),  # backwards
        ({"steer_angle": 0.59}, [(0, 800)]),
        ({"steer_angle": 0.61}, []),
        ({"steer_angle": -0.61}, []),
        # 0.4 s without steering angle: the five rows next to a value count as given
        ({"steer_angle": np.where(np.abs(np.arange(800) - 400) < 20, np.nan, 0.0)}, [(0, 384), (415, 799)]),
        ({"wheel_speed_rear": np.where(np.abs(np.arange(800) - 400) < 4, np.nan, 30.0)}, [(0, 800)]),
    ],
)
def test_stretches_are_forward_at_some_speed_with_little_steering_and_no_hole(columns, ends) -> None:
    log = data.prepare(make_checked(0.01 * np.arange(800), **columns), CAR)
    # blocks of 4 rows are cut off at the end
    assert [(s.first, s.last) for s in log.stretches] == ends
    assert any("has no stretch of 3 s" in n for n in log.notes) == (not ends)


def test_a_stretch_ends_at_a_gap_in_time_and_a_short_one_is_not_used() -> None:
    """Gaps of 0.09 and 0.11 s: only the second is a hole. The last part lasts 2.99 s."""
    step = np.full(1301, 0.01)
    step[0], step[301], step[1001] = 0.0, 0.09, 0.11
    good = np.ones(1301, bool)
    found = data._find_stretches(np.cumsum(step), good, 4)
    assert [(s.first, s.last) for s in found] == [(0, 1000)]
    step[695] = 0.11
    good[600] = False  # a row that is no good belongs to no stretch
    found = data._find_stretches(np.cumsum(step), good, 4)
    assert [(s.first, s.last) for s in found] == [(0, 600), (695, 999)]


def test_the_first_second_of_a_stretch_is_not_compared_in_whole_blocks() -> None:
    """1 s is 25 blocks of 4 rows; the block in which it ends is not compared either."""
    good = np.ones(500, bool)
    good[:3] = False
    (found,) = data._find_stretches(0.01 * np.arange(500), good, 4)
    assert (found.first, found.last) == (3, 499)
    assert not found.used[:104].any() and found.used[104:].all() and len(found.used) == 496
    (found,) = data._find_stretches(0.03 * np.arange(500), np.ones(500, bool), 4)
    assert int(np.argmax(found.used)) == 36  # 1.02 s are 34 rows, in the ninth block


def test_a_row_is_in_a_hole_if_it_is_50_ms_from_the_next_value_on_either_side() -> None:
    time, x = 0.02 * np.arange(12), np.ones(12)
    x[3:9] = np.nan  # rows 3 .. 8, values at 0.04 and 0.18 s
    expected = [False] * 5 + [True, True] + [False] * 5
    assert data._find_holes(time, x).tolist() == expected
    x[:3] = np.nan  # nothing before the hole: the next value counts
    assert data._find_holes(time, x).tolist() == [True] * 7 + [False] * 5
    x = np.ones(12)
    x[8:] = np.nan  # and nothing after it
    assert data._find_holes(time, x).tolist() == [False] * 10 + [True, True]


def test_distance_grows_with_the_mean_speed_of_the_axles_and_neither_backwards_nor_over_gaps() -> None:
    time = 0.01 * np.arange(900.0)
    time[600:] += 5.0
    back = np.where(np.arange(900) < 300, 1.0, -1.0)
    log = data.prepare(make_checked(time, wheel_speed_front=40.0, wheel_speed_rear=10.0), CAR)
    speed = 0.5 * (0.3 * 40 + 0.4 * 10)
    assert log.distance[599] == pytest.approx(5.99 * speed)
    assert log.distance[600] - log.distance[599] == pytest.approx(1.0 * speed)  # at most a second
    there = data.prepare(make_checked(time, wheel_speed_front=40 * back, wheel_speed_rear=10 * back), CAR)
    assert there.distance[299] == pytest.approx(2.99 * speed, rel=0.01)
    assert (np.diff(there.distance) >= 0).all() and there.distance[0] == 0.0
    np.testing.assert_allclose(np.diff(there.distance)[320:], 0.0)


def test_time_that_is_compared_is_that_of_the_used_rows_of_all_stretches() -> None:
    used = np.ones(100, bool)
    used[:40] = False
    log = make_prepared(300, 0.02, stretches=[FitStretch(0, 100, used), FitStretch(150, 250, used)])
    assert log.seconds == pytest.approx(2 * 60 * 0.02)
    assert log.name == "drive" and log.channels == list(NAMES[3:])


# ---- channels


def test_a_channel_that_is_missing_is_named_and_becomes_a_column_without_values() -> None:
    time = 0.01 * np.arange(500)
    rng = np.random.default_rng(1)
    log = data.prepare(
        make_checked(
            time, {"gnss_speed": 12 + 0.1 * rng.standard_normal(500)}, accel_y=np.nan, yaw_rate=np.nan,
            accel_x=0.1 * rng.standard_normal(500),
        ),
        CAR,
    )  # fmt: skip
    assert list(log.measured) == ["accel_x", "gnss_speed"]
    assert log.notes == [
        "drive.csv: has no accel_y, yaw_rate: unknowns that only these channels determine keep their prior"
    ]
    whole = data.add_missing_channels(log)
    assert list(whole.measured) == ["accel_x", "accel_y", "yaw_rate", "gnss_speed"]
    assert np.isnan(whole.measured["yaw_rate"]).all() and len(whole.measured["yaw_rate"]) == 500
    np.testing.assert_array_equal(whole.measured["accel_x"], log.measured["accel_x"])


def test_noise_of_each_channel_is_its_own_and_that_of_a_slower_one_that_of_its_entries() -> None:
    """White noise of 0.2, 0.1 and 0.004 while the car moves, ten times as much while it
    is slow: 8.75 rad/s x 0.3 m = 2.6 m/s. 15 %: scatter of 2000 values, of 500 for the
    gyro, which has one entry in four rows, so each row has twice its noise. A velocity
    that is repeated has the noise of its new samples."""
    rng, time = np.random.default_rng(2), 0.01 * np.arange(3000)
    slow = time < 10
    size = np.where(slow, 10.0, 1.0)
    entries = (0.002 * size * rng.standard_normal(3000))[::4]
    log = make_checked(
        time, {"ins_vel_x": np.repeat(0.08 * rng.standard_normal(1000), 3),
               "ins_vel_y": 0.05 * rng.standard_normal(3000)}, yaw_rate=np.interp(time, time[::4], entries),
        accel_x=0.2 * size * rng.standard_normal(3000), accel_y=0.1 * size * rng.standard_normal(3000),
        wheel_speed_front=np.where(slow, -10.0, -40.0), wheel_speed_rear=np.where(slow, -7.5, -30.0),
    )  # fmt: skip
    log.slower["yaw_rate"] = SlowChannel(time[::4], entries, 4.0)
    found = data.prepare(log, CAR).noise
    assert found == pytest.approx(
        {"accel_x": 0.2, "accel_y": 0.1, "yaw_rate": 0.004, "ins_vel_x": 0.08, "ins_vel_y": 0.05}, rel=0.15
    )


def test_only_the_rows_in_which_a_channel_has_a_new_sample_are_compared() -> None:
    rng, time = np.random.default_rng(10), 0.01 * np.arange(800)
    slow, fast = np.repeat(rng.standard_normal(200), 4), rng.standard_normal(800)
    extra = {"ins_vel_x": np.repeat(12 + rng.standard_normal(100), 8)}
    found = data.prepare(make_checked(time, extra, accel_x=fast, accel_y=slow), CAR).measured
    assert np.isfinite(found["accel_x"]).all()
    np.testing.assert_array_equal(found["accel_y"][8::4], slow[8::4])
    assert np.isfinite(found["accel_y"][8:]).mean() == pytest.approx(1 / 4, abs=0.01)
    assert np.isfinite(found["ins_vel_x"][16:]).mean() == pytest.approx(1 / 8, abs=0.01)


def test_noise_that_was_raised_to_its_limit_is_marked_by_how_much() -> None:
    """White noise of 0.02 m/s2 against a limit of 0.05; the other channel is above it."""
    rng, time = np.random.default_rng(3), 0.01 * np.arange(2000)
    white = {c: sd * rng.standard_normal(2000) for c, sd in zip(NAMES[3:], (0.02, 0.2, 0.01), strict=True)}
    log = make_checked(time, **white)
    found = data.prepare(log, CAR)
    assert found.noise["accel_x"] == 0.05
    assert found.quiet == pytest.approx({"accel_x": 0.4}, rel=0.1)


def test_noise_of_few_values_is_hardly_any_and_of_many_that_of_their_second_differences() -> None:
    x = 0.3 * np.random.default_rng(4).standard_normal(4000) + 0.01 * np.arange(4000.0)
    x[::7] = np.nan
    assert data._estimate_noise(x) == pytest.approx(0.3, rel=0.05)
    assert data._estimate_noise(x[:9]) == 1e-6  # 7 values
    steep = 0.3 * np.random.default_rng(5).standard_normal(4000) + np.arange(4000.0)
    assert data._estimate_noise(steep) == pytest.approx(0.3, rel=0.05)


def test_wheel_noise_is_that_of_the_noisier_axle_within_stretches() -> None:
    """20 %: the spline keeps a few percent of the noise, and the first second counts."""
    rng, time = np.random.default_rng(5), 0.01 * np.arange(1200)
    rear = 30 + 0.2 * rng.standard_normal(1200)
    rear[1100:] += rng.standard_normal(100)  # where the car is steered too far
    front = 40 + 0.05 * rng.standard_normal(1200)
    steer = np.where(np.arange(1200) < 1090, 0.0, 0.8)
    log = data.prepare(
        make_checked(time, steer_angle=steer, wheel_speed_front=front, wheel_speed_rear=rear), CAR
    )
    assert log.wheel_noise == pytest.approx(0.2, rel=0.2)
    assert data.prepare(make_checked(time, wheel_speed_front=1.0, wheel_speed_rear=1.0), CAR).wheel_noise == 0


@pytest.mark.parametrize("noisy", ["wheel_speed_front", "wheel_speed_rear"])
def test_wheel_noise_is_that_of_the_axles_alone_where_they_have_values(noisy: str) -> None:
    """The other axle has hardly any noise, the steering more; 3 values are missing."""
    rng, time = np.random.default_rng(6), 0.01 * np.arange(1000)
    columns = {"wheel_speed_front": 40.0, "wheel_speed_rear": 30.0}
    columns = {c: v + 0.01 * rng.standard_normal(1000) for c, v in columns.items()}
    columns[noisy] = columns[noisy] + 0.1 * rng.standard_normal(1000)
    columns[noisy][[300, 500, 501]] = np.nan
    log = data.prepare(make_checked(time, steer_angle=0.3 * rng.standard_normal(1000), **columns), CAR)
    assert len(log.stretches) == 1 and log.wheel_noise == pytest.approx(0.1, rel=0.1)


def test_a_channel_that_repeats_its_samples_is_smoothed_over_the_new_ones() -> None:
    rng, time = np.random.default_rng(13), 0.01 * np.arange(1200)
    value = np.sin(time[::4]) + 0.1 * rng.standard_normal(300)
    held = np.repeat(value, 4)
    expected = data.fit_smoothing_spline(time[::4], value)(time)
    np.testing.assert_allclose(data.smooth_values(time, held)[8:-8], expected[8:-8], atol=0.01)


def test_the_road_of_a_log_is_bank_and_grade_and_level_where_they_are_unknown() -> None:
    time = 0.01 * np.arange(500)
    bank = np.where(time < 2, np.nan, 0.05)
    log = data.prepare(make_checked(time, {"bank": bank, "grade": 0.02 + 0 * time, "brake": 0 * time}), CAR)
    assert set(log.road) == {"bank", "grade"}
    np.testing.assert_array_equal(log.road["bank"], np.where(time < 2, 0.0, 0.05))
    np.testing.assert_array_equal(log.road["grade"], 0.02)


def test_the_age_of_values_is_the_time_since_they_were_new_where_there_are_any() -> None:
    """A value every three rows of 20 ms: 0, 20 and 40 ms old."""
    held = np.repeat(np.random.default_rng(6).standard_normal(200), 3)
    time = 0.02 * np.arange(600)
    assert data._compute_age(time, held) == pytest.approx(0.02)
    assert data._compute_age(time, np.random.default_rng(7).standard_normal(600)) == 0.0
    assert data._compute_age(time, np.full(600, np.nan)) == 0.0
    held[300:] = np.nan  # a row without a value has no age
    assert data._compute_age(time, held) == pytest.approx(0.02)


# ---- smoothing


def test_few_values_or_none_with_noise_are_only_filled_in() -> None:
    time = 0.01 * np.arange(20)
    line = 1.0 + 3.0 * time
    gap = np.where((time > 0.025) & (time < 0.055), np.nan, line)[:10]
    np.testing.assert_allclose(data.smooth_values(time[:10], gap), line[:10], atol=1e-12)
    np.testing.assert_array_equal(data.smooth_values(time, line), line)
    assert data.fit_smoothing_spline(time, line) is None
    noisy = line + 0.1 * np.random.default_rng(8).standard_normal(20)
    assert data.fit_smoothing_spline(time[:7], noisy[:7]) is None
    assert data.fit_smoothing_spline(time, noisy) is not None


def test_a_channel_with_entries_of_its_own_is_smoothed_at_the_rows_and_constant_beyond_them() -> None:
    rng, time = np.random.default_rng(9), 0.01 * np.arange(800)
    own = time[100:700:2]
    value = np.sin(own) + 0.02 * rng.standard_normal(len(own))
    log = make_checked(time, steer_angle=np.interp(time, own, value))
    log.slower["steer_angle"] = SlowChannel(own, value, 2.0)
    found = data._smooth_channel(log, "steer_angle", log.data["steer_angle"].to_numpy())
    inside = slice(110, 690)
    assert np.std(found[inside] - np.sin(time[inside])) < 0.01
    np.testing.assert_array_equal(found[:100], found[100])
    np.testing.assert_array_equal(found[700:], found[700])
    log.slower["steer_angle"] = SlowChannel(own[:3], value[:3], 2.0)  # too few to smooth
    raw = np.where(np.arange(800) == 50, np.nan, np.arange(800.0))
    np.testing.assert_array_equal(data._smooth_channel(log, "steer_angle", raw), np.arange(800.0))


def test_a_smoothed_channel_is_the_natural_spline_of_its_penalty_also_between_the_rows(monkeypatch) -> None:
    """Compare with scipy. Values of a parabola have no noise, so they are kept."""
    rng, time = np.random.default_rng(14), np.cumsum(np.tile([0.01, 0.03, 0.02], 20))
    y = np.sin(3 * time) + 0.1 * rng.standard_normal(60)
    monkeypatch.setattr(data, "_choose_penalty", lambda time, y: 1e-5)
    at = np.linspace(time[0], time[-1], 500)
    expected = make_smoothing_spline(time, y, lam=1e-5)(at)
    np.testing.assert_allclose(data.fit_smoothing_spline(time, y)(at), expected, atol=1e-8)
    assert data.fit_smoothing_spline(time, 3.0 + (0.01 * np.arange(60)) ** 2) is None


@pytest.mark.parametrize(
    ("noise", "walk", "step"), [(0.1, 0.5, 0.01), (0.01, 200.0, 0.001), (1.0, 1.0, 0.05)]
)
def test_the_penalty_of_smoothing_is_the_ratio_of_noise_and_walk(
    noise: float, walk: float, step: float
) -> None:
    """The best penalty is noise^2/walk^2 for a derivative that is a random walk. A factor
    of 4: scatter of 3000 values."""
    rng, n = np.random.default_rng(11), 3000
    x = step * np.cumsum(np.cumsum(walk * np.sqrt(step) * rng.standard_normal(n)))
    found = data._choose_penalty(step * np.arange(n), x + noise * rng.standard_normal(n))
    assert abs(np.log(found / (noise / walk) ** 2)) < np.log(4)


# ---- latencies


def test_a_latency_of_an_input_is_removed_by_reading_the_log_later() -> None:
    """The log has the value of time t in the row of t + L. Beyond the end its last value
    is read."""
    config = Config.exact(RADII | {"steer_angle_latency": 0.03, "accel_y_latency": 0.02,
                                   "wheel_speed_rear_latency": -0.01})  # fmt: skip
    log = make_prepared(200, measured={"accel_y": np.zeros(200)})
    log.inputs["steer_angle"] = log.time**2
    log.inputs["wheel_speed_rear"] = 3 * log.time
    found = data.remove_latencies(log, config)
    np.testing.assert_allclose(found.inputs["steer_angle"][:197], (log.time[:197] + 0.03) ** 2, atol=1e-12)
    np.testing.assert_allclose(found.inputs["steer_angle"][197:], log.time[-1] ** 2, atol=1e-12)
    np.testing.assert_allclose(found.inputs["wheel_speed_rear"][1:], 3 * log.time[:-1], atol=1e-12)
    np.testing.assert_allclose(found.inputs["wheel_speed_front"], 40.0)
    assert found.late == {"accel_y": 0.02}  # what the log measures
    assert data.remove_latencies(log, CAR) is log
    np.testing.assert_allclose(log.read_later("steer_angle", 0.05, slice(10, 20)), found.time[15:25] ** 2)


def test_every_log_loses_the_latencies_of_the_vehicle_file() -> None:
    time = 0.01 * np.arange(400)
    logs = [make_checked(time, steer_angle=k * 0.01 * time) for k in (1, 2)]
    found = data.prepare_all(logs, Config.exact(RADII | {"steer_angle_latency": 0.1}))
    for k, log in enumerate(found, 1):
        np.testing.assert_allclose(log.inputs["steer_angle"][:-10], k * 0.01 * (time[:-10] + 0.1), atol=1e-9)


def test_a_simulated_signal_is_delayed_within_each_stretch() -> None:
    used = np.ones(50, bool)
    log = make_prepared(200, stretches=[FitStretch(10, 60, used), FitStretch(100, 150, used)])
    x = np.arange(200.0)
    found = log.delay(x, 0.02)
    np.testing.assert_allclose(found[12:60], x[10:58])
    np.testing.assert_allclose(found[102:150], x[100:148])
    np.testing.assert_allclose(found[[10, 11, 100, 101]], [10, 10, 100, 100])  # nothing from before it
    assert np.isnan(found[:10]).all() and np.isnan(found[60:100]).all() and np.isnan(found[150:]).all()
    assert log.delay(x, 0.0) is x


def test_rows_from_which_every_latency_leads_into_their_stretch_end_200_ms_before_it() -> None:
    used = np.ones(100, bool)
    log = make_prepared(300, stretches=[FitStretch(20, 120, used), FitStretch(150, 250, used)])
    expected = np.zeros(300)
    expected[20:100] = expected[150:230] = 1.0
    found = data.mark_inside(log)
    # the row exactly 200 ms before the end may count or not, by rounding of its time
    np.testing.assert_array_equal(np.delete(found, [99, 229]), np.delete(expected, [99, 229]))


# ---- blocks


def test_a_block_has_the_mean_of_its_finite_values_and_their_number() -> None:
    used = np.ones(14, bool)
    used[:4] = False
    log = make_prepared(40, stretches=[FitStretch(0, 14, used), FitStretch(20, 34, used)])
    x = np.arange(40.0)
    x[5], x[24:28] = np.nan, np.nan
    mean, count = data.average_blocks(log, x)
    np.testing.assert_allclose(mean, [(4 + 6 + 7) / 3, 9.5, 0.0, 29.5])
    assert count.tolist() == [3, 4, 0, 4]


def test_groups_of_blocks_end_at_a_gap_of_more_than_a_block_and_a_half() -> None:
    time = 0.04 * np.arange(9.0)
    time[3:] += 0.015  # later than usual, but no gap
    time[6:] += 0.03
    assert data.group_blocks(time, np.ones(9, bool), 3).tolist() == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]
    assert data.group_blocks(time, np.ones(9, bool), 4).tolist() == [[0, 1, 2, 3]]
    assert data.group_blocks(time, np.arange(9) > 0, 5).tolist() == [[1, 2, 3, 4, 5]]


# ---- curves


def test_without_a_gyro_or_on_a_straight_road_there_is_no_curve() -> None:
    log = make_prepared(400)
    np.testing.assert_array_equal(data.compute_curve_accel(log, CAR), 0.0)
    log.measured["yaw_rate"] = np.full(400, np.nan)
    np.testing.assert_array_equal(data.compute_curve_accel(log, CAR), 0.0)


def test_the_curve_of_a_road_is_smoothed_over_12_m_and_missing_values_are_bridged() -> None:
    """A car turns to the left from 60 to 100 m, at 12 m/s."""
    log = make_prepared(1400)
    turns = (log.distance > 60) & (log.distance < 100)
    rate = np.where(turns, 0.24, 0.0)
    rate[::3] = np.nan
    rate[[0, -1]] = 0.0
    log.measured["yaw_rate"] = rate
    metres = np.arange(0.0, 168.0)
    curvature = gaussian_filter1d(np.where((metres > 60) & (metres < 100), 0.02, 0.0), 12.0)
    expected = 144.0 * np.interp(log.distance, metres, curvature)
    np.testing.assert_allclose(data.compute_curve_accel(log, CAR), expected, atol=0.1)
    assert data.compute_curve_accel(log, CAR).max() > 2.5
    slow = make_prepared(1400, inputs={k: x / 12 for k, x in log.inputs.items()}, measured=log.measured)
    # at 1 m/s the curvature is that at 3 m/s, the least speed at which a car is simulated
    found = data.compute_curve_accel(slow, CAR)
    np.testing.assert_allclose(found, expected / 12 * 3, atol=0.05)


# ---- simulation of a log


class Seen:
    """Stands in for Replay, and keeps what it was given."""

    calls: ClassVar[list[tuple[dict, dict]]] = []

    def __init__(self, channels: tuple[str, ...], **inputs: np.ndarray):
        self.channels, self.inputs = channels, inputs

    def run(self, config: Config, **start: float) -> dict[str, np.ndarray]:
        self.calls.append((self.inputs, start))
        return {c: 100.0 * k + np.arange(len(self.inputs["dt"])) for k, c in enumerate(self.channels)}


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[tuple[dict, dict]]:
    monkeypatch.setattr(data, "Replay", Seen)
    monkeypatch.setattr(Seen, "calls", [])
    return Seen.calls


def test_each_stretch_is_simulated_from_its_own_row_time_and_yaw_rate(seen) -> None:
    used = np.ones(50, bool)
    log = make_prepared(300, stretches=[FitStretch(10, 60, used), FitStretch(100, 150, used)])
    log.time = log.time + 7.0
    log.measured["yaw_rate"] = np.where(np.arange(300) == 100, np.nan, 0.001 * np.arange(300))
    log.inputs["steer_angle"] = np.arange(300.0)
    profiles = {"bank": 0.1 * np.ones(300)}
    log.road = {"bank": 0.001 * np.arange(300), "grade": np.full(300, 0.02)}
    found = data.simulate(CAR, log, ("accel_y", "yaw_rate"), {"cy_front": 1.2}, profiles)
    (first, start), (second, later) = seen
    assert start == pytest.approx({"yaw_rate": 0.01, "time": 0.1, "cy_front": 1.2})
    assert later == pytest.approx({"yaw_rate": 0.0, "time": 1.0, "cy_front": 1.2})
    np.testing.assert_array_equal(second["steer_angle"], np.arange(100.0, 150.0))
    np.testing.assert_allclose(first["dt"], 0.01)
    np.testing.assert_allclose(second["bank"], 0.1 + 0.001 * np.arange(100, 150))
    np.testing.assert_allclose(second["grade"], 0.02)
    np.testing.assert_array_equal(found["yaw_rate"][100:150], 100.0 + np.arange(50))
    assert np.isnan(found["accel_y"][60:100]).all() and np.isnan(found["accel_y"][:10]).all()
    del log.measured["yaw_rate"]
    data.simulate(CAR, log, ("accel_y",), {}, {})
    assert [s["yaw_rate"] for _, s in seen[2:]] == [0.0, 0.0]


def test_an_input_is_read_later_by_its_latency_and_an_output_is_delayed_by_both(seen) -> None:
    log = make_prepared(200, late={"accel_y": 0.02}, stretches=[FitStretch(50, 150, np.ones(100, bool))])
    log.inputs["steer_angle"] = log.time.copy()
    found = data.simulate(CAR, log, ("accel_x", "accel_y"), {}, {}, {"steer_angle": 0.03, "accel_y": 0.01})
    np.testing.assert_allclose(seen[0][0]["steer_angle"], log.time[53:153], atol=1e-12)
    np.testing.assert_allclose(found["accel_y"][53:150], 100.0 + np.arange(97), atol=1e-9)
    np.testing.assert_array_equal(found["accel_x"][50:150], np.arange(100.0))


def test_a_stretch_that_diverges_is_far_off_and_the_others_are_as_they_were(monkeypatch) -> None:
    used = np.ones(50, bool)
    log = make_prepared(200, stretches=[FitStretch(0, 50, used), FitStretch(100, 150, used)])
    log.inputs["steer_angle"] = np.where(np.arange(200) < 80, 0.0, 0.01)
    plain = Replay.run

    def refuse(self: Replay, config: Config, **start: float) -> dict[str, np.ndarray]:
        if start["time"] > 0.5:
            raise UserError("replay refused row 7")
        return plain(self, config, **start)

    before = data.simulate(CAR, log, ("yaw_rate",), {}, {})["yaw_rate"]
    monkeypatch.setattr(Replay, "run", refuse)
    after = data.simulate(CAR, log, ("yaw_rate",), {}, {})["yaw_rate"]
    np.testing.assert_array_equal(after[:100], before[:100])
    np.testing.assert_array_equal(after[100:150], data.DIVERGED)
