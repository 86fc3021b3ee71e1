"""A log is read in parts: what is said of it, and what comes out, does not depend on where the parts end."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from conftest import tselab
from log_formats import FORMATS, drive, messages
from tse.impl import estimate, rows
from tse.impl.core import Config, library
from tse.impl.errors import UserError
from tse.impl.logs import log as module
from tse.impl.logs import raster
from tse.impl.logs.log import read_log
from tse.impl.logs.recording import Growing
from tse.impl.rows import Reading
from tse.impl.vehicle import read_vehicle

HERE = 100  # rows of a part in these tests


@pytest.fixture
def short_parts(monkeypatch):
    monkeypatch.setattr(module, "PART", HERE)


def lines_of(drive, count: int = 450) -> list[str]:
    return drive.log.read_text().splitlines()[: count + 1]


def read(folder: Path, lines: list[str]):
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n")
    return read_log(path)


def test_a_log_in_parts_is_the_log_as_a_whole(drive, tmp_path, monkeypatch):
    lines = lines_of(drive)
    lines[120:140] = [",".join("" for _ in lines[0].split(","))] * 20  # blank
    whole = read(tmp_path, lines)
    monkeypatch.setattr(module, "PART", HERE)
    parts = read(tmp_path, lines)
    assert np.array_equal(whole.time, parts.time) and np.array_equal(whole.line, parts.line)
    pd.testing.assert_frame_equal(whole.data, parts.data)
    pd.testing.assert_frame_equal(whole.ref, parts.ref)
    assert whole.notes == parts.notes and len(parts) == 430 and list(parts.line[118:120]) == [120, 141]


@pytest.mark.parametrize("row", [0, 99, 100, 101, 250, 449])
def test_a_cell_that_is_no_number_is_named_wherever_it_is(drive, tmp_path, short_parts, row):
    lines = lines_of(drive)
    lines[row + 1] = lines[row + 1].replace(",", ",oops,", 1).rsplit(",", 1)[0]
    log = read(tmp_path, lines)
    assert f"steer_angle: a cell that is no number is treated as missing (first in line {row + 2}: 'oops')" in log.notes
    assert list(np.flatnonzero(log.data["steer_angle"].isna())) == [row]


def test_each_column_with_a_wrong_cell_is_named_with_its_first(drive, tmp_path, short_parts):
    lines = lines_of(drive)
    name = lines[0].split(",")
    for row, column in ((20, "yaw_rate"), (300, "accel_x"), (310, "accel_x")):
        cells = lines[row].split(",")
        cells[name.index(column)] = "x"
        lines[row] = ",".join(cells)
    notes = read(tmp_path, lines).notes
    assert "yaw_rate: a cell that is no number is treated as missing (first in line 21: 'x')" in notes
    assert "accel_x: 2 cells that are no numbers are treated as missing (first in line 301: 'x')" in notes


def test_a_column_of_wrong_cells_is_refused_with_the_first(drive, tmp_path, short_parts):
    lines = lines_of(drive)
    name = lines[0].split(",").index("accel_x")
    for row in range(300, 340):
        cells = lines[row].split(",")
        cells[name] = "x"
        lines[row] = ",".join(cells)
    with pytest.raises(UserError, match="line 301, column accel_x"):
        read(tmp_path, lines)


@pytest.mark.parametrize("row", [50, 100, 101, 102, 300])
def test_a_row_with_too_many_cells_is_refused_wherever_it_is(drive, tmp_path, short_parts, row):
    lines = lines_of(drive)
    lines[row] += ",1,2"
    with pytest.raises(UserError, match=f"not a well-formed CSV: Expected 13 fields in line {row + 1}, saw 15"):
        read(tmp_path, lines)


def test_a_reference_that_turns_into_text_late_is_left_out(drive, tmp_path, short_parts):
    lines = lines_of(drive)
    lines[400] = lines[400].rsplit(",", 1)[0] + ",gone"
    log = read(tmp_path, lines)
    assert "column ref_cy_rear is not numeric: not used" in log.notes and "ref_cy_rear" not in log.ref


def test_rows_of_a_part_are_those_of_the_whole(drive, tmp_path):
    log = read(tmp_path, lines_of(drive))
    whole = log.rows()
    parts = np.concatenate([log.rows(first, first + 70) for first in range(0, len(log), 70)])
    assert np.array_equal(whole, parts)


TRACK, RADIUS = 1.5, 0.3


def four_wheels(folder, **columns):
    """A log with four wheel speeds of a car that turns, and the speeds of the middles of both axles, rad/s."""
    t = 0.01 * np.arange(400)
    turn = 0.4 * np.sin(t)
    middle = {"wheel_speed_front": 60.0 + t, "wheel_speed_rear": 60.2 + t}
    half = 0.5 * TRACK / RADIUS * turn
    table = {"time": t, "steer_angle": 0.05 * turn, "accel_x": 0 * t, "accel_y": 18 * turn, "yaw_rate": turn}
    for axle, speed in middle.items():
        table |= {f"{axle}_left": speed - half, f"{axle}_right": speed + half}
    path = folder / "four.csv"
    pd.DataFrame(table | columns).to_csv(path, index=False)
    return path, middle, table


def test_four_wheels_are_the_middles_of_two_axles(tmp_path):
    path, middle, _ = four_wheels(tmp_path)
    log = read_log(path)
    assert list(log.data) == [f.name for f in library().channels]
    for axle, speed in middle.items():
        np.testing.assert_allclose(log.data[axle], speed, atol=1e-12)
    assert log.notes == []


def test_a_wheel_that_is_missing_is_made_up_for_by_the_other_and_the_turn(tmp_path):
    _, middle, table = four_wheels(tmp_path)
    left, right = table["wheel_speed_front_left"].copy(), table["wheel_speed_front_right"].copy()
    left[100:150] = right[300:320] = np.nan
    left[200] = right[200] = np.nan
    path, *_ = four_wheels(tmp_path, wheel_speed_front_left=left, wheel_speed_front_right=right)
    log = read_log(path)
    expected = np.where(np.arange(400) == 200, np.nan, middle["wheel_speed_front"])
    np.testing.assert_allclose(log.data["wheel_speed_front"], expected, atol=1e-9)
    assert (
        "wheel_speed_front: one of both wheels is missing in 70 rows: taken from the other and the yaw rate"
        in log.notes
    )


def test_the_mean_of_an_axle_comes_before_its_sides_and_one_side_is_no_axle(tmp_path):
    path, *_ = four_wheels(tmp_path, wheel_speed_rear=np.full(400, 50.0))
    np.testing.assert_allclose(read_log(path).data["wheel_speed_rear"], 50.0)
    table = pd.read_csv(path).drop(columns="wheel_speed_front_right")
    table.to_csv(path, index=False)
    with pytest.raises(
        UserError, match=r"column wheel_speed_front is missing in the header .* left and right wheel may stand"
    ):
        read_log(path)


def test_a_wheel_out_of_range_is_missing_and_named_with_its_side(tmp_path):
    wrong = np.full(400, 60.0)
    wrong[7] = 900.0
    path, *_ = four_wheels(tmp_path, wheel_speed_rear_right=wrong)
    log = read_log(path)
    assert (
        "wheel_speed_rear_right: 1 values outside -400 .. 400 rad/s are treated as missing (first in line 9)"
        in log.notes
    )
    assert log.data["wheel_speed_rear"].notna().all()  # the other wheel stands in


# ---- very long logs, here those of more than a few rows


def test_of_a_very_long_log_a_part_of_the_rows_is_kept_for_the_verdict_and_all_are_counted(drive, monkeypatch):
    log = read_log(drive.log)
    config = Config(read_vehicle(drive.vehicle).values)
    whole = estimate.estimate_to(None, log, config)
    monkeypatch.setattr(estimate, "MOST_KEPT", 700)
    part = estimate.estimate_to(None, log, config)
    assert len(part) == len(whole) == len(log) == 2001 and not part.interrupted
    assert part.statuses == whole.statuses and sum(part.statuses.values()) == 2001
    pd.testing.assert_frame_equal(part.table, whole.table.iloc[::3].reset_index(drop=True))


def test_noise_and_units_of_a_very_long_log_are_those_of_its_liveliest_part(drive):
    log = read_log(drive.log)
    log.data["yaw_rate"] *= 0.01
    log.data.loc[1200:1599, "yaw_rate"] *= 100.0
    part = rows.liveliest(log, 400)
    assert len(part) == 400 and part.time[0] == log.time[1200] and part.line[0] == log.line[1200]
    assert np.array_equal(part.data["accel_y"], log.data["accel_y"][1200:1600])
    assert rows.liveliest(log, 2001) is log


# ---- what is read of a log in pieces is what is read as a whole


SECONDS = 30.0
SMALL = 300  # entries of a piece in these tests


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Messages of a drive, and the car's file."""
    car = tmp_path_factory.mktemp("long") / "car.toml"
    car.write_text(tselab("vehicle", "--simulated").out, encoding="utf-8")
    return messages(drive(car, SECONDS).iloc[: round(100 * SECONDS)]), car


@pytest.mark.parametrize("name", FORMATS)
def test_a_log_in_pieces_is_the_log_as_a_whole_to_the_last_bit(name, short, tmp_path, monkeypatch):
    needs, write = FORMATS[name]
    if find_spec(needs) is None:
        pytest.skip(f"{needs} is not installed: scripts/setup.sh logs")
    parts, car = short
    path, reading = write(tmp_path, parts), Reading(car=read_vehicle(car))
    whole = read_log(path, reading=reading)
    in_small_pieces(monkeypatch)
    log = read_log(path, reading=reading)
    assert np.array_equal(log.time, whole.time) and log.notes == whole.notes and log.turn == whole.turn
    for channel in whole.data:
        np.testing.assert_array_equal(log.data[channel], whole.data[channel], err_msg=channel)
    for channel, slower in whole.slower.items():
        assert np.array_equal(log.slower[channel].value, slower.value), channel


def in_small_pieces(monkeypatch) -> None:
    """Everything as of a log that is a hundred times as long."""
    for name in ("raster", "read_can", "read_columns", "read_mat", "read_mdf", "read_text"):
        monkeypatch.setattr(f"tse.impl.logs.{name}.PIECE", SMALL)
    monkeypatch.setattr("tse.impl.logs.read_mat.MOST_AT_ONCE", 0)


def test_a_spline_in_pieces_has_the_same_bits_and_a_low_pass_the_same_value(monkeypatch):
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.015, 0.025, 20000))
    x = np.where((t > 100) & (t < 250), 0.0, rng.normal(size=len(t)))  # where nothing is, it still rings
    up, down = (np.arange(t[0], t[-1], 1 / rate) for rate in (100.0, 10.0))
    monkeypatch.setattr(raster, "PIECE", 1 << 30)
    whole, slow = raster.resample(t, x, up, 100.0), raster.resample(t, x, down, 10.0)
    monkeypatch.setattr(raster, "PIECE", 1500)
    assert np.array_equal(raster.resample(t, x, up, 100.0), whole)
    np.testing.assert_allclose(raster.resample(t, x, down, 10.0), slow, rtol=0, atol=1e-14)


def test_a_column_that_grows_knows_what_is_missing():
    column = Growing()
    for place, value in ((2, 1.0), (2, 2.0), (5, 3.0)):
        column.set(place, value)
    column.set(5, 4.0)
    column.pad(8)
    np.testing.assert_array_equal(column.array(), [np.nan, np.nan, 2.0, np.nan, np.nan, 4.0, np.nan, np.nan])
