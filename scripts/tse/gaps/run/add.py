"""Write the improved vehicle file with the fitted stiffness and the named effects, i.e.
those that the search (infer/naming.py) reports as missing. Also write a C header with a
function that sets tse_config to the same values. If there is a formula, write it to files
of its own.

Road profiles are not written, because they are properties of the road, not of the car.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from tse.car.formula import format_c_header, write_formula
from tse.car.vehicle import (
    Vehicle,
    format_calibration_table,
    list_formula_settings,
    list_known_stiffness,
    list_latency_settings,
    list_uncertainty_settings,
    list_vehicle_settings,
    make_filter_values,
    read_vehicle,
)
from tse.gaps.infer.naming import convert_to_settings
from tse.gaps.problem import Problem
from tse.gaps.run.posterior import compute_posterior
from tse.gaps.run.workflow import FIT, Found
from tse.identify.knots import PROFILES
from tse.identify.unknowns import SUPERELEVATION
from tse.identify.vehicle_file import format_vehicle
from tse.library import __version__
from tse.library.core import NOMINAL, Config, library
from tse.library.files import write_atomically

VEHICLE_FILE, HEADER_FILE = "vehicle_improved.toml", "effects.h"
FORMULA, FORMULA_HEADER = "formula.toml", "tse_formula.h"


def write_vehicle(out: Path, vehicle_path: Path, problem: Problem, result: Found) -> tuple[Path, Path]:
    """Write the vehicle file and the C header, and return their paths.

    The vehicle file is written first and read back, and the header is made from the
    values that were read. So both files have exactly the same values. A formula is
    written to two more files, FORMULA and FORMULA_HEADER.
    """
    path = out / VEHICLE_FILE
    vehicle = read_vehicle(vehicle_path)
    formula = result.formula or vehicle.formula
    for name in (FORMULA, FORMULA_HEADER):
        (out / name).unlink(missing_ok=True)  # an earlier run may have left the file
    if formula is not None:
        write_formula(out / FORMULA, formula)
        with write_atomically(out / FORMULA_HEADER) as file:
            file.write(format_c_header(formula))
    with write_atomically(path) as file:
        file.write(make_vehicle_toml(replace(vehicle, formula=formula), problem, result))
    with write_atomically(out / HEADER_FILE) as file:
        file.write(make_header(read_vehicle(path)))
    return path, out / HEADER_FILE


def write_formula_files(out: Path, improved: Path) -> list[Path]:
    """Return the paths of the two files of the formula, which write_vehicle() has
    written. If the vehicle file `improved` has no formula, return an empty list.
    """
    return [out / FORMULA, out / FORMULA_HEADER] if read_vehicle(improved).formula is not None else []


def make_vehicle_toml(vehicle: Vehicle, problem: Problem, result: Found) -> str:
    """Return the content of the vehicle file with the fitted stiffness and the effects
    that the search has named.

    `vehicle` must be the vehicle file as the user wrote it, without the sensor settings
    that fill_sensors() estimates. They would become part of the file.
    """
    fit, named = result.final, {n.effect.id: n for n in result.naming.named}
    logs = [log for part, log in result.read if part == FIT]
    known = compute_posterior(
        problem, fit, vehicle, result.formula.settings() if result.formula else {}, logs, result.naming.spread
    )
    values = {
        **vehicle.values,
        **convert_to_settings(problem, fit.values),
        **convert_stiffness(problem.config, known.stiffness),
    }
    bands = {"longitudinal_stiffness_rear": ", follows the front one"}
    for k, (_, low, high) in list_known_stiffness(
        replace(vehicle, values=values, calibration=known.make_calibration())
    ).items():
        bands[NOMINAL[k]] = f", 95 %: {low:.4g} .. {high:.4g}"
    notes: dict[str, list[str]] = {}
    for i, n in named.items():
        bands |= {str(k): f", 95 %: {low:.3g} .. {high:.3g}" for k, (low, high) in n.ci95.items()}
        said = notes.setdefault("bank" if i == SUPERELEVATION else i, [])
        if i in PROFILES:
            said.append("not written: a profile over the distance belongs to the road, not to the car")
            continue
        said.append(f"closes {100 * n.share:.0f} % of the gap, evidence {n.evidence:.0f} nats")
        if n.look_alikes:
            said.append(f"These logs cannot exclude {', '.join(n.look_alikes)} in its place.")
    source = vehicle.path.name if vehicle.path else "the built-in car"
    names = ", ".join(log.path.name for log in problem.logs)
    added = [*(i for i in named if i not in PROFILES), *(["a formula"] if result.formula else [])]
    what = (
        f"# Fitted together: {', '.join(['stiffness', *added])}."
        if added
        else "# Stiffness fitted, nothing added."
    )
    title = [f"# {source}, improved by tselab gap {__version__} from {names}", what]
    return format_vehicle(
        title,
        vehicle,
        values,
        known.make_uncertainty(vehicle),
        format_calibration_table(**known.make_calibration()),
        bands,
        notes,
        Path(FORMULA),
    )


def convert_stiffness(config: Config, values: Mapping[str, float]) -> dict[str, float]:
    """Return the fitted stiffnesses as settings, clipped to the limits of the settings.
    `values` has the ratio of each fitted stiffness to its setting in `config`.

    The rear longitudinal stiffness is not fitted. Its relative change is the relative
    change of the front one, multiplied by the setting rear_longitudinal_follows_front.
    """
    found = {setting: getattr(config, setting) * values.get(key, 1.0) for key, setting in NOMINAL.items()}
    follows = config.rear_longitudinal_follows_front
    rear = 1.0 + follows * (values.get("cx_front", 1.0) - 1.0)
    found["longitudinal_stiffness_rear"] = config.longitudinal_stiffness_rear * rear
    limits = config.fields
    return {k: float(np.clip(v, limits[k].low, limits[k].high)) for k, v in found.items()}


# ---- the C header


def _find_group(key: str) -> str:
    """Return the heading in effects.h under which a setting is written."""
    if key in list_uncertainty_settings():
        return "uncertainty of the parameters"
    if key in list_formula_settings():
        return "formula"
    if key in list_latency_settings().values():
        return "latencies of the channels"
    return "vehicle" if key in list_vehicle_settings() else "sensors and initial values of the filter"


def make_header(vehicle: Vehicle) -> str:
    """Return a C header with a function that sets tse_config to the values that the
    estimator uses for this vehicle file, including the sds of its table [uncertainty].

    The header contains no date, so the same vehicle file always gives the same bytes.
    """
    slug = re.sub(r"\W+", "_", vehicle.name.lower(), flags=re.ASCII).strip("_") or "car"
    guard = f"TSE_EFFECTS_{slug.upper()}_H"
    fields = Config().fields
    by_setting = {p.setting: (e, p) for e in library().effects.values() for p in e.parameters}
    values = make_filter_values(vehicle)
    width = max(len(k) for k in values)
    body, section = [], None
    for key, value in ((k, values[k]) for k in fields if k in values):  # in the order of the settings
        effect, parameter = by_setting.get(key, (None, None))
        title = f"effect {effect.id}: {effect.title}" if effect else _find_group(key)
        if title != section:
            body.append(f"  /* {_make_plain(title)} */")
            section = title
        f = fields[key]
        number = f"{int(value)}" if f.is_integer else f"(tse_setting){float(value)!r}"
        unit = "" if f.unit in ("", "1") else f"{f.unit}: "
        body.append(
            f"  c->{key:<{width}} = {number};  /* "
            f"{_make_plain(unit + (parameter.text if parameter else f.text))} */"
        )
    return "\n".join(
        [
            f"/* {_make_plain(vehicle.name)}: settings of tse_config, with the effects found in the logs of "
            "this car.",
            f" * Written by tselab gap {__version__} from "
            f"{_make_plain(vehicle.path.name) if vehicle.path else 'the built-in car'}"
            " in the same folder. If you change one of the two files, change the other, too.",
            " *",
            " *   tse_config c;",
            " *   tse_config_default(&c);",
            f" *   tse_config_{slug}(&c);",
            " */",
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            '#include "tse/tse.h"',
            "",
            f"static inline void tse_config_{slug}(tse_config *c) {{",
            *body,
            "}",
            "",
            "#endif",
            "",
        ]
    )


def _make_plain(text: str) -> str:
    """Return text for a C comment, without strings that would end or nest the comment."""
    return text.replace("*/", "* /").replace("/*", "/ *").replace("\n", " ").replace("\\", "/")
