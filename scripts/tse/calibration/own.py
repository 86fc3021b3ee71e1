"""Calibrate a car on the same logs in which the stiffness is then estimated, and keep the
result in a cache for later runs.

This is done for cars without a calibration. As after any calibration, the posterior of
the stiffness becomes the prior of the filter. The filter then uses the same rows again as
measurements, so its sds are too small, but only slightly: their largest part is due to
the model error (model_sd), which more measurements do not reduce.

A short log contains too little information about model_sd. So the calibration may raise
model_sd, but not reduce it below the value of an uncalibrated car of the same mass and
axle distances (src/tables/uncalibrated.toml).
"""

import copy
import hashlib
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tse.car.config import make_config
from tse.car.vehicle import Vehicle, make_vehicle
from tse.identify.unknowns import CORNERING_AXLES
from tse.library import __version__
from tse.library.core import NOMINAL, Config, NativeFilter, library
from tse.library.errors import UserError
from tse.library.files import lock_file, read_sealed, tomllib, write_sealed
from tse.log.rows import CheckedLog, select_liveliest

# [s] Max total length of the logs that is used. If the logs are longer, only the parts in
# which the car turns most are used.
MAX_OWN_SECONDS = 600.0
MIN_OWN_SECONDS = 60.0  # [s] min total length of the logs
# [s] Tolerance of MIN_OWN_SECONDS, so that a log with 60 s of rows is accepted: n rows
# last n - 1 steps, and the first second (BURN_IN) is not compared with the simulation.
END_SECONDS = 2.0
MIN_TURNING_SECONDS = 2.0  # [s] min time with a lateral acceleration above MIN_TURNING_ACCEL
MIN_TURNING_ACCEL = 1.0  # [m/s2] min lateral acceleration of a turn
# The logs determine the cornering stiffness of an axle if the sd of ln(stiffness) is
# below this limit: the 95 % interval is then narrower than stiffness / 1.41 .. stiffness
# x 1.41. If the logs determine the stiffness of neither axle, the calibration is not
# used.
MAX_SHOWN_SD = 0.175
MAX_SEARCH_SECONDS = 300.0  # [s] max run time of the search
STOPPED = "it was stopped by Ctrl-C"
TOO_LONG = f"the search took longer than {MAX_SEARCH_SECONDS:g} s"
NOT_ASKED = (
    "not calibrated on the log itself, as asked: the car is taken as an ordinary one of its class, "
    "as in C, the FMU and the page"
)


class _TooLong(Exception):
    """Raised if the search takes longer than MAX_SEARCH_SECONDS."""


@dataclass
class OwnCalibration:
    """Result of a calibration on the same logs in which the stiffness is estimated."""

    text: str  # content of the calibrated vehicle file; empty if the calibration is not used
    words: list[str]  # lines for the user: the calibrated values, or why they are not used
    # Result for JSON: see _collect_findings(). If the calibration is not used: see
    # keep_class()
    found: dict[str, Any]

    def apply_to(self, before: Vehicle) -> Vehicle:
        """Return the calibrated car, with name, facts, notes and formula of the car
        `before`. If the calibration is not used, return the car `before`.

        In both cases, the returned car has the lines for the user in its member `found`.
        """
        if not self.text:
            return replace(before, found=self.words)
        made = make_vehicle(tomllib.loads(self.text), before.path or Path("vehicle"))
        kept = {k: getattr(before, k) for k in ("path", "name", "facts", "notes", "formula", "formula_path")}
        if before.formula is not None:
            made.values |= before.formula.settings()
        return replace(made, found=self.words, **kept)


def is_uncalibrated(vehicle: Vehicle) -> bool:
    """Return whether a car has neither a calibration nor sds stated in [uncertainty]."""
    return not vehicle.calibration and not vehicle.given_uncertainty


def get_cache_folder() -> Path:
    """Return the folder in which calibrations of this user are cached."""
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".cache"
    return Path(base) / "tselab" / "calibrated"


def calibrate_once(
    vehicle: Vehicle, logs: Sequence[CheckedLog], say: Callable[[str], None] = lambda _: None
) -> OwnCalibration:
    """Calibrate the car on these logs. If the cache has a result for the same logs, the
    same car and the same code, return the cached result. `say` is called with each line
    of progress."""
    seconds = sum(float(log.time[-1] - log.time[0]) for log in logs if len(log))
    if seconds < MIN_OWN_SECONDS - END_SECONDS:
        return keep_class(f"it lasts {seconds:.4g} s, {MIN_OWN_SECONDS:g} s are needed")
    if (turning := sum(_measure_turning(log, vehicle) for log in logs)) < MIN_TURNING_SECONDS:
        return keep_class(
            f"it hardly turns: {turning:.1f} s above {MIN_TURNING_ACCEL:g} m/s2 across, "
            f"{MIN_TURNING_SECONDS:g} s are needed"
        )
    parts = [_select_part(log, MAX_OWN_SECONDS / len(logs)) for log in logs]
    key = _compute_key(vehicle, parts)
    path = _make_cache_path(f"{key}.json")
    if path is None:
        return _calibrate_car(vehicle, parts, say)
    lock = path.with_suffix(".lock")
    with lock_file(lock), _remove_on_exit(lock):
        kept = read_sealed(path)
        if isinstance(kept, dict) and kept.get("key") == key:
            return OwnCalibration(
                kept["text"], [*kept["words"], f"kept from an earlier run: {path}"], kept["found"]
            )
        where = "kept file was damaged, replaced" if path.exists() else "kept for the next run"
        own = _calibrate_car(vehicle, parts, say)
        if own.found.get("why") != TOO_LONG:
            write_sealed(path, {"key": key, **vars(own)})
            own.words.append(f"{where}: {path}")
        return own


@contextmanager
def _remove_on_exit(lock: Path) -> Iterator[None]:
    """Remove the lock file on exit.

    If a second process is waiting for the lock, it then locks the removed file. A third
    process creates a new lock file, and does not wait for the second process. So the same
    calibration may run twice, which only costs time."""
    try:
        yield
    finally:
        with suppress(OSError):
            lock.unlink()


def _measure_turning(log: CheckedLog, vehicle: Vehicle) -> float:
    """Return the time [s] in which |lateral acceleration| is above MIN_TURNING_ACCEL. The
    lateral acceleration is computed as speed times yaw rate. If the log has no yaw rate,
    it is accel_y."""
    rate = log.data["yaw_rate"].to_numpy(float)
    speed = vehicle.values["wheel_radius_rear"] * log.data["wheel_speed_rear"]
    across = speed.to_numpy(float) * rate if np.isfinite(rate).any() else log.data["accel_y"].to_numpy(float)
    with np.errstate(invalid="ignore"):
        return float(log.dt[np.abs(across) > MIN_TURNING_ACCEL].sum())


def _make_cache_path(name: str) -> Path | None:
    """Return the path of a file in the cache folder; None if the folder cannot be created
    or is not writable."""
    try:
        folder = get_cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: the user has no home folder
        return None
    return folder / name if os.access(folder, os.W_OK) else None


def _select_part(log: CheckedLog, seconds: float) -> CheckedLog:
    """Return the part of a log, `seconds` long, in which the car turns most."""
    # If the sample time is above 0.01 s, select_liveliest() expects the number of rows
    # that the part would have with a sample time of 0.01 s
    sample_time = min(log.sample_time or 0.01, 0.01)
    return select_liveliest(log, max(1, round(seconds / sample_time)))


def _compute_key(vehicle: Vehicle, logs: Sequence[CheckedLog]) -> str:
    """Return a hash of everything that the calibration depends on: logs, car and code."""
    digest = hashlib.sha256(library().path.read_bytes())
    for code in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(code.read_bytes())
    about = [__version__, sorted(vehicle.values.items()), sorted(vehicle.facts.items())]
    digest.update(json.dumps(about, default=str).encode())
    for log in logs:
        columns = [log.time, log.rows()]
        columns += [x for _, s in sorted(log.slower.items()) for x in (s.time, s.value)]
        digest.update(json.dumps([list(log.data), sorted(log.slower), log.averaged]).encode())
        for column in columns:
            digest.update(np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()


def _calibrate_car(
    vehicle: Vehicle, logs: Sequence[CheckedLog], say: Callable[[str], None]
) -> OwnCalibration:
    """Calibrate on the logs, and check the result with the filter on the same rows. If a
    check fails, return keep_class(reason): the car then stays uncalibrated."""
    from tse.calibration import output, workflow

    car = copy.deepcopy(vehicle)
    until = time.monotonic() + MAX_SEARCH_SECONDS

    def report(text: str) -> None:
        if time.monotonic() > until:
            raise _TooLong
        say(f"calibrating on the log itself: {text}")

    try:
        result = workflow.calibrate_logs(logs, car, report, min_seconds=MIN_OWN_SECONDS - END_SECONDS)
    except (UserError, ValueError) as error:  # ValueError (LinAlgError): logs without enough information
        return keep_class(str(error))
    except _TooLong:
        return keep_class(TOO_LONG)
    found = _collect_findings(result)
    if not result.fit.converged:
        return keep_class(f"the search did not converge in {result.fit.steps} steps", found)
    if not any(found["stiffness"][axle]["sd_relative"] < MAX_SHOWN_SD for axle in CORNERING_AXLES):
        return keep_class("the log does not show the cornering stiffness", found)
    if wrong := result.misstated:
        return keep_class(wrong, found | {"wrong": wrong})
    result = replace(result, vehicle=replace(car, formula=None), own=True)
    text = output.format_calibrated(result, [log.path.name for log in logs], Path())
    made = OwnCalibration(text, _describe_result(result, found), found)
    for car, contradicts in ((vehicle, _describe_contradiction), (made.apply_to(vehicle), None)):
        for log in logs:
            config, _ = make_config(car, log)
            out = NativeFilter(config).estimate_rows(log.rows())
            used = out[out["status"] >= 0]
            if (used["change_kind"] > 0).any():  # one calibrated stiffness cannot describe two roads
                return keep_class("the road or the tyres change during the log", found)
            if contradicts and len(used) and (against := contradicts(config, used[-1], found)):
                return keep_class(against, found)
    return made


def _describe_contradiction(config: Config, last: np.void, found: Mapping[str, Any]) -> str:
    """Return a sentence if the calibration and the filter with the uncalibrated car
    contradict each other; otherwise an empty string.

    Both estimate the cornering stiffness from the same rows. They contradict each other
    if |ln(ratio of the two estimates)| is larger than 1.96 times the sd of this
    logarithm. Then the parameters of the calibrated or of the uncalibrated car are wrong.
    A comparison of their likelihoods could not decide which: the calibration maximises
    the likelihood of this log, so the calibrated car would always win.
    """
    for key, axle in CORNERING_AXLES.items():
        ours = found["stiffness"][key]
        mean, sd = float(last[key]), float(last[f"{key}_sd"]) / float(last[key])
        value = mean * float(getattr(config, NOMINAL[key]))
        if abs(np.log(ours["value"] / value)) > 1.96 * np.hypot(sd, ours["sd_relative"]):
            low, high = ours["low"] / 1000, ours["high"] / 1000
            return (
                f"the {axle} cornering stiffness is {ours['value'] / 1000:.0f} ({low:.0f} .. {high:.0f}) "
                f"kN/rad by the calibration, {value / 1000:.0f} +- {1.96 * sd * value / 1000:.0f} by the "
                "filter on the same rows"
            )
    return ""


def keep_class(why: str, found: Mapping[str, Any] | None = None) -> OwnCalibration:
    """Return a result for the case that the calibration is not used. The car then keeps
    the parameters and sds of an ordinary car of the same mass and axle distances (its
    class, src/tables/uncalibrated.toml).

    `why` is the reason. `found` is the result of _collect_findings(); None: the
    calibration ended before it had a result."""
    words = [f"not calibrated on the log itself: {why}; the car is taken as an ordinary one of its class"]
    return OwnCalibration("", words, {**(found or {}), "used": False, "why": why})


def _collect_findings(result: Any) -> dict[str, Any]:
    """Return the result as a dict that can be written as JSON: stiffness, latencies, and
    the names of the parameters that the logs do not determine."""
    from tse.calibration import output

    sds = dict(zip(result.problem.names, np.sqrt(np.diag(result.fit.covariance)), strict=True))
    values, stiffness = output.collect_settings(result), {}
    for key in CORNERING_AXLES:
        value, sd = values[NOMINAL[key]], float(sds[key])
        low, high = (value * float(np.exp(side * 1.96 * sd)) for side in (-1, 1))
        stiffness[key] = {"value": value, "low": low, "high": high, "sd_relative": sd}
    late = [f for f in result.findings if f.name.endswith("_latency")]
    return {
        "used": True,
        "seconds": result.seconds,
        "converged": result.fit.converged,
        "stiffness": stiffness,
        "latency": {f.name.removesuffix("_latency"): {"value": f.value, "sd": f.sd} for f in late if f.shown},
        "not_shown": [f.name for f in result.findings if not f.shown],
    }


def _describe_result(result: Any, found: dict[str, Any]) -> list[str]:
    """Return the result of the calibration as lines for the user."""
    stiffness = ", ".join(
        f"{CORNERING_AXLES[key]} {s['value'] / 1000:.0f} ({s['low'] / 1000:.0f} .. {s['high'] / 1000:.0f})"
        for key, s in found["stiffness"].items()
    )
    lines = [
        f"calibrated on the log itself, {found['seconds'] / 60:.1f} minutes of it: "
        f"stiffness at no slip, 95 %: {stiffness} kN/rad"
    ]
    late = [f"{c} {1000 * x['value']:.0f} +- {1960 * x['sd']:.0f}" for c, x in found["latency"].items()]
    lines += [f"latency behind the gyro, ms, 95 %: {', '.join(late)}"] if late else []
    groups: dict[str, list[bool]] = {}
    for f in result.findings:
        groups.setdefault(f.group, []).append(f.shown)
    hidden = [g if not any(shown) else f"part of {g}" for g, shown in groups.items() if not all(shown)]
    lines += result.slip_lines
    lines += [f"not shown by the log: {', '.join(hidden)}"] if hidden else []
    return [*lines, *result.advice]
