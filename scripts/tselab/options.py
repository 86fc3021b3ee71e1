"""Options that several commands share, and functions that print
JSON and check output files."""

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

MAX_OUTPUT_WIDTH = 100  # [characters] max length of a printed line without --verbose
FILE = click.Path(path_type=Path)
TABLES, PAGES = (".csv", ".parquet", ".pq"), (".html", ".htm")  # suffixes of tables and of pages


def fold(text: str) -> list[str]:
    """Wrap a text to MAX_OUTPUT_WIDTH. Return its lines. All lines but the first are
    indented by two more columns."""
    indent = text[: len(text) - len(text.lstrip())] + "  "
    return textwrap.wrap(
        text, MAX_OUTPUT_WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def fold_all(texts: Iterable[str]) -> list[str]:
    """Wrap several texts to MAX_OUTPUT_WIDTH. Return their lines."""
    return [line for text in texts for line in fold(text)]


class OutputPath(click.Path):
    """Type of an option that names an output file. The suffix of the file selects its
    format. A file without a suffix gets the format of the first of `suffixes`.

    Parameters
    ----------
    suffixes
        Allowed suffixes.
    """

    def __init__(self, *suffixes: str):
        super().__init__(path_type=Path)
        self.suffixes = suffixes

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path. Raise Error if its suffix is not allowed."""
        path = Path(super().convert(value, param, ctx))
        if path.suffix and path.suffix.lower() not in self.suffixes:
            option = param.opts[-1] if param is not None else "option"
            raise Error(
                f"option {option}: {path}: ends in {path.suffix}; its name must end in "
                f"{' or '.join(self.suffixes)}"
            )
        return path


# Values of the option --form, which selects filter and settings.
# default: the Kalman filter (tse_config_default())
# robust: the paper's particle filter with settings that keep it from diverging
#         (tse_config_robust())
# paper: the paper's particle filter as printed (tse_config_paper())
FORMS = ("default", "robust", "paper")
DAY = 86400.0  # [s] duration of a day
MAX_AGE = 40000.0  # [days] max value of --age


def read_key_values(pairs: tuple[str, ...]) -> dict[str, float]:
    """Parse the values of --set, each KEY=NUMBER. Return the numbers by their keys."""
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
    """Check all settings of a command line, and return them by name.

    `pairs`: the values of --set. `options`: settings that have an option of their own,
    such as --seed; None: not given. `simulator`: whether --set may also give settings of
    the simulator (`tselab simulate`). If `pairs` and `options` give the same setting,
    `pairs` is used or, if `simulator`, `options`."""
    from tse import tables

    own = {name: value for name, value in (options or {}).items() if value is not None}
    others = read_key_values(pairs)
    for name, value in own.items():
        tables.check_setting(name, value, source=f"option --{_find_option(name)}", simulator=simulator)
    for name, value in others.items():
        tables.check_setting(name, value, source="option --set", simulator=simulator)
    return {**others, **own} if simulator else {**own, **others}


def _find_option(setting: str) -> str:
    """Return the name of the option that sets a setting. One option, --spread, sets three
    settings: spread_cx_front, spread_cy_front and spread_cy_rear."""
    return "spread" if setting.startswith("spread_") else setting.replace("_", "-")


def show_progress(progress: bool | None) -> bool:
    """Return whether to show progress: the value of the option --progress or, if it is
    None, whether stderr is a terminal."""
    return sys.stderr.isatty() if progress is None else progress


def convert_age(days: float | None, load_learnt: Path | None) -> float:
    """Return the age [s] of a learnt state: the time since an earlier drive saved its
    filter state. Raise Error if `days` is given without `load_learnt`, or is outside
    0 .. MAX_AGE.

    `days`: value of --age. If None, return UNKNOWN_AGE, so that tse.estimate() uses the
    age of the file. `load_learnt`: file of the learnt state; None: no learnt state."""
    import tse

    if days is None:
        return tse.UNKNOWN_AGE
    if load_learnt is None:
        raise Error("option --age: needs --load-learnt, which names the learnt state that has this age")
    check_range("age", days, 0.0, MAX_AGE, "days")
    return days * DAY


def print_json(document: Any) -> None:
    """Print a document as JSON on standard output. Paths become strings."""
    click.echo(json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False, default=str))


def check_table(path: Path | None) -> None:
    """Raise Error if the file of --table has a wrong suffix or cannot be written. Called
    before a long run, so that the user gets this error at once. None: --table is not
    given, and there is no error."""
    from tse import files

    if path is None:
        return
    if not files.is_parquet(path) and path.suffix.lower() != ".csv":
        raise Error(f"option --table: {path}: the name of a table must end in .parquet, .pq or .csv")
    files.check_writable(path)


@contextmanager
def silence_warnings() -> Iterator[None]:
    """Suppress the UserWarnings of tse.estimate(), because the command prints the same
    sentences itself."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        yield


CALIBRATE = click.option(
    "--calibrate/--no-calibrate",
    default=True,
    show_default=True,
    help="Before the estimate, calibrate a car without calibrated stiffness on its own logs.",
)


class _Form(click.Choice):
    """Type of the option --form: one of FORMS. Earlier versions also had the value
    "sampled". If it is given, the error message names the value to use instead."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        if value == "sampled":
            self.fail(
                f"'sampled' was removed: use 'robust' instead. Allowed: {', '.join(FORMS)}.", param, ctx
            )
        return super().convert(value, param, ctx)


FORM = click.option(
    "--form",
    type=_Form(FORMS),
    default="default",
    show_default=True,
    help="paper: the paper's particle filter as printed. robust: the same with settings that keep it from "
    "diverging. Both are less safe than the default.",
)
PROGRESS = click.option(
    "--progress/--no-progress", default=None, help="Show progress; default: only if stderr is a terminal."
)


@contextmanager
def show_steps(progress: bool | None) -> Iterator[Callable[[str], None]]:
    """Yield a function that prints the current step, with the seconds since the start. On
    a terminal each step replaces the line of the previous step. If progress is not to be
    shown, the function does nothing."""
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
    help="Database that defines the frames of a bus: DBC, ARXML, KCD or SYM; default: those in the folder "
    "of the log. May be repeated.",
)
ROAD = click.option(
    "--road", "road_path", metavar="ROAD.csv", type=FILE, help="Table of bank and grade along the road."
)
JSON = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON instead of sentences.")
TABLE_HELP = "Also write the result as a table, .parquet or .csv."


def add_program_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add --json and --table to a command."""
    command = click.option("--table", metavar="TABLE.parquet", type=FILE, help=TABLE_HELP)(command)
    return JSON(command)


def add_reading_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of a command that reads logs: --signals, --rate, --strict and
    --database. The command receives them as one argument `reading`, a tse.Reading."""

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
            help="Rows per second after resampling; default: the rate of the fastest channel, at most 100. "
            "A log whose rows are evenly spaced is not resampled.",
        ),
        DATABASE,
        click.option(
            "--signals",
            metavar="SIGNALS.toml",
            type=FILE,
            help="File that assigns signals of the log to channels ('tselab signals' proposes one); default: "
            "signals.toml in the folder of the log.",
        ),
    ):
        with_reading = option(with_reading)
    return with_reading


JOBS = click.option(
    "--jobs",
    type=click.IntRange(1, 256),
    default=os.cpu_count() or 1,
    show_default="all cores",
    help="Number of parallel processes.",
)
FIRST_SEED = click.option(
    "--first-seed",
    type=click.IntRange(0, 2000000000),
    default=1,
    show_default=True,
    help="Seed of the first run.",
)
RESTART = click.option("--restart", is_flag=True, help="Discard runs that are already in DIR.")


class Lazy(click.Command):
    """A command with tables at the end of its --help. The tables are made only for
    --help, because making them loads the C library, which takes time.

    Parameters
    ----------
    tables
        Pairs (title, function). The function returns the text of the table. It may be
        given by its name in tse.tables.
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
    """Raise Error if an option has a value outside its range. None: the option was not
    given, and there is no error."""
    if value is not None and not low <= value <= high:
        raise Error(f"option --{name}: {value:g} is outside its range {low:g} .. {high:g} {unit}")
