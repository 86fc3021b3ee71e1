"""One drive in the files of the trade: VBOX, tables and bus logs as many tools write them.

All is written here line by line, as the tools do it. No library writes these."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd

from log_formats import DEG, RADIUS, RATIO, TRACK

G = 9.80665
EPOCH = 1_700_000_000.0  # s: of stamps that are a date
MIDNIGHT = 10 * 3600 + 59 * 60 + 40.0  # s: a drive that goes over an hour
CORNERS = ("fl", "fr", "rl", "rr")


def si(clean: pd.DataFrame, seconds: float = 40.0) -> pd.DataFrame:
    """The drive at 50 Hz with four wheels, m/s; all else in SI units, positive to the left."""
    rows = clean[clean.time < seconds].iloc[::2].reset_index(drop=True)
    table = rows[["time", "steer_angle", "accel_x", "accel_y", "yaw_rate"]].copy()
    for axle, letter in (("front", "f"), ("rear", "r")):
        for side, sign in (("l", -1), ("r", 1)):
            table[letter + side] = rows[f"wheel_speed_{axle}"] * RADIUS[axle] + sign * 0.5 * TRACK * rows.yaw_rate
    return table


def packed(time: Iterable[float]) -> list[str]:
    """Times of day as HHMMSS.sss."""
    whole = [round(1e3 * t) for t in time]
    return [f"{t // 3_600_000:02d}{t // 60_000 % 60:02d}{t // 1000 % 60:02d}.{t % 1000:03d}" for t in whole]


def write_vbo(path: Path, drive: pd.DataFrame, wheels: bool = True, start: float = MIDNIGHT) -> Path:
    """A file of a VBOX: yaw rate and lateral acceleration positive to the right, velocity across the car, too."""
    course = np.degrees(-np.cumsum(drive.yaw_rate) * 0.02) % 360.0
    speed = drive[list(CORNERS)].mean(axis=1)
    across = 0.9 * drive.yaw_rate - 0.0035 * speed * drive.accel_y
    columns = {"SWA": (RATIO * drive.steer_angle, "rad"), "YawRate": (-DEG * drive.yaw_rate, "°/s"),
               "X_Accel": (drive.accel_x / G, "g"), "Y_Accel": (-drive.accel_y / G, "g")}  # fmt: skip
    if wheels:
        columns |= {f"{c.upper()}whlspd": (drive[c], "m/s") for c in CORNERS}
    columns["Lat._Vel."] = -3.6 * across, "km/h"
    head = ["satellites", "time", "latitude", "longitude", "velocity kmh", "heading", "height", "vertical velocity kmh"]
    lines = ["File created on 01/01/2025 @ 11:00", "", "[header]", *head, *columns, "", "[channel units]",
             *(u for _, u in columns.values()), "", "[comments]", "Log Rate (Hz) : 50.00", "", "[column names]",
             "sats time lat long velocity heading height vert-vel " + " ".join(columns), "", "[data]"]  # fmt: skip
    for i, stamp in enumerate(packed(start + drive.time)):
        cells = [f"{x.iloc[i]:+.6E}" for x, _ in columns.values()]
        lines.append(f"074 {stamp} +3000.00000 -0600.00000 {3.6 * speed.iloc[i]:07.3f} {course.iloc[i]:06.2f} +0010.00 +000.00 "
                     + " ".join(cells))  # fmt: skip
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode("cp1252"))
    return path
