"""Score one estimator on one drive. The simulated stiffness varies at random from sample
to sample about a mean. The errors of the estimates are relative to this true mean. If
tyres saturate, the truth is the secant stiffness (force / slip), to which an estimator
with a linear tyre model converges (compute_felt_stiffness()).

A wrong estimate, or a right one that is flagged as not valid, counts against an estimator
only if the stiffness was observable. Observability is computed from the true motion. The
regressor phi of a stiffness is the derivative of the acceleration with respect to
stiffness / nominal, divided by the noise sd of the accelerometer. It is proportional to
the slip. A filter with a forgetting factor has a memory of 1/(1 - forgetting) rows. With
E[phi^2] and var(phi) over the last 2 * memory rows, the best-case sd, i.e. the smallest
sd that an estimate of the mean stiffness can have, relative to nominal, is

    sqrt((1 + E[phi^2] * spread^2) / (memory * var(phi)))

where spread is the sd of the stiffness from sample to sample, relative to nominal. A
stiffness is observable if its best-case sd is clearly below the setting valid_sd, the max
relative sd of a stiffness that the filter flags as valid.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from tse.car.vehicle import GRAVITY
from tse.library.core import REASON, STIFFNESS, library
from tse.log.rows import MEASURES
from tselab.montecarlo.case import LINEAR, Case, CaseDrive
from tselab.montecarlo.peers import LOW_SPEED

# An estimate has diverged if its relative error exceeds DIVERGED_ERROR for longer than
# DIVERGED_FOR [s]
DIVERGED_ERROR, DIVERGED_FOR = 0.20, 2.0
# [s] Errors are not scored for this time after the start of the drive, an event (change
# of the true stiffness), a row made unusable by a simulated fault, or a row with a tyre
# beyond its linear range
SETTLE_AFTER = 10.0
VALID_AFTER = 5.0  # [s] false_valid (see SHARES) does not count earlier rows of the drive
CLOSE = 0.10  # an estimate is right if its relative error is smaller than this
# A stiffness is clearly observable if its best-case sd (see the top of this file) is
# below valid_sd / CLEARLY, and clearly unobservable if it is above valid_sd * CLEARLY.
# Rows in between are not scored, because there neither "valid" nor "not valid" is wrong
CLEARLY = 2.0
# [m/s] if a wheel speed is below this, the car drives in reverse, and no estimator learns
# from the row; the same value as in src/paper/row.c
REVERSE_SPEED = -0.1
SETTLED_FOR = 1.0  # [s] an estimate has settled if its error is below CLOSE for this long
# Shares of rows that score_run() computes, in this order. Each is described as
# "denominator: numerator".
#   false_valid         rows flagged valid: those with an error above DIVERGED_ERROR
#   false_invalid       scored rows with an error below CLOSE: those not flagged valid
#   valid_unobservable  rows with unobservable stiffness: those flagged valid
#   reason_right        rows with unobservable stiffness: those flagged not valid, for one
#                       of UNKNOWN_REASONS
#   corrupted_reported  rows made unusable by a simulated fault: those not flagged valid,
#                       or with the status that a measurement is missing
SHARES = ("false_valid", "false_invalid", "valid_unobservable", "reason_right", "corrupted_reported")
# a change of regime (a change of the stiffness, or a restart of the filter) counts as
# reported if the output change_probability is at least this
SURE = 0.9
SCORED_STATES = ("vel_x", "yaw_rate")
DISTINCT = 0.5  # [s] reported changes with less time between them count as one change
# [s] a reported change is correct if its estimated time is at most BEFORE before the
# start and at most AFTER after the end of a true change
BEFORE, AFTER = (0.15, 2.0)
# A valid flag is wrong if the relative error exceeds OFF. Rows with a wrong flag are
# counted up to OFF_FOR [s] after an event (change of the true stiffness)
OFF, OFF_FOR = 0.20, 60.0
# reasons for "not valid" that are correct if the stiffness is not observable
UNKNOWN_REASONS = ("not excited", "held", "uncertain", "starting")


@dataclass
class Knowable:
    """True stiffness, and what can be known of it, in each of the n rows of a drive.
    Arrays (n, 3) have one column for each stiffness."""

    best_sd: np.ndarray  # (n, 3) best-case sd, relative to nominal; inf: no estimator learns from the row
    # (n, 3) true mean stiffness, relative to nominal. If tyres saturate: secant stiffness
    # (force / slip), averaged over the recent rows in the linear range. All errors refer
    # to it, except those that count as wrong "valid" flags after an event (`secant`)
    level: np.ndarray
    corrupted: np.ndarray  # (n,) whether a simulated fault has made the row unusable (Case.corrupt)
    beyond: np.ndarray  # (n,) whether a tyre is beyond its linear range
    # (n,) whether the row is at least SETTLE_AFTER after the start, the last event and
    # the last row that is corrupted or beyond the linear range, and at least
    # 2/(1 - forgetting) rows after the start
    settled: np.ndarray
    valid_sd: float  # setting of this name: max relative sd of a valid stiffness
    # (n, 3) as `level`, but averaged also over rows beyond the linear range. Truth for
    # wrong "valid" flags in score_regimes(). None: `level` is the truth
    secant: np.ndarray | None = None

    @property
    def observable(self) -> np.ndarray:
        """(n, 3) whether the stiffness is clearly observable: the best-case sd is below
        valid_sd / CLEARLY, both relative to nominal and relative to the truth."""
        return self.best_sd * np.maximum(1, 1 / self.level) < self.valid_sd / CLEARLY

    @property
    def unobservable(self) -> np.ndarray:
        """(n, 3) whether the stiffness is clearly unobservable: the best-case sd is above
        valid_sd * CLEARLY, both relative to nominal and relative to the truth."""
        return self.best_sd * np.minimum(1, 1 / self.level) > self.valid_sd * CLEARLY

    @property
    def judged(self) -> np.ndarray:
        """(n, 3) whether an error counts against the estimator: the stiffness is clearly
        observable, the row is settled and not corrupted, and no tyre is beyond its linear
        range."""
        return self.observable & (self.settled & ~self.corrupted & ~self.beyond)[:, None]


def compute_regressors(d: CaseDrive) -> tuple[np.ndarray, np.ndarray]:
    """Compute regressors and tyre utilisation from the truth.

    Returns
    -------
    tuple
        First (n, 3): regressor phi of each stiffness, i.e. the derivative of the
        acceleration (accel_x for the longitudinal, accel_y for the cornering stiffnesses)
        with respect to stiffness / nominal, divided by the noise sd of the accelerometer.
        Second (n, 2): utilisation of front and rear axle, i.e. the force of a linear tyre
        divided by the friction limit; 0 if friction is not limited.
    """
    c, truth = d.car, d.truth
    vx, vy, r = (truth[f"true_{n}"].astype(float) for n in ("vel_x", "vel_y", "yaw_rate"))
    vf = c.wheel_radius_front * truth["true_wheel_speed_front"]
    vr = c.wheel_radius_rear * truth["true_wheel_speed_rear"]
    body = np.maximum(np.abs(vx), LOW_SPEED)
    sf, sr = (vf - vx) / np.maximum(body, np.abs(vf)), (vr - vx) / np.maximum(body, np.abs(vr))
    af = (truth["steer_angle"] * vx - vy - c.lf * r) / body
    ar = (c.lr * r - vy) / body
    cxf, cxr = c.longitudinal_stiffness_front, c.longitudinal_stiffness_rear
    noise = max(d.sim.noise, 1e-6)
    x, y = 1 / (c.mass * c.accel_x_sd * noise), 1 / (c.mass * c.accel_y_sd * noise)
    phi = np.column_stack(
        [
            x * (cxf * sf + c.rear_longitudinal_follows_front * cxr * sr),
            y * c.cornering_stiffness_front * af,
            y * c.cornering_stiffness_rear * ar,
        ]
    )
    use = np.zeros((len(vx), 2))
    if d.friction > 0:
        level = d.stiffness
        follows = d.road + c.rear_longitudinal_follows_front * (level[:, 0] - d.road)
        limit = d.friction * c.mass * GRAVITY / (c.lf + c.lr)
        use[:, 0] = np.hypot(cxf * level[:, 0] * sf, c.cornering_stiffness_front * level[:, 1] * af) / (
            limit * c.lr
        )
        use[:, 1] = np.hypot(cxr * follows * sr, c.cornering_stiffness_rear * level[:, 2] * ar) / (
            limit * c.lf
        )
    return phi, use


def compute_grip(use: np.ndarray) -> np.ndarray:
    """Return secant stiffness (force / slip) / stiffness at zero slip of a simulated
    tyre, by the formula of compute_grip_share() in src/model/effects.h.

    `use`: ratio of the force of a linear tyre to the friction limit."""
    z = use / 3
    return np.where(z < 1, 1 - z + z**2 / 3, 1 / np.maximum(use, 1e-9))


def compute_felt_stiffness(
    mean: np.ndarray,
    phi: np.ndarray,
    use: np.ndarray,
    learning: np.ndarray,
    memory: float,
    linear: float = LINEAR,
) -> np.ndarray:
    """Return for each row the stiffness (n, 3), relative to nominal, to which a
    least-squares fit of a linear tyre to the last `memory` rows converges: the mean of
    the secant stiffness over these rows, weighted with phi^2.

    `mean`: true stiffness at zero slip, relative to nominal. `phi`, `use`: from
    compute_regressors(). `learning`: False in rows with low speed, reverse or a large
    steering angle. `memory`: number of rows. `linear`: max utilisation `use`. The mean
    leaves out rows without `learning` and rows in which an axle exceeds `linear`."""
    if not use.any():
        return mean
    rows = np.flatnonzero(learning & (use.max(axis=1) <= linear))
    if not len(rows):
        return mean
    latest = np.clip(np.searchsorted(rows, np.arange(len(use)), side="right") - 1, 0, None)
    secant = np.empty_like(mean)
    for i, axle in enumerate((0, 0, 1)):
        weight = phi[rows, i] ** 2
        with np.errstate(invalid="ignore"):
            share = compute_running_mean(
                weight * compute_grip(use[rows, axle]), memory
            ) / compute_running_mean(weight, memory)
        secant[:, i] = np.nan_to_num(share, nan=1.0)[latest]
    return mean * secant


def compute_running_mean(x: np.ndarray, window: float) -> np.ndarray:
    """Return for each row the mean of all values up to this row, with exponential
    forgetting: the gain is 1 / min(window, number of rows so far)."""
    first = min(len(x), int(window))
    start = np.cumsum(x[:first]) / np.arange(1, first + 1)
    if first == len(x):
        return start
    gain = 1 / window
    rest, _ = lfilter([gain], [1, gain - 1], x[first:], zi=[(1 - gain) * start[-1]])
    return np.concatenate([start, rest])


def compute_best_sd(phi: np.ndarray, learning: np.ndarray, spread: np.ndarray, memory: float) -> np.ndarray:
    """Return the best-case sd (n,) of the mean of one stiffness, relative to nominal; inf
    in rows from which an estimator does not learn.

    `phi`: regressor of this stiffness. `learning`: whether an estimator learns from each
    row. `spread`: sd of the stiffness from sample to sample. `memory`: number of rows."""
    sd = np.full(len(phi), np.inf)
    x = phi[learning]
    square = compute_running_mean(x**2, 2 * memory)
    signal = memory * np.maximum(square - compute_running_mean(x, 2 * memory) ** 2, 0.0)
    with np.errstate(divide="ignore"):
        sd[learning] = np.sqrt((1 + square * spread[learning] ** 2) / np.where(signal > 1e-12, signal, 0.0))
    return sd


def find_rows_after(time: np.ndarray, moments: np.ndarray, wait: float) -> np.ndarray:
    """Return for each row whether the latest of `moments` up to the row is at least
    `wait` seconds before it. True if all of `moments` are later than the row. `moments`:
    [s] in ascending order."""
    last = np.searchsorted(moments, time + 1e-9, side="right") - 1
    return (last < 0) | (time - np.where(last < 0, -np.inf, moments[last]) >= wait - 1e-9)


def find_knowable(d: CaseDrive, case: Case) -> Knowable:
    """Compute from the true motion the best sd that an estimator can reach in each row,
    and the rows in which the errors of an estimator count."""
    c = d.config
    phi, use = compute_regressors(d)
    wheels = np.column_stack(
        [getattr(c, f"wheel_radius_{a}") * d.truth[f"true_wheel_speed_{a}"] for a in ("front", "rear")]
    )
    learning = (
        (np.abs(wheels).max(axis=1) >= c.hold_speed)
        & (wheels.min(axis=1) >= REVERSE_SPEED)
        & (np.abs(d.truth["steer_angle"]) <= c.max_steer)
    )
    memory = 1 / (1 - c.forgetting)
    mean = compute_felt_stiffness(d.stiffness, phi, use, learning, memory)
    secant = compute_felt_stiffness(d.stiffness, phi, use, learning, memory, np.inf)
    sd = [
        compute_best_sd(phi[:, i], learning, getattr(d.sim, f"spread_{k}") * mean[:, i], memory)
        for i, k in enumerate(STIFFNESS)
    ]
    beyond = use.max(axis=1) > LINEAR
    disturbed = d.corrupted | beyond
    moments = np.sort(np.concatenate([[d.time[0]], case.events, d.time[disturbed]]))
    # An estimator may flag the first 2 * memory rows as not valid, with the reason
    # "starting". So these rows are not scored
    started = d.time - d.time[0] >= 2 * memory * c.sample_time - 1e-9
    settled = find_rows_after(d.time, moments, SETTLE_AFTER) & started
    return Knowable(np.column_stack(sd), mean, d.corrupted, beyond, settled, c.valid_sd, secant)


def find_rows_inside(time: np.ndarray, windows: tuple[tuple[float, float], ...]) -> np.ndarray:
    """Return whether each row is in one of the windows."""
    return np.any([(time >= a - 1e-9) & (time <= b + 1e-9) for a, b in windows], axis=0)


def find_longest_run(flags: np.ndarray) -> int:
    """Return the length of the longest run of True."""
    return count_wrong_rows(flags, flags)


def count_wrong_rows(wrong: np.ndarray, judged: np.ndarray) -> int:
    """Return the length of the longest stretch of consecutive wrong rows, counting only
    rows that are judged, i.e. whose error counts. A wrong row that is not judged is not
    counted, but does not end the stretch."""
    count = np.cumsum(np.concatenate([[0], wrong & judged]))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], wrong.astype(int), [0]])))
    return int((count[edges[1::2]] - count[edges[::2]]).max(initial=0))


def compute_settling_time(
    time: np.ndarray, error: np.ndarray, start: float, end: float, hold: float = SETTLED_FOR
) -> float:
    """Return the time [s] from `start` to the first row from which the error stays below
    CLOSE for `hold` seconds, or up to `end` if `end` comes sooner. Return inf if there is
    no such row.

    `time`, `start`, `end` [s]. `error`: relative error in each row."""
    part = (time >= start - 1e-9) & (time < end - 1e-9)
    t = time[part]
    wrong = np.flatnonzero(~(np.abs(error[part]) < CLOSE))
    begins = np.concatenate([[0], wrong + 1])  # first row of each stretch without wrong rows; may be empty
    begins = begins[begins < len(t)]
    ends = np.concatenate([t[wrong], [np.inf]])[: len(begins)]  # time of the next wrong row; inf: none
    long = np.flatnonzero(ends - t[begins] >= hold - 1e-9)
    return float(max(t[begins[long[0]]] - start, 0.0)) if len(long) else np.inf


def _compute_mean(x: np.ndarray) -> float:
    """Return the mean of the finite values, or NaN if there are none. A row that the
    estimator refused has no estimate and therefore the value NaN."""
    x = x[np.isfinite(x)]
    return float(x.mean()) if len(x) else np.nan


# ---- changes of regime


def compute_log_time(d: CaseDrive) -> np.ndarray:
    """Return the time [s] of each row since the first row, as the sum of the time
    steps (dt) of the log. The output change_age of an estimator refers to this time."""
    now = np.cumsum(d.rows["dt"].astype(float))
    return now - now[0]


def find_reported(d: CaseDrive, estimate: np.ndarray) -> np.ndarray:
    """Return the times [s] of the regime changes that the estimator reports, on the
    time axis of the drive. A regime change is a change of the stiffness of all tyres
    or of one axle, or a restart of the filter. Each row after a change reports it again,
    perhaps with another time. Times with gaps up to DISTINCT are one change, and only
    the first of them is returned."""
    sure = (
        (estimate["change_probability"] >= SURE) & (estimate["change_kind"] > 0) & (estimate["status"] >= 0)
    )
    now = compute_log_time(d)
    when = np.unique((now - estimate["change_age"].astype(float))[sure])
    if not len(when):
        return when
    return np.interp(when[np.diff(when, prepend=-np.inf) > DISTINCT], now, d.time)


def score_regimes(d: CaseDrive, case: Case, k: Knowable, estimate: np.ndarray) -> dict[str, float]:
    """Return the scores of regime changes. `changes`: number of reported changes.
    `false_changes`: number of false ones among them. For the n-th event (true change of
    the stiffness), n from 1:
    - `detected_n`: [s] time from the event until it is reported; inf if it never is,
    - `all_settle_n`: [s] time from the event until all stiffnesses have settled; inf if
      they do not settle before the next event,
    - `valid_off_n`: [s] total time, within OFF_FOR after the event, in which a stiffness
      was flagged valid although its relative error was above OFF."""
    names, time, row = estimate.dtype.names, d.time, {}
    now = compute_log_time(d)
    error = np.max(
        [np.abs(estimate[s].astype(float) / k.level[:, i] - 1) for i, s in enumerate(STIFFNESS)], axis=0
    )
    if "change_age" in names:
        found = find_reported(d, estimate)
        true = [(found > e - BEFORE) & (found < e + case.lasts + AFTER) for e in case.events]
        row["changes"], row["false_changes"] = (
            len(found),
            int((~np.any(true, axis=0)).sum() if true else len(found)),
        )
    for n, (event, end) in enumerate(itertools.pairwise((*case.events, np.inf)), 1):
        part = (time >= event - 1e-9) & (time < end - 1e-9)
        row[f"all_settle_{n}"] = compute_settling_time(time, error, event, end)
        if "change_age" in names:
            since = now - np.interp(event, time, now)
            says = part & (estimate["change_probability"] >= SURE) & (estimate["change_kind"] > 0)
            says &= estimate["change_age"] < since + 0.1
            row[f"detected_{n}"] = float(max(time[says.argmax()] - event, 0.0)) if says.any() else np.inf
        if f"{STIFFNESS[0]}_valid" in names:
            truth = k.level if k.secant is None else k.secant
            wrong = [
                (estimate[f"{s}_valid"] == 0)
                & (estimate["status"] >= 0)
                & ~(np.abs(estimate[s] / truth[:, i] - 1) <= OFF)
                for i, s in enumerate(STIFFNESS)
            ]
            off = np.any(wrong, axis=0) & part & (time < event + OFF_FOR - 1e-9)
            row[f"valid_off_{n}"] = float(off.sum() * d.config.sample_time)
    return row


def score_run(d: CaseDrive, case: Case, k: Knowable, estimate: np.ndarray) -> dict[str, float]:
    """Return the scores of one run. Errors of a stiffness are in percent, their mean
    squares in percent squared. A share is given as two numbers of rows, numerator and
    denominator, so that the shares of several runs can be pooled."""
    time, step = d.time, d.config.sample_time
    window = find_rows_inside(time, case.windows)
    truth = k.level
    known = k.judged
    names = estimate.dtype.names
    unknown = [code for code, f in library().codes(REASON).items() if f.name in UNKNOWN_REASONS]
    row: dict[str, float] = {}
    diverged = diverged_any = 0
    for i, key in enumerate(STIFFNESS):
        true = truth[:, i]
        error = estimate[key].astype(float) / true - 1 if key in names else np.full(len(time), np.nan)
        size = np.abs(error)
        sd = estimate[f"{key}_sd"].astype(float) / true
        row[f"{key}_mean_square"] = 1e4 * _compute_mean(error[window] ** 2)
        row[f"{key}_bias"] = 100 * _compute_mean(error[window])
        row[f"{key}_covered"] = 100 * np.mean(size[window] <= 1.96 * sd[window]) if key in names else np.nan
        row[f"{key}_sd_square"] = 1e4 * _compute_mean(sd[window] ** 2)
        for n, w in enumerate(case.windows):
            here = find_rows_inside(time, (w,))
            row[f"{key}_mean_square_w{n}"] = 1e4 * _compute_mean(error[here] ** 2)
            row[f"{key}_covered_w{n}"] = (
                100 * np.mean(size[here] <= 1.96 * sd[here]) if key in names else np.nan
            )
            row[f"{key}_bias_w{n}"] = 100 * _compute_mean(error[here])
            row[f"{key}_off_w{n}"] = int(
                find_longest_run(~(size[here] <= DIVERGED_ERROR)) * step > DIVERGED_FOR
            )
            if f"{key}_spread" in names:
                row[f"{key}_spread_w{n}"] = 100 * _compute_mean(estimate[f"{key}_spread"][here] / true[here])
        if f"{key}_spread" in names:
            row[f"{key}_spread"] = 100 * _compute_mean(estimate[f"{key}_spread"][window] / true[window])
        if f"{key}_spread_seen" in names:
            row[f"{key}_spread_seen"] = 100 * float(np.mean(estimate[f"{key}_spread_seen"][window]))
        if key in names:
            starts = (time[0], *case.events)
            ends = (*case.events, np.inf)
            for n, (a, b) in enumerate(zip(starts, ends, strict=True)):
                row[f"{key}_settle_{n}"] = compute_settling_time(time, error, a, b)
                row[f"{key}_stay_{n}"] = compute_settling_time(time, error, a, b, np.inf)
            wrong = ~(size <= DIVERGED_ERROR)
            row[f"{key}_judged"] = int(known[:, i].sum())
            row[f"{key}_worst"] = 100 * np.max(size[known[:, i]], initial=0.0)
            row[f"{key}_diverged"] = int(count_wrong_rows(wrong, known[:, i]) * step > DIVERGED_FOR)
            diverged = max(diverged, row[f"{key}_diverged"])
            diverged_any = max(diverged_any, int(find_longest_run(wrong & k.settled) * step > DIVERGED_FOR))
        if f"{key}_valid" in names:
            refused = estimate["status"] < 0
            missing = estimate["status"] == library().status("TSE_W_MISSING_CHANNEL")
            valid = (estimate[f"{key}_valid"] == 0) & ~refused
            flagged = valid & (time >= VALID_AFTER - 1e-9)
            dark = k.unobservable[:, i] & ~k.corrupted
            right = known[:, i] & (size < CLOSE)
            reasons = np.isin(estimate[f"{key}_valid"], unknown)
            shares = (
                (flagged & wrong, flagged),
                (right & ~valid, right),
                (dark & valid, dark),
                (dark & reasons & ~refused, dark),
                (k.corrupted & (~valid | missing), k.corrupted),
            )
            for name, (of, among) in zip(SHARES, shares, strict=True):
                row[f"{key}_{name}"], row[f"{key}_{name}_of"] = int(of.sum()), int(among.sum())
    for state in SCORED_STATES:
        if state in names:
            row[f"{state}_square"] = _compute_mean(
                (estimate[state] - d.truth[f"true_{state}"])[window].astype(float) ** 2
            )
    if STIFFNESS[0] in names:
        row["diverged"], row["diverged_any"] = diverged, diverged_any
        row |= score_regimes(d, case, k, estimate)
    if "status" in names:
        for channel in MEASURES:
            row[f"noise_{channel}"] = _compute_mean(estimate[f"noise_{channel}"][window])
        row["recoveries"] = int((estimate["status"] == library().status("TSE_W_RECOVERED")).sum())
    return row
