"""Classify the error that remains when the effects that the search found are part of the
model: is it an error of the sensors, is it localised in time, or does it depend on the
motion of the car?

Three kinds of errors count as errors of the sensors: low-frequency noise, a bias that is
a random walk, and single spikes. Low-frequency noise exceeds the estimated noise sd,
because this sd is estimated from differences between neighbouring rows, and
low-frequency noise hardly contributes to these differences.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from tse.gaps.infer.where import find_conditions
from tse.gaps.problem import Problem
from tse.identify.data import BLOCK_TIME

# An error is localised if half of its sum of squares above the noise is in one interval
# that lasts at most this share of the total time.
LOCAL = 0.15
# channel -> sd of the random walk of the bias of a MEMS sensor [m/s2/sqrt(s),
# rad/s/sqrt(s)]
WALK = {"accel_x": 0.005, "accel_y": 0.005, "yaw_rate": 0.0003}
# [s] Max correlation time at which a residual still counts as noise of a sensor that has
# a low pass (is_noise()). Errors of the car or the road have longer correlation times.
MEMORY = 0.12


@dataclass(frozen=True)
class Remainder:
    """The kind of error that remains in one channel when the effects that the search
    found are part of the model.
    """

    channel: str
    gap: float  # ratio of residual rms to sensor noise
    # "noise", "localised" (in a short interval), or "disturbance" (any other error, which
    # depends on the motion of the car)
    kind: str
    words: str  # description for the user


def find_remainders(
    problem: Problem, residuals: np.ndarray, values: dict[str, float], limit: float
) -> list[Remainder]:
    """Return the kind of error that remains in each channel.

    `residuals`: whitened residuals of the fit. `values`: fitted parameters. `limit`: max
    ratio of residual rms to sensor noise at which the error counts as noise without
    further tests.
    """
    # Channel -> condition under which the residual of the channel is largest.
    # find_conditions() lists the strongest condition first. In the reversed list it comes
    # last, and overwrites the weaker conditions of the same channel in the dict.
    large = {c.channel: c.condition for c in reversed(find_conditions(problem, residuals, values))}
    found = []
    for channel, mine in problem.used():
        e, log = residuals[mine], problem.rows.log[mine]
        steady = remove_walk(remove_spikes(e, log), log, estimate_walk(problem, mine, channel))
        size, own = (float(np.sqrt(np.mean(x**2))) for x in (e, steady))
        where = find_short_span(e, log, problem.rows.time[mine])
        kind = "noise"
        if size <= limit:
            words = "noise only"
        elif own <= limit:
            words = "noise only, apart from single spikes or a drifting bias"
        elif is_noise(steady, log):
            words = f"noise only, {own:.2f} times the noise estimated from row-to-row differences"
        elif where is not None:
            kind, name = "localised", problem.logs[where[2]].name
            words = f"half of the remaining error is in {name} between {where[0]:.1f} and {where[1]:.1f} s"
        else:
            kind = "disturbance"
            words = f"the remaining error is {size:.2f} times the noise" + (
                f", largest at {large[channel]}" if channel in large else ""
            )
        found.append(Remainder(channel, size, kind, f"{channel}: {words}"))
    return found


def estimate_walk(problem: Problem, rows: np.ndarray, channel: str) -> float:
    """Return the sd of the change of a channel's bias from one residual to the next (40
    ms), in units of the sd of the channel's noise; 0 for a channel that is not in WALK.
    """
    return WALK.get(channel, 0.0) * float(np.sqrt(BLOCK_TIME) * np.median(problem.weight[rows]))


def remove_spikes(e: np.ndarray, log: np.ndarray) -> np.ndarray:
    """Return the residual with single outliers replaced by the mean of their neighbours.

    A residual is a mean over 40 ms. Motions of the car last longer, so an outlier of a
    single residual is an error of the sensor.
    """
    near = 3.0 * 1.4826 * float(np.median(np.abs(e)))
    calm = np.abs(e) < near
    inside = (
        np.append(False, (log[2:] == log[1:-1]) & (log[1:-1] == log[:-2]))
        if len(e) > 2
        else np.zeros(0, bool)
    )
    lone = np.flatnonzero(np.append(inside, False)[: len(e)])
    lone = lone[~calm[lone] & calm[lone - 1] & calm[lone + 1] & (np.abs(e[lone]) > 1.25 * near)]
    rest = e.copy()
    rest[lone] = 0.5 * (e[lone - 1] + e[lone + 1])
    return rest


def remove_walk(e: np.ndarray, log: np.ndarray, step: float) -> np.ndarray:
    """Return the residual minus its slowly changing bias.

    A smoother estimates the bias. The residual is modelled as the bias plus white noise
    of variance 1, and the bias as a random walk. `step`: sd of the change of the bias
    from one residual to the next.
    """
    if step <= 0:
        return e
    # Stationary gain of the Kalman filter. For smoothing, the filter runs forwards over
    # the residual, and then backwards over its own estimates.
    g = 0.5 * step * (np.sqrt(step**2 + 4.0) - step)
    rest = np.empty_like(e)
    for i in np.unique(log):
        x = e[log == i]
        forth, _ = lfilter([g], [1.0, g - 1.0], x, zi=[(1.0 - g) * x[: max(1, round(1.0 / g))].mean()])
        back, _ = lfilter([g], [1.0, g - 1.0], forth[::-1], zi=[(1.0 - g) * forth[-1]])
        rest[log == i] = x - back[::-1]
    return rest


def is_noise(e: np.ndarray, log: np.ndarray) -> bool:
    """Return whether a residual is the noise of a sensor with a low pass.

    Such noise has a constant variance and a short correlation time, and does not
    oscillate. An error of the car or the road violates at least one of these conditions:
    its variance changes with the driving, its correlation time is long, or it oscillates.
    """
    most = round(1.0 / BLOCK_TIME)
    c, energies = np.zeros(most + 1), []
    for i in np.unique(log):
        x = e[log == i] - e[log == i].mean()
        c += [x[: len(x) - k] @ x[k:] for k in range(most + 1)]
        energies += [float(np.mean(s**2)) for s in np.split(x, range(most, len(x), most)) if len(s) == most]
    rho = c[1:] / max(c[0], 1e-300)
    limit = 3.0 / np.sqrt(len(e))
    length = 1.0 + 2.0 * float(np.sum(np.where(np.cumprod(rho > limit), rho, 0.0)))
    calm = max(1, round(MEMORY / BLOCK_TIME))
    if length * BLOCK_TIME > MEMORY or np.abs(rho[calm:]).max() > 0.1 + limit or rho.min() < -0.1 - limit:
        return False
    # Relative variance of the mean squares of windows of 1 s that is expected if the
    # residual has a constant variance
    chance = 2.0 * (1.0 + 2.0 * float(rho @ rho)) / most
    return float(np.var(energies)) <= 2.0 * chance * float(np.mean(energies)) ** 2


def find_short_span(e: np.ndarray, log: np.ndarray, time: np.ndarray) -> tuple[float, float, int] | None:
    """Return begin [s], end [s] and index of the log of the shortest interval that
    contains half of the sum of max(e^2 - 1, 0). e are the whitened residuals, and 1 is
    the variance of their noise.

    Return None if this interval is longer than the share LOCAL of the length of all logs,
    or if no single log contains half of the sum.
    """
    surplus = np.maximum(e**2 - 1.0, 0.0)
    total, n, best = surplus.sum(), len(e), None
    for i in np.unique(log):
        x, t = np.cumsum(np.append(0.0, surplus[log == i])), time[log == i]
        if x[-1] < 0.5 * total:
            continue
        end = np.searchsorted(x, x[:-1] + 0.5 * total)
        inside = end < len(x)
        spans = np.where(inside, end - np.arange(len(end)), n)
        k = int(np.argmin(spans))
        if best is None or spans[k] < best[0]:
            best = (int(spans[k]), float(t[k]), float(t[min(end[k], len(t)) - 1]), int(i))
    if best is None or best[0] > LOCAL * n:
        return None
    return best[1], best[2], best[3]
