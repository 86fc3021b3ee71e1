#!/usr/bin/env python3
"""Write learnt_table.h for tests/unit/host/test_learnt.c and test_prepare.c: a learnt state as bytes, by struct and zlib.

python3 generate_learnt.py > learnt_table.h        standard library only; deterministic
"""

import re
import struct
import zlib
from pathlib import Path

ROWS = (Path(__file__).resolve().parents[2] / "include" / "tse" / "vehicle.def").read_text()

# Binary fractions, so that double, float and fixed hold them exactly.
KNOWN, NU = 0b101, 64
MEAN, MEAN_SD = (-0.25, 0.125, 0.5), (0.03125, 0.25, 0.0625)
SPREAD, CORRELATION = (0.0625, 0.25, 0.125), (0.0, -0.5, 0.25)
BIAS, BIAS_SD = (-0.125, 0.0625, 0.0078125), (0.03125, 0.015625, 0.00390625)
NOISE, HELD = (0.5, 2.0, 1.25), 1


def vehicle():
    """FNV-1a over the vehicle's default settings in single precision, little-endian."""
    h = 2166136261
    for _name, value in re.findall(r"^REAL\((\w+),\s*([^,]+),", ROWS, re.M):
        for byte in struct.pack("<f", float(value)):
            h = (h ^ byte) * 16777619 % 2**32
    return h


def learnt(mark=b"tsel", version=2, of_hypotheses=True, extra=b""):
    """`of_hypotheses`: as the default form writes it; particles know nothing of noise, level and steering that is held."""
    numbers = [*MEAN, *MEAN_SD, *SPREAD, *CORRELATION, *BIAS, *BIAS_SD]
    body = struct.pack("<III18i", vehicle(), KNOWN, NU, *(round(x * 2**24) for x in numbers))
    if version > 1:
        body += struct.pack("<3iI", *(round(x * 2**24) * of_hypotheses for x in NOISE), (HELD << 6) * of_hypotheses)
    body += extra
    data = mark + struct.pack("<HH", version, 8 + len(body) + 4) + body
    return data + struct.pack("<I", zlib.crc32(data))


def array(name, data):
    print(f"\nstatic const uint8_t {name}[{len(data)}] = {{")
    for i in range(0, len(data), 16):
        print("  " + " ".join(f"0x{b:02x}," for b in data[i : i + 16]))
    print("};")


def numbers(name, values):
    print(f"static const double {name}[3] = {{ {', '.join(map(repr, values))} }};")


def main():
    print("/* Written by generate_learnt.py: a learnt state of the built-in car as struct and zlib make it. */")
    print("#ifndef LEARNT_TABLE_H\n#define LEARNT_TABLE_H\n\n#include <stdint.h>\n")
    print(f"#define LEARNT_VEHICLE 0x{vehicle():08x}u\n#define LEARNT_KNOWN {KNOWN}u\n#define LEARNT_NU {NU}")
    print("#if defined(LEARNT_WITH_BYTES)")
    numbers("learnt_mean", MEAN)
    numbers("learnt_mean_sd", MEAN_SD)
    numbers("learnt_spread", SPREAD)
    numbers("learnt_correlation", CORRELATION)
    numbers("learnt_bias", BIAS)
    numbers("learnt_bias_sd", BIAS_SD)
    numbers("learnt_noise", NOISE)
    print(f"#define LEARNT_HELD {HELD}")
    array("learnt_bytes", learnt())
    array("learnt_by_particles", learnt(of_hypotheses=False))
    array("learnt_of_format_1", learnt(version=1))
    array("learnt_of_a_newer_format", learnt(version=3, extra=b"what it knows"))
    array("learnt_of_another_kind", learnt(mark=b"tsep"))
    array("learnt_of_no_format", learnt(version=0))
    array("learnt_too_long", learnt(extra=bytes(4)))
    print("\n#endif\n#endif")


if __name__ == "__main__":
    main()
