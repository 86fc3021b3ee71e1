"""Options that several commands share, and output as JSON and as tables."""

import functools
import json
import os
import sys
import textwrap
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from tse.errors import Error, NoFile

COLUMNS = 100  # of the output without --verbose
FILE = click.Path(path_type=Path)
TABLES, PAGES = (".csv", ".parquet", ".pq"), (".html", ".htm")


def fold(text: str) -> list[str]:
    """Return the lines of a text on a terminal."""
    indent = text[: len(text) - len(text.lstrip())] + "  "
    return textwrap.wrap(
        text, COLUMNS, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def fold_all(texts: Iterable[str]) -> list[str]:
    """Return the lines of several texts on a terminal."""
    return [line for text in texts for line in fold(text)]


class OutputPath(click.Path):
    """A file that is written in the format of its suffix; without a suffix in the first
    of `suffixes`.

    Parameters
    ----------
    suffixes
        Suffixes of the formats.
    """

    def __init__(self, *suffixes: str):
        super().__init__(path_type=Path)
        self.suffixes = suffixes

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Refuse a suffix of another format."""
        path = Path(super().convert(value, param, ctx))
        if path.suffix and path.suffix.lower() not in self.suffixes:
            option = param.opts[-1] if param is not None else "option"
            raise Error(
                f"option {option}: {path}: is written as {' or '.join(self.suffixes)}, by its name, not "
                f"as {path.suffix}"
            )
        return path


FORMS = ("default", "robust", "paper")  # tse_config_default() and its like
DAY = 86400.0  # s
MAX_AGE = 40000.0  # days


def read_key_values(pairs: tuple[str, ...]) -> dict[str, float]:
    """Return the numbers of --set KEY=NUMBER by name."""
    values: dict[str, float] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        try:
            number = float(text)
        except ValueError:
            equals = ""
        if not equals:
            raise Error(f"option --set: {pair!r} is not KEY=NUMBER, for instance forgetting=0.995")
        values[key.strip()] = int(number) if number.is_integer() else number
    return values


def read_settings(
    pairs: tuple[str, ...], options: Mapping[str, float | None] | None = None, *, simulator: bool = False
) -> dict[str, float]:
    """Return the settings of options of their own, None for those not given, and of
    --set, each checked.

    --set wins, except over the options of `tselab simulate` (`simulator`)."""
    from tse import tables

    own = {name: value for name, value in (options or {}).items() if value is not None}
    others = read_key_values(pairs)
    for name, value in own.items():
        tables.check_setting(name, value, source=f"option --{_find_option(name)}", simulator=simulator)
    for name, value in others.items():
        tables.check_setting(name, value, source="option --set", simulator=simulator)
    return {**others, **own} if simulator else {**own, **others}


def _find_option(setting: str) -> str:
    """Return the option that sets it: --spread sets spread_cx_front and its like."""
    return "spread" if setting.startswith("spread_") else setting.replace("_", "-")


def show_progress(progress: bool | None) -> bool:
    """Return whether to show progress: as the option says, else on a terminal."""
    return sys.stderr.isatty() if progress is None else progress


def convert_age(days: float | None, load_learnt: Path | None) -> float:
    """Return the age of a learnt state, s; UNKNOWN_AGE without the option --age."""
    import tse

    if days is None:
        return tse.UNKNOWN_AGE
    if load_learnt is None:
        raise Error("option --age: is that of the file of --load-learnt, which is not given")
    check_range("age", days, 0.0, MAX_AGE, "days")
    return days * DAY


def print_json(document: Any) -> None:
    """Print a document as JSON on standard output; paths are texts."""
    click.echo(json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False, default=str))


def check_table(path: Path | None) -> None:
    """Refuse early a table of --table that could not be written."""
    from tse import files

    if path is None:
        return
    if not files.is_parquet(path) and path.suffix.lower() != ".csv":
        raise Error(f"option --table: {path}: a table is written as .parquet or .csv, by its name")
    files.check_writable(path)


@contextmanager
def silence_warnings() -> Iterator[None]:
    """Silence Python's warnings of a result: the command prints them itself."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


CALIBRATE = click.option(
    "--calibrate/--no-calibrate",
    default=True,
    show_default=True,
    help="Calibrate a car that nobody has calibrated on its log first.",
)


class _Form(click.Choice):
    """A choice of FORMS. The message for a removed form names its successor."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        if value == "sampled":
            self.fail(
                f"'sampled' is gone, 'robust' takes its place. Allowed: {', '.join(FORMS)}.", param, ctx
            )
        return super().convert(value, param, ctx)


FORM = click.option(
    "--form",
    type=_Form(FORMS),
    default="default",
    show_default=True,
    help="paper: the paper's particle filter as printed. robust: the same with settings that keep it from "
    "diverging; neither is "
    "as safe as the default.",
)
PROGRESS = click.option(
    "--progress/--no-progress", default=None, help="Progress bar; default: when stderr is a terminal."
)


@contextmanager
def show_steps(progress: bool | None) -> Iterator[Callable[[str], None]]:
    """Give a function that shows the current step with the seconds since the start; on a
    terminal on one line."""
    start, terminal = time.monotonic(), sys.stderr.isatty()

    def say(text: str) -> None:
        line = f"{time.monotonic() - start:5.1f} s  {text}"
        click.echo(f"\r\033[K{line[:110]}" if terminal else line, err=True, nl=not terminal)

    if not show_progress(progress):
        yield lambda _: None
        return
    try:
        yield say
    finally:
        if terminal:
            click.echo("\r\033[K", err=True, nl=False)


DATABASE = click.option(
    "--database",
    "databases",
    metavar="FILE",
    type=FILE,
    multiple=True,
    help="What the frames of a bus mean: "
    "DBC, ARXML, KCD, SYM; default: those beside the log. May be repeated.",
)
ROAD = click.option(
    "--road",
    "road_path",
    metavar="ROAD.csv",
    type=FILE,
    help="Bank and grade of the road, over distance and position.",
)
JSON = click.option(
    "--json", "as_json", is_flag=True, help="What was found as JSON on standard output, in place of words."
)
TABLE_HELP = "Also write what was found as a table, .parquet or .csv."


def add_program_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --json and --table to a command."""
    command = click.option("--table", metavar="TABLE.parquet", type=FILE, help=TABLE_HELP)(command)
    return JSON(command)


def add_reading_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of a command that reads logs; it gets them as one argument
    `reading`, a tse.Reading."""

    @functools.wraps(command)
    def with_reading(
        *args: Any,
        signals: Path | None,
        rate: float | None,
        strict: bool,
        databases: tuple[Path, ...],
        **kw: Any,
    ) -> Any:
        import tse

        if signals is not None and not signals.is_file():
            raise NoFile(
                f"{signals}: no such file (option --signals); 'tselab signals LOG --write {signals.name}' "
                "proposes one"
            )
        return command(*args, reading=tse.Reading(signals, rate, strict, databases), **kw)

    for option in (
        click.option(
            "--strict",
            is_flag=True,
            help="Refuse a log whose channels contradict each other, instead of warning.",
        ),
        click.option(
            "--rate",
            metavar="HZ",
            type=float,
            help="Rows per second to which the log is resampled; default: the fastest "
            "channel's, up to 100, or as it is when that is even.",
        ),
        DATABASE,
        click.option(
            "--signals",
            metavar="SIGNALS.toml",
            type=FILE,
            help="Which signal of the log is which channel "
            "('tselab signals' proposes it); default: signals.toml beside the log.",
        ),
    ):
        with_reading = option(with_reading)
    return with_reading


JOBS = click.option(
    "--jobs",
    type=click.IntRange(1, 256),
    default=os.cpu_count() or 1,
    show_default="all cores",
    help="Processes.",
)
FIRST_SEED = click.option(
    "--first-seed",
    type=click.IntRange(0, 2000000000),
    default=1,
    show_default=True,
    help="Seed of the first run.",
)
RESTART = click.option("--restart", is_flag=True, help="Discard the runs that are in DIR.")


class Lazy(click.Command):
    """A command whose help ends in tables of the library.

    Parameters
    ----------
    tables
        For each its title, and a function that returns its text; of tse.tables by name.
    """

    def __init__(
        self, *args: Any, tables: tuple[tuple[str, str | Callable[[], str]], ...] = (), **kwargs: Any
    ):
        super().__init__(*args, **kwargs)
        self.tables = tables

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        from tse import tables

        super().format_epilog(ctx, formatter)
        for title, made in self.tables:
            formatter.write(f"\n{title}:\n")
            try:
                formatter.write(
                    textwrap.indent((made if callable(made) else getattr(tables, made))(), "  ") + "\n"
                )
            except Error as error:
                formatter.write(f"  ({error})\n")


def check_range(name: str, value: float | None, low: float, high: float, unit: str) -> None:
    if value is not None and not low <= value <= high:
        raise Error(f"option --{name}: {value:g} is outside its range {low:g} .. {high:g} {unit}")
