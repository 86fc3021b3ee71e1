"""Headers that are written from src/tables are committed as they would be written; numbers of the filter have two homes."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def test_headers_are_what_the_tables_say():
    run = subprocess.run(
        [sys.executable, str(ROOT / "scripts" / "tables.py"), "--check"], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr


def test_a_number_of_the_default_filter_is_in_the_table_or_a_limit():
    """What is tuned is where scripts/sweep.py finds it."""
    found = [
        f"{path.name}: {name}"
        for path in sorted((ROOT / "src" / "filter").glob("*.[ch]"))
        if path.name != "limits.h"
        for name in re.findall(r"^#define (\w+) +-?(?:TSE_R\(|[\d.])", path.read_text(), re.M)
    ]
    assert not found


def test_the_default_filter_has_at_most_26_constants():
    """Each repairs something or shapes something: before a new one, one goes."""
    rows = re.findall(
        r"^\w+ *= \{ value = ", (ROOT / "src" / "tables" / "constants.toml").read_text(encoding="utf-8"), re.M
    )
    assert 20 < len(rows) <= 26
