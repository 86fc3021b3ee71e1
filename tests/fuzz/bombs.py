"""Read small files that unpack to far more than the memory, through the commands.

    python -m tests.fuzz.bombs [--write] [--only TEXT]

Each file is under 10 MB: constant signals and times that count up compress well. Each
format has a file with twenty million rows, and one with the maximum allowed number of
rows (ALWAYS_ALLOWED_ROWS), which is read. A text file is not compressed and holds 10 MB.
The figures are those of the process: resident memory, seconds of its processors, and the
size of its temporary files.
"""

import argparse
import multiprocessing
import os
import struct
import subprocess
import sys
import tempfile
import threading
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "scripts" / "results" / "bombs.md"
NAMES = ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")
MANY, ALLOWED = 20_000_000, 1_499_000
MAX_TAKEN = {"memory": 1024, "seconds": 60.0, "disk": 2048}  # MB, s, MB
LIMIT = 240  # s, elapsed time: the machine may be shared


def make_columns(rows: int) -> dict[str, np.ndarray]:
    """Return the signals of a log."""
    return {n: np.full(rows, 30.0 if n.startswith("wheel") else 0.0) for n in NAMES}


def write_parquet(path: Path, rows: int) -> None:
    """Write a table of constant signals."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({"time": np.arange(rows) * 10, **make_columns(rows)})  # ms, as its values show
    pq.write_table(
        table,
        path,
        compression="zstd",
        use_dictionary=list(NAMES),
        column_encoding={"time": "DELTA_BINARY_PACKED"},
    )


def write_mat73(path: Path, rows: int) -> None:
    """Write datasets of constant signals."""
    import h5py

    with h5py.File(path, "w") as file:
        for name, value in {"time": np.arange(rows) * 0.01, **make_columns(rows)}.items():
            file.create_dataset(name, data=value, compression="gzip", compression_opts=9, shuffle=True)


def write_mat5(path: Path, rows: int, names: tuple[str, ...] = ("time", *NAMES)) -> None:
    """Write variables of zeros block by block (MATLAB, MAT-File Format, 2019)."""
    parts = [b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H2s", 0x0100, b"IM")]
    for name in names:
        label = name.encode()
        head = struct.pack("<IIII", 6, 8, 6, 0) + struct.pack(
            "<IIii", 5, 8, rows, 1
        )  # of doubles; so many rows
        head += (
            struct.pack("<II", 1, len(label))
            + label
            + bytes(-len(label) % 8)
            + struct.pack("<II", 9, 8 * rows)
        )
        work = zlib.compressobj(9)
        packed = work.compress(struct.pack("<II", 14, len(head) + 8 * rows) + head)
        for left in range(8 * rows, 0, -(1 << 24)):
            packed += work.compress(bytes(min(left, 1 << 24)))
        packed += work.flush()
        parts += [struct.pack("<II", 15, len(packed)), packed]
    path.write_bytes(b"".join(parts))


def write_mf4(path: Path, rows: int) -> None:
    """Write a measurement with constant signals."""
    from asammdf import MDF, Signal

    clock = np.arange(rows) * 0.01
    with MDF() as mdf:
        mdf.append([Signal(value, clock, name=name) for name, value in make_columns(rows).items()])
        mdf.save(path, compression=2, overwrite=True)


def write_blf(path: Path, rows: int) -> None:
    """Write containers of equal frames."""
    frame = (
        struct.pack("<4sHHLL", b"LOBJ", 32, 1, 48, 1)
        + struct.pack("<LHHQ", 1, 0, 0, 0)
        + struct.pack("<HBBL8s", 1, 0, 8, 0xC1, b"")
    )
    packed = zlib.compress(frame * 20000, 9)
    box = (
        struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(packed), 10)
        + struct.pack("<H6xL4x", 2, 20000 * len(frame))
        + packed
    )
    box += bytes((32 + len(packed)) % 4)  # so many, as its readers have it
    start = struct.pack("<4sL", b"LOGG", 144).ljust(144, b"\0")
    path.write_bytes(start + box * -(-rows // 20000))
    path.with_suffix(".dbc").write_text('VERSION ""\nBO_ 193 A: 8 X\n SG_ steer : 0|16@1+ (1,0) [0|0] "" X\n')


def write_csv(path: Path, rows: int) -> None:
    """Write as many rows as 10 MB hold."""
    path.write_text(
        "time,steer_angle,wheel_speed_front,wheel_speed_rear,accel_x,accel_y,yaw_rate\n" + ",,,,,,\n" * rows
    )


def write_gaps(path: Path, rows: int) -> None:
    """Write values 1 s apart: resampling to 100 Hz gives a hundred times as many rows."""
    lines = [f"{k};0;30;30;0;0;0" for k in range(rows)]
    path.write_text(
        "time;steer_angle;wheel_speed_front;wheel_speed_rear;accel_x;accel_y;yaw_rate\n"
        + "\n".join(lines)
        + "\n"
    )


FORMATS: dict[str, tuple[str, Callable[[Path, int], None], tuple[int, ...]]] = {
    "Parquet": ("log.parquet", write_parquet, (MANY, ALLOWED)),
    "MAT 7.3": ("log.mat", write_mat73, (MANY, ALLOWED)),
    "MAT 5": ("log5.mat", write_mat5, (MANY, ALLOWED)),
    "MF4": ("log.mf4", write_mf4, (MANY, ALLOWED)),
    "BLF": ("log.blf", write_blf, (MANY, ALLOWED)),
    "CSV of nothing": ("blank.csv", write_csv, (1_400_000,)),
    "CSV of 1 Hz": ("slow.csv", write_gaps, (400_000, 14_000)),
}


@dataclass
class Taken:
    """Time, memory and disk of a command, and its output."""

    code: int
    seconds: float
    memory: float
    disk: float
    said: str


def run_command(arguments: list[str], folder: Path) -> Taken:
    """Run a command within LIMIT seconds."""
    scratch = folder / "tmp"
    scratch.mkdir(exist_ok=True)
    process = subprocess.Popen(
        [sys.executable, "-m", "tselab", *arguments],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=(folder / "said").open("w"),
        env={
            **os.environ,
            "TMPDIR": str(scratch),
            "PYTHONPATH": str(ROOT / "scripts"),
            "OPENBLAS_NUM_THREADS": "1",
        },
    )
    disk, done = [0.0], threading.Event()

    def watch() -> None:
        while not done.wait(0.1):
            disk[0] = max(disk[0], sum(p.stat().st_size for p in scratch.rglob("*") if p.is_file()) / 2**20)

    watcher, timer = threading.Thread(target=watch), threading.Timer(LIMIT, process.kill)
    watcher.start()
    timer.start()
    _, status, used = os.wait4(process.pid, 0)
    timer.cancel()
    done.set()
    watcher.join()
    errors = [x for x in (folder / "said").read_text().splitlines() if x.startswith("tselab: ")]
    said = errors[0].partition("error: ")[2] if errors else ""
    return Taken(
        os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, disk[0], said
    )


def main() -> int:
    """Make the files, read them and check the limits."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--write", action="store_true", help=f"make {RESULTS.relative_to(ROOT)} anew")
    parser.add_argument("--only", default="", help="formats with this in their name")
    given = parser.parse_args()
    lines, worst = [], {"memory": 0.0, "seconds": 0.0, "disk": 0.0}
    for name, (file, make, sizes) in FORMATS.items():
        for rows in sizes if given.only in name else ():
            with tempfile.TemporaryDirectory() as made:
                folder = Path(made)
                car = subprocess.run(
                    [sys.executable, "-m", "tselab", "vehicle", "--example"],
                    cwd=ROOT / "scripts",
                    capture_output=True,
                )
                (folder / "car.toml").write_bytes(car.stdout)
                maker = multiprocessing.get_context("spawn").Process(target=make, args=(folder / file, rows))
                maker.start()  # the peak memory of a command includes that of its parent
                maker.join()
                size = (folder / file).stat().st_size
                if size > 10_000_000:
                    continue
                for command in ("estimate", "signals"):
                    began = time.monotonic()
                    arguments = [
                        command,
                        file,
                        "--vehicle",
                        "car.toml",
                        *(["--out", "o.csv"] if command == "estimate" else []),
                    ]
                    x = run_command(arguments, folder)
                    worst = {key: max(value, getattr(x, key)) for key, value in worst.items()}
                    end = x.said.replace(f"{file}: ", "")[:60] or "read"
                    took = f"{x.memory:.0f} | {x.seconds:.0f} | {x.disk:.0f} | {x.code}"
                    lines.append(f"| {name} | {size / 1e6:.2f} | {rows:,} | {command} | {took} | {end} |")
                    print(lines[-1], f"{time.monotonic() - began:.0f} s on the wall", flush=True)
    over = [f"{key} {value:.0f}" for key, value in worst.items() if value > MAX_TAKEN[key]]
    text = (
        "`python -m tests.fuzz.bombs --write`\n\n"
        "Files under 10 MB that are made to unpack to far more. `tselab estimate` and `tselab signals` "
        "read each\nfile. "
        f"Limits: {MAX_TAKEN['memory']} MB of memory, {MAX_TAKEN['seconds']:.0f} s of processor time, "
        f"{MAX_TAKEN['disk']} MB of disk. Largest values: "
        f"{worst['memory']:.0f} MB, {worst['seconds']:.0f} s, {worst['disk']:.0f} MB.\n\n"
        "| format | file size [MB] | rows stated in the file | command | memory [MB] | processor time [s] | "
        "disk [MB] | exit code | message, 60 characters |\n"
        "|---|---:|---:|---|---:|---:|---:|---:|---|\n" + "\n".join(lines) + "\n"
    )
    if given.write:
        RESULTS.write_text(text)
    print(f"over: {', '.join(over) or 'nothing'}")
    return 1 if over else 0


if __name__ == "__main__":
    sys.exit(main())
