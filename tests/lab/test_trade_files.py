"""Files of the trade: each case is a kind of file that was read wrong once, built small, with the right answer."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from conftest import tselab, tselab_here
from log_formats import drive
from trade_files import DBC, MIDNIGHT, ODD_LINES, frames, packed, si, write_candump, write_vbo
from tse.impl.errors import UserError
from tse.impl.logs.counters import modulo_of
from tse.impl.logs.databases import read_database
from tse.impl.logs.log import read_log
from tse.impl.logs.proposal import propose
from tse.impl.logs.readers import read_recording
from tse.impl.logs.table import is_packed, of_packed
from tse.impl.rows import Reading
from tse.impl.vehicle import read_vehicle


@pytest.fixture(scope="module")
def car(tmp_path_factory):
    """A vehicle file."""
    path = tmp_path_factory.mktemp("trade") / "car.toml"
    path.write_text(tselab("vehicle", "--simulated").out, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def trip(car):
    """Forty seconds of lane changes at 50 Hz."""
    return si(drive(car))


# ---- VBOX


def test_a_vbox_file_is_read_with_its_units_and_time_of_day(trip, tmp_path):
    log = read_recording(write_vbo(tmp_path / "drive.vbo", trip))
    assert log.format == "VBOX" and log.notes == []
    np.testing.assert_allclose(log.channels["YawRate"].time, MIDNIGHT + trip.time, atol=1e-6)
    assert [log.channels[n].unit for n in ("velocity", "YawRate", "SWA", "FLwhlspd", "Lat._Vel.")] == \
        ["km/h", "°/s", "rad", "m/s", "km/h"]  # fmt: skip
    assert log.channels["sats"].value[0] == 10  # 64 more says that DGPS is received
    assert (log.channels["lat"].value[0], log.channels["long"].value[0]) == (50.0, 10.0)  # minutes, positive to the west


@pytest.mark.parametrize("wheels", [True, False])
def test_what_a_vbox_counts_to_the_right_is_found_positive_to_the_left(wheels, trip, tmp_path):
    """By the wheels, and without them by the course of the receiver."""
    found = propose(read_recording(write_vbo(tmp_path / "drive.vbo", trip, wheels)))
    guesses = {g.channel: (g.name, g.unit, g.sign) for g in found.guesses}
    assert guesses["yaw_rate"] == (("YawRate",), "°/s", -1.0)
    assert guesses["accel_y"] == (("Y_Accel",), "g", -1.0)
    assert guesses["ins_vel_y"] == (("Lat._Vel.",), "km/h", -1.0)
    assert guesses["steer_angle"] == (("SWA",), "rad", 1.0)
    assert guesses["wheel_speed_rear"][0] == (("RLwhlspd", "RRwhlspd") if wheels else ("velocity",))
    if wheels:
        assert found.missing == [] and guesses["wheel_speed_front"] == (("FLwhlspd", "FRwhlspd"), "m/s", 1.0)


def test_the_rows_of_a_vbox_file_are_those_of_the_drive(trip, car, tmp_path):
    path = write_vbo(tmp_path / "drive.vbo", trip)
    done = tselab_here("signals", path, "--vehicle", car, "--write", tmp_path / "signals.toml")
    assert done.code == 0, done.err
    log = read_log(path, reading=Reading(car=read_vehicle(car)))
    assert len(log) == len(trip)
    np.testing.assert_allclose(log.data["yaw_rate"], trip.yaw_rate, atol=1e-6)
    np.testing.assert_allclose(log.data["accel_y"], trip.accel_y, atol=1e-5)


def test_sections_of_a_vbox_file_may_be_missing_or_shorter(trip, tmp_path):
    """No [column names], units of the last columns only, a row that is cut off, a time without satellites, midnight."""
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
    assert any("fewer than 4 satellites in 1 rows" in n for n in log.notes) and any("does not end" in n for n in log.notes)


@pytest.mark.parametrize(("cut", "says"), [("[data]", "has no section [data]"), ("sats time", "has no column time")])
def test_a_vbox_file_without_data_or_time_is_refused_with_a_sentence(cut, says, trip, tmp_path):
    path = write_vbo(tmp_path / "drive.vbo", trip)
    path.write_bytes(path.read_bytes().replace(cut.encode(), b"sats clock" if cut != "[data]" else b"data"))
    with pytest.raises(UserError) as error:
        read_recording(path)
    assert says in str(error.value)


# ---- Time of day as a number


def test_seconds_are_no_time_of_day_and_minutes_of_sixty_seconds_are():
    seconds = 105940.0 + 0.02 * np.arange(5000)
    assert not is_packed(seconds) and not is_packed(0.02 * np.arange(20)) and not is_packed(0.01 * np.arange(5000))
    day = MIDNIGHT + 0.02 * np.arange(5000)
    time = np.floor(day / 3600) * 1e4 + np.floor(day / 60) % 60 * 100 + day % 60
    assert is_packed(time)
    np.testing.assert_allclose(of_packed(time), day, atol=1e-9)


@pytest.mark.parametrize("kind", ["packed time", "decimal comma in quotes"])
def test_a_table_with_the_names_of_tse_is_read_in_either_writing(kind, car, tmp_path):
    clean = drive(car, seconds=40.0).iloc[::2].reset_index(drop=True)
    table = clean.copy()
    table["time"] = packed(MIDNIGHT + clean.time)
    if kind == "packed time":
        table.to_csv(tmp_path / "log.csv", index=False)
    else:
        clean.to_csv(tmp_path / "log.csv", index=False, decimal=",", quoting=csv.QUOTE_ALL, float_format="%.9g")
    log = read_log(tmp_path / "log.csv", reading=Reading(car=read_vehicle(car)))
    assert len(log) == len(clean) and log.time[-1] - log.time[0] == pytest.approx(clean.time.iloc[-1])
    np.testing.assert_allclose(log.data["yaw_rate"], clean.yaw_rate, rtol=1e-6)
    assert not any("gap" in n or "jumps" in n for n in log.notes)
    assert any("HHMMSS" in n for n in log.notes) == (kind == "packed time")


# ---- Databases


@pytest.mark.parametrize("odd", ODD_LINES)
def test_a_database_is_read_without_its_odd_line_which_is_named(odd, trip, tmp_path):
    path = write_candump(tmp_path / "drive.log", frames(trip[:200]), DBC + ODD_LINES[odd] + "\n")
    log = read_recording(path)
    np.testing.assert_allclose(log.channels["ESC_1.YawRate"].value, np.degrees(trip.yaw_rate[:200]), atol=0.006)
    assert {"ESC_2.WheelSpeedRR", "SAS_1.SteeringWheelAngle"} <= set(log.channels)
    said = [n for n in log.notes if n.startswith("car.dbc: line 2")]
    assert len(said) == (0 if "point" in odd or "behind" in odd else 1), log.notes


def test_of_a_database_that_is_none_the_name_is_said(trip, tmp_path):
    path = write_candump(tmp_path / "drive.log", frames(trip[:20]), "this is no database")
    with pytest.raises(UserError, match=r"car\.dbc: is no database of a bus"):
        read_recording(path)


OPENDBC = Path(os.environ.get("TSE_OPENDBC", Path(__file__).parents[3] / "shared" / "opendbc"))


def test_all_public_databases_are_read():
    files = [p for p in sorted(OPENDBC.glob("**/*.dbc")) if b"\nBO_ " in p.read_bytes()]
    if not files:
        pytest.skip("opendbc is not beside this checkout (TSE_OPENDBC names its folder)")
    for path in files:
        assert read_database(path, []), path


def test_what_a_database_says_of_values_is_used(trip, tmp_path):
    """A code for no value in a measurement is missing; the codes of a state stay."""
    sent = frames(trip[:300])
    lost = [100, 101, 250]
    for i in lost:
        t, identifier, data = sent[3 * i]
        sent[3 * i] = t, identifier, b"\xff\x7f" + data[2:]
    text = DBC + 'VAL_ 100 YawRate 32767 "SNA" ;\nVAL_ 100 ESC_1_Qualifier 0 "valid" 3 "not_available" ;\n'
    log = read_recording(write_candump(tmp_path / "drive.log", sent, text))
    yaw = log.channels["ESC_1.YawRate"]
    assert list(np.flatnonzero(np.isnan(yaw.value))) == lost
    assert "ESC_1.YawRate: 3 values that the database calls SNA are treated as missing" in log.notes
    assert log.channels["ESC_1.ESC_1_Qualifier"].states == {0.0: "valid", 3.0: "not_available"}


def test_a_counter_of_fifteen_values_loses_no_message(trip, car, tmp_path):
    path = write_candump(tmp_path / "drive.log", frames(trip))
    assert tselab_here("signals", path, "--vehicle", car, "--write", tmp_path / "signals.toml").code == 0
    assert "modulo = 15" in (tmp_path / "signals.toml").read_text()
    assert not any("lost" in n for n in read_log(path, reading=Reading(car=read_vehicle(car))).notes)


@pytest.mark.parametrize(("counter", "modulo"), [
    (np.arange(400) % 16, 16), (np.arange(400) % 15, 15), (np.arange(400) % 15 + 1, 15), (np.arange(200) % 256, 256),
    (np.arange(400) // 2 % 16, 0), (np.delete(np.arange(400) % 16, [17, 80, 81, 200]), 16), (np.zeros(50), 0),
])  # fmt: skip
def test_how_far_a_counter_counts_is_read_from_it(counter, modulo):
    assert modulo_of(counter.astype(float)) == modulo


def test_the_qualifier_of_a_message_is_that_of_all_its_signals(trip, tmp_path):
    """Two bits, 3 where the sensor is not ready: the values are wrong then."""
    qualifier = np.where((np.arange(len(trip)) > 500) & (np.arange(len(trip)) < 560), 3, 0)
    found = propose(read_recording(write_candump(tmp_path / "drive.log", frames(trip, qualifier))))
    for channel in ("yaw_rate", "accel_x", "accel_y"):
        assert found[channel].valid == ("ESC_1.ESC_1_Qualifier", 0.0), channel
    assert found["steer_angle"].valid is None
