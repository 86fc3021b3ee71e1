"""The two real logs, as they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from conftest import tselab

DATA = Path(__file__).parents[3] / "shared" / "data"
NOMINAL_RANGE = {"cx_front": (20e3, 800e3), "cy_front": (20e3, 500e3), "cy_rear": (20e3, 500e3)}


@pytest.mark.parametrize("name", ["rav4_comma2k19", "subaru_sti"])
def test_real_log_gives_finite_positive_plausible_stiffness(name, tmp_path):
    folder = DATA / name
    if not (folder / "data.csv").exists():
        pytest.skip(f"{name}: the real log is not beside this checkout")
    done = tselab(
        "estimate", folder / "data.csv", "--vehicle", folder / "vehicle.toml", "--report", "r.html", cwd=tmp_path
    )
    assert done.code == 0, done.err
    assert "filled in: cornering_stiffness_front" in done.out and "filled in: yaw_rate_sd" in done.out
    assert "filled in: wheel_noise_sd" in done.out
    est = pd.read_csv(tmp_path / "data.est.csv")
    assert len(est) == len(pd.read_csv(folder / "data.csv"))
    assert np.isfinite(est.select_dtypes("number").to_numpy()).all()
    for key, (low, high) in NOMINAL_RANGE.items():
        assert (est[key] > 0).all()
        assert est[key][est[f"{key}_valid"] == 1].between(low, high).all(), key
    assert "not excited" in done.out
