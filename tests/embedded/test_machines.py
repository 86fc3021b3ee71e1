"""The filter on other machines: the same bits, within its budgets, and in a control loop
that a timer and a bus drive.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts" / "dev"))

import budgets  # noqa: E402
import machines as m  # noqa: E402

pytestmark = pytest.mark.slow


def find_machine(name: str) -> m.Machine:
    """Return a machine by its name; skip the test if it is not installed."""
    found = next(x for x in m.list_machines() if x.name == name)
    if why := found.find_missing():
        pytest.skip(f"{why} (scripts/setup.sh machines)")
    return found


def run_script(*words: str) -> str:
    """Run a script; return its output."""
    done = subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def test_the_same_bits_where_machines_differ_most() -> None:
    if all(x.find_missing() for x in m.list_machines() if x.short):
        pytest.skip(
            "none of the compilers and emulators for other machines is installed (scripts/setup.sh machines)"
        )
    assert "FAILED" not in run_script("scripts/dev/platforms.py", "--short")


def test_a_row_stays_within_the_limits() -> None:
    find_machine("Cortex-M4F")
    assert "FAILED" not in run_script("scripts/dev/budgets.py", "--short")


def test_a_limit_that_is_passed_is_found() -> None:
    x = budgets.Measured(
        "a target",
        {"mean": {"limit": 100}, "stack": {"limit": 10, "goal": 5}},
        values={"mean": 101, "stack": 10},
    )
    assert x.list_exceeded() == ["a target: mean 101, the limit is 100"]


def test_the_deepest_path_is_that_of_the_largest_frames(tmp_path: Path) -> None:
    node = 'node: {{ title: "{0}" label: "{0}\\nf.c:1:1\\n{1} bytes (static)" }}\n'
    edge = 'edge: {{ sourcename: "{0}" targetname: "{1}" label: "" }}\n'
    text = "".join(
        node.format(*x)
        for x in (("tse_step_f32", 10), ("f.c:small", 20), ("f.c:large", 200), ("f.c:leaf", 5))
    )
    calls = (
        ("tse_step_f32", "f.c:small"),
        ("tse_step_f32", "f.c:large"),
        ("f.c:large", "f.c:leaf"),
        ("f.c:leaf", "memcpy"),
    )
    (tmp_path / "f.ci").write_text(text + "".join(edge.format(*x) for x in calls))
    assert budgets.find_deepest_stack(tmp_path, "tse_step") == 10 + 200 + 5 + budgets.EXTERNAL


def test_a_control_loop_on_a_bus_has_the_bits_of_the_log(tmp_path: Path) -> None:
    """scripts/dropin/can on an emulated Cortex-M4F of 62.5 million instructions a second.

    The board receives each frame of the drive in its period.
    """
    m4f, example = find_machine("Cortex-M4F"), ROOT / "scripts" / "dropin" / "can"
    flags = (
        "-DTSE_NO_EFFECTS",
        "-DTSE_NO_DESCRIBE",
        f"-I{example}",
        "-DPERIOD_MS=10",
        "-DICOUNT_SHIFT=4",
        "-Wall",
        "-Wextra",
    )
    program = m.build_program(
        m.Work(tmp_path), m4f, "float", "can_board.c", "can", *flags, beside=[example / "control_loop.c"]
    )
    said = dict(
        re.findall(r"^(\w+) (\w+)$", m.run_program(m4f, program, "-icount", "shift=4,sleep=off"), re.M)
    )
    assert said["hash"] == m.read_golden("float")["default, scheme 0"]
    assert int(said["rows"]) == m.write_rows().count("\n")
    assert said["refused"] == said["overruns"] == "0"
    assert int(said["of"]) == 625_000
    # 205 000 instructions with the interrupt, and a margin of 10 % for other compilers
    assert int(said["longest"]) < 0.36 * int(said["of"])
