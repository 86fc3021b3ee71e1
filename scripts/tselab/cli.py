"""The command line: options in, modules called, messages out."""

from __future__ import annotations

import contextlib
import os
import sys
import textwrap
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tse.impl import __version__, maneuvers
from tse.impl.errors import UserError
from tse.impl.files import no_room
from tselab.commands.calibrate import calibrate
from tselab.commands.fleet import fleet
from tselab.commands.fmu import fmu
from tselab.commands.gap import gap
from tselab.commands.options import (
    CALIBRATE,
    FILE,
    FORM,
    JSON,
    PROGRESS,
    for_programs,
    key_values,
    reading,
    saying,
    show_progress,
)
from tselab.commands.signals import signals
from tselab.montecarlo import STUDIES

if TYPE_CHECKING:
    from tse.impl.rows import Reading

# Python package -> extra of pyproject.toml that brings it, for those that a part of tselab takes for granted
EXTRAS = {
    "lxml": "fmu",
    "fmpy": "fmu",
    "fmu_manipulation_toolbox": "fmu",
    "lief": "fmu",
    "matplotlib": "figures",
    "distributed": "cluster",
}
MOST_FINDINGS = 12  # stretches of road in the terminal
WRITTEN = {"estimates": "Estimates", "report": "Report", "table": "Table", "learnt": "Learnt state"}
JOBS = click.option(
    "--jobs", type=click.IntRange(1, 256), default=os.cpu_count() or 1, show_default="all cores", help="Processes."
)
FIRST_SEED = click.option(
    "--first-seed", type=click.IntRange(0, 2000000000), default=1, show_default=True, help="Seed of the first run."
)
RESTART = click.option("--restart", is_flag=True, help="Discard the runs that are in DIR.")
CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 110}


class Lazy(click.Command):
    """A command whose help ends in tables of the library."""

    def __init__(self, *args: Any, tables: tuple[tuple[str, str], ...] = (), **kwargs: Any):
        super().__init__(*args, **kwargs)
        self.tables = tables

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        from tse.impl import tables

        super().format_epilog(ctx, formatter)
        for title, name in self.tables:
            formatter.write(f"\n{title}:\n")
            try:
                formatter.write(textwrap.indent(getattr(tables, name)(), "  ") + "\n")
            except UserError as error:
                formatter.write(f"  ({error})\n")


def _version(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
    if not value or ctx.resilient_parsing:
        return
    from tse.impl.core import library

    lib = library()
    click.echo(f"tselab {__version__}\nlibrary tse {lib.version}, {lib.format}, up to {lib.capacity} particles")
    ctx.exit()


def _road_changes(pairs: tuple[str, ...]) -> list[tuple[float, float]]:
    from tse.impl.core import SIM_INPUT, library

    level = library().field(SIM_INPUT, "road_level")
    changes = []
    for pair in pairs:
        try:
            time, value = (float(x) for x in pair.split(":"))
        except ValueError:
            raise UserError(f"option --road-change: {pair!r} is not TIME:LEVEL, for instance 20:0.7") from None
        if not time >= 0 or not level.low <= value <= level.high:
            raise UserError(
                f"option --road-change: {pair!r}: the time must be >= 0 s, the level {level.low:g} .. {level.high:g}"
            )
        changes.append((time, value))
    return changes


def _positive(name: str, value: float | None, low: float, high: float, unit: str) -> None:
    if value is not None and not low <= value <= high:
        raise UserError(f"option --{name}: {value:g} is outside its range {low:g} .. {high:g} {unit}")


@click.group(context_settings=CONTEXT)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_version,
    help="Show versions and exit.",
)
@click.option("--debug", is_flag=True, help="Show the traceback of an internal error.")
def cli(debug: bool) -> None:
    """Tyre stiffness from a car's log.

    \b
    tselab vehicle --example > car.toml          a vehicle file to edit
    tselab estimate log.csv --vehicle car.toml --report report.html
    tselab signals drive.mf4 --write signals.toml      a log with names of its own
    tselab simulate --maneuver square-waves --vehicle car.toml --out log.csv
    tselab demo --out demo                       all of it, without a log of your own

    'tselab COMMAND --help' explains each command, its columns and units.
    """


@cli.command(
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
    type=FILE,
    help="Estimates, .csv or .parquet; default: the log's name with .est.csv, in the current directory.",
)
@click.option("--report", metavar="REPORT.html", type=FILE, help="Also write a report with interactive plots.")
@click.option("--load-learnt", metavar="FILE", type=FILE, help="Start from what an earlier drive taught.")
@click.option("--age", metavar="DAYS", type=float, help="How long ago that was; default: the age of the file.")
@click.option("--save-learnt", metavar="FILE", type=FILE, help="Write what this drive teaches; may be the same file.")
@click.option(
    "--average", metavar="SECONDS", type=float, help="Average the log over blocks of so long first, at most 0.1 s."
)
@CALIBRATE
@reading
@for_programs
@click.option("--seed", type=int, help="Seed of the random numbers; --form paper or robust.")
@click.option("--particles", type=int, help="Particles in use; --form paper or robust.")
@click.option("--forgetting", type=float, help="Forgetting factor per sample; --form paper or robust.")
@FORM
@click.option("--set", "pairs", metavar="KEY=VALUE", multiple=True, help="Any other setting; may be repeated.")
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
    form: str,
    pairs: tuple[str, ...],
    progress: bool | None,
    reading: Reading,
    as_json: bool,
    table: Path | None,
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
    (signals of the message that say so), hold (sent only when it changes), unsure (what was guessed: every run says so, and
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

    Each stiffness is given with its 95 % interval at the end of each stretch of road between changes, valid or not, and smoothed
    over the stretch: what came after counts, too. It says whether to act on it. With them grip and the largest sideslip angle.

    Exit code: 0 usable: every stiffness is valid; 3 usable in part; 4 nothing usable: the estimates are written, and no stiffness
    is valid; 2 bad input; 130 Ctrl-C. --json says what was found as JSON on standard output, in place of words; --table writes it
    as a row per stretch of road and stiffness.
    """
    from tse.impl import regimes, results
    from tse.impl.calibrate.own import STOPPED
    from tse.impl.estimate import read_learnt, write_learnt
    from tse.impl.files import check_distinct, check_writable
    from tse.impl.fleet import single
    from tse.impl.fleet.single import Calibrate, prepare
    from tse.impl.results import run_facts

    out = out or Path(log_path.stem + ".est.csv")
    inputs = {"the log": log_path, "--vehicle": vehicle_path, "--config": config_path, "--signals": reading.signals}
    check_distinct({"--out": out, "--report": report, "--save-learnt": save_learnt, "--table": table}, inputs)
    # a file that is loaded may be replaced by what is learnt now, and by nothing else
    check_distinct({"--out": out, "--report": report, "--table": table}, {"--load-learnt": load_learnt})
    results.check_table(table)
    for path in (out, report, save_learnt, table):
        if path is not None:
            check_writable(path)
    if age is not None and load_learnt is None:
        raise UserError("option --age: is that of the file of --load-learnt, which is not given")
    _positive("age", age, 0.0, 40000.0, "days")
    learnt = read_learnt(load_learnt, age) if load_learnt else None
    with saying(progress) as say:
        itself = Calibrate(say, goes_on=True) if calibrate and load_learnt is None and save_learnt is None else None
        prepared = prepare(
            log_path, vehicle_path, config_path, average, options, form, key_values(pairs), reading, itself
        )
    vehicle, log, config, warnings = prepared.vehicle, prepared.log, prepared.config, prepared.warnings
    ran = single.run(prepared, out, report, learnt, show_progress(progress))
    est, notes, changes, found = ran.estimate, ran.notes, ran.changes, ran.findings
    if save_learnt is not None:
        if est.learnt is not None and not warnings:
            write_learnt(save_learnt, est.learnt)
        elif warnings:
            notes.append(f"the channels contradict each other, so nothing was learnt: {save_learnt} is not written")
        else:
            notes.append(f"no row was used, so nothing was learnt: {save_learnt} is not written")
    odd = [*warnings, *log.warnings]
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
    else:
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
        for what, path in written.items():
            if path is not None:
                click.echo(f"{WRITTEN[what]} written to {path}")
    if prepared.own is not None and prepared.own.found.get("why") == STOPPED:
        click.echo(f"tselab: the calibration was stopped by Ctrl-C; {out} is that of an ordinary car", err=True)
        sys.exit(130)
    if est.interrupted:
        click.echo(
            f"tselab: stopped by Ctrl-C after {len(est)} of {len(log)} rows; {out} holds the rows done",
            err=True,
        )
        sys.exit(130)
    return results.exit_code(found)


MANEUVERS = "\n".join(
    f"  {k.name:<19} {k.duration:g} s from {k.speed:g} m/s, amplitude {k.amplitude:g} ({k.amplitude_text})\n{'':<22}{k.text}"
    for k in maneuvers.KINDS.values()
)


class SimulateCommand(Lazy):
    """Lists the manoeuvres too."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        formatter.write(f"\nManoeuvres:\n{MANEUVERS}\n")
        super().format_epilog(ctx, formatter)


@cli.command(
    cls=SimulateCommand,
    short_help="Simulate a manoeuvre: log and truth.",
    tables=(("Settings of the simulator (--set)", "sim_settings_table"),),
)
@click.option("--maneuver", metavar="NAME", required=True, help="What is driven; list below.")
@click.option(
    "--vehicle",
    "vehicle_path",
    metavar="CAR.toml",
    type=FILE,
    help="Vehicle file; default: the built-in car.",
)
@click.option("--out", metavar="LOG.csv", type=FILE, required=True, help="The log, as 'tselab estimate' reads it.")
@click.option("--truth", metavar="TRUTH.csv", type=FILE, help="Also write what really happened.")
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
    progress: bool | None,
    as_json: bool,
) -> None:
    """Simulate a manoeuvre: a log for 'tselab estimate', and the truth.

    \b
    tselab simulate --maneuver square-waves --vehicle car.toml --out log.csv --truth truth.csv
    tselab simulate --maneuver double-lane-change --out log.csv --road-change 20:0.6 --with-ref
    tselab simulate --maneuver straight --out log.csv --duration 300 --noise 2 --set true_bias_yaw_rate=0.01
    """
    from tse.impl.core import STIFFNESS, Config, SimConfig
    from tse.impl.estimate import write_table
    from tse.impl.files import check_distinct, check_writable
    from tse.impl.simulate import simulate as run
    from tse.impl.simulate import with_references
    from tse.impl.vehicle import default_vehicle, read_vehicle

    check_distinct({"--out": out, "--truth": truth}, {"--vehicle": vehicle_path})
    for path in (out, truth):
        if path is not None:
            check_writable(path)
    vehicle = read_vehicle(vehicle_path) if vehicle_path else default_vehicle()
    config, sim_config = Config(vehicle.values), SimConfig()
    for key, value in key_values(pairs).items():
        (sim_config if key in sim_config else config).set(key, value, source="option --set")
    for key, value in (("seed", seed), ("noise", noise), *((f"spread_{s}", spread) for s in STIFFNESS)):
        if value is not None:
            sim_config.set(key, value, source=f"option --{key.split('_')[0]}")
    if sample_time is not None:
        config.set("sample_time", sample_time, source="option --sample-time")
    top = sim_config.fields["speed"]
    _positive("speed", speed, top.low, top.high, "m/s")
    _positive("duration", duration, config.sample_time, 36000.0, "s")
    _positive("amplitude", amplitude, -1000.0, 1000.0, "")
    if maneuver == "constant-radius":
        _positive("amplitude", amplitude, 10.0, 1000.0, "m (radius)")
    elif amplitude is not None:
        _positive("amplitude", abs(amplitude), 0.0, 1.2, "rad")
    plan = maneuvers.build(
        maneuver, config, sample_time=config.sample_time, duration=duration,
        speed=sim_config.speed if speed is None and any(p.startswith("speed=") for p in pairs) else speed,
        amplitude=amplitude, road=_road_changes(road_change), seed=sim_config.seed,
    )  # fmt: skip
    result = run(plan, config, sim_config, vehicle.driven_axle, show_progress(progress))
    write_table(with_references(result) if with_ref else result.log, out)
    if truth is not None:
        write_table(result.truth, truth)
    if as_json:
        from tse.impl import results

        results.say_json(
            {"maneuver": maneuver, "vehicle": vehicle.name, "rows": len(plan.time), "seconds": float(plan.time[-1]),
             "seed": sim_config.seed, "filled": vehicle.filled, "notes": vehicle.notes, "written": {"log": out, "truth": truth}}
        )  # fmt: skip
        return
    for line in vehicle.filled:
        click.echo(f"filled in: {line}")
    for line in vehicle.notes:
        click.echo(f"note: {line}", err=True)
    click.echo(f"{maneuver}, {vehicle.name}: {len(plan.time)} rows, {plan.time[-1]:g} s, seed {sim_config.seed}")
    click.echo(f"Log written to {out}" + (f", truth to {truth}" if truth else ""))


def _short(x: float) -> str:
    return f"{x:.0f}" if x == int(x) else f"{x:.9g}"


class FormulaCommand(click.Command):
    """Lists what a formula is made of."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        from tse.impl.core import library

        kinds = {
            "SIGNAL": "Signals",
            "PLAIN": "Functions, beside + - * / and whole powers",
            "MEMORY": "Functions that remember",
        }
        with formatter.section("Places"):
            formatter.write_dl([(p.name, f"{p.unit}: {p.text}") for p in library().formula_places.values()])
        hidden = {"add", "sub", "mul", "div", "neg", "one", "two"}  # written as operators and digits
        for kind, title in kinds.items():
            with formatter.section(title):
                ops = [o for o in library().formula_ops.values() if o.kind == kind and o.name not in hidden]
                formatter.write_dl([(o.name, f"{o.unit}: {o.text}" if kind == "SIGNAL" else o.text) for o in ops])


@cli.command(cls=FormulaCommand)
@click.argument("path", metavar="FORMULA.toml", type=FILE)
@click.option(
    "--c", "header", metavar="OUT.h", type=FILE, help="Also write it as C, for a build with -DTSE_FORMULA=OUT.h."
)
@JSON
def formula(path: Path, header: Path | None, as_json: bool) -> None:
    """Check a formula of the user, an effect that no catalogue has; also as C.

    \b
    tselab formula gap/formula.toml
    tselab formula play.toml --c play.h

    'tselab gap' writes such files; by hand:

    \b
    id = "play"
    title = "play in the steering"
    place = "front_angle"
    formula = "play(steer_angle, w) - steer_angle"
    [numbers.w]
    value = 0.003
    unit = "rad"

    A vehicle file beside it runs it everywhere with
    [formula] file = "play.toml". Places, signals and functions are listed below; x, y, z are what stands in the brackets.
    """
    from tse.impl.core import library
    from tse.impl.files import atomic
    from tse.impl.formula import c_header, read_formula
    from tse.impl.tables import text_table

    found = read_formula(path)
    place = library().formula_places[found.place]
    if as_json:
        from tse.impl import results

        if header is not None:
            with atomic(header) as file:
                file.write(c_header(found))
        numbers = [{"name": n.name, "value": n.value, "unit": n.unit, "text": n.text} for n in found.numbers]
        results.say_json(
            {"formula": path, "title": found.title, "place": found.place, "unit": place.unit, "gain": found.gain,
             "text": found.text,
             "numbers": numbers, "operations": len(found.operations), "settings": found.settings(), "written": header}
        )  # fmt: skip
        return
    click.echo(f"{path}: {found.title}\n{found.place} [{place.unit}] + {found.gain:g} * ({found.text})")
    click.echo(text_table([[n.name, f"{n.value:.6g}", n.unit, n.text] for n in found.numbers], right=(1,)))
    count = len(found.operations)
    click.echo(
        f"{count} operations; settings: {', '.join(f'{k} = {_short(v)}' for k, v in found.settings().items() if v)}"
    )
    if header is not None:
        with atomic(header) as file:
            file.write(c_header(found))
        click.echo(f"Written to {header}")


@cli.command()
@click.argument("path", metavar="[CAR.toml]", type=FILE, required=False)
@click.option("--example", is_flag=True, help="Print a commented vehicle file, to edit for your car.")
@click.option("--simulated", is_flag=True, help="Print the car of 'tselab simulate', known exactly: for its logs only.")
@JSON
def vehicle(path: Path | None, example: bool, simulated: bool, as_json: bool) -> None:
    """Check a vehicle file, or print one.

    \b
    tselab vehicle --example > car.toml
    tselab vehicle car.toml
    """
    from tse.impl.tables import example_vehicle, simulated_vehicle, text_table

    if (path is not None) + example + simulated != 1:
        raise UserError("give a vehicle file to check, or --example, or --simulated")
    if path is None:
        click.echo(example_vehicle() if example else simulated_vehicle(), nl=False)
        return
    from tse.impl.core import Config
    from tse.impl.vehicle import read_vehicle

    car = read_vehicle(path)
    fields = Config().fields
    if as_json:
        from tse.impl import results

        said = {"vehicle": path, "name": car.name, "values": car.values, "filled": car.filled, "notes": car.notes}
        results.say_json(said)
        return
    click.echo(f"{path}: {car.name}")
    click.echo(text_table([[k, f"{v:.6g}", fields[k].unit, fields[k].text] for k, v in car.values.items()], right=(1,)))
    for line in car.filled:
        click.echo(f"filled in: {line}")
    for line in car.notes:
        click.echo(f"note: {line}", err=True)


@cli.command(short_help="List all settings.")
@click.option("--simulator", is_flag=True, help="The simulator's settings instead.")
@JSON
def settings(simulator: bool, as_json: bool) -> None:
    """List all settings with default, range and meaning.

    Settings go into a FILTER.toml (name = value, flat or under [filter]) or behind --set.
    """
    from tse.impl.core import CONFIG, SIM_CONFIG, library
    from tse.impl.tables import settings_table, sim_settings_table

    if as_json:
        from tse.impl import results

        rows = library().fields(SIM_CONFIG if simulator else CONFIG)
        results.say_json(
            [
                {"name": f.name, "default": f.default, "low": f.low, "high": f.high, "unit": f.unit, "text": f.text}
                for f in rows
            ]
        )
        return
    click.echo(sim_settings_table() if simulator else settings_table())


@cli.command()
@click.option(
    "--out",
    metavar="DIR",
    type=FILE,
    default=Path("demo"),
    show_default=True,
    help="Directory; made if needed.",
)
@click.option("--seed", type=int, default=1, show_default=True, help="Seed of the random numbers.")
@PROGRESS
def demo(out: Path, seed: int, progress: bool | None) -> None:
    """Simulate double lane changes with a road change, estimate, compare; do it again from an MF4 of other names, units, rates
    and latencies; then find a hidden effect.

    Writes vehicle.toml, filter.toml, log.csv, truth.csv, est.csv, report.html and, with matplotlib, demo.png; in
    the folder logger the same drive as an MF4, where the library for it is, and the proposed signals.toml; and in the folder gap
    the logs of a car with a hidden effect, and all that 'tselab gap' makes of them.
    """
    from tse.impl.tables import simulated_vehicle
    from tselab.demo import gap_summary, logger_summary, run_demo, run_gap, run_logger, summary

    if out.exists() and not out.is_dir():
        raise UserError(f"{out}: is a file, a directory is needed")
    made = run_demo(out, seed, show_progress(progress))
    click.echo(summary(made, out))
    try:
        logged = run_logger(out / "logger", made.log, simulated_vehicle(), made.est.table)
        click.echo("\n" + logger_summary(logged, out / "logger"))
    except UserError as error:
        click.echo(f"\nleft out: {error}")
    say = (lambda text: click.echo(f"gap: {text}", err=True)) if show_progress(progress) else (lambda _: None)
    click.echo("\n" + gap_summary(run_gap(out / "gap", seed, say, os.cpu_count() or 1), out / "gap"))


@cli.command(short_help="Errors against the truth in the paper's set-up.")
@click.option("--runs", type=click.IntRange(1, 100000), default=24, show_default=True, help="Runs, one seed each.")
@JOBS
@click.option("--particles", type=int, help="Particles in use.")
@click.option("--forgetting", type=float, help="Forgetting factor per sample.")
@FORM
@FIRST_SEED
@click.option(
    "--set",
    "pairs",
    metavar="KEY=VALUE",
    multiple=True,
    help="Any setting of filter or simulator; may be repeated.",
)
@click.option("--out", metavar="DIR", type=FILE, help="Also write accuracy.md and accuracy.csv (one row per run).")
@PROGRESS
@JSON
def accuracy(
    runs: int,
    jobs: int,
    particles: int | None,
    forgetting: float | None,
    form: str,
    first_seed: int,
    pairs: tuple[str, ...],
    out: Path | None,
    progress: bool | None,
    as_json: bool,
) -> None:
    """Accuracy against the truth in the paper's set-up (Sec. IV-A).

    \b
    tselab accuracy --runs 24 --jobs 2
    tselab accuracy --particles 500 --forgetting 0.99 --out results

    Square waves in steering and torque, stiffness redrawn every sample with 5 % sd, start at 70 %, 40 s; errors over
    20 .. 40 s. Diverged: any stiffness off by more than 20 % for longer than 2 s after 10 s.
    """
    from tse.impl.core import Config, SimConfig
    from tse.impl.estimate import write_table
    from tse.impl.files import atomic
    from tselab.montecarlo.accuracy import accuracy as run
    from tselab.montecarlo.accuracy import markdown

    settings: dict[str, float] = dict(Config.form(form))
    sim_settings: dict[str, float] = {}
    sim_config, config = SimConfig(), Config()
    for key, value in key_values(pairs).items():
        group, checked = (sim_settings, sim_config) if key in sim_config and key != "seed" else (settings, config)
        checked.set(key, value, source="option --set")
        group[key] = value
    for key, value in (("particles", particles), ("forgetting", forgetting)):
        if value is not None:
            config.set(key, value, source=f"option --{key}")
            settings[key] = value
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
    study = run(runs, jobs, settings, sim_settings, first_seed, show_progress(progress))
    text = markdown(study)
    if as_json:
        from tse.impl import results

        results.say_json({"runs": study.runs.to_dict("records"), "text": text})
    else:
        click.echo(text)
    if out is not None:
        with atomic(out / "accuracy.md") as file:
            file.write(text + "\n")
        write_table(study.runs, out / "accuracy.csv")


class StudyCommand(click.Command):
    """Lists the studies too."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        lines = [f"  {name:<11} {runs:>3} runs  {title}" for name, (runs, title) in STUDIES.items()]
        formatter.write("\nStudies, with their usual number of runs of each case:\n" + "\n".join(lines) + "\n")


@cli.command(cls=StudyCommand, short_help="Monte-Carlo studies: accuracy, bounds, peers, stress.")
@click.option("--study", "name", metavar="NAME", required=True, help="Which; list below.")
@click.option(
    "--runs", type=click.IntRange(1, 1000000), help="Runs of each case, one seed each; default: as the study."
)
@JOBS
@click.option("--scheduler", metavar="ADDRESS", help="Run on a Dask cluster instead, for instance tcp://host:8786.")
@click.option("--out", metavar="DIR", type=FILE, help="Directory; made if needed.  [default: montecarlo-NAME]")
@click.option("--cases", metavar="A,B", help="Only these cases of the study.")
@FIRST_SEED
@FORM
@click.option(
    "--set",
    "pairs",
    metavar="KEY=VALUE",
    multiple=True,
    help="Any setting of filter or simulator; may be repeated. What a case is about wins.",
)
@RESTART
@PROGRESS
@JSON
def montecarlo(
    name: str,
    runs: int | None,
    jobs: int,
    scheduler: str | None,
    out: Path | None,
    cases: str | None,
    first_seed: int,
    form: str,
    pairs: tuple[str, ...],
    restart: bool,
    progress: bool | None,
    as_json: bool,
) -> None:
    """Monte-Carlo studies against the simulator's truth.

    \b
    tselab montecarlo --study stress --runs 200 --jobs 2
    tselab montecarlo --study peers --runs 20 --cases nominal,noise-3x --out peers
    tselab montecarlo --study stress+ekf --runs 200
    tselab montecarlo --study stress --scheduler tcp://host:8786

    Every finished run is kept in DIR/runs.jsonl: the same command goes on after Ctrl-C, more --runs and --cases are added to
    what is there; runs of other settings or of another library are not taken.

    NAME+ekf runs another estimator beside the study's, on the same data; so does a function of yours, NAME+module.function, which
    takes the log and the settings and returns columns cx_front, cx_front_sd ... (scripts/examples/own_filter.py).

    Writes NAME.csv, NAME.md, runs.csv and, with matplotlib, NAME.png.
    """
    from tse.impl.core import Config, SimConfig

    settings: dict[str, float] = {}
    sim_settings: dict[str, float] = {}
    sim_config, config = SimConfig(), Config()
    for key, value in key_values(pairs).items():
        if key == "seed":
            raise UserError("option --set: the seeds are set by --first-seed and --runs")
        group, checked = (sim_settings, sim_config) if key in sim_config else (settings, config)
        checked.set(key, value, source="option --set")
        group[key] = value
    wanted = tuple(c.strip() for c in cases.split(",")) if cases is not None else ()
    plan = {"form": form, "settings": settings, "sim_settings": sim_settings, "cases": wanted}
    _study(name, runs, first_seed, out or Path(f"montecarlo-{name}"), plan, jobs, scheduler, restart, progress, as_json)


def _study(
    name: str, runs: int | None, first_seed: int, out: Path, plan: dict[str, Any], jobs: int, scheduler: str | None,
    restart: bool, progress: bool | None, as_json: bool,
) -> None:  # fmt: skip
    """Run a study, write its files and say what it found."""
    from tselab.montecarlo import studies
    from tselab.montecarlo.engine import Interrupted, Plan
    from tselab.montecarlo.engine import run as run_all
    from tselab.montecarlo.pictures import write

    study = studies.study(name, plan.get("cases", ()))
    todo = Plan(study, runs or study.runs, first_seed, **plan)
    try:
        rows = run_all(todo, out, jobs, scheduler, restart, show_progress(progress))
    except Interrupted as stopped:
        click.echo(f"tselab: {stopped}", err=True)
        sys.exit(130)
    text, files = write(todo, rows, out)
    if as_json:
        from tse.impl import results

        results.say_json({"study": name, "text": text, "written": files})
        return
    click.echo(text)
    click.echo(f"Written to {out}: {', '.join(f.name for f in files)}")


@cli.command(short_help="The paper's figures: as printed, robust, default.")
@click.option("--runs", type=click.IntRange(1, 1000000), help="Runs of each case, one seed each.  [default: 200]")
@JOBS
@click.option("--out", metavar="DIR", type=FILE, default=Path("paper"), show_default=True, help="Made if needed.")
@FIRST_SEED
@RESTART
@PROGRESS
@JSON
def paper(
    runs: int | None, jobs: int, out: Path, first_seed: int, restart: bool, progress: bool | None, as_json: bool
) -> None:
    """Draw the paper's Fig. 1 .. 4 with three filters side by side, and tabulate its numbers beside ours.

    \b
    tselab paper
    tselab paper --runs 40 --jobs 2 --out paper

    The filters: the paper's as printed, the same with settings that keep it from diverging, and the default. Every finished run is
    kept in DIR/runs.jsonl: the same command goes on after Ctrl-C. Writes paper.csv, paper.md, runs.csv and, with matplotlib,
    paper.png.
    """
    _study("paper", runs, first_seed, out, {}, jobs, None, restart, progress, as_json)


cli.add_command(fmu)
cli.add_command(gap)
cli.add_command(calibrate)
cli.add_command(signals)
cli.add_command(fleet)


def _give_up_stdout() -> None:
    """What is left for a terminal that takes no more goes nowhere: else Python complains of it at its end."""
    with contextlib.suppress(OSError, ValueError):  # in place of a terminal there may be no file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main() -> None:
    """Run; turn every failure into a short message and an exit code: 2 the user's, 1 ours, 130 Ctrl-C."""
    debug = "--debug" in sys.argv[1:]
    sys.argv = [a for i, a in enumerate(sys.argv) if i == 0 or a != "--debug"]
    try:
        code = cli.main(standalone_mode=False)
        sys.stdout.flush()
        sys.exit(code if isinstance(code, int) else 0)
    except click.ClickException as error:
        error.show()
        sys.exit(2)
    except UserError as error:
        click.echo(f"tselab: error: {error}", err=True)
        sys.exit(2)
    except (KeyboardInterrupt, click.Abort):
        click.echo("tselab: stopped by Ctrl-C", err=True)
        sys.exit(130)
    except BrokenPipeError:
        _give_up_stdout()
        sys.exit(141)
    except MemoryError:
        click.echo("tselab: error: there is not enough memory for this; a log that is too long can be cut, or run on a larger "
                   "machine (tselab signals --help says which formats are read in pieces)", err=True)  # fmt: skip
        sys.exit(2)
    except Exception as error:
        if isinstance(error, ImportError) and (extra := EXTRAS.get((error.name or "").partition(".")[0])):
            package = (error.name or "").partition(".")[0]
            click.echo(
                f"tselab: error: the Python package {package} is needed and is not installed: pip install 'tse[{extra}]'",
                err=True,
            )
            sys.exit(2)
        if reason := no_room(error):  # files.atomic says it of results: this is the terminal, or a temporary file
            _give_up_stdout()
            where = getattr(error, "filename", None) or "the output"
            click.echo(f"tselab: error: {where}: cannot be written: {reason}", err=True)
            sys.exit(2)
        if debug:
            traceback.print_exc()
        else:
            click.echo(
                f"tselab: internal error: {type(error).__name__}: {error}\n"
                "This is a fault of tselab, not of your files. Please report it with the output of the same command with --debug.",
                err=True,
            )
        sys.exit(1)
