"""The command `tselab simulate`."""

from pathlib import Path

import click

from tse.errors import Error
from tselab.options import (
    FILE,
    JSON,
    PROGRESS,
    ROAD,
    Lazy,
    OutputPath,
    check_range,
    print_json,
    read_settings,
    show_progress,
)

BUILT_IN = "the built-in car"
STIFFNESS = ("cx_front", "cy_front", "cy_rear")


def _list_maneuvers() -> str:
    from tse import tables

    return "\n".join(
        f"{k.name:<19} {k.duration:g} s from {k.speed:g} m/s, amplitude {k.amplitude:g} "
        f"({k.amplitude_text})\n"
        f"{'':<20}{k.text}"
        for k in tables.maneuvers()
    )


@click.command(
    cls=Lazy,
    tables=(("Manoeuvres", _list_maneuvers), ("Settings of the simulator (--set)", "sim_settings_table")),
)
@click.option("--maneuver", metavar="NAME", required=True, help="Name of the manoeuvre; list below.")
@click.option(
    "--vehicle",
    "vehicle_path",
    metavar="CAR.toml",
    type=FILE,
    help="Vehicle file; default: the built-in car.",
)
@click.option(
    "--out", metavar="LOG.csv", type=OutputPath(".csv"), required=True, help="The log, for 'tselab estimate'."
)
@click.option("--truth", metavar="TRUTH.csv", type=OutputPath(".csv"), help="Also write the true values.")
@click.option("--with-ref", is_flag=True, help="Also write the true values to columns ref_... of the log.")
@click.option("--seed", type=int, help="Seed of the random numbers.")
@click.option("--duration", type=float, help="Duration, s.")
@click.option("--sample-time", type=float, help="Time between rows, s.  [default: 0.01]")
@click.option("--speed", type=float, help="Initial speed, m/s.")
@click.option("--amplitude", type=float, help="Amplitude; its meaning is in the list below.")
@click.option(
    "--road-change",
    metavar="TIME:LEVEL",
    multiple=True,
    help="From TIME (s) on, every stiffness is LEVEL times nominal; may be repeated.",
)
@click.option(
    "--spread",
    type=float,
    help="Sd of each stiffness from sample to sample, as a fraction of the mean stiffness.",
)
@click.option("--noise", type=float, help="Factor on the sensor noise sd of the vehicle file.")
@click.option(
    "--set",
    "pairs",
    metavar="KEY=VALUE",
    multiple=True,
    help="Any setting of the simulator or vehicle; may be repeated.",
)
@ROAD
@PROGRESS
@JSON
def simulate(
    maneuver: str,
    vehicle_path: Path | None,
    out: Path,
    truth: Path | None,
    with_ref: bool,
    seed: int | None,
    duration: float | None,
    sample_time: float | None,
    speed: float | None,
    amplitude: float | None,
    road_change: tuple[str, ...],
    spread: float | None,
    noise: float | None,
    pairs: tuple[str, ...],
    road_path: Path | None,
    progress: bool | None,
    as_json: bool,
) -> None:
    """Simulate a manoeuvre. Write a log for 'tselab estimate', and the true values.

    \b
    tselab simulate --maneuver square-waves --out log.csv --truth truth.csv
    tselab simulate --maneuver double-lane-change --out log.csv --road-change 20:0.6
    tselab simulate --maneuver straight --out log.csv --set true_bias_yaw_rate=0.01

    With --road, the car drives along the road of this file: bank and grade at the
    distance travelled act on the car. If the file has positions, the log contains the
    position at this distance. The manoeuvre alone determines the steering: the car does
    not follow the bends of the road.
    """
    import tse
    from tse import tables
    from tse.files import check_distinct, check_writable

    check_distinct({"--out": out, "--truth": truth}, {"--vehicle": vehicle_path, "--road": road_path})
    check_writable(out, truth)
    car = tse.read_vehicle(vehicle_path) if vehicle_path else None
    own = {"seed": seed, "noise": noise, "sample_time": sample_time}
    settings = read_settings(pairs, own | {f"spread_{s}": spread for s in STIFFNESS}, simulator=True)
    top = tables.settings(simulator=True)["speed"]
    step = settings.get("sample_time", tables.settings()["sample_time"].default)
    check_range("speed", speed, top.low, top.high, "m/s")
    check_range("duration", duration, step, tables.MAX_DURATION, "s")
    check_range("amplitude", amplitude, -1000.0, 1000.0, "")
    if maneuver == "constant-radius":
        check_range("amplitude", amplitude, 10.0, 1000.0, "m (radius)")
    elif amplitude is not None:
        check_range("amplitude", abs(amplitude), 0.0, 1.2, "rad")
    drive = tse.simulate(
        maneuver,
        car,
        duration=duration,
        speed=speed,
        amplitude=amplitude,
        road_changes=_read_road_changes(road_change),
        settings=settings,
        road=road_path,
        bar=show_progress(progress),
    )
    drive.write(out, truth, with_ref=with_ref)
    name = car.name if car else BUILT_IN
    rows, seconds = len(drive.log), float(drive.log["time"].iloc[-1])
    used = int(settings.get("seed", tables.settings(simulator=True)["seed"].default))
    filled, notes = (car.filled, car.notes) if car else ([], [])
    if as_json:
        print_json(
            {
                "maneuver": maneuver,
                "vehicle": name,
                "rows": rows,
                "seconds": seconds,
                "seed": used,
                "filled": filled,
                "notes": notes,
                "written": {"log": out, "truth": truth},
            }
        )
        return
    for line in filled:
        click.echo(f"filled in: {line}")
    for line in notes:
        click.echo(f"note: {line}", err=True)
    click.echo(f"{maneuver}, {name}: {rows} rows, {seconds:g} s, seed {used}")
    click.echo(f"Log written to {out}" + (f", truth to {truth}" if truth else ""))


def _read_road_changes(pairs: tuple[str, ...]) -> list[tuple[float, float]]:
    """Parse the values of --road-change, each TIME:LEVEL. Return pairs (time [s], level):
    from this time to that of the next pair, every stiffness is level times nominal."""
    from tse import tables

    level = tables.road_level()
    changes = []
    for pair in pairs:
        try:
            time, value = (float(x) for x in pair.split(":"))
        except ValueError:
            raise Error(f"option --road-change: {pair!r} is not TIME:LEVEL, for instance 20:0.7") from None
        if not time >= 0 or not level.low <= value <= level.high:
            raise Error(
                f"option --road-change: {pair!r} is outside its range: TIME at least 0 s, LEVEL "
                f"{level.low:g} .. {level.high:g}"
            )
        changes.append((time, value))
    return changes
