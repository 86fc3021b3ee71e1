"""A log with a mistake is never valid and silent; scripts/results/mistakes.md has all front ends, and HEAVY tests try them all."""

import pytest

from tests.mistakes.drives import MISTAKES, Drive, drives
from tests.mistakes.front_ends import FRONT_ENDS

ROWS = ("C", "Python")  # of rows, and of a whole log


@pytest.fixture(scope="module")
def both() -> list[Drive]:
    return drives()


@pytest.mark.parametrize("front_end", ROWS)
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_never_valid_and_silent(mistake: str, front_end: str, both: list[Drive]) -> None:
    for drive in both:
        assert not FRONT_ENDS[front_end](drive, MISTAKES[mistake](drive)).silent, drive.name


@pytest.mark.parametrize("front_end", ROWS)
def test_nothing_is_said_against_a_log_without_one(front_end: str, both: list[Drive]) -> None:
    for drive in both:
        said = FRONT_ENDS[front_end](drive, drive.log)
        assert not said.against.any() and said.words == (), drive.name
        assert said.silent == drive.known  # the car that is known exactly is valid: the mistakes above are not missed by default


@pytest.mark.parametrize(
    ("mistake", "channel", "factor"),
    [
        ("yaw rate in deg/s", "yaw_rate", None),
        ("lateral acceleration in g", "accel_y", 0.102),
        ("km/h taken for m/s", "wheel_speed_front", 3.6),
        ("km/h taken for rad/s", "wheel_speed_front", 1.18),
        ("axles exchanged", "wheel_speed_front", 0.0),
        ("sign of yaw rate", "yaw_rate", -1.0),
        ("angle of the steering wheel", "steer_angle", 15.5),
        ("wheel speeds in m/s", "wheel_speed_front", 0.33),
    ],
)
def test_the_channel_is_named_with_its_factor(mistake: str, channel: str, factor: float | None, both: list[Drive]) -> None:
    for drive in both:
        said = FRONT_ENDS["C"](drive, MISTAKES[mistake](drive))
        at = int(said.against.nonzero()[0][-1])
        assert said.channel[at] == channel, drive.name
        if factor is not None:
            assert said.factor[at] == pytest.approx(factor, rel=0.2), drive.name  # roll, pitch and slopes are in it
