"""The account of a drive from made-up tables: changes, spells, stretches, sentences."""

import json

import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import make_smoothing_spline

import tse
from conftest import tselab_here
from tse.estimation.estimate import Estimates
from tse.estimation.regimes import (
    REGIMES,
    Change,
    describe_events,
    find_changes,
    find_spells,
    find_stretches,
    format_percent,
)
from tse.estimation.smooth import compute_fixed_parts, smooth_backward, smooth_stretch
from tse.estimation.verdict import make_findings
from tse.identify.data import solve_smoothing_spline
from tse.library.core import NOMINAL as SETTING
from tse.library.core import STIFFNESS, Config
from tse.report import results
from tse.runs import single

NOMINAL = {"cx_front": 1.6e5, "cy_front": 1.2e5, "cy_rear": 1.4e5}
CALM = [(0.0, 60.0, None)]


def make_table(
    told, seconds: float = 60.0, step: float = 0.01, valid=lambda t: np.ones(len(t), bool)
) -> pd.DataFrame:
    """Return the table of a drive.

    Each entry: from, to, (time of the change, kind, probability, ratio), or None before a
    change.
    """
    time = np.arange(round(seconds / step)) * step
    n = len(time)
    level = np.ones(n)
    columns = {"time": time, "status": np.zeros(n, int)}
    columns |= {f"p_{p}": np.zeros(n) for p in ("changed", "axle", "fault", "sliding", "restarted")}
    columns |= {
        "fault_channel": np.zeros(n, int),
        "change_age": np.zeros(n),
        "change_probability": np.zeros(n),
    }
    columns |= {"change_kind": np.zeros(n, int), **{f"change_{s}": np.ones(n) for s in STIFFNESS}}
    for start, end, change in told:
        rows = (time >= start - 1e-9) & (time < end - 1e-9)
        if change is None:
            continue
        when, kind, probability, ratio = change
        columns["change_age"][rows] = time[rows] - when
        columns["change_kind"][rows], columns["change_probability"][rows] = kind, probability
        for s in STIFFNESS:
            columns[f"change_{s}"][rows] = ratio
        level[rows] = ratio
    ok = valid(time)
    for s in STIFFNESS:
        columns |= {
            s: NOMINAL[s] * level,
            f"{s}_sd": NOMINAL[s] * level * 0.01,
            f"{s}_spread": NOMINAL[s] * level * 0.05,
        }
        columns |= {f"{s}_valid": ok.astype(int), f"{s}_spread_seen": np.ones(n, int)}
        columns |= {f"{s}_reason": np.where(ok, "valid", "not excited")}
    columns |= {f"noise_{c}": np.ones(n) for c in ("accel_x", "accel_y", "yaw_rate")}
    columns["p_steady"] = 1 - sum(columns[p] for p in REGIMES if p != "p_steady")
    return pd.DataFrame(columns)


ROAD = [(0, 36.1, None), (36.1, 60, (36.03, 1, 0.97, 0.7))]


def test_a_table_without_the_columns_has_no_events_and_is_one_stretch():
    table = make_table(CALM)[["time", "status", *(f"{s}{p}" for s in STIFFNESS for p in
                            ("", "_sd", "_spread", "_valid", "_spread_seen", "_reason"))]]  # fmt: skip
    assert find_changes(table) == [] and find_spells(table) == [] and describe_events([], []) == []
    (stretch,) = find_stretches(table, [])
    assert stretch.rows == slice(0, 6000) and (stretch.start, stretch.end) == (0.0, pytest.approx(59.99))
    (finding,) = make_findings(table, Config.exact(), [])
    assert finding.title == "" and finding.lines()[1].startswith("Front cornering stiffness: 120 kN/rad")
    empty = make_table(CALM).iloc[:0]
    assert find_changes(empty) == [] and find_spells(empty) == [] and find_stretches(empty, []) == []


def test_a_change_has_time_kind_probability_and_what_it_did():
    (change,) = find_changes(make_table(ROAD))
    assert (
        change.time == pytest.approx(36.03) and change.kind == 1 and change.probability == pytest.approx(0.97)
    )
    assert change.label == "road changed at 36.03 s"
    assert change.ratio["cy_rear"] == pytest.approx((0.7, 0.7 * 0.01 * np.sqrt(2)))
    assert (
        change.effect
        == "front longitudinal x 0.70 ± 0.01, front cornering x 0.70 ± 0.01, rear cornering x 0.70 ± 0.01"
    )


@pytest.mark.parametrize(
    ("kind", "what", "touched"),
    [
        (1, "road changed", 3),
        (2, "front axle changed", 1),
        (3, "rear axle changed", 1),
        (4, "started over", 0),
        (9, "changed", 0),
    ],
)
def test_kinds_are_told_in_words_with_the_stiffness_that_they_touch(kind, what, touched):
    (change,) = find_changes(make_table([(36.1, 60, (36.03, kind, 0.9, 0.7))]))
    assert change.what == what and len(change.ratio) == touched and bool(change.effect) == bool(touched)


def test_a_time_that_is_found_out_better_is_one_change_and_the_last_word_counts():
    told = [
        (10.1, 10.3, (10.0, 2, 0.91, 0.8)),
        (10.3, 11, (10.2, 1, 0.95, 0.75)),
        (11, 60, (10.1, 1, 0.99, 0.7)),
    ]
    (change,) = find_changes(make_table(told))
    assert (
        change.time == pytest.approx(10.1)
        and change.kind == 1
        and change.ratio["cx_front"][0] == pytest.approx(0.7)
    )


@pytest.mark.parametrize(
    ("told", "expected"),
    [
        (CALM, []),
        # rows tell only the last: earlier ones are remembered
        (
            [
                (0, 10.1, None),
                (10.1, 30.2, (10, 1, 0.95, 0.5)),
                (30.2, 45, (30, 1, 0.9, 2)),
                (45, 60, (44.8, 3, 1.0, 0.9)),
            ],
            [(10, 1, 0.95), (30, 1, 0.9), (44.8, 3, 1.0)],
        ),
        # a refused row in between is no new change
        ([(10.1, 30, (10, 1, 0.9, 0.7)), (30.01, 60, (10, 1, 0.95, 0.7))], [(10, 1, 0.95)]),
        # what became likely stays reported; what is not likely is none
        (
            [
                (20, 39.9, (20.0, 1, 0.99, 0.5)),
                (39.9, 40, (20.0, 1, 0.6, 0.5)),
                (40, 60, (39.7, 3, 0.97, 0.8)),
            ],
            [(20.0, 1, 0.99), (39.7, 3, 0.97)],
        ),
        ([(36.1, 60, (36.03, 1, 0.85, 0.7))], []),
        # and so is what did nothing
        *(
            ([(36.1, 60, (36.03, 1, 0.99, ratio))], [(36.03, 1, 0.99)] * said)
            for ratio, said in ((1.0, 0), (0.97, 0), (1.04, 0), (0.93, 1), (1.07, 1))
        ),
    ],
)
def test_changes_are_told_once_each(told, expected):
    assert [(c.time, c.kind, c.probability) for c in find_changes(make_table(told))] == [
        pytest.approx(e) for e in expected
    ]


def test_single_precision_tells_the_same():
    table = make_table([(3000.1, 3600, (3000.03, 1, 0.97, 0.7))], seconds=3600, step=0.1)
    small = table.astype({c: np.float32 for c in table.select_dtypes("float64") if c != "time"})
    (change,) = find_changes(small)
    assert change.time == pytest.approx(3000.03, abs=2e-3) and change.label == "road changed at 3000.03 s"


def test_spells_have_their_channel_and_short_gaps_are_bridged():
    table = make_table(CALM)
    at = table["time"].to_numpy()

    def during(a, b):
        return (at >= a - 1e-9) & (at < b - 1e-9)

    table.loc[during(5, 6) | during(6.3, 7), "p_sliding"] = 0.95
    table.loc[during(19.5, 20), ["p_fault", "fault_channel"]] = [0.9, 0]  # likely, and not named yet
    table.loc[during(20, 22), ["p_fault", "fault_channel"]] = [0.9, 6]
    table.loc[during(22, 23), ["p_fault", "fault_channel"]] = [0.99, 4]
    table.loc[during(40, 41) | during(50, 52), "p_sliding"] = 0.92
    table.loc[during(55, 56), "p_sliding"] = 0.3
    found = find_spells(table)
    assert [(s.what, s.channel, round(s.start, 2), round(s.end, 2)) for s in found] == [
        ("sliding", "", 5, 6.99),
        ("fault", "yaw_rate", 19.5, 21.99),
        ("fault", "accel_x", 22, 22.99),
        ("sliding", "", 40, 40.99),
        ("sliding", "", 50, 51.99),
    ]
    assert found[1].label == "yaw_rate at fault 19.50 .. 21.99 s, 90 %"
    assert describe_events([], found)[0] == "sliding 3 times, 5.0 s in all, first at 5.00 s"


def pieces(*times: float, seconds: float = 60.0) -> list[tuple[float, float, int, int]]:
    table = make_table(CALM, seconds)
    found = [Change(t, 1, 0.9, {}) for t in times]
    return [
        (round(s.start, 1), round(s.end, 1), s.rows.start, s.rows.stop) for s in find_stretches(table, found)
    ]


def test_stretches_lie_between_changes_and_short_ones_join_a_neighbour():
    assert pieces(36.03) == [(0, 36, 0, 3603), (36, 60, 3603, 6000)]
    assert pieces(20, 21) == [(0, 20, 0, 2000), (20, 60, 2100, 6000)]  # values of the longer piece
    assert pieces(1) == [(0, 60, 100, 6000)]
    assert pieces(59) == [(0, 60, 0, 5900)]
    assert pieces(20, 21, 22, 23) == [(0, 20, 0, 2000), (20, 60, 2300, 6000)]
    assert pieces(0.5, seconds=1) == [(0, 1, 0, 50)]
    assert pieces(-1, 70) == [(0, 60, 0, 6000)]


def test_each_stretch_has_its_own_stiffness_and_share_of_valid():
    table = make_table(ROAD, valid=lambda t: (t < 30) | (t > 48))
    found = find_changes(table)
    one, two = make_findings(table, Config.exact(), found)
    assert one.title == "From 0.0 .. 36.0 s"
    front = one.verdicts[1]
    assert front.value == pytest.approx(120) and front.band == pytest.approx(1.96 * 1.2)
    assert front.text.startswith(
        "120 kN/rad ± 2 (95 %), valid 83 % of the time; as nominal; last valid at 30.0 s"
    )
    rear = two.verdicts[2]
    assert rear.value == pytest.approx(98) and rear.valid == pytest.approx(0.5, abs=0.01)
    assert "30 % below nominal" in rear.text and "last valid" not in rear.text
    assert "changed during" not in front.text + rear.text
    assert two.lines()[0] == "From 36.0 .. 60.0 s:" and two.lines()[3].startswith(
        "  Rear cornering stiffness: 98 kN/rad"
    )


def test_a_stretch_on_which_nothing_is_valid_says_so():
    table = make_table(ROAD, valid=lambda t: t < 30)
    _, two = make_findings(table, Config.exact(), find_changes(table))
    title, *lines = two.lines()
    assert title == "From 36.0 .. 60.0 s: no stiffness is valid, mostly not excited"
    assert lines[1].startswith("  Front cornering stiffness: 84 kN/rad ± 2 (95 %), not valid: not excited: ")


@pytest.mark.parametrize(
    ("share", "text"), [(0, "0 %"), (0.004, "under 1 %"), (0.5, "50 %"), (0.996, "over 99 %"), (1, "100 %")]
)
def test_shares_say_neither_none_nor_all_of_what_is_neither(share, text):
    assert format_percent(share) == text


def test_the_terminal_tells_what_happened_and_speaks_of_every_stretch(drive, tmp_path, monkeypatch):
    monkeypatch.setattr(single, "estimate_to", lambda *_, **__: Estimates(make_table(ROAD), False))
    done = tselab_here("estimate", "--verbose", drive.log, "--vehicle", drive.vehicle, cwd=tmp_path)
    assert done.code == 0, done.err
    lines = done.out.splitlines()
    at = lines.index("From 0.0 .. 36.0 s:")
    assert lines[at - 1].startswith("road changed at 36.03 s: front longitudinal x 0.70 ± 0.01")
    assert lines[at + 2].startswith("  Front cornering stiffness: 120 kN/rad ± 2 (95 %)")
    assert lines[at + 4] == "From 36.0 .. 60.0 s:" and "84 kN/rad ± 2 (95 %)" in lines[at + 6]
    every_5_s = [(5 * i + 0.1, 5 * i + 5.1, (5.0 * i, 1, 0.9, 0.9)) for i in range(1, 40)]
    monkeypatch.setattr(single, "estimate_to", lambda *_, **__: Estimates(make_table(every_5_s, 200), False))
    done = tselab_here("estimate", "--verbose", drive.log, "--vehicle", drive.vehicle, cwd=tmp_path)
    assert done.out.count("From ") == 12 and "and 28 more stretches, which --report lists" in done.out


def test_the_short_answer_fits_twelve_lines_of_a_hundred_columns(drive, tmp_path, monkeypatch):
    """The answer comes first, then the newest events, then the number of the others."""
    every_5_s = [(5 * i + 0.1, 5 * i + 5.1, (5.0 * i, 1, 0.9, 0.7 + 0.2 * (i % 2))) for i in range(1, 40)]
    for told, seconds in ((CALM, 60), (ROAD, 60), (every_5_s, 200)):
        table = make_table(told, seconds)
        table["noise_accel_x"] = 3.0  # a note
        monkeypatch.setattr(single, "estimate_to", lambda *_, table=table, **__: Estimates(table, False))
        done = tselab_here("estimate", drive.log, "--vehicle", drive.vehicle, cwd=tmp_path)
        lines = [*done.out.splitlines(), *done.err.splitlines()]
        assert len(lines) <= 12 and max(map(len, lines)) <= 100, lines
        assert (
            lines[0]
            .strip()
            .startswith("front, in bends" if told is CALM else "From 0" if told is ROAD else "37 earlier")
        )
    assert "more notes: --verbose" in done.out


CAR = """\
mass = 1900
lf = 1.25
lr = 1.5
yaw_inertia = 3000
wheel_radius_front = 0.33
wheel_radius_rear = 0.33
"""
CALIBRATED = """\
[uncertainty]
model_sd = 0.03
mass_sd = 0.01
relaxation_sd = 0.1
wheel_delay_sd = 0.002
steer_ratio_sd = 0.01
"""


@pytest.mark.parametrize(
    ("car", "level"), [(CAR, 0.5), (CAR + CALIBRATED, 0.7), (CAR, 1.0)], ids=["unknown", "calibrated", "none"]
)
def test_another_road_is_told_of_a_car_that_is_known_loosely(car, level, tmp_path):
    """A band of 25 % is of the car, and is the same before and after."""
    (tmp_path / "car.toml").write_text(car)
    road = ("--road-change", f"40:{level}") if level < 1 else ()
    done = tselab_here(
        "simulate",
        "--maneuver",
        "double-lane-change",
        "--duration",
        60,
        *road,
        "--out",
        "log.csv",
        cwd=tmp_path,
    )
    assert done.code == 0, done.err
    done = tselab_here(
        "estimate", "--verbose", "log.csv", "--vehicle", "car.toml", "--out", "e.csv", cwd=tmp_path
    )
    times = [c.time for c in find_changes(pd.read_csv(tmp_path / "e.csv"))]
    assert times == [pytest.approx(40.0, abs=1.0)] if level < 1 else times == []


# ---- The smoothed stiffness of a stretch: against batch least squares of a random walk,
# on made-up tables, on drives with truth.


UNKNOWN = {"mass": 1900, "lf": 1.25, "lr": 1.5, "wheel_radius_front": 0.33, "wheel_radius_rear": 0.33}


def estimate_random_walk(rng, walk, noise, prior=0.3):
    """Draw a random walk, measure it, and estimate it with a Kalman filter.

    `noise`: variance of each row, inf: no measurement. Return z, and mean and variance
    after each row.
    """
    true = np.cumsum(np.concatenate([[rng.normal(0, prior)], rng.normal(0, np.sqrt(walk))]))
    read = np.isfinite(noise)
    z = np.where(read, true + rng.normal(size=len(true)) * np.sqrt(np.where(read, noise, 0)), 0.0)
    mean, var, m, p = [], [], 0.0, prior**2
    for i, r in enumerate(noise):
        p += walk[i - 1] if i else 0.0
        gain = p / (p + r)
        m, p = m + gain * (z[i] - m), p * (1 - gain)
        mean.append(m)
        var.append(p)
    return z, np.array(mean), np.array(var)


def solve_least_squares(z, walk, noise, prior=0.3):
    """Solve prior, steps and measurements as one problem; return means and variances."""
    n = len(z)
    step = np.diff(np.eye(n), axis=0)
    weight = np.concatenate([[1 / prior**2], 1 / walk, 1 / noise])
    A = np.concatenate([np.eye(1, n), step, np.eye(n)])
    b = np.concatenate([[0.0], np.zeros(n - 1), z])
    cov = np.linalg.inv(A.T @ (weight[:, None] * A))
    return cov @ (A.T @ (weight * b)), np.diag(cov)


@pytest.mark.parametrize("seed", range(5))
def test_it_is_batch_least_squares_of_the_random_walk(seed):
    rng = np.random.default_rng(seed)
    walk, noise = np.full(79, 1e-4), rng.uniform(0.01, 1.0, 80)
    noise[rng.random(80) < 0.3] = np.inf
    opened = walk.copy()
    opened[40], noise[41] = (
        0.2,
        np.inf,
    )  # the filter has opened the state here, and nobody says so but its variance
    z, mean, var = estimate_random_walk(rng, opened, noise)
    expected, expected_var = solve_least_squares(z, opened, noise)
    found, found_var = smooth_backward(mean, var, walk)
    np.testing.assert_allclose(found, expected, atol=1e-10)
    np.testing.assert_allclose(found_var, expected_var, atol=1e-12)
    assert np.abs(mean - expected).max() > 0.01  # the filter alone is something else


def test_what_is_fixed_does_not_shrink_and_the_rest_is_least_squares():
    n, part, step = 100, 0.05, 0.1
    config = Config.exact(
        {"steady_walk": 0.05, **{setting: NOMINAL[key] for key, setting in SETTING.items()}}
    )
    walk, noise = np.full(n - 1, config.steady_walk**2 * step), np.full(n, 0.04)
    z, mean, var = estimate_random_walk(np.random.default_rng(7), walk, noise)
    table = pd.DataFrame({"time": (np.arange(n) + 0.5) * step, "status": np.zeros(n, int)})
    told = {"one": np.zeros(3), "other": np.zeros(3)}
    for a, key in enumerate(STIFFNESS):
        table[key] = NOMINAL[key] * np.exp(mean)
        table[f"{key}_sd"] = table[key] * np.sqrt(var + part**2)
        told["one"][a], told["other"][a] = (np.exp(mean[-1]) * part * x for x in (0.6, 0.8))
    expected, expected_var = solve_least_squares(z, walk, noise)
    for key, found in compute_fixed_parts(table, config, told).items():
        assert found == pytest.approx(part**2)
        value, sd = smooth_stretch(table, key, config, found)
        assert value == pytest.approx(NOMINAL[key] * np.exp(expected.mean()))
        assert (
            sd / value == pytest.approx(np.sqrt(expected_var.mean() + part**2 + expected.var()))
            and sd / value > part
        )
        more = table.loc[table.index.repeat(10)].assign(time=(np.arange(10 * n) + 0.5) * step / 10)
        assert smooth_stretch(more, key, config, found) == pytest.approx(
            (value, sd)
        )  # as often as it is read
        refused = pd.concat([table, table.assign(status=-1, time=99.0) * [1, 1, *[9] * 6]])
        assert smooth_stretch(refused, key, config, found) == pytest.approx((value, sd))


def test_each_stretch_has_its_own_and_what_comes_before_a_change_does_not_bend_it():
    """The filter moves towards the new road half a second before it detects it."""
    table = make_table(ROAD, valid=lambda t: t < 55)
    doubt = table["time"].between(35.5, 36.02)
    for key in STIFFNESS:
        table.loc[doubt, key] *= np.linspace(1, 0.75, doubt.sum())
        table.loc[doubt, f"{key}_sd"] = table.loc[doubt, key] * np.linspace(0.01, 0.15, doubt.sum())
    found = [Change(36.03, 1, 0.97, {})]
    one, two = make_findings(table, Config.exact(), found)
    assert one.verdicts[1].value < 95  # of the last row
    for f, level in ((one, 1.0), (two, 0.7)):
        for v in f.verdicts:
            assert (
                v.smoothed == pytest.approx(level * NOMINAL[v.key] / 1000, rel=0.01)
                and v.smoothed_reason == "valid"
            )
    assert one.lines()[2].endswith("; smoothed over the stretch 119 ± 8, valid")
    rows = results.make_rows("log", Estimates(table, False), [one, two], found, ())
    assert [r["change_probability"] for r in rows[3:]] == pytest.approx([0.97] * 3)
    assert rows[3]["start"] == pytest.approx(36.03)
    assert rows[1]["smoothed_low"] < 1.2e5 < rows[1]["smoothed_high"] and rows[0]["change"] is None


def make_moving_table(since: float, keys, to: float = 0.9, sd: float = 0.01) -> pd.DataFrame:
    """Return the table of a road of 0.7; the filter moves there before it detects it."""
    table = make_table(ROAD)
    before = table["time"].between(since, 36.09)
    for key in keys:
        table.loc[before, key] *= np.linspace(1, to, before.sum())
        table[f"{key}_sd"] = sd * table[key]
    return table


@pytest.mark.parametrize("keys", [STIFFNESS, ("cx_front",)], ids=["all", "one"])
def test_a_change_began_where_the_estimates_began_to_move(keys):
    table = make_moving_table(33.0, keys)
    found = find_changes(table)
    assert [c.time for c in found] == [pytest.approx(33.0, abs=0.5)] and found[0].believed == pytest.approx(
        36.03
    )
    assert all(
        ratio == pytest.approx(0.7, abs=0.02) for ratio, _ in found[0].ratio.values()
    )  # over that of before it began
    one, two = make_findings(table, Config.exact(), found)
    assert one.stretch.end == two.stretch.start == found[0].time
    assert table["time"].iloc[two.stretch.rows.start] == pytest.approx(
        36.03
    )  # until then estimates are of no road
    for v, true in zip((*one.verdicts, *two.verdicts), (160, 120, 140, 112, 84, 98), strict=True):
        assert v.value == pytest.approx(true, rel=0.02) and v.smoothed == pytest.approx(true, rel=0.02)


def test_what_is_learnt_or_creeps_before_a_change_did_not_begin_it():
    assert [c.time for c in find_changes(make_moving_table(1.0, STIFFNESS, 0.95))] == [
        pytest.approx(36.03)
    ]  # 0.5 % of the way in a second
    table = make_moving_table(33.0, STIFFNESS)
    for key in STIFFNESS:  # as far as it was uncertain
        table[f"{key}_sd"] = table[key] * np.interp(table["time"], [33, 36.09], [0.08, 0.01])
    assert [c.time for c in find_changes(table)] == [pytest.approx(36.03)]


def test_a_change_does_not_begin_before_the_one_before_it_is_believed():
    told = [(30.1, 33, (30.03, 1, 0.97, 0.8)), (33, 60, (33.0, 1, 0.97, 0.4))]
    table = make_table(told)
    moving = table["time"].between(28, 32.99)
    for key in STIFFNESS:
        table.loc[moving, key] = NOMINAL[key] * np.linspace(1, 0.6, moving.sum())
    first, second = find_changes(table)
    assert first.time < first.believed <= second.time < second.believed == pytest.approx(33.0)


@pytest.mark.parametrize(
    ("sd", "rows", "reason"),
    [
        (0.01, "valid", "valid"),
        (0.2, "valid", "uncertain"),
        (0.2, "parameters uncertain", "parameters uncertain"),
        (0.2, "held", "held"),
        (0.01, "not excited", "not excited"),
    ],
)
def test_it_is_valid_if_rows_are_and_its_own_interval_allows_it(sd, rows, reason):
    table = make_table([(0.0, 60.0, None)], valid=lambda t: np.full(len(t), rows == "valid"))
    for key in STIFFNESS:
        table[f"{key}_sd"], table[f"{key}_reason"] = sd * table[key], rows
    (found,) = make_findings(table, Config.exact(), [])
    assert [v.smoothed_reason for v in found.verdicts] == [reason] * 3
    assert all(v.smoothed_band == pytest.approx(1.96 * sd * v.smoothed, rel=0.1) for v in found.verdicts)


def test_channels_that_contradict_each_other_leave_the_reason_and_refused_rows_nothing():
    table = make_table(ROAD)
    (found,) = make_findings(table, Config.exact(), find_changes(table), ["a sign"])
    assert all(v.smoothed_reason == "contradicted" and np.isnan(v.smoothed) for v in found.verdicts)
    (found,) = make_findings(table.assign(status=-1), Config.exact(), [])
    assert all(v.smoothed_reason == "" and np.isnan(v.smoothed) for v in found.verdicts)
    (found,) = make_findings(make_table([(0.0, 60.0, None)]), Config.exact(Config.settings_of("paper")), [])
    assert all(
        v.smoothed_reason == "" and "smoothed" not in v.text for v in found.verdicts
    )  # particles forget


@pytest.mark.slow
@pytest.mark.parametrize(
    ("known", "before", "after"), [(False, 1.0, 0.7), (True, 0.9, 0.6)], ids=["uncalibrated", "exact"]
)
def test_the_interval_holds_on_simulated_drives_with_a_change_of_the_road(known, before, after, drive):
    car = drive.vehicle if known else UNKNOWN
    inside, errors = [], []
    for seed in (1, 2, 3):
        road = [(0, before), (30, after)]
        made = tse.simulate(
            "double-lane-change", None if known else car, seed=seed, duration=60, road_changes=road
        )
        result = tse.estimate(made.log, car)
        table = result.stretches
        assert table["start"].tolist() == pytest.approx([0, 0, 0, 30, 30, 30], abs=3)
        told = (
            np.sqrt(sum(sd**2 for sd in result.uncertainty_sd.values())) / result.stiffness[-1]
        )  # over the nominal of each
        for n, row in enumerate(table.itertuples()):
            true = row.nominal * (before if n < 3 else after)
            inside.append(row.smoothed_low < true < row.smoothed_high)
            errors.append([abs(row.smoothed / true - 1), abs(row.value / true - 1)])
            assert row.smoothed_sd / row.smoothed >= told[n % 3] * row.nominal * 0.999
    smoothed, last = np.array(errors).mean(axis=0)
    assert np.mean(inside) >= 0.9 and smoothed < 1.1 * last, (
        inside,
        smoothed,
        last,
    )  # both 1 % of a car known exactly


def test_a_log_with_no_valid_row_has_an_answer_with_its_reason(tmp_path):
    (tmp_path / "car.toml").write_text(
        "mass = 1500\nlf = 1.2\nlr = 1.5\nwheel_radius_front = 0.3\nwheel_radius_rear = 0.3\n"
    )
    made = ("simulate", "--maneuver", "straight", "--duration", 20, "--out", "log.csv")
    assert tselab_here(*made, "--vehicle", "car.toml", cwd=tmp_path).code == 0
    run = ("estimate", "--verbose", "log.csv", "--vehicle", "car.toml", "--out", "e.csv")
    done = tselab_here(*run, "--report", "r.html", "--table", "t.csv", cwd=tmp_path)
    assert done.code == 4, done.err
    lines = [x for x in done.out.splitlines() if "stiffness:" in x]
    assert len(lines) == 3 and all(
        "; smoothed over the log " in x and ", not valid: " in x.split("smoothed")[1] for x in lines
    )
    said = json.loads(tselab_here(*run, "--json", cwd=tmp_path).out)["stretches"][0]["stiffness"]
    table = pd.read_csv(tmp_path / "t.csv").set_index("stiffness")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    estimates = pd.read_csv(tmp_path / "e.csv")
    for key, v in said.items():
        assert not estimates[f"{key}_valid"].any() and v["valid"] == 0
        assert v["smoothed_low"] < v["smoothed"] < v["smoothed_high"] and v["smoothed_reason"] == "uncertain"
        assert (
            table.loc[key, "smoothed"] == v["smoothed"] and table.loc[key, "smoothed_reason"] == "uncertain"
        )
    assert "Smoothed over the log" in page and page.count(", not valid: uncertain") >= 3


# ---- splines


@pytest.fixture(scope="module")
def signal():
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.uniform(0.005, 0.02, 800))
    return time, np.sin(time) + 0.1 * rng.standard_normal(800)


@pytest.mark.parametrize("penalty", [0.0, 1e-8, 1e-5, 1e-3, 1.0])
def test_it_is_that_of_scipy(signal, penalty):
    time, y = signal
    between = np.linspace(time[0], time[-1], 3001)
    # scipy solves a system whose condition grows with the penalty: 1e-8 at a penalty of 1
    # s3
    assert solve_smoothing_spline(time, y, penalty)(between) == pytest.approx(
        make_smoothing_spline(time, y, lam=penalty)(between), abs=1e-8
    )


def test_a_great_penalty_leaves_the_regression_line(signal):
    time, y = signal
    assert solve_smoothing_spline(time, y, 1e9)(time) == pytest.approx(
        np.polyval(np.polyfit(time, y, 1), time), abs=1e-5
    )


def test_three_values_are_enough():
    assert solve_smoothing_spline(np.array([0.0, 1.0, 3.0]), np.array([1.0, 2.0, 4.0]), 0.1)(
        2.0
    ) == pytest.approx(3.0)
