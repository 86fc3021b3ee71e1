"""Convert units in the spellings of logs to SI units, with the package pint."""

from __future__ import annotations

import functools
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pint


# Unit in the spelling of pint -> its spellings in logs, separated by blanks. pint alone
# refuses most of these spellings or takes them as a different unit. parse_unit() removes
# blanks and ignores case. Only kN (kilonewton) must be written as here: kn is the knot.
# Hz means turns per second (wheel speeds), whereas pint takes 1 Hz as 1 rad/s.
_SPELLINGS = {
    "1": "- 1 none unitless n/a null",
    "rad": "rad radian radians",
    "degree": "deg ° º grad degree degrees unit_degreofarc unit_deg \ufffd",
    "rad/s": "rad/s 1/s s^-1 rad/sec radps",
    "degree/s": (
        "deg/s °/s º/s \ufffd/s grad/s degree/s degrees/s degree/second deg_per_s dps degps degpersec "
        "deg/sec grad/sek unit_degreofarcperseco unit_degreofarcpersecon"
    ),
    "turn/s": "rps u/s hz rev/s",
    "turn/min": "rpm 1/min u/min min^-1 rev/min unit_minutinvers",
    "m/s": "m/s mps m/sec unit_meterpersecon unit_meterpersecond",
    "km/h": "km/h kmh kph kmph km/hr km/std kmh^-1 km.h-1 unit_kilometerperhour unit_kilomperhour",
    "mile/h": "mph mi/h unit_mileperhour",
    "knot": "kn kt kts knots",
    "m/s^2": (
        "m/s2 m/s^2 m/s² m/s\ufffd m/s/s m/(s^2) m/s**2 mps2 mpss m/sec2 m/sec^2 "
        "unit_meterpersecosquar unit_meterperseconsquar"
    ),
    "standard_gravity": "g g0 gn g_n gravity unit_gravityacceleration unit_forceofgravi",
    "0.001*standard_gravity": "mg",
    "s": "s sec seconds sek",
    "ms": "ms msec",
    "us": "us µs usec",
    "ns": "ns",
    "N*m": "nm n*m n.m n·m unit_newtonmeter unit_newtometer",
    "kN*m": "knm",
    "kN": "kN",
    "percent": "%",
}
SPELLINGS = {"": "1"} | {s: unit for unit, spelled in _SPELLINGS.items() for s in spelled.split()}

# Pattern of the units that pint may parse if they are not in _SPELLINGS. Any other unit
# is unknown. The pattern allows at most one ^, because pint would try to compute nested
# powers such as 9^9^9^9, which take unlimited time and memory.
_SIMPLE_UNIT = re.compile(r"(?!.*\^.*\^)[A-Za-z0-9°µΩ%·/^(). -]{1,24}")


@functools.lru_cache(maxsize=1)
def load_units() -> pint.UnitRegistry:
    """Return pint's registry of units; import pint at the first call."""
    import pint  # not at the top: the import takes 0.3 s and loads dask, if installed

    return pint.UnitRegistry()


@functools.lru_cache(maxsize=512)
def parse_unit(unit: str) -> pint.Quantity | None:
    """Return a unit as a quantity of pint; None if the unit is unknown."""
    text = unit.strip().strip("[]()").strip()
    compact = re.sub(r"\s+", "", text)
    plain = SPELLINGS.get(compact) or SPELLINGS.get(compact.lower())
    if plain is None and not _SIMPLE_UNIT.fullmatch(text):
        return None
    try:
        return load_units().Quantity(plain or text)
    except Exception:  # pint's tokenizer may raise any error
        return None


def is_unknown_unit(unit: str) -> bool:
    """Return whether a unit is unknown, such as km^h.

    A channel with an unknown unit gets a unit that is guessed from its values."""
    return parse_unit(unit) is None


def is_known_unit(unit: str) -> bool:
    """Return True for a known unit such as deg, % or m/s; False for an unknown one, for 1
    and for ""."""
    found = parse_unit(unit)
    return found is not None and not found.unitless


@functools.lru_cache(maxsize=512)
def unit_factor(unit: str, wanted: str, radius: float | None = None) -> float | None:
    """Return the factor that converts values in a unit to an SI unit.

    Parameters
    ----------
    unit : str
        The unit, in the spelling of the log.
    wanted : str
        SI unit of the channel.
    radius : float, optional
        [m] Wheel radius. If it is given and `wanted` is rad/s, `unit` may also be a unit
        of speed: the factor then converts speed to rotational speed of a wheel.

    Returns
    -------
    float or None
        The factor. None if the unit is unknown, if it measures a different quantity than
        `wanted`, or if the conversion needs `radius`, but `radius` is not given.
    """
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
    if wanted == "rad" and unit_kind(unit) not in ("", "angle"):  # e.g. %, the unit of a road's grade
        return None
    return float(found.to(target.units).magnitude)


@functools.lru_cache(maxsize=512)
def unit_kind(unit: str) -> str:
    """Return the kind of quantity that a unit measures.

    The result is "angle", "rate" (a rate of rotation, or a frequency), "speed",
    "acceleration", "torque", "time" or "other". It is "" if the unit is 1 or not stated.
    An unknown unit is "other"."""
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
        if found.units == load_units().dimensionless and found.magnitude == 1.0:
            return ""
        return "angle" if str(found.to_root_units().units) == "radian" else "other"
    return "other"
