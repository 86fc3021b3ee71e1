"""Two extended Kalman filters, "ekf" and "known" (run_peer()). They have the true noise
covariances, and tse is compared with them.

The state is z = (x, mu, b, eps), where x = (vel_x, vel_y, yaw_rate), b are the sensor
biases, and mu + eps = stiffness / nominal - 1 for the three stiffnesses: mu is the mean,
eps is white noise. eps_k affects the measurement of row k and the motion to row k + 1:

    y_k = h(x_k, mu + eps_k) + b_k + e_k
    x_{k+1} = f(x_k, mu + eps_k)
    eps_k ~ N(0, diag(spread^2)), independent from row to row

where y_k are the measurements, e_k is their white noise, h is observe() and f is move().
Because eps_k is in both equations, process noise and measurement noise are correlated.
With eps_k in the state, the covariance P of the state contains this correlation.

Equation numbers are those of src/EQUATIONS.md. Equations (1) to (4) are implemented here
in numpy, independently of the C library. Their derivatives are computed by complex steps.
"""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from tse.library.core import STIFFNESS, Config, library
from tse.log.rows import DRIVES, MEASURES

X, MU, B, EPS = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)  # indices of the parts of z
LOW_SPEED = 1.0  # [m/s] min speed in the denominators of the slips
# Max product of integration step and fastest decay rate. It limits the error of one
# Runge-Kutta step to about 0.8^5/120 = 0.3 % of the state
MAX_STEP_PRODUCT = 0.8
TINY = 1e-30  # step of the complex-step derivatives
STATES = ("vel_x", "vel_y", "yaw_rate")
# The filter "known" assumes that a change of the road surface multiplies each stiffness
# by 1 + a + b. a has the sd COMMON, and the same value for all three stiffnesses. b has
# the sd OWN, and an independent value for each stiffness
COMMON, OWN = 0.4, 0.1
PEER_DTYPE = np.dtype(
    [(f"{name}{end}", float) for name in STATES for end in ("", "_sd")]
    + [(f"{name}{end}", float) for name in STIFFNESS for end in ("", "_sd", "_spread")]
    + [(f"bias_{name}{end}", float) for name in MEASURES for end in ("", "_sd")]
)


@dataclass(frozen=True)
class Known:
    """Arguments of the filters "ekf" and "known": true noise sds, true spread and true
    times of changes of the simulation, and the forgetting factor."""

    # sd of each stiffness from sample to sample, relative to nominal (filter "ekf") or
    # to the estimated mean stiffness (filter "known")
    spread: tuple[float, float, float]
    noise_sd: tuple[float, float, float]  # noise sd of accel_x, accel_y [m/s2] and yaw_rate [rad/s]
    # forgetting factor of the mean stiffness for one sample_time (a setting). The filter
    # "known" does not use it
    forgetting: float = 0.99
    # steering angle between two rows. True: constant; False: it changes linearly
    held: bool = False
    # [s] times, counted from the first row, at which the mean stiffness changes; only the
    # filter "known" uses them
    changes: tuple[float, ...] = ()


def compute_accelerations(c: SimpleNamespace, x: np.ndarray, w: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return accel_x, accel_y and yaw acceleration, equations (1) to (4).

    `c`: parameters of the car. `x`: (3, n) vel_x, vel_y [m/s], yaw rate [rad/s]. `w`:
    (3, n) stiffness / nominal - 1 of the three stiffnesses (equation (5)). The equations
    are evaluated at each of the n columns. `u`: steering angle [rad], and wheel speeds
    front and rear [rad/s]."""
    v, (delta, front, rear) = np.maximum(x[0], LOW_SPEED), u
    front, rear = front * c.wheel_radius_front, rear * c.wheel_radius_rear
    fx = c.longitudinal_stiffness_front * (1 + w[0]) * (front - x[0]) / np.maximum(v, abs(front))
    follows = 1 + c.rear_longitudinal_follows_front * w[0]
    fx_rear = c.longitudinal_stiffness_rear * follows * (rear - x[0]) / np.maximum(v, abs(rear))
    fy = c.cornering_stiffness_front * (1 + w[1]) * (delta * x[0] - x[1] - c.lf * x[2]) / v
    fy_rear = c.cornering_stiffness_rear * (1 + w[2]) * (c.lr * x[2] - x[1]) / v
    yaw = (c.lf * (fy + fx * delta) - c.lr * fy_rear) / c.yaw_inertia
    return np.array([(fx + fx_rear - fy * delta) / c.mass, (fy + fy_rear + fx * delta) / c.mass, yaw])


def observe(c: SimpleNamespace, x: np.ndarray, w: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return accel_x, accel_y and yaw rate without bias. For the arguments see
    compute_accelerations()."""
    return np.array([*compute_accelerations(c, x, w, u)[:2], x[2]])


def move(
    c: SimpleNamespace, x: np.ndarray, w: np.ndarray, u: np.ndarray, to: np.ndarray, dt: float
) -> np.ndarray:
    """Integrate the states over dt by the Runge-Kutta method. The inputs change linearly
    from `u` to `to`."""

    def rate(x: np.ndarray, share: float) -> np.ndarray:
        a = compute_accelerations(c, x, w, u + share * (to - u))
        return a + np.array([x[1] * x[2], -x[0] * x[2], 0 * x[2]])

    speed = max(
        min(abs(i[k]) * r for i in (u, to) for k, r in ((1, c.wheel_radius_front), (2, c.wheel_radius_rear))),
        LOW_SPEED,
    )
    yaw = (c.cornering_stiffness_front * c.lf**2 + c.cornering_stiffness_rear * c.lr**2) / c.yaw_inertia
    along = (c.longitudinal_stiffness_front + c.longitudinal_stiffness_rear) / c.mass
    across = (c.cornering_stiffness_front + c.cornering_stiffness_rear) / c.mass
    # At nominal stiffness vel_x, vel_y and yaw rate decay at along / speed,
    # across / speed and yaw / speed [1/s]. 1.5 allows for stiffness up to 1.5 * nominal
    steps = int(np.clip(np.ceil(dt * 1.5 * max(along, across, yaw) / speed / MAX_STEP_PRODUCT), 1, 50))
    h = dt / steps
    for k in range(steps):
        k1 = rate(x, k / steps)
        k2 = rate(x + h / 2 * k1, (k + 0.5) / steps)
        k3 = rate(x + h / 2 * k2, (k + 0.5) / steps)
        x = x + h / 6 * (k1 + 2 * (k2 + k3) + rate(x + h * k3, (k + 1) / steps))
    return x


def _hold_inputs(u: np.ndarray) -> np.ndarray:
    """Replace each missing input by the last known value before it or, if there is none,
    by the first known value."""
    last = np.maximum.accumulate(np.where(np.isfinite(u), np.arange(len(u))[:, None], -1), axis=0)
    return np.nan_to_num(np.take_along_axis(u, np.where(last < 0, np.isfinite(u).argmax(0), last), 0))


def _find_conditions(
    c: SimpleNamespace, dt: np.ndarray, u: np.ndarray, y: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return two masks: the rows in which the states restart, and the measurements that
    are used in each row. The rules resemble those of the paper's filter
    (src/paper/row.c).

    `known`: whether a row has all inputs, i.e. steering angle and wheel speeds.

    A restart sets vel_x from the wheel speeds (in the first row from the setting
    initial_vel_x, unless initial_vel_x_from_wheels), vel_y to 0, and the yaw rate from
    the gyro. The states restart in
    - the first row,
    - a row with a wheel slower than the setting hold_speed,
    - a row before the first complete inputs, or more than the setting max_gap after the
      last complete inputs,
    - the row directly after a row of the two previous kinds,
    - a row more than max_gap after the previous row.

    No measurement is used in a row with a wheel slower than hold_speed (also in reverse)
    or a steering angle above max_steer, where the model is not valid, and in a row with
    a missing input, where the last known input may be wrong. A measurement outside its
    range is never used."""
    time = np.cumsum(dt)
    slow = np.minimum(u[:, 1] * c.wheel_radius_front, u[:, 2] * c.wheel_radius_rear) < c.hold_speed
    last = np.maximum.accumulate(np.where(known, np.arange(len(time)), -1))
    off = slow | (last < 0) | (time - time[np.maximum(last, 0)] > c.max_gap)
    restart = off | (dt > c.max_gap) | np.concatenate([[True], off[:-1]])
    low, high = np.array([(f.low, f.high) for f in library().channels if f.name in MEASURES]).T
    usable = (y >= low) & (y <= high) & (known & ~slow & (np.abs(u[:, 0]) <= c.max_steer))[:, None]
    # a restart sets the yaw rate of x from the measured yaw rate (index 2), so the update
    # must not use this measurement again
    usable[restart, 2] = False
    return restart, usable


def _differentiate(f: object, x: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return f(x, w) and its partial derivatives with respect to the twelve states
    z = (x, mu, b, eps), computed by complex steps.

    w = mu + eps, so the derivatives with respect to mu and to eps are those with respect
    to w. f does not depend on the biases b, so these derivatives are 0."""
    step = 1j * TINY * np.eye(6)
    y = f(x[:, None] + step[:3], w[:, None] + step[3:])  # type: ignore[operator]
    d = y.imag / TINY
    return y[:, 0].real, np.hstack([d, np.zeros((3, 3)), d[:, 3:]])


def run_peer(kind: str, rows: np.ndarray, config: Config, known: Known) -> np.ndarray:
    """Run an extended Kalman filter on a log. Return the estimates after each row. The
    stiffnesses are relative to nominal.

    `kind`: "ekf" (has a forgetting factor) or "known" (has none, but increases the
    variance of the mean stiffness at the true change times `known.changes`).
    `rows`: inputs with the fields of NativeFilter.inputs(); NaN is a missing value."""
    c, is_known = SimpleNamespace(**config.as_dict()), kind == "known"
    dt = np.concatenate([[0.0], np.array(rows["dt"][1:], float)])
    inputs, y = (np.array([rows[name] for name in names], float).T for names in (DRIVES, MEASURES))
    driven = np.isfinite(inputs).all(1)
    u, out = _hold_inputs(inputs), np.zeros(len(rows), PEER_DTYPE)
    restart, usable = _find_conditions(c, dt, u, y, driven)
    sd = lambda form, names: np.array([getattr(c, form.format(name)) for name in names]) ** 2  # noqa: E731
    start_x, walk, r = (
        sd("initial_{}_sd", STATES),
        sd("{}_bias_walk", MEASURES),
        np.array(known.noise_sd) ** 2,
    )
    eps = np.array(known.spread, float) ** 2
    first = np.concatenate([start_x, np.full(3, c.initial_mean_sd**2), sd("{}_bias_sd", MEASURES), eps])
    z0 = np.concatenate([np.zeros(3), [getattr(c, f"initial_{s}") - 1 for s in STIFFNESS], np.zeros(6)])
    z, p, time, changes = z0.copy(), np.diag(first), np.cumsum(dt), sorted(known.changes) if is_known else []
    for row in range(len(rows)):
        use, again = np.flatnonzero(usable[row]), bool(restart[row])
        if not again:
            to = np.where([known.held, False, False], u[row - 1], u[row])
            after = lambda x, w: move(c, x, w, u[row - 1], to, dt[row])  # noqa: B023, E731
            f = np.eye(12)
            z[X], f[X] = _differentiate(after, z[X], z[MU] + z[EPS])
            f[EPS], z[EPS] = 0, 0
            p = f @ p @ f.T + np.diag(np.concatenate([np.zeros(6), walk * dt[row], eps]))
            if again := not (np.isfinite(z).all() and np.isfinite(p).all()):
                z, p, use = z0.copy(), np.diag(first), use[use < 2]
        if again:  # restart: speed from the wheels, no lateral velocity, yaw rate from the gyro
            gyro = y[row, 2] - z[8] if np.isfinite(y[row, 2]) else 0.0
            z[X], z[EPS] = (
                [(u[row, 1] * c.wheel_radius_front + u[row, 2] * c.wheel_radius_rear) / 2, 0.0, gyro],
                0,
            )
            if row == 0 and not c.initial_vel_x_from_wheels:
                z[0] = c.initial_vel_x
            p[B, B] += np.diag(walk * dt[row])
            for part, variance in ((X, start_x), (EPS, eps)):
                p[part], p[:, part] = 0, 0
                p[part, part] = np.diag(variance)
        if is_known:
            # as in the simulator, the sd of eps is proportional to the mean stiffness.
            # The cross-covariances of eps in P are 0 before the update
            level = 1 + z[MU]
            while changes and time[row] >= changes[0] - 1e-9:
                changes.pop(0)
                p[MU, MU] += np.outer(level, level) * (COMMON**2 + OWN**2 * np.eye(3))
            eps = (np.array(known.spread) * level) ** 2
            p[EPS, EPS] = np.diag(eps)
        if len(use):
            measured, h = _differentiate(lambda x, w: observe(c, x, w, u[row]), z[X], z[MU] + z[EPS])  # noqa: B023
            h[:, B] = np.eye(3)
            ph = p @ h[use].T
            gain = np.linalg.solve(h[use] @ ph + np.diag(r[use]), ph.T).T
            z += gain @ (y[row] - measured - z[B])[use]
            left = np.eye(12) - gain @ h[use]
            p = left @ p @ left.T + (gain * r[use]) @ gain.T
            z[MU] = np.clip(z[MU], c.stiffness_min - 1, c.stiffness_max - 1)
        sds = np.sqrt(np.maximum(np.diagonal(p), 0))
        mean = np.stack([1 + z[MU], sds[MU], np.sqrt(eps)], 1)
        out[row] = tuple(
            np.concatenate(
                [np.stack([z[X], sds[X]], 1).ravel(), mean.ravel(), np.stack([z[B], sds[B]], 1).ravel()]
            )
        )
        # forgetting, equation (17): scale the rows and columns of mu in P, so that its
        # variance grows, but not above the initial variance
        if len(use) and not is_known:
            scale, now = np.ones(12), np.maximum(np.diagonal(p)[MU], 1e-300)
            forgot = known.forgetting ** (-(dt[row] or c.sample_time) / c.sample_time)
            scale[MU] = np.sqrt(np.minimum(forgot, np.maximum(1.0, c.initial_mean_sd**2 / now)))
            p = p * np.outer(scale, scale)
    return out
