"""Kinematic relations, counters and clocks of groups, each function against values that
are computed by hand or by numpy."""

from pathlib import Path

import numpy as np
import pytest

from tse.channels import group_clocks, physics
from tse.channels.counters import find_modulo
from tse.readers.recording import Channel, Recording

STEP = 1.0 / physics.COMPARISON_RATE
T = np.arange(0.0, 40.0, STEP)


def test_a_moving_mean_is_over_eight_rows_and_missing_where_half_of_them_are() -> None:
    x = T.copy()
    x[100] = np.nan
    x[200:204] = np.nan
    found = physics.smooth(x)
    assert found[50] == pytest.approx(np.mean(x[46:54]))
    assert found[100] == pytest.approx(np.mean([*x[96:100], *x[101:104]]))  # the other seven
    assert np.flatnonzero(np.isnan(found[150:250])).tolist() == [50, 51, 52, 53, 54]  # four of eight
    assert np.isnan(found[0]) and np.isfinite(found[1])  # rows before the first count as missing


@pytest.mark.parametrize("slope", [2.5, -2.5])
def test_a_line_has_the_slope_between_both_regressions(slope: float) -> None:
    rng = np.random.default_rng(2)
    x = rng.normal(3.0, 1.0, 800)
    y = slope * x + 7.0 + rng.normal(0.0, 1.0, 800)
    keep = np.arange(800) >= 300
    y[::7], x[3::11] = np.nan, np.nan
    x[:300] = 100.0  # not kept
    good = keep & np.isfinite(x) & np.isfinite(y)
    up, across = np.polyfit(x[good], y[good], 1)[0], 1.0 / np.polyfit(y[good], x[good], 1)[0]
    found = physics.fit(x, y, keep)
    assert found.slope == pytest.approx(np.sign(slope) * np.sqrt(up * across), rel=1e-9)
    assert found.offset == pytest.approx(y[good].mean() - found.slope * x[good].mean(), rel=1e-9)
    assert found.corr == pytest.approx(np.corrcoef(x[good], y[good])[0, 1], rel=1e-9)
    assert found.rows == good.sum()


def test_a_line_needs_200_rows_and_two_channels_that_vary() -> None:
    x = np.arange(300.0)
    assert physics.fit(x[:200], x[:200]) == physics.LineFit(1.0, 0.0, 1.0, 200)
    assert physics.fit(x[:199], x[:199]) == physics.LineFit(rows=199)
    for a, b in ((x, np.full(300, 4.0)), (np.full(300, 4.0), x)):
        assert physics.fit(a, b) == physics.LineFit(rows=300)


def test_a_mean_of_signals_leaves_out_what_is_missing() -> None:
    nan = np.nan
    found = physics.average([np.array([1.0, nan, nan, 4.0]), np.array([3.0, 5.0, nan, -4.0])])
    np.testing.assert_array_equal(found, [2.0, 5.0, nan, 0.0])


def test_a_derivative_is_per_second() -> None:
    np.testing.assert_allclose(physics.differentiate(3.0 * T), 3.0)


@pytest.mark.parametrize("per", [43.2, -43.2])
def test_steering_has_the_sign_the_size_the_understeer_and_the_offset_of_its_model(per: float) -> None:
    v = 20.0 + 8.0 * np.sin(0.3 * T)
    r = 0.1 * np.sin(0.7 * T)
    angle = per * r / v * (1.0 + 0.0035 * v**2) + 0.4
    slow = T < 5.0
    v[slow], angle[slow] = 4.9, 50.0  # too slow to be compared
    found = physics.fit_steering(angle, v, r)
    assert found is not None
    assert found.per_curvature == pytest.approx(per, rel=0.01) and found.sd < 0.02
    assert found.understeer == pytest.approx(0.0035, abs=2e-4)
    assert found.offset == pytest.approx(0.4, abs=1e-3) and found.share > 0.9999


def test_steering_at_one_speed_is_known_as_far_as_the_understeer() -> None:
    """At 20 m/s, an sd of the understeer of 0.0012 s2/m2 is one of 0.0012 x 400 /
    (1 + 0.002 x 400) = 27 % of the angle per curvature."""
    v, r = np.full(len(T), 20.0), 0.1 * np.sin(0.7 * T)
    found = physics.fit_steering(43.2 * r / v * 1.8, v, r)
    assert found is not None and 0.2 < found.sd < 0.35
    assert found.per_curvature == pytest.approx(43.2, rel=0.05)


@pytest.mark.parametrize("case", ["straight", "constant angle", "slow", "backwards", "short"])
def test_steering_without_bends_or_motion_has_no_model(case: str) -> None:
    v, r = np.full(len(T), 20.0), 0.1 * np.sin(0.7 * T)
    angle = 40.0 * r / v
    if case == "straight":
        r = np.zeros(len(T))
    elif case == "constant angle":
        angle = np.ones(len(T))
    elif case in ("slow", "backwards"):
        v = np.full(len(T), 5.0 if case == "slow" else -20.0)
    else:
        angle[199:] = np.nan
    assert physics.fit_steering(angle, v, r) is None


@pytest.mark.parametrize("late", [0.06, -0.06])
def test_a_lag_is_positive_where_the_second_signal_comes_later(late: float) -> None:
    def move(t: np.ndarray) -> np.ndarray:
        return np.sin(0.9 * t) + 0.5 * np.sin(0.37 * t)

    keep = T > 5.0
    y = -2.0 * move(T - late) + 3.0
    other = np.cos(1.7 * T)
    y[~keep] = 100.0
    found, sd = physics.find_lag(move(T), y, keep)
    assert found == pytest.approx(late, abs=2e-3) and 0 <= sd < 0.01
    found, sd = physics.find_lag(move(T), y + 5.0 * other, keep, (other,))
    assert found == pytest.approx(late, abs=2e-3) and sd < 0.01
    assert physics.find_lag(move(T), y + 5.0 * other, keep)[1] > 0.1  # the other signal is noise


def test_the_sd_of_a_lag_is_that_of_its_noise() -> None:
    rng = np.random.default_rng(4)
    x = np.sin(0.9 * T)
    keep = np.ones(len(T), bool)
    found = np.array(
        [
            physics.find_lag(x, x + physics.smooth(rng.normal(0.0, 0.3, len(T))), keep & (T > 1))
            for _ in range(150)
        ]
    )
    assert 1.0 < np.mean(found[:, 1]) / np.std(found[:, 0]) < 2.0  # on the safe side


def test_no_lag_follows_from_a_constant_or_from_too_few_rows() -> None:
    x, keep = np.sin(T), np.arange(len(T)) < 199
    assert physics.find_lag(np.ones(len(T)), x, T >= 0) == (0.0, np.inf)
    assert physics.find_lag(x, x, keep) == (0.0, np.inf)


@pytest.mark.parametrize(
    ("latitude", "longitude", "speed"),
    [
        (48.0 + 1e-5 * np.arange(50), np.full(50, 9.0), 22.239),  # 1e-5 degrees x 111.19 km x 20 Hz
        (np.full(50, 60.0), 9.0 + 1e-5 * np.arange(50), 11.120),  # half as far at 60 degrees north
        (np.zeros(50), (180.0 + 1e-5 * np.arange(-25, 25) + 180.0) % 360.0 - 180.0, 22.239),
        (60.0 + 3e-6 * np.arange(50), 9.0 - 8e-6 * np.arange(50), 11.120),  # 3-4-5
    ],
)
def test_speed_over_ground_is_that_of_a_sphere(latitude, longitude, speed) -> None:
    np.testing.assert_allclose(physics.compute_ground_speed(latitude, longitude), speed, rtol=1e-3)


# ---- Counters


@pytest.mark.parametrize(
    ("counter", "modulo"),
    [
        (np.arange(200) % 16, 16),
        (np.arange(200) % 15 + 1, 15),
        (np.arange(200) % 4, 4),
        (np.r_[np.nan, np.arange(200) % 8], 8),
        (np.arange(100) % 2, 0),  # a toggle bit is no counter
        (-(np.arange(200) % 16), 0),
        (np.arange(200) % 16 - 1, 0),
        (np.full(100, 3), 0),
        (np.array([1.0]), 0),
        (np.array([]), 0),
        (np.arange(200)[::-1] % 16, 0),  # it counts down
        ((np.arange(400) * 7 // 10) % 16, 0),  # 70 % of the steps
        ((np.arange(400) * 9 // 10) % 16, 16),  # 90 % of them
    ],
)
def test_the_modulo_of_a_counter_is_that_with_which_it_goes_up_by_one(counter, modulo: int) -> None:
    assert find_modulo(np.asarray(counter, float)) == modulo


# ---- Clocks of groups


def make_groups(**parts: tuple[np.ndarray, dict[str, np.ndarray]]) -> Recording:
    """Return a recording. Key: its group. Value: times, and values by name."""
    channels = {
        f"{group}.{name}": Channel(f"{group}.{name}", time, value)
        for group, (time, values) in parts.items()
        for name, value in values.items()
    }
    return Recording(Path("log.mf4"), "MF4", channels)


def turn(t: np.ndarray) -> np.ndarray:
    """Return a yaw rate that does not repeat itself, rad/s."""
    return np.sin(0.31 * t) * np.sin(0.9 * t + 0.02 * t**2) + 0.4 * np.sin(1.3 * t)


@pytest.mark.parametrize("ahead", [3.27, -3.27])
@pytest.mark.parametrize("later", [0.0, 4.0, -2.0])
def test_a_shift_is_the_time_by_which_the_second_clock_is_ahead(ahead: float, later: float) -> None:
    """The second group starts `later`, s, which is no difference of the clocks."""
    a, b = np.arange(5.0, 65.0, 0.02), np.arange(5.0 + later, 65.0, 0.05)
    groups = [
        group_clocks.ClockGroup(1, [Channel("imu.YawRate", a, turn(a))]),
        group_clocks.ClockGroup(2, [Channel("gps.YawRate", b + ahead, -3.0 * turn(b) + 1.0)]),
    ]
    found = group_clocks._find_shift(*groups)
    assert found is not None
    assert found[0] == pytest.approx(ahead, abs=0.02) and found[1] > 0.99


@pytest.mark.parametrize(("ahead", "is_shifted"), [(0.0, False), (0.3, False), (0.9, True)])
def test_a_small_shift_is_a_latency_and_no_clock(ahead: float, is_shifted: bool) -> None:
    t = np.arange(0.0, 60.0, 0.02)
    recording = make_groups(
        imu=(t, {"YawRate": turn(t)}),
        wheels=(t + ahead, {"wheel_fl": 60.0 - turn(t), "wheel_fr": 60 + turn(t)}),
    )
    warnings: list[str] = []
    found, moved = group_clocks.align_clocks(recording, warnings)
    assert bool(moved) is bool(warnings) is is_shifted
    assert is_shifted or found is recording


def test_the_change_of_speed_aligns_an_accelerometer_and_a_speed_either_way() -> None:
    t = np.arange(0.0, 80.0, 0.02)
    v = 20.0 + 4.0 * np.cumsum(turn(t)) * 0.02
    push = group_clocks.ClockGroup(1, [Channel("imu.AccelX", t, 4.0 * turn(t))])
    speed = group_clocks.ClockGroup(2, [Channel("gps.Vehicle_Speed", t + 2.0, v)])
    for a, b, ahead in ((push, speed, 2.0), (speed, push, -2.0)):
        found = group_clocks._find_shift(a, b)
        assert found is not None and found[0] == pytest.approx(ahead, abs=0.06)


def test_the_clock_of_the_best_names_is_kept_and_the_other_moved_onto_it() -> None:
    t = np.arange(0.0, 60.0, 0.02)
    wheels = {"wheel_rl": 60.0 - turn(t), "wheel_rr": 60.0 + turn(t)}
    recording = make_groups(wheels=(t + 100.5, wheels), imu=(t, {"YawRate": turn(t), "LatAcc": 20 * turn(t)}))
    warnings: list[str] = []
    found, moved = group_clocks.align_clocks(recording, warnings)
    assert set(moved) == {"wheels.wheel_rl", "wheels.wheel_rr"}
    assert moved["wheels.wheel_rl"] == pytest.approx(100.5, abs=0.02)
    np.testing.assert_allclose(found.channels["wheels.wheel_rr"].time, t, atol=0.02)
    assert found.channels["imu.YawRate"].time is t
    assert found.channels["wheels.wheel_rl"].time is found.channels["wheels.wheel_rr"].time
    (text,) = warnings
    assert text.startswith("the clock of group 1 (wheel_rl, wheel_rr) does not overlap with that of group 2")
    assert ": 100.5 .. 160.5 s and 0.0 .. 60.0 s. It is" in text
    assert "100.50 s off, ahead of that of group 2" in text


def test_a_clock_behind_is_named_so_and_one_that_no_signal_aligns_is_unknown() -> None:
    t = np.arange(0.0, 60.0, 0.02)
    late = make_groups(imu=(t + 70.0, {"YawRate": turn(t)}), gps=(t, {"YawRate": turn(t)}))
    warnings: list[str] = []
    group_clocks.align_clocks(late, warnings)
    assert "70.00 s off, behind that of group 1" in warnings[0]
    still = make_groups(imu=(t + 70.0, {"YawRate": turn(t)}), env=(t, {"Temp": turn(t)}))
    warnings = []
    found, moved = group_clocks.align_clocks(still, warnings)
    assert found is still and moved == {} and warnings[0].endswith("the shift is unknown")
    near = make_groups(imu=(t + 7.0, {"YawRate": turn(t)}), env=(t, {"Temp": turn(t)}))
    warnings = []
    assert group_clocks.align_clocks(near, warnings) == (near, {}) and warnings == []


@pytest.mark.parametrize("format_", ["CSV", "BLF", "MF4"])
def test_only_formats_with_several_clocks_are_aligned(format_: str) -> None:
    t = np.arange(0.0, 60.0, 0.02)
    recording = make_groups(imu=(t, {"YawRate": turn(t)}), gps=(t + 9.0, {"YawRate": turn(t)}))
    recording.format = format_
    _, moved = group_clocks.align_clocks(recording, [])
    assert set(moved) == ({"gps.YawRate"} if format_ == "MF4" else set())


def test_groups_share_an_array_of_times_and_have_a_hundred_of_them() -> None:
    t = np.arange(0.0, 2.0, 0.02)
    recording = make_groups(a=(t, {"x": t, "y": t}), b=(t.copy(), {"x": t}), c=(t[:99].copy(), {"x": t[:99]}))
    groups = group_clocks._group_channels(recording)
    assert [(g.number, [c.name for c in g.channels]) for g in groups] == [(1, ["a.x", "a.y"]), (2, ["b.x"])]
    assert groups[0].describe() == "group 1 (x, y)"
    for names, said in (("abc", "group 3 (a, b, c)"), ("abcd", "group 3 (a, b, c, ...)")):
        assert group_clocks.ClockGroup(3, [Channel(f"m.{n}", t, t) for n in names]).describe() == said


def test_a_span_is_from_the_first_to_the_last_time() -> None:
    time = np.array([np.nan, 2.0, 1.5, 7.25, 3.0])
    assert group_clocks.ClockGroup(1, [Channel("x", time, time)]).span == (1.5, 7.25)


@pytest.mark.parametrize(("begin", "is_said"), [(49.9, False), (50.1, True), (-49.9, False), (-50.1, True)])
def test_spans_hardly_overlap_if_less_than_half_of_the_shorter_is_common(begin, is_said) -> None:
    a, b = (
        group_clocks.ClockGroup(i, [Channel("x", np.array(span), np.zeros(2))])
        for i, span in enumerate([(0.0, 100.0), (begin, begin + 100.0)])
    )
    said = group_clocks._describe_gap(a, b)
    assert said == (f"{begin:.1f} .. {begin + 100:.1f} s and 0.0 .. 100.0 s" if is_said else "")


def test_motion_is_turn_change_or_speed_by_the_best_signal_of_a_group() -> None:
    t = np.arange(3.0)
    wheels = {"wheel_fl": t, "wheel_fr": t + 5.0, "wheel_rl": t, "wheel_rr": t + 2.0}

    def find(**values: np.ndarray) -> dict[str, list[float]]:
        group = group_clocks.ClockGroup(1, [Channel(f"g.{n}", t, x) for n, x in values.items()])
        return {name: x.tolist() for name, (_, x) in group_clocks._find_motion(group).items()}

    assert find(**wheels) == {"turn": [2.0, 2.0, 2.0], "speed": t.tolist()}  # the rear axle
    assert find(yaw_rate=t + 1, LatAcc=t) == {"turn": (t + 1).tolist()}
    assert find(LatAcc=t + 3, steering_angle=t) == {"turn": (t + 3).tolist()}
    assert find(AccelX=t + 4, vehicle_speed=t) == {"change": (t + 4).tolist()}
    assert find(vehicle_speed=t + 6) == {"speed": (t + 6).tolist()}
    assert find(temperature=t) == {}


def test_a_signal_is_resampled_at_10_hz_without_its_mean() -> None:
    t = np.arange(0.0, 30.0, 0.01)
    begin, x = group_clocks._resample_evenly((t[::-1] + 7.0, 5.0 + np.sin(t[::-1])), False)
    at = begin + np.arange(len(x)) / 10.0
    assert begin == pytest.approx(7.5) and x.mean() == pytest.approx(0.0, abs=1e-12)
    exact = np.sin(at - 7.0)
    np.testing.assert_allclose(
        x, (exact - exact.mean()) * np.mean(np.cos([-0.2, -0.1, 0, 0.1, 0.2])), atol=2e-3
    )
    _, slope = group_clocks._resample_evenly((t, 3.0 * t**2), True)
    np.testing.assert_allclose(np.diff(slope), 0.6, atol=1e-6)  # 6 per s2 in steps of 0.1 s


@pytest.mark.parametrize("case", ["constant", "few", "long", "far"])
def test_a_signal_that_shows_no_motion_is_not_correlated(case: str) -> None:
    t = np.arange(0.0, 60.0, 0.02)
    x = np.sin(t)
    if case == "constant":
        x = np.ones(len(t))
    elif case == "few":
        t, x = np.linspace(0.0, 60.0, 99), np.sin(np.linspace(0.0, 60.0, 99))
    elif case == "long":
        t = t * 1e5
    else:
        t = t + 2e11
    assert group_clocks._resample_evenly((t, x), False) is None


def test_signals_that_start_at_different_times_correlate_without_a_shift() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    lag, corr, at_zero = group_clocks._correlate((3.0, turn(t)), (8.0, turn(t[50:])))
    assert lag == pytest.approx(0.0, abs=1e-3)
    assert corr == pytest.approx(1.0) and at_zero == pytest.approx(1.0)
    lag, corr, at_zero = group_clocks._correlate((0.0, turn(t)), (0.0, turn(t - 0.93)))
    assert lag == pytest.approx(0.93, abs=0.01) and corr > 0.95 and at_zero < 0.8
