"""The secret that seals what a run leaves for the next: one for each user, or one for each process."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tselab import seal


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    seal.secret.cache_clear()
    yield tmp_path / "state"
    seal.secret.cache_clear()


def test_the_next_process_of_a_user_has_the_same_secret(home):
    first = seal.secret()
    kept = home / "tselab" / "seal.key"
    assert kept.read_bytes() == first and len(first) == seal.BYTES
    assert [p.name for p in kept.parent.iterdir()] == ["seal.key"]
    if os.name == "posix":
        assert kept.stat().st_mode & 0o077 == 0
    seal.secret.cache_clear()
    assert seal.secret() == first


def test_another_user_has_another(home, tmp_path, monkeypatch):
    first = seal.seal([b"one", b"two"])
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "other"))
    seal.secret.cache_clear()
    assert seal.seal([b"one", b"two"]) != first


@pytest.mark.parametrize("there", [b"", b"short", bytes(33)])
def test_where_none_can_be_kept_each_process_has_its_own(there, home):
    home.mkdir()
    if there:
        (home / "tselab").mkdir()
        (home / "tselab" / "seal.key").write_bytes(there)
    else:
        (home / "tselab").write_text("a file, in which no folder can be")
    first = seal.secret()
    seal.secret.cache_clear()
    assert len(first) == seal.BYTES and seal.secret() != first
