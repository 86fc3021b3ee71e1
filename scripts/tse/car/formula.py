"""A formula of the user: one effect that no catalogue has, as a place in the model, an expression and its numbers. Read from
text, checked, and turned into the settings formula_* (src/tables/formula.toml), into numbers over a log, or into C."""

from __future__ import annotations

import ast
import functools
import json
import keyword
import math
import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tse.library.core import CONFIG, library
from tse.library.errors import UserError, meant
from tse.library.files import atomic, read_toml
from tse.log.units import registry

MOST_VALUE = 1e6  # a larger result, and what is no number, counts as 0
PER_CODE = 3  # operations in one formula_code_<k>, a byte each, the lowest first
# Of the text. Longer or deeper ones fit no program, and are refused before Python's parser or the recursion here sees them.
MOST_TEXT = 400
MOST_NESTING = 20
MOST_POWER = 4
MOST_UNIT = 40  # characters

OPERATORS = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Div: "div"}
LITERALS = {1.0: "one", 2.0: "two"}
WRITTEN = {
    "add": "x + y",
    "sub": "x - y",
    "mul": "x * y",
    "div": "x / y",
    "neg": "-x",
    "one": "1",
    "two": "2",
}
# Units of the operands after the first, of operations whose unit column is `first`; x is the unit of the first.
OPERANDS = {"lag": ("s",), "second": ("1/s", "1"), "late": ("s",), "play": ("x",), "limit": ("x/s",)}
UNIT = re.compile(r"((1|[A-Za-z]+[1-9]?( [A-Za-z]+[1-9]?)*)(/[A-Za-z]+[1-9]?)*)?")
KEYS = ("id", "title", "place", "formula", "gain", "numbers", "found")
NUMBER_KEYS = ("value", "sd", "unit", "text")
UNIT_STYLE = 'units are written as in rad, m/s2, rad s2/m, kg m2, 1/s, Hz; "1" is a number without one'


class FormulaError(UserError):
    """A formula that is refused. The text names key, what is wrong and what is allowed; parse() and read_formula() put the file
    before it."""


def _limit_of(name: str) -> int:
    """Return a limit of a formula, [limit] of src/tables/formula.toml."""
    return library().formula_limits[name]


@dataclass(frozen=True)
class Number:
    """One number of a formula, in its own unit. sd: how well it is known, None where nobody says."""

    name: str
    value: float
    unit: str
    sd: float | None = None
    text: str = ""


@dataclass(frozen=True)
class Formula:
    """A formula, checked when it is made: one that is refused raises FormulaError. `text` is the expression as written; `found`
    are facts that tselab wrote to the file: strings, numbers and lists of them, not interpreted."""

    id: str
    title: str
    place: str
    text: str
    numbers: tuple[Number, ...]
    gain: float = 1.0
    found: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "numbers", tuple(self.numbers))
        if not re.fullmatch(r"[a-z][a-z0-9_]*", self.id):
            raise FormulaError(f"key id: {self.id!r} is not a name; allowed: a-z, then a-z, 0-9 and _")
        if not self.title.strip():
            raise FormulaError("key title: is empty; allowed: a line of text")
        places = library().formula_places
        if self.place not in places:
            raise FormulaError(f"key place: there is no place '{self.place}'{_hint(self.place, places)}")
        _check_range("key gain", "formula_gain", self.gain)
        _check_numbers(self.numbers)
        program = self._program
        if unused := [n.name for n in self.numbers if n.name not in program.named]:
            raise FormulaError(f"key numbers.{unused[0]}: the formula '{self.text}' does not use it")
        for name, setting in self.slots.items():
            _check_range(f"key numbers.{name}.value", setting, self._values[name])
        for letter, value in zip(_letters()[len(program.named) :], program.constants, strict=False):
            _check_range("key formula", f"formula_{letter}", value)
        object.__setattr__(
            self, "found", {str(key): _plain(value, f"key found.{key}") for key, value in self.found.items()}
        )

    @property
    def _program(self) -> _Program:
        return _program(
            self.text,
            library().formula_places[self.place].unit,
            tuple((n.name, n.unit) for n in self.numbers),
        )

    @property
    def _values(self) -> dict[str, float]:
        return {n.name: n.value for n in self.numbers}

    @property
    def operations(self) -> tuple[int, ...]:
        """The program: codes of FORMULA_OP, postfix."""
        table = library().formula_ops
        return tuple(table[op].code for op in self._program.operations)

    @property
    def constants(self) -> tuple[float, ...]:
        """Literals of the text but 1 and 2; they take the slots after those of the numbers."""
        return self._program.constants

    @property
    def slots(self) -> dict[str, str]:
        """Number -> the setting that holds it: in order of first appearance."""
        return {
            name: f"formula_{letter}" for name, letter in zip(self._program.named, _letters(), strict=False)
        }

    def settings(self) -> dict[str, float]:
        """All settings formula_* by name; slots and codes that the formula does not need are 0."""
        slots = [self._values[name] for name in self._program.named] + list(self.constants)
        settings = {
            "formula_gain": float(self.gain),
            "formula_place": float(library().formula_places[self.place].offset),
        }
        for i, letter in enumerate(_letters()):
            settings[f"formula_{letter}"] = float(slots[i]) if i < len(slots) else 0.0
        for k in range(_limit_of("FORMULA_OPS") // PER_CODE):
            codes = self.operations[PER_CODE * k : PER_CODE * (k + 1)]
            settings[f"formula_code_{k + 1}"] = float(int.from_bytes(bytes(codes), "little"))
        return settings

    def with_values(self, values: Mapping[str, float]) -> Formula:
        """The same formula with other values of some numbers, in their units. FormulaError: no such number, its range."""
        if unknown := [name for name in values if name not in self._values]:
            raise FormulaError(f"there is no number '{unknown[0]}'{_hint(unknown[0], self._values)}")
        return replace(
            self, numbers=tuple(replace(n, value=float(values.get(n.name, n.value))) for n in self.numbers)
        )

    def evaluate(self, signals: Mapping[str, np.ndarray], dt: float | np.ndarray) -> np.ndarray:
        """What the formula adds at its place, gain included, in the unit of the place; shape (rows,).

        signals: those the formula uses, by their names in FORMULA_OP, shape (rows,). dt: s from the row before, one for all or
        shape (rows,), of which the first is not used. The reference of what the library does; memories start at rest at the
        first row. KeyError: a signal that the formula uses is not given. ValueError: shapes that do not go together."""
        rows = max([np.size(dt), *(np.size(values) for values in signals.values())])
        h = np.broadcast_to(np.asarray(dt, float), (rows,)).copy()
        h[:1] = 0.0
        numbers = [self._values[name] for name in self._program.named] + list(self.constants)
        slots = dict(zip(_letters(), numbers, strict=False))
        table = library().formula_ops
        stack: list[np.ndarray] = []
        for op in self._program.operations:
            if op in slots:
                value: Any = slots[op]
            elif table[op].kind == "SIGNAL":
                value = signals[op]
            else:
                takes = table[op].takes
                operands = [stack.pop() for _ in range(takes)][::-1]
                value = PLAIN[op](*operands) if op in PLAIN else MEMORY[op](h, *operands)
            stack.append(np.broadcast_to(np.asarray(value, float), (rows,)))
        return self.gain * np.where(np.abs(stack[0]) < MOST_VALUE, stack[0], 0.0)


def parse(
    id: str,
    title: str,
    place: str,
    text: str,
    numbers: Iterable[Number] = (),
    gain: float = 1.0,
    source: str = "formula",
) -> Formula:
    """A formula from its parts. FormulaError, with `source` before its text: whatever is wrong with it."""
    try:
        return Formula(id, title, place, text, tuple(numbers), gain)
    except FormulaError as error:
        raise FormulaError(f"{source}: {error}") from None


def read_formula(path: Path) -> Formula:
    """Read a formula's file. UserError: it cannot be read, or is refused."""
    path = Path(path)
    data = read_toml(path)
    try:
        _check_keys(data, KEYS, "")
        numbers = tuple(_number(name, table) for name, table in _entry(data, "numbers", dict, "", {}).items())
        id, title, place, text = (_entry(data, key, str, "") for key in ("id", "title", "place", "formula"))
        gain, found = _entry(data, "gain", float, "", 1.0), _entry(data, "found", dict, "", {})
        return Formula(id, title, place, text, numbers, gain, found)
    except FormulaError as error:
        raise FormulaError(f"{path}: {error}") from None


def write_formula(path: Path, formula: Formula) -> None:
    """Write the file that read_formula() reads. UserError: it cannot be written."""
    with atomic(Path(path)) as file:
        file.write(toml_text(formula))


def toml_text(formula: Formula) -> str:
    """The text of the formula's file, with units in comments."""
    place = library().formula_places[formula.place]
    lines = [
        f"id = {_toml(formula.id)}",
        f"title = {_toml(formula.title)}",
        f"place = {_toml(formula.place)}  # {place.unit}: {place.text}",
        f"formula = {_toml(formula.text)}",
        f"gain = {_toml(float(formula.gain))}  # times the formula",
    ]
    for n in formula.numbers:
        comment = f"  # {n.unit}" if n.unit not in ("", "1") else ""
        lines += ["", f"[numbers.{n.name}]", f"value = {_toml(float(n.value))}{comment}"]
        lines += [] if n.sd is None else [f"sd = {_toml(float(n.sd))}{comment}"]
        lines += [f"unit = {_toml(n.unit)}"] + ([f"text = {_toml(n.text)}"] if n.text else [])
    if formula.found:
        lines += ["", "[found]  # written by tselab, not interpreted"]
        lines += [
            f"{key if re.fullmatch('[A-Za-z0-9_-]+', key) else _toml(key)} = {_toml(v)}"
            for key, v in formula.found.items()
        ]
    return "\n".join(lines) + "\n"


def c_header(formula: Formula) -> str:
    """The formula as a C99 header, compiled into the library in place of the interpreter. Its numbers stay settings."""
    program, table = formula._program, library().formula_ops
    place = library().formula_places[formula.place]
    letters = _letters()
    names = dict(zip(letters, (*program.named, *(repr(c) for c in program.constants)), strict=False))
    numbers = {n.name: n for n in formula.numbers}
    comment = [
        f"{formula.id} - {formula.title}",
        "",
        f"{formula.text}   added at {place.name} [{place.unit}]",
    ]
    for name, setting in formula.slots.items():
        n = numbers[name]
        comment.append(
            f"{name} [{n.unit or '1'}] is {setting}, {float(n.value)!r} when written{': ' + n.text if n.text else ''}"
        )
    for letter, value in zip(letters[len(program.named) :], program.constants, strict=False):
        comment.append(f"{value!r} is formula_{letter}")
    comment += ["", "Written by tselab, not by hand."]
    lines: list[str] = []
    stack: list[str] = []
    for i, op in enumerate(program.operations):
        if op in names:
            call = f"formula_number(f, {letters.index(op)}); /* {_comment(names[op])} */"
        else:
            takes = table[op].takes
            operands = stack[len(stack) - takes :]
            del stack[len(stack) - takes :]
            call = f"formula_{op}({', '.join(operands if table[op].kind == 'PLAIN' else ['f', *operands])});"
        lines.append(f"  const tse_real t{i} = {call}")
        stack.append(f"t{i}")
    guard = f"TSE_FORMULA_{formula.id.upper()}_H"
    return "\n".join(
        [
            "/* " + "\n".join(f" * {_comment(line)}".rstrip() for line in comment)[3:] + " */",
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            f"#define TSE_FORMULA_PLACE {place.offset} /* {place.name} */",
            f'#define TSE_FORMULA_ID "{formula.id}"',
            "",
            "static inline tse_real formula_program(formula_run *f)",
            "{",
            *lines,
            f"  return {stack[0]};",
            "}",
            "",
            "#endif",
            "",
        ]
    )


# Text -> program.


@dataclass(frozen=True)
class _Program:
    """Names of operations, postfix, where a number is the letter of its slot; numbers in slot order, then constants."""

    operations: tuple[str, ...]
    named: tuple[str, ...]
    constants: tuple[float, ...]


@functools.lru_cache(
    maxsize=1024
)  # every property of a Formula asks for it, and searches change nothing but values
def _program(text: str, place_unit: str, numbers: tuple[tuple[str, str], ...]) -> _Program:
    """The program of a text, its dimensions checked. numbers: (name, unit). FormulaError: what is refused."""
    units: dict[str, Any] = {}
    for name, unit in numbers:
        try:
            units[name] = _dimension(unit)
        except FormulaError as error:
            raise FormulaError(f"key numbers.{name}.unit: {error}") from None
    node = _parse_text(text)
    compiler = _Compiler(text, units)
    result = compiler.visit(node, 1)
    if result != _dimension(place_unit):
        raise compiler.wrong(
            node, f"has the unit {_unit_text(result)}, the place has {place_unit}" + _literal_advice(node)
        )
    named = tuple(dict.fromkeys(s for s in compiler.steps if s in units))
    constants = tuple(dict.fromkeys(s for s in compiler.steps if isinstance(s, float)))
    slots, letters = [*named, *constants], _letters()
    if len(slots) > len(letters):
        listed = ", ".join([*named, *(f"{c:g}" for c in constants)])
        raise FormulaError(
            f"key formula: needs {len(slots)} numbers ({listed}), {len(letters)} are allowed, literals but 1 and 2 count"
        )
    letter = dict(zip(slots, letters, strict=False))
    return _Program(tuple(str(letter.get(s, s)) for s in compiler.steps), named, constants)


def _parse_text(text: str) -> ast.expr:
    """The tree of a text; what cannot be a formula, or could hurt the parser, is refused before it."""
    if len(text) > MOST_TEXT:
        raise FormulaError(f"key formula: has {len(text)} characters, {MOST_TEXT} are allowed")
    if strange := re.search(
        r"[^A-Za-z0-9_+\-*/()., ]", text
    ):  # ASCII only: Python takes other letters for their look-alikes
        raise FormulaError(
            f"key formula: column {strange.start() + 1}: {strange[0]!r} is not allowed; {_allowed()}"
        )
    depth = 0
    for i, c in enumerate(text):
        depth += (c == "(") - (c == ")")
        if depth > MOST_NESTING:
            raise FormulaError(
                f"key formula: column {i + 1}: nested deeper than {MOST_NESTING}, the most allowed"
            )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what it says of `1(x)` is said better below
            return ast.parse(text.lstrip(" "), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        column = (getattr(error, "offset", None) or 1) + _indent(text)
        what = error.msg if isinstance(error, SyntaxError) else "cannot be parsed"
        raise FormulaError(f"key formula: column {column}: {what}; {_allowed()}") from None


class _Compiler:
    """Walks a tree: writes operations to `steps`, where numbers stand by name and literals by value; returns dimensions."""

    def __init__(self, text: str, units: Mapping[str, Any]):
        self.text = text
        self.units = units
        self.table = library().formula_ops
        self.steps: list[str | float] = []
        self.depth = 0

    def wrong(self, node: ast.AST, what: str) -> FormulaError:
        start = getattr(node, "col_offset", 0) + _indent(self.text)
        end = getattr(node, "end_col_offset", len(self.text)) + _indent(self.text)
        part = self.text[start:end]
        return FormulaError(
            f"key formula: column {start + 1}: '{part[:60]}{'...' * (len(part) > 60)}' {what}"
        )

    def emit(self, node: ast.AST, step: str | float, takes: int = 0) -> None:
        """One operation more. Checked at once: powers of powers would grow without end."""
        self.steps.append(step)
        self.depth += 1 - takes
        memories = [
            s
            for s in self.steps
            if s not in self.units and s in self.table and self.table[s].kind == "MEMORY"
        ]
        if len(self.steps) > _limit_of("FORMULA_OPS"):
            raise self.wrong(
                node,
                f"is beyond the {_limit_of('FORMULA_OPS')} operations that are allowed (powers count as products)",
            )
        if self.depth > _limit_of("FORMULA_STACK"):
            raise self.wrong(
                node,
                f"needs more than the {_limit_of('FORMULA_STACK')} values in hand that are allowed: put long terms first",
            )
        if len(memories) > _limit_of("FORMULA_MEMORIES"):
            listed = ", ".join(op.name for op in self.table.values() if op.kind == "MEMORY")
            raise self.wrong(
                node, f"is beyond the {_limit_of('FORMULA_MEMORIES')} that are allowed of {listed} together"
            )
        if memories.count("late") > _limit_of("FORMULA_LATE"):
            raise self.wrong(node, f"is beyond the {_limit_of('FORMULA_LATE')} 'late' that is allowed")

    def visit(self, node: ast.expr, level: int) -> Any:
        """Write the operations of this part of the text. Returned: its dimension."""
        if level > MOST_NESTING:
            raise self.wrong(
                node, f"is nested deeper than {MOST_NESTING}, the most allowed; a sum of n terms counts as n"
            )
        if isinstance(node, ast.Constant):
            return self.literal(node)
        if isinstance(node, ast.Name):
            return self.name(node)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return self.operation(node, "neg", [node.operand], level)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            return self.power(node, level)
        if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
            return self.operation(node, OPERATORS[type(node.op)], [node.left, node.right], level)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            name = node.func.id
            if name in WRITTEN and name in self.table:
                raise self.wrong(node, f"is not allowed: {name} is written as {WRITTEN[name]}")
            if name not in _callable():
                raise self.wrong(node.func, f"is not an operation{meant(name, _callable())}; {_allowed()}")
            takes = self.table[name].takes
            if node.keywords or len(node.args) != takes:
                operands = ", ".join("xyz"[:takes])
                raise self.wrong(node, f"is not {name}({operands}): {self.table[name].text}")
            return self.operation(node, name, node.args, level)
        raise self.wrong(node, f"is not allowed; {_allowed()}")

    def literal(self, node: ast.Constant) -> Any:
        if isinstance(node.value, bool) or not isinstance(node.value, (int, float)):
            raise self.wrong(node, f"is not allowed; {_allowed()}")
        try:
            value = float(node.value)
        except OverflowError:
            value = math.inf
        if not math.isfinite(value):
            raise self.wrong(node, "is not a finite number")
        self.emit(node, LITERALS.get(value, value))
        return _dimension("1")

    def name(self, node: ast.Name) -> Any:
        if node.id in self.units:
            self.emit(node, node.id)
            return self.units[node.id]
        if node.id in _signals():
            self.emit(node, node.id)
            return _dimension(self.table[node.id].unit)
        known = [*_signals(), *self.units]
        own = f"numbers of the file: {', '.join(self.units) or 'none'}"
        raise self.wrong(
            node,
            f"is neither a signal nor a number of the file{meant(node.id, known)}; signals: {', '.join(_signals())}; {own}",
        )

    def power(self, node: ast.BinOp, level: int) -> Any:
        times = node.right.value if isinstance(node.right, ast.Constant) else None
        if type(times) is not int or not 1 <= times <= MOST_POWER:
            raise self.wrong(node.right, f"is not a whole power; allowed: 1 .. {MOST_POWER}")
        unit = result = self.visit(node.left, level + 1)
        for _ in range(times - 1):
            self.visit(node.left, level + 1)
            self.emit(node, "mul", 2)
            result = result * unit
        return result

    def operation(self, node: ast.expr, op: str, operands: list[ast.expr], level: int) -> Any:
        units = [self.visit(operand, level + 1) for operand in operands]
        self.emit(node, op, len(operands))
        rule, first = self.table[op].unit, units[0]
        if rule == "same":
            self.agree(node, operands, units, [first] * len(units))
        elif rule == "product":
            return first * units[1]
        elif rule == "quotient":
            return first / units[1]
        elif rule == "root":
            return first**0.5
        elif rule == "rate":
            return first / _dimension("s")
        elif rule == "first":
            own = {"x": first, "x/s": first / _dimension("s")}
            rest = [own[u] if u in own else _dimension(u) for u in OPERANDS[op]]
            self.agree(node, operands, units, [first, *rest])
        else:  # of a unit, and so are its operands: soft
            self.agree(node, operands, units, [_dimension(rule)] * len(units))
            return _dimension(rule)
        return first

    def agree(self, node: ast.AST, operands: list[ast.expr], units: list[Any], needed: list[Any]) -> None:
        """Refuse an operand whose unit is not the one that is needed."""
        for operand, unit, need in zip(operands, units, needed, strict=True):
            if unit != need:
                part = ast.get_source_segment(self.text.lstrip(" "), operand)
                fit = f"does not fit: '{part}' has the unit {_unit_text(unit)}, needed is {_unit_text(need)}"
                raise self.wrong(node, fit + _literal_advice(*operands))


# Units.


@functools.lru_cache(maxsize=1024)
def _dimension(unit: str) -> Any:
    """The dimension of a unit as the tables write it, rad being none: `rad s2/m` is rad*s**2/m. FormulaError: pint does not
    know it, or it is not one of the model's: numbers are used as they stand, so that 0.1 deg would be 0.1 rad."""
    if len(unit) > MOST_UNIT or not UNIT.fullmatch(unit):
        raise FormulaError(f"{unit[:MOST_UNIT]!r} is not a unit; {UNIT_STYLE}; after each / stands one name")
    expression = re.sub(r"(?<=[A-Za-z])(?=[1-9])", "**", unit or "1").replace(" ", "*")
    try:
        quantity = (1.0 * registry().parse_expression(expression)) * registry().dimensionless
        base = quantity.to_base_units()
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError):
        raise FormulaError(f"{unit!r} is not a unit that is known; {UNIT_STYLE}") from None
    if not math.isclose(base.magnitude, 1.0):
        same = _unit_text(base.dimensionality) if base.dimensionality else "rad or 1"
        raise FormulaError(
            f"{unit!r} is {base.magnitude:.6g} of the unit that the model counts in; write the number in {same}"
        )
    return base.dimensionality


def _unit_text(dimension: Any) -> str:
    """A dimension in the notation of the tables: m/s2."""
    base = {"[length]": "m", "[time]": "s", "[mass]": "kg", "[temperature]": "K", "[current]": "A"}
    powers = {base.get(name, name): power for name, power in sorted(dimension.items())}
    parts = {name: name + ("" if abs(p) == 1 else f"{abs(p):g}") for name, p in powers.items()}
    top, below = [parts[n] for n in parts if powers[n] > 0], [parts[n] for n in parts if powers[n] < 0]
    return "/".join([" ".join(top) or "1", *below])


# Checks of the parts, and the tables.


def _letters() -> list[str]:
    return [op.name for op in library().formula_ops.values() if op.kind == "NUMBER"]


def _signals() -> list[str]:
    return [op.name for op in library().formula_ops.values() if op.kind == "SIGNAL"]


def _callable() -> list[str]:
    return [
        op.name
        for op in library().formula_ops.values()
        if op.kind in ("PLAIN", "MEMORY") and op.name not in WRITTEN
    ]


def _allowed() -> str:
    return (
        f"allowed: + - * /, -x, x**1 .. x**{MOST_POWER}, ( ), numbers, names of [numbers], signals ({', '.join(_signals())}), "
        f"operations ({', '.join(_callable())})"
    )


def _literal_advice(*parts: ast.expr) -> str:
    """What to do, where a part is of literals alone."""
    if all(any(isinstance(node, ast.Name) for node in ast.walk(part)) for part in parts):
        return ""
    return "; a literal has no unit: make it a number of the file, [numbers.<name>], that has one"


def _indent(text: str) -> int:
    return len(text) - len(text.lstrip(" "))


def _hint(name: str, known: Iterable[str]) -> str:
    """What could be meant; else all that is known."""
    known = list(known)
    return meant(name, known, other=f"; allowed: {', '.join(known) or 'none'}")


def _check_range(what: str, setting: str, value: float) -> None:
    f = library().field(CONFIG, setting)
    if not math.isfinite(value) or not f.low <= value <= f.high:
        raise FormulaError(
            f"{what}: {value!r} is outside the range of {setting}; allowed: {f.low:g} .. {f.high:g}"
        )


def _check_numbers(numbers: tuple[Number, ...]) -> None:
    table = library().formula_ops
    for n in numbers:
        key = f"key numbers.{n.name}"
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", n.name) or keyword.iskeyword(n.name):
            raise FormulaError(
                f"{key}: is not a name; allowed: a letter, then letters, digits and _, and no word of Python"
            )
        if n.name in table:  # a .. h, too: whoever sets formula_b should not have to ask which b that is
            text = table[n.name].text
            raise FormulaError(f"{key}: the name is taken ({table[n.name].kind.lower()}: {text}); allowed: any that is not in "
                               f"{', '.join(table)}")  # fmt: skip
        if [m.name for m in numbers].count(n.name) > 1:
            raise FormulaError(f"{key}: is there twice")
        if n.sd is not None and not 0 <= n.sd < math.inf:
            raise FormulaError(f"{key}.sd: {n.sd!r} is not an uncertainty; allowed: 0 or more")


def _check_keys(data: Mapping[str, Any], known: tuple[str, ...], prefix: str) -> None:
    for key in data:
        if key not in known:
            raise FormulaError(f"key {prefix}{key} is not known{_hint(key, known)}")


def _entry(data: Mapping[str, Any], key: str, kind: type, prefix: str, default: Any = None) -> Any:
    """A value of a file, of this kind; a whole number is a float, too."""
    kinds = {str: "a text", float: "a number", dict: "a table"}
    value = data.get(key, default)
    if value is None:
        raise FormulaError(f"key {prefix}{key} is missing; allowed: {kinds[kind]}")
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        try:
            value = float(value)
        except OverflowError:
            value = math.inf
    if not isinstance(value, kind):
        raise FormulaError(f"key {prefix}{key}: {value!r:.40} is not {kinds[kind]}")
    return value


def _number(name: str, table: Any) -> Number:
    """A table [numbers.<name>]."""
    prefix = f"numbers.{name}."
    if not isinstance(table, dict):
        raise FormulaError(f"key numbers.{name} must be a table: [numbers.{name}] with value and unit")
    _check_keys(table, NUMBER_KEYS, prefix)
    if "unit" not in table:
        raise FormulaError(f"key {prefix}unit is missing; {UNIT_STYLE}")
    sd = _entry(table, "sd", float, prefix) if "sd" in table else None
    value, unit = _entry(table, "value", float, prefix), _entry(table, "unit", str, prefix)
    return Number(name, value, unit, sd, _entry(table, "text", str, prefix, ""))


def _plain(value: Any, what: str, level: int = 0) -> Any:
    """A fact as Python has it without numpy."""
    if isinstance(value, (np.generic, np.ndarray)):
        value = value.tolist()
    if isinstance(value, (list, tuple)) and level < 4:
        return [_plain(v, what, level + 1) for v in value]
    if not isinstance(value, (str, bool, int, float)):
        raise FormulaError(f"{what}: {value!r:.40} cannot be kept; allowed: texts, numbers, lists of them")
    return value


def _toml(value: Any) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _comment(text: str) -> str:
    """A line that can stand in a comment of C: it neither closes it nor opens one, and goes on in no other line."""
    line = "".join(c if c.isprintable() and c != "\\" else " " for c in text).replace("??", "? ?")
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)", " ", line)


# Program -> numbers: operations on arrays of one value a row.


def _ratio(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.divide(x, y, out=np.zeros(len(x)), where=y != 0)


PLAIN: dict[str, Callable[..., Any]] = {
    "one": lambda: 1.0,
    "two": lambda: 2.0,
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": _ratio,
    "neg": np.negative,
    "abs": np.abs,
    "max": np.maximum,
    "min": np.minimum,
    "sqrt": lambda x: np.sqrt(np.maximum(x, 0.0)),
    "soft": lambda x: x / np.hypot(1.0, x),
}


def _by_row(function: Callable[..., list[float]]) -> Callable[..., list[float]]:
    """Called with arrays, works on lists: loops over them are several times faster."""
    return functools.wraps(function)(lambda *arrays: function(*(a.tolist() for a in arrays)))


@_by_row
def _lag(h: list[float], x: list[float], time: list[float]) -> list[float]:
    """First order by the trapezoidal rule; one faster than the rows becomes the mean of two."""
    y = [x[0]]
    for i in range(1, len(x)):
        t = max(time[i], 0.5 * h[i])
        k = 0.5 * h[i] / t if t > 0 else 0.0
        y.append((y[-1] * (1 - k) + k * (x[i - 1] + x[i])) / (1 + k))
    return y


@_by_row
def _second(h: list[float], a: list[float], frequency: list[float], damping: list[float]) -> list[float]:
    """mode_step() of src/model/laws.h."""
    x, v = a[0], 0.0
    y = [x]
    for i in range(1, len(a)):
        if h[i] > 0:
            wh = 2 * math.pi * max(frequency[i], 0.0) * h[i]
            drag, spring = max(damping[i], 0.0) * wh, 0.25 * wh * wh
            push = wh * wh * (0.5 * (a[i - 1] + a[i]) - x) / h[i]
            was, v = v, (v * (1 - drag - spring) + push) / (1 + drag + spring)
            x += 0.5 * h[i] * (was + v)
        y.append(x)
    return y


def _late(h: np.ndarray, x: np.ndarray, delay: np.ndarray) -> np.ndarray:
    """np.interp holds the first value before the start."""
    time = np.cumsum(h)
    return np.interp(time - np.maximum(delay, 0.0), time, x)


@_by_row
def _play(h: list[float], x: list[float], half: list[float]) -> list[float]:
    y = [x[0]]
    for i in range(1, len(x)):
        y.append(min(max(y[-1], x[i] - abs(half[i])), x[i] + abs(half[i])))
    return y


@_by_row
def _limit(h: list[float], x: list[float], most: list[float]) -> list[float]:
    y = [x[0]]
    for i in range(1, len(x)):
        step = abs(most[i]) * h[i]
        y.append(min(max(x[i], y[-1] - step), y[-1] + step))
    return y


@_by_row
def _rate(h: list[float], x: list[float]) -> list[float]:
    y = [0.0]
    for i in range(1, len(x)):
        y.append((x[i] - x[i - 1]) / h[i] if h[i] > 0 else y[-1])
    return y


MEMORY: dict[str, Callable[..., Any]] = {
    "lag": _lag,
    "second": _second,
    "late": _late,
    "play": _play,
    "limit": _limit,
    "rate": _rate,
}
