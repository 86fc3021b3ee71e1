"""Test whether the tests find the faults of the faults*.toml beside it.

    .venv/bin/python tests/proof/faults.py [--write] [--list NAME] [--only TEXT] [--again]

Each fault is put into a copy of the sources.

- src: the unit tests and the golden replay run until one fails, those of the file first,
  as in tests/proof/mutation.py. If none fails, the tests of the file run with sanitizers.
  A fault in code of fixed point alone is judged in fixed point.
- fmu: the unit tests of the FMUs, then the Python tests that the fault names.
- Python: the tests that the fault names.

A verdict is kept in build/faults and holds for the same fault, file and tests: an
interrupted run goes on where it was. Exit code 1: fewer faults are found than the list
demands, or a fault cannot be put in.
"""

import argparse
import contextlib
import filecmp
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomllib

sys.path.insert(0, str(Path(__file__).resolve().parent))
import mutation

ROOT = mutation.ROOT
REPORT = ROOT / "scripts" / "results" / "faults.md"
WORK = ROOT / "build" / "faults"
TIME_LIMIT = 1800.0  # s of the tests of one fault: the slowest files need 400 s without one
PYTEST = [".venv/bin/python", "-m", "pytest", "-c", "scripts/pyproject.toml", "--rootdir", "."]
COPIED_BESIDE = ("scripts/tse/library/lib",)  # not in git, and needed by the tests
BUILT = "build"  # folder of a copy that outlasts a run


@dataclass(frozen=True)
class FaultList:
    """A file of faults, and how many of them must be found."""

    file: Path
    min_found: int
    about: str  # of the table


HERE = Path(__file__).parent
LISTS = (
    FaultList(
        HERE / "faults.toml",
        28,
        "in the default filter and its model. The unit tests and the golden replay ran with each fault",
    ),
    FaultList(
        HERE / "faults_whole.toml",
        37,
        "in the whole project, chosen from the sources by a reader who had not seen the tests. The tests "
        "of the same area ran with each fault",
    ),
    FaultList(
        HERE / "faults_fresh.toml",
        37,
        "in the whole project, chosen later by a second reader who had not seen the tests. The tests of the "
        "same area ran with each fault",
    ),
    FaultList(
        HERE / "faults_second.toml",
        37,
        "in the whole project, chosen by a third reader who had not seen the tests, after others had written "
        "tests for the lists above. The tests of the same area ran with each fault",
    ),
    FaultList(
        HERE / "faults_third.toml",
        37,
        "in the whole project, chosen by a fourth reader who had not seen the tests, later than the lists "
        "above. The tests of the same area ran with each fault",
    ),
    FaultList(
        HERE / "faults_fourth.toml",
        37,
        "in the whole project, chosen by a fifth reader who had not seen the tests, while others wrote tests "
        "for each function of the core and the FMUs. The tests of the same area ran with each fault",
    ),
    FaultList(
        HERE / "faults_fifth.toml",
        37,
        "in the whole project, chosen by a sixth reader who had not seen the tests, while others wrote tests "
        "for each function of the Python packages. The tests of the same area ran with each fault",
    ),
)


@dataclass(frozen=True)
class HandFault:
    """A fault put in by hand."""

    what: str
    file: str  # from the root
    old: str
    new: str
    line: int
    tests: tuple[str, ...]  # Python test files of the area
    since: str  # the test that was written because this fault survived; empty: found at first
    also: str  # a test file that was not named for the fault before it was first tried

    @property
    def in_core(self) -> mutation.Fault:
        """The fault as tests/proof/mutation.py takes it."""
        at = (ROOT / self.file).read_text(encoding="utf-8").index(self.old)
        file = self.file.removeprefix("src/")
        return mutation.Fault(file, at, at + len(self.old), self.new, "hand", self.line, self.old)


def read_faults(file: Path) -> list[HandFault]:
    """Return the faults of a list.

    Raises
    ------
    ValueError
        The text to replace does not stand in its file exactly once.
    """
    found = []
    for row in tomllib.loads(file.read_text(encoding="utf-8"))["fault"]:
        text = (ROOT / row["file"]).read_text(encoding="utf-8")
        if text.count(row["old"]) != 1:
            raise ValueError(
                f"{row['file']} has {row['old']!r} {text.count(row['old'])} times: {row['what']}"
            )
        line = text.count("\n", 0, text.index(row["old"])) + 1
        since, also = row.get("since", ""), row.get("also", "")
        tests = (*([also] if also else []), *row.get("tests", ()))
        found.append(HandFault(row["what"], row["file"], row["old"], row["new"], line, tests, since, also))
    return found


# ---- faults of Python and of the FMUs: a copy of the tree


def run_within(command: Sequence[object], folder: Path, limit: float) -> tuple[int | None, str]:
    """Run a command in a folder; return exit code and output. None: it was stopped after
    `limit` s.

    Whatever it has started ends with it, also after Ctrl-C.
    """
    # No bytecode is written. Otherwise the bytecode of the file without the fault would
    # be used, if both files have the same length and were written within one second.
    env = {
        **os.environ,
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONPATH": str(folder / "scripts"),
    }
    log = folder / BUILT / "output.txt"
    log.parent.mkdir(exist_ok=True)
    with open(log, "wb") as out:
        process = subprocess.Popen(
            [str(c) for c in command],
            cwd=folder,
            env=env,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            code: int | None = process.wait(limit)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    return code, log.read_text(encoding="utf-8", errors="replace")


class TreeCourt:
    """A copy of the tree, in which faults are put and tests run."""

    def __init__(self, folder: Path):
        self.folder = folder
        self._configured = False
        self._copy()

    def _copy(self) -> None:
        """Make the copy equal to the tree. Equal files keep their time, so that only what
        differs is compiled anew."""
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=ROOT,
            capture_output=True,
            check=True,
        )
        wanted = {name for name in listed.stdout.decode().split("\0") if name and (ROOT / name).is_file()}
        for beside in COPIED_BESIDE:
            wanted |= {str(p.relative_to(ROOT)) for p in (ROOT / beside).rglob("*") if p.is_file()}
        self.folder.mkdir(parents=True, exist_ok=True)
        for root, folders, files in os.walk(self.folder):
            folders[:] = [f for f in folders if not (Path(root) == self.folder and f in (BUILT, ".venv"))]
            for name in files:
                path = Path(root) / name
                if str(path.relative_to(self.folder)) not in wanted:
                    path.unlink()
        for name in wanted:
            there = self.folder / name
            if not there.is_file() or not filecmp.cmp(ROOT / name, there, shallow=False):
                there.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ROOT / name, there)
                shutil.copymode(ROOT / name, there)
        if not (self.folder / ".venv").exists():
            (self.folder / ".venv").symlink_to((ROOT / ".venv").resolve(), target_is_directory=True)

    @contextlib.contextmanager
    def put_in(self, fault: HandFault) -> Iterator[None]:
        """Put a fault into the copy, and take it out at the end."""
        path = self.folder / fault.file
        text = path.read_text(encoding="utf-8")
        path.write_text(text.replace(fault.old, fault.new), encoding="utf-8")
        try:
            yield
        finally:
            path.write_text(text, encoding="utf-8")

    def judge(self, fault: HandFault) -> tuple[str, str]:
        """Return stillborn, found or survived, and the test that has found it.

        SystemExit: this test fails without the fault, too.
        """
        of_fmu = fault.file.startswith("fmu/")
        if of_fmu and not self._configured:
            self._configure()
        with self.put_in(fault):
            if fault.file.endswith(".py"):
                try:
                    compile((self.folder / fault.file).read_text(encoding="utf-8"), fault.file, "exec")
                except SyntaxError:
                    return "stillborn", ""
            if of_fmu:
                verdict, by = self._run_units()
                if verdict != "survived":
                    return verdict, by
            verdict, by = self._run_tests(fault.tests)
        if verdict == "found" and self._run_tests([by] if by else fault.tests)[0] == "found":
            raise SystemExit(f"faults: {by or fault.tests} fails without any fault")
        return verdict, by

    def _run_tests(self, tests: Sequence[str]) -> tuple[str, str]:
        """Run Python tests until one fails; one that does not end fails."""
        scratch = self.folder / BUILT / "pytest"
        code, said = run_within(
            [*PYTEST, "-x", "-q", "-p", "no:cacheprovider", "--basetemp", scratch, *tests],
            self.folder,
            TIME_LIMIT,
        )
        shutil.rmtree(scratch, ignore_errors=True)
        if code == 0:
            return "survived", ""
        if code is not None and code > 2:  # no test at all, or wrong arguments
            raise SystemExit(f"faults: pytest {' '.join(tests)} ends with {code}:\n{said[-2000:]}")
        by = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", said, re.MULTILINE)
        return "found", by[1] if by else ""

    def _configure(self) -> None:
        """Compile the unit tests of the FMUs, and run them without a fault."""
        options = [
            *(f"-DFETCHCONTENT_SOURCE_DIR_{n.upper()}={ROOT / '.venv/share' / n}" for n in SHARED),
            f"-DPython3_EXECUTABLE={ROOT / '.venv/bin/python'}",
            "-DTSE_TEST_EVERY_WAY=OFF",
        ]
        code, said = run_within(["cmake", "--preset", "release", *options], self.folder, TIME_LIMIT)
        if code != 0:
            raise SystemExit(f"faults: CMake fails:\n{said[-2000:]}")
        self._configured = True
        verdict, by = self._run_units()
        if verdict != "survived":
            raise SystemExit(f"faults: {by or 'a unit test of the FMUs'} fails without any fault: {verdict}")

    def _run_units(self) -> tuple[str, str]:
        """Compile and run the unit tests of the FMUs."""
        build = ["cmake", "--build", f"{BUILT}/release", "--target", *list_fmu_targets()]
        code, said = run_within(build, self.folder, TIME_LIMIT)
        if code != 0:
            return "stillborn", said[-300:]
        code, said = run_within(
            ["ctest", "--test-dir", f"{BUILT}/release", "-R", "^fmu_test_", "--stop-on-failure"],
            self.folder,
            TIME_LIMIT,
        )
        by = re.search(r"- (fmu_\w+) \(", said)
        return ("survived", "") if code == 0 else ("found", by[1] if by else "ctest")


SHARED = ("unity", "fmi2", "fmi3")  # sources that scripts/setup.sh fetches


def list_fmu_targets() -> list[str]:
    """Return the programs of tests/fmu/CMakeLists.txt."""
    every = {p.stem for p in (ROOT / "tests" / "fmu" / "unit").glob("test_*.c")}
    own = {"TireStiffnessEstimator": "test_estimator", "SingleTrackVehicle": "test_vehicle"}
    return sorted(
        f"fmu_{test}_{model}" for model, mine in own.items() for test in every - {*own.values()} | {mine}
    )


# ---- verdicts


class Verdicts:
    """Verdicts of earlier runs, by the content that they depend on."""

    def __init__(self, path: Path, again: bool):
        self._path = path
        self._known: dict[str, list[str]] = {}
        if path.is_file() and not again:
            self._known = json.loads(path.read_text(encoding="utf-8"))

    @staticmethod
    def make_key(fault: HandFault) -> str:
        """Return a hash of the fault, its file and the tests that judge it."""
        tests = [ROOT / t for t in fault.tests]
        if fault.file.startswith("src/"):
            tests = [p for t in ("unit", "replay") for p in sorted((ROOT / "tests" / t).rglob("*.[ch]"))]
        elif fault.file.startswith("fmu/"):
            tests += sorted((ROOT / "tests" / "fmu" / "unit").iterdir())
        digest = hashlib.sha256(json.dumps([fault.file, fault.old, fault.new, fault.tests]).encode())
        for path in (ROOT / fault.file, *tests):
            digest.update(path.read_bytes())
        return digest.hexdigest()

    def get(self, key: str) -> tuple[str, str] | None:
        """Return verdict and test of an earlier run."""
        found = self._known.get(key)
        return (found[0], found[1]) if found else None

    def keep(self, key: str, verdict: str, by: str) -> None:
        """Keep a verdict for later runs."""
        self._known[key] = [verdict, by]
        self._path.parent.mkdir(parents=True, exist_ok=True)
        new = self._path.with_suffix(".new")
        new.write_text(json.dumps(self._known, indent=1), encoding="utf-8")
        new.replace(self._path)


class Courts:
    """The court of each kind of file, made when the first fault of its kind comes."""

    def __init__(self, compiler: str):
        self._compiler = compiler
        self._core: mutation.Court | None = None
        self._fixed: mutation.Bench | None = None
        self._tree: TreeCourt | None = None

    def judge(self, fault: HandFault) -> tuple[str, str]:
        """Return found (by sanitizers, in fixed point), survived or stillborn, and the
        test."""
        if fault.file.startswith("src/"):
            self._core = self._core or mutation.Court(WORK, self._compiler)
            verdict = self._core.judge(fault.in_core)
            return (verdict if verdict != "same" else self._judge_in_fixed_point(fault)), ""
        self._tree = self._tree or TreeCourt(WORK / "tree")
        return self._tree.judge(fault)

    def _judge_in_fixed_point(self, fault: HandFault) -> str:
        """Return the verdict on a fault in code that other number formats do not
        compile."""
        if self._fixed is None:
            self._fixed = mutation.Bench(WORK / "fixed", self._compiler, ["-DTSE_REAL_FIXED=1"])
            self._fixed.prepare()
        verdict = self._fixed.judge(fault.in_core)
        return "found in fixed point" if verdict == "found" else verdict


def judge_faults(
    chosen: Sequence[HandFault], courts: Courts, verdicts: Verdicts
) -> list[tuple[HandFault, str]]:
    """Return each fault with its verdict."""
    done = []
    for n, fault in enumerate(chosen, 1):
        key = verdicts.make_key(fault)  # before: files may change while the tests run
        began, known = time.monotonic(), verdicts.get(key)
        verdict, by = known or courts.judge(fault)
        if known is None:
            verdicts.keep(key, verdict, by)
        took = "kept" if known else f"{time.monotonic() - began:.0f} s"
        where = f" by {by}" if by else ""
        print(
            f"{n}/{len(chosen)} {verdict}{where} ({took}): {fault.file}:{fault.line}: {fault.what}",
            flush=True,
        )
        done.append((fault, verdict))
    return done


def count_found(done: Sequence[tuple[HandFault, str]]) -> int:
    """Return the number of faults that are found."""
    return sum(verdict.startswith("found") for _, verdict in done)


def format_table(about: FaultList, done: Sequence[tuple[HandFault, str]]) -> str:
    """Return the table of a list in Markdown."""
    found = [f for f, verdict in done if verdict.startswith("found")]
    after, beside = sum(bool(f.since) for f in found), sum(bool(f.also) for f in found)
    parts = [f"{len(found) - after - beside} by the existing tests of the area"]
    parts += [f"{beside} by existing tests of another area"] if beside else []
    parts += [f"{after} by new tests"] if after else []
    lines = [
        f"## {about.file.name}",
        "",
        *textwrap.wrap(f"{len(done)} faults {about.about}.", 90),
        "",
        f"**{len(found)} of {len(done)} found**: {', '.join(parts)}. Commit {read_commit()}.",
        "",
        "| file and line | fault | result |",
        "|---|---|---|",
    ]
    for f, verdict in done:
        how = f" after a new test: {f.since.split('::')[1]}" if f.since else ""
        how += f" in {f.also}, not named at first" if f.also else ""
        lines.append(f"| {f.file}:{f.line} | {f.what} | {verdict}{how} |")
    return "\n".join(lines) + "\n"


def read_commit() -> str:
    """Return the first eight digits of the commit that is checked out."""
    command = ["git", "rev-parse", "--short=8", "HEAD"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def write_report(tables: dict[str, str]) -> None:
    """Write the tables of some lists, by name of the list, into the report. The tables of
    the other lists stay as they are in the report."""
    text = REPORT.read_text(encoding="utf-8") if REPORT.is_file() else ""
    known = {part.partition("\n")[0]: f"## {part}" for part in text.split("## ")[1:]}
    every = [tables.get(x.file.name, known.get(x.file.name)) for x in LISTS]
    head = "# Faults chosen by hand\n\n`.venv/bin/python tests/proof/faults.py --write [--list NAME]`\n"
    REPORT.write_text("\n".join([head, *(t.rstrip() + "\n" for t in every if t)]), encoding="utf-8")


def main() -> int:
    """Judge the faults and write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="", help="faults of which the sentence or file contains this")
    parser.add_argument("--list", choices=[x.file.stem for x in LISTS], help="the faults of one file")
    parser.add_argument("--again", action="store_true", help="judge those, too, of which a verdict is kept")
    parser.add_argument("--compiler", default="gcc")
    parser.add_argument("--write", action="store_true", help=f"write the lists to {REPORT.relative_to(ROOT)}")
    given: Any = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # what it has started ends, too
    courts, verdicts = Courts(given.compiler), Verdicts(WORK / "verdicts.json", given.again)
    missed = 0
    tables: dict[str, str] = {}  # name of a list -> its table
    for each in (x for x in LISTS if given.list in (None, x.file.stem)):
        chosen = [f for f in read_faults(each.file) if given.only in f.what or given.only in f.file]
        done = judge_faults(chosen, courts, verdicts)
        allowed = len(read_faults(each.file)) - each.min_found
        missed += max(0, len(done) - count_found(done) - allowed)
        tables[each.file.name] = format_table(each, done)
    if given.write and not given.only:
        write_report(tables)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
