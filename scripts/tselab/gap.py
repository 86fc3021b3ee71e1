"""The commands `tselab gap ...`."""

from __future__ import annotations

import difflib
import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tse.library.errors import UserError
from tse.library.files import check_writable, make_directory, resolve_path, write_atomically
from tselab.options import (
    FILE,
    JOBS,
    JSON,
    PAGES,
    PROGRESS,
    ROAD,
    Written,
    folded,
    for_programs,
    reading,
    saying,
)

if TYPE_CHECKING:
    from tse.log.rows import Reading

LOGS = click.argument("logs", metavar="LOG ...", type=FILE, nargs=-1, required=True)
VEHICLE = click.option("--vehicle", "vehicle_path", metavar="CAR.toml", type=FILE, required=True,
                       help="Vehicle file; 'tselab vehicle --example' prints one.")  # fmt: skip
HOLD_OUT = "--hold-out"
OUT = click.option("--out", metavar="DIR", type=FILE, required=True, help="Directory; made if needed.")
HELD = click.option(HOLD_OUT, "hold_out", metavar="LOG ...", type=FILE, multiple=True,
                    help="Logs that are not fitted: they prove what was found. All files up to the next option.")  # fmt: skip

REPORT = click.option(
    "--report", metavar="PAGE.html", type=Written(*PAGES), help="Also write the page there."
)
VERBOSE = click.option(
    "--verbose", is_flag=True, help="Say all: what is left of each channel, and what no log could show."
)


def of_a_run(command: Callable[..., int]) -> Callable[..., int]:
    """What every command takes that runs the whole workflow: the arguments of _run(), by name."""
    for take in (
        JSON,
        PROGRESS,
        JOBS,
        reading,
        VERBOSE,
        REPORT,
        ROAD,
        HELD,
        OUT,
        VEHICLE,
        LOGS,
    ):  # click lists the last one first
        command = take(command)
    return command


class Gap(click.Group):
    """A group whose command without a name is `run`: `tselab gap LOG.csv ...`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            near = difflib.get_close_matches(args[0], list(self.commands), 1, 0.75)
            if near and not Path(args[0]).exists():
                raise UserError(
                    f"gap {args[0]}: is no file and no command; did you mean 'tselab gap {near[0]}'?"
                )
            args = ["run", *args]
        return super().parse_args(ctx, args)

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        run = self.commands["run"]
        with click.Context(run, info_name=ctx.info_name, parent=ctx.parent) as inner:
            run.format_help(inner, formatter)
        self.format_commands(ctx, formatter)


class Run(click.Command):
    """--hold-out takes all files up to the next option."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        spread: list[str] = []
        holding = False
        for arg in args:
            if arg == HOLD_OUT:
                holding = True
            elif holding and not (arg.startswith("-") and len(arg) > 1):
                spread += [HOLD_OUT, arg]
            else:
                holding = False
                spread.append(arg)
        if HOLD_OUT in args and HOLD_OUT not in spread:
            spread.append(HOLD_OUT)  # alone: click says what is missing
        return super().parse_args(ctx, spread)


@click.group(cls=Gap, short_help="Find, name and add what the model lacks.")
def gap() -> None:
    """Find where simulation and measurement disagree, name the missing effect, add it, show the gap shrink."""


@gap.command(cls=Run, hidden=True)
@of_a_run
def run(**given: Any) -> int:
    """Find where simulation and measurement disagree, name the missing effect, add it, show the gap shrink.

    \b
    tselab gap drive1.csv drive2.csv --vehicle car.toml --out gap
    tselab gap log_*.csv --vehicle car.toml --out gap --hold-out hold_out_*.csv
    tselab gap check log_*.csv --vehicle car.toml

    The single-track model is driven by the logged steering angle and wheel speeds; what it says of accel_x, accel_y and
    yaw_rate is compared with what was measured. First car and road are fitted together:
    where bank or grade shows, the logs are put on it; laps of one road have one profile,
    and held-out laps of it use it. Then sets of effects of the catalogue, and how late
    messages are, are judged by their evidence beside what no model explains; a name needs
    a probability of 90 %. Held-out logs take no part in it. --road: the bank and grade
    are known, and not sought.

    \b
    DIR/verdict.json           what was found, for programs
    DIR/report.html            the same for people
    DIR/vehicle_improved.toml  stiffness and effects: for tselab estimate and simulate
    DIR/effects.h              the same for C: sets a tse_config
    DIR/road.csv               bank and grade of the road, where they show: for --road;
    road_2.csv of a second one DIR/formula.toml           a formula for what no effect of
    the catalogue explains, if one was found; tse_formula.h: in C DIR/residuals.parquet
    before and after, every block of 40 ms DIR/gap.png                the picture (with
    matplotlib)

    \b
    Exit code: 0 nothing is missing that these logs could show, 10 named, 11 possible, below 90 %, or look-alikes cannot be
    excluded, 20 something is missing that is not in the catalogue, 2 bad input, 130 Ctrl-C.
    """
    return _run(**given)


def _run(
    logs: tuple[Path, ...],
    vehicle_path: Path,
    out: Path,
    hold_out: tuple[Path, ...],
    jobs: int,
    progress: bool | None,
    reading: Reading,
    road_path: Path | None,
    formula: bool = False,
    as_json: bool = False,
    report: Path | None = None,
    verbose: bool = False,
) -> int:
    """The whole workflow, and what a person should know of it. `formula`: one is sought whatever the names leave."""
    from tse.gaps.run import workflow
    from tse.gaps.run.output import words, write_all
    from tse.roads.road import read_road

    _there(logs, hold_out)
    if report is not None:
        check_writable(report)
    make_directory(out)
    _distinct(logs, hold_out)
    with saying(progress) as say:
        road = read_road(road_path) if road_path is not None else None
        result = workflow.run(logs, vehicle_path, hold_out, jobs, say, formula, reading, road)
        written = write_all(out, result, vehicle_path, jobs, say)
    if report is not None:
        with write_atomically(report) as file:
            file.write((out / "report.html").read_text(encoding="utf-8"))
    if as_json:
        verdict = json.loads((out / "verdict.json").read_text(encoding="utf-8"))
        from tse.report import results

        results.say_json(
            {**verdict, "written": [out / f.name for f in written.files], "exit_code": result.exit_code}
        )
        return result.exit_code
    lines = [*result.words, *changes(result)]
    if result.undetectable:
        ids = ", ".join(d.id for d in result.undetectable)
        lines.append(f"These logs could not have shown, at its typical size: {ids}.")
    for line in lines if verbose else [*folded(_answer(result)), *_worth(result)]:
        click.echo(line)
    notes = [f"note: {line}" for line in result.notes]
    for line in notes if verbose else folded(notes):
        click.echo(line, err=True)
    for line in words(written.gain) if verbose else ():
        click.echo(line)
    for line in folded([f"Written to {out}: {', '.join(f.name for f in written.files)}"]):
        click.echo(line)
    return result.exit_code


def _answer(result: Any) -> list[str]:
    """Return the sentences without what is left of each channel, which the stages say, too."""
    return [line for line in result.words if not line.startswith("Still left: ")]


def _worth(result: Any) -> list[str]:
    """Return the residuals in a few lines: of the held-out logs, where there are any."""
    from tse.gaps.run import stages
    from tse.gaps.run.workflow import FIT

    held = next((part for part in result.stages if part != FIT), FIT)
    title = "fitted logs" if held == FIT else "held-out logs"
    return stages.short(result.stages[held], title) if held in result.stages else []


@gap.command(cls=Run, short_help="A formula for what no effect of the catalogue explains.")
@of_a_run
def discover(**given: Any) -> int:
    """A formula for what no effect of the catalogue explains.

    \b
    tselab gap discover log_*.csv --vehicle car.toml --out gap --hold-out hold_out_*.csv

    As 'tselab gap', which seeks one where its names leave something; this command always does. Forms of a library are put at
    the axles, on the body and into the sensors; those with the largest expected gain are simulated with the stiffness fitted
    beside them, length has a price, and a held-out log that they make worse forbids them.

    DIR/formula.toml can be edited, and written by hand: 'tselab formula' checks it, [formula] file = "formula.toml" in a vehicle
    file runs it in simulator, estimator and this workflow.
    """
    return _run(**given, formula=True)


def changes(result: Any) -> list[str]:
    """Return the residuals in three stages, in words."""
    from tse.gaps.run import stages
    from tse.gaps.run.workflow import FIT

    return stages.words(result.stages, lambda part: "fitted logs" if part == FIT else "held-out logs")


@gap.command(short_help="What these logs can and cannot show, before any fit.")
@LOGS
@VEHICLE
@reading
@for_programs
@JOBS
@PROGRESS
def check(
    logs: tuple[Path, ...],
    vehicle_path: Path,
    jobs: int,
    progress: bool | None,
    reading: Reading,
    as_json: bool,
    table: Path | None,
) -> int:
    """What these logs can and cannot show, before any effect is fitted.

    \b
    tselab gap check log_*.csv --vehicle car.toml

    For every effect the smallest size that would be named, its typical size, and how much of it the fitted stiffness takes up;
    then what those that would not be named show in.

    Exit code: 0 usable: every effect would be named at its typical size; 3 usable in part: some would; 4 nothing usable: none
    would; 2 bad input. --json says it for programs, --table writes a row for each effect.
    """
    from tse.gaps.run.check import check as look
    from tse.library.files import check_distinct
    from tse.report import results

    check_distinct({"--table": table}, {"--vehicle": vehicle_path} | {str(p): p for p in logs})
    results.check_table(table)

    with saying(progress) as say:
        found = look(logs, vehicle_path, jobs, say, reading)
    if table is not None:
        results.write_rows(
            table, [{"logs": " ".join(map(str, logs)), **e} for e in found.as_json()["effects"]]
        )
    if as_json:
        results.say_json({"logs": logs, "vehicle": vehicle_path, **found.as_json(), "exit_code": found.code})
    else:
        click.echo(found.text())
    return found.code


@gap.command(short_help="The effects that it knows.")
@for_programs
def catalogue(as_json: bool, table: Path | None) -> None:
    """List the effects that the workflow knows: what each is, where it enters, what shows it, how large it usually is.

    \b
    tselab gap catalogue
    tselab gap catalogue --table effects.csv
    """
    from tse.library.core import library
    from tse.report import results

    results.check_table(table)
    rows = [
        {"id": e.id, "effect": e.title, "enters": ", ".join(e.entry_points), "shows_in": e.channels,
         "look_alikes": ", ".join(e.look_alikes), "setting": p.setting, "unit": p.unit, "typical_low": p.typical[0],
         "typical_high": p.typical[1], "negligible": p.negligible, "meaning": p.text}
        for e in library().effects.values() for p in e.parameters
    ]  # fmt: skip
    if table is not None:
        results.write_rows(table, rows)
    if as_json:
        results.say_json({"effects": rows})
        return
    for e in library().effects.values():
        click.echo(f"{e.id}: {e.title}; enters at {', '.join(e.entry_points)}; shows in {e.channels}")
        for p in e.strengths:
            typical = f"typical {p.typical[0]:g} .. {p.typical[1]:g}, negligible below {p.negligible:g}"
            click.echo(f"    {p.setting} [{p.unit}]  {typical}: {p.text}")


@gap.command(short_help="Which manoeuvre tells two effects apart.")
@click.option(
    "--separate", metavar="ID,ID", required=True, help="The effects; ids as 'tselab gap check' lists them."
)
@VEHICLE
@click.option(
    "--top", type=click.IntRange(1, 100), default=6, show_default=True, help="Manoeuvres that are listed."
)
@JOBS
@PROGRESS
@JSON
def plan(
    separate: str, vehicle_path: Path, top: int, jobs: int, progress: bool | None, as_json: bool
) -> None:
    """Which manoeuvre tells two effects apart, and how long it must be driven.

    \b
    tselab gap plan --separate relaxation,steering_lag --vehicle car.toml

    Each manoeuvre of a library is simulated with either effect at its typical size, and the other one is fitted to it together
    with the stiffness; what it cannot copy is what tells them apart, in nats at the noise of the vehicle file's sensors. 8 nats
    are enough.
    """
    from tse.gaps.run.plan import plan as make

    with saying(progress) as say:
        found = make(separate, vehicle_path, jobs, say)
    if as_json:
        from tse.report import results

        rows = [{**vars(o), "needed": o.needed} for o in found.options]
        results.say_json(
            {"effects": [found.first, found.second], "separable": found.separable, "manoeuvres": rows}
        )
        return
    click.echo(found.text(top))


def _there(logs: tuple[Path, ...], hold_out: tuple[Path, ...] = ()) -> None:
    """All of them are there. A first one that is not, and sounds like a command, is called so."""
    for path in (*logs, *hold_out):
        if not path.exists():
            near = difflib.get_close_matches(str(path), list(gap.commands), 1, 0.6) if path is logs[0] else []
            hint = f"; nor is it a command of gap (did you mean 'tselab gap {near[0]}'?)" if near else ""
            raise UserError(f"{path}: no such file{hint}")


def _distinct(logs: tuple[Path, ...], hold_out: tuple[Path, ...]) -> None:
    """A log that is fitted proves nothing when it is held out, too; one that is given twice counts twice."""
    seen: set[Path] = set()
    for n, path in enumerate((*logs, *hold_out)):
        if resolve_path(path) in seen:
            what = "is given twice" if n < len(logs) else "option --hold-out: is fitted, too, or given twice"
            raise UserError(f"{path}: {what}")
        seen.add(resolve_path(path))
