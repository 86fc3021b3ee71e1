"""Scores of the studies, the tables that are made of them, and what the pictures draw.

Drives and estimates are made up, so that each score is known by hand.
"""

from contextlib import contextmanager
from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from test_montecarlo import make_constant_drive

from tse.library.core import INPUT, OUTPUT, SIM_OUTPUT, STIFFNESS, Config, SimConfig, library
from tse.log.rows import MEASURES
from tselab.montecarlo import engine, estimators, pictures, scores, summary
from tselab.montecarlo.case import Case, CaseDrive
from tselab.montecarlo.studies import Study

CAR = {
    "mass": 1500.0, "lf": 1.0, "lr": 1.5, "wheel_radius_front": 0.3, "wheel_radius_rear": 0.35,
    "longitudinal_stiffness_front": 1e5, "longitudinal_stiffness_rear": 0.8e5,
    "cornering_stiffness_front": 1.1e5, "cornering_stiffness_rear": 1.3e5,
    "rear_longitudinal_follows_front": 0.5, "accel_x_sd": 0.1, "accel_y_sd": 0.2, "sample_time": 0.1,
    "hold_speed": 2.0, "max_steer": 0.5, "forgetting": 0.9,
}  # fmt: skip


def make_drive(n: int = 1, friction: float = 0.0, **truth: object) -> CaseDrive:
    """Return a drive at 20 m/s, straight on, without slip; `truth` replaces columns."""
    rows = np.zeros(n, library().dtype(SIM_OUTPUT))
    rows["true_vel_x"] = 20.0
    rows["true_wheel_speed_front"], rows["true_wheel_speed_rear"] = 20 / 0.3, 20 / 0.35
    for key in STIFFNESS:
        rows[f"true_{key}"] = 1.0
    for name, values in truth.items():
        rows[name] = values
    config = Config.exact(CAR)
    sim, no = SimConfig({"noise": 2.0, "friction": friction}), np.zeros(n, bool)
    inputs = np.zeros(n, library().dtype(INPUT))
    inputs["dt"] = 0.1
    return CaseDrive(
        np.round(0.1 * np.arange(n), 9), inputs, rows, np.ones(n), no, {}, config, config, sim, (), friction
    )


# ---- what could be known


def test_regressors_are_slips_times_stiffness_over_mass_and_noise():
    d = make_drive(
        true_vel_y=0.4, true_yaw_rate=0.2, steer_angle=0.05,
        true_wheel_speed_front=21 / 0.3, true_wheel_speed_rear=19.5 / 0.35,
    )  # fmt: skip
    phi, use = scores.compute_regressors(d)
    along = 1e5 * 1 / 21 + 0.5 * 0.8e5 * (-0.5 / 20)  # slips over the larger speed
    front, rear = 0.05 - (0.4 + 1.0 * 0.2) / 20, (1.5 * 0.2 - 0.4) / 20
    per_x, per_y = 1 / (1500 * 0.1 * 2), 1 / (1500 * 0.2 * 2)
    assert phi[0] == pytest.approx([along * per_x, 1.1e5 * front * per_y, 1.3e5 * rear * per_y])
    assert not use.any()
    slow = make_drive(true_vel_x=0.2, true_vel_y=0.1)
    slow.truth["true_wheel_speed_front"] = 0.5 / 0.3
    phi, _ = scores.compute_regressors(slow)
    wheel = (20 - 0.2) / 20  # of the rear wheels
    expected = (1e5 * 0.3 / 1.0 + 0.5 * 0.8e5 * wheel) * per_x
    assert phi[0, 0] == pytest.approx(expected) and phi[0, 2] == pytest.approx(-1.3e5 * 0.1 / 1 * per_y)


def test_utilisation_is_the_force_of_each_axle_over_friction_times_its_load():
    d = make_drive(
        friction=0.8, true_vel_y=0.4, true_yaw_rate=0.2, steer_angle=0.05,
        true_wheel_speed_front=21 / 0.3, true_wheel_speed_rear=19.5 / 0.35,
        true_cx_front=0.6, true_cy_front=0.7, true_cy_rear=0.9,
    )  # fmt: skip
    d.road[:] = 0.9
    _, use = scores.compute_regressors(d)
    load = 1500 * 9.80665 / 2.5
    front = np.hypot(1e5 * 0.6 / 21, 1.1e5 * 0.7 * 0.02) / (0.8 * load * 1.5)
    follows = 0.9 + 0.5 * (0.6 - 0.9)
    rear = np.hypot(0.8e5 * follows * 0.5 / 20, 1.3e5 * 0.9 * 0.1 / 20) / (0.8 * load * 1.0)
    assert use[0] == pytest.approx([front, rear], rel=1e-3)


def test_a_felt_stiffness_is_that_of_the_rows_so_far_from_which_one_learns():
    n, every = 6, np.ones(6, bool)
    use = np.tile([[0.3, 0.6]], (n, 1))
    use[4:] = [0.6, 0.3]
    phi, mean = np.ones((n, 3)), np.full((n, 3), 0.5)
    grip = dict(zip((0.3, 0.6), scores.compute_grip(np.array([0.3, 0.6])), strict=True))
    found = scores.compute_felt_stiffness(mean, phi, use, every, 100.0)
    assert found[3] == pytest.approx([0.5 * grip[0.3]] * 2 + [0.5 * grip[0.6]])
    assert found[5, 2] == pytest.approx(0.5 * (4 * grip[0.6] + 2 * grip[0.3]) / 6)
    learning = every.copy()
    learning[2:] = False
    held = scores.compute_felt_stiffness(mean, phi, use, learning, 100.0)
    assert held[5] == pytest.approx(held[1])
    assert (scores.compute_felt_stiffness(mean, phi, use, ~every, 100.0) == mean).all()
    phi[4:, 1] = 3.0  # weighs nine times as much
    weighed = scores.compute_felt_stiffness(mean, phi, use, every, 100.0)[5, 1]
    assert weighed == pytest.approx(0.5 * (4 * grip[0.3] + 18 * grip[0.6]) / 22)
    use[5] = [0.1, 2.0]  # one axle is enough
    beyond = scores.compute_felt_stiffness(mean, phi, use, every, 100.0)
    assert beyond[5] == pytest.approx(beyond[4])


def make_waves(n: int) -> dict[str, np.ndarray]:
    """Return a truth in which every stiffness shows."""
    wave = np.where(np.arange(n) % 4 < 2, 1.0, -1.0)
    return {"true_vel_y": 0.3 * wave, "true_wheel_speed_front": (20 + wave) / 0.3, "steer_angle": 0.04 * wave}


def find_knowable(
    n: int, case: Case | None = None, corrupted: slice = slice(0), **truth: object
) -> scores.Knowable:
    d = make_drive(n, **(make_waves(n) | truth))
    d.corrupted[corrupted] = True
    return scores.find_knowable(d, case or Case("c", "", None))


def test_nothing_is_learnt_at_standstill_in_reverse_and_with_a_large_steering_angle():
    n = 60
    front, rear = np.full(n, 20.0), np.full(n, 20.0)
    front[10:20], rear[10:20] = 1.9, 1.9  # both are slow
    front[20:30], rear[20:30] = 1.9, 2.1  # one is fast
    front[30:40] = -0.2
    steer = np.where(np.arange(n) >= 50, -0.6, 0.04)
    known = find_knowable(
        n, true_wheel_speed_front=front / 0.3, true_wheel_speed_rear=rear / 0.35, steer_angle=steer
    )
    learns = np.isfinite(known.best_sd).any(axis=1)
    assert learns[5:10].all() and learns[20:30].all() and learns[40:50].all()
    assert not learns[10:20].any() and not learns[30:40].any() and not learns[50:].any()


def test_errors_count_when_start_events_and_faults_are_some_time_ago():
    n = 701
    memories = 20  # rows: two times 1 / (1 - 0.9)
    plain = find_knowable(n)
    assert np.flatnonzero(plain.settled)[0] == 100 > memories and plain.settled[100:].all()
    event = find_knowable(n, Case("c", "", None, events=(30.0,)))
    assert event.settled[299] and not event.settled[300:400].any() and event.settled[400:].all()
    both = find_knowable(n, Case("c", "", None, events=(40.0, 55.0)), corrupted=slice(200, 210))
    assert np.flatnonzero(np.diff(both.settled.astype(int))).tolist() == [99, 199, 308, 399, 499, 549, 649]
    fault = find_knowable(n, corrupted=slice(200, 260))
    assert fault.settled[199] and not fault.settled[200:359].any() and fault.settled[359]
    assert (fault.corrupted == (np.arange(n) // 10 >= 20) & (np.arange(n) < 260)).all()
    wild = np.where((np.arange(n) >= 200) & (np.arange(n) < 210), 10.0, 0.0)
    beyond = find_knowable(n, friction=1.4, true_vel_y=wild)
    assert beyond.beyond[200:210].all() and not beyond.beyond[100:200].any()
    assert not beyond.settled[200:309].any() and beyond.settled[309]
    assert plain.best_sd[500, 1] < 0.1 and plain.secant is not None and not plain.judged[:100].any()


def test_the_best_sd_grows_with_the_spread_of_its_own_stiffness():
    d = make_drive(400, **make_waves(400))
    d.sim = SimConfig({"noise": 2.0, "spread_cx_front": 0.0, "spread_cy_front": 0.3, "spread_cy_rear": 0.0})
    known = scores.find_knowable(d, Case("c", "", None))
    phi, _ = scores.compute_regressors(d)
    memory = 10
    for i, spread in enumerate((0.0, 0.3, 0.0)):
        tail = phi[-200:, i]
        expected = np.sqrt((1 + np.mean(tail**2) * spread**2) / (memory * tail.var()))
        assert known.best_sd[-20:, i].mean() == pytest.approx(expected, rel=0.05), i


@pytest.mark.parametrize(
    ("windows", "rows"), [(((1.0, 2.0),), [1, 2]), (((0.0, 0.5), (3.0, 9.0)), [0, 3, 4])]
)
def test_a_window_includes_its_ends(windows, rows):
    assert np.flatnonzero(scores.find_rows_inside(np.arange(5.0), windows)).tolist() == rows


# ---- changes of regime


@pytest.fixture
def still() -> tuple[CaseDrive, Case, scores.Knowable, np.ndarray]:
    return make_constant_drive(801, library().dtype(OUTPUT), 20.0)


def report_change(
    d: CaseDrive, estimate: np.ndarray, at: float, since: float, until: float = 1e9, p: float = 0.95
) -> None:
    """Let the rows from `since` to `until` report a change at the time `at`."""
    rows = (d.time >= since - 1e-9) & (d.time < until - 1e-9)
    estimate["change_kind"][rows], estimate["change_probability"][rows] = 1, p
    estimate["change_age"][rows] = d.time[rows] - at


def test_reported_changes_are_certain_distinct_and_on_the_time_of_the_drive(still):
    d, _, _, estimate = still
    assert len(scores.find_reported(d, estimate)) == 0
    report_change(d, estimate, 10.0, 12.0, 14.0, 0.89)
    assert len(scores.find_reported(d, estimate)) == 0
    report_change(d, estimate, 20.0, 22.0, 30.0)
    report_change(d, estimate, 20.4, 30.0, 40.0)  # the same, found out better
    report_change(d, estimate, 40.0, 42.0, p=0.9)
    assert scores.find_reported(d, estimate) == pytest.approx([20.0, 40.0], abs=1e-5)
    estimate["status"][d.time < 41] = -1  # refused rows report nothing
    assert scores.find_reported(d, estimate) == pytest.approx([40.0], abs=1e-5)
    d.rows["dt"][300] += 5.0  # a pause of the log, which the time of the drive leaves out
    assert scores.compute_log_time(d)[[0, 299, 300]] == pytest.approx([0, 29.9, 35.0])
    estimate["change_age"][d.time >= 42] = d.time[d.time >= 42] - 40.0
    assert scores.find_reported(d, estimate) == pytest.approx([40.0], abs=1e-5)


@pytest.mark.parametrize(
    ("at", "lasts", "false"),
    [(19.8, 0.0, 1), (19.9, 0.0, 0), (21.9, 0.0, 0), (22.1, 0.0, 1), (26.9, 5.0, 0), (27.1, 5.0, 1)],
)
def test_a_reported_change_is_false_unless_the_truth_changed_shortly_before(still, at, lasts, false):
    d, case, known, estimate = still
    report_change(d, estimate, at, at + 1)
    row = scores.score_regimes(d, replace(case, lasts=lasts), known, estimate)
    assert (row["changes"], row["false_changes"]) == (1, false)
    row = scores.score_regimes(d, replace(case, events=()), known, estimate)
    assert (row["changes"], row["false_changes"]) == (1, 1) and "detected_1" not in row


def test_a_change_is_detected_when_a_row_reports_one_that_is_not_older(still):
    d, case, known, estimate = still
    report_change(d, estimate, 10.0, 11.0, 23.0)  # an earlier one
    report_change(d, estimate, 20.0, 23.0)
    row = scores.score_regimes(d, case, known, estimate)
    assert row["detected_1"] == pytest.approx(3.0) and "detected_2" not in row
    two = replace(case, events=(20.0, 50.0))
    assert scores.score_regimes(d, two, known, estimate)["detected_2"] == np.inf
    estimate["change_probability"] = 0.5
    assert scores.score_regimes(d, case, known, estimate)["detected_1"] == np.inf


def test_all_have_settled_when_the_last_stiffness_has(still):
    d, case, known, estimate = still
    for key, settled in (("cx_front", 22.0), ("cy_rear", 25.0)):
        estimate[key][(d.time >= 20) & (d.time < settled)] = 0.4
    row = scores.score_regimes(d, case, known, estimate)
    assert row["all_settle_1"] == pytest.approx(5.0)


def test_wrong_rows_that_are_flagged_valid_are_counted_for_a_minute_after_the_change(still):
    d, case, known, estimate = still
    estimate["cy_front"][d.time >= 18] = 0.8 * 1.21
    estimate["cx_front"][d.time >= 18] = 0.8 * 1.19
    row = scores.score_regimes(d, case, known, estimate)
    assert row["valid_off_1"] == pytest.approx(60.0)
    estimate["cy_front_valid"][d.time >= 30] = 3
    assert scores.score_regimes(d, case, known, estimate)["valid_off_1"] == pytest.approx(10.0)
    estimate["status"][(d.time >= 20) & (d.time < 22)] = -1
    assert scores.score_regimes(d, case, known, estimate)["valid_off_1"] == pytest.approx(8.0)
    true = replace(known, secant=known.level * 1.21)  # of tyres that saturate the secant counts
    assert scores.score_regimes(d, case, true, estimate)["valid_off_1"] == 0
    two = replace(case, events=(20.0, 25.0))
    row = scores.score_regimes(d, two, known, estimate)
    assert (row["valid_off_1"], row["valid_off_2"]) == pytest.approx((3.0, 5.0))


# ---- scores of a run


def test_each_window_has_its_own_scores(still):
    d, case, known, estimate = still
    case = replace(case, windows=((10.0, 20.0), (30.0, 40.0)))
    second = (d.time >= 30) & (d.time <= 40)
    estimate["cy_front"][second], estimate["cy_front_sd"][second] = 0.8 * 0.9, 0.08
    estimate["cy_front_spread"] = np.where(second, 0.08, 0.04)
    row = scores.score_run(d, case, known, estimate)
    assert [row[f"cy_front_mean_square_w{n}"] for n in (0, 1)] == pytest.approx([0, 100], abs=1e-6)
    assert [row[f"cy_front_bias_w{n}"] for n in (0, 1)] == pytest.approx([0, -10], abs=1e-6)
    assert [row[f"cy_front_spread_w{n}"] for n in (0, 1)] == pytest.approx([5, 10])
    assert row["cy_front_covered"] == 100 and row["cy_front_bias"] == pytest.approx(-5)
    assert row["cy_front_sd_square"] == pytest.approx((1 + 100) / 2) and row[
        "cy_front_spread"
    ] == pytest.approx(7.5)
    assert [row[f"cy_front_covered_w{n}"] for n in (0, 1)] == [100, 100]
    estimate["cy_front_sd"][second] = 0.04
    row = scores.score_run(d, case, known, estimate)
    assert [row[f"cy_front_covered_w{n}"] for n in (0, 1)] == [100, 0]


@pytest.mark.parametrize(("rows", "off"), [(21, 1), (20, 0)])
def test_an_estimate_is_off_if_it_is_wrong_for_two_seconds_of_the_window(still, rows, off):
    d, case, known, estimate = still
    case = replace(case, windows=((10.0, 20.0), (30.0, 40.0)))
    estimate["cx_front"][310 : 310 + rows] = 0.8 * 0.79
    row = scores.score_run(d, case, known, estimate)
    assert (row["cx_front_off_w0"], row["cx_front_off_w1"], row["cx_front_diverged"]) == (0, off, off)


def test_states_are_scored_against_the_truth_in_the_window(still):
    d, case, known, estimate = still
    inside = (d.time >= 15) & (d.time <= 30)
    d.truth["true_vel_x"], d.truth["true_yaw_rate"] = 20.0, 0.1
    estimate["vel_x"], estimate["yaw_rate"] = np.where(inside, 20.5, 0.0), np.where(inside, 0.08, 9.0)
    estimate["status"][500:503] = library().status("TSE_W_RECOVERED")
    row = scores.score_run(d, case, known, estimate)
    assert row["vel_x_square"] == pytest.approx(0.25) and row["yaw_rate_square"] == pytest.approx(0.0004)
    assert row["recoveries"] == 3


def test_an_estimator_without_flags_has_no_scores_of_them(still):
    d, case, known, _ = still
    estimate = np.zeros(len(d.time), [(f"{s}{e}", float) for s in STIFFNESS for e in ("", "_sd")])
    for key in STIFFNESS:
        estimate[key] = 0.8
    row = scores.score_run(d, case, known, estimate)
    assert row["diverged"] == 0 and row["cy_rear_judged"] == int(known.judged[:, 2].sum())
    left = {"changes", "detected_1", "valid_off_1", "recoveries", "cx_front_spread", "cx_front_false_valid"}
    assert not left & set(row) and not any(k.startswith("noise_") for k in row)


def test_means_leave_refused_rows_out():
    assert scores._compute_mean(np.array([1.0, np.nan, 3.0])) == 2 and np.isnan(
        scores._compute_mean(np.full(2, np.nan))
    )
    assert scores.find_rows_after(np.arange(3.0), np.array([9.0]), 5.0).all()


# ---- tables


@pytest.fixture(autouse=True)
def few_resamples(monkeypatch):
    """200 instead of 2000: no interval here depends on it."""
    monkeypatch.setattr(summary, "RESAMPLES", 200)


def make_plan(*cases: Case, **more) -> engine.StudyPlan:
    cases = cases or (make_case("one"),)
    return engine.StudyPlan(
        Study(more.pop("study", "stress"), "A title", 3, cases), more.pop("runs", 3), **more
    )


def make_case(name: str, *names: str, **more) -> Case:
    return Case(name, f"title of {name}", None, estimators=names or ("tse",), **more)


def make_runs(case: str = "one", estimator: str = "tse", n: int = 3, **columns: object) -> pd.DataFrame:
    """Return the scores of n runs: squares of 4, no error else, of 400 rows and 40 s."""
    table: dict[str, object] = {"case": case, "estimator": estimator, "seed": 5 + np.arange(n)}
    for key in STIFFNESS:
        table |= {f"{key}_{x}": 4.0 for x in ("mean_square", "sd_square", "mean_square_w0", "mean_square_w1")}
        table |= {
            f"{key}_{x}": 1.0 for x in ("bias", "spread", "spread_seen", "worst", "bias_w0", "spread_w0")
        }
        table |= {
            f"{key}_covered": 95.0,
            f"{key}_covered_w0": 95.0,
            f"{key}_diverged": 0,
            f"{key}_judged": 100.0,
        }
        table |= {f"{key}_off_w0": 0, f"{key}_off_w1": 0, f"{key}_settle_1": 2.0, f"{key}_stay_1": 3.0}
        for share in scores.SHARES:
            table |= {f"{key}_{share}": 1.0, f"{key}_{share}_of": 10.0}
    table |= {"diverged": 0, "diverged_any": 0, "recoveries": 0.0, "changes": 2.0, "false_changes": 0.0}
    table |= {f"noise_{c}": 1.0 for c in MEASURES}
    table |= {"detected_1": 1.0, "all_settle_1": 2.0, "valid_off_1": 0.5, "vel_x_square": 0.01}
    table |= {
        "yaw_rate_square": 0.0001,
        "seconds": 40.0,
        "steps": 400.0,
        "simulate_s": 0.5,
        "estimate_s": 0.04,
    }
    return pd.DataFrame(table | columns, index=range(n))


def test_a_line_combines_the_runs_of_a_case():
    runs = make_runs(
        n=4, diverged=[1, 0, 0, 0], diverged_any=[1, 1, 0, 0], recoveries=[1.0, np.nan, 2.0, 0.0],
        cy_front_mean_square=[1.0, 4.0, 9.0, 2.0], cy_front_bias=[1.0, 2.0, 3.0, 6.0],
        cy_front_sd_square=[1, 1, 1, 13],
        cy_front_spread=[1.0, np.nan, 3.0, np.nan], cy_front_worst=[3.0, 9.0, 1.0, 2.0],
        cy_front_settle_1=[1.0, 2.0, np.inf, 4.0], cy_front_judged=[100, 200, 300, 400],
        cy_front_false_valid=[1, 0, 0, 3], cy_front_false_valid_of=[10, 10, 10, 70], seconds=[40, 40, 40, 60],
        cx_front_reason_right_of=0.0, cx_front_reason_right=0.0, estimate_s=[0.04, 0.08, 0.04, 4.0],
        detected_1=np.nan,
    )  # fmt: skip
    other = make_runs("two", n=2, diverged=1)
    plan = make_plan(make_case("one", "tse", "ekf"), make_case("two"))
    one, two = summary.summarise(plan, pd.concat([other, runs])).to_dict("records")
    assert (one["case"], one["estimator"], one["title"], one["runs"]) == ("one", "tse", "title of one", 4)
    assert (one["first_seed"], one["last_seed"]) == (5, 8) and (two["case"], two["diverged"]) == ("two", 2)
    low, high = stats.beta.ppf([0.025, 0.975], [1, 2], [4, 3])
    assert (one["diverged"], one["diverged_low"], one["diverged_high"]) == pytest.approx(
        (1, 100 * low, 100 * high)
    )
    assert (one["diverged_any"], one["recoveries"]) == (2, 3)
    assert one["cy_front_rms"] == pytest.approx(2.0) and one["cy_front_rms_median"] == pytest.approx(
        np.sqrt(3)
    )
    assert one["cy_front_rms_low"] < 2 < one["cy_front_rms_high"]
    assert one["cy_front_bias"] == 3
    assert one["cy_front_bias_half"] == pytest.approx(
        stats.t.ppf(0.975, 3) * np.std([1, 2, 3, 6], ddof=1) / 2
    )
    assert (one["cy_front_sd"], one["cy_front_spread"], one["cy_front_worst"]) == (2.0, 2.0, 9.0)
    assert one["cy_front_judged"] == pytest.approx(100 * 250 / 400)
    # of four runs the median is the third, so that a run that never settles is not halved
    assert (one["cy_front_settle_1"], one["cy_front_settle_1_90"]) == (4.0, np.inf)
    assert one["cy_rear_settle_1_most"] == 2 and one["cy_front_settle_1_most"] == np.inf
    assert one["cy_front_false_valid"] == pytest.approx(4.0)  # pooled, no mean of shares
    assert one["false_valid"] == pytest.approx(100 * (4 + 4 + 4) / (100 + 40 + 40))
    assert np.isnan(one["cx_front_reason_right"]) and one["reason_right"] == pytest.approx(10)
    assert one["hours"] == pytest.approx(180 / 3600) and np.isnan(one.get("detected_1", np.nan))
    assert one["microseconds_per_step"] == pytest.approx(1e6 * 0.06 / 400)
    assert (one["changes"], one["false_changes"], one["all_settle_1"]) == (8, 0, 2.0)


def test_a_mean_needs_two_runs_for_an_interval():
    assert summary.compute_mean_interval([3.0])[0] == 3 and np.isnan(summary.compute_mean_interval([3.0])[1])
    assert np.isnan(summary.compute_mean_interval([])).all()
    assert summary.compute_rms(np.array([[1.0, 9.0], [4.0, 4.0]])) == pytest.approx([np.sqrt(5), 2])


@pytest.mark.parametrize(("count", "low", "high"), [(0, 0, 3.689), (1, 0.0253, 5.572), (10, 4.795, 18.39)])
def test_the_interval_of_a_rate_is_garwood_s(count, low, high):
    assert summary.compute_poisson_interval(count, 2.0) == pytest.approx(
        (low / 2, high / 2), rel=1e-3, abs=1e-9
    )


def test_the_p_value_of_the_normality_check_is_uniform_for_normal_data():
    rng = np.random.default_rng(2)
    p = np.sort([summary.compute_anderson_darling(rng.standard_normal(60))[1] for _ in range(500)])
    assert np.abs(p - np.linspace(0, 1, 500)).max() < 1.63 / np.sqrt(500)  # Kolmogorov, 1 %


def test_small_p_values_of_the_normality_check_are_those_of_stephens_table():
    table = {0.631: 0.10, 0.752: 0.05, 0.873: 0.025, 1.035: 0.01}
    z = stats.norm.ppf((np.arange(50) + 0.5) / 50)
    found = [summary.compute_anderson_darling(z + skew * z**2) for skew in np.linspace(0.1, 0.3, 41)]
    inside = [(a, p) for a, p in found if 0.631 <= a <= 1.035]
    assert len(inside) > 5
    for a, p in inside:
        assert np.log(p) == pytest.approx(np.interp(a, list(table), np.log(list(table.values()))), abs=0.05)


@pytest.mark.parametrize(
    ("args", "text"),
    [
        ((1.234,), "1.23"),
        ((np.nan,), "-"),
        ((None,), "-"),
        ((np.inf, 1), "never"),
        ((2.0, 1, "+"), "+2.0"),
        ((-0.55, 1, "+"), "-0.6"),
    ],
)
def test_a_number_may_be_missing_or_never(args, text):
    assert summary.format_number(*args) == text


def test_cells_are_those_of_the_stiffness_that_settles_last():
    line = pd.Series(
        {"cx_front_settle_1": 1.0, "cx_front_settle_1_most": 9.0, "cy_front_settle_1": 2.0,
         "cy_front_settle_1_most": 3.0, "cy_rear_settle_1": 1.5, "cy_rear_settle_1_most": np.inf}
    )  # fmt: skip
    assert summary.format_settling(line, 1) == ["2.0 (never)", "-"] and summary.format_settling(line, 2) == [
        "-",
        "-",
    ]
    assert (
        summary.format_three(pd.Series({"cx_front_bias": 1.26, "cy_rear_bias": -2.0}), "bias", 1, "+")
        == "+1.3, -, -2.0"
    )
    line = pd.Series({"diverged": 2, "diverged_low": 0.25, "diverged_high": 31.5})
    assert (
        summary.format_divergence(line) == "2 (0.2 .. 31.5 %)"
        and summary.format_divergence(pd.Series()) == "-"
    )
    line = pd.Series({"x_rms": 1.234, "x_rms_low": 1.0, "x_rms_high": np.nan, "y_rms": np.nan})
    assert (summary._format_rms(line, "x"), summary._format_rms(line, "y")) == ("1.23 (1.00 .. -)", "-")


@pytest.mark.parametrize(
    ("times", "text"),
    [([3.0, 1.0, 2.0], "2.00 (3.00)"), ([1.0, np.inf, 2.0], "2.00 (never: 1)"),
     ([4.0, 1.0, 2.0, 3.0], "3.00 (4.00)"),
     ([np.nan, 5.0], "5.00 (5.00)"), ([np.nan], "-"), ([np.inf, np.inf, 1.0], "never (never: 2)")],
)  # fmt: skip
def test_times_are_median_and_longest_or_how_many_never(times, text):
    assert summary._format_median(pd.Series(times)) == text


def test_shares_means_and_errors_have_their_intervals():
    low, high = stats.beta.ppf([0.025, 0.975], [3, 4], [2, 1])
    hit = pd.Series([True, True, False, True])
    assert summary._format_share_of(hit) == f"75 ({100 * low:.0f} .. {100 * high:.0f}) %"
    half = stats.t.ppf(0.975, 2) / np.sqrt(3)
    assert summary._format_mean_of(pd.Series([-1.0, -2.0, -3.0])) == f"-2.00 ± {half:.2f}"
    part = make_runs(cx_front_off_w1=[1, 0, 0], cy_rear_off_w1=[1, 1, 0], cy_front_off_w0=1)
    (cell,) = summary._format_errors([part], 1)
    assert cell.startswith("2 of 3; 67 (")  # runs, not stiffnesses, and of this window
    assert summary._format_normality(pd.Series([1.0, 3.0])) == "1.41"
    assert summary._format_normality(pd.Series(np.arange(8.0))).startswith("2.45; 0.")


def test_the_overview_has_a_row_of_each_case_and_estimators_if_there_are_several():
    plan = make_plan(make_case("one"))
    runs = make_runs(noise_accel_y=2.0, cy_front_bias=[-1.0, -2.0, -3.0])
    table = summary.make_overview(plan, summary.summarise(plan, runs))
    row = dict(zip(table.head, table.rows[0], strict=True))
    assert (table.left, row["case"], row["runs"]) == (1, "one: title of one", "3") and "estimator" not in row
    assert row["bias [%]"] == "+1.00, -2.00, +1.00" and row["noise / setting"] == "1.0, 2.0, 1.0"
    assert (
        row["RMS error Cy front [%] (95 %)"].startswith("2.00 (2.00")
        and row["truth in 95 % interval [% of rows]"] == "95, 95, 95"
    )
    assert (row["false valid [%]"], row["faults reported [%]"], row["restarts"]) == ("10.00", "10.0", "0")
    plan = make_plan(make_case("one", "tse", "ekf"))
    both = pd.concat([make_runs(), make_runs(estimator="ekf", diverged=1)])
    table = summary.make_overview(plan, summary.summarise(plan, both))
    assert table.left == 2 and [r[1] for r in table.rows] == ["tse", "ekf"]
    assert [r[3].split()[0] for r in table.rows] == ["0", "3"]
    lines = table.markdown().splitlines()
    assert (
        lines[0] == "## All cases"
        and lines[2].startswith("Cells with three numbers")
        and any(line.startswith("|---|---|---:|") for line in lines)
    )
    bare = summary.Table("t", ["a"], [["1"]]).markdown().splitlines()
    assert bare == ["## t", "", "| a |", "|---|", "| 1 |"]


def test_ratios_are_of_the_same_runs_and_none_of_the_peers():
    case = make_case("one", "tse", "known", "ekf", "robust", windows=((1.0, 2.0), (3.0, 4.5)))
    squares = np.array([1.0, 4.0, 9.0])
    runs = pd.concat([
        make_runs(estimator="tse", cy_front_mean_square_w1=4 * squares),
        make_runs(estimator="known", cy_front_mean_square_w1=squares),
        make_runs(estimator="ekf"),
        make_runs(estimator="robust", **{f"{s}_mean_square_w{n}": np.nan for s in STIFFNESS for n in (0, 1)}),
    ])  # fmt: skip
    (table,) = summary.tabulate_ratios(make_plan(case), runs, "known")
    assert [r[:3] for r in table.rows] == [["one", "tse", "1 .. 2"], ["one", "tse", "3 .. 4.5"]]
    assert table.rows[1][3:6] == ["1.00 (1.00 .. 1.00)", "2.00 (2.00 .. 2.00)", "1.00 (1.00 .. 1.00)"]
    rms = np.sqrt(squares.mean())
    assert table.rows[1][6:] == [f"2.00, {2 * rms:.2f}, 2.00", f"2.00, {rms:.2f}, 2.00"]
    assert summary.tabulate_ratios(make_plan(case), runs[runs["estimator"] != "known"], "known") == []


def test_changes_of_the_road_have_a_row_of_each_event():
    case = make_case("one", events=(20.0, 45.5))
    runs = make_runs(cy_rear_settle_1=[4.0, 5.0, 6.0], cx_front_settle_2=1.0, detected_2=[1.0, np.inf, 2.0])
    runs = runs.assign(all_settle_2=1.0, valid_off_2=0.0, **{f"{s}_stay_2": np.inf for s in STIFFNESS})
    plan = make_plan(case)
    lines = summary.summarise(plan, runs)
    (table,) = summary.tabulate_changes(plan, lines)
    assert table.rows[0] == ["one", "tse", "20 s", "5.0 (6.0)", "3.0 (3.0)"]
    assert table.rows[1][2:] == ["45.5 s", "1.0 (1.0)", "never (never)"]
    assert summary.tabulate_changes(make_plan(), lines) == []
    after = summary._tabulate_after(plan, runs)
    assert after.rows[0] == ["one", "tse", "20 s", "1.00 (1.00)", "2.00 (2.00)", "0.50 (0.50)"]
    assert after.rows[1][3] == "2.00 (never: 1)"
    assert summary._tabulate_after(make_plan(replace(case, lasts=20.0)), runs).rows == []


def test_false_changes_are_rates_per_hour_of_each_case_and_of_all():
    runs = make_runs("one", seconds=1200.0, changes=[3.0, 1.0, 1.0], false_changes=[2.0, 1.0, 0.0])
    more = make_runs("two", seconds=1200.0, changes=1.0)
    deaf = make_runs("two", "ekf", changes=np.nan)
    plan = make_plan(make_case("one"), make_case("two", "tse", "ekf"))
    table = summary.tabulate_false_changes(plan, pd.concat([runs, more, deaf]))
    low, high = (stats.chi2.ppf(q, k) / 2 for q, k in ((0.025, 6), (0.975, 8)))
    assert table.rows[0] == ["one", "tse", "1.0", "5", "3", f"3.00 ({low:.2f} .. {high:.2f})", "2"]
    assert [r[:5] for r in table.rows[1:]] == [
        ["two", "tse", "1.0", "3", "0"],
        ["all", "tse", "2.0", "8", "3"],
    ]
    assert len(summary.tabulate_false_changes(make_plan(make_case("one")), runs).rows) == 1


def test_peers_are_compared_with_the_filter_that_has_the_covariances():
    plan = make_plan(make_case("one", "tse", "ekf"), study="peers")
    runs = pd.concat([
        make_runs(cy_front_mean_square=[4.0, 16.0, 36.0], estimate_s=0.02),
        make_runs(estimator="ekf", cy_front_mean_square=[1.0, 4.0, 9.0]),
    ])  # fmt: skip
    (table,) = summary.make_findings(plan, runs, summary.summarise(plan, runs))
    tse, ekf = (dict(zip(table.head, r, strict=True)) for r in table.rows)
    assert tse["Cy front / EKF"] == "2.00 (2.00 .. 2.00)" and ekf["Cy front / EKF"] == "1"
    assert (tse["time per step [µs]"], tse["time / EKF"], ekf["time / EKF"]) == ("50.0", "0.50", "1.00")
    assert tse["error below 10 % after [s]"] == "2.0 (2.0)" and tse["RMS error [%]"].startswith(
        "2.00, 4.32, "
    )


def test_each_study_has_its_own_tables_and_empty_ones_are_left_out():
    runs = make_runs("one", "known")
    for study, titles in (
        ("stress", []),
        ("accuracy", []),
        ("false-alarms", ["Changes of regime"]),
        ("regimes", ["Changes of regime"]),
        ("robust+ekf", ["one"]),
    ):
        plan = make_plan(make_case("one", "robust" if "robust" in study else "known"), study=study)
        mine = make_runs("one", "robust") if "robust" in study else runs
        found = summary.make_findings(plan, mine, summary.summarise(plan, mine))
        assert [t.title for t in found] == titles, study


def test_variants_have_their_text_and_the_scores_of_each_window():
    name = next(iter(estimators.VARIANTS))
    case = make_case("one", "robust", f"robust-{name}", windows=((1.0, 2.0), (3.0, 9.99)))
    runs = pd.concat([
        make_runs(estimator="robust", cx_front_spread_w0=[4.0, 5.0, 9.0]),
        make_runs(estimator=f"robust-{name}", cy_rear_mean_square_w1=25.0, cy_rear_off_w1=1),
    ])  # fmt: skip
    (table,) = summary._tabulate_robust(make_plan(case, study="robust"), runs, pd.DataFrame())
    assert table.head[2:6] == [
        "diverged runs, 1 .. 2 s",
        "rms error [%], 1 .. 2 s",
        "diverged runs, 3 .. 10 s",
        "rms error [%], 3 .. 10 s",
    ]
    one, two = table.rows
    assert one[1].startswith("settings of") and two[1] == estimators.VARIANTS[name][0]
    assert (
        one[-1] == "5.0, 1.0, 1.0" and two[4].startswith("3 of 3;") and two[5].endswith("5.00 (5.00 .. 5.00)")
    )
    assert two[2].startswith("0 of 3;") and two[3].endswith("2.00 (2.00 .. 2.00)")


def test_the_paper_s_numbers_are_beside_those_of_three_filters():
    waves = make_case("iv-a", *summary.PAPERS)
    lanes = make_case("iv-b-20", "paper", "robust", "tse")
    true = 100 * SimConfig().spread_cx_front
    runs = pd.concat([
        make_runs("iv-a", "printed", cx_front_spread_w0=np.array([1.02, 1.1, 1.3]) * true),
        make_runs("iv-a", "robust", cx_front_spread_w0=0.9 * true, cy_front_bias_w0=[-0.5, -0.5, -0.5]),
        make_runs("iv-a", "tse", cy_front_mean_square_w1=9.0),
        make_runs("iv-b-20", "paper", cx_front_bias_w0=3.0),
        make_runs("iv-b-20", "robust"),
        make_runs("iv-b-20", "tse", vel_x_square=0.04, yaw_rate_square=np.radians(0.5) ** 2),
    ])  # fmt: skip
    (table,) = summary.make_findings(make_plan(waves, lanes, study="paper"), runs, pd.DataFrame())
    rows = {r[0]: r[2:] for r in table.rows}
    fig1 = next(v for k, v in rows.items() if k.startswith("Fig. 1, inputs linear"))
    assert fig1 == ["+10", "-10", "-"]
    within = rows["... runs within 5 %, within 20 %"]
    assert within[0].startswith("33 (") and ", 67 (" in within[0] and within[1].startswith("0 (")
    assert rows["Fig. 2, inputs linear: Cy front, mean error, %"] == [
        "+1.00 ± 0.00",
        "-0.50 ± 0.00",
        "+1.00 ± 0.00",
    ]
    assert rows["inputs linear: rms error, 45 .. 60 s"][2].split(", ")[1] == "3.00 (3.00 .. 3.00)"
    assert rows["inputs linear: rms error, 15 .. 30 s"][2].split(", ")[1] == "2.00 (2.00 .. 2.00)"
    assert rows["Fig. 3, prior -20 %: mean error throughout"][0].startswith("+3.00 ± 0.00, +1.00")
    assert rows["Fig. 4, prior -20 %: rms error of vX, m/s; yaw rate, deg/s"][2] == "0.200; 0.500"


# ---- files and pictures


@pytest.mark.parametrize(
    ("more", "command"),
    [
        ({}, "tselab montecarlo --study stress --runs 3"),
        ({"study": "paper"}, "tselab paper --runs 3"),
        ({"study": "paper+ekf"}, "tselab montecarlo --study paper+ekf --runs 3"),
        (
            {"first_seed": 7, "form": "robust"},
            "tselab montecarlo --study stress --runs 3 --first-seed 7 --form robust",
        ),
        (
            {"settings": {"particles": 64}, "sim_settings": {"noise": 0.5}, "cases": ("a", "b")},
            "tselab montecarlo --study stress --runs 3 --set particles=64 --set noise=0.5 --cases a,b",
        ),
    ],
)
def test_the_command_of_a_study_has_what_differs_from_its_defaults(more, command):
    assert pictures.format_command(make_plan(**more)) == command


def test_the_facts_of_a_study_are_its_runs_settings_and_cost():
    lines = pd.DataFrame([{"case": "one", "estimator": "tse", "simulate_s": 0.5, "estimate_s": 0.04}])
    plan = make_plan(first_seed=5, settings={"particles": 64}, sim_settings={"noise": 0.5})
    facts = dict(pictures.list_run_facts(plan, lines))
    assert (
        facts["Runs"] == "3 of each case, seeds 5 .. 7"
        and facts["Settings"] == "form default, particles = 64, noise = 0.5"
    )
    assert facts["Cost"].startswith("0.54 s for a run of case one with estimator tse") and facts[
        "Cost"
    ].endswith("0.50 s")
    assert (
        dict(pictures.list_run_facts(make_plan(runs=1, first_seed=4), lines))["Runs"]
        == "1 of each case, seed 4"
    )
    table = summary.Table("t", ["a"], [["1"]])
    text = pictures.format_markdown(plan, [("Runs", "three")], [table])
    assert text.startswith("# A title\n\n- Runs: three\n\n## t\n") and "stress.csv (intervals" in text


@pytest.mark.parametrize(
    ("study", "drawn", "files", "overview"),
    [
        ("paper", True, ["csv", "md", "png"], False),
        ("paper", False, ["csv", "md"], False),
        ("stress", True, ["csv", "md"], True),
    ],
)
def test_a_study_writes_its_tables_and_the_paper_s_its_picture(
    monkeypatch, tmp_path, study, drawn, files, overview
):
    monkeypatch.setattr(pictures, "draw_paper", lambda *_: drawn)
    plan = make_plan(make_case("one"), study=study)
    text, paths = pictures.write_study(plan, make_runs(), tmp_path)
    assert [p.name for p in paths] == [f"{study}.{end}" for end in files]
    assert (tmp_path / f"{study}.md").read_text(encoding="utf-8") == text and (
        "## All cases" in text
    ) == overview
    assert pd.read_csv(tmp_path / f"{study}.csv")["cy_front_rms"][0] == 2.0


def get_drawn(axis: MagicMock) -> dict[str, np.ndarray]:
    """Return the values of the lines by their labels; one without a label is ''."""
    return {call.kwargs.get("label", ""): np.asarray(call.args[1]) for call in axis.plot.call_args_list}


def make_traced(**truth: float) -> tuple[CaseDrive, np.ndarray]:
    d = make_drive(3, **{"true_cx_front": 0.8, "true_cy_front": 0.9, "true_cy_rear": 0.7} | truth)
    y = np.zeros(
        3,
        [(f"cx_front{e}", float) for e in ("", "_sd", "_spread")]
        + [("cy_rear", float), ("cy_rear_sd", float)],
    )
    for name, value in zip(y.dtype.names, (0.85, 0.02, 0.06, 0.75, 0.03), strict=True):
        y[name] = value
    return d, y


def test_the_first_figure_has_the_spread_of_particles_and_the_sd_of_the_default_filter():
    d, y = make_traced()
    d.sim = SimConfig({"spread_cx_front": 0.1})
    for name, label, value in (("tse", "sd of the mean", 0.02), ("robust", "standard deviation", 0.06)):
        pictures._draw_fig1(axis := MagicMock(), name, d, y)
        drawn = get_drawn(axis)
        assert {k: v[0] for k, v in drawn.items()} == pytest.approx(
            {"truth": 0.8, "stiffness": 0.85, "": 0.08, label: value}
        )
    axis.axvline.assert_called_once()
    d.config = Config.exact({"form": 1})
    pictures._draw_fig1(axis := MagicMock(), "tse", d, y)
    assert get_drawn(axis)["standard deviation"][0] == 0.06


def test_the_second_figure_is_the_share_of_runs_in_bins_of_a_quarter_percent():
    x = np.array([0.1, 0.2, -0.1, 9.0, -9.0])
    pictures._draw_fig2(axis := MagicMock(), "tse", x)
    left, height, width = axis.bar.call_args.args
    assert width == pytest.approx(0.25) and height.sum() == pytest.approx(1)
    assert dict(zip(left, height, strict=True))[0.0] == pytest.approx(0.4)
    assert (height[0], height[-1]) == pytest.approx((0.2, 0.2))  # beyond the ends
    bell, edges = axis.stairs.call_args.args
    assert bell == pytest.approx(np.diff(stats.norm.cdf(edges, x.mean(), x.std(ddof=1))))
    pictures._draw_fig2(axis := MagicMock(), "tse", np.array([0.1]))
    assert axis.stairs.call_args.args[0].sum() == pytest.approx(1)


def test_the_third_figure_is_the_estimate_with_its_sd_of_the_stiffness_itself():
    d, y = make_traced()
    pictures._draw_fig3(axis := MagicMock(), "cy_rear", "printed", d, y)
    values = [np.asarray(call.args[1])[0] for call in axis.plot.call_args_list]
    assert values == pytest.approx([0.7, 0.75, 0.72, 0.78])
    assert axis.set.call_args.kwargs["title"] == "Fig. 3, as printed: Cy rear"


def test_the_picture_of_the_demo_has_truth_estimate_and_road(monkeypatch, tmp_path):
    n = 5
    axes, plt = [MagicMock() for _ in range(4)], MagicMock()
    labels = ["95 % interval", "not valid", "truth", "estimate"]
    axes[0].get_legend_handles_labels.return_value = (labels, labels)
    plt.subplots.return_value = (figure := MagicMock(), axes)

    @contextmanager
    def open_picture(path):
        yield plt

    monkeypatch.setattr(pictures, "open_picture", open_picture)
    est = pd.DataFrame({"time": np.arange(n) * 1.0})
    for k, key in enumerate(STIFFNESS):
        est = est.assign(**{key: 1e5 * (k + 1), f"{key}_sd": 2e3, f"{key}_valid": [0, 0, 1, 1, 3]})
    truth = pd.DataFrame({f"true_{key}": np.full(n + 2, 0.9e5) for key in STIFFNESS})
    truth = truth.assign(true_vel_x=20.0, road_level=[1.0, 1, 1, 0.7, 0.7, 1.0, 1.0])  # the run was cut
    log = pd.DataFrame({"steer_angle": np.full(n + 2, 0.02)})
    pictures.draw_demo(tmp_path / "p.png", est, truth, log)
    for k, axis in enumerate(axes[:3]):
        band, shade = axis.fill_between.call_args_list
        value = 100.0 * (k + 1)
        assert (band.args[1][0], band.args[2][0]) == pytest.approx((value - 3.92, value + 3.92))
        assert shade.kwargs["where"].tolist() == [True, True, False, False, True]
        drawn = get_drawn(axis)
        assert (drawn["truth"][0], drawn["estimate"][0], len(drawn["truth"])) == (90, value, n)
    assert np.asarray(axes[3].plot.call_args.args[1]) == pytest.approx(np.full(n, 20.0))  # mrad
    (note,) = axes[0].annotate.call_args_list
    assert note.args[0] == "road level 1 → 0.7" and note.args[1][0] == 3.0
    assert [axis.axvline.call_args.args[0] for axis in axes] == [3.0] * 4
    assert figure.legend.call_args.args[1] == ["truth", "estimate", "95 % interval", "not valid"]


def test_a_picture_of_the_paper_needs_matplotlib(monkeypatch, tmp_path):
    monkeypatch.setattr(pictures.importlib.util, "find_spec", lambda _: None)
    assert not pictures.draw_paper(make_plan(study="paper"), make_runs(), tmp_path / "p.png")
