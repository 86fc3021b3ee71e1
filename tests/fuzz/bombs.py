"""Files that are made to fill a machine, through the commands: python -m tests.fuzz.bombs [--write] [--only TEXT].

Each is under 10 MB and unpacks to far more: constant signals and times that count up, which compress to nearly nothing. Of each
format one with twenty million rows, and one with as many as any log may have (ALWAYS_ALLOWED_ROWS),
which is read; of text, which is not compressed, what 10 MB hold. What a command takes is
that of its process: the memory that was resident, seconds of its processors, and what lay in its folder for temporary files.
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
MOST = {"memory": 1024, "seconds": 60.0, "disk": 2048}  # MB, s, MB
LIMIT = 240  # s on the wall: the machine may be shared


def columns(rows: int) -> dict[str, np.ndarray]:
    return {n: np.full(rows, 30.0 if n.startswith("wheel") else 0.0) for n in NAMES}


def parquet(path: Path, rows: int) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({"time": np.arange(rows) * 10, **columns(rows)})  # ms, which its values say
    pq.write_table(
        table,
        path,
        compression="zstd",
        use_dictionary=list(NAMES),
        column_encoding={"time": "DELTA_BINARY_PACKED"},
    )


def mat73(path: Path, rows: int) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, value in {"time": np.arange(rows) * 0.01, **columns(rows)}.items():
            file.create_dataset(name, data=value, compression="gzip", compression_opts=9, shuffle=True)


def mat5(path: Path, rows: int, names: tuple[str, ...] = ("time", *NAMES)) -> None:
    """Variables of zeros, as the format has them (MATLAB, MAT-File Format, 2019): without ever being in memory."""
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


def mf4(path: Path, rows: int) -> None:
    from asammdf import MDF, Signal

    clock = np.arange(rows) * 0.01
    with MDF() as mdf:
        mdf.append([Signal(value, clock, name=name) for name, value in columns(rows).items()])
        mdf.save(path, compression=2, overwrite=True)


def blf(path: Path, rows: int) -> None:
    """Containers of frames that are all the same."""
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


def csv(path: Path, rows: int) -> None:
    path.write_text(
        "time,steer_angle,wheel_speed_front,wheel_speed_rear,accel_x,accel_y,yaw_rate\n" + ",,,,,,\n" * rows
    )


def gaps(path: Path, rows: int) -> None:
    """Values that are a second apart: at 100 Hz a hundred times as many rows."""
    lines = [f"{k};0;30;30;0;0;0" for k in range(rows)]
    path.write_text(
        "time;steer_angle;wheel_speed_front;wheel_speed_rear;accel_x;accel_y;yaw_rate\n"
        + "\n".join(lines)
        + "\n"
    )


FORMATS: dict[str, tuple[str, Callable[[Path, int], None], tuple[int, ...]]] = {
    "Parquet": ("log.parquet", parquet, (MANY, ALLOWED)), "MAT 7.3": ("log.mat", mat73, (MANY, ALLOWED)),
    "MAT 5": ("log5.mat", mat5, (MANY, ALLOWED)), "MF4": ("log.mf4", mf4, (MANY, ALLOWED)),
    "BLF": ("log.blf", blf, (MANY, ALLOWED)), "CSV of nothing": ("blank.csv", csv, (1_400_000,)),
    "CSV of 1 Hz": ("slow.csv", gaps, (400_000, 14_000)),
}  # fmt: skip


@dataclass
class Taken:
    code: int
    seconds: float
    memory: float
    disk: float
    said: str


def run(arguments: list[str], folder: Path) -> Taken:
    """One command, held to LIMIT."""
    scratch = folder / "tmp"
    scratch.mkdir(exist_ok=True)
    process = subprocess.Popen(
        [sys.executable, "-m", "tselab", *arguments], cwd=folder, stdout=subprocess.DEVNULL, stderr=(folder / "said").open("w"),
        env={**os.environ, "TMPDIR": str(scratch), "PYTHONPATH": str(ROOT / "scripts"), "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
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
                maker.start()  # what a command takes begins with what its parent has
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
                    x = run(arguments, folder)
                    worst = {key: max(value, getattr(x, key)) for key, value in worst.items()}
                    end = x.said.replace(f"{file}: ", "")[:60] or "read"
                    took = f"{x.memory:.0f} | {x.seconds:.0f} | {x.disk:.0f} | {x.code}"
                    lines.append(f"| {name} | {size / 1e6:.2f} | {rows:,} | {command} | {took} | {end} |")
                    print(lines[-1], f"{time.monotonic() - began:.0f} s on the wall", flush=True)
    over = [f"{key} {value:.0f}" for key, value in worst.items() if value > MOST[key]]
    text = (
        "`python -m tests.fuzz.bombs --write`: files under 10 MB that unpack to far more, made for this, through two commands.\n"
        f"Allowed: {MOST['memory']} MB of memory, {MOST['seconds']:.0f} s of a processor, {MOST['disk']} MB of disk. Largest: "
        f"{worst['memory']:.0f} MB, {worst['seconds']:.0f} s, {worst['disk']:.0f} MB.\n\n"
        "| format | file [MB] | rows that it says | command | memory [MB] | processor [s] | disk [MB] | exit code | said |\n"
        "|---|---:|---:|---|---:|---:|---:|---:|---|\n" + "\n".join(lines) + "\n"
    )
    if given.write:
        RESULTS.write_text(text)
    print(f"over: {', '.join(over) or 'nothing'}")
    return 1 if over else 0


if __name__ == "__main__":
    sys.exit(main())
