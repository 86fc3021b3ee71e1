"""Hypotheses of `tselab gap` and their prior: effects and latencies that a vehicle file
may lack.

The prior of a size is even over the typical range and normal beyond it, so that a size no
car has costs evidence, as does one too small to matter.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tse.car.vehicle import Vehicle
from tse.gaps.catalogue import CatalogueParameter, Effect, list_signed_delays, load_catalogue
from tse.identify import unknowns
from tse.identify.unknowns import SUPERELEVATION

# Values of the column `occurrence` that are not searched.
# ROAD: profiles of the road have a search of their own (infer/roads.py). A road that
# leans or climbs all along is a bias.
# ABSORBED: a stiffness takes the effect up, altogether or but for a twentieth
# (aligning_moment, on the logs of two generators). The forms of tyres are known no
# better. Drag and rolling resistance are among them: wheel speeds drive the model, and in
# accel_x the rest of either looks like a road.
NOT_SEARCHED = ("ROAD", "ABSORBED")
EXPECTED = 1.0  # prior mean of the number of SOME_CARS effects that a vehicle file lacks
SENSOR_SHARE = 0.1  # prior probability of one sensor error
# prior probability that an EVERY_CAR effect matters and is not in the file
EVERY_SHARE = 0.15
WRONG_SIGN = 0.01  # prior probability of a sign against the physics of an effect
SMALLER_SD = 0.7  # ln: sd of sizes below the typical range; half of it hardly matters
LARGER_SD = 0.35  # ln: sd of sizes above the typical range; hardly a car has twice of it
# ln: the same where the typical range is one value: an effect that is there or not
SWITCH_SD = 0.15
# min probability of a named effect: less than one of 10 such names is wrong
NAME_AT = 0.9
SIZE_COST = 3.0  # nats: cost of a size that the logs show to a percent of the typical one
MAX_LATE = 0.1  # s: max latency of a message behind or before another one
# s: typical latency of a message behind another one: bus cycles of 5 .. 20 ms, filters of
# 10 .. 30 Hz
LATE = (0.003, 0.02)
UNCERTAIN = unknowns.UNCERTAIN_SETTINGS | {
    "mass_sd": "mass_change",
    "yaw_inertia_sd": "yaw_inertia_change",
    "roll_steer_sd": "rear_roll_steer_gain",
}
OTHER_SD = 1.0  # typical sizes: sd of the strengths besides the largest one of an effect


def make_latency(name: str, title: str, channels: str) -> Effect:
    """Make the latency of messages an effect with one strength, in s."""
    text = "age of the values at the time of their row"
    parameter = CatalogueParameter(name, name, True, "s", 0.0, -MAX_LATE, MAX_LATE, *LATE, LATE[0], 0, text)
    return Effect(name, title, channels, (), (parameter,))


def make_latencies() -> tuple[Effect, ...]:
    """Return the latencies of messages as effects."""
    return (
        make_latency("wheel_speed_latency", "wheel speeds late", "accel_x"),
        make_latency("accel_x_latency", "accel_x late behind the gyro", "accel_x"),
        make_latency("accel_y_latency", "accel_y late behind the gyro", "accel_y"),
    )


def make_superelevation() -> Effect:
    """Return the superelevation of the road in its curves as an effect of its own.

    It is one number, beside the profile of the road. Left out, it looks like a scale of
    accel_y.
    """
    bank = load_catalogue()["bank"]
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
    """An effect that the vehicle file may lack."""

    effect: Effect
    odds: float  # ln of the prior odds that it does

    @property
    def id(self) -> str:
        return self.effect.id

    def ln_prior(self, values: Mapping[str, float]) -> float:
        """Return ln of the prior density of the strengths, per unit of each."""
        strengths = self.effect.strengths
        if strengths[0].prior:
            return sum(compute_ln_normal(values[p.name], *fit_prior(p)) for p in strengths)
        away = {p.name: values[p.name] - p.default for p in strengths}
        first = max(strengths, key=lambda p: abs(away[p.name]) / p.scale)
        total = 0.0
        for p in strengths:
            total += (
                compute_ln_size_prior(p, away[p.name])
                if p is first
                else -0.5 * (away[p.name] / (OTHER_SD * p.scale)) ** 2
                - math.log(OTHER_SD * p.scale * math.sqrt(2 * math.pi))
            )
        return total - math.log(len(strengths))


def compute_ln_size_prior(p: CatalogueParameter, away: float) -> float:
    """Return ln of the prior density of a strength that is `away` from its default.

    ln of its size is even over the typical range and normal beyond.
    """
    low, high = sorted((abs(p.typical_low - p.default), abs(p.typical_high - p.default)))
    low = low or 0.25 * high
    smaller = SMALLER_SD if high > low else SWITCH_SD
    size = max(abs(away), 1e-6 * high)
    z = math.log(low / size) / smaller if size < low else max(0.0, math.log(size / high)) / LARGER_SD
    width = math.log(high / low) + math.sqrt(0.5 * math.pi) * (smaller + LARGER_SD)
    plausible = 0.5 if p.sign == 0 else (1 - WRONG_SIGN if p.sign * away > 0 else WRONG_SIGN)
    return -0.5 * z * z - math.log(size * width) + math.log(plausible)


def apply_priors(vehicle: Vehicle) -> list[Effect]:
    """Return the catalogue with the priors of a vehicle file.

    Where [uncertainty] states the sd of a number, that is the prior of its size, about
    the file's value. If all of its sds are 0, as those of a simulator's car, there is no
    such prior.
    """
    sd = {name: vehicle.values[key] for key, name in UNCERTAIN.items() if key in vehicle.given_uncertainty}
    if not any(sd.values()):
        return list(load_catalogue().values())

    def with_prior(p: CatalogueParameter) -> CatalogueParameter:
        if p.name not in sd:
            return p
        return replace(
            p, default=vehicle.values.get(p.name, p.default), prior=max(sd[p.name], 0.01 * p.scale)
        )

    return [replace(e, parameters=tuple(map(with_prior, e.parameters))) for e in load_catalogue().values()]


def make_hypotheses(effects: Iterable[Effect] | None = None) -> list[Hypothesis]:
    """Return all hypotheses: effects in the order of the catalogue, then latencies and
    superelevation.
    """
    known = list(load_catalogue().values() if effects is None else effects)
    searched = [e for e in known if e.occurrence not in NOT_SEARCHED]
    physics = [e for e in searched if e.occurrence == "SOME_CARS"]
    # the only effect of a list may be absent, too
    share = EXPECTED / max(len(physics), 2)
    shares = {"SENSOR": SENSOR_SHARE, "EVERY_CAR": EVERY_SHARE, "SOME_CARS": share}
    found = []
    for e in (*searched, *make_latencies(), make_superelevation()):
        if any(p.name in list_signed_delays() for p in e.parameters):
            e = replace(
                e, parameters=tuple(replace(p, low=-MAX_LATE, high=MAX_LATE, sign=0) for p in e.parameters)
            )
        p = shares[e.occurrence]
        found.append(Hypothesis(e, math.log(p / (1 - p))))
    return found


def compute_threshold(effects: int) -> float:
    """Return the likelihood ratio, in nats, that a name among so many effects needs.

    It makes up for the prior odds against the effect, the odds of NAME_AT and the cost of
    the size.
    """
    return math.log(max(effects, 2) / EXPECTED - 1.0) + math.log(NAME_AT / (1.0 - NAME_AT)) + SIZE_COST


def fit_prior(p: CatalogueParameter) -> tuple[float, float]:
    """Return mean and sd of the normal prior of a parameter in a fit.

    It is the prior of the vehicle file, if there is one. Else it is wide for a strength,
    whose size is judged later, and the typical range for a shape.
    """
    if p.prior:
        return p.default, p.prior
    if p.strength:
        return p.default, 2.0 * max(abs(p.typical_low - p.default), abs(p.typical_high - p.default), p.scale)
    low, high = p.typical_low, p.typical_high
    return 0.5 * (low + high), max(0.5 * (high - low), 1e-3 * (p.high - p.low))


def compute_ln_normal(x: float, mean: float, sd: float) -> float:
    """Return ln of the normal density."""
    return -0.5 * ((x - mean) / sd) ** 2 - math.log(sd * math.sqrt(2 * math.pi))


def choose_start(p: CatalogueParameter) -> float:
    """Return the start of a search: 0.3 of the typical size of a strength, the middle of
    a shape.
    """
    if not p.strength:
        return fit_prior(p)[0]
    return float(np.clip(p.default + 0.3 * (p.sign or 1) * p.scale, p.low, p.high))
