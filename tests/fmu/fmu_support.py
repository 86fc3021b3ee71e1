"""Shared by the FMU tests: build the FMUs, run them through FMPy, replay a drive.

The same drive runs through an FMU and through the C library.
"""

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


def read_connections() -> set[tuple[str, str]]:
    """Return the system's connections from vehicle outputs to estimator inputs."""
    ssd = ElementTree.parse(ROOT / "fmu" / "StiffnessStudy.ssd")
    return {
        (c.get("startConnector"), c.get("endConnector"))
        for c in ssd.iter("{http://ssp-standard.org/SSP1/SystemStructureDescription}Connection")
        if (c.get("startElement"), c.get("endElement")) == ("vehicle", "estimator")
    }


def find_headers(fmi: str = "2") -> Path:
    """Return the folder of the FMI headers, where scripts/setup.sh puts them."""
    return ROOT / ".venv" / "share" / f"fmi{fmi}" / "headers"


@functools.cache
def build(folder: str = "fmu", *options: str) -> Path:
    """Build the FMUs with the preset fmu, and return the folder of the .fmu files.

    Only what changed is built again.
    """
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
    sources = [
        f"-DFETCHCONTENT_SOURCE_DIR_FMI{v}={find_headers(v).parent}" for v in FMI if find_headers(v).is_dir()
    ]
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
        """Return a variable's code for tests/fmu/client.c, such as r12.

        FMI 2.0 reads an Enumeration with the functions of Integer.
        """
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


def list_exports(binary: Path) -> set[str]:
    """Return the names that a shared library of this machine exports."""
    return {line.split()[-1] for line in run("nm", "-D", "--defined-only", binary).stdout.splitlines()}


@functools.cache
def make_scratch_folder() -> Path:
    """Return a folder that lasts as long as the tests."""
    return Path(tempfile.mkdtemp(prefix="tse-fmu-"))


@functools.cache
def load_unit(model: str, folder: str = "fmu") -> Unit:
    """Return an FMU of a build."""
    fmu = (build() if folder == "fmu" else ROOT / "build" / folder / "fmu") / f"{model}.fmu"
    return Unit(fmu, make_scratch_folder() / folder / model)


# ---- one instance


class Instance:
    """One instance, with variables by name.

    `log` holds its messages: (instance, status, category, text).
    """

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
        """Free the instance.

        FMPy's freeInstance() unloads the library, which states of other instances still
        need.
        """
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
        """Return values by name; without names all outputs."""
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
        """Return the fmi2Status of the step; raise on an error."""
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
        """Return values by name, those of an array as a list."""
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


def format_bits(x: float) -> str:
    """Return a Real in the form of tests/fmu/client.c."""
    return "x" + struct.pack(">d", x).hex()


class Log:
    """Times and channels of a log; NaN is missing."""

    def __init__(self, time: np.ndarray, channels: np.ndarray):
        self.time, self.channels = time, channels

    def __len__(self) -> int:
        return len(self.time)

    def step(self, i: int) -> float:
        """Step to the next row; the last step is as long as the one before."""
        return float(
            self.time[i + 1] - self.time[i] if i + 1 < len(self) else self.time[i] - self.time[i - 1]
        )

    def part(self, first: int, last: int) -> Log:
        return Log(self.time[first:last], self.channels[first:last])

    def through_library(self, settings: Mapping[str, float] | Config, form: str | None = None) -> np.ndarray:
        """Return a row of the core's outputs per row."""
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
        """Return a dictionary of the FMU's outputs per row."""
        rows = []
        for i in range(first, len(self) if last is None else last):
            instance.set(dict(zip(CHANNELS, self.channels[i], strict=True)))
            assert instance.step(float(self.time[i]), self.step(i)) <= fmi2Warning
            rows.append(instance.get())
        return rows


def make_parameters(settings: Mapping[str, float], of: Unit) -> dict[str, float]:
    """Return tse_config_exact() with these settings, under the estimator's names."""
    known = {
        n.partition(".")[2].replace(".", "_"): n
        for n, v in of.variables.items()
        if v.causality == "parameter"
    }
    return {**KNOWN, **{known[name]: value for name, value in settings.items()}}


def compute_expected_outputs(row: np.void, config: Config) -> dict[str, float]:
    """Return the estimator FMU's outputs for this row of the C library."""
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


def has_same_bits(a: float, b: float) -> bool:
    """Return whether both have the same bits."""
    return struct.pack(REAL_BITS, float(a)) == struct.pack(REAL_BITS, float(b))


def expect_same_rows(got: Iterable[Mapping[str, float]], expected: Iterable[Mapping[str, float]]) -> None:
    """Check that every output of every row has the same bits; name those that differ."""
    for i, (a, b) in enumerate(zip(got, expected, strict=True)):
        assert a.keys() == b.keys(), sorted(a.keys() ^ b.keys())
        wrong = [f"row {i}: {n} is {a[n]!r}, expected {b[n]!r}" for n in b if not has_same_bits(a[n], b[n])]
        assert not wrong, "\n".join(wrong[:10])


def read_recorded_drive(rows: int | None = None) -> Log:
    """Read tests/replay/drive.csv."""
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


def explain_unavailable(target: str) -> str:
    """Return why programs of this platform cannot be run here; empty: they can."""
    if subprocess.run([sys.executable, "-m", "ziglang", "version"], capture_output=True).returncode:
        return "ziglang is not installed (scripts/setup.sh platforms)"
    runner = RUNNERS[target][1]
    if runner and not shutil.which(runner[0]):
        return f"{runner[0]} is not installed"
    if target == "aarch64-linux" and not Path("/usr/aarch64-linux-gnu/lib").is_dir():
        return "there is no C library for aarch64 in /usr/aarch64-linux-gnu (Debian: libc6-arm64-cross)"
    return ""


@functools.cache
def build_library(target: str, of: Unit) -> Path:
    """Build the FMU's shared library for a platform, as `tselab fmu build` does."""
    build()
    platform = PLATFORMS[target]
    result = make_scratch_folder() / target / of.fmu.stem / (of.identifier + platform.suffix)
    result.parent.mkdir(parents=True, exist_ok=True)
    sources = ROOT / "build" / "fmu" / "fmu" / of.fmu.stem / "sources"
    result.write_bytes(compile_for(platform, sources, CACHE, read_version(of.fmu.stem)))
    return result


@functools.cache
def build_client(target: str) -> Path:
    program = make_scratch_folder() / f"client-{target}{RUNNERS[target][0]}"
    fmi = (
        ["-DCLIENT_FMI3", *(f"-I{find_headers(v)}" for v in FMI)]
        if find_headers("3").is_dir()
        else [f"-I{find_headers()}"]
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


def make_client_command(target: str) -> list[str]:
    """Return the command of tests/fmu/client.c on a platform."""
    return [*RUNNERS[target][1], str(build_client(target))]


def write_client_input(log: Log, of: Unit, path: Path) -> Path:
    """Write a log as INPUT.csv of the client."""
    lines = ["time," + ",".join(of.code(n) for n in CHANNELS)]
    lines += [
        ",".join(format_bits(x) for x in (t, *row)) for t, row in zip(log.time, log.channels, strict=True)
    ]
    path.write_text("\n".join(lines) + "\n")
    return path


def run_client(
    command: Sequence[str], library_: Path, of: Unit, input_: Path, output: Path, *options: str
) -> str:
    """Run the client; what it wrote."""
    environment = {**os.environ, "WINEDEBUG": "-all"}
    run(*command, library_, of.guid, input_, output, *options, env=environment)
    return output.read_text()
