"""Decide which tests share a process when several run at once.

scripts/test.sh runs the tests with pytest-xdist. In a single process nothing changes.
"""

import os
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: processes share the cores

import pytest

# The longest come first, so that no process ends long after the others. The tests of a
# file stay together because of its fixtures. Files of a row stay together because they
# wait for the same compiler runs.
FIRST = [
    ["tests/fmu/test_fmu_platforms.py", "tests/lab/test_fmu_cli.py"],
    ["tests/gap/test_study.py"],
    ["tests/embedded/test_machines.py"],
    ["tests/lab/test_live.py"],
    ["tests/lab/test_cli.py"],
    ["tests/lab/test_montecarlo.py"],
    ["tests/lab/test_gap_discover.py"],
    ["tests/lab/test_damaged_files.py"],
    ["tests/lab/test_what_moves.py"],
    ["tests/lab/test_fleet.py"],
    ["tests/lab/test_peers.py"],
    ["tests/lab/test_calibrate.py"],
    ["tests/lab/test_gap_output.py"],
    ["tests/gap/test_generator.py"],
    ["tests/fmu/test_fmu_memory.py"],
    ["tests/lab/test_gap_latency.py"],
    ["tests/dropin/test_amalgamation.py"],
]
RANK = {file: rank for rank, row in enumerate(FIRST) for file in row}


def find_file(nodeid: str) -> str:
    """Return the file of a test."""
    return nodeid.partition("::")[0]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--all", action="store_true", help="also the tests that are marked slow")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        "slow: takes long and seldom finds what others miss; runs with --all, or if its file is named",
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    asked = " ".join(map(str, config.invocation_params.args))
    if not config.getoption("--all"):
        left = [
            i for i in items if i.get_closest_marker("slow") and Path(find_file(i.nodeid)).name not in asked
        ]
        if left:
            config.hook.pytest_deselected(items=left)
            dropped = set(left)
            items[:] = [i for i in items if i not in dropped]
    if "PYTEST_XDIST_WORKER" in os.environ:
        items.sort(key=lambda item: RANK.get(find_file(item.nodeid), len(FIRST)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object | None:
    """Distribute by files (--dist loadfile) and by rows of files.

    The marks of loadgroup have no effect in pytest-xdist 3.8 with pytest 9.2.
    """
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class ByRow(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = find_file(nodeid)
            return FIRST[RANK[file]][0] if file in RANK else file

    return ByRow(config, log)
