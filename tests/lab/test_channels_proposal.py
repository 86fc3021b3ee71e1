"""What proposes signals.toml, function by function: names, companions of a signal, units,
signs, ratios, latencies, and the text of the proposal."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tse.channels import candidates, guesses, physics, scales, velocities, vocabulary, wheels
from tse.channels import look as look_module
from tse.channels import proposal as proposal_module
from tse.channels.look import Guess, Look, Proposal
from tse.channels.scales import UnitScale
from tse.library.files import parse_toml
from tse.readers.recording import RECEIVER_TEXT, Channel, ReadOptions, Recording

STEP = 1.0 / physics.COMPARISON_RATE
T = np.arange(0.0, 60.0, STEP)
V = 20.0 + 4.0 * np.sin(0.4 * T)
YAW = 0.15 * np.sin(0.7 * T)
NAN = np.nan
G = 9.80665


def make_look(units: dict[str, str] | None = None, rates: dict | None = None, **x: np.ndarray) -> Look:
    """Return a Look whose signals are on its raster as they are given."""
    look = object.__new__(Look)
    look.time, look.x, look.fine = T, dict(x), dict(x)
    look.raw = {n: (T, values) for n, values in x.items()}
    look.rate = {n: (rates or {}).get(n, 50.0) for n in x}
    look.channels = {n: Channel(n, T, values, (units or {}).get(n, "")) for n, values in x.items()}
    look._called, look._unit, look.sign_bit = {}, {}, {}
    return look


def record(**channels: tuple | np.ndarray) -> Recording:
    """Return a recording. Its channels: values, or values and unit; __ is a dot."""
    found = {}
    for name, given in channels.items():
        value, unit = given if isinstance(given, tuple) else (given, "")
        whole = name.replace("__", ".")
        found[whole] = Channel(whole, np.arange(len(value)) * 0.02, np.asarray(value, float), unit)
    return Recording(Path("log.csv"), "CSV", found)


def make_scale(figures: dict[str, float] | None = None, **unit: str) -> UnitScale:
    units = {"wheel": "m/s", "yaw_rate": "rad/s", "accel_y": "m/s2", "accel_x": "m/s2"} | unit
    per = {role: scales._convert_unit(role, u, None) for role, u in units.items()}
    return UnitScale(units, per, {} if figures is None else figures)


WHEELS = {
    "front_left": "wheel_fl",
    "front_right": "wheel_fr",
    "rear_left": "wheel_rl",
    "rear_right": "wheel_rr",
}


def make_wheels(v: np.ndarray = V, yaw: np.ndarray = YAW, track: float = 1.5) -> dict[str, np.ndarray]:
    half = 0.5 * track * yaw
    return {"wheel_fl": v - half, "wheel_fr": v + half, "wheel_rl": v - half, "wheel_rr": v + half}


# ---- Names


@pytest.mark.parametrize(
    ("role", "name", "low", "high"),
    [
        ("yaw_rate", "YawRate", 3.0, 3.0),
        ("yaw_rate", "IMU.YawRate", 3.0, 3.0),
        ("yaw_rate", "Status.YawRate", 3.0, 3.0),  # only its message is a status
        ("yaw_rate", "YawRate.value", 2.8, 2.8),  # only the message names it
        ("yaw_rate", "gyro_z", 2.5, 2.5),
        ("yaw_rate", "yaw", 1.2, 1.2),
        ("yaw_rate", "YawRateOffset", -1.0, -1.0),
        ("yaw_rate", "speed", 0.0, 0.0),
        ("accel_y", "LatAccel", 3.0, 3.0),
        ("accel_x", "LatAccel", 0.0, 0.0),
        ("accel_x", "LongAcc_Target", -1.0, -1.0),
        ("steer_angle", "steering", 1.5, 1.5),
        ("steer_angle", "SteeringWheelSpeed", -4.0, -0.5),
    ],
)
def test_a_name_has_the_score_of_its_words(role: str, name: str, low: float, high: float) -> None:
    assert low - 1e-9 <= vocabulary.score_name(role, name) <= high + 1e-9


@pytest.mark.parametrize(
    ("role", "name", "is_other"),
    [
        ("yaw_rate", "Gear", True),
        ("yaw_rate", "speed", True),
        ("speed", "speed", False),
        ("speed", "rpm", True),
        ("speed", "knots", False),
        ("accel_x", "knots", True),
        ("yaw_rate", "YawRate", False),
        ("steer_angle", "signal_17", False),
    ],
)
def test_another_quantity_is_named_by_its_word(role: str, name: str, is_other: bool) -> None:
    assert vocabulary.is_another_thing(role, name) is is_other


@pytest.mark.parametrize(
    ("name", "place", "score"),
    [
        ("WheelSpeed_FL", "front_left", 3.0),
        ("WheelSpeed.RR", "rear_right", 3.0),
        ("fl", "front_left", 1.0),
        ("FLwhlspd", "front_left", 2.7),
        ("Axle_Speed_Front", "front", 3.0),
        ("front", "", 0.0),
        ("BrakePressure_FL", "", 0.0),
        ("vehicle_speed", "", 0.0),
    ],
)
def test_the_wheel_of_a_name_and_its_score(name: str, place: str, score: float) -> None:
    found = vocabulary.find_place(name)
    assert (found if found[1] else ("", 0.0)) == (place, pytest.approx(score))


# ---- Flags, codes, counters, fine parts


def test_the_value_of_a_flag_that_means_valid_is_the_usual_one_or_the_one_not_called_bad() -> None:
    def find(values: list[float], name: str = "valid", states: dict | None = None) -> float | None:
        return look_module._find_valid_value(Channel(name, T, np.array(values, float), "", "", states or {}))

    assert find([3] * 9 + [0]) == 3.0
    assert find([3] * 8 + [0] * 2) is None  # 80 %
    assert find([3] * 10) is None
    assert find([0.5] * 9 + [1]) is None
    assert find([3] * 9 + [0], "speed") is None
    assert find([*range(9)] + [0] * 100) is None  # nine values
    assert find([*range(8)] + [0] * 100) == 0.0
    assert find([0] * 2 + [1] * 8, states={0.0: "Valid", 1.0: "Invalid"}) == 0.0  # also if it is rare
    assert find([0, 1, 2], states={0.0: "ok", 1.0: "good", 2.0: "error"}) is None
    assert find([0] * 9 + [1], states={0.0: "on", 1.0: "off"}) == 0.0  # no bad state is named


def test_a_code_for_no_value_is_rare_and_far_above_the_rest() -> None:
    x = np.sin(np.arange(100.0))
    for top, rows, is_code in (
        (2.0, 2, True),
        (1.4, 2, False),
        (2.0, 1, False),
        (-2.0, 3, True),
        (2.0, 11, False),
    ):
        y = x.copy()
        y[:rows] = top
        y[50] = NAN
        assert look_module.mark_no_value(y).sum() == (rows if is_code else 0), (top, rows)
    assert (
        not look_module.mark_no_value(np.zeros(20)).any() and not look_module.mark_no_value(np.zeros(0)).any()
    )


def test_a_flag_is_that_with_the_most_similar_name_or_that_of_the_whole_message() -> None:
    good = np.where(np.arange(100) < 95, 1.0, 0.0)
    x = np.sin(np.arange(100.0))
    recording = record(
        M__yawrate=x, M__lateral=x, M__yawrate_valid=good, M__lateral_valid=good, N__lateral_valid=good
    )
    flags = look_module.find_flags(recording)
    assert {k: len(v) for k, v in flags.items()} == {("M", 100): 2, ("N", 100): 1}
    find = look_module.find_flag
    assert find(recording, recording.channels["M.yawrate"], flags) == ("M.yawrate_valid", 1.0)
    assert find(recording, recording.channels["M.lateral"], flags) == ("M.lateral_valid", 1.0)
    # the flag of the lateral acceleration is not that of the yaw rate
    assert find(recording, recording.channels["M.yawrate"], flags, {"M.yawrate_valid"}) is None
    whole = record(M__abcdef=x, M__ghijkl=x, M__Qualifier=good, N__mnopqr=x)
    flags = look_module.find_flags(whole)
    assert find(whole, whole.channels["M.abcdef"], flags) == ("M.Qualifier", 1.0)
    assert find(whole, whole.channels["N.mnopqr"], flags) is None
    two = record(M__abcdef=x, M__Qualifier=good, M__qbit=good)
    assert find(two, two.channels["M.abcdef"], look_module.find_flags(two)) is None
    table = record(abcdef=x, Qualifier=good)  # columns of a table are no message
    assert find(table, table.channels["abcdef"], look_module.find_flags(table)) is None


def test_a_counter_counts_and_is_named_so() -> None:
    count = np.arange(100) % 16
    for name, x, modulo in (
        ("bz", count, 16),
        ("MsgCounter", np.arange(100) % 15, 15),
        ("speed", count, 0),
        ("bz", count[:49], 0),
        ("bz", count + 0.5, 0),
        ("bz", count - 1, 0),
    ):
        assert look_module._count_modulo(Channel(name, T[: len(x)], np.asarray(x, float))) == modulo, name


def test_a_step_is_that_of_all_values() -> None:
    assert look_module._find_step(np.array([0, 0.5, 2.0, 1.0, NAN, -1.5])) == pytest.approx(0.5)
    assert look_module._find_step(np.array([0, 0.5, 1.7])) == 0.0
    assert look_module._find_step(np.array([0, 1.0, 0])) == 0.0
    assert (
        look_module._find_step(np.arange(2001.0)) == 0.0 and look_module._find_step(np.arange(2000.0)) == 1.0
    )


@pytest.mark.parametrize(
    ("name", "fine", "found"),
    [
        ("angle_frac", 1.0, True),
        ("other", 1.0, False),
        ("angle_frac", -1.0, False),  # rougher than before
        ("angle_frac", 0.0, False),
    ],
)
def test_the_fine_part_makes_a_coarse_angle_smooth(name: str, fine: float, found: bool) -> None:
    angle = 30.0 * np.sin(np.arange(400) * 0.03)
    coarse = np.floor(angle)
    mine = Channel("M.angle", T[:400], coarse)
    guess = Guess("steer_angle", ("M.angle",), "deg", "")
    look_module._add_fine_part(guess, mine, [Channel(f"M.{name}", T[:400], fine * (angle - coarse))])
    assert guess.add == (f"M.{name}" if found else None)
    assert guess.figures[0].startswith("sent in steps of 1 deg")
    small = Guess("steer_angle", ("M.angle",), "deg", "")
    look_module._add_fine_part(small, Channel("M.angle", T[:400], np.round(angle, 1)), [])
    assert small.figures == []  # steps of 0.1 are not coarse


def test_companions_are_of_the_message_of_the_signal() -> None:
    n = 200
    x, good = np.sin(0.3 * np.arange(n)), np.where(np.arange(n) < 195, 0.0, 3.0)
    coded = x.copy()
    coded[-4:] = 30.0
    recording = record(
        M__yaw=x, M__Qualifier=good, M__bz=np.arange(n) % 16, N__bz=np.arange(n) % 8, N__lat=coded
    )
    found = [Guess("yaw_rate", ("M.yaw",), "", ""), Guess("accel_y", ("N.lat",), "", "")]
    look_module.find_companions(recording, found)
    assert found[0].valid == ("M.Qualifier", 0.0) and found[0].counter == ("M.bz", 16)
    assert found[1].valid is None and found[1].counter == ("N.bz", 8)
    assert found[1].unsure == ["a code for a missing value"]
    assert found[1].figures[0].startswith("30 seems to be a code")


def test_of_two_counters_none_is_that_of_the_message() -> None:
    recording = record(M__yaw=np.sin(np.arange(200)), M__bz=np.arange(200) % 16, M__count=np.arange(200) % 8)
    guess = Guess("yaw_rate", ("M.yaw",), "", "")
    look_module.find_companions(recording, [guess])
    assert guess.counter is None


def test_tick_counters_are_two_or_more_that_only_count_up() -> None:
    ticks = np.cumsum(np.arange(100) % 3)
    warn = look_module.warn_of_counting_wheels
    (text,) = warn(record(ticks_fl=ticks, ticks_fr=ticks, ticks_back=ticks[::-1]))
    assert text.startswith("ticks_fl, ticks_fr count up")
    assert warn(record(ticks_fl=ticks, other=ticks)) == []
    assert warn(record(ticks_fl=ticks[:50], ticks_fr=ticks[:50])) == []
    falls = np.cumsum(np.where(np.arange(100) % 10 == 0, -1, 2))
    assert warn(record(ticks_fl=falls, ticks_fr=falls)) == []
    assert warn(record(ticks_fl=np.arange(100) % 10, ticks_fr=np.arange(100) % 10)) == []


def test_a_sign_bit_changes_at_zero_and_is_set_at_large_values() -> None:
    t = np.arange(2000) * 0.01
    x = np.sin(t)
    bit = np.where(x < 0, 1.0, 0.0)

    def find(flag: np.ndarray, name: str = "angle_sign", value: np.ndarray | None = None) -> str | None:
        value = np.abs(x) if value is None else value
        return look_module._find_sign_bit("angle", t, value, {name: (f"M.{name}", t, flag)})

    assert find(bit) == "M.angle_sign"
    assert find(1.0 - bit) == "M.angle_sign"
    signed = np.abs(x)
    signed[300] = -0.2
    assert find(bit, value=signed) is None  # it has its sign
    both = {n: (n, t, bit) for n in ("angle_sgn", "angle_s", "angle_sg")}
    assert look_module._find_sign_bit("angle", t, np.abs(x), both) == "angle_s"
    assert find(bit, "quite_another_thing") is None
    assert find(2.0 * bit) is None
    assert find(np.roll(bit, 150)) is None  # it changes at large values
    assert find(np.where(np.abs(x) < 0.05, 1.0, 0.0)) is None  # standstill
    assert find(np.where(t < 9.0, bit, 0.0)) is None  # two changes


def test_a_bit_has_its_value_from_its_own_time_on() -> None:
    own, value = np.array([1.0, 2.0]), np.array([5.0, 6.0])
    found = look_module._hold_last(np.array([0.5, 1.0, 1.9, 2.0, 3.0]), own, value)
    assert found.tolist() == [5, 5, 5, 6, 6]


def test_values_that_a_flag_or_a_code_calls_invalid_are_missing() -> None:
    n = 500
    x = np.sin(0.1 * np.arange(n))
    flag, coded = np.where(np.arange(n) < 480, 1.0, 0.0), x.copy()
    coded[100:103] = 99.0
    recording = record(M__yaw=x, M__yaw_valid=flag, N__lat=coded)
    flags = look_module.find_flags(recording)
    found = look_module._mask_invalid(recording, recording.channels["M.yaw"], 490, flags)
    assert np.flatnonzero(np.isnan(found)).tolist() == list(range(480, 490)) and found[7] == x[7]
    found = look_module._mask_invalid(recording, recording.channels["N.lat"], n, flags)
    assert np.flatnonzero(np.isnan(found)).tolist() == [100, 101, 102]


def test_a_look_has_the_signals_with_their_sign_in_si_times() -> None:
    t = np.arange(0.0, 30.0, 0.01)
    x = np.sin(t)
    channels = {
        "angle": Channel("angle", t, np.abs(x), "deg"),
        "angle_sign": Channel("angle_sign", t, np.where(x < 0, 1.0, 0.0)),
        "slow": Channel("slow", t, np.repeat(np.sin(1.7 * np.arange(300)), 10), "km^h"),
        "still": Channel("still", t, np.ones(len(t))),
        "v_kmh": Channel("v_kmh", t, 50.0 + x),
        "EPS_Status": Channel("EPS_Status", t, 3.0 * x),
    }
    look = Look(Recording(Path("x"), "MF4", channels))
    assert set(look.x) == {"angle", "slow", "v_kmh", "EPS_Status"} and look.sign_bit == {
        "angle": "angle_sign"
    }
    np.testing.assert_allclose(look.fine["angle"][5:-5], np.sin(look.time)[5:-5], atol=0.01)
    assert np.diff(look.time) == pytest.approx(0.05)
    assert look.rate["slow"] == pytest.approx(10.0) and look.rate["angle"] == pytest.approx(100.0)
    assert look.find_unit("angle") == "deg" and look.find_unit("v_kmh") == "km/h"
    assert look.find_unit("slow") == ""  # its unit is unknown
    assert look.clean_name("EPS_Status") == "EPS"  # it has too many values for a status
    empty = Look(Recording(Path("x"), "MF4", {"still": channels["still"]}))
    assert empty.x == {} and len(empty.time) == 0


# ---- Wheels and motion


def test_a_speed_is_rarely_negative_and_not_constant() -> None:
    assert wheels.is_rolling(V)
    for share, is_speed in ((0.04, True), (0.06, False)):
        x = np.where(np.arange(1000) < 1000 * share, -1.0, 20.0)
        assert wheels.is_rolling(x) is is_speed
    assert wheels.is_rolling(np.where(np.arange(1000) < 500, -0.3, 20.0))  # noise at standstill
    assert not wheels.is_rolling(np.full(100, 20.0)) and not wheels.is_rolling(V[:10])


def test_wheels_are_those_of_the_fullest_set() -> None:
    units = dict.fromkeys(("wheel_fl", "wheel_fr", "wheel_rl", "wheel_rr", "old_v_fl", "old_v_fr"), "km/h")
    more = {"old_v_fl": V + 1, "old_v_fr": V + 2, "brake_press_fl": V}
    look = make_look(units, **make_wheels(), **more)
    assert wheels.find_wheels(look) == WHEELS
    one = {n: x for n, x in make_wheels().items() if n != "wheel_fr"}
    assert wheels.find_wheels(make_look(units, **one)) == {
        "rear_left": "wheel_rl",
        "rear_right": "wheel_rr",
    }  # one wheel in front is not used
    axles = make_look(None, wheel_speed_front=V, wheel_speed_rear=V + 0.1 * YAW)
    assert wheels.find_wheels(axles) == {"front": "wheel_speed_front", "rear": "wheel_speed_rear"}
    assert wheels.find_wheels(make_look(None, yaw=YAW)) == {}


def test_four_signals_of_one_size_are_wheels_without_names() -> None:
    x = {f"s{i}": w for i, w in enumerate(make_wheels(track=1.5 + 0.0).values())}
    x["s2"], x["s3"] = x["s2"] * 1.01, x["s3"] * 1.01
    look = make_look(None, **x, big=3.0 * V, turn=YAW)
    assert wheels._find_nameless_wheels(look) == {
        "front_left": "s0",
        "front_right": "s1",
        "rear_left": "s2",
        "rear_right": "s3",
    }
    assert wheels._find_nameless_wheels(make_look(None, **x, fifth=V * 1.02)) == {}
    same = x | {"s3": x["s2"]}
    assert wheels._find_nameless_wheels(make_look(None, **same)) == {}


@pytest.mark.parametrize(
    ("b", "is_same"),
    [(1.04 * V, True), (1.06 * V, False), (V + 2.0 * np.sin(3 * T), False), (np.where(T < 5, V, NAN), False)],
)
def test_signals_have_one_size_if_their_ratio_is_near_one_and_constant(b: np.ndarray, is_same: bool) -> None:
    assert wheels._is_same_size(V, b) is is_same


def test_the_turn_is_right_less_left_of_the_rear_axle() -> None:
    x = make_wheels()
    x["wheel_rl"] = x["wheel_rl"] - 0.1
    look = make_look(None, **x)
    np.testing.assert_allclose(wheels.find_turn(look, WHEELS), 1.5 * YAW + 0.1)
    front = {p: n for p, n in WHEELS.items() if p.startswith("front")}
    np.testing.assert_allclose(wheels.find_turn(look, front), 1.5 * YAW)
    assert wheels.find_turn(look, {"rear": "wheel_rl"}) is None
    np.testing.assert_allclose(wheels.compute_speed(look, front), V)
    assert wheels.compute_speed(make_look(None, YawRate=YAW), {}) is None


def test_the_slower_wheels_in_left_turns_are_the_left_ones() -> None:
    right, left = V + 0.75 * YAW, V - 0.75 * YAW
    look = make_look(None, a=right, b=left, c=left * 1.001, d=right * 1.001, r=YAW)
    guessed = dict(zip(WHEELS, "abcd", strict=True))
    found = wheels.find_sides(look, guessed, {"yaw_rate": "r"})
    assert found == {"front_left": "b", "front_right": "a", "rear_left": "c", "rear_right": "d"}
    assert wheels.find_sides(look, guessed, {}) == guessed
    named = make_look(None, **make_wheels(yaw=-YAW), r=YAW)
    assert wheels.find_sides(named, WHEELS, {"yaw_rate": "r"}) == WHEELS  # their names state it


def test_the_speed_of_the_car_is_the_best_name_that_is_fast_enough() -> None:
    units = {"Vehicle_Speed": "km/h", "GPS_Speed": "km/h"}
    look = make_look(units, {"GPS_Speed": 1.0}, Vehicle_Speed=V, GPS_Speed=V, v=V, rate=YAW)
    assert wheels.find_named_speed(look) == "Vehicle_Speed"
    only = make_look(units, {"GPS_Speed": 1.0}, GPS_Speed=V, rate=YAW)
    assert wheels.find_named_speed(only) == "GPS_Speed" and wheels.find_speed(only) == {}
    assert wheels.find_speed(look) == {"rear": "Vehicle_Speed"}
    assert wheels.is_car_speed({"rear": "x"}) and not wheels.is_car_speed(WHEELS)
    assert wheels.find_named_speed(make_look(None, Vehicle_Speed=YAW, accel=V)) == ""


def test_quaternions_are_four_names_with_x_y_z_w() -> None:
    parts = {f"q_{c}": np.sin(T + i) for i, c in enumerate("xyzw")}
    look = make_look(None, **parts, gyro_x=YAW, gyro_z=YAW)
    assert wheels.find_quaternions(look) == set(parts)


def test_roles_go_to_the_signals_that_agree_also_with_bare_names() -> None:
    rng = np.random.default_rng(1)
    x = make_wheels() | {
        "s1": YAW + 0.001 * rng.standard_normal(len(T)),
        "s2": V * YAW + 0.02 * rng.standard_normal(len(T)),
        "s3": physics.differentiate(V) + 0.02 * rng.standard_normal(len(T)),
        "s4": 40.0 * YAW / V * (1 + 0.002 * V**2),
        "s5": rng.standard_normal(len(T)),
    }
    units = {"s1": "rad/s", "s2": "m/s2", "s3": "m/s2", "s4": "deg", "s5": "m/s2"}
    found, worth = wheels.find_roles(make_look(units, **x), WHEELS, V, {})
    assert found == {"yaw_rate": "s1", "accel_y": "s2", "accel_x": "s3", "steer_angle": "s4"}
    assert all(w["shown"] > 2.5 and w["said"] == pytest.approx(1.05) for w in worth.values())
    named = x | {"YawRate": rng.standard_normal(len(T))}
    found, _ = wheels.find_roles(make_look(units, **named), WHEELS, V, {})
    assert found["yaw_rate"] == "s1"  # what it does counts more than its name
    alone, worth = wheels.find_roles(make_look(None, YawRate=YAW), {}, None, {})
    assert alone == {"yaw_rate": "YawRate"} and worth["yaw_rate"]["shown"] == 0.0


def test_the_score_by_physics_is_the_correlation_with_what_the_other_channels_predict() -> None:
    v = 15.0 + 14.0 * np.sin(0.21 * T)
    yaw = 0.2 * np.sin(0.7 * T)
    look = make_look(
        None, r=yaw, ay=v * yaw, ax=-physics.differentiate(v), steer=-40 * yaw / np.maximum(v, 3)
    )
    ref = {"yaw_rate": "r", "accel_y": "ay"}

    def score(role: str, name: str, turn: np.ndarray | None = None) -> float:
        return wheels._score_by_physics(look, role, name, v, v, physics.differentiate(v), turn, ref)

    assert score("yaw_rate", "r") == pytest.approx(4.0) and score("accel_y", "ay") == pytest.approx(4.0)
    assert score("accel_x", "ax") == pytest.approx(4.0) and score("steer_angle", "steer") > 3.9
    wrong = np.corrcoef(v * yaw, yaw)[0, 1]  # the yaw rate is taken for the lateral acceleration
    assert score("accel_x", "r") == -4.0
    ref.clear()
    assert score("accel_y", "r", yaw) == pytest.approx(np.clip(16 * (wrong - 0.75), -4, 4))
    assert score("accel_y", "ay", -2.0 * yaw) == pytest.approx(4.0) and score("yaw_rate", "r", -yaw) == 4.0
    assert score("yaw_rate", "r") == 0.0  # nothing to compare with


@pytest.mark.parametrize(("on", "is_brake"), [(True, True), (False, False)])
def test_a_brake_slows_the_car(on: bool, is_brake: bool) -> None:
    rate = physics.differentiate(V)
    press = np.where((rate < -0.8) == on, 20.0, 0.0)
    channel = Channel("BrakePressure", T, press, "bar")
    guess = wheels._guess_brake(channel, make_look(None, x=V), V)
    assert (guess is not None) is is_brake
    if guess:
        assert guess.above == pytest.approx(0.6) and guess.unit == "bar" and guess.confidence == "sure"
    switch = wheels._guess_brake(Channel("BrakeLight", T, press / 20.0), make_look(None, x=V), V)
    assert (switch is not None) is is_brake
    assert switch is None or (switch.above is None and switch.unit == "1")
    unknown = wheels._guess_brake(channel, make_look(None, x=V), None)
    assert unknown is not None and unknown.unsure and unknown.confidence == "unsure"
    for name in ("ParkBrake", "speed", "BrakeTorque"):
        assert wheels._guess_brake(Channel(name, T, press, "bar"), make_look(None, x=V), V) is None


def test_the_torque_of_an_axle_has_its_name_and_unit() -> None:
    x = 100.0 * np.sin(T)
    recording = record(
        WheelTorque_Front_Left=(x, "Nm"),
        WheelTorque_Front=(x, "Nm"),
        WheelTorque_Rear=(x, "km/h"),
        Torque=(x, "Nm"),
    )
    front = wheels._guess_torque(recording, "front")
    assert (
        front is not None and front.name == ("WheelTorque_Front",) and front.channel == "wheel_torque_front"
    )
    assert wheels._guess_torque(recording, "rear") is None


# ---- Units


def test_slopes_are_those_of_the_signals_as_logged() -> None:
    x = {n: 3.6 * w for n, w in make_wheels().items()}
    x |= {"r": -np.degrees(YAW), "ay": V * YAW / G, "ax": -physics.differentiate(V) / G, "GPS_Speed": V}
    look = make_look({"GPS_Speed": "m/s"}, **x)
    chosen = {"yaw_rate": "r", "accel_y": "ay", "accel_x": "ax"}
    v = 3.6 * V
    found = scales.measure_slopes(look, WHEELS, chosen, v)
    deg = 180 / np.pi
    assert found["accel_y"] == pytest.approx(1 / (3.6 * deg * G)) and found["accel_y_corr"] == pytest.approx(
        -1
    )
    assert found["track"] == pytest.approx(3.6 * 1.5 / deg) and found["track_corr"] == pytest.approx(-1)
    assert found["accel_x"] == pytest.approx(1 / (3.6 * G)) and found["accel_x_corr"] == pytest.approx(-1)
    assert found["speed"] == pytest.approx(1 / 3.6) and found["course_corr"] == 0.0
    assert found["top"] == pytest.approx(np.quantile(v, 0.99))
    assert scales.measure_slopes(look, WHEELS, chosen, None) == {}


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_course_of_a_receiver_is_clockwise(sign: float) -> None:
    course = np.degrees(np.mod(-sign * np.cumsum(YAW) * STEP, 2 * np.pi))
    look = make_look({"heading": "deg"}, heading=course, r=YAW)
    look.channels["heading"] = Channel("heading", T, course, "deg", RECEIVER_TEXT)
    assert scales._correlate_course(look, YAW, V) * sign > 0.9
    in_rad = make_look({"GPS_Heading": "rad"}, GPS_Heading=np.radians(course))
    assert scales._correlate_course(in_rad, YAW, V) == pytest.approx(scales._correlate_course(look, YAW, V))
    look.channels["heading"] = Channel("heading", T, course, "deg")
    assert scales._correlate_course(look, YAW, V) == 0.0  # a heading of something else
    gps = make_look({"GPS_Heading": "deg"}, GPS_Heading=course * 2)  # up to 720 is no course
    assert scales._correlate_course(gps, YAW, V) == 0.0


def test_the_ground_speed_is_that_of_the_receiver_or_of_its_positions() -> None:
    units = {"Vehicle_Speed": "km/h", "GPS_Speed": "km/h"}
    look = make_look(units, Vehicle_Speed=V, GPS_Speed=3.6 * V)
    np.testing.assert_allclose(scales._find_ground_speed(look, {}), V)
    assert scales._find_ground_speed(make_look(units, Vehicle_Speed=V), {"rear": "Vehicle_Speed"}) is None
    at = make_look(None, latitude=48.0 + np.cumsum(V) * STEP / 111194.9, longitude=np.full(len(T), 9.0))
    found = scales._find_ground_speed(at, {})
    assert found is not None
    np.testing.assert_allclose(found[20:-20], physics.smooth(V)[20:-20], rtol=0.01)
    no = make_look(None, latitude=1000 + T, longitude=T)
    assert scales._find_ground_speed(no, {}) is None


@pytest.mark.parametrize(
    ("role", "unit", "car", "per"),
    [
        ("wheel", "km/h", None, 1 / 3.6),
        ("wheel", "rad/s", None, 0.32),
        ("wheel", "rpm", 0.3, 0.3 * 2 * np.pi / 60),
        ("yaw_rate", "deg/s", None, np.pi / 180),
        ("accel_x", "g", None, G),
    ],
)
def test_a_unit_is_converted_to_si_and_wheels_to_m_per_s(role, unit, car, per) -> None:
    given = SimpleNamespace(values={"wheel_radius_front": car, "wheel_radius_rear": 9.0}) if car else None
    assert scales._convert_unit(role, unit, given) == pytest.approx(per)


@pytest.mark.parametrize(
    ("a", "b", "role", "is_same"),
    [
        ("rad/s", "1/s", "wheel", True),
        ("rad/s", "m/s", "wheel", False),
        ("kph", "km/h", "wheel", True),
        ("deg", "rad", "steer_angle", False),
        ("deg", "degrees", "steer_angle", True),
        ("g", "m/s2", "accel_y", False),
        ("x", "x", "accel_y", False),
    ],
)
def test_units_are_the_same_by_their_factor_and_kind(a: str, b: str, role: str, is_same: bool) -> None:
    assert scales.is_same_unit(a, b, role) is is_same


def test_units_have_costs_by_where_they_are_stated() -> None:
    look = make_look({"r": "deg/s", "odd": "Nm", "v": ""}, r=YAW, odd=YAW, r_degs=YAW, v=V, w_kmh=V)
    assert scales._list_units(look, "yaw_rate", "r", False) == [("deg/s", 0.0), ("rad/s", 6.0)]
    assert scales._list_units(look, "yaw_rate", "odd", False) == [("rad/s", 0.0), ("deg/s", 0.5)]
    assert scales._list_units(look, "wheel", "w_kmh", False)[:2] == [("km/h", 0.0), ("rad/s", 3.0)]
    speeds = [u for u, _ in scales._list_units(look, "wheel", "v", True)]
    assert speeds == ["km/h", "m/s", "mph"]
    assert len(scales._list_units(look, "wheel", "v", False)) == 5


def test_the_cost_of_units_is_the_squared_deviation_up_to_a_limit() -> None:
    unit = {"wheel": "m/s", "yaw_rate": "rad/s", "accel_y": "m/s2", "accel_x": "m/s2"}
    per = dict.fromkeys(unit, 1.0)
    cost, figures = scales._compute_cost({"accel_y": 1.1, "top": 30.0}, unit, per, None)
    assert cost == pytest.approx((np.log(1.1) / 0.07) ** 2) and figures == {"accel_y": 1.1}
    far = np.log(9.81) / 0.07
    assert scales._compute_cost({"accel_y": 9.81}, unit, per, None)[0] == pytest.approx(16 + 0.1 * far)
    for top, more in ((74.0, 0.0), (76.0, 4.0), (2.9, 4.0), (3.1, 0.0)):
        assert scales._compute_cost({"top": top}, unit, per, None)[0] == more
    facts = {"accel_y": 0.1, "accel_x": 0.1, "track": 0.1, "speed": 0.1}
    per = {"wheel": 2.0, "yaw_rate": 3.0, "accel_y": 5.0, "accel_x": 7.0}
    found = scales._compute_cost(facts, unit, per, None)[1]
    wanted = {"accel_y": 0.5 / 6, "accel_x": 0.35, "track": 0.2 / 3, "speed": 0.05}
    assert found == pytest.approx(wanted)
    rolling = unit | {"wheel": "rad/s"}
    loose = scales._compute_cost({"accel_y": 1.1}, rolling, dict.fromkeys(unit, 1.0), None)[0]
    assert loose == pytest.approx(np.log(1.1) ** 2 / (0.07**2 + 0.06**2))
    known = scales._compute_cost({"accel_y": 1.1}, rolling, dict.fromkeys(unit, 1.0), object())[0]
    assert known == pytest.approx(np.log(1.1) ** 2 / (0.07**2 + 0.02**2))


@pytest.mark.parametrize(("stated", "warns"), [("", False), ("rad/s", True), ("deg/s", False)])
def test_the_units_are_those_with_which_the_channels_agree(stated: str, warns: bool) -> None:
    x = {n: 3.6 * w for n, w in make_wheels(track=1.53).items()}
    look = make_look({"r": stated}, **x, r=np.degrees(YAW), ay=V * YAW / G)
    warnings: list[str] = []
    found = scales.find_units(look, WHEELS, {"yaw_rate": "r", "accel_y": "ay"}, None, warnings)
    assert found.unit == {"yaw_rate": "deg/s", "accel_y": "g", "wheel": "km/h"}
    assert found.figures["track"] == pytest.approx(1.53) and found.figures["accel_y"] == pytest.approx(1.0)
    assert warnings == (["the log states rad/s for 'r', but its values fit deg/s: deg/s is proposed"] * warns)
    assert scales.find_units(make_look(), {}, {}, None, []).unit == {}


# ---- Guesses


@pytest.mark.parametrize(
    ("facts", "sign", "is_sided"),
    [
        ({}, (1, 1, 1), False),
        ({"track_corr": 0.9}, (1, 1, 1), True),
        ({"track_corr": -0.9, "accel_y_corr": 0.9}, (-1, -1, 1), True),  # both are the wrong way
        ({"track_corr": -0.9, "accel_y_corr": -0.9}, (-1, 1, 1), True),
        ({"track_corr": -0.6, "accel_y_corr": -0.9}, (1, -1, 1), False),
        ({"track_corr": 0.1, "course_corr": -0.8}, (-1, -1, 1), True),
        ({"track_corr": 0.9, "course_corr": -0.8}, (1, 1, 1), True),
        ({"accel_x_corr": -0.6}, (1, 1, -1), False),
        ({"accel_x_corr": -0.4}, (1, 1, 1), False),
    ],
)
def test_signs_follow_from_wheels_then_from_the_course(facts, sign, is_sided) -> None:
    found, sided = guesses._find_signs(facts)
    assert (found["yaw_rate"], found["accel_y"], found["accel_x"]) == sign and sided is is_sided


@pytest.mark.parametrize(
    ("said", "shown", "confidence"),
    [
        (1.0, 2.5, "sure"),
        (0.9, 2.5, "likely"),
        (4.0, 2.4, "likely"),
        (2.5, -0.9, "likely"),
        (2.5, -1.0, "unsure"),
        (2.4, 2.4, "unsure"),
    ],
)
def test_confidence_follows_from_name_and_physics(said: float, shown: float, confidence: str) -> None:
    assert guesses._rate_confidence(said, shown) == confidence


def guess_motion(
    role: str = "yaw_rate", said: float = 3.0, shown: float = 3.0, sign: float = 1.0, **more
) -> Guess:
    given = {"is_sided": True, "unit": "rad/s" if role == "yaw_rate" else "m/s2"} | more
    look = make_look({"x": given["unit"]}, x=YAW)
    facts = {"track_corr": 0.99, "accel_y_corr": 0.98, "accel_x_corr": 0.9}
    figures = {"track": 1.5, "accel_y": 1.01, "accel_x": 0.98}
    worth = {"said": said, "shown": shown}
    return guesses._guess_motion(
        look, role, "x", worth, make_scale(figures), sign, facts, given["is_sided"], []
    )


@pytest.mark.parametrize(
    ("more", "confidence", "unsure"),
    [
        ({}, "sure", []),
        ({"is_sided": False}, "sure", ["its sign"]),
        ({"role": "accel_y", "is_sided": False}, "sure", []),
        ({"said": 0.5}, "likely", ["the signal, by its behaviour alone"]),
        ({"said": 0.5, "is_sided": False}, "likely", ["the signal, by its behaviour alone", "its sign"]),
        ({"shown": 0.0}, "likely", ["its sign"]),
        ({"shown": 0.0, "unit": ""}, "unsure", ["its sign", "its unit"]),
        ({"shown": 0.0, "said": 0.5}, "unsure", ["the signal", "its sign"]),
        ({"shown": 1.0, "said": 1.5}, "unsure", ["the signal"]),
    ],
)
def test_what_was_not_tested_is_unsure(more: dict, confidence: str, unsure: list[str]) -> None:
    found = guess_motion(**more)
    assert (found.confidence, found.unsure) == (confidence, unsure)


def test_evidence_names_ratios_correlations_and_the_direction() -> None:
    assert "positive to the right in the log" in guess_motion(sign=-1.0).figures
    assert "positive backwards in the log" in guess_motion("accel_x", sign=-1.0).figures
    found = guess_motion().figures
    assert found[0] == "(right - left wheel speed) / yaw rate: 1.50 m, correlation 0.990"
    assert found[1] == "a_y / (v r): 1.01, correlation 0.980"
    assert (
        guess_motion("accel_x", sign=-1.0).figures[0].startswith("a_x / (dv/dt of the wheels): -0.98, corr")
    )


def test_signs_that_all_contradict_the_wheels_may_be_those_of_the_wheels() -> None:
    found = {
        c: Guess(c, ("x",), "", "", -1.0, confidence="sure") for c in ("yaw_rate", "accel_y", "steer_angle")
    }
    warnings: list[str] = []
    guesses._check_inverted_axes(found, warnings)
    assert len(warnings) == 1 and {g.confidence for g in found.values()} == {"likely"}
    assert all(g.unsure == ["its sign, or which wheels are left"] for g in found.values())
    found["accel_y"].sign = 1.0
    guesses._check_inverted_axes(found, warnings)
    assert len(warnings) == 1


def guess_steering(per: float, unit: str, car=None, understeer: float = 0.002, offset: float = 0.0):
    """Return the guess for an angle of `per` x wheelbase x curvature, and warnings."""
    angle = per * 2.7 * YAW / V * (1 + understeer * V**2) + offset
    look = make_look({"a": unit}, a=angle)
    warnings: list[str] = []
    worth = {"said": 3.0, "shown": 3.0}
    return guesses._guess_steering(look, "a", worth, V, YAW, car, warnings), warnings


DEG = 180 / np.pi


@pytest.mark.parametrize(
    ("per", "unit", "found_unit", "ratio", "sign"),
    [
        (15.5 * DEG, "deg", "deg", 15.5, 1.0),
        (-15.5 * DEG, "", "deg", 15.5, -1.0),
        (15.5, "rad", "rad", 15.5, 1.0),
        (1.0, "", "rad", None, 1.0),
        (DEG, "deg", "deg", None, 1.0),
        (15.5 * DEG, "rad", "deg", 15.5, 1.0),  # the log states a unit that cannot be
    ],
)
def test_a_steering_angle_has_the_unit_with_which_its_ratio_is_usual(
    per, unit, found_unit, ratio, sign
) -> None:
    guess, warnings = guess_steering(per, unit)
    assert (guess.unit, guess.sign) == (found_unit, sign)
    assert guess.ratio == (None if ratio is None else pytest.approx(ratio, rel=0.02))
    assert bool(warnings) == (unit == "rad" and found_unit == "deg")
    assert ("positive to the right in the log" in guess.figures) == (sign < 0)


def test_a_ratio_is_that_of_the_file_the_measured_one_or_between_it_and_the_usual_one() -> None:
    def car(ratio: float | None, lf: float = 1.2) -> SimpleNamespace:
        return SimpleNamespace(values={"lf": lf, "lr": 1.5}, steering_ratio=ratio)

    assert guess_steering(16.0 * DEG, "deg", car(16.5))[0].ratio == 16.5
    far, warnings = guess_steering(16.0 * DEG, "deg", car(20.0))
    assert far.ratio == pytest.approx(16.0, rel=0.02)
    assert warnings[0].startswith("steer_angle: the steering ratio is 20 in the vehicle file, but 16.")
    between = guess_steering(19.0 * DEG, "deg", car(None))[0].ratio
    assert 15.5 < between < 19.0
    loose = guess_steering(19.0 * DEG, "deg")[0].ratio  # without a car, less is known
    assert 15.5 < loose < between
    longer = guess_steering(16.0 * DEG, "deg", car(None, 1.74))[0].ratio  # a wheelbase 20 % longer
    assert longer == pytest.approx(guess_steering(16.0 / 1.2 * DEG, "deg", car(None))[0].ratio, rel=0.01)
    offset = guess_steering(16.0 * DEG, "deg", offset=4.0)[0]
    assert "4 deg when driving straight" in offset.figures
    assert not any("straight" in f for f in guess_steering(16.0 * DEG, "deg", offset=1.0)[0].figures)


@pytest.mark.parametrize(
    ("v", "r", "why"),
    [(None, YAW, "no speed"), (V, None, "no yaw rate"), (V, np.zeros(len(T)), "too few bends")],
)
def test_a_steering_angle_that_cannot_be_tested_is_unsure(v, r, why: str) -> None:
    look = make_look(None, a=60.0 * YAW / 0.15)
    guess = guesses._guess_steering(look, "a", {"said": 3.0, "shown": 0.0}, v, r, None, [])
    assert (guess.unit, guess.ratio, guess.confidence) == ("deg", 15.5, "unsure")
    assert guess.unsure == ["sign", "ratio", "unit"] and why in guess.figures[0]
    car = SimpleNamespace(values={"lf": 1.0, "lr": 1.5}, steering_ratio=18.0)
    stated = make_look({"a": "deg"}, a=60.0 * YAW / 0.15)
    guess = guesses._guess_steering(stated, "a", {"said": 3.0, "shown": 0.0}, v, r, car, [])
    assert guess.ratio == 18.0 and guess.unsure == ["sign", "ratio"] and guess.unit_from == "from the log"


@pytest.mark.parametrize(
    ("size", "unit", "found"),
    [
        (45.0, "", ("deg", True)),
        (0.05, "", ("rad", False)),
        (0.8, "rad", ("rad", True)),
        (0.05, "rad", ("rad", False)),
        (1.0, "deg", ("deg", False)),
        (200.0, "deg", ("deg", True)),
    ],
)
def test_the_size_of_an_angle_shows_its_unit_and_the_wheel(size: float, unit: str, found: tuple) -> None:
    x = np.full(1000, -size)
    x[:20] = 1e6  # 2 % do not count
    assert guesses._guess_by_size(x, unit) == found


def test_wheels_have_the_ratio_to_the_other_axle_and_unsure_places() -> None:
    x = make_wheels()
    x["wheel_rl"], x["wheel_rr"] = x["wheel_rl"] * 1.05, x["wheel_rr"] * 1.05
    look = make_look(dict.fromkeys(x, "m/s"), **x)
    scale = make_scale({"track": 1.5, "accel_y": 1.0})
    rear = guesses._guess_wheels(look, "rear", ["wheel_rl", "wheel_rr"], WHEELS, scale)
    assert rear.figures[0] == "ratio to the other axle: 1.050" and rear.confidence == "sure"
    assert rear.channel == "wheel_speed_rear" and rear.unit_from == "from the log" and rear.unsure == []
    plain = make_look(None, a=V, b=V, c=V, d=V)
    unnamed = dict(zip(WHEELS, "abcd", strict=True))
    found = guesses._guess_wheels(plain, "front", ["a", "b"], unnamed, make_scale({}))
    assert found.confidence == "unsure" and found.unsure == ["which wheel is which", "its unit"]
    mixed = guesses._guess_wheels(look, "rear", ["wheel_fl", "wheel_rr"], WHEELS, scale)
    assert mixed.confidence == "unsure"
    car = guesses._guess_wheels(look, "rear", ["wheel_rl"], {"rear": "wheel_rl"}, scale)
    assert car.confidence == "likely" and "the speed of the car is used for both axles" in car.figures[-1]


def lag(x: np.ndarray, late: float) -> np.ndarray:
    return np.interp(T - late, T, x)


def test_latencies_are_those_behind_the_yaw_rate() -> None:
    x = make_wheels(yaw=lag(YAW, 0.04))
    x |= {n: w for n, w in make_wheels().items() if "wheel_f" in n}  # those in front are not late
    look = make_look(dict.fromkeys(x, "m/s"), **x, r=YAW, ay=lag(V * YAW, 0.06))
    for n in x:
        look.channels[n] = Channel(n, T + 0.001, look.x[n], "m/s")
    look.channels["ay"] = Channel("ay", T + 0.001, look.x["ay"])
    found = {"yaw_rate": Guess("yaw_rate", ("r",), "", ""), "accel_y": Guess("accel_y", ("ay",), "", "")}
    found |= {f"wheel_speed_{a}": Guess("w", (f"wheel_{a[0]}l",), "", "") for a in ("front", "rear")}
    sign = {"yaw_rate": 1.0, "accel_y": 1.0, "accel_x": 1.0}
    guesses.find_latencies(look, found, WHEELS, make_scale(), sign, [])
    assert found["wheel_speed_front"].latency == found["wheel_speed_rear"].latency
    assert found["wheel_speed_rear"].latency == pytest.approx(0.04, abs=0.004)
    assert found["accel_y"].latency == pytest.approx(0.06, abs=0.02)
    assert found["yaw_rate"].latency == 0.0


@pytest.mark.parametrize(
    ("late", "sd", "together", "latency"),
    [
        (0.02, 0.004, False, 0.02),
        (-0.02, 0.004, False, -0.02),
        (0.02, 0.006, False, 0.0),  # less than 4 sd
        (0.003, 0.0001, False, 0.0),
        (0.006, 0.0001, False, 0.006),
        (0.006, 0.0001, True, 0.0),  # sampled together
        (0.009, 0.0001, True, 0.009),
        (0.31, 0.001, False, 0.0),
        (0.1, 0.021, False, 0.0),
        (0.02, np.inf, False, 0.0),
    ],
)
def test_a_latency_is_set_if_it_is_certain_and_possible(late, sd, together, latency) -> None:
    look = make_look(None, x=YAW, r=YAW)
    look.channels["x"] = Channel("x", T if together else T.copy(), YAW)
    guess = Guess("accel_y", ("x",), "", "")
    guesses._set_latency(look, guess, "r", late, sd, "how")
    assert guess.latency == latency
    guesses._set_latency(look, None, "r", late, sd, "how")


@pytest.mark.parametrize(("late", "is_set"), [(0.0, False), (0.15, True), (0.5, False)])
def test_a_steering_angle_is_late_if_the_car_turns_too_soon(late: float, is_set: bool) -> None:
    """In a car, the yaw rate follows the steering angle by about 0.1 s."""
    steer = 0.02 * np.sin(0.7 * T) + 0.01 * np.sin(0.31 * T)
    r = lag(V * steer / (1 + 0.002 * V**2), 0.1)
    look = make_look(None, a=lag(steer, late))
    guess, warnings = Guess("steer_angle", ("a",), "", ""), []
    guesses._set_steering_latency(look, guess, V, r, T > 2.0, warnings)
    assert guess.latency == pytest.approx(late if is_set else 0.0, abs=0.02) and bool(warnings) is is_set


@pytest.mark.parametrize(
    ("offset", "words"), [(0.5, ""), (0.8, "tilted IMU"), (-9.8, "contains gravity"), (12.0, "tilt")]
)
def test_an_offset_of_an_accelerometer_is_named(offset: float, words: str) -> None:
    look = make_look(None, r=-YAW, ay=-(V * YAW + offset), ax=physics.differentiate(V))
    chosen = {"yaw_rate": "r", "accel_y": "ay", "accel_x": "ax"}
    found = {c: Guess(c, (n,), "", "") for c, n in chosen.items()}
    sign = {"yaw_rate": -1.0, "accel_y": -1.0, "accel_x": 1.0}
    warnings: list[str] = []
    guesses._check_offsets(look, found, chosen, make_scale({"accel_y": 1.0, "track": 1.5}), sign, V, warnings)
    assert len(warnings) == bool(words) and words in "".join(warnings)
    assert ("offset +0.50 m/s2" in found["accel_y"].figures) == (not words)
    assert "offset +0.00 m/s2" in found["accel_x"].figures or "offset -0.00 m/s2" in found["accel_x"].figures


@pytest.mark.parametrize(
    ("figures", "count"),
    [
        ({"accel_y": 0.81, "track": 1.11}, 0),
        ({"accel_y": 0.79}, 1),
        ({"accel_y": 1.26}, 1),
        ({"track": 1.09}, 1),
        ({"track": 2.11}, 1),
    ],
)
def test_an_unusual_ratio_or_track_is_named(figures: dict, count: int) -> None:
    warnings: list[str] = []
    guesses._check_offsets(make_look(), {}, {}, make_scale(figures), {}, V, warnings)
    assert len(warnings) == count
    guesses._check_offsets(make_look(), {}, {}, make_scale(figures), {}, None, warnings)
    assert len(warnings) == count


@pytest.mark.parametrize(("degrees", "is_said"), [(0, False), (6, False), (8, True), (-20, True)])
def test_an_imu_that_is_mounted_turned_is_named_with_its_angle(degrees: float, is_said: bool) -> None:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    along = physics.differentiate(V)
    look = make_look(None, r=YAW, ay=c * V * YAW - s * along, ax=along)
    found = {c: Guess(c, (n,), "", "", confidence="sure") for c, n in (("yaw_rate", "r"), ("accel_y", "ay"))}
    warnings: list[str] = []
    sign = {"yaw_rate": 1.0, "accel_y": 1.0}
    guesses._check_turned_imu(look, found, make_scale(), sign, V, warnings)
    assert bool(warnings) is is_said
    if is_said:
        assert f"turned by {degrees:.0f} degrees" in warnings[0]
        assert found["accel_y"].confidence == "unsure" and found["yaw_rate"].confidence == "sure"


# ---- Velocities


def slide(sign: float, size: float = 0.6) -> Look:
    vy = size * np.sin(0.9 * T)
    ay = V * YAW + physics.differentiate(vy)
    units = {"Long_Vel": "km/h", "Lat_Vel": "km/h"}
    return make_look(units, Long_Vel=3.6 * 1.01 * V, Lat_Vel=3.6 * sign * vy, r=YAW, ay=ay)


KNOWN = [Guess("yaw_rate", ("r",), "rad/s", ""), Guess("accel_y", ("ay",), "m/s2", "")]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_lateral_velocity_has_the_sign_of_the_acceleration(sign: float) -> None:
    along, across = velocities.find_velocities(slide(sign), KNOWN, V, "VBOX")
    assert (along.channel, along.sign, along.unit, along.confidence) == ("ins_vel_x", 1.0, "km/h", "sure")
    assert along.figures == ["ratio to the speed of the wheels: 1.010"]
    assert (across.channel, across.sign, across.confidence) == ("ins_vel_y", sign, "sure")
    assert f"positive to the {'left' if sign > 0 else 'right'}" in across.figures[0]


def test_without_motion_only_vbox_states_the_sign_of_a_lateral_velocity() -> None:
    for format_, signs in (("VBOX", [1.0, -1.0]), ("MF4", [1.0])):
        found = velocities.find_velocities(slide(1.0), [], V, format_)
        assert [g.sign for g in found] == signs
    assert velocities.find_velocities(slide(1.0), KNOWN, None, "VBOX") == []
    wide = velocities.find_velocities(slide(1.0, 9.0), KNOWN, V, "VBOX")
    assert [g.channel for g in wide] == ["ins_vel_x"]  # 9 m/s at 20 m/s is no lateral velocity
    for by in (0.8, 1.25):
        assert "ins_vel_x" not in [
            g.channel for g in velocities.find_velocities(slide(1.0), KNOWN, by * V, "")
        ]
    taken = [*KNOWN, Guess("vehicle_speed", ("Long_Vel",), "", "")]
    assert [g.channel for g in velocities.find_velocities(slide(1.0), taken, V, "")] == ["ins_vel_y"]


# ---- Candidates


def explain(
    name: str, x: np.ndarray, role: str = "yaw_rate", unit: str = "", found=KNOWN, v=V, rate=50.0
) -> str:
    look = make_look({name: unit}, {name: rate}, **{name: x}, r=YAW, ay=V * YAW)
    return candidates._explain_rejection(look.channels[name], role, look, {"used": "accel_y"}, found, v)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"name": "used", "x": YAW}, "is proposed as accel_y"),
        ({"name": "x", "x": np.where(T < 0.11, 1.0, NAN)}, "has 3 values"),
        ({"name": "x", "x": np.full(len(T), 7.0)}, "is 7 all the time"),
        ({"name": "x", "x": np.where(T < 5.0, T, NAN)}, "do not overlap those of the other signals"),
        ({"name": "x", "x": YAW, "unit": "m/s"}, "its unit m/s is not that of a rate"),
        ({"name": "x", "x": YAW, "role": "wheel"}, "is often negative, unlike a wheel speed"),
        ({"name": "x", "x": V, "role": "wheel", "rate": 1.0}, "has only 1 new values per second"),
        ({"name": "x", "x": V, "role": "wheel"}, "the other wheel of its axle"),
        ({"name": "YawRateOffset", "x": YAW}, "its name describes another quantity (a target"),
        ({"name": "Gear", "x": YAW}, "its name describes another quantity"),
        ({"name": "x", "x": YAW, "v": None}, "there is no speed to test it with"),
        ({"name": "YawRate", "x": YAW, "v": None}, "another signal fits better"),
        ({"name": "x", "x": np.cos(5 * T)}, "does not follow accel_y over speed (correlation 0.0"),
        ({"name": "x", "x": np.cos(5 * T), "role": "accel_y"}, "does not follow speed times yaw rate (corr"),
        ({"name": "x", "x": V**2 * YAW, "role": "accel_y", "v": V**2}, "yaw rate (correlation 1.00)"),
        ({"name": "x", "x": np.cos(5 * T), "role": "accel_x"}, "does not follow the change of speed (corr"),
        ({"name": "x", "x": np.cos(5 * T), "found": []}, "there is no accel_y to test it with"),
    ],
)
def test_a_signal_is_rejected_for_its_reason(given: dict, words: str) -> None:
    assert words in explain(**given)


def test_the_nearest_signals_are_the_three_best_that_fit_at_all() -> None:
    x = {"YawRate": YAW, "gyro_z": YAW, "yaw": YAW, "rate_z": YAW, "temperature": V}
    look = make_look({n: "rad/s" for n in x if n != "temperature"}, **x)
    recording = Recording(Path("x"), "CSV", look.channels)
    found = candidates.find_nearest_candidates(recording, look, [], ["yaw_rate", "steer_angle"], None)
    assert [t.partition(":")[0] for t in found["yaw_rate"]] == ["YawRate", "rate_z", "gyro_z"]
    assert found["steer_angle"] == ["no signal has a similar name or the unit of this channel"]


@pytest.mark.parametrize(
    ("role", "axle", "name", "unit", "score"),
    [
        ("yaw_rate", "", "YawRate", "deg/s", 4.0),
        ("yaw_rate", "", "YawRate", "", 3.0),
        ("yaw_rate", "", "YawRateOffset", "deg/s", 1.5),
        ("yaw_rate", "", "abc", "deg/s", 1.0),
        ("yaw_rate", "", "rpm", "rpm", 0.0),
        ("wheel", "front", "WheelSpeed_FL", "km/h", 4.0),
        ("wheel", "rear", "WheelSpeed_FL", "km/h", 0.0),
        ("wheel", "rear", "vehicle_speed", "km/h", 0.6),
        ("wheel", "rear", "vehicle_speed", "", 0.0),
    ],
)
def test_a_candidate_has_the_score_of_its_name_and_unit(role, axle, name, unit, score) -> None:
    assert candidates._score_candidate(role, axle, Channel(name, T, V, unit)) == pytest.approx(score)


# ---- The text of a proposal

FULL = Guess(
    "steer_angle", ("M.angle",), "deg", "from the log", -1.0, 15.5, 0.025, 3.25, None, "M.sign", "M.frac",
    ("M.q", 0.0), ("M.bz", 16), ["ratio", "sign"], "likely", ["evidence"],
)  # fmt: skip


def test_a_proposal_is_a_file_with_all_that_was_found(tmp_path: Path) -> None:
    brake = Guess("brake", ("p",), "bar", "from the log", above=0.0)
    pair = Guess("wheel_speed_rear", ("l", "r"), "km/h", "from the log")
    proposal = Proposal([FULL, pair, brake], ["look out"], ["accel_x"], {"accel_x": ["x: is 0 all the time"]})
    how = ReadOptions(databases=(tmp_path / "a.dbc", Path("/else/b.dbc")), step=0.01)
    text = proposal_module.format_signals(record(a=V), proposal, how, tmp_path)
    found = parse_toml(text)
    assert found["log"] == {"databases": ["a.dbc", "/else/b.dbc"], "step": 0.01}
    assert found["signals"]["steer_angle"] == {
        "name": "M.angle", "unit": "deg", "sign": -1, "add": "M.frac", "sign_bit": "M.sign", "ratio": 15.5,
        "latency": 0.025, "clock": 3.25, "valid": {"name": "M.q", "is": [0]},
        "counter": {"name": "M.bz", "modulo": 16}, "unsure": "ratio, sign",
    }  # fmt: skip
    assert found["signals"]["brake"] == {"name": "p", "unit": "bar", "above": 0}
    assert found["signals"]["wheel_speed_rear"] == {"name": ["l", "r"], "unit": "km/h"}
    lines = text.splitlines()
    assert lines[0].startswith("# Proposed by tselab signals for log.csv")
    assert lines[1] == "# warning: look out"
    assert "[signals.steer_angle]  # likely" in lines and "# evidence" in lines
    assert lines[-3:] == [
        "# [signals.accel_x]",
        "# x: is 0 all the time",
        '# name = "..."  # not found; if left out, the channel is missing',
    ]


def test_a_headline_has_all_that_was_found() -> None:
    assert proposal_module.format_headline(FULL) == (
        "steer_angle = M.angle: deg (from the log), sign -1, ratio 15.5, latency 25 ms, its clock is +3.25 s "
        "ahead, and M.frac, valid if M.q is 0, counter M.bz; likely"
    )
    plain = Guess("brake", ("a", "b"), "1", "from the log", above=0.0)
    assert proposal_module.format_headline(plain) == "brake = a and b: 1 (from the log), on above 0; unsure"


def test_a_line_of_the_list_has_rate_range_missing_share_and_use() -> None:
    x = np.r_[np.sin(0.7 * np.arange(75)), np.full(25, NAN)]
    recording = record(a=(x, "deg"), b=np.full(100, NAN))
    first, second = proposal_module.list_signals(
        recording, Proposal([Guess("yaw_rate", ("a",), "", "")], [], [])
    )
    assert (first.name, first.unit, first.used, first.missing) == ("a", "deg", "yaw_rate", 0.25)
    assert first.rate == pytest.approx(50.0)
    assert (first.low, first.high) == (pytest.approx(np.nanmin(x)), pytest.approx(np.nanmax(x)))
    assert (second.used, second.rate, second.missing) == ("", 0.0, 1.0) and np.isnan(second.low)


def test_a_unit_that_nobody_knows_is_named_once() -> None:
    recording = record(a=(V, "furlong/x"), b=(V, "furlong/x"), c=(V, "deg"))
    found = [Guess("w", ("a", "b"), "km/h", ""), Guess("x", ("c",), "deg", "")]
    (text,) = proposal_module._warn_of_strange_units(recording, found)
    assert text.startswith("the unit 'furlong/x' of a, b is unknown: km/h is proposed")


@pytest.mark.parametrize(("path", "text"), [("a/b.dbc", "a/b.dbc"), ("../c.dbc", None)])
def test_paths_inside_a_folder_are_relative(path: str, text: str | None, tmp_path: Path) -> None:
    found = proposal_module._make_relative(tmp_path / path, tmp_path)
    assert found == (text or (tmp_path / path).resolve().as_posix())
