"""Drives with manoeuvres: parking places and three-point turns between streets.

The car is a single track that rolls both ways, with tyres that have a relaxation length.
The sensors have noise, and the wheel speeds have no sign.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

STEP, SUB = 0.01, 5  # s: between rows; steps of the integration in one
G = 9.81
Part = tuple[
    float, float, float
]  # s at most, speed [m/s], steering angle [rad]; a negative speed is backwards


@dataclass(frozen=True)
class Car:
    mass: float
    lf: float
    lr: float
    inertia: float
    front: float  # N/rad
    rear: float
    radius: float
    lock: float  # rad

    def vehicle(self) -> str:
        """Return the vehicle file of an ordinary car with known mass and axles."""
        return (
            f'name = "car"\nmass = {self.mass}\nlf = {self.lf}\nlr = {self.lr}\n'
            f'wheel_radius_front = {self.radius}\nwheel_radius_rear = {self.radius}\ndriven_axle = "front"\n'
        )


@dataclass(frozen=True)
class Drive:
    car: Car
    log: pd.DataFrame  # wheel speeds without their sign
    speed: np.ndarray  # m/s, with it


def draw_car(rng: np.random.Generator) -> Car:
    mass, wheelbase = rng.uniform(1200.0, 2100.0), rng.uniform(2.5, 2.95)
    lf = wheelbase * rng.uniform(0.43, 0.5)
    lr = wheelbase - lf
    front = mass * G * lr / wheelbase * rng.uniform(9.5, 13.0)
    rear = mass * G * lf / wheelbase * rng.uniform(12.5, 16.0)
    return Car(
        mass,
        lf,
        lr,
        mass * lf * lr * rng.uniform(0.95, 1.1),
        front,
        rear,
        rng.uniform(0.29, 0.35),
        rng.uniform(0.52, 0.65),
    )


def draw_street(rng: np.random.Generator, seconds: float) -> list[Part]:
    """Draw bends and lane changes at 7 .. 17 m/s."""
    parts, done = [], 0.0
    while done < seconds:
        v, length = rng.uniform(7.0, 17.0), rng.uniform(1.0, 3.0)
        parts.append(
            (length, v, float(rng.choice([-1, 1])) * rng.uniform(1.0, 4.5) * (2.7 + 0.006 * v * v) / v**2)
        )
        done += length
    return [*parts, (1.0, 8.0, 0.0), (8.0, 0.0, 0.0)]


def draw_exit(rng: np.random.Generator, lock: float, back: float) -> list[Part]:
    """Leave a parking place: back in an arc, perhaps almost straight, then forward."""
    side = float(rng.choice([-1, 1]))
    arc = side * lock * rng.uniform(0.4, 1.0)
    parts = [(rng.uniform(0.5, 3.0), 0.0, arc), (rng.uniform(3.0, 7.0), -back, arc)]
    if rng.random() < 0.5:
        parts += [(rng.uniform(2.0, 4.0), -back, side * x * lock) for x in rng.uniform(-0.25, 0.25, 3)]
    return [*parts, (8.0, 0.0, 0.0), (rng.uniform(0.2, 2.0), 0.0, -arc), (3.0, rng.uniform(1.0, 4.0), -arc)]


def draw_three_point_turn(rng: np.random.Generator, lock: float, back: float) -> list[Part]:
    """Turn round in three points."""
    side = float(rng.choice([-1, 1]))
    ahead = [
        (4.0, rng.uniform(1.5, 4.0), side * lock),
        (8.0, 0.0, side * lock),
        (rng.uniform(0.2, 1.5), 0.0, -side * lock),
    ]
    behind = [
        (rng.uniform(3.0, 5.0), -back, -side * lock),
        (8.0, 0.0, -side * lock),
        (rng.uniform(0.2, 1.5), 0.0, side * lock),
    ]
    return [*ahead, *behind, (3.0, 4.0, side * 0.7 * lock)]


def drive(seed: int, forward: bool = False) -> Drive:
    """Return a drive with six manoeuvres.   forward: all of it is driven forward."""
    rng = np.random.default_rng(seed)
    car = draw_car(rng)
    parts = [(2.0, 0.0, 0.0), *draw_street(rng, 40.0)]
    for _ in range(6):
        parts += (draw_exit if rng.random() < 0.5 else draw_three_point_turn)(
            rng, car.lock, rng.uniform(1.0, 4.0)
        )
        parts += draw_street(rng, rng.uniform(15.0, 35.0))
    if forward:
        parts = [(seconds, abs(v), angle) for seconds, v, angle in parts]
    return drive_parts(car, parts, rng)


def drive_parts(car: Car, parts: list[Part], rng: np.random.Generator) -> Drive:
    """Drive as a driver does: limited change of speed and limited steering rate."""
    h, length = STEP / SUB, car.lf + car.lr
    vx = vy = r = angle = af = ar = push = 0.0
    relax, mu, slope, at = 0.35, 1.0, 0.0, 0.0
    rows: list[tuple[float, ...]] = []
    grades = np.interp(np.arange(4000), np.arange(0, 4000, 120), 0.02 * rng.standard_normal(34))
    for seconds, wanted, to in parts:
        strength = rng.uniform(0.8, 2.2)
        for _ in range(round(seconds / STEP)):
            for _ in range(SUB):
                rate = 0.7 if abs(vx) < 5 else 0.35
                angle += np.clip(to - angle, -rate * h, rate * h)
                brake = 1.4 * strength if vx > 0 else strength
                target = np.clip(1.5 * (wanted - vx), -brake, strength)
                push += h * (target - push) / 0.15
                sin, cos = np.sin(angle), np.cos(angle)
                across_front, along_front = (
                    (vy + car.lf * r) * cos - vx * sin,
                    vx * cos + (vy + car.lf * r) * sin,
                )
                af += h * (-across_front - abs(along_front) * af) / relax
                ar += h * (-(vy - car.lr * r) - abs(vx) * ar) / relax
                most_front, most_rear = (
                    mu * car.mass * G * car.lr / length,
                    mu * car.mass * G * car.lf / length,
                )
                front = most_front * np.tanh(car.front * af / most_front)
                rear = most_rear * np.tanh(car.rear * ar / most_rear)
                ax = push - front * sin / car.mass
                ay = (front * cos + rear) / car.mass
                vx += h * (ax + r * vy)
                vy += h * (ay - r * vx)
                r += h * (car.lf * front * cos - car.lr * rear) / car.inertia
                if wanted == 0.0 and abs(vx) < 0.03:
                    vx = vy = r = af = ar = push = ax = ay = 0.0
            at += vx * STEP
            slope = grades[int(abs(at)) % 4000]
            slip = push * car.mass / (14.0 * car.mass * G)
            rolled = along_front + abs(along_front) * slip * (vx != 0)
            rows.append((angle, rolled / car.radius, vx / car.radius, ax + G * slope, ay, r, vx))
        if wanted == 0.0:
            vx = vy = r = af = ar = push = 0.0
    columns = np.array(rows).T
    names = ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")
    log = {"time": STEP * np.arange(len(rows))} | dict(zip(names, columns, strict=False))
    offset = {"steer_angle": 0.004, "accel_x": 0.1, "accel_y": 0.1, "yaw_rate": 0.004}
    noise = {"steer_angle": 0.0005, "accel_x": 0.1, "accel_y": 0.1, "yaw_rate": 0.003}
    for name, sd in noise.items():
        log[name] = log[name] + offset[name] * rng.standard_normal() + sd * rng.standard_normal(len(rows))
    for name in names[1:3]:
        log[name] = np.abs(np.round(log[name] / 0.02) * 0.02)
    return Drive(car, pd.DataFrame(log), columns[6])
