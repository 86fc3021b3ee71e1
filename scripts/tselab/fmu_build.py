"""Building the FMUs of this checkout: natively by CMake, for other platforms from the sources that each FMU carries."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tse.impl.errors import UserError
from tse.impl.files import alone, atomic
from tselab import fmu_platforms as platforms
from tselab.fmu_platforms import FMI, PLATFORMS, read_build

Say = Callable[[str], None]
EPOCH = (1980, 1, 1, 0, 0, 0)  # the first date that a zip file knows


@dataclass(frozen=True)
class Built:
    """A file that was written, and what binaries are in it."""

    path: Path
    binaries: dict[str, int]  # platform -> bytes


def checkout() -> Path:
    """The checkout that this package belongs to."""
    root = Path(__file__).resolve().parents[2]
    if not (root / "CMakePresets.json").is_file() or not (root / "fmu").is_dir():
        raise UserError(
            "'tselab fmu build' compiles the checkout that tselab is part of; this tselab was installed without one"
        )
    return root


def version_of(name: str) -> str:
    """The version of FMI that an FMU of this checkout is for, by its name: X is of 2.0, X-fmi3 of 3.0."""
    return "3" if name.endswith("-fmi3") else "2"


def build(
    out: Path,
    wanted: Sequence[str],
    max_particles: int | None,
    say: Say,
    real: str = "double",
    fmi: Sequence[str] = FMI,
) -> list[Built]:
    """Build, and write the FMUs for these versions of FMI, and for 2.0 the systems, to `out` once all of it has gone well."""
    root = checkout()
    if wanted:
        platforms.check_compiler()
    stage = build_native(root, max_particles, say, real)
    there = {p.parent.name: p.parent for p in sorted(stage.glob("*/modelDescription.xml"))}
    fmus = {name: folder for name, folder in there.items() if version_of(name) in fmi}
    if lacking := [v for v in fmi if not any(version_of(name) == v for name in fmus)]:
        raise UserError(
            f"the FMI {lacking[0]}.0 headers are not in .venv/share: run scripts/setup.sh, or ask for --fmi 2"
        )
    files = {name: content(folder) for name, folder in fmus.items()}
    for name, folder in fmus.items():
        for platform in wanted:
            start = time.monotonic()
            to = PLATFORMS[platform]
            binary = platforms.compile_for(to, folder / "sources", root / "build" / "zig-cache", version_of(name))
            identifier = read_build(folder / "sources").identifier
            files[name][f"binaries/{to.folder(version_of(name))}/{identifier}{to.suffix}"] = binary
            say(f"{name} for {platform}: {len(binary):,} bytes, {time.monotonic() - start:.0f} s")
    out.mkdir(parents=True, exist_ok=True)
    built = []
    for name, inside in files.items():
        pack(out / f"{name}.fmu", inside)
        sizes = {n.split("/")[1]: len(b) for n, b in inside.items() if n.startswith("binaries/")}
        built.append(Built(out / f"{name}.fmu", sizes))
    for system in sorted(stage.glob("*/SystemStructure.ssd")) if "2" in fmi else ():
        parts = {
            f"resources/{name}.fmu": (out / f"{name}.fmu").read_bytes() for name in files if version_of(name) == "2"
        }
        parts |= {f"resources/{p.name}": p.read_bytes() for p in sorted((system.parent / "resources").glob("*.ssv"))}
        pack(out / f"{system.parent.name}.ssp", {"SystemStructure.ssd": system.read_bytes(), **parts})
        built.append(Built(out / f"{system.parent.name}.ssp", {}))
    return built


def build_native(root: Path, max_particles: int | None, say: Say, real: str = "double") -> Path:
    """Run the preset `fmu`; the folder in which the FMUs are laid out."""
    if shutil.which("cmake") is None:
        raise UserError("cmake is not installed: version 3.21 or later is needed")
    kind = ["fmu", *([str(max_particles)] if max_particles is not None else []), *([real] if real != "double" else [])]
    folder = root / "build" / "-".join(kind)
    with alone(lock_of(folder)):
        _build_native(root, folder, max_particles, real, say)
    return folder / "fmu"


def lock_of(folder: Path) -> Path:
    """What two processes that build in a folder take; beside it, because the folder itself may be removed."""
    return folder.with_name(f"{folder.name}.lock")


def _build_native(root: Path, folder: Path, max_particles: int | None, real: str, say: Say) -> None:
    _forget_foreign(folder, root)
    command = ["cmake", "--preset", "fmu", "-B", str(folder), f"-DTSE_REAL={real}"]
    if not (folder / "CMakeCache.txt").is_file() and "CMAKE_GENERATOR" not in os.environ and shutil.which("ninja"):
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
            raise UserError(
                f"the FMUs do not build: {' '.join(step[:3])} says\n{(done.stdout + done.stderr).strip()[-3000:]}"
            )


def _forget_foreign(folder: Path, root: Path) -> None:
    """A build folder of a checkout that was copied or moved knows the wrong paths."""
    cache = folder / "CMakeCache.txt"
    if cache.is_file() and f"CMAKE_HOME_DIRECTORY:INTERNAL={root}\n" not in cache.read_text(errors="replace"):
        shutil.rmtree(folder)


def pack(path: Path, files: Mapping[str, bytes]) -> None:
    """A zip file with the same bytes for the same content: sorted names, one date."""
    with atomic(path, "wb") as out, zipfile.ZipFile(out, "w") as file:
        for name in sorted(files):
            info = zipfile.ZipInfo(name, EPOCH)
            info.create_system = 3  # Unix, wherever it is packed
            info.external_attr = (0o100755 if name.endswith((".so", ".dll", ".dylib")) else 0o100644) << 16
            file.writestr(info, files[name], zipfile.ZIP_DEFLATED, 9)


def content(folder: Path) -> dict[str, bytes]:
    """All files below a folder by their name in the archive."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
