"""Estimate bank and grade of the roads of the logs, before the search for effects of the
car.

Bank and grade change the measurements as much as a change of the tyres does, but mostly
more slowly. A fit on level roads would explain them by a scale error of accel_y or by
different tyres. Therefore road and car are fitted together.

A fit of the road after the fit of the car could not correct this: the parameters of the
car would stay wrong and cause residuals of the yaw rate. Bank and grade cannot explain
these residuals, because they do not act on the yaw rate directly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tse.car.vehicle import Vehicle
from tse.gaps.catalogue import Effect, load_catalogue
from tse.gaps.infer.hypotheses import NAME_AT
from tse.identify.data import PreparedLog, add_missing_channels
from tse.identify.fit import CarFit, fit
from tse.identify.knots import KNOT_SD, PROFILES, Knots
from tse.identify.laps import Laps, find_laps, make_profile
from tse.identify.problem import CarProblem
from tse.identify.unknowns import make_prior
from tse.library.core import Config
from tse.log.rows import CheckedLog
from tse.roads.road import Road

ROAD_PROBABILITY = 0.1  # prior probability that a road profile is large enough to be found
# max ln odds, so that exp() does not overflow; at this limit the probability rounds to 1
MAX_ODDS = 50.0


@dataclass(frozen=True)
class FoundRoad:
    """Size of the bank or of the grade of all roads, and the evidence that the roads are
    not level."""

    effect: Effect  # bank or grade
    size: float  # [rad] rms of the profile about its mean on each road
    ci95: tuple[float, float]  # 95 % interval of `size`
    nats: float  # [nat] ln of the Bayes factor of the profile against a level road
    probability: float  # probability that the roads have such a profile, i.e. are not level


@dataclass
class Roads:
    """The profiles of bank and grade that were found, and the logs on these roads.

    Attributes
    ----------
    logs
        The logs, with bank and grade in each row if a profile was found.
    found
        The profiles that count as found: probability at least NAME_AT, and size at least
        the negligible size of the effect.
    road, fit
        The knots of the profiles, i.e. the points along the road between which a profile
        is interpolated, and the fit of car and road. None if no profile was found.
    laps
        Which logs are laps of the same road. None if no profile was found or the logs
        were not compared with each other.
    """

    logs: list[PreparedLog]
    found: list[FoundRoad] = field(default_factory=list)
    road: Knots | None = None
    fit: CarFit | None = None
    laps: Laps | None = None

    def list_roads(self) -> list[Road]:
        """Return the roads that were found, in the form that is written to road.csv."""
        if self.laps is None or self.fit is None:
            return []
        sd = self.fit.equations.compute_road_sd()
        return [
            make_profile(p, self.road, k, self.fit.z, sd)
            for k, p in enumerate(self.laps.path)
            if p is not None
        ]


def find_roads(
    logs: Sequence[PreparedLog],
    config: Config,
    vehicle: Vehicle,
    jobs: int,
    say: Callable[[str], None] = lambda _: None,
    read: Sequence[CheckedLog] = (),
) -> Roads:
    """Estimate the roads of logs that data.prepare() has prepared.

    If a log already has bank or grade, no road is estimated. `read` has the same logs as
    they were before data.prepare(). Laps of the same road are detected in them, and these
    laps get one common profile. Without `read`, each log gets a profile of its own.

    Car, bank and grade are fitted together. A profile counts as found if its probability
    is at least NAME_AT and its size is not negligible. If only one of bank and grade
    counts as found, the fit is repeated without the other, because a profile that does
    not count as found must not influence the car.
    """
    logs = list(logs)
    own = [add_missing_channels(log) for log in logs if log.stretches]
    if any(log.road for log in own):
        return Roads(logs)
    there = (
        find_laps([r for r, log in zip(read, logs, strict=True) if log.stretches], config) if read else None
    )
    distance, of = (there.distance, there.of) if there else ([log.distance for log in own], None)
    kinds, x, z = PROFILES, None, None
    while kinds:
        road = Knots.lay(distance, of, kinds)
        problem = CarProblem(own, config, make_prior(vehicle, config), jobs, road, lean=False)
        if not problem.groups:
            break
        ended = fit(problem, x, z, say=lambda text: say(f"car and road: {text}"))
        sd = ended.equations.compute_road_sd()
        found = [_judge_profile(kind, road, ended, sd) for kind in kinds]
        shown = tuple(
            f.effect.id
            for f in found
            if f.probability >= NAME_AT and f.size >= f.effect.strengths[0].negligible
        )
        if shown == kinds:
            return Roads(_place_logs(logs, road, ended.z), found, road, ended, there)
        fewer = Knots.lay(distance, of, shown)
        x, z = ended.search, np.zeros(len(fewer))
        for r in range(len(fewer.count)):
            for kind in shown:
                z[fewer.get_slice(r, kind)] = ended.z[road.get_slice(r, kind)]
        kinds = shown
    return Roads(logs)


def _judge_profile(kind: str, road: Knots, ended: CarFit, road_sd: np.ndarray) -> FoundRoad:
    """Return size, evidence and probability of one profile, bank or grade, over all
    roads.

    The size is the rms of the profile about its mean on each road. Its sd is computed as
    if the errors of the values at the knots were independent and had equal sds.
    """
    places = [road.get_slice(r, kind) for r in range(len(road.count))]
    nats = sum(ended.equations.compute_road_evidence(p, ended.z, KNOT_SD) for p in places)
    size = float(np.sqrt(np.mean([np.var(ended.z[p]) for p in places])))
    values = sum(p.stop - p.start for p in places)
    sd = float(np.sqrt(np.mean(np.concatenate([road_sd[p] for p in places]) ** 2) / values))
    odds = float(np.exp(min(nats + np.log(ROAD_PROBABILITY / (1.0 - ROAD_PROBABILITY)), MAX_ODDS)))
    ends = max(0.0, size - 1.96 * sd), size + 1.96 * sd
    return FoundRoad(load_catalogue()[kind], size, ends, nats, odds / (1.0 + odds))


def _place_logs(logs: Sequence[PreparedLog], road: Knots, z: np.ndarray) -> list[PreparedLog]:
    """Return the logs with bank and grade in each row. Logs without a stretch that can be
    compared with a simulation are returned unchanged.
    """
    found, i = [], 0
    for log in logs:
        found.append(replace(log, road=road.compute_profiles(i, z)) if log.stretches else log)
        i += 1 if log.stretches else 0
    return found
