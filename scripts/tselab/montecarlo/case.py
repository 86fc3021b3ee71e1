"""A case of a study, and the simulation of its drives.

A case is a manoeuvre with settings and faults of the log (class Case). For each seed of
the random numbers, the case is simulated once. The result is a drive, and all estimators
of the case run on it.
"""

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from tse.library.core import INPUT, STIFFNESS, Config, SimConfig, library
from tse.simulation.maneuvers import Maneuver
from tse.simulation.simulate import drive as run_simulator

# Settings of all cases. The estimators start from 70 % of the nominal stiffness. The car
# has front-wheel drive, because all manoeuvres have torque on the front axle. Small
# angles are assumed (exact_kinematics_share 0), as in equations (1) to (4) of the paper
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
    """A case of a study: manoeuvre, settings, faults of the log,
    and windows of the scores."""

    name: str
    title: str
    # function (car, settings of the simulator, random generator) that
    # returns the manoeuvre
    build: Builder
    config: Mapping[str, float] = field(default_factory=dict)  # settings of car and estimator
    # factors by which settings of the simulated car are multiplied. The estimators get
    # the settings without these factors
    car: Mapping[str, float] = field(default_factory=dict)
    sim: Mapping[str, float] = field(default_factory=dict)  # settings of the simulator
    # function that draws settings of the estimator at random, and returns them. It has
    # the same arguments as `build`. None: no setting is random
    draw: Draw | None = None
    # function (times, rows, random generator) that falsifies rows of the log in place,
    # and returns a bool for each row. True: an estimator should report this row as not
    # valid, and its errors in this row are not scored. None: the log is not falsified
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
    about: dict[str, float]  # settings of the case; they override settings of the user
    config: Config  # settings of the estimator "tse"
    car: Config  # true parameters of the car
    sim: SimConfig
    events: tuple[float, ...] = ()  # [s] as in Case
    friction: float = 0.0  # friction coefficient of the tyres; 0: the tyres are linear

    @property
    def stiffness(self) -> np.ndarray:
        """(rows, 3) true mean of each stiffness, relative to nominal."""
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
