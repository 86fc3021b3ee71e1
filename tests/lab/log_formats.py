"""One drive in the formats of measuring systems, written by the usual libraries.

Four wheels in km/h, the steering wheel in degrees, other names, three rates,
latencies."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pandas as pd
import pytest

RATIO, RADIUS, TRACK = 15.3, {"front": 0.33, "rear": 0.33}, 1.55
LATENCY = {"steer": 0.03, "wheels": 0.04, "imu": 0.02}  # s
EVERY = {"steer": 5, "wheels": 2, "imu": 1}  # rows of the clean log per entry: 20, 50, 100 Hz
DEG = 180 / np.pi


@dataclass(frozen=True)
class Message:
    """Signals with the same times: time (s) and columns, as logged."""

    name: str
    time: np.ndarray
    columns: dict[str, np.ndarray]
    units: dict[str, str]


def make_drive(car: Path, seconds: float = 60.0, seed: int = 3) -> pd.DataFrame:
    """Return a drive in tse's own columns: double lane changes with smooth torques.

    The torque moves to its next value within 0.5 s. Jumps from row to row would be lost
    between two entries of a slow channel."""
    from tse.car.vehicle import read_vehicle
    from tse.library.core import Config, SimConfig
    from tse.simulation import maneuvers
    from tse.simulation.simulate import simulate

    config = Config.exact(read_vehicle(car).values)
    plan = maneuvers.build("double-lane-change", config, sample_time=0.01, duration=seconds)
    foot = np.hanning(51)
    plan.wheel_torque_front = np.convolve(plan.wheel_torque_front, foot / foot.sum(), "same")
    quiet = {"spread_cx_front": 0.0, "spread_cy_front": 0.0, "spread_cy_rear": 0.0, "seed": seed}
    return simulate(plan, config, SimConfig(quiet)).log


def split_messages(clean: pd.DataFrame) -> list[Message]:
    """Return the drive as three messages, each later by its latency."""

    def part(name: str, columns: dict[str, np.ndarray], units: dict[str, str]) -> Message:
        k = EVERY[name]
        return Message(
            name, clean.time.to_numpy()[::k] + LATENCY[name], {c: x[::k] for c, x in columns.items()}, units
        )

    wheels = {}
    for axle, short in (("front", "V"), ("rear", "H")):
        for side, sign in (("L", -1), ("R", 1)):
            speed = (
                clean[f"wheel_speed_{axle}"].to_numpy() * RADIUS[axle]
                + sign * 0.5 * TRACK * clean.yaw_rate.to_numpy()
            )
            wheels[f"Rad{short}{side}"] = 3.6 * speed
    steer = {"LenkradWinkel": DEG * RATIO * clean.steer_angle.to_numpy()}
    imu = {"Gierrate": DEG * clean.yaw_rate.to_numpy(), "Querbeschl": clean.accel_y.to_numpy() / 9.80665,
           "Laengsbeschl": clean.accel_x.to_numpy()}  # fmt: skip
    return [
        part("steer", steer, {"LenkradWinkel": "deg"}),
        part("wheels", wheels, dict.fromkeys(wheels, "km/h")),
        part("imu", imu, {"Gierrate": "deg/s", "Querbeschl": "g", "Laengsbeschl": "m/s2"}),
    ]


def repeat_messages(parts: list[Message], times: int, period: float) -> list[Message]:
    """Return messages of any length: the drive, repeated every `period` s."""
    return [
        Message(m.name, np.concatenate([m.time + period * k for k in range(times)]),
                {n: np.tile(x, times) for n, x in m.columns.items()}, m.units) for m in parts
    ]  # fmt: skip


def make_signals_toml(
    prefix: dict[str, str], units: bool = True, log: str = "", steer_unit: str = "deg"
) -> str:
    """Return signals.toml for these names.

    `prefix`: text before the names, by message. `units`: give the units, for formats
    without."""

    def table(channel: str, names: list[str], message: str, unit: str, more: str = "") -> str:
        full = [prefix.get(message, "") + n for n in names]
        name = f'"{full[0]}"' if len(full) == 1 else "[" + ", ".join(f'"{n}"' for n in full) + "]"
        said = f'unit = "{unit}"\n' if units else ""
        return f"[signals.{channel}]\nname = {name}\n{said}latency = {LATENCY[message]}\n{more}\n"

    return log + "".join(
        [
            table("steer_angle", ["LenkradWinkel"], "steer", steer_unit, f"ratio = {RATIO}\n"),
            table("wheel_speed_front", ["RadVL", "RadVR"], "wheels", "km/h"),
            table("wheel_speed_rear", ["RadHL", "RadHR"], "wheels", "km/h"),
            table("accel_x", ["Laengsbeschl"], "imu", "m/s2"),
            table("accel_y", ["Querbeschl"], "imu", "g"),
            table("yaw_rate", ["Gierrate"], "imu", "deg/s"),
        ]
    )


def join_columns(parts: list[Message]) -> pd.DataFrame:
    """Return an outer join over time: most cells are empty."""
    frames = [pd.DataFrame({"t": np.round(m.time, 9)} | m.columns) for m in parts]
    table = frames[0]
    for f in frames[1:]:
        table = table.merge(f, on="t", how="outer")
    return table.sort_values("t").reset_index(drop=True)


def write_german_csv(folder: Path, parts: list[Message]) -> Path:
    """Write a German CSV: decimal comma, cp1252, preamble, units, held values."""
    table = join_columns(parts).ffill().dropna()
    units = {"LenkradWinkel": "°", "Gierrate": "°/s", "Querbeschl": "g", "Laengsbeschl": "m/s²"}
    names = ["Zeit", *table.columns[1:]]
    lines = ["Messung: Prüfstrecke", "Fahrer: Müller", "", ";".join(names)]
    lines.append(";".join(["ms", *(units.get(n, "km/h") for n in names[1:])]))
    lines += [
        ";".join(f"{x:.6f}".replace(".", ",") for x in [1000 * row[0], *row[1:]]) for row in table.to_numpy()
    ]
    path = folder / "fahrt.csv"
    path.write_bytes("\r\n".join(lines).encode("cp1252"))
    (folder / "signals.toml").write_text(make_signals_toml({}, units=False))
    return path


def write_parquet(folder: Path, parts: list[Message]) -> Path:
    """Write an outer join."""
    path = folder / "drive.parquet"
    join_columns(parts).to_parquet(path)
    (folder / "signals.toml").write_text(make_signals_toml({}))
    return path


def write_feather(folder: Path, parts: list[Message]) -> Path:
    """Write an outer join with dates as times."""
    path = folder / "drive.feather"
    table = join_columns(parts)
    table["t"] = pd.to_datetime("2024-05-01T08:00:00") + pd.to_timedelta(table.t, unit="s")
    table.to_feather(path)
    (folder / "signals.toml").write_text(make_signals_toml({}))
    return path


def write_mdf(folder: Path, parts: list[Message], name: str, version: str) -> Path:
    """Write a group per message."""
    from asammdf import MDF, Signal

    path = folder / name
    with MDF(version=version) as made:
        for m in parts:
            made.append(
                [Signal(x, m.time, unit=m.units[n], name=n) for n, x in m.columns.items()], acq_name=m.name
            )
        saved = made.save(path.with_suffix(".mf4" if version > "4" else ".mdf"), overwrite=True)
    Path(saved).replace(path)
    (folder / "signals.toml").write_text(make_signals_toml({}, units=False))
    return path


DBC = """VERSION ""
NS_ :
BS_:
BU_: ESP
BO_ 194 steer: 8 ESP
 SG_ LenkradWinkel : 0|16@1- (0.02,0) [-600|600] "deg" ESP
 SG_ LenkradBZ : 16|4@1+ (1,0) [0|15] "" ESP
BO_ 178 wheels: 8 ESP
 SG_ RadVL : 7|16@0+ (0.005,0) [0|300] "km/h" ESP
 SG_ RadVR : 23|16@0+ (0.005,0) [0|300] "km/h" ESP
 SG_ RadHL : 39|16@0+ (0.005,0) [0|300] "km/h" ESP
 SG_ RadHR : 55|16@0+ (0.005,0) [0|300] "km/h" ESP
BO_ 2566844158 imu: 8 ESP
 SG_ Gierrate : 0|16@1- (0.005,0) [-160|160] "deg/s" ESP
 SG_ Querbeschl : 16|16@1- (0.0001,0) [-3|3] "g" ESP
 SG_ Laengsbeschl : 32|16@1- (0.001,0) [-30|30] "m/s2" ESP
 SG_ Gueltig : 48|2@1+ (1,0) [0|3] "" ESP
"""


Frame: TypeAlias = tuple[float, int, bool, bytes, int]


def encode_frames(parts: list[Message]) -> list[Frame]:
    """Return time, identifier, extended flag, bytes and bus of every frame, in order."""
    import cantools

    database = cantools.database.load_string(DBC, "dbc")
    found = []
    for m in parts:
        message = database.get_message_by_name(m.name)
        for i, t in enumerate(m.time):
            values = {n: float(x[i]) for n, x in m.columns.items()}
            values |= {"steer": {"LenkradBZ": i % 16}, "imu": {"Gueltig": 1}}.get(m.name, {})
            found.append(
                (t, message.frame_id, message.is_extended_frame, message.encode(values, strict=False), 1)
            )
    return sorted(found)


def write_bus(path: Path, sent: list[Frame]) -> None:
    """Write frames by python-can."""
    import can

    with can.Logger(str(path)) as logger:
        for t, identifier, extended, data, channel in sent:
            logger.on_message_received(
                can.Message(
                    timestamp=float(1.7e9 + t),
                    arbitration_id=identifier,
                    is_extended_id=extended,
                    data=data,
                    channel=channel,
                )
            )


def write_bus_log(folder: Path, parts: list[Message], name: str) -> Path:
    """Write a bus, with its database beside the log."""
    path = folder / name
    write_bus(path, encode_frames(parts))
    (folder / "car.dbc").write_text(DBC)
    text = make_signals_toml({"steer": "steer.", "wheels": "wheels.", "imu": "imu."}, units=False)
    text = text.replace("ratio =", 'counter = "steer.LenkradBZ"\nratio =').replace(
        '[signals.yaw_rate]\n', '[signals.yaw_rate]\nvalid = {name = "imu.Gueltig", is = [1]}\n')  # fmt: skip
    (folder / "signals.toml").write_text(text)
    return path


def write_savvycan(folder: Path, parts: list[Message]) -> Path:
    """Write a table of frames: whole microseconds, hexadecimal identifiers and bytes."""
    lines = ["Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8"]
    write_bus_log(folder, parts, "drive.blf")
    (folder / "drive.blf").unlink()
    for t, identifier, extended, data, _ in encode_frames(parts):
        cells = ",".join(f"{b:02X}" for b in data)
        lines.append(f"{round(1e6 * t)},{identifier:08X},{str(extended).lower()},Rx,0,{len(data)},{cells}")
    path = folder / "drive.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def write_mf4_bus(path: Path, found: list[Frame]) -> None:
    """Write frames of a bus in MF4, as loggers do."""
    from asammdf import MDF, Signal
    from asammdf.blocks.v4_blocks import SourceInformation
    from asammdf.blocks.v4_constants import BUS_TYPE_CAN

    data = np.zeros((len(found), 8), np.uint8)
    for i, f in enumerate(found):
        data[i, : len(f[3])] = np.frombuffer(f[3], np.uint8)
    kind = [
        ("CAN_DataFrame.BusChannel", "u1"),
        ("CAN_DataFrame.ID", "u4"),
        ("CAN_DataFrame.IDE", "u1"),
        ("CAN_DataFrame.DLC", "u1"),
        ("CAN_DataFrame.DataLength", "u1"),
        ("CAN_DataFrame.DataBytes", "(8,)u1"),
    ]
    samples = np.zeros(len(found), kind)
    samples["CAN_DataFrame.BusChannel"] = [f[4] for f in found]
    samples["CAN_DataFrame.ID"] = [f[1] for f in found]
    samples["CAN_DataFrame.IDE"] = [f[2] for f in found]
    samples["CAN_DataFrame.DLC"] = samples["CAN_DataFrame.DataLength"] = [len(f[3]) for f in found]
    samples["CAN_DataFrame.DataBytes"] = data
    source = SourceInformation(source_type=2, bus_type=BUS_TYPE_CAN)
    source.name = source.path = "CAN1"
    with MDF(version="4.11") as mdf:
        mdf.append(
            [Signal(samples, np.array([f[0] for f in found]), name="CAN_DataFrame", source=source)],
            acq_source=source,
        )
        mdf.save(path, overwrite=True)


def write_mf4_bus_log(folder: Path, parts: list[Message]) -> Path:
    """Write a bus in MF4, with its database beside the log."""
    path = folder / "bus.mf4"
    write_mf4_bus(path, encode_frames(parts))
    (folder / "car.dbc").write_text(DBC)
    (folder / "signals.toml").write_text(
        make_signals_toml({}, units=False, log='[log]\ndatabases = ["car.dbc"]\n\n')
    )
    return path


WHEELS_MSG = "std_msgs/Header header\nfloat64 rad_vl\nfloat64 rad_vr\nfloat64 rad_hl\nfloat64 rad_hr"
STEER_MSG = "std_msgs/Header header\nfloat64 angle"


def _make_stamp(store: object, t: float) -> object:
    kinds = store.types
    return kinds["builtin_interfaces/msg/Time"](sec=int(t), nanosec=round(t % 1 * 1e9))


def _write_ros(store: object, parts: list[Message], write: Callable[[str, str, float, object], None]) -> None:
    kinds = store.types
    header = kinds["std_msgs/msg/Header"]
    vector, quaternion = kinds["geometry_msgs/msg/Vector3"], kinds["geometry_msgs/msg/Quaternion"]
    steer, wheels, imu = parts
    made = []

    def head(t: float) -> object:
        named = {"seq": 0} if "seq" in getattr(header, "__dataclass_fields__", {}) else {}
        return header(stamp=_make_stamp(store, 1.7e9 + t), frame_id="base", **named)

    for i, t in enumerate(steer.time):
        made.append((t, "/steer", "car_msgs/msg/Steer", lambda i=i, t=t: kinds["car_msgs/msg/Steer"](
            header=head(t), angle=float(steer.columns["LenkradWinkel"][i]))))  # fmt: skip
    for i, t in enumerate(wheels.time):
        made.append(
            (
                t,
                "/wheels",
                "car_msgs/msg/Wheels",
                lambda i=i, t=t: kinds["car_msgs/msg/Wheels"](
                    header=head(t), **{f"rad_{n[3:].lower()}": float(x[i]) for n, x in wheels.columns.items()}
                ),
            )
        )
    for i, t in enumerate(imu.time):
        c = imu.columns
        made.append(
            (
                t,
                "/imu",
                "sensor_msgs/msg/Imu",
                lambda i=i, t=t, c=c: kinds["sensor_msgs/msg/Imu"](
                    header=head(t),
                    orientation=quaternion(0.0, 0.0, 0.0, 1.0),
                    orientation_covariance=np.zeros(9),
                    angular_velocity=vector(0.0, 0.0, float(c["Gierrate"][i] / DEG)),
                    angular_velocity_covariance=np.zeros(9),
                    linear_acceleration=vector(
                        float(c["Laengsbeschl"][i]), float(9.80665 * c["Querbeschl"][i]), 9.81
                    ),
                    linear_acceleration_covariance=np.zeros(9),
                ),
            )
        )
    for t, topic, kind, message in sorted(made, key=lambda m: m[0]):
        write(topic, kind, 1.7e9 + t + 0.001, message())


def _write_ros_signals(folder: Path) -> None:
    text = make_signals_toml({"steer": "/steer.", "wheels": "/wheels."}).replace("LenkradWinkel", "angle")
    for place in ("VL", "VR", "HL", "HR"):
        text = text.replace(f"Rad{place}", f"rad_{place.lower()}")
    for german, field, unit in (
        ("Gierrate", "/imu.angular_velocity.z", "deg/s"),
        ("Querbeschl", "/imu.linear_acceleration.y", "g"),
        ("Laengsbeschl", "/imu.linear_acceleration.x", "m/s2"),
    ):
        text = text.replace(f'"{german}"\nunit = "{unit}"\n', f'"{field}"\n')
    (folder / "signals.toml").write_text(text)


def _open_store(ros1: bool = False) -> object:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    store.register(
        get_types_from_msg(WHEELS_MSG, "car_msgs/msg/Wheels")
        | get_types_from_msg(STEER_MSG, "car_msgs/msg/Steer")
    )
    return store


def _write_bag(
    folder: Path,
    parts: list[Message],
    path: Path,
    store: object,
    made: object,
    serialized: Callable[..., bytes],
) -> Path:
    opened: dict[str, object] = {}
    with made as writer:

        def write(topic: str, kind: str, t: float, message: object) -> None:
            if topic not in opened:
                opened[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(opened[topic], round(1e9 * t), serialized(message, kind))

        _write_ros(store, parts, write)
    _write_ros_signals(folder)
    return path


def write_rosbag2(folder: Path, parts: list[Message]) -> Path:
    """Write the folder of a ROS 2 bag."""
    from rosbags.rosbag2 import Writer

    store, path = _open_store(), folder / "bag"
    return _write_bag(folder, parts, path, store, Writer(path, version=9), store.serialize_cdr)


def write_rosbag1(folder: Path, parts: list[Message]) -> Path:
    """Write a ROS 1 bag."""
    from rosbags.rosbag1 import Writer

    store, path = _open_store(ros1=True), folder / "drive.bag"
    return _write_bag(folder, parts, path, store, Writer(path), store.serialize_ros1)


def write_mcap(folder: Path, parts: list[Message]) -> Path:
    """Write ROS 2 messages in one MCAP."""
    from mcap.writer import Writer

    store, path, opened = _open_store(), folder / "drive.mcap", {}
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="test")

        def write(topic: str, kind: str, t: float, message: object) -> None:
            if topic not in opened:
                text, _ = store.generate_msgdef(kind, ros_version=2)
                schema = writer.register_schema(kind, "ros2msg", text.encode())
                opened[topic] = writer.register_channel(topic, "cdr", schema)
            at = round(1e9 * t)
            writer.add_message(
                opened[topic], log_time=at, publish_time=at, data=bytes(store.serialize_cdr(message, kind))
            )

        _write_ros(store, parts, write)
        writer.finish()
    _write_ros_signals(folder)
    return path


def write_mat5(folder: Path, parts: list[Message]) -> Path:
    """Write a struct per message, with its time."""
    from scipy.io import savemat

    path = folder / "drive.mat"
    savemat(path, {m.name: {"time": m.time} | m.columns for m in parts})
    (folder / "signals.toml").write_text(make_signals_toml({m.name: f"{m.name}." for m in parts}))
    return path


def write_mat73(folder: Path, parts: list[Message]) -> Path:
    """Write the same as HDF5."""
    import h5py

    path = folder / "drive73.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for m in parts:
            for name, x in ({"time": m.time} | m.columns).items():
                file.create_dataset(f"{m.name}/{name}", data=x[None, :]).attrs["MATLAB_class"] = np.bytes_(
                    "double"
                )
    with open(path, "r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(116))
    (folder / "signals.toml").write_text(make_signals_toml({m.name: f"{m.name}." for m in parts}))
    return path


FORMATS: dict[str, tuple[str, Callable[[Path, list[Message]], Path]]] = {  # needed package, writer
    "MF4": ("asammdf", lambda f, p: write_mdf(f, p, "drive.mf4", "4.10")),
    "MDF 3": ("asammdf", lambda f, p: write_mdf(f, p, "drive.dat", "3.30")),
    "MF4, frames and DBC": ("asammdf", write_mf4_bus_log),
    "BLF and DBC": ("can", lambda f, p: write_bus_log(f, p, "drive.blf")),
    "ASC and DBC": ("can", lambda f, p: write_bus_log(f, p, "drive.asc")),
    "TRC and DBC": ("can", lambda f, p: write_bus_log(f, p, "drive.trc")),
    "frames in a CSV of python-can and DBC": ("can", lambda f, p: write_bus_log(f, p, "drive.csv")),
    "frames in a CSV of SavvyCAN and DBC": ("can", write_savvycan),
    "MCAP, ROS 2": ("mcap_ros2", write_mcap),
    "ROS 2 bag": ("rosbags", write_rosbag2),
    "ROS 1 bag": ("rosbags", write_rosbag1),
    "Parquet": ("pyarrow", write_parquet),
    "Feather": ("pyarrow", write_feather),
    "MAT 5": ("scipy", write_mat5),
    "MAT 7.3": ("h5py", write_mat73),
    "German CSV": ("pandas", write_german_csv),
}


def write_or_skip(name: str, folder: Path, parts: list[Message]) -> Path:
    """Write a log of this format; skip the test if its writer is not installed."""
    needs, write = FORMATS[name]
    if find_spec(needs) is None:
        pytest.skip(f"{needs} is not installed: scripts/setup.sh logs")
    return write(folder, parts)
