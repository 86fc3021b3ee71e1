"""Functions of verdict, answer and events, each alone, on tables of a few rows."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from tse.calibration.own import NOT_ASKED
from tse.car.vehicle import make_vehicle
from tse.channels.log import read_frame
from tse.estimation import verdict as module
from tse.estimation.answer import compute_held_stiffness, describe_rest, explain_reason, make_answer
from tse.estimation.estimate import Estimates
from tse.estimation.regimes import (
    Change,
    Spell,
    Stretch,
    describe_events,
    estimate_times,
    find_changes,
    find_channel_name,
    find_spans,
    find_spells,
    find_stretches,
    format_percent,
)
from tse.estimation.regimes import _fill_names as fill_names
from tse.estimation.regimes import _find_begin as find_begin
from tse.estimation.smooth import compute_fixed_parts, smooth_backward, smooth_stretch
from tse.estimation.verdict import (
    Finding,
    Quantity,
    Verdict,
    check_steering_lag,
    describe_implausible,
    list_contradictions,
    list_other_quantities,
    list_remarks,
    list_uncertain_parameters,
    make_findings,
    make_verdicts,
)
from tse.library.core import NOMINAL, STIFFNESS, Config, library
from tse.library.errors import UserError
from tse.roads.road import make_road
from tse.runs import single

NAN = float("nan")


def make_table(valid, reason="uncertain", step: float = 0.1, **columns) -> pd.DataFrame:
    """Return a table of estimates with these valid rows; stiffness is 100 +- 2 kN."""
    ok = np.asarray(valid, bool)
    n = len(ok)
    table = {"time": step * np.arange(n), "status": np.zeros(n, int)}
    for key in STIFFNESS:
        table |= {key: np.full(n, 1e5), f"{key}_sd": np.full(n, 2e3), f"{key}_spread": np.full(n, 5e3)}
        table |= {f"{key}_valid": ok.astype(int), f"{key}_spread_seen": np.zeros(n, int)}
        table |= {f"{key}_reason": np.where(ok, "valid", reason)}
    table |= {f"noise_{c}": np.ones(n) for c in ("accel_x", "accel_y", "yaw_rate")}
    return pd.DataFrame(table).assign(**columns)


def judge(table: pd.DataFrame, key: str = "cy_front", **settings) -> Verdict:
    nominal = {NOMINAL[k]: 1e5 for k in STIFFNESS}
    config = Config.exact(nominal | settings)
    return next(v for v in make_verdicts(table, config) if v.key == key)


# ---- the verdict on a stiffness


@pytest.mark.parametrize(
    ("rows", "valid", "level"),
    [
        (1000, 4, "none"),  # below 0.5 %
        (1000, 5, "partly"),
        (1000, 299, "partly"),
        (1000, 300, "good"),
        (1000, 1000, "good"),
    ],
)
def test_the_share_of_valid_rows_is_the_level(rows, valid, level):
    found = judge(make_table(np.arange(rows) < valid))
    assert (found.level, found.valid) == (level, valid / rows)


def test_the_value_is_of_the_last_valid_row_with_its_own_sd():
    rows = np.arange(10)
    table = make_table(rows < 6, cy_front=1e5 + 100.0 * rows, cy_front_sd=2000.0 + 10 * rows)
    found = judge(table)
    assert (found.value, found.band) == (pytest.approx(100.5), pytest.approx(1.96 * 2.05))
    assert (found.low, found.high) == (found.value - found.band, found.value + found.band)
    assert (found.nominal, found.unit, found.name) == (100.0, "kN/rad", "Front cornering stiffness")
    none = judge(table.assign(cy_front_valid=0, status=np.where(rows > 7, -1, 0)))
    assert none.value == pytest.approx(100.7) and none.level == "none"  # the last row that was not refused
    assert judge(table, "cx_front").unit == "kN"


@pytest.mark.parametrize(
    ("level", "said"),
    [(1.019, "as nominal"), (0.981, "as nominal"), (1.021, "2 % above nominal"), (0.97, "3 % below nominal")],
)
def test_the_distance_to_nominal_counts_from_2_percent(level, said):
    assert said in judge(make_table([1] * 10, cy_front=1e5 * level)).text


def test_a_stiffness_that_has_changed_says_from_what_to_what():
    rows = np.arange(10)
    assert (
        "it changed during the log, from 100 to 87"
        in judge(make_table([1] * 10, cy_front=np.where(rows < 5, 1e5, 87e3))).text
    )
    little = make_table([1] * 10, cy_front=np.where(rows < 5, 1e5, 89e3))  # 3 x 1.96 x 2 = 11.8
    assert "changed" not in judge(little).text
    wide = make_table(
        [1] * 10, cy_front=np.where(rows < 5, 1e5, 87e3), cy_front_sd=np.where(rows < 5, 5e3, 100)
    )
    assert "changed" not in judge(wide).text  # of the sd at its beginning
    part = make_verdicts(make_table([1] * 10, cy_front=np.where(rows < 5, 1e5, 87e3)), Config.exact(), False)
    assert "it changed during the stretch, from 100 to 87" in part[1].text
    never = make_table([0] * 10, cy_front=np.where(rows < 5, 1e5, 5e4))
    assert "changed" not in judge(never).text


@pytest.mark.parametrize(
    ("last", "said"), [(79, "last valid at 7.9 s"), (88, "last valid at 8.8 s"), (89, ""), (99, "")]
)
def test_a_stiffness_that_is_no_longer_valid_says_since_when(last, said):
    text = judge(make_table(np.arange(100) <= last)).text
    assert said in text and ("last valid" in text) == bool(said)


def test_the_time_of_the_last_valid_row_is_that_of_its_estimate():
    text = judge(make_table(np.arange(100) <= 50, estimate_age=0.3)).text
    assert "last valid at 4.7 s" in text


def test_the_commonest_reason_is_named_with_its_share():
    reasons = np.array(["valid"] * 5 + ["held"] * 2 + ["starting"] * 3)
    table = make_table(
        reasons == "valid", cy_front_reason=pd.Categorical(reasons, ["held", "starting", "valid", "x"])
    )
    found = judge(table)
    assert (found.reason, found.reason_share) == ("starting", 0.3)
    assert "otherwise mostly starting: too little excitation since the start" in found.text
    mostly = judge(
        make_table(np.arange(10) < 8, cy_front_reason=np.where(np.arange(10) < 8, "valid", "held"))
    )
    assert "otherwise" not in mostly.text and mostly.reason == "held"
    never = pd.Categorical(["valid"] * 10, ["held", "valid"])
    assert judge(make_table([1] * 10, cy_front_reason=never)).reason == ""
    assert judge(make_table([1] * 10)).reason == "" and judge(make_table([1] * 10)).reason_share == 0.0


@pytest.mark.parametrize(
    ("key", "reason", "why"),
    [
        ("cy_front", "uncertain", "too little steering excitation"),
        ("cy_rear", "not excited", "too little steering excitation"),
        ("cx_front", "not excited", "driving and braking were too weak or too steady"),
        ("cx_front", "held", "standstill, low speed, reverse, large steering angle or sliding wheels"),
    ],
)
def test_a_reason_is_explained_for_its_stiffness(key, reason, why):
    assert judge(make_table([0] * 10, reason), key).text.split(": ")[-1].startswith(why)


def test_the_sd_beside_its_limit_is_a_share_of_the_value():
    text = judge(make_table([0] * 10, "uncertain", cy_front_sd=15e3), valid_sd=0.08).text
    assert "not valid: uncertain, its sd 15 %, limit 8 %: too little" in text
    text = judge(make_table([0] * 10, "parameters uncertain", cy_front_sd=15e3), valid_sd=0.08).text
    assert "not valid: parameters uncertain, its sd 15 %, limit 8 %: the car's parameters" in text
    assert "limit" not in judge(make_table([0] * 10, "held")).text


def test_a_table_without_rows_has_a_reason():
    found = judge(make_table([]))
    assert (found.level, found.text, found.valid) == ("none", "no value: no rows", 0.0)
    assert np.isnan(found.value) and np.isnan(found.band)


def test_a_spread_counts_where_it_was_seen_in_half_of_the_valid_rows():
    seen = np.arange(10) < 5
    rows = {"cy_front_spread": np.where(seen, 8e3, 4e3), "cy_front": 8e4}
    found = judge(make_table([1] * 10, cy_front_spread_seen=seen.astype(int), **rows))
    assert found.spread == pytest.approx(6 / 80) and "spread 8 % from sample to sample" in found.text
    few = judge(make_table([1] * 10, cy_front_spread_seen=(np.arange(10) < 4).astype(int), **rows))
    assert np.isnan(few.spread)
    rows["cy_front_spread"] = np.where(seen, 8e3, 1e3)  # of the valid rows
    half = judge(make_table(seen, cy_front_spread_seen=(np.arange(10) < 3).astype(int), **rows))
    assert half.spread == pytest.approx(8 / 80)


def test_a_whole_log_that_ends_at_fault_is_good_in_part_and_a_stretch_is_not():
    for reason, whole in (("sensor fault", "partly"), ("implausible", "partly"), ("held", "good")):
        reasons = np.where(np.arange(10) < 6, "valid", reason)
        table = make_table(reasons == "valid", cy_front_reason=reasons)
        levels = [make_verdicts(table, Config.exact(), x)[1].level for x in (True, False)]
        assert levels == [whole, "good"]


def test_the_detail_of_a_verdict_is_what_follows_its_value():
    assert judge(make_table([1] * 10)).detail == "valid 100 % of the time; as nominal"


def test_a_particle_filter_has_the_median_of_a_log_and_else_the_last_value():
    rows = [1e5, 1.01e5, 1.02e5, 1.1e5, 1.06e5]
    table = make_table([1] * 5, cy_front=rows, cy_front_sd=[5e3, 1e3, 2e3, 9e3, 7e3])
    for form, whole, first, valid, value, sd in (
        (1, True, 5e3, 1, 102, 5),
        (0, True, 5e3, 1, 106, 7),
        (1, False, 5e3, 1, 106, 7),
        (1, True, 1e3, 1, 106, 7),  # it has changed by more than 3 x 1.96 kN
        (1, True, 5e3, 0, 106, 7),
    ):
        given = table.assign(cy_front_valid=valid)
        given.loc[0, "cy_front_sd"] = first
        found = make_verdicts(given, Config.exact({"form": form}), whole)[1]
        assert (found.value, found.band) == (pytest.approx(value), pytest.approx(1.96 * sd))
        assert ("it changed during" in found.text) == (first == 1e3)
    early = make_table(np.arange(30) < 5)
    for form in (0, 1):
        text = make_verdicts(early, Config.exact({"form": form}))[1].text
        assert ("last valid at" in text) == (form == 0)


# ---- the smoothed value


@pytest.mark.parametrize(
    ("valid", "sd", "reasons", "expected"),
    [
        (1, 9e3, None, "valid"),
        (1, 15e3, None, "uncertain"),
        (
            1,
            15e3,
            ["uncertain", "parameters uncertain", "parameters uncertain", "held"],
            "parameters uncertain",
        ),
        (0, 15e3, ["held"] * 4, "held"),
        (0, 5e3, ["held"] * 4, "held"),
    ],
)
def test_a_smoothed_value_is_valid_within_its_limit(valid, sd, reasons, expected):
    table = make_table([valid] * 4, cy_front_sd=sd)
    if reasons:
        table["cy_front_reason"] = reasons
    parts = dict.fromkeys(STIFFNESS, 0.0)
    config = Config.exact({"valid_sd": 0.1, NOMINAL["cy_front"]: 1e5})
    found = make_verdicts(table, config, True, parts)[1]
    assert found.smoothed_reason == expected and found.smoothed == pytest.approx(100.0)
    assert found.smoothed_band == pytest.approx(1.96 * sd / 1000, rel=0.05)
    act = "valid" if expected == "valid" else f"not valid: {expected}"
    assert found.text.endswith(f"; smoothed over the log 100 ± {found.smoothed_band:.0f}, {act}")
    assert "over the stretch 100" in make_verdicts(table, config, False, parts)[1].text


def test_a_smoother_ends_with_the_filter_and_takes_less_from_what_walks_more():
    """Three rows by hand: m1 + P1/(P1 + Q) (m2 - m1)."""
    mean, var = smooth_backward(np.array([1.0, 2.0]), np.array([4.0, 2.0]), np.array([4.0]))
    np.testing.assert_allclose(mean, [1.5, 2.0])
    np.testing.assert_allclose(var, [4 + 0.25 * (2 - 8), 2.0])
    mean, _ = smooth_backward(np.array([1.0, 2.0]), np.array([1.0, 4.0]), np.array([0.5]))
    assert mean[0] == pytest.approx(1.25)  # the variance rose by 3
    np.testing.assert_array_equal(smooth_backward(np.zeros(2), np.zeros(2), np.zeros(1))[0], [0, 0])


def test_the_fixed_part_is_that_of_the_last_row_that_was_used():
    config = Config.exact({NOMINAL[k]: x for k, x in zip(STIFFNESS, (2e5, 1e5, 5e4), strict=True)})
    table = make_table([1] * 3, status=[0, 0, -1], cy_front=[1e5, 8e4, 1e9])
    sds = {"mass_sd": np.array([0.03, 0.03, 0.1]), "cg_sd": np.array([0.04, 0.04, 0.2])}
    found = compute_fixed_parts(table, config, sds)
    assert list(found) == list(STIFFNESS)
    assert found["cx_front"] == pytest.approx(0.05**2 / 0.5**2)
    assert found["cy_front"] == pytest.approx(0.05**2 / 0.8**2)
    assert found["cy_rear"] == pytest.approx((0.1**2 + 0.2**2) / 2.0**2)
    assert compute_fixed_parts(table.assign(status=-1), config, sds) == {}
    assert compute_fixed_parts(table, Config.exact({"form": 1}), sds) == {}


def test_a_smoothed_stretch_is_the_mean_of_its_logarithms_and_refused_rows_do_not_count():
    config = Config.exact({"steady_walk": 0.01})
    table = make_table([1] * 4, cy_front=[1e5, 1.21e5, 7.0, 1e5], cy_front_sd=[1e4, 1.21e4, 1.0, 1e4])
    table = table.assign(status=[0, 0, -1, 0], time=[0.0, 1e9, 2e9, 3e9])  # each row is for itself
    value, sd = smooth_stretch(table, "cy_front", config, 0.0)
    assert value == pytest.approx(1e5 * 1.21 ** (1 / 3), rel=1e-6)
    logs = np.log([1, 1.21, 1])
    assert sd == pytest.approx(value * np.sqrt(0.01 + logs.var()), rel=1e-3)
    assert np.isnan(smooth_stretch(table.assign(status=-1), "cy_front", config, 0.0)).all()


def test_a_smoothed_stretch_walks_by_its_sd_in_a_second_and_keeps_its_common_part():
    """Two rows by hand, 0.5 s apart, each the last one of its tenth of a second."""
    config, walk = Config.exact({"steady_walk": 0.01}), 0.01**2 * 0.5
    table = make_table([1] * 4, cy_front=[7e4, 1e5, 9e4, 1.02e5], cy_front_sd=[1e4, 2e3, 1e4, 2.04e3])
    table = table.assign(time=[0.01, 0.05, 0.53, 0.55])
    for part, free in ((0.0, 4e-4), (1e-4, 3e-4), (1.0, 4e-6)):  # of 4e-4; at least a hundredth
        gain = free / (free + walk)
        value, sd = smooth_stretch(table, "cy_front", config, part)
        assert value == pytest.approx(1e5 * 1.02 ** ((1 + gain) / 2))
        between = (1 - gain) * np.log(1.02) / 2  # of both means from their mean
        assert sd == pytest.approx(value * np.sqrt((4e-4 - gain**2 * walk + 4e-4) / 2 + between**2))


# ---- findings


def test_a_finding_without_a_valid_stiffness_names_each_reason_once():
    verdicts = make_verdicts(make_table([0] * 5, "held").assign(cx_front_reason="starting"), Config.exact())
    finding = Finding(Stretch(1.0, 2.0, slice(0, 5)), verdicts)
    assert finding.nothing == "no stiffness is valid, mostly starting or held"
    assert finding.lines()[0] == "From 1.0 .. 2.0 s: no stiffness is valid, mostly starting or held"
    one = make_verdicts(make_table([0] * 5).assign(cy_rear_valid=1), Config.exact())
    assert Finding(None, one).nothing == "" and Finding(None, one).title == ""
    other = Quantity("grip", "Grip", "1", 0.9, 0.1, 1.0, "", 0.0, "x")
    assert Finding(None, one, [other]).lines()[-1] == "Grip: 0.90 ± 0.10 (95 %), x"
    assert Finding(Stretch(0, 1, slice(0, 1)), one, [other]).lines()[-1] == "  Grip: 0.90 ± 0.10 (95 %), x"


def test_a_quantity_has_its_unit_and_an_interval_of_at_least_a_hundredth():
    assert (
        Quantity("s", "Slip", "deg", 1.234, 0.001, NAN, "", 0.0, "x").line()
        == "Slip: 1.23 ± 0.01 deg (95 %), x"
    )


def test_contradictions_take_every_value_and_the_stretches():
    table = make_table([1] * 100, change_kind=1, change_age=0.1 * np.arange(100) - 5)
    (found,) = make_findings(table, Config.exact(), [Change(5.0, 1, 1.0, {})], ["a sign"])
    assert found.stretch is None and not found.others
    for v in found.verdicts:
        assert (v.level, v.reason, v.reason_share, v.valid) == ("none", "contradicted", 1.0, 1.0)
        assert v.smoothed_reason == "contradicted"
        assert np.isnan([v.value, v.band, v.spread]).all()
        assert v.text.startswith("contradicted: channels or vehicle file are wrong")


def test_each_stretch_is_judged_by_its_own_rows_and_the_common_part_of_the_log():
    late = np.arange(80) >= 40
    wide = np.arange(80) % 40 < 20
    table = make_table([1] * 80, cy_front=np.where(late, 8e4, 1e5), sideslip=np.where(late, 0.03, 0.01))
    table = table.assign(cy_front_sd=0.2 * table["cy_front"] * np.where(wide, 0.5, 0.1), sideslip_sd=1e-4)
    table = table.assign(grip=1.0, grip_sd=0.1, grip_valid=0, grip_reason="held")
    table.loc[78:, ["cy_front_valid", "cy_front_reason"]] = [0, "sensor fault"]
    config = Config.exact({"steady_walk": 1e-5, **{NOMINAL[k]: 1e5 for k in STIFFNESS}})
    parts = {"mass_sd": np.array([0.0, 0.09, 0.0])}
    found = make_findings(table, config, [Change(4.0, 2, 0.9, {})], (), parts)
    assert [f.title for f in found] == ["From 0.0 .. 4.0 s", "From 4.0 .. 7.9 s"]
    for f, value, angle in zip(found, (100, 80), (0.01, 0.03), strict=True):
        v = f.verdicts[1]
        assert (v.value, v.level) == (pytest.approx(value), "good")  # also if it ends at fault
        # its common part is more than the variance of any row, so that no row reduces it
        assert v.smoothed_band == pytest.approx(1.96 * value * np.sqrt((0.1**2 + 0.02**2) / 2), rel=0.03)
        assert "smoothed over the stretch" in v.text
        assert [q.value for q in f.others] == [pytest.approx(np.rad2deg(angle))]
    (whole,) = make_findings(table[:40], config, [], (), {"mass_sd": np.array([0.0, 0.12, 0.0])})
    assert whole.verdicts[1].smoothed_band == pytest.approx(14.1, rel=0.03) and len(whole.others) == 1
    assert "smoothed over the log" in whole.verdicts[1].text
    (free,) = make_findings(table[:40], config, [])
    assert free.verdicts[1].smoothed_band == pytest.approx(1.96 * 2, rel=0.03)  # that of the last row


# ---- grip and sideslip


def test_grip_is_that_of_its_last_valid_row():
    rows = np.arange(10)
    table = make_table(
        [1] * 10, grip=0.5 + 0.01 * rows, grip_sd=0.02 + 0.001 * rows, sideslip=0.0, sideslip_sd=0.1
    )
    table = table.assign(grip_valid=(rows < 4).astype(int), grip_reason=np.where(rows < 4, "valid", "held"))
    config = Config.exact({"grip_sd": 0.2})
    grip = list_other_quantities(table.assign(estimate_age=0.1), config)[0]
    assert (grip.value, grip.band) == (pytest.approx(0.53), pytest.approx(1.96 * 0.023))
    assert (grip.valid, grip.reason, grip.time) == (0.4, "held", pytest.approx(0.2))
    assert grip.text == "valid 40 % of the time"
    none = table.assign(grip_valid=0, grip_reason="held", status=np.where(rows > 7, -1, 0))
    grip = list_other_quantities(none, config)[0]
    assert grip.value == pytest.approx(0.57) and grip.text.startswith("not valid: held, standstill")
    assert [q.key for q in list_other_quantities(none.assign(status=-1), config)] == []
    assert list_other_quantities(table, Config.exact({"grip_sd": 0.2, "form": 1})) == []


def test_the_largest_sideslip_is_that_whose_interval_is_farthest_from_0():
    angle, sd = np.array([0.4, 0.05, 0.08, -0.06, 0.5]), np.array([0.01, 0.001, 0.03, 0.002, 0.01])
    refused, motion = -1, library().status("TSE_W_MISSING_CHANNEL")
    table = make_table([1] * 5, sideslip=angle, sideslip_sd=sd, grip_sd=0.1, estimate_age=0.08)
    table = table.assign(grip=1.0, grip_valid=0, grip_reason="held")
    table["status"] = [refused, 0, 0, motion, motion + 1]
    (slip,) = list_other_quantities(table, Config.exact())
    assert (slip.value, slip.band) == (
        pytest.approx(-np.rad2deg(0.06)),
        pytest.approx(1.96 * np.rad2deg(0.002)),
    )
    assert (slip.unit, slip.time) == ("deg", pytest.approx(0.22))
    assert slip.text.startswith("the largest, at 0.2 s; ")
    assert slip.text.endswith(f"median interval ± {1.96 * np.rad2deg(0.002):.2f}")
    assert np.isnan(slip.valid) and list_other_quantities(table.assign(status=9), Config.exact()) == []


# ---- remarks


def test_noise_counts_in_rows_that_learn_and_by_its_median():
    rows = np.arange(9)
    table = make_table(
        [1] * 9, noise_yaw_rate=np.where(rows < 5, 1.3, 0.1), noise_accel_y=np.where(rows < 4, 9.0, 1)
    )
    assert list_remarks(table) == ["yaw_rate: the estimated noise sd is 1.3 times its setting"]
    held = library().status("TSE_W_MISSING_CHANNEL") + 1
    assert list_remarks(table.assign(status=held)) == [] and list_remarks(table.assign(status=-1)) == []
    assert list_remarks(make_table([1] * 9, noise_accel_x=1.25)) == []


@pytest.mark.parametrize(
    ("seconds", "changes", "said"), [(170.0, 3, True), (190.0, 3, False), (100.0, 2, False)]
)
def test_changes_more_often_than_once_a_minute_are_not_believed(seconds, changes, said):
    time = np.arange(0.0, seconds + 0.05, 0.1)
    begun = np.minimum((time / 20).astype(int), changes)
    table = make_table(np.ones(len(time)), change_kind=np.minimum(begun, 1), change_age=time - 20.0 * begun,
                       change_probability=1.0, **{f"change_{k}": 0.8 for k in STIFFNESS})  # fmt: skip
    for key in STIFFNESS:
        table[key] = 1e5 * 0.8 ** (begun % 2)
    assert len(find_changes(table)) == changes
    found = [x for x in list_remarks(table) if "implausibly many" in x]
    assert [x.split(". ")[0] for x in found] == (
        [f"{changes} changes of road or tyres in {seconds:.0f} s are implausibly many"] if said else []
    )


def test_faults_are_counted_by_their_reason_or_at_standstill_by_their_probability():
    rows = np.arange(100)
    reasons = np.where((rows >= 10) & (rows < 20), "sensor fault", "held")
    table = make_table([0] * 100, "held").assign(cx_front_reason=reasons)
    assert list_remarks(table) == ["a sensor was probably at fault once, in 10 % of the log: not valid there"]
    table["p_fault"] = np.where(rows >= 95, 0.9, 0.89)
    assert list_remarks(table) == [
        "a sensor was probably at fault 2 times, in 15 % of the log: not valid there"
    ]
    assert list_remarks(make_table([0] * 100, "held")) == []
    reasons[23:33] = "sensor fault"  # 0.4 s later, but 0.7 s between their estimates
    table = make_table([0] * 100, "held").assign(cx_front_reason=reasons)
    assert " once, in 20 % " in list_remarks(table)[0]
    assert " 2 times, in 20 % " in list_remarks(table.assign(estimate_age=np.where(rows < 21, 0.3, 0.0)))[0]


def test_a_lag_is_that_of_the_last_row():
    config = Config.exact({"steer_lag_sd": 0.01, "steering_delay_time": 0.02, "imu_delay_time": 0.01})
    table = make_table([1] * 3, lag_steer=[0.5, 0.5, 0.06])
    assert check_steering_lag(table, config) == []  # 3 sd
    (text,) = check_steering_lag(table.assign(lag_steer=[0.03, 0.03, 0.061]), config)
    assert text.startswith("steer_angle is logged 31 ms earlier than") and "(sd 10 ms)" in text
    (text,) = check_steering_lag(table.assign(lag_steer=[0.03, 0.03, -0.011]), config)
    assert text.startswith("steer_angle is logged 41 ms later than")
    assert check_steering_lag(table[:0], config) == []


def test_the_parameters_that_widen_an_interval_most_are_named_in_order():
    config = Config.exact({NOMINAL[k]: 2e5 for k in STIFFNESS})
    table = make_table([1] * 2, cy_front_sd=[1.0, 2e4], cy_rear_sd=[1.0, 1e3])  # 10 % and 0.5 % of nominal
    parts = {n: np.array([0.0, x, 0.004]) for n, x in zip("abcd", (0.03, 0.06, 0.01, 0.05), strict=True)}
    (text,) = list_uncertain_parameters(table, config, parts)  # front: 84 % of the sd
    assert text.startswith(
        "front cornering stiffness: most of its 95 % interval at the end, ± 39 %, is parameter uncertainty: "
        "b 24 %, d 20 %, a 12 % (enter"
    )
    half = {"a": np.array([0.0, 0.0707, 0.0])}
    assert list_uncertain_parameters(table, config, half) == []  # just below half of the variance
    assert len(list_uncertain_parameters(table, config, {"a": np.array([0.0, 0.0708, 0.0])})) == 1
    narrow = table.assign(cy_front_sd=1e3)
    assert list_uncertain_parameters(narrow, config, {"a": np.array([0.0, 0.0099, 0.0])}) == []  # below 2 %
    assert len(list_uncertain_parameters(narrow, config, {"a": np.array([0.0, 0.0101, 0.0])})) == 1


# ---- contradictions


def find_number(channel: str) -> int:
    return next(i for i in range(1, 30) if find_channel_name(i) == channel)


@pytest.mark.parametrize(
    ("channel", "factor", "said"),
    [
        (
            "wheel_speed_rear",
            0.0,
            "front and rear wheel speeds seem to be exchanged, or driven_axle names the wrong",
        ),
        ("yaw_rate", 0.0, "yaw_rate does not agree with the other channels"),
        ("accel_y", -0.98, "accel_y seems to have the other sign (factor -0.98, about 1 is expected)"),
        ("wheel_speed_front", 3.6, "the wheel speeds seem to be 3.6 times the true value"),
        (
            "accel_x",
            9.81,
            "accel_x seems to be 9.81 times the true value, or the time steps 9.81 times the true steps",
        ),
        ("yaw_rate", 57.3, "yaw_rate seems to be 57.3 times the true value"),
    ],
)
def test_a_contradiction_is_named_by_channel_and_factor(channel, factor, said):
    row = pd.Series({"fault_channel": find_number(channel), "fault_factor": factor})
    assert module._name_contradiction(row).startswith(said)
    assert ("time steps" in module._name_contradiction(row)) == (channel == "accel_x")


def make_contradiction(reasons, channel="yaw_rate", factor=2.0, step=0.1) -> pd.DataFrame:
    """Return a table in which one stiffness alone has these reasons."""
    table = make_table([0] * len(reasons), "uncertain", step).assign(cx_front_reason=reasons)
    return table.assign(fault_channel=find_number(channel), fault_factor=factor)


@pytest.mark.parametrize(
    ("reasons", "said"),
    [
        (["valid"] * 5 + ["implausible"] * 5, ""),  # half is not more than half
        (["valid"] * 4 + ["implausible"] * 5, "56 %"),
        (["starting", "held", "input invalid", "row refused"] * 3 + ["valid"] + ["implausible"] * 2, "67 %"),
        (["implausible"] * 5 + ["valid"], ""),  # the last row that drives agrees
        (["implausible"] * 5 + ["held"] * 20, "100 %"),
        (["held"] * 5, ""),
        ([], ""),
    ],
)
def test_a_log_is_contradictory_if_most_rows_that_drive_are_and_the_last(reasons, said):
    found = describe_implausible(make_contradiction(reasons))
    assert bool(found) == bool(said) and said in found
    if said:
        assert found.endswith("rows that drive: yaw_rate seems to be 2 times the true value")


def test_a_contradictory_log_is_named_as_in_its_last_row():
    table = make_contradiction(["implausible"] * 5 + ["held"] * 2)
    table["fault_factor"] = [-1.0, -1.0, 9.0, 9.0, 3.0, 0.0, 0.0]
    assert describe_implausible(table).endswith("yaw_rate seems to be 3 times the true value")


@pytest.mark.parametrize(
    ("agreed", "held", "channel", "factor", "whole"),
    [
        (20.5, 0.0, "yaw_rate", 0.0, False),
        (19.5, 0.0, "yaw_rate", 0.0, True),
        (15.0, 10.0, "yaw_rate", 0.0, True),  # time at standstill does not count as driving
        (20.5, 0.0, "wheel_speed_front", 0.0, True),
        (20.5, 0.0, "yaw_rate", 2.0, True),
    ],
)
def test_a_failure_during_the_drive_is_one_after_20_s_of_driving(agreed, held, channel, factor, whole):
    reasons = ["held"] * int(10 * held) + ["valid"] * int(10 * agreed) + ["implausible"] * 400
    assert bool(describe_implausible(make_contradiction(reasons, channel, factor))) == whole


def test_intervals_of_contradictions_are_counted_and_the_first_is_named():
    reasons = np.full(100, "valid", object)
    reasons[10:20] = reasons[23:26] = reasons[60:70] = "implausible"  # the first two are 0.4 s apart
    table = make_contradiction(reasons)
    table.loc[table.index < 20, "fault_factor"] = -1.0
    table.loc[23:26, "fault_factor"] = -2.0
    (text,) = list_contradictions(table)
    assert text == (
        "the channels contradict each other 2 times, first from 1.0 to 2.5 s: yaw_rate seems to have the "
        "other sign (factor -2, about 1 is expected): not valid there"
    )
    (text,) = list_contradictions(table[:40].assign(estimate_age=0.5))
    assert text.startswith("the channels contradict each other from 0.5 to 2.0 s: ")


# ---- events


def test_times_are_those_of_the_estimates():
    table = pd.DataFrame({"time": [1.0, 2.0, 3.0]})
    np.testing.assert_array_equal(estimate_times(table), [1, 2, 3])
    np.testing.assert_array_equal(estimate_times(table.assign(estimate_age=0.0)), [1, 2, 3])
    np.testing.assert_allclose(estimate_times(table.assign(estimate_age=[0.1, np.nan, 0.2])), [0.9, 2, 2.8])


@pytest.mark.parametrize(("apart", "count"), [(0.5, 1), (0.75, 2)])  # numbers that are exact in binary
def test_runs_of_rows_at_most_half_a_second_apart_are_one(apart, count):
    time = np.array([0.0, 0.25, 0.25 + apart / 2, 0.25 + apart, 9.0])
    where = np.array([True, True, False, True, False])
    assert find_spans(time, where) == ([(0, 4)] if count == 1 else [(0, 2), (3, 4)])
    assert find_spans(time, ~where)[-1] == (4, 5)


def test_the_channel_of_a_fault_is_filled_in_at_its_beginning_only():
    channel = np.array([0, 0, 4, 0, 0, 5, 0, 0, 0])
    assert fill_names(channel, [(1, 4), (4, 7)]).tolist() == [0, 4, 4, 0, 5, 5, 0, 0, 0]
    assert channel.tolist() == [0, 0, 4, 0, 0, 5, 0, 0, 0]


def test_numbers_of_channels_count_required_ones_before_optional_ones():
    lib = library()
    assert find_channel_name(1) == lib.channels[0].name
    assert find_channel_name(len(lib.channels) + 1) == lib.optional[0].name
    last = len(lib.channels) + len(lib.optional)
    assert find_channel_name(last) == lib.optional[-1].name
    assert find_channel_name(0) == find_channel_name(last + 1) == find_channel_name(-1) == ""


def test_spells_are_in_order_of_their_start_with_their_largest_probability():
    time = 0.25 * np.arange(40)
    slide, fault = np.zeros(40), np.zeros(40)
    slide[[20, 21]] = 0.9, 0.95
    fault[[4, 5, 7]] = 0.91, 0.97, 0.9
    found = find_spells(pd.DataFrame({"time": time, "p_sliding": slide, "p_fault": fault}))
    assert found == [Spell("fault", 1.0, 1.75, 0.97), Spell("sliding", 5.0, 5.25, 0.95)]
    other = find_spells(pd.DataFrame({"time": time, "p_sliding": fault, "p_fault": slide}))
    assert [(x.what, x.start) for x in other] == [("sliding", 1.0), ("fault", 5.0)]
    assert find_spells(pd.DataFrame({"time": time, "p_sliding": slide - 0.06})) == []
    assert found[0].name == "fault" and Spell("fault", 0, 1, 1, "yaw_rate").name == "yaw_rate at fault"


def test_faults_of_two_channels_are_two_spells_each_with_its_own_probability():
    yaw, late = find_number("yaw_rate"), find_number("accel_y")
    table = pd.DataFrame({"time": 0.25 * np.arange(40), "p_fault": 0.0, "fault_channel": 0})
    table.loc[[4, 5, 6, 7, 20], "p_fault"] = [0.91, 0.93, 0.99, 0.92, 0.95]
    table.loc[[4, 5, 6, 7, 20], "fault_channel"] = [0, yaw, late, yaw, late]
    assert find_spells(table) == [
        Spell("fault", 1.0, 1.75, 0.93, "yaw_rate"),
        Spell("fault", 1.5, 1.5, 0.99, "accel_y"),
        Spell("fault", 5.0, 5.0, 0.95, "accel_y"),
    ]


def test_events_of_one_kind_are_one_line():
    changes = [Change(1.0, 1, 0.9, {"cy_rear": (0.7, NAN), "cx_front": (0.8, 0.05)}), Change(2.0, 4, 0.9, {})]
    spells = [
        Spell("sliding", 3.0, 4.5, 0.95),
        Spell("fault", 5.0, 6.0, 0.99, "accel_y"),
        Spell("sliding", 7.0, 7.5, 1),
    ]
    assert describe_events(changes, spells) == [
        "road changed at 1.00 s: rear cornering x 0.70, front longitudinal x 0.80 ± 0.05",
        "started over at 2.00 s",
        "sliding 2 times, 2.0 s in all, first at 3.00 s",
        "accel_y at fault 5.00 .. 6.00 s, 99 %",
    ]


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (0.0099, "under 1 %"),
        (0.01, "1 %"),
        (0.994, "99 %"),
        (0.995, "over 99 %"),
        (1.0, "100 %"),
        (1.5, "150 %"),
    ],
)
def test_a_share_near_none_or_all_is_neither(share, text):
    assert format_percent(share) == text


def test_a_stretch_that_begins_before_the_log_begins_at_0():
    assert Stretch(-0.04, 5.26, slice(0, 1)).title == "0.0 .. 5.3 s"
    assert Stretch(-0.06, 5.0, slice(0, 1)).title == "-0.1 .. 5.0 s"


def test_stretches_begin_where_the_estimates_are_believed():
    table = pd.DataFrame({"time": 0.5 * np.arange(40)})
    found = [Change(6.0, 1, 0.9, {}, 8.0), Change(14.0, 1, 0.9, {})]
    assert [(s.start, s.end, s.rows) for s in find_stretches(table, found)] == [
        (0.0, 6.0, slice(0, 12)),
        (6.0, 14.0, slice(16, 28)),
        (14.0, 19.5, slice(28, 40)),
    ]
    late = table.assign(estimate_age=0.5)
    assert [(s.start, s.rows) for s in find_stretches(late, found)] == [
        (-0.5, slice(0, 13)),
        (6.0, slice(17, 29)),
        (14.0, slice(29, 40)),
    ]
    assert len(find_stretches(table, [Change(0.0, 1, 0.9, {}), Change(19.5, 1, 0.9, {})])) == 1
    two = find_stretches(table, [Change(2.0, 1, 0.9, {})])  # rows from 0 to 2 s last 2 s
    assert [s.end for s in two] == [2.0, 19.5]
    assert len(find_stretches(table, [Change(1.5, 1, 0.9, {})])) == 1


def test_the_ratio_of_a_change_has_the_sd_of_both_values():
    rows = np.arange(200)
    time, changed = 0.1 * rows, rows >= 100
    table = pd.DataFrame({"time": time, "change_kind": np.where(changed, 2, 0),
                          "change_age": np.where(changed, time - 9.75, 0.0), "change_probability": 0.95,
                          "change_cy_front": 0.5, "cy_front": np.where(changed, 5e4, 1e5),
                          "cy_front_sd": np.where(changed, 2e3, 3e3)})  # fmt: skip
    (change,) = find_changes(table)
    ratio, sd = change.ratio["cy_front"]
    assert (ratio, sd) == (pytest.approx(0.5), pytest.approx(0.5 * np.hypot(0.04, 0.03)))
    assert list(change.ratio) == ["cy_front"] and change.believed == pytest.approx(9.75)
    (without,) = find_changes(table.drop(columns="cy_front_sd"))
    assert np.isnan(without.ratio["cy_front"][1]) and without.effect == "front cornering x 0.50"
    (bare,) = find_changes(table[["time", "change_kind", "change_age", "change_probability"]])
    assert bare.ratio == {} and bare.effect == ""


@pytest.mark.parametrize(
    ("middle", "last", "said"), [(0.95, 0.5, True), (0.5, 0.95, True), (0.85, 0.85, False), (NAN, NAN, True)]
)
def test_a_change_is_likely_by_its_median_or_at_its_end(middle, last, said):
    rows = np.arange(100)
    table = pd.DataFrame({"time": 0.1 * rows, "change_kind": np.where(rows >= 50, 4, 0),
                          "change_age": np.where(rows >= 50, 0.1 * rows - 5, 0.0),
                          "change_probability": np.where(rows == 99, last, middle)})  # fmt: skip
    assert len(find_changes(table)) == said


def test_a_change_begins_with_the_drift_of_the_stiffness_that_it_touches():
    time = 0.1 * np.arange(200)
    moving = np.interp(time, [10.0, 15.0], [1e5, 8e4])
    columns = {"cy_front": np.where(time > 15, 5e4, moving), "cy_rear": np.full(200, 1e5)}
    columns |= {f"{k}_sd": 10.0 + 0 * time for k in ("cy_front", "cy_rear")}
    assert find_begin(columns, time, 2, 0, 150, 199) == pytest.approx(100, abs=1)
    assert find_begin(columns, time, 3, 0, 150, 199) == 150  # the rear axle has not moved
    assert find_begin(columns, time, 4, 0, 150, 199) == 150  # touches none
    assert find_begin(columns, time, 2, 120, 150, 199) == 120  # not before `first`
    away = columns | {"cy_front": np.where(time > 15, 1.5e5, moving)}
    assert find_begin(away, time, 2, 0, 150, 199) == 150  # a drift away from the new value does not count


def make_drift(start=10.0, **columns) -> pd.DataFrame:
    """Return estimates that drift from 100 to 80 kN until a change to 50 kN at 15 s."""
    time = 0.1 * np.arange(200)
    seen = time > 14.95
    front = np.where(seen, 5e4, np.interp(time, [start, 15.0], [1e5, 8e4]))
    table = {"time": time, "change_kind": np.where(seen, 2, 0), "change_age": np.where(seen, time - 15, 0.0)}
    table |= {"change_probability": 0.95, "change_cy_front": 0.6, "change_cy_rear": 0.7}
    table |= {"cy_front": front, "cy_front_sd": 10.0, "cy_rear": 1e5, "cy_rear_sd": 10.0}
    return pd.DataFrame(table | columns)


def test_a_change_begins_with_its_drift_and_has_the_ratio_to_the_value_there():
    (change,) = find_changes(make_drift())
    assert (change.time, change.believed) == (pytest.approx(10.0, abs=0.11), pytest.approx(15.0))
    assert change.ratio["cy_front"][0] == pytest.approx(0.5, rel=1e-2) and list(change.ratio) == ["cy_front"]
    late = make_drift()
    late.loc[late["time"] < 15.95, "change_kind"] = 0  # detected a second after it
    assert find_changes(late) == [change]
    (change,) = find_changes(make_drift(cy_front=1e5))  # none
    assert change.time == change.believed == pytest.approx(15.0)
    assert change.ratio["cy_front"][0] == pytest.approx(0.6)
    time = 0.1 * np.arange(200)
    twice = make_drift(change_kind=np.where(time > 11.95, 2, 0),
                       change_age=time - np.where(time > 14.95, 15.0, 12.0))  # fmt: skip
    first, second = find_changes(twice)
    assert (first.believed, second.believed) == (pytest.approx(12.0), pytest.approx(15.0))
    assert second.time == pytest.approx(12.0, abs=0.11)  # not before the one before


def test_kind_and_ratios_of_a_change_are_those_of_its_last_row():
    late = np.arange(200) >= 180
    table = make_drift(cy_front=1e5).assign(change_cy_rear=np.where(late, 0.8, 0.9))
    table.loc[late, "change_kind"] = 3
    (change,) = find_changes(table)
    assert change.kind == 3 and change.effect.startswith("rear cornering x 0.80")


def test_rows_that_differ_by_half_a_second_report_one_change_with_the_likelihood_of_all():
    rows = np.arange(200)
    at = np.select([rows < 178, rows < 180], [15.0, 14.7], 15.25)  # 0.55 s from row to row
    table = make_drift(cy_front=1e5, change_probability=np.where(rows < 180, 0.95, 0.5))
    table["change_age"] = np.where(rows >= 150, table["time"] - at, 0.0)
    (change,) = find_changes(table)
    assert change.time == pytest.approx(15.25) and change.probability == pytest.approx(0.95)


@pytest.mark.parametrize(("ratios", "count"), [((1.04, 0.96), 0), ((1.06, 1.0), 1), ((1.0, 0.94), 1)])
def test_a_change_counts_if_one_stiffness_rises_or_falls_by_more_than_a_twentieth(ratios, count):
    table = make_drift(cy_front=1e5, change_cy_front=ratios[0], change_cy_rear=ratios[1], change_cx_front=1.0)
    table.loc[table["change_kind"] > 0, "change_kind"] = 1
    assert len(find_changes(table)) == count


def begin_drift(kind=2, **columns) -> int:
    table = make_drift(**columns)
    return find_begin({n: table[n].to_numpy() for n in table}, table["time"].to_numpy(), kind, 0, 149, 199)


def test_what_is_still_learnt_or_slow_is_no_drift():
    time = 0.1 * np.arange(200)
    still = np.interp(time, [0.0, 10.0, 15.0], [2e4, 2e4, 1e3])
    assert begin_drift(cy_front_sd=still) == 149  # 0.22 of movement, 1.96 x 0.2 of it learnt
    little = np.interp(time, [0.0, 10.0, 15.0], [0.14e5, 0.14e5, 1e3])
    assert begin_drift(cy_front_sd=little) == 149 and begin_drift(cy_front_sd=0.5 * little) < 110
    small = np.interp(time, [5.0, 15.0], [1.004e5, 1e5])
    assert begin_drift(cy_front=np.where(time > 15, 0.99e5, small)) == 149  # 0.4 % of at least 5 % in 10 s
    share = np.interp(time, [5.0, 15.0], [1e5, 0.87e5])
    moved = {"cy_front": np.where(time > 15, 0.5e5, share), "cx_front": 1e5, "cx_front_sd": 10.0}
    assert begin_drift(2, **moved) < 60 and begin_drift(1, **moved) == 149  # a third of it, of three


def test_refused_rows_do_not_hide_a_drift():
    table = make_drift()
    assert begin_drift(cy_front=table["cy_front"].where(table.index != 120)) == pytest.approx(100, abs=1)


def test_a_short_stretch_is_joined_to_the_next_and_the_last_to_the_one_before():
    table = pd.DataFrame({"time": 0.5 * np.arange(40)})

    def list_all(*times):
        found = find_stretches(table, [Change(t, 1, 0.9, {}) for t in times])
        return [(s.start, s.end, (s.rows.start, s.rows.stop)) for s in found]

    assert list_all(1.0, 6.0) == [(0.0, 6.0, (2, 12)), (6.0, 19.5, (12, 40))]
    assert list_all(6.0, 7.0) == [(0.0, 6.0, (0, 12)), (6.0, 19.5, (14, 40))]
    assert list_all(6.0, 19.0) == [(0.0, 6.0, (0, 12)), (6.0, 19.5, (12, 38))]
    slow = [Change(6.0, 1, 0.9, {}, 9.0), Change(10.0, 1, 0.9, {}), Change(12.0, 1, 0.9, {})]
    assert find_stretches(table, slow)[1] == Stretch(6.0, 12.0, slice(20, 24))  # of more rows
    late = find_stretches(table, [Change(6.0, 1, 0.9, {}, 9.0), Change(8.0, 1, 0.9, {})])
    assert [s.rows for s in late] == [slice(0, 12), slice(16, 40)]  # believed after its end: no rows


# ---- the answer


def make_verdict(key: str = "cy_front", level: str = "good", **more) -> Verdict:
    fields = {"name": "", "unit": "kN/rad", "value": 100.0, "band": 8.0, "spread": NAN, "nominal": 100.0}
    fields |= {
        "valid": 0.5,
        "reason": "held",
        "reason_share": 0.5,
        "text": "",
        "smoothed": 90.0,
        "smoothed_band": 3.0,
    }
    return Verdict(key=key, level=level, **(fields | {"smoothed_reason": "valid"} | more))


@pytest.mark.parametrize(
    ("verdict", "expected"),
    [
        (make_verdict(), (90.0, 3.0)),
        (make_verdict(smoothed=NAN), (100.0, 8.0)),
        (make_verdict(smoothed_reason="uncertain"), (100.0, 8.0)),
        (make_verdict(level="none", smoothed_reason="uncertain"), (90.0, 3.0)),
        (make_verdict(level="partly"), (90.0, 3.0)),
    ],
)
def test_the_value_of_a_stretch_is_the_smoothed_one_if_it_is_as_valid(verdict, expected):
    assert compute_held_stiffness(verdict) == expected


def test_the_rest_of_a_verdict_does_not_repeat_its_value():
    text = "100 kN/rad ± 8 (95 %), valid 50 % of the time; smoothed over the log 90 ± 3, valid"
    assert describe_rest(make_verdict(text=text)) == "valid 50 % of the time; at the end 100 ± 8"
    assert describe_rest(make_verdict(text=text, smoothed_reason="uncertain")).endswith(
        "smoothed over the log 90 ± 3, valid"
    )
    assert describe_rest(make_verdict(text="100 (95 %), a", smoothed=NAN)) == "a"
    assert describe_rest(make_verdict(text=text, band=0.1)).endswith("at the end 100 ± 0")


@pytest.mark.parametrize(
    ("key", "reason", "text"),
    [
        ("cy_rear", "uncertain", "too few bends in this log"),
        ("cx_front", "not excited", "too little acceleration in this log"),
        ("cx_front", "", "too little acceleration in this log"),
        ("cy_front", "held", "standstill, low speed, reverse or sliding wheels"),
        ("cy_front", "something else", "something else"),
    ],
)
def test_a_reason_is_said_in_a_few_words(key, reason, text):
    assert explain_reason(key, reason) == text


def test_the_answer_has_the_driven_axle_and_aligned_cells():
    verdicts = [
        make_verdict("cx_front", unit="kN", smoothed=50.0, smoothed_band=4.0, value=52.0),
        make_verdict("cy_front", "none", smoothed=NAN, value=NAN, band=NAN, reason="uncertain"),
        make_verdict("cy_rear", "none", smoothed_reason="held"),
    ]
    stiffness = {"longitudinal_stiffness_front": 1e5, "longitudinal_stiffness_rear": 1.5e5}
    front, rear = (
        make_answer([Finding(None, verdicts)], Config.exact(stiffness | {"driven_axle": axle}))
        for axle in (1, 2)
    )
    assert front == [
        "front, in bends   -                 not usable: too few bends in this log",
        "rear, in bends      90 ± 3 kN/rad   not usable: standstill, low speed, reverse or sliding wheels",
        "front, along        50 ± 4 kN       usable, valid 50 % of the time",
    ]
    assert rear[2] == "rear, along         75 ± 6 kN       usable, valid 50 % of the time"
    verdicts[0] = make_verdict("cx_front", unit="kN", smoothed=NAN, value=52.0)  # at the end
    for axle, said in ((0, " 52 ± 8 "), (1, " 52 ± 8 "), (2, " 78 ± 12 ")):
        lines = make_answer([Finding(None, verdicts)], Config.exact(stiffness | {"driven_axle": axle}))
        assert said in lines[2] and lines[2].startswith("rear" if axle == 2 else "front")


def test_the_answer_has_the_last_two_stretches_and_the_number_of_others():
    found = [
        Finding(Stretch(10.0 * i, 10.0 * i + 10, slice(0, 1)), [make_verdict(smoothed=80.0 + i)])
        for i in range(4)
    ]
    config = Config.exact()
    assert make_answer(found, config) == [
        "2 earlier stretches of road: see --verbose or the report",
        "From 20.0 .. 30.0 s:",
        "  front, in bends     82 ± 3 kN/rad   usable, valid 50 % of the time",
        "From 30.0 .. 40.0 s:",
        "  front, in bends     83 ± 3 kN/rad   usable, valid 50 % of the time",
    ]
    assert make_answer(found[:3], config)[0] == "1 earlier stretch of road: see --verbose or the report"
    assert make_answer(found[:2], config)[0] == "From 0.0 .. 10.0 s:"


# ---- what a run says of its log


def make_prepared(**more) -> single.Prepared:
    vehicle = SimpleNamespace(found=[], notes=[])
    return single.Prepared(vehicle, None, Config.exact({"steer_lag_sd": 0.01}), ["a note"], [], **more)


def test_estimates_that_contradict_themselves_make_doubts_certain():
    odd = make_contradiction(["implausible"] * 9)
    plain = make_prepared()
    assert single.find_contradiction(plain, odd)
    assert plain.warnings == plain.notes[:1] and plain.warnings[0].startswith(
        "check units, signs and axles: "
    )
    doubtful = make_prepared(doubts=["perhaps a sign"])
    assert single.find_contradiction(doubtful, odd)
    assert (doubtful.warnings, doubtful.doubts, doubtful.notes) == (["perhaps a sign"], [], ["a note"])
    late = make_prepared()
    assert single.find_contradiction(late, make_table([1] * 9, lag_steer=0.2))
    assert late.warnings[0].startswith("check steer_angle: steer_angle is logged 200 ms earlier")
    sure = make_prepared()
    sure.warnings = ["known"]
    assert not single.find_contradiction(sure, odd) and sure.warnings == ["known"]
    calm = make_prepared(doubts=["perhaps a sign"])
    assert not single.find_contradiction(calm, make_table([1] * 9)) and calm.doubts == ["perhaps a sign"]


def test_notes_of_a_run_count_refused_rows_and_leave_out_what_a_warning_says():
    table = make_contradiction(["valid"] * 20 + ["implausible"] * 9).assign(lag_steer=0.2, noise_accel_x=2.0)
    est = Estimates(table, False, statuses={0: 20, -3: 2, -1: 1, 4: 6})
    notes = single.collect_notes(make_prepared(), est)
    assert notes[0] == "a note" and notes[1].startswith("3 rows were refused by the library: ")
    assert [n.split(" ")[0] for n in notes[2:]] == ["accel_x:", "the", "steer_angle"]
    warned = make_prepared()
    warned.warnings = ["known"]
    assert [n.split(" ")[0] for n in single.collect_notes(warned, est)] == ["a", "3", "accel_x:"]
    assert single.collect_notes(make_prepared(), Estimates(make_table([1] * 9), False)) == ["a note"]


# ---- the preparation of a run


def make_log(**columns):
    t = np.arange(0.0, 20.0, 0.02)
    steer = 0.02 * np.sin(t)
    data = {"time": t, "steer_angle": steer, "accel_y": 100 * steer, "yaw_rate": 5 * steer}
    data |= dict.fromkeys(("wheel_speed_front", "wheel_speed_rear"), 60.0 + np.sin(0.3 * t))
    data |= {"accel_x": 0.1 * np.cos(0.3 * t)}
    rng = np.random.default_rng(1)
    noise = {n: 1e-3 * rng.standard_normal(len(t)) for n in data if n != "time"}
    return read_frame({n: c + noise.get(n, 0.0) for n, c in data.items()} | columns)


@pytest.fixture
def quiet(monkeypatch) -> None:
    """Checks of channels that find nothing."""
    monkeypatch.setattr(single, "check_car", lambda *_: [])
    monkeypatch.setattr(single, "check_lateral_delay", lambda *_: [])


CAR = {"mass": 1600.0, "lf": 1.2, "lr": 1.5, "wheel_radius_front": 0.32, "wheel_radius_rear": 0.32}


def prepare(
    log, average=None, options=None, form="default", settings=None, car=None, **more
) -> single.Prepared:
    car = car or make_vehicle(dict(CAR), Path("car.toml"))
    return single.assemble_run(car, log, None, average, options or {}, form, settings or {}, **more)


def test_settings_of_a_call_win_over_options_and_name_their_source(quiet):
    log = make_log()
    made = prepare(log, options={"valid_sd": 0.2, "max_gap": 0.3}, settings={"valid_sd": 0.15})
    assert (made.config.valid_sd, made.config.max_gap) == (0.15, 0.3)
    assert not made.warnings and not made.doubts and made.own is None
    with pytest.raises(UserError, match="argument settings: valid_sd = 5 is outside"):
        prepare(log, settings={"valid_sd": 5.0}, source="argument settings")
    with pytest.raises(UserError, match="option --set: valid_sd = 5 is outside"):
        prepare(log, settings={"valid_sd": 5.0})


def test_a_log_is_averaged_before_it_is_checked(quiet):
    made = prepare(make_log(), average=0.1)
    assert made.log.averaged == 5 and len(made.log) == 200
    assert prepare(make_log()).log.averaged == 1


@pytest.mark.parametrize("form", ["default", "robust"])
def test_what_contradicts_is_a_warning_and_what_may_is_a_doubt(form, monkeypatch):
    said = ["yaw_rate has the other sign", f"{single.PERHAPS}accel_x is in g"]
    monkeypatch.setattr(single, "check_car", lambda *_: list(said))
    monkeypatch.setattr(single, "select_certain", lambda found: found[:1])
    monkeypatch.setattr(single, "check_lateral_delay", lambda *_: ["late"])
    made = prepare(make_log(), form=form)
    assert made.warnings == said[:1] and made.doubts == said[1:] and made.notes[:2] == said
    assert "late" not in made.notes  # asked only of channels that agree
    with pytest.raises(
        UserError, match=r"log: option --strict: yaw_rate has the other sign; .*accel_x is in g"
    ):
        prepare(make_log(), form=form, strict=True)


@pytest.mark.parametrize("form", ["default", "robust"])
def test_a_late_lateral_channel_is_a_warning_of_the_default_filter(form, monkeypatch):
    monkeypatch.setattr(single, "check_car", lambda *_: [])
    monkeypatch.setattr(single, "check_lateral_delay", lambda *_: ["late"])
    made = prepare(make_log(), form=form)
    assert made.warnings == (["late"] if form == "default" else [])
    if form == "default":
        with pytest.raises(UserError, match="log: option --strict: late"):
            prepare(make_log(), form=form, strict=True)


def test_an_implausible_vehicle_file_is_a_warning_and_its_notes_are_notes(quiet):
    car = make_vehicle(CAR | {"uncertainty": {"mass_sd": 0.01}}, Path("car.toml"))
    car.wrong, car.notes = ["the mass is odd"], ["a table is unknown"]
    made = prepare(make_log(), car=car)
    assert made.warnings == ["the mass is odd"] and "a table is unknown" in made.notes
    assert made.vehicle.found == []  # its uncertainty is stated: nothing is to be calibrated


def test_noise_that_is_not_stated_is_of_the_log_only_for_particles(quiet):
    assert "accel_y_sd" not in prepare(make_log()).vehicle.values  # the filter estimates it
    assert prepare(make_log(), form="robust").vehicle.values["accel_y_sd"] > 0


def test_a_late_channel_and_a_wrong_vehicle_file_are_two_warnings(quiet, monkeypatch):
    monkeypatch.setattr(single, "check_lateral_delay", lambda *_: ["late"])
    car = make_vehicle(dict(CAR), Path("car.toml"))
    car.wrong = ["the mass is odd"]
    assert prepare(make_log(), car=car).warnings == ["late", "the mass is odd"]


def test_an_uncalibrated_car_says_so_unless_it_was_calibrated(quiet, monkeypatch):
    log = make_log()
    assert prepare(log).vehicle.found == [NOT_ASKED] and prepare(log, form="robust").vehicle.found == []
    given = []

    def calibrate(vehicle, logs, say):
        given.extend(logs)
        return single.keep_class("of a test", {"wrong": "the ratio is 16"})

    monkeypatch.setattr(single, "calibrate_once", calibrate)
    made = prepare(log, average=0.1, calibrate=single.Calibrate(others=[log]))
    assert [len(x) for x in given] == [len(log), len(log)]  # not the averaged one
    assert made.log.averaged == 5 and made.own is not None and NOT_ASKED not in made.vehicle.found
    assert made.notes[0] == "check the vehicle file: on this log the ratio is 16"
    assert made.doubts == made.notes[:1] and not made.warnings


@pytest.mark.parametrize("goes_on", [False, True])
def test_ctrl_c_during_a_calibration_ends_it_or_everything(goes_on, quiet, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(single, "calibrate_once", stop)
    if not goes_on:
        with pytest.raises(KeyboardInterrupt):
            prepare(make_log(), calibrate=single.Calibrate())
        return
    made = prepare(make_log(), calibrate=single.Calibrate(goes_on=True))
    assert single.STOPPED in " ".join(made.own.words)


def test_channels_that_contradict_each_other_are_not_calibrated_with(monkeypatch):
    monkeypatch.setattr(single, "check_car", lambda *_: ["odd"])
    monkeypatch.setattr(single, "calibrate_once", lambda *_: pytest.fail("calibrated"))
    for certain in (["odd"], []):
        monkeypatch.setattr(single, "select_certain", lambda _, found=certain: found)
        made = prepare(make_log(), calibrate=single.Calibrate())
        words = " ".join(made.own.words)
        assert "contradict each other" in words and (single.PERHAPS in words) != bool(certain)


def test_a_road_gives_the_sd_of_its_angles_unless_one_is_stated(quiet, monkeypatch):
    s = np.arange(0.0, 500.0, 5.0)
    road = make_road(s, x=s, y=0 * s).with_profile(s, 0 * s + 0.01, bank_sd=0 * s + 0.007)
    t = np.arange(0.0, 20.0, 0.02)
    log = make_log(ref_east=10 + 19 * t, ref_north=0 * t)
    made = prepare(log, road=road)
    assert made.config.road_sd == pytest.approx(0.007) and made.log.extra["bank"].iloc[500] == pytest.approx(
        0.01
    )
    monkeypatch.setattr(single, "calibrate_once", lambda *_: single.keep_class("of a test"))
    again = prepare(log, road=road, calibrate=single.Calibrate())
    assert [n.split(":")[0] for n in again.notes].count("road from road") == 1
    stated = prepare(log, road=road, options={"road_sd": 0.02})
    assert stated.config.road_sd == 0.02
    assert prepare(log).config.road_sd == Config().road_sd and "bank" not in log.extra
    with pytest.raises(UserError, match="road: form robust cannot use a road: use the default form"):
        prepare(log, road=road, form="robust")


def test_the_sd_of_a_road_is_at_most_the_largest_that_a_setting_has(quiet, monkeypatch):
    monkeypatch.setattr("tse.roads.road_match.add_road", lambda log, *_: (log, SimpleNamespace(sd=9.0)))
    assert prepare(make_log(), road="road").config.road_sd == Config().fields["road_sd"].high


def test_a_run_that_contradicts_itself_is_gone_over_again(quiet, monkeypatch):
    passes = []

    def run(path, log, config, progress, learnt, watch, contradicted):
        passes.append((path, contradicted))
        reasons = ["implausible"] * 9
        return Estimates(make_contradiction(reasons), False, b"x")

    monkeypatch.setattr(single, "estimate_to", run)
    made = prepare(make_log())
    ran = single.run_prepared(made, Path("out.csv"), None, SimpleNamespace(note="of yesterday"))
    assert passes == [(Path("out.csv"), False), (Path("out.csv"), True)]
    assert [v.reason for v in ran.findings[0].verdicts] == ["contradicted"] * 3
    assert ran.started_from == "of yesterday" and not ran.reported


def test_notes_are_those_of_every_check_with_the_settings_of_the_run(quiet, monkeypatch):
    seen = []
    monkeypatch.setattr(single, "find_false_stops", lambda log, *given: seen.append(given) or ["stops"])
    monkeypatch.setattr(single, "describe_sampling", lambda log, gap: seen.append(gap) or ["sampling"])
    monkeypatch.setattr(single, "describe_steering", lambda log, most: seen.append(most) or ["steering"])
    monkeypatch.setattr(single, "unused_notes", lambda config, settings: [f"unused: {next(iter(settings))}"])
    car = make_vehicle(CAR | {"wheel_radius_rear": 0.33}, Path("car.toml"))
    car.notes.append("of the car")
    log = make_log()
    log.notes.append("of the log")
    made = prepare(log, car=car, settings={"hold_speed": 1.5, "max_gap": 0.4, "max_steer": 0.5})
    assert seen == [(0.32, 0.33, 1.5), 0.4, 0.5]
    said = ["stops", "of the log", "sampling", "steering", "unused: hold_speed", "of the car"]
    assert [n for n in made.notes if n in said] == said


def test_a_setting_of_the_other_filter_is_refused_wherever_it_is_given(quiet):
    for given in ({"settings": {"particles": 90}}, {"options": {"particles": 90, "seed": None}}):
        with pytest.raises(UserError, match="particles has no effect"):
            prepare(make_log(), **given)
    assert prepare(make_log(), options={"particles": None}).config.form == 0


def test_a_run_after_a_calibration_has_the_settings_of_every_source(quiet, monkeypatch, tmp_path):
    monkeypatch.setattr(single, "calibrate_once", lambda *_: single.keep_class("of a test"))
    (tmp_path / "f.toml").write_text("max_steer = 0.5\n")
    car = make_vehicle(dict(CAR), Path("car.toml"))
    given = (tmp_path / "f.toml", None, {"valid_sd": 0.2}, "default", {"max_gap": 0.3})
    made = single.assemble_run(car, make_log(), *given, calibrate=single.Calibrate())
    assert (made.config.max_steer, made.config.valid_sd, made.config.max_gap) == (0.5, 0.2, 0.3)
    assert made.own is not None


def test_a_run_is_prepared_of_the_log_that_is_read_for_its_car(monkeypatch):
    read = []
    monkeypatch.setattr(single, "read_vehicle", lambda path: f"car {path}")
    monkeypatch.setattr(single, "read_log", lambda path, reading: read.append((path, reading)) or "log")
    monkeypatch.setattr(single, "assemble_run", lambda *given, **named: (given, named))
    reading = single.Reading(None, 20.0, True, ())
    given = (Path("f"), 0.1, {"a": 1}, "robust", {"b": 2})
    made, named = single.prepare_run(Path("l"), Path("c"), *given, reading, "calibrate", "road")
    assert made == ("car c", "log", *given)
    assert named == {"strict": True, "calibrate": "calibrate", "road": "road"}
    assert read == [(Path("l"), replace(reading, car="car c"))]


def test_a_run_passes_its_state_its_warnings_and_its_lines_on(quiet, monkeypatch):
    made, seen, wrote, judged = prepare(make_log()), [], [], []
    made.warnings = ["a sign"]
    sd = {"mass_sd": np.ones(3)}
    est = Estimates(make_table([1] * 9), False, b"x", sd)
    drawn, state = SimpleNamespace(add="add"), SimpleNamespace(note="of yesterday")
    for name in ("estimate", "estimate_to"):
        monkeypatch.setattr(single, name, lambda *given: seen.append(given) or est)
    monkeypatch.setattr("tse.report.report.write_report", lambda *given, **more: wrote.append((given, more)))
    monkeypatch.setattr("tse.report.plots.Data", lambda log: drawn)
    monkeypatch.setattr(single, "make_findings", lambda *given: judged.append(given[2:]) or ["found"])
    monkeypatch.setattr(single, "list_uncertain_parameters", lambda *given: [f"wide: {list(given[2])}"])
    ran = single.run_prepared(made, Path("o"), Path("r"), state, True)
    assert seen == [(Path("o"), made.log, made.config, True, state, ["add"], True)]
    assert judged == [([], ["a sign"], sd)] and ran.notes[-1] == "wide: ['mass_sd']" and ran.reported
    ((given, more),) = wrote
    assert given == (Path("r"), est, made.log, made.vehicle, made.config, ran.notes, drawn)
    assert more == {"judged": ([], ["found"])}
    ran = single.run_prepared(made, None, None, state, whole=True)
    assert seen[1] == (made.log, made.config, False, state, True) and not ran.reported
    est = Estimates(make_table([]), False)
    ran = single.run_prepared(made, None, Path("r"))
    assert not ran.reported and len(wrote) == 1 and ran.started_from is None


def test_a_run_that_was_stopped_is_not_gone_over_again(quiet, monkeypatch):
    passes = []
    est = Estimates(make_contradiction(["implausible"] * 9), True)
    monkeypatch.setattr(single, "estimate_to", lambda *given: passes.append(1) or est)
    made = prepare(make_log())
    single.run_prepared(made, None, None)
    assert len(passes) == 1 and len(made.warnings) == 1
