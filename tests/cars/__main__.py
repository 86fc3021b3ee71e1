"""Write logs of ordinary cars, from the root of the repository.

python -m tests.cars --road mountain --minutes 10 --cars 5 --seed 1 --out DIR
"""

import argparse
import math
from pathlib import Path

from .logs import make_logs
from .road import ROADS, SCENARIOS


def main() -> None:
    """Parse the command line and write the logs."""
    p = argparse.ArgumentParser(prog="python -m tests.cars", description=__doc__)
    p.add_argument("--road", action="append", choices=ROADS, help="may be repeated; default: all three")
    p.add_argument("--minutes", type=float, default=10.0)
    p.add_argument("--cars", type=int, default=5)
    p.add_argument("--seed", type=int, default=1)
    p.add_argument(
        "--scenario",
        choices=SCENARIOS,
        default="dry",
        help="; ".join(f"{k}: {v}" for k, v in SCENARIOS.items()).replace("%", "%%"),
    )
    p.add_argument(
        "--event-time",
        type=float,
        help="s, from when on the scenario may begin; default: drawn from the middle",
    )
    p.add_argument("--no-hills", action="store_true", help="no slope, no crossfall, no superelevation")
    p.add_argument("--grade", type=float, help="rms of the slope in %%; default: drawn per car")
    p.add_argument("--even", action="store_true", help="no unevenness of the road")
    p.add_argument(
        "--clean",
        action="store_true",
        help="sensors without noise, bias, steps and mounting; their latencies stay",
    )
    p.add_argument("--mass-error", type=float, default=0.0, help="of the vehicle file, relative")
    p.add_argument("--cg-error", type=float, default=0.0, help="of the vehicle file, m")
    p.add_argument("--tell-inertia", action="store_true", help="the vehicle file has the yaw inertia")
    p.add_argument("--pedals", action="store_true", help="with brake switch and wheel torques")
    p.add_argument("--out", type=Path, required=True)
    a = p.parse_args()
    for road in a.road or ROADS:
        logs = make_logs(
            road,
            a.minutes,
            a.cars,
            a.seed,
            a.scenario,
            hills=not a.no_hills,
            even=a.even,
            event_time=a.event_time,
            grade_rms=None if a.grade is None else math.atan(a.grade / 100),
            mass_error=a.mass_error,
            cg_error=a.cg_error,
            tell_inertia=a.tell_inertia,
            clean=a.clean,
            pedals=a.pedals,
        )
        for i, log in enumerate(logs):
            log.write(a.out / f"car_{i}", road)
            print(a.out / f"car_{i}" / f"log_{road}.csv")


if __name__ == "__main__":
    main()
