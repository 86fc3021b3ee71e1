"""Describe the result of a run by three aligned lines for each stretch of road.

Each line has a stiffness, its 95 % interval, and whether it is usable. The stiffnesses
are the cornering stiffnesses of front and rear axle, and the longitudinal stiffness of
the driven axle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tse.car.vehicle import DRIVEN
from tse.estimation.regimes import format_percent
from tse.estimation.verdict import CONTRADICTED, Finding, Verdict
from tse.library.core import Config

# stiffness -> start of its line in the answer: axle, and motion in which it is estimated
WHERE = {
    "cy_front": "front, in bends",
    "cy_rear": "rear, in bends",
    "cx_front": "front, along",
}  # the lines have this order
# stiffness -> explanation if the excitation was too weak
LITTLE = {
    "cy_front": "too few bends in this log",
    "cy_rear": "too few bends in this log",
    "cx_front": "too little acceleration in this log",
}
# reason why a stiffness is not valid -> explanation in the result of make_answer()
WHY_NOT = {
    "starting": "too little excitation since the start",
    "sensor fault": "a sensor was at fault",
    "held": "standstill, low speed, reverse or sliding wheels",
    "input invalid": "inputs or measurements are missing",
    "parameters uncertain": "the car's parameters are too uncertain (tselab calibrate)",
    "does not fit": "the model does not explain the measurements (tselab gap)",
    "implausible": "the channels contradict each other",
    "row refused": "the rows were refused",
    CONTRADICTED: "channels or vehicle file are wrong",
}
# max number of stretches of road that make_answer() describes: the last ones of the drive
MAX_ANSWER_STRETCHES = 2


def make_answer(found: Sequence[Finding], config: Config) -> list[str]:
    """Return lines that state each stiffness, its 95 % interval and whether it is usable.

    A stretch is a part of the drive between two changes of tyres or road. Each of the
    last MAX_ANSWER_STRETCHES stretches has three lines, one for each stiffness. If there
    are several stretches, each has a title above its lines.

    The values are those of compute_held_stiffness(). The longitudinal stiffness is that
    of the driven axle. That of the other axle cannot be estimated, because the filter
    assumes that this axle transmits no longitudinal force.
    """
    rear = config.driven_axle == DRIVEN["rear"]
    by = config.longitudinal_stiffness_rear / config.longitudinal_stiffness_front if rear else 1.0
    lines = []
    left_out = len(found) - MAX_ANSWER_STRETCHES
    if left_out > 0:
        lines.append(
            f"{left_out} earlier stretch{'es' if left_out > 1 else ''} of road: see --verbose or the report"
        )
    for finding in found[-MAX_ANSWER_STRETCHES:]:
        if finding.title:
            lines.append(f"{finding.title}:")
        of_key = {v.key: v for v in finding.verdicts}
        if "cx_front" in of_key:
            along = of_key["cx_front"]
            values = {n: by * getattr(along, n) for n in ("value", "band", "smoothed", "smoothed_band")}
            of_key["cx_front"] = replace(along, **values)
        rows = [_make_cells(of_key[key], rear) for key in WHERE if key in of_key]
        widths = [max(len(row[i]) for row in rows) for i in range(2)]
        indent = "  " if finding.title else ""
        lines += [f"{indent}{a:<{widths[0]}}   {b:<{widths[1]}}   {c}" for a, b, c in rows]
    return lines


def compute_held_stiffness(v: Verdict) -> tuple[float, float]:
    """Return one stiffness for a stretch of road, and half of its 95 % interval.

    The smoothed value is returned if it is valid. Otherwise, the filter's Verdict.value
    (normally at the end of the stretch) is returned if its level is "partly" or "good".
    If its level is "none", neither value is usable, and the smoothed one is returned. A
    particle filter has no smoothed value, so Verdict.value is returned."""
    smoothed = np.isfinite(v.smoothed) and (v.smoothed_reason == "valid" or v.level == "none")
    return (v.smoothed, v.smoothed_band) if smoothed else (v.value, v.band)


def describe_rest(v: Verdict) -> str:
    """Return the text after the value of compute_held_stiffness() in the report. If this
    is the smoothed value, the text gives the filter's value at the end of the stretch."""
    if compute_held_stiffness(v)[0] == v.value or not np.isfinite(v.smoothed):
        return v.detail
    return f"{v.detail.split('; smoothed over ')[0]}; at the end {v.value:.0f} ± {max(v.band, 0.5):.0f}"


def _make_cells(v: Verdict, rear: bool) -> tuple[str, str, str]:
    """Return the three cells of a line: name, value with 95 % interval, and whether the
    value is usable. `rear` is True for a rear-wheel-driven car."""
    where = "rear, along" if rear and v.key == "cx_front" else WHERE[v.key]
    value, band = compute_held_stiffness(v)
    if not np.isfinite(value):
        return where, "-", f"not usable: {explain_reason(v.key, v.reason)}"
    number = f"{value:4.0f} ± {max(band, 0.5):.0f} {v.unit}"
    if v.level == "none":
        return where, number, f"not usable: {explain_reason(v.key, v.reason)}"
    return where, number, f"usable, valid {format_percent(v.valid)} of the time"


def explain_reason(key: str, reason: str) -> str:
    """Return the reason why a stiffness is not usable, in a few words."""
    return WHY_NOT.get(reason, LITTLE[key] if reason in ("", "uncertain", "not excited") else reason)
