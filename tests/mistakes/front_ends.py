"""The six front ends of the library: each runs a log, and returns its validity and
warnings."""

import base64
import functools
import io
import json
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
for folder in ("scripts", "scripts/dev", "tests/fmu"):
    if str(ROOT / folder) not in sys.path:
        sys.path.insert(0, str(ROOT / folder))

import page as page_maker  # noqa: E402

import tse  # noqa: E402
from tests.mistakes.drives import AXLES, CAR, CHANNELS, STEP, Drive, LogOf, format_vehicle  # noqa: E402
from tse.library.core import library  # noqa: E402

STIFFNESS = ("cx_front", "cy_front", "cy_rear")
# columns that rows.c writes
COLUMNS = ("status", *(f"{s}_reason" for s in STIFFNESS), "fault_channel", "fault_factor")
HERE = Path(__file__).parent


@dataclass(frozen=True)
class Response:
    """The outputs of a front end for a log."""

    status: np.ndarray  # (rows,)
    valid: np.ndarray  # (rows, 3), of STIFFNESS
    channel: list[str | None]
    factor: np.ndarray
    words: tuple[str, ...] = ()  # warnings about the whole log
    usable: bool = True  # False: no value of the log is usable

    @property
    def against(self) -> np.ndarray:
        """Return the rows that are refused or implausible."""
        return (self.status < 0) | (self.status == library().status("TSE_W_IMPLAUSIBLE"))

    @property
    def silent(self) -> bool:
        """Return whether a stiffness is valid in the last 30 s without any warning."""
        last = self.valid[-round(30 / STEP) :].any()
        return bool(last and self.usable and not self.against[-round(30 / STEP) :].any())


def _name_channels(codes: np.ndarray) -> list[str | None]:
    names = [None, *(f.name for f in [*library().channels, *library().optional])]
    return [names[int(c)] for c in codes]


def _make_response(columns: Mapping[str, object], words: Sequence[str] = (), usable: bool = True) -> Response:
    """Return the response from columns; a stiffness is valid where its reason is 0."""
    c = {name: np.asarray(x, float) for name, x in columns.items()}
    valid = (np.column_stack([c[f"{s}_reason"] for s in STIFFNESS]) == 0) & (c["status"] >= 0)[:, None]
    return Response(
        c["status"].astype(int),
        valid,
        _name_channels(c["fault_channel"]),
        c["fault_factor"],
        tuple(words),
        usable,
    )


def _make_frame(log: LogOf) -> pd.DataFrame:
    return pd.DataFrame({c: log[c] for c in ("time", *CHANNELS)})


def _run(*command: object, **more: object) -> str:
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, check=False, timeout=120, **more
    )  # type: ignore[call-overload]
    if done.returncode:
        raise RuntimeError(f"{command[0]}: {done.returncode}\n{done.stdout[-1000:]}{done.stderr[-2000:]}")
    return str(done.stdout)


@functools.cache
def make_scratch_folder() -> Path:
    """Return a temporary folder for files that are built once."""
    return Path(tempfile.mkdtemp(prefix="tse-mistakes-"))


@functools.cache
def _build_program() -> Path:
    """Build rows.c with the library as two files; return the program."""
    two, program = make_scratch_folder() / "two", make_scratch_folder() / "rows"
    _run(sys.executable, ROOT / "scripts" / "dev" / "amalgamate.py", "--out", two / "tse")
    _run(
        "cc",
        "-O2",
        "-ffp-contract=off",
        f"-I{two}",
        HERE / "rows.c",
        two / "tse" / "tse.c",
        "-lm",
        "-o",
        program,
    )
    return program


def run_c(drive: Drive, log: LogOf) -> Response:
    """Run a log through a C program."""
    car = [repr(drive.car[k]) for k in CAR]
    text = _make_frame(log).to_csv(index=False, na_rep="nan")
    out = _run(_build_program(), int(drive.known), *car, AXLES[drive.driven], input=text)
    return _make_response(dict(zip(COLUMNS, np.loadtxt(io.StringIO(out)).T, strict=True)))


def _run_fmu(drive: Drive, log: LogOf, fmi: str) -> Response:
    """Run a log through the FMU of this FMI version, with FMPy."""
    from fmu_support import ESTIMATOR, Instance, load_unit
    from test_fmi3 import Instance3

    parameters = {f"vehicle.{k}": drive.car[k] for k in CAR} | {"filter.driven_axle": AXLES[drive.driven]}
    parameters["vehicle.exact"] = drive.known
    wanted = [f"estimate.{c}" for c in COLUMNS]
    time, values = log["time"], np.column_stack([log[c] for c in CHANNELS])
    rows = np.empty((len(time), len(wanted)))
    with Instance(load_unit(ESTIMATOR)) if fmi == "2" else Instance3(load_unit(f"{ESTIMATOR}-fmi3")) as one:
        one.start(parameters)
        kinds = [one.unit.variables[n] for n in wanted]
        # codes are Enumerations
        real, whole = ("getReal", "getInteger") if fmi == "2" else ("getFloat64", "getInt64")
        put = getattr(one.slave, "setReal" if fmi == "2" else "setFloat64")
        inputs = [one.unit.variables[c].valueReference for c in CHANNELS]
        get = [
            (getattr(one.slave, real if v.type in ("Real", "Float64") else whole), v.valueReference)
            for v in kinds
        ]
        for i, t in enumerate(time):
            put(inputs, list(map(float, values[i])))
            if fmi == "2":
                one.step(float(t), STEP)
            else:
                one.slave.doStep(currentCommunicationPoint=float(t), communicationStepSize=STEP)
            rows[i] = [f([reference])[0] for f, reference in get]
    return _make_response(dict(zip(COLUMNS, rows.T, strict=True)))


def _convert_table(table: pd.DataFrame, words: Sequence[str]) -> Response:
    """Return the response from a table of Python or the command, which has valid, no
    reason."""
    reasons = {f"{s}_reason": 1 - table[f"{s}_valid"] for s in STIFFNESS}
    return _make_response({c: table[c] for c in COLUMNS if c not in reasons} | reasons, words, not words)


def _write_vehicle(drive: Drive) -> Path:
    file = make_scratch_folder() / f"{drive.driven}-{drive.known}-{drive.car['mass']}.toml"
    file.write_text(format_vehicle(drive), encoding="utf-8")
    return file


def run_python(drive: Drive, log: LogOf) -> Response:
    """Run a log through tse.estimate()."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            result = tse.estimate(_make_frame(log), _write_vehicle(drive), calibrate=False)
        except tse.Error as error:
            return _make_refusal(log, str(error))
    return _convert_table(result.table, result.warnings)


def run_command(drive: Drive, log: LogOf) -> Response:
    """Run a log through tselab estimate LOG.csv --vehicle CAR.toml."""
    folder = Path(tempfile.mkdtemp(dir=make_scratch_folder()))
    _make_frame(log).to_csv(folder / "log.csv", index=False)
    command = [
        sys.executable,
        "-m",
        "tselab",
        "estimate",
        "log.csv",
        "--vehicle",
        _write_vehicle(drive),
        "--no-calibrate",
        "--out",
        "est.csv",
    ]
    done = subprocess.run(
        list(map(str, command)), cwd=folder, capture_output=True, text=True, check=False, timeout=600
    )
    found = folder / "est.csv"
    if not found.exists():
        if done.returncode != 2:
            raise RuntimeError(done.stderr[-2000:])
        return _make_refusal(log, done.stderr.strip())
    words = tuple(line for line in done.stderr.splitlines() if line.startswith("warning: check"))
    table = pd.read_csv(found)
    shutil.rmtree(folder)
    return _convert_table(table, words)


def _make_refusal(log: LogOf, text: str) -> Response:
    """Return the response to a log that is refused as a whole."""
    n = len(log["time"])
    refused = np.full(n, library().status("TSE_E_INPUT"))
    return Response(refused, np.zeros((n, 3), bool), [None] * n, np.zeros(n), (text,), False)


@functools.cache
def _load_page() -> tuple[dict[str, object], str]:
    """Return the tables of the page, and its library."""
    return page_maker.collect_names(), base64.b64encode(page_maker.compile_wasm()).decode()


def run_page(drive: Drive, log: LogOf) -> Response:
    """Run a log through the scripts of the page and its WebAssembly, in node."""
    knows, wasm = _load_page()
    job = {
        "scripts": str(page_maker.SOURCES),
        "page": knows,
        "wasm": wasm,
        "known": drive.known,
        "car": {**drive.car, "driven_axle": AXLES[drive.driven]},
        "time": log["time"].tolist(),
        "channels": {c: np.nan_to_num(log[c]).tolist() for c in CHANNELS},
    }
    file = make_scratch_folder() / "job.json"
    file.write_text(json.dumps(job), encoding="utf-8")
    found = json.loads(_run("node", HERE / "page.mjs", file))
    columns = {c: [np.nan if x is None else x for x in found["columns"][c]] for c in COLUMNS}
    return _make_response(columns, found["said"], not found["said"])


FRONT_ENDS: dict[str, Callable[[Drive, LogOf], Response]] = {
    "C": run_c,
    "FMI 2.0": functools.partial(_run_fmu, fmi="2"),
    "FMI 3.0": functools.partial(_run_fmu, fmi="3"),
    "Python": run_python,
    "command": run_command,
    "page": run_page,
}
