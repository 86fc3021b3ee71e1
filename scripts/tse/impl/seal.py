"""What a run leaves for the next one of the same user is sealed: a digest with a secret that stays in the user's own folder. So a
result folder from a stranger, whatever keys and checksums are in it, is never gone on from."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import hmac
import json
import os
import secrets
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from tse.impl.files import atomic

BYTES = 32  # of the secret


def seal(parts: Iterable[bytes]) -> bytes:
    """The digest of these bytes, one part after the other."""
    digest = hashlib.blake2b(key=secret())
    for part in parts:
        digest.update(part)
    return digest.digest()


def _mark(content: Any) -> str:
    return seal([json.dumps(content, sort_keys=True).encode()]).hex()


def write_sealed(path: Path, content: Any) -> None:
    """Keep what JSON can say: numbers and words, nothing that could run."""
    with atomic(path) as file:
        json.dump({"content": content, "seal": _mark(content)}, file)


def read_sealed(path: Path) -> Any:
    """Return what was kept; None where there is nothing, or what is there is of somebody else, or broken."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        content = kept["content"]
        return content if hmac.compare_digest(str(kept["seal"]).encode(), _mark(content).encode()) else None
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None


@functools.cache
def secret() -> bytes:
    """Made once for each user. Where no folder can hold it each process has its own, and goes on from nothing."""
    home = os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".local" / "state"
    path = Path(home) / "tselab" / "seal.key"
    with contextlib.suppress(OSError, RuntimeError):  # RuntimeError: there is no home
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            handle, name = tempfile.mkstemp(dir=path.parent)  # for nobody else to read
            with os.fdopen(handle, "wb") as file:
                file.write(secrets.token_bytes(BYTES))
            try:
                os.link(name, path)  # the first of several processes; whole, or not there
            except FileExistsError:
                pass
            finally:
                os.unlink(name)
        if len(found := path.read_bytes()) == BYTES:
            return found
    return secrets.token_bytes(BYTES)
