"""Format the vehicle file that `tselab calibrate` and `tselab gap` write.

It is the user's vehicle file with estimates instead of some of its values.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from tse.car.vehicle import (
    HINT_ONLY,
    Vehicle,
    format_formula_table,
    is_set,
    list_latency_settings,
    list_sensor_settings,
    list_vehicle_settings,
)
from tse.identify.lasting import Piece, measure_share
from tse.library.core import Config, library

# Weight of the prior value of the setting model_sd (relative sd of the model error)
# against its estimate from residuals, in intervals of LASTING_PIECE_TIME (10 s): the
# prior value counts as much as an estimate from 20 s of curves
PRIOR_PIECES = 2.0
# [m/s2] A 10 s interval with the rms lateral acceleration a has the weight
# a^2 / (a^2 + MIN_LATERAL_ACTIVITY^2) in measure_unexplained(). Equal to MIN_ACTIVITY in
# src/tables/constants.toml
MIN_LATERAL_ACTIVITY = 0.5


class Residuals(Protocol):
    """The part of CarProblem that measure_unexplained() needs."""

    groups: Sequence[tuple[int, str]]

    def make_piece(self, g: int, residual: np.ndarray) -> Piece: ...

    def compute_unit_yaw_rate(self, g: int) -> np.ndarray: ...


def estimate_model_sd(problem: Residuals, residuals: Sequence[np.ndarray], before: float) -> float:
    """Return the setting model_sd, the relative sd of the model error, from residuals.

    model_sd^2 is the weighted mean of `before`^2 (prior value, weight PRIOR_PIECES) and
    the square of the value from measure_unexplained() (weight: effective number of 10 s
    intervals, in which straight driving hardly counts).
    """
    left, count = measure_unexplained(problem, residuals)
    found = np.sqrt((PRIOR_PIECES * before**2 + count * left**2) / (PRIOR_PIECES + count))
    return min(float(found), Config().fields["model_sd"].high)


def measure_unexplained(problem: Residuals, residuals: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return the relative model error of yaw_rate, and the effective number of intervals.

    The relative model error is model error / rms of yaw_rate, see measure_share(). It is
    computed from yaw_rate, because bank and grade do not act on a gyro. Without a gyro,
    both results are 0.
    """
    own = [g for g, (_, c) in enumerate(problem.groups) if c == "yaw_rate"]
    if not own:
        return 0.0, 0.0
    pieces = [problem.make_piece(g, residuals[g]) for g in own]
    floor = [MIN_LATERAL_ACTIVITY * problem.compute_unit_yaw_rate(g) for g in own]
    return measure_share(pieces, floor)


def format_vehicle(
    title: Sequence[str],
    vehicle: Vehicle,
    values: Mapping[str, float],
    uncertainty: Mapping[str, float],
    calibration: Sequence[str],
    bands: Mapping[str, str],
    notes: Mapping[str, Sequence[str]],
    formula: Path | None,
) -> str:
    """Return the content of the vehicle file.

    Parameters
    ----------
    title
        First lines of the file.
    vehicle
        The user's vehicle. Two parts of it are written: the keys that are not settings
        (Vehicle.facts), and the user's formula for an effect that the model lacks.
    values
        All settings, by name.
    uncertainty
        Values of table [uncertainty], by key.
    calibration
        Lines of table [calibration].
    bands
        Key: name of a setting. Value: comment at the end of the line of this setting.
    notes
        Key: id of an effect. Value: comments below the heading of this effect. They are
        written even if the effect is off.
    formula
        Path of the file with the formula; None: the file gets no table [formula].
    """
    config, fields, late = Config.exact(values), Config().fields, list_latency_settings()

    def format_rows(names: Mapping[str, str]) -> list[str]:
        return [
            f"{key} = {float(values[k])!r}  # {fields[k].unit}{bands.get(k, '')}" for key, k in names.items()
        ]

    facts = {
        k: v for k, v in vehicle.facts.items() if k not in HINT_ONLY and isinstance(v, (str, int, float))
    }
    lines = [*title, "", *(f"{k} = {json.dumps(v, ensure_ascii=False)}" for k, v in facts.items())]
    lines += format_rows({k: k for k in list_vehicle_settings() if k in values})
    lines += ["", "[uncertainty]", *(f"{k} = {v:.3g}  # {fields[k].unit}" for k, v in uncertainty.items())]
    for table, names in (
        ("latency", {c: k for c, k in late.items() if k in values}),
        ("sensors", {k: k for k in list_sensor_settings() if k in values}),
    ):
        lines += ["", f"[{table}]", *format_rows(names)] if names else []
    if formula is not None and vehicle.formula is not None:
        lines += format_formula_table(vehicle.formula, formula).splitlines()
    for effect in library().effects.values():
        said = [f"# {note}" for note in notes.get(effect.id, ())]
        if is_set(config, effect):
            lines += ["", f"[effects.{effect.id}]  # {effect.title}", *said]
            for p in effect.parameters:
                value = float(getattr(config, p.setting))
                lines.append(f"{p.name} = {value!r}  # {p.unit}: {p.text}{bands.get(p.setting, '')}")
        elif said:
            lines += ["", f"# {effect.title}", *said]
    start = "# Prior of the next calibration; a stiffness is given as ln(stiffness / its value in this file)."
    lines += ["", start]
    return "\n".join([*lines, *calibration]) + "\n"
