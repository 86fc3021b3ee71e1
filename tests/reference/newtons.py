"""The single-track model of (1)-(4) in newtons, for who checks the program under test: inputs linear between rows,
integrated by Runge
and Kutta's fourth-order rule in steps of half a millisecond, differentiated by complex steps. And a drive of it, with noise."""

import numpy as np


def accelerations(car, x, w, u):
    """(1)-(4): specific force and yaw acceleration. Works for complex x and w, and for columns of them."""
    (vx, vy, r), (delta, omega_f, omega_r) = x, u
    vf, vr = car["wheel_radius_front"] * omega_f, car["wheel_radius_rear"] * omega_r
    larger = lambda a, b: np.where(np.real(a) > np.real(b), a, b)
    fx_f = car["longitudinal_stiffness_front"] * (1 + w[0]) * (vf - vx) / larger(vx, vf)
    follow = 1 + car["rear_longitudinal_follows_front"] * w[0]
    fx_r = car["longitudinal_stiffness_rear"] * follow * (vr - vx) / larger(vx, vr)
    fy_f = car["cornering_stiffness_front"] * (1 + w[1]) * (delta - (vy + car["lf"] * r) / vx)
    fy_r = car["cornering_stiffness_rear"] * (1 + w[2]) * (car["lr"] * r - vy) / vx
    ax, ay = (fx_f + fx_r - fy_f * delta) / car["mass"], (fy_f + fy_r + fx_f * delta) / car["mass"]
    return ax, ay, (car["lf"] * (fy_f + fx_f * delta) - car["lr"] * fy_r) / car["yaw_inertia"]


def rate(car, x, w, u):
    ax, ay, yaw = accelerations(car, x, w, u)
    return np.array([ax + x[1] * x[2], ay - x[0] * x[2], yaw])


def move(car, x, w, u0, u1, dt):
    """x after a row: classical Runge-Kutta, inputs linear between rows."""
    steps = int(np.ceil(dt / 5e-4 - 1e-9))
    at, h = (lambda k: u0 + (u1 - u0) * k / steps), dt / steps
    for k in range(steps):
        k1 = rate(car, x, w, at(k))
        k2 = rate(car, x + h / 2 * k1, w, at(k + 0.5))
        k3 = rate(car, x + h / 2 * k2, w, at(k + 0.5))
        k4 = rate(car, x + h * k3, w, at(k + 1))
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def observe(car, x, w, u):
    ax, ay, _ = accelerations(car, x, w, u)
    return np.array(np.broadcast_arrays(ax, ay, x[2]))


def jacobian(function, at):
    """Complex-step derivative; the function takes columns."""
    return np.imag(function(at[:, None] + 1e-30j * np.eye(len(at)))) * 1e30


def sds(car):
    return np.array([car["accel_x_sd"], car["accel_y_sd"], car["yaw_rate_sd"]])


CAR = {
    "mass": 1900.0, "yaw_inertia": 3000.0, "lf": 1.25, "lr": 1.5, "wheel_radius_front": 0.33, "wheel_radius_rear": 0.33,
    "longitudinal_stiffness_front": 1.6e5, "longitudinal_stiffness_rear": 1.6e5, "cornering_stiffness_front": 1.2e5,
    "cornering_stiffness_rear": 1.4e5, "rear_longitudinal_follows_front": 1.0,
    "accel_x_sd": 0.15, "accel_y_sd": 0.15, "yaw_rate_sd": 0.0035,
}  # fmt: skip
TS, ROWS = 0.01, 2000
SPREAD, MEAN_SD = 0.05, 0.2
BIAS_SD, WALK = np.array([0.05, 0.05, 0.002]), np.array([0.002, 0.002, 0.0001])
X_SD = np.array([0.05, 0.1, 0.01])
UNIT = np.array([1e-6, 1e-4, 1e-4, 1e-4, 1e-4, 1e-6])  # of a logged number: rad, rad/s, rad/s, m/s2, m/s2, rad/s


def drive(rng):
    """The log: steering angle, wheel speeds, accel_x, accel_y, yaw rate as multiples of UNIT; and the true mean."""
    t = TS * np.arange(ROWS)
    speed = 20 + 1.2 * np.sin(2 * np.pi * 0.25 * t) + 0.2 * np.sin(2 * np.pi * 0.9 * t)
    steer = 0.025 * np.sin(2 * np.pi * 0.3 * t) + 0.01 * np.sin(2 * np.pi * 1.1 * t)
    u = np.round(np.array([steer, speed / 0.33, (speed - 0.02) / 0.33]).T / UNIT[:3]) * UNIT[:3]
    x = np.array([(u[0, 1] + u[0, 2]) / 2 * 0.33, 0, 0]) + X_SD * rng.normal(size=3)
    b, mu, sd = BIAS_SD * rng.normal(size=3), np.array([-0.15, 0.12, -0.1]), sds(CAR)
    log = []
    for k in range(ROWS):
        w = mu + SPREAD * rng.normal(size=3)
        y = observe(CAR, x, w, u[k]) + b + sd * rng.normal(size=3)
        log.append(np.round(np.concatenate([u[k], y]) / UNIT))
        if k + 1 < ROWS:
            x, b = move(CAR, x, w, u[k], u[k + 1], TS), b + WALK * np.sqrt(TS) * rng.normal(size=3)
    return np.array(log).astype(int), mu


def short(x):
    """Rounded to single precision, so that the program starts from the same numbers in both formats."""
    return np.float32(x).astype(np.float64)


def numbers(values):
    """C initialiser, nested as the array is."""
    return "{ " + ", ".join(repr(float(v)) if np.ndim(v) == 0 else numbers(v) for v in values) + " }"
