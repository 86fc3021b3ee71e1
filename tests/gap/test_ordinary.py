"""The study of ordinary cars: what it says of one of them, and that a car whose steering lags keeps its cornering stiffness."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from tests.gap import ordinary


@pytest.fixture(scope="module")
def runs() -> pd.DataFrame:
    return pd.DataFrame(ordinary.one(("steering late", 401, 0.5))).assign(minutes=0.5)


def test_a_car_whose_steering_is_late_keeps_its_cornering_stiffness(runs: pd.DataFrame) -> None:
    """Told of no lag, a filter that knows of none said valid with 8 .. 45 % less. Of a car that nobody has calibrated few rows are
    valid; where the driver steers all are near the truth, and it lies in the interval of what is valid."""
    brisk = runs[runs["road"].isin(["slalom", "sine_sweep", "steps_fast", "highway"])]
    assert len(brisk) == 4
    for key in ("cy_front", "cy_rear"):
        assert brisk[f"{key} error"].abs().max() < 0.12
        assert brisk[f"{key} held"].sum() >= 0.95 * brisk[f"{key} valid"].sum()
        assert brisk["changes"].sum() == 0


def test_the_table_has_a_line_for_every_road(runs: pd.DataFrame) -> None:
    lines = ordinary.table(runs).splitlines()
    assert len(lines) == 2 + len(ordinary.ROADS)
    assert lines[2].startswith("| steering late | highway | tse |") and len({line.count("|") for line in lines}) == 1


def test_shares_are_of_the_rows_and_of_the_valid_ones() -> None:
    """A run without a valid row has no say in what is off."""
    counts = {"rows": [100.0, 100.0], "changes": [1, 0], "minutes": [1.0, 1.0], "car": "c", "road": "r", "who": "w"}
    for key in ordinary.STIFFNESS:
        counts |= {
            f"{key} valid": [50.0, 0.0],
            f"{key} off": [20.0, 0.0],
            f"{key} held": [10.0, 0.0],
            f"{key} error": [0.1, 0.3],
        }
    line = ordinary.table(pd.DataFrame(counts)).splitlines()[2]
    assert line == "| c | r | w | 20 / 20 / 20 | 25 / 25 / 25 | 40 / 40 / 40 | 20 / 20 / 20 | 5.0 |"


def test_the_command_writes_the_table(tmp_path: Path) -> None:
    out = tmp_path / "ordinary.md"
    options = [
        "--seeds",
        "1",
        "--minutes",
        "0.25",
        "--only",
        "as modelled",
        "--jobs",
        "1",
        "--out",
        str(out),
    ]
    assert ordinary.main(options) == 0
    assert out.read_text().startswith("# Ordinary cars\n") and "| as modelled | urban | tse |" in out.read_text()
