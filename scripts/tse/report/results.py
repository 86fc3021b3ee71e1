"""Convert the results of a run for other programs: to rows of a table, to a JSON
document, and to an exit code."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import pandas as pd

from tse.car.config import filter_text
from tse.car.vehicle import Vehicle, list_latency_settings
from tse.estimation import regimes
from tse.estimation.estimate import Estimates
from tse.estimation.verdict import Finding, Quantity, Verdict
from tse.library import __version__
from tse.library.core import Config, library
from tse.library.files import is_parquet, write_atomically
from tse.log.rows import CheckedLog

Usable: TypeAlias = Literal["yes", "in part", "no"]
USABLE, IN_PART, NOTHING = 0, 3, 4  # exit codes; code 2 is used for bad input
CODES: dict[int, Usable] = {USABLE: "yes", IN_PART: "in part", NOTHING: "no"}  # exit code -> column "usable"
LEVELS = {"good": "yes", "partly": "in part", "none": "no"}  # level of a verdict -> column "usable"
KILO = 1000.0  # factor from the units of class Verdict (kN, kN/rad) to N, N/rad
# Column of the table of results -> pandas type. The table has a row for each stiffness on
# each stretch of road. A stretch of road is the part of a drive from one detected change
# of the stiffness to the next.
ESTIMATE_COLUMNS: dict[str, str] = {
    "log": "string",
    "stretch": "Int64",
    "start": "Float64",
    "end": "Float64",
    "stiffness": "string",
    "value": "Float64",
    "sd": "Float64",
    "low": "Float64",
    "high": "Float64",
    "smoothed": "Float64",
    "smoothed_sd": "Float64",
    "smoothed_low": "Float64",
    "smoothed_high": "Float64",
    "smoothed_reason": "string",
    "spread": "Float64",
    "nominal": "Float64",
    "valid": "Float64",
    "usable": "string",
    "reason": "string",
    "change": "string",
    "change_probability": "Float64",
    "ratio": "Float64",
    "ratio_sd": "Float64",
    "warnings": "string",
    "text": "string",
}


def choose_exit_code(found: Sequence[Finding]) -> int:
    """Return the exit code that states how far the stiffnesses of a run are usable.

    Verdict.level is good, partly or none. Return USABLE if every stiffness has the level
    "good" on at least one stretch of road, NOTHING if every stiffness has the level
    "none" on all stretches, otherwise IN_PART."""
    best: dict[str, str] = {}
    for v in (v for f in found for v in f.verdicts):
        best[v.key] = min(best.get(v.key, v.level), v.level, key=list(LEVELS).index)
    levels = set(best.values()) or {"none"}
    return USABLE if levels == {"good"} else NOTHING if levels == {"none"} else IN_PART


def make_rows(
    log: Path,
    est: Estimates,
    found: Sequence[Finding],
    changes: Sequence[regimes.Change],
    warnings: Sequence[str],
) -> list[dict[str, Any]]:
    """Return the rows of the table of results. Each row is a dict with the keys of
    ESTIMATE_COLUMNS. A detected change of the stiffness, e.g. on a different road
    surface, is reported in the rows of the stretch that begins with the change."""
    time = regimes.estimate_times(est.table)
    whole = (float(time[0]), float(time[-1])) if len(time) else (np.nan, np.nan)
    table = []
    for number, f in enumerate(found, 1):
        start, end = (f.stretch.start, f.stretch.end) if f.stretch else whole
        began = next((c for c in changes if number > 1 and abs(c.time - start) < 1e-9), None)
        for v in f.verdicts:
            ratio, sd = began.ratio.get(v.key, (np.nan, np.nan)) if began else (np.nan, np.nan)
            table.append(
                {
                    "log": str(log),
                    "stretch": number,
                    "start": start,
                    "end": end,
                    **_convert_verdict(v),
                    "change": began.what if began else None,
                    "change_probability": began.probability if began else np.nan,
                    "ratio": ratio,
                    "ratio_sd": sd,
                    "warnings": "\n".join(warnings) or None,
                    "text": v.text,
                }
            )
    return table


def _convert_verdict(v: Verdict) -> dict[str, Any]:
    """Return the verdict on one stiffness as entries of a row of the table of results
    (ESTIMATE_COLUMNS), with the stiffness in N or N/rad. The spread is relative to the
    stiffness."""
    return {
        "stiffness": v.key,
        "value": KILO * v.value,
        "sd": KILO * v.band / 1.96,
        "low": KILO * v.low,
        "high": KILO * v.high,
        "smoothed": KILO * v.smoothed,
        "smoothed_sd": KILO * v.smoothed_band / 1.96,
        "smoothed_low": KILO * (v.smoothed - v.smoothed_band),
        "smoothed_high": KILO * (v.smoothed + v.smoothed_band),
        "smoothed_reason": v.smoothed_reason or None,
        "spread": v.spread,
        "nominal": KILO * v.nominal,
        "valid": v.valid,
        "usable": LEVELS[v.level],
        "reason": (v.reason or None) if v.level != "good" else None,  # a usable stiffness needs no reason
    }


def _convert_quantity(q: Quantity) -> dict[str, Any]:
    """Return the verdict on grip or sideslip as entries of the JSON document."""
    return {
        "value": q.value,
        "sd": q.band / 1.96,
        "low": q.value - q.band,
        "high": q.value + q.band,
        "unit": q.unit,
        "time": q.time,
        "valid": q.valid,
        "reason": q.reason or None,
        "text": q.line(),
    }


def make_document(
    log: Path, est: Estimates, found: Sequence[Finding], config: Config, said: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the results of a run as a dict for JSON. `said` has further entries of the
    dict, such as vehicle, notes and files."""
    changes, spells = regimes.find_changes(est.table), regimes.find_spells(est.table)
    time = est.table["time"]
    keys, per = ("stretch", "start", "end"), len(found[0].verdicts)
    table = [
        {k: x for k, x in r.items() if k not in ("log", "warnings")}
        for r in make_rows(log, est, found, changes, ())
    ]
    return {
        "tselab": __version__,
        "library": library().version,
        "log": str(log),
        **said,
        "rows": len(est),
        "seconds": float(time.iloc[-1] - time.iloc[0]) if len(est) else 0.0,
        "usable": CODES[choose_exit_code(found)],
        "exit_code": choose_exit_code(found),
        "settings": dict(config.changed()),
        "stretches": [
            {
                **{k: part[0][k] for k in keys},
                "stiffness": {r["stiffness"]: _drop_keys(r, (*keys, "stiffness")) for r in part},
                **{q.key: _convert_quantity(q) for q in f.others},
            }
            for f, part in zip(found, (table[i : i + per] for i in range(0, len(table), per)), strict=True)
        ],
        "changes": [vars(c) | {"what": c.what} for c in changes],
        "spells": [vars(s) for s in spells],
    }


def _drop_keys(row: Mapping[str, Any], keys: Sequence[str]) -> dict[str, Any]:
    """Return a copy of `row` without the entries named in `keys`."""
    return {k: x for k, x in row.items() if k not in keys}


def convert_to_plain(x: Any) -> Any:
    """Return data converted to types that JSON has. NaN and infinity are converted to
    None, and paths to strings."""
    if isinstance(x, Mapping):
        return {str(k): convert_to_plain(v) for k, v in x.items()}
    if isinstance(x, (list, tuple, set)):
        return [convert_to_plain(v) for v in x]
    if isinstance(x, np.generic):
        return convert_to_plain(x.item())
    if isinstance(x, float):
        return x if np.isfinite(x) else None
    return str(x) if isinstance(x, Path) else x


# ---- tables


def make_frame(table: Sequence[Mapping[str, Any]], columns: Mapping[str, str]) -> pd.DataFrame:
    """Return rows as a data frame. `columns` has the names of the columns and their
    types, in their order."""
    return pd.DataFrame([convert_to_plain(r) for r in table], columns=list(columns)).astype(dict(columns))


def write_rows(
    path: Path, table: Sequence[Mapping[str, Any]], columns: Mapping[str, str] | None = None
) -> None:
    """Write rows as Parquet or CSV, depending on the ending of the file name.

    `columns` has the names and types of the columns, in their order. None: pandas chooses
    names and types from the rows."""
    frame = make_frame(table, columns) if columns else pd.DataFrame([convert_to_plain(r) for r in table])
    with write_atomically(path, "wb") as file:
        if is_parquet(path):
            frame.to_parquet(file, index=False)
        else:
            file.write(frame.to_csv(index=False, lineterminator="\n").encode())


# ---- facts of a run, for the terminal and the report


def list_run_facts(
    est: Estimates, log: CheckedLog, vehicle: Vehicle, config: Config, stride: int = 1
) -> list[tuple[str, str]]:
    """Return the facts of a run as (name, value): log, vehicle, filter, latencies ...

    `stride` is plots.Data.stride. If it is above 1, the plots do not show all rows, and a
    fact states that they show the min and max of every `stride` rows."""
    span = float(est.table["time"].iloc[-1] - est.table["time"].iloc[0]) if len(est) else 0.0
    every = f", every {log.sample_time * 1000:.4g} ms" if log.sample_time else ""
    every += f" (means of {log.averaged} rows)" if log.averaged > 1 else ""
    facts = [
        ("Log", f"{log.path.name}: {len(log)} rows, {span:.1f} s{every}"),
        ("Vehicle", f"{vehicle.name}" + (f" ({vehicle.path.name})" if vehicle.path else "")),
        ("Filter", filter_text(config)),
    ]
    late = {
        channel: 1000 * getattr(config, name)
        for channel, name in list_latency_settings().items()
        if getattr(config, name)
    }
    if late:
        said = ", ".join(f"{channel} {ms:.3g} ms" for channel, ms in late.items())
        age = 1000 * float(est.table["estimate_age"].min()) if len(est) else 0.0
        facts.append(("Latency", f"{said} behind yaw_rate; estimates refer to {age:.3g} ms before their row"))
    if est.interrupted:
        facts.append(("Stopped", f"by Ctrl-C after {len(est)} of {len(log)} rows"))
    recovered = est.statuses.get(library().status("TSE_W_RECOVERED"), 0)
    if recovered:
        facts.append(("Recoveries", f"{recovered} (the filter discarded its estimates and started again)"))
    if stride > 1:
        facts.append(("Plots", f"min and max of every {stride} rows"))
    return facts
