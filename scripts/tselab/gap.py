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
OUT = click.option("--out", metavar="DIR", type=FILE, required=True, help="Directory; made if needed.")
HELD = click.option(
    HOLD_OUT,
    "hold_out",
    metavar="LOG ...",
    type=FILE,
    multiple=True,
    help="Logs that are not fitted: they prove what was found. All files up to the next option.",
)

REPORT = click.option(
    "--report", metavar="PAGE.html", type=OutputPath(*PAGES), help="Also write the page there."
)
VERBOSE = click.option(
    "--verbose", is_flag=True, help="Say all: what is left of each channel, and what no log could show."
)


def add_run_options(command: Callable[..., int]) -> Callable[..., int]:
    """Add the options of a command that runs the whole workflow: the arguments of _run(),
    by name."""
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
    ):  # click lists the last one first
        command = take(command)
    return command


class GapGroup(click.Group):
    """A group whose command without a name is `run`: `tselab gap LOG.csv ...`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            near = difflib.get_close_matches(args[0], list(self.commands), 1, 0.75)
            if near and not Path(args[0]).exists():
                raise Error(f"gap {args[0]}: is no file and no command; did you mean 'tselab gap {near[0]}'?")
            args = ["run", *args]
        return super().parse_args(ctx, args)

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        run = self.commands["run"]
        with click.Context(run, info_name=ctx.info_name, parent=ctx.parent) as inner:
            run.format_help(inner, formatter)
        self.format_commands(ctx, formatter)


class RunCommand(click.Command):
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


@click.group(cls=GapGroup, short_help="Find, name and add what the model lacks.")
def gap() -> None:
    """Find where simulation and measurement disagree, name the missing effect, add it,
    show the gap shrink."""


@gap.command(cls=RunCommand, hidden=True)
@add_run_options
def run(**given: Any) -> int:
    """Find where simulation and measurement disagree, name the missing effect, add it,
    show the gap shrink.

    \b
    tselab gap drive1.csv drive2.csv --vehicle car.toml --out gap
    tselab gap log_*.csv --vehicle car.toml --out gap --hold-out hold_out_*.csv
    tselab gap check log_*.csv --vehicle car.toml

    The single-track model is driven by the logged steering angle and wheel speeds; what
    it says of accel_x, accel_y and yaw_rate is compared with what was measured. First car
    and road are fitted together: where bank or grade shows, the logs are put on it; laps
    of one road have one profile, and held-out laps of it use it. Then sets of effects of
    the catalogue, and how late messages are, are judged by their evidence beside what no
    model explains; a name needs a probability of 90 %. Held-out logs take no part in it.
    --road: the bank and grade are known, and not sought.

    \b
    DIR/verdict.json           what was found, for programs
    DIR/report.html            the same for people
    DIR/vehicle_improved.toml  stiffness and effects: for tselab estimate and simulate
    DIR/effects.h              the same for C: sets a tse_config
    DIR/road.csv               bank and grade of the road, where they show: for --road;
                               road_2.csv of a second one
    DIR/formula.toml           a formula for what no effect of the catalogue explains,
                               if one was found; tse_formula.h: in C
    DIR/residuals.parquet      before and after, every block of 40 ms
    DIR/gap.png                the picture (with matplotlib)

    Exit code: 0 nothing is missing that these logs could show, 10 named, 11 possible,
    below 90 %, or look-alikes cannot be excluded, 20 something is missing that is not in
    the catalogue, 2 bad input, 130 Ctrl-C.
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
    """Run the whole workflow and print what it found. `formula`: seek one also where the
    names explain all."""
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
        lines.append(f"These logs could not have shown, at its typical size: {ids}.")
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


@gap.command(cls=RunCommand, short_help="A formula for what no effect of the catalogue explains.")
@add_run_options
def discover(**given: Any) -> int:
    """A formula for what no effect of the catalogue explains.

    \b
    tselab gap discover log_*.csv --vehicle car.toml --out gap --hold-out hold_out_*.csv

    As 'tselab gap', which seeks one where its names leave something; this command always
    does. Forms of a library are put at the axles, on the body and into the sensors; those
    with the largest expected gain are simulated with the stiffness fitted beside them,
    length has a price, and a held-out log that they make worse forbids them.

    DIR/formula.toml can be edited, and written by hand: 'tselab formula' checks it,
    [formula] file = "formula.toml" in a vehicle file runs it in simulator, estimator and
    this workflow.
    """
    return _run(**given, formula=True)


@gap.command(short_help="What these logs can and cannot show, before any fit.")
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
    """What these logs can and cannot show, before any effect is fitted.

    \b
    tselab gap check log_*.csv --vehicle car.toml

    For every effect the smallest size that would be named, its typical size, and how much
    of it the fitted stiffness takes up; then what those that would not be named show in.

    Exit code: 0 usable: every effect would be named at its typical size; 3 usable in
    part: some would; 4 nothing usable: none would; 2 bad input. --json says it for
    programs, --table writes a row for each effect.
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


@gap.command(short_help="The effects that it knows.")
@add_program_options
def catalogue(as_json: bool, table: Path | None) -> None:
    """List the effects that the workflow knows: what each is, where it enters, what shows
    it, how large it usually is.

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

    Each manoeuvre of a library is simulated with either effect at its typical size, and
    the other one is fitted to it together with the stiffness; what it cannot copy is what
    tells them apart, in nats at the noise of the vehicle file's sensors. 8 nats are
    enough.
    """
    import tse

    with show_steps(progress) as show:
        found = tse.gap_plan(separate, vehicle_path, jobs=jobs, progress=show)
    if as_json:
        print_json(found.to_dict())
        return
    click.echo(found.text(top))


def check_logs_exist(logs: tuple[Path, ...], hold_out: tuple[Path, ...] = ()) -> None:
    """Refuse a log that does not exist, with a hint if its name resembles a command."""
    for path in (*logs, *hold_out):
        if not path.exists():
            near = difflib.get_close_matches(str(path), list(gap.commands), 1, 0.6) if path is logs[0] else []
            hint = f"; nor is it a command of gap (did you mean 'tselab gap {near[0]}'?)" if near else ""
            raise Error(f"{path}: no such file{hint}")


def check_logs_once(logs: tuple[Path, ...], hold_out: tuple[Path, ...]) -> None:
    """Refuse a log that is given twice: it would count twice, and a fitted log that is
    held out proves nothing."""
    from tse.files import resolve_path

    seen: set[Path] = set()
    for n, path in enumerate((*logs, *hold_out)):
        if resolve_path(path) in seen:
            what = "is given twice" if n < len(logs) else "option --hold-out: is fitted, too, or given twice"
            raise Error(f"{path}: {what}")
        seen.add(resolve_path(path))
