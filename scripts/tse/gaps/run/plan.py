"""`tselab gap plan`: find the manoeuvre that best separates two effects A and B.

A car that has effect A at its typical size is simulated in each manoeuvre. Effect B and
the stiffness are fitted to this simulation. The remaining residuals, in units of the
sensor noise, determine the evidence in nats with which such a drive separates A from B
(compute_expected_nats()). The same is done with A and B exchanged, and the smaller
evidence counts.
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
from tse.gaps.infer.detect import ROAD_WAVELENGTH
from tse.gaps.problem import STIFFNESS_PARAMETERS, Problem
from tse.identify.knots import KNOT_DISTANCE, PROFILES
from tse.library.core import Config
from tse.library.errors import UserError, suggest_names
from tse.report.tables import text_table

NEED = 8.0  # [nat] min evidence with which two effects count as separated
# Min Option.share with which `tselab gap` can exclude one of the two effects. With a
# smaller share, model errors of a real car hide the difference between the effects.
RIVAL_SHARE = 0.1
# [nat] A manoeuvre excites an effect if the evidence for a car with this effect, against
# a car without it, is at least this value.
MIN_EXCITED_NATS = 0.1
# Relative change of the sum of squares below which a fit ends. The simulated logs have
# almost no noise, so the sum of squares at the minimum measures how different the two
# effects are. A fit that ended early would overestimate it.
FIT_TOLERANCE = 1e-6
MAX_PLAN_EVALUATIONS = 30  # max number of evaluations of the residuals in a fit
# Ratio of Option.nats to Option.shows below which nats is set to 0: so small an evidence
# comes from the step size of the integration, not from the effects.
SAME = 0.02
MAX_NEEDED = 3600.0  # [s] max length of a drive; effects that need a longer one are not separable


@dataclass(frozen=True)
class Option:
    """One manoeuvre, and the evidence with which it separates the effects A and B."""

    name: str
    seconds: float  # [s] length of the manoeuvre
    # [nat] Evidence for A against B if the car has A, or for B against A if it has B: the
    # smaller of the two.
    nats: float
    # [nat] Evidence for A if the car has A, or for B if the car has B, against a car with
    # neither and with fitted stiffness: the smaller of the two.
    shows: float
    # Evidence against the other effect / evidence against a car with neither. It is
    # computed for a car with A and for a car with B: the smaller of the two.
    share: float

    @property
    def needed(self) -> float:
        """[s] Time for which the manoeuvre must be driven to give NEED nats."""
        return NEED * self.seconds / self.nats if self.nats > 0 else float("inf")


@dataclass(frozen=True)
class ManeuverPlan:
    """Manoeuvres that may separate two effects, the best one first."""

    first: str
    second: str
    options: list[Option]

    @property
    def separable(self) -> bool:
        return bool(self.options) and self.options[0].needed <= MAX_NEEDED

    def text(self, top: int) -> str:
        """Return the plan as a sentence and a table of the `top` best manoeuvres."""
        pair = f"{self.first} and {self.second}"
        if not self.separable:
            shown = [o for o in self.options if o.shows >= NEED]
            why = (
                "each effect is visible, but the other effect explains the same residual"
                if shown
                else "there is no manoeuvre in which both effects are visible"
            )
            return f"{pair} cannot be separated by any of the {len(self.options)} manoeuvres: {why}."
        rows = [
            [
                "manoeuvre",
                f"nats in {self.options[0].seconds:.0f} s",
                f"s for {NEED:g} nats",
                "share that separates",
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
            f"To separate {pair}, drive: {best.name}, {long}. An evidence of {NEED:g} nats is enough.",
            "",
            text_table(rows, right=(1, 2, 3)),
        ]
        if best.share < RIVAL_SHARE:
            lines.append(
                f"The evidence that separates the effects is only {100 * best.share:.0f} % of the evidence "
                f"for one of them. 'tselab gap' needs {100 * RIVAL_SHARE:.0f} % to exclude one of them, "
                "because model errors of a real car hide smaller differences."
            )
        return "\n".join(lines)


def make_plan(
    separate: str, vehicle_path: Path, jobs: int = 1, say: Callable[[str], None] = lambda _: None
) -> ManeuverPlan:
    """Return the plan that separates two effects. `separate` is the option of the command
    line, "A,B" with the ids of the effects. All manoeuvres of make_candidates() are
    compared.
    """
    first, second = read_pair(separate)
    config = Config.exact(read_vehicle(vehicle_path).values)
    candidates = make_candidates(config)

    def judge_candidate(candidate: Candidate) -> Option:
        say(candidate.name)
        return compute_worth(candidate, config, first, second)

    with ThreadPoolExecutor(max(1, jobs)) as pool:
        options = list(pool.map(judge_candidate, candidates))
    return ManeuverPlan(first.id, second.id, sorted(options, key=lambda o: (-o.nats / o.seconds, o.name)))


def read_pair(separate: str) -> tuple[Effect, Effect]:
    """Return the two effects that the option --separate names."""
    known = load_catalogue()
    ids = [x.strip() for x in separate.split(",") if x.strip()]
    for i in ids:
        if i not in known:
            raise UserError(f"option --separate: there is no effect '{i}'{suggest_names(i, known)}")
    if len(ids) != 2 or ids[0] == ids[1]:
        raise UserError(
            f"option --separate: {separate!r} is not two effects; write the ids of two different "
            "effects, for instance relaxation,steering_lag"
        )
    return known[ids[0]], known[ids[1]]


def compute_worth(candidate: Candidate, config: Config, first: Effect, second: Effect) -> Option:
    """Return the evidence that a manoeuvre gives (see Option).

    Each of the two effects is simulated in turn. Two kinds of evidence are computed for
    it: against a fit of the other effect, and against a fit of the stiffness alone. Of
    each kind, the smaller value of the two simulated effects is returned.
    """
    problem = Problem(prepare_candidate(candidate, config), config)
    both, shows, shares = [], [], []
    for hidden, other in ((first, second), (second, first)):
        problem.measure(make_typical_values(problem, hidden))
        # If the manoeuvre does not excite the effect, nothing is fitted.
        if compute_expected_nats(problem, problem.compute_residuals({})) < MIN_EXCITED_NATS:
            shows.append(0.0)
            both.append(0.0)
            continue
        plain = fit_parameters(problem, STIFFNESS_PARAMETERS, {}, tolerance=FIT_TOLERANCE)
        shows.append(compute_expected_nats(problem, plain.residuals))
        shapes = [replace(p, low=p.typical_low, high=p.typical_high) for p in other.shapes]
        parameters = [*STIFFNESS_PARAMETERS, *problem.strengths(other), *shapes]
        with_it = fit_parameters(
            problem,
            parameters,
            plain.values | make_typical_values(problem, other),
            MAX_PLAN_EVALUATIONS,
            FIT_TOLERANCE,
        )
        left = min(compute_expected_nats(problem, with_it.residuals), shows[-1])
        both.append(left if left > SAME * shows[-1] else 0.0)
        shares.append(both[-1] / max(shows[-1], 1e-9))
    return Option(candidate.name, candidate.seconds, min(both), min(shows), min(shares, default=0.0))


def compute_expected_nats(problem: Problem, residuals: np.ndarray) -> float:
    """Return the expected evidence [nat] for the true model against a different model.

    `residuals` are those of the different model on a log that the true model has
    simulated with almost no noise, in units of the sd of the sensor noise.
    """
    total = 0.0
    for c in np.unique(problem.rows.channel):
        mine = problem.rows.channel == c
        n = int(mine.sum())
        total += 0.5 * n * np.log1p(float(residuals[mine] @ residuals[mine]) / n)
    return total


def make_typical_values(problem: Problem, e: Effect) -> dict[Key, float]:
    """Return the parameter values of an effect of typical size. A road profile is a sine
    with the wavelength ROAD_WAVELENGTH.
    """
    if e.id in PROFILES:
        p = e.strengths[0]
        amplitude = np.sqrt(2.0) * p.scale
        return {
            k.name: amplitude * float(np.sin(2 * np.pi * k.name.knot * KNOT_DISTANCE / ROAD_WAVELENGTH))
            for k in problem.strengths(e)
        }
    values = {p.name: p.default for p in e.shapes}
    return values | {
        p.name: float(np.clip(p.default + (p.sign or 1) * p.scale, p.low, p.high)) for p in e.strengths
    }
