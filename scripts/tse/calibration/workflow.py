"""From logs to a calibrated car: read, prepare, fit, prove on logs that were not fitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tse.calibration.result import Channel, Proof, Result, findings, groups, known_before
from tse.car.vehicle import SHAPE, Vehicle, fill_sensors, ordinary_car, read_vehicle
from tse.channels.agree import read_agreeing
from tse.identify import advice
from tse.identify.data import Prepared, blocks, prepare, with_all
from tse.identify.fit import Fit, fit
from tse.identify.laps import laps
from tse.identify.problem import LEAN, SPEED_TIME, Problem, known_car
from tse.identify.slip import slip_words, slips
from tse.identify.unknowns import MEASURED, SUPERELEVATION, VELOCITY, of_log, prior_of
from tse.library.core import Config
from tse.library.errors import UserError
from tse.log.noise import MOVING, noise_of
from tse.log.rows import DRIVES, Log, Reading
from tse.roads.road import Road
from tse.roads.road_match import on_road

Say = Callable[[str], None]
LEAST_LAG_SD = 0.003  # s: what relaxation and lags of the model leave
MOST_GYRO_WALK = (
    0.001  # rad/s/sqrt(s): no gyro wanders faster, and roads are not in it: it is a model that misses turns
)
FEWEST_STEPS = 10  # between values, to speak of quantisation


def run(
    logs: Sequence[Path | Log],
    vehicle: Path | Vehicle,
    held_out: Sequence[Path | Log],
    jobs: int,
    say: Say,
    most: int | None = None,
    reading: Reading | None = None,
    road: Road | None = None,
) -> Result:
    """Calibrate, and prove it on the logs. `most`: steps of the search; `road`: that all
    logs are on, if it is known."""
    if isinstance(vehicle, Path):
        vehicle = read_vehicle(vehicle)
    notes: list[str] = []
    reading = replace(reading or Reading(), car=vehicle)
    read = on_known(road, read_agreeing(logs, notes, reading), vehicle)
    problem = _problem(read, vehicle, jobs, notes, say)
    result = slips(problem, fit(problem, say=say, most=most), read, vehicle)

    say("proof")
    proofs = _proofs(problem, result)
    if held_out:
        held = _prepare(
            on_known(road, read_agreeing(held_out, notes, reading), vehicle), problem.config, notes, say
        )
        proofs += _held_out(problem, result, [log for log in held if log is not None])
    return _result(vehicle, problem, result, read, proofs, notes)


def on_known(road: Road | None, logs: Sequence[Log], vehicle: Vehicle) -> list[Log]:
    """Return logs with the bank and grade of a road. UserError: one is on another."""
    if road is None:
        return list(logs)
    config = Config.exact(vehicle.values)
    return [on_road(log, road, config)[0] for log in logs]


def of_logs(
    logs: Sequence[Log],
    vehicle: Vehicle,
    say: Say = lambda _: None,
    least: float = 0.0,
    notes: Sequence[str] = (),
) -> Result:
    """Calibrate on logs that are read and agree, without proof. UserError: they cannot be compared with a simulation for `least`
    seconds."""
    notes = list(notes)
    problem = _problem(logs, vehicle, 1, notes, say)
    if (seconds := sum(log.seconds for log in problem.logs)) < least:
        raise UserError(f"{seconds:.0f} s of it can be compared with a simulation, {least:.0f} s are needed")
    result = slips(problem, fit(problem, say=say), logs, vehicle)
    return _result(vehicle, problem, result, logs, [], notes)


def _problem(logs: Sequence[Log], vehicle: Vehicle, jobs: int, notes: list[str], say: Say) -> Problem:
    """Return what is fitted."""
    stated = dict(vehicle.values)
    fill_sensors(vehicle, logs[0])
    config = Config.exact(vehicle.values)
    vehicle.values = stated
    if SHAPE not in stated:
        setattr(config, SHAPE, ordinary_car(config)[SHAPE])
    ready = _prepare(logs, config, notes, say)
    if not any(p is not None and p.stretches for p in ready):
        raise UserError("; ".join(notes) or "no log can be used")
    velocity = any(c in log.measured for log in ready if log is not None for c in VELOCITY)
    usable = [(one, log) for one, log in zip(ready, logs, strict=True) if one is not None and one.stretches]
    knots = laps([log for _, log in usable], config).knots()
    problem = Problem([one for one, _ in usable], config, prior_of(vehicle, config, velocity), jobs, knots)
    if not problem.groups:
        raise UserError(f"no log has enough of {', '.join(MEASURED)} to compare a simulation with")
    return problem


def _result(
    vehicle: Vehicle,
    problem: Problem,
    result: Fit,
    logs: Sequence[Log],
    proofs: list[Proof],
    notes: list[str],
) -> Result:
    if vehicle.formula is not None:
        notes.append(
            f"the vehicle file has a formula ({vehicle.formula.id}): it was simulated as it is, and is kept"
        )
    notes += slip_words(problem, result)
    rows = findings(problem, result, known_before(problem.config))
    steps = {c: max(step_of(log.data[c].to_numpy(float)) for log in logs) for c in (*DRIVES, *MEASURED)}
    sensors = _sensors(problem, result, logs)
    found = Result(
        vehicle,
        problem.config,
        problem,
        result,
        rows,
        groups(problem, result, rows),
        proofs,
        sensors,
        steps,
        notes,
    )
    found.offers = advice.offers(problem, result, vehicle)
    return found


def _prepare(logs: Sequence[Log], config: Config, notes: list[str], say: Say) -> list[Prepared | None]:
    """Return each log ready to be simulated; None: it cannot be."""
    ready: list[Prepared | None] = []
    for log in logs:
        say(f"smoothing {log.path.name}")
        try:
            ready.append(with_all(prepare(log, config)))
        except UserError as error:
            notes.append(f"left out: {error}")
            ready.append(None)
            continue
        notes += ready[-1].notes
    return ready


# ---- proof


def _proofs(problem: Problem, result: Fit) -> list[Proof]:
    """Return each fitted log with the car and the road that were found."""
    before, after = _left(*_as_filed(problem)), _left(problem, problem.to_search(result.x), result.z)
    return [_proof(problem, i, False, before, after) for i in range(len(problem.logs))]


def _held_out(problem: Problem, result: Fit, logs: Sequence[Prepared]) -> list[Proof]:
    """Return each log that was not fitted: of it only biases are, and how far its road
    leans into its curves."""
    car = known_car(problem, problem.to_search(result.x))
    other = Problem(logs, car, problem.prior.only(()), problem.jobs, road=False)
    filed = Problem(logs, problem.config, problem.prior.only(()), problem.jobs, road=False)
    before, after = _left(*_as_filed(filed)), _left(other, fit(other).search)
    return [_proof(other, i, True, before, after) for i in range(len(other.logs))]


def _as_filed(problem: Problem) -> tuple[Problem, np.ndarray]:
    """Return the car of the vehicle file, on roads as it says, and what is then unknown."""
    filed = Problem(problem.logs, problem.config, problem.prior.only(()), problem.jobs, road=False)
    x = filed.mean.copy()
    for i in range(filed.leans):
        x[filed.names.index(of_log(SUPERELEVATION, i))] = getattr(problem.config, LEAN)
    return filed, x


def _left(problem: Problem, x: np.ndarray, z: np.ndarray | None = None) -> dict[tuple[int, str], float]:
    """Return the rms of measured less simulated by log and channel, about its mean."""
    z = np.zeros(problem.knots) if z is None else z
    return {g: float(np.std(e)) for g, e in zip(problem.groups, problem.as_sensed(x, z), strict=True)}


def _proof(problem: Problem, i: int, held_out: bool, before: dict, after: dict) -> Proof:
    log = problem.logs[i]
    channels = {}
    for g, (k, c) in enumerate(problem.groups):
        if k == i:
            per_block = log.noise[c] / float(np.sqrt(max(np.median(blocks(log, log.measured[c])[1]), 1)))
            channels[c] = Channel(float(np.std(problem.measured(g))), before[i, c], after[i, c], per_block)
    return Proof(log.path.name, held_out, channels)


# ---- sensors


def _sensors(problem: Problem, result: Fit, logs: Sequence[Log]) -> dict[str, float]:
    """Return noise of the channels as settings say it: white noise of a row (row_noise), and
    by how much what is left on level roads walks."""
    found = row_noise(logs, problem.config)
    for c, left in problem.lasting(result.level).items():
        walk = left.walk / (SPEED_TIME if c == "accel_x" else 1.0)  # of accel_x a speed is compared
        found[f"{c}_bias_walk"] = min(walk, MOST_GYRO_WALK) if c == "yaw_rate" else walk
    found["wheel_noise_sd"] = max((log.wheel_noise for log in problem.logs), default=0.0)
    # how late the steering acts in all: what the filter need not find out by itself
    lag = np.zeros(len(problem.names))
    for name, sign in (("steering_lag_time", 1.0), ("steer_angle_latency", -1.0)):
        lag[problem.names.index(name)] = sign
    found["steer_lag_sd"] = max(float(np.sqrt(lag @ result.covariance @ lag)), LEAST_LAG_SD)
    fields = problem.config.fields
    return {k: float(np.clip(v, fields[k].low, fields[k].high)) for k, v in found.items()}


def row_noise(logs: Sequence[Log], config: Config) -> dict[str, float]:
    """Return the settings of the white noise of a row, of the log with most of it, by second
    differences (noise.py)."""
    found: dict[str, float] = {}
    for log in logs:
        with np.errstate(invalid="ignore"):
            moving = np.abs(log.data["wheel_speed_rear"].to_numpy(float)) * config.wheel_radius_rear > MOVING
        for c in MEASURED:
            noise = noise_of(log, c, moving)
            if noise is not None:
                found[f"{c}_sd"] = max(found.get(f"{c}_sd", 0.0), noise.sd)
    return {k: float(np.clip(x, config.fields[k].low, config.fields[k].high)) for k, x in found.items()}


def step_of(x: np.ndarray) -> float:
    """The step in which a channel is quantised: the least difference between values, if all others are whole multiples of it;
    0: none that shows."""
    apart = np.diff(np.unique(x[np.isfinite(x)]))
    if len(apart) < FEWEST_STEPS or not (least := float(apart.min())) > 0:
        return 0.0
    step = float(np.median(apart[apart < 1.5 * least]))
    off = np.abs(apart / step - np.round(apart / step))
    return step if float(np.quantile(off, 0.99)) < 0.1 else 0.0
