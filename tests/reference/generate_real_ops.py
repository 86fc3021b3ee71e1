#!/usr/bin/env python3
"""Write real_ops_table.h: elementary functions from mpmath, 40 digits, for tests/unit/number/test_real_ops.c.

Arguments have at most 24 significant bits, so double and float hold them exactly; those that are multiples
of 2^-20 below 2048 are exact in fixed point too (the test skips the others there).

    python3 generate_real_ops.py > real_ops_table.h        needs mpmath; deterministic
"""

import random
from mpmath import mp, mpf, log, sqrt, sin, cos, atan2, pi, nint, floor

mp.dps = 40
rng = random.Random(20)
LSB = mpf(2) ** -20


def short(x):
    """x rounded to 24 significant bits, and to a multiple of 2^-20 where that keeps it non-zero."""
    x = mpf(x)
    if 1 <= abs(x) * 2**20 and abs(x) < 2**11:
        x = nint(x / LSB) * LSB
    if x == 0:
        return x
    unit = mpf(2) ** (int(floor(log(abs(x), 2))) - 23)
    return nint(x / unit) * unit


def row(*values):
    return "  { " + ", ".join(repr(float(v)) for v in values) + " },"


def table(name, columns, rows):
    unique = sorted({tuple(float(v) for v in r): r for r in rows}.items())
    print("/* %s */" % columns)
    print("static const double %s[][%d] = {" % (name, len(rows[0])))
    for _, r in unique:
        print(row(*r))
    print("};\n")


positive = [1 + s * k * LSB for k in (1, 2, 3, 5, 9, 17, 100, 1000, 10000) for s in (-1, 1)]  # next to 1
positive += [sqrt(mpf(2)) * h + k * LSB for h in (mpf(1) / 2, 1) for k in (-2, -1, 0, 1, 2)]  # seams of log2
positive += [mpf(2) ** k for k in range(-20, 11)]
positive += [mpf(2) ** rng.uniform(-1, 1) for _ in range(60)]
positive += [mpf(2) ** rng.uniform(-19, 10.99) for _ in range(60)]
positive += [mpf(2) ** rng.uniform(-120, 120) for _ in range(30)]
positive = [short(x) for x in positive]

octaves = [mpf(k) for k in range(-24, 13)] + [k * LSB for k in (-3, -2, -1, 1, 2, 3)]
octaves += [mpf(1) / 2 + k * LSB + n for k in (-1, 0, 1) for n in (-7, -1, 0, 3)]  # seams of exp2
octaves += [mpf(rng.uniform(-1, 1)) for _ in range(40)]
octaves += [mpf(rng.uniform(-22, 11)) for _ in range(60)]
octaves += [mpf(rng.uniform(-120, 120)) for _ in range(40)]
octaves = [short(x) for x in octaves]

turns = [short(mpf(k) / 8 + e * LSB) for k in range(9) for e in (-1, 0, 1) if 0 <= mpf(k) / 8 + e * LSB <= 1]
turns += [short(rng.random()) for _ in range(120)]

points = [(0, 1), (0, -1), (1, 0), (-1, 0)]
points += [(y, x) for y in (-3, 3) for x in (-3, 3)]  # diagonals
points += [(mpf("0.41421356") * s + e * LSB, t) for s in (-1, 1) for t in (-1, 1) for e in (-1, 0, 1)]
points += [
    (rng.uniform(-1, 1) * 2 ** rng.uniform(-8, 10), rng.uniform(-1, 1) * 2 ** rng.uniform(-8, 10)) for _ in range(100)
]
points = [(short(y), short(x)) for y, x in points]

print("/* Written by generate_real_ops.py; do not edit. */")
print("#ifndef REAL_OPS_TABLE_H\n#define REAL_OPS_TABLE_H\n")
table("log2_table", "x, log2(x), sqrt(x)", [(x, log(x, 2), sqrt(x)) for x in positive])
table("exp2_table", "x, 2^x", [(x, mpf(2) ** x) for x in octaves])
table("turn_table", "t, sin(2 pi t), cos(2 pi t)", [(t, sin(2 * pi * t), cos(2 * pi * t)) for t in turns])
table("atan2_table", "y, x, atan2(y, x)", [(y, x, atan2(y, x)) for y, x in points])
print("#endif")
