"""Which tests share a process when several run at once (scripts/test.sh; pytest-xdist). In one process nothing is changed."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

HERE = Path(__file__).parent
# The longest first, so that no process ends long after the others. A file stays together, for the sake of its fixtures; files of
# one row, too: they wait for the same compiler runs, which a second process could only watch.
FIRST = [
    ["fmu/test_fmu_platforms.py", "lab/test_fmu_cli.py"],
    ["lab/test_montecarlo.py"],
    ["gap/test_generator.py"],
]
GROUP = {file: (rank, row[0]) for rank, row in enumerate(FIRST) for file in row}


@pytest.hookimpl(tryfirst=True)  # before pytest-xdist reads the marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return
    groups = {}
    for item in items:
        file = item.path.relative_to(HERE).as_posix()
        groups[item] = GROUP.get(file, (len(FIRST), file))
        item.add_marker(pytest.mark.xdist_group(groups[item][1]))
    items.sort(key=lambda item: groups[item][0])


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "xdist_group(name): tests that run in the same process")
