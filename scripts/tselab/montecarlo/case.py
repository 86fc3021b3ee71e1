"""A case of a study, and the simulation of its drives.

A case (class Case) is a manoeuvre with settings of car, simulator and estimators, and
with faults of the log. Each seed of the random numbers gives one simulated drive of the
case (class CaseDrive). All estimators of the case run on this drive.
"""

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from tse.library.core import INPUT, STIFFNESS, Config, SimConfig, library
from tse.simulation.maneuvers import Maneuver
from tse.simulation.simulate import drive as run_simulator

# Settings of all cases, for the simulated car and for the estimators. The estimators
# start from 70 % of the nominal stiffness. The car has front-wheel drive, because all
# manoeuvres have drive torque on the front axle. Simulator and estimators assume small
# angles (exact_kinematics_share 0), as equations (1) to (4) of the paper do
INITIAL_SETTINGS = {
    **{f"initial_{s}": 0.7 for s in STIFFNESS},
    "driven_axle": 1,
    "exact_kinematics_share": 0.0,
}
# [s] start and end of the interval of the drive in which errors are scored by default
SCORED_WINDOW = (15.0, 30.0)
# Max ratio of tyre force to friction limit in the linear range of a tyre. The force is
# that of a linear tyre: stiffness * slip. Rows with a larger ratio are not scored,
# because the paper's model has linear tyres
LINEAR = 0.6

# Types of the functions in the fields build, corrupt and draw of Case. The comments at
# these fields describe the arguments
Builder = Callable[[Config, SimConfig, np.random.Generator], Maneuver]
Corruption = Callable[[np.ndarray, np.ndarray, np.random.Generator], np.ndarray]
Draw = Callable[[Config, SimConfig, np.random.Generator], Mapping[str, float]]


@dataclass(frozen=True)
class Case:
    """A case of a study: manoeuvre, settings, faults of the log, and the time windows in
    which the errors of the estimates are scored."""

    name: str
    title: str
    # function (car, settings of the simulator, random generator) that
    # returns the manoeuvre
    build: Builder
    config: Mapping[str, float] = field(default_factory=dict)  # settings of car and estimator
    # key: setting of the car; value: factor by which the setting of the simulated car is
    # multiplied. The estimators get the setting without the factor, i.e. a wrong value
    car: Mapping[str, float] = field(default_factory=dict)
    sim: Mapping[str, float] = field(default_factory=dict)  # settings of the simulator
    # function that draws settings of the estimator at random, and returns them. It has
    # the same arguments as `build`. None: no setting is random
    draw: Draw | None = None
    # function (times, rows, random generator) that falsifies rows of the log in place,
    # and returns a bool for each row. True: an estimator should flag its estimates in
    # this row as not valid, and errors in this row are not scored. None: no row is
    # falsified
    corrupt: Corruption | None = None
    estimators: tuple[str, ...] = ("tse",)
    windows: tuple[tuple[float, float], ...] = (SCORED_WINDOW,)  # [s] windows in which errors are scored
    events: tuple[float, ...] = ()  # [s] times at which the true stiffness changes
    lasts: float = 0.0  # [s] duration of each change in `events`; 0: the changes are steps


@dataclass
class CaseDrive:
    """One simulated drive: the truth and the log."""

    time: np.ndarray  # [s]
    rows: np.ndarray  # the log, as inputs of the library
    truth: np.ndarray  # outputs of the simulator
    road: np.ndarray  # (rows,) factor by which the road surface multiplies every stiffness
    corrupted: np.ndarray  # (rows,) True: a fault has made the row unusable (Case.corrupt)
    about: dict[str, float]  # settings of this case; they override those of the option --set
    config: Config  # all settings of the estimator "tse", which include `about`
    car: Config  # true parameters of the car
    sim: SimConfig
    events: tuple[float, ...] = ()  # [s] as in Case
    friction: float = 0.0  # friction coefficient of the tyres; 0: the tyres are linear

    @property
    def stiffness(self) -> np.ndarray:
        """(rows, 3) true stiffness at zero slip, without its random variation from sample
        to sample, relative to nominal."""
        return np.column_stack([self.truth[f"true_{s}"] for s in STIFFNESS]).astype(float)


def simulate_case(
    case: Case, seed: int, configure: Callable[[Mapping[str, float]], Config], sim: Mapping[str, float]
) -> CaseDrive:
    """Simulate the drive of a case with a seed.

    `configure`: function that takes the settings of the case, adds the user's settings,
    and returns all settings of the estimator "tse". If case and user give the same
    setting, the value of the case is used. `sim`: the user's settings of the
    simulator."""
    rng = np.random.default_rng([seed, zlib.crc32(case.name.encode())])
    about: dict[str, float] = {**case.config, "seed": seed}
    car, sim_config = configure(about), SimConfig({**sim, **case.sim, "seed": seed})
    for name, factor in case.car.items():
        car.set(name, getattr(car, name) * factor)
    maneuver = case.build(car, sim_config, rng)
    sim_config.speed = maneuver.speed
    if case.draw:
        about |= case.draw(car, sim_config, rng)

    inputs, truth = run_simulator(maneuver, car, sim_config)
    rows = np.zeros(len(inputs), library().dtype(INPUT))
    rows["dt"] = inputs["dt"]
    for f in library().channels:
        rows[f.name] = truth[f.name]
    corrupted = case.corrupt(maneuver.time, rows, rng) if case.corrupt else np.zeros(len(rows), bool)
    return CaseDrive(
        maneuver.time,
        rows,
        truth,
        maneuver.road_level,
        corrupted,
        about,
        configure(about),
        car,
        sim_config,
        case.events,
        sim_config.friction,
    )
