"""`tselab estimate`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tse.library.errors import UserError
from tselab.options import (
    CALIBRATE,
    FILE,
    FORM,
    PAGES,
    PROGRESS,
    ROAD,
    TABLES,
    Lazy,
    Written,
    check_range,
    fold,
    for_programs,
    key_values,
    reading,
    saying,
    show_progress,
)

if TYPE_CHECKING:
    from tse.log.rows import Reading


MOST_FINDINGS = 12  # stretches of road with --verbose
MOST_LINES = 12  # without it
MOST_EVENTS, MOST_NOTES = 4, 2
WRITTEN = {"estimates": "Estimates", "report": "Report", "table": "Table", "learnt": "Learnt state"}


@click.command(
    cls=Lazy,
    tables=(
        (
            "Columns of LOG.csv (SI units, ISO 8855: left and forward positive; an empty cell is a missing value)",
            "log_columns_table",
        ),
        (
            "Columns of EST.csv after time; _sd: of the estimate; _spread: model discrepancy, of particles from sample to sample",
            "est_columns_table",
        ),
        ("Codes", "codes_table"),
    ),
)
@click.argument("log_path", metavar="LOG", type=FILE)
@click.option("--vehicle", "vehicle_path", metavar="CAR.toml", type=FILE, required=True,
              help="Vehicle file; 'tselab vehicle --example' prints one.")  # fmt: skip
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
    type=Written(*TABLES),
    help="Estimates, .csv or .parquet; default: the log's name with .est.csv, in the current directory.",
)
@click.option(
    "--report",
    metavar="REPORT.html",
    type=Written(*PAGES),
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
@reading
@for_programs
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
    tselab estimate log.csv --vehicle car.toml --form paper --particles 200 --forgetting 0.995
    tselab estimate monday.csv --vehicle car.toml --save-learnt car.tse
    tselab estimate friday.csv --vehicle car.toml --load-learnt car.tse --age 4 --save-learnt car.tse

    LOG is a CSV with the columns below, or any format that 'tselab signals --help' lists, with names, units, rates and latencies
    of its own: signals.toml beside it, or --signals, says which signal is which, and 'tselab signals LOG --write signals.toml'
    proposes it.

    \b
    [signals.steer_angle]            [signals.wheel_speed_front]       [signals.accel_y]
    name = "LWI_Lenkradwinkel"       name = ["ESP_VL", "ESP_VR"]       name = "ESP_Querbeschl"
    unit = "deg"                     unit = "km/h"                     unit = "g"
    ratio = 15.3                     latency = 0.02                    sign = -1

    Further keys: scale, offset, sign_bit, add (a signal with the rest of the value), radius (of a wheel, m), valid and counter
    (signals of the message that say so), clock (s by which the clock of its group is ahead of the others),
    hold (sent only when it changes), unsure (what was guessed: every run says so, and
    --strict refuses, until it is taken out); ratio may be a table [[angle, ratio], ...]. [log]: time, time_unit, step, rate,
    databases, separator, decimal, encoding, header. Channels that the log does not have are missing;
    what is still observable is estimated.

    What the vehicle file leaves out is that of an ordinary car of its mass and axles (src/tables/uncalibrated.toml): stiffness
    from the axle loads, yaw inertia mass lf lr, grip of a dry road, each with the scatter of such cars; the run lists it.
    Noise and biases of the sensors are found while driving; with --form paper or robust the noise is found in the log beforehand.
    After 'tselab calibrate' the prior is the posterior of the calibration. A car that nobody has calibrated - no [calibration] and
    no [uncertainty] in its file - is calibrated on the log itself first, on at most ten minutes of it: the run says what that
    found and where it is kept for the next run; --no-calibrate leaves it out. A learnt state is of the car as its file has it, so
    --load-learnt and --save-learnt leave it out, too.

    Columns of the log that start with ref_ are drawn in the report: ref_vel_x, ref_yaw_rate_anything, ref_cy_front,
    ref_vehicle_speed, ref_wheel_fl ... with the quantity they name, others by themselves. Rows may come at any rate from 0.001 to
    1 s, also irregularly. To the particle filters (--form paper, robust) noise of the wheel speeds passes for slip and makes
    tyres look soft: --average 0.1 makes less of it; rows of EST.csv are then blocks, and noise that the vehicle file states is
    taken for that of one sample. Ctrl-C stops early and writes the rows done so far.

    A learnt state holds stiffness, grip, sensor biases and steering, with their covariance. It fits the vehicle it was learnt
    with, and is trusted the less the older it is (settings learnt_floor, learnt_walk_day).

    --road gives the filter the bank and grade of the road under each row: the log is
    found on it by gnss_latitude and gnss_longitude, else by its path, the yaw rate over
    the speed. Columns of road.csv: distance [m], bank (left side high > 0), grade (uphill
    > 0), bank_sd, grade_sd [rad]; of its path latitude, longitude [deg], x, y [m] or
    curvature [1/m]; closed, 1 of a circuit, whose last row is the first one again. A log
    that is on another road is refused.

    The answer is a line for each stiffness: its value with its 95 % interval over the last stretches of road between changes,
    what came after a row counted, too; and whether to act on it. --verbose says all: the values at the end of each stretch, grip,
    the largest sideslip angle, what was filled in.

    Exit code: 0 usable: every stiffness is valid; 3 usable in part; 4 nothing usable: the estimates are written, and no stiffness
    is valid; 2 bad input; 130 Ctrl-C. --json says what was found as JSON on standard output, in place of words; --table writes it
    as a row per stretch of road and stiffness.
    """
    from tse.calibration.own import STOPPED
    from tse.estimation import regimes
    from tse.estimation.answer import answer
    from tse.estimation.estimate import read_learnt, write_learnt
    from tse.library.files import check_distinct, check_writable
    from tse.report import results
    from tse.report.results import run_facts
    from tse.roads.road import read_road
    from tse.runs import single
    from tse.runs.single import Calibrate, prepare

    out = out or Path(log_path.stem + ".est.csv")
    inputs = {"the log": log_path, "--vehicle": vehicle_path, "--config": config_path, "--signals": reading.signals,
              "--road": road_path}  # fmt: skip
    check_distinct({"--out": out, "--report": report, "--save-learnt": save_learnt, "--table": table}, inputs)
    # a file that is loaded may be replaced by what is learnt now, and by nothing else
    check_distinct({"--out": out, "--report": report, "--table": table}, {"--load-learnt": load_learnt})
    results.check_table(table)
    for path in (out, report, save_learnt):
        if path is not None:
            check_writable(path)
    if age is not None and load_learnt is None:
        raise UserError("option --age: is that of the file of --load-learnt, which is not given")
    check_range("age", age, 0.0, 40000.0, "days")
    learnt = read_learnt(load_learnt, age) if load_learnt else None
    road = read_road(road_path) if road_path is not None else None
    with saying(progress) as say:
        itself = (
            Calibrate(say, goes_on=True)
            if calibrate and load_learnt is None and save_learnt is None
            else None
        )
        prepared = prepare(
            log_path,
            vehicle_path,
            config_path,
            average,
            options,
            form,
            key_values(pairs),
            reading,
            itself,
            road,
        )
    vehicle, log, config, warnings = prepared.vehicle, prepared.log, prepared.config, prepared.warnings
    ran = single.run(prepared, out, report, learnt, show_progress(progress))
    est, notes, changes, found = ran.estimate, ran.notes, ran.changes, ran.findings
    if save_learnt is not None:
        if est.learnt is not None and not warnings:
            write_learnt(save_learnt, est.learnt)
        elif warnings:
            notes.append(
                f"the channels contradict each other, so nothing was learnt: {save_learnt} is not written"
            )
        else:
            notes.append(f"no row was used, so nothing was learnt: {save_learnt} is not written")
    odd = [*warnings, *prepared.doubts, *log.warnings]
    if table is not None:
        results.write_rows(table, results.rows(log_path, est, found, changes, odd), results.COLUMNS)
    written = {"estimates": out, "report": report if ran.reported else None, "table": table}
    written["learnt"] = save_learnt if est.learnt is not None and not warnings else None
    if as_json:
        said = {"vehicle": vehicle.path, "started_from": learnt.note if learnt is not None else None, "filled": vehicle.filled,
                "calibration": {**prepared.own.found, "words": vehicle.found} if prepared.own else None,
                "notes": [n for n in notes if n not in odd], "warnings": odd, "interrupted": est.interrupted,
                "written": written}  # fmt: skip
        results.say_json(results.document(log_path, est, found, config, said))
    elif verbose:
        if learnt is not None:
            click.echo(f"started from: {learnt.note}")
        for name, value in run_facts(est, log, vehicle, config):
            click.echo(f"{name + ':':<11}{value}")
        for line in (*vehicle.found, *(f"filled in: {f}" for f in vehicle.filled)):
            click.echo(line)
        for line in notes:
            click.echo(f"{'warning' if line in odd else 'note'}: {line}", err=True)
        for line in regimes.words(changes, regimes.spells(est.table)):
            click.echo(line)
        for finding in found[:MOST_FINDINGS]:
            click.echo("\n".join(finding.lines()))
        if len(found) > MOST_FINDINGS:
            click.echo(f"and {len(found) - MOST_FINDINGS} more stretches, which --report lists")
        say_written(written)
    else:
        # what a filter finds of channels that are wrong did not happen
        events = [] if warnings else regimes.words(changes, regimes.spells(est.table))
        plain = [f"note: {n}" for n in notes if n not in odd]
        say_shortly(
            answer(found, config), [f"warning: {line}" for line in odd], [*events, *vehicle.found[:1]], plain,
            len(vehicle.found[1:]) + len(vehicle.filled), written, report is not None,
        )  # fmt: skip
    if prepared.own is not None and prepared.own.found.get("why") == STOPPED:
        click.echo(
            f"tselab: the calibration was stopped by Ctrl-C; {out} is that of an ordinary car", err=True
        )
        sys.exit(130)
    if est.interrupted:
        click.echo(
            f"tselab: stopped by Ctrl-C after {len(est)} of {len(log)} rows; {out} holds the rows done",
            err=True,
        )
        sys.exit(130)
    return results.exit_code(found)


def say_shortly(
    answer: list[str],
    warnings: list[str],
    events: list[str],
    notes: list[str],
    hidden: int,
    written: dict[str, Path | None],
    page: bool,
) -> None:
    """Say the answer and every warning; of the last events and the first notes what MOST_LINES have room for, and how many more
    there are, `hidden` besides. Warnings and notes go to standard error."""
    folded = {text: fold(text) for text in (*warnings, *events, *notes)}
    room = (
        MOST_LINES
        - len(answer)
        - sum(len(folded[w]) for w in warnings)
        - sum(path is not None for path in written.values())
        - 1
    )
    shown = []
    for text in (*events[: -MOST_EVENTS - 1 : -1], *notes[:MOST_NOTES]):
        if len(folded[text]) <= room:
            shown.append(text)
            room -= len(folded[text])
    for line in answer:
        click.echo(line)
    for text in (*warnings, *(t for t in events if t in shown), *(t for t in notes if t in shown)):
        click.echo("\n".join(folded[text]), err=text not in events)
    more = len(events) + len(notes) - len(shown) + hidden
    if more:
        click.echo(
            f"{more} more note{'s' if more > 1 else ''}: --verbose{'' if page else ', or --report PAGE.html'}"
        )
    say_written(written)


def say_written(written: dict[str, Path | None]) -> None:
    """Say which files there are now."""
    for what, path in written.items():
        if path is not None:
            click.echo(f"{WRITTEN[what]} written to {path}")
