"""Example of an estimator of your own that a study compares with tse.

    PYTHONPATH=scripts/examples tselab montecarlo \\
        --study peers+own_filter.random_walk --cases nominal,noise-3x --runs 20

The study `peers` runs all estimators on the same simulated drives: tse, Kalman filters
with the true covariances, and the function whose name follows the `+`. This function
receives the log and the settings of car and sensors, as tse does. It returns the
stiffnesses as columns with one value per row of the log, in N and N/rad.

This example is a Kalman filter whose states are the compliances 1/C of both axles, as
random walks. Side forces of the axles follow from yaw and lateral acceleration,

    Fy_front = (lr m ay + Iz dr/dt)/(lf + lr),
    Fy_rear  = (lf m ay - Iz dr/dt)/(lf + lr).

The slip angles are a_f = delta - (vy + lf r)/vx and a_r = (lr r - vy)/vx. The lateral
speed vy is not measured, but it cancels in their difference:

    a_f - a_r = delta - (lf + lr) r/vx  =  Fy_front/C_front - Fy_rear/C_rear.

The filter uses this equation, which is linear in the compliances, for its update. The
measurement is delta - (lf + lr) r/vx, and the regressor is (Fy_front, -Fy_rear).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import pandas as pd

Array = npt.NDArray[np.float64]
WALK = 0.002  # [1/sqrt(s)] sd of the change of a compliance in 1 s / nominal compliance
START = 0.3  # sd of the compliances at the start, relative to their start values
SMOOTH = 0.1  # [s] time constant of the low-pass filter of noisy channels
MIN_SPEED = 3.0  # [m/s] min speed at which the compliances are updated


def random_walk(log: pd.DataFrame, settings: Mapping[str, float]) -> dict[str, Array]:
    """Return cx_front, cy_front, cy_rear and the sd of each (suffix _sd), row by row.

    The filter does not estimate cx_front: cx_front and cx_front_sd are constant.
    """
    s = settings
    nominal = np.array([s["cornering_stiffness_front"], s["cornering_stiffness_rear"]])
    base, dt = s["lf"] + s["lr"], s["sample_time"]
    blend = dt / (SMOOTH + dt)

    c = 1 / (np.array([s["initial_cy_front"], s["initial_cy_rear"]]) * nominal)  # [rad/N] compliances
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
        variances.append(np.diag(p) / c**4)  # variance of the stiffness 1/c, to first order
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
            f"{name}: error of random_walk {100 * (mine[name][-1] / true - 1):+.1f} %, "
            f"of tse {100 * (getattr(e, name) / true - 1):+.1f} %"
        )
