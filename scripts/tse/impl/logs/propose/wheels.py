"""Which signals are wheels, on which side, and what they say of speed and turn."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from tse.impl.logs import physics
from tse.impl.logs.physics import fit, mean_of
from tse.impl.logs.propose.look import AXLES, KINDS, NAMED, WHEELS, Look
from tse.impl.logs.units import kind
from tse.impl.logs.vocabulary import NO_WHEEL, place_of, score, text_of

SLOWEST = 5.0  # Hz: a receiver of GNSS with one value a second misses what braking does


def find_wheels(look: Look) -> dict[str, str]:
    """Place -> name; of several sets the most complete one that behaves like wheels."""
    groups: dict[str, dict[str, tuple[float, str]]] = {}
    for name in look.x:
        place, worth = place_of(name)
        if not place or worth <= 0 or kind(look.unit(name)) not in ("", *KINDS["wheel"]) or not rolls(look.x[name]):
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


def rolls(x: np.ndarray) -> bool:
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
    rolling = [
        n
        for n in look.x
        if rolls(look.x[n]) and kind(look.unit(n)) in ("", *KINDS["wheel"]) and not NO_WHEEL.search(text_of(n))
    ]
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


def speed_of(look: Look, wheels: Mapping[str, str], chosen: Mapping[str, str]) -> np.ndarray | None:
    """The speed in whatever unit: of the wheels, or what is called one."""
    if wheels:
        return mean_of([look.x[n] for n in wheels.values()]) if len(look.time) else None
    name = named_speed(look)
    return look.x[name] if name else None


def find_speed(look: Look) -> dict[str, str]:
    """Without wheels: the car's speed in place of the rear axle, which drives or brakes less. The reader has it stand in for the
    front one as well, as for any axle that is not logged, and knows then that slip is not known."""
    name = named_speed(look, SLOWEST)
    return {"rear": name} if name else {}


def is_speed(wheels: Mapping[str, str]) -> bool:
    """Are these wheels the car's speed?"""
    return len(wheels) == 1


def named_speed(look: Look, slowest: float = 0.0) -> str:
    """What is called the speed of the car, and has at least so many values a second, Hz; "" where nothing is."""
    named = sorted(
        (score("speed", look.called(n)) + (kind(look.unit(n)) == "speed"), n)
        for n in look.x
        if look.rate[n] >= slowest and kind(look.unit(n)) in ("", "speed") and rolls(look.x[n])
    )
    return named[-1][1] if named and named[-1][0] >= NAMED else ""


def sided(wheels: Mapping[str, str]) -> bool:
    """Do the names say which wheel is left?"""
    return bool(wheels) and bool(place_of(next(iter(wheels.values())))[0])


def turn_of(look: Look, wheels: Mapping[str, str]) -> np.ndarray | None:
    """Right less left, of the axle behind if it is there: the yaw rate but for a factor. None: no pair, or no name says which is
    left."""
    if not sided(wheels):
        return None
    for axle in ("rear", "front"):
        left, right = wheels.get(f"{axle}_left"), wheels.get(f"{axle}_right")
        if left and right:
            return look.x[right] - look.x[left]
    return None


def find_sides(look: Look, wheels: dict[str, str], chosen: Mapping[str, str]) -> dict[str, str]:
    """Nameless wheels: those that are slower in a left turn are left; the first of each side is front."""
    if not wheels or sided(wheels) or "yaw_rate" not in chosen or "front_left" not in wheels:
        return wheels
    r, mean = look.x[chosen["yaw_rate"]], mean_of([look.x[n] for n in wheels.values()])
    order = sorted(wheels.values(), key=lambda n: fit(r, look.x[n] - mean).corr)
    left = [n for n in wheels.values() if n in order[:2]]
    right = [n for n in wheels.values() if n in order[2:]]
    return {"front_left": left[0], "front_right": right[0], "rear_left": left[1], "rear_right": right[1]}
