"""`cmake -S . -B build` without a network builds the library, and says what tests and FMUs would need."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
from dropin_support import ROOT, run, tool

NOWHERE = dict.fromkeys(("http_proxy", "https_proxy", "HTTPS_PROXY", "all_proxy"), "http://127.0.0.1:9") | {
    "GIT_CONFIG_GLOBAL": os.devnull,
    "GIT_CONFIG_NOSYSTEM": "1",
    "no_proxy": "",
}
SHARE = ROOT / ".venv" / "share"
GIVEN = [f"-DFETCHCONTENT_SOURCE_DIR_{name}={SHARE / name.lower()}" for name in ("UNITY", "FMI2")]


def cache(build: Path) -> dict[str, str]:
    rows = [x for x in (build / "CMakeCache.txt").read_text().splitlines() if x.startswith("TSE_BUILD_")]
    return {name.partition(":")[0]: value for name, value in (x.split("=", 1) for x in rows)}


@pytest.mark.parametrize("option", [[], ["-DFETCHCONTENT_FULLY_DISCONNECTED=ON"]])
def test_a_plain_configure_builds_the_library(option: list[str], tmp_path: Path) -> None:
    """Also where there is no C++ compiler: only the tests need one."""
    env = NOWHERE | ({"CXX": str(tmp_path / "none")} if option else {})
    said = run(tool("cmake"), "-S", ROOT, "-B", tmp_path, "-DCMAKE_BUILD_TYPE=Debug", *option, env=env)
    assert "the tests are not built" in said
    assert "FETCHCONTENT_SOURCE_DIR_UNITY" in said
    assert "the FMUs are not built" in said
    assert "FETCHCONTENT_SOURCE_DIR_FMI2" in said
    assert ("a C++ compiler" in said) == bool(option)
    assert cache(tmp_path) == {
        "TSE_BUILD_TESTS": "OFF",
        "TSE_BUILD_FMU": "OFF",
        "TSE_BUILD_BENCH": "OFF",
        "TSE_BUILD_FUZZ": "OFF",
    }
    if option:
        run(tool("cmake"), "--build", tmp_path)
        assert list((tmp_path / "src").glob("*tse.*"))


def test_tests_and_fmus_are_built_where_their_sources_are_given(tmp_path: Path) -> None:
    if not (SHARE / "unity/src/unity.c").is_file() or not (SHARE / "fmi2/headers/fmi2Functions.h").is_file():
        pytest.skip("scripts/setup.sh has not put Unity and the FMI headers into .venv/share")
    said = run(tool("cmake"), "-S", ROOT, "-B", tmp_path, *GIVEN, "-DFETCHCONTENT_FULLY_DISCONNECTED=ON", env=NOWHERE)
    assert "not built" not in said
    assert cache(tmp_path) == {
        "TSE_BUILD_TESTS": "ON",
        "TSE_BUILD_FMU": "ON",
        "TSE_BUILD_BENCH": "OFF",
        "TSE_BUILD_FUZZ": "OFF",
    }


@pytest.mark.parametrize(
    ("wanted", "named"), [("TESTS", "FETCHCONTENT_SOURCE_DIR_UNITY"), ("FMU", "FETCHCONTENT_SOURCE_DIR_FMI2")]
)
def test_what_is_asked_for_is_not_left_out(wanted: str, named: str, tmp_path: Path) -> None:
    options = [
        "-DTSE_BUILD_TESTS=OFF",
        "-DTSE_BUILD_FMU=OFF",
        f"-DTSE_BUILD_{wanted}=ON",
        "-DFETCHCONTENT_FULLY_DISCONNECTED=ON",
    ]
    command = [str(x) for x in (tool("cmake"), "-S", ROOT, "-B", tmp_path, *options)]
    done = subprocess.run(command, env=os.environ | NOWHERE, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert named in done.stderr
