"""One run of the estimator over one log: what the command `tselab estimate` does, and `tselab fleet` with each of many."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from tse.impl import regimes
from tse.impl.estimate import Estimate, estimate_to
from tse.impl.learnt import Learnt
from tse.impl.prepare import Prepared
from tse.impl.regimes import Change
from tse.impl.verdict import Finding, findings, implausible, of_uncertainty, remarks


@dataclass
class Run:
    """A run, and what it found. `notes` are those of the preparation, too; `reported`: the report is written."""

    estimate: Estimate
    changes: list[Change]
    findings: list[Finding]
    notes: list[str]
    reported: bool


def run(
    prepared: Prepared, out: Path | None, report: Path | None, learnt: Learnt | None = None, progress: bool = False
) -> Run:
    """Estimate, and write what is asked for: the estimates to `out`, the report."""

    def once() -> tuple[Estimate, Any]:
        drawn = None
        if report is not None:
            from tse.impl.plots import Data

            drawn = Data(prepared.log)
        watch = [drawn.add] if drawn else []
        contradicted = bool(prepared.warnings)
        return estimate_to(out, prepared.log, prepared.config, progress, learnt, watch, contradicted), drawn

    est, drawn = once()
    if contradicts(prepared, est.table):
        est, drawn = once()
    notes = notes_of(prepared, est)
    if report is not None and len(est):
        from tse.impl.report import write_report

        write_report(report, est, prepared.log, prepared.vehicle, prepared.config, notes, drawn, prepared.warnings)
    changes = regimes.changes(est.table)
    found = findings(est.table, prepared.config, changes, prepared.warnings, est.uncertainty_sd)
    return Run(est, changes, found, notes, report is not None and len(est) > 0)


def contradicts(prepared: Prepared, table: pd.DataFrame) -> bool:
    """Return whether the rows speak against a log of which the preparation had nothing to say; it is among the warnings then."""
    said = "" if prepared.warnings else implausible(table)
    if said:
        prepared.warnings.append(said)
        prepared.notes.insert(0, said)
    return bool(said)


def notes_of(prepared: Prepared, est: Estimate) -> list[str]:
    """Return what is to be said of a run: of its preparation, of rows that were refused, of the estimates."""
    notes = list(prepared.notes)
    refused = sum(rows for status, rows in est.statuses.items() if status < 0)
    if refused:
        notes.append(f"{refused} rows were refused by the library; their estimates are empty, the status says why")
    return [*notes, *remarks(est.table), *of_uncertainty(est.table, prepared.config, est.uncertainty_sd)]
