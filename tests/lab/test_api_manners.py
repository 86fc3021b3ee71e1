"""What the Python API takes besides, and what it says of what it does not take: no cryptic error, nothing silently wrong."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pandas as pd
import pytest

import tse

CAR = {"mass": 1650, "lf": 1.2, "lr": 1.5, "wheel_radius_front": 0.32, "wheel_radius_rear": 0.32}


@pytest.fixture(scope="module")
def frame():
    return tse.simulate("double-lane-change", duration=4).log[["time", *tse.CHANNELS]]


@pytest.fixture(scope="module")
def table(frame):
    return tse.estimate(frame, CAR).table


START = pd.Timestamp("2024-05-01 12:00:00")


@pytest.mark.parametrize(
    "time",
    [
        lambda t: pd.to_timedelta(t, unit="s"),
        lambda t: START + pd.to_timedelta(t, unit="s"),
        lambda t: (START + pd.to_timedelta(t, unit="s")).dt.tz_localize("Europe/Berlin"),
        lambda t: (START + pd.to_timedelta(t, unit="s")).astype(str),
        lambda t: (START + pd.to_timedelta(t, unit="s")).astype(object),
        lambda t: (START + pd.to_timedelta(t, unit="s")).to_numpy(),
        lambda t: pd.to_timedelta(t, unit="s").astype(object),
    ],
    ids=["spans", "dates", "with a zone", "as text", "objects", "numpy", "objects of spans"],
)
def test_a_time_may_be_dates(time, frame, table):
    """Means are those of seconds to what a date of 2024 in double resolves: 2e-7 s of a step of 0.01 s."""
    found = tse.estimate(frame.assign(time=time(frame["time"])), CAR).table
    assert np.allclose(np.diff(found["time"]), 0.01, atol=1e-6)
    assert np.allclose(found["cy_front"], table["cy_front"], rtol=2e-3)


def test_a_time_may_be_the_index(frame, table):
    index = frame.set_index("time")
    pd.testing.assert_frame_equal(tse.estimate(index, CAR).table, table, check_exact=True)
    spans = frame.drop(columns="time").set_index(pd.to_timedelta(frame["time"], unit="s"))
    assert np.allclose(tse.estimate(spans, CAR).table["cy_front"], table["cy_front"], rtol=2e-3)


def test_a_table_of_pyarrow_is_a_frame(frame, table):
    arrow = pytest.importorskip("pyarrow").Table.from_pandas(frame)
    pd.testing.assert_frame_equal(tse.estimate(arrow, CAR).table, table, check_exact=True)


def test_times_in_place_of_a_measurement_are_refused(frame):
    with pytest.raises(tse.Error, match="column yaw_rate is not numeric"):
        tse.estimate(frame.assign(yaw_rate=pd.to_datetime(frame["time"], unit="s")), CAR)
    with pytest.raises(tse.Error, match="column yaw_rate is not numeric"):
        tse.estimate({**{c: frame[c].to_list() for c in frame}, "yaw_rate": [10**400] * len(frame)}, CAR)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (None, "NoneType is no log; give a file, a data frame"),
        ([{"time": 0.0}], r"a list is no log; .*pd.DataFrame\(...\)"),
        (np.zeros((3, 7)), "without names of fields"),
        (7, "int is no log"),
    ],
)
def test_what_is_no_log_is_named(given, words):
    with pytest.raises(TypeError, match=words):
        tse.estimate(given, CAR)


def test_a_form_that_is_not_there_is_refused_with_those_that_are(frame):
    for run in (
        lambda: tse.estimate(frame, CAR, form="x"),
        lambda: tse.Filter(CAR, form="x"),
        lambda: tse.Filter(form=None),
    ):
        with pytest.raises(tse.SettingError, match="allowed: default, robust, paper"):
            run()


@pytest.mark.parametrize("value", [0, -0.01, 1.5, 1e-4, "a", float("nan"), 10**400, [1]])
def test_a_sample_time_outside_its_range_is_refused(value):
    with pytest.raises(tse.SettingError, match=r"sample_time = .* is refused; allowed: 0.001 .. 1 s"):
        tse.Filter(CAR, sample_time=value)


def test_a_sample_time_that_is_longer_than_the_filters_is_spoken_of():
    slow = tse.Filter(CAR, sample_time=0.5)
    assert slow.settings["sample_time"] == 0.1 and any("rows are 0.5 s apart" in n for n in slow.notes)


def test_a_row_is_whatever_has_names(frame):
    rows = [tse.Filter(CAR) for _ in range(4)]
    for i, named in enumerate(frame.head(50).itertuples()):
        row = frame.iloc[i]
        found = [
            f.step(x)
            for f, x in zip(rows, (row.to_dict(), row, named, frame.head(50).to_records(index=False)[i]), strict=True)
        ]
        assert all(np.array_equal(e.stiffness, found[0].stiffness) for e in found)


@pytest.mark.parametrize(
    ("row", "error", "words"),
    [
        ([1, 2], TypeError, "a row is a mapping.*not list"),
        (3.0, TypeError, "not float"),
        ({7: 1.0}, tse.InputError, "7 names no channel"),
        ({"accel_x": 10**400}, tse.InputError, r"accel_x = 1000.*\.\.\. is not a number"),
        ({"accel_x": "a"}, tse.InputError, "accel_x = 'a' is not a number"),
    ],
)
def test_what_is_no_row_is_named(row, error, words):
    with pytest.raises(error, match=words):
        tse.Filter(CAR).step(row)


def test_copies_go_on_by_themselves(frame):
    rows = frame.to_dict("records")
    one = tse.Filter(CAR)
    for row in rows[:100]:
        one.step(row)
    others = [one.copy(), copy.copy(one), copy.deepcopy(one), copy.deepcopy({"f": one})["f"]]
    expected = [one.step(row).stiffness for row in rows[100:200]]
    for other in others:
        assert np.array_equal([other.step(row).stiffness for row in rows[100:200]], expected)


def test_a_filter_is_not_pickled_and_says_what_to_take():
    with pytest.raises(TypeError, match="save_learnt"):
        pickle.dumps(tse.Filter(CAR))


def test_result_filter_steps_to_the_same_bits(frame, table):
    f = tse.estimate(frame, CAR).filter()
    found = [f.step(row).stiffness for row in frame.to_dict("records")]
    assert np.array_equal(found, table[list(tse.STIFFNESS)].to_numpy())


def test_what_is_refused_is_a_standard_exception_too(tmp_path):
    """With today's text, also of a KeyError, which else would quote it."""
    for named, kind, words in (
        (lambda: tse.read_vehicle(tmp_path / "none.toml"), FileNotFoundError, "none.toml: no such file"),
        (
            lambda: tse.Filter(CAR, settings={"forgeting": 1}),
            KeyError,
            "^there is no setting 'forgeting' .did you mean",
        ),
        (lambda: tse.Filter(CAR, settings={"forgetting": 2}), ValueError, "forgetting = 2 is outside its range"),
        (lambda: tse.read_vehicle({"mass": 1650}), ValueError, "lf"),
    ):
        with pytest.raises(kind, match=words) as caught:
            named()
        assert isinstance(caught.value, tse.Error) and isinstance(caught.value, ValueError)
