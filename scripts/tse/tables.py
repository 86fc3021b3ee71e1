"""Tables of the library: settings, channels, estimates, codes, effects, manoeuvres and
parts of a formula."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tse.estimation.verdict import NAMES
from tse.library.core import CONFIG, SIM_CONFIG, SIM_INPUT, Config, SimConfig, library
from tse.report.results import write_rows
from tse.report.tables import (
    codes_table,
    est_columns_table,
    example_vehicle,
    log_columns_table,
    settings_table,
    sim_settings_table,
    simulated_vehicle,
    text_table,
)
from tse.simulation.maneuvers import MANEUVERS, MAX_DRIVE_SECONDS

__all__ = [
    "MAX_DURATION",
    "STIFFNESS_NAMES",
    "LibraryBuild",
    "ManeuverRow",
    "Setting",
    "Term",
    "build",
    "check_setting",
    "codes_table",
    "effects",
    "est_columns_table",
    "example_vehicle",
    "formula_operations",
    "formula_places",
    "log_columns_table",
    "maneuvers",
    "road_level",
    "settings",
    "settings_table",
    "sim_settings_table",
    "simulated_vehicle",
    "text_table",
    "write_table",
]

STIFFNESS_NAMES = NAMES
"""Names of the stiffnesses in sentences, such as "Front cornering stiffness"."""
MAX_DURATION = MAX_DRIVE_SECONDS
"""s: the longest drive that is simulated."""


@dataclass(frozen=True)
class LibraryBuild:
    """The C library that is loaded."""

    version: str
    format: str
    """Number format: double, float or fixed point."""
    capacity: int
    """Particles that a filter of the paper can hold."""


@dataclass(frozen=True)
class Setting:
    """A number that can be set, and its range."""

    name: str
    default: float
    low: float
    high: float
    unit: str
    text: str
    """Its meaning."""


@dataclass(frozen=True)
class ManeuverRow:
    """A manoeuvre of simulate(), with its usual values."""

    name: str
    duration: float
    """s."""
    speed: float
    """m/s, at the start."""
    amplitude: float
    amplitude_text: str
    """Meaning and unit of the amplitude."""
    text: str
    """What is driven."""


@dataclass(frozen=True)
class Term:
    """A place where a formula enters, or an operation that it is made of."""

    name: str
    kind: str
    """PLACE, NUMBER, SIGNAL, PLAIN (a function) or MEMORY (a function that remembers)."""
    unit: str
    text: str


def build() -> LibraryBuild:
    """Return version, number format and capacity of the C library."""
    lib = library()
    return LibraryBuild(lib.version, lib.format, lib.capacity)


def settings(*, simulator: bool = False) -> dict[str, Setting]:
    """Return all settings by name: of the filter, or of the simulator."""
    rows = library().fields(SIM_CONFIG if simulator else CONFIG)
    return {f.name: Setting(f.name, f.default, f.low, f.high, f.unit, f.text) for f in rows}


def check_setting(name: str, value: float, *, source: str = "", simulator: bool = False) -> None:
    """Refuse a setting that nobody knows, or whose value is outside its range.

    Parameters
    ----------
    name, value
        The setting.
    source
        Where it comes from, such as the name of an option: the message begins with it.
    simulator
        Look among the settings of the simulator first.

    Raises
    ------
    SettingError
        The text names setting, value and range.
    """
    sim = SimConfig()
    (sim if simulator and name in sim else Config.exact()).set(name, value, source=source)


def road_level() -> Setting:
    """Return the level of a road, a factor of all stiffness, with its range."""
    f = library().field(SIM_INPUT, "road_level")
    return Setting(f.name, f.default, f.low, f.high, f.unit, f.text)


def maneuvers() -> list[ManeuverRow]:
    """Return the manoeuvres of simulate()."""
    return [
        ManeuverRow(k.name, k.duration, k.speed, k.amplitude, k.amplitude_text, k.text)
        for k in MANEUVERS.values()
    ]


def effects() -> list[dict[str, Any]]:
    """Return a row per parameter of the effects that the single-track model can be given.

    Returns
    -------
    list of dict
        id, effect (its title), enters (places), shows_in (channels), look_alikes,
        setting, unit, typical_low, typical_high, negligible (below it an effect is not
        named), meaning; strength: whether 0 switches the effect off.
    """
    return [
        {
            "id": e.id,
            "effect": e.title,
            "enters": ", ".join(e.entry_points),
            "shows_in": e.channels,
            "look_alikes": ", ".join(e.look_alikes),
            "setting": p.setting,
            "unit": p.unit,
            "typical_low": p.typical[0],
            "typical_high": p.typical[1],
            "negligible": p.negligible,
            "meaning": p.text,
            "strength": p.strength,
        }
        for e in library().effects.values()
        for p in e.parameters
    ]


def formula_places() -> dict[str, Term]:
    """Return the places of the model where a formula can enter, by name."""
    return {p.name: Term(p.name, "PLACE", p.unit, p.text) for p in library().formula_places.values()}


def formula_operations() -> dict[str, Term]:
    """Return the signals and functions that a formula can be made of, by name."""
    return {o.name: Term(o.name, o.kind, o.unit, o.text) for o in library().formula_ops.values()}


def write_table(rows: Sequence[Mapping[str, Any]], path: str | os.PathLike[str]) -> Path:
    """Write rows with the same keys as a table, .parquet or .csv by the name."""
    write_rows(Path(path), rows)
    return Path(path)
