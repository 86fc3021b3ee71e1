"""Write the result of a calibration: the vehicle file, a JSON file, and a file with the
formula (an effect that the user added to the model) if the car has one."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tse.calibration.result import CalibrationResult, NumberFinding
from tse.car.formula import write_formula
from tse.car.vehicle import format_calibration_table, get_unknown_car, list_sensor_settings
from tse.identify.slip import describe_wheel_latencies
from tse.identify.unknowns import (
    LATENCIES,
    LATENCY_SUFFIX,
    MIN_SD,
    OF_VELOCITY,
    SCALE_PARTNERS,
    SUPERELEVATION,
    UNCERTAIN_SETTINGS,
    VELOCITY_SD,
    name_in_log,
)
from tse.identify.vehicle_file import estimate_model_sd
from tse.identify.vehicle_file import format_vehicle as vehicle_toml
from tse.library import __version__
from tse.library.core import NOMINAL
from tse.library.files import write_atomically
from tse.report.results import convert_to_plain

# [1] Upper limit of the setting roll_steer_sd, the sd of rear_roll_steer_gain, in a
# calibrated vehicle file. The calibration does not estimate this sd. It copies the sd of
# the vehicle file that was read or, if this file has none, of an uncalibrated car (0.04,
# src/tables/uncalibrated.toml), and then applies the limit.
MAX_ROLL_STEER_SD = 0.03


def collect_settings(result: CalibrationResult) -> dict[str, float]:
    """Return the calibrated settings, except the latencies: name -> value, clipped to the
    allowed range of the setting. If the logs do not determine a parameter, its value is
    near the mean of its prior."""
    found = {f.name: f.value for f in result.findings if f.name not in LATENCIES}
    at = dict(zip(result.problem.names, result.fit.x, strict=True))
    for key, setting in NOMINAL.items():
        found[setting] = float(getattr(result.config, setting) * np.exp(at[key]))
    if leans := _list_superelevations(result):
        found["bank_superelevation"] = float(np.mean(leans))
    fields = result.config.fields
    return {k: float(np.clip(v, fields[k].low, fields[k].high)) for k, v in found.items()}


def _list_superelevations(result: CalibrationResult) -> list[float]:
    """Return the fitted superelevation of the road of each log [1]: the share of the
    lateral acceleration in curves that the bank of the road provides. The list is empty
    if the bank of the roads was fitted as a profile or was known."""
    at = dict(zip(result.problem.names, map(float, result.fit.x), strict=True))
    return [at[name_in_log(SUPERELEVATION, i)] for i in range(result.problem.leans)]


def collect_latencies(result: CalibrationResult) -> dict[str, float]:
    """Return channel -> delay of the channel relative to the gyro [s]."""
    return {LATENCIES[f.name]: f.value for f in result.findings if f.name in LATENCIES}


def collect_uncertainty(result: CalibrationResult) -> dict[str, float]:
    """Return the sds of the calibrated car's parameters, as settings of
    src/tables/uncertainty.toml.

    A parameter that cannot be estimated from logs keeps the sd in the vehicle file. If
    the file has no such sd, the parameter gets the sd of an uncalibrated car.
    """
    names, cov = result.problem.names, result.fit.covariance
    at = dict(zip(names, result.fit.x, strict=True))

    def compute_sd(*weights: tuple[str, float]) -> float:
        w = np.zeros(len(names))
        for name, weight in weights:
            w[names.index(name)] = weight
        return float(np.sqrt(w @ cov @ w))

    found = {key: result.vehicle.values.get(key, sd) for key, sd in get_unknown_car().items()}
    own_sd = found["model_sd"] if result.own else 0.0
    found |= {
        "model_sd": max(own_sd, estimate_model_sd(result.problem, result.fit.level, found["model_sd"])),
        **{
            key: compute_sd((name, 1.0), *([SCALE_PARTNERS[name]] if name in SCALE_PARTNERS else []))
            for key, name in UNCERTAIN_SETTINGS.items()
        },
        "yaw_inertia_sd": compute_sd(("yaw_inertia", 1.0 / at["yaw_inertia"])),
        "wheel_radius_sd": compute_sd(
            *((f"wheel_radius_{a}", k / at[f"wheel_radius_{a}"]) for a, k in (("rear", 1.0), ("front", -1.0)))
        ),
        "lean_sd": float(np.std(_list_superelevations(result) or [0.0])),
    }
    found |= {key: max(found[key], lower) for key, lower in MIN_SD.items()}
    found["roll_steer_sd"] = min(found["roll_steer_sd"], MAX_ROLL_STEER_SD)
    fields = result.config.fields
    return {k: float(np.clip(v, fields[k].low, fields[k].high)) for k, v in found.items()}


def place_formula(path: Path) -> Path:
    """Return the path of the formula file that belongs to a calibrated vehicle file.

    The formula is copied to the folder of the vehicle file, because the section [formula]
    must name a file in this folder, and the calibration is valid only with this formula.
    """
    return path.with_suffix(".formula.toml")


def format_calibrated(result: CalibrationResult, logs: list[str], formula: Path) -> str:
    """Return the content of the calibrated vehicle file. `logs` are the names of the
    fitted logs, and `formula` is the path of the formula file."""
    vehicle, found = result.vehicle, collect_settings(result)
    found |= {f"{c}{LATENCY_SUFFIX}": v for c, v in collect_latencies(result).items()}
    name = vehicle.path.name if vehicle.path else "the built-in car"
    title = [f"# {name}, calibrated by tselab {__version__} from {', '.join(logs)}"]
    if not result.fit.converged:
        title.append("# NOT CONVERGED: the numbers are those of the last step of the search.")
    everything = result.config.as_dict() | found
    written = {k: v for k, v in everything.items() if k not in list_sensor_settings()}
    written |= (
        result.sensors
        | _collect_velocity(result)
        | {k: v for k, v in vehicle.values.items() if k in list_sensor_settings()}
    )
    bands = {f.name: _format_band(f) for f in result.findings} | describe_wheel_latencies(
        result.problem, result.fit
    )
    start = format_calibration_table(*_collect_start(result, everything), result.own, everything)
    return vehicle_toml(title, vehicle, written, collect_uncertainty(result), start, bands, {}, formula)


def _collect_velocity(result: CalibrationResult) -> dict[str, float]:
    """Return position, latency and heading of the velocity sensor and their sds, as
    settings; an empty dict if there is no such sensor."""
    found = {f.name: f for f in result.findings if f.name in VELOCITY_SD}
    fields = result.config.fields
    sds: dict[str, float] = {}
    for name, f in found.items():
        key = VELOCITY_SD[name]
        sds[key] = max(sds.get(key, 0.0), f.sd)
    values = {name: f.value for name, f in found.items()} | sds
    return {k: float(np.clip(v, fields[k].low, fields[k].high)) for k, v in values.items()}


def _collect_start(
    result: CalibrationResult, written: Mapping[str, float]
) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Return names, means and covariance of the unknowns. They become the prior of the
    next calibration.

    In the fit, the unknown of a stiffness is ln(stiffness / its value in the vehicle file
    that was read). The returned mean refers to the value in the vehicle file that is
    written, so ln(written value / read value) is subtracted.
    """
    of_velocity = {u.name for u in OF_VELOCITY}
    own = [k for k, name in enumerate(result.problem.prior.names) if name not in of_velocity]
    names = [result.problem.prior.names[k] for k in own]
    mean, unit = result.fit.x[own].copy(), np.ones(len(own))
    for key, setting in NOMINAL.items():
        mean[names.index(key)] -= np.log(written[setting] / getattr(result.config, setting))
    if not result.own:
        # The calibrated car is to be used for other logs. The written rear longitudinal
        # stiffness [N] is the fitted value times compute_rear_factor(). Mean and sd of
        # the prior are multiplied by the same factor.
        rear = names.index("longitudinal_stiffness_rear")
        unit[rear] = written["longitudinal_stiffness_rear"] / mean[rear]
    return names, mean * unit, result.fit.covariance[np.ix_(own, own)] * np.outer(unit, unit)


def _format_band(f: NumberFinding) -> str:
    """Return the end of the comment on a number in the vehicle file: the 95 % interval,
    or that the logs do not determine the number."""
    if not f.shown:
        return ", not shown by these logs"
    return f", 95 % interval {f.value - 1.96 * f.sd:.4g} .. {f.value + 1.96 * f.sd:.4g}"


def write(path: Path, result: CalibrationResult, logs: list[str]) -> Path:
    """Write the vehicle file, the formula file and the JSON file. Return the path of
    the JSON file."""
    formula = place_formula(path)
    if result.vehicle.formula is not None:
        write_formula(formula, result.vehicle.formula)
    with write_atomically(path) as file:
        file.write(format_calibrated(result, logs, formula))
    numbers = path.with_suffix(".json")
    with write_atomically(numbers) as file:
        json.dump(convert_to_plain(to_json(result)), file, indent=1, allow_nan=False)
        file.write("\n")
    return numbers


def to_json(result: CalibrationResult) -> dict[str, Any]:
    """Return the result of a calibration as a dict for JSON."""
    return {
        "converged": result.fit.converged,
        "steps": result.fit.steps,
        "seconds": result.seconds,
        "findings": [f.as_json() for f in result.findings],
        "evidence": {g.name: g.nats for g in result.groups},
        "stiffness": {k: v for k, v in collect_settings(result).items() if "stiffness" in k},
        "uncertainty": collect_uncertainty(result),
        "superelevation": _list_superelevations(result),
        "left": {c: asdict(left) for c, left in result.problem.measure_lasting(result.fit.level).items()},
        "quantisation": result.steps,
        "sensors": result.sensors,
        "next": [asdict(o) for o in result.offers],
        "proof": [asdict(p) for p in result.proofs],
        "notes": result.notes,
    }  # fmt: skip
