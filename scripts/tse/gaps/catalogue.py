"""The catalogue of effects. For each parameter of an effect, it has what a fit must know:
limits, typical size, prior.

An effect is a property of the car, a sensor or the road that the simulation can include,
such as roll steer or a delay. The library provides the effects from
src/tables/effects.toml.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass

from tse.library.core import library


@dataclass(frozen=True)
class Own:
    """The key of one value of a road profile: bank or grade at one knot of one log. Knots
    are points along the road, between which the profile is interpolated.

    The key of a parameter of the car is a string, the name of its setting.
    """

    of: str  # id of the road effect: bank or grade
    log: int  # index of the log
    knot: int  # index of the knot along the road

    def __str__(self) -> str:
        return f"{self.of}@{self.log}:{self.knot}"


Key = str | Own


def drop_log_values(values: Mapping[Key, float]) -> dict[Key, float]:
    """Return the values of the car only, without the road profiles of the logs."""
    return {k: v for k, v in values.items() if not isinstance(k, Own)}


@dataclass(frozen=True)
class CatalogueParameter:
    """One parameter that can be fitted: a stiffness, or a parameter of an effect.

    A strength is a parameter that states the size of an effect. If all strengths are 0,
    the effect is off. A shape is any other parameter of an effect, such as a time
    constant. While the effect is off, its shapes have no influence.
    """

    # name of the setting that holds the parameter, or key (class Own) of a value of a
    # road profile
    name: Key
    key: str  # name within the effect, without the id of the effect
    strength: bool  # True for a strength, False for a shape
    unit: str
    # For a strength of an effect, the value without the effect: 0, or the value in the
    # vehicle file if the file states an sd of the parameter (hypotheses.apply_priors())
    default: float
    low: float
    high: float
    typical_low: float
    typical_high: float
    negligible: float  # difference from `default` below which a strength is negligible
    sign: int  # the plausible sign, 1 or -1; 0 if both are plausible
    text: str
    # prior sd. It is stated in the vehicle file, or is KNOT_SD for a value of a road
    # profile. None: no prior
    prior: float | None = None
    # True for a shape (see above) that keeps its setting in fits, because logs cannot
    # distinguish a change of the shape from a change of the strength of the effect
    given: bool = False

    @property
    def scale(self) -> float:
        """Typical size of the parameter: mean of |typical_low| and |typical_high|. If
        both are 0, the larger of |low| and |high|, the limits of the parameter.
        """
        return 0.5 * (abs(self.typical_low) + abs(self.typical_high)) or max(abs(self.low), abs(self.high))

    @property
    def step(self) -> float:
        """Step of finite differences: small relative to the typical size, but large
        relative to rounding errors.
        """
        return 0.02 * self.scale


@dataclass(frozen=True)
class Effect:
    """One effect of the catalogue: a property of the car, a sensor or the road that the
    simulation can include, such as roll steer."""

    id: str
    title: str
    channels: str  # description of the channels in which the effect is visible
    relatives: tuple[str, ...]  # ids of effects that are hard to distinguish from this one
    parameters: tuple[CatalogueParameter, ...]
    # Class that determines the prior probability that a car has the effect, e.g.
    # EVERY_CAR, SOME_CARS or SENSOR (error of a sensor): src/tables/effects.toml
    occurrence: str = "SENSOR"
    # Title that replaces `title` if the fitted strength is below early_below. A strength
    # below this limit does not come from the car, but from a latency of messages or a low
    # pass of the IMU. Empty if every strength of the effect can come from the car.
    early: str = ""
    early_below: float = 0.0

    @property
    def strengths(self) -> tuple[CatalogueParameter, ...]:
        return tuple(p for p in self.parameters if p.strength)

    @property
    def shapes(self) -> tuple[CatalogueParameter, ...]:
        """The shapes that can be fitted: logs can distinguish a change of such a shape
        from a change of the strength. The other shapes keep their settings.
        """
        return tuple(p for p in self.parameters if not p.strength and not p.given)

    @property
    def fitted(self) -> tuple[CatalogueParameter, ...]:
        return (*self.strengths, *self.shapes)


@functools.cache
def load_catalogue() -> dict[str, Effect]:
    """Return the effects that may be missing in a vehicle file, as id -> effect, in the
    order of the library. Effects that are on by default (IN_MODEL) are left out.
    """
    rows = {i: e for i, e in library().effects.items() if e.occurrence != "IN_MODEL"}
    return {
        e.id: Effect(
            e.id,
            e.title,
            e.channels,
            tuple(x for x in e.look_alikes if x in rows),
            tuple(
                CatalogueParameter(
                    p.setting,
                    p.name,
                    p.strength,
                    p.unit,
                    p.default,
                    p.low,
                    p.high,
                    *p.typical,
                    p.negligible,
                    p.sign,
                    p.text,
                    given=p.given,
                )
                for p in e.parameters
            ),
            e.occurrence,
            e.early,
            e.early_below,
        )
        for e in rows.values()
    }


@functools.cache
def list_signed_delays() -> frozenset[str]:
    """Return the names of the settings of delays that a fit may make negative.

    A negative delay of the steering or of the IMU means that the other channels are
    logged late relative to the channels of the steering or the IMU.
    """
    return frozenset(
        p.name for e in load_catalogue().values() if e.early for p in e.strengths if e.early_below <= p.low
    )
