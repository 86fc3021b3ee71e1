"""Pages and tables that are made from the tables of the library, which are those of src/tables."""

import math
import re
import warnings
from collections.abc import Iterable, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

import tables as sources
from tse.library.core import (
    CONFIG,
    INPUT,
    OUTPUT,
    REASON,
    SIM_CONFIG,
    SIM_INPUT,
    SIM_OUTPUT,
    STATUS,
    Config,
    Field,
    library,
)
from tse.library.files import read_toml
from tse.report import tables as texts

ROOT = Path(__file__).resolve().parents[2]
TSE = ROOT / "include" / "tse"
TABLES = ROOT / "src" / "tables"
C_TYPES = {"s": "tse_setting", "r": "tse_real", "i": "int32_t", "u": "uint32_t"}
GROUPS = {  # tables of the settings, in the order of tse_config, and what a reader calls them
    "vehicle": "Vehicle",
    "uncertainty": "How uncertain the parameters of the car are",
    "sensors": "Sensors",
    "latency": "Latencies",
    "velocity": "Measured velocity",
    "pedals": "Brake switch and wheel torques",
    "road": "Known road",
    "filter": "Filter",
    "formula": "A formula of the user",
    "effects": "Effects",
}
HOOKS = {  # of src/tables/effects.toml
    "CONSTANT": "the settings, once",
    "INPUT": "the steering angle of a row",
    "SLIP": "slip and slip angle of an axle",
    "LAG": "between slip and force: a state",
    "STIFFNESS": "the stiffness of an axle",
    "GRIP": "where the force of an axle ends",
    "BODY": "forces and yaw moment besides the tyres', gravity",
    "SENSOR": "what accelerometers and gyro read",
}


def cell(text: object) -> str:
    """Text that may stand in a table of Markdown."""
    return (
        str(text)
        .replace("|", "\\|")
        .replace("\n", " ")
        .replace("<", "&lt;")
        .replace("*", "\\*")
        .replace("_", "\\_")
    )


def code(text: object) -> str:
    return f"`{text}`"


def table(head: Sequence[str], rows: Iterable[Sequence[str]], right: tuple[int, ...] = ()) -> str:
    """A table of Markdown; cells are escaped already. `right`: columns that are aligned so."""
    lines = [
        "| " + " | ".join(head) + " |",
        "|" + "|".join("---:" if i in right else "---" for i in range(len(head))) + "|",
    ]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def number(x: float) -> str:
    return "-" if math.isnan(x) else f"{x:.10g}"


def _range(f: Field) -> str:
    return f"{f.low:g} .. {f.high:g}" if f.has_range else "any"


def group_of(setting: str) -> str:
    """Return the table of src/tables that has a setting."""
    return library().settings[setting].table


def settings(fields: Iterable[Field]) -> str:
    rows = [
        [
            f'<span id="{f.name}"></span>{code(f.name)}',
            code(C_TYPES[f.kind]),
            number(f.default),
            _range(f),
            cell(f.unit if not f.is_integer else "integer"),
            library().settings[f.name].filter,
            cell(f.text),
        ]
        for f in fields
    ]
    return table(["member", "type", "default", "range", "unit", "filter", "meaning"], rows, right=(2,))


def config_page() -> str:
    """Every member of tse_config."""
    fields, text = library().fields(CONFIG), []
    for name, title in GROUPS.items():
        own = [f for f in fields if group_of(f.name) == name]
        text.append(
            f"## {title}\n\n`src/tables/{sources.file_of(name)}.toml`, {len(own)} settings.\n\n{settings(own)}"
        )
    return (
        f"# tse_config: settings\n\n`tse_config` has {len(fields)} members, in SI units; `tse_config_default()` fills in the "
        "defaults, `tse_prepare()` refuses what is outside its range and names it. The same names are keys of a vehicle file "
        "(`[uncertainty]`, `[sensors]`, `[latency]`, `[effects.<id>]` in their tables), of `--set` and of "
        "`tse.Filter(settings=...)`, and parameters of the FMUs.\n\n"
        "The defaults are an ordinary car that nobody has calibrated. Where a default lies below its range it is 0: not set. "
        "`filter`: the filters whose estimate a setting moves, `default`, `paper` or both; none: simulator and replay alone. "
        "These have other values in `tse_config_exact()`, a car that is known exactly:\n\n"
        + uncalibrated()
        + "\n"
        + "\n".join(text)
    )


def uncalibrated() -> str:
    rows = read_toml(TABLES / "uncalibrated.toml")["setting"].items()
    exact = Config.exact()
    return table(
        ["setting", "default", "exact", "why"],
        [[code(n), f"{r['value']:g}", f"{getattr(exact, n):.9g}", cell(r["why"])] for n, r in rows],
        right=(1, 2),
    )


def input_fields() -> str:
    rows = []
    channels = read_toml(TABLES / "input.toml")["channel"]
    policies = {
        c["name"]: {"drives": "refused", "measured": "counts as missing"}[c["kind"]] for c in channels
    }
    optional = [f.name for f in library().optional]
    for f in library().fields(INPUT):
        policy = policies.get(f.name, "refused" if f.name == "dt" else "-")
        unit, allowed, text = f.unit, _range(f), f.text
        if f.name == "dt":
            unit, allowed = "s", "above 0 .. 3600"
            text = (
                "time since the previous row; ignored after tse_reset() up to the first row with all inputs"
            )
        for name, those, what in (
            ("missing", library().channels, "channels that are missing, besides those that are NaN"),
            ("given", library().optional, "what is measured of those below; 0: none is read"),
        ):
            if f.name == name:
                unit, allowed = "bits", "any"
                text = f"{what}: " + ", ".join(f"{1 << i} {c.name}" for i, c in enumerate(those))
        if f.name in optional:
            policy = "not there"
        rows.append([code(f.name), code(C_TYPES[f.kind]), allowed, cell(unit), policy, cell(text)])
    return table(["member", "type", "range", "unit", "outside it", "meaning"], rows)


def output_members() -> dict[str, str]:
    """Return the member of tse_output of each output."""
    return {
        name: row.get("member", name) for name, row in read_toml(TABLES / "output.toml")["column"].items()
    }


def output_fields() -> str:
    members = output_members()
    rows = []
    for f in library().fields(OUTPUT):
        unit = f.unit if not f.is_integer else "integer"
        rows.append([code(members[f.name]), code(f.name), code(C_TYPES[f.kind]), cell(unit), cell(f.text)])
    return table(["member of tse_output", "column, FMU output", "type", "unit", "meaning"], rows)


def _codes(which: int) -> str:
    rows = [[str(c), code(f.name), cell(f.text)] for c, f in sorted(library().codes(which).items())]
    return table(["code", "name", "meaning"], rows, right=(0,))


def status_codes() -> str:
    return _codes(STATUS)


def reason_codes() -> str:
    return _codes(REASON)


def regimes() -> str:
    return table(
        ["output", "in C", "meaning"],
        [
            [code(f"p_{i.lower()}"), code(f"y.regime[TSE_REGIME_{i}]"), cell(t)]
            for i, t in read_toml(TABLES / "output.toml")["regime"].items()
        ],
    )


def simulator() -> str:
    text = []
    for title, which in (
        ("tse_sim_config: settings", SIM_CONFIG),
        ("tse_sim_input: a row of the driver", SIM_INPUT),
        ("tse_sim_output", SIM_OUTPUT),
    ):
        rows = [
            [
                code(f.name),
                code(C_TYPES.get(f.kind, f.kind)),
                number(f.default) if which != SIM_OUTPUT else "-",
                _range(f),
                cell(f.unit),
                cell(f.text),
            ]
            for f in library().fields(which)
        ]
        text.append(
            f"## {title}\n\n"
            + table(["name", "type", "default", "range", "unit", "meaning"], rows, right=(2,))
        )
    return "\n".join(text)


def log_columns() -> str:
    rows = [
        [code(name), cell(unit), allowed, cell(text)] for name, unit, allowed, text in texts.log_columns()
    ]
    return table(["column", "unit", "range", "meaning"], rows)


def estimate_columns() -> str:
    rows = [[code(name), cell(unit), cell(text)] for name, unit, text in texts.estimate_columns()]
    rows.insert(0, [code("time"), "s", "as in the log"])
    return table(["column", "unit", "meaning"], rows)


def result_columns() -> str:
    from tse.report.results import COLUMNS

    return table(["column", "type in pandas"], [[code(n), t] for n, t in COLUMNS.items()])


def vehicle_example() -> str:
    return f"```toml\n{texts.example_vehicle()}\n```\n"


def formula_places() -> str:
    lib = library()
    return table(
        ["place", "unit", "where"],
        [[code(p.name), cell(p.unit), cell(p.text)] for p in lib.formula_places.values()],
    )


def formula_operations() -> str:
    kinds = {
        "NUMBER": "number",
        "SIGNAL": "signal of the model",
        "PLAIN": "function",
        "MEMORY": "function with memory",
    }
    rows = [
        [code(o.name), kinds.get(o.kind, o.kind), str(o.takes), cell(o.unit), cell(o.text)]
        for o in library().formula_ops.values()
    ]
    return table(["name", "kind", "operands", "unit", "meaning"], rows, right=(2,))


def constants() -> str:
    """src/tables/constants.toml by its sections."""
    text = []
    for section, own in read_toml(TABLES / "constants.toml").items():
        rows = [
            [code(n), f"{Decimal(repr(r['value'])):f}", *(cell(r[k]) for k in ("unit", "why", "test"))]
            for n, r in own.items()
        ]
        text.append(f"\n## {section[:1].upper()}{section[1:]}\n")
        text.append(table(["constant", "value", "unit", "why", "shown by"], rows, right=(1,)))
    return "\n".join(text)


def gap_exit_codes() -> str:
    from tse.gaps.run.workflow import EXIT

    return table(
        ["exit code", "verdict"],
        [[str(c), cell(name.replace("_", " "))] for name, c in EXIT.items()],
        right=(0,),
    )


# ---- effects


def equation_of(effect: str) -> str:
    """What the comment of an effect in the sources says."""
    text = "".join(
        (ROOT / "src" / "model" / f).read_text(encoding="utf-8")
        for f in ("effects_constant.h", "catalogue.h")
    )
    comment = text.partition(f"/* {effect}: ")[2].partition("*/")[0]
    words = " ".join(line.strip(" *") for line in comment.splitlines()).strip()
    return words[:1].upper() + words[1:]


# ---- C headers


def functions(header: str) -> list[tuple[str, str, str]]:
    """Name, declaration and comment of every function that a header declares."""
    text = (TSE / header).read_text(encoding="utf-8")
    found = []
    for match in re.finditer(r"^(?:const )?\w+ \*?(tse_\w+)\([^;{]*?\);", text, flags=re.M | re.S):
        before = text[: match.start()].rstrip()
        comment = ""
        if before.endswith("*/"):
            comment = before[before.rindex("/*") + 2 : -2]
        plain = (line.strip().removeprefix("*").removeprefix(" ") for line in comment.splitlines())
        found.append((match[1], match[0], "\n".join(plain).strip()))
    return found


def c_page() -> str:
    text = ["# C reference", ""]
    about = {
        "tse.h": "The estimator",
        "learnt.h": "What a drive taught, kept for the next",
        "simulate.h": "The simulator with truth",
        "replay.h": "The model driven by a log, for fits",
        "describe.h": "The tables at run time, for hosts that bind to them",
        "convert.h": "Numbers of a fixed-point build",
    }
    text += [
        "Structs member by member: [tse_config](config.md), [rows, status and reasons](rows.md), "
        "[simulator](simulator.md). `tse_setting` and `tse_real` are `double` in the default build; `-DTSE_REAL=float` and "
        "`fixed` make them float and 64-bit integers. In Python the same functions are called by [the API](python.md).",
        "",
    ]
    for header, title in about.items():
        own = functions(header)
        if not own:
            continue
        text += [f"## {title}: `tse/{header}`", ""]
        previous = ""
        for name, declaration, comment in own:
            comment = comment or previous  # functions that share a comment stand below it
            text += [
                f"### {name}",
                "",
                "<!-- not compiled: a declaration of the header -->",
                "```c",
                declaration,
                "```",
                "",
            ]
            if comment:
                text += ["```text", comment, "```", ""]
            previous = comment
    return "\n".join(text)


# ---- the command line


def cli_page() -> str:
    """Every command's --help: what click prints."""
    import click

    from tselab.cli import cli

    text = ["# Command line", "", "What `tselab COMMAND --help` says.", ""]

    def walk(command: click.Command, path: list[str], parent: click.Context | None) -> None:
        ctx = click.Context(command, info_name=path[-1], parent=parent, max_content_width=100, terminal_width=100,
                            help_option_names=["-h", "--help"])  # fmt: skip
        said = command.get_help(ctx).replace("```", "'''")
        text.extend([f"{'#' * min(len(path) + 1, 3)} {' '.join(path)}", "", "```text", said, "```", ""])
        if isinstance(command, click.Group):
            for name in command.list_commands(ctx):
                if (sub := command.get_command(ctx, name)) is not None and not sub.hidden:
                    walk(sub, [*path, name], ctx)

    walk(cli, ["tselab"], None)
    return "\n".join(text)


def learnt_layout() -> str:
    """The layout as tse/learnt.h has it."""
    text = (TSE / "learnt.h").read_text(encoding="utf-8")
    layout = text[text.index('     0  "tsel"') - 3 : text.index(" * Later formats")]
    return (
        "```text\n" + "\n".join(line.removeprefix(" *") for line in layout.splitlines()).rstrip() + "\n```\n"
    )


# ---- Tables of pages that are measured when they are written: runs of the filter, and what scripts/results says in other units.

CYCLES = 1.5  # clock cycles an instruction, assumed: loads take two, and so do branches that are taken
PERIOD = 0.01  # s between rows
CLOCKS = {
    "Cortex-M4F": 168,
    "Cortex-M7": 400,
    "Cortex-M3": 72,
    "Cortex-M0": 48,
}  # MHz that parts of each core often have


def controller() -> str:
    """Return time, load and memory of a row on microcontrollers, from scripts/results/budgets.md."""
    text = (ROOT / "scripts" / "results" / "budgets.md").read_text(encoding="utf-8")
    rows = []
    for line in text.splitlines():
        cells = [c.strip(" *") for c in line.strip("|").split("|")]
        clock = next((mhz for name, mhz in CLOCKS.items() if cells[0].startswith(name)), None)
        if clock is None or len(cells) < 8 or "limit" not in cells[1]:
            continue
        mean, longest, _, flash, particles, ram, stack = (
            int(re.match(r"\**([\d,]+)", c)[1].replace(",", "")) if "," in c.split(" ")[0] else 0
            for c in cells[1:8]
        )
        each = CYCLES / clock / 1e3  # ms an instruction
        least = longest * CYCLES / PERIOD / 1e6
        rows.append(
            [cells[0], str(clock), f"{mean * each:.2f}", f"{longest * each:.2f}", f"{least:.0f}",
             *(f"{b / 1e3:.1f}" if b else "-" for b in (flash, particles, ram, stack))]
        )  # fmt: skip
    head = [
        "core, number format",
        "MHz",
        "a row: mean [ms]",
        "longest [ms]",
        "least MHz at 100 Hz",
        "flash [kB]",
    ]
    return table(
        [*head, "with the particle filter", "RAM [kB]", "stack [kB]"], rows, right=tuple(range(1, 9))
    )


def flash() -> str:
    """Return the flash of the library without some of its options, from scripts/results/budgets.md."""
    text = (ROOT / "scripts" / "results" / "budgets.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([^|]+) \| \**([\d,]+)\** \([^|]*limit[^|]*\) \|$", text, re.M)
    return table(
        ["", "flash [kB]"],
        [[name, f"{int(size.replace(',', '')) / 1e3:.1f}"] for name, size in rows],
        right=(1,),
    )


def results(name: str, rows: Sequence[str], keep: Sequence[int]) -> str:
    """Return rows of a table of scripts/results: the first that begins with each of these cells, of it the columns `keep`."""
    lines = (ROOT / "scripts" / "results" / f"{name}.md").read_text(encoding="utf-8").splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("|---")) - 1
    found = [
        lines[head],
        *(next(line for line in lines if line.startswith(f"| {start} |")) for start in rows),
    ]
    cells = [[c.strip() for c in line.strip("|").split("|")] for line in found]
    kept = [[row[k] for k in keep] for row in cells]
    return table(kept[0], kept[1:])


def measured_cars() -> str:
    """Return how far estimates of calibrated cars are from the truth, and what bounds them."""
    names = ("calibrated", "calibrated, beside the secant without relaxation", "calibrated, beside the stiffness at no slip",
             "constant of the calibration", "best constant, from the truth", "not calibrated")  # fmt: skip
    return results("cars-fresh", [f"all | {name}" for name in names], (1, 2, 3, 4, 5, 6))


def measured_events() -> str:
    """Return how long estimates are wrong after an event, and when the samples show it."""
    return results(
        "cars-events", ("ice", "split", "aquaplaning", "low_limit", "pressure"), (0, 2, 4, 5, 6, 7)
    )


def measured_logs() -> str:
    """Return what a log of a real car leaves of its stiffness."""
    logs = ("stanford_250lm_a", "genesis_cpg_fast", "genesis_rfs", "rav4_comma2k19", "subaru_sti")
    return results("real", [f"{name} | the log itself" for name in logs], (0, 3, 4, 5, 6, 7, 8, 10, 11))


def tuning() -> str:
    """Return mean NIS, whiteness, validity and error for settings that fit a simulated drive, and for some that do not."""
    import tse
    from tse.library.core import library

    log, truth = tse.simulate("double-lane-change", duration=120)
    late = log.assign(yaw_rate=log["yaw_rate"].shift(8).bfill())
    known = {"mass": 1900, "lf": 1.25, "lr": 1.5, "wheel_radius_front": 0.33, "wheel_radius_rear": 0.33}
    exact = {
        **known, "yaw_inertia": 3000, "cornering_stiffness_front": 1.2e5, "cornering_stiffness_rear": 1.4e5,
        "longitudinal_stiffness_front": 1.6e5, "longitudinal_stiffness_rear": 1.6e5,
        "uncertainty": dict.fromkeys(library().uncertainties, 0.0),
    }  # fmt: skip
    cases: list[tuple[str, Any, dict[str, Any], dict[str, float]]] = [
        ("car known exactly", log, exact, {}),
        ("... gyro 80 ms late", late, exact, {}),
        ("... mass 1500 in place of 1900 kg", log, {**exact, "mass": 1500}, {}),
        ("uncalibrated", log, known, {}),
        ("... `model_sd` 0.02", log, known, {"model_sd": 0.02}),
        ("... `model_sd` 0.2", log, known, {"model_sd": 0.2}),
        ("... gyro 80 ms late", late, known, {}),
    ]
    rows = []
    for name, drive, car, settings in cases:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = tse.estimate(drive, car, settings=settings, calibrate=False).table
        found = found[found["time"] > 20]
        e = found["innovation_yaw_rate"].dropna().to_numpy()
        error = 100 * (found["cy_front"].iloc[-1] / truth["true_cy_front"].iloc[-1] - 1)
        half = 196 * found["cy_front_sd"].iloc[-1] / found["cy_front"].iloc[-1]
        rows.append(
            [name, *(f"{found[f'nis_{c}'].mean():.1f}" for c in ("accel_y", "yaw_rate")), f"{np.corrcoef(e[1:], e[:-1])[0, 1]:.2f}",
             f"{100 * found['cy_front_valid'].mean():.0f}", f"{round(error) + 0:+d}", f"{half:.0f}"]
        )  # fmt: skip
    head = [
        "settings",
        "mean `nis_accel_y`",
        "`nis_yaw_rate`",
        "autocorrelation of yaw rate's innovation",
        "valid [%]",
        "error [%]",
        "± [%]",
    ]
    return table(head, rows, right=(1, 2, 3, 4, 5, 6))
