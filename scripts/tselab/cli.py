"""The command line. Each command is a module of tselab, loaded when it is needed."""

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
    "replay": ("replay", "Show a log beside the simulation of a car along it."),
    "settings": ("car", "List all settings."),
    "signals": ("signals", "What a log holds, and a proposal of signals.toml."),
    "simulate": ("simulate", "Simulate a manoeuvre: log and truth."),
    "vehicle": ("car", "Check a vehicle file, or print one."),
}
CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 110}


class Commands(click.Group):
    """A group that loads a command when it is called: numpy alone takes longer than
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


def _print_version(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
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
    callback=_print_version,
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
    tselab live --interface socketcan --channel can0 --database car.dbc --vehicle car.toml
    tselab demo --out demo                       all of it, without a log of your own

    'tselab COMMAND --help' explains each command, its columns and units.
    """


def _discard_stdout() -> None:
    """Send the rest of the output nowhere: else Python complains at its end that the
    terminal takes no more."""
    with contextlib.suppress(OSError, ValueError):  # there may be no file in place of a terminal
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main() -> None:
    """Run the command. Every failure becomes a short message and an exit code: 2 the
    user's, 1 ours, 130 Ctrl-C."""
    debug = "--debug" in sys.argv[1:]
    sys.argv = [a for i, a in enumerate(sys.argv) if i == 0 or a != "--debug"]
    if isinstance(sys.stdout, io.TextIOWrapper):
        # the terminal may lack letters of the name of a car
        sys.stdout.reconfigure(errors="backslashreplace")
    os.environ["TSE_HOLD_MEMORY"] = "1"  # of logs, in this process and its workers (tse.readers.recording)
    # the pool of Arrow takes a gigabyte of addresses before it needs any
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
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
        _discard_stdout()
        sys.exit(141)
    except MemoryError:
        click.echo(
            "tselab: error: there is not enough memory for this; a log that is too long can be cut, or "
            "run on a larger machine (tselab signals --help says which formats are read in pieces)",
            err=True,
        )
        sys.exit(2)
    except Exception as error:
        from tse.files import explain_write_error

        # atomic() reports this of results: here it is the terminal or a temporary file
        if reason := explain_write_error(error):
            _discard_stdout()
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
