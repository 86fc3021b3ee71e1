"""Residuals of the simulation in three stages, in the units of the sensors: with
the vehicle file, after calibrating the parameters that every car has, and with
the named effects."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tse.car.vehicle import Vehicle
from tse.gaps.catalogue import Key
from tse.gaps.problem import Problem
from tse.identify import problem as car
from tse.identify.data import PreparedLog, remove_latencies
from tse.identify.fit import fit
from tse.identify.unknowns import CHANNEL_UNIT, LATENCIES, STIFFNESS, make_prior
from tse.library.core import Config

# Parameters that the second stage calibrates: the unknowns of a calibration that every
# car has and that are no effects of the catalogue. Biases are fitted in all stages.
EVERY_CAR = (*LATENCIES, "steering_ratio_change", "steering_offset_angle", "yaw_inertia", *STIFFNESS)


@dataclass(frozen=True)
class Stage:
    """Rms values of one channel over some logs, computed from means over 40 ms."""

    signal: float  # of the measurement about its mean in each log
    filed: float  # of the residual with the vehicle file
    calibrated: float  # of the residual after calibrating EVERY_CAR
    named: float  # of the residual with the named effects
    noise: float  # of the sensor noise

    @property
    def explained(self) -> float:
        """Share of the signal's mean square that the last stage explains."""
        return 1.0 - (self.named / max(self.signal, 1e-300)) ** 2


def calibrate_every_car(ready: Sequence[PreparedLog], config: Config, vehicle: Vehicle, jobs: int) -> Config:
    """Return the car with the parameters EVERY_CAR fitted on level roads. `ready` are the
    logs that data.prepare() returns.
    """
    prior = make_prior(vehicle, config).select(EVERY_CAR)
    problem = car.CarProblem(
        [log for log in ready if log.stretches], config, prior, jobs, road=False, lean=False
    )
    return car.make_known_car(problem, fit(problem).search)


def compute_stages(
    level: Problem, ready: Sequence[PreparedLog], found: Config, named: tuple[Problem, Mapping[Key, float]]
) -> dict[str, Stage]:
    """Return the rms values of each channel of some logs.

    Parameters
    ----------
    level
        The logs on level roads, with the car of the vehicle file.
    ready
        The same logs as data.prepare() returns them.
    found
        The car of calibrate_every_car().
    named
        The logs on the roads that were found, and the values of the named effects.
    """
    again = Problem([remove_latencies(log, found) for log in ready], found, level.jobs)
    left = [
        level.subtract_bias(level.predict({}) - np.nan_to_num(level.measured)),
        again.subtract_bias(again.predict({}) - np.nan_to_num(again.measured)),
        named[0].subtract_bias(named[0].predict(named[1]) - np.nan_to_num(named[0].measured)),
    ]
    signal = level.subtract_bias(np.nan_to_num(level.measured))

    def rms(x: np.ndarray) -> float:
        return float(np.sqrt(np.mean(x**2)))

    return {
        c: Stage(rms(signal[rows]), *(rms(e[rows]) for e in left), rms(1.0 / level.weight[rows]))
        for c, rows in level.used()
    }


def describe_channels(channels: Mapping[str, Stage], title: str) -> list[str]:
    """Return a heading for a part of the logs, and a line for each channel."""
    head = f"Error of the simulation, {title}: vehicle file, calibrated, with named effects (noise)"
    rows = [
        f"  {c + ',':<10}{CHANNEL_UNIT[c]:<6}  {s.filed:<8.3g}{s.calibrated:<8.3g}{s.named:<8.3g}"
        f"({s.noise:.2g})"
        for c, s in channels.items()
    ]
    return [head, *rows]


def describe_stages(found: Mapping[str, Mapping[str, Stage]], title: Callable[[str], str]) -> list[str]:
    """Return a sentence for each channel of each part of the logs. `title` returns the
    name of a part.
    """
    return [
        f"{c} of {title(part)}: rms error {s.filed:.3g} {CHANNEL_UNIT[c]} with the vehicle file, "
        f"{s.calibrated:.3g} calibrated, {s.named:.3g} with the named effects; sensor noise {s.noise:.2g}. "
        f"The model explains {100 * s.explained:.1f} % of the signal's mean square."
        for part, channels in found.items()
        for c, s in channels.items()
    ]
