"""A constant of tse that is another for a while: for studies and tests.

with changed("gap.infer.space.EPISODE", 60.0):
    run(...)
"""

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def changed(name: str, value: Any) -> Iterator[None]:
    """Set one constant in its module and in every module that imports it, in this process and in those forked from within."""
    module, _, key = name.rpartition(".")
    before = getattr(importlib.import_module(f"tse.impl.{module}"), key)
    mine = [m for n, m in sys.modules.items() if n.startswith("tse.") and vars(m).get(key) is before]
    for m in mine:
        setattr(m, key, value)
    try:
        yield
    finally:
        for m in mine:
            setattr(m, key, before)
