#!/usr/bin/env python3
"""Write gaussian_table.h: what is Gaussian given a particle's path, for tests/unit/test_gaussian.c.

Model, dense and in SI units: X = (x, mu, b), x+ = f(x, mu + eps), y = h(x) + d(x) (mu + eps) + b + e. f is the single-track
model of (1)-(4), inputs linear between rows, integrated by Runge and Kutta's fourth-order rule in steps of half a
millisecond (checked here against scipy's DOP853); every Jacobian is a complex-step derivative, exact to rounding. The
program under test integrates with ROS2, differentiates by central differences and whitens by the sensors' sd.

predict  P+ = A P A'
observe  C = H P H' + R in units of the sensors' sd, its inverse Cholesky factor, gains, Kalman update in Joseph's form
draw     eps given y: the conditional of the joint Student-t with noise (nut-2)/nut C
drive    20 s simulated here, and an extended Kalman filter of twelve states (x, mu, b, eps), which knows the spread

    python3 generate_gaussian.py     writes gaussian_table.h next to this file; needs numpy and scipy; deterministic
"""

from pathlib import Path

import numpy as np
from generate_weigh import SETTINGS, block, numbers, random_car, short
from scipy.integrate import solve_ivp
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, multivariate_t

PARTICLES, NU = 16, 20.0
NAMES = [*SETTINGS, "yaw_inertia"]
SCALES = np.array([0.05, 0.05, 0.01, 0.1, 0.1, 0.1, 0.4, 0.4, 0.4])  # sds of X in the core's units: biases in sensor sd


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


def digits(values):
    """Ten of them are enough, and keep the table short."""
    return np.vectorize(lambda v: float(f"{v:.10g}"))(np.array(values))


def sds(car):
    return np.array([car["accel_x_sd"], car["accel_y_sd"], car["yaw_rate_sd"]])


def new_car(rng):
    car = random_car(rng)
    car["yaw_inertia"] = short(car["mass"] * car["lf"] * car["lr"] * rng.uniform(0.8, 1.2))
    return car


def covariance(rng):
    root = SCALES[:, None] * (np.eye(9) + 0.5 * rng.normal(size=(9, 9)))
    p = short(root @ root.T / 2)
    return np.triu(p) + np.triu(p, 1).T


def inputs(car, rng):
    v = rng.uniform(12, 28)
    slip = rng.choice([-1, 1], 2) * rng.uniform(0.15, 0.3, 2)  # m/s: states stay off the kink at vx = R omega
    radii = np.array([car["wheel_radius_front"], car["wheel_radius_rear"]])
    return v, short([rng.uniform(-0.05, 0.05), *((v + slip) / radii)])


def particles(v, rng):
    x = short(np.array([v, *rng.normal(0, [0.3, 0.15])]) + rng.normal(0, [0.02, 0.02, 0.005], (PARTICLES, 3)))
    weight = short(rng.uniform(0, 1, PARTICLES))
    weight[rng.integers(PARTICLES)] = 1.0
    return x, weight


def predict_case(rng, sample_time, dt):
    car = new_car(rng)
    v, u0 = inputs(car, rng)
    x, weight = particles(v, rng)
    u1 = short(u0 + rng.normal(0, [0.01, 0.2, 0.2]))
    w = short(rng.normal(0, 0.15, (PARTICLES, 3)))
    p = covariance(rng)
    x0, w0 = weight @ x / weight.sum(), weight @ w / weight.sum()
    a = np.eye(9)
    a[:3, :6] = jacobian(lambda s: move(car, s[:3], s[3:], u0[:, None], u1[:, None], dt), np.array([*x0, *w0]))

    exact = solve_ivp(lambda t, s: rate(car, s, w0, u0 + (u1 - u0) * t / dt), (0, dt), x0, "DOP853", rtol=1e-13, atol=1e-13)
    assert np.abs(exact.y[:, -1] - move(car, x0, w0, u0, u1, dt)).max() < 1e-10

    # ROS2 is of order two: its error in one step of A is below 0.1 (rate h)^3
    fastest = np.abs(np.linalg.eigvals(jacobian(lambda s: rate(car, s, w0, u0[:, None]), x0))).max()
    steps = np.ceil(dt / (1.5 * sample_time) - 1e-9)
    error = float(0.1 * steps * (fastest * dt / steps) ** 3)
    return [
        "  {", block("settings", [car[name] for name in NAMES]), f"    {sample_time!r}, {dt!r}, {error!r},",
        block("from", u0), block("to", u1), block("x", x), block("w", w), block("weight", weight),
        block("cov", p), block("expected", a @ p @ a.T), "  },",
    ]  # fmt: skip


def linearised(car, x, mu, u, use):
    """H (9 columns, SI), at the mean."""
    h = np.zeros((3, 9))
    h[:, :6] = jacobian(lambda s: observe(car, s[:3], s[3:], u[:, None]), np.array([*x, *mu]))
    h[:, 6:] = np.eye(3)
    return h[use]


def regressors(car, x, u, w):
    """y without bias and noise at w, and its derivative d (3x3): y is affine in w."""
    return observe(car, x, w, u), jacobian(lambda s: observe(car, x[:, None], s, u[:, None]), w)


def observe_case(rng):
    car = new_car(rng)
    v, u = inputs(car, rng)
    x, weight = particles(v, rng)
    mu = short(rng.normal(0, 0.1, (PARTICLES, 3)))
    root = rng.normal(0, 0.05, (PARTICLES, 3, 4))
    scale = short(root @ root.transpose(0, 2, 1) / 4)
    bias = short(rng.normal(0, 0.3, (PARTICLES, 3)))  # in sensor sd, as in the core
    p, sd = covariance(rng), sds(car)
    to_si = np.diag([1, 1, 1, 1, 1, 1, *sd])
    mean_x, mean_mu = weight @ x / weight.sum(), weight @ mu / weight.sum()
    foretold, d = zip(*(regressors(car, x[i], u, mu[i]) for i in range(PARTICLES)), strict=True)
    y = short(foretold[3] + sd * (bias[3] + rng.normal(0, 1.5, 3)))

    white, gain, kalman, after, evidence = [], [], [], [], []
    for mask in range(1, 8):
        use = [k for k in range(3) if mask >> k & 1]
        h, r = linearised(car, mean_x, mean_mu, u, use), np.diag(sd[use] ** 2)
        p_si = to_si @ p @ to_si
        s = h @ p_si @ h.T + r
        k = np.linalg.solve(s, h @ p_si).T
        left = np.eye(9) - k @ h
        joseph = left @ p_si @ left.T + k @ r @ k.T
        full = np.zeros((9, 3))
        full[:, use] = k
        kalman.append(full)  # SI: m/s, rad/s, 1, m/s2 per m/s2
        to_core = np.linalg.inv(to_si)
        after.append(to_core @ joseph @ to_core)
        c = np.eye(3)
        c[np.ix_(use, use)] = s / np.outer(sd[use], sd[use])
        inverse = np.linalg.inv(np.linalg.cholesky(c))
        white.append(inverse)
        cross = np.zeros((9, 3))
        cross[:, use] = p @ to_si @ h.T / sd[use]
        gain.append(cross @ inverse.T)

        nut, density = NU - 2.0, []
        for i in range(PARTICLES):
            shape = d[i][use] @ (NU / nut * scale[i]) @ d[i][use].T + (nut - 2.0) / nut * s
            density.append(multivariate_t.logpdf(y[use], (foretold[i] + sd * bias[i])[use], shape, nut))
        evidence.append(logsumexp(density) - np.log(PARTICLES))
    return [
        "  {", block("settings", [car[name] for name in NAMES]), block("u", u), block("y", y), block("x", x),
        block("mu", mu), block("scale", [s[np.triu_indices(3)] for s in scale]), block("bias", bias), block("weight", weight),
        block("cov", p), block("foretold", digits(foretold)), block("d", digits(d)), block("white", digits(white)),
        block("gain", digits(gain)), block("kalman", digits(kalman)), block("after", digits(after)),
        block("evidence", digits(evidence)), "  },",
    ]  # fmt: skip


def draw_case(rng, mask, nu):
    car = new_car(rng)
    v, u = inputs(car, rng)
    x, mu = short([v, *rng.normal(0, [0.3, 0.15])]), short(rng.normal(0, 0.1, 3))
    root = rng.normal(0, 0.06, (3, 4))
    scale = short(root @ root.T / 4)
    bias, p, sd = short(rng.normal(0, 0.3, 3)), covariance(rng), sds(car)
    use = [k for k in range(3) if mask >> k & 1]
    foretold, d = regressors(car, x, u, mu)
    z = rng.normal(0, 2, 3) * sd
    y = short(foretold + sd * bias + z)
    z = (y - foretold - sd * bias)[use]
    to_si = np.diag([1, 1, 1, 1, 1, 1, *sd])
    h = linearised(car, x, mu, u, use)
    c = h @ to_si @ p @ to_si @ h.T + np.diag(sd[use] ** 2)
    nut = nu - 2.0
    a = nu / nut * scale
    s = d[use] @ a @ d[use].T + (nut - 2.0) / nut * c
    gain = np.linalg.solve(s, d[use] @ a).T
    dof = nut + len(use)
    shape = (nut + z @ np.linalg.solve(s, z)) / dof * (a - gain @ s @ gain.T)
    return [
        "  {", block("settings", [car[name] for name in NAMES]), f"    {mask}, {float(nu)!r},", block("u", u), block("y", y),
        block("x", x), block("mu", mu), block("scale", scale[np.triu_indices(3)]), block("bias", bias), block("cov", p),
        block("mean", gain @ z), f"    /* dof */ {float(dof)!r},",
        block("white", np.linalg.inv(np.linalg.cholesky(shape))), "  },",
    ]  # fmt: skip


# ----------------------------------------------------------------------------------------------------- drive

CAR = {
    "mass": 1900.0, "yaw_inertia": 3000.0, "lf": 1.25, "lr": 1.5, "wheel_radius_front": 0.33, "wheel_radius_rear": 0.33,
    "longitudinal_stiffness_front": 1.6e5, "longitudinal_stiffness_rear": 1.6e5, "cornering_stiffness_front": 1.2e5,
    "cornering_stiffness_rear": 1.4e5, "rear_longitudinal_follows_front": 1.0,
    "accel_x_sd": 0.15, "accel_y_sd": 0.15, "yaw_rate_sd": 0.0035,
}  # fmt: skip
TS, ROWS, EVERY = 0.01, 2000, 250
SPREAD, MEAN_SD, FORGETTING = 0.05, 0.2, 0.9999
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


def kalman(log):
    """Twelve states: (x, mu, b, eps); eps is estimated with the sample that it disturbs and then moves the car."""
    u, y, sd = (log * UNIT)[:, :3], (log * UNIT)[:, 3:], sds(CAR)
    mean = np.zeros(12)
    mean[0] = (u[0, 1] + u[0, 2]) / 2 * 0.33
    cov = np.diag(np.concatenate([X_SD, [MEAN_SD] * 3, BIAS_SD, [SPREAD] * 3]) ** 2)
    total, out = 0.0, []
    for k in range(ROWS):
        use = [0, 1, 2] if k > 0 else [0, 1]  # without a first yaw rate the filter starts straight ahead
        joint = lambda s, v=u[k]: observe(CAR, s[:3], s[3:6] + s[9:], v if s.ndim == 1 else v[:, None]) + s[6:9]
        h, r = jacobian(joint, mean)[use], np.diag(sd[use] ** 2)
        s = h @ cov @ h.T + r
        foretold = joint(mean)[use]
        total += multivariate_normal.logpdf(y[k, use], foretold, s)
        gain = np.linalg.solve(s, h @ cov).T
        before = np.diag(cov)[3:6]
        mean = mean + gain @ (y[k, use] - foretold)
        left = np.eye(12) - gain @ h
        cov = left @ cov @ left.T + gain @ r @ gain.T
        if (k + 1) % EVERY == 0:
            out.append([total, *mean[:9], *np.sqrt(np.diag(cov)[:9])])
        now = np.diag(cov)[3:6]  # forgotten as far as this sample taught
        fade = np.ones(12)
        fade[3:6] = np.sqrt(np.maximum(now, np.minimum(now / FORGETTING, before)) / now)
        cov = cov * np.outer(fade, fade)
        if k + 1 < ROWS:
            u0, u1 = u[k], u[k + 1]
            f = np.eye(12)
            f[9:] = 0
            go = lambda s, a=u0, b=u1: move(CAR, s[:3], s[3:6] + s[6:], a[:, None], b[:, None], TS)
            f[:3, [0, 1, 2, 3, 4, 5, 9, 10, 11]] = jacobian(go, mean[[0, 1, 2, 3, 4, 5, 9, 10, 11]])
            mean = np.concatenate([move(CAR, mean[:3], mean[3:6] + mean[9:], u0, u1, TS), mean[3:9], np.zeros(3)])
            cov = f @ cov @ f.T + np.diag(np.concatenate([np.zeros(6), WALK**2 * TS, [SPREAD**2] * 3]))
    return out


def main():
    rng = np.random.default_rng(9)
    n = len(NAMES)
    out = [
        "/* Written by generate_gaussian.py. Covariances: order x, mu, bias; x and mu in SI units, bias in sensor sd. */",
        "",
        f"enum {{ GAUSS_PARTICLES = {PARTICLES}, GAUSS_NU = {NU:.0f} }};",
        "#define GAUSS_SETTINGS(X) \\",
        "  " + " ".join(f"X({name})" for name in NAMES),
        "",
        f"typedef struct predict_case {{ double settings[{n}], sample_time, dt, error; /* error: bound on ROS2's in A */",
        f"  double from[3], to[3], x[{PARTICLES}][3], w[{PARTICLES}][3], weight[{PARTICLES}], cov[9][9], expected[9][9];",
        "} predict_case;",
        "static const predict_case predict_cases[] = {",
    ]
    for sample_time, dt in [(0.01, 0.01), (0.01, 0.01), (0.005, 0.0025), (0.01, 0.05), (0.001, 0.01), (0.001, 0.1)]:
        out += predict_case(rng, sample_time, dt)
    out += [
        "};",
        "",
        f"typedef struct observe_case {{ double settings[{n}], u[3], y[3]; /* y: SI */",
        f"  double x[{PARTICLES}][3], mu[{PARTICLES}][3], scale[{PARTICLES}][6], bias[{PARTICLES}][3], weight[{PARTICLES}], "
        "cov[9][9];",
        f"  double foretold[{PARTICLES}][3], d[{PARTICLES}][3][3]; /* SI, without bias */",
        "  /* by mask 1 .. 7: L^-1 and P H' L'^-1 in sensor sd; Kalman's gain in SI; covariance after the update; log of the",
        "   * mean over the particles of (22) with GAUSS_NU degrees of freedom */",
        "  double white[7][3][3], gain[7][9][3], kalman[7][9][3], after[7][9][9], evidence[7];",
        "} observe_case;",
        "static const observe_case observe_cases[] = {",
    ]
    for _ in range(3):
        out += observe_case(rng)
    out += [
        "};",
        "",
        f"typedef struct draw_case {{ double settings[{n}]; int mask; double nu, u[3], y[3];",
        "  double x[3], mu[3], scale[6], bias[3], cov[9][9], mean[3], dof, white[3][3]; /* of eps; white: scale^(-1/2) */",
        "} draw_case;",
        "static const draw_case draw_cases[] = {",
    ]
    for mask, nu in [(7, 12.0), (7, 40.0), (6, 15.0), (5, 101.0)]:
        out += draw_case(rng, mask, nu)
    out += ["};", ""]

    log, mu = drive(rng)
    settings = {
        **CAR, "accel_x_bias_sd": BIAS_SD[0], "accel_y_bias_sd": BIAS_SD[1], "yaw_rate_bias_sd": BIAS_SD[2],
        "accel_x_bias_walk": WALK[0], "accel_y_bias_walk": WALK[1], "yaw_rate_bias_walk": WALK[2], "sample_time": TS,
        "initial_spread": SPREAD, "initial_mean_sd": MEAN_SD, "forgetting": FORGETTING, "initial_dof": 1000.0,
        "mean_walk": 0.0, "hold_sd": 0.0, "initial_vel_x_sd": X_SD[0], "initial_vel_y_sd": X_SD[1],
        "initial_yaw_rate_sd": X_SD[2],
    }  # fmt: skip
    out += [
        "#define DRIVE_SETTINGS(X) \\",
        "  " + " ".join(f"X({k}, {float(v)!r})" for k, v in settings.items()),
        f"enum {{ DRIVE_ROWS = {ROWS}, DRIVE_EVERY = {EVERY} }};",
        f"static const double drive_true[3] = {numbers(mu)};",
        f"static const double drive_unit[6] = {numbers(UNIT)};",
        "/* steering angle, wheel speeds, accel_x, accel_y, yaw rate, in drive_unit; the first yaw rate is missing */",
        f"static const int drive_rows[{ROWS}][6] = {{",
    ]
    text = ["{" + ",".join(str(v) for v in row) + "}" for row in log]
    out += ["  " + ", ".join(text[k : k + 3]) + "," for k in range(0, ROWS, 3)]
    out += [
        "};",
        "/* after each 250 rows: sum of the log evidence; mean and sd of x, mu, b (SI) */",
        "static const struct { double evidence, mean[9], sd[9]; } drive_kalman[] = {",
    ]
    for row in kalman(log):
        out.append(f"  {{ {float(row[0])!r}, {numbers(row[1:10])}, {numbers(row[10:])} }},")
    out += ["};", ""]
    Path(__file__).with_name("gaussian_table.h").write_text("\n".join(out))


if __name__ == "__main__":
    main()
