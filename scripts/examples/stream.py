"""Estimate row by row, as in a car: continue after a refused row, keep the learnt state.

python scripts/examples/stream.py
"""

from __future__ import annotations

from collections.abc import Iterator

import tse

CAR = {"mass": 1900, "lf": 1.25, "lr": 1.5, "wheel_radius_front": 0.33, "wheel_radius_rear": 0.33}


def read_rows() -> Iterator[dict[str, float]]:
    """Yield rows in SI units. In a car they come from a bus, here from a simulated drive.

    In a row, a missing value may be left out, None or NaN.
    """
    for i, row in enumerate(tse.simulate("double-lane-change", duration=20).log.to_dict("records")):
        if i == 500:
            row["steer_angle"] = 7.0  # a wrong value, as in a broken message
        if i % 50:
            yield {str(name): value for name, value in row.items()}
        else:
            # every 50th row has no accel_x, as if the bus had lost this message
            yield {str(name): value for name, value in row.items() if name != "accel_x"}


def main() -> tuple[tse.Estimate, bytes]:
    """Run the filter on the rows. Return its last estimate and the learnt state."""
    # tell the filter that a steering angle that comes at t was measured at t - 0.02 s
    car = tse.Filter(CAR, sample_time=0.01, settings={"steer_angle_latency": 0.02})
    print(f"latencies of the late channels [s]: { {c: s for c, s in car.latencies.items() if s} }")
    e, refused = None, 0
    for row in read_rows():
        try:
            e = car.step(row)
        except tse.InputError as error:  # the filter is unchanged: continue with the next row
            refused += 1
            print(f"row refused: {error}")
            continue
        if e.status == tse.Status.RECOVERED:
            print(f"{e.time:.2f} s: {e.status_text}")
    assert e is not None
    print(
        f"{e.time:.2f} s: the estimate refers to {e.estimate_age:.3f} s earlier: "
        f"cy_front {e.cy_front:.0f} +- {1.96 * e.cy_front_sd:.0f} N/rad, ",
        end="",
    )
    print("valid" if e.cy_front_valid else f"not valid: {e.cy_front_reason}", f"(rows refused: {refused})")

    learnt = car.save_learnt()  # 268 bytes, to be stored in a file or an ECU
    assert learnt is not None
    tomorrow = tse.Filter(CAR, sample_time=0.01)
    tomorrow.load_learnt(learnt, age=86400.0)
    first = tomorrow.step(next(read_rows()))
    print(f"tomorrow's first row: cy_front {first.cy_front:.0f} +- {1.96 * first.cy_front_sd:.0f} N/rad")
    return e, learnt


if __name__ == "__main__":
    main()
