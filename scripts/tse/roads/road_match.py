"""Where on a road each row of a log is: by GNSS position where it is logged, else by the
path of the car.

The path is the curvature over the distance travelled, yaw rate over speed. It is found in
the curvature of the road by a hidden Markov model (Viterbi, IEEE Trans. Inf. Theory 13
(1967) 260): states are places of the road every STEP and "elsewhere", and a step of the
log goes 0, 1 or 2 steps along the road. So a wrong wheel radius, another lane, a start
anywhere, several rounds of a circuit and a way to the road and off it need no search of
their own. What is matched must go together (MIN_ALIKE) over bends enough (MIN_TURN);
a straight is the same everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from tse.library.core import Config
from tse.library.errors import UserError
from tse.log.rows import CheckedLog
from tse.roads.road import PROFILE, SMOOTH, Array, Road, make_road, to_local

GNSS, PATH = "GNSS position", "path"  # how a place is found
# m: error of a place along the road; by path it is the rms of four real laps against positions
PLACE_SD = {GNSS: 1.0, PATH: 3.0}
STEP = 2.5  # m: places of the road, and of the path; a third of SMOOTH
OFF_ROAD = 15.0  # m: a position further from the path is elsewhere: four lanes, or a poor GNSS
AHEAD = 20.0  # m: distance that an opposite direction counts as, in a search for the nearest place
STANDS = 0.5  # m/s: below it the car stands, and its yaw rate is the bias
SLIPS = 3.0  # nat: cost of 0 or 2 steps of the road in one of the log: 12 nat for a radius 1 % off, a km
ALIKE_SD = 0.25  # of the rms of the road's curvature: how far two drivers are apart in it
MIN_ALIKE_SD = 5e-4  # 1/m: steering on a straight, as if at a radius of 2 km
CLIPPED = 9.0  # of the squared distance over its variance: an overtaken car is no other road
ELSEWHERE = 1.0  # nat, of a step elsewhere: a step that is 1.4 sd apart costs the same
TURNS_OFF = 30.0  # nat, of leaving the road, and of coming to it: 75 m elsewhere
MIN_ALIKE = 0.85  # correlation of both curvatures over a stretch that is said to be on the road
MIN_TURN = 1.0  # rad: turning of the road over that stretch, added up: a straight shows no place
# rad: of that turning enough: parts of a winding road, backwards and mirrored, were alike over 3.6
SURE_TURN = 6.0
SAME_ALIKE = 0.05  # correlation: two parts of a road that differ by less are the same to a log
SURE_SHARE = 0.8  # ... or this share of all turning of the road, or of the log
STRETCH = 0.005  # of the distance by wheels: beyond it the path is matched again, stretched
DRIFT = 60.0  # m: window over which distances of log and road go together
MIN_ROUND = 100.0  # m: a shorter circuit is a circle
PIT_LANE = 300.0  # m: so far from the first row a circuit may begin
CLOSURE = 0.05  # of a round: by so much dead reckoning may miss its start
MAX_PLACES = 8000  # of a road, in the model; a longer road has longer steps


@dataclass(frozen=True)
class Track:
    """The path of a log.

    Parameters
    ----------
    travelled
        (n,) m, distance by the wheels since the first row; it does not decrease.
    heading
        (n,) rad, integral of the yaw rate less its bias, while the car rolls.
    x, y
        (n,) m, by position; None: the log has none.
    latitude, longitude
        (n,) deg, as logged, or None.
    """

    travelled: Array
    heading: Array
    x: Array | None = None
    y: Array | None = None
    latitude: Array | None = None
    longitude: Array | None = None


@dataclass(frozen=True)
class Profile:
    """The road under each of n rows of a log.

    Parameters
    ----------
    distance
        (n,) m along the road, in a circuit of the first round; NaN: not on the road.
    bank, grade, bank_sd, grade_sd
        (n,) rad; NaN: not known. A sd has the error of the place in it, times the slope there.
    how
        GNSS or PATH.
    """

    distance: Array
    bank: Array
    grade: Array
    bank_sd: Array
    grade_sd: Array
    how: str

    @property
    def share(self) -> float:
        """Share of the rows that are on the road."""
        return float(np.isfinite(self.distance).mean())

    @property
    def sd(self) -> float:
        """rad, rms of bank_sd and grade_sd over the rows; NaN: they are not known."""
        known = np.concatenate([self.bank_sd, self.grade_sd])
        known = known[np.isfinite(known)]
        return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")

    def words(self) -> str:
        """Say how many rows are on the road, and how they were found."""
        return f"{100 * self.share:.0f} % of the rows are on the road, found by {self.how}"


def track_of(log: CheckedLog, config: Config | None = None) -> Track:
    """Return the path of a log from wheel speeds and yaw rate, and its positions.

    Parameters
    ----------
    log
        With wheel speeds and yaw rate. Positions: gnss_latitude and gnss_longitude, else
        ref_latitude and ref_longitude, deg, else ref_east and ref_north, m.
    config
        Wheel radii; None: of an ordinary car. Their error is found with the place.
    """
    c = config or Config()
    speed = 0.5 * (c.wheel_radius_front * _filled(log.data["wheel_speed_front"].to_numpy(float))
                   + c.wheel_radius_rear * _filled(log.data["wheel_speed_rear"].to_numpy(float)))  # fmt: skip
    rate = _filled(log.data["yaw_rate"].to_numpy(float))
    stands = np.abs(speed) < STANDS
    bias = float(np.median(rate[stands])) if stands.any() else 0.0
    dt = np.diff(log.time, prepend=log.time[0])
    travelled = np.cumsum(np.maximum(speed, 0.0) * dt)
    heading = np.cumsum(np.where(stands, 0.0, rate - bias) * dt)
    columns = {**{n: log.extra[n] for n in log.extra}, **{n: log.ref[n] for n in log.ref}}
    for north, east in (("gnss_latitude", "gnss_longitude"), ("ref_latitude", "ref_longitude")):
        if north in columns and east in columns:
            latitude, longitude = (columns[n].to_numpy(float) for n in (north, east))
            known = np.flatnonzero(np.isfinite(latitude) & np.isfinite(longitude))
            if len(known):
                x, y = to_local(latitude, longitude, (latitude[known[0]], longitude[known[0]]))
                return Track(travelled, heading, x, y, latitude, longitude)
    if "ref_east" in columns and "ref_north" in columns:
        return Track(travelled, heading, *(columns[n].to_numpy(float) for n in ("ref_east", "ref_north")))
    return Track(travelled, heading)


def _filled(x: Array) -> Array:
    """Return a channel with the line between its neighbours where it is missing; 0 where
    it is missing altogether."""
    known = np.flatnonzero(np.isfinite(x))
    return np.interp(np.arange(len(x)), known, x[known]) if len(known) else np.zeros(len(x))


def along(road: Road, log: CheckedLog, config: Config | None = None) -> Profile:
    """Find bank and grade under every row of a log.

    Parameters
    ----------
    road
        Of which the log drives all, a part, or several rounds, in the direction of its
        distance.
    log, config
        As in track_of().

    Returns
    -------
    Profile

    Raises
    ------
    UserError
        The log is on another road, or what it has does not show where on this one. The
        text says why.

    Notes
    -----
    By position the cost is O(n log N). By path it is O(M N) for M steps of the log and N of
    the road: 0.5 s for laps of 4 km.
    """
    track = track_of(log, config)
    distance, how = _place(road, track, str(log.path))
    if road.is_closed:
        distance = road.distance[0] + np.mod(distance - road.distance[0], road.length)
    bank, grade, bank_sd, grade_sd = (road.at(n, distance) for n in PROFILE)
    off = PLACE_SD[how]
    bank_sd, grade_sd = (
        np.hypot(sd, off * road.slope(name, distance))
        for name, sd in (("bank", bank_sd), ("grade", grade_sd))
    )
    return Profile(distance, bank, grade, bank_sd, grade_sd, how)


def on_road(log: CheckedLog, road: Road, config: Config | None = None) -> tuple[CheckedLog, Profile]:
    """Return a log that has the bank and grade of a road as columns, as the filter and the replay use them.

    Parameters
    ----------
    log, road, config
        As in along(). Columns bank and grade of the log are replaced.

    Returns
    -------
    Log
        With a note of how many rows are on the road. The log that is given stays as it is.
    Profile
        What it was given.

    Raises
    ------
    UserError
        As along().
    """
    import pandas as pd

    profile = along(road, log, config)
    columns = {str(n): log.extra[n].to_numpy(float) for n in log.extra if n not in PROFILE}
    columns |= {n: x for n in ("bank", "grade") if np.isfinite(x := getattr(profile, n)).any()}
    notes = [*log.notes, f"road by {road.path}: {profile.words()}"]
    return replace(log, extra=pd.DataFrame(columns, index=range(len(log))), notes=notes), profile


def common(logs: Sequence[CheckedLog], config: Config | None = None) -> tuple[list[Array], Road]:
    """Find one distance for all rows of several logs of one road.

    Parameters
    ----------
    logs
        Of the same road in the same direction. The one that goes furthest gives the
        distance, from its first row on; where it comes round again, the road is a
        circuit, and all rounds have the distances of the first.
    config
        As in track_of().

    Returns
    -------
    distance
        A list of (n,) m, one for each log; NaN: not on the common road.
    road
        Path and curvature every 5 m, without bank and grade: Road.with_profile() puts
        them in.

    Raises
    ------
    UserError
        A log is on another road.
    """
    tracks = [track_of(log, config) for log in logs]
    longest = max(tracks, key=lambda t: float(t.travelled[-1]))
    road = road_of(longest)
    found = [_place(road, track, str(log.path))[0] for log, track in zip(logs, tracks, strict=True)]
    if road.is_closed:
        found = [np.mod(s, road.length) for s in found]
    return found, road


def road_of(track: Track) -> Road:
    """Return the road that a log has driven, without bank and grade: places every 2 STEP,
    of a circuit one round.

    UserError: the car has not moved by 4 STEP."""
    end = float(track.travelled[-1])
    if end < 4 * STEP:
        raise UserError(f"the car has moved by {end:.3g} m: that is no road")
    way = np.append(np.arange(0.0, end - STEP, 2 * STEP), end)
    turn = _curvature(track, way)
    position = _positions(track, way)
    distance = way - way[0]
    if position is not None:
        distance = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(position[0]), np.diff(position[1])))])
        distance = np.maximum.accumulate(distance + 1e-3 * np.arange(len(distance)))
    x, y, latitude, longitude = position or (None, None, None, None)
    road = make_road(
        distance, x=x, y=y, latitude=latitude, longitude=longitude, curvature=np.clip(turn, -1.0, 1.0)
    )
    begin, end = _round(road) or (0, 0)
    if not end:
        return road
    inside = slice(begin, end)

    def closed(column: Array | None) -> Array | None:
        return None if column is None else np.append(column[inside], column[begin])

    round_ = np.append(distance[inside], distance[end]) - distance[begin]
    return make_road(round_, x=closed(x), y=closed(y), latitude=closed(latitude), longitude=closed(longitude),
                     curvature=closed(road.curvature), is_closed=True)  # fmt: skip


def _positions(track: Track, way: Array) -> tuple[Array, Array, Array | None, Array | None] | None:
    """Return x, y, latitude, longitude at distances of the log, each the mean of the rows
    about it; None: there are no positions."""
    if track.x is None:
        return None
    known = np.isfinite(track.x) & np.isfinite(track.y)
    if known.sum() < 4:
        return None
    rolled = known & np.diff(track.travelled, prepend=-1.0).astype(bool)
    s = track.travelled[rolled]

    def smooth(column: Array | None) -> Array | None:
        if column is None:
            return None
        fine = np.arange(0.0, track.travelled[-1], 1.0)
        return np.interp(way, fine, _smooth(np.interp(fine, s, column[rolled]), STEP))

    return smooth(track.x), smooth(track.y), smooth(track.latitude), smooth(track.longitude)


def _smooth(values: Array, sd: float) -> Array:
    """Return values smoothed by a Gaussian window of so many values, sd; a slope stays
    one up to both ends."""
    wide = min(int(4 * sd) + 1, len(values) - 1)
    return gaussian_filter1d(np.pad(values, wide, mode="reflect", reflect_type="odd"), sd)[
        wide : len(values) + wide
    ]


def _curvature(track: Track, way: Array) -> Array:
    """Return the curvature of a log at distances that it has travelled, smoothed over
    SMOOTH, 1/m."""
    rolls = np.diff(track.travelled, prepend=-1.0) > 0
    fine = np.arange(0.0, track.travelled[-1], STEP)
    heading = np.interp(fine, track.travelled[rolls], track.heading[rolls])
    return np.interp(way, fine, gaussian_filter1d(np.gradient(heading, STEP), SMOOTH / STEP, mode="nearest"))


# ---- a circuit


def _round(road: Road) -> tuple[int, int] | None:
    """Return the places at which a round begins and ends, where the path comes there
    again in the same direction; None: nowhere.

    By position the first place within OFF_ROAD. By curvature the shift at which the rest
    is most like the beginning, if the path by dead reckoning comes near its start there,
    too."""
    s = road.distance
    if road.x is not None:
        points = _directed(road.x, road.y)
        for begin in np.searchsorted(s, np.arange(0.0, min(PIT_LANE, s[-1]), 10.0)):
            apart = np.linalg.norm(points - points[begin], axis=1)
            again = np.flatnonzero((apart < OFF_ROAD) & (s > s[begin] + MIN_ROUND))
            if len(again):
                first = again[: int(np.argmax(np.diff(again, append=len(s) + 2) > 1)) + 1]
                return int(begin), int(first[np.argmin(apart[first])])
        return None
    heading = np.cumsum(road.curvature * np.gradient(s))
    x, y = (np.cumsum(f(heading) * np.gradient(s)) for f in (np.cos, np.sin))
    alike = np.zeros(len(s))
    for lag in range(int(np.searchsorted(s, MIN_ROUND)), len(s) - int(np.searchsorted(s, MIN_ROUND))):
        back = np.hypot(x[lag] - x[0], y[lag] - y[0]) < CLOSURE * s[lag]
        alike[lag] = _alike(road.curvature[: len(s) - lag], road.curvature[lag:]) if back else 0.0
    end = int(np.argmax(alike > MIN_ALIKE))
    if not alike[end] > MIN_ALIKE:
        return None
    end += int(np.argmax(alike[end : end + 10]))
    return 0, end


def _alike(a: Array, b: Array) -> float:
    """Return the correlation of two curvatures about 0."""
    size = float(np.sqrt(np.sum(a**2) * np.sum(b**2)))
    return float(np.sum(a * b)) / size if size > 0 else 0.0


# ---- by position


def _directed(x: Array, y: Array) -> Array:
    """Return (n, 4): places of a path, m, and AHEAD times the direction over two sqrt(2):
    opposite ones are AHEAD apart."""
    dx, dy = np.gradient(x), np.gradient(y)
    size = np.maximum(np.hypot(dx, dy), 1e-9)
    return np.column_stack([x, y, 0.5 * AHEAD * dx / size, 0.5 * AHEAD * dy / size])


def _place(road: Road, track: Track, name: str) -> tuple[Array, str]:
    """Return the distance along the road of every row, NaN elsewhere, and how it was
    found."""
    if track.latitude is not None and road.latitude is not None:
        x, y = to_local(track.latitude, track.longitude, road.origin)
        start = to_local(road.latitude, road.longitude, road.origin)
        found = by_position(start[0], start[1], road.distance, x, y, track.travelled)
        if not np.isfinite(found).any():
            raise UserError(f"{name}: is on another road than {road.path}: no position is within {OFF_ROAD:g} m of it, "
                            f"driven in its direction")  # fmt: skip
        return found, GNSS
    if track.latitude is None and track.x is not None and road.latitude is None and road.x is not None:
        found = by_position(road.x, road.y, road.distance, track.x, track.y, track.travelled)
        if np.isfinite(found).any():  # else perhaps in another frame
            return found, GNSS
    return by_path(road, track, name), PATH


def by_position(x: Array, y: Array, distance: Array, at_x: Array, at_y: Array, travelled: Array) -> Array:
    """Return how far along a path places are.

    Parameters
    ----------
    x, y, distance
        (n,) m, the path.
    at_x, at_y
        (m,) m, the places, in the same frame; NaN: not known, then between its
        neighbours.
    travelled
        (m,) m, distance by the wheels: gives the direction.

    Returns
    -------
    (m,) m; NaN: further than OFF_ROAD from the path, or the other way.
    """
    known = np.isfinite(at_x) & np.isfinite(at_y)
    rolled = np.flatnonzero(known & (np.diff(travelled, prepend=-1.0) > 0))
    if len(rolled) < 4:
        return np.full(len(at_x), np.nan)
    fine = np.append(np.arange(distance[0], distance[-1], 1.0), distance[-1])
    path_x, path_y = np.interp(fine, distance, x), np.interp(fine, distance, y)
    tree = cKDTree(_directed(path_x, path_y))
    way = np.arange(0.0, travelled[-1], 1.0)
    smooth_x, smooth_y = (_smooth(np.interp(way, travelled[rolled], p[rolled]), STEP) for p in (at_x, at_y))
    apart, near = tree.query(_directed(smooth_x, smooth_y), distance_upper_bound=OFF_ROAD)
    on = np.isfinite(apart)
    near = np.where(on, near, 0)
    tangent = np.column_stack([np.gradient(path_x), np.gradient(path_y)])[near]
    off = np.column_stack([smooth_x - path_x[near], smooth_y - path_y[near]])
    length = np.maximum(np.sum(tangent**2, axis=1), 1e-9)
    s = fine[near] + np.clip(np.sum(off * tangent, axis=1) / length, -1.0, 1.0)
    s = np.clip(np.where(on, s, np.nan), distance[0], distance[-1])
    return _between(way, s, travelled)


def _between(way: Array, s: Array, at: Array) -> Array:
    """Interpolate distances along a road, but neither over a jump (a round begins anew)
    nor into what is NaN."""
    i = np.clip(np.searchsorted(way, at, side="right") - 1, 0, len(way) - 2)
    share = (at - way[i]) / (way[i + 1] - way[i])
    step = s[i + 1] - s[i]
    jumps = ~(np.abs(step) < 5 * (way[i + 1] - way[i]))
    return np.where(jumps, np.where(share < 0.5, s[i], s[i + 1]), s[i] + share * step)


# ---- by path


def by_path(road: Road, track: Track, name: str = "the log") -> Array:
    """Return the distance along the road of every row by curvature alone; NaN elsewhere.
    In a circuit it goes on with each round.

    UserError: nothing of the log is like the road; the text says why."""
    step = max(STEP, road.length / MAX_PLACES)
    places = road.distance[0] + step * np.arange(max(int(road.length / step), 2))
    its = _smoothed(road, places, step)
    way = np.arange(0.0, float(track.travelled[-1]) + step, step)
    turn = _curvature(track, way)
    scale = float(np.sqrt(np.mean(its**2)))
    if np.sum(np.abs(its)) * step < MIN_TURN:
        raise UserError(f"{name}: cannot be aligned with {road.path}: the road turns by less than {MIN_TURN:g} rad, so only "
                        f"GNSS positions show where on it a row is")  # fmt: skip
    sd = max(ALIKE_SD * scale, MIN_ALIKE_SD)
    place = _accepted(viterbi(its, turn, sd, road.is_closed), its, turn, step)
    stretch = _stretch(place, road.is_closed)
    if abs(stretch - 1.0) > STRETCH:  # wheel radius: 0 and 2 steps were needed
        track = replace(track, travelled=stretch * track.travelled)
        way = np.arange(0.0, float(track.travelled[-1]) + step, step)
        turn = _curvature(track, way)
        place = _accepted(viterbi(its, turn, sd, road.is_closed), its, turn, step)
    if not (place >= 0).any():
        raise UserError(f"{name}: cannot be aligned with {road.path}: nowhere do its bends go with those of the road for long "
                        f"enough; it is another road, the other direction, or too little of it")  # fmt: skip
    if _is_ambiguous(place, its, turn, step, road.is_closed):
        raise UserError(f"{name}: cannot be aligned with {road.path}: its bends repeat, as those of a slalom, and are as much like "
                        f"another part of the road; only GNSS positions show where on it a row is")  # fmt: skip
    s = road.distance[0] + _drifting(place, its, turn, step, road.is_closed)
    return _between(way, s, track.travelled)


def _stretches(place: npt.NDArray[np.int64]) -> list[tuple[int, int]]:
    """Return beginning and end of each stretch that is on the road."""
    edges = np.flatnonzero(np.diff((place >= 0).astype(int), prepend=0, append=0))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _stretch(place: npt.NDArray[np.int64], is_closed: bool) -> float:
    """Return how much longer the road is than what the wheels have travelled on it; 1
    where nothing is on it."""
    steps = np.concatenate([np.diff(place[b:e]) for b, e in _stretches(place)] or [np.ones(1)])
    steps = steps[steps >= 0] if is_closed else steps  # a round begins
    return float(np.mean(steps))


def _smoothed(road: Road, places: Array, step: float) -> Array:
    mode = "wrap" if road.is_closed else "nearest"
    return gaussian_filter1d(road.at("curvature", places), SMOOTH / step, mode=mode)


def viterbi(its: Array, turn: Array, sd: float, is_closed: bool) -> npt.NDArray[np.int64]:
    """Return the likeliest place of each step of a log on a road.

    Parameters
    ----------
    its
        (N,) 1/m, curvature of the road, in steps.
    turn
        (M,) 1/m, that of the log, in the same steps.
    sd
        1/m, of their difference on one road.
    is_closed
        The last place comes before the first.

    Returns
    -------
    (M,) int, 0 .. N - 1; -1: elsewhere.

    Notes
    -----
    O(M N) time, M N bytes.
    """
    n, steps = len(its), len(turn)
    came = np.zeros(
        (steps, n + 1), np.int8
    )  # 0, 1, 2: places further; 3: from elsewhere; [n]: 1 left the road
    left = np.zeros(steps, np.int64)  # from which place the log went elsewhere
    cost = np.full(n + 1, TURNS_OFF)
    cost[n] = 0.0
    options = np.empty((4, n))
    rows = np.arange(n)
    for i in range(steps):
        on = cost[:n]
        for k, price in ((0, SLIPS), (1, 0.0), (2, SLIPS)):
            options[k] = np.roll(on, k) + price
            if not is_closed:
                options[k, :k] = np.inf
        options[3] = cost[n] + TURNS_OFF
        best = np.argmin(options, axis=0)
        away = int(np.argmin(on))
        goes = on[away] + TURNS_OFF < cost[n]
        new = np.empty(n + 1)
        new[:n] = options[best, rows] + 0.5 * np.minimum(((turn[i] - its) / sd) ** 2, CLIPPED)
        new[n] = min(on[away] + TURNS_OFF, cost[n]) + ELSEWHERE
        came[i, :n] = best
        came[i, n] = goes
        left[i] = away
        cost = new - new.min()
    place = np.empty(steps, np.int64)
    at = int(np.argmin(cost))
    for i in range(steps - 1, -1, -1):
        place[i] = -1 if at == n else at
        before = int(left[i]) if came[i, n] else n
        if at < n:
            before = n if came[i, at] == 3 else (at - int(came[i, at])) % n
        at = before
    return place


def _accepted(place: npt.NDArray[np.int64], its: Array, turn: Array, step: float) -> npt.NDArray[np.int64]:
    """Return the places without stretches that are not alike, or turn too little to say
    so."""
    whole = SURE_SHARE * step * min(float(np.sum(np.abs(its))), float(np.sum(np.abs(turn))))
    least = max(MIN_TURN, min(SURE_TURN, whole))
    out = np.full(len(place), -1)
    for begin, end in _stretches(place):
        part = place[begin:end]
        if _alike(its[part], turn[begin:end]) > MIN_ALIKE and np.sum(np.abs(its[part])) * step > least:
            out[begin:end] = part
    return out


def _is_ambiguous(
    place: npt.NDArray[np.int64], its: Array, turn: Array, step: float, is_closed: bool
) -> bool:
    """Return whether the longest stretch is nearly as much like a part of the road that lies elsewhere."""
    begin, end = max(_stretches(place), key=lambda s: s[1] - s[0])
    part, mine = place[begin:end], turn[begin:end]
    least = _alike(its[part], mine) - SAME_ALIKE
    n, first = len(its), int(MIN_ROUND / step)
    for shift in range(first, n - first) if is_closed else (*range(-n, 1 - first), *range(first, n)):
        there = part + shift
        inside = slice(None) if is_closed else (there >= 0) & (there < n)
        at = np.mod(there, n)[inside]
        if len(at) > SURE_SHARE * len(part) and _alike(its[at], mine[inside]) > least:
            return True
    return False


def _drifting(place: npt.NDArray[np.int64], its: Array, turn: Array, step: float, is_closed: bool) -> Array:
    """Return distances from the first place of the road, m, that drift slowly against the
    distance of the log; NaN elsewhere.

    Places weigh as they show where they are, by the slope of the curvature; then their
    offset is corrected three times by least squares over DRIFT (Lucas and Kanade, IJCAI
    (1981) 674)."""
    n, window = len(its), DRIFT / step
    slope = np.gradient(np.concatenate([its[-2:], its, its[:2]]) if is_closed else its, step)
    slope = slope[2:-2] if is_closed else slope
    floor = 0.01 * float(np.mean(slope**2)) + 1e-30
    s = np.full(len(place), np.nan)
    for begin, end in _stretches(place):
        part = place[begin:end]
        rounds = np.cumsum(np.diff(part, prepend=part[0]) < 0) if is_closed else 0
        way, mine = step * np.arange(len(part)), turn[begin:end]
        weight = slope[part] ** 2 + floor
        offset = step * (part + n * rounds) - way

        def mean(values: Array, weight: Array = weight) -> Array:
            smooth = [gaussian_filter1d(v, window, mode="nearest") for v in (weight * values, weight)]
            return smooth[0] / smooth[1]

        offset = mean(offset)
        for _ in range(3):
            at = (way + offset) / step
            at = np.mod(at, n) if is_closed else at
            there, its_slope = (
                np.interp(at, np.arange(n), c, period=n if is_closed else None) for c in (its, slope)
            )
            push = gaussian_filter1d(its_slope * (mine - there), window, mode="nearest")
            offset += np.clip(
                push / (gaussian_filter1d(its_slope**2, window, mode="nearest") + floor), -step, step
            )
        s[begin:end] = way + offset
    return s if is_closed else np.where((s < -step) | (s > n * step), np.nan, np.clip(s, 0.0, (n - 1) * step))
