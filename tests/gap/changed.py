"""A constant of tselab.gap that is another for a while: for studies and tests.

with changed("space.EPISODE", 60.0):
    run(...)
"""

from __future__ import annotations

import ast
import functools
import importlib
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tselab.gap.constants import PACKAGE, TABLE, Constant

BY_NAME = {c.name: c for c in TABLE}


def find(name: str) -> Constant:
    """By its name, or by the end of it where no other one ends so. KeyError: there is none, or several."""
    if name in BY_NAME:
        return BY_NAME[name]
    found = [c for n, c in BY_NAME.items() if n.endswith("." + name)]
    if len(found) != 1:
        raise KeyError(
            f"{name!r} is {'several constants: ' + ', '.join(c.name for c in found) if found else 'no constant'}"
        )
    return found[0]


@contextmanager
def changed(name: str, value: Any) -> Iterator[None]:
    """One constant is another within this, in this process and all its threads, for everything in tselab that reads it; also for
    processes that are forked from within. What an earlier run has kept does not know of it. Names: find(). ValueError: it cannot be
    changed, or not to that."""
    constant = find(name)
    if constant.fixed:
        raise ValueError(f"{constant.name} is read when modules are loaded and cannot be changed for a run")
    if not _fits(value, constant.value):
        raise ValueError(f"{constant.name} is {constant.value!r}: {value!r} is nothing of that kind")
    for c in TABLE:
        importlib.import_module(c.module)
    before = getattr(sys.modules[constant.module], constant.key)
    _bind(constant, value)
    try:
        yield
    finally:
        _bind(constant, before)


def _fits(value: Any, like: Any) -> bool:
    """A number, or as many of them, or for the same names; a count stays a whole number."""
    if isinstance(like, Mapping):
        return (
            isinstance(value, Mapping) and value.keys() == like.keys() and all(_fits(value[k], like[k]) for k in like)
        )
    if isinstance(like, Sequence):
        return isinstance(value, Sequence) and len(value) == len(like) and all(map(_fits, value, like))
    return isinstance(value, int if isinstance(like, int) else (int, float)) and not isinstance(value, bool)


def _bind(constant: Constant, value: Any) -> None:
    """Its value now, in its module and in every one of tselab that imports it from there."""
    setattr(sys.modules[constant.module], constant.key, value)
    loaded = [m for n, m in sys.modules.items() if n.startswith(PACKAGE + ".") and getattr(m, "__file__", None)]
    for module in loaded:
        for name in imports(module.__file__).get((constant.module, constant.key), ()):
            setattr(module, name, value)


@functools.cache
def imports(path: str) -> dict[tuple[str, str], list[str]]:
    """(module, name there) of what a file imports at its top level, and the names it has here. Two modules may have the same number
    under the same name, so what a name is does not follow from its value."""
    found: dict[tuple[str, str], list[str]] = {}
    if path.endswith(".py"):
        for node in ast.parse(Path(path).read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom) and node.module:
                for a in node.names:
                    found.setdefault((node.module, a.name), []).append(a.asname or a.name)
    return found
