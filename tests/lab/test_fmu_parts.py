"""The parts of `tselab fmu` that need no compiler: names, descriptions, parameters, zip.

What the compilers build is in test_fmu_cli.py and tests/fmu.
"""

import json
import os
import struct
import subprocess
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace

import pytest

import tse
from conftest import tselab_here
from tse.errors import Error, NoFile
from tse.tables import simulated_vehicle
from tselab import fmu, fmu_build
from tselab.fmu import FmuParameter
from tselab.fmu_build import PLATFORMS

DESCRIPTION2 = """<fmiModelDescription fmiVersion="2.0"><ModelVariables>
<ScalarVariable name="vehicle.exact" causality="parameter"><Boolean start="false"/></ScalarVariable>
<ScalarVariable name="vehicle.mass" causality="parameter"><Real start="1500"/></ScalarVariable>
<ScalarVariable name="filter.form" causality="parameter"><Integer start="0"/></ScalarVariable>
<ScalarVariable name="filter.plain" causality="parameter"><Real/></ScalarVariable>
<ScalarVariable name="yaw_rate" causality="input"><Real start="0"/></ScalarVariable>
</ModelVariables></fmiModelDescription>"""
DESCRIPTION3 = """<fmiModelDescription fmiVersion="3.0"><ModelVariables>
<Boolean name="vehicle.exact" causality="parameter" start="false"/>
<Float64 name="vehicle.mass" causality="parameter" start="1500"/>
<Int32 name="filter.form" causality="parameter" start="0"/>
<Float64 name="filter.plain" causality="parameter"/>
<Float64 name="yaw_rate" causality="input" start="0"/>
</ModelVariables></fmiModelDescription>"""
BUILD = """<fmiBuildDescription><BuildConfiguration modelIdentifier="Tyre">
<SourceFileSet language="C99" compilerOptions="-O2 -ffp-contract=off">
<SourceFile name="a.c"/><SourceFile name="b.c"/>
<PreprocessorDefinition name="REAL" value="8"/><PreprocessorDefinition name="PLAIN"/>
</SourceFileSet>
<SourceFileSet language="C99"><SourceFile name="other.c"/></SourceFileSet>
</BuildConfiguration></fmiBuildDescription>"""


def write_fmu(path, text):
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("modelDescription.xml", text)
    return path


# ---- parameters


@pytest.mark.parametrize("text", [DESCRIPTION2, DESCRIPTION3])
def test_parameters_are_read_from_both_versions_of_fmi(text, tmp_path):
    assert fmu.read_parameters(write_fmu(tmp_path / "x.fmu", text)) == [
        FmuParameter("vehicle.exact", "Boolean", "false"),
        FmuParameter("vehicle.mass", "Real", "1500"),
        FmuParameter("filter.form", "Integer", "0"),
        FmuParameter("filter.plain", "Real", "0"),
    ]


def test_a_file_that_is_not_the_estimator_is_refused(tmp_path):
    other = write_fmu(tmp_path / "other.fmu", DESCRIPTION2.replace("vehicle.exact", "vehicle.name"))
    (tmp_path / "text.fmu").write_text("x")
    with zipfile.ZipFile(tmp_path / "empty.fmu", "w"):
        pass
    for path, kind, text in (
        (other, Error, "is not the FMU of the estimator"),
        (tmp_path / "text.fmu", Error, "is not an FMU: "),
        (tmp_path / "empty.fmu", Error, "is not an FMU: "),
        (tmp_path / "none.fmu", NoFile, "no such file"),
    ):
        with pytest.raises(kind, match=f"{path.name}: {text}"):
            fmu.read_parameters(path)


def test_a_parameter_set_has_the_vehicle_and_what_differs_from_its_start():
    parameters = [
        FmuParameter("vehicle.exact", "Boolean", "false"),
        FmuParameter("vehicle.mass", "Real", "1500"),
        FmuParameter("vehicle.lf", "Real", "1.25"),
        FmuParameter("filter.form", "Integer", "0"),
        FmuParameter("filter.driven_axle", "Integer", "1"),
        FmuParameter("effects.body_roll.gain", "Real", "0"),
        FmuParameter("effects.body_roll.damping", "Real", "0.3"),
        FmuParameter("noise.unknown", "Real", "2"),
    ]
    settings = {
        "mass": 1650,
        "form": 0.0,
        "driven_axle": 2.0,
        "body_roll_gain": 0.005,
        "body_roll_damping": 0.3,
    }
    text = fmu.format_parameter_set(parameters, settings, 'a "b" & c')
    lines = [line.strip() for line in text.splitlines() if "ssv:Parameter name" in line]
    assert lines == [
        '<ssv:Parameter name="vehicle.mass"><ssv:Real value="1650.0"/></ssv:Parameter>',
        '<ssv:Parameter name="vehicle.lf"><ssv:Real value="1.25"/></ssv:Parameter>',
        '<ssv:Parameter name="filter.driven_axle"><ssv:Integer value="2"/></ssv:Parameter>',
        '<ssv:Parameter name="effects.body_roll.gain"><ssv:Real value="0.005"/></ssv:Parameter>',
    ]
    import xml.etree.ElementTree as ElementTree

    assert ElementTree.fromstring(text).get("name") == 'a "b" & c'


def test_the_parameters_of_a_vehicle_are_written_under_its_name(tmp_path):
    write_fmu(tmp_path / "x.fmu", DESCRIPTION2)
    (tmp_path / "car.toml").write_text(simulated_vehicle())
    words = ("fmu", "parameters", "x.fmu", "--vehicle", "car.toml")
    done = tselab_here(*words, cwd=tmp_path)
    assert (done.code, done.out) == (0, "Parameter set written to car.ssv\n"), done.err
    text = (tmp_path / "car.ssv").read_text()
    name = tse.read_vehicle(tmp_path / "car.toml").name
    assert f'name="{name}"' in text and '"vehicle.mass"><ssv:Real value="1900.0"/>' in text
    for out in ("x.fmu", "car.toml"):
        assert tselab_here(*words, "--out", out, cwd=tmp_path).code == 2


# ---- what is built


@pytest.mark.parametrize(
    ("words", "wanted", "particles", "real", "fmi"),
    [
        ((), (), None, "double", ("2", "3")),
        (("--all-platforms",), tuple(PLATFORMS), None, "double", ("2", "3")),
        (
            ("--platform", "win64", "--platform", "linux64", "--platform", "win64"),
            ("win64", "linux64"),
            None,
            "double",
            ("2", "3"),
        ),
        (("--fmi", "3", "--real", "fixed", "--max-particles", 16), (), 16, "fixed", ("3",)),
        (("--fmi", "2"), (), None, "double", ("2",)),
    ],
)
def test_options_of_a_build_reach_it(words, wanted, particles, real, fmi, tmp_path, monkeypatch):
    calls = []

    def build(*given):
        calls.append(given)
        (tmp_path / "a.fmu").write_bytes(b"x" * 1234)
        return [
            fmu_build.Built(tmp_path / "a.fmu", {"win64": 5, "linux64": 7}),
            fmu_build.Built(tmp_path / "a.fmu", {}),
        ]

    monkeypatch.setattr(fmu_build, "build", build)
    done = tselab_here("fmu", "build", *words, cwd=tmp_path)
    assert done.out == f"{tmp_path}/a.fmu: 1,234 bytes (win64, linux64)\n{tmp_path}/a.fmu: 1,234 bytes\n"
    ((out, chosen, most, _, number, versions),) = calls
    assert (out, chosen, most, number, versions) == (Path("fmus"), wanted, particles, real, fmi)
    said = json.loads(tselab_here("fmu", "build", *words, "--json", cwd=tmp_path).out)
    assert said[0] == {"path": f"{tmp_path}/a.fmu", "bytes": 1234, "platforms": ["win64", "linux64"]}


def test_a_platform_has_a_folder_and_targets_for_each_version_of_fmi():
    darwin = PLATFORMS["darwin64"]
    assert (darwin.folder("2"), darwin.folder("3")) == ("darwin64", "x86_64-darwin")
    assert darwin.compiled_for("2") == ("x86_64-macos.11.0", "aarch64-macos.11.0")
    assert darwin.compiled_for("3") == ("x86_64-macos.11.0",)
    for name, p in PLATFORMS.items():
        processor, system = p.tuple3.split("-")
        suffix = {"linux": ".so", "windows": ".dll", "darwin": ".dylib"}[system]
        assert p.name == name and p.suffix == suffix and p.compiled_for("3")[0].startswith(processor)
        assert p.targets[0].split("-")[1].startswith({"darwin": "macos"}.get(system, system))
    assert set(fmu.PLATFORM_NAMES) == set(PLATFORMS)


@pytest.mark.parametrize(
    ("system", "machine", "names"),
    [
        ("linux", "x86_64", ("linux64", "x86_64-linux")),
        ("linux", "aarch64", ("aarch64-linux", "aarch64-linux")),
        ("win32", "AMD64", ("win64", "x86_64-windows")),
        ("win32", "ARM64", ("aarch64-windows", "aarch64-windows")),
        ("darwin", "arm64", ("aarch64-darwin", "aarch64-darwin")),
        ("darwin", "x86_64", ("darwin64", "x86_64-darwin")),
    ],
)
def test_this_machine_has_the_name_that_fmi_gives_it(system, machine, names, monkeypatch):
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr(fmu_build.machine, "machine", lambda: machine)
    assert (fmu_build.get_native_platform(), fmu_build.get_native_platform("3")) == names


def test_an_fmu_is_compiled_as_its_first_set_of_files_says(tmp_path, monkeypatch):
    (tmp_path / "buildDescription.xml").write_text(BUILD)
    flags = ("-std=c99", "-O2", "-ffp-contract=off", "-DREAL=8", "-DPLAIN=")
    assert fmu_build.read_build(tmp_path) == fmu_build.Build("Tyre", ("a.c", "b.c"), flags)
    calls = []

    def compile_it(arguments, folder, cache):
        calls.append(arguments)
        assert (folder, cache) == (tmp_path, tmp_path / "cache")
        Path(arguments[-1]).write_bytes(b"for " + arguments[1].encode())

    monkeypatch.setattr(fmu_build, "run_zig", compile_it)
    monkeypatch.setattr(fmu_build, "join_slices", list)
    found = fmu_build.compile_for(PLATFORMS["darwin64"], tmp_path, tmp_path / "cache")
    assert found == [b"for x86_64-macos.11.0", b"for aarch64-macos.11.0"]
    found = fmu_build.compile_for(PLATFORMS["linux64"], tmp_path, tmp_path / "cache", "3")
    assert found == [b"for x86_64-linux-gnu.2.2.5"]
    for arguments, suffix in zip(calls, (".dylib", ".dylib", ".so"), strict=True):
        assert arguments[0] == "-target" and set(flags) | set(fmu_build.SHARED) | {"-I."} <= set(arguments)
        assert arguments[-4:-1] == ["a.c", "b.c", "-o"] and Path(arguments[-1]).name == f"Tyre{suffix}"
        assert ("-Wl,-install_name,@rpath/Tyre.dylib" in arguments) is (suffix == ".dylib")

    def fail(*_):
        raise Error("no header")

    monkeypatch.setattr(fmu_build, "run_zig", fail)
    with pytest.raises(Error, match=r"^Tyre does not compile for win64: no header$"):
        fmu_build.compile_for(PLATFORMS["win64"], tmp_path, tmp_path / "cache")


def test_the_compiler_runs_in_the_folder_of_the_sources_with_a_cache_of_its_own(tmp_path, monkeypatch):
    calls = []

    def run(command, **how):
        calls.append((command, how))
        return SimpleNamespace(returncode=len(calls) - 1, stderr="x" * 3000 + "end \n")

    monkeypatch.setattr(subprocess, "run", run)
    fmu_build.run_zig(["-c", "a.c"], tmp_path, tmp_path / "cache")
    command, how = calls[0]
    assert command == [sys.executable, "-m", "ziglang", "cc", "-c", "a.c"] and how["cwd"] == tmp_path
    for name in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"):
        assert how["env"][name] == str(tmp_path / "cache")
    assert how["env"]["PATH"] == os.environ["PATH"]
    with pytest.raises(Error, match=r"^zig cc failed:\nx{1997}end$"):
        fmu_build.run_zig([], tmp_path, tmp_path)


def test_binaries_of_two_processors_are_joined_at_multiples_of_their_pages():
    x86 = struct.pack("<III", 0xFEEDFACF, 0x01000007, 3) + b"x" * 5000
    arm = struct.pack("<III", 0xFEEDFACF, 0x0100000C, 2) + b"a" * 777
    joined = fmu_build.join_slices(iter([x86, arm]))
    # a header of 8 bytes and 20 for each processor; pages of 4 and 16 KiB
    assert struct.unpack_from(">12I", joined) == (
        0xCAFEBABE, 2, 0x01000007, 3, 4096, 5012, 12, 0x0100000C, 2, 16384, 789, 14,
    )  # fmt: skip
    assert joined[4096 : 4096 + 5012] == x86 and joined[16384:] == arm
    assert fmu_build.join_slices([arm]) == arm
    with pytest.raises(ValueError, match="not a 64-bit Mach-O file"):
        fmu_build.join_slices([b"\x7fELF" * 5, arm])


def test_a_zip_is_the_same_whatever_the_order_and_the_date(tmp_path):
    files = {"b/x.so": b"1", "a.xml": b"2", "c.dll": b"3", "d.dylib": b"4", "e.sop": b"5"}
    fmu_build.pack(tmp_path / "one.fmu", files)
    fmu_build.pack(tmp_path / "two.fmu", dict(reversed(files.items())))
    assert (tmp_path / "one.fmu").read_bytes() == (tmp_path / "two.fmu").read_bytes()
    with zipfile.ZipFile(tmp_path / "one.fmu") as file:
        assert {n: file.read(n) for n in file.namelist()} == files and file.namelist() == sorted(files)
        for i in file.infolist():
            runs = i.filename in ("b/x.so", "c.dll", "d.dylib")
            assert i.external_attr >> 16 == (0o100755 if runs else 0o100644)
            assert i.date_time == (1980, 1, 1, 0, 0, 0) and i.create_system == 3
            assert i.compress_type == zipfile.ZIP_DEFLATED


def test_the_content_of_a_folder_has_paths_relative_to_it(tmp_path):
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "b" / "x.c").write_bytes(b"x")
    (tmp_path / "y.c").write_bytes(b"y")
    assert fmu_build.read_content(tmp_path) == {"a/b/x.c": b"x", "y.c": b"y"}
    assert [fmu_build.read_version(n) for n in ("A", "A-fmi3", "A-fmi2", "fmi3-A")] == ["2", "3", "2", "2"]
    assert fmu_build.get_lock(tmp_path / "fmu-512") == tmp_path / "fmu-512.lock"


def test_a_build_folder_of_another_checkout_is_deleted(tmp_path):
    for home, kept in ((tmp_path, True), (tmp_path / "sub", False), (tmp_path.parent, False)):
        folder = tmp_path / "build"
        folder.mkdir(exist_ok=True)
        (folder / "CMakeCache.txt").write_text(f"A:B=1\nCMAKE_HOME_DIRECTORY:INTERNAL={home}\nC:D=2\n")
        fmu_build._remove_foreign(folder, tmp_path)
        assert folder.exists() is kept
    folder.mkdir()
    fmu_build._remove_foreign(folder, tmp_path)
    assert folder.exists()  # it has no cache yet


def make_stage(folder, *names):
    """Return a folder of unpacked FMUs and of an SSP system."""
    for name in names:
        (folder / name / "sources").mkdir(parents=True)
        (folder / name / "modelDescription.xml").write_text(name)
        (folder / name / "sources" / "buildDescription.xml").write_text(BUILD)
        (folder / name / "binaries").mkdir()
        (folder / name / "binaries" / "here").mkdir()
        (folder / name / "binaries" / "here" / "Tyre.so").write_bytes(b"native")
    (folder / "Study" / "resources").mkdir(parents=True)
    (folder / "Study" / "SystemStructure.ssd").write_text("system")
    (folder / "Study" / "resources" / "car.ssv").write_text("car")
    return folder


def test_fmus_of_each_version_get_their_binaries_and_the_system_those_of_fmi_2(tmp_path, monkeypatch):
    stage = make_stage(tmp_path / "stage", "Car", "Car-fmi3")
    compiled, said = [], []
    monkeypatch.setattr(fmu_build, "check_compiler", lambda: None)
    monkeypatch.setattr(fmu_build, "build_native", lambda *_: stage)

    def compile_it(platform, sources, cache, fmi):
        compiled.append((platform.name, sources.parent.name, fmi))
        return b"made"

    monkeypatch.setattr(fmu_build, "compile_for", compile_it)
    found = fmu_build.build(tmp_path / "out", ("win64", "darwin64"), None, said.append)
    assert compiled == [
        (p, n, v) for n, v in (("Car", "2"), ("Car-fmi3", "3")) for p in ("win64", "darwin64")
    ]
    assert [f.path.name for f in found] == ["Car.fmu", "Car-fmi3.fmu", "Study.ssp"]
    assert found[0].binaries == {"here": 6, "win64": 4, "darwin64": 4} and found[2].binaries == {}
    assert found[1].binaries == {"here": 6, "x86_64-windows": 4, "x86_64-darwin": 4}
    with zipfile.ZipFile(found[0].path) as file:
        assert (
            file.read("binaries/darwin64/Tyre.dylib") == b"made"
            and "sources/buildDescription.xml" in file.namelist()
        )
    with zipfile.ZipFile(found[2].path) as file:
        assert file.namelist() == ["SystemStructure.ssd", "resources/Car.fmu", "resources/car.ssv"]
        assert file.read("resources/Car.fmu") == found[0].path.read_bytes()
    assert len(said) == 4 and said[0].startswith("Car for win64: 4 bytes")
    found = fmu_build.build(tmp_path / "three", (), None, said.append, fmi=("3",))
    assert [f.path.name for f in found] == ["Car-fmi3.fmu"] and len(compiled) == 4
    only2 = make_stage(tmp_path / "two", "Car")
    monkeypatch.setattr(fmu_build, "build_native", lambda *_: only2)
    with pytest.raises(Error, match=r"^the headers of FMI 3\.0 are not in"):
        fmu_build.build(tmp_path / "none", (), None, said.append)
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("particles", "real", "folder"),
    [
        (None, "double", "fmu"),
        (64, "double", "fmu-64"),
        (None, "fixed", "fmu-fixed"),
        (64, "float", "fmu-64-float"),
    ],
)
def test_each_kind_of_build_has_a_folder_and_its_options(particles, real, folder, tmp_path, monkeypatch):
    calls = []

    def run(command, **how):
        calls.append(command)
        assert how["cwd"] == tmp_path
        return SimpleNamespace(returncode=0)

    monkeypatch.setattr(subprocess, "run", run)
    monkeypatch.setattr(fmu_build.shutil, "which", lambda name: name)
    monkeypatch.delenv("CMAKE_GENERATOR", raising=False)
    (tmp_path / ".venv" / "share" / "fmi2").mkdir(parents=True)
    (tmp_path / "build").mkdir()
    assert (
        fmu_build.build_native(tmp_path, particles, lambda _: None, real)
        == tmp_path / "build" / folder / "fmu"
    )
    configure, make = calls
    at = str(tmp_path / "build" / folder)
    assert configure[:5] == ["cmake", "--preset", "fmu", "-B", at] and f"-DTSE_REAL={real}" in configure
    assert make == ["cmake", "--build", at, "--target", "fmus"]
    headers = [x for x in configure if x.startswith("-DFETCH")]
    assert headers == [f"-DFETCHCONTENT_SOURCE_DIR_FMI2={tmp_path}/.venv/share/fmi2"]
    assert [x for x in configure if "PARTICLES" in x] == (
        [f"-DTSE_MAX_PARTICLES={particles}"] if particles else []
    )
    assert configure[6:8] == ["-G", "Ninja"]


def test_a_build_that_fails_or_cannot_begin_names_the_cause(tmp_path, monkeypatch):
    (tmp_path / "build").mkdir()
    monkeypatch.setattr(
        subprocess, "run", lambda *_, **__: SimpleNamespace(returncode=1, stdout="out\n", stderr="bad\n")
    )
    monkeypatch.setattr(fmu_build.shutil, "which", lambda name: None if name == "ninja" else name)
    with pytest.raises(Error, match=r"output of cmake --preset fmu:\nout\nbad$"):
        fmu_build.build_native(tmp_path, None, lambda _: None)
    monkeypatch.setattr(fmu_build.shutil, "which", lambda name: None)
    with pytest.raises(Error, match="cmake is not installed"):
        fmu_build.build_native(tmp_path, None, lambda _: None)
    monkeypatch.setattr(fmu_build.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(Error, match="ziglang, which is not installed"):
        fmu_build.check_compiler()
    monkeypatch.setattr(fmu_build, "__file__", str(tmp_path / "a" / "b" / "c.py"))
    with pytest.raises(Error, match="needs a checkout of the project"):
        fmu_build.find_checkout()
    (tmp_path / "CMakePresets.json").write_text("")
    with pytest.raises(Error, match="needs a checkout of the project"):
        fmu_build.find_checkout()
    (tmp_path / "fmu").mkdir()
    assert fmu_build.find_checkout() == tmp_path.resolve()
