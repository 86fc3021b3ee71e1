#!/usr/bin/env python3
"""Write what C sources and headers have of the tables in src/tables/*.toml: structs,
enumerations, rows.

scripts/dev/tables.py            write
scripts/dev/tables.py --check    change nothing; fails, and names the files, where something would be

A file says where: between `// clang-format off: table NAME` and `// clang-format on: end of table`
stands what REGIONS has of that name.
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
SECTIONS = dict.fromkeys(
    ("sensors", "latency", "velocity", "pedals", "road"), "sensors"
)  # table: file that has it beside others
SECTIONS |= dict.fromkeys(("sim", "sim_input", "sim_output"), "sim")
NO_RANGE = "0.0, 1.0, -1.0"
# End of the text of a setting, by its column `filter`, in tables with settings of both
# filters.
ONLY_IN = ("vehicle", "sensors", "filter")
ONLY = {"default": "; default filter", "paper": "; paper's filter"}
# Begin of the text about an effect, by its column `filter`.
USES = {
    "both": "both filters use it",
    "default": "the default filter uses it, the paper's does not",
    "none": "no filter uses it, simulator and replay do",
}
Row = dict[str, Any]


def read(name: str) -> Row:
    """Return a table as it is in its file."""
    table = tomllib.loads((ROOT / "src" / "tables" / f"{file_of(name)}.toml").read_text(encoding="utf-8"))
    return table[name] if name in SECTIONS else table


def file_of(name: str) -> str:
    """Return the file of src/tables that has a table, less its end."""
    return SECTIONS.get(name, name)


def settings(name: str) -> dict[str, Row]:
    """Return the settings of a table by their names: defaults, ranges, units, texts.

    default: of tse_config_default(), an ordinary car; exact: of tse_config_exact(), a car
    that is known exactly; filter: the filters whose estimate the setting moves, "both"
    unless the row states another.
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


def config() -> dict[str, Row]:
    """Return all settings of tse_config, in its order."""
    return {n: row for table in CONFIG for n, row in settings(table).items()}


def c(x: float | int | str) -> str:
    """Return a number, or an expression, as C has it."""
    return x if isinstance(x, str) else repr(x)


def start(row: Row, of: str = "default") -> str:
    """Return the default, which is the most where a build allows no more. of: exact: of a
    car that is known exactly.
    """
    default, most = c(row[of]), c(row["most"])
    return f"{default} < {most} ? {default} : {most}" if isinstance(row["most"], str) else default


def short(x: float | int | str) -> str:
    """Return a number for people."""
    return x if isinstance(x, str) else f"{x:.10g}"


def text(x: str) -> str:
    return json.dumps(x, ensure_ascii=False)


def packed(parts: Iterable[str]) -> list[str]:
    """Return parts one behind the other, in lines of 106 columns."""
    return textwrap.wrap(
        " ".join(p.replace(" ", "\0") for p in parts), 106, break_long_words=False, break_on_hyphens=False
    )


def member(kind: str, name: str, about: str, width: int) -> str:
    """Return a member with what one has to know of it on the same line."""
    return f"{f'{kind} {name};':<{width}} /* {about} */"


def about(row: Row) -> str:
    """Return what one has to know of a setting, for its comment."""
    unit = "" if row.get("whole") else f"[{row['unit']}] "
    numbers = f"{short(row['default'])}, {short(row['least'])} .. {short(row['most'])}"
    return f"{unit}{numbers}; {row['text']}"


def struct(rows: dict[str, Row], real: str) -> list[str]:
    return [
        member("int32_t" if r.get("whole") else real, n, about(r), 45 if real == "tse_setting" else 28)
        for n, r in rows.items()
    ]


def field(of: str, name: str, kind: str, place: str, numbers: str, unit: str, says: str) -> str:
    """Return a row of tse_describe()."""
    return (
        f"{{ {text(name)}, '{kind}', (int32_t)offsetof({of}, {place}), {numbers}, {text(unit)}, "
        f"{text(says)} }},"
    )


def fmu_name(group: str, name: str) -> str:
    """Return the name of a setting among the parameters of an FMU."""
    return f"{ {'formula': 'effects', 'sim': 'simulation'}.get(group, group) }.{name}"


def settings_lists() -> Iterator[str]:
    """Yield a list of settings for each of their tables; that of the effects is made of
    their parameters.
    """
    for group in (*(g for g in CONFIG if g != "effects"), "sim"):
        rows = [
            f"{'WHOLE' if r['whole'] else 'REAL'}({text(fmu_name(group, n))}, {n}, {start(r)}, "
            f"{start(r, 'exact')}, "
            f"{c(r['least'])}, {c(r['most'])}, {text(r['unit'])}, {text(r['text'])})"
            for n, r in settings(group).items()
        ]
        yield from listed(f"SETTINGS_{group.upper()}(REAL, WHOLE)", rows)


# ---- a log row


def channels() -> list[Row]:
    return list(read("input")["channel"])


def optional() -> list[Row]:
    table = read("input")
    return [*table["velocity"], *table["pedal"], *table["road"]]


def input_members(rows: Iterable[Row], outside: dict[str, str]) -> list[str]:
    return [
        member("tse_real", r["name"], f"[{r['unit']}] {short(r['least'])} .. {short(r['most'])}, "
               f"{outside[r.get('kind', '')]}; {r['text']}", 28)
        for r in rows
    ]  # fmt: skip


# ---- outputs, status


def outputs() -> dict[str, Row]:
    return {
        n: {"member": n, "kind": "real", "unit": "", **row} for n, row in read("output")["column"].items()
    }


def output_members() -> list[str]:
    rows = read("output")["member"]
    kinds = {n: "tse_real" if "unit" in r else "int32_t" for n, r in rows.items()}
    return [
        member(kinds[n], n + (f"[{r['count']}]" if "count" in r else ""),
               (f"[{r['unit']}] " if "unit" in r else "") + r["text"], 30)
        for n, r in rows.items()
    ]  # fmt: skip


def hashed_outputs() -> list[str]:
    """Return the outputs of the hash of a recorded drive.

    estimate_age is not among them: no channel is late in these drives.
    """
    rows = [(n, r) for n, r in outputs().items() if n != "estimate_age"]
    return [
        f"{{ {text(n)}, offsetof(tse_output, {r['member']}), "
        f"{int(r['kind'] in ('flag', 'reason', 'code'))} }},"
        for n, r in rows
    ]


def codes(table: str) -> list[str]:
    return [
        f"{n + ' = ' + str(r['code']) + ',':<29} /* {r['text']} */" for n, r in read("status")[table].items()
    ]


def coded(rows: dict[str, Row]) -> list[str]:
    return [
        f"{{ {text(r.get('word', n))}, 'c', {r['code']}, {NO_RANGE}, {text(r.get('unit', ''))}, "
        f"{text(r['text'])} }},"
        for n, r in rows.items()
    ]


# ---- settings


def constants() -> list[str]:
    rows = [(n, r) for section in read("constants").values() for n, r in section.items()]
    return [
        f"#define {n + ' TSE_R(' + c(r['value']) + ')':<32} /* [{r['unit']}] {r['why']} */" for n, r in rows
    ]


def config_groups() -> list[str]:
    """Return the start and the count of the rows of some tables among those of their
    kind.
    """
    parts = []
    reals = [n for n, r in config().items() if not r["whole"]]
    wholes = [n for n, r in config().items() if r["whole"]]
    for group in ("vehicle", "latency", "effects", "formula"):
        own = [n for n, r in settings(group).items() if not r["whole"]]
        parts += [f"FIRST_{group.upper()} = {reals.index(own[0])},", f"COUNT_{group.upper()} = {len(own)},"]
    own = [n for n, r in settings("formula").items() if r["whole"]]
    return packed(
        [*parts, f"FIRST_WHOLE_FORMULA = {wholes.index(own[0])},", f"COUNT_WHOLE_FORMULA = {len(own)},"]
    )


def copied(group: str) -> Iterator[str]:
    """Yield the constants that a setting of a table is as it is."""
    for name, row in settings(group).items():
        constant = row.get("constant", [])
        yield from (f"COPY({x}, {name})," for x in ([constant] if isinstance(constant, str) else constant))


# ---- effects, formula


def estimator_text(effect: Row) -> str:
    """Return the sentence about the use of an effect by the filters."""
    parts = [USES[effect["filter"]]]
    if "remark" in effect:
        parts.append(effect["remark"])
    for name, row in effect["parameter"].items():
        if other := row.get("replaced_by"):
            parts.append(f"{name} counts only while {other} is 0")
    return "; ".join(parts)


def described_effects() -> list[str]:
    """Return the rows of tse_describe_effects()."""
    rows = []
    for i, e in read("effects").items():
        early = e.get("early", {"title": "", "below": 0.0})
        rows += [
            f"{{ {text(i)}, {text(e['hook'])}, {text(e['title'])},",
            f"  {text(e['entry'])}, {text(e['channels'])},",
            f"  {text(e['alike'])},",
            f"  {text(estimator_text(e))},",
            f"  TSE_EFFECT_{i}, {text(e['filter'])}, {text(e['occurrence'])},",
            f"  {text(early['title'])}, {c(early['below'])} }},",
        ]
    return rows


def described_settings() -> list[str]:
    """Return the rows of tse_describe_settings(), in the order of tse_config."""
    return [
        f"{{ {text(n)}, {text(group)}, {text(r['filter'])}, {text(r['replaced_by'])} }},"
        for group in CONFIG
        for n, r in settings(group).items()
    ]


def effect_numbers() -> list[str]:
    """Return the count of tse_real of struct tse_effects, as a constant of C.

    It holds the settings of the effects and ten numbers of mass and formula.
    """
    return [f"#define TSE_EFFECT_NUMBERS {len(settings('effects')) + 10}"]


def effect_parameters() -> Iterator[str]:
    roles = {"STRENGTH": 1, "SHAPE": 0, "GIVEN": -1}
    rows = [
        f"ROW(REAL, {r['effect']}, {n.removeprefix(r['effect'] + '_')}, {c(r['default'])}, "
        f"{c(r['exact'])}, {c(r['least'])}, "
        f"{c(r['most'])}, {text(r['unit'])}, {text(r['text'])}, "
        f"{roles[r['role']]}, {r['sign']}, {', '.join(c(x) for x in (*r['typical'], r['negligible']))})"
        for n, r in settings("effects").items()
    ]
    yield from listed("EFFECT_PARAMETERS(ROW, REAL)", rows)


def hooked(*hooks: str) -> list[str]:
    rows = read("effects")
    return [
        f"#define EFFECTS_{h}(X)" + "".join(f" X({i})" for i, e in rows.items() if e["hook"] == h)
        for h in hooks
    ]


def formula_limits() -> list[str]:
    """Return the limits of a formula and the count of its numbers, as constants of C."""
    table = read("formula")
    numbers = sum(r["kind"] == "NUMBER" for r in table["operation"].values())
    rows = {n: (r["value"], r["text"]) for n, r in table["limit"].items()}
    rows["TSE_FORMULA_NUMBERS"] = (numbers, "numbers, formula_a ..")
    return [f"#define {f'{n} {value}':<24} /* {what} */" for n, (value, what) in rows.items()]


def described_limits() -> list[str]:
    """Return the rows of TSE_STRUCT_FORMULA_LIMIT."""
    return coded(
        {n.removeprefix("TSE_"): {"code": r["value"], **r} for n, r in read("formula")["limit"].items()}
    )


def formula_operations() -> Iterator[str]:
    rows = read("formula")["operation"].items()
    yield from listed(
        "FORMULA_OPERATIONS(NUMBER, SIGNAL, PLAIN, MEMORY)",
        (
            f"{r['kind']}({n}, {r['code']}, {r['takes']}, {text(r['unit'])}, {text(r['text'])})"
            for n, r in rows
        ),
    )


# ---- simulator, replay


def truths() -> list[tuple[str, str, str, Row]]:
    """Return group, name, member and row of what a simulated row has besides what the car
    logs.
    """
    rows = [(t["group"], n, r) for t in read("sim_output")["truth"] for n, r in t.items() if n != "group"]
    return [(g, n, r.get("member", n), {"kind": "real", **r}) for g, n, r in rows]


# ---- variables of the FMUs


def listed(name: str, rows: Iterable[str]) -> Iterator[str]:
    """Yield a list as a macro, a row a line."""
    lines = [line for row in rows for line in fold(f"  {row} \\")]
    yield f"#define {name} \\"
    yield from lines[:-1]
    yield lines[-1].removesuffix(" \\")


ENUMERATIONS = {
    "status": "Status",
    "change_kind": "ChangeKind",
    "fault_channel": "FaultChannel",
}  # of outputs with codes


def output_row(name: str, r: Row) -> str:
    """Return the row of an output: how an FMU has it depends on its kind."""
    head, says = f"{name}, {r['member']}", text(r["text"])
    of, _, index = r["member"].partition("[")
    if r["kind"] == "reason":
        name = name.removesuffix("_valid")
        valid = "grip_valid" if name == "grip" else f"valid[{index}"
        return (
            f"REASON({name}, {r['member']}, {valid}, "
            f"{text('the grip' if name == 'grip' else 'the stiffness')})"
        )
    if r["kind"] == "stiffness":
        place = of.removeprefix("stiffness").removeprefix("_") or "mean"
        return f"STIFFNESS({head}, {place}[{index}, {text(r['unit'])}, {says})"
    if r["kind"] == "real":
        return f"NUMBER({head}, {text(r['unit'])}, {says})"
    return (
        f"FLAG({head}, {says})"
        if r["kind"] == "flag"
        else f"CODE({head}, {text(ENUMERATIONS[name])}, {says})"
    )


def truth_row(group: str, name: str, place: str, r: Row) -> str:
    """Return the row of a column of the simulator that is none of the log."""
    of, _, index = place.partition("[")
    if r["kind"] == "stiffness":
        si = {"stiffness": "mean_si", "drawn": "drawn_si"}[of]
        return f"STIFFNESS({group}, {name}, {place}, {si}[{index}, {text(r['unit'])}, {text(r['text'])})"
    return f"NUMBER({group}, {name}, {place}, {text(r['unit'])}, {text(r['text'])})"


def columns() -> Iterator[str]:
    """Yield a list for each kind of channel and output."""

    def ends(r: Row) -> str:
        return f"{c(r['least'])}, {c(r['most'])}, {text(r['unit'])}, {text(r['text'])})"

    table = read("input")
    kinds = {
        "CHANNELS": channels(),
        "VELOCITIES": table["velocity"],
        "PEDALS": table["pedal"],
        "ROADS": table["road"],
    }
    for name, rows in kinds.items():
        yield from listed(
            f"{name}(ROW)", (f"ROW({r['name']}, {int(r.get('kind') == 'drives')}, {ends(r)}" for r in rows)
        )
    driver = settings("sim_input").items()
    yield from listed("DRIVER(ROW)", (f"ROW({n}, {c(r['default'])}, {ends(r)}" for n, r in driver))
    yield from listed(
        "OUTPUTS(NUMBER, FLAG, CODE, STIFFNESS, REASON)", (output_row(n, r) for n, r in outputs().items())
    )
    yield from listed("TRUTHS(NUMBER, STIFFNESS)", (truth_row(*x) for x in truths()))
    for name, codes_of in (("STATUSES", "status"), ("REASON_CODES", "reason")):
        rows = read("status")[codes_of].items()
        yield from listed(
            f"{name}(ROW)", (f"ROW({n}, {text(r.get('word', n))}, {text(r['text'])})" for n, r in rows)
        )
    start_rows = read("replay")["start"].items()
    yield from listed(
        "REPLAY_START(ROW)",
        (f"ROW({n}, {c(r['default'])}, {text(r['unit'])}, {text(r['text'])})" for n, r in start_rows),
    )
    why = " ".join(f"{r['code']} {r['word']}," for r in read("status")["reason"].values())
    yield f"#define REASONS {text(why + ' see documentation')}"


def changes() -> list[str]:
    """Return word and meaning of what may have changed, by their codes."""
    return [f"{{ {text(r['word'])}, {text(r['text'])} }}," for r in read("output")["change"].values()]


DEFINITION = re.compile(  # of a function or an array that other files may use
    r"^(?!static|typedef|#|\s|TSE_INLINE)[a-z][\w *]*?\b(\w+)(?:\([^;{}]*\)\s*\{|\[[^\]]*\] = \{)", re.M
)


def internal_names() -> Iterator[str]:
    """Name what several files of src share and is no part of the API, by folder."""
    for folder in sorted(p for p in (ROOT / "src").iterdir() if p.is_dir() and p.name != "number"):
        texts = [path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.c"))]
        names = sorted({m[1] for text in texts for m in DEFINITION.finditer(text)})
        internal = [name for name in names if not name.startswith("tse_")]
        if internal:
            yield f"/* {folder.name} */"
            yield from (f"#define {name} TSE_NAME(tse_{name})" for name in internal)


REGIONS: dict[str, Callable[[], Iterable[str]]] = {  # name of a region: its lines
    "settings_lists": settings_lists,
    "output_members": output_members,
    "hashed_outputs": hashed_outputs,
    "constants": constants,
    "config_groups": config_groups,
    "effect_numbers": effect_numbers,
    "effect_parameters": effect_parameters,
    "formula_operations": formula_operations,
    "internal_names": internal_names,
    "columns": columns,
    "changes": changes,
    # a log row
    "input_channels": lambda: input_members(
        channels(), {"drives": "else refused", "measured": "else missing"}
    ),
    "input_optional": lambda: input_members(optional(), {"": "else not there"}),
    "channel_places": lambda: [f"TSE_CHANNEL_{r['name']}," for r in channels()],
    "optional_places": lambda: [f"TSE_OPTIONAL_{r['name']}," for r in optional()],
    "missing_bits": lambda: [
        f"#define TSE_MISSING_{r['name']} (1u << TSE_CHANNEL_{r['name']})" for r in channels()
    ],
    "given_bits": lambda: [
        f"#define TSE_GIVEN_{r['name']} (1u << TSE_OPTIONAL_{r['name']})" for r in optional()
    ],
    # outputs, status
    "regimes": lambda: [f"{f'TSE_REGIME_{n},':<21} /* {t} */" for n, t in read("output")["regime"].items()],
    "status_codes": lambda: codes("status"),
    "reason_codes": lambda: codes("reason"),
    # settings
    "config_members": lambda: struct(config(), "tse_setting"),
    "considered": lambda: [
        f"TSE_CONSIDER_{r['place']}," for r in settings("uncertainty").values() if "place" in r
    ],
    "vehicle_names": lambda: packed(f'"{n}",' for n in settings("vehicle")),
    "uncertainty_names": lambda: packed(f'"{n}",' for n in settings("uncertainty")),
    "sensor_names": lambda: packed(f'"{n}",' for n in settings("sensors")),
    "car_class": lambda: [
        f"#define CLASS_{n.upper()} {r['value']} /* [{r['unit']}] {r['text']} */"
        for n, r in read("uncalibrated")["class"].items()
    ],
    "copies": lambda: packed(row for group in CONFIG if group != "velocity" for row in copied(group)),
    "velocity_copies": lambda: packed(copied("velocity")),
    "exact": lambda: packed(
        f"SET({n}, {c(r['exact'])})," for n, r in config().items() if r["exact"] != r["default"]
    ),
    # effects, formula
    "effect_places": lambda: packed(f"TSE_EFFECT_{i}," for i in read("effects")),
    "effect_members": lambda: packed(f"{n}," for n in settings("effects")),
    "effects_described": described_effects,
    "settings_described": described_settings,
    "constant_effects": lambda: hooked("CONSTANT"),
    "acting_effects": lambda: hooked("INPUT", "SLIP", "LAG", "STIFFNESS", "GRIP", "BODY", "SENSOR"),
    "formula_limits": formula_limits,
    "formula_limits_described": described_limits,
    "formula_places": lambda: packed(
        f"PLACE_{n} = {r['code']}," for n, r in read("formula")["place"].items()
    ),
    "formula_places_described": lambda: coded(read("formula")["place"]),
    # simulator, replay
    "sim_members": lambda: struct(settings("sim"), "tse_setting"),
    "sim_input_members": lambda: struct(settings("sim_input"), "tse_real"),
    "sim_output_members": lambda: [
        member("tse_real", n + (f"[{r['count']}]" if "count" in r else ""), f"[{r['unit']}] {r['text']}", 29)
        for n, r in read("sim_output")["member"].items()
    ],
    "replay_log_members": lambda: [
        member(
            "const tse_real", "*" + n, f"[{r['unit']}] {'' if r['needed'] else 'or NULL; '}{r['text']}", 35
        )
        for n, r in read("replay")["log"].items()
    ],
    "replay_start_members": lambda: [
        member("tse_real", n, f"[{r['unit']}] {short(r['default'])}; {r['text']}", 30)
        for n, r in read("replay")["start"].items()
    ],
    "replay_out_members": lambda: [
        member("tse_real", "*" + n, f"[{r['unit']}] {r['text']}", 30)
        for n, r in read("replay")["out"].items()
    ],
    "replay_log_described": lambda: [
        field("tse_replay_log", n, "p" if r["needed"] else "o", n, NO_RANGE, r["unit"], r["text"])
        for n, r in read("replay")["log"].items()
    ],
    "replay_out_described": lambda: [
        field("tse_replay_out", n, "o", n, NO_RANGE, r["unit"], r["text"])
        for n, r in read("replay")["out"].items()
    ],
}


MAX_COLUMNS = 110
REMARK = re.compile(r"(.*\S)(\s+)/\* (.*) \*/$")


def fold_remark(code: str, gap: str, remark: str) -> list[str]:
    """Continue a remark that is too long below itself."""
    column = len(code) + len(gap)
    first, *rest = textwrap.wrap(remark, MAX_COLUMNS - column - 6, break_long_words=False)
    lines = [f"{code}{gap}/* {first}", *(f"{' ' * column} * {part}" for part in rest)]
    return [*lines[:-1], lines[-1] + " */"]


def split_text(word: str, room: int) -> list[str]:
    """Split a C string that is longer than a line into neighbours, which C joins."""
    if not word.startswith('"') or len(word) <= room:
        return [word]
    end = word.rindex('"')
    parts = textwrap.wrap(word[1:end], room - 4, break_long_words=False, drop_whitespace=False)
    return [f'"{part}"' for part in parts[:-1]] + [f'"{parts[-1]}"{word[end + 1 :]}']


def fold_row(line: str) -> list[str]:
    """Break a row of a table between its parts; a macro continues by backslashes."""
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
    """Return a generated line in lines of at most MAX_COLUMNS."""
    if len(line) <= MAX_COLUMNS:
        return [line]
    if m := REMARK.match(line):
        return fold_remark(m[1], m[2], m[3])
    return fold_row(line)


def filled(source: str) -> str:
    """Return a source or header with its tables as they are now."""

    def put(m: re.Match[str]) -> str:
        indent = m[1][: m[1].index("/")]
        made = (f"{'' if x.startswith('#') else indent}{x}".replace("\0", " ") for x in REGIONS[m[2]]())
        return m[1] + "".join(f"{line}\n" for x in made for line in fold(x)) + m[3]

    return REGION.sub(put, source)


def main() -> int:
    parser = argparse.ArgumentParser(
        description="Write what C sources and headers have of the tables in src/tables."
    )
    parser.add_argument("--check", action="store_true", help="change nothing; fail where something would be")
    check = parser.parse_args().check
    status = 0
    for path in sorted(p for pattern in SOURCES for p in ROOT.glob(pattern)):
        there = path.read_text(encoding="utf-8")
        if "clang-format off: table " not in there or (new := filled(there)) == there:
            continue
        if check:
            print(
                f"tables: {path.relative_to(ROOT)} is not what src/tables says: scripts/dev/tables.py",
                file=sys.stderr,
            )
            status = 1
        else:
            path.write_text(new, encoding="utf-8")
    return status


if __name__ == "__main__":
    sys.exit(main())
