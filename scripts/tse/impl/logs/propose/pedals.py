"""Brake switch or pressure, and wheel torques: by name and unit, and by what the speed does meanwhile."""

from __future__ import annotations

import re

import numpy as np

from tse.impl.logs import physics
from tse.impl.logs.propose.look import Guess, Look
from tse.impl.logs.raster import resample
from tse.impl.logs.recording import Channel, Recording
from tse.impl.logs.units import kind
from tse.impl.logs.vocabulary import text_of

BRAKE = re.compile(r"\b(brake?|brk|brems|frein|freno|bls)")
NO_BRAKE = re.compile(
    r"\b(park|hand|epb|fest|fault|fail|fehler|temp|wear|req|soll|target|aeb|valid|qual|count|torque|trq|moment|assist)"
)
WHEEL, MOMENT = r"\b(wheel|whl|axle|achs\w*|rad|roue|ruota|rueda)\b", r"\b(torque|trq|tq|moment)"
TORQUE = re.compile(f"{WHEEL}.*{MOMENT}|{MOMENT}.*{WHEEL}")
OTHER_TORQUE = re.compile(r"left|right|links|rechts|soll|req|target")
AXLE = {"front": re.compile(r"\b(front|vorne?|va|avant|frnt)\b"), "rear": re.compile(r"\b(rear|hinten|ha|arriere)\b")}
SLOWS = 0.7  # m/s2 that the car must lose more while it brakes than while it does not
FROM, TOP = 0.03, 0.995  # a pressure is one from this share of its largest values (quantile)


def find_pedals(recording: Recording, look: Look, v: np.ndarray | None) -> list[Guess]:
    """Return the guesses. v: speed on the raster of `look`, m/s; None: not known."""
    found = [g for c in recording if (g := _brake(c, look, v)) is not None]
    best = sorted(found, key=lambda g: (len(g.unsure), g.above is not None))[:1]
    return [*best, *(g for a in AXLE if (g := _torque(recording, a)) is not None)]


def _brake(c: Channel, look: Look, v: np.ndarray | None) -> Guess | None:
    """Return the guess that a signal is the brake's; None where its name is another, or the car does not slow by it."""
    name, x = text_of(c.short), c.value[np.isfinite(c.value)]
    if not BRAKE.search(name) or NO_BRAKE.search(name) or len(x) < physics.FEWEST or np.ptp(x) == 0:
        return None
    switch = set(np.unique(x)) <= {0.0, 1.0}
    above = None if switch else float(f"{FROM * np.quantile(x, TOP):.2g}")
    if above is not None and (above <= 0 or (not c.unit and not re.search(r"press|druck|pedal", name))):
        return None
    guess = Guess(
        "brake",
        (c.name,),
        "1" if switch or not c.unit else c.unit,
        "0 and 1" if switch else "the log says so",
        above=above,
    )
    if above is not None:
        guess.figures.append(f"a pressure or a pedal: the car brakes above {100 * FROM:g} % of its large values")
    good = np.isfinite(c.value)
    on = resample(c.time[good], 1.0 * (c.value[good] > (above or 0.5)), look.time, physics.RATE) > 0.5
    moving = np.abs(v) > physics.MOVING if v is not None else np.zeros(len(on), bool)
    if v is None or min((moving & on).sum(), (moving & ~on).sum()) < physics.FEWEST:
        guess.unsure = ["the signal, by its name alone"]
        return guess
    rate = physics.derivative(v)
    gains = [float(np.nanmean(rate[moving & rows])) for rows in (on, ~on)]
    if gains[0] > gains[1] - SLOWS:
        return None
    guess.confidence = "sure"
    guess.figures.append(f"the speed changes by {gains[0]:.2f} m/s2 while it is on, by {gains[1]:+.2f} while it is off")
    return guess


def _torque(recording: Recording, axle: str) -> Guess | None:
    """Return the guess of an axle's wheel torque, by name and unit; the run compares it with mass times accel_x."""
    for c in recording:
        name = text_of(c.short)
        named = TORQUE.search(name) and AXLE[axle].search(name) and not OTHER_TORQUE.search(name)
        if named and kind(c.unit) == "torque":
            guess = Guess(f"wheel_torque_{axle}", (c.name,), c.unit, "the log says so")
            guess.figures.append("by its name and unit: drive less brake torque of both wheels is needed")
            guess.unsure.append("the signal, by its name alone")
            return guess
    return None
