"""Every kind of bad input gives exit code 2 and one short message that names the place.

There is no traceback, and no output file is touched.
"""

import ast
from collections.abc import Callable, Iterator
from pathlib import Path

import pandas as pd
import pytest

import tse
from conftest import RAN, tselab, tselab_here
from tse.channels import log
from tse.library.core import Config

FORGETTING = Config.exact().fields["forgetting"].range_text
Change = Callable[[pd.DataFrame], pd.DataFrame]


def change_cell(row: int, column: str, value: str) -> Change:
    """Change the value in line `row` of the file; the header is line 1."""

    def change(table: pd.DataFrame) -> pd.DataFrame:
        table.loc[row - 2, column] = value
        return table

    return change


def scale_column(column: str, factor: float) -> Change:
    return lambda table: table.assign(**{column: (table[column].astype(float) * factor).astype(str)})


LOGS: dict[str, tuple[Change, list[str]]] = {
    "missing column": (
        lambda t: t.drop(columns="steer_angle"),
        ["column steer_angle is missing", "needed: time,steer_angle"],
    ),
    "upper case column": (
        lambda t: t.rename(columns={"accel_x": "Accel_X"}),
        ["accel_x is missing", "Accel_X -> accel_x"],
    ),
    "non-numeric column": (
        lambda t: t.assign(accel_x="abc"),
        ["line 2", "column accel_x", "'abc'", "-50 .. 50 m/s2"],
    ),
    "decimal comma": (
        lambda t: t.assign(yaw_rate="0,5"),
        ["line 2", "column yaw_rate", "decimals are written with a point"],
    ),
    "time stands": (lambda t: t.assign(time="1"), ["line 3", "column time", "the same time as line 2"]),
    "time goes back": (
        lambda t: t.assign(time=t.time[::-1].to_numpy()),
        ["line 3", "column time", "earlier than line 2"],
    ),
    "milliseconds": (scale_column("time", 1000), ["column time", "divide by 1000"]),
    "rows shuffled": (
        lambda t: t.sample(frac=1, random_state=1),
        ["column time", "earlier than line", "sort the rows by time"],
    ),
    "microseconds": (scale_column("time", 1e6), ["column time", "3600 s", "microseconds or nanoseconds"]),
    "days": (scale_column("time", 1 / 86400), ["column time", "at least 0.001 s", "days: by 86400"]),
    "steering in degrees": (
        scale_column("steer_angle", 180 / 3.14159 * 2),
        ["line 2", "steer_angle", "-1.2 .. 1.2 rad", "degrees"],
    ),
    "steering infinite": (
        lambda t: t.assign(steer_angle="inf"),
        ["line 2", "column steer_angle", "-1.2 .. 1.2 rad"],
    ),
    "wheel speed in rpm": (
        scale_column("wheel_speed_front", 9.5493),
        ["line 2", "wheel_speed_front", "-400 .. 400 rad/s", "rpm"],
    ),
    "yaw rate in deg/s": (
        lambda t: scale_column("yaw_rate", 573)(t),
        ["column yaw_rate", "-6 .. 6 rad/s", "deg/s"],
    ),
    "column all empty": (
        lambda t: t.assign(steer_angle=""),
        ["column steer_angle", "every cell is empty", "-1.2 .. 1.2 rad"],
    ),
    "no lateral sensor": (
        lambda t: t.drop(columns=["accel_y", "yaw_rate"]),
        ["accel_y and yaw_rate are missing"],
    ),
}
# A few bad rows or a missing sensor cost these rows or this sensor alone. The words are
# those of the message.
REPAIRED: dict[str, tuple[Change, list[str]]] = {
    "a cell that is no number": (
        change_cell(7, "accel_x", "abc"),
        ["accel_x: a cell that is no number is treated as missing", "line 7: 'abc'"],
    ),
    "a cell with a decimal comma": (
        change_cell(9, "yaw_rate", "0,5"),
        ["yaw_rate: a cell that is no number", "line 9"],
    ),
    "a wheel that spins": (
        change_cell(8, "wheel_speed_rear", "401"),
        ["wheel_speed_rear: 1 values outside", "-400 .. 400 rad/s", "line 8"],
    ),
    "an infinite angle": (
        change_cell(30, "steer_angle", "inf"),
        ["steer_angle: 1 values outside", "line 30"],
    ),
    "a row late": (change_cell(12, "time", "0.05"), ["time: 1 entries are out of order: left out"]),
    "a row twice": (
        change_cell(12, "time", "0.09"),
        ["time: 1 entries have the same time as the next entry", "0.090 s"],
    ),
    "a row without time": (change_cell(5, "time", ""), ["time: 1 entries without a time are left out"]),
    "a clock set back": (
        lambda t: t.assign(time=[*t.time[:50], *(t.time[50:].astype(float) - 0.4).astype(str)]),
        ["time: the clock goes back 1 time (first by 0.39 s at 0.490 s)", "all later times are shifted"],
    ),
    "a clock set ahead": (
        lambda t: t.assign(time=[*t.time[:50], *(t.time[50:].astype(float) + 5000).astype(str)]),
        ["time: the clock jumps ahead by 5000 s at 0.490 s: replaced by a gap of 60 s", "1 gap longer than"],
    ),
    "no accel_x": (lambda t: t.drop(columns="accel_x"), ["accel_x is not in the log"]),
    "no accel_y": (lambda t: t.assign(accel_y=""), ["accel_y is not in the log"]),
    "no yaw_rate": (lambda t: t.drop(columns="yaw_rate"), ["yaw_rate is not in the log"]),
    "no rear wheels": (
        lambda t: t.drop(columns="wheel_speed_rear"),
        ["wheel_speed_rear is not in the log: wheel_speed_front stands in", "cx_front not estimated"],
    ),
}


@pytest.mark.parametrize("name", REPAIRED)
def test_a_log_with_a_few_bad_rows_is_used_and_they_are_named(name, drive, tmp_path):
    change, words = REPAIRED[name]
    change(drive.table()).to_csv(tmp_path / "log.csv", index=False)
    done = tselab_here("estimate", "--verbose", "log.csv", "--vehicle", drive.vehicle, cwd=tmp_path)
    assert done.code in RAN, done.err
    for word in words:
        assert word in done.err, done.err
    est = pd.read_csv(tmp_path / "log.est.csv")
    assert len(est) >= len(drive.table()) - 1 and est[["cx_front", "cy_front", "cy_rear"]].notna().all().all()
    if "no rear wheels" in name:  # without a slip nothing is said of it
        assert not est.cx_front_valid.any()
    valid = est.cx_front_valid == 1  # without accel_x the force is that of the wheels' acceleration
    assert (abs(est.cx_front[valid] - 160e3) < 0.2 * 160e3).all()
    # what can still be told is
    end = est.iloc[-300:]
    assert end.cy_front.mean() == pytest.approx(120e3, rel=0.1) and end.cy_rear.mean() == pytest.approx(
        140e3, rel=0.1
    )


@pytest.mark.parametrize("name", LOGS)
def test_log_is_refused_with_its_place(name, drive, tmp_path):
    change, words = LOGS[name]
    log, out = tmp_path / "bad.csv", tmp_path / "est.csv"
    change(drive.table()).to_csv(log, index=False)
    out.write_text("as before\n")
    expect_refusal(
        tselab_here("estimate", "--verbose", log, "--vehicle", drive.vehicle, "--out", out),
        ["bad.csv", *words],
    )
    assert out.read_text() == "as before\n"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.csv", "est.csv"]


def expect_refusal(done, words: list[str]) -> None:
    assert done.code == 2, (done.out, done.err)
    assert "Traceback" not in done.err
    assert len(done.err.splitlines()) <= 4
    for word in words:
        assert word in done.err, done.err


HEADER = b"time,steer_angle,wheel_speed_front,wheel_speed_rear,accel_x,accel_y,yaw_rate"
FILES: dict[str, tuple[bytes, list[str]]] = {
    "empty": (b"", ["is empty"]),
    "only header": (HEADER + b"\n", ["has a header but no rows"]),
    "binary": (bytes(range(256)) * 40, ["binary file of an unknown format", "MF4"]),
    "zero bytes": (b"time\0,a\n" * 5, ["binary"]),
    "latin-1": ("time,steer_angle,°\n0,0,é\n".encode("latin-1"), ["signals.toml"]),
    "semicolons": (
        b"time;steer_angle;accel_x\n0;0;0\n",
        [
            "of tse's names it has steer_angle, accel_x, not wheel_speed_front",
            "tselab signals bad.csv --write",
        ],
    ),
    "no header": (b"0.0,0,60,60,0,0,0\n0.01,0,60,60,0,0,0\n", ["the first line must name the columns"]),
    "twice the same column": (
        HEADER + b",accel_x\n" + b"0,0,0,0,0,0,0,0\n",
        ["column accel_x appears more than once"],
    ),
    "too many cells": (HEADER + b"\n0,0,0,0,0,0,0\n0.01,0,0,0,0,0,0,5,5\n", ["line 3"]),
    "too many in the first row": (
        HEADER + b"\n0,0,0,0,0,0,0" + b"," * 200000 + b"\n0.01,0,0,0,0,0,0\n",
        ["line 2: 200007 cells", "names 7 columns"],
    ),
    "commas everywhere": (
        HEADER + b"\n" + 9 * b"0,0,0,01,60,5,60,5,0,1,0,2,0,3\n",
        ["line 2: 14 cells", "decimals with a point"],
    ),
    "cut in its only row": (HEADER + b"\n0,0,0,0,0,0,0.12", ["one row", "without a line break", "cut"]),
}


@pytest.mark.parametrize("name", FILES)
def test_file_that_is_no_log_is_refused(name, drive, tmp_path):
    content, words = FILES[name]
    (tmp_path / "bad.csv").write_bytes(content)
    expect_refusal(
        tselab_here("estimate", "--verbose", "bad.csv", "--vehicle", drive.vehicle, cwd=tmp_path),
        ["bad.csv", *words],
    )
    assert not (tmp_path / "bad.est.csv").exists()


@pytest.mark.parametrize("cut", [1, 4, 30, 70])
def test_a_line_that_does_not_end_is_not_believed(cut, drive, tmp_path):
    """A number without its last digits is a number, so the line must have an end."""
    whole = tmp_path / "whole.csv"
    lines = drive.log.read_text().splitlines(keepends=True)[:401]
    whole.write_text("".join(lines))
    (tmp_path / "cut.csv").write_text(
        "".join(lines) + lines[5][:-cut].replace(lines[5].split(",")[0], "4.5", 1)
    )
    a, b = log.read_log(whole), log.read_log(tmp_path / "cut.csv")
    assert len(a) == len(b) == 400
    pd.testing.assert_frame_equal(a.data, b.data)
    assert b.notes == [
        *a.notes,
        "line 402, the last, has no line break: it may be cut inside a number and is left out",
    ]


def test_missing_files_and_directories_are_named(drive, tmp_path):
    expect_refusal(
        tselab_here("estimate", "--verbose", "nowhere.csv", "--vehicle", drive.vehicle, cwd=tmp_path),
        ["nowhere.csv: no such file"],
    )
    expect_refusal(
        tselab_here("estimate", "--verbose", drive.log, "--vehicle", "nowhere.toml", cwd=tmp_path),
        ["nowhere.toml: no such file"],
    )
    expect_refusal(
        tselab_here("estimate", "--verbose", tmp_path, "--vehicle", drive.vehicle, cwd=tmp_path),
        ["is a directory"],
    )
    expect_refusal(
        tselab_here(
            "estimate", "--verbose", drive.log, "--vehicle", drive.vehicle, "--out", tmp_path / "no" / "x.csv"
        ),
        ["does not exist"],
    )
    expect_refusal(
        tselab_here("estimate", "--verbose", drive.log, "--vehicle", drive.vehicle, "--out", drive.log),
        ["same file as the log"],
    )


VEHICLES: dict[str, tuple[str, list[str]]] = {
    "no mass": (
        "lf = 1.2\nlr = 1.5\nwheel_radius_front = 0.3\nwheel_radius_rear = 0.3\n",
        ["key mass is missing", "50 .. 50000 kg"],
    ),
    "a log": (
        "time,steer_angle,accel_x,accel_y\n0,0,0,0\n",
        ["not valid TOML", "its first line has 4 columns: is it a log"],
    ),
    "not TOML": ("mass = = 3\n", ["not valid TOML", "line 1"]),
    "mass in tonnes": ("mass = 1.9\n", ["key mass", "1.9 is outside its range 50 .. 50000 kg"]),
    "mass in words": ('mass = "heavy"\n', ["key mass", "'heavy' is not a number"]),
    "negative length": ("mass = 1500.0\nlf = -1.2\n", ["key lf", "0.1 .. 10 m"]),
    "wheelbase": (
        "mass = 1500.0\nlf = 1.2\nlr = 1.5\nwheelbase = 2.6\n"
        "wheel_radius_front = 0.3\nwheel_radius_rear = 0.3\n",
        ["key wheelbase", "lf + lr = 2.7 m"],
    ),
    "sensor": ("[sensors]\naccel_x_sd = 0.0\n", ["key sensors.accel_x_sd", "0.001 .. 10 m/s2"]),
    "axle": (
        "mass = 1500.0\nlf = 1.2\nlr = 1.5\nwheel_radius_front = 0.3\nwheel_radius_rear = 0.3\n"
        'driven_axle = "all"\n',
        ["key driven_axle", "front, rear, both"],
    ),
}


WHOLE = "mass = 1500.0\nlf = 1.2\nlr = 1.5\nwheel_radius_front = 0.3\nwheel_radius_rear = 0.3\n"
VEHICLES |= {  # a rule would take the place of what a misspelt key says
    "misspelt": (
        WHOLE + "yaw_inertai = 2500.0\n",
        ["key yaw_inertai is not known", "did you mean yaw_inertia?"],
    ),
    "misspelt and missing": (WHOLE.replace("mass", "mas"), ["key mas is not known", "did you mean mass?"]),
    "misspelt sensor": (
        WHOLE + "[sensors]\naccel_x_ds = 0.1\n",
        ["key sensors.accel_x_ds", "did you mean accel_x_sd"],
    ),
    "in another table": (
        WHOLE + "[sensors]\nmass_sd = 0.1\n",
        ["key sensors.mass_sd is not known here", "[uncertainty]"],
    ),
    "below a table": (WHOLE + "[sensors]\nyaw_inertia = 2500.0\n", ["key sensors.yaw_inertia", "at the top"]),
    "in no table": (WHOLE + "accel_x_ds = 0.1\n", ["key accel_x_ds", "did you mean accel_x_sd, [sensors]?"]),
    "of the filter": (WHOLE + "particles = 100\n", ["key particles", "--config FILTER.toml"]),
    "of nobody": (WHOLE + "colour = 3\n", ["key colour", "tselab vehicle --example", "table"]),
    "misspelt table": (
        WHOLE + "[sensor]\naccel_x_sd = 0.1\n",
        ["table [sensor] is not known", "did you mean [sensors]?"],
    ),
    "misspelt effect": (
        WHOLE + "[effects.relaxation]\nlenght = 1\n",
        ["key effects.relaxation.lenght", "did you mean length?"],
    ),
    "many": (
        WHOLE + "one = 1\ntwo = 2\nthree = 3\nfour = 4\nfive = 5\n",
        ["key one", "key three", "and 2 more"],
    ),
}


@pytest.mark.parametrize("name", VEHICLES)
def test_vehicle_is_refused_with_file_and_key(name, tmp_path):
    text, words = VEHICLES[name]
    (tmp_path / "car.toml").write_text(text)
    expect_refusal(tselab_here("vehicle", "car.toml", cwd=tmp_path), ["car.toml", *words])


SETTINGS: dict[str, tuple[str, list[str]]] = {
    "range": ("particles = 3\n", ["particles", "= 3 is outside its range 16 .. "]),
    "fraction": ("[filter]\nparticles = 100.5\n", ["key particles", "whole number"]),
    "unknown": ("partikles = 100\n", ["no setting 'partikles'", "did you mean particles"]),
    "text": ('forgetting = "much"\n', ["key forgetting", "'much' is not a number", FORGETTING]),
    "twice": ("particles = 100\n[filter]\nparticles = 100\n", ["key particles appears twice"]),
}


@pytest.mark.parametrize("name", SETTINGS)
def test_filter_file_is_refused_with_file_and_key(name, drive, tmp_path):
    text, words = SETTINGS[name]
    (tmp_path / "filter.toml").write_text(text)
    done = tselab_here(
        "estimate",
        "--verbose",
        drive.log,
        "--vehicle",
        drive.vehicle,
        "--config",
        "filter.toml",
        cwd=tmp_path,
    )
    expect_refusal(done, ["filter.toml", *words])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--particles", "1000000"], ["option --particles", "16 .. "]),
        (["--forgetting", "1.5"], ["option --forgetting", FORGETTING]),
        (["--seed", "-1"], ["option --seed", "0 .. "]),
        (["--seed", "2"], ["seed has no effect with this form"]),
        (["--set", "particles=64"], ["particles has no effect", "form robust or paper"]),
        (["--set", "mass"], ["option --set", "KEY=NUMBER"]),
        (["--set", "integrate=1"], ["option --set", "did you mean integration"]),
    ],
)
def test_option_is_refused_with_its_name(options, words, drive, tmp_path):
    expect_refusal(
        tselab_here("estimate", "--verbose", drive.log, "--vehicle", drive.vehicle, *options, cwd=tmp_path),
        words,
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--maneuver", "fly"], ["no manoeuvre 'fly'", "square-waves"]),
        (["--maneuver", "straight", "--speed", "100"], ["option --speed", "0 .. 70 m/s"]),
        (["--maneuver", "straight", "--duration", "-1"], ["option --duration"]),
        (["--maneuver", "straight", "--sample-time", "1"], ["option --sample-time", "0.001 .. 0.1 s"]),
        (["--maneuver", "straight", "--road-change", "5"], ["option --road-change", "TIME:LEVEL"]),
        (["--maneuver", "straight", "--road-change", "5:0"], ["option --road-change", "0.02 .. 10"]),
        (["--maneuver", "straight", "--spread", "2"], ["option --spread", "0 .. 0.3"]),
    ],
)
def test_simulation_option_is_refused_with_its_range(options, words, tmp_path):
    expect_refusal(tselab_here("simulate", *options, "--out", "log.csv", cwd=tmp_path), words)
    assert not list(tmp_path.iterdir())


def test_every_refusal_of_a_library_that_is_not_there_says_what_to_do(monkeypatch, tmp_path):
    monkeypatch.setenv("TSELAB_LIBRARY", str(tmp_path / "libtse.so"))
    expect_refusal(tselab("settings"), ["libtse.so", "scripts/setup.sh"])


# ---- No content of a file is executed: no reader in the package turns data into code.


SOURCES = sorted(
    p for name in ("tse", "tselab") for p in (Path(tse.__file__).parents[1] / name).rglob("*.py")
)
MODULES = {
    "pickle",
    "_pickle",
    "cPickle",
    "dill",
    "cloudpickle",
    "joblib",
    "marshal",
    "shelve",
    "yaml",
    "code",
}
CALLS = {"eval", "exec", "compile", "__import__"}
METHODS = {"read_pickle", "unsafe_load"}


def find_code_of_data(source: str) -> Iterator[str]:
    """Find calls in a source that may execute the data they read."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name.split(".")[0] in MODULES)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in MODULES:
            yield node.module or ""
        elif isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            if name in CALLS or name.split(".")[-1] in METHODS:
                yield name
            if any(
                k.arg == "allow_pickle" and not (isinstance(k.value, ast.Constant) and k.value.value is False)
                for k in node.keywords
            ):
                yield f"{name}(allow_pickle)"


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: "/".join(p.parts[-2:]))
def test_no_source_makes_code_of_data(path):
    assert not list(find_code_of_data(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "from pickle import load",
        "import joblib.parallel",
        "np.load(f, allow_pickle=True)",
        "pd.read_pickle(f)",
        "eval(text)",
    ],
)
def test_what_makes_code_of_data_is_seen(source):
    assert list(find_code_of_data(source))
