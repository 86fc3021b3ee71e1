"""One drive in every format: one command each, and the estimates are those of the clean CSV."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from conftest import tselab, tselab_here
from log_formats import DEG, FORMATS, LATENCY, RATIO, drive, messages
from tse.impl.core import STIFFNESS

TOLERANCE = 0.01  # of the estimate from the clean CSV
LAST = 1000  # rows over which estimates are compared


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """A drive in tse's own columns, its vehicle file, and what is estimated from it."""
    folder = tmp_path_factory.mktemp("formats")
    car, log = folder / "car.toml", folder / "log.csv"
    car.write_text(tselab("vehicle", "--simulated").out, encoding="utf-8")
    drive(car).to_csv(log, index=False)
    return pd.read_csv(log), car, estimates(log, car, folder)


def estimates(log: Path, car: Path, folder: Path, *options: object) -> pd.Series:
    """Means over the end of EST.csv."""
    done = tselab_here("estimate", log, "--vehicle", car, "--out", folder / "est.csv", *options)
    assert done.code == 0, done.err
    return pd.read_csv(folder / "est.csv").iloc[-LAST:][list(STIFFNESS)].mean()


@pytest.mark.parametrize("name", FORMATS)
def test_a_drive_in_this_format_gives_the_estimates_of_the_clean_csv(name, clean, tmp_path):
    needs, write = FORMATS[name]
    if find_spec(needs) is None:
        pytest.skip(f"{needs} is not installed: scripts/setup.sh logs")
    table, car, wanted = clean
    path = write(tmp_path, messages(table))
    found = estimates(path, car, tmp_path)
    np.testing.assert_allclose(found / wanted, 1.0, atol=TOLERANCE)


@pytest.mark.parametrize("name", ["ROS 1 bag", "MCAP, ROS 2", "BLF and DBC", "ASC and DBC", "TRC and DBC", "MF4"])
def test_of_a_log_that_is_cut_off_what_is_before_is_used(name, clean, tmp_path):
    """A recorder without power, a copy that broke off."""
    from tse.impl.errors import UserError
    from tse.impl.logs.log import read_log
    from tse.impl.rows import Reading
    from tse.impl.vehicle import read_vehicle

    needs, write = FORMATS[name]
    if find_spec(needs) is None:
        pytest.skip(f"{needs} is not installed: scripts/setup.sh logs")
    table, car, _ = clean
    path = write(tmp_path, messages(table))
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    how = Reading(car=read_vehicle(car))
    if name == "MF4":  # asammdf writes what it describes behind the data
        with pytest.raises(UserError, match=r"is damaged or cut off: .*copy it again"):
            read_log(path, reading=how)
        return
    log = read_log(path, reading=how)
    assert 0.3 * len(table) < len(log) < 0.7 * len(table)
    assert any(
        "damaged" in n or "its end is missing" in n or "end of the file" in n or "cut" in n for n in log.notes
    ), log.notes
    np.testing.assert_allclose(np.nanmean(log.data["yaw_rate"]), np.mean(table.yaw_rate[: len(log)]), atol=0.01)


def test_the_rows_are_those_of_the_clean_log(clean, tmp_path):
    """Units, sign, ratio, latency, rates: each would show here."""
    from tse.impl.logs.log import read_log
    from tse.impl.rows import Reading
    from tse.impl.vehicle import read_vehicle

    table, car, _ = clean
    path = FORMATS["Parquet"][1](tmp_path, messages(table))
    log = read_log(path, reading=Reading(car=read_vehicle(car)))
    assert abs(len(log) - len(table)) < 12 and log.sample_time == pytest.approx(0.01)
    for name, share in (
        ("steer_angle", 0.01), ("wheel_speed_rear", 0.001), ("wheel_speed_front", 0.002), ("accel_x", 1e-6), ("accel_y", 1e-6),
        ("yaw_rate", 1e-6)
    ):  # fmt: skip
        true = np.interp(log.time, table.time, table[name])
        assert np.nanstd(log.data[name] - true) < share * np.std(true), name
    # an entry for two and for five rows: their noise is that of so many
    assert log.slower["wheel_speed_rear"].rows == pytest.approx(2, rel=0.01)
    assert "accel_y" not in log.slower
    assert log.slower["steer_angle"].rows == pytest.approx(5, rel=0.01)


@pytest.mark.parametrize("rate", [50, 200])
def test_another_rate_on_demand(rate, clean, tmp_path):
    from tse.impl.logs.log import read_log
    from tse.impl.rows import Reading
    from tse.impl.vehicle import read_vehicle

    table, car, _ = clean
    path = FORMATS["MAT 5"][1](tmp_path, messages(table))
    log = read_log(path, reading=Reading(rate=rate, car=read_vehicle(car)))
    assert log.sample_time == pytest.approx(1 / rate)
    true = np.interp(log.time, table.time, table.wheel_speed_rear)
    assert np.nanstd(log.data["wheel_speed_rear"] - true) < 0.01 * np.std(true)


def test_signals_proposes_the_file_that_was_written_by_hand(clean, tmp_path):
    from tse.impl.logs.signals import read_signals

    table, car, wanted = clean
    path = FORMATS["German CSV"][1](tmp_path, messages(table))
    by_hand = read_signals(tmp_path / "signals.toml")
    (tmp_path / "signals.toml").unlink()
    done = tselab_here("estimate", path, "--vehicle", car, "--out", tmp_path / "e.csv")
    assert done.code == 2 and "tselab signals fahrt.csv --write signals.toml" in done.err
    done = tselab_here("signals", path, "--vehicle", car, "--write", tmp_path / "signals.toml")
    assert done.code == 0, done.err
    proposed = read_signals(tmp_path / "signals.toml")
    for channel, signal in by_hand.signals.items():
        mine = proposed.signals[channel]
        assert (mine.name, mine.sign) == (signal.name, signal.sign), channel
    assert by_hand.signals["steer_angle"].ratio == RATIO
    # behind the gyro, which is late itself
    late = proposed.signals["wheel_speed_rear"].latency
    assert late == pytest.approx(LATENCY["wheels"] - LATENCY["imu"], abs=0.005)
    np.testing.assert_allclose(
        estimates(path, car, tmp_path)[["cy_front", "cy_rear"]] / wanted[["cy_front", "cy_rear"]], 1.0, atol=0.1
    )


def test_signals_lists_what_a_log_holds(clean, tmp_path):
    import json

    table, _, _ = clean
    path = FORMATS["Parquet"][1](tmp_path, messages(table))
    done = tselab_here("signals", path, "--json")
    found = json.loads(done.out)
    signals = {s["name"]: s for s in found["signals"]}
    assert done.code == 0 and len(signals) == 8
    wheel = signals["RadVL"]
    assert (
        wheel["rate"] == pytest.approx(50, rel=0.02) and wheel["used"] == "wheel_speed_front" and wheel["missing"] > 0.4
    )
    assert signals["Gierrate"]["rate"] == pytest.approx(100, rel=0.02)
    assert signals["LenkradWinkel"]["high"] == pytest.approx(DEG * RATIO * table.steer_angle[::5].max(), rel=1e-6)
    assert found["proposal"]["yaw_rate"]["figures"] and found["proposal"]["yaw_rate"]["unit"] == "deg/s"


def test_what_is_not_installed_is_named_with_the_command(monkeypatch, tmp_path):
    import importlib

    real = importlib.import_module
    path = tmp_path / "x.mf4"
    path.write_bytes(b"MDF     4.10    test".ljust(200, b"\0"))

    def without(name, *args, **kw):
        if name.startswith("asammdf"):
            raise ModuleNotFoundError(name, name="asammdf")
        return real(name, *args, **kw)

    monkeypatch.setattr("tse.impl.logs.recording.importlib.import_module", without)
    done = tselab_here("signals", path)
    assert done.code == 2 and "pip install 'tse[mf4]'" in done.err and "scripts/setup.sh logs" in done.err


def test_rlog_of_openpilot_is_read_by_its_schema(tmp_path):
    if find_spec("capnp") is None or find_spec("openpilot_logging") is None:
        pytest.skip("openpilot-logging is not installed: scripts/setup.sh openpilot")
    import capnp

    from tse.impl.logs.readers import read_recording

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
    path = FORMATS["Parquet"][1](tmp_path, messages(table))
    text = (tmp_path / "signals.toml").read_text()
    before, after = text.index("[signals.accel_x]"), text.index("[signals.accel_y]")
    (tmp_path / "signals.toml").write_text(text[:before] + text[after:])
    options = ["--out", tmp_path / "c.toml", "--steps", 1] if command == "calibrate" else []
    done = tselab_here(*command.split(), path, "--vehicle", car, "--jobs", 1, *options)
    assert done.code in (0, 3, 12) and "accel_x" in done.out + done.err, done.err
    if options:
        assert (tmp_path / "c.toml").exists()
    else:
        assert "accel_y" in done.out and "Gap with fitted stiffness" in done.out
