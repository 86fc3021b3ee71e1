"""Parquet and Feather by pyarrow."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tse.impl.errors import UserError
from tse.impl.logs.recording import PIECE, How, Later, Recording, check_rows, need
from tse.impl.logs.table import Column, recording_of


def read(path: Path, how: How) -> Recording:
    """All columns that are numbers or times; a struct's fields by their path."""
    pa = need("pyarrow", "all", str(path))
    with open(path, "rb") as file:
        parquet = file.read(4) == b"PAR1"
    try:
        schema, rows, batches = (_parquet if parquet else _feather)(path)
        check_rows(path, "the table", rows)
        if not rows:
            raise UserError(f"{path}: has columns but no rows")
        columns = [_column(pa, field, steps, rows, batches) for field, steps in _leaves(pa, schema)]
        found = recording_of(path, "Parquet" if parquet else "Feather", columns, how)
        pa.default_memory_pool().release_unused()
    except UserError:
        raise
    except (pa.ArrowException, OSError, ValueError) as error:
        raise UserError(f"{path}: is damaged or cut off: {str(error).splitlines()[0][:150]}") from None
    if found.channels and not np.isfinite(next(iter(found)).time).any():
        raise UserError(f"{path}: the time is empty")
    return found


Batches = Callable[[int], Iterator[Any]]  # a column of the file by its place -> what pyarrow reads of it at a time, tables of it


def _parquet(path: Path) -> tuple[Any, int, Batches]:
    """Schema, rows, and who reads a column."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    with pq.ParquetFile(path) as file:
        schema, rows = file.schema_arrow, file.metadata.num_rows
    alone = len(set(schema.names)) == len(schema.names) and not any("." in n for n in schema.names)  # a name says which

    def batches(place: int) -> Iterator[Any]:
        with pq.ParquetFile(path) as file:
            if alone:
                for batch in file.iter_batches(PIECE, columns=[schema.names[place]], use_threads=False):
                    yield pa.Table.from_batches([batch])
            else:
                for batch in file.iter_batches(PIECE, use_threads=False):
                    yield pa.Table.from_batches([batch]).select([place])

    return schema, rows, batches


def _feather(path: Path) -> tuple[Any, int, Batches]:
    import pyarrow as pa
    import pyarrow.feather as feather

    with open(path, "rb") as file:
        first = file.read(4) == b"FEA1"
    if first:  # the format of 2016, which has no batches
        table = feather.read_table(path)
        return table.schema, table.num_rows, lambda place: iter([table.select([place])])
    with pa.OSFile(str(path)) as source, pa.ipc.open_file(source) as file:
        schema = file.schema
        rows = sum(file.get_batch(i).num_rows for i in range(file.num_record_batches))

    def batches(place: int) -> Iterator[Any]:
        options = pa.ipc.IpcReadOptions(included_fields=[place], use_threads=False)
        with pa.OSFile(str(path)) as source, pa.ipc.open_file(source, options=options) as file:
            for i in range(file.num_record_batches):
                yield pa.Table.from_batches([file.get_batch(i)])

    return schema, rows, batches


def _leaves(pa: Any, schema: Any) -> Iterator[tuple[Any, tuple[int, ...]]]:
    """Fields that are no structs, with their path in names, and as places."""

    def walk(field: Any, at: tuple[int, ...]) -> Iterator[tuple[Any, tuple[int, ...]]]:
        if not pa.types.is_struct(field.type):
            yield field, at
            return
        for i in range(field.type.num_fields):
            part = field.type.field(i)
            yield from walk(part.with_name(f"{field.name}.{part.name}"), (*at, i))

    for place, field in enumerate(schema):
        yield from walk(field, (place,))


def _column(pa: Any, field: Any, steps: tuple[int, ...], rows: int, batches: Batches) -> Column:
    meta = {k.decode(errors="replace").lower(): v.decode(errors="replace") for k, v in (field.metadata or {}).items()}
    kind = pa.types
    dates = kind.is_timestamp(field.type) or kind.is_duration(field.type)

    def parts() -> Iterator[Any]:
        for table in batches(steps[0]):
            for place in steps[1:]:
                table = table.flatten().select([place])
            yield table.column(0)

    def whole() -> pd.Series:
        column = pa.chunked_array([c for part in parts() for c in part.chunks])
        if kind.is_dictionary(field.type):
            column = column.unify_dictionaries().combine_chunks()
            column = column.dictionary_decode() if hasattr(column, "dictionary_decode") else column
        return column.to_pandas()

    plain = kind.is_integer(field.type) or kind.is_floating(field.type)
    values = Later(rows, lambda: (part.to_pandas().to_numpy(float) for part in parts())) if plain else whole
    return Column(field.name, values, meta.get("unit", meta.get("units", "")), meta.get("description", ""), rows, dates)
