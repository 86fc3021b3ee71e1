"""The six ways into the library: each takes a drive with a log, and returns what is said of its rows."""

from __future__ import annotations

import base64
import functools
import io
import json
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
for folder in ("scripts", "tests/fmu"):
    if str(ROOT / folder) not in sys.path:
        sys.path.insert(0, str(ROOT / folder))

import page as page_maker  # noqa: E402

import tse  # noqa: E402
from tests.mistakes.drives import AXLES, CAR, CHANNELS, STEP, Drive, LogOf, vehicle_file  # noqa: E402
from tse.impl.core import library  # noqa: E402

STIFFNESS = ("cx_front", "cy_front", "cy_rear")
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


def _of_rows(rows: np.ndarray) -> Said:
    status = rows[:, 0].astype(int)
    return Said(status, (rows[:, 1:4] == 0) & (status >= 0)[:, None], _named(rows[:, 4]), rows[:, 5])


def _frame(log: LogOf) -> pd.DataFrame:
    return pd.DataFrame({c: log[c] for c in ("time", *CHANNELS)})


def _call(*command: object, **more: object) -> str:
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False, timeout=120, **more)  # type: ignore[call-overload]
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
    two = scratch() / "two"
    _call(sys.executable, ROOT / "scripts" / "amalgamate.py", "--out", two / "tse")
    _call(
        "cc",
        "-O2",
        "-ffp-contract=off",
        f"-I{two}",
        HERE / "rows.c",
        two / "tse" / "tse.c",
        "-lm",
        "-o",
        scratch() / "rows",
    )
    return scratch() / "rows"


def through_c(drive: Drive, log: LogOf) -> Said:
    """A program of C."""
    car = [repr(drive.car[k]) for k in CAR]
    out = _call(
        _program(), int(drive.known), *car, AXLES[drive.driven], input=_frame(log).to_csv(index=False, na_rep="nan")
    )
    return _of_rows(np.loadtxt(io.StringIO(out)))


def _through_fmu(drive: Drive, log: LogOf, fmi: str) -> Said:
    from fmu_support import ESTIMATOR, Instance, unit
    from test_fmi3 import Instance3

    parameters = {f"vehicle.{k}": drive.car[k] for k in CAR} | {"filter.driven_axle": AXLES[drive.driven]}
    parameters["vehicle.calibrated"] = drive.known
    wanted = [
        "estimate.status",
        *(f"estimate.{s}_reason" for s in STIFFNESS),
        "estimate.fault_channel",
        "estimate.fault_factor",
    ]
    time, values = log["time"], np.column_stack([log[c] for c in CHANNELS])
    rows = np.empty((len(time), len(wanted)))
    with Instance(unit(ESTIMATOR)) if fmi == "2" else Instance3(unit(f"{ESTIMATOR}-fmi3")) as one:
        one.start(parameters)
        kinds = [one.unit.variables[n] for n in wanted]
        real, whole = ("getReal", "getInteger") if fmi == "2" else ("getFloat64", "getInt64")  # codes are Enumerations
        put = getattr(one.slave, "setReal" if fmi == "2" else "setFloat64")
        inputs = [one.unit.variables[c].valueReference for c in CHANNELS]
        get = [(getattr(one.slave, real if v.type in ("Real", "Float64") else whole), v.valueReference) for v in kinds]
        for i, t in enumerate(time):
            put(inputs, list(map(float, values[i])))
            if fmi == "2":
                one.step(float(t), STEP)
            else:
                one.slave.doStep(currentCommunicationPoint=float(t), communicationStepSize=STEP)
            rows[i] = [f([reference])[0] for f, reference in get]
    return _of_rows(rows)


def through_fmi2(drive: Drive, log: LogOf) -> Said:
    """The FMU of FMI 2.0, through FMPy."""
    return _through_fmu(drive, log, "2")


def through_fmi3(drive: Drive, log: LogOf) -> Said:
    """The FMU of FMI 3.0, through FMPy."""
    return _through_fmu(drive, log, "3")


def _of_table(table: pd.DataFrame, words: tuple[str, ...], usable: bool) -> Said:
    valid = table[[f"{s}_valid" for s in STIFFNESS]].to_numpy(bool)
    return Said(
        table["status"].to_numpy(int),
        valid,
        _named(table["fault_channel"]),
        table["fault_factor"].to_numpy(float),
        words,
        usable,
    )


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
    return _of_table(result.table, result.warnings, not result.warnings)


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
    done = subprocess.run(list(map(str, command)), cwd=folder, capture_output=True, text=True, check=False, timeout=600)
    found = folder / "est.csv"
    if not found.exists():
        if done.returncode != 2:
            raise RuntimeError(done.stderr[-2000:])
        return _refused(log, done.stderr.strip())
    words = tuple(line for line in done.stderr.splitlines() if line.startswith("warning: check"))
    table = pd.read_csv(found)
    shutil.rmtree(folder)
    return _of_table(table, words, not words)


def _refused(log: LogOf, text: str) -> Said:
    n = len(log["time"])
    return Said(
        np.full(n, library().status("TSE_E_INPUT")), np.zeros((n, 3), bool), [None] * n, np.zeros(n), (text,), False
    )


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
    c = {
        name: np.array([np.nan if x is None else x for x in column], float) for name, column in found["columns"].items()
    }
    said = _of_rows(
        np.column_stack([c["status"], *(c[f"{s}_reason"] for s in STIFFNESS), c["fault_channel"], c["fault_factor"]])
    )
    return Said(said.status, said.valid, said.channel, said.factor, tuple(found["said"]), not found["said"])


FRONT_ENDS: dict[str, Callable[[Drive, LogOf], Said]] = {
    "C": through_c,
    "FMI 2.0": through_fmi2,
    "FMI 3.0": through_fmi3,
    "Python": through_python,
    "command": through_command,
    "page": through_page,
}
