"""What can be run on a drive, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from tselab.core import STIFFNESS, Config, Filter
from tselab.errors import UserError
from tselab.montecarlo import landed
from tselab.montecarlo.case import Drive
from tselab.study import START

if TYPE_CHECKING:
    from tselab.peers import Told

# What the default adds to the paper's filter and can be switched off alone: name, what it does, the settings that switch it off.
DEPARTURES: list[tuple[str, str, dict[str, float]]] = [
    ("noise found", "noise above the settings' is found and used", {"noise_max": 1.0}),
    ("slide", "wheels that lock or spin are coasted through", {"max_slip": 1.0}),
]
WITHOUT = "tse without "
PEERS = ("ekf", "ukf", "told")
BOUNDS = {"bound": "forgetting_bound", "crb": "cramer_rao"}  # no estimators: only what sd one could have
FORMS = ("sampled", "paper")
LANDED = "landed"
TEXTS = {
    LANDED: "the default of an earlier commit (tselab/montecarlo/landed.py)",
    "ekf": "EKF on the augmented state, told the true covariances",
    "ukf": "UKF on the augmented state, told the true covariances",
    "told": "EKF that never forgets, told the true covariances and when the road changes",
    "bound": "best linear estimator with the same forgetting",
    "crb": "Cramer-Rao bound without forgetting",
    "tse": "tse as it comes",
    "sampled": "states and means sampled, with limits",
    "paper": "states and means sampled, no limits: the paper's form",
}


def overrides(name: str) -> dict[str, float]:
    """The settings in which an estimator differs from `tse`, beside its form. 'sampled-100' has 100 particles."""
    if name in (*PEERS, *BOUNDS, *FORMS, LANDED):
        return {}
    if name.startswith(WITHOUT):
        for departure, _, settings in DEPARTURES:
            if name == WITHOUT + departure:
                return settings
    family, _, particles = name.partition("-")
    if name == "tse":
        return {}
    if family in FORMS and particles.isdigit():
        return {"particles": int(particles)}
    raise UserError(f"there is no estimator '{name}'")


def configure(name: str, form: str, settings: Mapping[str, float], about: Mapping[str, float]) -> Config:
    """Settings of an estimator: start and form, then the user's, then what the case is about, then its own."""
    if name == LANDED:
        return landed.configure({**START, **settings, **about})
    family = name.partition("-")[0]
    forms = Config.form(family if family in FORMS else form)
    return Config({**START, **forms, **settings, **about, **overrides(name)})


def run(name: str, d: Drive, config: Config) -> np.ndarray:
    """Estimate a drive: an array with the fields cx_front, cx_front_sd, ... of every row."""
    if name in PEERS:
        from tselab import peers

        return peers.run(name, d.rows, config, _told(d, config, name == "told"))
    if name in BOUNDS:
        from tselab import bounds

        sd = getattr(bounds, BOUNDS[name])(d.rows, d.truth_table, config, _told(d, config))
        out = np.zeros(len(sd), [(f"{s}_sd", float) for s in STIFFNESS])
        for i, s in enumerate(STIFFNESS):
            out[f"{s}_sd"] = sd[:, i] * d.stiffness[:, i]
        return out
    filter_ = Filter(config)
    rows, out = filter_.inputs(len(d.rows)), filter_.outputs(len(d.rows))
    for field in rows.dtype.names:
        rows[field] = d.rows[field]
    filter_.step_into(rows, out)
    return out


def _told(d: Drive, config: Config, changes: bool = False) -> Told:
    """The true covariances, as they are at the start; with `changes` for a filter that knows of the changes of level."""
    from tselab.peers import Told

    sensors = (config.accel_x_sd, config.accel_y_sd, config.yaw_rate_sd)
    return Told(
        spread=tuple(getattr(d.sim, f"spread_{s}") * (1 if changes else getattr(d.sim, f"true_{s}")) for s in STIFFNESS),
        noise_sd=tuple(sd * d.sim.noise for sd in sensors),
        forgetting=config.forgetting,
        held=bool(d.sim.hold_inputs),
        changes=d.events,
    )
