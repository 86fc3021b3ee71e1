"""The vehicle file that calibrate and gap leave: the user's, with what was found and how well it is known."""

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

PRIOR_PIECES = 2.0  # pieces of 10 s: what is known of a car before its logs counts as so many
MIN_LATERAL_ACTIVITY = 0.5  # m/s2: what happens where nothing does, LEAST_ACTIVITY of the filter


class Residuals(Protocol):
    """What a problem says of its residuals."""

    groups: Sequence[tuple[int, str]]

    def make_piece(self, g: int, residual: np.ndarray) -> Piece: ...

    def compute_unit_yaw_rate(
        self, g: int
    ) -> np.ndarray: ...  # a yaw rate of 1 m/s2 across, in the unit of the residuals


def estimate_model_sd(problem: Residuals, residuals: Sequence[np.ndarray], before: float) -> float:
    """Return what the filter counts of the model: the mean square of what was known before
    the logs, and of what they leave, each by its number of pieces.

    Half a minute straight on shows nothing of how well a model turns; half an hour of bends
    does."""
    left, count = measure_unexplained(problem, residuals)
    found = np.sqrt((PRIOR_PIECES * before**2 + count * left**2) / (PRIOR_PIECES + count))
    return min(float(found), Config().fields["model_sd"].high)


def measure_unexplained(problem: Residuals, residuals: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return the share of what happens that the model does not explain and that lasts 1 s, of
    yaw_rate, in which no road stands; and in how many pieces something happens. Without a
    gyro nothing is shown."""
    own = [g for g, (_, c) in enumerate(problem.groups) if c == "yaw_rate"]
    if not own:
        return 0.0, 0.0
    pieces = [problem.make_piece(g, residuals[g]) for g in own]
    return measure_share(pieces, [MIN_LATERAL_ACTIVITY * problem.compute_unit_yaw_rate(g) for g in own])


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
        Its first lines.
    vehicle
        The user's; names and facts are from it.
    values
        All settings that go into it.
    uncertainty, calibration
        Its tables of these names; the second as lines.
    bands
        What to say behind a setting.
    notes
        What to say below the heading of an effect, and of effects that are not set.
    formula
        File of the formula beside it.
    """
    config, fields, late = Config.exact(values), Config().fields, list_latency_settings()

    def rows(names: Mapping[str, str]) -> list[str]:
        return [
            f"{key} = {float(values[k])!r}  # {fields[k].unit}{bands.get(k, '')}" for key, k in names.items()
        ]

    facts = {
        k: v for k, v in vehicle.facts.items() if k not in HINT_ONLY and isinstance(v, (str, int, float))
    }
    lines = [*title, "", *(f"{k} = {json.dumps(v, ensure_ascii=False)}" for k, v in facts.items())]
    lines += rows({k: k for k in list_vehicle_settings() if k in values})
    lines += ["", "[uncertainty]", *(f"{k} = {v:.3g}  # {fields[k].unit}" for k, v in uncertainty.items())]
    for table, names in (
        ("latency", {c: k for c, k in late.items() if k in values}),
        ("sensors", {k: k for k in list_sensor_settings() if k in values}),
    ):
        lines += ["", f"[{table}]", *rows(names)] if names else []
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
    lines += [
        "",
        "# What the next calibration starts from: names, means and covariance; stiffness in ln over this file's.",
    ]
    return "\n".join([*lines, *calibration]) + "\n"
