"""Cases of the studies: manoeuvres, settings, seeds, estimators, units of work.

Manoeuvres are looked at as they are planned; what is simulated lasts less than a second.
"""

import sys
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from tse.library.core import INPUT, NOMINAL, SIM_OUTPUT, STIFFNESS, Config, SimConfig, library
from tse.library.errors import UserError
from tse.log.rows import DRIVES, MEASURES
from tse.simulation import maneuvers
from tselab.montecarlo import STUDIES, engine, estimators, peers, studies
from tselab.montecarlo.case import INITIAL_SETTINGS, Case, CaseDrive, simulate_case
from tselab.montecarlo.studies import Study, make_study

CAR = Config.exact(
    {
        "mass": 1500.0,
        "wheel_radius_front": 0.3,
        "wheel_radius_rear": 0.35,
        "longitudinal_stiffness_front": 1e5,
    }
)


def plan_drive(make, seed: int = 1, **more) -> maneuvers.Maneuver:
    return make(CAR, SimConfig({"seed": seed}), np.random.default_rng(seed), **more)


def get_at(m: maneuvers.Maneuver, values: np.ndarray, *times: float) -> list[float]:
    return [float(values[np.searchsorted(m.time, t - 1e-6)]) for t in times]


# ---- manoeuvres


def test_square_waves_of_a_study_have_their_own_torque_steering_and_road():
    m = plan_drive(studies.drive_square_waves, duration=6.0, steer=0.005, torque=250.0, road=((3.0, 0.7),))
    assert get_at(m, m.wheel_torque_front, 0, 2.49, 2.5, 5.0) == [250, 250, -250, 250]
    assert get_at(m, m.steer_angle, 0, 2, 4) == [0.005, -0.005, 0.005]
    assert get_at(m, m.road_level, 2.99, 3.0) == [1.0, 0.7] and m.time[-1] == 6.0
    sim = SimConfig({"wheel_inertia_front": 3.0, "wheel_inertia_rear": 2.0})
    force = 1e5 * 0.005  # accelerates car and rear wheels; the front wheels take up a little more
    a = force / (1500 + 2.0 / 0.35**2)
    torque = force * 0.3 + 3.0 / 0.3 * a
    assert studies.find_torque(CAR, sim, 0.005) == pytest.approx(torque)
    low = studies.drive_square_waves(CAR, sim, np.random.default_rng(1), duration=1.0, torque=None)
    assert low.wheel_torque_front[0] == pytest.approx(torque)


def test_the_highway_ends_with_a_lane_change():
    m = plan_drive(studies.drive_highway, 3)
    straight = plan_drive(studies.drive_listed, 3, name="straight", duration=315.0)
    change = m.steer_angle - straight.steer_angle
    assert get_at(m, change, 302.75, 304.25) == pytest.approx([0.015, -0.015])
    assert not change[(m.time < 302) | (m.time >= 305)].any() and m.time[-1] == 315
    other = plan_drive(studies.drive_listed, 4, name="straight", duration=315.0)
    assert (other.steer_angle != straight.steer_angle).any()  # the seed of the simulator


def test_reverse_goes_back_stops_and_launches():
    m = plan_drive(studies.drive_reverse)
    push = np.array(get_at(m, m.wheel_torque_front, 0, 4.9, 5, 11.9, 12, 16.9, 17, 20, 29.9)) / (1500 * 0.3)
    assert push == pytest.approx([-0.6, -0.6, 0, 0, 0.6, 0.6, 0, 1.8, 1.8])
    assert get_at(m, m.wheel_torque_front, 30, 32.5) == [700, -700]
    assert get_at(m, m.steer_angle, 4.9, 5, 6, 12, 29.9) == [0, 0.05, -0.05, 0, 0]
    assert np.abs(m.steer_angle[m.time >= 30]).max() == 0.02 and (m.speed, m.time[-1]) == (0.0, 60.0)
    assert m.target_speed is None and not m.wheel_torque_rear.any()


def test_wheels_lock_by_the_brake_and_the_car_gets_its_speed_back():
    m = plan_drive(studies.drive_wheel_lock)
    for start in (20.0, 45.0):
        assert get_at(m, m.brake_torque_front, start - 0.01, start, start + 0.99, start + 1) == [
            0,
            6000,
            6000,
            0,
        ]
        assert not any(get_at(m, m.wheel_torque_front, start, start + 0.99))
        waves = plan_drive(studies.drive_square_waves, duration=75.0)
        more = m.wheel_torque_front - waves.wheel_torque_front
        assert get_at(m, more, start + 1.99, start + 2, start + 5.99, start + 6) == [0, 700, 700, 0]
    assert m.brake_torque_rear is None


def test_wheels_spin_by_the_torque_and_the_brakes_take_the_speed_back():
    m = plan_drive(studies.drive_wheel_spin)
    waves = plan_drive(studies.drive_square_waves, duration=75.0)
    more = m.wheel_torque_front - waves.wheel_torque_front
    for start in (20.0, 45.0):
        assert get_at(m, m.wheel_torque_front, start, start + 0.84) == [4000, 4000]
        assert get_at(m, more, start - 0.01, start + 0.85, start + 2, start + 5.99, start + 6) == [
            0,
            0,
            -600,
            -600,
            0,
        ]


def test_the_paper_s_start_is_drawn_from_its_distribution():
    found = []
    for seed in range(200):
        sim = SimConfig({"seed": seed})
        m = studies.drive_paper_waves(
            CAR, sim, np.random.default_rng(seed), duration=0.02, road=((0.01, 0.7),)
        )
        found.append((m.speed, sim.vel_y))
    speed, lateral = np.array(found).T
    assert (speed.mean(), speed.std()) == pytest.approx((22, 1), abs=0.2)
    assert (lateral.mean(), lateral.std()) == pytest.approx((0, 1), abs=0.2)
    assert abs(np.corrcoef(speed, lateral)[0, 1]) < 0.2 and m.road_level.tolist() == [1, 0.7, 0.7]
    drawn = [
        studies._draw_paper_prior(CAR, SimConfig({"speed": 20.0}), np.random.default_rng(k))["initial_vel_x"]
        for k in range(200)
    ]
    assert (np.mean(drawn), np.std(drawn)) == pytest.approx((20, 1), abs=0.2)


def test_the_paper_s_lanes_come_after_a_straight_approach():
    m = plan_drive(studies.drive_paper_lanes)
    listed = plan_drive(studies.drive_listed, name="double-lane-change", duration=38.0)
    push = np.array(get_at(m, m.wheel_torque_front, 0.9, 1, 3.9, 4, 6, 8.9, 9)) / (1500 * 0.3)
    assert push == pytest.approx([0, 1, 1, 0, 1, 1, 0])
    assert (m.time[-1], len(m.time)) == (48.0, 4801) and not m.steer_angle[m.time < 13].any()
    assert (m.steer_angle[1000:] == listed.steer_angle).all()
    assert m.wheel_torque_front[1100] == pytest.approx(1.2 * 1500 * 0.3)
    assert m.speed == listed.speed - 6


def test_a_slow_change_is_linear_between_its_ends():
    m = plan_drive(studies.drive_slow_change, start=2.0, length=4.0, level=0.6, after=1.0)
    assert get_at(m, m.road_level, 0, 2, 4, 6, 7) == pytest.approx([1, 1, 0.8, 0.6, 0.6]) and m.time[-1] == 7


def test_random_waves_have_two_periods_and_the_size_of_their_range():
    t = np.arange(0, 400, 0.1)
    for seed in range(5):
        x = studies._make_waves(t, np.random.default_rng(seed), (0.02, 0.03), (6.0, 12.0))
        power = np.abs(np.fft.rfft(x)) ** 2
        period = 400 / np.arange(1, len(power))
        assert power[1:][(period > 5.8) & (period < 12.5)].sum() > 0.95 * power[1:].sum()
        # two sines of 0.7 and 0.3 of the size
        assert 0.02 * 0.9 < np.sqrt(2 * np.mean(x**2) / (0.7**2 + 0.3**2)) < 0.03 * 1.1


def test_ordinary_driving_stays_within_its_speeds_and_accelerations():
    straight = waves = 0
    understeer = maneuvers.compute_understeer(CAR)
    for seed in range(12):
        m = plan_drive(studies.drive_ordinary, seed, duration=120.0)
        v = m.target_speed
        assert len(v) == 12001 and m.speed == v[0] and (v >= 8).all() and (v < 35 + 5).all()
        rate = np.diff(v) / np.diff(m.time)
        steady = np.abs(rate) < 20  # between two parts a square wave may end with a step
        assert steady.mean() > 0.999 and np.abs(rate[steady]).max() < 1.5 + 1.0 + 1e-6
        lateral = m.steer_angle * v**2 / (CAR.lf + CAR.lr + understeer * v**2)
        assert 0.1 < np.abs(lateral).max() < 2.5 * 1.2
        straight += int((m.steer_angle == 0).sum() > 1000)
        waves += int(np.isclose(np.abs(rate), 1.0).sum() > 300)
    assert 0 < straight < 12 and 0 < waves < 12


# ---- lists of cases


def test_cases_are_what_their_names_say():
    cases = {c.name: c for c in make_study("stress").cases}
    assert len(cases) == len(make_study("stress").cases)
    for s in (1, 5, 15):
        assert cases[f"spread-{s}"].sim == dict.fromkeys(studies.SPREADS, s / 100)
    for f in (0.98, 0.99, 0.995, 0.999):
        assert cases[f"forgetting-{f:g}"].config == {"forgetting": f}
    for ms in (5, 10, 20, 40):
        assert cases[f"sample-{ms}ms"].config == {"sample_time": ms / 1000}
    assert (cases["noise-3x"].sim, cases["noise-third"].sim) == ({"noise": 3.0}, {"noise": 1 / 3})
    for name, by in (("mass+10", 1.1), ("mass-10", 0.9)):
        assert cases[name].car == {"mass": by, "yaw_inertia": by}
    assert cases["imu-bias"].sim["true_bias_yaw_rate"] == pytest.approx(np.radians(0.2))
    for c in (*DRIVES, *MEASURES):
        for kind, fault in (("dropout", studies.drop_channel), ("stuck", studies.freeze_channel)):
            corrupt = cases[f"{kind}-{c}"].corrupt
            assert (corrupt.func, corrupt.keywords) == (fault, {"channel": c})
            assert cases[f"{kind}-{c}"].windows == ((15.0, 95.0),)
    assert cases["wheel-noise-known"].config == {"wheel_noise_sd": 0.05}
    assert (
        cases["wheel-noise-unknown"].sim == {"wheel_speed_sd": 0.05}
        and not cases["wheel-noise-unknown"].config
    )
    assert cases["highway"].windows == ((305.0, 315.0),)
    assert cases["wheel-lock"].windows == ((15.0, 20.0), (60.0, 75.0)) and cases["wheel-spin"].sim == {
        "friction": 0.9
    }
    assert cases["nominal"].windows == ((15.0, 30.0),)


def test_windows_of_a_change_end_before_it_and_begin_when_it_is_over():
    for name in ("regimes", "paper"):
        for case in make_study(name).cases:
            for event in case.events:
                for a, b in case.windows:
                    assert case.lasts or not a <= event <= b, (case.name, event)
    for name, low in (("iv-b-20", 0.8), ("iv-b+20", 1.2)):
        (case,) = make_study("paper", (name,)).cases
        assert {case.config[f"initial_{s}"] for s in STIFFNESS} == {low} and case.config[
            "forgetting"
        ] == 0.995
        assert case.windows == ((0.0, 48.0), (44.0, 48.0))
    held = make_study("paper", ("iv-a-held",)).cases[0]
    assert (held.sim, held.config) == ({"hold_inputs": 1}, {"integration": 2})
    assert make_study("false-alarms", ("false-alarms-held",)).cases[0].sim == {"hold_inputs": 1}
    slow = make_study("regimes", ("slow-20",)).cases[0]
    assert (slow.events, slow.lasts, slow.windows) == ((20.0,), 20.0, ((20.0, 60.0),))


def test_a_study_has_the_cases_that_are_asked_for_and_each_estimator_once():
    study = make_study("peers+tse+printed", ("road-change", "nominal"))
    assert [c.name for c in study.cases] == ["nominal", "road-change"]  # in the order of the study
    assert study.cases[0].estimators == ("tse", "robust", "robust-100", "ekf", "known", "printed")
    assert (study.base, study.runs, study.title) == ("peers", *STUDIES["peers"])
    assert study.case("road-change").events == (20.0,)
    assert make_study("robust").cases[0].estimators[1] == f"robust-{next(iter(estimators.VARIANTS))}"
    with pytest.raises(UserError, match="no estimator 'nobody'"):
        make_study("stress+nobody")


# ---- the drive of a case


def make_case(**more) -> Case:
    return Case("short", "", partial(studies.drive_square_waves, duration=0.2), **more)


def configure(about) -> Config:
    return Config.exact({**INITIAL_SETTINGS, **about})


def test_a_drive_has_the_settings_of_case_and_user_and_a_car_of_its_own():
    case = make_case(
        config={"forgetting": 0.98}, car={"mass": 1.1}, sim={"noise": 2.0, "friction": 0.8}, events=(0.1,)
    )
    d = simulate_case(case, 5, configure, {"noise": 7.0, "spread_cx_front": 0.02})
    assert (d.sim.noise, d.sim.spread_cx_front, d.sim.seed, d.friction) == (2.0, 0.02, 5, 0.8)
    assert (d.about, d.events) == ({"forgetting": 0.98, "seed": 5}, (0.1,))
    assert d.car.mass == pytest.approx(1.1 * d.config.mass) and d.config.seed == 5
    assert d.sim.speed == 20 and len(d.rows) == 21 and not d.corrupted.any()
    assert (d.rows["accel_y"] == d.truth["accel_y"]).all() and d.rows["dt"] == pytest.approx(0.01)
    assert d.stiffness.shape == (21, 3) and (d.stiffness[:, 2] == d.truth["true_cy_rear"]).all()


def test_each_seed_and_each_case_has_its_own_random_numbers():
    drawn = []

    def draw(config, sim, rng):
        assert sim.speed == 17.0
        drawn.append(rng.random())
        return {"initial_vel_x": 20 + drawn[-1]}

    def corrupt(time, rows, rng):
        rows["accel_y"][3] = np.nan
        return time > 0.1

    build = partial(studies.drive_square_waves, duration=0.2)
    case = make_case(draw=draw, corrupt=corrupt)
    case = replace(case, build=lambda *given: replace(build(*given), speed=17.0))
    d = simulate_case(case, 1, configure, {})
    assert d.about["initial_vel_x"] == d.config.initial_vel_x == 20 + drawn[0]
    assert (
        d.corrupted.sum() == 10 and np.isnan(d.rows["accel_y"][3]) and np.isfinite(d.truth["accel_y"]).all()
    )
    again = simulate_case(case, 1, configure, {})
    assert (again.rows["accel_x"] == d.rows["accel_x"]).all()
    other = simulate_case(case, 2, configure, {})
    assert (other.rows["accel_x"] != d.rows["accel_x"]).any()
    simulate_case(replace(case, name="another"), 1, configure, {})
    assert drawn[0] == drawn[1] and len(set(drawn)) == 3


# ---- estimators


def test_settings_come_from_form_user_case_and_name_in_this_order():
    assert estimators.get_overrides("robust-256") == {"particles": 256}
    assert estimators.get_overrides("robust-no-limit") == {"spread_max": 2.0}
    assert (
        estimators.get_overrides("ekf")
        == estimators.get_overrides("paper")
        == estimators.get_overrides("tse")
        == {}
    )
    for name in ("tse-100", "robust-nothing", "nobody", "paper-1.5"):
        with pytest.raises(UserError, match="no estimator"):
            estimators.get_overrides(name)
    c = estimators.configure_estimator(
        "tse", "robust", {"forgetting": 0.9, "particles": 64}, {"forgetting": 0.95}
    )
    assert (c.form, c.forgetting, c.particles, c.initial_cy_rear, c.driven_axle) == (1, 0.95, 64, 0.7, 1)
    c = estimators.configure_estimator("robust-100", "default", {"particles": 64}, {"particles": 32})
    assert (c.form, c.particles) == (1, 100)
    assert estimators.configure_estimator("ekf", "default", {}, {}).form == 0
    c = estimators.configure_estimator("printed", "default", {}, {"initial_vel_x": 5.0})
    assert (c.initial_vel_x, c.initial_vel_x_from_wheels, c.integration) == (22.0, 0, 0)


@pytest.mark.parametrize(
    ("name", "yours"),
    [("tse", False), ("a.b", True), ("a.b.c", True), ("a-b.c", False), (".b", False), ("a.", False)],
)
def test_a_name_with_a_dot_is_a_function_of_the_user(name, yours):
    assert estimators.is_yours(name) == yours


def make_drive(n: int = 4, **sim: float) -> CaseDrive:
    truth = np.zeros(n, library().dtype(SIM_OUTPUT))
    rows = np.zeros(n, library().dtype(INPUT))
    rows["yaw_rate"] = np.arange(n)
    config = Config.exact()
    no = np.zeros(n, bool)
    return CaseDrive(
        0.1 * np.arange(n), rows, truth, np.ones(n), no, {}, config, config, SimConfig(sim), (2.0, 3.0)
    )


def test_a_function_of_the_user_gets_the_log_and_gives_newton(monkeypatch):
    d = make_drive()
    nominal = {s: getattr(d.config, NOMINAL[s]) for s in STIFFNESS}
    answer = {s: 0.5 * nominal[s] + np.zeros(4) for s in STIFFNESS}
    answer |= {f"{s}_sd": 0.1 * nominal[s] + np.zeros(4) for s in STIFFNESS}
    answer |= {"cy_rear_spread": 0.05 * nominal["cy_rear"] + np.zeros(4), "other": 1}
    seen = []
    mine = SimpleNamespace(run=lambda log, settings: seen.append((log, settings)) or answer, number=3)
    monkeypatch.setitem(sys.modules, "mine", mine)
    out = estimators.run_estimator("mine.run", d, d.config)
    assert {f: out[f][0] for f in out.dtype.names} == pytest.approx(
        {**dict.fromkeys(STIFFNESS, 0.5), **{f"{s}_sd": 0.1 for s in STIFFNESS}, "cy_rear_spread": 0.05}
    )
    log, settings = seen[0]
    assert log["time"].tolist() == d.time.tolist() and log["yaw_rate"].tolist() == [0, 1, 2, 3]
    assert settings["mass"] == d.config.mass
    answer["cx_front"] = np.zeros(3)
    with pytest.raises(UserError, match=r"cx_front with shape \(3,\); needed is \(4,\)"):
        estimators.run_estimator("mine.run", d, d.config)
    del answer["cx_front"], answer["cy_front_sd"]
    with pytest.raises(UserError, match=r"must return these columns, too: cx_front, cy_front_sd$"):
        estimators.run_estimator("mine.run", d, d.config)
    for name, why in (
        ("mine.number", "is not a function"),
        ("mine.none", "no estimator"),
        ("no_such.f", "PYTHONPATH"),
    ):
        with pytest.raises(UserError, match=why):
            estimators.get_overrides(name)


def test_a_peer_gets_the_true_spread_and_noise_of_the_drive():
    sim = {"noise": 3.0, "hold_inputs": 1, "true_cx_front": 0.8, "true_cy_front": 0.9}
    sim |= {"spread_cx_front": 0.05, "spread_cy_front": 0.06, "spread_cy_rear": 0.07}
    d = make_drive(**sim)
    config = Config.exact({"forgetting": 0.97, "accel_x_sd": 0.1, "accel_y_sd": 0.2, "yaw_rate_sd": 0.01})
    known = estimators._make_known(d, config)
    assert known.spread == pytest.approx((0.04, 0.054, 0.07))
    assert known.noise_sd == pytest.approx((0.3, 0.6, 0.03))
    assert (known.forgetting, known.held, known.changes) == (0.97, True, (2.0, 3.0))
    assert estimators._make_known(d, config, True).spread == pytest.approx((0.05, 0.06, 0.07))
    assert not estimators._make_known(make_drive(), config).held


def test_a_missing_input_is_held_from_the_row_before_or_the_first_known_one():
    nan = np.nan
    u = np.array([[nan, 1.0, nan], [nan, nan, nan], [3.0, nan, nan], [nan, 4.0, nan]])
    assert peers._hold_inputs(u).tolist() == [[3, 1, 0], [3, 1, 0], [3, 1, 0], [3, 4, 0]]


def test_peers_restart_and_leave_out_the_same_rows_as_tse():
    config = Config.exact({"max_gap": 0.25, "hold_speed": 2.0, "max_steer": 0.5})
    c = SimpleNamespace(**config.as_dict())
    n = 12
    dt, known = np.full(n, 0.1), np.ones(n, bool)
    u = np.column_stack([np.zeros(n), np.full(n, 30.0), np.full(n, 30.0)])
    y = np.zeros((n, 3))
    u[2, 1] = 1.0  # one axle is slow
    u[4, 0] = -0.6  # large steering angle
    dt[6] = 0.3  # gap
    known[8:11] = False  # the third row without inputs is more than 0.25 s after the last with them
    y[5, 1], y[7, 0] = 1e3, np.nan
    restart, usable = peers._find_conditions(c, dt, u, y, known)
    assert np.flatnonzero(restart).tolist() == [0, 2, 3, 6, 10, 11]
    expected = np.ones((n, 3), bool)
    expected[[2, 4, 8, 9, 10]] = False
    expected[[0, 3, 6, 11], 2] = False  # their yaw rate is that of the state
    expected[5, 1] = expected[7, 0] = False
    assert (usable == expected).all()
    restart, usable = peers._find_conditions(c, dt, u, y, np.arange(n) >= 3)
    assert restart[:4].all() and not restart[4] and not usable[:3].any()


# ---- units of work


def test_a_plan_has_each_case_with_each_seed_and_a_mark_of_all_that_counts():
    study = make_study("stress", ("nominal", "vy-start"))
    plan = engine.StudyPlan(study, 3, 5, "robust", {"particles": 64}, {"noise": 2.0})
    assert list(plan.seeds) == [5, 6, 7]
    assert [(u.case, u.seed) for u in plan.units] == [
        (c, s) for c in ("nominal", "vy-start") for s in (5, 6, 7)
    ]
    unit = plan.units[0]
    assert (unit.study, unit.form, unit.settings, unit.sim_settings) == (
        "stress", "robust", {"particles": 64}, {"noise": 2.0},
    )  # fmt: skip
    assert len({u.mark for u in plan.units}) == 6 == len({unit._replace(form=f).mark for f in "abcdef"})
    assert unit.mark == plan.units[0].mark


@pytest.fixture
def small(monkeypatch):
    case = make_case(
        estimators=("tse", "ekf"), windows=((0.1, 0.2),), config={"initial_cy_rear": 0.6}, events=(0.1,)
    )
    study = Study("small", "A small study", 1, (case,))
    monkeypatch.setattr(engine, "_load_study", lambda _: study)
    return engine.StudyPlan(study, 2, first_seed=4, settings={"initial_cy_front": 0.9})


def test_a_unit_has_a_row_of_each_estimator_with_the_columns_of_the_table(small):
    rows = engine.run_unit(small.units[1])
    assert [(r["case"], r["estimator"], r["seed"]) for r in rows] == [
        ("short", "tse", 5),
        ("short", "ekf", 5),
    ]
    assert (rows[0]["seconds"], rows[0]["steps"]) == (pytest.approx(0.2), 21)
    names = engine.list_columns("small")
    assert len(names) == len(set(names)) and set(rows[0]) <= set(names) and set(rows[1]) <= set(names)
    assert set(engine.TIMES) <= set(rows[0]) and rows[0]["simulate_s"] > 0
    d, estimate = engine.trace_run(small, small.study.cases[0], 5, "tse")
    inside = d.time >= 0.1 - 1e-9
    for key in STIFFNESS:
        error = estimate[key][inside].astype(float) / d.truth[f"true_{key}"][inside] - 1
        assert rows[0][f"{key}_bias"] == pytest.approx(100 * error.mean())
    assert [getattr(d.config, f"initial_{s}") for s in STIFFNESS] == [0.7, 0.9, 0.6]


def test_the_table_of_runs_is_in_the_order_of_cases_estimators_and_seeds(small, tmp_path):
    table = engine.run_study(small, tmp_path)
    assert list(zip(table["estimator"], table["seed"], strict=True)) == [
        ("tse", 4),
        ("tse", 5),
        ("ekf", 4),
        ("ekf", 5),
    ]
    assert list(table) == engine.list_columns("small") and (tmp_path / "runs.csv").exists()
    lines = (tmp_path / engine.RUNS).read_text().splitlines()
    marks = [u.mark for u in small.units]
    assert [x.split()[0] for x in lines if x] == marks
    read = engine.read_runs(tmp_path / engine.RUNS, small.units[:1])
    assert list(read) == marks[:1] and [r["estimator"] for r in read[marks[0]]] == ["tse", "ekf"]
    assert engine.read_runs(tmp_path / "none.jsonl", small.units) == {}


def test_there_are_columns_for_the_most_events_and_windows_of_a_case():
    for name, events, windows in (("stress", 0, 2), ("regimes", 2, 2), ("peers", 1, 1)):
        cases = make_study(name).cases
        names = set(engine.list_columns(name))
        most = max(len(c.events) for c in cases)
        assert most == events or name == "stress"
        for n in range(most + 1):
            assert f"cy_rear_settle_{n}" in names and (f"detected_{n}" in names) == (n > 0)
        assert f"cy_rear_settle_{most + 1}" not in names and f"detected_{most + 1}" not in names
        assert f"cx_front_off_w{windows - 1}" in names and f"cx_front_off_w{windows}" not in names
