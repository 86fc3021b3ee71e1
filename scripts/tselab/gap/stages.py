"""What a run has done, kept in DIR/stages so that it can go on: arrays and plain data in NumPy's archive, which runs no code when
it is read. A file that is damaged, of another version or of other inputs is made again; so is one that somebody else has
made: its content is sealed (tselab/seal.py)."""

from __future__ import annotations

import dataclasses
import hmac
import importlib
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tselab.files import atomic
from tselab.seal import seal

# Modules whose dataclasses may be in a stage; nothing else is ever made from a file.
MODULES = (
    "tselab.core", "tselab.formula", "tselab.gap.catalogue", "tselab.gap.data", "tselab.gap.fit", "tselab.gap.localise.where",
    "tselab.gap.infer.naming", "tselab.gap.infer.show", "tselab.gap.infer.formula.search",
)  # fmt: skip
MOST_BYTES = 4 << 30  # of a stage, unpacked


def stage(folder: Path, key: str, title: str, compute: Callable[[], Any]) -> Any:
    """What was computed before from the same things, or now. `key`: of what it depends on."""
    path = folder / f"{title}.npz"
    found = load(path, key)
    if found is not None:
        return found[0]
    value = compute()
    save(path, key, value)
    return value


def save(path: Path, key: str, value: Any) -> None:
    arrays: list[np.ndarray] = []
    tree = _packed(value, arrays)
    head = np.frombuffer(json.dumps({"key": key, "arrays": len(arrays), "value": tree}).encode(), np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic(path, "wb") as file:
        np.savez(file, head=head, seal=_seal(head, arrays), **{f"a{k}": a for k, a in enumerate(arrays)})


def load(path: Path, key: str) -> tuple[Any] | None:
    """(value,), or None: there is none that can be used."""
    if not path.is_file():
        return None
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(i.file_size for i in archive.infolist()) > MOST_BYTES:
                return None
        with np.load(path, allow_pickle=False) as file:
            raw = file["head"]
            head = json.loads(raw.tobytes().decode())
            if head["key"] != key:
                return None
            arrays = [file[f"a{k}"] for k in range(int(head["arrays"]))]
            if not hmac.compare_digest(file["seal"].tobytes(), _seal(raw, arrays).tobytes()):
                return None
            return (_unpacked(head["value"], arrays.__getitem__),)
    except Exception:  # whatever is wrong with a file that anybody may have made: it is made again
        return None


def _seal(head: np.ndarray, arrays: list[np.ndarray]) -> np.ndarray:
    """Of all that a stage holds."""
    whole = [head, *arrays]
    return np.frombuffer(
        seal(part for a in whole for part in (f"{a.dtype.str} {a.shape} ".encode(), a.tobytes())), np.uint8
    )


def _packed(value: Any, arrays: list[np.ndarray]) -> Any:
    if isinstance(value, np.ndarray):
        if value.dtype == object:
            raise TypeError("an array of objects is no stage")
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if isinstance(value, np.generic):
        return value.item()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: _packed(getattr(value, f.name), arrays) for f in dataclasses.fields(value) if f.init}
        return {"class": [type(value).__module__, type(value).__name__], "fields": fields}
    if isinstance(value, Path):
        return {"path": str(value)}
    if isinstance(value, dict):
        return {"items": [[_packed(k, arrays), _packed(v, arrays)] for k, v in value.items()]}
    if isinstance(value, tuple):
        return {"tuple": [_packed(v, arrays) for v in value]}
    if isinstance(value, list):
        return [_packed(v, arrays) for v in value]
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"{type(value).__name__} is no part of a stage")


def _unpacked(tree: Any, array: Callable[[int], np.ndarray]) -> Any:
    if isinstance(tree, list):
        return [_unpacked(v, array) for v in tree]
    if not isinstance(tree, dict):
        return tree
    if "array" in tree:
        return array(int(tree["array"]))
    if "path" in tree:
        return Path(tree["path"])
    if "tuple" in tree:
        return tuple(_unpacked(v, array) for v in tree["tuple"])
    if "items" in tree:
        return {_unpacked(k, array): _unpacked(v, array) for k, v in tree["items"]}
    module, name = tree["class"]
    if module not in MODULES:
        raise ValueError(f"{module} has no stages")
    made = getattr(importlib.import_module(module), name)
    if not dataclasses.is_dataclass(made) or made.__module__ != module:
        raise ValueError(f"{name} is no dataclass")
    return made(**{k: _unpacked(v, array) for k, v in tree["fields"].items()})
