"""Kalman filters with the true covariances, which tse is compared with.

State z = (vel_x, vel_y, yaw_rate; mu; b; eps): mu the mean deviation of the three stiffnesses from nominal, b the
biases, eps the deviation of this sample alone. The same eps disturbs the measurement and moves the car until the next row,

    y_k = h(x_k, mu + eps_k) + b_k + e_k,     x_{k+1} = f(x_k, mu + eps_k),     eps_k ~ N(0, diag(spread^2)) afresh

so process and measurement noise are dependent. Carrying eps_k as a state from its measurement to its prediction takes
that into account exactly: update z with y_k, predict x with the posterior of eps_k, replace eps.

Numbers in brackets are those of src/EQUATIONS.md. Model: (1)-(4) written anew in numpy, not the library's.

Our own, because no well-kept library was found that has dependent noise and forgets a part of the state (filterpy: no
maintainer; pykalman: no EKF; Stone Soup: an object per sample), and adding both would leave little of it in use.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tse.impl.core import STIFFNESS, Config, library
from tse.impl.rows import DRIVES, MEASURES

X, MU, B, EPS = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
LOW_SPEED = 1.0  # m/s, slips are taken over at least this, as in src/model/vehicle.h
STEP = 0.8  # largest rate times step of the integrator: error of a step below 0.8^5/120 of what decays
STATES = ("vel_x", "vel_y", "yaw_rate")
OUTPUT = np.dtype(
    [(f"{name}{end}", float) for name in STATES for end in ("", "_sd")]
    + [(f"{name}{end}", float) for name in STIFFNESS for end in ("", "_sd", "_spread")]
    + [(f"bias_{name}{end}", float) for name in MEASURES for end in ("", "_sd")]
)


@dataclass(frozen=True)
class Known:
    """True values of the simulation, which the filters know."""

    spread: tuple[float, float, float]  # sample-to-sample sd of the stiffness, relative to nominal
    noise_sd: tuple[float, float, float]  # accel_x, accel_y [m/s2], yaw_rate [rad/s]
    forgetting: float = 0.99  # lambda per nominal sample time
    held: bool = False  # the steering angle of a row acts until the next; else it is linear between rows
    changes: tuple[
        float, ...
    ] = ()  # s since the first row: from here on the mean stiffness is another; only "known" uses it


@dataclass(frozen=True)
class Matrices:
    """What the inputs alone decide at one time: slip numerators = n x + n0 (3), (4); accelerations = m F/mass (1)."""

    n: np.ndarray  # (4, 3), rows: front and rear slip, front and rear slip angle
    n0: np.ndarray  # (4, 1), R omega of either axle
    m: np.ndarray  # (3, 4)


class Model:
    """The single-track model on a log's rows, for columns of states; real or complex (for complex-step derivatives)."""

    def __init__(self, rows: np.ndarray, config: Config, held: bool = False):
        c = self.config = config
        self.dt = np.array(rows["dt"], float)
        self.dt[:1] = 0.0
        self.inputs = _held(np.array([rows[name] for name in DRIVES], float).T)
        self.y = np.array([rows[name] for name in MEASURES], float).T
        known = np.isfinite([rows[name] for name in DRIVES]).all(0)
        self.roll = self.inputs[:, 1:] * [c.wheel_radius_front, c.wheel_radius_rear]
        self.k = np.array([[c.longitudinal_stiffness_front], [c.longitudinal_stiffness_rear],
                           [c.cornering_stiffness_front], [c.cornering_stiffness_rear]]) / c.mass  # fmt: skip
        self.share = np.array([[1.0, 0, 0], [c.rear_longitudinal_follows_front, 0, 0], [0, 1, 0], [0, 0, 1]])
        self.jf, self.jr = c.mass * c.lf / c.yaw_inertia, c.mass * c.lr / c.yaw_inertia
        self._at = self._matrices(self.inputs)
        self._between = self._plan(held)
        self.restart, self.usable = self._conditions(known)

    def __len__(self) -> int:
        return len(self.dt)

    def _matrices(self, u: np.ndarray) -> list[Matrices]:
        """Of all times at once. u: (n, 3)."""
        c, count = self.config, len(u)
        n, n0, m = np.zeros((count, 4, 3)), np.zeros((count, 4, 1)), np.zeros((count, 3, 4))
        n[:, 0, 0] = n[:, 1, 0] = n[:, 2, 1] = n[:, 3, 1] = -1
        n[:, 2, 0], n[:, 2, 2], n[:, 3, 2] = u[:, 0], -c.lf, c.lr
        n0[:, 0, 0], n0[:, 1, 0] = c.wheel_radius_front * u[:, 1], c.wheel_radius_rear * u[:, 2]
        m[:, 0, :2] = m[:, 1, 2:] = 1
        m[:, 0, 2], m[:, 1, 0] = -u[:, 0], u[:, 0]
        m[:, 2] = np.stack([self.jf * u[:, 0], 0 * u[:, 0], 0 * u[:, 0] + self.jf, 0 * u[:, 0] - self.jr], 1)
        return [Matrices(*each) for each in zip(n, n0, m, strict=True)]

    def _plan(self, held: bool) -> list[list[Matrices]]:
        """Per row the matrices at the start, middle and end of every step from the row before, inputs linear between, or with
        `held` the steering angle as in the row before. Wheels have inertia: their speeds are linear in any case."""
        c = self.config
        speed = np.maximum(np.minimum(np.abs(self.roll).min(1), np.roll(np.abs(self.roll).min(1), 1)), LOW_SPEED)
        yaw = float(self.k[2, 0] * c.lf * self.jf + self.k[3, 0] * c.lr * self.jr)
        rate = 1.5 * max(float(self.k[:2].sum()), float(self.k[2:].sum()), yaw) / speed  # 1.5: may grip better
        steps = np.clip(np.ceil(self.dt * rate / STEP - 1e-9), 1, 50).astype(int)
        plan: list[list[Matrices]] = [[] for _ in range(len(self))]
        before = np.roll(self.inputs, 1, axis=0)
        change = self.inputs - before
        change[:, 0] *= not held
        for s in np.unique(steps):
            rows = np.flatnonzero(steps == s)
            share = np.arange(2 * s + 1)[None, :, None] / (2 * s)
            u = before[rows, None] + share * change[rows, None]
            flat = self._matrices(u.reshape(-1, 3))
            for i, row in enumerate(rows):
                plan[row] = flat[i * (2 * s + 1) : (i + 1) * (2 * s + 1)]
        return plan

    def _conditions(self, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows at which states start anew, and measurements to learn from: as tse_step() decides in src/estimator/filter.c. Too
        slow, reverse, large angles: the model is not made for them. Inputs missing: prediction only."""
        c, time = self.config, np.cumsum(self.dt)
        slow = self.roll.min(1) < c.hold_speed
        last = np.maximum.accumulate(np.where(known, np.arange(len(time)), -1))
        lost = (last < 0) | (time - time[np.maximum(last, 0)] > c.max_gap)
        restart = (self.dt > c.max_gap) | slow | lost
        restart[1:] |= slow[:-1] | lost[:-1]
        restart[:1] = True
        low, high = np.array([(f.low, f.high) for f in library().channels if f.name in MEASURES]).T
        usable = (self.y >= low) & (self.y <= high)
        usable &= (known & ~slow & (np.abs(self.inputs[:, 0]) <= c.max_steer))[:, None]
        usable[restart, 2] = False  # the gyro made the start
        return restart, usable

    def gains(self, w: np.ndarray) -> np.ndarray:
        """Stiffness over mass (5), (4, columns)."""
        return self.k * (1 + self.share @ w)

    def accelerations(self, at: Matrices, x: np.ndarray, gains: np.ndarray) -> np.ndarray:
        """aX, aY, yaw acceleration (1)-(4)."""
        s = at.n @ x
        s += at.n0
        body = np.where(x[0].real > LOW_SPEED, x[0], LOW_SPEED)
        s[:2] /= np.where(body.real > np.abs(at.n0[:2]), body, np.abs(at.n0[:2]))
        s[2:] /= body
        s *= gains
        return at.m @ s

    def rate(self, at: Matrices, x: np.ndarray, gains: np.ndarray) -> np.ndarray:
        a = self.accelerations(at, x, gains)
        a[0] += x[1] * x[2]
        a[1] -= x[0] * x[2]
        return a

    def move(self, row: int, x: np.ndarray, w: np.ndarray) -> np.ndarray:
        """x of the row before -> x of this row (7), by Runge and Kutta's fourth-order rule. x, w: (3, columns)."""
        gains, path = self.gains(w), self._between[row]
        h = self.dt[row] / (len(path) // 2)
        for i in range(0, len(path) - 2, 2):
            k1 = self.rate(path[i], x, gains)
            k2 = self.rate(path[i + 1], x + (0.5 * h) * k1, gains)
            k3 = self.rate(path[i + 1], x + (0.5 * h) * k2, gains)
            k4 = self.rate(path[i + 2], x + h * k3, gains)
            x = x + (h / 6) * (k1 + 2 * (k2 + k3) + k4)
        return x

    def observe(self, row: int, x: np.ndarray, w: np.ndarray) -> np.ndarray:
        """accel_x, accel_y, yaw_rate without bias and noise (9)."""
        y = self.accelerations(self._at[row], x, self.gains(w))
        y[2] = x[2]
        return y

    def linear_observation(self, row: int, x: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """h and its derivative by the twelve states."""
        y = self.observe(row, *_complex(x, w))
        h = np.zeros((3, 12))
        h[:, :6] = y.imag / TINY
        h[:, EPS] = h[:, MU]
        h[:, B] = np.eye(3)
        return y[:, 0].real, h

    def linear_motion(self, row: int, x: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """f and the transition of the twelve states: x by (x, mu, eps); mu and b stay; eps goes."""
        after = self.move(row, *_complex(x, w))
        f = np.zeros((12, 12))
        f[X, :6] = after.imag / TINY
        f[X, EPS] = f[X, MU]
        f[MU, MU] = f[B, B] = np.eye(3)
        return after[:, 0].real, f


TINY = 1e-30
_PERTURB = 1j * TINY * np.eye(6)


def _complex(x: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns for the complex-step derivative, which is exact to rounding."""
    return x[:, None] + _PERTURB[:3], w[:, None] + _PERTURB[3:]


def _held(u: np.ndarray) -> np.ndarray:
    """A missing input keeps its last value (the first known one at the start)."""
    u = u.copy()
    for column in u.T:
        known = np.isfinite(column)
        last = np.maximum.accumulate(np.where(known, np.arange(len(column)), -1))
        first = int(known.argmax()) if known.any() else 0
        column[:] = np.nan_to_num(column[np.where(last < 0, first, last)])
    return u


class Noise:
    """Covariances that the filters (and the bounds) share."""

    def __init__(self, config: Config, known: Known):
        c = config
        self.start_x = np.array([c.initial_vel_x_sd, c.initial_vel_y_sd, c.initial_yaw_rate_sd]) ** 2
        self.start_mu = np.full(3, c.initial_mean_sd**2)
        self.start_b = np.array([c.accel_x_bias_sd, c.accel_y_bias_sd, c.yaw_rate_bias_sd]) ** 2
        self.eps = np.array(known.spread, float) ** 2
        self.walk = np.array([c.accel_x_bias_walk, c.accel_y_bias_walk, c.yaw_rate_bias_walk]) ** 2  # per second
        self.r = np.array(known.noise_sd, float) ** 2
        self.log_forgetting = np.log(known.forgetting) / c.sample_time  # per second: forgetting goes by time

    def start(self) -> np.ndarray:
        return np.diag(np.concatenate([self.start_x, self.start_mu, self.start_b, self.eps]))

    def restart(self, p: np.ndarray, dt: float) -> np.ndarray:
        """States and eps as at the start, without correlations; the biases walked on."""
        p = p.copy()
        p[B, B] += np.diag(self.walk * dt)
        for part, variance in ((X, self.start_x), (EPS, self.eps)):
            p[part], p[:, part] = 0, 0
            p[part, part] = np.diag(variance)
        return p

    def process(self, dt: float) -> np.ndarray:
        """What the prediction adds: the biases' walk (8) and a fresh eps."""
        return np.diag(np.concatenate([np.zeros(6), self.walk * dt, self.eps]))

    def forget(self, p: np.ndarray, dt: float) -> np.ndarray:
        """Variance of mu over lambda, whole rows and columns (correlations stay); not beyond that of the start, else
        it would grow without end while nothing is excited."""
        if self.log_forgetting == 0.0:
            return p
        now = np.maximum(np.diagonal(p)[MU], 1e-300)
        scale = np.ones(12)
        scale[MU] = np.sqrt(np.minimum(np.exp(-self.log_forgetting * dt), np.maximum(1.0, self.start_mu / now)))
        return p * np.outer(scale, scale)


def update(p: np.ndarray, h: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gain and covariance after a measurement, in Joseph's form. r: variances."""
    ph = p @ h.T
    gain = np.linalg.solve(h @ ph + np.diag(r), ph.T).T
    left = np.eye(len(p)) - gain @ h
    return gain, left @ p @ left.T + (gain * r) @ gain.T


class Kalman:
    """What both filters have in common; `observe` and `predict` differ."""

    def __init__(self, rows: np.ndarray, config: Config, known: Known):
        self.config, self.known = config, known
        self.model, self.noise = Model(rows, config, known.held), Noise(config, known)
        self.start()

    def start(self) -> None:
        self.mean, self.cov = np.zeros(12), self.noise.start()
        self.mean[MU] = [getattr(self.config, f"initial_{s}") - 1 for s in STIFFNESS]

    def start_states(self, row: int) -> None:
        """As tse: from the wheels, straight ahead at the gyro's rate."""
        c, gyro = self.config, self.model.y[row, 2]
        self.mean[X] = [self.model.roll[row].mean(), 0.0, gyro - self.mean[8] if np.isfinite(gyro) else 0.0]
        if row == 0 and not c.initial_vel_x_from_wheels:
            self.mean[0] = c.initial_vel_x
        self.mean[EPS] = 0
        self.cov = self.noise.restart(self.cov, self.model.dt[row])

    def run(self) -> np.ndarray:
        out = np.zeros(len(self.model), OUTPUT)
        low, high = self.config.stiffness_min - 1, self.config.stiffness_max - 1
        for row in range(len(out)):
            use = np.flatnonzero(self.model.usable[row])
            if self.model.restart[row]:
                self.start_states(row)
            else:
                self.predict(row)
                if not (np.isfinite(self.mean).all() and np.isfinite(self.cov).all()):
                    self.start()  # whatever was logged, the next estimate is a number
                    self.start_states(row)
                    use = use[use < 2]  # the gyro made the start
            self.listen(row)
            if len(use):
                self.observe(row, use)
                self.mean[MU] = np.clip(self.mean[MU], low, high)
            self._write(out[row : row + 1])
            if len(use):  # what no sample replaces is not forgotten
                self.cov = self.noise.forget(self.cov, self.model.dt[row] or self.config.sample_time)
        return out

    def _write(self, out: np.ndarray) -> None:
        sd = np.sqrt(np.maximum(np.diagonal(self.cov), 0))
        # the order of OUTPUT
        out.view(float)[:] = np.concatenate(
            [
                np.stack([self.mean[X], sd[X]], 1).ravel(),
                np.stack([1 + self.mean[MU], sd[MU], np.sqrt(self.noise.eps)], 1).ravel(),
                np.stack([self.mean[B], sd[B]], 1).ravel(),
            ]
        )

    def listen(self, row: int) -> None:
        """Return what is known of this row."""

    def observe(self, row: int, use: np.ndarray) -> None:
        raise NotImplementedError

    def predict(self, row: int) -> None:
        raise NotImplementedError


class Extended(Kalman):
    """Linearised at the estimate."""

    def observe(self, row: int, use: np.ndarray) -> None:
        y, h = self.model.linear_observation(row, self.mean[X], self.mean[MU] + self.mean[EPS])
        gain, self.cov = update(self.cov, h[use], self.noise.r[use])
        self.mean = self.mean + gain @ (self.model.y[row] - y - self.mean[B])[use]

    def predict(self, row: int) -> None:
        x, f = self.model.linear_motion(row, self.mean[X], self.mean[MU] + self.mean[EPS])
        self.mean[X], self.mean[EPS] = x, 0
        self.cov = f @ self.cov @ f.T + self.noise.process(self.model.dt[row])


class Constant(Extended):
    """Knows when the mean stiffness changes: it never forgets in between, and opens the means at each change. The spread that
    it is given is one of mean stiffness 1 and follows the level, as the simulator's does. No filter that has to find the
    changes can be expected to do better."""

    common, own = 0.4, 0.1  # sd of a change over the level: of all stiffnesses together, of each

    def start(self) -> None:
        super().start()
        self.noise.log_forgetting = 0.0
        self._time = np.cumsum(self.model.dt)
        self._changes = sorted(self.known.changes)

    def listen(self, row: int) -> None:
        level = 1 + self.mean[MU]
        while self._changes and self._time[row] >= self._changes[0] - 1e-9:
            self._changes.pop(0)
            self.cov[MU, MU] += np.outer(level, level) * (self.common**2 + self.own**2 * np.eye(3))
        self.noise.eps = (np.array(self.known.spread) * level) ** 2
        self.cov[EPS, EPS] = np.diag(self.noise.eps)  # afresh in this row, and therefore without correlations


class Unscented(Kalman):
    """Scaled sigma points of all twelve states, eps among them (Wan & van der Merwe 2000, augmented form).

    alpha = 1/2, kappa = 0: the points lie alpha sqrt(12) = sqrt(3) sd out; with alpha = 1 a 30 % sd of the mean would give
    tyres of negative stiffness. beta = 2, that of a Gaussian; covariances stay positive, since beta >= alpha^2 and only
    the central weight is negative.
    """

    _alpha, _beta, _n = 0.5, 2.0, 12
    _spread = _alpha**2 * _n
    _mean = np.concatenate([[1 - _n / _spread], np.full(2 * _n, 0.5 / _spread)])
    _cov = _mean + np.concatenate([[1 - _alpha**2 + _beta], np.zeros(2 * _n)])

    def points(self) -> np.ndarray:
        """(12, 25)."""
        root = _root(self.cov * self._spread)
        return self.mean[:, None] + np.concatenate([np.zeros((12, 1)), root, -root], 1)

    def observe(self, row: int, use: np.ndarray) -> None:
        z = self.points()
        y = (self.model.observe(row, z[X], z[MU] + z[EPS]) + z[B])[use]
        mean = y @ self._mean
        dy = y - mean[:, None]
        weighted = dy * self._cov
        s = weighted @ dy.T + np.diag(self.noise.r[use])
        cross = (z - self.mean[:, None]) @ weighted.T
        gain = np.linalg.solve(s, cross.T).T
        self.mean = self.mean + gain @ (self.model.y[row, use] - mean)
        cov = self.cov - gain @ s @ gain.T
        self.cov = (cov + cov.T) / 2

    def predict(self, row: int) -> None:
        z = self.points()
        z[X] = self.model.move(row, z[X], z[MU] + z[EPS])
        self.mean[X] = z[X] @ self._mean
        self.mean[EPS] = 0
        d = z - self.mean[:, None]
        d[EPS] = 0
        self.cov = (d * self._cov) @ d.T + self.noise.process(self.model.dt[row])


def _root(p: np.ndarray) -> np.ndarray:
    """Any A with A A' = p; states without doubt make p singular, and rounding less than that."""
    try:
        return np.linalg.cholesky(p)
    except np.linalg.LinAlgError:
        if not np.isfinite(p).all():
            return np.full_like(p, np.nan)  # run() starts anew
        value, vector = np.linalg.eigh(p)
        return vector * np.sqrt(np.maximum(value, 0))


KINDS: dict[str, type[Kalman]] = {"ekf": Extended, "ukf": Unscented, "known": Constant}


def run(kind: str, rows: np.ndarray, config: Config, known: Known) -> np.ndarray:
    """Estimates after each row. kind: of KINDS; rows: as Filter.inputs(), NaN = missing; result: as OUTPUT, stiffness
    relative to nominal."""
    if kind not in KINDS:
        raise ValueError(f"kind is {kind!r}, not one of {', '.join(KINDS)}")
    with np.errstate(over="ignore", invalid="ignore"):  # a state that explodes is started anew
        return KINDS[kind](rows, config, known).run()
