"""Find the signals that contain the velocities measured by an INS or optical sensor, and
the sign convention of each signal."""

import re
from collections.abc import Sequence

import numpy as np

from tse.channels import physics
from tse.channels.look import Guess, Look
from tse.channels.physics import MOVING_SPEED
from tse.channels.vocabulary import join_words
from tse.log.units import unit_factor, unit_kind

VELOCITY_NAMES = {
    "ins_vel_x": re.compile(
        r"\b(lo?n?g\w* ?(vel\w*|speed)|(vel\w*|speed) ?lo?n?g\w*|l(ä|ae)ngs ?geschw\w*)\b"
    ),
    "ins_vel_y": re.compile(
        r"\b(lat\w* ?(vel\w*|speed)|(vel\w*|speed) ?lat\w*|quer ?geschw\w*|vy|v y|vel\w* ?y)\b"
    ),
}
NO_VELOCITY_NAME = re.compile(
    r"acc\w*|target|soll|req\w*|limit|valid|qual\w*|status|std|sd\b|var\b|acc(uracy)?\b|wheel|whl|wind"
)
# The lateral velocity v_y, positive to the left, fulfils dv_y/dt = a_y - v r (v: speed,
# r: yaw rate). So if accel_y - v r is regressed on the derivative of a signal of v_y, the
# coefficient is positive if the signal is positive to the left, otherwise negative. The
# sign is certain if |coefficient| / (sd of the coefficient) is at least this.
MIN_SIGN_SDS = 6.0
# [1] A signal is not taken for a lateral velocity if |signal| / speed exceeds this in
# more than 2 % of the rows.
MAX_ACROSS = 0.35


def find_velocities(look: Look, guesses: Sequence[Guess], v: np.ndarray | None, format_: str) -> list[Guess]:
    """Return the guesses of ins_vel_x and ins_vel_y.

    Parameters
    ----------
    look : Look
        The log.
    guesses : sequence of Guess
        Guesses of the other channels, with unit and sign.
    v : ndarray or None, (rows,)
        Mean circumferential speed of the wheels, m/s. None: unknown, nothing is found.
    format_ : str
        Format of the log. In VBOX files, the lateral velocity is positive to the right.

    Returns
    -------
    list of Guess
        At most one guess for each velocity. A longitudinal velocity is only accepted if
        its median ratio to `v` is in 0.85 .. 1.18. A lateral velocity is only accepted if
        its sign follows from accel_y - v r (MIN_SIGN_SDS) or from the format.
    """
    taken = {n for g in guesses for n in g.name}
    found: list[Guess] = []
    if v is None:
        return found
    for channel, pattern in VELOCITY_NAMES.items():
        named = [n for n in look.x if n not in taken and _is_called(look, n, pattern)]
        made = [
            g
            for n in named
            if (g := _guess_velocity(look, channel, n, guesses, v, format_ == "VBOX")) is not None
        ]
        found += sorted(made, key=lambda g: len(g.unsure))[:1]
    return found


def _is_called(look: Look, name: str, pattern: re.Pattern[str]) -> bool:
    """Return whether a signal has the unit of a speed and a name like `pattern`."""
    text = join_words(look.channels[name].short)
    return (
        bool(pattern.search(text))
        and not NO_VELOCITY_NAME.search(text)
        and unit_kind(look.find_unit(name)) == "speed"
    )


def _guess_velocity(
    look: Look, channel: str, name: str, guesses: Sequence[Guess], v: np.ndarray, vbox: bool
) -> Guess | None:
    """Return the guess that the signal `name` is the velocity `channel`.

    Return None if the signal is rejected. It is rejected if it contradicts the speed `v`
    [m/s] of the wheels, or if it is a lateral velocity of unknown sign. `vbox`: True: the
    log is a VBOX file."""
    unit = look.find_unit(name)
    x = look.x[name] * float(unit_factor(unit, "m/s") or 1.0)
    moving = np.isfinite(x) & (v > MOVING_SPEED)
    if moving.sum() < physics.MIN_ROWS:
        return None
    origin = "from the log" if look.channels[name].unit else "from the end of its name"
    guess = Guess(channel, (name,), unit, origin)
    if channel == "ins_vel_x":
        share = float(np.median(x[moving] / v[moving]))
        if not 0.85 < share < 1.18:
            return None
        guess.confidence = "sure"
        guess.figures.append(f"ratio to the speed of the wheels: {share:.3f}")
        return guess
    if np.quantile(np.abs(x[moving]) / v[moving], 0.98) > MAX_ACROSS:
        return None
    certainty = _find_sign(look, guesses, x, v, moving)
    if abs(certainty) >= MIN_SIGN_SDS:
        guess.sign = float(np.sign(certainty))
        guess.confidence = "sure"
        guess.figures.append(
            f"its derivative correlates with accel_y - v r: positive to the "
            f"{'left' if guess.sign > 0 else 'right'}"
        )
    elif vbox:
        guess.sign = -1.0
        guess.confidence = "likely"
        guess.figures.append("positive to the right, as VBOX defines it; too little motion to test it")
        guess.unsure.append("its sign")
    else:
        return None
    return guess


def _find_sign(
    look: Look, guesses: Sequence[Guess], x: np.ndarray, v: np.ndarray, moving: np.ndarray
) -> float:
    """Return coefficient / sd of a regression of accel_y - v r on the derivative of x.

    `x`: [m/s] lateral velocity. The result is positive if x is positive to the left,
    negative if x is positive to the right, and 0 if the regression is not possible. A
    second regressor is accel_y: body roll adds gravity to the measured accel_y, about in
    proportion to accel_y."""
    known = {g.channel: g for g in guesses}
    if not {"accel_y", "yaw_rate"} <= known.keys():
        return 0.0
    y, r = (
        look.x[(g := known[c]).name[0]] * g.sign * float(unit_factor(g.unit, u) or 1.0)
        for c, u in (("accel_y", "m/s2"), ("yaw_rate", "rad/s"))
    )
    table = np.column_stack([physics.differentiate(x), y, np.ones(len(x))])
    left = y - v * r
    keep = moving & np.isfinite(table).all(axis=1) & np.isfinite(left)
    if keep.sum() < physics.MIN_ROWS or np.std(table[keep, 0]) < 1e-3:
        return 0.0
    a, b = table[keep], left[keep]
    slope, *_ = np.linalg.lstsq(a, b, rcond=None)
    independent = max(len(b) / (2.0 * physics.MEAN_TIME * physics.COMPARISON_RATE), 4.0)
    variance = float(np.mean((b - a @ slope) ** 2)) * np.linalg.pinv(a.T @ a / len(b))[0, 0] / independent
    return float(slope[0] / np.sqrt(variance)) if variance > 0 else 0.0
