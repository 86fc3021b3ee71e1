#!/usr/bin/env python3
"""Fit the polynomials of src/number/real_ops.h and print them as C.

Every function is written as  form(x) * P(u),  u in [lo, hi]; P is the minimax polynomial (Remez) with
n coefficients. The form carries the zeros and exact values the function must keep: log2(1) = 0,
exp2(0) = 1, sin and cos exactly 0 where they vanish.

The bound printed with each row is the largest error of the *rounded* coefficients evaluated in exact
arithmetic; the rounding of the run-time evaluation comes on top and is measured by the unit test.

    python3 fit_elementary.py              prints the coefficients; needs mpmath
    python3 fit_elementary.py --degrees    prints the bound for one coefficient fewer and more
"""

from mpmath import mp, mpf, matrix, lu_solve, log, sin, cos, atan, sqrt, pi, tan

mp.dps = 50
LN2 = log(mpf(2))


def remez(g, weight, lo, hi, n, grid=1500):
    """Coefficients c of P(u) = sum c_k u^k that minimise max |weight(u) (P(u) - g(u))| over [lo, hi]."""
    mid, half = (lo + hi) / 2, (hi - lo) / 2
    u = [mid - half * cos(pi * (mpf(i) + mpf(1) / 2) / (n + 1)) for i in range(n + 1)]
    points = [mid - half * cos(pi * mpf(i) / grid) for i in range(grid + 1)]
    table = [(p, g(p), weight(p)) for p in points]
    for _ in range(12):
        a, b = matrix(n + 1, n + 1), matrix(n + 1, 1)
        for i, p in enumerate(u):
            for k in range(n):
                a[i, k] = p**k
            a[i, n] = (-1) ** i / weight(p)
            b[i] = g(p)
        c = list(lu_solve(a, b))[:n]
        error = [w * (poly(c, p) - y) for p, y, w in table]
        peaks = []  # the largest error of each run of one sign
        for i, e in enumerate(error):
            if peaks and (e > 0) == (error[peaks[-1]] > 0):
                if abs(e) > abs(error[peaks[-1]]):
                    peaks[-1] = i
            else:
                peaks.append(i)
        while len(peaks) > n + 1:
            peaks.pop(0 if abs(error[peaks[0]]) < abs(error[peaks[-1]]) else -1)
        if len(peaks) < n + 1:
            break  # error already at the resolution of the grid
        sizes = [abs(error[i]) for i in peaks]
        u = [points[i] for i in peaks]
        if max(sizes) < min(sizes) * mpf("1.001"):
            break
    return c


def poly(c, u):
    value = mpf(0)
    for k in reversed(c):
        value = value * u + k
    return value


def largest(g, weight, lo, hi, c, grid=4000):
    return max(
        abs(weight(u) * (poly(c, u) - g(u)))
        for u in (lo + (hi - lo) * mpf(i) / grid for i in range(grid + 1))
    )


def series(f, u, at_zero):
    return at_zero if abs(u) < mpf("1e-20") else f(u)  # closer, f would be nothing but cancellation


def away_from_zero(x):  # |x| without its zero: Remez needs a positive weight
    return abs(x) + mpf("1e-3")


# u -> value of P, weight that turns the error of P into the error that counts, range
def log2_ratio():  # log2(m) = s P(s^2), s = (m-1)/(m+1), m in [sqrt(1/2), sqrt(2)]
    smax = (sqrt(mpf(2)) - 1) / (sqrt(mpf(2)) + 1)
    g = lambda z: series(lambda z: log((1 + sqrt(z)) / (1 - sqrt(z))) / LN2 / sqrt(z), z, 2 / LN2)
    return g, lambda z: 1 / g(z), mpf(0), smax**2, "relative"


def log2_direct():  # log2(1+f) = f P(f), f in [sqrt(1/2)-1, sqrt(2)-1]
    g = lambda f: series(lambda f: log(1 + f) / LN2 / f, f, 1 / LN2)
    return g, away_from_zero, sqrt(mpf(1) / 2) - 1, sqrt(mpf(2)) - 1, "absolute"


def exp2_half():  # 2^r = 1 + r P(r), r in [-1/2, 1/2]
    g = lambda r: series(lambda r: (mpf(2) ** r - 1) / r, r, LN2)
    return g, lambda r: away_from_zero(r) / mpf(2) ** r, -mpf(1) / 2, mpf(1) / 2, "relative"


def exp2_unit():  # 2^f = 1 + f P(f), f in [0, 1]
    g = lambda r: series(lambda r: (mpf(2) ** r - 1) / r, r, LN2)
    return g, lambda r: (r + mpf("1e-6")) / mpf(2) ** r, mpf(0), mpf(1), "relative"


def sin_turn():  # sin(pi v) = v (1 - v^2) P(v^2), v in [-1, 1]
    def g(w):
        v = sqrt(w)
        return pi if v < mpf("1e-20") else pi / 2 if 1 - v < mpf("1e-20") else sin(pi * v) / (v * (1 - w))

    return g, lambda w: sqrt(w) * (1 - w) + mpf("1e-6"), mpf(0), mpf(1), "absolute"


def cos_turn():  # cos(pi v) = (1 - 4 v^2) P(v^2), v in [-1, 1]
    def g(w):
        v = sqrt(w)
        return pi / 4 if abs(v - mpf(1) / 2) < mpf("1e-20") else cos(pi * v) / (1 - 4 * w)

    return g, lambda w: away_from_zero(1 - 4 * w), mpf(0), mpf(1), "absolute"


def sin_octant():  # sin(pi/4 x) = x P(x^2), |x| <= 1
    g = lambda w: series(lambda w: sin(pi / 4 * sqrt(w)) / sqrt(w), w, pi / 4)
    return g, lambda w: sqrt(w) + mpf("1e-6"), mpf(0), mpf(1), "absolute"


def cos_octant():  # cos(pi/4 x) = 1 + x^2 P(x^2), |x| <= 1
    g = lambda w: series(lambda w: (cos(pi / 4 * sqrt(w)) - 1) / w, w, -(pi**2) / 32)
    return g, lambda w: w + mpf("1e-6"), mpf(0), mpf(1), "absolute"


def atan_eighth():  # atan(q) = q P(q^2), |q| <= tan(pi/8)
    g = lambda w: series(lambda w: atan(sqrt(w)) / sqrt(w), w, mpf(1))
    return g, lambda w: 1 / g(w), mpf(0), tan(pi / 8) ** 2, "relative"


def to_format(x, fmt):
    """Round x to the format; returns (exact value of the rounded number, text in C)."""
    if fmt == "double":
        d = float(x)
        return mpf(d), repr(d)
    if fmt == "float":
        if x == 0:
            return x, "0.0f"
        scale = mpf(2) ** (23 - int(mp.floor(mp.log(abs(x), 2))))
        value = mp.nint(x * scale) / scale
        text = "%.9g" % float(value)
        return value, (text if "." in text or "e" in text else text + ".0") + "f"
    bits = int(fmt[1:])  # 'q29': integer scaled by 2^29
    k = int(mp.nint(x * mpf(2) ** bits))
    return mpf(k) / mpf(2) ** bits, str(k)


ROWS = [
    # function     fit           format    n
    ("log2", log2_ratio, "double", 6),
    ("exp2", exp2_half, "double", 9),
    ("sin", sin_turn, "double", 8),
    ("cos", cos_turn, "double", 9),
    ("atan", atan_eighth, "double", 9),
    ("log2", log2_ratio, "float", 4),
    ("exp2", exp2_half, "float", 5),
    ("sin", sin_turn, "float", 6),
    ("cos", cos_turn, "float", 6),
    ("atan", atan_eighth, "float", 5),
    # log2 and atan in src/number/real_ops.h are another end of the exchange: same bound, other last digits of the last coefficients
    ("log2", log2_direct, "q30", 11),
    ("exp2", exp2_unit, "q30", 7),
    ("sin", sin_octant, "q30", 5),
    ("cos", cos_octant, "q30", 4),
    ("atan", atan_eighth, "q30", 7),
]

if __name__ == "__main__":
    import sys

    for name, fit, fmt, n in ROWS:
        g, weight, lo, hi, kind = fit()
        for m in [n - 1, n, n + 1] if "--degrees" in sys.argv else [n]:
            rounded = [to_format(c, fmt) for c in remez(g, weight, lo, hi, m)]
            bound = largest(g, weight, lo, hi, [value for value, _ in rounded])
            print("/* %-6s %-5s %d coefficients, %s error <= %s */" % (fmt, name, m, kind, mp.nstr(bound, 2)))
        if "--degrees" not in sys.argv:
            for k, (_, text) in enumerate(rounded):
                print("c%d = %s" % (k, text))
