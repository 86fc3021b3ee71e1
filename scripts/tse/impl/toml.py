"""Reading TOML with errors that name the file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from tse.impl.errors import NoFile, UserError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

loads = tomllib.loads

MOST_INTEGER = 1 << 63  # what TOML asks of a reader; Python's integers go on, and are no settings then


def read_toml(path: Path) -> dict[str, Any]:
    try:
        data = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise NoFile(f"{path}: no such file") from None
    except IsADirectoryError:
        raise UserError(f"{path}: is a directory, a TOML file is needed") from None
    except UnicodeDecodeError:
        raise UserError(f"{path}: is not a text file in UTF-8; a TOML file is needed") from None
    except ValueError as error:  # TOMLDecodeError is one; so are Python's limits on digits and dates
        raise UserError(f"{path}: is not valid TOML: {error}") from None
    except RecursionError:
        raise UserError(f"{path}: is not valid TOML: nested too deeply") from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    _check_integers(path, data, "")
    return data


def _check_integers(path: Path, value: Any, key: str) -> None:
    if isinstance(value, int) and not -MOST_INTEGER <= value < MOST_INTEGER:
        raise UserError(f"{path}: is not valid TOML: key {key}: an integer has at most 64 bits")
    for name, part in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        _check_integers(path, part, f"{key}.{name}" if key else str(name))
