"""Functions of tse.fleet(), each alone: logs found, results stored, drives in order."""

import struct
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from tse.estimation.estimate import Estimates
from tse.library.core import STIFFNESS
from tse.library.errors import NoFile, UserError
from tse.library.processes import Died
from tse.log.rows import Reading
from tse.report.report import read_figures
from tse.runs import find as finding
from tse.runs import keep as keeping
from tse.runs import page as paging
from tse.runs import run as running
from tse.runs import work as working
from tse.runs.find import Drive, find_drives, find_start
from tse.runs.keep import Done, Store, compute_key, find_unlike_tyres, make_table
from tse.runs.page import Car, Last, draw_distribution, draw_trend, list_cars, write_fleet_page
from tse.runs.run import FleetPlan, get_outcome, group_by_car, run_drives
from tse.runs.work import Mismatch, Outcome, Task, run_task

CAR = "mass = 1500\nlf = 1.2\nlr = 1.4\nwheel_radius_front = 0.3\nwheel_radius_rear = 0.3\n"


def touch(path: Path, content: bytes = b"") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


@pytest.fixture
def car(tmp_path) -> Path:
    return touch(tmp_path / "car.toml", CAR.encode())


# ---- logs


@pytest.mark.parametrize(
    ("name", "is_log"),
    [
        ("a.csv", True),
        ("a.csv.gz", True),
        ("a.mf4", True),
        ("a.blf", True),
        ("a.est.csv", False),
        ("a.est.csv.gz", False),
        ("a.est.parquet", False),
        ("a.parquet", True),
        ("a.txt", False),
        ("a.log", False),
        ("a.can", False),
        ("a.bz2", False),
        ("rlog.bz2", True),
        ("2024--qlog.zst", True),
        ("a.pdf", False),
        ("csv", False),
    ],
)
def test_the_name_shows_whether_a_file_of_a_folder_is_a_log(name, is_log):
    assert finding._is_log_name(name) == is_log


def test_a_folder_is_searched_to_its_end_without_results_hidden_files_and_the_table(tmp_path):
    logs, out, table = tmp_path / "logs", tmp_path / "logs" / "out", tmp_path / "logs" / "cars.csv"
    for name in ("golf/2024/A.CSV", "golf/b.mf4", "up/c.csv.gz", "d.csv", ".hidden/e.csv", ".f.csv",
                 "out/g.csv", "cars.csv", "golf/notes.txt", "golf/h.est.csv"):  # fmt: skip
        touch(logs / name)
    touch(logs / "bag" / "metadata.yaml")
    touch(logs / "bag" / "part.csv")  # a file of the bag, which is one log
    found = finding._find_logs([str(logs)], out, table)
    assert [(p.relative_to(logs).as_posix(), f.name) for p, f in found] == [
        ("bag", "logs"),
        ("d.csv", "logs"),
        ("golf/2024/A.CSV", "golf"),  # the folder below the one that was named
        ("golf/b.mf4", "golf"),
        ("up/c.csv.gz", "up"),
    ]


def test_a_log_that_is_named_twice_is_one_and_a_named_file_may_have_any_name(tmp_path):
    one, two = touch(tmp_path / "a" / "one.txt"), touch(tmp_path / "a" / "two.csv")
    words = [str(one), str(tmp_path / "a"), str(tmp_path / "*" / "t*.csv"), str(tmp_path / "a" / ".." / "a")]
    found = finding._find_logs(words, tmp_path / "out", None)
    assert [(p, f) for p, f in found] == [(one, tmp_path / "a"), (two, tmp_path / "a")]
    (tmp_path / "b.csv").mkdir()  # a folder that is no bag matches no pattern
    with pytest.raises(NoFile, match=r"b\*: no such file or folder, and no file matches it"):
        finding._find_logs([str(tmp_path / "b*")], tmp_path / "out", None)
    with pytest.raises(UserError, match=r"b\.csv: no log is in this folder; .*\.csv"):
        finding._find_logs([str(tmp_path / "b.csv")], tmp_path / "out", None)


def test_a_name_is_the_shortest_end_that_no_other_has():
    paths = [Path(p) for p in ("/x/a/golf", "/x/b/golf", "/x/a/up", "/y/b/golf")]
    names = [finding._shorten_name(p, paths) for p in paths]
    assert names == ["a/golf", "x/b/golf", "up", "y/b/golf"]


def test_a_log_is_of_the_first_row_that_matches_it(tmp_path, car):
    logs = [touch(tmp_path / n) for n in ("golf/1.csv", "golf/2.csv", "golf2/1.csv", "up/x/1.csv", "z.csv")]
    touch(tmp_path / "s" / "signals.toml")
    other = touch(tmp_path / "cars" / "up.toml", CAR.encode())
    table = tmp_path / "cars.csv"
    rows = ["log,vehicle,car,signals", "golf/2.csv,car.toml,first,", "golf,car.toml,,s/signals.toml"]
    table.write_text("\n".join([*rows, "up/*/1.csv,cars/up.toml,,", "golf2/1.csv,cars/up.toml,,"]) + "\n")
    found = finding._assign_by_table([(p, p.parent) for p in logs], table)
    assert [d.car for d in found] == ["car", "first", "up", "up", ""]
    assert [d.vehicle for d in found] == [car, car, other, other, None]
    assert [d.signals for d in found] == [tmp_path / "s" / "signals.toml", None, None, None, None]
    assert [bool(d.error) for d in found] == [False] * 4 + [True]
    assert found[4].error == f"{logs[4]}: no row of cars.csv matches this log"


def test_lines_of_a_table_are_counted_with_its_comments_and_blank_lines(tmp_path, car):
    table = tmp_path / "cars.csv"
    table.write_text("# my cars\n\nlog,vehicle\na.csv,car.toml\n# the next\nb.csv,gone.toml\n")
    with pytest.raises(NoFile, match=r"line 6, column vehicle: gone\.toml: no such file"):
        finding._read_table(table)
    table.write_text("# my cars\nlog,vehicle,signals\n\na.csv,car.toml,gone.toml\n")
    with pytest.raises(NoFile, match=r"line 4, column signals: gone\.toml: no such file"):
        finding._read_table(table)
    table.write_text("log;vehicle;car\n a.csv ;car.toml; my,car \n#b.csv;gone.toml;\n", encoding="utf-8")
    assert finding._read_table(table) == [
        {"log": "a.csv", "vehicle": "car.toml", "car": "my,car", "signals": ""}
    ]
    with pytest.raises(NoFile, match=r"gone\.csv: no such file \(option --vehicles\)"):
        finding._read_table(tmp_path / "gone.csv")


def test_drives_are_in_order_of_car_time_and_name(tmp_path):
    names = ("b/2024-01-02.csv", "a/2024-03-01.csv", "b/x 2023-12-31.csv", "a/2024-03-01 b.csv")
    for name in names:
        touch(tmp_path / name)
    found = find_drives([str(tmp_path)], None, None, None, tmp_path / "out")
    assert [f"{d.car}/{d.log.name}" for d in found] == [*sorted([names[1], names[3]]), names[2], names[0]]
    assert found[3].start - found[2].start == 2 * 86400 and found[0].start_from == "name"


# ---- the time of a drive


def utc(*parts: int) -> float:
    return datetime(*parts, tzinfo=timezone.utc).timestamp()


@pytest.mark.parametrize(
    ("name", "when"),
    [
        ("x/1999-12-31_23-59-58.csv", (1999, 12, 31, 23, 59, 58)),
        ("x/log 20240229T0102.csv", (2024, 2, 29, 1, 2)),
        ("x/2024.03.04 05h06m07.csv", (2024, 3, 4, 5, 6, 7)),
        ("2024-01-01/2024-01-02.csv", (2024, 1, 2)),  # the name of the log before that of its folder
        ("x/20240230.csv", None),
        ("x/120240203.csv", None),
        ("x/2024-13-01.csv", None),
        ("2024-01-01/x/a.csv", None),  # a folder further up is not that of the log
    ],
)
def test_a_date_in_a_name_is_its_start(tmp_path, name, when):
    path = touch(tmp_path / name)
    import os

    os.utime(path, (1e9, 1.1e9))  # accessed, modified
    assert find_start(path) == ((utc(*when), "name") if when else (1.1e9, "file"))


def make_mdf4(nanoseconds: int) -> bytes:
    return b"MDF     4.10".ljust(64, b"\0") + b"##HD".ljust(72, b"\0") + struct.pack("<Q", nanoseconds)


def make_mdf3(text: bytes) -> bytes:
    return b"MDF     3.30".ljust(64, b"\0") + b"HD".ljust(18, b"\0") + text


def make_blf(*parts: int) -> bytes:
    return b"LOGG".ljust(40, b"\0") + struct.pack("<8H", *parts) + bytes(100)


@pytest.mark.parametrize(
    ("content", "when"),
    [
        (make_mdf4(1_700_000_000_500_000_000), 1_700_000_000.5),
        (make_mdf4(0), None),
        (make_mdf4(1_700_000_000_500_000_000).replace(b"##HD", b"##DG"), None),
        (make_mdf3(b"05:04:202307:08:09"), utc(2023, 4, 5, 7, 8, 9)),
        (make_mdf3(b" " * 18), None),
        (make_blf(2022, 2, 1, 28, 23, 59, 58, 250), utc(2022, 2, 28, 23, 59, 58) + 0.25),
        (make_blf(2022, 13, 1, 28, 23, 59, 58, 250), None),
        (b"MDF     4.10", None),
        (b"LOGG", None),
        (b"time,speed\n", None),
    ],
)
def test_the_time_in_a_log_is_before_that_of_its_name(tmp_path, content, when):
    path = touch(tmp_path / "2024-01-02.log", content)
    expected = (pytest.approx(when, abs=1e-6), "log") if when else (utc(2024, 1, 2), "name")
    assert find_start(path) == expected


def test_the_time_of_an_mcap_file_is_that_of_its_first_message(tmp_path, monkeypatch):
    path = touch(tmp_path / "2024-01-02.mcap", b"\x89MCAP0\r\n")
    assert find_start(path) == (utc(2024, 1, 2), "name")  # damaged
    statistics = SimpleNamespace(message_start_time=1_650_000_000_250_000_000)
    of = {"now": statistics}
    reader = SimpleNamespace(get_summary=lambda: SimpleNamespace(statistics=of["now"]))
    monkeypatch.setattr(
        finding.importlib, "import_module", lambda _: SimpleNamespace(make_reader=lambda _: reader)
    )
    assert find_start(path) == (pytest.approx(1_650_000_000.25), "log")
    of["now"] = None
    assert find_start(path)[1] == "name"


def test_a_log_that_is_not_there_has_no_time(tmp_path):
    assert find_start(tmp_path / "gone.csv") == (0.0, "file")


# ---- results


def make_task(log: Path, vehicle: Path | None = None, **more) -> Task:
    fields = {
        **dict.fromkeys(("signals", "rate", "config", "average", "learnt", "estimates")),
        **dict.fromkeys(("strict", "report", "calibrate"), False),
        **dict.fromkeys(("databases", "others"), ()),
        **{"form": "default", "settings": {}, "age": 0.0, "code": working.read_code_version()},
    }
    return Task(log=log, vehicle=vehicle or log.parent / "car.toml", **(fields | more))


def test_what_was_stored_is_loaded_as_it_was(tmp_path, car):
    drive = Drive("my car", touch(tmp_path / "a b.csv", b"1"), car)
    task, store = make_task(drive.log), Store(tmp_path / "out", False)
    outcome = Outcome(rows=[{"value": 1.5, "low": np.float64(2)}], learnt=b"\0\xff", report=b"<html>",
                      seconds=12.5, code=3, notes=["a note"], calibrated="mass = 1\n")  # fmt: skip
    assert store.load(drive, task) is None
    made = store.save(drive, task, outcome)
    assert outcome.report is None and (tmp_path / "out" / made.report).read_bytes() == b"<html>"
    assert made.report == f"reports/{store.name(drive)}.html"
    kept = store.load(drive, task)
    assert kept.drive == drive and kept.report == made.report and kept.outcome == outcome
    assert store.load(drive, replace(task, strict=True)) is None
    drive.log.write_bytes(b"12")  # another size
    assert store.load(drive, task) is None


def test_a_result_without_its_report_or_estimates_is_made_again(tmp_path, car):
    store = Store(tmp_path / "out", False)
    drive = Drive("car", touch(tmp_path / "a.csv"), car)
    task = make_task(drive.log)
    made = store.save(drive, task, Outcome(report=b"page"))
    (tmp_path / "out" / made.report).unlink()
    assert store.load(drive, task) is None
    task = make_task(drive.log, estimates=store.estimates(drive))
    store.save(drive, task, Outcome())
    assert store.load(drive, task) is None
    touch(task.estimates)
    assert store.load(drive, task).outcome == Outcome()
    task.estimates.unlink()
    store.save(drive, task, Outcome(error="no log"))  # an error has no estimates
    assert store.load(drive, task).outcome.error == "no log"


def test_a_restart_forgets_what_is_done_and_nothing_else(tmp_path, car):
    drive = Drive("car", touch(tmp_path / "a.csv"), car)
    store, task = Store(tmp_path / "out", False), make_task(drive.log)
    store.save(drive, task, Outcome(report=b"page"))
    assert Store(tmp_path / "out", False).load(drive, task) is not None
    restarted = Store(tmp_path / "out", True)
    assert restarted.load(drive, task) is None and list((tmp_path / "out" / "reports").iterdir())


def test_names_of_files_are_plain_and_logs_of_one_name_differ(tmp_path):
    store = Store(tmp_path / "out", False)
    one, two = (Drive("GÖ: 1", tmp_path / f / "a/../.x?.csv") for f in "ab")
    assert store.name(one).startswith("GÖ_1-x-") and store.name(one)[:-8] == store.name(two)[:-8]
    assert store.name(one) != store.name(two) and len(store.name(one).split("-")[-1]) == 8
    assert keeping._clean_name("...") == "log" and keeping._clean_name("a.b-c_d") == "a.b-c_d"
    assert len(keeping._clean_name("x" * 99)) == 60
    assert store.estimates(one) == tmp_path / "out" / "estimates" / f"{store.name(one)}.parquet"


def test_a_calibrated_car_is_written_once_as_long_as_it_is_the_same(tmp_path, car):
    store, drive = Store(tmp_path / "out", False), Drive("golf", tmp_path / "a.csv", car)
    path = store.calibrated(drive, "mass = 1\n")
    assert path.name == "golf-car.toml" and path.read_text() == "mass = 1\n"
    before = path.stat().st_ino
    assert store.calibrated(drive, "mass = 1\n").stat().st_ino == before
    assert store.calibrated(drive, "mass = 2\n").read_text() == "mass = 2\n"


def make_row(**more) -> dict:
    return {"stretch": 1, "start": 0.0, "end": 60.0, "stiffness": "cy_front", "value": 1e5, "sd": 2e3,
            "nominal": 1e5, "usable": "yes"} | more  # fmt: skip


def test_the_table_has_a_row_for_each_result_and_one_for_each_error():
    car = Path("car.toml")
    done = [
        Done(Drive("a", Path("1.csv"), car, start=86400.5, start_from="name"),
             Outcome(rows=[make_row(), make_row(stiffness="cy_rear")], seconds=30.0), "reports/1.html"),
        Done(Drive("a", Path("2.csv"), None), Outcome(error="is empty")),
        Done(Drive("b", Path("3.csv"), car), Outcome()),
    ]  # fmt: skip
    table = make_table(done)
    assert list(table) == list(keeping.FLEET_COLUMNS)
    assert table.log.tolist() == ["1.csv", "1.csv", "2.csv", "3.csv"] and table.car.tolist() == [*"aaab"]
    assert table.start_time[0] == pd.Timestamp("1970-01-02T00:00:00.5Z")
    assert table.seconds.tolist() == [30, 30, 0, 0] and table.start_from[0] == "name"
    assert table.error[2:].tolist() == ["is empty", "no row could be used"] and table.error[:2].isna().all()
    assert table.usable.tolist() == ["yes", "yes", "no", "no"]
    assert table.report[0] == "reports/1.html" and table.report[2:].isna().all()
    assert table.vehicle.isna().tolist() == [False, False, True, False]


def make_fleet(*levels: float, **more) -> list[Done]:
    """Return a log of one car for each level of its front cornering stiffness."""
    return [
        Done(Drive("taxi", Path(f"{i}.csv")), Outcome(rows=[make_row(value=1e5 * x) | more]))
        for i, x in enumerate(levels)
    ]


def test_a_log_of_other_tyres_has_a_warning_in_all_of_its_rows():
    done = make_fleet(1.0, 1.0, 1.0, 2.0)
    done[3].outcome.rows.append(make_row(stiffness="cy_rear", warnings="steer_angle is late"))
    table = make_table(done)
    text = ("compared with the other logs of this car, front cornering stiffness 2.0 times as large: "
            "check car, load and tyres")  # fmt: skip
    assert table.warnings[:3].isna().all()
    assert table.warnings[3:].tolist() == [text, f"steer_angle is late\n{text}"]


@pytest.mark.parametrize(
    ("levels", "more", "warned"),
    [
        ((1.0, 1.0, 1.0, 1.5), {}, True),
        ((1.0, 1.0, 1.5), {}, False),  # too few others
        ((1.0, 1.0, 1.0, 1.33), {}, False),  # 1.3, and 2 sd of 2 % of 1
        ((1.0, 1.0, 1.0, 1.36), {}, True),
        ((1.0, 1.0, 1.0, 1.5), {"sd": 2e4}, False),
        ((1.0, 1.0, 1.0, 1.5), {"sd": None}, False),
        ((1.0, 1.0, 1.0, 1.5), {"usable": "no"}, False),
        ((1.0, 1.0, 1.0, 1.5), {"usable": "in part"}, True),
        ((1.0, 1.0, 1.0, 0.4), {}, False),
        ((0.9, 0.9, 1.1, 1.1, 1.35), {}, True),  # the median of the others is 1.0
    ],
)
def test_a_stiffness_far_above_that_of_the_other_logs_is_warned_of(levels, more, warned):
    found = find_unlike_tyres(make_table(make_fleet(*levels, **more)))
    assert list(found) == ([f"{len(levels) - 1}.csv"] if warned else [])


def test_stiffness_is_compared_over_its_nominal_value_and_only_within_a_car():
    done = make_fleet(1.0, 1.0, 1.0, 2.0)
    done[3].outcome.rows[0]["nominal"] = 2e5  # the vehicle file of this log has stiffer tyres
    assert find_unlike_tyres(make_table(done)) == {}
    done = make_fleet(1.0, 1.0, 1.0, 2.0)
    done[3].drive = replace(done[3].drive, car="bus")
    assert find_unlike_tyres(make_table(done)) == {}
    done = make_fleet(1.0, 1.0, 1.0, 1.0)
    done[0].outcome.rows.append(make_row(value=1.6e5, stretch=2))  # on its second stretch
    assert list(find_unlike_tyres(make_table(done))) == ["0.csv"]
    done = make_fleet(1.0, 1.0, 1.0, 2.0)
    for d in done:
        d.outcome.rows.append(d.outcome.rows[0] | {"stiffness": "cy_rear"})
    (text,) = find_unlike_tyres(make_table(done)).values()
    assert "front cornering stiffness 2.0 times, rear cornering stiffness 2.0 times as large" in text


def test_the_folder_keeps_what_the_last_drive_of_each_car_taught(tmp_path):
    store = Store(tmp_path, False)
    done = [Done(Drive(c, Path(f"{i}.csv")), Outcome(rows=[make_row()], learnt=x)) for i, (c, x) in
            enumerate([("a", b"1"), ("a", b"2"), ("a", None), ("b", None), ("c", b"3")])]  # fmt: skip
    table = store.write(done)
    assert {p.name: p.read_bytes() for p in (tmp_path / "learnt").iterdir()} == {"a.tse": b"2", "c.tse": b"3"}
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "fleet.parquet"), table)
    assert len(table) == 5


def test_the_key_of_a_result_has_what_the_files_are_and_not_only_their_names(tmp_path, car):
    log = touch(tmp_path / "a.csv", b"123")
    config = touch(tmp_path / "filter.toml", b"a")
    task = make_task(log, config=config, learnt=b"1", age=1.0)
    seen = [compute_key(task)]
    assert compute_key(replace(task, age=1.0004)) == seen[0]
    config.write_bytes(b"b")
    seen.append(compute_key(task))
    car.write_text(CAR.replace("1500", "1600"))
    seen.append(compute_key(task))
    touch(tmp_path / "signals.toml", b'[signals.yaw_rate]\nname = "r"\n')
    seen.append(compute_key(task))
    seen.append(compute_key(replace(task, age=1.002)))
    assert len(set(seen)) == 5


# ---- drives one after the other


def make_drives(*cars: str, tmp_path: Path, car: Path) -> list[Drive]:
    """Return a drive of each car, a day apart."""
    return [
        Drive(c, touch(tmp_path / f"{i}.csv"), car, start=86400.0 * i, start_from="name")
        for i, c in enumerate(cars)
    ]


@pytest.fixture
def ran(monkeypatch) -> list[Task]:
    """The tasks that were run; each takes 100 s and teaches its own name."""
    tasks: list[Task] = []

    def run(task: Task) -> Outcome:
        tasks.append(task)
        return Outcome(
            learnt=task.log.name.encode(),
            seconds=100.0,
            error=f"{task.log}: so" if "3" in task.log.name else "",
        )

    monkeypatch.setattr(running, "run_task", run)
    return tasks


def test_drives_of_a_car_follow_each_other_and_the_longest_chain_begins(tmp_path, car, ran):
    drives = make_drives("a", "b", "b", "b", "a", tmp_path=tmp_path, car=car)
    done = run_drives(drives, FleetPlan(Reading()), Store(tmp_path / "out", False), jobs=0)
    assert [d.drive for d in done] == drives
    assert [t.log.name for t in ran] == ["1.csv", "0.csv", "2.csv", "4.csv", "3.csv"]
    of = {t.log.name: t for t in ran}
    assert (of["1.csv"].learnt, of["1.csv"].age) == (None, 0.0)
    assert (of["2.csv"].learnt, of["2.csv"].age) == (b"1.csv", 86400 - 100)
    assert (of["4.csv"].learnt, of["4.csv"].age) == (b"0.csv", 4 * 86400 - 100)
    assert done[3].outcome.error == f"{drives[3].log}: so"
    again = run_drives(drives, FleetPlan(Reading()), Store(tmp_path / "out", False), jobs=0)
    assert len(ran) == 5 and [d.outcome for d in again] == [d.outcome for d in done]


def test_without_learning_each_drive_is_for_itself(tmp_path, car, ran):
    drives = make_drives("a", "b", "b", tmp_path=tmp_path, car=car)
    run_drives(drives, FleetPlan(Reading(), learn=False), Store(tmp_path / "out", False), jobs=0)
    assert running._group_chains(drives, False) == [[d] for d in drives]
    assert [(t.log.name, t.learnt, t.others) for t in ran] == [(f"{i}.csv", None, ()) for i in range(3)]


def test_a_drive_that_cannot_be_run_is_skipped_and_stops_no_other(tmp_path, car, ran):
    drives = make_drives("a", "a", "a", tmp_path=tmp_path, car=car)
    drives[0] = replace(drives[0], error="no row matches")
    drives[1] = replace(drives[1], vehicle=None)
    done = run_drives(drives, FleetPlan(Reading()), Store(tmp_path / "out", False), jobs=0)
    assert [d.outcome.error for d in done] == ["no row matches", f"{drives[1].log}: no vehicle file", ""]
    assert [t.log.name for t in ran] == ["2.csv"]


def test_a_drive_that_was_not_estimated_discards_nothing_that_was_learnt(tmp_path, car, monkeypatch):
    tasks: list[Task] = []

    def run(task: Task) -> Outcome:
        tasks.append(task)
        if task.log.name in ("1.csv", "2.csv"):
            return Outcome(error=f"{task.log}: no rows")
        return Outcome(learnt=task.log.name.encode(), seconds=100.0)

    monkeypatch.setattr(running, "run_task", run)
    drives = make_drives("a", "a", "a", "a", tmp_path=tmp_path, car=car)
    for _ in range(2):  # the second call finds all outcomes stored
        run_drives(drives, FleetPlan(Reading()), Store(tmp_path / "out", False), jobs=0)
    assert [t.log.name for t in tasks] == [f"{i}.csv" for i in range(4)]
    assert [t.learnt for t in tasks] == [None, b"0.csv", b"0.csv", b"0.csv"]
    assert [t.age for t in tasks] == [0.0] + [86400.0 * i - 100.0 for i in (1, 2, 3)]


def test_drives_that_overlap_have_no_age_below_0(tmp_path, car, ran):
    drives = [
        replace(d, start=50.0 * i) for i, d in enumerate(make_drives("a", "a", tmp_path=tmp_path, car=car))
    ]
    run_drives(drives, FleetPlan(Reading()), Store(tmp_path / "out", False), jobs=0)
    assert ran[1].age == 0.0 and ran[1].learnt == b"0.csv"


def test_a_task_has_the_options_of_the_fleet_and_the_files_of_its_drive(tmp_path, car, monkeypatch):
    monkeypatch.chdir(tmp_path)
    touch(tmp_path / "own.toml")
    reading = Reading(Path("signals.toml"), 50.0, True, (Path("car.dbc"),))
    more = {"reports": False, "estimates": True, "calibrate": False}
    plan = FleetPlan(reading, Path("filter.toml"), 0.1, "robust", {"mass": 1600.0}, **more)
    store = Store(tmp_path / "out", False)
    drives = [Drive("a", Path("0.csv"), Path("car.toml")), Drive("a", Path("1.csv"), car, Path("own.toml"))]
    first, second = (running._Chain([d], plan, store).make_task(d) for d in drives)
    assert first.log == tmp_path / "0.csv" and first.vehicle == car
    assert (first.signals, second.signals) == (tmp_path / "signals.toml", tmp_path / "own.toml")
    assert (first.rate, first.strict, first.databases) == (50.0, True, (tmp_path / "car.dbc",))
    assert (first.config, first.average, first.form) == (tmp_path / "filter.toml", 0.1, "robust")
    assert first.settings == {"mass": 1600.0} and not first.report and not first.calibrate
    assert first.estimates == store.estimates(drives[0])
    plain = running._Chain(drives[:1], FleetPlan(Reading()), store).make_task(drives[0])
    assert plain.report and plain.calibrate and plain.estimates is None and plain.signals is None


def test_a_car_is_calibrated_on_its_first_four_logs_and_then_has_its_own_file(tmp_path, car):
    drives = make_drives(*"aaaaaa", tmp_path=tmp_path, car=car)
    drives[2] = replace(drives[2], error="of no use")
    other = touch(tmp_path / "other.toml", CAR.encode())
    drives[3] = replace(drives[3], vehicle=other, signals=car)
    store = Store(tmp_path / "out", False)
    chain = running._Chain(drives, FleetPlan(Reading()), store)
    first = chain.make_task(drives[0])
    assert [(p.name, s) for p, s in first.others] == [("1.csv", None), ("4.csv", None), ("5.csv", None)]
    assert first.calibrate
    chain.take(first, Outcome(calibrated="mass = 1501\n", learnt=b"x"))
    second = chain.make_task(drives[1])
    assert second.vehicle == store.out / "calibrated" / "a-car.toml" and not second.calibrate
    assert second.others == () and second.vehicle.read_text() == "mass = 1501\n"
    assert chain.make_task(drives[3]).vehicle == other and chain.make_task(drives[3]).calibrate
    many = running._Chain(make_drives(*"aaaaaaa", tmp_path=tmp_path, car=car), FleetPlan(Reading()), store)
    assert [p.name for p, _ in many.make_task(many.drives[0]).others] == ["1.csv", "2.csv", "3.csv"]


def test_an_error_of_a_worker_names_the_log_as_the_user_does(tmp_path, car):
    log = Path("logs") / "a.csv"
    chain = running._Chain([Drive("a", log, car)], FleetPlan(Reading()), Store(tmp_path / "out", False))
    task = make_task(tmp_path / "elsewhere" / "a.csv", car)
    assert chain.take(task, Outcome(error=f"{task.log}: is empty")).outcome.error == f"{log}: is empty"
    assert not chain.drives

    def die() -> Outcome:
        raise Died

    assert get_outcome(task, lambda: Outcome(code=3)).code == 3
    assert get_outcome(task, die).error.startswith(f"{task.log}: the process that ran this task died")


def test_groups_of_logs_are_those_of_cars_in_order():
    done = [Done(Drive(c, Path(f"{i}.csv")), Outcome()) for i, c in enumerate("abca")]
    assert [(c, [d.drive.log.name for d in mine]) for c, mine in group_by_car(done)] == [
        ("a", ["0.csv", "3.csv"]),
        ("b", ["1.csv"]),
        ("c", ["2.csv"]),
    ]


# ---- one log in a worker


def test_a_worker_of_another_version_says_which(tmp_path):
    version, digest = working.read_code_version()
    for code in ((version, "0123456789"), ("0.0", digest)):
        said = f"has tselab {version} and library {digest[:8]}, but {code[0]} and {code[1][:8]} are needed"
        with pytest.raises(Mismatch, match=said):
            run_task(replace(make_task(tmp_path / "a"), code=code))


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (UserError("a.csv: is empty"), "a.csv: is empty"),
        (MemoryError(), "LOG: is too long for the memory of this machine"),
        (KeyError("x"), "LOG: internal error: KeyError: 'x' (test_fleet_parts.py:"),
    ],
)
def test_an_error_of_a_log_is_its_outcome(error, said, tmp_path, monkeypatch):
    def fail(_: Task) -> Outcome:
        raise error

    monkeypatch.setattr(working, "_run_log", fail)
    task = make_task(tmp_path / "a")
    found = run_task(task)
    assert found.error.startswith(said.replace("LOG", str(task.log))) and found.code == 4


@pytest.fixture
def worker(monkeypatch):
    """Make a run of a log that needs no log; what it is given is kept."""
    prepared = SimpleNamespace(
        own=None, warnings=[], doubts=["perhaps"], notes=[], config=None,
        log=SimpleNamespace(warnings=["cells"]), vehicle=SimpleNamespace(found=["of the car"]),
    )  # fmt: skip
    seen = SimpleNamespace(prepared=prepared, given=None, time=[5.0, 6.0, 35.5])

    def prepare(*given):
        seen.given = given
        return prepared

    def run(_, estimates, report, learnt):
        seen.estimates, seen.learnt = estimates, learnt
        if report is not None:
            report.write_bytes(b"page")
        table = pd.DataFrame({"time": seen.time, "status": 0})
        ran = SimpleNamespace(estimate=Estimates(table, False, b"new"), findings=[], changes=[])
        ran.notes, ran.reported = ["of the run"], report is not None and len(table) > 0
        return ran

    def make(log, est, findings, changes, warnings):
        seen.warnings = warnings
        return [{"value": 1.0}]

    monkeypatch.setattr(working, "prepare_run", prepare)
    monkeypatch.setattr(working.single, "run_prepared", run)
    monkeypatch.setattr(working.results, "make_rows", make)
    monkeypatch.setattr(working, "NativeFilter", lambda config: config)
    monkeypatch.setattr(working.Learnt, "load", lambda self, _: None)
    return seen


def test_the_outcome_of_a_log_is_that_of_its_run(worker, tmp_path):
    task = make_task(tmp_path / "a", report=True, estimates=tmp_path / "e.parquet", learnt=b"old", age=60.0)
    found = working._run_log(task)
    assert found == Outcome(rows=[{"value": 1.0}], learnt=b"new", report=b"page", seconds=30.5, code=4,
                            notes=["of the car", "of the run"])  # fmt: skip
    assert worker.warnings == ["perhaps", "cells"] and worker.estimates == tmp_path / "e.parquet"
    assert (worker.learnt.data, worker.learnt.age, worker.learnt.given) == (b"old", 60.0, True)
    worker.time = []
    assert (working._run_log(task).seconds, working._run_log(task).report) == (0.0, None)
    assert working._run_log(replace(task, report=False)).report is None


def test_channels_that_contradict_each_other_teach_nothing(worker, tmp_path):
    worker.prepared.warnings = ["a sign"]
    found = working._run_log(make_task(tmp_path / "a"))
    assert found.learnt is None and worker.warnings == ["a sign", "perhaps", "cells"]
    assert worker.learnt is None  # there was no drive before


def test_what_the_uncalibrated_car_taught_is_nothing_to_the_calibrated_one(worker, tmp_path):
    worker.prepared.own = SimpleNamespace(text="mass = 2\n")
    found = working._run_log(make_task(tmp_path / "a", learnt=b"old"))
    assert worker.learnt is None and found.calibrated == "mass = 2\n"
    worker.prepared.own = SimpleNamespace(text="")
    assert working._run_log(make_task(tmp_path / "a", learnt=b"old")).calibrated == "" and worker.learnt


def test_a_learnt_state_that_is_refused_is_a_note(worker, tmp_path, monkeypatch):
    def refuse(self, _) -> None:
        raise UserError(f"{self.path}: belongs to another vehicle")

    monkeypatch.setattr(working.Learnt, "load", refuse)
    working._run_log(make_task(tmp_path / "a", learnt=b"old"))
    assert worker.learnt is None and worker.prepared.notes == [
        "the learnt state of the previous drive is not used: the previous drive: belongs to another vehicle"
    ]


@pytest.mark.parametrize("known", [False, True])
def test_other_logs_are_read_for_a_car_that_is_not_calibrated(known, worker, tmp_path, monkeypatch):
    car = touch(tmp_path / "car.toml", (CAR + ("[uncertainty]\nmass_sd = 0.01\n" if known else "")).encode())
    read = []

    def agree(logs, notes, reading):
        read.append((logs[0].name, reading.signals, reading.rate, reading.car.values["mass"]))
        if logs[0].name == "bad":
            raise UserError("bad")
        return [f"log {logs[0].name}"]

    monkeypatch.setattr(working, "read_agreeing", agree)
    others = ((Path("bad"), None), (Path("good"), Path("s.toml")))
    task = make_task(tmp_path / "a", car, calibrate=True, others=others, rate=20.0)
    working._run_log(task)
    if known:
        assert not read and worker.given[-1] is None
        return
    assert read == [("bad", None, 20.0, 1500), ("good", Path("s.toml"), 20.0, 1500)]
    assert worker.given[-1].others == ["log good"] and not worker.given[-1].goes_on
    working._run_log(replace(task, calibrate=False))
    assert worker.given[-1] is None


# ---- the page


def test_a_value_is_shown_in_kilo_with_an_interval_of_at_least_1():
    assert Last(123456.0, 7800.0, 1.0, pd.Timestamp(0)).shown == "123 ± 8"
    assert Last(123456.0, 100.0, 1.0, pd.Timestamp(0)).shown == "123 ± 0"  # 0.5, rounded to even
    assert Last(9499.0, 600.0, 1.0, pd.Timestamp(0)).shown == "9 ± 1"


def make_done(car: str, *rows: dict, start: float = 0.0, seconds: float = 900.0, **outcome) -> Done:
    log = Path(f"{car} {start:g}.csv")
    return Done(Drive(car, log, start=start), Outcome(rows=list(rows), seconds=seconds, **outcome))


@pytest.fixture
def fleet() -> list[Done]:
    front, rear = make_row(), make_row(stiffness="cy_rear", nominal=1.5e5)
    return [
        make_done("stiff", front | {"value": 1.2e5}, rear | {"value": 9e4, "end": 40.0}),
        make_done(
            "stiff",
            front | {"value": 1.1e5, "end": 30.0, "sd": 3e3},
            front | {"value": 1.3e5, "usable": "no", "start": 30.0, "change": "road changed"},
            rear | {"value": 8e4, "usable": "in part", "warnings": "one\ntwo"},
            start=86400.0,
            seconds=2700.0,
            code=3,
        ),
        make_done("soft", front | {"value": 7e4, "change": "an axle changed", "start": 12.4}, code=0),
        make_done("along", make_row(stiffness="cx_front", value=6e4),
                  front | {"usable": "no", "value": None, "reason": "uncertain"}, code=3),
        make_done("none", error="is empty"),
    ]  # fmt: skip


def test_cars_have_their_latest_usable_stiffness_and_the_reason_of_others(fleet):
    cars = {c.name: c for c in list_cars(fleet, make_table(fleet))}
    assert list(cars) == ["soft", "stiff", "along", "none"]
    front, rear = cars["stiff"].last["cy_front"], cars["stiff"].last["cy_rear"]
    assert front == Last(1.1e5, 1.96 * 3e3, 1.1, pd.Timestamp("1970-01-02T00:00:30Z"))
    assert (rear.value, rear.of_nominal) == (8e4, pytest.approx(8 / 15))
    assert cars["stiff"].softest == "cy_rear" and cars["stiff"].hours == 1.0 and cars["stiff"].why == {}
    assert cars["along"].softest == "cx_front" and cars["along"].reason == "front, along 60 ± 4 kN"
    assert cars["along"].why == {"cy_front": "too few bends in this log"}
    assert (cars["none"].errors, cars["none"].softest, cars["soft"].errors) == (1, "", 0)
    assert cars["none"].reason == "no log was read"
    assert cars["soft"].reason == "front, in bends 70 ± 4 kN/rad"
    assert Car("x", [], {}, dict.fromkeys(STIFFNESS, "held")).reason == "no stiffness is known: held"


def test_remarks_are_those_of_each_log(fleet):
    found = paging._collect_remarks(make_table(fleet))
    assert found == {
        "stiff 86400.csv": {"changes": ["road changed at 30 s"], "warnings": ["one", "two"]},
        "soft 0.csv": {"changes": ["an axle changed at 12 s"], "warnings": []},
    }
    twice = make_done(
        "a", make_row(change="road changed"), make_row(stiffness="cy_rear", change="road changed")
    )
    assert paging._collect_remarks(make_table([twice]))["a 0.csv"]["changes"] == ["road changed at 0 s"]


def test_the_figure_of_all_cars_has_each_stiffness_with_half_its_interval(fleet):
    figure = draw_distribution(list_cars(fleet, make_table(fleet)))
    traces = {t["name"]: t for t in figure.data}
    front = traces["Front cornering stiffness"]
    assert (front["x"], front["y"]) == (["soft", "stiff"], [70.0, 110.0])
    assert front["error_y"]["array"] == pytest.approx([1.96 * 2, 1.96 * 3])
    rear, along = traces["Rear cornering stiffness"], traces["Front longitudinal stiffness"]
    assert (rear["x"], rear["y"], along["x"], along["y"]) == (["stiff"], [80.0], ["along"], [60.0])
    assert (front.get("yaxis", "y"), along["yaxis"]) == ("y", "y2")
    assert figure.layout["xaxis"]["categoryarray"] == ["soft", "stiff", "along", "none"]


def test_the_trend_of_a_car_has_its_usable_stretches_at_their_ends(fleet):
    table = make_table(fleet)
    (car,) = (c for c in list_cars(fleet, table) if c.name == "stiff")
    traces = {t["name"]: t for t in draw_trend(car, table).data}
    front, rear = traces["Front cornering stiffness"], traces["Rear cornering stiffness"]
    assert front["x"] == ["1970-01-01T00:01:00", "1970-01-02T00:00:30"] and front["y"] == [120.0, 110.0]
    assert front["error_y"]["array"] == pytest.approx([1.96 * 2, 1.96 * 3])
    assert rear["x"] == ["1970-01-01T00:00:40", "1970-01-02T00:01:00"] and rear["y"] == [90.0, 80.0]


def test_the_page_counts_logs_and_draws_cars_of_several_logs(fleet, tmp_path):
    write_fleet_page(tmp_path / "p.html", fleet, make_table(fleet), "my fleet")
    text = " ".join((tmp_path / "p.html").read_text(encoding="utf-8").split())
    assert "5 logs of 4 cars: 1 usable, 2 in part, 1 not usable, 1 that could not be read." in text
    assert "my fleet" in text and "Trend: stiff" in text and "Trend: soft" not in text
    assert "1970-01-02 00:00*" in text and '<td class="num">45.0</td>' in text
    assert "road changed at 30 s" in text and "one; two" in text and "is empty" in text
    assert len(read_figures(text)) == 2
