"""Running the estimator FMU over a log, as `tselab estimate` runs the library. FMPy runs any FMU over any table."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pandas as pd
from tqdm import tqdm

from tse.impl.core import OUTPUT, STIFFNESS, Config, library
from tse.impl.errors import UserError
from tse.impl.estimate import _stop_flag as stop_flag
from tse.impl.estimate import to_table
from tse.impl.rows import Log, columns
from tselab.fmu.archive import open_archive, read_description, unpacked
from tselab.fmu.platforms import usable_here

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription, ScalarVariable


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


# ---- One instance of an FMU in this process, by FMPy: values by name, and errors in the words of the FMU's own log.


_INTEGERS = tuple(f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64))  # of FMI 3.0
REALS = ("Real", "Float64", "Float32")
READ = {"Real": "getReal", "Integer": "getInteger", "Boolean": "getBoolean", "String": "getString"}
READ.update({kind: f"get{kind}" for kind in ("Float64", "Float32", *_INTEGERS)})
WRITE = {kind: method.replace("get", "set", 1) for kind, method in READ.items() if kind != "String"}
ERROR = 3  # fmi2Status and fmi3Status from which on a log line tells of a refusal


class Slave:
    """A co-simulation instance, not yet initialized."""

    def __init__(self, path: Path, description: ModelDescription, folder: Path):
        from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
        from fmpy.fmi3 import FMU3Slave

        self.path, self.description = path, description
        self.is_3 = version_of(description) == "3"
        self.variables: dict[str, ScalarVariable] = {v.name: v for v in description.modelVariables}
        self.said: list[str] = []
        identifier = description.coSimulation.modelIdentifier
        self._callbacks = fmi2CallbackFunctions()  # kept: the FMU calls back as long as it lives
        self._logger = fmi2CallbackLoggerTYPE(self._log)
        self._callbacks.logger = self._logger
        try:
            self._fmu = (FMU3Slave if self.is_3 else FMU2Slave)(
                guid=description.guid, unzipDirectory=str(folder), modelIdentifier=identifier, instanceName=identifier
            )
        except Exception as error:  # the loader's
            raise UserError(f"{path}: its binary cannot be loaded: {error}") from None
        if self.is_3:
            self._call("instantiate", logMessage=lambda environment, *said: self._log(environment, b"", *said))
        else:
            self._call("instantiate", callbacks=self._callbacks)

    def _log(self, _environment: Any, _name: bytes, status: int, _category: bytes, message: bytes) -> None:
        if status >= ERROR:
            self.said.append((message or b"").decode("utf-8", "replace"))

    def _call(self, method: str, *args: Any, **kwargs: Any) -> Any:
        self.said.clear()
        try:
            return getattr(self._fmu, method)(*args, **kwargs)
        except Exception as error:  # FMPy raises plain ones, too
            raise UserError(f"{self.path}: the FMU refuses: {'; '.join(self.said) or error}") from None

    def names(self, causality: str) -> list[str]:
        """In the order of the description; without Strings and arrays."""
        return [
            v.name
            for v in self.variables.values()
            if v.causality == causality and self._kind(v.name) in WRITE and not v.dimensions
        ]

    def _kind(self, name: str) -> str:
        """The type, as its functions are called: an Enumeration is an integer."""
        kind = self.variables[name].type
        return kind if kind != "Enumeration" else "Int64" if self.is_3 else "Integer"

    def initialize(self, start: float, parameters: Mapping[str, float], inputs: Mapping[str, float]) -> None:
        if not self.is_3:
            self._call("setupExperiment", startTime=start)
        self.set(parameters)
        self._call("enterInitializationMode", **({"startTime": start} if self.is_3 else {}))
        self.set(inputs)
        self._call("exitInitializationMode")

    def set(self, values: Mapping[str, float]) -> None:
        for kind, names in self._by_type(values).items():
            convert = float if kind in REALS else int
            self._call(WRITE[kind], self._references(names), [convert(values[n]) for n in names])

    def step(self, time: float, step: float) -> None:
        self._call("doStep", currentCommunicationPoint=time, communicationStepSize=step)

    def get(self, names: Iterable[str]) -> dict[str, Any]:
        """Values by name, in the order of the types."""
        values: dict[str, Any] = {}
        for kind, group in self._by_type(names).items():
            sized = {"nValues": len(group)} if self.is_3 else {}
            values.update(zip(group, self._call(READ[kind], self._references(group), **sized), strict=True))
        return values

    def close(self) -> None:
        try:
            self._fmu.terminate()
        except Exception:  # it may refuse in the state that an error left it in
            pass
        finally:
            self._fmu.freeInstance()

    def _references(self, names: Iterable[str]) -> list[int]:
        return [self.variables[n].valueReference for n in names]

    def _by_type(self, names: Iterable[str]) -> dict[str, list[str]]:
        groups: dict[str, list[str]] = {}
        for name in names:
            groups.setdefault(self._kind(name), []).append(name)
        return groups


def version_of(description: ModelDescription) -> str:
    """2 or 3; empty for other versions of FMI."""
    return "2" if description.fmiVersion == "2.0" else "3" if description.fmiVersion.startswith("3.") else ""


@contextmanager
def slave(path: Path) -> Iterator[Slave]:
    """An instance of the FMU at `path`, for as long as the block lasts."""
    archive = open_archive(path)
    description = read_description(path)
    if not version_of(description) or description.coSimulation is None:
        kind = "co-simulation" if description.coSimulation is not None else "model exchange only"
        raise UserError(
            f"{path}: is an FMU of FMI {description.fmiVersion}, {kind}; FMI 2.0 or 3.0 for co-simulation is needed"
        )
    here = usable_here(version_of(description))
    if not any(p in archive.binaries for p in here):
        have = ", ".join(sorted(archive.binaries)) or "none"
        raise UserError(f"{path}: has no binary for this machine, {here[0]}; it has: {have}")
    with unpacked(path) as folder:
        instance = Slave(path, description, folder)
        try:
            yield instance
        finally:
            instance.close()


# ---- A vehicle as a parameter set of SSP (.ssv), for the estimator in any tool that connects FMUs.


HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet version="1.0" name={name}
    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssv:Parameters>
"""
TAIL = """  </ssv:Parameters>
</ssv:ParameterSet>
"""


def parameter_set(variables: Mapping[str, Any], config: Config, name: str) -> str:
    """Return the parameter set of a car: vehicle.calibrated, all of vehicle.*, and of the others what is not at its start.

    Parameters
    ----------
    variables
        Of the estimator's modelDescription.xml, by name.
    config
        The settings of the car.
    name
        Of the car.
    """
    values, lines = config.as_dict(), []
    for v in variables.values():
        value: float | bool = (
            True if v.name == "vehicle.calibrated" else values.get(setting_of(v.name), float(v.start or 0))
        )
        if v.causality != "parameter" or not (v.name.startswith("vehicle.") or value != float(v.start)):
            continue
        kind = {"Float64": "Real", "Int32": "Integer"}.get(v.type, v.type)
        text = "true" if kind == "Boolean" else str(int(value)) if kind == "Integer" else repr(float(value))
        lines.append(f'    <ssv:Parameter name="{v.name}"><ssv:{kind} value="{text}"/></ssv:Parameter>\n')
    return HEAD.format(name=quoteattr(name)) + "".join(lines) + TAIL
