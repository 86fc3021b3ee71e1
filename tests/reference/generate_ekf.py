#!/usr/bin/env python3
"""Write ekf_table.h: a short drive and a Kalman filter of nine states on it, for tests/unit/test_ekf.c (tests/bench/ekf.c).

The model is newtons.py: in newtons, integrated in steps of half a millisecond, differentiated by complex steps. The
filter is written with matrices in their textbook form, the update with the inverse covariances added up.

    python3 generate_ekf.py     writes ekf_table.h next to this file; needs numpy and scipy; deterministic
"""

from pathlib import Path

import newtons as reference
import numpy as np
from newtons import BIAS_SD, CAR, MEAN_SD, SPREAD, TS, UNIT, WALK, X_SD, jacobian, move, numbers, observe, sds

ROWS, EVERY = 400, 50


def kalman(log):
    """Mean and sd of x, deviation of the stiffness, b after every EVERY rows."""
    u, y, r = (log * UNIT)[:, :3], (log * UNIT)[:, 3:], np.diag(sds(CAR) ** 2)
    mean = np.zeros(9)
    mean[0] = (u[0, 1] + u[0, 2]) / 2 * 0.33
    cov = np.diag(np.concatenate([X_SD, [MEAN_SD] * 3, BIAS_SD]) ** 2)
    out = []
    for k in range(ROWS):
        h = np.zeros((3, 9))
        h[:, :6] = jacobian(lambda s, v=u[k][:, None]: observe(CAR, s[:3], s[3:], v), mean[:6])
        h[:, 6:] = np.eye(3)
        d = h[:, 3:6]
        weight = np.linalg.inv(SPREAD**2 * d @ d.T + r)
        cov = np.linalg.inv(np.linalg.inv(cov) + h.T @ weight @ h)
        mean = mean + cov @ h.T @ weight @ (y[k] - observe(CAR, mean[:3], mean[3:6], u[k]) - mean[6:])
        if (k + 1) % EVERY == 0:
            out.append(np.concatenate([mean, np.sqrt(np.diag(cov))]))
        if k + 1 < ROWS:
            go = lambda s, a=u[k][:, None], b=u[k + 1][:, None]: move(CAR, s[:3], s[3:], a, b, TS)
            f = np.eye(9)
            f[:3, :6] = jacobian(go, mean[:6])
            mean = np.concatenate([move(CAR, mean[:3], mean[3:6], u[k], u[k + 1], TS), mean[3:]])
            g = f[:3, 3:6]
            cov = f @ cov @ f.T + np.diag(np.concatenate([np.zeros(6), WALK**2 * TS]))
            cov[:3, :3] += SPREAD**2 * g @ g.T
    return out


def main():
    reference.ROWS = ROWS
    log, _ = reference.drive(np.random.default_rng(27))
    settings = {
        **CAR, "accel_x_bias_sd": BIAS_SD[0], "accel_y_bias_sd": BIAS_SD[1], "yaw_rate_bias_sd": BIAS_SD[2],
        "accel_x_bias_walk": WALK[0], "accel_y_bias_walk": WALK[1], "yaw_rate_bias_walk": WALK[2],
        "initial_mean_sd": MEAN_SD, "initial_vel_x_sd": X_SD[0], "initial_vel_y_sd": X_SD[1], "initial_yaw_rate_sd": X_SD[2],
    }  # fmt: skip
    text = ["{" + ",".join(str(v) for v in row) + "}" for row in log]
    out = [
        "/* Written by generate_ekf.py. SI units. */",
        "",
        "#define EKF_SETTINGS(X) \\",
        "  " + " ".join(f"X({k}, {float(v)!r})" for k, v in settings.items()),
        f"enum {{ EKF_ROWS = {ROWS}, EKF_EVERY = {EVERY} }};",
        f"static const double ekf_dt = {TS!r}, ekf_spread = {SPREAD!r};",
        f"static const double ekf_unit[6] = {numbers(UNIT)};",
        "/* steering angle, wheel speeds, accel_x, accel_y, yaw rate, in ekf_unit */",
        f"static const int ekf_rows[{ROWS}][6] = {{",
        *("  " + ", ".join(text[k : k + 3]) + "," for k in range(0, ROWS, 3)),
        "};",
        "/* after each 50 rows: mean of x, deviation of the stiffness, b; their sds */",
        "static const struct { double mean[9], sd[9]; } ekf_expected[] = {",
        *(f"  {{ {numbers(row[:9])}, {numbers(row[9:])} }}," for row in kalman(log)),
        "};",
        "",
    ]
    Path(__file__).with_name("ekf_table.h").write_text("\n".join(out))


if __name__ == "__main__":
    main()
