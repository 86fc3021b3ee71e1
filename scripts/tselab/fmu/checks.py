"""What importers complain about, and no validator looks at: binaries, documentation, sources."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from lxml import etree

from tselab.fmu import platforms
from tselab.fmu.archive import Archive, unpacked
from tselab.fmu.platforms import Binary, read_binary

COMMON = """fmi2GetTypesPlatform fmi2GetVersion fmi2SetDebugLogging fmi2Instantiate fmi2FreeInstance fmi2SetupExperiment
    fmi2EnterInitializationMode fmi2ExitInitializationMode fmi2Terminate fmi2Reset fmi2GetReal fmi2GetInteger fmi2GetBoolean
    fmi2GetString fmi2SetReal fmi2SetInteger fmi2SetBoolean fmi2SetString fmi2GetFMUstate fmi2SetFMUstate fmi2FreeFMUstate
    fmi2SerializedFMUstateSize fmi2SerializeFMUstate fmi2DeSerializeFMUstate fmi2GetDirectionalDerivative"""
CO_SIMULATION = """fmi2SetRealInputDerivatives fmi2GetRealOutputDerivatives fmi2DoStep fmi2CancelStep fmi2GetStatus
    fmi2GetRealStatus fmi2GetIntegerStatus fmi2GetBooleanStatus fmi2GetStringStatus"""
MODEL_EXCHANGE = """fmi2EnterEventMode fmi2NewDiscreteStates fmi2EnterContinuousTimeMode fmi2CompletedIntegratorStep fmi2SetTime
    fmi2SetContinuousStates fmi2GetDerivatives fmi2GetEventIndicators fmi2GetContinuousStates
    fmi2GetNominalsOfContinuousStates"""

# FMI 3.0 wants all functions of all kinds exported, as old importers load them without asking; those of clocks and events, too.
FMI3 = """fmi3GetVersion fmi3SetDebugLogging fmi3InstantiateModelExchange fmi3InstantiateCoSimulation
    fmi3InstantiateScheduledExecution fmi3FreeInstance fmi3EnterInitializationMode fmi3ExitInitializationMode fmi3EnterEventMode
    fmi3Terminate fmi3Reset fmi3GetFloat32 fmi3GetFloat64 fmi3GetInt8 fmi3GetUInt8 fmi3GetInt16 fmi3GetUInt16 fmi3GetInt32
    fmi3GetUInt32 fmi3GetInt64 fmi3GetUInt64 fmi3GetBoolean fmi3GetString fmi3GetBinary fmi3GetClock fmi3SetFloat32 fmi3SetFloat64
    fmi3SetInt8 fmi3SetUInt8 fmi3SetInt16 fmi3SetUInt16 fmi3SetInt32 fmi3SetUInt32 fmi3SetInt64 fmi3SetUInt64 fmi3SetBoolean
    fmi3SetString fmi3SetBinary fmi3SetClock fmi3GetNumberOfVariableDependencies fmi3GetVariableDependencies fmi3GetFMUState
    fmi3SetFMUState fmi3FreeFMUState fmi3SerializedFMUStateSize fmi3SerializeFMUState fmi3DeserializeFMUState
    fmi3GetDirectionalDerivative fmi3GetAdjointDerivative fmi3EnterConfigurationMode fmi3ExitConfigurationMode
    fmi3GetIntervalDecimal fmi3GetIntervalFraction fmi3GetShiftDecimal fmi3GetShiftFraction fmi3SetIntervalDecimal
    fmi3SetIntervalFraction fmi3SetShiftDecimal fmi3SetShiftFraction fmi3EvaluateDiscreteStates fmi3UpdateDiscreteStates
    fmi3EnterContinuousTimeMode fmi3CompletedIntegratorStep fmi3SetTime fmi3SetContinuousStates fmi3GetContinuousStateDerivatives
    fmi3GetEventIndicators fmi3GetContinuousStates fmi3GetNominalsOfContinuousStates fmi3GetNumberOfEventIndicators
    fmi3GetNumberOfContinuousStates fmi3EnterStepMode fmi3GetOutputDerivatives fmi3DoStep fmi3ActivateModelPartition"""

# Folder -> system and machines that its binary must be for.
FOLDERS = {
    "linux64": ("linux", ("x86_64",)),
    "linux32": ("linux", ("x86",)),
    "win64": ("windows", ("x86_64",)),
    "win32": ("windows", ("x86",)),
    "darwin64": ("darwin", ("x86_64",)),  # other slices may be in it
    **{f"{m}-{s}": (s, (m,)) for m in ("x86_64", "x86", "aarch64") for s in ("linux", "windows", "darwin")},
}
FOLDERS3 = {f"{m}-{s}": (s, (m,)) for m in ("x86_64", "x86", "aarch64") for s in ("linux", "windows", "darwin")}
SUFFIX = {"linux": ".so", "windows": ".dll", "darwin": ".dylib"}
C_LIBRARY = {
    "linux": ("libc.so.6", "libm.so.6", "libpthread.so.0", "libdl.so.2", "librt.so.1", "ld-linux"),
    "windows": ("kernel32.dll", "msvcrt.dll", "ucrtbase.dll", "ntdll.dll", "api-ms-win-crt-"),
    "darwin": ("/usr/lib/libsystem.",),
}
OLD_GLIBC = (2, 17)  # of 2012; what needs a newer one is refused by long-lived systems


def check(archive: Archive) -> list[str]:
    """All findings, one sentence each."""
    try:
        root = etree.fromstring(archive.read("modelDescription.xml"))
    except etree.XMLSyntaxError as error:
        return [f"modelDescription.xml is not well-formed: {error}"]
    of_3 = is_3(root)
    described = _description3(root) if of_3 else _description(root)
    return [
        *described,
        *_experiment(root),
        *_content(archive, of_3),
        *_binaries(archive, root, of_3),
        *_sources(archive),
    ]


def is_3(root: etree._Element) -> bool:
    return root.get("fmiVersion", "").startswith("3.")


def _description3(root: etree._Element) -> Iterator[str]:
    units = {t.get("name") for t in root.iterfind("TypeDefinitions/*") if t.get("unit")}
    for v in root.iterfind("ModelVariables/*"):
        name = v.get("name")
        if not v.get("description"):
            yield f"{name} has no description"
        if v.tag in ("Float32", "Float64") and not v.get("unit") and v.get("declaredType") not in units:
            yield f"{name} has no unit"
        if (
            v.get("causality") in ("input", "parameter")
            and v.get("start") is None
            and v.find("Start") is None
            and v.tag != "Clock"
        ):
            yield f"{name} has no start value"


def _description(root: etree._Element) -> Iterator[str]:
    units = {t.get("name") for t in root.iterfind("TypeDefinitions/SimpleType") if t.find("Real") is not None
             and t.find("Real").get("unit")}  # fmt: skip
    for v in root.iterfind("ModelVariables/ScalarVariable"):
        name, kind = v.get("name"), next((c for c in v if c.tag != "Annotations"), None)
        if not v.get("description"):
            yield f"{name} has no description"
        if kind is None:
            yield f"{name} has no type"
        elif kind.tag == "Real" and not kind.get("unit") and kind.get("declaredType") not in units:
            yield f"{name} has no unit"
        if kind is not None and v.get("causality") in ("input", "parameter") and kind.get("start") is None:
            yield f"{name} has no start value"


def _experiment(root: etree._Element) -> Iterator[str]:
    experiment = root.find("DefaultExperiment")
    lacking = [
        a for a in ("startTime", "stopTime", "stepSize", "tolerance") if experiment is None or experiment.get(a) is None
    ]
    if lacking:
        yield f"DefaultExperiment has no {', '.join(lacking)}"


def _content(archive: Archive, of_3: bool) -> Iterator[str]:
    if "documentation/index.html" not in archive.names:
        yield "there is no documentation/index.html"
    if not any(n.startswith("documentation/licenses/") for n in archive.names):
        yield "there is no licence in documentation/licenses"
    if (picture := "terminalsAndIcons/icon.png" if of_3 else "model.png") not in archive.names:
        yield f"there is no {picture}"
    if not archive.binaries:
        yield "there is no binary"


def _binaries(archive: Archive, root: etree._Element, of_3: bool) -> Iterator[str]:
    kinds = {"CoSimulation": CO_SIMULATION, "ModelExchange": MODEL_EXCHANGE}
    if of_3:
        kinds = {"CoSimulation": "", "ModelExchange": "", "ScheduledExecution": ""}
    required, folders = (set(FMI3.split()), FOLDERS3) if of_3 else (set(COMMON.split()), FOLDERS)
    identifiers = set()
    for element, names in kinds.items():
        if (found := root.find(element)) is not None:
            required.update(names.split())
            identifiers.add(found.get("modelIdentifier"))
    for folder, names in archive.binaries.items():
        if folder not in folders:
            yield f"binaries/{folder}: FMI {'3.0' if of_3 else '2.0.4'} knows no such platform"
            continue
        system, machines = folders[folder]
        for identifier in identifiers:
            if f"binaries/{folder}/{identifier}{SUFFIX[system]}" not in names:
                yield f"binaries/{folder}: there is no {identifier}{SUFFIX[system]}"
        for name in names:
            if PurePosixPath(name).stem not in identifiers:
                continue  # a library that the binary brings along
            binary = read_binary(archive.read(name))
            if binary is None or binary.system != system or not set(machines) <= set(binary.machines):
                what = f"for {binary.system} on {', '.join(binary.machines)}" if binary else "no shared library"
                yield f"{name}: is {what}"
            else:
                beside = {PurePosixPath(n).name.lower() for n in names}
                yield from (f"{name}: {text}" for text in _binary(binary, required, beside, of_3))


def _binary(binary: Binary, required: set[str], beside: set[str], of_3: bool) -> Iterator[str]:
    if missing := sorted(required - binary.exports):
        yield f"does not export {', '.join(missing)}"
    if more := sorted(n for n in binary.exports if n not in required and not n.startswith("fmi3" if of_3 else "fmi2")):
        some = ", ".join(n if len(n) < 40 else f"{n[:36]} ..." for n in more[:3])
        yield f"exports {len(more)} names that are not of FMI, which may clash with others': {some}"
    allowed = C_LIBRARY[binary.system]
    if foreign := [n for n in binary.needs if not n.lower().startswith(allowed) and n.lower() not in beside]:
        yield f"needs {', '.join(foreign)}, which is not in the FMU"
    if binary.glibc > OLD_GLIBC:
        yield f"needs glibc {'.'.join(map(str, binary.glibc))}: systems older than that cannot load it"
    if binary.executable_stack:
        yield "asks for an executable stack: hardened systems refuse it"
    if not binary.signed:
        yield "is not signed: macOS on arm64 refuses it"


def _sources(archive: Archive) -> Iterator[str]:
    """Do the sources compile, alone, to a library without open ends? Only where buildDescription.xml says how."""
    if "sources/buildDescription.xml" not in archive.names:
        if any(n.startswith("sources/") for n in archive.names):
            yield "sources/ has no buildDescription.xml, so importers cannot compile it"
        return
    compiler = next((c for c in ("cc", "gcc", "clang") if shutil.which(c)), None)
    if compiler is None or os.name == "nt":
        return
    with unpacked(archive.path) as folder, tempfile.TemporaryDirectory() as out:
        sources = folder / "sources"
        try:
            build = platforms.read_build(sources)
        except (etree.XMLSyntaxError, AttributeError, KeyError) as error:
            yield f"sources/buildDescription.xml cannot be used: {error!r}"
            return
        flags = [f for f in build.flags if not f.startswith("-O")]  # whether it compiles does not depend on how well
        command = [
            compiler,
            *flags,
            "-O0",
            *platforms.SHARED,
            "-I.",
            *build.sources,
            "-o",
            str(Path(out) / "model"),
            "-lm",
        ]
        done = subprocess.run(command, cwd=sources, capture_output=True, text=True, errors="replace")
        if done.returncode:
            yield f"sources/ does not compile: {done.stderr.strip().splitlines()[0] if done.stderr.strip() else 'no message'}"
