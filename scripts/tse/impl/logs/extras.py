"""Libraries that are optional: what is not installed is named with the command that installs it."""

from __future__ import annotations

import importlib
from types import ModuleType

from tse.impl.errors import UserError


def need(module: str, extra: str, what: str) -> ModuleType:
    """The module, or a sentence how to get it. `extra`: of pyproject.toml; `what`: that cannot be read without."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        why = (
            "is not installed"
            if isinstance(error, ModuleNotFoundError) and error.name == package
            else f"cannot be loaded ({error})"
        )
        raise UserError(
            f"{what}: the Python package {package} is needed and {why}: pip install 'tse[{extra}]'"
            f" (in a checkout: scripts/setup.sh logs)"
        ) from None
