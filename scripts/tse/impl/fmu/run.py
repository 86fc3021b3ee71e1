"""Running the estimator FMU over a log, as `tselab estimate` runs the library. FMPy runs any FMU over any table."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from tse.impl.core import OUTPUT, STIFFNESS, Config, library
from tse.impl.errors import UserError
from tse.impl.estimate import _stop_flag as stop_flag
from tse.impl.estimate import to_table
from tse.impl.fmu.slave import Slave, slave
from tse.impl.rows import Log, columns


@dataclass
class Run:
    """What came out, and how the run ended."""

    table: pd.DataFrame
    interrupted: bool
    notes: list[str]


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


def _bar(total: int, progress: bool) -> tqdm:
    return tqdm(total=total, unit="row", disable=not progress, file=sys.stderr, leave=False, desc="fmu run")
