"""The command `tselab calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from tselab.gap import HOLD_OUT, LOGS, VEHICLE, RunCommand, check_logs_once
from tselab.options import (
    FILE,
    JOBS,
    PAGES,
    PROGRESS,
    ROAD,
    OutputPath,
    add_program_options,
    add_reading_options,
    check_table,
    fold_all,
    print_json,
    show_steps,
)

if TYPE_CHECKING:
    from tse import Reading


@click.command(cls=RunCommand)
@LOGS
@VEHICLE
@click.option(
    HOLD_OUT,
    "hold_out",
    metavar="LOG.csv ...",
    type=FILE,
    multiple=True,
    help="Logs that are not used for the fit; the calibrated car is validated on them. Takes all files up to "
    "the next option.",
)
@click.option(
    "--out",
    metavar="CALIBRATED.toml",
    type=OutputPath(".toml"),
    required=True,
    help="The calibrated vehicle file; a .json and a .html file are written next to it.",
)
@ROAD
@click.option(
    "--report",
    metavar="PAGE.html",
    type=OutputPath(*PAGES),
    help="Path of the HTML page; default: CALIBRATED.html.",
)
@click.option("--verbose", is_flag=True, help="Print every parameter and every channel.")
@click.option("--steps", type=click.IntRange(1, 1000), help="Max number of steps of the fit.  [default: 40]")
@add_reading_options
@add_program_options
@JOBS
@PROGRESS
def calibrate(
    logs: tuple[Path, ...],
    vehicle_path: Path,
    hold_out: tuple[Path, ...],
    out: Path,
    road_path: Path | None,
    report: Path | None,
    verbose: bool,
    steps: int | None,
    jobs: int,
    progress: bool | None,
    reading: Reading,
    as_json: bool,
    table: Path | None,
) -> int:
    """Calibrate the parameters of a car and its sensors on logs of ordinary driving.

    \b
    tselab calibrate drive1.csv drive2.csv --vehicle car.toml --out calibrated.toml
    tselab calibrate *.csv --vehicle car.toml --hold-out other.csv --out calibrated.toml
    tselab estimate drive3.csv --vehicle calibrated.toml

    The car is simulated with the logged steering angle and wheel speeds. One fit of the
    simulated to the measured accel_x, accel_y and yaw_rate estimates all of these
    parameters: bank and grade of the roads; delay of every channel relative to the gyro;
    ratio, offset and lag of the steering; wheel radii; position, mounting angles and
    scale of the IMU; roll and pitch of the body; relaxation length of the tyre forces;
    load transfer; yaw inertia; stiffness; noise of the sensors. The prior of each
    parameter is its distribution among passenger cars. If the logs have a measured
    velocity (columns ins_vel_x, ins_vel_y, gnss_speed), the fit uses this velocity, too.

    These logs determine a parameter if its posterior sd is clearly smaller than its prior
    sd. Every other parameter stays near its prior mean with a large sd, which widens the
    intervals of later estimates. The output states the number of these parameters,
    --verbose lists them. The output also names the drive or measurement that would narrow
    the intervals of the cornering stiffnesses most.

    With --hold-out, the calibrated car is validated on logs that the fit does not use.

    Half an hour of driving with bends and some braking is a good start. A second
    calibration, with --vehicle calibrated.toml and other logs, starts from the result of
    the first. With --road, bank and grade are read from ROAD.csv, and not fitted.

    \b
    CALIBRATED.toml            for tselab estimate, simulate, gap and fmu
    CALIBRATED.formula.toml    if the vehicle file names a formula, i.e. an effect of your
                               own ('tselab formula'): its copy. The simulation contains
                               this effect, and the fit does not change it
    CALIBRATED.json            all parameters as JSON
    CALIBRATED.html            all parameters as a page with plots; --report changes its
                               path

    --json prints all parameters on standard output, --table writes a table with a row for
    each parameter.

    Exit code: 0 usable: the fit converged, and these logs determine at least one
    parameter; 4 the fit converged, but these logs determine no parameter, or less than
    20 s of the logs can be compared with a simulation; 12 the fit did not converge (the
    files are written all the same); 2 bad input; 130 Ctrl-C.
    """
    import tse
    from tse.files import check_distinct, check_writable

    check_logs_once(logs, hold_out)
    check_writable(out, report)
    formula = tse.read_vehicle(vehicle_path).formula_path
    numbers, page = out.with_suffix(".json"), report or out.with_suffix(".html")
    kept_formula = out.with_suffix(".formula.toml") if formula else None
    check_distinct(
        {
            "--out": out,
            "the page": page,
            "the numbers": numbers,
            "the formula": kept_formula,
            "--table": table,
        },
        {"--vehicle": vehicle_path, "the formula of --vehicle": formula, "--signals": reading.signals}
        | {str(p): p for p in (*logs, *hold_out)},
    )
    check_table(table)
    with show_steps(progress) as show:
        found = tse.calibrate(
            logs,
            vehicle_path,
            hold_out=hold_out,
            road=road_path,
            reading=reading,
            steps=steps,
            jobs=jobs,
            progress=show,
        )
        found.write(out)
        show("writing the page")
        found.report(page)
    if table is not None:
        found.write_table(table)
    written = [
        str(out),
        *(p.name for p in (kept_formula, numbers, page) if p),
        *([str(table)] if table else []),
    ]
    if as_json:
        about = {"logs": logs, "vehicle": vehicle_path}
        print_json({**about, **found.to_dict(), "exit_code": found.exit_code, "written": written})
        return found.exit_code
    all_words = (*found.words, *(f"  {w}" for w in found.shown_words))
    for line in all_words if verbose else fold_all(found.answer):
        click.echo(line)
    notes = [f"note: {line}" for line in found.notes]
    for line in notes if verbose else fold_all(notes):
        click.echo(line, err=True)
    if not verbose:
        click.echo(f"More: --verbose, {page}")
    click.echo(f"Written: {', '.join(written)}")
    return found.exit_code
