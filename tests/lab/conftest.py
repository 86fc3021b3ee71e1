"""Shared by the tselab tests: run the command as a user does; one simulated drive."""

import contextlib
import io
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tse.library.core import Config, SimConfig, Simulator
from tselab.cli import main

COMMAND = [sys.executable, "-m", "tselab"]
RAN = (0, 3, 4)  # exit codes of an estimate that is written: usable, in part, nothing usable


@dataclass
class Result:
    code: int
    out: str
    err: str


def tselab(*args: object, cwd: Path | None = None) -> Result:
    """Run the command line to its end."""
    done = subprocess.run([*COMMAND, *map(str, args)], cwd=cwd, capture_output=True, text=True, timeout=300)
    return Result(done.returncode, done.stdout, done.stderr)


def tselab_here(*args: object, cwd: Path | None = None) -> Result:
    """Run the command in this process, since the start of Python takes a second.

    Every command that runs long is run as a process in some test, too, as a user does.
    """
    out, err = io.StringIO(), io.StringIO()
    argv, folder = sys.argv, Path.cwd()
    try:
        sys.argv = ["tselab", *map(str, args)]
        os.chdir(cwd or folder)
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            pytest.raises(SystemExit) as end,
        ):
            main()
    finally:
        sys.argv = argv
        os.chdir(folder)
    return Result(end.value.code, out.getvalue(), err.getvalue())


def simulated(config: dict[str, float], sim: dict[str, float], dt: float, **driver: np.ndarray) -> np.ndarray:
    """Return rows of the simulator for the driver's inputs, on a road of level 1."""
    simulator, rows = Simulator(Config.exact(config), SimConfig(sim)), len(driver["steer_angle"])
    inputs, outputs = simulator.inputs(rows), simulator.outputs(rows)
    for name, values in {"dt": dt, "road_level": 1.0, **driver}.items():
        inputs[name] = values
    for i in range(rows):
        simulator.step_into(inputs, outputs, i)
    return outputs


@dataclass
class Drive:
    """A simulated drive on disk."""

    folder: Path
    log: Path
    truth: Path
    vehicle: Path

    def table(self) -> pd.DataFrame:
        return pd.read_csv(self.log, dtype=str)


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cache of calibrations that is not the user's."""
    folder = tmp_path_factory.getbasetemp() / "cache"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder


@pytest.fixture(scope="session")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    """20 s of the paper's square waves."""
    folder = tmp_path_factory.mktemp("drive")
    vehicle, log, truth = folder / "car.toml", folder / "log.csv", folder / "truth.csv"
    vehicle.write_text(tselab("vehicle", "--simulated").out, encoding="utf-8")
    done = tselab(
        "simulate",
        "--maneuver",
        "square-waves",
        "--duration",
        20,
        "--vehicle",
        vehicle,
        "--out",
        log,
        "--truth",
        truth,
        "--seed",
        3,
        "--with-ref",
    )
    assert done.code == 0, done.err
    return Drive(folder, log, truth, vehicle)
