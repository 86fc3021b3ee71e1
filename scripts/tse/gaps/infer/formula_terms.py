"""The library of forms: what may be added at a place, without its coefficient, and the
sizes that a screening tries.

Everything is a product of what turns with the car (or pulls along it) and of what that
depends on, or what such a signal becomes through play, dead time, lags, modes and rate
limits. Units go with the text: the coefficient takes what is missing to that of the
place.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from tse.car.formula import Formula, Number
from tse.library.core import library

LATERAL = ("front_angle", "rear_angle", "force_y", "yaw_moment", "accel_y", "yaw_rate")
LONGITUDINAL = ("force_x", "accel_x")


@dataclass(frozen=True)
class Size:
    """A number of a form: where a search begins, and where it may go."""

    name: str
    value: float
    low: float
    high: float
    unit: str
    text: str


@dataclass(frozen=True)
class FormulaTerm:
    """A form. `unit`: exponents of metre and second."""

    text: str
    unit: tuple[int, int]
    sizes: tuple[Size, ...] = ()

    @property
    def price(self) -> int:
        """How much there is to it: numbers, signals and operations."""
        return sum(self.text.count(c) for c in "+-*/(") + 1


@dataclass(frozen=True)
class Signal:
    """What forms are made of.

    `sizes`: small, middle and large of what a driver does with it.
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
PLAYS = (0.001, 0.003, 0.01)  # rad: halves of plays of the steering that are tried


def format_unit(exponents: tuple[int, int]) -> str:
    """Return powers of metres and seconds as the text of a unit."""

    def part(sign: int) -> str:
        return " ".join(
            f"{u}{abs(n) if abs(n) > 1 else ''}" for u, n in zip("ms", exponents, strict=True) if n * sign > 0
        )

    above, below = part(1), part(-1)
    return (above or "1") + "".join(f"/{u}" for u in below.split())


def read_exponents(unit: str) -> tuple[int, int]:
    """Return the powers of metres and seconds of a unit: rad, m/s2, rad/s ..."""
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
    """Return the factors that a signal may have."""
    yield FormulaTerm("", (0, 0))
    yield FormulaTerm(
        "(vel_x/v - 1)", (0, 0), (Size("v", 18.0, 3.0, 80.0, "m/s", "speed at which it changes sign"),)
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
    size = Size("w", half, 0.1 * s.sizes[0], 3.0 * s.sizes[-1], s.units, "half of the dead zone")
    return FormulaTerm(f"({s.text} - max(-w, min(w, {s.text})))", s.unit, (size,))


def make_shapes(s: Signal) -> Iterator[FormulaTerm]:
    """Return nonlinear forms of a signal."""
    yield FormulaTerm(f"{s.text}*abs({s.text})", _add_exponents(s.unit, s.unit))
    yield FormulaTerm(f"{s.text}*{s.text}*{s.text}", _add_exponents(s.unit, _add_exponents(s.unit, s.unit)))
    for w in s.sizes:
        yield FormulaTerm(
            f"soft({s.text}/w)",
            (0, 0),
            (Size("w", w, 0.05 * w, 5.0 * w, s.units, f"{s.text} at which it saturates"),),
        )
        yield _make_dead_zone(s, w)


def add_memory(s: Signal) -> Iterator[FormulaTerm]:
    """Return a signal after each operation with memory, with and without the signal."""
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
    """Return a signal after play, or after a limit of its rate."""
    for w in halves:
        size = Size("w", w, 0.1 * w, 10.0 * w, s.units, "half of the play")
        yield FormulaTerm(f"(play({s.text}, w) - {s.text})", s.unit, (size,))
    for r in rates:
        size = Size(
            "r", r, 0.1 * r, 10.0 * r, "rad/s" if s.units == "rad" else "m/s3", "fastest that it can change"
        )
        yield FormulaTerm(f"(limit({s.text}, r) - {s.text})", s.unit, (size,))


def _multiply_terms(a: FormulaTerm, b: FormulaTerm) -> FormulaTerm:
    names = {s.name for s in a.sizes}
    assert not names & {s.name for s in b.sizes}, "sizes of both have one name"
    return FormulaTerm(
        f"{a.text}*{b.text}" if b.text else a.text, _add_exponents(a.unit, b.unit), (*a.sizes, *b.sizes)
    )


def make_lateral_forms() -> list[FormulaTerm]:
    """Return forms for the places of LATERAL.

    They are odd in the signals that turn the car, or forms of braking and speed.
    """
    found = [_multiply_terms(FormulaTerm(s.text, s.unit), m) for s in TURNING for m in make_modulators()]
    for s in TURNING:
        found += make_shapes(s)
    for s in (STEER, YAW, SIDE, FRONT, REAR):
        found += add_memory(s)
    found += add_play(STEER, PLAYS, (0.1, 0.3))
    found += add_play(SIDE, (0.2, 0.8), ())
    # what pulls to one side, whichever way the car turns
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
    """Return forms for the places of LONGITUDINAL."""
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


# What the catalogue has at a place, the signal that is in proportion first: imu_scale_ax,
# pitch_leak and a late accel_x; imu_scale_ay, body_roll and a late accel_y; gyro_scale;
# steering_ratio, steering_lag and steering_delay. Their evidence was asked for by these
# names, and a name is not to lose to itself: as a formula it says less and costs less.
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
    """Return the library at a place, without the forms of effects there."""
    return [
        t
        for t in (make_lateral_forms() if place in LATERAL else make_longitudinal_forms())
        if t.text not in KNOWN.get(place, ())
    ]


def make_formula(place: str, term: FormulaTerm, coefficient: float) -> Formula:
    """Return a form with its coefficient as a formula.

    Raises
    ------
    FormulaError
        The form does not fit in a program.
    """
    wanted = read_exponents(library().formula_places[place].unit)
    unit = format_unit((wanted[0] - term.unit[0], wanted[1] - term.unit[1]))
    numbers = (
        Number("k", coefficient, unit, None, f"times {term.text}"),
        *(Number(s.name, s.value, s.unit, None, s.text) for s in term.sizes),
    )
    return Formula("found", "found in logs: a formula, not a cause", place, f"k*{term.text}", numbers)


def compute_values(term: FormulaTerm, signals: Mapping[str, np.ndarray], dt: np.ndarray) -> np.ndarray:
    """Return the values of a form over one log, shape (rows,).

    `signals` are by their names in formulas, `dt` in s.
    """
    # at front_angle a number of any unit makes the form one of its place
    unit = format_unit((-term.unit[0], -term.unit[1]))
    numbers = (Number("k", 1.0, unit), *(Number(s.name, s.value, s.unit) for s in term.sizes))
    return Formula("form", "form", "front_angle", f"k*{term.text}", numbers).evaluate(signals, dt)
