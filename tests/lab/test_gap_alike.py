"""Constant speed and gentle steering, which cannot tell delays apart: exit code 11."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import pytest

from conftest import Result, tselab
from gap_logs import car, write_log

GENTLE = "steering sine sweep 0.2 .. 3 Hz, 2 m/s2, at 20 m/s"
SEED, DELAY = 7, 0.02  # s
ALIKE = {"steering_delay", "imu_delay"}


@dataclass
class Gentle:
    """A car whose IMU is late, driven gently, at one speed."""

    log: Path
    vehicle: Path
    out: Path
    done: Result

    def run(self, out: Path, *more: object) -> Result:
        return tselab("gap", self.log, "--vehicle", self.vehicle, "--out", out, "--jobs", 1, *more)


@pytest.fixture(scope="module")
def gentle(tmp_path_factory) -> Gentle:
    folder = tmp_path_factory.mktemp("gentle")
    vehicle = car(folder)
    log = write_log(folder / "gentle.csv", vehicle, GENTLE, {"imu_delay_time": DELAY}, SEED, seconds=12.0)
    found = Gentle(log, vehicle, folder / "out", Result(0, "", ""))
    found.done = found.run(found.out)
    return found


def test_named_but_not_told_from_others_is_exit_11_in_so_many_words(gentle):
    """At one speed and without braking the car is a linear system: late wheels and a late IMU are the same thing to it."""
    assert gentle.done.code == 11, gentle.done.out + gentle.done.err
    verdict = json.loads((gentle.out / "verdict.json").read_text(encoding="utf-8"))
    assert verdict["verdict"] == "named"
    (effect,) = verdict["effects"]
    assert {effect["id"], *effect["look_alikes"]} >= ALIKE
    assert effect["parameters"]["time"]["value"] == pytest.approx(
        DELAY, rel=0.1
    )  # of a lag, too: seen below its corner
    sentence = f"These logs cannot exclude {', '.join(effect['look_alikes'])} in its place."
    assert verdict["words"][0].startswith("Stiffness at no slip") and sentence in verdict["words"][1]
    assert sentence in gentle.done.out
    assert sentence in (gentle.out / "vehicle_improved.toml").read_text(encoding="utf-8")
