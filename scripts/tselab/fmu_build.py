"""Building the FMUs of this checkout: natively by CMake, for other platforms from the
sources that each FMU carries."""

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

# ---- Platforms of the binaries. They are cross-compiled by the C compiler of the Python
# package ziglang, which carries the C libraries of all of them.

FMI = ("2", "3")  # versions that FMUs are built for


@dataclass(frozen=True)
class Platform:
    """A folder in binaries/, named as FMI 2.0.4 does; in an FMU of FMI 3.0 it has another
    name, and one processor."""

    name: str
    tuple3: str
    suffix: str
    targets: tuple[str, ...]  # of zig; several are joined to one universal binary

    def folder(self, fmi: str) -> str:
        return self.tuple3 if fmi == "3" else self.name

    def compiled_for(self, fmi: str) -> tuple[str, ...]:
        return self.targets[:1] if fmi == "3" else self.targets


# glibc 2.2.5 is the first for x86_64, 2.17 the first for aarch64: nothing newer is
# needed, so older systems load it, too.
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

# How a shared library is made of sources. What decides its bits, and how fast it is,
# comes from the FMU's buildDescription.xml.
SHARED = ("-fPIC", "-fvisibility=hidden", "-shared", "-s")
LANGUAGE = {"C99": "-std=c99"}


def get_native_platform(fmi: str = "2") -> str:
    """Return the name of this machine's platform."""
    if fmi == "3" and (here := get_native_platform()) in PLATFORMS:
        return PLATFORMS[here].tuple3
    arm = machine.machine().lower() in ("aarch64", "arm64")
    system = {"linux": "linux", "win32": "win", "darwin": "darwin"}.get(sys.platform, sys.platform)
    return f"aarch64-{'windows' if system == 'win' else system}" if arm else f"{system}64"


@dataclass(frozen=True)
class Build:
    """Content of an FMU's buildDescription.xml."""

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
    """Refuse early a build without the compiler."""
    if importlib.util.find_spec("ziglang") is None:
        raise Error(
            "binaries of other platforms are compiled by the Python package ziglang, which is not installed: "
            "run 'scripts/setup.sh platforms', or install the extra 'platforms'"
        )


def compile_for(platform: Platform, sources: Path, cache: Path, fmi: str = "2") -> bytes:
    """Return the binary of a platform, compiled from the sources/ of an FMU for this
    version of FMI."""
    return join_slices([_compile(target, platform, sources, cache) for target in platform.compiled_for(fmi)])


def _compile(target: str, platform: Platform, sources: Path, cache: Path) -> bytes:
    build = read_build(sources)
    name = build.identifier + platform.suffix
    flags = [*build.flags, *SHARED, "-I."]
    if platform.suffix == ".dylib":  # else the path of the temporary folder would be written into it
        flags.append(f"-Wl,-install_name,@rpath/{name}")
    with tempfile.TemporaryDirectory() as folder:
        binary = Path(folder) / name  # a DLL carries the name it was linked with
        try:
            run_zig(["-target", target, *flags, *build.sources, "-o", str(binary)], sources, cache)
        except Error as error:
            raise Error(f"{build.identifier} does not compile for {platform.name}: {error}") from None
        return binary.read_bytes()


def run_zig(arguments: Sequence[str], folder: Path, cache: Path) -> None:
    """Run the C compiler of ziglang in a folder. `cache` keeps the C libraries of
    other platforms, which take a minute to build."""
    command = [sys.executable, "-m", "ziglang", "cc", *arguments]
    environment = {**os.environ, "ZIG_GLOBAL_CACHE_DIR": str(cache), "ZIG_LOCAL_CACHE_DIR": str(cache)}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, errors="replace"
    )
    if done.returncode:
        raise Error(f"zig cc says\n{done.stderr.strip()[-2000:]}")


FAT_MAGIC = 0xCAFEBABE  # big-endian
MACHO_64 = 0xFEEDFACF  # of the machine: little-endian for both
PAGE_BITS = {0x01000007: 12, 0x0100000C: 14}  # x86_64, arm64: a slice starts at a page


def join_slices(slices: Iterable[bytes]) -> bytes:
    """Return Mach-O files of several processors as one, as lipo joins them; a single
    one as it is."""
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
EPOCH = (1980, 1, 1, 0, 0, 0)  # the first date that a zip file knows


@dataclass(frozen=True)
class Built:
    """A file that was written, and what binaries are in it."""

    path: Path
    binaries: dict[str, int]  # platform -> bytes


def find_checkout() -> Path:
    """Return the checkout that this package belongs to."""
    root = Path(__file__).resolve().parents[2]
    if not (root / "CMakePresets.json").is_file() or not (root / "fmu").is_dir():
        raise Error(
            "'tselab fmu build' compiles the checkout that tselab is part of; this tselab was installed "
            "without one"
        )
    return root


def read_version(name: str) -> str:
    """Return the version of FMI of an FMU of this checkout, by its name: X is for 2.0,
    X-fmi3 for 3.0."""
    return "3" if name.endswith("-fmi3") else "2"


def build(
    out: Path,
    wanted: Sequence[str],
    max_particles: int | None,
    say: Say,
    real: str = "double",
    fmi: Sequence[str] = FMI,
) -> list[Built]:
    """Build, and write the FMUs for these versions of FMI, and for 2.0 the systems, to
    `out` once all of it has gone well."""
    root = find_checkout()
    if wanted:
        check_compiler()
    stage = build_native(root, max_particles, say, real)
    there = {p.parent.name: p.parent for p in sorted(stage.glob("*/modelDescription.xml"))}
    fmus = {name: folder for name, folder in there.items() if read_version(name) in fmi}
    if lacking := [v for v in fmi if not any(read_version(name) == v for name in fmus)]:
        raise Error(
            f"the FMI {lacking[0]}.0 headers are not in .venv/share: run scripts/setup.sh, or ask for --fmi 2"
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
    """Run the preset `fmu`. Return the folder with the content of the FMUs."""
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
    """Return the lock of processes that build in a folder; beside it, since the folder
    may be removed."""
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
                f"the FMUs do not build: {' '.join(step[:3])} "
                f"says\n{(done.stdout + done.stderr).strip()[-3000:]}"
            )


def _remove_foreign(folder: Path, root: Path) -> None:
    """Remove a build folder of a checkout that was copied or moved: its paths are
    wrong."""
    cache = folder / "CMakeCache.txt"
    if cache.is_file() and f"CMAKE_HOME_DIRECTORY:INTERNAL={root}\n" not in cache.read_text(errors="replace"):
        shutil.rmtree(folder)


def pack(path: Path, files: Mapping[str, bytes]) -> None:
    """Write a zip file with the same bytes for the same content: sorted names, one
    date."""
    with write_atomically(path, "wb") as out, zipfile.ZipFile(out, "w") as file:
        for name in sorted(files):
            info = zipfile.ZipInfo(name, EPOCH)
            info.create_system = 3  # Unix, wherever it is packed
            info.external_attr = (0o100755 if name.endswith((".so", ".dll", ".dylib")) else 0o100644) << 16
            file.writestr(info, files[name], zipfile.ZIP_DEFLATED, 9)


def read_content(folder: Path) -> dict[str, bytes]:
    """Return all files below a folder by their name in the archive."""
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }
