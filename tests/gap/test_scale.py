"""The measurement of long logs: the logs it makes, and what it counts of a process. The runs take minutes: scale.py itself."""

import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from tests.gap import scale


def test_logs_are_as_many_and_as_long_as_the_table_says(tmp_path: Path) -> None:
    scale.long_logs(tmp_path / "long", 12.0)
    assert len(list((tmp_path / "long").glob("log_*.csv"))) == 6
    assert len(list((tmp_path / "long").glob("hold_out_*.csv"))) == 2
    scale.many_logs(tmp_path / "many", 6.0)
    many = sorted((tmp_path / "many").glob("*.csv"))
    assert len(many) == 20
    for path in many:
        step = pd.read_csv(path)["time"].diff().dropna()
        assert step.min() > 0.0 and scale.minutes(path) == pytest.approx(0.1, rel=0.01)


def test_memory_is_that_of_one_process() -> None:
    """Not the largest of those before it. Asked in a small process: one that starts another gives it its own size as the least."""
    code = (
        "import sys; from measured import measured\n"
        "for mb in (400, 1): print(*measured(sys.executable, '-c', f'x = bytearray({mb} << 20); raise SystemExit(10)', codes=[10]))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=scale.ROOT, capture_output=True, text=True, check=True)
    large, small = ([float(x) for x in line.split()] for line in done.stdout.splitlines())
    assert large[0] == small[0] == 10
    assert 0.4e9 < large[3] < 0.6e9 and small[3] < 0.1e9


def test_a_row_of_the_table() -> None:
    row = scale.Row("long", "6, and 2 held out", 30.0, 10.0, 123.4, 1.234, "named: body_roll")
    assert scale.table([row], 2).splitlines()[-1] == "| long | 6, and 2 held out | 30.0 | 10.0 | 123 | 1.23 | named: body_roll |"
