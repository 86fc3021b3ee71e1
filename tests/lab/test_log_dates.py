"""A log with the library's names whose time is a date or a time of day is read by every command, as `tselab signals` reads it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import tse
from conftest import tselab
from tselab.log import read_log


@pytest.mark.parametrize("form", ["%Y-%m-%dT%H:%M:%S.%f", "%Y-%m-%d %H:%M:%S.%f", "%H:%M:%S.%f"])
def test_times_in_words_are_times(form, tmp_path, drive):
    log = tse.simulate("double-lane-change", duration=10).log
    seconds = log["time"].to_numpy(float)
    time = pd.Timestamp("2024-05-01 12:00:00") + pd.to_timedelta(seconds, unit="s")
    log.assign(time=time.strftime(form)).to_csv(tmp_path / "dates.csv", index=False)
    log.to_csv(tmp_path / "seconds.csv", index=False)
    dates, plain = read_log(tmp_path / "dates.csv"), read_log(tmp_path / "seconds.csv")
    assert np.allclose(dates.time - dates.time[0], plain.time, atol=1e-6)
    for name in plain.data:
        assert np.array_equal(dates.data[name], plain.data[name]), name
    done = tselab("estimate", tmp_path / "dates.csv", "--vehicle", drive.vehicle, "--out", tmp_path / "est.csv")
    assert done.code in (0, 3, 4), done.err


def test_a_time_that_is_none_is_refused_as_before(tmp_path, drive):
    log = tse.simulate("double-lane-change", duration=2).log
    log.assign(time="soon").to_csv(tmp_path / "soon.csv", index=False)
    done = tselab("estimate", tmp_path / "soon.csv", "--vehicle", drive.vehicle)
    assert done.code == 2 and "column time" in done.err and "soon" in done.err
