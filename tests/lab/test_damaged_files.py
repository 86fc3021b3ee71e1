"""A damaged file gives rows or an error message, whatever the damage.

Files are cut; bits change; parts are removed or doubled. TSE_DAMAGED is the number of
files of each kind (5; with --all 12; in the long run 200)."""

import gzip
import os
import random
import struct
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from conftest import tselab, tselab_here
from log_formats import FORMATS, make_drive, split_messages, write_or_skip
from trade_files import (
    BUS_LOGS,
    DBC,
    ODD_LINES,
    add_wheels,
    encode_frames,
    write_bus_log,
    write_candump,
    write_groups,
    write_long,
    write_racechrono,
    write_vbo,
)  # fmt: skip
from tse.car.vehicle import read_vehicle
from tse.channels.log import read_log
from tse.channels.proposal import format_signals, list_signals, propose
from tse.library.errors import UserError
from tse.log.rows import Reading
from tse.readers.read_mdf import _check_chains
from tse.readers.readers import read_recording

MAX_SECONDS = 60.0  # s of the processor for one file
TRADE = {
    "VBOX": lambda f, s: write_vbo(f / "drive.vbo", s),
    "three header rows": lambda f, s: write_racechrono(f / "drive.csv", s),
    "long table": lambda f, s: write_long(f / "drive.csv", s),
    "packed table": lambda f, s: pack_file(write_racechrono(f / "drive.csv", s)),
    "groups of MF4": lambda f, s: write_groups(f / "drive.mf4", s, 5.0),
    **{name: (lambda f, s, name=name: write_bus_log(name, f, encode_frames(s))) for name in BUS_LOGS},
}


def pack_file(path: Path) -> Path:
    made = path.with_name("drive.csv.gz")
    made.write_bytes(gzip.compress(path.read_bytes()))
    path.unlink()
    return made


def damage_file(data: bytes, chance: random.Random) -> bytes:
    """Return the file with one kind of damage."""
    made = bytearray(data)
    at = chance.randrange(len(made))
    kind = chance.randrange(6)
    if kind == 0:
        return bytes(made[:at])
    if kind == 1:
        for _ in range(chance.choice((1, 4, 40))):
            made[chance.randrange(len(made))] ^= 1 << chance.randrange(8)
    elif kind == 2:
        made[at : at + chance.choice((1, 8, 200))] = b""
    elif kind == 3:
        made[at:at] = made[max(0, at - 300) : at]
    elif kind == 4:
        made[at : at + 16] = bytes(chance.randrange(256) for _ in range(16))
    else:
        begin = chance.randrange(min(len(made), 2000))  # in the description of the content
        made[begin : begin + 4] = bytes(chance.choice(b"\0\xff\n,;\"'[]()#*-0 9") for _ in range(4))
    return bytes(made)


@pytest.fixture(scope="module")
def count(request) -> int:
    """Return the number of damaged files for each format."""
    return int(os.environ.get("TSE_DAMAGED", "12" if request.config.getoption("--all") else "5"))


def try_all(path: Path, target: Path, seed: str, car, count: int) -> None:
    """Read `count` damaged files as the commands do."""
    good, chance = target.read_bytes(), random.Random(seed)
    for i in range(count):
        target.write_bytes(damage_file(good, chance))
        begin = time.process_time()
        try:
            found = read_recording(path)
            proposal = propose(found, car)
            list_signals(found, proposal)
            (path.parent / "signals.toml").write_text(format_signals(found, proposal), encoding="utf-8")
            read_log(path, reading=Reading(car=car))
        except UserError as error:
            assert str(error).strip(), f"{seed} {i}"
        except Exception as error:
            raise AssertionError(f"{seed}, file {i}: {type(error).__name__}: {error}") from error
        finally:
            (path.parent / "signals.toml").unlink(missing_ok=True)
        assert time.process_time() - begin < MAX_SECONDS, f"{seed} {i}"


@pytest.fixture(scope="module")
def car(tmp_path_factory):
    """Return a vehicle."""
    path = tmp_path_factory.mktemp("damaged") / "car.toml"
    path.write_text(tselab("vehicle", "--simulated").out, encoding="utf-8")
    return read_vehicle(path)


@pytest.fixture(scope="module")
def clean(car):
    """Return twelve seconds of a drive."""
    return make_drive(car.path, seconds=12.0)


@pytest.mark.parametrize("name", TRADE)
def test_a_damaged_file_of_the_trade_is_read_or_refused(name, car, clean, count, tmp_path):
    if "MF4" in name:
        pytest.importorskip("asammdf", reason="asammdf is not installed: scripts/setup.sh logs")
    path = TRADE[name](tmp_path, add_wheels(clean)[:150])
    try_all(path, path, name, car, count)


SLOW = ("MDF 3", "MF4, frames and DBC")  # 1 s a file that is opened


@pytest.mark.parametrize(
    "name", [pytest.param(f, marks=[pytest.mark.slow] if f in SLOW else []) for f in FORMATS]
)
def test_a_damaged_file_of_a_library_is_read_or_refused(name, car, clean, count, tmp_path):
    path = write_or_skip(name, tmp_path, split_messages(clean[:300]))
    (tmp_path / "signals.toml").unlink(missing_ok=True)
    target = (
        max((p for p in path.rglob("*") if p.is_file()), key=lambda p: p.stat().st_size)
        if path.is_dir()
        else path
    )
    try_all(path, target, name, car, count)


@pytest.mark.parametrize("odd", ["", *ODD_LINES])
def test_a_damaged_database_is_read_or_refused(odd, car, clean, count, tmp_path):
    path = write_candump(
        tmp_path / "drive.log", encode_frames(add_wheels(clean)[:150]), DBC + ODD_LINES.get(odd, "") + "\n"
    )
    try_all(path, tmp_path / "car.dbc", odd, car, count)


def make_header(first_group: int, first_history: int) -> bytes:
    """Return the beginning of an MDF 4: two blocks."""
    name = b"MDF     4.10    test    ".ljust(28, b"\0") + struct.pack("<H", 410) + bytes(34)
    return (
        name
        + b"##HD\0\0\0\0"
        + struct.pack("<QQ6Q", 104, 6, first_group, first_history, 0, 0, 0, 0)
        + bytes(32)
    )


@pytest.mark.parametrize(("block", "where"), [
    (b"", (64, 0)), (b"##DG\0\0\0\0" + struct.pack("<QQ4Q", 64, 4, 168, 0, 0, 0) + bytes(8), (168, 0)),
    (b"##FH\0\0\0\0" + struct.pack("<QQ2Q", 56, 2, 168, 0) + bytes(16), (0, 168)),
])  # fmt: skip
def test_blocks_that_point_to_themselves_do_not_keep_a_reader(block, where, tmp_path):
    pytest.importorskip("asammdf", reason="asammdf is not installed: scripts/setup.sh logs")
    (tmp_path / "drive.mf4").write_bytes(make_header(*where) + block)
    begin = time.process_time()
    done = tselab_here("signals", tmp_path / "drive.mf4")
    assert done.code == 2 and "is damaged" in done.err, done.err
    assert time.process_time() - begin < 10.0


@pytest.mark.slow
@pytest.mark.parametrize("where", ["main", "thread"])
def test_a_reader_that_does_not_end_is_stopped(where, monkeypatch, tmp_path):
    monkeypatch.setattr("tse.readers.recording.BASE_READ_TIME", 0.3)
    path = tmp_path / "drive.csv"
    path.write_text("time,x\n0,1\n1,2\n")

    def read(*_: object) -> None:
        while True:
            try:
                time.sleep(0)
            except Exception:  # as parsers of other packages do
                continue

    monkeypatch.setattr("tse.readers.read_text.read", read)
    with pytest.raises(UserError, match="reading takes more than 0 s"):
        if where == "main":
            read_recording(path)
        else:
            with ThreadPoolExecutor(1) as pool:
                pool.submit(read_recording, path).result(timeout=30)


def test_a_thread_that_has_read_in_time_is_not_interrupted_later(monkeypatch, tmp_path):
    path = tmp_path / "drive.csv"
    path.write_text("time,x\n0,1\n1,2\n")
    read_recording(path)  # load the needed packages before the measurement
    monkeypatch.setattr("tse.readers.recording.BASE_READ_TIME", 1.0)

    def work() -> int:
        found = len(read_recording(path).channels)
        begin = time.thread_time()
        while time.thread_time() - begin < 1.6:
            pass
        return found

    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(work).result(timeout=30) == 1


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "time,"
            + ",".join(f"c{i}" for i in range(30000))
            + "\n"
            + ",".join("1" for _ in range(30001))
            + "\n",
            "has 30,001 columns",
        ),
        ("time," + "x" * 100000 + "\n0,1\n1,2\n", "a cell has 100,000 characters"),
        ("time," + "x" * 2000 + "\n0,1\n1,2\n", "the name of a column has 2,000 characters"),
    ],
)
@pytest.mark.parametrize("command", ["signals", "estimate"])
def test_a_table_that_is_too_wide_or_has_too_long_a_name_is_refused(text, says, command, car, tmp_path):
    (tmp_path / "drive.csv").write_text(text)
    done = tselab_here(command, tmp_path / "drive.csv", "--vehicle", car.path)
    assert done.code == 2 and says in done.err, done.err


def test_what_is_no_regular_file_is_refused_before_it_is_read(tmp_path):
    (tmp_path / "log.csv").write_text(
        "time,steer_angle,wheel_speed_front,wheel_speed_rear\n0,0,1,1\n0.01,0,1,1\n"
    )
    (tmp_path / "deep.toml").write_text("a" + ".a" * 3000 + " = 1\n")
    for option, value, says in (
        ("--vehicle", "/dev/zero", "is a device or a pipe, a TOML file is needed"),
        ("--vehicle", tmp_path / "deep.toml", "nested more than 64 deep"),
    ):
        done = tselab_here("estimate", tmp_path / "log.csv", option, value)
        assert done.code == 2 and says in done.err, done.err


def test_what_unpacks_to_far_more_than_a_log_is_refused(monkeypatch, tmp_path):
    monkeypatch.setattr("tse.readers.readers.MIN_UNPACKED_LIMIT", 1 << 20)
    (tmp_path / "drive.csv.gz").write_bytes(gzip.compress(b"time,x\n" + b"0,0\n" * 1000000))
    done = tselab_here("signals", tmp_path / "drive.csv.gz")
    assert done.code == 2 and "is larger than 1 MB after unpacking; allowed: 40 times" in done.err


@pytest.mark.parametrize("kind", ["DG", "CG", "CN", "FH"])
def test_a_list_of_an_mf4_that_forms_a_circle_is_refused(kind, tmp_path):
    """asammdf would follow it for ever. The last block of the kind links to itself."""
    asammdf = pytest.importorskip("asammdf", reason="asammdf is not installed: scripts/setup.sh logs")
    at_times = np.arange(50) * 0.01
    path = tmp_path / "log.mf4"
    with asammdf.MDF(version="4.10") as made:
        made.append(
            [asammdf.Signal(np.sin(at_times), at_times, name=name) for name in ("yaw_rate", "accel_y")]
        )
        made.save(path)
    content = bytearray(path.read_bytes())
    at = content.rfind(f"##{kind}".encode())
    struct.pack_into("<Q", content, at + 24, at)  # link 0, behind kind, length and number of links
    path.write_bytes(content)
    with pytest.raises(UserError, match=f"its list of {kind} blocks forms a circle"):
        _check_chains(path)
