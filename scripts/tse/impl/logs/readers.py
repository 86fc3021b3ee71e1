"""Readers, one per family of formats: a path in, a Recording out. Which: by what the file begins with, then by its suffix."""

import importlib
import re
from pathlib import Path

from tse.impl.errors import NoFile, UserError
from tse.impl.logs.recording import How, Recording, in_room

# module, its suffixes, what a file of it begins with
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
OTHERS = {  # what people have, that nobody reads here, and what to do
    ".xlsx": "save the sheet as CSV", ".xls": "save the sheet as CSV", ".ods": "save the sheet as CSV", ".zip": "unpack it first",
    ".gz": "unpack it first", ".7z": "unpack it first", ".rar": "unpack it first", ".tar": "unpack it first",
    ".pcap": "record the bus as BLF, ASC or MF4", ".pcapng": "record the bus as BLF, ASC or MF4",
    ".dbc": "this is the database, not the log: name it with --database",
    ".arxml": "this is the database, not the log: name it with --database", ".a2l": "this describes an ECU, it is not a log",
    ".toml": "a log is needed here", ".pkl": "save the table as Parquet", ".pickle": "save the table as Parquet",
    ".npz": "save the arrays as MAT or Parquet", ".npy": "save the arrays as MAT or Parquet", ".tdms": "export it as MF4 or CSV",
    ".d97": "export it as MF4", ".ld": "export it as CSV or MAT",
    ".json": "save the table as Parquet or CSV",
}  # fmt: skip
CANDUMP = re.compile(rb"\(\d+\.\d+\)\s+\w+\s+[0-9A-Fa-f]+#")  # (1489113253.31) can0 083#0FE0, whatever the file is called
# a table with a frame per row: SavvyCAN's, python-can's and others of time, identifier, bytes
FRAMES = re.compile(
    rb"[\"']?time[^,;\t\n]*[,;\t][^\n]*\b(id|arbitration_?id|can_?id|identifier)\b[^\n]*[,;\t]\s*[\"']?(data|d0|d1|byte_?[01]|data_?[01])\b",
    re.IGNORECASE,
)
FORMATS = "CSV, MF4/MDF, VBOX, BLF, ASC, TRC, MCAP, ROS bags, Parquet, Feather, MAT, openpilot's rlog"


def reader_of(path: Path) -> str:
    """Name of the module that reads it. UserError: nobody does."""
    if path.is_dir():
        if (path / "metadata.yaml").exists():
            return "rosbag"
        raise UserError(f"{path}: is a directory, not a log (a ROS 2 bag's has a metadata.yaml)")
    if path.exists() and not path.is_file():  # a pipe or a device may never end
        raise UserError(f"{path}: is no file; a log is read more than once, so write it to a file first")
    try:
        with open(path, "rb") as file:
            head = file.read(256)
    except FileNotFoundError:
        raise NoFile(f"{path}: no such file") from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    if not head.strip():
        raise UserError(f"{path}: is empty")
    for name, (_, beginnings) in READERS.items():
        if head.startswith(beginnings):
            return name
    if CANDUMP.match(head.lstrip()) or FRAMES.match(head.lstrip(b"\xef\xbb\xbf \r\n")):
        return "can"
    suffix = path.suffix.lower()
    if suffix in OTHERS:
        raise UserError(f"{path}: cannot be read as it is: {OTHERS[suffix]}; read are {FORMATS}")
    text = b"\0" not in head or head.startswith((b"\xff\xfe", b"\xfe\xff"))
    found = next((name for name, (suffixes, _) in READERS.items() if suffix in suffixes), None)
    if found in ("mdf", "mcap", "rosbag", "columns", "mat") and not (text and suffix == ".dat"):
        raise UserError(f"{path}: does not begin as {suffix} files do: it is cut off, or of another format; read are {FORMATS}")
    if found == "can" and suffix in (".log", ".can") and text:
        return "text"  # .log is the end of many a name
    if found in ("can", "openpilot", "vbo"):
        return found
    if text:
        return "text"
    raise UserError(f"{path}: is a binary file of no format that is known here; read are {FORMATS}")


def read_recording(path: Path, how: How | None = None) -> Recording:
    """A log as it is in its file. UserError: it cannot be read; the text says what helps."""
    path = Path(path)
    module = importlib.import_module(f"tse.impl.logs.read_{reader_of(path)}")
    with in_room(path):
        found: Recording = module.read(path, how or How())
    if not any(len(c) for c in found) and (how is None or how.wanted is None):
        raise UserError(f"{path}: has no channel with numbers in it")
    return found.since_start()
