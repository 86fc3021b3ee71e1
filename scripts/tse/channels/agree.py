"""Check whether the channels of a log agree with each other.

Physics relates the channels of a car: a_y = v r, a_x = dv/dt and so on (v: speed, r: yaw
rate). Each relation gives a ratio of measured to expected values. The code calls these
ratios figures. All are about 1 if units, signs and axes are right. check_units() assumes
in turn each mistake of a unit or sign that is often made (the code calls it a cause), and
computes the ratios after correction of this mistake. If the corrected ratios are much
nearer to 1 than those of the channels as logged, it returns a warning with the factor.
"""

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
from tse.log.rows import TORQUE_COLUMNS, CheckedLog, Reading, select_liveliest

# [1] sd of ln(measured / expected) in logs with correct units. Keys: names of the ratios,
# as in the dict FIGURES below; but "track" is the sd of both track_front and track_rear
# if the vehicle file states the track. Reasons why the ratios are not exactly 1:
# - accel_y: body roll and bank of the road. The ratio was 0.91 .. 1.10 with the cars of
#   tests/cars and in real logs.
# - accel_x: pitch and grade.
# - steer_angle: steering compliance and an inexact steering ratio.
FIGURE_SD = {"accel_y": 0.10, "accel_x": 0.10, "steer_angle": 0.08, "track": 0.04, "speed": 0.02}
# [m] track of passenger cars, and [1] sd of its logarithm. Used if the vehicle file does
# not state the track.
UNKNOWN_TRACK, UNKNOWN_TRACK_SD = 1.53, 0.09
# Each assumed set of mistakes has a cost: the sum of (ln ratio / sd)^2 over the ratios
# corrected for these mistakes, plus the following costs. The set of min cost is chosen.

# [1] cost of each assumed mistake. A mistake is thus reported only if correcting it
# reduces the sum of (ln ratio / sd)^2 over the ratios by more than this cost. Most logs
# are correct, so a small reduction is probably chance.
CAUSE_PRICE = 6.0
SIGN_PRICE = 60.0  # [1] cost of a ratio with the wrong sign
# [1] cost of each ratio that cannot be computed with the assumed unit of the speed, but
# can be computed with a different unit. Reason: with some units, the car would hardly
# move, and no ratio could be computed. Such a unit would otherwise have the lowest cost.
LOST_FIGURE_PRICE = 30.0
# [1] A ratio is used only if the correlation of measured and expected values exceeds this
# limit. steer_angle: only if the curvature of the path (yaw rate / speed), with a term
# for understeer, explains more than this share of the variance of the steering angle.
MIN_FIT = {"accel_y": 0.9, "accel_x": 0.8, "steer_angle": 0.85}
# [1] If the correlation of a ratio exceeds MIN_FIT with one assumed unit of the wheel
# speeds, MIN_FIT - FIT_SLACK suffices with the other units. Otherwise, the costs of two
# units could be sums over different ratios. Example, a real log in rad/s: the correlation
# of accel_y was 0.898 with rad/s (ratio not used) and 0.913 with km/h (used), so km/h was
# reported by mistake.
FIT_SLACK = 0.05
# [1] Cost of correcting one channel by a fitted factor. A wrong unit is reported only if
# its total cost is below that of the best fitted factor. A fitted factor brings the
# ratios nearer to 1 even by chance, so it costs 6 more than a wrong unit (CAUSE_PRICE).
# The 6 is about 2 ln(range / (sd sqrt(2 pi))), the Occam factor of ln factor: uniform
# prior in -ln 20 .. ln 20 (range: ln 400), estimated with the sd 0.1.
FREE_FACTOR_PRICE = 12.0
# [1] The correction of a unit or sign changes some ratios. If one of them then still has
# |ln ratio| >= EXPLAINED + 0.05, the warning contains PERHAPS.
EXPLAINED = 0.10
# [1] If |ln ratio| of any ratio exceeds this plus 2 sd of ln ratio, there is a warning
# even if no wrong unit or sign explains the ratio.
MAX_UNEXPLAINED = 0.35
# [1] A wrong unit is not the only reason for a wrong ratio of the steering angle. A car
# that is always braked in bends may oversteer, which changes the ratio, too: |ln ratio|
# was 0.48 for a neutral van. If |ln ratio| is below this limit, the warning names braking
# in bends as a possible cause.
MAX_HANDLING = 1.0
STANDARD_GRAVITY = 9.80665  # m/s2
# A warning contains this word if the mistake that it names is not certain, e.g. if a
# ratio is still wrong after correction of this mistake.
PERHAPS = "perhaps "
USUAL_STEERING_RATIO = 15.0  # [1] used if the vehicle file states no steering ratio

DEG_PER_RAD = 180 / np.pi
# Mistakes of one channel: its logged values are factor x (steering ratio)^exponent times
# the true ones. Columns: channel; factor; exponent; unit of the logged values, or "" for
# a wrong sign; message.
# docs/page/check.js uses these tables, too.
CAUSES: tuple[tuple[str, float, int, str, str], ...] = (
    ("yaw_rate", DEG_PER_RAD, 0, "deg/s", "yaw_rate is in deg/s (multiply by pi/180)"),
    ("steer_angle", DEG_PER_RAD, 0, "deg", "steer_angle is in degrees (multiply by pi/180)"),
    ("steer_angle", 1.0, 1, "rad", "steer_angle is the steering-wheel angle (divide by the steering ratio)"),
    ("steer_angle", DEG_PER_RAD, 1, "deg", "steer_angle is the steering-wheel angle in degrees"),
    ("accel_y", 1 / STANDARD_GRAVITY, 0, "g", "accel_y is in g (multiply by 9.81)"),
    ("accel_x", 1 / STANDARD_GRAVITY, 0, "g", "accel_x is in g (multiply by 9.81)"),
    ("steer_angle", -1.0, 0, "", "steer_angle is positive to the right (change its sign; left is positive)"),
    ("accel_y", -1.0, 0, "", "accel_y is positive to the right (change its sign; left is positive)"),
    ("yaw_rate", -1.0, 0, "", "yaw_rate is positive to the right (change its sign; left is positive)"),
    ("accel_x", -1.0, 0, "", "accel_x is positive to the rear (change its sign; forward is positive)"),
)
# Mistakes of all four wheel speeds: the logged values are factor x radius^exponent times
# the true ones (radius of the wheel, m). Columns: factor; exponent; unit of the logged
# values; message. A diameter in place of the radius doubles the speed of the car.
WHEEL_CAUSES: tuple[tuple[float, int, str, str], ...] = (
    (3.6, 1, "km/h", "the wheel speeds are in km/h (divide by 3.6 and the wheel radius)"),
    (1.0, 1, "m/s", "the wheel speeds are in m/s (divide by the wheel radius)"),
    (60 / (2 * np.pi), 0, "rpm", "the wheel speeds are in rpm (multiply by 2 pi/60)"),
    (2.23694, 1, "mph", "the wheel speeds are in mph (multiply by 0.447, divide by the wheel radius)"),
    (2.0, 0, "", "wheel_radius_front and _rear are diameters (divide them by 2)"),
)
# key of each ratio -> its name in messages
FIGURES = {
    "accel_y": "accel_y / (speed x yaw_rate)",
    "accel_x": "accel_x / (rate of change of wheel speed x wheel radius)",
    "steer_angle": "steer_angle / (wheelbase x yaw_rate / speed), without understeer,",
    "speed": "(wheel speed x radius) / vehicle_speed",
    "track_front": "(right - left front wheel speed) / (yaw_rate x track)",
    "track_rear": "(right - left rear wheel speed) / (yaw_rate x track)",
}

# [s] Wheel speeds of 0 in a moving car are reported if they last at least this long.
MIN_FALSE_STOP = 0.5
# [m/s] Wheel speeds of 0 are reported if the speed in the row before them plus the speed
# in the row after them exceeds this.
MIN_FALSE_STEP = 10.0
# [1] There is a warning if the ratio of ins_vel_x or gnss_speed to the wheel speed [m/s]
# is not within 1 / MAX_SPEED_RATIO .. MAX_SPEED_RATIO (median over the log).
MAX_SPEED_RATIO = 1.25
MIN_VELOCITY = 5.0  # [m/s] slower rows are not compared
# [s] Interval over which the change of gnss_course is compared with that of the heading,
# and the change of ins_vel_y with the integral of accel_y - v r.
CHANGE_TIME = 0.5
DRIVING_GAIN = 0.7  # [m/s2] dv/dt above which the car does not brake
COASTING_LOSS = -2.0  # [m/s2] dv/dt below which the car brakes; a coasting car loses less
# [1] Max ratio of the force of the wheel torques to mass x accel_x without a warning. The
# min is 1 / MAX_FORCE_RATIO if both axles have torques, otherwise MIN_AXLE_SHARE.
MAX_FORCE_RATIO = 1.6
# [1] min correlation of accel_x with the force of the wheel torques, for a warning
MIN_TORQUE_CORR = 0.7
# [1] min ratio of the force of one axle to mass x accel_x, if only this axle has torques
MIN_AXLE_SHARE = 0.25
# [1] The IMU is taken as turned about its vertical axis if the cross-axis sensitivities
# of both accelerometers exceed this, the sine of 12 degrees. In correct logs, at most one
# of the two sensitivities deviates from 0, by up to 0.13.
MIN_IMU_TURN = 0.2
# Limits for a warning that the front channel contains the wheels of one side of the car
# and the rear channel those of the other side. front - rear wheel speed [m/s] is then
# track x yaw rate, or minus this product. SIDE_LEVER: [m] min and max of the magnitude of
# the fitted factor of the yaw rate. MIN_SIDE_SHARE: [1] min share that the yaw rate
# explains of the variance of front - rear speed. The part of this variance that slip
# explains is subtracted before.
SIDE_LEVER, MIN_SIDE_SHARE = (0.5, 2.0), 0.5
# [s] max magnitude of the delay of the measured accel_y behind the accel_y that follows
# from speed and yaw rate. There is a warning if the delay is larger by more than 3 sd. In
# logs with a correctly placed IMU, it is -0.06 .. 0.1. Body roll causes a part of it.
MAX_LATE_ACROSS = 0.1
# [rows] interval over which accel_x is integrated, to check the times of a log whose rows
# are further apart than 1 / COMPARISON_RATE
SLOW_ROWS = 20
# [1] There is a warning if the ratio of the integral of accel_x over SLOW_ROWS rows to
# the change of speed in these rows is not within 1 / MAX_TIME_RATIO .. MAX_TIME_RATIO.
MAX_TIME_RATIO = 3.0
# [1] A mistake that was found in the whole log is tested in each piece of the log. If its
# correction makes the ratios worse in a larger share of the pieces than this, the mistake
# is not reported.
MAX_ODD_SHARE = 0.2
# [s] length of the pieces into which a log is divided, to test whether a mistake affects
# all of it. A piece must be long enough to contain bends and changes of speed.
COMPARED_PIECE_TIME = 20.0
# [rows] max length of a log that is checked as a whole: 87 minutes at 100 Hz. Of a longer
# log, noise and units are determined from the part of this length with the most motion.
MAX_CHECKED_ROWS = 1 << 19


@dataclass(frozen=True)
class Cause:
    """A wrong unit or sign: the logged channel is `factor` times its true value."""

    channel: str
    factor: float
    text: str  # message


@dataclass(frozen=True)
class Figures:
    """Ratios of measured to expected values of a log. Keys: names in FIGURES."""

    value: dict[str, float]
    sd: dict[str, float]  # [1] name -> sd of the logarithm of the ratio
    # Names of the ratios in `value` whose correlation (steer_angle: explained share)
    # exceeds MIN_FIT, or to which no MIN_FIT applies. The correlation of the other ratios
    # only exceeds MIN_FIT - FIT_SLACK.
    sure: frozenset[str] = frozenset()

    def select(self, names: Collection[str]) -> Figures:
        """Return a copy that has only the ratios with these names."""
        return Figures({n: x for n, x in self.value.items() if n in names}, self.sd, self.sure)


def read_agreeing(logs: Sequence[Path | CheckedLog], notes: list[str], reading: Reading) -> list[CheckedLog]:
    """Read logs and return those whose channels agree. Only these logs may be used to
    calibrate a car.

    Parameters
    ----------
    logs : sequence of Path or CheckedLog
        Logs in memory, or paths of files to read.
    notes : list of str
        The function appends the warnings of each log, and the reason why a log is left
        out.
    reading : Reading
        Options of reading. Its member `car` is the car; None: the default car.

    Raises
    ------
    UserError
        No log can be used. The message is the reason for the first log.
    """
    found: list[CheckedLog] = []
    refused: list[UserError] = []
    car = reading.car or make_default_vehicle()
    for given in logs:
        path = given.path if isinstance(given, CheckedLog) else given
        try:
            log = given if isinstance(given, CheckedLog) else read_log(given, reading=reading)
            against = check_car(select_liveliest(log, MAX_CHECKED_ROWS), car, Config.exact(car.values))
            if surely := select_certain(against):
                raise UserError(f"{path}: channels contradict each other: {'; '.join(surely)}")
            notes += [f"{path}: {text}" for text in against]
            found.append(log)
        except UserError as error:
            refused.append(error)
            notes.append(f"left out: {str(error).splitlines()[0]}")
    if refused and not found:
        raise refused[0]
    return found


def select_certain(warnings: Sequence[str]) -> list[str]:
    """Return the warnings of check_car() that are certain, i.e. do not contain PERHAPS.

    A banked road or a failing tyre can have the same effect on the channels as a wrong
    unit. Warnings that allow for this contain PERHAPS."""
    return [text for text in warnings if PERHAPS not in text]


def check_car(log: CheckedLog, vehicle: Vehicle, config: Config) -> list[str]:
    """Return the warnings of check_units() for a log, with the dimensions of its car."""
    tracks = {a: float(t) for a in ("front", "rear") if (t := vehicle.facts.get(f"track_{a}"))}
    radii = config.wheel_radius_front, config.wheel_radius_rear
    return check_units(log, config.lf + config.lr, *radii, vehicle.steering_ratio, tracks, config.mass)


def check_lateral_delay(log: CheckedLog, config: Config) -> list[str]:
    """Return a warning if accel_y is too late or too early for the yaw rate; [] if not.

    The expected accel_y is v r plus the derivative of the lateral velocity, both computed
    from speed and yaw rate. The delay of the measured behind the expected accel_y is
    estimated, and the latency of accel_y in the vehicle file is subtracted from this
    delay. The rest may be up to MAX_LATE_ACROSS, because of body roll. There is a warning
    if the magnitude of the rest exceeds MAX_LATE_ACROSS by more than 3 sd."""
    if len(log) < 50 or not log.sample_time:
        return []
    d = _smooth_channels(log)
    v = 0.5 * (
        config.wheel_radius_front * d["wheel_speed_front"] + config.wheel_radius_rear * d["wheel_speed_rear"]
    )
    wheelbase = config.lf + config.lr
    slip = config.mass * config.lf / (config.cornering_stiffness_rear * wheelbase) * v**2
    across = v * d["yaw_rate"] + physics.differentiate(
        (config.lr - slip + config.imu_lever_arm_x) * d["yaw_rate"]
    )
    late, sd = physics.find_lag(across, d["accel_y"], np.abs(v) > physics.MOVING_SPEED)
    late -= config.accel_y_latency
    if not abs(late) - 3.0 * sd > MAX_LATE_ACROSS:
        return []
    return [
        f"check accel_y and yaw_rate: accel_y is {abs(late) * 1e3:.0f} ms "
        f"{'later' if late > 0 else 'earlier'} than speed and yaw_rate predict: accel_y or yaw_rate is "
        "delayed or low-passed, or the IMU is far from the centre of gravity. The estimated stiffness is "
        "therefore wrong: calibrate, or state the delay in the vehicle file"
    ]


def check_units(
    log: CheckedLog,
    wheelbase: float,
    radius_front: float,
    radius_rear: float,
    ratio: float | None,
    tracks: Mapping[str, float] | None = None,
    mass: float | None = None,
) -> list[str]:
    """Return warnings about units, signs and axes.

    Parameters
    ----------
    log : CheckedLog
        The log.
    wheelbase : float
        [m] Wheelbase.
    radius_front, radius_rear : float
        [m] Radii of the wheels.
    ratio : float or None
        Steering ratio. None: unknown, USUAL_STEERING_RATIO is assumed.
    tracks : mapping of str to float, optional
        [m] Track of the axles "front" and "rear". UNKNOWN_TRACK is assumed for an axle
        without a value, and for both axles if None.
    mass : float, optional
        Mass of the car, kg. None: wheel torques are not checked.

    Returns
    -------
    list of str
        Warnings. Empty if the channels agree, or if the log has too little motion for a
        test.
    """
    if len(log) < 50 or not log.sample_time:
        return []
    d = _smooth_channels(log)
    radius = 0.5 * (radius_front + radius_rear)
    front, rear = radius_front * d["wheel_speed_front"], radius_rear * d["wheel_speed_rear"]
    apart = _check_axles(front, rear)
    swapped = _check_swapped_axes(d, 0.5 * (front + rear))
    velocity = _check_velocity(log, radius_front, radius_rear)
    swapped = swapped or _check_turned_imu(d, 0.5 * (front + rear))
    apart = apart or _check_mixed_sides(d, front, rear) or _check_time(log, radius)
    if swapped or apart or velocity:
        return [*apart, *swapped, *velocity]
    best: tuple[float, tuple[Cause, ...], Figures] | None = None
    plain: tuple[float, Figures] | None = None
    tried = []
    for wheels in (None, *_list_wheel_causes(radius)):
        per = wheels.factor if wheels else 1.0
        tried.append(
            (
                wheels,
                _compute_figures(
                    log, d, 0.5 * (front + rear) / per, wheelbase, tracks, per, (radius_front, radius_rear)
                ),
            )
        )
    shown = frozenset().union(*(f.sure for _, f in tried))
    tried = [(wheels, f.select(shown)) for wheels, f in tried]
    max_ratios = max(len(f.value) for _, f in tried)
    for wheels, figures in tried:
        for causes in _combine_causes(ratio or USUAL_STEERING_RATIO):
            lost = LOST_FIGURE_PRICE * (max_ratios - len(figures.value))
            cost = _compute_cost(figures, causes) + lost + CAUSE_PRICE * (len(causes) + (wheels is not None))
            if not causes and wheels is None:
                plain = cost, figures
            elif plain and len(figures.value) < len(plain[1].value):
                continue  # this unit cannot be the cause: some ratios cannot be computed with it
            if best is None or cost < best[0]:
                best = cost, (*((wheels,) if wheels else ()), *causes), figures
    pedals = _check_pedals(d, 0.5 * (front + rear), {"front": radius_front, "rear": radius_rear}, mass)
    if best is None or plain is None or not plain[1].value:
        return pedals
    _, causes, after = best
    if causes and best[0] < _compute_free_factor_cost(plain[1]):
        if not _holds_throughout(
            log, d, 0.5 * (front + rear), wheelbase, tracks, (radius_front, radius_rear), causes
        ):
            # The correction makes the ratios worse in a part of the log. A wrong unit or
            # sign would affect all of it, so the reason is a different one, e.g. a slide.
            return pedals
        return [_describe_causes(causes, plain[1], _apply_causes(after, causes))]
    return pedals + [
        f"check the units: {FIGURES[name]} is {x:.3g}, but about 1 is expected; no unit that is "
        f"often mixed up explains it{_list_alternatives(name, x)}"
        for name, x in plain[1].value.items()
        if abs(np.log(abs(x))) > MAX_UNEXPLAINED + 2 * plain[1].sd[name]
    ]


def _holds_throughout(
    log: CheckedLog,
    d: Mapping[str, np.ndarray],
    v: np.ndarray,
    wheelbase: float,
    tracks: Mapping[str, float] | None,
    radii: tuple[float, float],
    causes: tuple[Cause, ...],
) -> bool:
    """Return whether correcting the assumed mistakes `causes` lowers the cost in nearly
    all of the log.

    The log is divided into pieces of COMPARED_PIECE_TIME, since a wrong unit or sign
    affects all of it. A slide or ice may have the same effect on the ratios, but only in
    a part of the log. If the correction changes the cost of a piece by at most
    CAUSE_PRICE, e.g. because of little motion, the piece is not counted.
    """
    per = next((c.factor for c in causes if c.channel == "wheel_speed"), 1.0)
    others = tuple(c for c in causes if c.channel != "wheel_speed")
    count = round(COMPARED_PIECE_TIME * physics.COMPARISON_RATE)
    with_it = without = 0.0
    for first in range(0, len(v) - count // 2, count):
        part = {name: x[first : first + count] for name, x in d.items()}
        plain, other = (
            _compute_figures(log, part, v[first : first + count] / by, wheelbase, tracks, by, radii)
            for by in (1.0, per)
        )
        shared = {n for n in plain.value if n in other.value and not n.startswith("track")}
        if not shared:
            continue
        costs = _compute_cost(plain.select(shared), ()), _compute_cost(other.select(shared), others)
        if abs(costs[0] - costs[1]) > CAUSE_PRICE:
            with_it += costs[1] < costs[0]
            without += costs[0] < costs[1]
    return without <= MAX_ODD_SHARE * (with_it + without)


def _list_alternatives(name: str, x: float) -> str:
    """Return the last part of a warning: mistakes other than units that explain a wrong
    ratio of accel_x or steer_angle; "" for the other ratios.

    `name`: name of the ratio. `x`: its value."""
    if name == "accel_x":
        return f"; logged time steps that are {x:.3g} times the true ones would explain it"
    if name != "steer_angle":
        return ""
    braking = f", or {PERHAPS}braking in bends" if abs(np.log(abs(x))) < MAX_HANDLING else ""
    return f"; a wrong steering ratio or wheelbase explains it{braking}"


def _compute_free_factor_cost(figures: Figures) -> float:
    """Return the lowest cost that remains if one channel is corrected by an arbitrary
    factor of either sign. The cost includes FREE_FACTOR_PRICE."""
    costs = []
    for channel in ("yaw_rate", "accel_y", "accel_x", "steer_angle"):
        # Each ratio is proportional to a power of the factor. To find its exponent
        # (`power`), correct the channel by the factor e: the logarithm of the ratio then
        # changes by the exponent.
        turned = _apply_causes(figures, (Cause(channel, np.e, ""),))
        log = {n: np.log(abs(x)) for n, x in figures.value.items() if abs(turned[n] / x - 1) > 1e-9}
        if log:
            power = {n: np.log(abs(turned[n] / figures.value[n])) for n in log}
            weight = {n: 1.0 / figures.sd[n] ** 2 for n in log}
            best = -sum(weight[n] * power[n] * log[n] for n in log) / sum(
                weight[n] * power[n] ** 2 for n in log
            )
            costs += [
                _compute_cost(figures, (Cause(channel, sign * float(np.exp(best)), ""),)) for sign in (1, -1)
            ]
    return FREE_FACTOR_PRICE + min(costs, default=np.inf)


def find_false_stops(
    log: CheckedLog, radius_front: float, radius_rear: float, hold_speed: float
) -> list[str]:
    """Return a warning if both wheel speeds are 0 while the car drives.

    Criterion: the speeds step to 0 from one row to the next, and later step back to the
    speed of the car in the same way. The sum of both steps exceeds MIN_FALSE_STEP.
    Braking and accelerating cannot cause such steps. Speeds below `hold_speed`, m/s,
    count as 0."""
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
        if end - start >= MIN_FALSE_STOP and before + then > MIN_FALSE_STEP:
            found.append((start, end, before, then))
    if not found:
        return []
    start, end, before, then = found[0]
    often = "" if len(found) == 1 else f"{len(found)} times, first "
    return [
        f"both wheel speeds are 0 {often}from {start:.2f} to {end:.2f} s, while the car drove ({before:.3g} "
        f"m/s in the row before, {then:.3g} m/s in the row after): estimates there are not valid"
    ]


def _check_velocity(log: CheckedLog, radius_front: float, radius_rear: float) -> list[str]:
    """Return warnings if a measured velocity contradicts wheels, yaw rate or accel_y.

    The longitudinal velocity must equal the speed of the wheels within the factor
    MAX_SPEED_RATIO, since slip and errors of the radii are a few percent. Changes of the
    course over CHANGE_TIME must correlate with the integral of the yaw rate. Changes of
    the lateral velocity must correlate with the integral of accel_y - v r (on a flat
    road). A correlation below -0.5 means a wrong sign."""
    wheels = 0.5 * (radius_front * log.data["wheel_speed_front"] + radius_rear * log.data["wheel_speed_rear"])
    v = wheels.to_numpy(float)
    found = []
    for name in (n for n in ("ins_vel_x", "gnss_speed") if n in log.extra):
        x = log.extra[name].to_numpy(float)
        fast = np.isfinite(x) & (v > MIN_VELOCITY)
        if (
            fast.sum() >= 50
            and not 1 / MAX_SPEED_RATIO < (ratio := float(np.median(x[fast] / v[fast]))) < MAX_SPEED_RATIO
        ):
            found.append(
                f"check the units: {name} is {ratio:.3g} times the speed of the wheels, about 1 is expected"
            )
    if "gnss_course" in log.extra:
        course, turned = log.extra["gnss_course"].to_numpy(float), log.data["yaw_rate"].to_numpy(float)
        heading = np.cumsum(np.nan_to_num(turned) * np.diff(log.time, prepend=log.time[0]))
        rows = np.flatnonzero(np.isfinite(course) & (v > MIN_VELOCITY))
        n = max(1, round(CHANGE_TIME / float(np.median(np.diff(log.time[rows]))))) if len(rows) > 1 else 1
        first, last = rows[:-n], rows[n:]
        changes = np.column_stack(
            [np.angle(np.exp(1j * (course[last] - course[first]))), heading[last] - heading[first]]
        )
        changes = changes[log.time[last] - log.time[first] < 2 * CHANGE_TIME]
        if len(changes) >= 50 and changes.std(axis=0).min() > 0 and np.corrcoef(changes.T)[0, 1] < -0.5:
            found.append(
                "check the units: gnss_course turns against yaw_rate: a compass course increases clockwise, "
                "gnss_course must increase to the left"
            )
    if "ins_vel_y" in log.extra:
        y = log.extra["ins_vel_y"].to_numpy(float)
        rate = log.data["accel_y"].to_numpy(float) - v * log.data["yaw_rate"].to_numpy(float)
        step = np.diff(log.time, prepend=log.time[0])
        n = max(1, round(CHANGE_TIME / float(log.sample_time or CHANGE_TIME)))
        gained = np.cumsum(np.nan_to_num(rate) * step)
        changes = np.column_stack([y[n:] - y[:-n], gained[n:] - gained[:-n]])[v[n:] > MIN_VELOCITY]
        changes = changes[np.isfinite(changes).all(axis=1)]
        if len(changes) >= 50 and changes.std(axis=0).min() > 0 and np.corrcoef(changes.T)[0, 1] < -0.5:
            found.append(
                "check the units: ins_vel_y changes in the opposite direction to accel_y - speed x yaw_rate: "
                "ins_vel_y must be positive to the left"
            )
    return found


def _check_pedals(
    d: Mapping[str, np.ndarray], v: np.ndarray, radius: Mapping[str, float], mass: float | None
) -> list[str]:
    """Return warnings if brake or wheel torques contradict the acceleration.

    The brake (1: on) is compared with dv/dt. The force of the torques is compared with
    mass x accel_x. If only one axle has torques, only rows in which the car accelerates
    are used, since the brakes act on both axles."""
    found, moving, rate = [], np.abs(v) > MIN_VELOCITY, physics.differentiate(v)
    if "brake" in d:
        loses = f"off in {{:.0f}} % of the rows in which the car brakes by more than {-COASTING_LOSS:g} m/s2"
        for rows, on, words in (
            (rate > DRIVING_GAIN, True, "on in {:.0f} % of the rows in which the car gains speed"),
            (rate < COASTING_LOSS, False, loses),
        ):
            brake = d["brake"][moving & rows & np.isfinite(d["brake"])]
            share = float(np.mean((brake > 0.5) == on)) if len(brake) >= 50 else 0.0
            if share > 0.5:
                words = words.format(100 * share)
                found.append(f"check the units: brake is {words}: it must be 1 while braking, else 0")
    axles = [c for c in TORQUE_COLUMNS if c in d]
    if axles and mass and "accel_x" in d:
        force = sum(d[c] / radius[c.rpartition("_")[2]] for c in axles) / mass
        both = len(axles) == 2
        f = physics.fit(d["accel_x"], force, moving & (both | (d["accel_x"] > 0.3)))
        least = 1 / MAX_FORCE_RATIO if both else MIN_AXLE_SHARE
        if abs(f.corr) > MIN_TORQUE_CORR and not least < f.slope < MAX_FORCE_RATIO:
            found.append(
                f"check the units: the force of {' and '.join(axles)} is {f.slope:.3g} times mass x accel_x "
                f"(correlation {f.corr:.2f}), about 1 is expected: a wheel torque is the sum of both wheels "
                "of an axle in N m, negative while braking"
            )
    return found


def _smooth_channels(log: CheckedLog) -> dict[str, np.ndarray]:
    """Return the channels to check, resampled to COMPARISON_RATE and low-passed."""
    time = np.arange(log.time[0], log.time[-1], 1.0 / physics.COMPARISON_RATE)
    columns = {name: log.data[name].to_numpy(float) for name in log.data}
    columns |= {
        c: log.extra[c].to_numpy(float) for c in ("vehicle_speed", "brake", *TORQUE_COLUMNS) if c in log.extra
    }
    rate = 1.0 / max(log.sample_time or 0.01, 1e-3)
    found = {}
    for name, x in columns.items():
        good = np.isfinite(x)
        found[name] = physics.smooth(
            resample(log.time[good], x[good], time, min(physics.COMPARISON_RATE, rate))
        )
    return found


def _check_axles(front: np.ndarray, rear: np.ndarray) -> list[str]:
    """Return a warning if front and rear wheels differ in speed by over 25 %.

    `front`, `rear`: wheel speed x radius, m/s."""
    a, b = (
        float(np.nanmedian(np.abs(x[np.abs(x) > physics.MOVING_SPEED])))
        if (np.abs(x) > physics.MOVING_SPEED).any()
        else 0.0
        for x in (front, rear)
    )
    if min(a, b) > 0 and not 0.8 < a / b < 1.25:
        return [
            f"check the units: front and rear wheels roll at {a:.3g} and {b:.3g} m/s; wheel_radius_* or one "
            "wheel speed is wrong"
        ]
    return []


def _check_swapped_axes(d: Mapping[str, np.ndarray], v: np.ndarray) -> list[str]:
    """Return a warning if accel_x correlates with v r and accel_y does not."""
    moving = np.abs(v) > physics.MOVING_SPEED
    turn = v * d["yaw_rate"]
    x, y = (physics.fit(turn, d[c], moving) for c in ("accel_x", "accel_y"))
    along = physics.fit(physics.differentiate(v), d["accel_y"], moving)
    if (
        abs(x.corr) > MIN_FIT["accel_y"]
        and abs(y.corr) < 0.5
        and (abs(along.corr) > 0.5 or y.rows == 0 or abs(y.corr) < 0.2)
    ):
        return [
            f"check the axes: accel_x correlates with speed x yaw_rate (correlation {x.corr:.2f}, factor "
            f"{x.slope:.3g}) and accel_y does not ({y.corr:.2f}): accel_x and accel_y are swapped"
        ]
    return []


def _check_turned_imu(d: Mapping[str, np.ndarray], v: np.ndarray) -> list[str]:
    """Return a warning if the IMU is turned about the vertical axis.

    accel_x then contains a part of the lateral acceleration, and accel_y contains the
    same part of the longitudinal acceleration with the opposite sign."""
    turn, rate = v * d["yaw_rate"], physics.differentiate(v)
    rows = (np.abs(v) > physics.MOVING_SPEED) & np.isfinite(turn + rate + d["accel_x"] + d["accel_y"])
    if rows.sum() < physics.MIN_ROWS:
        return []
    parts = np.column_stack([rate[rows], turn[rows], np.ones(rows.sum())])
    (_, x, _), (y, _, _) = (np.linalg.lstsq(parts, d[c][rows], rcond=None)[0] for c in ("accel_x", "accel_y"))
    if min(abs(x), abs(y)) < MIN_IMU_TURN or x * y > 0:
        return []
    return [
        f"check the axes: accel_x contains {x:.2g} times (speed x yaw_rate), and accel_y contains {y:.2g} "
        "times the rate of change of the speed: the IMU is "
        f"turned about the vertical by {np.degrees(np.arcsin(np.clip((x - y) / 2, -1, 1))):.0f} degrees"
    ]


def _check_mixed_sides(d: Mapping[str, np.ndarray], front: np.ndarray, rear: np.ndarray) -> list[str]:
    """Return a warning if the two wheels of one side of the car are logged as an axle.

    In a bend, the outer wheels are faster than the inner ones. If the front channel is
    one side of the car and the rear channel the other one, front - rear speed is thus
    proportional to the yaw rate. With correct axles, the difference has the same sign in
    left and right bends."""
    y, turn, slip = front - rear, d["yaw_rate"], rear * physics.differentiate(rear)
    rows = (np.abs(front) > physics.MOVING_SPEED) & np.isfinite(y + turn + slip)
    if rows.sum() < physics.MIN_ROWS:
        return []
    v, across = rear[rows], np.abs(rear * turn)[rows]
    plain = [turn[rows], slip[rows], np.ones(rows.sum())]
    # Not only mixed sides, but also different tyre radii cause a difference of front and
    # rear speed. The radii differ by wear (term v), and depend on the square of the speed
    # (term v^3) and on the load in bends (term v |v r|). There is a warning only if the
    # yaw rate explains the difference in both fits, without and with these terms.
    for columns in (plain, [*plain, v, v**3, v * across]):
        parts = np.column_stack(columns)
        found = np.linalg.lstsq(parts, y[rows], rcond=None)[0]
        by = found[0] * float(np.std(turn[rows]))
        share = by**2 / (by**2 + float(np.var(y[rows] - parts @ found)) + 1e-12)
        if share < MIN_SIDE_SHARE or not SIDE_LEVER[0] < abs(found[0]) < SIDE_LEVER[1]:
            return []
    return [
        f"check the wheels: front - rear wheel speed is {found[0]:.2g} m times yaw_rate, like the "
        "difference of left and right wheels: wheel_speed_front or _rear is of one side, or a left and a "
        "right wheel are one signal"
    ]


def _check_time(log: CheckedLog, radius: float) -> list[str]:
    """Return a warning if the column time of a slowly sampled log is wrong, e.g. if it
    counts rows instead of seconds.

    The integral of accel_x over the logged time must equal the change of the speed."""
    step, n = float(log.sample_time or 0.0), SLOW_ROWS
    if step <= 1.0 / physics.COMPARISON_RATE or len(log) < 10 * n:
        return []
    v = radius * log.data["wheel_speed_rear"].to_numpy(float)
    gained = np.cumsum(np.nan_to_num(log.data["accel_x"].to_numpy(float))) * step
    f = physics.fit(v[n:] - v[:-n], gained[n:] - gained[:-n], v[n:] > physics.MOVING_SPEED)
    if f.corr < MIN_FIT["accel_x"] or 1 / MAX_TIME_RATIO < f.slope < MAX_TIME_RATIO:
        return []
    return [
        f"check the units: accel_x over {n} rows, {step:.3g} s apart, adds up to {f.slope:.3g} times the "
        "change of the speed: is time in s, or does it count rows?"
    ]


def _list_wheel_causes(radius: float) -> list[Cause]:
    """Return the mistakes of WHEEL_CAUSES for wheels of this radius, m."""
    return [Cause("wheel_speed", per * radius**power, text) for per, power, _, text in WHEEL_CAUSES]


def _combine_causes(ratio: float) -> Iterator[tuple[Cause, ...]]:
    """Yield all combinations of at most two of the mistakes in CAUSES: none, each one,
    each pair.

    Two mistakes of the same channel form a pair only if one of them is a wrong sign.
    `ratio`: steering ratio."""
    single = [Cause(channel, per * ratio**power, text) for channel, per, power, _, text in CAUSES]
    yield ()
    for cause in single:
        yield (cause,)
    for a, b in combinations(single, 2):
        if a.channel != b.channel or a.factor * b.factor < 0:
            yield a, b


def _compute_figures(
    log: CheckedLog,
    d: Mapping[str, np.ndarray],
    v: np.ndarray,
    wheelbase: float,
    tracks: Mapping[str, float] | None,
    wheels: float,
    radii: tuple[float, float],
) -> Figures:
    """Return the ratios of measured to expected values for the speed v, m/s.

    `d`: channels of the log or of a part of it. `wheels`: assumed factor by which the
    logged wheel speeds are too large. The caller has divided v by this factor. The track
    ratios are computed from logged wheel speeds, and are divided by the factor here."""
    value: dict[str, float] = {}
    sd: dict[str, float] = {}
    nearly: set[str] = set()
    moving = np.abs(v) > physics.MOVING_SPEED
    for name, kinematic in (("accel_y", v * d["yaw_rate"]), ("accel_x", physics.differentiate(v))):
        f = physics.fit(kinematic, d[name], moving)
        if abs(f.corr) > MIN_FIT[name] - FIT_SLACK and np.nanstd(d[name][moving]) > 0.02:
            value[name], sd[name] = f.slope, float(np.hypot(FIGURE_SD[name], 1 - abs(f.corr)))
            nearly |= {name} if abs(f.corr) <= MIN_FIT[name] else set()
    s = physics.fit_steering(d["steer_angle"], v, d["yaw_rate"])
    if s is not None and s.share > MIN_FIT["steer_angle"] - FIT_SLACK and s.per_curvature != 0:
        nearly |= {"steer_angle"} if s.share <= MIN_FIT["steer_angle"] else set()
        value["steer_angle"], sd["steer_angle"] = (
            s.per_curvature / wheelbase,
            float(np.hypot(FIGURE_SD["steer_angle"], s.sd)),
        )
    for axle, radius in zip(("front", "rear"), radii, strict=True):
        per_turn = log.turn.get(f"wheel_speed_{axle}")
        if per_turn:
            given = (tracks or {}).get(axle)
            value[f"track_{axle}"] = per_turn * radius / wheels / (given or UNKNOWN_TRACK)
            sd[f"track_{axle}"] = FIGURE_SD["track"] if given else UNKNOWN_TRACK_SD
    if "vehicle_speed" in d:
        both = moving & (d["vehicle_speed"] > physics.MOVING_SPEED)
        if both.sum() > physics.MIN_ROWS:
            value["speed"], sd["speed"] = (
                float(np.nanmedian((v / d["vehicle_speed"])[both])),
                FIGURE_SD["speed"],
            )
    return Figures(value, sd, frozenset(value) - nearly)


def _apply_causes(figures: Figures, causes: tuple[Cause, ...]) -> dict[str, float]:
    """Return the ratios after correction of the assumed mistakes `causes`.

    Mistakes of the wheel speeds change nothing here: the caller of _compute_figures() has
    already corrected the speed."""
    by = dict.fromkeys(("yaw_rate", "accel_y", "accel_x", "steer_angle"), 1.0)
    for cause in causes:
        if cause.channel in by:
            by[cause.channel] *= cause.factor
    # The ratios are proportional to accel_y / (v r), accel_x, steer_angle v / r, and
    # (right - left wheel speed) / r (r: yaw rate). `expected`: factor by which the causes
    # have changed each ratio.
    expected = {
        "accel_y": by["accel_y"] / by["yaw_rate"],
        "accel_x": by["accel_x"],
        "steer_angle": by["steer_angle"] / by["yaw_rate"],
    }
    expected |= {f"track_{a}": 1.0 / by["yaw_rate"] for a in ("front", "rear")} | {"speed": 1.0}
    return {name: x / expected[name] for name, x in figures.value.items()}


def _compute_cost(figures: Figures, causes: tuple[Cause, ...]) -> float:
    """Return the cost of the ratios after correction of the assumed mistakes `causes`.

    It is the sum of (ln |ratio| / sd)^2, plus SIGN_PRICE for each negative ratio."""
    left = _apply_causes(figures, causes)
    return sum(
        float(np.log(abs(x)) ** 2 / figures.sd[n] ** 2) + SIGN_PRICE * (x < 0) for n, x in left.items()
    )


def _describe_causes(causes: tuple[Cause, ...], before: Figures, after: Mapping[str, float]) -> str:
    """Return the warning that lists the causes, the factor by which each cause makes its
    channel wrong, and the ratios that change, before and after the correction."""
    moved = [
        n
        for n in before.value
        if (n in after and abs(np.log(abs(before.value[n] / after[n]))) > 0.02)
        or before.value[n] * after.get(n, 1) < 0
    ]
    parts = [f"{FIGURES[n]} is {before.value[n]:.3g}, {after[n]:.3g} after" for n in moved if n in after]
    fits = all(abs(np.log(abs(after[n]))) < EXPLAINED + 0.05 for n in moved if n in after)
    text = " and ".join(c.text for c in causes)
    if not fits and "steer_angle" in before.value:
        factor = before.value["steer_angle"]
        text += f", or the steering ratio or the wheelbase is wrong by the factor {factor:.3g}"
    return (
        f"check the units: {'' if fits else PERHAPS}{text}; factor "
        f"{', '.join(f'{c.factor:.3g}' for c in causes)}: {'; '.join(parts)} (about 1 is expected)"
    )
