"""Parquet and Feather by pyarrow."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tselab.errors import UserError
from tselab.logs.extras import need
from tselab.logs.recording import How, Recording
from tselab.logs.table import Column, recording_of


def read(path: Path, how: How) -> Recording:
    """All columns that are numbers or times; a struct's fields by their path."""
    pa = need("pyarrow", "all", str(path))
    try:
        with open(path, "rb") as file:
            parquet = file.read(4) == b"PAR1"
        if parquet:
            import pyarrow.parquet as pq

            table = pq.read_table(path)
        else:
            import pyarrow.feather as feather

            table = feather.read_table(path)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise UserError(f"{path}: is damaged or cut off: {str(error).splitlines()[0][:150]}") from None
    while any(pa.types.is_struct(f.type) for f in table.schema):
        table = table.flatten()
    if not table.num_rows:
        raise UserError(f"{path}: has columns but no rows")
    columns = []
    for place, f in enumerate(table.schema):
        meta = {k.decode(errors="replace").lower(): v.decode(errors="replace") for k, v in (f.metadata or {}).items()}
        column = table.column(place)
        if pa.types.is_dictionary(f.type):
            column = column.combine_chunks().dictionary_decode() if hasattr(column, "combine_chunks") else column
        values = column.to_pandas()
        columns.append(Column(f.name, values, meta.get("unit", meta.get("units", "")), meta.get("description", "")))
    found = recording_of(path, "Parquet" if parquet else "Feather", columns, how)
    if not np.isfinite(next(iter(found)).time).any():
        raise UserError(f"{path}: the time is empty")
    return found
