"""Read a formula of the user. Convert it to settings or C, or evaluate it for a log.

A formula describes an effect that is missing in the catalogue of effects. It adds the
value of an expression to a quantity of the vehicle model, e.g. to the front slip angle.
This quantity is called the place of the formula. The expression may contain numbers with
names. The expression is checked and compiled to a program: a list of operations in
postfix order. The program is stored in the settings formula_code_<k>. Each number is
stored in one of the settings formula_a, formula_b, ... (src/tables/formula.toml). This
setting is called the slot of the number.
"""

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
from tse.library.errors import UserError, suggest_names
from tse.library.files import read_toml, write_atomically
from tse.log.units import load_units

MAX_FORMULA_VALUE = 1e6  # a result of this magnitude or more, or NaN, is replaced by 0
# Number of operations of the program that one setting formula_code_<k> holds. Each
# operation is a byte, and the first operation is the lowest byte. The setting is an
# int32_t, which four bytes could make negative.
PER_CODE = 3
# Limits of the expression. They protect Python's parser and the recursion in _Compiler.
MAX_TEXT = 400  # [characters] max length
MAX_NESTING = 20  # max depth of nested parts
MAX_POWER = 4  # max exponent
MAX_UNIT = 40  # [characters] max length of a unit

OPERATORS = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Div: "div"}
# literal -> operation that yields this value. These literals therefore need no slot, i.e.
# none of the settings formula_a, formula_b, ... that hold the numbers of a formula.
LITERALS = {1.0: "one", 2.0: "two"}
# operation -> its notation. An expression must not call these operations by name.
WRITTEN_AS = {
    "add": "x + y",
    "sub": "x - y",
    "mul": "x * y",
    "div": "x / y",
    "neg": "-x",
    "one": "1",
    "two": "2",
}
# Operation -> units of its second and further operands, in this order. The first operand
# may have any unit, and the result has the same unit (unit = "first" in
# src/tables/formula.toml). In the units of the other operands, "x" stands for the unit of
# the first operand: the second operand of limit(angle, rate) is in rad/s if angle is in
# rad.
OPERANDS = {"lag": ("s",), "second": ("1/s", "1"), "late": ("s",), "play": ("x",), "limit": ("x/s",)}
UNIT = re.compile(r"((1|[A-Za-z]+[1-9]?( [A-Za-z]+[1-9]?)*)(/[A-Za-z]+[1-9]?)*)?")
FORMULA_KEYS = ("id", "title", "place", "formula", "gain", "numbers", "found")
NUMBER_KEYS = ("value", "sd", "unit", "text")
UNIT_STYLE = 'units are written as in rad, m/s2, rad s2/m, kg m2, 1/s, Hz; "1" is a number without one'


class FormulaError(UserError):
    """A formula is invalid. The message states the key of the formula file that is wrong,
    the error and the allowed values.

    parse() and read_formula() put the name of the file before the message.
    """


def _get_limit(name: str) -> int:
    """Return a limit of formulas, from the table [limit] of src/tables/formula.toml."""
    return library().formula_limits[name]


@dataclass(frozen=True)
class Number:
    """A named number of a formula. `value` and `sd` are in `unit`. `sd` None: unknown."""

    name: str
    value: float
    unit: str
    sd: float | None = None
    text: str = ""


@dataclass(frozen=True)
class Formula:
    """A formula. It is checked when it is created.

    Attributes
    ----------
    id, title
        Name and heading.
    place
        Name of the quantity of the model to which the value of the formula is added, e.g.
        front_angle, the front slip angle (table [place] of src/tables/formula.toml).
    text
        Expression as the user wrote it.
    numbers
        Numbers that the expression uses by name.
    gain
        Factor of the whole formula.
    found
        Results that tselab wrote to the file: strings, numbers, and lists of these. They
        are written to the file again, but are not used.

    Raises
    ------
    FormulaError
        A part is invalid.
    """

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
            raise FormulaError(
                f"key place: there is no place '{self.place}'{_suggest_name(self.place, places)}"
            )
        _check_range("key gain", "formula_gain", self.gain)
        _check_numbers(self.numbers)
        program = self._program
        if unused := [n.name for n in self.numbers if n.name not in program.named]:
            raise FormulaError(f"key numbers.{unused[0]}: the formula '{self.text}' does not use it")
        for name, setting in self.slots.items():
            _check_range(f"key numbers.{name}.value", setting, self._values[name])
        for letter, value in zip(_list_letters()[len(program.named) :], program.constants, strict=False):
            _check_range("key formula", f"formula_{letter}", value)
        object.__setattr__(
            self,
            "found",
            {str(key): _convert_fact(value, f"key found.{key}") for key, value in self.found.items()},
        )

    @property
    def _program(self) -> _Program:
        """The program that is compiled from the expression."""
        return _compile_program(
            self.text,
            library().formula_places[self.place].unit,
            tuple((n.name, n.unit) for n in self.numbers),
        )

    @property
    def _values(self) -> dict[str, float]:
        """Value of each number, by name."""
        return {n.name: n.value for n in self.numbers}

    @property
    def operations(self) -> tuple[int, ...]:
        """The program: the code of each operation (src/tables/formula.toml), in postfix
        order."""
        table = library().formula_ops
        return tuple(table[op].code for op in self._program.operations)

    @property
    def constants(self) -> tuple[float, ...]:
        """Literals in the expression, except 1 and 2, which have operations of their own.

        The library reads these literals from the settings formula_<letter> (slots) that
        follow those of the named numbers."""
        return self._program.constants

    @property
    def slots(self) -> dict[str, str]:
        """Name of a number -> setting formula_<letter> that holds its value (slot), in
        the order in which the numbers first appear in the expression."""
        return {
            name: f"formula_{letter}"
            for name, letter in zip(self._program.named, _list_letters(), strict=False)
        }

    def settings(self) -> dict[str, float]:
        """Return all settings formula_* by name. Those that the formula does not use are
        0."""
        slots = [self._values[name] for name in self._program.named] + list(self.constants)
        settings = {
            "formula_gain": float(self.gain),
            "formula_place": float(library().formula_places[self.place].offset),
        }
        for i, letter in enumerate(_list_letters()):
            settings[f"formula_{letter}"] = float(slots[i]) if i < len(slots) else 0.0
        for k in range(_get_limit("FORMULA_OPS") // PER_CODE):
            codes = self.operations[PER_CODE * k : PER_CODE * (k + 1)]
            settings[f"formula_code_{k + 1}"] = float(int.from_bytes(bytes(codes), "little"))
        return settings

    def with_values(self, values: Mapping[str, float]) -> Formula:
        """Return the formula with new values of some numbers, in their units.

        Raises
        ------
        FormulaError
            A number is unknown, or its value is outside its range.
        """
        if unknown := [name for name in values if name not in self._values]:
            raise FormulaError(f"there is no number '{unknown[0]}'{_suggest_name(unknown[0], self._values)}")
        return replace(
            self, numbers=tuple(replace(n, value=float(values.get(n.name, n.value))) for n in self.numbers)
        )

    def evaluate(self, signals: Mapping[str, np.ndarray], dt: float | np.ndarray) -> np.ndarray:
        """Evaluate the formula in each row of a log.

        Parameters
        ----------
        signals
            Values of each signal that the formula uses. Key: name of the signal, as in
            the formula. Value: array, (rows,).
        dt
            [s] time since the row before: one number for all rows, or an array, (rows,).
            The first value of the array is not used.

        Returns
        -------
        (rows,) gain x value of the expression. This is added to the quantity of the model
        that `place` names, and has its unit.

        Raises
        ------
        KeyError
            A signal is missing.
        ValueError
            Shapes do not match.

        Notes
        -----
        Tests compare the library with this implementation. Operations with memory, e.g.
        lag, start as if their input had been constant before the first row.
        """
        rows = max([np.size(dt), *(np.size(values) for values in signals.values())])
        h = np.broadcast_to(np.asarray(dt, float), (rows,)).copy()
        h[:1] = 0.0
        numbers = [self._values[name] for name in self._program.named] + list(self.constants)
        slots = dict(zip(_list_letters(), numbers, strict=False))
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
                value = (
                    PLAIN_FUNCTIONS[op](*operands)
                    if op in PLAIN_FUNCTIONS
                    else MEMORY_FUNCTIONS[op](h, *operands)
                )
            stack.append(np.broadcast_to(np.asarray(value, float), (rows,)))
        return self.gain * np.where(np.abs(stack[0]) < MAX_FORMULA_VALUE, stack[0], 0.0)


def parse(
    id: str,
    title: str,
    place: str,
    text: str,
    numbers: Iterable[Number] = (),
    gain: float = 1.0,
    source: str = "formula",
) -> Formula:
    """Make a formula from its parts.

    Raises
    ------
    FormulaError
        A part is invalid. The message begins with `source`.
    """
    try:
        return Formula(id, title, place, text, tuple(numbers), gain)
    except FormulaError as error:
        raise FormulaError(f"{source}: {error}") from None


def read_formula(path: Path) -> Formula:
    """Read the file of a formula. UserError: it cannot be read, or it is invalid."""
    path = Path(path)
    data = read_toml(path)
    try:
        _check_keys(data, FORMULA_KEYS, "")
        numbers = tuple(
            _read_number(name, table) for name, table in _read_entry(data, "numbers", dict, "", {}).items()
        )
        id, title, place, text = (
            _read_entry(data, key, str, "") for key in ("id", "title", "place", "formula")
        )
        gain, found = _read_entry(data, "gain", float, "", 1.0), _read_entry(data, "found", dict, "", {})
        return Formula(id, title, place, text, numbers, gain, found)
    except FormulaError as error:
        raise FormulaError(f"{path}: {error}") from None


def write_formula(path: Path, formula: Formula) -> None:
    """Write the file of a formula. UserError: it cannot be written."""
    with write_atomically(Path(path)) as file:
        file.write(format_toml(formula))


def format_toml(formula: Formula) -> str:
    """Return the contents of the file of a formula, with units in comments."""
    place = library().formula_places[formula.place]
    lines = [
        f"id = {_format_value(formula.id)}",
        f"title = {_format_value(formula.title)}",
        f"place = {_format_value(formula.place)}  # {place.unit}: {place.text}",
        f"formula = {_format_value(formula.text)}",
        f"gain = {_format_value(float(formula.gain))}  # times the formula",
    ]
    for n in formula.numbers:
        comment = f"  # {n.unit}" if n.unit not in ("", "1") else ""
        lines += ["", f"[numbers.{n.name}]", f"value = {_format_value(float(n.value))}{comment}"]
        lines += [] if n.sd is None else [f"sd = {_format_value(float(n.sd))}{comment}"]
        lines += [f"unit = {_format_value(n.unit)}"] + ([f"text = {_format_value(n.text)}"] if n.text else [])
    if formula.found:
        lines += ["", "[found]  # written by tselab, not interpreted"]
        lines += [
            f"{key if re.fullmatch('[A-Za-z0-9_-]+', key) else _format_value(key)} = {_format_value(v)}"
            for key, v in formula.found.items()
        ]
    return "\n".join(lines) + "\n"


def format_c_header(formula: Formula) -> str:
    """Return the formula as C99 code in a header.

    A library that is compiled with this header executes this code instead of interpreting
    the program in the settings formula_code_<k>. The numbers of the formula remain
    settings, so their values may change at run time.
    """
    program, table = formula._program, library().formula_ops
    place = library().formula_places[formula.place]
    letters = _list_letters()
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
            f"{name} [{n.unit or '1'}] is {setting}, {float(n.value)!r} when written"
            f"{': ' + n.text if n.text else ''}"
        )
    for letter, value in zip(letters[len(program.named) :], program.constants, strict=False):
        comment.append(f"{value!r} is formula_{letter}")
    comment += ["", "Written by tselab, not by hand."]
    lines: list[str] = []
    stack: list[str] = []
    for i, op in enumerate(program.operations):
        if op in names:
            call = f"formula_number(f, {letters.index(op)}); /* {_escape_comment(names[op])} */"
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
            "/* " + "\n".join(f" * {_escape_comment(line)}".rstrip() for line in comment)[3:] + " */",
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


# ---- From expression to program


@dataclass(frozen=True)
class _Program:
    """A compiled expression."""

    operations: tuple[str, ...]  # in postfix order
    named: tuple[str, ...]  # names of the numbers stored in formula_a, formula_b, ...
    constants: tuple[float, ...]  # literals, stored in the settings that follow those of `named`


# The result is cached: every property of a Formula needs the program, and a search for
# the best numbers compiles the same expression again and again.
@functools.lru_cache(maxsize=1024)
def _compile_program(text: str, place_unit: str, numbers: tuple[tuple[str, str], ...]) -> _Program:
    """Compile an expression to a program, and check its dimensions.

    `place_unit`: unit of the quantity to which the value of the expression is added; the
    expression must have the same dimension. `numbers`: (name, unit) of each number.

    Raises
    ------
    FormulaError
        The expression is invalid.
    """
    units: dict[str, Any] = {}
    for name, unit in numbers:
        try:
            units[name] = _parse_dimension(unit)
        except FormulaError as error:
            raise FormulaError(f"key numbers.{name}.unit: {error}") from None
    node = _parse_text(text)
    compiler = _Compiler(text, units)
    result = compiler.visit(node, 1)
    if result != _parse_dimension(place_unit):
        raise compiler.make_error(
            node, f"has the unit {_format_unit(result)}, the place has {place_unit}" + _advise_literal(node)
        )
    named = tuple(dict.fromkeys(s for s in compiler.steps if s in units))
    constants = tuple(dict.fromkeys(s for s in compiler.steps if isinstance(s, float)))
    slots, letters = [*named, *constants], _list_letters()
    if len(slots) > len(letters):
        listed = ", ".join([*named, *(f"{c:g}" for c in constants)])
        raise FormulaError(
            f"key formula: needs {len(slots)} numbers ({listed}), {len(letters)} are allowed; each literal "
            "other than 1 and 2 counts as a number"
        )
    letter = dict(zip(slots, letters, strict=False))
    return _Program(tuple(str(letter.get(s, s)) for s in compiler.steps), named, constants)


def _parse_text(text: str) -> ast.expr:
    """Parse an expression, after refusing strings that could overload Python's parser."""
    if len(text) > MAX_TEXT:
        raise FormulaError(f"key formula: has {len(text)} characters, {MAX_TEXT} are allowed")
    # Only ASCII is allowed. Python converts some other letters in names to ASCII letters,
    # so a name would be understood as a different name from the one in the file.
    if strange := re.search(r"[^A-Za-z0-9_+\-*/()., ]", text):
        raise FormulaError(
            f"key formula: column {strange.start() + 1}: {strange[0]!r} is not allowed; {_describe_allowed()}"
        )
    depth = 0
    for i, c in enumerate(text):
        depth += (c == "(") - (c == ")")
        if depth > MAX_NESTING:
            raise FormulaError(
                f"key formula: column {i + 1}: brackets nest deeper than the {MAX_NESTING} levels allowed"
            )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python warns of `1(x)`; the error below is clearer
            return ast.parse(text.lstrip(" "), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        column = (getattr(error, "offset", None) or 1) + _count_indent(text)
        what = error.msg if isinstance(error, SyntaxError) else "cannot be parsed"
        raise FormulaError(f"key formula: column {column}: {what}; {_describe_allowed()}") from None


class _Compiler:
    """Visitor of the syntax tree of an expression.

    Visiting a node appends the operations of the node to `steps`, and returns the
    dimension of its value. A step is the name of an operation, signal or number, or the
    value of a literal.
    """

    def __init__(self, text: str, units: Mapping[str, Any]):
        self.text = text
        self.units = units
        self.table = library().formula_ops
        self.steps: list[str | float] = []
        self.depth = 0

    def make_error(self, node: ast.AST, what: str) -> FormulaError:
        """Return an error that quotes the part of the expression at `node`."""
        start = getattr(node, "col_offset", 0) + _count_indent(self.text)
        end = getattr(node, "end_col_offset", len(self.text)) + _count_indent(self.text)
        part = self.text[start:end]
        return FormulaError(
            f"key formula: column {start + 1}: '{part[:60]}{'...' * (len(part) > 60)}' {what}"
        )

    def emit(self, node: ast.AST, step: str | float, takes: int = 0) -> None:
        """Append a step, and check that the program is within its limits: operations,
        values on the stack, operations with memory.

        `takes`: number of operands of the step; 0 for a signal, number or literal. The
        check after each step stops the compilation early: powers become products, so a
        few nested powers would give a huge program."""
        self.steps.append(step)
        self.depth += 1 - takes
        memories = [
            s
            for s in self.steps
            if s not in self.units and s in self.table and self.table[s].kind == "MEMORY"
        ]
        if len(self.steps) > _get_limit("FORMULA_OPS"):
            raise self.make_error(
                node,
                f"exceeds the {_get_limit('FORMULA_OPS')} operations that are allowed "
                "(a power counts as its products)",
            )
        if self.depth > _get_limit("FORMULA_STACK"):
            raise self.make_error(
                node,
                f"needs more than the {_get_limit('FORMULA_STACK')} intermediate values that are allowed: "
                "put long terms first",
            )
        if len(memories) > _get_limit("FORMULA_MEMORIES"):
            listed = ", ".join(op.name for op in self.table.values() if op.kind == "MEMORY")
            raise self.make_error(
                node, f"exceeds the {_get_limit('FORMULA_MEMORIES')} that are allowed of {listed} together"
            )
        if memories.count("late") > _get_limit("FORMULA_LATE"):
            raise self.make_error(
                node, f"uses 'late' more often than the limit of {_get_limit('FORMULA_LATE')}"
            )

    def visit(self, node: ast.expr, level: int) -> Any:
        """Append the operations of a part of the expression, and return its dimension.

        `level`: depth of nesting."""
        if level > MAX_NESTING:
            raise self.make_error(
                node, f"is nested deeper than the {MAX_NESTING} levels allowed; a sum of n terms has n levels"
            )
        if isinstance(node, ast.Constant):
            return self.visit_literal(node)
        if isinstance(node, ast.Name):
            return self.visit_name(node)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return self.visit_operation(node, "neg", [node.operand], level)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            return self.visit_power(node, level)
        if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
            return self.visit_operation(node, OPERATORS[type(node.op)], [node.left, node.right], level)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            name = node.func.id
            if name in WRITTEN_AS and name in self.table:
                raise self.make_error(node, f"is not allowed: {name} is written as {WRITTEN_AS[name]}")
            if name not in _list_functions():
                raise self.make_error(
                    node.func,
                    f"is not an operation{suggest_names(name, _list_functions())}; {_describe_allowed()}",
                )
            takes = self.table[name].takes
            if node.keywords or len(node.args) != takes:
                operands = ", ".join("xyz"[:takes])
                raise self.make_error(node, f"is not of the form {name}({operands}): {self.table[name].text}")
            return self.visit_operation(node, name, node.args, level)
        raise self.make_error(node, f"is not allowed; {_describe_allowed()}")

    def visit_literal(self, node: ast.Constant) -> Any:
        """Append a literal to `steps`, and return its dimension, 1."""
        if isinstance(node.value, bool) or not isinstance(node.value, (int, float)):
            raise self.make_error(node, f"is not allowed; {_describe_allowed()}")
        try:
            value = float(node.value)
        except OverflowError:
            value = math.inf
        if not math.isfinite(value):
            raise self.make_error(node, "is not a finite number")
        self.emit(node, LITERALS.get(value, value))
        return _parse_dimension("1")

    def visit_name(self, node: ast.Name) -> Any:
        """Append a number or a signal to `steps`, and return its dimension."""
        if node.id in self.units:
            self.emit(node, node.id)
            return self.units[node.id]
        if node.id in _list_signals():
            self.emit(node, node.id)
            return _parse_dimension(self.table[node.id].unit)
        known = [*_list_signals(), *self.units]
        own = f"numbers of the file: {', '.join(self.units) or 'none'}"
        raise self.make_error(
            node,
            f"is neither a signal nor a number of the file{suggest_names(node.id, known)}; "
            f"signals: {', '.join(_list_signals())}; {own}",
        )

    def visit_power(self, node: ast.BinOp, level: int) -> Any:
        """Append a power with an integer exponent to `steps`, as repeated products, and
        return the dimension of the power."""
        times = node.right.value if isinstance(node.right, ast.Constant) else None
        if type(times) is not int or not 1 <= times <= MAX_POWER:
            raise self.make_error(node.right, f"is not an integer exponent; allowed: 1 .. {MAX_POWER}")
        unit = result = self.visit(node.left, level + 1)
        for _ in range(times - 1):
            self.visit(node.left, level + 1)
            self.emit(node, "mul", 2)
            result = result * unit
        return result

    def visit_operation(self, node: ast.expr, op: str, operands: list[ast.expr], level: int) -> Any:
        """Append the operands and then the operation to `steps`. Check the units of the
        operands, and return the dimension of the result."""
        units = [self.visit(operand, level + 1) for operand in operands]
        self.emit(node, op, len(operands))
        rule, first = self.table[op].unit, units[0]
        if rule == "same":
            self.check_units(node, operands, units, [first] * len(units))
        elif rule == "product":
            return first * units[1]
        elif rule == "quotient":
            return first / units[1]
        elif rule == "root":
            return first**0.5
        elif rule == "rate":
            return first / _parse_dimension("s")
        elif rule == "first":
            own = {"x": first, "x/s": first / _parse_dimension("s")}
            rest = [own[u] if u in own else _parse_dimension(u) for u in OPERANDS[op]]
            self.check_units(node, operands, units, [first, *rest])
        else:  # the rule is a unit, which all operands and the result have: "1" for soft(x)
            self.check_units(node, operands, units, [_parse_dimension(rule)] * len(units))
            return _parse_dimension(rule)
        return first

    def check_units(
        self, node: ast.AST, operands: list[ast.expr], units: list[Any], needed: list[Any]
    ) -> None:
        """Raise an error if the units of operands differ from the needed ones."""
        for operand, unit, need in zip(operands, units, needed, strict=True):
            if unit != need:
                part = ast.get_source_segment(self.text.lstrip(" "), operand)
                has, needs = _format_unit(unit), _format_unit(need)
                fit = f"does not fit: '{part}' has the unit {has}, but {needs} is needed"
                raise self.make_error(node, fit + _advise_literal(*operands))


# ---- Units


@functools.lru_cache(maxsize=1024)
def _parse_dimension(unit: str) -> Any:
    """Return the dimension of a unit, e.g. of rad*s**2/m for the string "rad s2/m".

    rad has the dimension 1. Only coherent SI units are allowed, since values are used
    without conversion: 0.1 deg would be used as 0.1 rad.

    Raises
    ------
    FormulaError
        The unit is unknown, or is not a coherent SI unit.
    """
    if len(unit) > MAX_UNIT or not UNIT.fullmatch(unit):
        raise FormulaError(
            f"{unit[:MAX_UNIT]!r} is not a unit; {UNIT_STYLE}; "
            "one name follows each /, as in kg/m/s2 (not kg/m s2)"
        )
    expression = re.sub(r"(?<=[A-Za-z])(?=[1-9])", "**", unit or "1").replace(" ", "*")
    try:
        quantity = (1.0 * load_units().parse_expression(expression)) * load_units().dimensionless
        base = quantity.to_base_units()
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError):
        raise FormulaError(f"{unit!r} is not a known unit; {UNIT_STYLE}") from None
    if not math.isclose(base.magnitude, 1.0):
        same = _format_unit(base.dimensionality) if base.dimensionality else "rad or 1"
        raise FormulaError(
            f"{unit!r} is {base.magnitude:.6g} times the SI unit that the model uses; "
            f"write the number in {same}"
        )
    return base.dimensionality


def _format_unit(dimension: Any) -> str:
    """Return a dimension in the notation of the tables, e.g. m/s2."""
    base = {"[length]": "m", "[time]": "s", "[mass]": "kg", "[temperature]": "K", "[current]": "A"}
    powers = {base.get(name, name): power for name, power in sorted(dimension.items())}
    parts = {name: name + ("" if abs(p) == 1 else f"{abs(p):g}") for name, p in powers.items()}
    top, below = [parts[n] for n in parts if powers[n] > 0], [parts[n] for n in parts if powers[n] < 0]
    return "/".join([" ".join(top) or "1", *below])


# ---- allowed elements of a formula, and checks of its parts


def _list_letters() -> list[str]:
    """Return the letters of the settings formula_a, formula_b, ... for numbers."""
    return [op.name for op in library().formula_ops.values() if op.kind == "NUMBER"]


def _list_signals() -> list[str]:
    """Return the names of the signals that an expression may contain."""
    return [op.name for op in library().formula_ops.values() if op.kind == "SIGNAL"]


def _list_functions() -> list[str]:
    """Return the operations that an expression calls by name, such as lag(x, y)."""
    return [
        op.name
        for op in library().formula_ops.values()
        if op.kind in ("PLAIN", "MEMORY") and op.name not in WRITTEN_AS
    ]


def _describe_allowed() -> str:
    """Return what an expression may contain, for messages."""
    return (
        f"allowed: + - * /, -x, x**1 .. x**{MAX_POWER}, ( ), numbers, names of [numbers], "
        f"signals ({', '.join(_list_signals())}), operations ({', '.join(_list_functions())})"
    )


def _advise_literal(*parts: ast.expr) -> str:
    """Return the end of a message on wrong units of the operands `parts`. If an operand
    consists only of literals, return advice to replace a literal by a named number with a
    unit. Otherwise, return ""."""
    if all(any(isinstance(node, ast.Name) for node in ast.walk(part)) for part in parts):
        return ""
    return "; a literal has no unit: replace it by a name, with value and unit in [numbers.<name>]"


def _count_indent(text: str) -> int:
    """Return the number of spaces at the start of a string."""
    return len(text) - len(text.lstrip(" "))


def _suggest_name(name: str, known: Iterable[str]) -> str:
    """Return "did you mean x?" for a similar known name; without one, list all names."""
    known = list(known)
    return suggest_names(name, known, other=f"; allowed: {', '.join(known) or 'none'}")


def _check_range(what: str, setting: str, value: float) -> None:
    """Raise an error if a value is outside the range of its setting."""
    f = library().field(CONFIG, setting)
    if not math.isfinite(value) or not f.low <= value <= f.high:
        raise FormulaError(
            f"{what}: {value!r} is outside the range of {setting}; allowed: {f.low:g} .. {f.high:g}"
        )


def _check_numbers(numbers: tuple[Number, ...]) -> None:
    """Raise an error if a number has a wrong, reserved or repeated name or a wrong sd."""
    table = library().formula_ops
    for n in numbers:
        key = f"key numbers.{n.name}"
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", n.name) or keyword.iskeyword(n.name):
            raise FormulaError(
                f"{key}: is not a name; allowed: a letter, then letters, digits and _; no keyword of Python"
            )
        if n.name in table:  # includes the letters of formula_a, formula_b, ...
            text = table[n.name].text
            raise FormulaError(
                f"{key}: the name is taken ({table[n.name].kind.lower()}: {text}); "
                f"allowed: any name except {', '.join(table)}"
            )
        if [m.name for m in numbers].count(n.name) > 1:
            raise FormulaError(f"{key}: appears twice")
        if n.sd is not None and not 0 <= n.sd < math.inf:
            raise FormulaError(f"{key}.sd: {n.sd!r} is not an uncertainty; allowed: 0 or more")


def _check_keys(data: Mapping[str, Any], known: tuple[str, ...], prefix: str) -> None:
    """Raise an error if there is an unknown key."""
    for key in data:
        if key not in known:
            raise FormulaError(f"key {prefix}{key} is not known{_suggest_name(key, known)}")


def _read_entry(data: Mapping[str, Any], key: str, kind: type, prefix: str, default: Any = None) -> Any:
    """Return a value of a file; raise an error if it is missing or has a wrong type.

    An integer is converted if a float is needed. `default`: value of a missing key; None:
    the key is required."""
    kinds = {str: "a string", float: "a number", dict: "a table"}
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


def _read_number(name: str, table: Any) -> Number:
    """Read a table [numbers.<name>]."""
    prefix = f"numbers.{name}."
    if not isinstance(table, dict):
        raise FormulaError(f"key numbers.{name} must be a table: [numbers.{name}] with value and unit")
    _check_keys(table, NUMBER_KEYS, prefix)
    if "unit" not in table:
        raise FormulaError(f"key {prefix}unit is missing; {UNIT_STYLE}")
    sd = _read_entry(table, "sd", float, prefix) if "sd" in table else None
    value, unit = _read_entry(table, "value", float, prefix), _read_entry(table, "unit", str, prefix)
    return Number(name, value, unit, sd, _read_entry(table, "text", str, prefix, ""))


def _convert_fact(value: Any, what: str, level: int = 0) -> Any:
    """Return a value of Formula.found with NumPy types converted to plain Python types.

    `what`: key of the value, for the message. `level`: number of lists around the value.
    Lists may nest at most 4 deep."""
    if isinstance(value, (np.generic, np.ndarray)):
        value = value.tolist()
    if isinstance(value, (list, tuple)) and level < 4:
        return [_convert_fact(v, what, level + 1) for v in value]
    if not isinstance(value, (str, bool, int, float)):
        raise FormulaError(
            f"{what}: {value!r:.40} cannot be stored; allowed: strings, numbers, lists of them"
        )
    return value


def _format_value(value: Any) -> str:
    """Return a value in the notation of TOML."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list):
        return "[" + ", ".join(map(_format_value, value)) + "]"
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _escape_comment(text: str) -> str:
    """Return a string that is safe in a C comment: one line without /* and */."""
    line = "".join(c if c.isprintable() and c != "\\" else " " for c in text).replace("??", "? ?")
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)", " ", line)


# ---- Operations of a program, for all rows of a log at once. All arrays are (rows,).
# h: [s] time since the row before


def _divide(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return x / y, or 0 if y is 0."""
    return np.divide(x, y, out=np.zeros(len(x)), where=y != 0)


PLAIN_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "one": lambda: 1.0,
    "two": lambda: 2.0,
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": _divide,
    "neg": np.negative,
    "abs": np.abs,
    "max": np.maximum,
    "min": np.minimum,
    "sqrt": lambda x: np.sqrt(np.maximum(x, 0.0)),
    "soft": lambda x: x / np.hypot(1.0, x),
}


def _use_lists(function: Callable[..., list[float]]) -> Callable[..., list[float]]:
    """Return a function that takes arrays, converts them to lists, and calls `function`.

    A loop over the elements of a list is several times faster than a loop over an
    array."""
    return functools.wraps(function)(lambda *arrays: function(*(a.tolist() for a in arrays)))


@_use_lists
def _apply_lag(h: list[float], x: list[float], time: list[float]) -> list[float]:
    """Apply a first-order lag to `x` by the trapezoidal rule. `h`: [s] time since the row
    before. `time`: [s] time constant of the lag in each row.

    A time constant below h / 2 is replaced by h / 2. The result in a row is then the mean
    of the input in this row and in the row before.
    """
    y = [x[0]]
    for i in range(1, len(x)):
        t = max(time[i], 0.5 * h[i])
        k = 0.5 * h[i] / t if t > 0 else 0.0
        y.append((y[-1] * (1 - k) + k * (x[i - 1] + x[i])) / (1 + k))
    return y


@_use_lists
def _apply_second(
    h: list[float], a: list[float], frequency: list[float], damping: list[float]
) -> list[float]:
    """Apply a second-order lag to `a`, by the same method as mode_step() in
    src/model/laws.h.

    `h`: [s] time since the row before. `frequency`: [Hz] natural frequency. `damping`:
    [1] damping ratio."""
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


def _apply_delay(h: np.ndarray, x: np.ndarray, delay: np.ndarray) -> np.ndarray:
    """Delay a signal by `delay` [s]. Before the first row, the signal is taken as
    constant. `h`: [s] time since the row before."""
    time = np.cumsum(h)
    return np.interp(time - np.maximum(delay, 0.0), time, x)


@_use_lists
def _apply_play(h: list[float], x: list[float], half: list[float]) -> list[float]:
    """Apply mechanical play of width 2 x `half`: the output changes only if it would
    otherwise differ from the input by more than `half`. `h` is not used: it is the first
    argument of all operations with memory."""
    y = [x[0]]
    for i in range(1, len(x)):
        y.append(min(max(y[-1], x[i] - abs(half[i])), x[i] + abs(half[i])))
    return y


@_use_lists
def _limit_rate(h: list[float], x: list[float], limit: list[float]) -> list[float]:
    """Limit the rate of change of `x` to -`limit` .. `limit`, in the unit of `x` per s.
    `h`: [s] time since the row before."""
    y = [x[0]]
    for i in range(1, len(x)):
        step = abs(limit[i]) * h[i]
        y.append(min(max(x[i], y[-1] - step), y[-1] + step))
    return y


@_use_lists
def _differentiate(h: list[float], x: list[float]) -> list[float]:
    """Return the rate of change of a signal since the row before. It is 0 in the first
    row. If `h`, the time since the row before [s], is 0, it is the rate of the row
    before."""
    y = [0.0]
    for i in range(1, len(x)):
        y.append((x[i] - x[i - 1]) / h[i] if h[i] > 0 else y[-1])
    return y


MEMORY_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "lag": _apply_lag,
    "second": _apply_second,
    "late": _apply_delay,
    "play": _apply_play,
    "limit": _limit_rate,
    "rate": _differentiate,
}
