"""What a set of effects leaves of pieces of the logs that it was not fitted to.

The logs are cut into pieces of PIECE, and dealt to FOLDS folds. Without the rows of one
fold
the fit would be elsewhere: by its slopes, x + d with
    H' d = w J'e of that fold, H' the information of the other folds,
and leave e + J d there.
"""

from __future__ import annotations

import numpy as np

from tse.gaps.infer.search import Judged

FOLDS = 5
PIECE = 10.0  # s: a manoeuvre or two


def compute_held_out(judged: Judged) -> dict[str, float]:
    """Return the sum of squares that each channel keeps of folds that were not fitted, in
    units of the noise."""
    space, fit = judged.space, judged.fit
    assert space is not None and fit is not None
    folds = [(time // PIECE).astype(int) % FOLDS for time in space.time]
    found = dict.fromkeys(space.channels, 0.0)
    weights = [fit.scales[c].sd ** -2 for _, c in space.groups]
    # of equal rows: those of the fit count large residuals less
    whole = space.information + sum(w * j.T @ j for w, j in zip(weights, fit.slopes[0], strict=True))
    for k in range(FOLDS):
        mine = [(e[f == k], j[f == k]) for e, j, f in zip(fit.residuals, fit.slopes[0], folds, strict=True)]
        own = sum(w * j.T @ j for w, (_, j) in zip(weights, mine, strict=True))
        pull = sum(w * j.T @ e for w, (e, j) in zip(weights, mine, strict=True))
        by = np.linalg.solve(whole - own, pull)
        for (e, j), (_, c) in zip(mine, space.groups, strict=True):
            found[c] += float(np.sum((e + j @ by) ** 2))
    return found
