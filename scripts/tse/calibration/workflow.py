"""Calibrate a car: read and prepare logs, fit, and test the result on held-out logs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tse.calibration.result import (
    CalibrationResult,
    Proof,
    ProofChannel,
    group_findings,
    list_findings,
    list_stated,
)
from tse.car.vehicle import SHAPE, Vehicle, fill_sensors, get_ordinary_car, read_vehicle
from tse.channels.agree import read_agreeing
from tse.identify import advice
from tse.identify.data import PreparedLog, add_missing_channels, average_blocks, prepare
from tse.identify.fit import CarFit, fit
from tse.identify.laps import find_laps
from tse.identify.problem import LEAN, SPEED_TIME, CarProblem, make_known_car
from tse.identify.slip import apply_slip_regression, describe_slip
from tse.identify.unknowns import MEASURED, SUPERELEVATION, VELOCITY, make_prior, name_in_log
from tse.library.core import Config
from tse.library.errors import UserError
from tse.log.noise import MIN_MOVING_SPEED, estimate_noise
from tse.log.rows import DRIVES, CheckedLog, Reading
from tse.roads.road import Road
from tse.roads.road_match import add_road

Say = Callable[[str], None]
# [s] Min sd of the calibrated steering delay (setting steer_lag_sd). Logs cannot
# determine the delay more accurately, because an error in the modelled tyre relaxation,
# or in another modelled lag, changes the channels like an error in the steering delay.
MIN_LAG_SD = 0.003
# [rad/s/sqrt(s)] Max sd of the random walk of the gyro bias. If the residuals give a
# larger value, model errors in turns cause it, not the gyro.
MAX_GYRO_WALK = 0.001
# Min number of differences between successive distinct values of a channel. With fewer,
# the quantisation step cannot be found, and the channel is treated as not quantised.
MIN_STEPS = 10


def run(
    logs: Sequence[Path | CheckedLog],
    vehicle: Path | Vehicle,
    held_out: Sequence[Path | CheckedLog],
    jobs: int,
    say: Say,
    max_steps: int | None = None,
    reading: Reading | None = None,
    road: Road | None = None,
) -> CalibrationResult:
    """Calibrate a car, and compare the result with the logs.

    Parameters
    ----------
    logs, held_out
        Logs that are fitted, and logs that only test the result.
    vehicle
        The car, or the path of its vehicle file.
    jobs
        Number of threads.
    say
        Called with each line of progress.
    max_steps
        Max number of steps of the search; None: the limit of fit().
    reading
        Options for reading the logs; None: the defaults. Its member `car` is replaced by
        `vehicle`.
    road
        The road of all logs, if it is known. None: bank and grade are fitted.
    """
    if isinstance(vehicle, Path):
        vehicle = read_vehicle(vehicle)
    notes: list[str] = []
    reading = replace(reading or Reading(), car=vehicle)
    read = place_on_known(road, read_agreeing(logs, notes, reading), vehicle)
    problem = _make_problem(read, vehicle, jobs, notes, say)
    result = apply_slip_regression(problem, fit(problem, say=say, max_steps=max_steps), read, vehicle)

    say("testing the result")
    proofs = _prove_fitted(problem, result)
    if held_out:
        others = place_on_known(road, read_agreeing(held_out, notes, reading), vehicle)
        held = _prepare_logs(others, problem.config, notes, say)
        proofs += _prove_held_out(problem, result, [log for log in held if log is not None])
    return _make_result(vehicle, problem, result, read, proofs, notes)


def place_on_known(road: Road | None, logs: Sequence[CheckedLog], vehicle: Vehicle) -> list[CheckedLog]:
    """Return the logs with bank and grade of a known road. If `road` is None, the logs
    are returned unchanged. Raise UserError if a log is not on this road."""
    if road is None:
        return list(logs)
    config = Config.exact(vehicle.values)
    return [add_road(log, road, config)[0] for log in logs]


def calibrate_logs(
    logs: Sequence[CheckedLog],
    vehicle: Vehicle,
    say: Say = lambda _: None,
    min_seconds: float = 0.0,
    notes: Sequence[str] = (),
) -> CalibrationResult:
    """Calibrate on logs that have been read and checked, without testing the result.
    `say` is called with each line of progress, and `notes` become the first notes of the
    result.

    Raises
    ------
    UserError
        Less than `min_seconds` seconds of the logs can be compared with a simulation.
    """
    notes = list(notes)
    problem = _make_problem(logs, vehicle, 1, notes, say)
    if (seconds := sum(log.seconds for log in problem.logs)) < min_seconds:
        raise UserError(
            f"{seconds:.0f} s of the logs can be compared with a simulation, {min_seconds:.0f} s are needed: "
            "use logs of a longer drive"
        )
    result = apply_slip_regression(problem, fit(problem, say=say), logs, vehicle)
    return _make_result(vehicle, problem, result, logs, [], notes)


def _make_problem(
    logs: Sequence[CheckedLog], vehicle: Vehicle, jobs: int, notes: list[str], say: Say
) -> CarProblem:
    """Prepare the logs and build the problem for fit(): residuals and unknowns. If a log
    cannot be used, the reason is added to `notes`."""
    stated = dict(vehicle.values)
    fill_sensors(vehicle, logs[0])
    config = Config.exact(vehicle.values)
    vehicle.values = stated
    if SHAPE not in stated:
        setattr(config, SHAPE, get_ordinary_car(config)[SHAPE])
    ready = _prepare_logs(logs, config, notes, say)
    if not any(p is not None and p.stretches for p in ready):
        raise UserError("; ".join(notes) or "no log has rows that can be compared with a simulation")
    velocity = any(c in log.measured for log in ready if log is not None for c in VELOCITY)
    usable = [(one, log) for one, log in zip(ready, logs, strict=True) if one is not None and one.stretches]
    knots = find_laps([log for _, log in usable], config).lay_knots()
    problem = CarProblem(
        [one for one, _ in usable], config, make_prior(vehicle, config, velocity), jobs, knots
    )
    if not problem.groups:
        raise UserError(
            f"no log has enough samples of any of {', '.join(MEASURED)} to compare them with a simulation: "
            "log at least one of these channels during the whole drive"
        )
    return problem


def _make_result(
    vehicle: Vehicle,
    problem: CarProblem,
    result: CarFit,
    logs: Sequence[CheckedLog],
    proofs: list[Proof],
    notes: list[str],
) -> CalibrationResult:
    """Return the result of a calibration: the fit, the value of each fitted parameter
    before and after the fit, the misfits `proofs`, the sensor settings, the quantisation
    steps of the channels, and proposals for the next drive or measurement."""
    if vehicle.formula is not None:
        notes.append(
            f"the formula {vehicle.formula.id} of the vehicle file was simulated unchanged, and is kept"
        )
    notes += describe_slip(problem, result)
    rows = list_findings(problem, result, list_stated(problem.config))
    steps = {
        c: max(find_quantisation(log.data[c].to_numpy(float)) for log in logs) for c in (*DRIVES, *MEASURED)
    }
    sensors = _collect_sensors(problem, result, logs)
    found = CalibrationResult(
        vehicle, problem.config, problem, result, rows, group_findings(problem, result, rows), proofs,
        sensors, steps, notes,
    )  # fmt: skip
    found.offers = advice.list_offers(problem, result, vehicle)
    return found


def _prepare_logs(
    logs: Sequence[CheckedLog], config: Config, notes: list[str], say: Say
) -> list[PreparedLog | None]:
    """Return each log prepared for the simulation. If a log cannot be compared with a
    simulation, its entry is None and a note with the reason is added to `notes`."""
    ready: list[PreparedLog | None] = []
    for log in logs:
        say(f"smoothing {log.path.name}")
        try:
            ready.append(add_missing_channels(prepare(log, config)))
        except UserError as error:
            notes.append(f"left out: {error}")
            ready.append(None)
            continue
        notes += ready[-1].notes
    return ready


# ---- test on fitted and held-out logs


def _prove_fitted(problem: CarProblem, result: CarFit) -> list[Proof]:
    """Return the misfit of each fitted log before and after the calibration."""
    before = _measure_residuals(*_make_filed(problem))
    after = _measure_residuals(problem, problem.to_search(result.x), result.z)
    return [_make_proof(problem, i, False, before, after) for i in range(len(problem.logs))]


def _prove_held_out(problem: CarProblem, result: CarFit, logs: Sequence[PreparedLog]) -> list[Proof]:
    """Return the misfit of each held-out log with the car of the vehicle file (before)
    and with the calibrated car (after). With the calibrated car, only the biases and the
    superelevation of the road are fitted to each held-out log. With the car of the
    vehicle file, nothing is fitted."""
    car = make_known_car(problem, problem.to_search(result.x))
    other = CarProblem(logs, car, problem.prior.select(()), problem.jobs, road=False)
    filed = CarProblem(logs, problem.config, problem.prior.select(()), problem.jobs, road=False)
    before, after = _measure_residuals(*_make_filed(filed)), _measure_residuals(other, fit(other).search)
    return [_make_proof(other, i, True, before, after) for i in range(len(other.logs))]


def _make_filed(problem: CarProblem) -> tuple[CarProblem, np.ndarray]:
    """Return the problem with the car of the vehicle file, and values of its unknowns.

    The car is fixed, so the unknowns are only the superelevation of the road and the
    biases of the channels in each log. Each superelevation has the value of the vehicle
    file, and each bias its prior mean, 0. The road has no knots of bank and grade.
    """
    filed = CarProblem(problem.logs, problem.config, problem.prior.select(()), problem.jobs, road=False)
    x = filed.mean.copy()
    for i in range(filed.leans):
        x[filed.names.index(name_in_log(SUPERELEVATION, i))] = getattr(problem.config, LEAN)
    return filed, x


def _measure_residuals(
    problem: CarProblem, x: np.ndarray, z: np.ndarray | None = None
) -> dict[tuple[int, str], float]:
    """Return (index of the log, channel) -> sd of measured minus simulated, in the unit
    of the channel. `x`: values of the unknowns of the car. `z`: fitted bank and grade
    [rad] at the knots of the road; None: 0."""
    z = np.zeros(problem.knots) if z is None else z
    sensed = problem.compute_sensed_residuals(x, z)
    return {g: float(np.std(e)) for g, e in zip(problem.groups, sensed, strict=True)}


def _make_proof(problem: CarProblem, i: int, held_out: bool, before: dict, after: dict) -> Proof:
    """Return the misfit of the log with index i. `before` and `after` are the results of
    _measure_residuals() with the car of the vehicle file and with the calibrated car.
    `held_out`: True if the log was not fitted."""
    log = problem.logs[i]
    channels = {}
    for g, (k, c) in enumerate(problem.groups):
        if k == i:
            count = max(np.median(average_blocks(log, log.measured[c])[1]), 1)
            per_block = log.noise[c] / float(np.sqrt(count))
            signal = float(np.std(problem.get_measured(g)))
            channels[c] = ProofChannel(signal, before[i, c], after[i, c], per_block)
    return Proof(log.path.name, held_out, channels)


# ---- sensors


def _collect_sensors(problem: CarProblem, result: CarFit, logs: Sequence[CheckedLog]) -> dict[str, float]:
    """Return the sensor settings: sd of the white noise in one sample of each channel,
    random walk of the biases, noise of the wheel speeds, sd of the steering delay.

    The random walks are estimated from the residuals of the fitted car with bank and
    grade set to 0. Fitted bank and grade would explain a part of the slow residuals, so
    the walks would be estimated too small.
    """
    found = measure_row_noise(logs, problem.config)
    for c, left in problem.measure_lasting(result.level).items():
        # The residual of accel_x is integrated over SPEED_TIME, so its unit is m/s.
        walk = left.walk / (SPEED_TIME if c == "accel_x" else 1.0)
        found[f"{c}_bias_walk"] = min(walk, MAX_GYRO_WALK) if c == "yaw_rate" else walk
    found["wheel_noise_sd"] = max((log.wheel_noise for log in problem.logs), default=0.0)
    # The filter needs the prior sd of the total delay from the logged steering angle to
    # the wheels, steering_lag_time - steer_angle_latency. The latency is subtracted: the
    # later the angle is logged, the less time is left until the wheels have turned.
    lag = np.zeros(len(problem.names))
    for name, sign in (("steering_lag_time", 1.0), ("steer_angle_latency", -1.0)):
        lag[problem.names.index(name)] = sign
    found["steer_lag_sd"] = max(float(np.sqrt(lag @ result.covariance @ lag)), MIN_LAG_SD)
    fields = problem.config.fields
    return {k: float(np.clip(v, fields[k].low, fields[k].high)) for k, v in found.items()}


def measure_row_noise(logs: Sequence[CheckedLog], config: Config) -> dict[str, float]:
    """Return the settings <channel>_sd: sd of the white noise of a single row, for each
    channel. If there are several logs, it is the largest sd of any log."""
    found: dict[str, float] = {}
    for log in logs:
        with np.errstate(invalid="ignore"):
            moving = (
                np.abs(log.data["wheel_speed_rear"].to_numpy(float)) * config.wheel_radius_rear
                > MIN_MOVING_SPEED
            )
        for c in MEASURED:
            noise = estimate_noise(log, c, moving)
            if noise is not None:
                found[f"{c}_sd"] = max(found.get(f"{c}_sd", 0.0), noise.sd)
    return {k: float(np.clip(x, config.fields[k].low, config.fields[k].high)) for k, x in found.items()}


def find_quantisation(x: np.ndarray) -> float:
    """Return the step by which a channel is quantised; 0 if it is not quantised.

    Sort the distinct values and compute the differences between successive ones. The step
    is the median of the differences below 1.5 times the smallest difference. The channel
    is quantised if there are at least MIN_STEPS differences, and 99 % of them are integer
    multiples of the step, with errors below 0.1 steps.
    """
    apart = np.diff(np.unique(x[np.isfinite(x)]))
    if len(apart) < MIN_STEPS or not (least := float(apart.min())) > 0:
        return 0.0
    step = float(np.median(apart[apart < 1.5 * least]))
    off = np.abs(apart / step - np.round(apart / step))
    return step if float(np.quantile(off, 0.99)) < 0.1 else 0.0
