"""The demonstration's log as a measuring system would have made it: an MF4 with four wheels in km/h, the steering wheel in degrees,
three rates, latencies and names of its own; then what a user does with it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from tse.impl.core import STIFFNESS
from tse.impl.estimate import estimate_to
from tse.impl.files import atomic
from tse.impl.fleet.single import prepare
from tse.impl.logs.propose import propose
from tse.impl.logs.propose.text import toml_text
from tse.impl.logs.readers import read_recording
from tse.impl.logs.readers.recording import need
from tse.impl.rows import Reading
from tse.impl.vehicle import read_vehicle
from tse.impl.verdict import NAMES

RATIO, TRACK = 15.3, 1.55  # m
DEG, G = 180 / np.pi, 9.80665
GROUPS = {  # group of the MF4: rows of the clean log per entry, latency in s, channels with their units
    "LWI": (4, 0.030, {"LWI_Lenkradwinkel": "deg"}),
    "ESP_wheels": (2, 0.040, dict.fromkeys(("ESP_VL", "ESP_VR", "ESP_HL", "ESP_HR"), "km/h")),
    "IMU": (1, 0.010, {"Gierrate": "deg/s", "Querbeschl": "g", "Laengsbeschl": "m/s2"}),
}
LAST = 12.0  # s at the end over which the estimates are compared


@dataclass(frozen=True)
class Logger:
    """What came of it. `off`: estimate over that from the clean log, less 1, at the end of the drive."""

    found: dict[str, str]  # channel -> what it was guessed from
    late: float  # s by which the wheels were found to be behind the gyro
    off: dict[str, float]


def run_logger(out: Path, log: pd.DataFrame, vehicle: str, clean: pd.DataFrame) -> Logger:
    """Write car.toml and drive.mf4, have signals.toml proposed, estimate. `log`: the clean rows; `vehicle`: the text of the vehicle
    file; `clean`: what was estimated from them. UserError: no library for MF4."""

    need("asammdf", "mf4", "the demonstration of an MF4")
    out.mkdir(parents=True, exist_ok=True)
    with atomic(out / "car.toml") as file:
        file.write(f"steering_ratio = {RATIO}\n{vehicle}")
    car = read_vehicle(out / "car.toml")
    write_mf4(out / "drive.mf4", log, car.values)
    recording = read_recording(out / "drive.mf4")
    proposal = propose(recording, car)
    with atomic(out / "signals.toml") as file:
        file.write(toml_text(recording, proposal))
    prepared = prepare(out / "drive.mf4", out / "car.toml", None, None, {}, "default", {}, Reading())
    est = estimate_to(out / "est.csv", prepared.log, prepared.config)

    def end(table: pd.DataFrame) -> pd.Series:
        return table[table["time"] > table["time"].iloc[-1] - LAST][list(STIFFNESS)].mean()

    off = end(est.table) / end(clean) - 1
    wheels = next((g.latency for g in proposal.guesses if g.channel == "wheel_speed_rear"), float("nan"))
    return Logger({g.channel: " and ".join(g.name) for g in proposal.guesses}, wheels, off.to_dict())


def write_mf4(path: Path, log: pd.DataFrame, car: dict[str, float]) -> None:
    """The log as that of a measuring system."""
    from asammdf import MDF, Signal

    d = {name: log[name].to_numpy(float) for name in log}
    side = 0.5 * TRACK * d["yaw_rate"]
    front, rear = (d[f"wheel_speed_{a}"] * car[f"wheel_radius_{a}"] for a in ("front", "rear"))
    value = {
        "LWI_Lenkradwinkel": DEG * RATIO * d["steer_angle"],
        "ESP_VL": 3.6 * (front - side), "ESP_VR": 3.6 * (front + side),
        "ESP_HL": 3.6 * (rear - side), "ESP_HR": 3.6 * (rear + side),
        "Gierrate": DEG * d["yaw_rate"], "Querbeschl": d["accel_y"] / G, "Laengsbeschl": d["accel_x"],
    }  # fmt: skip
    with MDF(version="4.10") as mdf:
        for group, (every, latency, units) in GROUPS.items():
            time = d["time"][::every] + latency
            mdf.append([Signal(value[n][::every], time, unit=u, name=n) for n, u in units.items()], acq_name=group)
        mdf.save(path, overwrite=True)


def logger_summary(made: Logger, out: Path) -> str:
    """In plain words."""
    true = GROUPS["ESP_wheels"][1] - GROUPS["IMU"][1]
    off = ", ".join(f"{NAMES[key].lower()} {100 * x:+.1f} %" for key, x in made.off.items())
    return "\n".join(
        [
            "The same drive as a measuring system logs it: an MF4, four wheels in km/h, steering wheel in degrees, three rates, "
            "latencies.",
            f"tselab signals finds {len(made.found)} of 6 channels; the wheels {1e3 * made.late:.0f} ms behind the gyro "
            f"({1e3 * true:.0f} ms are true).",
            f"Against the estimates from the clean log, last {LAST:g} s: {off}.",
            f"Written to {out}: car.toml, drive.mf4, signals.toml, est.csv",
        ]
    )
