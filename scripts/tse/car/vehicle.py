"""Reading a vehicle file, and the rules that fill in what it leaves out."""

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
from tse.library.core import ALL, NOMINAL, Config, Effect, SettingError, library
from tse.library.errors import UserError, meant
from tse.library.files import read_toml
from tse.log.noise import kinematic_misfit, noise_of
from tse.log.rows import MEASURES, Log

GRAVITY = 9.81
REQUIRED = ("mass", "lf", "lr", "wheel_radius_front", "wheel_radius_rear")
WHEELBASE_TOLERANCE = 0.01  # m
HEAVY, LIGHT = (
    420.0,
    70.0,
)  # kg/m2: of mass over wheelbase squared: small cars 100, vans 380; pounds for kg make 2.2 of it
CALIBRATED_OF = ("mass", "lf", "lr")  # what a calibration takes as the file says it
REAR_HEAVY = 1.05  # lf over lr: no car that drives its front wheels alone is more so
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
FRICTION = "tyre_saturation_inverse_friction"  # setting, and its name in [calibration]
SHAPE = "tyre_saturation_shape"
TABLES = ("uncertainty", "sensors", "latency", "effects", "formula", "calibration")
ALIKE = 0.75  # of difflib: a table that is named so much like one of TABLES is thought to be misspelt
MOST_UNKNOWN = 3  # keys that one message lists
HINT_ONLY = ("author_stiffness_front", "author_stiffness_rear")

# Limits below which what a calibration finds is not believed, since tyres and steering are not quite as the model.
LEAST_GRIP_SD, LEAST_INVERSE = 0.1, 0.2
CALIBRATED_MODEL_SD = 0.05
FOUND_SENSORS = (  # what a calibration says of sensors is of its own residuals: the filter finds their noise while driving
    "accel_x_sd", "accel_y_sd", "yaw_rate_sd", "accel_x_bias_walk", "accel_y_bias_walk", "yaw_rate_bias_walk", "wheel_noise_sd",
)  # fmt: skip
DRIVEN = {"both": 0, "front": 1, "rear": 2}  # the setting driven_axle


@dataclass
class Vehicle:
    """A vehicle file, read: values for Config, the rest, and what was filled in by rule."""

    path: Path | None
    name: str
    values: dict[str, float]
    facts: dict[str, Any]
    filled: list[str] = field(default_factory=list)
    found: list[str] = field(default_factory=list)  # by a calibration on the log itself, in words
    given_uncertainty: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)  # of the notes: by which every stiffness is wrong
    formula: Formula | None = None  # of the user: [formula] names its file
    formula_path: Path | None = None
    calibration: dict[str, Any] = field(
        default_factory=dict
    )  # what an earlier `tselab calibrate` left: names, mean, covariance; own: on the log that is estimated

    @property
    def steering_ratio(self) -> float | None:
        """Angle of the steering wheel over that of the front wheels; None: the file does not say it."""
        ratio = self.facts.get("steering_ratio")
        return float(ratio) if isinstance(ratio, (int, float)) and ratio > 0 else None

    @property
    def driven_axle(self) -> str:
        """ "front", "rear" or "both"; "front" where the file does not say it."""
        return str(self.facts.get("driven_axle", "front"))


@functools.cache
def unknown_car() -> dict[str, float]:
    """Return how uncertain the parameters of an uncalibrated car are: sd in units of src/tables/uncertainty.toml."""
    return {
        name: value
        for name, value in _class_values(1900.0, 1.25, 1.5).items()
        if name in library().uncertainties
    }


@functools.cache
def _class_values(mass: float, lf: float, lr: float) -> dict[str, float]:
    """Return what an ordinary car of this mass and these axles has, where it is not what a car has that is known exactly."""
    about = {"mass": mass, "lf": lf, "lr": lr}
    before = Config.exact(about).as_dict()
    car = Config(about)
    car.fill("tse_config_complete")
    return {name: float(value) for name, value in car.as_dict().items() if value != before[name]}


def filter_values(vehicle: Vehicle) -> dict[str, float]:
    """Return the settings of the car's filter, beside the defaults: what the vehicle file says, and the prior of what it does not.

    Nobody has calibrated it: an ordinary car of its class (src/tables/uncalibrated.toml), the same as in C and FMU. Calibrated: the
    posterior of the calibration is the prior. [uncertainty] all 0: known exactly, nothing is added."""
    v = dict(vehicle.values)
    v["driven_axle"] = DRIVEN[vehicle.driven_axle]
    if "cg_height" in vehicle.facts:
        v["cg_height"] = float(vehicle.facts["cg_height"])
    if all(v.get(key) == 0 for key in uncertainty_settings()):
        return {**Config.settings_of("exact"), **v}
    ordinary = _class_values(v["mass"], v["lf"], v["lr"])
    if not vehicle.calibration:
        return {**ordinary, **v}
    c = vehicle.calibration
    mean = dict(zip(c["names"], c["mean"], strict=True))
    sd = {name: float(np.sqrt(c["covariance"][i][i])) for i, name in enumerate(c["names"])}
    found, plain = {"grip_sd": ordinary["grip_sd"]}, Config.exact()
    for key, name in (("cx_front", "cx"), ("cy_front", "cy_front"), ("cy_rear", "cy_rear")):
        setting = f"initial_{name}_sd"
        found[setting] = float(min(sd.get(key, np.inf), ordinary.get(setting, getattr(plain, setting))))
    found["grip"], found[SHAPE] = curve_of(ordinary, mean.get(FRICTION, 0.0), v.get(SHAPE, ordinary[SHAPE]))
    if mean.get(FRICTION):
        found["grip_sd"] = min(max(sd[FRICTION] * found["grip"], LEAST_GRIP_SD), 1.0)  # relative
    stated = {name: x for name, x in v.items() if name not in FOUND_SENSORS}
    sensors = {
        name: stated.get(name, ordinary.get(name, float(getattr(plain, name)))) for name in sensor_settings()
    }
    found["model_sd"] = max(v.get("model_sd", 0.0), CALIBRATED_MODEL_SD)
    of_class = {name: ordinary[name] for name in ("cg_height", "grade_sd")}
    return {**Config.settings_of("exact"), **of_class, **v, **sensors, **found}


def ordinary_car(config: Config) -> dict[str, float]:
    """Return what an ordinary car has of this mass and these axles."""
    return _class_values(float(config.mass), float(config.lf), float(config.lr))


def curve_of(ordinary: Mapping[str, float], inverse: float, shape: float) -> tuple[float, float]:
    """Return grip and shape of the tyres' curve: of a fit, 1/friction and the curve of that; of the class where the fit has no such
    effect, 0."""
    return (1.0 / max(inverse, LEAST_INVERSE), shape) if inverse else (ordinary["grip"], ordinary[SHAPE])


def known_stiffness(vehicle: Vehicle) -> dict[str, tuple[float, float, float]]:
    """Return each stiffness and its 95 % interval, N/rad and N, by the names of NOMINAL: of a file that tselab has calibrated."""
    c, found = vehicle.calibration, {}
    for key in NOMINAL if c else ():
        value = float(vehicle.values[NOMINAL[key]])
        by = float(np.exp(1.96 * np.sqrt(c["covariance"][c["names"].index(key)][c["names"].index(key)])))
        found[key] = value, value / by, value * by
    return found


def stiffness_words(vehicle: Vehicle) -> str:
    """Return what a person should know first."""
    rear = vehicle.driven_axle == "rear"  # the axle that drives is the one that shows it; the other follows
    along = "rear longitudinal" if rear else "front longitudinal"
    units = {
        "cy_front": ("front cornering", "kN/rad"),
        "cy_rear": ("rear cornering", "kN/rad"),
        "cx_front": (along, "kN"),
    }
    known = {k: [x / 1000 for x in v] for k, v in known_stiffness(vehicle).items()}
    if rear and known:
        by = vehicle.values["longitudinal_stiffness_rear"] / vehicle.values["longitudinal_stiffness_front"]
        known["cx_front"] = [by * x for x in known["cx_front"]]
    parts = [
        f"{units[k][0]} {known[k][0]:.0f} {units[k][1]} ({known[k][1]:.0f} .. {known[k][2]:.0f})"
        for k in units
    ]
    return f"Stiffness at no slip, 95 % interval: {', '.join(parts)}."


def vehicle_settings() -> list[str]:
    """Names of the settings that belong in a vehicle file."""
    return list(library().settings_in("vehicle"))


def uncertainty_settings() -> list[str]:
    """Names of the settings that belong in its [uncertainty] table: rows of src/tables/uncertainty.toml."""
    return list(library().uncertainties)


def sensor_settings() -> list[str]:
    """Names of the settings that belong in its [sensors] table."""
    return list(library().settings_in("sensors", "velocity", "pedals", "road"))


def latency_settings() -> dict[str, str]:
    """Settings that belong in its [latency] table, rows of src/tables/sensors.toml, by their keys there: the channels."""
    return {name.removesuffix("_latency"): name for name in library().settings_in("latency")}


def formula_settings() -> list[str]:
    """Names of the settings of a formula of the user, rows of src/tables/formula.toml."""
    return list(library().settings_in("formula"))


def default_vehicle() -> Vehicle:
    """The car of the library's defaults."""
    return Vehicle(None, "the built-in car", {}, {"driven_axle": "front"})


def read_vehicle(path: Path) -> Vehicle:
    """Read a vehicle file and check it; stiffness that is left out is filled in by rule.

    UserError: also a key that nobody knows. A misspelt one would be filled in by a rule, and the numbers would be of another car. A
    table of which nobody knows the name is a note: it may be another program's."""
    path = Path(path)
    return make_vehicle(read_toml(path), path)


def make_vehicle(data: dict[str, Any], path: Path) -> Vehicle:
    """The same of what a vehicle file says, as dictionaries, which are used up. `path` stands in messages."""
    sensors, uncertainty = _table(path, data, "sensors"), _table(path, data, "uncertainty")
    calibration = _calibration(path, _table(path, data, "calibration"))
    latency, latencies = _table(path, data, "latency"), latency_settings()
    formula_path = _formula_path(path, _table(path, data, "formula"))
    formula = read_formula(formula_path) if formula_path else None
    values: dict[str, float] = dict(formula.settings()) if formula else {}
    facts: dict[str, Any] = {}
    check = Config()
    unknown = _read_effects(path, data.pop("effects", {}), check, values)
    tables = {
        "": (data, {key: key for key in vehicle_settings()}),
        "uncertainty": (uncertainty, {key: key for key in uncertainty_settings()}),
        "sensors": (sensors, {key: key for key in sensor_settings()}),
        "latency": (latency, latencies),
    }
    others: list[str] = []  # tables
    for name, (table, known) in tables.items():
        prefix = f"{name}." if name else ""
        for key, value in table.items():
            if key in known:
                _set(check, known[key], value, f"{path}: key {prefix}{key}")
                values[known[key]] = float(value)
            elif not name and key in DESCRIPTIVE + HINT_ONLY:
                facts[key] = value
            elif not name and _is_table(value):
                if near := get_close_matches(key, TABLES, 1, ALIKE):
                    raise UserError(f"{path}: table [{key}] is not known (did you mean [{near[0]}]?)")
                others.append(key)
            else:
                unknown.append(
                    f"key {prefix}{key} is not known{_advice(name, key, {n: t[1] for n, t in tables.items()})}"
                )
    if unknown:
        more = len(unknown) - MOST_UNKNOWN
        raise UserError(
            f"{path}: {'; '.join(unknown[:MOST_UNKNOWN])}{f'; and {more} more' if more > 0 else ''}"
        )
    missing = [key for key in REQUIRED if key not in values]
    if missing:
        ranges = "; ".join(f"{k}: {check.fields[k].range_text}" for k in missing)
        raise UserError(f"{path}: key {', '.join(missing)} is missing (allowed: {ranges})")
    vehicle = Vehicle(
        path, str(facts.get("name", path.stem)), values, facts, formula=formula, formula_path=formula_path
    )
    vehicle.calibration = calibration
    if others:
        vehicle.notes.append(f"{path.name}: [{'], ['.join(others)}] is not known and not used")
    _check_facts(path, vehicle)
    _fill_vehicle(vehicle)
    vehicle.given_uncertainty = [key for key in uncertainty_settings() if key in uncertainty]
    if all(uncertainty.get(key) == 0 for key in uncertainty_settings()) and any(
        key in values and values[key] != getattr(Config.exact(), key) for key in vehicle_settings()
    ):
        vehicle.notes.append(
            f"{path.name}: [uncertainty] is 0 throughout: the car is taken as known exactly, and bands are of the sensors alone; "
            "of a real car leave the table out, or calibrate it"
        )
    found = dict(zip(calibration.get("names", []), calibration.get("mean", []), strict=True)).get(FRICTION)
    if found is not None and FRICTION in values and abs(values[FRICTION] - found) > 1e-3 * abs(found):
        vehicle.notes.append(
            f"{path.name}: effects.tyre_saturation.inverse_friction is {values[FRICTION]:.3g} and not used: the filter's grip is "
            f"that of [calibration], {found:.3g}; without that table yours is used, and the sds of an ordinary car"
        )
    vehicle.wrong = _wrong(path, vehicle)
    vehicle.notes += [*vehicle.wrong, *_of_another(path, vehicle)]
    if any(k in facts for k in HINT_ONLY):
        vehicle.notes.append(
            f"{path.name}: author_stiffness_* are somebody's guess and not used; to start from them, name them "
            "cornering_stiffness_*"
        )
    return vehicle


def _wrong(path: Path, vehicle: Vehicle) -> list[str]:
    """Return what no car has, and no log tells: stiffness goes with the mass, and with where it is."""
    mass, lf, lr = (vehicle.values[key] for key in ("mass", "lf", "lr"))
    found = []
    if not LIGHT < mass / (lf + lr) ** 2 < HEAVY:
        what = "little" if mass / (lf + lr) ** 2 < HEAVY else "much"
        found.append(
            f"{path.name}: mass = {mass:g} kg is {what} for lf + lr = {lf + lr:.3g} m: is it in kg, and are lf and lr in m, "
            "from the centre of gravity? Stiffness is wrong by the same factor"
        )
    if vehicle.driven_axle == "front" and lf > REAR_HEAVY * lr:
        found.append(
            f"{path.name}: lf = {lf:g} m and lr = {lr:g} m are of a car that is heavier in the rear, and driven_axle is front: are "
            "lf and lr exchanged, or is lf the wheelbase? Both cornering stiffnesses are wrong then"
        )
    return found


def _of_another(path: Path, vehicle: Vehicle) -> list[str]:
    """Return what the file says now, and did not when it was calibrated."""
    found = []
    of = vehicle.calibration.get("of", {})
    for key, value in of.items() if isinstance(of, dict) else ():
        if (
            key in CALIBRATED_OF
            and isinstance(value, int | float)
            and abs(vehicle.values[key] - value) > 1e-3 * abs(value)
        ):
            found.append(
                f"{path.name}: {key} = {vehicle.values[key]:g} was {value:g} when the file was calibrated, and what was found is "
                "of that car: calibrate anew"
            )
    return found


def _is_table(value: Any) -> bool:
    """A table, or several under one name."""
    return isinstance(value, dict) or (
        isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)
    )


def _advice(table: str, key: str, known: Mapping[str, Iterable[str]]) -> str:
    """What may have been meant by a key that is not known in a table; `known`: the keys of all tables by name, "": the top."""
    if (table, key) == ("latency", "yaw_rate"):
        return ": it is the clock, behind which the others are late"
    known = {name: [*keys] if name else [*keys, *DESCRIPTIVE] for name, keys in known.items()}
    where = {name: f"[{name}]" if name else "at the top, before the first [table]" for name in known}
    if there := [where[name] for name, keys in known.items() if key in keys]:
        return f" here, but {' and '.join(there)}"
    if near := meant(key, known[table]):
        return near
    if key in Config().fields:
        return ": a setting of the filter goes into its own file, --config FILTER.toml"
    elsewhere = {k: where[name] for name, keys in known.items() for k in keys}
    if near := get_close_matches(key, elsewhere, 1):
        return f" (did you mean {near[0]}, {elsewhere[near[0]]}?)"
    own = "" if table else ", and facts of your own go into a table, for instance [notes]"
    return f"; 'tselab vehicle --example' shows what is{own}"


def _table(path: Path, data: dict[str, Any], name: str) -> dict[str, Any]:
    """A table of the file, taken out; empty when it is not there."""
    table = data.pop(name, {})
    if not isinstance(table, dict):
        raise UserError(f"{path}: {name} must be a table: [{name}]")
    return table


def _formula_path(path: Path, table: dict[str, Any]) -> Path | None:
    """The file of a formula that [formula] names, beside this one; None when there is none."""
    if not table:
        return None
    name = table.get("file")
    if set(table) != {"file"} or not isinstance(name, str) or Path(name).name != name:
        raise UserError(
            f"{path}: [formula] needs one key, file: the name of a formula beside this file, and nothing else"
        )
    return path.parent / name


def formula_toml(formula: Formula, file: Path) -> str:
    """The table [formula] of a vehicle file beside `file`, which holds the formula."""
    return f"\n[formula]  # {formula.text}, at {formula.place}\nfile = {json.dumps(file.name, ensure_ascii=False)}\n"


def calibration_toml(
    names: Sequence[str],
    mean: np.ndarray,
    covariance: np.ndarray,
    own: bool = False,
    of: Mapping[str, float] | None = None,
) -> list[str]:
    """The table [calibration] of a vehicle file, in lines. `own`: on the logs that are estimated; `of`: settings of the car."""
    lines = ["[calibration]"]
    if of:
        lines.append(f"of = {{ {', '.join(f'{key} = {of[key]:.9g}' for key in CALIBRATED_OF)} }}")
    if own:
        lines.append("own = true  # on the logs that are estimated: for their estimate, and for no other")
    lines += [f"names = {json.dumps(list(names))}", f"mean = {_numbers(mean)}", "covariance = ["]
    return [*lines, *(f"  {_numbers(row)}," for row in 0.5 * (covariance + covariance.T)), "]"]


def _numbers(values: np.ndarray) -> str:
    """To nine digits: beyond them is what order of summation leaves."""
    return json.dumps([float(f"{x:.9g}") for x in values])


def _calibration(path: Path, table: dict[str, Any]) -> dict[str, Any]:
    """The table [calibration], which tselab wrote: names, means and covariance of what was found; {} when it is not there."""
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
    # in the correlation rounding is that of 1, also where two hardly go together
    correlation = covariance / np.outer(sd, sd) if finite else covariance
    symmetric = finite and np.allclose(correlation, correlation.T, 0, 1e-6)
    if not symmetric or np.linalg.eigvalsh(correlation)[0] <= 0:
        raise UserError(
            f"{path}: [calibration]: covariance is not one: it must be finite, symmetric and positive definite"
        )
    own = table.get("own") is True
    of = table.get("of", {})
    return {"names": names, "mean": mean.tolist(), "covariance": covariance.tolist(), "own": own, "of": of}


def _read_effects(path: Path, effects: Any, check: Config, values: dict[str, float]) -> list[str]:
    """The tables [effects.<id>]: parameters by their names in src/tables/effects.toml. Returned: unknown keys, a text each."""
    unknown: list[str] = []
    if not isinstance(effects, dict):
        raise UserError(f"{path}: effects must be tables: [effects.body_roll]")
    catalogue = library().effects
    for effect, parameters in effects.items():
        if effect not in catalogue:
            raise UserError(f"{path}: there is no effect '{effect}'{meant(effect, catalogue, other=ALL)}")
        if not isinstance(parameters, dict):
            raise UserError(f"{path}: effects.{effect} must be a table: [effects.{effect}]")
        settings = {p.name: p.setting for p in catalogue[effect].parameters}
        for key, value in parameters.items():
            if key not in settings:
                hint = meant(key, settings, 1, f" (allowed: {', '.join(settings)})")
                unknown.append(f"key effects.{effect}.{key} is not known{hint}")
                continue
            _set(check, settings[key], value, f"{path}: key effects.{effect}.{key}")
            values[settings[key]] = float(value)
    return unknown


def is_set(config: Config, effect: Effect) -> bool:
    """Return whether an effect is other than by default: exact kinematics off, the others on."""
    return any(getattr(config, p.setting) != p.default for p in effect.strengths)


def _set(config: Config, key: str, value: Any, source: str) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise UserError(f"{source}: {value!r} is not a number; allowed: {config.fields[key].range_text}")
    try:
        config.set(key, value)
    except SettingError as error:
        raise UserError(f"{source}: {error}") from None
    f = config.fields[key]
    if not f.low <= value <= f.high:  # 0, not set: a file leaves that out
        raise UserError(
            f"{source}: {key} = {value:g} is outside its range {f.range_text}; leave out what is not known"
        )


def _check_facts(path: Path, vehicle: Vehicle) -> None:
    for key in ("wheelbase", "steering_ratio", "track_front", "track_rear", "cg_height"):
        value = vehicle.facts.get(key)
        if value is not None and (
            isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < 1000
        ):
            raise UserError(f"{path}: key {key}: {value!r} is not a positive number")
    axle = vehicle.facts.get("driven_axle", "front")
    if axle not in ("front", "rear", "both"):
        raise UserError(f"{path}: key driven_axle: {axle!r} is not known; allowed: front, rear, both")
    lf, lr, wheelbase = vehicle.values["lf"], vehicle.values["lr"], vehicle.facts.get("wheelbase")
    if wheelbase is not None and abs(lf + lr - wheelbase) > WHEELBASE_TOLERANCE:
        raise UserError(
            f"{path}: key wheelbase: {wheelbase:g} m does not agree with lf + lr = {lf + lr:g} m; allowed difference: "
            f"{WHEELBASE_TOLERANCE:g} m"
        )


def _fill_vehicle(vehicle: Vehicle) -> None:
    """Fill in yaw inertia and stiffness of the class, where the file does not say them."""
    v = vehicle.values
    ordinary = _class_values(v["mass"], v["lf"], v["lr"])
    fields = Config().fields
    for key in vehicle_settings():
        if key in ordinary and key not in v:
            v[key] = ordinary[key]
            vehicle.filled.append(
                f"{key} = {v[key]:.0f} {fields[key].unit} (rule: an ordinary car of its mass and axles)"
            )
    _fill_uncertainty(vehicle)


def _fill_uncertainty(vehicle: Vehicle) -> None:
    """What the file does not say how well it knows, as of a car that nobody has calibrated; in one line."""
    fields = Config().fields
    missing = {key: sd for key, sd in unknown_car().items() if key not in vehicle.values}
    vehicle.values |= missing
    if missing:
        units = {key: "" if fields[key].unit == "1" else f" {fields[key].unit}" for key in missing}
        text = ", ".join(f"{key} = {sd:g}{units[key]}" for key, sd in missing.items())
        vehicle.filled.append(f"[uncertainty] {text} (rule: a car that nobody has calibrated; 0 is exact)")


def fill_sensors(vehicle: Vehicle, log: Log) -> None:
    """Sensor noise and bias that the vehicle file leaves out, from the log; the rules are in noise.py."""
    average_sensors(vehicle, log)
    v = vehicle.values
    config, ordinary = Config(v), _class_values(v["mass"], v["lf"], v["lr"])
    with np.errstate(invalid="ignore"):
        moving = np.abs(log.data["wheel_speed_front"].to_numpy()) * config.wheel_radius_front > 2.0
    silent = any(f"{channel}_sd" not in v for channel in MEASURES)
    misfits = kinematic_misfit(log, config.wheel_radius_front, config.wheel_radius_rear) if silent else {}
    _fill_wheel_noise(vehicle, config, log, moving)
    for channel in MEASURES:
        key = f"{channel}_sd"
        f = config.fields[key]
        if key in v:
            continue
        if log.data[channel].isna().all():
            continue  # not in the log: it is not asked
        noise, misfit = noise_of(log, channel, moving), misfits.get(channel)
        if noise is None:
            vehicle.filled.append(f"{key} = {f.default:.3g} {f.unit} (default: the log is too short to tell)")
            continue
        sd, text = noise.sd, noise.text
        if misfit is not None and misfit.sd > sd:
            sd, text = misfit.sd, f"residual of the kinematics {misfit.sd:.3g}; sensor alone {noise.sd:.3g}"
        _fill(vehicle, config, key, sd, f"from the log: {text}")
        bias, why = ordinary[f"{channel}_bias_sd"], "rule: a sensor nobody has described"
        if misfit is not None and misfit.bias > bias:
            bias, why = misfit.bias, "from the log: slow residual of the kinematics"
        _fill(vehicle, config, f"{channel}_bias_sd", bias, why)
        if misfit is not None:
            walk = max(misfit.walk, config.fields[f"{channel}_bias_walk"].default)
            _fill(
                vehicle,
                config,
                f"{channel}_bias_walk",
                walk,
                "from the log: change of the slow residual over 1 s",
            )


def _fill_wheel_noise(vehicle: Vehicle, config: Config, log: Log, moving: np.ndarray) -> None:
    found = {a: noise_of(log, f"wheel_speed_{a}", moving) for a in ("front", "rear")}
    found = {axle: noise for axle, noise in found.items() if noise is not None}
    if found:
        axle = max(found, key=lambda a: found[a].sd)
        _fill(
            vehicle,
            config,
            "wheel_noise_sd",
            found[axle].sd,
            f"from the log, {axle} axle: {found[axle].text}",
        )


def average_sensors(vehicle: Vehicle, log: Log) -> None:
    """Make the noise of one sample, as the file states it, that of a mean of several, where the log has means."""
    fields = Config().fields
    for key in ("wheel_noise_sd", *(f"{channel}_sd" for channel in MEASURES)):
        if log.averaged < 2 or key not in vehicle.values:
            continue
        f = fields[key]
        said = vehicle.values[f.name]
        vehicle.values[f.name] = float(np.clip(said / np.sqrt(log.averaged), f.low, f.high))
        vehicle.notes.append(
            f"{f.name}: {said:g} {f.unit} of one sample is {vehicle.values[f.name]:.3g} of a mean of {log.averaged}"
        )


def _fill(vehicle: Vehicle, config: Config, key: str, value: float, why: str) -> None:
    """Fill one sensor setting in, if the file leaves it out."""
    if key not in vehicle.values:
        f = config.fields[key]
        vehicle.values[key] = float(np.clip(value, f.low, f.high))
        vehicle.filled.append(f"{key} = {vehicle.values[key]:.3g} {f.unit} ({why})")
