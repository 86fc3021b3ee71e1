"""A log is read in parts: what is said of it, and what comes out, does not depend on where the parts end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tselab import log as module
from tselab.errors import UserError
from tselab.log import read_log

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
    with pytest.raises(UserError, match=f"line {row + 2}, column steer_angle: 'oops' is not a number"):
        read(tmp_path, lines)


def test_the_first_column_with_a_wrong_cell_is_named_not_the_first_part(drive, tmp_path, short_parts):
    lines = lines_of(drive)
    name = lines[0].split(",")
    for row, column in ((20, "yaw_rate"), (300, "accel_x"), (310, "accel_x")):
        cells = lines[row].split(",")
        cells[name.index(column)] = "x"
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
