"""Notes and rows of a log are the same for any place of an error and size of chunks."""

import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from conftest import tselab
from log_formats import FORMATS, make_drive, split_messages, write_or_skip
from tse.car.vehicle import read_vehicle
from tse.channels import raster
from tse.channels.log import read_log
from tse.channels.mapping import Series
from tse.channels.raster import find_rate, resample, resample_channels, select_entries
from tse.estimation import estimate
from tse.library.core import Config, library
from tse.library.errors import UserError
from tse.log import rows
from tse.log.clock import BRIDGED_GAP, straighten_time
from tse.log.rows import Reading
from tse.readers.recording import Growing


def read_lines(drive, count: int = 450) -> list[str]:
    return drive.log.read_text().splitlines()[: count + 1]


def read(folder: Path, lines: list[str]):
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n")
    return read_log(path)


def test_blank_rows_are_none_and_count_as_lines(drive, tmp_path):
    lines = read_lines(drive)
    lines[120:140] = [",".join("" for _ in lines[0].split(","))] * 20
    log = read(tmp_path, lines)
    assert len(log) == 430 and list(log.line[118:120]) == [120, 141]


@pytest.mark.parametrize("row", [0, 99, 100, 101, 250, 449])
def test_a_cell_that_is_no_number_is_named_wherever_it_is(drive, tmp_path, row):
    lines = read_lines(drive)
    lines[row + 1] = lines[row + 1].replace(",", ",oops,", 1).rsplit(",", 1)[0]
    log = read(tmp_path, lines)
    assert (
        f"steer_angle: a cell that is no number is treated as missing (first in line {row + 2}: 'oops')"
        in log.notes
    )
    assert list(np.flatnonzero(log.data["steer_angle"].isna())) == [row]


def test_each_column_with_a_wrong_cell_is_named_with_its_first(drive, tmp_path):
    lines = read_lines(drive)
    name = lines[0].split(",")
    for row, column in ((20, "yaw_rate"), (300, "accel_x"), (310, "accel_x")):
        cells = lines[row].split(",")
        cells[name.index(column)] = "x"
        lines[row] = ",".join(cells)
    notes = read(tmp_path, lines).notes
    assert "yaw_rate: a cell that is no number is treated as missing (first in line 21: 'x')" in notes
    assert "accel_x: 2 cells that are no numbers are treated as missing (first in line 301: 'x')" in notes


def test_a_column_of_wrong_cells_is_refused_with_the_first(drive, tmp_path):
    lines = read_lines(drive)
    name = lines[0].split(",").index("accel_x")
    for row in range(300, 340):
        cells = lines[row].split(",")
        cells[name] = "x"
        lines[row] = ",".join(cells)
    with pytest.raises(UserError, match="line 301, column accel_x"):
        read(tmp_path, lines)


@pytest.mark.parametrize("row", [50, 100, 101, 102, 300])
def test_a_row_with_too_many_cells_is_refused_wherever_it_is(drive, tmp_path, row):
    lines = read_lines(drive)
    lines[row] += ",1,2"
    with pytest.raises(
        UserError, match=f"not a well-formed CSV: Expected 13 fields in line {row + 1}, saw 15"
    ):
        read(tmp_path, lines)


def test_a_reference_that_turns_into_text_late_is_left_out(drive, tmp_path):
    lines = read_lines(drive)
    lines[400] = lines[400].rsplit(",", 1)[0] + ",gone"
    log = read(tmp_path, lines)
    assert "column ref_cy_rear is not numeric: not used" in log.notes and "ref_cy_rear" not in log.ref


def test_rows_of_a_part_are_those_of_the_whole(drive, tmp_path):
    log = read(tmp_path, read_lines(drive))
    whole = log.rows()
    parts = np.concatenate([log.rows(first, first + 70) for first in range(0, len(log), 70)])
    assert np.array_equal(whole, parts)


TRACK, RADIUS = 1.5, 0.3


def write_four_wheels(folder, **columns):
    """Write a log of a turning car with four wheels; return the axles' means, rad/s."""
    t = 0.01 * np.arange(400)
    turn = 0.4 * np.sin(t)
    middle = {"wheel_speed_front": 60.0 + t, "wheel_speed_rear": 60.2 + t}
    half = 0.5 * TRACK / RADIUS * turn
    table = {
        "time": t,
        "steer_angle": 0.05 * turn,
        "accel_x": 0 * t,
        "accel_y": 18 * turn + 0.2 * np.cos(t),
        "yaw_rate": turn,
    }
    for axle, speed in middle.items():
        table |= {f"{axle}_left": speed - half, f"{axle}_right": speed + half}
    path = folder / "four.csv"
    pd.DataFrame(table | columns).to_csv(path, index=False)
    return path, middle, table


def test_four_wheels_are_the_middles_of_two_axles(tmp_path):
    path, middle, _ = write_four_wheels(tmp_path)
    log = read_log(path)
    assert list(log.data) == [f.name for f in library().channels]
    for axle, speed in middle.items():
        np.testing.assert_allclose(log.data[axle], speed, atol=1e-12)
    assert log.notes == []


def test_a_wheel_that_is_missing_is_made_up_for_by_the_other_and_the_turn(tmp_path):
    _, middle, table = write_four_wheels(tmp_path)
    left, right = table["wheel_speed_front_left"].copy(), table["wheel_speed_front_right"].copy()
    left[100:150] = right[300:320] = np.nan
    left[200] = right[200] = np.nan
    path, *_ = write_four_wheels(tmp_path, wheel_speed_front_left=left, wheel_speed_front_right=right)
    log = read_log(path)
    expected = np.where(np.arange(400) == 200, np.nan, middle["wheel_speed_front"])
    np.testing.assert_allclose(log.data["wheel_speed_front"], expected, atol=1e-9)
    assert (
        "wheel_speed_front: one of both wheels is missing in 70 rows: its speed is computed from the other "
        "wheel and the yaw rate" in log.notes
    )


def test_the_mean_of_an_axle_comes_before_its_sides_and_one_side_is_no_axle(tmp_path):
    path, *_ = write_four_wheels(tmp_path, wheel_speed_rear=np.full(400, 50.0))
    np.testing.assert_allclose(read_log(path).data["wheel_speed_rear"], 50.0)
    table = pd.read_csv(path).drop(columns="wheel_speed_front_right")
    table.to_csv(path, index=False)
    with pytest.raises(
        UserError,
        match=r"column wheel_speed_front is missing in the header .* instead of the column of an axle",
    ):
        read_log(path)


def test_a_wheel_out_of_range_is_missing_and_named_with_its_side(tmp_path):
    wrong = np.full(400, 60.0)
    wrong[7] = 900.0
    path, *_ = write_four_wheels(tmp_path, wheel_speed_rear_right=wrong)
    log = read_log(path)
    assert (
        "wheel_speed_rear_right: 1 values outside -400 .. 400 rad/s are treated as missing (first in line 9)"
        in log.notes
    )
    assert log.data["wheel_speed_rear"].notna().all()  # the other wheel replaces it


# ---- Very long logs, here those with more than a few rows


def test_of_a_very_long_log_a_part_of_the_rows_is_kept_for_the_verdict_and_all_are_counted(
    drive, monkeypatch
):
    log = read_log(drive.log)
    config = Config.exact(read_vehicle(drive.vehicle).values)
    whole = estimate.estimate_to(None, log, config)
    monkeypatch.setattr(estimate, "MAX_SUMMARY", 700)
    part = estimate.estimate_to(None, log, config)
    assert len(part) == len(whole) == len(log) == 2001 and not part.interrupted
    assert part.statuses == whole.statuses and sum(part.statuses.values()) == 2001
    pd.testing.assert_frame_equal(part.table, whole.table.iloc[::3].reset_index(drop=True))


def test_noise_and_units_of_a_very_long_log_are_those_of_its_liveliest_part(drive):
    log = read_log(drive.log)
    log.data["yaw_rate"] *= 0.01
    log.data.loc[1200:1599, "yaw_rate"] *= 100.0
    part = rows.select_liveliest(log, 400)
    assert len(part) == 400 and part.time[0] == log.time[1200] and part.line[0] == log.line[1200]
    assert np.array_equal(part.data["accel_y"], log.data["accel_y"][1200:1600])
    assert rows.select_liveliest(log, 2001) is log


# ---- Reading in chunks gives the same as reading at once


SECONDS = 30.0
SMALL = 300  # rows of a chunk in these tests


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Return the messages of a drive, and the vehicle file."""
    car = tmp_path_factory.mktemp("long") / "car.toml"
    car.write_text(tselab("vehicle", "--simulated").out, encoding="utf-8")
    return split_messages(make_drive(car, SECONDS).iloc[: round(100 * SECONDS)]), car


@pytest.mark.parametrize("name", FORMATS)
def test_a_log_in_pieces_is_the_log_as_a_whole_to_the_last_bit(name, short, tmp_path, monkeypatch):
    parts, car = short
    path, reading = write_or_skip(name, tmp_path, parts), Reading(car=read_vehicle(car))
    whole = read_log(path, reading=reading)
    in_small_pieces(monkeypatch)
    log = read_log(path, reading=reading)
    assert np.array_equal(log.time, whole.time) and log.notes == whole.notes and log.turn == whole.turn
    for channel in whole.data:
        np.testing.assert_array_equal(log.data[channel], whole.data[channel], err_msg=channel)
    for channel, slower in whole.slower.items():
        assert np.array_equal(log.slower[channel].value, slower.value), channel


def in_small_pieces(monkeypatch) -> None:
    """Use small chunks, as if the log were a hundred times as long."""
    for name in ("channels.raster", "readers.read_can", "readers.read_mdf", "readers.read_text"):
        monkeypatch.setattr(f"tse.{name}.CHUNK_ROWS", SMALL)
    monkeypatch.setattr("tse.readers.read_mat.MAX_BYTES_AT_ONCE", 0)


def test_a_spline_in_pieces_has_the_same_bits(monkeypatch):
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.015, 0.025, 20000))
    x = np.where((t > 100) & (t < 250), 0.0, rng.normal(size=len(t)))  # the spline rings at 0, too
    at = np.arange(t[0], t[-1], 0.01)
    whole = resample(t, x, at, 100.0)
    monkeypatch.setattr(raster, "CHUNK_ROWS", 1500)
    assert np.array_equal(resample(t, x, at, 100.0), whole)


def test_a_column_that_grows_knows_what_is_missing():
    column = Growing()
    for place, value in ((2, 1.0), (2, 2.0), (5, 3.0)):
        column.set(place, value)
    column.set(5, 4.0)
    column.pad(8)
    np.testing.assert_array_equal(column.array(), [np.nan, np.nan, 2.0, np.nan, np.nan, 4.0, np.nan, np.nan])


# ---- From channels with their own times to rows; wrong clocks

T = np.arange(0, 20, 0.001)


def test_what_is_above_the_new_rate_does_not_come_down_as_something_slow():
    """Without a filter, a vibration of 97 Hz at 1 kHz becomes 3 Hz at 100 Hz."""
    slow, fast = np.sin(2 * np.pi * 2 * T), np.sin(2 * np.pi * 97 * T)
    time = np.arange(0.5, 19.5, 0.01)
    found = resample(T, slow + fast, time, 100.0)
    assert np.std(found - np.sin(2 * np.pi * 2 * time)) < 0.01
    taken = np.interp(time, T, slow + fast)  # the result of taking every tenth sample
    assert np.std(taken - np.sin(2 * np.pi * 2 * time)) > 0.5


@pytest.mark.parametrize(
    ("rate", "hz", "share"), [(10, 1, 0.01), (20, 2, 0.01), (50, 5, 0.01), (100, 10, 0.01)]
)
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


def test_a_held_channel_has_its_last_value_and_none_before_the_first():
    t, x = np.array([1.0, 2.0, 5.0]), np.array([10.0, 20.0, 30.0])
    at = np.array([0.99, 1.0, 1.99, 2.0, 4.99, 5.0, 9.0])
    np.testing.assert_array_equal(raster.hold(t, x, at), [np.nan, 10, 10, 20, 20, 30, 30])


def test_a_switch_changes_in_the_row_of_its_entry_and_has_nothing_in_between():
    found = make_channels()
    t = np.arange(0, 30, 0.1)  # ten times slower than the rows
    found["brake"] = Series("brake", t, np.where((t > 9.95) & (t < 14.95), 1.0, 0.0))
    rows = resample_channels(found, None)
    expected = (rows.time > 9.995) & (rows.time < 14.995)
    np.testing.assert_array_equal(rows.value["brake"], expected.astype(float))


def test_held_values_are_entries_where_they_are_new():
    held = np.repeat(np.sin(np.arange(0, 20, 0.05)), 5)
    t, x = select_entries(Series("steer_angle", np.arange(len(held)) * 0.01, held))
    assert find_rate(t) == pytest.approx(20) and len(t) == pytest.approx(400, abs=3)
    at = np.searchsorted(t, 10.0 - 1e-9)
    assert t[at] == pytest.approx(10.0) and x[at] == pytest.approx(np.sin(10.0))


def test_a_value_that_stands_still_is_no_hole():
    """On a straight road, the steering-wheel angle stays the same for seconds."""
    x = np.repeat(np.maximum(np.sin(np.arange(0, 60, 0.05)), 0.0), 5)
    t, _ = select_entries(Series("steer_angle", np.arange(len(x)) * 0.01, x))
    assert np.diff(t).max() < 0.11


def make_channels(**late: float) -> dict[str, Series]:
    """Return channels of three rates; one of them has a gap."""
    rates = {
        "steer_angle": 20,
        "wheel_speed_front": 50,
        "wheel_speed_rear": 50,
        "yaw_rate": 100,
        "accel_y": 100,
    }
    found = {}
    for name, rate in rates.items():
        t = np.arange(0, 30, 1 / rate)
        if name == "accel_y":
            t = t[(t < 10) | (t > 12)]
        found[name] = Series(name, t, np.sin(t + len(name)), late.get(name, 0.0))
    return found


def test_gaps_stay_gaps_and_only_of_the_channel_that_has_them():
    rows = resample_channels(make_channels(), None)
    assert rows.rate == 100 and np.diff(rows.time) == pytest.approx(0.01)
    missing = rows.time[np.isnan(rows.value["accel_y"])]
    assert missing.min() == pytest.approx(10.0, abs=0.02) and missing.max() == pytest.approx(12.0, abs=0.02)
    assert len(missing) == pytest.approx(200, abs=3)
    assert all(np.isfinite(rows.value[n]).all() for n in rows.value if n != "accel_y")


def test_a_gap_of_all_channels_is_no_rows():
    all_gone = {
        n: Series(n, s.time[(s.time < 14) | (s.time > 18)], s.value[(s.time < 14) | (s.time > 18)])
        for n, s in make_channels().items()
    }
    rows = resample_channels(all_gone, None)
    assert np.diff(rows.time).max() == pytest.approx(4.0, abs=0.15) and (np.diff(rows.time) > 0.02).sum() == 1


@pytest.mark.parametrize("count", [0, 1])
def test_channels_of_one_entry_are_a_row_and_of_none_no_row(count):
    found = {
        n: Series(n, s.time[:count] + 1e-3 * k, s.value[:count], 0.01)
        for k, (n, s) in enumerate(make_channels().items())
    }
    rows = resample_channels(found, None)
    assert len(rows.time) == count
    assert {n: x.tolist() for n, x in rows.value.items()} == {n: s.value.tolist() for n, s in found.items()}


@pytest.mark.parametrize("rate", [10.0, 50.0, 1000.0])
def test_any_rate(rate):
    rows = resample_channels(make_channels(), rate)
    assert np.median(np.diff(rows.time)) == pytest.approx(1 / rate)
    good = np.isfinite(rows.value["yaw_rate"])
    assert np.abs(rows.value["yaw_rate"] - np.sin(rows.time + 8))[good].max() < 0.01


def test_an_even_table_is_left_as_it_is():
    t = np.arange(0, 10, 0.02)
    x = {
        n: Series(n, t, np.random.default_rng(1).standard_normal(len(t))) for n in ("steer_angle", "yaw_rate")
    }
    rows = resample_channels(x, None)
    assert rows.time is t and rows.value["yaw_rate"] is x["yaw_rate"].value and rows.rate == pytest.approx(50)


# ---- Clocks


def test_a_good_clock_is_left_alone():
    t = np.array([0.0, 0.01, 0.03, 5.0])
    found, keep, notes = straighten_time(t)
    assert keep.all() and not notes and np.array_equal(found, t)


def test_a_clock_that_wraps_goes_on():
    t = np.arange(0, 20, 0.01)
    found, keep, notes = straighten_time(t % 8.0)
    np.testing.assert_allclose(found, t, atol=1e-9)
    assert keep.all() and "goes back 2 times (first by 7.99 s" in notes[0]


def test_late_entries_are_left_out_and_no_jump():
    t = np.arange(0, 2, 0.01)
    t[[50, 120]] -= 0.035
    found, keep, notes = straighten_time(t)
    assert list(np.flatnonzero(~keep)) == [50, 120] and (np.diff(found) > 0).all()
    assert notes == ["2 entries are out of order: left out"]


def test_many_late_entries_take_no_longer_each_than_a_few():
    t = np.arange(300000) * 0.01
    t[::10] -= 0.025
    begin = time.process_time()
    found, keep, notes = straighten_time(t)
    assert time.process_time() - begin < 8.0 and notes == ["29999 entries are out of order: left out"]
    assert np.array_equal(found, t[keep]) and np.flatnonzero(~keep).tolist() == list(range(10, 300000, 10))


def test_a_coarse_clock_is_spread_over_its_ticks():
    t = np.arange(0, 20, 0.01)
    found, keep, notes = straighten_time(np.floor(t * 10) / 10)
    assert keep.all() and np.abs(found - t).max() < 1e-9 and "too coarse" in notes[0]


def test_messages_of_a_bus_may_share_a_time():
    t = np.repeat(np.arange(0, 2, 0.01), 3)
    found, keep, notes = straighten_time(t, together=True)
    assert keep.all() and not notes and np.array_equal(found, t)


def test_a_clock_that_is_set_ahead_leaves_a_gap():
    t = np.arange(0, 20, 0.01)
    found, _, notes = straighten_time(np.where(t > 10, t + 1e6, t))
    assert (
        np.diff(found).max() == pytest.approx(BRIDGED_GAP)
        and "jumps ahead by 1e+06 s at 10.000 s" in notes[0]
    )


def test_a_table_at_1_khz_with_held_values_becomes_100_hz_and_rate_is_an_option(drive, tmp_path):
    table = pd.read_csv(drive.log)[:1000]
    fast = table.loc[np.repeat(np.arange(1000), 10)].reset_index(drop=True)
    fast["time"] = np.arange(10000) * 0.001
    fast.to_parquet(tmp_path / "log.parquet")
    log = read_log(tmp_path / "log.parquet")
    assert log.sample_time == pytest.approx(0.01)
    np.testing.assert_allclose(log.data["accel_y"], np.interp(log.time, table.time, table.accel_y), atol=1e-6)
    assert read_log(tmp_path / "log.parquet", reading=Reading(rate=25)).sample_time == pytest.approx(0.04)
