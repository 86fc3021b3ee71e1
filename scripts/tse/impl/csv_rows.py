"""Rows of a table as CSV, fast: every number in the shortest digits that give the same bits back. A long log is ten million
cells, for which pandas takes twenty seconds; orjson writes arrays of numbers, so a CSV is put together from its rows."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from typing import Any

import numpy as np
import orjson
import pandas as pd

Columns = Mapping[str, Any] | pd.DataFrame  # the columns: arrays, Categoricals or Series
NUMBERS = ("f8", "f4", "i8", "i4", "i2", "i1", "u8", "u4", "u2", "u1")
QUOTED = set(',"\r\n')  # text with one of these needs more care than there is here


def csv_header(table: Columns) -> bytes:
    """The line of the column names."""
    return pd.DataFrame(columns=list(table)).to_csv(index=False, lineterminator="\n").encode()


def csv_rows(table: Columns) -> bytes:
    """The lines of the rows. Missing values are empty cells."""
    columns = [getattr(column, "array", column) for _, column in table.items()]
    if not columns or not len(columns[0]):
        return b""
    parts: list[list[bytes]] = []
    for number, run in groupby(columns, key=_number):
        for cells in [_numbers(list(run))] if number else map(_words, run):
            if cells is None:  # a column that only pandas can write
                return pd.DataFrame(dict(table)).to_csv(index=False, header=False, lineterminator="\n").encode()
            parts.append(cells)
    return b"\n".join(map(b",".join, zip(*parts, strict=True))) + b"\n"


def _number(column: Any) -> str:
    """The type of numbers that _numbers() writes; of another column nothing."""
    kind = getattr(column.dtype, "numpy_dtype", column.dtype)
    return kind.str if isinstance(kind, np.dtype) and kind.str[1:] in NUMBERS else ""


def _numbers(columns: list[Any]) -> list[bytes] | None:
    """The cells of neighbours of one type, joined, a row each; None if this needs pandas."""
    first = np.asarray(columns[0])
    values = np.empty((len(first), len(columns)), first.dtype)
    for i, column in enumerate(columns):
        values[:, i] = column
    text = orjson.dumps(values, option=orjson.OPT_SERIALIZE_NUMPY)
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        if np.isinf(values).any():
            return None
        text = text.replace(b"null", b"")
    return text[2:-2].split(b"],[")


def _words(column: Any) -> list[bytes] | None:
    """The cells of a column of text, a row each; None if this needs pandas."""
    if isinstance(column, pd.Categorical):
        codes, words = column.codes, column.categories
    elif isinstance(column.dtype, pd.StringDtype):
        codes, words = pd.factorize(column)
    else:
        return None
    if not all(isinstance(w, str) and w and QUOTED.isdisjoint(w) for w in words):
        return None
    return np.array([*(w.encode() for w in words), b""], object)[codes].tolist()  # code -1: missing
