#!/usr/bin/env python3
"""Write error_table.h: the error of the mean of all particles, for tests/unit/test_error.c.

update   dense algebra of twelve states (x, mu, b, eps) in SI units: gain K = P H' S^-1 by solving, S = H P H' + R + d Sigma d',
         error (1 - K H) E (1 - K H)' + K R K' by full products; then in the core's units (bias and measurement in sensor sd)
predict  A E A' with the whole A
constant one constant, measured with noise and with an eps of each sample: the filter with forgetting is run 200 000 times from
         seeded random numbers, and what is counted is the variance of its error

    python3 generate_error.py     writes error_table.h next to this file; needs numpy; deterministic
"""

from pathlib import Path

import numpy as np
from generate_weigh import block, short

X, N = 9, 12
SD = np.array([0.15, 0.12, 0.0035])  # of accel_x, accel_y [m/s2], yaw rate [rad/s]
UNIT = np.concatenate([np.ones(6), SD])  # of X: biases are in sensor sd in the core
SCALES = np.array([0.1, 0.2, 0.02, 0.2, 0.1, 0.15, 0.05, 0.04, 0.001])
FORGETTING, SPREAD_VAR, START_VAR, RUNS, STEPS = 0.95, 0.5, 0.25, 200_000, 100
COUNTED = (1, 2, 5, 10, 20, 50, 100)


def psd(rng, scales, rank=None):
    """A random covariance with these sds, of full rank or less."""
    a = rng.standard_normal((len(scales), rank or len(scales) + 3))
    c = a @ a.T
    d = np.sqrt(np.diag(c))
    return c / np.outer(d, d) * np.outer(scales, scales)


def core(c):
    """Of X in SI units, in the core's."""
    return c / np.outer(UNIT, UNIT)


def si(c):
    return c * np.outer(UNIT, UNIT)


def update_case(rng, mask):
    P, E = short(core(psd(rng, SCALES))), short(core(psd(rng, SCALES)))
    sigma = short(psd(rng, np.array([0.1, 0.08, 0.12])))
    use = np.array([float(mask >> a & 1) for a in range(3)])
    noise = short(1 + use * rng.uniform(0, 8, 3) * (rng.random(3) < 0.6))
    d = np.array(
        [[rng.uniform(-3, 3), rng.uniform(-0.1, 0.1), 0], [rng.uniform(-0.1, 0.1), *rng.uniform(-4, 4, 2)], [0, 0, 0]]
    )
    H = np.zeros((3, X))  # SI: m/s2 per m/s and so on
    H[:2, :3] = rng.uniform(-8, 8, (2, 3))
    H[2, 2] = 1
    H[:, 3:6] = d
    H[:, 6:] = np.eye(3)
    H = short(use[:, None] * H / SD[:, None] * UNIT)  # the core's, rounded; back to SI for the reference
    H_si = H * SD[:, None] / UNIT

    both = np.hstack([H_si, H_si[:, 3:6]])
    error, R = np.zeros((N, N)), np.diag(noise * SD**2)
    error[:X, :X], error[X:, X:] = si(E), sigma
    S = H_si @ si(P) @ H_si.T + R + H_si[:, 3:6] @ sigma @ H_si[:, 3:6].T
    gain = np.linalg.solve(S, np.hstack([H_si @ si(P), H_si[:, 3:6] @ sigma])).T
    left = np.eye(N) - gain @ both
    after = left @ error @ left.T + gain @ R @ gain.T
    unit = np.concatenate([UNIT, np.ones(3)])
    return {"P": P, "E": E, "H": H, "sigma": sigma, "noise": noise, "after": after / np.outer(unit, unit)}


def predict_case(rng):
    E = short(psd(rng, np.concatenate([SCALES / UNIT, [0.1, 0.1, 0.1]]), rank=7))
    jac = short(np.hstack([np.eye(3) + rng.uniform(-0.3, 0.3, (3, 3)), rng.uniform(-0.5, 0.5, (3, 3))]))
    A = np.zeros((N, N))
    A[:3, :6], A[:3, X:] = jac, jac[:, 3:]
    A[3:X, 3:X] = np.eye(6)
    return {"E": E, "jac": jac, "after": A @ E @ A.T}


def constant():
    """y = m + eps + e, e ~ N(0, 1): variance of the error after the sample and its standard error."""
    rng = np.random.default_rng(11)
    m = rng.normal(0, np.sqrt(START_VAR), RUNS)
    mean, var, rows = np.zeros(RUNS), START_VAR, []
    for k in range(1, STEPS + 1):
        y = m + rng.normal(0, np.sqrt(SPREAD_VAR), RUNS) + rng.standard_normal(RUNS)
        mean = mean + var / (var + 1 + SPREAD_VAR) * (y - mean)
        # the core forgets P given the path of eps: with R alone, as far as the sample taught
        after = var - var * var / (var + 1)
        var = max(after, min(after / FORGETTING, var))
        if k in COUNTED:
            square = (mean - m) ** 2
            rows.append((k, square.mean(), square.std() / np.sqrt(RUNS)))
    return rows


def main():
    rng = np.random.default_rng(2024)
    updates = [update_case(rng, mask) for mask in (7, 7, 7, 7, 1, 2, 4, 5, 6)]
    predicts = [predict_case(rng) for _ in range(4)]
    lines = ["/* Written by generate_error.py. Order x, mu, bias, eps; biases and measurements in sensor sd. */", ""]
    lines += [
        "typedef struct error_update_case {",
        "  double P[9][9], E[9][9], H[3][9], sigma[3][3], noise[3], after[12][12];",
        "} error_update_case;",
    ]
    lines += ["static const error_update_case error_update_cases[] = {"]
    for c in updates:
        lines += ["  {", *(block(k, v) for k, v in c.items()), "  },"]
    lines += [
        "};",
        "",
        "typedef struct error_predict_case { double E[12][12], jac[3][6], after[12][12]; } error_predict_case;",
    ]
    lines += ["static const error_predict_case error_predict_cases[] = {"]
    for c in predicts:
        lines += ["  {", *(block(k, v) for k, v in c.items()), "  },"]
    lines += ["};", "", f"/* One constant, {RUNS} runs: samples, variance of the error, its standard error. */"]
    lines += [
        f"#define CONSTANT_FORGETTING {FORGETTING}",
        f"#define CONSTANT_SPREAD_VAR {SPREAD_VAR}",
        f"#define CONSTANT_START_VAR {START_VAR}",
    ]
    lines += ["static const struct { int samples; double variance, standard_error; } constant_rows[] = {"]
    lines += [f"  {{ {k}, {float(v)!r}, {float(s)!r} }}," for k, v, s in constant()]
    lines += ["};", ""]
    (Path(__file__).parent / "error_table.h").write_text("\n".join(lines))


if __name__ == "__main__":
    main()
