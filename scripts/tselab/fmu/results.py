"""What README states of validators and clients. Without dates and timings: a run that finds the same changes nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from tse.impl.estimate import write_table
from tse.impl.files import atomic
from tse.impl.tables import markdown_table
from tselab.fmu.clients import Row
from tselab.fmu.validate import Verdict


def write(folder: Path, verdicts: Mapping[str, Sequence[Verdict]], rows: Sequence[Row]) -> list[Path]:
    """Write the tables; what was skipped is not in them."""
    written = [folder / "fmu_validators.md"]
    with atomic(written[0]) as file:
        file.write(validators(verdicts))
    ran = [r for r in rows if not r.skipped]
    if ran:
        written += [folder / "fmu_clients.csv", folder / "fmu_clients.md"]
        table = [
            {"fmu": r.fmu, "client": r.client, "version": r.version, "run": r.run, "difference": r.text} for r in ran
        ]
        write_table(pd.DataFrame(table), written[1])
        with atomic(written[2]) as file:
            file.write(clients(ran))
    return written


def validators(verdicts: Mapping[str, Sequence[Verdict]]) -> str:
    """Findings per validator and FMU."""
    names = list(verdicts)
    rows = []
    ran = {n: {v.validator: v for v in verdicts[n] if not v.skipped} for n in names}
    for validator, version in {v.validator: v.version for found in ran.values() for v in found.values()}.items():
        counts = [str(len(ran[n][validator].findings)) if validator in ran[n] else "-" for n in names]
        rows.append([validator, version, *counts])
    return "\n".join(markdown_table(["validator", "version", *(f"{n}: findings" for n in names)], rows, 2)) + "\n"


def clients(rows: Sequence[Row]) -> str:
    """Largest difference to FMPy per client and FMU."""
    runs = {r.fmu: r.run for r in rows}
    table = []
    for client, version in dict.fromkeys((r.client, r.version) for r in rows):
        cells = [next((r.text for r in rows if (r.client, r.fmu) == (client, n)), "-") for n in runs]
        table.append([client, version, *cells])
    head = ["client", "version", *(f"{name}, {run}" for name, run in runs.items())]
    return "\n".join(markdown_table(head, table, len(head))) + "\n"
