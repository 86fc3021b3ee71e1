"""Make the guesses of a proposal, each with its evidence.

A guess is a signal that is proposed for a channel, with unit, sign, ratio, latency and
confidence. A role is a quantity that a signal may measure. It has the name of the channel
that needs this quantity, e.g. yaw_rate; the channels of all wheel speeds have the same
role, "wheel".
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tse.channels import physics
from tse.channels.look import MIN_NAME_SCORE, Guess, Look
from tse.channels.physics import MOVING_SPEED, average
from tse.channels.scales import UNIT_OPTIONS, USUAL_WHEELBASE, UnitScale, is_same_unit, measure_slopes
from tse.channels.vocabulary import AXLES, find_place, score_name
from tse.channels.wheels import compute_speed, is_car_speed
from tse.log.units import unit_factor, unit_kind
from tse.readers.table import find_unit_suffix

BY_SIZE = "from the size of its values"  # source of a unit that neither the log nor the name states
# [rad] There is a warning if the IMU is turned about the vertical axis by more than this.
# accel_y is then a_y cos(angle) + a_x sin(angle). A smaller angle needs no warning: the
# cosine is above 0.99, and tselab calibrate estimates the angle.
MIN_MOUNTING = 0.12
# Prior of the unit of a steering angle, used if a log has too few bends for a test. Key:
# (unit, True: angle of the steering wheel, False: angle of the road wheels). Value: (q,
# share of logs with this key). The 97 % quantile of |angle| of a log is log-normal: its
# median is q, in this unit, and its natural logarithm has the sd 1.
STEERING_SIZES = {
    ("deg", True): (45.0, 0.6),
    ("rad", False): (0.05, 0.25),
    ("rad", True): (0.8, 0.1),
    ("deg", False): (3.0, 0.05),
}
# [1] prior of the steering ratio, and sd of its logarithm: 2 sd include 12 .. 20
RATIO_PRIOR, RATIO_PRIOR_SD = 15.5, 0.12


def make_guesses(
    look: Look,
    wheels: Mapping[str, str],
    chosen: Mapping[str, str],
    worth: Mapping[str, Mapping[str, float]],
    scale: UnitScale,
    car: Any | None,
    warnings: list[str],
) -> list[Guess]:
    """Return the guesses of steering angle, wheel speeds and IMU.

    Parameters
    ----------
    look : Look
        The log.
    wheels : mapping of str to str
        Place of each wheel -> name of its signal.
    chosen : mapping of str to str
        Channel, except the wheel speeds -> name of the signal that was chosen for it.
    worth : mapping of str to mapping of str to float
        Channel -> the two scores of the signal chosen for it: "said" by name and unit,
        "shown" by its agreement with the other channels (physics).
    scale : UnitScale
        Unit of each role, and its factor to SI.
    car : Vehicle or None
        Car, with wheel radii, wheelbase and steering ratio.
    warnings : list of str
        The function appends its warnings.

    Returns
    -------
    list of Guess
        The guesses in the order of the library's channels.
    """
    found: dict[str, Guess] = {}
    v = compute_speed(look, wheels)
    facts = measure_slopes(look, wheels, chosen, v)
    if v is not None:
        v = v * scale.per["wheel"]
    sign, is_sided = _find_signs(facts)
    for role in ("yaw_rate", "accel_y", "accel_x"):
        if role in chosen:
            found[role] = _guess_motion(
                look, role, chosen[role], worth[role], scale, sign[role], facts, is_sided, warnings
            )
    if "steer_angle" in chosen:
        r = (
            look.x[chosen["yaw_rate"]] * scale.per["yaw_rate"] * sign["yaw_rate"]
            if "yaw_rate" in chosen
            else None
        )
        found["steer_angle"] = _guess_steering(
            look, chosen["steer_angle"], worth["steer_angle"], v, r, car, warnings
        )
    for axle in AXLES:
        mine = [wheels[f"{axle}_{s}"] for s in ("left", "right") if f"{axle}_{s}" in wheels] or (
            [wheels[axle]] if axle in wheels else []
        )
        if mine:
            found[f"wheel_speed_{axle}"] = _guess_wheels(look, axle, mine, wheels, scale)
    find_latencies(look, found, wheels, scale, sign, warnings)
    _check_offsets(look, found, chosen, scale, sign, v, warnings)
    _check_turned_imu(look, found, scale, sign, v, warnings)
    if abs(facts.get("track_corr", 0.0)) > 0.7:
        _check_inverted_axes(found, warnings)
    order = ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")
    return [found[c] for c in order if c in found]


def _find_signs(facts: Mapping[str, float]) -> tuple[dict[str, float], bool]:
    """Return the signs of yaw_rate, accel_y and accel_x, and whether the sign of yaw_rate
    was tested.

    A sign is -1 if the logged signal is positive to the right or backwards. It is the
    sign of the correlation
      - of yaw_rate with right - left wheel speed. If |correlation| is 0.7 or less, the
        rate of the GNSS course is used instead. If this |correlation| is 0.7 or less,
        too, the sign is 1, but not tested.
      - of accel_y with v r. v: speed, r: yaw rate with its sign corrected. If
        |correlation| is 0.7 or less, accel_y has the sign of yaw_rate.
      - of accel_x with dv/dt. If |correlation| is 0.5 or less, the sign is 1.
    `facts`: result of measure_slopes()."""
    turn = facts.get("track_corr", 0.0)
    if abs(turn) <= 0.7:
        turn = facts.get("course_corr", 0.0)
    is_sided = abs(turn) > 0.7
    lateral, along = facts.get("accel_y_corr", 0.0), facts.get("accel_x_corr", 0.0)
    sign = {"yaw_rate": float(np.sign(turn)) if is_sided else 1.0}
    sign["accel_y"] = sign["yaw_rate"] * (float(np.sign(lateral)) if abs(lateral) > 0.7 else 1.0)
    sign["accel_x"] = float(np.sign(along)) if abs(along) > 0.5 else 1.0
    return sign, is_sided


def _check_inverted_axes(found: Mapping[str, Guess], warnings: list[str]) -> None:
    """Warn if all lateral channels are positive to the right.

    The signs were determined from right - left wheel speed. They are therefore all wrong
    if the log has exchanged left and right wheels."""
    lateral = ("yaw_rate", "accel_y", "steer_angle")
    if not all(c in found and found[c].sign < 0 for c in lateral):
        return
    warnings.append(
        "steering, accel_y and yaw rate are positive to the right if left and right wheels are named "
        "correctly: SAE axes, or left and right wheels are exchanged; the proposed signs follow the wheels"
    )
    for c in lateral:
        found[c].confidence = min(found[c].confidence, "likely", key=("unsure", "likely", "sure").index)
        found[c].unsure.append("its sign, or which wheels are left")


def _describe_origin(look: Look, name: str, unit: str, role: str) -> str:
    """Return the source of a unit: the log, the end of the name, or the values."""
    c = look.channels[name]
    if c.unit and is_same_unit(c.unit, unit, role):
        return "from the log"
    end = find_unit_suffix(c.short)
    return "from the end of its name" if end and is_same_unit(end, unit, role) else BY_SIZE


def _rate_confidence(said: float, shown: float) -> str:
    """Return the confidence of a guess from its two scores.

    `said`: score by name and unit, at most about 4. `shown`: score by agreement with the
    other channels, -4 .. 4; 0: not tested; 2.5: correlation of about 0.9.
    "sure": `said` is at least MIN_NAME_SCORE, and `shown` is at least 2.5.
    "likely": `shown` is at least 2.5, or `said` is at least 2.5 and `shown` above -1.
    "unsure": in all other cases."""
    if said >= MIN_NAME_SCORE and shown >= 2.5:
        return "sure"
    return "likely" if (said >= 2.5 and shown > -1.0) or shown >= 2.5 else "unsure"


def _guess_motion(
    look: Look,
    role: str,
    name: str,
    worth: Mapping[str, float],
    scale: UnitScale,
    sign: float,
    facts: Mapping[str, float],
    is_sided: bool,
    warnings: list[str],
) -> Guess:
    """Return the guess of yaw_rate, accel_y or accel_x.

    `worth`: scores of the signal by name ("said") and by physics ("shown"). `facts`:
    result of measure_slopes(). `is_sided`: the sign of the yaw rate was tested."""
    unit = scale.unit[role]
    figures = _list_motion_figures(role, worth, scale, sign, facts, is_sided)
    confidence = _rate_confidence(worth["said"], worth["shown"])
    origin = _describe_origin(look, name, unit, role)
    unsure = []
    if worth["shown"] == 0.0:  # no signal to compare with, or too little motion in the log
        figures.append("not tested: by its name alone" if worth["said"] >= MIN_NAME_SCORE else "not tested")
        unsure = ["the signal", "its sign"] if worth["said"] < MIN_NAME_SCORE else ["its sign"]
        if origin == BY_SIZE:
            unsure.append("its unit")
            confidence = "unsure"
    elif worth["said"] < MIN_NAME_SCORE:
        unsure = [
            "the signal, by its behaviour alone",
            *(["its sign"] if role != "accel_x" and not is_sided else []),
        ]
    elif role == "yaw_rate" and not is_sided:
        unsure = ["its sign"]
    guess = Guess(role, (name,), unit, origin, sign, confidence=confidence, figures=figures, unsure=unsure)
    if confidence == "unsure" and not unsure:
        guess.unsure.append("the signal")
    if sign < 0:
        side = "backwards" if role == "accel_x" else "to the right"
        guess.figures.append(f"positive {side} in the log")
    other = {"accel_x": "accel_y", "accel_y": "accel_x"}.get(role)
    if other and score_name(other, name) > score_name(role, name) + 0.5:
        warnings.append(
            f"{name!r} has a name of {other}, but behaves like {role}: are the axes of the IMU swapped?"
        )
    return guess


def _list_motion_figures(
    role: str,
    worth: Mapping[str, float],
    scale: UnitScale,
    sign: float,
    facts: Mapping[str, float],
    is_sided: bool,
) -> list[str]:
    """Return the evidence for the guess of yaw_rate, accel_y or accel_x, in words."""
    figures = []
    what = {"accel_y": "a_y / (v r)", "accel_x": "a_x / (dv/dt of the wheels)"}
    if role in what and role in scale.figures:
        figure = sign * abs(scale.figures[role]) if role == "accel_x" else scale.figures[role]
        figures.append(f"{what[role]}: {figure:.2f}, correlation {abs(facts[f'{role}_corr']):.3f}")
    elif role == "accel_y" and "accel_y_corr" not in facts and worth["shown"] > 0:
        figures.append(
            "correlates with v (right - left wheel speed); without a yaw rate, its factor is unknown"
        )
    elif role in what:
        figures.append(
            f"{what[role]}: too little motion in the log (correlation {facts.get(f'{role}_corr', 0.0):.2f})"
        )
    if role == "yaw_rate":
        if "track" in scale.figures:
            figures.append(
                f"(right - left wheel speed) / yaw rate: {scale.figures['track']:.2f} m, correlation "
                f"{facts['track_corr']:.3f}"
            )
        if "accel_y" in scale.figures:
            figures.append(
                f"a_y / (v r): {scale.figures['accel_y']:.2f}, correlation {abs(facts['accel_y_corr']):.3f}"
            )
        if is_sided and abs(facts.get("track_corr", 0.0)) <= 0.7:
            figures.append(
                f"its sign is from the course of the GNSS receiver, correlation {facts['course_corr']:.3f}"
            )
        if not is_sided:
            figures.append("its sign was not tested by wheels: positive to the left is assumed (ISO 8855)")
    return figures


def _guess_steering(
    look: Look,
    name: str,
    worth: Mapping[str, float],
    v: np.ndarray | None,
    r: np.ndarray | None,
    car: Any | None,
    warnings: list[str],
) -> Guess:
    """Return the guess of the steering angle.

    The steering ratio follows from a fit of the angle to the curvature r/v of the path.
    `v`: [m/s] speed; None: unknown. `r`: [rad/s] yaw rate; None: unknown. Without v or r,
    unit and ratio follow from the size of the angle."""
    wheelbase = float(car.values["lf"] + car.values["lr"]) if car is not None else USUAL_WHEELBASE
    unit = look.channels[name].unit or find_unit_suffix(look.channels[name].short)
    unit = unit if unit_kind(unit) == "angle" else ""
    given = car.steering_ratio if car is not None else None
    found = physics.fit_steering(look.x[name], v, r) if v is not None and r is not None else None
    guess = Guess(
        "steer_angle", (name,), unit or "deg", "", confidence=_rate_confidence(worth["said"], worth["shown"])
    )
    if found is None or found.share < 0.5 or found.per_curvature == 0:
        why = "the log has too few bends to test sign and ratio"
        if v is None:
            why = "there is no speed to test sign and ratio with"
        elif r is None:
            why = "there is no yaw rate to test sign and ratio with"
        _set_untested_steering(guess, look.x[name], unit, given, why)
        return guess
    guess.sign = float(np.sign(found.per_curvature))
    # change of the signal, in its unit, per rad at the road wheels
    raw = abs(found.per_curvature) / wheelbase
    spread = float(np.hypot(found.sd, 0.05 if car is not None else 0.08))
    ratio = _choose_steering_unit(look, guess, raw, spread, unit, given, warnings)
    guess.ratio = None if abs(np.log(ratio)) < abs(np.log(ratio / RATIO_PRIOR)) else ratio
    if guess.ratio is None:
        guess.figures.append(
            f"angle / (r L/v): {ratio:.2f}, so it is the angle of the road wheels (r L/v explains "
            f"{100 * found.share:.0f} % of its variance)"
        )
    else:
        base = f"a wheelbase of {wheelbase:g} m{'' if car is not None else ' (a guess: give --vehicle)'}"
        guess.figures.append(
            f"angle / (r L/v): {ratio:.1f} (sd {ratio * spread:.1f}) with {base}; r L/v explains "
            f"{100 * found.share:.0f} % of its variance"
        )
        _set_steering_ratio(guess, ratio, spread, given, warnings)
    if guess.sign < 0:
        guess.figures.append("positive to the right in the log")
    offset = found.offset * float(unit_factor(guess.unit, "rad") or 1.0) / (guess.ratio or 1.0)
    if abs(offset) > 0.003:
        guess.figures.append(f"{found.offset:.3g} {guess.unit} when driving straight")
    return guess


def _set_untested_steering(guess: Guess, x: np.ndarray, unit: str, given: float | None, why: str) -> None:
    """Set unit and ratio of a steering angle by its size, if no test is possible.

    `x`: values of the angle. `unit`: unit in the log; "": unknown. `given`: steering
    ratio in the vehicle file; None: unknown. `why`: reason why no test is possible."""
    guess.unit, wheel = _guess_by_size(x, unit)
    guess.unit_from = "from the log" if unit else f"guessed from the size of its values: {why}"
    guess.ratio = (given or RATIO_PRIOR) if wheel else None
    guess.confidence = "unsure"
    guess.unsure = ["sign", "ratio", *([] if unit else ["unit"])]
    guess.figures.append(why)


def _choose_steering_unit(
    look: Look, guess: Guess, raw: float, spread: float, unit: str, given: float | None, warnings: list[str]
) -> float:
    """Choose the unit of the steering angle; return q = angle [rad] / (r L/v).

    r L/v (L: wheelbase) is the angle of the road wheels without understeer. With the
    right unit, q is 1 if the signal is the angle of the road wheels, and the steering
    ratio if it is the angle of the steering wheel. The unit whose q is nearest to 1 or to
    the steering ratio is chosen. `raw`: q with the angle in the unit of the signal.
    `spread`: sd of ln `raw`. `unit`: unit in the log; "": unknown. `given`: steering
    ratio in the vehicle file; None: unknown, RATIO_PRIOR is used."""
    units = [unit] if unit else UNIT_OPTIONS["steer_angle"]
    options = [(u, raw * float(unit_factor(u, "rad") or 1.0)) for u in units]
    ratio_spread = np.hypot(spread, 0.02 if given else 0.15)
    off, guess.unit, ratio = min(
        (min(abs(np.log(q)) / spread, abs(np.log(q / (given or RATIO_PRIOR))) / ratio_spread), u, q)
        for u, q in options
    )
    name = guess.name[0]
    guess.unit_from = _describe_origin(look, name, guess.unit, "steer_angle")
    # With the unit in the log, q differs by more than 3 sd from 1 and from the steering
    # ratio: the unit is not plausible.
    if unit and off > 3.0:
        other = "rad" if is_same_unit(unit, "deg", "steer_angle") else "deg"
        q = raw * float(unit_factor(other, "rad") or 1.0)
        if min(abs(np.log(q)), abs(np.log(q / (given or RATIO_PRIOR)))) / spread < 1.5:
            warnings.append(
                f"the log states {unit} for {name!r}, but its values fit {other}: {other} is proposed"
            )
            guess.unit, ratio, guess.unit_from = other, q, BY_SIZE
    return ratio


def _set_steering_ratio(
    guess: Guess, ratio: float, spread: float, given: float | None, warnings: list[str]
) -> None:
    """Set the steering ratio of a guess.

    If the vehicle file has a ratio that agrees with the measured ratio, the ratio of the
    vehicle file is set. If the two ratios do not agree, the measured ratio is set, with a
    warning. If the vehicle file has no ratio, the measured ratio is combined with the
    prior. `ratio`: measured ratio. `spread`: sd of ln `ratio`. `given`: ratio in the
    vehicle file; None: unknown."""
    if given is None:  # mean of ln measured ratio and ln prior, weighted by 1 / variance
        weight = RATIO_PRIOR_SD**-2 / (RATIO_PRIOR_SD**-2 + spread**-2)
        guess.ratio = float(np.exp((1 - weight) * np.log(ratio) + weight * np.log(RATIO_PRIOR)))
    guess.ratio = round(guess.ratio or ratio, 2)
    if given is not None and abs(np.log(ratio / given)) < 2.5 * spread:
        guess.figures.append(f"the ratio of the vehicle file, {given:g}, is used")
        guess.ratio = given
    elif given is None and spread > 0.12:
        guess.confidence = min(guess.confidence, "likely", key=("unsure", "likely", "sure").index)
    elif given is not None:
        warnings.append(
            f"steer_angle: the steering ratio is {given:g} in the vehicle file, but {ratio:.1f} by "
            "angle / (r L/v)"
        )


def _guess_by_size(x: np.ndarray, unit: str) -> tuple[str, bool]:
    """Return the most probable unit of a steering angle, by its 97 % quantile.

    The second value is True for the angle of the steering wheel, False for that of the
    road wheels. `unit`: unit in the log; "": unknown."""
    large = max(float(np.nanquantile(np.abs(x), 0.97)), 1e-9) if np.isfinite(x).any() else 1.0
    options = {
        k: s for k, s in STEERING_SIZES.items() if not unit or is_same_unit(k[0], unit, "steer_angle")
    } or STEERING_SIZES
    best = max(options, key=lambda k: np.log(options[k][1]) - 0.5 * np.log(large / options[k][0]) ** 2)
    return unit or best[0], best[1]


def _guess_wheels(
    look: Look, axle: str, mine: list[str], wheels: Mapping[str, str], scale: UnitScale
) -> Guess:
    """Return the guess of an axle's wheel speed, which is the mean of the signals `mine`.

    `mine`: names of the signals of this axle. `wheels`: place (rear_left, ...) -> name of
    the signal, for the wheels of both axles."""
    unit = scale.unit["wheel"]
    figures = []
    others = [n for n in wheels.values() if n not in mine]
    if others:
        a, b = (average([look.x[n] for n in part]) for part in (mine, others))
        fast = a > 0.3 * np.nanmax(a)
        if fast.any():
            figures.append(f"ratio to the other axle: {float(np.nanmedian((a / b)[fast])):.3f}")
    if "speed" in scale.figures:
        figures.append(f"ratio of logged speed to wheel speeds: {scale.figures['speed']:.3f}")
    if unit_factor(unit, "m/s") is None and "accel_y" in scale.figures:
        figures.append(f"a_y / (v r): {scale.figures['accel_y']:.2f}")
    if len(mine) == 2 and "track" in scale.figures:
        figures.append(f"(right - left wheel speed) / yaw rate: {scale.figures['track']:.2f} m")
    if is_car_speed(wheels):
        figures.append(
            "no wheel speed is logged: the speed of the car is used for both axles, so slip and longitudinal "
            "stiffness are not known"
        )
        origin = _describe_origin(look, mine[0], unit, "wheel")
        return Guess(f"wheel_speed_{axle}", tuple(mine), unit, origin, confidence="likely", figures=figures)
    named = all(find_place(n)[0].startswith(axle) for n in mine)
    agree = not others or "track" in scale.figures or "speed" in scale.figures or "accel_y" in scale.figures
    if not named:
        figures.append(
            "the names do not tell the wheels apart: left and right are found by the yaw rate, front and "
            "rear by their order"
        )
    confidence = "sure" if named and agree and len(wheels) > 1 else "likely" if named else "unsure"
    origin = _describe_origin(look, mine[0], unit, "wheel")
    unsure = [] if named else ["which wheel is which"]
    unsure += (
        ["its unit"]
        if origin == BY_SIZE and not ({"accel_y", "accel_x", "track", "speed"} & set(scale.figures))
        else []
    )
    if unsure and confidence == "sure":
        confidence = "likely"
    return Guess(
        f"wheel_speed_{axle}",
        tuple(mine),
        unit,
        origin,
        confidence=confidence,
        figures=figures,
        unsure=unsure,
    )


def _check_turned_imu(
    look: Look,
    found: Mapping[str, Guess],
    scale: UnitScale,
    sign: Mapping[str, float],
    v: np.ndarray | None,
    warnings: list[str],
) -> None:
    """Warn if the IMU is turned about the vertical axis.

    If it is, accel_y contains the longitudinal acceleration times the sine of the angle.
    The angle and its sd follow from a regression of accel_y on v r and dv/dt."""
    if v is None or "yaw_rate" not in found or "accel_y" not in found:
        return
    r = look.x[found["yaw_rate"].name[0]] * scale.per["yaw_rate"] * sign["yaw_rate"]
    y = look.x[found["accel_y"].name[0]] * scale.per["accel_y"] * sign["accel_y"]
    a = np.column_stack([v * r, physics.differentiate(v), np.ones(len(v))])
    keep = np.isfinite(a).all(axis=1) & np.isfinite(y) & (np.abs(v) > physics.MOVING_SPEED)
    if keep.sum() < physics.MIN_ROWS:
        return
    a, y = a[keep], y[keep]
    information = a.T @ a
    if np.linalg.cond(information) > 1e12:
        return
    slope = np.linalg.solve(information, a.T @ y)
    left = y - a @ slope
    independent = max(len(y) / (2.0 * physics.MEAN_TIME * physics.COMPARISON_RATE), 4.0)
    covariance = np.linalg.inv(information) * len(y) / independent * float(np.mean(left**2))
    if slope[0] <= 0:
        return
    angle = float(np.arctan2(slope[1], slope[0]))
    sd = float(np.sqrt(covariance[1, 1]) / np.hypot(slope[0], slope[1]))
    if abs(angle) < MIN_MOUNTING or abs(angle) < 4.0 * sd:
        return
    warnings.append(
        f"the IMU is mounted turned by {np.degrees(-angle):.0f} degrees (sd {np.degrees(sd):.0f}) about the "
        f"vertical axis: accel_y contains {slope[1]:+.2f} times the longitudinal acceleration; rotate "
        "accel_x and accel_y back in the log, or leave both out"
    )
    for c in ("accel_y", "accel_x"):
        if c in found:
            found[c].confidence = "unsure"
            found[c].unsure.append("how its IMU is mounted")


def _check_offsets(
    look: Look,
    found: Mapping[str, Guess],
    chosen: Mapping[str, str],
    scale: UnitScale,
    sign: Mapping[str, float],
    v: np.ndarray | None,
    warnings: list[str],
) -> None:
    """Warn if the median of accel_y - v r or of accel_x - dv/dt is outside +-0.7 m/s2, if
    a_y / (v r) is outside 0.8 .. 1.25, or if the track that follows from the wheel speeds
    is outside 1.1 .. 2.1 m."""
    if v is None:
        return
    r = (
        look.x[chosen["yaw_rate"]] * scale.per["yaw_rate"] * sign["yaw_rate"]
        if "yaw_rate" in chosen
        else None
    )
    for role, kinematic in (
        ("accel_y", v * r if r is not None else None),
        ("accel_x", physics.differentiate(v)),
    ):
        if role not in found or kinematic is None:
            continue
        left = look.x[found[role].name[0]] * scale.per[role] * sign[role] - kinematic
        offset = float(np.nanmedian(left)) if np.isfinite(left).any() else 0.0
        if 8.5 < abs(offset) < 11:
            warnings.append(
                f"{found[role].name[0]!r} contains gravity (it is {offset:.2f} m/s2 above the expected "
                f"{role}): it is the vertical axis, or the IMU is mounted on edge"
            )
        elif abs(offset) > 0.7:
            warnings.append(
                f"{role}: median difference from the kinematics {offset:+.2f} m/s2: tilted IMU or banked "
                "road; the estimator compensates for it"
            )
        else:
            found[role].figures.append(f"offset {offset:+.2f} m/s2")
    if "accel_y" in scale.figures and not 0.8 < scale.figures["accel_y"] < 1.25:
        warnings.append(
            f"a_y is {scale.figures['accel_y']:.2f} times v r even in the units that fit best: accel_y, "
            "yaw rate or speed is a wrong signal"
        )
    if "track" in scale.figures and not 1.1 < scale.figures["track"] < 2.1:
        warnings.append(
            f"(right - left wheel speed) / yaw rate gives a track of {scale.figures['track']:.2f} m: "
            "wheel radius, unit of the wheel speeds or unit of the yaw rate is wrong"
        )


# ---- Latency of each channel behind the yaw rate.

MIN_LATENCY = 0.004  # [s] min latency that is proposed
# [s] mean and sd of the lag of the yaw rate behind the angle of the road wheels in slow
# steering, simulated by understeering single-track models with tyre relaxation lengths
# and random parameters
YAW_LAG, YAW_LAG_SD = 0.10, 0.043
# [1] A steering latency is only proposed if latency / (sd of the latency) exceeds this.
MIN_STEERING_SDS = 2.0
MAX_STEERING_LATENCY = 0.4  # [s] a larger latency of the steering angle is not proposed
# [1] A latency of wheel speeds or accel_y is only proposed if |latency| / (sd of the
# latency) exceeds this.
MIN_LATENCY_SDS = 4.0


def find_latencies(
    look: Look,
    found: dict[str, Guess],
    wheels: Mapping[str, str],
    scale: UnitScale,
    sign: Mapping[str, float],
    warnings: list[str],
) -> None:
    """Set the latencies of wheel speeds, accel_y and steering angle, relative to the yaw
    rate, in the guesses `found`."""
    if "yaw_rate" not in found:
        return
    clock = found["yaw_rate"].name[0]
    r = look.x[clock] * scale.per["yaw_rate"] * sign["yaw_rate"]
    keep = np.isfinite(r)
    if "rear_left" in wheels:
        difference = (look.x[wheels["rear_right"]] - look.x[wheels["rear_left"]]) * scale.per["wheel"]
        v = average([look.x[n] for n in wheels.values()]) * scale.per["wheel"]
        late, sd = physics.find_lag(r, difference, keep & (v > MOVING_SPEED))
        for axle in AXLES:
            _set_latency(
                look,
                found.get(f"wheel_speed_{axle}"),
                clock,
                late,
                sd,
                "right - left wheel speed against the yaw rate",
            )
    if "steer_angle" in found and wheels:
        v = average([look.x[n] for n in wheels.values()]) * scale.per["wheel"]
        _set_steering_latency(look, found["steer_angle"], v, r, keep & (v > MOVING_SPEED), warnings)
    if "accel_y" in found and wheels:
        v = average([look.x[n] for n in wheels.values()]) * scale.per["wheel"]
        slope = physics.differentiate(r)
        # The lateral velocity contributes (c0 + c2 v^2) r' to accel_y (r': derivative of
        # r). _find_accel_lag() fits c0 and c2, so that this contribution is not taken for
        # a latency.
        late, sd = _find_accel_lag(look, found["accel_y"], v, r, slope, scale, sign, keep)
        how = "a_y against v r, without the effect of the lateral velocity"
        _set_latency(look, found["accel_y"], clock, late, sd, how)


def _set_steering_latency(
    look: Look, guess: Guess, v: np.ndarray, r: np.ndarray, keep: np.ndarray, warnings: list[str]
) -> None:
    """Set the latency of the steering angle, if the yaw rate lags the angle too little.

    In a car, the yaw rate lags the angle of the road wheels by YAW_LAG (sd YAW_LAG_SD).
    If the measured lag is smaller or negative, the logged angle is late by YAW_LAG - lag.
    This latency is only set if it is above MIN_STEERING_SDS x its sd, which includes
    YAW_LAG_SD, and below MAX_STEERING_LATENCY. tselab calibrate also finds smaller
    latencies."""
    steered = v * look.x[guess.name[0]] / (1.0 + physics.UNDERSTEER * v**2)
    follows, sd = physics.find_lag(steered, r, keep)
    late, sd = YAW_LAG - follows, float(np.hypot(sd, YAW_LAG_SD))
    if not np.isfinite(sd) or sd > 2 * YAW_LAG_SD or not MIN_STEERING_SDS * sd < late < MAX_STEERING_LATENCY:
        return
    guess.latency = round(late, 3)
    guess.figures.append(
        f"{1e3 * late:.0f} ms (sd {1e3 * sd:.0f}) late: the yaw rate lags the angle by {1e3 * follows:.0f} "
        f"ms, usual are {1e3 * YAW_LAG:.0f} ms; tselab calibrate estimates the latency more exactly"
    )
    warnings.append(
        f"steer_angle is logged about {1e3 * late:.0f} ms late, which is proposed as its latency: without "
        "this latency, the estimates would be wrong"
    )


def _find_accel_lag(
    look: Look,
    g: Guess,
    v: np.ndarray,
    r: np.ndarray,
    slope: np.ndarray,
    scale: UnitScale,
    sign: Mapping[str, float],
    keep: np.ndarray,
) -> tuple[float, float]:
    """Return the lag of accel_y behind v r, and the sd of the lag, both in s.

    `slope`: derivative r' of the yaw rate. The fit has two further terms, r' and v^2 r',
    since the lateral velocity contributes such terms to accel_y."""
    y = look.x[g.name[0]] * scale.per["accel_y"] * sign["accel_y"]
    return physics.find_lag(v * r, y, keep & (v > MOVING_SPEED), (slope, v**2 * slope))


def _set_latency(look: Look, guess: Guess | None, clock: str, late: float, sd: float, how: str) -> None:
    """Set the latency of a guess to `late`, if `late` is significant; add the evidence.

    `late`: [s] delay behind the yaw rate; negative: ahead of it. `sd`: [s] sd of `late`.
    `late` is significant if |late| is above MIN_LATENCY and MIN_LATENCY_SDS x `sd`, and
    below 0.3 s, and if `sd` is below 0.02 s. If signal and yaw rate have the same time
    stamps, they were probably sampled together. Only the evidence is then added for
    |late| up to 2 x MIN_LATENCY. `clock`: name of the signal of the yaw rate. `how`: the
    compared signals, for the evidence."""
    if guess is None or not np.isfinite(sd):
        return
    together = look.channels[guess.name[0]].time is look.channels[clock].time
    if abs(late) > max(MIN_LATENCY, MIN_LATENCY_SDS * sd) and abs(late) < 0.3 and sd < 0.02:
        guess.figures.append(f"{1e3 * late:.0f} ms (sd {1e3 * sd:.0f}) behind the yaw rate: {how}")
        if not together or abs(late) > 2 * MIN_LATENCY:
            guess.latency = round(late, 4)
