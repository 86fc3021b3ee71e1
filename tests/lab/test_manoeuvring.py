"""A car that manoeuvres, and wheel speeds without their sign.

Backwards nothing is learnt, and what is driven forward is used in full.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from manoeuvring import drive

import tse

# four whole drives; tests/unit/filter/test_backwards.c has the rules by rows
pytestmark = pytest.mark.slow

WHEELS = ["wheel_speed_front", "wheel_speed_rear"]


@pytest.mark.parametrize("seed", [1, 3, 17])
def test_without_a_sign_of_the_wheels_as_much_is_valid_and_right(seed: int, tmp_path: Path) -> None:
    driven = drive(seed)
    (tmp_path / "car.toml").write_text(driven.car.vehicle(), encoding="utf-8")
    car, signed = tse.read_vehicle(tmp_path / "car.toml"), driven.log.copy()
    signed[WHEELS] = signed[WHEELS].mul(np.where(driven.speed < 0, -1.0, 1.0), axis=0)
    without, with_sign = (tse.estimate(log, car, calibrate=False) for log in (driven.log, signed))
    valid, true = without.valid[:, 1:], np.array([driven.car.front, driven.car.rear])
    wrong = valid & (np.abs(without.stiffness[:, 1:] / true - 1) > 0.1)
    assert without.warnings == () and valid.sum() > 0.95 * with_sign.valid[:, 1:].sum() > 0.25 * len(valid)
    assert wrong.sum() <= max(0.02 * valid.sum(), 1.05 * (with_sign.valid[:, 1:] & wrong).sum())
    fast = np.abs(driven.speed) > 3.2
    held = without.table["cy_front_reason"].astype(str).to_numpy() == "held"
    assert (held == (driven.speed < 0))[fast].all()


def test_a_drive_that_only_goes_forward_is_not_held(tmp_path: Path) -> None:
    driven = drive(2, forward=True)
    (tmp_path / "car.toml").write_text(driven.car.vehicle(), encoding="utf-8")
    table = tse.estimate(driven.log, tse.read_vehicle(tmp_path / "car.toml"), calibrate=False).table
    assert not (table["cy_front_reason"].astype(str) == "held")[driven.speed > 3.2].any()
