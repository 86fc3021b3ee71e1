"""A formula of the user, an effect that the catalogue does not have."""

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
        A file as gap() writes it, or written by hand: `tselab formula --help` shows one.

    Returns
    -------
    Formula
        place, text, gain, numbers; settings() has the settings that run it.

    Raises
    ------
    FileNotFoundError
        The file is not there.
    Error
        A place, signal or function that is not known, a unit that does not fit, a number
        outside its range; a ValueError.
    """
    return _read(Path(path))


def write_c_formula(formula: Formula, path: str | os.PathLike[str]) -> Path:
    """Write a formula as a C header, for a build with -DTSE_FORMULA=path.

    Parameters
    ----------
    formula
        What read_formula() returned.
    path
        The header; one that is there is replaced.

    Returns
    -------
    Path
        The header.
    """
    with write_atomically(Path(path)) as file:
        file.write(format_c_header(formula))
    return Path(path)
