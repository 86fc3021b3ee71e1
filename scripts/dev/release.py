"""Make the files of a release from the last commit.

scripts/dev/release.sh calls this script after it has installed the tools.

    scripts/dev/release.sh 0.2.0
        make all parts in release/0.2.0
    scripts/dev/release.sh 0.2.0 --only wheels --platforms win_amd64
        make some parts
    scripts/dev/release.sh 0.2.0 --twice
        make the release twice in two folders, and compare them byte by byte

The same commit and the same tools (scripts/lock-release.txt) give the same bytes. For
this, the commit is exported to a new folder, the files in archives have the time of the
commit and no owner, and zig compiles every library.
"""

import argparse
import gzip
import hashlib
import io
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WHEELS = {  # key: platform tag of a wheel; value: name of this platform for zig
    "manylinux_2_17_x86_64.manylinux2014_x86_64": "x86_64-linux-gnu.2.17",
    "manylinux_2_17_aarch64.manylinux2014_aarch64": "aarch64-linux-gnu.2.17",
    "win_amd64": "x86_64-windows-gnu",
    "macosx_11_0_x86_64": "x86_64-macos.11.0",
    "macosx_11_0_arm64": "aarch64-macos.11.0",
}
SUMS = "SHA256SUMS"


class Failed(Exception):
    """The release cannot be made. The message is the reason."""


@dataclass
class Release:
    """A release that is being made."""

    version: str
    commit: str  # hash of the commit
    epoch: int  # [s] time of the commit, since 1970
    source: Path  # folder with the exported commit
    out: Path  # folder for the files of the release
    tags: Sequence[str]  # platform tags of the wheels to build

    def run(self, *command: str | Path, cwd: Path | None = None, **environment: str) -> str:
        """Run a command in the folder `cwd`. Return its output.

        `cwd`: None is the folder of the exported commit. `environment`: more variables.
        The environment of the command has SOURCE_DATE_EPOCH, so that tools write the time
        of the commit into files. It lacks CMAKE_*, SKBUILD_*, CFLAGS* and LDFLAGS* of the
        caller, because these would change a build.

        Raises
        ------
        Failed
            The exit code is not 0.
        """
        # The cache of zig is not in the exported folder, so that later releases use it
        # again. Without it, zig needs a minute to compile the C library of a platform.
        cache = str(ROOT / "build" / "zig-cache")
        env = {
            k: v
            for k, v in os.environ.items()
            if not k.startswith(("CMAKE_", "SKBUILD_", "CFLAGS", "LDFLAGS"))
        }
        env |= {
            "SOURCE_DATE_EPOCH": str(self.epoch),
            "ZIG_GLOBAL_CACHE_DIR": cache,
            "ZIG_LOCAL_CACHE_DIR": cache,
            "TZ": "UTC",
        }
        done = subprocess.run(
            [str(c) for c in command],
            cwd=cwd or self.source,
            env=env | environment,
            capture_output=True,
            text=True,
            errors="replace",
        )
        if done.returncode:
            raise Failed(
                f"{' '.join(str(c) for c in command[:6])} failed:\n{(done.stdout + done.stderr)[-3000:]}"
            )
        return done.stdout

    def pack_folder(self, name: str, folder: Path, top: str) -> None:
        """Write the files of a folder to the archive `name`, a .tar.gz.

        In the archive, all files are in the folder `top`. The same files give the same
        bytes."""
        packed = io.BytesIO()
        with tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as tar:
            for path in sorted(p for p in folder.rglob("*") if p.is_file()):
                info = tarfile.TarInfo(f"{top}/{path.relative_to(folder).as_posix()}")
                info.size, info.mtime = path.stat().st_size, self.epoch
                info.mode = 0o755 if os.access(path, os.X_OK) else 0o644
                with path.open("rb") as file:
                    tar.addfile(info, file)
        with (self.out / name).open("wb") as file, gzip.GzipFile("", "wb", 9, file, self.epoch) as zipped:
            zipped.write(packed.getvalue())


# ---- parts


def pack_source(r: Release) -> None:
    """Pack all files of the commit: sources of the C library and FMUs, CMake, tests."""
    r.pack_folder(f"tse-{r.version}-source.tar.gz", r.source, f"tse-{r.version}-source")


def build_sdist(r: Release) -> None:
    """Build the Python source package. pip compiles it if no wheel fits the system."""
    r.run(sys.executable, "-m", "build", "--sdist", "--no-isolation", "--outdir", r.out, r.source)


def build_wheels(r: Release) -> None:
    """Build a wheel for each platform, with the C library that zig compiles for it."""
    import ziglang

    zig = Path(ziglang.__file__).parent / "zig"
    for tag in r.tags:
        made = r.source.parent / "wheel" / tag
        r.run(
            sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", made,
            "-C", f"build-dir={made / 'build'}",
            "-C", f"cmake.define.CMAKE_TOOLCHAIN_FILE={r.source / 'cmake' / 'zig.cmake'}",
            "-C", f"cmake.define.TSE_ZIG={zig}",
            "-C", f"cmake.define.TSE_ZIG_TARGET={WHEELS[tag]}",
            r.source,
        )  # fmt: skip
        (wheel,) = made.glob("*.whl")
        r.run(sys.executable, "-m", "wheel", "tags", "--remove", "--platform-tag", tag, wheel)
        (wheel,) = made.glob("*.whl")
        shutil.move(wheel, r.out / wheel.name)


def build_fmus(r: Release) -> None:
    """Build the FMUs with binaries for all platforms, and the SSP that connects them."""
    link_headers(r)
    r.run(sys.executable, "-m", "tselab", "fmu", "build", "--all-platforms", "--out", r.out,
          PYTHONPATH=str(r.source / "scripts"))  # fmt: skip


def link_headers(r: Release) -> None:
    """Link .venv and the cache of zig into the folder of the exported commit.

    The exported folder has only the files in git. The build needs the headers of FMI,
    which scripts/setup.sh has fetched to .venv. With the cache, zig need not compile the
    C library of each platform again."""
    (r.source / "build").mkdir(exist_ok=True)
    for name in (".venv", "build/zig-cache"):
        (ROOT / name).mkdir(parents=True, exist_ok=True)
        if not (r.source / name).exists():
            (r.source / name).symlink_to(ROOT / name)


def pack_amalgamation(r: Release) -> None:
    """Pack the C library as two files, tse.h and tse.c."""
    script = r.source / "scripts" / "dev" / "amalgamate.py"
    folder = r.source.parent / "amalgamation"
    r.run(sys.executable, script, "--out", folder / "tse")
    r.pack_folder(f"tse-{r.version}-amalgamation.tar.gz", folder, f"tse-{r.version}")


def build_site(r: Release) -> None:
    """Build the offline documentation site, with the web page that runs the filter."""
    link_headers(r)
    r.run("cmake", "--preset", "lab")
    r.run("cmake", "--build", "--preset", "lab")
    (r.source / "scripts" / "tse" / "library" / "lib").mkdir(exist_ok=True)
    for made in (r.source / "build" / "lab" / "src").glob("libtse.[sd][oy]*"):
        if made.suffix in (".so", ".dylib"):
            shutil.copy(made.resolve(), r.source / "scripts" / "tse" / "library" / "lib" / made.name)
    r.run("bash", r.source / "scripts" / "dev" / "docs.sh", TSE_DOCS_PYTHON=sys.executable)
    r.pack_folder(f"tse-{r.version}-site.tar.gz", r.source / "build" / "site", f"tse-{r.version}-site")


def write_sbom(r: Release) -> None:
    """Write the software bill of materials: files and required packages (CycloneDX)."""
    from sbom import format_json, make_bom

    files = {p.name: hash_file(p) for p in sorted(r.out.iterdir())}
    text = format_json(make_bom(r.source, r.version, r.epoch, files))
    (r.out / f"tse-{r.version}.cdx.json").write_text(text, encoding="utf-8")


PARTS: dict[str, Callable[[Release], None]] = {
    "source": pack_source,
    "sdist": build_sdist,
    "wheels": build_wheels,
    "fmus": build_fmus,
    "amalgamation": pack_amalgamation,
    "site": build_site,
    "sbom": write_sbom,
}


# ---- the whole release


def hash_file(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def run_git(*arguments: str) -> str:
    """Run git in the repository. Return its output.

    Raises
    ------
    Failed
        git is not installed, or the exit code of git is not 0.
    """
    try:
        done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True)
    except FileNotFoundError:
        raise Failed("git is not installed; a release needs it to export the commit") from None
    if done.returncode:
        raise Failed(f"git {' '.join(arguments)} failed:\n{done.stderr.strip()}")
    return done.stdout.strip()


def check_version(folder: Path, version: str) -> None:
    """Raise Failed if a file of the exported commit states a different version."""
    there = {
        "include/tse/version.h": r'#define TSE_VERSION "(.+)"',
        "scripts/tse/library/__init__.py": r'__version__ = "(.+?)"',
        "CITATION.cff": r'(?m)^version: "?([^"\n]+)"?$',
        "CHANGELOG.md": r"(?m)^## \[([\d.]+)\] - \d{4}-\d\d-\d\d$",
    }
    for name, pattern in there.items():
        found = re.search(pattern, (folder / name).read_text(encoding="utf-8"))
        if not found or found[1] != version:
            raise Failed(f"{name} says version {found[1] if found else '?'}, not {version}")


def make_release(
    version: str, out: Path, parts: Sequence[str], tags: Sequence[str], say: Callable[[str], None]
) -> Release:
    """Make a release from the last commit.

    Parameters
    ----------
    version : str
        Version that the sources must state.
    out : Path
        Folder for the files. An earlier release in it is deleted.
    parts : sequence of str
        Keys of PARTS.
    tags : sequence of str
        Keys of WHEELS.
    say : callable
        Called with the name of each part before it is made.
    """
    commit = run_git("rev-parse", "HEAD")
    (ROOT / "build").mkdir(exist_ok=True)
    # The temporary folder has a new name in each call. --twice therefore also checks that
    # no byte of the release depends on the folder.
    with tempfile.TemporaryDirectory(prefix="release-", dir=ROOT / "build") as work:
        export = Path(work) / "tse"
        export.mkdir()
        subprocess.run(f"git archive {commit} | tar -x -C '{export}'", shell=True, cwd=ROOT, check=True)
        check_version(export, version)
        empty_folder(out)
        release = Release(
            version, commit, int(run_git("log", "-1", "--format=%ct", commit)), export, out.resolve(), tags
        )
        for part in parts:
            say(part)
            PARTS[part](release)
    files = sorted(p for p in out.iterdir() if p.name != SUMS)
    (out / SUMS).write_text("".join(f"{hash_file(p)}  {p.name}\n" for p in files), encoding="utf-8")
    return release


def empty_folder(out: Path) -> None:
    """Make the folder `out`. If it exists and holds a release, delete the release.

    Raises
    ------
    Failed
        The folder has files, but not the list of hashes that each release has.
    """
    if out.exists() and any(out.iterdir()) and not (out / SUMS).is_file():
        raise Failed(
            f"{out} holds files, but no release ({SUMS} is missing): remove it, or name another folder"
        )
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)


def find_differing(first: Path, second: Path) -> list[str]:
    """Return the names of files that differ between two folders, or are in only one."""
    names = {p.name for p in first.iterdir()} | {p.name for p in second.iterdir()}
    missing = {n for n in names if not ((first / n).is_file() and (second / n).is_file())}
    return sorted(missing | {n for n in names - missing if hash_file(first / n) != hash_file(second / n)})


def main() -> int:
    """Make those parts of a release that the options name."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("version", nargs="?")
    parser.add_argument("--out", type=Path, help="folder; a release in it is deleted (release/VERSION)")
    parser.add_argument("--only", default=",".join(PARTS), help="parts to make, separated by commas (all)")
    parser.add_argument(
        "--platforms", default=",".join(WHEELS), help="platform tags of the wheels, separated by commas (all)"
    )
    parser.add_argument("--twice", action="store_true", help="make the release twice and compare the files")
    parser.add_argument("--list", action="store_true", help="print the parts and the platforms")
    args = parser.parse_args()
    if args.list:
        print("\n".join([*(f"{name:<13} {part.__doc__}" for name, part in PARTS.items()), "", *WHEELS]))
        return 0
    parts, tags = args.only.split(","), args.platforms.split(",")
    unknown = [x for x in parts if x not in PARTS] + [x for x in tags if x not in WHEELS]
    if not args.version or unknown:
        parser.error(
            f"unknown: {', '.join(unknown)}; --list prints all parts and platforms"
            if unknown
            else "VERSION is missing"
        )
    out = args.out or ROOT / "release" / args.version

    def say(text: str) -> None:
        print(f"release: {text}", flush=True)

    try:
        release = make_release(args.version, out, parts, tags, say)
        if args.twice:
            other = out.with_name(f"{out.name}-again")
            make_release(args.version, other, parts, tags, say)
            if differs := find_differing(out, other):
                raise Failed(f"two releases differ: {', '.join(differs)}")
            say("two releases are equal in all bytes")
    except Failed as error:
        print(f"release: {error}", file=sys.stderr)
        return 1
    if run_git("status", "--porcelain"):
        say("note: changes that are not committed are not in the release")
    print((out / SUMS).read_text(), end="")
    say(f"made {out} from commit {release.commit[:12]}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
