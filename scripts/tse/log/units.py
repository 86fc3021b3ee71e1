"""Units of signals: to the SI units of the channels, by pint, with the spellings that logs have."""

from __future__ import annotations

import functools
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pint


# Spellings that pint does not know, or takes for something else; without blanks, and in lower case where nothing else is spelt
# so: S and MS are times, kN no knot. Hz is of wheels: turns. Dots of products are left to pint.
SPELLINGS = {
    "": "1", "-": "1", "1": "1", "none": "1", "unitless": "1", "n/a": "1", "null": "1",
    "rad": "rad", "radian": "rad", "radians": "rad", "deg": "degree", "°": "degree", "º": "degree", "grad": "degree",
    "degree": "degree", "degrees": "degree", "unit_degreofarc": "degree", "unit_deg": "degree", "\ufffd": "degree",
    "deg/s": "degree/s", "°/s": "degree/s", "º/s": "degree/s", "grad/s": "degree/s", "degree/s": "degree/s", "dps": "degree/s",
    "degps": "degree/s", "degpersec": "degree/s", "deg/sec": "degree/s", "grad/sek": "degree/s",
    "unit_degreofarcperseco": "degree/s", "unit_degreofarcpersecon": "degree/s",
    "\ufffd/s": "degree/s", "deg_per_s": "degree/s", "degree/second": "degree/s", "degrees/s": "degree/s",
    "rad/s": "rad/s", "1/s": "rad/s", "s^-1": "rad/s", "rad/sec": "rad/s", "radps": "rad/s", "rps": "turn/s", "u/s": "turn/s",
    "hz": "turn/s", "rev/s": "turn/s",
    "rpm": "turn/min", "1/min": "turn/min", "u/min": "turn/min", "min^-1": "turn/min", "rev/min": "turn/min",
    "unit_minutinvers": "turn/min",
    "kmph": "km/h", "km/std": "km/h", "kmh^-1": "km/h", "km.h-1": "km/h",
    "km/h": "km/h", "kmh": "km/h", "kph": "km/h", "km/hr": "km/h", "unit_kilometerperhour": "km/h", "unit_kilomperhour": "km/h",
    "mph": "mile/h", "mi/h": "mile/h", "unit_mileperhour": "mile/h", "kn": "knot", "kt": "knot", "kts": "knot", "knots": "knot",
    "m/s": "m/s", "mps": "m/s", "m/sec": "m/s", "unit_meterpersecon": "m/s", "unit_meterpersecond": "m/s",
    "m/s2": "m/s^2", "m/s^2": "m/s^2", "m/s²": "m/s^2", "m/s/s": "m/s^2", "m/(s^2)": "m/s^2", "mps2": "m/s^2", "m/sec2": "m/s^2",
    "m/sec^2": "m/s^2", "m/s**2": "m/s^2", "mpss": "m/s^2", "unit_meterpersecosquar": "m/s^2",
    "unit_meterperseconsquar": "m/s^2", "m/s\ufffd": "m/s^2",
    "g": "standard_gravity", "g0": "standard_gravity", "gn": "standard_gravity", "g_n": "standard_gravity",
    "gravity": "standard_gravity",
    "unit_gravityacceleration": "standard_gravity", "unit_forceofgravi": "standard_gravity", "mg": "0.001*standard_gravity",
    "s": "s", "sec": "s", "seconds": "s", "sek": "s", "ms": "ms", "msec": "ms", "us": "us", "µs": "us", "ns": "ns", "usec": "us",
    "nm": "N*m", "n*m": "N*m", "n.m": "N*m", "n·m": "N*m", "knm": "kN*m", "unit_newtonmeter": "N*m", "unit_newtometer": "N*m",
    "%": "percent", "kN": "kN",
}  # fmt: skip


_SIMPLE_UNIT = re.compile(
    r"(?!.*\^.*\^)[A-Za-z0-9°µΩ%·/^(). -]{1,24}"
)  # no towers of powers, which pint would work out


@functools.lru_cache(maxsize=1)
def load_units() -> pint.UnitRegistry:
    """Return the units that pint knows."""
    import pint  # a third of a second, and dask where it is installed: for those who have units

    return pint.UnitRegistry()


@functools.lru_cache(maxsize=512)
def parse_unit(unit: str) -> pint.Quantity | None:
    """A unit as it is spelt in a log, as a quantity; None where nobody knows it."""
    text = unit.strip().strip("[]()").strip()
    compact = re.sub(r"\s+", "", text)
    plain = SPELLINGS.get(compact) or SPELLINGS.get(compact.lower())
    if plain is None and not _SIMPLE_UNIT.fullmatch(text):
        return None
    try:
        return load_units().Quantity(plain or text)
    except Exception:  # pint's tokenizer raises what it likes at odd text
        return None


def is_unknown_unit(unit: str) -> bool:
    """Return whether a unit is one that nobody knows: km^h. The size of the signal says then what it is."""
    return parse_unit(unit) is None


def is_known_unit(unit: str) -> bool:
    """Is it a unit that somebody knows, and more than a blank?"""
    found = parse_unit(unit)
    return found is not None and not found.unitless


@functools.lru_cache(maxsize=512)
def unit_factor(unit: str, wanted: str, radius: float | None = None) -> float | None:
    """How much of `wanted` (SI) one `unit` is; None where it is none of it. Speeds become rates of wheels of this radius, m."""
    found = parse_unit(unit)
    if found is None:
        return None
    target = load_units().Quantity(1.0, {"m/s2": "m/s^2", "Nm": "N*m"}.get(wanted, wanted))
    if wanted == "rad/s" and found.check("[length]/[time]"):
        return None if not radius else float(found.to("m/s").magnitude) / radius
    if found.check("[frequency]") and not target.check("[frequency]"):
        return None
    if not found.is_compatible_with(target) or (found.unitless and wanted not in ("rad", "1")):
        return None
    if wanted == "rad" and unit_kind(unit) not in ("", "angle"):  # a slope in %
        return None
    return float(found.to(target.units).magnitude)


@functools.lru_cache(maxsize=512)
def unit_kind(unit: str) -> str:
    """angle, rate, speed, acceleration, torque, time, other; "": no unit."""
    found = parse_unit(unit)
    if found is None:
        return "other"
    dims = str(found.dimensionality)
    if found.check("[length]/[time]"):
        return "speed"
    if found.check("[length]/[time]**2"):
        return "acceleration"
    if found.check("[mass]*[length]**2/[time]**2"):
        return "torque"
    if found.check("[time]"):
        return "time"
    if found.check("[frequency]"):
        return "rate"
    if dims == "dimensionless":
        return "" if found.units == load_units().dimensionless and found.magnitude == 1.0 else (
            "angle" if str(found.to_root_units().units) == "radian" else "other")  # fmt: skip
    return "other"
