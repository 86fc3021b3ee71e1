"""What a calibration leaves."""

from dataclasses import dataclass, field

from tse.impl.calibrate.findings import Finding, Group
from tse.impl.core import Config
from tse.impl.identify.fit import Fit
from tse.impl.identify.problem import Problem
from tse.impl.vehicle import Vehicle

LEAST_SECONDS = 20.0  # of all logs together: of fewer the search converges, near its prior, on what happens to fit


@dataclass(frozen=True)
class Proof:
    """A log against the car of its file and as calibrated: rms of measured less simulated without its mean over workflow.SLOW, in
    which are road bank, grade and drift of the sensors; and how much likelier the calibrated car makes it."""

    log: str
    held_out: bool
    before: dict[str, float]
    after: dict[str, float]
    nats_per_second: float


@dataclass
class Result:
    """What a calibration leaves."""

    vehicle: Vehicle
    config: Config
    problem: Problem
    fit: Fit
    findings: list[Finding]
    groups: list[Group]
    proofs: list[Proof]
    sensors: dict[str, float]
    steps: dict[str, float]  # quantisation of each channel as logged; 0: none that shows
    notes: list[str] = field(default_factory=list)
    own: bool = False  # on the logs that are estimated: their rows count once

    @property
    def seconds(self) -> float:
        return sum(log.seconds for log in self.problem.logs)


def words(result: Result) -> list[str]:
    """Return how the search ended, and what it shows."""
    n = len(result.problem.logs)
    logs = f"{n} log{'s' if n > 1 else ''}, {result.seconds / 60:.1f} minutes"
    if result.fit.converged:
        lines = [f"From {logs}: converged after {result.fit.steps} steps."]
    else:
        lines = [
            f"From {logs}: NOT converged after {result.fit.steps} steps (last step {result.fit.moved:.2g} sd); --steps allows more."
        ]
    for held in (False, True):
        mine = [p for p in result.proofs if p.held_out == held]
        if mine:
            parts = []
            for c in mine[0].before:
                before, after = (sum(getattr(p, w).get(c, 0.0) ** 2 for p in mine) ** 0.5 for w in ("before", "after"))
                parts.append(f"{c} {100 * (after / max(before, 1e-12) - 1):+.0f} %")
            likelier = sum(p.nats_per_second for p in mine) / len(mine)
            title = "held-out" if held else "fitted"
            lines.append(f"Residuals of {title} logs, rms, slow parts left out: {', '.join(parts)}; {likelier:+.1f} nat a second.")
    if result.seconds < LEAST_SECONDS:
        lines.append(
            f"Not to be relied on: {result.seconds:.0f} s can be compared with a simulation, {LEAST_SECONDS:g} s are needed."
        )
    hidden = [f.name for f in result.findings if not f.shown]
    if hidden:
        lines.append(f"Not shown by these logs: {', '.join(hidden)}.")
    return lines
