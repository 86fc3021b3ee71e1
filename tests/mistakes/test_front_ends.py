"""All six front ends: FMUs, command and page say what the library says."""

import shutil

import pytest

from tests.mistakes.drives import MISTAKES, Drive, drives
from tests.mistakes.front_ends import FRONT_ENDS, page_maker


@pytest.fixture(scope="module")
def both() -> list[Drive]:
    return drives()


def _need(front_end: str) -> None:
    if front_end == "page":
        if not shutil.which("node"):
            pytest.skip("node is not installed")
        try:
            page_maker.compilers()
        except page_maker.Failed as error:
            pytest.skip(str(error))


@pytest.mark.parametrize("front_end", [f for f in FRONT_ENDS if f not in ("C", "Python")])
@pytest.mark.parametrize("mistake", [None, *MISTAKES])
def test_no_front_end_is_valid_and_silent(mistake: str | None, front_end: str, both: list[Drive]) -> None:
    _need(front_end)
    for drive in both:
        said = FRONT_ENDS[front_end](drive, MISTAKES[mistake](drive) if mistake else drive.log)
        if mistake:
            assert not said.silent, drive.name
        else:
            assert said.silent == drive.known and not said.against.any() and said.words == (), drive.name
