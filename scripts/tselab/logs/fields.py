"""Messages into channels by the path of their fields: what ROS, MCAP, JSON and Cap'n Proto have in common."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from tselab.logs.recording import Channel

LONGEST = (
    12  # elements of an array that become channels of their own: four wheels, not a camera's picture or a covariance
)
DEEPEST = 8
# Units that the definitions of the messages promise, by the last two fields of a path: REP 103, sensor_msgs, nav_msgs
SI = {"angular_velocity": "rad/s", "linear_acceleration": "m/s2", "linear": "m/s", "angular": "rad/s"}
ROS_TYPES = ("sensor_msgs", "geometry_msgs", "nav_msgs")


def flat(message: Any, at: str = "", depth: int = 0) -> Iterator[tuple[str, float]]:
    """Numbers of a message with their paths: angular_velocity.z, wheels.0."""
    if isinstance(message, (bool, int, float, np.integer, np.floating, np.bool_)):
        yield at, float(message)
        return
    if depth > DEEPEST or isinstance(message, (str, bytes)) or message is None:
        return
    if isinstance(message, dict):
        items = message.items()
    elif isinstance(message, (list, tuple, np.ndarray)):
        if len(message) > LONGEST or "covariance" in at:
            return
        items = ((str(i), x) for i, x in enumerate(message))
    else:
        names = getattr(message, "__slots__", None) or getattr(message, "__dataclass_fields__", None)
        if names is None:
            return
        items = ((str(n).lstrip("_"), getattr(message, n, None)) for n in names if not str(n).startswith("__"))
    for name, part in items:
        if name in ("header", "check_fields", "_check_fields"):
            continue
        yield from flat(part, f"{at}.{name}" if at else name, depth + 1)


def stamp(message: Any) -> float | None:
    """Time of measurement in the header of a ROS message, s; None where there is none, or it is 0."""
    header = message.get("header") if isinstance(message, dict) else getattr(message, "header", None)
    s = header.get("stamp") if isinstance(header, dict) else getattr(header, "stamp", None)
    if s is None:
        return None
    get = s.get if isinstance(s, dict) else lambda k, d=None: getattr(s, k, d)
    sec = next((get(k) for k in ("sec", "secs") if get(k) is not None), None)
    nano = next((get(k) for k in ("nanosec", "nsecs", "nsec") if get(k) is not None), 0)
    return float(sec) + 1e-9 * float(nano) if sec else None


class Collector:
    """Collects messages topic by topic, and makes channels of them."""

    def __init__(self) -> None:
        self._topics: dict[str, tuple[list[float], dict[str, list[tuple[int, float]]], str]] = {}

    def add(self, topic: str, time: float, message: Any, type_: str = "") -> None:
        """One message. Its time is that of its header, where it has one."""
        times, columns, _ = self._topics.setdefault(topic, ([], {}, type_))
        row = len(times)
        measured = stamp(message)
        times.append(time if measured is None else measured)
        for name, value in flat(message):
            columns.setdefault(name, []).append((row, value))

    def channels(self) -> dict[str, Channel]:
        """By topic and path: /imu.angular_velocity.z."""
        found: dict[str, Channel] = {}
        for topic, (times, columns, type_) in self._topics.items():
            time = np.array(times)
            for name, cells in columns.items():
                value = np.full(len(time), np.nan)
                rows, numbers = zip(*cells, strict=True)
                value[list(rows)] = numbers
                full = f"{topic}.{name}" if name else topic
                found[full] = Channel(full, time, value, _unit(type_, name), type_)
        return found


def _unit(type_: str, name: str) -> str:
    if not type_.startswith(ROS_TYPES):
        return ""
    parts = name.split(".")
    parent = parts[-2] if len(parts) > 1 else ""
    if parent == "linear" and ("Accel" in type_):
        return "m/s2"
    return SI.get(parent, "")
