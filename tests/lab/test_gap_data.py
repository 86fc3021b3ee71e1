"""Logs in the gap workflow: informative rows, and the best stretches of long logs.

The choice is compared with the best of all choices, and made on a log that is straight
but for a minute.
"""

import json
import os
import sys
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from gap_logs import write_car, write_log
from tests.gap.runs import change_constant
from tse.car.vehicle import read_vehicle
from tse.channels.agree import read_agreeing
from tse.channels.log import read_log
from tse.estimation.estimate import write_table
from tse.gaps.catalogue import load_catalogue
from tse.gaps.fit import fit_parameters
from tse.gaps.infer import excerpt as ex
from tse.gaps.infer.hypotheses import NAME_AT
from tse.gaps.infer.naming import Named, name_effects
from tse.gaps.parallel import is_copy, run_in_processes
from tse.gaps.problem import STIFFNESS_PARAMETERS, Problem
from tse.gaps.run import workflow
from tse.identify.data import BURN_IN, prepare, prepare_all, simulate, smooth_values
from tse.library.core import Config, Replay
from tse.library.errors import UserError
from tse.log.noise import find_new_values
from tse.log.rows import MEASURES, CheckedLog, Reading
from tse.report.results import convert_to_plain

TIME = 0.005 * np.arange(4000)
SIGNAL = np.sin(1.7 * TIME) + 0.3 * np.sin(11.0 * TIME)


@pytest.mark.parametrize("hold", [2, 4, 10])
def test_a_slow_signal_held_in_a_fast_log_is_taken_where_it_is_new(hold: int) -> None:
    held = np.repeat(SIGNAL[3::hold], hold)[: len(TIME) - 3]
    held = np.append(np.full(3, SIGNAL[0]), held)
    found = find_new_values(held)
    assert found[1:].mean() == pytest.approx(1.0 / hold, abs=2e-3)
    np.testing.assert_array_equal(held[found][2:], SIGNAL[found][2:])
    late = np.abs(smooth_values(TIME, held) - SIGNAL)[50:-50].max()
    assert late < 0.003  # held as it is: late by half of the hold, 0.01 and more


def test_the_same_value_again_is_new_at_its_beat() -> None:
    slow = np.round(SIGNAL[::4], 1)
    assert find_new_values(np.repeat(slow, 4))[4:].mean() == pytest.approx(0.25, abs=0.01)


@pytest.mark.parametrize("step", [0.0, 0.01, 0.2])
def test_a_fast_signal_is_new_in_every_row_however_coarse(step: float) -> None:
    noisy = SIGNAL + 0.02 * np.random.default_rng(1).standard_normal(len(TIME))
    assert find_new_values(np.round(noisy / step) * step if step else noisy).all()


def test_a_sensor_that_stands_still_is_no_slow_one() -> None:
    stuck = SIGNAL.copy()
    stuck[1000:1300] = stuck[1000]
    assert find_new_values(stuck).all()
    assert find_new_values(np.zeros(100)).all()


def test_a_log_that_cannot_be_read_is_left_out_and_said(tmp_path):
    vehicle = write_car(tmp_path)
    good = write_log(tmp_path / "good.csv", vehicle, "sweep", {}, 1)
    (tmp_path / "bad.csv").write_text("no log\n")
    notes: list[str] = []
    turned = pd.read_csv(good).assign(accel_y=lambda t: -t["accel_y"])
    turned.to_csv(tmp_path / "turned.csv", index=False)
    found = read_agreeing(
        [tmp_path / "bad.csv", tmp_path / "turned.csv", good], notes, Reading(car=read_vehicle(vehicle))
    )
    assert [x.path.name for x in found] == ["good.csv"]
    assert len(notes) == 2 and all(n.startswith("left out: ") for n in notes) and "is no table" in notes[0]
    assert "channels contradict each other" in notes[1] and "accel_y is positive to the right" in notes[1]
    with pytest.raises(UserError, match="is no table"):
        read_agreeing([tmp_path / "bad.csv", tmp_path / "turned.csv"], [], Reading())


def test_a_sensor_that_a_log_does_not_have_is_not_asked(tmp_path):
    """The rest of it is compared as it was."""
    vehicle = write_car(tmp_path)
    whole = write_log(tmp_path / "whole.csv", vehicle, "sweep", {}, 1)
    table = pd.read_csv(whole)
    table.drop(columns="accel_x").to_csv(tmp_path / "without.csv", index=False, float_format="%.9g")
    table.assign(accel_x="").to_csv(tmp_path / "empty.csv", index=False, float_format="%.9g")
    config = Config.exact(read_vehicle(vehicle).values)
    paths = [whole, tmp_path / "without.csv", tmp_path / "empty.csv"]
    logs = [prepare(x, config) for x in read_agreeing(paths, [], Reading())]
    assert [log.channels for log in logs] == [
        ["accel_x", "accel_y", "yaw_rate"],
        ["accel_y", "yaw_rate"],
        ["accel_y", "yaw_rate"],
    ]
    assert "has no accel_x" in logs[1].notes[0] and "has no accel_x" in logs[2].notes[0]
    values = {"cx_front": 1.1, "cy_front": 0.92, "cy_rear": 1.06}
    of_all, of_some = (Problem([log], config) for log in logs[:2])
    for channel in ("accel_y", "yaw_rate"):
        both = (p.compute_residuals(values)[p.rows.of(channel)] for p in (of_all, of_some))
        np.testing.assert_allclose(*both, rtol=1e-6, atol=1e-6)


# ---- copies of the process


LINUX = pytest.mark.skipif(sys.platform != "linux", reason="processes are not copied elsewhere")


@pytest.mark.parametrize("jobs", [1, 2, 5])
def test_what_comes_back_is_in_order_and_of_closures(jobs: int) -> None:
    by = 3
    assert run_in_processes(jobs, lambda x: by * x, [4, 1, 2]) == [12, 3, 6]
    assert run_in_processes(jobs, lambda x: by * x, []) == [] and not is_copy()


@LINUX
def test_each_is_done_in_another_process_which_makes_no_more() -> None:
    found = run_in_processes(
        2, lambda _: (os.getpid(), is_copy(), run_in_processes(2, lambda _: os.getpid(), [0, 0])), [0, 0, 0]
    )
    assert all(pid != os.getpid() and copy and inner == [pid, pid] for pid, copy, inner in found)


@LINUX
def test_only_what_is_light_is_sent() -> None:
    assert run_in_processes(2, lambda x: (x, lambda: None), [1, 2], lambda pair: pair[0]) == [
        1,
        2,
    ]  # a function cannot be sent


def test_an_error_of_a_user_stays_one() -> None:
    def wrong(x: int) -> int:
        raise UserError(f"{x} is too much")

    with pytest.raises(UserError, match="is too much"):
        run_in_processes(2, wrong, [7, 8])


def test_pieces_are_chosen_about_as_well_as_by_trying_all():
    """Greedy choices reach 1 - 1/e of the best ln det (Nemhauser 1978).

    With eight random pieces they reach nearly all of it.
    """
    rng = np.random.default_rng(3)
    says = [(lambda a: a.T @ a)(rng.standard_normal((3, 4)) * rng.uniform(0.2, 3)) for _ in range(8)]

    def worth(chosen):
        return np.linalg.slogdet(np.eye(4) + sum(says[k] for k in chosen))[1]

    most = max(worth(c) for c in combinations(range(8), 3))
    chosen = ex.choose_best(says, [1.0] * 8, 3.0)
    assert len(chosen) == 3
    assert worth(chosen) > 0.9 * most


def test_what_was_shown_once_adds_less_than_what_was_not():
    turns, brakes = np.diag([100.0, 0.0]), np.diag([0.0, 30.0])
    assert ex.choose_best([turns, turns, brakes], [1.0] * 3, 2.0) == [0, 2]
    assert ex.choose_best([], [], 2.0) == []


@pytest.fixture(scope="module")
def long_log(tmp_path_factory):
    """Four minutes straight on, one of which is a slalom."""
    rng, n, config = np.random.default_rng(1), 24000, Config.exact()
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
    problem = Problem([prepare(long_log, Config.exact())], Config.exact())
    baseline = fit_parameters(problem, STIFFNESS_PARAMETERS, {})
    with change_constant("gaps.infer.excerpt.MAX_SECONDS", 60.0):
        assert ex.is_long(problem)
        few = ex.choose_excerpt(problem, baseline)
    log = few.logs[0]
    assert 60.0 <= sum(log.seconds for log in few.logs) < 80.0
    turning = np.abs(log.inputs["steer_angle"]) > 0.005
    used = np.concatenate([np.arange(s.first, s.last)[s.used] for s in log.stretches])
    assert turning[used].mean() > 3 * turning.mean()
    for s in log.stretches:  # each begins from a start of its own
        assert not s.used[: int(BURN_IN / 0.01)].any()


def test_a_log_that_is_hardly_longer_is_taken_as_it_is(long_log):
    problem = Problem([prepare(long_log, Config.exact())], Config.exact())
    with change_constant("gaps.infer.excerpt.MAX_SECONDS", 200.0):
        assert not ex.is_long(problem)
        assert ex.choose_excerpt(problem, fit_parameters(problem, STIFFNESS_PARAMETERS, {})) is problem


@pytest.mark.slow
def test_what_is_found_in_an_excerpt_is_fitted_to_all(tmp_path):
    """A car rolls in 48 s of log, of which 20 s are searched.

    The size of the roll and the residuals are those of all logs.
    """
    vehicle = write_car(tmp_path)
    logs = [
        write_log(tmp_path / f"{d}.csv", vehicle, d, {"body_roll_gain": 0.009}, k)
        for k, d in enumerate(("sweep", "brakes"))
    ]
    with change_constant("gaps.infer.excerpt.MAX_SECONDS", 20.0):
        result = workflow.run_workflow(logs, vehicle, jobs=2)
    assert any("uses the most informative" in n for n in result.notes)
    (named,) = result.as_json()["effects"]
    assert named["id"] == "body_roll"
    gain = named["parameters"]["gain"]
    assert gain["ci95"][0] < gain["value"] < gain["ci95"][1]
    assert gain["value"] == pytest.approx(
        0.009, rel=0.05
    )  # 44 s of log know it to a percent; forms are the same
    assert len(result.problem.logs) == 2 and sum(log.seconds for log in result.problem.logs) > 40.0
    assert all(after < 1.15 for after in result.fit_after.values())


# ---- what logs could show


STEPS = "steering steps to 3 m/s2, at 20 m/s"
LOG_SEED, HIDE_SEED = 11, 1


@dataclass
class Clean:
    """A log of a car without an effect, and the effects not visible in it."""

    vehicle: Path
    problem: Problem
    log: CheckedLog
    undetectable: dict[str, dict]

    def named_when_hidden(self, effect: str, times: float) -> list[Named]:
        told = self.undetectable[effect]
        size = {told["parameter"]: times * told["smallest"]}
        (log,), config, rng = self.problem.logs, self.problem.config, np.random.default_rng(HIDE_SEED)
        columns = {"time": log.time} | {k: self.log.data[k].to_numpy(float) for k in log.inputs}
        hidden = simulate(
            self.problem.make_config(size), log, MEASURES, self.problem.get_stiffness_ratios(size), {}
        )
        for c, x in hidden.items():
            bias = getattr(config, f"{c}_bias_sd") * rng.standard_normal()
            columns[c] = x + bias + getattr(config, f"{c}_sd") * rng.standard_normal(len(x))
        path = self.vehicle.parent / "hidden.csv"
        write_table(pd.DataFrame(columns), path)
        read, config = workflow.read_logs([path], read_vehicle(self.vehicle))
        return name_effects(Problem(prepare_all(read, config), config), list(load_catalogue().values())).named


@pytest.fixture(scope="module")
def clean(tmp_path_factory) -> Clean:
    folder = tmp_path_factory.mktemp("detect")
    vehicle = write_car(folder)
    log = write_log(folder / "steps.csv", vehicle, STEPS, {}, LOG_SEED, seconds=30.0)
    result = workflow.run_workflow([log], vehicle)
    assert result.verdict == "none"
    told = json.loads(json.dumps(convert_to_plain(result.as_json()), allow_nan=False))["undetectable"]
    read, _ = workflow.read_logs([log], read_vehicle(vehicle))
    return Clean(vehicle, result.problem, read[0], {d["id"]: d for d in told})


@pytest.mark.parametrize(
    "effect", [pytest.param("steering_ratio", marks=pytest.mark.slow), "lateral_load_transfer"]
)
def test_twice_the_smallest_size_is_named_and_half_of_it_is_not(clean, effect):
    """The evidence grows with the square of the size: 4 and 1/4 of what a name needs.

    With a quarter, a class of look-alikes may be above 90 % with one noise of ten, as
    with this one. None of its effects is by itself.
    """
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
        p = next(p for p in load_catalogue()[e].parameters if p.name == told["parameter"])
        assert told["smallest"] is None or told["smallest"] <= max(p.high, -p.low), e
