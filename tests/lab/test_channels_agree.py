"""Checks of channels against each other, one relation at a time."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tse.car.vehicle import make_default_vehicle
from tse.channels import agree, physics
from tse.channels.agree import Cause, Figures, check_units, find_false_stops, read_agreeing, select_certain
from tse.channels.log import read_frame
from tse.library.core import Config
from tse.library.errors import UserError
from tse.log.rows import CheckedLog, Reading

STEP = 1.0 / physics.COMPARISON_RATE
T = np.arange(0.0, 60.0, STEP)
V = 20.0 + 3.0 * np.sin(0.4 * T)
YAW = 0.15 * np.sin(0.7 * T)
NAN = np.nan


def make_channels(**change: np.ndarray) -> dict[str, np.ndarray]:
    """Return channels of an exact car on the raster of the comparison."""
    d = {
        "steer_angle": 2.7 * YAW / V * (1.0 + 0.002 * V**2),
        "accel_x": physics.differentiate(V),
        "accel_y": V * YAW,
        "yaw_rate": YAW.copy(),
    }
    return d | change


def make_log(seconds: float = 60.0, step: float = 0.02, radius: float = 0.3, **change) -> CheckedLog:
    """Return a log of the same car. `change`: column -> function of time, speed, yaw
    rate."""
    t = np.arange(0.0, seconds, step)
    v = 20.0 + 3.0 * np.sin(0.4 * t)
    yaw = 0.15 * np.sin(0.7 * t)
    rng = np.random.default_rng(1)
    table = {
        "time": t,
        "steer_angle": 2.7 * yaw / v * (1.0 + 0.002 * v**2),
        "wheel_speed_front": v / radius,
        "wheel_speed_rear": v / radius,
        "accel_x": np.gradient(v, t) + 0.02 * rng.standard_normal(len(t)),
        "accel_y": v * yaw + 0.1 * rng.standard_normal(len(t)),
        "yaw_rate": yaw + 0.001 * rng.standard_normal(len(t)),
    }
    found = table | {n: x(t, v, yaw) if callable(x) else x for n, x in change.items()}
    return read_frame(pd.DataFrame({n: x for n, x in found.items() if x is not None}))


def compute(log: CheckedLog, d: dict, v: np.ndarray, tracks=None, wheels: float = 1.0) -> Figures:
    return agree._compute_figures(log, d, v, 2.7, tracks, wheels, (0.3, 0.36))


# ---- Ratios


def test_ratios_are_one_for_an_exact_car_and_the_factor_of_a_mistake_otherwise() -> None:
    log = make_log()
    found = compute(log, make_channels(), V)
    assert set(found.value) == {"accel_y", "accel_x", "steer_angle"} == found.sure
    assert all(x == pytest.approx(1.0, abs=0.02) for x in found.value.values())
    assert found.sd["accel_y"] == pytest.approx(agree.FIGURE_SD["accel_y"], rel=1e-3)
    for name, factor in (("accel_y", -0.1), ("accel_x", 3.0), ("steer_angle", 15.0)):
        changed = compute(log, make_channels(**{name: factor * make_channels()[name]}), V)
        assert changed.value[name] == pytest.approx(factor, rel=0.02), name
    half = compute(log, make_channels(), 0.5 * V)  # the speed is too low by the factor 2
    assert half.value["accel_y"] == pytest.approx(2.0) and half.value["accel_x"] == pytest.approx(2.0)
    assert compute(log, make_channels(), 0.2 * V).value.keys() <= {"track_front"}  # it hardly moves


def test_tracks_and_speeds_are_compared_in_their_own_units() -> None:
    log = make_log()
    log.turn = {"wheel_speed_front": 5.0, "wheel_speed_rear": 4.0}  # rad/s per rad/s
    given = compute(log, make_channels(), V, {"front": 1.5}).value
    assert given["track_front"] == pytest.approx(5.0 * 0.3 / 1.5)
    assert given["track_rear"] == pytest.approx(4.0 * 0.36 / agree.UNKNOWN_TRACK)
    found = compute(log, make_channels(), V, {"front": 1.5}, 3.6)
    assert found.value["track_front"] == pytest.approx(5.0 * 0.3 / 1.5 / 3.6)
    assert (found.sd["track_front"], found.sd["track_rear"]) == (0.04, 0.09)
    log.turn = {"wheel_speed_front": 0.0}
    assert "track_front" not in compute(log, make_channels(), V).value  # unknown
    slow = np.where(T < 50.0, V / 1.1, NAN)
    assert compute(log, make_channels(vehicle_speed=slow), V).value["speed"] == pytest.approx(1.1)
    few = np.where(T < 10.0, V, NAN)  # 200 rows
    assert "speed" not in compute(log, make_channels(vehicle_speed=few), V).value


def test_a_ratio_with_a_low_correlation_is_left_out_or_not_sure() -> None:
    rng = np.random.default_rng(2)
    noise, base = rng.standard_normal(len(T)), V * YAW
    for share, is_there, is_sure in ((0.3, True, True), (0.54, True, False), (0.8, False, False)):
        y = base + share * np.std(base) * noise
        corr = np.corrcoef(base, y)[0, 1]
        found = compute(make_log(), make_channels(accel_y=y), V)
        assert ("accel_y" in found.value, "accel_y" in found.sure) == (is_there, is_sure), corr
        if is_there:
            assert found.sd["accel_y"] == pytest.approx(np.hypot(0.1, 1 - corr))
    still = compute(make_log(), make_channels(accel_x=0.001 * make_channels()["accel_x"]), V)
    assert "accel_x" not in still.value  # too small to be a measurement


FIGURES = Figures(
    {
        "accel_y": 2.0,
        "accel_x": 0.5,
        "steer_angle": -15.0,
        "track_front": 1.2,
        "track_rear": 1.1,
        "speed": 3.6,
    },
    {
        "accel_y": 0.1,
        "accel_x": 0.1,
        "steer_angle": 0.08,
        "track_front": 0.04,
        "track_rear": 0.09,
        "speed": 0.02,
    },
)


@pytest.mark.parametrize(
    ("channel", "factor", "changed"),
    [
        ("accel_y", 2.0, {"accel_y": 1.0}),
        ("accel_x", 0.5, {"accel_x": 1.0}),
        ("steer_angle", -15.0, {"steer_angle": 1.0}),
        ("yaw_rate", 4.0, {"accel_y": 8.0, "steer_angle": -60.0, "track_front": 4.8, "track_rear": 4.4}),
        ("wheel_speed", 3.6, {}),
    ],
)
def test_a_mistake_of_a_channel_is_taken_out_of_the_ratios_that_have_it(channel, factor, changed) -> None:
    found = agree._apply_causes(FIGURES, (Cause(channel, factor, ""),))
    assert found == pytest.approx(FIGURES.value | changed)
    both = agree._apply_causes(FIGURES, (Cause("accel_y", 2.0, ""), Cause("accel_y", 3.0, "")))
    assert both["accel_y"] == pytest.approx(2.0 / 6.0)


def test_the_cost_is_the_squared_deviations_in_sds_and_a_price_for_each_wrong_sign() -> None:
    figures = Figures({"accel_y": 1.1, "steer_angle": -1.2}, {"accel_y": 0.1, "steer_angle": 0.08})
    wanted = (np.log(1.1) / 0.1) ** 2 + (np.log(1.2) / 0.08) ** 2 + agree.SIGN_PRICE
    assert agree._compute_cost(figures, ()) == pytest.approx(wanted)
    turned = agree._compute_cost(figures, (Cause("steer_angle", -1.0, ""),))
    assert turned == pytest.approx(wanted - agree.SIGN_PRICE)


def test_a_free_factor_costs_what_is_left_of_the_best_channel() -> None:
    """A factor of the yaw rate acts on two ratios, and brings both to their mean."""
    figures = Figures({"accel_y": 1 / 3.0, "steer_angle": 1 / 4.0}, {"accel_y": 0.1, "steer_angle": 0.1})
    half = np.log(4.0 / 3.0) / 2
    assert agree._compute_free_factor_cost(figures) == pytest.approx(12.0 + 2 * (half / 0.1) ** 2, rel=1e-3)
    rough = Figures(figures.value, {"accel_y": 0.1, "steer_angle": 0.2})
    wanted = 12.0 + np.log(4.0 / 3.0) ** 2 / (0.1**2 + 0.2**2)
    assert agree._compute_free_factor_cost(rough) == pytest.approx(wanted, rel=1e-3)
    one = Figures({"accel_x": -7.0}, {"accel_x": 0.1})
    assert agree._compute_free_factor_cost(one) == pytest.approx(12.0)
    assert agree._compute_free_factor_cost(Figures({"speed": 3.0}, {"speed": 0.02})) == np.inf
    picked = FIGURES.select({"accel_y", "speed"})
    assert picked.value == {"accel_y": 2.0, "speed": 3.6} and picked.sd == FIGURES.sd


def test_mistakes_are_combined_in_pairs_but_not_two_units_of_one_channel() -> None:
    found = list(agree._combine_causes(16.0))
    assert found[0] == () and len([c for c in found if len(c) == 1]) == 10
    pairs = [c for c in found if len(c) == 2]
    assert all(a.channel != b.channel or a.factor * b.factor < 0 for a, b in pairs)
    assert len(set(pairs)) == len(pairs) == 45 - 3  # three pairs of units of the steering angle
    factors = {c[0].text.split(" (")[0]: c[0].factor for c in found if len(c) == 1}
    assert factors["yaw_rate is in deg/s"] == pytest.approx(180 / np.pi)
    assert factors["steer_angle is the steering-wheel angle"] == 16.0
    assert factors["steer_angle is the steering-wheel angle in degrees"] == pytest.approx(16 * 180 / np.pi)
    assert factors["accel_y is in g"] == pytest.approx(1 / 9.80665)


def test_mistakes_of_wheels_are_factors_of_the_speed_with_this_radius() -> None:
    found = {c.text.partition(" (")[0]: c.factor for c in agree._list_wheel_causes(0.3)}
    assert found["the wheel speeds are in km/h"] == pytest.approx(3.6 * 0.3)
    assert found["the wheel speeds are in m/s"] == pytest.approx(0.3)
    assert found["the wheel speeds are in rpm"] == pytest.approx(60 / (2 * np.pi))
    assert found["the wheel speeds are in mph"] == pytest.approx(2.23694 * 0.3)
    assert found["wheel_radius_front and _rear are diameters"] == 2.0


def test_a_mistake_in_a_part_of_the_log_does_not_hold_throughout() -> None:
    """In pieces of 20 s: one of eight may be without it, two may not."""
    cause, t = (Cause("accel_y", -1.0, ""),), np.arange(0.0, 160.0, STEP)
    v, yaw = np.tile(V, 3)[: len(t)], np.tile(YAW, 3)[: len(t)]
    for wrong, holds in ((160.0, True), (140.0, True), (120.0, False), (0.0, False)):
        d = {
            "accel_x": physics.differentiate(v),
            "accel_y": np.where(wrong > t, -1, 1) * v * yaw,
            "yaw_rate": yaw,
            "steer_angle": 2.7 * yaw / v * (1.0 + 0.002 * v**2),
        }
        found = agree._holds_throughout(make_log(), d, v, 2.7, None, (0.3, 0.36), cause)
        assert found is holds, wrong
    small = (Cause("accel_y", 1.1, ""),)  # it changes the cost by less than a mistake costs
    assert agree._holds_throughout(make_log(), make_channels(), V, 2.7, None, (0.3, 0.36), small)
    kmh = (Cause("wheel_speed", 2.0, ""),)
    assert agree._holds_throughout(make_log(), make_channels(), 2.0 * V, 2.7, None, (0.3, 0.36), kmh)
    assert not agree._holds_throughout(make_log(), make_channels(), V, 2.7, None, (0.3, 0.36), kmh)


def test_a_warning_names_mistakes_factors_and_ratios_before_and_after() -> None:
    before = Figures({"accel_y": -1.02, "accel_x": 1.0}, {"accel_y": 0.1, "accel_x": 0.1})
    cause = (Cause("accel_y", -1.0, "accel_y is positive to the right"),)
    text = agree._describe_causes(cause, before, {"accel_y": 1.02, "accel_x": 1.0})
    assert text == (
        "check the units: accel_y is positive to the right; factor -1: accel_y / (speed x yaw_rate) is "
        "-1.02, 1.02 after (about 1 is expected)"
    )
    assert select_certain([text]) == [text]
    off = Figures({"accel_y": 0.1, "steer_angle": 1.3}, {"accel_y": 0.1, "steer_angle": 0.08})
    text = agree._describe_causes(cause, off, {"accel_y": 1.3, "steer_angle": 1.3})
    assert text.startswith("check the units: perhaps accel_y is") and "wrong by the factor 1.3" in text
    assert select_certain([text]) == []


@pytest.mark.parametrize(
    ("name", "x", "text"),
    [
        ("accel_y", 3.0, ""),
        ("accel_x", 0.4, "; logged time steps that are 0.4 times the true ones would explain it"),
        (
            "steer_angle",
            0.5,
            "; a wrong steering ratio or wheelbase explains it, or perhaps braking in bends",
        ),
        ("steer_angle", -3.0, "; a wrong steering ratio or wheelbase explains it"),
    ],
)
def test_what_else_explains_a_ratio_is_named(name: str, x: float, text: str) -> None:
    assert agree._list_alternatives(name, x) == text


# ---- Single checks


@pytest.mark.parametrize(
    ("front", "rear", "is_said"),
    [(20.0, 20.0, False), (24.9, 20.0, False), (25.1, 20.0, True), (15.9, 20.0, True)],
)
def test_axles_that_roll_at_different_speeds_are_named(front: float, rear: float, is_said: bool) -> None:
    a, b = np.full(300, front), np.full(300, rear)
    a[:200], b[:200] = 0.0, NAN  # standing and missing rows do not count
    found = agree._check_axles(a, b)
    assert bool(found) is is_said
    if is_said:
        assert f"front and rear wheels roll at {front:.3g} and 20 m/s" in found[0]
    assert agree._check_axles(np.zeros(300), b) == []


def test_swapped_axes_are_named_only_if_the_other_axis_does_not_follow() -> None:
    along = physics.differentiate(V)
    (text,) = agree._check_swapped_axes(make_channels(accel_x=-V * YAW, accel_y=along), V)
    assert "accel_x and accel_y are swapped" in text and "correlation -1.00, factor -1" in text
    for x, y in ((V * YAW, V * YAW), (along, V * YAW), (along, along)):
        assert agree._check_swapped_axes(make_channels(accel_x=x, accel_y=y), V) == []
    both = along / np.std(along) + 0.9 * V * YAW / np.std(V * YAW)  # accel_y follows both
    assert agree._check_swapped_axes(make_channels(accel_x=V * YAW, accel_y=both), V) == []
    still = agree._check_swapped_axes(make_channels(accel_x=V * YAW, accel_y=np.full(len(T), NAN)), V)
    assert len(still) == 1


@pytest.mark.parametrize(
    ("degrees", "is_said"), [(0, False), (11, False), (13, True), (-20, True), (30, True)]
)
def test_an_imu_that_is_turned_is_named_with_its_angle(degrees: float, is_said: bool) -> None:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    x, y = make_channels()["accel_x"], make_channels()["accel_y"]
    found = agree._check_turned_imu(make_channels(accel_x=c * x + s * y, accel_y=c * y - s * x), V)
    assert bool(found) is is_said
    if is_said:
        assert f"turned about the vertical by {degrees:.0f} degrees" in found[0]
    # one accelerometer alone, or both with the same sign, is no turn
    assert agree._check_turned_imu(make_channels(accel_x=x + 0.4 * y, accel_y=y - 0.05 * x), V) == []
    assert agree._check_turned_imu(make_channels(accel_x=x + 0.4 * y, accel_y=y + 0.4 * x), V) == []
    assert agree._check_turned_imu(make_channels(accel_x=x + 0.4 * y, accel_y=y - 0.4 * x), 0.2 * V) == []


@pytest.mark.parametrize(
    ("lever", "is_said"), [(1.5, True), (-1.5, True), (0.6, True), (0.4, False), (2.2, False), (0.0, False)]
)
def test_wheels_of_one_side_in_one_channel_are_named_with_their_track(lever: float, is_said: bool) -> None:
    d = make_channels()
    found = agree._check_mixed_sides(d, V + lever * YAW, V)
    assert bool(found) is is_said
    if is_said:
        assert f"is {lever:.2g} m times yaw_rate" in found[0]
    rng = np.random.default_rng(3)
    noisy = V + 1.5 * YAW + 0.5 * rng.standard_normal(len(T))  # it explains a tenth
    assert agree._check_mixed_sides(d, noisy, V) == []


@pytest.mark.parametrize(("per", "is_said"), [(1.0, False), (2.0, False), (10.0, True), (0.2, True)])
def test_a_time_that_counts_rows_is_named(per: float, is_said: bool) -> None:
    """The rows are 0.1 s apart; the steps of the column are `per` times as long."""
    log = make_log(120.0, 0.1)
    log.sample_time = 0.1 * per
    found = agree._check_time(log, 0.3)
    assert bool(found) is (is_said and 0.1 * per > 0.05)
    if found:
        assert f"accel_x over 20 rows, {0.1 * per:.3g} s apart, adds up to {per:.2g}" in found[0]
    assert agree._check_time(make_log(19.0, 0.1), 0.3) == []


def test_a_time_in_wrong_steps_is_named_also_if_they_are_short() -> None:
    log = make_log(600.0, 0.3)
    log.sample_time = 0.06
    assert "adds up to 0.2 times" in agree._check_time(log, 0.3)[0]


def stop(first: float, last: float, before: float = 20.0, after: float = 20.0) -> CheckedLog:
    """Return a log in which both wheels stand from `first` to `last`, s."""
    log = make_log(20.0)
    v = np.where(log.time < first - 1e-9, before, np.where(log.time > last + 1e-9, after, 0.0))
    log.data["wheel_speed_front"] = log.data["wheel_speed_rear"] = v / 0.3
    return log


@pytest.mark.parametrize(
    ("first", "last", "before", "after", "is_said"),
    [
        (5.0, 6.0, 20.0, 20.0, True),
        (5.0, 5.5, 20.0, 20.0, True),
        (5.0, 5.44, 20.0, 20.0, False),  # too short
        (5.0, 6.0, 4.9, 5.0, False),  # 9.9 m/s together
        (5.0, 6.0, 5.1, 5.0, True),
        (5.0, 30.0, 11.0, 0.0, True),  # to the end
        (0.0, 5.0, 0.0, 11.0, True),  # from the start
        (0.0, 5.0, 0.0, 9.0, False),
    ],
)
def test_a_stop_without_braking_is_false(first, last, before, after, is_said) -> None:
    found = find_false_stops(stop(first, last, before, after), 0.3, 0.3, 0.5)
    assert bool(found) is is_said
    if is_said:
        end = min(last, 19.98)
        assert f"both wheel speeds are 0 from {first:.2f} to {end:.2f} s" in found[0]
        assert f"({before:.3g} m/s in the row before, {after:.3g} m/s in the row after)" in found[0]


def test_a_stop_needs_both_axles_and_their_radii() -> None:
    log = stop(5.0, 6.0)
    log.data["wheel_speed_front"] = 20.0 / 0.3
    assert find_false_stops(log, 0.3, 0.3, 0.5) == []
    log = stop(5.0, 6.0, 9.0, 9.0)
    assert find_false_stops(log, 0.1, 0.1, 0.5) == []  # 3 m/s
    # missing rows do not end a stop
    log = stop(5.0, 6.0)
    log.data.loc[260:270, ["wheel_speed_front", "wheel_speed_rear"]] = NAN
    assert len(find_false_stops(log, 0.3, 0.3, 0.5)) == 1


def pedal(torques=(), mass: float | None = 1500.0, **channels) -> list[str]:
    d = make_channels(**channels)
    force = 1500.0 * d["accel_x"]
    for axle, share in torques:
        d[f"wheel_torque_{axle}"] = share * force * {"front": 0.3, "rear": 0.36}[axle]
    v = 20.0 + np.cumsum(d["accel_x"]) * STEP
    return agree._check_pedals(d, v, {"front": 0.3, "rear": 0.36}, mass)


def test_a_brake_that_is_on_while_the_car_accelerates_is_named() -> None:
    rate = 3.0 * np.sin(0.6 * T)
    on, off = np.where(rate < -1, 1.0, 0.0), np.where(rate < -1, 0.0, 1.0)
    assert pedal(accel_x=rate, brake=on) == []
    first, second = pedal(accel_x=rate, brake=off)
    assert "on in 100 % of the rows in which the car gains speed" in first
    assert "off in 100 % of the rows in which the car brakes by more than 2 m/s2" in second
    (text,) = pedal(accel_x=rate, brake=np.zeros(len(T)))
    assert "brake is off in 100 %" in text
    assert pedal(accel_x=rate, brake=np.where(np.arange(len(T)) % 5 < 3, on, off)) == []  # mostly right
    assert pedal(accel_x=rate, brake=np.full(len(T), NAN)) == []


@pytest.mark.parametrize(
    ("torques", "is_said"),
    [
        ((("front", 0.6), ("rear", 0.4)), False),
        ((("front", 0.95), ("rear", 0.6)), False),  # 1.55
        ((("front", 1.0), ("rear", 0.65)), True),  # 1.65
        ((("front", 0.4), ("rear", 0.2)), True),  # 0.6
        ((("front", 0.4), ("rear", 0.25)), False),
        ((("front", -0.6), ("rear", -0.4)), True),
        ((("front", 0.3),), False),  # one axle alone may make a part
        ((("rear", 0.2),), True),
        ((("rear", 1.7),), True),
    ],
)
def test_torques_make_the_force_of_mass_and_acceleration(torques, is_said: bool) -> None:
    found = pedal(torques, accel_x=2.0 * np.sin(0.6 * T))
    assert bool(found) is is_said
    if is_said:
        share = sum(s for _, s in torques)
        assert f"is {share:.3g} times mass x accel_x" in found[0]
    assert pedal(torques, None, accel_x=2.0 * np.sin(0.6 * T)) == []


@pytest.mark.parametrize(
    ("name", "by", "is_said"),
    [
        ("ins_vel_x", 1.0, False),
        ("ins_vel_x", 1.24, False),
        ("ins_vel_x", 1.26, True),
        ("gnss_speed", 0.81, False),
        ("gnss_speed", 0.79, True),
    ],
)
def test_a_velocity_is_compared_with_the_wheels(name: str, by: float, is_said: bool) -> None:
    found = agree._check_velocity(make_log(**{name: lambda t, v, yaw: by * v}), 0.3, 0.3)
    assert bool(found) is is_said
    assert not is_said or f"{name} is {by:.3g} times the speed of the wheels" in found[0]


def test_a_velocity_that_is_missing_at_times_is_compared_where_it_is_there() -> None:
    log = make_log(ins_vel_x=lambda t, v, yaw: np.where(t < 30.0, v, NAN))
    assert agree._check_velocity(log, 0.3, 0.3) == []


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_lateral_velocity_changes_with_the_acceleration(sign: float) -> None:
    def slide(t: np.ndarray) -> np.ndarray:
        return 0.5 * np.sin(0.9 * t)

    log = make_log(
        ins_vel_y=lambda t, v, yaw: sign * slide(t),
        accel_y=lambda t, v, yaw: v * yaw + np.gradient(slide(t), t),
    )
    found = agree._check_velocity(log, 0.3, 0.3)
    assert len(found) == (sign < 0) and all("ins_vel_y changes in the opposite" in text for text in found)


def test_channels_are_resampled_at_20_hz_and_smoothed() -> None:
    log = make_log(vehicle_speed=lambda t, v, yaw: v, gnss_speed=lambda t, v, yaw: v)
    found = agree._smooth_channels(log)
    assert set(found) == {*log.data, "vehicle_speed"}
    time = np.arange(log.time[0], log.time[-1], 0.05)
    assert len(found["yaw_rate"]) == len(time)
    inner = slice(10, -10)
    # the mean of eight rows is that of half a row earlier
    np.testing.assert_allclose(
        found["yaw_rate"][inner], 0.15 * np.sin(0.7 * (time - 0.025))[inner], atol=3e-3
    )


# ---- The whole check


def check(log: CheckedLog, **more) -> list[str]:
    given = {"wheelbase": 2.7, "radius_front": 0.3, "radius_rear": 0.3, "ratio": 16.0} | more
    return check_units(log, **given)


def test_a_right_log_has_no_warning_and_a_short_one_is_not_checked() -> None:
    assert check(make_log()) == []
    wrong = make_log(0.98, accel_y=lambda t, v, yaw: -v * yaw)
    assert len(wrong) == 49 and check(wrong) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"accel_x": lambda t, v, yaw: -np.gradient(v, t)}, "accel_x is positive to the rear"),
        ({"accel_x": lambda t, v, yaw: np.gradient(v, t) / 9.81}, "accel_x is in g"),
        (
            {"steer_angle": lambda t, v, yaw: 3.5 * 2.7 * yaw / v * (1 + 0.002 * v**2)},
            "no unit that is often mixed up explains it; a wrong steering ratio or wheelbase",
        ),
        ({"vehicle_speed": lambda t, v, yaw: v / 3.6}, "(wheel speed x radius) / vehicle_speed is 3.6"),
    ],
)
def test_a_mistake_is_named(change: dict, words: str) -> None:
    (text,) = check(make_log(**change))
    assert words in text


def test_each_dimension_of_a_car_is_taken_for_its_own_axle(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(agree, "check_units", lambda *given: [repr(x) for x in given[1:]])
    car = make_default_vehicle()
    car.facts |= {"track_front": 1.5, "track_rear": 1.6, "steering_ratio": 14.0}
    config = Config(
        {"lf": 1.1, "lr": 1.6, "wheel_radius_front": 0.3, "wheel_radius_rear": 0.36, "mass": 1500}
    )
    wanted = ["2.7", "0.3", "0.36", "14.0", "{'front': 1.5, 'rear': 1.6}", "1500.0"]
    assert agree.check_car(make_log(), car, config) == wanted


def test_the_dimensions_of_a_car_are_those_of_its_file() -> None:
    car = make_default_vehicle()
    config = Config.exact()
    log = make_log(radius=config.wheel_radius_front)
    assert agree.check_car(log, car, config) == []
    long = Config.exact({"lf": 3.0, "lr": 3.5})
    (text,) = agree.check_car(log, car, long)
    assert "steer_angle / (wheelbase x yaw_rate / speed)" in text and "is 0.41" in text


def test_logs_that_agree_are_kept_and_the_others_named() -> None:
    good = make_log(radius=Config.exact().wheel_radius_front)
    bad = make_log(radius=Config.exact().wheel_radius_front, yaw_rate=lambda t, v, yaw: np.degrees(yaw) / 20)
    notes: list[str] = []
    found = read_agreeing([good, bad, good], notes, Reading())
    assert [log is good for log in found] == [True, True]
    assert len(notes) == 1 and notes[0].startswith("left out: log: channels contradict each other: check")
    missing = Path("/none/log.csv")
    with pytest.raises(UserError, match="no such file"):
        read_agreeing([missing, bad], [], Reading())
    with pytest.raises(UserError, match="channels contradict"):
        read_agreeing([bad, missing], [], Reading())
    assert read_agreeing([], [], Reading()) == []
