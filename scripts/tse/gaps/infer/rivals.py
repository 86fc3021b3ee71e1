"""Decide between named effects, a formula, or both.

Named effects that leave most of the gap, or that close it only by their number, may
imitate something that the catalogue lacks. Therefore several combinations are compared:
the named effects alone, the named effects with a formula for what they leave, and a
formula without named effects. Each combination, called a world here, has the value

    sum over channels of ln likelihood of the residuals (search.py) - price.

The price of a name is its prior odds and the cost of its size (hypotheses.py). The
price of a formula is that of its length (formula_search.py) and the odds that the
catalogue lacks something. Residuals of the held-out logs count, too, with the values
fitted to the other logs. A name is kept if the worlds that contain it have together at
least the probability NAME_AT.

A subset of the names without a formula is no world, because the search has already
decided which effects to name, by a more detailed model of the residuals.
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

# If a remainder is left, the names must close at least this share of the gap together.
# Otherwise all of them are dropped.
MIN_TOGETHER = 0.2
OUTSIDE = 0.2  # prior probability that the missing effect is not in the catalogue
# Reason why an effect that the search named has no name in the end
INSTEAD = "a formula explains about as much or more, less its price"


@dataclass
class World:
    """A combination of named effects and, if `discovery` is given, a formula."""

    naming: Naming
    discovery: Discovery | None
    price: float  # [nat]
    residuals: list[np.ndarray]  # of the fitted logs and, if there are any, of the held-out logs
    probability: float = 0.0

    @property
    def names(self) -> frozenset[str]:
        return frozenset(n.effect.id for n in self.naming.named)

    @property
    def text(self) -> str | None:
        """The text of the formula; None without a formula."""
        return self.discovery.formula.text if self.discovery and self.discovery.formula else None


class Worlds:
    """All worlds that are compared."""

    def __init__(self, problem: Problem, held: Problem | None):
        self.problem, self.held = problem, held
        self.known: list[World] = []

    def add(self, naming: Naming, last: Fit, discovery: Discovery | None = None) -> None:
        """Add a world. `last` is the fit of its names, `discovery` its formula."""
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
        """Return the total probability of the worlds that contain this named effect."""
        return sum(w.probability for w in self.known if effect in w.names)

    def find_best(self) -> World:
        """Return the most probable world all of whose names have a probability of
        at least NAME_AT.
        """
        standing = (w for w in self.known if all(self.with_name(i) >= NAME_AT for i in w.names))
        return max(standing, key=lambda w: w.probability)

    def _compute_residuals(self, last: Fit, values: Mapping[str, float]) -> list[np.ndarray]:
        held = self.held
        return [last.residuals] + ([] if held is None else [held.compute_residuals(drop_log_values(values))])

    def _compute_mean_square(self, residuals: Sequence[np.ndarray], channel: str) -> tuple[float, int]:
        """Return the mean square of a channel's residuals in units of the noise,
        and their number.
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
    """Return the price of a name in nats: cost of its size less prior ln odds."""
    return SIZE_COST - next(
        (h.odds for h in make_hypotheses() if h.id == effect), compute_ln_odds(ROAD_PROBABILITY)
    )


def explain_remainder(
    problem: Problem, held: Problem | None, naming: Naming, say: Callable[[str], None]
) -> tuple[Discovery, Naming, list[dict[str, Any]]]:
    """Return the result of the formula search, the names, and all worlds
    that were compared.

    Formula and names are those of Worlds.find_best(). A name whose probability over all
    worlds is below NAME_AT is dropped.
    """
    if naming.named and naming.closed < MIN_TOGETHER:
        little = f"the names together close less than {100 * MIN_TOGETHER:.0f} % of the gap"
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
    # The formula to report is the result of the search with these names. That search has
    # already decided, also by the held-out logs, whether a formula is proposed.
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
    """Return the formula and the names that are still needed with it.

    A formula may explain what a named effect explained before. If the interval of the
    effect's size, fitted with the formula, then includes no effect, its name is dropped.
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
    """Fit the parameters of `last` again by least squares, as fits with a formula are
    made, so that worlds with and without a formula are comparable.
    """
    found = fit_parameters(problem.holding(last.values), last.parameters, last.values)
    return replace(found, values=last.values | found.values)
