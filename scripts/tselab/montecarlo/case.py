"""A case of a study, and one drive of it: simulated once per seed, read by every
estimator."""

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from tse.library.core import INPUT, STIFFNESS, Config, SimConfig, library
from tse.simulation.maneuvers import Maneuver
from tse.simulation.simulate import drive as run_simulator

# Torque is on the front axle in all manoeuvres; the car is that of the paper, (1)-(4).
START = {**{f"initial_{s}": 0.7 for s in STIFFNESS}, "driven_axle": 1, "exact_kinematics_share": 0.0}
WINDOW = (15.0, 30.0)  # s, where errors count unless the case says otherwise
G = 9.81  # m/s2
LINEAR = 0.6  # share of the friction limit beyond which a tyre counts as no longer linear

Builder = Callable[[Config, SimConfig, np.random.Generator], Maneuver]
Corruption = Callable[[np.ndarray, np.ndarray, np.random.Generator], np.ndarray]
Draw = Callable[[Config, SimConfig, np.random.Generator], Mapping[str, float]]


@dataclass(frozen=True)
class Case:
    """Manoeuvre, settings of the estimator, faults of the log, and the window of the
    scores."""

    name: str
    title: str
    build: Builder
    config: Mapping[str, float] = field(default_factory=dict)  # the car, and settings of the estimator
    car: Mapping[str, float] = field(
        default_factory=dict
    )  # factors on the car's settings of which nobody tells
    sim: Mapping[str, float] = field(default_factory=dict)  # the simulator
    draw: Draw | None = None  # further settings of the estimator that depend on the seed
    corrupt: Corruption | None = None  # changes the log; returns which rows it made unusable
    estimators: tuple[str, ...] = ("tse",)
    windows: tuple[tuple[float, float], ...] = (WINDOW,)
    events: tuple[float, ...] = ()  # s: from here on another truth has to be found
    lasts: float = 0.0  # s that the truth goes on changing after an event


@dataclass
class CaseDrive:
    """One simulated drive, as it was and as it was logged."""

    time: np.ndarray
    rows: np.ndarray  # the log
    truth: np.ndarray  # outputs of the simulator
    road: np.ndarray
    corrupted: np.ndarray  # rows of which the log does not tell the truth
    about: dict[str, float]  # settings that are the case's, not the user's or the estimator's
    config: Config  # settings of an estimator that has none of its own
    car: Config  # the car
    sim: SimConfig
    events: tuple[float, ...] = ()  # of the case
    friction: float = 0.0  # at which tyre forces saturate; 0: nowhere

    @property
    def stiffness(self) -> np.ndarray:
        """True mean stiffness, relative to nominal, (n, 3)."""
        return np.column_stack([self.truth[f"true_{s}"] for s in STIFFNESS]).astype(float)


def simulate_case(
    case: Case, seed: int, configure: Callable[[Mapping[str, float]], Config], sim: Mapping[str, float]
) -> CaseDrive:
    """Drive the case with a seed. `configure` completes what the case says about the
    estimator; what the case is about wins over the user's settings."""
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
