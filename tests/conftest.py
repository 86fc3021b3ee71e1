"""Which tests share a process when several run at once (scripts/test.sh; pytest-xdist). In one process nothing is changed."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # processes share the cores; before numpy is loaded

import pytest

# The longest first, so that no process ends long after the others. A file stays together, for the sake of its fixtures; files of
# one row, too: they wait for the same compiler runs, which a second process could only watch.
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
# What takes long, and seldom finds what the others do not: with --all (scripts/test.sh --all, as CI does), or when it is named
HEAVY = {
    "tests/dropin/test_amalgamation.py", "tests/embedded/test_machines.py", "tests/fmu/test_fmu_platforms.py",
    "tests/lab/test_fmu_cli.py", "tests/lab/test_gap_latency.py",
    *(f"tests/gap/test_study.py::test_a_{t}" for t in (
        "clean_car_gets_no_name", "hidden_effect_is_named_with_its_size", "patch_of_low_grip_is_none_of_the_catalogue")),
    "tests/mistakes/test_mistakes.py::test_the_other_front_ends_say_what_the_library_says",
    *(f"tests/proof/test_proof.py::test_{t}" for t in (
        "no_required_misra_rule_is_broken_outside_the_deviations", "a_fault_is_found_and_one_that_changes_nothing_is_not",
        "no_alarm_without_an_explanation")),
}  # fmt: skip
RANK = {file: rank for rank, row in enumerate(FIRST) for file in row}


def file_of(nodeid: str) -> str:
    return nodeid.partition("::")[0]


def heavy_of(nodeid: str) -> set[str]:
    """Its file or itself, where it is one of those."""
    return HEAVY & {file_of(nodeid), nodeid.partition("[")[0]}


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--all", action="store_true", help="also the tests that take long")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    asked = " ".join(map(str, config.invocation_params.args))
    if not config.getoption("--all"):
        left = [
            i for i in items if any(file_of(h).rpartition("/")[2] not in asked for h in heavy_of(i.nodeid))
        ]
        if left:
            config.hook.pytest_deselected(items=left)
            items[:] = [i for i in items if i not in set(left)]
    if "PYTEST_XDIST_WORKER" in os.environ:
        items.sort(key=lambda item: RANK.get(file_of(item.nodeid), len(FIRST)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object | None:
    """--dist loadfile, with rows of files. (The marks of loadgroup have no effect in pytest-xdist 3.8 with pytest 9.2.)"""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class ByRow(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = file_of(nodeid)
            return FIRST[RANK[file]][0] if file in RANK else file

    return ByRow(config, log)
