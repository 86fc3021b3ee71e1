"""For each channel that was not found in a log, list the signals whose name and unit fit
it best, and why each of them was rejected.

A role is the quantity that a channel needs. It has the name of the channel, e.g.
yaw_rate, but all wheel speeds have the same role, "wheel". A signal is rejected if its
values, unit, name or motion contradict the role, or if it is already proposed for another
channel.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from tse.channels import physics
from tse.channels.look import MIN_NAME_SCORE, ROLE_KINDS, Guess, Look
from tse.channels.physics import fit
from tse.channels.vocabulary import ROLE_WORDS, find_place, is_another_thing, score_name
from tse.channels.wheels import MIN_WHEEL_RATE, find_quaternions, is_rolling
from tse.log.units import unit_kind
from tse.readers.recording import Channel, Recording

MAX_CANDIDATES = 3  # max number of signals that are listed for one channel
MIN_VALUES = 4  # a signal with fewer values is rejected without a further test
# role, i.e. quantity that a signal may measure -> kind of its unit, as named in messages
WANTED_KIND = {
    "yaw_rate": "a rate",
    "accel_x": "an acceleration",
    "accel_y": "an acceleration",
    "steer_angle": "an angle",
    "wheel": "a speed or a rate",
}


def find_nearest_candidates(
    recording: Recording, look: Look, guesses: Sequence[Guess], missing: Sequence[str], v: np.ndarray | None
) -> dict[str, list[str]]:
    """Return the signals nearest to each missing channel, and why each was rejected.

    The nearest signals are the MAX_CANDIDATES signals with the highest scores of
    _score_candidate(). Signals with the score 0 are left out.

    Parameters
    ----------
    recording : Recording
        The log.
    look : Look
        The signals of the log, resampled to one raster.
    guesses : sequence of Guess
        The channels that were found.
    missing : sequence of str
        The channels that were not found.
    v : ndarray or None, (rows,)
        [m/s] Speed at the times of `look`. None: unknown.

    Returns
    -------
    dict of str to list of str
        For each missing channel a list of "signal: reason". If all signals have the score
        0, the list has one string that states this.
    """
    used = {n: g.channel for g in guesses for n in g.name}
    found: dict[str, list[str]] = {}
    for channel in missing:
        role = "wheel" if channel.startswith("wheel") else channel
        axle = channel.rpartition("_")[2] if role == "wheel" else ""
        worth = sorted(
            ((w, c.name) for c in recording if (w := _score_candidate(role, axle, c)) > 0), reverse=True
        )[:MAX_CANDIDATES]
        said = [
            f"{name}: {_explain_rejection(recording.channels[name], role, look, used, guesses, v)}"
            for _, name in worth
        ]
        found[channel] = said or ["no signal has a similar name or the unit of this channel"]
    return found


def _score_candidate(role: str, axle: str, c: Channel) -> float:
    """Return a score of how well the name and the unit of a signal fit a role, i.e. the
    quantity that a missing channel needs; 0: not at all.

    The score is that of the name, at most 3 (vocabulary.py), plus 1 if the unit fits. A
    signal whose name describes only another quantity has the score 0. For the role
    "wheel", a wheel of the wrong axle has the score 0. A speed signal whose name states
    no wheel has the score 0.6 if its unit fits, otherwise 0. `axle`: axle of the missing
    channel, "front" or "rear"; "" for other roles."""
    of_kind = unit_kind(c.unit) in ROLE_KINDS[role] and unit_kind(c.unit) != ""
    if role == "wheel":
        place, named = find_place(c.name)
        if place and not place.startswith(axle):
            return 0.0
        return named + of_kind if place else (0.6 * of_kind if score_name("speed", c.name) > 0 else 0.0)
    named = score_name(role, c.name)
    if named <= 0:  # 0.5 for a name with a word of the role and a word of a different quantity
        named = 0.5 if any(_match_patterns(role, c)) else 0.0
    return named + of_kind * (1.0 if named > 0 or not is_another_thing(role, c.name) else 0.0)


def _match_patterns(role: str, c: Channel) -> list[bool]:
    """Return for each pattern in ROLE_WORDS[role] whether the name of the signal `c` may
    match it, although the name also has a word for a different quantity.

    For a name that has such a word and matches a pattern with the score s, score_name()
    returns s - 4 or s - 4.2. So the name may match the pattern if the score of the name
    is negative and above s - 4.3."""
    return [
        score_name(role, c.name) > -4.0 + worth - 0.3 and score_name(role, c.name) < 0
        for _, worth in ROLE_WORDS[role]
    ]


def _explain_rejection(
    c: Channel, role: str, look: Look, used: Mapping[str, str], guesses: Sequence[Guess], v: np.ndarray | None
) -> str:
    """Return why a signal is rejected for a role: because it is proposed for another
    channel, because of its times, values, unit, rate or name, or because the kinematics
    contradict the role."""
    if c.name in used:
        return f"is proposed as {used[c.name]}"
    there = c.value[np.isfinite(c.value)]
    if len(there) < MIN_VALUES:
        return f"has {len(there)} values"
    if np.ptp(there) == 0:
        return f"is {there[0]:g} all the time"
    if c.name not in look.x:
        return (
            f"has only the values {there.min():g} and {there.max():g}: a switch"
            if len(np.unique(there[:100000])) == 2
            else "has no time"
        )
    x = look.x[c.name]
    if np.isfinite(x).sum() < physics.MIN_ROWS:
        times = c.time[np.isfinite(c.time)]
        if not len(times):
            return "has no time"
        begin, end = times[[0, -1]]
        others = f"{look.time[0]:.1f} .. {look.time[-1]:.1f} s"
        return f"its times ({begin:.1f} .. {end:.1f} s) do not overlap those of the other signals ({others})"
    unit = look.find_unit(c.name)
    if unit_kind(unit) not in ("", *ROLE_KINDS[role]):
        return f"its unit {unit} is not that of {WANTED_KIND[role]}"
    if role == "wheel":
        if not is_rolling(x):
            return "is often negative, unlike a wheel speed"
        if look.rate[c.name] < MIN_WHEEL_RATE:
            return (
                f"has only {look.rate[c.name]:.2g} new values per second; a wheel speed needs "
                f"{MIN_WHEEL_RATE:g}"
            )
        return "the other wheel of its axle, or the other axle, was not found"
    if c.name in find_quaternions(look):
        return "is a component of an attitude quaternion"
    if score_name(role, c.name) < 0:
        return "its name describes another quantity (a target, a status, an offset, ...)"
    if is_another_thing(role, c.name):
        return "its name describes another quantity"
    return _explain_by_physics(x, role, look, guesses, v, score_name(role, c.name))


def _explain_by_physics(
    x: np.ndarray, role: str, look: Look, guesses: Sequence[Guess], v: np.ndarray | None, named: float
) -> str:
    """Return which kinematic relation a signal contradicts. If no relation could be
    tested, return why not.

    `x`: values of the signal. `v`: [m/s] speed; None: unknown. `named`: score of the name
    of the signal for the role."""
    if v is None:
        return "there is no speed to test it with" if named < MIN_NAME_SCORE else "another signal fits better"
    by = {g.channel: look.x[g.name[0]] for g in guesses if len(g.name) == 1}
    moving = np.where(np.abs(v) > physics.MOVING_SPEED, v, np.nan)
    pairs = {
        "yaw_rate": ("accel_y", "accel_y over speed", lambda o: o / moving),
        "accel_y": ("yaw_rate", "speed times yaw rate", lambda o: v * o),
        "steer_angle": ("yaw_rate", "yaw rate over speed", lambda o: o / moving),
    }
    if role == "accel_x":
        corr = abs(fit(physics.differentiate(v), x).corr)
        return f"does not follow the change of speed (correlation {corr:.2f})"
    other, words, made = pairs[role]
    if other not in by:
        return f"there is no {other} to test it with, and its name is not clear"
    return f"does not follow {words} (correlation {abs(fit(made(by[other]), x).corr):.2f})"
