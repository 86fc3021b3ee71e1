"""Rows that come one at a time: a filter that runs with the car, goes on after a stop, and keeps what it has learnt.

python scripts/examples/stream.py
"""

from __future__ import annotations

from collections.abc import Iterator

import tse

CAR = {"mass": 1900, "lf": 1.25, "lr": 1.5, "wheel_radius_front": 0.33, "wheel_radius_rear": 0.33}


def rows() -> Iterator[dict[str, float]]:
    """Stands for a bus: here a simulated drive. SI units; what is missing may be left out, None or NaN."""
    for i, row in enumerate(tse.simulate("double-lane-change", duration=20).log.to_dict("records")):
        if i == 500:
            row["steer_angle"] = 7.0  # a broken message
        if i % 50:
            yield {str(name): value for name, value in row.items()}
        else:
            yield {
                str(name): value for name, value in row.items() if name != "accel_x"
            }  # a channel that is slower


def main() -> tuple[tse.Estimate, bytes]:
    car = tse.Filter(CAR, sample_time=0.01, settings={"steer_angle_latency": 0.02})  # known to be 20 ms late
    print(f"late channels: { {c: s for c, s in car.latencies.items() if s} } s")
    e, refused = None, 0
    for row in rows():
        try:
            e = car.step(row)
        except tse.InputError as error:  # the filter is as it was; the next row may come
            refused += 1
            print(f"row refused: {error}")
            continue
        if e.status == tse.Status.RECOVERED:
            print(f"{e.time:.2f} s: {e.status_text}")
    assert e is not None
    print(
        f"{e.time:.2f} s, of {e.estimate_age:.3f} s before: cy_front {e.cy_front:.0f} +- {1.96 * e.cy_front_sd:.0f} N/rad, ",
        end="",
    )
    print("valid" if e.cy_front_valid else f"not valid: {e.cy_front_reason}", f"({refused} row refused)")

    learnt = car.save_learnt()  # 268 bytes, for a file or an ECU
    assert learnt is not None
    tomorrow = tse.Filter(CAR, sample_time=0.01)
    tomorrow.load_learnt(learnt, age=86400.0)
    first = tomorrow.step(next(rows()))
    print(f"tomorrow's first row: cy_front {first.cy_front:.0f} +- {1.96 * first.cy_front_sd:.0f} N/rad")
    return e, learnt


if __name__ == "__main__":
    main()
