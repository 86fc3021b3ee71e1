"""The command `tselab estimate`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tselab.options import (
    CALIBRATE,
    FILE,
    FORM,
    PAGES,
    PROGRESS,
    ROAD,
    TABLES,
    Lazy,
    OutputPath,
    add_program_options,
    add_reading_options,
    check_table,
    convert_age,
    fold,
    print_json,
    read_settings,
    show_progress,
    show_steps,
    silence_warnings,
)

if TYPE_CHECKING:
    from tse import Reading, Result

# max number of stretches of road that --verbose prints. A stretch is a part of the drive
# from one change of the stiffness to the next
MAX_PRINTED_STRETCHES = 12
MAX_LINES = 12  # max number of printed lines without --verbose
# without --verbose, max number of printed events (change of the road, sensor fault,
# sliding), and max number of printed notes
MAX_EVENTS, MAX_NOTES = 4, 2
OUTPUT_LABELS = {"estimates": "Estimates", "report": "Report", "table": "Table", "learnt": "Learnt state"}
Files = dict[str, Path | None]


@click.command(
    cls=Lazy,
    tables=(
        (
            "Columns of LOG.csv (SI units, ISO 8855: left and forward positive; an empty cell is a "
            "missing value)",
            "log_columns_table",
        ),
        (
            "Columns of EST.csv after time (_sd: standard deviation of the estimate; _spread: model "
            "discrepancy, with --form paper or robust the sd of the stiffness from sample to sample)",
            "est_columns_table",
        ),
        ("Codes", "codes_table"),
    ),
)
@click.argument("log_path", metavar="LOG", type=FILE)
@click.option(
    "--vehicle",
    "vehicle_path",
    metavar="CAR.toml",
    type=FILE,
    required=True,
    help="Vehicle file; 'tselab vehicle --example' prints one.",
)
@click.option(
    "--config",
    "config_path",
    metavar="FILTER.toml",
    type=FILE,
    help="Filter settings; 'tselab settings' lists them.",
)
@click.option(
    "--out",
    metavar="EST.csv",
    type=OutputPath(*TABLES),
    help="Estimates, .csv or .parquet; default: name of the log with .est.csv, in the current directory.",
)
@click.option(
    "--report",
    metavar="REPORT.html",
    type=OutputPath(*PAGES),
    help="Also write a report with interactive plots.",
)
@click.option(
    "--load-learnt", metavar="FILE", type=FILE, help="Start from the learnt state of an earlier drive."
)
@click.option(
    "--age", metavar="DAYS", type=float, help="Age of the learnt state; default: the age of its file."
)
@click.option(
    "--save-learnt",
    metavar="FILE",
    type=FILE,
    help="Write the learnt state after this drive; may be the file of --load-learnt.",
)
@click.option(
    "--average",
    metavar="SECONDS",
    type=float,
    help="First average the log over blocks of this length, at most 0.1 s.",
)
@CALIBRATE
@ROAD
@add_reading_options
@add_program_options
@click.option(
    "--verbose",
    is_flag=True,
    help="Print everything: values that were filled in, all notes, all values of every stretch of road.",
)
@click.option("--seed", type=int, help="Seed of the random numbers; --form paper or robust.")
@click.option("--particles", type=int, help="Number of particles; --form paper or robust.")
@click.option("--forgetting", type=float, help="Forgetting factor per sample; --form paper or robust.")
@FORM
@click.option(
    "--set", "pairs", metavar="KEY=VALUE", multiple=True, help="Any other setting; may be repeated."
)
@PROGRESS
def estimate(
    log_path: Path,
    vehicle_path: Path,
    config_path: Path | None,
    out: Path | None,
    report: Path | None,
    load_learnt: Path | None,
    age: float | None,
    save_learnt: Path | None,
    average: float | None,
    calibrate: bool,
    road_path: Path | None,
    form: str,
    pairs: tuple[str, ...],
    progress: bool | None,
    reading: Reading,
    as_json: bool,
    table: Path | None,
    verbose: bool,
    **options: Any,
) -> int:
    """Estimate tyre stiffness from LOG.

    \b
    tselab estimate log.csv --vehicle car.toml
    tselab estimate log.csv --vehicle car.toml --out est.csv --report report.html
    tselab estimate log.csv --vehicle car.toml --form paper --particles 200
    tselab estimate monday.csv --vehicle car.toml --save-learnt car.tse
    tselab estimate friday.csv --vehicle car.toml --load-learnt car.tse --age 4

    LOG is a CSV with the columns below, or a file of any format that 'tselab signals
    --help' lists. The signals of such a file may have other names, units, rates and
    latencies. A file signals.toml in the folder of the log, or --signals, assigns them to
    channels. 'tselab signals LOG --write signals.toml' proposes one.

    \b
    [signals.steer_angle]          [signals.wheel_speed_front]     [signals.accel_y]
    name = "LWI_Lenkradwinkel"     name = ["ESP_VL", "ESP_VR"]     name = "ESP_Querbeschl"
    unit = "deg"                   unit = "km/h"                   unit = "g"
    ratio = 15.3                   latency = 0.02                  sign = -1

    Further keys of a channel: scale, offset, sign_bit (a signal that is 1 if the value is
    negative), add (a signal whose value is added), radius (wheel radius, m), valid and
    counter (signals of the same message: valid marks values as valid, counter counts the
    messages), clock (s; for formats whose groups of signals have different clocks: time
    by which the clock of this signal is ahead of that of the other signals), hold (true:
    the signal is sent only when it changes, so each value is held until the next), unsure
    (properties of this signal that were guessed by 'tselab signals'; until you remove the
    key, every run prints them, and --strict refuses the log). ratio (angle of the
    steering wheel / angle of the road wheels) may be a table [[angle of the steering
    wheel in the unit of the signal, ratio], ...]. Keys of [log]: time, time_unit, step,
    rate, databases, separator, decimal, encoding, header. If the log does not have a
    channel, this channel is missing in all rows, and the quantities that are observable
    without it are estimated.

    If the vehicle file does not give a value, the run assumes the value of an ordinary
    car with the same mass, lf and lr (src/tables/uncalibrated.toml): stiffness
    proportional to the axle load, yaw inertia = mass * lf * lr, grip of a dry road. An
    assumed value has the standard deviation found among ordinary cars; --verbose lists
    the assumed values. With a vehicle file of 'tselab calibrate', the values and their
    standard deviations are those that the calibration has found.

    The default filter also estimates noise and biases of the sensors. --form paper and
    --form robust select the particle filters instead. For these, the noise is estimated
    from the log before the filter runs.

    A car without calibrated stiffness (no [calibration] and no [uncertainty] in its file)
    is first calibrated on the log itself, on at most ten minutes of it. The run prints
    the result, and the name of the file that keeps it for the next run. There is no
    calibration with --no-calibrate, nor with --load-learnt or --save-learnt (see below).

    With --save-learnt, the filter writes its state after the drive, the learnt state:
    stiffness, grip, sensor biases, and offset, gain and latency of the steering, with
    their covariance. With --load-learnt, a later drive starts from this state. The state
    is valid only for the same vehicle file, so the car is not calibrated again. The older
    the state, the larger the variances with which the drive starts ('tselab settings'
    explains the settings learnt_floor and learnt_walk_day).

    The report also draws columns of the log that start with ref_. Those that name an
    estimated quantity (ref_vel_x, ref_yaw_rate_anything, ref_cy_front, ref_vehicle_speed,
    ref_wheel_fl ...) are drawn together with it, others separately. The time between rows
    may be 0.001 to 1 s, and may vary. The particle filters (--form paper, robust) treat
    noise of the wheel speeds as slip, and then underestimate the stiffness. --average
    0.1 reduces this noise: the filter gets the mean of each block of 0.1 s, and EST.csv
    has a row for each block. A noise sd in the vehicle file is always that of a single
    sample, not of a mean. Ctrl-C stops the run and writes the rows done so far.

    --road gives the filter the bank and grade of the road in each row. The position on
    the road is found from gnss_latitude and gnss_longitude or, without them, from the
    curvature of the driven path (yaw rate / speed). Columns of road.csv: distance [m],
    bank (left side high > 0), grade (uphill > 0), bank_sd, grade_sd [rad]; closed (1 for
    a circuit, whose last row is at the same place as the first); and the path of the
    road, either as latitude, longitude [deg], or as x, y [m], or as curvature [1/m]. A
    log that was driven on a different road is refused.

    When road surface or tyres change, the stiffness changes. At the changes that the
    filter finds, the drive is divided into stretches. For each of the last two stretches
    the command prints a line for each stiffness: its value with its 95 % interval, and
    whether it is usable. With the default filter this value is smoothed, i.e. later rows
    contribute to it, too. --verbose also prints the filtered values at the end of each
    stretch, grip, the largest sideslip angle, and the values that were assumed because
    the vehicle file does not give them.

    Exit code: 0 usable: every stiffness is valid; 3 usable in part: only some are; 4
    nothing usable: no stiffness is valid, but the estimates are written; 2 bad input; 130
    Ctrl-C. --json prints the result as JSON instead of sentences. --table writes the
    result as a table with a row for each stiffness on each stretch of road.
    """
    import tse
    from tse.files import check_distinct, check_writable

    out = out or Path(log_path.stem + ".est.csv")
    inputs = {
        "the log": log_path,
        "--vehicle": vehicle_path,
        "--config": config_path,
        "--signals": reading.signals,
        "--road": road_path,
    }
    check_distinct({"--out": out, "--report": report, "--save-learnt": save_learnt, "--table": table}, inputs)
    # only --save-learnt may overwrite the file of --load-learnt
    check_distinct({"--out": out, "--report": report, "--table": table}, {"--load-learnt": load_learnt})
    check_table(table)
    check_writable(out, report, save_learnt)
    age_s = convert_age(age, load_learnt)
    settings = read_settings(pairs, options)
    with show_steps(progress) as show, silence_warnings():
        result = tse.estimate(
            log_path,
            vehicle_path,
            settings=settings,
            form=form,
            average=average,
            learnt=load_learnt,
            age=age_s,
            calibrate=calibrate and save_learnt is None,
            road=road_path,
            config=config_path,
            reading=reading,
            out=out,
            report=report,
            keep_partial=True,
            progress=show,
            bar=show_progress(progress),
        )
    notes = [n for n in result.messages if n not in result.cautions]
    if save_learnt is not None and result.learnt is not None:
        result.save_learnt(save_learnt)
    elif save_learnt is not None:
        why = "the channels contradict each other" if result.warnings else "no row was used"
        notes.append(f"{why}, so nothing was learnt, and {save_learnt} is not written")
    if table is not None:
        result.write_table(table)
    written: Files = {"estimates": out, "report": report if result.reported else None, "table": table}
    written["learnt"] = save_learnt if result.learnt is not None else None
    if as_json:
        print_json({**result.to_dict(), "notes": notes, "written": written})
    elif verbose:
        print_all(result, notes, written)
    else:
        print_answer(result, notes, written, report is not None)
    if result.calibration_interrupted:
        click.echo(
            f"tselab: the calibration was stopped by Ctrl-C; the estimates in {out} assume an ordinary car",
            err=True,
        )
        sys.exit(130)
    if result.interrupted:
        rows = f"{result.rows} of {len(result.log)} rows"
        click.echo(f"tselab: stopped by Ctrl-C after {rows}; {out} has their estimates", err=True)
        sys.exit(130)
    return result.exit_code


def print_all(result: Result, notes: list[str], written: Files) -> None:
    """Print the whole result (--verbose). Warnings and notes go to standard error."""
    if result.started_from is not None:
        click.echo(f"started from: {result.started_from}")
    for name, value in result.facts:
        click.echo(f"{name + ':':<11}{value}")
    car = result.vehicle
    if car is not None:
        for line in (*car.found, *(f"filled in: {f}" for f in car.filled)):
            click.echo(line)
    for line in dict.fromkeys((*result.messages, *notes)):
        click.echo(f"{'warning' if line in result.cautions else 'note'}: {line}", err=True)
    for line in result.events:
        click.echo(line)
    for lines in result.stretch_words[:MAX_PRINTED_STRETCHES]:
        click.echo("\n".join(lines))
    if len(result.stretch_words) > MAX_PRINTED_STRETCHES:
        click.echo(
            f"and {len(result.stretch_words) - MAX_PRINTED_STRETCHES} more stretches, which --report lists"
        )
    print_written(written)


def print_answer(result: Result, notes: list[str], written: Files, has_report: bool) -> None:
    """Print the answer: for the last stretches of road, the value of each stiffness and
    whether it is usable. Then print every warning and, as far as MAX_LINES allows, the
    latest events (change of the road, sensor fault, sliding) and the first notes. Then
    print the number of events and notes that are not shown.

    Warnings and notes go to standard error."""
    found, filled = (result.vehicle.found, result.vehicle.filled) if result.vehicle is not None else ([], [])
    warnings = [f"warning: {line}" for line in result.cautions]
    # If channels contradict each other, the filter attributes the contradiction to
    # changes and faults that did not happen. Therefore its events are not printed
    events = [*(() if result.warnings else result.events), *found[:1]]
    plain = [f"note: {n}" for n in notes]
    folded = {text: fold(text) for text in (*warnings, *events, *plain)}
    used = len(result.answer) + sum(len(folded[w]) for w in warnings)
    room = MAX_LINES - used - sum(path is not None for path in written.values()) - 1
    shown = []
    for text in (*events[: -MAX_EVENTS - 1 : -1], *plain[:MAX_NOTES]):
        if len(folded[text]) <= room:
            shown.append(text)
            room -= len(folded[text])
    for line in result.answer:
        click.echo(line)
    for text in (*warnings, *(t for t in events if t in shown), *(t for t in plain if t in shown)):
        click.echo("\n".join(folded[text]), err=text not in events)
    more = len(events) + len(plain) - len(shown) + len(found[1:]) + len(filled)
    if more:
        page = "" if has_report else ", or --report PAGE.html"
        click.echo(f"{more} more note{'s' if more > 1 else ''}: --verbose{page}")
    print_written(written)


def print_written(written: Files) -> None:
    """Print the paths of the written files. None: the file was not written."""
    for what, path in written.items():
        if path is not None:
            click.echo(f"{OUTPUT_LABELS[what]} written to {path}")
