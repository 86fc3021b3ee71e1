"""The cases of all studies, and what only these cases need: manoeuvres, and functions
that put faults, such as lost values, into a simulated log.

A case is a manoeuvre with settings and possibly faults (class Case). "The paper" is cited
in docs/pages/method/paper.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tse.library.core import Config, SimConfig
from tse.library.errors import UserError
from tse.log.rows import DRIVES, MEASURES
from tse.simulation import maneuvers
from tse.simulation.maneuvers import Maneuver, make_square
from tselab.montecarlo import STUDIES
from tselab.montecarlo.case import Case
from tselab.montecarlo.estimators import PEERS, VARIANTS, get_overrides

# ---- Manoeuvres that only studies need. Each function takes the car, the settings of the
# simulator and a random generator, and returns a Maneuver.

# Amplitudes of the square waves in Sec. IV-A of the paper: steering angle [rad], and
# drive torque [Nm], the sum of both front wheels
WAVE_STEER, WAVE_TORQUE = 0.02, 700.0
LOW_STEER, LOW_SLIP = 0.005, 0.005  # [rad], [1] amplitudes of steering and slip at low excitation


def drive_square_waves(
    car: Config,
    sim: SimConfig,
    rng: np.random.Generator,
    *,
    duration: float,
    steer: float = WAVE_STEER,
    torque: float | None = WAVE_TORQUE,
    road: tuple[tuple[float, float], ...] = (),
) -> Maneuver:
    """Return square waves of steering and drive torque, as in Sec. IV-A of the paper.

    `steer` [rad], `torque` [Nm]: amplitudes. The torque is the sum of both front wheels.
    None: the torque that causes the slip LOW_SLIP. `road`: pairs of a time [s] and a
    factor. From this time to that of the next pair, every stiffness is the factor times
    nominal. Before the first pair, every stiffness is nominal."""
    m = maneuvers.build(
        "square-waves", car, sample_time=car.sample_time, duration=duration, amplitude=steer, road=list(road)
    )
    torque = find_torque(car, sim, LOW_SLIP) if torque is None else torque
    return replace(m, wheel_torque_front=torque * np.sign(m.wheel_torque_front))


def find_torque(car: Config, sim: SimConfig, slip: float) -> float:
    """Return the drive torque [Nm] on the front axle that keeps its slip at `slip`. It
    balances the tyre force, which accelerates the car and its rear wheels, and gives the
    front wheels the same acceleration."""
    force = car.longitudinal_stiffness_front * slip
    front, rear = (
        getattr(sim, f"wheel_inertia_{a}") / getattr(car, f"wheel_radius_{a}") ** 2 for a in ("front", "rear")
    )
    return force * car.wheel_radius_front * (car.mass + front + rear) / (car.mass + rear)


def drive_listed(
    car: Config, sim: SimConfig, rng: np.random.Generator, *, name: str, duration: float
) -> Maneuver:
    """Return a manoeuvre of `tselab simulate`."""
    return maneuvers.build(name, car, sample_time=car.sample_time, duration=duration, seed=sim.seed)


LANE_CHANGE = (302.0, 3.0, 0.015)  # start [s], duration [s], steering amplitude [rad]
HIGHWAY_END = 315.0  # [s] end of the drive


def drive_highway(car: Config, sim: SimConfig, rng: np.random.Generator) -> Maneuver:
    """Return five minutes of straight highway, then a lane change of 4 m."""
    m = drive_listed(car, sim, rng, name="straight", duration=HIGHWAY_END)
    start, length, amplitude = LANE_CHANGE
    share = (m.time - start) / length
    sine = np.where((share >= 0) & (share < 1), np.sin(2 * np.pi * share), 0.0)
    return replace(m, steer_angle=m.steer_angle + amplitude * sine)


REVERSE_END = 60.0  # [s] end of the drive


def drive_reverse(car: Config, sim: SimConfig, rng: np.random.Generator) -> Maneuver:
    """Return a drive that begins at standstill, goes backwards at 3 m/s with steering,
    stops, accelerates to 18 m/s, and ends with the paper's square waves."""
    t = np.round(np.arange(round(REVERSE_END / car.sample_time) + 1) * car.sample_time, 9)
    # [N] product of acceleration [m/s2] and mass
    force = np.select([t < 5, (t >= 12) & (t < 17), (t >= 20) & (t < 30)], [-0.6, 0.6, 1.8]) * car.mass
    waves = t >= 30
    torque = np.where(waves, WAVE_TORQUE * make_square(t, 5.0), force * car.wheel_radius_front)
    steer = np.select(
        [(t >= 5) & (t < 12), waves], [0.05 * make_square(t, 4.0), WAVE_STEER * make_square(t, 4.0)]
    )
    zero = np.zeros_like(t)
    return Maneuver(t, 0.0, steer, torque, zero, np.ones_like(t))


PULSES = (20.0, 45.0)  # [s] times at which the front wheels lock or spin
PULSES_END = 75.0  # [s] end of the drive
LOCK_TORQUE, LOCK_FOR = 6000.0, 1.0  # [Nm] brake torque, sum of both front wheels; [s] its duration
SPIN_TORQUE, SPIN_FOR = 4000.0, 0.85  # [Nm] drive torque, sum of both front wheels; [s] its duration


def drive_wheel_lock(car: Config, sim: SimConfig, rng: np.random.Generator) -> Maneuver:
    """Return square waves in which the brakes lock the front wheels twice, each time for
    one second. After each locking, drive torque brings the car back to its speed."""
    m = drive_square_waves(car, sim, rng, duration=PULSES_END)
    torque, brake = m.wheel_torque_front.copy(), np.zeros_like(m.time)
    for start in PULSES:
        locked = (m.time >= start) & (m.time < start + LOCK_FOR)
        brake[locked] = LOCK_TORQUE
        torque[locked] = 0.0
        torque[(m.time >= start + 2) & (m.time < start + 6)] += 700.0
    return replace(m, wheel_torque_front=torque, brake_torque_front=brake)


def drive_wheel_spin(car: Config, sim: SimConfig, rng: np.random.Generator) -> Maneuver:
    """Return square waves in which a large torque makes the front wheels spin twice.
    After each spinning, brake torque brings the car back to its speed."""
    m = drive_square_waves(car, sim, rng, duration=PULSES_END)
    torque = m.wheel_torque_front.copy()
    for start in PULSES:
        torque[(m.time >= start) & (m.time < start + SPIN_FOR)] = SPIN_TORQUE
        torque[(m.time >= start + 2) & (m.time < start + 6)] -= 600.0
    return replace(m, wheel_torque_front=torque)


# [m/s] mean and sd of the initial speed in the paper (from its x0 and P0). The initial
# lateral velocity has mean 0 and the same sd
PAPER_SPEED, PAPER_SD = 22.0, 1.0
APPROACH, LANES_END = 10.0, 48.0  # [s] end of the straight approach, end of the drive


def drive_paper_waves(
    car: Config,
    sim: SimConfig,
    rng: np.random.Generator,
    *,
    duration: float,
    road: tuple[tuple[float, float], ...],
) -> Maneuver:
    """Return the paper's square waves. The true initial speed and lateral velocity are
    drawn from the normal distribution that the paper assumes for them."""
    speed = PAPER_SPEED + PAPER_SD * rng.standard_normal()
    sim.vel_y = PAPER_SD * rng.standard_normal()
    return replace(drive_square_waves(car, sim, rng, duration=duration, road=road), speed=speed)


def drive_paper_lanes(car: Config, sim: SimConfig, rng: np.random.Generator) -> Maneuver:
    """Return a drive like that of Sec. IV-B of the paper: ten seconds straight ahead
    with two accelerations, then the manoeuvre double-lane-change. This manoeuvre
    begins with an acceleration of 3 s, so that the first lane change starts at 13 s."""
    m = drive_listed(car, sim, rng, name="double-lane-change", duration=LANES_END - APPROACH)
    t = np.round(np.arange(round(LANES_END / car.sample_time) + 1) * car.sample_time, 9)
    before = len(t) - len(m.time)
    drive = np.select([(t >= 1) & (t < 4), (t >= 6) & (t < 9)], [1.0, 1.0], 0.0)  # [m/s2] acceleration
    torque = drive * car.mass * car.wheel_radius_front
    torque[before:] += m.wheel_torque_front
    steer = np.concatenate([np.zeros(before), m.steer_angle])
    return Maneuver(t, m.speed - 6.0, steer, torque, np.zeros_like(t), np.ones_like(t))


# ---- changes of the road


def drive_slow_change(
    car: Config,
    sim: SimConfig,
    rng: np.random.Generator,
    *,
    start: float,
    length: float,
    level: float,
    after: float,
) -> Maneuver:
    """Return square waves on a road surface that changes slowly: every stiffness changes
    linearly from nominal to `level` times nominal.

    `start`, `length`: start and duration of the change [s]. `after`: time from the end
    of the change to the end of the drive [s]."""
    m = drive_square_waves(car, sim, rng, duration=start + length + after)
    return replace(m, road_level=np.interp(m.time, [start, start + length], [1.0, level]))


LANE_PERIOD = (6.0, 12.0)  # [s] range of the periods of steering while keeping the lane


def _make_waves(
    t: np.ndarray, rng: np.random.Generator, size: tuple[float, float], period: tuple[float, float]
) -> np.ndarray:
    """Return a steering angle [rad]: the sum of two sines of random period and phase. One
    sine has 70 %, the other 30 % of a total amplitude, which is random, too.

    `size`: [rad] range of the total amplitude. `period`: [s] range of each period."""
    a, share = rng.uniform(*size), (0.7, 0.3)
    return sum(a * s * np.sin(2 * np.pi * (t / rng.uniform(*period) + rng.random())) for s in share)


# Constants of drive_ordinary(), whose drive is a random sequence of parts

PART = (20.0, 60.0)  # [s] range of the duration of a part of the drive
SPEEDS = (8.0, 35.0)  # [m/s] range of the random speeds of the parts
SPEED_CHANGE = 1.5  # [m/s2] acceleration or deceleration from the speed of a part to that of the next
LATERAL_PEAK_RANGE = (0.5, 2.5)  # [m/s2] range of the max lateral acceleration of a part
# [m/s2] amplitude of the square wave of longitudinal acceleration in a part that has a
# square wave of steering
SQUARE_WAVE_ACCEL = 1.0


def drive_ordinary(car: Config, sim: SimConfig, rng: np.random.Generator, *, duration: float) -> Maneuver:
    """Return ordinary driving on an unchanged road surface. The true stiffness is
    constant, so every change of stiffness that an estimator reports is a false alarm.

    The drive is a random sequence of parts, each with one kind of steering: lane keeping,
    square waves, random steering, or none (straight ahead). Each part has a random speed,
    and begins with the change to this speed."""
    t = np.round(np.arange(round(duration / car.sample_time) + 1) * car.sample_time, 9)
    steer, target = np.zeros_like(t), np.zeros_like(t)
    start, speed = 0.0, rng.uniform(*SPEEDS)
    first = speed
    gradient = maneuvers.compute_understeer(car)
    while start < t[-1]:
        end = start + rng.uniform(*PART)
        now = t[part := (t >= start - 1e-9) & (t < end)]
        aim = rng.uniform(*SPEEDS)
        reached = speed + np.clip(aim - speed, -SPEED_CHANGE * (end - start), SPEED_CHANGE * (end - start))
        target[part] = np.interp(
            now, [start, start + max(abs(reached - speed) / SPEED_CHANGE, 1e-3)], [speed, reached]
        )
        fast = max(speed, reached)
        size = rng.uniform(*LATERAL_PEAK_RANGE) * (car.lf + car.lr + gradient * fast**2) / fast**2
        kind = rng.integers(4)
        if kind == 0:
            steer[part] = _make_waves(now, rng, (size, size), LANE_PERIOD)
        elif kind == 1:
            steer[part] = size * make_square(now, rng.uniform(3.0, 6.0))
            period = (end - start) / round((end - start) / rng.uniform(4.0, 8.0))
            target[part] += (
                SQUARE_WAVE_ACCEL * period / 2 * (1 - np.abs(2 * ((now - start) / period % 1.0) - 1))
            )
        elif kind == 2:
            steer[part] = np.clip(
                0.4 * size * maneuvers._make_coloured(rng, len(now), car.sample_time, 0.8), -size, size
            )
        start, speed = end, reached
    zero = np.zeros_like(t)
    return Maneuver(t, first, steer, zero, zero, np.ones_like(t), target_speed=target)


# ---- Faults of logs. Each function changes the rows in place, and returns a bool for
# each row. True: the fault makes the row unusable, so that errors of an estimator in it
# are not scored.


LENGTHS = (0.1, 0.5, 2.0, 5.0)  # [s] durations of the four faults (dropout or frozen channel) in a log
# [s] The log is divided into slots with one fault each. FIRST: start of the first slot.
# SLOT: length of a slot. JITTER: max time from the start of a slot to its fault. The rest
# of a slot shows whether the estimator recovers from the fault
FIRST, SLOT, JITTER = 15.0, 20.0, 2.0
SLOTS_END = FIRST + SLOT * len(LENGTHS)


def _choose_stretches(time: np.ndarray, rng: np.random.Generator) -> list[tuple[int, int]]:
    """Return a range of rows [a, b) for each fault. The faults have the durations LENGTHS
    in random order, and random start times within their slots."""
    found = []
    for slot, length in enumerate(rng.permutation(LENGTHS)):
        start = FIRST + SLOT * slot + rng.uniform(0, JITTER)
        a, b = np.searchsorted(time, [start, start + length])
        found.append((int(a), int(b)))
    return found


def drop_channel(time: np.ndarray, rows: np.ndarray, rng: np.random.Generator, channel: str) -> np.ndarray:
    """Remove the values of a channel in four intervals, with the durations LENGTHS.
    Return True (unusable) for the rows in these intervals."""
    corrupted = np.zeros(len(time), bool)
    for a, b in _choose_stretches(time, rng):
        rows[channel][a:b] = np.nan
        corrupted[a:b] = True
    return corrupted


def freeze_channel(time: np.ndarray, rows: np.ndarray, rng: np.random.Generator, channel: str) -> np.ndarray:
    """Freeze a channel in four intervals, with the durations LENGTHS: in each interval it
    repeats the last value before the interval. Return True (unusable) for the rows in
    these intervals."""
    corrupted = np.zeros(len(time), bool)
    for a, b in _choose_stretches(time, rng):
        rows[channel][a:b] = rows[channel][a - 1]
        corrupted[a:b] = True
    return corrupted


def add_outliers(
    time: np.ndarray, rows: np.ndarray, rng: np.random.Generator, share: float, sigmas: float
) -> np.ndarray:
    """Add outliers to the samples of accel_x, accel_y and yaw_rate, each with the
    probability `share`. The size of an outlier is `sigmas` times the default noise sd
    of the sensor, its sign is random. Return False (usable) for every row, because the
    errors of an estimator are scored also in rows with outliers."""
    default = Config.exact()
    for channel in MEASURES:
        hit = rng.random(len(time)) < share
        sign = rng.choice([-1.0, 1.0], len(time))
        rows[channel] += np.where(hit, sign * sigmas * getattr(default, f"{channel}_sd"), 0.0)
    return np.zeros(len(time), bool)


SPREADS = ("spread_cx_front", "spread_cy_front", "spread_cy_rear")
DEGREE = np.pi / 180


@dataclass(frozen=True)
class Study:
    """A list of cases. A case is a manoeuvre with settings and possibly faults."""

    # name of the study and, each after a "+", names of estimators that are added to all
    # cases. Example: "stress+ekf"
    name: str
    title: str
    runs: int  # default number of runs of each case
    cases: tuple[Case, ...]

    @property
    def base(self) -> str:
        """Name of the study without added estimators."""
        return self.name.partition("+")[0]

    def case(self, name: str) -> Case:
        """Return a case by its name."""
        return next(c for c in self.cases if c.name == name)


def _make_square_waves(duration: float = 30.0, **more: object) -> partial:
    return partial(drive_square_waves, duration=duration, **more)


def _draw_paper_prior(config: Config, sim: SimConfig, rng: np.random.Generator) -> Mapping[str, float]:
    """Return the setting of the initial speed: the true speed plus a random error with an
    sd of 1 m/s."""
    return {"initial_vel_x": sim.speed + rng.standard_normal()}


NOMINAL_CASE = Case("nominal", "square waves, all parameters as assumed", _make_square_waves())
NOISE_3X = Case("noise-3x", "sensor noise 3 times the setting", _make_square_waves(), sim={"noise": 3.0})
NOISE_THIRD = Case(
    "noise-third", "sensor noise a third of the setting", _make_square_waves(), sim={"noise": 1 / 3}
)
LOW = Case(
    "low-excitation", "slip 0.5 %, steering 0.005 rad", _make_square_waves(steer=LOW_STEER, torque=None)
)
OUTLIERS = Case(
    "outliers",
    "1 % of the inertial samples 10 sigma off",
    _make_square_waves(),
    corrupt=partial(add_outliers, share=0.01, sigmas=10.0),
)
ROAD_CHANGE_CASE = Case(
    "road-change",
    "all stiffness to 70 % at 20 s",
    _make_square_waves(40.0, road=((20.0, 0.7),)),
    events=(20.0,),
)

ROAD_03 = Case(
    "road-0.3",
    "road to 30 % at 20 s and back at 40 s",
    _make_square_waves(60.0, road=((20.0, 0.3), (40.0, 1.0))),
    events=(20.0, 40.0),
    windows=((30.0, 39.99), (50.0, 60.0)),
)


def _make_stress_cases() -> tuple[Case, ...]:
    imu_bias = {
        "true_bias_accel_x": 0.1,
        "true_bias_accel_y": 0.1,
        "true_bias_yaw_rate": 0.2 * DEGREE,
        "bias_walk": 1.0,
    }
    after_15 = ((FIRST, SLOTS_END),)
    pulses = ((PULSES[0] - 5, PULSES[0]), (PULSES_END - 15, PULSES_END))
    friction = {"sim": {"friction": 0.9}, "windows": pulses}
    slots = _make_square_waves(SLOTS_END)
    return (
        NOMINAL_CASE,
        Case(
            "paper-prior",
            "initial vx with an error of 1 m/s sd",
            _make_square_waves(),
            draw=_draw_paper_prior,
            config={"initial_vel_x_from_wheels": 0, "initial_vel_x_sd": 1.0},
        ),
        Case("vy-start", "initial vy 10 sigma wrong", _make_square_waves(), sim={"vel_y": 1.0}),
        NOISE_3X,
        NOISE_THIRD,
        Case(
            "wheel-noise-known",
            "noise of the wheel speeds 0.05 rad/s, as in the settings",
            _make_square_waves(),
            sim={"wheel_speed_sd": 0.05},
            config={"wheel_noise_sd": 0.05},
        ),
        Case(
            "wheel-noise-unknown",
            "noise of the wheel speeds 0.05 rad/s, but not in the settings",
            _make_square_waves(),
            sim={"wheel_speed_sd": 0.05},
        ),
        OUTLIERS,
        Case(
            "imu-bias",
            "biases of 0.1, 0.1 m/s2, 0.2 deg/s that vary as a random walk",
            _make_square_waves(),
            sim=imu_bias,
        ),
        LOW,
        replace(
            LOW,
            name="low-excitation-250",
            title="torque 250 Nm, steering 0.005 rad",
            build=_make_square_waves(steer=LOW_STEER, torque=250.0),
        ),
        Case(
            "highway",
            "5 min straight, then a lane change",
            drive_highway,
            windows=((LANE_CHANGE[0] + LANE_CHANGE[1], HIGHWAY_END),),
        ),
        replace(ROAD_03, windows=((30.0, 40.0), (50.0, 60.0))),
        *(
            Case(
                f"spread-{s:g}",
                f"sd of the stiffness from sample to sample {s:g} %",
                _make_square_waves(),
                sim=dict.fromkeys(SPREADS, s / 100),
            )
            for s in (1, 5, 15)
        ),
        *(
            Case(f"forgetting-{f:g}", f"forgetting {f:g}", _make_square_waves(), config={"forgetting": f})
            for f in (0.98, 0.99, 0.995)
        ),
        Case(
            "forgetting-0.999",
            "forgetting 0.999, scored after two memories",
            _make_square_waves(40.0),
            config={"forgetting": 0.999},
            windows=((20.0, 40.0),),
        ),
        *(
            Case(
                f"dropout-{c}",
                f"{c} missing for 0.1 .. 5 s",
                slots,
                corrupt=partial(drop_channel, channel=c),
                windows=after_15,
            )
            for c in (*DRIVES, *MEASURES)
        ),
        *(
            Case(
                f"stuck-{c}",
                f"{c} frozen for 0.1 .. 5 s",
                slots,
                corrupt=partial(freeze_channel, channel=c),
                windows=after_15,
            )
            for c in (*DRIVES, *MEASURES)
        ),
        Case(
            "stop-and-go",
            "standstill, launch, stop, four times",
            partial(drive_listed, name="stop-and-go", duration=80.0),
            windows=((20.0, 80.0),),
        ),
        Case(
            "reverse",
            "backwards from standstill, launch, square waves",
            drive_reverse,
            windows=((45.0, REVERSE_END),),
        ),
        Case(
            "wheel-lock",
            "front wheels lock for 1 s, twice; truth: secant stiffness",
            drive_wheel_lock,
            **friction,
        ),
        Case(
            "wheel-spin",
            "front wheels spin for 1 s, twice; truth: secant stiffness",
            drive_wheel_spin,
            **friction,
        ),
        Case(
            "mass+10",
            "10 % heavier than assumed",
            _make_square_waves(),
            car={"mass": 1.1, "yaw_inertia": 1.1},
        ),
        Case(
            "mass-10",
            "10 % lighter than assumed",
            _make_square_waves(),
            car={"mass": 0.9, "yaw_inertia": 0.9},
        ),
        *(
            Case(
                f"sample-{ms}ms",
                f"a row every {ms} ms",
                _make_square_waves(),
                config={"sample_time": ms / 1000},
            )
            for ms in (5, 10, 20, 40)
        ),
    )


# [s] slow change of the road surface. SLOW: its duration. SLOW_START: its start.
# SLOW_AFTER: time from its end to the end of the drive
SLOW, SLOW_START, SLOW_AFTER = 20.0, 20.0, 20.0


def _make_regime_cases() -> tuple[Case, ...]:
    """Return the cases in which the road surface, and with it the true stiffness,
    changes.

    For a step, errors are scored in a window before and a window after it. The first
    window ends 0.01 s before the step, because the row at the step already has the new
    stiffness. For a slow change, the only window is from its start to the end of the
    drive."""
    two = ("tse", "known")
    return (
        Case(
            "road-0.7",
            "square waves, road to 70 % at 30 s",
            _make_square_waves(60.0, road=((30.0, 0.7),)),
            events=(30.0,),
            windows=((15.0, 29.99), (45.0, 60.0)),
            estimators=two,
        ),
        replace(ROAD_03, estimators=two),
        Case(
            "slow-20",
            f"stiffness to 70 % within {SLOW:g} s",
            partial(drive_slow_change, start=SLOW_START, length=SLOW, level=0.7, after=SLOW_AFTER),
            events=(SLOW_START,),
            lasts=SLOW,
            windows=((SLOW_START, SLOW_START + SLOW + SLOW_AFTER),),
        ),
    )


TEN_MINUTES = 600.0  # [s] duration of each drive of the study "false-alarms"


def _make_false_alarm_cases() -> tuple[Case, ...]:
    known = Case(
        "false-alarms",
        "ordinary driving",
        partial(drive_ordinary, duration=TEN_MINUTES),
        windows=((30.0, TEN_MINUTES),),
    )
    return known, replace(
        known, name="false-alarms-held", title="ordinary driving; inputs held", sim={"hold_inputs": 1}
    )


def _set_estimators(estimators: tuple[str, ...], *cases: Case) -> tuple[Case, ...]:
    return tuple(replace(c, estimators=estimators) for c in cases)


def _make_paper_cases() -> tuple[Case, ...]:
    """Return the four cases of the paper:
    - iv-a, iv-a-held: square waves of Sec. IV-A. Between rows the inputs change linearly
      (iv-a) or are constant (iv-a-held).
    - iv-b-20, iv-b+20: simulation of the experiment of Sec. IV-B, with an initial
      stiffness that is 20 % too low or too high."""
    waves = Case(
        "iv-a",
        "square waves, road to 70 % at 30 s",
        partial(drive_paper_waves, duration=60.0, road=((30.0, 0.7),)),
        events=(30.0,),
        windows=((15.0, 29.99), (45.0, 60.0)),
        estimators=PAPER,
    )
    lanes = Case(
        "iv-b-20",
        "acceleration, double lane changes, prior 20 % too low",
        drive_paper_lanes,
        config=_make_prior(0.8),
        windows=((0.0, 48.0), (44.0, 48.0)),
        estimators=("paper", "robust", "tse"),
    )
    return (
        waves,
        replace(
            waves,
            name="iv-a-held",
            title=f"{waves.title}; inputs held",
            sim={"hold_inputs": 1},
            config={"integration": 2},
        ),
        lanes,
        replace(lanes, name="iv-b+20", title="the same, prior 20 % too high", config=_make_prior(1.2)),
    )


PAPER = ("printed", "robust", "tse")


def _make_prior(level: float) -> dict[str, float]:
    return {f"initial_{s}": level for s in ("cx_front", "cy_front", "cy_rear")} | {"forgetting": 0.995}


def _make_cases() -> dict[str, tuple[Case, ...]]:
    return {
        "accuracy": (
            Case(
                "accuracy", "square waves, start at 70 %", _make_square_waves(40.0), windows=((20.0, 40.0),)
            ),
        ),
        "paper": _make_paper_cases(),
        "robust": _set_estimators(
            ("robust", *(f"robust-{name}" for name in VARIANTS)),
            *(c for c in _make_paper_cases() if c.name == "iv-a"),
            ROAD_03,
            NOISE_3X,
        ),
        "peers": _set_estimators(
            ("tse", "robust", "robust-100", *PEERS),
            NOMINAL_CASE,
            LOW,
            NOISE_3X,
            NOISE_THIRD,
            ROAD_CHANGE_CASE,
        ),
        "stress": _make_stress_cases(),
        "regimes": _make_regime_cases(),
        "false-alarms": _make_false_alarm_cases(),
    }


def make_study(name: str, cases: tuple[str, ...] = ()) -> Study:
    """Return a study. Raise UserError for an unknown name.

    `name`: name of the study, and names of further estimators, each after a "+".
    `cases`: names of the cases; empty: all cases."""
    base, *added = name.split("+")
    if base not in STUDIES:
        raise UserError(f"option --study: there is no study '{base}'; known: {', '.join(STUDIES)}")
    for other in added:
        get_overrides(other)  # raises UserError for an unknown estimator
    every = [
        replace(c, estimators=tuple(dict.fromkeys((*c.estimators, *added)))) for c in _make_cases()[base]
    ]
    names = [c.name for c in every]
    if missing := [case for case in cases if case not in names]:
        raise UserError(f"option --cases: study {base} has no case '{missing[0]}'; known: {', '.join(names)}")
    runs, title = STUDIES[base]
    return Study(name, title, runs, tuple(c for c in every if not cases or c.name in cases))
