"""Do the channels of a log agree with each other? What physics wants of them, under every unit that may have been taken for
another: where a wrong unit, sign or axis explains the log better than none, the run says so, with the factor."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from tse.car.vehicle import Vehicle, make_default_vehicle
from tse.channels import physics
from tse.channels.log import read_log
from tse.channels.raster import resample
from tse.library.core import Config
from tse.library.errors import UserError
from tse.log.rows import TORQUES, Log, Reading, liveliest

# sd of the logarithm of what is left when all is right: a_y feels roll and roads that lean into their bends (0.91 .. 1.10 on the
# cars of
# tests/cars and the real logs); a_x pitch and grade; the steering compliance and a ratio that is not quite known
SD = {"accel_y": 0.10, "accel_x": 0.10, "steer_angle": 0.08, "track": 0.04, "speed": 0.02}
UNKNOWN_TRACK, UNKNOWN_TRACK_SD = 1.53, 0.09  # m: passenger cars, when the vehicle file does not say
PRICE = 6.0  # squared sd that a cause must explain, before it is spoken of: right logs are the rule
WRONG_SIGN = 60.0  # squared sd of a sign that is wrong
VANISHED = 30.0  # squared sd of a figure that one unit shows and another does not: at another speed the car would not move
ENOUGH = {
    "accel_y": 0.9,
    "accel_x": 0.8,
    "steer_angle": 0.85,
}  # correlation, or its square, from which a figure counts
# below ENOUGH a figure counts, too, where another speed that is tried shows it: there other rows are those of a car that moves.
# A real log had 0.898 of accel_y at its own speed and 0.913 at 0.85 of it, and was said to be in km/h
SLACK = 0.05
ODD = 12.0  # the same of a factor that no unit has: PRICE, and that it could have been any, of 1/20 .. 20 with the accuracy of SD
WELL = 0.10  # what a cause leaves, to be said to explain
FAR = 0.35  # of a logarithm: what is further off is said even when nothing explains it
# of a logarithm, of the steering angle's figure: up to it a car that is braked in every bend may oversteer (0.48 of a neutral van),
# so that it is said and the log is read
HANDLING = 1.0
G = 9.80665
PERHAPS = "perhaps "  # before a cause that leaves more than WELL
USUAL_RATIO = 15.0  # of a steering, when nobody says


DEG = 180 / np.pi
# Units that are mixed up, of a channel: how many times too large it is then, to be multiplied by that power of the steering
# ratio; the unit, "" for a sign; in words. The page has these tables, too (docs/page/check.js).
CAUSES: tuple[tuple[str, float, int, str, str], ...] = (
    ("yaw_rate", DEG, 0, "deg/s", "yaw_rate is in deg/s (multiply by pi/180)"),
    ("steer_angle", DEG, 0, "deg", "steer_angle is in degrees (multiply by pi/180)"),
    ("steer_angle", 1.0, 1, "rad", "steer_angle is the steering-wheel angle (divide by the steering ratio)"),
    ("steer_angle", DEG, 1, "deg", "steer_angle is the steering-wheel angle in degrees"),
    ("accel_y", 1 / G, 0, "g", "accel_y is in g (multiply by 9.81)"),
    ("accel_x", 1 / G, 0, "g", "accel_x is in g (multiply by 9.81)"),
    ("steer_angle", -1.0, 0, "", "steer_angle is positive to the right (change its sign; left is positive)"),
    ("accel_y", -1.0, 0, "", "accel_y is positive to the right (change its sign; left is positive)"),
    ("yaw_rate", -1.0, 0, "", "yaw_rate is positive to the right (change its sign; left is positive)"),
    ("accel_x", -1.0, 0, "", "accel_x is positive to the rear (change its sign; forward is positive)"),
)
# The same of the wheel speeds, all four: a power of the wheels' radius. A diameter in its place doubles the speed.
WHEEL_CAUSES: tuple[tuple[float, int, str, str], ...] = (
    (3.6, 1, "km/h", "the wheel speeds are in km/h (divide by 3.6 and the wheel radius)"),
    (1.0, 1, "m/s", "the wheel speeds are in m/s (divide by the wheel radius)"),
    (60 / (2 * np.pi), 0, "rpm", "the wheel speeds are in rpm (multiply by 2 pi/60)"),
    (2.23694, 1, "mph", "the wheel speeds are in mph (multiply by 0.447, divide by the wheel radius)"),
    (2.0, 0, "", "wheel_radius_front and _rear are diameters (divide them by 2)"),
)
FIGURES = {
    "accel_y": "accel_y over speed x yaw_rate",
    "accel_x": "accel_x over the change of wheel speed x wheel radius",
    "steer_angle": "steer_angle over wheelbase x yaw_rate / speed, understeer taken out",
    "speed": "wheel speed x radius over vehicle_speed",
    "track_front": "right less left front wheel over yaw_rate x track",
    "track_rear": "right less left rear wheel over yaw_rate x track",
}


LEAST_STOOD, FALL = (
    0.5,
    10.0,
)  # s; m/s, in the rows before and after: a stop from 5 m/s in a row and a start to it
OFF_SPEED, FAST, HALF = 1.25, 5.0, 0.5  # of a measured velocity: 1; m/s: rows that count; s
GAINS, SLOWS = 0.7, -2.0  # m/s2: no car gains so much with its brakes on, nor slows so much with them off
OFF_TORQUE, TORQUE_CORR = (
    1.6,
    0.7,
)  # of the force by wheel torques over mass times accel_x; its correlation, to be believed
LEAST_SHARE = 0.25  # of the force, by one axle of two
TURNED = 0.2  # of the other axis, that both accelerometers read: sine of 12 degrees; 0.13 of right cars, and of one of the two
# m, by yaw rate, that front wheels roll faster than rear ones: no axle does, left and right do; share of it without what slip does
ASIDE, ASIDE_SHARE = (0.5, 2.0), 0.5
LATE_ACROSS = 0.1  # s; cars and logs whose IMU is where it should be have -0.06 .. 0.1
ROWS_SLOW, OFF_TIME = (
    20,
    3.0,
)  # rows further apart than the raster; factor of the change of speed over so many
ODD_PIECES = 0.2  # of the pieces of a log may contradict a mistake that is in all of it
PIECE = 20.0  # s: bends and changes of speed in it show a unit
MOST_ROWS = (
    1 << 19
)  # from which noise and units are found: 87 minutes at 100 Hz; a longer log is as its liveliest so many rows


@dataclass(frozen=True)
class Cause:
    """A wrong unit: a channel is `factor` times what it should be."""

    channel: str
    factor: float
    text: str


@dataclass(frozen=True)
class Figures:
    """Measured over expected, and the sd of its logarithm; only those that this log shows."""

    value: dict[str, float]
    sd: dict[str, float]
    sure: frozenset[str] = frozenset()  # by ENOUGH, not by SLACK less

    def only(self, names: Collection[str]) -> Figures:
        return Figures({n: x for n, x in self.value.items() if n in names}, self.sd, self.sure)


def read_agreeing(logs: Sequence[Path | Log], notes: list[str], reading: Reading) -> list[Log]:
    """Return the logs that can be read, or are, and whose channels agree: nothing is learnt of a car from others. One that is left
    out is a note. UserError: all are."""
    found: list[Log] = []
    refused: list[UserError] = []
    car = reading.car or make_default_vehicle()
    for given in logs:
        path = given.path if isinstance(given, Log) else given
        try:
            log = given if isinstance(given, Log) else read_log(given, reading=reading)
            against = check_car(liveliest(log, MOST_ROWS), car, Config.exact(car.values))
            if surely := sure(against):
                raise UserError(f"{path}: nothing is learnt from it: {'; '.join(surely)}")
            notes += [f"{path}: {text}" for text in against]
            found.append(log)
        except UserError as error:
            refused.append(error)
            notes.append(f"left out: {str(error).splitlines()[0]}")
    if refused and not found:
        raise refused[0]
    return found


def sure(warnings: Sequence[str]) -> list[str]:
    """Return of what check_car() says that which is no guess: roads that lean, or a tyre that fails, may look like a wrong unit."""
    return [text for text in warnings if PERHAPS not in text]


def check_car(log: Log, vehicle: Vehicle, config: Config) -> list[str]:
    """Return how the channels of a log of this car contradict each other: check_units() with its measures."""
    tracks = {a: float(t) for a in ("front", "rear") if (t := vehicle.facts.get(f"track_{a}"))}
    radii = config.wheel_radius_front, config.wheel_radius_rear
    return check_units(log, config.lf + config.lr, *radii, vehicle.steering_ratio, tracks, config.mass)


def late_across(log: Log, config: Config) -> list[str]:
    """Return that accel_y does not come when the car turns, but much later or earlier than the vehicle file says; [] if it does.

    It is speed times yaw rate and the change of the sideslip. Body roll, which comes later, is within LATE_ACROSS."""
    if len(log) < 50 or not log.sample_time:
        return []
    d = _smooth(log)
    v = 0.5 * (
        config.wheel_radius_front * d["wheel_speed_front"] + config.wheel_radius_rear * d["wheel_speed_rear"]
    )
    wheelbase = config.lf + config.lr
    slip = config.mass * config.lf / (config.cornering_stiffness_rear * wheelbase) * v**2
    across = v * d["yaw_rate"] + physics.derivative(
        (config.lr - slip + config.imu_lever_arm_x) * d["yaw_rate"]
    )
    late, sd = physics.lag(across, d["accel_y"], np.abs(v) > physics.MOVING)
    late -= config.accel_y_latency
    if not abs(late) - 3.0 * sd > LATE_ACROSS:
        return []
    return [
        f"check accel_y and yaw_rate: accel_y comes {abs(late) * 1e3:.0f} ms {'later' if late > 0 else 'earlier'} than the car "
        "turns: one of them is late or low-passed, or the IMU is far from the centre of gravity. Stiffness is wrong by it: "
        "calibrate, or state it in the vehicle file"
    ]


def check_units(
    log: Log,
    wheelbase: float,
    radius_front: float,
    radius_rear: float,
    ratio: float | None,
    tracks: Mapping[str, float] | None = None,
    mass: float | None = None,
) -> list[str]:
    """Warnings in plain words; empty when the channels agree or the log moves too little to tell. `tracks`: m, by "front",
    "rear"."""
    if len(log) < 50 or not log.sample_time:
        return []
    d = _smooth(log)
    radius = 0.5 * (radius_front + radius_rear)
    front, rear = radius_front * d["wheel_speed_front"], radius_rear * d["wheel_speed_rear"]
    apart = _axles(front, rear)
    swapped = _swapped(d, 0.5 * (front + rear))
    velocity = _velocity(log, radius_front, radius_rear)
    swapped = swapped or _turned(d, 0.5 * (front + rear))
    apart = apart or _aside(d, front, rear) or _time(log, radius)
    if swapped or apart or velocity:
        return [*apart, *swapped, *velocity]
    best: tuple[float, tuple[Cause, ...], Figures] | None = None
    plain: tuple[float, Figures] | None = None
    tried = []
    for wheels in (None, *_of_wheels(radius)):
        per = wheels.factor if wheels else 1.0
        tried.append(
            (
                wheels,
                _figures(
                    log, d, 0.5 * (front + rear) / per, wheelbase, tracks, per, (radius_front, radius_rear)
                ),
            )
        )
    shown = frozenset().union(*(f.sure for _, f in tried))
    tried = [(wheels, f.only(shown)) for wheels, f in tried]
    most = max(len(f.value) for _, f in tried)
    for wheels, figures in tried:
        for causes in _sets(ratio or USUAL_RATIO):
            lost = VANISHED * (most - len(figures.value))
            cost = _cost(figures, causes) + lost + PRICE * (len(causes) + (wheels is not None))
            if not causes and wheels is None:
                plain = cost, figures
            elif plain and len(figures.value) < len(plain[1].value):
                continue  # at that speed the log says less: no explanation of what it says
            if best is None or cost < best[0]:
                best = cost, (*((wheels,) if wheels else ()), *causes), figures
    pedals = _pedals(d, 0.5 * (front + rear), {"front": radius_front, "rear": radius_rear}, mass)
    if best is None or plain is None or not plain[1].value:
        return pedals
    _, causes, after = best
    if causes and best[0] < _of_any_factor(plain[1]):
        if not _throughout(
            log, d, 0.5 * (front + rear), wheelbase, tracks, (radius_front, radius_rear), causes
        ):
            return pedals  # of a stretch, in which the car slides: no unit changes on the road
        return [_words(causes, plain[1], _left(after, causes))]
    return pedals + [
        f"check the units: {FIGURES[name]} is {x:.3g} times what is expected, about 1 is; no unit that is often mixed up explains "
        f"it{_otherwise(name, x)}"
        for name, x in plain[1].value.items()
        if abs(np.log(abs(x))) > FAR + 2 * plain[1].sd[name]
    ]


def _throughout(
    log: Log, d: Mapping[str, np.ndarray], v: np.ndarray, wheelbase: float, tracks: Mapping[str, float] | None,
    radii: tuple[float, float], causes: tuple[Cause, ...],
) -> bool:  # fmt: skip
    """Return whether causes explain the log better than none in nearly all of its pieces that show anything of them.

    A wrong unit or sign is so in all of them; a car that slides, or drives on ice, in some."""
    per = next((c.factor for c in causes if c.channel == "wheel_speed"), 1.0)
    others = tuple(c for c in causes if c.channel != "wheel_speed")
    count = round(PIECE * physics.RATE)
    with_it = without = 0.0
    for first in range(0, len(v) - count // 2, count):
        part = {name: x[first : first + count] for name, x in d.items()}
        plain, other = (
            _figures(log, part, v[first : first + count] / by, wheelbase, tracks, by, radii)
            for by in (1.0, per)
        )
        shared = {n for n in plain.value if n in other.value and not n.startswith("track")}
        if not shared:
            continue
        costs = _cost(plain.only(shared), ()), _cost(other.only(shared), others)
        if abs(costs[0] - costs[1]) > PRICE:
            with_it += costs[1] < costs[0]
            without += costs[0] < costs[1]
    return without <= ODD_PIECES * (with_it + without)


def _otherwise(name: str, x: float) -> str:
    """What else a figure may be off by."""
    if name == "accel_x":
        return f": time, if its steps are {x:.3g} times the true ones"
    if name != "steer_angle":
        return ""
    braking = f", or {PERHAPS}braking in bends" if abs(np.log(abs(x))) < HANDLING else ""
    return f", a wrong steering ratio or wheelbase does{braking}"


def _of_any_factor(figures: Figures) -> float:
    """What it costs that one channel is off by a factor that no unit has: the best one."""
    costs = []
    for channel in ("yaw_rate", "accel_y", "accel_x", "steer_angle"):
        turned = _left(figures, (Cause(channel, np.e, ""),))  # which figures go with it, and which against it
        log = {n: np.log(abs(x)) for n, x in figures.value.items() if abs(turned[n] / x - 1) > 1e-9}
        if log:
            power = {n: np.log(abs(turned[n] / figures.value[n])) for n in log}
            weight = {n: 1.0 / figures.sd[n] ** 2 for n in log}
            best = -sum(weight[n] * power[n] * log[n] for n in log) / sum(
                weight[n] * power[n] ** 2 for n in log
            )
            costs += [_cost(figures, (Cause(channel, sign * float(np.exp(best)), ""),)) for sign in (1, -1)]
    return ODD + min(costs, default=np.inf)


def stood(log: Log, radius_front: float, radius_rear: float, hold_speed: float) -> list[str]:
    """Return when the wheels of both axles read as good as 0 while the car drove: from one row to the next they stop, and they turn
    again as suddenly. Two such steps that together are more than FALL are nothing that brakes and engines do."""
    speed = np.maximum(
        np.abs(radius_front * log.data["wheel_speed_front"].to_numpy(float)),
        np.abs(radius_rear * log.data["wheel_speed_rear"].to_numpy(float)),
    )
    rows = np.flatnonzero(np.isfinite(speed))
    still = speed[rows] < hold_speed
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(np.int8), [0]])))
    found = []
    for first, after in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        start, end = float(log.time[rows[first]]), float(log.time[rows[after - 1]])
        before, then = (float(speed[rows[i]]) if 0 <= i < len(rows) else 0.0 for i in (first - 1, after))
        if end - start >= LEAST_STOOD and before + then > FALL:
            found.append((start, end, before, then))
    if not found:
        return []
    start, end, before, then = found[0]
    often = "" if len(found) == 1 else f"{len(found)} times, first "
    return [
        f"both wheel speeds are 0 {often}from {start:.2f} to {end:.2f} s, while the car drove ({before:.3g} m/s in the row before, "
        f"{then:.3g} in the row after): not valid there"
    ]


def _velocity(log: Log, radius_front: float, radius_rear: float) -> list[str]:
    """Return in what a measured velocity contradicts the wheels, and its change the lateral acceleration; [] where it does not.

    Speed along is that of the wheels within OFF_SPEED, since slip and radii are a few percent. Speed across changes by
    accel_y - v r, but for the road's bank: over HALF a second the two go together, and where they go against each other the sign
    is wrong."""
    wheels = 0.5 * (radius_front * log.data["wheel_speed_front"] + radius_rear * log.data["wheel_speed_rear"])
    v = wheels.to_numpy(float)
    found = []
    for name in (n for n in ("ins_vel_x", "gnss_speed") if n in log.extra):
        x = log.extra[name].to_numpy(float)
        fast = np.isfinite(x) & (v > FAST)
        if (
            fast.sum() >= 50
            and not 1 / OFF_SPEED < (ratio := float(np.median(x[fast] / v[fast]))) < OFF_SPEED
        ):
            found.append(
                f"check the units: {name} is {ratio:.3g} times the speed of the wheels, about 1 is expected"
            )
    if "gnss_course" in log.extra:
        course, turned = log.extra["gnss_course"].to_numpy(float), log.data["yaw_rate"].to_numpy(float)
        heading = np.cumsum(np.nan_to_num(turned) * np.diff(log.time, prepend=log.time[0]))
        rows = np.flatnonzero(np.isfinite(course) & (v > FAST))
        n = max(1, round(HALF / float(np.median(np.diff(log.time[rows]))))) if len(rows) > 1 else 1
        first, last = rows[:-n], rows[n:]
        changes = np.column_stack(
            [np.angle(np.exp(1j * (course[last] - course[first]))), heading[last] - heading[first]]
        )
        changes = changes[log.time[last] - log.time[first] < 2 * HALF]
        if len(changes) >= 50 and changes.std(axis=0).min() > 0 and np.corrcoef(changes.T)[0, 1] < -0.5:
            found.append(
                "check the units: gnss_course turns against yaw_rate: a compass counts clockwise, it counts to the left"
            )
    if "ins_vel_y" in log.extra:
        y = log.extra["ins_vel_y"].to_numpy(float)
        rate = log.data["accel_y"].to_numpy(float) - v * log.data["yaw_rate"].to_numpy(float)
        step = np.diff(log.time, prepend=log.time[0])
        n = max(1, round(HALF / float(log.sample_time or HALF)))
        gained = np.cumsum(np.nan_to_num(rate) * step)
        changes = np.column_stack([y[n:] - y[:-n], gained[n:] - gained[:-n]])[v[n:] > FAST]
        changes = changes[np.isfinite(changes).all(axis=1)]
        if len(changes) >= 50 and changes.std(axis=0).min() > 0 and np.corrcoef(changes.T)[0, 1] < -0.5:
            found.append(
                "check the units: ins_vel_y changes against accel_y - speed x yaw_rate: is its sign that of left?"
            )
    return found


def _pedals(
    d: Mapping[str, np.ndarray], v: np.ndarray, radius: Mapping[str, float], mass: float | None
) -> list[str]:
    """Return in what a brake switch contradicts the change of the speed, and wheel torques mass times accel_x; [] if in nothing.

    Both feel the slope of the road and drag in one way. Of one axle's torque only rows that drive count: brakes are on both."""
    found, moving, rate = [], np.abs(v) > FAST, physics.derivative(v)
    if "brake" in d:
        loses = f"off in {{:.0f}} % of the rows in which it loses more than {-SLOWS:g} m/s2"
        for rows, on, words in (
            (rate > GAINS, True, "on in {:.0f} % of the rows in which the car gains speed"),
            (rate < SLOWS, False, loses),
        ):
            brake = d["brake"][moving & rows & np.isfinite(d["brake"])]
            share = float(np.mean((brake > 0.5) == on)) if len(brake) >= 50 else 0.0
            if share > 0.5:
                words = words.format(100 * share)
                found.append(f"check the units: brake is {words}: it is 1 while the car brakes, else 0")
    axles = [c for c in TORQUES if c in d]
    if axles and mass and "accel_x" in d:
        force = sum(d[c] / radius[c.rpartition("_")[2]] for c in axles) / mass
        both = len(axles) == 2
        f = physics.fit(d["accel_x"], force, moving & (both | (d["accel_x"] > 0.3)))
        least = 1 / OFF_TORQUE if both else LEAST_SHARE
        if abs(f.corr) > TORQUE_CORR and not least < f.slope < OFF_TORQUE:
            found.append(
                f"check the units: {' and '.join(axles)} make {f.slope:.3g} times the force of mass x accel_x (correlation "
                f"{f.corr:.2f}), about 1 is expected: torques of the wheels in N m, of both of an axle, negative while they brake"
            )
    return found


def _smooth(log: Log) -> dict[str, np.ndarray]:
    """The channels and GNSS on the raster of physics.py."""
    time = np.arange(log.time[0], log.time[-1], 1.0 / physics.RATE)
    columns = {name: log.data[name].to_numpy(float) for name in log.data}
    columns |= {
        c: log.extra[c].to_numpy(float) for c in ("vehicle_speed", "brake", *TORQUES) if c in log.extra
    }
    rate = 1.0 / max(log.sample_time or 0.01, 1e-3)
    found = {}
    for name, x in columns.items():
        good = np.isfinite(x)
        found[name] = physics.smoothed(resample(log.time[good], x[good], time, min(physics.RATE, rate)))
    return found


def _axles(front: np.ndarray, rear: np.ndarray) -> list[str]:
    a, b = (
        float(np.nanmedian(np.abs(x[np.abs(x) > physics.MOVING])))
        if (np.abs(x) > physics.MOVING).any()
        else 0.0
        for x in (front, rear)
    )
    if min(a, b) > 0 and not 0.8 < a / b < 1.25:
        return [
            f"check the units: front and rear wheels roll at {a:.3g} and {b:.3g} m/s; wheel_radius_* or one wheel speed is wrong"
        ]
    return []


def _swapped(d: Mapping[str, np.ndarray], v: np.ndarray) -> list[str]:
    """accel_x goes with v r, and accel_y does not."""
    moving = np.abs(v) > physics.MOVING
    turn = v * d["yaw_rate"]
    x, y = (physics.fit(turn, d[c], moving) for c in ("accel_x", "accel_y"))
    along = physics.fit(physics.derivative(v), d["accel_y"], moving)
    if (
        abs(x.corr) > ENOUGH["accel_y"]
        and abs(y.corr) < 0.5
        and (abs(along.corr) > 0.5 or y.rows == 0 or abs(y.corr) < 0.2)
    ):
        return [
            f"check the axes: accel_x goes with speed x yaw_rate (correlation {x.corr:.2f}, factor {x.slope:.3g}) and accel_y does "
            f"not ({y.corr:.2f}): accel_x and accel_y are swapped"
        ]
    return []


def _turned(d: Mapping[str, np.ndarray], v: np.ndarray) -> list[str]:
    """Each accelerometer reads what belongs to the other, in opposite ways."""
    turn, rate = v * d["yaw_rate"], physics.derivative(v)
    rows = (np.abs(v) > physics.MOVING) & np.isfinite(turn + rate + d["accel_x"] + d["accel_y"])
    if rows.sum() < physics.FEWEST:
        return []
    parts = np.column_stack([rate[rows], turn[rows], np.ones(rows.sum())])
    (_, x, _), (y, _, _) = (np.linalg.lstsq(parts, d[c][rows], rcond=None)[0] for c in ("accel_x", "accel_y"))
    if min(abs(x), abs(y)) < TURNED or x * y > 0:
        return []
    return [
        f"check the axes: accel_x has {x:.2g} of speed x yaw_rate in it and accel_y {y:.2g} of the change of the speed: the IMU is "
        f"turned about the vertical by {np.degrees(np.arcsin(np.clip((x - y) / 2, -1, 1))):.0f} degrees"
    ]


def _aside(d: Mapping[str, np.ndarray], front: np.ndarray, rear: np.ndarray) -> list[str]:
    """Wheels of one side roll faster in a bend to the other; those of one axle in any bend."""
    y, turn, slip = front - rear, d["yaw_rate"], rear * physics.derivative(rear)
    rows = (np.abs(front) > physics.MOVING) & np.isfinite(y + turn + slip)
    if rows.sum() < physics.FEWEST:
        return []
    v, across = rear[rows], np.abs(rear * turn)[rows]
    plain = [turn[rows], slip[rows], np.ones(rows.sum())]
    # radii of both axles differ, by wear, by the square of the speed, and by the load in bends
    for columns in (plain, [*plain, v, v**3, v * across]):
        parts = np.column_stack(columns)
        found = np.linalg.lstsq(parts, y[rows], rcond=None)[0]
        by = found[0] * float(np.std(turn[rows]))
        share = by**2 / (by**2 + float(np.var(y[rows] - parts @ found)) + 1e-12)
        if share < ASIDE_SHARE or not ASIDE[0] < abs(found[0]) < ASIDE[1]:
            return []
    return [
        f"check the wheels: front less rear wheel speed is {found[0]:.2g} m times yaw_rate, as left less "
        "right is: wheel_speed_front or _rear is of one side, or a left and a right wheel are one signal"
    ]


def _time(log: Log, radius: float) -> list[str]:
    """Rows that are far apart, by a time that may count them: what accel_x adds up to is the change of the speed."""
    step, n = float(log.sample_time or 0.0), ROWS_SLOW
    if step <= 1.0 / physics.RATE or len(log) < 10 * n:
        return []
    v = radius * log.data["wheel_speed_rear"].to_numpy(float)
    gained = np.cumsum(np.nan_to_num(log.data["accel_x"].to_numpy(float))) * step
    f = physics.fit(v[n:] - v[:-n], gained[n:] - gained[:-n], v[n:] > physics.MOVING)
    if f.corr < ENOUGH["accel_x"] or 1 / OFF_TIME < f.slope < OFF_TIME:
        return []
    return [
        f"check the units: accel_x over {n} rows, {step:.3g} s apart, adds up to {f.slope:.3g} times the change of the speed: is "
        "time in s, or does it count rows?"
    ]


def _of_wheels(radius: float) -> list[Cause]:
    return [Cause("wheel_speed", per * radius**power, text) for per, power, _, text in WHEEL_CAUSES]


def _sets(ratio: float) -> Iterator[tuple[Cause, ...]]:
    """None, one, or two causes at once, of different channels."""
    single = [Cause(channel, per * ratio**power, text) for channel, per, power, _, text in CAUSES]
    yield ()
    for cause in single:
        yield (cause,)
    for a, b in combinations(single, 2):
        if a.channel != b.channel or a.factor * b.factor < 0:
            yield a, b


def _figures(
    log: Log, d: Mapping[str, np.ndarray], v: np.ndarray, wheelbase: float, tracks: Mapping[str, float] | None, wheels: float,
    radii: tuple[float, float],
) -> Figures:  # fmt: skip
    """With the speed v, m/s."""
    value: dict[str, float] = {}
    sd: dict[str, float] = {}
    nearly: set[str] = set()
    moving = np.abs(v) > physics.MOVING
    for name, kinematic in (("accel_y", v * d["yaw_rate"]), ("accel_x", physics.derivative(v))):
        f = physics.fit(kinematic, d[name], moving)
        if abs(f.corr) > ENOUGH[name] - SLACK and np.nanstd(d[name][moving]) > 0.02:
            value[name], sd[name] = f.slope, float(np.hypot(SD[name], 1 - abs(f.corr)))
            nearly |= {name} if abs(f.corr) <= ENOUGH[name] else set()
    s = physics.steering(d["steer_angle"], v, d["yaw_rate"])
    if s is not None and s.share > ENOUGH["steer_angle"] - SLACK and s.per_curvature != 0:
        nearly |= {"steer_angle"} if s.share <= ENOUGH["steer_angle"] else set()
        value["steer_angle"], sd["steer_angle"] = (
            s.per_curvature / wheelbase,
            float(np.hypot(SD["steer_angle"], s.sd)),
        )
    for axle, radius in zip(("front", "rear"), radii, strict=True):
        per_turn = log.turn.get(f"wheel_speed_{axle}")
        if per_turn:
            given = (tracks or {}).get(axle)
            value[f"track_{axle}"] = per_turn * radius / wheels / (given or UNKNOWN_TRACK)
            sd[f"track_{axle}"] = SD["track"] if given else UNKNOWN_TRACK_SD
    if "vehicle_speed" in d:
        both = moving & (d["vehicle_speed"] > physics.MOVING)
        if both.sum() > physics.FEWEST:
            value["speed"], sd["speed"] = float(np.nanmedian((v / d["vehicle_speed"])[both])), SD["speed"]
    return Figures(value, sd, frozenset(value) - nearly)


def _left(figures: Figures, causes: tuple[Cause, ...]) -> dict[str, float]:
    """The figures, if these causes are put right. The wheels' has been in the speed already."""
    by = dict.fromkeys(("yaw_rate", "accel_y", "accel_x", "steer_angle"), 1.0)
    for cause in causes:
        if cause.channel in by:
            by[cause.channel] *= cause.factor
    # accel_y over v r; steer_angle v/r; wheels over r
    expected = {
        "accel_y": by["accel_y"] / by["yaw_rate"],
        "accel_x": by["accel_x"],
        "steer_angle": by["steer_angle"] / by["yaw_rate"],
    }
    expected |= {f"track_{a}": 1.0 / by["yaw_rate"] for a in ("front", "rear")} | {"speed": 1.0}
    return {name: x / expected[name] for name, x in figures.value.items()}


def _cost(figures: Figures, causes: tuple[Cause, ...]) -> float:
    left = _left(figures, causes)
    return sum(
        float(np.log(abs(x)) ** 2 / figures.sd[n] ** 2) + WRONG_SIGN * (x < 0) for n, x in left.items()
    )


def _words(causes: tuple[Cause, ...], before: Figures, after: Mapping[str, float]) -> str:
    """The figures that speak, before and after."""
    moved = [
        n
        for n in before.value
        if (n in after and abs(np.log(abs(before.value[n] / after[n]))) > 0.02)
        or before.value[n] * after.get(n, 1) < 0
    ]
    parts = [f"{FIGURES[n]} is {before.value[n]:.3g}, {after[n]:.3g} after" for n in moved if n in after]
    fits = all(abs(np.log(abs(after[n]))) < WELL + 0.05 for n in moved if n in after)
    text = " and ".join(c.text for c in causes)
    if not fits and "steer_angle" in before.value:
        text += f", or the steering ratio or the wheelbase is wrong by the factor {before.value['steer_angle']:.3g}"
    return (
        f"check the units: {'' if fits else PERHAPS}{text}; factor {', '.join(f'{c.factor:.3g}' for c in causes)}: "
        f"{'; '.join(parts)} (about 1 is expected)"
    )
