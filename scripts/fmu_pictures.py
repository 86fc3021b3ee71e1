#!/usr/bin/env python3
"""Pictures of the FMUs. The same bytes every time.

    .venv/bin/python scripts/fmu_pictures.py study    the paper's study through both FMUs, connected: scripts/results/fmu.png
    .venv/bin/python scripts/fmu_pictures.py icons    what importers show: fmu/*/model.png

The study runs the FMUs of build/fmu (`cmake --build --preset fmu`).
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

from tselab.core import STIFFNESS
from tselab.figures import demo_picture, estimator_icon, vehicle_icon
from tselab.verdict import NAMES

ROOT = Path(__file__).resolve().parent.parent
BUILT = ROOT / "build" / "fmu" / "fmu"
DURATION, STEP = 60.0, 0.01  # s
ROAD_CHANGE = (30.0, 0.7)  # s, level
START = 0.7  # of nominal
CHANNELS = ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")


class Fmu:
    """One instance, its variables by name."""

    def __init__(self, path: Path, parameters: dict[str, float], known: bool = False):
        about = read_model_description(str(path))
        self.at = {v.name: v.valueReference for v in about.modelVariables}
        self.folder = extract(str(path))
        identifier = about.coSimulation.modelIdentifier
        self.fmu = FMU2Slave(
            guid=about.guid, unzipDirectory=self.folder, modelIdentifier=identifier, instanceName=identifier
        )
        self.fmu.instantiate()
        self.set(parameters)
        if known:  # the car, but for its tyres
            self.fmu.setBoolean([self.at["vehicle.calibrated"]], [True])
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def set(self, values: dict[str, float]) -> None:
        self.fmu.setReal([self.at[name] for name in values], list(values.values()))

    def get(self, names: list[str]) -> list[float]:
        return list(self.fmu.getReal([self.at[name] for name in names]))

    def flags(self, names: list[str]) -> list[bool]:
        return [bool(x) for x in self.fmu.getBoolean([self.at[name] for name in names])]

    def close(self) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)


def study() -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Square waves in steering and torque; estimates, truth and log, row by row. The estimate of a row is what the estimator
    puts out at the next communication point."""
    car = Fmu(BUILT / "SingleTrackVehicle.fmu", {})
    estimator = Fmu(BUILT / "TireStiffnessEstimator.fmu", {f"filter.initial_{s}": START for s in STIFFNESS}, True)
    means = [f"estimate.{s}{end}" for s in STIFFNESS for end in ("", "_sd")]
    valid = [f"estimate.{s}_valid" for s in STIFFNESS]
    true = ["true.vel_x", *(f"true.{s}" for s in STIFFNESS)]
    rows = []
    for k in range(round(DURATION / STEP)):
        time = k * STEP
        steer = 0.02 if k % 400 < 200 else -0.02
        torque = 700.0 if k % 500 < 250 else -700.0
        level = ROAD_CHANGE[1] if time + STEP > ROAD_CHANGE[0] else 1.0
        sample, truth, at = car.get([f"sensor.{c}" for c in CHANNELS]), car.get(true), time
        estimator.set(dict(zip(CHANNELS, sample, strict=True)))
        car.set({"steer_angle": steer, "wheel_torque_front": torque, "road_level": level})
        car.fmu.doStep(time, STEP)
        estimator.fmu.doStep(time, STEP)
        rows.append([at, *sample, *truth, *estimator.get(means), *estimator.flags(valid)])
    car.close()
    estimator.close()
    table = pd.DataFrame(rows, columns=["time", *CHANNELS, *true, *means, *valid])
    est = table[["time", *means, *valid]].rename(columns=lambda name: name.removeprefix("estimate."))
    truth = table[true].rename(columns=lambda name: name.replace(".", "_"))
    truth["road_level"] = np.where(table["time"] > ROAD_CHANGE[0] - STEP / 2, ROAD_CHANGE[1], 1.0)
    return est, truth, table[list(CHANNELS)]


def main() -> int:
    what = sys.argv[1:]
    if what == ["icons"]:
        estimator_icon(ROOT / "fmu" / "TireStiffnessEstimator" / "model.png")
        vehicle_icon(ROOT / "fmu" / "SingleTrackVehicle" / "model.png")
    elif what == ["study"]:
        est, truth, log = study()
        demo_picture(ROOT / "scripts" / "results" / "fmu.png", est, truth, log)
        print("| | RMS error, 10 s to the road change | RMS error, last 20 s | valid |\n|---|---:|---:|---:|")
        time = est["time"]
        for s in STIFFNESS:
            error = est[s] / truth[f"true_{s}"] - 1
            parts = (time >= 10) & (time < ROAD_CHANGE[0] - STEP / 2), time >= DURATION - 20
            rms = [100 * np.sqrt((error[part] ** 2).mean()) for part in parts]
            print(
                f"| {NAMES[s]} | {rms[0]:.2f} % | {rms[1]:.2f} % | {100 * est[f'{s}_valid'].mean():.0f} % of the time |"
            )
    else:
        print(__doc__, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
