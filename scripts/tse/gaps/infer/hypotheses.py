"""What may be missing, and how likely that is before any log: the catalogue with its typical sizes, and how late messages are.

A size that no car has is paid for, as is one too small to matter.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tse.car.vehicle import Vehicle
from tse.gaps.catalogue import Effect, Parameter, catalogue, signed_delays
from tse.identify import unknowns
from tse.identify.unknowns import SUPERELEVATION

# Not searched, by their column `occurrence`. ROAD: profiles of the road have a search of their own (infer/roads.py),
# and a road that leans or climbs all along is a bias. ABSORBED: a stiffness takes the effect up, altogether or but for
# a twentieth (aligning_moment, on the logs of two generators); the forms of tyres are known no better. What slows the
# car is among them: wheel speeds drive the model, and in accel_x the rest of it looks like any road.
NOT_SEARCHED = ("ROAD", "ABSORBED")
EXPECTED = 1.0  # how many of all other effects a car lacks before anybody has looked
SENSOR_SHARE = 0.1  # of cars, that a given sensor error is there
EVERY_SHARE = 0.15  # that what every car has is large enough to matter, and not in the file
WRONG_SIGN = 0.01  # probability that an effect has the sign that its physics does not
SMALLER_SD = 0.7  # ln: below the typical range: half and less is as good as nothing
LARGER_SD = 0.35  # ln: above the typical range: twice has hardly a car
SWITCH_SD = 0.15  # ln: of what is there or not
NAME_AT = 0.9  # probability from which an effect gets a name: of 10 such names less than one is wrong
SIZE_COST = 3.0  # nats: of a size that logs know to a percent of what is typical
MOST_LATE = 0.1  # s: of a message behind or before another one
# s: typical lateness of a message behind another one: bus cycles of 5 .. 20 ms, filters of 10 .. 30 Hz
LATE = (0.003, 0.02)
UNCERTAIN = unknowns.UNCERTAIN | {
    "mass_sd": "mass_change", "yaw_inertia_sd": "yaw_inertia_change", "roll_steer_sd": "rear_roll_steer_gain",
}  # fmt: skip
OTHER_SD = 1.0  # typical sizes: sd of the strengths besides the largest one of an effect


def _late(name: str, title: str, channels: str) -> Effect:
    text = "values are so much older than their row says"
    parameter = Parameter(name, name, True, "s", 0.0, -MOST_LATE, MOST_LATE, *LATE, LATE[0], 0, text)
    return Effect(name, title, channels, (), (parameter,))


def latencies() -> tuple[Effect, ...]:
    """How late messages are, in the form of effects."""
    return (
        _late("wheel_speed_latency", "wheel speeds late", "accel_x"),
        _late("accel_x_latency", "accel_x late behind the gyro", "accel_x"),
        _late("accel_y_latency", "accel_y late behind the gyro", "accel_y"),
    )


def lean() -> Effect:
    """Return what the bank of the road in its curves does, one number, as an effect of its own: left out it passes for a scale of
    accel_y. The profile of the road is another."""
    bank = catalogue()["bank"]
    only = tuple(p for p in bank.parameters if p.key == SUPERELEVATION)
    return Effect(
        SUPERELEVATION,
        "road that leans into its curves",
        "accel_y, yaw_rate",
        ("imu_scale_ay", "body_roll"),
        only,
    )


@dataclass(frozen=True)
class Hypothesis:
    """An effect that may be missing. `odds`: ln of the prior odds that it is."""

    effect: Effect
    odds: float

    @property
    def id(self) -> str:
        return self.effect.id

    def ln_prior(self, values: Mapping[str, float]) -> float:
        """ln density of the strengths, per unit of each: what a size costs."""
        strengths = self.effect.strengths
        if strengths[0].prior:
            return sum(ln_normal(values[p.name], *fit_prior(p)) for p in strengths)
        away = {p.name: values[p.name] - p.default for p in strengths}
        first = max(strengths, key=lambda p: abs(away[p.name]) / p.scale)
        total = 0.0
        for p in strengths:
            total += (
                ln_size(p, away[p.name])
                if p is first
                else -0.5 * (away[p.name] / (OTHER_SD * p.scale)) ** 2
                - math.log(OTHER_SD * p.scale * math.sqrt(2 * math.pi))
            )
        return total - math.log(len(strengths))


def ln_size(p: Parameter, away: float) -> float:
    """ln density of a strength that is `away` from its default: ln of its size is even over the typical range, normal beyond."""
    low, high = sorted((abs(p.typical_low - p.default), abs(p.typical_high - p.default)))
    low = low or 0.25 * high
    smaller = SMALLER_SD if high > low else SWITCH_SD
    size = max(abs(away), 1e-6 * high)
    z = math.log(low / size) / smaller if size < low else max(0.0, math.log(size / high)) / LARGER_SD
    width = math.log(high / low) + math.sqrt(0.5 * math.pi) * (smaller + LARGER_SD)
    plausible = 0.5 if p.sign == 0 else (1 - WRONG_SIGN if p.sign * away > 0 else WRONG_SIGN)
    return -0.5 * z * z - math.log(size * width) + math.log(plausible)


def known_of(vehicle: Vehicle) -> list[Effect]:
    """Return the catalogue; where the vehicle file has an sd of a number in [uncertainty], that is the prior of its size, about the
    file's. With sds of 0 throughout, as of a simulator's car, there is none."""
    sd = {name: vehicle.values[key] for key, name in UNCERTAIN.items() if key in vehicle.given_uncertainty}
    if not any(sd.values()):
        return list(catalogue().values())

    def with_prior(p: Parameter) -> Parameter:
        if p.name not in sd:
            return p
        return replace(
            p, default=vehicle.values.get(p.name, p.default), prior=max(sd[p.name], 0.01 * p.scale)
        )

    return [replace(e, parameters=tuple(map(with_prior, e.parameters))) for e in catalogue().values()]


def hypotheses(effects: Iterable[Effect] | None = None) -> list[Hypothesis]:
    """All that is asked, in the order of the catalogue."""
    known = list(catalogue().values() if effects is None else effects)
    searched = [e for e in known if e.occurrence not in NOT_SEARCHED]
    physics = [e for e in searched if e.occurrence == "SOME_CARS"]
    share = EXPECTED / max(len(physics), 2)  # the only effect of a list may be absent, too
    shares = {"SENSOR": SENSOR_SHARE, "EVERY_CAR": EVERY_SHARE, "SOME_CARS": share}
    found = []
    for e in (*searched, *latencies(), lean()):
        if any(p.name in signed_delays() for p in e.parameters):
            e = replace(
                e, parameters=tuple(replace(p, low=-MOST_LATE, high=MOST_LATE, sign=0) for p in e.parameters)
            )
        p = shares[e.occurrence]
        found.append(Hypothesis(e, math.log(p / (1 - p))))
    return found


def threshold(effects: int) -> float:
    """Nats of likelihood that a name of one of so many effects needs: the prior odds against it, the odds that are asked for, and
    what its size costs."""
    return math.log(max(effects, 2) / EXPECTED - 1.0) + math.log(NAME_AT / (1.0 - NAME_AT)) + SIZE_COST


def fit_prior(p: Parameter) -> tuple[float, float]:
    """Mean and sd of the normal that a fit takes for a parameter: what is known of it; else wide for a strength (its size is judged
    after), the typical range for a shape."""
    if p.prior:
        return p.default, p.prior
    if p.strength:
        return p.default, 2.0 * max(abs(p.typical_low - p.default), abs(p.typical_high - p.default), p.scale)
    low, high = p.typical_low, p.typical_high
    return 0.5 * (low + high), max(0.5 * (high - low), 1e-3 * (p.high - p.low))


def ln_normal(x: float, mean: float, sd: float) -> float:
    return -0.5 * ((x - mean) / sd) ** 2 - math.log(sd * math.sqrt(2 * math.pi))


def start_of(p: Parameter) -> float:
    """Where a search begins: a third of a typical size, the middle of a shape."""
    if not p.strength:
        return fit_prior(p)[0]
    return float(np.clip(p.default + 0.3 * (p.sign or 1) * p.scale, p.low, p.high))
