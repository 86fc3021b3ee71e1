"""What a calibration leaves."""

from __future__ import annotations

from dataclasses import dataclass, field

from tselab.calibrate.findings import Finding, Group
from tselab.core import Config
from tselab.identify.fit import Fit
from tselab.identify.problem import Problem
from tselab.vehicle import Vehicle


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
