"""Logs whose truth is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import pandas as pd

from tse._vehicle import VehicleLike, read_vehicle
from tse.impl import maneuvers
from tse.impl.core import Config, SimConfig
from tse.impl.simulate import simulate as _simulate
from tse.impl.vehicle import default_vehicle


class Simulated(NamedTuple):
    """A simulated drive; rows belong to each other."""

    log: pd.DataFrame
    """What the sensors say: columns as estimate() takes them."""
    truth: pd.DataFrame
    """What really happened: true_cy_front [N/rad], true_vel_y [m/s] ..."""


def simulate(
    maneuver: str = "double-lane-change",
    vehicle: VehicleLike | None = None,
    *,
    seed: int = 1,
    duration: float | None = None,
    speed: float | None = None,
    amplitude: float | None = None,
    road_changes: Sequence[tuple[float, float]] = (),
    settings: Mapping[str, float] | None = None,
) -> Simulated:
    """Simulate a drive: for trying, and for studies.

    Parameters
    ----------
    maneuver
        A name that `tselab simulate --help` lists.
    vehicle
        As in estimate(); None: the built-in car.
    seed
        Of the random numbers: the same drive again.
    duration, speed, amplitude
        s, m/s, and of the steering, rad (its meaning is in that list); None: as is usual for the manoeuvre.
    road_changes
        (s, factor): from then on all stiffness is nominal times the factor.
    settings
        Any of the simulator (`tselab settings --simulator`) or of the car.

    Returns
    -------
    Simulated
        The log, and the truth.

    Raises
    ------
    Error
        A manoeuvre or a setting that nobody knows, a value outside its range.
    """
    car = default_vehicle() if vehicle is None else read_vehicle(vehicle)
    config, sim = Config(car.values), SimConfig({"seed": seed})
    for name, value in (settings or {}).items():
        (sim if name in sim else config).set(name, value)
    plan = maneuvers.build(
        maneuver, config, sample_time=config.sample_time, duration=duration, speed=speed, amplitude=amplitude,
        road=list(road_changes), seed=seed,
    )  # fmt: skip
    done = _simulate(plan, config, sim, car.driven_axle)
    return Simulated(done.log, done.truth)
