"""tselab estimate from the shell, on good input."""

import dataclasses
import os
import re
import shlex
import signal
import struct
import subprocess
import time
import tracemalloc
import zlib
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from conftest import COMMAND, RAN, tselab, tselab_here
from tse.car.config import make_config
from tse.car.vehicle import make_default_vehicle, read_vehicle
from tse.channels.log import read_log
from tse.estimation import estimate as module
from tse.estimation.estimate import estimate_to
from tse.estimation.verdict import list_remarks, make_verdicts
from tse.library.errors import UserError
from tse.log.rows import CheckedLog, Reading, average, list_columns
from tse.report import results
from tse.report.results import list_run_facts
from tse.runs import single

STIFFNESS = ("cx_front", "cy_front", "cy_rear")
SENSORS = ("accel_x", "accel_y", "yaw_rate", "wheel_front", "wheel_rear")
ISSUE_COLUMNS = [
    "time", "vel_x", "vel_x_sd", "vel_y", "vel_y_sd", "yaw_rate", "yaw_rate_sd", "sideslip",
    *(f"{s}{part}" for s in STIFFNESS for part in ("", "_sd", "_spread", "_valid")),
    "bias_accel_x", "bias_accel_x_sd", "bias_accel_y", "bias_accel_y_sd", "bias_yaw_rate", "bias_yaw_rate_sd",
    "n_eff", "log_evidence", "status",
]  # fmt: skip
LATER_COLUMNS = [
    *(f"{s}_spread_seen" for s in STIFFNESS),
    "noise_accel_x",
    "noise_accel_y",
    "noise_yaw_rate",
    *(f"{s}_reason" for s in STIFFNESS),
    *(f"p_{p}" for p in ("steady", "changed", "axle", "fault", "sliding", "restarted")),
    "change_age",
    "change_probability",
    "change_kind",
    *(f"change_{s}" for s in STIFFNESS),
    "fault_channel",
    "discrepancy_accel_x",
    "discrepancy_accel_y",
    "discrepancy_yaw_rate",
    "lag_steer",
    "lag_steer_sd",
    "estimate_age",
    "sideslip_sd",
    "grip",
    "grip_sd",
    "grip_valid",
    "noise_wheel_front",
    "noise_wheel_rear",
    *(f"{what}_{c}" for what in ("innovation", "nis") for c in SENSORS),
    "grip_reason",
    *(f"{s}_secant" for s in STIFFNESS),
    "fault_factor",
]


@pytest.fixture(scope="module")
def result(drive, tmp_path_factory):
    folder = tmp_path_factory.mktemp("estimate")
    done = tselab("estimate", "--verbose", drive.log, "--vehicle", drive.vehicle, cwd=folder)
    assert done.code == 0, done.err
    return done, pd.read_csv(folder / "log.est.csv")


def test_columns_are_those_of_the_issue_and_others_follow(result):
    _, est = result
    assert list(est)[: len(ISSUE_COLUMNS)] == ISSUE_COLUMNS
    assert list(est)[len(ISSUE_COLUMNS) :] == LATER_COLUMNS
    for s in STIFFNESS:
        assert set(est[f"{s}_spread_seen"]) <= {0, 1}


def test_every_row_of_the_log_has_an_estimate_that_is_finite_and_positive(result, drive):
    _, est = result
    assert np.array_equal(est["time"], pd.read_csv(drive.log)["time"])
    numbers = est.select_dtypes("number")
    assert np.isfinite(numbers.to_numpy()).all()
    assert (est[list(STIFFNESS)] > 0).all(axis=None)
    assert (est["status"] >= 0).all()


def test_valid_is_one_or_zero_and_agrees_with_the_reason(result):
    _, est = result
    for s in STIFFNESS:
        assert set(est[f"{s}_valid"]) <= {0, 1}
        assert ((est[f"{s}_valid"] == 1) == (est[f"{s}_reason"] == "valid")).all()


def test_stiffness_is_found_in_newton_per_axle(result):
    _, est = result
    last = est.iloc[-1]
    assert last["cx_front"] == pytest.approx(1.6e5, rel=0.15)
    assert last["cy_front"] == pytest.approx(1.2e5, rel=0.06)
    assert last["cy_rear"] == pytest.approx(1.4e5, rel=0.06)


def test_terminal_says_verdict_and_where_the_file_is(result):
    done, _ = result
    assert "Front cornering stiffness: 1" in done.out and "kN/rad" in done.out and "(95 %)" in done.out
    assert "Estimates written to log.est.csv" in done.out


def test_same_seed_gives_the_same_bytes_and_another_seed_does_not(drive, tmp_path):
    contents = []
    for i, seed in enumerate((5, 5, 6)):
        out = tmp_path / f"{i}.csv"
        options = ["--form", "robust", "--seed", seed, "--particles", 64, "--out", out]
        assert tselab("estimate", "--verbose", drive.log, "--vehicle", drive.vehicle, *options).code == 0
        contents.append(out.read_bytes())
    assert contents[0] == contents[1] != contents[2]


@pytest.fixture
def prepared(drive):
    log = read_log(drive.log)
    return log, make_config(read_vehicle(drive.vehicle), log, None, {"particles": 32})[0]


def test_written_on_the_way_is_what_is_written_at_the_end(prepared, tmp_path, monkeypatch):
    log, config = prepared
    whole = module.estimate(log, config)
    module.write_estimates(whole.table, tmp_path / "whole.csv")
    for block in (module.BLOCK, 300, 4096):
        monkeypatch.setattr(module, "BLOCK", block)
        seen: list[int] = []
        est = module.estimate_to(
            tmp_path / "x.csv", log, config, watch=[lambda b, s=seen: s.append(len(b["time"]))]
        )
        assert (tmp_path / "x.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
        assert sum(seen) == len(est) == len(log) and max(seen) <= block
        assert est.learnt == whole.learnt and not est.interrupted
        for f in (lambda e: [v.text for v in make_verdicts(e.table, config)], lambda e: list_remarks(e.table),
                  lambda e: list_run_facts(e, log, make_default_vehicle(), config)):  # fmt: skip
            assert f(est) == f(whole)


def test_an_error_on_the_way_leaves_the_file_as_it_was(prepared, tmp_path, monkeypatch):
    def fail(block):
        if block["time"][0] > 5:
            raise RuntimeError("disk")

    monkeypatch.setattr(module, "BLOCK", 300)
    path = tmp_path / "est.csv"
    path.write_text("before")
    with pytest.raises(RuntimeError, match="disk"):
        module.estimate_to(path, *prepared, watch=[fail])
    assert path.read_text() == "before" and list(tmp_path.iterdir()) == [path]


def test_a_run_that_is_stopped_before_its_first_row_has_a_header_and_nothing_to_say(
    prepared, tmp_path, monkeypatch
):
    monkeypatch.setattr(module, "_catch_interrupt", lambda: nullcontext(lambda: True))
    est = module.estimate_to(tmp_path / "est.csv", *prepared)
    assert est.interrupted and len(est) == 0 and est.learnt is None
    assert (tmp_path / "est.csv").read_text() == ",".join(module.list_est_columns()) + "\n"
    assert (
        list_remarks(est.table) == []
        and [v.level for v in make_verdicts(est.table, prepared[1])] == ["none"] * 3
    )
    assert len(module.estimate(*prepared)) == 0


def test_memory_does_not_grow_by_what_is_written(prepared, tmp_path):
    log, config = prepared
    peak = {}
    for times in (4, 12):
        n = times * len(log)
        long = dataclasses.replace(
            log, time=0.01 * np.arange(n), data=pd.concat([log.data] * times, ignore_index=True)
        )
        tracemalloc.start()
        estimate_to(tmp_path / "x.csv", long, config)
        peak[n] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    (few, less), (many, more) = peak.items()
    assert (more - less) / (many - few) < 140  # 130: bytes a row; a row of EST.csv has 600 and more


@pytest.fixture
def estimated(drive, tmp_path):
    """What the command says of a table in place of the drive's, and its estimates."""

    def run(table, *options, codes=(0,)):
        table.to_csv(tmp_path / "log.csv", index=False)
        done = tselab_here(
            "estimate", "--verbose", "log.csv", "--vehicle", drive.vehicle, *options, cwd=tmp_path
        )
        assert done.code in codes, done.err
        return done, pd.read_csv(tmp_path / "log.est.csv")

    return run


def test_missing_cells_are_counted_and_bridged(drive, estimated):
    table = drive.table()
    table.loc[100:119, "accel_y"] = ""
    table.loc[300:309, "yaw_rate"] = "nan"
    table.loc[500:504, "steer_angle"] = ""
    table.loc[700, "accel_x"] = "99"
    done, est = estimated(table)
    assert "accel_y: 20 of 2001 cells are missing" in done.err and "line 102" in done.err
    assert "yaw_rate: 10 of 2001" in done.err
    assert "steer_angle: 5 of 2001" in done.err
    assert "accel_x: 1 values outside -50 .. 50 m/s2 are treated as missing (first in line 702)" in done.err
    assert np.isfinite(est.select_dtypes("number").to_numpy()).all()
    assert (est["status"].iloc[100:120] >= 1).all()


def test_irregular_sampling_is_followed_and_reported(drive, estimated):
    table = drive.table()
    rng = np.random.default_rng(1)
    keep = rng.random(len(table)) > 0.3
    keep[1000:1100] = False
    done, est = estimated(table[keep])
    assert "irregular sampling" in done.err and "1 gap longer than" in done.err
    assert len(est) == keep.sum()
    assert est["cy_front"].iloc[-1] == pytest.approx(1.2e5, rel=0.1)


def test_slow_log_of_20_hz_is_handled(drive, estimated):
    done, est = estimated(drive.table().iloc[::5])
    assert "every 50 ms" in done.out and (est[list(STIFFNESS)] > 0).all(axis=None)


def test_average_over_blocks_finds_the_same_tyres(drive, tmp_path):
    done = tselab_here(
        "estimate",
        "--verbose",
        drive.log,
        "--vehicle",
        drive.vehicle,
        "--average",
        0.04,
        "--report",
        "r.html",
        cwd=tmp_path,
    )
    assert done.code == 0, done.err
    assert "500 rows, 20.0 s, every 40 ms (means of 4 rows)" in done.out
    assert "averaged over 0.04 s: 2001 rows became 500, each the mean of 4" in done.err
    assert "accel_x_sd: 0.15 m/s2 for one sample is 0.075 m/s2 for a mean of 4" in done.err
    last = pd.read_csv(tmp_path / "log.est.csv").iloc[-1]
    for k, n in zip(STIFFNESS, (1.6e5, 1.2e5, 1.4e5), strict=True):
        assert (
            abs(last[k] - n) < 2.6 * last[f"{k}_sd"]
            and abs(last[k] - n) < (0.15 if k == "cx_front" else 0.06) * n
        ), k


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.2, "0.2 is outside its range 0.001 .. 0.1 s"),
        (0.012, "the rows of the log are 0.01 s apart"),
        ("nan", "outside"),
    ],
)
def test_average_that_cannot_be_is_refused(drive, tmp_path, seconds, text):
    done = tselab_here(
        "estimate", "--verbose", drive.log, "--vehicle", drive.vehicle, "--average", seconds, cwd=tmp_path
    )
    assert done.code == 2 and "option --average: " in done.err and text in done.err


def test_average_takes_rows_as_they_come():
    time = np.array(
        [0, 0.01, 0.02, 0.03, 0.1, 0.13, 0.14, 0.19, 0.2, 0.21, 0.22, 0.23, 5.0, 5.01, 5.02, 5.03, 5.1]
    )
    n = len(time)
    data = pd.DataFrame(dict.fromkeys(list_columns()[1:], 10.0 * time))
    data.loc[4:6, "accel_x"] = np.nan  # three of a block
    data.loc[8, "accel_y"] = np.nan  # one
    ref = pd.DataFrame({"ref_vel_x": np.where(time < 5, 1.0, np.nan)})
    log = average(CheckedLog(Path("x.csv"), time, data, ref, np.arange(n) + 2, 0.01), 0.1)
    assert log.time == pytest.approx(
        [0.015, 0.14, 0.215, 5.015]
    )  # mean times; the last row alone is no block
    assert log.data["yaw_rate"].tolist() == pytest.approx(10 * log.time)
    assert np.isnan(log.data["accel_x"][1]) and log.data["accel_x"].notna().sum() == 3
    assert log.data["accel_y"][2] == pytest.approx(2.2)
    assert log.ref["ref_vel_x"][:3].tolist() == [1, 1, 1] and np.isnan(log.ref["ref_vel_x"][3])
    assert list(log.line) == [2, 6, 10, 14] and log.averaged == 4
    assert log.rows()["dt"][1:] == pytest.approx(np.diff(log.time))


def test_extra_columns_blank_lines_and_a_byte_order_mark_do_no_harm(drive, tmp_path):
    table = drive.table().iloc[:300]
    table.insert(3, "driver", "somebody")
    table["ref_note"] = "text"
    text = table[table.columns[::-1]].to_csv(index=False)
    (tmp_path / "log.csv").write_text("\ufeff" + text + "\n\n", encoding="utf-8")
    done = tselab_here("estimate", "--verbose", "log.csv", "--vehicle", drive.vehicle, cwd=tmp_path)
    assert done.code in RAN, done.err
    assert "ref_note is not numeric" in done.err
    assert len(pd.read_csv(tmp_path / "log.est.csv")) == 300


def test_a_single_row_is_enough(drive, estimated):
    assert len(estimated(drive.table().iloc[:1], "--report", "r.html", codes=RAN)[1]) == 1


def test_settings_come_from_file_and_options_win(drive, tmp_path):
    (tmp_path / "filter.toml").write_text(
        "forgetting = 0.98\ninitial_mean_sd = 0.01\n[filter]\nparticles = 64\ninitial_cx_front = 0.7\n"
    )
    done = tselab_here(
        "estimate",
        "--form",
        "robust",
        drive.log,
        "--vehicle",
        drive.vehicle,
        "--config",
        "filter.toml",
        "--particles",
        48,
        "--set",
        "initial_cy_front=0.8",
        "--verbose",
        cwd=tmp_path,
    )
    assert done.code == 0, done.err
    assert "48 particles, forgetting 0.98" in done.out
    first = pd.read_csv(tmp_path / "log.est.csv").iloc[0]
    assert first["cx_front"] == pytest.approx(0.7 * 1.6e5, rel=0.1)
    assert first["cy_front"] == pytest.approx(0.8 * 1.2e5, rel=0.1)


@pytest.fixture
def turned(drive, estimated):
    """Estimates of a drive in which ten rows are steered too far, and what was said."""
    table = drive.table()
    table.loc[50:59, "steer_angle"] = "0.8"
    return estimated(table)


def test_at_large_steering_angles_nothing_is_learnt(turned):
    done, est = turned
    assert "steering beyond 0.7 rad in 10 rows (first in line 52)" in done.err
    assert (est["cy_front_reason"].iloc[50:60] == "held").all()
    for key in STIFFNESS:
        assert np.ptp(est[key].iloc[50:60]) < 1e-3 * est[key].iloc[50]


def test_what_was_not_used_has_no_evidence(turned):
    """As src/tables/output.toml says."""
    _, est = turned
    for name in ("log_evidence", "nis_accel_y", "innovation_accel_y", "innovation_yaw_rate"):
        assert (est[name].iloc[50:60] == 0).all(), name


def test_a_vehicle_speed_says_nothing_of_slip(drive, estimated):
    table = drive.table()
    table["wheel_speed_front"] = table["wheel_speed_rear"]
    done, est = estimated(table, codes=RAN)
    assert "both wheel speeds are one signal" in done.err
    assert not est["cx_front_valid"].any()


@pytest.mark.skipif(os.name == "nt", reason="signals work otherwise there")
def test_ctrl_c_leaves_complete_rows_and_says_so(drive, tmp_path):
    table = pd.read_csv(drive.log)
    long = pd.concat([table] * 60, ignore_index=True)
    long["time"] = np.arange(len(long)) * 0.01
    long.to_csv(tmp_path / "long.csv", index=False)
    run = subprocess.Popen(
        [
            *COMMAND,
            "estimate",
            "--verbose",
            "long.csv",
            "--vehicle",
            str(drive.vehicle),
            "--progress",
            "--report",
            "r.html",
            "--save-learnt",
            "car.tse",
        ],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    seen = b""
    end = time.monotonic() + 60
    while not re.search(rb"[1-9]\d*%", seen) and time.monotonic() < end:
        seen += os.read(run.stderr.fileno(), 4096)
    run.send_signal(signal.SIGINT)
    _, err = run.communicate(timeout=60)
    assert run.returncode == 130, err
    assert b"stopped by Ctrl-C after" in err and b"Traceback" not in err
    text = (tmp_path / "long.est.csv").read_text()
    assert text.endswith("\n")
    est = pd.read_csv(tmp_path / "long.est.csv")
    assert 0 < len(est) < len(long)
    assert np.isfinite(est.select_dtypes("number").to_numpy()).all()
    assert {p.name for p in tmp_path.iterdir()} == {"long.csv", "long.est.csv", "r.html", "car.tse"}
    done = tselab_here(
        "estimate",
        "--verbose",
        drive.log,
        "--vehicle",
        drive.vehicle,
        "--load-learnt",
        "car.tse",
        cwd=tmp_path,
    )
    assert "started from: car.tse" in done.out


def test_closed_pipe_is_not_an_error_message():
    run = subprocess.run(
        f"{shlex.join(COMMAND)} settings | head -n 1", shell=True, capture_output=True, text=True, timeout=60
    )
    assert run.stdout.startswith("setting") and run.stderr == ""


# ---- What is learnt on one drive is kept for the next: tselab estimate --save-learnt,
# --load-learnt.

TYRES = ("--set", "true_cx_front=0.75", "--set", "true_cy_front=0.8", "--set", "true_cy_rear=1.2")
FORMS = ("default", "robust")


def simulate(folder, name, seed, *options, maneuver="square-waves"):
    done = tselab_here("simulate", "--maneuver", maneuver, "--vehicle", "car.toml", "--out", f"{name}.csv",
                  "--truth", f"{name}.truth.csv", "--seed", seed, *TYRES, *options, cwd=folder)  # fmt: skip
    assert done.code == 0, done.err


def estimate(folder, name, *options, codes=RAN):
    done = tselab_here("estimate", "--verbose", f"{name}.csv", "--vehicle", "car.toml", *options, cwd=folder)
    assert done.code in codes, done.err
    return done


def compute_errors(folder, name, first, last):
    """Return the rms relative error per stiffness, and the share of wrong valid rows."""
    est, truth = (pd.read_csv(folder / f"{name}.{kind}.csv") for kind in ("est", "truth"))
    span = (est["time"] >= first) & (est["time"] < last)
    wrong = {key: (est[key] / truth[f"true_{key}"] - 1)[span] for key in STIFFNESS}
    sure = pd.concat([(wrong[k].abs() > 0.2) & (est[f"{k}_valid"][span] == 1) for k in STIFFNESS])
    return {key: float(np.sqrt((wrong[key] ** 2).mean())) for key in STIFFNESS}, float(sure.mean())


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """Return a drive on other tyres, learnt in two forms: default.tse, robust.tse."""
    folder = tmp_path_factory.mktemp("learnt")
    (folder / "car.toml").write_text(tselab_here("vehicle", "--simulated").out)
    simulate(folder, "first", 1)
    for form in FORMS:
        done = estimate(folder, "first", "--form", form, "--save-learnt", f"{form}.tse")
        assert f"Learnt state written to {form}.tse" in done.out
    simulate(folder, "second", 2, "--duration", 10)
    simulate(folder, "quiet", 2, "--duration", 10, maneuver="straight")
    simulate(folder, "changed", 3, "--duration", 30, "--road-change", "0:0.6")
    return folder


@pytest.mark.parametrize("form", FORMS)
def test_the_next_drive_is_right_at_once(first, form):
    """Square waves teach everything within tenths of a second: nothing to gain there."""
    estimate(first, "quiet", "--form", form)
    without, _ = compute_errors(first, "quiet", 0, 2)
    done = estimate(first, "quiet", "--form", form, "--load-learnt", f"{form}.tse", "--age", 1)
    assert f"started from: {form}.tse, 1 days old (--age)" in done.out
    learnt, _ = compute_errors(first, "quiet", 0, 2)
    mean = [np.mean(list(errors.values())) for errors in (without, learnt)]
    if form == "default":
        assert mean[0] > 0.1 and mean[1] < 0.05
        # along the car the radii are found anew with every drive, which is most of the
        # error there: 10 % for 13 %
        share = {"cx_front": 0.9}
        assert all(learnt[key] < share.get(key, 0.6) * without[key] for key in STIFFNESS)
    else:  # particles start 1 m/s off sideways, and what they knew of the mean is soon forgotten
        assert mean[0] > 0.1 and mean[1] < 0.1 and mean[1] < 0.6 * mean[0]


@pytest.mark.parametrize("form", FORMS)
def test_a_road_that_has_changed_since_is_followed(first, form):
    estimate(first, "changed", "--form", form, "--load-learnt", f"{form}.tse", "--age", 1)
    late, sure = compute_errors(first, "changed", 20, 30)
    assert max(late["cy_front"], late["cy_rear"]) < 0.05 and late["cx_front"] < 0.15 and sure == 0
    if form == "default":
        soon, sure = compute_errors(first, "changed", 5, 10)
        assert max(soon["cy_front"], soon["cy_rear"]) < 0.05 and soon["cx_front"] < 0.15 and sure == 0


def test_old_knowledge_is_trusted_less_and_never_less_than_the_settings_start(first):
    sd = []
    ages = (0, 30, 100, 40000)
    for age in ages:
        estimate(first, "quiet", "--load-learnt", "default.tse", "--age", age)
        start = pd.read_csv(first / "quiet.est.csv").iloc[0]
        sd.append(start["cy_front_sd"] / start["cy_front"])
    assert sd == pytest.approx([min(np.sqrt(0.1**2 + 0.02**2 * age), 0.3) for age in ages], rel=0.05)


def test_without_an_age_it_is_as_old_as_the_file(first, tmp_path):
    data = (first / "default.tse").read_bytes()
    (first / "aged.tse").write_bytes(data)
    then = time.time() - 5 * 86400
    os.utime(first / "aged.tse", (then, then))
    done = estimate(first, "second", "--load-learnt", "aged.tse")
    assert "started from: aged.tse, 5 days old (time of the file" in done.out


def test_one_file_may_be_loaded_and_replaced(first):
    before = (first / "default.tse").read_bytes()
    (first / "car.tse").write_bytes(before)
    estimate(first, "second", "--load-learnt", "car.tse", "--age", 3, "--save-learnt", "car.tse")
    after = (first / "car.tse").read_bytes()
    assert len(after) == len(before) and after != before and after[:12] == before[:12]


def test_sensors_filled_in_from_another_log_and_other_filter_settings_do_not_matter(first):
    lines = (first / "car.toml").read_text().split("[sensors]")[0]
    (first / "bare.toml").write_text(lines)
    done = tselab_here(
        "estimate",
        "--verbose",
        "second.csv",
        "--vehicle",
        "bare.toml",
        "--set",
        "max_gap=0.3",
        "--load-learnt",
        "default.tse",
        "--age",
        1,
        cwd=first,
    )
    assert done.code == 0, done.err


def test_a_file_that_is_wrong_is_named_with_what_is_wrong_and_nothing_is_written(first):
    (first / "second.est.csv").unlink(missing_ok=True)
    good = (first / "default.tse").read_bytes()
    flipped = good[:40] + bytes([good[40] ^ 4]) + good[41:]
    for name, data in {"damaged.tse": flipped, "short.tse": good[:50], "empty.tse": b"",
                       "log.tse": (first / "second.csv").read_bytes()}.items():  # fmt: skip
        (first / name).write_bytes(data)
        done = estimate(first, "second", "--load-learnt", name, "--save-learnt", "new.tse", codes=(2,))
        assert done.err.startswith(
            f"tselab: error: {name}: this is not a learnt state of this library, or it is damaged"
        ), done.err
        assert "Traceback" not in done.err
        assert not (first / "second.est.csv").exists() and not (first / "new.tse").exists()


def test_another_vehicle_and_a_newer_format_are_told_apart(first):
    car = (first / "car.toml").read_text()
    (first / "other.toml").write_text(re.sub(r"(?m)^mass\s*=.*$", "mass = 1555", car))
    done = tselab_here(
        "estimate",
        "--verbose",
        "second.csv",
        "--vehicle",
        "other.toml",
        "--load-learnt",
        "default.tse",
        cwd=first,
    )
    assert done.code == 2 and "default.tse: the learnt state belongs to another vehicle" in done.err
    data = (first / "default.tse").read_bytes()
    newer, older = (
        data[:4] + struct.pack("<H", 4) + data[6:-4],
        data[:4] + struct.pack("<HH", 1, 96) + data[8:92],
    )
    said = {
        "newer": (newer, "a newer version of this library"),
        "older": (older, "an older version of this library; learn anew"),
    }
    for name, (content, why) in said.items():
        (first / f"{name}.tse").write_bytes(content + struct.pack("<I", zlib.crc32(content)))
        done = estimate(first, "second", "--load-learnt", f"{name}.tse", codes=(2,))
        assert f"{name}.tse: the learnt state" in done.err and f"was written by {why}" in done.err


def test_a_bias_is_known_at_once_in_the_next_drive(first, tmp_path):
    (tmp_path / "car.toml").write_text((first / "car.toml").read_text())
    for name, seed in (("one", 1), ("two", 2)):
        done = tselab_here(
            "simulate",
            "--maneuver",
            "square-waves",
            "--vehicle",
            "car.toml",
            "--out",
            f"{name}.csv",
            "--set",
            "true_bias_yaw_rate=0.008",
            "--seed",
            seed,
            cwd=tmp_path,
        )
        assert done.code == 0, done.err
    estimate(tmp_path, "one", "--save-learnt", "biased.tse")
    off = []
    for options in ((), ("--load-learnt", "biased.tse", "--age", 0)):
        estimate(tmp_path, "two", *options)
        est = pd.read_csv(tmp_path / "two.est.csv")
        off.append(float((est["bias_yaw_rate"][est["time"] < 0.3] - 0.008).abs().mean()))
    assert off[1] < 0.002 and off[1] < 0.5 * off[0]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--load-learnt", "nowhere.tse"), "nowhere.tse: cannot be read: No such file"),
        (("--load-learnt", "."), ".: cannot be read: Is a directory"),
        (("--age", 3), "option --age"),
        (("--load-learnt", "default.tse", "--age", -1), "option --age: -1 is outside its range"),
        (("--load-learnt", "default.tse", "--age", "nan"), "option --age: nan is outside its range"),
        (("--save-learnt", "second.csv"), "--save-learnt is the same file as the log"),
        (("--save-learnt", "car.toml"), "--save-learnt is the same file as --vehicle"),
        (
            ("--load-learnt", "default.tse", "--out", "default.tse"),
            "ends in .tse; its name must end in .csv or .parquet or .pq",
        ),
        (("--save-learnt", "no/such/place.tse"), "does not exist"),
    ],
)
def test_options_that_cannot_be_are_refused(first, options, text):
    done = estimate(first, "second", *options, codes=(2,))
    assert text in done.err and "Traceback" not in done.err


def test_after_ctrl_c_no_second_pass_begins(drive, monkeypatch):
    """Rows that contradict the log would be gone over again, from the first."""
    passes = []

    def stopped(*args):
        passes.append(1)
        return replace(estimate_to(*args), interrupted=True)

    monkeypatch.setattr(single, "estimate_to", stopped)
    monkeypatch.setattr(single, "describe_implausible", lambda _: "odd")
    ran = single.run_prepared(
        single.prepare_run(drive.log, drive.vehicle, None, None, {}, "default", {}), None, None
    )
    assert len(passes) == 1 and ran.notes[0] == "odd"


def test_a_log_of_which_stiffness_is_said_to_be_wrong_has_no_valid_row(drive, monkeypatch):
    """The steering angle has another latency than the vehicle file states.

    This is known only at the end, and holds for all rows.
    """
    prepared = single.prepare_run(drive.log, drive.vehicle, None, None, {}, "default", {})
    assert results.choose_exit_code(single.run_prepared(prepared, None, None).findings) != results.NOTHING
    late = "steer_angle is logged 60 ms later than the vehicle file states. The stiffness is wrong"
    monkeypatch.setattr(single, "check_steering_lag", lambda *_: [late])
    ran = single.run_prepared(
        single.prepare_run(drive.log, drive.vehicle, None, None, {}, "default", {}), None, None
    )
    valid = [f"{s}_valid" for s in ("cx_front", "cy_front", "cy_rear", "grip")]
    assert (
        results.choose_exit_code(ran.findings) == results.NOTHING
        and not ran.estimate.table[valid].to_numpy().any()
    )
    assert sum(late in note for note in ran.notes) == 1 and (ran.estimate.table["status"] == 10).mean() > 0.3


def test_strict_holds_for_the_car_that_was_calibrated_on_the_log(drive, monkeypatch):
    says = iter([[], ["odd"]])
    monkeypatch.setattr(single, "check_car", lambda *_: next(says))
    monkeypatch.setattr(single, "is_uncalibrated", lambda _: True)
    monkeypatch.setattr(single, "calibrate_once", lambda *_: single.keep_class("of a test"))
    with pytest.raises(UserError, match="option --strict: odd"):
        single.prepare_run(
            drive.log, drive.vehicle, None, None, {}, "default", {}, Reading(strict=True), single.Calibrate()
        )
