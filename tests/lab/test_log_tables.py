"""Tables, messages and files of a log, by a few cells whose meaning is known by hand."""

import bz2
import gzip
import io
import json
import os
import signal
import struct
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from tse.library.errors import NoFile, UserError
from tse.readers import (
    read_columns,
    read_mat,
    read_mdf,
    read_openpilot,
    read_rosbag,
    read_text,
    read_vbo,
    readers,
    recording,
    table,
)
from tse.readers.readers import choose_reader, read_recording
from tse.readers.recording import (
    Channel,
    Collector,
    Growing,
    ReadOptions,
    Recording,
    flatten_message,
    read_stamp,
)
from tse.readers.table import Column, convert_numbers, convert_to_seconds, correct_time_units

LOG = Path("drive.csv")


def make_recording(**channels: tuple[np.ndarray, np.ndarray]) -> Recording:
    """Return a recording of channels, given as times and values; __ means a point."""
    found = {n.replace("__", "."): Channel(n.replace("__", "."), *x) for n, x in channels.items()}
    return Recording(LOG, "made", found)


def write(folder: Path, text: str, name: str = "drive.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


# ---- Names of channels


@pytest.mark.parametrize(
    ("name", "last"),
    [("wheel.fl", "fl"), ("/car/fl", "fl"), ("speed", "speed"), ("Lat._Vel.", "Lat_Vel"), ("a.b/c.d", "d")],
)
def test_the_last_part_of_a_name_is_behind_its_last_separator(name, last):
    assert recording.last_part(name) == last


def test_a_channel_is_found_by_its_end_only_where_one_fits():
    x = np.zeros(2)
    log = make_recording(a__fl=(x, x), b__fl=(x, x), a__rate=(x, x), speed=(x, x))
    assert log.find("rate", "s").name == "a.rate" and log.find("speed", "s").name == "speed"
    assert [log.has(n) for n in ("rate", "speed", "a.fl", "fl", "ate")] == [True, True, True, False, False]
    with pytest.raises(UserError, match=r"s: 'fl' is the name of 2 channels in drive.csv: .* a.fl, b.fl"):
        log.find("fl", "s")
    with pytest.raises(UserError, match=r"s: there is no 'ate' in drive.csv"):
        log.find("ate", "s")
    with pytest.raises(UserError, match=r"s: there is no 'speeed' in drive.csv \(did you mean speed\?\)"):
        log.find("speeed", "s")


def test_lists_of_names_have_six_and_the_number_of_the_others():
    assert recording.list_names("abcdef") == "a, b, c, d, e, f"
    assert recording.list_names("abcdefgh") == "a, b, c, d, e, f and 2 more"
    assert recording.find_unused_name("a", {"b"}) == "a"
    assert recording.find_unused_name("a", {"a", "a#3"}) == "a#2"
    assert recording.find_unused_name("a", {"a", "a#2", "a#4"}) == "a#3"
    said = recording.suggest_channels("zzz", ["Msg/Speed", "Rate"])
    assert said == "; it has Msg/Speed, Rate; 'tselab signals LOG' lists them"
    assert recording.suggest_channels("SPEED", ["Msg/Speed", "Rate"]) == " (did you mean Msg/Speed?)"


def test_times_since_1970_begin_near_zero_for_all_channels_and_keep_their_start():
    first = np.array([np.nan, 1.7e9 + 0.75, 1.7e9 + 2])
    other = np.array([1.7e9 + 1.5, 1.7e9 + 3])
    found = make_recording(
        a=(first, first), b=(other, other), c=(first, first), d=(np.zeros(0),) * 2
    ).since_start()
    assert found.start == 1.7e9
    np.testing.assert_allclose(found.channels["a"].time, [np.nan, 0.75, 2])
    np.testing.assert_allclose(found.channels["b"].time, [1.5, 3])
    assert found.channels["a"].time is found.channels["c"].time
    near = make_recording(a=(np.array([999_999.0, 2e6]),) * 2)
    assert near.since_start() is near
    assert make_recording(a=(np.array([1e6 + 0.5]),) * 2).since_start().start == 1e6
    nothing = make_recording(a=(np.full(2, np.nan),) * 2)
    assert nothing.since_start() is nothing


# ---- Limits


def test_more_rows_than_a_file_can_have_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(recording, "ALWAYS_ALLOWED_ROWS", 10)
    path = tmp_path / "a.bin"
    path.write_bytes(bytes(100))
    for rows, each, allowed in ((10, 50, True), (11, 50, False), (25, 4, True), (26, 4, False)):
        if allowed:
            recording.check_rows(path, "it", rows, each)
            continue
        with pytest.raises(UserError, match=f"it has {rows} rows; .* up to {max(10, 100 // each)}:"):
            recording.check_rows(path, "it", rows, each)
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "b.bin").write_bytes(bytes(20))
    assert recording.measure_size(tmp_path) == 120 and recording.measure_size(path) == 100


def test_a_table_may_be_as_wide_and_a_name_as_long_as_the_limit(monkeypatch):
    monkeypatch.setattr(recording, "MAX_COLUMNS", 3)
    recording.check_table_width(LOG, ["a", "b", "n" * recording.MAX_NAME_LENGTH])
    with pytest.raises(UserError, match="has 4 columns; allowed: up to 3"):
        recording.check_table_width(LOG, list("abcd"))
    with pytest.raises(UserError, match="has 1,001 characters"):
        recording.check_table_width(LOG, ["a", "n" * (recording.MAX_NAME_LENGTH + 1)])


def test_the_memory_for_reading_grows_with_the_file_and_is_given_back(tmp_path, monkeypatch):
    if recording.resource is None or recording._read_data_size() is None:
        pytest.skip("this system does not limit the memory of a process")
    path, kind = tmp_path / "a.bin", recording.resource.RLIMIT_DATA
    path.write_bytes(bytes(1 << 20))
    before = recording.resource.getrlimit(kind)
    monkeypatch.setattr(recording, "_read_data_size", lambda: 1 << 34)
    monkeypatch.delenv(recording.MEMORY_LIMIT_VARIABLE, raising=False)
    with recording.limit_memory(path):
        assert recording.resource.getrlimit(kind) == before
    monkeypatch.setenv(recording.MEMORY_LIMIT_VARIABLE, "1")
    with pytest.raises(UserError, match=r"more than 0\.7 GB of memory"), recording.limit_memory(path):
        limit = recording.resource.getrlimit(kind)[0]
        room = recording.BASE_MEMORY + recording.MEMORY_PER_BYTE * (1 << 20)
        assert limit == (1 << 34) + room or before[0] == limit != recording.resource.RLIM_INFINITY
        path.write_bytes(bytes(2 << 20))
        with recording.limit_memory(path):  # a limit within another one does not raise it
            assert recording.resource.getrlimit(kind)[0] == limit
        raise MemoryError
    assert recording.resource.getrlimit(kind) == before


def test_the_time_for_reading_grows_with_the_file_and_only_the_outermost_limit_counts(tmp_path):
    if not hasattr(signal, "setitimer"):
        pytest.skip("this system has no timer of the processor")
    path = tmp_path / "a.bin"
    path.write_bytes(bytes(2 << 20))
    with recording.limit_time(path):
        left, again = signal.getitimer(signal.ITIMER_VIRTUAL)
        assert left == pytest.approx(36.0, abs=0.5) and again == 1.0
        path.write_bytes(bytes(8 << 20))
        with recording.limit_time(path):
            assert signal.getitimer(signal.ITIMER_VIRTUAL)[0] <= left
        assert signal.getitimer(signal.ITIMER_VIRTUAL)[0] > 30.0
    assert signal.getitimer(signal.ITIMER_VIRTUAL)[0] == 0.0
    with recording.limit_time(tmp_path / "gone"):
        assert signal.getitimer(signal.ITIMER_VIRTUAL)[0] == 0.0


def test_cells_may_be_quoted_and_are_not_longer_than_the_limit(monkeypatch):
    monkeypatch.setattr(recording, "MAX_CELL_LENGTH", 5)
    assert recording.split_cells(LOG, 'a,"b,c",, d') == ["a", "b,c", "", " d"]
    assert recording.split_cells(LOG, 'a; "b;c"', ";", blanks=True) == ["a", "b;c"]
    assert recording.split_cells(LOG, "") == [] and recording.split_cells(LOG, "12345,6") == ["12345", "6"]
    with pytest.raises(UserError, match="a cell has 6 characters; allowed: up to 5"):
        recording.split_cells(LOG, "1,123456")
    assert recording.split_cells(LOG, "1,123456", tried=True) == ["1", "123456"]


# ---- Messages


@dataclass
class Stamp:
    sec: int
    nanosec: int


@dataclass
class Header:
    stamp: object
    frame_id: str = "base"


@dataclass
class Wheels:
    header: Header
    speed: list[float]
    valid: bool = True


class Slots:
    """A message of ROS 1, whose fields begin with an underscore."""

    __slots__ = ("__weakref__", "_check_fields", "_x", "y")

    def __init__(self) -> None:
        self._x, self.y, self._check_fields = 1, 2.5, True


def nest(depth: int) -> dict:
    return {"x": nest(depth - 1)} if depth else {"x": 1.0}


@pytest.mark.parametrize(
    ("message", "fields"),
    [
        (Wheels(Header(Stamp(1, 2)), [1.0, 2.0]), {"speed.0": 1.0, "speed.1": 2.0, "valid": 1.0}),
        ({"a": {"b": 3, "c": "text"}, "d": None, "e": b"x"}, {"a.b": 3.0}),
        ({"twelve": [0.5] * 12, "thirteen": [0.5] * 13}, {f"twelve.{k}": 0.5 for k in range(12)}),
        ({"pose_covariance": [1.0, 2.0], "pose": np.array([4.0])}, {"pose.0": 4.0}),
        (Slots(), {"x": 1.0, "y": 2.5}),
        (np.float32(0.5), {"": 0.5}),
        (np.bool_(True), {"": 1.0}),
        (nest(8), {"x." * 8 + "x": 1.0}),
        (nest(9), {}),
        (object(), {}),
    ],
)
def test_the_numbers_of_a_message_have_the_paths_of_their_fields(message, fields):
    assert dict(flatten_message(message)) == fields


@pytest.mark.parametrize(
    ("message", "time"),
    [
        (Wheels(Header(Stamp(7, 250_000_000)), []), 7.25),
        ({"header": {"stamp": {"secs": 7, "nsecs": 500_000_000}}}, 7.5),
        ({"header": {"stamp": {"sec": 7, "nsec": 125_000_000}}}, 7.125),
        ({"header": SimpleNamespace(stamp=SimpleNamespace(secs=7, nsecs=0))}, 7.0),
        ({"header": {"stamp": {"sec": 0, "nanosec": 5}}}, None),  # was not set
        ({"header": {"frame_id": "base"}}, None),
        ({"x": 1.0}, None),
        (SimpleNamespace(x=1.0), None),
    ],
)
def test_the_time_of_a_measurement_is_in_the_header_of_its_message(message, time):
    assert read_stamp(message) == time


def test_a_message_has_the_time_of_its_measurement_or_else_that_of_its_recording():
    collect = Collector(LOG)
    for k in range(3):
        collect.add("/wheels", 100.0 + k, Wheels(Header(Stamp(50 + k, 500_000_000)), [float(k)]))
        collect.add("/gyro", 100.0 + k, {"rate": float(k)})
    found = collect.channels()
    np.testing.assert_allclose(found["/wheels.speed.0"].time, [50.5, 51.5, 52.5])
    np.testing.assert_allclose(found["/gyro.rate"].time, [100, 101, 102])
    assert found["/wheels.speed.0"].value.tolist() == [0, 1, 2]


def test_fields_that_come_late_or_not_always_are_missing_elsewhere_and_only_needed_ones_are_kept():
    collect = Collector(LOG, lambda name: not name.endswith(".c"))
    for k, message in enumerate(({"a": 1, "c": 7}, {"a": 2, "b": 5}, {"b": 6}, {"a": 3})):
        collect.add("/m", float(k), message, "sensor_msgs/msg/Imu")
    found = collect.channels()
    assert list(found) == ["/m.a", "/m.b"] and found["/m.a"].text == "sensor_msgs/msg/Imu"
    np.testing.assert_array_equal(found["/m.a"].value, [1, 2, np.nan, 3])
    np.testing.assert_array_equal(found["/m.b"].value, [np.nan, 5, 6, np.nan])
    assert found["/m.a"].time.tolist() == [0, 1, 2, 3]
    collect = Collector(LOG)
    collect.add("/number", 0.5, 3.0)
    assert list(collect.channels()) == ["/number"]


@pytest.mark.parametrize(
    ("kind", "name", "unit"),
    [
        ("sensor_msgs/msg/Imu", "angular_velocity.z", "rad/s"),
        ("sensor_msgs/Imu", "linear_acceleration.x", "m/s2"),
        ("geometry_msgs/msg/TwistStamped", "twist.linear.x", "m/s"),
        ("nav_msgs/msg/Odometry", "twist.twist.angular.z", "rad/s"),
        ("geometry_msgs/msg/AccelStamped", "accel.linear.y", "m/s2"),
        ("geometry_msgs/msg/AccelStamped", "accel.angular.z", "rad/s"),
        ("sensor_msgs/msg/Imu", "orientation.z", ""),
        ("sensor_msgs/msg/Imu", "linear", ""),
        ("car_msgs/msg/Imu", "angular_velocity.z", ""),
    ],
)
def test_units_of_messages_of_ros_are_those_of_their_standard(kind, name, unit):
    assert recording._find_unit(kind, name) == unit


def test_a_column_that_grows_takes_many_values_at_once():
    column = Growing()
    column.extend(np.array([1, 2], np.int16))
    column.extend(np.arange(6.0)[::2])
    assert len(column) == 5 and column.array().tolist() == [1, 2, 0, 2, 4]
    assert Growing().array().tolist() == []


# ---- Numbers and times of tables


def test_cells_that_are_no_numbers_are_missing_and_the_first_is_named():
    cells = pd.Series([f"{k}" for k in range(60)])
    cells[[3, 7]] = ["abc", "x"]
    cells[[10, 11, 12, 13]] = ["", "NaN", " n/a", "SNA"]
    value, note = convert_numbers(cells)
    assert np.flatnonzero(np.isnan(value)).tolist() == [3, 7, 10, 11, 12, 13] and value[59] == 59
    assert note == "2 cells that are no numbers are treated as missing (first: 'abc' in row 4)"
    cells[:3] = "y"  # with 5 of 60 more than a twentieth
    assert convert_numbers(cells) == (None, "")
    cells[:2] = ["0", "1"]  # 3 of 60 are a twentieth
    assert convert_numbers(cells)[1].startswith("3 cells")


@pytest.mark.parametrize(
    ("values", "wanted"),
    [
        (np.array([1.5, np.nan]), [1.5, np.nan]),
        (np.array([1, 2], np.int8), [1, 2]),
        (pd.Series([True, False]), [1, 0]),
        (pd.Series([True, None], dtype=object), [1, np.nan]),
        (pd.array([1, None], "Int64"), [1, np.nan]),
        (pd.Series(["1e3", "-.5"]), [1000, -0.5]),
        (pd.Series(["", None], dtype=object), None),
        (pd.Series(pd.to_datetime(["2024-01-01"])), None),
        (pd.Series(pd.to_timedelta([1], "s")), None),
    ],
)
def test_a_column_of_any_kind_becomes_floats_or_is_not_used(values, wanted):
    found, note = convert_numbers(pd.Series(values) if not isinstance(values, np.ndarray) else values)
    assert note == "" and (found is None) == (wanted is None)
    if wanted is not None:
        np.testing.assert_array_equal(found, wanted)


RISE = np.arange(20) * 0.1


@pytest.mark.parametrize(
    ("columns", "options", "time"),
    [
        ({"speed": RISE, "time": RISE}, {}, "time"),
        ({"index": RISE, "time": RISE}, {}, "time"),  # the more likely word
        ({"lap time": RISE, "timestamp": RISE}, {}, "timestamp"),  # one word before two
        ({"a b c time": RISE, "sec": RISE}, {}, "sec"),  # too many words
        ({"time": RISE[::-1], "t": RISE}, {}, "t"),  # a time increases
        ({"time": RISE[::-1], "speed": RISE}, {}, "time"),
        ({"t": RISE[::-1], "time": RISE[::-1]}, {}, "time"),
        ({"time": np.repeat([0.0, 1.0], [1, 19]), "t": RISE}, {}, "t"),  # rises in 1 of 19 steps
        ({"time": np.repeat([0.0, 1.0, 2.0], [1, 18, 1]), "t": RISE}, {}, "time"),  # in 2 of 19
        ({"x": RISE[::-1], "counter [s]": RISE}, {}, "counter"),
        ({"x": RISE, "y": RISE}, {}, "x"),
        ({"time": RISE, "day": pd.Series(pd.date_range("2024", periods=20))}, {}, "day"),
        ({"time": RISE, "speed": RISE}, {"time": "speed"}, "speed"),
        ({"speed": RISE, "other": RISE}, {"step": 0.01}, None),
        ({"speed": RISE, "time": RISE}, {"step": 0.01}, "time"),
    ],
)
def test_the_time_column_is_the_one_that_is_named_or_most_likely(columns, options, time):
    made = [Column(n, x) for n, x in columns.items()]
    names = [table.split_unit(n)[0] for n in columns]
    found = table.make_recording(LOG, "CSV", made, ReadOptions(**options))
    assert [n for n in names if n not in found.channels] == ([time] if time else [])
    if not time:
        np.testing.assert_allclose(found.channels["speed"].time, 0.01 * np.arange(20))
        assert found.notes == ["no column is a time: rows are taken as 0.01 s apart ([log] step)"]


def test_a_table_without_a_time_is_refused_with_its_columns():
    same = np.repeat(RISE[:10], 2)
    with pytest.raises(UserError, match="no column is a time; columns of this file: a, b"):
        table.make_recording(LOG, "CSV", [Column("a", same), Column("b", RISE)], ReadOptions())
    with pytest.raises(UserError, match=r"there is no column 'tme' \(did you mean time\?\)"):
        table.make_recording(LOG, "CSV", [Column("time", RISE)], ReadOptions(time="tme"))
    with pytest.raises(UserError, match="has a header but no rows"):
        table.make_recording(LOG, "CSV", [Column("time", RISE[:0])], ReadOptions())


def test_columns_keep_their_units_and_equal_names_are_numbered():
    text = pd.Series(["a"] * 20)
    made = [
        Column("time", RISE),
        Column("v [km/h]", RISE, "", "of the car"),
        Column("v", 2 * RISE, "m/s"),
        Column("w_kmh", RISE),
        Column("note", text),
    ]
    found = table.make_recording(LOG, "CSV", made, ReadOptions(), ["before"])
    assert {n: c.unit for n, c in found.channels.items()} == {"v": "km/h", "v#2": "m/s", "w_kmh": "km/h"}
    assert found.channels["v#2"].value[1] == 0.2 and found.channels["v"].text == "of the car"
    assert found.notes == [
        "before",
        "column v appears more than once: its next occurrence is named v#2",
        "columns without numbers are not used: note",
    ]
    few = table.make_recording(LOG, "CSV", made, ReadOptions(wanted=lambda n: n == "w_kmh"))
    assert list(few.channels) == ["w_kmh"] and few.notes == []


@pytest.mark.parametrize(
    ("column", "options", "wanted"),
    [
        (Column("time", np.array([0.0, 1.0])), {}, [0, 1]),  # a median step of up to 1 is in s
        (Column("time", np.array([0.0, 1.5])), {}, [0, 0.0015]),
        (Column("time", np.array([0.0, 2000.0])), {}, [0, 2]),
        (Column("time", np.array([0.0, 2001.0])), {}, [0, 0.002001]),
        (Column("time", np.array([0.0, 3e6])), {}, [0, 0.003]),
        (Column("time", np.array([0.0, 10, 10, 20])), {"time_unit": "s"}, [0, 10, 10, 20]),
        (Column("time", np.array([0.0, 0.5])), {"time_unit": "ms"}, [0, 0.0005]),
        (Column("time", np.array([0.0, 0.5]), "min"), {}, [0, 30]),
        (Column("time", np.array([0.0, 0.5]), "km/h"), {}, [0, 0.5]),  # no unit of time
        (Column("time_us", np.array([0.0, 5.0])), {}, [0, 5e-6]),
        (Column("logMonoTime", np.array([0.0, 5.0])), {}, [0, 5e-9]),
        (Column("time", pd.Series(pd.to_timedelta([0, 1500], "ms"))), {}, [0, 1.5]),
        (Column("time", pd.Series(pd.to_datetime(["1970-01-02", None]))), {}, [86400, np.nan]),
        (
            Column("time", pd.Series(pd.to_datetime(["1970-01-02 02:00+02:00", "1970-01-02 03:00+02:00"]))),
            {},
            [86400, 90000],
        ),
        (Column("time", pd.Series(["0.5", " 1.5", "x"])), {}, [0.5, 1.5, np.nan]),
        (Column("time", pd.Series(["01:00:00.5", "01:00:01,25", None])), {}, [3600.5, 3601.25, np.nan]),
        (Column("time", pd.Series(["10:30", "10:31.5"])), {}, [630, 631.5]),
        (Column("time", pd.Series(["1970-01-01T00:01:00Z", "1970-01-01T00:01:00.5Z"])), {}, [60, 60.5]),
        (Column("time", pd.Series(["1970-01-01T03:00+02:00", "1970-01-01T03:00-01:00"])), {}, [3600, 14400]),
        (Column("time", pd.Series(["02.01.1970 00:00:00", "03.01.1970 00:00:01"])), {}, [86400, 172801]),
        (Column("time", pd.Series(["01/02/1970 00:00:00", "01/03/1970 00:00:01"])), {}, [86400, 172801]),
    ],
)
def test_times_of_any_kind_become_seconds(column, options, wanted):
    found = convert_to_seconds(LOG, column, [], ReadOptions(**options))
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_a_unit_of_time_that_is_guessed_is_named_and_a_wrong_one_is_refused():
    notes: list[str] = []
    convert_to_seconds(LOG, Column("time", np.array([0.0, 0, 0, 10, 10, 10, 20, 900])), notes)
    assert len(notes) == 1 and "rows are 10 apart, so the unit is taken as ms" in notes[0]
    with pytest.raises(UserError, match="time_unit: 'km' is no unit of time"):
        convert_to_seconds(LOG, Column("time", RISE), notes, ReadOptions(time_unit="km"))
    with pytest.raises(UserError, match="column when: 'soon' is no time"):
        convert_to_seconds(LOG, Column("when", pd.Series(["soon", "later", "now"])), notes)


def pack(day: np.ndarray) -> np.ndarray:
    """Return times of day as HHMMSS.ss."""
    return np.floor(day / 3600) * 1e4 + np.floor(day / 60) % 60 * 100 + day % 60


HOUR = 3590 + 0.5 * np.arange(800)


def test_packed_times_go_on_after_midnight_over_missing_ones():
    nan = np.nan
    found = table.unpack_times(np.array([235959.5, nan, 1.0, 120000.0, 235900.0, 0.5]))
    np.testing.assert_allclose(found, [86399.5, nan, 86401, 129600, 172740, 172800.5])
    assert table.unpack_times(np.array([10203.25]))[0] == 3723.25


@pytest.mark.parametrize(
    ("time", "packed"),
    [
        (pack(3590 + 0.5 * np.arange(40)), True),
        (pack(3597 + 0.5 * np.arange(9)), False),  # too few
        (pack(3597 + 0.5 * np.arange(10)), True),
        (pack(3600 + 0.5 * np.arange(40)), False),  # within one minute
        (pack(3590 + 2.0 * np.arange(40)), False),  # too slow
        (3550 + 0.5 * np.arange(100), False),  # a count of seconds passes 60
        (240000 + pack(3590 + 0.5 * np.arange(40)), False),
        (np.where(np.arange(800) == 60, 10075.0, pack(3590 + 0.5 * np.arange(800))), False),  # 75 s
        (HOUR // 60 * 100 + HOUR % 60, False),  # 60 min and more
    ],
)
def test_times_of_day_in_one_number_have_minutes_of_sixty_seconds(time, packed):
    assert table.is_packed(time) == packed
    notes: list[str] = []
    found = convert_to_seconds(LOG, Column("time", time), notes)
    assert (notes == [table.PACKED_NOTE]) == packed
    if packed:
        np.testing.assert_allclose(np.diff(found), 0.5, atol=1e-9)
        same = convert_to_seconds(LOG, Column("time", time), [], ReadOptions(time_unit="s"))
        assert np.array_equal(same, time)


def make_groups(*groups: np.ndarray) -> dict[str, Channel]:
    return {f"g{k}{i}": Channel(f"g{k}{i}", t, t) for k, t in enumerate(groups) for i in range(2)}


def test_groups_that_last_a_thousand_times_as_long_as_those_in_seconds_are_in_ms():
    second = 0.1 * np.arange(400)
    for factor, off, per in (
        (1e3, 1.02, 1e-3),
        (1e3, 1.04, 1.0),
        (1e6, 1.0, 1e-6),
        (1e9, 0.98, 1e-9),
        (10, 1.0, 1),
    ):
        notes: list[str] = []
        other = factor * off * second
        found = correct_time_units(make_groups(second, other), ReadOptions(), notes)
        assert np.array_equal(found["g01"].time, second)
        np.testing.assert_allclose(found["g10"].time, per * other, rtol=1e-12)
        assert found["g10"].time is found["g11"].time
        assert len(notes) == (per != 1.0) and all(
            n.startswith("time of g10, g11 seems to be in") for n in notes
        )


def test_where_no_group_is_in_seconds_the_shortest_step_gives_the_unit_of_all():
    fast, slow, few = 10.0 * np.arange(200), 2500.0 * np.arange(100), 0.01 * np.arange(99)
    notes: list[str] = []
    found = correct_time_units(make_groups(slow, fast, few), ReadOptions(), notes)
    np.testing.assert_allclose(found["g00"].time, 1e-3 * slow)
    np.testing.assert_allclose(found["g20"].time, 1e-3 * few)  # too short to show a unit
    assert notes == [
        "time seems to be in ms, because entries are 10 apart: it is converted "
        "([log] time_unit sets a different unit)"
    ]
    made = make_groups(slow, fast)
    found = correct_time_units(made, ReadOptions(time_unit="us"), notes)
    np.testing.assert_allclose(found["g10"].time, 1e-6 * fast)
    assert len(notes) == 1
    edge = make_groups(2.0 * np.arange(100))
    assert correct_time_units(edge, ReadOptions(), notes) is edge and len(notes) == 1


@pytest.mark.parametrize(
    ("title", "name", "unit"),
    [
        ("Speed [km/h]", "Speed", "km/h"),
        ("Speed (km/h) ", "Speed", "km/h"),
        ("Gear (Gear)", "Gear (Gear)", ""),
        ("Count [-]", "Count", "-"),
        ("[km/h]", "[km/h]", ""),
        ("a[0] <deg>", "a[0]", "deg"),
        ("a[7]", "a[7]", ""),
    ],
)
def test_a_unit_in_brackets_is_taken_off_a_name(title, name, unit):
    assert table.split_unit(title) == (name, unit)


@pytest.mark.parametrize(
    ("name", "unit", "words"),
    [
        ("vx_kmh", "km/h", ["vx", "kmh"]),
        ("steeringAngleDeg", "deg", ["steering", "angle", "deg"]),
        ("ESP_v_Signal_VL", "", ["esp", "v", "signal", "vl"]),
        ("wheelSpeedFL", "", ["wheel", "speed", "fl"]),
        ("deg", "", ["deg"]),
        ("wheel.speed.rads", "rad/s", ["wheel", "speed", "rads"]),
        ("yaw_dps", "deg/s", ["yaw", "dps"]),
        ("accel_g", "g", ["accel", "g"]),
        ("accel_ms2", "m/s2", ["accel", "ms2"]),
        ("v_mps", "m/s", ["v", "mps"]),
        ("ABSWheelRPM", "rpm", ["abs", "wheel", "rpm"]),
        ("Größe", "", ["größe"]),
    ],
)
def test_a_unit_may_be_the_last_word_of_a_name(name, unit, words):
    assert table.find_unit_suffix(name) == unit and table.split_words(name) == words


# ---- CSV


@pytest.mark.parametrize(
    ("text", "options", "values", "unit"),
    [
        ("time,v\n0,1\n1,2\n2,4\n", {}, [1, 2, 4], ""),
        ("time;v\n0,0;1,5\n0,1;2,5\n", {}, [1.5, 2.5], ""),
        ("time\tv\n0\t1\n1\t2\n", {}, [1, 2], ""),
        ("time v\n0   1\n1 2\n", {}, [1, 2], ""),
        ("time|v\n0|1\n1|2\n", {}, [1, 2], ""),
        ("by a logger\nday,1\n\ntime,v\ns,km/h\n0,1\n1,2\n", {}, [1, 2], "km/h"),
        ("time,v\n[s],[km/h]\nECU 1,ECU 1\n0,1\n1,2\n", {}, [1, 2], "km/h"),
        ("a,b\ntime,v\nx,y\n0,1\n1,2\n", {"header": 2}, [1, 2], ""),
        ("time;v\n0;1,5\n1;2,5\n", {"decimal": ","}, [1.5, 2.5], ""),
        ("time-v\n0-1\n1-2\n", {"separator": "-"}, [1, 2], ""),
        ("time\tv\n0\t1\n1\t2\n", {"separator": "tab"}, [1, 2], ""),
        ('"time","v"\n"0","1.5"\n"1","2"\n', {}, [1.5, 2], ""),
    ],
)
def test_the_layout_of_a_csv_is_found_or_given(text, options, values, unit, tmp_path):
    found = read_text.read(write(tmp_path, text), ReadOptions(**options))
    assert list(found.channels) == ["v"] and found.channels["v"].unit == unit
    assert found.channels["v"].value.tolist() == values


def test_the_layout_that_was_found_is_named_unless_it_is_plain(tmp_path):
    plain = read_text.read(write(tmp_path, "time,v,x\n0,1\n1,2\n"), ReadOptions())  # one name too many
    assert list(plain.channels) == ["v"] and plain.notes == []
    text = "logger X\ntime;v\ns;km/h\n0,5;1\n1,5;2\n"
    assert read_text.read(write(tmp_path, text), ReadOptions()).notes == [
        "read as CSV with separator ';', decimal ',', names in line 2, a row of units"
    ]


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        ("time,v\n", {}, "has a header but no rows"),
        ("\n\n", {}, "is empty"),
        ("0,1\n1,2\n", {}, "the first line must name the columns; it is '0,1'"),
        ("time\n0,1\n1,2\n", {}, "line 1 has 1 names, but the rows have 2 cells"),
        ("time,v\n0,1\n1,2\n", {"header": 4}, "header = 4 is out of range: .* allowed: 1 .. 3"),
        ("time,v\n0,1\n1,2\n", {"header": 0}, "header = 0 is out of range"),
        ("time,v\nab,cd\nef,gh\n", {}, "is no table: no line holds numbers"),
        ("a sentence\nand another\n", {}, "is no table"),
        ("time,v\n0,1\n1,2,3\n", {}, "every row needs as many cells as there are names"),
        ("time,v\n0,1\n", {"encoding": "ebcdic-9"}, "encoding = 'ebcdic-9'"),
    ],
)
def test_a_csv_that_is_none_is_refused_with_the_reason(text, options, said, tmp_path):
    with pytest.raises(UserError, match=said):
        read_text.read(write(tmp_path, text), ReadOptions(**options))


def test_an_encoding_is_found_by_its_mark_or_by_what_can_be_decoded(tmp_path):
    path = tmp_path / "a.csv"
    for text, wanted in (
        ("°".encode(), ("utf-8", "strict")),
        ("°".encode("cp1252"), ("cp1252", "replace")),
        ("°".encode("utf-8-sig"), ("utf-8-sig", "replace")),
        ("°".encode("utf-16"), ("utf-16", "replace")),
        (b"\xfe\xff" + "°".encode("utf-16-be"), ("utf-16", "replace")),
        (b"a" * 5000 + b"\xb0", ("cp1252", "replace")),
    ):
        path.write_bytes(text)
        assert read_text.detect_encoding(path) == wanted
    assert read_text.detect_encoding(path, ReadOptions(encoding="latin-1")) == ("latin-1", "strict")
    path.write_bytes(bytes(range(1, 9)) + b"\x0e\x0f\xff")
    with pytest.raises(UserError, match="is a binary file"):
        read_text.detect_encoding(path)


@pytest.mark.parametrize(
    ("rows", "decimal"),
    [
        ([["1,5", "2"]], ","),
        ([["1.5", "2,5", "3,5"]], ","),
        ([["1.5", "2,5"]], "."),  # as many of either
        ([["-,5e-3", "x,y"]], ","),
        ([["1", "2"]], None),
        ([["1.000,5"]], None),
    ],
)
def test_the_decimal_sign_is_that_of_most_numbers(rows, decimal):
    assert read_text._find_decimal(rows) == decimal


def test_the_decimal_sign_of_later_rows_is_that_of_the_first_one_that_has_it():
    assert read_text._find_first_decimal(LOG, ["1;2", "3;4,5", "6.5;7"], ";") == ","
    assert read_text._find_first_decimal(LOG, ["1;2", "3;4"], ";") is None


@pytest.mark.parametrize(
    ("cell", "data"),
    [
        ("1.5", True),
        ("-1,5e+3", True),
        (".5", True),
        ("12:30:01.5", True),
        ("2024-05-01T12:00:00Z", True),
        ("01.05.2024 12:00:00", True),
        ("NaN", True),
        ("", True),
        ("speed", False),
        ("1a", False),
        ("1.2.3", False),
    ],
)
def test_a_cell_of_data_is_a_number_a_time_or_empty(cell, data):
    assert read_text._is_data(cell) == data


def test_of_the_rows_above_the_data_the_names_are_those_that_differ_most_or_stand_last():
    rows = [["speed", "turn_", "axle"], ["s", "deg", "km/h"], ["ECU", "ECU", "IMU"], ["0", "1", "2"]]
    assert read_text._find_names_row(rows, [0, 1, 2]) == 0
    assert (
        read_text._find_names_row([["one_", "two_", "three_"], *rows], [0, 1]) == 1
    )  # equally many: the last
    assert (
        read_text._find_names_row([["one_", "two_", "three_"], [""], ["ECU", "ECU", "IMU"]], [0, 2]) == 2
    )  # apart
    assert read_text._find_names_row([["s", "deg"], ["deg", "s"]], [0, 1]) == 0  # only units
    assert read_text._are_units(["s", "deg", "-", ""]) and not read_text._are_units(["", ""])
    assert not read_text._are_units(["s", "deg", "-", "x", "y"])  # 60 %


LONG = [["1", "a", "5"], ["2", "b", "6"], ["3", "a", "7"], ["4", "b", "8"]]


@pytest.mark.parametrize(
    ("names", "rows", "places"),
    [
        (["time", "signal", "value"], LONG, (0, 1, 2)),
        (["value", "time", "sensor_name"], [[r[2], r[0], r[1]] for r in LONG], (1, 2, 0)),
        (["time", "signal", "value", "car"], [[*r, "x"] for r in LONG], (0, 1, 2, 3)),
        (["time", "signal", "value"], LONG[:1], ()),
        (["time", "signal", "value"], [[r[0], "1", r[2]] for r in LONG], ()),  # numbers are no names
        (["time", "signal", "value"], [[r[0], r[1] + r[0], r[2]] for r in LONG], ()),  # all different
        (["time", "signal", "value"], [[r[0], r[1], "x"] for r in LONG], ()),
        (["time", "signal", "speed"], LONG, ()),
        (["place", "signal", "value"], LONG, ()),
    ],
)
def test_a_long_table_is_known_by_titles_and_cells(names, rows, places):
    assert read_text._find_long_table(names, rows) == places


def test_channels_of_a_long_table_have_their_own_sorted_times(tmp_path):
    text = "time,signal,value\n" + "".join(
        f"{t},{n},{v}\n"
        for t, n, v in (
            (0.2, "v [km/h]", 3), (0.0, "v [km/h]", 1), (0.0, "w_deg", 5),
            (0.1, "v [km/h]", 2), (0.4, "w_deg", 7), (0.3, "w_deg", "x"),
        )
    )  # fmt: skip
    found = read_text.read(write(tmp_path, text), ReadOptions()).channels
    assert {n: (c.time.tolist(), c.unit) for n, c in found.items()} == {
        "v": ([0.0, 0.1, 0.2], "km/h"),
        "w_deg": ([0.0, 0.3, 0.4], "deg"),
    }
    assert found["v"].value.tolist() == [1, 2, 3]
    np.testing.assert_array_equal(found["w_deg"].value, [5, np.nan, 7])
    few = read_text.read(write(tmp_path, text), ReadOptions(wanted=lambda n: n == "v")).channels
    assert list(few) == ["v"]


# ---- VBOX


def write_vbo(folder: Path, names: str, rows: list[str], units: str = "", header: str = "") -> Path:
    text = f"[header]\n{header}\n[channel units]\n{units}\n[column names]\n{names}\n\n[data]\n"
    return write(folder, text + "".join(f"{r}\n" for r in rows), "drive.vbo")


def test_columns_of_the_receiver_are_in_degrees_and_missing_without_enough_satellites(tmp_path):
    names = "sats time lat long velocity heading height vert-vel yaw"
    rows = [
        "008 000001.00 +3030.5M -600 36 90 100 1 5",
        "067 000001.50 +3030.5M -600 36 90 100 1 6",  # bit 64 is a flag: 3 satellites
        "004 000102.00 +3030.5N -600 36 90 100 1 7",
    ]
    found = read_vbo.read(write_vbo(tmp_path, names, rows, "deg/s"), ReadOptions())
    c = found.channels
    assert c["lat"].time.tolist() == [1.0, 1.5, 62.0] and c["sats"].value.tolist() == [8, 3, 4]
    np.testing.assert_allclose(c["lat"].value, [50.508333, np.nan, 50.508333], atol=1e-6)
    np.testing.assert_allclose(c["long"].value, [10.0, np.nan, 10.0])
    for name in ("velocity", "heading", "height", "vert-vel"):
        assert np.isnan(c[name].value).tolist() == [False, True, False]
    assert c["yaw"].value.tolist() == [5, 6, 7] and c["yaw"].unit == "deg/s" and c["yaw"].text == ""
    assert c["velocity"].unit == "km/h" and c["velocity"].text == recording.RECEIVER_TEXT
    assert found.notes == [
        "the receiver had fewer than 4 satellites in 1 rows: "
        "its position and velocity are treated as missing there"
    ]
    every = read_vbo.read(
        write_vbo(tmp_path, names, [r.replace(r[:3], "002", 1) for r in rows]), ReadOptions()
    )
    assert np.isfinite(every.channels["lat"].value).all() and every.notes == []


@pytest.mark.parametrize(
    ("units", "header", "wanted"),
    [
        (["g", "deg/s"], [], ["", "km/h", "g", "deg/s"]),
        (["deg/s"], [], ["", "km/h", "", "deg/s"]),  # the last line is that of the last column
        (["s", "km/h", "g", "deg/s"], [], ["", "km/h", "g", "deg/s"]),  # one for each column
        (["g", "(null)"], [], ["", "km/h", "g", ""]),
        (["g", "deg/s", "", ""], [], ["", "km/h", "g", "deg/s"]),  # blank lines at the end
        (["s", "km/h", "g", ""], [], ["", "km/h", "g", ""]),  # yaw has no unit
        (["s", "km/h", "g", "", ""], [], ["", "km/h", "g", ""]),
        (["g", ""], [], ["", "km/h", "g", ""]),
        (["deg/s", ""], ["x"], ["", "km/h", "deg/s", ""]),
        ([], ["time", "velocity mph", "ax (g)", "yaw_deg"], ["", "mph", "g", "deg"]),
        (["m/s2", "rad/s"], ["time", "velocity kmh", "ax (g)", "yaw_deg"], ["", "km/h", "m/s2", "rad/s"]),
    ],
)
def test_units_of_a_vbox_are_assigned_from_the_last_column(units, header, wanted):
    names = ["time", "velocity", "ax", "yaw"]
    sections = {"channel units": units, "header": header}
    assert read_vbo._find_units(names, names, sections) == wanted


def test_a_blank_line_that_ends_a_short_section_of_units_is_no_unit():
    names = ["time", "ax", "ay", "yaw"]
    assert read_vbo._find_units(names, names, {"channel units": ["deg/s", ""]}) == ["", "", "", "deg/s"]


@pytest.mark.parametrize(
    ("title", "name"),
    [
        ("velocity kmh", "velocity"),
        ("Velocity MPH", "Velocity"),
        ("satellites", "sats"),
        ("vertical velocity kmh", "vert-vel"),
        ("Yaw Rate", "Yaw_Rate"),
        ("longitude", "long"),
    ],
)
def test_names_of_a_vbox_without_column_names_are_its_titles(title, name):
    found = read_vbo._find_names(LOG, {"header": ["", title]})[0]
    assert found == name
    assert read_vbo._find_names(LOG, {"column names": ["a b", "c"], "header": [title]}) == ["a", "b", "c"]


def test_rows_of_a_vbox_with_too_many_cells_or_without_an_end_are_left_out(tmp_path):
    names = "sats time velocity"
    rows = ["5 000001 1,5", "5 000002 2,5 9", "5 000003 3,5"]
    path = write_vbo(tmp_path, names, rows)
    path.write_text(path.read_text() + "5 000004 4,")
    found = read_vbo.read(path, ReadOptions(wanted=lambda n: n == "velocity"))
    assert found.channels["velocity"].value.tolist() == [1.5, 3.5] and list(found.channels) == ["velocity"]
    assert [n[:40] for n in found.notes] == [
        "1 rows of [data] have more cells than th",
        "the last row has no line break: it may b",
    ]
    first = read_vbo.read(write_vbo(tmp_path, names, [rows[1], *rows]), ReadOptions())
    assert first.channels["velocity"].value.tolist() == [1.5, 3.5] and first.notes[0].startswith("2 rows")
    for wide in (["1 2 3 4"] * 2, ["1 2 3 4", "1 2 3"]):
        with pytest.raises(UserError, match=r"every row of \[data\] has more cells"):
            read_vbo.read(write_vbo(tmp_path, "sats time", wide), ReadOptions())
    with pytest.raises(UserError, match="without rows"):
        read_vbo.read(write_vbo(tmp_path, names, []), ReadOptions())
    with pytest.raises(UserError, match=r"neither \[column names\] nor \[header\]"):
        read_vbo.read(write_vbo(tmp_path, "", rows), ReadOptions())


# ---- MAT and HDF5


@pytest.mark.parametrize(
    ("name", "plain"),
    [
        ("wheel.values", "wheel"),
        ("a.signals.values", "a"),
        ("values", "values"),
        ("a.Y", "a"),
        ("a.b", "a.b"),
    ],
)
def test_general_words_are_taken_off_the_end_of_a_path(name, plain):
    assert read_mat._strip_wrappers(name) == plain


@pytest.mark.parametrize(
    ("name", "value", "units", "is_time"),
    [
        ("car.time", RISE, {}, True),
        ("car.timeImu", RISE, {}, True),
        ("car.t_imu", RISE, {}, True),
        ("time.speed", RISE, {}, False),
        ("car.clk", RISE, {"car.clk": "ms"}, True),
        ("car.clk", RISE, {"car.clk": "km/h"}, False),
        ("time", np.zeros(20), {}, False),
        ("time", RISE[::-1], {}, False),
        ("time", np.append(RISE, [0, 0.1, 0, 0.1, 0]), {}, False),  # falls in 3 of 24 steps
        ("time", np.append(RISE, 0.0), {}, True),  # one fall of 20
        ("time", np.full(20, np.nan), {}, False),
    ],
)
def test_a_vector_is_a_time_by_name_or_unit_if_it_rises(name, value, units, is_time):
    assert read_mat._is_time(name, value, units) == is_time


def test_the_time_of_a_vector_is_the_nearest_one_of_its_length():
    times = {"a.time": np.zeros(9), "a.b.time": np.zeros(9), "c.time": np.zeros(9), "a.b.t": np.zeros(5)}
    for name, length, wanted in (
        ("a.b.x", 9, "a.b.time"),
        ("a.x", 9, "a.time"),
        ("c.x", 9, "c.time"),
        ("c.x", 5, "a.b.t"),
        ("c.x", 7, None),
    ):
        assert read_mat._find_nearest_time(name, length, times) == wanted


def save_mat(folder: Path, **variables) -> Path:
    from scipy.io import savemat

    path = folder / "drive.mat"
    savemat(path, variables)
    return path


def test_vectors_of_structs_have_their_units_and_the_times_of_their_struct(tmp_path):
    t = np.arange(6.0)
    path = save_mat(
        tmp_path,
        car={"time": 1e-3 * t, "v": {"values": 2 * t, "Unit": "km/h"}, "w_deg": 3 * t},
        imu={"t": 0.1 * t, "acc": np.stack([t, -t]), "short": t[:3]},
        wide=np.zeros((20, 17)),
        note="text",
    )
    found = read_mat.read(path, ReadOptions()).channels
    assert {n: c.unit for n, c in found.items()} == {
        "car.v": "km/h",
        "car.w_deg": "deg",
        "imu.acc.1": "",
        "imu.acc.2": "",
    }
    np.testing.assert_allclose(found["car.v"].time, 1e-3 * t)
    np.testing.assert_allclose(found["imu.acc.2"].time, 0.1 * t)
    assert (
        found["imu.acc.2"].value.tolist() == (-t).tolist()
        and found["car.v"].value.tolist() == (2 * t).tolist()
    )
    named = read_mat.read(path, ReadOptions(time="imu.t", wanted=lambda n: n == "car.v")).channels
    assert list(named) == ["car.v"]
    np.testing.assert_allclose(named["car.v"].time, 0.1 * t)
    with pytest.raises(UserError, match=r"there is no vector 'imu\.x': correct "):
        read_mat.read(path, ReadOptions(time="imu.x"))


def test_cells_of_a_mat_are_numbered_from_one_and_structs_have_a_unit(tmp_path):
    t = np.arange(6.0)
    cells = np.empty(2, object)
    cells[:] = [2 * t, "text"]
    path = save_mat(tmp_path, t=t, cells=cells, wheel={"unit": "m/s", "fl": 3 * t})
    found = read_mat.read(path, ReadOptions()).channels
    assert {n: (c.value[1], c.unit) for n, c in found.items()} == {"cells.1": (2, ""), "wheel.fl": (3, "m/s")}


def test_a_mat_without_times_is_a_table_or_refused(tmp_path):
    x = np.sin(np.arange(9.0))
    found = read_mat.read(save_mat(tmp_path, ticks=np.arange(9.0), x=x), ReadOptions())
    assert found.channels["x"].time.tolist() == list(range(9))
    with pytest.raises(
        UserError, match=r"no vector has the same length as a vector of times; .*x \(9\), y \(5\)"
    ):
        read_mat.read(save_mat(tmp_path, x=x, y=x[:5]), ReadOptions())
    with pytest.raises(UserError, match="has no vectors of numbers"):
        read_mat.read(save_mat(tmp_path, x=1.0, s="text"), ReadOptions())


@pytest.mark.parametrize(
    ("value", "columns"),
    [
        (np.zeros((5, 2)), {"x.1": 5, "x.2": 5}),
        (np.zeros((2, 5)), {"x.1": 5, "x.2": 5}),
        (np.zeros((16, 16)), {f"x.{k + 1}": 16 for k in range(16)}),
        (np.zeros((20, 17)), {}),
        (np.zeros((1, 5)), {"x": 5}),
        (np.zeros(2), {"x": 2}),
        (np.zeros(1), {}),
        (np.array(["a", "b"]), {}),
        (np.ones(3, bool), {"x": 3}),
        (np.zeros((2, 2, 3)), {}),
    ],
)
def test_a_matrix_is_a_channel_per_column_along_its_longer_side(value, columns):
    assert {n: len(x) for n, x in read_mat._split_columns("x", value)} == columns


def test_datasets_of_hdf5_are_read_column_by_column_with_their_attributes(tmp_path):
    h5py = pytest.importorskip("h5py", reason="h5py is not installed: scripts/setup.sh logs")
    path, t = tmp_path / "drive.h5", 0.01 * np.arange(50)
    with h5py.File(path, "w") as file:
        file["imu/clk"] = 1000 * t
        file["imu/clk"].attrs["unit"] = "ms"
        file["imu/acc"] = np.stack([t, 2 * t, 3 * t])
        file["imu/v"] = 5 * t[:, None]
        file["imu/v"].attrs["units"] = "km/h"
        file["imu/wide"] = np.zeros((50, 17))
        file["wheel/time"], file["wheel/fl"] = t, 7 * t
        file["wheel/unit"] = np.array([[ord(c)] for c in "m/s"], np.uint16)
        file["wheel/unit"].attrs["MATLAB_class"] = np.bytes_("char")
        file["#refs#/x"] = t
        file["object"] = t
        file["object"].attrs["MATLAB_object_decode"] = 1
    found = read_mat.read(path, ReadOptions())
    assert {n: (c.value[10], c.unit) for n, c in found.channels.items()} == {
        "imu.acc.1": (pytest.approx(0.1), ""),
        "imu.acc.2": (pytest.approx(0.2), ""),
        "imu.acc.3": (pytest.approx(0.3), ""),
        "imu.v": (pytest.approx(0.5), "km/h"),
        "wheel.fl": (pytest.approx(0.7), "m/s"),
    }
    np.testing.assert_allclose(found.channels["imu.v"].time, t)
    assert found.notes == ["MATLAB objects are not read, save them as structs: object"]


# ---- Parquet


def test_fields_of_structs_and_their_units_are_read_from_parquet(tmp_path):
    pa = pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq

    t = 0.1 * np.arange(5)
    inner = pa.StructArray.from_arrays([pa.array(2 * t), pa.array(3 * t)], ["v", "w"])
    outer = pa.StructArray.from_arrays([inner, pa.array(4 * t)], ["wheel", "x"])
    fields = [
        pa.field("time", pa.float64(), metadata={"unit": "s"}),
        pa.field("car", outer.type),
        pa.field("a", pa.float64(), metadata={"Units": "m/s2", "description": "of the car"}),
        pa.field("k", pa.dictionary(pa.int8(), pa.float64())),
    ]
    columns = [
        pa.array(t),
        outer,
        pa.array(5 * t),
        pa.array(np.repeat([1.5, 2.5], [2, 3])).dictionary_encode(),
    ]
    columns[3] = columns[3].cast(fields[3].type)
    pq.write_table(pa.table(columns, schema=pa.schema(fields)), tmp_path / "a.parquet")
    found = read_columns.read(tmp_path / "a.parquet", ReadOptions()).channels
    last = {n: c.value[4] for n, c in found.items()}
    wanted = {"car.wheel.v": 0.8, "car.wheel.w": 1.2, "car.x": 1.6, "a": 2.0, "k": 2.5}
    assert last == {n: pytest.approx(x) for n, x in wanted.items()}
    assert (found["a"].unit, found["a"].text) == ("m/s2", "of the car")


# ---- MDF


class FakeMdf:
    """Two groups as asammdf has them; the raw values of one channel are numbers."""

    def __init__(self, channels: list[dict[str, SimpleNamespace]], names: list[str]):
        self._channels = channels
        self.groups = [
            SimpleNamespace(
                channel_group=SimpleNamespace(acq_name=name, comment="", cycles_nr=4),
                channels=[SimpleNamespace(name=n) for n in group],
            )
            for group, name in zip(channels, names, strict=True)
        ]
        self.masters_db = {0: 0, 1: 0}

    def get(self, group: int, index: int, raw: bool, **_: object) -> SimpleNamespace:
        signal = list(self._channels[group].values())[index]
        return getattr(signal, "raw", signal) if raw else signal


def make_signal(time, samples, **more) -> SimpleNamespace:
    own = {"invalidation_bits": None, "unit": "", "comment": ""} | more
    return SimpleNamespace(timestamps=np.asarray(time), samples=np.asarray(samples), **own)


def test_channels_of_mdf_groups_keep_their_times_units_and_invalid_values(tmp_path):
    t, s = [0.0, 0.1, 0.2, 0.3], [1.0, 1.1, 1.2, 1.3]
    words = make_signal(t, ["a", "b", "a", "a"], raw=make_signal(t, [1, 2, 1, 1]))
    groups = [
        {
            "t": make_signal(t, t),
            "v": make_signal(t, [1, 2, 3, 4], unit="km/h", comment="fast"),
            "gear": words,
            "gone": make_signal(t, [1.0, 2, 3, 4], invalidation_bits=np.array([0, 1, 0, 1])),
            "matrix": make_signal(t, np.zeros((4, 2))),
        },
        {"t": make_signal(s, s), "v": make_signal(s, [5.0, 6, 7, 8]), "empty": make_signal([], [])},
    ]
    path = tmp_path / "a.mf4"
    path.write_bytes(bytes(100))
    found = read_mdf._read_channels(path, FakeMdf(groups, ["ESP", "ABS"]), ReadOptions())
    assert {n: (c.value.tolist(), c.time[0], c.unit, c.text) for n, c in found.items() if n != "gone"} == {
        "ESP.v": ([1, 2, 3, 4], 0.0, "km/h", "fast"),
        "gear": ([1, 2, 1, 1], 0.0, "", ""),
        "ABS.v": ([5, 6, 7, 8], 1.0, "", ""),
    }
    np.testing.assert_array_equal(found["gone"].value, [1, np.nan, 3, np.nan])
    assert found["ESP.v"].time is found["gone"].time
    few = read_mdf._read_channels(
        path, FakeMdf(groups, ["ESP", "ABS"]), ReadOptions(wanted=lambda n: n == "gear")
    )
    assert list(few) == ["gear"]


@pytest.mark.parametrize(("count", "parts"), [(0, []), (3, [3]), (4, [4]), (9, [4, 4, 1])])
def test_frames_of_an_mf4_are_read_in_parts_up_to_the_last(count, parts, monkeypatch):
    monkeypatch.setattr(read_mdf, "CHUNK_ROWS", 4)
    frames = np.arange(count)

    def get(record_offset: int, record_count: int, **_: object) -> SimpleNamespace:
        return SimpleNamespace(samples=frames[record_offset : record_offset + record_count])

    found = [s.samples for s in read_mdf._read_chunks(SimpleNamespace(get=get), 0, 0)]
    assert [len(x) for x in found] == parts and np.array_equal(np.concatenate([*found, frames[:0]]), frames)


def test_an_mdf_is_finished_by_its_first_bytes():
    file = io.BytesIO(b"MDF     4.10")
    assert read_mdf._is_finished(file) and file.tell() == 0
    assert not read_mdf._is_finished(io.BytesIO(b"UnFinMF 4.10"))


# ---- MCAP, ROS bags, openpilot


def write_mcap(path: Path, messages: list[tuple[str, str, int, bytes]]) -> Path:
    writer_of = pytest.importorskip(
        "mcap.writer", reason="mcap is not installed: scripts/setup.sh logs"
    ).Writer
    with open(path, "wb") as file:
        writer, opened = writer_of(file), {}
        writer.start()
        for topic, encoding, at, data in messages:
            if topic not in opened:
                opened[topic] = writer.register_channel(topic, encoding, 0)
            writer.add_message(opened[topic], log_time=at, publish_time=0, data=data)
        writer.finish()
    return path


def test_messages_of_an_mcap_have_the_time_of_their_log_in_s_and_unknown_ones_are_named(tmp_path):
    parts = [("/v", "json", int(1e9 * (5 + 0.5 * k)), json.dumps({"x": k}).encode()) for k in range(4)]
    path = write_mcap(tmp_path / "a.mcap", [*parts, ("/raw", "cbor", 0, b"")])
    found = read_recording(path)
    assert found.channels["/v.x"].value.tolist() == [0, 1, 2, 3] and found.format == "MCAP"
    np.testing.assert_allclose(found.channels["/v.x"].time, [5.0, 5.5, 6.0, 6.5])
    assert found.notes == ["topics that cannot be read: /raw (encoding 'cbor')"]
    path.write_bytes(path.read_bytes()[:-8])
    assert "the end of the file is missing: the part before is used" in read_recording(path).notes
    only = write_mcap(tmp_path / "b.mcap", [("/raw", "cbor", 0, b"")])
    with pytest.raises(UserError, match=r"no topic can be read: /raw \(encoding 'cbor'\)"):
        read_recording(only)


def make_record(data: bytes, **fields: bytes) -> bytes:
    parts = b"".join(
        struct.pack("<I", len(n) + 1 + len(v)) + n.encode() + b"=" + v for n, v in fields.items()
    )
    return struct.pack("<I", len(parts)) + parts + struct.pack("<I", len(data)) + data


def test_a_record_of_a_bag_has_a_kind_fields_and_data():
    record = make_record(b"data", op=b"\x07", topic=b"/a=b", conn=b"\x01\0\0\0")
    kind, fields, data = read_rosbag._read_record(io.BytesIO(record))
    assert (kind, data) == (7, b"data") and fields[b"topic"] == b"/a=b" and fields[b"conn"] == b"\x01\0\0\0"
    with pytest.raises(EOFError):
        read_rosbag._read_record(io.BytesIO(record[:-1]))
    for method, packed in ((b"none", b"abc"), (b"bz2", bz2.compress(b"abc"))):
        assert read_rosbag._unpack_chunk(method, packed) == b"abc"


@pytest.mark.parametrize("method", ["bz2", "lz4"])
def test_a_chunk_of_a_bag_is_unpacked_up_to_the_limit_only(method, monkeypatch):
    frame = pytest.importorskip("lz4.frame", reason="lz4 is not installed: scripts/setup.sh logs")
    packed = (bz2 if method == "bz2" else frame).compress(bytes(100_000))
    assert len(read_rosbag._unpack_chunk(method.encode(), packed)) == 100_000
    monkeypatch.setattr(read_rosbag, "MAX_RECORD_BYTES", 1000)
    monkeypatch.setattr(read_rosbag, "len", lambda x: sizes.append(len(x)) or len(x), raising=False)
    sizes = []
    with pytest.raises(ValueError, match="larger than 1 GB"):
        read_rosbag._unpack_chunk(method.encode(), packed)
    assert sizes == [1000]


@pytest.mark.parametrize(("at", "closed"), [(0, False), (60, True), (10_000, False)])
def test_a_bag_is_closed_if_its_index_is_within_the_file(at, closed, tmp_path):
    path = tmp_path / "a.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + make_record(b" " * 100, op=b"\x03", index_pos=struct.pack("<Q", at)))
    assert read_rosbag._is_closed(path) == closed
    path.write_bytes(b"#ROSBAG V2.0\n" + make_record(b" " * 100, op=b"\x05"))
    assert read_rosbag._is_closed(path)


def test_messages_of_a_bag_without_an_index_have_their_time_and_topic(tmp_path):
    pytest.importorskip("rosbags", reason="rosbags is not installed: scripts/setup.sh logs")
    from rosbags import typesys

    number = struct.pack("<I", 3)
    definition = make_fields(topic=b"/v", type=b"std_msgs/Float64", message_definition=b"float64 data")
    inner = make_record(definition, op=b"\x07", conn=number, topic=b"/v")
    for k in range(3):
        stamp = struct.pack("<II", 7 + k, 250_000_000)
        inner += make_record(struct.pack("<d", 0.5 * k), op=b"\x02", conn=number, time=stamp)
    inner += make_record(b"", op=b"\x02", conn=struct.pack("<I", 9), time=struct.pack("<II", 1, 0))
    chunk = make_record(bz2.compress(inner), op=b"\x05", compression=b"bz2", size=b"")
    path = tmp_path / "a.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + make_record(b"", op=b"\x03", index_pos=bytes(8)) + chunk + b"cut")
    found = [(topic, t, m.data, kind) for topic, t, m, kind in read_rosbag._read_from_front(path, typesys)]
    assert found == [("/v", 7.25 + k, 0.5 * k, "std_msgs/msg/Float64") for k in range(3)]


def test_messages_of_a_closed_bag_without_a_header_have_the_time_of_the_bag(tmp_path):
    pytest.importorskip("rosbags", reason="rosbags is not installed: scripts/setup.sh logs")
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store, path = get_typestore(Stores.ROS1_NOETIC), tmp_path / "a.bag"
    kind = "std_msgs/msg/Float64"
    with Writer(path) as bag:
        topic = bag.add_connection("/v", kind, typestore=store)
        for k in range(3):
            raw = store.serialize_ros1(store.types[kind](0.5 * k), kind)
            bag.write(topic, 7_250_000_000 + 500_000_000 * k, raw)
    c = read_recording(path).channels["/v.data"]
    assert c.value.tolist() == [0, 0.5, 1.0] and c.text == kind
    np.testing.assert_allclose(c.time, [7.25, 7.75, 8.25])


def make_fields(**fields: bytes) -> bytes:
    return b"".join(struct.pack("<I", len(n) + 1 + len(v)) + n.encode() + b"=" + v for n, v in fields.items())


def test_a_bag_is_its_file_or_the_folder_of_all_its_files(tmp_path):
    base = tmp_path / "a_0.db3"
    base.write_bytes(b"SQLite format 3\0")
    assert read_rosbag._find_bag(tmp_path) == tmp_path
    bag = tmp_path / "a.BAG"
    bag.touch()
    assert read_rosbag._find_bag(bag) == bag
    with pytest.raises(UserError, match="its folder has no metadata"):
        read_rosbag._find_bag(base)
    (tmp_path / "metadata.yaml").touch()
    assert read_rosbag._find_bag(base) == tmp_path


def test_events_of_openpilot_are_unpacked_and_sensors_have_a_channel_each(tmp_path):
    path = tmp_path / "rlog"
    for content in (b"plain", bz2.compress(b"plain")):
        path.write_bytes(content)
        assert read_openpilot._unpack(path) == b"plain"
    path.write_bytes(bz2.compress(b"plain")[:-4])
    with pytest.raises(UserError, match="is damaged or cut off"):
        read_openpilot._unpack(path)

    def make(kind: str, **fields: float) -> SimpleNamespace:
        return SimpleNamespace(which=lambda: kind, to_dict=lambda: fields)

    collect = Collector(LOG)
    read_openpilot._add(collect, "carState", 1.0, make("", vEgo=5.0))
    read_openpilot._add(collect, "sensorEvents", 2.0, [make("gyro", z=1.0), make("accel", x=3.0)])
    found = {n: (c.time.tolist(), c.value.tolist()) for n, c in collect.channels().items()}
    assert found == {
        "carState.vEgo": ([1.0], [5.0]),
        "sensorEvents.gyro.z": ([2.0], [1.0]),
        "sensorEvents.accel.x": ([2.0], [3.0]),
    }


# ---- The reader of a file


@pytest.mark.parametrize(
    ("name", "content", "reader"),
    [
        ("a.csv", b"MDF     4.10", "mdf"),  # the first bytes come before the suffix
        ("a.x", b"UnFinMF 4.10", "mdf"),
        ("a.csv", b"LOGG", "can"),
        ("a.log", b"(0.1) can0 083#0F\n", "can"),
        ("a.log", b"time,v\n0,1\n", "text"),
        ("a.can", b"time,v\n0,1\n", "text"),
        ("a.asc", b"anything\n", "can"),
        ("a.dat", b"time,v\n0,1\n", "text"),
        ("a.vbo", b"[header]\n", "vbo"),
        ("a.rlog", b"\x01\x02\0\0", "openpilot"),
        ("a", b"time,v\n0,1\n", "text"),
        ("a.csv", b"\xff\xfet\0i\0", "text"),
        ("a.mat", b"MATLAB 5.0 MAT-file", "mat"),
        ("a.h5", b"\x89HDF\r\n", "mat"),
        ("a.db3", b"SQLite format 3\0", "rosbag"),
        ("a.bag", b"#ROSBAG V2.0\n", "rosbag"),
        ("a.parquet", b"PAR1", "columns"),
        ("a.feather", b"ARROW1\0\0", "columns"),
        ("a.mcap", b"\x89MCAP0\r\n", "mcap"),
    ],
)
def test_the_reader_of_a_file_is_that_of_its_first_bytes_or_its_suffix(name, content, reader, tmp_path):
    (tmp_path / name).write_bytes(content)
    assert choose_reader(tmp_path / name) == reader


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.csv", b" \n", "is empty"),
        ("a.XLSX", b"PK\x03\x04", "save the sheet as CSV"),
        ("a.zip", b"PK", "unpack it first"),
        ("a.mf4", b"time,v\n", "does not begin like a .mf4 file"),
        ("a.dat", b"\0\0\0\0", "does not begin like a .dat file"),
        ("a.parquet", b"text", "does not begin like a .parquet file"),
        ("a.csv", b"a\0b", "is a binary file of an unknown format"),
        ("a.log", b"\0\0", None),
    ],
)
def test_a_file_that_no_reader_reads_is_refused_with_the_remedy(name, content, said, tmp_path):
    (tmp_path / name).write_bytes(content)
    if said is None:
        assert choose_reader(tmp_path / name) == "can"
        return
    with pytest.raises(UserError, match=said):
        choose_reader(tmp_path / name)


def test_folders_pipes_and_missing_files_are_no_logs(tmp_path):
    with pytest.raises(UserError, match="is a directory without metadata"):
        choose_reader(tmp_path)
    (tmp_path / "metadata.yaml").touch()
    assert choose_reader(tmp_path) == "rosbag"
    with pytest.raises(NoFile, match="no such file"):
        choose_reader(tmp_path / "gone.csv")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(UserError, match="is no file but a pipe or a device"):
        choose_reader(tmp_path / "pipe")


def test_a_packed_log_is_unpacked_under_its_own_name_and_only_up_to_its_limit(tmp_path, monkeypatch):
    path = tmp_path / "drive.csv.gz"
    path.write_bytes(gzip.compress(b"time,v\n0,1\n1,2\n"))
    with readers.unpack_log(path) as plain:
        assert plain.name == "drive.csv" and plain.read_text() == "time,v\n0,1\n1,2\n"
    assert not plain.exists()
    found = read_recording(path)
    assert found.path == path and found.channels["v"].value.tolist() == [1, 2]
    plain = write(tmp_path, "time,v\n0,1\n")
    with readers.unpack_log(plain) as same:
        assert same == plain
    monkeypatch.setattr(readers, "MIN_UNPACKED_LIMIT", 1000)
    noise = np.random.default_rng(1).bytes(5000)
    for content in (b"\n" * 1000, noise):
        path.write_bytes(gzip.compress(content))
        with readers.unpack_log(path) as plain:
            assert plain.read_bytes() == content
    for content in (b"\n" * 4000, b"\n" * 100_000):
        path.write_bytes(gzip.compress(content))
        with pytest.raises(UserError, match="allowed: 40 times"), readers.unpack_log(path):
            pass
    path.write_bytes(gzip.compress(b"time,v\n")[:-4])
    with pytest.raises(UserError, match="is damaged or cut off"), readers.unpack_log(path):
        pass


def test_a_log_without_numbers_is_refused_and_times_begin_near_zero(tmp_path):
    path = write(tmp_path, "time,v\n1700000000.5,1\n1700000001.5,2\n")
    found = read_recording(path)
    assert found.start == 1.7e9 and found.channels["v"].time.tolist() == [0.5, 1.5]
    with pytest.raises(UserError, match="has no channel with numbers in it"):
        read_recording(write(tmp_path, "time,v\n0,a\n1,b\n"))
