"""Messages into channels by the path of their fields: what ROS, MCAP, JSON and Cap'n Proto have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tse.impl.logs.recording import Channel, Growing

LONGEST = (
    12  # elements of an array that become channels of their own: four wheels, not a camera's picture or a covariance
)
DEEPEST = 8
# Units by the definitions of the messages, by the last two fields of a path: REP 103, sensor_msgs, nav_msgs
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


@dataclass
class _Topic:
    type: str
    time: Growing
    columns: dict[str, Growing | None] = field(default_factory=dict)  # None: not wanted


class Collector:
    """Collects messages topic by topic, and makes channels of them. `wanted`: which names are needed; None: all."""

    def __init__(self, wanted: Callable[[str], bool] | None = None) -> None:
        self._wanted = wanted
        self._topics: dict[str, _Topic] = {}

    def add(self, topic: str, time: float, message: Any, type_: str = "") -> None:
        """One message. Its time is that of its header, where it has one."""
        own = self._topics.get(topic)
        if own is None:
            own = self._topics[topic] = _Topic(type_, Growing())
        row = len(own.time)
        measured = stamp(message)
        own.time.set(row, time if measured is None else measured)
        for name, value in flat(message):
            if name not in own.columns:
                needed = self._wanted is None or self._wanted(_full(topic, name))
                own.columns[name] = Growing() if needed else None
            if (column := own.columns[name]) is not None:
                column.set(row, value)

    def channels(self) -> dict[str, Channel]:
        """By topic and path: /imu.angular_velocity.z."""
        found: dict[str, Channel] = {}
        for topic, own in self._topics.items():
            time = own.time.array()
            for name, column in own.columns.items():
                if column is not None:
                    column.pad(len(time))
                    full = _full(topic, name)
                    found[full] = Channel(full, time, column.array(), _unit(own.type, name), own.type)
        return found


def _full(topic: str, name: str) -> str:
    return f"{topic}.{name}" if name else topic


def _unit(type_: str, name: str) -> str:
    if not type_.startswith(ROS_TYPES):
        return ""
    parts = name.split(".")
    parent = parts[-2] if len(parts) > 1 else ""
    if parent == "linear" and ("Accel" in type_):
        return "m/s2"
    return SI.get(parent, "")
