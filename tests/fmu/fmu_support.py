"""What the tests of the FMUs share: building them, one instance through FMPy, the same drive through FMU and C library."""

from __future__ import annotations

import functools
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import read_model_description
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE, fmi2Warning
from fmpy.fmi3 import FMU3Slave

from tse.library.core import INPUT, OUTPUT, SIM_INPUT, Config, NativeFilter, convert_stiffness, library
from tse.library.files import lock_file
from tselab.fmu_build import FMI, PLATFORMS, compile_for, get_lock, get_native_platform, read_version, run_zig

ROOT = Path(__file__).resolve().parents[2]
ESTIMATOR, VEHICLE = "TireStiffnessEstimator", "SingleTrackVehicle"
MODELS = (ESTIMATOR, VEHICLE)
CHANNELS = [f.name for f in library().channels]
KNOWN = {"vehicle.exact": True}  # the car of tse_config_exact()
DRIVER = [f.name for f in library().fields(SIM_INPUT) if f.name != "dt"]

# ---- building


def run(*command: object, **options: Any) -> subprocess.CompletedProcess:
    """Run a command to its end; what it printed is in the error when it failed."""
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=900, **options)
    if done.returncode:
        text = f"{' '.join(map(str, command))}: {done.returncode}\n{done.stdout[-3000:]}{done.stderr[-3000:]}"
        raise RuntimeError(text)
    return done


def connections() -> set[tuple[str, str]]:
    """Of the vehicle's outputs to the estimator's inputs, as the system has them."""
    ssd = ElementTree.parse(ROOT / "fmu" / "StiffnessStudy.ssd")
    return {
        (c.get("startConnector"), c.get("endConnector"))
        for c in ssd.iter("{http://ssp-standard.org/SSP1/SystemStructureDescription}Connection")
        if (c.get("startElement"), c.get("endElement")) == ("vehicle", "estimator")
    }


def headers(fmi: str = "2") -> Path:
    """The FMI headers, where scripts/setup.sh puts them."""
    return ROOT / ".venv" / "share" / f"fmi{fmi}" / "headers"


@functools.cache
def build(folder: str = "fmu", *options: str) -> Path:
    """Build the FMUs with the preset fmu; only what changed is built again.   Returned: the folder of the .fmu files."""
    where = ROOT / "build" / folder
    with lock_file(get_lock(where)):  # of other processes that test, and of `tselab fmu build`
        _build(where, *options)
    return where / "fmu"


def _build(where: Path, *options: str) -> None:
    # a cache of another checkout or generator would stop CMake
    cache = where / "CMakeCache.txt"
    if cache.is_file() and f"CMAKE_HOME_DIRECTORY:INTERNAL={ROOT}\n" not in cache.read_text():
        shutil.rmtree(where)
    generator = [] if cache.is_file() or not shutil.which("ninja") else ["-G", "Ninja"]
    sources = [f"-DFETCHCONTENT_SOURCE_DIR_FMI{v}={headers(v).parent}" for v in FMI if headers(v).is_dir()]
    run("cmake", "--preset", "fmu", "-B", where, *generator, *sources, *options, cwd=ROOT)
    run("cmake", "--build", where, "--target", "fmus", cwd=ROOT)


class Unit:
    """An FMU, unpacked."""

    def __init__(self, fmu: Path, folder: Path):
        self.fmu, self.folder = fmu, folder
        with zipfile.ZipFile(fmu) as archive:
            archive.extractall(folder)
        self.description = read_model_description(folder)
        self.variables = {v.name: v for v in self.description.modelVariables}
        self.outputs = [v.name for v in self.description.modelVariables if v.causality == "output"]
        self.guid, self.identifier = self.description.guid, self.description.coSimulation.modelIdentifier

    def code(self, name: str) -> str:
        """A variable as tests/fmu/client.c takes it: r12. Of FMI 2.0 the functions of Integer read an Enumeration."""
        v = self.variables[name]
        if v.type == "Enumeration" and self.description.fmiVersion.startswith("2"):
            return f"i{v.valueReference}"
        return f"{'r' if v.type == 'Float64' else v.type[0].lower()}{v.valueReference}"

    @property
    def binary(self) -> Path:
        return next(
            (
                self.folder
                / "binaries"
                / get_native_platform("2" if self.description.fmiVersion == "2.0" else "3")
            ).glob("*.*")
        )


def exported(binary: Path) -> set[str]:
    """Names that a shared library of this machine exports."""
    return {line.split()[-1] for line in run("nm", "-D", "--defined-only", binary).stdout.splitlines()}


@functools.cache
def scratch() -> Path:
    """A folder for what lasts as long as the tests."""
    return Path(tempfile.mkdtemp(prefix="tse-fmu-"))


@functools.cache
def unit(model: str, folder: str = "fmu") -> Unit:
    """An FMU of a build."""
    fmu = (build() if folder == "fmu" else ROOT / "build" / folder / "fmu") / f"{model}.fmu"
    return Unit(fmu, scratch() / folder / model)


# ---- one instance


class Instance:
    """One instance, variables by name. `log` holds what it said: (instance, status, category, text)."""

    def __init__(self, of: Unit, name: str = "one", *, guid: str | None = None, logging: bool = False):
        self.unit, self.log = of, []

        def say(environment: Any, instance: bytes, status: int, category: bytes, text: bytes) -> None:
            self.log.append((instance.decode(), status, category.decode(), text.decode()))

        self._callbacks = fmi2CallbackFunctions()
        self._callbacks.logger = fmi2CallbackLoggerTYPE(say)  # kept: ctypes does not
        self.slave = FMU2Slave(
            guid=of.guid if guid is None else guid,
            unzipDirectory=str(of.folder),
            modelIdentifier=of.identifier,
            instanceName=name,
        )
        whole = ("setInteger", "getInteger")
        self._of_type = {"Real": ("setReal", "getReal"), "Integer": whole, "Enumeration": whole,
                         "Boolean": ("setBoolean", "getBoolean")}  # fmt: skip
        self.slave.instantiate(callbacks=self._callbacks, loggingOn=logging)
        self.open = True

    def __enter__(self) -> Instance:
        return self

    def __exit__(self, *_: object) -> None:
        self.free()

    def free(self) -> None:
        """Not FMPy's freeInstance(), which unloads the library below other instances' states."""
        if self.open:
            self.slave.fmi2FreeInstance(self.slave.component)
            self.open = False

    def set(self, values: Mapping[str, float]) -> None:
        for kind, (setter, _) in self._of_type.items():
            names = [n for n in values if self.unit.variables[n].type == kind]
            if names:
                references = [self.unit.variables[n].valueReference for n in names]
                as_type = float if kind == "Real" else int
                getattr(self.slave, setter)(references, [as_type(values[n]) for n in names])

    def get(self, names: Sequence[str] | None = None) -> dict[str, float]:
        """Values by name; without names all outputs."""
        names = self.unit.outputs if names is None else names
        result = {}
        for kind, (_, getter) in self._of_type.items():
            of_kind = [n for n in names if self.unit.variables[n].type == kind]
            if of_kind:
                references = [self.unit.variables[n].valueReference for n in of_kind]
                result.update(zip(of_kind, getattr(self.slave, getter)(references), strict=True))
        return result

    def start(self, parameters: Mapping[str, float] | None = None, inputs: Mapping[str, float] | None = None,
              time: float = 0.0) -> Instance:  # fmt: skip
        self.set(parameters or {})
        self.slave.setupExperiment(startTime=time)
        self.slave.enterInitializationMode()
        self.set(inputs or {})
        self.slave.exitInitializationMode()
        return self

    def step(self, time: float, size: float) -> int:
        """The fmi2Status of the step; an error raises."""
        return self.slave.fmi2DoStep(self.slave.component, time, size, 1)

    def state(self) -> bytes:
        state = self.slave.getFMUstate()
        data = self.slave.serializeFMUstate(state)
        self.slave.freeFMUstate(state)
        return data

    def restore(self, data: bytes) -> None:
        state = self.slave.deSerializeFMUstate(data)
        self.slave.setFMUstate(state)
        self.slave.freeFMUstate(state)

    def texts(self) -> list[str]:
        return [text for *_, text in self.log]


FUNCTIONS = {"Float64": "Float64", "Int32": "Int32", "Boolean": "Boolean", "Enumeration": "Int64"}  # by type


class Instance3:
    """One instance through FMPy, by names; `log` holds (status, category, text)."""

    def __init__(self, of: Unit, *, token: str | None = None, events: bool = False):
        self.unit, self.log = of, []
        self.slave = FMU3Slave(
            guid=token or of.guid,
            unzipDirectory=str(of.folder),
            modelIdentifier=of.identifier,
            instanceName="three",
        )

        def say(_: Any, status: int, category: bytes, text: bytes) -> None:
            self.log.append((status, category.decode(), text.decode()))

        self.slave.instantiate(logMessage=say, eventModeUsed=events)

    def __enter__(self) -> Instance3:
        return self

    def __exit__(self, *_: object) -> None:
        self.slave.fmi3FreeInstance(self.slave.component)  # not freeInstance(), which unloads the library

    def set(self, values: dict[str, float]) -> None:
        for kind, python in (("Float64", float), ("Int32", int), ("Boolean", bool)):
            names = [n for n in values if self.unit.variables[n].type == kind]
            if names:
                references = [self.unit.variables[n].valueReference for n in names]
                getattr(self.slave, f"set{kind}")(references, [python(values[n]) for n in names])

    def get(self, names: list[str]) -> dict[str, Any]:
        """Values by name; those of an array as a list."""
        found = {}
        for kind, function in FUNCTIONS.items():
            group = [self.unit.variables[n] for n in names if self.unit.variables[n].type == kind]
            if not group:
                continue
            counts = [v.shape[0] if v.dimensions else 0 for v in group]
            values = getattr(self.slave, f"get{function}")(
                [v.valueReference for v in group], nValues=sum(n or 1 for n in counts)
            )
            for v, n in zip(group, counts, strict=True):
                found[v.name] = [values.pop(0) for _ in range(n)] if n else values.pop(0)
        return found

    def start(
        self, parameters: dict[str, float] | None = None, inputs: dict[str, float] | None = None
    ) -> Instance3:
        self.set(parameters or {})
        self.slave.enterInitializationMode(startTime=0.0)
        self.set(inputs or {})
        self.slave.exitInitializationMode()
        return self

    def step(self, time: float, size: float) -> None:
        self.slave.doStep(time, size)


# ---- a drive through the C library and through the FMU

REAL_BITS = "<d"


def bits(x: float) -> str:
    """A Real as tests/fmu/client.c writes it."""
    return "x" + struct.pack(">d", x).hex()


class Log:
    """Times and channels of a log; NaN is missing."""

    def __init__(self, time: np.ndarray, channels: np.ndarray):
        self.time, self.channels = time, channels

    def __len__(self) -> int:
        return len(self.time)

    def step(self, i: int) -> float:
        """To the next row; the last one as long as the one before."""
        return float(
            self.time[i + 1] - self.time[i] if i + 1 < len(self) else self.time[i] - self.time[i - 1]
        )

    def part(self, first: int, last: int) -> Log:
        return Log(self.time[first:last], self.channels[first:last])

    def through_library(self, settings: Mapping[str, float] | Config, form: str | None = None) -> np.ndarray:
        """One row of the core's outputs per row."""
        config = settings
        if not isinstance(settings, Config):
            config = Config.exact({**(Config.settings_of(form) if form else {}), **settings})
        filter_ = NativeFilter(config)
        rows = np.zeros(len(self), library().dtype(INPUT))
        rows["dt"][1:] = np.diff(self.time)
        for k, name in enumerate(CHANNELS):
            rows[name] = self.channels[:, k]
        outputs = filter_.outputs(len(self))
        filter_.step_into(rows, outputs)
        return outputs

    def through_fmu(
        self, instance: Instance, first: int = 0, last: int | None = None
    ) -> list[dict[str, float]]:
        """One dictionary of the FMU's outputs per row."""
        rows = []
        for i in range(first, len(self) if last is None else last):
            instance.set(dict(zip(CHANNELS, self.channels[i], strict=True)))
            assert instance.step(float(self.time[i]), self.step(i)) <= fmi2Warning
            rows.append(instance.get())
        return rows


def parameters_of(settings: Mapping[str, float], of: Unit) -> dict[str, float]:
    """Settings under the estimator's names; what is not among them is as in tse_config_exact()."""
    known = {
        n.partition(".")[2].replace(".", "_"): n
        for n, v in of.variables.items()
        if v.causality == "parameter"
    }
    return {**KNOWN, **{known[name]: value for name, value in settings.items()}}


def expected_outputs(row: np.void, config: Config) -> dict[str, float]:
    """What the estimator FMU has to put out where the C library puts out this row."""
    expected: dict[str, float] = {}
    si = convert_stiffness(config, row)
    for f in library().fields(OUTPUT):
        value = row[f.name].item()
        stem = f.name.removesuffix("_valid")
        if f.name.endswith("_valid"):
            expected[f"estimate.{stem}_reason"], expected[f"estimate.{stem}_valid"] = value, value == 0
        elif f.name.endswith("_spread_seen"):
            expected[f"estimate.{f.name}"] = bool(value)
        elif stem.startswith(("cx_", "cy_")):
            expected[f"estimate.relative.{f.name}"] = value
            kind = 1 if f.name.endswith("_sd") else 2 if f.name.endswith("_spread") else 0
            axle = ["cx_front", "cy_front", "cy_rear"].index("_".join(f.name.split("_")[:2]))
            expected[f"estimate.{f.name}"] = float(si[kind][axle])
        else:
            expected[f"estimate.{f.name}"] = value
    stiffness = ("cx_front", "cy_front", "cy_rear")
    one = np.zeros(1, library().dtype(OUTPUT))
    for s in stiffness:
        one[s] = 1.0
    for s, nominal in zip(stiffness, convert_stiffness(config, one[0])[0], strict=True):
        expected[f"estimate.nominal.{s}"] = float(nominal)
        expected[f"estimate.{s}_secant"] = float(nominal * row[f"{s}_secant"])
    expected["estimate.valid"] = all(expected[f"estimate.{s}_valid"] for s in stiffness)
    return expected


def same(a: float, b: float) -> bool:
    """The same bits."""
    return struct.pack(REAL_BITS, float(a)) == struct.pack(REAL_BITS, float(b))


def expect_same_rows(got: Iterable[Mapping[str, float]], expected: Iterable[Mapping[str, float]]) -> None:
    """Every output of every row has the same bits; says which do not."""
    for i, (a, b) in enumerate(zip(got, expected, strict=True)):
        assert a.keys() == b.keys(), sorted(a.keys() ^ b.keys())
        wrong = [f"row {i}: {n} is {a[n]!r}, expected {b[n]!r}" for n in b if not same(a[n], b[n])]
        assert not wrong, "\n".join(wrong[:10])


def recorded_drive(rows: int | None = None) -> Log:
    """tests/replay/drive.csv."""
    lines = [
        s for s in (ROOT / "tests" / "replay" / "drive.csv").read_text().splitlines() if s[:1].isdigit()
    ][:rows]
    table = np.array([[float(c) if c else np.nan for c in s.split(",")] for s in lines])
    return Log(np.concatenate([[0.0], np.cumsum(table[1:, 0])]), table[:, 1:])


# ---- other platforms: compilers and what runs their programs

CACHE = ROOT / "build" / "zig-cache"  # that of `tselab fmu build`: what it has compiled is not compiled again
RUNNERS = {
    # name: suffix of a program, what runs it
    "linux64": ("", []),
    "aarch64-linux": ("", ["qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"]),
    "win64": (".exe", ["wine"]),
}


def unavailable(target: str) -> str:
    """Why programs of this platform cannot be built or run here; empty: they can."""
    if subprocess.run([sys.executable, "-m", "ziglang", "version"], capture_output=True).returncode:
        return "ziglang is not installed (scripts/setup.sh platforms)"
    runner = RUNNERS[target][1]
    if runner and not shutil.which(runner[0]):
        return f"{runner[0]} is not installed"
    if target == "aarch64-linux" and not Path("/usr/aarch64-linux-gnu/lib").is_dir():
        return "there is no C library for aarch64 in /usr/aarch64-linux-gnu (Debian: libc6-arm64-cross)"
    return ""


@functools.cache
def library_for(target: str, of: Unit) -> Path:
    """The FMU's shared library for a platform, compiled as `tselab fmu build` does."""
    build()
    platform = PLATFORMS[target]
    result = scratch() / target / of.fmu.stem / (of.identifier + platform.suffix)
    result.parent.mkdir(parents=True, exist_ok=True)
    sources = ROOT / "build" / "fmu" / "fmu" / of.fmu.stem / "sources"
    result.write_bytes(compile_for(platform, sources, CACHE, read_version(of.fmu.stem)))
    return result


@functools.cache
def _client(target: str) -> Path:
    program = scratch() / f"client-{target}{RUNNERS[target][0]}"
    fmi = (
        ["-DCLIENT_FMI3", *(f"-I{headers(v)}" for v in FMI)] if headers("3").is_dir() else [f"-I{headers()}"]
    )
    arguments = [
        "-target",
        PLATFORMS[target].targets[0],
        "-std=c99",
        "-O1",
        *fmi,
        "client.c",
        "-o",
        str(program),
    ]
    run_zig([*arguments, *([] if target == "win64" else ["-ldl"])], Path(__file__).parent, CACHE)
    return program


def client_for(target: str) -> list[str]:
    """tests/fmu/client.c for a platform, as a command."""
    return [*RUNNERS[target][1], str(_client(target))]


def client_input(log: Log, of: Unit, path: Path) -> Path:
    """A log as INPUT.csv of the client."""
    lines = ["time," + ",".join(of.code(n) for n in CHANNELS)]
    lines += [",".join(bits(x) for x in (t, *row)) for t, row in zip(log.time, log.channels, strict=True)]
    path.write_text("\n".join(lines) + "\n")
    return path


def run_client(
    command: Sequence[str], library_: Path, of: Unit, input_: Path, output: Path, *options: str
) -> str:
    """Run the client; what it wrote."""
    environment = {**os.environ, "WINEDEBUG": "-all"}
    run(*command, library_, of.guid, input_, output, *options, env=environment)
    return output.read_text()
