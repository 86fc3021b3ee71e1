#!/usr/bin/env python3
"""Write simulate_table.h for tests/unit/host/test_simulate.c.

A car with turning wheels, written with forces in newtons and torques in newton metres: driven by torques, braked to a
standstill and held, and backwards, integrated row by row with scipy's DOP853 at a tolerance of 1e-11. Between rows the
driver is linear and the stiffness is that of the row before. The drivers are functions of the row, here and in the test.
Slip is taken over at least 1 m/s; brakes oppose rotation, linearly up to 0.2 rad/s.

    python3 generate_simulate.py > simulate_table.h        needs numpy, scipy; deterministic
"""

import numpy as np
from scipy.integrate import solve_ivp

MASS, INERTIA, LF, LR = 1500.0, 2200.0, 1.2, 1.45
CXF, CXR, CYF, CYR, FOLLOW = 1.5e5, 1.2e5, 0.9e5, 1.1e5, 0.5
RF, RR, JF, JR = 0.33, 0.31, 2.4, 3.1
LEVEL = (0.8, 1.1, 0.9)  # mean stiffness over nominal: front longitudinal, front lateral, rear lateral
ROWS = 160
EVERY = 5  # rows between two lines of the table of results


def tyre_forces(x, delta, road):
    vx, vy, r, wf, wr = x
    level = np.array(LEVEL) * road
    rear = road * (1 + FOLLOW * (LEVEL[0] - 1))  # what does not follow the front still follows the road
    low = max(abs(vx), 1.0)
    sf = (RF * wf - vx) / max(abs(vx), abs(RF * wf), 1.0)
    sr = (RR * wr - vx) / max(abs(vx), abs(RR * wr), 1.0)
    af = (delta * vx - vy - LF * r) / low
    ar = (LR * r - vy) / low
    return CXF * level[0] * sf, CXR * rear * sr, CYF * level[1] * af, CYR * level[2] * ar


def accels(x, delta, road):
    fxf, fxr, fyf, fyr = tyre_forces(x, delta, road)
    return (fxf + fxr - fyf * delta) / MASS, (fyf + fyr + fxf * delta) / MASS


def brake(torque, omega):
    return torque * min(max(omega / 0.2, -1.0), 1.0)


def slope(t, x, start, end, dt):
    _, delta, tf, tr, bf, br, _ = start + (end - start) * (t / dt)
    road = start[6]
    fxf, fxr, fyf, fyr = tyre_forces(x, delta, road)
    front = fyf + fxf * delta
    return [
        (fxf + fxr - fyf * delta) / MASS + x[1] * x[2],
        (front + fyr) / MASS - x[0] * x[2],
        (LF * front - LR * fyr) / INERTIA,
        (tf - brake(bf, x[3]) - RF * fxf) / JF,
        (tr - brake(br, x[4]) - RR * fxr) / JR,
    ]


def driving(k):
    t = 0.015 * k
    road = 1.0 if k < 60 else 0.5 if k < 110 else 1.25
    light_brake = 150.0 if 70 <= k < 90 else 0.0
    return [
        (0.01, 0.02)[k % 2],
        0.03 * np.sin(5 * t),
        500 * np.sin(4 * t),
        250 * np.cos(3 * t),
        light_brake,
        light_brake / 2,
        road,
    ]


def stopping(k):
    press = min(k / 20, 1.0)
    return [0.01, 0.1 * press, 0.0, 0.0, 1500 * press, 1000 * press, 1.0]


def reversing(k):
    return [0.01, 0.2 * np.sin(0.05 * k), -450 * min(k / 10, 1.0), 100 * np.sin(0.1 * k), 0.0, 0.0, 1.0]


print("/* Written by generate_simulate.py; do not edit. */")
print("#ifndef SIMULATE_TABLE_H\n#define SIMULATE_TABLE_H\n")
print("enum { SIMULATED_ROWS = %d, SIMULATED_EVERY = %d };\n" % (ROWS, EVERY))
print("/* mass, yaw inertia, lf, lr, Cx front, Cx rear, Cy front, Cy rear, follow,")
print(" * radius front, rear, inertia front, rear, levels (3) */")
print("static const double simulated_car[] = {")
values = (MASS, INERTIA, LF, LR, CXF, CXR, CYF, CYR, FOLLOW, RF, RR, JF, JR, *LEVEL)
print("  " + ", ".join(repr(v) for v in values) + "\n};\n")

runs = []
for speed, driver in ((20.0, driving), (2.5, stopping), (0.0, reversing)):
    rows = np.array([driver(k) for k in range(ROWS)])
    x = np.array([speed, 0.0, 0.0, speed / RF, speed / RR])
    results = []
    for k in range(ROWS):
        if k > 0:
            dt = rows[k, 0]
            out = solve_ivp(slope, (0, dt), x, method="DOP853", rtol=1e-11, atol=1e-12, args=(rows[k - 1], rows[k], dt))
            assert out.success
            x = out.y[:, -1]
        if k % EVERY == 0:
            results.append([*x, *accels(x, rows[k, 1], rows[k, 6])])
    runs.append((speed, results))

print("static const double simulated_speed[] = { " + ", ".join(repr(run[0]) for run in runs) + " };\n")
print("/* every %d rows: vel_x, vel_y, yaw rate, wheel speed front, rear, accel_x, accel_y */" % EVERY)
print("static const double simulated_truth[][SIMULATED_ROWS / SIMULATED_EVERY][7] = {")
for _, results in runs:
    print("  {")
    for row in results:
        print("    { " + ", ".join("%.10g" % v for v in row) + " },")
    print("  },")
print("};\n")
print("#endif")
