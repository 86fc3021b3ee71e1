"""Make logs with their truth from cars, roads, drivers and sensors."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .cars import GRAVITY, Car, draw_car, make_clean_sensors
from .driver import CONTROL, Drivers
from .model import STEP, Fleet
from .road import ROADS, SCENARIOS, Road, Surface, draw_roads
from .sensors import FINE, ROW, SLOPES, STATES, Motion, make_log, make_pedals

SETTLE = 2.0  # s driven before the log begins
BATCH = 20  # cars side by side: more are not faster by car, and take memory
COLUMNS = ("time", "steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")
PEDALS = ("brake", "wheel_torque_front", "wheel_torque_rear")  # optional columns of a log
# Of the reference file, at the times of the rows without any latency. Columns that a
# log's reader would draw have no place in the log.
REFERENCE = (
    "time",
    "vel_x",
    "vel_y",
    "yaw_rate",
    "roll",
    "pitch",
    "steering_wheel",
    "road_wheel",
    "grade",
    "bank",
    "place",
    "beside",
    "slip_front",
    "slip_rear",
    "alpha_front",
    "alpha_rear",
    "fx_front",
    "fx_rear",
    "fy_front",
    "fy_rear",
    "cx_front",
    "cx_rear",
    "cy_front",
    "cy_rear",
    "cx_front_tyre",
    "cy_front_tyre",
    "cy_rear_tyre",
    "cy_front_steered",
    "cy_rear_axle",
    "radius_front",
    "radius_rear",
    *PEDALS,
    "road_friction",
    "road_stiffness",
)
BRAKES = 50.0  # N, brake force of all wheels at which the switch is on
MIN_SLIP, MIN_ANGLE, MIN_SPEED = 5e-4, 2e-3, 2.0  # 1, rad, m/s: no secant below


@dataclass
class CarLog:
    """A car on a road: log (COLUMNS) and reference (REFERENCE) by column, truth of
    truth.json."""

    car: Car
    log: dict[str, np.ndarray]
    reference: dict[str, np.ndarray]
    truth: dict[str, Any]

    @property
    def vehicle(self) -> dict[str, Any]:
        """Return the keys of the vehicle file."""
        return self.car.vehicle

    def write(self, folder: Path, road: str) -> None:
        """Write car.toml, log_<road>.csv, reference_<road>.csv, and this road's
        truth.json."""
        folder.mkdir(parents=True, exist_ok=True)
        lines = [f"{key} = {json.dumps(value)}" for key, value in self.vehicle.items()]
        (folder / "car.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
        _write_csv(folder / f"log_{road}.csv", self.log)
        _write_csv(folder / f"reference_{road}.csv", self.reference)
        file = folder / "truth.json"
        truth = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        logs = truth.get("logs", {}) if truth.get("parameters") == self.truth["parameters"] else {}
        truth = {k: v for k, v in self.truth.items() if k != "log"} | {
            "logs": logs | {road: self.truth["log"]}
        }
        file.write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


def _write_csv(path: Path, columns: dict[str, np.ndarray]) -> None:
    """Write columns with nine digits; NaN as an empty cell."""
    form = ",".join(["%.9g"] * len(columns))
    text = "\n".join([form % row for row in zip(*(c.tolist() for c in columns.values()), strict=True)])
    path.write_text(",".join(columns) + "\n" + text.replace("nan", "") + "\n", encoding="utf-8")


def make_stream(seed: int, car: int, what: str) -> np.random.Generator:
    """Return a random stream of its own: a car stays the same whatever else is drawn."""
    return np.random.default_rng([seed, car, *what.encode()])


def make_cars(
    cars: int,
    seed: int,
    mass_error: float = 0.0,
    cg_error: float = 0.0,
    tell_inertia: bool = False,
    clean: bool = False,
) -> list[Car]:
    """Draw cars 0 .. cars - 1 of a seed, as draw_car(). clean: sensors without errors."""
    drawn = [
        draw_car(make_stream(seed, i, "car"), mass_error, cg_error, tell_inertia, f"car {i} of seed {seed}")
        for i in range(cars)
    ]
    return [replace(c, sensors=make_clean_sensors(c.sensors)) if clean else c for c in drawn]


def make_logs(
    road: str = "mountain",
    minutes: float = 10.0,
    cars: int | list[Car] = 5,
    seed: int = 1,
    scenario: str = "dry",
    *,
    hills: bool = True,
    grade_rms: float | None = None,
    even: bool = False,
    event_time: float | None = None,
    mass_error: float = 0.0,
    cg_error: float = 0.0,
    tell_inertia: bool = False,
    clean: bool = False,
    pedals: bool = False,
) -> list[CarLog]:
    """Drive cars on a road.

    Parameters
    ----------
    hills
        The road has slopes, crossfall and superelevation.
    grade_rms
        rad; None: drawn by car.
    even
        No unevenness.
    scenario, event_time
        One of SCENARIOS, and the time, s, from which it may begin.
    pedals
        The logs have PEDALS, too.

    Notes
    -----
    Other parameters are those of make_cars(). Each car has its own road of ROADS. A car
    of a seed is the same car on every road, for any number of cars, and drives the same
    road in every scenario.
    """
    if road not in ROADS or scenario not in SCENARIOS:
        raise ValueError(
            f"no road {road!r} or scenario {scenario!r}; there are {ROADS} and {tuple(SCENARIOS)}"
        )
    fleet = (
        make_cars(cars, seed, mass_error, cg_error, tell_inertia, clean) if isinstance(cars, int) else cars
    )
    done: list[CarLog] = []
    for first in range(0, len(fleet), BATCH):
        batch = fleet[first : first + BATCH]

        def streams(what: str, first: int = first, batch: list[Car] = batch) -> list[np.random.Generator]:
            return [make_stream(seed, first + i, f"{road} {what}") for i in range(len(batch))]

        duration = 60.0 * minutes
        roads = draw_roads(road, streams("road"), duration + SETTLE, hills, grade_rms, even)
        speed = np.zeros(len(batch)) if road == "city" else roads.speed[0]
        model = Fleet(batch, speed)
        surface = Surface(scenario, streams("event"), duration, event_time, model.x)
        record = drive(batch, model, roads, surface, streams("driver"), duration)
        noise = streams("sensors")
        for i, car in enumerate(batch):
            about = {
                "seed": seed,
                "car": first + i,
                "road": road,
                "minutes": minutes,
                "scenario": scenario,
                "hills": hills,
                "even": even,
            }
            done.append(_finish(car, record, i, surface, about, noise[i]))
            if pedals:
                done[-1].log |= make_pedals(
                    car.sensors, done[-1].reference, make_stream(seed, first + i, f"{road} pedals")
                )
    return done


@dataclass
class Record:
    """Recording of a batch: (times, names, cars) every FINE and every CONTROL; log
    starts at 0."""

    state: np.ndarray
    slope: np.ndarray
    reference: np.ndarray


RECORDED = (
    *REFERENCE[1:20],
    "cx_front_tyre",
    "cx_rear_tyre",
    "cy_front_tyre",
    "cy_rear_tyre",
    "angle_steered",
    *REFERENCE[-7:],
)


def drive(
    cars: list[Car],
    fleet: Fleet,
    road: Road,
    surface: Surface,
    streams: list[np.random.Generator],
    duration: float,
) -> Record:
    """Drive for SETTLE and a duration, s."""
    settle, steps = round(SETTLE / CONTROL), round((SETTLE + duration) / CONTROL)
    drivers = Drivers(cars, fleet, road, surface, streams, steps)
    n, fine, part = len(cars), round(CONTROL / FINE), round(FINE / STEP)
    state, slope = np.empty((fine * steps + 1, len(STATES), n)), np.empty((steps + 1, len(SLOPES), n))
    reference = np.empty((steps, len(RECORDED), n), np.float32)
    ahead = STEP * np.arange(1, fine * part + 1)[:, None, None]
    for k in range(steps):
        drivers.decide(k)
        if surface.follow(
            (k - settle) * CONTROL, drivers.s, drivers.asked() if surface.scenario != "dry" else drivers.e
        ):
            fleet.set_road(*surface.now)
        grade, bank = road.at(road.grade, drivers.s), road.at(road.bank, drivers.s)
        # the road's plane turns with its slope: what a crest takes from the load
        bend = road.at(road.grade, drivers.s + 2.0) - road.at(road.grade, drivers.s - 2.0)
        into = GRAVITY * np.cos(grade) * np.cos(bank) + fleet.vx**2 * bend / 4.0
        gravity = np.array([-GRAVITY * np.sin(grade), -GRAVITY * np.sin(bank) * np.cos(grade), into])
        slope[k] = gravity
        places = drivers.s + ahead * fleet.vx + fleet.x[:, 0]
        uneven = road.uneven(places) if road.roughness.any() else None
        start, end = fleet.steering_wheel, drivers.steering_wheel
        record_step(reference[k], fleet, drivers, surface, grade, bank)
        for j in range(fine):
            state[fine * k + j] = read_state(fleet)
            to = start + (end - start) * ((j + 1) / fine)
            bumps = None if uneven is None else uneven[j * part : (j + 1) * part]
            fleet.advance(part, to, drivers.drive, drivers.brake, gravity, bumps)
        drivers.move()
    state[-1], slope[-1] = read_state(fleet), slope[-2]
    return Record(state, slope, reference)


def read_state(f: Fleet) -> np.ndarray:
    """Return the present STATES."""
    out = np.empty((len(STATES), f.n))
    out[:9] = f.vx, f.vy, f.r, f.roll, f.droll, f.pitch, f.dpitch, f.dheave, f.steering_wheel
    out[9:] = f.spin.reshape(4, f.n)
    return out


def record_step(
    out: np.ndarray, f: Fleet, d: Drivers, surface: Surface, grade: np.ndarray, bank: np.ndarray
) -> None:
    """Return the present RECORDED; slips and forces are those of the single track
    (cars.py)."""
    p = f.p
    cos, sin = np.cos(f.steer), np.sin(f.steer)
    lateral = f.vy + p.lf * f.r
    radius, spin = (
        0.5 * (f.rolling_radius[:, 0] + f.rolling_radius[:, 1]),
        0.5 * (f.spin[:, 0] + f.spin[:, 1]),
    )
    slips = []
    for rolling, v in zip(radius * spin, (f.vx * cos + lateral * sin, f.vx), strict=True):
        slips.append((rolling - v) / np.maximum(np.maximum(np.abs(v), np.abs(rolling)), 1.0))
    towards = np.arctan2(lateral, np.maximum(f.vx, 0.5))
    (fx, fy), taken = f.force[:, :, 0] + f.force[:, :, 1], 0.5 * (f.slip[:, :, 0] + f.slip[:, :, 1])
    ground = (
        (1.0, 1.0)
        if surface.scenario == "dry"
        else (surface.now[0].mean((0, 1)), surface.now[2].mean((0, 1)))
    )
    out[:-2] = (
        f.vx, f.vy, f.r, f.roll, f.pitch, f.steering_wheel, f.steer, grade, bank, d.s, d.e,
        *slips, f.steer - towards, -np.arctan2(f.vy - p.lr * f.r, np.maximum(f.vx, 0.5)),
        *fx, *fy, *taken[0], *taken[1], f.steering_wheel / p.steering_ratio - towards, *radius,
        d.braking > BRAKES, *(d.drive - d.brake).sum(1),
    )  # fmt: skip
    out[-2], out[-1] = ground


def compute_secant(force: np.ndarray, slip: np.ndarray, least: float, ok: np.ndarray) -> np.ndarray:
    """Return force over slip where the slip is large enough."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(ok & (np.abs(slip) >= least), force / slip, np.nan)


def _finish(
    car: Car, record: Record, i: int, surface: Surface, about: dict[str, Any], rng: np.random.Generator
) -> CarLog:
    settle = round(SETTLE / CONTROL)
    n = len(record.reference)
    time = np.arange(len(record.state)) * FINE - SETTLE
    state = {name: record.state[:, k, i] for k, name in enumerate(STATES)}
    coarse = np.arange(n + 1) * CONTROL - SETTLE
    state |= {name: np.interp(time, coarse, record.slope[:, k, i]) for k, name in enumerate(SLOPES)}
    rows = np.arange(n - settle) * ROW
    log, latency = make_log(car, Motion(time, state), rows, rng)

    seen = {name: record.reference[settle:, k, i].astype(float) for k, name in enumerate(RECORDED)}
    ok = seen["vel_x"] > MIN_SPEED
    taken = {name: seen[name] for name in RECORDED if name.endswith("_tyre")}
    found = {"time": rows, **{name: x for name, x in seen.items() if name not in taken}}
    for axis, slip, least in (("x", "slip", MIN_SLIP), ("y", "alpha", MIN_ANGLE)):
        for axle in ("front", "rear"):
            name, force = f"c{axis}_{axle}", seen[f"f{axis}_{axle}"]
            found[name] = compute_secant(force, seen[f"{slip}_{axle}"], least, ok)
            found[f"{name}_tyre"] = compute_secant(force, taken[f"{name}_tyre"], least, ok)
    found["cy_front_steered"] = compute_secant(seen["fy_front"], seen["angle_steered"], MIN_ANGLE, ok)
    found["cy_rear_axle"] = 1 / (1 / found["cy_rear_tyre"] + car.parameters["compliance_rear"])
    began = float(surface.time[i])
    event = (
        {"time": began, "place": float(surface.place[i]), "takes": float(surface.takes[i])}
        if np.isfinite(began)
        else None
    )
    if event:
        event |= {
            name: surface.end[k, :, :, i].tolist()
            for k, name in enumerate(("friction", "along", "across", "radius"))
        }
    truth = {
        "parameters": car.parameters,
        "driven_axle": car.driven_axle,
        "linear_stiffness": car.linear_stiffness(),
        "understeer": car.understeer(),
        "sensors": {k: v for k, v in car.sensors.items() if k != "latency"},
        "log": about | {"latency": latency, "event": event},
    }
    return CarLog(car, {c: log[c] for c in COLUMNS}, {c: found[c] for c in REFERENCE}, truth)
