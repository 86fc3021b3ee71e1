"""src/EQUATIONS.md: every function and every test that it names exists, and every equation of the paper has a row."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LEDGER = (ROOT / "src" / "EQUATIONS.md").read_text()
FUNCTION = re.compile(r"`(\w+)` in (src/[\w/]+\.[ch])")
TEST = re.compile(r"`(test_\w+)`")
NUMBERS = [*range(1, 10), *range(16, 20), *range(22, 28)]


def rows():
    """The rows of the tables that have the columns number or name, equation, function, test."""
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


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0])
def test_each_row_names_a_function_that_exists_and_a_test_that_runs(row):
    functions, tests = FUNCTION.findall(row[2]), TEST.findall(row[3])
    assert functions and tests
    for name, path in functions:
        text = (ROOT / path).read_text()
        assert re.search(rf"^[A-Za-z][^;{{}}()]*\b{name}\([^;]*?\)\s*\{{", text, re.M), f"{path} does not define {name}"
    for name in tests:
        sources = [p.read_text() for p in (ROOT / "tests" / "unit").rglob("test_*.c")]
        assert any(f"void {name}(void)" in s and f"RUN_TEST({name})" in s for s in sources), f"no unit test {name}"


def test_every_equation_of_the_paper_has_a_row():
    names = {row[0] for row in rows()}
    assert {f"({n})" for n in NUMBERS} | {"Algorithm 1"} <= names
