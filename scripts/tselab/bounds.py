"""What a linear estimator of the mean stiffness can reach: with forgetting, and the Cramer-Rao bound without.

Both are of the model of peers.py, linearised at the true states and the true mean stiffness:

    z+ = F z + (0, 0, walk, fresh eps),     y = H z + e,     z = (x, mu, b, eps)

In this linear-Gaussian model covariances depend on the trajectory but not on the data, so a bound is a run over the rows
that uses their inputs and which measurements are there. Numbers in brackets: src/EQUATIONS.md.

Assumptions: the true mean stiffness is constant, and start, biases, spread and noise are drawn as the settings and `known`
say. Where a simulation has no bias or starts exactly at the wheels' speed, errors come out a little below the bound.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from tselab.core import NOMINAL, STIFFNESS, Config
from tselab.peers import MU, Known, Model, Noise, update


def forgetting_bound(rows: np.ndarray, truth: pd.DataFrame, config: Config, known: Known) -> np.ndarray:
    """sd of the error of the Kalman filter that forgets mu with lambda, relative to the true mean: (rows, 3).

    Two recursions, rows k in time order:

    P, what the filter believes. The Kalman filter of the model, with mu's variance divided by lambda after every sample
    that taught something (17), up to the variance of the start (peers.Noise.forget). Only its gain K is of interest.

        S = H P H' + R,    K = P H' S^-1,    P <- (I - K H) P,    P <- L P L,    P <- F P F' + Q
        L = diag(1, lambda^-1/2, 1, 1)

    E, what that filter does. The estimate moves by z^ <- z^ + K (y - H z^) and z^ <- F z^; L moves no estimate. With
    y = H z + e and z <- F z + q the error z - z^ is (I - K H)(z - z^) - K e, then F (z - z^) + q, so its covariance is

        E <- (I - K H) E (I - K H)' + K R K',        E <- F E F' + Q

    whatever K is. There is no lambda in it, because the true mean does not move. Returned is sqrt(E of mu).

    P and E differ. For one stiffness, known states and information I per sample the forgetting filter is least squares
    with weights lambda^j for a sample j rows old: P = 1/(I sum lambda^j) = (1 - lambda)/I, but
    E = P^2 I sum lambda^2j = (1 - lambda)/(1 + lambda)/I = P/(1 + lambda). The filter calls itself 1.41 times as uncertain
    as it is, and its 95 % interval holds 99.4 %. `reported` is sqrt(P of mu).

    It bounds filters that discount what they know of mu by lambda, no others: less memory of the states, too (L of x and
    mu), gives 6 % less error of Cx in the square waves, more memory gives less of everything but follows a road later.
    With lambda = 1 K is optimal, E = P, and the bound is `cramer_rao`, which bounds them all.
    """
    return np.sqrt(_run(rows, truth, config, known)[1]) / _relative(truth, config)


def cramer_rao(rows: np.ndarray, truth: pd.DataFrame, config: Config, known: Known) -> np.ndarray:
    """Posterior Cramer-Rao bound of the mean stiffness, without forgetting, relative to the true mean: (rows, 3).

    Tichavsky, Muravchik & Nehorai (IEEE Trans. Signal Process. 46 (1998) 1386): in a linear-Gaussian model their recursion
    for the information J is the Kalman filter's for P = J^-1. It is run in P, since the process noise is singular (mu does
    not move, eps is replaced) and D22 = Q^-1 does not exist. The prior is that of the settings.
    """
    constant = Known(known.spread, known.noise_sd, 1.0)
    return np.sqrt(_run(rows, truth, config, constant)[0]) / _relative(truth, config)


def reported(rows: np.ndarray, truth: pd.DataFrame, config: Config, known: Known) -> np.ndarray:
    """sqrt(P of mu) of `forgetting_bound`: the sd which that estimator would report."""
    return np.sqrt(_run(rows, truth, config, known)[0]) / _relative(truth, config)


def _relative(truth: pd.DataFrame, config: Config) -> np.ndarray:
    """True mean stiffness over nominal, (rows, 3)."""
    return np.array([truth[f"true_{s}"] / getattr(config, NOMINAL[s]) for s in STIFFNESS]).T


def _run(rows: np.ndarray, truth: pd.DataFrame, config: Config, known: Known) -> tuple[np.ndarray, np.ndarray]:
    """Variances of mu after each row's measurement: P's and E's."""
    model, noise = Model(rows, config, known.held), Noise(config, known)
    x = np.array([truth[f"true_{name}"] for name in ("vel_x", "vel_y", "yaw_rate")]).T
    w = _relative(truth, config) - 1
    believed, actual = noise.start(), noise.start()
    variances = np.zeros((2, len(model), 3))
    for row in range(len(model)):
        if model.restart[row]:
            believed, actual = (noise.restart(c, model.dt[row]) for c in (believed, actual))
        else:
            _, f = model.linear_motion(row, x[row - 1], w[row - 1])
            q = noise.process(model.dt[row])
            believed, actual = f @ believed @ f.T + q, f @ actual @ f.T + q
        use = np.flatnonzero(model.usable[row])
        if len(use):
            _, h = model.linear_observation(row, x[row], w[row])
            gain, believed = update(believed, h[use], noise.r[use])
            left = np.eye(12) - gain @ h[use]
            actual = left @ actual @ left.T + (gain * noise.r[use]) @ gain.T
        variances[0, row], variances[1, row] = np.diagonal(believed)[MU], np.diagonal(actual)[MU]
        if len(use):
            believed = noise.forget(believed, model.dt[row] or config.sample_time)
    return variances[0], variances[1]
