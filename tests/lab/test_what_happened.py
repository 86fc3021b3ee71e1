"""What happened on a drive, told from made-up tables: changes, spells, stretches, and what is said of them."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from conftest import tselab_here
from tse.impl.core import STIFFNESS, Config
from tse.impl.regimes import REGIMES, Change, changes, percent, spells, stretches, words
from tse.impl.verdict import findings

NOMINAL = {"cx_front": 1.6e5, "cy_front": 1.2e5, "cy_rear": 1.4e5}
CALM = [(0.0, 60.0, None)]


def table_of(told, seconds: float = 60.0, step: float = 0.01, valid=lambda t: np.ones(len(t), bool)) -> pd.DataFrame:
    """A drive whose estimates tell: from, to, (time of the change, kind, probability, ratio) or None for no change yet."""
    time = np.arange(round(seconds / step)) * step
    n = len(time)
    level = np.ones(n)
    columns = {"time": time, "status": np.zeros(n, int)}
    columns |= {f"p_{p}": np.zeros(n) for p in ("changed", "axle", "fault", "sliding", "restarted")}
    columns |= {"fault_channel": np.zeros(n, int), "change_age": np.zeros(n), "change_probability": np.zeros(n)}
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
    table = table_of(CALM)[["time", "status", *(f"{s}{p}" for s in STIFFNESS for p in
                            ("", "_sd", "_spread", "_valid", "_spread_seen", "_reason"))]]  # fmt: skip
    assert changes(table) == [] and spells(table) == [] and words([], []) == []
    (stretch,) = stretches(table, [])
    assert stretch.rows == slice(0, 6000) and (stretch.start, stretch.end) == (0.0, pytest.approx(59.99))
    (finding,) = findings(table, Config(), [])
    assert finding.title == "" and finding.lines()[1].startswith("Front cornering stiffness: 120 kN/rad")
    empty = table_of(CALM).iloc[:0]
    assert changes(empty) == [] and spells(empty) == [] and stretches(empty, []) == []


def test_nothing_happened_on_a_drive_without_changes():
    assert changes(table_of(CALM)) == []


def test_a_change_has_time_kind_probability_and_what_it_did():
    (change,) = changes(table_of(ROAD))
    assert change.time == pytest.approx(36.03) and change.kind == 1 and change.probability == pytest.approx(0.97)
    assert change.label == "road changed at 36.03 s, 97 %"
    assert change.ratio["cy_rear"] == pytest.approx((0.7, 0.7 * 0.01 * np.sqrt(2)))
    assert (
        change.effect == "front longitudinal x 0.70 ± 0.01, front cornering x 0.70 ± 0.01, rear cornering x 0.70 ± 0.01"
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
    (change,) = changes(table_of([(36.1, 60, (36.03, kind, 0.9, 0.7))]))
    assert change.what == what and len(change.ratio) == touched and bool(change.effect) == bool(touched)


def test_earlier_changes_are_remembered_though_rows_tell_only_the_last():
    told = [
        (0, 10.1, None),
        (10.1, 30.2, (10, 1, 0.95, 0.5)),
        (30.2, 45, (30, 1, 0.9, 2)),
        (45, 60, (44.8, 3, 1.0, 0.9)),
    ]
    assert [(round(c.time, 2), c.kind) for c in changes(table_of(told))] == [(10, 1), (30, 1), (44.8, 3)]


def test_a_time_that_is_found_out_better_is_one_change_and_the_last_word_counts():
    told = [(10.1, 10.3, (10.0, 2, 0.91, 0.8)), (10.3, 11, (10.2, 1, 0.95, 0.75)), (11, 60, (10.1, 1, 0.99, 0.7))]
    (change,) = changes(table_of(told))
    assert change.time == pytest.approx(10.1) and change.kind == 1 and change.ratio["cx_front"][0] == pytest.approx(0.7)


def test_a_refused_row_in_between_is_no_new_change():
    told = [(10.1, 30, (10, 1, 0.9, 0.7)), (30.01, 60, (10, 1, 0.95, 0.7))]
    (change,) = changes(table_of(told))
    assert change.time == pytest.approx(10) and change.probability == pytest.approx(0.95)


def test_a_change_that_became_likely_stays_reported():
    told = [(20, 39.9, (20.0, 1, 0.99, 0.5)), (39.9, 40, (20.0, 1, 0.6, 0.5)), (40, 60, (39.7, 3, 0.97, 0.8))]
    found = changes(table_of(told))
    assert [(round(c.time, 2), c.kind) for c in found] == [(20.0, 1), (39.7, 3)]
    assert found[0].probability == pytest.approx(0.99)


def test_what_is_not_likely_is_no_change():
    assert changes(table_of([(36.1, 60, (36.03, 1, 0.85, 0.7))])) == []


@pytest.mark.parametrize(("ratio", "count"), [(1.0, 0), (0.97, 0), (1.04, 0), (0.93, 1), (1.07, 1)])
def test_a_change_that_did_nothing_is_none(ratio, count):
    assert len(changes(table_of([(36.1, 60, (36.03, 1, 0.99, ratio))]))) == count


def test_single_precision_tells_the_same():
    table = table_of([(3000.1, 3600, (3000.03, 1, 0.97, 0.7))], seconds=3600, step=0.1)
    small = table.astype({c: np.float32 for c in table.select_dtypes("float64") if c != "time"})
    (change,) = changes(small)
    assert change.time == pytest.approx(3000.03, abs=2e-3) and change.label.endswith("97 %")


def test_spells_have_their_channel_and_short_gaps_are_bridged():
    table = table_of(CALM)
    at = table["time"].to_numpy()

    def during(a, b):
        return (at >= a - 1e-9) & (at < b - 1e-9)

    table.loc[during(5, 6) | during(6.3, 7), "p_sliding"] = 0.95
    table.loc[during(19.5, 20), ["p_fault", "fault_channel"]] = [0.9, 0]  # likely, and not named yet
    table.loc[during(20, 22), ["p_fault", "fault_channel"]] = [0.9, 6]
    table.loc[during(22, 23), ["p_fault", "fault_channel"]] = [0.99, 4]
    table.loc[during(40, 41) | during(50, 52), "p_sliding"] = 0.92
    table.loc[during(55, 56), "p_sliding"] = 0.3
    found = spells(table)
    assert [(s.what, s.channel, round(s.start, 2), round(s.end, 2)) for s in found] == [
        ("sliding", "", 5, 6.99), ("fault", "yaw_rate", 19.5, 21.99), ("fault", "accel_x", 22, 22.99), ("sliding", "", 40, 40.99),
        ("sliding", "", 50, 51.99),
    ]  # fmt: skip
    assert found[1].label == "yaw_rate at fault 19.50 .. 21.99 s, 90 %"
    assert words([], found)[0] == "sliding 3 times, 5.0 s in all, first at 5.00 s"


def pieces(*times: float, seconds: float = 60.0) -> list[tuple[float, float, int, int]]:
    table = table_of(CALM, seconds)
    found = [Change(t, 1, 0.9, {}) for t in times]
    return [(round(s.start, 1), round(s.end, 1), s.rows.start, s.rows.stop) for s in stretches(table, found)]


def test_stretches_lie_between_changes_and_short_ones_join_a_neighbour():
    assert pieces(36.03) == [(0, 36, 0, 3603), (36, 60, 3603, 6000)]
    assert pieces(20, 21) == [(0, 20, 0, 2000), (20, 60, 2100, 6000)]  # values of the longer piece
    assert pieces(1) == [(0, 60, 100, 6000)]
    assert pieces(59) == [(0, 60, 0, 5900)]
    assert pieces(20, 21, 22, 23) == [(0, 20, 0, 2000), (20, 60, 2300, 6000)]
    assert pieces(0.5, seconds=1) == [(0, 1, 0, 50)]
    assert pieces(-1, 70) == [(0, 60, 0, 6000)]


def test_each_stretch_has_its_own_stiffness_and_share_of_valid():
    table = table_of(ROAD, valid=lambda t: (t < 30) | (t > 48))
    found = changes(table)
    one, two = findings(table, Config(), found)
    assert one.title == "From 0.0 .. 36.0 s"
    front = one.verdicts[1]
    assert front.value == pytest.approx(120) and front.band == pytest.approx(1.96 * 1.2)
    assert front.text.startswith("120 kN/rad ± 2 (95 %), valid 83 % of the time; as nominal; last valid at 30.0 s")
    rear = two.verdicts[2]
    assert rear.value == pytest.approx(98) and rear.valid == pytest.approx(0.5, abs=0.01)
    assert "30 % below nominal" in rear.text and "last valid" not in rear.text
    assert "changed during" not in front.text + rear.text
    assert two.lines()[0] == "From 36.0 .. 60.0 s:" and two.lines()[3].startswith(
        "  Rear cornering stiffness: 98 kN/rad"
    )


def test_a_stretch_on_which_nothing_is_valid_says_so():
    table = table_of(ROAD, valid=lambda t: t < 30)
    _, two = findings(table, Config(), changes(table))
    title, *lines = two.lines()
    assert title == "From 36.0 .. 60.0 s: no stiffness is valid, mostly not excited"
    assert lines[1].startswith("  Front cornering stiffness: 84 kN/rad ± 2 (95 %), not valid: not excited: ")


@pytest.mark.parametrize(
    ("share", "text"), [(0, "0 %"), (0.004, "under 1 %"), (0.5, "50 %"), (0.996, "over 99 %"), (1, "100 %")]
)
def test_shares_say_neither_none_nor_all_of_what_is_neither(share, text):
    assert percent(share) == text


def test_the_terminal_tells_what_happened_and_speaks_of_every_stretch(drive, tmp_path, monkeypatch):
    from tse.impl.estimate import Estimate
    from tse.impl.fleet import single

    monkeypatch.setattr(single, "estimate_to", lambda *_, **__: Estimate(table_of(ROAD), False))
    done = tselab_here("estimate", drive.log, "--vehicle", drive.vehicle, cwd=tmp_path)
    assert done.code == 0, done.err
    lines = done.out.splitlines()
    at = lines.index("From 0.0 .. 36.0 s:")
    assert lines[at - 1].startswith("road changed at 36.03 s, 97 %: front longitudinal x 0.70 ± 0.01")
    assert lines[at + 2].startswith("  Front cornering stiffness: 120 kN/rad ± 2 (95 %)")
    assert lines[at + 4] == "From 36.0 .. 60.0 s:" and "84 kN/rad ± 2 (95 %)" in lines[at + 6]
    every_5_s = [(5 * i + 0.1, 5 * i + 5.1, (5.0 * i, 1, 0.9, 0.9)) for i in range(1, 40)]
    monkeypatch.setattr(single, "estimate_to", lambda *_, **__: Estimate(table_of(every_5_s, 200), False))
    done = tselab_here("estimate", drive.log, "--vehicle", drive.vehicle, cwd=tmp_path)
    assert done.out.count("From ") == 12 and "and 28 more stretches, which --report lists" in done.out


CAR = "mass = 1900\nlf = 1.25\nlr = 1.5\nyaw_inertia = 3000\nwheel_radius_front = 0.33\nwheel_radius_rear = 0.33\n"
CALIBRATED = "[uncertainty]\nmodel_sd = 0.03\nmass_sd = 0.01\nrelaxation_sd = 0.1\nwheel_delay_sd = 0.002\nsteer_ratio_sd = 0.01\n"


@pytest.mark.parametrize(
    ("car", "level"), [(CAR, 0.5), (CAR + CALIBRATED, 0.7), (CAR, 1.0)], ids=["unknown", "calibrated", "none"]
)
def test_another_road_is_told_of_a_car_that_is_known_loosely(car, level, tmp_path):
    """A band of 25 % is of the car, and is the same before and after."""
    (tmp_path / "car.toml").write_text(car)
    road = ("--road-change", f"40:{level}") if level < 1 else ()
    done = tselab_here(
        "simulate", "--maneuver", "double-lane-change", "--duration", 60, *road, "--out", "log.csv", cwd=tmp_path
    )
    assert done.code == 0, done.err
    done = tselab_here("estimate", "log.csv", "--vehicle", "car.toml", "--out", "e.csv", cwd=tmp_path)
    times = [c.time for c in changes(pd.read_csv(tmp_path / "e.csv"))]
    assert times == [pytest.approx(40.0, abs=1.0)] if level < 1 else times == []
