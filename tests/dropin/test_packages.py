"""Packages of scripts/amalgamate.py: made, and built by their own tool where the Python package index has it. Where not (Zephyr,
ESP-IDF, vcpkg, Arduino), by stand-ins for the few commands that the package uses, and held against the published schema."""

from __future__ import annotations

import json
import os
import re
import subprocess
import tarfile
from pathlib import Path

import pytest
from dropin_support import ROOT, amalgamated, run, tool

PAGE = "https://example.org/tse"
STANDINS = Path(__file__).parent / "standins"
VERSION = re.search(r'TSE_VERSION "(.+)"', (ROOT / "include/tse/version.h").read_text())[1]
CONFIG = {"CONFIG_TSE": "y", "CONFIG_TSE_REAL_FLOAT": "y", "CONFIG_TSE_MAX_PARTICLES": "64",
          "CONFIG_TSE_LATENCY_ROWS": "32"}  # fmt: skip


def made(folder: Path, name: str, *options: str) -> Path:
    out = amalgamated(folder / name, "--package", name, "--url", PAGE, *options)
    for path in (p for p in out.rglob("*") if p.is_file() and p.suffix not in {".c", ".h"}):
        text = path.read_text()
        assert not re.search(r"@[A-Z]+@", text) or path.name.endswith(".in") or path.name == "CMakeLists.txt", path
        assert str(ROOT) not in text
    return out


@pytest.mark.parametrize("name", ["arduino", "conan", "esp-idf", "make", "platformio", "vcpkg", "zephyr"])
def test_a_package_has_the_version_and_the_licence(name: str, tmp_path: Path) -> None:
    out = made(tmp_path, name)
    assert len(list(out.rglob("LICENSE"))) == len(list(out.rglob("NOTICE"))) == 1
    told = {"make": "tse.h", "zephyr": "include/tse.h", "vcpkg": "vcpkg.json", "conan": "conanfile.py",
            "esp-idf": "idf_component.yml", "arduino": "library.properties", "platformio": "library.json"}  # fmt: skip
    assert VERSION in (out / told[name]).read_text()


def test_a_makefile_of_six_lines_builds_a_program(tmp_path: Path) -> None:
    out = made(tmp_path, "make")
    assert len((out / "Makefile").read_text().splitlines()) <= 6
    run(tool("make"), "-s", "CFLAGS=-std=c99 -O1 -Wall -Wextra -Werror", cwd=out)
    assert "front cornering" in run(out / "minimal")


def test_conan_builds_and_uses_its_package(tmp_path: Path) -> None:
    conan, out = tool("conan"), made(tmp_path, "conan")
    env = {"CONAN_HOME": str(tmp_path / "home")}
    run(conan, "profile", "detect", env=env)
    chosen = ("real=float", "max_particles=64", "latency_rows=16")
    run(conan, "create", ".", *(word for x in chosen for word in ("-o", f"&:{x}")), cwd=out, env=env)


def test_platformio_packs_its_package(tmp_path: Path) -> None:
    """Its list of licences comes from the net, and nothing else: it is handed the one that is needed."""
    pio, out = tool("pio"), made(tmp_path, "platformio")
    python = pio.read_text().splitlines()[0].removeprefix("#!")
    run(python, "-c",
        "import sys; from platformio.package.manifest.schema import ManifestSchema as M\n"
        "M.load_spdx_licenses = staticmethod(lambda: {'licenses': [{'licenseId': 'Apache-2.0'}]})\n"
        "from platformio.__main__ import main; sys.exit(main(['pio', 'pkg', 'pack', '-o', sys.argv[1]]))",
        tmp_path / "tse.tar.gz", cwd=out, env={"PLATFORMIO_CORE_DIR": str(tmp_path / "core")})  # fmt: skip
    with tarfile.open(tmp_path / "tse.tar.gz") as archive:
        assert {"library.json", "src/tse.h", "src/tse.c", "LICENSE"} <= set(archive.getnames())


def test_esp_idf_accepts_its_manifest(tmp_path: Path) -> None:
    compote, out = tool("compote"), made(tmp_path, "esp-idf")
    assert run(compote, "manifest", "lint", cwd=out, env={"IDF_TOOLS_PATH": str(tmp_path / "idf")}).strip() == ""


@pytest.mark.parametrize(
    ("name", "kconfig", "switch"), [("esp-idf", "Kconfig", ""), ("zephyr", "zephyr/Kconfig", "TSE")]
)
def test_kconfig_has_the_defaults_of_the_build(name: str, kconfig: str, switch: str, tmp_path: Path) -> None:
    read = "import kconfiglib, sys\nk = kconfiglib.Kconfig(sys.argv[1], warn_to_stderr=False)\n"
    read += "if sys.argv[2]: k.syms[sys.argv[2]].set_value(2)\nassert not k.warnings, k.warnings\n"
    read += "print(*(f'{s.name}={s.str_value}' for s in k.unique_defined_syms))"
    python = tool("compote").read_text().splitlines()[0].removeprefix("#!")
    if subprocess.run([python, "-c", "import kconfiglib"], capture_output=True, check=False).returncode:
        pytest.skip("kconfiglib is not installed beside compote (scripts/setup.sh dropin)")
    said = dict(x.split("=") for x in run(python, "-c", read, made(tmp_path, name) / kconfig, switch).split())
    cmake = (ROOT / "CMakeLists.txt").read_text()
    for option in ("TSE_MAX_PARTICLES", "TSE_LATENCY_ROWS"):
        assert f"set({option} {said[option]} CACHE" in cmake
    assert said["TSE_EFFECTS"] == said["TSE_REAL_DOUBLE"] == "y"


@pytest.mark.parametrize("name", ["zephyr", "esp-idf"])
def test_the_cmake_files_of_a_target_build_a_program(name: str, tmp_path: Path) -> None:
    cmake, out = tool("cmake"), made(tmp_path, name)
    minimal = re.sub(r'"tse/\w+\.h"', '"tse.h"', (ROOT / "tests/package/minimal.c").read_text())
    (tmp_path / "main.c").write_text(minimal)
    config = [f"-D{k}={v}" for k, v in (CONFIG | {"CONFIG_TSE_EFFECTS": "y"}).items()]
    package = out / "zephyr" if name == "zephyr" else out
    run(
        cmake, "-S", STANDINS, "-B", tmp_path / "b", f"-DPACKAGE={package}", f"-DPROGRAM={tmp_path / 'main.c'}", *config
    )
    run(cmake, "--build", tmp_path / "b")
    assert "front cornering" in run(tmp_path / "b" / "app")
    assert "tse_step_f32" in run(tool("nm"), tmp_path / "b" / "app")


def test_a_zephyr_module_names_what_is_there(tmp_path: Path) -> None:
    out = made(tmp_path, "zephyr")
    said = dict(re.findall(r"^ *(name|cmake|kconfig): (\S+)$", (out / "zephyr/module.yml").read_text(), re.M))
    assert said["name"] == "tse"
    assert (out / said["cmake"] / "CMakeLists.txt").is_file()
    assert (out / said["kconfig"]).is_file()


def test_the_portfile_of_vcpkg_installs_the_library(tmp_path: Path) -> None:
    cmake, out = tool("cmake"), made(tmp_path, "vcpkg")
    run(cmake, f"-DPORT={out}", f"-DWORK={tmp_path / 'work'}", "-P", STANDINS / "standins.cmake")
    packages = tmp_path / "work" / "packages"
    installed = {p.relative_to(packages).as_posix() for p in packages.rglob("*") if p.is_file()}
    assert {"include/tse/tse.h", "include/tse/config.h", "share/tse/LICENSE", "share/tse/NOTICE"} <= installed
    assert json.loads((out / "vcpkg.json").read_text())["version"] == VERSION


def test_an_arduino_sketch_compiles(tmp_path: Path) -> None:
    out = made(tmp_path, "arduino", "--real", "float", "--max-particles", "64")
    (tmp_path / "Arduino.h").write_text(
        "#pragma once\n#include <stdint.h>\n#include <stddef.h>\n"
        "struct Port { void begin(long) {} void println(double) {} void println(const char *) {} };\nextern Port Serial;\n"
    )
    flags = [
        "-std=gnu++17",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-fsyntax-only",
        "-x",
        "c++",
        "-include",
        tmp_path / "Arduino.h",
    ]
    run(tool("g++"), *flags, "-I", out / "src", out / "examples/drive/drive.ino")
    rows = dict(line.split("=", 1) for line in (out / "library.properties").read_text().splitlines())
    needed = "name version author maintainer sentence paragraph category url architectures"  # rev. 2.2
    assert all(rows[x] for x in needed.split())
    assert (out / "src" / rows["includes"]).is_file()


def test_the_published_schemas_accept_the_manifests(tmp_path: Path) -> None:
    """Those of vcpkg and Arduino, which are not copied into this project (the second is under the GPL)."""
    jsonschema = pytest.importorskip("jsonschema")
    referencing = pytest.importorskip("referencing")
    folder = Path(os.environ.get("TSE_SCHEMAS", "-"))
    if not folder.is_dir():
        pytest.skip(
            "TSE_SCHEMAS is no folder with docs of microsoft/vcpkg-tool and etc/schemas of arduino/arduino-lint"
        )
    schemas = {p.name: json.loads(p.read_text()) for p in folder.glob("*.json")}
    registry = referencing.Registry()
    for name, schema in schemas.items():
        resource = referencing.Resource(contents=schema, specification=referencing.jsonschema.DRAFT7)
        for base in {s["$id"].rpartition("/")[0] for s in schemas.values() if "$id" in s}:
            registry = registry.with_resource(f"{base}/{name}", resource)
    properties = (made(tmp_path, "arduino") / "library.properties").read_text()
    manifests = {
        "vcpkg.schema.json": json.loads((made(tmp_path, "vcpkg") / "vcpkg.json").read_text()),
        "arduino-library-properties-schema.json": dict(line.split("=", 1) for line in properties.splitlines()),
    }
    for name, manifest in manifests.items():
        jsonschema.Draft7Validator(schemas[name], registry=registry).validate(manifest)
