"""Search for the sets of effects that explain the logs, and compute the probability of
each set.

The evidence of a set is approximated by Laplace's method:
    ln evidence = sum over channels of ln likelihood at the best fit
        + ln prior density of the fitted values + 1/2 ln det(2 pi H^-1)
        + sum of ln prior odds of the effects of the set,
where H is the Hessian of the negative log posterior.

The fit (identify/fit.py) gives the squared residuals of a channel the weight 1 / sd^2.
For a channel with n residuals of rms r,
    sd^2 = noise^2 + (r^2 - noise^2) V.
Here r^2 - noise^2 is the mean square of the model error. V is the number of residuals in
MODEL_TIME, the correlation time of a model error. The likelihood L of the channel is
defined such that its derivative has the same weight:
    d ln L / d(sum of squares) = -1 / (2 sd^2).
Since the sum of squares is n r^2, the integral is
    ln L = -n / (2 V) ln(1 + V (r^2 / noise^2 - 1)).
In sd^2, r^2 - noise^2 is replaced by LASTING^2 noise^2 if it is smaller than that:
LASTING (space.py) is the rms model error of even the best model, in units of the noise.

Every fit has the strengths (sizes) of all effects as unknowns. Effects outside the set
have a prior that keeps them small. So one fit gives the partial derivatives of the
residuals with respect to all effects. From these derivatives, the evidence of other sets
is approximated by linear algebra (class Around). The sets that are most probable by this
approximation are then fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from tse.gaps.infer.hypotheses import Hypothesis, compute_ln_normal, fit_prior
from tse.gaps.infer.space import LASTING, Space
from tse.gaps.problem import Problem
from tse.identify import fit as engine
from tse.identify.data import BLOCK_TIME

MAX_EFFECTS = 12  # max number of effects in a set
MAX_ROUNDS = 12  # max number of steps of one climb (_climb()), each with the fit of a set
PASSES = 4  # max number of climbs after the first one, each followed by _fit_rivals()
AT_ONCE = 2  # max number of effects that are added, removed or replaced between two fits
# max number of replacements that are fitted for each effect of the best set
# (_fit_rivals())
RIVALS = 2
# [nat] A set is not fitted if its approximate evidence is below that of the best set by
# more than this value.
FAR = 12.0
WORTH = 0.1  # [nat] min increase of the evidence for which a set counts as better
# If no change of a single effect raises the evidence of a set, pairs of effects are
# added: one of the PAIRED effects with the largest evidence when added alone, and any
# other.
PAIRED = 8
# Number of iterations of Around.judge(). Each iteration computes the unknowns for given
# variances of the channels, and then the variances from the residuals at these unknowns.
WEIGHINGS = 4


@dataclass
class Judged:
    """A set of effects and its evidence. It was fitted, or approximated from the fit of a
    different set (class Around).
    """

    effects: tuple[Hypothesis, ...]
    values: dict[str, float]  # parameter -> fitted value
    covariance: np.ndarray  # covariance of the values
    evidence: float  # [nat] ln evidence, including ln of the prior odds of the effects
    space: Space | None = None  # None if the set was not fitted
    fit: engine.CarFit | None = None  # None if the set was not fitted

    @property
    def ids(self) -> frozenset[str]:
        return frozenset(h.id for h in self.effects)

    @property
    def converged(self) -> bool:
        return self.fit is not None and self.fit.converged

    def compute_sd(self) -> dict[str, float]:
        return dict(zip(self.values, np.sqrt(np.diag(self.covariance)), strict=True))


def compute_error_duration() -> float:
    """Return V (top of this file): correlation time of a model error, in blocks of 40
    ms."""
    return engine.MODEL_TIME / BLOCK_TIME


def compute_variance(square: float) -> float:
    """Return the variance of residuals in the likelihood. `square` is the mean square of
    the residuals. `square` and the returned variance are in units of the noise variance.
    """
    return 1.0 + compute_error_duration() * max(square - 1.0, LASTING**2)


def compute_ln_likelihood(square: float, count: int) -> float:
    """Return ln likelihood of a channel with `count` residuals (formula: top of this
    file). `square` is their mean square in units of the noise variance.

    If `square` - 1 is below LASTING^2, the variance of the residuals is constant, and ln
    likelihood is linear in `square`.
    """
    more = square - 1.0 - LASTING**2
    lowest = 1.0 + compute_error_duration() * LASTING**2
    above = float(np.log(lowest + compute_error_duration() * max(more, 0.0))) / compute_error_duration()
    return -0.5 * count * (above + min(more, 0.0) / lowest)


def compute_ln_size_odds(effects: Sequence[Hypothesis], values: Mapping[str, float]) -> float:
    """Return the sum over the effects of ln prior odds + ln(p/q).

    p and q are two prior densities at the fitted size of an effect. p is the true prior,
    which need not be normal (Hypothesis.compute_ln_prior()). q is the wide normal prior
    that the fit used in its place. The evidence from the fit contains q, so adding
    ln(p/q) replaces q by p.
    """
    total = 0.0
    for h in effects:
        fitted = sum(compute_ln_normal(values[p.name], *fit_prior(p)) for p in h.effect.strengths)
        total += h.odds + h.compute_ln_prior(values) - fitted
    return total


def judge_set(
    problem: Problem,
    asked: Sequence[Hypothesis],
    members: Collection[str],
    start: Mapping[str, float],
    like: Judged | None = None,
    rough: bool = False,
) -> Judged:
    """Fit a set of effects, and return it with its evidence.

    Parameters
    ----------
    problem
        The logs.
    asked
        All effects whose strengths are unknowns of the fit, in the set or outside it.
    members
        Ids of the effects of the set.
    start
        Values at which the fit starts.
    like
        A set that was fitted before. The partial derivatives of the residuals with
        respect to effects outside the new set are taken from its fit. None: they are
        simulated.
    rough
        False: the partial derivatives with respect to the effects of the new set are
        simulated. True: the fit starts with the derivatives from the fit of `like`
        instead, and updates them after each step (Broyden), which saves simulations.
    """
    lent = like.fit.slopes[0] if like is not None and like.fit is not None else None
    space = Space(problem, asked, members, lent)
    x = space.at(start)
    tables = _transfer_slopes(space, like) if like is not None and rough else None
    found = engine.fit(space, x, near=bool(start), tables=tables)
    values = space.values(found.search)
    away = found.search - space.mean
    evidence = sum(compute_ln_likelihood(*_compute_mean_square(space, found, c)) for c in space.channels)
    evidence -= 0.5 * float(away @ space.information @ away)
    evidence -= float(np.log(space.sd).sum()) + 0.5 * float(np.linalg.slogdet(found.equations.information)[1])
    evidence += compute_ln_size_odds(space.effects, values)
    return Judged(space.effects, values, found.covariance, evidence, space, found)


def _compute_mean_square(space: Space, found: engine.CarFit, channel: str) -> tuple[float, int]:
    """Return the mean square of a channel's residuals, and the number of residuals.
    Residuals e beyond Huber's limit h contribute h |e| in place of e^2.
    """
    e = np.concatenate([r for r, (_, c) in zip(found.residuals, space.groups, strict=True) if c == channel])
    end = engine.HUBER * found.scales[channel].rms
    return float(np.mean(np.abs(e) * np.minimum(np.abs(e), end))), len(e)


def _transfer_slopes(space: Space, like: Judged) -> list[np.ndarray]:
    """Return the partial derivatives of the residuals from the fit of `like`, one matrix
    for each channel of each log, with one column for each unknown of `space`.

    If an unknown of `space` is not an unknown of `like`, its column is 0. This can only
    be a shape parameter, such as a time constant, of an effect that is not in the set of
    `like`.
    """
    assert like.space is not None and like.fit is not None
    place = {n: k for k, n in enumerate(like.space.names)}
    found = []
    for table in like.fit.slopes[0]:
        mine = np.zeros((len(table), len(space.names)))
        for k, n in enumerate(space.names):
            if n in place:
                mine[:, k] = table[:, place[n]]
        found.append(mine)
    return found


class Around:
    """Approximates the evidence of any set of effects from the partial derivatives of one
    fit."""

    def __init__(self, judged: Judged):
        assert judged.space is not None and judged.fit is not None
        self.judged, self.space = judged, judged.space
        self._x = judged.fit.search
        size = len(self._x)
        self._count, self._square = (np.zeros(len(self.space.channels)) for _ in range(2))
        self._gradient = np.zeros((len(self.space.channels), size))
        self._gram = np.zeros((len(self.space.channels), size, size))
        tables = judged.fit.slopes[0]
        if self.space.lent is not None:
            tables = self.space.compute_own_slopes(self._x, judged.fit.residuals)
        parts = zip(judged.fit.residuals, tables, self.space.groups, strict=True)
        for e, table, (_, c) in parts:
            k = self.space.channels.index(c)
            weight = np.minimum(1.0, engine.HUBER * judged.fit.scales[c].rms / np.maximum(np.abs(e), 1e-300))
            self._count[k] += len(e)
            self._square[k] += float(e @ (weight * e))
            self._gradient[k] += table.T @ (weight * e)
            self._gram[k] += table.T @ (weight[:, None] * table)
        self._first = self._compute_weights(self._square)
        self._here = 0.0
        self._here = judged.evidence - self.judge(judged.ids).evidence

    def _compute_weights(self, square: np.ndarray) -> np.ndarray:
        return np.array([1.0 / compute_variance(s / n) for s, n in zip(square, self._count, strict=True)])

    def judge(self, members: frozenset[str]) -> Judged:
        """Return the set of the effects with the ids `members`, with approximate
        parameter values and evidence."""
        space = self.space
        effects = tuple(h for h in space.asked if h.id in members)
        mean, sd = space.compute_prior(members)
        there = {p.name for h in effects for p in h.effect.fitted}
        # Fix the shape parameters (such as time constants) of effects outside the set at
        # their values in the fit of `self.judged`.
        for k, p in enumerate(space.parameters):
            if not p.strength and p.name not in there:
                mean[k], sd[k] = self._x[k], 1e-6
        precision, weights = sd**-2, self._first
        for _ in range(WEIGHINGS):
            information = np.einsum("k,kij->ij", weights, self._gram) + np.diag(precision)
            gradient = weights @ self._gradient + precision * (self._x - mean)
            factor = cho_factor(information)
            x = np.clip(self._x - cho_solve(factor, gradient), space.low, space.high)
            by = x - self._x
            square = self._square + 2.0 * self._gradient @ by + np.einsum("i,kij,j->k", by, self._gram, by)
            weights = self._compute_weights(square)
        evidence = self._here
        evidence += sum(
            compute_ln_likelihood(s / n, int(n)) for s, n in zip(square, self._count, strict=True)
        )
        evidence -= 0.5 * float(precision @ (x - mean) ** 2)
        evidence -= float(np.log(sd).sum() + np.log(np.diag(factor[0])).sum())
        values = space.values(x)
        evidence += compute_ln_size_odds(effects, values)
        slope = space.compute_ln_slope(x)
        return Judged(effects, values, cho_solve(factor, np.eye(len(x))) * np.outer(slope, slope), evidence)


@dataclass
class Search:
    """Searches for the most probable set of effects, and stores the sets that it has
    fitted or approximated.
    """

    problem: Problem
    asked: Sequence[Hypothesis]  # all effects that a set may have
    say: Callable[[str], None] = lambda _: None
    known: dict[frozenset[str], Judged] = field(default_factory=dict)  # sets that were fitted
    # sets whose evidence was approximated from the fit of the best set
    near: dict[frozenset[str], Judged] = field(default_factory=dict)

    def judge(
        self,
        ids: Collection[str],
        start: Mapping[str, float],
        like: Judged | None = None,
        rough: bool = False,
    ) -> Judged:
        """Return the fitted set with these effects. If it has not been fitted before, it
        is fitted now by judge_set() with `start`, `like` and `rough`.
        """
        key = frozenset(ids)
        if key not in self.known:
            self.say(f"trying {', '.join(sorted(key)) or 'no effect'}")
            self.known[key] = judge_set(self.problem, self.asked, key, start, like, rough)
        return self.known[key]

    def run(self) -> Judged:
        """Return the most probable set. The search is started twice: from the empty set,
        and from the set of all effects. It continues from the better of the two results.
        """
        best = self._climb(self.judge((), {}))
        best = max(best, self._prune(best), key=lambda j: j.evidence)
        for _ in range(PASSES):
            best = self._climb(best)
            self._fit_rivals(best)
            likeliest = max(self.list_judged().values(), key=lambda j: j.evidence)
            if likeliest.evidence < best.evidence + WORTH:
                break
            self.judge(likeliest.ids, likeliest.values, best)
            best = max(self.known.values(), key=lambda j: j.evidence)
        return best

    def _prune(self, start: Judged) -> Judged:
        """Return the set that is reached from the set of all effects by removing effects
        one by one, as long as the evidence rises.

        The result may contain two effects that nearly cancel. A search that adds effects
        would not find such a pair, because adding only one of the two does not raise the
        evidence.
        """
        whole = self.judge([h.id for h in self.asked], start.values, start, rough=True)
        around, best = Around(whole), whole
        while best.effects:
            less = [around.judge(best.ids - {i}) for i in sorted(best.ids)]
            there = max(less, key=lambda j: j.evidence)
            if there.evidence < best.evidence:
                break
            best = there
        return self.judge(best.ids, best.values, start)

    def _climb(self, best: Judged) -> Judged:
        """Return the best set that is reached from `best` by repeatedly adding, removing
        or replacing effects.
        """
        for _ in range(MAX_ROUNDS):
            around = Around(best)
            self.near = {}
            there = self._find_best_near(around, best.ids, AT_ONCE)
            if there == best.ids:
                break
            new = there - best.ids
            tried = self.judge(there, self._get_set(around, there).values, best)
            tried = max([tried, *self._fit_alike(tried, new)], key=lambda j: j.evidence)
            if tried.evidence > best.evidence:
                best = tried
        return best

    def _fit_alike(self, judged: Judged, effects: Collection[str]) -> list[Judged]:
        """Fit the sets that are made from the set `judged` by replacing one of `effects`
        by an effect that the catalogue lists as similar, and return these sets.

        They are fitted because the linear approximation is not accurate enough to compare
        large effects.
        """
        found = []
        for h in judged.effects:
            for o in h.effect.relatives if h.id in effects else ():
                ids = judged.ids - {h.id} | {o}
                if o not in judged.ids and any(o == a.id for a in self.asked):
                    mine = {p.name for p in h.effect.fitted}
                    found.append(
                        self.judge(ids, {n: v for n, v in judged.values.items() if n not in mine}, judged)
                    )
        return found

    def _fit_rivals(self, best: Judged) -> None:
        """For each effect of the best set, fit the set without this effect, and the
        RIVALS most probable sets in which a different effect replaces it.
        """
        around = Around(best)
        for h in best.effects:
            less = best.ids - {h.id}
            others = [frozenset(less | {o.id}) for o in self.asked if o.id not in best.ids]
            ranked = sorted((self._get_set(around, s) for s in others), key=lambda j: -j.evidence)
            for j in (self._get_set(around, less), *ranked[:RIVALS]):
                if j.ids == less or j.evidence > best.evidence - FAR:
                    self.judge(j.ids, j.values, best, rough=True)
        for o in self.asked:
            if o.id not in best.ids:
                self._get_set(around, best.ids | {o.id})

    def _get_set(self, around: Around, ids: frozenset[str]) -> Judged:
        """Return a set of effects: the fitted set if it has been fitted, otherwise an
        approximation."""
        if ids in self.known:
            return self.known[ids]
        if ids not in self.near:
            self.near[ids] = around.judge(ids)
        return self.near[ids]

    def _find_best_near(self, around: Around, start: frozenset[str], changes: int) -> frozenset[str]:
        """Return the ids of the set that is reached from `start` by at most `changes`
        changes.

        A change adds, removes or replaces one effect, so that the approximate evidence
        rises most. If it would rise by less than WORTH, two effects are added, or two are
        replaced by one. If the evidence still rises by less than WORTH, the search ends.
        """

        def get_evidence(ids: frozenset[str]) -> float:
            return self._get_set(around, ids).evidence

        best = start
        for _ in range(changes):
            out = [h.id for h in self.asked if h.id not in best]
            near = [best - {i} for i in best]
            if len(best) < MAX_EFFECTS:
                near += [best | {o} for o in out]
            near += [best - {i} | {o} for i in best for o in out]
            there = max(near, key=get_evidence)
            if get_evidence(there) < get_evidence(best) + WORTH:
                first = sorted(out, key=lambda o: -get_evidence(best | {o}))[:PAIRED]
                room = len(best) + 2 <= MAX_EFFECTS
                near = [best | {a, b} for a in first for b in out if a != b and room]
                near += [best - {i, k} | {o} for i in best for k in best if i < k for o in out]
                there = max(near, key=get_evidence, default=best)
            if get_evidence(there) < get_evidence(best) + WORTH:
                break
            best = there
        return best

    def compute_probabilities(self) -> dict[frozenset[str], float]:
        """Return a dict: ids of the effects of a set -> its probability, for all sets
        that were fitted or approximated. The sum of the probabilities is 1.
        """
        sets = self.list_judged()
        ln = np.array([j.evidence for j in sets.values()])
        weight = np.exp(ln - ln.max())
        return dict(zip(sets, map(float, weight / weight.sum()), strict=True))

    def list_judged(self) -> dict[frozenset[str], Judged]:
        """Return a dict: ids of the effects of a set -> the set, for all sets that were
        fitted or approximated. If a set was both, the fitted one is returned.
        """
        return self.near | self.known
