"""The command `tselab fleet`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from tse.errors import Error
from tselab.options import (
    CALIBRATE,
    FILE,
    FORM,
    JOBS,
    JSON,
    PROGRESS,
    add_reading_options,
    print_json,
    read_key_values,
    show_progress,
)

if TYPE_CHECKING:
    from tse import Reading

MAX_CARS = 5  # that the terminal names, the softest first
MAX_ERRORS = 10  # that the terminal names


@click.command()
@click.argument("words", metavar="LOG|FOLDER|GLOB ...", nargs=-1, required=True)
@click.option(
    "--vehicle", "vehicle_path", metavar="CAR.toml", type=FILE, help="The vehicle file of all cars."
)
@click.option(
    "--vehicles",
    "table",
    metavar="TABLE.csv",
    type=FILE,
    help="Which car each log is of: columns log, vehicle, car, signals.",
)
@click.option(
    "--out",
    metavar="DIR",
    type=FILE,
    required=True,
    help="Directory; made if needed; what is done there is used again.",
)
@click.option("--car", metavar="NAME", help="All logs are of this one car; else a folder of logs is a car.")
@click.option(
    "--learn/--no-learn",
    default=True,
    show_default=True,
    help="Each drive starts from what the one of the same car "
    "before it taught; else each by itself, all at once.",
)
@click.option("--reports/--no-reports", default=True, show_default=True, help="A report for each log.")
@click.option(
    "--estimates", is_flag=True, help="Also keep the estimates of each log, row by row, as Parquet."
)
@click.option(
    "--config",
    "config_path",
    metavar="FILTER.toml",
    type=FILE,
    help="Filter settings, as for 'tselab estimate'.",
)
@click.option(
    "--average",
    metavar="SECONDS",
    type=float,
    help="Average the logs over blocks of so long first, at most 0.1 s.",
)
@CALIBRATE
@add_reading_options
@FORM
@click.option(
    "--set", "pairs", metavar="KEY=VALUE", multiple=True, help="Any other setting; may be repeated."
)
@JOBS
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Run on a Dask cluster instead, for instance tcp://host:8786, whose workers "
    "see the logs under the same paths.",
)
@click.option("--restart", is_flag=True, help="Run all again, also what is done.")
@JSON
@PROGRESS
def fleet(
    words: tuple[str, ...],
    vehicle_path: Path | None,
    table: Path | None,
    out: Path,
    car: str | None,
    learn: bool,
    reports: bool,
    estimates: bool,
    config_path: Path | None,
    average: float | None,
    calibrate: bool,
    form: str,
    pairs: tuple[str, ...],
    jobs: int,
    scheduler: str | None,
    restart: bool,
    as_json: bool,
    progress: bool | None,
    reading: Reading,
) -> int:
    """Estimate many logs of many cars, and compare the cars.

    \b
    tselab fleet logs/ --vehicle car.toml --out results
    tselab fleet 'logs/**/*.mf4' --vehicles cars.csv --out results
    tselab fleet logs/ --vehicles cars.csv --out results --scheduler tcp://host:8786

    Each log is run as by 'tselab estimate', in any format that 'tselab signals --help'
    lists, with the signals.toml beside it or --signals. Each drive starts from the learnt
    state of the drive of the same car before it. Their order is that of the time in the
    log (MF4, MDF, BLF, MCAP), else of a date in its name or its folder's, else of the
    time of the file. Several cars run at once.

    The car of a log: with --vehicle, each folder directly below FOLDER is a car, however
    deep its logs are; with --car all logs belong to one car. With --vehicles, the first
    row of the table that matches the log: a file, a folder, or a pattern, relative to the
    table:

    \b
    log,vehicle,car,signals
    golf_17,cars/golf.toml,golf 17,
    taxi/*.blf,cars/rav4.toml,taxi,cars/rav4.signals.toml

    \b
    DIR/fleet.parquet   a row per log, stretch of road and stiffness: value, sd,
                        validity, changes, warnings; error of a bad log
    DIR/fleet.html      cars and trends, the softest first, with links to all reports
    DIR/reports/        a report for each log;  DIR/estimates/  with --estimates
    DIR/learnt/         learnt state of each car, for 'tselab estimate --load-learnt'
    DIR/calibrated/     vehicle files of cars that nobody had calibrated, made of their
                        first logs, at most ten minutes of four. Learnt states belong to
                        these. With --no-learn each log is calibrated by itself, with
                        --no-calibrate none
    DIR/logs/           the logs that are done: the same command continues from there,
                        also after it was killed, and runs new and changed logs

    \b
    python -c "import pandas; print(pandas.read_parquet('results/fleet.parquet'))"
    duckdb -c "select car, stiffness, arg_max(value, start_time)
    from 'results/fleet.parquet' where usable <> 'no' group by all"

    Exit code: 0 all logs are usable; 3 in part; 4 nothing usable in any; 2 bad input; 130
    Ctrl-C.
    """
    import tse

    if (vehicle_path is None) == (table is None):
        raise Error(
            "either --vehicle is needed, the vehicle file of all cars, or --vehicles, a table with one "
            "for each log"
        )
    if car is not None and table is not None:
        raise Error("option --car: the table of --vehicles says which car a log is of")
    done = tse.fleet(
        words,
        vehicle_path,
        out=out,
        vehicles=table,
        car=car,
        settings=read_key_values(pairs),
        config=config_path,
        form=form,
        average=average,
        reading=reading,
        learn=learn,
        calibrate=calibrate,
        reports=reports,
        estimates=estimates,
        restart=restart,
        jobs=jobs,
        isolate=True,
        scheduler=scheduler,
        bar=show_progress(progress),
    )
    if as_json:
        print_json({**done.to_dict(), "written": done.files})
        return done.exit_code
    count, page = done.counts, done.files[1]
    cars = f"{len(done.ranking)} car{'s' if len(done.ranking) != 1 else ''}"
    click.echo(
        f"{len(done)} logs of {cars}, {done.hours:.1f} h: {count['yes']} usable, {count['in part']} in part, "
        f"{count['no']} that tell nothing, {count['error']} that cannot be read"
    )
    for place, (name, reason) in enumerate(done.ranking[:MAX_CARS], 1):
        click.echo(f"{place}. {name or 'without a car'}: {reason}")
    if len(done.ranking) > MAX_CARS:
        click.echo(f"and {len(done.ranking) - MAX_CARS} more cars, which {page} lists")
    for error in done.errors[:MAX_ERRORS]:
        click.echo(f"error: {error}", err=True)
    if len(done.errors) > MAX_ERRORS:
        click.echo(f"and {len(done.errors) - MAX_ERRORS} more, which {page} lists", err=True)
    click.echo(f"Written to {out}: {', '.join(f.name for f in done.files)}")
    return done.exit_code
