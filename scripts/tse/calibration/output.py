"""What a calibration leaves: the calibrated vehicle file, its formula if it has one, and all numbers as JSON."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tse.calibration.result import Finding, Result
from tse.car.formula import write_formula
from tse.car.vehicle import calibration_toml, sensor_settings, unknown_car
from tse.identify.slip import slip_bands
from tse.identify.unknowns import (
    ALSO,
    LATENCIES,
    LATENCY,
    LEAST_SD,
    OF_VELOCITY,
    SUPERELEVATION,
    UNCERTAIN,
    VELOCITY_SD,
    of_log,
)
from tse.identify.vehicle_file import model_sd
from tse.identify.vehicle_file import toml as vehicle_toml
from tse.library import __version__
from tse.library.core import NOMINAL
from tse.library.files import write_atomically
from tse.report.results import plain

ROLL_STEER_SD = 0.03  # of a car that logs have been fitted to


def values(result: Result) -> dict[str, float]:
    """Settings of the calibrated car. What these logs could not show keeps its prior, which is where the posterior is then."""
    found = {f.name: f.value for f in result.findings if f.name not in LATENCIES}
    at = dict(zip(result.problem.names, result.fit.x, strict=True))
    for key, setting in NOMINAL.items():
        found[setting] = float(getattr(result.config, setting) * np.exp(at[key]))
    if leans := _superelevations(result):
        found["bank_superelevation"] = float(np.mean(leans))
    fields = result.config.fields
    return {k: float(np.clip(v, fields[k].low, fields[k].high)) for k, v in found.items()}


def _superelevations(result: Result) -> list[float]:
    """Of each log; empty: the road is known."""
    at = dict(zip(result.problem.names, map(float, result.fit.x), strict=True))
    return [at[of_log(SUPERELEVATION, i)] for i in range(result.problem.leans)]


def latencies(result: Result) -> dict[str, float]:
    """s behind the gyro, by channel."""
    return {LATENCIES[f.name]: f.value for f in result.findings if f.name in LATENCIES}


def uncertainty(result: Result) -> dict[str, float]:
    """Return how well the car is known now, as settings (src/tables/uncertainty.toml); what logs cannot show stays as it was."""
    names, cov = result.problem.names, result.fit.covariance
    at = dict(zip(names, result.fit.x, strict=True))

    def sd(*weights: tuple[str, float]) -> float:
        w = np.zeros(len(names))
        for name, weight in weights:
            w[names.index(name)] = weight
        return float(np.sqrt(w @ cov @ w))

    found = {key: result.vehicle.values.get(key, sd) for key, sd in unknown_car().items()}
    found |= {
        "model_sd": max(
            found["model_sd"] if result.own else 0.0,
            model_sd(result.problem, result.fit.level, found["model_sd"]),
        ),
        **{key: sd((name, 1.0), *([ALSO[name]] if name in ALSO else [])) for key, name in UNCERTAIN.items()},
        "yaw_inertia_sd": sd(("yaw_inertia", 1.0 / at["yaw_inertia"])),
        "wheel_radius_sd": sd(
            *((f"wheel_radius_{a}", k / at[f"wheel_radius_{a}"]) for a, k in (("rear", 1.0), ("front", -1.0)))
        ),
        "lean_sd": float(np.std(_superelevations(result) or [0.0])),
    }
    found |= {key: max(found[key], least) for key, least in LEAST_SD.items()}
    found["roll_steer_sd"] = min(found["roll_steer_sd"], ROLL_STEER_SD)
    fields = result.config.fields
    return {k: float(np.clip(v, fields[k].low, fields[k].high)) for k, v in found.items()}


def formula_beside(path: Path) -> Path:
    """Where the formula of the calibrated vehicle file goes: its own copy, for what was found holds with this formula only, and
    [formula] names a file beside the vehicle's."""
    return path.with_suffix(".formula.toml")


def toml(result: Result, logs: list[str], formula: Path) -> str:
    """The calibrated vehicle file. `formula`: where its formula is, if it has one."""
    vehicle, found = (
        result.vehicle,
        values(result) | {f"{c}{LATENCY}": v for c, v in latencies(result).items()},
    )
    title = [
        f"# {vehicle.path.name if vehicle.path else 'the built-in car'}, calibrated by tselab {__version__} from {', '.join(logs)}"
    ]
    if not result.fit.converged:
        title.append("# NOT CONVERGED: the numbers are where the search stood.")
    everything = result.config.as_dict() | found
    written = {k: v for k, v in everything.items() if k not in sensor_settings()}
    written |= (
        result.sensors
        | _velocity(result)
        | {k: v for k, v in vehicle.values.items() if k in sensor_settings()}
    )
    bands = {f.name: _band(f) for f in result.findings} | slip_bands(result.problem, result.fit)
    start = calibration_toml(*_start(result, everything), result.own, everything)
    return vehicle_toml(title, vehicle, written, uncertainty(result), start, bands, {}, formula)


def _velocity(result: Result) -> dict[str, float]:
    """Return place, latency and heading of what measures the velocity, with their sd, where a log has it."""
    found = {f.name: f for f in result.findings if f.name in VELOCITY_SD}
    fields = result.config.fields
    sds: dict[str, float] = {}
    for name, f in found.items():
        key = VELOCITY_SD[name]
        sds[key] = max(sds.get(key, 0.0), f.sd)
    values = {name: f.value for name, f in found.items()} | sds
    return {k: float(np.clip(v, fields[k].low, fields[k].high)) for k, v in values.items()}


def _start(result: Result, written: Mapping[str, float]) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names, means and covariance of the unknowns of the car over the stiffness of the file that is written: fitted they were over
    that of the file that was read."""
    of_velocity = {u.name for u in OF_VELOCITY}
    own = [k for k, name in enumerate(result.problem.prior.names) if name not in of_velocity]
    names = [result.problem.prior.names[k] for k in own]
    mean, unit = result.fit.x[own].copy(), np.ones(len(own))
    for key, setting in NOMINAL.items():
        mean[names.index(key)] -= np.log(written[setting] / getattr(result.config, setting))
    if not result.own:
        rear = names.index("longitudinal_stiffness_rear")  # which follows the front one
        unit[rear] = written["longitudinal_stiffness_rear"] / mean[rear]
    return names, mean * unit, result.fit.covariance[np.ix_(own, own)] * np.outer(unit, unit)


def _band(f: Finding) -> str:
    return (
        f", 95 % interval {f.value - 1.96 * f.sd:.4g} .. {f.value + 1.96 * f.sd:.4g}"
        if f.shown
        else ", not shown by these logs"
    )


def write(path: Path, result: Result, logs: list[str]) -> Path:
    """The vehicle file, and beside it its formula and all numbers as JSON."""
    formula = formula_beside(path)
    if result.vehicle.formula is not None:
        write_formula(formula, result.vehicle.formula)
    with write_atomically(path) as file:
        file.write(toml(result, logs, formula))
    numbers = path.with_suffix(".json")
    with write_atomically(numbers) as file:
        json.dump(plain(as_json(result)), file, indent=1, allow_nan=False)
        file.write("\n")
    return numbers


def as_json(result: Result) -> dict[str, Any]:
    """All that was found."""
    return {
        "converged": result.fit.converged,
        "steps": result.fit.steps,
        "seconds": result.seconds,
        "findings": [f.as_json() for f in result.findings],
        "evidence": {g.name: g.nats for g in result.groups},
        "stiffness": {k: v for k, v in values(result).items() if "stiffness" in k},
        "uncertainty": uncertainty(result),
        "superelevation": _superelevations(result),
        "left": {c: asdict(left) for c, left in result.problem.lasting(result.fit.level).items()},
        "quantisation": result.steps,
        "sensors": result.sensors,
        "next": [asdict(o) for o in result.offers],
        "proof": [asdict(p) for p in result.proofs],
        "notes": result.notes,
    }  # fmt: skip
