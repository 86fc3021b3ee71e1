"""The command line: options in, modules called, messages out. One module of tselab a
command, loaded when it is needed."""

import contextlib
import importlib
import io
import os
import sys
import traceback

import click

from tse import __version__
from tse.errors import Error, Interrupted

COMMANDS = {  # name: module of tselab, what it does
    "calibrate": ("calibrate", "Find what the car and the sensors of a log are."),
    "demo": ("demo", "Simulate a drive, estimate, read an MF4, find a hidden effect."),
    "estimate": ("estimate", "Estimate tyre stiffness from LOG."),
    "fleet": ("fleet", "Estimate many logs of many cars."),
    "fmu": ("fmu", "Build FMUs, and their parameters for a car."),
    "formula": ("car", "Check a formula of the user, also as C."),
    "gap": ("gap", "Find, name and add what the model lacks."),
    "live": ("live", "Estimate while driving, from a CAN bus."),
    "montecarlo": ("studies", "Monte-Carlo studies: accuracy, peers, stress ..."),
    "paper": ("studies", "The paper's figures: as printed, robust, default."),
    "replay": ("replay", "A log beside what the model of a car says of it."),
    "settings": ("car", "List all settings."),
    "signals": ("signals", "What a log holds, and a proposal of signals.toml."),
    "simulate": ("simulate", "Simulate a manoeuvre: log and truth."),
    "vehicle": ("car", "Check a vehicle file, or print one."),
}
CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 110}


class Commands(click.Group):
    """Commands that are loaded when they are asked for: numpy alone takes longer than
    --help may."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        return getattr(importlib.import_module(f"tselab.{COMMANDS[name][0]}"), name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


def _version(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
    if not value or ctx.resilient_parsing:
        return
    from tse import tables

    lib = tables.build()
    click.echo(
        f"tselab {__version__}\nlibrary tse {lib.version}, {lib.format}, up to {lib.capacity} particles"
    )
    ctx.exit()


@click.group(cls=Commands, context_settings=CONTEXT)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_version,
    help="Show versions and exit.",
)
@click.option("--debug", is_flag=True, help="Show the traceback of an internal error.")
def cli(debug: bool) -> None:
    """Tyre stiffness from a car's log.

    \b
    tselab vehicle --example > car.toml          a vehicle file to edit
    tselab estimate log.csv --vehicle car.toml --report report.html
    tselab signals drive.mf4 --write signals.toml      a log with names of its own
    tselab simulate --maneuver square-waves --vehicle car.toml --out log.csv
    tselab live --interface socketcan --channel can0 --database car.dbc --vehicle car.toml      while driving
    tselab demo --out demo                       all of it, without a log of your own

    'tselab COMMAND --help' explains each command, its columns and units.
    """


def _give_up_stdout() -> None:
    """What is left for a terminal that takes no more goes nowhere: else Python complains
    of it at its end."""
    with contextlib.suppress(OSError, ValueError):  # in place of a terminal there may be no file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main() -> None:
    """Run; turn every failure into a short message and an exit code: 2 the user's, 1
    ours, 130 Ctrl-C."""
    debug = "--debug" in sys.argv[1:]
    sys.argv = [a for i, a in enumerate(sys.argv) if i == 0 or a != "--debug"]
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(
            errors="backslashreplace"
        )  # a car may have a name that this terminal has no letters for
    os.environ["TSE_HOLD_MEMORY"] = "1"  # of logs, in this process and its workers (tse.readers.recording)
    os.environ.setdefault(
        "ARROW_DEFAULT_MEMORY_POOL", "system"
    )  # its own takes a gigabyte of addresses before it needs any
    try:
        code = cli.main(standalone_mode=False)
        sys.stdout.flush()
        sys.exit(code if isinstance(code, int) else 0)
    except click.ClickException as error:
        error.show()
        sys.exit(2)
    except Error as error:
        click.echo(f"tselab: error: {error}", err=True)
        sys.exit(2)
    except (KeyboardInterrupt, Interrupted, click.Abort) as error:
        click.echo(f"tselab: {error if isinstance(error, Interrupted) else 'stopped by Ctrl-C'}", err=True)
        sys.exit(130)
    except BrokenPipeError:
        _give_up_stdout()
        sys.exit(141)
    except MemoryError:
        click.echo(
            "tselab: error: there is not enough memory for this; a log that is too long can be cut, or "
            "run on a larger "
            "machine (tselab signals --help says which formats are read in pieces)",
            err=True,
        )
        sys.exit(2)
    except Exception as error:
        from tse.files import no_room

        if reason := no_room(
            error
        ):  # files.atomic says it of results: this is the terminal, or a temporary file
            _give_up_stdout()
            where = getattr(error, "filename", None) or "the output"
            click.echo(f"tselab: error: {where}: cannot be written: {reason}", err=True)
            sys.exit(2)
        if debug:
            traceback.print_exc()
        else:
            click.echo(
                f"tselab: internal error: {type(error).__name__}: {error}\n"
                "This is a fault of tselab, not of your files. Please report it with the output of the "
                "same command with --debug.",
                err=True,
            )
        sys.exit(1)
