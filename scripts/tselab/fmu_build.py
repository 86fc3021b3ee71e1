"""Build the FMUs of this checkout. CMake builds each FMU with a binary for this machine.
Binaries for other platforms are then cross-compiled from the sources inside the FMU."""

import importlib.util
import os
import platform as machine
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tse.errors import Error
from tse.files import lock_file, write_atomically

# ---- Platforms. The Python package ziglang compiles the binaries for all platforms. It
# contains a C compiler, and the C libraries of these platforms.

FMI = ("2", "3")  # versions of FMI for which FMUs are built


@dataclass(frozen=True)
class Platform:
    """A platform for which binaries are built."""

    name: str  # folder in binaries/ of an FMU of FMI 2.0
    tuple3: str  # folder in binaries/ of an FMU of FMI 3.0
    suffix: str  # suffix of a shared library
    # targets of the compiler zig, such as x86_64-linux-gnu.2.2.5. If there are several,
    # their binaries are joined to one file
    targets: tuple[str, ...]

    def folder(self, fmi: str) -> str:
        """Return the name of the folder in binaries/ that holds the binary of this
        platform, in an FMU of this version of FMI."""
        return self.tuple3 if fmi == "3" else self.name

    def compiled_for(self, fmi: str) -> tuple[str, ...]:
        """Return the targets of zig for which the binary of this platform is compiled.

        FMI 2.0 has one folder, darwin64, for all processors of macOS: one binary for all
        `targets`. FMI 3.0 has a folder for each processor, named by `tuple3`: a binary
        for the first target only."""
        return self.targets[:1] if fmi == "3" else self.targets


# The targets of Linux name the oldest version of glibc that exists for the processor.
# Systems with this or any later version of glibc can load the binaries.
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

# Compiler options that are needed for a shared library. The other options, which affect
# numerical results and speed, are in the buildDescription.xml of the FMU.
SHARED = ("-fPIC", "-fvisibility=hidden", "-shared", "-s")
LANGUAGE = {"C99": "-std=c99"}


def get_native_platform(fmi: str = "2") -> str:
    """Return the name of the platform of this machine, as FMI 2.0 or 3.0 (`fmi`) defines
    it for the folders in binaries/ of an FMU."""
    if fmi == "3" and (here := get_native_platform()) in PLATFORMS:
        return PLATFORMS[here].tuple3
    arm = machine.machine().lower() in ("aarch64", "arm64")
    system = {"linux": "linux", "win32": "win", "darwin": "darwin"}.get(sys.platform, sys.platform)
    return f"aarch64-{'windows' if system == 'win' else system}" if arm else f"{system}64"


@dataclass(frozen=True)
class Build:
    """How to compile an FMU, from its buildDescription.xml: name of the binary, source
    files and compiler options."""

    identifier: str
    sources: tuple[str, ...]
    flags: tuple[str, ...]


def read_build(folder: Path) -> Build:
    """Read buildDescription.xml in the folder sources/ of an FMU. Only the first set of
    source files is used."""
    root = ElementTree.parse(folder / "buildDescription.xml").getroot()
    configuration = root.find("BuildConfiguration")
    files = configuration.find("SourceFileSet")
    flags = [LANGUAGE[files.get("language")], *files.get("compilerOptions", "").split()]
    flags += [f"-D{d.get('name')}={d.get('value', '')}" for d in files.findall("PreprocessorDefinition")]
    names = tuple(f.get("name") for f in files.findall("SourceFile"))
    return Build(configuration.get("modelIdentifier"), names, tuple(flags))


def check_compiler() -> None:
    """Raise Error if the cross-compiler is not installed. Called before a build."""
    if importlib.util.find_spec("ziglang") is None:
        raise Error(
            "binaries of other platforms are compiled by the Python package ziglang, which is not installed: "
            "run 'scripts/setup.sh platforms', or install the extra 'platforms'"
        )


def compile_for(platform: Platform, sources: Path, cache: Path, fmi: str = "2") -> bytes:
    """Compile the sources of an FMU for a platform. Return the binary.

    `sources`: folder sources/ of the FMU. `cache`: see run_zig()."""
    return join_slices([_compile(target, platform, sources, cache) for target in platform.compiled_for(fmi)])


def _compile(target: str, platform: Platform, sources: Path, cache: Path) -> bytes:
    build = read_build(sources)
    name = build.identifier + platform.suffix
    flags = [*build.flags, *SHARED, "-I."]
    if platform.suffix == ".dylib":
        # without this option, the library contains the path of the temporary folder
        # below, and so differs from build to build
        flags.append(f"-Wl,-install_name,@rpath/{name}")
    with tempfile.TemporaryDirectory() as folder:
        # a DLL contains its own file name, so it must be linked under its final name
        binary = Path(folder) / name
        try:
            run_zig(["-target", target, *flags, *build.sources, "-o", str(binary)], sources, cache)
        except Error as error:
            raise Error(f"{build.identifier} does not compile for {platform.name}: {error}") from None
        return binary.read_bytes()


def run_zig(arguments: Sequence[str], folder: Path, cache: Path) -> None:
    """Run the C compiler of ziglang in a folder.

    `cache`: folder for the C libraries of other platforms. For a new platform the
    compiler builds these libraries from source, which takes about a minute. Later runs
    take them from the folder."""
    command = [sys.executable, "-m", "ziglang", "cc", *arguments]
    environment = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": str(cache), "ZIG_LOCAL_CACHE_DIR": str(cache)}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, errors="replace"
    )
    if done.returncode:
        raise Error(f"zig cc failed:\n{done.stderr.strip()[-2000:]}")


FAT_MAGIC = 0xCAFEBABE  # magic number of a universal Mach-O file, big-endian
MACHO_64 = 0xFEEDFACF  # magic number of a 64-bit Mach-O file, little-endian on x86_64 and on arm64
# Key: CPU type in a Mach-O file (x86_64, arm64). Value: log2 of its page size [bytes].
# In a universal file, the part for a CPU must start at a multiple of its page size
PAGE_BITS = {0x01000007: 12, 0x0100000C: 14}


def join_slices(slices: Iterable[bytes]) -> bytes:
    """Join Mach-O files for several processors into a universal file, as the tool lipo
    does. If there is only one file, return it unchanged."""
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


Say = Callable[[str], None]
EPOCH = (1980, 1, 1, 0, 0, 0)  # date of all files in a zip: the earliest one that the format allows


@dataclass(frozen=True)
class Built:
    """A written FMU or SSP system."""

    path: Path
    binaries: dict[str, int]  # key: platform; value: size of its binary [bytes]. Empty for an SSP system


def find_checkout() -> Path:
    """Return the root of the checkout that contains this package. Raise Error if the
    package is installed outside a checkout."""
    root = Path(__file__).resolve().parents[2]
    if not (root / "CMakePresets.json").is_file() or not (root / "fmu").is_dir():
        raise Error(
            "'tselab fmu build' needs a checkout of the project, but this tselab is installed without one: "
            "run it from a checkout"
        )
    return root


def read_version(name: str) -> str:
    """Return the version of FMI that the name of an FMU states: "3" for NAME-fmi3, "2"
    for any other name."""
    return "3" if name.endswith("-fmi3") else "2"


def build(
    out: Path,
    wanted: Sequence[str],
    max_particles: int | None,
    say: Say,
    real: str = "double",
    fmi: Sequence[str] = FMI,
) -> list[Built]:
    """Build the FMUs for the versions `fmi` of FMI and, if "2" is one of them, the SSP
    systems. Write the files to `out` only after everything was compiled.

    `wanted`: platforms for which binaries are cross-compiled. If it is empty, the FMUs
    have only the binary for this machine."""
    root = find_checkout()
    if wanted:
        check_compiler()
    stage = build_native(root, max_particles, say, real)
    there = {p.parent.name: p.parent for p in sorted(stage.glob("*/modelDescription.xml"))}
    fmus = {name: folder for name, folder in there.items() if read_version(name) in fmi}
    if lacking := [v for v in fmi if not any(read_version(name) == v for name in fmus)]:
        raise Error(
            f"the headers of FMI {lacking[0]}.0 are not in .venv/share: run scripts/setup.sh, or use --fmi 2"
        )
    files = {name: read_content(folder) for name, folder in fmus.items()}
    for name, folder in fmus.items():
        for platform in wanted:
            start = time.monotonic()
            to = PLATFORMS[platform]
            binary = compile_for(to, folder / "sources", root / "build" / "zig-cache", read_version(name))
            identifier = read_build(folder / "sources").identifier
            files[name][f"binaries/{to.folder(read_version(name))}/{identifier}{to.suffix}"] = binary
            say(f"{name} for {platform}: {len(binary):,} bytes, {time.monotonic() - start:.0f} s")
    out.mkdir(parents=True, exist_ok=True)
    built = []
    for name, inside in files.items():
        pack(out / f"{name}.fmu", inside)
        sizes = {n.split("/")[1]: len(b) for n, b in inside.items() if n.startswith("binaries/")}
        built.append(Built(out / f"{name}.fmu", sizes))
    for system in sorted(stage.glob("*/SystemStructure.ssd")) if "2" in fmi else ():
        parts = {
            f"resources/{name}.fmu": (out / f"{name}.fmu").read_bytes()
            for name in files
            if read_version(name) == "2"
        }
        parts |= {
            f"resources/{p.name}": p.read_bytes() for p in sorted((system.parent / "resources").glob("*.ssv"))
        }
        pack(out / f"{system.parent.name}.ssp", {"SystemStructure.ssd": system.read_bytes(), **parts})
        built.append(Built(out / f"{system.parent.name}.ssp", {}))
    return built


def build_native(root: Path, max_particles: int | None, say: Say, real: str = "double") -> Path:
    """Run the CMake preset `fmu`. Return a folder that has a subfolder for each FMU, with
    the files of this FMU, not packed yet."""
    if shutil.which("cmake") is None:
        raise Error("cmake is not installed: version 3.21 or later is needed")
    kind = [
        "fmu",
        *([str(max_particles)] if max_particles is not None else []),
        *([real] if real != "double" else []),
    ]
    folder = root / "build" / "-".join(kind)
    with lock_file(get_lock(folder)):
        _build_native(root, folder, max_particles, real, say)
    return folder / "fmu"


def get_lock(folder: Path) -> Path:
    """Return the path of the lock file of a build folder. A process locks this file while
    it builds. The file is next to the folder, because a build may delete the folder."""
    return folder.with_name(f"{folder.name}.lock")


def _build_native(root: Path, folder: Path, max_particles: int | None, real: str, say: Say) -> None:
    _remove_foreign(folder, root)
    command = ["cmake", "--preset", "fmu", "-B", str(folder), f"-DTSE_REAL={real}"]
    if (
        not (folder / "CMakeCache.txt").is_file()
        and "CMAKE_GENERATOR" not in os.environ
        and shutil.which("ninja")
    ):
        command += ["-G", "Ninja"]
    for version in FMI:
        if (headers := root / ".venv" / "share" / f"fmi{version}").is_dir():
            command.append(f"-DFETCHCONTENT_SOURCE_DIR_FMI{version}={headers}")
    if max_particles is not None:
        command.append(f"-DTSE_MAX_PARTICLES={max_particles}")
    say("native build (CMake preset fmu)")
    for step in (command, ["cmake", "--build", str(folder), "--target", "fmus"]):
        done = subprocess.run(step, cwd=root, capture_output=True, text=True, errors="replace")
        if done.returncode:
            raise Error(
                f"building the FMUs failed: output of {' '.join(step[:3])}:\n"
                f"{(done.stdout + done.stderr).strip()[-3000:]}"
            )


def _remove_foreign(folder: Path, root: Path) -> None:
    """Delete the build folder if it was made for a checkout at a different path, because
    CMake cannot use it."""
    cache = folder / "CMakeCache.txt"
    if cache.is_file() and f"CMAKE_HOME_DIRECTORY:INTERNAL={root}\n" not in cache.read_text(errors="replace"):
        shutil.rmtree(folder)


def pack(path: Path, files: Mapping[str, bytes]) -> None:
    """Write a zip file. Names are sorted and all dates are EPOCH, so that the same
    content always gives the same bytes."""
    with write_atomically(path, "wb") as out, zipfile.ZipFile(out, "w") as file:
        for name in sorted(files):
            info = zipfile.ZipInfo(name, EPOCH)
            info.create_system = 3  # Unix, on every machine
            info.external_attr = (0o100755 if name.endswith((".so", ".dll", ".dylib")) else 0o100644) << 16
            file.writestr(info, files[name], zipfile.ZIP_DEFLATED, 9)


def read_content(folder: Path) -> dict[str, bytes]:
    """Return all files below a folder. Key: path relative to it. Value: content."""
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }
