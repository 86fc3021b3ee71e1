"""The commands `tselab vehicle`, `tselab formula` and `tselab settings`."""

from dataclasses import asdict
from pathlib import Path

import click

from tse.errors import Error
from tselab.options import FILE, JSON, print_json


@click.command()
@click.argument("path", metavar="[CAR.toml]", type=FILE, required=False)
@click.option("--example", is_flag=True, help="Print a commented vehicle file, to edit for your car.")
@click.option(
    "--simulated",
    is_flag=True,
    help="Print the vehicle file of the simulated car, whose parameters have no uncertainty. Use it only "
    "for logs of 'tselab simulate'.",
)
@click.option("--c", "header", metavar="OUT.h", type=FILE, help="Also write the settings as a C header.")
@JSON
def vehicle(path: Path | None, example: bool, simulated: bool, header: Path | None, as_json: bool) -> None:
    """Check a vehicle file, or print an example of one. With --c, also write the settings
    of the checked file as a C header.

    \b
    tselab vehicle --example > car.toml
    tselab vehicle car.toml
    tselab vehicle calibrated.toml --c car.h

    In C, call tse_config_default(&c), then tse_config_car(&c), which car.h defines. The
    settings are then those with which 'tselab estimate' runs at 100 Hz. car.h can be used
    with every number format of the library.
    """
    import tse
    from tse import tables
    from tse.files import check_distinct

    if (path is not None) + example + simulated != 1 or (header is not None and path is None):
        raise Error(
            "give exactly one of: a vehicle file to check, --example, --simulated; --c needs a vehicle file"
        )
    if path is None:
        click.echo(tables.example_vehicle() if example else tables.simulated_vehicle(), nl=False)
        return
    check_distinct({"--c": header}, {"the vehicle file": path})
    car = tse.read_vehicle(path)
    if header is not None:
        tse.write_c_settings(car, header)
    if as_json:
        said = {
            "vehicle": path,
            "name": car.name,
            "values": car.values,
            "filled": car.filled,
            "notes": car.notes,
            "written": header,
        }
        print_json(said)
        return
    known = tables.settings()
    rows = [[k, f"{v:.6g}", known[k].unit, known[k].text] for k, v in car.values.items()]
    click.echo(f"{path}: {car.name}")
    click.echo(tables.text_table(rows, right=(1,)))
    for line in car.filled:
        click.echo(f"filled in: {line}")
    if header is not None:
        click.echo(f"Written to {header}")
    for line in car.notes:
        click.echo(f"note: {line}", err=True)


@click.command()
@click.option("--simulator", is_flag=True, help="List the settings of the simulator instead.")
@JSON
def settings(simulator: bool, as_json: bool) -> None:
    """List all settings with default, range and meaning.

    Give settings in a file FILTER.toml (name = value, at top level or in the table
    [filter]) or with the option --set.
    """
    from tse import tables

    if as_json:
        print_json([asdict(s) for s in tables.settings(simulator=simulator).values()])
        return
    click.echo(tables.sim_settings_table() if simulator else tables.settings_table())


def _format_short(x: float) -> str:
    return f"{x:.0f}" if x == int(x) else f"{x:.9g}"


class FormulaCommand(click.Command):
    """A command whose help lists the signals and functions that a formula can be made of,
    and the places in the model to which it can be added."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        from tse import tables

        kinds = {
            "SIGNAL": "Signals",
            "PLAIN": "Functions, in addition to + - * / and integer powers",
            "MEMORY": "Functions that depend on earlier rows",
        }
        with formatter.section("Places"):
            formatter.write_dl([(p.name, f"{p.unit}: {p.text}") for p in tables.formula_places().values()])
        # operations that a formula writes as operators or digits, not by these names
        hidden = {"add", "sub", "mul", "div", "neg", "one", "two"}
        for kind, title in kinds.items():
            with formatter.section(title):
                ops = [
                    o for o in tables.formula_operations().values() if o.kind == kind and o.name not in hidden
                ]
                formatter.write_dl(
                    [(o.name, f"{o.unit}: {o.text}" if kind == "SIGNAL" else o.text) for o in ops]
                )


@click.command(cls=FormulaCommand)
@click.argument("path", metavar="FORMULA.toml", type=FILE)
@click.option(
    "--c",
    "header",
    metavar="OUT.h",
    type=FILE,
    help="Also write the formula as a C header, for a build with -DTSE_FORMULA=OUT.h.",
)
@JSON
def formula(path: Path, header: Path | None, as_json: bool) -> None:
    """Check a formula: an effect of your own, which 'tselab gap catalogue' does not list.

    The value of a formula is added to a quantity of the model, such as the slip angle of
    the front axle (front_angle) or the yaw moment. This quantity is called the place of
    the formula.

    \b
    tselab formula gap/formula.toml
    tselab formula play.toml --c play.h

    'tselab gap' writes such files. One can also be written by hand:

    \b
    id = "play"
    title = "play in the steering"
    place = "front_angle"
    formula = "play(steer_angle, w) - steer_angle"
    [numbers.w]
    value = 0.003
    unit = "rad"

    Two lines in a vehicle file of the same folder, [formula] and file = "play.toml", add
    the formula to simulator, estimator and 'tselab gap'. Below are all places, signals
    and functions; x, y and z are the first, second and third argument of a function.
    """
    import tse
    from tse import tables
    from tse.files import check_distinct

    check_distinct({"--c": header}, {"the formula": path})
    found = tse.read_formula(path)
    if header is not None:
        tse.write_c_formula(found, header)
    unit = tables.formula_places()[found.place].unit
    if as_json:
        numbers = [{"name": n.name, "value": n.value, "unit": n.unit, "text": n.text} for n in found.numbers]
        print_json(
            {
                "formula": path,
                "title": found.title,
                "place": found.place,
                "unit": unit,
                "gain": found.gain,
                "text": found.text,
                "numbers": numbers,
                "operations": len(found.operations),
                "settings": found.settings(),
                "written": header,
            }
        )
        return
    click.echo(f"{path}: {found.title}\n{found.place} [{unit}] + {found.gain:g} * ({found.text})")
    rows = [[n.name, f"{n.value:.6g}", n.unit, n.text] for n in found.numbers]
    click.echo(tables.text_table(rows, right=(1,)))
    values = ", ".join(f"{k} = {_format_short(v)}" for k, v in found.settings().items() if v)
    click.echo(f"{len(found.operations)} operations; settings: {values}")
    if header is not None:
        click.echo(f"Written to {header}")
