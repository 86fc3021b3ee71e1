"""Find the units of the wheel speeds, the yaw rate and the accelerations.

Each combination of units has a cost. The cost grows with the deviations of the signals
from the kinematic relations, e.g. a_y = v r, and with each unit that contradicts the unit
stated in the log or in the name of the signal. The combination of least cost is returned.
A role is a quantity that a signal may measure, e.g. yaw_rate.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from tse.channels import physics
from tse.channels.look import MIN_NAME_SCORE, MIN_PROOF_CORR, ROLE_KINDS, Look
from tse.channels.physics import USUAL_TRACK, USUAL_TRACK_SD, fit, smooth
from tse.channels.vocabulary import join_words, score_name
from tse.channels.wheels import compute_speed, find_named_speed, find_turn, is_car_speed
from tse.log.units import unit_factor, unit_kind
from tse.readers.recording import RECEIVER_TEXT
from tse.readers.table import find_unit_suffix

# role, i.e. quantity that a signal may measure -> units that are tried if neither the log
# nor the name of the signal states one
UNIT_OPTIONS = {
    "wheel": ("rad/s", "km/h", "m/s", "rpm", "mph"),
    "yaw_rate": ("rad/s", "deg/s"),
    "accel_y": ("m/s2", "g"),
    "accel_x": ("m/s2", "g"),
    "steer_angle": ("deg", "rad"),
}
# [m] wheel radius of passenger cars, and [1] sd of its logarithm, used if no car is given
USUAL_RADIUS, USUAL_RADIUS_SD = 0.32, 0.06
USUAL_WHEELBASE = 2.7  # [m] wheelbase of passenger cars, used if no car is given
# Costs of units. The cost of a combination of units is the sum of the costs of its units,
# plus (deviation / sd)^2 of each kinematic relation.
LOG_UNIT_COST = 6.0  # cost of a unit other than the one stated in the log
NAME_UNIT_COST = 3.0  # cost of a unit other than the one at the end of the signal's name
# Cost of each unit of UNIT_OPTIONS except the first one, if neither log nor name states a
# unit. The first unit has no cost.
OTHER_UNIT_COST = 0.5
MAX_EQUATION_COST = 16.0  # max cost of one kinematic relation, without FAR_COST
# The cost of a kinematic relation is min(e^2, MAX_EQUATION_COST + FAR_COST x |e|), with
# e = deviation / sd. FAR_COST makes the cost grow with |e| even above MAX_EQUATION_COST.
# So the units with the smallest deviations win even if the deviations of all units are
# large.
FAR_COST = 0.1
MOTION_COST = 25.0  # cost of a unit with which the motion exceeds MAX_MOTION
# limits of the motion of road cars: [rad/s] yaw_rate, [m/s2] accel_y and accel_x, [m/s]
# wheel (wheel speed in m/s)
MAX_MOTION = {"yaw_rate": 3.0, "accel_y": 20.0, "accel_x": 20.0, "wheel": 80.0}


@dataclass(frozen=True)
class UnitScale:
    """Units of all channels, and the kinematic ratios that were used to find them."""

    unit: dict[str, str]  # role (wheel, yaw_rate, accel_y, accel_x) -> unit
    per: dict[str, float]  # role -> factor from this unit to SI; role wheel: to m/s
    # Name -> magnitude of a ratio of signals in SI units. v: mean wheel speed [m/s], r:
    # yaw rate [rad/s].
    #   "accel_y": a_y / (v r)
    #   "accel_x": a_x / (dv/dt)
    #   "track": [m] (right - left wheel speed [m/s]) / r
    #   "speed": logged speed over ground [m/s] / v
    figures: dict[str, float]


def _get_radius(car: Any | None) -> float:
    """Return the radius of the front wheels, m; without a car USUAL_RADIUS."""
    return float(car.values["wheel_radius_front"]) if car is not None else USUAL_RADIUS


def find_units(
    look: Look, wheels: Mapping[str, str], chosen: Mapping[str, str], car: Any | None, warnings: list[str]
) -> UnitScale:
    """Return the combination of units that agrees best with physics, log and names.

    `wheels`: place of each wheel -> name of its signal. `chosen`: role of each channel
    except the wheel speeds -> name of its signal. If the result contradicts a unit in the
    log, a warning is appended to `warnings`."""
    names = {role: chosen[role] for role in ("yaw_rate", "accel_y", "accel_x") if role in chosen}
    car_speed = ""
    if is_car_speed(wheels):
        car_speed = next(iter(wheels.values()))
    elif not wheels:
        car_speed = find_named_speed(look)
    if wheels or car_speed:
        names["wheel"] = car_speed or next(iter(wheels.values()))
    v0 = compute_speed(look, wheels)
    facts = measure_slopes(look, wheels, chosen, v0)
    options = {role: _list_units(look, role, name, car_speed != "") for role, name in names.items()}
    tops = {
        r: float(np.nanquantile(np.abs(look.x[n]), 0.999))
        for r, n in names.items()
        if np.isfinite(look.x[n]).any()
    }
    best: tuple[float, UnitScale] | None = None
    for picks in product(*options.values()):
        unit = {role: u for role, (u, _) in zip(options, picks, strict=True)}
        per = {role: _convert_unit(role, u, car) for role, u in unit.items()}
        cost, figures = _compute_cost(facts, unit, per, car)
        cost += sum(
            MOTION_COST for role, top in tops.items() if role in per and top * per[role] > MAX_MOTION[role]
        )
        this = cost + sum(c for _, c in picks), UnitScale(unit, per, figures)
        if best is None or this[0] < best[0]:
            best = this
    if best is None:
        return UnitScale({}, {}, {})
    for role, u in best[1].unit.items():
        was = look.channels[names[role]].unit
        if (
            was
            and unit_kind(was) in ROLE_KINDS.get(role, ROLE_KINDS["wheel"])
            and not is_same_unit(u, was, role)
        ):
            warnings.append(
                f"the log states {was} for {names[role]!r}, but its values fit {u}: {u} is proposed"
            )
    return best[1]


def _list_units(look: Look, role: str, name: str, is_speed: bool) -> list[tuple[str, float]]:
    """Return the possible units of a signal, each with its cost.

    `is_speed`: the signal is the speed of the car, which replaces the wheel speeds. Only
    units of speed are then possible, e.g. not rad/s."""
    kinds = ROLE_KINDS.get(role, ROLE_KINDS["wheel"])
    said, end = look.channels[name].unit, find_unit_suffix(look.channels[name].short)
    said = said if unit_kind(said) in kinds else ""
    choices = list(UNIT_OPTIONS[role])
    if role == "wheel" and is_speed:
        choices = [u for u in choices if unit_factor(u, "m/s") is not None]
    if said and unit_factor(said, "rad/s" if role in ("wheel", "yaw_rate") else "m/s2", 1.0) is not None:
        choices = [said] + [u for u in choices if not is_same_unit(u, said, role)]
    elif said == "" and end and unit_kind(end) in kinds:
        choices = [end] + [u for u in choices if not is_same_unit(u, end, role)]
    cost = OTHER_UNIT_COST
    if said:
        cost = LOG_UNIT_COST
    elif end and choices[0] == end:
        cost = NAME_UNIT_COST
    return [(u, 0.0 if i == 0 else cost) for i, u in enumerate(choices)]


def is_same_unit(a: str, b: str, role: str) -> bool:
    """Return whether two units of a role are the same, also if spelt differently."""
    wanted = "rad/s" if role in ("wheel", "yaw_rate") else "rad" if role == "steer_angle" else "m/s2"
    x, y = unit_factor(a, wanted, 1.0), unit_factor(b, wanted, 1.0)
    # Two units are the same if their factors to SI are equal. For a wheel, rad/s and m/s
    # have equal factors, because they are computed with a radius of 1 m. These two units
    # are therefore distinguished by their kind (rate or speed).
    return x is not None and y is not None and abs(x / y - 1) < 1e-3 and unit_kind(a) == unit_kind(b)


def _convert_unit(role: str, unit: str, car: Any | None) -> float:
    """Return the factor from a unit to SI; for wheel speeds to m/s."""
    if role == "wheel":
        return float(unit_factor(unit, "m/s") or (unit_factor(unit, "rad/s") or 1.0) * _get_radius(car))
    return float(unit_factor(unit, "rad/s" if role == "yaw_rate" else "m/s2") or 1.0)


def measure_slopes(
    look: Look, wheels: Mapping[str, str], chosen: Mapping[str, str], v: np.ndarray | None
) -> dict[str, float]:
    """Fit the kinematic relations to the signals in their logged units.

    `v`: speed of the car in any unit. The result is a dict, empty if `v` is None:
      - "accel_y", "accel_x", "track", "speed": ratios as in UnitScale.figures, but in the
        logged units. A ratio is left out if its numerator and denominator correlate by
        less than MIN_PROOF_CORR ("accel_x": 0.8, "speed": 0.98)
      - "accel_y_corr", "accel_x_corr", "track_corr": correlation of numerator and
        denominator of the ratio, with its sign
      - "course_corr": result of _correlate_course()
      - "top": 99 % quantile of |v|, taken as the top speed"""
    facts: dict[str, float] = {}
    if v is None:
        return facts
    facts["top"] = float(np.nanquantile(np.abs(v), 0.99))
    r = look.x[chosen["yaw_rate"]] if "yaw_rate" in chosen else None
    if r is not None and "accel_y" in chosen:
        found = fit(v * r, look.x[chosen["accel_y"]])
        if abs(found.corr) > MIN_PROOF_CORR:
            facts["accel_y"] = abs(found.slope)
        facts["accel_y_corr"] = found.corr
    turn = find_turn(look, wheels)
    if r is not None and turn is not None:
        found = fit(r, turn)
        if abs(found.corr) > MIN_PROOF_CORR:
            facts["track"] = abs(found.slope)
        facts["track_corr"] = found.corr
    if r is not None:
        facts["course_corr"] = _correlate_course(look, r, v)
    if "accel_x" in chosen:
        found = fit(physics.differentiate(v), look.x[chosen["accel_x"]])
        if abs(found.corr) > 0.8:
            facts["accel_x"] = abs(found.slope)
        facts["accel_x_corr"] = found.corr
    ground = _find_ground_speed(look, wheels)
    if ground is not None:
        found = fit(v, ground)
        if found.corr > 0.98:
            facts["speed"] = float(np.nanmedian((ground / v)[v > 0.3 * np.nanmax(v)]))
    return facts


def _correlate_course(look: Look, r: np.ndarray, v: np.ndarray) -> float:
    """Return the correlation of the yaw rate `r` with -d(course)/dt of the GNSS course.

    The course increases in right turns, so -d(course)/dt is positive to the left. If the
    result is positive, the logged yaw rate is positive to the left; if negative, to the
    right. A course without unit is taken to be in deg. Return 0 if the log has no GNSS
    course, or if the course changes by less than 1 deg."""
    named = [
        n
        for n in look.raw
        if score_name("heading", n) >= MIN_NAME_SCORE
        and unit_kind(look.find_unit(n)) in ("", "angle")
        and (look.channels[n].text == RECEIVER_TEXT or re.search(r"gps|gnss", join_words(n)))
    ]
    if not named:
        return 0.0
    time, course = look.raw[named[0]]
    good = np.isfinite(course)
    time = time[good]
    course = np.degrees(course[good] * (unit_factor(look.find_unit(named[0]) or "deg", "rad") or 1.0))
    if len(course) < 10 or np.ptp(course) < 1.0 or course.min() < -181.0 or course.max() > 361.0:
        return 0.0
    turned = -np.unwrap(np.radians(course))
    rate = smooth(
        np.gradient(smooth(np.interp(look.time, time, turned, np.nan, np.nan))) * physics.COMPARISON_RATE
    )
    return fit(r, rate, np.abs(v) > 0.3 * np.nanmax(np.abs(v))).corr


def _find_ground_speed(look: Look, wheels: Mapping[str, str]) -> np.ndarray | None:
    """Return a speed over ground that is independent of the wheels, m/s.

    The speed of a GNSS receiver is preferred. If the log has no speed over ground, it is
    computed from positions. Return None if the log has no positions either."""
    named = [
        n
        for n in look.x
        if unit_kind(look.channels[n].unit) == "speed"
        and score_name("speed", n) >= MIN_NAME_SCORE
        and n not in wheels.values()
    ]
    named.sort(key=lambda n: (bool(re.search(r"gps|gnss|ground", join_words(n))), score_name("speed", n)))
    if named:
        return look.x[named[-1]] * float(unit_factor(look.channels[named[-1]].unit, "m/s") or 1.0)
    at = {
        role: max(((score_name(role, n), n) for n in look.x), default=(0.0, ""))
        for role in ("latitude", "longitude")
    }
    if all(w >= 2.0 for w, _ in at.values()):
        lat, lon = (look.x[at[role][1]] for role in ("latitude", "longitude"))
        if np.nanmax(np.abs(lat)) <= 90 and np.nanmax(np.abs(lon)) <= 180:
            return smooth(physics.compute_ground_speed(lat, lon))
    return None


def _compute_cost(
    facts: Mapping[str, float], unit: Mapping[str, str], per: Mapping[str, float], car: Any | None
) -> tuple[float, dict[str, float]]:
    """Return the cost of a combination of units, and the ratios of UnitScale.figures.

    The cost is the sum of min(e^2, MAX_EQUATION_COST + FAR_COST x |e|) over the kinematic
    relations, with e = ln(ratio / expected ratio) / sd. A top speed above 75 m/s or below
    3 m/s is improbable for a car, and adds 4. `facts`: result of measure_slopes().
    `unit`, `per`: as in UnitScale."""
    v, r, ay, ax = (per.get(k, 1.0) for k in ("wheel", "yaw_rate", "accel_y", "accel_x"))
    # If the unit of the wheel speeds is angular, all ratios depend on the wheel radius.
    # `loose`: sd of the logarithm of this radius.
    rolling = unit.get("wheel", "") and unit_factor(unit["wheel"], "m/s") is None
    loose = USUAL_RADIUS_SD if rolling and car is None else 0.02 if rolling else 0.0
    figures = {}
    cost = 0.0
    for name, factor_, sd, wanted in (
        ("accel_y", ay / (v * r), 0.07, 1.0),
        ("accel_x", ax / v, 0.12, 1.0),
        ("track", v / r, USUAL_TRACK_SD, USUAL_TRACK),
        ("speed", 1.0 / v, 0.03, 1.0),
    ):
        if name in facts:
            figures[name] = facts[name] * factor_
            off = np.log(figures[name] / wanted) / np.hypot(sd, loose)
            cost += float(min(off**2, MAX_EQUATION_COST + FAR_COST * abs(off)))
    top = facts.get("top", 20.0 / v) * v
    cost += 4.0 * (top > 75.0) + 4.0 * (top < 3.0)
    return cost, figures
