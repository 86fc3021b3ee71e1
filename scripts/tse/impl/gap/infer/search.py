"""The sets of effects that the logs speak for, and how likely each is: evidence by Laplace's method, sets found by adding, leaving
out and exchanging one effect at a time.

ln evidence of a set = sum over channels of power x ln likelihood of the residuals under the most probable discrepancy (noise.py),
    biases integrated, + ln prior of what is fitted, at the best fit,
    + 1/2 ln det(2 pi H^-1), H the curvature there,
    + ln prior odds of its effects.
The best fit is that of identify. A discrepancy is found anew for every set: a set that explains more leaves less of it. The
powers (Layout.trust) are those of the set that leaves least, the same for all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tse.impl.gap.catalogue import Parameter
from tse.impl.gap.infer import engine, noise
from tse.impl.gap.infer.hypotheses import Hypothesis, fit_prior, ln_normal, start_of
from tse.impl.gap.infer.space import REACH, Layout, Space, raw, slopes
from tse.impl.gap.parallel import apart
from tse.impl.identify.discrepancy import Discrepancy, without_bias

REFIT = 5  # candidates of a screening that are fitted in full
SWAPS = 3  # candidates that are asked to stand in for an effect
MOST_EFFECTS = 8  # of a set
PASSES = 2  # of adding, leaving out and exchanging
MOST_STEPS = 12  # of a fit while sets are compared
AHEAD = 1  # effects that may come to no good before the next one does
WORTH = 0.5  # nats: a set that is better by less is no reason to go on
FAR = 12.0  # nats: candidates that a screening puts further behind nothing are not fitted
SHARE = 0.5  # of what an effect is worth by the screening: what is worth less is not asked to stand in for it


@dataclass
class Judged:
    """A set of effects, fitted."""

    effects: tuple[Hypothesis, ...]
    space: Space
    x: np.ndarray
    noise: dict[str, Discrepancy]
    residuals: list[np.ndarray]
    likelihood: dict[str, float]  # ln, by channel
    gram: dict[str, np.ndarray]  # by channel: slopes' slopes, whitened
    prior: float  # ln, of what is fitted and of the effects
    left: dict[str, noise.Left]  # by channel
    converged: bool

    @property
    def ids(self) -> frozenset[str]:
        return frozenset(h.id for h in self.effects)

    @property
    def values(self) -> dict[str, float]:
        return self.space.values(self.x)

    @property
    def information(self) -> np.ndarray:
        return sum(self.space.power[c] * g for c, g in self.gram.items()) + self.space.information

    @property
    def evidence(self) -> float:
        """ln, with the prior odds of the set."""
        power = self.space.power
        total = self.prior + sum(power[c] * x for c, x in self.likelihood.items())
        return total + 0.5 * float(np.log(np.diag(self.space.information)).sum() - np.linalg.slogdet(self.information)[1])

    def sd(self) -> dict[str, float]:
        return dict(zip(self.space.names, np.sqrt(np.diag(np.linalg.inv(self.information))), strict=True))


@dataclass
class Search:
    """All sets that were looked at."""

    layout: Layout
    asked: Sequence[Hypothesis]
    jobs: int = 1
    say: Callable[[str], None] = lambda _: None
    known: dict[frozenset[str], Judged] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.nothing: list[np.ndarray] = []  # residuals without any effect

    # ---- one set

    def judge(self, ids: Iterable[str], start: Mapping[str, float], parent: Judged | None = None) -> Judged:
        """The set, fitted from `start` unless it was before."""
        key = frozenset(ids)
        if key not in self.known:
            self.known[key] = self._judged((key, start, parent))
        return self.known[key]

    def judge_all(self, asked: Sequence[tuple[frozenset[str], Mapping[str, float], Judged]]) -> list[Judged]:
        """Many sets, each from what another one had."""
        new = list({ids: (ids, start, parent) for ids, start, parent in asked if ids not in self.known}.values())
        for (ids, start, _), j in zip(new, apart(self.jobs, self._judged, new, _light), strict=True):
            if j.space is None:
                j.effects = tuple(h for h in self.asked if h.id in ids)
                j.space = Space(self.layout, j.effects, start)
            self.known[ids] = j
        return [self.known[ids] for ids, _, _ in asked]

    def _judged(self, asked: tuple[frozenset[str], Mapping[str, float], Judged | None]) -> Judged:
        ids, start, parent = asked
        return judge(self.layout, [h for h in self.asked if h.id in ids], start, parent)

    # ---- the search

    def run(self) -> Judged:
        """The most probable set that adding, leaving out and exchanging finds."""
        best, seen = self.judge((), {}), set()
        self.nothing = best.space.physical(best.x)
        while best.ids not in seen and len(seen) < PASSES:
            seen.add(best.ids)
            self._swapped(self._pruned(self._grown(best)))
            best = max(self.known.values(), key=lambda j: j.evidence)
        return best

    def _grown(self, best: Judged) -> Judged:
        there, behind = best, 0
        while len(there.effects) < MOST_EFFECTS and behind <= AHEAD:
            found = screen(self.layout, there, [h for h in self.asked if h.id not in there.ids])
            promising = [f for f in found[:REFIT] if f[0] >= -FAR]
            ask = [(there.ids | {h.id}, there.values | start, there) for _, h, start in promising]
            self.say(f"effect {len(there.effects) + 1}: trying {', '.join(h.id for _, h, _ in promising)}")
            tried = self.judge_all(ask)
            self._trust()
            there = max(tried, key=lambda j: j.evidence, default=None)
            if there is None:
                break
            if there.evidence < best.evidence + WORTH:
                behind += 1
            else:
                best, behind = there, 0
                best = there = self._explained(best)
        return best

    def _trust(self) -> None:
        """By what the set that leaves least leaves, channel by channel."""
        self.layout.trust(self._least())

    def _least(self) -> dict[str, noise.Left]:
        return {c: min((j.left[c] for j in self.known.values()), key=lambda x: x.wrong) for c in self.layout.channels}

    def _explained(self, best: Judged) -> Judged:
        """From here on what the set does is known to the catalogue's forms only: all sets are judged anew."""
        self.layout.explains(self.nothing, best.space.physical(best.x), best.values)
        least = self._least()
        self.known.clear()
        again = self.judge(best.ids, best.values, best)
        self.judge((), best.values, again)  # nothing is missing: always one of the answers, also where taking one away is worse
        self.layout.trust({c: min(least[c], again.left[c], key=lambda x: x.wrong) for c in least})
        return again

    def _pruned(self, best: Judged) -> Judged:
        while best.effects:
            self.say(f"is each of {', '.join(h.id for h in best.effects)} still needed?")
            without = self.judge_all([(best.ids - {h.id}, best.values, best) for h in best.effects])
            there = max(without, key=lambda j: j.evidence)
            if there.evidence < best.evidence:
                break
            best = there
        return best

    def _swapped(self, best: Judged) -> Judged:
        there = best
        for h in best.effects:
            without = self.known[best.ids - {h.id}]
            found = screen(self.layout, without, [o for o in self.asked if o.id not in without.ids])
            own = next((g for g, o, _ in found if o is h), 0.0)
            found = [f for f in found if f[1] is not h and f[0] >= min(own - FAR, SHARE * own)]
            ask = found[:SWAPS] + [f for f in found[SWAPS:] if f[1].id in h.effect.relatives]
            self.say(f"what could be in the place of {h.id}?")
            tried = self.judge_all([(without.ids | {o.id}, without.values | start, without) for _, o, start in ask])
            there = max([there, *tried], key=lambda j: j.evidence)
        return there

    # ---- what came of it

    def probabilities(self) -> dict[frozenset[str], float]:
        """Of the sets that were looked at."""
        sets = list(self.known.values())
        ln = np.array([j.evidence for j in sets])
        weight = np.exp(ln - ln.max())
        return {j.ids: float(w) for j, w in zip(sets, weight / weight.sum(), strict=True)}


def _light(judged: Judged) -> Judged:
    """Without what the process that asked has, too."""
    return replace(judged, effects=(), space=None)


def judge(layout: Layout, effects: Sequence[Hypothesis], start: Mapping[str, float], parent: Judged | None) -> Judged:
    """Fit a set of effects and say what it is worth."""
    kick = {p.name: start_of(p) for h in effects for p in h.effect.fitted}
    space = Space(layout, effects, kick | dict(start))
    if parent:
        space.knows(parent.noise, parent.residuals)
    found = engine.fit(space, space.first, parent.noise if parent else None, most=MOST_STEPS, chords=True)
    residuals, found.x = found.residuals, space.centred(found.x)
    gram = {c: np.zeros((len(found.x), len(found.x))) for c in space.channels}
    for table, (_, c) in zip(found.slopes, space.groups, strict=True):
        gram[c] += table.T @ table / space.power[c]
    away = (found.x - space.mean) / space.sd
    values = space.values(found.x)
    prior = -0.5 * float(away @ away)
    for h in space.effects:
        prior += h.odds + h.ln_prior(values) - sum(ln_normal(values[p.name], *fit_prior(p)) for p in h.effect.strengths)
    likelihood = {c: noise.worth(found.noise[c], noise.Series.of(space.pieces(residuals, c))) for c in space.channels}
    left = {c: noise.Left.of(found.noise[c], space.pieces(residuals, c)) for c in space.channels}
    return Judged(space.effects, space, found.x, found.noise, residuals, likelihood, gram, prior, left, found.converged)


def screen(layout: Layout, current: Judged, candidates: Sequence[Hypothesis]) -> list[tuple[float, Hypothesis, dict[str, float]]]:
    """Every candidate in a linearisation around a fit: (ln evidence over the fit's, candidate, start values), the most promising
    first: those that are best if what is left is a discrepancy as it was found, and those that are if it is all theirs, in turn."""
    parameters: list[Parameter] = [p for h in candidates for p in h.effect.fitted]
    space = current.space
    physical = space.physical(current.x)
    kick = {p.name: start_of(p) for h in candidates for p in h.effect.fitted}
    tables = [np.zeros((len(b), 0)) for b in physical]
    for h in candidates:  # a shape does nothing while its strength is nothing: around a third of the typical size
        at, strengths, shapes = current.values, h.effect.strengths, h.effect.shapes
        middle = {p.name: kick[p.name] for p in shapes}
        found = slopes(layout, at | middle, physical, strengths, REACH)
        if shapes:
            there = at | {p.name: kick[p.name] for p in h.effect.fitted}
            more = slopes(layout, there, layout.split(raw(layout.problem, there)), shapes)
            found = [np.column_stack([a, b]) for a, b in zip(found, more, strict=True)]
        tables = [np.column_stack([t, f]) for t, f in zip(tables, found, strict=True)]
    steep = space.slopes(current.x, current.residuals)
    lists = []
    for share in (1.0, 0.0):
        noise_of = {c: replace(d, share=max(share * d.share, noise.RANGES[1][0])) for c, d in current.noise.items()}
        lists.append(_screened(layout, current, candidates, parameters, tables, steep, noise_of))
    found: dict[str, tuple[float, Hypothesis, dict[str, float]]] = {}
    for pair in zip(*lists, strict=True):
        for one in pair:
            found.setdefault(one[1].id, one)
    return list(found.values())


def _screened(
    layout: Layout,
    current: Judged,
    candidates: Sequence[Hypothesis],
    parameters: Sequence[Parameter],
    tables: list[np.ndarray],
    steep: list[np.ndarray],
    noise_of: dict[str, Discrepancy],
) -> list[tuple[float, Hypothesis, dict[str, float]]]:
    """One of the two lists of screen(). What discrepancies would be without what a candidate explains is taken from how much it
    explains of each channel."""
    space = current.space
    r, j = engine.whitened(space, noise_of, current.residuals, steep)
    white = []
    for g, (_, channel) in enumerate(layout.groups):
        piece = space.piece(g, current.residuals[g])
        z = noise_of[channel].whiten(piece, np.column_stack([piece.bias, tables[g]]))[0]
        white.append(space.power[channel] ** 0.5 * without_bias(z[:, 1:], z[:, 0]))
    q_of = np.linalg.qr(np.vstack([*j, np.diag(1.0 / space.sd)]))[0]
    stacked = np.vstack([*white, np.zeros((len(current.x), len(parameters)))])
    own = stacked - q_of @ (q_of.T @ stacked)
    target = np.concatenate([*r, np.zeros(len(current.x))])
    target = target - q_of @ (q_of.T @ target)
    channel_of = np.concatenate([np.repeat(layout.channels.index(c), len(x)) for x, (_, c) in zip(r, layout.groups, strict=True)])
    found, k = [], 0
    for h in candidates:
        mine = h.effect.fitted
        a = own[:, k : k + len(mine)]
        k += len(mine)
        begin = {p.name: p.default if p.strength else start_of(p) for p in mine}
        if not np.isfinite(a).all() or not np.abs(a).max() > 0:
            found.append((-np.inf, h, {p.name: start_of(p) for p in mine}))
            continue
        information = a.T @ a + np.diag([fit_prior(p)[1] ** -2 for p in mine])
        x = -np.linalg.solve(information, a.T @ target)
        start = {p.name: float(np.clip(begin[p.name] + v, p.low, p.high)) for p, v in zip(mine, x, strict=True)}
        start = {p.name: start[p.name] if p.strength else begin[p.name] for p in mine}
        before, after = (y[: len(channel_of)] for y in (target, target + a @ x))
        n = len(h.effect.strengths)
        gain = h.odds + h.ln_prior(start) + 0.5 * (n * np.log(2 * np.pi) - float(np.linalg.slogdet(information[:n, :n])[1]))
        for c, channel in enumerate(layout.channels):
            rows = channel_of == c
            one, two = (float(y[rows] @ y[rows]) for y in (before, after))
            gain += 0.5 * space.power[channel] * int(rows.sum()) * np.log(max(one, 1e-300) / max(two, 1e-300))
        found.append((float(gain), h, start))
    return sorted(found, key=lambda f: -f[0])
