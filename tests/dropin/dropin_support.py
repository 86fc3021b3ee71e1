"""What the tests of the two files share."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DRIVE = ROOT / "tests" / "replay" / "drive.csv"
FORMATS = ("double", "float", "fixed")


def run(*command: str | Path, cwd: Path | None = None, env: dict[str, str] | None = None) -> str:
    done = subprocess.run(
        [str(c) for c in command], cwd=cwd, env=os.environ | (env or {}), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{' '.join(map(str, command))}: {done.returncode}\n{done.stdout[-3000:]}{done.stderr[-3000:]}"
    return done.stdout


def amalgamated(out: Path, *options: str) -> Path:
    run(sys.executable, ROOT / "scripts" / "amalgamate.py", "--out", out, *options)
    return out


def tool(name: str) -> Path:
    """A program in PATH; else the test is skipped."""
    found = shutil.which(name)
    if not found:
        pytest.skip(f"{name} is not installed")
    return Path(found)
