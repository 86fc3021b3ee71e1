"""One drive in the files of other tools: VBOX, tables and bus logs.

All files are written here line by line, as these tools write them, without libraries."""

import base64
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd

from log_formats import DEG, RADIUS, RATIO, TRACK

G = 9.80665
EPOCH = 1_700_000_000.0  # s; added to stamps that are dates
MIDNIGHT = 10 * 3600 + 59 * 60 + 40.0  # s; start of a drive across a full hour
CORNERS = ("fl", "fr", "rl", "rr")


def add_wheels(clean: pd.DataFrame, seconds: float = 40.0) -> pd.DataFrame:
    """Return the drive at 50 Hz with four wheels, m/s; SI units, positive to the left."""
    rows = clean[clean.time < seconds].iloc[::2].reset_index(drop=True)
    table = rows[["time", "steer_angle", "accel_x", "accel_y", "yaw_rate"]].copy()
    for axle, letter in (("front", "f"), ("rear", "r")):
        for side, sign in (("l", -1), ("r", 1)):
            table[letter + side] = (
                rows[f"wheel_speed_{axle}"] * RADIUS[axle] + sign * 0.5 * TRACK * rows.yaw_rate
            )
    return table


def pack_times(time: Iterable[float]) -> list[str]:
    """Return times of day as HHMMSS.sss."""
    whole = [round(1e3 * t) for t in time]
    return [f"{t // 3_600_000:02d}{t // 60_000 % 60:02d}{t // 1000 % 60:02d}.{t % 1000:03d}" for t in whole]


def write_vbo(
    path: Path, drive: pd.DataFrame, wheels: bool = True, start: float = MIDNIGHT, more: bool = False
) -> Path:
    """Write a VBOX file, with lateral signals and yaw rate positive to the right.

    `more`: add signals of an INS and of the car's bus, many with similar names."""
    course = np.degrees(-np.cumsum(drive.yaw_rate) * 0.02) % 360.0
    speed = drive[list(CORNERS)].mean(axis=1)
    across = 0.9 * drive.yaw_rate - 0.0035 * speed * drive.accel_y
    columns = {"SWA": (RATIO * drive.steer_angle, "rad"), "YawRate": (-DEG * drive.yaw_rate, "°/s"),
               "X_Accel": (drive.accel_x / G, "g"), "Y_Accel": (-drive.accel_y / G, "g")}  # fmt: skip
    if wheels:
        columns |= {f"{c.upper()}whlspd": (drive[c], "m/s") for c in CORNERS}
    columns["Lat._Vel."] = -3.6 * across, "km/h"
    if more:
        noise = np.random.default_rng(4).normal(size=(8, len(drive)))
        slip = -DEG * across / speed
        columns |= {
            n: (pd.Series(s * x), u)
            for x, (n, s, u) in zip(
                noise,
                (
                    ("RollRate1", 0.02, "rad/s"),
                    ("PitchRate", 0.5, "°/s"),
                    ("Pitch_Ang.", 0.3, "°"),
                    ("Lng_Jerk", 0.1, "g/s"),
                    ("Lat_Jerk", 0.1, "g/s"),
                    ("T1", 1.0, "s"),
                    ("AccrPedlLnn", 9.0, "%"),
                    ("Temp", 0.1, "°C"),
                ),
                strict=True,
            )
        }
        columns |= {f"Slip_{c.upper()}": (slip, "°") for c in CORNERS} | {
            "Slip_Angle": (slip, "°"),
            "Slip_COG": (slip, "°"),
            "True_Head": (course + 5.0, "°"),
            "Head_imu": (course, "°"),
            "Roll_Angle": (-0.3 * drive.accel_y, "°"),
            "PtTqAtW_FL": (900 * drive.accel_x, "Nm"),
            "PtGearAct": (3.0 + np.sign(drive.yaw_rate), ""),
            "VehSpdLgt": (speed, "m/s"),
            "Lng._Vel.": (3.6 * speed, "km/h"),
            "Pos.Qual.": (0.0 * speed + 4.0, ""),
        }
    head = [
        "satellites",
        "time",
        "latitude",
        "longitude",
        "velocity kmh",
        "heading",
        "height",
        "vertical velocity kmh",
    ]
    lines = [
        "File created on 01/01/2025 @ 11:00",
        "",
        "[header]",
        *head,
        *columns,
        "",
        "[channel units]",
        *(u for _, u in columns.values()),
        "",
        "[comments]",
        "Log Rate (Hz) : 50.00",
        "",
        "[column names]",
        "sats time lat long velocity heading height vert-vel " + " ".join(columns),
        "",
        "[data]",
    ]
    for i, stamp in enumerate(pack_times(start + drive.time)):
        cells = [f"{x.iloc[i]:+.6E}" for x, _ in columns.values()]
        lines.append(
            f"074 {stamp} +3000.00000 -0600.00000 {3.6 * speed.iloc[i]:07.3f} {course.iloc[i]:06.2f} "
            f"+0010.00 +000.00 {' '.join(cells)}"
        )
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
    "an identifier of a standard frame that is too long": (
        'BO_ 316495015 LongId: 8 A\n SG_ T2 : 0|8@1+ (1,0) [0|255] "" B'
    ),
    "a message behind the comments": (
        'CM_ SG_ 100 YawRate "of the car";\nBO_ 301 Y: 8 A\n SG_ T3 : 0|8@1+ (1,0) [0|255] "" B'
    ),
    "a quote that is not closed": 'CM_ SG_ 100 YawRate "of the car;',
    "a signal that is cut": "BO_ 302 Z: 8 A\n SG_ T4 : 0|8@1+ (1,) [0|1] B",
}


def encode_frames(drive: pd.DataFrame, qualifier: np.ndarray | None = None) -> list[tuple[float, int, bytes]]:
    """Return time, identifier, bytes of frames: three each 20 ms, counters 0 .. 14."""

    def packed_as(value: pd.Series, step: float) -> np.ndarray:
        return np.round(value.to_numpy() / step).astype(int)

    yaw, lateral, along = (
        packed_as(drive[c] * k, s)
        for c, k, s in (("yaw_rate", DEG, 0.01), ("accel_y", 1.0, 0.001), ("accel_x", 1.0, 0.001))
    )
    angle = packed_as(drive.steer_angle * DEG * RATIO, 0.1)
    wheels = [packed_as(3.6 * drive[c], 0.01) for c in CORNERS]
    found = []
    for i, t in enumerate(drive.time):
        state = (0 if qualifier is None else int(qualifier[i])) << 4 | i % 15
        esc = b"".join(int(x[i]).to_bytes(2, "little", signed=True) for x in (yaw, lateral, along)) + bytes(
            [state, 0]
        )
        found.append((t, 100, esc))
        found.append((t + 0.0005, 101, b"".join(int(x[i]).to_bytes(2, "little") for x in wheels)))
        found.append((t + 0.001, 102, int(angle[i]).to_bytes(2, "little", signed=True) + bytes([i % 15, 0])))
    return found


def write_candump(path: Path, sent: list[tuple[float, int, bytes]], database: str = DBC) -> Path:
    """Write the log of candump -l, and the database beside it."""
    path.write_text("".join(f"({EPOCH + t:.6f}) can0 {i:03X}#{d.hex().upper()}\n" for t, i, d in sent))
    (path.parent / "car.dbc").write_text(database, encoding="cp1252")
    return path


# ---- MF4 with a clock per group


def write_groups(path: Path, drive: pd.DataFrame, ahead: float = 0.0, per_second: float = 1.0) -> Path:
    """Write three groups: IMU, wheels, steering.

    `ahead`: lead of the wheels' clock, s; `per_second`: unit of the times."""
    from asammdf import MDF, Signal

    groups = [
        {
            "LateralAcc": (drive.accel_y, "m/s^2"),
            "LongAcc": (drive.accel_x, "m/s^2"),
            "YawRate": (drive.yaw_rate, "rad/s"),
        },
        {f"WheelSpeed{c.upper()}": (3.6 * drive[c], "km/h") for c in CORNERS},
        {"SteeringWheelAngle": (DEG * RATIO * drive.steer_angle, "deg")},
    ]
    with MDF(version="4.10") as made:
        for i, group in enumerate(groups):
            time = (drive.time.to_numpy() + (ahead if i == 1 else 0.0)) * per_second
            made.append([Signal(x.to_numpy(), time, unit=u, name=n) for n, (x, u) in group.items()])
        made.save(path, overwrite=True)
    return path


# ---- Tables


def make_columns(drive: pd.DataFrame) -> dict[str, tuple[pd.Series, str]]:
    """Return the columns of a table with their units."""
    columns = {
        "steering_angle": (DEG * RATIO * drive.steer_angle, "deg"),
        "lateral_acc": (drive.accel_y / G, "G"),
        "longitudinal_acc": (drive.accel_x / G, "G"),
        "yaw_rate": (DEG * drive.yaw_rate, "deg/s"),
    }
    return columns | {f"wheel_speed_{c}": (drive[c], "m/s") for c in CORNERS}


def write_racechrono(path: Path, drive: pd.DataFrame) -> Path:
    """Write names, units and sources below a preamble; stamps are whole seconds."""
    columns = make_columns(drive)
    lines = [
        "This file is created using an app.",
        "Format,3",
        'Session title,"Track X, day 1"',
        "Session type,Lap timing",
        "Created,04/05/2025,10:00",
        "Note,",
        "",
        "timestamp,fragment_id,lap_number,elapsed_time," + ",".join(columns),
        "unix time,,,s," + ",".join(u for _, u in columns.values()),
        ",,,," + ",".join(["200: canbus", "300: acc", "300: acc", "400: gyro", *["200: canbus"] * 4]),
    ]
    for i, t in enumerate(drive.time):
        lines.append(
            f"{EPOCH + t:.0f},0,1,{t:.2f}," + ",".join(f"{x.iloc[i]:.9g}" for x, _ in columns.values())
        )
    path.write_text("\n".join(lines) + "\n")
    return path


def write_long(path: Path, drive: pd.DataFrame, cars: tuple[str, ...] = ("CAR-1",)) -> Path:
    """Write a row per value."""
    lines = ["timestamp,vehicle_id,telemetry_name,telemetry_value"]
    stamps = pd.to_datetime(EPOCH + drive.time, unit="s").dt.strftime("%Y-%m-%dT%H:%M:%S.%f").str[:-3] + "Z"
    for i, stamp in enumerate(stamps):
        for name, (x, _) in make_columns(drive).items():
            lines += [f"{stamp},{car},{name},{x.iloc[i]:.9g}" for car in cars]
    path.write_text("\n".join(lines) + "\n")
    return path


# ---- Text logs of buses, by the tool that writes them


def _format_hex(data: bytes, between: str = " ") -> str:
    return between.join(f"{b:02X}" for b in data)


def _format_clock(t: float, digits: int) -> str:
    whole = round(10**digits * (MIDNIGHT + t))
    s, part = divmod(whole, 10**digits)
    return f"{s // 3600:02d}:{s // 60 % 60:02d}:{s % 60:02d}:{part:0{digits}d}"


def _format_asc(
    sent: list[tuple[float, int, bytes]], mode: str = "absolute", start: float = 0.0, mark: str = "."
) -> str:
    head = [
        "date Mit Mär 6 01:21:51.000 pm 2024",
        f"base hex  timestamps {mode}",
        "internal events logged",
        "// Prüfstand",
        "Begin Triggerblock Mit Mär 6 01:21:51.000 pm 2024",
        "   0.000000 Start of measurement",
    ]
    lines, before = [], 0.0
    for t, i, d in sent:
        stamp = t - before if mode == "relative" else t + start
        before = t
        lines.append(
            f"{stamp:.6f}".replace(".", mark) + f" 1  {i:X}             Rx   d {len(d)} {_format_hex(d)}"
        )
    return "\n".join([*head, *lines, "End TriggerBlock", ""])


def _format_candump(sent: list[tuple[float, int, bytes]], stamp: str) -> str:
    lines, before = [], 0.0
    for t, i, d in sent:
        text = {
            "absolute": f"({EPOCH + t:.6f}) ",
            "delta": f"({t - before:010.6f}) ",
            "zero": f"({t:010.6f}) ",
            "none": "",
            "date": f"({pd.Timestamp(EPOCH + t, unit='s'):%Y-%m-%d %H:%M:%S.%f}) ",
        }[stamp]
        before = t
        lines.append(f" {text} can0  {i:03X}   [{len(d)}]  {_format_hex(d)}")
    return "\n".join([*lines, ""])


def _format_busmaster(sent: list[tuple[float, int, bytes]], base: str = "HEX", mode: str = "SYSTEM") -> str:
    head = [
        "***BUSMASTER Ver 3.2.2***",
        "***PROTOCOL CAN***",
        "***NOTE: PLEASE DO NOT EDIT THIS DOCUMENT***",
        "***[START LOGGING SESSION]***",
        "***START DATE AND TIME 12:6:2024 10:59:40:000***",
        f"***{base}***",
        f"***{mode} MODE***",
        "***START CHANNEL BAUD RATE***",
        "***CHANNEL 1 - Adapter - 500000 bps***",
        "***END CHANNEL BAUD RATE***",
        "***<Time><Tx/Rx><Channel><CAN ID><Type><DLC><DataBytes>***",
    ]
    of = (lambda d: _format_hex(d)) if base == "HEX" else (lambda d: " ".join(str(b) for b in d))
    before = [0.0, *(t for t, _, _ in sent)]
    stamps = [
        _format_clock(t - b - MIDNIGHT if mode == "RELATIVE" else t, 4)
        for (t, _, _), b in zip(sent, before, strict=False)
    ]
    lines = [
        f"{c} Rx 1 {f'0x{i:03X}' if base == 'HEX' else i} s {len(d)} {of(d)}"
        for c, (_, i, d) in zip(stamps, sent, strict=True)
    ]
    return "\n".join([*head, *lines, "***[STOP LOGGING SESSION]***", ""])


def _format_trc(sent: list[tuple[float, int, bytes]], version: str) -> str:
    head = [] if version == "1.0" else [f";$FILEVERSION={version}", ";$STARTTIME=45000.5"]
    head += {"2.0": [";$COLUMNS=N,O,T,I,d,l,D"], "2.1": [";$COLUMNS=N,O,T,B,I,d,R,L,D"]}.get(
        version, [";  Prüfstand"]
    )
    lines = []
    for n, (t, i, d) in enumerate(sent, 1):
        before = {"1.0": "", "1.1": "Rx", "1.2": "1 Rx", "1.3": "1 Rx", "2.0": "DT", "2.1": "DT 1"}[version]
        between = {"1.3": "-", "2.0": "Rx", "2.1": "Rx -"}.get(version, "")
        number = f"{n:7d}" if version >= "2" else f"{n:6d})"
        lines.append(f"{number} {1e3 * t:11.3f} {before} {i:04X} {between} {len(d)} {_format_hex(d)}")
    return "\n".join([*head, *lines, ""])


def _format_table(sent: list[tuple[float, int, bytes]], title: str, row: str) -> str:
    lines = [
        row.format(
            t=t,
            e=EPOCH + t,
            ms=1e3 * t,
            i=i,
            n=len(d),
            h=_format_hex(d, ""),
            s=_format_hex(d),
            x=",".join(f"{b:02X}" for b in d),
            us=round(1e6 * t) + 166064000,
            b=base64.b64encode(d).decode(),
            c=_format_clock(t, 6)[::-1].replace(":", ".", 1)[::-1],
        )
        for t, i, d in sent
    ]
    return "\n".join([title, *lines, ""])


BUS_LOGS = {  # suffix, writer
    "ASC": (".asc", lambda s: _format_asc(s)),
    "ASC of cp1252": (".asc", lambda s: _format_asc(s)),
    "ASC with relative stamps": (".asc", lambda s: _format_asc(s, "relative")),
    "ASC with stamps below 0": (".asc", lambda s: _format_asc(s, start=-20.0)),
    "ASC with decimal commas": (".asc", lambda s: _format_asc(s, mark=",")),
    "ASC under another suffix": (".txt", lambda s: _format_asc(s)),
    "candump -l": (
        ".log",
        lambda s: "".join(f"({EPOCH + t:.6f}) can0 {i:03X}#{_format_hex(d, '')}\n" for t, i, d in s),
    ),
    "candump -l with R": (
        ".log",
        lambda s: "".join(f"({EPOCH + t:.9f}) can0 {i:03X}#{_format_hex(d, '')} R\n" for t, i, d in s),
    ),
    "candump -ta": (".txt", lambda s: _format_candump(s, "absolute")),
    "candump -td": (".log", lambda s: _format_candump(s, "delta")),
    "candump -tz": (".txt", lambda s: _format_candump(s, "zero")),
    "candump -tA": (".txt", lambda s: _format_candump(s, "date")),
    "candump -x": (".txt", lambda s: _format_candump(s, "absolute").replace("can0 ", "can0  RX - - ")),
    "candump -l of CAN FD": (
        ".log",
        lambda s: "".join(f"({EPOCH + t:.6f}) can0 {i:03X}##1{_format_hex(d, '')}\n" for t, i, d in s),
    ),
    "CANedge CSV": (
        ".csv",
        lambda s: _format_table(
            s,
            "TimestampEpoch;BusChannel;ID;IDE;DLC;DataLength;Dir;EDL;BRS;ESI;RTR;DataBytes",
            "{e:.6f};1;{i:X};0;{n};{n};0;0;0;0;0;{h}",
        ),
    ),
    "Cabana CSV": (".csv", lambda s: _format_table(s, "time,addr,bus,data", "{t:.6f},0x{i:x},0,0x{h}")),
    "CSV of PCAN-View": (
        ".csv",
        lambda s: _format_table(
            s,
            ";Message Number,Time Offset (ms),Type,ID (hex),Data Length,Data (hex)",
            "1,{ms:.3f},Rx,{i:04X},{n},{s}",
        ),
    ),
    "CSV with a time of day": (
        ".csv",
        lambda s: _format_table(s, "Time,Channel,ID,DLC,Data", "{c},1,0x{i:03X},{n},{s}"),
    ),
    "TRC 1.0": (".trc", lambda s: _format_trc(s, "1.0")),
    "TRC 1.1": (".trc", lambda s: _format_trc(s, "1.1")),
    "TRC 1.2": (".trc", lambda s: _format_trc(s, "1.2")),
    "TRC 1.3": (".trc", lambda s: _format_trc(s, "1.3")),
    "TRC 2.0": (".trc", lambda s: _format_trc(s, "2.0")),
    "TRC 2.1": (".trc", lambda s: _format_trc(s, "2.1")),
    "BUSMASTER": (".log", lambda s: _format_busmaster(s)),
    "BUSMASTER, decimal": (".log", lambda s: _format_busmaster(s, "DEC")),
    "BUSMASTER, relative": (".log", lambda s: _format_busmaster(s, "HEX", "RELATIVE")),
    "SavvyCAN CSV": (
        ".csv",
        lambda s: _format_table(
            s,
            "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8",
            "{us},{i:08X},false,Rx,0,{n},{x},",
        ),
    ),
    "python-can CSV": (
        ".csv",
        lambda s: _format_table(
            s, "timestamp,arbitration_id,extended,remote,error,dlc,data", "{e:.6f},0x{i:x},0,0,0,{n},{b}"
        ),
    ),
}


def write_bus_log(name: str, folder: Path, sent: list[tuple[float, int, bytes]]) -> Path:
    """Write a log of this layout, and the database beside it."""
    suffix, made = BUS_LOGS[name]
    path = folder / f"drive{suffix}"
    path.write_bytes(made(sent).encode("utf-8" if name == "ASC" else "cp1252"))
    (folder / "car.dbc").write_text(DBC, encoding="cp1252")
    return path
