"""A few hundred inputs of each fuzz target, the same ones each time.

Run scripts/dev/fuzz.sh --runs 1000000 for more. The readers of files have tests of their
own.
"""

import os
import subprocess
import sys
from pathlib import Path

import bombs
import pytest
import readers

import inputs

ROOT = Path(__file__).parents[2]
TARGETS = [
    "step",
    "settings",
    "learnt",
    "replay",
    "state",
    "fmu_calls_estimator",
    "fmu_calls_vehicle",
    "fmu_state_estimator",
    "fmu_state_vehicle",
]
RUNS = "400"


def run_fuzz(*args: str, path: str | None = None) -> subprocess.CompletedProcess[str]:
    env = dict(os.environ) if path is None else {**os.environ, "PATH": path}
    return subprocess.run(
        ["bash", "scripts/dev/fuzz.sh", *args], cwd=ROOT, env=env, capture_output=True, text=True, timeout=900
    )


@pytest.mark.slow
def test_nothing_is_found_in_a_few_inputs():
    names = [*TARGETS, "float_step", "fixed_step"]
    done = run_fuzz(*names, "--runs", RUNS, "--seed", "1")
    if done.returncode == 77:
        pytest.skip("clang with libFuzzer and sanitizers is not installed")
    assert done.returncode == 0, done.stdout + done.stderr
    for name in names:
        (row,) = [line.split() for line in done.stdout.splitlines() if line.startswith(f"{name} ")]
        assert int(row[1]) > 0, row


def test_without_clang_that_is_said(tmp_path):
    for tool in ("bash", "dirname", "sed", "mkdir", "ls", "head", "grep", "env"):  # all but clang
        where = next(
            Path(p) / tool for p in os.environ["PATH"].split(os.pathsep) if (Path(p) / tool).exists()
        )
        (tmp_path / tool).symlink_to(where)
    done = run_fuzz("step", "--seconds", "1", path=str(tmp_path))
    assert done.returncode == 77, done.stdout + done.stderr
    assert "skipped: clang with libFuzzer" in done.stdout


@pytest.mark.parametrize("args", [["nothing"], ["--runs"], ["--runs", "0"], ["--seconds", "x"], ["--fast"]])
def test_wrong_options_are_refused(args):
    done = run_fuzz(*args)
    assert done.returncode == 2 and done.stderr.startswith("fuzz: ")


def test_the_inputs_that_are_kept_are_all_there():
    """The C program and the search of a target read its kept inputs."""
    there = {target for target, _, _ in inputs.read_lines()}
    broke = {name: len(inputs.read_found(name)) for name in there if inputs.read_found(name)}
    assert {name: len(inputs.read(name)) - broke.get(name, 0) for name in TARGETS} == dict.fromkeys(
        TARGETS, 40
    )
    assert broke == {"fmu_calls_vehicle": 1, "learnt": 5, "replay": 2, "settings": 4, "state": 2, "step": 5,
                     "reader_runs": 2, "reader_vehicle": 1}  # fmt: skip
    assert there == {*TARGETS, *broke}


def test_what_is_packed_is_unpacked(tmp_path, monkeypatch):
    """A new corpus replaces the old one; inputs that once broke the target stay."""
    monkeypatch.setattr(inputs, "INPUTS", tmp_path / "inputs.hex")
    inputs.INPUTS.write_text("replay corpus 01\nstep corpus 00\nstep what_broke_it ff0a\n", encoding="ascii")
    folder = tmp_path / "new"
    folder.mkdir()
    for name, data in ("a", b""), ("b", b"\n\r\x00"):
        (folder / name).write_bytes(data)
    inputs.pack("step", folder)
    assert inputs.read("step") == [("corpus", b""), ("corpus", b"\n\r\x00"), ("what_broke_it", b"\xff\n")]
    assert inputs.read("replay") == [("corpus", b"\x01")]
    inputs.unpack("step", tmp_path / "out")
    assert sorted(p.read_bytes() for p in (tmp_path / "out").iterdir()) == [b"", b"\n\r\x00", b"\xff\n"]


# ---- readers of files: files that once broke one, and a few seconds of new ones


RUNS_READERS = 60  # of each target; readers.py --runs 1000000 on demand


FOUND = [(name, why, data) for name in readers.TARGETS for why, data in readers.read_kept(name)]


@pytest.mark.parametrize(
    ("name", "data"), [(n, d) for n, _, d in FOUND], ids=[f"{n}-{why}" for n, why, _ in FOUND]
)
def test_what_once_broke_a_reader_does_no_more(name, data, tmp_path):
    assert not readers.check_file(name, data, tmp_path)


@pytest.mark.parametrize("name", readers.TARGETS)
def test_no_changed_file_breaks_a_reader(name, tmp_path):
    done, findings = readers.search_target(name, RUNS_READERS, 60.0, 14, tmp_path)
    assert (done, findings) == (RUNS_READERS, 0)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the system does not say what a process holds")
def test_a_file_that_unpacks_without_end_is_refused(tmp_path):
    """A variable of 0.96 GB of zeros exceeds the memory that a command may take."""
    (tmp_path / "car.toml").write_bytes(readers.SMALL_CAR)
    bombs.write_mat5(tmp_path / "log.mat", 120_000_000, ("time",))
    assert (tmp_path / "log.mat").stat().st_size < 1_000_000
    taken = bombs.run_command(["signals", "log.mat", "--vehicle", "car.toml"], tmp_path)
    assert taken.code == 2, taken
    assert "reading takes more than 0.7 GB of memory" in taken.said
    assert taken.memory < bombs.MAX_TAKEN["memory"]


def test_a_reader_that_breaks_is_noticed(tmp_path, monkeypatch):
    """An exception, a warning, a file left behind, an unexplained refusal are found."""

    def leave(data: bytes, folder: Path) -> None:
        (folder / "car.toml").write_bytes(readers.SMALL_CAR)
        monkeypatch.setattr(readers, "main", lambda: (folder / "left").write_text("x") and sys.exit(0))
        readers.run_tselab(folder, "vehicle car.toml")

    def fail(data: bytes, folder: Path) -> None:
        raise ZeroDivisionError(len(data))

    def end(code: int, said: str) -> None:
        print(said, file=sys.stderr)
        sys.exit(code)

    monkeypatch.setitem(readers.TARGETS, "log", readers.Target(lambda: [b"1"], fail))
    assert "ZeroDivisionError" in readers.check_file("log", b"2", tmp_path)
    assert readers.search_target("log", 5, 60.0, 1, tmp_path / "found") == (0, 1)
    assert [p.read_bytes() for p in (tmp_path / "found" / "reader_log").iterdir()] == [b"1"]
    monkeypatch.setitem(readers.TARGETS, "log", readers.Target(lambda: [b"1"], leave))
    assert "left behind" in readers.check_file("log", b"2", tmp_path)
    for code, said, word in [
        (1, "internal error", "exit code 1"),
        (2, "", "refusal"),
        (0, "RuntimeWarning: x", "package speaks"),
        (2, "error: Traceback", "package speaks"),
        (2, "error\n" * 9, "refusal of"),
    ]:
        monkeypatch.setattr(readers, "main", lambda code=code, said=said: end(code, said))
        monkeypatch.setitem(readers.TARGETS, "log", readers.Target(lambda: [b"1"], readers.read_car))
        assert word in readers.check_file("log", b"2", tmp_path), (code, said)


@pytest.mark.parametrize("made", ["changed", "as before\n"])
def test_a_refusal_that_changes_a_result_is_noticed(made, tmp_path, monkeypatch):
    def refuse() -> None:
        Path("out").write_text(made)
        print("error: no", file=sys.stderr)
        sys.exit(2)

    monkeypatch.setattr(readers, "main", refuse)
    if made == "changed":
        with pytest.raises(readers.Broken, match="is changed"):
            readers.run_tselab(tmp_path, "estimate", "out")
    else:
        assert readers.run_tselab(tmp_path, "estimate", "out") == 2
