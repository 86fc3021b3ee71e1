"""Work in copies of the process: in order, what closures know, and errors as they were."""

import os
import sys

import pytest

from tselab.errors import UserError
from tselab.gap.parallel import apart, is_copy

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="processes are not copied elsewhere")


@pytest.mark.parametrize("jobs", [1, 2, 5])
def test_what_comes_back_is_in_order_and_of_closures(jobs: int) -> None:
    by = 3
    assert apart(jobs, lambda x: by * x, [4, 1, 2]) == [12, 3, 6]
    assert apart(jobs, lambda x: by * x, []) == [] and not is_copy()


@LINUX
def test_each_is_done_in_another_process_which_makes_no_more() -> None:
    found = apart(2, lambda _: (os.getpid(), is_copy(), apart(2, lambda _: os.getpid(), [0, 0])), [0, 0, 0])
    assert all(pid != os.getpid() and copy and inner == [pid, pid] for pid, copy, inner in found)


@LINUX
def test_only_what_is_light_is_sent() -> None:
    assert apart(2, lambda x: (x, lambda: None), [1, 2], lambda pair: pair[0]) == [1, 2]  # a function cannot be sent


def test_an_error_of_a_user_stays_one() -> None:
    def wrong(x: int) -> int:
        raise UserError(f"{x} is too much")

    with pytest.raises(UserError, match="is too much"):
        apart(2, wrong, [7, 8])
