"""Monte-Carlo studies: the scores, kept runs, and a small seeded part of each study.

Foreign runs are refused, and every way of running gives the same numbers.
"""

import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from conftest import COMMAND, tselab, tselab_here
from tse.library.core import INPUT, OUTPUT, REASON, SIM_OUTPUT, STIFFNESS, Config, SimConfig, library
from tse.library.errors import UserError
from tselab.montecarlo import STUDIES, engine, estimators, scores, studies, summary
from tselab.montecarlo.case import Case, CaseDrive, simulate_case
from tselab.montecarlo.pictures import write_study


def make_plan(study: str, *cases: str, runs: int = 1, **more) -> engine.StudyPlan:
    return engine.StudyPlan(studies.make_study(study, cases), runs, **more)


def drive_case(case: Case, seed: int = 1, **sim: float) -> CaseDrive:
    p = make_plan("stress")
    return simulate_case(case, seed, lambda about: engine.configure_unit("tse", p, about), sim)


def drop_times(table: pd.DataFrame) -> pd.DataFrame:
    return table.drop(columns=engine.TIMES)


# ---- scores, against arrays whose answer is seen by eye


def test_running_mean_is_the_mean_at_first_and_fades_later():
    x = np.array([1.0, 3.0, 5.0, 1.0])
    assert scores.compute_running_mean(x, 2.0) == pytest.approx([1, 2, 3.5, 2.25])  # gains 1, 1/2, 1/2, 1/2
    assert scores.compute_running_mean(x, 10.0) == pytest.approx([1, 2, 3, 2.5])


def test_longest_run_is_counted():
    assert (
        scores.find_longest_run(np.array([0, 1, 1, 0, 1, 1, 1], bool)) == 3
        and scores.find_longest_run(np.zeros(4, bool)) == 0
    )


def test_interval_of_a_share_is_clopper_pearson():
    assert summary.compute_clopper_pearson(0, 60) == (0, pytest.approx(1 - 0.025 ** (1 / 60)))


def test_best_sd_is_that_of_a_mean_over_the_memory():
    n, memory = 4000, 100.0
    spread = np.full(n, 0.05)
    waves = np.where(np.arange(n) % 2, 3.0, -3.0)
    every = np.ones(n, bool)
    sd = scores.compute_best_sd(waves, every, spread, memory)
    assert sd[-1] == pytest.approx(np.sqrt((1 + 9 * 0.05**2) / (memory * 9)), rel=1e-3)
    assert np.isinf(
        scores.compute_best_sd(np.full(n, 3.0), every, spread, memory)[-1]
    )  # constant: never seen
    held = every.copy()
    held[1000:2000] = False
    sd = scores.compute_best_sd(waves, held, spread, memory)
    assert np.isinf(sd[1000:2000]).all() and np.isfinite(sd[2000:]).all()


def test_a_stretch_is_wrong_on_end_for_as_many_rows_as_are_judged_in_it():
    wrong = np.array([1, 1, 1, 1, 0, 1, 1, 1], bool)
    judged = np.array([1, 0, 0, 1, 1, 1, 1, 1], bool)
    assert scores.count_wrong_rows(wrong, judged) == 3  # 2 of the first four, 3 of the last three
    assert scores.count_wrong_rows(wrong, ~judged) == 2
    assert scores.count_wrong_rows(np.zeros(8, bool), judged) == 0


def test_settling_is_the_time_until_the_error_stays_small_for_a_while_or_for_good():
    t = np.arange(8.0)
    error = np.array([0.3, 0.05, 0.3, 0.02, 0.02, 0.5, 0.05, 0.0])
    for hold, (first, good) in {1.0: (1, 1), 1.5: (3, 3), 2.5: (3, 6), np.inf: (3, 6)}.items():
        assert scores.compute_settling_time(t, error, 0.0, 5.0, hold) == first  # what lasts to the end lasts
        assert scores.compute_settling_time(t, error, 0.0, np.inf, hold) == good
    for hold in (1.0, np.inf):
        assert scores.compute_settling_time(t, error, 3.0, 5.0, hold) == 0
        assert scores.compute_settling_time(t, np.full(8, np.nan), 0.0, np.inf, hold) == np.inf
        assert scores.compute_settling_time(t, np.full(8, 0.05), 0.0, np.inf, hold) == 0
    assert scores.compute_settling_time(t, error, 3.0, 6.0) == 0  # 2 s, and then off once more
    assert scores.compute_settling_time(t, error, 3.0, 6.0, np.inf) == np.inf
    assert scores.compute_settling_time(t, error, 5.0, 6.0) == np.inf


def test_after_waits_from_the_last_moment():
    t = np.arange(0, 10, 1.0)
    settled = scores.find_rows_after(t, np.array([0.0, 4.5, 5.0]), 3.0)
    assert list(np.flatnonzero(settled)) == [3, 4, 8, 9]


ROWS, STEP = 401, 0.1
CODES = {f.name: code for code, f in library().codes(REASON).items()}


def make_constant_drive(
    rows: int, names: np.dtype, event: float
) -> tuple[CaseDrive, Case, scores.Knowable, np.ndarray]:
    """Return rows of a known truth of 0.8, with an estimate that is right, and an event.

    The estimate is valid, and its sd is 1 %.
    """
    time_ = np.round(np.arange(rows) * STEP, 9)
    truth, estimate = np.zeros(rows, library().dtype(SIM_OUTPUT)), np.zeros(rows, names)
    for key in STIFFNESS:
        truth[f"true_{key}"] = estimate[key] = 0.8
        estimate[f"{key}_sd"] = 0.008
    inputs = np.zeros(rows, library().dtype(INPUT))
    inputs["dt"] = STEP
    config, no = Config.exact({"sample_time": STEP}), np.zeros(rows, bool)
    d = CaseDrive(time_, inputs, truth, np.ones(rows), no, {}, config, config, SimConfig())
    known = scores.Knowable(
        np.full((rows, 3), 0.01), d.stiffness, no.copy(), no.copy(), time_ >= 10, config.valid_sd
    )
    return d, Case("still", "", None, events=(event,)), known, estimate


@pytest.fixture
def still() -> tuple[CaseDrive, Case, scores.Knowable, np.ndarray]:
    """40 s, with a spread of 5 % that is seen from 20 s on."""
    d, case, known, estimate = make_constant_drive(ROWS, library().dtype(OUTPUT), 20.0)
    for key in STIFFNESS:
        estimate[f"{key}_spread"] = 0.04
        estimate[f"{key}_spread_seen"][200:] = 1
    estimate["noise_accel_y"] = 2.0
    return d, case, known, estimate


def test_a_right_estimate_scores_nothing(still):
    row = scores.score_run(*still)
    assert row["diverged"] == row["diverged_any"] == 0
    assert (row["noise_accel_x"], row["noise_accel_y"], row["noise_yaw_rate"]) == (0, 2, 0)
    for key in STIFFNESS:
        assert row[f"{key}_mean_square"] == pytest.approx(0, abs=1e-20)
        assert row[f"{key}_covered"] == 100
        assert row[f"{key}_spread"] == pytest.approx(5)  # 0.04 of 0.8
        assert row[f"{key}_spread_seen"] == pytest.approx(100 * 101 / 151)  # of 15 .. 30 s that from 20 s on
        for n in (0, 1):
            assert row[f"{key}_settle_{n}"] == row[f"{key}_stay_{n}"] == 0
        assert row[f"{key}_false_valid"] == 0 and row[f"{key}_false_valid_of"] == ROWS - 50  # from 5 s on
        assert (
            row[f"{key}_false_invalid"] == 0 and row[f"{key}_false_invalid_of"] == ROWS - 100
        )  # from 10 s on


def test_error_bias_and_coverage_are_those_of_the_window(still):
    d, case, known, estimate = still
    inside = (d.time >= 15) & (d.time <= 30)
    estimate["cy_front"][inside] = 0.8 * 1.03
    estimate["cy_front"][~inside] = 5.0
    estimate["cy_rear"][inside] = np.where(
        np.arange(inside.sum()) % 2, 0.8 * 1.01, 0.8 * 0.97
    )  # 76 of 151 rows
    row = scores.score_run(d, case, known, estimate)
    assert row["cy_front_mean_square"] == pytest.approx(9)
    assert row["cy_front_bias"] == pytest.approx(3)
    assert row["cy_front_covered"] == 0  # 3 % is beyond 1.96 times 1 %
    assert row["cy_rear_covered"] == pytest.approx(100 * 75 / 151)
    assert row["cy_rear_mean_square"] == pytest.approx((76 * 9 + 75 * 1) / 151)


def test_diverged_counts_only_what_could_be_known(still):
    d, case, known, estimate = still
    wrong = (d.time > 30) & (d.time < 33.05)  # 30 rows, 3 s
    estimate["cx_front"][wrong] = 0.8 * 1.25
    row = scores.score_run(d, case, known, estimate)
    assert (
        row["diverged"] == row["cx_front_diverged"] == row["diverged_any"] == 1
        and row["cy_rear_diverged"] == 0
    )
    assert row["cx_front_worst"] == pytest.approx(25)

    dark = replace(known, best_sd=np.where(wrong[:, None], 1.0, known.best_sd))
    row = scores.score_run(d, case, dark, estimate)
    assert (row["diverged"], row["diverged_any"]) == (0, 1)
    for name in ("corrupted", "beyond"):
        row = scores.score_run(d, case, replace(known, **{name: wrong}), estimate)
        assert (row["diverged"], row["diverged_any"]) == (0, 1), name
    row = scores.score_run(d, case, replace(known, settled=d.time >= 40), estimate)
    assert (row["diverged"], row["diverged_any"]) == (0, 0)

    estimate["cx_front"][d.time > 32.0] = 0.8  # shorter than 2 s: not on end
    assert scores.score_run(d, case, known, estimate)["diverged_any"] == 0
    estimate["cx_front"][d.time > 30] = np.nan  # no estimate is a wrong one
    assert scores.score_run(d, case, known, estimate)["diverged"] == 1


def test_valid_flag_and_reason_are_held_against_what_could_be_known(still):
    d, case, known, estimate = still
    estimate["cx_front"][:100] = 0.5  # valid and wrong; 50 rows of it after 5 s
    estimate["cy_front_valid"][200:230] = CODES["uncertain"]  # not valid, and right
    estimate["cy_front_valid"][230:240] = CODES["sensor fault"]
    estimate["cy_rear_valid"][300:320] = CODES["not excited"]
    estimate["cy_rear_valid"][320:325] = CODES["sensor fault"]
    best = known.best_sd.copy()
    best[300:335, 2] = 1.0  # nothing shows cy_rear: 20 rows say so, 5 say something else, 5 claim to know
    corrupted = known.corrupted.copy()
    corrupted[235:245] = corrupted[330:335] = True  # the last 5 of them are corrupted besides
    row = scores.score_run(d, case, replace(known, best_sd=best, corrupted=corrupted), estimate)
    assert (row["cx_front_false_valid"], row["cx_front_false_valid_of"]) == (50, ROWS - 50)
    assert (row["cy_front_false_invalid"], row["cy_front_false_invalid_of"]) == (35, ROWS - 100 - 15)
    assert (row["cy_front_corrupted_reported"], row["cy_front_corrupted_reported_of"]) == (5, 15)
    estimate["status"][240:243] = library().status(
        "TSE_W_MISSING_CHANNEL"
    )  # valid by the others, and says so
    estimate["status"][243] = library().status("TSE_W_RECOVERED")
    again = scores.score_run(d, case, replace(known, best_sd=best, corrupted=corrupted), estimate)
    assert again["cy_front_corrupted_reported"] == 8
    assert (row["cy_rear_reason_right"], row["cy_rear_reason_right_of"]) == (20, 30)
    assert row["cy_rear_valid_unobservable"] == 5
    assert row["cy_rear_false_invalid"] == 0  # where nothing shows it, 'not valid' is right


def test_grey_is_neither_observable_nor_unobservable(still):
    known = still[2]
    for sd, seen, unseen in (
        (0.049, True, False),
        (0.051, False, False),
        (0.199, False, False),
        (0.201, False, True),
    ):
        at = replace(known, best_sd=np.full((ROWS, 3), sd), level=np.ones((ROWS, 3)))  # valid_sd is 0.1
        assert (at.observable == seen).all() and (at.unobservable == unseen).all(), sd
    # 0.045 of nominal is 15 % of a truth of 0.3: not clearly enough to tell 20 % by
    low = replace(known, best_sd=np.full((ROWS, 3), 0.045), level=np.full((ROWS, 3), 0.3))
    assert not low.observable.any() and replace(low, level=np.ones((ROWS, 3))).observable.all()


def test_regressors_are_what_the_accelerometer_feels():
    quiet = {"noise": 1.0, **dict.fromkeys(studies.SPREADS, 0.0)}
    d = drive_case(replace(studies.NOMINAL_CASE, build=studies._make_square_waves(5.0), sim=quiet))
    phi, use = scores.compute_regressors(d)
    c, steer = d.config, d.truth["steer_angle"]
    x, y = c.accel_x_sd * phi[:, 0], c.accel_y_sd * phi[:, 1:].sum(axis=1)
    front_y = c.accel_y_sd * phi[:, 1]
    assert d.truth["true_accel_x"] == pytest.approx(x - front_y * steer, abs=1e-9)
    assert d.truth["true_accel_y"] == pytest.approx(
        y + x * steer, abs=0.03
    )  # x holds the rear wheels' part, too
    assert not use.any()


# ---- cases


def test_low_excitation_has_half_a_percent_of_slip():
    quiet = dict.fromkeys(studies.SPREADS, 0.0)
    d = drive_case(replace(studies.LOW, sim=quiet))
    t = d.truth
    roll = d.config.wheel_radius_front * t["true_wheel_speed_front"]
    slip = (roll - t["true_vel_x"]) / np.maximum(roll, t["true_vel_x"])
    settled = (d.time % 2.5 > 1.0) & (d.time % 2.5 < 2.4)
    assert np.abs(slip[settled]) == pytest.approx(studies.LOW_SLIP, rel=0.03)
    assert np.abs(t["steer_angle"]).max() == studies.LOW_STEER


@pytest.mark.parametrize("kind", ["drop_channel", "freeze_channel"])
def test_a_corruption_of_each_length_and_nothing_else(kind):
    t = np.round(np.arange(0, studies.SLOTS_END, 0.01), 9)
    clean = np.zeros(len(t), library().dtype(INPUT))
    for name in ("accel_x", "accel_y"):
        clean[name] = np.random.default_rng(0).standard_normal(len(t))
    rows = clean.copy()
    hit = getattr(studies, kind)(t, rows, np.random.default_rng(1), "accel_x")
    edges = np.flatnonzero(np.diff(hit.astype(int))) + 1
    lengths = sorted((edges[1::2] - edges[::2]) * 0.01)
    assert lengths == pytest.approx(studies.LENGTHS, abs=0.011)
    assert (edges[2::2] - edges[1:-1:2]).min() * 0.01 > scores.SETTLE_AFTER + 2  # time to judge what it left
    assert (rows["accel_y"] == clean["accel_y"]).all() and (
        rows["accel_x"][~hit] == clean["accel_x"][~hit]
    ).all()
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        part = rows["accel_x"][a:b]
        assert np.isnan(part).all() if kind == "drop_channel" else (part == clean["accel_x"][a - 1]).all()
    again = clean.copy()
    assert (getattr(studies, kind)(t, again, np.random.default_rng(2), "accel_x") != hit).any()


def test_outliers_hit_one_in_a_hundred():
    rows = np.zeros(20000, library().dtype(INPUT))
    unusable = studies.add_outliers(np.arange(20000.0), rows, np.random.default_rng(1), 0.01, 10.0)
    assert not unusable.any() and not rows["steer_angle"].any()
    for name in ("accel_x", "accel_y", "yaw_rate"):
        hit = rows[name] != 0
        assert hit.sum() == pytest.approx(200, abs=60)
        assert np.abs(rows[name][hit]) == pytest.approx(10 * getattr(Config.exact(), f"{name}_sd"))
        assert abs((rows[name][hit] > 0).mean() - 0.5) < 0.15


def test_every_stress_case_can_be_driven_and_looks_at_rows_it_has():
    for case in studies.make_study("stress").cases:
        if case.name.startswith("stuck-") or case.name in ("highway", "stop-and-go"):
            continue  # as dropout-; long
        d = drive_case(case, 3)
        assert np.isfinite([d.truth[n] for n in ("true_vel_x", "true_vel_y", "true_yaw_rate")]).all(), (
            case.name
        )
        assert scores.find_rows_inside(d.time, case.windows).any() and max((*case.events, 0)) < d.time[-1], (
            case.name
        )
        assert np.abs(d.truth["true_vel_y"]).max() < 3, case.name  # nobody spins
        known = scores.find_knowable(d, case)
        assert known.judged[:, 0].any(), case.name  # else divergence could not be seen


def test_reverse_drives_backwards_and_is_logged_so():
    d = drive_case(studies.make_study("stress", ("reverse",)).cases[0])
    assert d.truth["true_vel_x"].min() < -2.5 and d.rows["wheel_speed_front"].min() < -5
    assert np.isinf(scores.find_knowable(d, studies.NOMINAL_CASE).best_sd[d.truth["true_vel_x"] < -0.5]).all()


def test_the_brakes_of_an_open_loop_manoeuvre_reach_the_wheels():
    lock = next(c for c in studies._make_cases()["stress"] if c.name == "wheel-lock")
    d = drive_case(replace(lock, sim={}))  # tyres without a limit: no wheel locks, but the car slows down
    start, end = np.searchsorted(d.time, [studies.PULSES[0], studies.PULSES[0] + studies.LOCK_FOR])
    assert d.truth["true_vel_x"][start] - d.truth["true_vel_x"][end] > 3


def test_wheels_lock_and_spin_for_about_a_second():
    for case in studies.make_study("stress", ("wheel-lock", "wheel-spin")).cases:
        t = (d := drive_case(case)).truth
        roll = d.car.wheel_radius_front * t["true_wheel_speed_front"]
        slip = np.abs(roll - t["true_vel_x"]) / np.maximum(roll, t["true_vel_x"])
        for start in studies.PULSES:
            long = 0.01 * (slip[(d.time >= start) & (d.time < start + 3)] > 0.5).sum()
            assert 0.7 < long < 1.3, case.name
        assert t["true_vel_x"].min() > 10 and t["true_vel_x"].max() < 30, case.name  # the speed is taken back


def test_the_truth_of_tyres_that_saturate_is_their_secant():
    assert scores.compute_grip(np.array([0.0, 0.3, 3.0, 6.0])) == pytest.approx(
        [1, 1 - 0.1 + 0.01 / 3, 1 / 3, 1 / 6]
    )
    quiet = {"noise": 1.0, "friction": 0.9, **dict.fromkeys(studies.SPREADS, 0.0)}
    d = drive_case(replace(studies.NOMINAL_CASE, sim=quiet))
    phi, use = scores.compute_regressors(d)
    c, rows = d.car, slice(1500, 3000)
    force_y = (c.accel_y_sd * phi[:, 1:] * scores.compute_grip(use)).sum(
        axis=1
    )  # no other stiffness explains what is felt
    x = c.accel_x_sd * phi[:, 0] * scores.compute_grip(use[:, 0])
    assert d.truth["true_accel_y"][rows] == pytest.approx(
        (force_y + x * d.truth["steer_angle"])[rows], abs=0.03
    )
    level = scores.find_knowable(d, studies.NOMINAL_CASE).level[rows]
    assert ((level > 0.8) & (level < 0.96)).all() and level[:, 2].mean() > level[
        :, 1
    ].mean()  # drive and steering in front
    one = np.ones(len(use), bool)
    assert (scores.compute_felt_stiffness(d.stiffness, phi, 0 * use, one, 100.0) == d.stiffness).all()
    alone = np.zeros_like(use)
    alone[:, 1] = 0.3
    assert scores.compute_felt_stiffness(d.stiffness, phi, alone, one, 100.0)[rows, 2] == pytest.approx(
        1 - 0.1 + 0.01 / 3
    )
    alone[2000:, 1] = 5.0  # beyond: nobody should learn from it
    assert scores.compute_felt_stiffness(d.stiffness, phi, alone, one, 100.0)[rows, 2] == pytest.approx(
        1 - 0.1 + 0.01 / 3
    )


def test_nothing_is_judged_before_two_memories_are_full():
    for name, first in (("nominal", scores.SETTLE_AFTER), ("forgetting-0.999", 20.0)):
        case = studies.make_study("stress", (name,)).cases[0]
        d = drive_case(case)
        settled = scores.find_knowable(d, case).settled
        assert d.time[settled.argmax()] == pytest.approx(first) and min(a for a, _ in case.windows) >= 15


def test_what_a_case_is_about_wins_over_the_users_settings():
    p = make_plan("stress", "forgetting-0.98", settings={"forgetting": 0.995, "particles": 64})
    about = p.study.cases[0].config
    config = engine.configure_unit("tse", p, about)
    assert (config.forgetting, config.particles, config.initial_cx_front) == (0.98, 64, 0.7)
    assert engine.configure_unit("robust-100", p, about).particles == 100
    robust, printed = (engine.configure_unit(name, p, about) for name in ("robust", "printed"))
    assert (
        (robust.form, printed.form) == (1, 1)
        and robust.forgetting_mean == 0.98
        and printed.initial_vel_x == 22
    )
    with pytest.raises(UserError, match="no estimator 'nonsense'"):
        engine.configure_unit("nonsense", p, about)


# ---- all runs


def test_runs_go_on_after_a_stop_and_a_cut_line(tmp_path, monkeypatch):
    p = make_plan("stress", "nominal", "outliers", runs=2, settings={"particles": 32})
    whole = drop_times(engine.run_study(p, tmp_path / "whole"))
    assert list(whole["seed"]) == [1, 2, 1, 2] and list(whole["case"]) == ["nominal"] * 2 + ["outliers"] * 2

    real, done = engine.run_unit, []

    def stops(unit):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(unit)
        return real(unit)

    monkeypatch.setattr(engine, "run_unit", stops)
    with pytest.raises(engine.Interrupted, match=r"keeps the 2 of 4 runs .* the same command continues"):
        engine.run_study(p, tmp_path / "cut")
    path = tmp_path / "cut" / engine.RUNS
    path.write_bytes(path.read_bytes()[:-20])  # the second run is cut
    done.clear()
    monkeypatch.setattr(engine, "run_unit", lambda unit: done.append(unit) or real(unit))
    assert drop_times(engine.run_study(p, tmp_path / "cut")).equals(whole)
    assert [(u.case, u.seed) for u in done] == [("nominal", 2), ("outliers", 1), ("outliers", 2)]
    done.clear()
    more = drop_times(
        engine.run_study(replace(p, runs=3), tmp_path / "cut")
    )  # more runs are added to what is there
    assert [u.seed for u in done] == [3, 3] and drop_times(engine.run_study(p, tmp_path / "cut")).equals(
        whole
    )
    assert len(more) == 6


def test_runs_of_other_settings_or_code_are_not_taken_and_stay_for_their_own(tmp_path, monkeypatch):
    p = make_plan("stress", "nominal", settings={"particles": 32}, runs=2)
    first = drop_times(engine.run_study(p, tmp_path))
    others = [
        replace(p, settings={"particles": 48}),
        replace(p, form="paper"),
        replace(p, sim_settings={"noise": 2.0}),
        make_plan("stress+robust", "nominal", settings={"particles": 32}, runs=2),
    ]
    for other in others:
        assert engine.read_runs(tmp_path / engine.RUNS, other.units) == {}
    for name in ("hash_library", "hash_code"):
        with monkeypatch.context() as m:
            m.setattr(engine, name, lambda: "f" * 64)
            assert engine.read_runs(tmp_path / engine.RUNS, p.units) == {}
    assert len(engine.run_study(others[0], tmp_path)) == 2
    path = tmp_path / engine.RUNS
    path.write_text(path.read_text().replace('"seed": 2', '"seed": 3'))  # no sum fits this any more
    assert len(engine.read_runs(path, p.units)) == 1
    monkeypatch.setattr(
        engine, "run_unit", lambda unit, real=engine.run_unit: real(unit) if unit.seed == 2 else 1 / 0
    )
    assert drop_times(engine.run_study(p, tmp_path)).equals(first)
    with pytest.raises(RuntimeError, match="case nominal, seed 1: ZeroDivisionError"):
        engine.run_study(p, tmp_path, restart=True)


def test_a_process_with_another_library_refuses():
    p = make_plan("stress", "nominal")
    unit = p.units[0]
    with pytest.raises(UserError, match="differs from the one with which the study began"):
        engine.run_unit(unit._replace(library="0" * 64))


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> pd.DataFrame:
    """In one process."""
    return drop_times(
        engine.run_study(
            make_plan("stress", "nominal", "paper-prior", runs=2), tmp_path_factory.mktemp("alone")
        )
    )


@pytest.mark.slow
def test_two_processes_give_the_same_numbers_and_all_files(alone, tmp_path):
    done = tselab(
        "montecarlo",
        "--study",
        "stress",
        "--cases",
        "nominal,paper-prior",
        "--runs",
        2,
        "--jobs",
        2,
        cwd=tmp_path,
    )
    assert done.code == 0, done.err
    out = tmp_path / "montecarlo-stress"
    table = pd.read_csv(out / "runs.csv")
    pd.testing.assert_frame_equal(drop_times(table), alone, check_dtype=False)
    text = (out / "stress.md").read_text()
    assert text.strip() in done.out
    assert "2 of each case, seeds 1 .. 2" in text
    assert "`tselab montecarlo --study stress --runs 2 --cases nominal,paper-prior`" in text
    lines = pd.read_csv(out / "stress.csv")
    low, high = stats.binomtest(int(lines["diverged"][0]), 2).proportion_ci(method="exact")
    assert (lines["diverged_low"][0], lines["diverged_high"][0]) == pytest.approx((100 * low, 100 * high))
    assert lines["cx_front_rms"][0] == pytest.approx(
        np.sqrt(alone["cx_front_mean_square"][:2].mean()), rel=1e-6
    )


def test_a_dask_cluster_gives_the_same_numbers(alone, tmp_path):
    distributed = pytest.importorskip(
        "distributed", reason="Dask is not installed: pip install 'tse[cluster]'"
    )
    options = {"processes": False, "protocol": "tcp://", "host": "127.0.0.1", "dashboard_address": None}
    with distributed.LocalCluster(n_workers=1, threads_per_worker=2, **options) as cluster:
        p = make_plan("stress", "nominal", "paper-prior", runs=2)
        table = engine.run_study(p, tmp_path, scheduler=cluster.scheduler_address)
    pd.testing.assert_frame_equal(drop_times(table), alone)


@pytest.mark.skipif(os.name == "nt", reason="no signals to a process")
@pytest.mark.parametrize(
    ("send", "what"),
    [
        pytest.param(os.killpg, signal.SIGINT, marks=pytest.mark.slow),
        (os.kill, signal.SIGTERM),
    ],  # a terminal tells the workers, too; kill does not
    ids=["ctrl-c", "kill"],
)
def test_an_interrupt_ends_with_130_leaves_no_worker_and_says_how_to_go_on(tmp_path, send, what):
    command = [
        *COMMAND,
        "montecarlo",
        "--study",
        "stress",
        "--cases",
        "nominal",
        "--runs",
        "500",
        "--jobs",
        "2",
        "--out",
        str(tmp_path),
    ]
    run = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(
            signal.SIGINT, signal.SIG_DFL
        ),  # a test run in the background ignores it
    )
    path, end = tmp_path / "runs.jsonl", time.monotonic() + 60
    while time.monotonic() < end and not (path.exists() and path.read_text().count("\n") > 2):
        time.sleep(0.05)
    send(run.pid, what)
    _, err = run.communicate(timeout=60)  # ends when the last worker has closed its copy of stderr
    assert run.returncode == 130, err
    assert "of 500 runs that are done, and the same command continues" in err and "Traceback" not in err
    assert path.read_text().endswith("\n")


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--study", "stres"], ["no study 'stres'", *STUDIES]),
        (["--study", "stress", "--cases", "nominal,nomnal"], ["no case 'nomnal'", "noise-3x"]),
        (["--study", "stress", "--runs", "0"], ["--runs", "1<=x"]),
        (["--study", "stress", "--set", "particles=5"], ["particles = 5 is outside its range 16 .."]),
        (["--study", "stress", "--set", "seed=5"], ["--first-seed"]),
        (["--study", "stress", "--out", "file"], ["file: is a file"]),
    ],
)
def test_bad_options_are_refused_with_what_is_allowed(tmp_path, options, named):
    (tmp_path / "file").write_text("")
    done = tselab_here("montecarlo", *options, cwd=tmp_path)
    assert done.code == 2, done.err
    for text in named:
        assert text in done.err
    assert "Traceback" not in done.err


@pytest.mark.parametrize("address", ["nonsense://x", "tcp://127.0.0.1:9", "tcp://127.0.0.1", "?"])
def test_a_scheduler_that_is_not_there_is_named(tmp_path, address):
    pytest.importorskip("distributed", reason="Dask is not installed: pip install 'tse[cluster]'")
    with pytest.raises(
        UserError, match="option --scheduler: no Dask scheduler answers at " + re.escape(address)
    ):
        engine.run_study(make_plan("stress", "nominal"), tmp_path, scheduler=address)


def test_without_dask_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UserError, match=r"pip install 'tse\[cluster\]'"):
        engine.run_study(make_plan("stress", "nominal"), tmp_path, scheduler="tcp://127.0.0.1:9")


# ---- numbers for people


def test_the_intervals_hold_what_they_should():
    rng = np.random.default_rng(3)
    x = rng.standard_normal(200)
    mean, half = summary.compute_mean_interval(x)
    assert (mean - half, mean + half) == pytest.approx(stats.t.interval(0.95, 199, x.mean(), stats.sem(x)))
    low, high = summary.bootstrap_interval(x**2)
    assert low < 1.0 < high and high - low == pytest.approx(2 * 1.96 * np.sqrt(2 / 200) / 2, rel=0.25)
    assert all(np.isnan(summary.bootstrap_interval(x[:1])))
    pair = np.stack([4 * x**2, x**2])  # on the same data the ratio is exact, whatever the data are
    assert summary.bootstrap_interval(pair, summary.compute_rms_ratio) == pytest.approx((2, 2))
    pair = np.stack([x, -x])  # runs are drawn with all that belongs to them
    assert summary.bootstrap_interval(pair, lambda p: p.sum(axis=0).mean(axis=-1)) == pytest.approx((0, 0))


@pytest.mark.filterwarnings("ignore::FutureWarning")
def test_the_normality_check_tells_normal_from_not():
    rng = np.random.default_rng(5)
    normal, not_normal = rng.standard_normal(100), rng.exponential(size=100)
    for x in (normal, not_normal):
        a, _ = summary.compute_anderson_darling(x)
        assert a == pytest.approx(stats.anderson(x, "norm").statistic * (1 + 0.75 / 100 + 2.25 / 100**2))
    assert (
        summary.compute_anderson_darling(normal)[1] > 0.05
        and summary.compute_anderson_darling(not_normal)[1] < 0.001
    )


# ---- a small part of each study

SMALL = {  # study: cases, runs
    "accuracy": ((), 4),
    "paper": ((), 2),
    "robust": (("noise-3x",), 1),
    "peers": (("nominal", "road-change"), 1),
    "stress": (("road-0.3", "mass-10"), 1),
    "regimes": (("road-0.7", "slow-20"), 1),
    "false-alarms": (("false-alarms",), 1),
}


def test_there_is_a_small_part_of_each_study():
    assert set(SMALL) == set(STUDIES)


@pytest.mark.slow
@pytest.mark.parametrize("name", SMALL)
def test_a_small_part_of_each_study(name, tmp_path):
    cases, runs = SMALL[name]
    p = make_plan(name, *cases, runs=runs)
    rows = engine.run_study(p, tmp_path)
    text, files = write_study(p, rows, tmp_path)
    assert {f.name for f in files} == {
        f"{name}.{end}" for end in ("csv", "md", *(["png"] if name == "paper" else []))
    }
    assert f"seeds 1 .. {runs}" in text if runs > 1 else "seed 1" in text

    lines = pd.read_csv(tmp_path / f"{name}.csv").set_index(["case", "estimator"])
    expected = [(c.name, e) for c in p.study.cases for e in c.estimators]
    assert list(lines.index) == expected
    if name not in ("stress", "paper", "robust"):
        assert not lines["diverged"].any(), text
    checks = {
        "accuracy": check_accuracy,
        "paper": check_paper,
        "robust": check_robust,
        "peers": check_peers,
        "stress": check_stress,
        "regimes": check_regimes,
        "false-alarms": check_false_alarms,
    }
    checks[name](lines, text)


def check_accuracy(lines, text):
    # along: the radii, which are exact here, are known to 0.2 %. A drive of seconds
    # hardly improves them.
    for name, limit in (("cx_front", 12.0), ("cy_front", 2.0), ("cy_rear", 2.0)):
        assert (
            lines.loc["accuracy", "tse"][f"{name}_rms"] < limit
            and lines.loc["accuracy", "tse"][f"{name}_covered"] > 90
        )


def check_paper(lines, text):
    """Check that in two runs robust and default do not diverge.

    A held steering angle that the filter has as such gives no bias.
    """
    for case in ("iv-a", "iv-a-held"):
        robust = lines.loc[case, "robust"]
        assert not robust["diverged"] and (robust[[f"{s}_rms" for s in STIFFNESS[1:]]] < 2).all()
        assert robust[[f"{s}_bias" for s in STIFFNESS[1:]]].abs().max() < 1
    for case in ("iv-b-20", "iv-b+20"):
        assert not lines.loc[case, "robust"]["diverged"]
    assert not lines.loc[("iv-a", "tse"), "diverged"]
    for figure in ("Fig. 1", "Fig. 2", "Fig. 3", "Fig. 4"):
        assert figure in text
    assert "| paper | as printed | robust | default |" in text and "tselab paper --runs 2" in text


def check_robust(lines, text):
    """Check that triple noise ends in the spread, where the spread has no limit.

    The spread then includes everything.
    """
    limited, free = (lines.loc["noise-3x", name] for name in ("robust", "robust-no-limit"))
    assert limited["cy_front_rms"] < free["cy_front_rms"] and free["cy_front_spread"] > 35
    assert all(text_ in text for text_, _ in estimators.VARIANTS.values())


def check_peers(lines, text):
    for name in ("tse", "ekf", "known"):
        line = lines.loc["nominal", name]
        assert line["cx_front_rms"] < 12 and (line[[f"{s}_rms" for s in STIFFNESS[1:]]] < 8).all()
    assert lines.loc["road-change", "ekf"]["cy_front_settle_1"] < 10
    assert np.isnan(lines.loc["nominal", "ekf"]["cy_front_settle_1"])
    assert "/ EKF" in text


def check_stress(lines, text):
    assert (lines["cy_rear_rms"] < 20).all() and lines.loc["mass-10", "tse"][
        "cy_front_bias"
    ] > 5  # C/m is what is seen
    assert lines.loc["road-0.3", "tse"]["cy_front_settle_2"] < 20


def check_regimes(lines, text):
    known = lines.loc["road-0.7", "known"]
    assert known["all_settle_1_most"] < 0.2 and known["cy_front_rms"] < 1 and np.isnan(known["valid_off_1"])
    assert lines.loc["road-0.7", "tse"]["detected_1"] < 5
    assert lines.loc["slow-20", "tse"]["cy_rear_rms"] < 20
    assert "## Ratio of the RMS error to that of known" in text and "## Detection of a change of road" in text


def check_false_alarms(lines, text):
    line = lines.loc["false-alarms", "tse"]
    assert line["hours"] == pytest.approx(1 / 6) and (line[[f"{s}_rms" for s in STIFFNESS]] < 15).all()
