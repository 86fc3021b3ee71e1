#!/usr/bin/env python3
"""The memory that tselab estimate takes for a long log in each format, with report and estimates.

    .venv/bin/python scripts/dev/long_logs.py [--hours 1] [--formats MF4 "MAT 7.3" ...]

writes scripts/results/long_logs.md; of formats that are not named the rows stay as they are. A log has four wheels at 50 Hz, the
steering wheel at 20 Hz, the inertial sensor at 100 Hz, each later than it was true: ten minutes of drive, again and again, by
the writers of short logs in tests/lab. One format at a time, in a temporary folder.
"""

import argparse
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests" / "lab")]
RESULT = ROOT / "scripts" / "results" / "long_logs.md"
PART = 600.0  # s of the drive that is repeated

from measured import ENV, TSELAB, measured  # noqa: E402

import log_formats as one  # noqa: E402  (the writers of short logs, in the tests)


def own_csv(folder: Path, parts: list[one.Message]) -> Path:
    """The same drive in the names of tse, as often: its rows are read as they are."""
    path, table = folder / "log.csv", one.drive(folder.parent / "car.toml", PART).iloc[: round(100 * PART)]
    for k in range(round(len(parts[-1].time) / len(table))):
        again = table.assign(time=(table["time"] + PART * k).round(4))
        again.to_csv(path, index=False, header=not k, mode="a" if k else "w")
    return path


FORMATS = {name: write for name, (_, write) in one.FORMATS.items() if "CSV of" not in name} | {
    "CSV of tse": own_csv
}


def size(path: Path) -> float:
    """MB of a file or of those in a folder."""
    return sum(p.stat().st_size for p in ([path] if path.is_file() else path.rglob("*"))) / 1e6


def estimated(folder: Path, log: Path, car: Path) -> tuple[float, float, int]:
    """Greatest memory in MB of 2**20 bytes, processor seconds, rows of the estimates."""
    words = [
        *TSELAB,
        "estimate",
        log,
        "--vehicle",
        car,
        "--out",
        folder / "e.parquet",
        "--report",
        folder / "r.html",
    ]
    _, _, busy, memory = measured(*words)
    import pyarrow.parquet as pq

    return memory / 2**20, busy, pq.read_metadata(folder / "e.parquet").num_rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--formats", nargs="+", choices=list(FORMATS), default=list(FORMATS), metavar="NAME")
    asked = parser.parse_args()
    times = max(1, round(3600 * asked.hours / PART))
    command = f"scripts/dev/long_logs.py --hours {asked.hours:g}"
    before = RESULT.read_text(encoding="utf-8") if RESULT.exists() else ""
    rows = dict(re.findall(r"^(\| ([^|]+?) \|.*)$", before, re.M)) if f"`{command}`" in before else {}
    rows = {name: row for row, name in rows.items() if name in FORMATS}
    with tempfile.TemporaryDirectory() as scratch:
        car = Path(scratch) / "car.toml"
        example = subprocess.run(
            [*TSELAB, "vehicle", "--simulated"], env=ENV, capture_output=True, text=True, check=True
        )
        car.write_text(example.stdout)
        parts = one.messages(one.drive(car, PART).iloc[: round(100 * PART)])
        for name in asked.formats:
            with tempfile.TemporaryDirectory(dir=scratch) as own:
                begin = time.monotonic()
                log = FORMATS[name](Path(own), one.repeated(parts, times, PART))
                written = time.monotonic() - begin
                memory, busy, count = estimated(Path(own), log, car)
                rows[name] = f"| {name} | {size(log):.0f} MB | {count} | {memory:.0f} MB | {busy:.0f} s |"
                print(rows[name], f"written in {written:.0f} s", flush=True)
            write(rows, command, asked.hours)


def write(rows: dict[str, str], command: str, hours: float) -> None:
    lines = [
        f"<!-- Written by `{command}`. -->",
        "",
        f"One log of {hours:g} h in each format, four wheels at 50 Hz, the steering wheel at 20 Hz, the inertial sensor at 100 Hz, "
        "through `tselab estimate LOG --vehicle CAR --out EST.parquet --report REPORT.html`: the greatest memory of that process "
        "(`ru_maxrss`, MB of 2^20 bytes), one run each.",
        "",
        "| Format | file | rows | memory | processor |",
        "|---|---:|---:|---:|---:|",
        *(rows[name] for name in FORMATS if name in rows),
    ]
    RESULT.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
