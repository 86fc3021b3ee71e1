"""The estimators that run on a simulated drive: tse, the paper's filter and its variants,
Kalman filters for comparison, and functions of the user."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from tse.library.core import NOMINAL, STIFFNESS, Config, NativeFilter, library
from tse.library.errors import UserError
from tselab.montecarlo import peers
from tselab.montecarlo.case import INITIAL_SETTINGS, CaseDrive
from tselab.montecarlo.peers import Known

# Variants of the robust filter (--form robust: the paper's filter with settings that keep
# it from diverging) that were tried and not chosen. The study "robust" compares them with
# the robust filter. The estimator of a variant is called robust-NAME. Key: NAME. Value:
# description, and the settings in which the variant differs from the robust filter.
VARIANTS: dict[str, tuple[str, dict[str, float]]] = {
    "one-factor": (
        "a single forgetting factor of 0.99, as in equation (17)",
        {"forgetting": 0.99, "forgetting_mean": 0.0, "forgetting_change": 1.0},
    ),
    "constant": (
        "forgetting factor of the mean does not decrease if innovations persist",
        {"forgetting_change": 1.0},
    ),
    "slower": ("forgetting factor of the mean 0.985 instead of 0.98", {"forgetting_mean": 0.985}),
    "slowest": ("forgetting factor of the mean 0.99 instead of 0.98", {"forgetting_mean": 0.99}),
    "euler": ("Euler integration, inputs held between rows", {"integration": 0}),
    "free": ("drawn stiffnesses are not reflected at the limits", {"reflect_draws": 0}),
    "no-kernel": ("resampling is not regularised", {"spread_kernel": 0.0}),
    "wide-kernel": ("kernel of the resampling 0.06 instead of 0.03", {"spread_kernel": 0.06}),
    "covariance": ("forgetting factor of the covariance 0.99 instead of 0.998", {"forgetting": 0.99}),
    "tight-limit": ("max spread 0.3 instead of 0.7", {"spread_max": 0.3}),
    "no-limit": ("no limit of the spread", {"spread_max": 2.0}),
    "small-start": ("initial spread 5 % instead of 15 %", {"initial_spread": 0.05}),
}
PEERS = ("ekf", "known")  # the extended Kalman filters of peers.py
# Form of each estimator that does not use the option --form. A form ("default", "robust"
# or "paper") is a set of settings that selects a filter of the C library
FORM_OF_ESTIMATOR = {"robust": "robust", "paper": "paper", "printed": "paper"}
# Settings in which the estimator "printed" differs from "paper": initial speed 22 m/s
# (Sec. IV-A of the paper) instead of the wheel speed, and Euler integration (0)
PRINTED = {"initial_vel_x": 22.0, "initial_vel_x_from_wheels": 0, "integration": 0}
TEXTS = {
    "ekf": "EKF on the augmented state, true covariances",
    "known": "EKF without forgetting, which has the true covariances and the times of the changes",
    "tse": "tse with default settings",
    "robust": "the paper's filter with settings that keep it from diverging",
    "paper": "the paper's filter as printed",
    "printed": "the paper's filter as printed, started as in Sec. IV-A",
}


def get_overrides(name: str) -> dict[str, float]:
    """Return the settings that the name of an estimator gives in addition to those of its
    form (FORM_OF_ESTIMATOR). For example, 'robust-100' is the robust filter with 100
    particles. Raise UserError if the name is unknown."""
    if is_yours(name):
        _load_yours(name)
        return {}
    if name == "printed":
        return PRINTED
    if name in (*PEERS, *FORM_OF_ESTIMATOR):
        return {}
    family, _, particles = name.partition("-")
    if family == "robust" and particles in VARIANTS:
        return VARIANTS[particles][1]
    if name == "tse":
        return {}
    if family in FORM_OF_ESTIMATOR and particles.isdigit():
        return {"particles": int(particles)}
    raise UserError(f"there is no estimator '{name}'")


def configure_estimator(
    name: str, form: str, settings: Mapping[str, float], about: Mapping[str, float]
) -> Config:
    """Return the settings of an estimator, merged in this order (a later value
    overrides an earlier one):
    1. INITIAL_SETTINGS, which all cases of all studies have,
    2. settings of a form: that of the estimator in FORM_OF_ESTIMATOR or, if the estimator
       is not listed there, `form`,
    3. settings of the user, `settings`,
    4. settings of the case, `about`,
    5. settings that the name of the estimator gives (get_overrides())."""
    family = name.partition("-")[0]
    forms = Config.settings_of(FORM_OF_ESTIMATOR.get(family, form))
    return Config.exact({**INITIAL_SETTINGS, **forms, **settings, **about, **get_overrides(name)})


def is_yours(name: str) -> bool:
    """Return whether a name has the form 'module.function' of a function of the user."""
    return all(part.isidentifier() for part in name.split(".")) and "." in name


def _load_yours(name: str) -> Callable[[pd.DataFrame, Mapping[str, float]], Any]:
    """Import a function of the user. Raise UserError if there is no such function."""
    module, _, function = name.rpartition(".")
    try:
        found = getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise UserError(
            f"there is no estimator '{name}': {error}; check that the folder of {module}.py is in PYTHONPATH"
        ) from None
    if not callable(found):
        raise UserError(f"the estimator '{name}' is not a function")
    return found


def _run_yours(name: str, d: CaseDrive, config: Config) -> np.ndarray:
    """Run a function of the user on a drive.

    The function of the user gets the log and all settings of tse. It returns stiffnesses
    and sds [N, N/rad], named as the columns of EST.csv. _run_yours() returns these values
    divided by the nominal stiffness."""
    log = pd.DataFrame({"time": d.time, **{f.name: d.rows[f.name].astype(float) for f in library().channels}})
    answer = _load_yours(name)(log, config.as_dict())
    fields = [f"{s}{end}" for s in STIFFNESS for end in ("", "_sd", "_spread") if f"{s}{end}" in answer]
    if missing := [s for s in (f"{s}{end}" for s in STIFFNESS for end in ("", "_sd")) if s not in fields]:
        raise UserError(f"the function '{name}' must return these columns, too: {', '.join(missing)}")
    out = np.zeros(len(d.rows), [(f, float) for f in fields])
    for f in fields:
        values = np.asarray(answer[f], float)
        if values.shape != out.shape:
            raise UserError(
                f"the estimator '{name}' returns {f} with shape {values.shape}; needed is {out.shape}, a "
                "number for each row"
            )
        out[f] = values / getattr(config, next(NOMINAL[s] for s in STIFFNESS if f.startswith(s)))
    return out


def run_estimator(name: str, d: CaseDrive, config: Config) -> np.ndarray:
    """Run an estimator on a drive. Return its outputs in every row. Each stiffness and
    its sd (such as cx_front and cx_front_sd) are relative to nominal."""
    if is_yours(name):
        return _run_yours(name, d, config)
    if name in PEERS:
        return peers.run_peer(name, d.rows, config, _make_known(d, config, name == "known"))
    return NativeFilter(config).estimate_rows(d.rows)


def _make_known(d: CaseDrive, config: Config, changes: bool = False) -> Known:
    """Return the arguments of an extended Kalman filter of peers.py: the true noise sds,
    spread and change times of the drive, and the forgetting factor.

    The spread is the sd of a stiffness from sample to sample. The simulated spread is
    proportional to the mean stiffness. The filter "known" (`changes` True) gets the ratio
    spread / mean, and multiplies it by its estimate of the mean. The filter "ekf"
    (`changes` False) gets the true spread at the start of the drive, relative to nominal,
    and keeps it."""
    sensors = (config.accel_x_sd, config.accel_y_sd, config.yaw_rate_sd)
    return Known(
        spread=tuple(
            getattr(d.sim, f"spread_{s}") * (1 if changes else getattr(d.sim, f"true_{s}")) for s in STIFFNESS
        ),
        noise_sd=tuple(sd * d.sim.noise for sd in sensors),
        forgetting=config.forgetting,
        held=bool(d.sim.hold_inputs),
        changes=d.events,
    )
