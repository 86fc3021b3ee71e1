"""Find the logs that were driven on the same road, and locate their rows along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tse.identify.knots import PROFILES, Knots
from tse.library.core import Config
from tse.library.errors import UserError
from tse.log.rows import CheckedLog
from tse.roads.road import Road
from tse.roads.road_match import derive_road, derive_track, match_common

MIN_LAP_SHARE = 0.5  # a log belongs to a road if at least this share of its rows lies on the road


@dataclass(frozen=True)
class Laps:
    """Roads of several logs.

    Attributes
    ----------
    distance : list of (n,) arrays [m], one for each log
        Place of each row along the road; NaN: off the road. If several logs share a
        circuit, a point of it has the same value in all rounds.
    of : list of int, one for each log
        Index of the road.
    path : list of Road or None, one for each road
        Path without bank and grade. None: the car hardly moved, or the road is a circuit
        of which there is only a single log.
    """

    distance: list[np.ndarray]
    of: list[int]
    path: list[Road | None]

    def count(self, road: int) -> int:
        """Return the number of logs on a road."""
        return self.of.count(road)

    def lay_knots(self, kinds: Sequence[str] = PROFILES) -> Knots:
        """Place knots along the roads."""
        return Knots.lay(self.distance, self.of, kinds)


def find_laps(logs: Sequence[CheckedLog], config: Config) -> Laps:
    """Find the logs that share a road: compare each log with the roads of earlier logs.

    Computing time: half a second for the comparison of two laps of 4 km.
    """
    groups: list[list[int]] = []
    distance: dict[int, np.ndarray] = {}
    path: list[Road | None] = []
    for i, log in enumerate(logs):
        for k, group in enumerate(groups):
            try:
                found, road = match_common([*(logs[j] for j in group), log], config)
            except UserError:  # the log is of a different road, or cannot be located on this one
                continue
            if min(float(np.isfinite(d).mean()) for d in found) >= MIN_LAP_SHARE:
                group.append(i)
                distance |= dict(zip(group, found, strict=True))
                path[k] = road
                break
        else:
            groups.append([i])
            track = derive_track(log, config)
            distance[i] = track.travelled
            path.append(_derive_path(track))
    of = [next(k for k, group in enumerate(groups) if i in group) for i in range(len(logs))]
    return Laps([distance[i] for i in range(len(logs))], of, path)


def _derive_path(track: object) -> Road | None:
    """Return the path of a log; None if it is a circuit, or if the car hardly moved."""
    try:
        road = derive_road(track)
    except UserError:
        return None
    # The path of a circuit is a single round. But in a log that shares its road with no
    # other log, distances continue over all rounds, so each round has its own knots. A
    # point of the path would then have several values of bank and grade.
    return None if road.is_closed else road


def make_profile(path: Road, knots: Knots, road: int, z: np.ndarray, sd: np.ndarray) -> Road:
    """Return the path with the fitted bank and grade of one road added.

    `road` is the index of the road. `z` has the values of bank and grade of all roads
    (see Knots), and `sd` their standard deviations."""
    columns: dict[str, np.ndarray] = {}
    for kind in knots.kinds:
        mine = knots.get_slice(road, kind)
        columns |= {kind: z[mine], f"{kind}_sd": sd[mine]}
    return path.with_profile(knots.compute_places(road), **columns)
