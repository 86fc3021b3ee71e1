"""Write files completely or not at all; write and read sealed files, which have a keyed
digest, so that changes by others are found; read TOML."""

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
except ImportError:  # Windows
    fcntl = None

# codes of errors that the user can resolve: full or failed disk, quota, size limit,
# read-only disk
WRITE_ERRORS = {
    getattr(errno, name) for name in ("ENOSPC", "EDQUOT", "EFBIG", "EIO", "EROFS") if hasattr(errno, name)
}


def explain_write_error(error: BaseException) -> str:
    """Return the system's text of an error in WRITE_ERRORS; "" for any other error."""
    if isinstance(error, OSError) and error.errno in WRITE_ERRORS:
        return error.strerror or str(error)
    return ""


def resolve_path(path: Path) -> Path:
    """Return the path with its symbolic links resolved.

    Unlike Path.resolve(), raise no error for a loop of links. Opening the file raises
    it."""
    return Path(os.path.realpath(path))


def check_directory(out: Path) -> None:
    """Raise UserError if the directory for results is an existing file."""
    if out.exists() and not out.is_dir():
        raise UserError(f"{out}: is a file, a directory is needed")


def make_directory(out: Path) -> None:
    """Make a directory for results and its parents, if it does not exist."""
    check_directory(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"{out}: cannot be created: {error.strerror}") from None


@contextmanager
def write_atomically(path: Path, mode: str = "w") -> Iterator[IO]:
    """Yield a file that replaces `path` when the block ends without an error.

    After an error, `path` is unchanged. If `path` is a symbolic link, the file replaces
    the link and not its target, which may belong to a different user. The permissions of
    `path` are kept."""
    path = Path(path)
    try:
        with _write_new(path, mode) as file:
            yield file
    except OSError as error:
        reason = explain_write_error(error)
        # packages that write pictures raise an OSError without an error number
        if error.errno is None and not isinstance(error, ValueError):
            reason = str(error)
        if reason:
            raise UserError(f"{path}: cannot be written: {reason}; the unfinished file is deleted") from error
        raise


PART_SUFFIX = ".part"  # end of the name of an unfinished file
MIN_PART_AGE = 60.0  # [s] the next write deletes an older unfinished file, unless it is locked


def _lock_handle(handle: int) -> bool:
    """Lock an open file. Return False if a different process holds the lock.

    The operating system releases the lock of a killed process."""
    if fcntl is None:  # Windows needs no lock: it refuses to delete a file that is open
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        # any other error means that the file system has no locks
        return error.errno not in (errno.EWOULDBLOCK, errno.EACCES)
    return True


@functools.lru_cache(maxsize=4096)
def _list_parts(folder: Path) -> tuple[str, ...]:
    """Return the names of the unfinished files in a folder. Later calls for the folder
    return the cached result of the first."""
    try:
        return tuple(n for n in os.listdir(folder) if n.startswith(".") and n.endswith(PART_SUFFIX))
    except OSError:
        return ()


def _remove_stale_parts(path: Path) -> None:
    """Delete unfinished files that a killed process left when it wrote to `path`."""
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
    """Yield a new file in the folder of `path` and rename it to `path` at the end."""
    text = None if "b" in mode else "utf-8"
    if path.exists() and not path.is_file():  # a pipe or a device is written, not replaced
        with open(path, mode, encoding=text) as file:
            yield file
        return
    _remove_stale_parts(path)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=PART_SUFFIX, dir=path.parent)
    except OSError as error:
        raise UserError(f"{path}: cannot be written: {error.strerror}") from None
    try:
        with os.fdopen(handle, mode, encoding=text, newline=None if text is None else "") as f:
            _lock_handle(f.fileno())
            yield f
            # the content must reach the disk before the new name does: otherwise a power
            # failure can leave an empty file
            f.flush()
            os.fsync(f.fileno())
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(name, path.stat().st_mode & 0o7777 if path.exists() else 0o666 & ~umask)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    """Write the entries of a folder to the disk, so that a power failure does not undo
    the renaming of a file. Do nothing on Windows, which has no call for it."""
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
    """Hold the lock of the file `path` while the block runs.

    A second process waits until the lock is released. The operating system releases the
    lock of a killed process."""
    from filelock import FileLock  # imported here, because row-by-row estimation needs numpy only

    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(path):
        yield


def check_writable(*paths: Path | None) -> None:
    """Raise UserError if one of these files cannot be written. None is skipped.

    Commands call this before long work, whose result would otherwise be lost."""
    for path in (p for p in paths if p is not None):
        if path.is_dir():
            raise UserError(f"{path}: is a directory, a file name is needed")
        if not path.parent.is_dir():
            raise UserError(f"{path}: the directory {path.parent} does not exist")
        if not os.access(path.parent, os.W_OK):
            raise UserError(f"{path}: the directory {path.parent} is not writable")


def check_distinct(outputs: dict[str, Path | None], inputs: dict[str, Path | None]) -> None:
    """Raise UserError if an output is the same file as an input or as a second output.

    Symbolic and hard links are followed.

    Parameters
    ----------
    outputs : dict of str to Path or None
        Files to write. Keys are names for the message. None is skipped.
    inputs : dict of str to Path or None
        Files to read, in the same form.
    """
    seen = {key: what for what, p in inputs.items() if p is not None for key in _identify(Path(p))}
    for what, path in outputs.items():
        if path is None:
            continue
        keys = _identify(Path(path))
        if same := next((seen[key] for key in keys if key in seen), None):
            raise UserError(f"{path}: {what} is the same file as {same}")
        seen.update(dict.fromkeys(keys, what))


def _identify(path: Path) -> list[object]:
    """Return keys of a file: its resolved path and, if the file exists, the pair of its
    device and inode.

    If two paths have a key in common, they are the same file."""
    keys: list[object] = [resolve_path(path)]
    try:
        found = path.stat()
    except OSError:
        return keys
    return [*keys, (found.st_dev, found.st_ino)] if found.st_ino else keys


def is_parquet(path: Path | None) -> bool:
    """Return True if the suffix is that of Parquet. Any other table is a CSV."""
    return path is not None and path.suffix.lower() in (".parquet", ".pq")


# ---- Sealed files hold data from which a later run of the same user continues. The
# seal is a digest of the data, keyed with a secret in the user's home folder. A file
# that somebody else has written or changed has a wrong seal and is not used.

SECRET_BYTES = 32


def compute_seal(content: Any) -> str:
    """Return the digest of JSON data, with the user's secret as the key."""
    return hashlib.blake2b(json.dumps(content, sort_keys=True).encode(), key=load_secret()).hexdigest()


def write_sealed(path: Path, content: Any) -> None:
    """Write data and their seal as JSON, a format that cannot contain code."""
    with write_atomically(path) as file:
        json.dump({"content": content, "seal": compute_seal(content)}, file)


def read_sealed(path: Path) -> Any:
    """Return the data of a sealed file; None if its seal is missing or wrong."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        content = kept["content"]
        seal = compute_seal(content)
        return content if hmac.compare_digest(str(kept["seal"]).encode(), seal.encode()) else None
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None


@functools.cache
def load_secret() -> bytes:
    """Return the user's secret, the key of the seals. If there is none, make it.

    If the secret cannot be stored, return random bytes. Later runs then cannot use the
    files that this process seals."""
    home = (
        os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".local" / "state"
    )
    path = Path(home) / "tselab" / "seal.key"
    with contextlib.suppress(OSError, RuntimeError):  # RuntimeError: no home directory
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            handle, name = tempfile.mkstemp(dir=path.parent)  # readable by its owner only
            with os.fdopen(handle, "wb") as file:
                file.write(secrets.token_bytes(SECRET_BYTES))
            try:
                # link() fails if a different process has just stored its secret; that
                # secret is then read below
                os.link(name, path)
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

INTEGER_LIMIT = 1 << 63  # an integer of TOML has 64 bits; Python would accept longer ones
MAX_TOML_BYTES = 16 << 20  # [bytes] maximum size; a signals.toml of 10 000 channels has 1 MB
MAX_TOML_DEPTH = 64  # max nesting depth of tables


def check_regular(path: Path, max_bytes: int, what: str) -> None:
    """Raise UserError if a path is no regular file or is too large to read.

    Parameters
    ----------
    path : Path
        The file. A missing file or a directory is accepted: opening it raises the error.
    max_bytes : int
        [bytes] Maximum size.
    what : str
        The needed content, for the message. Example: "a TOML file".

    Raises
    ------
    UserError
        The path is a device or a pipe, or the file is larger than `max_bytes`.
    """
    try:
        found = Path(path).stat()
    except (OSError, ValueError):
        return
    if stat.S_ISDIR(found.st_mode):
        return
    if not stat.S_ISREG(found.st_mode):
        raise UserError(f"{path}: is a device or a pipe, {what} is needed")
    if found.st_size > max_bytes:
        raise UserError(
            f"{path}: is too large: {found.st_size >> 20:,} MB; {what} has at most {max_bytes >> 20} MB"
        )


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    UserError
        The file cannot be read, is no regular file, is too large, is not valid TOML, or
        its tables are nested too deeply.
    """
    check_regular(path, MAX_TOML_BYTES, "a TOML file")
    try:
        data = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise NoFile(f"{path}: no such file") from None
    except IsADirectoryError:
        raise UserError(f"{path}: is a directory, a TOML file is needed") from None
    except UnicodeDecodeError:
        raise UserError(f"{path}: is not a text file in UTF-8; a TOML file is needed") from None
    except ValueError as error:  # TOMLDecodeError, or a number or date that Python cannot hold
        raise UserError(f"{path}: is not valid TOML: {error}{_hint_at_table(Path(path))}") from None
    except RecursionError:
        raise UserError(f"{path}: is not valid TOML: tables or arrays are nested too deeply") from None
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror}") from None
    _check_values(path, data, "", 0)
    return data


def _hint_at_table(path: Path) -> str:
    """Return a hint if the first line of a file looks like a header of CSV, else ""."""
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        line = file.readline(65536)
    cells = max(line.count(c) for c in ",;\t") + 1
    if cells > 3 and "=" not in line:
        return f"\n  its first line has {cells} columns: is it a log instead of a TOML file?"
    return ""


def _check_values(path: Path, value: Any, key: str, depth: int) -> None:
    """Raise UserError if an integer is too large or tables are nested too deeply.

    Parameters
    ----------
    path : Path
        The file, for the message.
    value
        A value of the file; its parts are checked, too.
    key : str
        The dotted key of `value`.
    depth : int
        Number of tables and arrays that contain `value`.
    """
    if isinstance(value, int) and not -INTEGER_LIMIT <= value < INTEGER_LIMIT:
        raise UserError(f"{path}: is not valid TOML: key {key[:200]}: an integer has at most 64 bits")
    if depth > MAX_TOML_DEPTH:
        raise UserError(
            f"{path}: is not valid TOML: key {key[:40]} ...: tables are nested more than "
            f"{MAX_TOML_DEPTH} deep"
        )
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for name, part in parts:
        _check_values(path, part, f"{key}.{name}" if key else str(name), depth + 1)
