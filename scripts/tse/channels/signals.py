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

MIN_RATE, MAX_RATE = 2.0, 1000.0  # [Hz] range of the rate of the rows
MAX_SIGNAL_LATENCY = 1.0  # [s] max latency of a signal
# [s] max difference between two clocks. It is large, since some clocks count from 1970,
# others from the start of the log.
MAX_CLOCK = 4e9
LOG_KEYS = {f.name for f in fields(ReadOptions)} - {"wanted"} | {"rate"}
SIGNAL_KEYS = (
    *("name", "add", "unit", "sign", "sign_bit", "scale", "offset", "ratio", "radius", "latency"),
    *("clock", "valid", "counter", "hold", "above", "unsure"),
)
NUMBER_RANGES = {  # key -> min, max, unit
    "scale": (-1e9, 1e9, ""),  # factor that is applied in addition to that of the unit
    "offset": (-1e6, 1e6, ""),  # subtracted from the signal, in its unit
    "radius": (0.05, 5.0, "m"),  # radius of the wheel, to convert a speed to rad/s
    # channel brake: value in the unit of the signal above which the car brakes
    "above": (-1e6, 1e6, ""),
    # delay from a measurement to its time in the log
    "latency": (-MAX_SIGNAL_LATENCY, MAX_SIGNAL_LATENCY, "s"),
    # time stamp of the signal minus time stamp of the other signals at the same instant
    "clock": (-MAX_CLOCK, MAX_CLOCK, "s"),
}
MIN_RATIO, MAX_RATIO = 0.5, 100.0  # range of the steering ratio


@dataclass(frozen=True)
class Flag:
    """A validity flag: a signal that states whether a measurement is valid."""

    name: str
    values: tuple[float, ...] | None = None  # values that mean valid; None: all but 0


@dataclass(frozen=True)
class Counter:
    """The counter of a message. If it does not change, the message is a repetition."""

    name: str
    modulo: int | None = None  # None: determined from the log


@dataclass(frozen=True)
class SignalSource:
    """The source of one channel: a table [signals.CHANNEL]."""

    channel: str
    name: tuple[str, ...]  # name of the signal, or names of left and right wheel
    unit: str | None = None  # None: the unit in the log
    sign: float = 1.0
    sign_bit: str | None = None  # name of a signal; where it is 1, the value is negated
    scale: float = 1.0
    offset: float = 0.0
    # Steering ratio: angle of the steering wheel / angle of the road wheels. It is a
    # number or, if it depends on the angle, a table. Rows of the table: (angle of the
    # steering wheel in the unit of the signal, ratio).
    ratio: float | tuple[tuple[float, float], ...] | None = None
    radius: float | None = None  # [m] radius of the wheel; None: that of the car
    latency: float = 0.0  # [s] as in NUMBER_RANGES
    clock: float = 0.0  # [s] as in NUMBER_RANGES
    valid: Flag | None = None
    counter: Counter | None = None
    hold: bool = False  # True: sent only if it changes, so each value is held until the next one
    # Threshold in the unit of the signal. The channel is 1 if the signal exceeds the
    # threshold, otherwise 0. None: no threshold.
    above: float | None = None
    # Name of a second signal that is added to the first one, in the same unit. Example:
    # the first one is the angle in steps of 1 deg, the second one its fraction in deg
    add: str | None = None
    # Properties of the source that were guessed but not tested, e.g. "the sign"; "":
    # none. Every run warns of them.
    unsure: str = ""


@dataclass(frozen=True)
class SignalsFile:
    """The contents of signals.toml."""

    path: Path | None  # None: there is no file, the log has the library's names
    signals: Mapping[str, SignalSource]  # channel -> its source
    how: ReadOptions = field(default_factory=ReadOptions)  # table [log]: options of reading
    # [Hz] rate of the rows of the result. None: the rows of the log if all channels share
    # them, otherwise the rate of the fastest channel, at most 100 Hz
    rate: float | None = None

    def wants(self, name: str) -> bool:
        """Return whether any channel is made from the signal `name`, e.g. as its value or
        as its validity flag.

        `name` and the names in signals.toml may be SIGNAL or MESSAGE.SIGNAL. SIGNAL fits
        the signal of this name in any message."""
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
    """Return the signals.toml of a log (None: no such file), and the options with which
    to read the log.

    Parameters
    ----------
    log : Path
        The log.
    file : Path or None
        Path of signals.toml. None: the signals.toml next to the log, if there is one.
    databases : sequence of Path
        Databases of the bus, e.g. DBC files. They take precedence over those in the table
        [log] of signals.toml.
    """
    file = file or find_signals_file(log)
    signals = read_signals(file) if file is not None else None
    how = signals.how if signals is not None else ReadOptions()
    given = {p.resolve() for p in databases}
    more = (p for p in how.databases if p.resolve() not in given)
    return signals, replace(how, databases=(*databases, *more))


def list_channels() -> list[str]:
    """Return the channels that signals.toml may assign, except ref_* (references)."""
    return [
        *(f.name for f in library().channels),
        *(s for pair in SIDES.values() for s in pair),
        *OPTIONAL_COLUMNS,
    ]


def find_unit(channel: str) -> str:
    """Return the SI unit of a channel; "" for ref_* and for unknown channels."""
    axle = next((a for a, pair in SIDES.items() if channel in pair), channel)
    if axle in OPTIONAL_COLUMNS:
        return OPTIONAL_COLUMNS[axle][0]
    return next((f.unit for f in library().channels if f.name == axle), "")


def read_signals(path: Path) -> SignalsFile:
    """Read and check signals.toml.

    Raises
    ------
    UserError
        The file is invalid. The message states file, line, key and the allowed values.
    """
    path = Path(path)
    data = read_toml(path)
    text = path.read_text(encoding="utf-8-sig")

    def refuse(table: str, key: str, message: str) -> UserError:
        """Return the error about a key of a table, with file and line. `key` "": the
        error is about the table itself."""
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
            f"{path}: assigns no channel: tables like [signals.yaw_rate] are needed; 'tselab signals LOG "
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
    """Raise an error if signals are assigned both to an axle and to its wheels, or only
    to one of the two wheels.

    `found`: channel -> its source. `refuse`: function (table, key, message) that makes
    the error."""
    for axle, pair in SIDES.items():
        if axle in found and any(s in found for s in pair):
            raise refuse(
                f"signals.{axle}",
                "",
                f"is assigned together with {' and '.join(s for s in pair if s in found)}: leave out the "
                "axle or its wheels",
            )
        if any(s in found for s in pair) and not all(s in found for s in pair):
            lone = next(s for s in pair if s in found)
            missing = next(s for s in pair if s not in found)
            raise refuse(
                f"signals.{lone}",
                "",
                f"{missing} is needed, too; if the axle has only one sensor, name the channel {axle}",
            )


def _check_log(path: Path, log: dict[str, Any], refuse: Any) -> tuple[ReadOptions, float | None]:
    """Check the table [log]. Return its options of reading, and the rate of the rows, Hz
    (None: not stated)."""
    for key, value in log.items():
        if key not in LOG_KEYS:
            raise refuse(
                "log",
                key,
                f"is not known{suggest_names(key, LOG_KEYS, 1)}; keys: {', '.join(sorted(LOG_KEYS))}",
            )
        if key in ("time", "time_unit", "separator", "decimal", "encoding") and not isinstance(value, str):
            raise refuse("log", key, f"{value!r} is not a string in quotes")
    rate = (
        _check_number("log", "rate", log["rate"], MIN_RATE, MAX_RATE, "Hz", refuse) if "rate" in log else None
    )
    step = _check_number("log", "step", log["step"], 1e-4, 1.0, "s", refuse) if "step" in log else None
    if "time_unit" in log and unit_factor(log["time_unit"], "s") is None:
        raise refuse("log", "time_unit", f"{log['time_unit']!r} is not a unit of time: s, ms, us, ns")
    if log.get("decimal", ".") not in (".", ","):
        raise refuse("log", "decimal", f'{log["decimal"]!r} is not allowed; allowed: "." and ","')
    header = log.get("header")
    if header is not None and (isinstance(header, bool) or not isinstance(header, int) or header < 1):
        raise refuse("log", "header", f"{header!r} is not a line number; the first line is 1")
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
    """Check the table of a channel and return its source. `at`: name of the table."""
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
        raise refuse(at, "scale", "0 makes the signal 0; allowed: any other number")
    if "radius" in table and "wheel_speed" not in channel:
        raise refuse(at, "radius", "is allowed for wheel speeds only")
    if "above" in table and channel != "brake":
        raise refuse(at, "above", "is allowed for brake only")
    if "sign" in table:
        if table["sign"] not in (1, -1) or isinstance(table["sign"], bool):
            raise refuse(at, "sign", f"{table['sign']!r} is not allowed; allowed: 1 and -1")
        values["sign"] = float(table["sign"])
    if "unit" in table:
        values["unit"] = _check_unit(channel, at, table, refuse)
    for key, what in (
        ("sign_bit", "the name of a signal that is 1 if the value is negative"),
        ("add", "the name of a signal with the fine part of the value, in the same unit"),
    ):
        if key in table:
            if not isinstance(table[key], str):
                raise refuse(at, key, f"must be {what}")
            values[key] = table[key]
    if "add" in table and len(names) > 1:
        raise refuse(at, "add", "is allowed with one name only")
    if "unsure" in table:
        if not isinstance(table["unsure"], str) or not table["unsure"].strip():
            raise refuse(
                at,
                "unsure",
                'must state what is unsure: unsure = "the sign"; after you have checked it, delete it',
            )
        values["unsure"] = table["unsure"].strip()
    if "ratio" in table:
        if channel != "steer_angle":
            raise refuse(at, "ratio", "is the steering ratio: allowed for steer_angle only")
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
    """Check the key `name`. Return the name of the signal, or the names of the signals of
    the left and right wheel."""
    names = [name] if isinstance(name, str) else name
    is_axle = channel in SIDES
    if (
        not isinstance(names, list)
        or not names
        or not all(isinstance(n, str) and n for n in names)
        or len(names) > 2
    ):
        two = ", or a list of two names: left and right wheel" if is_axle else ""
        raise refuse(at, "name", f'must be the name of a signal{two}: name = "..."')
    if len(names) == 2 and not is_axle and channel != "steer_angle":
        raise refuse(at, "name", f"two names are allowed for wheels only: {', '.join(SIDES)}")
    if len(set(names)) < len(names):
        raise refuse(at, "name", f"{names[0]!r} cannot be both left and right wheel")
    return tuple(names)


def _check_unit(channel: str, at: str, table: dict[str, Any], refuse: Any) -> str:
    """Return the value of the key `unit`; raise an error if it does not fit the
    channel."""
    unit, usual = table["unit"], _list_units(channel)
    if not isinstance(unit, str) or parse_unit(unit) is None:
        raise refuse(at, "unit", f"{unit!r} is not a known unit; usual units of {channel}: {usual}")
    if channel.startswith("ref_") or "above" in table:
        return unit
    wanted = find_unit(channel)
    if unit_factor(unit, wanted, 1.0) is None:
        raise refuse(at, "unit", f"{unit!r} cannot be converted to {wanted}; usual units: {usual}")
    return unit


def _check_ratio(at: str, value: Any, refuse: Any) -> float | tuple[tuple[float, float], ...]:
    """Check the key `ratio`. Return the steering ratio, or pairs (angle of the steering
    wheel in the unit of the signal, steering ratio)."""
    if not isinstance(value, list):
        return _check_number(at, "ratio", value, MIN_RATIO, MAX_RATIO, "", refuse)
    if len(value) < 2 or not all(isinstance(row, list) and len(row) == 2 for row in value):
        raise refuse(
            at,
            "ratio",
            "a table needs at least two rows [angle of the steering wheel, ratio]: [[-300, 14.0], [0, 16.0], "
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
    """Check the key `valid`, and return the validity flag that it names."""
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
        'must be the name of a signal that is not 0 if this one is valid, or {name = "...", is = [0]} with '
        "the values that mean valid",
    )


def _check_counter(at: str, value: Any, refuse: Any) -> Counter:
    """Check the key `counter`, and return the message counter that it names."""
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
    """Return the value of a key as a float; raise an error if it is outside low ..
    high."""
    allowed = f"allowed: {low:g} .. {high:g}{f' {unit}' if unit else ''}"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise refuse(at, key, f"{value!r} is not a number; {allowed}")
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
    """Return the line of a key as the start of a message, e.g. "line 3, ".

    Return "" if the key is not found."""
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
