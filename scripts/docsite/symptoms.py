"""Run commands of tselab on a log or a vehicle file that contains a mistake. The
troubleshooting page shows each command and its output."""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import pandas as pd
from click.testing import CliRunner

import tse
from tse.library.errors import UserError
from tse.report.tables import simulated_vehicle
from tselab.cli import cli

# [s] Duration of the simulated drive. In this time, tselab can decide whether a stiffness
# is usable.
DRIVE_DURATION = 6.0
ESTIMATE = "estimate log.csv --vehicle car.toml"
ERROR_PREFIX = "tselab: error"


def edit_car(old: str, new: str) -> Callable[[pd.DataFrame, Path], object]:
    """Return a function that writes car.toml: the vehicle file of the simulated car, in
    which the string `old` is replaced by `new`."""
    return lambda log, folder: (folder / "car.toml").write_text(
        simulated_vehicle().replace(old, new), encoding="utf-8"
    )


CASES: dict[str, tuple[Callable[[pd.DataFrame, Path], object], str, str]] = {
    # Key: name of a mistake that users make. Value:
    # 1. function that makes the mistake: it returns a wrong log or writes a wrong file
    # 2. arguments with which tselab is called on this log and these files
    # 3. text with which a line of the output begins: the page shows the first such line
    #    and the indented lines after it. "": the page shows errors, warnings, notes and
    #    the lines about the stiffnesses
    "column": (lambda log, _: log.drop(columns="steer_angle"), ESTIMATE, ERROR_PREFIX),
    "neither": (lambda log, _: log.drop(columns=["accel_y", "yaw_rate"]), ESTIMATE, ERROR_PREFIX),
    "degrees": (
        lambda log, _: log.assign(steer_angle=57.3 * 15 * log["steer_angle"]),
        ESTIMATE,
        ERROR_PREFIX,
    ),
    "cell": (
        lambda log, _: log.assign(accel_y=log["accel_y"].astype(object).where(log.index != 9, "n.b.")),
        ESTIMATE,
        "",
    ),
    "clock": (
        lambda log, _: pd.concat([log.iloc[:300], log.iloc[200:]]),
        f"{ESTIMATE} --verbose",
        "note: time",
    ),
    "format": (
        lambda _, folder: (folder / "log.mf4").write_bytes(b"hello\n"),
        ESTIMATE.replace("csv", "mf4"),
        ERROR_PREFIX,
    ),
    "range": (edit_car("mass = 1900.0", "mass = 1900000.0"), ESTIMATE, ERROR_PREFIX),
    "key": (edit_car("mass = 1900.0", "masse = 1900.0"), ESTIMATE, ERROR_PREFIX),
    "setting": (lambda log, _: log, f"{ESTIMATE} --set masss=1900", ERROR_PREFIX),
    "learnt": (
        lambda _, folder: (folder / "car.tse").write_bytes(b"tsel" + bytes(108)),
        f"{ESTIMATE} --load-learnt car.tse",
        ERROR_PREFIX,
    ),
    "table": (lambda log, _: log, f"{ESTIMATE} --table found.xls", ERROR_PREFIX),
    "unit": (lambda log, _: log.assign(accel_y=log["accel_y"] / 9.81), ESTIMATE, ""),
    "sign": (lambda log, _: log.assign(accel_y=-log["accel_y"]), ESTIMATE, ""),
}


def run_case(name: str) -> tuple[int, str]:
    """Make the mistake `name` of CASES in a new folder and run its command there. Return
    the exit code and the output."""
    make, arguments, _ = CASES[name]
    log, before = tse.simulate("square-waves", duration=DRIVE_DURATION).log, Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "car.toml").write_text(simulated_vehicle(), encoding="utf-8")
        made = make(log, Path(folder))
        (made if isinstance(made, pd.DataFrame) else log).to_csv(Path(folder) / "log.csv", index=False)
        os.chdir(folder)
        try:
            done = CliRunner().invoke(cli, [*arguments.split(), "--no-progress"], standalone_mode=False)
        finally:
            os.chdir(before)
    if isinstance(done.exception, UserError):  # tselab.cli.main() prints it and returns 2
        return 2, f"{done.output}{ERROR_PREFIX}: {done.exception}"
    if done.exception is not None:
        raise done.exception
    return int(done.return_value or 0), done.output


def show_case(name: str) -> str:
    """Return, in Markdown, the command for the mistake `name` of CASES and the relevant
    lines of its output."""
    code, said = run_case(name)
    _, arguments, begins = CASES[name]
    lines = [line for line in said.splitlines() if line.strip()]
    if begins:
        at = next(i for i, line in enumerate(lines) if line.startswith(begins))
        found = [lines[at], *(x for x in lines[at + 1 :][:3] if x.startswith("  "))]
    else:
        found = [
            line
            for line in lines
            if line.startswith((ERROR_PREFIX, "front,", "rear,", "note", "warning", "  "))
        ]
    found = [line if len(line) < 260 else line[:250] + " ..." for line in found[:5]]
    return "\n".join(["```text", f"$ tselab {arguments}", *found, f"(exit code {code})", "```"])
