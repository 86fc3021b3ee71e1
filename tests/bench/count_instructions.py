"""Count the instructions per particle and step with valgrind, and compare with a limit.

Instructions are counted because the wall clock of a shared machine is too noisy. The
limit leaves room for another compiler version. A learning pass that is no longer
vectorised (2000 instructions and more) exceeds it.
"""

import shutil
import subprocess
import sys

# Robust form, baseline x86-64, -O3: gcc 12 double 1124, float 650.
LIMIT = {"double": 1300, "float": 800}
PARTICLES, ROWS = 512, 100
SKIPPED = 77


def count_instructions(bench: str, rows: int) -> int:
    command = [
        "valgrind",
        "--tool=callgrind",
        "--callgrind-out-file=/dev/null",
        bench,
        str(PARTICLES),
        str(rows),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    line = next(x for x in done.stderr.splitlines() if "Collected" in x)
    return int(line.split(":")[1])


def main() -> int:
    bench, real = sys.argv[1:]
    if shutil.which("valgrind") is None:
        print("skipped: valgrind is not installed")
        return SKIPPED
    step = (count_instructions(bench, 2 * ROWS) - count_instructions(bench, ROWS)) / ROWS / PARTICLES
    print(f"{step:.0f} instructions per particle and step ({real}, limit {LIMIT[real]})")
    return 0 if step <= LIMIT[real] else 1


if __name__ == "__main__":
    sys.exit(main())
