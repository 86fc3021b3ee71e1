"""The two real logs, as they are. Nobody knows their tyres: the ranges are of what a car has, not of what is right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from conftest import RAN, tselab_here

DATA = Path(__file__).parents[3] / "shared" / "data"
RANGE = {"cx_front": (30e3, 300e3), "cy_front": (40e3, 200e3), "cy_rear": (40e3, 200e3)}
ROWS = {"rav4_comma2k19": {None: 4799, 0.1: 600}, "subaru_sti": {None: 4513, 0.1: 902}}


@pytest.mark.parametrize(("name", "average"), [
    ("rav4_comma2k19", None), ("rav4_comma2k19", 0.1), ("subaru_sti", None), ("subaru_sti", 0.1),
])  # fmt: skip
def test_real_log_gives_finite_positive_plausible_stiffness(name, average, tmp_path):
    folder = DATA / name
    if not (folder / "data.csv").exists():
        pytest.skip(f"{name}: the real log is not beside this checkout")
    options = () if average is None else ("--average", average)
    found = []
    for seed in (1, 2):
        done = tselab_here("estimate", folder / "data.csv", "--vehicle", folder / "vehicle.toml", "--seed", seed, "--report",
                           "r.html", "--no-calibrate", *options, cwd=tmp_path)  # fmt: skip
        assert done.code in RAN, done.err
        assert "filled in: cornering_stiffness_front" in done.out and "filled in: [uncertainty] mass_sd" in done.out
        est = pd.read_csv(tmp_path / "data.est.csv")
        assert len(est) == ROWS[name][average]
        numbers = est.select_dtypes("number")
        assert np.isfinite(numbers.to_numpy()).all() and (est["bias_accel_x"].abs() < 2).all()
        for key, (low, high) in RANGE.items():
            assert (est[key] > 0).all()
            valid = est[key][est[f"{key}_valid"] == 1]
            assert valid.between(low, high).all(), key
        found.append(est)
    pd.testing.assert_frame_equal(*found)  # whatever the seed: nothing is drawn
    # there is always a stiffness that the log does not show; it is given with its interval all the same
    assert "not valid: " in done.out and done.out.count("(95 %), ") >= 4
