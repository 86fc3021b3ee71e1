"""Compute the rms of the residuals of each channel, in the unit of the channel, in three
stages: with the vehicle file, after a calibration of the parameters that every car has,
and with the named effects. Named effects are those that the search (infer/naming.py)
reports as missing in the vehicle file. The last stage also has the estimated roads and,
if a formula is proposed, the formula.
"""

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

# Parameters that are calibrated in the second of the three stages (top of this file).
# Every car has them, and no vehicle file states them exactly. Sensor biases are fitted in
# all three stages.
EVERY_CAR = (*LATENCIES, "steering_ratio_change", "steering_offset_angle", "yaw_inertia", *STIFFNESS)


@dataclass(frozen=True)
class Stage:
    """Rms values of one channel in the fitted or in the held-out logs, in the unit of the
    channel. Each rms is that of means over blocks of 40 ms.
    """

    signal: float  # rms of the measurements after subtraction of the mean of each log
    filed: float  # rms of the residuals with the vehicle file
    calibrated: float  # rms of the residuals after a calibration of the parameters in EVERY_CAR
    named: float  # rms of the residuals with the named effects
    noise: float  # rms of the sensor noise in a block mean

    @property
    def explained(self) -> float:
        """Share of the signal's mean square that the last stage (`named`) explains."""
        return 1.0 - (self.named / max(self.signal, 1e-300)) ** 2


def calibrate_every_car(ready: Sequence[PreparedLog], config: Config, vehicle: Vehicle, jobs: int) -> Config:
    """Fit the parameters EVERY_CAR with all roads assumed level, and return the settings
    of the car with the fitted values. `ready` has the logs from data.prepare().
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
        The same logs, as returned by data.prepare().
    found
        The car that calibrate_every_car() returned.
    named
        The logs on the estimated roads, and the fitted values with the named effects.
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
    """Return lines of text: a heading, and for each channel the rms values of its Stage.

    `title` describes the part of the logs (fitted or held out) in the heading.
    """
    head = f"Error of the simulation, {title}: vehicle file, calibrated, with named effects (noise)"
    rows = [
        f"  {c + ',':<10}{CHANNEL_UNIT[c]:<6}  {s.filed:<8.3g}{s.calibrated:<8.3g}{s.named:<8.3g}"
        f"({s.noise:.2g})"
        for c, s in channels.items()
    ]
    return [head, *rows]


def describe_stages(found: Mapping[str, Mapping[str, Stage]], title: Callable[[str], str]) -> list[str]:
    """Return a sentence for each channel of each part of the logs. `title` converts
    the name of a part to its description in the sentence.
    """
    return [
        f"{c} of {title(part)}: rms error {s.filed:.3g} {CHANNEL_UNIT[c]} with the vehicle file, "
        f"{s.calibrated:.3g} calibrated, {s.named:.3g} with the named effects; sensor noise {s.noise:.2g}. "
        f"The model explains {100 * s.explained:.1f} % of the signal's mean square."
        for part, channels in found.items()
        for c, s in channels.items()
    ]
