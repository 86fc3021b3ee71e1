"""Choose the reader of a log by its first bytes, then by its suffix, and read it."""

import gzip
import importlib
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from tse.library.errors import NoFile, UserError
from tse.readers.bus_text import detect_bus_text
from tse.readers.databases import DATABASE_SUFFIXES as DATABASES
from tse.readers.recording import ReadOptions, Recording, limit_memory, limit_time

# Key: name of a module of this folder, without its prefix read_. Value: suffixes, and
# possible first bytes, of the files that the module reads
READERS: dict[str, tuple[tuple[str, ...], tuple[bytes, ...]]] = {
    "mdf": ((".mf4", ".mdf", ".dat", ".mf3"), (b"MDF     ", b"UnFinMF ")),
    "can": ((".blf", ".asc", ".trc", ".log", ".can"), (b"LOGG",)),
    "mcap": ((".mcap",), (b"\x89MCAP0\r\n",)),
    "rosbag": ((".bag", ".db3"), (b"#ROSBAG", b"SQLite format 3\0")),
    "columns": ((".parquet", ".pq", ".feather", ".arrow", ".ipc"), (b"PAR1", b"ARROW1", b"FEA1")),
    "mat": ((".mat", ".h5", ".hdf5"), (b"MATLAB 5.0", b"MATLAB 7.3", b"\x89HDF")),
    "openpilot": ((".rlog", ".qlog", ".bz2", ".zst"), ()),
    "vbo": ((".vbo",), ()),
    "text": ((".csv", ".tsv", ".txt", ".tab", ".dat"), ()),
}
UNREADABLE = {  # key: suffix of a file that no module reads; value: advice to the user
    ".xlsx": "save the sheet as CSV",
    ".xls": "save the sheet as CSV",
    ".ods": "save the sheet as CSV",
    ".zip": "unpack it first",
    ".7z": "unpack it first",
    ".rar": "unpack it first",
    ".tar": "unpack it first",
    ".pcap": "record the bus as BLF, ASC or MF4",
    ".pcapng": "record the bus as BLF, ASC or MF4",
    ".dbc": "this is the database, not the log: name it with --database",
    ".arxml": "this is the database, not the log: name it with --database",
    ".a2l": "this describes an ECU, it is not a log",
    ".toml": "this is a file of settings, not a log",
    ".pkl": "save the table as Parquet",
    ".pickle": "save the table as Parquet",
    ".npz": "save the arrays as MAT or Parquet",
    ".npy": "save the arrays as MAT or Parquet",
    ".tdms": "export it as MF4 or CSV",
    ".d97": "export it as MF4",
    ".ld": "export it as CSV or MAT",
    ".json": "save the table as Parquet or CSV",
}
HEAD_BYTES = 1 << 14  # [bytes] first part of a file that is read to detect its format
FORMATS = "CSV, MF4/MDF, VBOX, BLF, ASC, TRC, MCAP, ROS bags, Parquet, Feather, MAT, openpilot's rlog"


def choose_reader(path: Path) -> str:
    """Return the name of the module that reads a log, without its prefix read_.

    Raises
    ------
    UserError
        The log does not exist, is empty, or has a format that no module reads.
    """
    if path.is_dir():
        if (path / "metadata.yaml").exists():
            return "rosbag"
        raise UserError(
            f"{path}: is a directory without metadata.yaml; the only directory that is read as a log is a "
            "ROS 2 bag, which has this file"
        )
    if path.exists() and not path.is_file():  # a pipe or a device may deliver data for ever
        raise UserError(
            f"{path}: is no file but a pipe or a device; a log is read more than once, so write it to a "
            "file first"
        )
    try:
        with open(path, "rb") as file:
            head = file.read(HEAD_BYTES)
    except FileNotFoundError:
        raise NoFile(f"{path}: no such file") from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    if not head.strip():
        raise UserError(f"{path}: is empty")
    for name, (_, beginnings) in READERS.items():
        if head.startswith(beginnings):
            return name
    suffix = path.suffix.lower()
    if detect_bus_text(head, suffix):
        return "can"
    if suffix in UNREADABLE:
        raise UserError(f"{path}: cannot be read as it is: {UNREADABLE[suffix]}; readable: {FORMATS}")
    text = b"\0" not in head[:256] or head.startswith((b"\xff\xfe", b"\xfe\xff"))
    found = next((name for name, (suffixes, _) in READERS.items() if suffix in suffixes), None)
    # .log and .can are suffixes of bus logs, but detect_bus_text() found no frames: the
    # file is read as a table
    if found == "can":
        return "text" if text and suffix in (".log", ".can") else "can"
    has_mark = bool(found and READERS[found][1])  # files of this format have known first bytes
    if has_mark and not (text and suffix == ".dat"):
        raise UserError(
            f"{path}: does not begin like a {suffix} file: it is cut off, or has a different format; "
            f"readable: {FORMATS}"
        )
    if found and found != "text" and not has_mark:
        return found
    if text:
        return "text"
    raise UserError(f"{path}: is a binary file of an unknown format; readable: {FORMATS}")


GZIP = b"\x1f\x8b"  # first bytes of a gzip file
MIN_UNPACKED_LIMIT = 64 << 20  # [bytes] size after unpacking up to which every gzip file is read
# largest ratio of unpacked to packed size of a gzip file whose unpacked size exceeds
# MIN_UNPACKED_LIMIT. A file with a larger ratio is refused: it may be crafted to fill the
# disk
MAX_UNPACKED_RATIO = 40


@contextmanager
def unpack_log(path: Path) -> Iterator[Path]:
    """Yield the path of an unpacked log; unpack a gzip file into a temporary folder.

    The folder is deleted when the block of the context manager ends.

    Parameters
    ----------
    path : Path
        The log, packed by gzip (for example drive.csv.gz) or not.

    Yields
    ------
    Path
        The unpacked file, without .gz in its name; `path` itself if it is not packed.

    Raises
    ------
    UserError
        The gzip file is damaged, or its content is larger than the limit.
    """
    try:
        with open(path, "rb") as file:
            packed = path.is_file() and file.read(2) == GZIP
    except OSError:
        packed = False  # the file cannot be opened: the reader reports it
    if not packed:
        yield path
        return
    name = path.name[:-3] if path.suffix.lower() == ".gz" else path.name
    room = max(MIN_UNPACKED_LIMIT, MAX_UNPACKED_RATIO * path.stat().st_size)
    with tempfile.TemporaryDirectory(prefix="tselab-") as folder:
        plain = Path(folder) / (name or "log")
        try:
            with gzip.open(path, "rb") as source, open(plain, "wb") as target:
                while part := source.read(1 << 20):
                    if target.tell() + len(part) > room:
                        raise UserError(
                            f"{path}: is larger than {room >> 20:,} MB after unpacking; allowed: "
                            f"{MAX_UNPACKED_RATIO} times the packed size, at least "
                            f"{MIN_UNPACKED_LIMIT >> 20} MB; if it is a log, unpack it by gunzip first"
                        )
                    target.write(part)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise UserError(
                f"{path}: is damaged or cut off: {error}; copy it again, or "
                "unpack the part before the damage (gunzip -c)"
            ) from None
        except OSError as error:
            raise UserError(f"{path}: cannot be unpacked: {error.strerror or error}") from None
        yield plain


def read_recording(path: Path, how: ReadOptions | None = None) -> Recording:
    """Read a log of any format.

    Parameters
    ----------
    path : Path
        The log.
    how : ReadOptions, optional
        Options of the reader. None: the defaults.

    Raises
    ------
    UserError
        The log cannot be read. The message states the remedy.
    """
    path = Path(path)
    with limit_time(path), unpack_log(path) as plain:
        if plain == path:
            return _read_plain(path, how)
        how = how or ReadOptions()
        beside = how.databases or tuple(
            sorted(p for p in path.parent.iterdir() if p.suffix.lower() in DATABASES)
        )
        try:
            found = _read_plain(plain, replace(how, databases=beside))
        except UserError as error:
            raise UserError(str(error).replace(str(plain), str(path))) from None
        return replace(found, path=path)


def _read_plain(path: Path, how: ReadOptions | None) -> Recording:
    """Read an unpacked log."""
    module = importlib.import_module(f"tse.readers.read_{choose_reader(path)}")
    try:
        with limit_memory(path):
            found: Recording = module.read(path, how or ReadOptions())
    except UserError:
        raise
    except MemoryError:
        raise UserError(
            f"{path}: reading takes more memory than the machine has: cut a long log into drives; if the log "
            "is short, it is damaged, or crafted to exhaust memory"
        ) from None
    except Exception as error:  # in most cases the file is damaged
        said = f"{type(error).__name__}: {str(error)[:120]}"
        raise UserError(
            f"{path}: cannot be read ({said}): it is damaged, or of an unknown variant of its format; "
            "if a different program can read it, please report it to the authors of tse"
        ) from error
    if not any(len(c) for c in found) and (how is None or how.wanted is None):
        raise UserError(f"{path}: has no channel with numbers in it")
    return found.since_start()
