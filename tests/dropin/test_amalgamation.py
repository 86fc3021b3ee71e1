"""The two files of scripts/dev/amalgamate.py equal the library.

They compile alone without a warning, compute the same numbers and export the same names.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from test_can import ROOT, find_tool, run_command

from tse.car.formula import Number, format_c_header, parse

pytestmark = pytest.mark.slow

DRIVE = ROOT / "tests" / "replay" / "drive.csv"
FORMATS = ("double", "float", "fixed")
WARNINGS = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror")
SAME = ROOT / "tests" / "dropin" / "same.c"


def amalgamate(out: Path, *options: str) -> Path:
    """Write the two files with options; return their folder."""
    run_command(sys.executable, ROOT / "scripts" / "dev" / "amalgamate.py", "--out", out, *options)
    return out


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return amalgamate(tmp_path_factory.mktemp("two"))


@pytest.fixture(scope="module", params=FORMATS)
def both(
    request: pytest.FixtureRequest, two: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Path, Path]:
    """Return number format, library from its sources, and library from the two files."""
    cc, ar, folder = find_tool("cc"), find_tool("ar"), tmp_path_factory.mktemp(request.param)
    sources = sorted((ROOT / "src").rglob("*.c"))
    flags = ["-std=c99", "-O1", "-ffp-contract=off", f"-DTSE_REAL_{request.param.upper()}=1"]
    objects = []
    for source in sources:
        objects.append(folder / f"{'_'.join(source.relative_to(ROOT / 'src').parts)}.o")
        run_command(cc, *flags, "-I", ROOT / "include", "-I", ROOT / "src", "-c", source, "-o", objects[-1])
    run_command(ar, "rcs", folder / "library.a", *objects)
    run_command(cc, *flags, "-c", two / "tse.c", "-o", folder / "tse.o")
    run_command(ar, "rcs", folder / "two.a", folder / "tse.o")
    return request.param, folder / "library.a", folder / "two.a"


def compute_numbers(folder: Path, real: str, *with_what: str | Path) -> str:
    """Compile and run the program; return its output."""
    program = folder / f"same_{real}"
    run_command(
        find_tool("cc"), *WARNINGS, f"-DTSE_REAL_{real.upper()}=1", SAME, *with_what, "-o", program, "-lm"
    )
    return run_command(program, DRIVE)


def test_the_same_sources_give_the_same_bytes(two: Path, tmp_path: Path) -> None:
    again = amalgamate(tmp_path / "elsewhere")
    for name in ("tse.h", "tse.c", "LICENSE", "NOTICE"):
        assert (two / name).read_bytes() == (again / name).read_bytes()


def test_the_two_files_stand_alone_and_say_what_they_are(two: Path) -> None:
    header, source = (two / "tse.h").read_text(), (two / "tse.c").read_text()
    assert set(re.findall(r'#\s*include\s+"([^"]+)"', header)) == set()
    assert set(re.findall(r'#\s*include\s+"([^"]+)"', source)) == {
        "tse.h",
        "tse_formula.h",
    }  # the latter with TSE_FORMULA only
    version = re.search(r'TSE_VERSION "(.+)"', (ROOT / "include/tse/version.h").read_text())
    for text in (header, source):
        assert f"tse {version[1]}," in text.partition("*/")[0]
        assert "SPDX-License-Identifier: Apache-2.0" in text.partition("*/")[0]
        assert str(ROOT) not in text


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("real", FORMATS)
@pytest.mark.parametrize("effects", ["with effects", "without"])
def test_no_compiler_warns(two: Path, tmp_path: Path, compiler: str, real: str, effects: str) -> None:
    """gcc warns more with -O1, because it analyses the data flow."""
    flags = ["-DTSE_NO_EFFECTS=1"] if effects == "without" else []
    run_command(
        find_tool(compiler),
        *WARNINGS,
        "-O1",
        f"-DTSE_REAL_{real.upper()}=1",
        *flags,
        "-c",
        two / "tse.c",
        "-o",
        tmp_path / "tse.o",
    )


def test_header_and_source_are_cxx_too(two: Path) -> None:
    run_command(
        find_tool("g++"),
        "-std=c++17",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-fsyntax-only",
        "-x",
        "c++",
        two / "tse.c",
    )


def test_the_two_files_compute_what_the_library_computes(
    both: tuple[str, Path, Path], two: Path, tmp_path: Path
) -> None:
    real, library, archive = both
    expected = compute_numbers(tmp_path, real, "-I", ROOT / "include", library)
    assert expected.count("\n") > 30
    assert "-" not in re.sub(r"-?0 |learnt", "", expected.partition("table")[0]), (
        "no setting of same.c is refused"
    )
    assert compute_numbers(tmp_path, real, "-DONE_FILE", "-I", two, archive) == expected


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_a_compiler_that_may_fuse_gives_the_same_bits(two: Path, tmp_path: Path, compiler: str) -> None:
    """Without -std=c99 and -ffp-contract=off, as in builds with other flags."""
    cc = find_tool(compiler)
    if " fma " not in (Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""):
        pytest.skip("this processor has no fused multiply-add")
    golden = (ROOT / "tests/replay/golden_float.csv").read_text()
    program, flags = tmp_path / "update", ("-std=gnu11", "-O2", "-mfma", "-DTSE_REAL_FLOAT=1", "-I", two)
    run_command(cc, *flags, "-c", two / "tse.c", "-o", tmp_path / "tse.o")
    run_command(
        cc,
        *flags,
        "-include",
        "tse.h",
        "-I",
        ROOT / "include",
        ROOT / "tests/replay/update.c",
        tmp_path / "tse.o",
        "-o",
        program,
        "-lm",
    )
    assert run_command(program, "golden", DRIVE) == golden


def list_exported(archive: Path) -> set[str]:
    """Return the names that an archive exports."""
    rows = [
        line.split() for line in run_command(find_tool("nm"), "-g", "--defined-only", archive).splitlines()
    ]
    return {row[2] for row in rows if len(row) == 3}


def test_only_what_the_public_headers_declare_is_visible(both: tuple[str, Path, Path]) -> None:
    real, library, archive = both
    suffix = {"double": "f64", "float": "f32", "fixed": "fix"}[real]
    names = list_exported(archive)
    headers = "\n".join(p.read_text() for p in (ROOT / "include/tse").glob("*.h"))
    declared = re.findall(r"^#define \w+ +TSE_NAME\((\w+)\)", headers, re.M)
    assert names <= list_exported(library)
    assert names <= {f"{name}_{suffix}" for name in declared}
    assert f"tse_step_{suffix}" in names
    run_command(
        sys.executable, ROOT / "tests/check_symbols.py", "--nm", find_tool("nm"), "--real", real, archive
    )


def test_fast_math_is_refused(two: Path) -> None:
    command = [str(find_tool("cc")), "-ffast-math", "-fsyntax-only", str(two / "tse.c")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "NaN" in done.stderr


def test_options_are_defaults_that_a_macro_overrides(tmp_path: Path) -> None:
    cc, folder = (
        find_tool("cc"),
        amalgamate(tmp_path / "two", "--real", "float", "--max-particles", "64", "--no-effects"),
    )
    (tmp_path / "say.c").write_text(
        '#include <stdio.h>\n#include "tse.h"\nint main(void) { tse_build b; tse_describe_build(&b);\n'
        'printf("%s %d %d", b.format, (int)b.capacity, (int)b.sim_bytes); return 0; }\n'
    )
    for flags, expected in (
        ((), "float 64 0"),
        (("-DTSE_REAL_DOUBLE=1", "-DTSE_MAX_PARTICLES=32"), "double 32 0"),
    ):
        run_command(
            cc, *flags, "-I", folder, tmp_path / "say.c", folder / "tse.c", "-o", tmp_path / "say", "-lm"
        )
        assert run_command(tmp_path / "say") == expected


def test_without_rows_for_late_channels_the_rest_is_the_same(two: Path, tmp_path: Path) -> None:
    """A drive gives the same numbers; a late channel is refused by its name."""
    folder = amalgamate(tmp_path / "none", "--latency-rows", "0")
    said, usual = (
        compute_numbers(tmp_path, "double", "-DONE_FILE", "-I", x, x / "tse.c").splitlines()
        for x in (folder, two)
    )
    assert said[1:] == usual[1:]  # all but the first, the sizes
    assert len(said) > 30
    (tmp_path / "late.c").write_text(
        '#include <stdio.h>\n#include "tse.h"\n'
        "static tse_filter f;\nstatic tse_params p;\nint main(void)\n{\n"
        'tse_config c;\nconst char *wrong = "";\ntse_config_exact(&c);\n'
        "int reset = tse_prepare(&c, &p, &wrong) || tse_reset(&p, &f, sizeof f);\n"
        "int sound = tse_filter_check(&p, &f, sizeof f);\n"
        "c.steer_angle_latency = -0.01;\nint refused = tse_prepare(&c, &p, &wrong);\n"
        'printf("%d %d %d %s", reset, sound, refused == TSE_E_CONFIG, wrong);\nreturn 0;\n}\n'
    )
    run_command(
        find_tool("cc"),
        *WARNINGS,
        "-I",
        folder,
        tmp_path / "late.c",
        folder / "tse.c",
        "-o",
        tmp_path / "late",
        "-lm",
    )
    assert run_command(tmp_path / "late") == "0 0 1 steer_angle_latency"


def test_a_formula_is_compiled_in(two: Path, tmp_path: Path) -> None:
    formula = parse(
        "offset", "an offset of the angle", "front_angle", "k*steer_angle", [Number("k", 0.1, "1")]
    )
    (tmp_path / "tse_formula.h").write_text(format_c_header(formula))
    run_command(
        find_tool("cc"),
        *WARNINGS,
        "-DTSE_FORMULA=1",
        "-I",
        tmp_path,
        "-c",
        two / "tse.c",
        "-o",
        tmp_path / "tse.o",
    )


def test_the_makefile_of_the_page_builds_a_program(two: Path, tmp_path: Path) -> None:
    page = (ROOT / "scripts/dropin/README.md").read_text()
    (tmp_path / "Makefile").write_text(re.search(r"```make\n(.*?)```", page, re.S)[1])
    for name in ("tse.h", "tse.c"):
        (tmp_path / name).write_bytes((two / name).read_bytes())
    minimal = (ROOT / "tests/package/minimal.c").read_text()
    (tmp_path / "minimal.c").write_text(re.sub(r'"tse/\w+\.h"', '"tse.h"', minimal))
    run_command(find_tool("make"), "-s", "CFLAGS=-std=c99 -O1 -Wall -Wextra -Werror", cwd=tmp_path)
    assert "front cornering" in run_command(tmp_path / "minimal")
