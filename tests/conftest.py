"""Decide which tests share a process when several run at once.

scripts/test.sh runs the tests with pytest-xdist. In a single process nothing changes.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: processes share the cores

import pytest

# The longest come first, so that no process ends long after the others. The tests of a
# file stay together because of its fixtures. Files of a row stay together because they
# wait for the same compiler runs.
FIRST = [
    ["tests/fmu/test_fmu_platforms.py", "tests/lab/test_fmu_cli.py"],
    ["tests/gap/test_study.py"],
    ["tests/embedded/test_machines.py"],
    ["tests/lab/test_cli.py"],
    ["tests/lab/test_montecarlo.py"],
    ["tests/lab/test_gap_discover.py"],
    ["tests/lab/test_peers.py"],
    ["tests/lab/test_calibrate.py"],
    ["tests/lab/test_gap_output.py"],
    ["tests/gap/test_generator.py"],
    ["tests/fmu/test_fmu_memory.py"],
    ["tests/lab/test_gap_latency.py"],
    ["tests/dropin/test_amalgamation.py"],
]
# Tests that take long and seldom find faults that others miss. They run with --all
# (scripts/test.sh --all, as in CI) or if they are named.
HEAVY = {
    "tests/dropin/test_amalgamation.py",
    "tests/embedded/test_machines.py",
    "tests/fmu/test_fmu_platforms.py",
    "tests/lab/test_fmu_cli.py",
    "tests/lab/test_gap_latency.py",
    *(
        f"tests/gap/test_study.py::test_a_{t}"
        for t in (
            "clean_car_gets_no_name",
            "hidden_effect_is_named_with_its_size",
            "patch_of_low_grip_is_none_of_the_catalogue",
        )
    ),
    "tests/mistakes/test_mistakes.py::test_the_other_front_ends_say_what_the_library_says",
    *(
        f"tests/proof/test_proof.py::test_{t}"
        for t in (
            "no_required_misra_rule_is_broken_outside_the_deviations",
            "a_fault_is_found_and_one_that_changes_nothing_is_not",
            "no_alarm_without_an_explanation",
        )
    ),
}
RANK = {file: rank for rank, row in enumerate(FIRST) for file in row}


def find_file(nodeid: str) -> str:
    """Return the file of a test."""
    return nodeid.partition("::")[0]


def find_heavy(nodeid: str) -> set[str]:
    """Return the entries of HEAVY for a test: its file or the test itself."""
    return HEAVY & {find_file(nodeid), nodeid.partition("[")[0]}


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--all", action="store_true", help="also the tests that take long")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    asked = " ".join(map(str, config.invocation_params.args))
    if not config.getoption("--all"):
        left = [
            i
            for i in items
            if any(find_file(h).rpartition("/")[2] not in asked for h in find_heavy(i.nodeid))
        ]
        if left:
            config.hook.pytest_deselected(items=left)
            items[:] = [i for i in items if i not in set(left)]
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
