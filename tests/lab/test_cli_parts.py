"""Options, output and exit codes of each command, by stand-ins for the long runs.

A stand-in takes the place of a function of the public tse, and keeps its arguments.
"""

import json
import signal
import sys
import warnings
from collections import OrderedDict
from pathlib import Path
from types import SimpleNamespace

import click
import numpy as np
import pandas as pd
import pytest

import tse
from conftest import tselab_here
from tse import tables
from tse.errors import Error, Interrupted, NoFile
from tselab import cli, demo, live, options, studies
from tselab import estimate as estimate_command
from tselab import gap as gap_command
from tselab import signals as signals_command
from tselab import simulate as simulate_command
from tselab.montecarlo import engine, pictures
from tselab.montecarlo import studies as all_studies

CAR = "mass = 1650\nlf = 1.2\nlr = 1.5\nwheel_radius_front = 0.32\nwheel_radius_rear = 0.31\n"
FORMULA = """id = "play"
title = "play in the steering"
place = "front_angle"
gain = 0.5
formula = "play(steer_angle, w) - steer_angle"
[numbers.w]
value = 0.003
unit = "rad"
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """An empty log, a car and a folder to work in."""
    monkeypatch.chdir(tmp_path)
    for name in ("log.csv", "other.csv"):
        (tmp_path / name).write_text("")
    (tmp_path / "car.toml").write_text(CAR)
    return tmp_path


def replace(monkeypatch, name, result):
    """Let tse.<name> return `result`; return the list of its arguments."""
    calls = []

    def stand_in(*given, **named):
        calls.append((given, named))
        if isinstance(result, BaseException):
            raise result
        return result

    monkeypatch.setattr(tse, name, stand_in)
    return calls


def keep_writes(written):
    """Return a function that keeps the paths to which a result is written."""
    return lambda path, *more, **named: written.append((path, *more)) or path


# ---- options


def test_a_long_text_is_folded_at_a_hundred_columns_with_an_indent_of_two_more():
    words = ["word"] * 30
    first, second = options.fold("  " + " ".join(words))
    assert len(first) <= 100 < len(first) + 5 and first.startswith("  word")
    assert second.startswith("    word") and (first + " " + second).split() == words
    for whole in ("x" * 120, "a-" * 60):
        assert options.fold(whole) == [whole]
    for length, lines in ((50, 1), (51, 2)):
        assert len(options.fold("y" * 49 + " " + "z" * length)) == lines
    assert options.fold_all(["a", "  " + "b " * 60]) == ["a", *options.fold("  " + "b " * 60)]


@pytest.mark.parametrize(
    ("name", "allowed"),
    [("a.csv", True), ("a.PARQUET", True), ("a", True), ("a.xlsx", False), ("b.c/a", True)],
)
def test_the_suffix_of_an_output_file_is_one_of_those_allowed(name, allowed):
    kind, option = options.OutputPath(*options.TABLES), click.Option(["--out", "-o", "--table"])
    if allowed:
        assert kind.convert(name, option, None) == Path(name)
    else:
        with pytest.raises(
            Error, match=r"option --table: a.xlsx: ends in .xlsx; .* .csv or .parquet or .pq$"
        ):
            kind.convert(name, option, None)


def test_pairs_are_numbers_by_key_and_whole_ones_are_integers():
    found = options.read_key_values(("seed=3", " a =0.5", "b=2e3", "a=0.25"))
    assert found == {"seed": 3, "a": 0.25, "b": 2000}
    assert [type(found[k]) for k in ("seed", "a", "b")] == [int, float, int]
    for pair in ("a", "a=", "a=x", "=="):
        with pytest.raises(Error, match=f"option --set: '{pair}' is not KEY=NUMBER"):
            options.read_key_values((pair,))


def test_of_an_option_and_a_pair_the_pair_counts_except_in_the_simulator():
    given = {"seed": 3, "particles": None}
    assert options.read_settings(("seed=5",), given) == {"seed": 5}
    assert options.read_settings(("seed=5",), given, simulator=True) == {"seed": 3}
    assert options.read_settings((), {"noise": 0.5}, simulator=True) == {"noise": 0.5}


@pytest.mark.parametrize(
    ("pairs", "given", "simulator", "text"),
    [
        ((), {"spread_cy_rear": 2.0}, True, "option --spread: spread_cy_rear = 2"),
        ((), {"sample_time": 2.0}, True, "option --sample-time: sample_time = 2"),
        (("noise=1",), None, False, "option --set: there is no setting 'noise'"),
        (("mass=1",), None, True, "option --set: mass = 1 is outside"),
    ],
)
def test_a_setting_that_is_wrong_is_refused_with_the_option_that_gives_it(pairs, given, simulator, text):
    with pytest.raises(Error, match=f"^{text}"):
        options.read_settings(pairs, given, simulator=simulator)


def test_the_age_of_a_learnt_state_is_given_in_days():
    assert options.convert_age(2.5, Path("car.tse")) == 216000.0
    assert options.convert_age(40000.0, Path("car.tse")) == 40000 * 86400.0
    for state in (None, Path("car.tse")):
        assert options.convert_age(None, state) == tse.UNKNOWN_AGE
    with pytest.raises(Error, match=r"option --age: .*--load-learnt"):
        options.convert_age(2.0, None)
    for days in (-0.1, 40000.5):
        with pytest.raises(Error, match=r"option --age: .* outside its range 0 .. 40000 days"):
            options.convert_age(days, Path("car.tse"))
    assert options.convert_age(0.0, Path("car.tse")) == 0.0


def test_an_option_outside_its_range_is_refused_and_its_ends_are_allowed():
    for value in (None, 1.0, 2.0):
        options.check_range("rate", value, 1.0, 2.0, "Hz")
    for value in (0.99, 2.01, float("nan")):
        with pytest.raises(Error, match=r"option --rate: .* is outside its range 1 .. 2 Hz"):
            options.check_range("rate", value, 1.0, 2.0, "Hz")


def test_json_has_paths_as_text_and_no_number_that_json_lacks(capsys):
    options.print_json({"path": Path("a/b"), "name": "東風"})
    text = capsys.readouterr().out
    assert json.loads(text) == {"path": "a/b", "name": "東風"} and "東風" in text
    with pytest.raises(ValueError, match="not JSON compliant"):
        options.print_json({"x": float("nan")})


def test_a_table_is_a_parquet_or_a_csv_that_can_be_written(tmp_path):
    for name in ("a.csv", "a.CSV", "a.parquet", "a.pq"):
        options.check_table(tmp_path / name)
    options.check_table(None)
    for name in ("a.xlsx", "a"):
        with pytest.raises(Error, match="the name of a table must end in"):
            options.check_table(tmp_path / name)
    with pytest.raises(Error):
        options.check_table(tmp_path / "nowhere" / "a.csv")


@pytest.mark.parametrize("terminal", [False, True])
def test_progress_is_shown_on_request_or_on_a_terminal(terminal, monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    assert options.show_progress(None) is terminal
    assert options.show_progress(True) is True and options.show_progress(False) is False
    clock = iter([100.0, 103.24, 112.0])
    monkeypatch.setattr(options.time, "monotonic", lambda: next(clock))
    with options.show_steps(True) as show:
        show("simulating")
        show("x" * 200)
    said = capsys.readouterr().err
    start = "\r\033[K" if terminal else ""
    assert said.startswith(f"{start}  3.2 s  simulating")
    assert said.endswith("\r\033[K") is terminal and (" 12.0 s  " in said)
    assert ("\n" in said) is not terminal and ("x" * 120 in said) is not terminal
    clock = iter([0.0])
    with options.show_steps(False) as show:
        show("simulating")
    assert capsys.readouterr().err == ""


def test_only_the_warnings_of_an_estimate_are_silent():
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        with options.silence_warnings():
            warnings.warn("of an estimate", UserWarning, stacklevel=1)
            warnings.warn("of numpy", RuntimeWarning, stacklevel=1)
        warnings.warn("afterwards", UserWarning, stacklevel=1)
    assert [str(w.message) for w in seen] == ["of numpy", "afterwards"]


def test_options_for_reading_are_one_argument_and_a_missing_file_of_signals_is_named(tmp_path):
    (tmp_path / "s.toml").write_text("")
    taken = []

    @click.command()
    @options.add_reading_options
    def command(reading):
        taken.append(reading)

    words = ["--signals", str(tmp_path / "s.toml"), "--rate", "50", "--strict", "--database", "a.dbc"]
    command.main([*words, "--database", "b.dbc"], standalone_mode=False)
    command.main([], standalone_mode=False)
    assert taken == [
        tse.Reading(tmp_path / "s.toml", 50.0, True, (Path("a.dbc"), Path("b.dbc"))),
        tse.Reading(None, None, False, ()),
    ]
    with pytest.raises(NoFile, match=r"no such file \(option --signals\); .*--write x.toml"):
        command.main(["--signals", str(tmp_path / "x.toml")], standalone_mode=False)


def test_a_help_without_the_library_has_the_reason_in_place_of_a_table():
    def fail():
        raise Error("there is no tse library")

    command = options.Lazy("x", tables=(("First", lambda: "a\nb"), ("Second", fail)))
    text = command.get_help(click.Context(command))
    assert text.endswith("First:\n  a\n  b\n\nSecond:\n  (there is no tse library)")


def test_a_form_that_was_removed_names_its_successor(place):
    done = tselab_here("estimate", "log.csv", "--vehicle", "car.toml", "--form", "sampled")
    assert done.code == 2 and "'sampled' was removed: use 'robust' instead" in done.err


# ---- the command itself


@pytest.mark.parametrize(
    ("error", "code", "text"),
    [
        (Error("a.csv: bad"), 2, "tselab: error: a.csv: bad\n"),
        (Interrupted("run it again"), 130, "tselab: run it again\n"),
        (KeyboardInterrupt(), 130, "tselab: stopped by Ctrl-C\n"),
        (click.Abort(), 130, "tselab: stopped by Ctrl-C\n"),
        (BrokenPipeError(), 141, ""),
        (MemoryError(), 2, "tselab: error: there is not enough memory"),
        (OSError(28, "No space left on device", "x.csv"), 2, "x.csv: cannot be written: No space left"),
        (OSError(28, "No space left on device"), 2, "the output: cannot be written: No space left"),
        (KeyError("k"), 1, "tselab: internal error: KeyError: 'k'\n"),
        (click.UsageError("no such option"), 2, "no such option"),
    ],
)
def test_each_error_has_its_exit_code_and_sentence(error, code, text, place, monkeypatch):
    monkeypatch.setattr(cli, "_discard_stdout", lambda: None)
    replace(monkeypatch, "read_vehicle", error)
    done = tselab_here("vehicle", "car.toml")
    assert (done.code, done.out) == (code, "") and text in done.err and "Traceback" not in done.err
    assert bool(done.err) is bool(text)


def test_the_exit_code_is_what_the_command_returns(place, monkeypatch):
    replace(monkeypatch, "signals", make_signals(missing=("yaw_rate",)))
    assert tselab_here("signals", "log.csv").code == 3
    assert tselab_here("settings").code == 0


# ---- vehicle, settings, formula


@pytest.mark.parametrize(
    "words", [(), ("car.toml", "--example"), ("--example", "--simulated"), ("--example", "--c", "car.h")]
)
def test_exactly_one_vehicle_is_checked_or_printed(words, place):
    done = tselab_here("vehicle", *words)
    assert done.code == 2 and "give exactly one of" in done.err and not (place / "car.h").exists()


def test_a_vehicle_is_listed_with_units_and_written_as_c(place):
    done = tselab_here("vehicle", "car.toml", "--c", "car.h")
    lines = done.out.splitlines()
    assert done.code == 0 and lines[0].startswith("car.toml: ") and lines[-1] == "Written to car.h"
    rows = {line.split()[0]: line.split()[1:3] for line in lines[1:] if line and " " in line}
    assert rows["mass"] == ["1650", "kg"] and rows["wheel_radius_rear"] == ["0.31", "m"]
    assert any(line.startswith("filled in: ") for line in lines)
    assert "tse_config_car" in (place / "car.h").read_text()
    found = json.loads(tselab_here("vehicle", "car.toml", "--json").out)
    assert found["values"]["lr"] == 1.5 and found["vehicle"] == "car.toml" and found["written"] is None
    assert tselab_here("vehicle", "--example").out == tables.example_vehicle()
    assert tselab_here("vehicle", "--simulated").out == tables.simulated_vehicle()
    done = tselab_here("vehicle", "car.toml", "--c", "car.toml")
    assert done.code == 2 and (place / "car.toml").read_text() == CAR


def test_settings_of_the_simulator_are_its_own():
    plain, simulator = (tselab_here("settings", *more).out for more in ((), ("--simulator",)))
    first = [line.split()[0] for line in simulator.splitlines()[1:] if line[0] != " "]
    assert first == list(tables.settings(simulator=True)) and "true_bias_yaw_rate" not in plain
    rows = json.loads(tselab_here("settings", "--simulator", "--json").out)
    assert [r["name"] for r in rows] == first


def test_a_formula_is_printed_with_place_unit_gain_and_settings(place):
    (place / "play.toml").write_text(FORMULA)
    done = tselab_here("formula", "play.toml", "--c", "play.h")
    first, second, number, last, written = done.out.splitlines()
    assert first == "play.toml: play in the steering" and written == "Written to play.h"
    assert second == "front_angle [rad] + 0.5 * (play(steer_angle, w) - steer_angle)"
    assert number.split()[:3] == ["w", "0.003", "rad"]
    found = tse.read_formula(place / "play.toml")
    values = dict(pair.split(" = ") for pair in last.partition("settings: ")[2].split(", "))
    assert {k: float(v) for k, v in values.items()} == {k: v for k, v in found.settings().items() if v}
    assert last.startswith(f"{len(found.operations)} operations; ") and (place / "play.h").exists()
    said = json.loads(tselab_here("formula", "play.toml", "--json").out)
    assert (said["unit"], said["gain"], said["operations"]) == ("rad", 0.5, len(found.operations))
    assert said["numbers"] == [{"name": "w", "value": 0.003, "unit": "rad", "text": ""}]


def test_a_formula_lists_each_kind_of_its_parts_under_its_title():
    text = tselab_here("formula", "--help").out
    parts = text.partition("Places:")[2].partition("\nSignals:\n")
    signals, _, rest = parts[2].partition("\nFunctions, in addition to")
    plain, _, memory = rest.partition("\nFunctions that depend on earlier rows:\n")
    for kind, listed in (("SIGNAL", signals), ("PLAIN", plain), ("MEMORY", memory)):
        first = {line.split()[0] for line in listed.splitlines() if line.startswith("  ") and line[2] != " "}
        names = {o.name for o in tables.formula_operations().values() if o.kind == kind}
        assert first & set(tables.formula_operations()) == names - {
            "add", "sub", "mul", "div", "neg", "one", "two"
        }  # fmt: skip
    assert all(name in parts[0] for name in tables.formula_places())


# ---- estimate


def make_result(**more):
    """Return a result whose parts are short texts."""
    given = {
        "messages": (),
        "cautions": (),
        "warnings": (),
        "learnt": b"state",
        "reported": True,
        "answer": ("front", "rear", "along"),
        "events": (),
        "vehicle": SimpleNamespace(found=[], filled=[]),
        "stretch_words": (("a",),),
        "facts": (("log", "log.csv"), ("a long name", "1")),
        "started_from": None,
        "calibration_interrupted": False,
        "interrupted": False,
        "exit_code": 3,
        "rows": 5,
        "log": range(9),
        "written": [],
    }
    result = SimpleNamespace(**{**given, **more})
    result.save_learnt = keep_writes(result.written)
    result.write_table = keep_writes(result.written)
    result.to_dict = lambda: {"usable": "in part", "notes": "of the run"}
    return result


def test_options_of_an_estimate_reach_the_run_and_its_code_is_returned(place, monkeypatch):
    result = make_result()
    calls = replace(monkeypatch, "estimate", result)
    (place / "old.tse").write_text("")
    words = ["--config", "filter.toml", "--out", "e.csv", "--report", "r.html", "--load-learnt", "old.tse"]
    words += ["--age", 2, "--average", 0.04, "--road", "road.csv", "--form", "robust", "--rate", 50]
    words += ["--set", "valid_sd=0.1", "--seed", 4, "--table", "t.csv", "--no-progress"]
    done = tselab_here("estimate", "log.csv", "--vehicle", "car.toml", *words)
    assert done.code == 3, done.err
    ((given, named),) = calls
    assert given == (Path("log.csv"), Path("car.toml"))
    progress = named.pop("progress")
    progress("discarded")
    assert named == {
        "settings": {"valid_sd": 0.1, "seed": 4},
        "form": "robust",
        "average": 0.04,
        "learnt": Path("old.tse"),
        "age": 172800.0,
        "calibrate": True,
        "road": Path("road.csv"),
        "config": Path("filter.toml"),
        "reading": tse.Reading(None, 50.0, False, ()),
        "out": Path("e.csv"),
        "report": Path("r.html"),
        "keep_partial": True,
        "bar": False,
    }
    assert result.written == [(Path("t.csv"),)]
    assert done.out.splitlines()[-3:] == [
        "Estimates written to e.csv",
        "Report written to r.html",
        "Table written to t.csv",
    ]


@pytest.mark.parametrize(
    ("words", "calibrate"), [((), True), (("--no-calibrate",), False), (("--save-learnt", "c.tse"), False)]
)
def test_a_car_whose_learnt_state_is_saved_is_not_calibrated(words, calibrate, place, monkeypatch):
    calls = replace(monkeypatch, "estimate", make_result())
    tselab_here("estimate", "sub/drive.one.csv", "--vehicle", "car.toml", *words)
    assert calls[0][1]["calibrate"] is calibrate and calls[0][1]["learnt"] is None
    assert calls[0][1]["out"] == Path("drive.one.est.csv") and calls[0][1]["age"] == tse.UNKNOWN_AGE


@pytest.mark.parametrize(
    ("more", "line"),
    [
        ({}, "Learnt state written to c.tse"),
        ({"learnt": None}, "note: no row was used, so nothing was learnt, and c.tse is not written"),
        (
            {"learnt": None, "warnings": ("w",)},
            "note: the channels contradict each other, so nothing was learnt, and c.tse is not written",
        ),
    ],
)
def test_a_learnt_state_is_saved_or_it_is_noted_why_not(more, line, place, monkeypatch):
    result = make_result(**more)
    replace(monkeypatch, "estimate", result)
    done = tselab_here("estimate", "log.csv", "--vehicle", "car.toml", "--save-learnt", "c.tse", "--verbose")
    assert line in (done.out + done.err).splitlines()
    assert result.written == ([(Path("c.tse"),)] if not more else [])
    assert ("Learnt state written" in done.out) is not bool(more)


@pytest.mark.parametrize(
    "words",
    [
        ("--out", "log.csv"),
        ("--report", "car.html", "--vehicle", "car.html"),
        ("--save-learnt", "car.toml"),
        ("--load-learnt", "t.csv", "--table", "t.csv"),
        ("--out", "a.csv", "--table", "a.csv"),
        ("--config", "a.csv", "--out", "a.csv"),
        ("--road", "a.csv", "--out", "a.csv"),
        ("--signals", "a.csv", "--out", "a.csv"),
        ("--save-learnt", "a.csv", "--table", "a.csv"),
        ("--out", "no/e.csv"),  # no such folder
        ("--report", "no/r.html"),
        ("--save-learnt", "no/c.tse"),
        ("--table", "no/t.csv"),
        ("--table", "t.txt"),
    ],
)
def test_an_output_that_is_an_input_or_another_output_or_cannot_be_written_is_refused(
    words, place, monkeypatch
):
    calls = replace(monkeypatch, "estimate", make_result())
    for name in ("a.csv", "t.csv", "car.html"):
        (place / name).write_text("")
    vehicle = () if "--vehicle" in words else ("--vehicle", "car.toml")
    done = tselab_here("estimate", "log.csv", *vehicle, *words)
    assert done.code == 2 and calls == []
    assert tselab_here("estimate", "log.csv", "--vehicle", "car.toml", "--load-learnt", "c.tse",
                       "--save-learnt", "c.tse").code == 3  # fmt: skip


def test_ctrl_c_leaves_the_rows_that_are_done_and_has_exit_code_130(place, monkeypatch):
    replace(monkeypatch, "estimate", make_result(interrupted=True))
    done = tselab_here("estimate", "log.csv", "--vehicle", "car.toml", "--out", "e.csv")
    assert done.code == 130
    assert done.err == "tselab: stopped by Ctrl-C after 5 of 9 rows; e.csv has their estimates\n"
    replace(monkeypatch, "estimate", make_result(calibration_interrupted=True))
    done = tselab_here("estimate", "log.csv", "--vehicle", "car.toml")
    assert done.code == 130 and "the calibration was stopped by Ctrl-C" in done.err


def test_json_of_an_estimate_has_the_notes_and_files_of_the_command(place, monkeypatch):
    result = make_result(messages=("a note", "a caution"), cautions=("a caution",), reported=False)
    replace(monkeypatch, "estimate", result)
    done = tselab_here("estimate", "log.csv", "--vehicle", "car.toml", "--json", "--report", "r.html")
    assert json.loads(done.out) == {
        "usable": "in part",
        "notes": ["a note"],
        "written": {"estimates": "log.est.csv", "report": None, "table": None, "learnt": None},
    }


def print_it(capsys, function, *given):
    function(*given)
    said = capsys.readouterr()
    return said.out.splitlines(), said.err.splitlines()


def test_the_short_answer_has_every_warning_the_latest_events_and_the_first_notes(capsys):
    result = make_result(
        cautions=("c1",),
        events=tuple(f"e{i}" for i in range(7)),
        vehicle=SimpleNamespace(found=["f1", "f2"], filled=["g"]),
    )
    written = {"estimates": Path("e.csv"), "report": None}
    out, err = print_it(capsys, estimate_command.print_answer, result, ["n1", "n2", "n3"], written, False)
    # 12 lines: the answer, a warning, 4 events of 8 with the sentence on the calibration,
    # 2 notes of 3, how many more, the file
    assert out[:7] == ["front", "rear", "along", "e4", "e5", "e6", "f1"]
    assert out[7:] == ["7 more notes: --verbose, or --report PAGE.html", "Estimates written to e.csv"]
    assert err == ["warning: c1", "note: n1", "note: n2"]
    result.warnings, result.vehicle, result.events = ("c1",), None, ("e1",)
    out, err = print_it(capsys, estimate_command.print_answer, result, ["n1", "n2", "n3"], written, True)
    assert out[3:] == ["1 more note: --verbose", "Estimates written to e.csv"]  # without events
    assert err == ["warning: c1", "note: n1", "note: n2"]


def test_what_finds_no_room_in_twelve_lines_is_counted(capsys):
    two_lines = tuple(f"{i}" + " word" * 25 for i in range(4))
    result = make_result(cautions=two_lines, events=("e0", "e1"))
    out, err = print_it(capsys, estimate_command.print_answer, result, ["n"], {"estimates": None}, True)
    # three lines of the answer and eight of warnings leave none
    assert len(err) == 8 and out == ["front", "rear", "along", "3 more notes: --verbose"]
    result.cautions = (*two_lines[:3], "w")
    out, err = print_it(capsys, estimate_command.print_answer, result, ["n"], {"estimates": None}, True)
    assert out[3:] == ["e1", "2 more notes: --verbose"] and len(err) == 7
    result.cautions = two_lines[:3]  # room for two lines
    out, err = print_it(capsys, estimate_command.print_answer, result, ["n"], {"estimates": None}, True)
    assert out[3:] == ["e0", "e1", "1 more note: --verbose"] and len(err) == 6
    result.events = ("e0", "e1" + " word" * 25)  # the later one takes two lines
    out, err = print_it(capsys, estimate_command.print_answer, result, ["n"], {"estimates": None}, True)
    assert out[3].startswith("e1") and out[5:] == ["2 more notes: --verbose"] and len(err) == 6


def test_the_long_answer_has_all_notes_facts_and_twelve_stretches(capsys):
    result = make_result(
        messages=("m", "c", "m"),
        cautions=("c",),
        started_from="old.tse, 2 days old",
        events=("e",),
        vehicle=SimpleNamespace(found=["f"], filled=["g"]),
        stretch_words=tuple((f"s{i}", "x") for i in range(14)),
    )
    out, err = print_it(capsys, estimate_command.print_all, result, ["m", "n"], {"table": Path("t.csv")})
    assert err == ["note: m", "warning: c", "note: n"]
    assert out[:3] == ["started from: old.tse, 2 days old", "log:       log.csv", "a long name:1"]
    assert out[3:6] == ["f", "filled in: g", "e"]
    assert out[6:30] == [x for i in range(12) for x in (f"s{i}", "x")]
    assert out[30:] == ["and 2 more stretches, which --report lists", "Table written to t.csv"]
    result.stretch_words = result.stretch_words[:12]
    out, _ = print_it(capsys, estimate_command.print_all, result, [], {})
    assert out[-1] == "x"


# ---- signals


def make_signals(count=3, **more):
    """Return a proposal in which every third signal is used."""
    given = {
        "format": "CSV",
        "guesses": (("yaw_rate = s0", ("0.98 alike",)),),
        "missing": (),
        "nearest": {"yaw_rate": ("s5: too slow",), "accel_y": ("s6: no unit",)},
        "warnings": ("w",),
        "notes": ("n",),
        "written": [],
    }
    found = SimpleNamespace(**{**given, **more})
    rows = [(f"s{i}", "m", 100.0, -1.5, 2.25, 0.256, "yaw_rate" if i % 3 == 0 else "") for i in range(count)]
    found.to_frame = lambda: pd.DataFrame(
        rows, columns=["name", "unit", "rate", "low", "high", "missing", "used"]
    )
    found.to_dict = lambda: {"format": "CSV"}
    found.write = keep_writes(found.written)
    return found


def test_signals_are_listed_with_rate_range_share_missing_and_channel():
    text = signals_command._format_signals(make_signals(missing=("accel_y",)), Path("log.csv"), False)
    lines = text.splitlines()
    assert lines[0] == "log.csv: CSV, 3 signals"
    assert lines[3].split() == ["s0", "m", "100", "-1.5", "2.25", "26", "%", "yaw_rate"]
    assert lines[4].split() == ["s1", "m", "100", "-1.5", "2.25", "26", "%"]
    assert lines[-6:] == [
        "yaw_rate = s0",
        "  0.98 alike",
        "not found: accel_y",
        "  accel_y: s6: no unit",
        "warning: w",
        "note: n",
    ]


def test_of_many_signals_those_in_use_and_eighty_others_are_listed():
    many = make_signals(150)
    names = [f"s{i}" for i in range(150) if i % 3 == 0] + [f"s{i}" for i in range(150) if i % 3][:80]
    text = signals_command._format_signals(many, Path("log.csv"), False)
    assert [line.split()[0] for line in text.splitlines()[3 : 3 + 130]] == names
    assert "and 20 more, which --all lists" in text.splitlines()
    text = signals_command._format_signals(make_signals(80), Path("log.csv"), False)
    assert [line.split()[0] for line in text.splitlines()[3:6]] == ["s0", "s1", "s2"]  # in their order
    for found, every in ((many, True), (make_signals(80), False)):
        text = signals_command._format_signals(found, Path("log.csv"), every)
        assert "which --all lists" not in text and all(f"s{i} " in text for i in range(80))


def test_a_proposal_without_a_folder_is_written_beside_its_log(place, monkeypatch):
    (place / "sub").mkdir()
    found = make_signals()
    calls = replace(monkeypatch, "signals", found)
    done = tselab_here("signals", "sub/log.csv", "--write", "s.toml", "--vehicle", "car.toml",
                       "--database", "a.dbc")  # fmt: skip
    assert done.code == 0 and done.out.splitlines()[-1] == "Written to sub/s.toml"
    assert found.written == [(Path("sub/s.toml"),)]
    assert calls == [((Path("sub/log.csv"), Path("car.toml")), {"databases": (Path("a.dbc"),)})]
    done = tselab_here("signals", "sub/log.csv", "--write", "./sub/other.toml", "--json")
    assert json.loads(done.out) == {"format": "CSV"} and done.err == "Written to sub/other.toml\n"
    (place / "sub" / "s.toml").write_text("mine")
    done = tselab_here("signals", "sub/log.csv", "--write", "s.toml")
    assert done.code == 2 and "sub/s.toml: exists already" in done.err and len(found.written) == 2
    replace(monkeypatch, "signals", make_signals(guesses=()))
    done = tselab_here("signals", "log.csv", "--write", "new.toml")
    assert done.code == 2 and "so new.toml is not written" in done.err.replace(f"{place}/", "")


# ---- simulate, replay


@pytest.mark.parametrize(
    ("pairs", "found"),
    [
        ((), []),
        (("20:0.7", "0:1", " 5.5 : 2e0 "), [(20.0, 0.7), (0.0, 1.0), (5.5, 2.0)]),
        (("3:0.02", "3:10"), [(3.0, 0.02), (3.0, 10.0)]),
        (("-1:0.5",), "outside its range: .*0.02 .. 10$"),
        (("1:10.5",), "outside its range"),
        (("1:0.01",), "outside its range"),
        (("nan:1",), "outside its range"),
        (("1:2:3",), "is not TIME:LEVEL"),
        (("1",), "is not TIME:LEVEL"),
        (("a:1",), "is not TIME:LEVEL"),
    ],
)
def test_changes_of_the_road_are_a_time_and_a_level(pairs, found):
    if isinstance(found, list):
        assert simulate_command._read_road_changes(pairs) == found
        return
    with pytest.raises(Error, match=f"option --road-change: '{pairs[0]}' .*{found}"):
        simulate_command._read_road_changes(pairs)


def make_drive(written, rows=101, step=0.02):
    return SimpleNamespace(
        log=pd.DataFrame({"time": np.arange(rows) * step}),
        write=lambda *given, **named: written.append((given, named)),
    )


def test_options_of_a_simulation_are_settings_and_the_manoeuvre(place, monkeypatch):
    written = []
    calls = replace(monkeypatch, "simulate", make_drive(written))
    words = ["--truth", "t.csv", "--with-ref", "--seed", 7, "--duration", 8, "--sample-time", 0.02]
    words += ["--speed", 15, "--amplitude", -0.05, "--road-change", "2:0.5", "--spread", 0.1, "--noise", 2]
    words += ["--set", "mass=1700", "--set", "seed=9", "--road", "road.csv", "--no-progress"]
    done = tselab_here(
        "simulate", "--maneuver", "sine-sweep", "--out", "s.csv", "--vehicle", "car.toml", *words
    )
    assert done.code == 0, done.err
    ((given, named),) = calls
    assert given[0] == "sine-sweep" and given[1].values["mass"] == 1650
    assert named == {
        "duration": 8.0,
        "speed": 15.0,
        "amplitude": -0.05,
        "road_changes": [(2.0, 0.5)],
        "settings": {
            "mass": 1700,
            "seed": 7,
            "noise": 2.0,
            "sample_time": 0.02,
            **{f"spread_{s}": 0.1 for s in ("cx_front", "cy_front", "cy_rear")},
        },
        "road": Path("road.csv"),
        "bar": False,
    }
    assert written == [((Path("s.csv"), Path("t.csv")), {"with_ref": True})]
    assert "sine-sweep, car: 101 rows, 2 s, seed 7" in done.out or "101 rows, 2 s, seed 7" in done.out
    assert done.out.splitlines()[-1] == "Log written to s.csv, truth to t.csv"
    assert any(line.startswith("filled in: ") for line in done.out.splitlines())


def test_a_simulation_without_a_vehicle_is_of_the_built_in_car(place, monkeypatch):
    written = []
    calls = replace(monkeypatch, "simulate", make_drive(written))
    done = tselab_here("simulate", "--maneuver", "straight", "--out", "s.csv")
    seed = tables.settings(simulator=True)["seed"].default
    assert done.out == (f"straight, the built-in car: 101 rows, 2 s, seed {seed:.0f}\nLog written to s.csv\n")
    assert calls[0][0] == ("straight", None) and calls[0][1]["settings"] == {}
    assert written == [((Path("s.csv"), None), {"with_ref": False})]
    done = tselab_here("simulate", "--maneuver", "straight", "--out", "s.csv", "--json", "--set", "seed=5")
    assert json.loads(done.out) == {
        "maneuver": "straight",
        "vehicle": "the built-in car",
        "rows": 101,
        "seconds": 2.0,
        "seed": 5,
        "filled": [],
        "notes": [],
        "written": {"log": "s.csv", "truth": None},
    }


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--road", "s.csv"), "--road"),
        (("--truth", "s.csv"), "--truth"),
        (("--truth", "t.csv", "--road", "t.csv"), "--road"),
        (("--truth", "no/t.csv"), "does not exist"),
    ],
)
def test_files_of_a_simulation_are_none_of_its_inputs_and_can_be_written(words, text, place, monkeypatch):
    calls = replace(monkeypatch, "simulate", make_drive([]))
    done = tselab_here("simulate", "--maneuver", "straight", "--out", "s.csv", *words)
    assert done.code == 2 and text in done.err and calls == []


def test_a_simulation_says_what_was_filled_in_and_noted_of_its_car(place, monkeypatch):
    replace(monkeypatch, "simulate", make_drive([]))
    replace(monkeypatch, "read_vehicle", SimpleNamespace(name="my car", filled=["a"], notes=["b"]))
    words = ("simulate", "--maneuver", "straight", "--out", "s.csv", "--vehicle", "car.toml")
    done = tselab_here(*words)
    assert done.out.splitlines()[0] == "filled in: a" and done.err == "note: b\n"
    said = json.loads(tselab_here(*words, "--json", "--truth", "t.csv").out)
    assert (said["vehicle"], said["filled"], said["notes"]) == ("my car", ["a"], ["b"])
    assert said["written"] == {"log": "s.csv", "truth": "t.csv"}


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--maneuver", "constant-radius", "--amplitude", 10), None),
        (("--maneuver", "constant-radius", "--amplitude", 9.9), "10 .. 1000 m (radius)"),
        (("--maneuver", "constant-radius", "--amplitude", 1001), "-1000 .. 1000"),
        (("--maneuver", "step-steer", "--amplitude", -1.2), None),
        (("--maneuver", "step-steer", "--amplitude", -1.3), "0 .. 1.2 rad"),
        (("--maneuver", "step-steer", "--amplitude", 1.3), "0 .. 1.2 rad"),
        (("--maneuver", "straight", "--duration", 0.01), None),
        (("--maneuver", "straight", "--duration", 0.009), "0.01 .. "),
        (("--maneuver", "straight", "--duration", 0.04, "--sample-time", 0.05), "0.05 .. "),
        (("--maneuver", "straight", "--duration", tables.MAX_DURATION), None),
        (("--maneuver", "straight", "--duration", tables.MAX_DURATION + 1), "option --duration"),
    ],
)
def test_amplitude_and_duration_of_a_simulation_have_a_range(words, text, place, monkeypatch):
    replace(monkeypatch, "simulate", make_drive([]))
    done = tselab_here("simulate", *words, "--out", "s.csv")
    assert done.code == (0 if text is None else 2), done.err
    assert text is None or text in done.err


def test_a_manoeuvre_is_listed_with_its_defaults():
    k = tables.maneuvers()[0]
    lines = simulate_command._list_maneuvers().splitlines()
    assert len(lines) == 2 * len(tables.maneuvers()) and lines[1].strip() == k.text
    words = f"{k.duration:g} s from {k.speed:g} m/s, amplitude {k.amplitude:g} ({k.amplitude_text})"
    assert lines[0].split(maxsplit=1) == [k.name, words]


def test_a_replay_prints_notes_words_and_files(place, monkeypatch):
    written = []
    found = SimpleNamespace(
        write=keep_writes(written),
        report=keep_writes(written),
        notes=("n",),
        words=("accel_y: 0.1 m/s2",),
        to_dict=lambda: {"apart": {}, "notes": ["n"]},
    )
    calls = replace(monkeypatch, "replay", found)
    words = ("replay", "log.csv", "--vehicle", "car.toml", "--set", "mass=1700", "--road", "r.csv")
    done = tselab_here(*words, "--out", "o.csv", "--report", "p.html")
    assert (done.code, done.err) == (0, "note: n\n")
    assert done.out == "accel_y: 0.1 m/s2\nWritten: o.csv, p.html\n"
    assert written == [(Path("o.csv"),), (Path("p.html"),)]
    assert calls[0][0] == (Path("log.csv"), Path("car.toml"))
    assert calls[0][1]["settings"] == {"mass": 1700} and calls[0][1]["road"] == Path("r.csv")
    done = tselab_here(*words)
    assert done.out == "accel_y: 0.1 m/s2\n" and len(written) == 2
    said = json.loads(tselab_here(*words, "--json").out)
    assert said == {"log": "log.csv", "vehicle": "car.toml", "apart": {}, "notes": ["n"], "written": []}
    assert tselab_here(*words, "--out", "log.csv").code == 2


# ---- calibrate, gap


def test_held_out_logs_are_all_arguments_up_to_the_next_option():
    taken = []

    @click.command(cls=gap_command.RunCommand)
    @gap_command.LOGS
    @gap_command.HELD
    @click.option("--x")
    def command(logs, hold_out, x):
        taken.append(([str(p) for p in logs], [str(p) for p in hold_out], x))

    for words in (
        ["a", "b", "--hold-out", "c", "d", "--x", "1", "e"],
        ["--hold-out", "c", "--x", "1", "a"],
        ["a", "--hold-out", "c", "--hold-out", "d", "-"],
        ["a"],
    ):
        command.main(words, standalone_mode=False)
    assert taken == [
        (["a", "b", "e"], ["c", "d"], "1"),
        (["a"], ["c"], "1"),
        (["a"], ["c", "d", "-"], None),
        (["a"], [], None),
    ]
    with pytest.raises(click.BadOptionUsage, match="--hold-out"):
        command.main(["a", "--hold-out"], standalone_mode=False)


def test_a_log_that_does_not_exist_or_is_given_twice_is_refused(place):
    def check(logs, hold_out=()):
        given = tuple(map(Path, logs)), tuple(map(Path, hold_out))
        gap_command.check_logs_exist(*given)
        gap_command.check_logs_once(*given)

    check(["log.csv"], ["other.csv"])
    for logs, hold_out, text in (
        (["log.csv", "./log.csv"], [], "^log.csv: is given twice: give it once"),
        (["log.csv"], [f"{place}/log.csv"], "log.csv: option --hold-out: is also a log of the fit"),
        (["log.csv"], ["other.csv", "other.csv"], "other.csv: option --hold-out"),
        (["log.csv", "catalog"], [], "^catalog: no such file$"),
        (["catalog", "log.csv"], [], "did you mean the command 'tselab gap catalogue'"),
        (["log.csv"], ["none.csv"], "^none.csv: no such file$"),
    ):
        with pytest.raises(Error, match=text):
            check(logs, hold_out)


def make_gap(**more):
    found = SimpleNamespace(
        words=("verdict", "Still left: x"),
        answer=("verdict",),
        stages=("stage",),
        short_stages=("table",),
        undetectable=("lag", "play"),
        notes=("a note",),
        gain=("gain",),
        files=(Path("found/verdict.json"), Path("found/report.html")),
        exit_code=11,
        written=[],
        to_dict=lambda: {"verdict": "possible"},
        **more,
    )
    found.report = keep_writes(found.written)
    return found


def test_the_verdict_on_effects_is_printed_short_or_whole(place, monkeypatch):
    found = make_gap()
    calls = replace(monkeypatch, "gap", found)
    words = ("gap", "log.csv", "--vehicle", "car.toml", "--out", "found", "--hold-out", "other.csv")
    words += ("--jobs", 3, "--road", "r.csv", "--no-progress")
    done = tselab_here(*words)
    assert (done.code, done.err) == (11, "note: a note\n")
    assert done.out == "verdict\ntable\nWritten to found: verdict.json, report.html\n"
    ((given, named),) = calls
    named.pop("progress")
    assert given == ((Path("log.csv"),), Path("car.toml"))
    assert named == {
        "hold_out": (Path("other.csv"),),
        "out": Path("found"),
        "jobs": 3,
        "formula": False,
        "road": Path("r.csv"),
        "reading": tse.Reading(),
    }
    done = tselab_here(*words, "--verbose", "--report", "p.html")
    assert done.out.splitlines()[:3] == ["verdict", "Still left: x", "stage"]
    assert "at their typical size: lag, play." in done.out.splitlines()[3]
    assert done.out.splitlines()[4] == "gain" and found.written == [(Path("p.html"),)]
    said = json.loads(tselab_here(*words, "--json").out)
    assert said["exit_code"] == 11 and said["written"] == ["found/verdict.json", "found/report.html"]
    assert tselab_here("gap", "discover", *words[1:]).code == 11 and calls[-1][1]["formula"] is True


def test_a_check_of_effects_prints_its_table_and_returns_its_code(place, monkeypatch):
    written = []
    found = SimpleNamespace(
        text="the table", exit_code=4, write_table=keep_writes(written), to_dict=lambda: {"effects": []}
    )
    calls = replace(monkeypatch, "gap_check", found)
    words = ("gap", "check", "log.csv", "other.csv", "--vehicle", "car.toml", "--jobs", 2)
    done = tselab_here(*words, "--table", "t.csv", "--no-progress")
    assert (done.code, done.out) == (4, "the table\n") and written == [(Path("t.csv"),)]
    assert calls[0][0] == ((Path("log.csv"), Path("other.csv")), Path("car.toml"))
    assert calls[0][1]["jobs"] == 2
    said = json.loads(tselab_here(*words, "--json").out)
    assert said["exit_code"] == 4 and said["logs"] == ["log.csv", "other.csv"]
    assert tselab_here(*words, "--table", "log.csv").code == 2
    plan = SimpleNamespace(text=lambda top: f"{top} rows", to_dict=lambda: {"separable": True})
    calls = replace(monkeypatch, "gap_plan", plan)
    words = ("gap", "plan", "--separate", "a,b", "--vehicle", "car.toml", "--jobs", 2)
    assert tselab_here(*words).out == "6 rows\n" and tselab_here(*words, "--top", 3).out == "3 rows\n"
    assert json.loads(tselab_here(*words, "--json").out) == {"separable": True}
    assert calls[0][0] == ("a,b", Path("car.toml")) and calls[0][1]["jobs"] == 2


def test_the_catalogue_lists_each_effect_once_with_its_strengths(place):
    effects = tables.effects()
    done = tselab_here("gap", "catalogue", "--table", "t.csv")
    lines = done.out.splitlines()
    assert [x.partition(":")[0] for x in lines if not x.startswith(" ")] == list(
        OrderedDict.fromkeys(e["id"] for e in effects)
    )
    strengths = [e for e in effects if e["strength"]]
    indented = [x.split() for x in lines if x.startswith(" ")]
    assert [x[0] for x in indented] == [e["setting"] for e in strengths]
    for x, e in zip(indented, strengths, strict=True):
        text = " ".join(x)
        assert f"typical {e['typical_low']:g} .. {e['typical_high']:g}, negligible below" in text
        assert f"negligible below {e['negligible']:g}: {' '.join(e['meaning'].split())}" in text
    table = pd.read_csv(place / "t.csv")
    assert len(table) == len(effects) > len(strengths) and "strength" not in table
    said = json.loads(tselab_here("gap", "catalogue", "--json").out)["effects"]
    assert [e["setting"] for e in said] == table["setting"].tolist()


def make_calibration():
    found = SimpleNamespace(
        words=("w1", "w2"),
        shown_words=("mass",),
        answer=("a",),
        notes=("n",),
        exit_code=4,
        written=[],
        to_dict=lambda: {"converged": True},
    )
    for name in ("write", "report", "write_table"):
        setattr(found, name, lambda path, name=name: found.written.append((name, path)))
    return found


def test_a_calibration_names_its_files_and_prints_parameters_on_request(place, monkeypatch):
    found = make_calibration()
    calls = replace(monkeypatch, "calibrate", found)
    words = ("calibrate", "log.csv", "--vehicle", "car.toml", "--out", "c.toml", "--no-progress")
    more = ("--hold-out", "other.csv", "--steps", 9, "--jobs", 2, "--table", "t.csv", "--road", "r.csv")
    done = tselab_here(*words, *more)
    assert (done.code, done.err) == (4, "note: n\n")
    assert done.out == "a\nMore: --verbose, c.html\nWritten: c.toml, c.json, c.html, t.csv\n"
    assert found.written == [
        ("write", Path("c.toml")), ("report", Path("c.html")), ("write_table", Path("t.csv"))
    ]  # fmt: skip
    ((given, named),) = calls
    named.pop("progress")
    assert given == ((Path("log.csv"),), Path("car.toml"))
    assert named == {
        "hold_out": (Path("other.csv"),),
        "road": Path("r.csv"),
        "reading": tse.Reading(),
        "steps": 9,
        "jobs": 2,
    }
    done = tselab_here(*words, "--verbose", "--report", "p.html")
    assert done.out == "w1\nw2\n  mass\nWritten: c.toml, c.json, p.html\n"
    said = json.loads(tselab_here(*words, "--json").out)
    assert said == {
        "logs": ["log.csv"],
        "vehicle": "car.toml",
        "converged": True,
        "exit_code": 4,
        "written": ["c.toml", "c.json", "c.html"],
    }


def test_a_calibrated_car_with_a_formula_has_its_copy_and_overwrites_no_input(place, monkeypatch):
    calls = replace(monkeypatch, "calibrate", make_calibration())
    (place / "c.formula.toml").write_text(FORMULA)
    (place / "play.toml").write_text(FORMULA)
    for formula, out, code in (
        ("play.toml", "c.toml", 4),
        ("c.formula.toml", "c.toml", 2),
        (None, "car.toml", 2),
    ):
        text = f'{CAR}[formula]\nfile = "{formula}"\n' if formula else CAR
        (place / "car.toml").write_text(text)
        done = tselab_here("calibrate", "log.csv", "--vehicle", "car.toml", "--out", out)
        assert done.code == code, done.err
        if code == 4:
            assert done.out.splitlines()[-1] == "Written: c.toml, c.formula.toml, c.json, c.html"
    assert len(calls) == 1
    done = tselab_here("calibrate", "log.csv", "log.csv", "--vehicle", "car.toml", "--out", "c.toml")
    assert done.code == 2 and "is given twice" in done.err


# ---- fleet, studies


def make_fleet(cars, errors=0):
    counts = {"yes": 4, "in part": 3, "no": 2, "error": errors}
    sized = type("Fleet", (SimpleNamespace,), {"__len__": lambda _: 9 + errors})
    return sized(
        counts=counts,
        hours=12.34,
        ranking=tuple((f"car {i}" if i else "", f"reason {i}") for i in range(cars)),
        errors=tuple(f"log {i}" for i in range(errors)),
        files=(Path("out/fleet.parquet"), Path("out/fleet.html")),
        exit_code=3,
        to_dict=lambda: {"logs": []},
    )


def test_a_fleet_is_printed_with_its_softest_cars_and_first_errors(place, monkeypatch):
    calls = replace(monkeypatch, "fleet", make_fleet(7, 12))
    words = ("fleet", "logs", "*.csv", "--vehicle", "car.toml", "--out", "out", "--no-progress")
    more = (
        "--car",
        "golf",
        "--no-learn",
        "--no-reports",
        "--estimates",
        "--average",
        0.05,
        "--form",
        "robust",
    )
    more += ("--set", "valid_sd=0.1", "--jobs", 2, "--restart", "--no-calibrate", "--config", "f.toml")
    done = tselab_here(*words, *more)
    assert done.code == 3
    lines = done.out.splitlines()
    assert lines[0] == (
        "21 logs of 7 cars, 12.3 h: 4 usable, 3 usable in part, 2 not usable, 12 not estimated because "
        "of an error"
    )
    assert lines[1] == "1. logs without a car: reason 0" and lines[5] == "5. car 4: reason 4"
    assert lines[6:] == [
        "and 2 more cars, which out/fleet.html lists",
        "Written to out: fleet.parquet, fleet.html",
    ]
    assert done.err.splitlines() == [
        *(f"error: log {i}" for i in range(10)), "and 2 more errors, which out/fleet.html lists"
    ]  # fmt: skip
    ((given, named),) = calls
    assert given == (("logs", "*.csv"), Path("car.toml"))
    assert named == {
        "out": Path("out"),
        "vehicles": None,
        "car": "golf",
        "settings": {"valid_sd": 0.1},
        "config": Path("f.toml"),
        "form": "robust",
        "average": 0.05,
        "reading": tse.Reading(),
        "learn": False,
        "calibrate": False,
        "reports": False,
        "estimates": True,
        "restart": True,
        "jobs": 2,
        "isolate": True,
        "scheduler": None,
        "bar": False,
    }
    replace(monkeypatch, "fleet", make_fleet(1))
    done = tselab_here(*words)
    assert done.out.startswith("9 logs of 1 car, ") and "more" not in done.out and done.err == ""
    said = json.loads(tselab_here(*words, "--json").out)
    assert said == {"logs": [], "written": ["out/fleet.parquet", "out/fleet.html"]}


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ((), "give either --vehicle"),
        (("--vehicle", "car.toml", "--vehicles", "t.csv"), "give either --vehicle"),
        (("--vehicles", "t.csv", "--car", "golf"), "option --car: is not allowed"),
    ],
)
def test_a_fleet_has_one_vehicle_or_a_table_of_them(words, text, place, monkeypatch):
    calls = replace(monkeypatch, "fleet", make_fleet(1))
    done = tselab_here("fleet", "logs", "--out", "out", *words)
    assert done.code == 2 and text in done.err and calls == []


def test_settings_of_a_study_are_split_between_filter_and_simulator(place, monkeypatch):
    plans, runs = [], []
    study = SimpleNamespace(runs=33)
    monkeypatch.setattr(all_studies, "make_study", lambda *given: plans.append(given) or study)
    monkeypatch.setattr(engine, "run_study", lambda *given: runs.append(given) or "rows")
    monkeypatch.setattr(pictures, "write_study", lambda *given: ("the table", [given[2] / "x.md"]))
    words = ("montecarlo", "--study", "stress", "--cases", "a, b", "--first-seed", 5, "--form", "robust")
    done = tselab_here(*words, "--set", "noise=2", "--set", "valid_sd=0.1", "--jobs", 2, "--no-progress")
    assert done.out == "the table\nWritten to montecarlo-stress: x.md\n", done.err
    assert plans == [("stress", ("a", "b"))]
    ((plan, out, jobs, scheduler, restart, bar),) = runs
    assert (plan.study, plan.runs, plan.first_seed, plan.form) == (study, 33, 5, "robust")
    assert (plan.settings, plan.sim_settings, plan.cases) == ({"valid_sd": 0.1}, {"noise": 2}, ("a", "b"))
    assert (out, jobs, scheduler, restart, bar) == (Path("montecarlo-stress"), 2, None, False, False)
    done = tselab_here("paper", "--runs", 4, "--json", "--restart", "--jobs", 1)
    assert json.loads(done.out) == {"study": "paper", "text": "the table", "written": ["paper/x.md"]}
    assert plans[1] == ("paper", ()) and runs[1][0].runs == 4 and runs[1][0].cases == ()
    assert runs[1][1:5] == (Path("paper"), 1, None, True)
    done = tselab_here("montecarlo", "--study", "stress", "--set", "seed=3")
    assert done.code == 2 and "seed is not allowed" in done.err and len(runs) == 2
    assert len(studies._list_studies().splitlines()) == len(studies.STUDIES)


# ---- live


def test_options_of_a_bus_are_numbers_truth_values_or_text():
    pairs = ("bitrate=500000", "timing=0.5", "fd=true", "echo=FALSE", "host=10.0.0.1", " key =a=b", "n=-3")
    found = live._read_bus_options(pairs)
    assert found == {
        "bitrate": 500000,
        "timing": 0.5,
        "fd": True,
        "echo": False,
        "host": "10.0.0.1",
        "key": "a=b",
        "n": -3,
    }
    assert [type(found[k]) for k in ("bitrate", "timing", "fd")] == [int, float, bool]
    for pair in ("bitrate", "=1", "a b=1"):
        with pytest.raises(Error, match=f"option --bus: '{pair}' is not KEY=VALUE"):
            live._read_bus_options((pair,))


def test_lines_of_a_terminal_are_updated_in_place_and_events_stand_above(monkeypatch, capsys):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    with live._Lines(False) as lines:
        lines.show(["a", "b", "c"])
        lines.show([])
        lines.show(["d", "e"])
        lines.say("an event")
        lines.show(["f"])
    said = capsys.readouterr()
    up = "\033[{}A\033[J"
    assert said.out == f"a\nb\nc\n{up.format(3)}d\ne\n{up.format(2)}an event\nf\n{up.format(1)}"
    assert said.err == ""
    with live._Lines(True) as lines:
        lines.show(["a"])
        lines.say("an event")
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "an event\n")


def test_the_lines_of_a_drive_are_updated_four_times_a_second(monkeypatch):
    clock, shown = [100.0], []
    monkeypatch.setattr(live.time, "monotonic", lambda: clock[0])

    def poll():
        clock[0] += 0.1

    drive = SimpleNamespace(poll=poll, answer="answer", ended=False)
    lines = SimpleNamespace(show=lambda answer: shown.append((round(clock[0] - 100.0, 1), answer)))
    live._follow(drive, lines, lambda: clock[0] > 100.95)
    assert shown == [(t, "answer") for t in (0.1, 0.4, 0.7, 1.0)]
    drive.ended = True
    live._follow(drive, lines, lambda: False)
    assert len(shown) == 4


def test_ctrl_c_sets_a_flag_a_second_one_ends_and_all_is_restored_afterwards():
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    interval = sys.getswitchinterval()
    for first in before:
        with live._catch_interrupt() as stopped:
            assert not stopped() and sys.getswitchinterval() < interval
            signal.raise_signal(first)
            assert stopped()
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        assert {n: signal.getsignal(n) for n in before} == before
        assert sys.getswitchinterval() == pytest.approx(interval)


def make_live(rows=5, learnt=b"state"):
    drive = SimpleNamespace(
        notes=("a note",),
        rows=rows,
        learnt=learnt,
        exit_code=3,
        answer=("front",),
        numbers="9 frames",
        ended=True,
        written=[],
        closed=[],
        to_dict=lambda: {"rows": rows},
        serve=lambda: "http://127.0.0.1:5/",
    )
    drive.close = lambda: drive.closed.append(1)
    drive.write_table = keep_writes(drive.written)
    drive.save_learnt = keep_writes(drive.written)
    return drive


def test_options_of_a_drive_reach_it_and_its_result_is_printed_and_saved(place, monkeypatch):
    drive, opened = make_live(), []
    calls = replace(monkeypatch, "live", drive)
    monkeypatch.setattr(click, "launch", opened.append)
    words = ("live", "--interface", "pcan", "--channel", "can1", "--database", "a.dbc", "--database", "b.dbc")
    words += ("--vehicle", "car.toml", "--signals", "s.toml", "--out", "drive", "--load-learnt", "old.tse")
    words += (
        "--age",
        1,
        "--save-learnt",
        "new.tse",
        "--rate",
        50,
        "--config",
        "f.toml",
        "--set",
        "mass=1700",
    )
    words += ("--bus", "bitrate=5", "--duration", 7, "--table", "t.csv", "--browser")
    done = tselab_here(*words)
    assert done.code == 3, done.err
    assert done.out.splitlines() == ["front", "Learnt state written to new.tse", "Drive recorded in drive"]
    assert done.err.splitlines() == [
        "a note",
        "the drive is recorded in drive; Ctrl-C ends it",
        "plots: http://127.0.0.1:5/",
        "9 frames",
    ]
    assert opened == ["http://127.0.0.1:5/"] and drive.closed == [1]
    assert drive.written == [(Path("t.csv"),), (Path("new.tse"),)]
    ((given, named),) = calls
    named.pop("say")
    assert given == (Path("car.toml"),)
    assert named == {
        "database": (Path("a.dbc"), Path("b.dbc")),
        "interface": "pcan",
        "channel": "can1",
        "signals": Path("s.toml"),
        "out": Path("drive"),
        "settings": {"mass": 1700},
        "config": Path("f.toml"),
        "learnt": Path("old.tse"),
        "age": 86400.0,
        "rate": 50.0,
        "duration": 7.0,
        "bitrate": 5,
    }


def test_a_drive_without_rows_or_without_a_learnt_state_writes_neither(place, monkeypatch):
    drive = make_live(0, None)
    calls = replace(monkeypatch, "live", drive)
    words = ("live", "--interface", "x", "--database", "a.dbc", "--vehicle", "car.toml")
    done = tselab_here(*words, "--table", "t.csv", "--save-learnt", "new.tse")
    assert drive.written == [] and "no row was made from the received frames" in done.out
    assert "nothing was learnt, so new.tse is not written" in done.err
    name = str(calls[0][1]["out"])
    assert name.startswith("live-2") and len(name) == len("live-20240501-120000")
    done = tselab_here(*words, "--json", "--save-learnt", "new.tse", "--out", "drive")
    assert json.loads(done.out) == {"rows": 0, "learnt": None} and done.code == 3
    replace(monkeypatch, "live", make_live())
    done = tselab_here(*words, "--json", "--save-learnt", "new.tse", "--out", "drive")
    assert json.loads(done.out) == {"rows": 5, "learnt": "new.tse"}


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("--rate", 2), 3),
        (("--rate", 1000), 3),
        (("--rate", 1.9), 2),
        (("--rate", 1001), 2),
        (("--duration", 0.1), 3),
        (("--duration", 0.09), 2),
        (("--duration", 86400), 3),
        (("--duration", 86401), 2),
        (("--save-learnt", "car.toml"), 2),
        (("--load-learnt", "t.csv", "--table", "t.csv"), 2),
        (("--load-learnt", "t.tse", "--save-learnt", "t.tse"), 3),
        (("--signals", "t.csv", "--table", "t.csv"), 2),
        (("--config", "t.csv", "--table", "t.csv"), 2),
        (("--save-learnt", "t.csv", "--table", "t.csv"), 2),
        (("--save-learnt", "no/t.tse"), 2),  # no such folder
        (("--table", "no/t.csv"), 2),
        (("--bus", "bit rate=5"), 2),
    ],
)
def test_what_a_drive_cannot_begin_with_is_refused_before_it_begins(words, code, place, monkeypatch):
    calls = replace(monkeypatch, "live", make_live())
    done = tselab_here("live", "--interface", "x", "--database", "a.dbc", "--vehicle", "car.toml",
                       "--out", "drive", *words)  # fmt: skip
    assert done.code == code and len(calls) == (code == 3)


# ---- demo


def test_the_logger_of_the_demo_has_names_units_rates_and_latencies_of_a_bus(tmp_path, monkeypatch):
    groups = {}

    class File:
        def __init__(self, version):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def append(self, signals, acq_name):
            groups[acq_name] = {s.name: s for s in signals}

        def save(self, path, overwrite):
            groups["path"] = path

    def make_signal(samples, time, unit, name):
        return SimpleNamespace(samples=samples, time=time, unit=unit, name=name)

    monkeypatch.setitem(sys.modules, "asammdf", SimpleNamespace(MDF=File, Signal=make_signal))
    n = 8
    t = np.arange(n) * 0.01
    log = pd.DataFrame(
        {"time": t, "steer_angle": 0.02, "yaw_rate": 0.1, "accel_y": 4.903325, "accel_x": -1.5}
    )
    log["wheel_speed_front"], log["wheel_speed_rear"] = 60.0 + t, 50.0
    demo.write_mf4(tmp_path / "x.mf4", log, {"wheel_radius_front": 0.3, "wheel_radius_rear": 0.4})
    assert groups.pop("path") == tmp_path / "x.mf4"
    at = {
        s: (every, late) for s, every, late in (("LWI", 4, 0.03), ("ESP_wheels", 2, 0.04), ("IMU", 1, 0.01))
    }
    assert set(groups) == set(at)
    for name, (every, late) in at.items():
        for s in groups[name].values():
            assert s.time == pytest.approx(t[::every] + late)
    half = 0.5 * 1.55 * 0.1  # m/s at the wheels by the yaw rate: the left ones are slower
    expected = {
        "LWI_Lenkradwinkel": ("deg", np.degrees(0.02) * 15.3),
        "ESP_VL": ("km/h", 3.6 * (0.3 * (60.0 + t[::2]) - half)),
        "ESP_VR": ("km/h", 3.6 * (0.3 * (60.0 + t[::2]) + half)),
        "ESP_HL": ("km/h", 3.6 * (20.0 - half)),
        "ESP_HR": ("km/h", 3.6 * (20.0 + half)),
        "Gierrate": ("deg/s", np.degrees(0.1)),
        "Querbeschl": ("g", 0.5),
        "Laengsbeschl": ("m/s2", -1.5),
    }
    found = {name: s for signals in groups.values() for name, s in signals.items()}
    assert set(found) == set(expected)
    for name, (unit, value) in expected.items():
        assert found[name].unit == unit and found[name].samples == pytest.approx(value), name


def make_estimates(t, **levels):
    table = pd.DataFrame({"time": t})
    for s in tse.STIFFNESS:
        table[s], table[f"{s}_valid"] = levels.get(s, 1.0), True
    return table


def test_the_demo_states_errors_before_the_change_and_at_the_end_of_the_valid_rows(
    tmp_path, monkeypatch, capsys
):
    t = np.arange(73.0)
    truth = pd.DataFrame({f"true_{s}": np.where(t < 36, 1e5, 7e4) for s in tse.STIFFNESS})
    table = make_estimates(t)
    error = np.where(t < 10, 0.9, np.where(t < 36, np.where(t % 2, 0.03, -0.01), np.where(t > 60, 0.02, 0.5)))
    table["cy_front"] = truth["true_cy_front"] * (1 + error)
    table.loc[t >= 37, "cx_front_valid"] = False
    table.loc[65, "cy_rear_valid"] = False
    for s in ("cx_front", "cy_rear"):
        table[s] = truth[f"true_{s}"] * np.where(t == 65, 3.0, 1.0)
    written = []
    drive = SimpleNamespace(truth=truth, log="the log", write=keep_writes(written))
    result = SimpleNamespace(table=table, time=t, to_csv=keep_writes(written), report=keep_writes(written))
    simulated = replace(monkeypatch, "simulate", drive)
    replace(monkeypatch, "estimate", result)

    def no_picture(*_):
        raise Error("no matplotlib")

    monkeypatch.setattr(demo, "draw_demo", no_picture)
    assert demo.show_estimate(tmp_path, 4, False) == ("the log", table)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Double lane changes, 72 s; at 36 s every stiffness drops to 70 % of nominal."
    rms = 100 * np.sqrt((0.03**2 + 0.01**2) / 2)
    names, rear = tables.STIFFNESS_NAMES, "0.0 % from 10 s to the change, 0.0 % in the last 12 s"
    assert f"{names['cx_front']}: RMS error 0.0 % from 10 s to the change; valid 51 % of the time" in lines
    assert (
        f"{names['cy_front']}: RMS error {rms:.1f} % from 10 s to the change, 2.0 % in the last 12 s; "
        "valid 100 % of the time"
    ) in lines
    assert f"{names['cy_rear']}: RMS error {rear}; valid 99 % of the time" in lines
    assert "demo.png" not in lines[-1] and "report.html" in lines[-1]
    assert (tmp_path / "filter.toml").read_text().splitlines()[1:] == [
        f"initial_{s} = 0.8" for s in tse.STIFFNESS
    ]
    named = simulated[0][1]
    assert named["road_changes"] == [(36.0, 0.7)] and named["seed"] == 4 and named["duration"] == 72.0


def test_the_demo_of_a_hidden_effect_holds_out_the_last_log_and_states_the_residuals(
    tmp_path, monkeypatch, capsys
):
    drives = SimpleNamespace(write=lambda path: path)
    simulated = replace(monkeypatch, "simulate", drives)
    rms = {"fit": {"accel_y": (3.0, 1.01)}, "held_out": {"accel_y": (2.0, 1.04)}}
    found = replace(monkeypatch, "gap", SimpleNamespace(words=("named",), rms=rms))
    demo.show_gap(tmp_path, 10, lambda _: None)
    (((logs, path), named),) = found
    names = [p.name for p in logs]
    assert names == ["log_1_sine_sweep.csv", "log_2_double_lane_change.csv", "log_3_square_waves.csv"]
    assert [p.name for p in named["hold_out"]] == ["held_out_4_square_waves.csv"]
    assert "body_roll_gain" not in tse.read_vehicle(path).values
    assert [call[1]["seed"] for call in simulated] == [10, 11, 12, 13]
    settings = simulated[0][1]["settings"]
    assert settings["body_roll_gain"] == 0.009 and settings["spread_cy_rear"] == 0.02
    out = capsys.readouterr().out
    assert "3.00 without the named effect, 1.01 with it; in the held-out manoeuvre 2.00 and 1.04." in out


def test_the_demo_of_a_logger_compares_the_ends_of_both_estimates(tmp_path, monkeypatch, capsys):
    t = np.arange(101) * 0.2  # to 20 s; the mean is that of the last 12 s
    clean = make_estimates(t, cy_front=np.where(t > 8.0, 2.0, 50.0))
    other = make_estimates(t, cy_front=np.where(t > 8.0, 2.1, 90.0), cy_rear=0.98)
    monkeypatch.setattr(demo, "write_mf4", lambda *given: written.append(given))
    monkeypatch.setattr(demo.importlib.util, "find_spec", lambda name: name)
    written = []
    found = make_signals(guesses=(("a", ()),) * 5)
    found.to_dict = lambda: {"proposal": {"wheel_speed_rear": {"latency": 0.0305}}}
    replace(monkeypatch, "signals", found)
    replace(monkeypatch, "estimate", SimpleNamespace(table=other))
    demo.show_mf4(tmp_path, "log", clean)
    out = capsys.readouterr().out
    assert "finds 5 of 6 channels, and a delay of the wheel speeds relative to the gyro of 30 ms" in out
    assert "(true: 30 ms)" in out
    for key, change in (("cx_front", "+0.0"), ("cy_front", "+5.0"), ("cy_rear", "-2.0")):
        assert f"{tables.STIFFNESS_NAMES[key].lower()} {change} %" in out
    assert (tmp_path / "car.toml").read_text().startswith("steering_ratio = 15.3\n")
    assert written[0][0] == tmp_path / "drive.mf4" and written[0][2]["wheel_radius_rear"] == 0.33
    monkeypatch.setattr(demo.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(Error, match=r"asammdf: pip install 'tse\[mf4\]'"):
        demo.show_mf4(tmp_path, "log", clean)


def test_the_demo_goes_on_where_a_package_is_not_installed(tmp_path, monkeypatch):
    def skip(*_):
        raise Error("needs asammdf")

    done = []
    monkeypatch.setattr(demo, "show_estimate", lambda *given: done.append(given) or ("log", "table"))
    monkeypatch.setattr(demo, "show_mf4", skip)
    monkeypatch.setattr(demo, "show_gap", lambda out, seed, show: done.append((out, seed)))
    found = tselab_here("demo", "--out", "d", "--seed", 3, "--no-progress", cwd=tmp_path)
    assert found.code == 0 and "skipped: needs asammdf" in found.out
    assert done == [(Path("d"), 3, False), (Path("d/gap"), 3)]
