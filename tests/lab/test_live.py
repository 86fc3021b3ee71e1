"""The filter on a bus while driving has the rows and estimates of the drive's file.

Each fault has a sentence.
"""

import json
import shutil
import signal
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import tse
import tse.estimation.answer
from conftest import RAN, tselab, tselab_here
from log_formats import RADIUS, RATIO, TRACK, make_drive
from trade_files import DBC, encode_frames
from tse.car.config import make_config
from tse.car.vehicle import read_vehicle
from tse.channels.log import read_log
from tse.channels.signals import read_signals
from tse.library.errors import UserError
from tse.log.rows import Reading
from tse.streaming.drive import LiveDrive, make_bus_opener
from tse.streaming.page import Page

can = pytest.importorskip("can")

ROOT = Path(__file__).resolve().parents[2]
EPOCH = 1_700_000_000.0
SIGNALS = f"""
[signals.steer_angle]
name = "SteeringWheelAngle"
ratio = {RATIO}
counter = "SAS_1_Counter"
[signals.wheel_speed_front]
name = ["WheelSpeedFL", "WheelSpeedFR"]
[signals.wheel_speed_rear]
name = ["ESC_2.WheelSpeedRL", "WheelSpeedRR"]
[signals.yaw_rate]
name = "YawRate"
valid = {{name = "ESC_1_Qualifier", is = [0]}}
[signals.accel_x]
name = "LongitudinalAcceleration"
[signals.accel_y]
name = "LateralAcceleration"
latency = 0.01
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A vehicle file, a database and signals.toml."""
    made = tmp_path_factory.mktemp("live")
    (made / "car.toml").write_text(tselab("vehicle", "--simulated").out, encoding="utf-8")
    (made / "car.dbc").write_text(DBC, encoding="cp1252")
    (made / "signals.toml").write_text(SIGNALS)
    return made


def sent(
    folder: Path, seconds: float = 20.0, qualifier: np.ndarray | None = None
) -> list[tuple[float, int, bytes]]:
    """Return the frames of a drive, three messages each 10 ms."""
    clean = make_drive(folder / "car.toml", seconds)
    table = clean[["time", "steer_angle", "accel_x", "accel_y", "yaw_rate"]].copy()
    for axle, letter in (("front", "f"), ("rear", "r")):
        for side, sign in (("l", -1), ("r", 1)):
            table[letter + side] = (
                clean[f"wheel_speed_{axle}"] * RADIUS[axle] + sign * 0.5 * TRACK * clean.yaw_rate
            )
    return encode_frames(table, qualifier)


@pytest.fixture(scope="module")
def trip(folder):
    """Twenty seconds of it."""
    return sent(folder)


def make_message(stamp: float, identifier: int, data: bytes) -> "can.Message":
    return can.Message(timestamp=EPOCH + stamp, arbitration_id=identifier, data=data, is_extended_id=False)


class Sender(threading.Thread):
    """Sends frames on a virtual bus, so many times as fast as they were."""

    def __init__(self, channel: str, trip: list[tuple[float, int, bytes]], speed: float = 5.0):
        super().__init__(daemon=True)
        self._channel, self._trip, self._speed = channel, trip, speed

    def run(self) -> None:
        with can.Bus(interface="virtual", channel=self._channel, preserve_timestamps=True) as bus:
            begin = time.monotonic()
            for t, i, d in self._trip:
                if (wait := begin + (t - self._trip[0][0]) / self._speed - time.monotonic()) > 0:
                    time.sleep(wait)
                bus.send(make_message(t, i, d))


def make_opener(channel: str):
    return make_bus_opener("virtual", channel, preserve_timestamps=True)


def make_live(folder, channel, out=None, signals=True, say=lambda _: None, **more):
    car = read_vehicle(folder / "car.toml")
    mapped = read_signals(folder / "signals.toml") if signals is True else signals
    opened = more.pop("opened", None) or make_opener(channel)
    return LiveDrive(
        opened, [folder / "car.dbc"], car, make_config(car, None)[0], mapped, out, say=say, **more
    )


def drive_live(live, sender, patience=1.0):
    """Work until everything was sent and used."""
    sender.start()
    end = time.monotonic() + patience
    while sender.is_alive() or time.monotonic() < end:
        end = time.monotonic() + patience if sender.is_alive() else end
        live.work(0.05)
    live.close()


def test_a_drive_has_the_numbers_of_its_file(folder, trip, tmp_path):
    """The rows of the record give the same bits.

    Its frames give the same values, but for the end of the spline, which lacks later
    frames.
    """
    live = make_live(folder, "same", tmp_path / "out")
    drive_live(live, Sender("same", trip, 3.0))
    out = tmp_path / "out"
    assert {p.name for p in out.iterdir()} >= {
        "car.dbc",
        "events.txt",
        "filter.toml",
        "frames.blf",
        "frames.signals.toml",
        "rows.csv",
        "rows.est.csv",
    } - {"events.txt"}
    done = tselab_here(
        "estimate",
        out / "rows.csv",
        "--config",
        out / "filter.toml",
        "--vehicle",
        folder / "car.toml",
        "--no-calibrate",
        "--out",
        tmp_path / "rows.est.csv",
    )
    assert done.code in RAN, done.err
    assert (tmp_path / "rows.est.csv").read_bytes() == (out / "rows.est.csv").read_bytes()
    done = tselab_here("estimate", out / "frames.blf", "--vehicle", folder / "car.toml", "--no-calibrate",
                       "--out", tmp_path / "frames.est.csv")  # fmt: skip
    assert done.code in RAN, done.err
    mine, theirs = pd.read_csv(out / "rows.est.csv"), pd.read_csv(tmp_path / "frames.est.csv")
    assert abs(len(mine) - len(theirs)) <= 2 and len(mine) > 1950
    both = mine.assign(key=(100 * mine.time).round()).merge(
        theirs.assign(key=(100 * theirs.time).round()), on="key"
    )
    assert len(both) > 1950
    for s in ("cx_front", "cy_front", "cy_rear"):
        assert (np.abs(both[f"{s}_x"] - both[f"{s}_y"]) / both[f"{s}_sd_y"]).max() < 0.1
    rows = read_log(out / "frames.blf", reading=Reading(car=read_vehicle(folder / "car.toml")))
    own = pd.read_csv(out / "rows.csv")
    at = np.searchsorted(rows.time, own.time - 1e-4).clip(0, len(rows) - 1)
    for c, size in (
        ("yaw_rate", 0.002),
        ("accel_y", 0.05),
        ("steer_angle", 5e-4),
        ("wheel_speed_front", 0.02),
    ):
        assert np.nanquantile(np.abs(rows.data[c].to_numpy()[at] - own[c]), 0.99) < size


@pytest.mark.slow
def test_a_drive_in_real_time_keeps_up(folder, tmp_path):
    live = make_live(folder, "real", tmp_path / "out")
    drive_live(live, Sender("real", sent(folder, 8.0), 1.0), 0.3)
    drive_ = live.drive
    assert drive_.rows / (drive_.time - drive_.first) > 99.0
    assert np.median(drive_.delays) < 0.05
    assert "100 rows per second" in live.numbers()


@pytest.mark.slow
def test_a_database_of_another_bus_is_said_and_it_goes_on(folder, trip):
    live = make_live(folder, "foreign")
    strange = [(t, i + 500, d) for t, i, d in trip[:1500]]  # 5 s, as long as the others are away
    drive_live(live, Sender("foreign", strange + trip[1500:], 2.0))
    said = " ".join(text for _, text in live.said)
    assert (
        "none of the 3 identifiers (0x258, 0x259, 0x25a) is in car.dbc: the databases describe a different "
        "bus" in said
    )
    assert live.drive.rows > 1300


def test_a_message_that_stops_is_said_and_missing_until_it_is_back(folder, trip, tmp_path):
    """Each time that it stops."""
    stops = ((5.0, 8.0), (12.0, 15.0))
    live = make_live(folder, "stops", tmp_path / "out")
    sent_ = [f for f in trip if not (f[1] == 102 and any(a < f[0] < b for a, b in stops))]
    drive_live(live, Sender("stops", sent_))
    said = [text for _, text in live.said]
    assert sum("steer_angle: no value for a second (message SAS_1)" in s for s in said) == len(stops)
    assert sum("steer_angle: values arrive again" in s for s in said) == len(stops)
    rows = pd.read_csv(tmp_path / "out" / "rows.csv")
    time_ = rows.time % 100
    for a, b in stops:
        gone = rows[(time_ > a + 0.2) & (time_ < b - 0.1)]
        assert len(gone) > 250 and gone.steer_angle.isna().all() and gone.yaw_rate.notna().all()
        assert rows[(time_ > b + 0.2) & (time_ < b + 3.0)].steer_angle.notna().all()


def test_values_that_a_flag_calls_invalid_are_missing(folder, tmp_path):
    bad = np.zeros(1001)
    bad[400:700] = 1
    live = make_live(folder, "flag", tmp_path / "out")
    drive_live(live, Sender("flag", sent(folder, 10.0, bad)))
    rows = pd.read_csv(tmp_path / "out" / "rows.csv")
    inside = rows[(rows.time > 4.1) & (rows.time < 6.9)]
    assert inside.yaw_rate.isna().all() and inside.accel_x.notna().all() and len(inside) > 250
    assert any("yaw_rate: no value for a second" in text for _, text in live.said)


class Broken:
    """A bus that gives some messages, then fails."""

    def __init__(self, messages):
        self._messages = list(messages)

    def recv(self, timeout):
        if not self._messages:
            raise can.CanOperationError("Network is down [Error Code 100]")
        return self._messages.pop(0)

    def shutdown(self):
        pass


def test_a_bus_that_fails_is_opened_again_and_what_follows_is_used(folder, trip):
    first, later = [make_message(*f) for f in trip[:1500]], [make_message(*f) for f in trip[1500:]]
    parts = iter([Broken(first), Broken(later)])
    refused = iter([False, True, False])

    def opened():
        if next(refused, True):
            raise UserError("cannot be opened")
        return next(parts)

    live = make_live(folder, "", opened=opened)
    end = time.monotonic() + 6.0
    while live.drive.frames < len(trip) and time.monotonic() < end:
        live.work(0.05)
    live.close()
    said = [text for _, text in live.said]
    assert any("the bus failed (Network is down [Error Code 100]): tselab tries" in s for s in said)
    assert "the bus is open again" in said
    assert live.drive.rows > 1900


def test_a_bus_that_is_off_and_error_frames_are_said(folder, trip):
    off = can.Message(arbitration_id=0x40, is_error_frame=True)
    error = can.Message(arbitration_id=0x4, is_error_frame=True)
    messages = iter([error, off, *(make_message(*f) for f in trip[:30])])
    bus = Broken([])

    def recv(timeout):
        found = next(messages, None)
        if found is None:
            time.sleep(0.02)
        return found

    bus.recv = recv
    live = make_live(folder, "", opened=lambda: bus)
    end = time.monotonic() + 1.6
    while time.monotonic() < end:
        live.work(0.05)
    live.close()
    said = [text for _, text in live.said]
    assert any("1 error frame on the bus" in s for s in said), said
    assert any("the bus is off" in s for s in said)
    assert any("no frame for a second" in s for s in said)


def test_a_clock_that_is_set_back_is_bridged(folder, trip):
    live = make_live(folder, "clock")
    drive_live(live, Sender("clock", trip[:1500] + [(t - 100.0, i, d) for t, i, d in trip[1500:3000]]))
    assert any("the clock of the bus was set back by 100 s" in text for _, text in live.said)
    assert live.drive.rows > 900


@pytest.mark.slow
def test_signals_that_nobody_names_are_proposed_from_what_comes(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("tse.streaming.drive.LISTENED", 2.0)
    live = make_live(folder, "none", tmp_path / "out", signals=None)
    drive_live(live, Sender("none", sent(folder, 40.0), 5.0))
    said = [text for _, text in live.said]
    assert any("proposed: yaw_rate = ESC_1.YawRate: deg/s" in s for s in said)
    assert any("guessed by names, units and physics" in s for s in said)
    signals = read_signals(tmp_path / "out" / "frames.signals.toml").signals
    assert signals["steer_angle"].name == ("SAS_1.SteeringWheelAngle",)
    assert live.drive.rows > 3800  # those that came before they were found, too


def test_channels_that_contradict_each_other_are_said_and_teach_nothing(folder, trip, tmp_path):
    path = tmp_path / "wrong.toml"
    path.write_text(SIGNALS.replace('name = "YawRate"', 'name = "YawRate"\nsign = -1'))
    live = make_live(folder, "wrong", signals=read_signals(path))
    drive_live(live, Sender("wrong", trip), 1.5)
    assert any("yaw_rate is positive to the right" in text for _, text in live.said)
    est, found, _, against = live.result()
    assert est.learnt is None and against and all(v.level == "none" for f in found for v in f.verdicts)


@pytest.mark.slow
def test_python_gives_each_row_and_goes_on_from_what_a_drive_taught(folder, trip):
    def drive_(channel, **more):
        bus = can.Bus(interface="virtual", channel=channel, preserve_timestamps=True)
        sender = Sender(channel, trip)
        with tse.live(
            folder / "car.toml", database=folder / "car.dbc", bus=bus, duration=6.0, **more
        ) as live:
            sender.start()
            return live, list(live)

    live, estimates = drive_("first")
    assert len(estimates) > 1900 and len(live.answer) == 3 and live.learnt is not None
    share = np.mean([e.cy_front_valid for e in estimates])
    assert f"valid {100 * share:.0f} % of the time" in live.answer[0]
    last = estimates[-1]
    assert last.cy_front_valid and abs(last.cy_front - 120e3) < 3 * last.cy_front_sd
    _, again = drive_("second", learnt=live.learnt, age=60.0)
    assert again[0].cy_front_sd < 0.6 * estimates[0].cy_front_sd
    with pytest.raises(tse.Error, match="another vehicle"):
        car = {"mass": 900.0, "lf": 1.2, "lr": 1.5, "wheel_radius_front": 0.3, "wheel_radius_rear": 0.3}
        tse.live(
            car,
            database=folder / "car.dbc",
            bus=can.Bus(interface="virtual", channel="third"),
            learnt=live.learnt,
        )
    with pytest.raises(TypeError, match="either an interface or an open bus"):
        tse.live(folder / "car.toml", database=folder / "car.dbc")


COMMAND = """
import sys, threading
sys.path[:0] = {paths!r}
from test_live import Sender, sent
from pathlib import Path
folder = Path({folder!r})
Sender("cli", sent(folder, 30.0), 3.0).start()
from tselab.cli import main
sys.argv = ["tselab", "live", "--interface", "virtual", "--channel", "cli",
            "--bus", "preserve_timestamps=true", "--database", str(folder / "car.dbc"),
            "--vehicle", str(folder / "car.toml"), *{more!r}]
main()
"""


def command(folder, *more):
    paths = [str(Path(__file__).parent), *sys.path]
    text = COMMAND.format(paths=paths, folder=str(folder), more=[str(m) for m in more])
    return subprocess.Popen(
        [sys.executable, "-c", text], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@pytest.mark.slow
def test_the_command_saves_what_it_learnt_at_its_end_and_at_ctrl_c(folder, tmp_path):
    taught = tmp_path / "car.tse"
    done = command(folder, "--out", tmp_path / "one", "--duration", 9, "--save-learnt", taught, "--json",
                   "--table", tmp_path / "found.csv")  # fmt: skip
    out, err = done.communicate(timeout=120)
    assert done.returncode in RAN, err
    said = json.loads(out)
    assert (
        said["learnt"] == str(taught)
        and taught.stat().st_size == 268
        and said["exit_code"] == done.returncode
    )
    assert said["frames"] > 5000 and said["rows"] == len(pd.read_csv(tmp_path / "one" / "rows.csv")) > 1800
    assert set(pd.read_csv(tmp_path / "found.csv").stiffness) == {"cx_front", "cy_front", "cy_rear"}
    before = taught.read_bytes()
    going = command(
        folder, "--out", tmp_path / "two", "--load-learnt", taught, "--age", 1, "--save-learnt", taught
    )
    rows = tmp_path / "two" / "rows.csv"
    end = time.monotonic() + 60
    while time.monotonic() < end and not (rows.is_file() and rows.stat().st_size > 20_000):
        time.sleep(0.1)
    going.send_signal(signal.SIGINT)
    out, err = going.communicate(timeout=60)
    assert going.returncode in RAN, err
    assert "started from" in err and "Traceback" not in err and f"Learnt state written to {taught}" in out
    assert "front, in bends" in out and "rows per second; delay from a frame to its estimate" in err
    assert taught.read_bytes() != before and (tmp_path / "two" / "before.tse").read_bytes() == before
    again = tselab_here(
        "estimate",
        rows,
        "--config",
        tmp_path / "two" / "filter.toml",
        "--vehicle",
        folder / "car.toml",
        "--load-learnt",
        tmp_path / "two" / "before.tse",
        "--age",
        1,
        "--out",
        tmp_path / "e.csv",
    )
    assert (
        again.code in RAN
        and (tmp_path / "e.csv").read_bytes() == (tmp_path / "two" / "rows.est.csv").read_bytes()
    )


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--interface", "virtual"], "option --database: is missing"),
        (
            ["--interface", "nosuch", "--database", "car.dbc"],
            "interface nosuch, channel None: cannot be opened",
        ),
        (["--interface", "virtual", "--database", "gone.dbc"], "gone.dbc"),
        (
            ["--interface", "virtual", "--database", "car.dbc", "--bus", "bitrate"],
            "'bitrate' is not KEY=VALUE",
        ),
        (
            ["--interface", "virtual", "--database", "car.dbc", "--signals", "typo.toml"],
            "there is no 'YawRat' in car.dbc",
        ),
        (
            ["--interface", "virtual", "--database", "car.dbc", "--signals", "less.toml"],
            "steer_angle is missing",
        ),
        (["--interface", "virtual", "--database", "car.dbc", "--out", "."], "is not empty"),
        (
            ["--interface", "virtual", "--database", "car.dbc", "--duration", "0"],
            "option --duration: 0 is outside its range",
        ),
    ],
)
def test_what_cannot_begin_is_refused_with_a_sentence(options, says, folder, tmp_path):
    for name in ("car.toml", "car.dbc", "signals.toml"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "typo.toml").write_text(SIGNALS.replace('"YawRate"', '"YawRat"'))
    (tmp_path / "less.toml").write_text(SIGNALS[SIGNALS.index("[signals.wheel_speed_front]") :])
    done = tselab_here("live", "--vehicle", "car.toml", *options, cwd=tmp_path)
    assert done.code == 2 and says in done.err and "Traceback" not in done.err
    assert {p.name for p in tmp_path.iterdir()} == {
        "car.toml",
        "car.dbc",
        "signals.toml",
        "typo.toml",
        "less.toml",
    }


def test_the_page_has_the_rows_and_nothing_for_other_hosts(folder, trip):
    live = make_live(folder, "page")
    page = Page(live)
    try:
        text = urllib.request.urlopen(page.url, timeout=10).read().decode()
        assert (
            "class Chart" in text and "/* @" not in text and "http://" not in text and "https://" not in text
        )
        sender = Sender("page", trip[:3000])
        sender.start()
        while sender.is_alive():
            page.add(*live.work(0.05))
        found = json.load(urllib.request.urlopen(f"{page.url}rows?from=0&events=0", timeout=10))
        count = len(found["columns"]["time"])
        assert 150 < count < 210 and found["next"] == count and len(found["answer"]) == 3
        assert found["columns"]["cy_front"][-1] == pytest.approx(
            float(live.last["cy_front"]) * 120.0, rel=0.05
        )
        rest = json.load(urllib.request.urlopen(f"{page.url}rows?from={count}&events=0", timeout=10))
        assert rest["columns"]["time"] == [] and rest["begin"] == 0
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(
                urllib.request.Request(page.url, headers={"Host": "evil.example"}), timeout=10
            )
    finally:
        page.close()
        live.close()


@pytest.mark.slow
def test_the_page_in_a_browser(folder, trip):
    """Answers and plots appear at two widths, light and dark, without a network."""
    sys.path.append(str(ROOT / "scripts" / "dev"))
    import page as built

    chromium = next(
        (found for n in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(n))), None
    )
    if chromium is None or not shutil.which("node") or not shutil.which("npm"):
        pytest.skip("no browser, no node or no npm is installed")
    try:
        modules = built.install_modules()
    except built.Failed as error:
        pytest.skip(str(error)[:200])
    live = make_live(folder, "browser")
    page = Page(live, car="not calibrated")
    try:
        sender = Sender("browser", trip)
        sender.start()
        end = time.monotonic() + 2
        while sender.is_alive() or time.monotonic() < end:
            page.add(*live.work(0.05))
        how = [
            "node",
            ROOT / "tests" / "page" / "live.mjs",
            modules,
            chromium,
            page.url,
            ROOT / "build" / "site" / "shots",
        ]
        done = subprocess.run([str(x) for x in how], capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        seen = json.loads(done.stdout)
        answer = [line.strip() for line in tse.estimation.answer.make_answer(live.now(), live.config)]
    finally:
        page.close()
        live.close()
    assert seen["errors"] == [] and all(r.startswith((page.url, "data:")) for r in seen["requests"])
    for name in ("live-light", "live-phone"):
        of = seen[name]
        assert "   ".join(of["answer"]).split() == " ".join(answer).split()
        assert of["car"] == "not calibrated" and " rows, " in of["state"]
        assert of["overflow"] <= 0 and not of["cut"]
        assert of["behind"][3] == 0, of["behind"]


def test_a_disk_that_is_full_is_a_sentence_and_it_goes_on(folder, trip, tmp_path, monkeypatch):
    live = make_live(folder, "full", tmp_path / "out")

    class Full:
        def write(self, data):
            raise OSError(28, "No space left on device")

        def close(self):
            pass

    monkeypatch.setattr("tse.streaming.drive.open", lambda *a, **k: Full(), raising=False)
    sender = Sender("full", trip[:3000])
    drive_live(live, sender, 1.5)
    monkeypatch.undo()
    assert any("No space left on device): the filter goes on" in text for _, text in live.said)
    assert live.drive.rows > 900
