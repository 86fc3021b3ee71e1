"""Files of strangers through the readers (readers.py): those that once broke something, and a few seconds of new ones."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

HERE = Path(__file__).parent
RUNS = 60  # of each target; readers.py --runs 1000000 on demand


def _load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fuzz_readers", HERE / "readers.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz_readers"] = module
    spec.loader.exec_module(module)
    return module


readers = _load()
FOUND = [(name, why, data) for name in readers.TARGETS for why, data in readers.kept(name)]


@pytest.mark.parametrize(("name", "data"), [(n, d) for n, _, d in FOUND], ids=[f"{n}-{why}" for n, why, _ in FOUND])
def test_what_once_broke_a_reader_does_no_more(name, data, tmp_path):
    assert not readers.check(name, data, tmp_path)


@pytest.mark.parametrize("name", readers.TARGETS)
def test_no_changed_file_breaks_a_reader(name, tmp_path):
    done, findings = readers.search(name, RUNS, 60.0, 14, tmp_path)
    assert (done, findings) == (RUNS, 0)


def test_a_reader_that_breaks_is_noticed(tmp_path, monkeypatch):
    """Also: an exception, a warning, something left behind, a refusal that nobody says."""

    def leave(data: bytes, folder: Path) -> None:
        (folder / "car.toml").write_bytes(readers.SMALL_CAR)
        monkeypatch.setattr(readers, "main", lambda: (folder / "left").write_text("x") and sys.exit(0))
        readers.command(folder, "vehicle", "car.toml")

    def fail(data: bytes, folder: Path) -> None:
        raise ZeroDivisionError(len(data))

    def end(code: int, said: str) -> None:
        print(said, file=sys.stderr)
        sys.exit(code)

    monkeypatch.setitem(readers.TARGETS, "log", readers.Target(lambda: [b"1"], fail))
    assert "ZeroDivisionError" in readers.check("log", b"2", tmp_path)
    assert readers.search("log", 5, 60.0, 1, tmp_path / "found") == (0, 1)
    assert [p.read_bytes() for p in (tmp_path / "found" / "reader_log").iterdir()] == [b"1"]
    monkeypatch.setitem(readers.TARGETS, "log", readers.Target(lambda: [b"1"], leave))
    assert "left behind" in readers.check("log", b"2", tmp_path)
    for code, said, word in [(1, "internal error", "exit code 1"), (2, "", "refusal"), (0, "RuntimeWarning: x", "package speaks"),
                             (2, "error: Traceback", "package speaks"), (2, "error\n" * 9, "refusal of")]:  # fmt: skip
        monkeypatch.setattr(readers, "main", lambda code=code, said=said: end(code, said))
        monkeypatch.setitem(readers.TARGETS, "log", readers.Target(lambda: [b"1"], readers.read_car))
        assert word in readers.check("log", b"2", tmp_path), (code, said)


@pytest.mark.parametrize("made", ["changed", "as before\n"])
def test_a_refusal_that_changes_a_result_is_noticed(made, tmp_path, monkeypatch):
    def refuse() -> None:
        Path("out").write_text(made)
        print("error: no", file=sys.stderr)
        sys.exit(2)

    monkeypatch.setattr(readers, "main", refuse)
    if made == "changed":
        with pytest.raises(readers.Broken, match="is changed"):
            readers.command(tmp_path, "estimate", made=("out",))
    else:
        assert readers.command(tmp_path, "estimate", made=("out",)) == 2
