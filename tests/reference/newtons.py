"""The single-track model of (1)-(4) in newtons, for who checks the program under test: inputs linear between rows, integrated by
Runge and Kutta's fourth-order rule in steps of half a millisecond."""

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
