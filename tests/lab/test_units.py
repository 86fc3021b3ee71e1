"""A wrong unit is the commonest error: the run says so."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import tse
from conftest import RAN, tselab, tselab_here
from tests.cars.logs import make_logs
from tse.impl.logs.agree import stood
from tse.impl.logs.log import read_log
from tse.impl.verdict import implausible


@pytest.fixture(scope="module")
def lively(tmp_path_factory):
    """A log that turns, brakes and accelerates enough for the channels to be compared."""
    path = tmp_path_factory.mktemp("units") / "log.csv"
    assert tselab_here("simulate", "--maneuver", "double-lane-change", "--duration", 36, "--out", path).code == 0
    return path


def warnings(lively, **scale):
    from tse.impl.logs.agree import check_units
    from tse.impl.logs.log import read_log

    log = read_log(lively)
    for name, factor in scale.items():
        log.data[name] *= factor
    return " | ".join(check_units(log, 2.75, 0.33, 0.33, 16.0))


def test_a_good_log_gives_no_warning(lively):
    assert warnings(lively) == ""


@pytest.mark.parametrize(
    ("scale", "hint"),
    [
        ({"yaw_rate": 57.3}, "yaw_rate is in deg/s"),
        ({"steer_angle": 16.0}, "steer_angle is the steering-wheel angle"),
        ({"steer_angle": 57.3}, "steer_angle is in degrees"),
        ({"accel_y": 1 / 9.81}, "accel_y is in g"),
        ({"accel_x": 1 / 9.81}, "accel_x is in g"),
        ({"wheel_speed_front": 0.33, "wheel_speed_rear": 0.33}, "the wheel speeds are in m/s"),
        ({"wheel_speed_front": 9.55, "wheel_speed_rear": 9.55}, "the wheel speeds are in rpm"),
        ({"wheel_speed_front": 2.0, "wheel_speed_rear": 2.0}, "wheel_radius_front and _rear are diameters"),
        ({"steer_angle": -1.0}, "positive to the right"),
        ({"accel_y": -1.0}, "positive to the right"),
        ({"accel_x": -1.0}, "accel_x is positive to the rear"),
        ({"wheel_speed_rear": 2.0}, "front and rear wheels roll at"),
    ],
)
def test_wrong_units_and_signs_are_named(lively, scale, hint):
    assert hint in warnings(lively, **scale)


def test_a_scale_that_no_unit_has_is_said_without_one(lively):
    """2.9 is no unit; with the wheels taken for rpm the car would hardly move, so nothing would speak against it."""
    said = warnings(lively, yaw_rate=2.9)
    assert "no unit that is often mixed up explains it" in said and "rpm" not in said and "factor" not in said


def test_steering_at_one_speed_where_one_understeer_would_leave_nothing():
    """At 25 m/s an understeer of -0.0016 s2/m2, which is among those tried, would need no steering in any bend."""
    from tse.impl.logs import physics

    v = np.full(4000, 25.0)
    r = 0.1 * np.sin(np.arange(4000) / physics.RATE)
    seen = physics.steering(16.0 * 2.75 * r / v * (1 + 0.002 * v**2), v, r)
    assert seen is not None and seen.per_curvature == pytest.approx(16.0 * 2.75, rel=0.05)


def test_the_warning_reaches_the_terminal(lively, drive, tmp_path):
    table = pd.read_csv(lively)
    table["accel_y"] /= 9.81
    table.to_csv(tmp_path / "log.csv", index=False)
    done = tselab_here("estimate", "log.csv", "--vehicle", drive.vehicle, "--particles", 32, cwd=tmp_path)
    assert done.code == 4 and "warning: check the units: accel_y is in g" in done.err
    strict = tselab_here(
        "estimate", "log.csv", "--vehicle", drive.vehicle, "--strict", "--out", "strict.csv", cwd=tmp_path
    )
    assert strict.code == 2 and "option --strict: check the units: accel_y is in g" in strict.err
    assert not (tmp_path / "strict.csv").exists()


@pytest.fixture(scope="module")
def cars(tmp_path_factory):
    """Cars that tse's model did not make, on roads that lean, climb and bend: road -> logs as tables, and the vehicle's facts."""
    return {road: make_logs(road, minutes=1.5, cars=2, seed=5) for road in ("highway", "mountain")}


def notes_of(car, folder, **columns) -> list[str]:
    from tse.impl.logs.agree import check_units
    from tse.impl.logs.log import read_log

    v = car.vehicle
    log = pd.DataFrame(car.log)
    for axle in ("front", "rear"):  # four wheels
        mean, half = log.pop(f"wheel_speed_{axle}"), 0.5 * v[f"track_{axle}"] / v[f"wheel_radius_{axle}"] * log.yaw_rate
        log[f"wheel_speed_{axle}_left"], log[f"wheel_speed_{axle}_right"] = mean - half, mean + half
    for name, change in columns.items():
        for c in [c for c in log if c.startswith(name)]:
            log[c] = change(log[c])
    log.to_csv(folder / "log.csv", index=False)
    tracks = {a: v[f"track_{a}"] for a in ("front", "rear")}
    return check_units(read_log(folder / "log.csv"), v["lf"] + v["lr"], v["wheel_radius_front"], v["wheel_radius_rear"],
                       v["steering_ratio"], tracks)  # fmt: skip


@pytest.mark.parametrize("road", ["highway", "mountain"])
def test_right_logs_of_cars_that_nobody_made_here_get_no_note(road, cars, tmp_path):
    """A car that understeers turns at 130 km/h by a third of what its angle says: no reason to ask about units."""
    for car in cars[road]:
        assert notes_of(car, tmp_path) == []


def test_kmh_taken_for_rad_per_s_is_noticed_by_the_track(cars, tmp_path):
    """It is a factor of 1.05 .. 1.15 only: the wheels of an axle, against the yaw rate, tell."""
    for car in cars["mountain"]:
        radius = car.vehicle["wheel_radius_front"]
        found = notes_of(car, tmp_path, wheel_speed=lambda x, radius=radius: 3.6 * radius * x)
        if abs(np.log(3.6 * radius)) > 0.08:
            assert len(found) == 1 and "the wheel speeds are in km/h" in found[0], found
            assert f"factor {3.6 * radius:.3g}" in found[0]


@pytest.mark.parametrize(
    ("columns", "hint"),
    [
        ({"accel_y": lambda x: x / 9.81}, "accel_y is in g"),
        ({"steer_angle": lambda x: -x}, "steer_angle is positive to the right"),
        ({"accel_x": lambda x: -x}, "accel_x is positive to the rear"),
        ({"wheel_speed": lambda x: 0.447 * x}, "the wheel speeds are in m"),
    ],
)
def test_units_of_such_cars(columns, hint, cars, tmp_path):
    for car in cars["mountain"]:
        found = notes_of(car, tmp_path, **columns)
        assert len(found) == 1 and hint in found[0], found


def test_swapped_axes_are_named(cars, tmp_path):
    car = cars["mountain"][0]
    swapped = dict(car.log)
    swapped["accel_x"], swapped["accel_y"] = swapped["accel_y"], swapped["accel_x"]
    car = type(car)(car.car, swapped, car.reference, car.truth)
    assert any("accel_x and accel_y are swapped" in n for n in notes_of(car, tmp_path))


def test_a_log_that_contradicts_itself_tells_nothing_and_teaches_nothing(lively, drive, tmp_path):
    """With the steering turned round the filter finds some other car, and would be sure of it."""
    table = pd.read_csv(lively)
    table["steer_angle"] *= -1
    table.to_csv(tmp_path / "log.csv", index=False)
    more = ("--table", "t.parquet", "--save-learnt", "l")
    done = tselab_here("estimate", "log.csv", "--vehicle", drive.vehicle, *more, cwd=tmp_path)
    assert done.code == 4 and "steer_angle is positive to the right" in done.err
    told = pd.read_parquet(tmp_path / "t.parquet")
    assert (told.usable == "no").all() and told.value.isna().all() and (told.reason == "contradicted").all()
    assert not (tmp_path / "l").exists() and "so nothing was learnt" in done.err


def test_wheels_that_stand_while_the_car_drives_are_a_note(lively, drive, tmp_path):
    """And nothing of numpy's: smoothed over the step a speed is as good as 0, where the curvature is none."""
    table = pd.read_csv(lively)
    rows = (table.time > 10) & (table.time < 30)
    table.loc[rows, ["wheel_speed_front", "wheel_speed_rear"]] = 0.0
    table.to_csv(tmp_path / "log.csv", index=False)
    done = tselab("estimate", "log.csv", "--vehicle", drive.vehicle, cwd=tmp_path)
    assert done.code in RAN and "RuntimeWarning" not in done.err
    assert (
        "note: both wheel speeds are 0 from 10.01 to 29.99 s, while the car drove (19.6 m/s in the row before"
        in done.err
    )


def test_a_car_that_stops_and_starts_gets_no_note_and_two_gaps_get_one(lively):
    log = read_log(lively)
    speed = np.clip(np.abs(20 - 5 * np.abs(log.time - 10)) - 10, 0, None) / 0.33
    log.data["wheel_speed_front"] = log.data["wheel_speed_rear"] = speed
    assert (speed == 0).sum() > 300 and stood(log, 0.33, 0.33, 1.0) == []
    steady = np.full(len(log), 60.0)
    for seconds, said in ((((3, 6),), 1), (((3, 6), (8, 9)), 1), (((3, 3.3),), 0)):
        x = np.where(np.any([(log.time > a) & (log.time < b) for a, b in seconds], axis=0), 0.0, steady)
        log.data["wheel_speed_front"] = log.data["wheel_speed_rear"] = x
        notes = stood(log, 0.33, 0.33, 1.0)
        assert len(notes) == said and ("2 times, first from 3.0" in "".join(notes)) == (len(seconds) > 1)


@pytest.mark.parametrize("mistake", ["units", "axles"])
def test_no_row_of_a_log_that_contradicts_itself_is_valid(mistake, drive, tmp_path):
    """Also not before the filter knows: in a drive of a minute it finds exchanged axles after some seconds."""
    simulated = ("simulate", "--maneuver", "double-lane-change", "--duration", 60, "--out", tmp_path / "log.csv")
    assert tselab_here(*simulated).code == 0
    table = pd.read_csv(tmp_path / "log.csv")
    front, rear = "wheel_speed_front", "wheel_speed_rear"
    if mistake == "units":
        table[[front, rear]] *= 0.33 * 2.23694  # mph
    else:
        table[[front, rear]] = table[[rear, front]].to_numpy()
    table.to_csv(tmp_path / "log.csv", index=False)
    vehicle = tmp_path / "car.toml"
    vehicle.write_text(drive.vehicle.read_text())
    done = tselab_here("estimate", "log.csv", "--vehicle", vehicle, "--out", "est.csv", cwd=tmp_path)
    hint = "the wheel speeds are in mph" if mistake == "units" else "front and rear wheel speeds seem to be exchanged"
    assert done.code == 4 and hint in done.err
    estimated = pd.read_csv(tmp_path / "est.csv")
    names = ("cx_front", "cy_front", "cy_rear", "grip")
    assert not estimated[[f"{n}_valid" for n in names]].to_numpy().any()
    against = np.any([estimated[f"{n}_reason"] == "implausible" for n in names], axis=0)
    assert against.mean() > 0.5 and (estimated.status[against] == 10).all()
    with pytest.warns(UserWarning, match=hint):
        assert not tse.estimate(table, vehicle).valid.any()


def test_a_channel_that_contradicts_for_a_while_leaves_the_rest():
    """Rows in which the car stands or the filter starts do not count; what is over is not against the whole log."""
    reasons = np.array(["starting"] * 10 + ["implausible"] * 60 + ["valid"] * 30)
    table = pd.DataFrame(dict.fromkeys(("cx_front_reason", "cy_front_reason", "cy_rear_reason"), reasons))
    table = table.assign(fault_channel=4, fault_factor=-1.0)
    assert implausible(table) == ""
    assert implausible(table.iloc[:70]).endswith(
        "accel_x seems to have the other sign (factor -1, about 1 is expected)"
    )
    assert "in 67 % of the rows that drive" in implausible(table.iloc[np.r_[0:10, 70:100, 10:70]])
    assert implausible(table.iloc[np.r_[70:100, 0:10, 10:35]]) == ""


def test_a_measurement_that_never_changes_is_missing(lively, tmp_path):
    from tse.impl.logs.log import read_log

    table = pd.read_csv(lively)
    table["accel_x"] = 0.03
    table.to_csv(tmp_path / "log.csv", index=False)
    log = read_log(tmp_path / "log.csv")
    assert log.data["accel_x"].isna().all() and log.data["accel_y"].notna().all()
    assert any("accel_x is 0.03 in every row, while wheel_speed_rear changes" in n for n in log.notes)
