"""Which signal is which of the other channels: by its name and unit, and by how well it agrees with the others."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np

from tse.impl.logs import physics
from tse.impl.logs.physics import fit
from tse.impl.logs.propose.look import KINDS, NAMED, TURNED, Look
from tse.impl.logs.propose.wheels import rolls, turn_of
from tse.impl.logs.units import kind
from tse.impl.logs.vocabulary import score

# Correlation that speaks neither for nor against a role; the change of the wheels' speed is a noisy reference, and slopes add to it
HALFWAY = {"accel_x": 0.68}
LATERAL = ("yaw_rate", "accel_y", "accel_x", "steer_angle")


def find_roles(
    look: Look, wheels: Mapping[str, str], v: np.ndarray | None, before: Mapping[str, str]
) -> tuple[dict[str, str], dict[str, dict[str, float]]]:
    """Role -> name, and what every candidate was worth: by name and unit, and by physics."""
    taken = set(wheels.values()) | quaternions(look)
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
        shown[role] = {n: _shown(look, role, n, v, turn_of(look, wheels), ref) for n in said[role]}
        total[role] = {n: said[role][n] + shown[role][n] for n in said[role]}
    found: dict[str, str] = {}
    pairs = sorted(((w, role, n) for role in LATERAL for n, w in total[role].items()), reverse=True)
    for w, role, n in pairs:  # the best first; one signal has one role
        if (
            role not in found
            and n not in found.values()
            and w >= NAMED
            and (score(role, look.called(n)) >= 0.8 or shown[role][n] >= 2.5)  # a unit alone is no name
        ):
            found[role] = n
    return found, {
        role: {"said": said[role].get(n, 0.0), "shown": shown[role].get(n, 0.0)} for role, n in found.items()
    }


def quaternions(look: Look) -> set[str]:
    """Parts of attitudes: x, y, z beside a w are no rates, though rotation.z sounds like one."""
    known = set(look.channels)
    stems = {n[:-1] for n in known if n[-2:] in (".w", "_w") and n[:-1] + "z" in known}
    return {n for n in known if n[:-1] in stems and n[-1] in "wxyz"}


def _said(look: Look, role: str, name: str) -> float:
    unit = kind(look.unit(name))
    of_kind = 1.0 if unit in KINDS[role] else (0.0 if unit == "" else -3.0)
    return score(role, look.called(name)) + of_kind + 0.001 * min(look.rate[name], 100.0)


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
    return float(np.clip(16.0 * (np.mean(said) - HALFWAY.get(role, 0.75)), -4.0, 4.0)) if said else 0.0


def _pair(
    look: Look, v: np.ndarray, taken: set[str], said: Mapping[str, Mapping[str, float]], ref: Mapping[str, str]
) -> dict[str, str]:
    """Yaw rate and lateral acceleration without a name that says so: the two for which a_y = v r holds best."""
    free = [n for n in look.x if n not in taken and not rolls(look.x[n])]
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
