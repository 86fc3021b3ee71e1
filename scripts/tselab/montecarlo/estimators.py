"""What can be run on a drive, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from tselab.core import STIFFNESS, Config, Filter
from tselab.errors import UserError
from tselab.montecarlo.case import Drive
from tselab.study import START

if TYPE_CHECKING:
    from tselab.peers import Told

# Every departure from the paper's filter that can be switched off: name, what it does, the settings that switch it off.
DEPARTURES: list[tuple[str, str, dict[str, float]]] = [
    ("hold", "what nothing excites is held, not learnt", {"hold_sd": 0.0}),
    ("spread limit", "spread above a limit is sensor noise, not tyre", {"spread_max": 2.0}),
    ("marginalisation", "states and mean stiffness are Gaussian in each particle", {"marginalised": 0}),
]
WITHOUT = "tse without "
PEERS = ("ekf", "ukf")
BOUNDS = {"bound": "forgetting_bound", "crb": "cramer_rao"}  # no estimators: only what sd one could have
FORMS = ("paper", "marginalised")
TEXTS = {
    "ekf": "EKF on the augmented state, told the true covariances",
    "ukf": "UKF on the augmented state, told the true covariances",
    "bound": "best linear estimator with the same forgetting",
    "crb": "Cramer-Rao bound without forgetting",
    "paper": "tse in the paper's form",
    "marginalised": "tse in the marginalised form",
}


def overrides(name: str) -> dict[str, float]:
    """The settings in which an estimator differs from `tse`, beside its form. 'tse-100' has 100 particles."""
    if name in (*PEERS, *BOUNDS, *FORMS):
        return {}
    if name.startswith(WITHOUT):
        for departure, _, settings in DEPARTURES:
            if name == WITHOUT + departure:
                return settings
    family, _, particles = name.partition("-")
    if family == "tse" and (not particles or particles.isdigit()):
        return {"particles": int(particles)} if particles else {}
    raise UserError(f"there is no estimator '{name}'")


def configure(name: str, form: str, settings: Mapping[str, float], about: Mapping[str, float]) -> Config:
    """Settings of an estimator: start and form, then the user's, then what the case is about, then its own."""
    forms = Config.form(name if name in FORMS else form)
    return Config({**START, **forms, **settings, **about, **overrides(name)})


def run(name: str, d: Drive, config: Config) -> np.ndarray:
    """Estimate a drive: an array with the fields cx_front, cx_front_sd, ... of every row."""
    if name in PEERS:
        from tselab import peers

        return peers.run(name, d.rows, config, _told(d, config))
    if name in BOUNDS:
        from tselab import bounds

        sd = getattr(bounds, BOUNDS[name])(d.rows, d.truth_table, config, _told(d, config))
        out = np.zeros(len(sd), [(f"{s}_sd", float) for s in STIFFNESS])
        for i, s in enumerate(STIFFNESS):
            out[f"{s}_sd"] = sd[:, i] * d.stiffness[:, i]
        return out
    filter_ = Filter(config)
    out = filter_.outputs(len(d.rows))
    filter_.step_into(d.rows, out)
    return out


def _told(d: Drive, config: Config) -> Told:
    """The true covariances, as they are at the start."""
    from tselab.peers import Told

    sensors = (config.accel_x_sd, config.accel_y_sd, config.yaw_rate_sd)
    return Told(
        spread=tuple(getattr(d.sim, f"spread_{s}") * getattr(d.sim, f"true_{s}") for s in STIFFNESS),
        noise_sd=tuple(sd * d.sim.noise for sd in sensors),
        forgetting=config.forgetting,
    )
