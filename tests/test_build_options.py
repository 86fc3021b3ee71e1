"""Options of a compiler that change results: an error where the preprocessor can see them, else found by tse_self_test()."""

import os
import platform
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ASKED = shlex.split(os.environ.get("CC", "cc"))[0], "gcc", "clang"
COMPILERS = list({os.path.realpath(path): c for c in reversed(ASKED) if (path := shutil.which(c))}.values())  # cc is one of them
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


def build(compiler, folder, real, options):
    """How a drop-in build goes: the sources and somebody's options.   Returned: what compiler and program said."""
    (folder / "main.c").write_text(PROGRAM)
    program = folder / "program"
    command = [compiler, *options, f"-DTSE_REAL_{real}=1", f"-I{ROOT / 'include'}", f"-I{ROOT / 'src'}", folder / "main.c",
               ROOT / "src" / "host" / "self_test.c", "-o", program, "-lm"]  # fmt: skip
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    if done.returncode:
        return None, done.stderr
    return subprocess.run([program], capture_output=True, text=True, check=True).stdout, done.stderr


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("options", ["-std=c99 -O0", "-std=c99 -O3", "-std=gnu99 -O3 -ffp-contract=off", "-O2 -fno-trapping-math"])
def test_ordinary_options_pass(compiler, options, real, tmp_path):
    said, errors = build(compiler, tmp_path, real, [*options.split(), "-Wall", "-Wextra", "-Werror"])
    assert said == "0 \n", errors


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("options", ["-ffast-math", "-Ofast", "-ffinite-math-only"])
def test_fast_math_does_not_compile(compiler, options, real, tmp_path):
    said, errors = build(compiler, tmp_path, real, ["-std=c99", "-O2", *options.split()])
    assert said is None and "change results: compile without" in errors


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("compiler", [c for c in COMPILERS if is_clang(c)])
def test_a_reciprocal_that_quotients_share_is_found(compiler, real, tmp_path):
    """clang says nothing of it to the preprocessor; with it the bits differ."""
    said, _ = build(compiler, tmp_path, real, ["-std=c99", "-O2", "-freciprocal-math"])
    assert said.startswith("-12 quotients")


@pytest.mark.parametrize("option", ["-funsafe-math-optimizations", "-freciprocal-math", "-fno-signed-zeros"])
@pytest.mark.parametrize("compiler", [c for c in COMPILERS if not is_clang(c)])
def test_parts_of_fast_math_do_not_compile_where_the_compiler_says_so(compiler, option, tmp_path):
    said, errors = build(compiler, tmp_path, "DOUBLE", ["-std=c99", "-O2", option])
    assert said is None and "change results: compile without" in errors


# what the machines say on which sums have other widths: -1 gcc's -mfpmath=both, 1 s390x, 2 x87, 16 and 32 of half precision
@pytest.mark.parametrize(
    ("method", "refused"),
    [("-1", REALS), ("0", ()), ("1", ("FLOAT",)), ("2", REALS), ("16", ()), ("32", ()), ("64", ("FLOAT",)), ("128", REALS)],
)
@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("compiler", [c for c in COMPILERS if not is_clang(c)])
def test_sums_that_are_wider_than_their_numbers_do_not_compile(compiler, real, method, refused, tmp_path):
    said, errors = build(compiler, tmp_path, real, ["-std=c99", "-U__FLT_EVAL_METHOD__", f"-D__FLT_EVAL_METHOD__={method}"])
    if real in refused:
        assert said is None and "round differently" in errors
    else:
        assert said == "0 \n"


@pytest.mark.skipif(not X86, reason="no x87 here")
@pytest.mark.parametrize("option", ["-mfpmath=387", "-mfpmath=both"])
@pytest.mark.parametrize("compiler", [c for c in COMPILERS if not is_clang(c)])
def test_x87_does_not_compile(compiler, option, tmp_path):
    said, errors = build(compiler, tmp_path, "DOUBLE", ["-std=c99", option])
    assert said is None and "as x87 makes them" in errors


@pytest.mark.skipif(not FUSES, reason="this processor has no fused multiply-add of x86")
@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("compiler", COMPILERS)
def test_contraction_is_found_where_it_is_not_prevented(compiler, real, tmp_path):
    """gcc fuses in its GNU dialect, and says so nowhere. To clang the sources say that it must not."""
    fuse = ["-ffp-contract=on"] if is_clang(compiler) else []
    said, errors = build(compiler, tmp_path, real, ["-std=gnu99", "-O2", "-mfma", *fuse])
    if is_clang(compiler):
        assert said == "0 \n", errors
    else:
        assert said.startswith("-12 products are not rounded before they are added: -ffp-contract=off"), errors


@pytest.mark.skipif(not X86, reason="options of x86")
@pytest.mark.parametrize("compiler", COMPILERS)
def test_sums_in_another_order_are_found(compiler, tmp_path):
    """clang gives it no name."""
    said, errors = build(compiler, tmp_path, "DOUBLE", ["-O2", "-fassociative-math", "-fno-signed-zeros", "-fno-trapping-math"])
    if is_clang(compiler):
        assert said.startswith("-12 "), errors
    else:
        assert said is None and "change results" in errors
