"""The extended Kalman filters that tse is compared with.

They are compared with least squares over a whole window, and run on all a log may hold.
"""

import functools
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tse.library.core import NOMINAL, STIFFNESS, Config, NativeFilter, SimConfig
from tse.log.rows import DRIVES, MEASURES, list_columns
from tse.simulation import maneuvers
from tse.simulation.simulate import simulate
from tselab.montecarlo import peers
from tselab.montecarlo.case import INITIAL_SETTINGS

# the other estimators of a study; only scripts/results depends on them
pytestmark = pytest.mark.slow

KINDS = ("ekf", "known")
SPREAD = 0.05  # of SimConfig
SENSORS = tuple(f"{name}_sd" for name in MEASURES)


@dataclass
class Drive:
    """What a filter is given, and the truth."""

    config: Config
    rows: np.ndarray
    known: peers.Known
    truth: pd.DataFrame

    @property
    def time(self) -> np.ndarray:
        return self.truth["time"].to_numpy()

    @property
    def mean(self) -> np.ndarray:
        return np.array([self.truth[f"true_{s}"] / getattr(self.config, NOMINAL[s]) for s in STIFFNESS]).T

    def run(self, kind: str) -> np.ndarray:
        return peers.run_peer(kind, self.rows, self.config, self.known)


def drive(
    name: str = "square-waves",
    *,
    seed: int = 1,
    duration: float = 10.0,
    dt: float = 0.01,
    noise: float = 1.0,
    low: bool = False,
    settings: dict | None = None,
    sim: dict | None = None,
    road: list | None = None,
    forgetting: float = 0.99,
) -> Drive:
    """Simulate a drive; low: slip of half a per cent, steering of 0.005 rad."""
    config = Config.exact({**INITIAL_SETTINGS, "sample_time": dt, **(settings or {})})
    maneuver = maneuvers.build(name, config, sample_time=dt, duration=duration, road=road)
    if low:
        maneuver.wheel_torque_front = maneuver.wheel_torque_front * 250 / 700
        maneuver.steer_angle = maneuver.steer_angle * 0.005 / 0.02
    simulation = simulate(maneuver, config, SimConfig({"seed": seed, "noise": noise, **(sim or {})}))
    rows = NativeFilter(config).inputs(len(maneuver.time))
    rows["dt"] = dt
    for channel in list_columns()[1:]:
        rows[channel] = simulation.log[channel]
    sensors = tuple(noise * getattr(config, s) for s in SENSORS)
    return Drive(config, rows, peers.Known((SPREAD,) * 3, sensors, forgetting), simulation.truth)


# ---- the reference: (1)-(4) in newtons, inputs linear between rows, Runge and Kutta's
# fourth-order rule in steps of half a millisecond


def compute_reference_accelerations(car, x, w, u):
    """Return specific force and yaw acceleration by (1)-(4), also for columns."""
    (vx, vy, r), (delta, omega_f, omega_r) = x, u
    vf, vr = car["wheel_radius_front"] * omega_f, car["wheel_radius_rear"] * omega_r
    fx_f = car["longitudinal_stiffness_front"] * (1 + w[0]) * (vf - vx) / np.maximum(vx, vf)
    follow = 1 + car["rear_longitudinal_follows_front"] * w[0]
    fx_r = car["longitudinal_stiffness_rear"] * follow * (vr - vx) / np.maximum(vx, vr)
    fy_f = car["cornering_stiffness_front"] * (1 + w[1]) * (delta - (vy + car["lf"] * r) / vx)
    fy_r = car["cornering_stiffness_rear"] * (1 + w[2]) * (car["lr"] * r - vy) / vx
    ax, ay = (fx_f + fx_r - fy_f * delta) / car["mass"], (fy_f + fy_r + fx_f * delta) / car["mass"]
    return ax, ay, (car["lf"] * (fy_f + fx_f * delta) - car["lr"] * fy_r) / car["yaw_inertia"]


def compute_reference_rate(car, x, w, u):
    ax, ay, yaw = compute_reference_accelerations(car, x, w, u)
    return np.array([ax + x[1] * x[2], ay - x[0] * x[2], yaw])


def move_reference(car, x, w, u0, u1, dt):
    """Return x after a row: classical Runge-Kutta, inputs linear between rows."""
    steps = int(np.ceil(dt / 5e-4 - 1e-9))
    at, h = (lambda k: u0 + (u1 - u0) * k / steps), dt / steps
    for k in range(steps):
        k1 = compute_reference_rate(car, x, w, at(k))
        k2 = compute_reference_rate(car, x + h / 2 * k1, w, at(k + 0.5))
        k3 = compute_reference_rate(car, x + h / 2 * k2, w, at(k + 0.5))
        k4 = compute_reference_rate(car, x + h * k3, w, at(k + 1))
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def observe_reference(car, x, w, u):
    ax, ay, _ = compute_reference_accelerations(car, x, w, u)
    return np.array(np.broadcast_arrays(ax, ay, x[2]))


# ---- what is compared


def get_estimates(out: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.array([out[s] for s in STIFFNESS]).T, np.array([out[f"{s}_sd"] for s in STIFFNESS]).T


def is_finite(out: np.ndarray) -> bool:
    return all(np.isfinite(out[name]).all() for name in out.dtype.names)


# ---- least squares over a whole window


class Window:
    """A short drive as one linear problem: measurements as functions of random numbers.

    theta = (x0, mu, b0, eps of each row, step of the biases before each row but the
    first), whitened: N(0, 1). The functions run the reference's model from the first row
    to the last. Their derivative is a central difference.
    """

    ROWS, DT = 25, 0.01
    step = 1.0  # of the difference, in sds

    def __init__(self, scale: float):
        """`scale` multiplies every sd; with a small one any problem is linear."""
        n = self.ROWS
        self.config = config = Config.exact(
            {
                **{f"initial_{s}": v for s, v in zip(STIFFNESS, (0.9, 1.1, 1.05), strict=True)},
                "initial_mean_sd": 0.3 * scale,
                **{
                    f"initial_{k}_sd": v * scale
                    for k, v in (("vel_x", 0.1), ("vel_y", 0.1), ("yaw_rate", 0.01))
                },
                **{f"{m}_bias_sd": getattr(Config.exact(), f"{m}_bias_sd") * scale for m in MEASURES},
                **{f"{m}_bias_walk": 5 * getattr(Config.exact(), f"{m}_bias_walk") * scale for m in MEASURES},
            }
        )
        self.car = config.as_dict()
        sensors = np.array([getattr(Config.exact(), s) for s in SENSORS]) * scale
        self.spread = np.array([0.05, 0.1, 0.03]) * scale
        self.known = peers.Known(tuple(self.spread), tuple(sensors), 1.0)
        t = self.DT * np.arange(n)
        self.u = np.array(
            [0.02 + 0.02 * np.sin(15 * t), (20.3 + 2 * t) / 0.33, (20.1 - 0.3 * np.sin(9 * t)) / 0.33]
        ).T
        self.start = np.array([self.u[0, 1:].mean() * 0.33, 0.1, 0.02])
        self.mu = np.array([getattr(config, f"initial_{s}") - 1 for s in STIFFNESS])
        get = lambda form: np.array([getattr(config, form.format(m)) for m in MEASURES])  # noqa: E731
        x_sd = np.array([config.initial_vel_x_sd, config.initial_vel_y_sd, config.initial_yaw_rate_sd])
        self.sd = np.concatenate(
            [
                x_sd, np.full(3, config.initial_mean_sd), get("{}_bias_sd"),
                np.tile(self.spread, n), np.tile(get("{}_bias_walk") * np.sqrt(self.DT), n - 1),
            ]
        )  # fmt: skip
        self.sensors = sensors

    def trajectory(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return x, b, y, (rows, 3, columns), for whitened theta in columns."""
        n, theta = self.ROWS, self.sd[:, None] * theta
        eps = theta[9 : 9 + 3 * n].reshape(n, 3, -1)
        steps = np.concatenate([theta[None, 6:9], theta[9 + 3 * n :].reshape(n - 1, 3, -1)])
        b = np.cumsum(steps, axis=0)
        x, mu = [self.start[:, None] + theta[:3]], self.mu[:, None] + theta[3:6]
        for k in range(1, n):
            x.append(
                move_reference(self.car, x[-1], mu + eps[k - 1], *self.u[k - 1 : k + 1, :, None], self.DT)
            )
        y = [observe_reference(self.car, x[k], mu + eps[k], self.u[k][:, None]) + b[k] for k in range(n)]
        return np.array(x), b, np.array(y)

    @functools.cached_property
    def linear(self) -> tuple[np.ndarray, ...]:
        """Return the derivatives of x, b and y by whitened theta."""
        each = self.step * np.eye(len(self.sd))
        ahead, back = self.trajectory(each), self.trajectory(-each)
        return tuple((a - b) / (2 * self.step) for a, b in zip(ahead, back, strict=True))

    def rows(self, y: np.ndarray) -> np.ndarray:
        rows = NativeFilter(self.config).inputs(self.ROWS)
        rows["dt"] = self.DT
        for name, values in zip((*DRIVES, *MEASURES), (*self.u.T, *y.T), strict=True):
            rows[name] = values
        return rows

    def information(self, use: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return prior and measurements as one whitened system a theta = ...

        `use`, (rows, 3), selects the measurements.
        """
        a = (self.linear[2] / self.sensors[:, None])[use]
        return a, np.eye(len(self.sd)) + a.T @ a


def test_estimates_equal_weighted_least_squares_over_the_whole_window(monkeypatch):
    """With noise a ten-thousandth of a car's, the filters' problem is linear.

    Its solution is that of least squares on all rows at once, without the missing
    channels. The remaining curvature is of that order. Steps are short, since the sd of
    vel_x is less than a thousandth of a millimetre per second here.
    """
    monkeypatch.setattr(peers, "MAX_STEP_PRODUCT", 0.02)
    window, rng = Window(1e-4), np.random.default_rng(5)
    use = np.ones((window.ROWS, 3), bool)
    use[0, 2] = False  # the filters start from the first yaw rate
    use[5, 0] = use[8:12, 1] = use[12:16, 2] = use[18] = False
    theta = rng.standard_normal(len(window.sd))
    theta[:3] = 0.0  # starts where the filters start: at the wheels' speed, straight ahead
    window.start[1], window.start[2] = 0.0, 0.02
    clean = window.trajectory(theta[:, None])[2][..., 0]
    y = clean + window.sensors * rng.standard_normal(clean.shape)
    y[0, 2] = window.start[2]
    y[~use & (np.arange(window.ROWS) > 0)[:, None]] = np.nan

    out = peers.run_peer("ekf", window.rows(y), window.config, window.known)

    a, information = window.information(use)
    foretold = window.trajectory(np.zeros((len(window.sd), 1)))
    best = np.linalg.solve(information, a.T @ ((y - foretold[2][..., 0]) / window.sensors)[use])
    covariance = np.linalg.inv(information)
    x, b = window.linear[0][-1], window.linear[1][-1]
    mu = np.zeros((3, len(window.sd)))
    mu[:, 3:6] = np.diag(window.sd[3:6])
    expected = {name: (foretold[0][-1, i, 0] + x[i] @ best, x[i]) for i, name in enumerate(peers.STATES)}
    expected |= {name: (1 + window.mu[i] + mu[i] @ best, mu[i]) for i, name in enumerate(STIFFNESS)}
    expected |= {f"bias_{name}": (b[i] @ best, b[i]) for i, name in enumerate(MEASURES)}
    for name, (value, row) in expected.items():
        sd = np.sqrt(row @ covariance @ row)
        assert out[f"{name}_sd"][-1] == pytest.approx(sd, rel=1e-3), name
        assert abs(out[name][-1] - value) < 2e-3 * sd, name


def test_a_sample_moves_the_stiffness_by_a_sensible_amount():
    """Guards the test above: the window must teach, or any filter would pass it."""
    window = Window(1e-4)
    use = np.ones((window.ROWS, 3), bool)
    sd = window.sd[3:6] * np.sqrt(np.diag(np.linalg.inv(window.information(use)[1]))[3:6])
    assert (sd < 0.5 * window.config.initial_mean_sd).sum() >= 2


@pytest.mark.parametrize(("dt", "speed"), [(0.04, 20.0), (0.01, 2.5), (0.04, 2.5)])
def test_long_rows_and_low_speeds_are_integrated_in_several_steps(dt, speed):
    config = Config.exact({"sample_time": dt})
    rows = NativeFilter(config).inputs(2)
    rows["dt"], rows["steer_angle"] = dt, [0.02, 0.03]
    rows["wheel_speed_front"], rows["wheel_speed_rear"] = (
        [speed / 0.33, (speed + 0.05) / 0.33],
        (speed - 0.02) / 0.33,
    )
    x, w = np.array([speed, 0.05, 0.02]), np.array([0.1, 0.2, 0.1])
    u, to = np.array([rows[name] for name in DRIVES]).T
    exact = move_reference(config.as_dict(), x, w, u, to, dt)
    moved = peers.move(SimpleNamespace(**config.as_dict()), x[:, None], w[:, None], u, to, dt)
    np.testing.assert_allclose(moved[:, 0], exact, atol=2e-5)


# ---- what a log may hold


def test_who_is_told_that_inputs_are_held_moves_as_the_simulator_does():
    """When the steering turns, its row's motion does not yet show the turn.

    That row has no measurement here.
    """
    d = drive(duration=4.0, sim={"hold_inputs": 1})
    flip = np.searchsorted(d.time, 2.0 - 1e-9)
    for name in MEASURES:
        d.rows[name][flip] = np.nan
    yaw = [
        peers.run_peer("ekf", d.rows, d.config, replace(d.known, held=held))["yaw_rate"]
        for held in (True, False)
    ]
    turned = np.abs([y[flip] - y[flip - 1] for y in yaw])
    assert turned[0] < 5e-4 and turned[1] > 0.002, turned


@pytest.mark.slow
def test_errors_are_half_of_what_the_filter_believes_of_them():
    """Forgetting makes the filter's variance 1 + lambda times that of its error.

    The start is 30 % off, 1 sd; biases are drawn and walk. Rows are four memories apart,
    so that their errors are nearly independent. The intervals are 99.8 %. Cx may be up to
    15 % worse: a stiffness that is 9 % off is a worse place to linearise at.
    """
    shares = []
    for seed in range(1, 9):
        bias = np.random.default_rng(seed).standard_normal(3)
        start = {
            f"true_bias_{m}": b * getattr(Config.exact(), f"{m}_bias_sd")
            for m, b in zip(MEASURES, bias, strict=True)
        }
        d = drive(duration=20.0, seed=seed, sim={**start, "bias_walk": 1.0})
        mean, sd = get_estimates(d.run("ekf"))
        at = np.searchsorted(d.time, np.array((8.0, 12.0, 16.0, 20.0)) - 1e-6)
        shares.append(1.99 * (((mean - d.mean) / sd)[at]) ** 2)
    low, high = stats.chi2.interval(0.998, 32)
    total = np.sum(shares, axis=(0, 1))
    assert (total > low).all() and (total < high * np.array([1.15**2, 1, 1])).all(), total / 32


def test_what_nothing_excites_any_more_is_forgotten_up_to_the_variance_of_the_start():
    d = drive(duration=20.0)
    for name in ("accel_y", "yaw_rate", "steer_angle"):
        d.rows[name][600:] = 0.0  # straight ahead: no side force, nothing about the lateral stiffness
    sd = get_estimates(d.run("ekf"))[1][:, 1:]
    np.testing.assert_allclose(sd[660] / sd[650], d.known.forgetting**-5, rtol=1e-3)
    np.testing.assert_allclose(sd[-1], d.config.initial_mean_sd, rtol=1e-3)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", DRIVES)
def test_a_missing_input_teaches_nothing_and_ends(kind, name):
    d = drive(duration=6.0)
    gap = slice(300, 340)  # longer than max_gap: states start again
    whole = get_estimates(d.run(kind))
    d.rows[name][gap] = np.nan
    mean, sd = get_estimates(out := d.run(kind))
    assert is_finite(out)
    for held in (mean, sd):
        np.testing.assert_allclose(held[gap][1:], held[gap][:1].repeat(39, 0), atol=1e-9)
    assert np.abs(mean[-1] - whole[0][-1]).max() < 2 * whole[1][-1].max()


def test_values_that_no_sensor_has_are_missing():
    d = drive(duration=2.0)
    d.rows["accel_x"][50:60] = np.nan
    missing = d.run("ekf")
    d.rows["accel_x"][50:60] = 1e6
    assert (d.run("ekf") == missing).all()


def spin_wheel(d: Drive) -> None:
    d.rows["wheel_speed_front"][200:300] *= 3


def freeze_sensors(d: Drive) -> None:
    for name in ("accel_y", "wheel_speed_rear"):
        d.rows[name][200:400] = d.rows[name][200]


def lose_channels(d: Drive) -> None:
    for name in (*DRIVES, *MEASURES):
        d.rows[name][:20] = np.nan
        d.rows[name][300:310] = np.nan


def make_gap(d: Drive) -> None:
    d.rows["dt"][300] = 5.0


HARD = {
    "road change": ({"road": [(2.0, 0.3), (4.0, 1.0)]}, None),
    "noise": ({"noise": 3.0}, None),
    "low excitation": ({"low": True}, None),
    "short rows": ({"dt": 0.005, "duration": 3.0}, None),
    "long rows": ({"dt": 0.04}, None),
    "standstill": ({"name": "stop-and-go", "duration": 22.0, "dt": 0.02}, None),
    "wheel spin": ({}, spin_wheel),
    "stuck channels": ({}, freeze_sensors),
    "nothing logged": ({}, lose_channels),
    "gap": ({}, make_gap),
    "no noise of the stiffness": ({"sim": {f"spread_{s}": 0.0 for s in STIFFNESS}}, None),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("case", HARD)
def test_every_hard_case_ends_with_numbers(kind, case):
    arguments, harm = HARD[case]
    d = drive(**{"duration": 6.0, **arguments})
    if case.startswith("no noise"):
        d = Drive(d.config, d.rows, peers.Known((0.0,) * 3, d.known.noise_sd), d.truth)
    if harm:
        harm(d)
    mean, _ = get_estimates(out := d.run(kind))
    assert is_finite(out)
    assert (mean >= d.config.stiffness_min - 1e-9).all() and (mean <= d.config.stiffness_max + 1e-9).all()


@pytest.mark.parametrize("level", [0.5, 0.7, 1.4])
def test_who_is_told_of_a_change_follows_it_at_once_and_forgets_nothing_before_and_after(level):
    d = drive(
        duration=16.0, road=[(8.0, level)], sim=dict.fromkeys([f"spread_{s}" for s in STIFFNESS], SPREAD)
    )
    known = replace(d.known, changes=(8.0,), forgetting=0.9)  # of which it takes no notice
    mean, sd = get_estimates(out := peers.run_peer("known", d.rows, d.config, known))
    event = np.searchsorted(d.time, 8.0 - 1e-9)
    assert (sd[event] > 3 * sd[event - 1]).all()
    for part in (slice(200, event), slice(event, None)):
        assert (
            np.diff(sd[part], axis=0) < 0.01 * sd[part][1:]
        ).all()  # linearised anew, a little more now and then
    error = mean / d.mean - 1
    assert (np.abs(error[event + 50 :, 1:]) < 0.10).all()  # Cx waits for the next change of torque
    late = d.time > 13
    assert (np.abs(error[late]) < 3 * sd[late] / level).all() and (
        sd[late] / level < [0.03, 0.01, 0.01]
    ).all()
    spread = [out[f"{s}_spread"][late].mean() for s in STIFFNESS]
    assert spread == pytest.approx([SPREAD * level] * 3, rel=0.02)

    deaf = get_estimates(peers.run_peer("known", d.rows, d.config, replace(known, changes=())))[0]
    assert (np.abs(deaf / d.mean - 1)[event + 50] > 0.10).all()
