"""Each key of signals.toml: what it makes of a signal, and what is allowed in it."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tse.channels import mapping, signals
from tse.channels.mapping import Clocks, Series, map_signals
from tse.channels.signals import (
    Counter,
    Flag,
    SignalsFile,
    SignalSource,
    find_signals,
    find_unit,
    read_signals,
)
from tse.library.errors import UserError
from tse.log.rows import OPTIONAL_COLUMNS
from tse.readers.recording import Channel, Recording

T = np.arange(6) * 0.1
X = np.array([1.0, -2.0, 3.0, 4.0, np.inf, 6.0])
CAR = SimpleNamespace(values={"wheel_radius_front": 0.25, "wheel_radius_rear": 0.5})
NAN = np.nan


def make_recording(*channels: Channel) -> Recording:
    return Recording(Path("log.csv"), "CSV", {c.name: c for c in channels})


def map_one(channel: str, *channels: Channel, car=None, notes=None, max_lost=0.5, **keys) -> Series:
    """Return the only series that the first of `channels` becomes."""
    file = SignalsFile(None, {channel: SignalSource(channel, (channels[0].name,), **keys)})
    found = map_signals(make_recording(*channels), file, car, [] if notes is None else notes, max_lost)
    assert list(found) == [channel]
    return found[channel]


DEG = np.pi / 180


@pytest.mark.parametrize(
    ("channel", "unit", "keys", "per", "offset"),
    [
        ("yaw_rate", "deg/s", {}, DEG, 0.0),
        ("yaw_rate", "deg/s", {"sign": -1.0}, -DEG, 0.0),
        ("yaw_rate", "deg/s", {"offset": 2.0}, DEG, 2.0),  # degrees per s, not rad/s
        ("yaw_rate", "deg/s", {"scale": 0.5, "sign": -1.0, "offset": 2.0}, -0.5 * DEG, 2.0),
        ("yaw_rate", "rad/s", {"unit": "deg/s"}, DEG, 0.0),  # the file is right, not the log
        ("accel_y", "g", {}, 9.80665, 0.0),
        ("steer_angle", "deg", {"ratio": 16.0}, DEG / 16.0, 0.0),
        ("wheel_speed_front", "km/h", {"car": CAR}, 1 / 3.6 / 0.25, 0.0),
        ("wheel_speed_rear", "km/h", {"car": CAR}, 1 / 3.6 / 0.5, 0.0),
        ("wheel_speed_rear", "km/h", {"car": CAR, "radius": 0.2}, 1 / 3.6 / 0.2, 0.0),
        ("wheel_speed_rear", "rpm", {"car": CAR}, 2 * np.pi / 60, 0.0),
        ("vehicle_speed", "km/h", {"car": CAR}, 1 / 3.6, 0.0),
        ("ref_cy_front", "kN", {}, 1.0, 0.0),
    ],
)
def test_a_signal_becomes_si_by_its_unit_offset_scale_and_sign(channel, unit, keys, per, offset) -> None:
    found = map_one(channel, Channel("x", T, X, unit), **keys)
    np.testing.assert_allclose(found.value, np.where(np.isfinite(X), per * (X - offset), NAN), rtol=1e-6)
    assert found.time is T and found.latency == 0.0 and not found.hold


def test_a_signal_without_a_unit_is_taken_in_si_with_a_note() -> None:
    notes: list[str] = []
    assert map_one("yaw_rate", Channel("x", T, X), notes=notes).value[0] == 1.0
    (note,) = notes
    assert note.startswith("yaw_rate: the unit of 'x' is unknown") and note.endswith("rad/s is assumed")


@pytest.mark.parametrize(
    ("channel", "unit", "message"),
    [
        ("wheel_speed_front", "km/h", "the radius of the wheel is needed"),
        ("wheel_speed_front", "Nm", "'Nm' .of 'x' in the log. cannot be converted to rad/s"),
        ("accel_y", "deg", "'deg' .of 'x' in the log. cannot be converted to m/s2"),
    ],
)
def test_a_unit_that_does_not_fit_is_refused(channel: str, unit: str, message: str) -> None:
    with pytest.raises(UserError, match=message):
        map_one(channel, Channel("x", T, X, unit))


@pytest.mark.parametrize(("latency", "clock"), [(0.03, 0.0), (0.0, 0.03), (0.05, -0.02), (-0.03, 0.06)])
def test_latency_and_clock_are_subtracted_from_the_times(latency: float, clock: float) -> None:
    found = map_one("yaw_rate", Channel("x", T, X, "rad/s"), latency=latency, clock=clock)
    np.testing.assert_allclose(found.time, T - 0.03)
    assert found.latency == latency


def test_a_brake_is_on_above_its_threshold_in_the_unit_of_the_signal() -> None:
    x = np.array([0.0, 5.0, 5.1, 80.0, np.nan, -9.0])
    found = map_one("brake", Channel("p", T, x, "bar"), above=5.0, hold=True)
    np.testing.assert_array_equal(found.value, [0, 0, 1, 1, NAN, 0])
    assert found.hold
    turned = map_one("brake", Channel("p", T, x, "bar"), above=5.0, sign=-1.0, scale=2.0)
    np.testing.assert_array_equal(turned.value, [0, 0, 0, 0, NAN, 1])


def test_the_fine_part_and_the_sign_bit_are_the_last_ones_sent() -> None:
    fine = Channel("fine", np.array([0.05, 0.2, 0.45]), np.array([0.1, 0.2, 0.3]))
    bit = Channel("bit", np.array([0.0, 0.15, 0.3]), np.array([0.0, 1.0, 0.0]))
    found = map_one("yaw_rate", Channel("x", T, np.arange(6.0), "rad/s"), fine, add="fine")
    # before its first value, that is the first one
    np.testing.assert_allclose(found.value, [0.1, 1.1, 2.2, 3.2, 4.2, 5.3])
    found = map_one("yaw_rate", Channel("x", T, np.ones(6), "rad/s"), bit, sign_bit="bit", sign=-1.0)
    np.testing.assert_array_equal(found.value, [-1, -1, 1, -1, -1, -1])


def test_a_ratio_that_depends_on_the_angle_is_that_of_the_steering_wheel() -> None:
    angle = np.array([-400.0, -200.0, 0.0, 100.0, 400.0, 50.0])
    table = ((-200.0, 10.0), (0.0, 16.0), (200.0, 12.0))
    ratio = np.array([10.0, 10.0, 16.0, 14.0, 12.0, 15.0])
    found = map_one("steer_angle", Channel("x", T, angle, "deg"), ratio=table)
    np.testing.assert_allclose(found.value, angle * DEG / ratio)
    turned = map_one("steer_angle", Channel("x", T, -angle, "deg"), ratio=table, sign=-1.0)
    np.testing.assert_allclose(turned.value, angle * DEG / ratio)  # the table is in the channel's sign


@pytest.mark.parametrize(
    ("values", "state", "good"),
    [
        (None, [1, 0, 2, 3, 1, 1], [0, 2, 3, 4, 5]),
        ((0.0,), [0, 0, 0, 1, 3, 0], [0, 1, 2, 5]),
        ((0.0, 3.0), [0, 0, 0, 1, 3, 0], [0, 1, 2, 4, 5]),
        (None, [1, NAN, 1, 1, 1, 1], [0, 2, 3, 4, 5]),
    ],
)
def test_values_that_a_flag_marks_are_missing(values, state, good) -> None:
    notes: list[str] = []
    x = Channel("x", T, np.arange(6.0), "rad/s")
    flag = Channel("q", T, np.array(state, float))
    found = map_one("yaw_rate", x, flag, notes=notes, valid=Flag("q", values))
    assert np.flatnonzero(np.isfinite(found.value)).tolist() == good
    assert notes == [f"yaw_rate: {6 - len(good)} values that q marks as invalid are treated as missing"]
    assert np.isfinite(x.value).all()  # the log itself is not changed


def test_a_flag_that_marks_more_than_the_limit_is_refused() -> None:
    x, three = Channel("x", T, np.arange(6.0), "rad/s"), Channel("q", T, np.array([1.0, 1, 1, 0, 0, 0]))
    assert np.isnan(map_one("yaw_rate", x, three, valid=Flag("q")).value).sum() == 3
    four = Channel("q", T, np.array([1.0, 1, 0, 0, 0, 0]))
    with pytest.raises(UserError, match=r"'q' marks 67 % of yaw_rate as invalid; it has the values 0, 1"):
        map_one("yaw_rate", x, four, valid=Flag("q"))
    assert np.isnan(map_one("yaw_rate", x, four, valid=Flag("q"), max_lost=1.0).value).sum() == 4


def map_counted(state: list[int], modulo: int | None = None) -> tuple[list[int], list[str]]:
    """Return the rows that a counter makes missing, and the notes."""
    t, notes = np.arange(len(state)) * 0.1, []
    channels = Channel("x", t, np.arange(len(state)) * 1.0, "rad/s"), Channel("bz", t, np.array(state, float))
    found = map_one("yaw_rate", *channels, notes=notes, counter=Counter("bz", modulo))
    return np.flatnonzero(np.isnan(found.value)).tolist(), notes


def test_a_counter_shows_repeated_and_lost_messages() -> None:
    count = [i % 16 for i in range(40)]
    assert map_counted(count) == ([], [])
    rows, notes = map_counted([*count[:10], 9, *count[10:20], *count[23:]])
    assert rows == [10]
    assert notes == [
        "yaw_rate: 1 entries with the same counter bz as the entry before are treated as missing",
        "yaw_rate: 3 messages are lost according to the counter bz",
    ]
    # a step from 3 to 0 is the next message with modulo 4, and a loss with modulo 16
    four = [i % 4 for i in range(40)]
    assert map_counted(four) == ([], [])
    assert map_counted(four, 16)[1] == ["yaw_rate: 108 messages are lost according to the counter bz"]
    rows, notes = map_counted([1] * 40)
    assert rows == [] and notes == [
        "yaw_rate: the counter bz does not count in 98 % of the entries: not used"
    ]


def test_two_signals_are_the_left_and_the_right_wheel() -> None:
    left, right = Channel("l", T, np.arange(6.0), "rad/s"), Channel("r", T, np.arange(6.0) + 10, "rad/s")
    file = SignalsFile(None, {"wheel_speed_rear": SignalSource("wheel_speed_rear", ("l", "r"))})
    found = map_signals(make_recording(left, right), file, None, [])
    assert {n: s.value[0] for n, s in found.items()} == {
        "wheel_speed_rear_left": 0.0,
        "wheel_speed_rear_right": 10.0,
    }
    assert found["wheel_speed_rear_left"].channel == "wheel_speed_rear_left"


def test_two_steering_angles_are_averaged_at_the_times_of_the_first() -> None:
    left, right = Channel("l", T, T, "rad"), Channel("r", T[:5] + 0.05, 2 * (T[:5] + 0.05), "rad")
    source = SignalSource("steer_angle", ("l", "r"), latency=0.02, hold=True)
    found = map_signals(make_recording(left, right), SignalsFile(None, {"steer_angle": source}), None, [])
    (series,) = found.values()
    np.testing.assert_allclose(series.time, T - 0.02)
    np.testing.assert_allclose(series.value[1:5], 1.5 * T[1:5])
    assert (series.channel, series.latency, series.hold) == ("steer_angle", 0.02, True)


def test_times_are_corrected_once_and_shared() -> None:
    time = np.array([0.0, 0.1, NAN, 0.2, 0.3])
    a, b = Channel("a", time, np.arange(5.0)), Channel("b", time, np.arange(5.0) + 5)
    clocks = Clocks()
    (t, x), (u, y) = clocks.straighten(a), clocks.straighten(b)
    assert t is u and t.tolist() == [0.0, 0.1, 0.2, 0.3]
    assert x.tolist() == [0, 1, 3, 4] and y.tolist() == [5, 6, 8, 9]
    clocks.straighten(Channel("c", time.copy(), np.arange(5.0)))
    assert clocks.notes == ["1 entries without a time are left out"]
    assert clocks.subtract_latency(t, 0.0) is t
    earlier = clocks.subtract_latency(t, 0.05)
    np.testing.assert_allclose(earlier, t - 0.05)
    assert clocks.subtract_latency(t, 0.05) is earlier
    assert clocks.subtract_latency(t, 0.06) is not earlier


def test_a_held_value_is_taken_at_its_time_and_from_then_on() -> None:
    channel = Channel("q", np.array([1.0, 2.0]), np.array([5.0, 6.0]))
    found = mapping._hold_last(Clocks(), channel, np.array([0.0, 1.0, 1.99, 2.0, 9.0]))
    assert found.tolist() == [5, 5, 5, 6, 6]
    empty = Channel("q", np.zeros(0), np.zeros(0))
    assert np.isnan(mapping._hold_last(Clocks(), empty, T)).all()


# ---- signals.toml


def read(folder: Path, text: str) -> SignalsFile:
    path = folder / "signals.toml"
    path.write_text(text, encoding="utf-8")
    return read_signals(path)


STEER = '[signals.steer_angle]\nname = "a"\n'


@pytest.mark.parametrize(
    ("keys", "field", "value"),
    [
        ("", "name", ("a",)),
        ("", "sign", 1.0),
        ("", "unit", None),
        ("sign = -1", "sign", -1.0),
        ("ratio = 0.5", "ratio", 0.5),
        ("ratio = 100", "ratio", 100.0),
        ("ratio = [[0, 14], [100, 16]]", "ratio", ((0.0, 14.0), (100.0, 16.0))),
        ("latency = -1", "latency", -1.0),
        ("clock = 4e9", "clock", 4e9),
        ("scale = -2", "scale", -2.0),
        ("offset = 3", "offset", 3.0),
        ('valid = "q"', "valid", Flag("q", None)),
        ('valid = {name = "q"}', "valid", Flag("q", None)),
        ('valid = {name = "q", is = 2}', "valid", Flag("q", (2.0,))),
        ('valid = {name = "q", is = [0, 3]}', "valid", Flag("q", (0.0, 3.0))),
        ('counter = "z"', "counter", Counter("z", None)),
        ('counter = {name = "z", modulo = 2}', "counter", Counter("z", 2)),
        ('counter = {name = "z"}', "counter", Counter("z", None)),
        ("hold = true", "hold", True),
        ("hold = false", "hold", False),
        ('add = "b"', "add", "b"),
        ('sign_bit = "s"', "sign_bit", "s"),
        ('unsure = "  the sign "', "unsure", "the sign"),
        ('unit = "deg"', "unit", "deg"),
    ],
)
def test_a_key_is_taken_as_it_is_given(keys: str, field: str, value: object, tmp_path: Path) -> None:
    assert getattr(read(tmp_path, STEER + keys).signals["steer_angle"], field) == value


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (STEER + "sign = true", "sign: True is not allowed"),
        (STEER + "ratio = 0.49", "ratio: 0.49 is out of range; allowed: 0.5 .. 100$"),
        (STEER + "ratio = [[0, 14], [0, 15]]", "ratio: row 2: angles must increase: 0 follows 0"),
        (STEER + "ratio = [[0, 14, 3], [1, 15, 3]]", "needs at least two rows"),
        (STEER + "latency = 1.01", "latency: 1.01 is out of range; allowed: -1 .. 1 s"),
        (STEER + "latency = true", "latency: True is not a number"),
        (STEER + "above = 1", "above: is allowed for brake only"),
        (STEER + "radius = 0.3", "radius: is allowed for wheel speeds only"),
        (STEER + "hold = 1", "hold: must be true or false"),
        (STEER + 'unsure = " "', "unsure: must state what is unsure"),
        (STEER + 'counter = {name = "z", modulo = 1}', "counter: must be the name"),
        (STEER + 'counter = {name = "z", modulo = true}', "counter: must be the name"),
        (STEER + 'valid = {name = "q", is = []}', "valid: must be the name"),
        (STEER + 'valid = {nam = "q"}', "valid: must be the name"),
        (STEER + "add = 3", "add: must be the name"),
        (STEER + "sign_bit = 3", "sign_bit: must be the name"),
        ('[signals.steer_angle]\nname = ["a", "b"]\nadd = "c"', "add: is allowed with one name only"),
        ("[signals.steer_angle]\nname = []", "name: must be the name of a signal: name"),
        ('[signals.steer_angle]\nname = ["a", ""]', "name: must be the name of a signal: name"),
        ("signals = 3", "log and signals must be tables"),
        ("[signals]\nsteer_angle = 3", "line 2, steer_angle must be a table"),
        ('[signal]\nx = 1\n[signals.steer_angle]\nname = "a"', "line 1, .signal.: is not known"),
        ("[log]\ndecimal = ';'\n" + STEER, "decimal: ';' is not allowed"),
        ("[log]\nheader = 0\n" + STEER, "header: 0 is not a line number"),
        ("[log]\nheader = true\n" + STEER, "header: True is not a line number"),
        ("[log]\nencoding = 3\n" + STEER, "encoding: 3 is not a string"),
        ("[log]\nrate = 1.9\n" + STEER, "rate: 1.9 is out of range; allowed: 2 .. 1000 Hz"),
        ("[log]\nstep = 2\n" + STEER, "step: 2 is out of range; allowed: 0.0001 .. 1 s"),
        ("[log]\nwanted = 2\n" + STEER, "wanted: is not known"),
        ("[log]\ndatabases = [3]\n" + STEER, "databases: must be a list of files"),
        (
            '[signals.wheel_speed_front]\nname = "a"\n[signals.wheel_speed_front_right]\nname = "b"',
            "wheel_speed_front.: is assigned together with wheel_speed_front_right",
        ),
        ('[signals.wheel_speed_rear_right]\nname = "b"', "rear_right.: wheel_speed_rear_left is needed, too"),
        ('[signals.accel_y]\nname = "a"\nratio = 15', "ratio: is the steering ratio"),
        ('[signals.accel_y]\nname = "a"\nunit = "deg"', "'deg' cannot be converted to m/s2; .* m/s2, g"),
        ('[signals.wheel_speed_rear]\nname = "a"\nunit = "x"', "rad/s, rpm, km/h, m/s, mph"),
    ],
)
def test_a_key_that_is_not_allowed_is_refused_with_its_reason(
    text: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(UserError, match=message):
        read(tmp_path, text)


def test_the_table_log_has_the_options_of_reading(tmp_path: Path) -> None:
    head = (
        '[log]\nrate = 50\nstep = 0.02\ntime = "t"\ntime_unit = "ms"\nseparator = ";"\ndecimal = ","\n'
        'encoding = "cp1252"\nheader = 3\ndatabases = "car.dbc"\n'
    )
    file = read(tmp_path, head + STEER)
    assert file.rate == 50.0 and file.path == tmp_path / "signals.toml"
    how = file.how
    assert (how.step, how.time, how.time_unit, how.separator) == (0.02, "t", "ms", ";")
    assert (how.decimal, how.encoding, how.header) == (",", "cp1252", 3)
    assert how.databases == (tmp_path / "car.dbc",)  # next to signals.toml
    assert read(tmp_path, STEER).rate is None


def test_a_brake_and_a_reference_may_have_any_unit(tmp_path: Path) -> None:
    text = '[signals.brake]\nname = "p"\nunit = "bar"\nabove = 3\n[signals.ref_x]\nname = "x"\nunit = "kN"\n'
    found = read(tmp_path, text).signals
    assert found["brake"].above == 3.0 and found["ref_x"].unit == "kN"


def test_a_file_wants_every_signal_that_it_names_with_or_without_its_message() -> None:
    source = SignalSource(
        "steer_angle", ("Steer.angle",), add="fine", sign_bit="bit", valid=Flag("q"), counter=Counter("bz")
    )
    file = SignalsFile(None, {"steer_angle": source})
    for name in ("Steer.angle", "angle", "fine", "bit", "q", "bz", "M.fine", "topic/bz"):
        assert file.wants(name), name
    for name in ("Other.angle", "rangle", "gle", "steer_angle", "finer", "Mfine"):
        assert not file.wants(name), name


def test_databases_that_are_given_come_before_those_of_the_file_and_none_twice(tmp_path: Path) -> None:
    log, other = tmp_path / "log.blf", tmp_path / "other.toml"
    read(tmp_path, '[log]\ndatabases = ["y/../a.dbc", "b.dbc"]\n' + STEER)
    other.write_text('[signals.yaw_rate]\nname = "r"\n')
    given = (tmp_path / "c.dbc", tmp_path / "x" / ".." / "a.dbc")
    file, how = find_signals(log, None, given)
    assert file is not None and set(file.signals) == {"steer_angle"}
    assert how.databases == (*given, tmp_path / "b.dbc")
    file, how = find_signals(log, other, ())
    assert file is not None and set(file.signals) == {"yaw_rate"} and how.databases == ()
    file, how = find_signals(tmp_path / "elsewhere" / "log.blf", None, given)
    assert file is None and how.databases == given


def test_units_are_those_of_the_library() -> None:
    units = {
        "steer_angle": "rad",
        "wheel_speed_front_left": "rad/s",
        "wheel_speed_rear": "rad/s",
        "accel_x": "m/s2",
        "yaw_rate": "rad/s",
        "vehicle_speed": "m/s",
        "wheel_torque_rear": "Nm",
        "nonsense": "",
    }
    assert {n: find_unit(n) for n in units} == units


def test_channels_are_those_of_the_library_their_wheels_and_what_is_optional() -> None:
    found = signals.list_channels()
    assert found[:6] == [
        *("steer_angle", "wheel_speed_front", "wheel_speed_rear"),
        *("accel_x", "accel_y", "yaw_rate"),
    ]
    sides = [f"wheel_speed_{a}_{s}" for a in ("front", "rear") for s in ("left", "right")]
    assert found[6:] == [*sides, *OPTIONAL_COLUMNS]


def test_the_line_of_a_key_is_that_of_its_own_table() -> None:
    text = (
        '[log]\nrate = 3\n\n["signals"."yaw_rate"]\nname = "r"\n[ signals.accel_y ]\n"unit" = "g"\nname = "a"'
    )
    for table, key, line in (
        ("log", "rate", 2),
        ("signals.yaw_rate", "", 4),
        ("signals.yaw_rate", "name", 5),
        ("signals.accel_y", "unit", 7),
        ("signals.accel_y", "name", 8),
        ("signals.accel_y", "sign", 6),  # the key is missing: the line of its table
        ("signals.yaw_rate", "name, row 2", 5),
        ("signals.yaw_rate", "unit", 4),  # not that of the next table
        ("signals", "", 4),
    ):
        assert signals._find_line(text, table, key) == f"line {line}, ", (table, key)
    assert signals._find_line(text, "signals.brake", "name") == ""
