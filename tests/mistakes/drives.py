"""Two drives with bends, acceleration and braking, and frequent mistakes in logs."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.cars.cache import make_logs_once
from tse.library.core import Config, SimConfig
from tse.report.tables import simulated_vehicle
from tse.simulation import maneuvers
from tse.simulation.simulate import simulate

STEP = 0.01  # s
SECONDS = 150.0
CHANNELS = ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")
WHEELS = CHANNELS[1:3]
CAR = ("mass", "lf", "lr", "wheel_radius_front", "wheel_radius_rear")
AXLES = {"both": 0, "front": 1, "rear": 2}
DEGREE, G, RATIO = np.pi / 180, 9.80665, 15.5
TRACK = 1.53  # m
STUCK = 20.0  # s, from which on a channel is frozen
LogOf = dict[str, np.ndarray]


@dataclass(frozen=True)
class Drive:
    """A log and its car."""

    name: str
    log: LogOf
    car: dict[str, float]  # CAR
    driven: str
    # the settings are those of the simulated car; else only CAR, with defaults for the
    # others
    known: bool

    def settings(self) -> Config:
        """Return the settings by tse_config_exact() or tse_config_default()."""
        car = {**self.car, "driven_axle": AXLES[self.driven]}
        return Config.exact(car) if self.known else Config(car)


def make_drives() -> list[Drive]:
    """Return the drives of a known single track and of a car with 14 degrees of freedom.

    The single track is known exactly, so its stiffness is valid soon. The other car is on
    a mountain road."""
    car = {"mass": 1900.0, "lf": 1.25, "lr": 1.5, "wheel_radius_front": 0.33, "wheel_radius_rear": 0.33}
    config = Config.exact({**car, "driven_axle": AXLES["front"]})
    plan = maneuvers.build("double-lane-change", config, sample_time=STEP, duration=SECONDS, seed=1)
    made = simulate(plan, config, SimConfig({"seed": 1})).log
    single = {c: made[c].to_numpy(float) for c in ("time", *CHANNELS)}
    real = make_logs_once("mountain", minutes=SECONDS / 60, cars=5, seed=41)[3]
    facts = {k: float(real.vehicle[k]) for k in CAR}
    of_car = {c: np.asarray(real.log[c], float) for c in ("time", *CHANNELS)}
    return [
        Drive("single track, known exactly", single, car, "front", True),
        Drive("14 degrees of freedom, ordinary car", of_car, facts, str(real.vehicle["driven_axle"]), False),
    ]


def _scale_channels(channels: tuple[str, ...], factor: Callable[[Drive], float]) -> Callable[[Drive], LogOf]:
    """Return a function that multiplies channels by a factor."""
    return lambda d: {**d.log, **{c: factor(d) * d.log[c] for c in channels}}


def _exchange_axles(d: Drive) -> LogOf:
    return {**d.log, WHEELS[0]: d.log[WHEELS[1]], WHEELS[1]: d.log[WHEELS[0]]}


def _freeze_yaw_rate(d: Drive) -> LogOf:
    x = d.log["yaw_rate"]
    at = round(STUCK / STEP)
    return {**d.log, "yaw_rate": np.where(np.arange(len(x)) < at, x, x[at])}


def _get_radius(d: Drive) -> float:
    return d.car["wheel_radius_front"]


MISTAKES: dict[str, Callable[[Drive], LogOf]] = {
    "yaw rate in deg/s": _scale_channels(("yaw_rate",), lambda _: 1 / DEGREE),
    "lateral acceleration in g": _scale_channels(("accel_y",), lambda _: 1 / G),
    "km/h taken for m/s": _scale_channels(WHEELS, lambda _: 3.6),
    "km/h taken for rad/s": _scale_channels(WHEELS, lambda d: 3.6 * _get_radius(d)),
    "axles exchanged": _exchange_axles,
    "sign of yaw rate": _scale_channels(("yaw_rate",), lambda _: -1),
    "sign of lateral acceleration": _scale_channels(("accel_y",), lambda _: -1),
    "sign of steering angle": _scale_channels(("steer_angle",), lambda _: -1),
    "steering angle in degrees": _scale_channels(("steer_angle",), lambda _: 1 / DEGREE),
    "angle of the steering wheel": _scale_channels(("steer_angle",), lambda _: RATIO),
    "wheel speeds in m/s": _scale_channels(WHEELS, _get_radius),
    "wheel speeds in rpm": _scale_channels(WHEELS, lambda _: 30 / np.pi),
    "yaw rate stands still": _freeze_yaw_rate,
}


def _turn_imu(d: Drive) -> LogOf:
    x, y, angle = d.log["accel_x"], d.log["accel_y"], np.pi / 6
    return {
        **d.log,
        "accel_x": x * np.cos(angle) + y * np.sin(angle),
        "accel_y": y * np.cos(angle) - x * np.sin(angle),
    }


def _mix_sides(d: Drive) -> LogOf:
    half = 0.5 * TRACK / _get_radius(d) * d.log["yaw_rate"]
    return {**d.log, WHEELS[0]: d.log[WHEELS[0]] - half, WHEELS[1]: d.log[WHEELS[1]] + half}


def _slow_time(d: Drive) -> LogOf:
    return {**d.log, "time": 100.0 * d.log["time"]}


# Mistakes that only a whole log shows, with a part of the warning: a single row has
# neither time nor other rows to compare with.
OF_LOGS: dict[str, tuple[Callable[[Drive], LogOf], str]] = {
    "IMU turned by 30 degrees": (_turn_imu, "the IMU is turned about the vertical by"),
    "left wheels as front, right as rear": (
        _mix_sides,
        "is of one side, or a left and a right wheel are one signal",
    ),
    "time counts rows": (_slow_time, "is time in s, or does it count rows?"),
}


def format_vehicle(d: Drive) -> str:
    """Return the car as a vehicle file; missing values have defaults."""
    if d.known:  # the car of `tselab simulate`, with all values and no uncertainty
        return simulated_vehicle()
    return "".join(
        f"{k} = {v}\n" for k, v in {"name": '"car"', **d.car, "driven_axle": f'"{d.driven}"'}.items()
    )
