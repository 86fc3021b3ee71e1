"""FMU and SSP files: opening anybody's, packing our own."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from tselab.errors import UserError
from tselab.files import atomic

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

EPOCH = (1980, 1, 1, 0, 0, 0)  # the first date that a zip file knows
SUFFIXES = (".so", ".dll", ".dylib")


def need_fmpy() -> None:
    """FMPy is an extra: say how it is had."""
    try:
        import fmpy  # noqa: F401
    except ImportError:
        raise UserError("FMPy is not installed: run scripts/setup.sh, or install the extra 'fmu'") from None


@dataclass(frozen=True)
class Archive:
    """An FMU file: its path, and the names in it."""

    path: Path
    names: tuple[str, ...]

    @property
    def binaries(self) -> dict[str, list[str]]:
        """Platform -> its binaries."""
        found: dict[str, list[str]] = {}
        for name in self.names:
            parts = PurePosixPath(name).parts
            if len(parts) >= 3 and parts[0] == "binaries" and name.endswith(SUFFIXES):
                found.setdefault(parts[1], []).append(name)
        return found

    def read(self, name: str) -> bytes:
        with zipfile.ZipFile(self.path) as file:
            return file.read(name)


def open_archive(path: Path) -> Archive:
    """An FMU as far as every importer must be able to read it."""
    path = Path(path)
    if path.is_dir():
        raise UserError(f"{path}: is a directory, not an FMU")
    try:
        with zipfile.ZipFile(path) as file:
            broken = file.testzip()
            names = tuple(i.filename for i in file.infolist() if not i.is_dir())
    except FileNotFoundError:
        raise UserError(f"{path}: no such file") from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, ValueError) as error:
        raise UserError(f"{path}: is not an FMU: {error}") from None
    if broken:
        raise UserError(f"{path}: is damaged: the checksum of {broken} differs")
    if "modelDescription.xml" not in names:
        raise UserError(f"{path}: is not an FMU: there is no modelDescription.xml in it")
    return Archive(path, names)


def read_description(path: Path) -> ModelDescription:
    """Its model description, for who wants to run it; validators have more to say of it."""
    need_fmpy()
    from fmpy import read_model_description

    try:
        return read_model_description(str(path), validate=False)
    except Exception as error:  # whatever a parser says of whatever stands there
        raise UserError(f"{path}: modelDescription.xml cannot be read: {error}") from None


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """The content of an FMU in a temporary folder."""
    with tempfile.TemporaryDirectory(prefix="tselab-fmu-", ignore_cleanup_errors=True) as folder:
        with zipfile.ZipFile(path) as file:
            file.extractall(folder)
        yield Path(folder)


def pack(path: Path, files: Mapping[str, bytes]) -> None:
    """A zip file with the same bytes for the same content: sorted names, one date."""
    with atomic(path, "wb") as out, zipfile.ZipFile(out, "w") as file:
        for name in sorted(files):
            info = zipfile.ZipInfo(name, EPOCH)
            info.create_system = 3  # Unix, wherever it is packed
            info.external_attr = (0o100755 if name.endswith(SUFFIXES) else 0o100644) << 16
            file.writestr(info, files[name], zipfile.ZIP_DEFLATED, 9)


def content(folder: Path) -> dict[str, bytes]:
    """All files below a folder by their name in the archive."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
