"""The catalogue of effects, as the library tells it (tse/effects.def through tse_describe)."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from tselab.core import effects as library_effects


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect, or a stiffness."""

    name: str  # of the setting
    role: str  # STRENGTH, SHAPE, STIFFNESS
    unit: str
    default: float
    low: float
    high: float
    typical_low: float
    typical_high: float
    negligible: float
    sign: int  # 1, -1: the plausible one; 0: either
    text: str

    @property
    def is_strength(self) -> bool:
        return self.role != "SHAPE"

    @property
    def scale(self) -> float:
        """A typical size."""
        return 0.5 * (abs(self.typical_low) + abs(self.typical_high)) or max(abs(self.low), abs(self.high))

    @property
    def step(self) -> float:
        """For finite differences."""
        return 0.02 * self.scale


@dataclass(frozen=True)
class Effect:
    """One row of the catalogue and its parameters."""

    id: str
    hook: str
    title: str
    entry: str
    channels: str
    alike: str
    estimator: str
    parameters: tuple[Parameter, ...]

    @property
    def strengths(self) -> tuple[Parameter, ...]:
        return tuple(p for p in self.parameters if p.is_strength)

    @property
    def shapes(self) -> tuple[Parameter, ...]:
        return tuple(p for p in self.parameters if not p.is_strength)

    @property
    def relatives(self) -> tuple[str, ...]:
        """What the catalogue says looks alike."""
        return tuple(x.strip() for x in self.alike.split(",") if x.strip())


@functools.cache
def catalogue() -> dict[str, Effect]:
    """Every effect by its id, in the library's order."""
    found = {}
    for row in library_effects():
        parameters = tuple(Parameter(**p) for p in row.pop("parameters"))
        found[row["id"]] = Effect(parameters=parameters, **row)
    return found
