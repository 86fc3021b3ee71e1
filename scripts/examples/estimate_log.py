"""A log becomes an estimate.

    python scripts/examples/estimate_log.py [LOG.csv CAR.toml]

Without files: a simulated drive of which the truth is known.
"""

from __future__ import annotations

import sys

import pandas as pd

import tse


def main(arguments: list[str]) -> tse.Result:
    truth = None
    if arguments:
        log, car = pd.read_csv(arguments[0]), arguments[1]
    else:
        # what a car's data sheet says; tyres are filled in by a rule, and result.notes says so
        car = {
            "mass": 1900,
            "lf": 1.25,
            "lr": 1.5,
            "yaw_inertia": 3000,
            "wheel_radius_front": 0.33,
            "wheel_radius_rear": 0.33,
        }
        log, truth = tse.simulate("square-waves", duration=30, road_changes=[(20.0, 0.7)])
    # known exactly: the intervals of a car that nobody has calibrated are wide, and little is valid
    exact = {} if arguments else {"uncertainty": dict.fromkeys(UNCERTAIN, 0.0)}
    result = tse.estimate(log, car if arguments else {**car, **exact})

    for line in result.words:  # as `tselab estimate` ends
        print(line)
    last = result.stiffness[-1], result.stiffness_sd[-1], result.valid[-1]
    for name, mean, sd, valid in zip(tse.STIFFNESS, *last, strict=True):
        print(f"{name}: {mean / 1e3:.1f} kN +- {1.96 * sd / 1e3:.1f}" + ("" if valid else "  (not valid)"))
    if truth is not None:
        error = result.table["cy_front"] / truth["true_cy_front"] - 1
        settled = result.table["cy_front_valid"] & (result.table["time"] > 25)
        print(f"cy_front, 5 s after the road has changed: within {100 * error[settled].abs().max():.1f} % of the truth")
    return result


UNCERTAIN = (
    "mass_sd", "yaw_inertia_sd", "cg_sd", "steer_ratio_sd", "steer_offset_sd", "accel_y_scale_sd", "wheel_delay_sd",
    "accel_delay_sd", "relaxation_sd", "lean_sd", "gyro_scale_sd", "trail_sd", "roll_steer_sd", "wheel_radius_sd", "model_sd",
    "grade_sd",
)  # fmt: skip

if __name__ == "__main__":
    main(sys.argv[1:])
