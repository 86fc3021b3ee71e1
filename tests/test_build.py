"""Builds with other options than ours.

Options of a compiler that change results are an error where the preprocessor can see
them, and tse_self_test() finds the others. scripts/dev/locked.sh installs no package
without its hash because something failed.
"""

import hashlib
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
ASKED = shlex.split(os.environ.get("CC", "cc"))[0], "gcc", "clang"
COMPILERS = list(
    {os.path.realpath(path): c for c in reversed(ASKED) if (path := shutil.which(c))}.values()
)  # cc is one of them
X86 = platform.machine() in ("x86_64", "AMD64")
CPU = Path("/proc/cpuinfo")
FUSES = X86 and CPU.exists() and " fma " in CPU.read_text()
REALS = ("DOUBLE", "FLOAT")
PROGRAM = r"""
#include <stdio.h>
#include "tse/tse.h"
int main(void)
{
  const char *wrong = "";
  const tse_status status = tse_self_test(&wrong);
  printf("%d %s\n", (int)status, wrong);
  return 0;
}
"""


def is_clang(compiler):
    said = subprocess.run([compiler, "--version"], capture_output=True, text=True).stdout
    return "clang" in said


def build_and_run(compiler, folder, real, options):
    """Compile the sources with some options and run the self test.

    Returns the outputs of the program (None if it does not compile) and of the compiler.
    """
    (folder / "main.c").write_text(PROGRAM)
    program = folder / "program"
    command = [
        compiler,
        *options,
        f"-DTSE_REAL_{real}=1",
        f"-I{ROOT / 'include'}",
        f"-I{ROOT / 'src'}",
        folder / "main.c",
        ROOT / "src" / "host" / "self_test.c",
        "-o",
        program,
        "-lm",
    ]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    if done.returncode:
        return None, done.stderr
    return subprocess.run([program], capture_output=True, text=True, check=True).stdout, done.stderr


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize(
    "options", ["-std=c99 -O0", "-std=c99 -O3", "-std=gnu99 -O3 -ffp-contract=off", "-O2 -fno-trapping-math"]
)
def test_ordinary_options_pass(compiler, options, real, tmp_path):
    said, errors = build_and_run(compiler, tmp_path, real, [*options.split(), "-Wall", "-Wextra", "-Werror"])
    assert said == "0 \n", errors


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("options", ["-ffast-math", "-Ofast", "-ffinite-math-only"])
def test_fast_math_does_not_compile(compiler, options, real, tmp_path):
    said, errors = build_and_run(compiler, tmp_path, real, ["-std=c99", "-O2", *options.split()])
    assert said is None and "changes results: compile without" in errors


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("compiler", [c for c in COMPILERS if is_clang(c)])
def test_a_reciprocal_that_quotients_share_is_found(compiler, real, tmp_path):
    """clang defines no macro for this option, and the bits differ."""
    said, _ = build_and_run(compiler, tmp_path, real, ["-std=c99", "-O2", "-freciprocal-math"])
    assert said.startswith("-12 quotients")


@pytest.mark.parametrize("option", ["-funsafe-math-optimizations", "-freciprocal-math", "-fno-signed-zeros"])
@pytest.mark.parametrize("compiler", [c for c in COMPILERS if not is_clang(c)])
def test_parts_of_fast_math_do_not_compile_where_the_compiler_says_so(compiler, option, tmp_path):
    said, errors = build_and_run(compiler, tmp_path, "DOUBLE", ["-std=c99", "-O2", option])
    assert said is None and "changes results: compile without" in errors


# FLT_EVAL_METHOD of machines whose sums have another width: -1 gcc's -mfpmath=both, 1
# s390x, 2 x87, 16 and 32 half precision.
@pytest.mark.parametrize(
    ("method", "refused"),
    [
        ("-1", REALS),
        ("0", ()),
        ("1", ("FLOAT",)),
        ("2", REALS),
        ("16", ()),
        ("32", ()),
        ("64", ("FLOAT",)),
        ("128", REALS),
    ],
)
@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("compiler", [c for c in COMPILERS if not is_clang(c)])
def test_sums_that_are_wider_than_their_numbers_do_not_compile(compiler, real, method, refused, tmp_path):
    said, errors = build_and_run(
        compiler, tmp_path, real, ["-std=c99", "-U__FLT_EVAL_METHOD__", f"-D__FLT_EVAL_METHOD__={method}"]
    )
    if real in refused:
        told = "computed in double" if method in ("1", "64") else "round differently"
        assert said is None and told in errors
    else:
        assert said == "0 \n"


@pytest.mark.skipif(not X86, reason="no x87 here")
@pytest.mark.parametrize("option", ["-mfpmath=387", "-mfpmath=both"])
@pytest.mark.parametrize("compiler", [c for c in COMPILERS if not is_clang(c)])
def test_x87_does_not_compile(compiler, option, tmp_path):
    said, errors = build_and_run(compiler, tmp_path, "DOUBLE", ["-std=c99", option])
    assert said is None and "(x87)" in errors


@pytest.mark.skipif(not FUSES, reason="this processor has no fused multiply-add of x86")
@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("compiler", COMPILERS)
def test_contraction_is_found_where_it_is_not_prevented(compiler, real, tmp_path):
    """gcc fuses in its GNU dialect without a macro; the sources forbid it to clang."""
    fuse = ["-ffp-contract=on"] if is_clang(compiler) else []
    said, errors = build_and_run(compiler, tmp_path, real, ["-std=gnu99", "-O2", "-mfma", *fuse])
    if is_clang(compiler):
        assert said == "0 \n", errors
    else:
        assert said.startswith("-12 products are not rounded before they are added: use -ffp-contract=off"), (
            errors
        )


@pytest.mark.skipif(not X86, reason="options of x86")
@pytest.mark.parametrize("compiler", COMPILERS)
def test_sums_in_another_order_are_found(compiler, tmp_path):
    """clang defines no macro for this option."""
    said, errors = build_and_run(
        compiler, tmp_path, "DOUBLE", ["-O2", "-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math"]
    )
    if is_clang(compiler):
        assert said.startswith("-12 "), errors
    else:
        assert said is None and "changes results" in errors


LOCKED = ROOT / "scripts" / "dev" / "locked.sh"
NO_FILES = 3


def run_locked(python: object, lock: Path) -> int:
    """Return the exit code of scripts/dev/locked.sh."""
    return subprocess.run([LOCKED, str(python), lock], capture_output=True, text=True, timeout=120).returncode


@pytest.mark.parametrize(
    ("says", "wanted"),
    [
        ("ERROR: No matching distribution found for numpy==9", NO_FILES),
        ("ERROR: THESE PACKAGES DO NOT MATCH THE HASHES FROM THE REQUIREMENTS FILE.", 1),
        (
            "ERROR: THESE PACKAGES DO NOT MATCH THE HASHES ...\\nERROR: No matching distribution found for a",
            1,
        ),
        ("WARNING: Retrying after connection broken\\nERROR: No matching distribution found for numpy==9", 1),
        ("ERROR: HTTP error 503 while getting a.whl", 1),
        ("an unknown error", 1),
    ],
)
def test_only_files_that_do_not_exist_for_this_python_are_replaced(
    tmp_path: Path, says: str, wanted: int
) -> None:
    python, lock = tmp_path / "python", tmp_path / "lock.txt"
    python.write_text(f"#!/bin/sh\nprintf '{says}\\n' >&2\nexit 1\n")
    python.chmod(0o755)
    lock.touch()
    assert run_locked(python, lock) == wanted


@pytest.mark.slow
def test_pip_itself_and_a_hash_that_differs(tmp_path: Path) -> None:
    """A package made here, without a registry."""
    wheel = tmp_path / "empty_of_tse-1-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr(
            "empty_of_tse-1.dist-info/METADATA", "Metadata-Version: 2.1\nName: empty-of-tse\nVersion: 1\n"
        )
        archive.writestr(
            "empty_of_tse-1.dist-info/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        archive.writestr("empty_of_tse-1.dist-info/RECORD", "")
    right = hashlib.sha256(wheel.read_bytes()).hexdigest()
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "env"], check=True)
    python, lock = tmp_path / "env" / "bin" / "python", tmp_path / "lock.txt"
    for digest, wanted in (("0" * 64, 1), (right, 0)):
        lock.write_text(f"--no-index\n--find-links {tmp_path}\nempty-of-tse==1 --hash=sha256:{digest}\n")
        assert run_locked(python, lock) == wanted
    assert subprocess.run([python, "-m", "pip", "show", "empty-of-tse"], capture_output=True).returncode == 0


def test_setup_goes_on_without_hashes_in_that_case_alone() -> None:
    """Only after this exit code of locked.sh, and not in CI."""
    text = (ROOT / "scripts" / "setup.sh").read_text(encoding="utf-8")
    assert (
        text.count("installing the newest versions, not those of") == 1
        and '[ $locked -eq 3 ] && [ -z "${CI:-}" ]' in text
    )
    assert "--requirement scripts/lock" not in text


# ---- workflows of the forge: actions pinned by commit, existing scripts, no lint


WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def read_steps(workflow: Path) -> list[dict[str, object]]:
    """Return the steps of a workflow."""
    return [
        s
        for job in yaml.safe_load(workflow.read_text(encoding="utf-8"))["jobs"].values()
        for s in job["steps"]
    ]


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda p: p.stem)
def test_actions_are_pinned_and_scripts_are_there(workflow: Path) -> None:
    text = workflow.read_text(encoding="utf-8")
    used = re.findall(r"uses: (\S+)(.*)", text)
    assert used
    for action, comment in used:
        assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}", action) and re.fullmatch(
            r" # v\d+\.\d+\.\d+", comment
        ), action
    for script in re.findall(r"(?:^|\s)((?:scripts/|tests/|\.ci/)[\w./-]+)", text):
        assert (ROOT / script).is_file(), script
    assert yaml.safe_load(text)["permissions"] == {"contents": "read"}


def test_what_is_run_here_is_run_there() -> None:
    runs = {w.stem: " ".join(str(s.get("run", "")) for s in read_steps(w)) for w in WORKFLOWS}
    assert set(runs) == {"ci", "nightly"}
    assert ".ci/run" in runs["ci"] and "ctest" in runs["ci"] and "pip wheel" in runs["ci"]
    assert all(f"scripts/dev/{s}" in runs["nightly"] for s in ("fuzz.sh", "soak.sh", "proof.sh mutation"))


def test_the_linter_of_the_forge_has_nothing_to_say() -> None:
    linter = shutil.which("actionlint")
    if linter is None:
        pytest.skip(
            "actionlint is not installed (go install github.com/rhysd/actionlint/cmd/actionlint@v1.7.7)"
        )
    done = subprocess.run([linter, "-no-color", *WORKFLOWS], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stdout
