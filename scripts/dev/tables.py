#!/usr/bin/env python3
"""Write src/tables/*.toml as C code into parts of C sources and headers.

    scripts/dev/tables.py
        write these parts: structs, enumerations, rows of tables
    scripts/dev/tables.py --check
        write nothing; name each file with a part that is out of date, and fail if there
        is one

Such a generated part stands between `// clang-format off: table NAME` and
`// clang-format on: end of table`. The dict REGIONS has the function that generates the
part NAME.
"""

import argparse
import json
import re
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]
REGION = re.compile(
    r"^( *// clang-format off: table (\w+)\n).*?^( *// clang-format on: end of table\n)", re.M | re.S
)
SOURCES = ("include/tse/*.h", "src/*/*.[ch]", "fmu/*/*.[ch]", "tests/replay/*.h", "docs/page/*.c")
CONFIG = (
    "vehicle",
    "uncertainty",
    "sensors",
    "latency",
    "velocity",
    "pedals",
    "road",
    "effects",
    "formula",
    "filter",
)
# Key: a table that shares its file with other tables. Value: name of this file. Any table
# that is not a key has a file of its own, with the name of the table.
SECTIONS = dict.fromkeys(("sensors", "latency", "velocity", "pedals", "road"), "sensors")
SECTIONS |= dict.fromkeys(("sim", "sim_input", "sim_output"), "sim")
# Default, low and high of a row of tse_describe() that has no range: low is above high
NO_RANGE = "0.0, 1.0, -1.0"
# Tables with settings that only one filter uses. Key of ONLY: this filter (column
# `filter`). Value: text that is appended to the text of the setting.
ONLY_IN = ("vehicle", "sensors", "filter")
ONLY = {"default": "; no effect in the paper's filter", "paper": "; no effect in the default filter"}
# Key: column `filter` of an effect. Value: which filters use the effect, as text for
# tse_describe_effects().
USES = {
    "both": "both filters use it",
    "default": "the default filter uses it, the paper's does not",
    "none": "no filter uses it, simulator and replay do",
}
Row = dict[str, Any]


def read(name: str) -> Row:
    """Return a table of src/tables, unchanged."""
    table = tomllib.loads((ROOT / "src" / "tables" / f"{find_file(name)}.toml").read_text(encoding="utf-8"))
    return table[name] if name in SECTIONS else table


def find_file(name: str) -> str:
    """Return the name, without suffix, of the src/tables file with the table `name`."""
    return SECTIONS.get(name, name)


def read_settings(name: str) -> dict[str, Row]:
    """Return the settings of a table by name: defaults, range, unit and text of each.

    Each setting has the columns of the TOML file, but these are added or replaced:
    exact: value in tse_config_exact(), for a car whose parameters are known exactly: the
    `default` of the TOML file;
    default: value in tse_config_default(), for an ordinary car: the value in
    uncalibrated.toml if that file has the setting, otherwise the same as `exact`;
    whole: True if the setting is an integer;
    filter: filters whose estimates depend on the setting; "both" if the TOML file has no
    such column;
    unit, replaced_by: "" if the TOML file has no such column;
    text: text of the TOML file; in the tables ONLY_IN, a text of ONLY is appended if one
    of the filters does not use the setting.
    """
    table = read(name)
    if name == "formula":
        table = table["setting"]
    if name == "effects":
        table = {
            f"{i}_{p}": {"filter": e["filter"], **row, "effect": i}
            for i, e in table.items()
            for p, row in e["parameter"].items()
        }
    ordinary = read("uncalibrated")["setting"]
    return {
        n: {
            "unit": "",
            "filter": "both",
            "replaced_by": "",
            **row,
            "text": row["text"] + (ONLY.get(row.get("filter"), "") if name in ONLY_IN else ""),
            "whole": not isinstance(row["default"], float),
            "exact": row["default"],
            "default": ordinary.get(n, {"value": row["default"]})["value"],
        }
        for n, row in table.items()
    }


def read_config() -> dict[str, Row]:
    """Return all settings of tse_config, in the order of its members."""
    return {n: row for table in CONFIG for n, row in read_settings(table).items()}


def format_c(x: float | int | str) -> str:
    """Return a number as C source. Return a string unchanged: it is a C expression."""
    return x if isinstance(x, str) else repr(x)


def format_start(row: Row, of: str = "default") -> str:
    """Return the default of a setting as C source.

    If the upper limit of the setting is a C expression, a build option may make this
    limit smaller than the default. The result is then a C expression for min(default,
    upper limit).

    Parameters
    ----------
    row : dict
        The setting.
    of : str
        "default" for tse_config_default(), "exact" for tse_config_exact().
    """
    default, most = format_c(row[of]), format_c(row["most"])
    return f"{default} < {most} ? {default} : {most}" if isinstance(row["most"], str) else default


def format_short(x: float | int | str) -> str:
    """Return a number with at most 10 digits, for comments. Return a string unchanged."""
    return x if isinstance(x, str) else f"{x:.10g}"


def quote(x: str) -> str:
    """Return a text as a C string literal."""
    return json.dumps(x, ensure_ascii=False)


def pack_lines(parts: Iterable[str]) -> list[str]:
    """Return the parts, joined by spaces, in lines of at most 106 columns.

    No part is broken: its spaces are replaced by NUL characters before the lines are
    wrapped, and fill_tables() replaces these by spaces again."""
    return textwrap.wrap(
        " ".join(p.replace(" ", "\0") for p in parts), 106, break_long_words=False, break_on_hyphens=False
    )


def format_member(kind: str, name: str, about: str, width: int) -> str:
    """Return the line of a struct member, with a comment after column `width`."""
    return f"{f'{kind} {name};':<{width}} /* {about} */"


def describe_setting(row: Row) -> str:
    """Return the comment on a setting: "[unit] default, min .. max; meaning"."""
    unit = "" if row.get("whole") else f"[{row['unit']}] "
    numbers = f"{format_short(row['default'])}, {format_short(row['least'])} .. {format_short(row['most'])}"
    return f"{unit}{numbers}; {row['text']}"


def list_members(rows: dict[str, Row], real: str) -> list[str]:
    """Return the members of a struct of settings.

    `real`: C type of each setting that is not an integer: tse_setting or tse_real."""
    return [
        format_member(
            "int32_t" if r.get("whole") else real, n, describe_setting(r), 45 if real == "tse_setting" else 28
        )
        for n, r in rows.items()
    ]


def format_field(of: str, name: str, kind: str, place: str, numbers: str, unit: str, says: str) -> str:
    """Return a row of the tables of tse_describe(), for one member of a struct.

    `of`: name of the struct. `name`: name of the member for the user. `place`: the member
    in C. `kind`: letter for its type (tse_field.kind). `numbers`: default, low and high,
    as C source. `says`: meaning of the member."""
    return (
        f"{{ {quote(name)}, '{kind}', (int32_t)offsetof({of}, {place}), {numbers}, {quote(unit)}, "
        f"{quote(says)} }},"
    )


def make_fmu_name(group: str, name: str) -> str:
    """Return the name of the FMU parameter that holds a setting."""
    return f"{ {'formula': 'effects', 'sim': 'simulation'}.get(group, group) }.{name}"


def list_settings() -> Iterator[str]:
    """Yield the lines of a macro SETTINGS_<TABLE> for each table except effects.

    The macro lists the settings of the table."""
    for group in (*(g for g in CONFIG if g != "effects"), "sim"):
        rows = [
            f"{'WHOLE' if r['whole'] else 'REAL'}({quote(make_fmu_name(group, n))}, {n}, "
            f"{format_start(r)}, {format_start(r, 'exact')}, "
            f"{format_c(r['least'])}, {format_c(r['most'])}, {quote(r['unit'])}, {quote(r['text'])})"
            for n, r in read_settings(group).items()
        ]
        yield from format_macro(f"SETTINGS_{group.upper()}(REAL, WHOLE)", rows)


# ---- a log row


def read_channels() -> list[Row]:
    """Return the required channels of a log row."""
    return list(read("input")["channel"])


def read_optional() -> list[Row]:
    """Return the optional channels of a log row."""
    table = read("input")
    return [*table["velocity"], *table["pedal"], *table["road"]]


def list_inputs(rows: Iterable[Row], outside: dict[str, str]) -> list[str]:
    """Return the members of tse_input for the channels `rows`, as lines of C source.

    `outside`: key: column `kind` of the channel ("drives", "measured"; "" for an optional
    channel). Value: what the filter does with a value out of range, for the comment."""
    return [
        format_member(
            "tse_real",
            r["name"],
            f"[{r['unit']}] {format_short(r['least'])} .. {format_short(r['most'])}, "
            f"{outside[r.get('kind', '')]}; {r['text']}",
            28,
        )
        for r in rows
    ]


# ---- outputs, status


def read_outputs() -> dict[str, Row]:
    """Return the output columns by name."""
    return {
        n: {"member": n, "kind": "real", "unit": "", **row} for n, row in read("output")["column"].items()
    }


def list_output_members() -> list[str]:
    """Return the members of tse_output."""
    rows = read("output")["member"]
    kinds = {n: "tse_real" if "unit" in r else "int32_t" for n, r in rows.items()}
    return [
        format_member(
            kinds[n],
            n + (f"[{r['count']}]" if "count" in r else ""),
            (f"[{r['unit']}] " if "unit" in r else "") + r["text"],
            30,
        )
        for n, r in rows.items()
    ]


def list_hashed_outputs() -> list[str]:
    """Return the outputs that are part of the hash that tests compute for a drive.

    estimate_age is left out: it is always 0 in these drives, which have no late channel.
    """
    rows = [(n, r) for n, r in read_outputs().items() if n != "estimate_age"]
    return [
        f"{{ {quote(n)}, offsetof(tse_output, {r['member']}), "
        f"{int(r['kind'] in ('flag', 'reason', 'code'))} }},"
        for n, r in rows
    ]


def list_codes(table: str) -> list[str]:
    """Return the codes of a table of status.toml as the constants of an enumeration."""
    return [
        f"{n + ' = ' + str(r['code']) + ',':<29} /* {r['text']} */" for n, r in read("status")[table].items()
    ]


def describe_codes(rows: dict[str, Row]) -> list[str]:
    """Return the C source of codes, as rows of a table that tse_describe() returns."""
    return [
        f"{{ {quote(r.get('word', n))}, 'c', {r['code']}, {NO_RANGE}, {quote(r.get('unit', ''))}, "
        f"{quote(r['text'])} }},"
        for n, r in rows.items()
    ]


# ---- settings


def list_constants() -> list[str]:
    """Return the constants of src/tables/constants.toml as definitions of macros."""
    rows = [(n, r) for section in read("constants").values() for n, r in section.items()]
    return [
        f"#define {n + ' TSE_R(' + format_c(r['value']) + ')':<32} /* [{r['unit']}] {r['why']} */"
        for n, r in rows
    ]


def list_config_groups() -> list[str]:
    """Return definitions of the C constants FIRST_<TABLE> and COUNT_<TABLE>.

    A real setting is a setting that is not an integer. FIRST_<TABLE> is the index of the
    first real setting of the table among all real settings of tse_config. COUNT_<TABLE>
    is the number of real settings of the table. FIRST_WHOLE_FORMULA and
    COUNT_WHOLE_FORMULA are the same for the integer settings of the table `formula`,
    among all integer settings."""
    parts = []
    reals = [n for n, r in read_config().items() if not r["whole"]]
    wholes = [n for n, r in read_config().items() if r["whole"]]
    for group in ("vehicle", "latency", "effects", "formula"):
        own = [n for n, r in read_settings(group).items() if not r["whole"]]
        parts += [f"FIRST_{group.upper()} = {reals.index(own[0])},", f"COUNT_{group.upper()} = {len(own)},"]
    own = [n for n, r in read_settings("formula").items() if r["whole"]]
    return pack_lines(
        [*parts, f"FIRST_WHOLE_FORMULA = {wholes.index(own[0])},", f"COUNT_WHOLE_FORMULA = {len(own)},"]
    )


def list_copies(group: str) -> Iterator[str]:
    """Yield `COPY(member of tse_params, setting),` for the settings of a table.

    The column `constant` of a setting names the members that are copies of it. A setting
    without this column is not copied."""
    for name, row in read_settings(group).items():
        constant = row.get("constant", [])
        yield from (f"COPY({x}, {name})," for x in ([constant] if isinstance(constant, str) else constant))


# ---- effects, formula


def describe_use(effect: Row) -> str:
    """Return the sentence on how the filters use an effect."""
    parts = [USES[effect["filter"]]]
    if "remark" in effect:
        parts.append(effect["remark"])
    for name, row in effect["parameter"].items():
        if other := row.get("replaced_by"):
            parts.append(f"{name} is ignored unless {other} is 0")
    return "; ".join(parts)


def describe_effects() -> list[str]:
    """Return the rows of tse_describe_effects()."""
    rows = []
    for i, e in read("effects").items():
        early = e.get("early", {"title": "", "below": 0.0})
        rows += [
            f"{{ {quote(i)}, {quote(e['hook'])}, {quote(e['title'])},",
            f"  {quote(e['entry'])}, {quote(e['channels'])},",
            f"  {quote(e['alike'])},",
            f"  {quote(describe_use(e))},",
            f"  TSE_EFFECT_{i}, {quote(e['filter'])}, {quote(e['occurrence'])},",
            f"  {quote(early['title'])}, {format_c(early['below'])} }},",
        ]
    return rows


def describe_settings() -> list[str]:
    """Return the rows of tse_describe_settings(), in the order of tse_config."""
    return [
        f"{{ {quote(n)}, {quote(group)}, {quote(r['filter'])}, {quote(r['replaced_by'])} }},"
        for group in CONFIG
        for n, r in read_settings(group).items()
    ]


def count_effect_numbers() -> list[str]:
    """Return the definition of TSE_EFFECT_NUMBERS: how many tse_real tse_effects has.

    They are the settings of the effects and 10 more: the mass of the car, formula_gain,
    and formula_a .. formula_h (8 constants of the user's formula).
    """
    return [f"#define TSE_EFFECT_NUMBERS {len(read_settings('effects')) + 10}"]


def list_effect_parameters() -> Iterator[str]:
    """Yield the lines of the macro EFFECT_PARAMETERS, the list of all effect parameters.

    One argument of each row is the role: 1 for a strength, which switches the effect off
    if it is 0; 0 for a shape, e.g. a frequency; -1 for a shape that is never fitted."""
    roles = {"STRENGTH": 1, "SHAPE": 0, "GIVEN": -1}
    rows = [
        f"ROW(REAL, {r['effect']}, {n.removeprefix(r['effect'] + '_')}, {format_c(r['default'])}, "
        f"{format_c(r['exact'])}, {format_c(r['least'])}, "
        f"{format_c(r['most'])}, {quote(r['unit'])}, {quote(r['text'])}, "
        f"{roles[r['role']]}, {r['sign']}, "
        f"{', '.join(format_c(x) for x in (*r['typical'], r['negligible']))})"
        for n, r in read_settings("effects").items()
    ]
    yield from format_macro("EFFECT_PARAMETERS(ROW, REAL)", rows)


def list_hooks(*hooks: str) -> list[str]:
    """Return the definition of a macro EFFECTS_<HOOK> for each hook.

    A hook is a place in the model at which functions of effects are called. The macro
    lists the effects whose functions are called there."""
    rows = read("effects")
    return [
        f"#define EFFECTS_{h}(X)" + "".join(f" X({i})" for i, e in rows.items() if e["hook"] == h)
        for h in hooks
    ]


def define_formula_limits() -> list[str]:
    """Return the C constants that limit the size of a formula, as definitions of macros.

    They are the max numbers of operations, values on the stack, memories and delays, and
    the number of constants."""
    table = read("formula")
    numbers = sum(r["kind"] == "NUMBER" for r in table["operation"].values())
    rows = {n: (r["value"], r["text"]) for n, r in table["limit"].items()}
    rows["TSE_FORMULA_NUMBERS"] = (
        numbers,
        "number of settings formula_a, formula_b ... for the constants of a formula",
    )
    return [f"#define {f'{n} {value}':<24} /* {what} */" for n, (value, what) in rows.items()]


def describe_limits() -> list[str]:
    """Return the rows of tse_describe(TSE_STRUCT_FORMULA_LIMIT): name, value and meaning
    of each limit of the size of a formula, such as the max number of operations."""
    return describe_codes(
        {n.removeprefix("TSE_"): {"code": r["value"], **r} for n, r in read("formula")["limit"].items()}
    )


def list_operations() -> Iterator[str]:
    """Yield the lines of the macro FORMULA_OPERATIONS, the list of the operations that a
    formula can use.

    Its arguments are macros, one for each kind of operation. A row is a call of the macro
    of its kind: KIND(name, code, number of operands, unit, text)."""
    rows = read("formula")["operation"].items()
    yield from format_macro(
        "FORMULA_OPERATIONS(NUMBER, SIGNAL, PLAIN, MEMORY)",
        (
            f"{r['kind']}({n}, {r['code']}, {r['takes']}, {quote(r['unit'])}, {quote(r['text'])})"
            for n, r in rows
        ),
    )


# ---- simulator, replay


def read_truths() -> list[tuple[str, str, str, Row]]:
    """Return the columns with the true values of a simulated drive.

    A recorded log has no such columns. For each column, return the group and the name of
    the column, the member of tse_sim_output with the value, and the table row that
    describes the column (unit, text, kind)."""
    rows = [(t["group"], n, r) for t in read("sim_output")["truth"] for n, r in t.items() if n != "group"]
    return [(g, n, r.get("member", n), {"kind": "real", **r}) for g, n, r in rows]


# ---- variables of the FMUs


def format_macro(name: str, rows: Iterable[str]) -> Iterator[str]:
    """Yield the lines of a macro that lists rows, one row in a line."""
    lines = [line for row in rows for line in fold(f"  {row} \\")]
    yield f"#define {name} \\"
    yield from lines[:-1]
    yield lines[-1].removesuffix(" \\")


# Key: output that is a code. Value: its enumeration type in the FMU
ENUMERATIONS = {"status": "Status", "change_kind": "ChangeKind", "fault_channel": "FaultChannel"}


def format_output(name: str, r: Row) -> str:
    """Return the row of an output for the macro OUTPUTS, which lists all outputs.

    A row is a call of a macro, such as FLAG(name, member, text). The kind of the output
    (number, flag, code, stiffness, reason) selects the macro and its arguments."""
    head, says = f"{name}, {r['member']}", quote(r["text"])
    of, _, index = r["member"].partition("[")
    if r["kind"] == "reason":
        name = name.removesuffix("_valid")
        valid = "grip_valid" if name == "grip" else f"valid[{index}"
        return (
            f"REASON({name}, {r['member']}, {valid}, "
            f"{quote('the grip' if name == 'grip' else 'the stiffness')})"
        )
    if r["kind"] == "stiffness":
        place = of.removeprefix("stiffness").removeprefix("_") or "mean"
        return f"STIFFNESS({head}, {place}[{index}, {quote(r['unit'])}, {says})"
    if r["kind"] == "real":
        return f"NUMBER({head}, {quote(r['unit'])}, {says})"
    return (
        f"FLAG({head}, {says})"
        if r["kind"] == "flag"
        else f"CODE({head}, {quote(ENUMERATIONS[name])}, {says})"
    )


def format_truth(group: str, name: str, place: str, r: Row) -> str:
    """Return the row of a true value of the simulated car, for the macro TRUTHS."""
    of, _, index = place.partition("[")
    if r["kind"] == "stiffness":
        si = {"stiffness": "mean_si", "drawn": "drawn_si"}[of]
        return f"STIFFNESS({group}, {name}, {place}, {si}[{index}, {quote(r['unit'])}, {quote(r['text'])})"
    return f"NUMBER({group}, {name}, {place}, {quote(r['unit'])}, {quote(r['text'])})"


def list_columns() -> Iterator[str]:
    """Yield the macros of src/tables/columns.h, each of which is a list.

    The lists are: channels of a log, inputs of the simulator, outputs of the filter, true
    values of a simulated drive, status and reason codes, start values of a replay."""

    def format_end(r: Row) -> str:
        return f"{format_c(r['least'])}, {format_c(r['most'])}, {quote(r['unit'])}, {quote(r['text'])})"

    table = read("input")
    kinds = {
        "CHANNELS": read_channels(),
        "VELOCITIES": table["velocity"],
        "PEDALS": table["pedal"],
        "ROADS": table["road"],
    }
    for name, rows in kinds.items():
        yield from format_macro(
            f"{name}(ROW)",
            (f"ROW({r['name']}, {int(r.get('kind') == 'drives')}, {format_end(r)}" for r in rows),
        )
    driver = read_settings("sim_input").items()
    yield from format_macro(
        "DRIVER(ROW)", (f"ROW({n}, {format_c(r['default'])}, {format_end(r)}" for n, r in driver)
    )
    yield from format_macro(
        "OUTPUTS(NUMBER, FLAG, CODE, STIFFNESS, REASON)",
        (format_output(n, r) for n, r in read_outputs().items()),
    )
    yield from format_macro("TRUTHS(NUMBER, STIFFNESS)", (format_truth(*x) for x in read_truths()))
    for name, codes_of in (("STATUSES", "status"), ("REASON_CODES", "reason")):
        rows = read("status")[codes_of].items()
        yield from format_macro(
            f"{name}(ROW)", (f"ROW({n}, {quote(r.get('word', n))}, {quote(r['text'])})" for n, r in rows)
        )
    start_rows = read("replay")["start"].items()
    yield from format_macro(
        "REPLAY_START(ROW)",
        (
            f"ROW({n}, {format_c(r['default'])}, {quote(r['unit'])}, {quote(r['text'])})"
            for n, r in start_rows
        ),
    )
    why = " ".join(f"{r['code']} {r['word']}," for r in read("status")["reason"].values())
    yield f"#define REASONS {quote(why + ' see documentation')}"


def list_changes() -> list[str]:
    """Return names and meanings of the codes of tse_output.change_kind, in code order."""
    return [f"{{ {quote(r['word'])}, {quote(r['text'])} }}," for r in read("output")["change"].values()]


DEFINITION = re.compile(  # definition of a non-static function or array in a C file
    r"^(?!static|typedef|#|\s|TSE_INLINE)[a-z][\w *]*?\b(\w+)(?:\([^;{}]*\)\s*\{|\[[^\]]*\] = \{)", re.M
)


def define_internal_names() -> Iterator[str]:
    """Yield macros that add a prefix to internal names, so that they cannot collide with
    names of the program into which the library is linked.

    Internal names are those of functions and arrays of src that are neither static nor
    part of the API.
    """
    for folder in sorted(p for p in (ROOT / "src").iterdir() if p.is_dir() and p.name != "number"):
        texts = [path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.c"))]
        names = sorted({m[1] for text in texts for m in DEFINITION.finditer(text)})
        internal = [name for name in names if not name.startswith("tse_")]
        if internal:
            yield f"/* {folder.name} */"
            yield from (f"#define {name} TSE_NAME(tse_{name})" for name in internal)


REGIONS: dict[
    str, Callable[[], Iterable[str]]
] = {  # key: NAME of a generated part of a C file; value: function that returns the lines of the part
    "settings_lists": list_settings,
    "output_members": list_output_members,
    "hashed_outputs": list_hashed_outputs,
    "constants": list_constants,
    "config_groups": list_config_groups,
    "effect_numbers": count_effect_numbers,
    "effect_parameters": list_effect_parameters,
    "formula_operations": list_operations,
    "internal_names": define_internal_names,
    "columns": list_columns,
    "changes": list_changes,
    # a log row
    "input_channels": lambda: list_inputs(
        read_channels(), {"drives": "else refused", "measured": "else missing"}
    ),
    "input_optional": lambda: list_inputs(read_optional(), {"": "otherwise missing"}),
    "channel_places": lambda: [f"TSE_CHANNEL_{r['name']}," for r in read_channels()],
    "optional_places": lambda: [f"TSE_OPTIONAL_{r['name']}," for r in read_optional()],
    "missing_bits": lambda: [
        f"#define TSE_MISSING_{r['name']} (1u << TSE_CHANNEL_{r['name']})" for r in read_channels()
    ],
    "given_bits": lambda: [
        f"#define TSE_GIVEN_{r['name']} (1u << TSE_OPTIONAL_{r['name']})" for r in read_optional()
    ],
    # outputs, status
    "regimes": lambda: [f"{f'TSE_REGIME_{n},':<21} /* {t} */" for n, t in read("output")["regime"].items()],
    "status_codes": lambda: list_codes("status"),
    "reason_codes": lambda: list_codes("reason"),
    # settings
    "config_members": lambda: list_members(read_config(), "tse_setting"),
    "considered": lambda: [
        f"TSE_CONSIDER_{r['place']}," for r in read_settings("uncertainty").values() if "place" in r
    ],
    "vehicle_names": lambda: pack_lines(f'"{n}",' for n in read_settings("vehicle")),
    "uncertainty_names": lambda: pack_lines(f'"{n}",' for n in read_settings("uncertainty")),
    "sensor_names": lambda: pack_lines(f'"{n}",' for n in read_settings("sensors")),
    "car_class": lambda: [
        f"#define CLASS_{n.upper()} {r['value']} /* [{r['unit']}] {r['text']} */"
        for n, r in read("uncalibrated")["class"].items()
    ],
    "copies": lambda: pack_lines(
        row for group in CONFIG if group != "velocity" for row in list_copies(group)
    ),
    "velocity_copies": lambda: pack_lines(list_copies("velocity")),
    "exact": lambda: pack_lines(
        f"SET({n}, {format_c(r['exact'])})," for n, r in read_config().items() if r["exact"] != r["default"]
    ),
    # effects, formula
    "effect_places": lambda: pack_lines(f"TSE_EFFECT_{i}," for i in read("effects")),
    "effect_members": lambda: pack_lines(f"{n}," for n in read_settings("effects")),
    "effects_described": describe_effects,
    "settings_described": describe_settings,
    "constant_effects": lambda: list_hooks("CONSTANT"),
    "acting_effects": lambda: list_hooks("INPUT", "SLIP", "LAG", "STIFFNESS", "GRIP", "BODY", "SENSOR"),
    "formula_limits": define_formula_limits,
    "formula_limits_described": describe_limits,
    "formula_places": lambda: pack_lines(
        f"PLACE_{n} = {r['code']}," for n, r in read("formula")["place"].items()
    ),
    "formula_places_described": lambda: describe_codes(read("formula")["place"]),
    # simulator, replay
    "sim_members": lambda: list_members(read_settings("sim"), "tse_setting"),
    "sim_input_members": lambda: list_members(read_settings("sim_input"), "tse_real"),
    "sim_output_members": lambda: [
        format_member(
            "tse_real", n + (f"[{r['count']}]" if "count" in r else ""), f"[{r['unit']}] {r['text']}", 29
        )
        for n, r in read("sim_output")["member"].items()
    ],
    "replay_log_members": lambda: [
        format_member(
            "const tse_real", "*" + n, f"[{r['unit']}] {'' if r['needed'] else 'or NULL; '}{r['text']}", 35
        )
        for n, r in read("replay")["log"].items()
    ],
    "replay_start_members": lambda: [
        format_member("tse_real", n, f"[{r['unit']}] {format_short(r['default'])}; {r['text']}", 30)
        for n, r in read("replay")["start"].items()
    ],
    "replay_out_members": lambda: [
        format_member("tse_real", "*" + n, f"[{r['unit']}] {r['text']}", 30)
        for n, r in read("replay")["out"].items()
    ],
    "replay_log_described": lambda: [
        format_field("tse_replay_log", n, "p" if r["needed"] else "o", n, NO_RANGE, r["unit"], r["text"])
        for n, r in read("replay")["log"].items()
    ],
    "replay_out_described": lambda: [
        format_field("tse_replay_out", n, "o", n, NO_RANGE, r["unit"], r["text"])
        for n, r in read("replay")["out"].items()
    ],
}


MAX_COLUMNS = 110
REMARK = re.compile(r"(.*\S)(\s+)/\* (.*) \*/$")


def fold_remark(code: str, gap: str, remark: str) -> list[str]:
    """Return the lines of `code` with `remark` as a comment at its end.

    A long comment continues in the lines below."""
    column = len(code) + len(gap)
    first, *rest = textwrap.wrap(remark, MAX_COLUMNS - column - 6, break_long_words=False)
    lines = [f"{code}{gap}/* {first}", *(f"{' ' * column} * {part}" for part in rest)]
    return [*lines[:-1], lines[-1] + " */"]


def split_text(word: str, room: int) -> list[str]:
    """Split a C string literal of more than `room` characters into several literals.

    The C compiler joins adjacent literals. A shorter literal, or a word that is no
    literal, is returned unchanged."""
    if not word.startswith('"') or len(word) <= room:
        return [word]
    end = word.rindex('"')
    parts = textwrap.wrap(word[1:end], room - 4, break_long_words=False, drop_whitespace=False)
    return [f'"{part}"' for part in parts[:-1]] + [f'"{parts[-1]}"{word[end + 1 :]}']


def fold_row(line: str) -> list[str]:
    """Return a row of a generated table as several lines, broken between words.

    If the row is part of a macro, each line ends with a backslash."""
    is_macro = line.endswith(" \\")
    body = line.removesuffix(" \\")
    indent = " " * (len(body) - len(body.lstrip()) + 4)
    room = MAX_COLUMNS - 2 - len(indent)
    words = re.findall(r'(?:"(?:\\.|[^"\\])*"|[^\s"])+', body)
    lines = [indent[4:]]
    for word in (part for whole in words for part in split_text(whole, room)):
        if len(lines[-1]) + 1 + len(word) > MAX_COLUMNS - 2:
            lines.append(indent)
        lines[-1] += word if not lines[-1].strip() else f" {word}"
    if body.lstrip().startswith("#define"):
        return [*(f"{x} \\" for x in lines[:-1]), lines[-1]]
    return [f"{x} \\" for x in lines] if is_macro else lines


def fold(line: str) -> list[str]:
    """Return a generated line as lines of at most MAX_COLUMNS."""
    if len(line) <= MAX_COLUMNS:
        return [line]
    if m := REMARK.match(line):
        return fold_remark(m[1], m[2], m[3])
    return fold_row(line)


def fill_tables(source: str) -> str:
    """Return the text of a C file in which all generated parts are written again."""

    def put(m: re.Match[str]) -> str:
        indent = m[1][: m[1].index("/")]
        made = (f"{'' if x.startswith('#') else indent}{x}".replace("\0", " ") for x in REGIONS[m[2]]())
        return m[1] + "".join(f"{line}\n" for x in made for line in fold(x)) + m[3]

    return REGION.sub(put, source)


def main() -> int:
    """Write the generated parts of all files, or check that they are up to date."""
    parser = argparse.ArgumentParser(
        description="Generate the parts of C sources and headers that repeat src/tables/*.toml."
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help="change nothing; fail if a part is out of date, and name its file",
    )
    check = parser.parse_args().check
    status = 0
    for path in sorted(p for pattern in SOURCES for p in ROOT.glob(pattern)):
        there = path.read_text(encoding="utf-8")
        if "clang-format off: table " not in there or (new := fill_tables(there)) == there:
            continue
        if check:
            print(
                f"tables: {path.relative_to(ROOT)} differs from src/tables: run scripts/dev/tables.py",
                file=sys.stderr,
            )
            status = 1
        else:
            path.write_text(new, encoding="utf-8")
    return status


if __name__ == "__main__":
    sys.exit(main())
