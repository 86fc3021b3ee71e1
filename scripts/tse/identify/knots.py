"""Describe bank and grade of roads by values at knots, with linear interpolation.

Bank and grade accelerate the car by gravity, which accelerometers do not measure. With
the measured accelerations a_x and a_y, and the acceleration of gravity g,
    dv_x/dt = a_x - g grade,    dv_y/dt = a_y - v_x yaw_rate - g bank.
The value at a knot acts only on the rows near this knot. So one simulation gives the
partial derivatives with respect to the values at every KNOT_SPACING-th knot, and the fit
eliminates all values by a sparse factorisation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix

KNOT_DISTANCE = 40.0  # [m] between knots; the bank of a road changes within 30 .. 60 m
KNOT_SD = 0.03  # [rad] prior sd of a value of bank or grade; the prior mean is 0
PROFILES = ("bank", "grade")
# For finite differences, one simulation changes the values at every 5th knot (every
# 200 m). This is so far apart that at most one changed value influences a residual
KNOT_SPACING = 5
# [knots] The value at a knot begins to act at this distance before the knot: bank and
# grade are interpolated linearly, so the value has an influence from the previous knot on
KNOT_LEAD = 1.0
KNOT_STEP = 0.01  # [rad] step of the finite differences; the effect of gravity is nearly linear


@dataclass(frozen=True)
class Knots:
    """Knots of the roads of several logs.

    Attributes
    ----------
    distance : list of arrays [m], one for each log
        Place of the car along its road, one value per row; NaN: off the road. Logs with
        the same `road` share the origin.
    road : list of int, one for each log
        Index of the road.
    first, count : lists, one entry for each road
        Place [m] of the first knot, and number of knots of one profile.
    kinds : tuple of str
        Profiles that are fitted: "bank", "grade" or both.
    """

    distance: list[np.ndarray]
    road: list[int]
    first: list[float]
    count: list[int]
    kinds: tuple[str, ...] = PROFILES

    @classmethod
    def lay(
        cls,
        distance: Sequence[np.ndarray],
        road: Sequence[int] | None = None,
        kinds: Sequence[str] = PROFILES,
    ) -> Knots:
        """Place equidistant knots along each road, over all distances of its logs.

        Parameters
        ----------
        distance, kinds
            As in Knots.
        road
            Index of the road of each log; None: each log has its own road.
        """
        of_log = list(range(len(distance))) if road is None else list(road)
        first, count = [], []
        for k in range(max(of_log, default=-1) + 1):
            mine = np.concatenate([d for d, r in zip(distance, of_log, strict=True) if r == k])
            first.append(float(np.nanmin(mine)))
            count.append(int((np.nanmax(mine) - first[-1]) // KNOT_DISTANCE) + 2)
        return cls(list(distance), of_log, first, count, tuple(kinds))

    def __len__(self) -> int:
        """Return the length of the vector z.

        z has the values at the knots: bank of the first road, then its grade, then bank
        and grade of the second road, and so on.
        """
        return len(self.kinds) * sum(self.count)

    def get_slice(self, road: int, profile: str) -> slice:
        """Return the slice of z that holds a profile of a road."""
        begin = len(self.kinds) * sum(self.count[:road]) + self.kinds.index(profile) * self.count[road]
        return slice(begin, begin + self.count[road])

    def compute_places(self, road: int) -> np.ndarray:
        """Return the place [m] of each knot along a road."""
        return self.first[road] + KNOT_DISTANCE * np.arange(self.count[road])

    def compute_profiles(self, log: int, z: np.ndarray) -> dict[str, np.ndarray]:
        """Return bank and grade [rad] of each row of a log; 0 for rows off the road."""
        road = self.road[log]
        places = self.compute_places(road)
        found = {p: np.interp(self.distance[log], places, z[self.get_slice(road, p)]) for p in self.kinds}
        return {p: np.nan_to_num(x) for p, x in found.items()}

    def list_moves(self) -> list[np.ndarray]:
        """Return the vectors that are added to z for the finite differences.

        Each vector changes the values of one profile (bank or grade) at every
        KNOT_SPACING-th knot. These knots are so far apart that at most one changed value
        influences a row. So one simulation gives the derivatives for all of them.
        """
        found = []
        for profile in self.kinds:
            for colour in range(KNOT_SPACING):
                step = np.zeros(len(self))
                for road in range(len(self.count)):
                    step[self.get_slice(road, profile)][colour::KNOT_SPACING] = KNOT_STEP
                found.append(step)
        return found

    def find_acting(self, log: int, distance: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return for each distance which changed value of z influences a residual there.

        `distance` [m] is along the road of the log. `step`, a vector of list_moves(), is
        non-zero at the changed values. The result is the index in z of the last changed
        knot that is at most KNOT_LEAD ahead; -1 if there is no such knot.
        """
        road = self.road[log]
        profile = next((p for p in self.kinds if step[self.get_slice(road, p)].any()), None)
        if profile is None:
            return np.full(len(distance), -1)
        mine = self.get_slice(road, profile)
        moved = np.flatnonzero(step[mine])
        at = (
            np.searchsorted(moved, (distance - self.first[road]) / KNOT_DISTANCE + KNOT_LEAD, side="right")
            - 1
        )
        return np.where((at >= 0) & np.isfinite(distance), mine.start + moved[np.maximum(at, 0)], -1)


def build_sparse(
    rows: list[np.ndarray], columns: list[np.ndarray], values: list[np.ndarray], shape: tuple[int, int]
) -> csc_matrix:
    """Build a sparse matrix from lists of row indices, column indices and values."""
    return coo_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape
    ).tocsc()
