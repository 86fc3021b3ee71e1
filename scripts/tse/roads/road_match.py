"""Find the place on a road of each row of a log.

A place is a point of the road, given by its distance along the road. If the log and the
road have positions, the place of a row is the place nearest to the position of the car.
Otherwise, the curvature of the path of the car (yaw rate / speed) as a function of the
travelled distance is matched with the curvature of the road.

Curvatures are matched by a hidden Markov model: its most probable sequence of states
(Viterbi, IEEE Trans. Inf. Theory 13 (1967) 260) gives the places. The states are places
on the road, PLACE_STEP apart, and the state "elsewhere", i.e. off the road. In each step
of the log, i.e. while the car travels PLACE_STEP, the state moves on by 0, 1 or 2 places.
Moves by 0 and 2 places allow for an error of the travelled distance due to a wrong wheel
radius or a different lane. The car may start anywhere on the road, drive several rounds
of a circuit, and drive to the road and away from it.

A stretch is a part of the log in which the car is on the road without interruption. A
stretch is accepted only if the curvatures of log and road correlate (MIN_ALIKE) and the
road turns enough (SURE_TURN, SURE_SHARE, MIN_TURN). On straights, the curvature is 0
everywhere and does not tell the place."""

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
from tse.roads.road import PROFILE, SMOOTH_DISTANCE, Array, Road, make_road, to_local

# names of the two methods that find places on a road, as in messages to the user
GNSS, PATH = "GNSS position", "path"
# Key: method that finds the place on the road of each row of a log. Value: [m] sd of the
# error of the found distance along the road. The sd of PATH is the rms difference between
# the distances by PATH and by GNSS in four real laps.
PLACE_SD = {GNSS: 1.0, PATH: 3.0}
PLACE_STEP = 2.5  # [m] spacing of the places of road and log: a third of SMOOTH_DISTANCE
# [m] max distance between the position of a car on the road and the path of the road. It
# allows for a car four lanes (15 m) beside the path, or for a poor GNSS receiver.
MAX_OFF_ROAD = 15.0
# [m] distance that is attributed to a car that is on the road, but drives in the opposite
# direction. It exceeds MAX_OFF_ROAD, so such a car counts as off the road.
DIRECTION_DISTANCE = 20.0
# [m/s] Below this speed, the car is taken to stand. Its true yaw rate is then 0, so the
# measured yaw rate is the bias of the gyro.
MIN_ROLL_SPEED = 0.5
# Costs of the hidden Markov model are negative log-likelihoods, in nat. The model divides
# the log and the road into steps of PLACE_STEP.

# [nat] cost of a step of the log in which the place on the road advances by 0 or 2 steps
# instead of 1. An error of the wheel radius of 1 % requires this in 4 of the 400 steps of
# a km, and thus costs 12 nat per km.
SLIP_COST = 3.0
# [1] sd of the difference between the curvatures of log and road, relative to the rms
# curvature of the road. The curvatures differ because drivers take different lines.
ALIKE_SD = 0.25
# [1/m] min of the sd of the difference between the curvatures of log and road: this value
# is used if ALIKE_SD x rms curvature is smaller. It allows for steering corrections on a
# straight: curves with a radius of 2 km.
MIN_ALIKE_SD = 5e-4
# [1] larger values of (difference of the curvatures / its sd)^2 are replaced by this
# value. So a short large difference, e.g. when the car overtakes, does not put the car
# off the road.
MAX_SQUARED_ERROR = 9.0
# [nat] cost of each step of the log in which the car is off the road. It equals the cost
# of a step on the road in which the curvature of the log differs from the curvature of
# the road by 1.4 sd: 0.5 x 1.4^2 = 1.
ELSEWHERE_COST = 1.0
# [nat] cost of leaving the road, and cost of reaching the road. Each equals the cost of
# being off the road for 30 steps of PLACE_STEP, i.e. 75 m.
TURN_OFF_COST = 30.0
# Limits for a stretch, i.e. a part of the log in which the model finds the car on the
# road without interruption. Turning is the integral of |curvature| of the road over the
# stretch.

# [1] min correlation of the curvatures of road and log in a stretch. A stretch with a
# lower correlation counts as off the road
MIN_ALIKE = 0.85
# [rad] min turning in a stretch. A stretch that turns less counts as off the road. A road
# that turns less in total is refused, because none of its stretches can turn enough
MIN_TURN = 1.0
# [rad] turning in a stretch above which its match is not taken as chance. A stretch that
# turns less may match by chance: a stretch with 3.6 rad of a winding road was found to
# match the same road reversed or mirrored.
SURE_TURN = 6.0
# [1] The place of a stretch is ambiguous if the curvature of the log correlates with a
# different part of the road almost as well: by less than this value worse than with the
# part on which the stretch was found.
SAME_ALIKE = 0.05
# [1] A stretch that turns by less than SURE_TURN is accepted as well if it has more than
# this share of the turning of the whole road or of the whole log, whichever turns less.
# So a short road or log can be matched.
SURE_SHARE = 0.8
# [1] The match of a log gives the stretch factor: distance along the road / distance from
# the wheel speeds. If the factor differs from 1 by more than this value, e.g. due to a
# wrong wheel radius, the distance from the wheel speeds is corrected, and the log is
# matched again.
MAX_STRETCH = 0.005
# [m] sd of the Gaussian window over which _refine_places() averages the offset, i.e. the
# distance along the road minus the distance from the wheel speeds. The offset is taken as
# constant within the window.
DRIFT_WINDOW = 60.0
MIN_ROUND = 100.0  # [m] min length of a circuit
# [m] max distance that the car drives before it reaches the circuit, e.g. in a pit lane
MAX_PIT_LANE = 300.0
# [1] limit of: distance between beginning and end of a round / length of the round, if
# the path of the round is computed from the curvature. Above it, there is no circuit
MAX_CLOSURE = 0.05
# Max number of places on the road in the hidden Markov model. If a road needs more places
# PLACE_STEP apart, their spacing is increased.
MAX_PLACES = 8000


@dataclass(frozen=True)
class Track:
    """The path of the car in a log of n rows.

    Parameters
    ----------
    travelled
        (n,) [m] distance from the wheel speeds since the first row. It never decreases.
    heading
        (n,) [rad] integral of (yaw rate - bias of the gyro) over time since the first
        row. It stays constant while the car stands.
    x, y
        (n,) m, positions. None: the log has none.
    latitude, longitude
        (n,) deg, as logged. None: the log has none.
    """

    travelled: Array
    heading: Array
    x: Array | None = None
    y: Array | None = None
    latitude: Array | None = None
    longitude: Array | None = None


@dataclass(frozen=True)
class Profile:
    """Bank and grade of the road under each of n rows of a log.

    Parameters
    ----------
    distance
        (n,) [m] distance along the road, counted anew in each round of a circuit. NaN:
        off the road.
    bank, grade, bank_sd, grade_sd
        (n,) [rad]. NaN: unknown. Both sd include the effect of an error of the place,
        which is PLACE_SD x the derivative of bank or grade with respect to distance.
    how
        Method by which the places were found: GNSS or PATH.
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
        """rms [rad] of all known values of bank_sd and grade_sd together. NaN: none is
        known."""
        known = np.concatenate([self.bank_sd, self.grade_sd])
        known = known[np.isfinite(known)]
        return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")

    def describe(self) -> str:
        """Return the share of rows on the road and the method, in words."""
        return f"{100 * self.share:.0f} % of the rows are on the road, found by {self.how}"


def derive_track(log: CheckedLog, config: Config | None = None) -> Track:
    """Compute the path of a log from wheel speeds and yaw rate, with positions if logged.

    Parameters
    ----------
    log
        Log with wheel speeds and yaw rate. The positions are the first of these pairs of
        columns that the log has: gnss_latitude and gnss_longitude [deg], ref_latitude and
        ref_longitude [deg], ref_east and ref_north [m].
    config
        Settings with the wheel radii. None: the default radii. A wrong radius does no
        harm: positions give the place without the radii, and the match of curvatures
        estimates and corrects the error of the distance.
    """
    c = config or Config()
    front, rear = (_fill_gaps(log.data[f"wheel_speed_{a}"].to_numpy(float)) for a in ("front", "rear"))
    speed = 0.5 * (c.wheel_radius_front * front + c.wheel_radius_rear * rear)
    rate = _fill_gaps(log.data["yaw_rate"].to_numpy(float))
    stands = np.abs(speed) < MIN_ROLL_SPEED
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


def _fill_gaps(x: Array) -> Array:
    """Interpolate the missing values of a channel. If the channel has no value at all,
    return zeros."""
    known = np.flatnonzero(np.isfinite(x))
    return np.interp(np.arange(len(x)), known, x[known]) if len(known) else np.zeros(len(x))


def match_log(road: Road, log: CheckedLog, config: Config | None = None) -> Profile:
    """Find bank and grade under every row of a log.

    Parameters
    ----------
    road
        The car may drive the whole road, a part of it, or several rounds, but only in the
        direction in which Road.distance increases.
    log, config
        As in derive_track().

    Returns
    -------
    Profile

    Raises
    ------
    UserError
        The log is not on this road, or its place on the road cannot be determined. The
        message states the reason.

    Notes
    -----
    The computing time is O(n log N) with positions, and O(M N) without positions, e.g.
    0.5 s for laps of 4 km. n: number of rows. M: number of steps of PLACE_STEP that the
    car travels. N: number of places on the road.
    """
    track = derive_track(log, config)
    distance, how = _match_track(road, track, str(log.path))
    if road.is_closed:
        distance = road.distance[0] + np.mod(distance - road.distance[0], road.length)
    bank, grade, bank_sd, grade_sd = (road.interpolate(n, distance) for n in PROFILE)
    off = PLACE_SD[how]
    bank_sd, grade_sd = (
        np.hypot(sd, off * road.compute_slope(name, distance))
        for name, sd in (("bank", bank_sd), ("grade", grade_sd))
    )
    return Profile(distance, bank, grade, bank_sd, grade_sd, how)


def add_road(log: CheckedLog, road: Road, config: Config | None = None) -> tuple[CheckedLog, Profile]:
    """Add bank and grade of a road to a log, as columns that filter and replay use.

    Parameters
    ----------
    log, road, config
        As in match_log(). If the log has columns bank and grade, they are replaced.

    Returns
    -------
    CheckedLog
        A copy of the log, with a note on the share of its rows that are on the road.
    Profile
        Bank and grade of the road under its rows.

    Raises
    ------
    UserError
        As in match_log().
    """
    import pandas as pd

    profile = match_log(road, log, config)
    columns = {str(n): log.extra[n].to_numpy(float) for n in log.extra if n not in PROFILE}
    columns |= {n: x for n in ("bank", "grade") if np.isfinite(x := getattr(profile, n)).any()}
    notes = [*log.notes, f"road from {road.path}: {profile.describe()}"]
    return replace(log, extra=pd.DataFrame(columns, index=range(len(log))), notes=notes), profile


def match_common(logs: Sequence[CheckedLog], config: Config | None = None) -> tuple[list[Array], Road]:
    """Find the distance along a common road for each row of several logs.

    Parameters
    ----------
    logs
        Logs on the same road in the same direction. The road is the path of the longest
        log, and distances count from the first row of this log. If this log returns to
        its start, the road is a circuit, and a place has the same distance in all rounds.
    config
        As in derive_track().

    Returns
    -------
    distance
        One array for each log: (n,) [m] distances of its rows. NaN: off the common road.
    road
        Path and curvature every 5 m. Bank and grade are unknown: Road.with_profile() sets
        them.

    Raises
    ------
    UserError
        A log is on a different road.
    """
    tracks = [derive_track(log, config) for log in logs]
    longest = max(tracks, key=lambda t: float(t.travelled[-1]))
    road = derive_road(longest)
    found = [_match_track(road, track, str(log.path))[0] for log, track in zip(logs, tracks, strict=True)]
    if road.is_closed:
        found = [np.mod(s, road.length) for s in found]
    return found, road


def derive_road(track: Track) -> Road:
    """Return the path of a log as a road with a place every 2 x PLACE_STEP.

    Bank and grade are unknown. If the path is a circuit, the road is one round of it.

    Raises
    ------
    UserError
        The car moved by less than 4 x PLACE_STEP.
    """
    end = float(track.travelled[-1])
    if end < 4 * PLACE_STEP:
        raise UserError(
            f"no road can be made from the log: the car moved by {end:.3g} m, less than {4 * PLACE_STEP:g} m"
        )
    way = np.append(np.arange(0.0, end - PLACE_STEP, 2 * PLACE_STEP), end)
    turn = _compute_track_curvature(track, way)
    position = _average_positions(track, way)
    distance = way - way[0]
    if position is not None:
        distance = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(position[0]), np.diff(position[1])))])
        distance = np.maximum.accumulate(distance + 1e-3 * np.arange(len(distance)))
    x, y, latitude, longitude = position or (None, None, None, None)
    road = make_road(
        distance, x=x, y=y, latitude=latitude, longitude=longitude, curvature=np.clip(turn, -1.0, 1.0)
    )
    begin, end = _find_round(road) or (0, 0)
    if not end:
        return road
    inside = slice(begin, end)

    def close(column: Array | None) -> Array | None:
        return None if column is None else np.append(column[inside], column[begin])

    round_ = np.append(distance[inside], distance[end]) - distance[begin]
    return make_road(
        round_,
        x=close(x),
        y=close(y),
        latitude=close(latitude),
        longitude=close(longitude),
        curvature=close(road.curvature),
        is_closed=True,
    )


def _average_positions(track: Track, way: Array) -> tuple[Array, Array, Array | None, Array | None] | None:
    """Return x, y, latitude and longitude at travelled distances `way`, smoothed.

    Return None if the log has fewer than 4 positions. Latitude and longitude are None if
    the log has only x and y."""
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
        return np.interp(way, fine, _smooth_values(np.interp(fine, s, column[rolled]), PLACE_STEP))

    return smooth(track.x), smooth(track.y), smooth(track.latitude), smooth(track.longitude)


def _smooth_values(values: Array, sd: float) -> Array:
    """Smooth evenly spaced values by a Gaussian window. `sd`: sd of the window / spacing
    of the values.

    The window needs values beyond both ends of the series. They are made by reflection of
    the series in its end point, so that a straight line stays straight up to its end."""
    wide = min(int(4 * sd) + 1, len(values) - 1)
    padded = np.pad(values, wide, mode="reflect", reflect_type="odd")
    return gaussian_filter1d(padded, sd)[wide : len(values) + wide]


def _compute_track_curvature(track: Track, way: Array) -> Array:
    """Return the curvature [1/m] of the path of a log, smoothed over SMOOTH_DISTANCE, at
    the travelled distances `way` [m]."""
    rolls = np.diff(track.travelled, prepend=-1.0) > 0
    fine = np.arange(0.0, track.travelled[-1], PLACE_STEP)
    heading = np.interp(fine, track.travelled[rolls], track.heading[rolls])
    curvature = gaussian_filter1d(
        np.gradient(heading, PLACE_STEP), SMOOTH_DISTANCE / PLACE_STEP, mode="nearest"
    )
    return np.interp(way, fine, curvature)


# ---- Circuits


def _find_round(road: Road) -> tuple[int, int] | None:
    """Return the indices of the first and the last place of the first round. Return None
    if the road is no circuit.

    At the end of a round, the path reaches the beginning of the round again, in the same
    direction.

    If the road has positions, places every 10 m up to MAX_PIT_LANE are tried as the
    beginning. The first place to which the path returns is taken: the path comes within
    MAX_OFF_ROAD of this place again, more than MIN_ROUND later. The round ends where the
    path is nearest to the beginning during this first return.

    Without positions, the round begins at the first place. Its length L is the first one
    above MIN_ROUND that meets two conditions: the curvature of the path and the same
    curvature shifted by L correlate (MIN_ALIKE), and the path computed from the curvature
    returns after L to within MAX_CLOSURE x L of its beginning. Of the place at L and the
    next 9 places, the round ends at the one where the correlation is highest.
    """
    s = road.distance
    if road.x is not None:
        points = _add_direction(road.x, road.y)
        for begin in np.searchsorted(s, np.arange(0.0, min(MAX_PIT_LANE, s[-1]), 10.0)):
            apart = np.linalg.norm(points - points[begin], axis=1)
            again = np.flatnonzero((apart < MAX_OFF_ROAD) & (s > s[begin] + MIN_ROUND))
            if len(again):
                first = again[: int(np.argmax(np.diff(again, append=len(s) + 2) > 1)) + 1]
                return int(begin), int(first[np.argmin(apart[first])])
        return None
    heading = np.cumsum(road.curvature * np.gradient(s))
    x, y = (np.cumsum(f(heading) * np.gradient(s)) for f in (np.cos, np.sin))
    alike = np.zeros(len(s))
    for lag in range(int(np.searchsorted(s, MIN_ROUND)), len(s) - int(np.searchsorted(s, MIN_ROUND))):
        back = np.hypot(x[lag] - x[0], y[lag] - y[0]) < MAX_CLOSURE * s[lag]
        alike[lag] = _correlate(road.curvature[: len(s) - lag], road.curvature[lag:]) if back else 0.0
    end = int(np.argmax(alike > MIN_ALIKE))
    if not alike[end] > MIN_ALIKE:
        return None
    end += int(np.argmax(alike[end : end + 10]))
    return 0, end


def _correlate(a: Array, b: Array) -> float:
    """Return the correlation of two curvatures, without subtracting their means."""
    size = float(np.sqrt(np.sum(a**2) * np.sum(b**2)))
    return float(np.sum(a * b)) / size if size > 0 else 0.0


# ---- Matching by position


def _add_direction(x: Array, y: Array) -> Array:
    """Return (n, 4): x and y of the points of a path, and its direction as a vector.

    The vector is scaled so that two points at the same position with opposite directions
    are DIRECTION_DISTANCE apart in these four coordinates.
    """
    dx, dy = np.gradient(x), np.gradient(y)
    size = np.maximum(np.hypot(dx, dy), 1e-9)
    return np.column_stack([x, y, 0.5 * DIRECTION_DISTANCE * dx / size, 0.5 * DIRECTION_DISTANCE * dy / size])


def _match_track(road: Road, track: Track, name: str) -> tuple[Array, str]:
    """Return the distance along the road of each row, and the method (GNSS or PATH).

    The distance is NaN off the road. `name`: name of the log in error messages."""
    if track.latitude is not None and road.latitude is not None:
        x, y = to_local(track.latitude, track.longitude, road.origin)
        start = to_local(road.latitude, road.longitude, road.origin)
        found = match_by_position(start[0], start[1], road.distance, x, y, track.travelled)
        if not np.isfinite(found).any():
            raise UserError(
                f"{name}: is not on the road {road.path}: the car was never within {MAX_OFF_ROAD:g} m of the "
                "road and driving in the direction of the road"
            )
        return found, GNSS
    if track.latitude is None and track.x is not None and road.latitude is None and road.x is not None:
        found = match_by_position(road.x, road.y, road.distance, track.x, track.y, track.travelled)
        if np.isfinite(found).any():  # else x and y of log and road may have different origins
            return found, GNSS
    return match_by_path(road, track, name), PATH


def match_by_position(
    x: Array, y: Array, distance: Array, at_x: Array, at_y: Array, travelled: Array
) -> Array:
    """Return the distance along a path for each position of a log.

    Parameters
    ----------
    x, y, distance
        (n,) [m] points of the path, and their distances along the path.
    at_x, at_y
        (m,) [m] positions of the log in the same frame. NaN: unknown.
    travelled
        (m,) [m] travelled distance at each position, from the wheel speeds. The positions
        are interpolated at travelled distances 1 m apart and smoothed. The direction of
        driving is the direction of the line through the smoothed positions.

    Returns
    -------
    (m,) [m]. NaN: the position is further than MAX_OFF_ROAD from the path, or the car
    drives in the opposite direction.
    """
    known = np.isfinite(at_x) & np.isfinite(at_y)
    rolled = np.flatnonzero(known & (np.diff(travelled, prepend=-1.0) > 0))
    if len(rolled) < 4:
        return np.full(len(at_x), np.nan)
    fine = np.append(np.arange(distance[0], distance[-1], 1.0), distance[-1])
    path_x, path_y = np.interp(fine, distance, x), np.interp(fine, distance, y)
    tree = cKDTree(_add_direction(path_x, path_y))
    way = np.arange(0.0, travelled[-1], 1.0)
    smooth_x, smooth_y = (
        _smooth_values(np.interp(way, travelled[rolled], p[rolled]), PLACE_STEP) for p in (at_x, at_y)
    )
    apart, near = tree.query(_add_direction(smooth_x, smooth_y), distance_upper_bound=MAX_OFF_ROAD)
    on = np.isfinite(apart)
    near = np.where(on, near, 0)
    tangent = np.column_stack([np.gradient(path_x), np.gradient(path_y)])[near]
    off = np.column_stack([smooth_x - path_x[near], smooth_y - path_y[near]])
    length = np.maximum(np.sum(tangent**2, axis=1), 1e-9)
    s = fine[near] + np.clip(np.sum(off * tangent, axis=1) / length, -1.0, 1.0)
    s = np.clip(np.where(on, s, np.nan), distance[0], distance[-1])
    return _interpolate_places(way, s, travelled)


def _interpolate_places(way: Array, s: Array, at: Array) -> Array:
    """Convert travelled distances `at` to distances along a road.

    `s`: distances along the road at the travelled distances `way`. Between two values of
    `way`, s is interpolated linearly. But if s changes there by at least 5 times as much
    as `way`, or if one of the two s is NaN, the s at the nearest `way` is used."""
    i = np.clip(np.searchsorted(way, at, side="right") - 1, 0, len(way) - 2)
    share = (at - way[i]) / (way[i + 1] - way[i])
    step = s[i + 1] - s[i]
    jumps = ~(np.abs(step) < 5 * (way[i + 1] - way[i]))
    return np.where(jumps, np.where(share < 0.5, s[i], s[i + 1]), s[i] + share * step)


# ---- Matching by path


def match_by_path(road: Road, track: Track, name: str = "the log") -> Array:
    """Return the distance along the road of every row, by curvature only.

    NaN: off the road. In a circuit, the distance increases from round to round.

    Raises
    ------
    UserError
        No part of the log matches the road. The message states the reason.
    """
    step = max(PLACE_STEP, road.length / MAX_PLACES)
    places = road.distance[0] + step * np.arange(max(int(road.length / step), 2))
    its = _smooth_curvature(road, places, step)
    way = np.arange(0.0, float(track.travelled[-1]) + step, step)
    turn = _compute_track_curvature(track, way)
    scale = float(np.sqrt(np.mean(its**2)))
    if np.sum(np.abs(its)) * step < MIN_TURN:
        raise UserError(
            f"{name}: cannot be aligned with {road.path}: the road turns by less than {MIN_TURN:g} rad, "
            "too little to find places by the bends; use a log and a road with GNSS positions"
        )
    sd = max(ALIKE_SD * scale, MIN_ALIKE_SD)
    place = _accept_stretches(run_viterbi(its, turn, sd, road.is_closed), its, turn, step)
    stretch = _estimate_stretch(place, road.is_closed)
    # If the wheel radius is wrong, the places advance by 0 or 2 in many steps, each of
    # which has a cost: correct the travelled distance, and match again.
    if abs(stretch - 1.0) > MAX_STRETCH:
        track = replace(track, travelled=stretch * track.travelled)
        way = np.arange(0.0, float(track.travelled[-1]) + step, step)
        turn = _compute_track_curvature(track, way)
        place = _accept_stretches(run_viterbi(its, turn, sd, road.is_closed), its, turn, step)
    if not (place >= 0).any():
        raise UserError(
            f"{name}: cannot be aligned with {road.path}: the bends of the log match those of the road "
            "nowhere over a sufficient length; the car drove on a different road, in the opposite direction, "
            "or not far enough"
        )
    if _is_ambiguous(place, its, turn, step, road.is_closed):
        raise UserError(
            f"{name}: cannot be aligned with {road.path}: the bends of the log match several parts of the "
            "road, as in a slalom, so its place is ambiguous; use a log and a road with GNSS positions"
        )
    s = road.distance[0] + _refine_places(place, its, turn, step, road.is_closed)
    return _interpolate_places(way, s, track.travelled)


def _find_road_stretches(place: npt.NDArray[np.int64]) -> list[tuple[int, int]]:
    """Return the parts of a log in which the car is on the road without interruption.

    `place`: place on the road in each step of the log; -1: off the road. Each part is
    returned as (index of its first step, index of its last step + 1)."""
    edges = np.flatnonzero(np.diff((place >= 0).astype(int), prepend=0, append=0))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _estimate_stretch(place: npt.NDArray[np.int64], is_closed: bool) -> float:
    """Return the stretch factor: distance along the road / distance from wheel speeds.

    Places on the road and steps of the log have the same spacing. So the factor is the
    mean number of places by which the car moves on in a step. Return 1 if no part of the
    log is on the road."""
    steps = np.concatenate([np.diff(place[b:e]) for b, e in _find_road_stretches(place)] or [np.ones(1)])
    steps = steps[steps >= 0] if is_closed else steps  # < 0: the index restarts at 0 in a new round
    return float(np.mean(steps))


def _smooth_curvature(road: Road, places: Array, step: float) -> Array:
    """Return the curvature [1/m] of a road, smoothed over SMOOTH_DISTANCE.

    `places`: [m] distances along the road at which it is returned, `step` [m] apart."""
    mode = "wrap" if road.is_closed else "nearest"
    return gaussian_filter1d(road.interpolate("curvature", places), SMOOTH_DISTANCE / step, mode=mode)


def run_viterbi(its: Array, turn: Array, sd: float, is_closed: bool) -> npt.NDArray[np.int64]:
    """Return the most probable sequence of places on a road for the steps of a log.

    Parameters
    ----------
    its
        (N,) 1/m, curvature of the road at its places.
    turn
        (M,) 1/m, curvature of the log. The travelled distance from one value to the next
        equals the distance between two places of the road.
    sd
        1/m, sd of the difference of the two curvatures while the car is on the road.
    is_closed
        True: the first place follows the last one.

    Returns
    -------
    (M,) int, index of the place, 0 .. N - 1. -1: off the road.

    Notes
    -----
    Time O(M N), memory M N bytes.
    """
    n, steps = len(its), len(turn)
    # came[i, p]: code of the most probable predecessor of place p in step i. 0: place p,
    # 1: place p - 1, 2: place p - 2, 3: the state "elsewhere" (off the road). came[i, n]:
    # the same for the state "elsewhere" in step i. 0: "elsewhere", 1: the place left[i].
    came = np.zeros((steps, n + 1), np.int8)
    # left[i] is the place from which the car leaves the road, if it leaves it in step i
    left = np.zeros(steps, np.int64)
    cost = np.full(n + 1, TURN_OFF_COST)
    cost[n] = 0.0
    options = np.empty((4, n))
    rows = np.arange(n)
    for i in range(steps):
        on = cost[:n]
        for k, price in ((0, SLIP_COST), (1, 0.0), (2, SLIP_COST)):
            options[k] = np.roll(on, k) + price
            if not is_closed:
                options[k, :k] = np.inf
        options[3] = cost[n] + TURN_OFF_COST
        best = np.argmin(options, axis=0)
        away = int(np.argmin(on))
        goes = on[away] + TURN_OFF_COST < cost[n]
        new = np.empty(n + 1)
        new[:n] = options[best, rows] + 0.5 * np.minimum(((turn[i] - its) / sd) ** 2, MAX_SQUARED_ERROR)
        new[n] = min(on[away] + TURN_OFF_COST, cost[n]) + ELSEWHERE_COST
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


def _accept_stretches(
    place: npt.NDArray[np.int64], its: Array, turn: Array, step: float
) -> npt.NDArray[np.int64]:
    """Return the places, with -1 in stretches of low correlation or little turning.

    Turning is the integral of |curvature|. A stretch is accepted if the correlation of
    the curvatures of log and road exceeds MIN_ALIKE, and the turning of the road over the
    stretch exceeds max(MIN_TURN, min(SURE_TURN, SURE_SHARE x turning of the whole road,
    SURE_SHARE x turning of the whole log)). `its`: [1/m] curvature of the road at its
    places. `turn`: [1/m] curvature of the log at its steps. `step`: [m] spacing of places
    and of steps."""
    whole = SURE_SHARE * step * min(float(np.sum(np.abs(its))), float(np.sum(np.abs(turn))))
    min_turn = max(MIN_TURN, min(SURE_TURN, whole))
    out = np.full(len(place), -1)
    for begin, end in _find_road_stretches(place):
        part = place[begin:end]
        if _correlate(its[part], turn[begin:end]) > MIN_ALIKE and np.sum(np.abs(its[part])) * step > min_turn:
            out[begin:end] = part
    return out


def _is_ambiguous(
    place: npt.NDArray[np.int64], its: Array, turn: Array, step: float, is_closed: bool
) -> bool:
    """Return whether the longest stretch also matches a different part of the road.

    The part of the road on which the stretch was found is shifted along the road, by at
    least MIN_ROUND. The stretch matches a shifted part if it correlates with it better
    than with the original part, or worse by less than SAME_ALIKE. `its`, `turn`, `step`:
    as in _accept_stretches()."""
    begin, end = max(_find_road_stretches(place), key=lambda s: s[1] - s[0])
    part, mine = place[begin:end], turn[begin:end]
    min_alike = _correlate(its[part], mine) - SAME_ALIKE
    n, first = len(its), int(MIN_ROUND / step)
    for shift in range(first, n - first) if is_closed else (*range(-n, 1 - first), *range(first, n)):
        there = part + shift
        inside = slice(None) if is_closed else (there >= 0) & (there < n)
        at = np.mod(there, n)[inside]
        if len(at) > SURE_SHARE * len(part) and _correlate(its[at], mine[inside]) > min_alike:
            return True
    return False


def _refine_places(
    place: npt.NDArray[np.int64], its: Array, turn: Array, step: float, is_closed: bool
) -> Array:
    """Return the distance [m] along the road from place 0 for each step of the log. It is
    more accurate than step * place. NaN: off the road.

    The offset, i.e. the distance along the road minus the travelled distance, changes
    slowly, because it is due to a wrong wheel radius and to the lane. So the offset is
    taken as constant within a Gaussian window (DRIFT_WINDOW) about each place. Three
    Gauss-Newton steps estimate the offset at which the curvature of the log fits the
    curvature of the road best (Lucas and Kanade, IJCAI (1981) 674). Places are weighted
    by the square of the derivative of the curvature with respect to distance, since the
    offset is observable only where the curvature changes.
    """
    n, window = len(its), DRIFT_WINDOW / step
    slope = np.gradient(np.concatenate([its[-2:], its, its[:2]]) if is_closed else its, step)
    slope = slope[2:-2] if is_closed else slope
    floor = 0.01 * float(np.mean(slope**2)) + 1e-30
    s = np.full(len(place), np.nan)
    for begin, end in _find_road_stretches(place):
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
            period = n if is_closed else None
            there, its_slope = (np.interp(at, np.arange(n), c, period=period) for c in (its, slope))
            push = gaussian_filter1d(its_slope * (mine - there), window, mode="nearest")
            square = gaussian_filter1d(its_slope**2, window, mode="nearest")
            offset += np.clip(push / (square + floor), -step, step)
        s[begin:end] = way + offset
    if is_closed:
        return s
    return np.where((s < -step) | (s > n * step), np.nan, np.clip(s, 0.0, (n - 1) * step))
