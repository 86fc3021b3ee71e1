"""The catalogue of effects in the form that fits use. The library provides
it from src/tables/effects.toml.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass

from tse.library.core import library


@dataclass(frozen=True)
class Own:
    """The key of one value of the road profile under one log.

    Parameters of the car have the name of their setting as key instead.
    """

    of: str  # id of the road effect: bank or grade
    log: int  # index of the log
    knot: int  # index of the value along the profile

    def __str__(self) -> str:
        return f"{self.of}@{self.log}:{self.knot}"


Key = str | Own


def drop_log_values(values: Mapping[Key, float]) -> dict[Key, float]:
    """Return the fitted values without those of a single log (road profiles)."""
    return {k: v for k, v in values.items() if not isinstance(k, Own)}


@dataclass(frozen=True)
class CatalogueParameter:
    """One parameter that is fitted: a stiffness, or a parameter of an effect.

    A strength says how large an effect is, and 0 (or the default) switches it off. A
    shape is any other parameter of the effect, such as a time constant.
    """

    name: Key  # its setting, or the key of a value of a road profile
    key: str  # its name within the effect
    strength: bool  # True for a strength, False for a shape
    unit: str
    default: float
    low: float
    high: float
    typical_low: float
    typical_high: float
    negligible: float
    sign: int  # the plausible sign, 1 or -1; 0 if both are plausible
    text: str
    # prior sd, from the vehicle file or of a value of a road profile; None: no prior
    prior: float | None = None
    given: bool = False  # True for a shape that no log can distinguish from the strength; it is not fitted

    @property
    def scale(self) -> float:
        """The typical size: mean of the absolute ends of the typical range."""
        return 0.5 * (abs(self.typical_low) + abs(self.typical_high)) or max(abs(self.low), abs(self.high))

    @property
    def step(self) -> float:
        """The step of finite differences, which is small relative to the typical size and
        large relative to rounding errors.
        """
        return 0.02 * self.scale


@dataclass(frozen=True)
class Effect:
    """One effect of the catalogue and its parameters."""

    id: str
    title: str
    channels: str  # the channels in which it is visible, as text
    relatives: tuple[str, ...]  # ids of the effects of the catalogue that look similar
    parameters: tuple[CatalogueParameter, ...]
    # how often cars have it: column `occurrence` of src/tables/effects.toml
    occurrence: str = "SENSOR"
    # Title of the effect if its strength is below early_below. Such a value is an error
    # of messages or of the IMU. Empty if the effect has no such range.
    early: str = ""
    early_below: float = 0.0

    @property
    def strengths(self) -> tuple[CatalogueParameter, ...]:
        return tuple(p for p in self.parameters if p.strength)

    @property
    def shapes(self) -> tuple[CatalogueParameter, ...]:
        """The shapes that a log can distinguish from the strength. Other shapes are not
        fitted and keep their settings.
        """
        return tuple(p for p in self.parameters if not p.strength and not p.given)

    @property
    def fitted(self) -> tuple[CatalogueParameter, ...]:
        return (*self.strengths, *self.shapes)


@functools.cache
def load_catalogue() -> dict[str, Effect]:
    """Return the effects that a vehicle file may lack, as id -> effect, in the library's
    order. Effects that are always part of the model are left out.
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
    """Return the settings of delays that a fit may make negative. A negative delay means
    that messages of the channel are logged too early.
    """
    return frozenset(
        p.name for e in load_catalogue().values() if e.early for p in e.strengths if e.early_below <= p.low
    )
