"""Read MATLAB files: version 5 by scipy, version 7.3 and other HDF5 by h5py."""

import functools
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tse.library.errors import UserError
from tse.log.units import unit_factor, unit_kind
from tse.readers.recording import Channel, ReadOptions, Recording, check_rows, import_optional, list_names
from tse.readers.table import TIME_WORDS, Column, find_unit_suffix, make_recording, split_unit, split_words

# [bytes] A MAT file of version 5 with at most this unpacked size is read by one call. A
# larger file is read variable by variable, which takes less memory
MAX_BYTES_AT_ONCE = 1 << 25
# Each column of a matrix is a channel. A matrix with more columns than this is skipped
MAX_MATRIX_COLUMNS = 16
MIN_VECTOR_LENGTH = 2  # a shorter vector is skipped
COMPRESSED_TYPE = 15  # miCOMPRESSED: type of an element of version 5 that is packed by zlib
# [bytes] A file of version 5 with a larger unpacked variable is refused. A vector of
# doubles of this size holds 37 h at 1 kHz
MAX_VARIABLE_BYTES = 1 << 30


@dataclass(frozen=True)
class LazyVector:
    """A vector that is read on demand."""

    rows: int
    read: Callable[[], np.ndarray]

    def __len__(self) -> int:
        return self.rows


def read(path: Path, how: ReadOptions) -> Recording:
    """Read vectors and columns of matrices as channels.

    The name of a channel is its path in the structs of the file, for example car.speed.
    The times of a channel are the values of a time vector of the same length. If several
    time vectors have this length, the one that is nearest in the tree of structs is used.
    A vector without such a time vector is skipped."""
    with open(path, "rb") as file:
        head = file.read(128)
    opaque: list[str] = []
    hdf = b"HDF" in head[:8] or head.startswith(b"MATLAB 7.3")
    leaves = list(_walk_version73(path, opaque) if hdf else _walk_version5(path, opaque))
    units = {
        name.rpartition(".")[0]: v
        for name, v in leaves
        if isinstance(v, str) and name.rpartition(".")[2].lower() in ("unit", "units")
    }
    vectors = {name: v for name, v in leaves if isinstance(v, np.ndarray | LazyVector)}
    if not vectors:
        more = ""
        if opaque:
            more = f" ({list_names(opaque)} are MATLAB objects: save them as structs or matrices)"
        raise UserError(f"{path}: has no vectors of numbers{more}")
    notes = [f"MATLAB objects are not read, save them as structs: {list_names(opaque)}"] if opaque else []
    times = {name: v for name, v in vectors.items() if _is_time(name, v, units)}
    if how.time is not None:
        if how.time not in vectors:
            raise UserError(
                f"{path}: there is no vector {how.time!r}: correct [log] time in signals.toml; "
                f"vectors of this file: {list_names(vectors)}"
            )
        times = {how.time: vectors[how.time]}
    if not times and len({len(v) for v in vectors.values()}) == 1:
        columns = [
            Column(n, v.read if isinstance(v, LazyVector) else v, rows=len(v)) for n, v in vectors.items()
        ]
        return make_recording(path, "MAT", columns, how, notes)  # finds the time column, or raises
    clocks: dict[str, np.ndarray] = {}
    channels: dict[str, Channel] = {}
    for name, v in vectors.items():
        if name in times:
            continue
        own = _find_nearest_time(name, len(v), times)
        if own is None:
            continue
        if own not in clocks:
            clocks[own] = _convert_time(path, own, _load(times[own]), units.get(own, ""), how, notes)
        plain, unit = split_unit(_strip_wrappers(name))
        if how.wanted and not how.wanted(plain):
            continue
        unit = unit or units.get(name, "") or units.get(name.rpartition(".")[0], "")
        unit = unit or find_unit_suffix(plain)
        channels[plain] = Channel(plain, clocks[own], _load(v), unit if unit_kind(unit) != "time" else "")
    if not channels:
        raise UserError(
            f"{path}: no vector has the same length as a vector of times; vectors (length): "
            f"{list_names(f'{n} ({len(v)})' for n, v in vectors.items())}. Name "
            'the vector of times in signals.toml: [log] time = "NAME"'
        )
    return Recording(path, "MAT", channels, notes)


def _load(v: np.ndarray | LazyVector) -> np.ndarray:
    """Return a vector; read it if it is not in memory."""
    return v.read() if isinstance(v, LazyVector) else v


def _strip_wrappers(name: str) -> str:
    """Remove general words, such as values, from the end: wheel.values gives wheel."""
    parts = name.split(".")
    while len(parts) > 1 and parts[-1].lower() in ("values", "value", "data", "signals", "samples", "y"):
        parts.pop()
    return ".".join(parts)


def _is_time(name: str, v: np.ndarray | LazyVector, units: dict[str, str]) -> bool:
    """Return whether a vector contains times.

    Its name or its unit must be that of a time. In addition, more than 90 % of its steps
    must be 0 or positive, and at least one step must be positive."""
    w = split_words(name.rpartition(".")[2])
    is_named = bool(w) and (w[-1] in TIME_WORDS or w[0] in TIME_WORDS)
    if not is_named and unit_kind(units.get(name, "")) != "time":
        return False
    v = _load(v)
    step = np.diff(v)
    return bool(np.isfinite(v).any() and (step >= 0).mean() > 0.9 and (step > 0).any())


def _find_nearest_time(name: str, length: int, times: Mapping[str, np.ndarray | LazyVector]) -> str | None:
    """Return the name of the nearest time vector of this length, or None.

    The result is None if no time vector has the length `length`. Nearest means the
    smallest number of steps in the tree of structs from the vector `name` to the time
    vector."""
    fits = [t for t, v in times.items() if len(v) == length]
    path = name.split(".")

    def measure_path(t: str) -> int:
        other = t.split(".")
        same = 0
        while same < min(len(path), len(other)) and path[same] == other[same]:
            same += 1
        return len(path) + len(other) - 2 * same

    return min(fits, key=measure_path) if fits else None


def _convert_time(
    path: Path, name: str, v: np.ndarray, unit: str, how: ReadOptions, notes: list[str]
) -> np.ndarray:
    """Convert a time vector to s.

    If its unit is unknown, convert_to_seconds() guesses the unit from the steps between
    the times."""
    unit = how.time_unit or unit
    if unit and (per := unit_factor(unit, "s")) is not None:
        return v * per
    if not len(v):
        return v
    columns = [Column(name, v), Column("x", v)]
    recording = make_recording(path, "MAT", columns, ReadOptions(time=split_unit(name)[0]), [])
    return next(iter(recording)).time


def _walk_version5(path: Path, opaque: list[str]) -> Iterator[tuple[str, Any]]:
    """Yield paths and values of all vectors and strings in a MAT file of version 5.

    The strings may be units of vectors. The names of MATLAB objects, which cannot be
    read, are added to `opaque`."""
    import scipy.io

    arguments: dict[str, Any] = {"squeeze_me": True, "struct_as_record": False}
    try:
        one_by_one = _measure_unpacked(path) > MAX_BYTES_AT_ONCE
        for only in [[name] for name, _, _ in scipy.io.whosmat(path)] if one_by_one else [None]:
            for name, value in scipy.io.loadmat(path, variable_names=only, **arguments).items():
                if not name.startswith("__"):
                    yield from _walk(name, value, opaque)
    except (UserError, MemoryError):
        raise
    except Exception as error:  # a parser may raise any error
        raise UserError(f"{path}: is damaged or cut off: {str(error)[:120]}; copy it again") from None


def _measure_unpacked(path: Path) -> int:
    """Return the unpacked size [bytes] of all variables in a file of version 5.

    The sizes are those in the headers of the variables: scipy unpacks no more bytes than
    a header states. If a variable is larger than MAX_VARIABLE_BYTES, raise UserError."""
    total = 0
    with open(path, "rb") as file:
        head = file.read(128)
        order = ">" if head[126:128] == b"MI" else "<"
        while len(tag := file.read(8)) == 8:
            kind_, size = struct.unpack(order + "II", tag)
            after = file.tell() + size
            if kind_ == COMPRESSED_TYPE:
                inner = zlib.decompressobj().decompress(file.read(min(size, 4096)), 8)
                size = struct.unpack(order + "II", inner)[1] if len(inner) == 8 else size
            if size > MAX_VARIABLE_BYTES:
                raise UserError(
                    f"{path}: has a variable of {size / 2**30:.1f} GB. At most 1 GB is allowed in MAT "
                    "version 5, because its variables are read as a whole. Save the file with -v7.3"
                )
            total += size
            file.seek(after)
    return total


def _walk(name: str, value: Any, opaque: list[str], depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Yield paths and values of all vectors and strings in a variable read by scipy."""
    if hasattr(value, "_fieldnames"):
        if depth < 8:
            for f in value._fieldnames:
                yield from _walk(f"{name}.{f}", getattr(value, f), opaque, depth + 1)
    elif type(value).__name__ == "MatlabOpaque" or "Opaque" in type(value).__name__:
        opaque.append(name)
    elif isinstance(value, str):
        yield name, value
    elif isinstance(value, np.ndarray):
        if value.dtype == object:
            for i, part in enumerate(value.ravel()[:200]):
                yield from _walk(f"{name}.{i + 1}", part, opaque, depth + 1)
        else:
            yield from _split_columns(name, value)


def _split_columns(name: str, value: np.ndarray) -> Iterator[tuple[str, Any]]:
    """Yield a vector, or each column of a matrix, as floats.

    A matrix with more columns than rows is transposed first, since it is taken as a
    matrix with one channel per row. A matrix with more than MAX_MATRIX_COLUMNS channels
    is skipped."""
    if value.dtype.kind not in "biuf":
        return
    value = np.squeeze(value)
    if value.ndim == 1 and len(value) >= MIN_VECTOR_LENGTH:
        yield name, value.astype(float)
    elif value.ndim == 2:
        value = value if value.shape[0] >= value.shape[1] else value.T
        if value.shape[1] <= MAX_MATRIX_COLUMNS:
            for i in range(value.shape[1]):
                yield f"{name}.{i + 1}", value[:, i].astype(float)


def _walk_version73(path: Path, opaque: list[str]) -> Iterator[tuple[str, Any]]:
    """Yield paths and values of all vectors and strings in a file of version 7.3."""
    h5py = import_optional("h5py", "mat", str(path))
    try:
        with h5py.File(path, "r") as file:
            yield from _walk_hdf(file, "", opaque, h5py)
    except (UserError, MemoryError):
        raise
    except Exception as error:  # a parser may raise any error
        raise UserError(f"{path}: is damaged or cut off: {str(error)[:120]}; copy it again") from None


def _walk_hdf(group: Any, at: str, opaque: list[str], h5py: Any) -> Iterator[tuple[str, Any]]:
    """Yield paths and values of all vectors and strings in a group of HDF5.

    If a dataset has an attribute `unit` or `units`, also yield the unit, as a string with
    the path NAME.unit, where NAME is the path of the dataset."""
    for key, item in group.items():
        name = f"{at}.{key}" if at else key
        if key.startswith("#"):
            continue
        kind_ = item.attrs.get("MATLAB_class", b"")
        kind_ = kind_.decode() if isinstance(kind_, bytes) else str(kind_)
        if item.attrs.get("MATLAB_object_decode") is not None:
            opaque.append(name)
        elif isinstance(item, h5py.Group):
            yield from _walk_hdf(item, name, opaque, h5py)
        elif kind_ == "char":
            yield name, "".join(chr(c) for c in np.asarray(item).ravel() if c)
        elif item.dtype.kind in "biuf":
            check_rows(Path(item.file.filename), name, int(np.prod(item.shape, dtype=float)))
            yield from _split_dataset(name, item, h5py)
            unit = item.attrs.get("unit", item.attrs.get("units"))
            if unit is not None:
                yield f"{name}.unit", unit.decode() if isinstance(unit, bytes) else str(unit)


def _split_dataset(name: str, item: Any, h5py: Any) -> Iterator[tuple[str, Any]]:
    """Yield the vector in a dataset, or each column of its matrix, read on demand."""
    long = [axis for axis, n in enumerate(item.shape) if n > 1]
    if not 1 <= len(long) <= 2:
        yield from _split_columns(name, np.asarray(item))
        return
    along = max(long, key=lambda axis: item.shape[axis])  # the axis of the rows
    across = next((axis for axis in long if axis != along), None)
    count = 1 if across is None else item.shape[across]
    file, dataset = item.file.filename, item.name
    place = [slice(None) if axis == along else 0 for axis in range(len(item.shape))]

    def read_column(k: int) -> np.ndarray:
        with h5py.File(file, "r") as again:
            selection = tuple(k if axis == across else p for axis, p in enumerate(place))
            return np.asarray(again[dataset][selection], float)

    for k in range(count if count <= MAX_MATRIX_COLUMNS else 0):
        column = f"{name}.{k + 1}" if across is not None else name
        yield column, LazyVector(item.shape[along], functools.partial(read_column, k))
