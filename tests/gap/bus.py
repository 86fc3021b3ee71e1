"""Compare the names that gap finds in clean CSV logs and in the same logs of a bus.

    python -m tests.gap.bus [--clean N] [--hidden N] [--first SEED] [--jobs N]
        [--out FILE]

From the root of the repository; some minutes. Cars of the generator, with and without a
hidden effect. The bus is an MF4 with a group for each message: IMU at 100 Hz, wheels at
50 Hz, steering at 33 Hz. Each is later than in the clean log, and is quantised.
signals.toml has no latencies: the workflow has to find them. The table goes to
scripts/results/gap-bus.md.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from tests.gap.runs import run_in_processes
from tests.gap.study import format_interval

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "scripts" / "results" / "gap-bus.md"
FIRST, CLEAN, HIDDEN = 8001, 10, 10
MESSAGES = {  # rows per entry, s, columns
    "steer": (3, 0.012, ("steer_angle",)),
    "wheels": (2, 0.02, ("wheel_speed_front", "wheel_speed_rear")),
    "imu": (1, 0.005, ("accel_x", "accel_y", "yaw_rate")),
}
# rad, rad/s, m/s2, rad/s: 0.1 deg of a steering wheel of ratio 16; 0.03 km/h of a wheel
# of 0.33 m; 0.01 m/s2; 0.01 deg/s
STEP = {
    "steer_angle": 1.1e-4,
    "wheel_speed_front": 0.025,
    "wheel_speed_rear": 0.025,
    "accel_x": 0.01,
    "accel_y": 0.01,
    "yaw_rate": 1.75e-4,
}
SHOWN = (
    "body_roll",
    "relaxation",
    "steering_ratio",
    "cg_shift",
    "gyro_scale",
    "imu_scale_ay",
    "lateral_load_transfer",
    "tyre_saturation",
    "imu_lever_arm",
    "rear_roll_steer",
)


def write_bus_log(csv: Path, path: Path) -> None:
    """Write a log as a bus has it."""
    from asammdf import MDF, Signal

    clean = pd.read_csv(csv)
    with MDF(version="4.10") as mdf:
        for name, (every, late, columns) in MESSAGES.items():
            time = clean.time.to_numpy()[::every] + late
            signals = [
                Signal(STEP[c] * np.round(clean[c].to_numpy()[::every] / STEP[c]), time, name=c)
                for c in columns
            ]
            mdf.append(signals, acq_name=name)
        mdf.save(path, overwrite=True)


def run(asked: tuple[int, str]) -> dict:
    """Run a car both ways; return the names of the car and of the sensors."""
    from tests.gap.generator import Spec, make_cases
    from tse.gaps.run.workflow import run_workflow as gap

    seed, hidden = asked
    case = next(make_cases([Spec(hidden or "clean", {hidden: 1.0} if hidden else {}, seed)]))
    found = {"seed": seed, "hidden": hidden}
    with tempfile.TemporaryDirectory() as name:
        folder = case.write(Path(name) / "case")
        for path in sorted(folder.glob("*.csv")):
            write_bus_log(path, path.with_suffix(".mf4"))
        for kind in ("csv", "mf4"):
            logs, held = (sorted(folder.glob(f"{part}_*.{kind}")) for part in ("log", "hold_out"))
            verdict = gap(logs, folder / "car.toml", held).as_json()
            names = {e["id"] for e in verdict["effects"]}
            alike = {a for e in verdict["effects"] for a in e["look_alikes"]}
            found[kind] = {
                "names": sorted(names),
                "alike": sorted(alike),
                "sensors": sorted(s["id"] for s in verdict["sensors"]),
            }
    return found


def is_same(case: dict) -> bool:
    """Return whether the names of the car are the same, or admitted look-alikes."""
    a, b = case["csv"], case["mf4"]
    return set(a["names"]) <= {*b["names"], *b["alike"]} and set(b["names"]) <= {*a["names"], *a["alike"]}


def make_table(cases: list[dict]) -> str:
    """Return the results of cases as Markdown."""
    lines = [
        "| hidden effect | seed | named, clean CSV | effects of the car named, bus | "
        "errors of the sensors named, bus |",
        "|---|---:|---|---|---|",
    ]
    for c in cases:
        cells = (", ".join(x) or "-" for x in (c["csv"]["names"], c["mf4"]["names"], c["mf4"]["sensors"]))
        lines.append(f"| {c['hidden'] or '-'} | {c['seed']} | " + " | ".join(cells) + " |")
    clean, hidden = ([c for c in cases if bool(c["hidden"]) is kind] for kind in (False, True))
    quiet, alike = sum(not c["mf4"]["names"] for c in clean), sum(map(is_same, cases))
    found = sum(c["hidden"] in c["mf4"]["names"] for c in hidden)
    more = sum(len(set(c["mf4"]["names"]) - {c["hidden"]}) for c in hidden)
    lines.append(
        f"\nLogs of a bus: no effect of the car is named for {quiet} of {len(clean)} cars without a hidden "
        f"effect (95 %: {format_interval(quiet, len(clean))}). {found} of {len(hidden)} hidden effects are "
        f"named, with {more} further names. The names are those from the clean log, or look like them, for "
        f"{alike} of {len(cases)} cars ({format_interval(alike, len(cases))})."
    )
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.gap.bus", description=__doc__.split("\n")[0])
    parser.add_argument("--clean", type=int, default=CLEAN, metavar="N", help="cars that hide nothing")
    parser.add_argument("--hidden", type=int, default=HIDDEN, metavar="N", help="cars with one effect")
    parser.add_argument("--first", type=int, default=FIRST, metavar="SEED")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, help=f"default, of all cases: {TABLE.relative_to(ROOT)}")
    options = parser.parse_args()
    effects = [""] * options.clean + [SHOWN[k % len(SHOWN)] for k in range(options.hidden)]
    cases = run_in_processes(
        run, [(options.first + k, e) for k, e in enumerate(effects)], options.jobs, "car"
    )
    if cases is None:
        return 130
    text = make_table(cases)
    print(text)
    whole = (options.clean, options.hidden, options.first) == (CLEAN, HIDDEN, FIRST)
    if options.out or whole:
        (options.out or TABLE).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
