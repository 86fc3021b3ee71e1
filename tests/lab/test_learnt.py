"""What one drive taught, kept for the next: tselab estimate --save-learnt, --load-learnt."""

from __future__ import annotations

import os
import re
import time

import numpy as np
import pandas as pd
import pytest

from conftest import RAN, tselab_here

KEYS = ("cx_front", "cy_front", "cy_rear")
TYRES = ("--set", "true_cx_front=0.75", "--set", "true_cy_front=0.8", "--set", "true_cy_rear=1.2")
FORMS = ("default", "robust")


def simulate(folder, name, seed, *options, maneuver="square-waves"):
    done = tselab_here("simulate", "--maneuver", maneuver, "--vehicle", "car.toml", "--out", f"{name}.csv",
                  "--truth", f"{name}.truth.csv", "--seed", seed, *TYRES, *options, cwd=folder)  # fmt: skip
    assert done.code == 0, done.err


def estimate(folder, name, *options, codes=RAN):
    done = tselab_here("estimate", f"{name}.csv", "--vehicle", "car.toml", *options, cwd=folder)
    assert done.code in codes, done.err
    return done


def errors(folder, name, first, last):
    """Relative errors over a span of time: root mean square per stiffness; and the rows that are valid, yet wrong."""
    est, truth = (pd.read_csv(folder / f"{name}.{kind}.csv") for kind in ("est", "truth"))
    span = (est["time"] >= first) & (est["time"] < last)
    wrong = {key: (est[key] / truth[f"true_{key}"] - 1)[span] for key in KEYS}
    sure = pd.concat([(wrong[k].abs() > 0.2) & (est[f"{k}_valid"][span] == 1) for k in KEYS])
    return {key: float(np.sqrt((wrong[key] ** 2).mean())) for key in KEYS}, float(sure.mean())


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """A drive on tyres unlike the settings', learnt in two forms: default.tse, robust.tse."""
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


@pytest.mark.parametrize(("form", "drive"), [("robust", "quiet"), ("default", "quiet")])
def test_the_next_drive_is_right_at_once(first, form, drive):
    """Square waves teach everything within tenths of a second: nothing to gain there."""
    estimate(first, drive, "--form", form)
    without, _ = errors(first, drive, 0, 2)
    done = estimate(first, drive, "--form", form, "--load-learnt", f"{form}.tse", "--age", 1)
    assert f"started from: {form}.tse, 1 days old (--age)" in done.out
    learnt, _ = errors(first, drive, 0, 2)
    mean = [np.mean(list(errors.values())) for errors in (without, learnt)]
    if form == "default":
        assert mean[0] > 0.1 and mean[1] < 0.05 and all(learnt[key] < 0.6 * without[key] for key in KEYS)
    else:  # particles start 1 m/s off sideways, and what they knew of the mean is soon forgotten
        assert mean[0] > 0.1 and mean[1] < 0.1 and mean[1] < 0.6 * mean[0]


@pytest.mark.parametrize("form", FORMS)
def test_a_road_that_has_changed_since_is_followed(first, form):
    estimate(first, "changed", "--form", form, "--load-learnt", f"{form}.tse", "--age", 1)
    late, sure = errors(first, "changed", 20, 30)
    assert max(late["cy_front"], late["cy_rear"]) < 0.05 and late["cx_front"] < 0.1 and sure == 0
    if form == "default":
        soon, sure = errors(first, "changed", 5, 10)
        assert max(soon["cy_front"], soon["cy_rear"]) < 0.05 and soon["cx_front"] < 0.1 and sure == 0


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
    done = tselab_here("estimate", "second.csv", "--vehicle", "bare.toml", "--particles", 64, "--seed", 9, "--load-learnt",
                  "default.tse", "--age", 1, cwd=first)  # fmt: skip
    assert done.code == 0, done.err


def files_that_are_wrong(first):
    good = (first / "default.tse").read_bytes()
    flipped = bytearray(good)
    flipped[40] ^= 4
    return {
        "damaged.tse": (bytes(flipped), "not a learnt state of this library, or damaged"),
        "short.tse": (good[:50], "not a learnt state"),
        "empty.tse": (b"", "not a learnt state"),
        "log.tse": ((first / "second.csv").read_bytes(), "not a learnt state"),
    }


def test_a_file_that_is_wrong_is_named_with_what_is_wrong_and_nothing_is_written(first):
    (first / "second.est.csv").unlink(missing_ok=True)
    for name, (data, text) in files_that_are_wrong(first).items():
        (first / name).write_bytes(data)
        done = estimate(first, "second", "--load-learnt", name, "--save-learnt", "new.tse", codes=(2,))
        assert done.err.startswith(f"tselab: error: {name}: ") and text in done.err, done.err
        assert "Traceback" not in done.err
        assert not (first / "second.est.csv").exists() and not (first / "new.tse").exists()


def test_another_vehicle_and_a_newer_format_are_told_apart(first):
    import struct
    import zlib

    car = (first / "car.toml").read_text()
    (first / "other.toml").write_text(re.sub(r"(?m)^mass\s*=.*$", "mass = 1555", car))
    done = tselab_here("estimate", "second.csv", "--vehicle", "other.toml", "--load-learnt", "default.tse", cwd=first)
    assert done.code == 2 and "default.tse: the learnt state belongs to another vehicle" in done.err
    data = (first / "default.tse").read_bytes()
    newer = data[:4] + struct.pack("<H", 4) + data[6:-4]
    (first / "newer.tse").write_bytes(newer + struct.pack("<I", zlib.crc32(newer)))
    done = estimate(first, "second", "--load-learnt", "newer.tse", codes=(2,))
    assert "newer.tse: the learnt state was written by a newer version of this library" in done.err
    older = data[:4] + struct.pack("<HH", 1, 96) + data[8:92]
    (first / "older.tse").write_bytes(older + struct.pack("<I", zlib.crc32(older)))
    done = estimate(first, "second", "--load-learnt", "older.tse", codes=(2,))
    assert "older.tse: the learnt state was written by an older version of this library; learn anew" in done.err


def test_a_bias_is_known_at_once_in_the_next_drive(first, tmp_path):
    (tmp_path / "car.toml").write_text((first / "car.toml").read_text())
    for name, seed in (("one", 1), ("two", 2)):
        done = tselab_here("simulate", "--maneuver", "square-waves", "--vehicle", "car.toml", "--out", f"{name}.csv",
                      "--set", "true_bias_yaw_rate=0.008", "--seed", seed, cwd=tmp_path)  # fmt: skip
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
        (("--load-learnt", "default.tse", "--out", "default.tse"), "--out is the same file as --load-learnt"),
        (("--save-learnt", "no/such/place.tse"), "does not exist"),
    ],
)
def test_options_that_cannot_be_are_refused(first, options, text):
    done = estimate(first, "second", *options, codes=(2,))
    assert text in done.err and "Traceback" not in done.err
