"""Make the driver's inputs of a manoeuvre as time histories, a value for each sample.

A manoeuvre has a steering angle, and either wheel torques (open loop) or a target speed.
A proportional controller in simulate.py follows the target speed by drive and brake
torques.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tse.library.core import Config
from tse.library.errors import UserError


@dataclass
class Maneuver:
    """Time histories of a manoeuvre: arrays with a value for each time.

    A torque [Nm] is the sum of both wheels of an axle."""

    time: np.ndarray  # [s]
    speed: float  # [m/s] speed at the start
    steer_angle: np.ndarray  # [rad] at the road wheels
    wheel_torque_front: np.ndarray
    wheel_torque_rear: np.ndarray
    road_level: np.ndarray  # factor by which the road multiplies all stiffnesses
    # [m/s] target of a speed controller, whose wheel and brake torques replace those of
    # the manoeuvre. None: no controller
    target_speed: np.ndarray | None = None
    brake_torque_front: np.ndarray | None = None  # None: no brake torque
    brake_torque_rear: np.ndarray | None = None  # None: no brake torque
    # coefficient of friction. If it is 0 in a row, or if this is None, the simulator's
    # settings determine it.
    road_friction: np.ndarray | None = None


@dataclass(frozen=True)
class Kind:
    """A manoeuvre in the list MANEUVERS."""

    name: str
    duration: float  # [s] default duration
    speed: float  # [m/s] default speed at the start
    amplitude: float  # default amplitude, in the unit of amplitude_text
    amplitude_text: str  # quantity and unit of the amplitude
    text: str  # description
    # function (time, speed, amplitude, config, rng) that returns time histories, with the
    # names of members of Maneuver as keys
    build: Callable[[np.ndarray, float, float, Config, np.random.Generator], dict]


def make_square(t: np.ndarray, period: float) -> np.ndarray:
    """Return +1 in the first half of each period, and -1 in the second."""
    return np.where((t / period + 1e-9) % 1.0 < 0.5, 1.0, -1.0)


def _make_square_waves(
    t: np.ndarray, speed: float, amplitude: float, config: Config, rng: np.random.Generator
) -> dict:
    """Make square waves: steering with period 4 s, drive torque with period 5 s."""
    return {"steer_angle": amplitude * make_square(t, 4.0), "wheel_torque_front": 700.0 * make_square(t, 5.0)}


def _make_double_lane_change(
    t: np.ndarray, speed: float, amplitude: float, config: Config, rng: np.random.Generator
) -> dict:
    """Make cycles of 12 s: 3 s accelerate, 6 s change lane and back, 2 s brake, 1 s roll.

    Braking reduces the speed to about its value before the acceleration.
    """
    cycle = t % 12.0
    steer = np.zeros_like(t)
    for start, sign in ((3.0, 1.0), (6.0, -1.0)):  # a full period of a sine changes the lane
        s = (cycle - start) / 2.5
        inside = (s >= 0) & (s < 1)
        steer[inside] += sign * amplitude * np.sin(2 * np.pi * s[inside])
    drive = np.select([cycle < 3.0, (cycle >= 9.0) & (cycle < 11.0)], [1.2, -1.75], 0.0)  # m/s2
    return {"steer_angle": steer, "wheel_torque_front": drive * config.mass * config.wheel_radius_front}


def _make_step_steer(
    t: np.ndarray, speed: float, amplitude: float, config: Config, rng: np.random.Generator
) -> dict:
    """Increase the steering angle after 1 s by a ramp of 0.2 s, at constant speed."""
    return {
        "steer_angle": amplitude * np.clip((t - 1.0) / 0.2, 0.0, 1.0),
        "target_speed": np.full_like(t, speed),
    }


def _make_sine_sweep(
    t: np.ndarray, speed: float, amplitude: float, config: Config, rng: np.random.Generator
) -> dict:
    """Steer by a sine whose frequency rises exponentially from 0.2 to 3 Hz, at constant
    speed."""
    low, high = 0.2, 3.0
    rate = np.log(high / low) / max(t[-1], 1e-9)
    phase = 2 * np.pi * low * np.expm1(rate * t) / rate
    return {"steer_angle": amplitude * np.sin(phase), "target_speed": np.full_like(t, speed)}


def compute_understeer(config: Config) -> float:
    """Return the understeer gradient K of the nominal car, rad s2/m.

    The steering angle on a circle of radius R is (L + K v^2) / R, with wheelbase L."""
    c = config
    wheelbase = c.lf + c.lr
    return c.mass / wheelbase * (c.lr / c.cornering_stiffness_front - c.lf / c.cornering_stiffness_rear)


def _make_constant_radius(
    t: np.ndarray, speed: float, amplitude: float, config: Config, rng: np.random.Generator
) -> dict:
    """Drive on a circle with rising speed, up to a lateral acceleration of 4 m/s2."""
    radius = amplitude
    top = max(speed, np.sqrt(4.0 * radius))
    target = speed + (top - speed) * np.clip(t / max(t[-1], 1e-9), 0.0, 1.0)
    steer = (config.lf + config.lr + compute_understeer(config) * target**2) / radius
    return {"steer_angle": steer * np.clip(t / 2.0, 0.0, 1.0), "target_speed": target}


def _make_straight(
    t: np.ndarray, speed: float, amplitude: float, config: Config, rng: np.random.Generator
) -> dict:
    """Drive straight with small random corrections of steering and speed."""
    step = t[1] - t[0] if len(t) > 1 else 0.01
    return {
        "steer_angle": amplitude * _make_coloured(rng, len(t), step, 0.8),
        "target_speed": speed + 0.5 * _make_coloured(rng, len(t), step, 8.0),
    }


def _make_stop_and_go(
    t: np.ndarray, speed: float, amplitude: float, config: Config, rng: np.random.Generator
) -> dict:
    """Make cycles of 20 s: accelerate to 12 m/s in 6 s, hold this speed for 4 s, brake to
    standstill in 5 s, rest for 5 s.

    From 5 to 11 s of each cycle the car drives a bend: to the left in the first cycle, to
    the right in the second, and so on."""
    cycle = t % 20.0
    top = 12.0
    target = np.interp(cycle, [0, 6, 10, 15, 20], [0, top, top, 0, 0])
    bend = np.clip(np.sin(np.pi * (cycle - 5.0) / 6.0), 0.0, None) * ((cycle > 5) & (cycle < 11))
    return {
        "steer_angle": amplitude * bend * np.where((t // 20.0) % 2 == 0, 1.0, -1.0),
        "target_speed": target,
    }


def _make_coloured(rng: np.random.Generator, n: int, step: float, memory: float) -> np.ndarray:
    """Return low-pass noise with sd 1, like the small corrections of a human driver.

    Two first-order low-pass filters are applied to white noise. `n`: number of values.
    `step`: sample time [s]. `memory`: time constant [s] of the slower filter."""
    from scipy.signal import lfilter

    a = np.exp(-step / memory)
    x = lfilter([1 - a], [1, -a], rng.standard_normal(n + int(10 * memory / step)))
    b = np.exp(-step / (0.3 * memory))
    x = lfilter([1 - b], [1, -b], x)[-n:]
    return x / (x.std() or 1.0)


MAX_DRIVE_SECONDS = 36000.0  # [s] max duration of a simulation

# fmt: off
MANEUVERS = {
    k.name: k
    for k in (
        Kind("square-waves", 40.0, 20.0, 0.02, "steering, rad",
             "steering square wave of 4 s, front torque square wave of 700 Nm and 5 s (paper IV-A)",
             _make_square_waves),
        Kind("double-lane-change", 48.0, 18.0, 0.03, "steering, rad",
             "accelerate, double lane change, brake; repeated every 12 s (after paper IV-B)",
             _make_double_lane_change),
        Kind("step-steer", 10.0, 20.0, 0.02, "steering, rad",
             "steering step after 1 s at constant speed",
             _make_step_steer),
        Kind("sine-sweep", 40.0, 20.0, 0.02, "steering, rad",
             "steering sine from 0.2 to 3 Hz at constant speed",
             _make_sine_sweep),
        Kind("constant-radius", 60.0, 8.0, 60.0, "radius, m",
             "speed rises slowly up to 4 m/s2 on a circle, steering follows the nominal understeer",
             _make_constant_radius),
        Kind("straight", 120.0, 30.0, 0.001, "sd of the steering, rad",
             "straight highway with small random steering and speed corrections",
             _make_straight),
        Kind("stop-and-go", 80.0, 0.0, 0.03, "steering, rad",
             "accelerate, bend, brake to standstill, wait; repeated every 20 s",
             _make_stop_and_go),
    )
}
# fmt: on


def build(
    name: str,
    config: Config,
    *,
    sample_time: float,
    duration: float | None = None,
    speed: float | None = None,
    amplitude: float | None = None,
    road: list[tuple[float, float]] | None = None,
    seed: int = 1,
) -> Maneuver:
    """Make a manoeuvre of the list MANEUVERS.

    Parameters
    ----------
    name
        Key of MANEUVERS.
    config
        Settings of the car.
    sample_time, duration
        [s] Time between rows, and duration. duration None: the default of the manoeuvre.
    speed
        [m/s] Speed at the start. None: the default of the manoeuvre.
    amplitude
        Kind.amplitude_text states quantity and unit, e.g. "steering, rad". None: the
        default of the manoeuvre.
    road
        Changes of the road surface: a pair (time [s], factor) for each. From this time to
        the next change, all stiffnesses are multiplied by the factor. Before the first
        change, and if `road` is None, the factor is 1.
    seed
        Seed of the random corrections of steering and speed.

    Raises
    ------
    UserError
        The manoeuvre is unknown.
    """
    if name not in MANEUVERS:
        raise UserError(f"there is no manoeuvre '{name}'; known: {', '.join(MANEUVERS)}")
    kind = MANEUVERS[name]
    duration = kind.duration if duration is None else duration
    speed = kind.speed if speed is None else speed
    n = round(duration / sample_time) + 1
    t = np.round(np.arange(n) * sample_time, 9)
    histories = kind.build(
        t, speed, kind.amplitude if amplitude is None else amplitude, config, np.random.default_rng(seed)
    )
    level = np.ones(n)
    for start, value in sorted(road or []):
        level[t >= start - 1e-9] = value
    zero = np.zeros(n)
    return Maneuver(time=t, speed=speed, steer_angle=histories["steer_angle"],
                    wheel_torque_front=histories.get("wheel_torque_front", zero),
                    wheel_torque_rear=histories.get("wheel_torque_rear", zero), road_level=level,
                    target_speed=histories.get("target_speed"))  # fmt: skip
