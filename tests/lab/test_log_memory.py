"""Logs that are too long for memory: what is read of them in pieces is what is read as a whole, and the pieces are let go."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest

from conftest import tselab
from log_formats import FORMATS, drive, messages, repeated
from tse.impl import room
from tse.impl.logs import raster
from tse.impl.logs.log import read_log
from tse.impl.room import Room
from tse.impl.rows import Reading
from tse.impl.vehicle import read_vehicle

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
    assert log.room._maps and not whole.room._maps
    log.let_go()
    assert np.array_equal(log.time, whole.time) and log.notes == whole.notes and log.turn == whole.turn
    for channel in whole.data:
        np.testing.assert_array_equal(log.data[channel], whole.data[channel], err_msg=channel)
    for channel, slower in whole.slower.items():
        assert np.array_equal(log.slower[channel].value, slower.value), channel


def in_small_pieces(monkeypatch) -> None:
    """Everything as of a log that is a hundred times as long."""
    monkeypatch.setattr(room, "MOST_BYTES", 8 * SMALL)
    monkeypatch.setattr(room, "MOST_HELD", SMALL)
    for module in ("room", "logs.raster", "logs.readers.can", "logs.readers.columns", "logs.readers.mat", "logs.readers.mdf",
                   "logs.readers.text"):  # fmt: skip
        monkeypatch.setattr(f"tse.impl.{module}.PIECE", SMALL)
    monkeypatch.setattr("tse.impl.logs.readers.mat.MOST_AT_ONCE", 0)


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


HOURS, MOST = 3.0, 130  # MB that reading a log of so many hours may take on top: 70 and 80; as a whole 455 and 628
MEASURE = """
import resource, sys
from pathlib import Path
from tse.impl.logs.log import read_log
from tse.impl.rows import Reading
from tse.impl.vehicle import read_vehicle
reading = Reading(car=read_vehicle(Path(sys.argv[3])))
read_log(Path(sys.argv[1]), reading=reading)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
rows = len(read_log(Path(sys.argv[2]), reading=reading))
print(rows, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // (2**20 if sys.platform == "darwin" else 2**10))
"""


@pytest.mark.parametrize("name", ["MF4", "Parquet"])
def test_a_long_log_takes_less_memory_than_its_channels(name, short, tmp_path):
    needs, write = FORMATS[name]
    if find_spec(needs) is None:
        pytest.skip(f"{needs} is not installed: scripts/setup.sh logs")
    parts, car = short
    folders = [tmp_path / "short", tmp_path / "long"]
    for folder in folders:
        folder.mkdir()
    times = round(3600 * HOURS / SECONDS)
    paths = [write(folder, repeated(parts, n, SECONDS)) for folder, n in zip(folders, (1, times), strict=True)]
    done = subprocess.run([sys.executable, "-c", MEASURE, *map(str, paths), str(car)], capture_output=True, text=True,
                          env=os.environ | {"OPENBLAS_NUM_THREADS": "1"}, check=True)  # fmt: skip
    rows, memory = map(int, done.stdout.split())
    assert rows == pytest.approx(360000 * HOURS, abs=20)
    assert memory < MOST


def test_nothing_is_left_in_the_folder_for_temporary_files(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    own = Room()
    long = own.keep(np.arange(1e6))
    column = own.growing()
    column.extend(long)
    column.extend(long)
    assert own._maps and not list(tmp_path.iterdir())  # not even while it is used
    own.let_go()
    found = column.array()
    assert len(found) == 2e6 and np.array_equal(found[1_000_000:], long)
    assert np.array_equal(pickle.loads(pickle.dumps((own, found)))[1], found)


def test_a_column_that_grows_knows_what_is_missing(monkeypatch):
    monkeypatch.setattr(room, "MOST_HELD", 4)
    own = Room()
    column = own.growing()
    for place, value in ((2, 1.0), (2, 2.0), (5, 3.0)):
        column.set(place, value)
        own.took(1)
    column.set(5, 4.0)
    column.pad(8)
    np.testing.assert_array_equal(column.array(), [np.nan, np.nan, 2.0, np.nan, np.nan, 4.0, np.nan, np.nan])


def test_a_disk_that_is_full_is_an_error_and_no_signal(monkeypatch):
    if not hasattr(os, "posix_fallocate"):
        pytest.skip("this system cannot reserve room in a file")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(OSError, match="No space left"):
        Room().keep(np.zeros(1 << 20))
