"""Functions of a road, each alone: columns, places, curvature, and steps of the match."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tse.channels.log import read_frame
from tse.library.core import Config
from tse.library.errors import UserError
from tse.log.rows import CheckedLog
from tse.roads import road_match as module
from tse.roads.road import Road, compute_curvature, make_road, read_road, to_local, write_road
from tse.roads.road_match import (
    GNSS,
    PATH,
    Profile,
    Track,
    add_road,
    derive_road,
    derive_track,
    match_by_path,
    match_by_position,
    match_common,
    match_log,
    run_viterbi,
)

DEGREE = 6371008.8 * np.pi / 180  # m, a degree of latitude on a sphere of the mean radius
RADII = Config.exact({"wheel_radius_front": 0.3, "wheel_radius_rear": 0.4})


def make_profile(distance, bank=None, is_closed=False, **more) -> Road:
    """Return a straight road; what is not given of its profile is unknown."""
    s = np.asarray(distance, float)
    unknown = np.full(len(s), np.nan)
    columns = {"bank": bank, "grade": None, "bank_sd": None, "grade_sd": None} | more
    profile = {n: unknown if c is None else np.asarray(c, float) for n, c in columns.items()}
    return Road(s, **profile, curvature=np.zeros(len(s)), is_closed=is_closed)


# ---- columns


@pytest.mark.parametrize(
    ("name", "inside", "outside", "said"),
    [
        ("distance", (-1e7, 1e7), (-1.1e7, 1.1e7), "-1e+07 .. 1e+07 m"),
        ("bank", (-0.35, 0.35), (-0.351, 0.351), "-0.35 .. 0.35 rad"),
        ("grade", (-0.35, 0.35), (-0.351, 0.351), "-0.35 .. 0.35 rad"),
        ("bank_sd", (0.0, 0.35), (-0.001, 0.351), "0 .. 0.35 rad"),
        ("grade_sd", (0.0, 0.35), (-0.001, 0.351), "0 .. 0.35 rad"),
        ("x", (-1e7, 1e7), (-1.1e7, 1.1e7), "-1e+07 .. 1e+07 m"),
        ("y", (-1e7, 1e7), (-1.1e7, 1.1e7), "-1e+07 .. 1e+07 m"),
        ("latitude", (-90.0, 90.0), (-90.1, 90.1), "-90 .. 90 deg"),
        ("longitude", (-180.0, 180.0), (-180.1, 180.1), "-180 .. 180 deg"),
        ("curvature", (-1.0, 1.0), (-1.1, 1.1), "-1 .. 1 1/m"),
    ],
)
def test_a_column_may_reach_its_limits_and_not_exceed_them(tmp_path, name, inside, outside, said):
    others = {"distance": (0, 1), "bank": (0, 0), "curvature": (0, 0)}
    if pair := {"x": "y", "y": "x", "latitude": "longitude", "longitude": "latitude"}.get(name):
        others[pair] = (0, 1)
    path = tmp_path / "road.csv"
    for values, right in ((inside, True), *(((inside[0], x), False) for x in outside)):
        table = pd.DataFrame(others | {name: values})
        table.to_csv(path, index=False)
        if right:
            np.testing.assert_array_equal(getattr(read_road(path), name), values)
            continue
        with pytest.raises(UserError, match=f"line 3, column {name}: .* is outside the allowed range") as e:
            read_road(path)
        assert str(e.value).endswith(said)


@pytest.mark.parametrize("name", ["x", "y", "latitude", "longitude", "curvature"])
def test_only_the_profile_may_have_empty_cells(tmp_path, name):
    table = pd.DataFrame({"distance": [0, 5, 9], "bank": 0.1, "x": [0, 5, 9], "y": 0, "curvature": 0})
    table = table.assign(latitude=[48.0, 48.1, 48.2], longitude=11.0, grade=np.nan, bank_sd=np.nan)
    path = tmp_path / "road.csv"
    table.to_csv(path, index=False)
    assert np.isnan(read_road(path).grade).all()
    table.astype({name: float}).assign(**{name: [*table[name][:2], np.nan]}).to_csv(path, index=False)
    with pytest.raises(UserError, match=f"line 4, column {name}: is empty"):
        read_road(path)


def test_of_two_wrong_cells_the_first_is_named(tmp_path):
    path = tmp_path / "road.csv"
    path.write_text("distance,bank,curvature\n0,0,0\n10,0.4,0\n20,0.5,0\n")
    with pytest.raises(UserError, match=r"line 3, column bank: 0\.4 "):
        read_road(path)
    path.write_text("distance,bank,curvature\n0,0,0\n10,0,0\n5,0,0\n4,0,0\n")
    with pytest.raises(UserError, match="line 4, column distance: 5 m is not greater than 10 m"):
        read_road(path)


def test_blank_lines_count_as_lines(tmp_path):
    path = tmp_path / "road.csv"
    path.write_text("distance,bank,curvature\n\n0,0,0\n \n10,0.4,0\n\n")
    with pytest.raises(UserError, match=r"line 5, column bank: 0\.4 "):
        read_road(path)
    path.write_text("distance,bank,curvature\n\n0,0,0\n\n10,0.x,0\n\n")
    with pytest.raises(UserError, match=r"line 5, column bank: '0\.x' is not a number"):
        read_road(path)


def test_spaces_and_a_byte_order_mark_do_no_harm_and_1_is_closed(tmp_path):
    path = tmp_path / "road.csv"
    path.write_text("\ufeffdistance , grade, curvature,closed\n0, 0.1 ,0,1\n10, ,0.01,1\n", encoding="utf-8")
    road = read_road(path)
    assert road.is_closed and road.distance.tolist() == [0, 10] and road.path == path
    np.testing.assert_array_equal(road.grade, [0.1, np.nan])
    assert np.isnan(road.bank).all()


def test_a_road_from_arrays_counts_rows_from_0_and_needs_a_way():
    s, none = np.array([0.0, 1.0]), np.full(2, np.nan)
    with pytest.raises(UserError, match=r"road: row 1, column bank: 0\.4 is outside"):
        Road(s, np.array([0.0, 0.4]), none, none, none, curvature=none * 0)
    with pytest.raises(UserError, match="column x is missing: give both x and y"):
        Road(s, none, none, none, none, y=s)
    with pytest.raises(UserError, match="column curvature, or x and y, or latitude and longitude"):
        Road(s, none, none, none, none)
    with pytest.raises(UserError, match="column bank has 3 values, but distance has 2"):
        Road(s, np.zeros(3), none, none, none, curvature=np.zeros(2))
    with pytest.raises(UserError, match="has 1 rows; a road needs at least two"):
        make_road(s[:1], curvature=s[:1])


def test_the_file_has_the_columns_of_the_road_and_empty_cells(tmp_path):
    road = make_profile([0, 1234.5678], [0.0123456, np.nan], grade_sd=[0.001, 0.002])
    write_road(road, tmp_path / "road.csv")
    assert (tmp_path / "road.csv").read_text().splitlines() == [
        "distance,bank,grade,bank_sd,grade_sd,curvature,closed",
        "0.000,0.012346,,,0.001000,0.000000,0",
        "1234.568,,,,0.002000,0.000000,0",
    ]


# ---- places


def test_the_length_counts_from_the_first_place():
    assert make_profile([100, 130, 190]).length == 90.0
    assert len(make_profile([100, 130, 190])) == 3


def test_a_circuit_that_begins_elsewhere_than_at_0_begins_again():
    road = make_profile([100, 110, 120, 130], [0.0, 0.1, 0.2, 0.0], is_closed=True)
    np.testing.assert_allclose(
        road.interpolate("bank", [105, 135, 85, 165, 130, np.nan]), [0.05, 0.05, 0.15, 0.05, 0.0, np.nan]
    )


def test_a_slope_is_that_of_the_5_m_before_a_place():
    road = make_profile([0, 50, 100], [0.0, 0.1, 0.0], grade=[0.0, -0.2, 0.0])
    np.testing.assert_allclose(
        road.compute_slope("bank", np.array([3.0, 5.0, 50.0, 52.5, 60.0, 100.0])),
        [np.nan, 0.002, 0.002, 0.0, -0.002, -0.002],
        atol=1e-12,
    )
    assert road.compute_slope("grade", np.array([20.0]))[0] == pytest.approx(-0.004)


def test_each_knot_column_goes_to_its_own_place_and_over_the_seam_of_a_circuit():
    open_ = make_profile([100, 110, 120, 130, 140])
    knots = {"bank": [0.1, 0.2], "grade": [0.0, -0.1], "bank_sd": [0.01, 0.03], "grade_sd": [0.02, 0.06]}
    arrays = {n: np.array(v) for n, v in knots.items()}
    made = open_.with_profile(np.array([110.0, 130.0]), **arrays)
    for name, (a, b) in knots.items():
        np.testing.assert_allclose(getattr(made, name), [np.nan, a, (a + b) / 2, b, np.nan])
    closed = replace(open_, is_closed=True)  # one round is 40 m: from 130 on to 150, which is 110
    np.testing.assert_allclose(
        closed.with_profile(np.array([110.0, 130.0]), bank=arrays["bank"]).bank, [0.15, 0.1, 0.15, 0.2, 0.15]
    )


def test_a_road_without_a_profile_has_each_column_where_it_was_given():
    s = np.array([0.0, 1.0, 2.0])
    road = make_road(s, x=s, y=2 * s, latitude=3 * s, longitude=4 * s, curvature=0.1 * s, is_closed=True)
    for name, factor in {"x": 1, "y": 2, "latitude": 3, "longitude": 4, "curvature": 0.1}.items():
        np.testing.assert_array_equal(getattr(road, name), factor * s)
    assert road.is_closed and not make_road(s, curvature=0 * s).is_closed
    for name in ("bank", "grade", "bank_sd", "grade_sd"):
        assert np.isnan(getattr(road, name)).all()


def test_degrees_become_metres_east_and_north_of_the_origin():
    """A degree of longitude at 60 deg is half a degree of latitude."""
    east, north = to_local(np.array([60.0, 60.01, 59.99]), np.array([10.0, 10.02, 9.98]), (60.0, 10.0))
    np.testing.assert_allclose(east, [0, 0.01 * DEGREE, -0.01 * DEGREE], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(north, [0, 0.01 * DEGREE, -0.01 * DEGREE], rtol=1e-9, atol=1e-9)
    road = make_road(
        np.array([0.0, 1.0]), latitude=np.array([-30.0, -29.0]), longitude=np.array([170.0, 172])
    )
    assert road.origin == (-30.0, 170.0)
    np.testing.assert_allclose(road.x, [0, 2 * DEGREE * np.cos(np.pi / 6)])
    np.testing.assert_allclose(road.y, [0, DEGREE])


def test_the_curvature_is_negative_to_the_right_and_at_its_own_place():
    """The curvature of a clothoid grows with the distance: s / A^2."""
    s = np.concatenate([np.arange(0.0, 50.0, 1.0), np.arange(50.0, 120.0, 2.0)])
    fine = np.linspace(0, s[-1], 200_001)
    heading = -(fine**2) / (2 * 60.0**2)
    step = fine[1]
    x, y = (
        np.concatenate([[0], np.cumsum((f(heading[1:] - np.diff(heading) / 2)) * step)])
        for f in (np.cos, np.sin)
    )
    found = compute_curvature(s, np.interp(s, fine, x), np.interp(s, fine, y))
    np.testing.assert_allclose(found[1:-1], -s[1:-1] / 60.0**2, atol=2e-4)
    np.testing.assert_array_equal(compute_curvature(s[:2], x[:2], y[:2]), [0, 0])
    three = compute_curvature(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 1.0]), np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(three, np.pi / 2)  # a corner to the left within 1 m


def test_a_circle_through_west_has_no_jump_of_its_heading():
    s = np.arange(0.0, 700.0, 5.0)
    found = compute_curvature(s, -50 * np.sin(s / 50), -50 * (1 - np.cos(s / 50)))
    np.testing.assert_allclose(found, 0.02, rtol=1e-3)


# ---- the path of a log


def make_log(seconds: float = 10.0, speed=8.0, rate=0.0, **columns) -> CheckedLog:
    """Return a log of 10 Hz at a speed, m/s, of the wheels of RADII."""
    t = np.arange(0.0, seconds + 0.05, 0.1)
    v = np.broadcast_to(speed, t.shape)
    data = {"time": t, "steer_angle": 0.01 * np.sin(t), "accel_x": np.sin(t), "accel_y": np.cos(t)}
    data |= {"wheel_speed_front": v / 0.3 + 0.3 * np.sin(t), "wheel_speed_rear": v / 0.4 - 0.225 * np.sin(t)}
    data |= {"yaw_rate": rate + 1e-9 * np.sin(t)}
    return read_frame(data | {n: np.broadcast_to(c, t.shape) for n, c in columns.items()}, "the log")


def test_the_distance_is_the_mean_of_both_axles_by_their_radii():
    track = derive_track(make_log(), RADII)
    np.testing.assert_allclose(track.travelled, 8.0 * np.arange(101) * 0.1, atol=1e-6)
    assert track.x is track.y is track.latitude is None


def test_the_distance_does_not_decrease_in_reverse_and_needs_no_settings():
    t = np.arange(0.0, 10.05, 0.1)
    track = derive_track(make_log(speed=np.where(t < 5, 6.0, -3.0)), RADII)
    assert track.travelled[-1] == pytest.approx(6.0 * 4.9, rel=1e-6) and (np.diff(track.travelled) >= 0).all()
    own = Config()
    by = 0.5 * (own.wheel_radius_front / 0.3 + own.wheel_radius_rear / 0.4)
    mean = derive_track(make_log()).travelled[-1]
    assert mean == pytest.approx(80.0 * by, rel=1e-3)


def test_a_gyro_is_biased_by_what_it_shows_at_standstill_and_a_standing_car_does_not_turn():
    t = np.arange(0.0, 10.05, 0.1)
    stands = t < 4
    rate = np.where(stands, 0.02, 0.02 + 0.3)
    rate[3] = 5.0  # a single value does not move the median
    track = derive_track(make_log(speed=np.where(stands, 0.0, 8.0), rate=rate), RADII)
    assert track.heading[39] == 0.0
    assert track.heading[-1] == pytest.approx(0.3 * 6.1, rel=1e-6)
    moving = derive_track(make_log(rate=0.3), RADII)  # without a standstill the bias is unknown
    assert moving.heading[-1] == pytest.approx(0.3 * 10.0, rel=1e-6)


def test_missing_cells_of_wheels_and_gyro_are_bridged():
    log = make_log(rate=0.2)
    for name in ("wheel_speed_front", "wheel_speed_rear", "yaw_rate"):
        log.data.loc[40:60, name] = np.nan
    track = derive_track(log, RADII)
    assert track.travelled[-1] == pytest.approx(80.0, rel=0.01)
    assert track.heading[-1] == pytest.approx(2.0, rel=1e-6)
    log.data["yaw_rate"] = np.nan
    np.testing.assert_array_equal(derive_track(log, RADII).heading, 0.0)


def test_positions_are_those_of_gnss_before_those_of_a_reference():
    t = np.arange(0.0, 10.05, 0.1)
    north = np.where(t < 0.15, np.nan, 60.0 + 1e-4 * t)
    gnss = {"gnss_latitude": north, "gnss_longitude": 10.0 + 2e-4 * t}
    angles = {"ref_latitude": 50.0 + 1e-4 * t, "ref_longitude": 7.0 + 1e-4 * t}
    local = {"ref_east": 3 * t, "ref_north": 5 * t}
    both = derive_track(make_log(**gnss, **angles, **local), RADII)
    np.testing.assert_array_equal(both.latitude, north)
    np.testing.assert_allclose(both.longitude, 10.0 + 2e-4 * t)
    first = 2  # the origin is the first row with both coordinates
    np.testing.assert_allclose(both.y[first:], 1e-4 * (t[first:] - t[first]) * DEGREE, atol=1e-6)
    at = 2e-4 * (t - t[first]) * DEGREE * np.cos(np.deg2rad(north[first]))
    np.testing.assert_allclose(both.x, at, atol=1e-6)
    reference = derive_track(make_log(**angles, **local), RADII)
    np.testing.assert_allclose(reference.latitude, 50.0 + 1e-4 * t)
    without = derive_track(make_log(**dict.fromkeys(gnss, np.nan), **angles), RADII)
    np.testing.assert_allclose(without.longitude, 7.0 + 1e-4 * t)
    metres = derive_track(make_log(**local), RADII)
    np.testing.assert_allclose([metres.x, metres.y], [3 * t, 5 * t])
    assert metres.latitude is None


# ---- the profile under a log


def test_a_profile_sums_up_what_is_known():
    nan = np.nan
    unknown = np.full(4, nan)
    on = np.array([1.0, nan, 3.0, 4.0])
    profile = Profile(
        on, unknown, unknown, np.array([3.0, nan, nan, 5.0]), np.array([nan, nan, 4.0, nan]), PATH
    )
    assert profile.share == 0.75 and profile.sd == pytest.approx(np.sqrt((9 + 25 + 16) / 3))
    assert profile.describe() == "75 % of the rows are on the road, found by path"
    assert np.isnan(replace(profile, bank_sd=unknown, grade_sd=unknown).sd)


def drive_straight(**columns) -> CheckedLog:
    """Return a drive at 8 m/s along the x axis, 80 m from 20 m on, with its positions."""
    t = np.arange(0.0, 10.05, 0.1)
    return make_log(ref_east=20 + 8 * t, ref_north=0.0, **columns)


def test_an_error_of_the_place_widens_the_sd_by_the_slope_of_the_same_angle():
    s = np.arange(0.0, 201.0, 5.0)
    road = make_road(s, x=s, y=0 * s).with_profile(
        s, 0.002 * s - 0.1, -0.001 * s, 0.003 + 0 * s, 0.001 + 0 * s
    )
    profile = match_log(road, drive_straight(), RADII)
    assert profile.how == GNSS
    at = 20 + 8 * np.arange(101) * 0.1
    np.testing.assert_allclose(profile.distance, at, atol=0.05)
    np.testing.assert_allclose(profile.bank, 0.002 * at - 0.1, atol=2e-4)
    np.testing.assert_allclose(profile.grade, -0.001 * at, atol=1e-4)
    np.testing.assert_allclose(profile.bank_sd, np.hypot(0.003, 1.0 * 0.002), rtol=1e-6)  # 1 m by GNSS
    np.testing.assert_allclose(profile.grade_sd, np.hypot(0.001, 1.0 * 0.001), rtol=1e-6)
    assert module.PLACE_SD == {GNSS: 1.0, PATH: 3.0}


def test_a_log_gets_the_columns_that_the_road_knows_and_loses_its_own():
    s = np.arange(0.0, 201.0, 5.0)
    road = make_road(s, x=s, y=0 * s).with_profile(s, grade=0 * s + 0.05, grade_sd=0 * s + 0.01)
    log = drive_straight(bank=0.2, grade=0.3, gnss_speed=8.0)
    made, profile = add_road(log, road, RADII)
    assert "bank" not in made.extra and "bank_sd" not in made.extra and "grade_sd" not in made.extra
    np.testing.assert_allclose(made.extra["grade"], 0.05)
    np.testing.assert_allclose(made.extra["gnss_speed"], 8.0) if "gnss_speed" in log.extra else None
    assert made.notes == [
        *log.notes,
        "road from road: 100 % of the rows are on the road, found by GNSS position",
    ]
    assert profile.share == 1.0
    np.testing.assert_allclose(log.extra["grade"], 0.3)  # the log itself is as it was


def test_the_place_in_a_circuit_is_that_of_its_first_round():
    s = np.arange(0.0, 2 * np.pi * 60, 5.0)
    s = np.append(s, 2 * np.pi * 60)
    x, y = 60 * np.sin(s / 60), 60 * (1 - np.cos(s / 60))
    road = make_road(1000 + s, x=x, y=y, is_closed=True).with_profile(1000 + s, bank=0.1 * np.sin(s / 60))
    t = np.arange(0.0, 60.05, 0.1)
    log = make_log(
        60.0, rate=8 / 60, ref_east=60 * np.sin(8 * t / 60), ref_north=60 * (1 - np.cos(8 * t / 60))
    )
    profile = match_log(road, log, RADII)
    assert profile.distance.min() >= 1000 and profile.distance.max() <= 1000 + s[-1]
    inside = np.abs(np.mod(8 * t, s[-1]) / s[-1] - 0.5) < 0.45
    np.testing.assert_allclose(profile.distance[inside], 1000 + np.mod(8 * t, s[-1])[inside], atol=0.5)
    np.testing.assert_allclose(profile.bank, 0.1 * np.sin(8 * t / 60), atol=2e-3)


def test_latitude_and_longitude_are_matched_before_local_positions_and_far_away_is_an_error():
    s = np.arange(0.0, 201.0, 5.0)
    degrees = {"latitude": 60 + s / DEGREE, "longitude": 10 + 0 * s}
    road = make_road(s, **degrees)
    track = Track(s, 0 * s, s + 5000, 0 * s, 60 + s / DEGREE, 10 + 0 * s)  # x, y: of another origin
    found, how = module._match_track(road, track, "one")
    assert how == GNSS
    np.testing.assert_allclose(found, s, atol=0.05)
    with pytest.raises(UserError, match="two: is not on the road road: the car was never within 15 m"):
        module._match_track(road, replace(track, latitude=track.latitude + 0.1), "two")
    with pytest.raises(UserError, match="three: cannot be aligned with road: the road turns by less"):
        module._match_track(make_road(s, x=s, y=0 * s), replace(track, latitude=None), "three")


# ---- the path of a log as a road


def drive_track(s, curvature, by: float = 1.0, positions: bool = True) -> Track:
    """Return the track of a drive along s, m; wheels measure `by` times the way."""
    heading = np.concatenate([[0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * np.diff(s))])
    middle = 0.5 * (heading[1:] + heading[:-1])
    x, y = (np.concatenate([[0], np.cumsum(f(middle) * np.diff(s))]) for f in (np.cos, np.sin))
    return Track(by * s, heading, x, y) if positions else Track(by * s, heading)


def test_a_road_has_a_place_every_5_m_and_the_distances_of_its_positions():
    s = np.arange(0.0, 151.0)
    plain = derive_road(drive_track(s, 0.005 + 0 * s, positions=False))
    np.testing.assert_allclose(plain.distance, np.arange(0.0, 151.0, 5.0))
    np.testing.assert_allclose(plain.curvature, 0.005, rtol=1e-6)
    assert np.isnan(plain.bank).all() and not plain.is_closed and plain.x is None
    wide = derive_road(drive_track(s, 0 * s, by=1.1))  # wheels that measure 10 % too much
    assert wide.length == pytest.approx(150.0, abs=1.0) and wide.x[-1] == pytest.approx(150.0, abs=1.0)
    with pytest.raises(UserError, match=r"the car moved by 9\.9 m, less than 10 m"):
        derive_road(drive_track(np.linspace(0, 9.9, 20), np.zeros(20)))
    assert derive_road(drive_track(np.linspace(0, 10.0, 21), np.zeros(21), positions=False)).length == 10.0


@pytest.mark.parametrize("lane", [0.0, 60.0])
def test_a_round_begins_where_the_path_returns_to_and_ends_there(lane):
    """A pit lane of 60 m leads to a circuit of 400 m, of which 1.5 rounds are driven."""
    s = np.arange(0.0, lane + 601.0)
    track = drive_track(s, np.where(s >= lane, 2 * np.pi / 400, 0.0))
    road = derive_road(track)
    assert road.is_closed and road.length == pytest.approx(400.0, abs=7.0)
    assert road.distance[0] == 0.0 and (road.x[0], road.y[0]) == (road.x[-1], road.y[-1])
    assert road.x[0] == pytest.approx(0, abs=0.1) if not lane else 10 < road.x[0] < 61
    part = s < lane + 330  # no round yet
    once = drive_track(s[part], np.where(s >= lane, 2 * np.pi / 400, 0.0)[part])
    assert not derive_road(once).is_closed


def make_oval(rounds: float) -> tuple[np.ndarray, np.ndarray]:
    """Return distance and curvature on a circuit of 500 m, which repeats nowhere else."""
    s = np.arange(0.0, 500.0 * rounds + 1)
    phase = 2 * np.pi * s / 500
    return s, 2 * np.pi / 500 * (1 + 1.5 * np.sin(2 * phase) + np.cos(3 * phase))


def test_rounds_without_positions_are_found_by_bends_that_return():
    s, bend = make_oval(2.5)
    road = derive_road(drive_track(s, bend, positions=False))
    assert road.is_closed and road.length == pytest.approx(500.0, abs=5.0)
    s, bend = make_oval(0.9)
    assert not derive_road(drive_track(s, bend, positions=False)).is_closed


def test_rows_of_several_rounds_have_one_distance_and_the_longest_log_is_the_road():
    t = np.arange(0.0, 120.05, 0.1)
    w = 8 / (500 / (2 * np.pi))
    radius = 8 / w

    def make(seconds: float, start: float) -> CheckedLog:
        at = w * (np.arange(0.0, seconds + 0.05, 0.1) + start)
        return make_log(seconds, rate=w, ref_east=radius * np.sin(at), ref_north=radius * (1 - np.cos(at)))

    (short, long), road = match_common([make(30.0, 20.0), make(120.0, 0.0)], RADII)
    assert road.is_closed and road.length == pytest.approx(500.0, abs=3.0)
    assert len(short) == 301 and len(long) == len(t) and long.max() < road.length
    np.testing.assert_allclose(short[10:-10], 8 * (20 + t[10:291]), atol=2.0)


def test_distances_that_go_on_over_the_rounds_are_those_of_one(monkeypatch):
    t = np.arange(0.0, 120.05, 0.1)
    at = 2 * np.pi * 8 * t / 500
    log = make_log(120.0, rate=8 * 2 * np.pi / 500, ref_east=80 * np.sin(at), ref_north=80 * (1 - np.cos(at)))
    monkeypatch.setattr(module, "_match_track", lambda *_: (8 * t, PATH))
    (found,), road = match_common([log], RADII)
    np.testing.assert_allclose(found, np.mod(8 * t, road.length))
    profile = match_log(road, log, RADII)
    np.testing.assert_allclose(profile.distance, np.mod(8 * t, road.length))


def test_positions_are_averaged_along_the_way_and_few_are_none():
    s = np.arange(0.0, 101.0)
    track = Track(s, 0 * s, 2 * s, -s, 3 * s, 4 * s)
    way = np.array([0.0, 7.5, 100.0])
    found = module._average_positions(track, way)
    np.testing.assert_allclose(found[0][:2], [0, 15], atol=1e-9)
    np.testing.assert_allclose([f[1] for f in found], [15, -7.5, 22.5, 30], atol=1e-9)
    few = np.where(s < 3, s, np.nan)
    assert module._average_positions(replace(track, x=few), way) is None
    assert module._average_positions(replace(track, x=np.where(s < 4, s, np.nan)), way) is not None
    assert module._average_positions(Track(s, s), way) is None


def test_smoothing_keeps_a_line_to_its_ends_and_averages_noise():
    line = 3.0 + 0.5 * np.arange(60)
    np.testing.assert_allclose(module._smooth_values(line, 2.5), line, atol=1e-9)
    assert module._smooth_values(line[:3], 2.5)[1] == pytest.approx(3.5)
    spike = np.zeros(61)
    spike[30] = 1.0
    shape = np.exp(-0.5 * (np.arange(-6, 7) / 2.5) ** 2) / (2.5 * np.sqrt(2 * np.pi))
    np.testing.assert_allclose(module._smooth_values(spike, 2.5)[24:37], shape, rtol=0.01)


def test_the_curvature_of_a_track_is_its_turning_per_metre_and_a_standstill_does_not_count():
    s = np.arange(0.0, 201.0)
    track = drive_track(s, -0.02 + 0 * s)
    np.testing.assert_allclose(
        module._compute_track_curvature(track, np.array([20.0, 100.0])), -0.02, rtol=1e-6
    )
    travelled, heading = np.insert(s, 100, [99.0] * 5), np.insert(track.heading, 100, [5.0] * 5)
    stood = module._compute_track_curvature(Track(travelled, heading), np.array([50.0, 100.0]))
    np.testing.assert_allclose(stood, -0.02, rtol=1e-6)


def test_the_correlation_of_curvatures_keeps_their_means():
    a = np.array([1.0, 2.0, 3.0])
    assert module._correlate(a, 2 * a) == pytest.approx(1.0)
    assert module._correlate(a, -a) == pytest.approx(-1.0)
    assert module._correlate(a, a[::-1]) == pytest.approx(10 / 14)  # of deviations it would be -1
    assert module._correlate(a, 0 * a) == 0.0


# ---- by position


def test_opposite_directions_are_20_m_apart_and_equal_ones_not_at_all():
    x, y = np.arange(5.0), np.zeros(5)
    there, back = module._add_direction(x, y), module._add_direction(x[::-1], y)[::-1]
    assert np.linalg.norm(there - back, axis=1) == pytest.approx([20.0] * 5)
    across = module._add_direction(np.zeros(5), np.arange(5.0))
    assert np.linalg.norm(there[0] - across[0]) == pytest.approx(20.0 / np.sqrt(2))
    np.testing.assert_array_equal(there[:, :2], np.column_stack([x, y]))


@pytest.mark.parametrize(
    ("beside", "on"), [(0.0, True), (-14.5, True), (14.5, True), (-15.5, False), (15.5, False)]
)
def test_a_position_within_15_m_is_on_the_road(beside, on):
    s = np.arange(0.0, 101.0)
    at = np.arange(10.0, 90.0)
    found = match_by_position(s, 0 * s, 1000 + s, at, beside + 0 * at, at - 10)
    assert np.isfinite(found).all() == on == np.isfinite(found).any()
    if on:
        np.testing.assert_allclose(found, 1000 + at, atol=0.05)


def test_a_position_beyond_an_end_is_at_the_end_and_missing_ones_are_bridged():
    s = np.arange(0.0, 101.0)
    at = np.arange(-5.0, 106.0)
    known = np.where((at > 40) & (at < 60), np.nan, at)
    found = match_by_position(s, 0 * s, s, known, 0 * at, at + 5)
    np.testing.assert_allclose(found, np.clip(at, 0, 100), atol=0.3)
    assert found.min() == 0.0 and found.max() == 100.0
    few = match_by_position(s, 0 * s, s, np.where(at < -2, at, np.nan), 0 * at, at + 5)
    assert np.isnan(few).all() and len(few) == len(at)


def test_places_between_are_linear_and_at_a_jump_the_nearest():
    way = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    s = np.array([10.0, 11.0, 12.0, 500.0, np.nan])
    at = np.array([0.0, 0.25, 1.5, 2.4, 2.6, 3.4, 3.6, 4.0])
    np.testing.assert_allclose(
        module._interpolate_places(way, s, at), [10, 10.25, 11.5, 12, 500, 500, np.nan, np.nan]
    )
    faster = module._interpolate_places(
        way, np.array([0.0, 4.9, 4.9, 0.1, 5.2]), np.array([0.5, 2.4, 3.4, 3.6])
    )
    np.testing.assert_allclose(faster, [2.45, 2.98, 0.1, 5.2])  # 4.9 is a step, 5.1 a jump


# ---- by path


BENDS = 0.02 * np.sin(np.cumsum(np.random.default_rng(4).uniform(0, 1.0, 200)))


def test_a_sequence_of_places_follows_the_bends_with_slower_and_faster_steps():
    way = [*range(20, 60), 59, 60, *range(61, 80), *range(81, 120)]
    found = run_viterbi(BENDS, BENDS[way], 5e-4, False)
    assert (np.abs(found - way) <= 1).all() and (found == way).mean() > 0.95
    assert found.dtype == np.int64


def test_a_circuit_goes_on_at_its_first_place_and_an_open_road_does_not():
    way = [*range(150, 200), *range(0, 50)]
    assert run_viterbi(BENDS, BENDS[way], 5e-4, True).tolist() == way
    there = run_viterbi(BENDS, BENDS[way], 5e-4, False)
    assert (np.diff(there)[there[1:] >= 0] >= 0).all() or (there == -1).any()
    assert there.tolist() != way


def test_what_does_not_fit_is_elsewhere_before_and_after_the_road():
    other = 0.02 * np.cos(3.3 * np.arange(80))
    found = run_viterbi(BENDS, np.concatenate([other, BENDS[40:160], other]), 5e-4, False)
    assert (found[:78] == -1).all() and (found[-78:] == -1).all()
    assert found[80:200].tolist() == list(range(40, 160))


def test_a_short_difference_does_not_leave_the_road():
    turn = BENDS[40:160].copy()
    turn[50:55] += 0.5
    assert run_viterbi(BENDS, turn, 5e-4, False).tolist() == list(range(40, 160))


def test_stretches_are_the_parts_on_the_road():
    place = np.array([5, 6, -1, -1, 7, 8, 9, -1, 3])
    assert module._find_road_stretches(place) == [(0, 2), (4, 7), (8, 9)]
    assert module._find_road_stretches(np.array([-1, -1])) == []


def test_the_stretch_of_the_way_is_the_mean_advance_within_stretches():
    place = np.array([0, 1, 3, 4, -1, 50, 51, 52])
    assert module._estimate_stretch(place, False) == pytest.approx((1 + 2 + 1 + 1 + 1) / 5)
    assert module._estimate_stretch(np.array([-1, -1]), False) == 1.0
    circuit = np.array([97, 98, 99, 0, 1, 3])
    assert module._estimate_stretch(circuit, True) == pytest.approx((1 + 1 + 1 + 2) / 4)


def test_a_stretch_is_accepted_if_it_is_alike_and_turns_enough():
    """One place is 10 m; the limit is 6 rad, 80 % of the less that road or log turns."""
    its = 0.02 * np.where(np.arange(100) // 10 % 2, -1.0, 1.0)  # 0.2 rad a place
    place = np.array([*range(10, 45), -1, *range(50, 70)])  # 7 rad and 4 rad
    turn = np.where(place >= 0, its[place], 0.02)
    found = module._accept_stretches(place, its, turn, 10.0)
    assert found.tolist() == [*range(10, 45), *[-1] * 21]
    assert (module._accept_stretches(place, its, -turn, 10.0) == -1).all()  # the other way round
    short = np.arange(50, 70)  # the whole log turns by 4 rad, and so does the stretch
    assert module._accept_stretches(short, its, its[short], 10.0).tolist() == short.tolist()
    part = np.where(np.arange(20) < 15, short, -1)  # 3 rad, below 80 % of 4 rad
    assert (module._accept_stretches(part, its, its[short], 10.0) == -1).all()
    tiny = np.arange(50, 54)  # less than 1 rad shows nothing, even if that is all
    assert (module._accept_stretches(tiny, its, its[tiny], 10.0) == -1).all()
    noisy = its[short] + 0.02 * np.where(np.arange(20) % 2, -1.0, 1.0)  # correlation 0.71
    assert (module._accept_stretches(short, its, noisy, 10.0) == -1).all()


def test_a_place_is_ambiguous_if_another_part_of_the_road_is_alike():
    """One place is 10 m; the other part begins at least 100 m away."""
    rng = np.random.default_rng(8)
    piece = 0.02 * rng.standard_normal(40)
    alone, twice = 0.02 * rng.standard_normal(120), 0.02 * rng.standard_normal(120)
    alone[10:50] = piece
    twice[10:50] = twice[70:110] = piece
    place = np.array([-1, *range(10, 50), -1, 3, 4])
    turn = np.array([0.0, *piece, 0.0, 9.0, 9.0])
    for closed in (False, True):
        assert not module._is_ambiguous(place, alone, turn, 10.0, closed)
        assert module._is_ambiguous(place, twice, turn, 10.0, closed)
        assert module._is_ambiguous(np.where(place >= 10, place + 60, place), twice, turn, 10.0, closed)
    seam = np.roll(twice, 30)  # the second one lies across the first place of a circuit
    moved = np.where(place >= 0, (place + 30) % 120, -1)
    assert module._is_ambiguous(moved, seam, turn, 10.0, True)
    assert not module._is_ambiguous(moved, seam, turn, 10.0, False)


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize(("apart", "said"), [(9, False), (10, True)])
def test_what_is_less_than_100_m_apart_is_one_place(apart, said, closed):
    its = 0.02 * np.random.default_rng(8).standard_normal(60)
    its[20 + apart : 28 + apart] = its[20:28]
    place = np.arange(20, 28)
    assert module._is_ambiguous(place, its, its[place], 10.0, closed) == said


@pytest.mark.parametrize("shift", [0.0, 0.8, -1.1])
@pytest.mark.parametrize("closed", [False, True])
def test_places_are_found_between_the_steps(shift, closed):
    """Places are 2.5 m apart; the car is `shift` m further than its places."""
    s = 2.5 * np.arange(200)

    def bend(at):
        return 0.01 * np.sin(2 * np.pi * 3 * at / 500) + 0.01 * np.cos(2 * np.pi * 7 * at / 500)

    place = np.array([-1, *range(20, 180), -1])
    turn = bend(np.where(place >= 0, s[place] + shift, 0.0))
    found = module._refine_places(place, bend(s), turn, 2.5, closed)
    assert np.isnan(found[[0, -1]]).all()
    np.testing.assert_allclose(found[1:-1], s[20:180] + shift, atol=0.2)


def test_refined_places_increase_over_the_rounds_of_a_circuit_and_stay_on_an_open_road():
    s = 2.5 * np.arange(200)
    its = 0.01 * np.sin(2 * np.pi * 3 * s / 500) + 0.01 * np.cos(2 * np.pi * 7 * s / 500)
    place = np.concatenate([np.arange(100, 200), np.arange(200), np.arange(50)])
    found = module._refine_places(place, its, its[place], 2.5, True)
    np.testing.assert_allclose(found, 250 + 2.5 * np.arange(350), atol=0.2)
    whole = module._refine_places(np.arange(200), its, its, 2.5, False)
    assert whole.min() >= 0 and whole.max() <= s[-1]


def test_the_curvature_of_a_circuit_is_smoothed_over_its_seam():
    s = np.arange(0.0, 501.0)
    bend = np.where((s < 10) | (s > 490), 0.02, 0.0)
    for closed in (True, False):
        road = replace(make_profile(s, is_closed=closed), curvature=np.where(s < 10, 0.0, bend))
        first = module._smooth_curvature(road, np.arange(0.0, 500.0, 2.5), 2.5)[0]
        assert (first > 0.004) == closed


def test_distances_by_path_count_from_the_first_place_of_the_road():
    s = np.arange(0.0, 800.0)
    rng = np.random.default_rng(11)
    knots = np.cumsum(rng.uniform(20, 50, 40))
    bend = np.interp(s, knots, rng.uniform(-0.03, 0.03, 40))
    road = make_road(5000 + s, curvature=bend)
    track = drive_track(s[100:700], bend[100:700], by=1.03, positions=False)
    track = replace(track, travelled=track.travelled - track.travelled[0])
    found = match_by_path(road, track)
    assert np.isfinite(found).mean() > 0.95
    np.testing.assert_allclose(found[np.isfinite(found)], 5000 + s[100:700][np.isfinite(found)], atol=4.0)


def test_a_wrong_wheel_radius_is_corrected_before_the_log_is_matched_again(monkeypatch):
    """Wheels that measure 10 % too much make 264 steps of the 240 of a way of 600 m."""
    s, bend = make_oval(1.8)
    counts = []
    monkeypatch.setattr(
        module,
        "run_viterbi",
        lambda its, turn, *more: counts.append(len(turn)) or run_viterbi(its, turn, *more),
    )
    match_by_path(make_road(s, curvature=bend), drive_track(s[:601], bend[:601], by=1.1, positions=False))
    assert counts[0] == 265 and counts[1] == pytest.approx(241, abs=13)


def test_a_road_of_many_places_is_matched_in_longer_steps(monkeypatch):
    monkeypatch.setattr(module, "MAX_PLACES", 100)
    seen = []
    monkeypatch.setattr(module, "run_viterbi", lambda its, turn, *_: seen.append((len(its), len(turn))) or
                        np.full(len(turn), -1))  # fmt: skip
    s = np.arange(0.0, 1001.0)
    track = drive_track(s[:501], 0.01 + 0 * s[:501], positions=False)
    with pytest.raises(UserError, match="that log: cannot be aligned with road: the bends of the log match"):
        match_by_path(make_road(s, curvature=0.01 + 0 * s), track, "that log")
    assert seen == [(100, 51)]


def test_a_file_that_is_no_table_says_so(tmp_path):
    (tmp_path / "road.csv").write_text("distance,bank\n1,2,3,4\n")
    with pytest.raises(UserError, match=r"road\.csv: cannot be read as a road file: "):
        read_road(Path(tmp_path / "road.csv"))
    with pytest.raises(UserError, match="cannot be read as a road file: Is a directory"):
        read_road(tmp_path)
