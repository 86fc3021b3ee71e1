"""Simulate a manoeuvre and return a log with the true values: simulate(). Simulate a car
that is driven by the inputs of a measured log: replay()."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from tse.api.log import LogLike, PathLike, read_checked, read_known_road
from tse.api.shown import Shown
from tse.api.vehicle import VehicleLike, check_names, read_vehicle
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
    """Result of simulate(): log and truth. Both tables have a row for each time, in the
    same order."""

    log: pd.DataFrame
    """Sensor readings, with the columns that estimate() expects."""
    truth: pd.DataFrame
    """True values: true_cy_front [N/rad], true_vel_y [m/s] ..."""

    def with_references(self) -> pd.DataFrame:
        """Return the log with the truth added as columns ref_... The page of
        Result.report() draws these columns as reference."""
        return add_references(Simulation(self.log, self.truth))

    def write(
        self,
        log: str | os.PathLike[str],
        truth: str | os.PathLike[str] | None = None,
        *,
        with_ref: bool = False,
    ) -> Path:
        """Write log and truth as CSV. Each number has the fewest digits from which the
        same bits can be read back.

        Parameters
        ----------
        log, truth
            The files. Existing files are replaced. None: the truth is not written.
        with_ref
            Whether the log also gets the columns ref_... of with_references().

        Returns
        -------
        Path
            `log`.
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
    """Simulate a drive, to try out the estimator and for studies.

    Parameters
    ----------
    maneuver
        A name that `tselab simulate --help` lists.
    vehicle
        As in estimate(). None: the built-in car.
    seed
        Seed of the random numbers. The same seed gives the same drive.
    duration, speed, amplitude
        Duration [s], initial speed [m/s] and amplitude of the manoeuvre. The amplitude is
        usually an angle of the road wheels [rad]; `tselab simulate --help` gives its
        meaning and unit. None: the manoeuvre's own value.
    road_changes
        Pairs (time [s], factor). From the time of a pair on, every stiffness is the
        factor of this pair times its nominal value.
    settings
        Any settings of the simulator (`tselab settings --simulator`) or of the car.
        If `wheel_speed_sd` is not given here, it is 0.02 rad/s, as for real sensors. With
        0, the wheel speeds of a steady drive would be constant, which the filter takes
        for a frozen sensor.
    road
        Road that the car drives on: a file road.csv or a Road. Each row has the bank and
        grade of the road at the distance travelled. If the road has positions, the log
        also has columns with the position of the car.
    bar
        Show a progress bar on standard error.

    Returns
    -------
    Simulated
        Log and truth.

    Raises
    ------
    Error
        A manoeuvre or setting is unknown, or a value is outside its range.
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


# ---- Simulate the car with the inputs of a log


class Replayed(Shown):
    """Result of replay(): measured channels, and the same
    channels of the simulated car."""

    def __init__(self, table: pd.DataFrame, notes: Sequence[str] = (), title: str = "log", vehicle: str = ""):
        self._table, self._title, self._vehicle = table, title, vehicle
        self.notes = tuple(notes)
        """Sentences about contradictions between log and car, and about the part of the
        road on which the log was driven."""

    def to_frame(self) -> pd.DataFrame:
        """Return the rows. Columns: time; logged accel_x, accel_y and yaw_rate; the
        simulated values of these three channels, in columns that end in _simulated; and
        vel_x and vel_y, which are simulated."""
        return self._table

    def apart(self) -> dict[str, along.ModelMisfit]:
        """Return the differences between measured and simulated channels above 3 m/s.

        Returns
        -------
        dict
            Key: channel. Value: a ModelMisfit of the difference measured minus simulated:
            `mean` (it contains the bias of the sensor), `rms` about this mean,
            `over_noise` (rms / sd of the white noise of the channel in this log), and
            `unit`. All numbers are NaN if no row above 3 m/s has the channel.
        """
        return along.measure_misfit(self._table)

    def to_dict(self) -> dict[str, Any]:
        """Return what `tselab replay --json` prints, as a dict: the result of apart(),
        and the notes."""
        parts = {c: asdict(a) for c, a in self.apart().items()}
        found: dict[str, Any] = convert_to_plain({"apart": parts, "notes": self.notes})
        return found

    @property
    def words(self) -> tuple[str, ...]:
        """Sentences about the differences of measured and simulated channels
        (apart())."""
        return along.describe_misfit(self.apart())

    def plot(self) -> Any:
        """Return a plotly figure: measured and simulated channels over time."""
        return draw_lines(along.list_curves(self._table))

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the HTML page that `tselab replay` writes."""
        from tse.report.report import write_page  # imports jinja, which is slow

        text = "Drag to zoom, double-click to reset. No parameter is fitted to this log."
        sections = [("Measured and simulated", text, set_layout(self.plot(), 620))]
        title = f"{self._title}, measured and simulated"
        write_page(
            Path(path), "replay.html.j2", sections, title=title, vehicle=self._vehicle, words=self.words
        )
        return Path(path)

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the rows of to_frame() as CSV."""
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
    """Simulate the car with the inputs of a log, to compare it with the measurements.

    The inputs are the logged steering angle and wheel speeds. The model is the
    single-track model with the effects of the car.

    Parameters
    ----------
    log
        A file, a data frame, or the result of read_log(). Missing steering angles
        and wheel speeds are interpolated between neighbouring rows. A channel
        that has a latency in the settings of the car (such as accel_y_latency) is
        simulated with this delay.
    vehicle
        As in estimate().
    settings
        Any settings by name. They override those of the vehicle.
    road
        Bank and grade of the road: a file road.csv or a Road. None: the columns bank and
        grade of the log are used; if it has no such columns, the road is level.
    reading
        Options for reading a file: signals, rate, strict, databases.

    Returns
    -------
    Replayed
        The result. The simulated channels have no noise and no bias, and
        the stiffness is constant.

    Raises
    ------
    Error
        Rows are more than 1 s apart, or a value is outside its range. The error is also a
        ValueError.
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
