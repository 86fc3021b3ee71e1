"""A formula of the user: text to program, values over a log, C code, refusals."""

import math
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from tse.car import formula as module
from tse.car.formula import Formula, Number, format_c_header, format_toml, parse, read_formula, write_formula
from tse.library.errors import UserError

W = Number("w", 0.002, "rad", 0.0003, "half of the play")
T = Number("tau", 0.08, "s")
FILE = """id = "steering_play"
title = "the front wheels lag behind by a play"
place = "front_angle"
formula = "play(steer_angle, w) - steer_angle"
[numbers.w]
value = 0.002
sd = 0.0003
unit = "rad"
"""


def make(text, *numbers, place="front_angle", **more) -> Formula:
    return parse("it", "a title", place, text, numbers, **more)


def list_operations(formula) -> list[str]:
    table = {op.code: op.name for op in module.library().formula_ops.values()}
    return [table[code] for code in formula.operations]


def drive(rows=200, seed=1) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    return {
        op.name: random.normal(size=rows)
        for op in module.library().formula_ops.values()
        if op.kind == "SIGNAL"
    }


# Programs.


@pytest.mark.parametrize(
    ("text", "numbers", "program"),
    [
        ("play(steer_angle, w) - steer_angle", [W], "steer_angle a play steer_angle sub"),
        ("-w*2", [W], "a neg two mul"),
        ("1 + 2.0", [], "one two add"),
        ("0.5*w + 0.25 + 0.5", [W], "b a mul c add b add"),
        ("steer_angle**1", [], "steer_angle"),
        ("-steer_angle**3", [], "steer_angle steer_angle mul steer_angle mul neg"),
        ("(w + time/tau)**2", [W, T], "a time b div add a time b div add mul"),
        ("(w**2)**2", [W], "a a mul a a mul mul"),
        ("w - (w - (w - w))", [W], "a a a a sub sub sub"),
    ],
)
def test_the_program_of_a_text(text, numbers, program):
    assert list_operations(make(text, *numbers)) == program.split()


def run_stack_machine(formula: Formula, row: dict[str, float]) -> float:
    """Run the settings' bytes as src/tables/formula.toml defines them.

    The module's own tables are not used.
    """
    settings = formula.settings()
    codes = [int(settings[f"formula_code_{k}"]) >> shift & 255 for k in range(1, 11) for shift in (0, 8, 16)]
    signals = {16: "steer_angle", 17: "vel_x", 18: "vel_y", 19: "yaw_rate", 20: "accel_x", 21: "accel_y"}
    signals |= {22: "slip_angle_front", 23: "slip_angle_rear", 24: "slip_front", 25: "slip_rear", 26: "time"}
    binary = {
        32: lambda x, y: x + y,
        33: lambda x, y: x - y,
        34: lambda x, y: x * y,
        35: lambda x, y: x / y if y else 0.0,
        38: max,
        39: min,
    }
    unary = {
        36: lambda x: -x,
        37: abs,
        40: lambda x: math.sqrt(x) if x > 0 else 0.0,
        41: lambda x: x / math.sqrt(1 + x * x),
    }
    stack: list[float] = []
    for code in codes:
        if code == 0:
            break
        if code <= 8:
            stack.append(settings[f"formula_{'abcdefgh'[code - 1]}"])
        elif code <= 10:
            stack.append(code - 8.0)
        elif code in signals:
            stack.append(row[signals[code]])
        elif code in unary:
            stack.append(unary[code](stack.pop()))
        else:
            y, x = stack.pop(), stack.pop()
            stack.append(binary[code](x, y))
    assert len(stack) == 1
    return settings["formula_gain"] * stack[0]


@pytest.mark.parametrize(
    "text",
    [
        "soft(steer_angle/w)*slip_front - 3*w",
        "max(min(slip_front, 0.1), -0.1)**3 + abs(slip_rear)/2",
        "sqrt(slip_front) + vel_y/vel_x - vel_y/(vel_x - vel_x)",
        "tau*yaw_rate*soft(accel_y/g) - time/tau*(w - 0.25)**2",
        "(steer_angle + 1)**4/(slip_angle_front - 2*slip_angle_rear)",
    ],
)
def test_text_program_and_settings_mean_the_same(text):
    known = {"w": W, "tau": T, "g": Number("grav", 9.81, "m/s2")}
    text = text.replace("accel_y/g", "accel_y/grav")
    numbers = [n for n in known.values() if n.name in text]
    formula = make(text, *numbers, gain=-1.5)
    signals = drive()
    values = formula.evaluate(signals, 0.01)

    def python(row):  # Python's own reading of the text; a quotient by 0 there is the one case it lacks
        scope = {"abs": abs, "max": max, "min": min, "soft": lambda x: x / math.sqrt(1 + x * x)}
        scope["sqrt"] = lambda x: math.sqrt(max(x, 0.0))
        plain = text.replace(" - vel_y/(vel_x - vel_x)", "")
        return -1.5 * eval(plain, {"__builtins__": {}}, scope | row | {n.name: n.value for n in numbers})

    for i in range(20):
        row = {name: float(values_of[i]) for name, values_of in signals.items()}
        assert values[i] == pytest.approx(run_stack_machine(formula, row), rel=1e-12)
        assert values[i] == pytest.approx(python(row), rel=1e-12)


def test_settings_are_all_of_the_formula_and_in_range():
    formula = make("w + 0.5*steer_angle", W, gain=2.0)
    settings = formula.settings()
    assert len(settings) == 2 + 8 + 11
    assert settings["formula_a"] == 0.002 and settings["formula_b"] == 0.5 and settings["formula_c"] == 0
    assert settings["formula_gain"] == 2.0 and settings["formula_place"] == 0
    assert formula.slots == {"w": "formula_a"} and formula.constants == (0.5,)
    assert make("vel_x/tau", T, place="accel_x").settings()["formula_place"] == 7
    for name, value in settings.items():
        f = module.library().field(module.CONFIG, name)
        assert f.low <= value <= f.high


def test_slots_go_to_numbers_by_first_appearance_then_to_literals():
    formula = make("0.5*b1 + 7*b2 + 0.5*b1", Number("b2", 2.5, "1"), Number("b1", 1.5, ""))
    assert formula.slots == {"b1": "formula_a", "b2": "formula_b"}
    assert formula.constants == (0.5, 7.0)
    assert [formula.settings()[f"formula_{x}"] for x in "abcde"] == [1.5, 2.5, 0.5, 7.0, 0.0]


def test_other_values_keep_all_else_and_are_checked():
    formula = make("play(steer_angle, w) - steer_angle", W)
    other = formula.with_values({"w": 0.004})
    assert other.settings()["formula_a"] == 0.004 and formula.settings()["formula_a"] == 0.002
    assert other.numbers[0].sd == W.sd and other.operations == formula.operations
    with pytest.raises(UserError, match="no number 'v'"):
        formula.with_values({"v": 1.0})
    for value in (math.nan, math.inf, 2e6):
        with pytest.raises(UserError, match=r"numbers.w.value.*-1e\+06 \.\. 1e\+06"):
            formula.with_values({"w": value})


def test_the_longest_and_the_deepest_are_allowed():
    assert len(make("+".join(["slip_front*slip_rear"] * 8) + "+1").operations) == 33
    assert len(make("1-(1-(1-(1-(1-(1-(1-1))))))").operations) == 15
    assert list_operations(make("rate(rate(rate(steer_angle)))*time**3")).count("rate") == 3
    assert make("(" * 20 + "steer_angle" + ")" * 20).operations == (16,)


def test_the_tables_of_this_module_know_every_operation():
    table = module.library().formula_ops.values()
    assert {op.name for op in table if op.kind == "PLAIN"} == set(module.PLAIN_FUNCTIONS)
    assert {op.name for op in table if op.kind == "MEMORY"} == set(module.MEMORY_FUNCTIONS)
    for op in table:
        if op.kind == "MEMORY" and op.unit == "first":
            assert len(module.OPERANDS[op.name]) == op.takes - 1
        if op.takes:
            assert op.unit in ("same", "product", "quotient", "root", "first", "rate", "1")
    assert set(module.WRITTEN_AS) <= {op.name for op in table}


# What is refused.

LONG = "slip_front*slip_rear"
REFUSED = {
    "empty": ("", "invalid syntax"),
    "unknown name": ("steer_angl", r"column 1: 'steer_angl' is neither.*did you mean steer_angle"),
    "column": ("   slip_front + what", r"column 17: 'what'"),
    "operation as a name": ("lag", "neither a signal nor a number"),
    "unknown operation": (
        "sofd(1)",
        r"'sofd' is not an operation \(did you mean soft or second\?\); allowed: \+ - \* /",
    ),
    "builtin": ("print(1)", r"not an operation.*operations \(abs, max, min, sqrt, soft, lag"),
    "import": ("__import__(time)", "'__import__' is not an operation"),
    "import of a text": ("__import__('os')", 'column 12: "\'" is not allowed'),
    "attribute": ("steer_angle.real", r"'steer_angle.real' is not allowed; allowed: \+"),
    "call of a call": ("abs(1)(2)", "is not allowed"),
    "subscript": ("slip_front[0]", r"column 11: '\[' is not allowed"),
    "lambda": ("lambda: 1", "':' is not allowed"),
    "comparison": ("slip_front < 1", "'<' is not allowed"),
    "choice": ("1 if slip_front else 2", "is not allowed"),
    "not": ("not 1", "is not allowed"),
    "yield": ("yield", "invalid syntax"),
    "plus": ("+1", "is not allowed"),
    "floor": ("1//2", "is not allowed"),
    "tuple": ("1, 2", "is not allowed"),
    "star": ("max(*slip_front)", "is not of the form max"),
    "stars": ("max(*slip_front, 1)", "is not allowed"),
    "keyword": ("max(1, x=2)", "'=' is not allowed"),
    "operands": ("play(steer_angle)", r"is not of the form play\(x, y\): x after a play"),
    "add": ("add(1, 2)", r"add is written as x \+ y"),
    "two": ("two()", "two is written as 2"),
    "slot": ("a", "neither a signal nor a number"),
    "true": ("True", "is not allowed"),
    "dots": ("...", "is not allowed"),
    "complex": ("1j", "is not allowed"),
    "infinite": ("1e999", "not a finite number"),
    "huge whole": ("9" * 390, "not a finite number"),
    "large literal": ("2000000.0", r"outside the range of formula_a; allowed: -1e\+06 .. 1e\+06"),
    "power of a name": ("2**slip_front", "not an integer exponent; allowed: 1 .. 4"),
    "power 0": ("slip_front**0", "not an integer exponent"),
    "power 5": ("slip_front**5", "not an integer exponent"),
    "power -1": ("slip_front**-1", "not an integer exponent"),
    "power True": ("slip_front**True", "not an integer exponent"),
    "tower of powers": ("(((slip_front**4)**4)**4)**4", "exceeds the 33 operations"),
    "high power": ("9**99999999", "not an integer exponent"),
    "too long text": ("slip_front+" * 40, "has 440 characters, 400 are allowed"),
    "huge text": ("(" * 1_000_000, "has 1000000 characters"),
    "brackets": ("(" * 21 + "1" + ")" * 21, "column 21: brackets nest deeper than the 20 levels"),
    "minuses": ("-" * 399 + "1", "nested deeper than the 20 levels"),
    "open": ("(1", "never closed"),
    "34 operations": ("+".join([LONG] * 8) + "+-1", "exceeds the 33 operations"),
    "deep stack": ("1-(1-(1-(1-(1-(1-(1-(1-1)))))))", "more than the 8 intermediate values"),
    "4 memories": (
        "rate(rate(rate(rate(steer_angle))))*time**4",
        "exceeds the 3 that are allowed of lag, second",
    ),
    "memories by power": ("lag(steer_angle, time)**4", "exceeds the 3 that are allowed"),
    "2 late": ("late(late(steer_angle, time), time)", "uses 'late' more often than the limit of 1"),
    "9 literals": ("3+4+5+6+7+8+9+10+11", "needs 9 numbers .*, 8 are allowed"),
    "full-width letters": ("ｓlip_front", "column 1: 'ｓ' is not allowed"),
    "cyrillic": ("slip_frоnt", "column 8: 'о' is not allowed"),
    "superscript": ("slip_front²", "is not allowed"),
    "other digits": ("１ + 1", "is not allowed"),
    "direction": ("1\u202e+ 2", "is not allowed"),
    "null": ("1\x00", "is not allowed"),
    "lines": ("1 +\n1", "is not allowed"),
    "comment": ("1 # 2", "'#' is not allowed"),
}


@pytest.mark.parametrize(("text", "message"), REFUSED.values(), ids=REFUSED.keys())
def test_texts_that_are_refused(text, message):
    with pytest.raises(UserError, match=message) as error:
        make(text, source="x.toml")
    assert str(error.value).startswith("x.toml: key formula: ")
    assert len(str(error.value)) < 600


def test_no_text_of_allowed_characters_ends_otherwise_than_in_a_formula_or_a_refusal():
    random = np.random.default_rng(3)
    pieces = [
        *"()+-*/.,12 ",
        "**",
        "abs",
        "lag",
        "play",
        "steer_angle",
        "slip_front",
        "time",
        "in",
        "if",
        "else",
        "not",
        "0x",
        "e9",
    ]
    made = 0
    for _ in range(3000):
        text = "".join(random.choice(pieces, random.integers(1, 12)))
        try:
            make(text)
            made += 1
        except UserError:
            pass
    assert made > 20


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"id": "Steering"}, "key id: 'Steering' is not a name"),
        ({"id": "a\n"}, "key id"),
        ({"title": " "}, "key title"),
        ({"place": "front_angl"}, "key place: there is no place.*did you mean front_angle"),
        ({"place": "nowhere"}, "allowed: front_angle, rear_angle"),
        ({"gain": 11.0}, r"key gain: 11.0 is outside.*-10 \.\. 10"),
        ({"gain": math.nan}, "key gain"),
        ({"numbers": []}, "'w' is neither.*numbers of the file: none"),
        ({"numbers": [W, Number("v", 1.0, "1")]}, "key numbers.v: the formula .* does not use it"),
        ({"numbers": [W, W]}, "key numbers.w: appears twice"),
        ({"numbers": [W, Number("vel_x", 1.0, "1")]}, "key numbers.vel_x: the name is taken .signal"),
        ({"numbers": [W, Number("lag", 1.0, "1")]}, "key numbers.lag: the name is taken"),
        ({"numbers": [W, Number("f", 1.0, "1")]}, "key numbers.f: the name is taken .number: formula_f"),
        ({"numbers": [W, Number("lambda", 1.0, "1")]}, "key numbers.lambda: is not a name"),
        ({"numbers": [W, Number("ｗ", 1.0, "1")]}, "is not a name"),
        ({"numbers": [W, Number("__w", 1.0, "1")]}, "is not a name"),
        ({"numbers": [Number("w", math.inf, "rad")]}, "key numbers.w.value: inf"),
        ({"numbers": [Number("w", 2e6, "rad")]}, "key numbers.w.value"),
        ({"numbers": [Number("w", 0.1, "rad", -1.0)]}, "key numbers.w.sd: -1.0.*allowed: 0 or more"),
        ({"numbers": [Number("w", 0.1, "rad", math.nan)]}, "key numbers.w.sd"),
        ({"numbers": [Number("w", 0.1, "furlongs_")]}, "key numbers.w.unit: 'furlongs_' is not a unit"),
        ({"numbers": [Number("w", 0.1, "radd")]}, "key numbers.w.unit: 'radd' is not a known unit"),
    ],
)
def test_parts_that_are_refused(change, message):
    parts = {
        "id": "it",
        "title": "a title",
        "place": "front_angle",
        "text": "play(steer_angle, w)",
        "numbers": [W],
    } | change
    with pytest.raises(UserError, match=message) as error:
        parse(**parts, source="x.toml")
    assert str(error.value).startswith("x.toml: key ")


# Dimensions.


@pytest.mark.parametrize(
    ("text", "place", "unit"),
    [
        ("k*accel_y", "front_angle", "rad s2/m"),
        ("k*accel_y", "front_angle", "s2/m"),
        ("k*yaw_rate", "yaw_moment", "1/s"),
        ("k*yaw_rate", "yaw_moment", "Hz"),
        ("rate(vel_x) - k", "accel_x", "m/s2"),
        ("vel_x*yaw_rate + k", "accel_y", "m/s/s"),
        ("sqrt(vel_x**2 + vel_y**2)/k", "force_x", "s"),
        ("sqrt(sqrt(k**4))", "force_x", "m/s2"),
        ("soft(accel_y/k)", "stiffness_front", "m/s2"),
        ("second(accel_y, k, 0.3)", "accel_y", "Hz"),
        ("lag(accel_y, k) + late(accel_y, k)", "accel_y", "s"),
        ("limit(yaw_rate, k)", "yaw_rate", "rad/s2"),
        ("play(vel_x, k)*yaw_rate", "force_y", "m/s"),
        ("max(accel_x, k) + min(-k, abs(accel_y))", "force_x", "m/s2"),
        ("steer_angle - 0.002*k", "front_angle", ""),
        ("accel_x*k/k", "force_x", "kg m2"),
    ],
)
def test_dimensions_that_fit(text, place, unit):
    assert make(text, Number("k", 1.5, unit), place=place).slots == {"k": "formula_a"}


@pytest.mark.parametrize(
    ("text", "place", "unit", "message"),
    [
        ("k*accel_y", "front_angle", "rad", r"column 1: 'k\*accel_y' has the unit m/s2, the place has rad"),
        (
            "steer_angle + k",
            "front_angle",
            "m",
            r"'steer_angle \+ k' does not fit: 'k' has the unit m, but 1 is needed",
        ),
        (
            "k*(vel_x - 0.5)",
            "force_x",
            "1/s",
            r"column 4: .*'0.5' has the unit 1, but m/s is needed; a literal.*\[numbers.<name>\]",
        ),
        ("k*0", "force_x", "1", "has the unit 1, the place has m/s2"),
        ("max(accel_x, k)", "force_x", "m/s", "'k' has the unit m/s, but m/s2 is needed"),
        ("sqrt(vel_x)*k", "force_x", "m/s2", r"has the unit m1.5/s2.5, the place"),
        ("soft(accel_y)*k", "force_y", "m/s2", "'accel_y' has the unit m/s2, but 1 is needed"),
        ("lag(steer_angle, k)", "front_angle", "Hz", "'k' has the unit 1/s, but s is needed"),
        (
            "lag(steer_angle, 0.1)*k",
            "front_angle",
            "1",
            "'0.1' has the unit 1, but s is needed; a literal has no unit",
        ),
        ("second(steer_angle, k, 0.3)", "front_angle", "s", "but 1/s is needed"),
        ("second(steer_angle, 1/time, k)", "front_angle", "s", "but 1 is needed"),
        ("late(steer_angle, k)", "front_angle", "1", "but s is needed"),
        ("play(vel_x, k)", "force_x", "rad", "but m/s is needed"),
        ("limit(vel_x, k)", "force_x", "m/s", "but m/s2 is needed"),
        ("rate(vel_x)*k", "force_x", "s", "has the unit m/s, the place has m/s2"),
        ("-k", "force_x", "m", "has the unit m, the place"),
        (
            "steer_angle*k",
            "front_angle",
            "deg",
            "0.0174533 times the SI unit that the model uses; write the number in rad",
        ),
        ("vel_x*k", "force_x", "1/ms", "1000 times the SI unit"),
        ("vel_x*k", "force_x", "kg/m s2", "one name follows each /"),
        ("vel_x*k", "force_x", "m\ns", "is not a unit"),
        ("vel_x*k", "force_x", "9**9**9", "is not a unit"),
        ("vel_x*k", "force_x", "m" * 1000, "is not a unit"),
        ("vel_x*k", "force_x", "degC", "is not a known unit"),
        ("vel_x*k", "force_x", "nan", "write the number in"),
    ],
)
def test_dimensions_that_do_not(text, place, unit, message):
    with pytest.raises(UserError, match=message):
        make(text, Number("k", 1.5, unit), place=place)


# Files.


def test_a_file_is_read_and_written(tmp_path):
    path = tmp_path / "steering_play.toml"
    path.write_text(FILE, encoding="utf-8")
    formula = read_formula(path)
    assert formula.numbers == (Number("w", 0.002, "rad", 0.0003),) and formula.gain == 1.0
    write_formula(path, formula)
    assert read_formula(path) == formula
    assert "value = 0.002  # rad\n" in path.read_text(encoding="utf-8")
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def test_whatever_a_formula_holds_comes_back_from_its_file(tmp_path):
    numbers = (
        W,
        T,
        Number("k", 1e-5, "rad s2/m", 0.0, 'has "quotes", a \\ and\na line\x7f'),
        Number("n", -3.0, ""),
    )
    found = {
        "names": ["w", "tau"],
        "covariance": np.array([[1.0, 0.5], [0.5, 1.0]]),
        "rows": np.int64(3),
        "a key": "ü\t",
        "fine": True,
        "sd": np.float32(0.5),
    }
    text = "lag(play(steer_angle, w), tau) + k*accel_y*n"
    formula = Formula("it", 'a "title"\nin # two lines', "front_angle", text, numbers, -0.25, found)
    path = tmp_path / "it.toml"
    write_formula(path, formula)
    again = read_formula(path)
    assert again == formula and format_toml(again) == format_toml(formula)
    plain = {"covariance": [[1.0, 0.5], [0.5, 1.0]], "rows": 3, "sd": 0.5}
    assert again.found == found | plain


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('id = "steering_play"', "", "key id is missing"),
        ('id = "steering_play"', "id = 3", "key id: 3 is not a string"),
        (
            'id = "steering_play"',
            'id = "steering_play"\ngian = 1.0',
            r"key gian is not known \(did you mean gain\?\)",
        ),
        ('id = "steering_play"', 'id = "steering_play"\ngain = "1"', "key gain: '1' is not a number"),
        ('id = "steering_play"', 'id = "steering_play"\ngain = true', "key gain: True is not a number"),
        (
            'id = "steering_play"',
            f'id = "steering_play"\ngain = 1{"0" * 400}',
            "key gain: an integer has at most 64 bits",
        ),
        ("[numbers.w]\n", "[numbers]\nv = 1\n[numbers.w]\n", r"key numbers.v must be a table: \[numbers.v\]"),
        ("value = 0.002", "", "key numbers.w.value is missing"),
        ("value = 0.002", "value = nan", "key numbers.w.value: nan"),
        ("value = 0.002", "value = [1]", r"key numbers.w.value: \[1\] is not a number"),
        ('unit = "rad"', "", "key numbers.w.unit is missing"),
        (
            'unit = "rad"',
            'unit = "rad"\nvlaue = 1',
            r"key numbers.w.vlaue is not known \(did you mean value\?\)",
        ),
        ('unit = "rad"', 'unit = "rad"\n[found]\nday = 2024-01-01', "key found.day.*cannot be stored"),
        ('unit = "rad"', 'unit = "rad"\n[found.more]\nx = 1', "key found.more.*cannot be stored"),
        ("[numbers.w]", "[numbers.w", "is not valid TOML"),
    ],
)
def test_files_that_are_refused(tmp_path, old, new, message):
    path = tmp_path / "x.toml"
    assert old in FILE
    path.write_text(FILE.replace(old, new), encoding="utf-8")
    with pytest.raises(UserError, match=message) as error:
        read_formula(path)
    assert str(error.value).startswith(f"{path}: ")


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(UserError, match="no such file"):
        read_formula(tmp_path / "none.toml")


# Numbers over a log.


def test_a_lag_is_that_of_a_linear_system():
    time = np.arange(0, 3, 0.01)
    steer = np.sin(3 * time) + 0.2 * np.sin(11 * time) + 0.1
    y = make("lag(steer_angle, tau)", T).evaluate({"steer_angle": steer}, 0.01)
    # lsim is exact for an input that is linear between rows, from rest at 0, so the first
    # value is subtracted. The trapezoidal rule errs by (w h)^2/12 of the passed signal,
    # with w below 11 rad/s, and by (h/T)^2/12 = 1e-3 of the kink at the start.
    _, exact, _ = signal.lsim(([1.0], [T.value, 1.0]), steer - steer[0], time)
    assert y == pytest.approx(exact + steer[0], abs=2e-3)
    assert y[0] == steer[0]


def test_a_step_through_a_lag_decays_by_its_time():
    steer = np.r_[0.0, np.ones(400)]
    y = make("lag(steer_angle, tau)", Number("tau", 0.5, "s")).evaluate({"steer_angle": steer}, 0.001)
    # The first step is a ramp over h, as if the step came h/2 earlier than row 1.
    t = 0.001 * np.arange(401) - 0.0005
    assert y[1:] == pytest.approx(1 - np.exp(-t[1:] / 0.5), abs=1e-6)


def test_a_lag_shorter_than_the_rows_is_the_mean_of_two():
    steer = drive()["steer_angle"]
    y = make("lag(steer_angle, tau)", Number("tau", 0.0, "s")).evaluate({"steer_angle": steer}, 0.01)
    assert y[1:] == pytest.approx(0.5 * (steer[1:] + steer[:-1]), abs=1e-12)


def test_a_mode_is_that_of_a_linear_system():
    time = np.arange(0, 4, 0.005)
    accel = 2 * np.sin(5 * time) + 0.3
    f, w = Number("freq", 1.5, "Hz"), 2 * math.pi * 1.5
    y = make("second(accel_y, freq, 0.3)", f, place="accel_y").evaluate({"accel_y": accel}, 0.005)
    _, exact, _ = signal.lsim(([w**2], [1.0, 2 * 0.3 * w, w**2]), accel - accel[0], time)
    # The rule detunes the mode by (w h)^2/12 = 2e-4 of its frequency. Over the ringing of
    # 2 m/s2 this is about 1e-3.
    assert y == pytest.approx(exact + accel[0], abs=3e-3)


def test_late_play_limit_and_rate_row_by_row():
    x = np.array([1.0, 1.0, 2.0, 4.0, 4.0, 0.0, 0.0])
    dt = np.array([9.0, 0.1, 0.1, 0.1, 0.2, 0.1, 0.1])  # the first is not used
    n = [Number("p", 1.0, "rad"), Number("q", 5.0, "1/s"), Number("late_by", 0.15, "s")]
    signals = {"steer_angle": x}
    assert make("play(steer_angle, p)", n[0]).evaluate(signals, dt) == pytest.approx([1, 1, 1, 3, 3, 1, 1])
    assert make("play(steer_angle, -p)", n[0]).evaluate(signals, dt) == pytest.approx([1, 1, 1, 3, 3, 1, 1])
    assert make("limit(steer_angle, q)", n[1]).evaluate(signals, dt) == pytest.approx(
        [1, 1, 1.5, 2, 3, 2.5, 2]
    )
    assert make("rate(steer_angle)*time").evaluate(signals | {"time": np.ones(7)}, dt) == pytest.approx(
        [0, 0, 10, 20, 0, -40, 0]
    )
    assert make("late(steer_angle, late_by)", n[2]).evaluate(signals, dt) == pytest.approx(
        [1, 1, 1, 1.5, 4, 4, 2]
    )
    assert make("late(steer_angle, -late_by)", n[2]).evaluate(signals, dt) == pytest.approx(
        x
    )  # no look ahead


def test_two_rows_of_one_time_change_no_memory_but_what_follows_at_once():
    x, dt = np.array([0.0, 1.0, 3.0, 3.0]), np.array([0.1, 0.1, 0.0, 0.1])
    signals = {"steer_angle": x, "time": np.ones(4)}
    assert make("rate(steer_angle)*time").evaluate(signals, dt) == pytest.approx([0, 10, 10, 0])
    for text in ("lag(steer_angle, time)", "second(steer_angle, 1/time, 0.5)", "limit(steer_angle, 1/time)"):
        y = make(text).evaluate(signals, dt)
        assert y[2] == y[1] and np.isfinite(y).all()


def test_what_is_no_number_or_none_of_a_car_is_0():
    signals = {"steer_angle": np.array([1e3, 1e200, math.nan, math.inf])}
    with np.errstate(over="ignore"):
        assert make("steer_angle**2 - 1").evaluate(signals, 0.01).tolist() == [999999.0, 0.0, 0.0, 0.0]


def test_memories_in_memories_are_those_of_the_parts():
    signals, k = drive(), [W, T]
    both = make("lag(play(steer_angle, w), tau)", *k).evaluate(signals, 0.01)
    inner = make("play(steer_angle, w)", W).evaluate(signals, 0.01)
    assert both == pytest.approx(
        make("lag(steer_angle, tau)", T).evaluate({"steer_angle": inner}, 0.01), abs=1e-14
    )


def test_a_value_of_a_million_or_more_is_0_on_either_side():
    steer = np.array([9.99e5, 1e6, 5e6, -9.99e5, -1e6, -5e6, math.nan])
    y = make("steer_angle", gain=0.5).evaluate({"steer_angle": steer}, 0.01)
    assert y.tolist() == [4.995e5, 0.0, 0.0, -4.995e5, 0.0, 0.0, 0.0]


def test_numbers_below_0_in_memories_are_those_without_a_sign_or_0():
    """A limit or a play has a magnitude; a negative frequency, damping or time is 0."""
    t = np.arange(0, 1, 0.01)
    steer = {"steer_angle": np.sin(9 * t)}

    def value(text, place="front_angle", **numbers):
        units = {"pace": "rad/s", "w": "rad", "own": "Hz", "z": "1", "tau": "s"}
        given = [Number(n, x, units[n]) for n, x in numbers.items()]
        return make(text, *given, place=place).evaluate(steer, 0.01)

    for text, name, x in (("limit(steer_angle, pace)", "pace", 2.0), ("play(steer_angle, w)", "w", 0.3)):
        np.testing.assert_array_equal(value(text, **{name: x}), value(text, **{name: -x}))
    second = "second(steer_angle, own, z)"
    np.testing.assert_array_equal(value(second, own=-3.0, z=0.3), np.zeros(100))  # it stays at its start
    np.testing.assert_array_equal(value(second, own=3.0, z=-0.3), value(second, own=3.0, z=0.0))
    np.testing.assert_array_equal(
        value("lag(steer_angle, tau)", tau=-1.0), value("lag(steer_angle, tau)", tau=0.0)
    )
    np.testing.assert_array_equal(value("late(steer_angle, tau)", tau=-0.1), steer["steer_angle"])


def test_the_step_before_the_first_row_is_not_used():
    steer, step = {"steer_angle": np.arange(5.0)}, np.array([math.nan, 0.1, 0.1, 0.1, 0.1])
    for text in ("late(steer_angle, tau)", "lag(steer_angle, tau)"):
        formula = make(text, T)
        np.testing.assert_array_equal(formula.evaluate(steer, step), formula.evaluate(steer, 0.1))


def test_a_lag_without_a_time_stays_where_no_time_passes():
    steer = np.array([0.0, 1.0, 5.0, 5.0])
    y = make("lag(steer_angle, tau)", Number("tau", 0.0, "s")).evaluate(
        {"steer_angle": steer}, np.array([0.01, 0.01, 0.0, 0.01])
    )
    assert y.tolist() == [0.0, 0.5, 0.5, 5.0]  # the means of two rows


@pytest.mark.parametrize(
    ("value", "is_allowed"), [(1e6, True), (-1e6, True), (1.1e6, False), (-1.1e6, False)]
)
def test_a_number_is_within_the_range_of_its_setting(value, is_allowed):
    if is_allowed:
        assert make("w", Number("w", value, "rad")).settings()["formula_a"] == value
    else:
        with pytest.raises(UserError, match=r"numbers.w.value: .* is outside the range of formula_a"):
            make("w", Number("w", value, "rad"))


@pytest.mark.parametrize(("depth", "is_allowed"), [(4, True), (5, False)])
def test_results_are_lists_of_at_most_four_levels(depth, is_allowed):
    fact: object = 1.5
    for _ in range(depth):
        fact = [fact]
    if is_allowed:
        assert Formula("it", "x", "front_angle", "w", (W,), 1.0, {"a": fact}).found["a"] == fact
    else:
        with pytest.raises(UserError, match=r"found\.a: .*cannot be stored"):
            Formula("it", "x", "front_angle", "w", (W,), 1.0, {"a": fact})


def test_an_expression_of_20_levels_is_allowed_and_one_of_21_is_not():
    assert list_operations(make("-" * 19 + "w", W)) == ["a"] + ["neg"] * 19
    with pytest.raises(UserError, match="is nested deeper than the 20 levels allowed"):
        make("-" * 20 + "w", W)


@pytest.mark.parametrize("text", ["w w", "w + v", "w +"])
def test_a_column_counts_the_blanks_before_the_expression(text):
    columns = []
    for indent in (0, 3):
        with pytest.raises(UserError) as error:
            make(" " * indent + text, W)
        columns.append(int(str(error.value).split("column ")[1].split(":")[0]))
    assert columns[1] == columns[0] + 3


def test_a_header_and_a_file_state_numbers_place_and_units():
    numbers = (Number("w", 0.1234567, "rad", 0.0, "a play"), Number("k", 3.0, "1"))
    formula = Formula("it", "a title", "yaw_moment", "rate(rate(play(steer_angle, w)))*k*7.5", numbers)
    text = format_c_header(formula)
    for line in (
        "#ifndef TSE_FORMULA_IT_H",
        "#define TSE_FORMULA_PLACE 4 /* yaw_moment */",
        "  const tse_real t1 = formula_number(f, 0); /* w */",
        "  const tse_real t2 = formula_play(f, t0, t1);",
        "  const tse_real t5 = formula_number(f, 1); /* k */",
        "  const tse_real t6 = formula_mul(t4, t5);",
        "  const tse_real t7 = formula_number(f, 2); /* 7.5 */",
        "  return t8;",
        " * w [rad] is formula_a, 0.1234567 when written: a play",
        " * 7.5 is formula_c",
    ):
        assert line in text.splitlines(), line
    lines = format_toml(formula).splitlines()
    assert {"value = 0.1234567  # rad", "sd = 0.0  # rad", "value = 3.0", 'text = "a play"'} <= set(lines)


def test_a_formula_without_signals_is_a_constant():
    assert make("w", W, gain=2.0).evaluate({}, np.full(5, 0.01)) == pytest.approx(np.full(5, 0.004))
    with pytest.raises(KeyError):
        make("steer_angle").evaluate({}, 0.01)


# ---- compiled


ROOT = Path(__file__).resolve().parents[2]
PREPARE = ("estimator/settings.c", "estimator/latencies.c", "estimator/check.c", "estimator/prepare.c")
SOURCES = "model/integrator.c", *PREPARE, "host/replay.c"
PROGRAM = r"""
#include <stdio.h>
#include "tse/replay.h"
#define ROWS 2000
static double dt[ROWS], steer[ROWS], front[ROWS], rear[ROWS], x[ROWS], y[ROWS], r[ROWS];
int main(void)
{
  tse_config c;
  tse_params p;
  tse_replay_start start;
  tse_replay_log log = { 0 };
  tse_replay_out out = { 0 };
  int32_t wrong;
  unsigned random = 1;
  tse_config_exact(&c);
  SETTINGS
  if (tse_prepare(&c, &p, NULL) < 0) return 1;
  for (int i = 0; i < ROWS; i++) {
    random = random * 1664525u + 1013904223u;
    dt[i] = 0.01;
    steer[i] = (i ? steer[i - 1] : 0) * 0.98 + 0.004 * ((double)(random >> 8) / 8388608.0 - 1.0);
    front[i] = rear[i] = (15 + 5 * (double)i / ROWS) / 0.3;
  }
  log.dt = dt; log.steer_angle = steer; log.wheel_speed_front = front; log.wheel_speed_rear = rear;
  out.accel_x = x; out.accel_y = y; out.yaw_rate = r;
  tse_replay_start_default(&start);
  if (tse_replay(&p, &log, ROWS, &start, &out, &wrong) < 0) return 2;
  fwrite(x, sizeof x, 1, stdout); fwrite(y, sizeof y, 1, stdout); fwrite(r, sizeof r, 1, stdout);
  return 0;
}
"""
TITLES = (
    "*/ int x = ; /*",
    "ends in \\",
    "??/",
    "a\n*/\n#error",
    "/*/*/",
    "\u202e ü */",
)  # none of which ends a comment
FORMULA = parse(
    "play_and_lag",
    "*/ a play, softened with the speed\n#error \\",
    "rear_angle",
    "k*(play(steer_angle, w) - steer_angle)*(1 + soft((vel_x - v0)/vw)) + j*lag(accel_y, T)",
    [
        Number(*n, text=text)
        for n, text in zip(
            (
                ("k", 0.9, "1"),
                ("w", 0.002, "rad"),
                ("v0", 17.0, "m/s"),
                ("vw", 2.0, "m/s"),
                ("j", 2e-4, "s2/m"),
                ("T", 0.1, "s"),
            ),
            TITLES,
            strict=True,
        )
    ],
)


def run(folder: Path, settings: dict[str, float], *flags: str) -> bytes:
    folder.mkdir(exist_ok=True)
    lines = " ".join(f"c.{k} = {v!r};" for k, v in settings.items())
    (folder / "main.c").write_text(PROGRAM.replace("SETTINGS", lines))
    warn = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wno-float-conversion", "-Werror"]
    build = [
        "cc",
        "-std=c99",
        "-O1",
        "-ffp-contract=off",
        *warn,
        "-DTSE_REAL_DOUBLE=1",
        "-DTSE_MAX_PARTICLES=64",
        *flags,
    ]
    files = [
        f"-I{ROOT / 'include'}",
        f"-I{ROOT / 'src'}",
        "main.c",
        *(ROOT / "src" / name for name in SOURCES),
    ]
    subprocess.run([*build, *files, "-lm", "-o", "run"], cwd=folder, check=True)
    return subprocess.run([folder / "run"], check=True, capture_output=True).stdout


@pytest.mark.skipif(not shutil.which("cc"), reason="there is no compiler cc")
def test_compiled_in_and_interpreted_are_the_same_bits(tmp_path):
    settings = FORMULA.settings()
    interpreted = run(tmp_path / "interpreted", settings)
    (tmp_path / "compiled").mkdir()
    header = format_c_header(FORMULA)
    assert "Written by tselab, not by hand." in header and '#define TSE_FORMULA_ID "play_and_lag"' in header
    (tmp_path / "compiled" / "tse_formula.h").write_text(2 * header, encoding="utf-8")  # its guard holds
    numbers = {k: v for k, v in settings.items() if not k.startswith(("formula_code", "formula_place"))}
    compiled = run(tmp_path / "compiled", numbers, "-DTSE_FORMULA=1", "-I.")
    assert len(interpreted) == 3 * 2000 * 8
    assert compiled == interpreted
    without = run(tmp_path / "without", {})
    assert without != interpreted
    last = struct.unpack("<6000d", interpreted)[-1] - struct.unpack("<6000d", without)[-1]
    assert abs(last) > 1e-4  # it does something, and not of the size of rounding


@pytest.mark.skipif(not shutil.which("cc"), reason="there is no compiler cc")
def test_a_build_with_a_formula_compiled_in_takes_no_other(tmp_path):
    (tmp_path / "compiled").mkdir()
    (tmp_path / "compiled" / "tse_formula.h").write_text(format_c_header(FORMULA), encoding="utf-8")
    with pytest.raises(subprocess.CalledProcessError) as refused:
        run(tmp_path / "compiled", FORMULA.settings(), "-DTSE_FORMULA=1", "-I.")
    assert refused.value.returncode == 1  # tse_prepare()
