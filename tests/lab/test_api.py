"""The Python API has the numbers of the command and of the C library.

Its refusals name the error. The examples of scripts/examples run and do what they claim.
"""

import copy
import inspect
import math
import os
import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from small_car import ROW

import tse
from conftest import tselab
from tse.estimation.estimate import list_est_columns
from tse.library.core import INPUT, NOMINAL, OUTPUT, STATUS, Config, library
from tselab.montecarlo.studies import make_study

ROOT = Path(__file__).resolve().parents[2]
REPLAY = ROOT / "tests" / "replay"
CAR = {"mass": 1650, "lf": 1.2, "lr": 1.5, "wheel_radius_front": 0.32, "wheel_radius_rear": 0.32}


@pytest.fixture(scope="module")
def frame(drive):
    return pd.read_csv(drive.log)


@pytest.fixture(scope="module")
def result(drive, frame):
    return tse.estimate(frame, drive.vehicle)


def has_same_bits(a, b):
    return np.array_equal(np.asarray(a, float), np.asarray(b, float), equal_nan=True)


def test_what_is_usable_is_what_the_command_says(drive, result, tmp_path):
    done = tselab(
        "estimate",
        "--verbose",
        drive.log,
        "--vehicle",
        drive.vehicle,
        "--out",
        tmp_path / "e.csv",
        "--table",
        tmp_path / "t.parquet",
    )
    assert {0: "yes", 3: "in part", 4: "no"}[done.code] == result.usable
    theirs = pd.read_parquet(tmp_path / "t.parquet").drop(columns="log")
    pd.testing.assert_frame_equal(result.stretches, theirs, check_exact=True)


def test_a_frame_that_contradicts_itself_warns_and_leaves_nothing_usable(drive, frame):
    with pytest.warns(UserWarning, match="yaw_rate is positive to the right"):
        wrong = tse.estimate(frame.assign(yaw_rate=-frame["yaw_rate"]), drive.vehicle)
    assert wrong.usable == "no" and wrong.learnt is None and wrong.stretches["value"].isna().all()
    assert len(wrong.warnings) == 1 and not set(wrong.warnings) & set(wrong.notes)
    assert all("contradict" in line for line in wrong.words)


def make_row(table, i):
    return {name: table[name][i] for name in table.columns}


# ---- a whole log


def test_a_frame_gives_what_the_command_writes(drive, result, tmp_path):
    done = tselab(
        "estimate", "--verbose", drive.log, "--vehicle", drive.vehicle, "--out", tmp_path / "command.csv"
    )
    assert done.code == 0, done.err
    result.to_csv(tmp_path / "api.csv")
    assert (tmp_path / "api.csv").read_bytes() == (tmp_path / "command.csv").read_bytes()
    assert list(result.table) == list_est_columns() and len(result) == 2001
    for line in result.words:
        assert line in done.out


def test_arrays_and_structured_arrays_are_as_good_as_a_frame(drive, frame, result):
    arrays = {name: frame[name].to_numpy() for name in ("time", *tse.CHANNELS)}
    for log in (arrays, frame[list(arrays)].to_records(index=False)):
        other = tse.estimate(log, drive.vehicle)
        pd.testing.assert_frame_equal(other.table, result.table, check_exact=True)


def test_settings_and_average_reach_the_filter_as_options_of_the_command_do(drive, frame, tmp_path):
    done = tselab(
        "estimate",
        drive.log,
        "--vehicle",
        drive.vehicle,
        "--average",
        0.04,
        "--set",
        "initial_cy_front=0.8",
        "--out",
        tmp_path / "command.csv",
    )
    assert done.code == 0, done.err
    tse.estimate(frame, drive.vehicle, average=0.04, settings={"initial_cy_front": 0.8}).to_csv(
        tmp_path / "api.csv"
    )
    assert (tmp_path / "api.csv").read_bytes() == (tmp_path / "command.csv").read_bytes()


def test_a_mapping_is_a_vehicle_file(drive, frame, tmp_path):
    text = (
        "\n".join(f"{k} = {v}" for k, v in CAR.items())
        + "\n[latency]\nsteer_angle = 0.02\n[sensors]\naccel_y_sd = 0.2\n"
    )
    (tmp_path / "car.toml").write_text(text)
    mapping = {
        **CAR,
        "mass": np.int64(1650),
        "latency": {"steer_angle": np.float32(0.02)},
        "sensors": {"accel_y_sd": 0.2},
    }
    before = copy.deepcopy(mapping)
    first = tse.estimate(
        frame.head(300), mapping, settings={"steer_angle_latency": 0.02}
    )  # a float32 is not quite 0.02
    second = tse.estimate(frame.head(300), tmp_path / "car.toml")
    pd.testing.assert_frame_equal(first.table, second.table, check_exact=True)
    assert mapping == before and first.settings == second.settings


def test_one_vehicle_serves_several_logs(frame, result):
    car = tse.read_vehicle(CAR)
    before = copy.deepcopy(car)
    tse.estimate(frame.head(300), car)
    assert car == before  # what the log says of the sensors is the log's


def test_shapes_kinds_and_the_meaning_of_valid(result):
    n = len(result)
    for array in (result.stiffness, result.stiffness_sd, result.stiffness_secant, result.stiffness_spread):
        assert array.shape == (n, 3) and array.dtype == np.float64
    assert result.valid.shape == result.reason.shape == (n, 3) and result.valid.dtype == bool
    assert result.time.shape == result.status.shape == (n,)
    assert (
        ((result.reason == "valid") == result.valid).all()
        and result.valid[-1].all()
        and not result.valid[0].any()
    )
    assert result.table["cy_front_valid"].dtype == bool
    for i, s in enumerate(tse.STIFFNESS):
        assert result.stiffness[-1, i] == pytest.approx(result.settings[NOMINAL[s]], rel=0.15)


def test_the_next_drive_starts_from_what_was_learnt(drive, frame, result):
    assert len(result.learnt) == library().learnt_bytes
    known = tse.estimate(frame.head(50), drive.vehicle, learnt=result.learnt, age=3600.0)
    fresh = tse.estimate(frame.head(50), drive.vehicle)
    assert known.stiffness_sd[0, 1] < 0.5 * fresh.stiffness_sd[0, 1]
    unknown = tse.estimate(frame.head(50), drive.vehicle, learnt=result.learnt)
    assert unknown.stiffness_sd[0, 1] > known.stiffness_sd[0, 1]
    with pytest.raises(tse.Error, match="damaged"):
        tse.estimate(frame.head(50), drive.vehicle, learnt=b"x" * 112)
    with pytest.raises(tse.Error, match="age is NaN; allowed: 0 s or more"):
        tse.estimate(frame.head(50), drive.vehicle, learnt=result.learnt, age=math.nan)


@pytest.mark.parametrize(
    ("change", "texts"),
    [
        (
            lambda f: f.drop(columns="steer_angle"),
            ["log: column steer_angle is missing", "needed: time, steer_angle"],
        ),
        (lambda f: f.drop(columns=["wheel_speed_rear", "wheel_speed_front"]), ["left and right wheel"]),
        (lambda f: f.assign(yaw_rate="x"), ["column yaw_rate is not numeric", "-6 .. 6 rad/s"]),
        (
            lambda f: f.assign(steer_angle=f["steer_angle"].where(f.index % 5 != 2, 2.5)),
            ["row 2, column steer_angle: 2.5 is outside the allowed range -1.2 .. 1.2 rad", "pi/180"],
        ),
        (
            lambda f: f.assign(time=f["time"].to_numpy()[::-1]),
            ["row 1, column time: ", "is earlier than row 0"],
        ),
        (lambda f: f.iloc[:0], ["has no rows"]),
        (
            lambda f: f.assign(accel_y=np.nan, yaw_rate=np.nan),
            ["accel_y and yaw_rate are missing: the tyres cannot be estimated without one of them"],
        ),
        (lambda f: pd.concat([f, f[["accel_x"]]], axis=1), ["column accel_x appears more than once"]),
        (
            lambda f: {**{c: f[c] for c in f}, "yaw_rate": f["yaw_rate"].to_numpy()[:5]},
            ["column yaw_rate has shape (5,)"],
        ),
    ],
)
def test_a_log_that_cannot_be_used_is_refused_by_column_row_and_range(drive, frame, change, texts):
    with pytest.raises(tse.Error) as error:
        tse.estimate(change(frame), drive.vehicle)
    for text in texts:
        assert text in str(error.value)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            lambda f: f.drop(columns="accel_y"),
            "accel_y is not in the log: quantities that only accel_y shows are not estimated",
        ),
        (lambda f: f.drop(columns="wheel_speed_rear"), "wheel_speed_front stands in for it"),
        (
            lambda f: f.assign(steer_angle=f["steer_angle"].where(f.index != 7, 2.5)),
            "steer_angle: 1 values outside -1.2 .. 1.2 rad are treated as missing (first in row 7)",
        ),
        (lambda f: f.assign(time=f["time"].where(f.index != 9, 0.0)), "time: "),
        (
            lambda f: f.assign(accel_y=0.33 * f["wheel_speed_rear"] * f["yaw_rate"]),
            "accel_y equals speed times yaw_rate",
        ),
        (
            lambda f: f.assign(yaw_rate=f["yaw_rate"].where(f.index % 100 > 4, -3.2767)),
            "yaw_rate is -3.2767 in 25 rows",
        ),
        (
            lambda f: {**f, "yaw_rate": np.ma.masked_array(f["yaw_rate"].to_numpy(), f.index % 10 == 0)},
            "yaw_rate: 50 of 500 cells",
        ),
    ],
)
def test_what_a_log_lacks_is_missing_and_said(drive, frame, change, text):
    result = tse.estimate(change(frame.head(500)), drive.vehicle)
    assert any(text in note for note in result.notes), result.notes
    assert np.isfinite(result.stiffness).all()


@pytest.mark.parametrize(
    ("vehicle", "text"),
    [
        ({**CAR, "mass": 5.0}, r"vehicle: key mass: mass = 5 is outside its range 50 .. 50000 kg"),
        (
            {k: v for k, v in CAR.items() if k != "lf"},
            r"vehicle: key lf is missing \(allowed: lf: 0.1 .. 10 m\)",
        ),
        ({**CAR, "masss": 1.0}, "key masss is not known .*mass"),
        ({**CAR, "latency": {"accel_y": 3.0}}, "key latency.accel_y: .* -0.2 .. 0.2 s"),
        ("nowhere.toml", "nowhere.toml: no such file"),
    ],
)
def test_a_vehicle_that_cannot_be_is_refused_by_key_and_range(frame, vehicle, text):
    with pytest.raises(tse.Error, match=text):
        tse.estimate(frame, vehicle)
    with pytest.raises(tse.Error, match=text):
        tse.Filter(vehicle)


# ---- row by row


@pytest.mark.parametrize(
    ("call", "error", "said"),
    [
        (lambda _: tse.calibrate([], CAR), tse.Error, "no log is given"),
        (lambda f: tse.estimate(f, CAR, settings=[1]), TypeError, "settings: list is not a mapping"),
        (lambda f: tse.replay(f, CAR, settings=0.1), TypeError, "settings: float is not a mapping"),
        (lambda f: tse.estimate(f, None), TypeError, "vehicle: NoneType cannot be a vehicle"),
        (
            lambda f: tse.estimate(f, CAR, learnt="car.tse"),
            TypeError,
            "learnt: bytes are needed, .*, not str",
        ),
        (lambda f: tse.estimate(f.astype(complex), CAR), tse.Error, "column time is not numeric"),
        (
            lambda f: tse.estimate(f.assign(yaw_rate=f["yaw_rate"] > 0), CAR),
            tse.Error,
            "column yaw_rate is not numeric",
        ),
        (
            lambda f: tse.estimate({**f, "yaw_rate": f["yaw_rate"][::-1]}, CAR),
            tse.Error,
            "Series with different indices",
        ),
        (lambda _: tse.simulate(duration=-1), tse.Error, "duration: -1 is outside its range"),
    ],
)
def test_what_is_no_log_car_or_setting_is_named(frame, call, error, said):
    with pytest.raises(error, match=said):
        call(frame)


def test_row_by_row_gives_the_bits_of_the_whole(frame, result):
    f = result.filter()
    for i in range(600):
        e = f.step(make_row(frame, i)).as_dict()
        row = result.table.iloc[i]
        for name, value in e.items():
            if name == "fault_channel":
                code = int(row[name])
                assert value == (tse.CHANNELS[code - 1] if code else None)
            elif isinstance(value, str):
                assert value == row[name]
            else:
                assert has_same_bits(value, row[name]), name
    assert set(e) == set(result.table)


def test_row_by_row_gives_the_golden_drive():
    drive = pd.read_csv(REPLAY / "drive.csv", comment="#")
    golden = pd.read_csv(REPLAY / "golden_double.csv", comment="#", index_col="row")
    f = tse.Filter({**tse.simulated_car(), "driven_axle": "both"})
    nominal = {s: float(f.settings[NOMINAL[s]]) for s in tse.STIFFNESS}
    compared = 0
    for i, row in enumerate(drive.to_dict("records")):
        e = f.step(row)
        if i not in golden.index:
            continue
        for name, want in golden.loc[i].items():
            key = next(
                (s for s in tse.STIFFNESS if name in (s, f"{s}_sd", f"{s}_secant", f"{s}_spread")), None
            )
            if name.endswith("_valid"):
                assert getattr(e, name) == (want == 0)
            elif name == "fault_channel":
                assert e.fault_channel == (tse.CHANNELS[int(want) - 1] if want else None)
            else:
                assert getattr(e, name) == pytest.approx(
                    want * nominal.get(key, 1.0), rel=2e-11, abs=1e-300
                ), (i, name)
            compared += 1
    assert compared > 5000


def test_dt_and_time_are_the_same_clock(frame):
    by_dt, by_time = tse.Filter(CAR), tse.Filter(CAR)
    for i in range(200):
        row = {c: frame[c][i] for c in tse.CHANNELS}
        a = by_dt.step(row, dt=frame["time"][i] - frame["time"][i - 1]) if i else by_dt.step(row)
        b = by_time.step(row, time=frame["time"][i])
        assert a.cy_front == b.cy_front and a.log_evidence == b.log_evidence
    assert b.time == frame["time"][199] and a.time == pytest.approx(b.time - frame["time"][0])


def test_what_is_missing_may_be_left_out_none_or_nan():
    estimates = []
    for missing in ({}, {"accel_y": None}, {"accel_y": math.nan}):
        f = tse.Filter(CAR)
        f.step(ROW)
        estimates.append(f.step({k: v for k, v in ROW.items() if k != "accel_y"} | {"dt": 0.01} | missing))
    assert estimates[0] == estimates[1] == estimates[2]
    assert estimates[0].status in (tse.Status.STARTING, tse.Status.MISSING_CHANNEL)  # the larger of both
    assert estimates[0].status_text == library().codes(STATUS)[int(estimates[0].status)].text


@pytest.mark.parametrize(
    ("change", "field", "text"),
    [
        ({"steer_angle": 3.0}, "steer_angle", "steer_angle = 3 is outside its range -1.2 .. 1.2 rad"),
        ({"wheel_speed_front": math.inf}, "wheel_speed_front", "-400 .. 400 rad/s"),
        ({"dt": 0.0}, "dt", "dt = 0 is outside its range"),
        ({"dt": -1.0}, "dt", "dt = -1 is outside its range"),
        ({"dt": 4000.0}, "dt", "dt = 4000 is outside its range"),
        ({"dt": None}, "dt", "not a number"),
        ({"time": 1.0}, "dt", "both time and dt are given"),
        ({"steer_angel": 0.1}, "steer_angel", "did you mean steer_angle"),
        ({"missing": 1}, "missing", "there is no channel"),
        ({"wheel_speed_rear_left": 60.0}, "wheel_speed_rear_left", "give wheel_speed_rear, the mean"),
        ({"accel_x": "fast"}, "accel_x", "accel_x = 'fast' is not a number"),
    ],
)
def test_a_row_that_is_refused_leaves_the_filter_as_it_was(change, field, text):
    f, other = tse.Filter(CAR), tse.Filter(CAR)
    for each in (f, other):
        each.step(ROW)
        each.step(ROW, dt=0.01)
    with pytest.raises(tse.InputError) as error:
        f.step({**ROW, "dt": 0.01, **change})
    assert error.value.field == field and text in str(error.value)
    assert f.step(ROW, dt=0.01) == other.step(ROW, dt=0.01)


def test_a_second_row_needs_a_time():
    f = tse.Filter(CAR)
    f.step(ROW)
    with pytest.raises(tse.InputError, match="dt is missing"):
        f.step(ROW)
    stream = tse.Filter(CAR)
    with pytest.raises(tse.InputError, match="time = nan is not a finite number"):
        stream.step(ROW, time=float("nan"))
    stream.step(ROW, time=1.0)  # as if the other had not been


def test_a_measurement_out_of_range_is_missing_and_said_so():
    f, other = tse.Filter(CAR), tse.Filter(CAR)
    f.step(ROW), other.step(ROW)
    assert f.step({**ROW, "accel_y": 99.0}, dt=0.01) == other.step({**ROW, "accel_y": None}, dt=0.01)


def test_a_channel_that_is_late_is_waited_for(frame):
    f = tse.Filter({**CAR, "latency": {"accel_y": 0.03}})
    assert f.latencies == {
        "steer_angle": 0.0,
        "wheel_speed_front": 0.0,
        "wheel_speed_rear": 0.0,
        "accel_x": 0.0,
        "accel_y": 0.03,
    }
    seen = [f.step(make_row(frame, i)) for i in range(100)]
    assert seen[0].status == tse.Status.WAITING
    assert 0.029 < seen[-1].estimate_age < 0.051 and seen[-1].status != tse.Status.WAITING


def test_what_a_stream_has_learnt_is_what_the_log_has(frame, result):
    f = result.filter()
    assert f.save_learnt() is None
    for i in range(len(frame)):
        f.step(make_row(frame, i))
    assert f.save_learnt() == result.learnt
    for name, sd in f.uncertainty_sd().items():
        assert np.array_equal(sd, result.uncertainty_sd[name])
    new = result.filter()
    new.load_learnt(result.learnt, age=60.0)
    assert (
        new.step(make_row(frame, 0)).cy_front_sd < 0.5 * result.filter().step(make_row(frame, 0)).cy_front_sd
    )
    with pytest.raises(tse.LearntError):
        new.load_learnt(result.learnt)  # after the first row
    with pytest.raises(tse.LearntError, match="another vehicle"):
        tse.Filter(CAR).load_learnt(result.learnt)


def test_a_filter_that_is_told_no_mass_finds_nothing_valid_and_one_that_is_told_one_is_of_an_ordinary_car():
    nothing, mass, car = tse.Filter(), tse.Filter(settings={**CAR, "driven_axle": 1}), tse.Filter(CAR)
    reasons = set()
    for row in tse.simulate("double-lane-change", duration=40).log.to_dict("records"):
        said = {str(k): v for k, v in row.items()}
        reasons.add(nothing.step(said).cy_front_reason)
        told, same = mass.step(said), car.step(said)
    assert reasons >= {"parameters uncertain"} and "valid" not in reasons
    assert told == same and told.cy_front > 0
    assert nothing.settings["mass_sd"] == 0.3


def test_the_simulated_car_is_that_of_the_command(tmp_path):
    (tmp_path / "car.toml").write_text(tselab("vehicle", "--simulated").out)
    file, here = tse.Filter(tmp_path / "car.toml"), tse.Filter(tse.simulated_car())
    assert file.settings == here.settings and here.settings["model_sd"] == 0 and here.settings["mass"] == 1900
    with pytest.raises(
        tse.Error, match=r"mass = 0 is outside its range 50 .. 50000 kg; if it is unknown, leave it out"
    ):
        tse.read_vehicle({**tse.simulated_car(), "mass": 0})


def test_settings_of_a_filter_are_checked_and_win():
    assert tse.Filter(CAR, settings={"mass": 1700.0}).settings["mass"] == 1700.0
    assert tse.Filter(CAR, sample_time=0.04).settings["max_gap"] >= 0.2
    assert tse.Filter(form="paper").settings["form"] == Config.exact(Config.settings_of("paper")).form
    with pytest.raises(
        tse.SettingError, match=r"mass = 1 is outside its range 50 .. 50000 kg \(mass of the car; 0"
    ):
        tse.Filter(CAR, settings={"mass": 1})
    with pytest.raises(tse.SettingError, match="did you mean mass"):
        tse.Filter(CAR, settings={"mas": 1})


# ---- names


def test_the_typed_names_are_those_of_the_tables():
    subprocess.run([sys.executable, ROOT / "scripts" / "dev" / "api_tables.py", "--check"], check=True)
    names = [f.name for f in fields(tse.Estimate)]
    assert {f.name for f in library().fields(OUTPUT)} <= set(names)
    assert set(tse.Row.__annotations__) == {f.name for f in library().fields(INPUT)} - {
        "missing",
        "given",
    } | {"time"}


def test_an_import_of_the_api_leaves_the_threads_of_others_alone():
    code = (
        "import os; os.environ.pop('OPENBLAS_NUM_THREADS', None); "
        "import tse; print(os.environ.get('OPENBLAS_NUM_THREADS'))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "None\n"


def test_every_public_name_says_what_it_is():
    for name in tse.__all__:
        thing = getattr(tse, name)
        if isinstance(thing, type) and thing.__module__.startswith("tse."):
            assert thing.__doc__, name
            public = [
                m
                for n, m in vars(thing).items()
                if not n.startswith("_") and (callable(m) or isinstance(m, property))
            ]
            assert all(m.__doc__ for m in public), name
    for name in (n for n in tse.__all__ if inspect.isfunction(getattr(tse, n)) or n == "Filter"):
        thing = getattr(tse, name)
        text = inspect.getdoc(thing)
        takes = inspect.signature(thing).parameters
        for section in [*(["Parameters"] if takes else []), *(["Returns"] if name != "Filter" else [])]:
            assert f"\n{section}\n{'-' * len(section)}\n" in text, f"{name}: {section}"
        said = re.findall(r"^\*{0,2}([\w, ]+)$", text.partition("Parameters\n----------\n")[2], re.M)
        assert set(takes) <= {p for line in said for p in line.split(", ")}, name
    for array in ("stiffness", "valid", "reason", "time", "status"):
        assert re.match(r"\(n(, 3)?,?\)", getattr(tse.Result, array).__doc__), array


def test_simulated_logs_are_the_commands(tmp_path):
    done = tselab(
        "simulate", "--maneuver", "sine-sweep", "--duration", 5, "--seed", 4, "--out", tmp_path / "log.csv"
    )
    assert done.code == 0, done.err
    log = tse.simulate("sine-sweep", duration=5, seed=4).log
    want = pd.read_csv(tmp_path / "log.csv", dtype=str).astype(float)  # to the last bit, also by pandas 2
    pd.testing.assert_frame_equal(log, want, check_exact=True)


def test_speed_and_seed_among_the_settings_of_a_simulation_are_the_manoeuvres():
    found = tse.simulate("double-lane-change", duration=1, settings={"speed": 25.0, "seed": 3})
    assert found.truth["true_vel_x"].iloc[0] == pytest.approx(25.0, abs=0.2)
    pd.testing.assert_frame_equal(
        found.log, tse.simulate("double-lane-change", duration=1, speed=25.0, seed=3).log
    )


def test_a_filter_for_rows_needs_numpy_alone(drive):
    """As in a place where nothing else is installed."""
    code = f"""
import sys
class Others:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in {{"numpy", "tse", "tselab", *sys.stdlib_module_names}}:
            raise ModuleNotFoundError(name, name=name)
sys.meta_path.insert(0, Others())
import tse
car = tse.read_vehicle({str(drive.vehicle)!r})
wheels = {{"wheel_speed_front": 60.0, "wheel_speed_rear": 60.0}}
e = tse.Filter(car).step(steer_angle=0.0, **wheels, accel_x=0.0, accel_y=0.0, yaw_rate=0.0)
print(e.vel_x)
try:
    tse.estimate
except ModuleNotFoundError as error:
    print(error)
from tselab.__main__ import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    speed, said = done.stdout.splitlines()
    assert float(speed) == pytest.approx(60.0 * 0.33, rel=0.01)
    assert said == "tse.estimate needs the package pandas: pip install 'tse[lab]'"
    assert (
        done.returncode == 2
        and done.stderr == "tselab: the Python package click is needed: pip install 'tse[lab]'\n"
    )


@pytest.mark.parametrize(
    ("used", "heavy"),
    [
        ("pass", "'scipy.signal', 'scipy.stats', 'plotly', 'matplotlib', 'fmpy'"),
        (
            "tse.estimate({log!r}, {vehicle!r})",
            "'scipy', 'plotly', 'matplotlib', 'fmpy'",
        ),  # scipy: 80 MB, a second
    ],
)
def test_nothing_is_loaded_that_only_other_parts_need(used, heavy, drive):
    used = used.format(log=str(drive.log), vehicle=str(drive.vehicle))
    code = f"import sys, tse; {used}; print(sorted(m for m in ({heavy}) if m in sys.modules))"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        == "[]\n"
    )


EXAMPLES = ROOT / "scripts" / "examples"


def run_example(name, *arguments):
    done = subprocess.run(
        [sys.executable, EXAMPLES / name, *map(str, arguments)], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_stream_is_followed():
    out = run_example("stream.py")
    assert "row refused: steer_angle = 7 is outside its range -1.2 .. 1.2 rad" in out
    assert "late channels [s]: {'steer_angle': 0.02}" in out and "refers to 0.020 s earlier" in out
    (now, within), (first, _) = (
        (float(x), float(by)) for x, by in re.findall(r"cy_front (\d+) \+- (\d+)", out)
    )
    assert abs(first - now) < within  # it was not valid: the next drive starts from the prior again


def test_a_filter_of_ones_own_runs_in_a_study_beside_tse(tmp_path):
    command = [sys.executable, "-m", "tselab", "montecarlo", "--study", "stress+own_filter.random_walk",
               "--cases", "nominal", "--runs", "2", "--jobs", "1",
               "--out", str(tmp_path / "out")]  # fmt: skip
    path = os.pathsep.join(filter(None, [str(EXAMPLES), os.environ.get("PYTHONPATH", "")]))
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=300, env={**os.environ, "PYTHONPATH": path}
    )
    assert done.returncode == 0, done.stderr
    runs = pd.read_csv(tmp_path / "out" / "runs.csv").set_index(["estimator", "seed"])
    assert set(runs.index.get_level_values(0)) == {"tse", "own_filter.random_walk"}
    errors = (
        runs["cy_front_rms"]
        if "cy_front_rms" in runs
        else runs[[c for c in runs if c.startswith("cy_front")]].iloc[:, 0]
    )
    assert errors.notna().all()
    assert "own_filter.random_walk" in done.stdout


@pytest.mark.parametrize(
    ("name", "text"),
    [
        (
            "nowhere.kalman",
            "no estimator 'nowhere.kalman': No module named 'nowhere'; "
            "check that the folder of nowhere.py is in PYTHONPATH",
        ),
        ("tse.Nothing", "has no attribute 'Nothing'"),
        ("tse.STIFFNESS", "is not a function"),
    ],
)
def test_an_estimator_that_is_not_there_is_refused(name, text):
    with pytest.raises(tse.Error) as error:
        make_study(f"stress+{name}")
    assert text in str(error.value)


def test_the_settings_of_a_filter_are_to_read():
    """One that is put there would be without effect."""
    f = tse.Filter(CAR)
    with pytest.raises(TypeError):
        f.settings["mass"] = 3000.0
    assert tse.Filter(settings={**f.settings, "mass": 1800.0}).settings["mass"] == 1800.0
