"""Read and check signals.toml: signal, unit, sign, ratio and latency of each channel."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from tse.library.core import library
from tse.library.errors import UserError, suggest_names
from tse.library.files import read_toml
from tse.log.rows import OPTIONAL_COLUMNS, SIDES, find_signals_file
from tse.log.units import parse_unit, unit_factor
from tse.readers.recording import ReadOptions

MIN_RATE, MAX_RATE = 2.0, 1000.0  # Hz of the rows
MAX_LATENCY = 1.0  # s
MAX_CLOCK = 4e9  # s: an epoch
LOG_KEYS = {f.name for f in fields(ReadOptions)} - {"wanted"} | {"rate"}
SIGNAL_KEYS = (
    *("name", "add", "unit", "sign", "sign_bit", "scale", "offset", "ratio", "radius", "latency"),
    *("clock", "valid", "counter", "hold", "above", "unsure"),
)
NUMBER_RANGES = {  # by key: min, max, unit
    "scale": (-1e9, 1e9, ""),  # factor after the unit
    "offset": (-1e6, 1e6, ""),  # subtracted, in the unit of the signal
    "radius": (0.05, 5.0, "m"),  # of the wheel, for speeds
    # pressure above which the car brakes, in the unit of the signal
    "above": (-1e6, 1e6, ""),
    # from a measurement to its time in the log
    "latency": (-MAX_LATENCY, MAX_LATENCY, "s"),
    # by which the clock of its group is ahead of the others
    "clock": (-MAX_CLOCK, MAX_CLOCK, "s"),
}
MIN_RATIO, MAX_RATIO = 0.5, 100.0


@dataclass(frozen=True)
class Flag:
    """A signal that states whether others are valid."""

    name: str
    values: tuple[float, ...] | None = None  # that mean valid; None: all but 0


@dataclass(frozen=True)
class Counter:
    """The counter of a message. A repeated count means a repeated message."""

    name: str
    modulo: int | None = None  # None: found from the log


@dataclass(frozen=True)
class SignalSource:
    """The source of one channel. Two names: left and right wheel."""

    channel: str
    name: tuple[str, ...]
    unit: str | None = None
    sign: float = 1.0
    sign_bit: str | None = None  # a signal that is 1 where the value is negative
    scale: float = 1.0
    offset: float = 0.0
    # steering wheel over road wheels; or a table over the angle in the signal's unit
    ratio: float | tuple[tuple[float, float], ...] | None = None
    radius: float | None = None
    latency: float = 0.0
    clock: float = 0.0
    valid: Flag | None = None
    counter: Counter | None = None
    hold: bool = False  # sent only when it changes: a value stands until the next
    above: float | None = None  # 1 where the signal is above it, in its own unit, else 0
    # signal with the fine part of the value, in the same unit
    add: str | None = None
    # guesses that were not tested; every run warns until the key is deleted
    unsure: str = ""


@dataclass(frozen=True)
class SignalsFile:
    """The contents of signals.toml."""

    path: Path | None
    signals: Mapping[str, SignalSource]
    how: ReadOptions = field(default_factory=ReadOptions)
    rate: float | None = None

    def wants(self, name: str) -> bool:
        """Return whether a signal with this name, or this last part of it, is needed."""
        names = {
            n
            for s in self.signals.values()
            for n in (*s.name, s.add, s.sign_bit, s.valid and s.valid.name, s.counter and s.counter.name)
            if n
        }
        return name in names or any(
            n.endswith((f".{name}", f"/{name}")) or name.endswith((f".{n}", f"/{n}")) for n in names
        )


def find_signals(
    log: Path, file: Path | None, databases: Sequence[Path]
) -> tuple[SignalsFile | None, ReadOptions]:
    """Return the signals.toml of a log, and the settings for reading it.

    Parameters
    ----------
    log : Path
        The log.
    file : Path or None
        signals.toml. None: the one beside the log, if there is one.
    databases : sequence of Path
        Databases of the bus; they precede those that [log] names.
    """
    file = file or find_signals_file(log)
    signals = read_signals(file) if file is not None else None
    how = signals.how if signals is not None else ReadOptions()
    given = {p.resolve() for p in databases}
    more = (p for p in how.databases if p.resolve() not in given)
    return signals, replace(how, databases=(*databases, *more))


def list_channels() -> list[str]:
    """Return the channels that a file may have, without ref_*."""
    return [
        *(f.name for f in library().channels),
        *(s for pair in SIDES.values() for s in pair),
        *OPTIONAL_COLUMNS,
    ]


def find_unit(channel: str) -> str:
    """Return the SI unit of a channel."""
    axle = next((a for a, pair in SIDES.items() if channel in pair), channel)
    if axle in OPTIONAL_COLUMNS:
        return OPTIONAL_COLUMNS[axle][0]
    return next((f.unit for f in library().channels if f.name == axle), "")


def read_signals(path: Path) -> SignalsFile:
    """Read and check signals.toml.

    Raises
    ------
    UserError
        With file, line, field and the allowed values.
    """
    path = Path(path)
    data = read_toml(path)
    text = path.read_text(encoding="utf-8-sig")

    def refuse(table: str, key: str, message: str) -> UserError:
        """Return the error of a key, with its line."""
        return UserError(
            f"{path}: {_find_line(text, table, key)}[{table}]{f' {key}' if key else ''}: {message}"
        )

    log, signals = data.pop("log", {}), data.pop("signals", {})
    if data:
        raise refuse(
            next(iter(data)),
            "",
            f"is not known{suggest_names(next(iter(data)), ('log', 'signals'), 1)}; tables are [log] and "
            "[signals.CHANNEL]",
        )
    if not isinstance(log, dict) or not isinstance(signals, dict):
        raise UserError(f"{path}: log and signals must be tables: [log], [signals.CHANNEL]")
    if not signals:
        raise UserError(
            f"{path}: names no channel: [signals.yaw_rate] and the like are needed; 'tselab signals LOG "
            f"--write {path.name}' proposes them"
        )
    how, rate = _check_log(path, log, refuse)
    known = list_channels()
    found: dict[str, SignalSource] = {}
    for channel, table in signals.items():
        at = f"signals.{channel}"
        if channel not in known and not channel.startswith("ref_"):
            raise refuse(
                at,
                "",
                f"there is no such channel{suggest_names(channel, known, 1)}; channels: {', '.join(known)}, "
                "ref_ANYTHING",
            )
        if not isinstance(table, dict):
            line = _find_line(text, "signals", channel)
            raise UserError(f'{path}: {line}{channel} must be a table: [{at}] with name = "..."')
        found[channel] = _check_signal(channel, at, table, refuse)
    _check_sides(found, refuse)
    return SignalsFile(path, found, how, rate)


def _check_sides(found: Mapping[str, SignalSource], refuse: Any) -> None:
    """Refuse an axle together with its wheels, and a single wheel."""
    for axle, pair in SIDES.items():
        if axle in found and any(s in found for s in pair):
            raise refuse(
                f"signals.{axle}",
                "",
                f"and {' and '.join(s for s in pair if s in found)} say the same: leave one out",
            )
        if any(s in found for s in pair) and not all(s in found for s in pair):
            lone = next(s for s in pair if s in found)
            missing = next(s for s in pair if s not in found)
            raise refuse(
                f"signals.{lone}",
                "",
                f"{missing} is needed, too; a car with one sensor on the axle has {axle}",
            )


def _check_log(path: Path, log: dict[str, Any], refuse: Any) -> tuple[ReadOptions, float | None]:
    """Return the settings of [log], and the rate of the rows, Hz."""
    for key, value in log.items():
        if key not in LOG_KEYS:
            raise refuse(
                "log",
                key,
                f"is not known{suggest_names(key, LOG_KEYS, 1)}; keys: {', '.join(sorted(LOG_KEYS))}",
            )
        if key in ("time", "time_unit", "separator", "decimal", "encoding") and not isinstance(value, str):
            raise refuse("log", key, f"{value!r} is no text in quotes")
    rate = (
        _check_number("log", "rate", log["rate"], MIN_RATE, MAX_RATE, "Hz", refuse) if "rate" in log else None
    )
    step = _check_number("log", "step", log["step"], 1e-4, 1.0, "s", refuse) if "step" in log else None
    if "time_unit" in log and unit_factor(log["time_unit"], "s") is None:
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
    how = ReadOptions(
        databases=tuple((path.parent / d) for d in databases),
        time=log.get("time"),
        time_unit=log.get("time_unit"),
        step=step,
        separator=log.get("separator"),
        decimal=log.get("decimal"),
        encoding=log.get("encoding"),
        header=header,
    )
    return how, rate


def _check_signal(channel: str, at: str, table: dict[str, Any], refuse: Any) -> SignalSource:
    """Return the signal of a channel from its table. `at`: name of the table."""
    for key in table:
        if key not in SIGNAL_KEYS:
            raise refuse(
                at, key, f"is not known{suggest_names(key, SIGNAL_KEYS, 1)}; keys: {', '.join(SIGNAL_KEYS)}"
            )
    names = _check_names(channel, at, table.get("name"), refuse)
    values: dict[str, Any] = {"channel": channel, "name": names}
    for key, (low, high, unit) in NUMBER_RANGES.items():
        if key in table:
            values[key] = _check_number(at, key, table[key], low, high, unit, refuse)
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
        values["unit"] = _check_unit(channel, at, table, refuse)
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
            raise refuse(
                at, "unsure", 'must say what is: unsure = "the sign"; delete it when you have checked it'
            )
        values["unsure"] = table["unsure"].strip()
    if "ratio" in table:
        if channel != "steer_angle":
            raise refuse(at, "ratio", "is the steering ratio, of steer_angle")
        values["ratio"] = _check_ratio(at, table["ratio"], refuse)
    if "valid" in table:
        values["valid"] = _check_flag(at, table["valid"], refuse)
    if "counter" in table:
        values["counter"] = _check_counter(at, table["counter"], refuse)
    if "hold" in table:
        if not isinstance(table["hold"], bool):
            raise refuse(at, "hold", "must be true or false")
        values["hold"] = table["hold"]
    return SignalSource(**values)


def _check_names(channel: str, at: str, name: Any, refuse: Any) -> tuple[str, ...]:
    """Return the name of the signal, or those of left and right wheel."""
    names = [name] if isinstance(name, str) else name
    is_axle = channel in SIDES
    if (
        not isinstance(names, list)
        or not names
        or not all(isinstance(n, str) and n for n in names)
        or len(names) > 2
    ):
        two = ", or two of them: left and right wheel" if is_axle else ""
        raise refuse(at, "name", f'must be the name of a signal{two}: name = "..."')
    if len(names) == 2 and not is_axle and channel != "steer_angle":
        raise refuse(at, "name", f"two names are for wheels: {', '.join(SIDES)}")
    if len(set(names)) < len(names):
        raise refuse(at, "name", f"{names[0]!r} cannot be both wheels")
    return tuple(names)


def _check_unit(channel: str, at: str, table: dict[str, Any], refuse: Any) -> str:
    """Return the unit of a signal, which must be convertible to that of the channel."""
    unit, usual = table["unit"], _list_units(channel)
    if not isinstance(unit, str) or parse_unit(unit) is None:
        raise refuse(
            at, "unit", f"{unit!r} is no unit that is known; for {channel} {usual} are, for instance"
        )
    if channel.startswith("ref_") or "above" in table:
        return unit
    wanted = find_unit(channel)
    if unit_factor(unit, wanted, 1.0) is None:
        raise refuse(at, "unit", f"{unit!r} cannot be turned into {wanted}; {usual} can, for instance")
    return unit


def _check_ratio(at: str, value: Any, refuse: Any) -> float | tuple[tuple[float, float], ...]:
    """Return the steering ratio, or its table over the angle."""
    if not isinstance(value, list):
        return _check_number(at, "ratio", value, MIN_RATIO, MAX_RATIO, "", refuse)
    if len(value) < 2 or not all(isinstance(row, list) and len(row) == 2 for row in value):
        raise refuse(
            at,
            "ratio",
            "a table has two rows or more of angle of the steering wheel, ratio: [[-300, 14.0], [0, 16.0], "
            "[300, 14.0]]",
        )
    rows = []
    for i, row in enumerate(value):
        angle = _check_number(at, f"ratio, row {i + 1}, angle", row[0], -1e5, 1e5, "", refuse)
        rows.append(
            (angle, _check_number(at, f"ratio, row {i + 1}, ratio", row[1], MIN_RATIO, MAX_RATIO, "", refuse))
        )
        if i and rows[i][0] <= rows[i - 1][0]:
            raise refuse(
                at, "ratio", f"row {i + 1}: angles must increase: {rows[i][0]:g} follows {rows[i - 1][0]:g}"
            )
    return tuple(rows)


def _check_flag(at: str, value: Any, refuse: Any) -> Flag:
    """Return the flag of the key valid."""
    if isinstance(value, str):
        return Flag(value)
    if isinstance(value, dict) and set(value) <= {"name", "is"} and isinstance(value.get("name"), str):
        allowed = value.get("is")
        allowed = allowed if isinstance(allowed, list) or allowed is None else [allowed]
        if allowed is None or (allowed and all(isinstance(x, (int, float)) for x in allowed)):
            return Flag(value["name"], None if allowed is None else tuple(float(x) for x in allowed))
    raise refuse(
        at,
        "valid",
        'must be the name of a signal that is not 0 where this one is valid, or {name = "...", is = [0]}',
    )


def _check_counter(at: str, value: Any, refuse: Any) -> Counter:
    """Return the counter of the key counter."""
    if isinstance(value, str):
        return Counter(value)
    if isinstance(value, dict) and set(value) <= {"name", "modulo"} and isinstance(value.get("name"), str):
        modulo = value.get("modulo")
        if modulo is None:
            return Counter(value["name"])
        if isinstance(modulo, int) and not isinstance(modulo, bool) and 2 <= modulo <= 2**32:
            return Counter(value["name"], modulo)
    raise refuse(at, "counter", 'must be the name of the message\'s counter, or {name = "...", modulo = 16}')


def _check_number(at: str, key: str, value: Any, low: float, high: float, unit: str, refuse: Any) -> float:
    """Return a number that is inside its range."""
    allowed = f"allowed: {low:g} .. {high:g}{f' {unit}' if unit else ''}"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise refuse(at, key, f"{value!r} is no number; {allowed}")
    if not low <= value <= high:
        raise refuse(at, key, f"{value:g} is out of range; {allowed}")
    return float(value)


def _list_units(channel: str) -> str:
    """Return the usual units of a channel, for messages."""
    usual = {
        "rad": "rad, deg",
        "rad/s": "rad/s, rpm, km/h, m/s, mph" if "wheel" in channel else "rad/s, deg/s",
        "m/s2": "m/s2, g",
        "m/s": "m/s, km/h, mph",
        "Nm": "Nm",
    }
    return usual.get(find_unit(channel), "SI units")


def _find_line(text: str, table: str, key: str) -> str:
    """Return the line of a key as the start of a message; "" if it is not found."""
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
