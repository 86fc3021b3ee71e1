"""Tables of pages that are measured when they are written: runs of the filter, and what scripts/results says in other units."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from docsite.tables import table

ROOT = Path(__file__).resolve().parents[2]
CYCLES = 1.5  # clock cycles an instruction, assumed: loads take two, and so do branches that are taken
PERIOD = 0.01  # s between rows
CLOCKS = {
    "Cortex-M4F": 168,
    "Cortex-M7": 400,
    "Cortex-M3": 72,
    "Cortex-M0": 48,
}  # MHz that parts of each core often have


def controller() -> str:
    """Return time, load and memory of a row on microcontrollers, from scripts/results/budgets.md."""
    text = (ROOT / "scripts" / "results" / "budgets.md").read_text(encoding="utf-8")
    rows = []
    for line in text.splitlines():
        cells = [c.strip(" *") for c in line.strip("|").split("|")]
        clock = next((mhz for name, mhz in CLOCKS.items() if cells[0].startswith(name)), None)
        if clock is None or len(cells) < 8 or "limit" not in cells[1]:
            continue
        mean, longest, _, flash, particles, ram, stack = (
            int(re.match(r"\**([\d,]+)", c)[1].replace(",", "")) if "," in c.split(" ")[0] else 0 for c in cells[1:8]
        )
        each = CYCLES / clock / 1e3  # ms an instruction
        least = longest * CYCLES / PERIOD / 1e6
        rows.append(
            [cells[0], str(clock), f"{mean * each:.2f}", f"{longest * each:.2f}", f"{least:.0f}",
             *(f"{b / 1e3:.1f}" for b in (flash, particles, ram, stack))]
        )  # fmt: skip
    head = ["core, number format", "MHz", "a row: mean [ms]", "longest [ms]", "least MHz at 100 Hz", "flash [kB]"]
    return table([*head, "with the particle filter", "RAM [kB]", "stack [kB]"], rows, right=tuple(range(1, 9)))


def tuning() -> str:
    """Return mean NIS, whiteness, validity and error for settings that fit a simulated drive, and for some that do not."""
    import tse
    from tse.impl.core import library

    log, truth = tse.simulate("double-lane-change", duration=120)
    late = log.assign(yaw_rate=log["yaw_rate"].shift(8).bfill())
    known = {"mass": 1900, "lf": 1.25, "lr": 1.5, "wheel_radius_front": 0.33, "wheel_radius_rear": 0.33}
    exact = {
        **known, "yaw_inertia": 3000, "cornering_stiffness_front": 1.2e5, "cornering_stiffness_rear": 1.4e5,
        "longitudinal_stiffness_front": 1.6e5, "longitudinal_stiffness_rear": 1.6e5,
        "uncertainty": dict.fromkeys(library().uncertainties, 0.0),
    }  # fmt: skip
    cases: list[tuple[str, Any, dict[str, Any], dict[str, float]]] = [
        ("car known exactly", log, exact, {}),
        ("... gyro 80 ms late", late, exact, {}),
        ("... mass 1500 in place of 1900 kg", log, {**exact, "mass": 1500}, {}),
        ("uncalibrated", log, known, {}),
        ("... `model_sd` 0.02", log, known, {"model_sd": 0.02}),
        ("... `model_sd` 0.2", log, known, {"model_sd": 0.2}),
        ("... gyro 80 ms late", late, known, {}),
    ]
    rows = []
    for name, drive, car, settings in cases:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = tse.estimate(drive, car, settings=settings, calibrate=False).table
        found = found[found["time"] > 20]
        e = found["innovation_yaw_rate"].dropna().to_numpy()
        error = 100 * (found["cy_front"].iloc[-1] / truth["true_cy_front"].iloc[-1] - 1)
        half = 196 * found["cy_front_sd"].iloc[-1] / found["cy_front"].iloc[-1]
        rows.append(
            [name, f"{found['nis'].mean():.1f}", f"{np.corrcoef(e[1:], e[:-1])[0, 1]:.2f}",
             f"{100 * found['cy_front_valid'].mean():.0f}", f"{round(error) + 0:+d}", f"{half:.0f}"]
        )  # fmt: skip
    head = ["settings", "mean `nis`", "autocorrelation of yaw rate's innovation", "valid [%]", "error [%]", "± [%]"]
    return table(head, rows, right=(1, 2, 3, 4, 5))
