"""Files are written completely or not at all, even on a full disk; inputs are kept."""

import csv
import errno
import io
import os
import resource
import signal
import subprocess
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from conftest import COMMAND, tselab_here
from tse.estimation import estimate
from tse.estimation.estimate import make_csv_header, make_csv_rows
from tse.library import files
from tse.library.errors import UserError

KB = 40  # allowed size of a file; every result of a drive is larger


def run_with_little_room(*args: object, room: int = KB) -> subprocess.CompletedProcess[str]:
    """Run the command with a limit to the size of a file, as on a full disk."""

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (room * 1024, room * 1024))

    return subprocess.run(
        [*COMMAND, *map(str, args)], capture_output=True, text=True, timeout=120, preexec_fn=limit
    )


def test_a_full_disk_is_said_and_leaves_what_was_there(drive, tmp_path):
    out, report = tmp_path / "est.csv", tmp_path / "report.html"
    out.write_text("as before\n")
    done = run_with_little_room(
        "estimate", drive.log, "--vehicle", drive.vehicle, "--out", out, "--report", report
    )
    assert done.returncode == 2, done.stderr
    assert f"{out}: cannot be written: " in done.stderr
    assert "internal error" not in done.stderr and "Traceback" not in done.stderr
    assert out.read_text() == "as before\n"
    assert [p.name for p in tmp_path.iterdir()] == ["est.csv"]


def test_of_two_results_the_one_that_does_not_fit_is_named(drive, tmp_path):
    out, report = tmp_path / "est.csv", tmp_path / "report.html"
    done = run_with_little_room(
        "estimate", drive.log, "--vehicle", drive.vehicle, "--out", out, "--report", report, room=2000
    )
    assert done.returncode == 2
    assert f"{report}: cannot be written: " in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["est.csv"]
    assert out.read_text().endswith("\n")


FORMULA = """id = "drag"
title = "d"
place = "force_x"
formula = "-drag * vel_x * abs(vel_x)"
gain = 0.5
[numbers.drag]
value = 0.0003
unit = "1/m"
"""


@pytest.mark.parametrize(
    ("result", "args"),
    [
        ("est.csv", ["estimate", "LOG", "--vehicle", "CAR", "--out", "est.csv"]),
        ("learnt", ["estimate", "LOG", "--vehicle", "CAR", "--out", "/dev/null", "--save-learnt", "learnt"]),
        ("log.csv", ["simulate", "--maneuver", "step-steer", "--duration", "2", "--out", "log.csv"]),
        (
            "truth.csv",
            [
                "simulate",
                "--maneuver",
                "step-steer",
                "--duration",
                "2",
                "--out",
                "/dev/null",
                "--truth",
                "truth.csv",
            ],
        ),
        ("car.h", ["vehicle", "CAR", "--c", "car.h"]),
        ("drag.h", ["formula", "drag.toml", "--c", "drag.h"]),
        ("studies", ["montecarlo", "--study", "robust", "--runs", "1", "--jobs", "1", "--out", "studies"]),
    ],
    ids=lambda x: x if isinstance(x, str) else x[0],
)
def test_not_a_byte_of_room_is_said_by_every_command(result, args, drive, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("drag.toml").write_text(FORMULA)
    before = {p.name for p in tmp_path.iterdir()}
    done = run_with_little_room(*[{"LOG": drive.log, "CAR": drive.vehicle}.get(a, a) for a in args], room=0)
    assert done.returncode == 2, done.stdout + done.stderr
    assert f"{result}" in done.stderr and "cannot be written" in done.stderr
    assert "internal error" not in done.stderr and "Traceback" not in done.stderr
    left = [p for p in tmp_path.rglob("*") if p.is_file() and p.name not in before and p.stat().st_size > 0]
    assert not left


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize("command", [["settings"], ["vehicle", "--example"]])
def test_a_terminal_that_takes_no_more_is_no_fault_of_ours(command):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*COMMAND, *command], stdout=full, stderr=subprocess.PIPE, text=True, timeout=120
        )
    assert done.returncode == 2
    assert done.stderr.startswith("tselab: error: the output: cannot be written: ")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("where", ["block", "fsync", "replace"])
def test_whatever_fails_the_old_file_stays_and_no_other(where, tmp_path, monkeypatch):
    path = tmp_path / "result.csv"
    path.write_text("as before\n")

    def fail(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    if where != "block":
        monkeypatch.setattr(files.os, where, fail)
    with (
        pytest.raises(UserError, match=f"{path}: cannot be written: No space left"),
        files.write_atomically(path) as file,
    ):
        file.write("new\n")
        if where == "block":
            fail()
    assert path.read_text() == "as before\n"
    assert [p.name for p in tmp_path.iterdir()] == ["result.csv"]


def test_a_link_is_replaced_and_what_it_leads_to_stays(tmp_path):
    (tmp_path / "folder").mkdir()
    path, link = tmp_path / "folder" / "result.csv", tmp_path / "link.csv"
    path.write_text("as before\n")
    path.chmod(0o640)
    link.symlink_to(path)
    with files.write_atomically(link) as file:
        file.write("new\n")
    assert not link.is_symlink() and link.read_text() == "new\n" and link.stat().st_mode & 0o777 == 0o640
    assert path.read_text() == "as before\n"


def test_what_a_killed_process_has_left_is_cleared_and_nothing_else(tmp_path):
    names = ("e.csv.abcdefgh", "e.csv.ijklmnop", "f.csv.abcdefgh", "e.csv.heldheld")
    left, young, other, held = (tmp_path / f".{n}.part" for n in names)
    for path in (left, young, other, held):
        path.write_text("half a ta")
    for path in (left, other, held):
        os.utime(path, (1e9, 1e9))
    with open(held) as file:
        files.fcntl.flock(file, files.fcntl.LOCK_EX)  # as another process that still writes it
        with files.write_atomically(tmp_path / "e.csv") as made:
            made.write("whole\n")
    assert {p.name for p in tmp_path.iterdir()} == {"e.csv", young.name, other.name, held.name}


@pytest.mark.parametrize(
    ("command", "says"),
    [
        (
            ["estimate", "log.csv", "--vehicle", "car.toml", "--out", "e.xlsx"],
            "--out: e.xlsx: ends in .xlsx; its name must end in .csv or .parquet",
        ),
        (
            ["estimate", "log.csv", "--vehicle", "car.toml", "--report", "r.pdf"],
            "--report: r.pdf: ends in .pdf; its name must end in .html or .htm",
        ),
        (
            ["simulate", "--maneuver", "sine", "--out", "log.mf4"],
            "option --out: log.mf4: ends in .mf4; its name must end in .csv",
        ),
        (
            ["calibrate", "log.csv", "--vehicle", "car.toml", "--out", "c.json"],
            "option --out: c.json: ends in .json; its name must end in .toml",
        ),
        (
            ["signals", "log.csv", "--write", "s.csv"],
            "option --write: s.csv: ends in .csv; its name must end in .toml",
        ),
    ],
)
def test_a_format_that_is_not_written_is_refused_by_its_name(command, says, drive, tmp_path):
    for name, path in {"log.csv": drive.log, "car.toml": drive.vehicle}.items():
        (tmp_path / name).write_bytes(path.read_bytes())
    done = tselab_here(*command, cwd=tmp_path)
    assert done.code == 2 and says in done.err, done.err
    assert {p.name for p in tmp_path.iterdir()} == {"log.csv", "car.toml"}


def test_the_content_is_on_the_disk_before_it_has_the_name(tmp_path, monkeypatch):
    path = tmp_path / "result.csv"
    order = []
    sync, replace = os.fsync, os.replace

    def synced(handle: int) -> None:
        order.append("folder" if os.path.isdir(f"/proc/self/fd/{handle}") else os.fstat(handle).st_size)
        sync(handle)

    def replaced(*names: object) -> None:
        order.append("name")
        replace(*names)

    monkeypatch.setattr(files.os, "fsync", synced)
    monkeypatch.setattr(files.os, "replace", replaced)
    with files.write_atomically(path) as file:
        file.write("new\n")
    assert order == [4, "name", "folder"]


def test_a_link_to_an_input_is_that_input(drive, tmp_path):
    hard, soft = tmp_path / "hard.csv", tmp_path / "soft.csv"
    log = tmp_path / "log.csv"
    log.write_bytes(drive.log.read_bytes())
    os.link(log, hard)
    soft.symlink_to(log)
    page = tmp_path / "page.html"
    os.link(log, page)
    for link in (hard, soft):
        done = tselab_here("estimate", log, "--vehicle", drive.vehicle, "--out", link)
        assert done.code == 2, done.out
        assert f"{link}: --out is the same file as the log" in done.err
        assert link.read_bytes() == drive.log.read_bytes()
    done = tselab_here("estimate", drive.log, "--vehicle", drive.vehicle, "--out", log, "--report", page)
    assert done.code == 2
    assert "--report is the same file as --out" in done.err


@pytest.mark.parametrize(
    ("command", "option", "same"),
    [
        (
            (
                "calibrate",
                "a.csv",
                "--vehicle",
                "car.toml",
                "--hold-out",
                "b.csv",
                "--out",
                "x.toml",
                "--table",
                "b.csv",
            ),
            "--table",
            "b.csv",
        ),
        (("formula", "play.toml", "--c", "play.toml"), "--c", "the formula"),
        (("fmu", "parameters", "x.fmu", "--vehicle", "car.toml", "--out", "car.toml"), "--out", "--vehicle"),
    ],
)
def test_no_command_writes_over_what_it_reads(command, option, same, drive, tmp_path):
    for name, path in {"a.csv": drive.log, "b.csv": drive.log, "car.toml": drive.vehicle}.items():
        (tmp_path / name).write_bytes(path.read_bytes())
    (tmp_path / "play.toml").write_text(
        'id = "p"\ntitle = "p"\nplace = "front_angle"\nformula = "steer_angle"\n'
    )
    before = {p: p.read_bytes() for p in tmp_path.iterdir()}
    done = tselab_here(*command, cwd=tmp_path)
    assert done.code == 2 and f"{option} is the same file as {same}" in done.err, done.err
    assert {p: p.read_bytes() for p in tmp_path.iterdir()} == before


# ---- Seals


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    files.load_secret.cache_clear()
    yield tmp_path / "state"
    files.load_secret.cache_clear()


def test_the_next_process_of_a_user_has_the_same_secret(home):
    first = files.load_secret()
    kept = home / "tselab" / "seal.key"
    assert kept.read_bytes() == first and len(first) == files.SECRET_BYTES
    assert [p.name for p in kept.parent.iterdir()] == ["seal.key"]
    if os.name == "posix":
        assert kept.stat().st_mode & 0o077 == 0
    files.load_secret.cache_clear()
    assert files.load_secret() == first


def test_another_user_has_another(home, tmp_path, monkeypatch):
    first = files.compute_seal(["one", "two"])
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "other"))
    files.load_secret.cache_clear()
    assert files.compute_seal(["one", "two"]) != first


@pytest.mark.parametrize("there", [b"", b"short", bytes(33)])
def test_where_none_can_be_kept_each_process_has_its_own(there, home):
    home.mkdir()
    if there:
        (home / "tselab").mkdir()
        (home / "tselab" / "seal.key").write_bytes(there)
    else:
        (home / "tselab").write_text("a file, in which no folder can be")
    first = files.load_secret()
    files.load_secret.cache_clear()
    assert len(first) == files.SECRET_BYTES and files.load_secret() != first


# ---- Tables that are written fast: pandas reads back the same bits.


def write_csv(table) -> str:
    return (make_csv_header(table) + make_csv_rows(table)).decode()


def write_by_pandas(table: pd.DataFrame) -> str:
    return table.to_csv(index=False, lineterminator="\n")


def parse_cells(text: str) -> list[list[object]]:
    """Return the cells of a table: numbers by their value, other cells as texts."""

    def value(cell: str) -> object:
        try:
            return float(cell)
        except ValueError:
            return {"true": "True", "false": "False"}.get(cell, cell)

    return [[value(cell) for cell in row] for row in csv.reader(io.StringIO(text))]


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_numbers_have_the_shortest_digits_and_every_bit(kind):
    rng = np.random.default_rng(1)
    bits = rng.integers(0, np.iinfo(np.uint64).max, 20000, np.uint64).view(np.float64)
    plain = rng.standard_normal(20000) * 10.0 ** rng.integers(-6, 7, 20000)
    with np.errstate(all="ignore"):
        x = np.concatenate([bits, plain, [0.0, -0.0, 5e-324, 1e16, 1e22, 123456789.0, 0.1 + 0.2]]).astype(
            kind
        )
    x = x[np.isfinite(x)]
    texts = make_csv_rows({"x": x}).decode().split()
    back = np.array([float(c) for c in texts]).astype(kind)
    assert np.array_equal(back.view(np.uint8), x.view(np.uint8))
    assert all(Decimal(c) == Decimal(str(v)) for c, v in zip(texts, x, strict=True))


def draw_usual_columns(seed: int, rows: int = 500) -> dict:
    """Return columns like those of estimates: numbers of many kinds, and words."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-9, 9, rows)
    some = np.where(rng.random(rows) < 0.5, np.nan, np.round(size % 7))
    return {
        "time": np.arange(rows) * 0.01,
        "x": (rng.standard_normal(rows) * size).astype(np.float32),
        "y": some.astype(np.float32),
        "log": rng.uniform(-1, 1, rows) * 1e3,
        "none": np.full(rows, np.nan, np.float32),
        "one": np.ones(rows, np.float32),
        "zero": np.where(rng.random(rows) < 0.5, -0.0, 0.0).astype(np.float32),
        "code": rng.integers(-5, 9, rows, np.int32),
        "count": rng.integers(0, 2**23, rows),
        "same": pd.Categorical(["valid"] * rows),
        "word": pd.Categorical(rng.choice(["a b", "c"], rows)),
        "part": pd.Categorical([None, *["x"] * (rows - 1)]),
    }


@pytest.mark.parametrize("rows", [1, 2, 500])
def test_what_is_usual_is_written_without_arrow_and_as_arrow_writes_it(monkeypatch, rows):
    tables = [draw_usual_columns(seed, rows) for seed in range(5)]
    tables = [t | {"time": np.where(t["time"] < 1e-5, 0.0, t["time"])} for t in tables]
    expected = [estimate._write_rows_by_arrow(t) for t in tables]
    monkeypatch.delattr(estimate, "_write_rows_by_arrow")
    assert [make_csv_rows(t) for t in tables] == expected
    assert [make_csv_rows(pd.DataFrame(t)) for t in tables] == expected


@pytest.mark.parametrize(
    "odd", [np.float32(1e10), -np.float32(2e20), np.inf, 9e-6, 1e16, 2**24, 2**60, "a,b", None, True], ids=str
)  # fmt: skip
def test_what_orjson_writes_otherwise_is_written_by_arrow(odd):
    kind = np.float32 if isinstance(odd, np.float32) else None
    table = draw_usual_columns(3, 4) | {
        "odd": np.array([odd, odd, odd, odd if isinstance(odd, str | bool) else 2], kind)
    }
    assert make_csv_rows(table) == estimate._write_rows_by_arrow(table)


def test_missing_cells_are_empty():
    reals, words = np.array([1.5, np.nan, 2.5]), pd.Categorical(["a", None, "b"])
    assert make_csv_rows({"x": reals, "y": reals, "w": words}) == b"1.5,1.5,a\n,,\n2.5,2.5,b\n"


MIXED = pd.DataFrame(
    {
        "time": [0.0, 0.5, 1.0],
        "x": [1.25, -3.0, 0.001],
        "valid": [1, 0, 1],
        "y": np.array([0.5, 2.0, 3.5], np.float32),
        "code": np.array([-3, 0, 7], np.int32),
        "word": ["valid", "not excited", "valid"],
        "again": pd.Categorical(["a b", "c", "a b"]),
    }
)


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"flag": [True, False, True]},
        {"word": ['say "x"', "a,b", "two\nlines"]},
        {"x": [np.inf, -np.inf, np.nan]},
        {"word": ["", None, "x"]},
        {'head,"er': [1, 2, 3]},
    ],
)
def test_a_table_reads_as_what_pandas_writes(change):
    table = MIXED.assign(**change)
    assert parse_cells(write_csv(table)) == parse_cells(write_by_pandas(table))


def test_a_table_without_rows_has_its_header():
    assert write_csv(MIXED.iloc[:0]) == write_by_pandas(MIXED.iloc[:0])


def test_parts_put_together_are_the_whole():
    parts = b"".join(make_csv_rows(MIXED.iloc[i : i + 1]) for i in range(3))
    assert parts == make_csv_rows(MIXED)
    assert pd.read_csv(io.BytesIO(parts), header=None).shape == (3, len(MIXED.columns))
