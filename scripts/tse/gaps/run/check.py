"""`tselab gap check`: compute which effects would be visible in the logs. An effect is
visible if `tselab gap` would report it as missing. The effects are not fitted. Their
influence is computed from partial derivatives of the residuals (infer/detect.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tse.car.vehicle import read_vehicle
from tse.gaps.catalogue import load_catalogue
from tse.gaps.fit import compute_gap, fit_parameters
from tse.gaps.infer import detect
from tse.gaps.infer.hypotheses import compute_threshold
from tse.gaps.problem import STIFFNESS_PARAMETERS, Problem
from tse.gaps.run import workflow
from tse.identify.data import prepare_all
from tse.library.errors import UserError
from tse.log.rows import Reading
from tse.report.results import CODES, IN_PART, NOTHING, USABLE
from tse.report.tables import text_table


@dataclass(frozen=True)
class Check:
    """Result of `tselab gap check`."""

    effects: list[detect.Detectable]
    gap: dict[str, float]  # channel -> residual rms / sensor noise, with fitted stiffness
    notes: list[str]

    @property
    def code(self) -> int:
        """Exit code: NOTHING if no effect would be visible at its typical size, USABLE if
        every effect would be, otherwise IN_PART. Effects with the occurrence ABSORBED are
        not required for USABLE: `tselab gap` does not search for them, because an
        estimated stiffness or road angle compensates for nearly all of their influence.
        """
        if not any(d.visible for d in self.effects):
            return NOTHING
        searched = [d for d in self.effects if load_catalogue()[d.id].occurrence != "ABSORBED"]
        return USABLE if all(d.visible for d in searched) else IN_PART

    def as_json(self) -> dict[str, Any]:
        """Return the result as a dict for JSON, for programs."""
        return {
            "effects": [asdict(d) | {"visible": d.visible} for d in self.effects],
            "gap": self.gap,
            "usable": CODES[self.code],
            "notes": self.notes,
        }

    def text(self) -> str:
        """Return the result as a table and sentences, for the terminal."""
        order = sorted(self.effects, key=lambda d: (not d.visible, d.smallest / d.typical))
        rows = [["effect", "parameter", "smallest visible", "typical", "visible", "absorbed by stiffness"]]
        for d in order:
            unit = "" if d.unit == "1" else f" {d.unit}"
            smallest = f"{d.smallest:.2g}{unit}" if np.isfinite(d.smallest) else "never"
            rows.append(
                [
                    d.id,
                    d.parameter.removeprefix(d.id + "_"),
                    smallest,
                    f"{d.typical:.2g}{unit}",
                    "yes" if d.visible else "no",
                    f"{100 * max(0.0, d.absorbed):.0f} %",
                ]
            )
        lines = [text_table(rows, right=(2, 3, 5)), ""]
        seen = sum(d.visible for d in order)
        lines.append(
            f"{seen} of {len(order)} effects would be named at their typical size "
            f"(evidence of at least {compute_threshold(len(order)):.1f} nats)."
        )
        if hidden := [d for d in order if not d.visible]:
            lines.append("The other effects would be visible in these channels:")
            lines += [f"  {d.id}: {load_catalogue()[d.id].channels}" for d in hidden]
        parts = ", ".join(f"{c} {x:.2f}" for c, x in self.gap.items())
        lines.append(
            f"Gap with fitted stiffness, ratio of residual to sensor noise: {parts}; 1 is noise alone."
        )
        return "\n".join(lines + [f"note: {n}" for n in self.notes])


def check_model(
    logs: Sequence[Path],
    vehicle_path: Path,
    jobs: int = 1,
    say: Callable[[str], None] = lambda _: None,
    reading: Reading | None = None,
) -> Check:
    """Fit stiffness and biases to the logs, and compute for every effect the smallest
    size at which it would be visible (infer/detect.py). `say` is called with the name of
    each step.
    """
    say("reading the logs")
    notes: list[str] = []
    read, config = workflow.read_logs(logs, read_vehicle(vehicle_path), reading, notes)
    problem = Problem(prepare_all(read, config), config, jobs)
    notes += problem.notes
    if not problem.logs:
        raise UserError("; ".join(notes) or "no log can be compared")
    say("fitting stiffness and sensor biases")
    baseline = fit_parameters(problem, STIFFNESS_PARAMETERS, {})
    say("computing the smallest visible size of every effect")
    found = detect.compute_detectable(problem, baseline, list(load_catalogue().values()))
    return Check(
        found, compute_gap(problem, baseline.residuals), [*(n for log in read for n in log.notes), *notes]
    )
