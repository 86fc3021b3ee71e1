"""`tselab simulate`."""

from pathlib import Path

import click

from tse.library.errors import UserError
from tse.simulation import maneuvers
from tselab.options import FILE, JSON, PROGRESS, ROAD, Lazy, Written, check_range, key_values, show_progress


def _listed() -> str:
    return "\n".join(
        f"{k.name:<19} {k.duration:g} s from {k.speed:g} m/s, amplitude {k.amplitude:g} ({k.amplitude_text})\n{'':<20}{k.text}"
        for k in maneuvers.MANEUVERS.values()
    )


@click.command(
    cls=Lazy, tables=(("Manoeuvres", _listed), ("Settings of the simulator (--set)", "sim_settings_table"))
)
@click.option("--maneuver", metavar="NAME", required=True, help="What is driven; list below.")
@click.option(
    "--vehicle",
    "vehicle_path",
    metavar="CAR.toml",
    type=FILE,
    help="Vehicle file; default: the built-in car.",
)
@click.option(
    "--out",
    metavar="LOG.csv",
    type=Written(".csv"),
    required=True,
    help="The log, as 'tselab estimate' reads it.",
)
@click.option("--truth", metavar="TRUTH.csv", type=Written(".csv"), help="Also write what really happened.")
@click.option("--with-ref", is_flag=True, help="Put the truth into ref_ columns of the log.")
@click.option("--seed", type=int, help="Seed of the random numbers.")
@click.option("--duration", type=float, help="Length, s.")
@click.option("--sample-time", type=float, help="Time between rows, s.  [default: 0.01]")
@click.option("--speed", type=float, help="Start speed, m/s.")
@click.option("--amplitude", type=float, help="Amplitude; what it means is in the list below.")
@click.option(
    "--road-change",
    metavar="TIME:LEVEL",
    multiple=True,
    help="From TIME on all stiffness times LEVEL; may be repeated.",
)
@click.option("--spread", type=float, help="Sample-to-sample sd of all three stiffnesses, share of the mean.")
@click.option("--noise", type=float, help="Sensor noise, times the sd of the vehicle file.")
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
    """Simulate a manoeuvre: a log for 'tselab estimate', and the truth.

    \b
    tselab simulate --maneuver square-waves --vehicle car.toml --out log.csv --truth truth.csv
    tselab simulate --maneuver double-lane-change --out log.csv --road-change 20:0.6 --with-ref
    tselab simulate --maneuver straight --out log.csv --duration 300 --noise 2 --set true_bias_yaw_rate=0.01

    --road: the bank and grade of a road lie under the car, by the distance that it has
    travelled. The log has the positions of the road there, but the car steers as the
    manoeuvre says, whatever the bends of the road.
    """
    from tse.car.vehicle import make_default_vehicle, read_vehicle
    from tse.estimation.estimate import write_table
    from tse.library.core import STIFFNESS, Config, SimConfig
    from tse.library.files import check_distinct, check_writable
    from tse.roads.road import read_road
    from tse.simulation.simulate import add_references
    from tse.simulation.simulate import simulate as run

    check_distinct({"--out": out, "--truth": truth}, {"--vehicle": vehicle_path, "--road": road_path})
    check_writable(out, truth)
    profile = read_road(road_path) if road_path is not None else None
    vehicle = read_vehicle(vehicle_path) if vehicle_path else make_default_vehicle()
    config, sim_config = Config.exact(vehicle.values), SimConfig()
    settings = key_values(pairs)
    for key, value in settings.items():
        (sim_config if key in sim_config else config).set(key, value, source="option --set")
    for key, value in (("seed", seed), ("noise", noise), *((f"spread_{s}", spread) for s in STIFFNESS)):
        if value is not None:
            sim_config.set(key, value, source=f"option --{key.split('_')[0]}")
    if sample_time is not None:
        config.set("sample_time", sample_time, source="option --sample-time")
    top = sim_config.fields["speed"]
    check_range("speed", speed, top.low, top.high, "m/s")
    check_range("duration", duration, config.sample_time, maneuvers.MAX_DRIVE_SECONDS, "s")
    check_range("amplitude", amplitude, -1000.0, 1000.0, "")
    if maneuver == "constant-radius":
        check_range("amplitude", amplitude, 10.0, 1000.0, "m (radius)")
    elif amplitude is not None:
        check_range("amplitude", abs(amplitude), 0.0, 1.2, "rad")
    plan = maneuvers.build(
        maneuver, config, sample_time=config.sample_time, duration=duration,
        speed=sim_config.speed if speed is None and "speed" in settings else speed,
        amplitude=amplitude, road=_road_changes(road_change), seed=sim_config.seed,
    )  # fmt: skip
    result = run(plan, config, sim_config, vehicle.driven_axle, show_progress(progress), profile)
    write_table(add_references(result) if with_ref else result.log, out)
    if truth is not None:
        write_table(result.truth, truth)
    if as_json:
        from tse.report import results

        results.say_json(
            {"maneuver": maneuver, "vehicle": vehicle.name, "rows": len(plan.time), "seconds": float(plan.time[-1]),
             "seed": sim_config.seed, "filled": vehicle.filled, "notes": vehicle.notes, "written": {"log": out, "truth": truth}}
        )  # fmt: skip
        return
    for line in vehicle.filled:
        click.echo(f"filled in: {line}")
    for line in vehicle.notes:
        click.echo(f"note: {line}", err=True)
    click.echo(
        f"{maneuver}, {vehicle.name}: {len(plan.time)} rows, {plan.time[-1]:g} s, seed {sim_config.seed}"
    )
    click.echo(f"Log written to {out}" + (f", truth to {truth}" if truth else ""))


def _road_changes(pairs: tuple[str, ...]) -> list[tuple[float, float]]:
    from tse.library.core import SIM_INPUT, library

    level = library().field(SIM_INPUT, "road_level")
    changes = []
    for pair in pairs:
        try:
            time, value = (float(x) for x in pair.split(":"))
        except ValueError:
            raise UserError(
                f"option --road-change: {pair!r} is not TIME:LEVEL, for instance 20:0.7"
            ) from None
        if not time >= 0 or not level.low <= value <= level.high:
            raise UserError(
                f"option --road-change: {pair!r}: the time must be >= 0 s, the level {level.low:g} .. {level.high:g}"
            )
        changes.append((time, value))
    return changes
