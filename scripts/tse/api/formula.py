"""Read and write formulas. A formula is an effect that a user adds to the model because
the catalogue of effects does not contain it."""

from __future__ import annotations

import os
from pathlib import Path

from tse.car.formula import Formula, format_c_header
from tse.car.formula import read_formula as _read
from tse.library.files import write_atomically


def read_formula(path: str | os.PathLike[str]) -> Formula:
    """Read and check a formula.

    Parameters
    ----------
    path
        A file that gap() or the user has written. `tselab formula --help` shows an
        example.

    Returns
    -------
    Formula
        The formula. Its members are place (the quantity of the model to which the formula
        is added), text (the expression), gain (factor of the expression) and numbers (the
        named numbers in the expression). Its method settings() returns the settings that
        make the filter use the formula.

    Raises
    ------
    FileNotFoundError
        The file does not exist.
    Error
        A place, signal or function is unknown, units do not match, or a number is outside
        its range. The error is also a ValueError.
    """
    return _read(Path(path))


def write_c_formula(formula: Formula, path: str | os.PathLike[str]) -> Path:
    """Write a formula as a C header, for a build with -DTSE_FORMULA=path.

    Parameters
    ----------
    formula
        Result of read_formula().
    path
        File for the header. An existing file is replaced.

    Returns
    -------
    Path
        `path`.
    """
    with write_atomically(Path(path)) as file:
        file.write(format_c_header(formula))
    return Path(path)
