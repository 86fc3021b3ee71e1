"""Find the logs of a fleet, and for each log its car and the time when it was driven."""

import fnmatch
import glob
import importlib
import io
import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from pathlib import Path

import pandas as pd

from tse.library.errors import NoFile, UserError, suggest_names
from tse.library.files import check_regular, resolve_path
from tse.readers.readers import READERS

# Suffixes of logs that many other files have as well. A file with such a suffix is read
# only if the user names it or gives a glob pattern that matches it. The search of a
# folder for logs skips such files.
AMBIGUOUS_SUFFIXES = {".txt", ".log", ".tab", ".h5", ".hdf5", ".bz2", ".zst", ".ipc", ".arrow", ".can"}
SUFFIXES = {s for suffixes, _ in READERS.values() for s in suffixes} - AMBIGUOUS_SUFFIXES
# ends of the names of files that `tselab estimate` writes; these files are not logs
RESULTS = (".est.csv", ".est.parquet")
MAX_TABLE = 256 << 20  # [byte] max size of a table of vehicles (option --vehicles)
# columns of a table of vehicles; only log and vehicle are required
TABLE_COLUMNS = ("log", "vehicle", "car", "signals")
OPENPILOT = ("rlog.bz2", "rlog.zst", "qlog.bz2", "qlog.zst")  # ends of the names of logs of openpilot
# date in the name of a file, and the time of day after it if there is one
DATE = re.compile(
    r"(?<!\d)(20\d\d|19\d\d)[-_.]?(0[1-9]|1[0-2])[-_.]?(0[1-9]|[12]\d|3[01])"
    r"(?:[-_.T ]{0,3}([01]\d|2[0-3])[-_.:h]?([0-5]\d)(?:[-_.:m]?([0-5]\d))?)?(?!\d)"
)


@dataclass(frozen=True)
class Drive:
    """One log of a fleet, and its car."""

    car: str
    log: Path
    vehicle: Path | None = None
    signals: Path | None = None
    start: float = 0.0  # [s since 1970] time when the drive began
    start_from: str = "file"  # source of `start`, see find_start()
    error: str = ""  # reason why the log cannot be estimated; empty: it can be estimated


def find_drives(
    words: Sequence[str], vehicle: Path | None, table: Path | None, car: str | None, out: Path
) -> list[Drive]:
    """Return all logs, sorted by car and by the time of the drive.

    `words`: files, folders and glob patterns. `table`: CSV with the vehicle file and the
    car of each log. If it is given, `vehicle` and `car` are not used. If it is None, all
    logs have the vehicle file `vehicle` and belong to the car named `car`. If `table` and
    `car` are None, each folder has the logs of one car, which is named after the folder.
    `out`: folder of the results, which is not searched for logs."""
    logs = _find_logs(words, out, table)
    found = _assign_by_table(logs, table) if table is not None else _assign_by_folder(logs, vehicle, car)
    timed = [replace(d, start=s, start_from=f) for d in found for s, f in (find_start(d.log),)]
    return sorted(timed, key=lambda d: (d.car, d.start, str(d.log)))


# ---- logs


def _find_logs(words: Sequence[str], out: Path, table: Path | None) -> list[tuple[Path, Path]]:
    """Return every log once, as a pair: path of the log, folder of the car. If the user
    gives no name for the car, the car is named after this folder. Raise UserError if a
    folder contains no log, or if one of `words` matches no file."""
    found: dict[Path, tuple[Path, Path]] = {}
    not_logs = {resolve_path(out), *([resolve_path(table)] if table is not None else [])}
    for word in words:
        path = Path(word)
        if path.is_dir() and not _is_bag(path):
            inside = list(_walk_logs(path, not_logs))
            if not inside:
                raise UserError(
                    f"{path}: no log is in this folder; a log has one of these suffixes: "
                    f"{' '.join(sorted(SUFFIXES))}"
                )
            mine = [(p, path / p.relative_to(path).parts[0] if p.parent != path else path) for p in inside]
        elif path.exists():
            mine = [(path, path.parent)]
        else:
            mine = [
                (p, p.parent)
                for p in map(Path, sorted(glob.glob(word, recursive=True)))
                if p.is_file() or _is_bag(p)
            ]
            if not mine:
                raise NoFile(f"{word}: no such file or folder, and no file matches it as a pattern")
        for p, folder in mine:
            found.setdefault(resolve_path(p), (p, resolve_path(folder)))
    return list(found.values())


def _is_bag(path: Path) -> bool:
    """Return whether a path is a ROS 2 bag: a log that is a folder of several files."""
    return path.is_dir() and (path / "metadata.yaml").is_file()


def _walk_logs(folder: Path, not_logs: set[Path]) -> Iterator[Path]:
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or resolve_path(path) in not_logs:
            continue
        if path.is_dir() and not _is_bag(path):
            yield from _walk_logs(path, not_logs)
        elif _is_bag(path) or _is_log_name(path.name.lower()):
            yield path


def _is_log_name(name: str) -> bool:
    plain = name.removesuffix(".gz")
    return name.endswith(OPENPILOT) or (Path(plain).suffix in SUFFIXES and not plain.endswith(RESULTS))


# ---- cars


def _assign_by_folder(
    logs: Sequence[tuple[Path, Path]], vehicle: Path | None, car: str | None
) -> list[Drive]:
    folders = sorted({folder for _, folder in logs})
    names = {f: car or _shorten_name(f, folders) for f in folders}
    return [Drive(names[folder], path, vehicle) for path, folder in logs]


def _shorten_name(folder: Path, others: Sequence[Path]) -> str:
    """Return the shortest end of the path `folder` that no other path in `others` has.
    `others` contains `folder`, too."""
    for parts in range(1, len(folder.parts) + 1):
        name = "/".join(folder.parts[-parts:])
        if sum("/".join(o.parts[-parts:]) == name for o in others) == 1:
            return name
    return str(folder)


def _assign_by_table(logs: Sequence[tuple[Path, Path]], table: Path) -> list[Drive]:
    """Return a drive for each log. Car, vehicle file and signals of the drive are taken
    from the first row of the table whose column `log` matches the log. If no row matches
    the log, the drive has an error."""
    rows = _read_table(table)
    base = resolve_path(table).parent
    vehicles = sorted({resolve_path(base / r["vehicle"]).with_suffix("") for r in rows})
    found = []
    for path, _ in logs:
        row = next((r for r in rows if _is_match(resolve_path(path), base, r["log"])), None)
        if row is None:
            found.append(Drive("", path, error=f"{path}: no row of {table.name} matches this log"))
            continue
        vehicle = resolve_path(base / row["vehicle"])
        name = row["car"] or _shorten_name(vehicle.with_suffix(""), vehicles)
        found.append(Drive(name, path, vehicle, base / row["signals"] if row["signals"] else None))
    return found


def _is_match(path: Path, base: Path, pattern: str) -> bool:
    """Return whether `pattern`, a value of the column log, matches the log `path`. The
    value may be the path of the log, the path of a folder that contains the log, or a
    glob pattern. Paths are relative to `base`, the folder of the table."""
    return base / pattern in (path, *path.parents) or fnmatch.fnmatch(
        str(path), str(Path(glob.escape(str(base))) / pattern)
    )


def _read_table(table: Path) -> list[dict[str, str]]:
    """Read and check a table of vehicles. Return its rows."""
    check_regular(table, MAX_TABLE, "a table of vehicles")
    try:
        with open(table, encoding="utf-8-sig") as file:
            # only a whole line can be a comment, since file names may contain "#"
            lines = {n: text for n, text in enumerate(file, 1) if text.strip() and not text.startswith("#")}
        head = next(iter(lines.values()), "")
        separator = ";" if ";" in head and "," not in head else ","
        read = pd.read_csv(
            io.StringIO("".join(lines.values())),
            dtype=str,
            keep_default_na=False,
            skipinitialspace=True,
            sep=separator,
        )
    except FileNotFoundError:
        raise NoFile(f"{table}: no such file (option --vehicles)") from None
    except (OSError, UnicodeDecodeError, pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        raise UserError(f"{table}: cannot be read as a CSV: {str(error).strip()[:150]}") from None
    read.columns = [str(c).strip() for c in read.columns]
    if lacks := [c for c in TABLE_COLUMNS[:2] if c not in read]:
        raise UserError(
            f"{table}: column {' and '.join(lacks)} is missing; required: log (a file, a folder or a "
            "pattern like cars/7/*.mf4) and vehicle (vehicle file of the car of this log); optional: car, "
            "signals; paths are relative to the folder of the table"
        )
    for column in (c for c in read if c not in TABLE_COLUMNS):
        hint = suggest_names(str(column), TABLE_COLUMNS, 1)
        raise UserError(f"{table}: column {column} is not known{hint}; allowed: {', '.join(TABLE_COLUMNS)}")
    rows = [{c: str(r.get(c, "")).strip() for c in TABLE_COLUMNS} for r in read.to_dict("records")]
    of: dict[str, str] = {}
    numbers = list(lines)[1:]
    for line, row in zip(numbers, rows, strict=False):
        if row["car"] and of.setdefault(row["car"], row["vehicle"]) != row["vehicle"]:
            before = of[row["car"]]
            raise UserError(
                f"{table}: line {line}, column vehicle: a line above gives the vehicle file {before} for the "
                f"same car {row['car']}: give the same file in all lines of a car"
            )
    for line, row in zip(numbers, rows, strict=False):
        for column in TABLE_COLUMNS[:2]:
            if not row[column]:
                raise UserError(
                    f"{table}: line {line}, column {column}: is empty; each line needs log and vehicle"
                )
        for column in ("vehicle", "signals"):
            if row[column] and not (resolve_path(table).parent / row[column]).is_file():
                raise NoFile(f"{table}: line {line}, column {column}: {row[column]}: no such file")
    return rows


# ---- time


def find_start(path: Path) -> tuple[float, str]:
    """Return the time when a drive began [s since 1970], and the source of this time. The
    first source that is available is used: "log", the start time in the log; "name", a
    date in the name of the log or of its folder; "file", the modification time of the
    file."""
    for source, of in (("log", _read_log_start), ("name", _read_name_date)):
        try:
            when = of(path)
        except (OSError, ValueError, struct.error):
            when = None
        if when is not None and when > 0:
            return when, source
    try:
        return path.stat().st_mtime, "file"
    except OSError:
        return 0.0, "file"


def _read_name_date(path: Path) -> float | None:
    """Return the date in the name of the file or, if it has none, in the name of its
    folder, as s since 1970 UTC. If a time of day follows the date, it is used as well,
    otherwise 00:00. None: there is no date."""
    for name in (path.stem, path.parent.name):
        if m := DATE.search(name):
            year, month, day, hour, minute, second = (int(x or 0) for x in m.groups())
            return datetime(year, month, day, hour, minute, second, tzinfo=timezone.utc).timestamp()
    return None


def _read_log_start(path: Path) -> float | None:
    """Return the start time in the header of a log [s since 1970]. Formats with a start
    time are MDF 4, MDF 3, BLF and MCAP. None: the log has a different format, is a
    folder (ROS 2 bag), or is an MCAP file without a readable summary."""
    if not path.is_file():
        return None
    with open(path, "rb") as file:
        head = file.read(512)
    if head.startswith(b"MDF     4") and head[64:68] == b"##HD":
        return struct.unpack_from("<Q", head, 136)[0] * 1e-9
    if head.startswith(b"MDF     3") and head[64:66] == b"HD":
        text = head[82:100].decode("latin-1")
        return datetime.strptime(text, "%d:%m:%Y%H:%M:%S").replace(tzinfo=timezone.utc).timestamp()
    if head.startswith(b"LOGG"):
        year, month, _, day, hour, minute, second, milli = struct.unpack_from("<8H", head, 40)
        return datetime(year, month, day, hour, minute, second, 1000 * milli, tzinfo=timezone.utc).timestamp()
    if head.startswith(b"\x89MCAP0"):
        return _read_mcap_start(path)
    return None


def _read_mcap_start(path: Path) -> float | None:
    try:
        reader = importlib.import_module("mcap.reader")
        with open(path, "rb") as file:
            summary = reader.make_reader(file).get_summary()
    except Exception:  # the file is damaged, or the package mcap is not installed
        return None
    return 1e-9 * summary.statistics.message_start_time if summary and summary.statistics else None
