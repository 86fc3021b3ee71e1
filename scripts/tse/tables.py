"""Lists of the names that the C library knows, with units and meanings: settings, columns
of logs and of estimates, codes of status and reasons, effects by which the model can be
extended, manoeuvres of the simulator, and signals and functions that formulas can use."""

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
"""Max duration of a simulated drive, s."""


@dataclass(frozen=True)
class LibraryBuild:
    """Properties of the loaded C library."""

    version: str
    format: str
    """Number format: double, float or fixed point."""
    capacity: int
    """Max number of particles with which the paper's filter can run."""


@dataclass(frozen=True)
class Setting:
    """A setting: name, default, range, unit and meaning."""

    name: str
    default: float
    low: float
    high: float
    unit: str
    text: str
    """Meaning of the setting."""


@dataclass(frozen=True)
class ManeuverRow:
    """A manoeuvre of simulate(), with its default values."""

    name: str
    duration: float
    """Duration, s."""
    speed: float
    """Initial speed, m/s."""
    amplitude: float
    amplitude_text: str
    """Meaning and unit of the amplitude."""
    text: str
    """Description of the manoeuvre."""


@dataclass(frozen=True)
class Term:
    """A term of a formula: a number, a signal, a function, or the place in the model to
    which the formula is added."""

    name: str
    kind: str
    """PLACE (where the formula is added to the model), NUMBER, SIGNAL, PLAIN (function
    without memory) or MEMORY (function that depends on earlier rows)."""
    unit: str
    text: str


def build() -> LibraryBuild:
    """Return version, number format and max number of particles of the C library."""
    lib = library()
    return LibraryBuild(lib.version, lib.format, lib.capacity)


def settings(*, simulator: bool = False) -> dict[str, Setting]:
    """Return all settings by name: of the filter, or of the simulator."""
    rows = library().fields(SIM_CONFIG if simulator else CONFIG)
    return {f.name: Setting(f.name, f.default, f.low, f.high, f.unit, f.text) for f in rows}


def check_setting(name: str, value: float, *, source: str = "", simulator: bool = False) -> None:
    """Raise SettingError if a setting is unknown, or its value is outside its range.

    Parameters
    ----------
    name, value
        The setting.
    source
        Where the setting comes from, such as the name of an option.
        The message begins with it.
    simulator
        True: look for the name among the settings of the simulator first, then among
        those of the filter. False: look for it only among those of the filter.

    Raises
    ------
    SettingError
        The message names setting, value and range.
    """
    sim = SimConfig()
    (sim if simulator and name in sim else Config.exact()).set(name, value, source=source)


def road_level() -> Setting:
    """Return name, range and meaning of the input road_level of the simulator. It is a
    factor on every stiffness, for each row of a drive."""
    f = library().field(SIM_INPUT, "road_level")
    return Setting(f.name, f.default, f.low, f.high, f.unit, f.text)


def maneuvers() -> list[ManeuverRow]:
    """Return the manoeuvres of simulate()."""
    return [
        ManeuverRow(k.name, k.duration, k.speed, k.amplitude, k.amplitude_text, k.text)
        for k in MANEUVERS.values()
    ]


def effects() -> list[dict[str, Any]]:
    """Return the effects by which the single-track model can be extended, with a row for
    each of their parameters.

    Returns
    -------
    list of dict
        Keys that describe the effect: id; effect (title); enters (parts of the model
        that it changes, such as "front axle"); shows_in (channels that it affects, and
        when); look_alikes (ids of effects that are hard to distinguish from it). Keys
        that describe the parameter: setting (name of the setting that holds it); unit;
        typical_low, typical_high (range among cars that have the effect); negligible
        (`tselab gap` does not report an effect whose size is below this); meaning;
        strength (True: the parameter is the size of the effect, and 0 switches the effect
        off; False: it gives the shape of the effect, such as a time constant).
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
    """Return the places of the model to which a formula can be added, by name."""
    return {p.name: Term(p.name, "PLACE", p.unit, p.text) for p in library().formula_places.values()}


def formula_operations() -> dict[str, Term]:
    """Return the signals and functions that a formula can be made of, by name."""
    return {o.name: Term(o.name, o.kind, o.unit, o.text) for o in library().formula_ops.values()}


def write_table(rows: Sequence[Mapping[str, Any]], path: str | os.PathLike[str]) -> Path:
    """Write a table: Parquet if `path` ends in .parquet, otherwise CSV. Each mapping in
    `rows` is a row, and its keys are the columns. All rows have the same keys."""
    write_rows(Path(path), rows)
    return Path(path)
