"""The catalogue of effects (src/tables/effects.toml, through the library) in the form
that fits take.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass

from tse.library.core import library


@dataclass(frozen=True)
class Own:
    """Key of one value of the profile of a log's road.

    The key of a number of the car is its setting.
    """

    of: str  # an effect of the road
    log: int
    knot: int  # which of its values

    def __str__(self) -> str:
        return f"{self.of}@{self.log}:{self.knot}"


Key = str | Own


def drop_log_values(values: Mapping[Key, float]) -> dict[Key, float]:
    """Return the fitted values of the car, without those of one log."""
    return {k: v for k, v in values.items() if not isinstance(k, Own)}


@dataclass(frozen=True)
class CatalogueParameter:
    """One number that is fitted: a stiffness, or a parameter of an effect."""

    name: Key  # its setting, or a value of one log
    key: str  # within its effect
    strength: bool  # else a shape
    unit: str
    default: float
    low: float
    high: float
    typical_low: float
    typical_high: float
    negligible: float
    sign: int  # 1, -1: the plausible one; 0: either
    text: str
    # sd before the fit: of the vehicle file, or of a value of a profile
    prior: float | None = None
    given: bool = False  # a shape that no log tells from the strength

    @property
    def scale(self) -> float:
        """Typical size."""
        return 0.5 * (abs(self.typical_low) + abs(self.typical_high)) or max(abs(self.low), abs(self.high))

    @property
    def step(self) -> float:
        """Step of finite differences: small against the typical size, large against
        rounding.
        """
        return 0.02 * self.scale


@dataclass(frozen=True)
class Effect:
    """One row of the catalogue and its parameters."""

    id: str
    title: str
    channels: str
    relatives: tuple[str, ...]  # ids of its look-alikes in the catalogue
    parameters: tuple[CatalogueParameter, ...]
    # how often cars have it: the column of src/tables/effects.toml
    occurrence: str = "SENSOR"
    # title of a value below early_below, which is of messages or the IMU; "": none
    early: str = ""
    early_below: float = 0.0

    @property
    def strengths(self) -> tuple[CatalogueParameter, ...]:
        return tuple(p for p in self.parameters if p.strength)

    @property
    def shapes(self) -> tuple[CatalogueParameter, ...]:
        """Shapes that a log can tell from the strength.

        The others keep their settings.
        """
        return tuple(p for p in self.parameters if not p.strength and not p.given)

    @property
    def fitted(self) -> tuple[CatalogueParameter, ...]:
        return (*self.strengths, *self.shapes)


@functools.cache
def load_catalogue() -> dict[str, Effect]:
    """Return the effects that a vehicle file may lack by their ids, in the library's
    order.
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
    """Return the settings of delays that a fit may make negative: a negative delay is an
    early message.
    """
    return frozenset(
        p.name for e in load_catalogue().values() if e.early for p in e.strengths if e.early_below <= p.low
    )
