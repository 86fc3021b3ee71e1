"""A guess of signals.toml: names by words, units and physics together; every guess with the figure that speaks for it.

A candidate of a role is worth what its name sounds like (vocabulary.py), plus whether its unit is of the kind, plus how well it
agrees with the others (physics.py). The references of the physics are the best candidates themselves, so it is done a few times
over."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np

from tselab.logs import physics
from tselab.logs.mapping import Clocks, Series
from tselab.logs.names import unit_at_end
from tselab.logs.physics import MOVING, RATE, TRACK, TRACK_SD, fit, mean_of, smoothed
from tselab.logs.raster import entries, rate_of, resample
from tselab.logs.recording import Channel, Recording
from tselab.logs.units import factor, kind
from tselab.logs.vocabulary import place_of, score, text_of

LATERAL = ("yaw_rate", "accel_y", "accel_x", "steer_angle")
KINDS = {"yaw_rate": ("rate",), "accel_y": ("acceleration",), "accel_x": ("acceleration",), "steer_angle": ("angle",),
    "wheel": ("speed", "rate"),
         "speed": ("speed",)}  # fmt: skip
UNITS = {"wheel": ("rad/s", "km/h", "m/s", "rpm", "mph"), "yaw_rate": ("rad/s", "deg/s"), "accel_y": ("m/s2", "g"),
    "accel_x": ("m/s2", "g"),
         "steer_angle": ("deg", "rad")}  # fmt: skip
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
AXLES = ("front", "rear")
USUAL_RATIO, USUAL_RATIO_SD = 15.5, 0.12  # and 12 .. 20, of its logarithm
LONGEST = 1500.0  # s of a log that are looked at
PASSES = 3
USUAL_RADIUS, RADIUS_SD = 0.32, 0.06  # m; of its logarithm: passenger cars, when no vehicle file says
USUAL_WHEELBASE = 2.7  # m, likewise
NAMED, TURNED = 1.0, 0.9  # a name that says something; a correlation that proves something
CONTRADICTED, SUFFIX, UNSAID = (
    6.0,
    3.0,
    0.5,
)  # cost, in squared sd, of a unit that is not the log's, not the name's, and of any other than SI
CLIP = 16.0  # most that one equation says against a set of units
LEAST_LATENCY = 0.004  # s
FOUND = 4.0  # sd by which a latency is not 0


@dataclass
class Guess:
    """One channel of the library. `figures`: what speaks for it, in words."""

    channel: str
    name: tuple[str, ...]
    unit: str
    unit_from: str
    sign: float = 1.0
    ratio: float | None = None
    latency: float = 0.0
    confidence: str = "unsure"  # sure, likely, unsure
    figures: list[str] = field(default_factory=list)


@dataclass
class Proposal:
    """The guesses, in the order of the library, and what contradicts them or is odd."""

    guesses: list[Guess]
    warnings: list[str]
    missing: list[str]

    def __getitem__(self, channel: str) -> Guess | None:
        return next((g for g in self.guesses if g.channel == channel), None)


class Look:
    """A recording on one even raster, smoothed, for comparisons. `x`: by name, (rows,)."""

    def __init__(self, recording: Recording):
        clocks = Clocks()
        own: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        for c in recording:
            time, value = clocks.of(c)
            if np.isfinite(value).sum() > 3 and np.nanstd(value) > 0 and len(time):
                own[c.name] = entries(Series(c.name, time, value))
        self.channels: dict[str, Channel] = {c.name: c for c in recording if c.name in own}
        self.rate = {n: rate_of(t) for n, (t, _) in own.items()}
        if not own:
            self.x, self.time = {}, np.zeros(0)
            return
        first = float(np.median([t[0] for t, _ in own.values()]))
        last = min(float(np.median([t[-1] for t, _ in own.values()])), first + LONGEST)
        self.time = np.arange(first, max(last, first + 1.0), 1.0 / RATE)
        self.fine = {n: resample(t, v, self.time, RATE) for n, (t, v) in own.items()}
        self.x = {n: smoothed(v) for n, v in self.fine.items()}

    def unit(self, name: str) -> str:
        """As the log says, or the end of the name."""
        c = self.channels[name]
        return c.unit if kind(c.unit) not in ("",) else unit_at_end(c.short)


def propose(recording: Recording, car: Any | None = None) -> Proposal:
    """Guess which signal is which. `car`: a vehicle.Vehicle; its radii, wheelbase and ratio make the figures sharper."""
    look = Look(recording)
    warnings: list[str] = []
    wheels = _wheels(look)
    chosen: dict[str, str] = {}
    worth: dict[str, dict[str, float]] = {}
    for _ in range(PASSES):
        raw = _speed(look, wheels, chosen)
        chosen, worth = _roles(look, wheels, raw, chosen)
        if raw is None:
            break
    wheels = _sides(look, wheels, chosen)
    scale = _units(look, wheels, chosen, car, warnings)
    guesses = _guesses(look, wheels, chosen, worth, scale, car, warnings)
    have = {g.channel for g in guesses}
    return Proposal(
        guesses,
        warnings,
        [
            c
            for c in ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")
            if c not in have
        ],
    )


# ---- which signals are wheels


def _wheels(look: Look) -> dict[str, str]:
    """Place -> name; of several sets the most complete one that behaves like wheels."""
    groups: dict[str, dict[str, tuple[float, str]]] = {}
    for name in look.x:
        place, worth = place_of(name)
        if not place or worth <= 0 or kind(look.unit(name)) not in ("", *KINDS["wheel"]) or not _rolls(look.x[name]):
            continue
        worth += kind(look.unit(name)) in KINDS["wheel"]
        stem = name.replace("/", ".").rpartition(".")[0]
        for key in (
            f"{len(text_of(name).split())} {look.unit(name)} {_stem(name, place)}",
            f"message {stem} {look.unit(name)}",
        ):
            best = groups.setdefault(key, {}).get(place)
            if best is None or worth > best[0]:
                groups[key][place] = worth, name
    found, best = {}, 0.0
    for group in groups.values():
        for places in (WHEELS, AXLES):
            mine = {p: group[p] for p in places if p in group}
            pairs = len(mine) == len(places) or any(all(f"{a}_{s}" in mine for s in ("left", "right")) for a in AXLES)
            value = (
                len(mine) * 2.0
                + sum(w for w, _ in mine.values()) / max(len(mine), 1)
                + 3.0 * (len(mine) == 4)
                + _alike(look, [n for _, n in mine.values()])
            )
            if pairs and len({n for _, n in mine.values()}) == len(mine) and value > best:
                found, best = {p: n for p, (_, n) in mine.items()}, value
    if "front_left" in found or "rear_left" in found:
        for axle in AXLES:  # one wheel of an axle is none
            if sum(f"{axle}_{s}" in found for s in ("left", "right")) == 1:
                found = {p: n for p, n in found.items() if not p.startswith(axle)}
    return found or _nameless_wheels(look)


def _stem(name: str, place: str) -> str:
    """A name without what says where."""
    text = text_of(re.split(r"[./]", name)[-1])
    return re.sub(
        r"\b(fl|fr|rl|rr|vl|vr|hl|hr|lf|rf|lr|front|rear|left|right|vorne?|hinten|links|rechts|[a-z]?[fvhrl]{2})\b",
        "*",
        text,
    ).replace("* *", "*")


def _rolls(x: np.ndarray) -> bool:
    """Hardly ever below 0, and moves."""
    good = x[np.isfinite(x)]
    return len(good) > 10 and float(np.mean(good < -0.02 * np.max(np.abs(good)))) < 0.05 and float(np.ptp(good)) > 0


def _alike(look: Look, names: list[str]) -> float:
    """2: all go alike, as wheels do; less otherwise."""
    if len(names) < 2:
        return 0.0
    first = look.x[names[0]]
    return 2.0 * min(max(fit(first, look.x[n]).corr, 0.0) for n in names[1:])


def _nameless_wheels(look: Look) -> dict[str, str]:
    """Four signals that are the same but for some percent, of one unit: wheels, in the order of the file."""
    rolling = [n for n in look.x if _rolls(look.x[n]) and kind(look.unit(n)) in ("", *KINDS["wheel"])]
    for first in rolling:
        same = [n for n in rolling if look.unit(n) == look.unit(first) and _same_size(look.x[first], look.x[n])]
        distinct: list[str] = []
        for n in same:
            if all(np.nanmax(np.abs(look.x[n] - look.x[d])) > 1e-6 * np.nanmax(np.abs(look.x[n])) for d in distinct):
                distinct.append(n)
        if len(distinct) == 4:
            return dict(zip(WHEELS, distinct, strict=True))
    return {}


def _same_size(a: np.ndarray, b: np.ndarray) -> bool:
    keep = np.isfinite(a) & np.isfinite(b) & (np.abs(a) > 0.3 * np.nanmax(np.abs(a)))
    if keep.sum() < physics.FEWEST:
        return False
    part = b[keep] / a[keep]
    return bool(abs(np.median(part) - 1) < 0.05 and np.std(part) < 0.03)


def _speed(look: Look, wheels: Mapping[str, str], chosen: Mapping[str, str]) -> np.ndarray | None:
    """The speed in whatever unit: of the wheels, or what is called one."""
    if wheels:
        return mean_of([look.x[n] for n in wheels.values()]) if len(look.time) else None
    named = sorted((score("speed", n) + (kind(look.unit(n)) == "speed"), n) for n in look.x if _rolls(look.x[n]))
    return look.x[named[-1][1]] if named and named[-1][0] >= NAMED else None


def _turn(look: Look, wheels: Mapping[str, str]) -> np.ndarray | None:
    """Right less left, of the axle behind if it is there: the yaw rate but for a factor."""
    for axle in ("rear", "front"):
        left, right = wheels.get(f"{axle}_left"), wheels.get(f"{axle}_right")
        if left and right:
            return look.x[right] - look.x[left]
    return None


# ---- which are the others


def _roles(
    look: Look, wheels: Mapping[str, str], v: np.ndarray | None, before: Mapping[str, str]
) -> tuple[dict[str, str], dict[str, dict[str, float]]]:
    """Role -> name, and what every candidate was worth: by name and unit, and by physics."""
    taken = set(wheels.values())
    said = {role: {n: _said(look, role, n) for n in look.x if n not in taken} for role in LATERAL}
    ref = dict(before)
    if not ref:
        for role in LATERAL:
            best = max(said[role].items(), key=lambda i: i[1], default=("", 0.0))
            if best[1] >= NAMED:
                ref[role] = best[0]
        if v is not None and ("yaw_rate" not in ref or "accel_y" not in ref):
            ref |= _pair(look, v, taken, said, ref)
    total: dict[str, dict[str, float]] = {}
    shown: dict[str, dict[str, float]] = {}
    for role in LATERAL:
        shown[role] = {n: _shown(look, role, n, v, _turn(look, wheels), ref) for n in said[role]}
        total[role] = {n: said[role][n] + shown[role][n] for n in said[role]}
    found: dict[str, str] = {}
    pairs = sorted(((w, role, n) for role in LATERAL for n, w in total[role].items()), reverse=True)
    for w, role, n in pairs:  # the best first; one signal has one role
        if (
            role not in found
            and n not in found.values()
            and w >= NAMED
            and (said[role][n] >= 0.8 or shown[role][n] >= 2.5)
        ):
            found[role] = n
    return found, {
        role: {"said": said[role].get(n, 0.0), "shown": shown[role].get(n, 0.0)} for role, n in found.items()
    }


def _said(look: Look, role: str, name: str) -> float:
    unit = kind(look.unit(name))
    of_kind = 1.0 if unit in KINDS[role] else (0.0 if unit == "" else -3.0)
    return score(role, name) + of_kind + 0.001 * min(look.rate[name], 100.0)


def _shown(
    look: Look, role: str, name: str, v: np.ndarray | None, turn: np.ndarray | None, ref: Mapping[str, str]
) -> float:
    """-4 .. 4: how well it agrees with the others; 0: nothing to compare with."""
    x = look.x[name]
    said = []
    if role == "yaw_rate":
        if turn is not None:
            said.append(abs(fit(x, turn).corr))
        if v is not None and "accel_y" in ref and ref["accel_y"] != name:
            said.append(abs(fit(v * x, look.x[ref["accel_y"]]).corr))
    elif role == "accel_y" and v is not None:
        if "yaw_rate" in ref and ref["yaw_rate"] != name:
            said.append(abs(fit(v * look.x[ref["yaw_rate"]], x).corr))
        elif turn is not None:
            said.append(abs(fit(v * turn, x).corr))
    elif role == "accel_x" and v is not None:
        said.append(abs(fit(physics.derivative(v), x).corr))
    elif role == "steer_angle" and v is not None:
        r = look.x[ref["yaw_rate"]] if "yaw_rate" in ref and ref["yaw_rate"] != name else turn
        if r is not None:
            top = float(np.nanquantile(np.abs(v), 0.98)) if np.isfinite(v).any() else 0.0
            found = physics.steering(x, v * (25.0 / top if top else 1.0), r)
            said.append(np.sqrt(max(found.share, 0.0)) if found else 0.0)
    said = [s for s in said if s > 0]
    return float(np.clip(16.0 * (np.mean(said) - 0.75), -4.0, 4.0)) if said else 0.0


def _pair(
    look: Look, v: np.ndarray, taken: set[str], said: Mapping[str, Mapping[str, float]], ref: Mapping[str, str]
) -> dict[str, str]:
    """Yaw rate and lateral acceleration without a name that says so: the two for which a_y = v r holds best."""
    free = [n for n in look.x if n not in taken and not _rolls(look.x[n])]
    rates = [ref["yaw_rate"]] if "yaw_rate" in ref else [n for n in free if said["yaw_rate"][n] > -1]
    accels = [ref["accel_y"]] if "accel_y" in ref else [n for n in free if said["accel_y"][n] > -1]
    best, found = TURNED, {}
    for r, a in product(rates[:80], accels[:80]):
        if r == a:
            continue
        corr = abs(fit(v * look.x[r], look.x[a]).corr) + 0.01 * (said["yaw_rate"][r] + said["accel_y"][a])
        # of two that go together anyway the one of which v times the other is nearer is the acceleration
        corr -= 0.5 * max(0.0, abs(fit(look.x[r], look.x[a]).corr) - abs(fit(v * look.x[r], look.x[a]).corr))
        if corr > best:
            best, found = corr, {"yaw_rate": r, "accel_y": a}
    return found


def _sides(look: Look, wheels: dict[str, str], chosen: Mapping[str, str]) -> dict[str, str]:
    """Nameless wheels: those that are slower in a left turn are left; the first of each side is front."""
    if not wheels or place_of(next(iter(wheels.values())))[0] or "yaw_rate" not in chosen or "front_left" not in wheels:
        return wheels
    r, mean = look.x[chosen["yaw_rate"]], mean_of([look.x[n] for n in wheels.values()])
    order = sorted(wheels.values(), key=lambda n: fit(r, look.x[n] - mean).corr)
    left = [n for n in wheels.values() if n in order[:2]]
    right = [n for n in wheels.values() if n in order[2:]]
    return {"front_left": left[0], "front_right": right[0], "rear_left": left[1], "rear_right": right[1]}


# ---- units


@dataclass(frozen=True)
class Scale:
    """Units that were settled together, and the figures that settled them."""

    unit: dict[str, str]  # of wheel, yaw_rate, accel_y, accel_x
    per: dict[str, float]  # SI per unit
    figures: dict[
        str, float
    ]  # accel_y: a_y over v r; accel_x: a_x over dv/dt; track: m; speed: over the log's own speed


def _radius(car: Any | None, axle: str = "front") -> float:
    return float(car.values[f"wheel_radius_{axle}"]) if car is not None else USUAL_RADIUS


def _units(
    look: Look, wheels: Mapping[str, str], chosen: Mapping[str, str], car: Any | None, warnings: list[str]
) -> Scale:
    """The set of units that agrees best with physics and with what log and names say."""
    names = {role: chosen[role] for role in ("yaw_rate", "accel_y", "accel_x") if role in chosen}
    if wheels:
        names["wheel"] = next(iter(wheels.values()))
    v0 = _speed(look, wheels, chosen)
    facts = _facts(look, wheels, chosen, v0)
    options: dict[str, list[tuple[str, float]]] = {}
    for role, name in names.items():
        said, end = look.channels[name].unit, unit_at_end(look.channels[name].short)
        said = said if kind(said) in KINDS.get(role, KINDS["wheel"]) else ""
        choices = list(UNITS[role])
        if said and factor(said, "rad/s" if role in ("wheel", "yaw_rate") else "m/s2", 1.0) is not None:
            choices = [said] + [u for u in choices if not _same(u, said, role)]
        elif said == "" and end and kind(end) in KINDS.get(role, KINDS["wheel"]):
            choices = [end] + [u for u in choices if not _same(u, end, role)]
        cost = CONTRADICTED if said else SUFFIX if end and choices[0] == end else UNSAID
        options[role] = [(u, 0.0 if i == 0 else cost) for i, u in enumerate(choices)]
    best: tuple[float, Scale] | None = None
    declared: tuple[float, Scale] | None = None
    for picks in product(*options.values()):
        unit = {role: u for role, (u, _) in zip(options, picks, strict=True)}
        per = {role: _per(role, u, car) for role, u in unit.items()}
        cost, figures = _cost(facts, unit, per, car)
        this = cost + sum(c for _, c in picks), Scale(unit, per, figures)
        declared = declared or this
        if best is None or this[0] < best[0]:
            best = this
    if best is None or declared is None:
        return Scale({}, {}, {})
    for role, u in best[1].unit.items():
        was = look.channels[names[role]].unit
        if was and kind(was) in KINDS.get(role, KINDS["wheel"]) and not _same(u, was, role):
            warnings.append(f"{names[role]!r} is in {was}, the log says, but its size is that of {u}: {u} is proposed")
    return best[1]


def _same(a: str, b: str, role: str) -> bool:
    wanted = "rad/s" if role in ("wheel", "yaw_rate") else "rad" if role == "steer_angle" else "m/s2"
    x, y = factor(a, wanted, 1.0), factor(b, wanted, 1.0)
    # a rate of rolling and a speed are different units, though both become rates
    return x is not None and y is not None and abs(x / y - 1) < 1e-3 and kind(a) == kind(b)


def _per(role: str, unit: str, car: Any | None) -> float:
    """SI per unit; of wheels m/s."""
    if role == "wheel":
        return float(factor(unit, "m/s") or (factor(unit, "rad/s") or 1.0) * _radius(car))
    return float(factor(unit, "rad/s" if role == "yaw_rate" else "m/s2") or 1.0)


def _facts(look: Look, wheels: Mapping[str, str], chosen: Mapping[str, str], v: np.ndarray | None) -> dict[str, float]:
    """Slopes between the signals as they are logged; only those that show."""
    facts: dict[str, float] = {}
    if v is None:
        return facts
    facts["top"] = float(np.nanquantile(np.abs(v), 0.99))
    r = look.x[chosen["yaw_rate"]] if "yaw_rate" in chosen else None
    if r is not None and "accel_y" in chosen:
        found = fit(v * r, look.x[chosen["accel_y"]])
        if abs(found.corr) > TURNED:
            facts["accel_y"] = abs(found.slope)
        facts["accel_y_corr"] = found.corr
    turn = _turn(look, wheels)
    if r is not None and turn is not None:
        found = fit(r, turn)
        if abs(found.corr) > TURNED:
            facts["track"] = abs(found.slope)
        facts["track_corr"] = found.corr
    if "accel_x" in chosen:
        found = fit(physics.derivative(v), look.x[chosen["accel_x"]])
        if abs(found.corr) > 0.8:
            facts["accel_x"] = abs(found.slope)
        facts["accel_x_corr"] = found.corr
    ground = _ground(look, wheels)
    if ground is not None:
        found = fit(v, ground)
        if found.corr > 0.98:
            facts["speed"] = float(np.nanmedian((ground / v)[v > 0.3 * np.nanmax(v)]))
    return facts


def _ground(look: Look, wheels: Mapping[str, str]) -> np.ndarray | None:
    """Speed over ground that the log has besides, m/s, in a known unit; of a receiver of GNSS before others."""
    named = [
        n
        for n in look.x
        if kind(look.channels[n].unit) == "speed" and score("speed", n) >= NAMED and n not in wheels.values()
    ]
    named.sort(key=lambda n: (bool(re.search(r"gps|gnss|ground", text_of(n))), score("speed", n)))
    if named:
        return look.x[named[-1]] * float(factor(look.channels[named[-1]].unit, "m/s") or 1.0)
    at = {role: max(((score(role, n), n) for n in look.x), default=(0.0, "")) for role in ("latitude", "longitude")}
    if all(w >= 2.0 for w, _ in at.values()):
        lat, lon = (look.x[at[role][1]] for role in ("latitude", "longitude"))
        if np.nanmax(np.abs(lat)) <= 90 and np.nanmax(np.abs(lon)) <= 180:
            return smoothed(physics.haversine(lat, lon))
    return None


def _cost(
    facts: Mapping[str, float], unit: Mapping[str, str], per: Mapping[str, float], car: Any | None
) -> tuple[float, dict[str, float]]:
    """How far a set of units is from what physics wants, in squared sd, and the figures themselves."""
    v, r, ay, ax = (per.get(k, 1.0) for k in ("wheel", "yaw_rate", "accel_y", "accel_x"))
    rolling = unit.get("wheel", "") and factor(unit["wheel"], "m/s") is None
    loose = RADIUS_SD if rolling and car is None else 0.02 if rolling else 0.0
    figures = {}
    cost = 0.0
    for name, factor_, sd, wanted in (
        ("accel_y", ay / (v * r), 0.07, 1.0),
        ("accel_x", ax / v, 0.12, 1.0),
        ("track", v / r, TRACK_SD, TRACK),
        ("speed", 1.0 / v, 0.03, 1.0),
    ):
        if name in facts:
            figures[name] = facts[name] * factor_
            off = np.log(figures[name] / wanted) / np.hypot(sd, loose)
            cost += float(min(off**2, CLIP))
    top = facts.get("top", 20.0 / v) * v
    cost += 4.0 * (top > 75.0) + 4.0 * (top < 3.0)
    return cost, figures


# ---- the guesses in words


def _guesses(
    look: Look,
    wheels: Mapping[str, str],
    chosen: Mapping[str, str],
    worth: Mapping[str, Mapping[str, float]],
    scale: Scale,
    car: Any | None,
    warnings: list[str],
) -> list[Guess]:
    found: dict[str, Guess] = {}
    facts = _facts(look, wheels, chosen, _speed(look, wheels, chosen))
    v = None
    if wheels:
        v = mean_of([look.x[n] for n in wheels.values()]) * scale.per["wheel"]
    # the sign of the yaw rate is told by the wheels, where it is told; the others follow it
    sign = {
        "yaw_rate": float(np.sign(facts.get("track_corr", 0.0))) if abs(facts.get("track_corr", 0.0)) > 0.7 else 1.0
    }
    sided = abs(facts.get("track_corr", 0.0)) > 0.7
    sign["accel_y"] = sign["yaw_rate"] * (
        float(np.sign(facts["accel_y_corr"])) if abs(facts.get("accel_y_corr", 0.0)) > 0.7 else 1.0
    )
    sign["accel_x"] = float(np.sign(facts["accel_x_corr"])) if abs(facts.get("accel_x_corr", 0.0)) > 0.5 else 1.0
    for role in ("yaw_rate", "accel_y", "accel_x"):
        if role in chosen:
            found[role] = _guess(look, role, chosen[role], worth[role], scale, sign[role], facts, sided, warnings)
    if "steer_angle" in chosen:
        r = look.x[chosen["yaw_rate"]] * scale.per["yaw_rate"] * sign["yaw_rate"] if "yaw_rate" in chosen else None
        found["steer_angle"] = _steer(look, chosen["steer_angle"], worth["steer_angle"], v, r, car, warnings)
    for axle in AXLES:
        mine = [wheels[f"{axle}_{s}"] for s in ("left", "right") if f"{axle}_{s}" in wheels] or (
            [wheels[axle]] if axle in wheels else []
        )
        if mine:
            found[f"wheel_speed_{axle}"] = _wheel(look, axle, mine, wheels, scale, facts)
    _latencies(look, found, wheels, scale, sign)
    _odd(look, found, chosen, scale, sign, v, warnings)
    order = ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")
    return [found[c] for c in order if c in found]


def _from(look: Look, name: str, unit: str, role: str) -> str:
    c = look.channels[name]
    if c.unit and _same(c.unit, unit, role):
        return "the log says so"
    end = unit_at_end(c.short)
    return "the name ends so" if end and _same(end, unit, role) else "its size says so"


def _confidence(said: float, shown: float) -> str:
    """Sure: name and physics agree. Likely: one of them is clear."""
    if said >= NAMED and shown >= 2.5:
        return "sure"
    return "likely" if (said >= 2.5 and shown > -1.0) or shown >= 3.0 else "unsure"


def _guess(
    look: Look,
    role: str,
    name: str,
    worth: Mapping[str, float],
    scale: Scale,
    sign: float,
    facts: Mapping[str, float],
    sided: bool,
    warnings: list[str],
) -> Guess:
    unit = scale.unit[role]
    figures = []
    what = {"accel_y": "a_y over v r", "accel_x": "a_x over dv/dt of the wheels"}
    if role in what and role in scale.figures:
        figures.append(
            f"{what[role]}: {sign * abs(scale.figures[role]) if role == 'accel_x' else scale.figures[role]:.2f}, correlation "
            f"{abs(facts[f'{role}_corr']):.3f}"
        )
    elif role in what:
        figures.append(f"{what[role]}: the log shows too little (correlation {facts.get(f'{role}_corr', 0.0):.2f})")
    if role == "yaw_rate":
        if "track" in scale.figures:
            figures.append(
                f"right less left wheels: {scale.figures['track']:.2f} m of track, correlation {facts['track_corr']:.3f}"
            )
        if "accel_y" in scale.figures:
            figures.append(
                f"a_y over v r: {scale.figures['accel_y']:.2f}, correlation {abs(facts['accel_y_corr']):.3f}"
            )
        if not sided:
            figures.append("which way is positive shows in no wheel: ISO 8855 is taken, positive to the left")
    confidence = _confidence(worth["said"], worth["shown"])
    guess = Guess(role, (name,), unit, _from(look, name, unit, role), sign, confidence=confidence, figures=figures)
    if sign < 0:
        guess.figures.append({"yaw_rate": "positive to the right in the log", "accel_y": "positive to the right in the log",
                              "accel_x": "positive backwards in the log"}[role])  # fmt: skip
    other = {"accel_x": "accel_y", "accel_y": "accel_x"}.get(role)
    if other and score(other, name) > score(role, name) + 0.5:
        warnings.append(f"{name!r} sounds like {other}, and behaves like {role}: are the axes of the IMU swapped?")
    return guess


def _steer(
    look: Look,
    name: str,
    worth: Mapping[str, float],
    v: np.ndarray | None,
    r: np.ndarray | None,
    car: Any | None,
    warnings: list[str],
) -> Guess:
    wheelbase = float(car.values["lf"] + car.values["lr"]) if car is not None else USUAL_WHEELBASE
    unit = look.channels[name].unit or unit_at_end(look.channels[name].short)
    unit = unit if kind(unit) == "angle" else ""
    told = car.steering_ratio if car is not None else None
    found = physics.steering(look.x[name], v, r) if v is not None and r is not None else None
    guess = Guess("steer_angle", (name,), unit or "deg", "", confidence=_confidence(worth["said"], worth["shown"]))
    if found is None or found.share < 0.5 or found.per_curvature == 0:
        guess.unit_from = "the log says so" if unit else "a guess: the log turns too little to tell"
        guess.ratio = told
        guess.confidence = "unsure"
        guess.figures.append("the log turns too little to test sign and ratio")
        return guess
    guess.sign = float(np.sign(found.per_curvature))
    raw = abs(found.per_curvature) / wheelbase  # of the signal's unit per rad of the road wheels
    options = [(u, raw * float(factor(u, "rad") or 1.0)) for u in ([unit] if unit else UNITS["steer_angle"])]
    spread = float(np.hypot(found.sd, 0.05 if car is not None else 0.08))
    likely = [
        (
            min(
                abs(np.log(q)) / spread,
                abs(np.log(q / (told or USUAL_RATIO))) / np.hypot(spread, 0.02 if told else 0.15),
            ),
            u,
            q,
        )
        for u, q in options
    ]
    off, guess.unit, ratio = min(likely)
    guess.unit_from = _from(look, name, guess.unit, "steer_angle")
    if unit and off > 3.0:  # the unit that is said makes no sense
        other = "rad" if _same(unit, "deg", "steer_angle") else "deg"
        q = raw * float(factor(other, "rad") or 1.0)
        if min(abs(np.log(q)), abs(np.log(q / (told or USUAL_RATIO)))) / spread < 1.5:
            warnings.append(
                f"{name!r} is in {unit}, the log says, but its size is that of {other}: {other} is proposed"
            )
            guess.unit, ratio, guess.unit_from = other, q, "its size says so"
    guess.ratio = None if abs(np.log(ratio)) < abs(np.log(ratio / USUAL_RATIO)) else ratio
    if guess.ratio is None:
        guess.figures.append(
            f"angle over r L/v: {ratio:.2f}, so it is that of the road wheels ({100 * found.share:.0f} % of its variance)"
        )
    else:
        base = f"a wheelbase of {wheelbase:g} m{'' if car is not None else ' (a guess: give --vehicle)'}"
        guess.figures.append(
            f"angle over r L/v: ratio {ratio:.1f} (sd {ratio * spread:.1f}) with {base}, {100 * found.share:.0f} % of its variance"
        )
        if told is None:  # what cars have counts as much as it is sure
            weight = USUAL_RATIO_SD**-2 / (USUAL_RATIO_SD**-2 + spread**-2)
            guess.ratio = float(np.exp((1 - weight) * np.log(ratio) + weight * np.log(USUAL_RATIO)))
        guess.ratio = round(guess.ratio, 2)
        if told is not None and abs(np.log(ratio / told)) < 2.5 * spread:
            guess.figures.append(f"the vehicle file says {told:g}, which is taken")
            guess.ratio = told
        elif told is None and spread > 0.12:
            guess.confidence = min(guess.confidence, "likely", key=("unsure", "likely", "sure").index)
        elif told is not None:
            warnings.append(f"steer_angle: the ratio is {ratio:.1f} by r L/v, the vehicle file says {told:g}")
    if guess.sign < 0:
        guess.figures.append("positive to the right in the log")
    offset = found.offset * float(factor(guess.unit, "rad") or 1.0) / (guess.ratio or 1.0)
    if abs(offset) > 0.003:
        guess.figures.append(f"straight on it shows {found.offset:.3g} {guess.unit}")
    return guess


def _wheel(
    look: Look, axle: str, mine: list[str], wheels: Mapping[str, str], scale: Scale, facts: Mapping[str, float]
) -> Guess:
    unit = scale.unit["wheel"]
    figures = []
    others = [n for n in wheels.values() if n not in mine]
    if others:
        a, b = (mean_of([look.x[n] for n in part]) for part in (mine, others))
        fast = a > 0.3 * np.nanmax(a)
        if fast.any():
            figures.append(f"{axle} over the other axle: {float(np.nanmedian((a / b)[fast])):.3f}")
    if "speed" in scale.figures:
        figures.append(f"the log's own speed over theirs: {scale.figures['speed']:.3f}")
    if factor(unit, "m/s") is None and "accel_y" in scale.figures:
        figures.append(f"a_y over v r: {scale.figures['accel_y']:.2f}")
    if len(mine) == 2 and "track" in scale.figures:
        figures.append(f"right less left over the yaw rate: {scale.figures['track']:.2f} m")
    named = all(place_of(n)[0].startswith(axle) for n in mine)
    agree = not others or "track" in scale.figures or "speed" in scale.figures or "accel_y" in scale.figures
    if not named:
        figures.append(
            "no name says which wheel it is: left and right are by the yaw rate, front and rear by their order"
        )
    confidence = "sure" if named and agree and len(wheels) > 1 else "likely" if named else "unsure"
    return Guess(
        f"wheel_speed_{axle}",
        tuple(mine),
        unit,
        _from(look, mine[0], unit, "wheel"),
        confidence=confidence,
        figures=figures,
    )


def _latencies(
    look: Look, found: dict[str, Guess], wheels: Mapping[str, str], scale: Scale, sign: Mapping[str, float]
) -> None:
    """How much later than the gyro wheels and accelerometers are logged. The steering's shows only beside a model of the car:
    calibrate."""
    if "yaw_rate" not in found:
        return
    clock = found["yaw_rate"].name[0]
    r = look.x[clock] * scale.per["yaw_rate"] * sign["yaw_rate"]
    keep = np.isfinite(r)
    if "rear_left" in wheels:
        difference = (look.x[wheels["rear_right"]] - look.x[wheels["rear_left"]]) * scale.per["wheel"]
        v = mean_of([look.x[n] for n in wheels.values()]) * scale.per["wheel"]
        late, sd = physics.lag(r, difference, keep & (v > MOVING))
        for axle in AXLES:
            _late(look, found.get(f"wheel_speed_{axle}"), clock, late, sd, "right less left wheels against the gyro")
    if "accel_y" in found and wheels:
        v = mean_of([look.x[n] for n in wheels.values()]) * scale.per["wheel"]
        slope = physics.derivative(r)
        # the body's own way of following, (c0 + c2 v^2) r', is no latency
        late, sd = _lag_of_accel(look, found["accel_y"], v, r, slope, scale, sign, keep)
        _late(look, found["accel_y"], clock, late, sd, "a_y against v r, the body's own part taken out")


def _lag_of_accel(
    look: Look,
    g: Guess,
    v: np.ndarray,
    r: np.ndarray,
    slope: np.ndarray,
    scale: Scale,
    sign: Mapping[str, float],
    keep: np.ndarray,
) -> tuple[float, float]:
    y = look.x[g.name[0]] * scale.per["accel_y"] * sign["accel_y"]
    return physics.lag(v * r, y, keep & (v > MOVING), (slope, v**2 * slope))


def _late(look: Look, guess: Guess | None, clock: str, late: float, sd: float, how: str) -> None:
    if guess is None or not np.isfinite(sd):
        return
    together = look.channels[guess.name[0]].time is look.channels[clock].time
    if abs(late) > max(LEAST_LATENCY, FOUND * sd) and abs(late) < 0.3 and sd < 0.02:
        guess.figures.append(f"{1e3 * late:.0f} ms (sd {1e3 * sd:.0f}) behind the yaw rate: {how}")
        if not together or abs(late) > 2 * LEAST_LATENCY:
            guess.latency = round(late, 4)


def _odd(
    look: Look,
    found: Mapping[str, Guess],
    chosen: Mapping[str, str],
    scale: Scale,
    sign: Mapping[str, float],
    v: np.ndarray | None,
    warnings: list[str],
) -> None:
    """What is right perhaps, and should be looked at."""
    if v is None:
        return
    r = look.x[chosen["yaw_rate"]] * scale.per["yaw_rate"] * sign["yaw_rate"] if "yaw_rate" in chosen else None
    for role, kinematic in (("accel_y", v * r if r is not None else None), ("accel_x", physics.derivative(v))):
        if role not in found or kinematic is None:
            continue
        left = look.x[found[role].name[0]] * scale.per[role] * sign[role] - kinematic
        offset = float(np.nanmedian(left)) if np.isfinite(left).any() else 0.0
        if 8.5 < abs(offset) < 11:
            warnings.append(
                f"{found[role].name[0]!r} holds gravity ({offset:.2f} m/s2 more than {role} should): it is the vertical axis, or "
                f"the IMU stands on edge"
            )
        elif abs(offset) > 0.7:
            warnings.append(
                f"{role}: {offset:+.2f} m/s2 more than the kinematics say, on average: mounting or a road that leans; the "
                f"estimator finds it"
            )
        else:
            found[role].figures.append(f"offset {offset:+.2f} m/s2")
    if "accel_y" in scale.figures and not 0.8 < scale.figures["accel_y"] < 1.25:
        warnings.append(
            f"a_y is {scale.figures['accel_y']:.2f} times v r in the units that fit best: one of the three is not what it is taken "
            f"for"
        )
    if "track" in scale.figures and not 1.1 < scale.figures["track"] < 2.1:
        warnings.append(
            f"right less left wheels say a track of {scale.figures['track']:.2f} m: radius, unit of the wheels or of the yaw rate "
            f"are off"
        )
