"""signals.toml: which signal of a log is which channel, in which unit, with which sign, ratio and latency. Read and checked."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from tse.impl.core import library
from tse.impl.errors import UserError, meant
from tse.impl.files import read_toml
from tse.impl.logs.recording import How
from tse.impl.rows import OPTIONAL, SIDES, beside_of
from tse.impl.units import factor, quantity

SLOWEST, FASTEST = 2.0, 1000.0  # Hz: of a raster
LONGEST_LATENCY = 1.0  # s
LONGEST_CLOCK = 4e9  # s: an epoch
LOG_KEYS = {f.name for f in fields(How)} - {"wanted"} | {"rate"}
KEYS = (
    "name", "add", "unit", "sign", "sign_bit", "scale", "offset", "ratio", "radius", "latency", "clock", "valid", "counter",
    "hold", "above",
    "unsure",
)  # fmt: skip
RANGES = {  # key -> low, high, unit, what it is
    "scale": (-1e9, 1e9, "", "a factor after the unit, 1 if left out"),
    "offset": (-1e6, 1e6, "", "taken off in the unit of the signal, 0 if left out"),
    "radius": (0.05, 5.0, "m", "of the wheel, for speeds; the vehicle file's if left out"),
    "above": (-1e6, 1e6, "", "of a pressure: the brakes are on above it, in the unit of the signal"),
    "latency": (-LONGEST_LATENCY, LONGEST_LATENCY, "s", "by how much later than it was true a value is logged"),
    "clock": (-LONGEST_CLOCK, LONGEST_CLOCK, "s", "by how much the clock of its group is ahead of the others"),
}
LEAST_RATIO, MOST_RATIO = 0.5, 100.0


@dataclass(frozen=True)
class Flag:
    """A signal that says whether others are valid: `of` these values, or any but 0."""

    name: str
    values: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Counter:
    """The counter of a message: an entry with the counter of the one before is that one again."""

    name: str
    modulo: int | None = None  # None: as the log shows it


@dataclass(frozen=True)
class Signal:
    """One channel: where it comes from. Two names: left and right wheel."""

    channel: str
    name: tuple[str, ...]
    unit: str | None = None
    sign: float = 1.0
    sign_bit: str | None = None  # a signal that is 1 where the value is negative
    scale: float = 1.0
    offset: float = 0.0
    ratio: float | tuple[tuple[float, float], ...] | None = (
        None  # steering wheel over road wheels; or by angle, in the signal's unit
    )
    radius: float | None = None
    latency: float = 0.0
    clock: float = 0.0
    valid: Flag | None = None
    counter: Counter | None = None
    hold: bool = False  # sent only when it changes: a value stands until the next
    above: float | None = None  # 1 where the signal is above it, in its own unit, else 0
    add: str | None = None  # a signal with the rest of the value, in the same unit: the fine part of an angle
    unsure: str = ""  # what was guessed and could not be tested; every run says so until the key is taken out


@dataclass(frozen=True)
class Signals:
    """The file as a whole."""

    path: Path | None
    signals: Mapping[str, Signal]
    how: How = field(default_factory=How)
    rate: float | None = None

    def wants(self, name: str) -> bool:
        """Is a signal of that name, or that last part of it, needed?"""
        names = {
            n
            for s in self.signals.values()
            for n in (*s.name, s.add, s.sign_bit, s.valid and s.valid.name, s.counter and s.counter.name)
            if n
        }
        return name in names or any(n.endswith((f".{name}", f"/{name}")) or name.endswith((f".{n}", f"/{n}")) for n in names)


def find_signals(log: Path, file: Path | None, databases: Sequence[Path]) -> tuple[Signals | None, How]:
    """The signals.toml of a log, that which was named or the one beside it, and how the log is read: [log] of it, and these
    databases before those that it names."""
    file = file or beside_of(log)
    signals = read_signals(file) if file is not None else None
    how = signals.how if signals is not None else How()
    given = {p.resolve() for p in databases}
    return signals, replace(how, databases=(*databases, *(p for p in how.databases if p.resolve() not in given)))


def known_channels() -> list[str]:
    """Channels that a file may have, without ref_*."""
    return [*(f.name for f in library().channels), *(s for pair in SIDES.values() for s in pair), *OPTIONAL]


def unit_of(channel: str) -> str:
    """The SI unit in which the library takes a channel."""
    axle = next((a for a, pair in SIDES.items() if channel in pair), channel)
    if axle in OPTIONAL:
        return OPTIONAL[axle][0]
    return next((f.unit for f in library().channels if f.name == axle), "")


def read_signals(path: Path) -> Signals:
    """Read and check. UserError: file, line, field, what is allowed."""
    path = Path(path)
    data = read_toml(path)
    text = path.read_text(encoding="utf-8-sig")

    def refuse(table: str, key: str, message: str) -> UserError:
        return UserError(f"{path}: {_line(text, table, key)}[{table}]{f' {key}' if key else ''}: {message}")

    log, signals = data.pop("log", {}), data.pop("signals", {})
    if data:
        raise refuse(
            next(iter(data)),
            "",
            f"is not known{meant(next(iter(data)), ('log', 'signals'), 1)}; tables are [log] and [signals.CHANNEL]",
        )
    if not isinstance(log, dict) or not isinstance(signals, dict):
        raise UserError(f"{path}: log and signals must be tables: [log], [signals.CHANNEL]")
    if not signals:
        raise UserError(
            f"{path}: names no channel: [signals.yaw_rate] and the like are needed; 'tselab signals LOG --write {path.name}' "
            f"proposes them"
        )
    how, rate = _log(path, log, refuse)
    known = known_channels()
    found: dict[str, Signal] = {}
    for channel, table in signals.items():
        at = f"signals.{channel}"
        if channel not in known and not channel.startswith("ref_"):
            raise refuse(at, "", f"there is no such channel{meant(channel, known, 1)}; channels: {', '.join(known)}, ref_ANYTHING")
        if not isinstance(table, dict):
            raise UserError(f'{path}: {_line(text, "signals", channel)}{channel} must be a table: [{at}] with name = "..."')
        found[channel] = _signal(channel, at, table, refuse)
    for axle, pair in SIDES.items():
        if axle in found and any(s in found for s in pair):
            raise refuse(f"signals.{axle}", "", f"and {' and '.join(s for s in pair if s in found)} say the same: leave one out")
        if any(s in found for s in pair) and not all(s in found for s in pair):
            lone = next(s for s in pair if s in found)
            missing = next(s for s in pair if s not in found)
            raise refuse(f"signals.{lone}", "", f"{missing} is needed, too; a car with one sensor on the axle has {axle}")
    return Signals(path, found, how, rate)


def _log(path: Path, log: dict[str, Any], refuse: Any) -> tuple[How, float | None]:
    for key, value in log.items():
        if key not in LOG_KEYS:
            raise refuse("log", key, f"is not known{meant(key, LOG_KEYS, 1)}; keys: {', '.join(sorted(LOG_KEYS))}")
        if key in ("time", "time_unit", "separator", "decimal", "encoding") and not isinstance(value, str):
            raise refuse("log", key, f"{value!r} is no text in quotes")
    rate = _number("log", "rate", log["rate"], SLOWEST, FASTEST, "Hz", refuse) if "rate" in log else None
    step = _number("log", "step", log["step"], 1e-4, 1.0, "s", refuse) if "step" in log else None
    if "time_unit" in log and factor(log["time_unit"], "s") is None:
        raise refuse("log", "time_unit", f"{log['time_unit']!r} is no unit of time; s, ms, us, ns are")
    if log.get("decimal", ".") not in (".", ","):
        raise refuse("log", "decimal", f'{log["decimal"]!r} is not allowed; "." and "," are')
    header = log.get("header")
    if header is not None and (isinstance(header, bool) or not isinstance(header, int) or header < 1):
        raise refuse("log", "header", f"{header!r} is no line; the first is 1")
    databases = log.get("databases", [])
    databases = [databases] if isinstance(databases, str) else databases
    if not isinstance(databases, list) or not all(isinstance(d, str) for d in databases):
        raise refuse("log", "databases", 'must be a list of files: ["car.dbc"]')
    how = How(
        databases=tuple((path.parent / d) for d in databases), time=log.get("time"), time_unit=log.get("time_unit"), step=step,
        separator=log.get("separator"), decimal=log.get("decimal"), encoding=log.get("encoding"), header=header,
    )  # fmt: skip
    return how, rate


def _signal(channel: str, at: str, table: dict[str, Any], refuse: Any) -> Signal:
    for key in table:
        if key not in KEYS:
            raise refuse(at, key, f"is not known{meant(key, KEYS, 1)}; keys: {', '.join(KEYS)}")
    name = table.get("name")
    names = [name] if isinstance(name, str) else name
    axle = channel in SIDES
    if not isinstance(names, list) or not names or not all(isinstance(n, str) and n for n in names) or len(names) > 2:
        raise refuse(
            at, "name", f'must be the name of a signal{", or two of them: left and right wheel" if axle else ""}: name = "..."'
        )
    if len(names) == 2 and not axle and channel != "steer_angle":
        raise refuse(at, "name", f"two names are for wheels: {', '.join(SIDES)}")
    if len(set(names)) < len(names):
        raise refuse(at, "name", f"{names[0]!r} cannot be both wheels")
    values: dict[str, Any] = {"channel": channel, "name": tuple(names)}
    for key, (low, high, unit, _) in RANGES.items():
        if key in table:
            values[key] = _number(at, key, table[key], low, high, unit, refuse)
    if values.get("scale") == 0.0:
        raise refuse(at, "scale", "0 leaves nothing of the signal")
    if "radius" in table and "wheel_speed" not in channel:
        raise refuse(at, "radius", "is for wheel speeds")
    if "above" in table and channel != "brake":
        raise refuse(at, "above", "is for brake")
    if "sign" in table:
        if table["sign"] not in (1, -1) or isinstance(table["sign"], bool):
            raise refuse(at, "sign", f"{table['sign']!r} is not allowed; 1 and -1 are")
        values["sign"] = float(table["sign"])
    if "unit" in table:
        unit = table["unit"]
        if not isinstance(unit, str) or quantity(unit) is None:
            raise refuse(at, "unit", f"{unit!r} is no unit that is known; for {channel} {_units_for(channel)} are, for instance")
        if not channel.startswith("ref_") and "above" not in table and factor(unit, unit_of(channel), 1.0) is None:
            raise refuse(at, "unit", f"{unit!r} cannot be turned into {unit_of(channel)}; {_units_for(channel)} can, for instance")
        values["unit"] = unit
    for key, what in (
        ("sign_bit", "the name of a signal that is 1 where the value is negative"),
        ("add", "the name of a signal with the rest of the value, in the same unit"),
    ):
        if key in table:
            if not isinstance(table[key], str):
                raise refuse(at, key, f"must be {what}")
            values[key] = table[key]
    if "add" in table and len(names) > 1:
        raise refuse(at, "add", "goes with one name")
    if "unsure" in table:
        if not isinstance(table["unsure"], str) or not table["unsure"].strip():
            raise refuse(at, "unsure", 'must say what is: unsure = "the sign"; leave it out when you have looked')
        values["unsure"] = table["unsure"].strip()
    if "ratio" in table:
        if channel != "steer_angle":
            raise refuse(at, "ratio", "is the steering ratio, of steer_angle")
        values["ratio"] = _ratio(at, table["ratio"], refuse)
    if "valid" in table:
        values["valid"] = _flag(at, table["valid"], refuse)
    if "counter" in table:
        values["counter"] = _counter(at, table["counter"], refuse)
    if "hold" in table:
        if not isinstance(table["hold"], bool):
            raise refuse(at, "hold", "must be true or false")
        values["hold"] = table["hold"]
    return Signal(**values)


def _ratio(at: str, value: Any, refuse: Any) -> float | tuple[tuple[float, float], ...]:
    if not isinstance(value, list):
        return _number(at, "ratio", value, LEAST_RATIO, MOST_RATIO, "", refuse)
    if len(value) < 2 or not all(isinstance(row, list) and len(row) == 2 for row in value):
        raise refuse(
            at,
            "ratio",
            "a table has two rows or more of angle of the steering wheel, ratio: [[-300, 14.0], [0, 16.0], [300, 14.0]]",
        )
    rows = []
    for i, row in enumerate(value):
        angle = _number(at, f"ratio, row {i + 1}, angle", row[0], -1e5, 1e5, "", refuse)
        rows.append((angle, _number(at, f"ratio, row {i + 1}, ratio", row[1], LEAST_RATIO, MOST_RATIO, "", refuse)))
        if i and rows[i][0] <= rows[i - 1][0]:
            raise refuse(at, "ratio", f"row {i + 1}: angles must increase: {rows[i][0]:g} follows {rows[i - 1][0]:g}")
    return tuple(rows)


def _flag(at: str, value: Any, refuse: Any) -> Flag:
    if isinstance(value, str):
        return Flag(value)
    if isinstance(value, dict) and set(value) <= {"name", "is"} and isinstance(value.get("name"), str):
        allowed = value.get("is")
        allowed = allowed if isinstance(allowed, list) or allowed is None else [allowed]
        if allowed is None or (allowed and all(isinstance(x, (int, float)) for x in allowed)):
            return Flag(value["name"], None if allowed is None else tuple(float(x) for x in allowed))
    raise refuse(at, "valid", 'must be the name of a signal that is not 0 where this one is valid, or {name = "...", is = [0]}')


def _counter(at: str, value: Any, refuse: Any) -> Counter:
    if isinstance(value, str):
        return Counter(value)
    if isinstance(value, dict) and set(value) <= {"name", "modulo"} and isinstance(value.get("name"), str):
        modulo = value.get("modulo")
        if modulo is None:
            return Counter(value["name"])
        if isinstance(modulo, int) and not isinstance(modulo, bool) and 2 <= modulo <= 2**32:
            return Counter(value["name"], modulo)
    raise refuse(at, "counter", 'must be the name of the message\'s counter, or {name = "...", modulo = 16}')


def _number(at: str, key: str, value: Any, low: float, high: float, unit: str, refuse: Any) -> float:
    allowed = f"allowed: {low:g} .. {high:g}{f' {unit}' if unit else ''}"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise refuse(at, key, f"{value!r} is no number; {allowed}")
    if not low <= value <= high:
        raise refuse(at, key, f"{value:g} is out of range; {allowed}")
    return float(value)


def _units_for(channel: str) -> str:
    return {"rad": "rad, deg", "rad/s": "rad/s, rpm, km/h, m/s, mph" if "wheel" in channel else "rad/s, deg/s", "m/s2": "m/s2, g",
            "m/s": "m/s, km/h, mph", "Nm": "Nm"}.get(unit_of(channel), "SI units")  # fmt: skip


def _line(text: str, table: str, key: str) -> str:
    """Where a key stands, for people; "" if it is not known."""
    inside, key, found = not table, key.partition(",")[0], ""
    for i, line in enumerate(text.splitlines(), 1):
        head = re.match(r"\s*\[\[?\s*([^\]#]+?)\s*\]", line)
        if head and "=" not in line.partition("[")[0]:
            name = head[1].replace('"', "").replace(" ", "")
            inside = name == table
            if inside or (not key and name.startswith(f"{table}.")):
                found = found or f"line {i}, "
                if not key:
                    return found
        elif inside and key and re.match(rf'\s*"?{re.escape(key)}"?\s*=', line):
            return f"line {i}, "
    return found
