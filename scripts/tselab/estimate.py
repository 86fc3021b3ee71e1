"""`tselab estimate`."""

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

MAX_STRETCHES = 12  # stretches of road with --verbose
MAX_LINES = 12  # of the terminal, without --verbose
MAX_EVENTS, MAX_NOTES = 4, 2  # without --verbose
WRITTEN = {"estimates": "Estimates", "report": "Report", "table": "Table", "learnt": "Learnt state"}
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
            "Columns of EST.csv after time; _sd: of the estimate; _spread: model discrepancy, of "
            "particles from sample to sample",
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
    help="Estimates, .csv or .parquet; default: the log's name with .est.csv, in the current directory.",
)
@click.option(
    "--report",
    metavar="REPORT.html",
    type=OutputPath(*PAGES),
    help="Also write a report with interactive plots.",
)
@click.option("--load-learnt", metavar="FILE", type=FILE, help="Start from what an earlier drive taught.")
@click.option(
    "--age", metavar="DAYS", type=float, help="How long ago that was; default: the age of the file."
)
@click.option(
    "--save-learnt", metavar="FILE", type=FILE, help="Write what this drive teaches; may be the same file."
)
@click.option(
    "--average",
    metavar="SECONDS",
    type=float,
    help="Average the log over blocks of so long first, at most 0.1 s.",
)
@CALIBRATE
@ROAD
@add_reading_options
@add_program_options
@click.option(
    "--verbose",
    is_flag=True,
    help="Say all: what was filled in, notes, every number of every stretch of road.",
)
@click.option("--seed", type=int, help="Seed of the random numbers; --form paper or robust.")
@click.option("--particles", type=int, help="Particles in use; --form paper or robust.")
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

    LOG is a CSV with the columns below, or any format that 'tselab signals --help' lists,
    with names, units, rates and latencies of its own: signals.toml beside it, or
    --signals, says which signal is which, and 'tselab signals LOG --write signals.toml'
    proposes it.

    \b
    [signals.steer_angle]          [signals.wheel_speed_front]     [signals.accel_y]
    name = "LWI_Lenkradwinkel"     name = ["ESP_VL", "ESP_VR"]     name = "ESP_Querbeschl"
    unit = "deg"                   unit = "km/h"                   unit = "g"
    ratio = 15.3                   latency = 0.02                  sign = -1

    Further keys: scale, offset, sign_bit, add (a signal with the rest of the value),
    radius (of a wheel, m), valid and counter (signals of the message that say so), clock
    (s by which the clock of its group is ahead of the others), hold (sent only when it
    changes), unsure (what was guessed: every run lists it, and --strict refuses, until it
    is taken out); ratio may be a table [[angle, ratio], ...]. [log]: time, time_unit,
    step, rate, databases, separator, decimal, encoding, header. Channels that the log
    does not have are missing; what is still observable is estimated.

    What the vehicle file leaves out is that of an ordinary car of its mass and axles
    (src/tables/uncalibrated.toml): stiffness from the axle loads, yaw inertia mass lf lr,
    grip of a dry road, each with the scatter of such cars; the run lists it. Noise and
    biases of the sensors are found while driving; with --form paper or robust the noise
    is found in the log beforehand. After 'tselab calibrate' the prior is the posterior of
    the calibration. A car that nobody has calibrated - no [calibration] and no
    [uncertainty] in its file - is calibrated on the log itself first, on at most ten
    minutes of it: the run says what that found and where it is kept for the next run;
    --no-calibrate leaves it out. A learnt state is of the car as its file has it, so
    --load-learnt and --save-learnt leave it out, too.

    Columns of the log that start with ref_ are drawn in the report: ref_vel_x,
    ref_yaw_rate_anything, ref_cy_front, ref_vehicle_speed, ref_wheel_fl ... with the
    quantity they name, others by themselves. Rows may come at any rate from 0.001 to 1 s,
    also irregularly. To the particle filters (--form paper, robust) noise of the wheel
    speeds passes for slip and makes tyres look soft: --average 0.1 makes less of it; rows
    of EST.csv are then blocks, and noise that the vehicle file states is taken for that
    of one sample. Ctrl-C stops early and writes the rows done so far.

    A learnt state holds stiffness, grip, sensor biases and steering, with their
    covariance. It fits the vehicle it was learnt with, and is trusted the less the older
    it is (settings learnt_floor, learnt_walk_day).

    --road gives the filter the bank and grade of the road under each row: the log is
    found on it by gnss_latitude and gnss_longitude, else by its path, the yaw rate over
    the speed. Columns of road.csv: distance [m], bank (left side high > 0), grade (uphill
    > 0), bank_sd, grade_sd [rad]; of its path latitude, longitude [deg], x, y [m] or
    curvature [1/m]; closed, 1 of a circuit, whose last row is the first one again. A log
    that is on another road is refused.

    The answer is a line for each stiffness: its value with its 95 % interval over the
    last stretches of road between changes, what came after a row counted, too; and
    whether to act on it. --verbose says all: the values at the end of each stretch, grip,
    the largest sideslip angle, what was filled in.

    Exit code: 0 usable: every stiffness is valid; 3 usable in part; 4 nothing usable: the
    estimates are written, and no stiffness is valid; 2 bad input; 130 Ctrl-C. --json says
    what was found as JSON on standard output, in place of words; --table writes it as a
    row per stretch of road and stiffness.
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
    # --save-learnt may replace the file that was loaded, the other outputs may not
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
        notes.append(f"{why}, so nothing was learnt: {save_learnt} is not written")
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
            f"tselab: the calibration was stopped by Ctrl-C; {out} is that of an ordinary car", err=True
        )
        sys.exit(130)
    if result.interrupted:
        rows = f"{result.rows} of {len(result.log)} rows"
        click.echo(f"tselab: stopped by Ctrl-C after {rows}; {out} holds the rows done", err=True)
        sys.exit(130)
    return result.exit_code


def print_all(result: Result, notes: list[str], written: Files) -> None:
    """Print everything that the run found; warnings and notes on standard error."""
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
    for lines in result.stretch_words[:MAX_STRETCHES]:
        click.echo("\n".join(lines))
    if len(result.stretch_words) > MAX_STRETCHES:
        click.echo(f"and {len(result.stretch_words) - MAX_STRETCHES} more stretches, which --report lists")
    print_written(written)


def print_answer(result: Result, notes: list[str], written: Files, has_report: bool) -> None:
    """Print the answer and every warning, and the last events and first notes that
    MAX_LINES have room for.

    The last line says how many more there are. Warnings and notes go to standard
    error."""
    found, filled = (result.vehicle.found, result.vehicle.filled) if result.vehicle is not None else ([], [])
    warnings = [f"warning: {line}" for line in result.cautions]
    # events that a filter finds in wrong channels did not happen
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
    """Print which files were written."""
    for what, path in written.items():
        if path is not None:
            click.echo(f"{WRITTEN[what]} written to {path}")
