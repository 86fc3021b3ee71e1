"""`tselab gap plan`: the manoeuvre that tells two effects apart.

A car that has A at typical size drives each manoeuvre; B is fitted to it together with
the stiffness. What B cannot copy is worth nats at the noise of the sensors; the worse of
the two directions counts.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tse.car.vehicle import read_vehicle
from tse.gaps.catalogue import Effect, Key, load_catalogue
from tse.gaps.drives import Candidate, make_candidates, prepare_candidate
from tse.gaps.fit import fit_parameters
from tse.gaps.infer.detect import WAVE
from tse.gaps.problem import STIFFNESS, Problem
from tse.identify.knots import KNOT_DISTANCE, PROFILES
from tse.library.core import Config
from tse.library.errors import UserError, suggest_names
from tse.report.tables import text_table

NEED = 8.0  # nats: by which two effects are separable
# of the nats by which an effect shows: the forms of a real car are not known better
RIVAL_SHARE = 0.1
NOTHING = 0.1  # nats: by which an effect shows: less is not excited
# relative change of the sum of squares at which a fit ends: without noise it is the whole
# difference
EXACT = 1e-6
MAX_STEPS = 30  # of a fit
SAME = (
    # of the nats by which an effect shows: less is the integration's steps, and no model
    # is that good
    0.02
)
MAX_NEEDED = 3600.0  # s: what takes longer cannot be separated by driving


@dataclass(frozen=True)
class Option:
    """One manoeuvre and what it is worth."""

    name: str
    seconds: float
    nats: float  # of the worse direction
    shows: float  # nats by which the weaker of the two shows at all
    # of the nats by which an effect shows, those that the other one cannot take over
    share: float

    @property
    def needed(self) -> float:
        """How long it must be driven."""
        return NEED * self.seconds / self.nats if self.nats > 0 else float("inf")


@dataclass(frozen=True)
class ManeuverPlan:
    """All manoeuvres, best first."""

    first: str
    second: str
    options: list[Option]

    @property
    def separable(self) -> bool:
        return bool(self.options) and self.options[0].needed <= MAX_NEEDED

    def text(self, top: int) -> str:
        """Return the plan for people."""
        pair = f"{self.first} and {self.second}"
        if not self.separable:
            shown = [o for o in self.options if o.shows >= NEED]
            why = (
                "each shows, but the other one can always stand in for it"
                if shown
                else "no manoeuvre shows both"
            )
            return f"{pair} cannot be separated by any of the {len(self.options)} manoeuvres: {why}."
        rows = [
            [
                "manoeuvre",
                f"nats in {self.options[0].seconds:.0f} s",
                f"s for {NEED:g} nats",
                "of the evidence",
            ]
        ]
        for o in self.options[:top]:
            long = f"{o.needed:.0f}" if o.needed <= MAX_NEEDED else "over an hour"
            needed = "one run" if o.needed <= o.seconds else long
            rows.append([o.name, f"{o.nats:.1f}", needed, f"{100 * o.share:.0f} %"])
        best = self.options[0]
        once = best.needed <= best.seconds
        times = np.ceil(best.needed / best.seconds)
        long = f"once ({best.seconds:.0f} s)" if once else f"for {best.needed:.0f} s, {times:.0f} times"
        lines = [
            f"To tell {pair} apart, drive: {best.name}, {long}. {NEED:g} nats are enough.",
            "",
            text_table(rows, right=(1, 2, 3)),
        ]
        if best.share < RIVAL_SHARE:
            lines.append(
                f"The difference is only {100 * best.share:.0f} % of what either of them shows; "
                "'tselab gap' asks for "
                f"{100 * RIVAL_SHARE:.0f} %, because the forms of a real car are not known better: "
                "it will not exclude either."
            )
        return "\n".join(lines)


def make_plan(
    separate: str, vehicle_path: Path, jobs: int = 1, say: Callable[[str], None] = lambda _: None
) -> ManeuverPlan:
    """Return every manoeuvre of the library for two effects, "A,B"."""
    first, second = read_pair(separate)
    config = Config.exact(read_vehicle(vehicle_path).values)
    candidates = make_candidates(config)

    def one(candidate: Candidate) -> Option:
        say(candidate.name)
        return compute_worth(candidate, config, first, second)

    with ThreadPoolExecutor(max(1, jobs)) as pool:
        options = [o for o in pool.map(one, candidates) if o is not None]
    return ManeuverPlan(first.id, second.id, sorted(options, key=lambda o: (-o.nats / o.seconds, o.name)))


def read_pair(separate: str) -> tuple[Effect, Effect]:
    known = load_catalogue()
    ids = [x.strip() for x in separate.split(",") if x.strip()]
    for i in ids:
        if i not in known:
            raise UserError(f"option --separate: there is no effect '{i}'{suggest_names(i, known)}")
    if len(ids) != 2 or ids[0] == ids[1]:
        raise UserError(
            f"option --separate: {separate!r} is not two effects, for instance relaxation,steering_lag"
        )
    return known[ids[0]], known[ids[1]]


def compute_worth(candidate: Candidate, config: Config, first: Effect, second: Effect) -> Option:
    """Return nats of the worse direction, and of the weaker effect against stiffness
    alone.
    """
    problem = Problem(prepare_candidate(candidate, config), config)
    both, shows, shares = [], [], []
    for hidden, other in ((first, second), (second, first)):
        problem.measure(make_typical_values(problem, hidden))
        if (
            compute_expected_nats(problem, problem.residuals({})) < NOTHING
        ):  # nothing to fit: it is not excited
            shows.append(0.0)
            both.append(0.0)
            continue
        plain = fit_parameters(problem, STIFFNESS, {}, tolerance=EXACT)
        shows.append(compute_expected_nats(problem, plain.residuals))
        shapes = [replace(p, low=p.typical_low, high=p.typical_high) for p in other.shapes]
        parameters = [*STIFFNESS, *problem.strengths(other), *shapes]
        with_it = fit_parameters(
            problem, parameters, plain.values | make_typical_values(problem, other), MAX_STEPS, EXACT
        )
        left = min(compute_expected_nats(problem, with_it.residuals), shows[-1])
        both.append(left if left > SAME * shows[-1] else 0.0)
        shares.append(both[-1] / max(shows[-1], 1e-9))
    return Option(candidate.name, candidate.seconds, min(both), min(shows), min(shares, default=0.0))


def compute_expected_nats(problem: Problem, residuals: np.ndarray) -> float:
    """Return the expected evidence for the true model, in nats.

    The other model leaves this residual of a log without noise.
    """
    total = 0.0
    for c in np.unique(problem.rows.channel):
        mine = problem.rows.channel == c
        n = int(mine.sum())
        total += 0.5 * n * np.log1p(float(residuals[mine] @ residuals[mine]) / n)
    return total


def make_typical_values(problem: Problem, e: Effect) -> dict[Key, float]:
    """Return an effect at its typical size. A road goes up and down every WAVE metres."""
    if e.id in PROFILES:
        p = e.strengths[0]
        amplitude = np.sqrt(2.0) * p.scale
        return {
            k.name: amplitude * float(np.sin(2 * np.pi * k.name.knot * KNOT_DISTANCE / WAVE))
            for k in problem.strengths(e)
        }
    values = {p.name: p.default for p in e.shapes}
    return values | {
        p.name: float(np.clip(p.default + (p.sign or 1) * p.scale, p.low, p.high)) for p in e.strengths
    }
