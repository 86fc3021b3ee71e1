"""Functions of a run over a log, each alone: learnt state, columns, tables, files."""

import io
import os
import signal
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from tse.channels.log import read_frame
from tse.estimation import estimate as module
from tse.estimation.estimate import (
    Estimates,
    Learnt,
    Summary,
    convert_to_single,
    estimate,
    estimate_to,
    list_est_columns,
    list_est_fields,
    make_block,
    mark_implausible,
    read_learnt,
    write_estimates,
    write_learnt,
    write_table,
)
from tse.library.core import NOMINAL, OUTPUT, STIFFNESS, Config, LearntError, NativeFilter, library
from tse.library.errors import UserError

CONFIG = Config.exact({NOMINAL["cx_front"]: 1.6e5, NOMINAL["cy_front"]: 1.2e5, NOMINAL["cy_rear"]: 1.4e5})
CODES = {f.name: code for code, f in library().codes(4 + 3).items()}  # reasons


def make_log(rows: int = 300):
    t = 0.01 * np.arange(rows)
    data = {"time": t, "steer_angle": 0.01 * np.sin(t), "accel_x": 0.1 * np.cos(t), "accel_y": np.sin(t)}
    wheels = dict.fromkeys(("wheel_speed_front", "wheel_speed_rear"), 60.0 + np.cos(t))
    return read_frame(data | wheels | {"yaw_rate": 0.05 * np.sin(t)})


# ---- the learnt state


def test_a_learnt_state_has_the_age_that_is_given_or_that_of_its_file(tmp_path):
    path = tmp_path / "car.tse"
    write_learnt(path, b"state")
    os.utime(path, (0, time.time() - 3 * 86400))  # accessed, modified
    given, found = read_learnt(path, 7 * 86400.0), read_learnt(path)
    assert given == Learnt(path, b"state", 7 * 86400.0, True)
    assert (found.data, found.given) == (b"state", False) and found.age == pytest.approx(3 * 86400, abs=60)
    assert given.note == f"{path}, 7 days old (--age)"
    assert found.note == f"{path}, 3 days old (time of the file; give the true age by --age)"
    os.utime(path, (0, time.time() + 1000))  # of a clock that is ahead
    assert read_learnt(path).age == 0.0 and read_learnt(path, 0.0).given


def test_of_a_file_that_is_no_learnt_state_little_is_read(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(bytes(200_000))
    assert len(read_learnt(path).data) == 65536
    with pytest.raises(UserError, match="gone: cannot be read: No such file"):
        read_learnt(tmp_path / "gone")


def test_a_learnt_state_is_loaded_with_its_age_and_refused_by_its_file():
    seen = []
    state = Learnt(Path("car.tse"), b"x", 5.0, True)
    state.load(SimpleNamespace(load_learnt=lambda *given: seen.append(given)))
    assert seen == [(b"x", 5.0)]

    def refuse(*_):
        raise LearntError("is of another vehicle")

    with pytest.raises(UserError, match=r"^car\.tse: is of another vehicle$"):
        state.load(SimpleNamespace(load_learnt=refuse))


# ---- columns


def make_outputs(n: int = 4) -> np.ndarray:
    out = np.zeros(n, library().dtype(OUTPUT))
    for i, key in enumerate(STIFFNESS):
        out[key], out[f"{key}_sd"], out[f"{key}_spread"] = 0.5 + 0.1 * i, 0.01, 0.02
    return out


def test_stiffness_is_in_newton_by_its_own_nominal_value_and_other_outputs_are_as_they_are():
    out = make_outputs()
    out["vel_x"], out["cy_rear_secant"], out["cy_front_spread_seen"], out["change_cy_rear"] = (
        20.0,
        0.5,
        1,
        0.7,
    )
    out["lag_steer"], out["status"] = 0.02, [0, 4, 0, 0]
    block = make_block(np.arange(4.0), out, CONFIG)
    assert list(block) == list_est_columns() and block["time"].tolist() == [0, 1, 2, 3]
    assert block["cx_front"] == pytest.approx(np.full(4, 0.5 * 1.6e5))
    assert block["cy_front"] == pytest.approx(np.full(4, 0.6 * 1.2e5))
    assert block["cy_rear"] == pytest.approx(np.full(4, 0.7 * 1.4e5))
    assert block["cy_rear_sd"] == pytest.approx(np.full(4, 0.01 * 1.4e5))
    assert block["cx_front_spread"] == pytest.approx(np.full(4, 0.02 * 1.6e5))
    assert block["cy_rear_secant"] == pytest.approx(np.full(4, 0.5 * 1.4e5))
    assert (block["vel_x"] == 20).all() and (block["change_cy_rear"] == 0.7).all()
    assert (block["lag_steer"] == 0.02).all() and (block["cy_front_spread_seen"] == 1).all()


def test_a_reason_of_0_is_valid_unless_the_row_was_refused():
    out = make_outputs()
    out["cy_front_valid"] = [0, CODES["held"], 0, 99]
    out["grip_valid"], out["status"] = CODES["starting"], [0, 4, -3, 0]
    block = make_block(np.arange(4.0), out, CONFIG)
    assert block["cy_front_valid"].tolist() == [1, 0, 0, 0]
    assert list(block["cy_front_reason"]) == ["valid", "held", "row refused", "unknown"]
    assert list(block["grip_reason"]) == ["starting", "starting", "row refused", "starting"]
    assert block["grip_valid"].tolist() == [0] * 4 and block["cx_front_valid"].tolist() == [1, 1, 0, 1]


def test_columns_of_later_versions_follow_those_of_earlier_ones():
    names = [f.name for f in list_est_fields()]
    assert sorted(names) == sorted(f.name for f in library().fields(OUTPUT))
    order = ["vel_x", "cy_rear_spread_seen", "noise_yaw_rate", "p_steady", "estimate_age", "sideslip_sd",
             "noise_wheel_rear", "fault_factor"]  # fmt: skip
    assert [names.index(n) for n in order] == sorted(names.index(n) for n in order)
    assert set(list_est_columns()) == {*names, "time", *(f"{s}_reason" for s in (*STIFFNESS, "grip"))}


def test_of_channels_that_contradict_each_other_only_valid_rows_change():
    out = make_outputs(5)
    for key in STIFFNESS:
        out[f"{key}_valid"] = CODES["held"]
    out["grip_valid"] = CODES["starting"]
    out["cy_rear_valid"][[0, 3]] = CODES["valid"]
    out["grip_valid"][1] = CODES["valid"]
    out["status"] = [0, 1, 4, -3, 5]
    mark_implausible(out)
    assert out["status"].tolist() == [10, 10, 4, -3, 5]
    assert out["cy_rear_valid"].tolist() == [
        CODES[x] for x in ("implausible", "held", "held", "valid", "held")
    ]
    assert out["grip_valid"][1] == CODES["implausible"] and (out["cx_front_valid"] == CODES["held"]).all()


# ---- a run


def test_every_block_has_its_own_rows_and_times(monkeypatch):
    log = make_log()
    est = estimate(log, CONFIG)
    whole = est.table
    assert not est.interrupted and not estimate_to(None, log, CONFIG).interrupted
    assert len(whole) == 300 and np.array_equal(whole["time"], log.time)
    monkeypatch.setattr(module, "BLOCK", 70)
    monkeypatch.setattr(module, "ROWS_AT_A_TIME", 30)
    pd.testing.assert_frame_equal(estimate(log, CONFIG).table, whole)
    marked = []
    monkeypatch.setattr(module, "mark_implausible", lambda out: marked.append(len(out)))
    estimate(log, CONFIG)
    assert not marked
    estimate(log, CONFIG, contradicted=True)
    assert marked == [70, 70, 70, 70, 20]


@pytest.mark.parametrize("to_file", [False, True])
def test_a_run_begins_with_the_learnt_state_and_returns_that_of_its_end(to_file, monkeypatch):
    monkeypatch.setattr(module, "BLOCK", 120)
    log, config = make_log(), Config.exact({**CONFIG.as_dict(), "mass_sd": 0.02})
    filter_ = NativeFilter(config)
    outputs = filter_.outputs(300)
    filter_.step_into(log.rows(0, 300), outputs, 0, 300)
    loaded, seen, marked = [], [], []
    monkeypatch.setattr(module, "mark_implausible", lambda out: marked.append(len(out)))
    more = {"learnt": SimpleNamespace(load=loaded.append), "contradicted": True}
    if to_file:
        more["watch"] = [lambda block: seen.append(len(block["time"])), lambda block: seen.append(0)]
    est = estimate_to(None, log, config, **more) if to_file else estimate(log, config, **more)
    assert est.learnt == filter_.save_learnt() and len(loaded) == 1
    assert isinstance(loaded[0], NativeFilter)
    expected = filter_.uncertainty_sd()
    assert list(est.uncertainty_sd) == list(expected) != []
    np.testing.assert_array_equal(est.uncertainty_sd["mass_sd"], expected["mass_sd"])
    assert seen == ([120, 0, 120, 0, 60, 0] if to_file else [])
    assert marked == [120, 120, 60]


@pytest.mark.parametrize("shown", [False, True])
def test_a_progress_bar_counts_the_rows_of_the_log(shown, monkeypatch, capsys):
    made = []

    class Bar(module.tqdm):
        def __init__(self, **given):
            made.append((given["total"], given["disable"]))
            super().__init__(**given)

    monkeypatch.setattr(module, "tqdm", Bar)
    estimate(make_log(100), CONFIG, shown)
    assert made == [(100, not shown)] and bool(capsys.readouterr().err) == shown


def test_a_run_that_is_stopped_has_the_rows_up_to_there(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "ROWS_AT_A_TIME", 50)
    for run, written in ((estimate, False), (lambda *a: estimate_to(tmp_path / "e.csv", *a), True)):
        asked = iter([False] * 4)

        class Stop:
            def __enter__(self, asked=asked):
                return lambda: next(asked, True)

            def __exit__(self, *_):
                return None

        monkeypatch.setattr(module, "_catch_interrupt", Stop)
        est = run(make_log(), CONFIG)
        assert est.interrupted and len(est) == len(est.table) == 150 and est.learnt is not None
        assert np.isfinite(est.table["cy_front"]).all()
        assert not written or len(pd.read_csv(tmp_path / "e.csv")) == 150


def test_statuses_count_every_row():
    table = pd.DataFrame({"status": [0, 0, -3, 4]})
    assert Estimates(table, False).statuses == {0: 2, -3: 1, 4: 1} and len(Estimates(table, False)) == 4
    assert len(Estimates(table, False, statuses={0: 100})) == 100


@pytest.mark.parametrize(
    ("most", "kept"), [(10, range(10)), (9, range(0, 10, 2)), (4, range(0, 10, 3)), (3, range(0, 10, 4))]
)
def test_a_summary_keeps_every_nth_row_across_blocks(most, kept, monkeypatch):
    monkeypatch.setattr(module, "MAX_SUMMARY", most)
    out = make_outputs(10)
    out["status"] = np.arange(10)
    out["cy_rear"], out["cy_rear_valid"] = np.arange(10), [0] * 9 + [CODES["held"]]
    block = make_block(np.arange(10.0), out, CONFIG)
    summary = Summary(make_block(np.zeros(0), out[:0], CONFIG), 10)
    for a, b in ((0, 3), (3, 4), (4, 10)):
        summary.add({n: c[a:b] for n, c in block.items()})
    table = summary.table()
    assert table["time"].tolist() == list(kept) == table["status"].tolist()
    assert table["cy_rear"].tolist() == [1.4e5 * i for i in kept]
    assert list(table["cy_rear_reason"]) == ["held" if i == 9 else "valid" for i in kept]
    assert summary.rows == 10 and summary.statuses == dict.fromkeys(range(10), 1)
    assert table["cy_rear"].dtype == np.float32 and table["time"].dtype == np.float64
    assert "vel_x" not in table and set(table) == set(module.SUMMARY)


# ---- files


def test_files_are_in_single_precision_but_for_times():
    table = {n: np.array([0.1]) for n in ("time", "log_evidence", "x")}
    table |= {"n": np.array([3]), "w": pd.Categorical(["a"])}
    kinds = {n: str(c.dtype) for n, c in convert_to_single(table).items()}
    assert kinds == {
        "time": "float64",
        "log_evidence": "float64",
        "x": "float32",
        "n": "int64",
        "w": "category",
    }


def test_a_table_of_many_blocks_is_written_whole(monkeypatch, tmp_path):
    table = pd.DataFrame({"time": 0.1 * np.arange(10), "x": np.linspace(0, 1 / 3, 10)})
    write_table(table, tmp_path / "whole.csv")
    write_estimates(table, tmp_path / "single.csv")
    monkeypatch.setattr(module, "BLOCK", 3)
    write_table(table, tmp_path / "parts.csv")
    assert (tmp_path / "whole.csv").read_bytes() == (tmp_path / "parts.csv").read_bytes()
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "whole.csv"), table)
    back = pd.read_csv(tmp_path / "single.csv")
    assert (back["time"] == table["time"]).all() and (
        back["x"].astype(np.float32) == table["x"].astype(np.float32)
    ).all()
    assert (back["x"] != table["x"]).any()


def test_the_suffix_chooses_the_format_and_no_path_writes_nothing(tmp_path, monkeypatch):
    log = make_log(100)
    monkeypatch.setattr(module, "BLOCK", 10)
    monkeypatch.setattr(module, "GROUP", 40)
    est = estimate_to(tmp_path / "e.parquet", log, CONFIG)
    estimate_to(tmp_path / "e.csv", log, CONFIG)
    assert not list(tmp_path.glob(".*")) and len(estimate_to(None, log, CONFIG)) == len(est) == 100
    parquet = pq.ParquetFile(tmp_path / "e.parquet")
    assert [parquet.metadata.row_group(i).num_rows for i in range(parquet.num_row_groups)] == [40, 40, 20]
    table, text = pd.read_parquet(tmp_path / "e.parquet"), pd.read_csv(tmp_path / "e.csv")
    assert list(table) == list(text) == list_est_columns()
    assert table["time"].dtype == np.float64 and table["vel_x"].dtype == np.float32
    np.testing.assert_array_equal(table["cy_front"], text["cy_front"].astype(np.float32))
    assert table["cy_front_reason"].astype(str).tolist() == text["cy_front_reason"].tolist()


# ---- Ctrl-C


def test_the_first_interrupt_is_seen_and_the_second_interrupts():
    before = signal.getsignal(signal.SIGINT)
    with module._catch_interrupt() as stopped:
        assert not stopped()
        signal.raise_signal(signal.SIGINT)
        assert stopped()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_a_run_in_another_thread_leaves_the_handler_alone():
    seen = []

    def run() -> None:
        with module._catch_interrupt() as stopped:
            seen.append((stopped(), signal.getsignal(signal.SIGINT)))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert seen == [(False, signal.getsignal(signal.SIGINT))]


# ---- cells of CSV


@pytest.mark.parametrize(
    ("values", "kind"),
    [
        (np.array([0.5, 1.5]), ("d", False, True)),
        (np.array([0.5, 0.5], np.float32), ("f", True, True)),
        (np.array([0.5, np.nan]), ("d", False, False)),
        (np.array([np.nan, np.nan]), ("d", True, False)),
        (np.array([2.0, 1.5]), ("d", False, False)),
        (np.array([0.0, -0.0]), ("d", False, False)),
        (np.array([-0.0, -0.0]), ("d", True, False)),
        (np.array([0.0, 0.0]), ("d", True, False)),
        (np.array([3, 3]), ("f", True, False)),
        (np.array(["a", "b"]), ("", False, False)),
        (np.array([True, False]), ("", False, False)),
        (pd.Categorical(["a", "a"]), ("words", True, False)),
        (pd.Categorical(["a", "b"]), ("words", False, False)),
    ],
)
def test_the_kind_of_a_column_is_how_its_cells_are_written(values, kind):
    assert module._find_kind(values) == kind


@pytest.mark.parametrize(("number", "plain"), [((1 << 24) - 1, True), (1 << 24, False), (-(1 << 24), False)])
def test_integers_that_single_precision_does_not_hold_are_left_to_arrow(number, plain):
    found = module._join_cells([np.array([number, 1])], "f", False)
    assert (found == [str(number).encode(), b"1"]) if plain else found is None


@pytest.mark.parametrize(
    ("kind", "number", "alike"),
    [
        ("d", 1.5e-5, True),
        ("d", 0.9e-5, False),
        ("d", -0.9e-5, False),
        ("d", 9.5e9 + 0.5, True),
        ("d", -1e10, False),
        ("f", 1e-7, True),
        ("f", 1e10, False),
    ],
)
def test_numbers_that_are_written_in_another_way_are_left_to_arrow(kind, number, alike):
    column = np.array([0.5, number], kind)
    assert (module._join_cells([column], kind, False) is not None) == alike
    table = {"x": column}
    assert module.make_csv_rows(table) == module._write_rows_by_arrow(table)


def test_a_missing_word_is_an_empty_cell_and_a_word_may_have_quotes():
    words = pd.Categorical(["a", None, "b"])
    assert module.make_csv_rows({"w": words, "x": np.array([1.0, np.nan, 2.5])}) == b"a,1\n,\nb,2.5\n"
    quoted = {"w": pd.Categorical(['say "a"', None, "b"]), "x": np.array([1, 2, 3])}
    assert module._join_cells([quoted["w"]], "words", False) is None
    assert pd.read_csv(io.BytesIO(module.make_csv_rows(quoted)), header=None)[0].fillna("").tolist() == [
        'say "a"', "", "b"]  # fmt: skip
