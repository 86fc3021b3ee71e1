"""Run the golden drive through tse.Filter; print the hash of every field of every
estimate.

    python tests/package/replay_api.py [FOLDER of the packages]

The line is the same on every system.
"""

import csv
import hashlib
import sys
from pathlib import Path

if len(sys.argv) > 1:
    sys.path.insert(0, sys.argv[1])
    # Python 3.12 reads the version of Windows by this module, which ends wine 8.
    sys.modules["_wmi"] = None  # type: ignore[assignment]

import tse

DRIVE = Path(__file__).resolve().parents[1] / "replay" / "drive.csv"


def main() -> None:
    """Run the drive and print the hash."""
    f, seen, rows = tse.Filter({**tse.simulated_car(), "driven_axle": "both"}), hashlib.sha256(), 0
    with DRIVE.open(encoding="utf-8") as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            e = f.step({name: float(text) if text else None for name, text in row.items()})
            seen.update(
                repr([int(x) if isinstance(x, tse.Status) else x for x in e.as_dict().values()]).encode()
            )
            rows += 1
    print(
        f"{rows} rows, {seen.hexdigest()}, learnt {hashlib.sha256(f.save_learnt() or b'').hexdigest()[:16]}"
    )


if __name__ == "__main__":
    main()
