"""Which logs are on the same road, and where on it each of their rows is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tse.identify.knots import PROFILES, Knots
from tse.library.core import Config
from tse.library.errors import UserError
from tse.log.rows import CheckedLog
from tse.roads.road import Road
from tse.roads.road_match import common, road_of, track_of

LEAST_SHARE = 0.5  # of the rows of a log that are on a road, to be a lap of it


@dataclass(frozen=True)
class Laps:
    """Roads of several logs.

    Attributes
    ----------
    distance : list of (n,) arrays [m], by log
        Along its road, of a circuit in the first round; NaN: not on it.
    of : list of int, by log
        Its road.
    path : list of Road, by road
        Without bank and grade; None: the car has hardly moved.
    """

    distance: list[np.ndarray]
    of: list[int]
    path: list[Road | None]

    def count(self, road: int) -> int:
        """Return how many logs are on a road."""
        return self.of.count(road)

    def knots(self, kinds: Sequence[str] = PROFILES) -> Knots:
        """Return knots over the roads."""
        return Knots.of(self.distance, self.of, kinds)


def laps(logs: Sequence[CheckedLog], config: Config) -> Laps:
    """Find which logs share a road, each compared with the roads of those before it.

    Cost: half a second for a lap of 4 km beside another."""
    groups: list[list[int]] = []
    distance: dict[int, np.ndarray] = {}
    path: list[Road | None] = []
    for i, log in enumerate(logs):
        for k, group in enumerate(groups):
            try:
                found, road = common([*(logs[j] for j in group), log], config)
            except UserError:  # on another road, or nothing shows where on this one
                continue
            if min(float(np.isfinite(d).mean()) for d in found) >= LEAST_SHARE:
                group.append(i)
                distance |= dict(zip(group, found, strict=True))
                path[k] = road
                break
        else:
            groups.append([i])
            track = track_of(log, config)
            distance[i] = track.travelled
            path.append(_path(track))
    of = [next(k for k, group in enumerate(groups) if i in group) for i in range(len(logs))]
    return Laps([distance[i] for i in range(len(logs))], of, path)


def _path(track: object) -> Road | None:
    try:
        road = road_of(track)
    except UserError:
        return None
    return None if road.is_closed else road  # rounds of one log have each their own values


def profile(path: Road, knots: Knots, road: int, z: np.ndarray, sd: np.ndarray) -> Road:
    """Return a road with the values that a fit has found of it. A profile that was not
    fitted is not known."""
    columns: dict[str, np.ndarray] = {}
    for kind in knots.kinds:
        mine = knots.values(road, kind)
        columns |= {kind: z[mine], f"{kind}_sd": sd[mine]}
    return path.with_profile(knots.places(road), **columns)
