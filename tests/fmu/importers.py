"""Validate the FMUs, and run them in programs that import FMUs; FMPy is the reference.

    .venv/bin/python tests/fmu/importers.py

builds the FMUs of all platforms, checks them and writes the tables of scripts/results.

All clients do the same run. Its steps of 1/128 s are exact in binary, so every client has
the same time, however it counts. Inputs change at every step. Each client has a process
of its own, so that a crash is recorded as a finding. A client that is not installed is
listed as such and counts as no finding.
"""

import ctypes
import functools
import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from fmpy.validation import validate_fmu
from fmu_support import (
    CHANNELS,
    RUNNERS,
    VEHICLE,
    Instance,
    Instance3,
    Unit,
    explain_unavailable,
    format_bits,
    make_client_command,
    run_client,
)
from lxml import etree

from tse.library.core import Config, SimConfig
from tse.report.tables import format_markdown_table
from tse.simulation import maneuvers
from tse.simulation.simulate import HISTORIES, drive
from tselab.fmu_build import PLATFORMS, build, read_version

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "scripts" / "results"
STEP, STEPS = 1 / 128, 100  # s
TOOLBOX = "fmu_manipulation_toolbox"
TBB = "libtbb.so.12"
KINDS = {
    "Real": "Real",
    "Float64": "Real",
    "Integer": "Integer",
    "Int32": "Integer",
    "Boolean": "Boolean",
}  # compared


@dataclass
class Verdict:
    """What one validator says."""

    validator: str
    version: str
    findings: list[str] = field(default_factory=list)
    skipped: str = ""  # why it did not run


def validate(fmu: Path) -> list[Verdict]:
    """Run all validators."""
    with zipfile.ZipFile(fmu) as archive:
        of_3 = etree.fromstring(archive.read("modelDescription.xml")).get("fmiVersion", "").startswith("3.")
    fmpy = Verdict("FMPy validate_fmu", version("fmpy"), validate_fmu(str(fmu)))
    return [fmpy, check_by_fmutool(fmu), check_schema(fmu, of_3), check_by_vdmcheck(fmu, of_3)]


def run_program(*command: str | Path) -> tuple[list[str], int]:
    done = subprocess.run(
        [str(c) for c in command],
        capture_output=True,
        text=True,
        errors="replace",
        timeout=300,
        env={**os.environ, "LC_ALL": "C"},
    )
    return [x.strip() for x in (done.stdout + done.stderr).splitlines() if x.strip()], done.returncode


def check_by_fmutool(fmu: Path) -> Verdict:
    program = f"import sys; from {TOOLBOX}.cli.fmutool import fmutool; sys.exit(fmutool())"
    lines, code = run_program(sys.executable, "-c", program, "-input", fmu, "-check")
    said = [x.partition("|")[2].strip() for x in lines if x.startswith(("ERROR", "CRITICAL", "WARNING"))]
    found = [text for text in said if "error(s)" not in text]  # without its sums
    return Verdict(
        "fmutool -check", version("fmu-manipulation-toolbox"), found or lines[-1:] if code else found
    )


def check_schema(fmu: Path, of_3: bool) -> Verdict:
    """Check against the standard's XML schemas, which the toolbox carries.

    FMI 2.0.5 takes some files of FMI 3.0.
    """
    verdict = Verdict("XML schema", "FMI 3.0.2" if of_3 else "FMI 2.0.4")
    folder = Path(find_spec(TOOLBOX).submodule_search_locations[0]) / "resources"
    schemas = {
        "modelDescription.xml": "fmi-3.0/fmi3ModelDescription.xsd"
        if of_3
        else "fmi-2.0/fmi2ModelDescription.xsd",
        "terminalsAndIcons/terminalsAndIcons.xml": "fmi-3.0/fmi3TerminalsAndIcons.xsd",
        "sources/buildDescription.xml": "fmi-3.0/fmi3BuildDescription.xsd",
    }
    with zipfile.ZipFile(fmu) as archive:
        for name in schemas.keys() & set(archive.namelist()):
            rules = etree.XMLSchema(etree.parse(str(folder / schemas[name])))
            if not rules.validate(etree.fromstring(archive.read(name))):
                verdict.findings += [f"{name}: line {e.line}: {e.message}" for e in rules.error_log]
    return verdict


# ---- VDMCheck: a formal model of the standard. It is under the GPL, so it is run where
# it is installed, and is never part of tse.

VDMCHECK = "1.1.3"
POM = f"""<project xmlns="http://maven.apache.org/POM/4.0.0">
  <modelVersion>4.0.0</modelVersion><groupId>tse</groupId><artifactId>vdmcheck</artifactId><version>1</version>
  <dependencies><dependency>
    <groupId>org.into-cps.vdmcheck.fmi2</groupId><artifactId>vdmcheck2</artifactId><version>{VDMCHECK}</version>
  </dependency></dependencies>
</project>
"""
VDMCHECK_FOLDER = Path(sys.prefix) / "share" / f"vdmcheck-{VDMCHECK}"


def fetch_vdmcheck() -> None:
    """Fetch VDMCheck with Maven, once."""
    if (VDMCHECK_FOLDER / "vdmcheck2.jar").is_file() or not shutil.which("mvn"):
        return
    with tempfile.TemporaryDirectory(dir=VDMCHECK_FOLDER.parent, ignore_cleanup_errors=True) as scratch:
        jars, pom = Path(scratch) / "jars", Path(scratch) / "pom.xml"
        pom.write_text(POM)
        if run_program("mvn", "-q", "-B", "-f", pom, "dependency:copy-dependencies", "-DincludeScope=runtime",
                   "-Dmdep.stripVersion=true", f"-DoutputDirectory={jars}")[1]:  # fmt: skip
            return
        for name in ("rule-model", "static-model", "vdmcheck2"):  # it looks for its model in files beside it
            with zipfile.ZipFile(jars / f"{name}.jar") as jar:
                jar.extractall(jars, [n for n in jar.namelist() if n.startswith("fmi2")])
        jars.rename(VDMCHECK_FOLDER)


def check_by_vdmcheck(fmu: Path, of_3: bool) -> Verdict:
    jar = VDMCHECK_FOLDER / "vdmcheck2.jar"
    if of_3 or not shutil.which("java") or not jar.is_file():
        why = (
            "that of FMI 3.0 is in no registry"
            if of_3
            else "needs Java, and Maven that fetches it (importers.py)"
        )
        return Verdict("VDMCheck", VDMCHECK, skipped=why)
    with tempfile.TemporaryDirectory() as folder:
        plain = shutil.copyfile(
            fmu, Path(folder) / "model.fmu"
        )  # it goes by the ending, and knows ASCII only
        lines, _ = run_program("java", "-jar", jar, plain)
    found = [x for x in lines if x != "Errors found." and not x.startswith("https://")]
    return Verdict(
        "VDMCheck", VDMCHECK, [] if "No errors found." in lines else found or ["failed without a word"]
    )


# ---- clients


def make_inputs(of: Unit) -> dict[str, np.ndarray]:
    """Return a drive by step: the driver's inputs, or the sensors' readings."""
    config = Config.exact({"sample_time": STEP})
    plan = maneuvers.build("square-waves", config, sample_time=STEP, duration=STEP * STEPS)
    driver, sensors = drive(plan, config, SimConfig({"seed": 1}))
    names, table = (HISTORIES, driver) if of.identifier == VEHICLE else (CHANNELS, sensors)
    inputs = {n: np.array(table[n][:STEPS], float) for n in names}
    for name, values in inputs.items():
        values[0] = float(
            of.variables[name].start
        )  # clients differ in whether they initialize with the first inputs
    return inputs


def list_outputs(of: Unit) -> list[str]:
    return [n for n in of.outputs if of.variables[n].type in KINDS and not of.variables[n].dimensions]


def run_fmpy(of: Unit) -> list[list[float]]:
    rows, inputs, outputs = [], make_inputs(of), list_outputs(of)
    with (Instance3 if read_version(of.fmu.stem) == "3" else Instance)(of) as fmu:
        fmu.start()
        for i in range(STEPS):
            fmu.set({n: v[i] for n, v in inputs.items()})
            fmu.step(i * STEP, STEP)
            values = fmu.get(outputs)
            rows.append([values[n] for n in outputs])
    return rows


def load_tbb() -> None:
    """Load libtbb.so.12, which the library of ecos needs and does not bring.

    That of the Python package tbb is preferred to that of the system. Raises OSError
    where there is neither.
    """
    of_package = Path(sys.prefix) / "lib" / TBB
    ctypes.CDLL(str(of_package) if of_package.is_file() else TBB, mode=ctypes.RTLD_GLOBAL)


def find_obstacle(client: str, fmi: str) -> str:
    """Return why a client that is a Python package cannot run here; empty if it can."""
    if find_spec(PYTHON[client][0]) is None:
        return "not installed (scripts/setup.sh clients)"
    if client == "libcosim" and fmi == "3":
        return "knows FMI 1.0 and 2.0 only"
    if client == "ecos" and sys.platform == "linux":
        if not shutil.which("unzip"):
            return "unzip, which ecos calls, is not installed"
        try:
            load_tbb()
        except OSError:
            return f"{TBB} is not installed (Python package tbb, or libtbb12 of Debian)"
    return ""


def run_ecos(of: Unit) -> list[list[float]]:
    if sys.platform == "linux":
        load_tbb()
    from ecospy import EcosSimulation, EcosSimulationStructure

    structure = EcosSimulationStructure()
    structure.add_model("fmu", str(of.fmu))
    rows, inputs, outputs = [], make_inputs(of), list_outputs(of)
    with EcosSimulation(step_size=STEP, structure=structure) as simulation:
        read = {
            "Real": simulation.get_real,
            "Integer": simulation.get_integer,
            "Boolean": simulation.get_bool,
        }
        simulation.init(0)
        for i in range(STEPS):
            for name, values in inputs.items():
                simulation.set_real(f"fmu::{name}", values[i])
            simulation.step(1)
            rows.append([read[KINDS[of.variables[n].type]](f"fmu::{n}") for n in outputs])
        simulation.terminate()
    return rows


def run_libcosim(of: Unit) -> list[list[float]]:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.ERROR)
    execution = CosimExecution.from_step_size(round(STEP * 1e9))
    index = execution.add_local_slave(CosimLocalSlave(str(of.fmu), "fmu"))
    manipulator, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
    execution.add_manipulator(manipulator)
    execution.add_observer(observer)
    read = {k: getattr(observer, f"last_{k.lower()}_values") for k in ("Real", "Integer", "Boolean")}
    rows, inputs, outputs = [], make_inputs(of), list_outputs(of)
    for i in range(STEPS):
        references = [of.variables[n].valueReference for n in inputs]
        manipulator.slave_real_values(index, references, [v[i] for v in inputs.values()])
        assert execution.step(), f"step {i} failed"
        values = {}
        for kind in read:
            names = [n for n in outputs if KINDS[of.variables[n].type] == kind]
            if names:
                references = [of.variables[n].valueReference for n in names]
                values.update(zip(names, read[kind](index, references), strict=True))
        rows.append([values[n] for n in outputs])
    return rows


PYTHON = {"FMPy": ("fmpy", run_fmpy), "ecos": ("ecospy", run_ecos), "libcosim": ("libcosimpy", run_libcosim)}
FOREIGN = {"win64": "wine", "aarch64-linux": "qemu-aarch64"}  # whose binaries run here, and by which program
CLIENTS = (*(c for c in PYTHON if c != "FMPy"), *FOREIGN)  # that are compared with FMPy


class Failed(Exception):
    """A client that did not do its run."""


def in_process(client: str, of: Unit) -> np.ndarray:
    """Run a client that is a Python package, in a process of its own."""
    with tempfile.TemporaryDirectory(prefix="tse-client-", ignore_cleanup_errors=True) as folder:
        result = Path(folder) / "result.npy"
        lines, code = run_program(sys.executable, __file__, client, of.fmu, result)
        if not result.is_file():
            raise Failed(lines[-1] if lines else f"exit code {code}")
        return np.load(result)


def run_foreign(target: str, of: Unit) -> np.ndarray:
    """Run tests/fmu/client.c with the binary of another platform."""
    to, inputs = PLATFORMS[target], make_inputs(of)
    wanted = [of.code(n) for n in list_outputs(of)]
    lines = [",".join(["time", *map(of.code, inputs)])]
    lines += [
        ",".join(format_bits(x) for x in (i * STEP, *(v[i] for v in inputs.values()))) for i in range(STEPS)
    ]
    (of.folder / "input.csv").write_text("\n".join(lines) + "\n")
    binary = of.folder / "binaries" / to.folder(read_version(of.fmu.stem)) / (of.identifier + to.suffix)
    try:
        command = make_client_command(target)
        files = of.folder / "input.csv", of.folder / "output.csv"
        text = run_client(command, binary, of, *files, "--outputs", ",".join(wanted))
    except RuntimeError as error:
        raise Failed(str(error).splitlines()[-1]) from None
    head, *rows = (line.split(",") for line in text.splitlines())
    return np.array([[parse_number(row[head.index(c)]) for c in wanted] for row in rows])


def parse_number(text: str) -> float:
    return float(np.uint64(int(text[1:], 16)).view(np.float64)) if text.startswith("x") else float(text)


@dataclass(frozen=True)
class Row:
    """One client, one FMU."""

    client: str
    version: str
    says: str  # "same bits", or the largest difference to FMPy over all outputs, each over its largest value
    ran: bool = True


def compare(of: Unit) -> list[Row]:
    """Run every client on one FMU; the first row is FMPy's, the reference."""
    reference = in_process("FMPy", of)
    rows = [Row("FMPy", version("fmpy"), "reference")]
    return rows + [compare_one(client, of, reference) for client in CLIENTS]


def compare_one(client: str, of: Unit, reference: np.ndarray) -> Row:
    """Run one of CLIENTS on one FMU."""
    fmi = read_version(of.fmu.stem)
    if client in PYTHON:
        package = PYTHON[client][0]
        if why := find_obstacle(client, fmi):
            return Row(client, "", f"skipped: {why}", False)
        return Row(
            client,
            version(package),
            describe_difference(functools.partial(in_process, client, of), reference),
        )
    program, target = FOREIGN[client], client
    name = f"C client on {program}, {target}"
    there = (of.folder / "binaries" / PLATFORMS[target].folder(fmi)).is_dir()
    if why := explain_unavailable(target) if there else f"the FMU has no binary for {target}":
        return Row(name, "", f"skipped: {why}", False)
    number = re.search(r"\d+\.\d+[.\d]*", " ".join(run_program(*RUNNERS[target][1][:1], "--version")[0]))
    return Row(
        name,
        number[0] if number else "",
        describe_difference(functools.partial(run_foreign, target, of), reference),
    )


def describe_difference(run: Callable[[], np.ndarray], reference: np.ndarray) -> str:
    """Describe how a client's run differs from the reference."""
    try:
        values = run()
    except (Failed, subprocess.TimeoutExpired) as error:
        return f"failed: {error}"
    if values.shape != reference.shape:
        return f"failed: {len(values)} steps instead of {len(reference)}"
    if values.tobytes() == reference.tobytes():
        return "same bits"
    if (np.isnan(values) != np.isnan(reference)).any():
        return "failed: no number where FMPy has one, or the other way round"
    size = np.nan_to_num(np.abs(reference)).max(axis=0)
    return (
        f"{(np.nan_to_num(np.abs(values - reference)).max(axis=0) / np.where(size > 0, size, 1.0)).max():.1e}"
    )


# ---- tables; without dates and timings: a run that finds the same changes nothing


def make_validators_table(verdicts: dict[str, Sequence[Verdict]]) -> str:
    """Tabulate the findings per validator and FMU.

    A check that was skipped everywhere is left out.
    """
    ran = {n: {v.validator: v for v in found if not v.skipped} for n, found in verdicts.items()}
    rows = []
    for name, number in {v.validator: v.version for found in ran.values() for v in found.values()}.items():
        rows.append(
            [name, number, *(str(len(ran[n][name].findings)) if name in ran[n] else "-" for n in ran)]
        )
    return (
        "\n".join(format_markdown_table(["validator", "version", *(f"{n}: findings" for n in ran)], rows, 2))
        + "\n"
    )


def make_clients_table(found: dict[str, list[Row]], heads: list[str]) -> str:
    """Tabulate the largest difference to FMPy per client and FMU.

    A variable that every client skips is left out.
    """
    ran = {n: {r.client: r for r in rows if r.ran} for n, rows in found.items()}
    table = []
    for name, number in {r.client: r.version for rows in ran.values() for r in rows.values()}.items():
        table.append([name, number, *(ran[n][name].says if name in ran[n] else "-" for n in ran)])
    return "\n".join(format_markdown_table(["client", "version", *heads], table, len(heads) + 2)) + "\n"


def main() -> int:
    """Run everything; with CLIENT FMU RESULT, run one client in this process."""
    if len(sys.argv) == 4:
        client, fmu, result = sys.argv[1:]
        with tempfile.TemporaryDirectory() as folder:
            np.save(result, np.array(PYTHON[client][1](Unit(Path(fmu), Path(folder))), float))
        return 0
    fetch_vdmcheck()
    made = build(ROOT / "build" / "fmus", tuple(PLATFORMS), None, lambda text: print(text, file=sys.stderr))
    fmus = sorted(b.path for b in made if b.path.suffix == ".fmu")
    verdicts = {f.name: validate(f) for f in fmus}
    with tempfile.TemporaryDirectory() as folder:
        units = {f.name: Unit(f, Path(folder) / f.stem) for f in fmus}
        clients = {name: compare(of) for name, of in units.items()}
        heads = [f"{name}, {STEPS} steps, {len(list_outputs(of))} outputs" for name, of in units.items()]
    text = f"{make_clients_table(clients, heads)}\n{make_validators_table(verdicts)}"
    (RESULTS / "fmu_importers.md").write_text(text)
    print(text)
    bad = [text for found in verdicts.values() for v in found for text in v.findings]
    bad += [
        f"{n}: {r}"
        for n, rows in clients.items()
        for r in rows
        if r.ran and r.says not in ("reference", "same bits")
    ]
    print(*bad, sep="\n", end="")
    return int(bool(bad))


if __name__ == "__main__":
    sys.exit(main())
