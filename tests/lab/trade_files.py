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


# ---- Frames of a bus

DBC = """VERSION ""

NS_ :

BS_:

BU_: A B

BO_ 100 ESC_1: 8 A
 SG_ YawRate : 0|16@1- (0.01,0) [-327|327] "deg/s" B
 SG_ LateralAcceleration : 16|16@1- (0.001,0) [-32|32] "m/s2" B
 SG_ LongitudinalAcceleration : 32|16@1- (0.001,0) [-32|32] "m/s2" B
 SG_ ESC_1_Counter : 48|4@1+ (1,0) [0|14] "" B
 SG_ ESC_1_Qualifier : 52|2@1+ (1,0) [0|3] "" B

BO_ 101 ESC_2: 8 A
 SG_ WheelSpeedFL : 0|15@1+ (0.01,0) [0|327] "km/h" B
 SG_ WheelSpeedFR : 16|15@1+ (0.01,0) [0|327] "km/h" B
 SG_ WheelSpeedRL : 32|15@1+ (0.01,0) [0|327] "km/h" B
 SG_ WheelSpeedRR : 48|15@1+ (0.01,0) [0|327] "km/h" B

BO_ 102 SAS_1: 4 A
 SG_ SteeringWheelAngle : 0|16@1- (0.1,0) [-780|780] "deg" B
 SG_ SAS_1_Counter : 16|4@1+ (1,0) [0|14] "" B

"""
ODD_LINES = {
    "a comment without a signal": 'CM_ SG_ 100 "no signal is named";',
    "a comment without a kind": 'CM_ 100 "no BO_";',
    "a value table of no signal": 'VAL_ 100 NotThere 1 "On" 0 "Off" ;',
    "a name that begins with a digit": 'BO_ 1275 2017_5: 8 A\n SG_ 0_COUNTER : 0|4@1+ (1,0) [0|15] "" B',
    "a factor that begins with a point": 'BO_ 300 X: 8 A\n SG_ T : 0|13@1+ (.25,-500) [-500|1547] "Nm" B',
    "an identifier of a standard frame that is too long": 'BO_ 316495015 LongId: 8 A\n SG_ T2 : 0|8@1+ (1,0) [0|255] "" B',
    "a message behind the comments": 'CM_ SG_ 100 YawRate "of the car";\nBO_ 301 Y: 8 A\n SG_ T3 : 0|8@1+ (1,0) [0|255] "" B',
    "a quote that is not closed": 'CM_ SG_ 100 YawRate "of the car;',
    "a signal that is cut": "BO_ 302 Z: 8 A\n SG_ T4 : 0|8@1+ (1,) [0|1] B",
}  # fmt: skip


def frames(drive: pd.DataFrame, qualifier: np.ndarray | None = None) -> list[tuple[float, int, bytes]]:
    """Time, identifier and bytes of each frame: three messages each 20 ms, counters of 0 .. 14."""

    def packed_as(value: pd.Series, step: float) -> np.ndarray:
        return np.round(value.to_numpy() / step).astype(int)

    yaw, lateral, along = (packed_as(drive[c] * k, s) for c, k, s in
                           (("yaw_rate", DEG, 0.01), ("accel_y", 1.0, 0.001), ("accel_x", 1.0, 0.001)))  # fmt: skip
    angle = packed_as(drive.steer_angle * DEG * RATIO, 0.1)
    wheels = [packed_as(3.6 * drive[c], 0.01) for c in CORNERS]
    found = []
    for i, t in enumerate(drive.time):
        state = (0 if qualifier is None else int(qualifier[i])) << 4 | i % 15
        esc = b"".join(int(x[i]).to_bytes(2, "little", signed=True) for x in (yaw, lateral, along)) + bytes([state, 0])
        found.append((t, 100, esc))
        found.append((t + 0.0005, 101, b"".join(int(x[i]).to_bytes(2, "little") for x in wheels)))
        found.append((t + 0.001, 102, int(angle[i]).to_bytes(2, "little", signed=True) + bytes([i % 15, 0])))
    return found


def write_candump(path: Path, sent: list[tuple[float, int, bytes]], database: str = DBC) -> Path:
    """The log of candump -l, and the database beside it."""
    path.write_text("".join(f"({EPOCH + t:.6f}) can0 {i:03X}#{d.hex().upper()}\n" for t, i, d in sent))
    (path.parent / "car.dbc").write_text(database, encoding="cp1252")
    return path
