"""From channels with their own time to rows, and clocks that are wrong."""

from __future__ import annotations

import numpy as np
import pytest

from tse.impl.clock import BRIDGED, straight
from tse.impl.logs.log import read_log
from tse.impl.logs.mapping import Series
from tse.impl.logs.raster import entries, on_raster, rate_of, resample
from tse.impl.rows import Reading

T = np.arange(0, 20, 0.001)


def test_what_is_above_the_new_rate_does_not_come_down_as_something_slow():
    """A vibration of 97 Hz in a channel of 1 kHz would be 3 Hz at 100 Hz."""
    slow, fast = np.sin(2 * np.pi * 2 * T), np.sin(2 * np.pi * 97 * T)
    time = np.arange(0.5, 19.5, 0.01)
    found = resample(T, slow + fast, time, 100.0)
    assert np.std(found - np.sin(2 * np.pi * 2 * time)) < 0.01
    taken = np.interp(time, T, slow + fast)  # what taking every tenth one would do
    assert np.std(taken - np.sin(2 * np.pi * 2 * time)) > 0.5


@pytest.mark.parametrize(("rate", "hz", "share"), [(10, 1, 0.01), (20, 2, 0.01), (50, 5, 0.01), (100, 10, 0.01)])
def test_a_slow_channel_in_between_is_what_it_was(rate, hz, share):
    t = np.arange(0, 20, 1 / rate)
    time = np.arange(1.0, 19.0, 0.01)
    found = resample(t, np.sin(2 * np.pi * hz * t), time, 100.0)
    assert np.std(found - np.sin(2 * np.pi * hz * time)) < share


def test_a_straight_line_stays_one_to_its_ends():
    time = np.arange(0, 20, 0.01)
    np.testing.assert_allclose(resample(T, 3 * T + 1, time, 100.0), 3 * time + 1, atol=1e-9)


def test_times_that_jitter_are_taken_as_they_are():
    rng = np.random.default_rng(1)
    t = np.arange(0, 20, 0.01) + rng.uniform(-0.003, 0.003, 2000)
    time = np.arange(1, 19, 0.01)
    assert np.std(resample(t, np.sin(2 * np.pi * t), time, 100.0) - np.sin(2 * np.pi * time)) < 1e-4


def test_held_values_are_entries_where_they_are_new():
    held = np.repeat(np.sin(np.arange(0, 20, 0.05)), 5)
    t, x = entries(Series("steer_angle", np.arange(len(held)) * 0.01, held))
    assert rate_of(t) == pytest.approx(20) and len(t) == pytest.approx(400, abs=3)
    at = np.searchsorted(t, 10.0 - 1e-9)
    assert t[at] == pytest.approx(10.0) and x[at] == pytest.approx(np.sin(10.0))


def test_a_value_that_stands_still_is_no_hole():
    """Straight on, the steering wheel shows the same for seconds."""
    x = np.repeat(np.maximum(np.sin(np.arange(0, 60, 0.05)), 0.0), 5)
    t, _ = entries(Series("steer_angle", np.arange(len(x)) * 0.01, x))
    assert np.diff(t).max() < 0.11


def table(**late: float) -> dict[str, Series]:
    """Channels of three rates, of which one has a gap."""
    rates = {"steer_angle": 20, "wheel_speed_front": 50, "wheel_speed_rear": 50, "yaw_rate": 100, "accel_y": 100}
    found = {}
    for name, rate in rates.items():
        t = np.arange(0, 30, 1 / rate)
        if name == "accel_y":
            t = t[(t < 10) | (t > 12)]
        found[name] = Series(name, t, np.sin(t + len(name)), late.get(name, 0.0))
    return found


def test_gaps_stay_gaps_and_only_of_the_channel_that_has_them():
    rows = on_raster(table(), None)
    assert rows.rate == 100 and np.diff(rows.time) == pytest.approx(0.01)
    missing = rows.time[np.isnan(rows.value["accel_y"])]
    assert missing.min() == pytest.approx(10.0, abs=0.02) and missing.max() == pytest.approx(12.0, abs=0.02)
    assert len(missing) == pytest.approx(200, abs=3)
    assert all(np.isfinite(rows.value[n]).all() for n in rows.value if n != "accel_y")


def test_a_gap_of_all_channels_is_no_rows():
    all_gone = {
        n: Series(n, s.time[(s.time < 14) | (s.time > 18)], s.value[(s.time < 14) | (s.time > 18)])
        for n, s in table().items()
    }
    rows = on_raster(all_gone, None)
    assert np.diff(rows.time).max() == pytest.approx(4.0, abs=0.15) and (np.diff(rows.time) > 0.02).sum() == 1


@pytest.mark.parametrize("rate", [10.0, 50.0, 1000.0])
def test_any_rate(rate):
    rows = on_raster(table(), rate)
    assert np.median(np.diff(rows.time)) == pytest.approx(1 / rate)
    good = np.isfinite(rows.value["yaw_rate"])
    assert np.abs(rows.value["yaw_rate"] - np.sin(rows.time + 8))[good].max() < 0.01


def test_an_even_table_is_left_as_it_is():
    t = np.arange(0, 10, 0.02)
    x = {n: Series(n, t, np.random.default_rng(1).standard_normal(len(t))) for n in ("steer_angle", "yaw_rate")}
    rows = on_raster(x, None)
    assert rows.time is t and rows.value["yaw_rate"] is x["yaw_rate"].value and rows.rate == pytest.approx(50)


# ---- clocks


def test_a_good_clock_is_left_alone():
    t = np.array([0.0, 0.01, 0.03, 5.0])
    found, keep, notes = straight(t)
    assert keep.all() and not notes and np.array_equal(found, t)


def test_a_clock_that_wraps_goes_on():
    t = np.arange(0, 20, 0.01)
    found, keep, notes = straight(t % 8.0)
    np.testing.assert_allclose(found, t, atol=1e-9)
    assert keep.all() and "goes back 2 times (first by 7.99 s" in notes[0]


def test_late_entries_are_left_out_and_no_jump():
    t = np.arange(0, 2, 0.01)
    t[[50, 120]] -= 0.035
    found, keep, notes = straight(t)
    assert list(np.flatnonzero(~keep)) == [50, 120] and (np.diff(found) > 0).all()
    assert notes == ["2 entries are out of order: left out"]


def test_a_coarse_clock_is_spread_over_its_ticks():
    t = np.arange(0, 20, 0.01)
    found, keep, notes = straight(np.floor(t * 10) / 10)
    assert keep.all() and np.abs(found - t).max() < 1e-9 and "coarser" in notes[0]


def test_messages_of_a_bus_may_share_a_time():
    t = np.repeat(np.arange(0, 2, 0.01), 3)
    found, keep, notes = straight(t, together=True)
    assert keep.all() and not notes and np.array_equal(found, t)


def test_a_clock_that_is_set_ahead_leaves_a_gap():
    t = np.arange(0, 20, 0.01)
    found, _, notes = straight(np.where(t > 10, t + 1e6, t))
    assert np.diff(found).max() == pytest.approx(BRIDGED) and "jumps ahead by 1e+06 s at 10.000 s" in notes[0]


def test_a_table_at_1_khz_with_held_values_becomes_100_hz_and_rate_is_an_option(drive, tmp_path):
    import pandas as pd

    table = pd.read_csv(drive.log)[:1000]
    fast = table.loc[np.repeat(np.arange(1000), 10)].reset_index(drop=True)
    fast["time"] = np.arange(10000) * 0.001
    fast.to_parquet(tmp_path / "log.parquet")
    log = read_log(tmp_path / "log.parquet")
    assert log.sample_time == pytest.approx(0.01)
    np.testing.assert_allclose(log.data["accel_y"], np.interp(log.time, table.time, table.accel_y), atol=1e-6)
    assert read_log(tmp_path / "log.parquet", reading=Reading(rate=25)).sample_time == pytest.approx(0.04)
