"""Logs whose truth is known, and the car simulated along a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import pandas as pd

from tse._log import LogLike, PathLike, checked, known_road
from tse._shown import Shown
from tse._vehicle import VehicleLike, named, read_vehicle
from tse.car.vehicle import make_default_vehicle
from tse.library.core import Config, SimConfig
from tse.library.errors import UserError
from tse.report.plots import lines
from tse.roads.road import Road
from tse.simulation import along, maneuvers
from tse.simulation.simulate import simulate as _simulate


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
    road: PathLike | Road | None = None,
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
    road
        road.csv: its bank and grade lie under the car, by the distance that it has
        travelled; the log has its positions.

    Returns
    -------
    Simulated
        The log, and the truth.

    Raises
    ------
    Error
        A manoeuvre or a setting that nobody knows, a value outside its range.
    """
    car = make_default_vehicle() if vehicle is None else read_vehicle(vehicle)
    config, sim = Config.exact(car.values), SimConfig({"seed": seed})
    for name, value in named(settings).items():
        (sim if name in sim else config).set(name, value)
    if duration is not None and not config.sample_time <= duration <= maneuvers.MAX_DRIVE_SECONDS:
        raise UserError(
            f"duration: {duration:g} is outside its range {config.sample_time:g} .. {maneuvers.MAX_DRIVE_SECONDS:g} s"
        )
    plan = maneuvers.build(
        maneuver, config, sample_time=config.sample_time, duration=duration,
        speed=sim.speed if speed is None and "speed" in named(settings) else speed,
        amplitude=amplitude, road=list(road_changes), seed=int(sim.seed),
    )  # fmt: skip
    done = _simulate(plan, config, sim, car.driven_axle, road=known_road(road))
    return Simulated(done.log, done.truth)


# ---- along a log: what its sensors should have read


class Replayed(Shown):
    """What was measured, and what the car of the settings would have read."""

    def __init__(self, table: pd.DataFrame):
        self._table = table

    def to_frame(self) -> pd.DataFrame:
        """Return the rows: time, accel_x, accel_y, yaw_rate as logged, and simulated with the end _simulated; vel_x, vel_y."""
        return self._table

    def apart(self) -> dict[str, along.ModelMisfit]:
        """How far measured and simulated are apart, above 3 m/s.

        Returns
        -------
        dict
            By channel: rms without the mean, which is the sensor's bias; that over the white noise of the channel in this log;
            the mean; the unit. NaN: the log does not have it.
        """
        return along.measure_misfit(self._table)

    @property
    def words(self) -> tuple[str, ...]:
        """The same in words."""
        return along.describe_misfit(self.apart())

    def plot(self) -> Any:
        """Return a figure of plotly: measured and simulated over time."""
        return lines(along.list_curves(self._table))


def replay(
    log: LogLike,
    vehicle: VehicleLike,
    *,
    settings: Mapping[str, float] | None = None,
    road: PathLike | Road | None = None,
) -> Replayed:
    """Simulate the car along a log: its steering angle and wheel speeds drive the single-track model, with the car's effects.

    Parameters
    ----------
    log
        A file, a frame, or what read_log() returned. Rows without a steering angle or wheel speed take the line between their
        neighbours; channels that the car's settings call late (accel_y_latency) are simulated as late.
    vehicle
        As in estimate().
    settings
        Any settings by name; they win.
    road
        road.csv, whose bank and grade lie under the car; None: level, but for columns
        bank and grade of the log.

    Returns
    -------
    Replayed
        Deterministic: no noise, constant stiffness, no bias.

    Raises
    ------
    Error
        Rows are more than 1 s apart, or a value is outside its range; a ValueError.
    """
    car = read_vehicle(vehicle)
    rows, config = checked(log, car), Config.exact(car.values)
    for name, value in named(settings).items():
        config.set(name, value)
    profile = known_road(road)
    if profile is not None:
        from tse.roads.road_match import add_road

        rows, _ = add_road(rows, profile, config)
    return Replayed(along.simulate_along(rows, config))
