"""Constant speed and gentle steering, which cannot tell delays apart: exit code 11; and the same on a Dask cluster of processes."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from conftest import Result, tselab
from dask_cluster import Start, free_port, scheduler, starting, until, worker
from gap_logs import car, write_log
from tselab.cli import main

GENTLE = "steering sine sweep 0.2 .. 3 Hz, 2 m/s2, at 20 m/s"
SEED, DELAY = 7, 0.02  # s
ALIKE = {"steering_delay", "imu_delay"}


@dataclass
class Gentle:
    """A car whose IMU is late, driven gently, at one speed."""

    log: Path
    vehicle: Path
    out: Path
    done: Result

    def run(self, out: Path, *more: object) -> Result:
        return tselab("gap", self.log, "--vehicle", self.vehicle, "--out", out, "--jobs", 1, *more)


@pytest.fixture(scope="module")
def gentle(tmp_path_factory) -> Gentle:
    folder = tmp_path_factory.mktemp("gentle")
    vehicle = car(folder)
    log = write_log(folder / "gentle.csv", vehicle, GENTLE, {"imu_delay_time": DELAY}, SEED, seconds=12.0)
    found = Gentle(log, vehicle, folder / "out", Result(0, "", ""))
    found.done = found.run(found.out)
    return found


def test_named_but_not_told_from_others_is_exit_11_in_so_many_words(gentle):
    """At one speed and without braking the car is a linear system: late wheels and a late IMU are the same thing to it."""
    assert gentle.done.code == 11, gentle.done.out + gentle.done.err
    verdict = json.loads((gentle.out / "verdict.json").read_text(encoding="utf-8"))
    assert verdict["verdict"] == "named"
    (effect,) = verdict["effects"]
    assert {effect["id"], *effect["look_alikes"]} >= ALIKE
    assert effect["parameters"]["time"]["value"] == pytest.approx(
        DELAY, rel=0.1
    )  # of a lag, too: seen below its corner
    sentence = f"These logs cannot exclude {', '.join(effect['look_alikes'])} in its place."
    assert verdict["words"][0].startswith("Stiffness at no slip") and sentence in verdict["words"][1]
    assert sentence in gentle.done.out
    assert sentence in (gentle.out / "vehicle_improved.toml").read_text(encoding="utf-8")


# ---- a cluster of processes


@pytest.fixture
def start() -> Iterator[Start]:
    """Starts `dask ARGS`; ends all of them, whatever happens."""
    pytest.importorskip("distributed", reason="dask.distributed is missing: there is no cluster to test with")
    with starting() as one:
        yield one


@pytest.fixture
def refused(gentle, tmp_path, monkeypatch, capsys) -> Callable[[str], str]:
    """What a run with --scheduler says that ends at once, in this process: a start of Python takes longer than all the rest."""

    def run(address: str) -> str:
        args = ["gap", gentle.log, "--vehicle", gentle.vehicle, "--out", tmp_path / "refused", "--scheduler", address]
        monkeypatch.setattr(sys, "argv", ["tselab", *map(str, args)])
        begin = time.monotonic()
        with pytest.raises(SystemExit) as end:
            main()
        out, err = capsys.readouterr()
        assert end.value.code == 2 and "internal error" not in err and "Traceback" not in err, out + err
        assert time.monotonic() - begin < 100  # some seconds; that it does not wait for ever
        return err

    return run


def test_cluster_of_processes_gives_the_same_verdict_and_says_what_it_lacks(gentle, start, refused, tmp_path):
    import distributed

    address = scheduler(start)
    assert f"the Dask cluster at {address} has no workers" in refused(address)

    one = worker(address, tmp_path / "dask")
    with distributed.Client(address, set_as_default=False) as client:
        start(*one)
        until(lambda: len(client.scheduler_info()["workers"]) == 1)
        far = gentle.run(tmp_path / "far", "--scheduler", address)
        assert far.code == gentle.done.code and "Traceback" not in far.err, far.err
        for file in ("verdict.json", "vehicle_improved.toml", "effects.h"):  # to the last bit
            assert (tmp_path / "far" / file).read_bytes() == (gentle.out / file).read_bytes(), file

        (tmp_path / "old" / "tselab").mkdir(parents=True)
        (tmp_path / "old" / "tselab" / "__init__.py").write_text('__version__ = "0.0.1"\n')
        start(*one, path=tmp_path / "old")
        until(lambda: len(client.scheduler_info()["workers"]) == 2)
        said = refused(address)
        assert address in said and "has tselab 0.0.1, this is tselab" in said, said


def test_nobody_at_the_address_is_said_at_once(refused):
    pytest.importorskip("distributed", reason="dask.distributed is missing: there is no cluster to test with")
    address = f"tcp://127.0.0.1:{free_port()}"
    assert f"no Dask scheduler answers at {address}" in refused(address)
