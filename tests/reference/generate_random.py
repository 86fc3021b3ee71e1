#!/usr/bin/env python3
"""Write random_table.h for tests/unit/number/test_random.c.

threefry2x32-20 in the general form of Salmon et al. (SC11, section 4.1: rounds, rotations, key injection every four
rounds) on Python integers, checked here against the three vectors that Random123 publishes; quantiles of Student's t
and of F from scipy.

    python3 generate_random.py > random_table.h        needs scipy; deterministic
"""

import random

from scipy import stats

MASK = 0xFFFFFFFF
ROTATIONS = (13, 15, 26, 6, 17, 29, 16, 24)


def threefry2x32(counter, key, rounds=20):
    words = [(c + k) & MASK for c, k in zip(counter, key, strict=True)]
    schedule = [*key, 0x1BD11BDA ^ key[0] ^ key[1]]
    for r in range(rounds):
        n = ROTATIONS[r % 8]
        words[0] = (words[0] + words[1]) & MASK
        words[1] = ((words[1] << n | words[1] >> (32 - n)) & MASK) ^ words[0]
        if r % 4 == 3:
            k = r // 4 + 1
            words[0] = (words[0] + schedule[k % 3]) & MASK
            words[1] = (words[1] + schedule[(k + 1) % 3] + k) & MASK
    return words


ones = (MASK, MASK)
assert threefry2x32((0, 0), (0, 0)) == [0x6B200159, 0x99BA4EFE]
assert threefry2x32(ones, ones) == [0x1CB996FC, 0xBB002BE7]
assert threefry2x32((0x243F6A88, 0x85A308D3), (0x13198A2E, 0x03707344)) == [0xC4923A9C, 0x483DF7A0]

rng = random.Random(1)
vectors = [((0, 0), (0, 0)), (ones, ones), ((0x243F6A88, 0x85A308D3), (0x13198A2E, 0x03707344))]
vectors += [((1 << b if b < 32 else 0, 1 << b - 32 if b >= 32 else 0), (0, 0)) for b in range(0, 64, 5)]
vectors += [tuple((rng.getrandbits(32), rng.getrandbits(32)) for _ in range(2)) for _ in range(30)]

print("/* Written by generate_random.py; do not edit. */")
print("#ifndef RANDOM_TABLE_H\n#define RANDOM_TABLE_H\n\n#include <stdint.h>\n")
print("/* counter (2 words), key (2 words), result (2 words); the first three rows are Random123's own vectors */")
print("static const uint32_t threefry_table[][6] = {")
for counter, key in vectors:
    print("  { " + ", ".join("0x%08xu" % w for w in (*counter, *key, *threefry2x32(counter, key))) + " },")
print("};\n")

# Probabilities at which empirical distributions are compared with the exact ones: dense, and into both tails.
probability = [0.0005, 0.001, 0.002, 0.005] + [k / 100 for k in range(1, 100)] + [0.995, 0.998, 0.999, 0.9995]
dofs = [5, 6, 8, 11, 30, 101, 1000]


def numbers(values):
    text = [repr(float(v)) for v in values]
    return ",\n    ".join(", ".join(text[i : i + 5]) for i in range(0, len(text), 5))


print("static const double probability_table[] = {\n    " + numbers(probability) + ",\n};\n")
print("static const double dof_table[] = { " + ", ".join(repr(float(n)) for n in dofs) + " };\n")
for name, text, law in (
    ("student_table", "quantiles of Student's t, one row per dof", lambda nu: stats.t(nu)),
    (
        "radius3_table",
        "quantiles of F(3, dof): the squared radius of three jointly spherical t, over 3",
        lambda nu: stats.f(3, nu),
    ),
):
    print("/* %s */" % text)
    print("static const double %s[][%d] = {" % (name, len(probability)))
    for nu in dofs:
        print("  { " + numbers(law(nu).ppf(probability)) + " },")
    print("};\n")
print("#endif")
