"""Simulate logs whose truth is known, and the car along a log."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from tse._log import LogLike, PathLike, read_checked, read_known_road
from tse._shown import Shown
from tse._vehicle import VehicleLike, check_names, read_vehicle
from tse.car.vehicle import make_default_vehicle
from tse.channels.agree import MAX_CHECKED_ROWS, check_car
from tse.estimation.estimate import write_table
from tse.library.core import Config, SimConfig
from tse.library.errors import UserError
from tse.log.rows import Reading, select_liveliest
from tse.report.plots import draw_lines, set_layout
from tse.report.results import convert_to_plain
from tse.roads.road import Road
from tse.simulation import along, maneuvers
from tse.simulation.simulate import WHEEL_NOISE, Simulation, add_references
from tse.simulation.simulate import simulate as _simulate


class Simulated(NamedTuple):
    """A simulated drive; row n of the log and row n of the truth are of the same time."""

    log: pd.DataFrame
    """Readings of the sensors: columns as estimate() takes them."""
    truth: pd.DataFrame
    """True values: true_cy_front [N/rad], true_vel_y [m/s] ..."""

    def with_references(self) -> pd.DataFrame:
        """Return the log with the truth in columns ref_..., which the page of an estimate
        draws."""
        return add_references(Simulation(self.log, self.truth))

    def write(
        self,
        log: str | os.PathLike[str],
        truth: str | os.PathLike[str] | None = None,
        *,
        with_ref: bool = False,
    ) -> Path:
        """Write the log and the truth as CSV, with the shortest digits that give the same
        bits back.

        Parameters
        ----------
        log, truth
            Files; one that is there is replaced. None: the truth is not written.
        with_ref
            Write with_references() as the log.

        Returns
        -------
        Path
            The file of the log.
        """
        write_table(self.with_references() if with_ref else self.log, Path(log))
        if truth is not None:
            write_table(self.truth, Path(truth))
        return Path(log)


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
    bar: bool = False,
) -> Simulated:
    """Simulate a drive: for trying, and for studies.

    Parameters
    ----------
    maneuver
        A name that `tselab simulate --help` lists.
    vehicle
        As in estimate(); None: the built-in car.
    seed
        Seed of the random numbers: the same seed gives the same drive.
    duration, speed, amplitude
        s, m/s, and usually rad of steering (the list says its meaning); None: usual for
        the manoeuvre.
    road_changes
        (s, factor): from then on all stiffness is nominal times the factor.
    settings
        Any of the simulator (`tselab settings --simulator`) or of the car.
        `wheel_speed_sd` is 0.02 rad/s unless it is set here: real wheel speeds have
        noise, and the filter takes a channel that repeats a number exactly for frozen.
    road
        road.csv: its bank and grade lie under the car, by the distance that it has
        travelled; the log has its positions.
    bar
        Show a progress bar on standard error.

    Returns
    -------
    Simulated
        The log, and the truth.

    Raises
    ------
    Error
        An unknown manoeuvre or setting, or a value outside its range.
    """
    car = make_default_vehicle() if vehicle is None else read_vehicle(vehicle)
    config, sim = Config.exact(car.values), SimConfig({"seed": seed, "wheel_speed_sd": WHEEL_NOISE})
    for name, value in check_names(settings).items():
        (sim if name in sim else config).set(name, value)
    if duration is not None and not config.sample_time <= duration <= maneuvers.MAX_DRIVE_SECONDS:
        raise UserError(
            f"duration: {duration:g} is outside its range {config.sample_time:g} .. "
            f"{maneuvers.MAX_DRIVE_SECONDS:g} s"
        )
    plan = maneuvers.build(
        maneuver,
        config,
        sample_time=config.sample_time,
        duration=duration,
        speed=sim.speed if speed is None and "speed" in check_names(settings) else speed,
        amplitude=amplitude,
        road=list(road_changes),
        seed=int(sim.seed),
    )
    done = _simulate(plan, config, sim, car.driven_axle, bar, read_known_road(road))
    return Simulated(done.log, done.truth)


# ---- along a log


class Replayed(Shown):
    """Measured channels, and the readings of the simulated car."""

    def __init__(self, table: pd.DataFrame, notes: Sequence[str] = (), title: str = "log", vehicle: str = ""):
        self._table, self._title, self._vehicle = table, title, vehicle
        self.notes = tuple(notes)
        """Contradictions of log and car, and where the log is on the road, in words."""

    def to_frame(self) -> pd.DataFrame:
        """Return the rows: time, accel_x, accel_y, yaw_rate as logged, and simulated with
        the end _simulated; vel_x, vel_y."""
        return self._table

    def apart(self) -> dict[str, along.ModelMisfit]:
        """Return how far measured and simulated are apart, above 3 m/s.

        Returns
        -------
        dict
            By channel: rms without the mean, which is the sensor's bias; that over the
            white noise of the channel in this log; the mean; the unit. NaN: the log does
            not have the channel.
        """
        return along.measure_misfit(self._table)

    def to_dict(self) -> dict[str, Any]:
        """Return apart() and the notes, as `tselab replay --json` has them."""
        parts = {c: asdict(a) for c, a in self.apart().items()}
        found: dict[str, Any] = convert_to_plain({"apart": parts, "notes": self.notes})
        return found

    @property
    def words(self) -> tuple[str, ...]:
        """apart() in sentences."""
        return along.describe_misfit(self.apart())

    def plot(self) -> Any:
        """Return a figure of plotly: measured and simulated over time."""
        return draw_lines(along.list_curves(self._table))

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the page of `tselab replay`."""
        from tse.report.report import write_page  # jinja: for those who write pages

        text = "Drag to zoom, double-click to reset; nothing is fitted."
        sections = [("Measured and simulated", text, set_layout(self.plot(), 620))]
        title = f"{self._title}, measured and simulated"
        write_page(
            Path(path), "replay.html.j2", sections, title=title, vehicle=self._vehicle, words=self.words
        )
        return Path(path)

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the rows as CSV."""
        write_table(self._table, Path(path))
        return Path(path)


def replay(
    log: LogLike,
    vehicle: VehicleLike,
    *,
    settings: Mapping[str, float] | None = None,
    road: PathLike | Road | None = None,
    reading: Reading | None = None,
) -> Replayed:
    """Simulate the car along a log.

    The single-track model with the effects of the car is driven by the logged steering
    angle and wheel speeds.

    Parameters
    ----------
    log
        A file, a frame, or what read_log() returned. Rows without a steering angle or
        wheel speed are interpolated between their neighbours. Channels that the settings
        of the car call late (accel_y_latency) are simulated as late.
    vehicle
        As in estimate().
    settings
        Any settings by name; they win.
    road
        road.csv, whose bank and grade lie under the car; None: level, but for columns
        bank and grade of the log.
    reading
        How a file is read: signals, rate, strict, databases.

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
    config = Config.exact(car.values)
    for name, value in check_names(settings).items():
        config.set(name, value)
    rows, placed = read_checked(log, car, reading=reading), list[str]()
    profile = read_known_road(road)
    if profile is not None:
        from tse.roads.road_match import add_road

        rows, _ = add_road(rows, profile, config)
        placed = [rows.notes[-1]]
    notes = [*check_car(select_liveliest(rows, MAX_CHECKED_ROWS), car, config), *placed]
    return Replayed(along.simulate_along(rows, config), notes, rows.path.name, car.name)
