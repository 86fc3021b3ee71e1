"""The command `tselab replay`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from tselab.gap import VEHICLE
from tselab.options import FILE, JSON, PAGES, ROAD, Written, key_values, reading

if TYPE_CHECKING:
    from tse.log.rows import Reading


@click.command()
@click.argument("log_path", metavar="LOG", type=FILE)
@VEHICLE
@click.option("--out", metavar="TABLE.csv", type=Written(".csv"), help="Every row, measured and simulated.")
@click.option("--report", metavar="PAGE.html", type=Written(*PAGES), help="The picture of it, for a browser.")
@click.option(
    "--set", "pairs", metavar="KEY=VALUE", multiple=True, help="Any setting of the car; may be repeated."
)
@ROAD
@reading
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
    """Show a log beside what the model of a car says of it.

    \b
    tselab replay drive.csv --vehicle car.toml --report before.html
    tselab replay drive.csv --vehicle found/vehicle_improved.toml --report after.html

    The single-track model is driven by the logged steering angle and wheel speeds, with the effects, latencies and the formula of
    the vehicle file; accel_x, accel_y and yaw_rate are compared, above 3 m/s. Nothing is fitted, and the road is level: what it
    climbs and leans by is in the difference, unless --road says it.
    """
    from dataclasses import replace

    from tse.car.vehicle import read_vehicle
    from tse.channels.agree import MAX_CHECKED_ROWS, check_car
    from tse.channels.log import read_log
    from tse.estimation.estimate import write_table
    from tse.library.core import Config
    from tse.library.files import check_distinct, check_writable
    from tse.log.rows import select_liveliest
    from tse.report.plots import layout, lines
    from tse.report.report import write_page
    from tse.report.results import say_json
    from tse.roads.road import read_road
    from tse.roads.road_match import add_road
    from tse.simulation.along import describe_misfit, list_curves, measure_misfit, simulate_along

    check_distinct({"--out": out, "--report": report}, {"LOG": log_path, "--vehicle": vehicle_path, "--signals": reading.signals,
                                                         "--road": road_path})  # fmt: skip
    check_writable(out, report)
    car = read_vehicle(vehicle_path)
    config = Config.exact(car.values)
    for key, value in key_values(pairs).items():
        config.set(key, value, source="option --set")
    words: list[str] = []
    log = read_log(log_path, reading=replace(reading, car=car))
    if road_path is not None:
        log, _ = add_road(log, read_road(road_path), config)
        words.append(log.notes[-1])
    notes = check_car(select_liveliest(log, MAX_CHECKED_ROWS), car, config) + words
    table = simulate_along(log, config)
    found = measure_misfit(table)
    if out is not None:
        write_table(table, out)
    if report is not None:
        title = f"{log_path.name}, measured and simulated"
        text = "Drag to zoom, double-click to reset; nothing is fitted."
        write_page(report, "replay.html.j2", [("Measured and simulated", text, layout(lines(list_curves(table)), 620))],
                   title=title, vehicle=car.name, words=describe_misfit(found))  # fmt: skip
    written = [str(p) for p in (out, report) if p is not None]
    if as_json:
        parts = {c: vars(a) for c, a in found.items()}
        say_json(
            {
                "log": log_path,
                "vehicle": vehicle_path,
                "measure_misfit": parts,
                "notes": notes,
                "written": written,
            }
        )
        return
    for line in notes:
        click.echo(f"note: {line}", err=True)
    for line in describe_misfit(found):
        click.echo(line)
    if written:
        click.echo(f"Written: {', '.join(written)}")
