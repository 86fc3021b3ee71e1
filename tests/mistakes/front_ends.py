"""The six ways into the library: each takes a drive with a log, and returns what is said of its rows."""

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
for folder in ("scripts/dev", "tests/fmu"):
    if str(ROOT / folder) not in sys.path:
        sys.path.insert(0, str(ROOT / folder))

import page as page_maker  # noqa: E402

import tse  # noqa: E402
from tests.mistakes.drives import AXLES, CAR, CHANNELS, STEP, Drive, LogOf, vehicle_file  # noqa: E402
from tse.library.core import library  # noqa: E402

STIFFNESS = ("cx_front", "cy_front", "cy_rear")
COLUMNS = (
    "status",
    *(f"{s}_reason" for s in STIFFNESS),
    "fault_channel",
    "fault_factor",
)  # what rows.c writes of a row
HERE = Path(__file__).parent


@dataclass(frozen=True)
class Said:
    """What a front end says of a log, per row; `words` of the whole log."""

    status: np.ndarray
    valid: np.ndarray  # (n, 3)
    channel: list[str | None]
    factor: np.ndarray
    words: tuple[str, ...] = ()
    usable: bool = True  # False: it says that no value of this log is

    @property
    def against(self) -> np.ndarray:
        """Rows that are refused or implausible."""
        return (self.status < 0) | (self.status == library().status("TSE_W_IMPLAUSIBLE"))

    @property
    def silent(self) -> bool:
        """Whether a stiffness is valid in the last half minute and nobody has said anything against it."""
        last = self.valid[-round(30 / STEP) :].any()
        return bool(last and self.usable and not self.against[-round(30 / STEP) :].any())


def _named(codes: np.ndarray) -> list[str | None]:
    names = [None, *(f.name for f in [*library().channels, *library().optional])]
    return [names[int(c)] for c in codes]


def _of_rows(columns: Mapping[str, object], words: Sequence[str] = (), usable: bool = True) -> Said:
    """Columns of a front end by the names of the library's outputs: a stiffness is valid where its reason is 0."""
    c = {name: np.asarray(x, float) for name, x in columns.items()}
    valid = (np.column_stack([c[f"{s}_reason"] for s in STIFFNESS]) == 0) & (c["status"] >= 0)[:, None]
    return Said(
        c["status"].astype(int), valid, _named(c["fault_channel"]), c["fault_factor"], tuple(words), usable
    )


def _frame(log: LogOf) -> pd.DataFrame:
    return pd.DataFrame({c: log[c] for c in ("time", *CHANNELS)})


def _call(*command: object, **more: object) -> str:
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, check=False, timeout=120, **more
    )  # type: ignore[call-overload]
    if done.returncode:
        raise RuntimeError(f"{command[0]}: {done.returncode}\n{done.stdout[-1000:]}{done.stderr[-2000:]}")
    return str(done.stdout)


@functools.cache
def scratch() -> Path:
    """A folder for what is built once."""
    return Path(tempfile.mkdtemp(prefix="tse-mistakes-"))


@functools.cache
def _program() -> Path:
    """rows.c and the library as two files."""
    two, program = scratch() / "two", scratch() / "rows"
    _call(sys.executable, ROOT / "scripts" / "dev" / "amalgamate.py", "--out", two / "tse")
    _call(
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


def through_c(drive: Drive, log: LogOf) -> Said:
    """A program of C."""
    car = [repr(drive.car[k]) for k in CAR]
    text = _frame(log).to_csv(index=False, na_rep="nan")
    out = _call(_program(), int(drive.known), *car, AXLES[drive.driven], input=text)
    return _of_rows(dict(zip(COLUMNS, np.loadtxt(io.StringIO(out)).T, strict=True)))


def _through_fmu(drive: Drive, log: LogOf, fmi: str) -> Said:
    from fmu_support import ESTIMATOR, Instance, unit
    from test_fmi3 import Instance3

    parameters = {f"vehicle.{k}": drive.car[k] for k in CAR} | {"filter.driven_axle": AXLES[drive.driven]}
    parameters["vehicle.exact"] = drive.known
    wanted = [f"estimate.{c}" for c in COLUMNS]
    time, values = log["time"], np.column_stack([log[c] for c in CHANNELS])
    rows = np.empty((len(time), len(wanted)))
    with Instance(unit(ESTIMATOR)) if fmi == "2" else Instance3(unit(f"{ESTIMATOR}-fmi3")) as one:
        one.start(parameters)
        kinds = [one.unit.variables[n] for n in wanted]
        real, whole = (
            ("getReal", "getInteger") if fmi == "2" else ("getFloat64", "getInt64")
        )  # codes are Enumerations
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
    return _of_rows(dict(zip(COLUMNS, rows.T, strict=True)))


def _of_table(table: pd.DataFrame, words: Sequence[str]) -> Said:
    """What Python and the command give: validity in place of a reason."""
    reasons = {f"{s}_reason": 1 - table[f"{s}_valid"] for s in STIFFNESS}
    return _of_rows({c: table[c] for c in COLUMNS if c not in reasons} | reasons, words, not words)


def _vehicle(drive: Drive) -> Path:
    file = scratch() / f"{drive.driven}-{drive.known}-{drive.car['mass']}.toml"
    file.write_text(vehicle_file(drive), encoding="utf-8")
    return file


def through_python(drive: Drive, log: LogOf) -> Said:
    """tse.estimate() with a data frame. Error: it takes no such log."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            result = tse.estimate(_frame(log), _vehicle(drive), calibrate=False)
        except tse.Error as error:
            return _refused(log, str(error))
    return _of_table(result.table, result.warnings)


def through_command(drive: Drive, log: LogOf) -> Said:
    """tselab estimate LOG.csv --vehicle CAR.toml."""
    folder = Path(tempfile.mkdtemp(dir=scratch()))
    _frame(log).to_csv(folder / "log.csv", index=False)
    command = [
        sys.executable,
        "-m",
        "tselab",
        "estimate",
        "log.csv",
        "--vehicle",
        _vehicle(drive),
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
        return _refused(log, done.stderr.strip())
    words = tuple(line for line in done.stderr.splitlines() if line.startswith("warning: check"))
    table = pd.read_csv(found)
    shutil.rmtree(folder)
    return _of_table(table, words)


def _refused(log: LogOf, text: str) -> Said:
    n = len(log["time"])
    refused = np.full(n, library().status("TSE_E_INPUT"))
    return Said(refused, np.zeros((n, 3), bool), [None] * n, np.zeros(n), (text,), False)


@functools.cache
def _page() -> tuple[dict[str, object], str]:
    """What the page knows, and its library."""
    return page_maker.known(), base64.b64encode(page_maker.wasm()).decode()


def through_page(drive: Drive, log: LogOf) -> Said:
    """The scripts of the page and its WebAssembly, in node."""
    knows, wasm = _page()
    job = {
        "scripts": str(page_maker.SOURCES), "page": knows, "wasm": wasm, "known": drive.known,
        "car": {**drive.car, "driven_axle": AXLES[drive.driven]},
        "time": log["time"].tolist(), "channels": {c: np.nan_to_num(log[c]).tolist() for c in CHANNELS},
    }  # fmt: skip
    file = scratch() / "job.json"
    file.write_text(json.dumps(job), encoding="utf-8")
    found = json.loads(_call("node", HERE / "page.mjs", file))
    columns = {c: [np.nan if x is None else x for x in found["columns"][c]] for c in COLUMNS}
    return _of_rows(columns, found["said"], not found["said"])


FRONT_ENDS: dict[str, Callable[[Drive, LogOf], Said]] = {
    "C": through_c,
    "FMI 2.0": functools.partial(_through_fmu, fmi="2"),  # through FMPy
    "FMI 3.0": functools.partial(_through_fmu, fmi="3"),
    "Python": through_python,
    "command": through_command,
    "page": through_page,
}
