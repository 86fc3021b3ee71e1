"""Write the vehicle file of a calibration or a gap: the user's file with the
estimates."""

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

PRIOR_PIECES = 2.0  # weight of the prior of model_sd, in pieces of 10 s
MIN_LATERAL_ACTIVITY = 0.5  # m/s2, floor of the signal: MIN_ACTIVITY of the filter


class Residuals(Protocol):
    """Residuals of a problem that measure_unexplained() needs."""

    groups: Sequence[tuple[int, str]]

    def make_piece(self, g: int, residual: np.ndarray) -> Piece: ...

    def compute_unit_yaw_rate(self, g: int) -> np.ndarray: ...


def estimate_model_sd(problem: Residuals, residuals: Sequence[np.ndarray], before: float) -> float:
    """Return model_sd of the filter: mean square of prior and residuals, by number of
    pieces.

    Half a minute straight ahead shows nothing of a model error in curves. Half an hour of
    curves does.
    """
    left, count = measure_unexplained(problem, residuals)
    found = np.sqrt((PRIOR_PIECES * before**2 + count * left**2) / (PRIOR_PIECES + count))
    return min(float(found), Config().fields["model_sd"].high)


def measure_unexplained(problem: Residuals, residuals: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return the share of yaw_rate that the model does not explain, and the number of
    pieces.

    The share is that of measure_share(): an error that lasts 1 s. yaw_rate has no road in
    it. Without a gyro both are 0.
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
    """Write the file as text.

    Parameters
    ----------
    title
        First lines.
    vehicle
        The user's vehicle; gives names and facts.
    values
        All settings of the file.
    uncertainty, calibration
        Tables of these names; the second as lines.
    bands
        Comment behind a setting.
    notes
        Comment below the heading of an effect, also of effects that are off.
    formula
        File of the formula beside it.
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
    start = "# Prior of the next calibration: names, means and covariance; stiffness in ln over this file's."
    lines += ["", start]
    return "\n".join([*lines, *calibration]) + "\n"
