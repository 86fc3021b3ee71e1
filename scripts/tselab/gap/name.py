"""Naming the missing effects: forward selection with everything refitted, backward pruning, gates, swap test.

Score of an effect: nats by which the model with it explains the logs better, stiffness and all other parameters refitted
(fit.gain). It is named only above ln(effects in the catalogue / FALSE_NAMES): then fewer than FALSE_NAMES of the logs of a
car without any missing effect get a name, whatever the size of the catalogue.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import norm

from tselab.gap.catalogue import Effect, Parameter
from tselab.gap.fit import Fit, covariance, excess, fit, gain
from tselab.gap.optional import TORQUES
from tselab.gap.problem import PROFILES, STIFFNESS, Problem, profile_size
from tselab.vehicle import GRAVITY

FALSE_NAMES = 0.01
REFIT = 5  # candidates of the linear screening that are fitted in full
REACH = 15.0  # steps: a chord over a third of the typical size says more of an effect than its tangent at zero
LEAST_SHARE = 0.03  # of the gap that is left: what an effect must close to be worth a name
LEAST_EVIDENCE = 0.03  # of all nats so far: what less explains, after others, repairs the shape of theirs
LEAST_CLOSED = 0.8  # of the gap: what all names together must close
AS_MUCH = 0.95  # of what a road's profile closes: what one effect of the car closes, too, is the car's
RIVAL_NATS, RIVAL_SHARE = 5.0, 0.1  # a rival that explains as much to within this cannot be excluded
NEGLIGIBLE = "negligible in size"
MOST_EFFECTS = 6
PATCHWORK = 4  # as many effects and more: more likely a patchwork than the truth
LEAST_CLOSED_PATCHWORK = 0.9  # so they must close more


@dataclass
class Named:
    """One named effect and what speaks for it."""

    effect: Effect
    values: dict[str, float]
    ci95: dict[str, tuple[float, float]]
    share: float  # of the gap that it closes
    evidence: float  # nats
    look_alikes: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)


@dataclass
class Naming:
    """What the selection came to."""

    baseline: Fit
    final: Fit
    named: list[Named]
    closed: float  # share of the gap
    ranking: list[dict]  # the first screening in full: every effect alone
    steps: list[dict]
    rejected: list[dict]


def threshold(effects: int) -> float:
    """Nats that a name needs."""
    return float(np.log(effects / FALSE_NAMES))


def fit_with(problem: Problem, effects: Sequence[Effect], start: Mapping[str, float]) -> Fit:
    """Stiffness and these effects together. A shape says nothing while its strength is near zero, so strengths come first."""
    strengths = [*STIFFNESS, *(p for e in effects for p in problem.strengths(e))]
    shapes = [p for e in effects for p in e.shapes]
    kick = dict(start)
    for e in effects:
        for p in problem.strengths(e):
            kick.setdefault(p.name, p.default if e.id in PROFILES else p.default + 0.25 * (p.sign or 1) * p.scale)
    first = fit(problem, strengths, kick, most=8)
    if not shapes:
        return first
    return fit(problem, [*strengths, *(_typical(p) for p in shapes)], kick | first.values)


def _typical(p: Parameter) -> Parameter:
    """A shape is only searched where it is plausible: it is there to let a form give, not to make another effect of it."""
    return p if p.typical_high <= p.typical_low else Parameter(**(vars(p) | {"low": p.typical_low, "high": p.typical_high}))


def screen(problem: Problem, current: Fit, candidates: Sequence[Effect]) -> list[tuple[float, Effect, dict[str, float]]]:
    """Every candidate in a linearisation around the current fit: (nats, effect, start values), best first."""
    parameters = [p for e in candidates for p in problem.strengths(e)]
    slopes = problem.jacobian(current.values, current.residuals, parameters, REACH)
    q, _ = np.linalg.qr(current.jacobian)
    found, k = [], 0
    for e in candidates:
        strengths = problem.strengths(e)
        a = slopes[:, k : k + len(strengths)]
        k += len(strengths)
        own = a - q @ (q.T @ a)  # what stiffness and the effects already named cannot do
        size = np.linalg.norm(own, axis=0) * np.array([p.scale for p in strengths])
        if not np.all(np.isfinite(own)) or size.max() < 1e-6 * np.sqrt(len(own)):
            found.append((0.0, e, {}))
            continue
        prior = np.diag([1.0 / p.prior if p.prior else 0.0 for p in strengths])
        gram = own.T @ own
        x = -np.linalg.lstsq(gram + prior @ prior, own.T @ current.residuals, rcond=1e-10)[0]
        x = np.array([np.clip(v, p.low - p.default, p.high - p.default) for v, p in zip(x, strengths, strict=True)])
        after = current.residuals + own @ x
        start = {p.name: p.default + float(v) for v, p in zip(x, strengths, strict=True)}
        found.append((gain(problem, current.residuals, after) - freedom(problem, e, own), e, start))
    return sorted(found, key=lambda f: -f[0])


def freedom(problem: Problem, e: Effect, slopes: np.ndarray) -> float:
    """Nats that an effect gains by chance, beyond those of one parameter: half of its effective number of parameters more."""
    if e.id not in PROFILES:
        return 0.5 * (len(e.strengths) - 1)
    prior = np.diag([1.0 / p.prior for p in problem.strengths(e)])
    gram = slopes.T @ slopes
    return float(np.trace(np.linalg.solve(gram + prior @ prior, gram)))


def name(
    problem: Problem,
    effects: Sequence[Effect],
    say: Callable[[str], None] = lambda _: None,
    baseline: Fit | None = None,
) -> Naming:
    """Which effects the logs show, if any."""
    baseline = baseline or fit(problem, STIFFNESS, {})
    need, full_gap = threshold(len(effects)), excess(problem, baseline.residuals)
    current, chosen, ranking, steps, rejected = baseline, [], [], [], []
    refused: set[str] = set()
    while len(chosen) < MOST_EFFECTS:
        rest = [e for e in effects if e not in chosen and e.id not in refused]
        screened = screen(problem, current, rest)
        if not ranking:
            ranking = [{"id": e.id, "nats": g} for g, e, _ in screened]
        tried = []
        for g, e, start in screened[:REFIT]:
            if g < 0.2 * need:
                break
            say(f"{len(chosen) + 1}. effect: trying {e.id}")
            with_it = fit_with(problem, [*chosen, e], current.values | start)
            chance = freedom(problem, e, with_it.columns(problem.strengths(e)))
            tried.append((gain(problem, current.residuals, with_it.residuals) - chance, e, with_it))
        tried = _road_last(problem, current, sorted(tried, key=lambda t: -t[0]))
        for entry in ranking:
            for g, e, f in tried:
                if entry["id"] == e.id and not chosen:
                    entry |= {"nats": g, "share": _share(problem, baseline, f, full_gap), "values": dict(f.values)}
        accepted = trifle = None
        for g, e, with_it in tried:
            left = excess(problem, current.residuals)
            share = (left - excess(problem, with_it.residuals)) / max(left, 1e-300)
            all_nats = gain(problem, baseline.residuals, with_it.residuals)
            why = _refuse(problem, e, with_it, g, max(need, LEAST_EVIDENCE * all_nats), share)
            if why == NEGLIGIBLE and trifle is None:
                trifle = (e, with_it)
            if why is None and trifle is not None and not _beyond(problem, chosen, trifle, e, with_it, need):
                why = f"a negligible {trifle[0].id} explains the same, and better"
            if why is None:
                accepted = (g, e, with_it)
                break
            rejected.append({"id": e.id, "nats": g, "share": share, "why": why, "step": len(chosen) + 1})
        if accepted is None:
            break
        g, e, current = accepted
        chosen.append(e)
        steps.append({"id": e.id, "nats": g, "closed": _share(problem, baseline, current, full_gap)})
        current, chosen, dropped = _prune(problem, current, chosen, need, say)
        refused |= dropped
        if dropped:
            steps.append({"dropped": sorted(dropped)})
    closed = _share(problem, baseline, current, full_gap)
    named = _named(problem, effects, chosen, current, full_gap, say)
    return Naming(baseline, current, named, closed, sorted(ranking, key=lambda r: -r["nats"]), steps, rejected)


def _road_last(
    problem: Problem, current: Fit, tried: list[tuple[float, Effect, Fit]]
) -> list[tuple[float, Effect, Fit]]:
    """A profile has a hundred parameters and bends to the form of anything (a rolling resistance is a slope that every road has):
    it comes after an effect of the car that closes as much of the gap."""
    before = excess(problem, current.residuals)
    closes = {e.id: before - excess(problem, f.residuals) for _, e, f in tried}
    car = max((closes[e.id] for _, e, _ in tried if e.id not in PROFILES), default=0.0)
    return sorted(tried, key=lambda t: t[1].id in PROFILES and car > 0.0 and car >= AS_MUCH * closes[t[1].id])


def _share(problem: Problem, baseline: Fit, f: Fit, full_gap: float) -> float:
    return 1.0 - excess(problem, f.residuals) / full_gap if full_gap > 0 else 0.0


def _refuse(problem: Problem, e: Effect, f: Fit, g: float, need: float, share: float) -> str | None:
    """Why this effect gets no name; None: it does."""
    if g < need:
        return f"evidence {g:.1f} nats, needed {need:.1f}"
    if share < LEAST_SHARE:
        return f"closes {100 * share:.1f} % of the gap"
    if e.id in PROFILES:
        return None if profile_size(e, f.values) >= e.strengths[0].negligible else NEGLIGIBLE
    if all(abs(f.values[p.name] - p.default) < p.negligible for p in e.strengths):
        return NEGLIGIBLE
    for p in e.strengths:
        inside = 0.98 * p.typical_low <= abs(f.values[p.name]) <= 1.001 * p.typical_high
        if f.at_bound(p) and not inside and abs(f.values[p.name] - p.default) >= p.negligible:
            return f"{p.name} runs to the limit of what is plausible"
        if p.sign and p.sign * (f.values[p.name] - p.default) < -p.negligible:
            return f"{p.name} has the wrong sign"
    return None


def _beyond(problem: Problem, chosen: list[Effect], trifle: tuple[Effect, Fit], e: Effect, f: Fit, need: float) -> bool:
    """Does an effect explain what a better one, too small to be named, leaves? Wheels that spin up are 1 % of yaw inertia."""
    small, without = trifle
    both = fit_with(problem, [*chosen, small, e], f.values | without.values)
    return gain(problem, without.residuals, both.residuals) - freedom(problem, e, both.columns(problem.strengths(e))) >= need


def _prune(
    problem: Problem, current: Fit, chosen: list[Effect], need: float, say: Callable[[str], None]
) -> tuple[Fit, list[Effect], set[str]]:
    """Drop what the others, refitted, make superfluous."""
    dropped: set[str] = set()
    for e in list(chosen[:-1]):
        others = [o for o in chosen if o is not e]
        say(f"is {e.id} still needed?")
        without = fit_with(problem, others, {k: v for k, v in current.values.items() if not k.startswith((e.id + "_", e.id + "@"))})
        if gain(problem, without.residuals, current.residuals) < need:  # a name, once given, needs no more than that
            current, chosen = without, others
            dropped.add(e.id)
    return current, chosen, dropped


def _named(
    problem: Problem, effects: Sequence[Effect], chosen: list[Effect], final: Fit, full_gap: float, say: Callable[[str], None]
) -> list[Named]:
    sd = np.sqrt(np.maximum(np.diag(covariance(problem, final)), 0.0)) if chosen else np.zeros(0)
    sd_of = {p.name: s for p, s in zip(final.parameters, sd, strict=True)} if chosen else {}
    z = float(norm.ppf(0.975))
    named = []
    for e in chosen:
        others = [o for o in chosen if o is not e]
        start = {k: v for k, v in final.values.items() if not k.startswith((e.id + "_", e.id + "@"))}
        without = fit_with(problem, others, start) if others else fit(problem, STIFFNESS, start)
        evidence = gain(problem, without.residuals, final.residuals)
        share = (excess(problem, without.residuals) - excess(problem, final.residuals)) / max(full_gap, 1e-300)
        if e.id in PROFILES:
            mine = problem.strengths(e)
            size, spread = profile_size(e, final.values), float(np.sqrt(np.mean([sd_of[p.name] ** 2 for p in mine])))
            values = {e.strengths[0].name: size}
            ci = {e.strengths[0].name: (max(0.0, size - z * spread), size + z * spread)}
        else:
            values = {p.name: final.values[p.name] for p in e.fitted}
            ci = {k: (v - z * sd_of[k], v + z * sd_of[k]) for k, v in values.items()}
        item = Named(e, values, ci, share, evidence)
        item.look_alikes = look_alikes(problem, effects, chosen, e, without, final, evidence, say)
        for p in e.strengths:
            if not p.typical_low <= abs(values[p.name]) <= p.typical_high:
                item.remarks.append(
                    f"{p.name} = {values[p.name]:.3g} {p.unit} is outside the typical {p.typical_low:g} .. {p.typical_high:g}"
                )
        if e.id == "rolling_resistance" and any(c in TORQUES for log in problem.logs for c in log.channels):
            c = problem.config
            torque = values["rolling_resistance_coefficient"] * c.mass * GRAVITY * c.wheel_radius_front
            item.remarks.append(f"wheel torques that together are a constant {torque:.0f} Nm too high would look the same")
        named.append(item)
    return named


def look_alikes(
    problem: Problem,
    effects: Sequence[Effect],
    chosen: Sequence[Effect],
    e: Effect,
    without: Fit,
    final: Fit,
    evidence: float,
    say: Callable[[str], None],
) -> list[str]:
    """Swap test: which effects, in the place of this one and with all else refitted, explain the logs as well."""
    others = [o for o in chosen if o is not e]
    margin = max(RIVAL_NATS, RIVAL_SHARE * evidence)
    rivals = []
    screened = screen(problem, without, [r for r in effects if r is e or r not in chosen])
    own = next(g for g, r, _ in screened if r is e)
    screened = [s for s in screened if s[1] is not e]
    best = {r.id: (g, r, s) for g, r, s in screened}
    ask = [best[i] for i in e.relatives if i in best]
    ask += [f for f in screened[:3] if f not in ask]
    for g, rival, start in ask:
        if g < 0.3 * own:
            continue
        say(f"could it be {rival.id} instead of {e.id}?")
        swapped = fit_with(problem, [*others, rival], without.values | start)
        if gain(problem, swapped.residuals, final.residuals) < margin:
            rivals.append(rival.id)
    return rivals
