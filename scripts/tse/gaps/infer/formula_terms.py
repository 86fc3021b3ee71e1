"""The forms that the search for a formula tries. A form is a formula without its
coefficient, for example abs(accel_x)*yaw_rate.

There are three kinds of forms: a signal of the car's motion times a factor that depends
on speed, acceleration or steering; a nonlinear function of a signal; and a signal changed
by play, dead time, lag, a second-order mode or a rate limit. A form may contain numbers,
such as a time constant, which are tried with several start values.

The value of a formula is added at a place of the model: a quantity such as the yaw moment
or the output of accel_y. A formula is the coefficient times the form. So the unit of the
coefficient is the unit of the quantity at the place divided by the unit of the form.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from tse.car.formula import Formula, Number
from tse.library.core import library

# Places: quantities of the model to which a formula can be added
LATERAL = ("front_angle", "rear_angle", "force_y", "yaw_moment", "accel_y", "yaw_rate")
LONGITUDINAL = ("force_x", "accel_x")


@dataclass(frozen=True)
class Size:
    """A number in a form, such as a time constant: the value at which its fit starts, and
    its limits.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    text: str


@dataclass(frozen=True)
class FormulaTerm:
    """A form: a formula without its coefficient.

    `text` is the expression. `unit` has the exponents of metre and second: (1, -2) is
    m/s2. `sizes` are the numbers in the expression.
    """

    text: str
    unit: tuple[int, int]
    sizes: tuple[Size, ...] = ()

    @property
    def price(self) -> int:
        """Length of the form, from which its price in nats is computed: number of
        operators and opening parentheses, plus 1.
        """
        return sum(self.text.count(c) for c in "+-*/(") + 1


@dataclass(frozen=True)
class Signal:
    """A signal of the car's motion or steering from which forms are composed.

    `text` is its expression and `units` its unit. `sizes` are a small, a medium and a
    large value of the signal in ordinary driving.
    """

    text: str
    units: str
    sizes: tuple[float, ...]

    @property
    def unit(self) -> tuple[int, int]:
        return read_exponents(self.units)


STEER = Signal("steer_angle", "rad", (0.005, 0.02, 0.06))
YAW = Signal("yaw_rate", "rad/s", (0.03, 0.12, 0.35))
SIDE = Signal("accel_y", "m/s2", (0.7, 2.0, 4.5))
FRONT = Signal("slip_angle_front", "rad", (0.005, 0.02, 0.05))
REAR = Signal("slip_angle_rear", "rad", (0.005, 0.02, 0.05))
STEER_RATE = Signal("rate(steer_angle)", "rad/s", (0.02, 0.1, 0.4))
SPEED = Signal("vel_x", "m/s", (9.0, 16.0, 24.0))
PULL = Signal("accel_x", "m/s2", (0.7, 1.5, 3.5))
TURNING = (STEER, YAW, SIDE, FRONT, REAR, STEER_RATE)
PLAYS = (0.001, 0.003, 0.01)  # [rad] start values of the half width of the steering play


def format_unit(exponents: tuple[int, int]) -> str:
    """Return a unit as a string, from the exponents of metre and second."""

    def format_part(sign: int) -> str:
        return " ".join(
            f"{u}{abs(n) if abs(n) > 1 else ''}" for u, n in zip("ms", exponents, strict=True) if n * sign > 0
        )

    above, below = format_part(1), format_part(-1)
    return (above or "1") + "".join(f"/{u}" for u in below.split())


def read_exponents(unit: str) -> tuple[int, int]:
    """Return the exponents of metre and second of a unit such as rad, m/s2 or rad/s."""
    found = {"m": 0, "s": 0}
    for k, part in enumerate(unit.split("/")):
        for u in part.split():
            name, power = (u[:-1], int(u[-1])) if u[-1].isdigit() and len(u) > 1 else (u, 1)
            if name in found:
                found[name] += power if k == 0 else -power
    return found["m"], found["s"]


def _add_exponents(a: tuple[int, int], b: tuple[int, int]) -> tuple[int, int]:
    return a[0] + b[0], a[1] + b[1]


def _soften_step(s: Signal, at: float, name: str, width: float) -> tuple[str, tuple[Size, ...]]:
    low, high = 0.2 * s.sizes[0], 2.5 * s.sizes[-1]
    at_, w = f"{name}0", f"{name}w"
    return f"soft(({_format_magnitude(s)} - {at_})/{w})", (
        Size(at_, at, low, high, s.units, f"{s.text} in the middle of the step"),
        Size(w, width, 0.05 * width, 4.0 * width, s.units, f"half the width of the step of {s.text}"),
    )


def _format_magnitude(s: Signal) -> str:
    return s.text if s is SPEED else f"abs({s.text})"


def make_modulators() -> Iterator[FormulaTerm]:
    """Yield the factors by which a signal is multiplied. The first factor has an empty
    expression, which stands for 1.
    """
    yield FormulaTerm("", (0, 0))
    yield FormulaTerm(
        "(vel_x/v - 1)",
        (0, 0),
        (Size("v", 18.0, 3.0, 80.0, "m/s", "speed at which this factor changes sign"),),
    )
    yield FormulaTerm("vel_x*vel_x", (2, -2))
    for at in SPEED.sizes:
        yield FormulaTerm(*_make_step(SPEED, at, "v", 3.0))
    for s, name in ((SIDE, "a"), (PULL, "p"), (STEER, "d")):
        yield FormulaTerm(_format_magnitude(s), s.unit)
        for at in s.sizes[1:]:
            yield FormulaTerm(*_make_step(s, at, name, 0.3 * at))
    yield FormulaTerm("accel_x", PULL.unit)
    yield FormulaTerm("(abs(accel_x) + accel_x)", PULL.unit)
    yield FormulaTerm("(abs(accel_x) - accel_x)", PULL.unit)


def _make_step(
    s: Signal, at: float, name: str, width: float
) -> tuple[str, tuple[int, int], tuple[Size, ...]]:
    text, sizes = _soften_step(s, at, name, width)
    return f"(1 + {text})", (0, 0), sizes


def _make_dead_zone(s: Signal, half: float) -> FormulaTerm:
    size = Size("w", half, 0.1 * s.sizes[0], 3.0 * s.sizes[-1], s.units, "half width of the dead zone")
    return FormulaTerm(f"({s.text} - max(-w, min(w, {s.text})))", s.unit, (size,))


def make_shapes(s: Signal) -> Iterator[FormulaTerm]:
    """Yield nonlinear functions of a signal: powers, saturation and a dead zone."""
    yield FormulaTerm(f"{s.text}*abs({s.text})", _add_exponents(s.unit, s.unit))
    yield FormulaTerm(f"{s.text}*{s.text}*{s.text}", _add_exponents(s.unit, _add_exponents(s.unit, s.unit)))
    for w in s.sizes:
        yield FormulaTerm(
            f"soft({s.text}/w)",
            (0, 0),
            (Size("w", w, 0.05 * w, 5.0 * w, s.units, f"{s.text} at which soft is 0.71"),),
        )
        yield _make_dead_zone(s, w)


def add_memory(s: Signal) -> Iterator[FormulaTerm]:
    """Yield forms in which a signal is delayed by a lag, a second-order mode or a dead
    time. For a lag and for a mode, there are two forms: the output, and the output minus
    the signal. For a dead time, there is only the output minus the signal.
    """
    for less in ("", f" - {s.text}"):
        for t in (0.05, 0.15, 0.4):
            yield FormulaTerm(
                f"(lag({s.text}, T){less})", s.unit, (Size("T", t, 0.005, 3.0, "s", "time constant"),)
            )
        for f, d in itertools.product((1.0, 1.5, 2.2, 3.2), (0.1, 0.35)):
            sizes = (
                Size("f0", f, 0.3, 8.0, "Hz", "natural frequency"),
                Size("D", d, 0.02, 1.5, "1", "damping ratio"),
            )
            yield FormulaTerm(f"(second({s.text}, f0, D){less})", s.unit, sizes)
    for t in (0.02, 0.08):
        yield FormulaTerm(
            f"(late({s.text}, T) - {s.text})", s.unit, (Size("T", t, 0.002, 0.3, "s", "dead time"),)
        )


def add_play(s: Signal, halves: tuple[float, ...], rates: tuple[float, ...]) -> Iterator[FormulaTerm]:
    """Yield forms for play and for a rate limit: the signal after the play or the limit,
    minus the signal itself. `halves` has the half widths of the play, and `rates` the
    limits of the rate.
    """
    for w in halves:
        size = Size("w", w, 0.1 * w, 10.0 * w, s.units, "half width of the play")
        yield FormulaTerm(f"(play({s.text}, w) - {s.text})", s.unit, (size,))
    for r in rates:
        size = Size("r", r, 0.1 * r, 10.0 * r, "rad/s" if s.units == "rad" else "m/s3", "max rate of change")
        yield FormulaTerm(f"(limit({s.text}, r) - {s.text})", s.unit, (size,))


def _multiply_terms(a: FormulaTerm, b: FormulaTerm) -> FormulaTerm:
    names = {s.name for s in a.sizes}
    assert not names & {s.name for s in b.sizes}, "sizes of both have one name"
    return FormulaTerm(
        f"{a.text}*{b.text}" if b.text else a.text, _add_exponents(a.unit, b.unit), (*a.sizes, *b.sizes)
    )


def make_lateral_forms() -> list[FormulaTerm]:
    """Return the forms, i.e. formulas without coefficient, that are tried at the places
    of LATERAL, such as the yaw moment.

    Most forms have opposite signs in left and right turns. The other forms have the same
    sign in all turns, so they push the car always to the same side. These other forms
    consist of accel_x, speed, or absolute values and squares of signals.
    """
    found = [_multiply_terms(FormulaTerm(s.text, s.unit), m) for s in TURNING for m in make_modulators()]
    for s in TURNING:
        found += make_shapes(s)
    for s in (STEER, YAW, SIDE, FRONT, REAR):
        found += add_memory(s)
    found += add_play(STEER, PLAYS, (0.1, 0.3))
    found += add_play(SIDE, (0.2, 0.8), ())
    # forms that push the car to the same side in all turns
    found += [
        FormulaTerm(t, u)
        for t, u in (("accel_x", PULL.unit), ("abs(accel_x)", PULL.unit), ("vel_x*vel_x", (2, -2)))
    ]
    for s in (STEER, YAW, SIDE, FRONT, REAR):
        found += [
            FormulaTerm(f"abs({s.text})", s.unit),
            FormulaTerm(f"{s.text}*{s.text}", _add_exponents(s.unit, s.unit)),
        ]
    return found


def make_longitudinal_forms() -> list[FormulaTerm]:
    """Return the forms, i.e. formulas without coefficient, that are tried at the places
    of LONGITUDINAL, such as the longitudinal force."""
    found = [
        _multiply_terms(FormulaTerm(PULL.text, PULL.unit), m)
        for m in make_modulators()
        if "accel_x" not in m.text
    ]
    found += [*make_shapes(PULL), *add_memory(PULL), *add_play(PULL, (0.1, 0.4), (3.0, 10.0))]
    for text, unit in (
        ("vel_x*vel_x", (2, -2)),
        ("vel_x", (1, -1)),
        ("abs(accel_y)", SIDE.unit),
        ("accel_y*accel_y", (2, -4)),
        ("accel_y*steer_angle", SIDE.unit),
        ("accel_y*yaw_rate", (1, -3)),
        ("yaw_rate*yaw_rate", (0, -2)),
        ("steer_angle*steer_angle", (0, 0)),
        ("abs(steer_angle)", (0, 0)),
        ("steer_angle", (0, 0)),
        ("accel_y", SIDE.unit),
        ("yaw_rate", YAW.unit),
    ):
        found.append(FormulaTerm(text, unit))
    return found


# place of the model -> forms that are not tried at this place, because the search for
# effects has already tested what they describe, a latency or an effect of the catalogue:
#   accel_x      imu_scale_ax, pitch_leak, latency of accel_x
#   accel_y      imu_scale_ay, body_roll, latency of accel_y
#   yaw_rate     gyro_scale
#   front_angle  steering_ratio, steering_lag, steering_delay
# As a formula, an effect has a lower price (penalty for complexity) than as a named
# effect. So the formula would replace the named effect.
KNOWN: dict[str, tuple[str, ...]] = {
    "accel_x": ("accel_x", "(second(accel_x, f0, D))", "(late(accel_x, T) - accel_x)"),
    "accel_y": ("accel_y", "(second(accel_y, f0, D))", "(late(accel_y, T) - accel_y)"),
    "yaw_rate": ("yaw_rate",),
    "front_angle": (
        "steer_angle",
        "(lag(steer_angle, T) - steer_angle)",
        "(late(steer_angle, T) - steer_angle)",
    ),
}


def list_forms(place: str) -> list[FormulaTerm]:
    """Return the forms that are tried at a place of the model: all except those in KNOWN,
    which describe effects of the catalogue or latencies."""
    return [
        t
        for t in (make_lateral_forms() if place in LATERAL else make_longitudinal_forms())
        if t.text not in KNOWN.get(place, ())
    ]


def make_formula(place: str, term: FormulaTerm, coefficient: float) -> Formula:
    """Return the formula `coefficient` times `term`. Its value is added to the quantity
    of the model that `place` names, such as "yaw_moment".

    Raises
    ------
    FormulaError
        The formula is too long for the library.
    """
    wanted = read_exponents(library().formula_places[place].unit)
    unit = format_unit((wanted[0] - term.unit[0], wanted[1] - term.unit[1]))
    numbers = (
        Number("k", coefficient, unit, None, f"coefficient of {term.text}"),
        *(Number(s.name, s.value, s.unit, None, s.text) for s in term.sizes),
    )
    return Formula("found", "found in logs: a formula, not a cause", place, f"k*{term.text}", numbers)


def compute_values(term: FormulaTerm, signals: Mapping[str, np.ndarray], dt: np.ndarray) -> np.ndarray:
    """Return the values of a term, i.e. of a formula without its coefficient, in the rows
    of one log: an array of the shape (rows,).

    `signals` has the signals under their names in formulas. `dt` is the time step [s].
    """
    # A Formula needs a place, and k must have the unit (unit of the place) / (unit of the
    # form). The values are the same for every place. Here the place is front_angle. It is
    # in rad, so the unit of k is 1 / (unit of the form).
    unit = format_unit((-term.unit[0], -term.unit[1]))
    numbers = (Number("k", 1.0, unit), *(Number(s.name, s.value, s.unit) for s in term.sizes))
    return Formula("form", "form", "front_angle", f"k*{term.text}", numbers).evaluate(signals, dt)
