"""The settings of a run: defaults, then the vehicle file, then the log's sampling, then --config, then options."""

import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tse.car.vehicle import FRICTION, Vehicle, make_filter_values
from tse.library.core import CONFIG, Config, SettingError, library
from tse.library.errors import UserError
from tse.library.files import read_toml
from tse.log.rows import ROAD_COLUMNS, TORQUE_COLUMNS, VELOCITY_COLUMNS, CheckedLog

GAP_IN_SAMPLES = 5  # max_gap is at least this many sample times
SAME_GRIP = 0.01  # relative: a friction that is stated and the filter's grip
ROLLING, MANY, SAME_RATIO = 5.0, 500, 1e-3  # rad/s; rows; of the ratio of both axles' wheel speeds
# Effects that the car's filter does not apply (src/EQUATIONS.md, "In the default filter"); nor the formula of the user.
NOT_IN_FILTER = ("longitudinal_relaxation", "combined_slip", "stiffness_drift", "crosswind")
FOUND = (
    "longitudinal_relaxation",
    "combined_slip",
)  # of these what a calibration finds (identify/unknowns.py)
OF_FORM = re.compile(r"form ([01])$")  # how the text of a setting of one filter ends
ONE_SPEED = (
    "both wheel speeds are one signal: taken as the vehicle's speed, which does not show slip; longitudinal stiffness is not "
    "estimated"
)


def read_filter_file(path: Path) -> dict[str, float]:
    """A FILTER.toml: any setting, flat or under [filter]."""
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
    """The settings of a run, and notes on what the log made of them."""
    values = make_filter_values(vehicle) if form == "default" else vehicle.values
    config = Config({**Config.settings_of(form), **values})
    notes: list[str] = []
    if log is not None and log.sample_time is not None:
        notes += set_sampling(config, log.sample_time)
    if log is not None and wheels_are_one(log):
        config.wheel_signals = 1
        notes.append(ONE_SPEED)
    if form == "default" and (unused := not_in_filter(config, vehicle)):
        notes.append(
            f"{', '.join(unused)}: not in the filter's model, not used (tselab simulate, calibrate and gap use it)"
        )
    if form != "default":
        notes.append(
            f"form {form} is the paper's filter, a reference for its model: on an ordinary car values and intervals are wrong"
        )
    if filter_file is not None:
        for key, value in read_filter_file(filter_file).items():
            config.set(key, value)
    for key, value in (options or {}).items():
        if value is not None:
            config.set(key, value, source=f"option --{key.replace('_', '-')}")
    asked = {key for key, x in config.as_dict().items() if x != values.get(key)}
    _check_optional(config, log, asked)
    return config.complete(), notes


def unused_friction(vehicle: Vehicle, config: Config) -> list[str]:
    """Return a note where a friction that the vehicle file states is another than the filter's grip.

    Of a car that nobody has calibrated the filter starts from the grip of an ordinary car."""
    inverse = vehicle.values.get(FRICTION, 0.0)
    exact = config.grip == 0  # then the library takes the friction
    if (
        config.form != 0
        or exact
        or vehicle.calibration
        or inverse <= 0
        or abs(config.grip * inverse - 1) < SAME_GRIP
    ):
        return []
    return [
        f"{vehicle.path.name}: effects.tyre_saturation.inverse_friction is {inverse:.3g} and not used by the filter: its grip "
        f"starts at {config.grip:.3g}; --set grip={1 / inverse:.3g} states it (tselab simulate and gap use it as it is)"
    ]


def check_effect(names: Collection[str], config: Config) -> None:
    """SettingError: one of them is not its default, and the other filter's: it would do nothing."""
    for name in config.changed().keys() & set(names):
        of = OF_FORM.search(config.fields[name].text)
        if of and int(of[1]) != int(config.form):
            forms = ("default", "robust or paper")
            raise SettingError(
                f"{name} has no effect with this form: it is a setting of form {forms[int(of[1])]}"
            )


def optional_settings() -> dict[tuple[str, ...], list[str]]:
    """Return the settings about optional channels, rows of src/tables/sensors.toml, by the channels."""
    names = [f.name for f in library().fields(CONFIG)]
    first, last = names.index("ins_velocity_sd"), names.index("velocity_scale_sd")
    return {
        VELOCITY_COLUMNS: names[first : last + 1],
        TORQUE_COLUMNS: ["wheel_torque_least"],
        ROAD_COLUMNS: ["road_sd"],
    }


def _check_optional(config: Config, log: CheckedLog | None, asked: Collection[str]) -> None:
    """Raise UserError where an optional channel, or a setting about one, would be without
    effect. `asked`: what this run asks for. A vehicle file is of all logs of its car, with an
    INS or without."""
    if log is None:
        return
    if log.optional and config.form != 0:
        raise UserError(
            f"{log.path}: column {', '.join(log.optional)}: only the default filter uses it; leave the column out, or the form"
        )
    for channels, settings in optional_settings().items():
        given = [
            key for key in settings if key in asked and getattr(config, key) != config.fields[key].default
        ]
        if given and not any(c in log.optional for c in channels):
            known = ", ".join(channels)
            raise UserError(
                f"{log.path}: {', '.join(given)} without effect: the log has none of {known}; leave it out"
            )


def not_in_filter(config: Config, vehicle: Vehicle) -> list[str]:
    """Return what the vehicle file says of the car and the filter does not apply."""
    effects = library().effects
    found = (
        FOUND if vehicle.calibration else ()
    )  # that the filter has not what a calibration found is no news of this run
    on = [
        i
        for i in NOT_IN_FILTER
        if i not in found and any(getattr(config, p.setting) != 0 for p in effects[i].strengths)
    ]
    return [*(f"effects.{i}" for i in on), *(["formula"] if vehicle.formula is not None else [])]


def wheels_are_one(log: CheckedLog) -> bool:
    """Return whether the wheel speeds of both axles have the same ratio in all rows that move: one signal, logged twice."""
    front, rear = (log.data[f"wheel_speed_{axle}"].to_numpy(float) for axle in ("front", "rear"))
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = (front / rear)[np.abs(rear) > ROLLING]
    ratio = ratio[np.isfinite(ratio)]
    return len(ratio) > MANY and float(np.ptp(ratio)) < SAME_RATIO


def set_sampling(config: Config, sample_time: float) -> list[str]:
    """Settings for rows that are usually `sample_time` s apart; notes on what that means."""
    f = config.fields["sample_time"]
    used = min(max(sample_time, f.low), f.high)
    config.sample_time = used
    gap = config.fields["max_gap"]
    config.max_gap = min(max(config.max_gap, GAP_IN_SAMPLES * sample_time), gap.high)
    if abs(used - sample_time) > 1e-6:
        return [f"rows are {sample_time:.3g} s apart; the nearest sample_time the filter knows is {used:g} s"]
    return []


def filter_text(config: Config) -> str:
    """The form of the filter and its size, in a few words."""
    if not config.form:
        return "the car's Kalman filter"
    return f"{config.particles} particles, forgetting {config.forgetting:g}, seed {config.seed}"


def c_settings(vehicle: Vehicle) -> str:
    """Return the settings of a vehicle file, and of its class what it leaves out, as a function in C99 for any number format."""
    config, _ = make_config(vehicle, None)
    stated = {*vehicle.values, *config.changed()}
    title = re.sub(r"[^\w .,-]", "?", vehicle.name or "a car", flags=re.ASCII)
    lines = [
        f"/* {title}. Written by tselab, not by hand. */",
        "#ifndef TSE_CAR_H",
        "#define TSE_CAR_H",
        "#ifndef TSE_VERSION /* the header of the library was not included before, in whatever layout it is */",
        "#if defined __has_include",
        '#if !__has_include("tse/tse.h")',
        "#define TSE_IS_FLAT /* tse.h and tse.c in a folder of include files themselves */",
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
