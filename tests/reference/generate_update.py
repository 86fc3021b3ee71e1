#!/usr/bin/env python3
"""Write update_table.h: the exact conditional of w given y for single particles, for tests/unit/paper/test_learn.c.

Given the past, (w, y) is jointly Student-t with nut = nu - 2 degrees of freedom and scale
    [ A     A d'                          ]        A = (1 + gamma)/nut Lambda
    [ d A   d A d' + (nut-2)/nut (R + P)  ]
so w given y is Student-t too (Kotz & Nadarajah, Multivariate t Distributions, 2004, section 1.11). Dense, SI units.

    python3 generate_update.py        writes update_table.h next to this file; needs numpy and scipy; deterministic
"""

from pathlib import Path

import numpy as np
from scipy import stats

from generate_weigh import SETTINGS, block, numbers, random_car, random_particle, regressors, short

MASKS = [7, 7, 3, 6, 2, 5]
T_LEVELS = np.concatenate([[0.0005, 0.002, 0.005], np.arange(1, 50) / 50, [0.995, 0.998, 0.9995]])
F_LEVELS = np.concatenate([np.arange(1, 20) / 20, [0.98, 0.99, 0.998]])


def case(rng, mask, nu):
    car = random_car(rng)
    gamma = short(rng.uniform(0.01, 0.5))
    var = short(rng.uniform(0.05, 0.5, 3))
    v = rng.uniform(12, 25)
    u = short([rng.uniform(0.02, 0.05), v / car["wheel_radius_front"] + 2.0, v / car["wheel_radius_rear"] + 1.0])
    x, mu, scale, bias = random_particle(car, u, rng, spread=(0.03, 0.05))
    h, d = regressors(car, x, u)
    sd = np.array([car["accel_x_sd"], car["accel_y_sd"], car["yaw_rate_sd"]])
    y = short(h + d @ mu + bias + sd * rng.normal(0, 2, 3))

    use = [k for k in range(3) if mask >> k & 1]
    nut = nu - 2.0
    a = (1.0 + gamma) / nut * (nu * scale)
    s = (d @ a @ d.T + (nut - 2.0) / nut * np.diag(sd**2 * (1.0 + var)))[np.ix_(use, use)]
    z = (y - h - d @ mu - bias)[use]
    gain = a @ d[use].T @ np.linalg.inv(s)
    mean = mu + gain @ z
    dof = nut + len(use)
    shape = (nut + z @ np.linalg.solve(s, z)) / dof * (a - gain @ s @ gain.T)
    white = np.linalg.inv(np.linalg.cholesky(shape))
    return [
        "  {",
        block("settings", [car[name] for name in SETTINGS]),
        f"    /* mask, nu, gamma */ {mask}, {float(nu)!r}, {float(gamma)!r},",
        block("bias_var", var), block("x", x), block("mu", mu), block("scale", scale[np.triu_indices(3)]),
        block("bias", bias), block("u", u), block("y", y), block("h", h), block("d", d),
        block("mean", mean), f"    /* dof */ {float(dof)!r},", block("white", white),
        block("t_quantile", stats.t.ppf(T_LEVELS, dof)), block("f_quantile", stats.f.ppf(F_LEVELS, 3, dof)),
        "  },",
    ]  # fmt: skip


def main():
    rng = np.random.default_rng(25)
    out = [
        "/* Written by generate_update.py. SI units; white: inverse of the Cholesky factor of the conditional's scale. */",
        "",
        "typedef struct update_case {",
        f"  double settings[{len(SETTINGS)}]; /* in the order of UPDATE_SETTINGS */",
        "  int mask;",
        "  double nu, gamma, bias_var[3]; /* bias_var in squared sensor sd */",
        "  double x[3], mu[3], scale[6], bias[3], u[3], y[3]; /* scale: Lambda/nu */",
        "  double h[3], d[3][3], mean[3], dof, white[3][3];",
        f"  double t_quantile[{len(T_LEVELS)}], f_quantile[{len(F_LEVELS)}];",
        "} update_case;",
        "#define UPDATE_SETTINGS(X) \\",
        "  " + " ".join(f"X({name})" for name in SETTINGS),
        "",
        f"static const double t_level[] = {numbers(T_LEVELS)};",
        f"static const double f_level[] = {numbers(F_LEVELS)};",
        "",
        "static const update_case update_cases[] = {",
    ]
    for mask, nu in zip(MASKS, [8.0, 60.0, 12.0, 25.0, 9.0, 101.0], strict=True):
        out += case(rng, mask, nu)
    out += ["};", ""]
    Path(__file__).with_name("update_table.h").write_text("\n".join(out))


if __name__ == "__main__":
    main()
