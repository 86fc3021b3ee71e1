"""Properties that the class Estimate has in addition to its fields."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt

from tse.library.core import STATUS, STIFFNESS, library

Array = npt.NDArray[np.float64]


class EstimateBase:
    """Base class of Estimate: stiffnesses as arrays, and the status as a sentence."""

    __slots__ = ()

    @property
    def stiffness(self) -> Array:
        """(3,) mean stiffnesses: cx_front [N], cy_front and cy_rear [N/rad]."""
        return np.array([getattr(self, s) for s in STIFFNESS])

    @property
    def stiffness_sd(self) -> Array:
        """(3,) standard deviations of `stiffness`, in the same units."""
        return np.array([getattr(self, f"{s}_sd") for s in STIFFNESS])

    @property
    def valid(self) -> npt.NDArray[np.bool_]:
        """(3,) whether each stiffness may be used."""
        return np.array([getattr(self, f"{s}_valid") for s in STIFFNESS])

    @property
    def status_text(self) -> str:
        """Meaning of `status`, as a sentence."""
        return str(library().codes(STATUS)[self.as_dict()["status"]].text)

    def as_dict(self) -> dict[str, Any]:
        """Return all fields by name."""
        return {f.name: getattr(self, f.name) for f in fields(self)}  # type: ignore[arg-type]
