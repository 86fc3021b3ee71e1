"""From logs to a calibrated car: read, prepare, fit, prove on logs that were not fitted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tse.impl.calibrate.result import Proof, Result, findings, groups, known_before
from tse.impl.core import Config
from tse.impl.errors import UserError
from tse.impl.identify.data import BLOCK, Prepared, prepare
from tse.impl.identify.discrepancy import cost
from tse.impl.identify.fit import Fit, fit
from tse.impl.identify.problem import SPEED_TIME, Problem
from tse.impl.identify.slip import slip_words, slips
from tse.impl.identify.unknowns import MEASURED, OWN, STIFFNESS, Prior, prior_of
from tse.impl.logs.agree import read_agreeing
from tse.impl.noise import MOVING, noise_of, smooth
from tse.impl.rows import DRIVES, Log, Reading
from tse.impl.vehicle import SHAPE, Vehicle, fill_sensors, ordinary_car, read_vehicle

Say = Callable[[str], None]
SLOW = 4.0  # s
LEAST_LAG_SD = 0.003  # s: what relaxation and lags of the model leave
MOST_GYRO_WALK = 0.001  # rad/s/sqrt(s): no gyro wanders faster, and roads are not in it: it is a model that misses turns
FEWEST_STEPS = 10  # between values, to speak of quantisation


def run(
    logs: Sequence[Path],
    vehicle_path: Path,
    held_out: Sequence[Path],
    jobs: int,
    say: Say,
    most: int | None = None,
    reading: Reading | None = None,
) -> Result:
    """Calibrate, and prove it on the logs. `most`: steps of the search."""
    vehicle = read_vehicle(vehicle_path)
    notes: list[str] = []
    reading = replace(reading or Reading(), car=vehicle)
    read = read_agreeing(logs, notes, reading)
    problem, ready = _problem(read, vehicle, jobs, notes, say)
    config = problem.config

    say("stiffness alone, the car as in the file")
    plain_problem = Problem(ready, config, _stiffness_of(problem.prior), jobs, unlike=False)
    plain = fit(plain_problem, say=say)

    result = fit(problem, say=say, most=most)

    say("proof")
    proofs = _proofs(problem, result, plain_problem, plain, problem.logs, False)
    if held_out:
        held = _prepare(read_agreeing(held_out, notes, reading), config, notes, say)
        proofs += _proofs(problem, result, plain_problem, plain, held, True)
    return _result(vehicle, problem, result, read, proofs, notes)


def of_logs(
    logs: Sequence[Log], vehicle: Vehicle, say: Say = lambda _: None, least: float = 0.0, notes: Sequence[str] = ()
) -> Result:
    """Calibrate on logs that are read and agree, without proof. UserError: they cannot be compared with a simulation for `least`
    seconds."""
    notes = list(notes)
    problem, _ = _problem(logs, vehicle, 1, notes, say)
    if (seconds := sum(log.seconds for log in problem.logs)) < least:
        raise UserError(f"{seconds:.0f} s of it can be compared with a simulation, {least:.0f} s are needed")
    return _result(vehicle, problem, fit(problem, say=say), logs, [], notes)


def _problem(logs: Sequence[Log], vehicle: Vehicle, jobs: int, notes: list[str], say: Say) -> tuple[Problem, list[Prepared]]:
    """What is fitted, and the logs as they are simulated."""
    stated = dict(vehicle.values)
    fill_sensors(vehicle, logs[0])
    config = Config(vehicle.values)
    vehicle.values = stated
    if SHAPE not in stated:
        setattr(config, SHAPE, ordinary_car(config)[SHAPE])
    ready = _prepare(logs, config, notes, say)
    if not any(p.stretches for p in ready):
        raise UserError("; ".join(notes) or "no log can be used")
    problem = Problem(ready, config, prior_of(vehicle, config), jobs)
    if not problem.groups:
        raise UserError(f"no log has enough of {', '.join(MEASURED)} to compare a simulation with")
    return problem, ready


def _result(vehicle: Vehicle, problem: Problem, result: Fit, logs: Sequence[Log], proofs: list[Proof], notes: list[str]) -> Result:
    if vehicle.formula is not None:
        notes.append(f"the vehicle file has a formula ({vehicle.formula.id}): it was simulated as it is, and is kept")
    result = slips(problem, result, logs, vehicle)
    notes += slip_words(problem, result)
    rows = findings(problem, result, known_before(problem.config))
    steps = {c: max(step_of(log.data[c].to_numpy(float)) for log in logs) for c in (*DRIVES, *MEASURED)}
    sensors = _sensors(problem, result) | noise_along(logs, problem.config)
    return Result(vehicle, problem.config, problem, result, rows, groups(problem, result, rows), proofs, sensors, steps, notes)


def _prepare(logs: Sequence[Log], config: Config, notes: list[str], say: Say) -> list[Prepared]:
    ready = []
    for log in logs:
        say(f"smoothing {log.path.name}")
        try:
            ready.append(_with_all(prepare(log, config)))
        except UserError as error:
            notes.append(f"left out: {error}")
            continue
        notes += ready[-1].notes
    return ready


def _with_all(log: Prepared) -> Prepared:
    """A sensor that the log does not have has nothing to say anywhere: a column of NaN."""
    nothing = np.full(len(log.time), np.nan)
    return replace(log, measured={c: log.measured.get(c, nothing) for c in (*MEASURED, *log.measured)})


def _stiffness_of(prior: Prior) -> Prior:
    at = [prior.names.index(s) for s in STIFFNESS]
    return Prior(STIFFNESS, prior.mean[at], prior.covariance[np.ix_(at, at)], prior.low[at], prior.high[at])


def _proofs(
    problem: Problem, result: Fit, plain_problem: Problem, plain: Fit, logs: Sequence[Prepared], held_out: bool
) -> list[Proof]:
    """Each log by itself; of one that is held out nothing is fitted but the sensors' bias."""
    found = []
    for i, log in enumerate(x for x in logs if x.stretches):
        before, old = _misfit(plain_problem, plain, log, None if held_out else i)
        after, new = _misfit(problem, result, log, None if held_out else i)
        found.append(Proof(log.path.name, held_out, before, after, (old - new) / max(log.seconds, 1.0)))
    return found


def _misfit(problem: Problem, result: Fit, log: Prepared, fitted: int | None) -> tuple[dict[str, float], float]:
    """Rms of each channel, and minus the log likelihood. `fitted`: the log's index among those that were fitted."""
    other = Problem([log], problem.config, problem.prior, unlike=False)
    own = other.mean[other.car :] if fitted is None else result.x[problem.car + len(OWN) * fitted :][: len(OWN)]
    residuals = other.residuals(np.append(result.x[: problem.car], own))
    rows = round(SLOW / BLOCK)
    fast = [r - smooth(r, rows) if len(r) else r for r in other.as_sensed(np.append(result.x[: problem.car], own))]
    rms = {c: float(np.std(fast[g])) for g, (_, c) in enumerate(other.groups) if len(fast[g])}
    return rms, sum(cost(result.noise[c], other.pieces(residuals, c)) for c in other.channels if c in result.noise)


def _sensors(problem: Problem, result: Fit) -> dict[str, float]:
    """Noise of the channels as the settings say it. White noise of a row; held values carry what one of them does."""
    found: dict[str, float] = {}
    for c in problem.channels:
        d = result.noise[c]
        rows = sum(len(log.time) for log in problem.logs)
        fresh = sum(int(np.isfinite(log.measured[c]).sum()) for log in problem.logs)
        if c != "accel_x":  # what is compared of it is a speed: noise_along()
            found[f"{c}_sd"] = d.white * float(np.sqrt(rows / max(fresh, 1)))
        walk = d.walk / (SPEED_TIME if c == "accel_x" else 1.0)
        found[f"{c}_bias_walk"] = min(walk, MOST_GYRO_WALK) if c == "yaw_rate" else walk
    found["wheel_noise_sd"] = max((log.wheel_noise for log in problem.logs), default=0.0)
    # how late the steering acts in all: what the filter need not find out by itself
    lag = np.zeros(len(problem.names))
    for name, sign in (("steering_lag_time", 1.0), ("steer_angle_latency", -1.0)):
        lag[problem.names.index(name)] = sign
    found["steer_lag_sd"] = max(float(np.sqrt(lag @ result.covariance @ lag)), LEAST_LAG_SD)
    fields = problem.config.fields
    return {k: float(np.clip(v, fields[k].low, fields[k].high)) for k, v in found.items()}


def noise_along(logs: Sequence[Log], config: Config) -> dict[str, float]:
    """Return accel_x_sd [m/s2]: white noise of a row of the log with most of it, by second differences (noise.py)."""
    found = []
    for log in logs:
        with np.errstate(invalid="ignore"):
            moving = np.abs(log.data["wheel_speed_rear"].to_numpy(float)) * config.wheel_radius_rear > MOVING
        found.append(noise_of(log, "accel_x", moving))
    sds = [noise.sd for noise in found if noise is not None]
    f = config.fields["accel_x_sd"]
    return {"accel_x_sd": float(np.clip(max(sds), f.low, f.high))} if sds else {}


def step_of(x: np.ndarray) -> float:
    """The step in which a channel is quantised: the least difference between values, if all others are whole multiples of it;
    0: none that shows."""
    apart = np.diff(np.unique(x[np.isfinite(x)]))
    if len(apart) < FEWEST_STEPS or not (least := float(apart.min())) > 0:
        return 0.0
    step = float(np.median(apart[apart < 1.5 * least]))
    off = np.abs(apart / step - np.round(apart / step))
    return step if float(np.quantile(off, 0.99)) < 0.1 else 0.0
