"""Of long logs the stretches that say most: sets of effects and formulas are searched
there, and what is found is fitted to all.

What a stretch says is the information about stiffness and every effect of the catalogue
(slopes where nothing is missing, channel by channel, sizes in units of what is typical)
and about whatever the plain model leaves. The stretches are chosen one by one, each by
how much it adds to ln det of the information of those that are there (a Bayesian
D-optimal design, Chaloner & Verdinelli 1995): a second lane change adds less than the
first braking.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tse.gaps.catalogue import CatalogueParameter
from tse.gaps.fit import Fit
from tse.gaps.infer.hypotheses import choose_start, fit_prior, make_hypotheses
from tse.gaps.infer.space import REACH, STIFFNESS_SD
from tse.gaps.problem import STIFFNESS, Problem
from tse.identify.data import BURN_IN, FitStretch, PreparedLog

# s: of logs, in which effects are searched: what is found is fitted to all of them
MAX_SECONDS = 90.0
# s: of a log that is chosen or not: a manoeuvre or two, of which BURN_IN is lost
PIECE = 15.0
# noise of a block: that a piece's information counts with: models are no better known
# than that, and with less the first pieces are sure of everything
ENTRY_SD = 30.0


def is_long(problem: Problem) -> bool:
    """Return whether logs are long enough for a choice of MAX_SECONDS."""
    return sum(log.seconds for log in problem.logs) > 2.0 * MAX_SECONDS


def choose_excerpt(problem: Problem, baseline: Fit) -> Problem:
    """Return the stretches with the most information, MAX_SECONDS in all.

    A problem that is hardly longer is returned as it is. `baseline` is the fit of this
    problem. Cost: as many simulations of everything as the catalogue has parameters.
    """
    if not is_long(problem):
        return problem
    table, rows = _compute_slopes(problem, baseline), problem.rows
    pieces: list[tuple[int, FitStretch]] = []
    says: list[np.ndarray] = []
    for i, log in enumerate(problem.logs):
        for piece in _cut_pieces(log):
            first, last = log.time[piece.first] + BURN_IN, log.time[piece.last - 1]
            mine = table[(rows.log == i) & (rows.time >= first) & (rows.time <= last)]
            pieces.append((i, piece))
            says.append(mine.T @ mine / ENTRY_SD**2)
    chosen = choose_best(says, [piece.used.sum() * problem.logs[i].step for i, piece in pieces], MAX_SECONDS)
    logs = []
    for i, log in enumerate(problem.logs):
        mine = [pieces[k][1] for k in sorted(chosen) if pieces[k][0] == i]
        if mine:
            logs.append(replace(log, stretches=mine))
    return problem.of(logs)


def choose_best(says: Sequence[np.ndarray], seconds: Sequence[float], most: float) -> list[int]:
    """Return the indices of pieces, most informative first, up to the length `most`.

    `says` is their information, in units of the prior.
    """
    total = np.eye(len(says[0])) if says else np.zeros((0, 0))
    left, chosen, length = list(range(len(says))), [], 0.0
    while left and length < most:
        gain = [np.linalg.slogdet(total + says[k])[1] for k in left]
        k = left.pop(int(np.argmax(gain)))
        chosen.append(k)
        total, length = total + says[k], length + seconds[k]
    return chosen


def _cut_pieces(log: PreparedLog) -> list[FitStretch]:
    """Cut stretches to PIECE. Each starts anew, and its first second is not compared."""
    found = []
    length = round(PIECE / log.step) // log.rows_per_block * log.rows_per_block
    ahead = -(-round(BURN_IN / log.step) // log.rows_per_block) * log.rows_per_block
    for s in log.stretches:
        for first in range(s.first, s.last, length):
            last = min(first + length, s.last)
            if last - first > 2 * ahead:
                used = s.used[first - s.first : last - s.first].copy()
                used[:ahead] = False
                found.append(FitStretch(first, last, used))
    return found


def _compute_slopes(problem: Problem, baseline: Fit) -> np.ndarray:
    """Return the slopes of the residuals, per prior sd, and the residuals."""
    asked = make_hypotheses()
    parameters: list[CatalogueParameter] = [*STIFFNESS, *(p for h in asked for p in h.effect.strengths)]
    at = baseline.values | {p.name: choose_start(p) for h in asked for p in h.effect.shapes}
    unit = [STIFFNESS_SD if p in STIFFNESS else fit_prior(p)[1] for p in parameters]
    slopes = problem.jacobian(at, problem.residuals(at), parameters, REACH)
    return np.column_stack([np.nan_to_num(slopes) * unit, baseline.residuals])
