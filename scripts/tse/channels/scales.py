"""Which units all channels have together: physics weighs every set of those that are often mixed up."""

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
from tse.log.units import factor, kind
from tse.readers.recording import RECEIVER
from tse.readers.table import unit_at_end

UNIT_OPTIONS = {"wheel": ("rad/s", "km/h", "m/s", "rpm", "mph"), "yaw_rate": ("rad/s", "deg/s"), "accel_y": ("m/s2", "g"),
    "accel_x": ("m/s2", "g"),
         "steer_angle": ("deg", "rad")}  # fmt: skip
USUAL_RADIUS, USUAL_RADIUS_SD = 0.32, 0.06  # m; of its logarithm: passenger cars, when no vehicle file says
USUAL_WHEELBASE = 2.7  # m, likewise
LOG_UNIT_COST, NAME_UNIT_COST, OTHER_UNIT_COST = (
    6.0,
    3.0,
    0.5,
)  # cost, in squared sd, of a unit that is not the log's, not the name's, and of any other than SI
MAX_EQUATION_COST = 16.0  # most that one equation says against a set of units,
MAX_MOTION = {
    "yaw_rate": 3.0,
    "accel_y": 20.0,
    "accel_x": 20.0,
    "wheel": 80.0,
}  # what road cars do, SI, wheels m/s
MOTION_COST = 25.0  # cost of a unit with which a car would do more
FAR_COST = 0.1  # but of two sets that are both far off the nearer one is better: per sd


@dataclass(frozen=True)
class Scale:
    """Units that were settled together, and the figures that settled them."""

    unit: dict[str, str]  # of wheel, yaw_rate, accel_y, accel_x
    per: dict[str, float]  # SI per unit
    figures: dict[
        str, float
    ]  # accel_y: a_y over v r; accel_x: a_x over dv/dt; track: m; speed: over the log's own speed


def _get_radius(car: Any | None) -> float:
    return float(car.values["wheel_radius_front"]) if car is not None else USUAL_RADIUS


def find_units(
    look: Look, wheels: Mapping[str, str], chosen: Mapping[str, str], car: Any | None, warnings: list[str]
) -> Scale:
    """The set of units that agrees best with physics and with what log and names say."""
    names = {role: chosen[role] for role in ("yaw_rate", "accel_y", "accel_x") if role in chosen}
    car_speed = (
        next(iter(wheels.values())) if is_car_speed(wheels) else "" if wheels else find_named_speed(look)
    )
    if wheels or car_speed:
        names["wheel"] = car_speed or next(iter(wheels.values()))
    v0 = compute_speed(look, wheels)
    facts = measure_slopes(look, wheels, chosen, v0)
    options: dict[str, list[tuple[str, float]]] = {}
    for role, name in names.items():
        said, end = look.channels[name].unit, unit_at_end(look.channels[name].short)
        said = said if kind(said) in ROLE_KINDS.get(role, ROLE_KINDS["wheel"]) else ""
        choices = [
            u for u in UNIT_OPTIONS[role] if not (role == "wheel" and car_speed and factor(u, "m/s") is None)
        ]
        if said and factor(said, "rad/s" if role in ("wheel", "yaw_rate") else "m/s2", 1.0) is not None:
            choices = [said] + [u for u in choices if not is_same_unit(u, said, role)]
        elif said == "" and end and kind(end) in ROLE_KINDS.get(role, ROLE_KINDS["wheel"]):
            choices = [end] + [u for u in choices if not is_same_unit(u, end, role)]
        cost = LOG_UNIT_COST if said else NAME_UNIT_COST if end and choices[0] == end else OTHER_UNIT_COST
        options[role] = [(u, 0.0 if i == 0 else cost) for i, u in enumerate(choices)]
    tops = {
        r: float(np.nanquantile(np.abs(look.x[n]), 0.999))
        for r, n in names.items()
        if np.isfinite(look.x[n]).any()
    }
    best: tuple[float, Scale] | None = None
    declared: tuple[float, Scale] | None = None
    for picks in product(*options.values()):
        unit = {role: u for role, (u, _) in zip(options, picks, strict=True)}
        per = {role: _convert_unit(role, u, car) for role, u in unit.items()}
        cost, figures = _compute_cost(facts, unit, per, car)
        cost += sum(
            MOTION_COST for role, top in tops.items() if role in per and top * per[role] > MAX_MOTION[role]
        )
        this = cost + sum(c for _, c in picks), Scale(unit, per, figures)
        declared = declared or this
        if best is None or this[0] < best[0]:
            best = this
    if best is None or declared is None:
        return Scale({}, {}, {})
    for role, u in best[1].unit.items():
        was = look.channels[names[role]].unit
        if was and kind(was) in ROLE_KINDS.get(role, ROLE_KINDS["wheel"]) and not is_same_unit(u, was, role):
            warnings.append(
                f"{names[role]!r} is in {was}, the log says, but its size is that of {u}: {u} is proposed"
            )
    return best[1]


def is_same_unit(a: str, b: str, role: str) -> bool:
    wanted = "rad/s" if role in ("wheel", "yaw_rate") else "rad" if role == "steer_angle" else "m/s2"
    x, y = factor(a, wanted, 1.0), factor(b, wanted, 1.0)
    # a rate of rolling and a speed are different units, though both become rates
    return x is not None and y is not None and abs(x / y - 1) < 1e-3 and kind(a) == kind(b)


def _convert_unit(role: str, unit: str, car: Any | None) -> float:
    """SI per unit; of wheels m/s."""
    if role == "wheel":
        return float(factor(unit, "m/s") or (factor(unit, "rad/s") or 1.0) * _get_radius(car))
    return float(factor(unit, "rad/s" if role == "yaw_rate" else "m/s2") or 1.0)


def measure_slopes(
    look: Look, wheels: Mapping[str, str], chosen: Mapping[str, str], v: np.ndarray | None
) -> dict[str, float]:
    """Slopes between the signals as they are logged; only those that show."""
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
    """Return how well the yaw rate goes with the course of a receiver of GNSS.

    The course counts clockwise from north, in degrees. 1: the yaw rate is positive to the
    left. -1: to the right. 0: there is no course."""
    named = [
        n for n in look.raw
        if score_name("heading", n) >= MIN_NAME_SCORE and kind(look.find_unit(n)) in ("", "angle")
        and (look.channels[n].text == RECEIVER or re.search(r"gps|gnss", join_words(n)))
    ]  # fmt: skip
    if not named:
        return 0.0
    time, course = look.raw[named[0]]
    good = np.isfinite(course)
    time, course = time[good], course[good]
    if len(course) < 10 or np.ptp(course) < 1.0 or course.min() < -181.0 or course.max() > 361.0:
        return 0.0
    turned = -np.unwrap(np.radians(course))
    rate = smooth(
        np.gradient(smooth(np.interp(look.time, time, turned, np.nan, np.nan))) * physics.COMPARISON_RATE
    )
    return fit(r, rate, np.abs(v) > 0.3 * np.nanmax(np.abs(v))).corr


def _find_ground_speed(look: Look, wheels: Mapping[str, str]) -> np.ndarray | None:
    """Speed over ground that the log has besides, m/s, in a known unit; of a receiver of GNSS before others."""
    named = [
        n
        for n in look.x
        if kind(look.channels[n].unit) == "speed"
        and score_name("speed", n) >= MIN_NAME_SCORE
        and n not in wheels.values()
    ]
    named.sort(key=lambda n: (bool(re.search(r"gps|gnss|ground", join_words(n))), score_name("speed", n)))
    if named:
        return look.x[named[-1]] * float(factor(look.channels[named[-1]].unit, "m/s") or 1.0)
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
    """How far a set of units is from what physics wants, in squared sd, and the figures themselves."""
    v, r, ay, ax = (per.get(k, 1.0) for k in ("wheel", "yaw_rate", "accel_y", "accel_x"))
    rolling = unit.get("wheel", "") and factor(unit["wheel"], "m/s") is None
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
