"""Logs of a multi-body car that shares no code with tse: `commonroad-vehicle-models` 3.0.2 (BSD), 29 states, three cars.

    python -m tests.gap.multibody OUT --car 1 [--seed N] [--log NAME ...] [--no-noise] [--tyre KIND] [--step MS]

OUT gets four logs to fit (log_*.csv), two of other manoeuvres (hold_out_*.csv), the car as its engineer knows it (car.toml),
and what of src/tables/effects.toml it has beyond the model (truth.json). 1: Ford Escort, 2: BMW 320i, 3: VW Vanagon; one ADAMS
tyre for all.

The package's axes are those of SAE (z down, y right: a left wheel runs faster for yaw rate > 0, gravity adds to z'), tse's of
ISO 8855 (z up, y left). Here all is SAE until `sensors` turns it round; a `Program` is what a driver wants, so it is ISO.
"""

from __future__ import annotations

import argparse
import copy
import json
import sys
import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import vehiclemodels.utils.tire_model as tyre
from scipy.optimize import least_squares
from vehiclemodels.init_mb import init_mb
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb as rates
from vehiclemodels.vehicle_parameters import VehicleParameters, setup_vehicle_parameters

GRAVITY = 9.81  # m/s2, as in the package
STEP = 0.001  # s, of the integration
SAMPLE = 0.01  # s, of the logs
SETTLE = 3.0  # s driven straight before a log begins
DURATION = 45.0  # s of a log
SPEED_GAIN = 0.5  # 1/s: acceleration that the driver adds per speed that is missing
STEER_GAIN = 30.0  # 1/s: how fast the steering goes where it should be
STEER_RATE = 0.36  # rad/s of the road wheels; the package turns them by 0.4 at most
NAMES = {1: "Ford Escort", 2: "BMW 320i", 3: "VW Vanagon"}

# Places in the package's state. SAE; *_U: unsprung, front and rear.
STEER, VX, YAW_RATE, ROLL, PITCH, PITCH_RATE, VY, HEIGHT = 2, 3, 5, 6, 8, 9, 10, 11
ROLL_U, ROLL_RATE_U, VY_U, HEIGHT_U, OMEGA = (13, 18), (14, 19), (15, 20), (16, 21), slice(23, 27)

COLUMNS = ("time", "steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")
NOISE = {  # sd of one sample, white: rad; rad/s, mean of an axle's wheels; m/s2; rad/s
    "steer_angle": 5e-4, "wheel_speed_front": 0.05, "wheel_speed_rear": 0.05,
    "accel_x": 0.05, "accel_y": 0.05, "yaw_rate": 0.003,
}  # fmt: skip

# half step, state -> steering rate in rad/s, acceleration in m/s2
Input = Callable[[int, list[float]], tuple[float, float]]


# ---- the car and its tyres


def parameters(number: int, kind: str = "package") -> VehicleParameters:
    """The package's parameter set, with one of TYRES."""
    return TYRES[kind](setup_vehicle_parameters(number))


def smooth(p: VehicleParameters) -> VehicleParameters:
    """A copy without the shifts of side force that the package turns with the sign of camber, which make it jump at 0."""
    p = copy.deepcopy(p)
    p.tire.p_hy1 = p.tire.p_vy1 = 0.0
    return p


def physical(p: VehicleParameters) -> VehicleParameters:
    """A copy whose tyres do as real ones where the package's do not.

    No jump; a wheel that leans to a side pushes to that side (the package takes camber of ISO's axes for SAE's); side force by
    slip cancels from left to right; p_vx1 load, which the package has within the sine of the magic formula, is left out."""
    p = smooth(p)
    p.tire.p_hy3, p.tire.p_vy3 = -p.tire.p_hy3, -p.tire.p_vy3
    p.tire.r_vy1 = p.tire.r_vy3 = p.tire.p_vx1 = 0.0
    return p


TYRES: dict[str, Callable[[VehicleParameters], VehicleParameters]] = {
    "package": copy.deepcopy,
    "smooth": smooth,
    "physical": physical,
}


def static_load(p: VehicleParameters) -> np.ndarray:
    """(2,) N: load of the front and of the rear axle at rest. Not m g b/L, for the axles' own mass is on them."""
    length = p.a + p.b
    return GRAVITY * np.array([p.m_s * p.b / length + p.m_uf, p.m_s * p.a / length + p.m_ur])


def at_rest(p: VehicleParameters, speed: float) -> list[float]:
    """(29,) state, driving straight at `speed` in m/s: springs at the length at which they carry the body.

    `init_mb` leaves body height and pitch at 0 with the tyres pressed in, which is no equilibrium: the body would drop."""
    x = init_mb([0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0], p)
    front, rear = (x[i] for i in HEIGHT_U)
    x[PITCH] = (rear - front) / (p.a + p.b)
    x[HEIGHT] = front + p.a * x[PITCH]
    return x


def tyre_force(p: VehicleParameters, slip: float, angle: float, camber: float, load: float) -> tuple[float, float]:
    """Force of one tyre in N, forwards and to the right in the wheel's axes, by the package's formulas.

    slip: (R omega - v)/v, > 0: drives; angle: rad, > 0: slides to the right; camber: rad; load: N."""
    along = tyre.formula_longitudinal(-slip, camber, load, p.tire)
    aside, mu = tyre.formula_lateral(angle, camber, load, p.tire)
    along = tyre.formula_longitudinal_comb(-slip, angle, along, p.tire)
    return along, tyre.formula_lateral_comb(-slip, angle, camber, mu, load, aside, p.tire)


@dataclass(frozen=True)
class Wheels:
    """What the wheels do, each (4,): front left, front right, rear left, rear right; SAE."""

    angle: np.ndarray  # rad, slip angle
    slip: np.ndarray  # 1, > 0: drives
    camber: np.ndarray  # rad
    load: np.ndarray  # N
    along: np.ndarray  # N, in the wheel's axes
    aside: np.ndarray  # N, in the wheel's axes

    def body(self, steer: float) -> tuple[np.ndarray, np.ndarray]:
        """Force of front and rear axle in the car's axes: forwards (2,) and to the right (2,), N."""
        x, y = (v.reshape(2, 2).sum(1) for v in (self.along, self.aside))
        c, s = np.array([np.cos(steer), 1.0]), np.array([np.sin(steer), 0.0])
        return c * x - s * y, c * y + s * x


def wheels(p: VehicleParameters, x: list[float]) -> Wheels:
    """The package computes this on its way to the rates and keeps it to itself; `check` holds the two together."""
    found = []
    for axle, (arm, track, d, e) in enumerate(((p.a, p.T_f, p.D_f, p.E_f), (-p.b, p.T_r, p.D_r, p.E_r))):
        roll_u, height_u, roll_rate_u = x[ROLL_U[axle]], x[HEIGHT_U[axle]], x[ROLL_RATE_U[axle]]
        steer = x[STEER] if axle == 0 else 0.0
        across = x[VY] + arm * x[YAW_RATE]
        for side in (-1.0, 1.0):  # left, right
            load = (height_u + p.R_w * (np.cos(roll_u) - 1) + side * 0.5 * track * np.sin(roll_u)) * p.K_zt
            forward = x[VX] - side * 0.5 * track * x[YAW_RATE]
            over_ground = forward * np.cos(steer) + across * np.sin(steer)
            slip = p.R_w * x[OMEGA.start + 2 * axle + (side > 0)] / over_ground - 1
            angle = np.arctan((across - roll_rate_u * (p.R_w - height_u)) / forward) - steer
            spring = (p.h_s - p.R_w + height_u - x[HEIGHT]) / np.cos(x[ROLL]) - p.h_s + p.R_w
            spring += arm * x[PITCH] - side * 0.5 * (x[ROLL] - roll_u) * track
            camber = x[ROLL] - side * (d * spring + e * spring**2)
            found.append((angle, slip, camber, load, *tyre_force(p, slip, angle, camber, load)))
    return Wheels(*np.array(found).T)


def check(p: VehicleParameters, x: list[float]) -> float:
    """m/s2: how far the acceleration by `wheels` is from that of the package's rates; nothing but rounding."""
    f = rates(list(x), [0.0, 0.0], p)
    along, aside = (v.sum() for v in wheels(p, x).body(x[STEER]))
    turning = x[YAW_RATE] * x[VX]
    lateral = p.m_s * (f[VY] + turning) + p.m_uf * (f[VY_U[0]] + turning) + p.m_ur * (f[VY_U[1]] + turning)
    return float(max(abs(f[VX] - x[YAW_RATE] * x[VY] - along / p.m), abs(lateral - aside) / p.m))


def slopes(p: VehicleParameters) -> dict[str, float]:
    """N/rad, N: stiffness of the axles at static load, straight, freely rolling, no camber: tse's nominal values."""
    step, found = 1e-6, {}
    for axle, load in zip(("front", "rear"), 0.5 * static_load(p), strict=True):
        free = free_slip(p, load)
        by_angle = [tyre_force(p, free, s * step, 0.0, load)[1] for s in (-1, 1)]
        by_slip = [tyre_force(p, free + s * step, 0.0, 0.0, load)[0] for s in (-1, 1)]
        found[f"cornering_stiffness_{axle}"] = float(by_angle[0] - by_angle[1]) / step  # two wheels, two steps
        found[f"longitudinal_stiffness_{axle}"] = float(by_slip[1] - by_slip[0]) / step
    return found


def free_slip(p: VehicleParameters, load: float) -> float:
    """Slip of a tyre without longitudinal force: not 0, because the magic formula is shifted."""
    slip = 0.0
    for _ in range(30):  # secant of known slope
        slip -= tyre_force(p, slip, 0.0, 0.0, load)[0] / (p.tire.p_kx1 * load)
    return slip


def vehicle(p: VehicleParameters) -> dict[str, float]:
    """The car as its engineer knows it: keys of src/tables/vehicle.toml, SI."""
    return {
        "mass": p.m, "yaw_inertia": p.I_z, "lf": p.a, "lr": p.b, "track_front": p.T_f, "track_rear": p.T_r, "cg_height": p.h_cg,
        "wheel_radius_front": p.R_w, "wheel_radius_rear": p.R_w, **slopes(p),
    }  # fmt: skip


def vehicle_toml(p: VehicleParameters, number: int) -> str:
    """The vehicle file: nominal values and the sensors' noise, nothing of what truth.json says."""
    known = {"wheelbase": p.a + p.b, **vehicle(p)}
    sensors = {f"{k}_sd": NOISE[k] for k in ("accel_x", "accel_y", "yaw_rate")}
    sensors["wheel_noise_sd"] = NOISE["wheel_speed_front"]
    lines = [f'name = "multi-body {NAMES[number]}"', f'driven_axle = "{"front" if p.T_se > 0.5 else "rear"}"']
    return "\n".join([*lines, *_keys(known), "", "[sensors]", *_keys(sensors), ""])


def _keys(values: dict[str, float]) -> list[str]:
    return [f"{k} = {v:.7g}" for k, v in values.items()]


# ---- driving


def drive(p: VehicleParameters, x: list[float], wanted: Input, steps: int, step: float, every: int = 1) -> np.ndarray:
    """RK4 from state x. Returns (steps//every + 1, 2, 29): state and its rate at every `every`-th step.

    `wanted` is asked at half steps 0 .. 2 steps. Fixed steps: the wheels' spin is the fastest (1/(2 ms) at 10 m/s)."""
    kept = np.empty((steps // every + 1, 2, len(x)))
    for i in range(steps + 1):
        k1 = rates(x, wanted(2 * i, x), p)
        if i % every == 0:
            kept[i // every] = x, k1
        if i == steps:
            break
        y = [a + 0.5 * step * b for a, b in zip(x, k1, strict=True)]
        k2 = rates(y, wanted(2 * i + 1, y), p)
        y = [a + 0.5 * step * b for a, b in zip(x, k2, strict=True)]
        k3 = rates(y, wanted(2 * i + 1, y), p)
        y = [a + step * b for a, b in zip(x, k3, strict=True)]
        k4 = rates(y, wanted(2 * i + 2, y), p)
        x = [a + step / 6 * (b + 2 * (c + d) + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True)]
    return kept


@dataclass
class Program:
    """What the driver wants at every half step from SETTLE before the log, each (n,); ISO."""

    steer: np.ndarray  # rad, road wheels, > 0: left
    speed: np.ndarray  # m/s
    accel: np.ndarray  # m/s2


def driver(program: Program, step: float) -> Input:
    """Steers as the program says, and drives or brakes for its acceleration and speed."""
    steer_rate = np.gradient(program.steer, 0.5 * step)
    signals = list(zip(*(v.tolist() for v in (program.steer, steer_rate, program.speed, program.accel)), strict=True))

    def wanted(i: int, x: list[float]) -> tuple[float, float]:
        steer, rate, speed, accel = signals[i]
        return STEER_GAIN * (-steer - x[STEER]) - rate, accel + SPEED_GAIN * (speed - x[VX])

    return wanted


class Track:
    """A program in the making; time 0 is the start of the log."""

    def __init__(self, p: VehicleParameters, rng: np.random.Generator, step: float) -> None:
        self.rng, self.wheelbase = rng, p.a + p.b
        self.t = np.arange(round(2 * (DURATION + SETTLE) / step) + 1) * 0.5 * step - SETTLE
        self.steer, self.accel = np.zeros_like(self.t), np.zeros_like(self.t)
        self.v0 = 20.0  # m/s at the start

    def ramp(self, start: float, length: float) -> np.ndarray:
        """0 before `start`, 1 after `start + length` (s), smooth between."""
        return 0.5 - 0.5 * np.cos(np.pi * np.clip((self.t - start) / length, 0, 1))

    def pulse(self, start: float, end: float, rise: float) -> np.ndarray:
        return self.ramp(start, rise) - self.ramp(end - rise, rise)

    def speed(self) -> np.ndarray:
        step = 0.5 * (self.t[1] - self.t[0])
        return self.v0 + np.concatenate([[0.0], np.cumsum(self.accel[1:] + self.accel[:-1]) * step])

    def angle(self, ay: float, v: float | np.ndarray | None = None) -> float | np.ndarray:
        """rad: steady road-wheel angle for a lateral acceleration in m/s2, of a car that is neutral, as these nearly are."""
        v = self.v0 if v is None else v
        return ay * self.wheelbase / v**2

    def change(self, start: float, period: float, size: float) -> None:
        """A double lane change: two sines of steering, one to each side; size: rad."""
        for at, side in ((start, 1.0), (start + 1.5 * period, -1.0)):
            t = np.clip((self.t - at) / period, 0, 1)
            self.steer += side * size * np.sin(2 * np.pi * t) * np.sin(np.pi * t) ** 0.5


def _sweep(v0: float) -> Callable[[Track], None]:
    """0.2 .. 3 Hz, 2.2 .. 2.8 m/s2 as long as the steering can follow."""

    def sweep(k: Track) -> None:
        k.v0 = v0
        end = DURATION - 1.0
        t = np.clip(k.t - 1.0, 0, end - 1.0)
        rate = np.log(3.0 / 0.2) / (end - 1.0)
        hertz = 0.2 * np.exp(rate * t)
        size = np.minimum(k.angle(k.rng.uniform(2.2, 2.8)), STEER_RATE / (2 * np.pi * hertz))
        k.steer += size * np.sin(2 * np.pi * (hertz - 0.2) / rate) * k.pulse(1.0, end, 0.5)

    return sweep


def _steps(k: Track) -> None:
    """A slow ramp to 5 .. 5.6 m/s2 to each side, then steps of 2 m/s2 to that in no order; 20 m/s."""
    side = k.rng.choice([-1.0, 1.0])
    most = k.rng.uniform(5.0, 5.6)
    for start, sign in ((1.0, side), (8.0, -side)):
        rise = np.clip((k.t - start) / 5.0, 0, 1) * (1 - k.ramp(start + 5.5, 0.8))
        k.steer += sign * k.angle(most) * rise
    start, length = 15.5, (DURATION - 16.0) / 6
    levels = np.linspace(2.0, most, 6)
    for i, ay in enumerate(k.rng.permutation(levels)):  # in no order: severity must not look like time
        k.steer += side * (-1) ** i * k.angle(ay) * k.pulse(start, start + 0.65 * length, k.rng.uniform(0.25, 0.6))
        start += length


def _brake_throttle(k: Track) -> None:
    """Steps of throttle and brakes from 16 m/s, every other one in a turn."""
    k.v0 = 16.0
    side = k.rng.choice([-1.0, 1.0])
    for i, start in enumerate(np.arange(1.0, DURATION - 5.5, 6.2)):
        up, down = k.rng.uniform(1.5, 2.2), k.rng.uniform(2.5, 5.0 if i % 2 == 0 else 3.8)
        rise, held = k.rng.uniform(0.15, 0.3), k.rng.uniform(2.2, 2.8)
        k.accel += up * k.pulse(start, start + held, rise)
        brake = up * (held - rise) / down + rise
        k.accel -= down * k.pulse(start + held + 0.4, start + held + 0.4 + brake, rise)
        if i % 2:
            side = -side
            size = k.angle(k.rng.uniform(2.8, 3.4), 19.0)
            k.steer += side * size * k.pulse(start - 0.5, start + held + brake + 1.6, 0.7)


def _slalom(k: Track) -> None:
    """Slalom at a speed that rises and falls, then braking in two turns."""
    k.v0 = 16.0
    k.accel += 0.9 * np.sin(2 * np.pi * np.clip(k.t - 1.0, 0, 24.0) / 12.0)
    k.accel += 1.4 * k.pulse(25.0, 29.5, 0.3)
    f = k.rng.uniform(0.4, 0.6)
    size = k.angle(k.rng.uniform(3.2, 4.0), k.speed())
    k.steer += size * np.sin(2 * np.pi * f * (k.t - 1.0)) * k.pulse(1.0, 25.0, 2.0)
    side = k.rng.choice([-1.0, 1.0])
    for start, sign in ((29.5, side), (37.5, -side)):
        k.steer += sign * k.angle(k.rng.uniform(2.8, 3.4), 22.0) * k.pulse(start, start + 6.0, 0.8)
        k.accel -= k.rng.uniform(2.6, 3.8) * k.pulse(start + 2.0, start + 3.8, 0.25)
        k.accel += 1.4 * k.pulse(start + 3.9, start + 7.4, 0.3)


def _double_lane_change(k: Track) -> None:
    """Three double lane changes at 16 m/s, three at 24 m/s."""
    k.v0 = 16.0
    k.accel += 1.6 * k.pulse(20.0, 25.2, 0.2)
    for start, v in ((1.5, 16.0), (8.0, 16.0), (14.5, 16.0), (26.5, 24.0), (32.5, 24.0), (38.5, 24.0)):
        k.change(start, k.rng.uniform(1.6, 2.2), k.rng.choice([-1.0, 1.0]) * k.angle(k.rng.uniform(3.6, 4.8), v))


FITTED: dict[str, Callable[[Track], None]] = {
    "sweep_15": _sweep(15.0), "sweep_25": _sweep(25.0), "steps": _steps, "brake_throttle": _brake_throttle,
}  # fmt: skip
HELD_OUT: dict[str, Callable[[Track], None]] = {"slalom": _slalom, "double_lane_change": _double_lane_change}


def stream(seed: int, what: str) -> np.random.Generator:
    """Random numbers that depend on the seed and on what they are for, not on what else is drawn."""
    return np.random.default_rng([seed, *what.encode()])


def program_of(p: VehicleParameters, name: str, seed: int, step: float = STEP) -> Program:
    """A manoeuvre of FITTED or HELD_OUT, drawn by seed."""
    track = Track(p, stream(seed, name), step)
    {**FITTED, **HELD_OUT}[name](track)
    return Program(track.steer, track.speed(), track.accel)


def motion(p: VehicleParameters, program: Program, step: float = STEP) -> np.ndarray:
    """(samples, 2, 29): state and rate every SAMPLE from the start of the log."""
    steps = round((DURATION + SETTLE) / step)
    every = round(SAMPLE / step)
    kept = drive(p, at_rest(p, float(program.speed[0])), driver(program, step), steps, step, every)
    return kept[round(SETTLE / SAMPLE) :]


# ---- sensors


def imu(x: np.ndarray, f: np.ndarray, level: float) -> np.ndarray:
    """(n, 3) accel_x, accel_y in m/s2, yaw_rate in rad/s, ISO, of an IMU fixed to the body at the body's centre of gravity.

    x, f: (n, 29) states and rates, SAE. `level`: rad, pitch at rest, taken out as a workshop levels an IMU.
    An accelerometer reads the force on the body less its weight. In the road's axes that is speed' plus what turning adds, and
    z'' - g, which is minus what springs and joints carry; turned into the body by pitch, then roll. Sideways this is the force
    of the joints over the body's mass to the last bit. Forwards the package moves body and axles as one: no swing by pitch."""
    r, roll, pitch = x[:, YAW_RATE], x[:, ROLL], x[:, PITCH] - level
    ahead = f[:, VX] - r * x[:, VY]
    right = f[:, VY] + r * x[:, VX]
    down = f[:, HEIGHT + 1] - GRAVITY
    body_x = ahead * np.cos(pitch) - down * np.sin(pitch)
    body_y = right * np.cos(roll) + (ahead * np.sin(pitch) + down * np.cos(pitch)) * np.sin(roll)
    body_r = r * np.cos(pitch) * np.cos(roll) - x[:, PITCH_RATE] * np.sin(roll)
    return np.stack([body_x, -body_y, -body_r], -1)


def sensors(p: VehicleParameters, kept: np.ndarray, rng: np.random.Generator | None) -> dict[str, np.ndarray]:
    """Columns of a log, each (n,), ISO, SI. `rng` None: no noise."""
    x, f = kept[:, 0], kept[:, 1]
    omega = x[:, OMEGA]
    measured = imu(x, f, at_rest(p, 20.0)[PITCH])
    values = (np.arange(len(x)) * SAMPLE, -x[:, STEER], omega[:, :2].mean(1), omega[:, 2:].mean(1), *measured.T)
    log = dict(zip(COLUMNS, values, strict=True))
    if rng is not None:
        for name, sd in NOISE.items():
            log[name] = log[name] + sd * rng.standard_normal(len(x))
    return log


# ---- what is true of this car, by experiments of its own


def held(p: VehicleParameters, speed: float, steer: float, seconds: float = 6.0) -> list[float]:
    """(29,) state after turning the wheels to `steer` (rad, SAE) within 1 s and holding angle and speed (m/s)."""
    steps = round(seconds / STEP)

    def wanted(i: int, x: list[float]) -> tuple[float, float]:
        to = steer * min(1.0, 0.5 * i * STEP)
        return STEER_GAIN * (to - x[STEER]), 2.0 * (speed - x[VX])

    return list(drive(p, at_rest(p, speed), wanted, steps, STEP, steps)[-1, 0])


OUTPUTS = ("roll", "pitch", "force_x", "force_y", "body_y", "yaw_acc", "load_front", "load_rear")


def outputs(p: VehicleParameters, x: list[float], accel: float) -> np.ndarray:
    """(8,) OUTPUTS: rad; all tyres' force over mass in m/s2; lateral acceleration of the body; rad/s2; N. SAE."""
    f = rates(list(x), [0.0, accel], p)
    w = wheels(p, x)
    along, aside = w.body(x[STEER])
    load = w.load.reshape(2, 2).sum(1)
    lateral = f[VY] + x[YAW_RATE] * x[VX]
    return np.array([x[ROLL], x[PITCH], along.sum() / p.m, aside.sum() / p.m, lateral, f[YAW_RATE], *load])


def response(p: VehicleParameters, speed: float, by: str, hertz: np.ndarray) -> dict[str, np.ndarray]:
    """OUTPUTS -> (len(hertz),) complex: response to steering (by = "steer"), throttle ("drive") or brakes ("brake").

    Linearised about driving straight at `speed`, by central differences of the package's rates; of a smooth car only."""
    x = held(p, speed, 0.0, 3.0)
    n, step = len(x), 1e-6

    def both(y: list[float], accel: float) -> np.ndarray:
        return np.concatenate([rates(list(y), [0.0, accel], p), outputs(p, y, accel)])

    moved = np.empty((n + len(OUTPUTS), n))
    for i in range(n):
        low, high = list(x), list(x)
        low[i], high[i] = x[i] - step, x[i] + step
        moved[:, i] = (both(high, 0.0) - both(low, 0.0)) / (2 * step)
    if by == "steer":
        pushed = moved[:, STEER]
    else:
        push = 1e-4 if by == "drive" else -1e-4
        pushed = (both(x, push) - both(x, 0.0)) / push
    rest = [i for i in range(n) if i != STEER]
    a, b, c, d = moved[np.ix_(rest, rest)], pushed[rest], moved[n:, rest], pushed[n:]
    found = np.array([c @ np.linalg.solve(2j * np.pi * f * np.eye(n - 1) - a, b) + d for f in hertz])
    return dict(zip(OUTPUTS, found.T, strict=True))


def mode(hertz: np.ndarray, wanted: np.ndarray) -> dict[str, float]:
    """gain, frequency (Hz), damping of gain w^2/(s^2 + 2 z w s + w^2) nearest to a response (complex).

    static: the response at the lowest frequency; misfit: rms over that."""
    s = 2j * np.pi * hertz

    def form(q: np.ndarray) -> np.ndarray:
        w = 2 * np.pi * q[1]
        return q[0] * w**2 / (s**2 + 2 * q[2] * w * s + w**2)

    def off(q: np.ndarray) -> np.ndarray:
        e = (form(q) - wanted) / abs(wanted[0])
        return np.concatenate([e.real, e.imag])

    q = least_squares(off, [wanted[0].real, 1.5, 0.3]).x
    misfit = float(np.sqrt(np.mean(off(q) ** 2) * 2))
    return {"gain": q[0], "frequency": q[1], "damping": q[2], "static": float(wanted[0].real), "misfit": misfit}


ROLLING = np.linspace(0.1, 3.0, 59)  # Hz, where the modes are fitted


def roll_truth(p: VehicleParameters) -> tuple[dict[str, float], float]:
    """Parameters of body_roll, and how far body_y is from that form (rms, relative to the tyres' force)."""
    y = response(smooth(p), 20.0, "steer", ROLLING)
    lean = -y["roll"] / y["force_y"]  # SAE: to the right > 0, so outwards in a left turn, whose force is < 0
    found = mode(ROLLING, lean)
    swing = -((2 * np.pi * ROLLING) ** 2) * lean
    lever = lever_arm(p)
    rest = y["body_y"] / y["force_y"] - 1 - lever * y["yaw_acc"] / y["force_y"]  # = coupling swing = -height swing
    coupling = float((rest * swing.conj()).sum().real / (abs(swing) ** 2).sum())
    misfit = float(np.sqrt(np.mean(abs(rest - coupling * swing) ** 2)))
    return {**found, "height": -coupling, "coupling": coupling}, misfit


def lever_arm(p: VehicleParameters) -> float:
    """m: the body's centre of gravity before that of the whole car."""
    return (p.m_ur * p.b - p.m_uf * p.a) / p.m


def pitch_truth(p: VehicleParameters) -> dict[str, dict[str, float]]:
    """Parameters of pitch_leak (nose up > 0) and longitudinal_load_transfer, by brakes and by throttle."""
    found = {}
    for by in ("brake", "drive"):
        y = response(smooth(p), 20.0, by, ROLLING)
        found[by] = mode(ROLLING, y["pitch"] / y["force_x"])
        load = static_load(p)
        found[by]["load_front"] = float(-(y["load_front"] / y["force_x"])[0].real / load[0])
        found[by]["load_rear"] = float((y["load_rear"] / y["force_x"])[0].real / load[1])
    return found


def turns(p: VehicleParameters, speed: float = 20.0) -> list[dict[str, float]]:
    """Steady left turns at rising lateral acceleration: what an axle's secant stiffness over the nominal one then is, and roll.

    Slip angle as the single-track model has it, of the axle's middle."""
    nominal, rows = slopes(p), []
    for wanted in (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 5.5):
        x = held(p, speed, -wanted * (p.a + p.b) / speed**2)
        _, aside = wheels(p, x).body(x[STEER])
        across = np.array([x[VY] + p.a * x[YAW_RATE], x[VY] - p.b * x[YAW_RATE]])
        angle = np.arctan(across / x[VX]) - np.array([x[STEER], 0.0])
        both = -aside / angle / [nominal["cornering_stiffness_front"], nominal["cornering_stiffness_rear"]]
        rows.append({"accel_y": float(-aside.sum() / p.m), "cy_front": both[0], "cy_rear": both[1], "roll": x[ROLL]})
    return rows


def camber_steer(p: VehicleParameters) -> tuple[float, float]:
    """1: slip angle into the turn that an axle's side force by camber amounts to, per roll angle, front and rear.

    In a steady turn of 2 m/s2 without the jump: each axle's force less that without camber, over its stiffness, over roll."""
    p = smooth(p)
    x = held(p, 20.0, -2.0 * (p.a + p.b) / 400)
    w = wheels(p, x)
    upright = np.array([tyre_force(p, s, a, 0.0, z)[1] for s, a, z in zip(w.slip, w.angle, w.load, strict=True)])
    more = -(w.aside - upright).reshape(2, 2).sum(1)  # to the left, as the turn
    nominal = slopes(p)
    found = more / [nominal["cornering_stiffness_front"], nominal["cornering_stiffness_rear"]] / x[ROLL]
    return float(found[0]), float(found[1])


def saturation(p: VehicleParameters) -> dict[str, float]:
    """1/friction of tyre_saturation by the tyre alone, no camber; axle load as tse has it, m g lr/L and m g lf/L.

    peak: load over the most force. brush, blend: least squares up to 5.5 m/s2 of the catalogue's form with stiffness free, of
    the brush and of any shape; stiffness: what these find over the slope at 0."""
    found, load_of = {}, p.m * GRAVITY / (p.a + p.b) * np.array([p.b, p.a])
    for axle, load, carried in zip(("front", "rear"), load_of, static_load(p), strict=True):
        angle = np.linspace(0, 0.3, 1201)
        force = np.array([-2 * tyre_force(p, free_slip(p, carried / 2), float(a), 0.0, carried / 2)[1] for a in angle])
        found[f"peak_{axle}"] = load / force.max()
        used = force <= 5.5 / GRAVITY * load
        a, fy, slope = angle[used], force[used], slopes(p)[f"cornering_stiffness_{axle}"]
        for name, free in (("brush", 2), ("blend", 3)):

            def off(q: np.ndarray, a=a, fy=fy, slope=slope, load=load) -> np.ndarray:
                x = q[0] * slope * a * q[1] / load
                brush = np.where(x < 3, 1 - x / 3 + x**2 / 27, 1 / np.maximum(x, 1))
                shape = q[2] if len(q) > 2 else 0.0
                return (q[0] * slope * a * (brush + shape * ((1 + x**2 + x**4) ** -0.25 - brush)) - fy) / load

            start, high = [1.0, 0.95, 0.5][:free], [2.0, 5.0, 1.0][:free]
            q = least_squares(off, start, bounds=([0.1, 0.0, 0.0][:free], high)).x
            found[f"{name}_{axle}"], found[f"{name}_stiffness_{axle}"] = q[1], q[0]
            if free > 2:
                found[f"shape_{axle}"] = q[2]
    return {k: float(v) for k, v in found.items()}


def combined(p: VehicleParameters) -> dict[str, float]:
    """k of 1/sqrt(1 + k slip^2) nearest to the tyre's weight of side force by slip up to 3.5 %, of both signs.

    Mean of -20 and 20 mrad, at the front's static load, without the side force that slip makes by itself. driving, braking: the
    weight at 2 % of slip. side_*: N/N, side force by 2 % of slip at no angle, to the left, over load."""
    load, slip = 0.5 * static_load(p)[0], np.linspace(-0.035, 0.035, 71)
    q = copy.deepcopy(p)
    q.tire.r_vy1 = q.tire.r_vy3 = 0.0
    fy = np.array([[tyre_force(q, s, a, 0.0, load)[1] for s in slip] for a in (-0.02, 0.02)])
    weight = (fy / fy[:, 35:36]).mean(0)  # the package's tyre is not quite the same to both sides
    k = least_squares(lambda k: 1 / np.sqrt(1 + k * slip**2) - weight, [50.0], bounds=(0, np.inf)).x[0]
    found = {"k": float(k), "driving": float(weight[55]), "braking": float(weight[15])}
    return {
        **found,
        **{f"side_{n}": -tyre_force(p, s, 0.0, 0.0, load)[1] / load for n, s in (("drive", 0.02), ("brake", -0.02))},
    }


def lateral_transfer(p: VehicleParameters) -> tuple[float, float]:
    """s4/m2: k of C (1 - k ay^2), front and rear.

    Side force of an axle whose wheels carry what they do at 5 m/s2, no camber, at a small angle, over that of equal loads."""
    x = held(smooth(p), 20.0, -5.0 * (p.a + p.b) / 400)
    loads, found = wheels(smooth(p), x).load.reshape(2, 2), []
    for pair in loads:
        uneven = sum(tyre_force(p, 0.0, 1e-4, 0.0, z)[1] for z in pair)
        even = 2 * tyre_force(p, 0.0, 1e-4, 0.0, pair.mean())[1]
        found.append(float((1 - uneven / even) / 25))
    return found[0], found[1]


def truth(p: VehicleParameters, number: int) -> dict:
    """What truth.json says: every effect that may be missing, its parameters and how they were found, and what is outside."""
    rolls, roll_misfit = roll_truth(p)
    pitches = pitch_truth(p)
    load = static_load(p)
    sat, mix, camber, lateral = saturation(p), combined(p), camber_steer(p), lateral_transfer(p)
    rolling = [free_slip(p, 0.5 * z) for z in load]
    nod = {k: 0.5 * (pitches["brake"][k] + pitches["drive"][k]) for k in pitches["brake"]}
    jump = [
        2 * abs(tyre_force(p, 0.0, 0.0, 1e-12, 0.5 * z)[1] - tyre_force(p, 0.0, 0.0, 0.0, 0.5 * z)[1]) for z in load
    ]
    spin = 4 * p.I_y_w / p.R_w**2
    none = "the package has none"
    rows: list[tuple[str, dict[str, float], str]] = [
        ("mass", {"change": 0.0}, "as told"),
        ("yaw_inertia", {"change": 0.0}, "as told; the package turns the whole car by I_z and the tyres' moment"),
        ("cg_shift", {"distance": 0.0},
         "arms of the tyres' moment are a and b, as told. The axle loads' centre of gravity is imu_lever_arm further back: who "
         "weighs the axles finds that, and then needs aligning_moment.trail of the same size"),
        ("wheel_radius", {"change": float(-np.mean(rolling)), "front": -rolling[0], "rear": -rolling[1]},
         "slip without force at static load: the magic formula is shifted by p_hx1 and, within its sine, by p_vx1 load"),
        *((name, {key: 0.0}, "what is logged is the state that steers")
          for name, key in (("steering_ratio", "change"), ("steering_offset", "angle"), ("steering_delay", "time"),
                            ("steering_lag", "time"))),
        ("steering_compliance", {"angle_per_moment": 0.0}, none),
        ("rear_roll_steer", {"gain": camber[1], "gain_beyond_front": camber[1] - camber[0], "roll": rolls["gain"],
                             "frequency": rolls["frequency"], "damping": rolls["damping"]},
         "no steering: side force by camber over stiffness over roll, in a steady turn of 2 m/s2 with and without camber. In "
         "the package a wheel that leans out pushes in; the front has its own, see outside"),
        ("relaxation", {"length": 0.0}, none + ": force follows slip at once"),
        ("longitudinal_relaxation", {"length": 0.0}, none),
        ("stiffness_drift", {"change": 0.0}, none),
        ("combined_slip", {"factor": mix["k"], "weight_driving_2": mix["driving"], "weight_braking_2": mix["braking"]},
         "least squares on the tyre's own weight up to 3.5 % of slip, both signs, at -20 and 20 mrad; weight_..._2: at 2 %"),
        ("tyre_saturation", {"inverse_friction": 0.5 * (sat["peak_front"] + sat["peak_rear"]), **sat},
         "inverse_friction: load (m g lr/L) over the most side force, mean of the axles; brush, blend: least squares up to "
         "5.5 m/s2 on the axle's own curve without camber, stiffness free, shape 0 or free"),
        ("longitudinal_load_transfer", {"gain": 0.5 * (nod["load_front"] + nod["load_rear"]), "front": nod["load_front"],
                                        "rear": nod["load_rear"]},
         "stiffness is in proportion to load: relative change of axle load per acceleration by the tyres, linearised, 0.1 Hz; "
         "in the package it comes with the pitch mode, not at once"),
        ("lateral_load_transfer", {"gain": 0.5 * sum(lateral), "front": lateral[0], "rear": lateral[1]},
         "force of an axle with the wheel loads of a 5 m/s2 turn over that with equal ones: none, the tyre is linear in load"),
        ("aero_drag", {"coefficient": 0.0}, none),
        ("rolling_resistance", {"coefficient": 0.0}, none + ": the shift of the formula is a slip, see wheel_radius"),
        ("grade", {"angle": 0.0}, "level road; the IMU is levelled at rest"),
        ("bank", {"angle": 0.0, "superelevation": 0.0}, "level road"),
        ("crosswind", {"speed": 0.0}, none),
        ("conicity", {"front": 0.0, "rear": 0.0}, "none without slip and camber; see outside"),
        ("aligning_moment", {"trail": 0.0}, none),
        ("imu_lever_arm", {"x": lever_arm(p), "y": 0.0},
         "the IMU is at the body's centre of gravity, that of the whole car is (m_ur b - m_uf a)/m behind it"),
        ("body_roll", rolls,
         "linearised at 20 m/s, steering, 0.1 .. 3 Hz: roll over the tyres' force by a mode; height, coupling: what else of "
         "the body's acceleration goes with roll''. Slip angles are by the speed of the body's centre: coupling < 0"),
        ("pitch_leak", {**{k: nod[k] for k in ("gain", "frequency", "damping", "static", "misfit")}, "height": 0.0},
         "linearised at 20 m/s, mean of throttle and brakes, 0.1 .. 3 Hz; the package swings nothing forwards: height 0"),
        ("imu_misalignment", {"angle": 0.0}, "none"),
        *((name, {"error": 0.0}, "none") for name in ("imu_scale_ax", "imu_scale_ay", "gyro_scale")),
        ("imu_delay", {"time": 0.0}, "none"),
    ]  # fmt: skip
    outside = {
        "camber_jump": {
            "front": jump[0], "rear": jump[1], "accel": sum(jump) / p.m, "jumps": bool(p.tire.p_vy1 or p.tire.p_hy1),
            "how": "N: side force that pushes an axle into the turn as soon as the body leans (sign(camber) in the tyre): its "
                   "jump where roll changes sign is twice that; accel: m/s2, both axles",
        },
        "front_camber_steer": {"gain": camber[0], "how": "as rear_roll_steer, front axle; the catalogue has none"},
        "side_force_by_slip": {
            "driving": mix["side_drive"], "braking": mix["side_brake"],
            "how": "share of load that pushes to the left at 2 % of slip: S_vy of the tyre, not mirrored from left to right",
        },
        "wheel_spin_inertia": {"mass": spin, "share": spin / p.m, "how": "kg that the wheels add to the mass for torque"},
        "compliant_joints": {
            "misfit": roll_misfit,
            "how": "rms, over the tyres' force, of the body's acceleration without roll and lever arm, 0.1 .. 3 Hz",
        },
        "load": {
            "front": float(load[0]), "rear": float(load[1]), "front_by_lengths": p.m * GRAVITY * p.b / (p.a + p.b),
            "how": "N: load that the tyres carry at rest, and m g lr/L, which tse takes",
        },
        "pitch_at_rest": {"angle": at_rest(p, 20.0)[PITCH], "how": "rad: tyres pressed in unevenly; taken out of the IMU"},
        "steady_turns": {
            "rows": turns(p),
            "how": "20 m/s: secant stiffness over nominal, of the single-track slip angle, with all that camber does",
        },
    }  # fmt: skip
    effects = []
    for key, found, how in rows:
        first = next(iter(found))
        effects.append({"id": key, "parameter": first, "value": found[first], "parameters": found, "how": how})
    checked = check(p, held(p, 20.0, -4.0 * (p.a + p.b) / 400, 1.5))
    return {
        "car": number, "name": NAMES[number], "effects": effects, "outside": outside, "vehicle": vehicle(p),
        "by_brake_and_drive": pitches, "noise": NOISE,
        "check": {"value": checked, "how": "m/s2: `wheels` against the package's rates, in a turn that builds up"},
    }  # fmt: skip


# ---- command line


def plain(value: object) -> object:
    """Numbers of numpy as Python's, for JSON; 6 digits."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, list):
        return [plain(v) for v in value]
    if isinstance(value, bool | str | int):
        return value
    return float(f"{float(value):.6g}") + 0.0


def main(arguments: list[str]) -> int:
    """Command line."""
    names = [*FITTED, *HELD_OUT]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="the folder to write")
    parser.add_argument("--car", type=int, choices=NAMES, default=1, help="parameter set (default: 1)")
    parser.add_argument("--seed", type=int, default=1, help="of noise and of sizes of the manoeuvres (default: 1)")
    parser.add_argument("--log", nargs="+", choices=names, default=names, help="these only")
    parser.add_argument("--no-noise", action="store_true", help="what the sensors would read without noise")
    parser.add_argument(
        "--tyre", choices=TYRES, default="package", help="the package's, or without what no tyre does (see there)"
    )
    parser.add_argument(
        "--step", type=float, default=1e3 * STEP, help="of the integration, ms; divides 10 (default: 1)"
    )
    given = parser.parse_args(arguments)
    p = parameters(given.car, given.tyre)
    step = given.step / 1e3
    if abs(SAMPLE / step - round(SAMPLE / step)) > 1e-9:
        parser.error("--step must divide 10 ms")
    given.out.mkdir(parents=True, exist_ok=True)
    for name in given.log:
        start = clock.perf_counter()
        kept = motion(p, program_of(p, name, given.seed, step), step)
        log = sensors(p, kept, None if given.no_noise else stream(given.seed, f"{name} noise"))
        path = given.out / f"{'log' if name in FITTED else 'hold_out'}_{name}.csv"
        np.savetxt(
            path, np.column_stack(list(log.values())), fmt="%.7g", delimiter=",", header=",".join(COLUMNS), comments=""
        )
        least = min(wheels(p, list(x)).load.min() for x in kept[::5, 0])
        v, ax, ay = kept[:, 0, VX], abs(log["accel_x"]).max(), abs(log["accel_y"]).max()
        print(f"{path}: {v.min():.1f} .. {v.max():.1f} m/s, |ax| {ax:.1f}, |ay| {ay:.1f} m/s2, least wheel load {least:.0f} N,"
              f" {clock.perf_counter() - start:.1f} s")  # fmt: skip
    (given.out / "car.toml").write_text(vehicle_toml(p, given.car), encoding="utf-8")
    start = clock.perf_counter()
    told = {
        **truth(p, given.car),
        "tyre": given.tyre,
        "seed": given.seed,
        "with_noise": not given.no_noise,
        "step": step,
    }
    (given.out / "truth.json").write_text(json.dumps(plain(told), indent=1) + "\n", encoding="utf-8")
    print(f"{given.out / 'truth.json'}: {clock.perf_counter() - start:.1f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
