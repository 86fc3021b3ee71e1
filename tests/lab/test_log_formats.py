"""One drive in every format gives the estimates of the clean CSV, by one command each."""

import importlib
import json
import sqlite3
import struct
import zlib
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from conftest import RAN, tselab, tselab_here
from log_formats import (
    DEG,
    FORMATS,
    LATENCY,
    RATIO,
    make_drive,
    split_messages,
    write_bus,
    write_mf4_bus,
    write_or_skip,
)
from log_formats import RADIUS as RADII
from tse.car.vehicle import read_vehicle
from tse.channels import physics
from tse.channels.log import read_log
from tse.channels.look import _find_sign_bit
from tse.channels.proposal import propose
from tse.channels.signals import read_signals
from tse.library.core import STIFFNESS
from tse.library.errors import UserError
from tse.log.rows import Reading
from tse.readers import recording
from tse.readers.readers import choose_reader, read_recording
from tse.readers.recording import Channel, Recording

TOLERANCE = 0.01  # relative to the estimate from the clean CSV
LAST = 1000  # rows at the end, over which estimates are compared


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """Return a drive in tse's own columns, its vehicle file, and its estimates."""
    folder = tmp_path_factory.mktemp("formats")
    car, log = folder / "car.toml", folder / "log.csv"
    car.write_text(tselab("vehicle", "--simulated").out, encoding="utf-8")
    make_drive(car).to_csv(log, index=False)
    return pd.read_csv(log), car, compute_estimates(log, car, folder)


def compute_estimates(log: Path, car: Path, folder: Path, *options: object) -> pd.Series:
    """Return the means of the last rows of EST.csv."""
    done = tselab_here("estimate", "--verbose", log, "--vehicle", car, "--out", folder / "est.csv", *options)
    assert done.code == 0, done.err
    return pd.read_csv(folder / "est.csv").iloc[-LAST:][list(STIFFNESS)].mean()


@pytest.mark.parametrize("name", FORMATS)
def test_a_drive_in_this_format_gives_the_estimates_of_the_clean_csv(name, clean, tmp_path):
    table, car, wanted = clean
    path = write_or_skip(name, tmp_path, split_messages(table))
    found = compute_estimates(path, car, tmp_path)
    np.testing.assert_allclose(found / wanted, 1.0, atol=TOLERANCE)


@pytest.mark.parametrize(
    "name", ["ROS 1 bag", "MCAP, ROS 2", "BLF and DBC", "ASC and DBC", "TRC and DBC", "MF4"]
)
def test_of_a_log_that_is_cut_off_what_is_before_is_used(name, clean, tmp_path):
    """The recorder has lost its power, or the copy is incomplete."""
    table, car, _ = clean
    path = write_or_skip(name, tmp_path, split_messages(table))
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    how = Reading(car=read_vehicle(car))
    if name == "MF4":  # asammdf writes the descriptions after the data
        with pytest.raises(UserError, match=r"is damaged or cut off: .*copy it again"):
            read_log(path, reading=how)
        return
    log = read_log(path, reading=how)
    assert 0.3 * len(table) < len(log) < 0.7 * len(table)
    assert any(
        "damaged" in n or "its end is missing" in n or "end of the file" in n or "cut" in n for n in log.notes
    ), log.notes
    np.testing.assert_allclose(
        np.nanmean(log.data["yaw_rate"]), np.mean(table.yaw_rate[: len(log)]), atol=0.01
    )


def test_the_rows_are_those_of_the_clean_log(clean, tmp_path):
    """The comparison checks units, sign, ratio, latency and rates."""
    table, car, _ = clean
    path = FORMATS["Parquet"][1](tmp_path, split_messages(table))
    log = read_log(path, reading=Reading(car=read_vehicle(car)))
    assert abs(len(log) - len(table)) < 12 and log.sample_time == pytest.approx(0.01)
    for name, share in (
        ("steer_angle", 0.01),
        ("wheel_speed_rear", 0.001),
        ("wheel_speed_front", 0.002),
        ("accel_x", 1e-6),
        ("accel_y", 1e-6),
        ("yaw_rate", 1e-6),
    ):
        true = np.interp(log.time, table.time, table[name])
        assert np.nanstd(log.data[name] - true) < share * np.std(true), name
    # an entry for two and for five rows, so the noise is spread over as many
    assert log.slower["wheel_speed_rear"].rows == pytest.approx(2, rel=0.01)
    assert "accel_y" not in log.slower
    assert log.slower["steer_angle"].rows == pytest.approx(5, rel=0.01)


@pytest.mark.parametrize("rate", [50, 200])
def test_another_rate_on_demand(rate, clean, tmp_path):
    table, car, _ = clean
    path = FORMATS["MAT 5"][1](tmp_path, split_messages(table))
    log = read_log(path, reading=Reading(rate=rate, car=read_vehicle(car)))
    assert log.sample_time == pytest.approx(1 / rate)
    true = np.interp(log.time, table.time, table.wheel_speed_rear)
    assert np.nanstd(log.data["wheel_speed_rear"] - true) < 0.01 * np.std(true)


def test_signals_proposes_the_file_that_was_written_by_hand(clean, tmp_path):
    table, car, wanted = clean
    path = FORMATS["German CSV"][1](tmp_path, split_messages(table))
    by_hand = read_signals(tmp_path / "signals.toml")
    (tmp_path / "signals.toml").unlink()
    done = tselab_here("estimate", "--verbose", path, "--vehicle", car, "--out", tmp_path / "e.csv")
    assert done.code == 2 and f"tselab signals {path} --write signals.toml" in done.err
    done = tselab_here("signals", path, "--vehicle", car, "--write", tmp_path / "signals.toml")
    assert done.code == 0, done.err
    proposed = read_signals(tmp_path / "signals.toml")
    for channel, signal in by_hand.signals.items():
        mine = proposed.signals[channel]
        assert (mine.name, mine.sign) == (signal.name, signal.sign), channel
    assert by_hand.signals["steer_angle"].ratio == RATIO
    # relative to the gyro, which has a latency, too
    late = proposed.signals["wheel_speed_rear"].latency
    assert late == pytest.approx(LATENCY["wheels"] - LATENCY["imu"], abs=0.005)
    np.testing.assert_allclose(
        compute_estimates(path, car, tmp_path)[["cy_front", "cy_rear"]] / wanted[["cy_front", "cy_rear"]],
        1.0,
        atol=0.1,
    )


def test_signals_lists_what_a_log_holds(clean, tmp_path):
    table, _, _ = clean
    path = FORMATS["Parquet"][1](tmp_path, split_messages(table))
    done = tselab_here("signals", path, "--json")
    found = json.loads(done.out)
    signals = {s["name"]: s for s in found["signals"]}
    assert done.code == 0 and len(signals) == 8
    wheel = signals["RadVL"]
    assert (
        wheel["rate"] == pytest.approx(50, rel=0.02)
        and wheel["used"] == "wheel_speed_front"
        and wheel["missing"] > 0.4
    )
    assert signals["Gierrate"]["rate"] == pytest.approx(100, rel=0.02)
    assert signals["LenkradWinkel"]["high"] == pytest.approx(
        DEG * RATIO * table.steer_angle[::5].max(), rel=1e-6
    )
    assert found["proposal"]["yaw_rate"]["figures"] and found["proposal"]["yaw_rate"]["unit"] == "deg/s"


def test_what_is_not_installed_is_named_with_the_command(monkeypatch, tmp_path):
    real = importlib.import_module
    path = tmp_path / "x.mf4"
    path.write_bytes(b"MDF     4.10    test".ljust(200, b"\0"))

    def without(name, *args, **kw):
        if name.startswith("asammdf"):
            raise ModuleNotFoundError(name, name="asammdf")
        return real(name, *args, **kw)

    monkeypatch.setattr("tse.readers.recording.importlib.import_module", without)
    done = tselab_here("signals", path)
    assert done.code == 2 and "pip install 'tse[mf4]'" in done.err and "scripts/setup.sh logs" in done.err


def test_rlog_of_openpilot_is_read_by_its_schema(tmp_path):
    if find_spec("capnp") is None or find_spec("openpilot_logging") is None:
        pytest.skip("openpilot-logging is not installed: scripts/setup.sh openpilot")
    import capnp

    spec = find_spec("openpilot_logging")
    capnp.remove_import_hook()
    log = capnp.load(str(Path(spec.submodule_search_locations[0]) / "cereal" / "log.capnp"))
    raw = b""
    for i in range(300):
        event = log.Event.new_message(logMonoTime=int(1e15 + 1e7 * i))
        state = event.init("carState")
        state.steeringAngleDeg, state.vEgo = float(10 * np.sin(0.1 * i)), 20.0 + 0.01 * i
        state.wheelSpeeds.fl = 20.0 + 0.01 * i
        raw += event.to_bytes()
    (tmp_path / "a.rlog").write_bytes(raw)
    found = read_recording(tmp_path / "a.rlog")
    c = found.channels["carState.wheelSpeeds.fl"]
    assert (
        len(c) == 300
        and c.value[-1] == pytest.approx(22.99, rel=1e-5)
        and np.diff(c.time) == pytest.approx(0.01, abs=1e-6)
    )


@pytest.mark.parametrize("command", ["calibrate", "gap check"])
def test_calibrate_and_gap_take_any_log_also_without_accel_x(command, clean, tmp_path):
    table, car, _ = clean
    path = FORMATS["Parquet"][1](tmp_path, split_messages(table))
    text = (tmp_path / "signals.toml").read_text()
    before, after = text.index("[signals.accel_x]"), text.index("[signals.accel_y]")
    (tmp_path / "signals.toml").write_text(text[:before] + text[after:])
    options = ["--out", tmp_path / "c.toml", "--steps", 1, "--verbose"] if command == "calibrate" else []
    done = tselab_here(*command.split(), path, "--vehicle", car, "--jobs", 1, *options)
    assert done.code in (0, 3, 12) and "accel_x" in done.out + done.err, done.err
    if options:
        assert (tmp_path / "c.toml").exists()
    else:
        assert "accel_y" in done.out and "Gap with fitted stiffness" in done.out


# ---- Properties of real logs that simulated ones lacked. Each case is a copy of a public
# log that was read wrong once.

RADIUS = RADII["rear"]


@pytest.fixture(scope="module")
def bends(tmp_path_factory):
    """Return a minute of lane changes: true signals in SI units."""
    car = tmp_path_factory.mktemp("world") / "car.toml"
    car.write_text(tselab("vehicle", "--simulated").out, encoding="utf-8")
    return make_drive(car)


def make_recording(time: np.ndarray, **columns: object) -> Recording:
    """Return a recording of columns, given as values or as (values, unit)."""
    parts = {n.replace("__", "."): x if isinstance(x, tuple) else (x, "") for n, x in columns.items()}
    return Recording(
        Path("log"), "made", {n: Channel(n, time, np.asarray(v, float), u) for n, (v, u) in parts.items()}
    )


def make_signals_without_wheels(bends) -> dict[str, object]:
    """Return signals named as in a published MAT file of a car driven by a computer.

    It has no steering wheel: df is the angle of the front wheels."""
    return {
        "vx": bends.wheel_speed_rear * RADIUS,
        "df": bends.steer_angle,
        "a_lat": bends.accel_y,
        "a_long": bends.accel_x,
        "wz": bends.yaw_rate,
        "psi": np.angle(np.exp(1j * np.cumsum(bends.yaw_rate) * 0.01)),
    }


def test_without_wheels_the_speed_stands_for_an_axle_and_says_so(bends):
    found = propose(make_recording(bends.time.to_numpy(), **make_signals_without_wheels(bends)))
    assert {g.channel: g.name for g in found.guesses} == {
        "steer_angle": ("df",), "wheel_speed_rear": ("vx",), "accel_x": ("a_long",),
        "accel_y": ("a_lat",), "yaw_rate": ("wz",)}  # fmt: skip
    assert (found["wheel_speed_rear"].unit, found["steer_angle"].unit, found["steer_angle"].ratio) == (
        "m/s",
        "rad",
        None,
    )
    assert "slip and longitudinal stiffness are not known" in " ".join(found["wheel_speed_rear"].figures)


def test_a_speed_of_a_receiver_once_a_second_is_no_wheel_but_tells_the_units(bends):
    made = make_signals_without_wheels(bends) | {
        "wz": np.degrees(bends.yaw_rate),
        "a_lat": bends.accel_y / 9.81,
    }
    speed = Channel("gps_speed_kmh", bends.time.to_numpy()[::100], 3.6 * np.asarray(made.pop("vx"))[::100])
    log = make_recording(bends.time.to_numpy(), **made)
    log.channels[speed.name] = speed
    found = propose(log)
    assert found["wheel_speed_rear"] is None and "wheel_speed_rear" in found.missing
    assert (found["yaw_rate"].unit, found["accel_y"].unit) == ("deg/s", "g")


def test_an_attitude_is_no_yaw_rate_and_an_accuracy_no_steering(bends):
    heading = np.cumsum(bends.yaw_rate) * 0.01
    noise = np.random.default_rng(1).normal(0.2, 0.02, len(bends))
    found = propose(
        make_recording(
            bends.time.to_numpy(),
            tf__rotation__z=np.sin(heading / 2),
            tf__rotation__w=np.cos(heading / 2),
            gnss__RollAccuracy=(noise, "deg"),
            engine__rpm=(900 + 50 * noise, "rpm"),
            vehicle_speed=bends.wheel_speed_rear * 1.1,
        )
    )
    assert found["yaw_rate"] is None and found["steer_angle"] is None


def test_a_measured_quantity_may_be_called_status(bends):
    named = {
        "vehicle_speed_status": 3.6 * RADIUS * bends.wheel_speed_rear,
        "steer_angle_status": bends.steer_angle * 57.3 * RATIO,
        "yaw_rate_status": bends.yaw_rate,
    }
    found = propose(make_recording(bends.time.to_numpy(), **named))
    assert found["steer_angle"].name == ("steer_angle_status",) and found["yaw_rate"].name == (
        "yaw_rate_status",
    )
    assert found["wheel_speed_rear"].unit == "km/h"
    flags = {n: np.arange(len(bends)) // 100 % 3 for n in ("steer_angle_status", "yaw_rate_status")}
    assert (
        propose(make_recording(bends.time.to_numpy(), vehicle_speed=bends.wheel_speed_rear, **flags))[
            "yaw_rate"
        ]
        is None
    )


def test_the_four_pressures_of_the_tyres_are_no_wheel_speeds(bends):
    rng = np.random.default_rng(2)
    pressure = {f"{s}_pressure": 33 + 0.01 * bends.time + rng.normal(0, 0.05, len(bends)) for s in
                ("left_front", "right_front", "left_rear", "right_rear")}  # fmt: skip
    assert propose(make_recording(bends.time.to_numpy(), **pressure)).guesses == []


def test_the_ratio_of_a_straight_drive_is_not_drawn_down_by_the_noise_of_the_gyro():
    """The steering angle hardly moves, and the gyro has coarse steps.

    A regression on the noisy gyro gives a ratio that is a third too small: 11.8 for a car
    of 16.9."""
    rng = np.random.default_rng(3)
    v = np.full(5000, 22.0)
    r, noise = (physics.smooth(rng.normal(0, 0.02, 6000))[500:-500] for _ in range(2))
    angle = RATIO * 2.7 * r / v * (1 + physics.UNDERSTEER * v**2)
    found = physics.fit_steering(angle, v, r + 0.7 * noise)
    assert 0.55 < found.share < 0.8
    off = abs(np.log(found.per_curvature / (RATIO * 2.7)))
    assert off < 2.0 * found.sd and off < 0.25 and found.sd < 0.4


TWO = """VERSION ""
BO_ 100 M: 2 X
 SG_ speed : 0|16@1+ (1,0) [0|65535] "km/h" X
BO_ 2147483748 E: 2 X
 SG_ angle : 0|16@1+ (1,0) [0|65535] "deg" X
"""


@pytest.mark.parametrize("name", ["drive.blf", "drive.asc", "drive.log", "drive.csv", "drive.mf4"])
def test_buses_and_kinds_of_identifiers_are_kept_apart(name, tmp_path):
    """Identifier 100, standard and extended, on two buses; the higher bus sends first."""
    pytest.importorskip("cantools", reason="cantools is not installed: scripts/setup.sh logs")
    sent = [
        (1e-2 * i + 1e-3 * k, 100, extended, (10 * k + i).to_bytes(2, "little"), bus)
        for i in range(50)
        for k, (extended, bus) in enumerate([(False, 2), (False, 1), (True, 1)])
    ]
    (tmp_path / "car.dbc").write_text(TWO)
    if name == "drive.csv":
        rows = [f"{round(1e6 * t)},{i:X},{e},{b},{len(d)},{d[0]:02X},{d[1]:02X}" for t, i, e, d, b in sent]
        (tmp_path / name).write_text("Time Stamp,ID,Extended,Bus,LEN,D1,D2\n" + "\n".join(rows) + "\n")
    elif name == "drive.mf4":
        write_mf4_bus(tmp_path / name, sent)
    else:
        write_bus(tmp_path / name, sent)
    log = read_recording(tmp_path / name)
    assert {
        n: (c.value == k * 10 + np.arange(50)).all()
        for k, n in ((0, "M.speed#2"), (1, "M.speed"), (2, "E.angle"))
        for c in [log.channels[n]]
    } == {"M.speed#2": True, "M.speed": True, "E.angle": True}
    assert len(log.channels) == 3 and any(
        "message M appears more than once" in n and "M.speed#2" in n for n in log.notes
    )


@pytest.mark.parametrize("name", ["drive.candump", "drive.txt", "drive.log"])
def test_what_candump_wrote_is_told_by_its_lines(name, tmp_path):
    path = tmp_path / name
    path.write_text("(1489113253.313310) can0 083#0FE0000000900000\n")
    assert choose_reader(path) == "can"


def test_a_table_may_be_called_log(tmp_path):
    path = tmp_path / "drive.log"
    path.write_text("time,speed\n" + "".join(f"{0.1 * i:g},{i}\n" for i in range(9)))
    assert read_recording(path).channels["speed"].value[-1] == 8


def test_a_decimal_comma_that_comes_late_is_one(tmp_path):
    """The car stands at first, so the first numbers are whole."""
    rows = [f"{i};{'0' if i < 500 else f'{i},5'}" for i in range(600)]
    (tmp_path / "drive.csv").write_text("time;speed\n" + "\n".join(rows) + "\n")
    assert read_recording(tmp_path / "drive.csv").channels["speed"].value[[499, 500, 599]].tolist() == [
        0,
        500.5,
        599.5,
    ]


def test_a_database_of_frames_is_no_bag(tmp_path):
    pytest.importorskip("rosbags", reason="rosbags is not installed: scripts/setup.sh logs")
    path = tmp_path / "drive.db"
    with sqlite3.connect(path) as base:
        base.execute("create table messages (ts real, arbitration_id integer, data blob)")
    base.close()
    with pytest.raises(UserError, match=r"no ROS 2 bag.*logconvert drive.db drive.blf"):
        read_recording(path)


def test_a_sign_that_is_a_bit_of_its_own_is_proposed_with_its_magnitude(bends):
    """The log has |angle| and |yaw rate|, each with a bit for the sign, as Volkswagen
    has.

    Other bits are similar to the signs, and none of them is a measurement."""
    time, data = bends.time.to_numpy(), bends
    rng = np.random.default_rng(3)
    found = propose(
        make_recording(
            time,
            **{
                "LWI_Lenkradwinkel": np.abs(RATIO * data.steer_angle.to_numpy()),
                "LWI_VZ_Lenkradwinkel": 1.0 * (data.steer_angle < 0),
                "LWI_QBit_Lenkradwinkel": 1.0 * (rng.random(len(time)) < 0.01),
                "ESP_Gierrate": np.abs(data.yaw_rate.to_numpy()),
                "ESP_VZ_Gierrate": 1.0 * (data.yaw_rate < 0),
                "ESP_Querbeschleunigung": data.accel_y.to_numpy(),
                "ESP_Laengsbeschl": data.accel_x.to_numpy(),
                **{
                    f"ESP_{side}_Radgeschw": data[f"wheel_speed_{axle}"].to_numpy() * RADIUS
                    for side, axle in (("VL", "front"), ("VR", "front"), ("HL", "rear"), ("HR", "rear"))
                },
                "ESP_Stillstand_Radgeschw": 1.0 * (data.wheel_speed_front < 0.1),
            },
        )
    )
    wanted = (
        ("steer_angle", "LWI_Lenkradwinkel", "LWI_VZ_Lenkradwinkel"),
        ("yaw_rate", "ESP_Gierrate", "ESP_VZ_Gierrate"),
        ("accel_y", "ESP_Querbeschleunigung", None),
    )
    for channel, name, bit in wanted:
        guess = found[channel]
        assert guess is not None and (guess.name, guess.sign_bit) == ((name,), bit), guess


@pytest.mark.parametrize(("bit", "wanted"), [("ESP_VZ_Gierrate", "ESP_VZ_Gierrate"), ("ESP_Gaspedal", None)])
def test_a_bit_whose_name_is_less_alike_is_no_sign(bit, wanted):
    """The values fit, but the two names share only 7 of 12 letters."""
    time = 0.01 * np.arange(2000)
    turn = np.sin(time)
    assert _find_sign_bit("ESP_Gierrate", time, np.abs(turn), {bit: (bit, time, 1.0 * (turn < 0))}) == wanted


@pytest.mark.parametrize(("late", "says"), [(0.0, False), (0.12, True)])
def test_a_steering_angle_that_comes_after_the_yaw_rate_is_late(bends, late, says):
    """A car cannot turn before its wheels do.

    An angle that is in time gives no warning."""
    time = bends.time.to_numpy()
    data = {c: bends[c] for c in ("accel_x", "accel_y", "yaw_rate", "wheel_speed_front", "wheel_speed_rear")}
    found = propose(make_recording(time, steer_angle=np.interp(time - late, time, bends.steer_angle), **data))
    guess = found["steer_angle"]
    assert guess is not None and any("steer_angle is logged about" in w for w in found.warnings) == says
    assert guess.latency == pytest.approx(late, abs=0.05 if says else 0.0)


def test_a_file_that_unpacks_to_more_than_a_log_is_refused_by_what_it_says(tmp_path):
    """A file of 1 KB in MAT 5 that states 4 GB, and a table with too many rows."""
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    packed = zlib.compress(struct.pack("<II", 14, (1 << 32) - 8) + bytes(1 << 20))
    (tmp_path / "bomb.mat").write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)
    done = tselab_here("signals", tmp_path / "bomb.mat")
    assert done.code == 2 and "has a variable of 4.0 GB" in done.err and "-v7.3" in done.err

    pa = pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq

    table = {"time": pa.nulls(50000, pa.float64()), "x": pa.nulls(50000, pa.float64())}
    pq.write_table(pa.table(table), tmp_path / "t.parquet")
    size = (tmp_path / "t.parquet").stat().st_size
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording, "ALWAYS_ALLOWED_ROWS", 49999)
        done = tselab_here("signals", tmp_path / "t.parquet")
    assert size < 1e5
    assert (
        done.code == 2 and "the table has 50,000 rows; a file of its size may have up to 49,999" in done.err
    )
    assert "cut a long log into drives" in done.err


# ---- Real logs


DATA = Path(__file__).parents[3] / "shared" / "data"
RANGE = {"cx_front": (30e3, 300e3), "cy_front": (40e3, 200e3), "cy_rear": (40e3, 200e3)}
ROWS = {"rav4_comma2k19": {None: 4799, 0.1: 600}, "subaru_sti": {None: 4513, 0.1: 902}}


@pytest.mark.parametrize(("name", "average"), [
    ("rav4_comma2k19", None), ("rav4_comma2k19", 0.1), ("subaru_sti", None), ("subaru_sti", 0.1),
])  # fmt: skip
def test_real_log_gives_finite_positive_plausible_stiffness(name, average, tmp_path):
    folder = DATA / name
    if not (folder / "data.csv").exists():
        pytest.skip(f"{name}: the real log is not beside this checkout")
    options = () if average is None else ("--average", average)
    found = []
    for _ in range(2):
        done = tselab_here(
            "estimate",
            "--verbose",
            folder / "data.csv",
            "--vehicle",
            folder / "vehicle.toml",
            "--report",
            "r.html",
            "--no-calibrate",
            *options,
            cwd=tmp_path,
        )
        assert done.code in RAN, done.err
        assert (
            "filled in: cornering_stiffness_front" in done.out
            and "filled in: [uncertainty] mass_sd" in done.out
        )
        est = pd.read_csv(tmp_path / "data.est.csv")
        assert len(est) == ROWS[name][average]
        numbers = est.select_dtypes("number")
        assert np.isfinite(numbers.to_numpy()).all() and (est["bias_accel_x"].abs() < 2).all()
        for key, (low, high) in RANGE.items():
            assert (est[key] > 0).all()
            valid = est[key][est[f"{key}_valid"] == 1]
            assert valid.between(low, high).all(), key
        found.append(est)
    pd.testing.assert_frame_equal(*found)  # the estimates do not depend on a random number
    # one stiffness is always unobservable in this log, and has its interval nevertheless
    assert "not valid: " in done.out and done.out.count("(95 %), ") >= 4
