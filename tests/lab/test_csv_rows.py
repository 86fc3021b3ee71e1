"""Tables written fast: the same bits come back, and in every other respect it is what pandas writes."""

from __future__ import annotations

import io
from decimal import Decimal

import numpy as np
import pandas as pd
import pytest

from tse.impl.estimate import csv_header, csv_rows


def written(table) -> str:
    return (csv_header(table) + csv_rows(table)).decode()


def as_pandas(table: pd.DataFrame) -> str:
    return table.to_csv(index=False, lineterminator="\n")


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_numbers_have_the_shortest_digits_and_every_bit(kind):
    rng = np.random.default_rng(1)
    bits = rng.integers(0, np.iinfo(np.uint64).max, 20000, np.uint64).view(np.float64)
    plain = rng.standard_normal(20000) * 10.0 ** rng.integers(-6, 7, 20000)
    with np.errstate(all="ignore"):
        x = np.concatenate([bits, plain, [0.0, -0.0, 5e-324, 1e16, 1e22, 123456789.0, 0.1 + 0.2]]).astype(kind)
    x = x[np.isfinite(x)]
    cells = csv_rows({"x": x}).decode().split()
    back = np.array([float(c) for c in cells]).astype(kind)
    assert np.array_equal(back.view(np.uint8), x.view(np.uint8))
    assert all(Decimal(c) == Decimal(str(v)) for c, v in zip(cells, x, strict=True))


def test_whole_numbers_of_a_column_of_reals_keep_their_point():
    assert csv_rows({"x": np.array([1.0, -20.0]), "n": np.array([1, -20])}) == b"1.0,1\n-20.0,-20\n"


def test_missing_cells_are_empty():
    reals, words = np.array([1.5, np.nan, 2.5]), pd.Categorical(["a", None, "b"])
    assert csv_rows({"x": reals, "y": reals, "w": words}) == b"1.5,1.5,a\n,,\n2.5,2.5,b\n"


MIXED = pd.DataFrame(
    {
        "time": [0.0, 0.5, 1.0],
        "x": [1.25, -3.0, 0.001],
        "valid": [1, 0, 1],
        "y": np.array([0.5, 2.0, 3.5], np.float32),
        "code": np.array([-3, 0, 7], np.int32),
        "word": ["valid", "not excited", "valid"],
        "again": pd.Categorical(["a b", "c", "a b"]),
    }
)


@pytest.mark.parametrize(
    "change",
    [{}, {"flag": [True, False, True]}, {"word": ['say "x"', "a,b", "two\nlines"]}, {"x": [np.inf, -np.inf, np.nan]},
     {"word": ["", None, "x"]}, {"when": pd.to_datetime(["2024-01-01"] * 3)}, {"mixed": [1, "a", None]},
     {'head,"er': [1, 2, 3]}],
)  # fmt: skip
def test_a_table_is_written_as_pandas_writes_it(change):
    table = MIXED.assign(**change)
    assert written(table) == as_pandas(table)


def test_a_table_without_rows_has_its_header():
    assert written(MIXED.iloc[:0]) == as_pandas(MIXED.iloc[:0])


def test_parts_put_together_are_the_whole():
    parts = b"".join(csv_rows(MIXED.iloc[i : i + 1]) for i in range(3))
    assert parts == csv_rows(MIXED)
    assert pd.read_csv(io.BytesIO(parts), header=None).shape == (3, len(MIXED.columns))
