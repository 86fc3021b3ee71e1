"""The gap workflow on logs whose channels are late.

One vehicle file states the latencies. One drive is so gentle that it cannot distinguish
delays.
"""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from conftest import tselab
from gap_logs import write_car, write_log
from tse.car.vehicle import read_vehicle
from tse.gaps.run import workflow
from tse.identify.data import prepare, remove_latencies

pytestmark = pytest.mark.slow

LATE = {
    "steer_angle": 0.03,
    "wheel_speed_front": 0.02,
    "wheel_speed_rear": 0.02,
    "accel_x": 0.01,
    "accel_y": -0.02,
}  # whole rows
HIDDEN = {"body_roll_gain": 0.009}


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Path, Path]]:
    """Log and vehicle file: in time; late and told; late and not told."""
    folder = tmp_path_factory.mktemp("late")
    vehicle = write_car(folder)
    log = write_log(folder / "in_time.csv", vehicle, "sweep", HIDDEN, 5, 12.0)
    table = pd.read_csv(log)
    for name, by in LATE.items():
        table[name] = table[name].shift(round(by / 0.01))
    table.dropna().to_csv(folder / "late.csv", index=False, float_format="%.9g")
    told = folder / "told.toml"
    told.write_text(vehicle.read_text() + "\n[latency]\n" + "".join(f"{k} = {v}\n" for k, v in LATE.items()))
    return {
        "in time": (log, vehicle),
        "told": (folder / "late.csv", told),
        "not told": (folder / "late.csv", vehicle),
    }


def test_a_late_log_is_read_as_one_in_time(logs: dict[str, tuple[Path, Path]]) -> None:
    """Latencies are whole rows.

    The smoothed steering differs only by the effect of the smoothing at the ends.
    """
    found = {}
    for name, (log, vehicle) in logs.items():
        read, config = workflow.read_logs([log], read_vehicle(vehicle))
        found[name] = remove_latencies(prepare(read[0], config), config)
    there = np.searchsorted(found["in time"].time, found["told"].time - 1e-6)
    steer = {who: log.inputs["steer_angle"] for who, log in found.items()}
    off = {
        who: float(np.std((steer[who] - steer["in time"][there])[200:-200])) for who in ("told", "not told")
    }
    assert off["told"] < 0.05 * off["not told"]
    assert all(np.isfinite(x).all() for x in found["told"].inputs.values())
    assert found["told"].late == {k: v for k, v in LATE.items() if k.startswith("accel")}
    assert found["in time"].late == {}


def test_an_effect_is_named_with_its_size_when_latencies_are_told(logs: dict[str, tuple[Path, Path]]) -> None:
    """With the latencies given, the result is that of the log that is in time.

    Without them, a latency is found, and no physical effect that does not exist.
    """
    results = {name: workflow.run_workflow([log], vehicle, jobs=2) for name, (log, vehicle) in logs.items()}
    named = {
        name: {n.effect.id: n for n in r.naming.named} if r.verdict == "named" else {}
        for name, r in results.items()
    }
    assert list(named["in time"]) == list(named["told"]) == ["body_roll"]
    sizes = [named[name]["body_roll"].values["body_roll_gain"] for name in ("in time", "told")]
    assert sizes[1] == pytest.approx(sizes[0], rel=0.05)
    assert sizes[0] == pytest.approx(HIDDEN["body_roll_gain"], rel=0.15)
    verdict = results["not told"].as_json()
    assert verdict["sensors"] or "imu_delay" in named["not told"] or "steering_delay" in named["not told"]
    physics = {
        n.effect.id
        for n in results["not told"].naming.named
        if n.effect.occurrence != "SENSOR" and not n.message
    }
    assert physics <= {"body_roll"}, results["not told"].words


GENTLE, DELAY = "steering sine sweep 0.2 .. 3 Hz, 2 m/s2, at 20 m/s", 0.02  # s
ALIKE = {"steering_delay", "imu_delay"}


def test_named_but_not_told_from_others_is_exit_11_in_so_many_words(tmp_path: Path) -> None:
    """At one speed and without braking the car is a linear system.

    There, late wheels and a late IMU have the same effect.
    """
    vehicle, out = write_car(tmp_path), tmp_path / "out"
    log = write_log(tmp_path / "gentle.csv", vehicle, GENTLE, {"imu_delay_time": DELAY}, 7, seconds=12.0)
    done = tselab("gap", "--verbose", log, "--vehicle", vehicle, "--out", out, "--jobs", 1)
    assert done.code == 11, done.out + done.err
    verdict = json.loads((out / "verdict.json").read_text(encoding="utf-8"))
    assert verdict["verdict"] == "named"
    (effect,) = verdict["effects"]
    assert {effect["id"], *effect["look_alikes"]} >= ALIKE
    assert effect["parameters"]["time"]["value"] == pytest.approx(
        DELAY, rel=0.1
    )  # of a lag, too: seen below its corner
    sentence = f"These logs cannot exclude {', '.join(effect['look_alikes'])} in its place."
    assert verdict["words"][0].startswith("Stiffness at no slip") and sentence in verdict["words"][1]
    assert sentence in done.out
    assert sentence in (out / "vehicle_improved.toml").read_text(encoding="utf-8")
