"""Which stretches of long logs say most: against the best of all choices, and on a log that is straight but for a minute."""

from itertools import combinations

import numpy as np
import pandas as pd
import pytest

from gap_logs import car, write_log
from tselab.core import Config, Replay
from tselab.gap import constants, workflow
from tselab.gap.data import BURN_IN, prepare
from tselab.gap.fit import fit
from tselab.gap.infer import excerpt as ex
from tselab.gap.problem import STIFFNESS, Problem
from tselab.log import read_log
from tselab.rows import MEASURES


def test_pieces_are_chosen_about_as_well_as_by_trying_all():
    """Greedy choices reach 1 - 1/e of the best ln det (Nemhauser 1978); of eight random pieces, nearly all of it."""
    rng = np.random.default_rng(3)
    says = [(lambda a: a.T @ a)(rng.standard_normal((3, 4)) * rng.uniform(0.2, 3)) for _ in range(8)]

    def worth(chosen):
        return np.linalg.slogdet(np.eye(4) + sum(says[k] for k in chosen))[1]

    most = max(worth(c) for c in combinations(range(8), 3))
    chosen = ex.best(says, [1.0] * 8, 3.0)
    assert len(chosen) == 3
    assert worth(chosen) > 0.9 * most


def test_what_was_shown_once_adds_less_than_what_was_not():
    turns, brakes = np.diag([100.0, 0.0]), np.diag([0.0, 30.0])
    assert ex.best([turns, turns, brakes], [1.0] * 3, 2.0) == [0, 2]
    assert ex.best([], [], 2.0) == []


@pytest.fixture(scope="module")
def long_log(tmp_path_factory):
    """Four minutes straight on, one of which is a slalom."""
    rng, n, config = np.random.default_rng(1), 24000, Config()
    time = 0.01 * np.arange(n)
    steer = np.where((time > 100) & (time < 160), 0.02 * np.sin(1.5 * time), 0.0)
    wheel = np.full(n, 20.0 / config.wheel_radius_front)
    inputs = {
        "steer_angle": steer,
        "wheel_speed_front": wheel,
        "wheel_speed_rear": wheel * config.wheel_radius_front / config.wheel_radius_rear,
    }
    out = Replay(MEASURES, dt=np.full(n, 0.01), **inputs).run(config)
    noise = {"steer_angle": 1e-4, "wheel_speed_front": 0.01, "wheel_speed_rear": 0.01, "yaw_rate": 2e-3}
    columns = {k: x + noise.get(k, 0.05) * rng.standard_normal(n) for k, x in (inputs | out).items()}
    path = tmp_path_factory.mktemp("long") / "log.csv"
    pd.DataFrame({"time": time} | columns).to_csv(path, index=False, float_format="%.9g")
    return read_log(path, MEASURES)


def test_the_part_with_the_bends_is_chosen(long_log):
    problem = Problem([prepare(long_log, Config())], Config())
    baseline = fit(problem, STIFFNESS, {})
    with constants.changed("excerpt.MOST_SECONDS", 60.0):
        assert ex.is_long(problem)
        few = ex.excerpt(problem, baseline)
    log = few.logs[0]
    assert 60.0 <= sum(log.seconds for log in few.logs) < 80.0
    turning = np.abs(log.inputs["steer_angle"]) > 0.005
    used = np.concatenate([np.arange(s.first, s.last)[s.used] for s in log.stretches])
    assert turning[used].mean() > 3 * turning.mean()
    for s in log.stretches:  # each begins from a start of its own
        assert not s.used[: int(BURN_IN / 0.01)].any()


def test_a_log_that_is_hardly_longer_is_taken_as_it_is(long_log):
    problem = Problem([prepare(long_log, Config())], Config())
    with constants.changed("excerpt.MOST_SECONDS", 200.0):
        assert not ex.is_long(problem)
        assert ex.excerpt(problem, fit(problem, STIFFNESS, {})) is problem


def test_what_is_found_in_an_excerpt_is_fitted_to_all(tmp_path):
    """A car that rolls, in 48 s of log, of which 20 are searched: its size is that of all logs, and so is what is left."""
    vehicle = car(tmp_path)
    logs = [
        write_log(tmp_path / f"{d}.csv", vehicle, d, {"body_roll_gain": 0.009}, k)
        for k, d in enumerate(("sweep", "brakes"))
    ]
    with constants.changed("excerpt.MOST_SECONDS", 20.0):
        result = workflow.run(logs, vehicle, tmp_path / "out", jobs=2)
    assert any("s that say most" in n for n in result.notes)
    (named,) = result.as_json()["effects"]
    assert named["id"] == "body_roll"
    gain = named["parameters"]["gain"]
    assert gain["ci95"][0] < gain["value"] < gain["ci95"][1]
    assert gain["value"] == pytest.approx(0.009, rel=0.05)  # 44 s of log know it to a percent; forms are the same
    assert len(result.problem.logs) == 2 and sum(log.seconds for log in result.problem.logs) > 40.0
    assert all(after < 1.15 for after in result.fit_after.values())
