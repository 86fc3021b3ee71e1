#!/usr/bin/env python3
"""Measure memory and processor time of `tselab estimate` for a long log in each format.

    .venv/bin/python scripts/dev/long_logs.py [--hours 1] [--formats MF4 "MAT 7.3" ...]

Writes the table in scripts/results/long_logs.md. With the same --hours as before, rows of
formats that are not measured stay in the table. A log repeats the same ten minutes of a
drive: four wheels at 50 Hz, the steering wheel at 20 Hz, the inertial sensor at 100 Hz.
Time stamps of all signals are 20 to 40 ms late. Functions of tests/lab write the log to a
temporary folder, one format at a time. `tselab estimate` is run with --report, which also
needs memory."""

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
PART = 600.0  # [s] duration of the drive that a log contains again and again

from measured import ENV, TSELAB, measure_command  # noqa: E402

import log_formats as formats  # noqa: E402  (functions of tests/lab that write logs)


def write_own_csv(folder: Path, parts: list[formats.Message]) -> Path:
    """Write the repeated drive as a CSV with the column names and units of tse.

    `parts`: messages of the repeated drive, as written to logs in the other formats. Only
    the number of repetitions is taken from them. Return the path of the CSV."""
    path = folder / "log.csv"
    table = formats.make_drive(folder.parent / "car.toml", PART).iloc[: round(100 * PART)]
    for k in range(round(len(parts[-1].time) / len(table))):
        again = table.assign(time=(table["time"] + PART * k).round(4))
        again.to_csv(path, index=False, header=not k, mode="a" if k else "w")
    return path


FORMATS = {name: write for name, (_, write) in formats.FORMATS.items() if "CSV of" not in name}
FORMATS["CSV of tse"] = write_own_csv


def measure_size(path: Path) -> float:
    """Return the size [MB] of a file, or of all files in a folder."""
    return sum(p.stat().st_size for p in ([path] if path.is_file() else path.rglob("*"))) / 1e6


def measure_estimate(folder: Path, log: Path, car: Path) -> tuple[float, float, int]:
    """Run `tselab estimate` on a log of a car.

    Return the maximum memory [2**20 bytes] and the processor time [s] of the command, and
    the number of rows of estimates that it wrote."""
    words = [*TSELAB, "estimate", log, "--vehicle", car]
    words += ["--out", folder / "e.parquet", "--report", folder / "r.html"]
    _, _, busy, memory = measure_command(*words)
    import pyarrow.parquet as pq

    return memory / 2**20, busy, pq.read_metadata(folder / "e.parquet").num_rows


def main() -> None:
    """Write a log in each format, run `tselab estimate` on it, and write the table of the
    memory and time that the command took."""
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
        parts = formats.split_messages(formats.make_drive(car, PART).iloc[: round(100 * PART)])
        for name in asked.formats:
            with tempfile.TemporaryDirectory(dir=scratch) as own:
                begin = time.monotonic()
                log = FORMATS[name](Path(own), formats.repeat_messages(parts, times, PART))
                written = time.monotonic() - begin
                memory, busy, count = measure_estimate(Path(own), log, car)
                rows[name] = (
                    f"| {name} | {measure_size(log):.0f} MB | {count} | {memory:.0f} MB | {busy:.0f} s |"
                )
                print(rows[name], f"written in {written:.0f} s", flush=True)
            write_result(rows, command, asked.hours)


def write_result(rows: dict[str, str], command: str, hours: float) -> None:
    """Write scripts/results/long_logs.md, with one row of its table for each format.

    `rows`: row of the table as Markdown, by name of the format. `command`: command line
    of this script, for the head of the file. `hours`: duration of each log."""
    lines = [
        f"<!-- Written by `{command}`. -->",
        "",
        f"One log of {hours:g} h in each format: four wheels at 50 Hz, steering wheel at 20 Hz, inertial "
        "sensor at 100 Hz. Command: `tselab estimate LOG --vehicle CAR --out EST.parquet --report "
        "REPORT.html`. Memory: maximum of the process (`ru_maxrss`, MB of 2^20 bytes) in one run.",
        "",
        "| format | file size | rows | max memory | processor time |",
        "|---|---:|---:|---:|---:|",
        *(rows[name] for name in FORMATS if name in rows),
    ]
    RESULT.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
