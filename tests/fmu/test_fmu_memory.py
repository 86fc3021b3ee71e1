"""No memory error and no leak in the importer's own process, by sanitizers and valgrind.

    python test_fmu_memory.py BUILD_FOLDER ROWS

is the program that runs under them.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from fmpy.fmi1 import FMICallException
from fmu_support import (
    ESTIMATOR,
    MODELS,
    Instance,
    build,
    find_headers,
    list_exports,
    load_unit,
    read_recorded_drive,
    run,
)

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent
FLAGS = "-g -O1 -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer"


def main(folder: str, rows: int) -> None:
    """Do all that an importer does, several times: drive, save, restore, refuse, free."""
    for model in MODELS:
        of = load_unit(model, folder)
        for _ in range(2):
            with Instance(of, "a", logging=True) as a, Instance(of, "b") as b:
                parameters = {"filter.particles": 60} if model == ESTIMATOR else {"simulation.seed": 2}
                a.start(parameters)
                if model == ESTIMATOR:
                    read_recorded_drive(rows).through_fmu(a)
                else:
                    for k in range(rows):
                        a.set({"wheel_torque_front": 100.0 * (k % 5), "steer_angle": 0.001 * (k % 9)})
                        a.step(0.01 * k, 0.01)
                        a.get()
                data = a.state()
                b.restore(data)
                for bad in (data[:-1], data[:3], data[:100] + b"x" + data[101:], b"\0" * len(data)):
                    try:
                        b.restore(bad)
                    except FMICallException:
                        continue
                    raise AssertionError("a damaged state was taken")
                for call in (lambda i=a: i.slave.getReal([10**6]), lambda i=a: i.set({"vehicle.mass": 1.0})):
                    try:
                        call()
                    except FMICallException:
                        continue
                    raise AssertionError("a wrong call was taken")
                a.slave.terminate()
                a.slave.reset()
        print(model, "done")


def find_sanitizer() -> str:
    """Return the run-time library of gcc's address sanitizer; empty: there is none."""
    if not shutil.which("gcc"):
        return ""
    path = subprocess.run(
        ["gcc", "-print-file-name=libasan.so"], capture_output=True, text=True
    ).stdout.strip()
    return path if os.path.isabs(path) else ""


def run_scenario(environment: dict[str, str], *before: str, rows: int) -> subprocess.CompletedProcess:
    return subprocess.run(
        [*before, sys.executable, __file__, environment["FOLDER"], str(rows)],
        cwd=HERE,
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "PYTHONMALLOC": "malloc", **environment},
    )


@pytest.mark.skipif(not find_sanitizer(), reason="gcc's address sanitizer is not installed")
def test_sanitizers_find_nothing() -> None:
    build(
        "fmu-asan",
        "-DCMAKE_C_COMPILER=gcc",
        "-DCMAKE_BUILD_TYPE=Debug",
        f"-DCMAKE_C_FLAGS={FLAGS}",
        "-DCMAKE_C_FLAGS_DEBUG=",
    )
    binary = load_unit(MODELS[0], "fmu-asan").binary
    assert "__asan" in run("nm", "-D", binary).stdout, "this FMU was built without the sanitizer"
    # leaks that name no line of ours are Python's own
    options = "detect_leaks=1:exitcode=0:verify_asan_link_order=0:handle_segv=1"
    done = run_scenario({"FOLDER": "fmu-asan", "LD_PRELOAD": find_sanitizer(), "ASAN_OPTIONS": options,
                     "UBSAN_OPTIONS": "print_stacktrace=1"}, rows=300)  # fmt: skip
    assert done.stdout.count("done") == 2, done.stderr[-4000:]
    assert "ERROR: AddressSanitizer" not in done.stderr and "runtime error" not in done.stderr, done.stderr[
        -4000:
    ]
    blocks = [b for b in done.stderr.split("\n\n") if re.search(r"(Direct|Indirect) leak", b)]
    leaks = [b for b in blocks if re.search(r"fmi2|tse_|model_", b)]
    assert not leaks, "\n\n".join(leaks[:5])


def test_the_fmu_cannot_leak_because_it_does_not_allocate(model) -> None:
    """Memory is a pool; and of the C library nothing but these is called."""
    if not shutil.which("nm"):
        pytest.skip("nm is not installed")
    needed = {
        line.split()[-1].split("@")[0]
        for line in run("nm", "-D", "--undefined-only", model.binary).stdout.splitlines()
    }
    needed = {n for n in needed if not n.startswith("_")}
    assert needed <= {
        "memcpy",
        "memset",
        "memcmp",
        "memchr",
        "memmove",
        "strchr",
        "strcmp",
        "strrchr",
        "strlen",
        "snprintf",
        "sqrt",
    }, needed
    header = (model.folder / "sources" / "fmi2Functions.h").read_text()
    common, _, rest = header[header.index("FMI2_Export fmi2GetTypesPlatformTYPE") :].partition(
        "Model Exchange"
    )
    co_simulation = rest.partition("Co-Simulation")[2]
    defined = set(re.findall(r"^ *FMI2_Export fmi2\w+TYPE +(fmi2\w+);", common + co_simulation, re.M))
    assert list_exports(model.binary) == defined and len(defined) == 34


@pytest.mark.skipif(not shutil.which("valgrind"), reason="valgrind is not installed")
def test_valgrind_finds_nothing_in_a_client(model, tmp_path: Path) -> None:
    """The small client instead of Python also shows uninitialised bytes in saved states.

    It takes a few steps only, because valgrind is slow.
    """
    client, input_ = tmp_path / "client", tmp_path / "in.csv"
    run("cc", "-std=c99", "-g", "-I", find_headers(), HERE / "client.c", "-o", client, "-ldl")
    input_.write_text(
        f"time,{model.code('steer_angle')}\n" + "".join(f"{0.01 * k:.2f},0.0{k % 3}\n" for k in range(12))
    )
    few = ["--set", f"{model.code('filter.particles')}=60"] if "filter.particles" in model.variables else []
    common = [
        "valgrind",
        "-q",
        "--error-exitcode=9",
        "--leak-check=full",
        client,
        model.binary,
        model.guid,
        input_,
    ]
    run(*common, tmp_path / "out.csv", *few, "--save", f"{tmp_path / 'state'}@6")
    run(*common, tmp_path / "rest.csv", "--restore", f"{tmp_path / 'state'}@6")
    assert (tmp_path / "rest.csv").read_text().splitlines()[1:] == (
        tmp_path / "out.csv"
    ).read_text().splitlines()[7:]


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
