"""No front end is valid and silent for a log with a mistake
(scripts/results/mistakes.md)."""

import re
import shutil

import numpy as np
import pytest

from tests.mistakes.drives import CHANNELS, MISTAKES, OF_LOGS, STEP, Drive, make_drives
from tests.mistakes.front_ends import FRONT_ENDS, page_maker

# whole drives; tests/unit/filter/test_plausible.c has the rules by rows
pytestmark = pytest.mark.slow

ROWS = ("C", "Python")  # front ends without a file: of rows, of a whole log


@pytest.fixture(scope="module")
def both() -> list[Drive]:
    return make_drives()


def expect_response(mistake: str | None, front_end: str, both: list[Drive]) -> None:
    for drive in both:
        said = FRONT_ENDS[front_end](drive, MISTAKES[mistake](drive) if mistake else drive.log)
        if mistake:
            assert not said.silent, drive.name
        else:  # the car that is known exactly is valid, so the test can fail
            assert said.silent == drive.known and not said.against.any() and said.words == (), drive.name


@pytest.mark.parametrize("front_end", ROWS)
@pytest.mark.parametrize("mistake", [None, *MISTAKES])
def test_a_mistake_is_never_valid_and_silent(mistake: str | None, front_end: str, both: list[Drive]) -> None:
    expect_response(mistake, front_end, both)


@pytest.mark.parametrize("front_end", ROWS)
@pytest.mark.parametrize("channel", CHANNELS)
def test_a_channel_that_is_frozen_never_ends_valid(channel: str, front_end: str, both: list[Drive]) -> None:
    """Rows before the fault stay valid. From 30 s after it on, no row is."""
    log = dict(both[0].log)
    stuck = round(0.4 * len(log["time"]))
    log[channel] = np.where(np.arange(len(log["time"])) < stuck, log[channel], log[channel][stuck])
    valid = FRONT_ENDS[front_end](both[0], log).valid
    assert (
        valid[: stuck // 2].any()
        and valid[:stuck].mean() > 0.5
        and not valid[stuck + round(30 / STEP) :].any()
    )


@pytest.mark.parametrize("mistake", OF_LOGS)
def test_what_only_a_whole_log_shows_is_said(mistake: str, both: list[Drive]) -> None:
    change, words = OF_LOGS[mistake]
    for drive in both:
        said = FRONT_ENDS["Python"](drive, change(drive))
        assert not said.valid.any() and words in " ".join(said.words), (drive.name, said.words)
        if degrees := re.search(r"about the vertical by (-?\d+) degrees", " ".join(said.words)):
            # noise and grade: below 2; with the tangent in place of the sine it would be
            # 27
            assert abs(int(degrees[1]) - 30) <= 2, drive.name


@pytest.mark.parametrize("front_end", [f for f in FRONT_ENDS if f not in ROWS])
@pytest.mark.parametrize("mistake", [None, *MISTAKES])
def test_the_other_front_ends_say_what_the_library_says(
    mistake: str | None, front_end: str, both: list[Drive]
) -> None:
    if front_end == "page":
        if not shutil.which("node"):
            pytest.skip("node is not installed")
        try:
            page_maker.find_compilers()
        except page_maker.Failed as error:
            pytest.skip(str(error))
    expect_response(mistake, front_end, both)


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
def test_the_channel_is_named_with_its_factor(
    mistake: str, channel: str, factor: float | None, both: list[Drive]
) -> None:
    for drive in both:
        said = FRONT_ENDS["C"](drive, MISTAKES[mistake](drive))
        at = int(said.against.nonzero()[0][-1])
        assert said.channel[at] == channel, drive.name
        if factor is not None:
            # contains roll, pitch and grade
            assert said.factor[at] == pytest.approx(factor, rel=0.2), drive.name
