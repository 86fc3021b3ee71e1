"""Find the signals of wheel speeds, motion, brake and wheel torques in a log.

The evidence is the name and unit of each signal, and the kinematics of the car.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import product

import numpy as np

from tse.channels import physics
from tse.channels.look import MIN_NAME_SCORE, MIN_PROOF_CORR, ROLE_KINDS, WHEEL_PLACES, Guess, Look
from tse.channels.physics import average, fit
from tse.channels.raster import resample
from tse.channels.vocabulary import (
    AXLES,
    NO_WHEEL_WORDS,
    find_place,
    is_another_thing,
    join_words,
    score_name,
)
from tse.log.units import unit_kind
from tse.readers.recording import Channel, Recording, last_part

# [Hz] min rate of a wheel speed, and of a speed of the car that replaces missing wheel
# speeds. The speed of a GNSS receiver at 1 Hz is too slow to resolve braking.
MIN_WHEEL_RATE = 5.0


def find_wheels(look: Look) -> dict[str, str]:
    """Return a dict with the signal of each wheel speed: place (front_left, ...) -> name.

    If the log has speeds of axles instead of wheels, the places are "front" and "rear".
    Signals with similar names, or in the same message, are grouped into sets. The score
    of a set depends on its completeness, its names, and the correlation of its signals.
    The set with the highest score is returned."""
    groups: dict[str, dict[str, tuple[float, str]]] = {}
    for name in look.x:
        place, worth = find_place(name)
        if (
            not place
            or worth <= 0
            or unit_kind(look.find_unit(name)) not in ("", *ROLE_KINDS["wheel"])
            or not is_rolling(look.x[name])
        ):
            continue
        worth += unit_kind(look.find_unit(name)) in ROLE_KINDS["wheel"]
        stem = name.replace("/", ".").rpartition(".")[0]
        for key in (
            f"{len(join_words(name).split())} {look.find_unit(name)} {_strip_place(name)}",
            f"message {stem} {look.find_unit(name)}",
        ):
            best = groups.setdefault(key, {}).get(place)
            if best is None or worth > best[0]:
                groups[key][place] = worth, name
    found, best = {}, 0.0
    for group in groups.values():
        for places in (WHEEL_PLACES, AXLES):
            mine = {p: group[p] for p in places if p in group}
            pairs = len(mine) == len(places) or any(
                all(f"{a}_{s}" in mine for s in ("left", "right")) for a in AXLES
            )
            value = (
                len(mine) * 2.0
                + sum(w for w, _ in mine.values()) / max(len(mine), 1)
                + 3.0 * (len(mine) == 4)
                + _compare_motion(look, [n for _, n in mine.values()])
            )
            if pairs and len({n for _, n in mine.values()}) == len(mine) and value > best:
                found, best = {p: n for p, (_, n) in mine.items()}, value
    if "front_left" in found or "rear_left" in found:
        for axle in AXLES:  # if only one wheel of an axle is found, it is not used
            if sum(f"{axle}_{s}" in found for s in ("left", "right")) == 1:
                found = {p: n for p, n in found.items() if not p.startswith(axle)}
    return found or _find_nameless_wheels(look)


def _strip_place(name: str) -> str:
    """Return the last part of a name, with the words for a place replaced by *.

    Words for a place are front, left, fl, ... The names of the four wheel speeds of a car
    thus become equal, and find_wheels() groups signals with equal names."""
    text = join_words(last_part(name))
    return re.sub(
        r"\b(fl|fr|rl|rr|vl|vr|hl|hr|lf|rf|lr|front|rear|left|right|vorne?|hinten|links|rechts|"
        r"[a-z]?[fvhrl]{2})\b",
        "*",
        text,
    ).replace("* *", "*")


def is_rolling(x: np.ndarray) -> bool:
    """Return whether a signal may be a speed: rarely below 0, and not constant."""
    good = x[np.isfinite(x)]
    return (
        len(good) > 10
        and float(np.mean(good < -0.02 * np.max(np.abs(good)))) < 0.05
        and float(np.ptp(good)) > 0
    )


def _compare_motion(look: Look, names: list[str]) -> float:
    """Return a score, 0 .. 2, of how well signals agree as wheel speeds of the same car.

    The score is 2 x the min correlation of the signals with the first of them. For wheel
    speeds of the same car, it is nearly 2."""
    if len(names) < 2:
        return 0.0
    first = look.x[names[0]]
    return 2.0 * min(max(fit(first, look.x[n]).corr, 0.0) for n in names[1:])


def _find_nameless_wheels(look: Look) -> dict[str, str]:
    """Return four signals that may be wheel speeds, as place -> name; {}: no such
    signals.

    The names do not show that the signals are wheel speeds. But the signals have the same
    unit, and their values differ by a few percent only. The places (WHEEL_PLACES) follow
    the order in the file. find_sides() later finds the left and right wheels by the yaw
    rate."""
    rolling = [
        n
        for n in look.x
        if is_rolling(look.x[n])
        and unit_kind(look.find_unit(n)) in ("", *ROLE_KINDS["wheel"])
        and not NO_WHEEL_WORDS.search(join_words(n))
    ]
    for first in rolling:
        same = [
            n
            for n in rolling
            if look.find_unit(n) == look.find_unit(first) and _is_same_size(look.x[first], look.x[n])
        ]
        distinct: list[str] = []
        for n in same:
            if all(
                np.nanmax(np.abs(look.x[n] - look.x[d])) > 1e-6 * np.nanmax(np.abs(look.x[n]))
                for d in distinct
            ):
                distinct.append(n)
        if len(distinct) == 4:
            return dict(zip(WHEEL_PLACES, distinct, strict=True))
    return {}


def _is_same_size(a: np.ndarray, b: np.ndarray) -> bool:
    """Return whether the ratio of two signals is near 1 and almost constant."""
    keep = np.isfinite(a) & np.isfinite(b) & (np.abs(a) > 0.3 * np.nanmax(np.abs(a)))
    if keep.sum() < physics.MIN_ROWS:
        return False
    part = b[keep] / a[keep]
    return bool(abs(np.median(part) - 1) < 0.05 and np.std(part) < 0.03)


def compute_speed(look: Look, wheels: Mapping[str, str]) -> np.ndarray | None:
    """Return the mean of the wheel speeds, in the unit of the log.

    Without wheel speeds, return the signal whose name describes the speed of the car.
    Return None if the log has no such signal either."""
    if wheels:
        return average([look.x[n] for n in wheels.values()]) if len(look.time) else None
    name = find_named_speed(look)
    return look.x[name] if name else None


def find_speed(look: Look) -> dict[str, str]:
    """Return {"rear": name of the signal with the car's speed}; {} if no signal has it.

    This speed replaces missing wheel speeds. It is assigned to the rear axle only. When
    the log is read, the front axle, which has no signal, gets the same speed. Both axles
    then have equal speeds, so slip cannot be computed."""
    name = find_named_speed(look, MIN_WHEEL_RATE)
    return {"rear": name} if name else {}


def is_car_speed(wheels: Mapping[str, str]) -> bool:
    """Return whether `wheels` is a result of find_speed(), i.e. has the speed of the car
    instead of the speeds of wheels. Only find_speed() returns a single signal."""
    return len(wheels) == 1


def find_named_speed(look: Look, slowest: float = 0.0) -> str:
    """Return the name of the signal that is most probably the speed of the car, judged by
    names. Return "" if no name describes this speed.

    `slowest`: min rate of the signal, Hz."""
    named = sorted(
        (score_name("speed", look.clean_name(n)) + (unit_kind(look.find_unit(n)) == "speed"), n)
        for n in look.x
        if look.rate[n] >= slowest and unit_kind(look.find_unit(n)) in ("", "speed") and is_rolling(look.x[n])
    )
    return named[-1][1] if named and named[-1][0] >= MIN_NAME_SCORE else ""


def is_sided(wheels: Mapping[str, str]) -> bool:
    """Return whether the names of the wheel speeds state the wheel, e.g. front left."""
    return bool(wheels) and bool(find_place(next(iter(wheels.values())))[0])


def find_turn(look: Look, wheels: Mapping[str, str]) -> np.ndarray | None:
    """Return right minus left wheel speed of an axle, which is proportional to yaw rate.

    The rear axle is preferred. Return None if no axle has signals of both wheels, or if
    the names of the wheel speeds do not state the places of the wheels."""
    if not is_sided(wheels):
        return None
    for axle in ("rear", "front"):
        left, right = wheels.get(f"{axle}_left"), wheels.get(f"{axle}_right")
        if left and right:
            return look.x[right] - look.x[left]
    return None


def find_sides(look: Look, wheels: dict[str, str], chosen: Mapping[str, str]) -> dict[str, str]:
    """Assign places to four wheel speeds whose names do not state them.

    The two wheels that are slower in left turns are the left wheels. The logged yaw rate
    is taken as positive to the left. Of the two wheels of a side, the one that is first
    in the file is taken as the front wheel."""
    if not wheels or is_sided(wheels) or "yaw_rate" not in chosen or "front_left" not in wheels:
        return wheels
    r, mean = look.x[chosen["yaw_rate"]], average([look.x[n] for n in wheels.values()])
    order = sorted(wheels.values(), key=lambda n: fit(r, look.x[n] - mean).corr)
    left = [n for n in wheels.values() if n in order[:2]]
    right = [n for n in wheels.values() if n in order[2:]]
    return {"front_left": left[0], "front_right": right[0], "rear_left": left[1], "rear_right": right[1]}


# ---- Find yaw rate, accelerations and steering angle by name, unit and kinematics.

# Role, i.e. quantity that a signal may measure -> neutral correlation [1]. Kinematics
# predict the quantity from other channels, e.g. accel_x from dv/dt. If a signal and the
# prediction have a higher correlation, the score of the signal for the role increases. If
# they have a lower one, it decreases. Roles that are not listed have the neutral
# correlation 0.75. That of accel_x is lower, since dv/dt is noisy and the grade of the
# road adds to accel_x.
NEUTRAL_CORR = {"accel_x": 0.68}
MAX_PHYSICS_SCORE = 4.0  # max magnitude of the score by physics, see _score_by_physics()
MOTION_ROLES = ("yaw_rate", "accel_y", "accel_x", "steer_angle")


def find_roles(
    look: Look, wheels: Mapping[str, str], v: np.ndarray | None, before: Mapping[str, str]
) -> tuple[dict[str, str], dict[str, dict[str, float]]]:
    """Assign signals to the roles of MOTION_ROLES.

    Parameters
    ----------
    look : Look
        The log.
    wheels : mapping of str to str
        Place of each wheel -> name of its signal.
    v : ndarray or None, (rows,)
        Speed in any unit. None: unknown.
    before : mapping of str to str
        Role -> name of its signal, as found by the call before. _score_by_physics()
        correlates all signals with these. Empty in the first call, which uses the signals
        with the best names instead.

    Returns
    -------
    dict of str to str
        Role -> name of its signal.
    dict of str to dict of str to float
        Role -> the two scores of its signal: "said" by name and unit, "shown" by physics.
    """
    taken = set(wheels.values()) | find_quaternions(look)
    said = {
        role: {n: _score_by_name(look, role, n) for n in look.x if n not in taken} for role in MOTION_ROLES
    }
    ref = dict(before)
    if not ref:
        for role in MOTION_ROLES:
            best = max(said[role].items(), key=lambda i: i[1], default=("", 0.0))
            if best[1] >= MIN_NAME_SCORE:
                ref[role] = best[0]
        if v is not None and ("yaw_rate" not in ref or "accel_y" not in ref):
            ref |= _find_pair(look, v, taken, said, ref)
    total: dict[str, dict[str, float]] = {}
    shown: dict[str, dict[str, float]] = {}
    turn = find_turn(look, wheels)
    top = float(np.nanquantile(np.abs(v), 0.98)) if v is not None and np.isfinite(v).any() else 0.0
    # The fit of the steering angle needs the speed in m/s, but the unit of the speed is
    # not known yet. The speed is therefore scaled so that its 98 % quantile is 25 m/s.
    usual = None if v is None else v * (25.0 / top if top else 1.0)
    change = None if v is None else physics.differentiate(v)
    # Compute the score by physics only if its max, MAX_PHYSICS_SCORE, plus the score by
    # name can reach MIN_NAME_SCORE.
    for role in MOTION_ROLES:
        shown[role] = {
            n: _score_by_physics(look, role, n, v, usual, change, turn, ref)
            if w + MAX_PHYSICS_SCORE >= MIN_NAME_SCORE
            else 0.0
            for n, w in said[role].items()
        }
        total[role] = {n: said[role][n] + shown[role][n] for n in said[role]}
    found: dict[str, str] = {}
    pairs = sorted(((w, role, n) for role in MOTION_ROLES for n, w in total[role].items()), reverse=True)
    for w, role, n in pairs:  # the best pair first; each signal gets at most one role
        # A matching unit is not sufficient. In addition, the name must describe the role
        # (score by name 0.8 or more), or the signal must agree with other channels (score
        # by physics 2.5 or more).
        if (
            role not in found
            and n not in found.values()
            and w >= MIN_NAME_SCORE
            and (score_name(role, look.clean_name(n)) >= 0.8 or shown[role][n] >= 2.5)
            and not is_another_thing(role, look.clean_name(n))
        ):
            found[role] = n
    return found, {
        role: {"said": said[role].get(n, 0.0), "shown": shown[role].get(n, 0.0)} for role, n in found.items()
    }


def find_quaternions(look: Look) -> set[str]:
    """Return the components of attitude quaternions: names that end in x, y, z and w."""
    known = set(look.channels)
    stems = {n[:-1] for n in known if n[-2:] in (".w", "_w") and n[:-1] + "z" in known}
    return {n for n in known if n[:-1] in stems and n[-1] in "wxyz"}


def _score_by_name(look: Look, role: str, name: str) -> float:
    """Return the score of a signal for a role by name, unit and rate."""
    unit = unit_kind(look.find_unit(name))
    of_kind = 1.0 if unit in ROLE_KINDS[role] else (0.0 if unit == "" else -3.0)
    of_kind -= 3.0 * is_another_thing(role, look.clean_name(name))
    return score_name(role, look.clean_name(name)) + of_kind + 0.001 * min(look.rate[name], 100.0)


def _score_by_physics(
    look: Look,
    role: str,
    name: str,
    v: np.ndarray | None,
    usual: np.ndarray | None,
    change: np.ndarray | None,
    turn: np.ndarray | None,
    ref: Mapping[str, str],
) -> float:
    """Return the score of a signal for a role by its correlation with other channels.

    The score is in -MAX_PHYSICS_SCORE .. MAX_PHYSICS_SCORE. It is 0 if there is no
    channel to compare with. `v`: speed in any unit. `usual`: speed scaled to about m/s.
    `change`: derivative of `v`. `turn`: right minus left wheel speed. `ref`: role -> name
    of the signal to compare with."""
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
    elif role == "accel_x" and change is not None:
        said.append(abs(fit(change, x).corr))
    elif role == "steer_angle" and usual is not None:
        r = look.x[ref["yaw_rate"]] if "yaw_rate" in ref and ref["yaw_rate"] != name else turn
        if r is not None:
            found = physics.fit_steering(x, usual, r)
            said.append(np.sqrt(max(found.share, 0.0)) if found else 0.0)
    said = [s for s in said if s > 0]
    return (
        float(
            np.clip(
                16.0 * (np.mean(said) - NEUTRAL_CORR.get(role, 0.75)), -MAX_PHYSICS_SCORE, MAX_PHYSICS_SCORE
            )
        )
        if said
        else 0.0
    )


def _find_pair(
    look: Look,
    v: np.ndarray,
    taken: set[str],
    said: Mapping[str, Mapping[str, float]],
    ref: Mapping[str, str],
) -> dict[str, str]:
    """Return the two signals, as yaw_rate and accel_y, that best fit a_y = v r. Return {}
    if no pair has a score above MIN_PROOF_CORR.

    The score of a pair is the correlation of a_y and v r. Names and units that fit add at
    most 0.08 to it. If `ref` has one of the two signals, only the other is searched
    for. `taken`: names of wheel speeds and quaternions, which are not tried. `said`: role
    -> name of a signal -> score by name and unit."""
    free = [n for n in look.x if n not in taken and not is_rolling(look.x[n])]
    rates = [ref["yaw_rate"]] if "yaw_rate" in ref else [n for n in free if said["yaw_rate"][n] > -1]
    accels = [ref["accel_y"]] if "accel_y" in ref else [n for n in free if said["accel_y"][n] > -1]
    best, found = MIN_PROOF_CORR, {}
    for r, a in product(rates[:80], accels[:80]):
        if r == a:
            continue
        corr = abs(fit(v * look.x[r], look.x[a]).corr) + 0.01 * (said["yaw_rate"][r] + said["accel_y"][a])
        # r: candidate for the yaw rate, a: candidate for the lateral acceleration. If a
        # correlates better with r than with v r, reduce the score of the pair: r and a
        # may be swapped, or both may measure the same quantity.
        corr -= 0.5 * max(0.0, abs(fit(look.x[r], look.x[a]).corr) - abs(fit(v * look.x[r], look.x[a]).corr))
        if corr > best:
            best, found = corr, {"yaw_rate": r, "accel_y": a}
    return found


# ---- Find brake and wheel torques by name, unit and change of the speed.

BRAKE_NAME = re.compile(r"\b(brake?|brk|brems|frein|freno|bls)")
NO_BRAKE_NAME = re.compile(
    r"\b(park|hand|epb|fest|fault|fail|fehler|temp|wear|req|soll|target|aeb|valid|qual|count|"
    r"torque|trq|moment|assist)"
)
WHEEL_WORD = r"\b(wheel|whl|axle|achs\w*|rad|roue|ruota|rueda)\b"
MOMENT_WORD = r"\b(torque|trq|tq|moment)"
TORQUE_NAME = re.compile(f"{WHEEL_WORD}.*{MOMENT_WORD}|{MOMENT_WORD}.*{WHEEL_WORD}")
OTHER_TORQUE_NAME = re.compile(r"left|right|links|rechts|soll|req|target")
AXLE_NAME = {
    "front": re.compile(r"\b(front|vorne?|va|avant|frnt)\b"),
    "rear": re.compile(r"\b(rear|hinten|ha|arriere)\b"),
}
# [m/s2] A signal is accepted as the brake only if the mean of dv/dt in rows with the
# brake on is lower than in rows with the brake off, by at least this much.
MIN_BRAKING_LOSS = 0.7
# [1] The car is taken to brake if the brake pressure or pedal position exceeds
# PEDAL_SHARE x the PEDAL_QUANTILE quantile of its values.
PEDAL_SHARE, PEDAL_QUANTILE = 0.03, 0.995


def find_pedals(recording: Recording, look: Look, v: np.ndarray | None) -> list[Guess]:
    """Return the guesses (class Guess) of brake and wheel torques.

    If several signals may be the brake, only the one with the fewest unsure properties is
    returned. If several have equally few, a switch is preferred to a pressure or pedal
    position. `v`: speed at the times of `look`, m/s. None: unknown."""
    found = [g for c in recording if (g := _guess_brake(c, look, v)) is not None]
    best = sorted(found, key=lambda g: (len(g.unsure), g.above is not None))[:1]
    return [*best, *(g for a in AXLE_NAME if (g := _guess_torque(recording, a)) is not None)]


def _guess_brake(c: Channel, look: Look, v: np.ndarray | None) -> Guess | None:
    """Return the guess that a signal is the brake, or None if it is not.

    The name of the signal must be that of a brake. If the speed is known, the car must
    decelerate by MIN_BRAKING_LOSS more while the brake is on than while it is off."""
    name, x = join_words(c.short), c.value[np.isfinite(c.value)]
    if (
        not BRAKE_NAME.search(name)
        or NO_BRAKE_NAME.search(name)
        or len(x) < physics.MIN_ROWS
        or np.ptp(x) == 0
    ):
        return None
    switch = set(np.unique(x)) <= {0.0, 1.0}
    above = None if switch else float(f"{PEDAL_SHARE * np.quantile(x, PEDAL_QUANTILE):.2g}")
    if above is not None and (above <= 0 or (not c.unit and not re.search(r"press|druck|pedal", name))):
        return None
    guess = Guess(
        "brake",
        (c.name,),
        "1" if switch or not c.unit else c.unit,
        "0 and 1" if switch else "from the log",
        above=above,
    )
    if above is not None:
        guess.figures.append(
            f"a pressure or a pedal: the car brakes if it exceeds {100 * PEDAL_SHARE:g} % of its "
            f"{100 * PEDAL_QUANTILE:g} % quantile"
        )
    good = np.isfinite(c.value)
    on = (
        resample(c.time[good], 1.0 * (c.value[good] > (above or 0.5)), look.time, physics.COMPARISON_RATE)
        > 0.5
    )
    moving = np.abs(v) > physics.MOVING_SPEED if v is not None else np.zeros(len(on), bool)
    if v is None or min((moving & on).sum(), (moving & ~on).sum()) < physics.MIN_ROWS:
        guess.unsure = ["the signal, by its name alone"]
        return guess
    rate = physics.differentiate(v)
    gains = [float(np.nanmean(rate[moving & rows])) for rows in (on, ~on)]
    if gains[0] > gains[1] - MIN_BRAKING_LOSS:
        return None
    guess.confidence = "sure"
    guess.figures.append(
        f"the speed changes by {gains[0]:.2f} m/s2 while it is on, by {gains[1]:+.2f} while it is off"
    )
    return guess


def _guess_torque(recording: Recording, axle: str) -> Guess | None:
    """Return the guess of an axle's wheel torque by name and unit; None if no signal
    fits.

    The values are not tested here. agree.py later compares (torque / wheel radius) with
    mass x accel_x, and warns if they disagree."""
    for c in recording:
        name = join_words(c.short)
        named = (
            TORQUE_NAME.search(name) and AXLE_NAME[axle].search(name) and not OTHER_TORQUE_NAME.search(name)
        )
        if named and unit_kind(c.unit) == "torque":
            guess = Guess(f"wheel_torque_{axle}", (c.name,), c.unit, "from the log")
            guess.figures.append(
                "found by its name and unit; it must be drive minus brake torque, sum of both wheels"
            )
            guess.unsure.append("the signal, by its name alone")
            return guess
    return None
