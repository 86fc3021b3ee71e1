"""Name the missing effects, and state the size, probability and look-alikes of each. All
of this is computed from the sets of effects that the search has judged (search.py).

A named effect is one that is reported as missing in the vehicle file. A look-alike
explains the logs about as well as the named effect. The gap is the sum of squared
residuals minus the sum expected from sensor noise (fit.compute_excess()). Names and sizes
come from the fitted logs only. Held-out logs are not used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import norm

from tse.car.vehicle import list_latency_settings
from tse.gaps.catalogue import Effect, Key, drop_log_values, list_signed_delays, load_catalogue
from tse.gaps.fit import Fit, compute_channel_excess, compute_excess, fit_parameters
from tse.gaps.infer.folds import compute_held_out
from tse.gaps.infer.hypotheses import NAME_AT, Hypothesis, make_hypotheses
from tse.gaps.infer.roads import FoundRoad
from tse.gaps.infer.search import Judged, Search, judge_set
from tse.gaps.problem import STIFFNESS_PARAMETERS, Problem
from tse.identify.knots import PROFILES
from tse.identify.unknowns import SUPERELEVATION
from tse.log.rows import DRIVES

# The search computes the probability of many sets of effects. Effect B replaces a named
# effect A in a set that contains B but not A, if B is not in the most probable set. B is
# a look-alike of A if the sum of the probabilities of these sets is at least ALIKE_AT
# times the probability that A, or any effect that replaces A, is missing. ALIKE_AT is
# small, because the evidence has an error of about 2 nats: the evidence for mass and for
# yaw inertia differs by 2 nats, although no log can distinguish them.
ALIKE_AT = 0.02
# An effect that is not named is reported as possible if its probability is at least this
POSSIBLE_AT = 0.1
# The gap is the sum of squared residuals minus the sum expected from sensor noise. A
# named effect must close at least MIN_CLOSED of the gap that the other named effects
# leave. A road profile must close at least MIN_CLOSED of the gap of the channel in which
# it is visible (ROAD_CHANNEL). Superelevation is named even if it closes less.
MIN_CLOSED = 0.05
WIDE = float(norm.ppf(0.975))  # half the width of a 95 % interval, in sd
# The verdict is that the model lacks the named effects of car and sensors if they close
# more than MIN_NAMED of the gap that bank and grade of the roads leave.
MIN_NAMED = 0.5
ROAD_CHANNEL = {"grade": "accel_x", "bank": "accel_y"}  # channel in which a road effect is visible
MAX_SETS = 8  # max number of sets of effects that are reported, each with its probability
# Reasons why a possible effect is not named
SMALL, IDLE, UNSURE = "its size is negligible", "it closes almost nothing", f"below {100 * NAME_AT:.0f} %"
ZERO = "its 95 % interval includes the case without this effect"


@dataclass
class Named:
    """One named effect, and the evidence that the vehicle file lacks it."""

    effect: Effect
    values: dict[str, float]  # parameter -> fitted value
    ci95: dict[str, tuple[float, float]]  # parameter -> 95 % interval
    share: float  # share of the gap of the car without effects that this effect closes
    # [nat] ln of the evidence for the set of effects with this effect, minus ln of the
    # evidence for the set without it
    evidence: float
    probability: float = 1.0  # probability that the vehicle file lacks the effect
    # ids of effects that can replace this effect in other sets (ALIKE_AT)
    look_alikes: list[str] = field(default_factory=list)
    # The other named effects leave a gap. `alone` is the share of this gap that the
    # effect closes, computed in pieces of the logs that were left out of the fit
    # (folds.py).
    alone: float = 1.0
    # probability that the vehicle file lacks this effect, or an effect that replaces it
    # in other sets of effects
    whole: float = 1.0

    def at(self, values: Mapping[Key, float]) -> Named:
        """Return the named effect with the values of a different fit. The intervals are
        shifted and keep their widths.

        A road profile is returned unchanged, because it is not among the fitted values.
        """
        by = {k: values[k] - v for k, v in self.values.items() if k in values}
        ci95 = {k: (low + by.get(k, 0.0), high + by.get(k, 0.0)) for k, (low, high) in self.ci95.items()}
        return replace(self, values={k: v + by.get(k, 0.0) for k, v in self.values.items()}, ci95=ci95)

    @property
    def holds_nothing(self) -> bool:
        """True if the 95 % interval of every strength includes the default of this
        strength. With the default there is no effect.
        """
        default = {p.name: p.default for p in self.effect.strengths if p.name in self.ci95}
        return all(low <= default[k] <= high for k, (low, high) in self.ci95.items() if k in default)

    @property
    def message(self) -> bool:
        """True if the cause is not in the car, but in the messages (latency) or in the
        IMU (low-pass filter).

        True for the latencies of make_latencies(), and for an effect of the catalogue
        with a fitted strength below Effect.early_below, where a latency or a low pass is
        the cause.
        """
        e = load_catalogue().get(self.effect.id)
        if e is None:
            return self.effect.id != SUPERELEVATION
        return bool(e.early) and any(self.values.get(p.name, p.default) < e.early_below for p in e.strengths)

    @property
    def title(self) -> str:
        return self.effect.early if self.message and self.effect.early else self.effect.title


@dataclass
class Naming:
    """Result of a search for missing effects: the named effects, and possible effects
    that are not named."""

    baseline: Fit  # fit of the car without effects, on level roads
    final: Fit  # fit with the named effects
    named: list[Named]
    closed: float  # share of the gap that is closed by all named effects together
    # possible effects that are not named: id, probability, and why they are not named
    possible: list[dict]
    sets: list[dict]  # the most probable sets of effects: ids of the effects, and probability
    converged: bool  # True if the last fit has converged
    # Covariance matrix of ln stiffness due to the choice of the set of effects: the mean
    # of d d' over all sets, weighted by their probabilities. d is ln stiffness fitted
    # with a set, minus ln stiffness fitted with the named set. The matrix adds to the
    # uncertainty of the stiffness, because sets that explain the logs equally well may
    # have different stiffness.
    spread: np.ndarray = field(
        default_factory=lambda: np.zeros((len(STIFFNESS_PARAMETERS), len(STIFFNESS_PARAMETERS)))
    )

    @property
    def closes_most(self) -> bool:
        """True if the named effects of car and sensors close more than MIN_NAMED of the
        gap that is left after bank and grade of the roads have closed their part.
        """
        roads = sum(n.share for n in self.named if n.effect.id in (*PROFILES, SUPERELEVATION))
        return self.closed - roads > MIN_NAMED * max(1.0 - roads, 0.0)


def name_effects(
    problem: Problem,
    effects: Sequence[Effect],
    say: Callable[[str], None] = lambda _: None,
    baseline: Fit | None = None,
    roads: Sequence[FoundRoad] = (),
) -> Naming:
    """Search for the set of missing effects, and name those that are certain enough.

    The search computes the probabilities of many sets of effects. An effect of the most
    probable set is named if it, or an effect that replaces it in other sets, is missing
    with a probability of at least NAME_AT. A named effect loses its name if its size is
    negligible, if its 95 % interval includes the default, with which there is no effect,
    or if it closes too little of the gap (MIN_CLOSED).

    Parameters
    ----------
    problem : Problem
        The fitted logs.
    effects : Sequence of Effect
        The effects that may be missing.
    say : Callable
        Called with each line of progress.
    baseline : Fit or None
        Result of fit_plain_car() on level roads. None: it is computed for `problem`.
    roads : Sequence of FoundRoad
        The road profiles of the logs.
    """
    plain = fit_plain_car(problem)
    baseline = baseline or plain
    search = Search(problem, make_hypotheses(effects), say)
    best = search.run()
    probability = Probability(search, best.ids)
    names = {h.id for h in best.effects if probability.of_class(h.id) >= NAME_AT}
    dropped: dict[str, str] = {}  # effect -> why it has no name
    full = compute_excess(problem, baseline.residuals)
    while True:
        final = best if names == best.ids else search.judge(names, best.values, best, rough=True)
        # Sizes come from `sized`, a fit of the named effects only. Widths of intervals
        # come from `final`, a fit in which the effects without a name are not fixed at 0,
        # but have a narrow prior about 0. So the widths include the influence of these
        # effects.
        sized = fit_alone(problem, final.effects, final.values)
        small = {h.id: SMALL for h in final.effects if is_negligible(h.effect, sized.values)}
        small |= {h.id: ZERO for h in final.effects if includes_defaults(h, sized.values, final.compute_sd())}
        if small:
            names = final.ids - set(small)
            dropped |= small
            continue
        last = convert_to_fit(problem, sized) if final.effects else plain
        named = [
            _make_named(problem, search, final, sized, last, h, probability, full) for h in final.effects
        ]
        idle = min((n for n in named if n.effect.id != SUPERELEVATION), key=lambda n: n.alone, default=None)
        if idle is None or idle.alone >= MIN_CLOSED:
            break
        names = final.ids - {idle.effect.id}
        dropped[idle.effect.id] = IDLE
    named += name_roads(problem, baseline, plain, roads)
    stated = {n.effect.id for n in named}
    possible = [
        {"id": i, "probability": p, "why": dropped.get(i, UNSURE)}
        for i, p in sorted(probability.effects.items(), key=lambda x: -x[1])
        if p >= POSSIBLE_AT and i not in stated and not any(i in n.look_alikes for n in named)
    ]
    closed = 1.0 - compute_excess(problem, last.residuals) / full if full > 0 else 0.0
    spread = probability.compute_spread(search, final)
    return Naming(baseline, last, named, closed, possible, probability.list_sets(), final.converged, spread)


def drop_names(problem: Problem, naming: Naming, kept: frozenset[str], why: str) -> Naming:
    """Fit the effects `kept` again, and return the result in which only these are named.

    The other named effects become possible effects with the reason `why`. An effect of
    `kept` that is negligible in the new fit becomes a possible effect with the reason
    SMALL. Effects with a probability below POSSIBLE_AT are not reported at all.
    """
    left = _refit_names(problem, naming, kept, naming.baseline)
    stay = {n.effect.id for n in left.named}
    dropped = [
        {"id": n.effect.id, "probability": n.probability, "why": SMALL if n.effect.id in kept else why}
        for n in naming.named
        if n.effect.id not in stay and n.probability >= POSSIBLE_AT
    ]
    possible = sorted([*dropped, *naming.possible], key=lambda p: -p["probability"])
    return replace(left, possible=possible)


def refit_on_all(problem: Problem, naming: Naming, baseline: Fit) -> Naming:
    """Fit the named effects, which were found in an excerpt of the logs, to all logs.

    `problem` has all logs. `baseline` is the result of fit_plain_car() for all logs on
    level roads.
    """
    return _refit_names(problem, naming, frozenset(n.effect.id for n in naming.named), baseline)


def fit_plain_car(problem: Problem) -> Fit:
    """Fit the stiffness of the vehicle file's car by least squares, without effects."""
    return fit_parameters(problem, STIFFNESS_PARAMETERS, {})


def name_roads(problem: Problem, level: Fit, on_road: Fit, roads: Sequence[FoundRoad]) -> list[Named]:
    """Return the road profiles as named effects.

    `level` and `on_road` are fits of the car without effects: `level` on level roads, and
    `on_road` on roads with the estimated bank and grade. A profile is judged by the gap
    of the channel in which it is visible (ROAD_CHANNEL). It is named if this gap is
    smaller in `on_road` than in `level` by at least MIN_CLOSED of the gap in `level`.
    """
    full, before, after = (
        compute_excess(problem, level.residuals),
        *(compute_channel_excess(problem, f.residuals) for f in (level, on_road)),
    )
    found = []
    for r in roads:
        p, channel = r.effect.strengths[0].name, ROAD_CHANNEL[r.effect.id]
        closed = before.get(channel, 0.0) - after.get(channel, 0.0)
        if closed < MIN_CLOSED * before.get(channel, 0.0):
            continue
        share = closed / max(full, 1e-300)
        found.append(
            Named(r.effect, {p: r.size}, {p: r.ci95}, share, r.nats, r.probability, whole=r.probability)
        )
    return found


def _refit_names(problem: Problem, naming: Naming, kept: frozenset[str], baseline: Fit) -> Naming:
    """Fit the named effects whose ids are in `kept` again, and return the result in which
    only these effects are named. `baseline` is the fit on level roads without effects.

    The intervals keep their widths. Most of the width comes from errors of the model, so
    a fit to other logs hardly changes it.
    """
    roads = [n for n in naming.named if n.effect.id in PROFILES]
    flat = kept - {n.effect.id for n in roads}
    final, named, converged = fit_plain_car(problem), [], naming.converged
    asked = {e.id: e for e in load_catalogue().values()} | {
        n.effect.id: n.effect for n in naming.named if n.effect.id in load_catalogue()
    }
    if effects := [h for h in make_hypotheses(asked.values()) if h.id in flat]:
        plain = fit_alone(problem, effects, drop_log_values(naming.final.values))
        final, converged = convert_to_fit(problem, plain), plain.converged
        there = [n for n in naming.named if n.effect.id in flat]
        named = [n.at(final.values) for n in there if not is_negligible(n.effect, final.values)]
    full = compute_excess(problem, baseline.residuals)
    closed = 1.0 - compute_excess(problem, final.residuals) / full if full > 0 else 0.0
    named += roads
    return replace(naming, baseline=baseline, final=final, named=named, closed=closed, converged=converged)


def is_negligible(effect: Effect, values: Mapping[str, float]) -> bool:
    """Return whether every strength of an effect differs from its default by less than
    its negligible size.
    """
    return all(abs(values[p.name] - p.default) < p.negligible for p in effect.strengths)


def includes_defaults(h: Hypothesis, values: Mapping[str, float], sd: Mapping[str, float]) -> bool:
    """Return whether the 95 % interval of every strength includes the default of this
    strength. With the default there is no effect.
    """
    return all(abs(values[p.name] - p.default) < WIDE * sd[p.name] for p in h.effect.strengths)


def compute_relevance(judged: Judged, h: Hypothesis) -> float:
    """Return the probability that at least one strength of an effect exceeds its
    negligible size, given that the effect is in the set. The strengths are treated as
    independent.
    """
    little, sd = 1.0, judged.compute_sd()
    for p in h.effect.strengths:
        ends = (np.array([-p.negligible, p.negligible]) - (judged.values[p.name] - p.default)) / sd[p.name]
        little *= float(np.diff(norm.cdf(ends))[0])
    return 1.0 - little


class Probability:
    """Probabilities that effects of relevant size are missing, summed over all sets of
    effects that a search has judged.
    """

    def __init__(self, search: Search, found: frozenset[str]):
        """Sum the probabilities of the sets. `found` has the ids of the best set, whose
        effects may be named.
        """
        self._sets = search.compute_probabilities()
        self._found = found
        self.effects: dict[str, float] = {}
        for ids, p in self._sets.items():
            judged = search.list_judged()[ids]
            for h in judged.effects:
                self.effects[h.id] = self.effects.get(h.id, 0.0) + p * compute_relevance(judged, h)

    def in_place(self, effect: str) -> dict[str, float]:
        """Return the effects that replace `effect` in other sets, as id -> probability.

        Effect B replaces `effect` if B is not in the best set, and if a set contains B
        but not `effect`. The probability of B is the sum of the probabilities of all sets
        that contain B but not `effect`.
        """
        found: dict[str, float] = {}
        for ids, p in self._sets.items():
            if effect not in ids:
                for i in ids - self._found:
                    found[i] = found.get(i, 0.0) + p
        return found

    def of_class(self, effect: str) -> float:
        """Return the probability that an effect, or one that replaces it in other sets,
        is missing.
        """
        stand_in = sum(p for ids, p in self._sets.items() if effect not in ids and ids - self._found)
        return self.effects.get(effect, 0.0) + stand_in

    def compute_spread(self, search: Search, named: Judged) -> np.ndarray:
        """Return the sum of p d d' over all sets. p is the probability of a set, and d is
        ln stiffness fitted with this set, minus ln stiffness fitted with the set `named`.
        """
        sets = search.list_judged()
        away = {ids: compute_ln_stiffness(sets[ids]) - compute_ln_stiffness(named) for ids in self._sets}
        return sum(
            (p * np.outer(away[ids], away[ids]) for ids, p in self._sets.items()),
            np.zeros((len(STIFFNESS_PARAMETERS),) * 2),
        )

    def list_sets(self) -> list[dict]:
        """Return ids and probability of the most probable sets: at most MAX_SETS of them,
        and only those with a probability of at least 0.001.
        """
        top = sorted(self._sets.items(), key=lambda x: -x[1])[:MAX_SETS]
        return [{"ids": sorted(ids), "probability": p} for ids, p in top if p >= 0.001]


def compute_ln_stiffness(judged: Judged) -> np.ndarray:
    """Return ln of the ratio of each stiffness to its value in the vehicle file."""
    return np.log([judged.values[p.name] for p in STIFFNESS_PARAMETERS])


def _make_named(
    problem: Problem,
    search: Search,
    final: Judged,
    plain: Judged,
    last: Fit,
    h: Hypothesis,
    probability: Probability,
    full: float,
) -> Named:
    """Return an effect as a named effect, with its evidence and the shares of the gap
    that it closes.

    `h` is the effect. `plain` is the fitted set of the named effects only, and `last` is
    the same fit with its residuals. In the fit `final`, the effects that are not named
    are not 0, but have a narrow prior about 0. `full` is the gap of the car without
    effects.
    """
    found = _make_sized_name(h, plain, probability, final)
    without = search.judge(final.ids - {h.id}, final.values, final, rough=True)
    found.evidence = final.evidence - without.evidence
    others = tuple(o for o in final.effects if o is not h)
    less = judge_set(problem, others, [o.id for o in others], plain.values, plain, rough=True)
    before, after = (
        compute_excess(problem, convert_to_fit(problem, less, slopes=False).residuals),
        compute_excess(problem, last.residuals),
    )
    found.share = (min(before, full) - after) / max(full, 1e-300)
    noise = {c: float(problem.noise_energy[rows].sum()) for c, rows in problem.used()}
    unseen = [sum(max(0.0, x - noise[c]) for c, x in compute_held_out(j).items()) for j in (less, plain)]
    found.alone = 1.0 - unseen[1] / max(unseen[0], 1e-300)
    return found


def _make_sized_name(
    h: Hypothesis, judged: Judged, probability: Probability, rough: Judged | None = None
) -> Named:
    """Return a named effect with size, interval, probability and look-alikes.

    The size comes from `judged`, the fit of the named effects only. The width of the
    interval comes from the fit `rough`, in which the effects that are not named are not
    0, but have a narrow prior about 0. If `rough` is None, the width comes from `judged`.
    """
    sd = (rough or judged).compute_sd()
    values = {p.name: judged.values[p.name] for p in h.effect.fitted}
    item = Named(
        h.effect, values, {k: (v - WIDE * sd[k], v + WIDE * sd[k]) for k, v in values.items()}, 0.0, 0.0
    )
    item.probability = probability.effects.get(h.id, 0.0)
    whole = item.whole = probability.of_class(h.id)
    instead = probability.in_place(h.id)
    item.look_alikes = sorted(
        (i for i, p in instead.items() if p >= ALIKE_AT * whole), key=lambda i: -instead[i]
    )
    return item


def fit_alone(problem: Problem, effects: Sequence[Hypothesis], values: Mapping[str, float]) -> Judged:
    """Fit these effects, with all other effects absent. The fit starts at `values`."""
    return judge_set(problem, effects, [h.id for h in effects], values)


def convert_to_fit(problem: Problem, judged: Judged, slopes: bool = True) -> Fit:
    """Return a judged set as a Fit: values, residuals and, if `slopes` is True,
    their partial derivatives.
    """
    there = {p.name for h in judged.effects for p in h.effect.fitted} | {p.name for p in STIFFNESS_PARAMETERS}
    parameters = [p for p in judged.space.parameters if p.name in there]
    values = {p.name: judged.values[p.name] for p in parameters}
    residuals = problem.compute_residuals(values)
    jacobian = (
        problem.compute_jacobian(values, residuals, parameters) if slopes else np.zeros((len(residuals), 0))
    )
    return Fit(parameters, values, residuals, jacobian)


def convert_to_settings(problem: Problem, values: Mapping[Key, float]) -> dict[str, float]:
    """Return fitted values as settings of a vehicle file.

    A vehicle file has no negative delays. A steering delay of -D becomes the delay 0 and
    the latency +D of the steering angle. An IMU delay of -D becomes the delay 0 and the
    latency +D of steering angle and wheel speeds. Latencies of messages become latencies
    of channels. Parameters of the road are left out, except superelevation.
    """
    given = problem.config.as_dict()
    road = (p.name for e in PROFILES for p in load_catalogue()[e].parameters if p.key != SUPERELEVATION)
    others = {*list_signed_delays(), *list_latency_settings().values(), *road}
    found = {k: v for k, v in drop_log_values(values).items() if k in problem.config and k not in others}
    later = dict.fromkeys((*DRIVES, "accel_x", "accel_y"), 0.0) | problem.get_latencies(values)
    for key, channels in (("steering_delay_time", ("steer_angle",)), ("imu_delay_time", DRIVES)):
        change = max(values.get(key, given[key]), 0.0) - given[key]
        if key in values:
            found[key] = max(values[key], 0.0)
        for c in channels:
            later[c] += change
    found |= {f"{c}_latency": given[f"{c}_latency"] + by for c, by in later.items() if abs(by) > 1e-9}
    return found
