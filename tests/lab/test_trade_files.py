"""Files of other tools. Each case is a small copy of a file that was read wrong once."""

import csv
import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from conftest import tselab, tselab_here
from log_formats import DEG, RATIO, make_drive
from trade_files import (
    BUS_LOGS,
    CORNERS,
    DBC,
    MIDNIGHT,
    ODD_LINES,
    add_wheels,
    encode_frames,
    pack_times,
    write_bus_log,
    write_candump,
    write_groups,
    write_long,
    write_racechrono,
    write_vbo,
)  # fmt: skip
from tse.car.vehicle import read_vehicle
from tse.channels.counters import find_modulo
from tse.channels.log import read_log
from tse.channels.proposal import format_signals, propose
from tse.channels.vocabulary import find_place
from tse.library.errors import UserError
from tse.log.rows import Reading
from tse.readers.databases import read_database
from tse.readers.readers import read_recording
from tse.readers.recording import Channel, Recording
from tse.readers.table import is_packed, unpack_times


@pytest.fixture(scope="module")
def car(tmp_path_factory):
    """Return a vehicle file."""
    path = tmp_path_factory.mktemp("trade") / "car.toml"
    path.write_text(tselab("vehicle", "--simulated").out, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def trip(car):
    """Return forty seconds of lane changes at 50 Hz."""
    return add_wheels(make_drive(car))


# ---- VBOX


def test_a_vbox_file_is_read_with_its_units_and_time_of_day(trip, tmp_path):
    log = read_recording(write_vbo(tmp_path / "drive.vbo", trip))
    assert log.format == "VBOX" and log.notes == []
    np.testing.assert_allclose(log.channels["YawRate"].time, MIDNIGHT + trip.time, atol=1e-6)
    assert [log.channels[n].unit for n in ("velocity", "YawRate", "SWA", "FLwhlspd", "Lat._Vel.")] == \
        ["km/h", "°/s", "rad", "m/s", "km/h"]  # fmt: skip
    assert log.channels["sats"].value[0] == 10  # bit 64 is the flag of DGPS
    assert (log.channels["lat"].value[0], log.channels["long"].value[0]) == (
        50.0,
        10.0,
    )  # minutes, positive to the west


@pytest.mark.parametrize("wheels", [True, False])
def test_what_a_vbox_counts_to_the_right_is_found_positive_to_the_left(wheels, trip, tmp_path):
    """The wheels show the sign, or else the course of the receiver."""
    found = propose(read_recording(write_vbo(tmp_path / "drive.vbo", trip, wheels)))
    guesses = {g.channel: (g.name, g.unit, g.sign) for g in found.guesses}
    assert guesses["yaw_rate"] == (("YawRate",), "°/s", -1.0)
    assert guesses["accel_y"] == (("Y_Accel",), "g", -1.0)
    assert guesses["ins_vel_y"] == (("Lat._Vel.",), "km/h", -1.0)
    assert guesses["steer_angle"] == (("SWA",), "rad", 1.0)
    assert guesses["wheel_speed_rear"][0] == (("RLwhlspd", "RRwhlspd") if wheels else ("velocity",))
    if wheels:
        assert found.missing == [] and guesses["wheel_speed_front"] == (("FLwhlspd", "FRwhlspd"), "m/s", 1.0)


def test_what_an_ins_gives_besides_is_taken_for_nothing_else(trip, tmp_path):
    found = propose(read_recording(write_vbo(tmp_path / "drive.vbo", trip, more=True)))
    assert found.missing == []
    assert {g.channel: g.name for g in found.guesses} == {
        "steer_angle": ("SWA",),
        "wheel_speed_front": ("FLwhlspd", "FRwhlspd"),
        "wheel_speed_rear": ("RLwhlspd", "RRwhlspd"),
        "accel_x": ("X_Accel",),
        "accel_y": ("Y_Accel",),
        "yaw_rate": ("YawRate",),
        "ins_vel_x": ("Lng._Vel.",),
        "ins_vel_y": ("Lat._Vel.",),
    }


def test_the_rows_of_a_vbox_file_are_those_of_the_drive(trip, car, tmp_path):
    path = write_vbo(tmp_path / "drive.vbo", trip)
    done = tselab_here("signals", path, "--vehicle", car, "--write", tmp_path / "signals.toml")
    assert done.code == 0, done.err
    log = read_log(path, reading=Reading(car=read_vehicle(car)))
    assert len(log) == len(trip)
    np.testing.assert_allclose(log.data["yaw_rate"], trip.yaw_rate, atol=1e-6)
    np.testing.assert_allclose(log.data["accel_y"], trip.accel_y, atol=1e-5)


def test_sections_of_a_vbox_file_may_be_missing_or_shorter(trip, tmp_path):
    """[column names] is missing, [channel units] is short, a row is cut, satellites are
    lost.

    The drive goes on after midnight."""
    path = write_vbo(tmp_path / "drive.vbo", trip, start=86400.0 - 10.0)
    text = path.read_text(encoding="cp1252")
    before, _, after = text.partition("[column names]")
    text = before + after[after.index("[data]"):]  # fmt: skip
    text = text.replace("rad\n°/s\ng\ng\nm/s\nm/s\n", "\n")
    lines = text.replace("074 240000.000", "074 000000.000").splitlines()
    first = lines.index("[data]") + 1
    lines[first + 100] = lines[first + 100].replace("074 ", "002 ", 1)
    lines = [x.replace("074 24", "074 00") for x in lines]
    path.write_text("\n".join(lines)[:-7], encoding="cp1252")
    log = read_recording(path)
    speed = log.channels["velocity"]
    assert np.isnan(speed.value[100]) and np.isfinite(speed.value[99])
    np.testing.assert_allclose(np.diff(speed.time), 0.02, atol=1e-6)
    assert log.channels["FLwhlspd"].unit == "" and log.channels["RLwhlspd"].unit == "m/s"
    assert any("fewer than 4 satellites in 1 rows" in n for n in log.notes) and any(
        "has no line break" in n for n in log.notes
    )


@pytest.mark.parametrize(
    ("cut", "says"), [("[data]", "has no section [data]"), ("sats time", "has no column time")]
)
def test_a_vbox_file_without_data_or_time_is_refused_with_a_sentence(cut, says, trip, tmp_path):
    path = write_vbo(tmp_path / "drive.vbo", trip)
    path.write_bytes(path.read_bytes().replace(cut.encode(), b"sats clock" if cut != "[data]" else b"data"))
    with pytest.raises(UserError) as error:
        read_recording(path)
    assert says in str(error.value)


# ---- Time of day as a number


def test_seconds_are_no_time_of_day_and_minutes_of_sixty_seconds_are():
    seconds = 105940.0 + 0.02 * np.arange(5000)
    assert (
        not is_packed(seconds)
        and not is_packed(0.02 * np.arange(20))
        and not is_packed(0.01 * np.arange(5000))
    )
    day = MIDNIGHT + 0.02 * np.arange(5000)
    time = np.floor(day / 3600) * 1e4 + np.floor(day / 60) % 60 * 100 + day % 60
    assert is_packed(time)
    np.testing.assert_allclose(unpack_times(time), day, atol=1e-9)


@pytest.mark.parametrize("kind", ["packed time", "decimal comma in quotes"])
def test_a_table_with_the_names_of_tse_is_read_in_either_writing(kind, car, tmp_path):
    clean = make_drive(car, seconds=40.0).iloc[::2].reset_index(drop=True)
    table = clean.copy()
    table["time"] = pack_times(MIDNIGHT + clean.time)
    if kind == "packed time":
        table.to_csv(tmp_path / "log.csv", index=False)
    else:
        clean.to_csv(
            tmp_path / "log.csv", index=False, decimal=",", quoting=csv.QUOTE_ALL, float_format="%.9g"
        )
    log = read_log(tmp_path / "log.csv", reading=Reading(car=read_vehicle(car)))
    assert len(log) == len(clean) and log.time[-1] - log.time[0] == pytest.approx(clean.time.iloc[-1])
    np.testing.assert_allclose(log.data["yaw_rate"], clean.yaw_rate, rtol=1e-6)
    assert not any("gap" in n or "jumps" in n for n in log.notes)
    assert any("HHMMSS" in n for n in log.notes) == (kind == "packed time")


# ---- Databases


@pytest.mark.parametrize("odd", ODD_LINES)
def test_a_database_is_read_without_its_odd_line_which_is_named(odd, trip, tmp_path):
    path = write_candump(tmp_path / "drive.log", encode_frames(trip[:200]), DBC + ODD_LINES[odd] + "\n")
    log = read_recording(path)
    np.testing.assert_allclose(
        log.channels["ESC_1.YawRate"].value, np.degrees(trip.yaw_rate[:200]), atol=0.006
    )
    assert {"ESC_2.WheelSpeedRR", "SAS_1.SteeringWheelAngle"} <= set(log.channels)
    said = [n for n in log.notes if n.startswith("car.dbc: line 2")]
    assert len(said) == (0 if "point" in odd or "behind" in odd else 1), log.notes


def test_a_database_that_is_named_and_stands_in_signals_toml_is_read_once(trip, car, tmp_path):
    odd = next(k for k in ODD_LINES if "point" not in k and "behind" not in k)
    path = write_candump(tmp_path / "drive.log", encode_frames(trip), DBC + ODD_LINES[odd] + "\n")
    database, made = tmp_path / "car.dbc", tmp_path / "signals.toml"
    assert tselab_here("signals", path, "--database", database, "--vehicle", car, "--write", made).code == 0
    assert "databases" in made.read_text()
    notes = read_log(path, reading=Reading(car=read_vehicle(car), databases=(database,))).notes
    assert len([n for n in notes if n.startswith("car.dbc: line 2")]) == 1, notes


def test_of_a_database_that_is_none_the_name_is_said(trip, tmp_path):
    path = write_candump(tmp_path / "drive.log", encode_frames(trip[:20]), "this is no database")
    with pytest.raises(UserError, match=r"car\.dbc: cannot be read as a database of a bus"):
        read_recording(path)


def test_what_cantools_does_not_read_canmatrix_may(trip, monkeypatch, tmp_path):
    cantools = pytest.importorskip("cantools", reason="cantools is not installed: scripts/setup.sh logs")
    pytest.importorskip("canmatrix", reason="canmatrix is not installed: it comes with asammdf")
    path = write_candump(tmp_path / "drive.log", encode_frames(trip[:100]))
    made = cantools.database.load_string(DBC, "dbc").as_kcd_string()
    (tmp_path / "car.kcd").write_text(made)
    (tmp_path / "car.dbc").unlink()

    def refuse(*_: object, **__: object) -> None:
        raise ValueError("a line that it does not know")

    monkeypatch.setattr("cantools.database.load_file", refuse)
    log = read_recording(path)
    np.testing.assert_allclose(
        log.channels["ESC_1.YawRate"].value, np.degrees(trip.yaw_rate[:100]), atol=0.006
    )
    assert any("car.kcd: read by canmatrix" in n for n in log.notes)


OPENDBC = Path(os.environ.get("TSE_OPENDBC", Path(__file__).parents[3] / "shared" / "opendbc"))


def test_all_public_databases_are_read():
    files = [p for p in sorted(OPENDBC.glob("**/*.dbc")) if b"\nBO_ " in p.read_bytes()]
    if not files:
        pytest.skip("opendbc is not beside this checkout (TSE_OPENDBC names its folder)")
    for path in files:
        assert read_database(path, []), path


@pytest.mark.parametrize("offset", ["0", "-50"])
def test_what_a_database_says_of_values_is_used(offset, trip, tmp_path):
    """A code for "not available" is missing in a measurement; a state keeps its codes.

    Codes are raw values, before factor and offset of the signal.
    """
    sent = encode_frames(trip[:300])
    lost = [100, 101, 250]
    for i in lost:
        t, identifier, data = sent[3 * i]
        sent[3 * i] = t, identifier, b"\xff\x7f" + data[2:]
    text = DBC.replace("SG_ YawRate : 0|16@1- (0.01,0)", f"SG_ YawRate : 0|16@1- (0.01,{offset})")
    text += 'VAL_ 100 YawRate 32767 "SNA" ;\nVAL_ 100 ESC_1_Qualifier 0 "valid" 3 "not_available" ;\n'
    log = read_recording(write_candump(tmp_path / "drive.log", sent, text))
    yaw = log.channels["ESC_1.YawRate"]
    assert list(np.flatnonzero(np.isnan(yaw.value))) == lost
    assert "ESC_1.YawRate: 3 values that the database calls SNA are treated as missing" in log.notes
    assert log.channels["ESC_1.ESC_1_Qualifier"].states == {0.0: "valid", 3.0: "not_available"}


def test_a_counter_of_fifteen_values_loses_no_message(trip, car, tmp_path):
    path = write_candump(tmp_path / "drive.log", encode_frames(trip))
    assert tselab_here("signals", path, "--vehicle", car, "--write", tmp_path / "signals.toml").code == 0
    assert "modulo = 15" in (tmp_path / "signals.toml").read_text()
    assert not any("lost" in n for n in read_log(path, reading=Reading(car=read_vehicle(car))).notes)


@pytest.mark.parametrize(
    ("counter", "modulo"),
    [
        (np.arange(400) % 16, 16),
        (np.arange(400) % 15, 15),
        (np.arange(400) % 15 + 1, 15),
        (np.arange(200) % 256, 256),
        (np.arange(400) // 2 % 16, 0),
        (np.delete(np.arange(400) % 16, [17, 80, 81, 200]), 16),
        (np.zeros(50), 0),
    ],
)
def test_how_far_a_counter_counts_is_read_from_it(counter, modulo):
    assert find_modulo(counter.astype(float)) == modulo


def test_the_qualifier_of_a_message_is_that_of_all_its_signals(trip, tmp_path):
    """The qualifier has two bits; at 3, the sensor is not ready, its values are wrong."""
    qualifier = np.where((np.arange(len(trip)) > 500) & (np.arange(len(trip)) < 560), 3, 0)
    found = propose(read_recording(write_candump(tmp_path / "drive.log", encode_frames(trip, qualifier))))
    for channel in ("yaw_rate", "accel_x", "accel_y"):
        assert found[channel].valid == ("ESC_1.ESC_1_Qualifier", 0.0), channel
    assert found["steer_angle"].valid is None


# ---- Units and names


def make_recording(trip, **columns):
    """Return the recording of a CSV, with some columns replaced."""
    return Recording(Path("log.csv"), "CSV", {n: Channel(n, trip.time.to_numpy(), np.asarray(x, float), u)
                                              for n, (x, u) in columns.items()})  # fmt: skip


def make_motion(trip):
    return {
        "steer": (trip.steer_angle * DEG * RATIO, "deg"),
        "ay": (trip.accel_y, "m/s2"),
        "ax": (trip.accel_x, "m/s2"),
        "omega": (trip.yaw_rate, "rad/s"),
    }


@pytest.mark.parametrize(
    ("unit", "warned"), [("km^h", True), ("kmph", False), ("Kmh", False), ("kmH?", True)]
)
def test_an_unknown_unit_is_questioned_and_no_reason_to_drop(unit, warned, trip):
    found = propose(
        make_recording(trip, **make_motion(trip), **{f"wheel_{c}": (3.6 * trip[c], unit) for c in CORNERS})
    )
    assert found.missing == [] and found["yaw_rate"].name == ("omega",)
    assert found["wheel_speed_front"].name == ("wheel_fl", "wheel_fr")
    assert (found["wheel_speed_front"].unit == "km/h") == warned
    assert any("is unknown: km/h is proposed" in w for w in found.warnings) == warned
    assert not any("but its values fit" in w for w in found.warnings)


@pytest.mark.parametrize(
    "form",
    [
        "{}whlspd",
        "{}speed",
        "{}_wheel",
        "WhlSpd{}",
        "wheelspeed{}",
        "v_{}",
        "{}WheelSpeed",
        "Wheel_{}_Speed",
        "WHEEL_SPEED_{}",
        "ABS_{}_Spd",
        "whl{}spd",
        "Speed.{}",
        "W_SPD_{}_KMH",
    ],
)
@pytest.mark.parametrize(
    "corners", ["FL FR RL RR", "VL VR HL HR", "LF RF LR RR", "FrontLeft FrontRight RearLeft RearRight"]
)
def test_the_corner_may_stand_anywhere_in_the_name_of_a_wheel(form, corners):
    names = [form.format(c) for c in corners.split()]
    assert [find_place(n)[0] for n in names] == ["front_left", "front_right", "rear_left", "rear_right"], (
        names
    )
    lower = [n.lower() for n in names]
    assert [find_place(n)[0] for n in lower] == ["front_left", "front_right", "rear_left", "rear_right"], (
        lower
    )


def test_a_gear_is_no_angle_and_a_speed_of_the_receiver_no_acceleration(trip):
    time = trip.time.to_numpy()
    gear = 3 + np.round(2 * np.sin(0.3 * time))
    speed = trip[list(CORNERS)].mean(axis=1)
    found = propose(
        make_recording(
            trip,
            **{
                "Gear Position (Gear)": (gear, ""),
                "RPM": (1000 + 40 * speed * gear, "RPM"),
                "Vehicle Speed": (3.6 * speed, "kph"),
                "GPS Speed": (speed * trip.yaw_rate, ""),
                "Pitch Angle": (5 * trip.steer_angle, "deg"),
            },
        )
    )
    assert {g.channel for g in found.guesses} == {"wheel_speed_rear"}
    assert set(found.nearest) == set(found.missing)
    assert all(found.nearest.values())


def test_for_what_is_not_found_the_nearest_are_named_with_the_reason(trip):
    columns = make_motion(trip) | {f"wheel_{c}": (3.6 * trip[c], "km/h") for c in CORNERS}
    rng = np.random.default_rng(5)
    noise = rng.normal(size=len(trip))
    columns |= {"ay": (np.full(len(trip), 0.3), "m/s2"), "omega z": (noise, "V"), "steer": (noise, "bar")}
    del columns["omega"]
    found = propose(make_recording(trip, **columns))
    said = {c: " / ".join(x) for c, x in found.nearest.items()}
    assert "ay: is 0.3 all the time" in said["accel_y"]
    assert "omega z: its unit V is not that of a rate" in said["yaw_rate"]
    assert "steer: its unit bar is not that of an angle" in said["steer_angle"]


# ---- Clocks of groups


@pytest.mark.parametrize(("ahead", "says"), [
    (5.0, "is 5.00 s off"), pytest.param(-12.4, "is 12.40 s off", marks=pytest.mark.slow),
    pytest.param(1.7e9, "does not overlap", marks=pytest.mark.slow), (0.0, ""),
    pytest.param(0.04, "", marks=pytest.mark.slow),
])  # fmt: skip
def test_the_clock_of_a_group_that_is_off_is_found_and_taken_off(ahead, says, trip, car, tmp_path):
    pytest.importorskip("asammdf", reason="asammdf is not installed: scripts/setup.sh logs")
    path = write_groups(tmp_path / "drive.mf4", trip, ahead)
    found = propose(read_recording(path), read_vehicle(car))
    said = [w for w in found.warnings if "clock of group" in w]
    assert len(said) == bool(says) and all(says in w for w in said), found.warnings
    assert found.missing == [] and found["yaw_rate"].sign == 1 and found["accel_x"].sign == 1
    assert found["wheel_speed_front"].clock == pytest.approx(ahead if says else 0.0, abs=0.03)
    (tmp_path / "signals.toml").write_text(format_signals(read_recording(path), found))
    log = read_log(path, reading=Reading(car=read_vehicle(car)))
    speed = 0.5 * (trip.rl + trip.rr).to_numpy() / read_vehicle(car).values["wheel_radius_rear"]
    wanted = np.interp(log.time, trip.time + (ahead if not says else 0.0), speed)
    good = np.isfinite(log.data["wheel_speed_rear"].to_numpy())
    assert good.sum() > 1300
    assert np.std((log.data["wheel_speed_rear"].to_numpy() - wanted)[good]) < 0.2


def test_a_time_in_ms_is_taken_as_such_and_said(trip, tmp_path):
    pytest.importorskip("asammdf", reason="asammdf is not installed: scripts/setup.sh logs")
    log = read_recording(write_groups(tmp_path / "drive.mf4", trip, per_second=1000.0))
    np.testing.assert_allclose(np.diff(log.channels["YawRate"].time), 0.02, atol=1e-6)
    assert any("time seems to be in ms" in n for n in log.notes)


# ---- Tables


def test_of_three_rows_above_the_numbers_the_first_has_the_names(trip, tmp_path):
    log = read_recording(write_racechrono(tmp_path / "session.csv", trip))
    c = log.channels["yaw_rate"]
    assert c.unit == "deg/s" and log.channels["lateral_acc"].unit == "G"
    np.testing.assert_allclose(c.time, trip.time, atol=1e-6)
    assert propose(log).missing == []


@pytest.mark.parametrize("cars", [("CAR-1",), ("CAR-1", "CAR-2")])
def test_a_long_table_becomes_a_signal_per_name(cars, trip, tmp_path):
    log = read_recording(write_long(tmp_path / "telemetry.csv", trip[:400], cars))
    name = "CAR-2.yaw_rate" if len(cars) > 1 else "yaw_rate"
    np.testing.assert_allclose(log.channels[name].value, np.degrees(trip.yaw_rate[:400]), rtol=1e-6)
    np.testing.assert_allclose(np.diff(log.channels[name].time), 0.02, atol=1.1e-3)
    assert any("one value per row" in n for n in log.notes)
    assert len(log.channels) == 8 * len(cars)


# ---- Bus logs


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize("layout", BUS_LOGS)
def test_a_bus_log_of_this_layout_is_read(layout, zipped, trip, tmp_path):
    pytest.importorskip("can", reason="python-can is not installed: scripts/setup.sh logs")
    path = write_bus_log(layout, tmp_path, encode_frames(trip[:500]))
    if zipped:
        packed_path = path.with_name(path.name + ".gz")
        packed_path.write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()
        path = packed_path
    log = read_recording(path)
    yaw, wheel, angle = (
        log.channels[n] for n in ("ESC_1.YawRate", "ESC_2.WheelSpeedRR", "SAS_1.SteeringWheelAngle")
    )
    np.testing.assert_allclose(yaw.value, np.degrees(trip.yaw_rate[:500]), atol=0.006)
    np.testing.assert_allclose(wheel.value, 3.6 * trip.rr[:500], atol=0.006)
    np.testing.assert_allclose(angle.value, DEG * RATIO * trip.steer_angle[:500], atol=0.06)
    np.testing.assert_allclose(yaw.time - yaw.time[0], trip.time[:500], atol=2e-4)
    assert not any("lost" in n or "back" in n or "odd" in n or "damaged" in n for n in log.notes), log.notes


def test_frames_without_a_time_are_refused_with_what_helps(trip, tmp_path):
    path = write_bus_log("candump -tz", tmp_path, encode_frames(trip[:50]))
    path.write_text("".join(line.split(") ")[1] + "\n" for line in path.read_text().splitlines()))
    with pytest.raises(UserError, match=r"no times: record with candump -l"):
        read_recording(path)


@pytest.mark.parametrize(
    "layout", ["ASC", "candump -l", "candump -ta", "TRC 1.1", "BUSMASTER", "CANedge CSV"]
)
def test_a_line_that_is_no_frame_is_left_out_and_named(layout, trip, tmp_path):
    path = write_bus_log(layout, tmp_path, encode_frames(trip[:50]))
    lines = path.read_text(encoding="latin-1").splitlines()
    lines[100] = lines[100][: len(lines[100]) - 9] + "ZZ"
    path.write_text("\n".join(lines) + "\n", encoding="latin-1")
    log = read_recording(path)
    assert (
        sum(
            len(c)
            for n, c in log.channels.items()
            if n.endswith(("YawRate", "WheelSpeedFL", "SteeringWheelAngle"))
        )
        == 149
    )
    assert any("1 lines cannot be parsed as frames" in n and "line 101" in n for n in log.notes), log.notes
