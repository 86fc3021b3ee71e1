"""Entries of channels to common rows, step by step: entries, rate, times, values."""

from pathlib import Path

import numpy as np
import pytest

from tse.channels import raster
from tse.channels.mapping import Series
from tse.channels.raster import (
    choose_rate,
    find_longest_gap,
    find_rate,
    resample,
    select_entries,
    start_on_beat,
)
from tse.library.errors import UserError

NAN = np.nan


def test_entries_are_the_new_values_and_those_of_a_burst_their_mean() -> None:
    t = np.arange(40) * 0.1
    x = np.sin(1.7 * np.arange(40)) + 3.0
    x[5] = NAN
    time, value = select_entries(Series("accel_y", t, x))
    assert time.tolist() == np.delete(t, 5).tolist() and value.tolist() == np.delete(x, 5).tolist()
    burst = np.array([*t[:10], 0.91, 0.924, *t[10:]])
    both = np.array([*x[:10], 7.0, 2.0, *x[10:]])
    time, value = select_entries(Series("accel_y", burst, both))
    at = int(np.argmin(np.abs(time - 0.9)))
    assert len(time) == 39  # 0.9, 0.91 and 0.924 s are one entry
    assert time[at] == pytest.approx((0.9 + 0.91 + 0.924) / 3)
    assert value[at] == pytest.approx((x[9] + 7.0 + 2.0) / 3)
    more = np.append(burst, 2.03)  # 0.3 steps after 2.0 s is no burst
    order = np.argsort(more)
    assert len(select_entries(Series("accel_y", more[order], np.append(both, 9.0)[order]))[0]) == 40


@pytest.mark.parametrize("hold", [True, False])
def test_held_channels_keep_their_repetitions(hold: bool) -> None:
    x = np.repeat(np.sin(1.7 * np.arange(60)), 4)
    t = np.arange(240) * 0.01
    time, value = select_entries(Series("accel_y", t, x, hold=hold))
    assert len(time) == (240 if hold else 60)
    assert np.array_equal(value, x if hold else x[::4]) and time[1] == pytest.approx(0.01 if hold else 0.04)


@pytest.mark.parametrize(
    ("time", "rate"),
    [([0.0, 0.1, 0.2, 0.3, 5.0], 10.0), ([0, 0, 0.5, 0.5, 1.0], 2.0), ([3.0], 0.0), ([], 0.0), ([2, 2], 0.0)],
)
def test_a_rate_is_that_of_the_median_step_that_is_not_0(time: list[float], rate: float) -> None:
    assert find_rate(np.array(time, float)) == pytest.approx(rate)


@pytest.mark.parametrize(
    ("rates", "rate"),
    [
        ([20.0, 50.0, 10.0], 50.0),
        ([1000.0, 50.0], 100.0),
        ([4.9, 1.0], 10.0),
        ([5.0, 1.0], 5.0),
        ([], 10.0),
        ([49.4], 49),
        ([12.5], 12.5),
        ([99.7], 100),
    ],
)
def test_the_rate_of_the_rows_is_that_of_the_fastest_channel(rates: list[float], rate: float) -> None:
    assert choose_rate(rates) == rate


@pytest.mark.parametrize(
    ("usual", "longest"), [(0.01, 0.25), (0.1, 0.6), (0.3, 1.0), (0.5, 1.25), (2.0, 5.0), (0.04, 0.25)]
)
def test_a_step_is_a_gap_by_the_median_step(usual: float, longest: float) -> None:
    assert find_longest_gap(usual) == pytest.approx(longest)


def test_core_channels_are_inputs_and_measurements_also_of_one_wheel() -> None:
    names = ("steer_angle", "wheel_speed_front", "wheel_speed_rear_left", "accel_x", "yaw_rate")
    assert all(raster.is_core(n) for n in names)
    assert not any(raster.is_core(n) for n in ("vehicle_speed", "brake", "ins_vel_x", "ref_cy"))


def test_rows_at_most_half_a_step_outside_the_entries_have_the_value_at_the_end() -> None:
    t = np.arange(1.0, 3.01, 0.1)
    found = resample(t, t.copy(), np.array([0.94, 0.96, 1.0, 2.05, 3.0, 3.04, 3.06]), 10.0)
    np.testing.assert_allclose(found, [NAN, 1.0, 1.0, 2.05, 3.0, 3.0, NAN], atol=1e-9)
    assert np.isnan(resample(t[:0], t[:0], t, 10.0)).all()
    np.testing.assert_array_equal(
        resample(t[:1], t[:1], np.array([0.9, 0.96, 1.04, 1.2]), 10.0), [NAN, 1, 1, NAN]
    )


def test_rows_in_a_gap_are_missing_and_those_in_a_shorter_step_are_not() -> None:
    t = np.array([0.0, 0.1, 0.2, 0.3, 0.9, 1.0, 1.1, 1.2, 1.9, 2.0, 2.1, 2.2])  # 0.6 s, 0.7 s
    rows = np.arange(0.0, 2.21, 0.05)
    found = resample(t, 2.0 * t, rows, 20.0)
    gone = np.isnan(found)
    assert rows[gone].min() == pytest.approx(1.3) and rows[gone].max() == pytest.approx(1.8)
    np.testing.assert_allclose(found[~gone], np.clip(2 * rows, 0, None)[~gone], atol=0.11)


def test_cubics_are_exact_for_a_cubic() -> None:
    t = np.arange(2.0, 5.0, 0.1)
    at = np.linspace(2.0, t[-1], 77)
    cubic = np.array([0.7, -2.0, 0.5, 3.0])
    for function in (raster._interpolate_cubic, raster._interpolate_spline):
        np.testing.assert_allclose(function(t, np.polyval(cubic, t), at), np.polyval(cubic, at), rtol=1e-9)
    three = raster._interpolate_spline(t[:3], t[:3] ** 2, np.array([2.05]))
    assert three[0] == pytest.approx(0.5 * (2.0**2 + 2.1**2))  # linear
    same = np.array([0.0, 1.0, 1.0, 2.0, 3.0, 4.0])
    np.testing.assert_allclose(raster._interpolate_spline(same, same**2, np.array([0.5, 2.5])), [0.25, 6.25])


def test_a_cubic_is_through_the_two_entries_before_and_the_two_after() -> None:
    """The error for s^4 is then s (s - 1) (s - 2) (s - 3), s in 1 .. 2: at most 9/16."""
    t = np.arange(30.0)
    at = np.linspace(1.0, 28.0, 500)
    off = raster._interpolate_cubic(t, (t - 15.0) ** 4, at) - (at - 15.0) ** 4
    assert np.abs(off).max() == pytest.approx(9 / 16, rel=0.01)
    ends = np.array([0.4, 28.6])  # the four entries at the end
    off = raster._interpolate_cubic(t, (t - 15.0) ** 4, ends) - (ends - 15.0) ** 4
    assert np.abs(off) == pytest.approx(0.4 * 0.6 * 1.6 * 2.6)


def test_the_low_pass_passes_what_the_rows_can_hold_without_a_delay() -> None:
    t = np.arange(0.0, 10.0, 0.001)
    for hz, gain in ((5.0, 1.0), (30.0, 1.0), (60.0, 0.0), (200.0, 0.0)):
        even, x = raster._filter_low_pass(t, np.sin(2 * np.pi * hz * t), 0.001, 100.0)
        inner = slice(500, -500)
        np.testing.assert_allclose(even, t, atol=1e-9)
        np.testing.assert_allclose(x[inner], gain * np.sin(2 * np.pi * hz * t)[inner], atol=0.01)
    gone = np.r_[t[:3000], t[3007:]]  # some entries are missing: the step stays 1 ms
    even, x = raster._filter_low_pass(gone, 2.0 * gone, 0.001, 100.0)
    assert len(even) == len(t) and np.abs(x - 2.0 * even).max() < 1e-9


def test_a_measurement_is_in_the_row_nearest_to_it_and_not_in_a_row_beyond_the_step() -> None:
    time = np.array([0.0, 0.1, 0.2, 0.3])
    entries = np.array([-0.2, 0.04, 0.16, 0.26, 0.39])
    found = raster._place_entries(entries, np.arange(5.0), time)
    np.testing.assert_array_equal(found, [1.0, NAN, 2.0, 4.0])  # 0.39 s: the last row, within a step
    np.testing.assert_array_equal(raster._place_entries(entries[:1], np.ones(1), time), [NAN] * 4)
    np.testing.assert_array_equal(raster._place_entries(entries[1:2], np.ones(1), time[:1]), [1.0])


@pytest.mark.parametrize(
    ("first", "rates", "start"),
    [
        (0.52, {"yaw_rate": 100.0, "accel_y": 50.0}, 0.523),  # on an entry of the yaw rate
        (0.52, {"yaw_rate": 50.0, "accel_y": 100.0}, 0.526),
        (0.52, {"yaw_rate": 50.0, "accel_y": 50.0}, 0.52),
        (0.2, {"yaw_rate": 100.0, "accel_y": 100.0}, 0.203),
        (5.0, {"yaw_rate": 100.0, "accel_y": 100.0}, 5.003),  # after its last entry
        (0.525, {"yaw_rate": 101.0, "accel_y": 50.0}, 0.533),
        (0.525, {"yaw_rate": 103.0, "accel_y": 50.0}, 0.525),
    ],
)
def test_the_first_row_is_a_whole_number_of_steps_from_an_entry(first, rates, start) -> None:
    times = {"accel_y": 0.006 + np.arange(50, 150) * 0.01, "yaw_rate": 0.003 + np.arange(50, 150) * 0.01}
    found = start_on_beat(times, rates, 100.0, first)
    assert found == pytest.approx(start, abs=1e-6)


def make(**rates: float) -> dict[str, Series]:
    """Return channels with these rates, which are sine waves. All end at 10 s."""
    found = {}
    for name, rate in rates.items():
        t = np.arange(0.0, 10.0, 1.0 / rate)
        found[name] = Series(name, t, np.sin(t + len(name)))
    return found


FULL = {"steer_angle": 20, "wheel_speed_front": 50, "wheel_speed_rear": 50, "yaw_rate": 100}


def test_rows_cover_the_time_in_which_all_inputs_are_there() -> None:
    found = make(**FULL)
    for name, first, last in (
        ("steer_angle", 2.0, 9.0),
        ("wheel_speed_rear", 1.0, 8.0),
        ("yaw_rate", 3.0, 7.0),
    ):
        s = found[name]
        part = (s.time >= first - 1e-9) & (s.time <= last + 1e-9)
        found[name] = Series(name, s.time[part], s.value[part])
    rows = raster.resample_channels(found, None)
    assert (rows.time[0], rows.time[-1], rows.rate) == (pytest.approx(2.0), pytest.approx(8.0), 100.0)
    assert np.isnan(rows.value["yaw_rate"][rows.time < 2.99]).all()
    found["steer_angle"] = Series("steer_angle", np.array([0.0, 0.1]), np.zeros(2))
    apart = raster.resample_channels(found, None)  # the inputs have no time in common
    assert (apart.time[0], apart.time[-1]) == (pytest.approx(0.0), pytest.approx(10.0, abs=0.03))


def test_original_entries_are_kept_of_channels_slower_than_the_rows() -> None:
    found = make(**FULL, vehicle_speed=10, ins_vel_x=10)
    found["steer_angle"] = Series(
        "steer_angle", found["steer_angle"].time, found["steer_angle"].value, hold=True
    )
    rows = raster.resample_channels(found, None)
    assert set(rows.native) == {"wheel_speed_front", "wheel_speed_rear", "vehicle_speed"}
    t, x, rate = rows.native["wheel_speed_front"]
    assert np.array_equal(t, found["wheel_speed_front"].time) and rate == pytest.approx(50)
    assert np.array_equal(x, found["wheel_speed_front"].value)
    given = np.isfinite(rows.value["ins_vel_x"])
    assert given.sum() == 100  # each measurement once
    np.testing.assert_allclose(rows.time[given], np.arange(100) * 0.1, atol=1e-9)
    held = rows.value["steer_angle"][(rows.time > 1.005) & (rows.time < 1.045)]
    assert set(held) == {np.sin(1.0 + 11)}


def test_notes_name_the_rates_from_the_fastest_and_the_latencies_in_ms() -> None:
    found = make(steer_angle=20, yaw_rate=100)
    found["steer_angle"] = Series("steer_angle", found["steer_angle"].time, found["steer_angle"].value, 0.035)
    rows = raster.resample_channels(found, None)
    assert rows.notes == [
        "resampled to 100 Hz (yaw_rate: 100 Hz; steer_angle: 20 Hz)",
        "moved earlier by their latency: steer_angle 35 ms",
    ]
    assert (
        raster.resample_channels(make(steer_angle=20, yaw_rate=100), 50.0)
        .notes[0]
        .startswith("resampled to 50 Hz")
    )


def make_table(rate: float = 50.0, **change) -> dict[str, Series]:
    """Return the columns of a table."""
    t = np.arange(0.0, 10.0, 1.0 / rate)
    found = {n: Series(n, t, np.sin(1.7 * np.arange(len(t)) + len(n))) for n in ("steer_angle", "yaw_rate")}
    s = found["yaw_rate"]
    values = {"time": s.time, "value": s.value, "latency": 0.0, "hold": False} | change
    return found | {"yaw_rate": Series("yaw_rate", **values)}


@pytest.mark.parametrize(
    ("change", "rate", "is_kept"),
    [
        ({}, None, True),
        ({}, 50.0, True),
        ({}, 50.4, True),  # within 1 %
        ({}, 51.0, False),
        ({"time": np.arange(500) * 0.02}, None, True),  # equal times in another array
        ({"time": np.arange(500) * 0.02 + 0.001}, None, False),
        ({"latency": 0.01}, None, False),
        ({"hold": True}, None, False),
        ({"value": np.where(np.arange(500) % 5 == 0, np.arange(500.0), NAN)}, None, False),  # slower
        ({"value": np.where(np.arange(500) < 300, np.arange(500.0), NAN)}, None, True),  # it ends
        ({"value": np.full(500, NAN)}, None, True),
    ],
)
def test_a_table_is_kept_if_its_rows_are_those_wanted(
    change: dict, rate: float | None, is_kept: bool
) -> None:
    found = make_table(**change)
    kept = raster._keep_table(found, rate)
    assert (kept is not None) is is_kept
    if kept is not None:
        assert kept.time is found["steer_angle"].time and kept.rate == pytest.approx(50)


@pytest.mark.parametrize(
    ("own", "rate", "is_kept"), [(150, None, True), (160, None, False), (160, 160, True)]
)
def test_a_fast_table_is_kept_only_if_its_rate_is_asked_for(
    own: float, rate: float | None, is_kept: bool
) -> None:
    assert (raster._keep_table(make_table(own), rate) is not None) is is_kept


def test_a_velocity_that_is_slower_than_its_table_does_not_change_the_rows() -> None:
    found = make_table()
    value = np.where(np.arange(500) % 5 == 0, 1.0, NAN)
    found["ins_vel_x"] = Series("ins_vel_x", found["steer_angle"].time, value)
    assert raster._keep_table(found, None) is not None
    assert raster._keep_table({}, None) is None


def test_a_file_of_few_bytes_has_no_ten_million_rows(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("x" * 1000)
    found = {"steer_angle": Series("steer_angle", np.array([0.0, 1e5]), np.array([1.0, 2.0]))}
    with pytest.raises(UserError, match="from its first to its last value at 100 Hz it has 10,000,001 rows"):
        raster.resample_channels(found, 100.0, path)


def test_one_wheel_determines_the_rate_and_a_brake_is_a_switch() -> None:
    found = make(steer_angle=20, wheel_speed_rear_left=50, wheel_speed_rear_right=50, yaw_rate=20, brake=10)
    s = found["brake"]
    found["brake"] = Series("brake", s.time, np.floor(s.time) % 2)
    rows = raster.resample_channels(found, None)
    assert rows.rate == 50.0
    np.testing.assert_array_equal(rows.value["brake"], np.floor(rows.time + 1e-9) % 2)


def test_rows_that_only_an_optional_channel_has_are_left_out() -> None:
    found = make(**FULL, vehicle_speed=10)
    for name in FULL:
        s = found[name]
        part = (s.time < 4.0) | (s.time > 6.0)
        found[name] = Series(name, s.time[part], s.value[part])
    rows = raster.resample_channels(found, None)
    assert not ((rows.time > 4.1) & (rows.time < 5.9)).any() and len(rows.time) > 700


def test_a_channel_twice_as_fast_as_the_rows_is_low_passed_and_times_may_jitter() -> None:
    t = np.arange(0.0, 4.0, 0.005)
    rows = np.arange(0.5, 3.5, 0.01)
    assert np.abs(resample(t, np.sin(2 * np.pi * 80.0 * t), rows, 100.0)).max() < 0.05
    t = np.arange(3000) * 0.001
    late = t + 3e-4 * np.sin(37.0 * t)
    even, x = raster._filter_low_pass(late, 2.0 * late, 0.001, 100.0)
    np.testing.assert_allclose(x, 2.0 * even, atol=1e-6)


def test_rows_and_entries_coincide_also_where_times_are_rounded() -> None:
    tenths = 0.1 + 0.2  # it is above 0.3
    assert raster.hold(np.array([0.0, tenths]), np.array([1.0, 2.0]), np.array([0.3])).tolist() == [2.0]
    t = np.array([0.2, 0.3, 0.4, 0.5, 0.6])
    time = raster._make_times({"yaw_rate": (t, t)}, {"yaw_rate": 10.0}, ["yaw_rate"], 10.0, None)
    np.testing.assert_allclose(time, t)
    assert start_on_beat({"yaw_rate": np.array([0.1])}, {"yaw_rate": 10.0}, 10.0, 0.8) == pytest.approx(0.8)
