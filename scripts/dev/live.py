#!/usr/bin/env python3
"""Measure the delay from a CAN frame to its estimate in `tselab live`, and compare the
estimates of `tselab live` with those of `tselab estimate`.

    [chrt -r 10] .venv/bin/python scripts/dev/live.py [--seconds 60]

With `chrt -r 10`, all processes run with real-time priority. Writes
scripts/results/live.md. One process sends the CAN frames of a simulated drive over
UDP multicast in real time: every 10 ms three messages, for wheels, steering wheel and
inertial sensor. A second process, `tselab live`, reads the frames, estimates, and records
frames and rows. Afterwards `tselab estimate` reads the recorded rows, the recorded frames
and the original log of the drive."""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "tests" / "lab")]
RESULT = ROOT / "scripts" / "results" / "live.md"
GROUP, PORT = "239.74.163.2", 43113
PRIORITY = {0: "usual", 1: "real-time", 2: "real-time"}  # keys: SCHED_OTHER, SCHED_FIFO, SCHED_RR of Linux
NAMES = {"cy_front": "front, in bends", "cy_rear": "rear, in bends", "cx_front": "front, along"}

import can  # noqa: E402
import pandas as pd  # noqa: E402
from measured import ENV, TSELAB  # noqa: E402

import log_formats as formats  # noqa: E402  (functions of tests/lab that write logs)
import trade_files as trade  # noqa: E402

SIGNALS = """
[signals.steer_angle]
name = "SteeringWheelAngle"
ratio = 15.3
[signals.wheel_speed_front]
name = ["WheelSpeedFL", "WheelSpeedFR"]
[signals.wheel_speed_rear]
name = ["WheelSpeedRL", "WheelSpeedRR"]
[signals.yaw_rate]
name = "YawRate"
[signals.accel_x]
name = "LongitudinalAcceleration"
[signals.accel_y]
name = "LateralAcceleration"
"""


def make_frames(car: Path, seconds: float) -> list[tuple[float, int, bytes]]:
    """Simulate a drive, and encode its signals as CAN frames.

    `car`: vehicle file. `seconds`: duration of the drive. Return for each frame: time
    since the start of the drive [s], CAN identifier, data bytes."""
    clean = formats.make_drive(car, seconds)
    table = clean[["time", "steer_angle", "accel_x", "accel_y", "yaw_rate"]].copy()
    for axle, letter in (("front", "f"), ("rear", "r")):
        for side, sign in (("l", -1), ("r", 1)):
            turn = sign * 0.5 * formats.TRACK * clean.yaw_rate
            table[letter + side] = clean[f"wheel_speed_{axle}"] * formats.RADIUS[axle] + turn
    return trade.encode_frames(table)


def send(path: Path, delay: float) -> None:
    """Send the frames of a candump log at the rate at which they were logged.

    `delay` [s]: time from this call to the start of the logged drive."""
    lines = [line.split() for line in path.read_text().splitlines()]
    frames = [(float(t[1:-1]) - trade.EPOCH, *f.split("#")) for t, _, f in lines]
    with can.Bus(interface="udp_multicast", channel=GROUP, port=PORT) as bus:
        begin = time.monotonic() + delay
        for t, i, d in frames:
            if (wait := begin + t - time.monotonic()) > 0:
                time.sleep(wait)
            bus.send(can.Message(arbitration_id=int(i, 16), data=bytes.fromhex(d), is_extended_id=False))


def estimate_by_command(log: Path, car: Path, *more: object) -> pd.DataFrame:
    """Run `tselab estimate` on a log, with the options `more`. Return the estimates."""
    out = log.with_suffix(".again.csv")
    words = [*TSELAB, "estimate", log, "--vehicle", car, "--no-calibrate", "--out", out, *more]
    subprocess.run(
        [str(w) for w in words], check=False, env=ENV, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    return pd.read_csv(out)


def run_live(folder: Path, car: Path, log: Path, seconds: float) -> re.Match[str]:
    """Run `tselab live` while a second process sends the frames of a log.

    `tselab live` ends with a summary. Return its numbers as groups 1 .. 6 of a match:
    frames; rows; rows per second; median, 99 % quantile and maximum of the delay from a
    frame to its estimate [ms]."""
    sender = subprocess.Popen([sys.executable, __file__, "--send", str(log)], env=ENV)
    words = [*TSELAB, "live", "--interface", "udp_multicast", "--channel", GROUP, "--bus", f"port={PORT}"]
    words += ["--database", str(folder / "car.dbc"), "--vehicle", str(car)]
    words += ["--out", str(folder / "out"), "--duration", str(seconds + 9.0)]
    done = subprocess.run(words, check=False, env=ENV, capture_output=True, text=True)
    sender.wait()
    found = re.search(
        r"(\d+) frames, (\d+) rows, (\d+) rows per second; delay from a frame to its estimate: "
        r"median (\d+) ms, for 99 % of the rows at most (\d+) ms, max (\d+) ms",
        done.stderr,
    )
    if found is None:
        sys.exit(done.stdout + done.stderr)
    return found


def describe_priority() -> str:
    """Return "real-time" if this process runs under SCHED_FIFO or SCHED_RR, else "usual".

    On a system that does not tell the policy, such as Windows, return "usual"."""
    return PRIORITY.get(os.sched_getscheduler(0), "usual") if hasattr(os, "sched_getscheduler") else "usual"


def main() -> None:
    """Measure the delay of `tselab live`, compare its estimates with those of `tselab
    estimate`, and write scripts/results/live.md."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--send", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.send:
        send(asked.send, 5.0)
        return
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        car, out = folder / "car.toml", folder / "out"
        example = subprocess.run(
            [*TSELAB, "vehicle", "--simulated"], check=True, env=ENV, capture_output=True, text=True
        )
        car.write_text(example.stdout)
        log = trade.write_candump(folder / "drive.log", make_frames(car, asked.seconds))
        (folder / "signals.toml").write_text(SIGNALS)
        load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
        found = run_live(folder, car, log, asked.seconds)
        live = pd.read_csv(out / "rows.est.csv")
        again = estimate_by_command(out / "rows.csv", car, "--config", out / "filter.toml")
        is_same = (out / "rows.est.csv").read_bytes() == (out / "rows.again.csv").read_bytes()
        frames, file = estimate_by_command(out / "frames.blf", car), estimate_by_command(log, car)
    agree = "the same bits" if is_same and len(again) == len(live) else "OTHER BITS"
    lines = [
        f"<!-- Written by `scripts/dev/live.py --seconds {asked.seconds:g}`. -->\n",
        f"A simulated drive of {asked.seconds:g} s, {found[1]} frames in three messages each 10 ms, "
        "sent by one process over UDP multicast in real time and read by a second one, `tselab live`; "
        f"{describe_priority()} priority; the machine has {os.cpu_count()} cores, and its load before was "
        f"{load:.0f} processes.\n",
        "| quantity | value |\n|---|---:|",
        f"| rows per second | {found[3]} |",
        f"| delay from a frame to its estimate, median | {found[4]} ms |",
        f"| delay, 99 % of the rows at most | {found[5]} ms |",
        f"| delay, longest | {found[6]} ms |",
        f"| estimates of `tselab estimate` from the recorded rows | {agree} |\n",
        "Stiffness at the end with its standard deviation, kN/rad or kN. Time stamps of the recorded frames "
        "are from this machine, those of the file from the simulation.\n",
        "| stiffness | `tselab live` | `tselab estimate`, recorded frames | `tselab estimate`, file of the "
        "drive |\n"
        "|---|---:|---:|---:|",
    ]
    for s, name in NAMES.items():
        cells = [
            f"{t[s].iloc[-1] / 1e3:.2f} ± {t[f'{s}_sd'].iloc[-1] / 1e3:.2f}" for t in (live, frames, file)
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    RESULT.write_text("\n".join([*lines, ""]))
    print(RESULT.read_text())


if __name__ == "__main__":
    main()
