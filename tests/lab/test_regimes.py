"""The studies of regimes: the events that count as a change, the drives, the tables."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from test_montecarlo import make_constant_drive

from tse.library.core import STIFFNESS, Config, SimConfig
from tse.library.errors import UserError
from tselab.montecarlo import engine, scores, studies, summary
from tselab.montecarlo.case import Case, CaseDrive, simulate_case

ROWS, STEP = 601, 0.1
ESTIMATE = np.dtype(
    [(f"{s}{end}", float) for s in STIFFNESS for end in ("", "_sd", "_spread")]
    + [(f"{s}_valid", np.int32) for s in STIFFNESS]
    + [("status", np.int32), ("change_age", float), ("change_probability", float), ("change_kind", np.int32)]
    + [(f"noise_{c}", float) for c in ("accel_x", "accel_y", "yaw_rate")]
)


def drive_case(case: Case, seed: int = 1) -> CaseDrive:
    plan = engine.StudyPlan(studies.make_study("regimes"), 1)
    return simulate_case(case, seed, lambda about: engine.configure_unit("tse", plan, about), {})


# ---- scores, against arrays whose answer is seen by eye


@pytest.fixture
def still() -> tuple[CaseDrive, Case, scores.Knowable, np.ndarray]:
    """60 s, an event at 30 s of which the estimator, right all the time, says nothing."""
    return make_constant_drive(ROWS, ESTIMATE, 30.0)


def expect_change(
    estimate: np.ndarray, d: CaseDrive, first: float, when: float, until: float = np.inf, sure: float = 0.9
) -> None:
    """Make the estimator report from row `first` on that the regime changed at `when`."""
    rows = (d.time > first - 1e-9) & (d.time < until - 1e-9)
    estimate["change_age"][rows] = d.time[rows] - when
    estimate["change_probability"][rows] = sure
    estimate["change_kind"][rows] = 1


def test_who_says_nothing_reports_nothing_and_notices_nothing(still):
    row = scores.score_regimes(*still)
    assert row == {
        "changes": 0,
        "false_changes": 0,
        "all_settle_1": 0.0,
        "detected_1": np.inf,
        "valid_off_1": 0.0,
    }
    d, case, known, estimate = still
    assert "detected_1" not in scores.score_regimes(d, replace(case, events=()), known, estimate)


def test_a_change_counts_once_however_often_it_is_said(still):
    d, case, known, estimate = still
    expect_change(estimate, d, 30.3, 30.0)
    expect_change(
        estimate, d, 31.0, 30.2, until=32.0
    )  # a history that begins 0.2 s later is the likeliest for a while
    expect_change(estimate, d, 33.0, 30.0, until=34.0, sure=0.5)  # not sure
    assert scores.find_reported(d, estimate) == pytest.approx([30.0])
    row = scores.score_regimes(d, case, known, estimate)
    assert (row["changes"], row["false_changes"], row["detected_1"]) == (1, 0, pytest.approx(0.3))


def test_false_changes_are_those_that_are_not_within_two_seconds_after_an_event(still):
    d, case, known, estimate = still
    for when in (12.0, 29.5, 29.9, 31.9, 32.2, 45.0):
        expect_change(estimate, d, when, when, until=when + 0.3)
    row = scores.score_regimes(d, case, known, estimate)
    assert (row["changes"], row["false_changes"]) == (
        4,
        3,
    )  # 31.9 and 32.2 are one, and right; 29.5 and 29.9 are one, and early
    assert scores.score_regimes(d, replace(case, events=()), known, estimate)["false_changes"] == 4
    assert scores.score_regimes(d, replace(case, lasts=14.0), known, estimate)["false_changes"] == 2
    assert scores.score_regimes(d, replace(case, events=(30.0, 45.0)), known, estimate)["false_changes"] == 2


def test_who_reports_an_older_change_has_not_detected_the_event(still):
    d, case, known, estimate = still
    expect_change(estimate, d, 20.0, 20.0)
    assert scores.score_regimes(d, case, known, estimate)["detected_1"] == np.inf
    expect_change(estimate, d, 34.0, 29.95)  # birth times are no rows of events
    row = scores.score_regimes(d, case, known, estimate)
    assert row["detected_1"] == pytest.approx(4.0) and (row["changes"], row["false_changes"]) == (2, 1)


def test_a_refused_row_says_nothing(still):
    d, _, _, estimate = still
    expect_change(estimate, d, 30.0, 30.0)
    estimate["status"] = -3
    assert not len(scores.find_reported(d, estimate))


def test_the_age_of_a_change_counts_pauses_and_the_drive_does_not(still):
    d, case, known, estimate = still
    d.rows["dt"][400] = 600.0  # at 40 s
    expect_change(estimate, d, 30.0, 30.0)
    estimate["change_age"][400:] += 600.0 - STEP
    assert scores.find_reported(d, estimate) == pytest.approx([30.0])
    expect_change(estimate, d, 50.0, 50.0)  # after the pause
    assert scores.find_reported(d, estimate) == pytest.approx([30.0, 50.0])
    row = scores.score_regimes(d, replace(case, events=(30.0, 50.0)), known, estimate)
    assert row["false_changes"] == 0 and row["detected_2"] == pytest.approx(0)


def test_all_three_are_right_when_the_last_of_them_is(still):
    d, case, known, estimate = still
    for i, key in enumerate(STIFFNESS):
        estimate[key][(d.time > 30 - 1e-9) & (d.time < 31 + i - 1e-9)] *= 1.15
    row = scores.score_regimes(d, case, known, estimate)
    assert row["all_settle_1"] == pytest.approx(3.0) and row["valid_off_1"] == 0  # 15 % is not yet off


def test_valid_and_off_counts_the_seconds_in_which_any_is(still):
    d, case, known, estimate = still
    estimate["cx_front"][(d.time > 29) & (d.time < 33 - 1e-9)] *= 1.3  # 3 s of them after the event
    estimate["cy_rear"][(d.time > 32 - 1e-9) & (d.time < 35 - 1e-9)] *= 0.7  # a second more than those
    estimate["cy_rear_valid"][(d.time > 34 - 1e-9)] = 3  # and says so at last
    assert scores.score_regimes(d, case, known, estimate)["valid_off_1"] == pytest.approx(4.0)
    saturated = replace(known, secant=np.where((d.time > 40)[:, None], 0.6, known.level))
    assert scores.score_regimes(d, case, saturated, estimate)["valid_off_1"] == pytest.approx(4.0 + 20.0)
    estimate["status"][d.time > 40] = -1
    assert scores.score_regimes(d, case, saturated, estimate)["valid_off_1"] == pytest.approx(4.0)


def test_who_has_no_such_outputs_has_no_such_scores(still):
    d, case, known, estimate = still
    plain = estimate[[n for n in ESTIMATE.names if not n.startswith("change")]]
    assert set(scores.score_regimes(d, case, known, plain)) == {"all_settle_1", "valid_off_1"}
    assert set(scores.score_regimes(d, case, known, estimate[list(STIFFNESS)])) == {"all_settle_1"}


def test_windows_are_scored_each_for_itself(still):
    d, case, known, estimate = still
    estimate["cy_front"][d.time > 30] *= 1.03
    row = scores.score_run(d, replace(case, windows=((10.0, 20.0), (40.0, 50.0))), known, estimate)
    assert row["cy_front_mean_square_w0"] == pytest.approx(0) and row[
        "cy_front_mean_square_w1"
    ] == pytest.approx(9)
    assert (row["cy_front_covered_w0"], row["cy_front_covered_w1"], row["cy_front_covered"]) == (100, 0, 50)


# ---- cases

EVERY = {c.name: c for study in ("regimes", "false-alarms") for c in studies._make_cases()[study]}


def test_every_case_can_be_driven_and_looks_at_rows_it_has():
    for case in EVERY.values():
        if case.name.startswith("false-alarms"):
            continue  # long
        d = drive_case(case, 3)
        vy = np.abs(d.truth["true_vel_y"])
        assert np.isfinite(vy).all() and vy.max() < 3, case.name  # nobody spins
        assert scores.find_rows_inside(d.time, case.windows).any() and max((*case.events, 0)) < d.time[-1], (
            case.name
        )
        for a, b in case.windows:  # the truth of a window does not jump
            part = d.stiffness[(d.time >= a) & (d.time <= b + 1e-9)]
            assert np.abs(np.diff(part, axis=0)).max() < 0.01, case.name


def test_a_slow_change_goes_all_the_way_at_one_rate():
    d = drive_case(EVERY["slow-20"])
    at = [np.searchsorted(d.time, t - 1e-9) for t in (20.0, 30.0, 40.0, 60.0)]
    assert d.stiffness[at, 1] == pytest.approx([1, 0.85, 0.7, 0.7], abs=1e-6)
    assert d.time[-1] == 60 and EVERY["slow-20"].windows == ((20.0, 60.0),)


def test_held_cases_hold_and_the_others_do_not():
    for name, case in EVERY.items():
        assert drive_case(
            replace(case, build=studies._make_square_waves(0.1), corrupt=None)
        ).sim.hold_inputs == name.endswith("-held")
    road = EVERY["road-0.7"]
    ramped, held = (drive_case(replace(road, sim={"hold_inputs": hold})) for hold in (0, 1))
    flip = np.searchsorted(ramped.time, 2.0 - 1e-9)  # of the steering
    assert (ramped.rows["steer_angle"] == held.rows["steer_angle"]).all()
    before, after = (
        np.abs(ramped.truth["true_yaw_rate"] - held.truth["true_yaw_rate"])[r] for r in (flip - 1, flip)
    )
    assert after > 20 * before  # the ramp has turned the wheels during the row before


def test_ordinary_driving_is_ordinary():
    ends, speeds = [], []
    for seed in range(1, 6):
        car, sim = Config.exact(), SimConfig()
        m = studies.drive_ordinary(car, sim, np.random.default_rng(seed), duration=600.0)
        assert np.abs(m.steer_angle).max() < 0.2 and (m.road_level == 1).all()
        jumps = np.abs(np.diff(m.target_speed))
        assert jumps.max() < 0.03  # 3 m/s2
        assert (
            m.target_speed.min() >= 8 - 1e-9
            and m.target_speed.max() <= 35 + 4
            and m.speed == m.target_speed[0]
        )
        sideways = m.steer_angle * m.target_speed**2 / (car.lf + car.lr)
        assert np.abs(sideways).max() < 2.5 * 3  # more steering than on a circle, since it understeers
        ends.append(np.abs(m.steer_angle).max())
        speeds.append(m.target_speed.mean())
    assert np.std(ends) > 0 and np.std(speeds) > 0.5
    d = drive_case(
        replace(EVERY["false-alarms"], build=lambda *a: studies.drive_ordinary(*a, duration=120.0))
    )
    assert np.abs(d.truth["true_accel_y"]).max() < 4 and np.abs(d.truth["true_accel_x"]).max() < 4.5
    assert (np.abs(d.truth["true_vel_x"] - np.median(d.truth["true_vel_x"]))).max() < 30


# ---- estimators that are added to a study, tables


def test_a_study_may_be_run_with_more_estimators():
    study = studies.make_study("stress+ekf+known", ("nominal", "mass+10"))
    assert (study.name, study.base) == ("stress+ekf+known", "stress")
    assert [c.estimators for c in study.cases] == [("tse", "ekf", "known")] * 2
    assert studies.make_study("regimes+known").case("road-0.7").estimators == ("tse", "known")  # once
    with pytest.raises(UserError, match="there is no estimator 'nobody'"):
        studies.make_study("stress+nobody")
    with pytest.raises(UserError, match="there is no study 'nothing'"):
        studies.make_study("nothing+ekf")


@pytest.mark.parametrize(("count", "exposure"), [(0, 10.0), (3, 2.0), (40, 100.0)])
def test_the_interval_of_a_rate_is_exact(count, exposure):
    low, high = summary.compute_poisson_interval(count, exposure)
    assert stats.poisson.cdf(count, high * exposure) == pytest.approx(0.025)
    assert low == 0 if count == 0 else stats.poisson.sf(count - 1, low * exposure) == pytest.approx(0.025)


def test_medians_name_the_longest_and_those_that_never_did():
    assert summary._format_median(pd.Series([0.1, 0.3, 0.2])) == "0.20 (0.30)"
    assert summary._format_median(pd.Series([0.1, np.inf, 0.2])) == "0.20 (never: 1)"
    assert summary._format_median(pd.Series([np.nan])) == "-"


def test_false_changes_are_counted_by_the_hour():
    plan = engine.StudyPlan(studies.make_study("false-alarms"), 3)
    runs = pd.DataFrame(
        {
            "case": "false-alarms",
            "estimator": "tse",
            "changes": [1, 0, 3],
            "false_changes": [0, 0, 2],
            "seconds": 600.0,
        }
    )
    (row,) = summary.tabulate_false_changes(plan, runs).rows
    assert (
        row[:5] == ["false-alarms", "tse", "0.5", "4", "2"]
        and row[5].startswith("4.00 (0.48 .. 14.45)")
        and row[6] == "1"
    )
    runs["changes"] = np.nan
    assert summary.tabulate_false_changes(plan, runs).rows == []
