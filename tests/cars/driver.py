"""Simulate drivers: preview of the path, intermittent corrections, slow hands and feet.

Steering: the curvature of the road a little ahead, for which the driver knows the angle
(understeer within 10 %), plus a correction by the predicted offset at the preview point
(MacAdam 1981; optimal preview reduces to it). Corrections are intermittent (Gawthrop et
al. 2011). Arms are of second order, with a remnant. Speed: the road's, with pedal
changes of at least a quarter of a second, gears, and anti-lock and traction control by
axle.
"""

import numpy as np
from scipy.signal import lfilter

from .cars import GRAVITY, Car
from .model import Fleet
from .road import Road, Surface

CONTROL = 0.01  # s
MAX_HAND_RATE = 8.0  # rad/s, of the steering wheel
LOOK = 0.8  # s, how far ahead speed is read from the road
TRAITS = {  # of a driver, drawn uniformly
    "preview": (1.3, 1.9),  # s
    "least_preview": (4.0, 5.5),  # m
    "gain": (0.6, 0.9),  # 1, of the correction
    "attention": (0.1, 0.4),  # s, mean time between two corrections
    "startles": (0.15, 0.4),  # m, error at the preview point with an immediate correction
    "arms": (8.5, 14.0),  # rad/s
    "arms_damping": (0.75, 0.95),
    "misjudged": (-0.1, 0.1),  # 1, of the understeer
    "remnant": (0.003, 0.011),  # rad, sd at the steering wheel at 25 m/s
    "remnant_time": (0.25, 0.8),  # s
    "restless": (0.02, 0.05),  # 1, sd of the wanted speed
    "pedal_noise": (0.05, 0.2),  # m/s2
    "accelerate": (1.3, 2.6),  # m/s2, most
    "brake": (2.5, 4.0),
    "jerk": (2.0, 5.0),  # m/s3
    "change_pedals": (0.25, 0.6),  # s
    "stops_with": (1.2, 2.2),  # m/s2
}
GEARS = np.array([3.5, 7.0, 11.5, 17.0, 24.0])  # m/s, where a gearbox changes up


def draw_wander(rng: np.random.Generator, n: int, tau: float) -> np.ndarray:
    """Return noise of sd 1 and correlation time tau, s, every CONTROL, smoothed by two
    poles."""
    keep = np.exp(-CONTROL / tau)
    x = rng.standard_normal(n + 500)
    for _ in range(2):
        x = lfilter([1 - keep], [1, -keep], x)
    return x[500:] / ((1 - keep) ** 2 * np.sqrt((1 + keep**2) / (1 - keep**2) ** 3))


class Drivers:
    """A driver for each car. decide() sets steering_wheel, drive, brake for CONTROL
    seconds."""

    def __init__(
        self,
        cars: list[Car],
        fleet: Fleet,
        road: Road,
        surface: Surface,
        streams: list[np.random.Generator],
        steps: int,
    ) -> None:
        self.fleet, self.road, self.surface = fleet, road, surface
        n = fleet.n
        traits = [{k: rng.uniform(*span) for k, span in TRAITS.items()} for rng in streams]
        self.t = {k: np.array([t[k] for t in traits]) for k in TRAITS}
        noise = [
            np.stack(
                [
                    draw_wander(rng, steps, t["remnant_time"]),
                    draw_wander(rng, steps, 6.0),
                    draw_wander(rng, steps, 0.7),
                    rng.random(steps),
                ]
            )
            for rng, t in zip(streams, traits, strict=True)
        ]
        self.noise = np.stack(noise, -1)  # (remnant, speed, pedal, attention; steps; cars)
        p = fleet.p
        self.understeer = np.array([c.understeer() for c in cars]) * (1 + self.t["misjudged"])
        self.wheelbase = p.lf + p.lr
        # hands and the car's yaw rate answer late; the road is read that much earlier
        self.early = (
            2 * self.t["arms_damping"] / self.t["arms"] + 2 * p.steering_damping / p.steering_frequency + 0.06
        )
        # m, m, rad: along, beside and against the road
        self.s, self.e, self.psi = (np.zeros(n), np.zeros(n), np.zeros(n))
        self.correction = np.zeros(n)  # 1/m
        self.steering_wheel, self.turning = np.zeros(n), np.zeros(n)
        self.accel = np.zeros(n)  # m/s2, wanted
        # 1 throttle, 0 neither, -1 brake; s left until the foot is there
        self.pedal, self.changing = (np.ones(n), np.zeros(n))
        self.thrust, self.braking = np.zeros(n), np.zeros(n)  # N, after engine and brakes
        self.gear, self.shifting = np.zeros(n), np.zeros(n)
        self.antilock, self.traction = np.ones((2, 1, n)), np.ones((2, 1, n))
        self.stop, self.wait, self.standing = np.zeros(n, np.intp), np.zeros(n), np.zeros(n, bool)
        self.stopping, self.lost = np.zeros(n, bool), np.zeros(n, bool)
        self.cars = np.arange(n)

    def move(self) -> None:
        """Follow the car along the road for CONTROL seconds."""
        f = self.fleet
        bend = self.road.at(self.road.curvature, self.s)
        cos, sin = np.cos(self.psi), np.sin(self.psi)
        ds = (f.vx * cos - f.vy * sin) / np.maximum(1 - self.e * bend, 0.3)
        self.s += CONTROL * ds
        self.e += CONTROL * (f.vx * sin + f.vy * cos)
        self.psi += CONTROL * (f.r - bend * ds)
        # who has left the road brakes to a standstill and finds a road again
        self.lost |= (np.abs(self.psi) > 1.0) | (np.abs(self.e) > 10.0)
        found = self.lost & (np.abs(f.vx) < 0.2) & (np.abs(f.vy) < 0.2)
        self.lost &= ~found
        for x in (self.e, self.psi, self.correction):
            x[found] = 0.0

    def asked(self) -> np.ndarray:
        """Return the lateral acceleration, m/s2: the larger one of road and car.

        That of the road is here and shortly ahead.
        """
        v = np.abs(self.fleet.vx)
        ahead = [np.abs(self.road.at(self.road.curvature, self.s + t * v)) for t in (0.0, 1.5, 3.0)]
        return np.maximum(v * v * np.maximum.reduce(ahead), v * np.abs(self.fleet.r))

    def decide(self, k: int) -> None:
        self._steer(k)
        self._choose_speed(k)
        self._press()

    def _steer(self, k: int) -> None:
        f, t, road = self.fleet, self.t, self.road
        v = np.maximum(f.vx, 0.5)
        look = np.maximum(v * t["preview"], t["least_preview"])
        # where the car will be heading once it has answered what the hands do already
        heading = (
            self.psi + f.vy / np.maximum(v, 3.0) + self.early * (f.r - v * road.at(road.curvature, self.s))
        )
        miss = road.at(road.offset, self.s + look) - self.e - look * np.sin(np.clip(heading, -0.7, 0.7))
        due = np.clip(t["gain"] * 2 * miss / look**2, -0.08, 0.08)
        notice = (self.noise[3, k] < CONTROL / t["attention"]) | (
            np.abs(due - self.correction) * look**2 > 2 * t["startles"]
        )
        self.correction = np.where(notice, due, self.correction)
        bend = road.at(road.curvature, self.s + v * self.early)
        grip = 0.75 * self.surface.known * GRAVITY / (v * v)
        bend = np.clip(bend + self.correction, -np.minimum(grip, 0.2), np.minimum(grip, 0.2))
        angle = np.arctan(self.wheelbase * bend) + self.understeer * v * v * bend
        angle = np.where(self.lost, np.arctan2(f.vy, v), angle)  # look where you go
        wanted = f.p.steering_ratio * np.clip(angle, -0.6, 0.6)
        wanted += t["remnant"] * (0.6 + 12 / (v + 5)) * self.noise[0, k]
        wanted = np.where(f.vx < 0.3, self.steering_wheel, wanted)
        w = t["arms"]
        self.turning += CONTROL * (
            w * w * (wanted - self.steering_wheel) - 2 * t["arms_damping"] * w * self.turning
        )
        self.turning = np.clip(self.turning, -MAX_HAND_RATE, MAX_HAND_RATE)
        self.turning = np.where(f.vx < 0.3, 0.8 * self.turning, self.turning)
        self.steering_wheel = self.steering_wheel + CONTROL * self.turning

    def _choose_speed(self, k: int) -> None:
        """Choose the wanted acceleration, m/s2."""
        f, t, road = self.fleet, self.t, self.road
        v, known = f.vx, self.surface.known
        ahead = self.s + np.maximum(LOOK * v, 1.5)
        wanted = road.at(road.speed, ahead) * (1 + t["restless"] * self.noise[1, k])
        slippery = known < 0.9
        if slippery.any():  # slower, and as the next curve allows
            bend = np.maximum.reduce(
                [
                    np.abs(road.at(road.curvature, self.s + x * np.maximum(v, 4.0)))
                    for x in (0.5, 1.5, 3.0, 4.5)
                ]
            )
            careful = np.minimum(0.8 * wanted, np.sqrt(0.3 * known * GRAVITY / np.maximum(bend, 1e-4)))
            wanted = np.where(slippery, np.maximum(careful, 2.0), wanted)
        accel = (wanted - v) / LOOK + t["pedal_noise"] * self.noise[2, k]
        left = road.stop_at[self.stop, self.cars] - self.s
        # who has begun to brake for a stop brakes until the car stands, be it a little
        # before or behind the line
        need = v * v / (2 * np.maximum(left, 0.3))
        self.stopping |= ~self.standing & (need > 0.7 * t["stops_with"]) & np.isfinite(left)
        accel = np.where(self.stopping, -np.clip(need, 0.5, t["brake"]), accel)
        accel = np.where(self.lost, -4.0, accel)
        accel = np.clip(
            accel,
            -np.minimum(t["brake"], 0.45 * known * GRAVITY),
            np.minimum(t["accelerate"], 0.25 * known * GRAVITY),
        )
        # feet move at their own pace; only for a stop are they sure
        most = CONTROL * np.where(accel < -2, 2, 1) * t["jerk"]
        self.accel = self.accel + np.clip(accel - self.accel, -most, most)
        arrived = ~self.standing & (v < 0.25) & (self.stopping | (left < 3.0))
        self.stopping &= ~arrived
        self.wait = np.where(arrived, road.stop_for[self.stop, self.cars], self.wait - CONTROL)
        leaves = self.standing & (self.wait <= 0)
        self.stop = self.stop + leaves
        self.standing = (self.standing | arrived) & ~leaves
        self.accel = np.where(self.standing, -1.0, np.where(leaves, 0.0, self.accel))

    def _press(self) -> None:
        """Set torques of drive and brakes by the wanted acceleration."""
        f, t, p = self.fleet, self.t, self.fleet.p
        v = np.maximum(f.vx, 0.0)
        grade = self.road.at(self.road.grade, self.s)
        need = p.mass * (self.accel + GRAVITY * (grade + p.rolling_resistance)) + f.drag * v * v
        drag = np.where(v > 2.0, p.engine_drag, 0.0) + np.where(v > 2.0, 0.0, 0.1 * p.mass)
        # pedals: neither between what the engine brakes and nothing; a foot that changes
        # over takes its time
        want = np.where(need > -0.3 * drag, 1.0, np.where(need < -drag - 0.1 * p.mass, -1.0, 0.0))
        want = np.where(self.standing, -1.0, want)
        over = (want * self.pedal < 0) & ~self.standing
        self.changing = np.where(over, t["change_pedals"], np.maximum(self.changing - CONTROL, 0))
        self.pedal = np.where(self.changing > 0, 0.0, want)
        # gears: the torque is gone while one is changed, upwards only
        gear = (v[None] > GEARS[:, None]).sum(0)
        self.shifting = np.where(
            (gear > self.gear) & (self.pedal > 0), p.gearbox_gap, np.maximum(self.shifting - CONTROL, 0)
        )
        self.gear = np.where(
            gear > self.gear,
            gear,
            np.where(v < 0.75 * GEARS[np.maximum(self.gear - 1, 0).astype(int)], gear, self.gear),
        )
        throttle = np.minimum(np.maximum(need, 0), p.power / np.maximum(v, 4.0)) * (self.shifting <= 0)
        thrust = np.where(
            self.pedal > 0, throttle, np.where(v > 2.0, -p.engine_drag * np.minimum((v - 2) / 3, 1), 0)
        )
        hold = p.mass * (1.2 + 1.2 * GRAVITY * np.abs(grade))
        braking = np.where(
            self.standing,
            hold,
            np.where(self.pedal < 0, np.maximum(-need - np.where(v > 2.0, p.engine_drag, 0), 0), 0),
        )
        self.thrust += CONTROL / 0.12 * (thrust - self.thrust)
        self.braking += CONTROL / 0.07 * (braking - self.braking)
        # anti-lock and traction control by axle, on the slip of its worse wheel
        slip = (f.rolling_radius * f.spin - f.vx) / np.maximum(np.abs(f.vx), 2.5)
        locks, spins = slip.min(1, keepdims=True) < -0.12, slip.max(1, keepdims=True) > 0.1
        self.antilock = np.where(
            locks, np.maximum(0.75 * self.antilock, 0.05), np.minimum(self.antilock + 0.04, 1)
        )
        self.traction = np.where(
            spins, np.maximum(0.75 * self.traction, 0.05), np.minimum(self.traction + 0.02, 1)
        )
        radius = 0.5 * (p.radius_front + p.radius_rear)
        held = np.where(self.standing, 1.0, self.antilock)
        self.drive = f.drive_share * (self.thrust * radius) * self.traction
        self.brake = f.brake_share * (self.braking * radius) * held
