"""The profile of a road: its file, and the match of a log with it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import tse
from conftest import tselab
from tse.car.vehicle import list_vehicle_settings
from tse.channels.log import read_frame, read_log
from tse.identify.knots import KNOT_DISTANCE, Knots
from tse.identify.laps import find_laps, make_profile
from tse.library.core import Config
from tse.library.errors import NoFile, UserError
from tse.roads.road import Road, compute_curvature, make_road, read_road, write_road
from tse.roads.road_match import derive_track, match_by_path, match_by_position, match_common, match_log

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
RADIUS = 0.3  # m, of the wheels of these logs
CAR = Config.exact({"wheel_radius_front": RADIUS, "wheel_radius_rear": RADIUS})
TEXT = """distance,bank,grade,bank_sd,grade_sd,x,y
0,0.02,0.01,0.004,0.005,0,0
10,0.04,,0.004,,10,0
20,-0.03,0.00,0.004,0.005,20,1
"""


def write_road_file(tmp_path, text=TEXT):
    path = tmp_path / "road.csv"
    path.write_text(text, encoding="utf-8")
    return path


def make_winding_road(length, seed, step=1.0):
    """Return distance, m, and curvature, 1/m, of a winding road.

    Its bends are random, 20 .. 60 m long, with 1/40 1/m at most.
    """
    rng = np.random.default_rng(seed)
    s = np.arange(0.0, length + step, step)
    knots = np.cumsum(rng.uniform(20.0, 60.0, int(length / 20)))
    return s, np.interp(s, knots, rng.uniform(-0.025, 0.025, len(knots)))


def make_circuit():
    """Return distance, m, and curvature, 1/m, of a circuit of 1500 m.

    Polar form: r = 1 + 0.2 sin 3 phi + 0.1 cos 5 phi.
    """
    phi = np.linspace(0.0, 2 * np.pi, 20001)
    r = 1 + 0.2 * np.sin(3 * phi) + 0.1 * np.cos(5 * phi)
    r1 = 0.6 * np.cos(3 * phi) - 0.5 * np.sin(5 * phi)
    r2 = -1.8 * np.sin(3 * phi) - 2.5 * np.cos(5 * phi)
    size = np.hypot(r, r1)
    s = np.concatenate([[0.0], np.cumsum(0.5 * (size[1:] + size[:-1]) * np.diff(phi))])
    unit = 1500.0 / s[-1]
    at = np.arange(0.0, 1501.0)
    return at, np.interp(at, unit * s, (r**2 + 2 * r1**2 - r * r2) / size**3 / unit)


def compute_path(s, bend, x0=0.0):
    heading = np.concatenate([[0.0], np.cumsum(0.5 * (bend[1:] + bend[:-1]) * np.diff(s))])
    middle = 0.5 * (heading[1:] + heading[:-1])
    return x0 + np.concatenate([[0.0], np.cumsum(np.cos(middle) * np.diff(s))]), np.concatenate(
        [[0.0], np.cumsum(np.sin(middle) * np.diff(s))]
    )


def simulate_drive(s, bend, begin=0.0, end=None, radius=1.0, bias=0.0, closed=False, seed=1, **columns):
    """Return a log of a drive along a road at 12 .. 18 m/s, and the true distance of its
    rows.

    `radius`: true wheel radius over the nominal one.
    """
    rng = np.random.default_rng(seed)
    end = float(s[-1] if end is None else end)
    t = np.arange(0.0, (end - begin) / 12.0, 0.02)
    v = 15.0 + 3.0 * np.sin(0.1 * t)
    at = begin + np.concatenate([[0.0], np.cumsum(v[:-1] * 0.02)])
    t, v, at = t[at < end], v[at < end], at[at < end]
    turn = np.interp(np.mod(at, s[-1]) if closed else at, s, bend)
    wheel = v / (RADIUS * radius)
    data = {"time": t, "steer_angle": 2.7 * turn, "wheel_speed_front": wheel, "wheel_speed_rear": wheel,
            "accel_x": 0.3 * np.cos(0.1 * t), "accel_y": v**2 * turn + 0.1 * rng.standard_normal(len(t)),
            "yaw_rate": v * turn + bias + 0.005 * rng.standard_normal(len(t))}  # fmt: skip
    data |= {name: f(at) for name, f in columns.items()}
    return read_frame(data, f"drive {seed}"), at


def make_plain_road(s, bend, **more):
    return make_road(s, curvature=bend, **more)


# ---- the file


def test_a_road_is_read_as_it_stands_in_the_file(tmp_path):
    road = read_road(write_road_file(tmp_path))
    assert road.distance.tolist() == [0.0, 10.0, 20.0]
    assert road.bank.tolist() == [0.02, 0.04, -0.03]
    assert np.isnan(road.grade[1]) and road.grade[2] == 0.0
    assert not road.is_closed


def test_what_is_written_is_read_again(tmp_path):
    s, bend = make_circuit()
    profile = (
        0.03 * np.sin(s / 100),
        0.02 * np.cos(s / 150),
        np.full(len(s), 0.004),
        np.full(len(s), np.nan),
    )
    x, y = compute_path(s, bend)
    road = Road(s, *profile, x, y, 45 + y / 111e3, 8 + x / 79e3, bend, True)
    write_road(road, tmp_path / "road.csv")
    again = read_road(tmp_path / "road.csv")
    assert again.is_closed and again.length == road.length
    for name, digits in (
        ("distance", 3),
        ("bank", 6),
        ("grade", 6),
        ("bank_sd", 6),
        ("grade_sd", 6),
        ("x", 3),
        ("y", 3),
        ("latitude", 9),
        ("longitude", 9),
        ("curvature", 6),
    ):
        np.testing.assert_allclose(
            getattr(again, name), getattr(road, name), rtol=0, atol=0.51 * 10.0**-digits
        )


@pytest.mark.parametrize(
    "was, becomes, said",
    [
        ("0,0.02", "0,0.36", "line 2, column bank: 0.36 is outside the allowed range -0.35 .. 0.35 rad"),
        (
            "20,-0.03,0.00",
            "20,-0.03,-0.5",
            "line 4, column grade: -0.5 is outside the allowed range -0.35 .. 0.35 rad",
        ),
        (
            "10,0.04",
            "10,two",
            "line 3, column bank: 'two' is not a number; allowed: -0.35 .. 0.35 rad; only bank, grade, "
            "bank_sd and grade_sd may be empty",
        ),
        ("20,-0.03", "10,-0.03", "line 4, column distance: 10 m is not greater than 10 m in the row before"),
        ("10,0.04", ",0.04", "line 3, column distance: is empty"),
        ("distance,", "way,", "column distance is missing in the header"),
        ("bank,grade,", "lean,slope,", "column bank or grade is needed"),
        ("x,y", "x,z", "column y is missing: give both x and y, or neither"),
        ("x,y", "u,v", "column curvature, or x and y, or latitude and longitude are needed"),
        ("x,y", "x,x", "column x appears twice"),
        (
            "10,0.04,,0.004,,10,0\n20,-0.03,0.00,0.004,0.005,20,1\n",
            "",
            "has 1 rows; a road needs at least two",
        ),
    ],
)
def test_a_wrong_file_is_refused_by_name_line_column_and_range(tmp_path, was, becomes, said):
    assert was in TEXT
    path = write_road_file(tmp_path, TEXT.replace(was, becomes, 1))
    with pytest.raises(UserError) as error:
        read_road(path)
    assert str(path) in str(error.value) and said in str(error.value)


@pytest.mark.parametrize("closed", [("0", "1", "1"), ("", "", ""), ("1", "", "1"), ("2", "2", "2")])
def test_closed_is_0_or_1_and_the_same_in_every_row(tmp_path, closed):
    rows = ["distance,bank,curvature,closed", *(f"{10 * n},0.01,0.001,{c}" for n, c in enumerate(closed))]
    with pytest.raises(UserError, match="column closed: "):
        read_road(write_road_file(tmp_path, "\n".join(rows) + "\n"))


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(NoFile, match=r"nowhere\.csv: no such file"):
        read_road(tmp_path / "nowhere.csv")


def test_a_refused_road_leaves_the_file_as_it_was(tmp_path):
    path = write_road_file(tmp_path)
    with pytest.raises(UserError, match="not greater than"):
        write_road(replace(read_road(path), distance=np.array([0.0, 1.0, 0.5])), path)
    assert path.read_text() == TEXT


# ---- places


def test_a_place_lies_between_its_neighbours(tmp_path):
    road = read_road(write_road_file(tmp_path))
    np.testing.assert_allclose(road.interpolate("bank", [-1.0, 0.0, 2.5, 15.0, 20.0, 21.0, np.nan]),
                               [np.nan, 0.02, 0.025, 0.005, -0.03, np.nan, np.nan])  # fmt: skip


def test_a_circuit_begins_again():
    road = Road(
        [0, 10, 20, 30], [0.0, 0.1, 0.2, 0.0], *np.full((3, 4), np.nan), curvature=np.zeros(4), is_closed=True
    )
    np.testing.assert_allclose(
        road.interpolate("bank", [5.0, 35.0, 25.0, 85.0, -5.0]), [0.05, 0.05, 0.1, 0.1, 0.1]
    )


def test_knots_become_the_profile_of_a_path():
    s = np.arange(0.0, 101.0, 5.0)
    road = make_plain_road(s, 0 * s).with_profile(np.array([20.0, 60.0]), bank=np.array([0.0, 0.04]))
    assert road.interpolate("bank", [40.0])[0] == pytest.approx(0.02)
    assert np.isnan(road.interpolate("bank", [10.0, 70.0])).all() and np.isnan(road.grade).all()


def test_the_curvature_of_a_circle_is_one_over_its_radius():
    s = np.arange(0.0, 200.0, 5.0)
    x, y = 50 * np.sin(s / 50), 50 * (1 - np.cos(s / 50))
    # chords are shorter than arcs by (5/50)^2/24
    np.testing.assert_allclose(compute_curvature(s, x, y), 0.02, rtol=1e-3)


# ---- by position


def test_a_position_is_found_along_its_own_direction_only():
    """The road goes 100 m east and comes back 8 m north of it.

    One car drives 2 m beside the way back, and one backwards.
    """
    s = np.arange(0.0, 209.0, 1.0)
    x = np.where(s <= 100, s, np.where(s <= 108, 100, 208 - s))
    y = np.clip(s - 100, 0, 8)
    back = np.arange(90.0, 10.0, -1.0)
    found = match_by_position(x, y, s, back, np.full(len(back), 6.0), np.arange(len(back), dtype=float))
    # a grid of 1 m, and directions smoothed over 2.5 m
    np.testing.assert_allclose(found, 208 - back, atol=0.2)
    wrong = match_by_position(
        x[:80], y[:80], s[:80], back, np.zeros(len(back)), np.arange(len(back), dtype=float)
    )
    assert np.isnan(wrong).all()


def test_a_log_with_latitude_and_longitude_is_found_by_them():
    s, bend = make_winding_road(2000.0, 5)
    x, y = compute_path(s, bend)
    north, east = 48 + y / 111195.08, 11 + x / (111195.08 * np.cos(np.deg2rad(48)))
    road = make_road(s, latitude=north, longitude=east).with_profile(s, bank=0.02 * np.sin(s / 80))
    log, at = simulate_drive(s, bend, 300.0, 1700.0, gnss_latitude=lambda a: np.interp(a, s, north),
                     gnss_longitude=lambda a: np.interp(a, s, east))  # fmt: skip
    profile = match_log(road, log, CAR)
    assert profile.how == "GNSS position" and profile.share == 1.0
    np.testing.assert_allclose(profile.distance, at, atol=1.5)
    np.testing.assert_allclose(profile.bank, 0.02 * np.sin(at / 80), atol=0.02 * 1.5 / 80 + 1e-5)
    assert np.isnan(profile.grade).all()
    far = replace(log, extra=log.extra.assign(gnss_latitude=log.extra["gnss_latitude"] + 0.1))
    with pytest.raises(UserError, match=r"is not on the road.*the car was never within 15 m"):
        match_log(road, far, CAR)


# ---- by path


@pytest.mark.parametrize(
    "begin, radius, bias", [(0.0, 1.0, 0.0), (400.0, 1.0, 0.003), (400.0, 1.03, 0.0), (0.0, 0.95, 0.003)]
)
def test_a_log_is_found_by_its_bends(begin, radius, bias):
    """A gyro bias of 3 mrad/s acts as a bend of 5 km. Wheels 5 % off give 100 m at the
    end."""
    s, bend = make_winding_road(2000.0, 7)
    log, at = simulate_drive(s, bend, begin, 1900.0, radius, bias)
    profile = match_log(make_plain_road(s, bend).with_profile(s, grade=s / 1e5), log, CAR)
    assert profile.how == "path" and profile.share > 0.95
    off = profile.distance - at
    assert np.nanquantile(np.abs(off), 0.95) < 5.0 and np.nanmax(np.abs(off)) < 10.0
    np.testing.assert_allclose(profile.grade, profile.distance / 1e5)


def test_rounds_of_a_circuit_are_one_road():
    s, bend = make_circuit()
    log, at = simulate_drive(s, bend, 200.0, 200.0 + 3.4 * 1500.0, closed=True)
    profile = match_log(make_plain_road(s, bend, is_closed=True), log, CAR)
    off = np.mod(profile.distance - at + 750.0, 1500.0) - 750.0
    assert profile.share > 0.98 and np.nanmax(np.abs(off)) < 8.0
    assert np.nanmax(profile.distance) < 1500.0


def test_what_is_off_the_road_is_not_on_it():
    """The log has 600 m on the way to the road, 1400 m on it, and 500 m elsewhere."""
    s, bend = make_winding_road(1400.0, 13)
    (_, to), (_, off) = make_winding_road(600.0, 14), make_winding_road(500.0, 15)
    whole = np.concatenate([to[:-1], bend, off[1:]])
    log, at = simulate_drive(np.arange(len(whole), dtype=float), whole)
    found = match_log(make_plain_road(s, bend), log, CAR).distance
    inside = (at > 650) & (at < 1950)
    assert np.isfinite(found[inside]).all() and np.nanmax(np.abs(found[inside] - (at[inside] - 600))) < 8.0
    assert np.isnan(found[(at < 500) | (at > 2150)]).mean() > 0.95


@pytest.mark.parametrize("change", ["another", "mirrored", "backwards"])
def test_another_road_is_refused(change):
    s, bend = make_winding_road(2500.0, 17)
    other = {"another": make_winding_road(2500.0, 18)[1], "mirrored": -bend, "backwards": -bend[::-1]}[change]
    with pytest.raises(
        UserError, match="drive 1: cannot be aligned with road: the bends of the log match those of the road"
    ):
        match_log(make_plain_road(s, bend), simulate_drive(s, other)[0], CAR)


def test_a_straight_road_says_that_it_shows_no_place():
    s = np.arange(0.0, 2000.0, 10.0)
    with pytest.raises(UserError, match="turns by less than 1 rad, too little to find places by the bends"):
        match_log(make_plain_road(s, 0 * s), simulate_drive(*make_winding_road(1500.0, 19))[0], CAR)


def test_bends_that_repeat_say_that_they_show_no_place():
    """The road is a slalom: 20 m to each side and back, twenty times over 2 km."""
    s = np.arange(0.0, 2001.0)
    bend = 0.01 * np.sin(2 * np.pi * s / 100)
    with pytest.raises(UserError, match="bends of the log match several parts of the road, as in a slalom"):
        match_log(make_plain_road(s, bend), simulate_drive(s, bend, 300.0, 1800.0)[0], CAR)


# ---- several logs


def test_laps_have_one_distance():
    """Rows at one place have one distance, for logs with other starts and wheels."""
    s, bend = make_winding_road(2200.0, 23)
    drives = (0.0, 2200.0, 1.0), (150.0, 1900.0, 1.02), (400.0, 2100.0, 0.98)  # from, to, radius
    made = [simulate_drive(s, bend, *drive, seed=i) for i, drive in enumerate(drives)]
    found, road = match_common([log for log, _ in made], CAR)
    assert not road.is_closed and road.length == pytest.approx(2200.0, rel=0.02)
    for (log, at), distance in zip(made, found, strict=True):
        assert len(distance) == len(log) and np.isfinite(distance).mean() > 0.95
        assert np.nanmax(np.abs(distance - at)) < 10.0


def test_laps_of_one_road_share_its_knots_and_another_road_has_its_own():
    s, bend = make_winding_road(2200.0, 23)
    other_s, other_bend = make_winding_road(1500.0, 31)
    (first, at), (other, _), (second, later) = (
        simulate_drive(s, bend, seed=1),
        simulate_drive(other_s, other_bend, seed=2),
        simulate_drive(s, bend, 150.0, 1900.0, 1.02, seed=3),
    )
    found = find_laps([first, other, second], CAR)
    assert found.of == [0, 1, 0] and (found.count(0), found.count(1)) == (2, 1)
    for distance, true in ((found.distance[0], at), (found.distance[2], later)):
        assert np.nanmax(np.abs(distance - true)) < 10.0
    assert [len(found.lay_knots().compute_places(k)) for k in (0, 1)] == pytest.approx(
        [2200 / KNOT_DISTANCE, 1500 / KNOT_DISTANCE], abs=3
    )


def test_a_profile_that_was_not_fitted_is_not_known():
    """Only a bank is fitted: the grade of the road and of its logs stays unknown."""
    s, bend = make_winding_road(400.0, 5)
    knots = Knots.lay([s], kinds=("bank",))
    z = 0.01 * np.arange(len(knots))
    found = make_profile(make_plain_road(s, bend), knots, 0, z, np.full(len(z), 0.002))
    np.testing.assert_allclose(found.bank, np.interp(s, knots.compute_places(0), z), atol=1e-12)
    np.testing.assert_allclose(found.bank_sd, 0.002)
    assert np.isnan(found.grade).all() and np.isnan(found.grade_sd).all()


def test_rounds_of_one_log_are_found_to_be_a_circuit():
    s, bend = make_circuit()
    (first, at), (second, later) = (
        simulate_drive(s, bend, 0.0, 2.6 * 1500, closed=True),
        simulate_drive(s, bend, 700.0, 2300.0, closed=True, seed=2),
    )
    (a, b), road = match_common([first, second], CAR)
    assert road.is_closed and road.length == pytest.approx(1500.0, abs=10.0)
    for distance, true in ((a, at), (b, later)):
        off = np.mod(distance - true + 750.0, 1500.0) - 750.0
        assert np.isfinite(distance).mean() > 0.95 and np.nanmax(np.abs(off)) < 12.0


# ---- the real road


def read_genesis(name):
    folder = SHARED / name
    if not folder.is_dir():
        pytest.skip("../shared/data is not here")
    return read_log(folder / "data.csv")


@pytest.mark.parametrize("radius", [1.0, 1.03])
def test_the_path_of_a_real_lap_leads_where_its_positions_are(radius):
    """Match a real lap of 3.6 km by wheel speeds and gyro with a road by INS positions.

    95 % of the rows: straights show no place.
    """
    log = read_genesis("genesis_cpg_fast")
    car = Config.exact({"wheel_radius_front": 0.34 * radius, "wheel_radius_rear": 0.34 * radius})
    track = derive_track(log, car)
    (by_gnss,), way = match_common([log], car)
    road = make_road(way.distance, x=way.x, y=way.y)
    found = match_by_path(road, replace(track, x=None, y=None))
    moves = np.diff(track.travelled, prepend=0.0) > 0.01
    off = np.abs(found - by_gnss)[moves]
    assert np.isfinite(off).mean() > 0.9
    assert np.nanmedian(off) < 3.0 and np.nanquantile(off, 0.95) < 10.0


def test_a_lap_of_another_place_is_refused():
    car = Config.exact({"wheel_radius_front": 0.34, "wheel_radius_rear": 0.34})
    _, way = match_common([read_genesis("genesis_cpg_fast")], car)
    rfs = read_genesis("genesis_rfs")
    with pytest.raises(UserError, match="cannot be aligned"):
        match_log(
            make_plain_road(way.distance, way.curvature),
            replace(rfs, ref=rfs.ref.drop(columns=["ref_east", "ref_north"])),
            car,
        )


# ---- what a known road is good for


KNOWN = Config.exact({})
ROAD_CAR = {"name": "its car", **{n: float(getattr(KNOWN, n)) for n in list_vehicle_settings()}}
TRUE = {
    "true_cy_front": 0.8,
    "true_cy_rear": 0.85,
    "spread_cx_front": 0.0,
    "spread_cy_front": 0.0,
    "spread_cy_rear": 0.0,
}
ORDINARY = {"lean_sd": 0.05, "bank_superelevation": 0.1, "grade_sd": 0.03}  # settings of an uncalibrated car


@pytest.fixture(scope="module")
def banked():
    """Return a drive on a road with 1.7 deg rms of bank and grade, in waves of 170 ..
    900 m."""
    s = np.arange(0.0, 3000.0, 5.0)
    waves = [0.03 * np.sqrt(0.5) * sum(np.sin(2 * np.pi * s / w + k) for k, w in enumerate(of)) for of in
             ((170, 310, 450, 900), (270, 410, 550, 1000))]  # fmt: skip
    sd = np.full(len(s), 0.003)
    road = make_road(s, x=s, y=0 * s).with_profile(s, *waves, bank_sd=sd, grade_sd=sd)
    return road, tse.simulate("double-lane-change", seed=1, duration=120, settings=TRUE, road=road)


def score_estimates(log, **more):
    """Return rms error and mean sd of both cornering stiffnesses, and the share of valid
    rows.

    Error and sd are shares of the truth, over the last three quarters.
    """
    result = tse.estimate(log, ROAD_CAR, calibrate=False, settings=ORDINARY, **more)
    rows = result.to_frame().iloc[len(log) // 4 :]
    true = {
        "cy_front": 0.8 * KNOWN.cornering_stiffness_front,
        "cy_rear": 0.85 * KNOWN.cornering_stiffness_rear,
    }
    error, sd, valid = (
        np.array([f(c) for c in true])
        for f in (
            lambda c: np.sqrt(np.mean((rows[c] / true[c] - 1) ** 2)),
            lambda c: np.mean(rows[f"{c}_sd"]) / true[c],
            lambda c: rows[f"{c}_valid"].mean(),
        )
    )
    return error, sd, valid, result


def test_the_simulated_car_is_on_the_road(banked):
    """Its distance is the integral of the true speed, and it drives on the bank there."""
    road, (log, truth) = banked
    s = np.concatenate([[0.0], np.cumsum(truth["true_vel_x"].to_numpy()[:-1] * np.diff(log["time"]))])
    np.testing.assert_allclose(log["ref_east"], s, atol=1e-6)
    np.testing.assert_allclose(truth["true_bank"], np.interp(s, road.distance, road.bank), atol=1e-9)


def test_a_known_road_makes_the_estimate_better(banked):
    """Without the road the error is 10 % on both axles.

    Bank acts as side force, in waves as long as a manoeuvre.
    """
    road, (log, truth) = banked
    error, sd, valid, plain = score_estimates(log)
    error_on, sd_on, valid_on, known = score_estimates(log, road=road)
    assert (error_on < 0.5 * error).all() and (error_on < 0.04).all()
    assert (sd_on < sd).all() and (valid_on >= valid).all()
    off, off_on = (
        np.sqrt(np.mean((r.to_frame()["vel_y"] - truth["true_vel_y"]) ** 2)) for r in (plain, known)
    )
    assert off_on < 0.5 * off
    assert any("100 % of the rows are on the road, found by GNSS position" in note for note in known.notes)


def test_a_road_that_is_not_known_changes_no_bit(banked):
    """The file has neither bank nor grade, or the columns have no value."""
    _, (log, _) = banked
    short = log.iloc[:1500]
    plain = score_estimates(short)[3].to_frame()
    again = score_estimates(short.assign(bank=np.nan, grade=np.nan))[3].to_frame()
    pd.testing.assert_frame_equal(plain, again, check_exact=True)


def test_the_replay_has_the_road_under_it(banked):
    """For the simulator's own car, only the noise of accel_y remains."""
    road, (log, _) = banked
    true = {"cornering_stiffness_front": 0.8 * KNOWN.cornering_stiffness_front,
            "cornering_stiffness_rear": 0.85 * KNOWN.cornering_stiffness_rear}  # fmt: skip
    level, known = (
        tse.replay(log, ROAD_CAR, settings=true, road=r).apart()["accel_y"].rms for r in (None, road)
    )
    assert level > 1.5 * known and known < 1.05 * KNOWN.accel_y_sd


def test_columns_of_a_log_are_the_whole_road_in_a_replay(banked):
    """Columns replace bank, grade and lean of the settings."""
    _, (log, truth) = banked
    given = log.assign(bank=truth["true_bank"], grade=truth["true_grade"])
    one, other = (
        tse.replay(given, ROAD_CAR, settings=s).to_frame()
        for s in ({}, {"bank_angle": 0.02, "grade_angle": -0.01, "bank_superelevation": 0.1})
    )
    for c in ("vel_y", "yaw_rate_simulated", "accel_y_simulated"):
        np.testing.assert_allclose(one[c], other[c], atol=1e-6)


def test_the_commands_take_a_road(banked, tmp_path):
    road, _ = banked
    write_road(road, tmp_path / "road.csv")
    log, est = tmp_path / "log.csv", tmp_path / "est.csv"
    car = tmp_path / "car.toml"
    car.write_text("\n".join(f"{k} = {v!r}".replace("'", '"') for k, v in ROAD_CAR.items()), encoding="utf-8")
    on = ("--road", str(tmp_path / "road.csv"))
    simulated = ("simulate", "--maneuver", "double-lane-change", "--duration", "20", "--out", str(log))
    assert tselab(*simulated, *on).code == 0
    said = tselab(
        "estimate", "--verbose", str(log), "--vehicle", str(car), "--no-calibrate", "--out", str(est), *on
    )
    assert said.code in (0, 3, 4) and "100 % of the rows are on the road" in said.err + said.out
    said = tselab("replay", str(log), "--vehicle", str(car), *on)
    assert said.code == 0 and "100 % of the rows are on the road" in said.err
    (tmp_path / "road.csv").write_text(TEXT.replace("0.02", "0.5"), encoding="utf-8")
    said = tselab(
        "estimate", "--verbose", str(log), "--vehicle", str(car), "--no-calibrate", "--out", str(est), *on
    )
    assert said.code == 2 and "column bank: 0.5 is outside the allowed range" in said.err
    said = tselab(
        "estimate", "--verbose", str(log), "--vehicle", str(car), "--form", "paper", "--out", str(est), *on
    )
    assert said.code == 2
