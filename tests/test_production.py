"""scripts/production.py: the page is what its tables say, and nothing of the tables is lost on the way."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

import production  # noqa: E402


def test_the_page_is_current() -> None:
    done = subprocess.run(
        [sys.executable, ROOT / "scripts" / "production.py", "--check"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_every_status_and_reason_has_its_row() -> None:
    text = production.page()
    statuses, reasons = production.rows_of("status"), production.rows_of("reason")
    codes = [int(code) for _, code, _ in statuses]
    assert codes == list(range(codes[0], codes[-1] + 1)) and codes[0] < -10 and codes[-1] >= 9  # none is missed
    assert [int(code) for _, code, _ in reasons] == list(range(len(reasons))) and len(reasons) >= 9
    for name, code, sentence in (*statuses, *reasons):
        assert f"| {name} | {code} | {sentence} |" in text


def test_policies_and_tables_are_on_the_page() -> None:
    text = production.page()
    assert "Policy for odd rows" in text and "Formats 1 and 2 are refused" in text
    for name, title, command in (*production.TABLES, *production.LONG):
        assert f"## {title}" in text
        if not (production.RESULTS / name).exists():
            assert f"Not run yet: `{command}`" in text
