"""tselab fleet: many logs of many cars, in any state, give one table and one page.

The run may be killed and started again, and may run on a cluster.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from conftest import COMMAND, tselab, tselab_here
from dask_cluster import kill_this_process, make_worker_command, start_programs, start_scheduler, wait_until
from tse.car.vehicle import read_vehicle
from tse.estimation.estimate import write_table
from tse.library.core import STIFFNESS, Config, SimConfig
from tse.library.errors import Interrupted, UserError
from tse.library.processes import LocalPool, check_workers
from tse.log.rows import Reading
from tse.report.report import read_figures
from tse.runs import work as module
from tse.runs.find import Drive, find_drives, find_start
from tse.runs.keep import Store, compute_key, find_unlike_tyres
from tse.runs.run import FleetPlan, get_outcome, run_drives
from tse.runs.work import Task, read_code_version
from tse.simulation import maneuvers
from tse.simulation.simulate import simulate

CARS = {"golf": 1.0, "up": 0.7}  # level of the road under the tyres, which is how soft the car looks
DAYS = 3


def write_drive(path: Path, car: Path, seed: int, level: float, seconds: float = 20.0) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    config = Config.exact(read_vehicle(car).values)
    plan = maneuvers.build(
        "double-lane-change", config, sample_time=0.02, duration=seconds, road=[(0.0, level)]
    )
    write_table(simulate(plan, config, SimConfig({"seed": seed})).log, path)


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> Path:
    """Two cars on three days, and three logs that are none."""
    folder = tmp_path_factory.mktemp("fleet")
    car = folder / "car.toml"
    car.write_text(tselab("vehicle", "--simulated").out, encoding="utf-8")
    for i, (name, level) in enumerate(CARS.items()):
        for day in range(1, DAYS + 1):
            write_drive(folder / "logs" / name / f"2024-05-{day:02d}.csv", car, 10 * i + day, level)
    (folder / "logs" / "golf" / "2024-05-02 empty.csv").write_text("")
    (folder / "logs" / "up" / "2024-05-09.mf4").write_bytes(b"MDF     4.10 and no more")
    (folder / "logs" / "up" / "2024-05-09.csv").write_text("time,speed\n0,1\n0.01,1\n0.02,1\n")
    return folder


def run_fleet(folder: Path, out: Path, *more: object):
    return tselab_here(
        "fleet", folder / "logs", "--vehicle", folder / "car.toml", "--out", out, "--jobs", 2, *more
    )


@pytest.fixture(scope="module")
def done(logs):
    """The whole of it once, in two processes."""
    out = logs / "out"
    return run_fleet(logs, out, "--estimates"), out, pd.read_parquet(out / "fleet.parquet")


def test_a_row_per_log_stretch_and_stiffness_and_a_bad_log_is_a_row_with_its_error(done):
    ran, _, table = done
    assert (
        ran.code == 3 and "9 logs of 2 cars" in ran.out and "3 not estimated because of an error" in ran.out
    ), ran.err
    bad = table[table.error.notna()]
    assert set(bad.log.map(lambda p: Path(p).name)) == {
        "2024-05-02 empty.csv",
        "2024-05-09.mf4",
        "2024-05-09.csv",
    }
    assert (
        bad.value.isna().all()
        and bad.error.str.contains("is empty").any()
        and bad.error.str.contains("tselab signals").any()
    )
    good = table[table.error.isna()]
    assert sorted(good.groupby(["car", "log"]).stiffness.unique().map(len)) == [3] * 6
    last = good.groupby(["car", "stiffness"]).value.last() / good.groupby(["car", "stiffness"]).nominal.last()
    for name, level in CARS.items():
        np.testing.assert_allclose(
            last[name].to_numpy(), level, rtol=0.07
        )  # along: wheel radii are known to 0.2 % at best
    assert (good.sd > 0).all() and (good.start_from == "name").all()
    assert good.start_time.dt.day.tolist() == sorted(good[good.car == "golf"].start_time.dt.day) * 2


def test_a_drive_starts_from_what_the_one_before_it_taught(done, logs, tmp_path):
    """--load-learnt, --age and --save-learnt by hand give the same bits.

    The first drive is valid late, the others at once.
    """
    _, out, table = done
    up = [logs / "logs" / "up" / f"2024-05-{day:02d}.csv" for day in (1, 2)]
    car = ["--vehicle", logs / "car.toml"]
    assert (
        tselab_here(
            "estimate", up[0], *car, "--out", tmp_path / "1.parquet", "--save-learnt", tmp_path / "l"
        ).code
        == 0
    )
    age = (86400 - table.seconds[table.log == str(up[0])].iloc[0]) / 86400
    again = tselab_here(
        "estimate",
        up[1],
        *car,
        "--out",
        tmp_path / "2.parquet",
        "--load-learnt",
        tmp_path / "l",
        "--age",
        age,
    )
    assert again.code == 0, again.err
    for day in (1, 2):
        (kept,) = (out / "estimates").glob(f"up-2024-05-{day:02d}-*.parquet")
        pd.testing.assert_frame_equal(pd.read_parquet(kept), pd.read_parquet(tmp_path / f"{day}.parquet"))
    (kept,) = (out / "learnt").glob("up.tse")
    assert kept.stat().st_size > 100
    alone = run_fleet(logs, tmp_path / "alone", "--no-learn", "--no-reports", "--jobs", 1)
    assert alone.code == 3
    by_itself = pd.read_parquet(tmp_path / "alone" / "fleet.parquet")
    second = [
        t[(t.log == str(up[1])) & (t.stiffness == "cy_front")].valid.iloc[0] for t in (table, by_itself)
    ]
    assert second[0] > second[1]


def test_the_page_links_to_every_report_and_names_the_softest_car_first(done):
    _, out, table = done
    page = (out / "fleet.html").read_text(encoding="utf-8")
    reports = table.report.dropna().unique()
    assert len(reports) == 6
    for report in reports:
        assert f'href="{report}"' in page and (out / report).stat().st_size > 10_000
    assert page.index('href="#car1">up<') < page.index('href="#car2">golf<')
    assert "of nominal" not in page and "kN/rad" in page
    assert re.search(r"<td>(front|rear), in bends \d+ ± \d+ kN/rad</td>", page)
    assert "Logs that could not be used" in page and "2024-05-02 empty.csv" in page

    assert [len(f["data"]) for f in read_figures(page)] == [3, 3, 3]  # all cars, and the trend of each


def test_what_is_done_is_used_again_and_what_has_changed_is_not(logs, done, tmp_path):
    _, out, table = done
    shutil.copytree(out, tmp_path / "out")
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "out" / "logs").iterdir()}
    start = time.monotonic()
    again = run_fleet(logs, tmp_path / "out")  # without --estimates: those of before are not asked for
    assert again.code == 3
    changed = {p.name for p, t in before.items() if p.stat().st_mtime_ns != t}
    assert len(changed) == 9  # they are part of what was asked
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "out" / "logs").iterdir()}
    again = run_fleet(logs, tmp_path / "out", "--json")
    assert again.code == 3 and time.monotonic() - start < 60
    assert all(p.stat().st_mtime_ns == t for p, t in before.items())
    said = json.loads(again.out)
    assert len(said["logs"]) == 9 and [c["car"] for c in said["cars"]] == ["up", "golf"]
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "out" / "fleet.parquet"), table)
    # of a stranger's hand, or cut off: made again
    one = next(p for p in before if p.name.startswith("golf-2024-05-03"))
    kept = json.loads(one.read_text())
    kept["content"]["outcome"]["rows"][0]["value"] = 1.0
    one.write_text(json.dumps(kept))
    other = next(p for p in before if p.name.startswith("up-2024-05-03"))
    other.write_text(other.read_text()[:100])
    assert run_fleet(logs, tmp_path / "out").code == 3
    assert {p for p, t in before.items() if p.stat().st_mtime_ns != t} == {one, other}
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "out" / "fleet.parquet"), table)


def test_a_result_is_made_again_where_anything_of_its_task_is_another(tmp_path):
    """Each field of a task is in the key of its result, by its content or by its name."""
    for name in ("log.csv", "other.csv", "log.signals.toml", "car.dbc", "filter.toml"):
        (tmp_path / name).write_text(name)
    for name, mass in (("car.toml", 1500), ("heavy.toml", 1900)):
        (tmp_path / name).write_text(
            f"mass = {mass}\nlf = 1.2\nlr = 1.4\nwheel_radius_front = 0.3\nwheel_radius_rear = 0.3\n"
        )
    task = replace(make_task(tmp_path / "log.csv"), vehicle=tmp_path / "car.toml")
    others = {
        "log": tmp_path / "other.csv",
        "vehicle": tmp_path / "heavy.toml",
        "signals": tmp_path / "car.dbc",
        "rate": 50.0,
        "strict": True,
        "databases": (tmp_path / "filter.toml",),
        "config": tmp_path / "filter.toml",
        "average": 0.1,
        "form": "robust",
        "settings": {"mass": 1700.0},
        "learnt": b"of the drive before",
        "age": 60.0,
        "report": True,
        "estimates": tmp_path / "est.parquet",
        "calibrate": True,
        "others": ((tmp_path / "other.csv", None),),
        "code": ("0.1", "another library"),
    }
    assert set(others) == {f.name for f in fields(Task)}
    keys = {name: compute_key(replace(task, **{name: value})) for name, value in others.items()}
    assert len({compute_key(task), *keys.values()}) == 1 + len(others), keys


@pytest.mark.parametrize("named", [True, False])
def test_a_result_is_made_again_where_a_database_of_its_bus_is_another(named, tmp_path):
    """A database that no option names: signals.toml names it, or it is beside the log."""
    folder = tmp_path / "databases" if named else tmp_path
    folder.mkdir(exist_ok=True)
    (folder / "car.dbc").write_text("")
    (tmp_path / "log.blf").write_bytes(b"")
    if named:
        text = '[log]\ndatabases = ["databases/car.dbc"]\n[signals.yaw_rate]\nname = "YawRate"\n'
        (tmp_path / "signals.toml").write_text(text)
    car = tmp_path / "car.toml"
    car.write_text("mass = 1500\nlf = 1.2\nlr = 1.4\nwheel_radius_front = 0.3\nwheel_radius_rear = 0.3\n")
    task = replace(make_task(tmp_path / "log.blf"), vehicle=car)
    before = compute_key(task)
    assert compute_key(task) == before
    (folder / "car.dbc").write_text('VERSION "2"\n')
    assert compute_key(task) != before


def test_killed_and_started_again_it_loses_no_log_that_was_done(logs, done, tmp_path):
    command = [
        *COMMAND,
        "fleet",
        logs / "logs",
        "--vehicle",
        logs / "car.toml",
        "--out",
        tmp_path / "out",
        "--jobs",
        1,
        "--no-reports",
    ]
    process = subprocess.Popen([*map(str, command)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    kept = tmp_path / "out" / "logs"
    end = time.monotonic() + 90
    while len(list(kept.glob("*.json"))) < 2 and time.monotonic() < end:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    before = {p: p.stat().st_mtime_ns for p in kept.glob("*.json")}
    assert 2 <= len(before) < 9 and not (tmp_path / "out" / "fleet.parquet").exists()
    assert run_fleet(logs, tmp_path / "out", "--no-reports").code == 3
    assert all(p.stat().st_mtime_ns == t for p, t in before.items())
    table = pd.read_parquet(tmp_path / "out" / "fleet.parquet")
    pd.testing.assert_frame_equal(table.drop(columns="report"), done[2].drop(columns="report"))


def make_task(log: Path) -> Task:
    """Return a task that has a log only."""
    return Task(
        log,
        log.parent,
        None,
        None,
        False,
        (),
        None,
        None,
        "default",
        {},
        None,
        0.0,
        False,
        None,
        False,
        (),
        read_code_version(),
    )


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_a_log_that_kills_its_process_is_the_one_that_is_blamed(tmp_path):
    with LocalPool(kill_this_process, 2) as workers:
        for name in ("a", "deadly", "b"):
            workers.submit(make_task(tmp_path / name))
        found = {t.log.name: get_outcome(t, result) for t, result in (workers.next() for _ in range(3))}
    assert {name for name, o in found.items() if o.error} == {"deadly"} and "memory" in found["deadly"].error


def test_which_car_a_log_is_of(logs, tmp_path):
    """By the folder, by the table, by a word."""
    car = logs / "car.toml"
    mine = find_drives([str(logs / "logs")], car, None, None, tmp_path)
    assert [d.car for d in mine] == ["golf"] * 4 + ["up"] * 5
    assert {d.car for d in find_drives([str(logs / "logs" / "up")], car, None, None, tmp_path)} == {"up"}
    assert {d.car for d in find_drives([str(logs / "logs")], car, None, "mine", tmp_path)} == {"mine"}
    assert len(find_drives([str(logs / "logs" / "*" / "*-01.csv")], car, None, None, tmp_path)) == 2
    table = tmp_path / "cars.csv"
    table.write_text(f"log,vehicle,car\n{logs}/logs/golf,{car},GO 1\n{logs}/logs/up/*.csv,{car},\n")
    mine = find_drives([str(logs / "logs")], None, table, None, tmp_path)
    assert {d.car for d in mine if not d.error} == {"GO 1", "car"}
    # one name of many files: what one car teaches is nothing to the other
    for name in CARS:
        (tmp_path / name).mkdir()
        shutil.copy(car, tmp_path / name / "vehicle.toml")
    rows = "".join(f"{logs}/logs/{name},{name}/vehicle.toml\n" for name in CARS)
    (tmp_path / "two.csv").write_text(f"log,vehicle\n{rows}")
    two = find_drives([str(logs / "logs")], None, tmp_path / "two.csv", None, tmp_path)
    assert {d.car for d in two} == {"golf/vehicle", "up/vehicle"}
    odd = tmp_path / "[x] #1"  # above the table, and in it
    shutil.copytree(logs / "logs" / "golf", odd / "#2")
    (odd / "cars.csv").write_text("# mine\nlog,vehicle,car\n./#2/*.csv,../golf/vehicle.toml,GO #3\n")
    assert {d.car for d in find_drives([str(odd)], None, odd / "cars.csv", None, tmp_path)} == {"GO #3"}
    (lost,) = (d for d in mine if d.error)
    assert lost.log.suffix == ".mf4" and "no row of cars.csv matches this log" in lost.error


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("log,car\n", "column vehicle is missing"),
        ("log,vehicle\nx,\n", "line 2, column vehicle: is empty"),
        ("log,vehicle\nx,nowhere.toml\n", "nowhere.toml: no such file"),
        (
            "log,vehicle,car\nx,a.toml,golf\ny,b.toml,golf\n",
            "line 3, column vehicle: a line above gives the vehicle file a.toml for the same car golf",
        ),
        ("", "cannot be read as a CSV"),
    ],
)
def test_a_table_that_is_wrong_is_refused_with_its_place(text, said, logs, tmp_path):
    (tmp_path / "cars.csv").write_text(text)
    done = tselab_here("fleet", logs / "logs", "--vehicles", tmp_path / "cars.csv", "--out", tmp_path / "out")
    assert done.code == 2 and said in done.err, done.err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("nowhere/", "--vehicle", "car.toml"), "nowhere/: no such file or folder"),
        (("logs",), "give either --vehicle"),
        (("logs", "--vehicle", "car.toml", "--scheduler", "tcp://127.0.0.1:1"), "no Dask scheduler answers"),
        (("empty", "--vehicle", "car.toml"), "no log is in this folder"),
    ],
)
def test_what_cannot_be_run_is_refused(options, said, logs, tmp_path):
    (logs / "empty").mkdir(exist_ok=True)
    done = tselab_here("fleet", *options, "--out", tmp_path / "out", cwd=logs)
    assert done.code == 2 and said in done.err, done.err


def test_when_a_drive_began(tmp_path):
    def at(name: str, content: bytes = b"") -> tuple[float, str]:
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_bytes(content)
        when, source = find_start(path)
        return pd.Timestamp(when, unit="s").isoformat(), source

    assert at("drive_20240501-081502.csv") == ("2024-05-01T08:15:02", "name")
    assert at("2024-05-01T08.15.csv") == ("2024-05-01T08:15:00", "name")
    assert at("2023_12_31/part 3.csv") == ("2023-12-31T00:00:00", "name")
    assert at("4711_12345678.csv")[1] == "file"
    mf4 = b"MDF     4.10    ".ljust(64, b"\0") + b"##HD".ljust(72, b"\0") + int(1.7e18).to_bytes(8, "little")
    assert at("a.mf4", mf4.ljust(300, b"\0")) == ("2023-11-14T22:13:20", "log")
    blf = b"LOGG".ljust(40, b"\0") + b"".join(
        x.to_bytes(2, "little") for x in (2022, 2, 1, 28, 23, 59, 58, 0)
    )
    assert at("2024-01-01.blf", blf.ljust(200, b"\0")) == ("2022-02-28T23:59:58", "log")


def test_ctrl_c_says_how_to_go_on(logs, tmp_path, monkeypatch):
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(LocalPool, "next", stop)
    found = find_drives([str(logs / "logs")], logs / "car.toml", None, None, tmp_path)
    with pytest.raises(Interrupted, match=r"keeps the 0 of 9 logs .* and the same command continues"):
        run_drives(found, FleetPlan(Reading(), reports=False), Store(tmp_path, False), 1)


@pytest.mark.slow
def test_on_a_cluster_a_worker_that_is_killed_costs_nothing(logs, done, tmp_path):
    distributed = pytest.importorskip(
        "distributed", reason="dask.distributed is missing: there is no cluster to test with"
    )
    with start_programs() as start:
        address = start_scheduler(start)
        with distributed.Client(address, set_as_default=False) as client:
            first = start(*make_worker_command(address, tmp_path / "dask"))
            wait_until(lambda: len(client.scheduler_info()["workers"]) == 1)
            command = [
                *COMMAND,
                "fleet",
                logs / "logs",
                "--vehicle",
                logs / "car.toml",
                "--out",
                tmp_path / "out",
                "--no-reports",
                "--scheduler",
                address,
            ]
            process = subprocess.Popen(
                [*map(str, command)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
            )
            kept = tmp_path / "out" / "logs"
            wait_until(lambda: len(list(kept.glob("*.json"))) >= 2)
            start(*make_worker_command(address, tmp_path / "dask"))
            first.kill()  # in the middle of a log
            _, said = process.communicate(timeout=120)
    assert process.returncode == 3, said
    table = pd.read_parquet(tmp_path / "out" / "fleet.parquet")
    pd.testing.assert_frame_equal(table.drop(columns="report"), done[2].drop(columns="report"))


def test_a_cluster_without_workers_or_with_another_tselab_is_refused(tmp_path):
    distributed = pytest.importorskip(
        "distributed", reason="dask.distributed is missing: there is no cluster to test with"
    )
    (tmp_path / "old" / "tse" / "library").mkdir(parents=True)
    (tmp_path / "old" / "tse" / "__init__.py").touch()
    (tmp_path / "old" / "tse" / "library" / "__init__.py").write_text('__version__ = "0.0.1"\n')
    with start_programs() as start:
        address = start_scheduler(start)
        with distributed.Client(address, set_as_default=False) as client:
            with pytest.raises(UserError, match="has no workers"):
                check_workers(client, address)
            start(*make_worker_command(address, tmp_path / "dask"), path=tmp_path / "old")
            wait_until(lambda: len(client.scheduler_info()["workers"]) == 1)
            with pytest.raises(UserError, match=r"has tselab 0\.0\.1, but this process has tselab"):
                check_workers(client, address)


def test_the_table_is_read_by_others_as_the_help_says(done):
    """What the help says of reading it works."""
    _, out, table = done
    assert set(table.usable.unique()) <= {"yes", "in part", "no"}
    assert list(STIFFNESS) == table.stiffness.dropna().unique().tolist()
    duckdb = pytest.importorskip("duckdb", reason="duckdb is not installed")
    text = (
        f"select car, stiffness, arg_max(value, start_time) from '{out}/fleet.parquet' "
        "where usable <> 'no' group by all"
    )
    assert len(duckdb.sql(text).fetchall()) == 6


def test_no_word_is_lost_of_an_error_that_is_a_fault_of_ours(monkeypatch, tmp_path):
    def fail(_: object) -> None:
        raise ZeroDivisionError("of ours")

    monkeypatch.setattr(module, "_run_log", fail)
    assert "internal error: ZeroDivisionError: of ours" in module.run_task(make_task(tmp_path / "a")).error
    with pytest.raises(UserError, match="install the same version on all"):
        module.run_task(replace(make_task(tmp_path / "a"), code=("0", "0")))


def test_a_link_in_a_circle_is_a_row_with_its_error(tmp_path):
    (tmp_path / "loop.csv").symlink_to("loop.csv")
    assert [d.log.name for d in find_drives([str(tmp_path)], None, None, None, tmp_path / "out")] == [
        "loop.csv"
    ]


@pytest.mark.parametrize(("text", "says"), [
    ("log;vehicle\na.csv;car.toml\n", ""),  # as a German spreadsheet writes it
    ("log,vehicle,singals\na.csv,car.toml,\n", r"column singals is not known \(did you mean signals\?\)"),
])  # fmt: skip
def test_a_table_of_cars_of_any_spreadsheet(text, says, tmp_path):
    for name in ("a.csv", "car.toml"):
        (tmp_path / name).write_text("x")
    table = tmp_path / "cars.txt"
    table.write_text(text)
    if says:
        with pytest.raises(UserError, match=says):
            find_drives([str(tmp_path)], None, table, None, tmp_path / "out")
    else:
        assert (
            find_drives([str(tmp_path)], None, table, None, tmp_path / "out")[0].vehicle
            == (tmp_path / "car.toml").resolve()
        )


def test_cars_of_names_alike_have_files_of_their_own(tmp_path):
    """On a file system without upper case, too."""
    store = Store(tmp_path, False)
    names = ("car_1", "car 1", "Car_1", "x" * 61, "x" * 62)
    files = [store.calibrated(Drive(name, Path("log.csv"), tmp_path / "car.toml"), name) for name in names]
    assert [f.read_text() for f in files] == list(names) and len({f.name.lower() for f in files}) == len(
        names
    )


def test_a_log_of_another_car_is_said():
    rows = [
        {
            "car": "taxi",
            "log": f"{i}",
            "stiffness": "cy_front",
            "value": 100 * x,
            "nominal": 100.0,
            "sd": 2.0,
            "usable": "yes",
        }
        for i, x in enumerate((1.0, 1.05, 0.6, 0.95, 1.9))
    ]
    found = find_unlike_tyres(pd.DataFrame(rows))
    assert list(found) == ["4"] and "front cornering stiffness 1.9 times as large" in found["4"]
    assert find_unlike_tyres(pd.DataFrame(rows[:3])) == {}


# ---- Work in other processes that is interrupted.

MANY = """
import contextlib, sys, time
from tse.library import processes

if __name__ == "__main__":
    try:
        with contextlib.closing(processes.run_in_processes(time.sleep, [0.004] * 3000, 2)) as results:
            for i, _ in enumerate(results):
                if i == 3:
                    print("busy", flush=True)
    except KeyboardInterrupt:
        sys.exit(130)
"""


@pytest.mark.skipif(os.name == "nt", reason="no signals to a process")
def test_an_interrupt_between_many_short_tasks_ends_all(tmp_path):
    """Six interrupts find the fault with a probability of 1 - 0.6^6 = 95 %.

    Four of ten runs hung while a lock of each future was taken for every result.
    """
    (tmp_path / "many.py").write_text(MANY)
    for moment in range(6):
        run = subprocess.Popen(
            [sys.executable, str(tmp_path / "many.py")],
            stdout=subprocess.PIPE,
            start_new_session=True,
            preexec_fn=lambda: signal.signal(
                signal.SIGINT, signal.SIG_DFL
            ),  # a test run in the background ignores it
        )
        assert run.stdout is not None and run.stdout.readline() == b"busy\n"
        time.sleep(0.037 * moment)
        os.killpg(run.pid, signal.SIGINT)
        try:
            run.communicate(timeout=30)  # ends when the last worker has closed its copy
        finally:
            run.poll() is None and os.killpg(run.pid, signal.SIGKILL)
        assert run.returncode == 130


def test_cars_are_ranked_by_their_stiffness_and_not_by_their_own_calibration(done):
    """A car that is soft, and is soft in its vehicle file, is ranked as soft.

    For an unknown stiffness the reason is given.
    """
    from tse.runs.page import Car, Last

    def car(name, **last):
        return Car(
            name,
            [],
            {k: Last(v, 5e3, v / nominal, pd.Timestamp(0)) for k, (v, nominal) in last.items()},
            {} if last else {"cy_front": "too few bends in this log"},
        )

    stiff = car("stiff", cy_front=(100e3, 120e3), cx_front=(50e3, 50e3))
    soft = car("soft", cy_front=(90e3, 80e3), cy_rear=(70e3, 70e3))
    along, nothing = car("along", cx_front=(40e3, 50e3)), car("nothing")
    ranked = sorted([nothing, stiff, along, soft], key=lambda c: (c.place, c.name))
    assert [c.name for c in ranked] == ["soft", "stiff", "along", "nothing"]
    assert [c.reason for c in ranked] == [
        "rear, in bends 70 ± 5 kN/rad", "front, in bends 100 ± 5 kN/rad", "front, along 40 ± 5 kN",
        "no stiffness is known: too few bends in this log",
    ]  # fmt: skip
    _, _, table = done
    assert (table.usable == "yes").any() and table[table.usable == "yes"].reason.isna().all()
