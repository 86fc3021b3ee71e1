"""Read randomly changed files with all readers.

    python tests/fuzz/readers.py [TARGET ...] [--runs N] [--seconds S]

A target consists of a reader, a few good files, and a check. Whatever a file holds, the
command must succeed (exit code 0; 3 or 4 if it uses a part) or refuse the file (2). A
refusal has a few lines, without a traceback or a warning of a package, and no partly
written output. build/fuzz/found/TARGET keeps each file that breaks a check. Add it to
tests/fuzz/inputs.hex (inputs.py), with a name that states the fault: the tests read those
files.
"""

import argparse
import contextlib
import functools
import hashlib
import io
import json
import os
import random
import re
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

try:
    import resource
except ImportError:  # Windows has no limits
    resource = None

import inputs  # beside this file
from tse.library.errors import UserError
from tselab.cli import main

ROOT = Path(__file__).resolve().parents[2]
ROWS = 60  # of a log: enough for every check of a log, and thousands of logs a minute
MAX_LINES = 6  # of a refusal: its sentence, hints, and notes on files read before
MAX_BYTES = 1 << 18  # of a changed file
MAX_MEMORY = 3 << 30  # bytes of addresses: twice those of the process with its packages


class Broken(Exception):
    """A check has failed; the text is the reason."""


# ---- a command, as a user runs it


def run_tselab(folder: Path, line: str, *made: str) -> int:
    """Run tselab in `folder`.

    `line`: its arguments; `made`: files that it may write. After a refusal the existing
    ones must be unchanged.
    """
    for name in made:
        (folder / name).write_text("as before\n")
    before = {p.name for p in folder.iterdir()}
    out, err = io.StringIO(), io.StringIO()
    argv, here = sys.argv, Path.cwd()
    code: object = None
    try:
        sys.argv = ["tselab", *line.split()]
        os.chdir(folder)
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
            warnings.simplefilter("always")
            main()
    except SystemExit as end:
        code = end.code
    finally:
        sys.argv = argv
        os.chdir(here)
    said = err.getvalue()
    if code not in (0, 2, 3, 4):
        raise Broken(f"exit code {code}: {said[:500]}")
    if "Traceback" in said or re.search(r"\bWarning\b|Warning:", said):
        raise Broken(f"a package speaks: {said[:500]}")
    if code == 2 and not (0 < len(said.splitlines()) <= MAX_LINES and "error" in said.lower()):
        raise Broken(f"a refusal of {len(said.splitlines())} lines: {said[:500]}")
    if left := {p.name for p in folder.iterdir()} ^ before:
        raise Broken(f"left behind: {sorted(left)}")
    if code == 2 and (touched := [n for n in made if (folder / n).read_text() != "as before\n"]):
        raise Broken(f"refused, and {touched} is changed")
    return int(code)


# ---- targets


@dataclass(frozen=True)
class Target:
    """Files of a kind and their reader.

    `once` writes the bytes to a file of the folder and reads it; `words`: parts of such
    files.
    """

    seeds: Callable[[], list[bytes]]
    once: Callable[[bytes, Path], None]
    words: tuple[bytes, ...] = ()


def make_table(log: bytes = b"") -> pd.DataFrame:
    t = np.arange(ROWS) * 0.01
    steer = 0.02 * np.sin(3.0 * t)
    columns = {
        "time": t,
        "steer_angle": steer,
        "wheel_speed_front": 60 + 0.2 * t,
        "wheel_speed_rear": 60 + 0.2 * t,
        "accel_x": 0.1 * np.cos(9 * t),
        "accel_y": 60 * steer,
        "yaw_rate": 3 * steer,
    }
    return pd.DataFrame(columns).round(6)


@functools.cache
def make_log() -> bytes:
    return make_table().to_csv(index=False).encode()


@functools.cache
def make_car() -> bytes:
    from tse.report.tables import simulated_vehicle

    return simulated_vehicle().encode()


SMALL_CAR = b"mass = 1500.0\nlf = 1.2\nlr = 1.5\nwheel_radius_front = 0.3\nwheel_radius_rear = 0.3\n"


def make_logs() -> list[bytes]:
    more = make_table().assign(vehicle_speed=20.0, note="x", ref_cy_front=1.0)
    sides = make_table().rename(columns={"wheel_speed_front": "wheel_speed_front_left"})
    sides.insert(3, "wheel_speed_front_right", 60.0)
    holes = make_table()
    holes.loc[5:9, "accel_y"] = np.nan
    holes.loc[20, "steer_angle"] = np.nan
    return [
        make_log(),
        *(t.to_csv(index=False).encode() for t in (more, sides, holes)),
        make_log().replace(b"\n", b"\r\n"),
    ]


def read_log(data: bytes, folder: Path) -> None:
    (folder / "in.csv").write_bytes(data)
    (folder / "car.toml").write_bytes(SMALL_CAR)
    if run_tselab(folder, "estimate in.csv --vehicle car.toml --out est.csv", "est.csv") != 2:
        est = pd.read_csv(folder / "est.csv")
        numbers = est.select_dtypes("number").drop(columns="time")
        if np.isinf(numbers.to_numpy(float)).any() or (est["yaw_rate"].abs() > 20.001).any():
            raise Broken("estimates that are none")


def make_cars() -> list[bytes]:
    told = (
        SMALL_CAR + b"[uncertainty]\nmass_sd = 0.05\n[sensors]\naccel_x_sd = 0.1\n[latency]\naccel_y = 0.02\n"
    )
    told += b"[effects.body_roll]\ngain = 0.01\n"
    found = (
        SMALL_CAR
        + b'[calibration]\nnames = ["a", "b"]\nmean = [1.0, 2.0]\ncovariance = [[1.0, 0.1], [0.1, 1.0]]\n'
    )
    return [make_car(), SMALL_CAR, told, found]


def read_car(data: bytes, folder: Path) -> None:
    (folder / "car.toml").write_bytes(data)
    run_tselab(folder, "vehicle car.toml")


def make_filters() -> list[bytes]:
    return [
        b"forgetting = 0.98\nmax_gap = 0.2\nform = 2\nparticles = 32\n",
        b"[filter]\nform = 0\nwheel_signals = 1\nseed = 7\n",
    ]


def read_filter(data: bytes, folder: Path) -> None:
    (folder / "in.csv").write_bytes(make_log())
    (folder / "car.toml").write_bytes(SMALL_CAR)
    (folder / "filter.toml").write_bytes(data)
    run_tselab(folder, "estimate in.csv --vehicle car.toml --config filter.toml --out est.csv", "est.csv")


def make_formulas() -> list[bytes]:
    play = (
        b'id = "play"\ntitle = "play in the steering"\nplace = "front_angle"\n'
        b'formula = "play(steer_angle, w) - steer_angle"\n'
    )
    drag = (
        b'id = "drag"\ntitle = "d"\nplace = "force_x"\nformula = "-drag * vel_x * abs(vel_x)"\ngain = 0.5\n'
    )
    drag += b'[numbers.drag]\nvalue = 0.0003\nsd = 0.1\nunit = "1/m"\n'
    return [
        play + b'[numbers.w]\nvalue = 0.003\nunit = "rad"\ntext = "half of it"\n[found]\ngain = 3\n',
        drag,
    ]


def read_formula(data: bytes, folder: Path) -> None:
    (folder / "f.toml").write_bytes(data)
    run_tselab(folder, "formula f.toml --c f.h", "f.h")


@functools.cache
def make_learnt() -> bytes:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "in.csv").write_bytes(make_log())
        (folder / "car.toml").write_bytes(SMALL_CAR)
        run_tselab(folder, "estimate in.csv --vehicle car.toml --out e.csv --save-learnt l", "e.csv", "l")
        return (folder / "l").read_bytes()


def read_learnt(data: bytes, folder: Path) -> None:
    (folder / "in.csv").write_bytes(make_log())
    (folder / "car.toml").write_bytes(SMALL_CAR)
    (folder / "learnt").write_bytes(data)
    run_tselab(folder, "estimate in.csv --vehicle car.toml --load-learnt learnt --out e.csv", "e.csv")


# Runs of a study: a text file to which rows are appended, and the settings of the study.


@functools.cache
def make_runs() -> bytes:
    from tselab.montecarlo import engine

    rows = json.dumps([{"case": "iv-a", "estimator": "robust", "seed": 1, "diverged": 0.0}])
    return f"\n{make_plan().units[0].mark} {engine._hash(rows)} {rows}\n".encode()


@functools.cache
def make_plan() -> object:
    from tselab.montecarlo import engine, studies

    return engine.StudyPlan(studies.make_study("robust", ()), 1, 1, "default", {}, {}, ())


def read_runs(data: bytes, folder: Path) -> None:
    from tselab.montecarlo import engine

    (folder / engine.RUNS).write_bytes(data)
    good = json.loads(make_runs().split(b" ", 2)[2])
    if any(rows != good for rows in engine.read_runs(folder / engine.RUNS, make_plan().units).values()):
        raise Broken("runs that nobody made")


ODD = (
    b"nan",
    b"inf",
    b"-inf",
    b"1e400",
    b"-0",
    b"1e-400",
    b"9" * 400,
    b"0x10",
    b"1_000",
    b"NaN",
    b"None",
    b"\0",
    b"\xff",
    b"\xef\xbb\xbf",
    b'"',
    b"'",
    b",",
    b";",
    b"\n",
    b"\r",
    b"\r\n",
    b"\t",
    b" ",
    b"\xc2\xb2",
    b"\xe2\x80\xa8",
    b"=",
    b"#",
)
TOML_WORDS = (
    b"[",
    b"]",
    b"[[",
    b"{",
    b"}",
    b"[" * 3000,
    b"x = " + b"[" * 3000 + b"\n",
    b"a." * 2000,
    b'"""',
    b"true",
    b"1979-05-27",
    b"= [1, 2]",
    b"= {}",
    b"inf",
    b"\\u0000",
    b"mass = 1",
    b"[effects]",
    b"[effects.grade]",
    b"[formula]\nfile = 'x.toml'\n",
    b"[sensors]",
    b"[latency]",
)
JSON_WORDS = (
    b"[" * 3000,
    b"{",
    b"null",
    b"true",
    b"NaN",
    b"Infinity",
    b"1e999",
    b'{"cases": 3}',
    b'"cases"',
    b"\\ud800",
)

FILTER_WORDS = (*TOML_WORDS, b"sample_time = 0.001", b"form = 1", b"max_gap = 1.0", b"noise_max = 1000.0")
FORMULA_WORDS = (*TOML_WORDS, b"lag(", b"late(", b"**", b"(" * 100, b"sqrt(", b"__import__", b"place")

TARGETS = {
    "log": Target(
        make_logs, read_log, (b"time", b"accel_x", b"wheel_speed_rear", b"yaw_rate", b"0.01", b"," * 5000)
    ),
    "vehicle": Target(make_cars, read_car, TOML_WORDS),
    "filter": Target(make_filters, read_filter, FILTER_WORDS),
    "formula": Target(make_formulas, read_formula, FORMULA_WORDS),
    "learnt": Target(lambda: [make_learnt()], read_learnt),
    "runs": Target(lambda: [make_runs()], read_runs, JSON_WORDS),
}


# ---- changes


def change_file(dice: random.Random, data: bytes, others: list[bytes], words: tuple[bytes, ...]) -> bytes:
    """Return a file with one or a few changes."""
    b = bytearray(data)
    for _ in range(dice.choice([1, 1, 1, 2, 3, 6])):
        at = dice.randrange(len(b) + 1)
        to = min(len(b), at + int(2 ** dice.uniform(0, 7)))
        match dice.randrange(9):
            case 0 if b:
                b[at % len(b)] ^= 1 << dice.randrange(8)
            case 1 if b:
                b[at % len(b)] = dice.randrange(256)
            case 2:
                del b[at:to]
            case 3:
                b[at:at] = b[dice.randrange(len(b) + 1) :][: to - at]
            case 4:
                b[at:at] = dice.choice([*ODD, *words])
            case 5:
                b[at:to] = dice.choice([*ODD, *words])
            case 6:  # another number
                found = list(re.finditer(rb"-?\d+\.?\d*", bytes(b)))
                if found:
                    m = dice.choice(found)
                    b[m.start() : m.end()] = dice.choice(
                        [*ODD[:10], b"0", b"-1", b"1e9", str(dice.uniform(-1e3, 1e3)).encode()]
                    )
            case 7:  # lines in another order, or twice
                lines = bytes(b).split(b"\n")
                i, k = dice.randrange(len(lines)), dice.randrange(len(lines))
                lines[i] = lines[k]
                b = bytearray(b"\n".join(lines))
            case _:  # the head of one, the tail of another
                other = dice.choice(others)
                b[at:] = other[dice.randrange(len(other) + 1) :]
    return bytes(b[:MAX_BYTES])


# ---- searching


@contextlib.contextmanager
def make_folder(parent: Path) -> Iterator[Path]:
    """Yield an empty folder."""
    folder = parent / "one"
    folder.mkdir()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def check_file(name: str, data: bytes, parent: Path) -> str:
    """Return the fault when these bytes are read, or ""."""
    with make_folder(parent) as folder:
        try:
            TARGETS[name].once(data, folder)
        except Broken as error:
            return str(error)
        except UserError as error:
            return f"refused where nobody says it: {error}"
        except Exception:  # an error that a reader does not handle
            return traceback.format_exc()
    return ""


def keep_file(name: str, data: bytes, what: str, found: Path) -> Path:
    """Write a file that breaks a check to the folder of its target."""
    place = found / f"reader_{name}"
    place.mkdir(parents=True, exist_ok=True)
    path = place / hashlib.sha256(data).hexdigest()[:16]
    path.write_bytes(data)
    print(f"{name}: {what.strip()}\n  kept as {path}", flush=True)
    return path


def search_target(name: str, runs: int, seconds: float, seed: int, found: Path) -> tuple[int, int]:
    """Read changed files until `runs` or `seconds` are over.

    Keeps one file for each way of breaking. Returns the number of runs and of findings.
    """
    target, dice, end, ways = (
        TARGETS[name],
        random.Random(f"{name} {seed}"),
        time.monotonic() + seconds,
        set[str](),
    )
    seeds = target.seeds() + [data for _, data in read_kept(name)]
    pool, done = list(seeds), 0
    with tempfile.TemporaryDirectory(prefix="tse-fuzz-") as parent:
        for data in seeds:
            if what := check_file(name, data, Path(parent)):
                keep_file(name, data, f"a good file: {what}", found)
                return done, 1
        while done < runs and time.monotonic() < end:
            data = dice.choice(pool)
            data = change_file(dice, data, pool, target.words)
            done += 1
            if what := check_file(name, data, Path(parent)):
                way = classify_failure(what)
                if way not in ways:
                    ways.add(way)
                    keep_file(name, data, what, found)
            elif dice.random() < 0.05:  # changes on changes
                pool[len(seeds) :] = [*pool[len(seeds) :], data][-50:]
    return done, len(ways)


def classify_failure(what: str) -> str:
    """Return place and type of the exception, or the message without its values."""
    lines = what.strip().splitlines()
    places = [line for line in lines if re.match(r' *File ".*tselab', line)]
    return (
        " ".join([*places[-1:], lines[-1].partition(":")[0]])
        if places
        else re.sub(r"\d+|'[^']*'", "", lines[0])[:80]
    )


def read_kept(name: str) -> list[tuple[str, bytes]]:
    """Return name and bytes of files that once broke a check."""
    return inputs.read_found(f"reader_{name}")


def parse_options() -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(TARGETS)}; default: all")
    parser.add_argument(
        "--runs", type=int, default=1 << 62, help="files of each target; default: as many as --seconds allow"
    )
    parser.add_argument(
        "--seconds", type=float, default=float("inf"), help="for each target; default: 2 without --runs"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--found", type=Path, default=ROOT / "build/fuzz/found", help="where what breaks something is kept"
    )
    given = parser.parse_args()
    if wrong := [t for t in given.targets if t not in TARGETS]:
        parser.error(f"no target {wrong[0]}; there are {', '.join(TARGETS)}")
    if given.runs == 1 << 62 and given.seconds == float("inf"):
        given.seconds = 2.0
    return given


def limit_memory() -> None:
    """Limit the memory, so that a reader that takes more raises MemoryError."""
    if resource is not None:
        resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))


def run_targets() -> int:
    """Search the chosen targets."""
    given, findings = parse_options(), 0
    limit_memory()
    for name in given.targets or TARGETS:
        start = time.monotonic()
        done, wrong = search_target(name, given.runs, given.seconds, given.seed, given.found)
        findings += wrong
        seconds = round(time.monotonic() - start, 1)
        print(
            json.dumps({"target": f"reader_{name}", "inputs": done, "findings": wrong, "seconds": seconds}),
            flush=True,
        )
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(run_targets())
