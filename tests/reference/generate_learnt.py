#!/usr/bin/env python3
"""Write learnt_table.h for tests/unit/host/test_learnt.c and test_prepare.c: a learnt state as bytes, by struct and zlib.

python3 generate_learnt.py > learnt_table.h        standard library only; deterministic
"""

import math
import struct
import sys
import zlib
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROWS = tomllib.loads((Path(__file__).resolve().parents[2] / "src" / "tables" / "vehicle.toml").read_text())

# Binary fractions, so that double, float and fixed hold them exactly.
KNOWN, NU = 0b101, 64
KEPT = 11  # biases, logarithms of stiffness and grip, steering offset, ratio, lateness, radius
MEAN = (-0.125, 0.0625, 0.0078125, -0.25, 0.125, 0.5, 0.0625, 2**-8, 2**-6, 2**-7, 2**-9)
SD = (0.03125, 0.015625, 0.00390625, 0.03125, 0.25, 0.0625, 0.125, 2**-10, 2**-7, 2**-7, 2**-9)
COMMON = (0.5, -0.5, 0.25, 0.5, 0.75, -0.25, 0.125, 0.5, 0.25, -0.125, 0.5)  # correlations are products of these
NOISE = (0.5, 2.0, 1.25, 1.0, 0.75)
# What particles know: stiffness over nominal less 1, its sd and spread
PARTICLE_MEAN, PARTICLE_SD = (-0.25, 0.125, 0.5), (0.03125, 0.25, 0.0625)
SPREAD, CORRELATION = (0.0625, 0.25, 0.125), (0.0, -0.5, 0.25)


def vehicle():
    """FNV-1a over the vehicle's default settings in single precision, little-endian."""
    h = 2166136261
    for value in (row["default"] for row in ROWS.values()):
        for byte in struct.pack("<f", float(value)):
            h = (h ^ byte) * 16777619 % 2**32
    return h


def q24(values):
    return struct.pack(f"<{len(values)}i", *(round(x * 2**24) for x in values))


def learnt(of_particles=False):
    """`of_particles`: as they write it, who know stiffness, biases and process sd alone."""
    mean, sd, noise = MEAN, SD, NOISE
    pairs = [COMMON[i] * COMMON[j] for i in range(KEPT) for j in range(i + 1, KEPT)]
    if of_particles:
        levels = [1 + x for x in PARTICLE_MEAN]
        mean = (*MEAN[:3], *(math.log(x) for x in levels), 0, 0, 0, 0, 0)
        sd = (*SD[:3], *(x / level for x, level in zip(PARTICLE_SD, levels, strict=True)), 0, 0, 0, 0, 0)
        pairs, noise = [0] * len(pairs), [0] * len(NOISE)
    body = struct.pack("<III", vehicle(), KNOWN, NU) + q24(mean) + q24(sd)
    body += struct.pack(f"<{len(pairs)}hh", *(round(x * 2**14) for x in pairs), 0)
    body += q24(noise) + q24(SPREAD) + q24(CORRELATION)
    data = b"tsel" + struct.pack("<HH", 3, 8 + len(body) + 4) + body
    return data + struct.pack("<I", zlib.crc32(data))


def array(name, data):
    print(f"\nstatic const uint8_t {name}[{len(data)}] = {{")
    for i in range(0, len(data), 16):
        print("  " + " ".join(f"0x{b:02x}," for b in data[i : i + 16]))
    print("};")


def numbers(name, values):
    print(f"static const double {name}[{len(values)}] = {{ {', '.join(map(repr, values))} }};")


def main():
    print("/* Written by generate_learnt.py: a learnt state of the built-in car as struct and zlib make it. */")
    print("#ifndef LEARNT_TABLE_H\n#define LEARNT_TABLE_H\n\n#include <stdint.h>\n")
    print(f"#define LEARNT_VEHICLE 0x{vehicle():08x}u\n#define LEARNT_KNOWN {KNOWN}u\n#define LEARNT_NU {NU}")
    print("#if defined(LEARNT_WITH_BYTES)")
    numbers("learnt_mean", MEAN)
    numbers("learnt_sd", SD)
    numbers("learnt_common", COMMON)
    numbers("learnt_noise", NOISE)
    numbers("learnt_particle_mean", PARTICLE_MEAN)
    numbers("learnt_particle_sd", PARTICLE_SD)
    numbers("learnt_spread", SPREAD)
    numbers("learnt_correlation", CORRELATION)
    array("learnt_bytes", learnt())
    array("learnt_by_particles", learnt(of_particles=True))
    print("\n#endif\n#endif")


if __name__ == "__main__":
    main()
