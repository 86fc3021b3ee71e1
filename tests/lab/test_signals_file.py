"""Wrong signals.toml and wrong logs: an error names place and remedy, a warning the
fault."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import tse
from conftest import RAN, tselab, tselab_here
from tests.cars.cache import make_logs_once
from tests.cars.real import DATA
from tse.car.vehicle import make_default_vehicle, read_vehicle
from tse.channels import look, physics
from tse.channels.agree import check_car, check_units, find_false_stops, select_certain
from tse.channels.log import read_log
from tse.channels.proposal import propose
from tse.channels.signals import read_signals
from tse.estimation.verdict import describe_implausible, list_contradictions
from tse.library.core import Config
from tse.library.errors import UserError
from tse.log.rows import Reading
from tse.readers.recording import Channel, Recording

GOOD = """[signals.steer_angle]
name = "lrw"
unit = "deg"
ratio = 15.0
[signals.wheel_speed_front]
name = ["vl", "vr"]
unit = "km/h"
radius = 0.3
[signals.wheel_speed_rear]
name = ["hl", "hr"]
unit = "km/h"
radius = 0.3
[signals.accel_y]
name = "aq"
unit = "g"
[signals.yaw_rate]
name = "gier"
unit = "deg/s"
"""
FILES: dict[str, tuple[str, str, list[str]]] = {  # old text, new text, words of the message
    "no TOML": ('name = "lrw"', "name = = 3", ["not valid TOML", "line 2"]),
    "empty": (GOOD, "", ["assigns no channel", "tselab signals"]),
    "table": (
        "[signals.steer_angle]",
        "[signal.steer_angle]",
        ["line 1", "[signal]", "did you mean signals?"],
    ),
    "channel": (
        "steer_angle]",
        "steering_angle]",
        ["line 1", "no such channel", "did you mean steer_angle?"],
    ),
    "key": (
        "ratio = 15.0",
        "ration = 15.0",
        ["line 4", "[signals.steer_angle] ration", "did you mean ratio?"],
    ),
    "no name": ('name = "lrw"\n', "", ["line 1", "name", "must be the name of a signal"]),
    "name of no signal": ('"lrw"', '"lrv"', ["'lrv'", "did you mean lrw?"]),
    "three wheels": ('["vl", "vr"]', '["vl", "vr", "hl"]', ["line 6", "two names: left and right"]),
    "same wheel": ('["vl", "vr"]', '["vl", "vl"]', ["line 6", "cannot be both left and right wheel"]),
    "two yaw rates": ('"gier"', '["gier", "aq"]', ["line 17", "two names are allowed for wheels"]),
    "unit": ('unit = "deg/s"', 'unit = "degz"', ["line 18", "'degz' is not a known unit", "rad/s, deg/s"]),
    "unit of another kind": (
        'unit = "deg/s"',
        'unit = "Nm"',
        ["line 18", "cannot be converted to rad/s", "deg/s"],
    ),
    "sign": (
        "ratio = 15.0",
        "ratio = 15.0\nsign = 2",
        ["line 5", "sign: 2 is not allowed; allowed: 1 and -1"],
    ),
    "ratio": ("ratio = 15.0", "ratio = 0.1", ["line 4", "ratio: 0.1 is out of range; allowed: 0.5 .. 100"]),
    "ratio as text": ("ratio = 15.0", 'ratio = "15"', ["line 4", "'15' is not a number", "0.5 .. 100"]),
    "ratio of one row": ("ratio = 15.0", "ratio = [[0, 15]]", ["line 4", "at least two rows"]),
    "ratio falls": (
        "ratio = 15.0",
        "ratio = [[0, 15], [-10, 14]]",
        ["line 4", "row 2: angles must increase: -10 follows 0"],
    ),
    "ratio's range": ("ratio = 15.0", "ratio = [[0, 15], [10, 900]]", ["line 4", "row 2", "0.5 .. 100"]),
    "ratio of a wheel": ("[signals.accel_y]", "[signals.accel_y]\nratio = 15", ["ratio", "for steer_angle"]),
    "latency in ms": (
        'unit = "g"',
        'unit = "g"\nlatency = 20',
        ["line 16", "latency: 20 is out of range; allowed: -1 .. 1 s"],
    ),
    "scale": ('unit = "g"', 'unit = "g"\nscale = 0', ["scale", "0 makes the signal 0"]),
    "radius": (
        "radius = 0.3\n[signals.wheel_speed_rear]",
        "radius = 33\n[signals.wheel_speed_rear]",
        ["line 8", "allowed: 0.05 .. 5 m"],
    ),
    "flag": ('unit = "g"', 'unit = "g"\nvalid = 1', ["valid", "the name of a signal"]),
    "flag says all is wrong": (
        'unit = "g"',
        'unit = "g"\nvalid = {name = "q", is = [5]}',
        ["100 %", "it has the values 1", "is = [0]"],
    ),
    "counter": ('unit = "g"', 'unit = "g"\ncounter = {name = "bz", modulo = 1}', ["counter", "modulo = 16"]),
    "one wheel": (
        '[signals.wheel_speed_front]\nname = ["vl", "vr"]',
        '[signals.wheel_speed_front_left]\nname = "vl"',
        ["wheel_speed_front_right is needed, too"],
    ),
    "rate": (
        "[signals.steer_angle]",
        "[log]\nrate = 1e6\n[signals.steer_angle]",
        ["line 2", "rate", "2 .. 1000 Hz"],
    ),
    "time": (
        "[signals.steer_angle]",
        '[log]\ntime = "zait"\n[signals.steer_angle]',
        ["no column 'zait'", "did you mean zeit?"],
    ),
    "time's unit": (
        "[signals.steer_angle]",
        '[log]\ntime_unit = "m"\n[signals.steer_angle]',
        ["line 2", "'m' is not a unit of time"],
    ),
    "database": (
        "[signals.steer_angle]",
        "[log]\ndatabases = 3\n[signals.steer_angle]",
        ["line 2", "databases", "list of files"],
    ),
    "log's key": (
        "[signals.steer_angle]",
        "[log]\nseperator = ';'\n[signals.steer_angle]",
        ["line 2", "did you mean separator?"],
    ),
}


def table(rows: int = 1000) -> pd.DataFrame:
    """Return a drive in odd names and units."""
    t = np.arange(rows) * 0.01
    turn = 0.2 * np.sin(t)
    v = 20 + np.sin(0.5 * t)
    wheels = {n: 3.6 * (v + s * 0.75 * turn) for n, s in (("vl", -1), ("vr", 1), ("hl", -1), ("hr", 1))}
    return pd.DataFrame(
        {
            "zeit": t,
            "lrw": np.degrees(15 * 2.7 * turn / v * 1.6),
            **wheels,
            "aq": (v * turn + 0.3 * np.cos(3 * t)) / 9.80665,
            "gier": np.degrees(turn),
            "q": 1.0,
            "bz": np.arange(rows) % 16,
        }
    )


@pytest.mark.parametrize("name", FILES)
def test_a_wrong_file_is_refused_with_line_field_and_what_is_allowed(name, drive, tmp_path):
    old, new, words = FILES[name]
    assert old in GOOD
    table().to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "signals.toml").write_text(GOOD.replace(old, new))
    done = tselab_here(
        "estimate",
        "--verbose",
        "log.csv",
        "--vehicle",
        drive.vehicle,
        "--signals",
        "signals.toml",
        cwd=tmp_path,
    )
    assert done.code == 2 and "Traceback" not in done.err, done.err
    assert len(done.err.splitlines()) <= 3
    for word in ("signals.toml" if "zait" not in new else "log.csv", *words):
        assert word in done.err, done.err
    assert not (tmp_path / "log.est.csv").exists()


def test_the_file_that_these_were_made_from_is_right(tmp_path):
    table().to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "signals.toml").write_text(GOOD)
    log = read_log(tmp_path / "log.csv")
    v = 20 + np.sin(0.5 * log.time)
    np.testing.assert_allclose(log.data["wheel_speed_rear"], v / 0.3, rtol=1e-9)
    np.testing.assert_allclose(
        log.data["accel_y"], v * 0.2 * np.sin(log.time) + 0.3 * np.cos(3 * log.time), atol=1e-9
    )
    np.testing.assert_allclose(log.data["steer_angle"], 2.7 * 1.6 * 0.2 * np.sin(log.time) / v, atol=1e-9)
    assert log.data["accel_x"].isna().all() and any("accel_x is not in the log" in n for n in log.notes)
    assert log.turn["wheel_speed_rear"] == pytest.approx(1.5 / 0.3, rel=1e-6)


def test_ratio_table_sign_bit_flag_counter_and_offset(tmp_path):
    x = table()
    x["vz"] = (x.lrw < 0) * 1.0
    x["lrw"] = x.lrw.abs()
    x.loc[100:119, "q"] = 0
    x.loc[200, "bz"] = x.bz[199]
    x["gier"] += 3.0
    x.to_csv(tmp_path / "log.csv", index=False)
    changes = (
        ("ratio = 15.0", 'ratio = [[-400, 10.0], [0, 15.0], [400, 20.0]]\nsign_bit = "vz"'),
        ('unit = "g"', 'unit = "g"\nvalid = "q"\ncounter = "bz"'),
        ('unit = "deg/s"', 'unit = "deg/s"\noffset = 3.0'),
    )
    text = GOOD
    for old, new in changes:
        text = text.replace(old, new)
    (tmp_path / "signals.toml").write_text(text)
    log = read_log(tmp_path / "log.csv")
    angle = np.where(x.vz > 0, -x.lrw, x.lrw)
    np.testing.assert_allclose(log.data["steer_angle"], np.radians(angle / (15 + angle / 80)), atol=1e-9)
    assert list(np.flatnonzero(log.data["accel_y"].isna())) == [*range(100, 120), 200]
    np.testing.assert_allclose(log.data["yaw_rate"], 0.2 * np.sin(log.time), atol=1e-9)


def test_a_radius_that_nobody_says(tmp_path):
    table().to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "signals.toml").write_text(GOOD.replace("radius = 0.3\n", ""))
    with pytest.raises(
        UserError, match=r"to convert km/h to rad/s, the radius of the wheel is needed: give a vehicle file"
    ):
        read_log(tmp_path / "log.csv")


@pytest.mark.parametrize("name", ["--signals", "signals.toml"])
def test_a_file_beside_the_log_is_taken_unless_it_is_of_other_logs(name, drive, tmp_path):
    """A file that names no column of a log with the library's names is ignored."""
    (tmp_path / "log.csv").write_text(drive.log.read_text())
    (tmp_path / "signals.toml").write_text(GOOD)
    if name == "--signals":
        with pytest.raises(UserError, match=r"there is no 'lrw' in log\.csv"):
            read_log(tmp_path / "log.csv", reading=Reading(signals=tmp_path / "signals.toml"))
    else:
        assert len(read_log(tmp_path / "log.csv")) == 2001


def test_a_file_beside_a_log_in_tse_s_names_is_taken_when_it_speaks_of_them(drive, tmp_path):
    table = drive.table().astype(float)
    table["yaw_rate"] = np.degrees(table.yaw_rate)
    table.to_csv(tmp_path / "log.csv", index=False)
    names = ["steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate"]
    units = {"yaw_rate": "deg/s"}
    text = [
        f'[signals.{n}]\nname = "{n}"\n' + (f'unit = "{units[n]}"\n' if n in units else "") for n in names
    ]
    (tmp_path / "log.signals.toml").write_text("".join(text))
    log = read_log(tmp_path / "log.csv")
    np.testing.assert_allclose(log.data["yaw_rate"], drive.table().yaw_rate.astype(float), atol=1e-12)
    assert any("signals are assigned by" in n for n in log.notes)


BROKEN: dict[str, tuple[str, bytes, list[str]]] = {  # file name, contents, words of the message
    "empty MF4": ("x.mf4", b"", ["is empty"]),
    "MF4 in name only": ("x.mf4", b"hello " * 100, ["does not begin like a .mf4 file", "cut off"]),
    "MF4 cut off": ("x.mf4", b"MDF     4.10    tselab  ".ljust(90, b"\0"), ["damaged or cut off"]),
    "BLF without database": ("x.blf", b"LOGG".ljust(200, b"\0"), ["no database", "--database FILE"]),
    "ASC without frames": (
        "x.asc",
        b"date Mon\nbase hex timestamps absolute\n",
        ["no database", "--database"],
    ),
    "MCAP cut off": ("x.mcap", b"\x89MCAP0\r\n".ljust(60, b"\0"), ["damaged or cut off"]),
    "bag cut off": ("x.bag", b"#ROSBAG V2.0\n".ljust(60, b"\0"), ["damaged or cut off"]),
    "db3 without metadata": (
        "x.db3",
        b"SQLite format 3\0".ljust(60, b"\0"),
        ["metadata.yaml", "give the folder"],
    ),
    "Parquet cut off": ("x.parquet", b"PAR1".ljust(60, b"\0"), ["damaged or cut off"]),
    "MAT cut off": ("x.mat", b"MATLAB 5.0 MAT-file".ljust(128, b" ") + b"\1\2\3", ["damaged or cut off"]),
    "MAT 7.3 cut off": ("x.mat", b"\x89HDF\r\n\x1a\n".ljust(60, b"\0"), ["damaged or cut off"]),
    "Excel": ("x.xlsx", b"PK\3\4".ljust(60, b"\0"), ["save the sheet as CSV"]),
    "zip": ("x.zip", b"PK\3\4".ljust(60, b"\0"), ["unpack it first"]),
    "database for a log": ("x.dbc", b'VERSION ""\n', ["this is the database", "--database"]),
    "a picture": (
        "x.png",
        b"\x89PNG\r\n\x1a\n\0\0".ljust(60, b"\0"),
        ["binary file of an unknown format", "MF4"],
    ),
    "no time": (
        "x.csv",
        b"lrw;vl\n1,5;2\n1,4;3\n1,3;3\n1,5;4\n",
        ["no column is a time", "[log] time", "step = 0.01"],
    ),
    "names missing": ("x.csv", b"1;2;3\n2;3;4\n3;4;5\n", ["first line must name the columns"]),
    "too few names": (
        "x.csv",
        b"zeit;lrw\n1;2;3\n2;3;4\n3;4;5\n",
        ["line 1 has 2 names, but the rows have 3 cells"],
    ),
    "a row too long": (
        "x.csv",
        b"zeit;lrw\n" + b"0,1;2\n" * 20 + b"0,2;3;4;5\n" + b"0,3;4\n" * 5,
        ["not a well-formed CSV", "line 22"],
    ),
    "words": ("x.txt", b"Dear colleague\nplease find the log attached\nbest regards\n", ["no table"]),
    "time of words": ("x.csv", b"zeit;lrw\nheute;1\ngestern;2\nmorgen;3\n", ["zeit", "is no time"]),
    "only header": ("x.csv", b"zeit;lrw;vl\n", ["header but no rows"]),
    "JSON": ("x.json", b"{}", ["save the table as Parquet or CSV"]),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_is_refused_with_the_remedy(name, tmp_path):
    file, content, words = BROKEN[name]
    (tmp_path / file).write_bytes(content)
    done = tselab_here("signals", file, cwd=tmp_path)
    if "the Python package" in done.err:
        pytest.skip(done.err.strip())
    assert done.code == 2 and "Traceback" not in done.err, done.err
    assert file in done.err and len(done.err.splitlines()) <= 3
    for word in words:
        assert word in done.err, done.err


def test_there_are_forty_kinds_of_them():
    assert len(FILES) + len(BROKEN) >= 40


def test_a_file_that_is_written_is_read_again_and_none_is_overwritten(tmp_path):
    table(4000).drop(columns=["q", "bz"]).to_csv(tmp_path / "log.csv", index=False)
    done = tselab_here("signals", "log.csv", "--write", "signals.toml", cwd=tmp_path)
    assert done.code == 3 and "not found: accel_x" in done.out
    found = read_signals(tmp_path / "signals.toml")
    assert set(found.signals) == {
        "steer_angle",
        "wheel_speed_front",
        "wheel_speed_rear",
        "accel_y",
        "yaw_rate",
    }
    again = tselab_here("signals", "log.csv", "--write", "signals.toml", cwd=tmp_path)
    assert again.code == 2 and "exists already" in again.err


# ---- dates


def test_a_proposal_with_a_bare_name_stands_beside_the_log_where_it_is_looked_for(tmp_path):
    (tmp_path / "logs").mkdir()
    log = tmp_path / "logs" / "log.csv"
    t = np.arange(0, 20, 0.02)
    speed, lean = 20 + np.sin(0.3 * t), 0.2 * np.sin(t)
    pd.DataFrame(
        {
            "t [s]": t,
            "Lenkwinkel [deg]": 30 * lean,
            "v_VL [km/h]": 3.6 * speed,
            "v_HL [km/h]": 3.6 * speed,
            "Gierrate [deg/s]": np.rad2deg(lean),
            "ay [m/s2]": speed * lean,
            "ax [m/s2]": 0.3 * np.cos(0.3 * t),
        }
    ).to_csv(log, index=False)
    done = tselab_here("signals", "logs/log.csv", "--write", "signals.toml", cwd=tmp_path)
    assert done.code in (0, 3), done.err
    assert (log.parent / "signals.toml").is_file() and not (tmp_path / "signals.toml").exists()
    assert f"Written to {Path('logs') / 'signals.toml'}" in done.out


@pytest.mark.parametrize("form", ["%Y-%m-%dT%H:%M:%S.%f", "%Y-%m-%d %H:%M:%S.%f", "%H:%M:%S.%f"])
def test_times_in_words_are_times(form, tmp_path, drive):
    log = tse.simulate("double-lane-change", duration=10).log
    seconds = log["time"].to_numpy(float)
    time = pd.Timestamp("2024-05-01 12:00:00") + pd.to_timedelta(seconds, unit="s")
    log.assign(time=time.strftime(form)).to_csv(tmp_path / "dates.csv", index=False)
    log.to_csv(tmp_path / "seconds.csv", index=False)
    dates, plain = read_log(tmp_path / "dates.csv"), read_log(tmp_path / "seconds.csv")
    assert np.allclose(dates.time - dates.time[0], plain.time, atol=1e-6)
    for name in plain.data:
        assert np.array_equal(dates.data[name], plain.data[name]), name
    done = tselab(
        "estimate",
        "--verbose",
        tmp_path / "dates.csv",
        "--vehicle",
        drive.vehicle,
        "--out",
        tmp_path / "est.csv",
    )
    assert done.code in (0, 3, 4), done.err


def test_a_time_that_is_none_is_refused_as_before(tmp_path, drive):
    log = tse.simulate("double-lane-change", duration=2).log
    log.assign(time="soon").to_csv(tmp_path / "soon.csv", index=False)
    done = tselab("estimate", "--verbose", tmp_path / "soon.csv", "--vehicle", drive.vehicle)
    assert done.code == 2 and "column time" in done.err and "soon" in done.err


# ---- A wrong unit is the most frequent error: the run warns.


@pytest.fixture(scope="module")
def lively(tmp_path_factory):
    """A log with enough bends, braking and acceleration for a comparison of the
    channels."""
    path = tmp_path_factory.mktemp("units") / "log.csv"
    assert (
        tselab_here("simulate", "--maneuver", "double-lane-change", "--duration", 36, "--out", path).code == 0
    )
    return path


def list_warnings(lively, **scale):
    log = read_log(lively)
    for name, factor in scale.items():
        log.data[name] *= factor
    return " | ".join(check_units(log, 2.75, 0.33, 0.33, 16.0))


@pytest.mark.parametrize(
    ("scale", "hint"),
    [
        ({"yaw_rate": 57.3}, "yaw_rate is in deg/s"),
        ({"steer_angle": 16.0}, "steer_angle is the steering-wheel angle"),
        ({"steer_angle": 57.3}, "steer_angle is in degrees"),
        ({"accel_y": 1 / 9.81}, "accel_y is in g"),
        ({"accel_x": 1 / 9.81}, "accel_x is in g"),
        ({"wheel_speed_front": 0.33, "wheel_speed_rear": 0.33}, "the wheel speeds are in m/s"),
        ({"wheel_speed_front": 9.55, "wheel_speed_rear": 9.55}, "the wheel speeds are in rpm"),
        ({"wheel_speed_front": 2.0, "wheel_speed_rear": 2.0}, "wheel_radius_front and _rear are diameters"),
        ({"steer_angle": -1.0}, "positive to the right"),
        ({"accel_y": -1.0}, "positive to the right"),
        ({"accel_x": -1.0}, "accel_x is positive to the rear"),
        ({"wheel_speed_rear": 2.0}, "front and rear wheels roll at"),
    ],
)
def test_wrong_units_and_signs_are_named(lively, scale, hint):
    assert hint in list_warnings(lively, **scale)
    assert list_warnings(lively) == ""


def test_a_scale_that_no_unit_has_is_said_without_one(lively):
    """The factor 2.9 is no unit. With wheel speeds in rpm the car would hardly move, and
    lose figures."""
    said = list_warnings(lively, yaw_rate=2.9)
    assert "no unit that is often mixed up explains it" in said and "rpm" not in said and "factor" not in said


def test_a_van_that_oversteers_when_it_is_braked_in_bends_is_not_left_out(tmp_path):
    """A neutral van that brakes in every bend needs half of the usual steering; no unit
    fits."""
    time = np.arange(0.0, 60.0, 0.01)
    v = 18.0 + 2.0 * np.sin(0.6 * time)
    r = 0.15 * np.sin(0.3 * time)
    car = make_default_vehicle()
    config = Config.exact(car.values)
    base, radius = config.lf + config.lr, config.wheel_radius_front
    rows = {
        "time": time,
        "steer_angle": 0.6 * base * r / v,
        "yaw_rate": r,
        "accel_x": np.gradient(v, time),
        "accel_y": v * r,
        "wheel_speed_front": v / radius,
        "wheel_speed_rear": v / radius,
    }
    pd.DataFrame(rows).to_csv(tmp_path / "log.csv", index=False)
    log = read_log(tmp_path / "log.csv")
    said = check_car(log, car, config)
    assert len(said) == 1 and "braking in bends" in said[0] and not select_certain(said)
    log.data["steer_angle"] *= 0.4
    assert select_certain(check_car(log, car, config))


@pytest.mark.parametrize("first, last", [(0.0, 1.0), (0.0, 2 / 3), (1 / 3, 1.0), (0.5, 1.0)])
@pytest.mark.parametrize(
    "folder", sorted(DATA.glob("*/vehicle.toml")) or [None], ids=lambda p: p.parent.name if p else "none"
)
def test_no_part_of_a_real_log_is_left_out(folder, first, last, tmp_path):
    """In two thirds of a log accel_y was just below MIN_FIT, and above it with wheels in
    km/h."""
    if folder is None:
        pytest.skip("../shared/data is not here")
    car = read_vehicle(folder)
    rows = pd.read_csv(folder.parent / "data.csv")
    rows.iloc[int(first * len(rows)) : int(last * len(rows))].to_csv(tmp_path / "log.csv", index=False)
    assert select_certain(check_car(read_log(tmp_path / "log.csv"), car, Config.exact(car.values))) == []


def test_steering_at_one_speed_where_one_understeer_would_leave_nothing():
    """At 25 m/s a car with an understeer of -0.0016 s2/m2 would need no steering in
    bends."""
    v = np.full(4000, 25.0)
    r = 0.1 * np.sin(np.arange(4000) / physics.COMPARISON_RATE)
    seen = physics.fit_steering(16.0 * 2.75 * r / v * (1 + 0.002 * v**2), v, r)
    assert seen is not None and seen.per_curvature == pytest.approx(16.0 * 2.75, rel=0.05)


def test_the_warning_reaches_the_terminal(lively, drive, tmp_path):
    table = pd.read_csv(lively)
    table["accel_y"] /= 9.81
    table.to_csv(tmp_path / "log.csv", index=False)
    done = tselab_here("estimate", "--verbose", "log.csv", "--vehicle", drive.vehicle, cwd=tmp_path)
    assert done.code == 4 and "warning: check the units: accel_y is in g" in done.err
    strict = tselab_here(
        "estimate",
        "--verbose",
        "log.csv",
        "--vehicle",
        drive.vehicle,
        "--strict",
        "--out",
        "strict.csv",
        cwd=tmp_path,
    )
    assert strict.code == 2 and "option --strict: check the units: accel_y is in g" in strict.err
    assert not (tmp_path / "strict.csv").exists()


@pytest.fixture(scope="module")
def cars(tmp_path_factory):
    """Cars of another model, on roads with bank, grade and bends: logs and vehicles by
    road."""
    return {road: make_logs_once(road, minutes=1.5, cars=2, seed=5) for road in ("highway", "mountain")}


def list_notes(car, folder, **columns) -> list[str]:
    v = car.vehicle
    log = pd.DataFrame(car.log)
    for axle in ("front", "rear"):  # four wheels
        mean, half = (
            log.pop(f"wheel_speed_{axle}"),
            0.5 * v[f"track_{axle}"] / v[f"wheel_radius_{axle}"] * log.yaw_rate,
        )
        log[f"wheel_speed_{axle}_left"], log[f"wheel_speed_{axle}_right"] = mean - half, mean + half
    for name, change in columns.items():
        for c in [c for c in log if c.startswith(name)]:
            log[c] = change(log[c])
    log.to_csv(folder / "log.csv", index=False)
    tracks = {a: v[f"track_{a}"] for a in ("front", "rear")}
    return check_units(
        read_log(folder / "log.csv"),
        v["lf"] + v["lr"],
        v["wheel_radius_front"],
        v["wheel_radius_rear"],
        v["steering_ratio"],
        tracks,
    )


@pytest.mark.slow
@pytest.mark.parametrize("road", ["highway", "mountain"])
def test_right_logs_of_cars_that_nobody_made_here_get_no_note(road, cars, tmp_path):
    """At 130 km/h an understeering car has a third of the yaw rate of its steering
    angle."""
    for car in cars[road]:
        assert list_notes(car, tmp_path) == []


@pytest.mark.slow
def test_kmh_taken_for_rad_per_s_is_noticed_by_the_track(cars, tmp_path):
    """The factor is only 1.05 .. 1.15. The wheels of an axle and the yaw rate show it."""
    for car in cars["mountain"]:
        radius = car.vehicle["wheel_radius_front"]
        found = list_notes(car, tmp_path, wheel_speed=lambda x, radius=radius: 3.6 * radius * x)
        if abs(np.log(3.6 * radius)) > 0.08:
            assert len(found) == 1 and "the wheel speeds are in km/h" in found[0], found
            assert f"factor {3.6 * radius:.3g}" in found[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("columns", "hint"),
    [
        ({"accel_y": lambda x: x / 9.81}, "accel_y is in g"),
        ({"steer_angle": lambda x: -x}, "steer_angle is positive to the right"),
        ({"accel_x": lambda x: -x}, "accel_x is positive to the rear"),
        ({"wheel_speed": lambda x: 0.447 * x}, "the wheel speeds are in m"),
    ],
)
def test_units_of_such_cars(columns, hint, cars, tmp_path):
    for car in cars["mountain"]:
        found = list_notes(car, tmp_path, **columns)
        assert len(found) == 1 and hint in found[0], found


@pytest.mark.slow
def test_swapped_axes_are_named(cars, tmp_path):
    car = cars["mountain"][0]
    swapped = dict(car.log)
    swapped["accel_x"], swapped["accel_y"] = swapped["accel_y"], swapped["accel_x"]
    car = type(car)(car.car, swapped, car.reference, car.truth)
    assert any("accel_x and accel_y are swapped" in n for n in list_notes(car, tmp_path))


def test_a_log_that_contradicts_itself_tells_nothing_and_teaches_nothing(lively, drive, tmp_path):
    """With an inverted steering angle, the filter fits another car with a small
    variance."""
    table = pd.read_csv(lively)
    table["steer_angle"] *= -1
    table.to_csv(tmp_path / "log.csv", index=False)
    more = ("--table", "t.parquet", "--save-learnt", "l")
    done = tselab_here("estimate", "--verbose", "log.csv", "--vehicle", drive.vehicle, *more, cwd=tmp_path)
    assert done.code == 4 and "steer_angle is positive to the right" in done.err
    told = pd.read_parquet(tmp_path / "t.parquet")
    assert (told.usable == "no").all() and told.value.isna().all() and (told.reason == "contradicted").all()
    assert not (tmp_path / "l").exists() and "so nothing was learnt" in done.err


def test_wheels_that_stand_while_the_car_drives_are_a_note(lively, drive, tmp_path):
    """No warning of numpy either: the smoothed speed is almost 0, so r/v is undefined."""
    table = pd.read_csv(lively)
    rows = (table.time > 10) & (table.time < 30)
    table.loc[rows, ["wheel_speed_front", "wheel_speed_rear"]] = 0.0
    table.to_csv(tmp_path / "log.csv", index=False)
    done = tselab("estimate", "--verbose", "log.csv", "--vehicle", drive.vehicle, cwd=tmp_path)
    assert done.code in RAN and "RuntimeWarning" not in done.err
    assert (
        "note: both wheel speeds are 0 from 10.01 to 29.99 s, while the car drove (19.6 m/s in the row before"
        in done.err
    )


def test_a_car_that_stops_and_starts_gets_no_note_and_two_gaps_get_one(lively):
    log = read_log(lively)
    speed = np.clip(np.abs(20 - 5 * np.abs(log.time - 10)) - 10, 0, None) / 0.33
    log.data["wheel_speed_front"] = log.data["wheel_speed_rear"] = speed
    assert (speed == 0).sum() > 300 and find_false_stops(log, 0.33, 0.33, 1.0) == []
    steady = np.full(len(log), 60.0)
    for seconds, said in ((((3, 6),), 1), (((3, 6), (8, 9)), 1), (((3, 3.3),), 0)):
        x = np.where(np.any([(log.time > a) & (log.time < b) for a, b in seconds], axis=0), 0.0, steady)
        log.data["wheel_speed_front"] = log.data["wheel_speed_rear"] = x
        notes = find_false_stops(log, 0.33, 0.33, 1.0)
        assert len(notes) == said and ("2 times, first from 3.0" in "".join(notes)) == (len(seconds) > 1)


@pytest.mark.parametrize("mistake", ["units", "axles"])
def test_no_row_of_a_log_that_contradicts_itself_is_valid(mistake, drive, tmp_path):
    """Not even at the start: the filter detects exchanged axles after some seconds."""
    simulated = (
        "simulate",
        "--maneuver",
        "double-lane-change",
        "--duration",
        60,
        "--out",
        tmp_path / "log.csv",
    )
    assert tselab_here(*simulated).code == 0
    table = pd.read_csv(tmp_path / "log.csv")
    front, rear = "wheel_speed_front", "wheel_speed_rear"
    if mistake == "units":
        table[[front, rear]] *= 0.33 * 2.23694  # mph
    else:
        table[[front, rear]] = table[[rear, front]].to_numpy()
    table.to_csv(tmp_path / "log.csv", index=False)
    vehicle = tmp_path / "car.toml"
    vehicle.write_text(drive.vehicle.read_text())
    done = tselab_here(
        "estimate", "--verbose", "log.csv", "--vehicle", vehicle, "--out", "est.csv", cwd=tmp_path
    )
    hint = (
        "the wheel speeds are in mph"
        if mistake == "units"
        else "front and rear wheel speeds seem to be exchanged"
    )
    assert done.code == 4 and hint in done.err
    estimated = pd.read_csv(tmp_path / "est.csv")
    names = ("cx_front", "cy_front", "cy_rear", "grip")
    assert not estimated[[f"{n}_valid" for n in names]].to_numpy().any()
    against = np.any([estimated[f"{n}_reason"] == "implausible" for n in names], axis=0)
    assert against.mean() > 0.5 and (estimated.status[against] == 10).all()
    with pytest.warns(UserWarning, match=hint):
        assert not tse.estimate(table, vehicle).valid.any()


def test_a_channel_that_contradicts_for_a_while_leaves_the_rest():
    """Rows at standstill or during start do not count. A fault that is over is not the
    log's."""
    reasons = np.array(["starting"] * 10 + ["implausible"] * 60 + ["valid"] * 30)
    table = pd.DataFrame(dict.fromkeys(("cx_front_reason", "cy_front_reason", "cy_rear_reason"), reasons))
    table = table.assign(fault_channel=4, fault_factor=-1.0)
    assert describe_implausible(table) == ""
    assert describe_implausible(table.iloc[:70]).endswith(
        "accel_x seems to have the other sign (factor -1, about 1 is expected)"
    )
    assert "in 67 % of the rows that drive" in describe_implausible(table.iloc[np.r_[0:10, 70:100, 10:70]])
    assert describe_implausible(table.iloc[np.r_[70:100, 0:10, 10:35]]) == ""


@pytest.mark.parametrize(
    ("before", "factor", "whole"), [(10.0, 0.0, True), (30.0, 0.0, False), (30.0, -1.0, True)]
)
def test_a_channel_that_fails_leaves_what_was_valid_before(before: float, factor: float, whole: bool) -> None:
    """A channel that agreed for 20 s, and has no constant factor, has no wrong unit or
    sign."""
    time = np.arange(0.0, 90.0, 0.1)
    names = ("cx_front_reason", "cy_front_reason", "cy_rear_reason")
    reasons = np.where(time > before, "implausible", "valid")
    table = pd.DataFrame(
        {"time": time} | dict.fromkeys(names, reasons) | {"fault_channel": 6, "fault_factor": factor}
    )
    assert bool(describe_implausible(table)) == whole
    (said,) = list_contradictions(table)
    assert said.startswith(f"the channels contradict each other from {before + 0.1:.1f} to 89.9 s: yaw_rate ")
    assert list_contradictions(table[reasons == "valid"]) == []


def test_a_measurement_that_never_changes_is_missing(lively, tmp_path):
    table = pd.read_csv(lively)
    table["accel_x"] = 0.03
    table.to_csv(tmp_path / "log.csv", index=False)
    log = read_log(tmp_path / "log.csv")
    assert log.data["accel_x"].isna().all() and log.data["accel_y"].notna().all()
    assert any("accel_x is 0.03 in every row, while wheel_speed_rear changes" in n for n in log.notes)


def test_the_time_per_signal_does_not_grow_with_their_number(monkeypatch):
    """Each signal is tested for a flag at most twice, not once for every other signal."""
    time = np.arange(0.0, 30.0, 0.02)
    rng = np.random.default_rng(2)
    walk = {
        f"ECU_{i}_{n}": rng.normal(size=len(time)).cumsum()
        for i in range(60)
        for n in ("Temp", "State", "Press", "Flow")
    }
    recording = Recording(Path("many"), "table", {n: Channel(n, time, x) for n, x in walk.items()})
    looked = []
    valid = look._find_valid_value
    monkeypatch.setattr(look, "_find_valid_value", lambda c: looked.append(c.name) or valid(c))
    propose(recording)
    assert len(looked) <= 2 * len(walk)


def test_steering_by_curvature_is_the_best_of_all_understeers():
    """The result is that of one regression for each understeer."""
    rng = np.random.default_rng(3)
    v = 15.0 + 8.0 * np.sin(np.linspace(0, 9, 4000))
    r = 0.2 * np.sin(np.linspace(0, 80, 4000)) + 0.002 * rng.normal(size=4000)
    angle = 2.7 * r / v * (1 + 0.003 * v**2) + 0.01 + 0.001 * rng.normal(size=4000)
    found = physics.fit_steering(angle, v, r)
    x = r / v * (1 + found.understeer * v**2)
    slope, offset = np.polyfit(x, angle, 1)
    share = np.corrcoef(x, angle)[0, 1] ** 2
    assert found.share == pytest.approx(share, abs=1e-9) and found.offset == pytest.approx(offset, abs=1e-9)
    assert found.per_curvature == pytest.approx(slope / np.sqrt(share), rel=1e-9)
    assert found.understeer == pytest.approx(0.003, abs=3e-4)
