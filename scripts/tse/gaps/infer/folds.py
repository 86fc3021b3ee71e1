"""Test a set of effects by cross-validation: compute its residuals in pieces of the logs
that are left out of the fit.

The logs are cut into pieces of the length FOLD_PIECE_TIME, which are distributed over
FOLDS folds. The fit is not repeated for each fold, but linearised. If the rows of one
fold are left out, the parameters change by d, where
    H d = w J'e.
H is the information matrix of the other folds plus that of the prior. J, e and w are the
partial derivatives, residuals and weights of the fold that is left out. The residuals of
this fold become e + J d.
"""

from __future__ import annotations

import numpy as np

from tse.gaps.infer.search import Judged

FOLDS = 5  # number of folds
FOLD_PIECE_TIME = 10.0  # [s] length of the pieces into which the logs are cut: one or two manoeuvres


def compute_held_out(judged: Judged) -> dict[str, float]:
    """Return for each channel the sum of squared residuals over all folds. The residuals
    of a fold, in units of the sensor noise, come from a fit to the other folds.
    """
    space, fit = judged.space, judged.fit
    assert space is not None and fit is not None
    folds = [(time // FOLD_PIECE_TIME).astype(int) % FOLDS for time in space.time]
    found = dict.fromkeys(space.channels, 0.0)
    weights = [fit.scales[c].sd ** -2 for _, c in space.groups]
    # All rows of a channel have the same weight here. In the fit, large residuals have
    # smaller weights.
    whole = space.information + sum(w * j.T @ j for w, j in zip(weights, fit.slopes[0], strict=True))
    for k in range(FOLDS):
        mine = [(e[f == k], j[f == k]) for e, j, f in zip(fit.residuals, fit.slopes[0], folds, strict=True)]
        own = sum(w * j.T @ j for w, (_, j) in zip(weights, mine, strict=True))
        pull = sum(w * j.T @ e for w, (e, j) in zip(weights, mine, strict=True))
        by = np.linalg.solve(whole - own, pull)
        for (e, j), (_, c) in zip(mine, space.groups, strict=True):
            found[c] += float(np.sum((e + j @ by) ** 2))
    return found
