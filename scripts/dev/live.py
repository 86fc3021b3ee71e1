#!/usr/bin/env python3
"""How well `tselab live` keeps up, and whether it says what `tselab estimate` says of the same drive.

    [chrt -r 10] .venv/bin/python scripts/dev/live.py [--seconds 60]

writes scripts/results/live.md. A process sends the frames of a simulated drive in real time over UDP multicast: three messages
each 10 ms, wheels, steering wheel, inertial sensor. The command reads them, in a process of its own; then `tselab estimate` reads
its record, and the drive as a file that was there before."""

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
PRIORITY = {0: "usual", 1: "real-time", 2: "real-time"}
NAMES = {"cy_front": "front, in bends", "cy_rear": "rear, in bends", "cx_front": "front, along"}

import can  # noqa: E402
import pandas as pd  # noqa: E402
from measured import ENV, TSELAB  # noqa: E402

import log_formats as one  # noqa: E402  (the writers of short logs, in the tests)
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


def drive(car: Path, seconds: float) -> list[tuple[float, int, bytes]]:
    """Time, identifier and bytes of each frame."""
    clean = one.drive(car, seconds)
    table = clean[["time", "steer_angle", "accel_x", "accel_y", "yaw_rate"]].copy()
    for axle, letter in (("front", "f"), ("rear", "r")):
        for side, sign in (("l", -1), ("r", 1)):
            table[letter + side] = (
                clean[f"wheel_speed_{axle}"] * one.RADIUS[axle] + sign * 0.5 * one.TRACK * clean.yaw_rate
            )
    return trade.frames(table)


def send(path: Path, delay: float) -> None:
    """Send the frames of a log of candump at its times, `delay` s from now."""
    lines = [line.split() for line in path.read_text().splitlines()]
    frames = [(float(t[1:-1]) - trade.EPOCH, *f.split("#")) for t, _, f in lines]
    with can.Bus(interface="udp_multicast", channel=GROUP, port=PORT) as bus:
        begin = time.monotonic() + delay
        for t, i, d in frames:
            if (wait := begin + t - time.monotonic()) > 0:
                time.sleep(wait)
            bus.send(can.Message(arbitration_id=int(i, 16), data=bytes.fromhex(d), is_extended_id=False))


def estimated(log: Path, car: Path, *more: object) -> pd.DataFrame:
    """Estimates of a log by the command."""
    out = log.with_suffix(".again.csv")
    words = [*TSELAB, "estimate", log, "--vehicle", car, "--no-calibrate", "--out", out, *more]
    subprocess.run(
        [str(w) for w in words], check=False, env=ENV, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    return pd.read_csv(out)


def main() -> None:
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
        car = folder / "car.toml"
        car.write_text(
            subprocess.run(
                [*TSELAB, "vehicle", "--simulated"], check=True, env=ENV, capture_output=True, text=True
            ).stdout
        )
        log = trade.write_candump(folder / "drive.log", drive(car, asked.seconds))
        (folder / "signals.toml").write_text(SIGNALS)
        load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
        sender = subprocess.Popen([sys.executable, __file__, "--send", str(log)], env=ENV)
        out = folder / "out"
        done = subprocess.run(
            [*TSELAB, "live", "--interface", "udp_multicast", "--channel", GROUP, "--bus", f"port={PORT}", "--database",
             str(folder / "car.dbc"), "--vehicle", str(car), "--out", str(out), "--duration", str(asked.seconds + 9.0)],
            check=False, env=ENV, capture_output=True, text=True)  # fmt: skip
        sender.wait()
        found = re.search(r"(\d+) frames, (\d+) rows, (\d+) a second; from a frame to the estimate (\d+) ms, "
                          r"of 99 % of the rows at most (\d+) ms, longest (\d+) ms", done.stderr)  # fmt: skip
        if found is None:
            sys.exit(done.stdout + done.stderr)
        mine = pd.read_csv(out / "rows.est.csv")
        same = estimated(out / "rows.csv", car, "--config", out / "filter.toml")
        bits = (out / "rows.est.csv").read_bytes() == (out / "rows.again.csv").read_bytes()
        frames, file = estimated(out / "frames.blf", car), estimated(log, car)
    agree = "the same bits" if bits and len(same) == len(mine) else "OTHER BITS"
    lines = [
        f"<!-- Written by `scripts/dev/live.py --seconds {asked.seconds:g}`. -->\n",
        f"A simulated drive of {asked.seconds:g} s, {found[1]} frames in three messages each 10 ms, sent by another process "
        "over UDP multicast in real time; `tselab live` in a process of its own; "
        f"{PRIORITY[os.sched_getscheduler(0)] if hasattr(os, 'sched_getscheduler') else 'usual'} priority; the machine has "
        f"{os.cpu_count()} cores and {load:.0f} processes wanted to run besides.\n",
        "| | |\n|---|---:|",
        f"| rows a second | {found[3]} |",
        f"| from a frame to the estimate with it, median | {found[4]} ms |",
        f"| 99 % of the rows | {found[5]} ms |",
        f"| longest | {found[6]} ms |",
        f"| rows of the record through `tselab estimate` | {agree} |\n",
        "Stiffness at the end with its standard deviation, kN/rad or kN. The frames of the record have the stamps of the "
        "machine, the file those of the drive.\n",
        "| stiffness | live | its frames, through `tselab estimate` | the file of the drive |\n|---|---:|---:|---:|",
    ]
    for s, name in NAMES.items():
        cells = [
            f"{t[s].iloc[-1] / 1e3:.2f} ± {t[f'{s}_sd'].iloc[-1] / 1e3:.2f}" for t in (mine, frames, file)
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    RESULT.write_text("\n".join([*lines, ""]))
    print(RESULT.read_text())


if __name__ == "__main__":
    main()
