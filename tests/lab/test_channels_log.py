"""Reading of logs and data frames, function by function: headers, cells, wheel speeds
that are substituted, channels of a lower rate, and the messages about what is wrong."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from tse.channels import log as module
from tse.channels.log import adapt_to_car, convert_to_numbers, map_own_names, read_frame, read_log
from tse.channels.mapping import Series
from tse.library.errors import NoFile, UserError
from tse.log.rows import Reading
from tse.readers.recording import Channel, Recording

T = np.arange(60) * 0.02
TURN = 0.1 * np.sin(1.3 * T)
FULL = {
    "time": T,
    "steer_angle": 0.02 * np.sin(1.1 * T),
    "wheel_speed_front": 50.0 + T,
    "wheel_speed_rear": 49.0 + T,
    "accel_x": np.cos(0.7 * T),
    "accel_y": np.sin(0.9 * T),
    "yaw_rate": TURN,
}
NAN = np.nan


def leave_out(*names: str, **more) -> dict:
    return {n: x for n, x in FULL.items() if n not in names} | more


def make_car(front: float, rear: float) -> SimpleNamespace:
    return SimpleNamespace(values={"wheel_radius_front": front, "wheel_radius_rear": rear})


def write(folder: Path, table: dict, name: str = "log.csv", **options) -> Path:
    path = folder / name
    pd.DataFrame(table).to_csv(path, index=False, **options)
    return path


# ---- Wheel speeds of an axle that the log lacks


@pytest.mark.parametrize(
    ("gone", "by"), [("wheel_speed_front", 0.36 / 0.3), ("wheel_speed_rear", 0.3 / 0.36)]
)
def test_a_substituted_wheel_speed_times_its_radius_is_the_speed_of_the_other_axle(
    gone: str, by: float
) -> None:
    """The front wheels of 0.3 m turn faster than the rear wheels of 0.36 m."""
    log = read_frame(leave_out(gone))
    other = next(c for c in ("wheel_speed_front", "wheel_speed_rear") if c != gone)
    assert log.stand_in == gone and np.array_equal(log.data[gone], log.data[other])
    first = adapt_to_car(log, make_car(0.3, 0.36))
    np.testing.assert_allclose(first.data[gone], by * FULL[other])
    np.testing.assert_array_equal(first.data[other], FULL[other])
    assert first.stands_by == pytest.approx(by)
    # with another car, the radii of the first one no longer matter
    second = adapt_to_car(first, make_car(0.4, 0.4))
    np.testing.assert_allclose(second.data[gone], FULL[other])


def test_both_wheel_speeds_of_a_log_stay_as_they_are() -> None:
    log = read_frame(FULL)
    assert adapt_to_car(log, make_car(0.3, 0.36)) is log


def test_a_car_that_is_given_to_a_log_scales_its_wheels(tmp_path: Path) -> None:
    path = write(tmp_path, leave_out("wheel_speed_rear"))
    log = read_log(path, reading=Reading(car=make_car(0.3, 0.36)))
    np.testing.assert_allclose(log.data["wheel_speed_rear"], FULL["wheel_speed_front"] / 1.2)


def test_the_speed_of_the_car_is_that_of_a_front_wheel_only_without_wheel_speeds() -> None:
    speed = Series("vehicle_speed", T, 15.0 + T, 0.03, True)
    notes: list[str] = []
    found = {"vehicle_speed": speed}
    module._substitute_speed(Path("x"), found, Reading(car=make_car(0.3, 0.5)), notes)
    made = found["wheel_speed_front"]
    np.testing.assert_allclose(made.value, (15.0 + T) / 0.3)
    assert (made.channel, made.time is T, made.latency, made.hold) == ("wheel_speed_front", True, 0.03, True)
    assert found["vehicle_speed"] is speed and notes == [
        "the log has no wheel speed: vehicle_speed is used instead"
    ]
    for others in ({"vehicle_speed": speed, "wheel_speed_rear": speed}, {"yaw_rate": speed}):
        before = dict(others)
        module._substitute_speed(Path("x"), others, Reading(car=make_car(0.3, 0.5)), notes)
        assert others == before
    with pytest.raises(UserError, match="the radius of the wheels is needed"):
        module._substitute_speed(Path("x"), {"vehicle_speed": speed}, Reading(), [])


def test_channels_slower_than_the_rows_have_their_entries_and_axles_the_mean_of_their_wheels() -> None:
    t, u = np.array([0.0, 0.1, 0.2]), np.array([0.05, 0.15, 0.25])
    native = {
        "yaw_rate": (t, t + 1, 10.0),
        "wheel_speed_rear_left": (t, 40.0 + t, 20.0),
        "wheel_speed_rear_right": (u, 44.0 + u, 20.0),
        "wheel_speed_front_left": (t, t, 20.0),  # the right one is as fast as the rows
        "vehicle_speed": (t, t, 10.0),
    }
    found = module._join_slow_channels(native, 100.0)
    assert set(found) == {"yaw_rate", "wheel_speed_rear"}
    assert found["yaw_rate"].rows == 10.0 and np.array_equal(found["yaw_rate"].value, t + 1)
    rear = found["wheel_speed_rear"]
    assert rear.rows == 5.0 and rear.time is t
    np.testing.assert_allclose(rear.value[1:], 42.0 + t[1:])


# ---- Which CSV is read without signals.toml


@pytest.mark.parametrize(
    ("head", "row", "is_plain"),
    [
        ("time,steer_angle,accel_x,accel_y", "0.1,0.2,0.3,0.4", True),
        ("time,steer_angle,accel_x", "0.1,0.2,0.3", False),
        ("time,steer_angle,accel_x,other", "0.1,0.2,0.3,0", False),
        ("t,steer_angle,accel_x,accel_y,yaw_rate", "0,0,0,0,0", False),
        ("time;steer_angle;accel_x;accel_y", "0;0;0;0", False),
        ("time,Steer_Angle,Accel_X,accel_y", "0,0,0,0", True),  # refused later with a hint
        ("time,steer_angle,accel_x,accel_y", "12:30:01,0,0,0", False),
        ("time,steer_angle,accel_x,accel_y", "2024-05-01,0,0,0", True),
        ("time,steer_angle,accel_x,accel_y", '"0,1",0,0,0', False),
        ("time,steer_angle,accel_x,accel_y", '0.1,"0,1",0,0', True),
        ("time,wheel_speed_front_left,wheel_speed_front_right,accel_y", "0,0,0,0", True),
        (" time , steer_angle ,accel_x,accel_y", "0,0,0,0", True),
    ],
)
def test_a_csv_in_the_names_of_the_library_is_plain(
    head: str, row: str, is_plain: bool, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"{head}\n{row}\n")
    assert module._is_plain(path, Reading()) is is_plain
    assert not module._is_plain(path, Reading(rate=50.0))
    assert not module._is_plain(path, Reading(signals=tmp_path / "signals.toml"))
    (tmp_path / "signals.toml").write_text('[signals.yaw_rate]\nname = "gier"\n')
    assert module._is_plain(path, Reading()) is is_plain
    (tmp_path / "log.signals.toml").write_text('[signals.accel_y]\nname = "accel_y"\n')
    assert not (is_plain and "accel_y" in head) or not module._is_plain(path, Reading())


def test_no_text_or_no_file_is_not_plain(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    assert not module._is_plain(path, Reading()) and not module._is_plain(tmp_path, Reading())
    for content in (b"time,accel_x,accel_y,yaw_rate\n\xff\xfe", b"time,accel_x,accel_y,yaw_rate\n\0", b""):
        path.write_bytes(content)
        assert not module._is_plain(path, Reading())


# ---- Cells of a CSV


def test_the_last_row_counts_only_with_its_line_break(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    for content, head, whole in (
        ("a,b\n1,2\n3,4\n", ["a,b", "1,2"], None),
        ("a,b\n1,2\n3,4", ["a,b", "1,2"], 1),
        ("a,b\n1,2\n3,4\n5", ["a,b", "1,2"], 2),
        ("a,b", ["a,b"], None),
        ("a,b\n" + "1,2\n" * 300000 + "3", ["a,b", "1,2"], 300000),
    ):
        path.write_text(content)
        assert module._read_head(path) == (head, whole)
    path.write_text("\ufeffa,b\n1,2\n", encoding="utf-8")
    assert module._read_head(path)[0] == ["a,b", "1,2"]
    for content, message in (
        ("a,b\n1,2", "has one row, without a line break"),
        (" \n", "is empty"),
        ("a\0,b\n1,2\n", "is a binary file"),
    ):
        path.write_text(content)
        with pytest.raises(UserError, match=message):
            module._read_head(path)
    path.write_bytes(b"a,b\n" + b"1,2\n" * 300000 + b"\xff\n")
    with pytest.raises(UserError, match="is not a text file in UTF-8"):
        module._read_head(path)
    with pytest.raises(NoFile):
        module._read_head(tmp_path / "none.csv")
    with pytest.raises(UserError, match="is a directory"):
        module._read_head(tmp_path)


def test_numbers_are_read_and_other_cells_are_missing() -> None:
    cells = pd.Series(["1.5", "x", None, "-2e3", " 4 "])
    np.testing.assert_array_equal(convert_to_numbers(cells), [1.5, NAN, NAN, -2000.0, 4.0])
    huge = convert_to_numbers(pd.Series(["1" * 400, "7", "x"], [4, 6, 8]))
    assert huge.index.tolist() == [4, 6, 8] and huge.tolist()[:2] == [np.inf, 7.0] and np.isnan(huge[8])


@pytest.mark.parametrize(("bad", "is_read"), [(3, True), (4, False)])
def test_at_most_a_twentieth_of_a_column_may_be_no_numbers(bad: int, is_read: bool, tmp_path: Path) -> None:
    """Of 60 cells, 3."""
    cells = FULL["accel_y"].astype(str).astype(object)
    cells[10 : 10 + bad] = "1,2"
    path = write(tmp_path, FULL | {"accel_y": cells})
    if not is_read:
        message = "line 12, column accel_y: '1,2' is not a number; .*; decimals are written with a point"
        with pytest.raises(UserError, match=message):
            read_log(path)
        return
    log = read_log(path)
    assert np.flatnonzero(log.data["accel_y"].isna()).tolist() == [10, 11, 12]
    assert (
        "accel_y: 3 cells that are no numbers are treated as missing (first in line 12: '1,2')" in log.notes
    )


def test_an_empty_cell_is_missing_and_a_row_whose_time_repeats_is_left_out(tmp_path: Path) -> None:
    time, across = T.copy(), FULL["accel_y"].astype(object)
    time[20], across[30] = time[21], ""
    log = read_log(write(tmp_path, FULL | {"time": time, "accel_y": across}))
    assert len(log) == 59 and log.line[19:21].tolist() == [21, 23]
    np.testing.assert_allclose(log.data["yaw_rate"], np.delete(TURN, 20))
    assert np.flatnonzero(log.data["accel_y"].isna()).tolist() == [29]
    assert not any("no number" in n for n in log.notes)


def test_an_optional_column_that_is_not_numeric_is_left_out(tmp_path: Path) -> None:
    table = FULL | {"ref_cy": np.array(["x", *T[1:].astype(str)], object), "brake": T > 0.5, "note": "hello"}
    log = read_log(write(tmp_path, table))
    assert "column ref_cy, brake is not numeric: not used" in log.notes
    assert list(log.ref) == [] and list(log.extra) == []


def test_a_row_that_is_cut_is_left_out(tmp_path: Path) -> None:
    path = write(tmp_path, FULL)
    path.write_text(path.read_text()[:-4])
    log = read_log(path)
    assert len(log) == 59 and log.line[-1] == 60
    assert "line 61, the last, has no line break: it may be cut inside a number and is left out" in log.notes


@pytest.mark.parametrize(
    ("header", "missing", "text"),
    [
        (["time;accel_x"], ["accel_y"], "; the columns must be separated by commas"),
        (["1.0", "2"], ["accel_y"], "; the first line must name the columns"),
        (["time", "Accel_Y"], ["accel_y"], "; names are lower case: Accel_Y -> accel_y"),
        (["time"], ["wheel_speed_rear"], "; instead of the column of an axle, those of its left and right"),
        (
            ["time"],
            ["accel_y"],
            "accel_y is missing in the header (line 1)\n  needed: accel_y\n  found:  time",
        ),
    ],
)
def test_a_missing_column_is_explained(header: list[str], missing: list[str], text: str) -> None:
    found = module._describe_missing(Path("log.csv"), header, missing, missing)
    assert text in found
    assert ("left and right" in found) == ("wheel" in missing[0])


@pytest.mark.parametrize(
    ("header", "row", "message"),
    [
        (["a", "b"], "1,2", ""),
        (["a", "b"], "1,2,3", "3 cells, but the header .line 1. names 2 columns$"),
        (["a", "b"], "0,1,0,2", "hint: the comma is both separator of columns and decimal mark"),
        (["a", "b"], "x,1,0,2", "names 2 columns$"),
    ],
)
def test_a_first_row_longer_than_the_header_is_refused(header: list[str], row: str, message: str) -> None:
    if not message:
        module._check_first_row(Path("log.csv"), header, [row])
        return
    with pytest.raises(UserError, match=message):
        module._check_first_row(Path("log.csv"), header, [row])


def test_a_range_is_that_of_the_axle_of_a_wheel() -> None:
    assert module._describe_range("time") == "seconds, increasing"
    assert module._describe_range("wheel_speed_rear_left") == module._describe_range("wheel_speed_rear")
    assert module._describe_range("accel_y") == "-50 .. 50 m/s2"


@pytest.mark.parametrize(
    ("column", "is_twice", "is_refused"),
    [("accel_y", True, True), ("ref_cy", True, True), ("note", True, False), ("accel_y", False, False)],
)
def test_a_column_that_is_read_must_not_appear_twice(column, is_twice, is_refused, tmp_path: Path) -> None:
    table = pd.DataFrame(FULL | {"ref_cy": T, "note": T})
    if is_twice:
        table.insert(3, column, T, allow_duplicates=True)
    path = tmp_path / "log.csv"
    table.to_csv(path, index=False)
    if is_refused:
        with pytest.raises(UserError, match=f"column {column} appears more than once"):
            read_log(path)
    else:
        assert len(read_log(path)) == 60


# ---- Data frames


def test_the_index_of_a_frame_may_be_its_time() -> None:
    plain = read_frame(FULL)
    table = pd.DataFrame(leave_out("time"))
    named = table.set_index(pd.Index(T, name="time"))
    dated = table.set_index(pd.Timestamp("2024-05-01 10:00:00") + pd.to_timedelta(T, unit="s"))
    spans = table.set_index(pd.to_timedelta(T, unit="s"))
    for frame in (named, dated, spans):
        log = read_frame(frame)
        np.testing.assert_allclose(log.time - log.time[0], plain.time, atol=1e-6)
        assert np.array_equal(log.data["yaw_rate"], plain.data["yaw_rate"])
    with pytest.raises(UserError, match="column time is missing"):
        read_frame(table.set_index(pd.Index(T, name="t")))


def test_rows_of_series_are_matched_by_their_index_or_refused() -> None:
    series = {n: pd.Series(x) for n, x in FULL.items()}
    assert len(read_frame(series)) == 60
    series["yaw_rate"] = pd.Series(TURN, np.arange(60) + 1)
    with pytest.raises(UserError, match="Series with different indices"):
        read_frame(series)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.ones(60, complex), "column accel_y is not numeric; allowed: -50 .. 50 m/s2, or NaN for missing"),
        (np.ones(60, bool), "column accel_y is not numeric"),
        (pd.to_timedelta(T, unit="s"), "column accel_y is not numeric"),
        (np.ones((60, 2)), r"column accel_y has shape \(60, 2\)"),
        (np.ones(59), r"column accel_y has shape \(59,\)"),
    ],
)
def test_a_column_that_is_no_measurement_is_refused(values: object, message: str) -> None:
    with pytest.raises(UserError, match=message):
        read_frame(FULL | {"accel_y": values})


def test_masked_values_are_missing_and_a_brake_may_be_boolean() -> None:
    masked = np.ma.masked_array(FULL["accel_y"], np.arange(60) == 7)
    log = read_frame(FULL | {"accel_y": masked, "brake": T > 0.5, "ref_cy": np.full(60, "x")})
    assert np.flatnonzero(log.data["accel_y"].isna()).tolist() == [7]
    assert log.extra["brake"].tolist() == (T > 0.5).astype(float).tolist()
    assert list(log.ref) == [] and "column ref_cy is not numeric: not used" in log.notes


def test_a_frame_needs_rows_and_its_columns_once() -> None:
    with pytest.raises(UserError, match="log: has no rows"):
        read_frame({n: x[:0] for n, x in FULL.items()})
    with pytest.raises(UserError, match="drive: column steer_angle is missing\n  needed"):
        read_frame(leave_out("steer_angle"), "drive")
    message = "wheel_speed_front, wheel_speed_rear is missing; instead of the column of an axle"
    with pytest.raises(UserError, match=message):
        read_frame(leave_out("wheel_speed_front", "wheel_speed_rear"))
    twice = pd.DataFrame(FULL)
    twice.insert(3, "accel_y", T, allow_duplicates=True)
    with pytest.raises(UserError, match="column accel_y appears more than once"):
        read_frame(twice)


def test_wheels_of_a_frame_replace_their_axle_and_rows_count_from_0() -> None:
    wheels = {"wheel_speed_rear_left": 48.0 - TURN, "wheel_speed_rear_right": 50.0 + TURN}
    log = read_frame(leave_out("wheel_speed_rear", **wheels))
    np.testing.assert_allclose(log.data["wheel_speed_rear"], 49.0)
    assert log.line[0] == 0 and log.place == "row" and log.stand_in is None
    out = FULL["accel_y"].copy()
    out[3] = 900.0
    assert any("row 3" in n for n in read_frame(FULL | {"accel_y": out}).notes)


# ---- Logs of other formats


def make_recording(*names: str) -> Recording:
    return Recording(Path("log.mf4"), "MF4", {n: Channel(n, T, T, "rad/s") for n in names})


@pytest.mark.parametrize(
    ("names", "channels"),
    [
        (("steer_angle", "wheel_speed_rear"), {"steer_angle", "wheel_speed_rear"}),
        (
            ("M.steer_angle", "M.wheel_speed_front", "M.ref_x", "other"),
            {"steer_angle", "wheel_speed_front", "ref_x"},
        ),
        (
            ("steer_angle", "wheel_speed_front_left", "wheel_speed_front_right"),
            {"steer_angle", "wheel_speed_front_left", "wheel_speed_front_right"},
        ),
        (
            ("steer_angle", "wheel_speed_front", "wheel_speed_front_left", "wheel_speed_front_right"),
            {"steer_angle", "wheel_speed_front"},
        ),
        (("steer_angle", "wheel_speed_front_left", "yaw_rate"), None),
        (("wheel_speed_front", "wheel_speed_rear", "yaw_rate"), None),
        (("steer_angle", "vehicle_speed"), None),
    ],
)
def test_a_log_in_the_names_of_the_library_needs_no_file(names, channels) -> None:
    found = map_own_names(make_recording(*names))
    assert (None if found is None else set(found.signals)) == channels
    if found is not None:
        assert all(c == s.channel for c, s in found.signals.items()) and found.path is None


def test_a_log_without_a_file_is_refused_with_what_it_has() -> None:
    recording = make_recording("steer_angle", "yaw_rate", "wheel_speed_front_left", "gear")
    text = module._describe_unnamed(Path("my log.mf4"), recording)
    assert "assigns its 4 signals" in text and "tselab signals 'my log.mf4'" in text
    has, lacks = text.split("it has ")[1].splitlines()[0].split(", not ")
    assert sorted(has.split(", ")) == ["steer_angle", "wheel_speed_front_left", "yaw_rate"]
    assert lacks == "wheel_speed_front, wheel_speed_rear"
    assert "of tse's names" not in module._describe_unnamed(Path("x"), make_recording("gear", "rpm"))


@pytest.mark.parametrize(("rate", "is_allowed"), [(1.9, False), (2.0, True), (1000.0, True), (1001.0, False)])
def test_a_rate_is_allowed_from_2_to_1000_hz(rate: float, is_allowed: bool, tmp_path: Path) -> None:
    t = np.arange(0.0, 5.0, 0.02)
    table = {n: np.interp(t, T, x) + 0.01 * np.sin(9 * t) for n, x in FULL.items()} | {"time": t}
    path = write(tmp_path, table)
    if is_allowed:
        log = read_log(path, reading=Reading(rate=rate))
        assert log.sample_time == pytest.approx(1.0 / rate) and log.place == "row" and log.line[0] == 1
    else:
        with pytest.raises(UserError, match=r"option --rate: .* is outside its range 2 .. 1000 Hz"):
            read_log(path, reading=Reading(rate=rate))


def test_what_is_unsure_is_a_warning_and_an_error_if_strict(tmp_path: Path) -> None:
    path = write(tmp_path, FULL)
    text = "".join(f'[signals.{n}]\nname = "{n}"\n' for n in FULL if n not in ("time", "yaw_rate"))
    (tmp_path / "signals.toml").write_text(
        text + '[signals.yaw_rate]\nname = "yaw_rate"\nunsure = "its sign"\n'
    )
    log = read_log(path)
    assert log.warnings[0].startswith("guessed, not tested: yaw_rate (its sign): check them in")
    assert log.notes[0] == log.warnings[0]
    with pytest.raises(UserError, match="option --strict: guessed, not tested: yaw_rate"):
        read_log(path, reading=Reading(strict=True))
    (tmp_path / "signals.toml").write_text(text + '[signals.yaw_rate]\nname = "yaw_rate"\n')
    assert read_log(path, reading=Reading(strict=True)).warnings == []
