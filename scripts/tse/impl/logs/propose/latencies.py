"""How late each channel is behind the gyro."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tse.impl.logs import physics
from tse.impl.logs.physics import MOVING, mean_of
from tse.impl.logs.propose.look import AXLES, Guess, Look
from tse.impl.logs.propose.scales import Scale

LEAST_LATENCY = 0.004  # s
# s, by which a car turns behind its wheels in slow steering: single-track models of understeering passenger cars
# with relaxation, drawn, at 10 .. 35 m/s
YAW_LAG, YAW_LAG_SD = 0.10, 0.043
STEER_SURE = 2.0  # sd from which a latency of the steering is proposed
LATEST = 0.4  # s
FOUND = 4.0  # sd by which a latency is not 0


def find_latencies(
    look: Look, found: dict[str, Guess], wheels: Mapping[str, str], scale: Scale, sign: Mapping[str, float],
    warnings: list[str],
) -> None:  # fmt: skip
    """How much later than the gyro wheels and accelerometers are logged, and the steering, where it is more than cars differ by."""
    if "yaw_rate" not in found:
        return
    clock = found["yaw_rate"].name[0]
    r = look.x[clock] * scale.per["yaw_rate"] * sign["yaw_rate"]
    keep = np.isfinite(r)
    if "rear_left" in wheels:
        difference = (look.x[wheels["rear_right"]] - look.x[wheels["rear_left"]]) * scale.per["wheel"]
        v = mean_of([look.x[n] for n in wheels.values()]) * scale.per["wheel"]
        late, sd = physics.lag(r, difference, keep & (v > MOVING))
        for axle in AXLES:
            _late(look, found.get(f"wheel_speed_{axle}"), clock, late, sd, "right less left wheels against the gyro")
    if "steer_angle" in found and wheels:
        v = mean_of([look.x[n] for n in wheels.values()]) * scale.per["wheel"]
        _late_steering(look, found["steer_angle"], v, r, keep & (v > MOVING), warnings)
    if "accel_y" in found and wheels:
        v = mean_of([look.x[n] for n in wheels.values()]) * scale.per["wheel"]
        slope = physics.derivative(r)
        # the body's own way of following, (c0 + c2 v^2) r', is no latency
        late, sd = _lag_of_accel(look, found["accel_y"], v, r, slope, scale, sign, keep)
        _late(look, found["accel_y"], clock, late, sd, "a_y against v r, the body's own part taken out")


def _late_steering(
    look: Look, guess: Guess, v: np.ndarray, r: np.ndarray, keep: np.ndarray, warnings: list[str]
) -> None:
    """A car turns YAW_LAG after its wheels are turned. Where the yaw rate follows sooner, or comes before the angle, which no car
    does, the angle is late. What is less than cars differ by shows only in a fit of the whole car: calibrate."""
    steered = v * look.x[guess.name[0]] / (1.0 + physics.UNDERSTEER * v**2)
    follows, sd = physics.lag(steered, r, keep)
    late, sd = YAW_LAG - follows, float(np.hypot(sd, YAW_LAG_SD))
    if not np.isfinite(sd) or sd > 2 * YAW_LAG_SD or not STEER_SURE * sd < late < LATEST:
        return
    guess.latency = round(late, 3)
    guess.figures.append(f"{1e3 * late:.0f} ms (sd {1e3 * sd:.0f}) late: the yaw rate is {1e3 * follows:.0f} ms behind it, usual "
                         f"are {1e3 * YAW_LAG:.0f}; tselab calibrate finds it better")  # fmt: skip
    warnings.append(f"steer_angle is logged about {1e3 * late:.0f} ms late, which is proposed as its latency: without it the "
                    "estimates would be of another car")  # fmt: skip


def _lag_of_accel(
    look: Look,
    g: Guess,
    v: np.ndarray,
    r: np.ndarray,
    slope: np.ndarray,
    scale: Scale,
    sign: Mapping[str, float],
    keep: np.ndarray,
) -> tuple[float, float]:
    y = look.x[g.name[0]] * scale.per["accel_y"] * sign["accel_y"]
    return physics.lag(v * r, y, keep & (v > MOVING), (slope, v**2 * slope))


def _late(look: Look, guess: Guess | None, clock: str, late: float, sd: float, how: str) -> None:
    if guess is None or not np.isfinite(sd):
        return
    together = look.channels[guess.name[0]].time is look.channels[clock].time
    if abs(late) > max(LEAST_LATENCY, FOUND * sd) and abs(late) < 0.3 and sd < 0.02:
        guess.figures.append(f"{1e3 * late:.0f} ms (sd {1e3 * sd:.0f}) behind the yaw rate: {how}")
        if not together or abs(late) > 2 * LEAST_LATENCY:
            guess.latency = round(late, 4)
