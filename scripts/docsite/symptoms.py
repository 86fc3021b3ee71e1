"""Troubleshooting by symptom: what the tools print. Each case is run when docsite.fill writes the page."""

import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

DURATION = 6.0  # s of simulated drive: enough for a verdict, short enough for every build


@dataclass(frozen=True)
class Symptom:
    """A mistake, how it is made of a good log and vehicle file, and what cures it."""

    title: str
    make: Callable[[pd.DataFrame, Path], None]  # writes log.csv and car.toml, or others, into the folder
    arguments: str
    says: str  # how the line begins that is looked for: tselab: error, note, warning
    cause: str
    remedy: str


def _log(change: Callable[[pd.DataFrame], pd.DataFrame]) -> Callable[[pd.DataFrame, Path], None]:
    return lambda log, folder: change(log.copy()).to_csv(folder / "log.csv", index=False)


def _vehicle(old: str, new: str) -> Callable[[pd.DataFrame, Path], None]:
    def make(_log: pd.DataFrame, folder: Path) -> None:
        path = folder / "car.toml"
        text = path.read_text(encoding="utf-8")
        if old not in text:
            raise ValueError(f"{old!r} is not in the example of a vehicle file")
        path.write_text(text.replace(old, new), encoding="utf-8")

    return make


def _file(name: str, content: bytes) -> Callable[[pd.DataFrame, Path], None]:
    return lambda _log, folder: (folder / name).write_bytes(content) and None


def _scaled(channel: str, factor: float) -> Callable[[pd.DataFrame, Path], None]:
    return _log(lambda log: log.assign(**{channel: log[channel] * factor}))


ESTIMATE = "estimate log.csv --vehicle car.toml"
CASES = (
    Symptom(
        "A column is missing",
        _log(lambda x: x.drop(columns="steer_angle")),
        ESTIMATE,
        "tselab: error",
        "The log has other names, or the channel is not in it.",
        "`tselab signals LOG --write signals.toml` proposes which signal is which channel: [logs](../use/logs.md#signalstoml). "
        "Steering angle and time cannot be done without.",
    ),
    Symptom(
        "Neither accel_y nor yaw_rate",
        _log(lambda x: x.drop(columns=["accel_y", "yaw_rate"])),
        ESTIMATE,
        "tselab: error",
        "Without either, side forces are not observable.",
        "Log one of them at least; both are much better.",
    ),
    Symptom(
        "Degrees, or the steering wheel's angle",
        _scaled("steer_angle", 57.3 * 15),
        ESTIMATE,
        "tselab: error",
        "`steer_angle` is that of the road wheels in rad.",
        '`unit = "deg"` and `ratio` in [signals.toml](../use/logs.md#signalstoml).',
    ),
    Symptom(
        "A cell that is no number",
        _log(lambda x: x.assign(accel_y=x["accel_y"].astype(object).where(x.index != 9, "n.b."))),
        ESTIMATE,
        "",
        "Text in a column of numbers.",
        "It counts as missing, as an empty cell does, and is said; mend the row that is named, if it is not meant so.",
    ),
    Symptom(
        "A time that goes back",
        _log(lambda x: pd.concat([x.iloc[:300], x.iloc[200:]])),
        ESTIMATE,
        "note: time",
        "Two recordings in one file, or a clock that was set.",
        "Cut the log there, if what follows is another drive.",
    ),
    Symptom(
        "Not a log that is known",
        _file("log.mf4", b"hello\n"),
        "estimate log.mf4 --vehicle car.toml",
        "tselab: error",
        "The file is cut off, or of another format than its name says.",
        "Copy it again; [formats](../use/logs.md#formats).",
    ),
    Symptom(
        "A setting of the vehicle is out of range",
        _vehicle("mass = 1900.0", "mass = 1900000.0"),
        ESTIMATE,
        "tselab: error",
        "Grams for kilograms, millimetres for metres.",
        "SI units; every range: [tse_config](../reference/config.md).",
    ),
    Symptom(
        "A key that nobody knows",
        _vehicle("mass = 1900.0", "masse = 1900.0"),
        ESTIMATE,
        "tselab: error",
        "A slip of the pen. It is refused, because a rule would take its place silently.",
        "The sentence says what may be meant. Tables of your own, `[notes]`, are left alone.",
    ),
    Symptom(
        "A setting on the command line is not known",
        _log(lambda x: x),
        f"{ESTIMATE} --set masss=1900",
        "tselab: error",
        "No such setting.",
        "`tselab settings` lists all.",
    ),
    Symptom(
        "A learnt state is refused",
        _file("car.tse", b"tsel" + bytes(108)),
        f"{ESTIMATE} --load-learnt car.tse",
        "tselab: error",
        "It is damaged, cut off, of another vehicle or of a newer version.",
        "Leave the option out once; `--save-learnt` writes a new one.",
    ),
    Symptom(
        "A table of a format that is not written",
        _log(lambda x: x),
        f"{ESTIMATE} --table found.xls",
        "tselab: error",
        "Tables are Parquet or CSV.",
        "Name it so.",
    ),
    Symptom(
        "accel_y in g",
        _scaled("accel_y", 1 / 9.81),
        ESTIMATE,
        "",
        "A unit that is off makes a channel disagree with all others; the log is not refused.",
        '`unit = "g"` in signals.toml; `tselab signals LOG` proposes units by names and by what the other channels say.',
    ),
    Symptom(
        "accel_y with the other sign",
        _scaled("accel_y", -1.0),
        ESTIMATE,
        "",
        "Axes are ISO 8855: left is positive.",
        "`sign = -1` in signals.toml.",
    ),
)


def run(symptom: Symptom) -> tuple[int, str]:
    """Exit code, and what the command says, in a folder of its own."""
    from click.testing import CliRunner

    import tse
    from tse.impl.errors import UserError
    from tse.impl.tables import simulated_vehicle
    from tselab.cli import cli

    before = Path.cwd()
    log = tse.simulate("square-waves", duration=DURATION).log
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log.to_csv(folder / "log.csv", index=False)
        (folder / "car.toml").write_text(simulated_vehicle(), encoding="utf-8")
        symptom.make(log, folder)
        os.chdir(folder)
        try:
            done = CliRunner().invoke(cli, [*symptom.arguments.split(), "--no-progress"], standalone_mode=False)
        finally:
            os.chdir(before)
    if isinstance(done.exception, UserError):  # as tselab.cli.main() ends
        return 2, f"{done.output}tselab: error: {done.exception}"
    if done.exception is not None:
        raise done.exception
    return int(done.return_value or 0), done.output


def page() -> str:
    text = []
    for s in CASES:
        code, said = run(s)
        lines = [line for line in said.splitlines() if line.strip()]
        at = next((i for i, line in enumerate(lines) if s.says and line.startswith(s.says)), None)
        if s.says and at is None:
            raise ValueError(f"{s.title}: nothing begins with {s.says!r} in {said!r}")
        if at is None:
            shown = [line for line in lines if "stiffness" in line or line.startswith(("tselab: error", "note", "warning", "  "))]
        else:
            shown = [lines[at], *(x for x in lines[at + 1 :][:3] if x.startswith("  "))]
        shown = [line if len(line) < 260 else line[:250] + " ..." for line in shown[:5]]
        text += [
            f"### {s.title}",
            "",
            "```text",
            f"$ tselab {s.arguments}",
            *shown,
            f"(exit code {code})",
            "```",
            "",
            f"*Cause.* {s.cause} *Remedy.* {s.remedy}",
            "",
        ]
    return "\n".join(text)
