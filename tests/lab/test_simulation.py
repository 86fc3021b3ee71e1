"""Manoeuvres, speed controller, log and truth of a simulation; the replay along a log.

Expected values are by hand. No drive is longer than a few seconds.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tse.library.core import Config, SimConfig
from tse.library.errors import UserError
from tse.log.rows import MEASURES, CheckedLog, list_columns
from tse.roads.road import Road
from tse.simulation import along, maneuvers
from tse.simulation.maneuvers import MANEUVERS, Maneuver, build
from tse.simulation.simulate import (
    HISTORIES,
    _follow_speed,
    add_references,
    compute_travelled,
    drive,
    simulate,
)

CAR = {
    "mass": 1500.0,
    "lf": 1.0,
    "lr": 1.5,
    "wheel_radius_front": 0.3,
    "wheel_radius_rear": 0.35,
    "cornering_stiffness_front": 1e5,
    "cornering_stiffness_rear": 1.5e5,
}
UNDERSTEER = 0.005  # rad s2/m: 1500/2.5 (1.5/1e5 - 1/1.5e5)
QUIET = {"noise": 0.0, "spread_cx_front": 0.0, "spread_cy_front": 0.0, "spread_cy_rear": 0.0}


def make_maneuver(name: str, duration: float, **more) -> Maneuver:
    return build(name, Config.exact(CAR), sample_time=0.01, duration=duration, **more)


def get_at(m: Maneuver, values: np.ndarray, *times: float) -> list[float]:
    return [float(values[round(t / 0.01)]) for t in times]


# ---- manoeuvres


def test_a_square_wave_is_high_in_the_first_half_of_each_period():
    t = np.cumsum(np.full(80, 0.05)) - 0.05  # with rounding errors
    high = [maneuvers.make_square(t, 1.0)[k] for k in (0, 9, 10, 19, 20, 29, 30, 60)]
    assert high == [1, 1, -1, -1, 1, 1, -1, 1]


def test_the_square_waves_have_their_own_periods_and_only_the_front_axle_drives():
    m = make_maneuver("square-waves", 20.0, amplitude=0.01)
    assert get_at(m, m.steer_angle, 0, 1.99, 2, 3.99, 4) == [0.01, 0.01, -0.01, -0.01, 0.01]
    assert get_at(m, m.wheel_torque_front, 0, 2.49, 2.5, 4.99, 5) == [700, 700, -700, -700, 700]
    assert not m.wheel_torque_rear.any() and m.target_speed is None and m.brake_torque_front is None


def test_a_double_lane_change_goes_left_and_back_between_acceleration_and_braking():
    m = make_maneuver("double-lane-change", 24.0, amplitude=0.03)
    quarter = 2.5 / 4
    assert get_at(m, m.steer_angle, 3 + quarter, 3 + 3 * quarter, 6 + quarter) == pytest.approx(
        [0.03, -0.03, -0.03], rel=1e-3
    )
    assert not any(get_at(m, m.steer_angle, 0, 2.99, 5.6, 5.99, 8.6, 11.9, 12.5))
    assert get_at(m, m.steer_angle, 15 + quarter) == pytest.approx([0.03], rel=1e-3)
    push = np.array(get_at(m, m.wheel_torque_front, 0, 2.99, 3.0, 8.99, 9.0, 10.99, 11.0, 12.0))
    assert push / (1500 * 0.3) == pytest.approx([1.2, 1.2, 0, 0, -1.75, -1.75, 0, 1.2])


def test_a_step_of_the_steering_is_a_ramp_of_a_fifth_of_a_second_after_one_second():
    m = make_maneuver("step-steer", 3.0, amplitude=0.02, speed=25.0)
    assert get_at(m, m.steer_angle, 0.5, 1.0, 1.1, 1.2, 3.0) == pytest.approx([0, 0, 0.01, 0.02, 0.02])
    assert (m.target_speed == 25).all() and m.speed == 25


def test_a_sweep_has_the_periods_of_its_first_and_last_frequency():
    m = make_maneuver("sine-sweep", 40.0, amplitude=0.02)
    assert np.abs(m.steer_angle).max() == pytest.approx(0.02, rel=1e-2)
    turns = (3.0 - 0.2) * 40 / np.log(15)  # integral of the frequency
    crossings = m.time[1:][np.diff(np.signbit(m.steer_angle)) != 0]
    assert len(crossings) == int(2 * turns)
    assert crossings[-1] - crossings[-3] == pytest.approx(1 / 3.0, abs=0.02)
    assert m.steer_angle[1] > 0 and 2.2 < crossings[1 if crossings[0] < 0.1 else 0] < 2.5
    assert (m.target_speed == 20).all()


def test_the_understeer_is_that_of_the_steady_circle():
    assert maneuvers.compute_understeer(Config.exact(CAR)) == pytest.approx(UNDERSTEER)
    swapped = CAR | {"cornering_stiffness_front": 1.5e5, "cornering_stiffness_rear": 1e5}
    assert maneuvers.compute_understeer(Config.exact(swapped)) == 0  # load over stiffness is equal


@pytest.mark.parametrize(("speed", "end"), [(8.0, 16.0), (None, 16.0), (20.0, 20.0)])
def test_on_a_circle_the_speed_rises_to_4_m_s2_and_the_steering_follows(speed, end):
    m = make_maneuver("constant-radius", 10.0, amplitude=64.0, speed=speed)
    begin = speed or 8.0
    assert get_at(m, m.target_speed, 0, 5, 10) == pytest.approx([begin, (begin + end) / 2, end])
    steer = [(2.5 + UNDERSTEER * v**2) / 64 for v in (begin + 0.1 * (end - begin), end)]
    assert get_at(m, m.steer_angle, 0, 1, 10) == pytest.approx([0, steer[0] / 2, steer[1]])


def test_straight_has_the_amplitude_as_sd_of_the_steering_and_half_a_metre_a_second_of_speed():
    m, other = (make_maneuver("straight", 60.0, amplitude=0.002, seed=s) for s in (3, 4))
    assert m.steer_angle.std() == pytest.approx(0.002)
    assert m.target_speed.std() == pytest.approx(0.5) and abs(m.target_speed.mean() - 30) < 1
    assert (m.steer_angle != other.steer_angle).any()
    assert (m.steer_angle == make_maneuver("straight", 60.0, amplitude=0.002, seed=3).steer_angle).all()
    assert len(make_maneuver("straight", 0.0).time) == 1


def test_stop_and_go_accelerates_brakes_rests_and_bends_to_either_side():
    m = make_maneuver("stop-and-go", 40.0)
    assert get_at(m, m.target_speed, 0, 3, 6, 10, 12.5, 15, 19, 23) == pytest.approx(
        [0, 6, 12, 12, 6, 0, 0, 6]
    )
    assert get_at(m, m.steer_angle, 8, 28) == pytest.approx([0.03, -0.03])
    assert not any(get_at(m, m.steer_angle, 0, 4.9, 11.1, 17, 19, 24.9, 31.1))
    assert m.speed == 0


def test_corrections_of_a_driver_are_as_slow_as_their_two_filters_and_start_at_full_size():
    memory, step = 0.1, 0.01
    x = maneuvers._make_coloured(np.random.default_rng(1), 100_000, step, memory)
    assert x.std() == pytest.approx(1)
    lag = round(memory / step)
    # two first-order filters with time constants T and 0.3 T
    expected = (np.exp(-1) - 0.3 * np.exp(-1 / 0.3)) / 0.7
    assert np.mean(x[lag:] * x[:-lag]) == pytest.approx(expected, abs=0.04)
    first = [maneuvers._make_coloured(np.random.default_rng(k), 2000, step, 1.0)[0] for k in range(150)]
    assert np.sqrt(np.mean(np.square(first))) == pytest.approx(1, abs=0.25)


@pytest.mark.parametrize(
    ("road", "expected"),
    [
        (None, [1, 1, 1, 1, 1]),
        ([(2.0, 0.4)], [1, 1, 0.4, 0.4, 0.4]),
        ([(1.0, 0.7), (3.0, 1.2)], [1, 0.7, 0.7, 1.2, 1.2]),
        ([(3.0, 1.2), (1.0, 0.7)], [1, 0.7, 0.7, 1.2, 1.2]),
        ([(0.0, 0.5)], [0.5] * 5),
    ],
)
def test_each_change_of_the_road_acts_from_its_time_on_in_whatever_order(road, expected):
    m = make_maneuver("square-waves", 4.0, road=road)
    assert get_at(m, m.road_level, 0, 1, 2, 3, 4) == expected
    if expected[1] != expected[0]:
        assert get_at(m, m.road_level, 0.99) == [expected[0]]


def test_what_is_given_replaces_the_default_also_if_it_is_zero():
    m = build("square-waves", Config.exact(CAR), sample_time=0.02, duration=1.0, speed=0.0, amplitude=0.0)
    assert (len(m.time), m.time[-1], m.speed) == (51, 1.0, 0.0) and not m.steer_angle.any()
    assert m.time[1] == 0.02
    m = build("square-waves", Config.exact(CAR), sample_time=0.02)
    kind = MANEUVERS["square-waves"]
    assert (m.time[-1], m.speed, np.abs(m.steer_angle).max()) == (kind.duration, kind.speed, kind.amplitude)
    with pytest.raises(UserError, match=r"no manoeuvre 'u-turn'; known: square-waves, double"):
        build("u-turn", Config.exact(CAR), sample_time=0.01)


# ---- the speed controller


def follow(target, now: float, i: int = 0, front: float = 1.0) -> list[float]:
    """Return torques of row i: drive front and rear, brake front and rear."""
    target = np.asarray(target, float)
    n = len(target)
    zero = np.zeros(n)
    m = Maneuver(0.1 * np.arange(n), 0.0, zero, zero, zero, zero, target)
    names = ("wheel_torque_front", "wheel_torque_rear", "brake_torque_front", "brake_torque_rear")
    inputs = np.zeros(n, [(name, float) for name in names])
    _follow_speed(inputs, i, m, now, Config.exact(CAR), front)
    return [float(inputs[name][i]) for name in names]


@pytest.mark.parametrize(
    ("target", "now", "i", "front", "drive_", "brake", "hold"),
    [
        ([10, 10], 9.5, 0, 1.0, 1.0, 0, 0),  # twice the error of the speed
        ([10, 10], 10.5, 0, 1.0, 0, 1.0, 0),
        ([10, 10.1], 10, 0, 1.0, 1.0, 0, 0),  # 0.1 m/s in 0.1 s ahead
        ([9, 10, 10.2, 11], 10, 1, 1.0, 2.0, 0, 0),  # the next row, no other
        ([9, 10], 10, 1, 1.0, 0, 0, 0),  # nothing is ahead of the last row
        ([10, 10], 9.5, 0, 0.0, 1.0, 0, 0),
        ([10, 10], 9.5, 0, 0.5, 1.0, 0, 0),
        ([20, 20], 10, 0, 1.0, 4.0, 0, 0),  # limits
        ([10, 10], 20, 0, 1.0, 0, 6.0, 0),
        ([0, 0], 0.0, 0, 1.0, 0, 0, 300),  # stands
        ([0, 0], 0.4, 0, 1.0, 0, 0.8, 300),
        ([0, 0], 0.6, 0, 1.0, 0, 1.2, 0),  # still rolls
        ([0.06, 0.06], 0.06, 0, 1.0, 0, 0, 0),  # is to go
    ],
)
def test_torques_give_the_demanded_acceleration_on_the_driven_axle(
    target, now, i, front, drive_, brake, hold
):
    expected = [
        1500 * drive_ * front * 0.3,
        1500 * drive_ * (1 - front) * 0.35,
        1500 * brake * 0.6 * 0.3 + hold,
        1500 * brake * 0.4 * 0.35 + hold,
    ]
    assert follow(target, now, i, front) == pytest.approx(expected)


@pytest.mark.parametrize(("axle", "share"), [("front", 1.0), ("rear", 0.0), ("both", 0.5)])
def test_the_driven_axle_gets_the_drive_torque(axle, share):
    m = replace(make_maneuver("step-steer", 0.1), target_speed=np.full(11, 20.5))
    inputs, _ = drive(m, Config.exact(CAR), SimConfig(QUIET), axle)
    force = inputs["wheel_torque_front"] / 0.3, inputs["wheel_torque_rear"] / 0.35
    assert force[0][0] == pytest.approx(1500 * share) and force[1][0] == pytest.approx(1500 * (1 - share))
    assert not inputs["brake_torque_front"].any()


# ---- drives


def make_road(**more) -> Road:
    """Return 3 m of road that begins at 100 m; its grade is unknown after 101 m."""
    s = np.array([100.0, 101.0, 102.0, 103.0])
    sd = np.full(4, 0.001)
    path = more or {"curvature": np.zeros(4)}
    return Road(s, 0.01 * (s - 99), np.array([0.02, 0.02, np.nan, np.nan]), sd, sd, **path)


def test_a_drive_has_the_inputs_of_its_manoeuvre_and_starts_at_its_speed():
    m = make_maneuver("square-waves", 0.2, speed=17.0, road=[(0.1, 0.5)])
    m.time = m.time + 5.0
    m.road_friction = np.linspace(0.5, 1, 21)
    m.brake_torque_rear = np.full(21, 7.0)
    inputs, outputs = drive(m, Config.exact({**CAR, "sample_time": 0.02}), SimConfig(QUIET))
    assert inputs["dt"][:3] == pytest.approx([0.02, 0.01, 0.01])  # the first row: the setting
    for name in HISTORIES[:3] + HISTORIES[4:]:
        assert inputs[name] == pytest.approx(getattr(m, name)), name
    assert inputs["road_friction"] == pytest.approx(m.road_friction)
    assert not inputs["brake_torque_front"].any() and not inputs["bank"].any()
    assert outputs["true_vel_x"][0] == pytest.approx(17.0, abs=0.1)


def test_the_way_is_the_sum_of_speed_and_time_before_each_row():
    inputs = np.zeros(4, [("dt", float)])
    outputs = np.zeros(4, [("true_vel_x", float)])
    inputs["dt"], outputs["true_vel_x"] = [0.5, 0.1, 0.2, 0.4], [10, 20, 30, 99]
    assert compute_travelled(inputs, outputs) == pytest.approx([0, 1, 5, 17])


def test_bank_and_grade_are_those_of_the_place_and_level_where_nothing_is_known():
    m = make_maneuver("step-steer", 0.3, amplitude=0.0)
    road = make_road()
    inputs, outputs = drive(m, Config.exact(CAR), SimConfig(QUIET), road=road)
    s = compute_travelled(inputs, outputs)
    assert s[-1] > 5 and inputs["bank"][0] == pytest.approx(0.01)
    inside = s < 3
    np.testing.assert_allclose(inputs["bank"], np.where(inside, 0.01 + 0.01 * s, 0), atol=1e-7)
    assert inputs["grade"][s < 1] == pytest.approx(0.02) and not inputs["grade"][s > 1].any()


@pytest.mark.parametrize("kind", ["local", "global", "none"])
def test_the_log_has_the_positions_that_the_road_has(kind):
    x = np.array([7.0, 8.0, 9.0, 10.0])
    path = {
        "local": {"x": x, "y": -2 * x},
        "global": {"latitude": 48 + 1e-5 * x, "longitude": 9 + 2e-5 * x},
        "none": {},
    }[kind]
    road = make_road(**path)
    found = simulate(
        make_maneuver("step-steer", 0.1, amplitude=0.0), Config.exact(CAR), SimConfig(QUIET), road=road
    )
    s = found.truth["true_distance"].to_numpy()
    expected = {
        "local": {"ref_east": 7 + s, "ref_north": -14 - 2 * s},
        "global": {"gnss_latitude": 48 + 1e-5 * (7 + s), "gnss_longitude": 9 + 2e-5 * (7 + s)},
        "none": {},
    }[kind]
    assert set(found.log) - set(list_columns()) == set(expected)
    for name, values in expected.items():
        np.testing.assert_allclose(found.log[name], values, atol=1e-9, rtol=0)
    assert found.truth["true_bank"].to_numpy() == pytest.approx(0.01 * (1 + s), abs=1e-7)
    assert found.truth["true_grade"][0] == pytest.approx(0.02)


def test_the_truth_is_in_the_units_of_the_vehicle_file_and_the_references_are_copies_of_it():
    config = Config.exact(CAR)
    m = make_maneuver("square-waves", 0.1, road=[(0.05, 0.5)])
    found = simulate(m, config, SimConfig({**QUIET, "true_cy_front": 0.8, "true_cx_front": 0.9}))
    truth = found.truth.iloc[0]
    assert truth["true_cy_front"] == pytest.approx(0.8 * 1e5)
    assert truth["true_cy_rear"] == pytest.approx(1.5e5)
    assert truth["true_cx_front"] == pytest.approx(0.9 * config.longitudinal_stiffness_front)
    assert found.truth["true_cy_rear"].iloc[-1] == pytest.approx(0.75e5)
    assert set(list_columns()) & set(found.truth) == {"time"} and list(found.log) == list_columns()
    assert (found.truth["wheel_torque_front"] == 700).all() and found.truth["road_level"][9] == 0.5
    log = add_references(found)
    assert list(log)[len(found.log.columns) :] == [
        "ref_vel_x",
        "ref_vel_y",
        "ref_yaw_rate",
        "ref_cx_front",
        "ref_cy_front",
        "ref_cy_rear",
    ]
    for column in ("vel_x", "vel_y", "yaw_rate", "cx_front", "cy_front", "cy_rear"):
        assert (log[f"ref_{column}"] == found.truth[f"true_{column}"]).all()
    assert found.log["accel_y"].to_numpy() == pytest.approx(found.truth["true_accel_y"].to_numpy())


# ---- the replay along a log


def make_log(seconds: float = 2.0, **columns: np.ndarray) -> CheckedLog:
    """Return a log of slow turns at 20 m/s; `columns` replace channels or are extra."""
    t = np.round(np.arange(0, seconds, 0.01), 9)
    wheel = np.full(len(t), 20.0)
    data = {
        "steer_angle": 0.02 * np.sin(2 * np.pi * t / 2.0),
        "wheel_speed_front": wheel / 0.3,
        "wheel_speed_rear": wheel / 0.35,
        "accel_x": 0 * t,
        "accel_y": 0 * t,
        "yaw_rate": 0.01 + 0 * t,
    }
    data |= {k: v for k, v in columns.items() if k in data}
    extra = pd.DataFrame({k: v for k, v in columns.items() if k not in data}, index=range(len(t)))
    return CheckedLog(
        Path("log.csv"), t, pd.DataFrame(data), pd.DataFrame(), np.arange(len(t)), 0.01, extra=extra
    )


@pytest.mark.parametrize(
    ("by", "expected"), [(0.0, [0, 1, 4, 9]), (0.5, [0.5, 2.5, 6.5, 9]), (-1.0, [0, 0, 1, 4])]
)
def test_a_shifted_channel_has_the_value_of_a_later_time(by, expected):
    t = np.arange(4.0)
    assert along._shift_channel(t, t**2, by) == pytest.approx(expected)


def test_a_logged_road_replaces_that_of_the_settings_where_it_has_values():
    log = make_log(0.04, bank=[0.05, np.nan, 0.05, np.nan], grade=[0.03, 0.03, np.nan, np.nan])
    given = Config.exact({**CAR, "bank_angle": 0.02, "grade_angle": -0.01, "bank_superelevation": 0.5})
    inputs = {"wheel_speed_rear": np.full(4, 20 / 0.35)}
    config, road = along._derive_road(log, given, inputs)
    lean = -0.5 * 20 * 0.01 / 9.80665
    assert road["bank"] == pytest.approx([0.03, lean, 0.03, lean], rel=1e-3)
    assert road["grade"] == pytest.approx([0.04, 0.04, 0, 0])
    assert (config.bank_superelevation, given.bank_superelevation) == (0.0, 0.5)
    still = make_log(0.02, bank=[np.nan, np.nan], yaw_rate=np.full(2, np.nan))
    assert not along._derive_road(still, given, {"wheel_speed_rear": np.full(2, 50.0)})[1]["bank"].any()
    steep = make_log(0.02, bank=[np.nan, np.nan], yaw_rate=np.full(2, 5.0))
    assert along._derive_road(steep, given, {"wheel_speed_rear": np.full(2, 50.0)})[1][
        "bank"
    ] == pytest.approx(-0.35)
    config, road = along._derive_road(make_log(0.02, grade=[0.1, 0.1]), given, inputs)
    assert set(road) == {"grade"} and config.bank_superelevation == 0.5
    assert along._derive_road(make_log(0.02), given, inputs)[1] == {}


@pytest.mark.parametrize("late", [0.0, 0.05])
def test_a_late_steering_angle_is_read_where_it_acted_and_a_late_gyro_is_simulated_late(late):
    plain = make_log()
    table = along.simulate_along(plain, Config.exact(CAR))
    rows = slice(20, 180)
    shifted = np.interp(plain.time - late, plain.time, plain.data["steer_angle"])
    found = along.simulate_along(
        make_log(steer_angle=shifted),
        Config.exact({**CAR, "steer_angle_latency": late, "accel_y_latency": 0.03}),
    )
    assert table["yaw_rate_simulated"].std() > 0.01
    for name, delay in (("yaw_rate_simulated", 0), ("accel_y_simulated", 3), ("vel_y", 0)):
        wanted = table[name].to_numpy()[rows.start - delay : rows.stop - delay]
        np.testing.assert_allclose(found[name].to_numpy()[rows], wanted, atol=2e-4)
    assert (table["yaw_rate"] == 0.01).all() and list(table)[:4] == ["time", *MEASURES]


@pytest.mark.parametrize("name", ["steer_angle", "wheel_speed_rear"])
def test_a_replay_needs_every_input(name):
    with pytest.raises(UserError, match=f"the log has no values of {name}"):
        along.simulate_along(make_log(0.1, **{name: np.full(10, np.nan)}), Config.exact(CAR))
    hole = np.where(np.arange(10) == 4, np.nan, 50.0 if "wheel" in name else 0.0)
    table = along.simulate_along(make_log(0.1, **{name: hole}), Config.exact(CAR))
    assert np.isfinite(table["yaw_rate_simulated"]).all()


def make_misfit_table() -> pd.DataFrame:
    """Return 2000 rows, of which 1000 are fast, 250 of them backwards."""
    rng = np.random.default_rng(1)
    n = 2000
    speed = np.repeat([10.0, 3.0, -10.0, 0.0], [750, 500, 250, 500])
    table = {"time": 0.01 * np.arange(n), "vel_x": speed}
    fast = np.abs(speed) > 3
    for c in MEASURES:
        table[f"{c}_simulated"] = np.zeros(n)
        table[c] = np.where(fast, 0.2 * np.sign(speed) + 0.5 * np.sin(2 * np.pi * np.arange(n) / 250), 50.0)
    table["accel_x"] = table["accel_x"] + 0.05 * rng.standard_normal(n)
    table["yaw_rate"] = np.where(fast, np.nan, 1.0)
    return pd.DataFrame(table)


def test_a_misfit_is_that_of_fast_rows_about_its_mean_and_over_the_noise_of_its_channel():
    found = along.measure_misfit(make_misfit_table())
    assert found["accel_y"].mean == pytest.approx(0.1) and found["accel_y"].unit == "m/s2"
    rms = np.sqrt(0.5**2 / 2 + 0.2**2 - 0.1**2)  # sine and two levels
    assert found["accel_y"].rms == pytest.approx(rms)
    assert found["accel_x"].rms == pytest.approx(np.hypot(rms, 0.05), rel=0.02)
    assert found["accel_x"].over_noise == pytest.approx(found["accel_x"].rms / 0.05, rel=0.15)
    assert np.isnan(found["yaw_rate"].rms) and found["yaw_rate"].unit == "rad/s"


def test_a_misfit_is_said_with_unit_noise_and_speed():
    lines = along.describe_misfit(
        {
            "accel_x": along.ModelMisfit(0.254, 3.14, -0.05, "m/s2"),
            "accel_y": along.ModelMisfit(0.254, np.nan, 0.05, "m/s2"),
            "yaw_rate": along.ModelMisfit(np.nan, np.nan, np.nan, "rad/s"),
        }
    )
    assert lines == (
        "accel_x: measured minus simulated: rms 0.254 m/s2 about the mean, 3.1 times the sensor noise; "
        "mean -0.05 m/s2; rows above 3 m/s",
        "accel_y: measured minus simulated: rms 0.254 m/s2 about the mean, mean 0.05 m/s2; rows above 3 m/s",
        "yaw_rate: not compared: the log has no values above 3 m/s",
    )


def test_curves_are_measured_and_simulated_of_each_channel():
    table = make_misfit_table()
    table["accel_y_simulated"] = 7.0
    curves = along.list_curves(table)
    assert [title for title, _ in curves] == ["accel_x [m/s2]", "accel_y [m/s2]", "yaw_rate [rad/s]"]
    (name, t, y), (other, _, z) = curves[1][1]
    assert (name, other) == ("accel_y measured", "accel_y simulated")
    assert y is not z and (z == 7).all() and (t == table["time"]).all() and y[800] == 50
