"""`tselab vehicle`, `formula`, `settings`: the files and settings of a run."""

from pathlib import Path

import click

from tse.library.errors import UserError
from tselab.options import FILE, JSON


@click.command()
@click.argument("path", metavar="[CAR.toml]", type=FILE, required=False)
@click.option("--example", is_flag=True, help="Print a commented vehicle file, to edit for your car.")
@click.option(
    "--simulated", is_flag=True, help="Print the car of 'tselab simulate', known exactly: for its logs only."
)
@click.option("--c", "header", metavar="OUT.h", type=FILE, help="Also write the car's settings as C.")
@JSON
def vehicle(path: Path | None, example: bool, simulated: bool, header: Path | None, as_json: bool) -> None:
    """Check a vehicle file, or print one; also as C.

    \b
    tselab vehicle --example > car.toml
    tselab vehicle car.toml
    tselab vehicle calibrated.toml --c car.h

    In C, in any number format, tse_config_default(&c) and tse_config_car(&c) of car.h give the settings with which
    'tselab estimate' runs at 100 Hz.
    """
    from tse.report.tables import example_vehicle, simulated_vehicle, text_table

    if (path is not None) + example + simulated != 1 or (header is not None and path is None):
        raise UserError(
            "give a vehicle file to check, or --example, or --simulated; --c is for a vehicle file"
        )
    if path is None:
        click.echo(example_vehicle() if example else simulated_vehicle(), nl=False)
        return
    from tse.car.config import c_settings
    from tse.car.vehicle import read_vehicle
    from tse.library.core import Config
    from tse.library.files import check_distinct, write_atomically

    check_distinct({"--c": header}, {"the vehicle file": path})
    car = read_vehicle(path)
    fields = Config().fields
    if header is not None:
        with write_atomically(header) as file:
            file.write(c_settings(car))
    if as_json:
        from tse.report import results

        said = {
            "vehicle": path,
            "name": car.name,
            "values": car.values,
            "filled": car.filled,
            "notes": car.notes,
            "written": header,
        }
        results.say_json(said)
        return
    click.echo(f"{path}: {car.name}")
    click.echo(
        text_table(
            [[k, f"{v:.6g}", fields[k].unit, fields[k].text] for k, v in car.values.items()], right=(1,)
        )
    )
    for line in car.filled:
        click.echo(f"filled in: {line}")
    if header is not None:
        click.echo(f"Written to {header}")
    for line in car.notes:
        click.echo(f"note: {line}", err=True)


@click.command()
@click.option("--simulator", is_flag=True, help="The simulator's settings instead.")
@JSON
def settings(simulator: bool, as_json: bool) -> None:
    """List all settings with default, range and meaning.

    Settings go into a FILTER.toml (name = value, flat or under [filter]) or behind --set.
    """
    from tse.library.core import CONFIG, SIM_CONFIG, library
    from tse.report.tables import settings_table, sim_settings_table

    if as_json:
        from tse.report import results

        rows = library().fields(SIM_CONFIG if simulator else CONFIG)
        results.say_json(
            [
                {
                    "name": f.name,
                    "default": f.default,
                    "low": f.low,
                    "high": f.high,
                    "unit": f.unit,
                    "text": f.text,
                }
                for f in rows
            ]
        )
        return
    click.echo(sim_settings_table() if simulator else settings_table())


def _short(x: float) -> str:
    return f"{x:.0f}" if x == int(x) else f"{x:.9g}"


class FormulaCommand(click.Command):
    """Lists what a formula is made of."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        from tse.library.core import library

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
    help="Also write it as C, for a build with -DTSE_FORMULA=OUT.h.",
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
    from tse.car.formula import format_c_header, read_formula
    from tse.library.core import library
    from tse.library.files import check_distinct, write_atomically
    from tse.report.tables import text_table

    check_distinct({"--c": header}, {"the formula": path})
    found = read_formula(path)
    if header is not None:
        with write_atomically(header) as file:
            file.write(format_c_header(found))
    place = library().formula_places[found.place]
    if as_json:
        from tse.report import results

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
        click.echo(f"Written to {header}")
