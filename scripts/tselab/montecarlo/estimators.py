"""What can be run on a drive, by name."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from tse.library.core import NOMINAL, STIFFNESS, Config, NativeFilter, library
from tse.library.errors import UserError
from tselab.montecarlo import peers
from tselab.montecarlo.case import START, CaseDrive
from tselab.montecarlo.peers import Known

# Variants of the robust form, robust-NAME: what was tried.
VARIANTS: dict[str, tuple[str, dict[str, float]]] = {
    "one-factor": (
        "one forgetting factor in (17), 0.99",
        {"forgetting": 0.99, "forgetting_mean": 0.0, "forgetting_change": 1.0},
    ),
    "constant": ("the mean's factor does not fall where innovations last", {"forgetting_change": 1.0}),
    "slower": ("the mean's factor 0.985, not 0.98", {"forgetting_mean": 0.985}),
    "slowest": ("the mean's factor 0.99, falling", {"forgetting_mean": 0.99}),
    "euler": ("Euler, inputs held", {"integration": 0}),
    "free": ("draws are not reflected", {"reflect_draws": 0}),
    "no-kernel": ("resampling is not regularised", {"spread_kernel": 0.0}),
    "wide-kernel": ("kernel 0.06, not 0.03", {"spread_kernel": 0.06}),
    "covariance": ("the covariance forgets by 0.99, not 0.998", {"forgetting": 0.99}),
    "tight-limit": ("the spread is 0.3 at most, not 0.7", {"spread_max": 0.3}),
    "no-limit": ("the spread has no limit", {"spread_max": 2.0}),
    "small-start": ("starts with a spread of 5 %, not 15 %", {"initial_spread": 0.05}),
}
PEERS = ("ekf", "known")
FORMS = {"robust": "robust", "paper": "paper", "printed": "paper"}  # and the form that each is of
PRINTED = {
    "initial_vel_x": 22.0,
    "initial_vel_x_from_wheels": 0,
    "integration": 0,
}  # where Sec. IV-A starts; Euler
TEXTS = {
    "ekf": "EKF on the augmented state, true covariances",
    "known": "EKF that never forgets, with the true covariances and the times of changes",
    "tse": "tse as it comes",
    "robust": "the paper's filter with settings that keep it from diverging",
    "paper": "the paper's filter as printed",
    "printed": "the paper's filter as printed, started as in Sec. IV-A",
}


def get_overrides(name: str) -> dict[str, float]:
    """The settings in which an estimator differs from `tse`, beside its form.
    'robust-100' has 100 particles."""
    if is_yours(name):
        _load_yours(name)
        return {}
    if name == "printed":
        return PRINTED
    if name in (*PEERS, *FORMS):
        return {}
    family, _, particles = name.partition("-")
    if family == "robust" and particles in VARIANTS:
        return VARIANTS[particles][1]
    if name == "tse":
        return {}
    if family in FORMS and particles.isdigit():
        return {"particles": int(particles)}
    raise UserError(f"there is no estimator '{name}'")


def configure_estimator(
    name: str, form: str, settings: Mapping[str, float], about: Mapping[str, float]
) -> Config:
    """Settings of an estimator: start and form, then the user's, then what the case is
    about, then its own."""
    family = name.partition("-")[0]
    forms = Config.settings_of(FORMS.get(family, form))
    return Config.exact({**START, **forms, **settings, **about, **get_overrides(name)})


def is_yours(name: str) -> bool:
    """A function of the user by its name in Python, 'module.function'."""
    return all(part.isidentifier() for part in name.split(".")) and "." in name


def _load_yours(name: str) -> Callable[[pd.DataFrame, Mapping[str, float]], Any]:
    module, _, function = name.rpartition(".")
    try:
        found = getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise UserError(
            f"there is no estimator '{name}': {error}; is the folder of {module}.py in PYTHONPATH?"
        ) from None
    if not callable(found):
        raise UserError(f"the estimator '{name}' is not a function")
    return found


def _run_yours(name: str, d: CaseDrive, config: Config) -> np.ndarray:
    """Given the log and the settings of car and sensors that tse has; returned: stiffness
    in N and N/rad, as columns of EST.csv."""
    log = pd.DataFrame({"time": d.time, **{f.name: d.rows[f.name].astype(float) for f in library().channels}})
    answer = _load_yours(name)(log, config.as_dict())
    fields = [f"{s}{end}" for s in STIFFNESS for end in ("", "_sd", "_spread") if f"{s}{end}" in answer]
    if missing := [s for s in (f"{s}{end}" for s in STIFFNESS for end in ("", "_sd")) if s not in fields]:
        raise UserError(f"the estimator '{name}' does not give {', '.join(missing)}")
    out = np.zeros(len(d.rows), [(f, float) for f in fields])
    for f in fields:
        values = np.asarray(answer[f], float)
        if values.shape != out.shape:
            raise UserError(
                f"the estimator '{name}' gives {f} in shape {values.shape}, not {out.shape}: a number a row"
            )
        out[f] = values / getattr(config, next(NOMINAL[s] for s in STIFFNESS if f.startswith(s)))
    return out


def run_estimator(name: str, d: CaseDrive, config: Config) -> np.ndarray:
    """Estimate a drive; return cx_front, cx_front_sd, ... of every row."""
    if is_yours(name):
        return _run_yours(name, d, config)
    if name in PEERS:
        return peers.run_peer(name, d.rows, config, _make_known(d, config, name == "known"))
    return NativeFilter(config).estimate_rows(d.rows)


def _make_known(d: CaseDrive, config: Config, changes: bool = False) -> Known:
    """The true covariances, as they are at the start; with `changes` for a filter that
    knows of the changes of level."""

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
