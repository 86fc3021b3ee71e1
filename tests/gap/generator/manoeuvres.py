"""Draw the driver's steering angle, target speed and acceleration of each step.

Steering is open loop and computed from the nominal car, so that a manoeuvre does not
depend on the hidden effects.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .car import NOMINAL, compute_understeer
from .model import STEP

SETTLE = 2.0  # s driven straight before the log begins


@dataclass
class Program:
    """Signals at every step, from SETTLE before the log to its end."""

    steer: np.ndarray
    speed: np.ndarray
    accel: np.ndarray
    coast: np.ndarray


class Track:
    """A program being built; time 0 is the start of the log.

    `grip` scales the lateral acceleration where the car could slide.
    """

    def __init__(self, rng: np.random.Generator, duration: float, grip: float) -> None:
        self.rng, self.duration, self.grip = rng, duration, grip
        self.t = np.arange(round((duration + SETTLE) / STEP) + 1) * STEP - SETTLE
        self.steer, self.accel, self.coast = (np.zeros_like(self.t) for _ in range(3))
        self.v0 = 20.0

    def ramp(self, start: float, length: float) -> np.ndarray:
        """Return 0 before `start`, 1 after `start + length`, smooth between."""
        return 0.5 - 0.5 * np.cos(np.pi * np.clip((self.t - start) / length, 0, 1))

    def pulse(self, start: float, end: float, rise: float) -> np.ndarray:
        return self.ramp(start, rise) - self.ramp(end - rise, rise)

    def angle(self, ay: float, v: float | None = None) -> float:
        """Return the nominal car's steady road-wheel angle for a lateral acceleration."""
        v = self.v0 if v is None else v
        return self.grip * ay * ((NOMINAL["lf"] + NOMINAL["lr"]) / v**2 + compute_understeer(NOMINAL))

    def program(self) -> Program:
        speed = self.v0 + np.cumsum(self.accel) * STEP
        return Program(self.steer, speed, self.accel, self.coast)


def steer_sine_sweep(k: Track) -> None:
    k.v0 = k.rng.uniform(19, 26)
    end = k.duration - 1.0
    t = np.clip(k.t - 1.0, 0, end - 1.0)
    low, high = 0.25, 3.0
    rate = np.log(high / low) / (end - 1.0)
    phase = 2 * np.pi * low * (np.exp(rate * t) - 1) / rate
    k.steer += k.angle(k.rng.uniform(2.8, 3.4)) * np.sin(phase) * k.pulse(1.0, end, 0.5)


def make_steps(low: float, high: float) -> Callable[[Track], None]:
    def steps(k: Track) -> None:
        k.v0 = k.rng.uniform(low, high)
        side = k.rng.choice([-1.0, 1.0])
        start, levels = 1.0, np.linspace(2.0, k.rng.uniform(5.0, 5.6), 6)
        length = (k.duration - 1.0) / 6
        for i, ay in enumerate(k.rng.permutation(levels)):  # in no order: severity must not look like time
            rise = k.rng.uniform(0.25, 0.6)
            k.steer += side * (-1) ** i * k.angle(ay) * k.pulse(start, start + 0.62 * length, rise)
            start += length

    return steps


def steer_slalom(k: Track) -> None:
    k.v0 = k.rng.uniform(14, 20)
    f = k.rng.uniform(0.4, 0.65)
    k.steer += (
        k.angle(k.rng.uniform(3.6, 4.6)) * np.sin(2 * np.pi * f * k.t) * k.pulse(1.0, k.duration - 1.0, 2.0)
    )


def change_lanes(k: Track) -> None:
    k.v0 = k.rng.uniform(17, 24)
    for start in np.arange(1.5, k.duration - 6.0, 8.5):
        a = k.angle(k.rng.uniform(3.6, 4.8))
        period = k.rng.uniform(1.6, 2.2)
        for at, side in ((start, 1.0), (start + 1.5 * period, -1.0)):
            t = np.clip((k.t - at) / period, 0, 1)
            k.steer += side * a * np.sin(2 * np.pi * t) * np.sin(np.pi * t) ** 0.5


def _brake_in_turn(k: Track) -> None:
    k.v0 = k.rng.uniform(22, 26)
    side = k.rng.choice([-1.0, 1.0])
    for i, start in enumerate(np.arange(1.0, k.duration - 9.0, 9.6)):
        k.steer += side * (-1) ** i * k.angle(k.rng.uniform(3.4, 4.2)) * k.pulse(start, start + 7.6, 0.8)
        hard = k.rng.uniform(3.2, 4.6) * max(k.grip, 0.6)
        k.accel -= hard * k.pulse(start + 2.0, start + 4.0, 0.3)
        k.accel += hard * 1.7 / 3.7 * k.pulse(start + 4.3, start + 8.3, 0.3)


def _brake_throttle(k: Track) -> None:
    k.v0 = k.rng.uniform(15, 18)
    for start in np.arange(1.0, k.duration - 5.5, 5.8):
        up, down = k.rng.uniform(1.6, 2.6), k.rng.uniform(2.5, 5.0)
        rise = k.rng.uniform(0.15, 0.3)
        held = k.rng.uniform(2.2, 2.8)
        k.accel += up * k.pulse(start, start + held, rise)
        brake = up * (held - rise) / down + rise
        k.accel -= down * k.pulse(start + held + 0.4, start + held + 0.4 + brake, rise)
    _wander(k, 0.002, 1.5)


def drive_in_town(k: Track) -> None:
    k.v0 = k.rng.uniform(5.5, 7.0)
    side = k.rng.choice([-1.0, 1.0])
    for i, start in enumerate(np.arange(1.0, k.duration - 4.5, 4.8)):
        k.steer += (
            side
            * (-1) ** i
            * k.rng.uniform(0.16, 0.27)
            * min(1.0, k.grip + 0.2)
            * k.pulse(start, start + 3.8, 0.9)
        )
        k.accel += k.rng.uniform(0.5, 1.0) * (
            k.pulse(start + 3.6, start + 4.8, 0.3) - k.pulse(start - 0.4, start + 0.8, 0.3)
        )


def drive_on_highway(k: Track) -> None:
    k.v0 = k.rng.uniform(29, 34)
    _wander(k, 0.002, 0.8)
    for start in np.arange(2.0, k.duration - 6.0, 9.0):
        a = k.rng.uniform(0.3, 0.8)
        k.accel += a * (k.pulse(start, start + 2.5, 0.5) - k.pulse(start + 3.0, start + 5.5, 0.5))


def _coast_down(k: Track) -> None:
    k.v0 = k.rng.uniform(28, 33)
    _wander(k, 0.002, 0.8)
    k.coast += k.t > 1.0


def _wander(k: Track, size: float, fastest: float) -> None:
    """Add small steering corrections: five sines below `fastest` Hz."""
    for _ in range(5):
        f, phase = k.rng.uniform(0.1, fastest), k.rng.uniform(0, 2 * np.pi)
        k.steer += size / np.sqrt(2.5) * np.sin(2 * np.pi * f * k.t + phase) * k.ramp(0.5, 1.0)


MANOEUVRES: dict[str, Callable[[Track], None]] = {
    "sine_sweep": steer_sine_sweep,
    "steps_slow": make_steps(12, 15),
    "steps_fast": make_steps(24, 29),
    "slalom": steer_slalom,
    "double_lane_change": change_lanes,
    "brake_in_turn": _brake_in_turn,
    "brake_throttle": _brake_throttle,
    "urban": drive_in_town,
    "highway": drive_on_highway,
    "coast_down": _coast_down,
}
CORE = (
    "sine_sweep",
    "steps_slow",
    "steps_fast",
    "brake_in_turn",
    "brake_throttle",
)  # in every case of the study
SIXTH = ("urban", "highway", "coast_down")  # and one of these, by seed
HOLD_OUT = ("slalom", "double_lane_change")


def drive_program(name: str, rng: np.random.Generator, duration: float = 30.0, grip: float = 1.0) -> Program:
    """Draw a manoeuvre; with `grip` below 1 the driver keeps away from the limit."""
    track = Track(rng, duration, grip)
    MANOEUVRES[name](track)
    return track.program()
