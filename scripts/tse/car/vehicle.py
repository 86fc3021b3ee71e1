"""Read and check a vehicle file. Fill in missing values with those of an ordinary car, or
with values from a log."""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from tse.car.formula import Formula, read_formula
from tse.library.core import ALL_SETTINGS_HINT, NOMINAL, Config, EffectRow, SettingError, library
from tse.library.errors import UserError, suggest_names
from tse.library.files import read_toml
from tse.log.noise import compute_misfit, estimate_noise
from tse.log.rows import MEASURES, CheckedLog

GRAVITY = 9.81  # [m/s2] the same value as in the library
REQUIRED = ("mass", "lf", "lr", "wheel_radius_front", "wheel_radius_rear")
WHEELBASE_TOLERANCE = 0.01  # [m] max difference of wheelbase and lf + lr
# [kg/m2] Plausible range of mass / wheelbase^2. The ratio is about 100 in small cars, and
# 380 in vans. A mass in pounds instead of kg increases the ratio by the factor 2.2.
MAX_MASS_RATIO, MIN_MASS_RATIO = 420.0, 70.0
# Keys whose values a calibration takes as known. If one of them is changed afterwards,
# the calibration is no longer valid.
CALIBRATED_FACTS = ("mass", "lf", "lr")
# [1] Max lf / lr of cars with front-wheel drive. Their front axle carries more than half
# of the weight, so lf / lr is normally below 1. If the ratio exceeds this limit, there is
# a message that lf or lr is probably wrong.
MAX_REAR_RATIO = 1.05
# keys at the top of the file that are not settings
DESCRIPTIVE = (
    "name",
    "wheelbase",
    "steering_ratio",
    "track_front",
    "track_rear",
    "cg_height",
    "driven_axle",
    "source",
)
# Name of 1/friction of the tyres. The setting and the fitted parameter in the table
# [calibration] have the same name.
FRICTION = "tyre_saturation_inverse_friction"
SHAPE = "tyre_saturation_shape"
VEHICLE_TABLES = ("uncertainty", "sensors", "latency", "effects", "formula", "calibration")
# [1] An unknown table is refused as misspelt if its name is at least this similar to a
# name in VEHICLE_TABLES (ratio of difflib: 1 is equal). Otherwise, it is accepted with a
# note that it is not used, since it may be meant for a different program.
MIN_TABLE_LIKENESS = 0.75
MAX_UNKNOWN_KEYS = 3  # max number of unknown keys that one message lists
# keys with a stiffness that the author of the file guessed: not used, but there is a note
HINT_ONLY = ("author_stiffness_front", "author_stiffness_rear")

# The posterior of a calibration is the prior of the filter. The following values limit
# this prior. Without lower limits, its sds would be too small, since the covariance of
# the calibration does not include the errors of the model of tyres and steering.
MIN_GRIP_SD = 0.1  # [1] min relative sd of the grip
MIN_INVERSE_FRICTION = 0.2  # [1] min 1/friction, i.e. friction of at most 5
# [1] Min of the setting model_sd of a calibrated car. model_sd is the sd of the part of
# an IMU channel that the model does not explain, relative to the rms of the channel.
CALIBRATED_MODEL_SD = 0.05
# Settings of the sensor noise and of the bias walks that a calibration computes from the
# logs and writes to the vehicle file. The filter does not use these values: it estimates
# the noise of the sensors while driving.
FOUND_SENSORS = (
    "accel_x_sd",
    "accel_y_sd",
    "yaw_rate_sd",
    "accel_x_bias_walk",
    "accel_y_bias_walk",
    "yaw_rate_bias_walk",
    "wheel_noise_sd",
)
DRIVEN = {"both": 0, "front": 1, "rear": 2}  # values of the setting driven_axle


@dataclass
class Vehicle:
    """Contents of a vehicle file, and the values that were filled in for missing keys."""

    path: Path | None
    name: str
    values: dict[str, float]  # settings by name
    facts: dict[str, Any]  # keys of the file that are not settings: DESCRIPTIVE, HINT_ONLY
    # messages on the values that were filled in for missing keys
    filled: list[str] = field(default_factory=list)
    # messages on the calibration on the logs of the same run (calibration/own.py): its
    # result, or why it was not made
    found: list[str] = field(default_factory=list)
    given_uncertainty: list[str] = field(default_factory=list)  # keys of [uncertainty] in the file
    notes: list[str] = field(default_factory=list)
    # messages on implausible values, e.g. of the mass, that make every stiffness wrong
    wrong: list[str] = field(default_factory=list)
    formula: Formula | None = None  # read from the file that the table [formula] names
    formula_path: Path | None = None
    # Table [calibration], as written by `tselab calibrate`; {} if the file has no such
    # table. Keys: "names", "mean" and "covariance" of the fitted unknowns. "of": values
    # of CALIBRATED_FACTS when the car was calibrated. "own": True if the car was
    # calibrated on the same logs in which the stiffness is then estimated.
    calibration: dict[str, Any] = field(default_factory=dict)

    @property
    def steering_ratio(self) -> float | None:
        """Angle of the steering wheel / angle of the front wheels; None: unknown."""
        ratio = self.facts.get("steering_ratio")
        return float(ratio) if isinstance(ratio, (int, float)) and ratio > 0 else None

    @property
    def driven_axle(self) -> str:
        """Driven axle: "front", "rear" or "both"; default "front"."""
        return str(self.facts.get("driven_axle", "front"))


@functools.cache
def get_unknown_car() -> dict[str, float]:
    """Return the settings of [uncertainty] for an uncalibrated car. They are the same for
    every mass, lf and lr."""
    return {
        name: value
        for name, value in _compute_class_values(1900.0, 1.25, 1.5).items()
        if name in library().uncertainties
    }


@functools.cache
def _compute_class_values(mass: float, lf: float, lr: float) -> dict[str, float]:
    """Return settings of an ordinary car: name -> value.

    `mass`: [kg]. `lf`, `lr`: [m] distance of the front and rear axle from the centre of
    gravity. A setting is left out if it has the same value in Config.exact(), i.e. in the
    settings of an exactly known car with this mass, lf and lr."""
    about = {"mass": mass, "lf": lf, "lr": lr}
    before = Config.exact(about).as_dict()
    car = Config(about)
    car.fill("tse_config_complete")
    return {name: float(value) for name, value in car.as_dict().items() if value != before[name]}


def make_filter_values(vehicle: Vehicle) -> dict[str, float]:
    """Return the settings of the car for the default filter.

    Settings that the vehicle file leaves out have these values:
    - If all keys of [uncertainty] are 0, i.e. the car is known exactly: Config.exact().
    - If it is not calibrated: those of an ordinary car with the same mass, lf and lr
      (src/tables/uncalibrated.toml), as in C and the FMU.
    - If it is calibrated: Config.exact(), but cg_height, grade_sd and the sensor settings
      are those of an ordinary car.

    For a calibrated car, some settings replace those of the file. The initial sds of the
    stiffnesses, the tyre curve, grip_sd and model_sd follow from the calibration, within
    the limits MIN_GRIP_SD, MIN_INVERSE_FRICTION and CALIBRATED_MODEL_SD. FOUND_SENSORS
    have the values of an ordinary car.
    """
    v = dict(vehicle.values)
    v["driven_axle"] = DRIVEN[vehicle.driven_axle]
    if "cg_height" in vehicle.facts:
        v["cg_height"] = float(vehicle.facts["cg_height"])
    if all(v.get(key) == 0 for key in list_uncertainty_settings()):
        return {**Config.settings_of("exact"), **v}
    ordinary = _compute_class_values(v["mass"], v["lf"], v["lr"])
    if not vehicle.calibration:
        return {**ordinary, **v}
    c = vehicle.calibration
    mean = dict(zip(c["names"], c["mean"], strict=True))
    sd = {name: float(np.sqrt(c["covariance"][i][i])) for i, name in enumerate(c["names"])}
    found, plain = {"grip_sd": ordinary["grip_sd"]}, Config.exact()
    for key, name in (("cx_front", "cx"), ("cy_front", "cy_front"), ("cy_rear", "cy_rear")):
        setting = f"initial_{name}_sd"
        found[setting] = float(min(sd.get(key, np.inf), ordinary.get(setting, getattr(plain, setting))))
    found["grip"], found[SHAPE] = choose_curve(
        ordinary, mean.get(FRICTION, 0.0), v.get(SHAPE, ordinary[SHAPE])
    )
    if mean.get(FRICTION):
        found["grip_sd"] = min(max(sd[FRICTION] * found["grip"], MIN_GRIP_SD), 1.0)  # relative
    stated = {name: x for name, x in v.items() if name not in FOUND_SENSORS}
    sensors = {
        name: stated.get(name, ordinary.get(name, float(getattr(plain, name))))
        for name in list_sensor_settings()
    }
    found["model_sd"] = max(v.get("model_sd", 0.0), CALIBRATED_MODEL_SD)
    of_class = {name: ordinary[name] for name in ("cg_height", "grade_sd")}
    return {**Config.settings_of("exact"), **of_class, **v, **sensors, **found}


def get_ordinary_car(config: Config) -> dict[str, float]:
    """Return settings of an ordinary car with the mass, lf and lr of `config`."""
    return _compute_class_values(float(config.mass), float(config.lf), float(config.lr))


def choose_curve(ordinary: Mapping[str, float], inverse: float, shape: float) -> tuple[float, float]:
    """Return the grip, i.e. the friction coefficient, and the shape of the tyre curve.

    `ordinary`: settings of an ordinary car. `inverse`: fitted 1/friction; 0: friction was
    not fitted, and the function returns grip and shape of `ordinary`. `shape`: shape that
    is returned if friction was fitted.
    """
    if not inverse:
        return ordinary["grip"], ordinary[SHAPE]
    return 1.0 / max(inverse, MIN_INVERSE_FRICTION), shape


def list_known_stiffness(vehicle: Vehicle) -> dict[str, tuple[float, float, float]]:
    """Return the stiffnesses of a calibrated file: key -> (value, min, max), N/rad or N.

    Min and max are the limits of the 95 % interval. {}: the file has no calibration."""
    c, found = vehicle.calibration, {}
    for key in NOMINAL if c else ():
        value = float(vehicle.values[NOMINAL[key]])
        by = float(np.exp(1.96 * np.sqrt(c["covariance"][c["names"].index(key)][c["names"].index(key)])))
        found[key] = value, value / by, value * by
    return found


def describe_stiffness(vehicle: Vehicle) -> str:
    """Return the stiffnesses of a calibrated car with their intervals, as one line."""
    # longitudinal stiffness is observable at the driven axle only
    rear = vehicle.driven_axle == "rear"
    along = "rear longitudinal" if rear else "front longitudinal"
    units = {
        "cy_front": ("front cornering", "kN/rad"),
        "cy_rear": ("rear cornering", "kN/rad"),
        "cx_front": (along, "kN"),
    }
    known = {k: [x / 1000 for x in v] for k, v in list_known_stiffness(vehicle).items()}
    if rear and known:
        by = vehicle.values["longitudinal_stiffness_rear"] / vehicle.values["longitudinal_stiffness_front"]
        known["cx_front"] = [by * x for x in known["cx_front"]]
    parts = [
        f"{units[k][0]} {known[k][0]:.0f} {units[k][1]} ({known[k][1]:.0f} .. {known[k][2]:.0f})"
        for k in units
    ]
    return f"Stiffness at no slip, 95 % interval: {', '.join(parts)}."


def list_vehicle_settings() -> list[str]:
    """Return the names of the settings at the top of a vehicle file."""
    return list(library().settings_in("vehicle"))


def list_uncertainty_settings() -> list[str]:
    """Return the names of the settings in [uncertainty]: src/tables/uncertainty.toml."""
    return list(library().uncertainties)


def list_sensor_settings() -> list[str]:
    """Return the names of the settings in [sensors]."""
    return list(library().settings_in("sensors", "velocity", "pedals", "road"))


def list_latency_settings() -> dict[str, str]:
    """Return a dict: key in the table [latency], i.e. name of a channel -> setting."""
    return {name.removesuffix("_latency"): name for name in library().settings_in("latency")}


def list_formula_settings() -> list[str]:
    """Return the names of the settings of a formula: src/tables/formula.toml."""
    return list(library().settings_in("formula"))


def make_default_vehicle() -> Vehicle:
    """Return the car whose settings are the library's defaults."""
    return Vehicle(None, "the built-in car", {}, {"driven_axle": "front"})


def read_vehicle(path: Path) -> Vehicle:
    """Read and check a vehicle file. Fill in missing yaw inertia, stiffnesses and sds.

    An unknown table only causes a note, since it may be meant for a different program. A
    table whose name resembles one in VEHICLE_TABLES (MIN_TABLE_LIKENESS) is an error.

    Raises
    ------
    UserError
        The file cannot be read, or a key is invalid or unknown. Unknown keys are errors,
        since the value of a misspelt key would otherwise be ignored, and the value of
        an ordinary car would be used.
    """
    path = Path(path)
    return make_vehicle(read_toml(path), path)


def make_vehicle(data: dict[str, Any], path: Path) -> Vehicle:
    """Make a vehicle from the contents of a file.

    Parameters
    ----------
    data
        Contents of the file as nested dicts. The function removes the tables from it.
    path
        Name of the file in messages; its folder contains the file of the formula.

    Raises
    ------
    UserError
        As in read_vehicle().
    """
    sensors, uncertainty = _pop_table(path, data, "sensors"), _pop_table(path, data, "uncertainty")
    calibration = _read_calibration(path, _pop_table(path, data, "calibration"))
    latency = _pop_table(path, data, "latency")
    formula_path = _find_formula(path, _pop_table(path, data, "formula"))
    formula = read_formula(formula_path) if formula_path else None
    values: dict[str, float] = dict(formula.settings()) if formula else {}
    check = Config()
    unknown = _read_effects(path, data.pop("effects", {}), check, values)
    tables = {"": data, "uncertainty": uncertainty, "sensors": sensors, "latency": latency}
    facts, others = _read_tables(path, tables, check, values, unknown)
    if unknown:
        more = len(unknown) - MAX_UNKNOWN_KEYS
        rest = f"; and {more} more" if more > 0 else ""
        raise UserError(f"{path}: {'; '.join(unknown[:MAX_UNKNOWN_KEYS])}{rest}")
    missing = [key for key in REQUIRED if key not in values]
    if missing:
        ranges = "; ".join(f"{k}: {check.fields[k].range_text}" for k in missing)
        raise UserError(f"{path}: key {', '.join(missing)} is missing (allowed: {ranges})")
    name = str(facts.get("name", path.stem))
    vehicle = Vehicle(path, name, values, facts, formula=formula, formula_path=formula_path)
    vehicle.calibration = calibration
    if others:
        vehicle.notes.append(f"{path.name}: [{'], ['.join(others)}] is unknown and not used")
    _check_facts(path, vehicle)
    _fill_vehicle(vehicle)
    vehicle.given_uncertainty = [key for key in list_uncertainty_settings() if key in uncertainty]
    vehicle.wrong = _list_implausible(path, vehicle)
    vehicle.notes += _list_conflicts(path, vehicle, uncertainty)
    vehicle.notes += [*vehicle.wrong, *_list_changed_facts(path, vehicle)]
    if any(k in facts for k in HINT_ONLY):
        vehicle.notes.append(
            f"{path.name}: author_stiffness_* are guesses and not used; to start from them, rename them to "
            "cornering_stiffness_*"
        )
    return vehicle


def _read_tables(
    path: Path,
    tables: Mapping[str, dict[str, Any]],
    check: Config,
    values: dict[str, float],
    unknown: list[str],
) -> tuple[dict[str, Any], list[str]]:
    """Add settings of the tables to `values`, and messages on unknown keys to `unknown`.
    Raise UserError if a value is invalid.

    `tables`: name of the table -> contents. The name "" means the top of the file.
    `check`: a Config. Each value is set in it only to check the range of the value.

    Returns
    -------
    facts
        Keys that are not settings: DESCRIPTIVE, HINT_ONLY.
    others
        Names of unknown tables.
    """
    settings: dict[str, dict[str, str]] = {
        "": {key: key for key in list_vehicle_settings()},
        "uncertainty": {key: key for key in list_uncertainty_settings()},
        "sensors": {key: key for key in list_sensor_settings()},
        "latency": list_latency_settings(),
    }
    facts: dict[str, Any] = {}
    others: list[str] = []
    for name, table in tables.items():
        prefix = f"{name}." if name else ""
        for key, value in table.items():
            if key in settings[name]:
                setting = settings[name][key]
                _set_value(check, setting, value, f"{path}: key {prefix}{key}")
                values[setting] = float(value)
            elif not name and key in DESCRIPTIVE + HINT_ONLY:
                facts[key] = value
            elif not name and _is_table(value):
                if near := get_close_matches(key, VEHICLE_TABLES, 1, MIN_TABLE_LIKENESS):
                    raise UserError(f"{path}: table [{key}] is not known (did you mean [{near[0]}]?)")
                others.append(key)
            else:
                unknown.append(f"key {prefix}{key} is not known{_advise_key(name, key, settings)}")
    return facts, others


def _list_conflicts(path: Path, vehicle: Vehicle, uncertainty: Mapping[str, Any]) -> list[str]:
    """Return notes on tables that contradict each other or other keys of the file."""
    found, values = [], vehicle.values
    is_exact = all(uncertainty.get(key) == 0 for key in list_uncertainty_settings())
    exact = Config.exact()
    if is_exact and any(
        key in values and values[key] != getattr(exact, key) for key in list_vehicle_settings()
    ):
        found.append(
            f"{path.name}: [uncertainty] is 0 throughout: the car is assumed to be known exactly, and "
            "intervals include only the noise of the sensors; for a real car, leave the table out, or "
            "calibrate the car"
        )
    names, means = vehicle.calibration.get("names", []), vehicle.calibration.get("mean", [])
    mean = dict(zip(names, means, strict=True)).get(FRICTION)
    if mean is not None and FRICTION in values and abs(values[FRICTION] - mean) > 1e-3 * abs(mean):
        found.append(
            f"{path.name}: effects.tyre_saturation.inverse_friction = {values[FRICTION]:.3g} is not used: "
            f"the filter uses the grip in [calibration], 1/{mean:.3g}; to override it: "
            f"--set grip={1 / max(values[FRICTION], MIN_INVERSE_FRICTION):.3g}"
        )
    return found


def _list_implausible(path: Path, vehicle: Vehicle) -> list[str]:
    """Return messages on an implausible mass or position of the axles.

    Such errors cannot be found in a log, but make the estimates wrong: the stiffness is
    proportional to the mass and depends on the position of the centre of gravity.
    """
    mass, lf, lr = (vehicle.values[key] for key in ("mass", "lf", "lr"))
    found = []
    if not MIN_MASS_RATIO < mass / (lf + lr) ** 2 < MAX_MASS_RATIO:
        what = "little" if mass / (lf + lr) ** 2 < MAX_MASS_RATIO else "much"
        found.append(
            f"{path.name}: mass = {mass:g} kg is {what} for lf + lr = {lf + lr:.3g} m: is it in kg, and are "
            "lf and lr in m, from the centre of gravity? Stiffness is wrong by the same factor"
        )
    if vehicle.driven_axle == "front" and lf > MAX_REAR_RATIO * lr:
        found.append(
            f"{path.name}: with lf = {lf:g} m and lr = {lr:g} m the car is heavier at the rear, but "
            "driven_axle is front: are lf and lr exchanged, or is lf the wheelbase? Then both cornering "
            "stiffnesses are wrong"
        )
    return found


def _list_changed_facts(path: Path, vehicle: Vehicle) -> list[str]:
    """Return messages on CALIBRATED_FACTS that differ from those at the calibration."""
    found = []
    of = vehicle.calibration.get("of", {})
    for key, value in of.items() if isinstance(of, dict) else ():
        if key not in CALIBRATED_FACTS or not isinstance(value, int | float):
            continue
        if abs(vehicle.values[key] - value) > 1e-3 * abs(value):
            found.append(
                f"{path.name}: {key} = {vehicle.values[key]:g} was {value:g} when the file was calibrated, "
                "so the calibration is not valid for it: calibrate again"
            )
    return found


def _is_table(value: Any) -> bool:
    """Return whether a value is a TOML table or an array of tables."""
    return isinstance(value, dict) or (
        isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)
    )


def _advise_key(table: str, key: str, known: Mapping[str, Iterable[str]]) -> str:
    """Return a hint at the probable meaning of an unknown key, to end a message.

    `table`: table of the key; "": top of the file. `known`: table -> its keys."""
    if (table, key) == ("latency", "yaw_rate"):
        return ": it is the reference; latencies of the other channels are relative to it"
    known = {name: [*keys] if name else [*keys, *DESCRIPTIVE] for name, keys in known.items()}
    where = {name: f"[{name}]" if name else "at the top, before the first [table]" for name in known}
    if there := [where[name] for name, keys in known.items() if key in keys]:
        return f" here, but {' and '.join(there)}"
    if near := suggest_names(key, known[table]):
        return near
    if key in Config().fields:
        return ": a setting of the filter goes into its own file, --config FILTER.toml"
    elsewhere = {k: where[name] for name, keys in known.items() for k in keys}
    if near := get_close_matches(key, elsewhere, 1):
        return f" (did you mean {near[0]}, {elsewhere[near[0]]}?)"
    own = "" if table else "; put keys of your own into a table, for instance [notes]"
    return f"; 'tselab vehicle --example' lists known keys{own}"


def _pop_table(path: Path, data: dict[str, Any], name: str) -> dict[str, Any]:
    """Remove a table from `data` and return it. Return {} if the table is missing."""
    table = data.pop(name, {})
    if not isinstance(table, dict):
        raise UserError(f"{path}: {name} must be a table: [{name}]")
    return table


def _find_formula(path: Path, table: dict[str, Any]) -> Path | None:
    """Return the path of the file that [formula] names; None: there is no such table.

    The file must be in the folder of the vehicle file."""
    if not table:
        return None
    name = table.get("file")
    if set(table) != {"file"} or not isinstance(name, str) or Path(name).name != name:
        raise UserError(
            f"{path}: [formula] needs exactly one key, file: the name of a formula file in the same folder"
        )
    return path.parent / name


def format_formula_table(formula: Formula, file: Path) -> str:
    """Return the table [formula] of a vehicle file. `file`: path of the formula."""
    name = json.dumps(file.name, ensure_ascii=False)
    return f"\n[formula]  # {formula.text}, at {formula.place}\nfile = {name}\n"


def format_calibration_table(
    names: Sequence[str],
    mean: np.ndarray,
    covariance: np.ndarray,
    own: bool = False,
    of: Mapping[str, float] | None = None,
) -> list[str]:
    """Return the table [calibration] of a vehicle file as lines.

    Parameters
    ----------
    names, mean, covariance
        Posterior of the unknowns of the fit.
    own
        True: the car was calibrated on the same logs in which the stiffness is then
        estimated, so the table is valid for these logs only.
    of
        Settings of the car: name -> value. Those in CALIBRATED_FACTS are written to the
        table. None: no setting is written.
    """
    lines = ["[calibration]"]
    if of:
        lines.append(f"of = {{ {', '.join(f'{key} = {of[key]:.9g}' for key in CALIBRATED_FACTS)} }}")
    if own:
        lines.append(
            "own = true  # calibrated on the logs in which the stiffness is estimated: not valid for others"
        )
    lines += [f"names = {json.dumps(list(names))}", f"mean = {_format_numbers(mean)}", "covariance = ["]
    return [*lines, *(f"  {_format_numbers(row)}," for row in 0.5 * (covariance + covariance.T)), "]"]


def _format_numbers(values: np.ndarray) -> str:
    """Format numbers with nine significant digits.

    Further digits would depend on the order of summation in the calibration."""
    return json.dumps([float(f"{x:.9g}") for x in values])


def _read_calibration(path: Path, table: dict[str, Any]) -> dict[str, Any]:
    """Check and return the table [calibration] that tselab wrote; {}: it is missing."""
    if not table:
        return {}
    try:
        names = [str(name) for name in table["names"]]
        mean, covariance = np.array(table["mean"], float), np.array(table["covariance"], float)
    except (KeyError, TypeError, ValueError):
        raise UserError(
            f"{path}: [calibration] needs names, mean and covariance, as 'tselab calibrate' writes them"
        ) from None
    n = len(names)
    if mean.shape != (n,) or covariance.shape != (n, n) or len(set(names)) < n:
        raise UserError(
            f"{path}: [calibration]: {n} different names need {n} means and {n} rows of {n} covariances"
        )
    sd = np.sqrt(np.abs(np.diag(covariance))) + 1e-300
    finite = np.isfinite(mean).all() and np.isfinite(covariance).all()
    # Check correlations instead of covariances: correlations do not depend on units, so
    # one tolerance for rounding errors suffices.
    correlation = covariance / np.outer(sd, sd) if finite else covariance
    symmetric = finite and np.allclose(correlation, correlation.T, 0, 1e-6)
    if not symmetric or np.linalg.eigvalsh(correlation)[0] <= 0:
        raise UserError(
            f"{path}: [calibration]: covariance is not a covariance matrix: it must be finite, symmetric and "
            "positive definite"
        )
    own = table.get("own") is True
    of = table.get("of", {})
    return {"names": names, "mean": mean.tolist(), "covariance": covariance.tolist(), "own": own, "of": of}


def _read_effects(path: Path, effects: Any, check: Config, values: dict[str, float]) -> list[str]:
    """Add the settings in [effects.<id>] to `values`; return messages on unknown keys."""
    unknown: list[str] = []
    if not isinstance(effects, dict):
        raise UserError(f"{path}: effects must be tables, e.g. [effects.body_roll]")
    catalogue = library().effects
    for effect, parameters in effects.items():
        if effect not in catalogue:
            raise UserError(
                f"{path}: there is no effect '{effect}'"
                f"{suggest_names(effect, catalogue, other=ALL_SETTINGS_HINT)}"
            )
        if not isinstance(parameters, dict):
            raise UserError(f"{path}: effects.{effect} must be a table: [effects.{effect}]")
        settings = {p.name: p.setting for p in catalogue[effect].parameters}
        for key, value in parameters.items():
            if key not in settings:
                hint = suggest_names(key, settings, 1, f" (allowed: {', '.join(settings)})")
                unknown.append(f"key effects.{effect}.{key} is not known{hint}")
                continue
            _set_value(check, settings[key], value, f"{path}: key effects.{effect}.{key}")
            values[settings[key]] = float(value)
    return unknown


def is_set(config: Config, effect: EffectRow) -> bool:
    """Return whether an effect differs from its default.

    By default, the effect "exact kinematics" is on, and all other effects are off."""
    return any(getattr(config, p.setting) != p.default for p in effect.strengths)


def _set_value(config: Config, key: str, value: Any, source: str) -> None:
    """Check and set a setting. UserError: it is not a number, or outside its range."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise UserError(f"{source}: {value!r} is not a number; allowed: {config.fields[key].range_text}")
    try:
        config.set(key, value)
    except SettingError as error:
        raise UserError(f"{source}: {error}") from None
    f = config.fields[key]
    # Config accepts 0 for "not set". In a file, the key must be left out instead.
    if not f.low <= value <= f.high:
        raise UserError(
            f"{source}: {key} = {value:g} is outside its range {f.range_text}; if it is unknown, leave it out"
        )


def _check_facts(path: Path, vehicle: Vehicle) -> None:
    """Check the keys that are not settings, and that the wheelbase equals lf + lr."""
    for key in ("wheelbase", "steering_ratio", "track_front", "track_rear", "cg_height"):
        value = vehicle.facts.get(key)
        if value is not None and (
            isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < 1000
        ):
            raise UserError(f"{path}: key {key}: {value!r} is not a number above 0 and below 1000")
    axle = vehicle.facts.get("driven_axle", "front")
    if axle not in ("front", "rear", "both"):
        raise UserError(f"{path}: key driven_axle: {axle!r} is not known; allowed: front, rear, both")
    lf, lr, wheelbase = vehicle.values["lf"], vehicle.values["lr"], vehicle.facts.get("wheelbase")
    if wheelbase is not None and abs(lf + lr - wheelbase) > WHEELBASE_TOLERANCE:
        raise UserError(
            f"{path}: key wheelbase: {wheelbase:g} m does not agree with lf + lr = {lf + lr:g} m; "
            f"allowed difference: {WHEELBASE_TOLERANCE:g} m"
        )


def _fill_vehicle(vehicle: Vehicle) -> None:
    """Fill in missing values, and append messages to `filled`.

    Yaw inertia and stiffnesses become those of an ordinary car with the same mass, lf and
    lr. Uncertainties become those of an uncalibrated car."""
    v = vehicle.values
    ordinary = _compute_class_values(v["mass"], v["lf"], v["lr"])
    fields = Config().fields
    for key in list_vehicle_settings():
        if key in ordinary and key not in v:
            v[key] = ordinary[key]
            vehicle.filled.append(
                f"{key} = {v[key]:.0f} {fields[key].unit} (rule: an ordinary car of its mass and axles)"
            )
    _fill_uncertainty(vehicle)


def _fill_uncertainty(vehicle: Vehicle) -> None:
    """Set missing uncertainties to those of an uncalibrated car, and append a message
    about them to `vehicle.filled`."""
    fields = Config().fields
    missing = {key: sd for key, sd in get_unknown_car().items() if key not in vehicle.values}
    vehicle.values |= missing
    if missing:
        units = {key: "" if fields[key].unit == "1" else f" {fields[key].unit}" for key in missing}
        text = ", ".join(f"{key} = {sd:g}{units[key]}" for key, sd in missing.items())
        vehicle.filled.append(f"[uncertainty] {text} (rule: an uncalibrated car; 0 means exact)")


def fill_sensors(vehicle: Vehicle, log: CheckedLog) -> None:
    """Set the sensor settings (noise and bias) that the file leaves out.

    They are estimated from the log by the rules of log/noise.py."""
    average_sensors(vehicle, log)
    v = vehicle.values
    config, ordinary = Config(v), _compute_class_values(v["mass"], v["lf"], v["lr"])
    with np.errstate(invalid="ignore"):
        moving = np.abs(log.data["wheel_speed_front"].to_numpy()) * config.wheel_radius_front > 2.0
    silent = any(f"{channel}_sd" not in v for channel in MEASURES)
    misfits = compute_misfit(log, config.wheel_radius_front, config.wheel_radius_rear) if silent else {}
    _fill_wheel_noise(vehicle, config, log, moving)
    for channel in MEASURES:
        key = f"{channel}_sd"
        f = config.fields[key]
        if key in v:
            continue
        if log.data[channel].isna().all():
            continue
        noise, misfit = estimate_noise(log, channel, moving), misfits.get(channel)
        if noise is None:
            vehicle.filled.append(f"{key} = {f.default:.3g} {f.unit} (default: the log is too short)")
            continue
        sd, text = noise.sd, noise.text
        if misfit is not None and misfit.sd > sd:
            sd = misfit.sd
            text = f"residual of the kinematics {sd:.3g}; noise of the sensor {noise.sd:.3g}"
        _fill_setting(vehicle, config, key, sd, f"from the log: {text}")
        bias, why = ordinary[f"{channel}_bias_sd"], "rule: a sensor without stated bias"
        if misfit is not None and misfit.bias > bias:
            bias, why = misfit.bias, "from the log: slow residual of the kinematics"
        _fill_setting(vehicle, config, f"{channel}_bias_sd", bias, why)
        if misfit is not None:
            walk = max(misfit.walk, config.fields[f"{channel}_bias_walk"].default)
            why = "from the log: change of the slow residual over 1 s"
            _fill_setting(vehicle, config, f"{channel}_bias_walk", walk, why)


def _fill_wheel_noise(vehicle: Vehicle, config: Config, log: CheckedLog, moving: np.ndarray) -> None:
    """If the vehicle file does not state the noise of the wheel speeds, set it to the
    noise that the log has at the noisier axle."""
    found = {a: estimate_noise(log, f"wheel_speed_{a}", moving) for a in ("front", "rear")}
    found = {axle: noise for axle, noise in found.items() if noise is not None}
    if found:
        axle = max(found, key=lambda a: found[a].sd)
        noise = found[axle]
        _fill_setting(vehicle, config, "wheel_noise_sd", noise.sd, f"from the log, {axle} axle: {noise.text}")


def average_sensors(vehicle: Vehicle, log: CheckedLog) -> None:
    """Reduce the stated noise of sensors if each row of the log is a mean of n samples.

    The stated sd is that of one sample. The sd of the mean is sd / sqrt(n), with n =
    log.averaged."""
    fields = Config().fields
    for key in ("wheel_noise_sd", *(f"{channel}_sd" for channel in MEASURES)):
        if log.averaged < 2 or key not in vehicle.values:
            continue
        f = fields[key]
        said = vehicle.values[f.name]
        vehicle.values[f.name] = float(np.clip(said / np.sqrt(log.averaged), f.low, f.high))
        vehicle.notes.append(
            f"{f.name}: {said:g} {f.unit} for one sample is {vehicle.values[f.name]:.3g} {f.unit} for a mean "
            f"of {log.averaged}"
        )


def _fill_setting(vehicle: Vehicle, config: Config, key: str, value: float, why: str) -> None:
    """Set a sensor setting that the vehicle file leaves out. `why`: source of the
    value."""
    if key not in vehicle.values:
        f = config.fields[key]
        vehicle.values[key] = float(np.clip(value, f.low, f.high))
        vehicle.filled.append(f"{key} = {vehicle.values[key]:.3g} {f.unit} ({why})")
