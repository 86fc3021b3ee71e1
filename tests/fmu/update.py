"""Write the golden copies of modelDescription.xml:  python3 tests/fmu/update.py"""

from __future__ import annotations

import difflib
import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PYTHON = ROOT / ".venv" / "bin" / "python"
if PYTHON.exists() and Path(sys.prefix) != ROOT / ".venv":
    os.execv(PYTHON, [str(PYTHON), *sys.argv])

from fmu_support import GOLDEN, MODELS, build  # noqa: E402


def main() -> None:
    """Build, say what differs, write."""
    GOLDEN.mkdir(exist_ok=True)
    for model in MODELS:
        new = (build() / model / "modelDescription.xml").read_text(encoding="utf-8")
        golden = GOLDEN / f"{model}.xml"
        old = golden.read_text(encoding="utf-8") if golden.exists() else ""
        diff = "".join(difflib.unified_diff(old.splitlines(True), new.splitlines(True), golden.name, "built", n=0))
        print(diff or f"{model}: no change")
        golden.write_text(new, encoding="utf-8")


if __name__ == "__main__":
    main()
