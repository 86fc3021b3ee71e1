"""The platforms that binaries of an FMU are for, and how one is cross-compiled: by the C compiler of the Python package ziglang,
which carries the C libraries of all of them."""

from __future__ import annotations

import importlib.util
import os
import platform as machine
import struct
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tse.impl.errors import UserError

FMI = ("2", "3")  # versions that FMUs are built for


@dataclass(frozen=True)
class Platform:
    """A folder in binaries/, named as FMI 2.0.4 does; in an FMU of FMI 3.0 it has another name, and one processor."""

    name: str
    tuple3: str
    suffix: str
    targets: tuple[str, ...]  # of zig; several are joined to one universal binary

    def folder(self, fmi: str) -> str:
        return self.tuple3 if fmi == "3" else self.name

    def compiled_for(self, fmi: str) -> tuple[str, ...]:
        return self.targets[:1] if fmi == "3" else self.targets


# glibc 2.2.5 is the first for x86_64, 2.17 the first for aarch64: nothing newer is needed, so older systems load it, too.
PLATFORMS = {
    p.name: p
    for p in (
        Platform("linux64", "x86_64-linux", ".so", ("x86_64-linux-gnu.2.2.5",)),
        Platform("win64", "x86_64-windows", ".dll", ("x86_64-windows-gnu",)),
        Platform("darwin64", "x86_64-darwin", ".dylib", ("x86_64-macos.11.0", "aarch64-macos.11.0")),
        Platform("aarch64-linux", "aarch64-linux", ".so", ("aarch64-linux-gnu.2.17",)),
        Platform("aarch64-darwin", "aarch64-darwin", ".dylib", ("aarch64-macos.11.0",)),
    )
}

# How a shared library is made of sources. What decides its bits, and how fast it is, comes from the FMU's buildDescription.xml.
SHARED = ("-fPIC", "-fvisibility=hidden", "-shared", "-s")
LANGUAGE = {"C99": "-std=c99"}


def native(fmi: str = "2") -> str:
    """The name of this machine's platform."""
    if fmi == "3" and (here := native()) in PLATFORMS:
        return PLATFORMS[here].tuple3
    arm = machine.machine().lower() in ("aarch64", "arm64")
    system = {"linux": "linux", "win32": "win", "darwin": "darwin"}.get(sys.platform, sys.platform)
    return f"aarch64-{'windows' if system == 'win' else system}" if arm else f"{system}64"


@dataclass(frozen=True)
class Build:
    """What an FMU's buildDescription.xml says."""

    identifier: str
    sources: tuple[str, ...]
    flags: tuple[str, ...]


def read_build(folder: Path) -> Build:
    """Read sources/buildDescription.xml: its first set of source files."""
    root = ElementTree.parse(folder / "buildDescription.xml").getroot()
    configuration = root.find("BuildConfiguration")
    files = configuration.find("SourceFileSet")
    flags = [LANGUAGE[files.get("language")], *files.get("compilerOptions", "").split()]
    flags += [f"-D{d.get('name')}={d.get('value', '')}" for d in files.findall("PreprocessorDefinition")]
    names = tuple(f.get("name") for f in files.findall("SourceFile"))
    return Build(configuration.get("modelIdentifier"), names, tuple(flags))


def check_compiler() -> None:
    """Refuse early, before any long work, what cannot be compiled."""
    if importlib.util.find_spec("ziglang") is None:
        raise UserError(
            "binaries of other platforms are compiled by the Python package ziglang, which is not installed: "
            "run 'scripts/setup.sh platforms', or install the extra 'platforms'"
        )


def compile_for(platform: Platform, sources: Path, cache: Path, fmi: str = "2") -> bytes:
    """The binary of one platform, from the sources/ of an FMU for this version of FMI."""
    return universal([_compile(target, platform, sources, cache) for target in platform.compiled_for(fmi)])


def _compile(target: str, platform: Platform, sources: Path, cache: Path) -> bytes:
    build = read_build(sources)
    name = build.identifier + platform.suffix
    flags = [*build.flags, *SHARED, "-I."]
    if platform.suffix == ".dylib":  # else the path of the temporary folder would be written into it
        flags.append(f"-Wl,-install_name,@rpath/{name}")
    with tempfile.TemporaryDirectory() as folder:
        binary = Path(folder) / name  # a DLL carries the name it was linked with
        try:
            zig(["-target", target, *flags, *build.sources, "-o", str(binary)], sources, cache)
        except UserError as error:
            raise UserError(f"{build.identifier} does not compile for {platform.name}: {error}") from None
        return binary.read_bytes()


def zig(arguments: Sequence[str], folder: Path, cache: Path) -> None:
    """Run its C compiler in a folder. `cache` keeps the C libraries of other platforms, which take a minute to make."""
    command = [sys.executable, "-m", "ziglang", "cc", *arguments]
    environment = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": str(cache), "ZIG_LOCAL_CACHE_DIR": str(cache)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, errors="replace")
    if done.returncode:
        raise UserError(f"zig cc says\n{done.stderr.strip()[-2000:]}")


FAT_MAGIC = 0xCAFEBABE  # big-endian
MACHO_64 = 0xFEEDFACF  # of the machine: little-endian for both
PAGE_BITS = {0x01000007: 12, 0x0100000C: 14}  # x86_64, arm64: a slice starts at a page


def universal(slices: Iterable[bytes]) -> bytes:
    """Mach-O files of several processors in one, as lipo joins them; one alone stays as it is."""
    slices = list(slices)
    if len(slices) == 1:
        return slices[0]
    header = struct.pack(">II", FAT_MAGIC, len(slices))
    body = b""
    start = len(header) + 20 * len(slices)
    for piece in slices:
        magic, cpu, subtype = struct.unpack_from("<III", piece)
        if magic != MACHO_64:
            raise ValueError("not a 64-bit Mach-O file")
        page = 1 << PAGE_BITS[cpu]
        offset = -(-(start + len(body)) // page) * page
        body += bytes(offset - start - len(body)) + piece
        header += struct.pack(">5I", cpu, subtype, offset, len(piece), PAGE_BITS[cpu])
    return header + body
