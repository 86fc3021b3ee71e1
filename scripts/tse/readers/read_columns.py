"""Read Parquet and Feather files by pyarrow, one column at a time."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tse.library.errors import UserError
from tse.readers.recording import ReadOptions, Recording, check_rows, import_optional
from tse.readers.table import Column, make_recording


def read(path: Path, how: ReadOptions) -> Recording:
    """Read all columns of numbers or times. Each field of a struct is a column."""
    pa = import_optional("pyarrow", "all", str(path))
    with open(path, "rb") as file:
        parquet = file.read(4) == b"PAR1"
    try:
        schema, rows, read_column = (_open_parquet if parquet else _open_feather)(path)
        check_rows(path, "the table", rows)
        if not rows:
            raise UserError(f"{path}: has columns but no rows")
        columns = [
            _make_column(pa, field, steps, rows, read_column) for field, steps in _flatten_fields(pa, schema)
        ]
        found = make_recording(path, "Parquet" if parquet else "Feather", columns, how)
        pa.default_memory_pool().release_unused()
    except (UserError, MemoryError):
        raise
    except (pa.ArrowException, OSError, ValueError) as error:
        raise UserError(
            f"{path}: is damaged or cut off: {str(error).splitlines()[0][:150]}; copy it again"
        ) from None
    if found.channels and not np.isfinite(next(iter(found)).time).any():
        raise UserError(f"{path}: the time column is empty")
    return found


# function: index of a column in the file -> its values, a pyarrow.ChunkedArray
ReadColumn = Callable[[int], Any]


def _open_parquet(path: Path) -> tuple[Any, int, ReadColumn]:
    """Return schema, number of rows and a function that reads a column."""
    import pyarrow.parquet as pq

    with pq.ParquetFile(path) as file:
        schema, rows = file.schema_arrow, file.metadata.num_rows
    names = schema.names
    are_unique = len(set(names)) == len(names) and not any("." in n for n in names)

    def read_column(place: int) -> Any:
        with pq.ParquetFile(path) as file:
            if are_unique:
                return file.read([schema.names[place]], use_threads=False).column(0)
            return file.read(use_threads=False).column(place)

    return schema, rows, read_column


def _open_feather(path: Path) -> tuple[Any, int, ReadColumn]:
    """Return schema, number of rows and a function that reads a column."""
    import pyarrow as pa
    import pyarrow.feather as feather

    with open(path, "rb") as file:
        first = file.read(4) == b"FEA1"
    if first:  # version 1 of the format
        table = feather.read_table(path)
        return table.schema, table.num_rows, table.column
    with pa.OSFile(str(path)) as source, pa.ipc.open_file(source) as file:
        schema = file.schema
        rows = sum(file.get_batch(i).num_rows for i in range(file.num_record_batches))

    def read_column(place: int) -> Any:
        options = pa.ipc.IpcReadOptions(included_fields=[place], use_threads=False)
        with pa.OSFile(str(path)) as source, pa.ipc.open_file(source, options=options) as file:
            return file.read_all().column(0)

    return schema, rows, read_column


def _flatten_fields(pa: Any, schema: Any) -> Iterator[tuple[Any, tuple[int, ...]]]:
    """Yield each field that is no struct, with the indices that lead to it.

    The first index selects a column of the file. Each further index selects a field of a
    struct. The name of the yielded field is its path: car.speed for the field speed of
    the struct car."""

    def walk(field: Any, at: tuple[int, ...]) -> Iterator[tuple[Any, tuple[int, ...]]]:
        if not pa.types.is_struct(field.type):
            yield field, at
            return
        for i in range(field.type.num_fields):
            part = field.type.field(i)
            yield from walk(part.with_name(f"{field.name}.{part.name}"), (*at, i))

    for place, field in enumerate(schema):
        yield from walk(field, (place,))


def _make_column(pa: Any, field: Any, steps: tuple[int, ...], rows: int, read: ReadColumn) -> Column:
    """Return a column whose values are read from the file each time they are needed.

    `field` and `steps` are a field and its indices, as _flatten_fields() yields them.
    `rows` is the number of rows of the table. `read` is called with steps[0], the index
    of the column in the file."""
    meta = {
        k.decode(errors="replace").lower(): v.decode(errors="replace")
        for k, v in (field.metadata or {}).items()
    }
    kind = pa.types

    def read_values() -> pd.Series:
        column = read(steps[0])
        for place in steps[1:]:
            column = pa.table([column], ["struct"]).flatten().column(place)
        return (column.cast(field.type.value_type) if kind.is_dictionary(field.type) else column).to_pandas()

    dates = kind.is_timestamp(field.type) or kind.is_duration(field.type)
    unit, text = meta.get("unit", meta.get("units", "")), meta.get("description", "")
    return Column(field.name, read_values, unit, text, rows, dates)
