"""Compute how accurately the parameters of the improved car are known: the joint
covariance of stiffness and effects. It includes effects that the search has named, and
effects that it has not named but that have a prior sd. The latter keep the values of the
vehicle file, but their uncertainty widens the intervals of the other parameters.

The covariance is computed at the fitted values, in the same way as in a calibration
(identify/fit.py). The prior sd of an effect that is not named comes from the table
[uncertainty] of the vehicle file. If it is not stated there, it is that of an
uncalibrated car.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tse.car.vehicle import Vehicle, get_unknown_car, list_uncertainty_settings
from tse.gaps.catalogue import Key, load_catalogue
from tse.gaps.fit import NOISE_LIMIT, Fit, compute_gap
from tse.gaps.infer.hypotheses import UNCERTAIN, Hypothesis, make_hypotheses
from tse.gaps.infer.space import Space
from tse.gaps.problem import Problem
from tse.identify import fit as engine
from tse.identify.slip import LONGITUDINAL_KEY, estimate_longitudinal
from tse.identify.unknowns import MIN_SD, SCALE_PARTNERS, UNKNOWNS
from tse.identify.vehicle_file import estimate_model_sd
from tse.library.core import NOMINAL
from tse.log.rows import CheckedLog

# Setting with the sd of a common factor of mass, yaw inertia and all stiffnesses. A
# common factor has no influence on the motion, so logs cannot reduce this sd.
SCALE = "mass_sd"


@dataclass(frozen=True)
class Posterior:
    """Posterior mean and covariance of the car's parameters."""

    names: tuple[Key, ...]
    values: np.ndarray
    covariance: np.ndarray
    model_sd: float  # sd of the model discrepancy of a channel / rms of the channel

    @property
    def stiffness(self) -> dict[str, float]:
        """Ratio of each stiffness to its value in the vehicle file."""
        return {str(n): float(x) for n, x in zip(self.names, self.values, strict=True) if n in NOMINAL}

    def compute_sd(self, name: str) -> float:
        """Return the sd of a parameter.

        A parameter in SCALE_PARTNERS (the scale error of accel_y) has a partner (body
        roll) that changes accel_y in the same way. Logs cannot distinguish the two. Only
        their weighted sum can be estimated, so the sd of this sum is returned for such a
        parameter.
        """
        weights = dict([(name, 1.0), *([SCALE_PARTNERS[name]] if name in SCALE_PARTNERS else [])])
        w = np.array([weights.get(n, 0.0) for n in self.names])
        return float(np.sqrt(w @ self.covariance @ w))

    def make_uncertainty(self, vehicle: Vehicle) -> dict[str, float]:
        """Return the settings of [uncertainty] for the improved vehicle file.

        Each sd is that of the posterior, but at least MIN_SD or the sd in the user's
        vehicle file, whichever is smaller. MIN_SD is the best accuracy that a model of a
        car can have. model_sd is that of the posterior. Other settings, such as mass_sd,
        keep their values. If all sds in the user's file are 0, the car is known exactly:
        all settings keep their values.
        """
        v = {key: vehicle.values[key] for key in list_uncertainty_settings() if key in vehicle.values}
        if not any(v.values()):
            return v
        v["model_sd"] = self.model_sd
        return v | {
            key: max(self.compute_sd(name), min(MIN_SD.get(key, 0.0), v[key]))
            for key, name in UNCERTAIN.items()
            if key != SCALE
        }

    def make_calibration(self) -> dict[str, Any]:
        """Return names, mean and covariance of the parameters for
        format_calibration_table(), which writes them to the improved vehicle file.

        A stiffness is represented by ln(stiffness / its value in the improved vehicle
        file). The mean of this ln is 0, because the file has the posterior mean.
        """
        known = {u.name for u in UNKNOWNS if not u.relative}
        mine = [k for k, n in enumerate(self.names) if n in NOMINAL or n in known]
        ln = np.array([self.names[k] in NOMINAL for k in mine])
        mean, scale = np.where(ln, 0.0, self.values[mine]), np.where(ln, self.values[mine], 1.0)
        covariance = self.covariance[np.ix_(mine, mine)] / np.outer(scale, scale)
        return {"names": [str(self.names[k]) for k in mine], "mean": mean, "covariance": covariance}


def compute_posterior(
    problem: Problem,
    fit: Fit,
    vehicle: Vehicle,
    settings: Mapping[str, float],
    logs: Sequence[CheckedLog] = (),
    spread: np.ndarray | None = None,
) -> Posterior:
    """Return the posterior of the car: values, covariance and model discrepancy.

    Parameters
    ----------
    problem, fit
        The fitted logs and their fit with the named effects.
    vehicle
        The car of the user's vehicle file.
    settings
        Settings of the formula that is part of the fit; empty without a formula.
    logs
        The fitted logs as they were read.
    spread
        Several sets of effects may explain the logs, and each set gives different
        stiffnesses. `spread` is the covariance of ln stiffness over these sets
        (Naming.spread). It is added to the covariance of the fit. None: 0.

    Notes
    -----
    model_sd is computed without the formula, because the default filter does not apply
    formulas. For the filter, the part of the residuals that a formula explains is a model
    error.

    The longitudinal stiffness comes from a regression on the slip of the wheels
    (estimate_longitudinal()) if the rms of the accel_x residuals exceeds NOISE_LIMIT
    times the sensor noise, or if accel_x is not measured. The reason: measured wheel
    speeds are inputs of the simulation, so their noise enters the simulated accel_x.
    Soft tyres smooth this noise. So the fit would make the stiffness too small, by 13 to
    45 % for three simulated multi-body cars. If the logs do not permit the regression,
    the stiffness keeps its prior.
    """
    prior = {name: vehicle.values.get(key, 0.0) for key, name in UNCERTAIN.items() if key != SCALE}
    fitted = {p.name for p in fit.parameters}
    asked = [*make_hypotheses(), Hypothesis(load_catalogue()["aligning_moment"], 0.0)]
    effects = [h for h in asked if any(p.name in fitted or prior.get(p.name) for p in h.effect.strengths)]
    bare = problem.holding(fit.values)
    problem = bare.holding(settings)

    def evaluate_fit(problem: Problem) -> tuple[Space, np.ndarray, engine.CarFit]:
        space = Space(problem, effects, [h.id for h in effects])
        start = problem.nominal | problem.fixed
        at = np.array([start.get(n, 1.0 if n in NOMINAL else 0.0) for n in space.names])
        space.sd = np.array(
            [sd if n in fitted else prior.get(n) or sd for n, sd in zip(space.names, space.sd, strict=True)]
        )
        space.mean, space.information = space.to_search(at), np.diag(space.sd**-2)
        return space, at, engine.fit(space, space.mean, max_steps=0, near=True)

    space, at, found = evaluate_fit(problem)
    car = [
        k
        for k, p in enumerate(space.parameters)
        if p.name in NOMINAL or p.name in fitted or prior.get(p.name)
    ]
    there, _, alone = evaluate_fit(bare) if settings else (space, at, found)
    before = vehicle.values.get("model_sd", get_unknown_car()["model_sd"])
    left = estimate_model_sd(there, alone.residuals, before)
    values, covariance = at[car], found.covariance[np.ix_(car, car)]
    if compute_gap(problem, fit.residuals).get("accel_x", np.inf) > NOISE_LIMIT:
        k = [space.names[k] for k in car].index(LONGITUDINAL_KEY)
        mean, sd = estimate_longitudinal(problem.config, problem.fixed, logs, vehicle)
        values[k] = np.exp(mean)
        covariance[k, :] = covariance[:, k] = 0.0
        covariance[k, k] = (sd * values[k]) ** 2
    stiff = [car.index(k) for k, n in enumerate(space.names) if n in NOMINAL]
    common = vehicle.values.get(SCALE, 0.0) ** 2 + (0.0 if spread is None else spread)
    covariance[np.ix_(stiff, stiff)] += common * np.outer(values[stiff], values[stiff])
    return Posterior(tuple(space.names[k] for k in car), values, covariance, left)
