"""The Python API has the command's results: numbers, words, table, picture, page."""

import ast
import copy
import json
import pickle
from pathlib import Path

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest
from test_api import CAR as SMALL

import tse
from conftest import tselab_here
from tse.channels.signals import read_signals
from tse.gaps.run import workflow
from tse.readers.recording import ReadOptions
from tse.report.report import read_figures

ROOT = Path(__file__).resolve().parents[2]
CAR = {
    "mass": 1900,
    "lf": 1.25,
    "lr": 1.5,
    "yaw_inertia": 3000,
    "wheel_radius_front": 0.33,
    "wheel_radius_rear": 0.33,
}
TOML = "\n".join(f"{key} = {value}" for key, value in CAR.items()) + "\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A drive of a minute, log.csv and car.toml."""
    place = tmp_path_factory.mktemp("api")
    tse.simulate("double-lane-change", duration=60, seed=2).log.to_csv(place / "log.csv", index=False)
    (place / "car.toml").write_text(TOML)
    return place


def show_result(result, path):
    """Use every output of a result; return the page that it wrote."""
    assert result.words and all(isinstance(line, str) for line in result.words)
    assert isinstance(result.to_frame(), pd.DataFrame)
    assert isinstance(result.plot(), go.Figure)
    text = result._repr_html_()
    assert "<table" in text and "<ul>" in text
    assert result.report(path) == path
    page = path.read_text(encoding="utf-8")
    assert page.lower().startswith("<!doctype html>") and "src=" not in page.split("<body")[1][:2000]
    return page


def test_a_log_is_read_shown_and_estimated_like_its_frame(folder, tmp_path):
    log = tse.read_log(folder / "log.csv", CAR)
    assert len(log) == len(log.time) == 6001 and log.sample_time == pytest.approx(0.01)
    show_result(log, tmp_path / "log.html")
    frame = log.to_frame()
    assert np.array_equal(frame["yaw_rate"], pd.read_csv(folder / "log.csv")["yaw_rate"])
    tables = [
        tse.estimate(given, CAR).table for given in (log, frame, folder / "log.csv", str(folder / "log.csv"))
    ]
    for table in tables[1:]:
        pd.testing.assert_frame_equal(table, tables[0], check_exact=True)


def test_a_wheel_speed_that_stands_in_is_by_the_radii_of_the_car_whatever_holds_the_log(folder, tmp_path):
    """The front wheels are a tenth smaller, and turn as much faster."""
    car, frame = (
        CAR | {"wheel_radius_front": 0.3},
        pd.read_csv(folder / "log.csv").drop(columns="wheel_speed_rear"),
    )
    frame.to_csv(tmp_path / "log.csv", index=False)
    of_none = tse.read_log(tmp_path / "log.csv")
    tables = [
        tse.estimate(given, car, calibrate=False).table for given in (tmp_path / "log.csv", frame, of_none)
    ]
    for table in tables[1:]:
        pd.testing.assert_frame_equal(table, tables[0], check_exact=True)
    assert tables[0]["vel_x"].iloc[-1] == pytest.approx(0.3 * frame["wheel_speed_front"].iloc[-1], rel=0.02)


def test_an_estimate_draws_and_writes_the_page_of_the_command(folder, tmp_path):
    done = tselab_here("estimate", "log.csv", "--vehicle", "car.toml", "--out", tmp_path / "est.csv",
                       "--report", tmp_path / "command.html", cwd=folder)  # fmt: skip
    assert done.code in (0, 3, 4), done.err
    result = tse.estimate(folder / "log.csv", folder / "car.toml")
    assert result.to_frame() is result.table and len(result.log) == len(result)
    page = show_result(result, tmp_path / "api.html")
    command = (tmp_path / "command.html").read_text(encoding="utf-8")
    for mine, theirs in zip(read_figures(page), read_figures(command), strict=True):
        assert [t.get("name") for t in mine["data"]] == [t.get("name") for t in theirs["data"]]
    result.to_csv(tmp_path / "api.csv")
    assert (tmp_path / "api.csv").read_bytes() == (tmp_path / "est.csv").read_bytes()
    with pytest.raises(ValueError, match="not made by estimate"):
        tse.Result(result.table, result.settings).plot()


def test_signals_are_proposed_and_read_back(folder, tmp_path):
    frame = pd.read_csv(folder / "log.csv")
    turned = frame.assign(yaw_rate=np.degrees(frame["yaw_rate"])).rename(
        columns={"yaw_rate": "YawRate_degps"}
    )
    turned.to_csv(tmp_path / "odd.csv", index=False)
    found = tse.signals(tmp_path / "odd.csv", CAR)
    show_result(found, tmp_path / "signals.html")
    used = found.to_frame().set_index("name")["used"]
    assert used["YawRate_degps"] == "yaw_rate" and not found.missing
    done = tselab_here("signals", "odd.csv", "--vehicle", folder / "car.toml", "--json", cwd=tmp_path)
    assert json.loads(done.out)["proposal"].keys() == {c for c in used if c}
    log = tse.read_log(tmp_path / "odd.csv", CAR, signals=found.write(tmp_path / "signals.toml"))
    assert np.allclose(log.to_frame()["yaw_rate"], frame["yaw_rate"], atol=1e-9)
    (tmp_path / "none.csv").write_text("time,a\n0,1\n0.01,2\n0.02,1\n")
    with pytest.raises(tse.Error, match="no signal could be proposed"):
        tse.signals(tmp_path / "none.csv").write(tmp_path / "none.toml")


def test_a_log_is_proposed_as_the_file_beside_it_says_and_what_is_written_says_it_too(folder, tmp_path):
    pd.read_csv(folder / "log.csv").drop(columns="time").to_csv(tmp_path / "log.csv", index=False, sep=";")
    (tmp_path / "signals.toml").write_text(
        '[log]\nstep = 0.01\nseparator = ";"\n[signals.steer_angle]\nname = "steer_angle"\n'
    )
    made = tse.signals(tmp_path / "log.csv", CAR, databases=[tmp_path / "car.dbc"]).write(
        tmp_path / "api.toml"
    )
    done = tselab_here(
        "signals",
        "log.csv",
        "--vehicle",
        folder / "car.toml",
        "--database",
        "car.dbc",
        "--write",
        "command.toml",
        cwd=tmp_path,
    )
    assert done.code == 0, done.err
    wanted = ReadOptions((tmp_path / "car.dbc",), step=0.01, separator=";")
    assert read_signals(made).how == read_signals(tmp_path / "command.toml").how == wanted
    assert len(tse.read_log(tmp_path / "log.csv", CAR, signals=made)) == len(pd.read_csv(folder / "log.csv"))


def test_a_replay_is_the_car_without_noise(folder, tmp_path):
    """A replay without noise and spread is the log.

    They differ only by the simulator's wheels between rows.
    """
    quiet = dict.fromkeys(("noise", "spread_cx_front", "spread_cy_front", "spread_cy_rear"), 0.0)
    log = tse.simulate("double-lane-change", CAR, duration=20, settings=quiet).log
    for settings, off in ((None, 0.03), ({"cornering_stiffness_front": 60e3}, None)):
        result = tse.replay(log, CAR, settings=settings)
        table = result.to_frame()
        rms = (table["accel_y"] - table["accel_y_simulated"]).std() / table["accel_y"].std()
        assert rms < off if off else rms > 0.1
    page = show_result(result, tmp_path / "replay.html")
    assert "measured minus simulated" in page
    late = log.assign(accel_y=log["accel_y"].shift(5, fill_value=0.0))
    apart = [tse.replay(x, CAR, settings=s).apart()["accel_y"].rms
             for x, s in ((log, None), (late, {"accel_y_latency": 0.05}), (late, None))]  # fmt: skip
    assert apart[1] == pytest.approx(apart[0], rel=0.05) and apart[2] > 3 * apart[0]
    holes = log.copy()
    holes.loc[100:103, "steer_angle"] = np.nan
    assert np.isfinite(tse.replay(holes, CAR).to_frame()["accel_y_simulated"]).all()
    with pytest.raises(tse.Error, match="rows are 2 s apart"):
        tse.replay(log.assign(time=log["time"] * 200), CAR)


@pytest.fixture(scope="module")
def calibrated(folder):
    return tse.calibrate(tse.read_log(folder / "log.csv", CAR), CAR)


def test_python_learns_nothing_from_channels_that_contradict_each_other(folder):
    """Contradicting channels are treated as by the command.

    Each frame is checked by itself and named by its number.
    """
    frame = pd.read_csv(folder / "log.csv")
    wrong = frame.assign(accel_y=frame["accel_y"] / 9.81)
    with pytest.raises(tse.Error, match=r"channels contradict each other: .*accel_y is in g"):
        tse.calibrate(wrong, CAR)
    found = tse.calibrate([wrong, frame[:2000], frame], CAR)
    assert any(n.startswith("left out: log 1: channels contradict") for n in found.notes)
    assert [log.name for log in found._result.problem.logs] == ["log 2", "log 3"]


def test_what_is_not_shown_stays_at_its_prior(calibrated):
    """The rear's longitudinal stiffness follows the front's, and its prior with it."""
    rows = calibrated.to_frame()
    kept = rows[~rows["shown"].astype(bool)].set_index("name")
    assert "longitudinal_stiffness_rear" in kept.index
    assert (abs(kept["value"] - kept["prior"]) < 1.5 * kept["prior_sd"]).all()


def test_gap_takes_logs_as_they_are_and_a_vehicle_as_its_file_has_it(folder, tmp_path, monkeypatch):
    """A slower channel keeps its entries: through a CSV they would be a row each."""

    class Stop(Exception):
        pass

    def run(logs, *_, **__):
        taken.extend(logs)
        raise Stop

    taken: list = []
    monkeypatch.setattr(workflow, "run_workflow", run)
    log = tse.read_log(folder / "log.csv", CAR)
    with pytest.raises(Stop):
        tse.gap(log, CAR, out=tmp_path)
    assert taken == [log._checked] and not list(tmp_path.glob("*.csv"))
    car = tse.read_vehicle(folder / "car.toml")
    car.values["mass"] = 2500.0
    with pytest.raises(tse.Error, match="mass of the vehicle differ from"):
        tse.gap(log, car, out=tmp_path)


def test_a_calibrated_car_is_the_commands(calibrated, folder, tmp_path):
    done = tselab_here(
        "calibrate",
        "--verbose",
        "log.csv",
        "--vehicle",
        "car.toml",
        "--out",
        tmp_path / "calibrated.toml",
        cwd=folder,
    )
    theirs, mine = tse.read_vehicle(tmp_path / "calibrated.toml"), calibrated.vehicle
    assert done.code == 0 and calibrated.converged
    assert (
        mine.values == pytest.approx(theirs.values, rel=1e-9)
        and mine.calibration.keys() == theirs.calibration.keys()
    )
    show_result(calibrated, tmp_path / "calibrated.html")
    assert calibrated.to_frame()["shown"].any() and calibrated.words[0] in done.out
    tse.read_vehicle(calibrated.write(tmp_path / "mine.toml"))
    narrow, wide = (tse.estimate(folder / "log.csv", car, calibrate=False) for car in (mine, CAR))
    assert (narrow.stiffness_sd[-1, 1:] < wide.stiffness_sd[-1, 1:]).all()


def test_a_fleet_of_one_process_is_the_commands(folder, tmp_path):
    done = tselab_here(
        "fleet",
        "log.csv",
        "--vehicle",
        "car.toml",
        "--out",
        tmp_path / "command",
        "--no-calibrate",
        cwd=folder,
    )
    assert done.code in (0, 3, 4), done.err
    result = tse.fleet(folder / "log.csv", CAR, out=tmp_path / "api", calibrate=False)
    show_result(result, tmp_path / "fleet.html")
    drop = ["report", "log", "car", "vehicle"]
    theirs = pd.read_parquet(tmp_path / "command" / "fleet.parquet").drop(columns=drop)
    pd.testing.assert_frame_equal(
        pd.read_parquet(tmp_path / "api" / "fleet.parquet").drop(columns=drop), theirs
    )
    (tmp_path / "bad.csv").write_text("time\n1\n")
    assert "bad.csv" in tse.fleet([tmp_path / "bad.csv"], CAR, out=tmp_path / "api").errors[0]
    with pytest.raises(ValueError, match="vehicles"):
        tse.fleet(folder / "log.csv", out=tmp_path / "x")


def run_notebook(name, folder, monkeypatch):
    """Run the cells, and return their variables; show the value of a cell's last line."""
    monkeypatch.chdir(folder)
    cells = json.loads((ROOT / "scripts" / "examples" / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]
    names: dict = {}
    for source in ("".join(c["source"]) for c in cells if c["cell_type"] == "code"):
        tree = ast.parse(source)
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, name, "exec"), names)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), name, "eval"), names)
            assert not hasattr(value, "_repr_html_") or value._repr_html_()
    assert not any(c.get("outputs") for c in cells)  # kept without: a picture of plotly has a megabyte
    return names


@pytest.mark.slow
def test_the_notebook_from_a_log_to_an_answer(tmp_path, monkeypatch):
    n = run_notebook("log_to_answer", tmp_path, monkeypatch)
    used = n["found"].to_frame().set_index("name")["used"]
    assert used["LenkradWinkel_deg"] == "steer_angle" and used["Gierrate_degs"] == "yaw_rate"
    assert np.allclose(n["log"].to_frame()["yaw_rate"], n["drive"]["yaw_rate"], atol=1e-9)
    better, truth = n["better"], [n["truth"][f"true_{s}"].iloc[-1] for s in tse.STIFFNESS]
    assert better.valid[-1, 1:].all() and (np.abs(n["error"][1:]) < 0.2).all()
    assert (np.abs(better.stiffness[-1] - truth) < 2 * 1.96 * better.stiffness_sd[-1]).all()
    assert (tmp_path / "report.html").exists()


def test_the_notebook_that_tunes_a_filter(tmp_path, monkeypatch):
    """What its text says of each setting."""
    table = run_notebook("tune_filter", tmp_path, monkeypatch)["table"]
    fits = table.loc["as it is"]
    assert table.loc["gyro late", "white yaw_rate"] > fits["white yaw_rate"] + 0.2
    assert abs(table.loc["gyro late", "error"]) > abs(fits["error"]) + 0.05
    light = table.loc["mass too small"]
    assert light["error"] < -0.1 and light["white yaw_rate"] <= fits["white yaw_rate"]  # nothing shows it
    assert light["nis"] == pytest.approx(fits["nis"], rel=0.05)
    assert table.loc["model_sd 0.005", "nis"] > fits["nis"] > table.loc["model_sd 0.2", "nis"]
    assert table.loc["model_sd 0.2", "interval"] > fits["interval"] > table.loc["model_sd 0.005", "interval"]
    wide = table.loc["valid_sd 0.2"]
    assert wide["valid"] >= fits["valid"] and wide["error"] == fits["error"]


@pytest.mark.slow
def test_the_notebook_of_a_missing_effect(tmp_path, monkeypatch):
    n = run_notebook("missing_effect", tmp_path, monkeypatch)
    gap = n["gap"]
    assert (
        gap.verdict == "named"
        and gap.exit_code in (10, 11)
        and set(gap.to_frame()["id"]) == {"steering_ratio"}
    )
    assert gap.vehicle.values["steering_ratio_change"] == pytest.approx(0.15, abs=0.04)
    show_result(gap, tmp_path / "page.html")
    rms = [
        (t["yaw_rate"] - t["yaw_rate_simulated"]).std()
        for t in (n[x].to_frame() for x in ("before", "after"))
    ]
    assert rms[1] < 0.6 * rms[0]


def test_a_setting_of_the_other_filter_is_refused(folder):
    for run in (
        lambda: tse.Filter(CAR, settings={"particles": 200}),
        lambda: tse.estimate(folder / "log.csv", CAR, settings={"particles": 200}, calibrate=False),
        lambda: tse.Filter(CAR, form="robust", settings={"noise_max": 2}),
    ):
        with pytest.raises(tse.SettingError, match="has no effect with this form of the filter"):
            run()
    tse.Filter(CAR, form="robust", settings={"particles": 200})
    tse.Filter(settings=tse.Filter(CAR).settings)


# ---- What else the Python API takes, and how it refuses the rest: no cryptic error,
# nothing wrong without a message.


@pytest.fixture(scope="module")
def frame():
    return tse.simulate("double-lane-change", duration=4).log[["time", *tse.CHANNELS]]


@pytest.fixture(scope="module")
def table(frame):
    return tse.estimate(frame, SMALL).table


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
    """Means equal those of times in seconds, within the resolution of a date in double.

    A date of 2024 resolves 2e-7 s of a step of 0.01 s.
    """
    found = tse.estimate(frame.assign(time=time(frame["time"])), SMALL).table
    assert np.allclose(np.diff(found["time"]), 0.01, atol=1e-6)
    assert np.allclose(found["cy_front"], table["cy_front"], rtol=2e-3)


def test_a_time_may_be_the_index(frame, table):
    index = frame.set_index("time")
    pd.testing.assert_frame_equal(tse.estimate(index, SMALL).table, table, check_exact=True)
    spans = frame.drop(columns="time").set_index(pd.to_timedelta(frame["time"], unit="s"))
    assert np.allclose(tse.estimate(spans, SMALL).table["cy_front"], table["cy_front"], rtol=2e-3)


def test_a_table_of_pyarrow_is_a_frame(frame, table):
    arrow = pytest.importorskip("pyarrow").Table.from_pandas(frame)
    pd.testing.assert_frame_equal(tse.estimate(arrow, SMALL).table, table, check_exact=True)


def test_times_in_place_of_a_measurement_are_refused(frame):
    with pytest.raises(tse.Error, match="column yaw_rate is not numeric"):
        tse.estimate(frame.assign(yaw_rate=pd.to_datetime(frame["time"], unit="s")), SMALL)
    with pytest.raises(tse.Error, match="column yaw_rate is not numeric"):
        tse.estimate({**{c: frame[c].to_list() for c in frame}, "yaw_rate": [10**400] * len(frame)}, SMALL)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (None, "NoneType cannot be a log; give a file, a data frame"),
        ([{"time": 0.0}], r"a list cannot be a log; .*pd.DataFrame\(\) makes"),
        (np.zeros((3, 7)), "has no field names"),
        (7, "int cannot be a log"),
    ],
)
def test_what_is_no_log_is_named(given, words):
    with pytest.raises(TypeError, match=words):
        tse.estimate(given, SMALL)


def test_a_form_that_is_not_there_is_refused_with_those_that_are(frame):
    for run in (
        lambda: tse.estimate(frame, SMALL, form="x"),
        lambda: tse.Filter(SMALL, form="x"),
        lambda: tse.Filter(form=None),
    ):
        with pytest.raises(tse.SettingError, match="allowed: default, robust, paper"):
            run()


@pytest.mark.parametrize("value", [0, -0.01, 1.5, 1e-4, "a", float("nan"), 10**400, [1]])
def test_a_sample_time_outside_its_range_is_refused(value):
    with pytest.raises(tse.SettingError, match=r"sample_time = .* is outside its range 0.001 .. 1 s"):
        tse.Filter(SMALL, sample_time=value)


def test_a_sample_time_that_is_longer_than_the_filters_is_spoken_of():
    slow = tse.Filter(SMALL, sample_time=0.5)
    assert slow.settings["sample_time"] == 0.1 and any("rows are 0.5 s apart" in n for n in slow.notes)


def test_a_row_is_whatever_has_names(frame):
    rows = [tse.Filter(SMALL) for _ in range(4)]
    for i, named in enumerate(frame.head(50).itertuples()):
        row = frame.iloc[i]
        found = [
            f.step(x)
            for f, x in zip(
                rows, (row.to_dict(), row, named, frame.head(50).to_records(index=False)[i]), strict=True
            )
        ]
        assert all(np.array_equal(e.stiffness, found[0].stiffness) for e in found)


@pytest.mark.parametrize(
    ("row", "error", "words"),
    [
        ([1, 2], TypeError, "row: list cannot be a row; give a mapping"),
        (3.0, TypeError, "row: float cannot be a row"),
        ({7: 1.0}, tse.InputError, "7 is not the name of a channel"),
        ({"accel_x": 10**400}, tse.InputError, r"accel_x = 1000.*\.\.\. is not a number"),
        ({"accel_x": "a"}, tse.InputError, "accel_x = 'a' is not a number"),
    ],
)
def test_what_is_no_row_is_named(row, error, words):
    with pytest.raises(error, match=words):
        tse.Filter(SMALL).step(row)


def test_copies_go_on_by_themselves(frame):
    rows = frame.to_dict("records")
    one = tse.Filter(SMALL)
    for row in rows[:100]:
        one.step(row)
    others = [one.copy(), copy.copy(one), copy.deepcopy(one), copy.deepcopy({"f": one})["f"]]
    expected = [one.step(row).stiffness for row in rows[100:200]]
    for other in others:
        assert np.array_equal([other.step(row).stiffness for row in rows[100:200]], expected)
    one.reset()
    assert one.step(rows[0]) == tse.Filter(SMALL).step(rows[0])


def test_a_filter_is_not_pickled_and_says_what_to_take():
    with pytest.raises(TypeError, match="save_learnt"):
        pickle.dumps(tse.Filter(SMALL))


def test_what_is_refused_is_a_standard_exception_too(tmp_path):
    """With today's text, also of a KeyError, which else would quote it."""
    for named, kind, words in (
        (lambda: tse.read_vehicle(tmp_path / "none.toml"), FileNotFoundError, "none.toml: no such file"),
        (
            lambda: tse.Filter(SMALL, settings={"forgeting": 1}),
            KeyError,
            "^there is no setting 'forgeting' .did you mean",
        ),
        (
            lambda: tse.Filter(SMALL, settings={"forgetting": 2}),
            ValueError,
            "forgetting = 2 is outside its range",
        ),
        (lambda: tse.read_vehicle({"mass": 1650}), ValueError, "lf"),
    ):
        with pytest.raises(kind, match=words) as caught:
            named()
        assert isinstance(caught.value, tse.Error) and isinstance(caught.value, ValueError)
