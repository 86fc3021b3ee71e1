"""The default filter of an earlier commit, to run beside today's on the same data in the same process: its library is built
from this repository's history into build/landed."""

from __future__ import annotations

import functools
import io
import shutil
import subprocess
import tarfile
import tempfile
from collections.abc import Mapping
from pathlib import Path

from tselab.core import Config, Library, library_path
from tselab.errors import UserError
from tselab.files import alone

LANDED = "10299f02040706499712295df39c3c0884dc93e4"  # the last commit whose default is the marginalised particle filter
ROOT = Path(__file__).resolve().parents[3]
SOURCES = ("CMakeLists.txt", "cmake", "include", "src")
OPTIONS = ("-DCMAKE_BUILD_TYPE=Release", "-DBUILD_SHARED_LIBS=ON", "-DTSE_MAX_PARTICLES=4096", "-DTSE_BUILD_TESTS=OFF",
           "-DTSE_BUILD_FMU=OFF", "-DTSE_WERROR=OFF")  # as the preset lab # fmt: skip


@functools.cache
def library() -> Library:
    """The library of LANDED, built once."""
    folder = ROOT / "build" / "landed"
    path = folder / LANDED[:12] / library_path().name
    with alone(folder / "lock"):
        if not path.is_file():
            _build(path)
    return Library(path)


def _build(path: Path) -> None:
    archive = _output("git", "-C", ROOT, "archive", "--format=tar", LANDED, *SOURCES)
    with tempfile.TemporaryDirectory(prefix="making-", dir=path.parent.parent) as scratch:
        source, build = Path(scratch) / "source", Path(scratch) / "build"
        with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
            tar.extractall(source, **({"filter": "data"} if hasattr(tarfile, "data_filter") else {}))
        _output("cmake", "-S", source, "-B", build, *OPTIONS)
        _output("cmake", "--build", build, "--config", "Release", "--parallel", "2")
        found = next((f for f in build.rglob(path.name) if f.is_file()), None)
        if found is None:
            raise UserError(f"the estimator 'landed': its build of commit {LANDED[:12]} made no {path.name}")
        path.parent.mkdir(exist_ok=True)
        made = Path(scratch) / path.name
        shutil.copy(found, made)  # not a link
        made.replace(path)


def _output(*command: object) -> bytes:
    try:
        return subprocess.run([str(c) for c in command], check=True, capture_output=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        said = getattr(error, "stderr", b"").decode(errors="replace").strip().splitlines() or [str(error)]
        raise UserError(
            f"the estimator 'landed' is built from commit {LANDED[:12]} of this repository's history, and {command[0]} failed: "
            f"{said[-1]}. It needs git, cmake, a C compiler and a clone with its history (git fetch --unshallow)."
        ) from None


def configure(settings: Mapping[str, float]) -> Config:
    """Its settings: those of `settings` that it has; what came later is ignored."""
    config = Config(lib=library())
    for name, value in settings.items():
        if name in config:
            config.set(name, value)
    return config
