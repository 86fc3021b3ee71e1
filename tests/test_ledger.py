"""src/EQUATIONS.md: its functions and tests exist, and it is complete.

Every equation of the paper has a row, every deviation its place. src/paper/algorithm1.c
has every line of Algorithm 1 once, and names the equations that the ledger names.
"""

import re
import sys
from pathlib import Path

import pytest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[1]
LEDGER = (ROOT / "src" / "EQUATIONS.md").read_text()
FUNCTION = re.compile(r"`(\w+)` in (src/[\w/]+\.[ch])")
TEST = re.compile(r"`(test_\w+)`")
NUMBERS = [*range(1, 10), *range(16, 20), 22, 23, *range(25, 28)]


def read_rows():
    """Return the rows of the tables with number or name, equation, function and test."""
    found, inside = [], False
    for line in LEDGER.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("|"):
            inside = False
        elif cells[2:] == ["function", "test"]:
            inside = True
        elif inside and not set(line) <= set("|-"):
            assert len(cells) == 4, line
            found.append(cells)
    return found


@pytest.mark.parametrize("row", read_rows(), ids=lambda row: row[0])
def test_each_row_names_a_function_that_exists_and_a_test_that_runs(row):
    functions, tests = FUNCTION.findall(row[2]), TEST.findall(row[3])
    assert functions and tests
    for name, path in functions:
        text = (ROOT / path).read_text()
        assert re.search(rf"^[A-Za-z][^;{{}}()]*\b{name}\([^;]*?\)\s*\{{", text, re.M), (
            f"{path} does not define {name}"
        )
    for name in tests:
        sources = [p.read_text() for p in (ROOT / "tests" / "unit").rglob("test_*.c")]
        assert any(re.search(rf"\nstatic void\s+{name}\(\s*void\)", s) for s in sources), (
            f"no unit test {name}"
        )


def test_every_equation_of_the_paper_has_a_row():
    names = {row[0] for row in read_rows()}
    assert {f"({n})" for n in NUMBERS} | {"Algorithm 1"} <= names


DERIVED = {*range(10, 16), 20, 21, 24}  # no code of their own
LOOPS = {1, 2, 5, 13, 19, 20}  # lines of Algorithm 1 that are "for" and "end"
PAPER = ROOT / "src" / "paper"


def read_table(text, head):
    """Return the cells of the first table with this head."""
    lines = iter(text.splitlines())
    for line in lines:
        if [cell.strip() for cell in line.strip("|").split("|")] == head:
            break
    next(lines)
    found = []
    for line in lines:
        if not line.startswith("|"):
            return found
        found.append([cell.strip() for cell in line.strip("|").split("|")])
    return found


def parse_numbers(text):
    """Return the numbers of "3, 6" or "8 .. 10"."""
    found = []
    for part in text.split(","):
        first, _, last = (x.strip(" ()") for x in part.partition(".."))
        found += range(int(first), int(last or first) + 1)
    return found


DEVIATIONS = [
    *read_table(LEDGER, ["paper", "here", "why", "where"]),
    *read_table(LEDGER, ["row", "here", "where"]),
]


@pytest.mark.parametrize("row", DEVIATIONS, ids=lambda row: row[0][:40])
def test_each_deviation_names_a_function_of_the_source(row):
    source = "\n".join(p.read_text() for p in (ROOT / "src").rglob("*.[ch]"))
    (name,) = re.findall(r"`(\w+)`$", row[-1])
    assert re.search(rf"^[A-Za-z][^;{{}}()]*\b{name}\([^;]*?\)\s*\{{", source, re.M), name


def test_every_line_of_algorithm_1_stands_in_the_code_once():
    calls = re.findall(
        r"^ .*?(\w+)\(.*/\* ([0-9 .,]+?) +(?:\(.*?)?\*/", (PAPER / "algorithm1.c").read_text(), re.M
    )
    lines = [n for _, text in calls for n in parse_numbers(text)]
    assert sorted(lines) == sorted(set(range(1, 21)) - LOOPS)


def test_the_code_of_algorithm_1_and_the_ledger_name_the_same_functions():
    ledger = {row[0]: row[2] for row in read_rows()}
    text = (PAPER / "algorithm1.c").read_text()
    named = re.findall(r"^ .*?(\w+)\(p, f.*/\* .*?(\(.*\)) *\*/", text, re.M)
    assert len(named) >= 8
    for function, equations in named:
        for n in re.findall(r"\((\d+)\)", equations):
            assert f"`{function}`" in ledger[f"({n})"] or n == "22", (function, n)


def test_every_equation_is_in_the_code_or_derived():
    assert {*NUMBERS, *DERIVED} == set(range(1, 28))


def test_what_keeps_the_filter_from_diverging_is_off_in_the_defaults():
    """Defaults of the paper's filter are the printed values, marked "(the paper)"."""
    rows = tomllib.loads((ROOT / "src" / "tables" / "filter.toml").read_text())
    said = (
        (n, r["default"], re.search(r"(?:; |rows: )([\d.]+):? [^;]*\(the paper\)", r["text"]))
        for n, r in rows.items()
    )
    printed = [(name, default, off[1]) for name, default, off in said if off]
    assert len(printed) == 6
    for name, default, off in printed:
        assert float(default) == float(off), name
