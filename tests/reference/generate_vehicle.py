#!/usr/bin/env python3
"""Write vehicle_table.h for tests/unit/model/test_vehicle.c and test_propagate.c.

The single-track model written with forces in newtons, mass and inertia, (1)-(4) in the form of algorithm.md with the
library's policy for low speed and reverse (slip over at least 1 m/s, absolute speeds), integrated by scipy's DOP853 at
a tolerance of 1e-13; its linearisation at constant speed by the matrix exponential.

    python3 generate_vehicle.py > vehicle_table.h        needs numpy, scipy; deterministic
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

rng = np.random.default_rng(2)

# mass, yaw inertia, lf, lr, Cx front, Cx rear, Cy front, Cy rear, share of the front's deviation that the rear takes
CARS = [
    (1900.0, 3000.0, 1.25, 1.5, 1.6e5, 1.6e5, 1.2e5, 1.4e5, 1.0),
    (1100.0, 1500.0, 1.0, 1.375, 0.9e5, 0.7e5, 0.75e5, 1.0e5, 0.0),
    (2600.0, 5200.0, 1.625, 1.375, 2.1e5, 2.4e5, 1.5e5, 1.7e5, 0.5),
]
LOW_SPEED = 1.0


def forces(car, x, u, w):
    """Slips [1, 1, rad, rad] and forces [N]; front and rear, longitudinal and lateral."""
    _, _, lf, lr, cxf, cxr, cyf, cyr, follow = car
    vx, vy, r = x
    delta, vf, vr = u
    over = max(abs(vx), LOW_SPEED)
    sf = (vf - vx) / max(abs(vx), abs(vf), LOW_SPEED)
    sr = (vr - vx) / max(abs(vx), abs(vr), LOW_SPEED)
    af = (delta * vx - (vy + lf * r)) / over
    ar = (lr * r - vy) / over
    slip = (sf, sr, af, ar)
    return slip, (cxf * (1 + w[0]) * sf, cxr * (1 + follow * w[0]) * sr, cyf * (1 + w[1]) * af, cyr * (1 + w[2]) * ar)


def accels(car, x, u, w):
    mass, inertia, lf, lr = car[:4]
    _, (fxf, fxr, fyf, fyr) = forces(car, x, u, w)
    front = fyf + fxf * u[0]
    return (fxf + fxr - fyf * u[0]) / mass, (front + fyr) / mass, (lf * front - lr * fyr) / inertia


def rhs(car, x, u, w):
    ax, ay, yaw = accels(car, x, u, w)
    return [ax + x[1] * x[2], ay - x[0] * x[2], yaw]


def cells(values):
    return "{ " + ", ".join(repr(float(v)) for v in values) + " },"


print("/* Written by generate_vehicle.py; do not edit. */")
print("#ifndef VEHICLE_TABLE_H\n#define VEHICLE_TABLE_H\n")
print("/* mass, yaw inertia, lf, lr, Cx front, Cx rear, Cy front, Cy rear, follow */")
print("static const double car_table[][9] = {")
for car in CARS:
    print("  " + cells(car))
print("};\n")

print(
    "/* car | vel_x, vel_y, yaw rate | steer, R omega front, rear | w (3) | slip front, rear, slip angle front, rear |"
)
print(" * accel_x, accel_y, yaw acceleration */")
print("static const double force_table[][17] = {")
for i in range(90):
    k = i % len(CARS)
    speed = (0.0, 0.3, 1.0, 3.0, 20.0, 70.0)[i // 3 % 6] * (-1.0 if i % 5 == 4 else 1.0)
    x = np.array([speed, rng.uniform(-1, 1), rng.uniform(-0.8, 0.8)])
    u = np.array([rng.uniform(-0.3, 0.3), *(speed + rng.uniform(-1, 1, 2) * (0.3 + 0.1 * abs(speed)))])
    w = rng.uniform(-0.8, 1.5, 3) if i % 4 else np.zeros(3)
    print("  " + cells([k, *x, *u, *w, *forces(CARS[k], x, u, w)[0], *accels(CARS[k], x, u, w)]))
print("};\n")

print("/* car | duration | state at the start (3) | inputs at the start (3), at the end (3), linear between | w (3) |")
print(" * state at the end (3) | time constant of the fastest tyre mode at the start */")
print("static const double drive_table[][18] = {")
DRIVES = [  # speed, duration, change of R omega, steering angle at the end
    (0.3, 0.4, 0.2, 0.1),
    (0.6, 0.4, 0.3, -0.2),
    (2.0, 0.5, 0.8, 0.15),
    (5.0, 0.8, 1.0, -0.1),
    (10.0, 1.0, 1.5, 0.06),
    (20.0, 1.0, 2.0, 0.04),
    (20.0, 1.0, -2.5, -0.05),
    (40.0, 1.0, 1.5, -0.03),
    (70.0, 1.0, 1.0, 0.015),
    (-5.0, 0.8, -1.0, 0.1),
    (-0.5, 0.4, -0.2, 0.2),
]
for i, (speed, duration, change, steer) in enumerate(DRIVES):
    k = i % len(CARS)
    car = CARS[k]
    sign = 1.0 if change > 0 else -1.0  # driving or braking from the start: no corner of max() is crossed
    u0 = np.array(
        [0.2 * steer, speed * (1 + 0.004 * sign * np.sign(speed)), speed * (1 + 0.006 * sign * np.sign(speed))]
    )
    if abs(speed) < LOW_SPEED:
        u0[1:] = speed + 0.02 * sign
    u1 = u0 + np.array([0.8 * steer, change, 1.1 * change])
    w = np.array([0.3, -0.25, 0.2]) * (-1.0) ** i
    x0 = np.array([speed, 0.02 * steer * speed, 0.3 * steer])

    def slope(t, x, car=car, u0=u0, u1=u1, w=w, duration=duration):
        return rhs(car, x, u0 + (u1 - u0) * t / duration, w)

    out = solve_ivp(slope, (0, duration), x0, method="DOP853", rtol=1e-13, atol=1e-15, max_step=duration / 50)
    assert out.success
    fastest = (1 + max(w)) * (car[4] + car[5]) / car[0] / max(abs(speed), LOW_SPEED)
    print("  " + cells([k, duration, *x0, *u0, *u1, *w, *out.y[:, -1], 1 / fastest]))
print("};\n")

print("/* car | speed | duration | vel_y, yaw rate at the start | steering angle at the start, at the end |")
print(
    " * vel_y, yaw rate at the end: the lateral model at constant speed, which is linear, by the matrix exponential */"
)
print("static const double linear_table[][9] = {")
for i, speed in enumerate((0.5, 1.5, 4.0, 10.0, 20.0, 40.0, 70.0)):
    for k in (i % len(CARS), (i + 1) % len(CARS)):
        mass, inertia, lf, lr, _, _, cf, cr, _ = CARS[k]
        over = max(speed, LOW_SPEED)
        matrix = np.zeros((4, 4))  # vy, r, delta, its slope
        matrix[0, :2] = -(cf + cr) / (mass * over), (lr * cr - lf * cf) / (mass * over) - speed
        matrix[1, :2] = (lr * cr - lf * cf) / (inertia * over), -(lf**2 * cf + lr**2 * cr) / (inertia * over)
        matrix[:2, 2] = cf / mass * speed / over, lf * cf / inertia * speed / over
        matrix[2, 3] = 1.0
        duration = 0.2 if speed < 3 else 0.6
        start = rng.uniform(-1, 1, 2)
        steer = rng.uniform(-1, 1, 2)
        end = expm(matrix * duration) @ [*start, steer[0], (steer[1] - steer[0]) / duration]
        print("  " + cells([k, speed, duration, *start, *steer, *end[:2]]))
print("};\n")
print(
    "/* car | speed | step | vel_y, yaw rate before | after one step of an L-stable method of order 2, gamma = 1 - 1/sqrt(2):"
)
print(" * (1 + (1 - 2 gamma) z)/(1 - gamma z)^2 at z = step times the lateral model's matrix */")
print("static const double stability_table[][7] = {")
gamma = 1 - np.sqrt(0.5)
for i, speed in enumerate((0.5, 1.5, 4.0, 10.0, 20.0, 40.0, 70.0)):
    for k, step in ((i % len(CARS), 0.01), ((i + 1) % len(CARS), 0.05)):
        mass, inertia, lf, lr, _, _, cf, cr, _ = CARS[k]
        over = max(speed, LOW_SPEED)
        z = step * np.array(
            [
                [-(cf + cr) / (mass * over), (lr * cr - lf * cf) / (mass * over) - speed],
                [(lr * cr - lf * cf) / (inertia * over), -(lf**2 * cf + lr**2 * cr) / (inertia * over)],
            ]
        )
        one = np.eye(2)
        start = rng.uniform(-1, 1, 2)
        end = np.linalg.inv(one - gamma * z) @ np.linalg.inv(one - gamma * z) @ (one + (1 - 2 * gamma) * z) @ start
        print("  " + cells([k, speed, step, *start, *end]))
print("};\n")
print("#endif")
