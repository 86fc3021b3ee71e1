"""Logs as the gap workflow takes them: which rows hold something new."""

import os
import sys

import numpy as np
import pandas as pd
import pytest

from gap_logs import car, write_log
from tse.impl.core import Config
from tse.impl.errors import UserError
from tse.impl.gap.parallel import apart, is_copy
from tse.impl.gap.problem import Problem
from tse.impl.identify.data import fresh, prepare, smoothed
from tse.impl.logs.agree import read_agreeing
from tse.impl.rows import Reading
from tse.impl.vehicle import read_vehicle

TIME = 0.005 * np.arange(4000)
SIGNAL = np.sin(1.7 * TIME) + 0.3 * np.sin(11.0 * TIME)


@pytest.mark.parametrize("hold", [2, 4, 10])
def test_a_slow_signal_held_in_a_fast_log_is_taken_where_it_is_new(hold: int) -> None:
    held = np.repeat(SIGNAL[3::hold], hold)[: len(TIME) - 3]
    held = np.append(np.full(3, SIGNAL[0]), held)
    found = fresh(held)
    assert found[1:].mean() == pytest.approx(1.0 / hold, abs=2e-3)
    np.testing.assert_array_equal(held[found][2:], SIGNAL[found][2:])
    late = np.abs(smoothed(TIME, held) - SIGNAL)[50:-50].max()
    assert late < 0.003  # held as it is: late by half of the hold, 0.01 and more


def test_the_same_value_again_is_new_at_its_beat() -> None:
    slow = np.round(SIGNAL[::4], 1)
    assert fresh(np.repeat(slow, 4))[4:].mean() == pytest.approx(0.25, abs=0.01)


@pytest.mark.parametrize("step", [0.0, 0.01, 0.2])
def test_a_fast_signal_is_new_in_every_row_however_coarse(step: float) -> None:
    noisy = SIGNAL + 0.02 * np.random.default_rng(1).standard_normal(len(TIME))
    assert fresh(np.round(noisy / step) * step if step else noisy).all()


def test_a_sensor_that_stands_still_is_no_slow_one() -> None:
    stuck = SIGNAL.copy()
    stuck[1000:1300] = stuck[1000]
    assert fresh(stuck).all()
    assert fresh(np.zeros(100)).all()


def test_a_log_that_cannot_be_read_is_left_out_and_said(tmp_path):
    vehicle = car(tmp_path)
    good = write_log(tmp_path / "good.csv", vehicle, "sweep", {}, 1)
    (tmp_path / "bad.csv").write_text("no log\n")
    notes: list[str] = []
    turned = pd.read_csv(good).assign(accel_y=lambda t: -t["accel_y"])
    turned.to_csv(tmp_path / "turned.csv", index=False)
    found = read_agreeing([tmp_path / "bad.csv", tmp_path / "turned.csv", good], notes, Reading(car=read_vehicle(vehicle)))
    assert [x.path.name for x in found] == ["good.csv"]
    assert len(notes) == 2 and all(n.startswith("left out: ") for n in notes) and "is no table" in notes[0]
    assert "nothing is learnt from it" in notes[1] and "accel_y is positive to the right" in notes[1]
    with pytest.raises(UserError, match="is no table"):
        read_agreeing([tmp_path / "bad.csv", tmp_path / "turned.csv"], [], Reading())


def test_a_sensor_that_a_log_does_not_have_is_not_asked(tmp_path):
    """The rest of it is compared as it was."""
    vehicle = car(tmp_path)
    whole = write_log(tmp_path / "whole.csv", vehicle, "sweep", {}, 1)
    table = pd.read_csv(whole)
    table.drop(columns="accel_x").to_csv(tmp_path / "without.csv", index=False, float_format="%.9g")
    table.assign(accel_x="").to_csv(tmp_path / "empty.csv", index=False, float_format="%.9g")
    config = Config(read_vehicle(vehicle).values)
    paths = [whole, tmp_path / "without.csv", tmp_path / "empty.csv"]
    logs = [prepare(x, config) for x in read_agreeing(paths, [], Reading())]
    assert [log.channels for log in logs] == [["accel_x", "accel_y", "yaw_rate"], ["accel_y", "yaw_rate"], ["accel_y", "yaw_rate"]]
    assert "without accel_x" in logs[1].notes[0] and "without accel_x" in logs[2].notes[0]
    values = {"cx_front": 1.1, "cy_front": 0.92, "cy_rear": 1.06}
    of_all, of_some = (Problem([log], config) for log in logs[:2])
    for channel in ("accel_y", "yaw_rate"):
        both = (p.residuals(values)[p.rows.of(channel)] for p in (of_all, of_some))
        np.testing.assert_allclose(*both, rtol=1e-6, atol=1e-6)


# ---- copies of the process


LINUX = pytest.mark.skipif(sys.platform != "linux", reason="processes are not copied elsewhere")


@pytest.mark.parametrize("jobs", [1, 2, 5])
def test_what_comes_back_is_in_order_and_of_closures(jobs: int) -> None:
    by = 3
    assert apart(jobs, lambda x: by * x, [4, 1, 2]) == [12, 3, 6]
    assert apart(jobs, lambda x: by * x, []) == [] and not is_copy()


@LINUX
def test_each_is_done_in_another_process_which_makes_no_more() -> None:
    found = apart(2, lambda _: (os.getpid(), is_copy(), apart(2, lambda _: os.getpid(), [0, 0])), [0, 0, 0])
    assert all(pid != os.getpid() and copy and inner == [pid, pid] for pid, copy, inner in found)


@LINUX
def test_only_what_is_light_is_sent() -> None:
    assert apart(2, lambda x: (x, lambda: None), [1, 2], lambda pair: pair[0]) == [1, 2]  # a function cannot be sent


def test_an_error_of_a_user_stays_one() -> None:
    def wrong(x: int) -> int:
        raise UserError(f"{x} is too much")

    with pytest.raises(UserError, match="is too much"):
        apart(2, wrong, [7, 8])
