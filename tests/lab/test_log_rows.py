"""Times, rows and checks of a log, by small arrays whose result is known by hand."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tse.library.core import INPUT, library
from tse.library.errors import UserError
from tse.log import rows
from tse.log.clock import BRIDGED_GAP, MAX_TIME_GAP, straighten_time
from tse.log.rows import CheckedLog, Reading, SlowChannel, average, check_log, straighten_log_time

LOG = Path("drive.csv")
CHANNELS = ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")


def make_log(time, **columns) -> CheckedLog:
    """Return a log with a line number of 2 for its first row; other channels are 0."""
    time = np.asarray(time, float)
    data = {c: np.zeros(len(time)) for c in CHANNELS} | {
        n: np.asarray(x, float) for n, x in columns.items() if n in CHANNELS
    }
    extra = {n: np.asarray(x, float) for n, x in columns.items() if n not in CHANNELS}
    step = float(np.median(np.diff(time))) if len(time) > 1 else None
    frame = pd.DataFrame(data)
    ref = pd.DataFrame(index=range(len(time)))
    return CheckedLog(
        LOG, time, frame, ref, np.arange(len(time)) + 2, step, extra=pd.DataFrame(extra, range(len(time)))
    )


def make_table(count: int = 400) -> dict[str, np.ndarray]:
    """Return the columns of a lively drive without a fault."""
    t = 0.01 * np.arange(count)
    noise = np.random.default_rng(1).normal(size=(6, count))
    return {
        "steer_angle": 0.03 * np.sin(t) + 1e-4 * noise[0],
        "wheel_speed_front": 60 + 5 * np.cos(t) + 0.01 * noise[1],
        "wheel_speed_rear": 60 + 5 * np.cos(t) + 0.01 * noise[2],
        "accel_x": np.sin(t) + 0.1 * noise[3],
        "accel_y": 3 * np.sin(t) + 0.3 * noise[4],
        "yaw_rate": 0.2 * np.sin(t) + 0.002 * noise[5],
    }


def check(table: dict[str, np.ndarray], notes: list[str] | None = None, **more) -> CheckedLog:
    """Return the checked log of a table at 100 Hz."""
    count = len(next(iter(table.values())))
    notes = [] if notes is None else notes
    return check_log(LOG, 0.01 * np.arange(count), dict(table), np.arange(count) + 2, notes, **more)


# ---- Times


@pytest.mark.parametrize(
    ("time", "wanted", "note"),
    [
        ([0.0, np.nan, 0.1, 0.2], [0.0, 0.1, 0.2], "1 entries without a time are left out"),
        ([np.nan, 0.3], [0.3], "1 entries without a time are left out"),
        ([np.nan, np.nan], [], "2 entries without a time are left out"),
        # of entries with the same time, the last one is kept
        ([0, 1, 1, 2, 3, 4, 5], [0, 1, 2, 3, 4, 5], "1 entries have the same time as the next entry"),
        # a fall by more than MAX_LATE_TIME sets the clock back, though times soon go on
        (
            [0, 1, 2, 1.4, 3, 4],
            [0, 1, 2, 3, 4.6, 5.6],
            "the clock goes back 1 time (first by 0.6 s at 2.000 s)",
        ),
        ([0, 1, 2, 1.5, 3, 4], [0, 1, 2, 3, 4], "1 entries are out of order: left out"),
        # times that do not go on above the highest one after MAX_LATE_ROWS / 2 entries
        ([0.0, 0.1, 0.05, 0.06, 0.07, 0.08, 0.2], [0.0, 0.1, 0.2], "4 entries are out of order: left out"),
        ([0.0, 0.1, 0.2, 0.05, 0.15, 0.25], [0.0, 0.1, 0.2, 0.25], "2 entries are out of order: left out"),
        ([0.0, 0.1, 0.2, 0.15], [0.0, 0.1, 0.2, 0.3], "goes back 1 time (first by 0.05 s at 0.200 s)"),
        (
            [0.0, 0.1, 0.05, 0.06, 0.07, 0.08, 0.09, 0.2],
            [0.0, 0.1, 0.11, 0.12, 0.13, 0.14, 0.15, 0.26],
            "the clock goes back 1 time (first by 0.05 s at 0.100 s)",
        ),
        # the usual step is that of times that rise
        ([0, 1, -9, -19, -29], [0, 1, 2, 3, 4], "the clock goes back 3 times (first by 10 s at 1.000 s)"),
        (
            [0, 1, 1, 1 + MAX_TIME_GAP, 3602, 3603, 3604],
            [0, 1, 1 + MAX_TIME_GAP, 3602, 3603, 3604],
            "1 entries have the same time as the next entry (first at 1.000 s)",
        ),
        ([0, 1, 2, 0, 1, 2, 0, 1], [0, 1, 2, 3, 4, 5, 6, 7], "the clock goes back 2 times (first by 2 s"),
        ([0, 1, 2 + MAX_TIME_GAP], [0, 1, 1 + BRIDGED_GAP], "the clock jumps ahead by 3601 s at 1.000 s"),
        (
            [0, 1, 9e3, 9e3 + 1, 9e4],
            [0, 1, 1 + BRIDGED_GAP, 2 + BRIDGED_GAP, 2 + 2 * BRIDGED_GAP],
            "the clock jumps ahead by 8999 s at 1.000 s",
        ),
    ],
)
def test_a_wrong_clock_is_repaired_and_named(time, wanted, note):
    found, keep, notes = straighten_time(np.array(time, float))
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    assert len(notes) == 1 and note in notes[0], notes
    assert keep.sum() == len(found)


def test_the_entry_that_is_kept_of_two_at_a_time_is_the_last():
    found, keep, _ = straighten_time(np.array([0.0, 1, 1, 2, 3, 4, 5]))
    assert keep.tolist() == [True, False, True, True, True, True, True] and found[1] == 1


def test_after_a_fall_of_the_clock_one_usual_step_follows_for_all_later_times():
    """The usual step is the median of the steps ahead, here 0.1 s."""
    time = np.array([10.0, 10.1, 10.2, 10.3, 2.0, 2.1, 2.4])
    found, keep, _ = straighten_time(time)
    assert keep.all()
    np.testing.assert_allclose(found, [10.0, 10.1, 10.2, 10.3, 10.4, 10.5, 10.8])


def test_a_gap_of_the_longest_length_is_no_jump_of_the_clock():
    time = np.array([0.0, 1.0, 1.0 + MAX_TIME_GAP])
    found, keep, notes = straighten_time(time)
    assert keep.all() and notes == [] and np.array_equal(found, time)


@pytest.mark.parametrize(("same", "kept", "note"), [(2, 8, "have the same time"), (3, 10, "30 % of the")])
def test_above_a_fifth_of_equal_times_entries_are_spread_and_none_is_dropped(same, kept, note):
    time = np.arange(10.0)
    time[1 : 2 * same : 2] = time[0 : 2 * same : 2]
    found, keep, notes = straighten_time(time)
    assert keep.sum() == kept and note in notes[0] and (np.diff(found) > 0).all()


def test_entries_of_one_tick_are_spread_up_to_the_next_tick_but_not_over_a_gap():
    time = np.array([0.0, 0.0, 0.1, 0.1, 0.1, 0.1, 0.2, 0.2, 5.0, 5.0])
    found, keep, _ = straighten_time(time)
    # after 0.2 there is a gap: two median ticks of 0.1 s are used
    wanted = [0.0, 0.05, 0.1, 0.125, 0.15, 0.175, 0.2, 0.3, 5.0]
    assert keep.all()
    np.testing.assert_allclose(found[:9], wanted, atol=1e-9)
    assert found[8] < found[9]


def test_frames_of_a_bus_keep_equal_times_also_where_the_clock_is_repaired():
    time = np.array([5.0, 5.0, 6.0, 6.0, 1.0, 1.0, 2.0])
    found, keep, notes = straighten_time(time, together=True)
    assert keep.all() and len(notes) == 1
    np.testing.assert_allclose(found, [5, 5, 6, 6, 7, 7, 8])


# ---- The time column of a log


@pytest.mark.parametrize(
    ("time", "text"),
    [
        ([0, 0, 0, 0, 1], r"line 3, column time: 0 is the same time as line 2 \(0\).*\(3 such rows\)"),
        ([0, 1, 0.9, 2, 0.8, 1.5, 1.2, 3], r"line 4, column time: 0.9 is earlier than line 3 \(1\)"),
        ([0, np.nan, np.nan, np.nan, 1], r"line 3, column time: is empty or not finite"),
        ([0, 4000, 8000, 12000], r"line 3, column time: 4000 s after the previous row; .* at most 3600 s"),
    ],
)
def test_a_column_that_holds_no_time_is_refused_with_its_first_line(time, text):
    time = np.array(time, float)
    with pytest.raises(UserError, match=text):
        straighten_log_time(LOG, time, np.arange(len(time)) + 2, [])


@pytest.mark.parametrize(("back", "hint"), [(1, False), (3, True)])
def test_many_falls_of_the_time_hint_at_unsorted_rows(back, hint):
    time = np.arange(12.0)
    time[2 : 2 + 3 * back : 3] -= 1.5
    with pytest.raises(UserError) as error:
        rows.check_time(LOG, time, np.arange(12) + 2)
    assert ("sort the rows by time" in str(error.value)) == hint
    assert (f"({back} such rows)" in str(error.value)) == (back > 1)
    assert "line 4, column time: 0.5 is earlier than line 3 (1)" in str(error.value)


def test_a_few_repairs_of_the_time_are_notes_and_rows_are_named_by_their_place():
    notes: list[str] = []
    time = np.array([0, 0.01, np.nan, 0.03, 0.04])
    found, keep = straighten_log_time(LOG, time, np.arange(5), notes)
    assert keep.tolist() == [True, True, False, True, True] and len(found) == 4
    assert notes == ["time: 1 entries without a time are left out"]
    with pytest.raises(UserError, match="row 1, column time: 0 is the same time as row 0"):
        straighten_log_time(LOG, np.zeros(4), np.arange(4), [], "row")


@pytest.mark.parametrize(
    ("step", "text"),
    [
        (1.0, ""),
        (1.01, "at most 1 s"),
        (10.0, "divide by 1000"),
        (200.0, "divide by 1000"),
        (201.0, "microseconds or nanoseconds"),
        (0.0005, ""),
        (0.00049, "at least 0.001 s"),
        (1e-4, "minutes, multiply by 60; days: by 86400"),
    ],
)
def test_a_step_between_rows_outside_its_limits_is_refused_with_the_unit_it_may_have(step, text):
    if not text:
        rows._check_sample_time(LOG, step)
        return
    with pytest.raises(UserError) as error:
        rows._check_sample_time(LOG, step)
    assert text in str(error.value)


# ---- Rows for the library


def test_the_time_of_the_first_row_is_the_sample_time_and_later_parts_know_the_row_before():
    log = make_log([3.0, 3.1, 3.3, 4.0])
    np.testing.assert_allclose(log.dt, [0.15 + 0.05, 0.1, 0.2, 0.7], atol=1e-9)
    np.testing.assert_allclose(log.rows(2)["dt"], [0.2, 0.7])
    np.testing.assert_allclose(log.rows(1, 3)["dt"], [0.1, 0.2])
    alone = make_log([7.0])
    assert alone.dt == pytest.approx([0.01]) and alone.rows()["dt"] == pytest.approx([0.01])


def test_optional_channels_are_given_where_they_are_finite_and_courses_are_wrapped():
    names = [f.name for f in library().optional]
    made = np.zeros(3, library().dtype(INPUT))
    columns = {
        "gnss_course": np.array([4.0, np.nan, -4.0]),
        "bank": np.array([0.1, 0.2, np.nan]),
        "vehicle_speed": np.ones(3),  # no channel of the library
    }
    rows.fill_optional(made, columns)
    course, bank = 1 << names.index("gnss_course"), 1 << names.index("bank")
    assert made["given"].tolist() == [course | bank, bank, course]
    np.testing.assert_allclose(made["gnss_course"], [4 - 2 * np.pi, 0, 2 * np.pi - 4])
    np.testing.assert_allclose(made["bank"], [0.1, 0.2, 0.0])
    assert make_log([0, 1], bank=[0, 0], vehicle_speed=[1, 1]).optional == ["bank"]


def test_a_part_of_the_rows_has_the_optional_values_of_these_rows():
    log = make_log([0, 0.01, 0.02, 0.03], steer_angle=[1, 2, 3, 4], brake=[0, 1, np.nan, 0.5])
    part = log.rows(1, 4)
    assert part["steer_angle"].tolist() == [2, 3, 4] and part["brake"].tolist() == [1, 0, 0.5]
    assert (part["given"] > 0).tolist() == [True, False, True]


def test_steering_beyond_a_limit_counts_on_either_side_but_not_at_it_or_where_it_is_missing():
    log = make_log(range(5), steer_angle=[0.5, -0.6, np.nan, 0.6, -0.5])
    assert log.steers_beyond(0.5).tolist() == [False, True, False, True, False]
    said = rows.describe_steering(log, 0.5)
    assert len(said) == 1 and "beyond 0.5 rad in 2 rows (first in line 3)" in said[0]
    assert rows.describe_steering(log, 0.6) == []


# ---- Files of a log


def test_files_that_determine_the_rows_are_those_that_exist(tmp_path):
    log, base = tmp_path / "a.csv", tmp_path / "car.dbc"
    base.touch()
    gone = tmp_path / "gone.dbc"
    assert Reading(databases=(base, gone)).files(log) == [base]
    (tmp_path / "signals.toml").touch()
    assert Reading().files(log) == [tmp_path / "signals.toml"]
    (tmp_path / "a.signals.toml").touch()
    (tmp_path / "own.toml").touch()
    assert rows.find_signals_file(log) == tmp_path / "a.signals.toml"
    assert rows.find_signals_file(tmp_path / "b.csv") == tmp_path / "signals.toml"
    assert Reading(signals=tmp_path / "own.toml", databases=(base,)).files(log) == [
        tmp_path / "own.toml",
        base,
    ]
    assert Reading(signals=gone).files(log) == []


def test_the_files_of_a_folder_are_all_that_it_holds_at_any_depth_in_order(tmp_path):
    (tmp_path / "part" / "deep").mkdir(parents=True)
    made = [tmp_path / "b.db3", tmp_path / "metadata.yaml", tmp_path / "part" / "deep" / "a.db3"]
    for p in made:
        p.touch()
    assert rows.list_log_files(tmp_path) == made
    assert rows.list_log_files(made[0]) == made[:1]


# ---- Channels that a log lacks

ALL = ("time", *CHANNELS)
WHEELS = ("wheel_speed_front_left", "wheel_speed_front_right")


@pytest.mark.parametrize(
    ("gone", "more", "absent"),
    [
        (["accel_x"], [], ["accel_x"]),
        (["steer_angle"], [], []),  # required
        (["wheel_speed_rear"], [], ["wheel_speed_rear"]),
        (["wheel_speed_front", "wheel_speed_rear"], [], []),
        (["wheel_speed_front"], WHEELS[:1], []),  # the second wheel was forgotten
        (["accel_x"], ["Accel_X"], []),  # a misspelling
        (["yaw_rate", "wheel_speed_front"], [], ["wheel_speed_front", "yaw_rate"]),
    ],
)
def test_a_channel_that_may_be_absent_is_a_measurement_or_one_axle(gone, more, absent):
    names = [c for c in ALL if c not in gone] + list(more)
    assert rows.find_absent_channels(names, [], rows.MEASURES) == absent


def test_an_axle_with_both_sides_is_not_absent():
    names = [c for c in ALL if c != "wheel_speed_front"] + list(WHEELS)
    assert rows.find_absent_channels(names, ["wheel_speed_front"], rows.MEASURES) == []


@pytest.mark.parametrize(
    ("missing", "text"),
    [
        (["wheel_speed_rear_left"], "both wheels of an axle are needed"),
        (["accel_x", "steer_angle"], "without the steering angle the tyres cannot be estimated"),
        (["accel_y"], "name its signal in signals.toml"),
    ],
)
def test_the_remedy_fits_the_missing_column(missing, text):
    assert text in rows._suggest_remedy(missing)


def test_the_speed_of_the_other_axle_is_copied_and_accel_x_is_dropped():
    for gone, there in (("wheel_speed_rear", "wheel_speed_front"), ("wheel_speed_front", "wheel_speed_rear")):
        table, notes = make_table(), []
        del table[gone]
        log = check(table, notes)
        assert log.stand_in == gone and np.array_equal(log.data[gone], table[there])
        assert log.data["accel_x"].isna().all() and log.data["accel_y"].notna().all()
        assert any(n.startswith(f"{gone} is not in the log: {there} stands in") for n in notes)


def test_an_absent_measurement_is_empty_and_named_and_two_lateral_ones_are_refused():
    table, notes = make_table(), []
    del table["yaw_rate"]
    log = check(table, notes)
    assert log.data["yaw_rate"].isna().all() and log.stand_in is None
    assert notes == ["yaw_rate is not in the log: quantities that only yaw_rate shows are not estimated"]
    del table["accel_y"]
    with pytest.raises(UserError, match="accel_y and yaw_rate are missing"):
        check(table)
    with pytest.raises(UserError, match=r"steer_angle is missing: without the steering angle"):
        check({c: x for c, x in make_table().items() if c != "steer_angle"})


def test_columns_of_a_log_are_named_in_the_order_of_the_library_and_references_apart():
    table = make_table() | {
        "ref_cy_front": np.full(400, 5.0),
        "bank": np.full(400, 0.1),
        "other": np.ones(400),
    }
    log = check(table)
    assert list(log.data) == list(CHANNELS) and list(log.ref) == ["ref_cy_front"]
    assert list(log.extra) == ["bank"] and log.sample_time == pytest.approx(0.01) and len(log) == 400
    assert rows.list_columns() == list(ALL)


# ---- Values that cannot be used


def test_values_at_the_limits_are_used_and_a_few_beyond_are_missing_and_named():
    table, notes = make_table(), []
    table["steer_angle"][[3, 7]] = 1.2, -1.2
    table["steer_angle"][[10, 20]] = -1.3, 1.4
    table["accel_y"][5] = np.nan
    log = check(table, notes)
    assert np.flatnonzero(log.data["steer_angle"].isna()).tolist() == [10, 20]
    assert notes == [
        "steer_angle: 2 values outside -1.2 .. 1.2 rad are treated as missing (first in line 12)",
        "steer_angle: 2 of 400 cells are missing or not usable (first in line 12)",
        "accel_y: 1 of 400 cells are missing or not usable (first in line 7)",
    ]


@pytest.mark.parametrize(("count", "refused"), [(20, False), (21, True)])
def test_a_column_with_more_than_a_twentieth_outside_is_refused(count, refused):
    table = make_table()
    table["yaw_rate"][100 : 100 + count] = -7.0 - np.arange(count)
    if not refused:
        assert check(table).data["yaw_rate"].isna().sum() == count
        return
    with pytest.raises(
        UserError, match=r"line 102, column yaw_rate: -7 is outside .* \(21 such rows\)"
    ) as error:
        check(table)
    assert "if the column holds deg/s, multiply by pi/180" in str(error.value)


@pytest.mark.parametrize(
    ("row", "count", "others", "dropped"),
    [
        (-40.0, 5, 400, True),
        (-40.0, 4, 400, False),  # too seldom
        (40.0, 200, 400, False),  # in half of the rows
        (40.0, 199, 400, True),
        (4.0, 9, 400, False),  # not far from the others
        (40.0, 9, 9, False),  # a switch: too few other values
    ],
)
def test_an_outlying_value_that_repeats_is_a_code_for_not_available(row, count, others, dropped):
    value = 3 * np.sin(0.1 * np.arange(400))
    if others < 400:
        value = np.arange(400) % others * 0.1
    value[:count] = row
    data, notes = {"accel_y": value.copy()}, []
    rows._drop_code(data, "accel_y", notes)
    assert np.isnan(data["accel_y"][:count]).all() == dropped and np.isfinite(data["accel_y"][count:]).all()
    assert len(notes) == dropped
    if dropped:
        assert f"accel_y is {row:g} in {count} rows and at most 3 in the others" in notes[0]


@pytest.mark.parametrize(
    ("count", "value", "dropped"),
    [
        (10, np.full(400, -5.0), True),
        (9, np.full(400, -5.0), False),  # too few runs
        (10, np.where(np.arange(400) % 40 < 20, 5.0, -5.0), False),  # it passes through 0
    ],
)
def test_zeros_between_values_far_from_zero_were_written_for_missing_ones(count, value, dropped):
    value = value + 0.01 * np.sin(np.arange(400.0))
    for k in range(count):
        value[40 * k + 19 : 40 * k + 21 - (k > 8)] = 0.0
    data, notes = {"accel_y": value.copy()}, []
    rows._drop_written_zeros(data, "accel_y", notes)
    assert np.array_equal(np.isnan(data["accel_y"]), (value == 0) & dropped)
    assert len(notes) == dropped and (not notes or f"is 0 in {(value == 0).sum()} rows" in notes[0])


@pytest.mark.parametrize(("other", "dropped"), [(50, False), (40, True)])
def test_zeros_of_a_channel_that_is_often_zero_are_kept(other, dropped):
    """Ten runs of zeros lie between values far from 0: a fifth of all runs, or fewer."""
    size = np.repeat([0.001, 5.0], [other, 10])
    value = np.column_stack([size, size + 0.001, 0 * size, size, size + 0.001]).ravel()
    data = {"accel_y": value.copy()}
    rows._drop_written_zeros(data, "accel_y", [])
    assert np.array_equal(np.isnan(data["accel_y"]), (value == 0) & dropped)


@pytest.mark.parametrize(
    ("name", "witness", "span", "dropped"),
    [
        ("yaw_rate", "accel_y", 0.51, True),
        ("yaw_rate", "accel_y", 0.49, False),
        ("accel_y", "yaw_rate", 0.051, True),
        ("accel_y", "yaw_rate", 0.049, False),
        ("accel_x", "wheel_speed_rear", 5.1, True),
        ("accel_x", "wheel_speed_rear", 4.9, False),
    ],
)
def test_a_measurement_that_never_changes_is_stuck_only_while_its_witness_moves(name, witness, span, dropped):
    """From the 5 % to the 95 % quantile, the witness moves by `span`."""
    count = 401
    data = {c: np.full(count, 0.7) for c in CHANNELS}
    data[witness] = np.linspace(0.0, span / 0.9, count) - 2.0
    data[name] = np.full(count, 0.7)
    data[name][:3] = np.nan
    parts = {c: (c,) for c in CHANNELS}
    notes: list[str] = []
    rows._drop_stuck(data, parts, notes)
    assert np.isnan(data[name]).all() == dropped and len(notes) == dropped
    if dropped:
        assert notes[0].startswith(f"{name} is 0.7 in every row, while {witness} changes")


def test_a_measurement_that_changes_once_or_is_short_is_not_stuck():
    for count, last in ((199, 0.7), (400, 0.8)):
        data = {c: np.zeros(count) for c in CHANNELS}
        data["yaw_rate"] = np.append(np.full(count - 1, 0.7), last)
        data["accel_y"] = np.linspace(-5, 5, count)
        rows._drop_stuck(data, {c: (c,) for c in CHANNELS}, [])
        assert np.isfinite(data["yaw_rate"]).all()


@pytest.mark.parametrize("axle", ["wheel_speed_front", "wheel_speed_rear"])
@pytest.mark.parametrize(("noise", "dropped"), [(0.0, True), (0.01, True), (0.04, False)])
def test_an_accel_y_that_is_speed_times_yaw_rate_was_computed(axle, noise, dropped):
    table = make_table()
    table["yaw_rate"] = 0.2 * np.sin(0.1 * np.arange(400))
    exact = 0.3 * table[axle] * table["yaw_rate"]
    table["accel_y"] = exact + noise * np.sqrt(np.mean(exact**2)) * np.random.default_rng(2).normal(size=400)
    other = "wheel_speed_rear" if axle.endswith("front") else "wheel_speed_front"
    table[other] = table[other] * (1 + 0.2 * np.sin(0.05 * np.arange(400)))
    log = check(table, notes := [])
    assert log.data["accel_y"].isna().all() == dropped
    assert any("accel_y equals speed times yaw_rate" in n for n in notes) == dropped


# ---- Two wheels of an axle


def test_the_turn_ratio_is_right_minus_left_over_the_yaw_rate():
    rate = 0.2 * np.sin(0.1 * np.arange(200))
    left, right = 50 - 2.5 * rate, 50 + 2.5 * rate
    mean, per_turn = rows._average_axle("wheel_speed_front", left, right, rate, [])
    assert per_turn == pytest.approx(5.0) and mean == pytest.approx(np.full(200, 50.0))
    left[:30], right[50:90] = np.nan, np.nan
    left[100] = right[100] = np.nan
    notes: list[str] = []
    mean, per_turn = rows._average_axle("wheel_speed_front", left, right, rate, notes)
    assert per_turn == pytest.approx(5.0) and np.flatnonzero(np.isnan(mean)).tolist() == [100]
    assert np.nanmax(np.abs(mean - 50)) < 1e-9 and "missing in 70 rows" in notes[0]


@pytest.mark.parametrize(("sd", "known"), [(0.5, True), (2.0, False)])
def test_a_turn_ratio_that_is_mainly_noise_is_unknown(sd, known):
    """The wheels differ by an rms of 0.71 rad/s in turns, and by noise of this sd."""
    rate = 0.2 * np.sin(0.1 * np.arange(2000))
    noise = sd * np.random.default_rng(4).normal(size=2000)
    _, per_turn = rows._average_axle("wheel_speed_rear", 50 - 2.5 * rate, 50 + 2.5 * rate + noise, rate, [])
    assert (per_turn == pytest.approx(5.0, rel=0.15)) if known else per_turn == 0.0


def test_without_a_yaw_rate_a_wheel_that_is_missing_leaves_the_axle_without_speed():
    left, right = np.full(9, 50.0), np.full(9, 52.0)
    left[2] = np.nan
    mean, per_turn = rows._average_axle("wheel_speed_rear", left, right, np.zeros(9), [])
    assert per_turn == 0.0 and np.isnan(mean[2]) and mean[3] == 51.0


# ---- Optional columns


def test_an_optional_column_with_a_few_values_outside_loses_them_and_with_many_is_not_used():
    line, notes = np.arange(100) + 2, []
    value = np.linspace(-0.35, 0.35, 100)
    value[[4, 50]] = 0.36, -0.36
    found = rows._check_optional("bank", value, line, notes)
    assert np.flatnonzero(np.isnan(found)).tolist() == [4, 50] and np.isfinite(value).all()
    assert notes == ["bank: 2 values outside -0.35 .. 0.35 rad are treated as missing"]
    value[60:70] = np.nan  # 5 of 90 are more than 5 %
    value[[20, 21, 22]] = 2.0
    notes = []
    assert rows._check_optional("bank", value, line, notes, "row") is None
    assert "column bank is not used: 0.36 in row 6 is outside the allowed range -0.35 .. 0.35 rad" in notes[0]
    assert notes[0].endswith("hint: degrees: multiply by pi/180")
    notes = []
    assert rows._check_optional("brake", np.full(3, np.nan), line, notes) is None
    assert notes == ["column brake is not used: it is empty"]


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("vehicle_speed", -60, 120),
        ("ins_vel_y", -60, 60),
        ("gnss_speed", 0, 120),
        ("wheel_torque_rear", -20000, 20000),
        ("gnss_latitude", -90, 90),
        ("gnss_longitude", -180, 180),
    ],
)
def test_the_range_of_an_optional_column_includes_its_limits(name, low, high):
    value = np.linspace(low, high, 200)
    value[:2] = low - 0.01 * (high - low), high + 0.01 * (high - low)
    found = rows._check_optional(name, value, np.arange(200), [])
    assert np.flatnonzero(np.isnan(found)).tolist() == [0, 1]


# ---- Means over blocks


def test_a_mean_has_the_line_of_its_first_row_and_a_value_where_more_than_half_is_there():
    time = 0.01 * np.arange(12)
    y = np.arange(12.0)
    y[[0, 1, 4, 5, 6]] = np.nan
    log = average(make_log(time, accel_y=y, brake=[0, 0, 0, 1] * 3), 0.04)
    np.testing.assert_allclose(log.time, [0.015, 0.055, 0.095])
    # half of the first block is missing, and three quarters of the second
    np.testing.assert_array_equal(np.isnan(log.data["accel_y"]), [True, True, False])
    assert log.data["accel_y"][2] == 9.5 and log.extra["brake"].tolist() == [0.25] * 3
    assert log.line.tolist() == [2, 6, 10] and log.averaged == 4 and log.sample_time == pytest.approx(0.04)
    assert log.notes[-1] == "averaged over 0.04 s: 12 rows became 3, each the mean of 4"


def test_a_last_block_of_half_the_usual_rows_is_dropped_and_a_longer_one_is_kept():
    for count, blocks in ((10, 2), (11, 3)):
        assert len(average(make_log(0.01 * np.arange(count)), 0.04)) == blocks
    assert len(average(make_log(0.01 * np.arange(3)), 0.04)) == 1  # a single block


def test_a_course_is_averaged_along_the_shorter_way_over_missing_values():
    course = np.array([3.0, np.nan, 3.2, 3.3, -2.9, -2.8])
    course[2:4] -= 2 * np.pi
    log = average(make_log(0.01 * np.arange(6), gnss_course=course), 0.03)
    wanted = [3.1, np.mean([3.3, 2 * np.pi - 2.9, 2 * np.pi - 2.8])]
    np.testing.assert_allclose(
        np.exp(1j * log.extra["gnss_course"]), np.exp(1j * np.array(wanted)), atol=1e-9
    )


def test_channels_slower_than_the_blocks_keep_their_entries_with_fewer_rows_each():
    log = make_log(0.01 * np.arange(40))
    t = 0.01 * np.arange(4)
    log.slower = {n: SlowChannel(t, t, r) for n, r in (("steer_angle", 10.0), ("accel_y", 4.0))}
    found = average(log, 0.04).slower
    assert list(found) == ["steer_angle"] and found["steer_angle"].rows == 2.5


@pytest.mark.parametrize(
    ("log", "seconds", "text"),
    [
        (make_log(0.01 * np.arange(9)), 0.0149, "is too short .* rows of the log are 0.01 s apart"),
        (make_log([1.0]), 0.05, "the log has a single row"),
        (make_log(0.01 * np.arange(9)), 0.11, "outside its range 0.001 .. 0.1 s"),
    ],
)
def test_blocks_that_cannot_be_averaged_are_refused(log, seconds, text):
    with pytest.raises(UserError, match=text):
        average(log, seconds)


def test_blocks_of_one_and_a_half_steps_and_of_the_longest_time_are_allowed():
    assert len(average(make_log(0.01 * np.arange(9)), 0.015)) == 6
    assert len(average(make_log(0.01 * np.arange(20)), 0.1)) == 2


# ---- What is reported of the rows


def test_irregular_steps_and_the_longest_gap_are_named():
    step = np.full(400, 0.0625)  # a power of 2: times are exact
    step[[20, 60, 90]] = 0.0675, 0.25, 0.5
    log = make_log(np.append(0.0, np.cumsum(step)))
    said = rows.describe_sampling(log, 0.2)
    assert len(said) == 1 and said[0].startswith(
        "2 gaps longer than 0.2 s (the longest 0.5 s, before line 93)"
    )
    assert rows.describe_sampling(log, 0.4)[0].startswith("1 gap longer than 0.4 s")
    step[90] = 0.25
    assert rows.describe_sampling(make_log(np.append(0.0, np.cumsum(step))), 0.25) == []
    step[100:110] = 0.05
    said = rows.describe_sampling(make_log(np.append(0.0, np.cumsum(step))), 1.0)
    assert said == ["irregular sampling: 3 % of the steps differ from the median by more than 10 %"]
    assert rows.describe_sampling(make_log([0.0]), 1.0) == ["the log has a single row"]


@pytest.mark.parametrize(("step", "count"), [(0.01, 100), (0.02, 50), (0.005, 100)])
def test_the_liveliest_part_is_short_in_rows_and_in_time(step, count):
    turn = np.zeros(1000)
    turn[500:600] = -1.0  # to the right
    turn[10] = 2.0
    log = make_log(step * np.arange(1000), yaw_rate=turn)
    part = rows.select_liveliest(log, 100)
    assert len(part) == count and (part.data["yaw_rate"] == -1.0).all()
    assert part.line[0] == part.time[0] / step + 2 and part.time[0] >= 500 * step - 1e-9


def test_without_a_yaw_rate_the_liveliest_part_is_that_of_the_steering():
    angle = np.zeros(1000)
    angle[700:800] = 0.3
    log = make_log(0.01 * np.arange(1000), yaw_rate=np.full(1000, np.nan), steer_angle=angle, bank=angle)
    t = 0.05 * np.arange(200)
    log.slower = {"steer_angle": SlowChannel(t, t, 5.0)}
    part = rows.select_liveliest(log, 100)
    assert (part.data["steer_angle"] == 0.3).all() and (part.extra["bank"] == 0.3).all()
    slow = part.slower["steer_angle"]
    assert slow.rows == 5.0 and slow.time.tolist() == t[140:160].tolist() == slow.value.tolist()


# ---- Rows that count in a sum, and the words of notes


def test_a_measurement_is_stuck_also_if_its_witness_has_two_wheels_or_moves_late():
    """The witness of accel_x is the left wheel, and the car moves at the end only."""
    data = {c: np.zeros(250_000) for c in CHANNELS if c != "wheel_speed_rear"}
    data["wheel_speed_rear_left"] = np.append(np.zeros(200_000), np.linspace(0.0, 30.0, 50_000))
    data["wheel_speed_rear_right"] = np.zeros(250_000)
    data["accel_y"], data["yaw_rate"] = np.arange(2 * 125_000.0), np.arange(2 * 125_000.0)
    parts = {c: (c,) for c in CHANNELS} | {"wheel_speed_rear": tuple(data)[-2:]}
    rows._drop_stuck(data, parts, notes := [])
    assert np.isnan(data["accel_x"]).all() and len(notes) == 1
    assert notes[0].startswith("accel_x is 0 in every row, while wheel_speed_rear changes")


def test_zeros_are_written_only_if_both_neighbours_are_far_from_zero():
    """Steps are 1, so values above 4 are far from 0."""
    up = np.r_[5.0, 6.0, 7.0, 6.0, 5.0]
    near = np.r_[5.0, 4.0, 3.0, 2.0, 1.0]
    for part, lost in ((up, True), (near, False)):
        value = np.concatenate([np.append(part, 0.0) for _ in range(15)])
        value = np.append(value, 5.0)
        data = {"accel_y": value}
        rows._drop_written_zeros(data, "accel_y", [])
        assert np.isnan(data["accel_y"]).any() == lost
    # missing values between the others are no steps of 0
    fine = np.concatenate([[5.0, 6.0, 5.0, np.nan, np.nan, np.nan, np.nan, 5.0, 0.0] for _ in range(300)])
    data = {"accel_y": np.append(np.where(fine == 6.0, 9.0, fine), 5.0)}
    rows._drop_written_zeros(data, "accel_y", [])
    assert np.isfinite(data["accel_y"]).sum() == np.isfinite(fine).sum() + 1  # 5 is not 4 x 4


def test_a_run_of_zeros_at_the_start_or_the_end_has_no_value_on_one_side():
    value = np.concatenate([[0.0], *([50.0, 50.1, 0.0] for _ in range(10))])
    data = {"accel_x": value}
    rows._drop_written_zeros(data, "accel_x", notes := [])  # 9 inner runs are too few
    assert notes == [] and (data["accel_x"] == value).all()


def test_the_liveliest_part_is_that_with_the_most_motion_in_all_of_it():
    turn = np.zeros(1000)
    turn[100:125] = 3.0  # much, but short
    turn[500:600] = 1.0
    log = make_log(0.01 * np.arange(1000), yaw_rate=turn)
    log.slower = {"yaw_rate": SlowChannel(log.time[::3], turn[::3], 3.0)}
    part = rows.select_liveliest(log, 100)
    assert part.time[0] == pytest.approx(5.0) and part.time[-1] == pytest.approx(5.99)
    assert part.data.index[0] == part.extra.index[0] == part.ref.index[0] == 0
    # entries at both ends of the part belong to it
    assert part.slower["yaw_rate"].time[[0, -1]] == pytest.approx([5.01, 5.97])
    log.slower = {"yaw_rate": SlowChannel(log.time[[499, 500, 599, 600]], np.arange(4.0), 3.0)}
    assert rows.select_liveliest(log, 100).slower["yaw_rate"].value.tolist() == [1, 2]


def test_rows_without_a_yaw_rate_count_neither_for_the_turn_nor_for_one_wheel():
    rate = 0.2 * np.sin(0.1 * np.arange(200))
    left, right = 50 - 2.5 * rate, 50 + 2.5 * rate
    rate = rate.copy()
    rate[[10, 20, 30]] = np.nan
    right[20] = np.nan
    mean, per_turn = rows._average_axle("wheel_speed_front", left, right, rate, notes := [])
    assert per_turn == pytest.approx(5.0) and notes == []
    assert np.flatnonzero(np.isnan(mean)).tolist() == [20] and mean[10] == pytest.approx(50.0)


def test_notes_name_rows_by_the_word_of_the_log():
    log = make_log([0.0, 0.1, 0.2, 0.9, 1.0], steer_angle=[0, 0, 2, 0, 0])
    log.place = "row"
    assert "(first in row 4)" in rows.describe_steering(log, 1.0)[0]
    assert "before row 5)" in rows.describe_sampling(log, 0.5)[-1]
    table = make_table()
    table["yaw_rate"][7] = 99.0
    check(table, notes := [], place="row")
    assert any("yaw_rate: 1 values outside" in n and "(first in row 9)" in n for n in notes)


def test_missing_times_do_not_hide_times_that_stand_still():
    time = np.array([0.0, np.nan, 0.0, 0.0, np.nan, 0.0, 1.0, np.nan, 1.0])
    with pytest.raises(UserError, match="column time: is empty or not finite"):
        straighten_log_time(LOG, time, np.arange(9) + 2, [])


def test_one_long_gap_is_bridged_and_many_are_refused_with_the_line_and_the_usual_unit():
    time = np.append(0.01 * np.arange(10), 4000 + 0.01 * np.arange(10))
    found, keep = straighten_log_time(LOG, time, np.arange(20) + 2, notes := [])
    assert keep.all() and found[10] - found[9] == pytest.approx(BRIDGED_GAP) and "jumps ahead" in notes[0]
    late = np.array([0.0, np.nan, 5000.0, 10000.0, 15000.0])
    with pytest.raises(UserError, match="line 4, column time: 5000 s after the previous row"):
        straighten_log_time(LOG, late, np.arange(5) + 2, [])
    # the unit is that of the usual step, not of the gap
    with pytest.raises(UserError, match="divide by 1000"):
        rows.check_time(LOG, np.array([0.0, 10.0, 20.0, 5000.0]), np.arange(4) + 2)


def test_a_mean_over_blocks_is_taken_of_references_and_blocks_end_by_their_times():
    log = make_log(0.1 + 0.01 * np.arange(40), accel_y=np.arange(40.0))
    log.ref = pd.DataFrame({"ref_cy": np.arange(40.0)})
    found = average(log, 0.05)
    assert len(found) == 8 and found.ref["ref_cy"].tolist() == [2 + 5 * i for i in range(8)]
    assert found.data["accel_y"].tolist() == found.ref["ref_cy"].tolist()
    # with the accuracy of the times, not one row early
    exact = make_log(np.array([0.0, 0.01, 0.02, 0.03 - 1e-12, 0.04, 0.05, 0.06 - 1e-12, 0.07, 0.08]))
    assert average(exact, 0.03).line.tolist() == [2, 5, 8]


def test_an_empty_column_is_an_absent_one():
    table = make_table()
    table["accel_x"] = np.full(400, np.nan)
    log = check(table, notes := [])
    assert log.data["accel_x"].isna().all()
    assert notes == ["accel_x is not in the log: quantities that only accel_x shows are not estimated"]


def test_a_computed_accel_y_is_found_also_if_it_is_missing_in_some_rows():
    table = make_table()
    table["accel_y"] = 0.3 * table["wheel_speed_rear"] * table["yaw_rate"]
    table["accel_y"][50:150] = np.nan
    log = check(table, notes := [])
    assert log.data["accel_y"].isna().all() and any("it is computed, not measured" in n for n in notes)


def test_a_checked_log_has_its_turn_ratios_and_optional_columns_with_missing_values():
    table = make_table()
    rear = table.pop("wheel_speed_rear")
    table["wheel_speed_rear_left"] = rear - 2.5 * table["yaw_rate"]
    table["wheel_speed_rear_right"] = rear + 2.5 * table["yaw_rate"]
    table["brake"] = np.where(np.arange(400) < 10, np.nan, 1.0)
    log = check(table)
    assert log.turn == {"wheel_speed_rear": pytest.approx(5.0)}
    assert np.isfinite(log.extra["brake"]).sum() == 390 and log.optional == ["brake"]
