"""An estimator of your own beside tse, on the same drives, in the same tables.

    PYTHONPATH=scripts/examples tselab montecarlo \\
        --study peers+own_filter.random_walk --cases nominal,noise-3x --runs 20

A study runs every estimator on the same simulated drives: tse, Kalman filters with the
true covariances, and yours, by its name in Python. It receives the log and the settings
of car and sensors, as tse does, and returns columns in N and N/rad.

This example is a Kalman filter with a random walk of the two cornering stiffnesses. It
cannot measure sideslip, so it uses differences. Yaw acceleration and lateral acceleration
give the side forces of both axles,

    Fy_front = (lr m ay + Iz dr/dt)/(lf + lr),
    Fy_rear  = (lf m ay - Iz dr/dt)/(lf + lr),

and from dvy/dt = ay - vx r, with the slip angles a_f = delta - (vy + lf r)/vx and a_r =
(lr r - vy)/vx, the difference contains no vy:

    a_f - a_r = delta - (lf + lr) r/vx  =  Fy_front/C_front - Fy_rear/C_rear.

This is linear in the compliances 1/C: measurement delta - (lf + lr) r/vx, regressor
(Fy_front, -Fy_rear).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import pandas as pd

Array = npt.NDArray[np.float64]
WALK = 0.002  # 1/sqrt(s): random walk of the compliances, relative to nominal
START = 0.3  # sd of the compliances at the start, relative
SMOOTH = 0.1  # s, time constant: the side forces are differences of noisy channels
MIN_SPEED = 3.0  # m/s, no update below


def random_walk(log: pd.DataFrame, settings: Mapping[str, float]) -> dict[str, Array]:
    """Return cx_front, cy_front, cy_rear and their _sd, one value per row.

    The filter does not estimate cx_front: its columns keep the initial value.
    """
    s = settings
    nominal = np.array([s["cornering_stiffness_front"], s["cornering_stiffness_rear"]])
    base, dt = s["lf"] + s["lr"], s["sample_time"]
    blend = dt / (SMOOTH + dt)

    c = 1 / (np.array([s["initial_cy_front"], s["initial_cy_rear"]]) * nominal)  # compliances, rad/N
    p = np.diag((START * c) ** 2)
    q = np.diag((WALK / nominal) ** 2 * dt)
    r_sd = np.hypot(np.sqrt(blend) * s["yaw_rate_sd"] * base / 10.0, 1e-3)

    ay = yaw = steer = before = 0.0
    means, variances = [], []
    for row in log.itertuples(index=False):
        speed = 0.5 * (
            s["wheel_radius_front"] * row.wheel_speed_front + s["wheel_radius_rear"] * row.wheel_speed_rear
        )
        p = p + q
        if np.isfinite([row.accel_y, row.yaw_rate, row.steer_angle, speed]).all() and speed > MIN_SPEED:
            ay += blend * (row.accel_y - ay)
            yaw, before = yaw + blend * (row.yaw_rate - yaw), yaw
            steer += blend * (row.steer_angle - steer)
            turn = s["yaw_inertia"] * (yaw - before) / dt
            h = np.array([s["lr"] * s["mass"] * ay + turn, -(s["lf"] * s["mass"] * ay - turn)]) / base
            innovation = steer - base * yaw / speed - h @ c
            gain = p @ h / (h @ p @ h + r_sd**2)
            c, p = c + gain * innovation, p - np.outer(gain, h @ p)
            c = np.clip(c, 0.1 / nominal, 10 / nominal)
        means.append(1 / c)
        variances.append(np.diag(p) / c**4)  # of 1/c, to first order
    stiffness, sd = np.array(means), np.sqrt(np.array(variances))
    unknown = np.full(len(log), s["initial_cx_front"] * s["longitudinal_stiffness_front"])
    return {
        "cx_front": unknown, "cx_front_sd": START * unknown,
        "cy_front": stiffness[:, 0], "cy_front_sd": sd[:, 0],
        "cy_rear": stiffness[:, 1], "cy_rear_sd": sd[:, 1],
    }  # fmt: skip


if __name__ == "__main__":
    import tse

    log, truth = tse.simulate("square-waves", duration=30)
    theirs = tse.Filter(tse.simulated_car())
    mine = random_walk(log, theirs.settings)
    e = [theirs.step({str(k): v for k, v in row.items()}) for row in log.to_dict("records")][-1]
    for name in ("cy_front", "cy_rear"):
        true = truth[f"true_{name}"].iloc[-1]
        print(
            f"{name}: mine {100 * (mine[name][-1] / true - 1):+.1f} %, "
            f"tse {100 * (getattr(e, name) / true - 1):+.1f} % off"
        )
