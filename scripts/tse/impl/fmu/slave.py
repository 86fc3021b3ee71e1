"""One instance of an FMU in this process, by FMPy: values by name, and errors in the words of the FMU's own log."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tse.impl.errors import UserError
from tse.impl.fmu.archive import open_archive, read_description, unpacked
from tse.impl.fmu.platforms import usable_here

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription, ScalarVariable

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
