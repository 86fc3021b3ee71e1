#!/usr/bin/env python3
"""Write kalman_table.h: a Kalman filter for a case in which the particle filter must agree with one (test_kalman.c).

turning  Constant wheel speeds, a slowly swaying steering angle of 0.03 rad. With the mean of the stiffness known and its
         spread known (5 %), w is white Gaussian noise that enters the motion and the accelerometers at once; vel_y, yaw
         rate and biases then are linear and Gaussian, except that d depends on the slip angle, which is known to 1 %.
         State of the Kalman filter: [vel_x, vel_y, yaw_rate, 3 biases, w], the noise w being estimated with the sample
         that it disturbs, which is what carries the correlation of process and measurement noise. Motion: (1)-(4)
         integrated by scipy to 1e-10, linearised by differences. Update: Joseph form.

Measurements are drawn here from the same models.
    python3 generate_kalman.py        writes kalman_table.h next to this file; needs numpy and scipy; deterministic
"""

from pathlib import Path

import numpy as np
from newtons import numbers, short
from scipy.integrate import solve_ivp
from scipy.stats import multivariate_normal

M, INERTIA, LF, LR, RADIUS = 1900.0, 3000.0, 1.25, 1.5, 0.33
CX_F, CX_R, CY_F, CY_R = 1.6e5, 1.6e5, 1.2e5, 1.4e5  # defaults of tse/config.h
SD = np.array([0.15, 0.15, short(0.0035)])
BIAS_SD = np.array([0.05, 0.05, 0.002])
WALK = np.array([0.002, 0.002, 0.0001])
TS, OMEGA, SPREAD = 0.01, 60.0, 0.05
X_SD = np.array([0.0, 0.005, 0.003])
V = RADIUS * OMEGA


def forces(x, w, delta):
    """Specific force and yaw acceleration with the stiffness C (1 + w); the rear longitudinal one follows the front's."""
    vx, vy, r = x
    slip = (V - vx) / max(V, vx)
    fx_f, fx_r = CX_F * (1 + w[0]) * slip, CX_R * (1 + w[0]) * slip
    fy_f = CY_F * (1 + w[1]) * (delta - (vy + LF * r) / vx)
    fy_r = CY_R * (1 + w[2]) * (LR * r - vy) / vx
    ax, ay = (fx_f + fx_r - fy_f * delta) / M, (fy_f + fy_r + fx_f * delta) / M
    return ax, ay, (LF * (fy_f + fx_f * delta) - LR * fy_r) / INERTIA


def move(x, w, delta0, delta1):
    """x one sample later, steering linear between rows."""

    def rate(t, x):
        ax, ay, acc = forces(x, w, delta0 + (delta1 - delta0) * t / TS)
        return [ax + x[1] * x[2], ay - x[0] * x[2], acc]

    return solve_ivp(rate, (0, TS), x, rtol=1e-10, atol=1e-12).y[:, -1]


def observe(x, w, delta):
    ax, ay, _ = forces(x, w, delta)
    return np.array([ax, ay, x[2]])


def jacobian(f, at, step):
    return np.array([(f(at + e) - f(at - e)) / (2 * step) for e in step * np.eye(len(at))]).T


def turning(rng, rows):
    steer = short(0.03 * np.sin(2 * np.pi * 0.4 * TS * np.arange(rows)))
    x = np.array([V, *(X_SD[1:] * rng.normal(size=2))])
    b = BIAS_SD * rng.normal(size=3)
    mean = np.array([V, 0, 0, 0, 0, 0, 0, 0, 0.0])
    cov = np.diag(np.concatenate([X_SD, BIAS_SD, [SPREAD] * 3]) ** 2)
    out = []
    for k in range(rows):
        w = SPREAD * rng.normal(size=3)
        y = short(observe(x, w, steer[k]) + b + SD * rng.normal(size=3))
        use = [0, 1, 2] if k > 0 else [0, 1]  # without a first yaw rate the filter starts straight ahead
        joint = lambda s, k=k: observe(s[:3], s[6:], steer[k]) + s[3:6]
        h, r = jacobian(joint, mean, 1e-5)[use], np.diag(SD[use] ** 2)
        expected, s = joint(mean)[use], h @ cov @ h.T + np.diag(SD[use] ** 2)
        evidence = multivariate_normal.logpdf(y[use], expected, s)
        gain = np.linalg.solve(s, h @ cov).T
        mean = mean + gain @ (y[use] - expected)
        left = np.eye(9) - gain @ h
        cov = left @ cov @ left.T + gain @ r @ gain.T
        sd = np.sqrt(np.diag(cov))
        out.append([steer[k], *y, evidence, *mean[1:6], *sd[1:6]])
        if k + 1 < rows:
            x, b = move(x, w, steer[k], steer[k + 1]), b + WALK * np.sqrt(TS) * rng.normal(size=3)
            ahead = lambda s, k=k: np.concatenate([move(s[:3], s[6:], steer[k], steer[k + 1]), s[3:6], np.zeros(3)])
            f = jacobian(ahead, mean, 1e-4)
            mean = ahead(mean)
            cov = f @ cov @ f.T + np.diag(np.concatenate([np.zeros(3), WALK**2 * TS, [SPREAD**2] * 3]))
    return out


def main():
    rng = np.random.default_rng(1960)
    settings = {
        "accel_x_sd": SD[0], "accel_y_sd": SD[1], "yaw_rate_sd": SD[2], "accel_x_bias_sd": BIAS_SD[0],
        "accel_y_bias_sd": BIAS_SD[1], "yaw_rate_bias_sd": BIAS_SD[2], "accel_x_bias_walk": WALK[0],
        "accel_y_bias_walk": WALK[1], "yaw_rate_bias_walk": WALK[2], "sample_time": TS, "initial_spread": SPREAD,
        "initial_vel_x_sd": X_SD[0], "initial_vel_y_sd": X_SD[1], "initial_yaw_rate_sd": X_SD[2],
    }  # fmt: skip
    out = ["/* Written by generate_kalman.py. SI units, natural logs. Vehicle: the defaults of tse/config.h. */", ""]
    out += ["#define KALMAN_SETTINGS(X) \\", "  " + " ".join(f"X({k}, {float(v)!r})" for k, v in settings.items())]
    out += [
        f"#define KALMAN_OMEGA {OMEGA!r} /* rad/s, all wheels */",
        "",
        "/* mean and sd: vel_y, yaw_rate, bias of accel_x, accel_y, yaw_rate, given the row's own sample */",
        "static const struct { double steer, y[3], evidence, mean[5], sd[5]; } kalman_turning[] = {",
    ]
    nested = lambda row, *cuts: numbers([v[0] if len(v) == 1 else v for v in np.split(np.array(row), cuts)])
    out += [f"  {nested(row, 1, 4, 5, 10)}," for row in turning(rng, 160)]
    out += ["};", ""]
    Path(__file__).with_name("kalman_table.h").write_text("\n".join(out))


if __name__ == "__main__":
    main()
