"""Choose the most informative stretches of long logs (the excerpt). Missing effects and
formulas are searched for in the excerpt only, and the result is then fitted to the whole
logs.

The information matrix of a stretch is J'J / ENTRY_SD^2, where ENTRY_SD is the assumed sd
of the residuals. The columns of J are the partial derivatives of the residuals with
respect to stiffness and every effect of the catalogue, computed for the model without
effects and multiplied by the prior sds. The residuals of this model are one more column
of J. So a stretch also counts as informative if the model does not explain it.

The stretches are chosen one by one. The next stretch is always the one that most
increases ln det of the sum of the information matrices (a Bayesian D-optimal design,
Chaloner & Verdinelli 1995). So if a lane change has been chosen, a second lane change
adds less information than a first braking.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tse.gaps.catalogue import CatalogueParameter
from tse.gaps.fit import Fit
from tse.gaps.infer.hypotheses import choose_start, fit_prior, make_hypotheses
from tse.gaps.infer.space import REACH, STIFFNESS_SD
from tse.gaps.problem import STIFFNESS_PARAMETERS, Problem
from tse.identify.data import BURN_IN, FitStretch, PreparedLog

MAX_SECONDS = 90.0  # [s] total length of the stretches that are chosen
# [s] Length of the pieces into which logs are cut. It is the time of one or two
# manoeuvres. The excerpt consists of the most informative pieces. In the first BURN_IN
# seconds of each piece, simulation and measurement are not compared, because the initial
# state is unknown.
EXCERPT_PIECE_TIME = 15.0
# Assumed sd of the residuals in the information matrix of a piece, in units of the noise
# of the residuals. It is far above 1, because residuals also contain the errors of the
# model. With a smaller sd, the first few pieces would determine all parameters. All later
# pieces would then add little information, and the choice among them would be arbitrary.
ENTRY_SD = 30.0


def is_long(problem: Problem) -> bool:
    """Return whether the logs are so long that stretches are chosen: together longer than
    twice MAX_SECONDS.
    """
    return sum(log.seconds for log in problem.logs) > 2.0 * MAX_SECONDS


def choose_excerpt(problem: Problem, baseline: Fit) -> Problem:
    """Return the problem with only the most informative stretches of its logs, about
    MAX_SECONDS in total.

    If the logs are not long (is_long()), the problem is returned unchanged. `baseline` is
    the fit of the problem without effects. The computing time is one simulation of all
    logs for each parameter of the catalogue.
    """
    if not is_long(problem):
        return problem
    table, rows = _compute_slopes(problem, baseline), problem.rows
    pieces: list[tuple[int, FitStretch]] = []
    information: list[np.ndarray] = []
    for i, log in enumerate(problem.logs):
        for piece in _cut_pieces(log):
            first, last = log.time[piece.first] + BURN_IN, log.time[piece.last - 1]
            mine = table[(rows.log == i) & (rows.time >= first) & (rows.time <= last)]
            pieces.append((i, piece))
            information.append(mine.T @ mine / ENTRY_SD**2)
    chosen = choose_best(
        information, [piece.used.sum() * problem.logs[i].step for i, piece in pieces], MAX_SECONDS
    )
    logs = []
    for i, log in enumerate(problem.logs):
        mine = [pieces[k][1] for k in sorted(chosen) if pieces[k][0] == i]
        if mine:
            logs.append(replace(log, stretches=mine))
    return problem.of(logs)


def choose_best(information: Sequence[np.ndarray], seconds: Sequence[float], limit: float) -> list[int]:
    """Return the indices of the most informative pieces, in the order of their choice.

    `information` and `seconds` have the information matrix and the length of each piece.
    Pieces are added until their total length [s] reaches `limit`. The sum of the
    information matrices includes that of the prior, which is the identity matrix, because
    parameters are in units of their prior sds.
    """
    total = np.eye(len(information[0])) if information else np.zeros((0, 0))
    left, chosen, length = list(range(len(information))), [], 0.0
    while left and length < limit:
        gain = [np.linalg.slogdet(total + information[k])[1] for k in left]
        k = left.pop(int(np.argmax(gain)))
        chosen.append(k)
        total, length = total + information[k], length + seconds[k]
    return chosen


def _cut_pieces(log: PreparedLog) -> list[FitStretch]:
    """Cut the stretches of a log into pieces of the length EXCERPT_PIECE_TIME and return
    them. Each piece is simulated on its own, from an unknown initial state. So simulation
    and measurement are not compared in its first BURN_IN seconds."""
    found = []
    length = round(EXCERPT_PIECE_TIME / log.step) // log.rows_per_block * log.rows_per_block
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
    """Return the matrix J of the module's docstring for all logs. Each column has the
    partial derivatives of the residuals with respect to one stiffness or strength, times
    its prior sd. The last column has the residuals.
    """
    asked = make_hypotheses()
    parameters: list[CatalogueParameter] = [
        *STIFFNESS_PARAMETERS,
        *(p for h in asked for p in h.effect.strengths),
    ]
    at = baseline.values | {p.name: choose_start(p) for h in asked for p in h.effect.shapes}
    unit = [STIFFNESS_SD if p in STIFFNESS_PARAMETERS else fit_prior(p)[1] for p in parameters]
    slopes = problem.compute_jacobian(at, problem.compute_residuals(at), parameters, REACH)
    return np.column_stack([np.nan_to_num(slopes) * unit, baseline.residuals])
