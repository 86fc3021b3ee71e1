"""The commands `tselab gap ...`."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tse.errors import Error
from tselab.options import (
    FILE,
    JOBS,
    JSON,
    PAGES,
    PROGRESS,
    ROAD,
    OutputPath,
    add_program_options,
    add_reading_options,
    check_table,
    fold_all,
    print_json,
    show_steps,
)

if TYPE_CHECKING:
    from tse import Reading

LOGS = click.argument("logs", metavar="LOG ...", type=FILE, nargs=-1, required=True)
VEHICLE = click.option(
    "--vehicle",
    "vehicle_path",
    metavar="CAR.toml",
    type=FILE,
    required=True,
    help="Vehicle file; 'tselab vehicle --example' prints one.",
)
HOLD_OUT = "--hold-out"
OUT = click.option("--out", metavar="DIR", type=FILE, required=True, help="Directory; created if needed.")
HELD = click.option(
    HOLD_OUT,
    "hold_out",
    metavar="LOG ...",
    type=FILE,
    multiple=True,
    help="Logs that are not used for the fit; the result is validated on them. Takes all files up to "
    "the next option.",
)

REPORT = click.option(
    "--report", metavar="PAGE.html", type=OutputPath(*PAGES), help="Also write the page to this file."
)
VERBOSE = click.option(
    "--verbose",
    is_flag=True,
    help="Also print the remaining residual of each channel, and the effects that would not be detected in "
    "these logs.",
)


def add_run_options(command: Callable[..., int]) -> Callable[..., int]:
    """Add the options that the commands `run` and `discover` share. The options become
    the keyword arguments of _run()."""
    for take in (
        JSON,
        PROGRESS,
        JOBS,
        add_reading_options,
        VERBOSE,
        REPORT,
        ROAD,
        HELD,
        OUT,
        VEHICLE,
        LOGS,
    ):  # --help lists first the option that is added last
        command = take(command)
    return command


class GapGroup(click.Group):
    """Group of the `gap` commands. If its first argument is not the name of a command, it
    calls `run`, so that `tselab gap LOG.csv ...` works."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            near = difflib.get_close_matches(args[0], list(self.commands), 1, 0.75)
            if near and not Path(args[0]).exists():
                raise Error(
                    f"gap {args[0]}: is neither a file nor a command; did you mean 'tselab gap {near[0]}'?"
                )
            args = ["run", *args]
        return super().parse_args(ctx, args)

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        run = self.commands["run"]
        with click.Context(run, info_name=ctx.info_name, parent=ctx.parent) as inner:
            run.format_help(inner, formatter)
        self.format_commands(ctx, formatter)


class RunCommand(click.Command):
    """A command whose option --hold-out takes several files: all arguments after it, up
    to the next option."""

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
            spread.append(HOLD_OUT)  # without a file, so that click reports that the file is missing
        return super().parse_args(ctx, spread)


@click.group(cls=GapGroup, short_help="Find effects that the model lacks, and add them.")
def gap() -> None:
    """Compare a simulation with logs, and name the effect that the model of the car
    lacks, such as body roll or a delay. Write a vehicle file with this effect, and show
    how much the residuals shrink."""


@gap.command(cls=RunCommand, hidden=True)
@add_run_options
def run(**given: Any) -> int:
    """Compare a simulation with logs, and name the effect that the model of the car
    lacks, such as body roll or a delay. Write a vehicle file with this effect, and show
    how much the residuals shrink. 'tselab gap catalogue' lists all effects.

    \b
    tselab gap drive1.csv drive2.csv --vehicle car.toml --out gap
    tselab gap log_*.csv --vehicle car.toml --out gap --hold-out hold_out_*.csv
    tselab gap check log_*.csv --vehicle car.toml

    The single-track model is simulated with the logged steering angle and wheel speeds.
    The simulated accel_x, accel_y and yaw_rate are compared with the measured ones.
    First, the stiffnesses of the car are fitted together with bank and grade of the road.
    If the logs determine bank or grade, the simulation uses the fitted values. Otherwise
    the simulated road is level. All laps of the same road, also in held-out logs, have
    the same bank and grade. With --road, bank and grade are read from ROAD.csv and not
    fitted. Then models with different effects, and different delays of the channels, are
    fitted, and are compared by their Bayesian evidence. A noise model describes residuals
    that no effect explains. An effect is named if the probability that the model lacks it
    is at least 90 %. Held-out logs do not influence the verdict.

    \b
    DIR/verdict.json           the verdict as JSON
    DIR/report.html            the verdict as a page with plots
    DIR/vehicle_improved.toml  stiffness and effects, for tselab estimate and simulate
    DIR/effects.h              stiffness and effects for C: a function that sets a
                               tse_config
    DIR/road.csv               bank and grade of the road, if they were determined, for
                               --road; road_2.csv for a second road
    DIR/formula.toml           a formula for the residuals that no effect of the catalogue
                               explains, if a formula was found
    DIR/tse_formula.h          this formula for C
    DIR/residuals.parquet      residuals without and with the named effects, as means over
                               blocks of 40 ms
    DIR/gap.png                the residuals as a picture (if matplotlib is installed)

    Exit code: 0 the model lacks nothing, as far as these logs can show; 10 an effect is
    named; 11 an effect is uncertain: the probability that the model lacks it is below
    90 %, or a different effect explains the same residuals; 20 the model lacks something
    that is not in the catalogue; 2 bad input; 130 Ctrl-C.
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
    """Run the command `run`, or `discover` if `formula` is True, and print the result.

    `formula`: search for a formula even if the named effects explain the residuals."""
    import tse
    from tse.files import check_writable, make_directory

    check_logs_exist(logs, hold_out)
    check_writable(report)
    make_directory(out)
    check_logs_once(logs, hold_out)
    with show_steps(progress) as show:
        found = tse.gap(
            logs,
            vehicle_path,
            hold_out=hold_out,
            out=out,
            jobs=jobs,
            formula=formula,
            road=road_path,
            reading=reading,
            progress=show,
        )
    if report is not None:
        found.report(report)
    if as_json:
        print_json({**found.to_dict(), "written": found.files, "exit_code": found.exit_code})
        return found.exit_code
    short = [*fold_all(found.answer), *found.short_stages]
    lines = [*found.words, *found.stages] if verbose else short
    if verbose and found.undetectable:
        ids = ", ".join(found.undetectable)
        lines.append(f"Effects that would not be detected in these logs even at their typical size: {ids}.")
    for line in lines:
        click.echo(line)
    notes = [f"note: {line}" for line in found.notes]
    for line in notes if verbose else fold_all(notes):
        click.echo(line, err=True)
    for line in found.gain if verbose else ():
        click.echo(line)
    for line in fold_all([f"Written to {out}: {', '.join(f.name for f in found.files)}"]):
        click.echo(line)
    return found.exit_code


@gap.command(cls=RunCommand, short_help="Find a formula for residuals that no effect explains.")
@add_run_options
def discover(**given: Any) -> int:
    """Find a formula for the residuals that no effect of the catalogue explains.

    \b
    tselab gap discover log_*.csv --vehicle car.toml --out gap --hold-out hold_out_*.csv

    This command does what 'tselab gap LOG ...' does, but searches for a formula in any
    case. 'tselab gap LOG ...' searches only if the named effects leave a part of the
    residuals unexplained. A candidate is a formula from a library, added to the equations
    of an axle, the body or a sensor. A linearised model shows how much each candidate
    would reduce the residuals. The best candidates are simulated, and are fitted together
    with the stiffness and the named effects. Longer formulas are penalised. A formula
    that makes the residuals of a held-out log larger is rejected.

    DIR/formula.toml can be edited or written by hand; 'tselab formula' checks it. The
    lines [formula] file = "formula.toml" in a vehicle file add the formula to simulator,
    estimator and 'tselab gap'.
    """
    return _run(**given, formula=True)


@gap.command(short_help="List which effects would be detected in these logs.")
@LOGS
@VEHICLE
@add_reading_options
@add_program_options
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
    """List which effects would be detected in these logs, before any effect is fitted.

    \b
    tselab gap check log_*.csv --vehicle car.toml

    For every effect the table has the smallest size at which 'tselab gap' would name this
    effect, its typical size, and the share that is absorbed by stiffness: of the mean
    square change that the effect makes in the simulated channels, the share that a
    changed stiffness can make, too, so that it is not visible. Below the table are the
    effects that would not be named at their typical size, with the channels that they
    affect.

    Exit code: 0 usable: every effect would be named at its typical size; 3 usable in
    part: only some effects would be named; 4 nothing usable: no effect would be named;
    2 bad input. --json prints the table as JSON, --table writes a row for each effect.
    """
    import tse
    from tse.files import check_distinct

    check_distinct({"--table": table}, {"--vehicle": vehicle_path} | {str(p): p for p in logs})
    check_table(table)
    with show_steps(progress) as show:
        found = tse.gap_check(logs, vehicle_path, jobs=jobs, reading=reading, progress=show)
    if table is not None:
        found.write_table(table)
    if as_json:
        about = {"logs": logs, "vehicle": vehicle_path}
        print_json({**about, **found.to_dict(), "exit_code": found.exit_code})
    else:
        click.echo(found.text)
    return found.exit_code


@gap.command(short_help="List the effects of the catalogue.")
@add_program_options
def catalogue(as_json: bool, table: Path | None) -> None:
    """List the effects of the catalogue. For each effect: its meaning, the parts of the
    model that it changes (such as "front axle"), the channels that it affects, and its
    typical size.

    \b
    tselab gap catalogue
    tselab gap catalogue --table effects.csv
    """
    from tse import tables

    check_table(table)
    effects = tables.effects()
    rows = [{k: v for k, v in e.items() if k != "strength"} for e in effects]
    if table is not None:
        tables.write_table(rows, table)
    if as_json:
        print_json({"effects": rows})
        return
    shown = set()
    for e in effects:
        if e["id"] not in shown:
            click.echo(f"{e['id']}: {e['effect']}; enters at {e['enters']}; shows in {e['shows_in']}")
            shown.add(e["id"])
        if e["strength"]:
            typical = f"typical {e['typical_low']:g} .. {e['typical_high']:g}"
            click.echo(
                f"    {e['setting']} [{e['unit']}]  {typical}, negligible below {e['negligible']:g}: "
                f"{e['meaning']}"
            )


@gap.command(short_help="Find the manoeuvre that distinguishes two effects.")
@click.option(
    "--separate",
    metavar="ID,ID",
    required=True,
    help="The two effects; 'tselab gap catalogue' lists the ids.",
)
@VEHICLE
@click.option(
    "--top",
    type=click.IntRange(1, 100),
    default=6,
    show_default=True,
    help="Max number of manoeuvres that are listed.",
)
@JOBS
@PROGRESS
@JSON
def plan(
    separate: str, vehicle_path: Path, top: int, jobs: int, progress: bool | None, as_json: bool
) -> None:
    """Find the manoeuvre that distinguishes two effects, and how long it must be driven.

    \b
    tselab gap plan --separate relaxation,steering_lag --vehicle car.toml

    Let A and B be the two effects. Each manoeuvre of a library is simulated for a car
    with effect A at its typical size. Effect B and the stiffness are fitted to this
    simulation. The residuals of the fit, divided by the sensor noise of the vehicle file,
    give the log likelihood ratio of A to B in nats. The same is done with A and B
    exchanged, and the smaller of the two log likelihood ratios is printed. A and B count
    as distinguished from 8 nats on. The log likelihood ratio is proportional to the
    length of the drive: a manoeuvre that gives 2 nats must be driven four times.
    """
    import tse

    with show_steps(progress) as show:
        found = tse.gap_plan(separate, vehicle_path, jobs=jobs, progress=show)
    if as_json:
        print_json(found.to_dict())
        return
    click.echo(found.text(top))


def check_logs_exist(logs: tuple[Path, ...], hold_out: tuple[Path, ...] = ()) -> None:
    """Raise Error if a log does not exist. The message has a hint if the first log
    resembles the name of a command."""
    for path in (*logs, *hold_out):
        if not path.exists():
            near = difflib.get_close_matches(str(path), list(gap.commands), 1, 0.6) if path is logs[0] else []
            hint = f"; did you mean the command 'tselab gap {near[0]}'?" if near else ""
            raise Error(f"{path}: no such file{hint}")


def check_logs_once(logs: tuple[Path, ...], hold_out: tuple[Path, ...]) -> None:
    """Raise Error if a log is given twice. A repeated log would count twice in the fit,
    and a fitted log cannot validate the result as a held-out log."""
    from tse.files import resolve_path

    seen: set[Path] = set()
    for n, path in enumerate((*logs, *hold_out)):
        if resolve_path(path) in seen:
            what = (
                "is given twice: give it once"
                if n < len(logs)
                else "option --hold-out: is also a log of the fit, or given twice: give it once"
            )
            raise Error(f"{path}: {what}")
        seen.add(resolve_path(path))
