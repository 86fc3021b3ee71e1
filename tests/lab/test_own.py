"""An uncalibrated car is calibrated on its own log.

The tests check what is found, what is kept and what keeps the values of the class. The
car is one of tests/cars, with 14 degrees of freedom.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import tse
from conftest import Result, tselab, tselab_here
from tests.cars import make_cars
from tests.cars.cache import make_logs_once
from tests.cars.study import TRUTH, compute_truth
from tests.gap.runs import change_constant
from tse.calibration import own, workflow
from tse.car.config import make_config
from tse.car.vehicle import make_filter_values, make_vehicle, read_vehicle
from tse.channels.log import read_log
from tse.library.core import NativeFilter
from tse.runs.keep import CALIBRATED

# whole drives and searches; tests/lab/test_own_parts.py has the parts
pytestmark = pytest.mark.slow

MINUTES = 1.5
AXLES = ("cy_front", "cy_rear")


@dataclass
class Case:
    folder: Path
    log: Path
    car: Path
    first: Result  # estimated, as JSON
    est: pd.DataFrame
    plain: pd.DataFrame  # --no-calibrate


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory, cache: Path) -> Case:
    folder = tmp_path_factory.mktemp("own")
    make_logs_once("mountain", MINUTES, cars=make_cars(1, 3301), seed=4)[0].write(folder, "mountain")
    log, car = folder / "log_mountain.csv", folder / "car.toml"
    first = tselab("estimate", "--verbose", log, "--vehicle", car, "--report", "r.html", "--json", cwd=folder)
    est = pd.read_csv(folder / "log_mountain.est.csv")
    plain = tselab(
        "estimate", "--verbose", log, "--vehicle", car, "--no-calibrate", "--out", "plain.csv", cwd=folder
    )
    assert plain.code in (0, 3, 4), plain.err
    return Case(folder, log, car, first, est, pd.read_csv(folder / "plain.csv"))


def compute_errors(case: Case, est: pd.DataFrame, key: str) -> np.ndarray:
    """Return the relative errors of the rows after 20 s."""
    truth = pd.read_csv(case.folder / "reference_mountain.csv")
    true = compute_truth({c: truth[c].to_numpy(float) for c in TRUTH.values()})[key]
    return (est[key].to_numpy() / true - 1)[est["time"].to_numpy() > 20]


def test_the_stiffness_of_the_car_is_found_and_said(case):
    """At no slip and with the steering's compliance, within its 95 % interval."""
    said = json.loads(case.first.out)["calibration"]
    truth = json.loads((case.folder / "truth.json").read_text())["linear_stiffness"]
    assert said["used"] and said["converged"] and 60 < said["seconds"] < 60 * MINUTES
    for key in AXLES:
        assert said["stiffness"][key]["low"] < truth[f"{key}_effective"] < said["stiffness"][key]["high"]
    page = (case.folder / "r.html").read_text(encoding="utf-8")
    for line in said["words"]:
        assert line in page
    assert "calibrated on the log itself" in said["words"][0] and "kept for the next run" in said["words"][-1]


def test_the_estimate_is_nearer_and_more_of_the_front_valid(case):
    for key in AXLES:
        ours, plain = (compute_errors(case, e, key) for e in (case.est, case.plain))
        assert np.nanmedian(np.abs(ours)) < 0.1 and np.nanmedian(np.abs(ours)) < np.nanmedian(np.abs(plain))
        sd = (case.est[f"{key}_sd"] / case.est[key]).to_numpy()[case.est["time"].to_numpy() > 20]
        known = np.isfinite(ours)
        # Nearly all rows of one drive share one error. 0.9 fails where the interval
        # misses for seconds, not for a moment.
        assert (np.abs(ours)[known] < 1.96 * sd[known] * (1 + ours[known])).mean() > 0.9
    assert case.est["cy_front_valid"].mean() > case.plain["cy_front_valid"].mean()


def test_the_posterior_is_the_prior(case):
    """Of the stiffness; model discrepancy is that of the class."""
    made = own.calibrate_once(read_vehicle(case.car), [read_log(case.log)])
    table = read_toml_text(made.text)["calibration"]
    vehicle, stated = made.apply_to(read_vehicle(case.car)), read_vehicle(case.car)
    prior, plain = make_filter_values(vehicle), make_filter_values(stated)
    for key in AXLES:
        at = table["names"].index(key)
        posterior = np.sqrt(table["covariance"][at][at])
        assert posterior == pytest.approx(made.found["stiffness"][key]["sd_relative"])
        assert prior[f"initial_{key}_sd"] == pytest.approx(posterior)
    assert prior["model_sd"] == pytest.approx(plain["model_sd"], rel=1e-9)
    del table["own"]
    assert make_filter_values(
        make_vehicle(read_toml_text(made.text) | {"calibration": table}, Path("car.toml"))
    )["initial_cy_rear_sd"] == pytest.approx(posterior)


def read_toml_text(text: str) -> dict:
    from tse.library.files import tomllib

    return tomllib.loads(text)


def test_a_second_run_takes_what_the_first_has_kept(case, monkeypatch, tmp_path):
    def fail(*_: object, **__: object) -> None:
        raise AssertionError("calibrated anew")

    monkeypatch.setattr(workflow, "calibrate_logs", fail)
    again = tselab_here(
        "estimate", "--verbose", case.log, "--vehicle", case.car, "--out", "est.csv", cwd=tmp_path
    )
    assert "kept from an earlier run: " in again.out
    assert (tmp_path / "est.csv").read_bytes() == (case.folder / "log_mountain.est.csv").read_bytes()


def test_python_says_and_estimates_the_same(case):
    frame = pd.read_csv(case.log)
    found = tse.estimate(frame, case.car)
    assert found.calibration == {
        k: v for k, v in json.loads(case.first.out)["calibration"].items() if k != "words"
    }
    assert np.array_equal(found.stiffness[:, 1].astype(np.float32), case.est["cy_front"].astype(np.float32))
    assert any("calibrated on the log itself" in n for n in found.notes)
    plain = tse.estimate(frame, case.car, calibrate=False)
    assert plain.calibration is None and np.array_equal(
        plain.stiffness[:, 1].astype(np.float32), case.plain["cy_front"].astype(np.float32)
    )
    after = tse.estimate(
        frame, found.vehicle, learnt=found.learnt, age=0.0
    )  # of the car that it was learnt of
    assert after.calibration is None and after.valid[:, 1].mean() > found.valid[:, 1].mean() - 0.05


def test_an_entry_that_is_broken_or_of_somebody_else_is_made_anew(case, cache):
    entry = find_kept(case, cache)
    entry.unlink()  # the command's has the bits of one thread of the BLAS
    own.calibrate_once(read_vehicle(case.car), [read_log(case.log)])
    whole = entry.read_text()
    for text in (whole[:-20], whole.replace("cornering_stiffness_front = ", "cornering_stiffness_front = 1")):
        entry.write_text(text)
        again = own.calibrate_once(read_vehicle(case.car), [read_log(case.log)])
        assert again.words[-1] == f"kept file was damaged, replaced: {entry}"
        assert entry.read_text() == whole


def find_kept(case: Case, cache: Path) -> Path:
    key = own._compute_key(read_vehicle(case.car), [read_log(case.log)])
    return cache / "tselab" / "calibrated" / f"{key}.json"


def test_another_car_or_log_is_another_entry(case, tmp_path):
    log, car = read_log(case.log), read_vehicle(case.car)
    keys = {own._compute_key(car, [log])}
    other = tmp_path / "car.toml"
    other.write_text("cg_height = 0.9\n" + case.car.read_text(), encoding="utf-8")  # which no setting has
    keys.add(own._compute_key(read_vehicle(other), [log]))
    other.write_text(case.car.read_text() + "\n[latency]\nsteer_angle = 0.01\n", encoding="utf-8")
    keys.add(own._compute_key(read_vehicle(other), [log]))
    rows = case.log.read_text().splitlines()
    (tmp_path / "log.csv").write_text("\n".join(rows[:-1]) + "\n")
    keys.add(own._compute_key(car, [read_log(tmp_path / "log.csv")]))
    assert len(keys) == 4


@pytest.mark.parametrize("step", [0.005, 0.01, 0.02, 0.1])
def test_the_part_that_calibrates_a_car_lasts_as_long_at_every_sample_time(case, step):
    log = read_log(case.log)
    slow = replace(log, time=log.time[0] + step * np.arange(len(log)), sample_time=step)
    part = own._select_part(slow, 8.0)
    assert len(part) * step == pytest.approx(8.0, abs=step)


def test_too_short_a_log_is_said_and_the_car_stays_one_of_its_class(case, tmp_path):
    rows = case.log.read_text().splitlines()
    (tmp_path / "log.csv").write_text("\n".join(rows[:3001]) + "\n")
    done = tselab_here("estimate", "--verbose", "log.csv", "--vehicle", case.car, cwd=tmp_path)
    assert "not calibrated on the log itself: it lasts 29.99 s, 60 s are needed" in done.out
    assert "filled in: cornering_stiffness_front" in done.out
    plain = tselab_here(
        "estimate",
        "--verbose",
        "log.csv",
        "--vehicle",
        case.car,
        "--no-calibrate",
        "--out",
        "p.csv",
        cwd=tmp_path,
    )
    assert f"\n{own.NOT_ASKED}\n" in f"\n{plain.out}"
    assert (tmp_path / "p.csv").read_bytes() == (tmp_path / "log.est.csv").read_bytes()


def test_a_log_that_goes_straight_shows_nothing(case):
    log = read_log(case.log)
    log.data["yaw_rate"] *= 0.05
    words = own.calibrate_once(read_vehicle(case.car), [log]).words
    assert words == [own.keep_class("it hardly turns: 0.0 s above 1 m/s2 across, 2 s are needed").words[0]]


def test_a_search_that_does_not_end_leaves_the_car_to_its_class(case, monkeypatch, tmp_path):
    car, log = read_vehicle(case.car), read_log(case.log)
    longest = own.MAX_SEARCH_SECONDS
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # nothing is kept there
    monkeypatch.setattr(own, "MAX_SEARCH_SECONDS", -1.0)
    with change_constant("identify.fit.MAX_FIT_STEPS", 1):
        late = own.calibrate_once(car, [log])
        assert late.text == "" and late.found == {"used": False, "why": own.TOO_LONG}
        monkeypatch.setattr(own, "MAX_SEARCH_SECONDS", longest)
        stopped = own.calibrate_once(car, [log])  # what took too long is not kept: it is tried again
    assert stopped.text == "" and "did not converge in 1 steps" in stopped.words[0]
    assert stopped.apply_to(car).values == car.values


def test_ctrl_c_stops_it_and_the_car_is_an_ordinary_one(case, cache, monkeypatch, tmp_path):
    """The estimate is written, no calibration is kept, and no lock stays.

    In Python it is an ordinary interrupt.
    """

    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(workflow, "calibrate_logs", interrupt)
    (tmp_path / "car.toml").write_text(
        case.car.read_text() + "\n[latency]\nsteer_angle = 0.02\n", encoding="utf-8"
    )
    before = sorted(cache.rglob("*.json"))
    done = tselab_here(
        "estimate", "--verbose", case.log, "--vehicle", "car.toml", "--out", "est.csv", cwd=tmp_path
    )
    assert done.code == 130 and "the calibration was stopped by Ctrl-C" in done.err
    assert f"not calibrated on the log itself: {own.STOPPED}" in done.out
    tselab_here(
        "estimate",
        "--verbose",
        case.log,
        "--vehicle",
        "car.toml",
        "--no-calibrate",
        "--out",
        "plain.csv",
        cwd=tmp_path,
    )
    assert (tmp_path / "est.csv").read_bytes() == (tmp_path / "plain.csv").read_bytes()
    assert sorted(cache.rglob("*.json")) == before and not list(cache.rglob("*.lock"))
    with pytest.raises(KeyboardInterrupt):
        tse.estimate(pd.read_csv(case.log), tmp_path / "car.toml")


def test_a_minute_is_long_enough_without_its_last_row(case, tmp_path):
    """59.98 s: what the ends leave out is no reason."""
    rows = case.log.read_text().splitlines()
    (tmp_path / "log.csv").write_text("\n".join(rows[:6000]) + "\n")  # names, and 5999 rows
    log, car = read_log(tmp_path / "log.csv"), read_vehicle(case.car)
    assert log.time[-1] - log.time[0] == pytest.approx(59.98, abs=1e-6)
    with change_constant("identify.fit.MAX_FIT_STEPS", 1):
        assert "s are needed" not in own.calibrate_once(car, [log]).words[0]


def test_who_is_calibrated_or_known_is_left_alone(case, tmp_path):
    car = tmp_path / "car.toml"
    car.write_text(case.car.read_text() + "\n[uncertainty]\nmass_sd = 0.02\n", encoding="utf-8")
    learnt = tmp_path / "car.tse"
    for options in (("--vehicle", car), ("--vehicle", case.car, "--save-learnt", learnt),
                    ("--vehicle", case.car, "--load-learnt", learnt)):  # fmt: skip
        done = tselab_here(
            "estimate", "--verbose", case.log, *options, "--json", "--out", "e.csv", cwd=tmp_path
        )
        assert json.loads(done.out)["calibration"] is None, options


def test_channels_that_contradict_each_other_calibrate_nothing(case):
    frame = pd.read_csv(case.log)
    frame["yaw_rate"] = -frame["yaw_rate"]
    with pytest.warns(UserWarning):
        found = tse.estimate(frame, case.car)
    assert found.calibration == {"used": False, "why": "its channels contradict each other"}


def test_a_fleet_calibrates_a_car_on_its_first_logs(case, tmp_path):
    """Both drives are of one car: the second starts from the first's results."""
    rows = case.log.read_text().splitlines()
    (tmp_path / "logs").mkdir()
    for name, part in (("2026-01-01", rows[1:4501]), ("2026-01-02", rows[4501:])):
        (tmp_path / "logs" / f"{name}.csv").write_text("\n".join([rows[0], *part]) + "\n")
    wrong = pd.read_csv(case.log)
    wrong.assign(accel_y=wrong["accel_y"] / 9.81).to_csv(tmp_path / "logs" / "2026-01-03.csv", index=False)
    command = ("fleet", "logs", "--vehicle", case.car, "--car", "x", "--out", "out", "--no-reports", "--json")
    done = tselab_here(*command, cwd=tmp_path)
    first, second, _ = json.loads(done.out)["logs"]
    assert "calibrated on the log itself" in first["notes"][0]
    assert any(
        n.startswith("left out: ") and "2026-01-03.csv: channels contradict each other" in n
        for n in first["notes"]
    )
    assert not any(
        "calibrated on" in n or "learnt state of the previous drive is not used" in n for n in second["notes"]
    )
    (made,) = (tmp_path / "out" / CALIBRATED).glob("*.toml")
    assert read_vehicle(made).calibration["own"]
    loaded = tselab_here(
        "estimate",
        "--verbose",
        "logs/2026-01-02.csv",
        "--vehicle",
        made,
        "--load-learnt",
        "out/learnt/x.tse",
        cwd=tmp_path,
    )
    assert loaded.code in (0, 3), loaded.err
    stat = made.stat().st_mtime_ns
    assert tselab_here(*command, cwd=tmp_path).out == done.out and made.stat().st_mtime_ns == stat
    plain = tselab_here(*command[:-1], "--no-calibrate", "--restart", "--json", cwd=tmp_path)
    notes = [n for log in json.loads(plain.out)["logs"] for n in log["notes"]]
    assert own.NOT_ASKED in notes and not any("minutes of it" in n for n in notes)


def test_a_log_of_two_roads_calibrates_nothing(tmp_path, cache):
    """Ice in the middle: one stiffness for both would be that of neither."""
    made = make_logs_once("mountain", 2.0, cars=make_cars(1, 3301), seed=4, scenario="ice", event_time=60.0)[
        0
    ]
    made.write(tmp_path, "mountain")
    found = own.calibrate_once(read_vehicle(tmp_path / "car.toml"), [read_log(tmp_path / "log_mountain.csv")])
    assert not found.text and not found.found["used"]
    assert "the road or the tyres change during the log" in found.words[0]


def test_search_and_filter_that_exclude_each_other_calibrate_nothing(case):
    """The search's value is moved to twice that of the filter, with a narrow interval.

    Where it is not moved, both agree.
    """
    vehicle, log = read_vehicle(case.car), read_log(case.log)
    found = own.calibrate_once(vehicle, [log]).found
    config, _ = make_config(vehicle, log)
    last = NativeFilter(config).estimate_rows(log.rows())[-1]
    assert own._describe_contradiction(config, last, found) == ""
    front = {k: 2 * v for k, v in found["stiffness"]["cy_front"].items()} | {"sd_relative": 0.05}
    text = own._describe_contradiction(config, last, {"stiffness": found["stiffness"] | {"cy_front": front}})
    assert f"the front cornering stiffness is {front['value'] / 1000:.0f} " in text
    assert "by the calibration" in text and "by the filter on the same rows" in text
