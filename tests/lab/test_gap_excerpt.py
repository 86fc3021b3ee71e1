"""Which stretches of long logs say most: against the best of all choices, and on a log that is straight but for a minute."""

import json
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from gap_logs import car, write_log
from tests.gap.runs import changed
from tse.impl.core import Config, Replay
from tse.impl.estimate import write_table
from tse.impl.gap.catalogue import catalogue
from tse.impl.gap.fit import fit
from tse.impl.gap.infer import excerpt as ex
from tse.impl.gap.infer.hypotheses import NAME_AT
from tse.impl.gap.infer.naming import Named, name
from tse.impl.gap.problem import STIFFNESS, Problem
from tse.impl.gap.run import workflow
from tse.impl.identify.data import BURN_IN, prepare, prepare_all
from tse.impl.identify.simulate import simulate
from tse.impl.logs.log import read_log
from tse.impl.results import plain
from tse.impl.rows import MEASURES, Log
from tse.impl.vehicle import read_vehicle


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
    with changed("gap.infer.excerpt.MOST_SECONDS", 60.0):
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
    with changed("gap.infer.excerpt.MOST_SECONDS", 200.0):
        assert not ex.is_long(problem)
        assert ex.excerpt(problem, fit(problem, STIFFNESS, {})) is problem


def test_what_is_found_in_an_excerpt_is_fitted_to_all(tmp_path):
    """A car that rolls, in 48 s of log, of which 20 are searched: its size is that of all logs, and so is what is left."""
    vehicle = car(tmp_path)
    logs = [write_log(tmp_path / f"{d}.csv", vehicle, d, {"body_roll_gain": 0.009}, k) for k, d in enumerate(("sweep", "brakes"))]
    with changed("gap.infer.excerpt.MOST_SECONDS", 20.0):
        result = workflow.run(logs, vehicle, jobs=2)
    assert any("s that say most" in n for n in result.notes)
    (named,) = result.as_json()["effects"]
    assert named["id"] == "body_roll"
    gain = named["parameters"]["gain"]
    assert gain["ci95"][0] < gain["value"] < gain["ci95"][1]
    assert gain["value"] == pytest.approx(0.009, rel=0.05)  # 44 s of log know it to a percent; forms are the same
    assert len(result.problem.logs) == 2 and sum(log.seconds for log in result.problem.logs) > 40.0
    assert all(after < 1.15 for after in result.fit_after.values())


# ---- what logs could show


STEPS = "steering steps to 3 m/s2, at 20 m/s"
LOG_SEED, HIDE_SEED = 11, 1


@dataclass
class Clean:
    """A log of a car that lacks nothing, and what its verdict says that it could not have shown."""

    vehicle: Path
    problem: Problem
    log: Log
    undetectable: dict[str, dict]

    def named_when_hidden(self, effect: str, times: float) -> list[Named]:
        told = self.undetectable[effect]
        size = {told["parameter"]: times * told["smallest"]}
        (log,), config, rng = self.problem.logs, self.problem.config, np.random.default_rng(HIDE_SEED)
        columns = {"time": log.time} | {k: self.log.data[k].to_numpy(float) for k in log.inputs}
        hidden = simulate(self.problem.model(size), log, MEASURES, self.problem.stiffness(size, 0), {})
        for c, x in hidden.items():
            bias = getattr(config, f"{c}_bias_sd") * rng.standard_normal()
            columns[c] = x + bias + getattr(config, f"{c}_sd") * rng.standard_normal(len(x))
        path = self.vehicle.parent / "hidden.csv"
        write_table(pd.DataFrame(columns), path)
        read, config = workflow.read([path], read_vehicle(self.vehicle))
        return name(Problem(prepare_all(read, config), config), list(catalogue().values())).named


@pytest.fixture(scope="module")
def clean(tmp_path_factory) -> Clean:
    folder = tmp_path_factory.mktemp("detect")
    vehicle = car(folder)
    log = write_log(folder / "steps.csv", vehicle, STEPS, {}, LOG_SEED, seconds=12.0)
    result = workflow.run([log], vehicle)
    assert result.verdict == "none"
    told = json.loads(json.dumps(plain(result.as_json()), allow_nan=False))["undetectable"]
    read, _ = workflow.read([log], read_vehicle(vehicle))
    return Clean(vehicle, result.problem, read[0], {d["id"]: d for d in told})


@pytest.mark.parametrize("effect", ["steering_ratio", "lateral_load_transfer"])
def test_twice_the_smallest_size_is_named_and_half_of_it_is_not(clean, effect):
    """Nats go with the square of the size: 4 and 1/4 of what a name needs. With a quarter, a class of look-alikes may be above 90 %
    in one noise of ten, as in this one; none of them is by itself."""
    told = clean.undetectable[effect]
    assert told["smallest"] > told["typical"]
    half = clean.named_when_hidden(effect, 0.5)
    assert all(n.look_alikes and n.probability < NAME_AT and n.effect.id != effect for n in half)
    named = clean.named_when_hidden(effect, 2.0)
    assert [n.effect.id for n in named] == [effect]
    assert named[0].values[told["parameter"]] == pytest.approx(2 * told["smallest"], rel=0.2)


def test_no_size_is_told_that_the_model_does_not_take(clean):
    """A slope over zero says of the longitudinal relaxation 6.6 m; the limit is 2 m."""
    assert clean.undetectable["longitudinal_relaxation"]["smallest"] is None
    for e, told in clean.undetectable.items():
        p = next(p for p in catalogue()[e].parameters if p.name == told["parameter"])
        assert told["smallest"] is None or told["smallest"] <= max(p.high, -p.low), e
