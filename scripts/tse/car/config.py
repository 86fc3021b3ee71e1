"""Collect the settings of a run.

Each of these sources overrides those before it: defaults, vehicle file, the log (sample
time, max gap, one or two wheel signals), file of --config, options.
"""

import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tse.car.vehicle import Vehicle, make_filter_values
from tse.library.core import Config, SettingError, library
from tse.library.errors import UserError
from tse.library.files import read_toml
from tse.log.rows import ROAD_COLUMNS, TORQUE_COLUMNS, VELOCITY_COLUMNS, CheckedLog

# [sample times] Min of the setting max_gap. With a smaller value, a few missing rows of a
# slowly sampled log would already be treated as a gap.
GAP_IN_SAMPLES = 5
# Front and rear wheel speed are the same signal if their ratio varies by less than
# SAME_RATIO over all rows with a wheel speed above ROLLING [rad/s], and if there are more
# than MANY such rows.
ROLLING, MANY, SAME_RATIO = 5.0, 500, 1e-3
ONE_SPEED = (
    "both wheel speeds are one signal: taken as the vehicle's speed, which does not show slip; "
    "longitudinal stiffness is not estimated"
)
# Names of the filters in src/tables. The value of the setting `form` is an index of this
# tuple.
FILTERS = ("default", "paper")
# tables of src/tables whose settings belong to a filter, not to the car
TUNING = ("filter", "sensors")
# name of a filter -> text for messages on how to select this filter by the option `form`
FORM_PHRASES = {"default": "form default", "paper": "form robust or paper"}


def read_filter_file(path: Path) -> dict[str, float]:
    """Read the file of the option --config, which contains settings of the filter. They
    are keys at the top of the file, or keys of its table [filter].

    Raises
    ------
    UserError
        A key appears both at the top and in [filter], there is no setting with the name
        of a key, or a value is outside its range.
    """
    data = read_toml(path)
    nested = data.pop("filter", {})
    if not isinstance(nested, dict):
        raise UserError(f"{path}: filter must be a table: [filter]")
    both = sorted(set(data) & set(nested))
    if both:
        raise UserError(f"{path}: key {both[0]} appears twice, at the top and under [filter]")
    values: dict[str, float] = {}
    check = Config()
    for key, value in {**data, **nested}.items():
        try:
            check.set(key, value)
        except SettingError as error:
            raise UserError(f"{path}: key {key}: {error}") from None
        values[key] = value
    return values


def make_config(
    vehicle: Vehicle,
    log: CheckedLog | None,
    filter_file: Path | None = None,
    options: Mapping[str, Any] | None = None,
    form: str = "default",
) -> tuple[Config, list[str]]:
    """Return the settings of a run, and notes.

    The notes name the settings that follow from the log, and the settings stated by the
    user that the filter does not use.

    Parameters
    ----------
    vehicle : Vehicle
        The car.
    log : CheckedLog or None
        Log of the run. It determines the sample time, and whether both wheel speeds are
        the same signal. None: no setting follows from a log.
    filter_file : Path or None
        File with further settings, from option --config. None: no file.
    options : Mapping or None
        Further settings from command-line options: name -> value. Value None: the option
        is not given.
    form : str
        Filter and its settings. "default": the Kalman filter. "paper": the particle
        filter of the paper. "robust": the same particle filter with robust settings.

    Raises
    ------
    UserError
        A setting is outside its range. Or the log has an optional channel that the filter
        does not use. Or `options` or `filter_file` has a setting for an optional
        channel that the log does not have.
    """
    values = make_filter_values(vehicle) if form == "default" else vehicle.values
    config = Config({**Config.settings_of(form), **values})
    notes: list[str] = []
    if log is not None and log.sample_time is not None:
        notes += set_sampling(config, log.sample_time)
    if log is not None and wheels_are_one(log):
        config.wheel_signals = 1
        notes.append(ONE_SPEED)
    stated = {p: vehicle.values[p] for p in effect_settings() if p in vehicle.values}
    if filter_file is not None:
        for key, value in read_filter_file(filter_file).items():
            config.set(key, value)
            stated[key] = value
    for key, value in (options or {}).items():
        if value is not None:
            config.set(key, value, source=f"option --{key.replace('_', '-')}")
            stated[key] = value
    found = vehicle.calibration.get("names", ())
    notes += unused_notes(
        config, {k: x for k, x in stated.items() if k not in found}, vehicle.formula is not None
    )
    if form != "default":
        notes.append(
            f"form {form} is the filter of the paper, for comparison only: "
            "for an ordinary car, its values and intervals are wrong"
        )
    asked = {key for key, x in config.as_dict().items() if x != values.get(key)}
    _check_optional(config, log, asked)
    return config.complete(), notes


def filter_of(config: Config) -> str:
    """Return the filter that these settings select: default or paper."""
    return FILTERS[int(config.form)]


def is_used(name: str, config: Config) -> bool:
    """Return whether the filter that `config` selects uses the setting `name`.

    There are two reasons why a setting is not used. It belongs only to the filter that is
    not selected. Or a second setting replaces it: the field `replaced_by` of the setting
    (src/tables) names this second setting, and the value of the second setting is not 0.
    """
    use = library().settings[name]
    replaced = bool(use.replaced_by) and getattr(config, use.replaced_by) != 0
    return use.filter in ("both", filter_of(config)) and not replaced


def check_effect(names: Collection[str], config: Config) -> None:
    """Raise an error if a setting for this run belongs to the filter that is not
    selected.

    Such a setting would have no effect. In a vehicle file, such settings are accepted,
    since the file is used with both filters. unused_notes() lists them.

    Parameters
    ----------
    names : Collection of str
        Settings that the user states for this run. A setting with its default value is
        accepted.
    config : Config
        All settings of the run.

    Raises
    ------
    SettingError
        A setting belongs to the filter that is not selected.
    """
    for name in config.changed():
        use = library().settings[name]
        if name in names and use.table in TUNING and use.filter not in ("both", filter_of(config)):
            raise SettingError(
                f"{name} has no effect with this form of the filter: it needs {FORM_PHRASES[use.filter]}"
            )


def optional_settings() -> dict[tuple[str, ...], list[str]]:
    """Return a dict. Key: names of optional channels of the same kind, e.g. of a velocity
    sensor. Value: names of the settings that only matter for these channels.

    The settings are described in src/tables/sensors.toml.
    """
    tables = {VELOCITY_COLUMNS: "velocity", TORQUE_COLUMNS: "pedals", ROAD_COLUMNS: "road"}
    return {channels: list(library().settings_in(table)) for channels, table in tables.items()}


def _check_optional(config: Config, log: CheckedLog | None, asked: Collection[str]) -> None:
    """Raise an error if the filter does not use an optional channel of the log, or if a
    setting has no effect because the log does not have its optional channel.

    `asked`: names of the settings that the user states for this run. Settings in the
    vehicle file are not checked, since the file is used for all logs of the car, with and
    without these channels.
    """
    if log is None:
        return
    if log.optional and config.form != 0:
        raise UserError(
            f"{log.path}: column {', '.join(log.optional)}: only the default filter uses such columns; "
            "leave them out, or select the default filter (form default)"
        )
    for channels, settings in optional_settings().items():
        given = [
            key for key in settings if key in asked and getattr(config, key) != config.fields[key].default
        ]
        if given and not any(c in log.optional for c in channels):
            known = ", ".join(channels)
            raise UserError(
                f"{log.path}: {', '.join(given)} has no effect: the log has none of {known}; "
                "leave out the setting"
            )


def effect_settings() -> tuple[str, ...]:
    """Return the names of the settings of all effects."""
    return library().settings_in("effects")


def unused_notes(config: Config, stated: Mapping[str, float], formula: bool = False) -> list[str]:
    """Return notes on stated settings that the filter does not use.

    Parameters
    ----------
    config : Config
        All settings of the run.
    stated : Mapping
        Settings that the user states: name -> value. There is no note on a setting that
        has its default value.
    formula : bool
        True: the user states a formula (car/formula.py).
    """
    lib = library()
    unused: list[str] = []
    for effect in lib.effects.values():
        if effect.filter not in ("both", filter_of(config)) and any(
            stated.get(p.setting, p.default) != p.default for p in effect.strengths
        ):
            unused.append(f"effects.{effect.id}")
    if formula:
        unused.append("formula")
    changed, others = config.changed(), lib.settings_in("effects", "formula")
    unused += [
        name for name in stated if name in changed and name not in others and not is_used(name, config)
    ]
    notes = []
    if unused:
        notes.append(
            f"{', '.join(unused)}: not used, since it is not in the filter's model "
            "(tselab simulate, calibrate and gap use it)"
        )
    for effect in lib.effects.values():
        on = any(getattr(config, p.setting) != p.default for p in effect.strengths)
        for p in effect.parameters if on and effect.filter in ("both", filter_of(config)) else ():
            if stated.get(p.setting, p.default) != p.default and not is_used(p.setting, config):
                other = lib.settings[p.setting].replaced_by
                notes.append(
                    f"effects.{effect.id}.{p.name} = {stated[p.setting]:g}: not used, since {other} = "
                    f"{getattr(config, other):g} replaces it; set {other} = 0 to use it"
                )
    return notes


def wheels_are_one(log: CheckedLog) -> bool:
    """Return whether the wheel speeds of both axles are the same signal, logged twice.

    This is so if their ratio is constant (SAME_RATIO) in the rows in which the car moves.
    """
    front, rear = (log.data[f"wheel_speed_{axle}"].to_numpy(float) for axle in ("front", "rear"))
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = (front / rear)[np.abs(rear) > ROLLING]
    ratio = ratio[np.isfinite(ratio)]
    return len(ratio) > MANY and float(np.ptp(ratio)) < SAME_RATIO


def set_sampling(config: Config, sample_time: float) -> list[str]:
    """Set sample_time, and raise max_gap to at least GAP_IN_SAMPLES sample times.

    `sample_time`: [s] median step between rows. If the range of the setting does not
    contain it, set the nearest limit and return a note. Otherwise, return [].
    """
    f = config.fields["sample_time"]
    used = min(max(sample_time, f.low), f.high)
    config.sample_time = used
    gap = config.fields["max_gap"]
    config.max_gap = min(max(config.max_gap, GAP_IN_SAMPLES * sample_time), gap.high)
    if abs(used - sample_time) > 1e-6:
        return [f"rows are {sample_time:.3g} s apart; the nearest sample_time that is allowed is {used:g} s"]
    return []


def filter_text(config: Config) -> str:
    """Return a description of the filter in a few words, for messages."""
    if not config.form:
        return "the car's Kalman filter"
    return f"{config.particles} particles, forgetting {config.forgetting:g}, seed {config.seed}"


def c_settings(vehicle: Vehicle) -> str:
    """Return a C99 header with a function that sets the settings of a vehicle file.

    The header compiles with a library for double, float or fixed-point numbers. Settings
    that the file leaves out have the values of an ordinary car with the same mass, lf and
    lr (src/tables/uncalibrated.toml).
    """
    config, _ = make_config(vehicle, None)
    stated = {*vehicle.values, *config.changed()}
    title = re.sub(r"[^\w .,-]", "?", vehicle.name or "a car", flags=re.ASCII)
    lines = [
        f"/* {title}. Written by tselab, not by hand. */",
        "#ifndef TSE_CAR_H",
        "#define TSE_CAR_H",
        "#ifndef TSE_VERSION /* the header of the library is not included yet */",
        "#if defined __has_include",
        '#if !__has_include("tse/tse.h")',
        "#define TSE_IS_FLAT /* tse.h is in the include path itself, not in its folder tse */",
        "#endif",
        "#endif",
        "#ifdef TSE_IS_FLAT",
        '#include "tse.h"',
        "#else",
        '#include "tse/tse.h"',
        "#endif",
        "#endif",
        "",
        "static inline void tse_config_car(tse_config *c) /* after tse_config_default() */",
        "{",
    ]
    for name, value in config.as_dict().items():
        if name not in stated:
            continue
        number = repr(value) if isinstance(value, int) else f"TSE_S({value!r})"
        lines.append(f"  c->{name} = {number}; /* [{config.fields[name].unit}] */")
    return "\n".join([*lines, "}", "#endif"]) + "\n"
