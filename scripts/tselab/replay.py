"""The command `tselab replay`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from tselab.gap import VEHICLE
from tselab.options import FILE, JSON, PAGES, ROAD, OutputPath, add_reading_options, print_json, read_settings

if TYPE_CHECKING:
    from tse import Reading


@click.command()
@click.argument("log_path", metavar="LOG", type=FILE)
@VEHICLE
@click.option(
    "--out",
    metavar="TABLE.csv",
    type=OutputPath(".csv"),
    help="Also write every row: measured and simulated channels.",
)
@click.option(
    "--report",
    metavar="PAGE.html",
    type=OutputPath(*PAGES),
    help="Also write a page with plots of measured and simulated channels.",
)
@click.option(
    "--set", "pairs", metavar="KEY=VALUE", multiple=True, help="Any setting of the car; may be repeated."
)
@ROAD
@add_reading_options
@JSON
def replay(
    log_path: Path,
    vehicle_path: Path,
    out: Path | None,
    report: Path | None,
    road_path: Path | None,
    pairs: tuple[str, ...],
    reading: Reading,
    as_json: bool,
) -> None:
    """Compare a log with a simulation that has the logged inputs.

    \b
    tselab replay drive.csv --vehicle car.toml --report before.html
    tselab replay drive.csv --vehicle found/vehicle_improved.toml --report after.html

    The single-track model is simulated with the logged steering angle and wheel speeds,
    and with the effects (such as body roll, a steering lag, or a formula of your own) and
    latencies of the vehicle file. Above 3 m/s, the simulated accel_x, accel_y and
    yaw_rate are compared with the measured ones. No parameter is fitted. Without --road
    the simulated road is level, so bank and grade of the real road are part of the
    difference.
    """
    import tse
    from tse.files import check_distinct, check_writable

    inputs = {"LOG": log_path, "--vehicle": vehicle_path, "--signals": reading.signals, "--road": road_path}
    check_distinct({"--out": out, "--report": report}, inputs)
    check_writable(out, report)
    settings = read_settings(pairs)
    found = tse.replay(log_path, vehicle_path, settings=settings, road=road_path, reading=reading)
    if out is not None:
        found.write(out)
    if report is not None:
        found.report(report)
    written = [str(p) for p in (out, report) if p is not None]
    if as_json:
        print_json({"log": log_path, "vehicle": vehicle_path, **found.to_dict(), "written": written})
        return
    for line in found.notes:
        click.echo(f"note: {line}", err=True)
    for line in found.words:
        click.echo(line)
    if written:
        click.echo(f"Written: {', '.join(written)}")
