"""Values that are held: of a signal that is slower than the rows of its log, which rows have a new one."""

from __future__ import annotations

import numpy as np


def fresh(x: np.ndarray) -> np.ndarray:
    """Rows with a new value, where a slow signal is held in a fast log: held values are old ones, and half a hold late on average.
    All rows, unless new values come every k-th row: a quantised signal repeats itself, too, but at no beat."""
    changed = np.flatnonzero(np.append(True, (np.diff(x) != 0) & np.isfinite(x[1:]))).astype(
        np.int32
    )  # half the memory
    gaps = np.diff(changed[1:])
    if len(gaps) < 50:
        return np.ones(len(x), bool)
    beat = int(np.median(gaps[gaps <= np.quantile(gaps, 0.5)]))
    if beat < 2 or np.mean(gaps % beat == 0) < 0.9:
        return np.ones(len(x), bool)
    found = np.zeros(len(x), bool)
    found[changed] = True
    for gap, start in zip(gaps[gaps > beat], changed[1:-1][gaps > beat], strict=True):  # the same again is new, too
        found[start : start + gap : beat] = True
    found[changed[-1] :: beat] = True
    found[changed[1] :: -beat] = True  # and before it changed for the first time
    return found
