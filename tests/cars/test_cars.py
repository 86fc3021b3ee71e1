"""The generator of ordinary cars against independent physics."""

import json
from dataclasses import replace

import numpy as np
import pytest

from . import CHANNELS, COLUMNS, GRAVITY, REFERENCE, ROADS, SCENARIOS, make_cars, make_logs, model
from .cars import AIR, compute_roll_arm, compute_sprung_mass
from .logs import RECORDED, drive
from .model import Fleet
from .road import Road, Surface
from .sensors import FINE, SLOPES, STATES, Motion, make_log, measure_motion

# the simulator of a study; only scripts/results depends on it
pytestmark = pytest.mark.slow

LEVEL = (0.0, 0.0, GRAVITY)


class Rig:
    """Cars on a smooth road with given steering and brakes; drive torque may hold the
    speed."""

    def __init__(self, speed, cars=None, n=4, seed=5, gravity=LEVEL):
        self.cars = cars or make_cars(n, seed, clean=True)
        self.n = len(self.cars)
        self.speed = np.broadcast_to(np.asarray(speed, float), self.n).copy()
        self.f = Fleet(self.cars, self.speed)
        self.gravity = np.array(gravity)[:, None] * np.ones(self.n)
        self.kept = []

    def run(self, seconds, wheel=0.0, hold=True, brake=0.0, keep=False):
        """Run. wheel: rad, mean angle of the road wheels with stiff steering; brake: N
        m a wheel."""
        f, p, none = self.f, self.f.p, np.zeros((2, 2, self.n))
        for _ in range(round(seconds / FINE)):
            force = (
                3.0 * p.mass * (self.speed - f.vx)
                + f.drag * f.vx**2
                + p.mass * GRAVITY * p.rolling_resistance
            )
            drive = f.drive_share * (force * p.radius_front) if hold else none
            if keep:
                self.kept.append(
                    np.vstack(
                        [f.state[[0, 1, 2, 5, 6, 7, 8, 4]], f.steering_wheel[None], f.spin.reshape(4, -1)]
                    )
                )
            f.advance(
                round(FINE / model.STEP),
                wheel * p.steering_ratio + 0 * f.vx,
                drive,
                none + brake,
                self.gravity,
                None,
            )
        return f

    def motion(self, i):
        state = {name: np.array([k[j, i] for k in self.kept]) for j, name in enumerate(STATES)}
        state |= {name: np.full(len(self.kept), self.gravity[j, i]) for j, name in enumerate(SLOPES)}
        return Motion(np.arange(len(self.kept)) * FINE, state)


@pytest.fixture(scope="module")
def turning():
    """Drive a steady left turn of 0.25 m/s2 at 10, 20, 30, 40 m/s."""
    rig = Rig([10, 20, 30, 40])
    c = [car.parameters for car in rig.cars]
    wheelbase = np.array([p["lf"] + p["lr"] for p in c])
    understeer = np.array([car.understeer() for car in rig.cars])
    rig.speed = np.array([10.0, 20, 30, 40])
    rig.wheel = 0.25 * (wheelbase / rig.speed**2 + understeer)
    rig.run(0.5, rig.wheel)
    rig.run(4.0, rig.wheel)
    return rig, wheelbase, understeer


def test_a_gentle_turn_has_the_yaw_rate_of_the_linear_single_track(turning):
    rig, wheelbase, understeer = turning
    f = rig.f
    handbook = f.vx * rig.wheel / (wheelbase + understeer * f.vx**2)
    np.testing.assert_allclose(f.r, handbook, rtol=0.03)
    load = f.p.mass * f.vx * f.r / wheelbase  # and the sideslip of its rear axle
    rear = (
        load
        * (f.p.lf - f.p.trail_pneumatic)
        / np.array([car.linear_stiffness()["cy_rear_effective"] for car in rig.cars])
    )
    angle = -(f.vy - f.p.lr * f.r) / f.vx
    np.testing.assert_allclose(angle + f.p.roll_steer_rear * f.roll, rear, rtol=0.03)


def test_forces_of_a_steady_turn_are_mass_times_acceleration(turning):
    rig, _, _ = turning
    f = rig.f
    side = f.force[1].sum((0, 1)) + (f.force[0, 0] * np.sin(f.steer)).sum(0)
    np.testing.assert_allclose(side, f.p.mass * f.vx * f.r, rtol=2e-3)


def test_loads_move_outwards_by_the_height_of_the_centre_of_gravity():
    rig = Rig([15, 18, 21, 24])
    f = rig.run(5.0, 0.03 + 0 * rig.speed)
    p, half = f.p, 0.5 * np.array([f.p.track_front, f.p.track_rear])
    moment = (half * (f.load[:, 1] - f.load[:, 0])).sum(0)
    mass = np.array([compute_sprung_mass(car.parameters)[0] for car in rig.cars])
    arm = np.array([compute_roll_arm(car.parameters) for car in rig.cars])
    side = f.force[1].sum((0, 1)) + (f.force[0, 0] * np.sin(f.steer)).sum(0)
    np.testing.assert_allclose(moment, side * p.cg_height + mass * GRAVITY * arm * f.roll, rtol=0.02)
    assert (f.roll > 0).all()
    # and a straight rig on the brakes moves load to the front by the same height
    rig = Rig(25.0)
    f = rig.run(2.5, hold=False, brake=350.0)
    along = f.force[0].sum((0, 1)) - f.drag * f.vx**2
    moved = f.load[0].sum(0) - f.static[0].sum(0)
    mass = np.array([compute_sprung_mass(car.parameters)[0] for car in rig.cars])
    pitch_arm = f.body_pitch / mass
    lean = mass * GRAVITY * pitch_arm * f.pitch  # the body leans over its front axle
    np.testing.assert_allclose(moved * (f.p.lf + f.p.lr), -along * f.p.cg_height + lean, rtol=0.02)
    assert (f.pitch > 0).all()


def test_standing_cars_have_static_axle_loads_and_stay():
    rig = Rig(0.0, gravity=(-0.25, -0.2, GRAVITY))
    f = rig.run(2.0, hold=False, brake=400.0)
    place = 0.0
    for _ in range(10):
        f = rig.run(0.3, hold=False, brake=400.0)
        place = place + 0.3 * np.hypot(f.vx, f.vy)
    assert (place < 1e-3).all() and (np.abs(f.spin) < 1e-9).all() and (np.abs(f.r) < 1e-4).all()
    np.testing.assert_allclose(f.load.sum((0, 1)), f.p.mass * GRAVITY, rtol=1e-3)
    rig = Rig(0.0)
    f = rig.run(1.0, hold=False)
    np.testing.assert_allclose(f.load[0].sum(0), f.p.mass * GRAVITY * f.p.lr / (f.p.lf + f.p.lr), rtol=1e-6)
    assert (np.abs(f.state[:3]) < 1e-9).all()


def test_coasting_loses_what_air_and_tyres_take():
    rig = Rig(30.0)
    rig.run(1.0, hold=False)
    before = rig.f.vx.copy()
    f = rig.run(2.0, hold=False)
    p = f.p
    turning = (f.inertia / f.radius**2).sum((0, 1))
    v = 0.5 * (before + f.vx)
    loss = (0.5 * AIR * p.drag_area * v**2 + p.rolling_resistance * p.mass * GRAVITY) / (p.mass + turning)
    np.testing.assert_allclose((before - f.vx) / 2.0, loss, rtol=0.01)
    # straight, but for the toe of an axle that carries both wheels alike
    assert (np.abs(f.r) < 1e-6).all() and (np.abs(f.vy) < 1e-6).all()


def test_energy_that_the_brakes_take_is_what_the_car_loses():
    rig = Rig(28.0)
    rig.run(1.0, hold=False)
    f, p = rig.f, rig.f.p

    def energy():
        return 0.5 * p.mass * f.vx**2 + 0.5 * (f.inertia * f.spin**2).sum((0, 1))

    before, taken = energy(), 0.0
    for _ in range(200):
        spin, vx, force = f.spin.copy(), f.vx.copy(), f.force.copy()
        rig.run(FINE, hold=False, brake=300.0)
        slipping = (f.force[0] * (f.rolling_radius * f.spin - f.vx)).sum((0, 1))  # heat of the tyres, little
        air = f.drag * vx**3
        taken = taken + FINE * (((300.0 + f.resistance) * spin).sum((0, 1)) + air + slipping)
    del force
    np.testing.assert_allclose(before - energy(), taken, rtol=0.01)


def test_left_and_right_are_mirror_images():
    left, right = Rig(14.0, n=2), Rig(14.0, n=2)
    for wheel in (0.05, 0.1, -0.03):
        left.run(0.4, wheel)
        right.run(0.4, -wheel)
    np.testing.assert_allclose(left.f.state[[1, 2, 5]], -right.f.state[[1, 2, 5]], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(left.f.state[[0, 7]], right.f.state[[0, 7]], rtol=1e-6, atol=1e-9)


def test_half_the_step_is_the_same_drive(monkeypatch):
    def drive():
        rig = Rig([6, 14, 28], n=3)
        for wheel, brake in ((0.02, 0), (-0.03, 300.0), (0.0, 0.0)):
            rig.run(0.5, wheel, hold=brake == 0, brake=brake)
        return rig.f

    coarse = drive()
    monkeypatch.setattr(model, "STEP", model.STEP / 2)
    fine = drive()
    # in transients half a step apart
    for a, b, most in zip(coarse.state[:3], fine.state[:3], (0.01, 0.003, 0.003), strict=True):
        np.testing.assert_allclose(a, b, atol=most)


def test_from_standstill_to_45_and_around_the_tightest_corner_all_stays_calm():
    rig = Rig([0.0, 0.3, 1.0, 3.0, 12.0, 30.0, 45.0], n=7)
    f = rig.run(3.0, np.array([0.3, 0.5, 0.5, 0.5, 0.1, 0.01, 0.005]))
    assert np.isfinite(f.state).all() and (np.abs(f.state[[4, 6, 8]]) < 0.02).all()
    slow = slice(1, 4)  # no slip to speak of: the rear axle follows the geometry
    geometry = f.vx * np.tan(f.steer) / (f.p.lf + f.p.lr)
    np.testing.assert_allclose(f.r[slow], geometry[slow], rtol=0.05)
    limit = f.load * f.mu0 * f.p.mu_x_ratio
    assert (np.hypot(*f.force) < 1.01 * limit).all()


def test_no_tyre_gives_more_than_friction_and_locked_wheels_stop_turning():
    rig = Rig(20.0)
    f = rig.run(1.0, 0.3, hold=False, brake=3000.0)
    assert (f.spin < 1.0).all() and np.isfinite(f.state).all()
    most = f.load * (f.mu0 - f.mu1 * f.load) * f.p.mu_x_ratio
    assert (np.hypot(*f.force) <= 1.001 * most).all()
    assert (np.hypot(*f.force) > 0.6 * most).any()


def test_standing_on_a_grade_the_accelerometer_reads_gravity():
    grade, bank = 0.06, 0.04
    gravity = (
        -GRAVITY * np.sin(grade),
        -GRAVITY * np.sin(bank) * np.cos(grade),
        GRAVITY * np.cos(grade) * np.cos(bank),
    )
    rig = Rig(0.0, gravity=gravity)
    rig.run(3.0, hold=False, brake=800.0)
    rig.run(0.2, hold=False, brake=800.0, keep=True)
    for i, car in enumerate(rig.cars):
        _, found = measure_motion(car, rig.motion(i))
        # uphill: forward
        assert found[0].mean() == pytest.approx(GRAVITY * np.sin(grade - rig.f.pitch[i]), abs=0.01)
        # left side up: left
        assert found[1].mean() == pytest.approx(GRAVITY * np.sin(bank + rig.f.roll[i]), abs=0.01)
        assert found[0].mean() == pytest.approx(GRAVITY * np.sin(grade), rel=0.12)  # the body leans, too
        assert abs(found[2].mean()) < 1e-4


def test_in_a_left_turn_accel_y_is_speed_times_yaw_rate_and_what_the_body_rolls(turning):
    rig, _, _ = turning
    rig.run(0.3, rig.wheel, keep=True)
    f = rig.f
    for i, car in enumerate(rig.cars):
        _, found = measure_motion(car, rig.motion(i))
        assert found[1].mean() == pytest.approx(f.vx[i] * f.r[i] + GRAVITY * f.roll[i], rel=0.01)
        moved = replace(car, sensors={**car.sensors, "imu_x": 0.5, "imu_y": 0.2, "imu_yaw": 0.02})
        _, other = measure_motion(moved, rig.motion(i))
        assert other[1].mean() - found[1].mean() == pytest.approx(
            -0.2 * f.r[i] ** 2 - 0.02 * found[0].mean(), abs=2e-3
        )
        assert other[0].mean() - found[0].mean() == pytest.approx(
            0.02 * found[1].mean() - 0.5 * f.r[i] ** 2, abs=2e-3
        )


def test_small_slips_have_the_linear_stiffness(turning):
    rig, _, _ = turning
    f = rig.f
    front, rear = (f.force[1].sum(1) / f.slip[1].mean(1))[:]
    for found, name in ((front, "cy_front"), (rear, "cy_rear")):
        np.testing.assert_allclose(found, [car.linear_stiffness()[name] for car in rig.cars], rtol=0.03)
    rig = Rig(20.0)
    f = rig.run(1.0, hold=False, brake=100.0)
    along = f.force[0, 0].sum(0) / f.slip[0, 0].mean(0) / f.load[0].sum(0) * f.static[0].sum(0)
    np.testing.assert_allclose(along, [car.linear_stiffness()["cx_front"] for car in rig.cars], rtol=0.03)


# ---- logs


@pytest.fixture(scope="module")
def logs():
    return {
        "mountain": make_logs("mountain", 0.11, 3, seed=3, clean=True),
        "city": make_logs("city", 0.07, 3, seed=3),
        "highway": make_logs("highway", 0.085, 3, seed=3, scenario="ice", event_time=2.0),
    }


def test_logs_are_whole(logs):
    assert set(logs) == set(ROADS)
    for road, found in logs.items():
        for x in found:
            assert tuple(x.log) == COLUMNS and tuple(x.reference) == REFERENCE
            assert all(np.isfinite(c).all() for c in x.log.values()), road
            assert all(np.isfinite(c).all() for k, c in x.reference.items() if not k.startswith("c")), road
            np.testing.assert_allclose(np.diff(x.log["time"]), 0.01, atol=1e-9)
            assert {len(c) for c in (*x.log.values(), *x.reference.values())} == {len(x.log["time"])}
            assert (np.abs(x.reference["vel_y"]) < 3).all() and (np.abs(x.reference["beside"]) < 8).all()
            json.dumps(x.truth, allow_nan=False)


def estimate_delay(channel: np.ndarray, truth: np.ndarray) -> float:
    """Return the latency of a channel, s, by least squares over delays, scale and offset
    free.

    Rows of 0.01 s.
    """
    rows = np.arange(len(truth)) * 0.01
    inner = slice(40, -40)
    # what the road shakes is too fast for rows, and would ask for delays of half a row
    bell = np.hanning(33) / np.hanning(33).sum()
    channel, truth = (np.convolve(x, bell, mode="same") for x in (channel, truth))

    def misfit(delay: float) -> float:
        x = np.stack([np.interp(rows - delay, rows, truth), np.ones(len(rows))], -1)[inner]
        return np.linalg.lstsq(x, channel[inner], rcond=None)[1][0]

    tried = np.arange(-0.01, 0.08, 0.0005)
    return float(tried[np.argmin([misfit(d) for d in tried])])


def test_channels_are_as_late_as_the_truth_says(logs):
    for x in logs["mountain"]:
        r, told = x.reference, x.truth["log"]["latency"]
        assert set(told) == set(CHANNELS) and all(-1e-9 <= v < 0.062 for v in told.values())
        assert estimate_delay(x.log["steer_angle"], r["steering_wheel"]) == pytest.approx(
            told["steer_angle"], abs=0.0015
        )
        assert estimate_delay(x.log["yaw_rate"], r["yaw_rate"]) == pytest.approx(told["yaw_rate"], abs=0.0015)
        for axle in ("front", "rear"):
            v = r["vel_x"] if axle == "rear" else r["vel_x"] * np.cos(r["road_wheel"]) + (
                r["vel_y"] + x.car.parameters["lf"] * r["yaw_rate"]) * np.sin(r["road_wheel"])  # fmt: skip
            s = r[f"slip_{axle}"]
            spin = np.where(s > 0, v / (1 - s), v * (1 + s)) / r[f"radius_{axle}"]
            assert estimate_delay(x.log[f"wheel_speed_{axle}"], spin) == pytest.approx(
                told[f"wheel_speed_{axle}"], abs=0.002
            )
        p = x.car.parameters
        # of the IMU over the axes
        above = (
            p["cg_height"] - compute_sprung_mass(p)[1] + compute_roll_arm(p),
            p["cg_height"] - p["pitch_centre"],
        )
        ddroll, ddpitch = (np.gradient(np.gradient(r[k], 0.01), 0.01) for k in ("roll", "pitch"))
        side = (
            np.gradient(r["vel_y"], 0.01)
            + r["vel_x"] * r["yaw_rate"]
            + GRAVITY * np.sin(r["bank"] + r["roll"])
        )
        side -= above[0] * ddroll
        assert estimate_delay(x.log["accel_y"], side) == pytest.approx(told["accel_y"], abs=0.002)
        push = (
            np.gradient(r["vel_x"], 0.01)
            - r["vel_y"] * r["yaw_rate"]
            + GRAVITY * np.sin(r["grade"] - r["pitch"])
        )
        push += above[1] * ddpitch
        assert estimate_delay(x.log["accel_x"], push) == pytest.approx(told["accel_x"], abs=0.002)


def test_what_is_logged_is_in_steps_and_slower_wheels_are_held(logs):
    for x in logs["city"] + logs["highway"]:
        q = x.car.sensors
        wheel = x.log["steer_angle"] * x.vehicle["steering_ratio"] / q["steering_wheel_step"]
        np.testing.assert_allclose(wheel, np.round(wheel), atol=1e-6)
        speed = 2 * x.log["wheel_speed_front"] * x.vehicle["wheel_radius_front"] / q["wheel_step"]
        np.testing.assert_allclose(speed, np.round(speed), atol=1e-6)
        accel = x.log["accel_x"] / q["accel_step"]
        np.testing.assert_allclose(accel, np.round(accel), atol=1e-6)
    for x in logs["highway"]:
        same = np.mean(np.diff(x.log["wheel_speed_rear"]) == 0)
        assert same > 0.45 if x.car.sensors["period"]["wheel_speed_rear"] == 0.02 else same < 0.8


def test_pulses_of_a_wheel_are_its_speed_and_none_while_it_stands():
    car = make_cars(1, 4, clean=True)[0]
    car = replace(car, sensors={**car.sensors, "wheel_pulses": 48, "latency": dict.fromkeys(CHANNELS, 0.03)})
    time = np.arange(0, 12, FINE)
    spin = np.interp(time, [0, 2, 4, 10], [0, 0, 40, 80])
    state = {name: np.zeros(len(time)) for name in (*STATES, *SLOPES)}
    state |= {name: spin for name in STATES if name.startswith("spin")} | {"gz": np.full(len(time), GRAVITY)}
    rows = np.arange(1.0, 10.0, 0.01)
    log, latency = make_log(car, Motion(time, state), rows, np.random.default_rng(0))
    late = latency["wheel_speed_rear"]
    assert late == pytest.approx(0.03, abs=0.006)
    there = rows > 5
    np.testing.assert_allclose(
        log["wheel_speed_rear"][there], np.interp(rows - late, time, spin)[there], atol=0.15
    )
    assert (log["wheel_speed_rear"][rows < 1.9] == 0).all()


def test_while_the_car_waits_wheels_stand_and_it_stays(logs):
    for x in logs["city"]:
        r = x.reference
        standing = r["time"] < 0.4
        assert (np.abs(r["vel_x"][standing]) < 0.01).all() and (
            x.log["wheel_speed_rear"][standing] == 0
        ).all()
        assert np.isnan(r["cy_front"][standing]).all()
        assert r["vel_x"].max() > 1


def test_a_driver_stops_where_told_waits_and_goes_on():
    cars, streams = make_cars(2, 6), [np.random.default_rng(k) for k in range(2)]
    line = np.zeros((300, 2))
    road = Road(line, line + 8.0, line, line + 0.03, line, np.array([[1.0, 1], [24, 24], [np.inf, np.inf]]),
                np.array([[0.5, 0.5], [1.5, 1.5], [0, 0]]), np.zeros(2), np.zeros(2, int))  # fmt: skip
    fleet = Fleet(cars, np.zeros(2))
    record = drive(cars, fleet, road, Surface("dry", streams, 14.0, None, fleet.x), streams, 11.5)
    speed, place = record.reference[:, RECORDED.index("vel_x")], record.reference[:, RECORDED.index("place")]
    waits = (speed < 0.1) & (place > 14)
    assert (np.abs(np.where(waits, place, 24) - 24) < 3).all()
    assert (
        ((waits.sum(0) > 100) & (waits.sum(0) < 300)).all()
        and (place[-1] > 25).all()
        and (speed.min(0) > -0.1).all()
    )


def test_secants_are_near_the_linear_stiffness_and_fall_on_ice(logs):
    for x in logs["mountain"]:
        for name in ("cx_front", "cy_front", "cy_rear"):
            found = x.reference[f"{name}_tyre"]
            if np.isfinite(found).sum() < 50:  # the front axle of a rear-driven car that did not brake
                continue
            ratio = np.nanmedian(found) / x.truth["linear_stiffness"][name]
            assert 0.75 < ratio < 1.1, name
    for x in logs["highway"]:
        r, event = x.reference, x.truth["log"]["event"]
        assert 2.0 <= event["time"] < 5.0
        ice = r["time"] > event["time"] + 0.5
        assert (r["road_friction"][r["time"] < event["time"]] == 1).all() and (
            r["road_friction"][ice] < 0.45
        ).all()
        fallen = np.nanmedian(r["cx_front_tyre"][ice]) / x.truth["linear_stiffness"]["cx_front"]
        assert fallen == pytest.approx(event["along"][0][0], rel=0.25)


def test_the_same_seed_is_the_same_log_and_a_car_does_not_depend_on_the_others():
    first, again, alone = (make_logs("mountain", 0.005, n, seed=8) for n in (2, 2, 1))
    for a, b in zip(first, again, strict=True):
        assert all(np.array_equal(a.log[c], b.log[c]) for c in COLUMNS) and a.truth == b.truth
    assert alone[0].truth == first[0].truth
    for c in COLUMNS:
        np.testing.assert_allclose(alone[0].log[c], first[0].log[c], rtol=1e-6, atol=0.03)
    assert first[0].car.parameters != first[1].car.parameters
    assert make_cars(1, 9)[0].parameters != make_cars(1, 8)[0].parameters


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_roads_that_change_do_so_where_the_car_is_calm(scenario):
    x = np.array([[1.2, 1.2], [-1.5, -1.5]])[..., None]
    surface = Surface(scenario, [np.random.default_rng(4)], 100.0, 10.0, x)
    seen = []
    for k in range(400):  # 20 m/s, cornering until 12 s
        surface.follow(0.5 * k, np.array([10.0 * k]), np.array([5.0 if k < 24 else 0.2]))
        seen.append(surface.now.copy())
    seen = np.array(seen)[..., 0]  # times; friction, along, across, radius; axles; sides
    assert (seen[:20] == 1).all()
    if scenario == "dry":
        assert (seen == 1).all()
        return
    begun = surface.time[0]
    assert begun == (10.0 if scenario in Surface.SLOW else 12.0)
    friction, along, across, radius = seen[round(2 * begun) + 3]
    if scenario in ("ice", "low_limit", "snow", "wet"):
        assert (friction < (0.9 if scenario == "wet" else 0.65)).all() and (
            seen[-1] == surface.end[..., 0]
        ).all()
    if scenario == "split":
        assert ((friction < 0.5).all(0)).sum() == 1 and ((friction == 1).all(0)).sum() == 1
    if scenario == "aquaplaning":
        assert (
            (friction[0] < friction[1]).all()
            and (seen[-1] == 1).all()
            and (seen[round(2 * (begun + 4))] == 1).all()
        )
    if scenario == "pressure":
        changed = (seen[-1, 2] < 0.85) & (seen[-1, 3] < 1)
        assert changed.sum() == 1 and (seen[:, 0] == 1).all() and (np.diff(seen[:, 2].min((1, 2))) <= 0).all()
    if scenario in ("front_axle", "rear_axle"):
        axle = int(scenario == "rear_axle")
        assert (seen[-1, 1:3, axle] == 0.8).all() and (seen[:, :, 1 - axle] == 1).all()
        assert (seen[round(2 * (begun + 20)), 2, axle] == 0.8).all() and (
            seen[round(2 * (begun + 10)), 2, axle] == 0.9
        ).all()
    assert (across < 1).any() == (scenario != "low_limit") and (along <= 1).all() | (scenario == "pressure")
    assert (radius == 1).all() | (scenario == "pressure")


def test_a_car_that_floats_for_three_seconds_stays_on_its_road():
    x = make_logs("highway", 0.07, 2, seed=2, scenario="aquaplaning", event_time=0.1)
    for log in x:
        assert (
            all(np.isfinite(c).all() for c in log.log.values())
            and (np.abs(log.reference["beside"]) < 8).all()
        )
        assert log.reference["road_friction"].min() < 0.6 and log.reference["road_friction"][-1] == 1


def test_cars_are_plausible():
    for car in make_cars(60, 11):
        p, c = car.parameters, car.linear_stiffness()
        assert (
            1100 <= p["mass"] <= 2300
            and 2.3 < p["lf"] + p["lr"] < 3.05
            and 0.35 < p["lf"] / (p["lf"] + p["lr"]) < 0.55
        )
        assert (
            0.8 <= p["yaw_inertia"] / (p["mass"] * p["lf"] * p["lr"]) <= 1.2
            and 0.0005 < car.understeer() < 0.009
        )
        load = p["mass"] * GRAVITY * p["lr"] / (p["lf"] + p["lr"])
        assert 6 < c["cy_front"] / load < 26 and 15 < c["cx_front"] / load < 34
        v = car.vehicle
        assert v["mass"] == pytest.approx(p["mass"], abs=0.1) and v["lf"] + v["lr"] == pytest.approx(
            v["wheelbase"], abs=1e-3
        )
        assert 0 <= 1 - p["radius_front"] / v["wheel_radius_front"] <= 0.01
        assert abs(p["steering_ratio"] / v["steering_ratio"] - 1) <= 0.03 and "yaw_inertia" not in v
    heavier = make_cars(1, 11, mass_error=0.1, cg_error=0.05, tell_inertia=True)[0]
    assert (
        heavier.vehicle["mass"] == pytest.approx(1.1 * heavier.parameters["mass"], abs=0.1)
        and "yaw_inertia" in heavier.vehicle
    )
    assert heavier.vehicle["lf"] == pytest.approx(heavier.parameters["lf"] + 0.05, abs=1e-3)


def test_files_hold_what_the_arrays_hold(tmp_path, logs):
    x = logs["city"][0]
    x.write(tmp_path / "car_0", "city")
    logs["city"][0].write(tmp_path / "car_0", "again")
    read = np.genfromtxt(tmp_path / "car_0" / "log_city.csv", delimiter=",", names=True)
    assert read.dtype.names == COLUMNS
    for c in COLUMNS:
        np.testing.assert_allclose(read[c], x.log[c], rtol=1e-7, atol=1e-9)
    reference = np.genfromtxt(tmp_path / "car_0" / "reference_city.csv", delimiter=",", names=True)
    np.testing.assert_allclose(reference["cy_front"], x.reference["cy_front"], rtol=1e-6)
    truth = json.loads((tmp_path / "car_0" / "truth.json").read_text())
    assert truth["parameters"] == x.car.parameters and set(truth["logs"]) == {"city", "again"}
    assert f"mass = {x.vehicle['mass']}" in (tmp_path / "car_0" / "car.toml").read_text()


def test_no_sensor_tells_rear_tyres_from_a_suspension_that_gives_in_with_their_force():
    (car,) = make_cars(1, 3, clean=True)
    own, tyres = car.parameters, 2 * car.parameters["cornering_rear"]
    stiffer = 1.1 * tyres
    soft = 1 / tyres - 1 / stiffer  # rad/N: compliance of a suspension that keeps the axle unchanged
    others = (
        {"cornering_rear": stiffer / 2, "compliance_rear": own["compliance_rear"] + soft},
        {"cornering_rear": stiffer / 2},
    )
    read = []
    for change in ({}, *others):
        rig = Rig(25.0, cars=[replace(car, parameters=own | change)])
        for wheel in (0.0, 0.01, 0.02, -0.015, 0.0, 0.01):
            rig.run(0.7, wheel, keep=True)
        read.append(measure_motion(rig.cars[0], rig.motion(0))[1][1:])
    alike, unlike = (np.sqrt(np.mean((x - read[0]) ** 2, axis=1)) for x in read[1:])
    assert (alike < 0.15 * unlike).all()
