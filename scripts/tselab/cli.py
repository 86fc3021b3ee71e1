"""The command `tselab`: the list of its subcommands, and the exit codes for errors. Each
subcommand is defined in a module of tselab. The module is imported only when the
subcommand is called."""

import contextlib
import importlib
import io
import os
import sys
import traceback

import click

from tse import __version__
from tse.errors import Error, Interrupted

# Key: name of the subcommand. Value: module of tselab that defines it, line in --help
COMMANDS = {
    "calibrate": ("calibrate", "Calibrate the parameters of a car on its logs."),
    "demo": ("demo", "Simulate a drive, estimate, read an MF4, find a hidden effect."),
    "estimate": ("estimate", "Estimate tyre stiffness from LOG."),
    "fleet": ("fleet", "Estimate many logs of many cars."),
    "fmu": ("fmu", "Build FMUs, and write their parameters for a car."),
    "formula": ("car", "Check a formula of your own; write it as C."),
    "gap": ("gap", "Find effects that the model lacks, and add them."),
    "live": ("live", "Estimate while driving, from a CAN bus."),
    "montecarlo": ("studies", "Monte-Carlo studies: accuracy, peers, stress ..."),
    "paper": ("studies", "Reproduce the figures of the paper with three filters."),
    "replay": ("replay", "Compare a log with a simulation that has the logged inputs."),
    "settings": ("car", "List all settings."),
    "signals": ("signals", "List the signals of a log, and propose signals.toml."),
    "simulate": ("simulate", "Simulate a manoeuvre: log and truth."),
    "vehicle": ("car", "Check a vehicle file, or print one."),
}
CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 110}


class Commands(click.Group):
    """Group of the subcommands. A subcommand is imported only when it is called, so that
    `tselab --help` does not wait for numpy."""

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
    """Estimate tyre stiffness from the log of a car.

    \b
    tselab vehicle --example > car.toml                a vehicle file to edit
    tselab estimate log.csv --vehicle car.toml --report report.html
    tselab signals drive.mf4 --write signals.toml      a log with other signal names
    tselab simulate --maneuver square-waves --vehicle car.toml --out log.csv
    tselab live --interface socketcan --channel can0 --database car.dbc --vehicle car.toml
    tselab demo --out demo                             an example that needs no log

    'tselab COMMAND --help' explains each command, and the columns and units of its files.
    """


def _discard_stdout() -> None:
    """Redirect standard output to the null device. Called after a write to standard
    output has failed. Otherwise Python would at exit write the rest of its output buffer,
    fail again, and print a second error."""
    with contextlib.suppress(OSError, ValueError):  # standard output may have no file descriptor
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main() -> None:
    """Run the command. Turn every exception into a short message and an exit code: 2
    input error, 1 internal error, 130 Ctrl-C, 141 closed output pipe."""
    debug = "--debug" in sys.argv[1:]
    sys.argv = [a for i, a in enumerate(sys.argv) if i == 0 or a != "--debug"]
    if isinstance(sys.stdout, io.TextIOWrapper):
        # if a character (e.g. in the name of a car) does not exist in the encoding of the
        # terminal, print its escape sequence
        sys.stdout.reconfigure(errors="backslashreplace")
    # with this variable, tse.readers.recording limits the memory for reading logs, in
    # this process and in worker processes
    os.environ["TSE_HOLD_MEMORY"] = "1"
    # use the memory allocator of the system: Arrow's own allocator reserves 1 GB at its
    # first use. This counts as memory of the process, and exceeds the limit for a small
    # log
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
            "tselab: error: there is not enough memory: cut the log into shorter ones, or run it on a "
            "machine with more memory (tselab signals --help lists which formats are read in pieces)",
            err=True,
        )
        sys.exit(2)
    except Exception as error:
        from tse.files import explain_write_error

        # an OSError here comes from standard output or a temporary file: if a file of
        # results cannot be written, write_atomically() raises Error instead
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
                "This is an error in tselab, not in your files. Please report it with the output of the "
                "same command with --debug.",
                err=True,
            )
        sys.exit(1)
