"""Programs that import FMUs, each made to do the same run; FMPy's is the reference.

The run: steps of 1/128 s, so that time is exact however a client counts it, with inputs that change at every step. Each client
has a process of its own: one that crashes is a finding, no more."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from tse.impl import maneuvers
from tse.impl.core import Config, SimConfig
from tse.impl.errors import UserError
from tse.impl.files import atomic
from tse.impl.rows import columns
from tse.impl.simulate import HISTORIES, drive
from tse.impl.tables import markdown_table
from tselab.fmu import platforms
from tselab.fmu.archive import open_archive, read_description, unpacked
from tselab.fmu.build import checkout
from tselab.fmu.run import slave, version_of
from tselab.fmu.validate import Verdict, package_version

STEP = 1 / 128  # s
STEPS = 100
TOLERANCE = 1e-9  # of the largest value of an output: beyond, a difference is a finding
KINDS = ("Real", "Integer", "Boolean")  # Enumerations, Strings and arrays are not compared
KIND_OF = {"Float64": "Real", "Int32": "Integer"}  # of FMI 3.0


@dataclass(frozen=True)
class Plan:
    """What every client is to do."""

    fmu: str
    guid: str
    identifier: str
    step: float
    inputs: dict[str, np.ndarray]  # value per step
    outputs: tuple[str, ...]
    kind: dict[str, str]
    reference: dict[str, int]  # value references
    fmi: str = "2"

    @property
    def steps(self) -> int:
        return len(next(iter(self.inputs.values()))) if self.inputs else STEPS

    def as_json(self) -> str:
        """For a process of its own: nothing runs when it is read."""
        inputs = {name: values.tolist() for name, values in self.inputs.items()}
        return json.dumps({f.name: getattr(self, f.name) for f in dataclasses.fields(self)} | {"inputs": inputs})

    @classmethod
    def from_json(cls, text: str) -> Plan:
        found = json.loads(text)
        inputs = {name: np.array(values, float) for name, values in found["inputs"].items()}
        return cls(**(found | {"inputs": inputs, "outputs": tuple(found["outputs"])}))


def make_plan(path: Path) -> Plan:
    """Inputs that make sense, where we know what they mean; else the start values."""
    description = read_description(path)
    fmi = version_of(description)
    if not fmi or description.coSimulation is None:
        raise UserError(f"{path}: is no co-simulation FMU of FMI 2.0 or 3.0: clients are not compared")
    kinds = {v.name: KIND_OF.get(v.type, v.type) for v in description.modelVariables}
    variables = {v.name: v for v in description.modelVariables if kinds[v.name] in KINDS and not v.dimensions}
    names = {c: [v.name for v in variables.values() if v.causality == c] for c in ("input", "output")}
    step = STEP
    if (
        not description.coSimulation.canHandleVariableCommunicationStepSize
        and description.defaultExperiment is not None
    ):
        step = float(description.defaultExperiment.stepSize or STEP)
    used = [*names["input"], *names["output"]]
    inputs = excitation(set(names["input"]))
    for name, values in inputs.items():
        values[0] = float(variables[name].start)  # clients differ in whether they initialize with the first inputs
    return Plan(
        str(Path(path).resolve()),
        description.guid,
        description.coSimulation.modelIdentifier,
        step,
        inputs,
        tuple(names["output"]),
        {n: kinds[n] for n in used},
        {n: variables[n].valueReference for n in used},
        fmi,
    )


def excitation(inputs: set[str]) -> dict[str, np.ndarray]:
    """A drive, for FMUs that take what a driver does or what a car's sensors say."""

    config = Config({"sample_time": STEP})
    plan = maneuvers.build("square-waves", config, sample_time=STEP, duration=STEP * STEPS, speed=None, amplitude=None, road=[],
                           seed=1)  # fmt: skip
    driver, sensors = drive(plan, config, SimConfig({"seed": 1}))
    for names, table in ((HISTORIES, driver), (columns()[1:], sensors)):
        if set(names) <= inputs:
            return {n: np.array(table[n][:STEPS], float) for n in names}
    return {}


# ---- clients that are Python packages; run in a process of their own, see main()


def run_fmpy(plan: Plan) -> np.ndarray:

    rows = []
    with slave(Path(plan.fmu)) as fmu:
        fmu.initialize(0.0, {}, {})
        for i in range(plan.steps):
            fmu.set({n: v[i] for n, v in plan.inputs.items()})
            fmu.step(i * plan.step, plan.step)
            values = fmu.get(plan.outputs)
            rows.append([values[n] for n in plan.outputs])
    return np.array(rows, float)


def run_ecos(plan: Plan) -> np.ndarray:
    from ecospy import EcosSimulation, EcosSimulationStructure

    structure = EcosSimulationStructure()
    structure.add_model("fmu", plan.fmu)
    rows = []
    with EcosSimulation(step_size=plan.step, structure=structure) as simulation:
        read = {"Real": simulation.get_real, "Integer": simulation.get_integer, "Boolean": simulation.get_bool}
        simulation.init(0)
        for i in range(plan.steps):
            for name, values in plan.inputs.items():
                simulation.set_real(f"fmu::{name}", values[i])
            simulation.step(1)
            rows.append([read[plan.kind[n]](f"fmu::{n}") for n in plan.outputs])
        simulation.terminate()
    return np.array(rows, float)


def run_libcosim(plan: Plan) -> np.ndarray:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimManipulator import CosimManipulator
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.ERROR)
    execution = CosimExecution.from_step_size(round(plan.step * 1e9))
    local = CosimLocalSlave(plan.fmu, "fmu")
    index = execution.add_local_slave(local)
    manipulator, observer = CosimManipulator.create_override(), CosimObserver.create_last_value()
    execution.add_manipulator(manipulator)
    execution.add_observer(observer)
    read = {
        "Real": observer.last_real_values,
        "Integer": observer.last_integer_values,
        "Boolean": observer.last_boolean_values,
    }
    references = [plan.reference[n] for n in plan.inputs]
    groups = {k: [n for n in plan.outputs if plan.kind[n] == k] for k in KINDS}
    rows = []
    for i in range(plan.steps):
        if references:
            manipulator.slave_real_values(index, references, [v[i] for v in plan.inputs.values()])
        if not execution.step():
            raise RuntimeError(f"step {i} failed")
        values = {}
        for kind, names in groups.items():
            if names:
                values.update(zip(names, read[kind](index, [plan.reference[n] for n in names]), strict=True))
        rows.append([values[n] for n in plan.outputs])
    return np.array(rows, float)


ONLY_2 = {"libcosim"}  # clients that know no FMI 3.0
PYTHON_CLIENTS = {"FMPy": ("fmpy", run_fmpy), "ecos": ("ecospy", run_ecos), "libcosim": ("libcosimpy", run_libcosim)}


def main() -> None:
    """What the process of a client does: NAME PLAN RESULT."""
    name, plan, result = sys.argv[1:]
    np.save(result, PYTHON_CLIENTS[name][1](Plan.from_json(Path(plan).read_text(encoding="utf-8"))))


def _in_process(name: str, plan: Plan) -> np.ndarray:
    with tempfile.TemporaryDirectory(prefix="tselab-client-", ignore_cleanup_errors=True) as folder:
        order, result = Path(folder) / "plan", Path(folder) / "result.npy"
        order.write_text(plan.as_json(), encoding="utf-8")
        command = [sys.executable, "-m", "tselab.fmu.clients", name, str(order), str(result)]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=300)
        if not result.is_file():
            last = [x for x in (done.stderr + done.stdout).splitlines() if x.strip()]
            raise ClientError(last[-1].strip() if last else f"exit code {done.returncode}")
        return np.load(result)


# ---- binaries of other platforms, by the small C client of the tests: tests/fmu/client.c says what it reads and writes


@dataclass(frozen=True)
class Foreign:
    """A way to run another platform's binaries."""

    platform: str
    program: str
    command: tuple[str, ...]
    needs: str = ""  # a path without which it does not run


FOREIGN = (
    Foreign("win64", "wine", ("wine",)),
    Foreign(
        "aarch64-linux", "qemu-aarch64", ("qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"), "/usr/aarch64-linux-gnu/lib"
    ),
)
LETTER = {"Real": "r", "Integer": "i", "Boolean": "b"}


class ClientError(Exception):
    """A client that did not do its run."""


def _foreign_client(foreign: Foreign) -> Path:
    """The C client for that platform, compiled when its source is newer."""

    root = checkout()
    source, share = root / "tests" / "fmu" / "client.c", root / ".venv" / "share"
    includes = [f"-I{share / f'fmi{v}' / 'headers'}" for v in platforms.FMI]
    program = root / "build" / "fmu-clients" / f"{foreign.platform}{'.exe' if foreign.platform == 'win64' else ''}"
    if not program.is_file() or program.stat().st_mtime < source.stat().st_mtime:
        program.parent.mkdir(parents=True, exist_ok=True)
        target = platforms.PLATFORMS[foreign.platform].targets[0]
        platforms.zig(["-target", target, "-std=c99", "-O1", *includes, "-DCLIENT_FMI3", str(source), "-o", str(program)],
                      program.parent, root / "build" / "zig-cache")  # fmt: skip
    return program


def _foreign_reason(foreign: Foreign, plan: Plan) -> str:
    """Why it cannot be run here; empty when it can."""

    if platforms.PLATFORMS[foreign.platform].folder(plan.fmi) not in open_archive(Path(plan.fmu)).binaries:
        return f"the FMU has no binary for {foreign.platform}"
    if shutil.which(foreign.program) is None:
        return f"{foreign.program} is not installed"
    if foreign.needs and not Path(foreign.needs).is_dir():
        return f"{foreign.needs}, the C library of {foreign.platform}, is not installed"
    if find_spec("ziglang") is None:
        return "the package ziglang, which compiles the client, is not installed (scripts/setup.sh platforms)"
    try:
        root = checkout()
    except UserError:
        return "its client is part of the checkout"
    return "" if (root / "tests" / "fmu" / "client.c").is_file() else "tests/fmu/client.c is not there"


def run_foreign(foreign: Foreign, plan: Plan) -> np.ndarray:
    client = _foreign_client(foreign)
    suffix = platforms.PLATFORMS[foreign.platform].suffix
    columns = {f"{LETTER[plan.kind[n]]}{plan.reference[n]}": v for n, v in plan.inputs.items()}
    wanted = [f"{LETTER[plan.kind[n]]}{plan.reference[n]}" for n in plan.outputs]
    with unpacked(Path(plan.fmu)) as folder:
        with open(folder / "input.csv", "w", newline="", encoding="ascii") as file:
            out = csv.writer(file, lineterminator="\n")
            out.writerow(["time", *columns])
            for i in range(plan.steps):
                out.writerow([repr(i * plan.step), *(repr(float(v[i])) for v in columns.values())])
        binary = (
            Path("binaries") / platforms.PLATFORMS[foreign.platform].folder(plan.fmi) / f"{plan.identifier}{suffix}"
        )
        command = [
            *foreign.command,
            str(client),
            str(binary),
            plan.guid,
            "input.csv",
            "output.csv",
            "--outputs",
            ",".join(wanted),
        ]
        wine = {"WINEPREFIX": str(client.parent / "wine"), "WINEDEBUG": "-all"}  # not the user's own Windows
        done = subprocess.run(command, cwd=folder, env={**wine, **os.environ}, capture_output=True, text=True, errors="replace",
                              timeout=600)  # fmt: skip
        result = folder / "output.csv"
        if done.returncode or not result.is_file():
            said = [x for x in done.stderr.splitlines() if x.strip()]
            raise ClientError(said[-1] if said else f"exit code {done.returncode}")
        rows = list(csv.DictReader(io.StringIO(result.read_text(encoding="ascii"))))
    return np.array([[_number(row[c]) for c in wanted] for row in rows])


def _number(text: str) -> float:
    return float(np.uint64(int(text[1:], 16)).view(np.float64)) if text.startswith("x") else float(text)


# ---- the comparison


@dataclass(frozen=True)
class Row:
    """One client, one FMU."""

    fmu: str
    client: str
    version: str
    run: str
    difference: float | None  # largest, of an output's largest value; None: did not run
    same_bits: bool = False
    problem: str = ""
    skipped: str = ""
    is_reference: bool = False

    @property
    def text(self) -> str:
        if self.skipped or self.problem:
            return f"skipped: {self.skipped}" if self.skipped else f"failed: {self.problem}"
        if self.is_reference:
            return "reference"
        return "same bits" if self.same_bits else f"{self.difference:.1e}"

    @property
    def is_finding(self) -> bool:
        return bool(self.problem) or (self.difference is not None and not self.difference <= TOLERANCE)


def compare(path: Path, say: Callable[[str], None] = lambda _: None) -> list[Row]:
    """Every client that is here, on one FMU."""
    plan = make_plan(path)
    what = f"{plan.steps} steps, {len(plan.outputs)} outputs"
    name = Path(path).name
    rows = []
    reference = None
    for client, (package, _) in PYTHON_CLIENTS.items():
        version = package_version(package)
        if find_spec(package) is None:
            rows.append(Row(name, client, version, what, None, skipped="not installed (scripts/setup.sh clients)"))
            continue
        if plan.fmi != "2" and client in ONLY_2:
            rows.append(Row(name, client, version, what, None, skipped="knows FMI 1.0 and 2.0 only"))
            continue
        say(f"{name}: {client}")
        row, values = _row(name, client, version, what, lambda c=client: _in_process(c, plan), reference)
        rows.append(row)
        if reference is None:
            if values is None:
                return rows  # nothing to compare with
            reference = values
    for foreign in FOREIGN:
        client = f"C client on {foreign.program}, {foreign.platform}"
        if reason := _foreign_reason(foreign, plan):
            rows.append(Row(name, client, "", what, None, skipped=reason))
            continue
        say(f"{name}: {client}")
        version = _program_version(foreign.program)
        rows.append(_row(name, client, version, what, lambda f=foreign: run_foreign(f, plan), reference)[0])
    return rows


def _row(
    name: str, client: str, version: str, what: str, run: Callable[[], np.ndarray], reference: np.ndarray | None
) -> tuple[Row, np.ndarray | None]:
    try:
        values = run()
    except (ClientError, UserError, subprocess.TimeoutExpired) as error:
        return Row(name, client, version, what, None, problem=str(error)), None
    if reference is None:
        return Row(name, client, version, what, 0.0, same_bits=True, is_reference=True), values
    if values.shape != reference.shape:
        return Row(
            name, client, version, what, None, problem=f"{len(values)} steps instead of {len(reference)}"
        ), values
    return Row(name, client, version, what, difference(values, reference), same_bits(values, reference)), values


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    return bool((np.ascontiguousarray(a).view(np.uint64) == np.ascontiguousarray(b).view(np.uint64)).all())


def difference(values: np.ndarray, reference: np.ndarray) -> float:
    """The largest over all outputs, each relative to its largest value; infinite where only one of them is a number."""
    if (np.isnan(values) != np.isnan(reference)).any():
        return float("inf")
    values, reference = np.nan_to_num(values), np.nan_to_num(reference)
    size = np.abs(reference).max(axis=0)
    return float((np.abs(values - reference).max(axis=0) / np.where(size > 0, size, 1.0)).max())


def _program_version(program: str) -> str:
    done = subprocess.run([program, "--version"], capture_output=True, text=True, errors="replace")
    found = re.search(r"\d+\.\d+[.\d]*", done.stdout)
    return found[0] if found else ""


# ---- What README states of validators and clients. Without dates and timings: a run that finds the same changes nothing.


def write(folder: Path, verdicts: Mapping[str, Sequence[Verdict]], rows: Sequence[Row]) -> list[Path]:
    """Write the tables; what was skipped is not in them."""
    written = [folder / "fmu_validators.md"]
    with atomic(written[0]) as file:
        file.write(validators(verdicts))
    ran = [r for r in rows if not r.skipped]
    if ran:
        written += [folder / "fmu_clients.md"]
        with atomic(written[1]) as file:
            file.write(clients(ran))
    return written


def validators(verdicts: Mapping[str, Sequence[Verdict]]) -> str:
    """Findings per validator and FMU."""
    names = list(verdicts)
    rows = []
    ran = {n: {v.validator: v for v in verdicts[n] if not v.skipped} for n in names}
    for validator, number in {v.validator: v.version for found in ran.values() for v in found.values()}.items():
        counts = [str(len(ran[n][validator].findings)) if validator in ran[n] else "-" for n in names]
        rows.append([validator, number, *counts])
    return "\n".join(markdown_table(["validator", "version", *(f"{n}: findings" for n in names)], rows, 2)) + "\n"


def clients(rows: Sequence[Row]) -> str:
    """Largest difference to FMPy per client and FMU."""
    runs = {r.fmu: r.run for r in rows}
    table = []
    for client, number in dict.fromkeys((r.client, r.version) for r in rows):
        cells = [next((r.text for r in rows if (r.client, r.fmu) == (client, n)), "-") for n in runs]
        table.append([client, number, *cells])
    head = ["client", "version", *(f"{name}, {run}" for name, run in runs.items())]
    return "\n".join(markdown_table(head, table, len(head))) + "\n"


if __name__ == "__main__":
    main()
