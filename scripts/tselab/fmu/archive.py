"""FMU and SSP files: open anybody's, pack our own."""

from __future__ import annotations

import lzma
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from tse.impl.errors import NoFile, UserError
from tse.impl.files import atomic

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription


EPOCH = (1980, 1, 1, 0, 0, 0)  # the first date that a zip file knows
# An FMU with binaries for all platforms has 60 files of 5 MB; tools pack tables of 100 MB, in which a byte may be packed 100 times.
MOST_FILES = 10_000
MOST_BYTES = 2 << 30  # of all files, unpacked
MOST_RATIO = 200  # of a file, unpacked over packed: deflate itself ends at 1032
SMALL = 1 << 20  # bytes; what is smaller may be packed as it will
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
            _check_contents(path, file.infolist())
            broken = file.testzip()
            names = tuple(i.filename for i in file.infolist() if not i.is_dir())
    except FileNotFoundError:
        raise NoFile(f"{path}: no such file") from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    except (
        zipfile.BadZipFile,
        zlib.error,
        lzma.LZMAError,
        NotImplementedError,
        RuntimeError,
        EOFError,
        ValueError,
    ) as error:
        raise UserError(f"{path}: is not an FMU: {error}") from None
    if broken:
        raise UserError(f"{path}: is damaged: the checksum of {broken} differs")
    if "modelDescription.xml" not in names:
        raise UserError(f"{path}: is not an FMU: there is no modelDescription.xml in it")
    return Archive(path, names)


def _check_contents(path: Path, members: list[zipfile.ZipInfo]) -> None:
    """Before a byte is unpacked: nothing that fills memory or disk, nothing that leaves the folder it is unpacked to. Who reads a
    member gets no more bytes than the directory says, so that its sizes can be relied on."""
    if len(members) > MOST_FILES:
        raise UserError(f"{path}: has {len(members)} files; allowed: up to {MOST_FILES}")
    if (total := sum(m.file_size for m in members)) > MOST_BYTES:
        raise UserError(f"{path}: is {total / 1e6:.0f} MB when unpacked; allowed: up to {MOST_BYTES / 1e6:.0f} MB")
    seen: set[str] = set()
    for member in members:
        name = member.orig_filename.split("\0", 1)[0]
        parts = name.replace("\\", "/").split("/")
        if name.startswith(("/", "\\")) or ".." in parts or ":" in parts[0] or name != member.orig_filename or not name:
            raise UserError(f"{path}: the name {member.orig_filename[:80]!r} in it leads out of the archive")
        if name in seen:
            raise UserError(f"{path}: {name[:80]!r} is in it twice")
        seen.add(name)
        if stat.S_IFMT(member.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise UserError(f"{path}: {name[:80]!r} in it is no file but a link or a device")
        if member.file_size > SMALL and member.file_size > MOST_RATIO * member.compress_size:
            raise UserError(
                f"{path}: {name[:80]!r} in it is {member.file_size / max(member.compress_size, 1):.0f} times larger when unpacked; "
                f"allowed: up to {MOST_RATIO} times"
            )


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
            _check_contents(path, file.infolist())  # again: who made it may have changed it
            try:
                file.extractall(folder)
            except OSError as error:  # a name that no file can have here, a folder where a file is, a full disk
                raise UserError(f"{path}: cannot be unpacked: {error.strerror}") from None
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
