"""Write files completely or not at all, seal what a later run goes on from, read TOML with errors that name the file."""

import contextlib
import errno
import functools
import hashlib
import hmac
import json
import os
import re
import secrets
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from tse.library.errors import NoFile, UserError

fcntl: Any
try:
    import fcntl
except ImportError:  # Windows has none
    fcntl = None

# What a disk, a quota, a limit of the shell or a device says when it takes no more: the user's to mend, not ours.
WRITE_ERRORS = {
    getattr(errno, name) for name in ("ENOSPC", "EDQUOT", "EFBIG", "EIO", "EROFS") if hasattr(errno, name)
}


def explain_write_error(error: BaseException) -> str:
    """Why nothing could be written, in words; empty if the error is another."""
    return error.strerror or str(error) if isinstance(error, OSError) and error.errno in WRITE_ERRORS else ""


def resolve_path(path: Path) -> Path:
    """Where a path leads, as Path.resolve(), but also for links that lead in a circle: opening it says so."""
    return Path(os.path.realpath(path))


def check_directory(out: Path) -> None:
    """Refuse early a directory for results that is a file."""
    if out.exists() and not out.is_dir():
        raise UserError(f"{out}: is a file, a directory is needed")


def make_directory(out: Path) -> None:
    """Make a directory for results, with those above it; one that is there stays."""
    check_directory(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"{out}: cannot be made: {error.strerror}") from None


@contextmanager
def write_atomically(path: Path, mode: str = "w") -> Iterator[IO]:
    """A file that takes the place of `path` when the block ends well and the disk has it; else `path` stays as it was. A link is
    replaced itself, not what it leads to, which may be somebody else's; who may read and write it stays."""
    path = Path(path)
    try:
        with _write_new(path, mode) as file:
            yield file
    except OSError as error:
        reason = explain_write_error(error)
        if error.errno is None and not isinstance(
            error, ValueError
        ):  # packages that write pictures keep no number of it
            reason = str(error)
        if reason:
            raise UserError(f"{path}: cannot be written: {reason}; nothing of it is kept") from error
        raise


PART_SUFFIX = ".part"  # the end of the name of a file that is being written
MIN_PART_AGE = 60.0  # s old that such a file is, at least, to be taken for one that a process left behind


def _lock_handle(handle: int) -> bool:
    """Let nobody else hold this open file; False: somebody does. A process that is killed lets go."""
    if fcntl is None:  # Windows removes no file that is open
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in (errno.EWOULDBLOCK, errno.EACCES)  # a file system that knows no locks
    return True


@functools.lru_cache(maxsize=4096)
def _list_parts(folder: Path) -> tuple[str, ...]:
    """Files that were being written in a folder when this process first looked there."""
    try:
        return tuple(n for n in os.listdir(folder) if n.startswith(".") and n.endswith(PART_SUFFIX))
    except OSError:
        return ()


def _remove_stale_parts(path: Path) -> None:
    """Remove what a process that was killed has left of this file."""
    own = re.compile(rf"\.{re.escape(path.name)}\.[a-z0-9_]{{8}}{re.escape(PART_SUFFIX)}")
    for left in (path.parent / n for n in _list_parts(path.parent) if own.fullmatch(n)):
        with contextlib.suppress(OSError):
            if not left.is_symlink() and time.time() - left.stat().st_mtime > MIN_PART_AGE:
                with open(left, "rb") as file:
                    held = _lock_handle(file.fileno())
                if held:
                    left.unlink()


@contextmanager
def _write_new(path: Path, mode: str) -> Iterator[IO]:
    if path.exists() and not path.is_file():  # a pipe or device: nothing to rename over
        with open(path, mode, encoding=None if "b" in mode else "utf-8") as file:
            yield file
        return
    _remove_stale_parts(path)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=PART_SUFFIX, dir=path.parent)
    except OSError as error:
        raise UserError(f"{path}: cannot be written: {error.strerror}") from None
    try:
        with os.fdopen(
            handle, mode, encoding=None if "b" in mode else "utf-8", newline=None if "b" in mode else ""
        ) as f:
            _lock_handle(f.fileno())
            yield f
            f.flush()
            os.fsync(
                f.fileno()
            )  # before the new name: else a power cut can leave the name without the content
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(name, path.stat().st_mode & 0o7777 if path.exists() else 0o666 & ~umask)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    """The new name itself. Not every system or file system can; the content is safe then, and the name follows."""
    if sys.platform == "win32":
        return
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    except OSError:
        pass
    finally:
        os.close(handle)


@contextmanager
def lock_file(path: Path) -> Iterator[None]:
    """One process at a time is in the block that a lock file guards; others wait. A process that is killed lets go, too."""
    from filelock import FileLock  # a filter for rows that come one at a time needs numpy alone

    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(path):
        yield


def check_writable(*paths: Path | None) -> None:
    """Refuse early, before any long work, what cannot be written; None is not asked for."""
    for path in (p for p in paths if p is not None):
        if path.is_dir():
            raise UserError(f"{path}: is a directory, a file name is needed")
        if not path.parent.is_dir():
            raise UserError(f"{path}: the directory {path.parent} does not exist")
        if not os.access(path.parent, os.W_OK):
            raise UserError(f"{path}: the directory {path.parent} is not writable")


def check_distinct(outputs: dict[str, Path | None], inputs: dict[str, Path | None]) -> None:
    """No output may overwrite an input or another output, under whatever name: links are looked through, hard ones, too."""
    seen = {key: what for what, p in inputs.items() if p is not None for key in _identify(Path(p))}
    for what, path in outputs.items():
        if path is None:
            continue
        keys = _identify(Path(path))
        if same := next((seen[key] for key in keys if key in seen), None):
            raise UserError(f"{path}: {what} is the same file as {same}")
        seen.update(dict.fromkeys(keys, what))


def _identify(path: Path) -> list[object]:
    """Under what a file is known: its path, and where it is there its place on the disk."""
    keys: list[object] = [resolve_path(path)]
    try:
        found = path.stat()
    except OSError:
        return keys
    return [*keys, (found.st_dev, found.st_ino)] if found.st_ino else keys


def is_parquet(path: Path | None) -> bool:
    """Is a table of that name Parquet? Else it is CSV."""
    return path is not None and path.suffix.lower() in (".parquet", ".pq")


# ---- What a run leaves for the next one of the same user is sealed: a digest with a secret that stays in the user's own
# folder. So a result folder from a stranger, whatever keys and checksums are in it, is never gone on from.

SECRET_BYTES = 32  # of the secret


def compute_seal(content: Any) -> str:
    """The digest of what JSON can say."""
    return hashlib.blake2b(json.dumps(content, sort_keys=True).encode(), key=load_secret()).hexdigest()


def write_sealed(path: Path, content: Any) -> None:
    """Keep what JSON can say: numbers and words, nothing that could run."""
    with write_atomically(path) as file:
        json.dump({"content": content, "seal": compute_seal(content)}, file)


def read_sealed(path: Path) -> Any:
    """Return what was kept; None where there is nothing, or what is there is of somebody else, or broken."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        content = kept["content"]
        return (
            content
            if hmac.compare_digest(str(kept["seal"]).encode(), compute_seal(content).encode())
            else None
        )
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None


@functools.cache
def load_secret() -> bytes:
    """Made once for each user. Where no folder can hold it each process has its own, and goes on from nothing."""
    home = (
        os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".local" / "state"
    )
    path = Path(home) / "tselab" / "seal.key"
    with contextlib.suppress(OSError, RuntimeError):  # RuntimeError: there is no home
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            handle, name = tempfile.mkstemp(dir=path.parent)  # for nobody else to read
            with os.fdopen(handle, "wb") as file:
                file.write(secrets.token_bytes(SECRET_BYTES))
            try:
                os.link(name, path)  # the first of several processes; whole, or not there
            except FileExistsError:
                pass
            finally:
                os.unlink(name)
        if len(found := path.read_bytes()) == SECRET_BYTES:
            return found
    return secrets.token_bytes(SECRET_BYTES)


# ---- TOML

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

parse_toml = tomllib.loads

INTEGER_LIMIT = 1 << 63  # what TOML asks of a reader; Python's integers go on, and are no settings then


MAX_TOML_BYTES = 16 << 20  # bytes; a signals.toml of 10 000 channels has 1 MB
MAX_TOML_DEPTH = 64  # tables in tables


def check_regular(path: Path, most: int, what: str) -> None:
    """Refuse, before it is read, what is no regular file, or far too large for what it should be.

    Parameters
    ----------
    path : Path
        What is to be read. One that is not there passes: who opens it says so.
    most : int
        Bytes that it may have.
    what : str
        What is needed there, for the message: "a TOML file".

    Raises
    ------
    UserError
        It is a device or a pipe, or has more bytes.
    """
    try:
        found = Path(path).stat()
    except (OSError, ValueError):
        return
    if stat.S_ISDIR(found.st_mode):
        return
    if not stat.S_ISREG(found.st_mode):
        raise UserError(f"{path}: is a device or a pipe, {what} is needed")
    if found.st_size > most:
        raise UserError(f"{path}: has {found.st_size >> 20:,} MB; {what} of up to {most >> 20} MB is read")


def read_toml(path: Path) -> dict[str, Any]:
    """Return what a TOML file says. UserError: it is none, is no regular file, or is nested too deeply."""
    check_regular(path, MAX_TOML_BYTES, "a TOML file")
    try:
        data = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise NoFile(f"{path}: no such file") from None
    except IsADirectoryError:
        raise UserError(f"{path}: is a directory, a TOML file is needed") from None
    except UnicodeDecodeError:
        raise UserError(f"{path}: is not a text file in UTF-8; a TOML file is needed") from None
    except ValueError as error:  # TOMLDecodeError is one; so are Python's limits on digits and dates
        raise UserError(f"{path}: is not valid TOML: {error}{_hint_at_table(Path(path))}") from None
    except RecursionError:
        raise UserError(f"{path}: is not valid TOML: nested too deeply") from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    _check_values(path, data, "", 0)
    return data


def _hint_at_table(path: Path) -> str:
    """What to say of a file whose first line names columns."""
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        line = file.readline(65536)
    cells = max(line.count(c) for c in ",;\t") + 1
    return (
        f"\n  it is a table of {cells} columns: a log in the place of a TOML file?"
        if cells > 3 and "=" not in line
        else ""
    )


def _check_values(path: Path, value: Any, key: str, depth: int) -> None:
    if isinstance(value, int) and not -INTEGER_LIMIT <= value < INTEGER_LIMIT:
        raise UserError(f"{path}: is not valid TOML: key {key[:200]}: an integer has at most 64 bits")
    if depth > MAX_TOML_DEPTH:
        raise UserError(
            f"{path}: is not valid TOML: key {key[:40]} ...: tables are nested more than {MAX_TOML_DEPTH} deep"
        )
    for name, part in (
        value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    ):
        _check_values(path, part, f"{key}.{name}" if key else str(name), depth + 1)
