"""Frames of a bus to rows: names, start and rate of the rows, waits, clock, columns."""

import math
import struct
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tse.channels import stream
from tse.channels.mapping import Series
from tse.channels.signals import Counter, Flag, SignalsFile, SignalSource
from tse.channels.stream import Stream
from tse.library.errors import UserError
from tse.readers.bus_text import CanFrame

pytest.importorskip("cantools", reason="cantools is not installed: scripts/setup.sh logs")

DBC = """VERSION ""
BO_ 100 STEER: 4 X
 SG_ angle : 0|16@1- (0.001,0) [0|0] "rad" X
 SG_ same : 16|16@1- (0.001,0) [0|0] "" X
BO_ 101 IMU: 6 X
 SG_ rate : 0|16@1- (0.001,0) [0|0] "rad/s" X
 SG_ across : 16|16@1- (0.001,0) [0|0] "m/s2" X
 SG_ along : 32|16@1- (0.001,0) [0|0] "m/s2" X
BO_ 102 FRONT: 4 X
 SG_ left : 0|16@1- (0.01,0) [0|0] "rad/s" X
 SG_ right : 16|16@1- (0.01,0) [0|0] "rad/s" X
BO_ 103 REAR: 4 X
 SG_ left : 0|16@1- (0.01,0) [0|0] "rad/s" X
 SG_ right : 16|16@1- (0.01,-200) [0|0] "rad/s" X
BO_ 104 OPTIC: 4 X
 SG_ vx : 0|16@1- (0.01,0) [0|0] "m/s" X
 SG_ same : 16|16@1- (0.01,0) [0|0] "m/s" X
"""
CAR = SimpleNamespace(values={"wheel_radius_front": 0.3, "wheel_radius_rear": 0.36})
NAMES = {
    "steer_angle": ("angle",),
    "wheel_speed_front": ("FRONT.left", "FRONT.right"),
    "wheel_speed_rear": ("REAR.left", "REAR.right"),
    "accel_x": ("along",),
    "accel_y": ("across",),
    "yaw_rate": ("rate",),
}
NAN = np.nan


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stream") / "car.dbc"
    path.write_text(DBC, encoding="ascii")
    return path


def make(database: Path, names: dict | None = None, rate: float | None = None, **sources: dict) -> Stream:
    """Return a stream. `sources`: channel -> more keys of its source."""
    names = NAMES if names is None else names
    found = {c: SignalSource(c, n, **sources.get(c, {})) for c, n in names.items()}
    return Stream([database], SignalsFile(None, found), CAR, rate)


def leave_out(*channels: str) -> dict:
    return {c: n for c, n in NAMES.items() if c not in channels}


def frame(time: float, identifier: int, *raw: int) -> CanFrame:
    return CanFrame(time, identifier, False, "can0", struct.pack(f"<{len(raw)}h", *raw))


def make_frames(first: float, last: float, late: float = 0.0) -> list[CanFrame]:
    """Return frames whose signals are lines: angle 0.05 t, yaw rate 0.1 t, a_y
    1 t, a_x 0.5 t, wheels 50 + t and 52 + t in front, 40 + t and 44 + t in the rear.

    The steering angle comes at 20 Hz and `late`, s, the IMU at 100, the wheels at 50."""
    found = []
    for i in range(round(first * 100), round(last * 100)):
        t = i / 100
        found.append(frame(t, 101, i, 10 * i, 5 * i))
        if i % 2 == 0:
            found.append(frame(t + 0.001, 102, 5000 + i, 5200 + i))
            found.append(frame(t + 0.002, 103, 4000 + i, 24400 + i))
        if i % 5 == 0:
            found.append(frame(t + 0.003 + late, 100, i // 2, i // 2))
    return sorted(found)


def read_rows(made: Stream, frames: list[CanFrame]) -> tuple[np.ndarray, dict]:
    """Return the rows of all frames, asked for after each 0.1 s."""
    times, columns = [], {c: [] for c in made.list_columns()}
    done = 0
    for now in np.arange(frames[0].time, frames[-1].time + 0.1, 0.1):
        upto = next((i for i in range(done, len(frames)) if frames[i].time > now), len(frames))
        made.add(frames[done:upto])
        done = upto
        time, value = made.make_rows(float(now))
        times.append(time)
        for c in columns:
            columns[c].append(value[c])
    return np.concatenate(times), {c: np.concatenate(x) for c, x in columns.items()}


def test_rows_are_the_signals_at_the_rate_of_the_fastest_and_each_comes_once(database: Path) -> None:
    made = make(database)
    assert made.rate is None
    time, value = read_rows(made, make_frames(0.0, 2.0))
    assert made.rate == 100.0 and made.one_speed is False and made.unknown == {}
    np.testing.assert_allclose(np.diff(time), 0.01, atol=1e-9)
    assert time[0] == pytest.approx(0.01) and 1.85 < time[-1] < 1.99  # the steering angle begins at 3 ms
    wanted = {
        "steer_angle": 0.05 * (time - 0.003),
        "wheel_speed_front": 51.0 + time - 0.001,
        "wheel_speed_rear": 42.0 + time - 0.002,
        "accel_x": 0.5 * time,
        "accel_y": time,
        "yaw_rate": 0.1 * time,
    }
    assert list(value) == list(wanted)
    for name, x in wanted.items():
        np.testing.assert_allclose(value[name], x, atol=2e-3, err_msg=name)
    assert made.known == 200 + 100 + 100 + 40 and made.time == pytest.approx(1.99)
    made._receive(2.0)
    assert made.last["yaw_rate"] == pytest.approx(1.99) and made.last["steer_angle"] == pytest.approx(1.953)


def test_a_row_waits_for_the_slowest_channel_but_no_longer_than_its_step_and_a_half(database: Path) -> None:
    """At 20 Hz, 75 and 20 ms; a message that stops is not waited for after 0.3 s."""
    made = make(database)
    delay = []
    frames = make_frames(0.0, 3.0)
    frames = [f for f in frames if not (f.identifier == 100 and f.time > 1.5)]
    done = 0
    for now in np.arange(0.0, 2.2, 0.01):
        upto = next((i for i in range(done, len(frames)) if frames[i].time > now), len(frames))
        made.add(frames[done:upto])
        done = upto
        time, value = made.make_rows(float(now))
        if len(time) and now > 1.1:
            delay.append((now, now - time[-1], value["steer_angle"][-1]))
    before = [d for now, d, _ in delay if now < 1.45]
    assert max(before) <= 0.095 + 1e-6 and min(before) < 0.03
    gone = [d for now, d, _ in delay if 1.62 < now < 1.74]
    assert gone and min(gone) > 0.08  # it is waited for
    silent = [(d, x) for now, d, x in delay if now > 1.85]
    assert max(d for d, _ in silent) < 0.05 and all(math.isnan(x) for _, x in silent)


def test_a_latency_is_the_time_before_its_stamp(database: Path) -> None:
    made = make(database, steer_angle={"latency": 0.04}, yaw_rate={"sign": -1.0})
    time, value = read_rows(made, make_frames(0.0, 2.0, late=0.04))
    np.testing.assert_allclose(value["steer_angle"], 0.05 * (time - 0.003), atol=2e-3)
    np.testing.assert_allclose(value["yaw_rate"], -0.1 * time, atol=2e-3)
    made._receive(2.0)
    assert made.last["steer_angle"] == pytest.approx(1.993)  # of its stamp


def test_a_rate_that_is_given_is_that_of_the_rows(database: Path) -> None:
    made = make(database, rate=25.0)
    assert made.rate is None  # no row yet
    time, value = read_rows(made, make_frames(0.0, 2.0))
    assert made.rate == 25.0
    np.testing.assert_allclose(np.diff(time), 0.04, atol=1e-9)
    np.testing.assert_allclose(value["yaw_rate"], 0.1 * time, atol=2e-3)


@pytest.mark.parametrize(
    ("gone", "by"), [("wheel_speed_rear", 0.3 / 0.36), ("wheel_speed_front", 0.36 / 0.3)]
)
def test_the_other_axle_stands_in_for_one_that_is_not_on_the_bus(
    database: Path, gone: str, by: float
) -> None:
    """Wheel speed x radius is the same at both axles."""
    made = make(database, leave_out(gone))
    assert made.one_speed and made.notes[0].startswith(f"{gone} is not on the bus")
    _, value = read_rows(made, make_frames(0.0, 1.5))
    other = "wheel_speed_front" if gone.endswith("rear") else "wheel_speed_rear"
    np.testing.assert_allclose(value[gone], by * value[other])
    assert np.isnan(value["accel_x"]).all() and np.isfinite(value["accel_y"]).all()


def test_the_speed_of_the_car_stands_in_for_all_wheels(database: Path) -> None:
    names = leave_out("wheel_speed_front", "wheel_speed_rear") | {"vehicle_speed": ("vx",)}
    made = make(database, names)
    frames = [f for f in make_frames(0.0, 2.0) if f.identifier < 102]
    frames += [frame(i / 50, 104, 1500 + 2 * i, 0) for i in range(100)]
    time, value = read_rows(made, sorted(frames))
    np.testing.assert_allclose(value["wheel_speed_front"], (15.0 + time) / 0.3, atol=0.05)
    np.testing.assert_allclose(value["wheel_speed_rear"], (15.0 + time) / 0.36, atol=0.05)
    np.testing.assert_allclose(value["vehicle_speed"], 15.0 + time, atol=0.02)
    assert made.one_speed


@pytest.mark.parametrize("both", [True, False])
def test_one_signal_for_both_axles_is_one_speed(database: Path, both: bool) -> None:
    name = ("FRONT.left",) if both else ("REAR.left",)
    made = make(database, NAMES | {"wheel_speed_front": ("FRONT.left",), "wheel_speed_rear": name})
    assert made.one_speed is both and made.notes == []


def test_a_clock_that_is_set_back_goes_on_from_where_it_was(database: Path) -> None:
    made = make(database)
    assert made.add(make_frames(10.0, 11.0)) == []
    assert made.add([frame(10.6, 101, 0, 0, 0)]) == []  # 0.39 s: a late frame
    (text,) = made.add([frame(7.99, 101, 7, 0, 0), frame(8.09, 101, 8, 0, 0)])
    assert "set back by 3 s" in text
    assert made.time == pytest.approx(11.09)
    assert made.add([frame(8.19, 101, 9, 0, 0)]) == [] and made.time == pytest.approx(11.19)
    kept = made._kept["IMU.rate"]
    assert kept.time[-2:] == pytest.approx([11.09, 11.19]) and kept.value[-2:] == pytest.approx(
        [0.008, 0.009]
    )
    assert (np.diff(kept.time) > 0).all()


def test_frames_are_counted_by_whether_a_database_has_them(database: Path) -> None:
    made = make(database, leave_out("accel_x"))
    made.add([frame(0.0, 99, 1), frame(0.1, 99, 1), frame(0.2, 77, 1), frame(0.3, 104, 1, 2)])
    assert made.unknown == {99: 2, 77: 1} and made.known == 1
    assert math.isnan(made._first)  # message 104 is known, but nothing of it is needed
    made.add([frame(0.4, 100, 1, 1), frame(0.5, 101, 1, 1, 1)])
    assert made._first == 0.4 and made.known == 3


def test_rows_begin_after_a_second_and_without_a_channel_after_three(database: Path) -> None:
    for frames, begin in ((make_frames(5.0, 9.5), 6.0), (make_frames(5.0, 9.5)[:0], 8.0)):
        made = make(database)
        sent = frames or [f for f in make_frames(5.0, 9.5) if f.identifier != 103]
        first = None
        done = 0
        for now in np.arange(5.0, 9.5, 0.03):
            upto = next((i for i in range(done, len(sent)) if sent[i].time > now), len(sent))
            made.add(sent[done:upto])
            done = upto
            if len(made.make_rows(float(now))[0]):
                first = float(now)
                break
        assert first == pytest.approx(begin, abs=0.07)


def test_an_axle_goes_on_with_one_wheel(database: Path) -> None:
    frames = []
    for f in make_frames(0.0, 2.2):
        rows = round(100 * f.time)
        if f.identifier != 103:
            frames.append(f)
        elif f.time < 1.5:  # the track makes 20 rad/s per rad/s of yaw rate
            frames.append(frame(f.time, 103, 4000 - rows, 24000 + rows))
        else:
            frames.append(frame(f.time, 103, 4000 - rows))  # too short for the right wheel
    time, value = read_rows(make(database), frames)
    late = time > 1.55
    np.testing.assert_allclose(value["wheel_speed_rear"][late], 40.0, atol=0.02)
    assert late.sum() > 50


def test_values_out_of_range_are_missing(database: Path) -> None:
    made = make(database, NAMES | {"brake": ("vx",)})
    nothing = np.full(2, NAN)
    value = {
        "yaw_rate": np.array([6.1, -6.0]),
        "accel_y": np.array([3.0, 51.0]),
        "wheel_speed_front_left": np.array([40.0, 500.0]),
        "wheel_speed_front_right": np.array([44.0, 44.0]),
        "wheel_speed_rear": np.array([-401.0, 30.0]),
        "brake": np.array([1.0, 1.1]),
    }
    found = made._finish_columns(dict(value), 2)
    wanted = {
        "steer_angle": nothing,
        "wheel_speed_front": [42.0, NAN],
        "wheel_speed_rear": [NAN, 30.0],
        "accel_x": nothing,
        "accel_y": [3.0, NAN],
        "yaw_rate": [NAN, -6.0],
        "brake": [1.0, NAN],
    }
    assert list(found) == list(wanted)
    for name, x in wanted.items():
        np.testing.assert_array_equal(found[name], x, err_msg=name)


def test_the_other_wheel_follows_from_the_yaw_rate_with_the_factor_of_all_rows(database: Path) -> None:
    made = make(database)
    yaw = np.array([0.1, 0.2, -0.1, 0.3, NAN])
    left, right = 40.0 - 2.0 * yaw, 40.0 + 2.0 * yaw  # 4 rad/s per rad/s
    assert np.isnan(made._average_axle("wheel_speed_rear", left, np.full(5, NAN), yaw)).all()  # not known yet
    made._average_axle("wheel_speed_rear", left, right, yaw)
    first = made._average_axle("wheel_speed_rear", left, np.full(5, NAN), yaw)
    second = made._average_axle("wheel_speed_rear", np.full(5, NAN), right, yaw)
    for x in (first, second):
        np.testing.assert_allclose(x, [40, 40, 40, 40, NAN])
    np.testing.assert_allclose(made._average_axle("wheel_speed_rear", left, right + 1.0, yaw)[:4], 40.5)
    assert set(made._turns) == {"wheel_speed_rear"}


def test_a_velocity_is_in_the_nearest_row_once(database: Path) -> None:
    made = make(database, NAMES | {"ins_vel_x": ("vx",)}, rate=100.0)
    t, x = np.array([0.101, 0.147, 0.1549, 0.19]), np.array([1.0, 2.0, 3.0, 4.0])
    time = np.array([0.10, 0.11, 0.12, 0.13, 0.14, 0.15])
    np.testing.assert_array_equal(
        made._place_measurements("ins_vel_x", t, x, time), [1.0, NAN, NAN, NAN, NAN, 3.0]
    )
    later = made._place_measurements("ins_vel_x", t, x, np.array([0.16, 0.17, 0.18, 0.19]))
    np.testing.assert_array_equal(later, [NAN, NAN, NAN, 4.0])
    missed = made._place_measurements("ins_vel_x", np.array([0.192]), np.array([5.0]), np.array([0.2, 0.21]))
    np.testing.assert_array_equal(missed, [5.0, NAN])  # its row was given before it came
    assert made.list_columns()[-1] == "ins_vel_x"


def test_old_entries_are_deleted_only_while_enough_of_them_are_kept() -> None:
    made = stream._Signal(None, None, [i * 0.1 for i in range(129)], [float(i) for i in range(129)])
    made.trim()
    assert len(made.time) == len(made.value) == 65 and made.value[0] == 64.0
    few = stream._Signal(None, None, [float(i) for i in range(128)], [float(i) for i in range(128)])
    few.trim()
    assert len(few.time) == 128
    fast = stream._Signal(None, None, [i * 0.01 for i in range(300)], [float(i) for i in range(300)])
    fast.trim()
    assert len(fast.time) == 300  # the older half is of the last 2 s


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (leave_out("steer_angle"), "steer_angle is missing"),
        (leave_out("wheel_speed_front", "wheel_speed_rear"), "assigns no wheel speed"),
        (leave_out("accel_y", "yaw_rate"), "accel_y and yaw_rate are missing"),
        (NAMES | {"yaw_rate": ("ratte",)}, "there is no 'ratte' in car.dbc"),
        (
            NAMES | {"yaw_rate": ("left",)},
            "'left' is in the database 2 times: choose one: FRONT.left, REAR.left",
        ),
    ],
)
def test_a_stream_without_what_it_needs_is_refused(names: dict, message: str, database: Path) -> None:
    with pytest.raises(UserError, match=message):
        make(database, names)
    for gone in ("accel_y", "yaw_rate", "accel_x"):
        make(database, leave_out(gone))


def test_the_message_of_a_channel_is_found_also_by_one_of_its_wheels(database: Path) -> None:
    made = make(database)
    found = {c: made.find_message(c) for c in ("steer_angle", "wheel_speed_rear_right", "yaw_rate", "brake")}
    assert found == {"steer_angle": "STEER", "wheel_speed_rear_right": "REAR", "yaw_rate": "IMU", "brake": ""}


def test_all_signals_of_a_channel_get_their_whole_names() -> None:
    source = SignalSource(
        "steer_angle",
        ("a",),
        add="b",
        sign_bit="c",
        valid=Flag("d", (0.0,)),
        counter=Counter("e", 8),
        ratio=2.0,
    )
    assert stream._list_names(source) == ["a", "b", "c", "d", "e"]
    whole = stream._rename_sources(source, {n: f"M.{n}" for n in "abcde"})
    assert stream._list_names(whole) == ["M.a", "M.b", "M.c", "M.d", "M.e"]
    assert whole.valid == Flag("M.d", (0.0,)) and whole.counter == Counter("M.e", 8) and whole.ratio == 2.0
    plain = SignalSource("steer_angle", ("a",))
    assert stream._list_names(plain) == ["a"]
    assert stream._rename_sources(plain, {"a": "M.a"}) == SignalSource("steer_angle", ("M.a",))


def test_a_mean_rate_is_of_new_values_over_the_whole_time() -> None:
    held = np.repeat(np.sin(1.7 * np.arange(81)), 4)
    t = np.arange(324) * 0.005
    assert stream.find_mean_rate(Series("yaw_rate", t, held)) == pytest.approx(80 / t[-1])
    assert stream.find_mean_rate(Series("yaw_rate", t[:1], held[:1])) == 0.0


def test_the_ends_of_a_range_are_inside() -> None:
    x = np.array([-1.01, -1.0, 0.0, 2.0, 2.01, NAN])
    np.testing.assert_array_equal(stream._mask_outside(x, -1.0, 2.0), [NAN, -1, 0, 2, NAN, NAN])


def hear(made: Stream, now: float, **channels: tuple[float, float, float]) -> float:
    """Return the time up to which rows are complete.

    `channels`: name -> (time of the last entry, rate, latency)."""
    found = {n: Series(n, np.zeros(1), np.zeros(1), late) for n, (_, _, late) in channels.items()}
    own = {n: (np.array([0.0, last]), np.zeros(2)) for n, (last, _, _) in channels.items()}
    rates = {n: rate for n, (_, rate, _) in channels.items()}
    return made._find_row_limit(stream._Heard(now, found, own, rates, list(channels)))


def test_rows_are_complete_up_to_the_channel_that_is_furthest_behind(database: Path) -> None:
    made = make(database, rate=100.0)
    yaw, steer = (9.99, 100.0, 0.0), (9.95, 20.0, 0.0)
    assert hear(made, 10.0, yaw_rate=yaw, steer_angle=steer) == pytest.approx(9.95)
    # 10 s less 1.5 steps and 0.02 s; with a latency, that is earlier
    assert hear(made, 10.0, steer_angle=(9.8, 20.0, 0.0)) == pytest.approx(9.905)
    assert hear(made, 10.0, steer_angle=(9.8, 20.0, 0.05)) == pytest.approx(9.855)
    assert hear(made, 10.0, steer_angle=(9.69, 20.0, 0.0)) == -math.inf  # silent for 0.3 s
    assert hear(made, 10.0, steer_angle=(9.69, 20.0, 0.02)) == pytest.approx(9.885)
    assert hear(made, 10.0, yaw_rate=(9.74, 100.0, 0.0)) == -math.inf
    assert hear(made, 10.0, yaw_rate=(9.76, 100.0, 0.0)) == pytest.approx(9.965)
    assert hear(made, 10.0, yaw_rate=yaw, steer_angle=(9.69, 20.0, 0.0)) == pytest.approx(9.99)
    # two rows ahead of a channel that is low-passed
    assert hear(made, 10.0, yaw_rate=(9.999, 500.0, 0.0)) == pytest.approx(9.979)


def test_rows_begin_with_the_last_of_the_inputs(database: Path) -> None:
    starts = {100: 0.1, 101: 0.4, 102: 0.0, 103: 0.3}
    made = make(database)
    time, value = read_rows(made, [f for f in make_frames(0.0, 2.0) if f.time > starts[f.identifier]])
    assert time[0] == pytest.approx(0.31)  # on the beat of the IMU, which comes later
    assert (
        np.isnan(value["yaw_rate"][time < 0.405]).all() and np.isfinite(value["yaw_rate"][time > 0.415]).all()
    )


def test_no_row_is_later_than_the_limit(database: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = make(database)
    read_rows(made, make_frames(0.0, 1.5))
    made.add(make_frames(1.5, 2.0))
    monkeypatch.setattr(made, "_find_row_limit", lambda heard: 1.808)
    assert made.make_rows(2.0)[0][-1] == pytest.approx(1.80)
    assert len(made.make_rows(3.5)[0]) == 0


@pytest.mark.parametrize(
    ("names", "sources", "said"),
    [
        (NAMES, {}, ""),
        (NAMES | {"steer_angle": ("STEER.same",)}, {}, "steer_angle: the unit of 'STEER.same' is unknown"),
        (NAMES, {"yaw_rate": {"valid": Flag("STEER.angle", (9.0,))}}, ""),  # never valid
    ],
)
def test_units_that_are_missing_are_noted_and_flags_may_mark_all(
    names, sources, said, database: Path
) -> None:
    made = make(database, names, **sources)
    _, value = read_rows(made, make_frames(0.0, 1.5))
    assert [n.startswith(said) for n in made.notes] == ([True] if said else [])
    assert np.isnan(value["yaw_rate"]).all() == bool(sources)


def test_a_speed_of_the_car_changes_no_wheel_speed(database: Path) -> None:
    made = make(database, leave_out("wheel_speed_rear") | {"vehicle_speed": ("vx",)})
    frames = make_frames(0.0, 1.5) + [frame(i / 50, 104, 1500, 0) for i in range(75)]
    time, value = read_rows(made, sorted(frames))
    np.testing.assert_allclose(value["wheel_speed_front"], 51.0 + time, atol=0.01)


def listen(made: Stream, time: np.ndarray, **channels: tuple[np.ndarray, np.ndarray, bool]) -> dict:
    """Return channels at the times of rows. `channels`: name -> times, values, hold."""
    found = {n: Series(n, t, x, hold=held) for n, (t, x, held) in channels.items()}
    own = {n: (s.time, s.value) for n, s in found.items()}
    rates = {n: 1.0 / float(np.median(np.diff(s.time))) for n, s in found.items()}
    made._usual = {n: (r, True) for n, r in rates.items()}
    return made._resample(stream._Heard(float(time[-1]), found, own, rates, list(found)), time)


def test_channels_are_held_placed_low_passed_or_interpolated(database: Path) -> None:
    made = make(database, rate=20.0)
    slow, fast = np.arange(100) * 0.1, np.arange(1000) * 0.01
    time = np.arange(8.0, 9.81, 0.05) + 0.02
    steps = np.floor(slow + 0.05)
    found = listen(
        made,
        time,
        brake=(slow, steps % 2, False),
        steer_angle=(slow, steps, True),
        ins_vel_x=(slow, steps, False),
        yaw_rate=(fast, np.sin(fast) + 0.5 * np.sin(2 * np.pi * 25.0 * fast), False),
        accel_y=(slow, np.sin(slow), False),
        accel_x=(slow.copy(), np.cos(slow), False),
    )
    held = np.floor(time)
    np.testing.assert_array_equal(found["steer_angle"], held)
    np.testing.assert_array_equal(found["brake"], held % 2)
    assert np.isfinite(found["ins_vel_x"]).mean() == pytest.approx(0.55, abs=0.06)
    np.testing.assert_allclose(found["yaw_rate"], np.sin(time), atol=0.02)
    np.testing.assert_allclose(found["accel_y"], np.sin(time), atol=1e-4)
    np.testing.assert_allclose(found["accel_x"], np.cos(time), atol=1e-4)


def test_rows_after_the_last_entry_and_in_a_gap_are_missing(database: Path) -> None:
    made = make(database, rate=100.0)
    t = np.arange(200) * 0.02
    late = np.arange(3.9, 4.2, 0.01)
    found = listen(made, late, yaw_rate=(t, t, False), accel_y=(t, 2 * t, False))
    for name, by in (("yaw_rate", 1.0), ("accel_y", 2.0)):
        np.testing.assert_allclose(found[name][late < 3.98], by * late[late < 3.98])
        assert np.isnan(found[name][late > 3.995]).all()
    gap = np.where(t > 3.5, t + 1.0, t)
    rows = np.arange(3.4, 4.9, 0.01)
    found = listen(made, rows, yaw_rate=(gap, gap, False))
    assert np.isnan(found["yaw_rate"][(rows > 3.52) & (rows < 4.5)]).all()
    np.testing.assert_allclose(found["yaw_rate"][rows > 4.53], rows[rows > 4.53])


@pytest.mark.parametrize(
    ("steer", "wheel", "source", "may"),
    [
        (10.0, 10.0, {}, True),  # all have an entry at the row that is due
        (9.98, 10.0, {}, False),
        (10.0, 9.98, {}, False),  # the right wheel in front
        (9.9, 10.0, {}, True),  # waited for until 10.095 s, which has passed
        (9.97, 10.0, {"latency": 0.05}, False),
        (10.04, 10.0, {"clock": 0.05}, False),  # at 9.99 s of the common clock
        (10.06, 10.0, {"clock": 0.05}, True),
    ],
)
def test_rows_may_be_complete_if_no_channel_is_worth_waiting_for(steer, wheel, source, may, database) -> None:
    made = make(database, rate=100.0, steer_angle=source)
    for n, kept in made._kept.items():
        kept.time = [9.0, {"STEER.angle": steer, "FRONT.right": wheel}.get(n, 10.0)]
    names = [c for c in NAMES if "wheel" not in c]
    names += [f"wheel_speed_{a}_{s}" for a in ("front", "rear") for s in ("left", "right")]
    made._usual = dict.fromkeys(names, (20.0, True))
    now = 10.1 if steer == 9.9 else 10.05
    assert not made._may_have_rows(now) or math.isnan(
        made._start
    )  # before the start, the exact check is made
    made._start, made._looked = 10.0, 10.0
    assert made._may_have_rows(now) is may
    assert made._may_have_rows(11.01) is True  # once per s, the exact check is made
    made._usual = dict.fromkeys(names, (200.0, True))
    made._looked = 10.3
    made._sent = 30
    assert made._may_have_rows(10.32) is True  # all have been silent for 0.25 s


def test_a_clock_that_is_set_back_twice_goes_on_each_time(database: Path) -> None:
    made = make(database)
    said = [made.add([frame(t, 101, i, 0, 0)]) for i, t in enumerate((10.0, 11.0, 5.0, 6.0, 1.0, 1.5))]
    assert [len(x) for x in said] == [0, 0, 1, 0, 1, 0] and "by 5 s" in said[4][0]
    assert made._kept["IMU.rate"].time == pytest.approx([10.0, 11.0, 12.0, 12.5])
    assert made.time == pytest.approx(12.5)


def test_a_value_has_the_time_of_its_own_frame_also_if_frames_before_are_too_short(database: Path) -> None:
    made = make(database)
    made.add([frame(0.0, 103, 4000), frame(0.1, 103, 4100, 24400), frame(0.2, 103, 4200)])
    right, left = made._kept["REAR.right"], made._kept["REAR.left"]
    assert (right.time, right.value) == ([0.1], [44.0])
    assert left.time == [0.0, 0.1, 0.2] and left.value == pytest.approx([40.0, 41.0, 42.0])


def test_values_that_the_database_calls_not_available_are_missing_and_not_the_last(tmp_path: Path) -> None:
    path = tmp_path / "codes.dbc"
    path.write_text(DBC + 'VAL_ 101 rate 32767 "not available" ;\n', encoding="ascii")
    made = make(path)
    made.add([frame(0.0, 101, 100, 1, 2), frame(0.1, 101, 32767, 1, 2), frame(0.2, 101, 32767, 1, 2)])
    np.testing.assert_allclose(made._kept["IMU.rate"].value, [0.1, NAN, NAN])
    made._receive(0.2)
    assert made.last["yaw_rate"] == 0.0 and made.last["accel_y"] == 0.2


def test_of_many_new_rows_the_last_ones_are_given_and_none_twice(
    database: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stream, "MAX_NEW_ROWS", 50)
    made = make(database)
    made.add(make_frames(0.0, 2.0))
    first, _ = made.make_rows(2.0)
    assert len(first) == 50 and made._sent == round((first[-1] - made._start) * 100) + 1
    made.add(make_frames(2.0, 2.3))
    second, value = made.make_rows(2.3)
    np.testing.assert_allclose(np.diff([*first, *second]), 0.01, atol=1e-9)
    np.testing.assert_allclose(value["yaw_rate"], 0.1 * second, atol=2e-3)


def test_between_two_checks_missing_values_are_left_out_and_bursts_are_joined(database: Path) -> None:
    made = make(database)
    made._usual["yaw_rate"] = (100.0, True)
    t = np.arange(40) * 0.01
    x = np.where(np.arange(40) == 7, NAN, np.sin(t))
    time, value = made._select_entries("yaw_rate", Series("yaw_rate", t, x), False)
    np.testing.assert_array_equal(time, np.delete(t, 7))
    np.testing.assert_array_equal(value, np.delete(x, 7))
    burst = np.insert(t, 20, 0.191)
    time, _ = made._select_entries("yaw_rate", Series("yaw_rate", burst, np.sin(burst)), False)
    assert len(time) == 40 and time[19] == pytest.approx(0.1905)


def test_the_speed_of_the_car_has_its_latency_also_as_a_wheel_speed(database: Path) -> None:
    names = leave_out("wheel_speed_front", "wheel_speed_rear") | {"vehicle_speed": ("vx",)}
    made = make(database, names, vehicle_speed={"latency": 0.05})
    made.add([frame(1.0, 104, 1500, 0), frame(1.1, 104, 1530, 0)])
    front = made._build_series()["wheel_speed_front"]
    assert front.latency == 0.05 and front.time == pytest.approx([0.95, 1.05])
    assert front.value == pytest.approx([50.0, 51.0])


def test_a_name_is_whole_and_one_wheel_of_an_axle_is_no_axle(database: Path) -> None:
    with pytest.raises(UserError, match=r"there is no 'ate' in car\.dbc"):
        make(database, NAMES | {"yaw_rate": ("ate",)})
    made = make(database, leave_out("wheel_speed_front") | {"wheel_speed_front_left": ("FRONT.left",)})
    assert made.one_speed and made.notes[0].startswith("wheel_speed_front is not on the bus")
