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

MAX_CARS = 5  # max number of cars that are printed, those with the smallest stiffness first
MAX_ERRORS = 10  # max number of printed errors


@click.command()
@click.argument("words", metavar="LOG|FOLDER|GLOB ...", nargs=-1, required=True)
@click.option("--vehicle", "vehicle_path", metavar="CAR.toml", type=FILE, help="Vehicle file of all logs.")
@click.option(
    "--vehicles",
    "table",
    metavar="TABLE.csv",
    type=FILE,
    help="Table of the vehicle file of each log: columns log, vehicle, car, signals.",
)
@click.option(
    "--out",
    metavar="DIR",
    type=FILE,
    required=True,
    help="Directory, created if needed. Logs whose results it already contains are not run again.",
)
@click.option(
    "--car", metavar="NAME", help="Name of the car of all logs; default: each folder of logs is a car."
)
@click.option(
    "--learn/--no-learn",
    default=True,
    show_default=True,
    help="Start each drive from the learnt state of the previous drive of the car. With --no-learn all "
    "logs run independently and in parallel.",
)
@click.option("--reports/--no-reports", default=True, show_default=True, help="Write a report for each log.")
@click.option(
    "--estimates", is_flag=True, help="Also write the estimates of every row, in a Parquet file for each log."
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
    help="First average the logs over blocks of this length, at most 0.1 s.",
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
    help="Run on a Dask cluster instead, for instance tcp://host:8786. Its workers must "
    "have the logs under the same paths.",
)
@click.option("--restart", is_flag=True, help="Run all logs again, also those that are done.")
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

    Each log is estimated as 'tselab estimate' does it, with the option --signals or,
    without the option, with the signals.toml in the folder of the log. 'tselab signals
    --help' lists the formats. Each drive starts from the learnt state of the previous
    drive of the same car, i.e. from the estimates at the end of that drive: stiffness,
    grip, sensor biases, and offset, gain and latency of the steering. The order of the
    drives follows from the start time in the log (MF4, MDF, BLF, MCAP). If a log has no
    start time, the date in its name or in the name of its folder is used. If there is no
    such date, the modification time of the file is used. Several cars run in parallel.

    With --vehicle, each folder directly below FOLDER holds the logs of one car, also in
    its subfolders; with --car, all logs belong to one car. With --vehicles, the column
    'log' of the table holds files, folders or glob patterns. A log gets vehicle, car and
    signals from the first row whose entry in this column matches the path of the log.
    Paths in the table are relative to the folder of the table:

    \b
    log,vehicle,car,signals
    golf_17,cars/golf.toml,golf 17,
    taxi/*.blf,cars/rav4.toml,taxi,cars/rav4.signals.toml

    \b
    DIR/fleet.parquet   a row for each log, stretch of road (part of the drive from one
                        change of the stiffness to the next) and stiffness: value, sd,
                        validity, changes, warnings; for a log that cannot be estimated
                        a row with its error
    DIR/fleet.html      cars and their trends, the car with the smallest stiffness first,
                        with links to all reports
    DIR/reports/        a report for each log
    DIR/estimates/      with --estimates, the estimates of each log
    DIR/learnt/         learnt state of each car, for 'tselab estimate --load-learnt'
    DIR/calibrated/     for each car without calibrated stiffness, a vehicle file with
                        calibrated stiffness, from at most ten minutes of the first four
                        logs of the car. The learnt state of the car is valid only with
                        this vehicle file. With --no-learn each log is calibrated on
                        itself alone; with --no-calibrate there is no calibration
    DIR/logs/           results of the logs that are done. If the command is run again,
                        even after it was killed, it reads these results, and estimates
                        only logs that are new or have changed

    \b
    python -c "import pandas; print(pandas.read_parquet('results/fleet.parquet'))"
    duckdb -c "select car, stiffness, arg_max(value, start_time)
    from 'results/fleet.parquet' where usable <> 'no' group by all"

    Exit code: 0 every log is usable; 3 only some logs or parts of logs are usable;
    4 no log is usable; 2 bad input; 130 Ctrl-C.
    """
    import tse

    if (vehicle_path is None) == (table is None):
        raise Error(
            "give either --vehicle, the vehicle file of all logs, or --vehicles, a table with the vehicle "
            "file of each log"
        )
    if car is not None and table is not None:
        raise Error("option --car: is not allowed with --vehicles, whose column car names the cars")
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
        f"{len(done)} logs of {cars}, {done.hours:.1f} h: {count['yes']} usable, {count['in part']} usable "
        f"in part, {count['no']} not usable, {count['error']} not estimated because of an error"
    )
    for place, (name, reason) in enumerate(done.ranking[:MAX_CARS], 1):
        click.echo(f"{place}. {name or 'logs without a car'}: {reason}")
    if len(done.ranking) > MAX_CARS:
        click.echo(f"and {len(done.ranking) - MAX_CARS} more cars, which {page} lists")
    for error in done.errors[:MAX_ERRORS]:
        click.echo(f"error: {error}", err=True)
    if len(done.errors) > MAX_ERRORS:
        click.echo(f"and {len(done.errors) - MAX_ERRORS} more errors, which {page} lists", err=True)
    click.echo(f"Written to {out}: {', '.join(f.name for f in done.files)}")
    return done.exit_code
