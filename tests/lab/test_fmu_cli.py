"""tselab fmu build: what is built is reproducible and loads elsewhere."""

import importlib.util
import re
import shutil
import struct
import zipfile
from pathlib import Path

import pytest

from conftest import tselab, tselab_here
from tse.library.errors import UserError
from tselab import fmu_build as build
from tselab import fmu_build as platforms

pytestmark = pytest.mark.slow

if shutil.which("cmake") is None:
    pytest.skip("cmake is not installed", allow_module_level=True)
lief = pytest.importorskip("lief")

FMUS = ("SingleTrackVehicle", "TireStiffnessEstimator")
PLATFORMS3 = ("win64", "darwin64")
FMUS3 = tuple(f"{name}-fmi3" for name in FMUS)


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build both FMUs, for FMI 2.0 and 3.0, and the system; return the folder."""
    folder = tmp_path_factory.mktemp("fmus")
    done = tselab("fmu", "build", "--out", folder)
    assert done.code == 0, done.err
    assert [line.split(":")[0] for line in done.out.splitlines()] == [
        str(folder / name)
        for name in (*(f"{n}{v}.fmu" for n in FMUS for v in ("", "-fmi3")), "StiffnessStudy.ssp")
    ]
    return folder


@pytest.fixture(scope="session")
def everywhere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the same with binaries of all platforms.

    The FMUs of FMI 3.0, which take as long again, have those of two platforms besides
    this one.
    """
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip(
            "ziglang, which compiles for other platforms, is not installed (scripts/setup.sh platforms)"
        )
    folder = tmp_path_factory.mktemp("everywhere")
    build.build(folder, tuple(platforms.PLATFORMS), None, lambda _: None, fmi=("2",))
    build.build(folder, PLATFORMS3, None, lambda _: None, fmi=("3",))
    return folder


def expect_refusal(done, words: list[str]) -> None:
    assert done.code == 2, done.out + done.err
    assert "Traceback" not in done.err
    for word in words:
        assert word in done.err


@pytest.mark.parametrize("command", ["build", "parameters"])
def test_help_teaches(command):
    done = tselab_here("fmu", command, "--help")
    assert done.code == 0 and f"tselab fmu {command} " in done.out.split("Usage", 1)[1].split("\n", 1)[1]


# ---- build


def test_the_same_sources_give_the_same_files(built, tmp_path):
    assert tselab("fmu", "build", "--out", tmp_path).code == 0
    names = sorted(p.name for p in built.iterdir())
    assert names == sorted(p.name for p in tmp_path.iterdir())
    for name in names:
        assert (tmp_path / name).read_bytes() == (built / name).read_bytes()
        with zipfile.ZipFile(built / name) as file:
            inside = file.infolist()
        assert [i.filename for i in inside] == sorted(i.filename for i in inside)
        assert {i.date_time for i in inside} == {build.EPOCH}


def test_the_system_holds_the_fmus_that_lie_beside_it(built):
    with zipfile.ZipFile(built / "StiffnessStudy.ssp") as file:
        for name in FMUS:
            assert file.read(f"resources/{name}.fmu") == (built / f"{name}.fmu").read_bytes()


def test_one_version_of_fmi_can_be_asked_for(built, tmp_path):
    assert tselab("fmu", "build", "--fmi", "3", "--out", tmp_path).code == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == [f"{name}.fmu" for name in FMUS3]
    for name in FMUS3:
        assert (tmp_path / f"{name}.fmu").read_bytes() == (built / f"{name}.fmu").read_bytes()


def test_headers_that_are_not_there_are_named(tmp_path, monkeypatch):
    for name in FMUS:
        (tmp_path / "stage" / name).mkdir(parents=True)
        (tmp_path / "stage" / name / "modelDescription.xml").write_text("")
    monkeypatch.setattr(build, "build_native", lambda *_: tmp_path / "stage")
    with pytest.raises(UserError, match=r"headers of FMI 3\.0 are not in .*scripts/setup\.sh"):
        build.build(tmp_path / "out", (), None, lambda _: None)
    assert not (tmp_path / "out").exists()


def test_what_is_interrupted_leaves_nothing(tmp_path, monkeypatch):
    def interrupted(*_: object) -> bytes:
        raise KeyboardInterrupt

    monkeypatch.setattr(platforms, "check_compiler", lambda: None)
    monkeypatch.setattr(platforms, "compile_for", interrupted)
    with pytest.raises(KeyboardInterrupt):
        build.build(tmp_path / "out", ("win64",), None, lambda _: None)
    assert not (tmp_path / "out").exists()


def test_a_missing_compiler_is_said_before_anything_is_built(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(build, "build_native", lambda *_: pytest.fail("was built"))
    with pytest.raises(UserError, match=r"ziglang.*not installed.*scripts/setup\.sh platforms"):
        build.build(tmp_path, ("linux64",), None, lambda _: None)


def test_build_refuses_a_file_and_a_platform_that_nobody_knows(tmp_path):
    (tmp_path / "taken").write_text("")
    expect_refusal(
        tselab_here("fmu", "build", "--out", tmp_path / "taken"), ["taken", "a directory is needed"]
    )
    expect_refusal(tselab_here("fmu", "build", "--platform", "vax"), ["vax", "linux64"])


def test_slices_are_joined_as_the_loader_of_macos_wants_them():
    x86 = struct.pack("<III", 0xFEEDFACF, 0x01000007, 3) + b"x" * 5000
    arm = struct.pack("<III", 0xFEEDFACF, 0x0100000C, 0) + b"a" * 777
    joined = platforms.join_slices([x86, arm])
    assert struct.unpack_from(">II", joined) == (0xCAFEBABE, 2)
    for i, (piece, bits) in enumerate(((x86, 12), (arm, 14))):
        cpu, subtype, offset, size, align = struct.unpack_from(">5I", joined, 8 + 20 * i)
        assert (cpu, subtype) == struct.unpack_from("<II", piece, 4) and align == bits
        assert offset % (1 << bits) == 0 and joined[offset : offset + size] == piece
    assert platforms.join_slices([arm]) == arm


def read_slices(data: bytes) -> list:
    """Read a shared library with lief; a universal one has one part per processor."""
    if data[:2] == b"MZ":
        return [lief.PE.parse(data)]
    if data[:4] == b"\x7fELF":
        return [lief.ELF.parse(data)]
    found = lief.MachO.parse(data)
    return [found.at(i) for i in range(found.size)]


X86, ARM = lief.Header.ARCHITECTURES.X86_64, lief.Header.ARCHITECTURES.ARM64
MACHINES = {
    "linux64": [X86],
    "win64": [X86],
    "darwin64": [X86, ARM],
    "aarch64-linux": [ARM],
    "aarch64-darwin": [ARM],
}
C_LIBRARY = (
    "libc.so.6",
    "libm.so.6",
    "kernel32.dll",
    "ntdll.dll",
    "ucrtbase.dll",
    "msvcrt.dll",
    "api-ms-win-crt-",
    "/usr/lib/libsystem.",
)
LINKER_MADE = {
    "_init",
    "_fini",
    "_edata",
    "_end",
    "__bss_start",
    "_mh_dylib_header",
    "__dso_handle",
    "___dso_handle",
    "__mh_dylib_header",
}
OLDEST = {"linux64": (2, 2, 5), "aarch64-linux": (2, 17)}  # glibc that a binary needs


@pytest.mark.parametrize("name", [*FMUS, *FMUS3])
def test_binaries_of_all_platforms_export_fmi_and_need_nothing_new(everywhere, name):
    fmi = build.read_version(name)
    header = (
        build.find_checkout() / ".venv" / "share" / f"fmi{fmi}" / "headers" / f"fmi{fmi}Functions.h"
    ).read_text()
    required = re.findall(rf"^ *FMI{fmi}_Export \w+\s+(fmi{fmi}\w+);", header, flags=re.M)
    if fmi == "2":  # an FMU for co-simulation alone has not those of model exchange
        del required[required.index("fmi2EnterEventMode") : required.index("fmi2SetRealInputDerivatives")]
    with zipfile.ZipFile(everywhere / f"{name}.fmu") as fmu:
        binaries = {n.split("/")[1]: fmu.read(n) for n in fmu.namelist() if n.startswith("binaries/")}
    wanted = (
        MACHINES
        if fmi == "2"
        else {p: MACHINES[p] for p in {platforms.get_native_platform(), *PLATFORMS3} & set(MACHINES)}
    )
    assert set(binaries) == {platforms.PLATFORMS[p].folder(fmi) for p in wanted}
    for platform, machines in wanted.items():
        data = binaries[platforms.PLATFORMS[platform].folder(fmi)]
        found = read_slices(data)
        assert [b.abstract.header.architecture for b in found] == (machines if fmi == "2" else machines[:1])
        for b in found:
            assert {f.name for f in b.exported_functions} - LINKER_MADE in (
                {*required},
                {f"_{n}" for n in required},
            )
            needs = [getattr(x, "name", x).lower() for x in b.libraries]
            assert [
                x for x in needs if not x.startswith((*C_LIBRARY, "@rpath/"))
            ] == []  # its own name in macOS
            if isinstance(b, lief.ELF.Binary):
                versions = [a.name for r in b.symbols_version_requirement for a in r.get_auxiliary_symbols()]
                numbers = [tuple(int(x) for x in v.removeprefix("GLIBC_").split(".")) for v in versions]
                assert (
                    max(numbers, default=()) <= ((2, 17) if fmi == "3" else OLDEST[platform])
                    and b.has_nx is not False
                )
            if isinstance(b, lief.MachO.Binary) and b.abstract.header.architecture == ARM:
                assert b.has_code_signature  # macOS on arm64 loads nothing else
        assert b"/tmp/" not in data and str(build.find_checkout()).encode() not in data
