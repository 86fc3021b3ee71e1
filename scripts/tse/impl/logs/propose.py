"""A guess of signals.toml: names by words, units and physics together; every guess with the figure that speaks for it.

A candidate of a role is worth what its name sounds like (vocabulary.py), plus whether its unit is of the kind, plus how well it
agrees with the others (physics.py). The references of the physics are the best candidates themselves, so it is done a few times
over."""

from __future__ import annotations

from typing import Any

from tse.impl.logs.guesses import make_guesses
from tse.impl.logs.look import Guess, Look, Proposal, counted, find_companions
from tse.impl.logs.recording import Recording
from tse.impl.logs.scales import find_units
from tse.impl.logs.wheels import find_pedals, find_roles, find_sides, find_speed, find_wheels, speed_of

__all__ = ["Guess", "Proposal", "propose"]
PASSES = 3


def propose(recording: Recording, car: Any | None = None) -> Proposal:
    """Guess which signal is which. `car`: a vehicle.Vehicle; its radii, wheelbase and ratio make the figures sharper."""
    look = Look(recording)
    warnings: list[str] = []
    wheels = find_wheels(look) or find_speed(look)
    chosen: dict[str, str] = {}
    worth: dict[str, dict[str, float]] = {}
    for _ in range(PASSES):
        raw = speed_of(look, wheels, chosen)
        chosen, worth = find_roles(look, wheels, raw, chosen)
        if raw is None:
            break
        wheels = find_sides(look, wheels, chosen)
    scale = find_units(look, wheels, chosen, car, warnings)
    guesses = make_guesses(look, wheels, chosen, worth, scale, car, warnings)
    for g in guesses:
        if len(g.name) == 1 and g.name[0] in look.sign_bit:
            g.sign_bit = look.sign_bit[g.name[0]]
            g.figures.append(f"its sign is {g.sign_bit}, which changes where it goes through zero")
    raw = speed_of(look, wheels, chosen)
    guesses += find_pedals(recording, look, None if raw is None else raw * scale.per["wheel"])
    find_companions(recording, guesses)
    warnings += counted(recording) if not wheels else []
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
