"""The hypotheses of `tselab gap` and their priors: effects and latencies that a vehicle
file may lack.

The prior density of ln(size of an effect) is constant over the typical range and falls
like a normal density on both sides of it. So the evidence for an effect becomes smaller
if its size is too small to matter or too large for a car.
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

# Effects with one of these values in the column `occurrence` of src/tables/effects.toml
# are not searched for:
#
# - ROAD: infer/roads.py estimates road profiles. A constant bank or grade cannot be
#   distinguished from a sensor bias.
# - ABSORBED: the fitted stiffness compensates for at least 95 % of the effect. The rest
#   cannot be distinguished from errors of tyre models, which are also about 5 % (measured
#   for aligning_moment, in logs of two simulators). Drag and rolling resistance are
#   ABSORBED for a different reason: they hardly change the speed, which the model takes
#   from the wheel speeds, and in accel_x they look like a grade.
NOT_SEARCHED = ("ROAD", "ABSORBED")
# prior mean of the number of effects that a vehicle file lacks, counting only those with
# the occurrence SOME_CARS
EXPECTED = 1.0
SENSOR_SHARE = 0.1  # prior probability of each sensor error
# prior probability that an effect with the occurrence EVERY_CAR is large enough to matter
# and is missing in the vehicle file
EVERY_SHARE = 0.15
WRONG_SIGN = 0.01  # prior probability of a sign that contradicts the physics of an effect
# prior sd of ln(size) below the typical range. 0.7 is ln 2: an effect of half the
# smallest typical size, which hardly matters, is 1 sd below the range.
SMALLER_SD = 0.7
# prior sd of ln(size) above the typical range. 0.35 is (ln 2) / 2: an effect of twice the
# largest typical size, which hardly any car has, is 2 sd above the range.
LARGER_SD = 0.35
# prior sd of ln(size) below the typical range if this range is a single value. It is
# small, because a car either has such an effect in full or does not have it.
SWITCH_SD = 0.15
# An effect is named, i.e. reported as missing in the vehicle file, if the effect or one
# that explains the logs in its place is missing with at least this probability. So at
# most one in 10 reports is wrong.
NAME_AT = 0.9
# [nat] Reduction of the evidence for an effect, because its size is not known in advance
# but must be fitted. The value holds if the posterior sd of the size is about 1 % of the
# typical size.
SIZE_COST = 3.0
MAX_LATE = 0.1  # [s] max delay of a message relative to other messages, with either sign
# [s] typical delay of a message relative to other messages: bus cycles of 5 .. 20 ms,
# filters of 10 .. 30 Hz
LATE = (0.003, 0.02)
# setting of [uncertainty] in a vehicle file -> parameter whose prior sd it states
UNCERTAIN = unknowns.UNCERTAIN_SETTINGS | {
    "mass_sd": "mass_change",
    "yaw_inertia_sd": "yaw_inertia_change",
    "roll_steer_sd": "rear_roll_steer_gain",
}
# An effect may have several strengths, i.e. parameters that state its size. OTHER_SD is
# the prior sd of each strength, in units of its typical size. Only the strength that is
# largest in these units has a different prior (Hypothesis.compute_ln_prior()).
OTHER_SD = 1.0


def make_latency(name: str, title: str, channels: str) -> Effect:
    """Return an effect whose only strength is a latency [s] with the name `name`.
    `channels` are the channels in which this latency is visible.
    """
    text = "time from the measurement of a value to the time of its row"
    parameter = CatalogueParameter(name, name, True, "s", 0.0, -MAX_LATE, MAX_LATE, *LATE, LATE[0], 0, text)
    return Effect(name, title, channels, (), (parameter,))


def make_latencies() -> tuple[Effect, ...]:
    """Return the latencies of the channels as effects."""
    return (
        make_latency("wheel_speed_latency", "wheel speeds logged late", "accel_x"),
        make_latency("accel_x_latency", "accel_x logged later than the gyro", "accel_x"),
        make_latency("accel_y_latency", "accel_y logged later than the gyro", "accel_y"),
    )


def make_superelevation() -> Effect:
    """Return the superelevation of the road in its curves as an effect.

    Superelevation is one number: the share of the lateral acceleration in a curve that
    the bank of the road provides. So the bank from superelevation is proportional to the
    lateral acceleration. The bank of the road profile is added to it. A model without
    superelevation would explain the proportional bank by a scale error of accel_y.
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
    """The hypothesis that the vehicle file lacks an effect."""

    effect: Effect
    odds: float  # ln of the prior odds of the hypothesis

    @property
    def id(self) -> str:
        return self.effect.id

    def compute_ln_prior(self, values: Mapping[str, float]) -> float:
        """Return ln of the joint prior density of the effect's strengths at `values`.

        If the vehicle file states an sd for the effect, all strengths have the normal
        priors of fit_prior(). Otherwise, the strength that is largest relative to its
        typical size has the prior of compute_ln_size_prior(). The others have normal
        priors with the sd OTHER_SD times their typical size. Every strength is the
        largest with the same prior probability.
        """
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
    """Return ln of the prior density of a strength `p` at the value default + `away`.

    ln |away| is uniform over the typical range and has normal tails on both sides. The
    sign of `away` is implausible with probability WRONG_SIGN.
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
    """Return the effects of the catalogue with the priors that a vehicle file states.

    If the section [uncertainty] states the sd of a parameter, the prior of this parameter
    is normal. Its mean is the value in the vehicle file. Its sd is the stated sd, but at
    least 1 % of the typical size. If all stated sds are 0, as for a simulated car, the
    effects are returned unchanged.
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
    """Return all hypotheses: first the effects of the catalogue in their order, without
    those of NOT_SEARCHED, then the latencies and the superelevation.

    `effects` replaces the effects of the catalogue; None: the catalogue is used.
    """
    known = list(load_catalogue().values() if effects is None else effects)
    searched = [e for e in known if e.occurrence not in NOT_SEARCHED]
    physics = [e for e in searched if e.occurrence == "SOME_CARS"]
    # Divide by at least 2. If the list has only one effect, the prior probability of this
    # effect would otherwise be 1, and its odds infinite.
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
    """Return the log likelihood ratio [nat] that an effect needs to be named as missing.

    `effects` is the number of candidates: effects that the model may lack. The prior mean
    of the number of missing effects is EXPECTED, so each candidate is missing with the
    prior probability EXPECTED / effects. The returned ratio is the sum of three terms: ln
    of the prior odds against the effect; ln of the odds of the probability NAME_AT; and
    SIZE_COST, the evidence that is lost because the size of the effect must be fitted.
    """
    return math.log(max(effects, 2) / EXPECTED - 1.0) + math.log(NAME_AT / (1.0 - NAME_AT)) + SIZE_COST


def fit_prior(p: CatalogueParameter) -> tuple[float, float]:
    """Return mean and sd of the normal prior that a parameter has in a fit.

    - A prior that the vehicle file states is used as it is.
    - A strength (the size of an effect) otherwise has a wide prior. After the fit,
      search.compute_ln_size_odds() replaces it by the prior of plausible sizes.
    - A shape (any other parameter) has as mean the middle of its typical range, and as sd
      half the width of this range.
    """
    if p.prior:
        return p.default, p.prior
    if p.strength:
        return p.default, 2.0 * max(abs(p.typical_low - p.default), abs(p.typical_high - p.default), p.scale)
    low, high = p.typical_low, p.typical_high
    return 0.5 * (low + high), max(0.5 * (high - low), 1e-3 * (p.high - p.low))


def compute_ln_normal(x: float, mean: float, sd: float) -> float:
    """Return ln of the normal density at x."""
    return -0.5 * ((x - mean) / sd) ** 2 - math.log(sd * math.sqrt(2 * math.pi))


def choose_start(p: CatalogueParameter) -> float:
    """Return the value at which the fit of a parameter starts. For a strength, it is the
    default plus 0.3 times the typical size with the plausible sign (plus if both signs
    are plausible). For a shape, it is the prior mean (fit_prior()).
    """
    if not p.strength:
        return fit_prior(p)[0]
    return float(np.clip(p.default + 0.3 * (p.sign or 1) * p.scale, p.low, p.high))
