"""Make tables and pages of the documentation, most of them from src/tables.

Each function make_X() returns the content of block X. A block is a part of a Markdown
page between the comments `<!-- table: X -->` and `<!-- end -->`. docsite.fill calls the
functions and replaces the blocks.
"""

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
TABLES_FOLDER = ROOT / "src" / "tables"
C_TYPES = {"s": "tse_setting", "r": "tse_real", "i": "int32_t", "u": "uint32_t"}
SETTING_GROUPS = {  # heading of each table of settings, in the order of tse_config
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
# Key: hook, the place in the model at which the function of an effect is called
# (src/tables/effects.toml). Value: quantity that this function changes.
HOOKS = {
    "CONSTANT": "the settings, before the model runs",
    "INPUT": "the steering angle of a row",
    "SLIP": "slip and slip angle of an axle",
    "LAG": "slip or slip angle of the tyre forces, which become states of the model",
    "STIFFNESS": "the stiffness of an axle",
    "GRIP": "the secant stiffness of an axle, which limits its lateral force",
    "BODY": "forces and yaw moment on the body other than those of the tyres, and gravity",
    "SENSOR": "the signals of accelerometers and gyro",
}
# Column of the table of results (ESTIMATE_COLUMNS in tse.report.results) -> meaning
RESULT_MEANINGS = {
    "log": "path of the log",
    "stretch": "number of the stretch in the log, from 1",
    "start": "start of the stretch [s]",
    "end": "end of the stretch [s]",
    "stiffness": "cx_front, cy_front or cy_rear",
    "value": "filtered stiffness in the last valid row or, if no row is valid, in the last row of the "
    "stretch [N, N/rad]",
    "sd": "standard deviation of value [N, N/rad]",
    "low": "lower limit of the 95 % interval of value [N, N/rad]",
    "high": "upper limit of the 95 % interval of value [N, N/rad]",
    "smoothed": "stiffness smoothed over the stretch [N, N/rad]; empty with the paper's filter",
    "smoothed_sd": "standard deviation of smoothed [N, N/rad]",
    "smoothed_low": "lower limit of the 95 % interval of smoothed [N, N/rad]",
    "smoothed_high": "upper limit of the 95 % interval of smoothed [N, N/rad]",
    "smoothed_reason": "valid, or the reason why smoothed is not valid",
    "spread": "sd of the stiffness from sample to sample / value; only of the paper's filter",
    "nominal": "stiffness in the vehicle file [N, N/rad]",
    "valid": "number of valid rows / number of rows of the stretch",
    "usable": "yes, in part or no",
    "reason": "most frequent reason of the rows that are not valid; empty if usable is yes",
    "change": "kind of the change at the start of the stretch; empty in the first stretch",
    "change_probability": "probability that since this change no further change, sliding or sensor fault has "
    "begun",
    "ratio": "stiffness after this change / before it",
    "ratio_sd": "standard deviation of ratio",
    "warnings": "warnings about log and vehicle file",
    "text": "the result as a sentence",
}


def escape_cell(text: object) -> str:
    """Return a text with the special characters of a Markdown table cell escaped."""
    return (
        str(text)
        .replace("|", "\\|")
        .replace("\n", " ")
        .replace("<", "&lt;")
        .replace("*", "\\*")
        .replace("_", "\\_")
    )


def format_code(text: object) -> str:
    """Return a text as inline code of Markdown."""
    return f"`{text}`"


def format_table(head: Sequence[str], rows: Iterable[Sequence[str]], right: tuple[int, ...] = ()) -> str:
    """Return a Markdown table.

    Parameters
    ----------
    head : sequence of str
        Titles of the columns.
    rows : iterable of sequences of str
        Cells, already escaped.
    right : tuple of int
        Indices of right-aligned columns.
    """
    lines = [
        "| " + " | ".join(head) + " |",
        "|" + "|".join("---:" if i in right else "---" for i in range(len(head))) + "|",
    ]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def format_number(x: float) -> str:
    """Return a number as text, "-" for NaN."""
    return "-" if math.isnan(x) else f"{x:.10g}"


def _format_range(f: Field) -> str:
    """Return the range of a field as text, "any" if it has none."""
    return f"{f.low:g} .. {f.high:g}" if f.has_range else "any"


def find_group(setting: str) -> str:
    """Return the name of the table in src/tables that defines a setting."""
    return library().settings[setting].table


def format_settings(fields: Iterable[Field]) -> str:
    """Return a Markdown table of settings: type, default, range, unit, meaning."""
    rows = [
        [
            f'<span id="{f.name}"></span>{format_code(f.name)}',
            format_code(C_TYPES[f.kind]),
            format_number(f.default),
            _format_range(f),
            escape_cell(f.unit if not f.is_integer else "integer"),
            library().settings[f.name].filter,
            escape_cell(f.text),
        ]
        for f in fields
    ]
    return format_table(["member", "type", "default", "range", "unit", "filter", "meaning"], rows, right=(2,))


def make_config_page() -> str:
    """Return the page of all members of tse_config."""
    fields, text = library().fields(CONFIG), []
    for name, title in SETTING_GROUPS.items():
        own = [f for f in fields if find_group(f.name) == name]
        file = f"src/tables/{sources.find_file(name)}.toml"
        text.append(f"## {title}\n\n`{file}`, {len(own)} settings.\n\n{format_settings(own)}")
    return (
        f"# tse_config: settings\n\n`tse_config` has {len(fields)} members, in SI units. "
        "`tse_config_default()` sets them to their defaults. `tse_prepare()` refuses a setting outside its "
        "range, and names it. The same names are keys of a vehicle file (`[uncertainty]`, `[sensors]`, "
        "`[latency]`, `[effects.<id>]` in their tables), of `--set` and of `tse.Filter(settings=...)`, and "
        "parameters of the FMUs.\n\n"
        "The defaults are those of an ordinary car that is not calibrated. A default of 0 below the range "
        "means: not set. Column `filter`: the filters whose estimate the setting changes: `default`, `paper` "
        "or both; none: only simulator and replay use it. The following settings have different values in "
        "`tse_config_exact()`, a car that is known exactly:\n\n"
        + make_uncalibrated()
        + "\n"
        + "\n".join(text)
    )


def make_uncalibrated() -> str:
    """Return a table of the settings with two values: the default, for a car that is not
    calibrated, and the value in tse_config_exact(), for a car that is known exactly."""
    rows = read_toml(TABLES_FOLDER / "uncalibrated.toml")["setting"].items()
    exact = Config.exact()
    return format_table(
        ["setting", "default", "car known exactly", "unit", "reason for the default"],
        [
            [
                format_code(n),
                f"{r['value']:g}",
                f"{getattr(exact, n):.9g}",
                escape_cell(exact.fields[n].unit),
                escape_cell(r["why"]),
            ]
            for n, r in rows
        ],
        right=(1, 2),
    )


def make_input_fields() -> str:
    """Return the table of the members of tse_input."""
    rows = []
    channels = read_toml(TABLES_FOLDER / "input.toml")["channel"]
    policies = {
        c["name"]: {"drives": "refused", "measured": "counts as missing"}[c["kind"]] for c in channels
    }
    optional = [f.name for f in library().optional]
    for f in library().fields(INPUT):
        policy = policies.get(f.name, "refused" if f.name == "dt" else "-")
        unit, allowed, text = f.unit, _format_range(f), f.text
        if f.name == "dt":
            unit, allowed = "s", "above 0 .. 3600"
            text = (
                "time since the previous row; after tse_reset(), ignored up to the first row with all inputs"
            )
        for name, those, what in (
            ("missing", library().channels, "channels that are missing, in addition to those that are NaN"),
            ("given", library().optional, "optional channels below that this row has; 0: none is read"),
        ):
            if f.name == name:
                unit, allowed = "bits", "any"
                text = f"{what}: " + ", ".join(f"{1 << i} {c.name}" for i, c in enumerate(those))
        if f.name in optional:
            policy = "not used"
        rows.append(
            [
                format_code(f.name),
                format_code(C_TYPES[f.kind]),
                allowed,
                escape_cell(unit),
                policy,
                escape_cell(text),
            ]
        )
    return format_table(["member", "type", "range", "unit", "out of range", "meaning"], rows)


def list_output_members() -> dict[str, str]:
    """Return a dict: name of an output -> member of tse_output that holds this output."""
    return {
        name: row.get("member", name)
        for name, row in read_toml(TABLES_FOLDER / "output.toml")["column"].items()
    }


def make_output_fields() -> str:
    """Return the table of the members of tse_output.

    For each estimate, tse_output has the reason why the estimate is not valid. The table
    of estimates and the FMUs have an output NAME_valid instead: 1 valid, 0 not valid."""
    members = list_output_members()
    rows = []
    for f in library().fields(OUTPUT):
        text = f.text
        if f.name.endswith("_valid"):
            text = (
                "in C: 0 if the estimate is valid, otherwise the reason why it is not (tse_reason). Column "
                f"and FMU output: 1 valid, 0 not valid; {f.name.removesuffix('_valid')}_reason has the reason"
            )
        unit = f.unit if not f.is_integer else "integer"
        rows.append(
            [
                format_code(members[f.name]),
                format_code(f.name),
                format_code(C_TYPES[f.kind]),
                escape_cell(unit),
                escape_cell(text),
            ]
        )
    return format_table(
        ["member of tse_output", "column of the estimates, FMU output", "type in C", "unit in C", "meaning"],
        rows,
    )


def _format_codes(which: int) -> str:
    """Return a table of codes. `which` is STATUS or REASON."""
    rows = [
        [str(c), format_code(f.name), escape_cell(f.text)] for c, f in sorted(library().codes(which).items())
    ]
    return format_table(["code", "name", "meaning"], rows, right=(0,))


def make_status_codes() -> str:
    """Return the table of the status codes."""
    return _format_codes(STATUS)


def make_reason_codes() -> str:
    """Return the table of the reasons why an estimate may not be used."""
    return _format_codes(REASON)


def make_regimes() -> str:
    """Return the table of the regimes of the filter (steady, road changed, channel faulty
    ...): for each, the output that is its probability, and the meaning."""
    return format_table(
        ["output", "in C", "meaning"],
        [
            [format_code(f"p_{i.lower()}"), format_code(f"y.regime[TSE_REGIME_{i}]"), escape_cell(t)]
            for i, t in read_toml(TABLES_FOLDER / "output.toml")["regime"].items()
        ],
    )


def make_simulator() -> str:
    """Return the tables of the simulator: settings, input and output."""
    text = []
    for title, which in (
        ("tse_sim_config: settings", SIM_CONFIG),
        ("tse_sim_input: a row of the driver", SIM_INPUT),
        ("tse_sim_output", SIM_OUTPUT),
    ):
        rows = [
            [
                format_code(f.name),
                format_code(C_TYPES.get(f.kind, f.kind)),
                format_number(f.default) if which != SIM_OUTPUT else "-",
                _format_range(f),
                escape_cell(f.unit),
                escape_cell(f.text),
            ]
            for f in library().fields(which)
        ]
        text.append(
            f"## {title}\n\n"
            + format_table(["name", "type", "default", "range", "unit", "meaning"], rows, right=(2,))
        )
    return "\n".join(text)


def make_log_columns() -> str:
    """Return the table of the columns of a log."""
    rows = [
        [format_code(name), escape_cell(unit), allowed, escape_cell(text)]
        for name, unit, allowed, text in texts.list_log_columns()
    ]
    return format_table(["column", "unit", "range", "meaning"], rows)


def make_estimate_columns() -> str:
    """Return the table of the columns that `tselab estimate --out` writes."""
    rows = [
        [format_code(name), escape_cell(unit), escape_cell(text)]
        for name, unit, text in texts.list_estimate_columns()
    ]
    rows.insert(0, [format_code("time"), "s", "as in the log"])
    return format_table(["column", "unit", "meaning"], rows)


def make_result_columns() -> str:
    """Return the table of the columns that `tselab estimate --table` writes."""
    from tse.report.results import ESTIMATE_COLUMNS

    return format_table(
        ["column", "type in pandas", "meaning"],
        [[format_code(n), t, escape_cell(RESULT_MEANINGS[n])] for n, t in ESTIMATE_COLUMNS.items()],
    )


def make_vehicle_example() -> str:
    """Return the example of a vehicle file."""
    return f"```toml\n{texts.example_vehicle()}\n```\n"


def make_formula_places() -> str:
    """Return the table of the quantities of the model to which a formula can be added."""
    lib = library()
    return format_table(
        ["place", "unit", "where"],
        [
            [format_code(p.name), escape_cell(p.unit), escape_cell(p.text)]
            for p in lib.formula_places.values()
        ],
    )


def make_formula_operations() -> str:
    """Return the table of the operations that a formula can use."""
    kinds = {
        "NUMBER": "number",
        "SIGNAL": "signal of the model",
        "PLAIN": "function",
        "MEMORY": "function with memory",
    }
    rows = [
        [
            format_code(o.name),
            kinds.get(o.kind, o.kind),
            str(o.takes),
            escape_cell(o.unit),
            escape_cell(o.text),
        ]
        for o in library().formula_ops.values()
    ]
    return format_table(["name", "kind", "operands", "unit", "meaning"], rows, right=(2,))


def make_constants() -> str:
    """Return a table for each section of src/tables/constants.toml."""
    text = []
    for section, own in read_toml(TABLES_FOLDER / "constants.toml").items():
        rows = [
            [
                format_code(n),
                f"{Decimal(repr(r['value'])):f}",
                *(escape_cell(r[k]) for k in ("unit", "why", "test")),
            ]
            for n, r in own.items()
        ]
        text.append(f"\n## {section[:1].upper()}{section[1:]}\n")
        text.append(format_table(["constant", "value", "unit", "why", "tested by"], rows, right=(1,)))
    return "\n".join(text)


def make_gap_exit_codes() -> str:
    """Return the table of exit codes of `tselab gap`."""
    from tse.gaps.infer.hypotheses import NAME_AT
    from tse.gaps.run.workflow import DOUBTFUL, EXIT, MIN_UNNAMED_PROBABILITY

    sure, possible = 100 * NAME_AT, 100 * MIN_UNNAMED_PROBABILITY
    meanings = {
        "none": "nothing is missing that these logs could show",
        "named": f"at least one effect is missing; each named effect has at least {sure:.0f} %, at least one "
        "has no look-alike",
        DOUBTFUL: f"an effect is missing with {possible:.0f} .. {sure:.0f} % probability, or each named "
        "effect has look-alikes",
        "not_in_catalogue": "something is missing that the effects of the catalogue do not explain",
    }
    return format_table(
        ["exit code", "verdict", "meaning"],
        [
            [str(c), escape_cell(name.replace("_", " ")), escape_cell(meanings[name])]
            for name, c in EXIT.items()
        ],
        right=(0,),
    )


# ---- effects


def find_equation(effect: str) -> str:
    """Return the comment on the function of an effect as Markdown. It contains the
    equation.

    An indented line of the comment is an equation, and becomes a paragraph in code font.
    """
    text = "".join(
        (ROOT / "src" / "model" / f).read_text(encoding="utf-8")
        for f in ("effects_constant.h", "catalogue.h")
    )
    comment = text.partition(f"/* {effect}: ")[2].partition("*/")[0]
    made: list[str] = []
    paragraph: list[str] = []  # lines of the paragraph that has begun
    for line in (*(line.strip().removeprefix("*") for line in comment.splitlines()), ""):
        is_equation = line.startswith("   ")
        if line.strip() and not is_equation:
            paragraph.append(line.strip())
            continue
        if paragraph:
            made.append(escape_cell(" ".join(paragraph)))
            paragraph = []
        if is_equation:
            made.append(format_code(line.strip()))
    return "\n\n".join(made)


# ---- C headers


def list_functions(header: str) -> list[tuple[str, str, str]]:
    """Return name, declaration and comment of each function of a header. The comment is
    "" if none stands directly above the declaration."""
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


def make_c_page() -> str:
    """Return the page of all C functions."""
    text = ["# C reference", ""]
    about = {
        "tse.h": "The estimator",
        "learnt.h": "The learnt state, from one drive to the next",
        "simulate.h": "The simulator, with true values",
        "replay.h": "The model with a log as input, for fits",
        "describe.h": "The tables of the library at run time, for bindings",
        "convert.h": "Conversion of numbers, for fixed-point builds",
    }
    text += [
        "Members of the structs: [tse_config](config.md), [rows, status and reasons](rows.md), "
        "[simulator](simulator.md). `tse_setting` and `tse_real` are `double` in the default build, "
        "`float` with `-DTSE_REAL=float`, and 64-bit integers with `-DTSE_REAL=fixed`. "
        "[The Python API](python.md) calls the same functions.",
        "",
    ]
    for header, title in about.items():
        own = list_functions(header)
        if not own:
            continue
        text += [f"## {title}: `tse/{header}`", ""]
        previous = ""
        for name, declaration, comment in own:
            comment = comment or previous  # one comment may describe several functions below it
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


def make_cli_page() -> str:
    """Return the page of all commands, with the output of --help for each command."""
    import click

    from tselab.cli import cli

    text = ["# Command line", "", "The output of `tselab COMMAND --help` for each command.", ""]

    def add_command(command: click.Command, path: list[str], parent: click.Context | None) -> None:
        ctx = click.Context(
            command,
            info_name=path[-1],
            parent=parent,
            max_content_width=100,
            terminal_width=100,
            help_option_names=["-h", "--help"],
        )
        said = command.get_help(ctx).replace("```", "'''")
        text.extend([f"{'#' * min(len(path) + 1, 3)} {' '.join(path)}", "", "```text", said, "```", ""])
        if isinstance(command, click.Group):
            for name in command.list_commands(ctx):
                if (sub := command.get_command(ctx, name)) is not None and not sub.hidden:
                    add_command(sub, [*path, name], ctx)

    add_command(cli, ["tselab"], None)
    return "\n".join(text)


def make_learnt_layout() -> str:
    """Return the layout of a file with a learnt state, from the comment in
    tse/learnt.h."""
    text = (TSE / "learnt.h").read_text(encoding="utf-8")
    layout = text[text.index('     0  "tsel"') - 3 : text.index(" *\n * In every format")]
    return (
        "```text\n" + "\n".join(line.removeprefix(" *") for line in layout.splitlines()).rstrip() + "\n```\n"
    )


# ---- tables of measured numbers: from runs of the filter, and from scripts/results

# Assumed mean number of clock cycles of an instruction: most need 1, loads and taken
# branches need 2.
CYCLES = 1.5
PERIOD = 0.01  # [s] time between rows
CLOCKS = {"Cortex-M4F": 168, "Cortex-M7": 400, "Cortex-M3": 72, "Cortex-M0": 48}  # [MHz] usual clock rates


def make_controller() -> str:
    """Return a table for microcontrollers: time of a filter step, memory, and the lowest
    clock rate at which the processor keeps up with 100 rows per second.

    The numbers are computed from scripts/results/budgets.md."""
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
        each = CYCLES / clock / 1e3  # [ms] time of an instruction
        least = longest * CYCLES / PERIOD / 1e6
        rows.append(
            [cells[0], str(clock), f"{mean * each:.2f}", f"{longest * each:.2f}", f"{least:.0f}",
             *(f"{b / 1e3:.1f}" if b else "-" for b in (flash, particles, ram, stack))]
        )  # fmt: skip
    head = [
        "core, number format",
        "clock [MHz]",
        "mean time of a row [ms]",
        "longest [ms]",
        "lowest clock for 100 Hz [MHz]",
        "flash [kB]",
        "flash with the particle filter [kB]",
        "RAM [kB]",
        "stack [kB]",
    ]
    return format_table(head, rows, right=tuple(range(1, 9)))


def make_flash() -> str:
    """Return a table of the flash memory that the library needs if some of its parts are
    left out of the build.

    The numbers are those of scripts/results/budgets.md."""
    text = (ROOT / "scripts" / "results" / "budgets.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([^|]+) \| \**([\d,]+)\** \([^|]*limit[^|]*\) \|$", text, re.M)
    names = {
        "everything": "with all options",
        "without any of these": "without any of these four",
        "... and small": "without any of these four, with `TSE_SMALL`",
    }
    return format_table(
        ["build", "flash [kB]"],
        [[names.get(name, name), f"{int(size.replace(',', '')) / 1e3:.1f}"] for name, size in rows],
        right=(1,),
    )


def select_results(
    name: str, rows: Sequence[str], keep: Sequence[int], head: Sequence[str], titles: Sequence[str] = ()
) -> str:
    """Return some rows and columns of a table of scripts/results.

    Parameters
    ----------
    name
        File name without suffix.
    rows
        For each text, the first row that begins with it is selected. A text has whole
        cells, separated by " | ".
    keep
        Indices of the columns to select.
    head
        Titles of the selected columns.
    titles
        First cells of the selected rows; empty: those of the file.
    """
    lines = (ROOT / "scripts" / "results" / f"{name}.md").read_text(encoding="utf-8").splitlines()
    found = [next(line for line in lines if line.startswith(f"| {start} |")) for start in rows]
    cells = [[c.strip() for c in line.strip("|").split("|")] for line in found]
    kept = [[row[k] for k in keep] for row in cells]
    named = [[title, *row[1:]] for title, row in zip(titles, kept, strict=True)] if titles else kept
    return format_table(head, named)


def make_measured_cars() -> str:
    """Return a table with the errors of the stiffnesses that the filter estimates for
    calibrated cars.

    For comparison, the table also has the errors for cars that are not calibrated, and
    the errors without a filter: with the constant stiffness of the calibration, and with
    the best constant, the median of the true stiffness."""
    names = {  # estimator in the file -> title on the page
        "calibrated": "filter, calibrated car; truth: secant over the slip angle of the wheels",
        "calibrated, beside the secant without relaxation": "the same filter; truth: secant over the relaxed "
        "slip angle",
        "calibrated, beside the stiffness at no slip": "the same filter, output `stiffness`; truth: slope at "
        "zero slip",
        "constant of the calibration": "no filter: constant stiffness of the calibration",
        "best constant, from the truth": "no filter: median of the true secants of the car",
        "not calibrated": "filter, car not calibrated",
    }
    head = [
        "estimator; truth",
        "median error [%]",
        "valid [% of rows]",
        "error above 10 % [% of valid rows]",
        "95 % interval contains truth [% of rows]",
        "false changes per hour",
    ]
    return select_results(
        "cars-fresh", [f"all | {name}" for name in names], (1, 2, 3, 4, 5, 6), head, list(names.values())
    )


def make_measured_events() -> str:
    """Return a table with the time for which estimates are valid but wrong by more than
    20 % after an event, such as ice or a loss of pressure.

    The table also has the ratio of the true stiffness after the event to that before it,
    the share of events that the filter reports within 5 s, and the time after which the
    measurements show the event."""
    names = {  # event in the file -> title on the page
        "ice": "ice: friction 25 .. 40 %, stiffness 40 .. 65 % of the dry road",
        "split": "split: ice on one side of the car",
        "aquaplaning": "aquaplaning for 3 s: front stiffness 15 .. 40 %, rear 40 .. 70 %",
        "low_limit": "lower friction limit: 45 .. 60 %, stiffness unchanged",
        "pressure": "one tyre loses pressure within 1 .. 3 min: its cornering stiffness falls to 60 .. 80 %",
    }
    head = [
        "event",
        "true secant, median after / before",
        "valid in the next 60 s [% of rows]",
        "time with a valid secant more than 20 % off, in the next 60 s [s]: median; 90 %; max",
        "the same for the stiffness at zero slip [s]",
        "reported within 5 s [% of drives]",
        "shows after [s]: median, 90 %",
    ]
    return select_results("cars-events", list(names), (0, 2, 4, 5, 6, 7, 8), head, list(names.values()))


def make_measured_logs() -> str:
    """Return a table of the stiffness estimated from logs of real cars."""
    logs = ("stanford_250lm_a", "genesis_cpg_fast", "genesis_rfs", "rav4_comma2k19", "subaru_sti")
    head = [
        "log",
        "sd of the calibrated cornering stiffness, front / rear [%]",
        "this sd if all other parameters were known, front / rear [%]",
        "front [kN/rad]",
        "front valid [% of rows]",
        "rear [kN/rad]",
        "rear valid [% of rows]",
        "sideslip: rms error of the filter [deg]",
        "sideslip: rms error of the formula [deg]",
    ]
    return select_results(
        "real", [f"{name} | the log itself" for name in logs], (0, 3, 4, 5, 6, 7, 8, 10, 11), head
    )


def make_tuning() -> str:
    """Return a table that shows how a wrong mass, latency or `model_sd` changes the
    innovations, the share of valid rows, and error and 95 % interval of `cy_front`.

    NIS is the normalised innovation squared of one channel: the square of the innovation,
    divided by its predicted variance."""
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
            [
                name,
                *(f"{found[f'nis_{c}'].mean():.1f}" for c in ("accel_y", "yaw_rate")),
                f"{np.corrcoef(e[1:], e[:-1])[0, 1]:.2f}",
                f"{100 * found['cy_front_valid'].mean():.0f}",
                f"{round(error) + 0:+d}",
                f"{half:.0f}",
            ]
        )
    head = [
        "settings",
        "mean `nis_accel_y`",
        "mean `nis_yaw_rate`",
        "autocorrelation of `innovation_yaw_rate`",
        "rows with valid `cy_front` [%]",
        "error of `cy_front` at the end [%]",
        "half of its 95 % interval [%]",
    ]
    return format_table(head, rows, right=(1, 2, 3, 4, 5, 6))
