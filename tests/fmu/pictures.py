"""Run the paper's study through both FMUs connected; write its picture and table.

    .venv/bin/python tests/fmu/pictures.py

The files, scripts/results/fmu.png and its table, have the same bytes every time.
"""

import numpy as np
import pandas as pd
from docsite.pictures import shrink_picture
from fmu_support import CHANNELS, ESTIMATOR, ROOT, VEHICLE, Instance, load_unit

from tse.estimation.verdict import NAMES
from tse.library.core import STIFFNESS
from tse.report.tables import format_markdown_table
from tselab.montecarlo.pictures import draw_demo

DURATION, STEP = 60.0, 0.01  # s
ROAD_CHANGE = (30.0, 0.7)  # s, level
START = 0.7  # of nominal


def run_study() -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Return estimates, truth and log of square waves in steering and torque, row by row.

    The estimate of a row is the estimator's output at the next communication point.
    """
    made = [f"estimate.{s}{end}" for s in STIFFNESS for end in ("", "_sd", "_valid")]
    true = ["true.vel_x", *(f"true.{s}" for s in STIFFNESS)]
    start = {f"filter.initial_{s}": START for s in STIFFNESS} | {
        "vehicle.exact": True
    }  # known, but for its tyres
    rows = []
    with Instance(load_unit(VEHICLE)) as car, Instance(load_unit(ESTIMATOR)) as estimator:
        car.start()
        estimator.start(start)
        for k in range(round(DURATION / STEP)):
            time = k * STEP
            was = car.get([*true, *(f"sensor.{c}" for c in CHANNELS)])
            estimator.set({c: was[f"sensor.{c}"] for c in CHANNELS})
            car.set({
                "steer_angle": 0.02 if k % 400 < 200 else -0.02,
                "wheel_torque_front": 700.0 if k % 500 < 250 else -700.0,
                "road_level": ROAD_CHANGE[1] if time + STEP > ROAD_CHANGE[0] else 1.0,
            })  # fmt: skip
            car.step(time, STEP)
            estimator.step(time, STEP)
            rows.append({"time": time, **was, **estimator.get(made)})
    table = pd.DataFrame(rows)
    est = table[["time", *made]].rename(columns=lambda name: name.removeprefix("estimate."))
    truth = table[true].rename(columns=lambda name: name.replace(".", "_"))
    truth["road_level"] = np.where(table["time"] > ROAD_CHANGE[0] - STEP / 2, ROAD_CHANGE[1], 1.0)
    return (
        est,
        truth,
        table[[f"sensor.{c}" for c in CHANNELS]].rename(columns=lambda name: name.removeprefix("sensor.")),
    )


def main() -> None:
    est, truth, log = run_study()
    picture = ROOT / "scripts" / "results" / "fmu.png"
    draw_demo(picture, est, truth, log)
    shrink_picture(picture)
    time, rows = est["time"], []
    for s in STIFFNESS:
        error = est[s] / truth[f"true_{s}"] - 1
        parts = (time >= 10) & (time < ROAD_CHANGE[0] - STEP / 2), time >= DURATION - 20
        rms = [f"{100 * np.sqrt((error[part] ** 2).mean()):.2f} %" for part in parts]
        rows.append([NAMES[s], *rms, f"{100 * est[f'{s}_valid'].mean():.0f} % of the time"])
    head = ["stiffness", "RMS error, from 10 s to the change of road", "RMS error, last 20 s", "valid"]
    print("\n".join(format_markdown_table(head, rows)))


if __name__ == "__main__":
    main()
