"""Driving an FMU with a table of inputs, row by row."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from tselab.core import OUTPUT, STIFFNESS, Config, library, similar
from tselab.errors import UserError
from tselab.estimate import _stop_flag as stop_flag
from tselab.estimate import to_table
from tselab.fmu.slave import Slave, slave
from tselab.log import csv_header, csv_table, to_numbers
from tselab.rows import Log, check_time, columns


@dataclass
class Run:
    """What came out, and how the run ended."""

    table: pd.DataFrame
    interrupted: bool
    notes: list[str]


# ---- the estimator over a log, as `tselab estimate` does it


def is_estimator(names: Mapping[str, object]) -> bool:
    """Does an FMU with these variables take a log's channels and give all of an estimate?"""
    return all(c in names for c in columns()[1:]) and all(v in names for v in sources().values())


def sources() -> dict[str, str]:
    """Output of the library -> variable of the estimator that holds it. The codes why an estimate is not valid are the outputs
    that the library calls ..._valid."""
    names = {}
    for f in library().fields(OUTPUT):
        stiffness = next((s for s in STIFFNESS if f.name == s or f.name.startswith(s + "_")), None)
        if f.name.endswith("_valid"):
            names[f.name] = f"estimate.{f.name.removesuffix('_valid')}_reason"
        elif stiffness and f.unit == "1":
            names[f.name] = f"estimate.relative.{f.name}"
        else:
            names[f.name] = f"estimate.{f.name}"
    return names


def estimate(path: Path, log: Log, config: Config, progress: bool = False) -> Run:
    """Run an estimator FMU over a log: the table that estimate.estimate() makes, bit for bit."""
    with slave(path) as fmu:
        if not is_estimator(fmu.variables):
            raise UserError(
                f"{path}: does not take the columns of a log, or gives no estimate.*: it is not the estimator"
            )
        parameters, notes = settings(fmu, config)
        channels = columns()[1:]
        rows = log.data[channels].to_numpy(float)
        steps = np.append(np.diff(log.time), config.sample_time)
        wanted = sources()
        outputs = np.zeros(len(log), library().dtype(OUTPUT))
        fmu.initialize(float(log.time[0]), parameters, dict(zip(channels, rows[0], strict=True)))
        done = 0
        with stop_flag() as stopped, _bar(len(log), progress) as bar:
            for i, time in enumerate(log.time):
                if stopped():
                    break
                fmu.set(dict(zip(channels, rows[i], strict=True)))
                fmu.step(float(time), float(steps[i]))
                values = fmu.get(wanted.values())
                for name, variable in wanted.items():
                    outputs[name][i] = values[variable]
                done = i + 1
                bar.update()
    table = to_table(log.time[:done], outputs[:done], config)
    return Run(table, done < len(log), notes)


def setting_of(parameter: str) -> str:
    """The setting that a parameter is: vehicle.mass is mass, effects.body_roll.gain is body_roll_gain."""
    return parameter.partition(".")[2].replace(".", "_") or parameter


def settings(fmu: Slave, config: Config) -> tuple[dict[str, float], list[str]]:
    """The parameters that are settings, all of them: nothing is left to the class of the car. One that the FMU does not have, and
    that is not as it always is, matters."""
    known = {setting_of(name): name for name in fmu.names("parameter")}
    values = {known[k]: v for k, v in config.as_dict().items() if k in known}
    if "calibrated" in known:
        values[known["calibrated"]] = True
    lost = [k for k in config.changed() if k not in known]
    notes = [f"the FMU has no parameter for {', '.join(lost)}: what was set is not used"] if lost else []
    return values, notes


# ---- any FMU


def drive(
    path: Path,
    table_path: Path,
    parameters: Mapping[str, float],
    config: Config | None = None,
    hold: bool = False,
    progress: bool = False,
) -> Run:
    """Run any FMU: inputs from the columns of a table that have their names, all outputs out. Row i of the result is time i, after
    the step that led there. Between rows inputs change linearly where the FMU can interpolate, unless `hold`; else each row holds
    until the next."""
    notes = []
    with slave(path) as fmu:
        time, data = read_inputs(table_path, fmu)
        values = dict(settings(fmu, config)[0]) if config is not None else {}
        values.update(resolve(fmu, parameters))
        outputs = fmu.names("output")
        reals = [n for n in data if fmu.is_real(n)]
        interpolates = fmu.description.coSimulation.canInterpolateInputs and not hold and bool(reals)
        if fmu.is_3 and reals and not hold:
            notes = ["FMI 3.0 has no derivatives of inputs: each row holds until the next, as with --hold"]
        column = {name: data[name].to_numpy() for name in data}
        fmu.initialize(float(time[0]), values, {n: c[0] for n, c in column.items()})
        rows = [fmu.get(outputs)]
        with stop_flag() as stopped, _bar(len(time) - 1, progress) as bar:
            for i, step in enumerate(np.diff(time)):
                if stopped():
                    break
                fmu.set({n: c[i] for n, c in column.items()})
                if interpolates:
                    fmu.set_rates({n: (column[n][i + 1] - column[n][i]) / step for n in reals})
                fmu.step(float(time[i]), float(step))
                rows.append(fmu.get(outputs))
                bar.update()
    table = pd.DataFrame(rows, columns=fmu.columns(outputs))
    table = table.astype(dict.fromkeys(fmu.columns(n for n in outputs if fmu.variables[n].type == "Boolean"), int))
    table.insert(0, "time", time[: len(rows)])
    return Run(table, len(rows) < len(time), notes)


def resolve(fmu: Slave, parameters: Mapping[str, float]) -> dict[str, float]:
    """Parameters by their name, or as the setting that they are."""
    names = fmu.names("parameter")
    values = {}
    for key, value in parameters.items():
        found = [key] if key in names else [n for n in names if setting_of(n) == key]
        if not found:
            close = similar(key, dict.fromkeys(names)) if names else ""
            raise UserError(f"option --set: {fmu.path} has no parameter '{key}'{close.split(';')[0]}")
        if len(found) > 1:
            raise UserError(f"option --set: '{key}' is one of {', '.join(found)}: give the whole name")
        values[found[0]] = value
    return values


def read_inputs(path: Path, fmu: Slave) -> tuple[np.ndarray, pd.DataFrame]:
    """A table with a column time, and inputs by their names. An empty cell is not a number, for the FMU to judge."""
    header, whole, _ = csv_header(path)
    inputs = fmu.names("input")
    if "time" not in header:
        raise UserError(f"{path}: column time is missing in the header (line 1)")
    unknown = [c for c in header if c != "time" and c not in inputs and not c.startswith("ref_")]
    if unknown:
        raise UserError(
            f"{path}: column {', '.join(unknown)} is no input of {fmu.path.name}; its inputs: {', '.join(inputs) or 'none'}"
        )
    twice = sorted({c for c in header if header.count(c) > 1})
    if twice:
        raise UserError(f"{path}: column {', '.join(twice)} appears more than once in the header (line 1)")
    if whole is not None:
        raise UserError(
            f"{path}: line {whole + 2}, the last, does not end: it may be cut inside a number; if not, end it"
        )
    table = csv_table(path, header)[[c for c in header if not c.startswith("ref_")]]
    line = np.arange(len(table)) + 2
    if table.empty:
        raise UserError(f"{path}: has a header but no rows")
    numbers = {}
    for name in table:
        column = to_numbers(table[name])
        bad = (column.isna() & (table[name].notna() | (name != "time" and not fmu.is_real(name)))).to_numpy()
        if bad.any():
            i = int(bad.argmax())
            raise UserError(f"{path}: line {line[i]}, column {name}: {str(table[name].iloc[i])[:40]!r} is not a number")
        numbers[name] = column.astype(float)
    time = numbers.pop("time").to_numpy()
    check_time(path, time, line)
    return time, pd.DataFrame(numbers, index=range(len(time)))


def _bar(total: int, progress: bool) -> tqdm:
    return tqdm(total=total, unit="row", disable=not progress, file=sys.stderr, leave=False, desc="fmu run")
