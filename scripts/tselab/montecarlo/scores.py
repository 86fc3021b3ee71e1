"""One drive and one estimate of it become a row of numbers. All errors are shares of the
true mean stiffness at that row. Of tyres that saturate the truth is their secant: the
linear model has no other stiffness to find (compute_felt_stiffness()).

Whether an estimate may be blamed for being wrong, or for saying that it does not know,
depends on what could be known. That is judged from the simulator's truth: from the
noise-free slips follows the regressor phi of each stiffness (as src/paper/row.c, which
has to use estimates), and from its variance over the last two memories the sd that the
mean could have at best,  sqrt((1 + E[phi^2] spread^2)/(memory var phi)).
"""

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from tse.library.core import REASON, STIFFNESS, library
from tse.log.rows import MEASURES
from tselab.montecarlo.case import LINEAR, Case, CaseDrive, G

DIVERGED_ERROR, DIVERGED_FOR = 0.20, 2.0  # share of the mean stiffness, s
SETTLE_AFTER = 10.0  # s after start, event or disturbance, before errors are judged
VALID_AFTER = 5.0  # s, before the valid flag is judged
CLOSE = 0.10  # error below which an estimate has settled, or may be called right
CLEARLY = 2.0  # best-case sd beyond this factor of valid_sd, either way, is clear; between is grey
LOW_SPEED = 1.0  # m/s, as in src/model/vehicle.h
REVERSE_SPEED = -0.1  # m/s, as in src/estimator/filter.c
SETTLED_FOR = 1.0  # s within CLOSE: has settled
SHARES = ("false_valid", "false_invalid", "valid_unobservable", "reason_right", "corrupted_reported")
SURE = 0.9  # of a change of regime: from here on it counts as reported
STATES = ("vel_x", "yaw_rate")
DISTINCT = 0.5  # s between changes that count as two
BEFORE, AFTER = (
    0.15,
    2.0,
)  # s by which a change that is reported may be earlier than the true one, later: else it is a false one
OFF, OFF_FOR = 0.20, 60.0  # error that must not be called valid, s after an event in which it is counted
UNKNOWN_REASONS = ("not excited", "held", "uncertain", "starting")  # right where nothing can be known


@dataclass
class Knowable:
    """What could be known at each row."""

    best_sd: np.ndarray  # (n, 3), relative to nominal; inf where nothing is learnt
    level: np.ndarray  # (n, 3) true mean as tyres show it, relative to nominal
    corrupted: np.ndarray  # (n,) the log does not tell the truth
    beyond: np.ndarray  # (n,) tyres beyond their linear range
    settled: np.ndarray  # (n,) long enough after start, events and disturbances
    valid_sd: float
    secant: np.ndarray | None = None  # (n, 3) as level, of tyres beyond their linear range, too

    @property
    def observable(self) -> np.ndarray:
        """Clearly so, (n, 3): the valid flag counts in shares of nominal, errors in
        shares of the truth; by both."""
        return self.best_sd * np.maximum(1, 1 / self.level) < self.valid_sd / CLEARLY

    @property
    def unobservable(self) -> np.ndarray:
        """Clearly so, by both counts, (n, 3)."""
        return self.best_sd * np.minimum(1, 1 / self.level) > self.valid_sd * CLEARLY

    @property
    def judged(self) -> np.ndarray:
        """Where an error is the estimator's fault, (n, 3)."""
        return self.observable & (self.settled & ~self.corrupted & ~self.beyond)[:, None]


def compute_regressors(d: CaseDrive) -> tuple[np.ndarray, np.ndarray]:
    """From the truth: phi (n, 3) in true sigma per unit of w, and the tyre forces over
    the friction limit (n, 2)."""
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
        limit = d.friction * c.mass * G / (c.lf + c.lr)
        use[:, 0] = np.hypot(cxf * level[:, 0] * sf, c.cornering_stiffness_front * level[:, 1] * af) / (
            limit * c.lr
        )
        use[:, 1] = np.hypot(cxr * follows * sr, c.cornering_stiffness_rear * level[:, 2] * ar) / (
            limit * c.lf
        )
    return phi, use


def compute_grip(use: np.ndarray) -> np.ndarray:
    """Secant of the simulator's tyre over its stiffness, as grip() in
    src/host/simulate.c. use: linear force over the limit."""
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
    """The stiffness that a best fit of the linear tyre over the memory finds: the secant,
    weighted by what each row shows of it, phi^2. Rows beyond the linear range, from which
    nobody should learn, do not count."""
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
    """Mean of what has been, with a memory of `window` rows: gain 1/min(window, rows so
    far)."""
    first = min(len(x), int(window))
    start = np.cumsum(x[:first]) / np.arange(1, first + 1)
    if first == len(x):
        return start
    gain = 1 / window
    rest, _ = lfilter([gain], [1, gain - 1], x[first:], zi=[(1 - gain) * start[-1]])
    return np.concatenate([start, rest])


def compute_best_sd(phi: np.ndarray, learning: np.ndarray, spread: np.ndarray, memory: float) -> np.ndarray:
    """Best-case sd of the mean from the regressor of one stiffness; rows from which
    nothing is learnt do not count."""
    sd = np.full(len(phi), np.inf)
    x = phi[learning]
    square = compute_running_mean(x**2, 2 * memory)
    signal = memory * np.maximum(square - compute_running_mean(x, 2 * memory) ** 2, 0.0)
    with np.errstate(divide="ignore"):
        sd[learning] = np.sqrt((1 + square * spread[learning] ** 2) / np.where(signal > 1e-12, signal, 0.0))
    return sd


def find_rows_after(time: np.ndarray, moments: np.ndarray, wait: float) -> np.ndarray:
    """Rows that are at least `wait` after the last of the moments before them. Moments
    need not be rows."""
    last = np.searchsorted(moments, time + 1e-9, side="right") - 1
    return (last < 0) | (time - np.where(last < 0, -np.inf, moments[last]) >= wait - 1e-9)


def find_knowable(d: CaseDrive, case: Case) -> Knowable:
    """What the truth of the drive says about what could be known."""
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
    # Before, the filter says "starting", and rightly
    started = d.time - d.time[0] >= 2 * memory * c.sample_time - 1e-9
    settled = find_rows_after(d.time, moments, SETTLE_AFTER) & started
    return Knowable(np.column_stack(sd), mean, d.corrupted, beyond, settled, c.valid_sd, secant)


def find_rows_inside(time: np.ndarray, windows: tuple[tuple[float, float], ...]) -> np.ndarray:
    """Rows in any of the windows."""
    return np.any([(time >= a - 1e-9) & (time <= b + 1e-9) for a, b in windows], axis=0)


def find_longest_run(flags: np.ndarray) -> int:
    """Length of the longest run of True."""
    return count_wrong_rows(flags, flags)


def count_wrong_rows(wrong: np.ndarray, judged: np.ndarray) -> int:
    """Most judged rows in any one stretch in which every row, judged or not, is wrong."""
    count = np.cumsum(np.concatenate([[0], wrong & judged]))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], wrong.astype(int), [0]])))
    return int((count[edges[1::2]] - count[edges[::2]]).max(initial=0))


def compute_settling_time(
    time: np.ndarray, error: np.ndarray, start: float, end: float, hold: float = SETTLED_FOR
) -> float:
    """Seconds from `start` until the error stays below CLOSE for `hold` seconds, with
    hold = inf up to `end`; inf when it does not. Less than `hold` before the end counts
    when it stays below until there."""
    part = (time >= start - 1e-9) & (time < end - 1e-9)
    t = time[part]
    wrong = np.flatnonzero(~(np.abs(error[part]) < CLOSE))
    begins = np.concatenate([[0], wrong + 1])  # of stretches that are right, some of no length
    begins = begins[begins < len(t)]
    ends = np.concatenate([t[wrong], [np.inf]])[: len(begins)]  # the first wrong row after each, if any
    long = np.flatnonzero(ends - t[begins] >= hold - 1e-9)
    return float(max(t[begins[long[0]]] - start, 0.0)) if len(long) else np.inf


def _compute_mean(x: np.ndarray) -> float:
    """Of the rows that have an estimate: a refused row has none."""
    x = x[np.isfinite(x)]
    return float(x.mean()) if len(x) else np.nan


# ---- changes of regime


def compute_log_time(d: CaseDrive) -> np.ndarray:
    """Time as the log has it: with the pauses, during which nothing was driven."""
    now = np.cumsum(d.rows["dt"].astype(float))
    return now - now[0]


def find_reported(d: CaseDrive, estimate: np.ndarray) -> np.ndarray:
    """When the estimator says that the regime changed, in the time of the drive: each
    change once, whenever it was said."""
    sure = (
        (estimate["change_probability"] >= SURE) & (estimate["change_kind"] > 0) & (estimate["status"] >= 0)
    )
    now = compute_log_time(d)
    when = np.unique((now - estimate["change_age"].astype(float))[sure])
    if not len(when):
        return when
    return np.interp(when[np.diff(when, prepend=-np.inf) > DISTINCT], now, d.time)


def score_regimes(d: CaseDrive, case: Case, k: Knowable, estimate: np.ndarray) -> dict[str, float]:
    """Changes reported and false ones; after each event how soon it was detected, how
    soon all stiffnesses were right, and for how long any was called valid and was not."""
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
    """The numbers of one run. Percent; shares as two counts of rows, so that they can be
    pooled."""
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
    for state in STATES:
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
