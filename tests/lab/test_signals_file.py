"""signals.toml and logs that are wrong: each ends in a sentence that names the place and the remedy, or goes on and says what is
missing."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import tse
from conftest import tselab, tselab_here
from tse.impl.errors import UserError
from tse.impl.logs.log import read_log
from tse.impl.logs.signals import read_signals
from tse.impl.rows import Reading

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
FILES: dict[str, tuple[str, str, list[str]]] = {  # what is replaced, by what, what must be said
    "no TOML": ('name = "lrw"', "name = = 3", ["not valid TOML", "line 2"]),
    "empty": (GOOD, "", ["names no channel", "tselab signals"]),
    "table": ("[signals.steer_angle]", "[signal.steer_angle]", ["line 1", "[signal]", "did you mean signals?"]),
    "channel": ("steer_angle]", "steering_angle]", ["line 1", "no such channel", "did you mean steer_angle?"]),
    "key": ("ratio = 15.0", "ration = 15.0", ["line 4", "[signals.steer_angle] ration", "did you mean ratio?"]),
    "no name": ('name = "lrw"\n', "", ["line 1", "name", "must be the name of a signal"]),
    "name of no signal": ('"lrw"', '"lrv"', ["'lrv'", "did you mean lrw?"]),
    "three wheels": ('["vl", "vr"]', '["vl", "vr", "hl"]', ["line 6", "two of them: left and right"]),
    "same wheel": ('["vl", "vr"]', '["vl", "vl"]', ["line 6", "cannot be both wheels"]),
    "two yaw rates": ('"gier"', '["gier", "aq"]', ["line 17", "two names are for wheels"]),
    "unit": ('unit = "deg/s"', 'unit = "degz"', ["line 18", "'degz' is no unit", "rad/s, deg/s"]),
    "unit of another kind": ('unit = "deg/s"', 'unit = "Nm"', ["line 18", "cannot be turned into rad/s", "deg/s"]),
    "sign": ("ratio = 15.0", "ratio = 15.0\nsign = 2", ["line 5", "sign: 2 is not allowed; 1 and -1"]),
    "ratio": ("ratio = 15.0", "ratio = 0.1", ["line 4", "ratio: 0.1 is out of range; allowed: 0.5 .. 100"]),
    "ratio as text": ("ratio = 15.0", 'ratio = "15"', ["line 4", "'15' is no number", "0.5 .. 100"]),
    "ratio of one row": ("ratio = 15.0", "ratio = [[0, 15]]", ["line 4", "two rows or more"]),
    "ratio falls": ("ratio = 15.0", "ratio = [[0, 15], [-10, 14]]", ["line 4", "row 2: angles must increase: -10 follows 0"]),
    "ratio's range": ("ratio = 15.0", "ratio = [[0, 15], [10, 900]]", ["line 4", "row 2", "0.5 .. 100"]),
    "ratio of a wheel": ("[signals.accel_y]", "[signals.accel_y]\nratio = 15", ["ratio", "of steer_angle"]),
    "latency in ms": ('unit = "g"', 'unit = "g"\nlatency = 20', ["line 16", "latency: 20 is out of range; allowed: -1 .. 1 s"]),
    "scale": ('unit = "g"', 'unit = "g"\nscale = 0', ["scale", "0 leaves nothing"]),
    "radius": ("radius = 0.3\n[signals.wheel_speed_rear]", "radius = 33\n[signals.wheel_speed_rear]", ["line 8", "allowed: 0.05 .. "
                                                            "5 m"]),
    "flag": ('unit = "g"', 'unit = "g"\nvalid = 1', ["valid", "the name of a signal"]),
    "flag says all is wrong": ('unit = "g"', 'unit = "g"\nvalid = {name = "q", is = [5]}', ["100 %", "it has the values "
                                                            "1", "is = [0]"]),
    "counter": ('unit = "g"', 'unit = "g"\ncounter = {name = "bz", modulo = 1}', ["counter", "modulo = 16"]),
    "one wheel": ('[signals.wheel_speed_front]\nname = ["vl", "vr"]', '[signals.wheel_speed_front_left]\nname = "vl"',
                  ["wheel_speed_front_right is needed, too"]),
    "rate": ("[signals.steer_angle]", "[log]\nrate = 1e6\n[signals.steer_angle]", ["line 2", "rate", "2 .. 1000 Hz"]),
    "time": ("[signals.steer_angle]", '[log]\ntime = "zait"\n[signals.steer_angle]', ["no column 'zait'", "did you mean zeit?"]),
    "time's unit": ("[signals.steer_angle]", '[log]\ntime_unit = "m"\n[signals.steer_angle]', ["line 2", "'m' is no unit of time"]),
    "database": ("[signals.steer_angle]", "[log]\ndatabases = 3\n[signals.steer_angle]", ["line 2", "databases", "list of files"]),
    "log's key": ("[signals.steer_angle]", "[log]\nseperator = ';'\n[signals.steer_angle]", ["line 2", "did you mean separator?"]),
}  # fmt: skip


def table(rows: int = 1000) -> pd.DataFrame:
    """A drive in odd names and units."""
    t = np.arange(rows) * 0.01
    turn = 0.2 * np.sin(t)
    v = 20 + np.sin(0.5 * t)
    wheels = {n: 3.6 * (v + s * 0.75 * turn) for n, s in (("vl", -1), ("vr", 1), ("hl", -1), ("hr", 1))}
    return pd.DataFrame({"zeit": t, "lrw": np.degrees(15 * 2.7 * turn / v * 1.6),
    **wheels, "aq": v * turn / 9.80665, "gier": np.degrees(turn),
                         "q": 1.0, "bz": np.arange(rows) % 16})  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_a_wrong_file_is_refused_with_line_field_and_what_is_allowed(name, drive, tmp_path):
    old, new, words = FILES[name]
    assert old in GOOD
    table().to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "signals.toml").write_text(GOOD.replace(old, new))
    done = tselab_here("estimate", "log.csv", "--vehicle", drive.vehicle, "--signals", "signals.toml", cwd=tmp_path)
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
    np.testing.assert_allclose(log.data["accel_y"], v * 0.2 * np.sin(log.time), atol=1e-9)
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
    text = GOOD.replace("ratio = 15.0", 'ratio = [[-400, 10.0], [0, 15.0], [400, 20.0]]\nsign_bit = "vz"').replace(
        'unit = "g"', 'unit = "g"\nvalid = "q"\ncounter = "bz"').replace('unit = "deg/s"', 'unit = "deg/s"\noffset = '
                                                            '3.0')  # fmt: skip
    (tmp_path / "signals.toml").write_text(text)
    log = read_log(tmp_path / "log.csv")
    angle = np.where(x.vz > 0, -x.lrw, x.lrw)
    np.testing.assert_allclose(log.data["steer_angle"], np.radians(angle / (15 + angle / 80)), atol=1e-9)
    assert list(np.flatnonzero(log.data["accel_y"].isna())) == [*range(100, 120), 200]
    np.testing.assert_allclose(log.data["yaw_rate"], 0.2 * np.sin(log.time), atol=1e-9)


def test_a_radius_that_nobody_says(tmp_path):
    table().to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "signals.toml").write_text(GOOD.replace("radius = 0.3\n", ""))
    with pytest.raises(UserError, match=r"km/h needs the radius of the wheel: a vehicle file \(--vehicle\), or radius"):
        read_log(tmp_path / "log.csv")


@pytest.mark.parametrize("name", ["--signals", "signals.toml"])
def test_a_file_beside_the_log_is_taken_unless_it_is_of_other_logs(name, drive, tmp_path):
    """One that names nothing of a log in tse's own columns is not meant for it."""
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
    text = [f'[signals.{n}]\nname = "{n}"\n' + (f'unit = "{units[n]}"\n' if n in units else "") for n in names]
    (tmp_path / "log.signals.toml").write_text("".join(text))
    log = read_log(tmp_path / "log.csv")
    np.testing.assert_allclose(log.data["yaw_rate"], drive.table().yaw_rate.astype(float), atol=1e-12)
    assert any("signals by" in n for n in log.notes)


BROKEN: dict[str, tuple[str, bytes, list[str]]] = {  # file name, what is in it, what must be said
    "empty MF4": ("x.mf4", b"", ["is empty"]),
    "MF4 that is none": ("x.mf4", b"hello " * 100, ["does not begin as .mf4 files do", "cut off"]),
    "MF4 cut off": ("x.mf4", b"MDF     4.10    tselab  ".ljust(90, b"\0"), ["damaged or cut off"]),
    "BLF without database": ("x.blf", b"LOGG".ljust(200, b"\0"), ["no database", "--database FILE"]),
    "ASC without frames": ("x.asc", b"date Mon\nbase hex timestamps absolute\n", ["no database", "--database"]),
    "MCAP cut off": ("x.mcap", b"\x89MCAP0\r\n".ljust(60, b"\0"), ["damaged or cut off"]),
    "bag cut off": ("x.bag", b"#ROSBAG V2.0\n".ljust(60, b"\0"), ["damaged or cut off"]),
    "db3 without metadata": ("x.db3", b"SQLite format 3\0".ljust(60, b"\0"), ["metadata.yaml", "give the folder"]),
    "Parquet cut off": ("x.parquet", b"PAR1".ljust(60, b"\0"), ["damaged or cut off"]),
    "MAT cut off": ("x.mat", b"MATLAB 5.0 MAT-file".ljust(128, b" ") + b"\1\2\3", ["damaged or cut off"]),
    "MAT 7.3 cut off": ("x.mat", b"\x89HDF\r\n\x1a\n".ljust(60, b"\0"), ["damaged or cut off"]),
    "Excel": ("x.xlsx", b"PK\3\4".ljust(60, b"\0"), ["save the sheet as CSV"]),
    "zip": ("x.zip", b"PK\3\4".ljust(60, b"\0"), ["unpack it first"]),
    "database for a log": ("x.dbc", b'VERSION ""\n', ["this is the database", "--database"]),
    "a picture": ("x.png", b"\x89PNG\r\n\x1a\n\0\0".ljust(60, b"\0"), ["binary file of no format", "MF4"]),
    "no time": ("x.csv", b"lrw;vl\n1,5;2\n1,4;3\n1,3;3\n1,5;4\n", ["no column is a time", "[log] time", "step = 0.01"]),
    "names missing": ("x.csv", b"1;2;3\n2;3;4\n3;4;5\n", ["first line must name the columns"]),
    "too few names": ("x.csv", b"zeit;lrw\n1;2;3\n2;3;4\n3;4;5\n", ["line 1 has 2 names, the rows have 3 cells"]),
    "a row too long": ("x.csv", b"zeit;lrw\n" + b"0,1;2\n" * 20 + b"0,2;3;4;5\n" + b"0,3;4\n" * 5, ["not a well-formed "
                                                            "CSV", "line 22"]),
    "words": ("x.txt", b"Dear colleague\nplease find the log attached\nbest regards\n", ["no table"]),
    "time of words": ("x.csv", b"zeit;lrw\nheute;1\ngestern;2\nmorgen;3\n", ["zeit", "is no time"]),
    "only header": ("x.csv", b"zeit;lrw;vl\n", ["header but no rows"]),
    "JSON": ("x.json", b"{}", ["save the table as Parquet or CSV"]),
}  # fmt: skip


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
    assert set(found.signals) == {"steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_y", "yaw_rate"}
    again = tselab_here("signals", "log.csv", "--write", "signals.toml", cwd=tmp_path)
    assert again.code == 2 and "is there already" in again.err


# ---- dates


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
    done = tselab("estimate", tmp_path / "dates.csv", "--vehicle", drive.vehicle, "--out", tmp_path / "est.csv")
    assert done.code in (0, 3, 4), done.err


def test_a_time_that_is_none_is_refused_as_before(tmp_path, drive):
    log = tse.simulate("double-lane-change", duration=2).log
    log.assign(time="soon").to_csv(tmp_path / "soon.csv", index=False)
    done = tselab("estimate", tmp_path / "soon.csv", "--vehicle", drive.vehicle)
    assert done.code == 2 and "column time" in done.err and "soon" in done.err
