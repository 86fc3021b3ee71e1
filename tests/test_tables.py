"""Committed headers equal those written from src/tables; constants of the filter are
there.
"""

import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def test_headers_are_what_the_tables_say():
    run = subprocess.run(
        [sys.executable, str(ROOT / "scripts" / "dev" / "tables.py"), "--check"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr


def test_a_number_of_the_default_filter_is_in_the_table_or_a_limit():
    """scripts/dev/sweep.py finds each tuned number there."""
    found = [
        f"{path.name}: {name}"
        for path in sorted((ROOT / "src" / "filter").glob("*.[ch]"))
        if path.name != "limits.h"
        for name in re.findall(r"^#define (\w+) +-?(?:TSE_R\(|[\d.])", path.read_text(), re.M)
    ]
    assert not found


def test_the_default_filter_has_at_most_26_constants():
    """Each constant repairs or shapes something. Remove one before you add one."""
    rows = re.findall(
        r"^\w+ *= \{ value = ", (ROOT / "src" / "tables" / "constants.toml").read_text(encoding="utf-8"), re.M
    )
    assert 20 < len(rows) <= 26


# ---- A name of src/ belongs to a single function, so that a debugger, a search and a
# reader find the same. Alternatives of the preprocessor stand in one file. A function
# fits a screen.


SRC = Path(__file__).resolve().parents[1] / "src"
HEAD = r"^(?!typedef\b|enum\b|extern\b)[A-Za-z_][\w *]*?\b(\w+)\([^;{}]*\)(?:\s*/\*[^\n]*\*/)?"
# A body in one line, or up to the first brace in column 0.
BODY = r"(?:\s*\{.*\}[^\n]*|\s*\{[^\n]*\n(?:[^}\n][^\n]*\n|\n)*\})"
FUNCTION = re.compile(HEAD + BODY, re.M)
FORMATS = {"number/fixed.c", "number/real_ops.h"}  # the same operations for each number format
TABLE = re.compile(r" *// clang-format off: table .*?// clang-format on: end of table\n", re.S)
MAX_LINES = 60  # of a function: a screen of lines of at most 110 columns


def find_functions():
    """Yield (file, name, lines of the body) of every function that is defined."""
    for path in sorted(SRC.rglob("*.[ch]")):
        for found in FUNCTION.finditer(path.read_text()):
            body = TABLE.sub(
                "", found[0].partition("\n{\n")[2]
            )  # "": in one line; rows that a script writes are data
            yield path.relative_to(SRC).as_posix(), found[1], body.count("\n")


def test_every_function_is_seen():
    """Each brace in column 0 that ends a function belongs to a function found."""
    for path in sorted(SRC.rglob("*.[ch]")):
        text = path.read_text()
        found = [x for x in FUNCTION.finditer(text) if x[0].endswith("\n}")]
        assert len(found) == len(re.findall(r"^\{$", text, re.M)), path


def test_no_two_files_define_functions_of_one_name():
    files = defaultdict(set)
    for file, name, _ in find_functions():
        files[name].add(file)
    twice = {name: sorted(where) for name, where in files.items() if len(where) > 1 and where != FORMATS}
    assert not twice


def test_no_two_files_define_a_type_or_a_macro_of_one_name():
    """Macros that their file undefines may repeat, and those of number formats."""
    files = defaultdict(set)
    for path in sorted(SRC.rglob("*.[ch]")):
        text = path.read_text()
        gone = set(re.findall(r"^#undef (\w+)", text, re.M))
        for name in {*re.findall(r"^#define (\w+)", text, re.M)} - gone:
            files[name].add(path.relative_to(SRC).as_posix())
        for name in re.findall(r"^(?:typedef struct \w+ \{.*)?\} (\w+);", text, re.M):
            files[name].add(path.relative_to(SRC).as_posix())
    assert not {name: sorted(where) for name, where in files.items() if len(where) > 1 and where != FORMATS}


def test_a_macro_of_a_public_header_is_a_constant():
    """Exceptions: a number of each format, and the name of a public function in it."""
    public = (SRC.parent / "include" / "tse").glob("*.h")
    with_arguments = {
        x for path in public for x in re.findall(r"^# *define +(\w+)\(", path.read_text(), re.M)
    }
    assert with_arguments == {"TSE_R", "TSE_S", "TSE_NAME"}


def test_no_function_is_longer_than_a_screen():
    assert not [x for x in find_functions() if x[2] > MAX_LINES]


def test_no_line_of_c_is_wider_than_110_columns():
    """Python: ruff. Prose: scripts/dev/prose.py. scripts/dev/format.sh checks all."""
    root = SRC.parent
    folders = ("src", "include", "fmu", "docs/page", "scripts", "tests")
    files = [p for folder in folders for end in "ch" for p in (root / folder).rglob(f"*.{end}")]
    wide = [
        f"{p.relative_to(root)}:{n}"
        for p in files
        if p.parent.name != "reference"
        for n, line in enumerate(p.read_text(encoding="utf-8").splitlines(), 1)
        if len(line) > 110
    ]
    assert len(files) > 150 and not wide
