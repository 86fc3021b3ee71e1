"""scripts/new_effect.py: what it makes builds without a warning in every hook, is off at 0, and waits for its formula."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
UNITY = ROOT / ".venv" / "share" / "unity" / "src"
HOOKS = ("CONSTANT", "INPUT", "SLIP", "STIFFNESS", "GRIP", "BODY", "SENSOR")
pytestmark = pytest.mark.skipif(not shutil.which("cc"), reason="there is no compiler cc")


@pytest.fixture
def copy(tmp_path):
    for folder in ("src", "include", "tests/unit"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    (tmp_path / "scripts").mkdir()
    for script in ("new_effect.py", "tables.py"):
        shutil.copy(ROOT / "scripts" / script, tmp_path / "scripts")
    return tmp_path


def new_effect(folder, *arguments):
    command = [sys.executable, "scripts/new_effect.py", *map(str, arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def test_every_hook_compiles_without_a_warning_beside_the_others(copy):
    for hook in HOOKS:
        done = new_effect(copy, f"try_{hook.lower()}", "--hook", hook)
        assert done.returncode == 0, done.stderr
    flags = ["-std=c99", "-fsyntax-only", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror", "-DTSE_REAL_DOUBLE=1",
             "-DTSE_MAX_PARTICLES=64", "-Iinclude", "-Isrc"]  # fmt: skip
    subprocess.run(
        ["cc", *flags, "src/model/integrator.c", "src/estimator/prepare.c", "src/host/replay.c"], cwd=copy, check=True
    )


def test_its_test_builds_and_fails_in_one_place_which_says_what_to_write(copy):
    if not UNITY.is_dir():
        pytest.skip("Unity is not there: scripts/setup.sh")
    done = new_effect(copy, "brake_pull", "--hook", "BODY", "--parameter", "arm", "--unit", "m", "--low", -0.5, "--high", 0.5,
                      "--typical", 0.01, 0.05)  # fmt: skip
    assert done.returncode == 0 and "test_effect_brake_pull.c" in done.stdout
    sources = [str(p.relative_to(copy)) for p in sorted((copy / "src").rglob("*.c"))]
    subprocess.run(
        ["cc", "-std=c99", "-O0", "-DTSE_REAL_DOUBLE=1", "-DTSE_MAX_PARTICLES=64", "-Iinclude", "-Isrc", "-Itests/unit",
         f"-I{UNITY}", "tests/unit/model/test_effect_brake_pull.c", str(UNITY / "unity.c"), *sources, "-lm", "-o", "run"],
        cwd=copy, check=True,
    )  # fmt: skip
    said = subprocess.run([copy / "run"], capture_output=True, text=True).stdout
    assert "2 Tests 1 Failures" in said and "write the formula of brake_pull" in said
    row = re.search(r"^\| brake_pull .*$", (copy / "src" / "EQUATIONS.md").read_text(), re.M)[0]
    assert "`brake_pull_body`" in row and "`test_brake_pull_does_what_its_equation_says`" in row


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("mass", "--hook", "BODY"), "there is such an effect"),
        (("Brake-Pull", "--hook", "BODY"), "small letters"),
        (("brake_pull", "--hook", "BODY", "--low", "0.1", "--high", "1"), "0, which is off, must be in the range"),
        (("brake_pull", "--hook", "BODY", "--typical", "2", "3"), "must be in the range"),
        (("brake_pull", "--hook", "WHEEL"), "invalid choice"),
    ],
)
def test_what_makes_no_sense_writes_nothing(copy, arguments, said):
    before = {p: p.read_bytes() for p in copy.rglob("*") if p.is_file()}
    done = new_effect(copy, *arguments)
    assert done.returncode == 2 and said in done.stderr and "Traceback" not in done.stderr
    assert {p: p.read_bytes() for p in copy.rglob("*") if p.is_file()} == before
