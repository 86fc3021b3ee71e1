"""Keep the logs that tests make, so that another run of the tests need not make them."""

import hashlib
import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np

from .logs import CarLog, make_logs

HERE = Path(__file__).parent
FOLDER = HERE.parents[1] / "build" / "cache" / "cars"
SOURCES = ("cars", "driver", "logs", "model", "road", "sensors")


def compute_key(*arguments: Any, **named: Any) -> str:
    """Return a hash of everything that logs depend on: arguments, sources and NumPy."""
    key = hashlib.sha256(pickle.dumps((arguments, sorted(named.items()), np.__version__)))
    for name in SOURCES:
        key.update((HERE / f"{name}.py").read_bytes())
    return key.hexdigest()


def make_logs_once(*arguments: Any, **named: Any) -> list[CarLog]:
    """Return make_logs() of these arguments, from build/cache if it was made before.

    A file that cannot be read is made anew."""
    path = FOLDER / f"{compute_key(*arguments, **named)}.pickle"
    try:
        return pickle.loads(path.read_bytes())
    except (OSError, EOFError, pickle.UnpicklingError, AttributeError):
        made = make_logs(*arguments, **named)
    FOLDER.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}.part")
    part.write_bytes(pickle.dumps(made))
    part.replace(path)
    return made
