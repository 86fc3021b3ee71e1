"""Each function of the public tse by itself: small inputs, stand-ins for long runs.

Covered are the parts of Filter, Result, Calibration, Fleet, Gap, Log and Signals,
simulate(), replay() and vehicles, the lists of tse.tables, and the exceptions.
"""

import json
import math
from pathlib import Path
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from small_car import CAR, CODE, ROW

import tse
from tse import errors, tables
from tse.api import calibrate as _calibrate
from tse.api import estimate as _estimate
from tse.api import filter as _filter
from tse.api import fleet as _fleet
from tse.api import gap as _gap
from tse.api import log as _log
from tse.api import shown as _shown
from tse.api import simulate as _simulate
from tse.api import vehicle as _vehicle
from tse.calibration.own import STOPPED
from tse.estimation import regimes
from tse.estimation.estimate import Estimates, Learnt, list_est_columns
from tse.gaps.run import workflow
from tse.library.core import OUTPUT, STATUS, Config, library
from tse.library.errors import UserError
from tse.library.files import parse_toml, read_toml
from tse.roads.road import Road
from tse.runs.page import Car, Last
from tse.runs.single import Calibrate
from tse.simulation import along, maneuvers
from tse.simulation.along import ModelMisfit

ROOT = Path(__file__).resolve().parents[2]
NOMINAL = {"cx_front": 80e3, "cy_front": 100e3, "cy_rear": 150e3}


def replace(monkeypatch, module, name, result):
    """Let a function of a module return `result`; return the list of its arguments."""
    calls = []

    def stand_in(*given, **named):
        calls.append((given, named))
        return result

    monkeypatch.setattr(module, name, stand_in)
    return calls


# ---- Filter


def test_each_output_of_a_row_is_the_field_of_its_name_in_its_unit():
    f = tse.Filter(CAR)
    values = {}
    for i, field in enumerate(library().fields(OUTPUT)):
        values[field.name] = 0 if field.kind != "r" else (i + 1) / 1024
    values |= {"cy_front_valid": CODE["held"], "cx_front_spread_seen": 1, "change_kind": 2}
    values |= {"status": library().status("TSE_W_HELD"), "fault_channel": 2, "grip_valid": CODE["uncertain"]}
    for name, value in values.items():
        f._out[name] = value
    f._time = 7.5
    found = f._estimate().as_dict()
    assert found.pop("time") == 7.5 and found.pop("status") is tse.Status.HELD
    assert found.pop("fault_channel") == "wheel_speed_front"  # the second channel
    for s in (*tse.STIFFNESS, "grip"):
        code = values.pop(f"{s}_valid")
        words = "held" if s == "cy_front" else "uncertain" if s == "grip" else "valid"
        assert (found.pop(f"{s}_valid"), found.pop(f"{s}_reason")) == (code == 0, words)
    for s, nominal in NOMINAL.items():
        for part in ("", "_sd", "_spread", "_secant"):
            assert found.pop(f"{s}{part}") == pytest.approx(values.pop(f"{s}{part}") * nominal, rel=1e-15)
        assert found.pop(f"{s}_spread_seen") is (s == "cx_front")
        values.pop(f"{s}_spread_seen")
    for name in ("status", "fault_channel"):
        values.pop(name)
    assert found == values


def test_the_three_stiffnesses_are_arrays_in_one_order():
    f = tse.Filter(CAR)
    for i, s in enumerate(tse.STIFFNESS, 1):
        f._out[s], f._out[f"{s}_sd"] = i, i / 8
    f._out["cy_front_valid"], f._out["status"] = CODE["held"], library().status("TSE_W_GAP")
    e = f._estimate()
    assert e.stiffness.tolist() == [80e3, 200e3, 450e3] and e.stiffness_sd.tolist() == [10e3, 25e3, 56250.0]
    assert e.valid.tolist() == [True, False, True] and e.valid.dtype == bool
    assert e.status_text == library().codes(STATUS)[library().status("TSE_W_GAP")].text


@pytest.mark.parametrize(
    ("number", "name"),
    [(0, None), (1, "steer_angle"), (6, "yaw_rate"), (7, "ins_vel_x"), (15, "grade"), (99, None)],
)
def test_a_channel_at_fault_has_the_name_of_its_number(number, name):
    f = tse.Filter(CAR)
    f._out["fault_channel"] = number
    assert f._estimate().fault_channel == name


def test_the_time_of_a_filter_is_that_of_the_rows_or_the_sum_of_the_steps():
    f = tse.Filter(CAR, sample_time=0.02)
    assert f._compute_step(None, None) == 0.02 and f._compute_step(99.0, None) == 0.02
    times = [f.step(ROW).time, f.step(ROW, dt=0.25).time, f.step(ROW, dt=0.5).time]
    assert times == [0.0, 0.25, 0.75]
    assert f._compute_step(None, 0.125) == 0.125 and f._compute_step(1.0, None) == 0.25
    f.reset()
    assert f.step(ROW).time == 0.0
    f.reset()
    assert f.step(ROW, time=0.5).time == 0.5  # before the last row: it is a first row
    with pytest.raises(tse.InputError):
        f.step({**ROW, "steer_angle": 3.0}, time=2.0)
    assert f._compute_step(1.0, None) == 0.5  # a refused row has no time
    for text, given in (
        ("dt is missing", (None, None)),
        ("both time and dt", (1.0, 1.0)),
        ("time = inf is not", (math.inf, None)),
    ):
        with pytest.raises(tse.InputError, match=text):
            f._compute_step(*given)


def test_optional_channels_are_given_where_they_are_finite_and_others_are_ignored():
    f = tse.Filter(CAR)
    names = [x.name for x in library().optional]
    f.step(ROW, gnss_speed=19.0, brake=None, bank=math.nan, grade=math.inf, ref_mass=1.0, vehicle_speed=19.0)
    assert f._row["given"][0] == 1 << names.index("gnss_speed") and f._row["gnss_speed"][0] == 19.0
    f.step(accel_y=1.0, dt=0.01, bank=0.02, grade=0.01)
    assert (
        f._row["given"][0] == (1 << names.index("bank")) + (1 << names.index("grade"))
        and f._row["gnss_speed"][0] == 0.0
    )
    assert np.isnan([f._row[c][0] for c in tse.CHANNELS if c != "accel_y"]).all()
    f.step({**ROW, "accel_y": 2.0}, accel_y=3.0, dt=0.01)
    assert f._row["accel_y"][0] == 3.0  # the channel counts, not the row
    assert f.step(None, dt=0.01).status in (tse.Status.PREDICTED, tse.Status.STARTING)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("wheel_speed_front_right", ": give wheel_speed_front, the mean of both wheels"),
        ("wheel_speed_rear_left", ": give wheel_speed_rear, the mean of both wheels"),
        ("yaw_rat", " (did you mean yaw_rate?)"),
        ("qqq", "; known: time, dt, steer_angle, wheel_speed_front, "),
    ],
)
def test_an_unknown_channel_has_a_hint(name, hint):
    with pytest.raises(tse.InputError) as error:
        tse.Filter(CAR).step({name: 1.0})
    assert str(error.value).startswith(f"there is no channel {name!r}{hint}") and error.value.field == name


def test_the_ends_of_the_sample_time_are_allowed_and_notes_come_in_order():
    assert [_filter._read_sample_time(x) for x in (0.001, "0.5", 1)] == [0.001, 0.5, 1.0]
    for value in (0.00099, 1.001, None):
        with pytest.raises(tse.SettingError, match=r"range 0.001 .. 1 s"):
            _filter._read_sample_time(value)
    car = tse.read_vehicle({k: v for k, v in CAR.items() if "stiffness" not in k})
    f = tse.Filter(car, sample_time=0.5)
    assert car.filled and f.notes[: len(car.filled)] == tuple(car.filled)
    assert f.notes[-1].startswith("rows are 0.5 s apart")
    assert tse.Filter(settings={"mass": 1500}).notes == ()


def test_each_delay_is_that_of_its_channel_and_yaw_rate_has_none():
    f = tse.Filter({**CAR, "latency": {"steer_angle": 0.02, "wheel_speed_rear": 0.03, "accel_x": -0.01}})
    assert f.latencies == {
        "steer_angle": 0.02,
        "wheel_speed_front": 0.0,
        "wheel_speed_rear": 0.03,
        "accel_x": -0.01,
        "accel_y": 0.0,
    }


@pytest.mark.parametrize(
    "row", [MappingProxyType(ROW), pd.Series(ROW), next(pd.DataFrame([ROW]).itertuples()), None]
)
def test_any_row_is_a_mapping_of_names(row):
    assert _filter._make_mapping(row) == ({} if row is None else ROW)


# ---- Result


def make_table(rows=4):
    """Return a table of estimates in which every column has values of its own."""
    columns = {"time": 2.0 + 0.5 * np.arange(rows), "status": np.array([0, 1, -3, 0])[:rows]}
    for i, s in enumerate(tse.STIFFNESS, 1):
        for j, part in enumerate(("", "_sd", "_secant", "_spread")):
            columns[s + part] = 100.0 * i + 10 * j + np.arange(rows)
        columns[f"{s}_valid"] = np.arange(rows) >= i
        columns[f"{s}_reason"] = np.where(columns[f"{s}_valid"], "valid", f"held {i}")
    return pd.DataFrame(columns)


def test_arrays_of_a_result_are_the_columns_of_each_stiffness_in_order():
    table = make_table()
    r = tse.Result(table, {})
    assert len(r) == 4 and r.time.tolist() == [2.0, 2.5, 3.0, 3.5] and r.status.tolist() == [0, 1, -3, 0]
    for found, j in ((r.stiffness, 0), (r.stiffness_sd, 1), (r.stiffness_secant, 2), (r.stiffness_spread, 3)):
        assert found[1].tolist() == [101.0 + 10 * j, 201.0 + 10 * j, 301.0 + 10 * j]
    assert r.valid.tolist() == [[False] * 3, [True, False, False], [True, True, False], [True] * 3]
    assert r.reason[1].tolist() == ["valid", "held 2", "held 3"] and r.status.dtype == np.int64


def make_run(**more):
    """Return a result of a run whose parts are short texts."""
    given = {
        "notes": ["w", "d", "l", "n"],
        "findings": [
            SimpleNamespace(lines=lambda: ["a", "b"], verdicts=[]),
            SimpleNamespace(lines=lambda: ["c"], verdicts=[]),
        ],
        "changes": ["change"],
        "estimate": Estimates(make_table(), False, None, {}, {0: 70, -3: 5}),
        "reported": True,
        "started_from": "old.tse",
    }
    ran = SimpleNamespace(**{**given, **more})
    ready = SimpleNamespace(
        warnings=["w"],
        doubts=["d"],
        log=SimpleNamespace(warnings=["l"], path=Path("log.csv"), notes=[]),
        vehicle=SimpleNamespace(path=Path("car.toml"), found=["f1", "f2"], filled=["g"]),
        own=SimpleNamespace(found={"used": True}),
        config=Config.exact(CAR),
    )
    return tse.Result(make_table(), {"mass": 1650}, vehicle=ready.vehicle, _ran=(ran, ready))


def test_sentences_of_a_result_are_those_of_its_run(monkeypatch):
    r = make_run()
    assert r.words == ("f1", "a", "b", "c") and r.stretch_words == (("a", "b"), ("c",))
    assert r.messages == ("w", "d", "l", "n") and r.cautions == ("w", "d", "l")
    assert r.rows == 75 and r.started_from == "old.tse" and r.reported and not r.interrupted
    monkeypatch.setattr(_estimate, "make_answer", lambda found, config: [str(len(found)), str(config.mass)])
    assert r.answer == ("2", "1650.0") and repr(r) == "2\n1650.0"
    seen = replace(monkeypatch, regimes, "describe_events", ["it slid"])
    monkeypatch.setattr(regimes, "find_spells", lambda table: len(table))
    assert r.events == ("it slid",) and seen == [((["change"], 4), {})]
    assert not make_run(reported=False).reported
    plain = tse.Result(make_table(), {})
    assert plain.started_from is None and not plain.reported
    for of in ("facts", "messages", "cautions", "log"):
        with pytest.raises(ValueError, match="not made by estimate"):
            getattr(plain, of)


@pytest.mark.parametrize(("code", "word"), [(0, "yes"), (3, "in part"), (4, "no")])
def test_how_far_a_result_is_usable_is_its_exit_code(code, word, monkeypatch):
    monkeypatch.setattr(_estimate.results, "choose_exit_code", lambda found: code)
    assert (make_run().exit_code, make_run().usable) == (code, word)


def test_a_run_or_its_calibration_may_be_interrupted():
    cut = make_run(estimate=Estimates(make_table(), True, None, {}, {0: 1}))
    assert cut.interrupted and not cut.calibration_interrupted
    for found, stopped in (
        (None, False),
        ({"why": STOPPED}, True),
        ({"why": "too short"}, False),
        ({}, False),
    ):
        assert tse.Result(make_table(), {}, calibration=found).calibration_interrupted is stopped


def test_the_document_of_a_result_keeps_cautions_apart_from_notes(monkeypatch):
    seen = replace(monkeypatch, _estimate.results, "make_document", {"x": math.nan})
    assert make_run().to_dict() == {"x": None}
    (path, _, found, config, said), _ = seen[0]
    assert path == Path("log.csv") and len(found) == 2 and config.mass == 1650
    assert said == {
        "vehicle": Path("car.toml"),
        "started_from": "old.tse",
        "filled": ["g"],
        "calibration": {"used": True, "words": ["f1", "f2"]},
        "notes": ["n"],
        "warnings": ("w", "d", "l"),
        "interrupted": False,
    }


def test_a_summary_has_neither_plot_nor_page_nor_rows(tmp_path):
    r = make_run()
    for what, use in (
        ("plot", r.plot),
        ("report", lambda: r.report(tmp_path / "p.html")),
        ("to_csv", lambda: r.to_csv(tmp_path / "e.csv")),
    ):
        with pytest.raises(ValueError, match=f"^{what}: this result holds only a summary"):
            use()
    assert not list(tmp_path.iterdir())
    whole = pd.DataFrame({c: [0.0] for c in (*list_est_columns(), "more")})
    tse.Result(whole, {})._check_whole("plot")
    with pytest.raises(ValueError, match="summary"):
        tse.Result(whole.drop(columns="cy_rear_secant"), {})._check_whole("plot")


def test_flags_are_written_as_0_and_1():
    found = _estimate._convert_flags(make_table())
    assert found["cx_front_valid"].tolist() == [0, 1, 1, 1] and found["cx_front_valid"].dtype == np.int64
    assert found["time"].dtype == np.float64 and found["status"].tolist() == [0, 1, -3, 0]


def test_what_was_learnt_is_written_and_nothing_is_refused(tmp_path):
    taught = tse.Result(make_table(), {}, learnt=b"state")
    assert taught.save_learnt(str(tmp_path / "c.tse")) == tmp_path / "c.tse"
    assert (tmp_path / "c.tse").read_bytes() == b"state"
    with pytest.raises(UserError, match=r"nothing was learnt, so n.tse is not written"):
        tse.Result(make_table(), {}).save_learnt("n.tse")


def test_the_age_of_a_learnt_state_is_that_of_its_file_or_as_given(tmp_path, monkeypatch):
    read = replace(monkeypatch, _estimate, "read_learnt", "read")
    path = tmp_path / "c.tse"
    assert _estimate.read_learnt_state(path, tse.UNKNOWN_AGE) == "read"
    assert _estimate.read_learnt_state(path, 60.0) == "read"
    assert read == [((path, None), {}), ((path, 60.0), {})]
    assert _estimate.read_learnt_state(b"x", 60.0) == Learnt(Path("learnt"), b"x", 60.0, True)
    assert _estimate.read_learnt_state(b"x", tse.UNKNOWN_AGE).age == math.inf
    assert _estimate.read_learnt_state(None, 60.0) is None


@pytest.fixture
def runs(monkeypatch):
    """Stand-ins for reading, preparing and running; what they were given and return."""
    table = make_table().astype({f"{s}_valid": int for s in tse.STIFFNESS})
    done = Estimates(table, False, b"state", {"mass_sd": np.ones(3)})
    car = tse.read_vehicle(CAR)
    car.found, car.filled = ["found"], ["filled"]
    ready = SimpleNamespace(warnings=[], vehicle=car, config=Config.exact(CAR), own=None)
    ran = SimpleNamespace(estimate=done, notes=["contradiction", "note"])
    return SimpleNamespace(
        done=done,
        ready=ready,
        read=replace(monkeypatch, _estimate, "read_checked", "rows"),
        made=replace(monkeypatch, _estimate, "assemble_run", ready),
        ran=replace(monkeypatch, _estimate, "run_prepared", ran),
    )


def test_what_is_given_to_an_estimate_reaches_its_run(runs, tmp_path):
    reading = tse.Reading(strict=True)
    road = Road.__new__(Road)
    said = []
    r = tse.estimate("log.csv", CAR, settings={"valid_sd": 0.1}, form="robust", average=0.04,
                     road=road, config="f.toml", reading=reading, out=tmp_path / "e.csv", report="r.html",
                     keep_partial=True, progress=said.append, bar=True)  # fmt: skip
    assert runs.read[0][0][0] == "log.csv" and runs.read[0][1] == {"reading": reading}
    ((given, named),) = runs.made
    assert given[0].values["mass"] == 1650
    assert given[1:] == ("rows", Path("f.toml"), 0.04, {}, "robust", {"valid_sd": 0.1}, "settings")
    calibrate = named.pop("calibrate")
    assert isinstance(calibrate, Calibrate) and calibrate.goes_on and named == {"strict": True, "road": road}
    calibrate.say("a step")
    assert said == ["a step"]
    assert runs.ran == [((runs.ready, tmp_path / "e.csv", Path("r.html"), None, True), {"whole": False})]
    assert r.table["cx_front_valid"].tolist() == [False, True, True, True]
    assert r.table["cx_front_valid"].dtype == bool and r.learnt == b"state" and r.warnings == ()
    assert r.notes == ("found", "filled", "contradiction", "note")
    assert r.settings["cornering_stiffness_rear"] == 150e3 and list(r.uncertainty_sd) == ["mass_sd"]
    assert r.calibration is None and r.vehicle is runs.ready.vehicle


@pytest.mark.parametrize(
    ("given", "calibrates"),
    [
        ({}, True),
        ({"calibrate": False}, False),
        ({"learnt": b"x"}, False),
        ({"reading": tse.Reading()}, True),
    ],
)
def test_a_car_is_calibrated_unless_it_has_a_learnt_state(given, calibrates, runs):
    tse.estimate("log.csv", CAR, **given)
    named, ran = runs.made[0][1], runs.ran[0]
    assert (named["calibrate"] is not None) is calibrates and named["strict"] is False
    before = Learnt(Path("learnt"), b"x", math.inf, True) if "learnt" in given else None
    assert ran[0][1:] == (None, None, before, False)
    assert ran[1] == {"whole": True}


def test_contradictions_warn_and_leave_nothing_learnt_and_ctrl_c_is_raised(runs):
    runs.ready.warnings = ["contradiction"]
    runs.ready.own = SimpleNamespace(found={"used": False})
    with pytest.warns(UserWarning, match="^contradiction$") as seen:
        r = tse.estimate("log.csv", CAR)
    assert seen[0].filename == __file__
    assert r.warnings == ("contradiction",) and r.learnt is None and r.notes == ("found", "filled", "note")
    assert r.calibration == {"used": False}
    runs.done.interrupted, runs.ready.warnings = True, []
    with pytest.raises(KeyboardInterrupt):
        tse.estimate("log.csv", CAR)
    assert tse.estimate("log.csv", CAR, keep_partial=True).learnt == b"state"


# ---- Calibration


def make_calibration(converged=True, seconds=100.0, shown=(True, False)):
    found = [
        SimpleNamespace(shown=s, words=f"p{i}", as_json=lambda i=i: {"name": f"p{i}", "sd": i})
        for i, s in enumerate(shown)
    ]
    result = SimpleNamespace(
        fit=SimpleNamespace(converged=converged),
        notes=["n"],
        seconds=seconds,
        findings=found,
        groups=[SimpleNamespace(members=found[::-1])],
        vehicle=tse.read_vehicle(CAR),
    )
    return tse.Calibration(result, [Path("a.csv"), Path("b.csv")])


@pytest.mark.parametrize(
    ("given", "code"),
    [
        ({}, 0),
        ({"seconds": 20.0}, 0),
        ({"seconds": 19.9}, 4),
        ({"shown": (False, False)}, 4),
        ({"shown": ()}, 4),
        ({"converged": False}, 12),
        ({"converged": False, "seconds": 1.0}, 12),
    ],
)
def test_the_code_of_a_calibration_is_by_convergence_length_and_parameters(given, code):
    found = make_calibration(**given)
    assert found.exit_code == code and found.converged is (code != 12) and found.notes == ("n",)


def test_a_calibration_lists_what_is_shown_and_its_table_has_the_logs(tmp_path, monkeypatch):
    found = make_calibration(shown=(True, False, True))
    assert found.shown_words == ("p2", "p0") and found.to_frame()["name"].tolist() == ["p0", "p1", "p2"]
    table = pd.read_csv(found.write_table(tmp_path / "t.csv"))
    assert table["logs"].tolist() == ["a.csv b.csv"] * 3 and table["sd"].tolist() == [0, 1, 2]
    assert list(table) == ["logs", "name", "sd"]
    monkeypatch.setattr(_calibrate, "describe_stiffness", lambda car: f"car of {car.values['mass']:g} kg")
    monkeypatch.setattr(_calibrate, "describe_result", lambda result: ["second", "third"])
    seen = replace(monkeypatch, _calibrate, "summarise_result", ["summary"])
    text = "\n".join(f"{k} = {v}" for k, v in {**CAR, "mass": 1700}.items())
    formatted = replace(monkeypatch, _calibrate.output, "format_calibrated", text)
    assert found.words == ("car of 1700 kg", "second", "third") and found.answer == ("summary",)
    assert seen[0][0][1] == "car of 1700 kg"
    assert formatted[0][0][1:] == (["a.csv", "b.csv"], Path("formula.toml"))
    found._result.vehicle.formula_path, found._result.vehicle.formula = Path("f.toml"), "formula"
    car = found.vehicle
    assert (car.path, car.formula, car.formula_path) == (None, "formula", Path("f.toml"))
    assert formatted[-1][0][2] == Path("f.toml")


def test_logs_of_a_calibration_are_fitted_or_held_out(monkeypatch, tmp_path):
    frame = pd.DataFrame({"time": [0.0, 0.01, 0.02], **{c: [x] * 3 for c, x in ROW.items()}})
    done = replace(monkeypatch, _calibrate.workflow, "run", make_calibration()._result)
    found = tse.calibrate(["a.csv", frame], CAR, hold_out=Path("h.csv"), steps=7, jobs=3)
    (logs, car, held, jobs, say, steps, reading, road), _ = done[0]
    say("discarded")
    assert logs[0] == Path("a.csv") and len(logs[1]) == 3 and held == [Path("h.csv")]
    assert (car.values["mass"], jobs, steps, reading, road) == (1650, 3, 7, None, None)
    assert found._names == ["a.csv", "log 2"]
    tse.calibrate("a.csv", CAR)
    assert done[1][0][2] == [] and done[1][0][3] == 1


# ---- Fleet


def make_done(code=0, error="", seconds=1800.0, car="golf", log="a.csv"):
    drive = SimpleNamespace(car=car, log=log, start=5.0, start_from="name")
    outcome = SimpleNamespace(code=code, error=error, seconds=seconds, notes=["n"])
    return SimpleNamespace(outcome=outcome, drive=drive, report="" if error else "reports/a.html")


def make_fleet(done, monkeypatch, cars=()):
    monkeypatch.setattr(_fleet.page, "list_cars", lambda *_: list(cars))
    return tse.Fleet(done, pd.DataFrame(), Path("out"))


@pytest.mark.parametrize(
    ("codes", "code"),
    [
        ([0, 0], 0),
        ([4, 4], 4),
        ([3], 3),
        ([0, 4], 3),
        ([0, "error"], 3),
        (["error", "error"], 4),
        (["error", 4], 4),
        ([], 0),
    ],
)
def test_the_code_of_a_fleet_is_that_of_all_its_logs_or_in_part(codes, code, monkeypatch):
    done = [make_done(0, "bad") if c == "error" else make_done(c) for c in codes]
    assert make_fleet(done, monkeypatch).exit_code == code


def test_a_fleet_counts_its_logs_hours_and_errors(monkeypatch):
    done = [
        make_done(0),
        make_done(0),
        make_done(3),
        make_done(4, seconds=900.0),
        make_done(0, "b: bad", 0.0),
    ]
    fleet = make_fleet(done, monkeypatch)
    assert fleet.counts == {"yes": 2, "in part": 1, "no": 1, "error": 1} and fleet.hours == 1.75
    assert len(fleet) == 5 and fleet.errors == ("b: bad",)
    assert fleet.files == (Path("out/fleet.parquet"), Path("out/fleet.html"))
    said = fleet.to_dict()
    assert [x["usable"] for x in said["logs"]] == ["yes", "yes", "in part", "no", "no"]
    assert [x["error"] for x in said["logs"]] == [None] * 4 + ["b: bad"]
    assert said["logs"][4]["report"] is None and said["logs"][0]["report"] == "reports/a.html"
    assert said["logs"][0]["start"] == 5.0 and (said["usable"], said["exit_code"]) == ("in part", 3)


def test_each_car_of_a_fleet_has_a_sentence_with_its_latest_stiffnesses(monkeypatch):
    when = pd.Timestamp("2024-05-01 12:00:00")
    last = {"cy_rear": Last(140e3, 5e3, 0.93, when), "cx_front": Last(70e3, 1e3, 0.9, when)}
    cars = [
        SimpleNamespace(name="golf", done=[1, 2], hours=1.25, last=last, reason="rear 140", why={}),
        Car("taxi", [make_done(car="taxi")], {}, {"cy_front": "too few bends"}),
    ]
    fleet = make_fleet([], monkeypatch, cars)
    assert fleet.ranking == (("golf", "rear 140"), ("taxi", "no stiffness is known: too few bends"))
    assert fleet.words == (
        "golf: 2 logs, 1.2 h; rear, in bends 140 ± 5 kN/rad; front, along 70 ± 1 kN",
        "taxi: 1 logs, 0.5 h; no stiffness is known: too few bends",
    )
    golf, taxi = fleet.to_dict()["cars"]
    assert golf["last"]["cy_rear"] == {
        "value": 140e3,
        "band": 5e3,
        "of_nominal": 0.93,
        "time": "2024-05-01T12:00:00",
    }
    assert (golf["logs"], golf["hours"], golf["place_by"]) == (2, 1.25, "rear 140")
    assert taxi["why_not"] == {"cy_front": "too few bends"} and taxi["last"] == {}


@pytest.mark.parametrize(
    ("given", "jobs", "logs"),
    [
        ({}, 0, ["a.csv"]),
        ({"jobs": 3}, 3, ["a.csv"]),
        ({"isolate": True}, 1, ["a.csv"]),
        ({"logs": ["a", Path("b")], "scheduler": "tcp://x"}, 0, ["a", "b"]),
    ],
)
def test_logs_of_a_fleet_run_here_or_in_processes_of_their_own(given, jobs, logs, monkeypatch, tmp_path):
    drives = [SimpleNamespace(vehicle=None)]
    found = replace(monkeypatch, _fleet.find, "find_drives", drives)
    stored = replace(
        monkeypatch, _fleet, "Store", SimpleNamespace(write=lambda done: pd.DataFrame({"done": done}))
    )
    ran = replace(monkeypatch, _fleet, "run_drives", [])
    pages = replace(monkeypatch, _fleet.page, "write_fleet_page", None)
    monkeypatch.setattr(_fleet.page, "list_cars", lambda *_: [])
    given = {"logs": "a.csv", "learn": False, "estimates": True, "calibrate": False, **given}
    given |= {"average": 0.02, "settings": {"mass": 1}, "config": "f.toml", "restart": True, "car": "golf"}
    tse.fleet(vehicle=CAR, out=tmp_path / "out", **given)
    assert found[0][0] == (logs, tmp_path / "out" / "vehicle.toml", None, "golf", tmp_path / "out")
    assert stored[0][0] == (tmp_path / "out", True)
    (given_drives, plan, _, count, scheduler, bar), _ = ran[0]
    assert given_drives is drives and count == jobs and scheduler == given.get("scheduler") and not bar
    assert plan == _fleet.FleetPlan(
        tse.Reading(), Path("f.toml"), 0.02, "default", {"mass": 1}, False, True, True, False
    )
    assert pages[0][0][0] == tmp_path / "out" / "fleet.html" and pages[0][0][3] == "out"


def test_a_fleet_has_either_a_vehicle_or_a_table_and_the_table_names_the_cars(tmp_path):
    for given in ({}, {"vehicle": CAR, "vehicles": "t.csv"}):
        with pytest.raises(ValueError, match="give either `vehicle`"):
            tse.fleet("logs", out=tmp_path, **given)
    with pytest.raises(UserError, match="car: is not allowed together with `vehicles`"):
        tse.fleet("logs", out=tmp_path, vehicles="t.csv", car="golf")
    (tmp_path / "fleet.html").write_text("page")
    fleet = tse.Fleet.__new__(tse.Fleet)
    fleet.folder = tmp_path
    assert fleet.report(tmp_path / "copy.html").read_text() == "page"


# ---- Gap


def make_gap(tmp_path, stages, **more):
    given = {
        "verdict": "named",
        "exit_code": 10,
        "notes": ["n"],
        "undetectable": [SimpleNamespace(id="lag"), SimpleNamespace(id="play")],
        "words": ["a is named", "Still left: b", "c, Still left: d"],
        "stages": stages,
        "fit_before": {"accel_y": 3.0, "yaw_rate": 2.0},
        "fit_after": {"accel_y": 1.5, "yaw_rate": 1.0},
        "held_out": {"accel_y": SimpleNamespace(before=4.0, after=1.25)},
    }
    written = SimpleNamespace(files=[tmp_path / "verdict.json"], gain=[], changes="changes")
    return tse.Gap(SimpleNamespace(**{**given, **more}), written, tmp_path, None)


@pytest.mark.parametrize(
    ("parts", "title"), [(("fit", "held_out"), "held-out logs"), (("fit",), "fitted logs"), ((), None)]
)
def test_the_short_table_is_of_the_held_out_logs_if_there_are_any(parts, title, tmp_path, monkeypatch):
    monkeypatch.setattr(_gap.stages, "describe_channels", lambda found, title: [f"{title}: {found}"])
    gap = make_gap(tmp_path, {p: f"stages of {p}" for p in parts})
    assert gap.short_stages == ((f"{title}: stages of {parts[-1]}",) if parts else ())
    monkeypatch.setattr(_gap.stages, "describe_stages", lambda found, title: [title(p) for p in found])
    assert gap.stages == tuple({"fit": "fitted logs", "held_out": "held-out logs"}[p] for p in parts)
    assert workflow.FIT == "fit" and workflow.HELD_OUT == "held_out"


def test_a_verdict_has_words_residuals_files_and_a_row_for_each_name(tmp_path):
    gap = make_gap(tmp_path, {})
    assert gap.words == ("a is named", "Still left: b", "c, Still left: d")
    assert gap.answer == ("a is named", "c, Still left: d")
    assert gap.rms == {
        "fit": {"accel_y": (3.0, 1.5), "yaw_rate": (2.0, 1.0)},
        "held_out": {"accel_y": (4.0, 1.25)},
    }
    assert (gap.verdict, gap.exit_code, gap.notes, gap.undetectable) == ("named", 10, ("n",), ("lag", "play"))
    assert gap.files == (tmp_path / "verdict.json",)
    verdict = {"effects": [{"id": "a", "parameters": {}}], "sensors": [{"id": "late", "value": 0.02}]}
    (tmp_path / "verdict.json").write_text(json.dumps(verdict))
    assert gap.to_dict() == verdict
    assert gap.to_frame().to_dict("records") == [
        {"id": "a", "parameters": {}},
        {"id": "late", "parameters": {"time": {"value": 0.02}}},
    ]
    (tmp_path / "report.html").write_text("page")
    assert gap.report(str(tmp_path / "copy.html")).read_text() == "page"
    (tmp_path / "vehicle_improved.toml").write_text("\n".join(f"{k} = {v}" for k, v in CAR.items()))
    assert gap.vehicle.values["lr"] == 1.5


def test_logs_of_a_search_are_fitted_or_held_out_and_its_folder_may_be_temporary(tmp_path, monkeypatch):
    result = make_gap(tmp_path, {})._result
    ran = replace(monkeypatch, _gap.workflow, "run_workflow", result)
    wrote = replace(monkeypatch, _gap, "write_all", SimpleNamespace(files=[], gain=[], changes=None))
    gap = tse.gap(["a.csv", "b.csv"], CAR, hold_out="h.csv", out=tmp_path / "out", jobs=3, formula=True)
    (logs, car, held, jobs, say, formula, reading, road), _ = ran[0]
    assert (logs, held) == ([Path("a.csv"), Path("b.csv")], [Path("h.csv")])
    assert (car, jobs, formula, reading, road) == (tmp_path / "out" / "vehicle.toml", 3, True, None, None)
    assert wrote[0][0] == (tmp_path / "out", result, car, 3, say) and gap.folder == tmp_path / "out"
    temporary = tse.gap("a.csv", CAR)
    assert temporary.folder.is_dir() and ran[1][0][2] == [] and ran[1][0][5] is False


def test_a_check_has_a_row_for_each_effect_with_its_logs(tmp_path, monkeypatch):
    found = SimpleNamespace(
        code=3,
        notes=["n"],
        text=lambda: "table",
        as_json=lambda: {"effects": [{"id": "a", "size": math.nan}]},
    )
    seen = replace(monkeypatch, _gap.check, "check_model", found)
    for logs, paths in (("a.csv", ["a.csv"]), ([Path("a.csv"), "b.csv"], ["a.csv", "b.csv"])):
        check = tse.gap_check(logs, CAR, jobs=2)
        assert seen[-1][0][0] == [Path(p) for p in paths] and seen[-1][0][2] == 2
        table = pd.read_csv(check.write_table(tmp_path / "t.csv"))
        assert table["logs"].tolist() == [" ".join(paths)] and table["id"].tolist() == ["a"]
    assert (check.exit_code, check.notes, check.text) == (3, ("n",), "table")
    assert check.to_dict() == {"effects": [{"id": "a", "size": None}]} and len(check.to_frame()) == 1


def test_a_plan_has_its_effects_and_a_row_for_each_manoeuvre(monkeypatch):
    class Option:
        def __init__(self, name, evidence):
            self.name, self.evidence = name, evidence

        @property
        def needed(self):
            return 60.0 * 8.0 / self.evidence if self.evidence else math.inf

    options = [Option("sine", 4.0), Option("step", 0.0)]
    found = SimpleNamespace(
        separable=True, text=lambda rows: f"{rows} rows", options=options, first="lag", second="delay"
    )
    seen = replace(monkeypatch, _gap.plan, "make_plan", found)
    plan = tse.gap_plan("lag,delay", CAR, jobs=2)
    assert seen[0][0][0] == "lag,delay" and seen[0][0][2] == 2
    assert plan.text() == "6 rows" and plan.text(2) == "2 rows" and plan.separable
    assert plan.to_dict() == {
        "effects": ["lag", "delay"],
        "separable": True,
        "manoeuvres": [
            {"name": "sine", "evidence": 4.0, "needed": 120.0},
            {"name": "step", "evidence": 0.0, "needed": None},
        ],
    }
    assert plan.to_frame()["name"].tolist() == ["sine", "step"]


# ---- Log, Signals


def make_frame(rows=5, step=0.02, start=100.0):
    return pd.DataFrame({"time": start + step * np.arange(rows), **{c: [x] * rows for c, x in ROW.items()}})


def test_a_log_has_its_duration_and_all_of_its_columns():
    frame = make_frame().assign(gnss_speed=19.0, ref_mass=1.0)
    log = tse.Log(_log.read_checked(frame, tse.read_vehicle(CAR), "my log"))
    assert log.words[0] == "my log: 5 rows, 0.1 s" and log.words[1:] == log.notes
    assert len(log) == 5 and log.sample_time == pytest.approx(0.02)
    found = log.to_frame()
    assert list(found) == ["time", *tse.CHANNELS, "gnss_speed", "ref_mass"] and found.index.tolist() == list(
        range(5)
    )
    assert found["time"].to_numpy() == pytest.approx(frame["time"].to_numpy())
    assert log.warnings == tuple(log._checked.warnings) and log.path == Path("my log")


def test_logs_in_memory_are_numbered_only_if_there_are_several():
    car = tse.read_vehicle(CAR)
    found = _log.collect_logs([make_frame(), "a.csv", make_frame(4)], car)
    assert [x if isinstance(x, Path) else (x.path.name, len(x)) for x in found] == [
        ("log 1", 5),
        Path("a.csv"),
        ("log 3", 4),
    ]
    assert _log.collect_logs(make_frame(), car)[0].path.name == "log"
    assert _log.collect_logs((Path("a.csv"),), car) == [Path("a.csv")] and _log.collect_logs([], car, 0) == []
    with pytest.raises(UserError, match="no log is given"):
        _log.collect_logs([], car)


def test_a_log_is_adapted_to_the_car_that_it_is_used_with(monkeypatch):
    car = tse.read_vehicle({**CAR, "wheel_radius_front": 0.3, "wheel_radius_rear": 0.4})
    checked = _log.read_checked(make_frame().drop(columns="wheel_speed_rear"), car)
    assert checked.data["wheel_speed_rear"].tolist() == pytest.approx([60.0 * 0.3 / 0.4] * 5)
    again = _log.read_checked(
        tse.Log(_log.read_checked(make_frame().drop(columns="wheel_speed_front"), tse.read_vehicle(CAR))), car
    )
    assert again.data["wheel_speed_front"].tolist() == pytest.approx([60.0 * 0.4 / 0.3] * 5)
    read = replace(monkeypatch, _log, "_read_log", "read")
    assert _log.read_checked("a.csv", car, reading=tse.Reading(rate=50.0)) == "read"
    assert read == [((Path("a.csv"),), {"reading": tse.Reading(rate=50.0, car=car)})]
    monkeypatch.setattr(_log, "_read_log", lambda path, reading: read.append((path, reading)))
    monkeypatch.setattr(_log, "Log", lambda checked: checked)
    tse.read_log("a.csv", signals="s.toml", rate=20.0, strict=True, databases=["a.dbc"])
    assert read[-1] == (Path("a.csv"), tse.Reading(Path("s.toml"), 20.0, True, (Path("a.dbc"),), None))


def test_a_road_is_read_from_a_file_or_taken_as_it_is(monkeypatch):
    road = Road.__new__(Road)
    read = replace(monkeypatch, _log, "read_road", "read")
    assert _log.read_known_road(None) is None and _log.read_known_road(road) is road and read == []
    assert _log.read_known_road("r.csv") == "read" and read == [((Path("r.csv"),), {})]


def make_signals(monkeypatch, guesses=("g",), missing=("accel_y",)):
    lines = [
        SimpleNamespace(name="a", used="yaw_rate", low=math.nan),
        SimpleNamespace(name="b", used="", low=0.0),
    ]
    monkeypatch.setattr(_log, "list_signals", lambda *_: lines)
    monkeypatch.setattr(_log, "format_headline", lambda g: f"headline of {g.channel}")
    monkeypatch.setattr(_log, "format_signals", lambda recording, proposal, how, folder: f"for {folder}")
    recording = SimpleNamespace(format="CSV", notes=["n"], path=Path("logs/a.csv"))
    proposal = SimpleNamespace(
        missing=list(missing),
        nearest={"accel_y": ["q: no unit"]},
        warnings=["w"],
        guesses=[SimpleNamespace(channel="yaw_rate", figures=["0.98"], unit="deg/s") for _ in guesses],
    )
    return tse.Signals(recording, proposal, None)


def test_a_proposal_has_its_channels_then_what_is_missing_then_warnings(monkeypatch, tmp_path):
    found = make_signals(monkeypatch)
    assert found.words == ("headline of yaw_rate", "not found: accel_y", "warning: w")
    assert found.guesses == (("headline of yaw_rate", ("0.98",)),) and found.nearest == {
        "accel_y": ("q: no unit",)
    }
    assert found._shown_rows()["name"].tolist() == ["a"] and found.to_frame()["name"].tolist() == ["a", "b"]
    assert found.toml == "for logs" and (found.format, found.notes) == ("CSV", ("n",))
    assert found.write(tmp_path / "s.toml").read_text() == f"for {tmp_path}"
    said = found.to_dict()
    assert said["proposal"] == {"yaw_rate": {"figures": ["0.98"], "unit": "deg/s"}}
    assert (
        said["signals"][0] == {"name": "a", "used": "yaw_rate", "low": None} and said["log"] == "logs/a.csv"
    )
    assert (said["missing"], said["warnings"], said["notes"]) == (["accel_y"], ["w"], ["n"])
    assert make_signals(monkeypatch, missing=()).words == ("headline of yaw_rate", "warning: w")
    with pytest.raises(UserError, match=r"logs/a.csv: no signal could be proposed, so x.toml is not written"):
        make_signals(monkeypatch, guesses=()).write("x.toml")


# ---- simulate, replay


def test_a_simulation_is_of_the_manoeuvre_and_settings_that_are_given(monkeypatch):
    done = SimpleNamespace(log="log", truth="truth")
    plans = replace(monkeypatch, maneuvers, "build", "plan")
    runs = replace(monkeypatch, _simulate, "_simulate", done)
    given = {"settings": {"speed": 25.0, "sample_time": 0.02, "noise": 2.0}, "road_changes": ((2.0, 0.5),)}
    rear = {**CAR, "driven_axle": "rear"}
    found = tse.simulate("sine-sweep", rear, seed=4, duration=8, amplitude=0.1, bar=True, **given)
    assert found == _simulate.Simulated("log", "truth")
    (name, config), named = plans[0]
    assert name == "sine-sweep" and config.mass == 1650 and config.sample_time == 0.02
    assert named == {
        "sample_time": 0.02,
        "duration": 8,
        "speed": 25.0,
        "amplitude": 0.1,
        "road": [(2.0, 0.5)],
        "seed": 4,
    }
    (plan, same, sim, driven, bar, road), _ = runs[0]
    assert plan == "plan" and same is config and driven == tse.read_vehicle(rear).driven_axle
    assert (sim.noise, sim.wheel_speed_sd, sim.seed, bar, road) == (2.0, 0.02, 4, True, None)
    tse.simulate(speed=15.0, settings={"speed": 25.0, "seed": 9, "wheel_speed_sd": 0.0})
    assert plans[1][1]["speed"] == 15.0 and plans[1][1]["seed"] == 9 and runs[1][0][2].wheel_speed_sd == 0.0
    assert plans[1][0][0] == "double-lane-change"
    tse.simulate(settings={"noise": 0.0})
    assert plans[2][1]["speed"] is None and plans[2][1]["duration"] is None


def test_the_duration_of_a_simulation_is_at_least_a_row(monkeypatch):
    replace(monkeypatch, maneuvers, "build", "plan")
    replace(monkeypatch, _simulate, "_simulate", SimpleNamespace(log="log", truth="truth"))
    for duration in (0.01, maneuvers.MAX_DRIVE_SECONDS):
        tse.simulate(duration=duration)
    for duration in (0.009, maneuvers.MAX_DRIVE_SECONDS + 1, math.nan):
        with pytest.raises(UserError, match=r"duration: .* is outside its range 0.01 .. "):
            tse.simulate(duration=duration)


def test_a_simulated_log_is_written_with_references_on_request(tmp_path):
    drive = tse.simulate("straight", duration=0.05)
    assert drive.write(tmp_path / "a.csv") == tmp_path / "a.csv"
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]
    drive.write(tmp_path / "b.csv", tmp_path / "t.csv", with_ref=True)
    plain, log, truth = (pd.read_csv(tmp_path / f"{x}.csv", dtype=str).astype(float) for x in "abt")
    assert list(plain) == ["time", *tse.CHANNELS]
    assert truth["true_vel_x"].tolist() == drive.truth["true_vel_x"].tolist() == log["ref_vel_x"].tolist()


def test_a_replay_has_the_settings_the_road_and_the_notes_of_its_log(monkeypatch):
    ran = replace(monkeypatch, along, "simulate_along", "table")
    checked = replace(monkeypatch, _simulate, "check_car", ["yaw_rate is wrong"])
    found = tse.replay(make_frame(), {**CAR, "name": "golf"}, settings={"cornering_stiffness_front": 60e3})
    rows, config = ran[0][0]
    assert len(rows) == 5 and (config.cornering_stiffness_front, config.mass) == (60e3, 1650)
    assert found.notes == ("yaw_rate is wrong",) and found.to_frame() == "table"
    assert checked[0][0][1].name == "golf" and checked[0][0][2] is config
    assert (found._title, found._vehicle) == ("log", "golf")
    from tse.roads import road_match

    road = Road.__new__(Road)
    placed = SimpleNamespace(notes=["first", "placed on the road"], path=Path("log"))
    added = replace(monkeypatch, road_match, "add_road", (placed, None))
    monkeypatch.setattr(_simulate, "select_liveliest", lambda rows, count: rows)
    found = tse.replay(make_frame(), CAR, road=road)
    assert found.notes == ("yaw_rate is wrong", "placed on the road") and ran[1][0][0] is placed
    assert added[0][0][1] is road


def test_differences_of_a_replay_are_a_document_and_sentences(monkeypatch, tmp_path):
    monkeypatch.setattr(
        along, "measure_misfit", lambda table: {"accel_y": ModelMisfit(0.5, 2.0, math.nan, "m/s2")}
    )
    replayed = tse.Replayed(pd.DataFrame({"time": [0.5], "accel_y": [0.1]}), ["n"])
    assert replayed.to_dict() == {
        "apart": {"accel_y": {"rms": 0.5, "over_noise": 2.0, "mean": None, "unit": "m/s2"}},
        "notes": ["n"],
    }
    assert replayed.words == along.describe_misfit(replayed.apart()) and "0.5" in replayed.words[0]
    assert replayed.write(tmp_path / "r.csv").read_text() == "time,accel_y\n0.5,0.1\n"


# ---- vehicles


def test_the_file_of_a_vehicle_is_its_own_or_written_of_its_mapping(tmp_path):
    mapping = {
        **CAR,
        "name": 'a "car" ü 😀',
        "mass": np.float32(1650.5),
        "latency": {"steer_angle": np.float64(0.02)},
        "effects": {"body_roll": {"gain": 0.005}},
    }
    path = _vehicle.get_vehicle_file(mapping, tmp_path / "new")
    assert path == tmp_path / "new" / "vehicle.toml"
    assert parse_toml(path.read_text(encoding="utf-8")) == {
        **mapping,
        "mass": 1650.5,
        "latency": {"steer_angle": 0.02},
    }
    assert (
        _vehicle.get_vehicle_file(str(path), tmp_path / "none") == path and not (tmp_path / "none").exists()
    )
    car = tse.read_vehicle(path)
    assert car.name == 'a "car" ü 😀' and _vehicle.get_vehicle_file(car, tmp_path) == path
    car.values["lf"], car.values["lr"] = 1.3, 1.4
    with pytest.raises(UserError, match=r"^lf, lr of the vehicle differ from .*vehicle.toml"):
        _vehicle.get_vehicle_file(car, tmp_path)
    with pytest.raises(UserError, match="the vehicle is not read from a file"):
        _vehicle.get_vehicle_file(tse.read_vehicle(mapping), tmp_path)
    with pytest.raises(UserError):
        _vehicle.get_vehicle_file({**mapping, "mass": 1}, tmp_path / "wrong")
    assert not (tmp_path / "wrong").exists()


def test_a_vehicle_is_a_copy_of_what_is_given():
    given = {**CAR, "latency": {"steer_angle": 0.02}}
    car = tse.read_vehicle(given)
    given["latency"]["steer_angle"] = 0.1
    other = tse.read_vehicle(car)
    other.values["mass"] = 1.0
    assert car.values["mass"] == 1650 and car.values["steer_angle_latency"] == 0.02 and car.path is None
    assert _vehicle.check_names(None) == {} and _vehicle.check_names(CAR) is CAR


def test_the_simulated_car_has_no_uncertainty_and_all_settings_of_a_vehicle():
    car = tse.simulated_car()
    assert car["uncertainty"] and set(car["uncertainty"].values()) == {0.0}
    assert (car["mass"], car["lf"], car["lr"], car["driven_axle"]) == (1900.0, 1.25, 1.5, "front")
    assert car["sensors"]["accel_y_sd"] == Config.exact().accel_y_sd > 0
    assert (car["cornering_stiffness_front"], car["cornering_stiffness_rear"]) == (120e3, 140e3)


# ---- what notebooks show


class Shown(_shown.Shown):
    def __init__(self, rows=3):
        self._rows = rows

    words = ("a < b & c", "second")

    def to_frame(self):
        return pd.DataFrame({"x": [f"cell{i}" for i in range(self._rows)]})

    def plot(self):
        return SimpleNamespace(to_html=lambda **how: f"<div>{json.dumps(how)}</div>")


def test_a_result_is_shown_as_escaped_sentences_and_at_most_twenty_rows(tmp_path):
    text = Shown()._repr_html_()
    assert text.startswith("<ul><li>a &lt; b &amp; c</li><li>second</li></ul><table")
    for rows, hidden in ((20, False), (21, True)):
        text = Shown(rows)._repr_html_()
        assert ("cell10<" not in text) is hidden and "cell0<" in text and f"cell{rows - 1}<" in text
    page = Shown().report(tmp_path / "p.html").read_text()
    assert page.startswith("<!doctype html>") and "cell2" in page and '"full_html": false' in page
    assert '"include_plotlyjs": true' in page  # without a network
    plain = _shown.Shown()
    for use in (lambda: plain.words, plain.to_frame, plain.plot):
        with pytest.raises(NotImplementedError):
            use()


# ---- tables, exceptions, names


def test_settings_manoeuvres_and_the_road_are_those_of_the_tables():
    for simulator, name in ((False, "vehicle"), (True, "sim")):
        source = read_toml(ROOT / "src" / "tables" / f"{name}.toml")
        rows = next(iter(source.values()))
        found = tables.settings(simulator=simulator)
        for key, row in rows.items():
            if isinstance(row, dict) and "least" in row and key in found:
                s = found[key]
                assert (s.name, s.low, s.high, s.text) == (key, row["least"], row["most"], row["text"])
    assert found["speed"].unit == "m/s" and found["speed"].default == 20.0 and "mass" not in found
    road = read_toml(ROOT / "src" / "tables" / "sim.toml")["sim_input"]["road_level"]
    level = tables.road_level()
    assert (level.name, level.low, level.high) == ("road_level", road["least"], road["most"])
    assert level.default == road["default"] and level.text == road["text"]
    for row in tables.maneuvers():
        k = maneuvers.MANEUVERS[row.name]
        for n in ("duration", "speed", "amplitude", "amplitude_text", "text"):
            assert getattr(row, n) == getattr(k, n)
    assert len(tables.maneuvers()) == len(maneuvers.MANEUVERS)


def test_the_list_of_effects_is_the_catalogue_with_a_row_for_each_parameter():
    source = read_toml(ROOT / "src" / "tables" / "effects.toml")
    rows = {(e["id"], e["setting"]): e for e in tables.effects()}
    compared = 0
    for name, effect in source.items():
        for key, p in effect.get("parameter", {}).items() if isinstance(effect, dict) else ():
            row = rows[name, f"{name}_{key}"]
            assert (row["effect"], row["shows_in"]) == (effect["title"], effect["channels"])
            assert (row["enters"], row["look_alikes"]) == (effect["entry"], effect["alike"])
            assert [row["typical_low"], row["typical_high"]] == p["typical"]
            assert (row["unit"], row["negligible"], row["meaning"]) == (p["unit"], p["negligible"], p["text"])
            assert row["strength"] is (p["role"] == "STRENGTH")
            compared += 1
    assert compared == len(rows) == len(tables.effects()) > 40


def test_terms_of_formulas_have_their_kind_unit_and_text():
    source = read_toml(ROOT / "src" / "tables" / "formula.toml")
    places, operations = tables.formula_places(), tables.formula_operations()
    assert {n: (p.kind, p.unit, p.text) for n, p in places.items()} == {
        n: ("PLACE", x["unit"], x["text"]) for n, x in source["place"].items()
    }
    found = {n: (o.kind, o.unit, o.text) for n, o in operations.items()}
    assert found == {n: (x["kind"], x["unit"], x["text"]) for n, x in source["operation"].items()}


def test_a_setting_is_looked_for_in_the_simulator_first_if_it_is_meant():
    tables.check_setting("mass", 1650.0)
    tables.check_setting("noise", 2.0, simulator=True)
    tables.check_setting("mass", 1650.0, simulator=True)
    for name, value, simulator in (("noise", 2.0, False), ("noise", 200.0, True), ("mass", 1.0, True)):
        with pytest.raises(tse.SettingError, match=r"^option --x: "):
            tables.check_setting(name, value, source="option --x", simulator=simulator)
    built = tables.build()
    assert (built.version, built.format, built.capacity) == (
        library().version,
        library().format,
        library().capacity,
    )


def test_names_are_imported_at_their_first_use_and_unknown_ones_are_refused():
    assert set(dir(tse)) == set(tse.__all__) and tse.errors is errors
    for module in (tse, errors):
        with pytest.raises(AttributeError, match=f"module '{module.__name__}' has no attribute 'nothing'"):
            module.nothing  # noqa: B018
    error = errors.InputError("too large", "accel_y")
    assert (error.field, str(error)) == ("accel_y", "too large")
    assert isinstance(error, tse.Error) and isinstance(error, ValueError)
    for name in tse.__all__:
        assert getattr(tse, name) is not None


def test_a_missing_package_is_named_but_a_missing_part_of_tse_is_not(monkeypatch):
    for name, text in (
        ("pandas", r"tse.estimate needs the package pandas: pip install 'tse\[lab\]'"),
        ("tse.x", "^tse.x$"),
    ):

        def fail(module, name=name):
            raise ModuleNotFoundError(name, name=name)

        monkeypatch.delitem(vars(tse), "estimate", raising=False)
        monkeypatch.setattr(tse.importlib, "import_module", fail)
        with pytest.raises(ModuleNotFoundError, match=text) as error:
            tse.estimate  # noqa: B018
        assert error.value.name == name


def test_a_formula_is_written_as_a_header(tmp_path, monkeypatch):
    from tse.api import formula as _formula

    read = replace(monkeypatch, _formula, "_read", "formula")
    monkeypatch.setattr(_formula, "format_c_header", lambda formula: f"header of {formula}")
    found = tse.read_formula(str(tmp_path / "f.toml"))
    assert read == [((tmp_path / "f.toml",), {})]
    assert tse.write_c_formula(found, tmp_path / "f.h").read_text() == "header of formula"
