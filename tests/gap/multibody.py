"""Run the gap workflow on a multi-body car that shares no code with tse.

    python -m tests.gap.multibody [--cars 1 2 3] [--jobs N]

From the root of the repository; some minutes a car. The table has the named effects, the
errors of their sizes, and the reduction of the gap on held-out manoeuvres.

`commonroad-vehicle-models` 3.0.2 (BSD), 29 states, three cars. Car 1 was used while the
workflow was made, 2 and 3 were not. Finished cars are kept in build/multibody; --again
starts anew. The table goes to scripts/results/gap-multibody.md.

`write` makes four logs to fit (log_*.csv), two of other manoeuvres (hold_out_*.csv), the
car as its engineer knows it (car.toml), and its effects of src/tables/effects.toml beyond
the model (truth.json). 1: Ford Escort, 2: BMW 320i, 3: VW Vanagon; one ADAMS tyre for
all.

The package has axes of SAE (z down, y right: a left wheel runs faster for yaw rate > 0,
gravity adds to z'), tse those of ISO 8855 (z up, y left). All is SAE until `make_log`
converts it. A `Program`, the driver's demand, is ISO.
"""

import argparse
import copy
import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import vehiclemodels.utils.tire_model as tyre
from scipy.optimize import least_squares
from vehiclemodels.init_mb import init_mb
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb as rates
from vehiclemodels.vehicle_parameters import VehicleParameters, setup_vehicle_parameters

from tests.gap.runs import run_in_processes
from tse.gaps.run.workflow import run_workflow as gap
from tse.report.results import convert_to_plain

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "build" / "multibody"
TABLE = ROOT / "scripts" / "results" / "gap-multibody.md"
GRAVITY = 9.81  # m/s2, as in the package
STEP = 0.001  # s, of the integration
SAMPLE = 0.01  # s, of the logs
SETTLE = 3.0  # s driven straight before a log begins
DURATION = 45.0  # s of a log
SPEED_GAIN = 0.5  # 1/s: acceleration of the driver over the error of the speed
STEER_GAIN = 30.0  # 1/s: rate of the steering over its error
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


def make_parameters(number: int) -> VehicleParameters:
    """Return the package's parameters, with tyres changed to behave as real ones.

    No shift of side force by the sign of camber, which makes it jump at 0. A leaning
    wheel pushes to the side it leans to (the package takes camber of ISO's axes for
    SAE's). Side force by slip cancels from left to right. p_vx1 load, which the package
    has within the sine of the magic formula, is left out.
    """
    p = copy.deepcopy(setup_vehicle_parameters(number))
    p.tire.p_hy1 = p.tire.p_vy1 = 0.0
    p.tire.p_hy3, p.tire.p_vy3 = -p.tire.p_hy3, -p.tire.p_vy3
    p.tire.r_vy1 = p.tire.r_vy3 = p.tire.p_vx1 = 0.0
    return p


def compute_static_load(p: VehicleParameters) -> np.ndarray:
    """Return the load of both axles at rest, N, (2,), with the axles' own mass."""
    length = p.a + p.b
    return GRAVITY * np.array([p.m_s * p.b / length + p.m_uf, p.m_s * p.a / length + p.m_ur])


def make_straight_state(p: VehicleParameters, speed: float) -> list[float]:
    """Return the state of a straight drive at `speed`, m/s, (29,), in equilibrium.

    `init_mb` leaves body height and pitch at 0 with compressed tyres, so the body would
    drop.
    """
    x = init_mb([0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0], p)
    front, rear = (x[i] for i in HEIGHT_U)
    x[PITCH] = (rear - front) / (p.a + p.b)
    x[HEIGHT] = front + p.a * x[PITCH]
    return x


def compute_tyre_force(
    p: VehicleParameters, slip: float, angle: float, camber: float, load: float
) -> tuple[float, float]:
    """Return the force of one tyre, N, forwards and to the right in the wheel's axes.

    slip: (R omega - v)/v, > 0: drives. angle: rad, > 0: slides to the right. camber: rad.
    load: N.
    """
    along = tyre.formula_longitudinal(-slip, camber, load, p.tire)
    aside, mu = tyre.formula_lateral(angle, camber, load, p.tire)
    along = tyre.formula_longitudinal_comb(-slip, angle, along, p.tire)
    return along, tyre.formula_lateral_comb(-slip, angle, camber, mu, load, aside, p.tire)


@dataclass(frozen=True)
class Wheels:
    """Motion and forces of the wheels, each (4,): front left, right, rear left, right;
    SAE."""

    angle: np.ndarray  # rad, slip angle
    slip: np.ndarray  # 1, > 0: drives
    camber: np.ndarray  # rad
    load: np.ndarray  # N
    along: np.ndarray  # N, in the wheel's axes
    aside: np.ndarray  # N, in the wheel's axes

    def body(self, steer: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the force of both axles in the car's axes: forwards (2,), to the
        right (2,), N."""
        x, y = (v.reshape(2, 2).sum(1) for v in (self.along, self.aside))
        c, s = np.array([np.cos(steer), 1.0]), np.array([np.sin(steer), 0.0])
        return c * x - s * y, c * y + s * x


def compute_wheels(p: VehicleParameters, x: list[float]) -> Wheels:
    """Compute the wheels as the package does internally; `check` compares both."""
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
            found.append((angle, slip, camber, load, *compute_tyre_force(p, slip, angle, camber, load)))
    return Wheels(*np.array(found).T)


def check(p: VehicleParameters, x: list[float]) -> float:
    """Return the difference between compute_wheels() and the package's rates, m/s2."""
    f = rates(list(x), [0.0, 0.0], p)
    along, aside = (v.sum() for v in compute_wheels(p, x).body(x[STEER]))
    turning = x[YAW_RATE] * x[VX]
    lateral = p.m_s * (f[VY] + turning) + p.m_uf * (f[VY_U[0]] + turning) + p.m_ur * (f[VY_U[1]] + turning)
    return float(max(abs(f[VX] - x[YAW_RATE] * x[VY] - along / p.m), abs(lateral - aside) / p.m))


def compute_slopes(p: VehicleParameters) -> dict[str, float]:
    """Return the stiffness of the axles at static load, straight, free rolling: N/rad, N.

    Without camber: tse's nominal values.
    """
    step, found = 1e-6, {}
    for axle, load in zip(("front", "rear"), 0.5 * compute_static_load(p), strict=True):
        free = free_slip(p, load)
        by_angle = [compute_tyre_force(p, free, s * step, 0.0, load)[1] for s in (-1, 1)]
        by_slip = [compute_tyre_force(p, free + s * step, 0.0, 0.0, load)[0] for s in (-1, 1)]
        # two wheels, two steps
        found[f"cornering_stiffness_{axle}"] = float(by_angle[0] - by_angle[1]) / step
        found[f"longitudinal_stiffness_{axle}"] = float(by_slip[1] - by_slip[0]) / step
    return found


def free_slip(p: VehicleParameters, load: float) -> float:
    """Return the slip without longitudinal force: not 0, as the magic formula is
    shifted."""
    slip = 0.0
    for _ in range(30):  # secant of known slope
        slip -= compute_tyre_force(p, slip, 0.0, 0.0, load)[0] / (p.tire.p_kx1 * load)
    return slip


def make_vehicle(p: VehicleParameters) -> dict[str, float]:
    """Return the car as its engineer knows it: keys of src/tables/vehicle.toml, SI."""
    return {
        "mass": p.m,
        "yaw_inertia": p.I_z,
        "lf": p.a,
        "lr": p.b,
        "track_front": p.T_f,
        "track_rear": p.T_r,
        "cg_height": p.h_cg,
        "wheel_radius_front": p.R_w,
        "wheel_radius_rear": p.R_w,
        **compute_slopes(p),
    }


def format_vehicle(p: VehicleParameters, number: int) -> str:
    """Return the vehicle file: nominal values and sensor noise, without the truth."""
    known = {"wheelbase": p.a + p.b, **make_vehicle(p)}
    sensors = {f"{k}_sd": NOISE[k] for k in ("accel_x", "accel_y", "yaw_rate")}
    sensors["wheel_noise_sd"] = NOISE["wheel_speed_front"]
    lines = [f'name = "multi-body {NAMES[number]}"', f'driven_axle = "{"front" if p.T_se > 0.5 else "rear"}"']
    return "\n".join([*lines, *format_keys(known), "", "[sensors]", *format_keys(sensors), ""])


def format_keys(values: dict[str, float]) -> list[str]:
    return [f"{k} = {v:.7g}" for k, v in values.items()]


# ---- driving


def drive(p: VehicleParameters, x: list[float], wanted: Input, steps: int, every: int) -> np.ndarray:
    """Integrate from state x by RK4; return state and rate at every `every`-th step.

    (steps//every + 1, 2, 29). `wanted` is called at half steps 0 .. 2 steps. Steps are
    fixed: the spin of the wheels is the fastest (1/(2 ms) at 10 m/s).
    """

    def after(x: list[float], k: list[float], h: float) -> list[float]:
        return [a + h * b for a, b in zip(x, k, strict=True)]

    kept = np.empty((steps // every + 1, 2, len(x)))
    for i in range(steps + 1):
        k1 = rates(x, wanted(2 * i, x), p)
        if i % every == 0:
            kept[i // every] = x, k1
        if i == steps:
            break
        y = after(x, k1, 0.5 * STEP)
        k2 = rates(y, wanted(2 * i + 1, y), p)
        y = after(x, k2, 0.5 * STEP)
        k3 = rates(y, wanted(2 * i + 1, y), p)
        y = after(x, k3, STEP)
        k4 = rates(y, wanted(2 * i + 2, y), p)
        x = [a + STEP / 6 * (b + 2 * (c + d) + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True)]
    return kept


@dataclass
class Program:
    """Demand of the driver at every half step from SETTLE before the log, each (n,);
    ISO."""

    steer: np.ndarray  # rad, road wheels, > 0: left
    speed: np.ndarray  # m/s
    accel: np.ndarray  # m/s2


def make_driver(program: Program) -> Input:
    """Steer as the program, and drive or brake for its acceleration and speed."""
    steer_rate = np.gradient(program.steer, 0.5 * STEP)
    signals = list(
        zip(*(v.tolist() for v in (program.steer, steer_rate, program.speed, program.accel)), strict=True)
    )

    def wanted(i: int, x: list[float]) -> tuple[float, float]:
        steer, rate, speed, accel = signals[i]
        return STEER_GAIN * (-steer - x[STEER]) - rate, accel + SPEED_GAIN * (speed - x[VX])

    return wanted


class Track:
    """A program in the making; time 0 is the start of the log."""

    def __init__(self, p: VehicleParameters, rng: np.random.Generator) -> None:
        self.rng, self.wheelbase = rng, p.a + p.b
        self.t = np.arange(round(2 * (DURATION + SETTLE) / STEP) + 1) * 0.5 * STEP - SETTLE
        self.steer, self.accel = np.zeros_like(self.t), np.zeros_like(self.t)
        self.v0 = 20.0  # m/s at the start

    def ramp(self, start: float, length: float) -> np.ndarray:
        """Return 0 before `start`, 1 after `start + length` (s), smooth between."""
        return 0.5 - 0.5 * np.cos(np.pi * np.clip((self.t - start) / length, 0, 1))

    def pulse(self, start: float, end: float, rise: float) -> np.ndarray:
        return self.ramp(start, rise) - self.ramp(end - rise, rise)

    def speed(self) -> np.ndarray:
        step = 0.5 * (self.t[1] - self.t[0])
        return self.v0 + np.concatenate([[0.0], np.cumsum(self.accel[1:] + self.accel[:-1]) * step])

    def angle(self, ay: float, v: float | np.ndarray | None = None) -> float | np.ndarray:
        """Return the steady road-wheel angle, rad, of a neutral car for a lateral
        acceleration."""
        v = self.v0 if v is None else v
        return ay * self.wheelbase / v**2

    def change(self, start: float, period: float, size: float) -> None:
        """Add a double lane change: a sine of steering to each side; size: rad."""
        for at, side in ((start, 1.0), (start + 1.5 * period, -1.0)):
            t = np.clip((self.t - at) / period, 0, 1)
            self.steer += side * size * np.sin(2 * np.pi * t) * np.sin(np.pi * t) ** 0.5


def _sweep(v0: float) -> Callable[[Track], None]:
    """Sweep 0.2 .. 3 Hz at 2.2 .. 2.8 m/s2, as long as the steering can follow."""

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
    """Ramp to 5 .. 5.6 m/s2 to each side, then steps of 2 m/s2 in random order, at 20
    m/s."""
    side = k.rng.choice([-1.0, 1.0])
    most = k.rng.uniform(5.0, 5.6)
    for start, sign in ((1.0, side), (8.0, -side)):
        rise = np.clip((k.t - start) / 5.0, 0, 1) * (1 - k.ramp(start + 5.5, 0.8))
        k.steer += sign * k.angle(most) * rise
    start, length = 15.5, (DURATION - 16.0) / 6
    levels = np.linspace(2.0, most, 6)
    for i, ay in enumerate(
        k.rng.permutation(levels)
    ):  # in random order: severity must not correlate with time
        k.steer += (
            side * (-1) ** i * k.angle(ay) * k.pulse(start, start + 0.65 * length, k.rng.uniform(0.25, 0.6))
        )
        start += length


def _brake_throttle(k: Track) -> None:
    """Step throttle and brakes from 16 m/s, every other time in a turn."""
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
    """Drive a slalom with changing speed, then brake in two turns."""
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
    """Make three double lane changes at 16 m/s, three at 24 m/s."""
    k.v0 = 16.0
    k.accel += 1.6 * k.pulse(20.0, 25.2, 0.2)
    for start, v in ((1.5, 16.0), (8.0, 16.0), (14.5, 16.0), (26.5, 24.0), (32.5, 24.0), (38.5, 24.0)):
        k.change(
            start, k.rng.uniform(1.6, 2.2), k.rng.choice([-1.0, 1.0]) * k.angle(k.rng.uniform(3.6, 4.8), v)
        )


FITTED: dict[str, Callable[[Track], None]] = {
    "sweep_15": _sweep(15.0), "sweep_25": _sweep(25.0), "steps": _steps, "brake_throttle": _brake_throttle,
}  # fmt: skip
HELD_OUT: dict[str, Callable[[Track], None]] = {"slalom": _slalom, "double_lane_change": _double_lane_change}


def make_stream(seed: int, what: str) -> np.random.Generator:
    """Return a random stream by seed and purpose, independent of other draws."""
    return np.random.default_rng([seed, *what.encode()])


def draw_program(p: VehicleParameters, name: str, seed: int) -> Program:
    """Return a manoeuvre of FITTED or HELD_OUT, drawn by seed."""
    track = Track(p, make_stream(seed, name))
    {**FITTED, **HELD_OUT}[name](track)
    return Program(track.steer, track.speed(), track.accel)


def simulate_motion(p: VehicleParameters, program: Program) -> np.ndarray:
    """Return state and rate every SAMPLE from the start of the log, (samples, 2, 29)."""
    steps, every = round((DURATION + SETTLE) / STEP), round(SAMPLE / STEP)
    return drive(p, make_straight_state(p, float(program.speed[0])), make_driver(program), steps, every)[
        round(SETTLE / SAMPLE) :
    ]


# ---- sensors


def measure_motion(x: np.ndarray, f: np.ndarray, level: float) -> np.ndarray:
    """Return accel_x, accel_y, m/s2, and yaw_rate, rad/s, of a body-fixed IMU, ISO, (n,
    3).

    It is at the body's centre of gravity. x, f: (n, 29) states and rates, SAE. `level`:
    rad, pitch at rest, removed as a workshop levels an IMU. An accelerometer measures the
    force on the body less its weight. In the road's axes this is speed' plus the terms of
    the turn, and z'' - g, the negative force of springs and joints. It is rotated into
    the body by pitch, then roll. Laterally it is exactly the force of the joints over the
    body's mass. Longitudinally the package moves body and axles together, without a swing
    by pitch.
    """
    r, roll, pitch = x[:, YAW_RATE], x[:, ROLL], x[:, PITCH] - level
    ahead = f[:, VX] - r * x[:, VY]
    right = f[:, VY] + r * x[:, VX]
    down = f[:, HEIGHT + 1] - GRAVITY
    body_x = ahead * np.cos(pitch) - down * np.sin(pitch)
    body_y = right * np.cos(roll) + (ahead * np.sin(pitch) + down * np.cos(pitch)) * np.sin(roll)
    body_r = r * np.cos(pitch) * np.cos(roll) - x[:, PITCH_RATE] * np.sin(roll)
    return np.stack([body_x, -body_y, -body_r], -1)


def make_log(p: VehicleParameters, kept: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return the columns of a log, each (n,), ISO, SI."""
    x, f = kept[:, 0], kept[:, 1]
    omega = x[:, OMEGA]
    measured = measure_motion(x, f, make_straight_state(p, 20.0)[PITCH])
    values = (
        np.arange(len(x)) * SAMPLE,
        -x[:, STEER],
        omega[:, :2].mean(1),
        omega[:, 2:].mean(1),
        *measured.T,
    )
    log = dict(zip(COLUMNS, values, strict=True))
    return {
        name: x + NOISE[name] * rng.standard_normal(len(x)) if name in NOISE else x for name, x in log.items()
    }


# ---- what is true of this car, by experiments of its own


def hold_steering(p: VehicleParameters, speed: float, steer: float, seconds: float = 6.0) -> list[float]:
    """Return the state after steering to `steer` (rad, SAE) in 1 s and holding it, (29,).

    The speed (m/s) is held, too.
    """
    steps = round(seconds / STEP)

    def wanted(i: int, x: list[float]) -> tuple[float, float]:
        to = steer * min(1.0, 0.5 * i * STEP)
        return STEER_GAIN * (to - x[STEER]), 2.0 * (speed - x[VX])

    return list(drive(p, make_straight_state(p, speed), wanted, steps, steps)[-1, 0])


OUTPUTS = ("roll", "pitch", "force_x", "force_y", "load_front", "load_rear")


def compute_outputs(p: VehicleParameters, x: list[float]) -> np.ndarray:
    """Return OUTPUTS, (6,): rad; force of all tyres over mass in m/s2; N. SAE."""
    w = compute_wheels(p, x)
    along, aside = w.body(x[STEER])
    return np.array([x[ROLL], x[PITCH], along.sum() / p.m, aside.sum() / p.m, *w.load.reshape(2, 2).sum(1)])


def measure_response(p: VehicleParameters, speed: float, by: str, hertz: np.ndarray) -> dict[str, np.ndarray]:
    """Return the complex response of OUTPUTS to steering, throttle or brakes,
    (len(hertz),).

    by = "steer", "drive" or "brake". Linearised about driving straight at `speed`, by
    central differences of the package's rates.
    """
    x = hold_steering(p, speed, 0.0, 3.0)
    n, step = len(x), 1e-6

    def both(y: list[float], accel: float) -> np.ndarray:
        return np.concatenate([rates(list(y), [0.0, accel], p), compute_outputs(p, y)])

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


def fit_gain(hertz: np.ndarray, wanted: np.ndarray) -> float:
    """Return the gain of gain w^2/(s^2 + 2 z w s + w^2) nearest to a complex response."""
    s = 2j * np.pi * hertz

    def off(q: np.ndarray) -> np.ndarray:
        w = 2 * np.pi * q[1]
        e = (q[0] * w**2 / (s**2 + 2 * q[2] * w * s + w**2) - wanted) / abs(wanted[0])
        return np.concatenate([e.real, e.imag])

    return float(least_squares(off, [wanted[0].real, 1.5, 0.3]).x[0])


ROLLING = np.linspace(0.1, 3.0, 59)  # Hz, where the modes are fitted


def measure_roll_gain(p: VehicleParameters) -> float:
    """Return the gain of body_roll, rad s2/m: roll over the tyres' force by a mode.

    Linearised at 20 m/s, by steering, 0.1 .. 3 Hz.
    """
    y = measure_response(p, 20.0, "steer", ROLLING)
    # SAE: to the right > 0, so outwards in a left turn, whose force is < 0
    return fit_gain(ROLLING, -y["roll"] / y["force_y"])


def measure_pitch_and_load(p: VehicleParameters) -> tuple[float, float]:
    """Return the gains of pitch_leak (nose up > 0) and longitudinal_load_transfer.

    Linearised at 20 m/s; means of brakes and throttle, and of axles. Stiffness is
    proportional to load: its relative change over the acceleration by the tyres, at 0.1
    Hz. In the package it comes with the pitch mode, not at once.
    """
    pitch, transfer, load = [], [], compute_static_load(p)
    for by in ("brake", "drive"):
        y = measure_response(p, 20.0, by, ROLLING)
        pitch.append(fit_gain(ROLLING, y["pitch"] / y["force_x"]))
        ahead = (y["load_front"] / y["force_x"])[0].real / load[0]
        transfer.append(0.5 * ((y["load_rear"] / y["force_x"])[0].real / load[1] - ahead))
    return 0.5 * sum(pitch), 0.5 * sum(transfer)


def measure_rear_camber_steer(p: VehicleParameters) -> float:
    """Return the slip angle into the turn of the rear axle's camber force, over roll
    angle.

    In a steady turn of 2 m/s2: force of the axle less that without camber, over its
    stiffness, over roll. In the package a wheel that leans out pushes in. The front axle
    has the same, for which the catalogue has no effect.
    """
    x = hold_steering(p, 20.0, -2.0 * (p.a + p.b) / 400)
    w = compute_wheels(p, x)
    rear = zip(w.slip[2:], w.angle[2:], w.load[2:], strict=True)
    upright = sum(compute_tyre_force(p, s, a, 0.0, z)[1] for s, a, z in rear)
    return float((upright - w.aside[2:].sum()) / compute_slopes(p)["cornering_stiffness_rear"] / x[ROLL])


def measure_inverse_friction(p: VehicleParameters) -> float:
    """Return tse's load of an axle over the maximum side force of its tyres, mean of
    both.

    Loads m g lr/L and m g lf/L; tyres without camber.
    """
    found, angle = [], np.linspace(0, 0.3, 1201)
    for load, carried in zip(
        p.m * GRAVITY / (p.a + p.b) * np.array([p.b, p.a]), compute_static_load(p), strict=True
    ):
        free = free_slip(p, carried / 2)
        found.append(
            load / max(-2 * compute_tyre_force(p, free, float(a), 0.0, carried / 2)[1] for a in angle)
        )
    return float(np.mean(found))


def fit_combined_slip(p: VehicleParameters) -> float:
    """Return k of 1/sqrt(1 + k slip^2) nearest to the tyre's weight of side force by
    slip.

    Slip up to 3.5 %, both signs. Mean of -20 and 20 mrad, at the front's static load,
    without the side force by slip alone.
    """
    load, slip = 0.5 * compute_static_load(p)[0], np.linspace(-0.035, 0.035, 71)
    fy = np.array([[compute_tyre_force(p, s, a, 0.0, load)[1] for s in slip] for a in (-0.02, 0.02)])
    weight = (fy / fy[:, 35:36]).mean(0)  # the package's tyre is not quite symmetric
    return float(
        least_squares(lambda k: 1 / np.sqrt(1 + k * slip**2) - weight, [50.0], bounds=(0, np.inf)).x[0]
    )


def fit_lateral_transfer(p: VehicleParameters) -> float:
    """Return k of C (1 - k ay^2), s4/m2, mean of the axles: 0, the tyre is linear in
    load.

    Side force of an axle with the wheel loads of 5 m/s2, without camber, at a small
    angle, over that with equal loads.
    """
    loads, found = compute_wheels(p, hold_steering(p, 20.0, -5.0 * (p.a + p.b) / 400)).load.reshape(2, 2), []
    for pair in loads:
        uneven = sum(compute_tyre_force(p, 0.0, 1e-4, 0.0, z)[1] for z in pair)
        even = 2 * compute_tyre_force(p, 0.0, 1e-4, 0.0, pair.mean())[1]
        found.append(float((1 - uneven / even) / 25))
    return 0.5 * sum(found)


# Effects that the car has none of, and the parameter of each. What is steered is the
# state that is logged; the package turns the whole car by I_z and the tyres' moment, at
# arms a and b; its road is level, and the IMU levelled at rest.
NONE = {
    "mass": "change",
    "yaw_inertia": "change",
    "cg_shift": "distance",
    "steering_ratio": "change",
    "steering_offset": "angle",
    "steering_delay": "time",
    "steering_lag": "time",
    "steering_compliance": "angle_per_moment",
    "relaxation": "length",
    "longitudinal_relaxation": "length",
    "stiffness_drift": "change",
    "aero_drag": "coefficient",
    "rolling_resistance": "coefficient",
    "grade": "angle",
    "bank": "angle",
    "crosswind": "speed",
    "conicity": "front",
    "aligning_moment": "trail",
    "imu_misalignment": "angle",
    "imu_scale_ax": "error",
    "imu_scale_ay": "error",
    "gyro_scale": "error",
    "imu_delay": "time",
}


def make_truth(p: VehicleParameters) -> dict:
    """Return truth.json: every effect that may be missing, its first parameter and
    value."""
    pitch, transfer = measure_pitch_and_load(p)
    has = {
        # without force a tyre slips at static load: the magic formula is shifted by p_hx1
        "wheel_radius": ("change", -np.mean([free_slip(p, 0.5 * z) for z in compute_static_load(p)])),
        "rear_roll_steer": ("gain", measure_rear_camber_steer(p)),
        "combined_slip": ("factor", fit_combined_slip(p)),
        "tyre_saturation": ("inverse_friction", measure_inverse_friction(p)),
        "longitudinal_load_transfer": ("gain", transfer),
        "lateral_load_transfer": ("gain", fit_lateral_transfer(p)),
        # the IMU is at the body's centre of gravity, that of the whole car is behind it,
        # where who weighs the axles finds it
        "imu_lever_arm": ("x", (p.m_ur * p.b - p.m_uf * p.a) / p.m),
        "body_roll": ("gain", measure_roll_gain(p)),
        "pitch_leak": ("gain", pitch),
    }
    every = {key: (parameter, 0.0) for key, parameter in NONE.items()} | has
    return {"effects": [{"id": key, "parameter": at, "value": float(x)} for key, (at, x) in every.items()]}


def write(folder: Path, number: int, seed: int = 1) -> None:
    """Write the logs of a car, its vehicle file and its truth. seed: of noise and
    manoeuvres."""
    p = make_parameters(number)
    folder.mkdir(parents=True, exist_ok=True)
    for name in (*FITTED, *HELD_OUT):
        log = make_log(p, simulate_motion(p, draw_program(p, name, seed)), make_stream(seed, f"{name} noise"))
        path = folder / f"{'log' if name in FITTED else 'hold_out'}_{name}.csv"
        np.savetxt(
            path,
            np.column_stack(list(log.values())),
            fmt="%.7g",
            delimiter=",",
            header=",".join(COLUMNS),
            comments="",
        )
    (folder / "car.toml").write_text(format_vehicle(p, number), encoding="utf-8")
    (folder / "truth.json").write_text(json.dumps(make_truth(p), indent=1) + "\n", encoding="utf-8")


# ---- the study


def run(car: int) -> dict:
    """Run one car: logs, workflow, results."""
    folder = FOLDER / f"car{car}"
    done = folder / "result.json"
    if not done.exists():
        if not (folder / "truth.json").exists():  # its last file
            write(folder, car)
        logs, held = sorted(folder.glob("log_*.csv")), sorted(folder.glob("hold_out_*.csv"))
        verdict = gap(logs, folder / "car.toml", held).as_json()
        done.write_text(
            json.dumps(
                convert_to_plain(
                    {k: verdict[k] for k in ("effects", "formula", "gap", "verdict", "possible", "words")}
                )
            )
        )
    return json.loads(done.read_text())


def get_true_size(truth: dict, effect: str) -> tuple[str, float] | None:
    """Return parameter and size of the effect in the car; None: absent, or without one
    size."""
    found = next((e for e in truth["effects"] if e["id"] == effect), {})
    value = found.get("value")
    return (found["parameter"], float(value)) if isinstance(value, (int, float)) and value else None


def make_table(results: dict[int, tuple[dict, dict]]) -> str:
    """Return results and truth by car as Markdown."""
    lines = [
        "| car | named effects: size (true size) | formula | "
        "accel_x, held out: rms / noise, before -> after | accel_y | yaw_rate |",
        "|---|---|---|---:|---:|---:|",
    ]
    for car, (result, truth) in results.items():
        named = []
        for e in result["effects"]:
            true = get_true_size(truth, e["id"])
            key = true[0] if true else next(iter(e["parameters"]))
            size = f"{e['parameters'][key]['value']:.3g}"
            named.append(f"{e['id']} {size}" + (f" ({true[1]:.3g})" if true else " (not there)"))
        proposed = (result["formula"] or {}).get("proposed")
        before, after = result["gap"]["held_out"]["before"], result["gap"]["held_out"]["after"]
        falls = [
            f"{before[c]:.2f} -> {after[c]:.2f}, {100 * (after[c] / before[c] - 1):+.0f} %"
            for c in ("accel_x", "accel_y", "yaw_rate")
        ]
        text = f"`{proposed['formula']}` at {proposed['place']}" if proposed else "-"
        lines.append(f"| {car} | {', '.join(named) or '-'} | {text} | {' | '.join(falls)} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.gap.multibody", description=__doc__.split("\n")[0])
    parser.add_argument("--cars", type=int, nargs="+", choices=(1, 2, 3), default=[1, 2, 3])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--again", action="store_true")
    options = parser.parse_args()
    if options.again:
        shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True, exist_ok=True)
    found = run_in_processes(run, options.cars, options.jobs, "car")
    if found is None:
        return 130
    results = dict(zip(options.cars, found, strict=True))
    text = make_table(
        {c: (r, json.loads((FOLDER / f"car{c}" / "truth.json").read_text())) for c, r in results.items()}
    )
    if len(results) == 3:
        TABLE.write_text(text)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
