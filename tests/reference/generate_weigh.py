#!/usr/bin/env python3
"""Write weigh_table.h: log densities (22), (23) of random particles for tests/unit/paper/test_weigh.c.

Everything in SI units with dense matrices: stiffness in N and N/rad, measurements in m/s2 and rad/s, Lambda 3x3 of the
relative deviation, P and R in squared SI units. The density is scipy.stats.multivariate_t.logpdf, the evidence its
logsumexp. The program under test whitens, works in log2 and in scalar steps: nothing in common but the equations.

    python3 generate_weigh.py        writes weigh_table.h next to this file; needs numpy and scipy; deterministic
"""

from pathlib import Path

import numpy as np
from scipy.special import logsumexp
from scipy.stats import multivariate_t

PARTICLES = 16
CASES = 6
STEPS = 4


def short(x):
    """Rounded to single precision, so that the program starts from the same numbers in both formats."""
    return np.float32(x).astype(np.float64)


def regressors(car, x, u):
    """h (3) and d (3x3) of (9) in SI units; u = steering angle, wheel speeds. Valid where speeds are above 1 m/s."""
    vx, vy, r = x
    delta, omega_f, omega_r = u
    vf, vr = car["wheel_radius_front"] * omega_f, car["wheel_radius_rear"] * omega_r
    s_f, s_r = (vf - vx) / max(vx, vf), (vr - vx) / max(vx, vr)
    alpha_f, alpha_r = delta - (vy + car["lf"] * r) / vx, (car["lr"] * r - vy) / vx
    fx_f, fx_r = car["longitudinal_stiffness_front"] * s_f, car["longitudinal_stiffness_rear"] * s_r
    fy_f, fy_r = car["cornering_stiffness_front"] * alpha_f, car["cornering_stiffness_rear"] * alpha_r
    follow = car["rear_longitudinal_follows_front"]
    h = np.array([fx_f + fx_r - fy_f * delta, fy_f + fy_r + fx_f * delta, 0.0]) / car["mass"]
    h[2] = r
    d = (
        np.array([[fx_f + follow * fx_r, -fy_f * delta, 0.0], [fx_f * delta, fy_f, fy_r], [0.0, 0.0, 0.0]])
        / car["mass"]
    )
    return h, d


SETTINGS = [
    "mass", "lf", "lr", "wheel_radius_front", "wheel_radius_rear", "longitudinal_stiffness_front",
    "longitudinal_stiffness_rear", "cornering_stiffness_front", "cornering_stiffness_rear",
    "rear_longitudinal_follows_front", "accel_x_sd", "accel_y_sd", "yaw_rate_sd",
]  # fmt: skip


def random_car(rng):
    return {
        "mass": short(rng.uniform(900, 3000)), "lf": short(rng.uniform(1, 1.6)), "lr": short(rng.uniform(1, 1.8)),
        "wheel_radius_front": short(rng.uniform(0.28, 0.36)), "wheel_radius_rear": short(rng.uniform(0.28, 0.36)),
        "longitudinal_stiffness_front": short(rng.uniform(8e4, 2e5)),
        "longitudinal_stiffness_rear": short(rng.uniform(8e4, 2e5)),
        "cornering_stiffness_front": short(rng.uniform(8e4, 2e5)),
        "cornering_stiffness_rear": short(rng.uniform(8e4, 2e5)),
        "rear_longitudinal_follows_front": short(rng.choice([0.0, 1.0, 0.4])),
        "accel_x_sd": short(rng.uniform(0.05, 0.3)), "accel_y_sd": short(rng.uniform(0.05, 0.3)),
        "yaw_rate_sd": short(rng.uniform(0.002, 0.01)),
    }  # fmt: skip


def random_particle(car, u, rng, spread=(0.02, 0.15)):
    v = 0.5 * (car["wheel_radius_front"] * u[1] + car["wheel_radius_rear"] * u[2])
    x = short([v + rng.normal(0, 0.1), rng.normal(0, 0.2), rng.normal(0, 0.1)])
    mu = short(rng.normal(0, 0.15, 3))
    g = rng.normal(0, rng.uniform(*spread), (3, 5))
    sigma = short(g @ g.T)  # Lambda/nu
    bias = short(rng.normal(0, [0.1, 0.1, 0.003]))
    return x, mu, sigma, bias


def density(car, x, mu, scale, bias, u, y, nu, gamma, var, mask):
    """log St(y; h + d mu + b, d A d' + (nut-2)/nut (R+P), nut) of the channels in the mask; scale is Lambda/nu."""
    h, d = regressors(car, x, u)
    nut = nu - 2.0
    a = (1.0 + gamma) / nut * (nu * scale)
    sd = np.array([car["accel_x_sd"], car["accel_y_sd"], car["yaw_rate_sd"]])
    s = d @ a @ d.T + (nut - 2.0) / nut * (np.diag(sd**2) + np.diag(var * sd**2))
    use = [k for k in range(3) if mask >> k & 1]
    return multivariate_t.logpdf(y[use], loc=(h + d @ mu + bias)[use], shape=s[np.ix_(use, use)], df=nut)


def numbers(values):
    """C initialiser, nested as the array is."""
    return "{ " + ", ".join(repr(float(v)) if np.ndim(v) == 0 else numbers(v) for v in values) + " }"


def block(name, value):
    return f"    /* {name} */ {numbers(value)},"


def main():
    rng = np.random.default_rng(2016)
    out = ["/* Written by generate_weigh.py. Logs are natural, units SI. */", ""]
    out += [
        f"enum {{ WEIGH_PARTICLES = {PARTICLES}, WEIGH_STEPS = {STEPS} }};",
        "typedef struct weigh_case {",
        f"  double settings[{len(SETTINGS)}];             /* in the order of WEIGH_SETTINGS */",
        "  double nu, gamma, bias_var[3];    /* bias_var in squared sensor sd */",
        f"  double x[{PARTICLES}][3], mu[{PARTICLES}][3], scale[{PARTICLES}][6], bias[{PARTICLES}][3]; "
        "/* scale: Lambda/nu; bias SI */",
        f"  double u[{STEPS}][3], y[{STEPS}][3];",
        f"  double log_density[7][{PARTICLES}];       /* first row, channels of mask 1 .. 7 */",
        f"  int mask[{STEPS}];                      /* channels used in the sequence of rows */",
        f"  double evidence[{STEPS}];",
        "} weigh_case;",
        "#define WEIGH_SETTINGS(X) \\",
        "  " + " ".join(f"X({name})" for name in SETTINGS),
        "",
        "static const weigh_case weigh_cases[] = {",
    ]
    upper = np.triu_indices(3)
    for case in range(CASES):
        car = random_car(rng)
        nu = short([6.0, 9.0, 30.0, 100.0, 400.0, 2000.0][case])
        gamma = short(rng.uniform(0.005, 0.9))
        var = short(rng.uniform(0.01, 0.6, 3))
        v = rng.uniform(8, 30)
        u = short([
            [rng.normal(0, 0.05), v / car["wheel_radius_front"] + rng.normal(0, 0.5),
             v / car["wheel_radius_rear"] + rng.normal(0, 0.5)] for _ in range(STEPS)
        ])  # fmt: skip
        particles = [random_particle(car, u[0], rng) for _ in range(PARTICLES)]
        # measurements near what one of the particles foretells, so that no density falls below the program's 2^-120
        y = []
        for k in range(STEPS):
            x, mu, _, bias = particles[k]
            h, d = regressors(car, x, u[k])
            sd = np.array([car["accel_x_sd"], car["accel_y_sd"], car["yaw_rate_sd"]])
            y.append(short(h + d @ mu + bias + sd * rng.normal(0, 2, 3)))
        single = np.array([
            [density(car, *q, u[0], y[0], nu, gamma, var, mask) for q in particles] for mask in range(1, 8)
        ])  # fmt: skip
        masks = [7, *rng.choice(np.arange(1, 7), STEPS - 2), 7]
        logq = np.full(PARTICLES, -np.log(PARTICLES))
        evidence = []
        for k in range(STEPS):
            logq = logq + [density(car, *q, u[k], y[k], nu, gamma, var, masks[k]) for q in particles]
            evidence.append(logsumexp(logq))
            logq = np.maximum(logq, logq.max() - 120 * np.log(2))  # as stated in src/paper/weigh.c: less is no weight
            logq = logq - logsumexp(logq)
        out += [
            "  {",
            block("settings", [car[name] for name in SETTINGS]),
            f"    /* nu, gamma */ {float(nu)!r}, {float(gamma)!r},",
            block("bias_var", var),
        ]
        out += [block("x", [q[0] for q in particles]), block("mu", [q[1] for q in particles])]
        out += [block("scale", [q[2][upper] for q in particles]), block("bias", [q[3] for q in particles])]
        out += [block("u", u), block("y", y), block("log_density", single)]
        out.append("    { " + ", ".join(str(int(m)) for m in masks) + " },")
        out.append(block("evidence", evidence))
        out.append("  },")
    out += ["};", ""]

    out += [
        "/* No slip, d = 0: log St of z in each used channel, in units of its sd, scale (nut-2)/nut; by nu and channels. */",
        "static const struct { double nu, z[3], log_density[7]; } weigh_gamma_ratio[] = {",
    ]
    for nu in [6.0, 6.25, 7.0, 8.0, 9.5, 12.0, 20.0, 35.0, 60.0, 102.0, 250.0, 500.0, 1000.0, 2000.0]:
        z = short(rng.normal(0, 1.5, 3))
        nut = nu - 2.0
        row = []
        for mask in range(1, 8):
            use = [k for k in range(3) if mask >> k & 1]
            shape = (nut - 2) / nut * np.eye(len(use))
            row.append(multivariate_t.logpdf(z[use], loc=np.zeros(len(use)), shape=shape, df=nut))
        out.append(f"  {{ {nu!r}, {numbers(z)}, {numbers(row)} }},")
    out += ["};", ""]
    Path(__file__).with_name("weigh_table.h").write_text("\n".join(out))


if __name__ == "__main__":
    main()
