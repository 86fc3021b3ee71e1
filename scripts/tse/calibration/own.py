"""A car that nobody has calibrated: calibrated on the log that is estimated, once, and kept for the next run.

The posterior of the cornering stiffness is the filter's prior, as of any calibration. The same rows are then prior and measurement,
which model discrepancy makes little of: they add hardly anything. Longitudinal stiffness and model discrepancy stay those of the
class: one short log says too little of either.
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
from tse.library import __version__
from tse.library.core import NOMINAL, Config, NativeFilter, library
from tse.library.errors import UserError
from tse.library.files import lock_file, read_sealed, tomllib, write_sealed
from tse.log.rows import CheckedLog, select_liveliest

MOST_SECONDS = 600.0  # of all logs together: of a longer one the part in which the car turns most
LEAST_SECONDS = 60.0  # that can be compared with a simulation,
ENDS = 2.0  # s: less what its ends leave out: a row, and where the simulation starts
LEAST_TURNING = 2.0  # s with a lateral acceleration of
TURNING = 1.0  # m/s2
KNOWN = 0.175  # ln: where neither cornering stiffness comes out to this, the log shows nothing of them
LONGEST = 300.0  # s: a search that takes longer on this machine is given up
STOPPED = "it was stopped by Ctrl-C"
TOO_LONG = f"the search took longer than {LONGEST:g} s"
AXLES = {"cy_front": "front", "cy_rear": "rear"}


class _TooLong(Exception):
    """The search has taken LONGEST."""


@dataclass
class Own:
    """What came of it. `text`: the calibrated vehicle file; empty: the car stays one of its class. `found`: for programs."""

    text: str
    words: list[str]
    found: dict[str, Any]

    def vehicle(self, before: Vehicle) -> Vehicle:
        """Return the calibrated car; what the file says beside it stays."""
        if not self.text:
            return replace(before, found=self.words)
        made = make_vehicle(tomllib.loads(self.text), before.path or Path("vehicle"))
        kept = {k: getattr(before, k) for k in ("path", "name", "facts", "notes", "formula", "formula_path")}
        if before.formula is not None:
            made.values |= before.formula.settings()
        return replace(made, found=self.words, **kept)


def uncalibrated(vehicle: Vehicle) -> bool:
    """Return whether nobody has calibrated the car, or said how well it is known."""
    return not vehicle.calibration and not vehicle.given_uncertainty


def cache_folder() -> Path:
    """Where calibrations are kept, of this user."""
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".cache"
    return Path(base) / "tselab" / "calibrated"


def calibrated(
    vehicle: Vehicle, logs: Sequence[CheckedLog], say: Callable[[str], None] = lambda _: None
) -> Own:
    """Calibrate on logs of the car, or return what an earlier run has found on the same ones."""
    seconds = sum(float(log.time[-1] - log.time[0]) for log in logs if len(log))
    if seconds < LEAST_SECONDS - ENDS:
        return of_class(f"it lasts {seconds:.4g} s, {LEAST_SECONDS:g} s are needed")
    if (turning := sum(_turning(log, vehicle) for log in logs)) < LEAST_TURNING:
        return of_class(
            f"it hardly turns: {turning:.1f} s above {TURNING:g} m/s2 across, {LEAST_TURNING:g} s are needed"
        )
    parts = [_part(log, MOST_SECONDS / len(logs)) for log in logs]
    key = _key(vehicle, parts)
    path = _place(f"{key}.json")
    if path is None:
        return _calibrate(vehicle, parts, say)
    lock = path.with_suffix(".lock")
    with lock_file(lock), _gone(lock):
        kept = read_sealed(path)
        if isinstance(kept, dict) and kept.get("key") == key:
            return Own(kept["text"], [*kept["words"], f"kept from an earlier run: {path}"], kept["found"])
        where = "broken, made anew" if path.exists() else "kept for the next run"
        own = _calibrate(vehicle, parts, say)
        if own.found.get("why") != TOO_LONG:
            write_sealed(path, {"key": key, **vars(own)})
            own.words.append(f"{where}: {path}")
        return own


@contextmanager
def _gone(lock: Path) -> Iterator[None]:
    """Take the lock file away behind the block, however it ends: who comes then does the work twice, at worst."""
    try:
        yield
    finally:
        with suppress(OSError):
            lock.unlink()


def _turning(log: CheckedLog, vehicle: Vehicle) -> float:
    """Seconds with a lateral acceleration of TURNING by speed and yaw rate, or by accel_y where there is no gyro."""
    rate, speed = (
        log.data["yaw_rate"].to_numpy(float),
        vehicle.values["wheel_radius_rear"] * log.data["wheel_speed_rear"],
    )
    across = speed.to_numpy(float) * rate if np.isfinite(rate).any() else log.data["accel_y"].to_numpy(float)
    with np.errstate(invalid="ignore"):
        return float(log.dt[np.abs(across) > TURNING].sum())


def _place(name: str) -> Path | None:
    """Where to keep it; None where no folder can hold it."""
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: there is no home
        return None
    return folder / name if os.access(folder, os.W_OK) else None


def _part(log: CheckedLog, seconds: float) -> CheckedLog:
    return select_liveliest(log, max(1, round(seconds / (log.sample_time or 0.01))))


def _key(vehicle: Vehicle, logs: Sequence[CheckedLog]) -> str:
    """Of all that the calibration depends on: what was read of the logs, the car, the code."""
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


def _calibrate(vehicle: Vehicle, logs: Sequence[CheckedLog], say: Callable[[str], None]) -> Own:
    from tse.calibration import output, workflow

    car = copy.deepcopy(vehicle)
    until = time.monotonic() + LONGEST

    def watched(text: str) -> None:
        if time.monotonic() > until:
            raise _TooLong
        say(f"calibrating on the log itself: {text}")

    try:
        result = workflow.of_logs(logs, car, watched, least=LEAST_SECONDS - ENDS)
    except (UserError, ValueError) as error:  # ValueError: LinAlgError, of rows that determine nothing
        return of_class(str(error))
    except _TooLong:
        return of_class(TOO_LONG)
    found = _found(result)
    if not result.fit.converged:
        return of_class(f"the search did not converge in {result.fit.steps} steps", found)
    if not any(found["stiffness"][axle]["sd_relative"] < KNOWN for axle in AXLES):
        return of_class("these rows show nothing of the cornering stiffness", found)
    if wrong := result.misstated:
        return of_class(wrong, found | {"wrong": wrong})
    result = replace(result, vehicle=replace(car, formula=None), own=True)
    made = Own(output.toml(result, [log.path.name for log in logs], Path()), _words(result, found), found)
    for car, contradicts in ((vehicle, _contradicted), (made.vehicle(vehicle), None)):
        for log in logs:
            config, _ = make_config(car, log)
            out = NativeFilter(config).estimate_rows(log.rows())
            used = out[out["status"] >= 0]
            if (used["change_kind"] > 0).any():  # a stiffness of two roads is that of neither
                return of_class("the road or the tyres change during it", found)
            if contradicts and len(used) and (against := contradicts(config, used[-1], found)):
                return of_class(against, found)
    return made


def _contradicted(config: Config, last: np.void, found: Mapping[str, Any]) -> str:
    """Return how search and filter of the class, two estimates from the same rows, contradict each other; empty: they agree.

    Both intervals claim 95 %. Where the means are further apart than both together allow, one model is wrong, and nothing in the
    log says which: its likelihood is that of the searched numbers, which were searched for it."""
    for key, axle in AXLES.items():
        ours = found["stiffness"][key]
        mean, sd = float(last[key]), float(last[f"{key}_sd"]) / float(last[key])
        value = mean * float(getattr(config, NOMINAL[key]))
        if abs(np.log(ours["value"] / value)) > 1.96 * np.hypot(sd, ours["sd_relative"]):
            return (
                f"the search finds {ours['value'] / 1000:.0f} ({ours['low'] / 1000:.0f} .. {ours['high'] / 1000:.0f}) kN/rad "
                f"in the {axle}, the filter {value / 1000:.0f} +- {1.96 * sd * value / 1000:.0f} on the same rows"
            )
    return ""


def of_class(why: str, found: Mapping[str, Any] | None = None) -> Own:
    """Return that the car stays one of its class, and why."""
    words = [f"not calibrated on the log itself: {why}; the car is taken as an ordinary one of its class"]
    return Own("", words, {**(found or {}), "used": False, "why": why})


def _found(result: Any) -> dict[str, Any]:
    """For programs: stiffness, latencies, and what could not be shown."""
    from tse.calibration import output

    sds = dict(zip(result.problem.names, np.sqrt(np.diag(result.fit.covariance)), strict=True))
    values, stiffness = output.values(result), {}
    for key in AXLES:
        value, sd = values[NOMINAL[key]], float(sds[key])
        stiffness[key] = {
            "value": value, "low": value * float(np.exp(-1.96 * sd)), "high": value * float(np.exp(1.96 * sd)), "sd_relative": sd,
        }  # fmt: skip
    late = [f for f in result.findings if f.name.endswith("_latency")]
    return {
        "used": True, "seconds": result.seconds, "converged": result.fit.converged, "stiffness": stiffness,
        "latency": {f.name.removesuffix("_latency"): {"value": f.value, "sd": f.sd} for f in late if f.shown},
        "not_shown": [f.name for f in result.findings if not f.shown],
    }  # fmt: skip


def _words(result: Any, found: dict[str, Any]) -> list[str]:
    stiffness = ", ".join(
        f"{AXLES[key]} {s['value'] / 1000:.0f} ({s['low'] / 1000:.0f} .. {s['high'] / 1000:.0f})"
        for key, s in found["stiffness"].items()
    )
    minutes = found["seconds"] / 60
    lines = [
        f"calibrated on the log itself, {minutes:.1f} minutes of it: stiffness at no slip, 95 %: {stiffness} kN/rad"
    ]
    late = [f"{c} {1000 * x['value']:.0f} +- {1960 * x['sd']:.0f}" for c, x in found["latency"].items()]
    lines += [f"latency behind the gyro, ms, 95 %: {', '.join(late)}"] if late else []
    groups = {
        g: [f.shown for f in result.findings if f.group == g]
        for g in dict.fromkeys(f.group for f in result.findings)
    }
    hidden = [g if not any(shown) else f"part of {g}" for g, shown in groups.items() if not all(shown)]
    lines += result.along
    lines += [f"could not be shown: {', '.join(hidden)}"] if hidden else []
    return [*lines, *result.surer]
