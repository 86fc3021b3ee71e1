"""Decide whether named effects, a formula, or both explain the logs.

A named effect is one that the search reports as missing in the vehicle file. The gap is
the sum of squared residuals minus the sum expected from sensor noise
(fit.compute_excess()).

Named effects that close only a small part of the gap, or that are many, may merely
imitate an effect that is not in the catalogue. Therefore three combinations, called
worlds here, are compared: the named effects alone, the named effects with a formula for
the residuals that they leave, and a formula without named effects. The ln probability of
a world is, up to a constant,

    sum over channels of ln likelihood of the residuals (search.py) - price.

The price penalises the complexity of a world. It is the sum of the prices of its named
effects and of its formula. The price of a named effect is SIZE_COST, because its size was
fitted, minus ln of its prior odds (hypotheses.py). The price of a formula is the price of
its length (formula_search.py) minus ln of the prior odds that the missing effect is not
in the catalogue (OUTSIDE).

The likelihood is computed from the residuals of the fitted logs and of the held-out logs.
The held-out logs are simulated with the values that were fitted to the other logs. An
effect keeps its name only if the worlds in which it is named have a total probability of
at least NAME_AT.

There is no world with only some of the named effects and no formula. The search for
effects (search.py) has already compared such sets of effects, with a more detailed model
of the residuals than the one used here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tse.gaps.catalogue import drop_log_values
from tse.gaps.fit import Fit, fit_parameters
from tse.gaps.infer import naming as name
from tse.gaps.infer.formula_search import Discovery, discover_formula, refit_on_all
from tse.gaps.infer.hypotheses import NAME_AT, SIZE_COST, make_hypotheses
from tse.gaps.infer.naming import Naming
from tse.gaps.infer.roads import ROAD_PROBABILITY
from tse.gaps.infer.search import compute_ln_likelihood
from tse.gaps.parallel import run_in_processes
from tse.gaps.problem import Problem
from tse.identify.data import COMPARED_CHANNELS

# Min share of the gap (sum of squared residuals above the sensor noise) that all named
# effects together must close. If they close less, none is named. This is checked only if
# a formula is searched for. It is searched for if the user asks for one, or if the named
# effects leave residuals above the sensor noise.
MIN_TOGETHER = 0.2
OUTSIDE = 0.2  # prior probability that the missing effect is not in the catalogue
# Reason that the user reads if an effect that the search has named is not named in the
# result
INSTEAD = "a formula explains the logs about as well or better, even after a penalty for its length"


@dataclass
class World:
    """A combination of named effects and, if `discovery` is not None, a formula."""

    naming: Naming
    discovery: Discovery | None
    # [nat] penalty for the complexity of the named effects and of the formula. The ln
    # probability of the world is ln likelihood - price, up to a constant.
    price: float
    # residuals of the fitted logs, and of the held-out logs if there are any
    residuals: list[np.ndarray]
    probability: float = 0.0  # computed by Worlds.weigh()

    @property
    def names(self) -> frozenset[str]:
        return frozenset(n.effect.id for n in self.naming.named)

    @property
    def text(self) -> str | None:
        """The formula as a string; None without a formula."""
        return self.discovery.formula.text if self.discovery and self.discovery.formula else None


class Worlds:
    """The worlds that are compared with each other by their probability. A world is a
    combination of named effects and, if there is one, a formula.

    `held` has the held-out logs. It is None if there are no held-out logs.
    """

    def __init__(self, problem: Problem, held: Problem | None):
        self.problem, self.held = problem, held
        self.known: list[World] = []

    def add(self, naming: Naming, last: Fit, discovery: Discovery | None = None) -> None:
        """Add the world with the named effects of `naming` and the formula of `discovery`
        (None: no formula). Without a formula, the residuals come from the fit `last`;
        with a formula, from `discovery.fit`, and `last` is ignored.
        """
        price, values = sum((compute_name_price(n.effect.id) for n in naming.named), 0.0), last.values
        if discovery is not None:
            assert discovery.fit is not None
            price += discovery.price - compute_ln_odds(OUTSIDE)
            last, values = discovery.fit, discovery.values
        self.known.append(World(naming, discovery, price, self._compute_residuals(last, values)))

    def weigh(self) -> None:
        """Compute the probability of each world."""
        value = np.array([-w.price for w in self.known], float)
        for c in COMPARED_CHANNELS:
            value += [compute_ln_likelihood(*self._compute_mean_square(w.residuals, c)) for w in self.known]
        weight = np.exp(value - value.max())
        for w, p in zip(self.known, weight / weight.sum(), strict=True):
            w.probability = float(p)

    def with_name(self, effect: str) -> float:
        """Return the probability that this effect is present: the sum over the worlds
        that have it among their named effects."""
        return sum(w.probability for w in self.known if effect in w.names)

    def find_best(self) -> World:
        """Return the most probable world in which every named effect is certain. An
        effect is certain if the worlds in which it is named have a total probability of
        at least NAME_AT.
        """
        standing = (w for w in self.known if all(self.with_name(i) >= NAME_AT for i in w.names))
        return max(standing, key=lambda w: w.probability)

    def _compute_residuals(self, last: Fit, values: Mapping[str, float]) -> list[np.ndarray]:
        held = self.held
        return [last.residuals] + ([] if held is None else [held.compute_residuals(drop_log_values(values))])

    def _compute_mean_square(self, residuals: Sequence[np.ndarray], channel: str) -> tuple[float, int]:
        """Return the mean square of a channel's residuals over the fitted and the
        held-out logs, in units of the noise variance, and the number of these residuals.
        """
        total, rows = 0.0, 0
        for p, r in zip((p for p in (self.problem, self.held) if p is not None), residuals, strict=True):
            mine = dict(p.used()).get(channel)
            if mine is not None:
                total, rows = total + float(r[mine] @ r[mine]), rows + int(mine.sum())
        return total / max(rows, 1), rows


def compute_ln_odds(probability: float) -> float:
    """Return ln of the odds p / (1 - p)."""
    return float(np.log(probability / (1.0 - probability)))


def compute_name_price(effect: str) -> float:
    """Return the price [nat] of a named effect, i.e. the penalty for its complexity:
    SIZE_COST - ln of its prior odds."""
    return SIZE_COST - next(
        (h.odds for h in make_hypotheses() if h.id == effect), compute_ln_odds(ROAD_PROBABILITY)
    )


def explain_remainder(
    problem: Problem, held: Problem | None, naming: Naming, say: Callable[[str], None]
) -> tuple[Discovery, Naming, list[dict[str, Any]]]:
    """Search for formulas. Return the result of the formula search, the named effects,
    and a list of all worlds that were compared. A world is a combination of named effects
    and a formula (or none).

    The named effects are those of the best world (Worlds.find_best()). But an effect
    loses its name if the product of two probabilities is below NAME_AT: the probability
    that the vehicle file lacks this effect or one that can replace it (Named.whole), and
    the total probability of the worlds that name this effect (Worlds.with_name()). The
    formula is the one that the formula search with the named effects of the best world
    proposes, if any.
    """
    if naming.named and naming.closed < MIN_TOGETHER:
        little = f"the named effects together close less than {100 * MIN_TOGETHER:.0f} % of the gap"
        naming = name.drop_names(problem, naming, frozenset(), little)
    asked = [naming, *([name.drop_names(problem, naming, frozenset(), INSTEAD)] if naming.named else [])]
    fits = [refit_world(problem, n.final) for n in asked]
    worlds = Worlds(problem, held)

    def search_formula(k: int) -> Discovery:
        names = ", ".join(m.effect.id for m in asked[k].named)
        return discover_formula(
            problem, fits[k], held, lambda text: say(f"{text}{names and f', in addition to {names}'}")
        )

    sought = run_in_processes(problem.jobs, search_formula, range(len(asked)))
    worlds.add(naming, fits[0])
    for n, last, found in zip(asked, fits, sought, strict=True):
        if found.formula is not None:
            worlds.add(n, last, found)
    worlds.weigh()
    best = worlds.find_best()
    shown = [
        {"ids": sorted(w.names), "formula": w.text, "probability": w.probability}
        for w in sorted(worlds.known, key=lambda w: -w.probability)
    ]
    # Report the formula from the search that started from the named effects of the best
    # world. That search has decided whether the formula is proposed (formula_search.py).
    last = next(d for n, d in zip(asked, sought, strict=True) if n is best.naming)
    share = {n.effect.id: worlds.with_name(n.effect.id) for n in best.naming.named}
    named = [
        replace(n, probability=n.probability * share[n.effect.id], whole=n.whole * share[n.effect.id])
        for n in best.naming.named
    ]
    naming = replace(best.naming, named=named)
    if any(n.whole < NAME_AT for n in named):
        sure = frozenset(n.effect.id for n in named if n.whole >= NAME_AT)
        naming = name.drop_names(problem, naming, sure, name.UNSURE)
        last = refit_on_all(problem, naming.final, last)
    return *find_formula_beside(problem, naming, last), shown


def find_formula_beside(problem: Problem, naming: Naming, last: Discovery) -> tuple[Discovery, Naming]:
    """Return the formula, and the named effects that are still needed beside it.

    `last` is the result of the formula search, a fit of named effects and formula
    together. An effect is no longer named if, in this fit, the 95 % interval of each of
    its strengths includes the default, at which there is no effect. The intervals have
    the widths of the fit without a formula (Named.at()).
    """
    if last.formula is None or last.fit is None or not naming.named:
        return last, naming
    at = [n.at(last.fit.values) for n in naming.named]
    idle = {n.effect.id for n in at if n.holds_nothing}
    if not idle:
        return last, naming
    left = frozenset(n.effect.id for n in naming.named) - idle
    naming = name.drop_names(problem, naming, left, INSTEAD)
    return refit_on_all(problem, naming.final, last), naming


def refit_world(problem: Problem, last: Fit) -> Fit:
    """Fit the parameters of `last`, the fit of a world without a formula, again by
    fit_parameters(). Fits with a formula are made by the same function, so the residuals
    of worlds with and without a formula are comparable.
    """
    found = fit_parameters(problem.holding(last.values), last.parameters, last.values)
    return replace(found, values=last.values | found.values)
