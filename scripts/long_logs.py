#!/usr/bin/env python3
"""The memory that tselab estimate takes for a very long log in each format, with report and estimates.

    .venv/bin/python scripts/long_logs.py [--hours 10] [--formats MF4 "MAT 7.3" ...]

writes scripts/results/long_logs.md; of formats that are not named the rows stay as they are. A log has four wheels at 50 Hz, the
steering wheel at 20 Hz, the inertial sensor at 100 Hz, each later than it was true. It is written in pieces into a temporary
folder, one format at a time: some minutes and up to 1 GB for ten hours.
"""

from __future__ import annotations

import argparse
import itertools
import os
import re
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests" / "lab")]
RESULT = ROOT / "scripts" / "results" / "long_logs.md"
TSELAB = [sys.executable, "-m", "tselab"]
ENV = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",
                    "PYTHONPATH": os.pathsep.join([str(ROOT / "scripts"), os.environ.get("PYTHONPATH", "")])}  # fmt: skip
PART = 600.0  # s of the drive that is repeated
EPOCH = 1.7e9  # s: clocks of buses and of ROS count from 1970

import log_formats as one  # noqa: E402  (the writers of short logs, in the tests)

Parts = list[one.Message]  # the drive as its three messages


def later(parts: Parts, seconds: float) -> Parts:
    return [one.Message(m.name, m.time + seconds, m.columns, m.units) for m in parts]


def mdf(version: str, name: str, **saving: int) -> Callable[[Path, Parts, int], Path]:
    """A group per message, to which records are added."""

    def write(folder: Path, parts: Parts, times: int) -> Path:
        one.mf4(folder, parts)  # for its signals.toml
        from asammdf import MDF, Signal

        path = folder / name
        with MDF(version=version) as file:
            for m in parts:
                file.append([Signal(x, m.time, unit=m.units[n], name=n) for n, x in m.columns.items()])
            for k in range(1, times):
                for group, m in enumerate(later(parts, PART * k)):
                    file.extend(group, [(m.time, None), *((x, None) for x in m.columns.values())])
            Path(file.save(path, overwrite=True, **saving))
        return path

    return write


def mf4_bus(folder: Path, parts: Parts, times: int) -> Path:
    """Frames of a bus: one group, to which records are added."""
    short = one.mf4_bus(folder, parts)
    from asammdf import MDF

    path = folder / "long.mf4"
    with MDF(short) as first, MDF(version="4.11") as file:
        frame = first.get("CAN_DataFrame", raw=True)
        file.append([frame], acq_source=frame.source)
        for k in range(1, times):
            file.extend(0, [(frame.timestamps + PART * k, None), (frame.samples, None)])
        file.save(path, overwrite=True)
    short.unlink()
    return path


def bus(name: str) -> Callable[[Path, Parts, int], Path]:
    def write(folder: Path, parts: Parts, times: int) -> Path:
        import can

        short = one.bus(folder, parts, name)
        short.unlink()
        frames = one.frames(parts)
        with can.Logger(str(folder / name)) as logger:
            for k, (t, identifier, extended, data) in itertools.product(range(times), frames):
                logger.on_message_received(can.Message(timestamp=EPOCH + PART * k + t, arbitration_id=identifier,
                                                       is_extended_id=extended, data=data, channel=1))  # fmt: skip
        return folder / name

    return write


def parquet(folder: Path, parts: Parts, times: int) -> Path:
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = one.parquet(folder, parts)
    with ExitStack() as stack:
        table = pa.Table.from_pandas(period(parts), preserve_index=False)
        file = stack.enter_context(pq.ParquetWriter(path, table.schema))
        for k in range(times):
            file.write_table(table.set_column(0, "t", pa.array(table["t"].to_numpy() + PART * k)))
    return path


def feather(folder: Path, parts: Parts, times: int) -> Path:
    """Version 2, compressed as pandas does it; dates for times."""
    import pyarrow as pa

    path = one.feather(folder, parts)
    frame = period(parts)
    start = pd.to_datetime("2024-05-01T08:00:00")
    with ExitStack() as stack:
        file = None
        for k in range(times):
            dates = start + pd.to_timedelta(frame.t + PART * k, unit="s")
            table = pa.Table.from_pandas(frame.assign(t=dates), preserve_index=False)
            if file is None:
                options = pa.ipc.IpcWriteOptions(compression="lz4")
                file = stack.enter_context(pa.ipc.new_file(str(path), table.schema, options=options))
            file.write_table(table, max_chunksize=1 << 16)
    return path


def german_csv(folder: Path, parts: Parts, times: int) -> Path:
    path = one.german_csv(folder, parts)
    head = path.read_bytes().split(b"\r\n")[:5]
    table = period(parts).ffill().dropna().to_numpy() * [1000.0, *[1.0] * 8]
    with open(path, "wb") as file:
        file.write(b"\r\n".join([*head, b""]))
        for k in range(times):
            rows = table + np.eye(1, 9) * 1000.0 * PART * k  # the time
            text = "\r\n".join([*(";".join(f"{x:.6f}" for x in row) for row in rows.tolist()), ""])
            file.write(text.replace(".", ",").encode("cp1252"))
    return path


def mat5(folder: Path, parts: Parts, times: int) -> Path:
    return one.mat5(folder, one.repeated(parts, times, PART))


def period(parts: Parts) -> pd.DataFrame:
    """All messages in one table, from one PART to the next: repeated, its times increase."""
    table = one.joined(one.repeated(parts, 2, PART))
    return table[(table.t >= PART - 1e-6) & (table.t < 2 * PART - 1e-6)].assign(t=lambda x: x.t - PART)


def mat73(folder: Path, parts: Parts, times: int) -> Path:
    """HDF5 in chunks that are compressed, as MATLAB does it."""
    import h5py

    path = one.mat73(folder, parts)
    with h5py.File(path, "w", userblock_size=512) as file:
        for m in parts:
            rows = len(m.time)
            for name, x in ({"time": m.time} | m.columns).items():
                made = file.create_dataset(
                    f"{m.name}/{name}",
                    (1, rows * times),
                    float,
                    chunks=(1, 8192),
                    compression="gzip",
                    compression_opts=3,
                )
                made.attrs["MATLAB_class"] = np.bytes_("double")
                for k in range(times):
                    made[0, rows * k : rows * (k + 1)] = x + (PART * k if name == "time" else 0.0)
    with open(path, "r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(116))
    return path


def messages(store: object, parts: Parts, ros1: bool, times: int) -> Iterator[tuple[str, str, int, bytes]]:
    """Topic, type, time in ns, bytes: those of one part, with the time in their header, which stands behind 4 bytes, put on."""
    found: list[tuple[str, str, float, bytearray]] = []

    def write(topic: str, kind: str, t: float, message: object) -> None:
        raw = store.serialize_ros1(message, kind) if ros1 else store.serialize_cdr(message, kind)  # type: ignore[attr-defined]
        found.append((topic, kind, t, bytearray(raw)))

    one._ros(store, parts, write)
    for k, (topic, kind, t, raw) in itertools.product(range(times), found):
        seconds, nano = struct.unpack_from("<II", raw, 4)
        again = bytearray(raw)
        struct.pack_into("<II", again, 4, seconds + round(PART) * k, nano)
        yield topic, kind, round(1e9 * t) + round(PART) * k * 10**9, bytes(again)


def rosbag(ros1: bool) -> Callable[[Path, Parts, int], Path]:
    def write(folder: Path, parts: Parts, times: int) -> Path:
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import Writer as Writer2

        store, opened = one._store(ros1), {}
        path = folder / ("drive.bag" if ros1 else "bag")
        with Writer1(path) if ros1 else Writer2(path, version=9) as writer:
            for topic, kind, t, raw in messages(store, parts, ros1, times):
                if topic not in opened:
                    opened[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(opened[topic], t, raw)
        one._ros_signals(folder)
        return path

    return write


def mcap(folder: Path, parts: Parts, times: int) -> Path:
    from mcap.writer import Writer

    store, path, opened = one._store(), folder / "drive.mcap", {}
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="tse")
        for topic, kind, t, raw in messages(store, parts, False, times):
            if topic not in opened:
                text, _ = store.generate_msgdef(kind, ros_version=2)
                opened[topic] = writer.register_channel(
                    topic, "cdr", writer.register_schema(kind, "ros2msg", text.encode())
                )
            writer.add_message(opened[topic], log_time=t, publish_time=t, data=raw)
        writer.finish()
    one._ros_signals(folder)
    return path


FORMATS: dict[str, Callable[[Path, Parts, int], Path]] = {
    "MF4": mdf("4.10", "drive.mf4"),
    "MF4, compressed": mdf("4.10", "drive.mf4", compression=2),
    "MDF 3": mdf("3.30", "drive.mdf"),
    "Parquet": parquet,
    "Feather": feather,
    "MAT 7.3": mat73,
    "MAT 5": mat5,
    "BLF and DBC": bus("drive.blf"),
    "MCAP, ROS 2": mcap,
    "MF4, frames and DBC": mf4_bus,
    "ROS 2 bag": rosbag(ros1=False),
    "ROS 1 bag": rosbag(ros1=True),
    "ASC and DBC": bus("drive.asc"),
    "TRC and DBC": bus("drive.trc"),
    "German CSV": german_csv,
}


def size(path: Path) -> float:
    """MB of a file or of those in a folder."""
    return sum(p.stat().st_size for p in ([path] if path.is_file() else path.rglob("*"))) / 1e6


def measured(folder: Path, log: Path, car: Path) -> tuple[float, float, int]:
    """Greatest memory in MB of 2**20 bytes, processor seconds, rows of the estimates."""
    words = [*TSELAB, "estimate", log, "--vehicle", car, "--out", folder / "e.parquet", "--report", folder / "r.html"]
    done = subprocess.run(
        [sys.executable, "-c", "import resource, subprocess, sys; c = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL)"
         ".returncode; u = resource.getrusage(resource.RUSAGE_CHILDREN); print(c, u.ru_maxrss, u.ru_utime + u.ru_stime)",
         *map(str, words)], env=ENV, capture_output=True, text=True, check=True,
    )  # fmt: skip
    code, memory, busy = done.stdout.split()
    if int(code) not in (0, 3):
        raise SystemExit(f"{log.name}: exit code {code}\n{done.stderr}")
    import pyarrow.parquet as pq

    unit = 2**20 if sys.platform == "darwin" else 2**10
    return float(memory) / unit, float(busy), pq.read_metadata(folder / "e.parquet").num_rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=10.0)
    parser.add_argument("--formats", nargs="+", choices=list(FORMATS), default=list(FORMATS), metavar="NAME")
    asked = parser.parse_args()
    times = max(1, round(3600 * asked.hours / PART))
    command = f"scripts/long_logs.py --hours {asked.hours:g}"
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
                log = FORMATS[name](Path(own), parts, times)
                written = time.monotonic() - begin
                memory, busy, count = measured(Path(own), log, car)
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
