"""Names, a formula, or both: what explains most for what it costs to say.

Names that leave most of a gap, or close it by being many, may be a patchwork for
something that the catalogue does not have. So what the search named stands beside
formulas for what these, or none, leave. Each of these worlds is worth

    sum over channels of ln likelihood of the residuals (search.py)  -  what it costs to
    say,

a name its prior odds and size (hypotheses.py), a formula its length (formula/search.py)
and the odds that the catalogue lacks something. Held-out logs count as those that were
fitted, with the numbers of these. A name stands if the worlds that have it are likely
enough together. Fewer names without a formula are no world of their own: whether a name
is worth having beside nothing is what the search has judged, in a model of what is left
that is finer than this one.
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

# of the gap, that names must close where something is left: less is as good as nothing
MIN_TOGETHER = 0.2
OUTSIDE = 0.2  # prior, that what is missing is in no catalogue
# why what the search named has no name in the end
INSTEAD = "a formula explains about as much or more for what it costs"


@dataclass
class World:
    """Names, with a formula for what they leave or without."""

    naming: Naming
    discovery: Discovery | None
    price: float  # nats
    residuals: list[np.ndarray]  # of the fitted logs, and of those that were held out
    probability: float = 0.0

    @property
    def names(self) -> frozenset[str]:
        return frozenset(n.effect.id for n in self.naming.named)

    @property
    def text(self) -> str | None:
        """Of the formula."""
        return self.discovery.formula.text if self.discovery and self.discovery.formula else None


class Worlds:
    """All that are compared."""

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
            value += [compute_ln_likelihood(*self._square(w.residuals, c)) for w in self.known]
        weight = np.exp(value - value.max())
        for w, p in zip(self.known, weight / weight.sum(), strict=True):
            w.probability = float(p)

    def with_name(self, effect: str) -> float:
        """Return the probability of the worlds with a name."""
        return sum(w.probability for w in self.known if effect in w.names)

    def best(self) -> World:
        """Return the likeliest world whose names all stand."""
        standing = (w for w in self.known if all(self.with_name(i) >= NAME_AT for i in w.names))
        return max(standing, key=lambda w: w.probability)

    def _compute_residuals(self, last: Fit, values: Mapping[str, float]) -> list[np.ndarray]:
        held = self.held
        return [last.residuals] + ([] if held is None else [held.residuals(drop_log_values(values))])

    def _square(self, residuals: Sequence[np.ndarray], channel: str) -> tuple[float, int]:
        """Return mean square in units of the noise, and the count of values."""
        total, rows = 0.0, 0
        for p, r in zip((p for p in (self.problem, self.held) if p is not None), residuals, strict=True):
            mine = dict(p.used()).get(channel)
            if mine is not None:
                total, rows = total + float(r[mine] @ r[mine]), rows + int(mine.sum())
        return total / max(rows, 1), rows


def compute_ln_odds(probability: float) -> float:
    return float(np.log(probability / (1.0 - probability)))


def compute_name_price(effect: str) -> float:
    """Return the prior cost of a name in nats."""
    return SIZE_COST - next(
        (h.odds for h in make_hypotheses() if h.id == effect), compute_ln_odds(ROAD_PROBABILITY)
    )


def explain_remainder(
    problem: Problem, held: Problem | None, naming: Naming, say: Callable[[str], None]
) -> tuple[Discovery, Naming, list[dict[str, Any]]]:
    """Return a formula or None, the names, and all worlds that were compared.

    The names are those of the likeliest world that are as likely as a name must be.
    """
    if naming.named and naming.closed < MIN_TOGETHER:
        little = f"the names together close less than {100 * MIN_TOGETHER:.0f} % of the gap"
        naming = name.drop_names(problem, naming, frozenset(), little)
    asked = [naming, *([name.drop_names(problem, naming, frozenset(), INSTEAD)] if naming.named else [])]
    fits = [refit_world(problem, n.final) for n in asked]
    worlds = Worlds(problem, held)

    def formula(k: int) -> Discovery:
        beside = ", ".join(m.effect.id for m in asked[k].named)
        return discover_formula(
            problem, fits[k], held, lambda text: say(f"{text}{beside and f', beside {beside}'}")
        )

    sought = run_in_processes(problem.jobs, formula, range(len(asked)))
    worlds.add(naming, fits[0])
    for n, last, found in zip(asked, fits, sought, strict=True):
        if found.formula is not None:
            worlds.add(n, last, found)
    worlds.weigh()
    best = worlds.best()
    shown = [
        {"ids": sorted(w.names), "formula": w.text, "probability": w.probability}
        for w in sorted(worlds.known, key=lambda w: -w.probability)
    ]
    # whether a formula is worth reading beside these names is what its own search has
    # judged, on the held-out logs, too
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
    """Return a formula and the names that it leaves: it may take over what a name did."""
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
    """Fit the same world by least squares, as formulas are fitted."""
    found = fit_parameters(problem.holding(last.values), last.parameters, last.values)
    return replace(found, values=last.values | found.values)
