"""Describe bank and grade under the logs by values at knots along each road.

A profile is linear between its knots. Bank and grade push the car and leave the sensors
alone: v_x' = a_x - g grade, v_y' = a_y - v_x yaw_rate - g bank. A value acts on few rows,
so one simulation gives the slopes of every KNOT_SPACING-th value, and the fit eliminates
the values by a sparse factorisation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix

KNOT_DISTANCE = 40.0  # m, between knots: a road changes its lean within 30 .. 60 m
KNOT_SD = 0.03  # rad, prior sd of a value of bank or grade, about a level road
PROFILES = ("bank", "grade")
KNOT_SPACING = 5  # knots between two that one simulation moves
KNOT_LEAD = 1.0  # knots: a value acts from the knot before on, by linear interpolation
KNOT_STEP = 0.01  # rad, of the finite differences: gravity acts by the sine, nearly linear


@dataclass(frozen=True)
class Knots:
    """Knots of the roads of several logs.

    Attributes
    ----------
    distance : list of arrays [m], by log
        Place of the car on its road, one value a row. Logs with the same `road` share the
        origin.
    road : list of int, by log
        Index of its road.
    first, count : list, by road
        Place [m] of the first knot, and number of knots of one profile.
    kinds : tuple of str
        Unknown profiles, of PROFILES.
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
        """Lay knots over the distances.

        Parameters
        ----------
        distance, kinds
            As in Knots.
        road
            Index of the road by log; None: each log has its own road.
        """
        of_log = list(range(len(distance))) if road is None else list(road)
        first, count = [], []
        for k in range(max(of_log, default=-1) + 1):
            mine = np.concatenate([d for d, r in zip(distance, of_log, strict=True) if r == k])
            first.append(float(np.nanmin(mine)))
            count.append(int((np.nanmax(mine) - first[-1]) // KNOT_DISTANCE) + 2)
        return cls(list(distance), of_log, first, count, tuple(kinds))

    def __len__(self) -> int:
        """Return the number of values: bank, then grade of each road."""
        return len(self.kinds) * sum(self.count)

    def get_slice(self, road: int, profile: str) -> slice:
        """Return the slice of z that holds a profile of a road."""
        begin = len(self.kinds) * sum(self.count[:road]) + self.kinds.index(profile) * self.count[road]
        return slice(begin, begin + self.count[road])

    def compute_places(self, road: int) -> np.ndarray:
        """Return the distance of each knot, m."""
        return self.first[road] + KNOT_DISTANCE * np.arange(self.count[road])

    def compute_profiles(self, log: int, z: np.ndarray) -> dict[str, np.ndarray]:
        """Return bank and grade of each row of a log, rad; 0 off the common road."""
        road = self.road[log]
        places = self.compute_places(road)
        found = {p: np.interp(self.distance[log], places, z[self.get_slice(road, p)]) for p in self.kinds}
        return {p: np.nan_to_num(x) for p, x in found.items()}

    def list_moves(self) -> list[np.ndarray]:
        """Return vectors of steps of z, each of knots with no row in common."""
        found = []
        for profile in self.kinds:
            for colour in range(KNOT_SPACING):
                step = np.zeros(len(self))
                for road in range(len(self.count)):
                    step[self.get_slice(road, profile)][colour::KNOT_SPACING] = KNOT_STEP
                found.append(step)
        return found

    def find_acting(self, log: int, distance: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return the index of the value of `step` that acts at each distance; -1: none.

        It is the moved knot that the car passed last, or reaches within one knot.
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
    """Build the sparse matrix of slopes by z from lists of rows, columns and values."""
    return coo_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape
    ).tocsc()
