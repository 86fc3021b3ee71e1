"""The answer in three aligned lines: what each stiffness is, and whether to act on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tse.impl.regimes import percent
from tse.impl.verdict import CONTRADICTED, Finding, Verdict

WHERE = {"cy_front": "front, in bends", "cy_rear": "rear, in bends", "cx_front": "front, along"}  # in this order
LITTLE = {
    "cy_front": "too few bends in this log",
    "cy_rear": "too few bends in this log",
    "cx_front": "too little acceleration in this log",
}
WHY_NOT = {
    "starting": "too little was seen since the start",
    "sensor fault": "a sensor was at fault",
    "held": "the car stood, crept, reversed or slid",
    "input invalid": "inputs or measurements are missing",
    "parameters uncertain": "the car is not known well enough (tselab calibrate)",
    "does not fit": "the sensors read what the model does not explain (tselab gap)",
    "implausible": "the channels contradict each other",
    "row refused": "the rows were refused",
    CONTRADICTED: "the channels contradict each other",
}
MOST_STRETCHES = 3  # of a road that changed: the last ones


def answer(found: Sequence[Finding]) -> list[str]:
    """Return three lines for each of the last stretches of road, under its title where there are several.

    The value is what held through the stretch (smoothed), where that is known."""
    lines = []
    left_out = len(found) - MOST_STRETCHES
    if left_out > 0:
        lines.append(f"{left_out} earlier stretch{'es' if left_out > 1 else ''} of road: --verbose, or the report")
    for finding in found[-MOST_STRETCHES:]:
        if finding.title:
            lines.append(f"{finding.title}:")
        of_key = {v.key: v for v in finding.verdicts}
        rows = [_cells(of_key[key]) for key in WHERE if key in of_key]
        widths = [max(len(row[i]) for row in rows) for i in range(2)]
        indent = "  " if finding.title else ""
        lines += [f"{indent}{a:<{widths[0]}}   {b:<{widths[1]}}   {c}" for a, b, c in rows]
    return lines


def _cells(v: Verdict) -> tuple[str, str, str]:
    """Return which stiffness, its value with its 95 % interval, and whether to act on it."""
    value, band = (v.smoothed, v.smoothed_band) if np.isfinite(v.smoothed) else (v.value, v.band)
    if not np.isfinite(value):
        return WHERE[v.key], "-", f"not usable: {why_not(v.key, v.reason)}"
    number = f"{value:4.0f} ± {max(band, 0.5):.0f} {v.unit}"
    if v.level == "none":
        return WHERE[v.key], number, f"not usable: {why_not(v.key, v.reason)}"
    return WHERE[v.key], number, f"usable, valid {percent(v.valid)} of the time"


def why_not(key: str, reason: str) -> str:
    """Return in a few words why a stiffness is not usable."""
    return WHY_NOT.get(reason, LITTLE[key] if reason in ("", "uncertain", "not excited") else reason)
