"""Propose what to drive or measure next, and predict the intervals of both cornering
stiffnesses that would result.

The predicted covariance is the inverse of a sum: information matrix of the fit of the
logs + information matrix of the proposal. For a manoeuvre, the latter comes from a
simulation, with residuals of the same rms and correlation time as in the logs. For a
measurement of a parameter, it is 1/variance of the measurement.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tse.car.vehicle import Vehicle
from tse.identify.data import BURN_IN, FitStretch, PreparedLog
from tse.identify.fit import CarFit, ResidualScale, build_normal
from tse.identify.problem import LASTING_ERROR_SHARE, CarProblem
from tse.identify.unknowns import CORNERING_AXLES, MEASURED, VELOCITY, make_prior

MANOEUVRE_SPEED = 18.0  # [m/s] 65 km/h: possible on a test track or an empty road
MANOEUVRE_TIME = 40.0  # [s]
STEER_AMPLITUDE = 0.03  # [rad] at the wheels: the tyres remain nearly linear
SWEEP_BAND = (0.2, 3.0)  # [Hz] first and last frequency of the sine sweep
SLALOM_FREQUENCY = 0.6  # [Hz]
STEP_PERIOD = 4.0  # [s] time from step to step of the steering wheel
STEP_RISE = 0.3  # [s] time in which a driver turns the steering wheel for a step
KNOWN_LATENCY = 0.002  # [s] sd of a latency if it is taken from the documentation of the CAN bus
KNOWN_INERTIA = 0.03  # relative sd of the yaw inertia if it is measured on a test bench
KNOWN_PLACE = 0.02  # [m] sd of the position of the velocity sensor if it is measured with a tape measure
# A proposal is listed if it narrows the confidence interval of the cornering stiffness of
# at least one axle to less than this share of its present width
MAX_REMAINING = 0.9


@dataclass(frozen=True)
class Offer:
    """A drive or measurement that is proposed, and the accuracy that would result."""

    what: str  # the proposal in words
    sd: dict[str, float]  # name of a cornering stiffness -> resulting sd of ln(stiffness)


def steer_sweep(t: np.ndarray) -> np.ndarray:
    """Return the steering angle [rad] of a logarithmic sine sweep over SWEEP_BAND."""
    low, high = SWEEP_BAND
    rate = np.log(high / low) / MANOEUVRE_TIME
    return STEER_AMPLITUDE * np.sin(2 * np.pi * low * np.expm1(rate * t) / rate)


def steer_steps(t: np.ndarray) -> np.ndarray:
    """Return the steering angle [rad] of steps, alternately to the left and right."""
    side = np.where((t // STEP_PERIOD).astype(int) % 2, -1.0, 1.0)
    return STEER_AMPLITUDE * side * np.clip((t % STEP_PERIOD) / STEP_RISE * 2 - 1, -1, 1)


def steer_slalom(t: np.ndarray) -> np.ndarray:
    """Return the steering angle [rad] of a slalom, a sine of SLALOM_FREQUENCY."""
    return STEER_AMPLITUDE * np.sin(2 * np.pi * SLALOM_FREQUENCY * t)


_TIME, _SPEED = f"{MANOEUVRE_TIME:g} s", f"{3.6 * MANOEUVRE_SPEED:.0f} km/h"
MANOEUVRES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    f"{_TIME} of sine sweep, {SWEEP_BAND[0]:g} .. {SWEEP_BAND[1]:g} Hz, at {_SPEED}": steer_sweep,
    f"{_TIME} of steps of the steering wheel at {_SPEED}": steer_steps,
    f"{_TIME} of slalom at {_SPEED}": steer_slalom,
}


def list_offers(problem: CarProblem, fit: CarFit, vehicle: Vehicle) -> list[Offer]:
    """Return the proposals that would make a cornering stiffness more accurate.

    The cheapest comes first. A proposal is listed if it narrows the confidence interval
    of the cornering stiffness of at least one axle to less than MAX_REMAINING of its
    present width. Most of the computing time is for partial derivatives of simulations:
    each manoeuvre needs a simulation of 40 s, and the proposal of a measured velocity
    needs simulations of all logs.
    """
    now = compute_axle_sd(problem, fit, _compute_car_information(problem, fit))
    latency_sd = _compute_sd_if_known(problem, fit, _list_latencies(problem), KNOWN_LATENCY)
    inertia_sd = KNOWN_INERTIA * problem.config.yaw_inertia
    found = [
        Offer(f"latencies known to {1000 * KNOWN_LATENCY:g} ms", latency_sd),
        Offer(
            f"yaw inertia known to {100 * KNOWN_INERTIA:g} %",
            _compute_sd_if_known(problem, fit, ["yaw_inertia"], inertia_sd),
        ),
        *(Offer(what, compute_sd_after(problem, fit, steer)) for what, steer in MANOEUVRES.items()),
    ]
    if any(c in problem.channels for c in VELOCITY):
        levers = ["velocity_lever_x", "velocity_lever_y"]
        place = f"position of the velocity sensor known to {100 * KNOWN_PLACE:g} cm"
        found.insert(0, Offer(place, _compute_sd_if_known(problem, fit, levers, KNOWN_PLACE)))
    else:
        found.append(Offer("these drives with an INS", _compute_sd_with_velocity(problem, fit, vehicle)))
    return [o for o in found if any(o.sd[k] < MAX_REMAINING * now[k] for k in CORNERING_AXLES)]


def describe_offers(now: dict[str, float], found: list[Offer]) -> list[str]:
    """Return lines of text: first the present intervals of the cornering stiffnesses,
    then, for each proposed drive or measurement, the intervals that would result. If
    there is no proposal, return an empty list.
    """

    def format_sd(sd: dict[str, float]) -> str:
        return " and ".join(f"+- {196 * sd[k]:.0f}" for k in CORNERING_AXLES) + " %"

    if not found:
        return []
    head = f"Cornering stiffness, front and rear: now {format_sd(now)}. What would narrow the intervals:"
    return [head, *(f"  {o.what}: {format_sd(o.sd)}" for o in found)]


def compute_axle_sd(problem: CarProblem, fit: CarFit, information: np.ndarray) -> dict[str, float]:
    """Return the sd of ln(stiffness) of both axles from an information matrix of the car.

    Keys are the names of the cornering stiffnesses, as in Offer.sd.
    """
    sd = np.sqrt(np.diag(np.linalg.inv(information)))
    sd *= np.abs(problem.compute_ln_slope(fit.search)[: problem.car])
    return {k: float(sd[problem.names.index(k)]) for k in CORNERING_AXLES}


def _compute_car_information(problem: CarProblem, fit: CarFit) -> np.ndarray:
    """Return the information matrix of the unknowns of the car.

    All other unknowns are marginalised: bank and grade of the roads, and for each log its
    biases and lean (share of the lateral acceleration that banked curves compensate).
    """
    n = problem.car
    return np.linalg.inv(np.linalg.inv(fit.equations.information)[:n, :n])


def _list_latencies(problem: CarProblem) -> list[str]:
    """Return the names of the latencies that the documentation of a CAN bus may state."""
    return [n for n in problem.prior.names if n.endswith("_latency") and n != "velocity_latency"]


def _compute_sd_if_known(problem: CarProblem, fit: CarFit, names: list[str], sd: float) -> dict[str, float]:
    """Return the sds (Offer.sd) that would result if the unknowns `names` were measured,
    each with an error of sd `sd`.
    """
    information = _compute_car_information(problem, fit)
    at = [problem.names.index(n) for n in names]
    information[at, at] += sd**-2
    return compute_axle_sd(problem, fit, information)


def compute_sd_after(
    problem: CarProblem, fit: CarFit, steer: Callable[[np.ndarray], np.ndarray]
) -> dict[str, float]:
    """Return the sds (Offer.sd) that result if a manoeuvre is added to the logs.

    `steer` is the steering angle of the manoeuvre as a function of time.
    """
    added = _compute_added_information(problem, fit, [_make_log(problem, steer)], fit.scales)
    return compute_axle_sd(problem, fit, _compute_car_information(problem, fit) + added)


def _compute_sd_with_velocity(problem: CarProblem, fit: CarFit, vehicle: Vehicle) -> dict[str, float]:
    """Return the sds (Offer.sd) that would result if the logs also had a measured lateral
    velocity.

    Its residuals are assumed to have the rms of its slow error, LASTING_ERROR_SHARE times
    ins_velocity_sd, and the same ratio of sd to rms as those of the yaw rate.
    """
    logs = [
        replace(
            log,
            measured=log.measured | {"ins_vel_y": np.zeros(len(log.time))},
            noise=log.noise | {"ins_vel_y": 0.0},
        )
        for log in problem.logs
    ]
    lasting = LASTING_ERROR_SHARE * float(problem.config.ins_velocity_sd)
    yaw = fit.scales["yaw_rate"] if "yaw_rate" in fit.scales else next(iter(fit.scales.values()))
    scales = fit.scales | {"ins_vel_y": ResidualScale(lasting, lasting * yaw.sd / yaw.rms)}
    prior = make_prior(vehicle, problem.config, velocity=True)
    other = CarProblem(logs, problem.config, prior, problem.jobs, problem.road, problem.leans > 0)
    at = dict(zip(problem.names, fit.search, strict=True))
    x = np.array([at.get(n, m) for n, m in zip(other.names, other.mean, strict=True)])
    found = _compute_information(other, x, fit.z, scales)
    own = [other.names.index(n) for n in problem.prior.names]
    return compute_axle_sd(problem, fit, np.linalg.inv(np.linalg.inv(found)[np.ix_(own, own)]))


def _compute_added_information(
    problem: CarProblem, fit: CarFit, logs: list[PreparedLog], scales: dict[str, ResidualScale]
) -> np.ndarray:
    """Return the information matrix that further logs would add for the unknowns of the
    car. It is without the prior, because the fit of the present logs already contains it.
    """
    other = CarProblem(logs, problem.config, problem.prior, problem.jobs)
    x = np.append(fit.search[: problem.car], other.mean[other.car :])
    found, n = _compute_information(other, x, np.zeros(other.knots), scales), problem.car
    return np.linalg.inv(np.linalg.inv(found)[:n, :n]) - problem.information[:n, :n]


def _compute_information(
    problem: CarProblem, x: np.ndarray, z: np.ndarray, scales: dict[str, ResidualScale]
) -> np.ndarray:
    """Return the information matrix of the unknowns x if the residuals of each channel
    have the rms and the weight in `scales`.

    The matrix depends on the partial derivatives of the residuals, not on their values,
    which are unknown for a manoeuvre that was not driven. So all residuals are set to 0.
    """
    base = problem.compute_residuals(x, z)
    slopes = problem.compute_slopes(x, z, base), problem.compute_road_slopes(x, z, base)
    return build_normal(problem, scales, x, z, [np.zeros(len(e)) for e in base], *slopes).information


def _make_log(problem: CarProblem, steer: Callable[[np.ndarray], np.ndarray]) -> PreparedLog:
    """Return a log of a manoeuvre, with the channels of all logs, and the noise sd and
    time step of the first log.

    Its inputs are steering angle and wheel speeds. Its measurements are 0: only partial
    derivatives are needed, which do not depend on measurements.
    """
    like = problem.logs[0]
    time = like.step * np.arange(
        round(MANOEUVRE_TIME / like.step) // like.rows_per_block * like.rows_per_block
    )
    spin = {
        f"wheel_speed_{a}": np.full(len(time), MANOEUVRE_SPEED / getattr(problem.config, f"wheel_radius_{a}"))
        for a in ("front", "rear")
    }
    measured = {c: np.zeros(len(time)) for c in MEASURED if c in problem.channels}
    used = time >= BURN_IN  # moved below to the start of the next block
    used[: int(np.argmax(used)) // like.rows_per_block * like.rows_per_block + like.rows_per_block] = False
    return PreparedLog(
        Path("manoeuvre"), time, {"steer_angle": steer(time), **spin}, measured, like.noise,
        [FitStretch(0, len(time), used)], like.rows_per_block, MANOEUVRE_SPEED * time,
    )  # fmt: skip
