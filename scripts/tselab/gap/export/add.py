"""What was found, for those who use it: the improved vehicle file, and a C header that sets tse_config to it.

Only what is asserted goes in: without a name the stiffness alone. A profile of the road is not of the car: not written."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from tselab import __version__
from tselab.core import NOMINAL, Config, EffectParameter, library
from tselab.files import atomic
from tselab.formula import c_header, write_formula
from tselab.gap.export.posterior import posterior
from tselab.gap.fit import Fit
from tselab.gap.infer.naming import Named, settings
from tselab.gap.problem import PROFILES, Problem
from tselab.gap.workflow import Result
from tselab.vehicle import (
    HINT_ONLY,
    Vehicle,
    calibration_toml,
    formula_settings,
    formula_toml,
    is_set,
    known_stiffness,
    latency_settings,
    read_vehicle,
    sensor_settings,
    uncertainty_settings,
    vehicle_settings,
)

VEHICLE, HEADER = "vehicle_improved.toml", "effects.h"
FORMULA, FORMULA_HEADER = "formula.toml", "tse_formula.h"


def asserted(result: Result) -> tuple[Fit, list[Named]]:
    """The fit that stands, and its effects: those of a verdict that names them, else none."""
    named = result.naming.named if result.verdict == "named" else []
    if result.formula is not None:
        return result.final, named
    return (result.naming.final if named else result.naming.baseline), named


def write(out: Path, vehicle_path: Path, problem: Problem, result: Result) -> tuple[Path, Path]:
    """Both files; the header is made from the vehicle file as it reads back."""
    path = out / VEHICLE
    vehicle = read_vehicle(vehicle_path)
    formula = result.formula or vehicle.formula
    for name in (FORMULA, FORMULA_HEADER):
        (out / name).unlink(missing_ok=True)  # of an earlier run
    if formula is not None:
        write_formula(out / FORMULA, formula)
        with atomic(out / FORMULA_HEADER) as file:
            file.write(c_header(formula))
    with atomic(path) as file:
        file.write(improved(vehicle, problem, result))
    with atomic(out / HEADER) as file:
        file.write(header(read_vehicle(path)))
    return path, out / HEADER


def formula_files(out: Path, improved: Path) -> list[Path]:
    """What was written of a formula."""
    return [out / FORMULA, out / FORMULA_HEADER] if read_vehicle(improved).formula is not None else []


def _group(key: str) -> str:
    """What a setting is of: a heading of effects.h."""
    if key in uncertainty_settings():
        return "how uncertain that is"
    if key in formula_settings():
        return "a formula of the user"
    if key in latency_settings().values():
        return "how late channels are logged"
    return "vehicle" if key in vehicle_settings() else "sensors"


def improved(vehicle: Vehicle, problem: Problem, result: Result) -> str:
    """The vehicle file with fitted stiffness and effects. `vehicle`: as the user wrote it, sensors not filled in."""
    fit, named = asserted(result)
    values = {**vehicle.values, **stiffness(problem.config, fit.values)}
    found = settings(problem, fit.values)
    config = Config(values | found)
    source = vehicle.path.name if vehicle.path else "the built-in car"
    logs = ", ".join(log.path.name for log in problem.logs)
    fields = Config().fields
    lines = [f"# {source}, improved by tselab gap {__version__} from {logs}", *_verdict(result), ""]
    facts = {k: v for k, v in vehicle.facts.items() if k not in HINT_ONLY}
    lines += [
        f"{k} = {json.dumps(v, ensure_ascii=False)}" for k, v in facts.items() if isinstance(v, (str, int, float))
    ]
    known = posterior(problem, fit, vehicle, result.formula.settings() if result.formula else {})
    after = replace(vehicle, values=values, calibration=known.calibration())
    band = {
        NOMINAL[k]: f", fitted, 95 %: {low:.4g} .. {high:.4g}" for k, (_, low, high) in known_stiffness(after).items()
    }
    band["longitudinal_stiffness_rear"] = ", follows the front one"
    for key in vehicle_settings():
        if key in values:
            lines.append(f"{key} = {values[key]!r}  # {fields[key].unit}{band.get(key, '')}")
    lines += ["", "[uncertainty]"]
    lines += [f"{k} = {v:.3g}  # {fields[k].unit}" for k, v in known.uncertainty(vehicle).items()]
    late = latency_settings()
    logged = {
        k: found.get(late[k], values.get(late[k], 0.0)) for k in late if late[k] in found or k in vehicle.given_latency
    }
    if logged:
        lines += ["", "[latency]", *(f"{k} = {v!r}  # {fields[late[k]].unit}" for k, v in logged.items())]
    sensors = [k for k in sensor_settings() if k in values]
    if sensors:
        lines += ["", "[sensors]", *(f"{k} = {values[k]!r}  # {fields[k].unit}" for k in sensors)]
    formula = result.formula or vehicle.formula
    if formula is not None:
        lines += formula_toml(formula, Path(FORMULA)).splitlines()
    mine = {n.effect.id: n for n in named}
    for effect in library().effects.values():
        n = mine.get(effect.id)
        if effect.id in PROFILES and n:
            lines += [
                "",
                f"# {effect.title}: a profile over the distance, of the road and not of the car: not written.",
            ]
        if not is_set(config, effect):
            continue
        lines += ["", f"[effects.{effect.id}]  # {effect.title}{'' if n else ', as in the file'}"]
        if n:
            lines.append(f"# closes {100 * n.share:.0f} % of the gap, evidence {n.evidence:.0f} nats")
            lines += [f"# {remark}" for remark in n.remarks]
        if n and n.look_alikes:
            lines.append(f"# These logs cannot exclude {', '.join(n.look_alikes)} in its place.")
        lines += [_parameter(p, float(getattr(config, p.setting)), n) for p in effect.parameters]
    lines += [
        "",
        "# What estimator and calibration start from: means and covariance; stiffness in ln over this file's.",
    ]
    lines += calibration_toml(**known.calibration())
    return "\n".join(lines) + "\n"


def _verdict(result: Result) -> list[str]:
    if result.verdict == "none":
        return ["# Nothing is missing that these logs could show: stiffness fitted, nothing added."]
    if result.verdict == "named":
        return ["# Stiffness and the effects below were fitted together: they belong together."]
    if result.formula is not None:
        return [
            "# Something is missing that is not in the catalogue: stiffness and a formula for it were fitted together."
        ]
    return ["# Something is missing that is not in the catalogue: stiffness fitted without it, nothing added."]


def _parameter(p: EffectParameter, value: float, n: Named | None) -> str:
    band = ""
    if n and p.setting in n.ci95:
        low, high = n.ci95[p.setting]
        band = (
            f", 95 %: {low:.3g} .. {high:.3g}" if np.isfinite([low, high]).all() else ", not determined by these logs"
        )
    return f"{p.name} = {value!r}  # {p.unit}: {p.text}{band}"


def stiffness(config: Config, values: Mapping[str, float]) -> dict[str, float]:
    """Fitted stiffness as settings; the rear longitudinal one follows the front as the settings say."""
    found = {setting: getattr(config, setting) * values.get(key, 1.0) for key, setting in NOMINAL.items()}
    follows = config.rear_longitudinal_follows_front
    rear = 1.0 + follows * (values.get("cx_front", 1.0) - 1.0)
    found["longitudinal_stiffness_rear"] = config.longitudinal_stiffness_rear * rear
    limits = config.fields
    return {k: float(np.clip(v, limits[k].low, limits[k].high)) for k, v in found.items()}


# ---- C


def header(vehicle: Vehicle) -> str:
    """A static inline function that sets tse_config as the vehicle file does. Same file, same bytes: no date in it."""
    slug = re.sub(r"\W+", "_", vehicle.name.lower(), flags=re.ASCII).strip("_") or "car"
    guard = f"TSE_EFFECTS_{slug.upper()}_H"
    fields = Config().fields
    by_setting = {p.setting: (e, p) for e in library().effects.values() for p in e.parameters}
    width = max(len(k) for k in vehicle.values)
    body, section = [], None
    for key, value in ((k, vehicle.values[k]) for k in fields if k in vehicle.values):  # in the order of the settings
        effect, parameter = by_setting.get(key, (None, None))
        title = f"effect {effect.id}: {effect.title}" if effect else _group(key)
        if title != section:
            body.append(f"  /* {_plain(title)} */")
            section = title
        f = fields[key]
        number = f"{int(value)}" if f.is_integer else f"(tse_setting){float(value)!r}"
        unit = "" if f.unit in ("", "1") else f"{f.unit}: "
        body.append(
            f"  c->{key:<{width}} = {number};  /* {_plain(unit + (parameter.text if parameter else f.text))} */"
        )
    return "\n".join(
        [
            f"/* {_plain(vehicle.name)}: settings of tse_config, with the effects that the logs of this car show.",
            f" * Written by tselab gap {__version__} from {_plain(vehicle.path.name) if vehicle.path else 'the built-in car'},"
            " beside which it lies; whoever changes one makes the other again.",
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


def _plain(text: str) -> str:
    """Text that may stand in a comment of C."""
    return text.replace("*/", "* /").replace("/*", "/ *").replace("\n", " ").replace("\\", "/")
