"""The command itself: help, versions, lists, demo, study, internal errors.

The simulator from the shell: formats, and properties of the truth computed by hand.
"""

import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pandas as pd
import pytest

from conftest import tselab, tselab_here
from tse import tables
from tse.channels.log import read_log
from tse.library.core import Config
from tse.simulation.maneuvers import MANEUVERS
from tselab import cli


def test_version_names_package_and_library():
    done = tselab("--version")
    assert done.code == 0 and done.out.startswith("tselab 0.") and "particles" in done.out


def test_the_installed_command_is_the_package():
    command = shutil.which("tselab", path=str(Path(sys.executable).parent))
    if command is None:
        pytest.skip("tselab is not installed beside this python")

    assert (
        subprocess.run([command, "--version"], capture_output=True, text=True, timeout=60).stdout
        == tselab("--version").out
    )


@pytest.mark.parametrize("command", ["estimate", "simulate", "vehicle", "settings", "demo", "montecarlo"])
def test_help_teaches(command):
    done = tselab(command, "--help")
    assert done.code == 0 and "Usage: tselab " + command in done.out.replace("python -m ", "")
    if command == "estimate":
        assert "wheel_speed_front  rad/s  -400 .. 400" in done.out and "cx_front_spread" in done.out
    if command == "simulate":
        assert "double-lane-change" in done.out and "true_bias_yaw_rate" in done.out


def test_wrong_usage_exits_with_2_and_says_what_is_missing():
    done = tselab("estimate")
    assert done.code == 2 and "Missing argument 'LOG'" in done.err
    done = tselab("estimat", "x.csv")
    assert done.code == 2 and "No such command" in done.err


def test_settings_lists_every_setting():
    lines = tselab("settings").out.splitlines()
    names = [line.split()[0] for line in lines[1:] if line[0] != " "]  # long texts go on in the next line
    assert names == list(Config.exact().fields)


def test_internal_error_is_one_paragraph_and_exit_1(monkeypatch, capsys):
    monkeypatch.setattr(tables, "settings_table", lambda *_: 1 / 0)
    for argv, traceback in ((["tselab", "settings"], False), (["tselab", "--debug", "settings"], True)):
        monkeypatch.setattr(sys, "argv", argv)
        with pytest.raises(SystemExit) as stop:
            cli.main()
        assert stop.value.code == 1
        assert ("Traceback" in capsys.readouterr().err) == traceback


def test_a_terminal_without_the_letters_of_a_name_gets_their_numbers(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "cp1252")
    keys = {"mass": 1900, "lf": 1.25, "lr": 1.5, "wheel_radius_front": 0.33, "wheel_radius_rear": 0.33}
    text = "\n".join(['name = "\u4e1c\u98ce"', *(f"{k} = {v}" for k, v in keys.items())])
    (tmp_path / "car.toml").write_text(text, encoding="utf-8")
    done = tselab("vehicle", "car.toml", cwd=tmp_path)
    assert done.code == 0 and done.out.startswith(r"car.toml: \u4e1c\u98ce"), done.err


@pytest.mark.slow
def test_demo_leaves_everything_and_finds_the_stiffness(tmp_path):
    done = tselab("demo", "--out", "demo", cwd=tmp_path)
    assert done.code == 0, done.err
    drive, _, hidden = done.out.partition("\n\n")
    assert len(drive.splitlines()) == 5
    assert "hidden effect (body_roll" in hidden and "(body_roll): gain 0.009" in hidden
    verdict = json.loads((tmp_path / "demo" / "gap" / "verdict.json").read_text())
    assert [e["id"] for e in verdict["effects"]] == ["body_roll"]
    # 5 %: the scatter of a stiffness that is redrawn at every sample. In held-out logs
    # this scatter is noise above the sensors'.
    assert verdict["effects"][0]["parameters"]["gain"]["value"] == pytest.approx(0.009, rel=0.05)
    assert (
        verdict["gap"]["held_out"]["after"]["accel_y"]
        < 1.15
        < 3
        < verdict["gap"]["held_out"]["before"]["accel_y"]
    )
    names = {p.name for p in (tmp_path / "demo").iterdir()}
    assert {"vehicle.toml", "filter.toml", "log.csv", "truth.csv", "est.csv", "report.html"} <= names
    est, truth = pd.read_csv(tmp_path / "demo" / "est.csv"), pd.read_csv(tmp_path / "demo" / "truth.csv")
    before = est["time"].between(25, 36)
    for key, limit in (("cx_front", 0.08), ("cy_front", 0.04), ("cy_rear", 0.04)):
        assert abs(est[key][before].mean() / truth[f"true_{key}"][before].mean() - 1) < limit
    if importlib.util.find_spec("asammdf") is None:
        assert "skipped: the demo of an MF4" in done.out
    else:  # from other names, units, rates and latencies the same comes out
        assert "tselab signals finds 6 of 6 channels" in done.out
        logged = pd.read_csv(tmp_path / "demo" / "logger" / "est.csv").iloc[-1000:]
        for key in ("cx_front", "cy_front", "cy_rear"):
            assert logged[key].mean() == pytest.approx(est[key].iloc[-1000:].mean(), rel=0.02)
    again = tselab(
        "estimate",
        "log.csv",
        "--vehicle",
        "vehicle.toml",
        "--config",
        "filter.toml",
        "--out",
        "again.csv",
        cwd=tmp_path / "demo",
    )
    assert again.code == 0
    assert (tmp_path / "demo" / "again.csv").read_bytes() == (tmp_path / "demo" / "est.csv").read_bytes()


# ---- --json of every command with a result: one document on standard output, and nothing
# else.


FORMULA = """id = "play"
title = "play in the steering"
place = "front_angle"
formula = "play(steer_angle, w) - steer_angle"
[numbers.w]
value = 0.003
unit = "rad"
"""
WITHOUT = {  # what has none, and why
    "demo": "pictures and pages for people",
    "fmu parameters": "what it has to say is the file",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("json")
    (folder / "car.toml").write_text(tselab_here("vehicle", "--simulated").out)
    (folder / "play.toml").write_text(FORMULA)
    done = tselab_here(
        "simulate", "--maneuver", "sine-sweep", "--duration", 20, "--out", "log.csv", cwd=folder
    )
    assert done.code == 0, done.err
    return folder


@pytest.mark.parametrize(
    ("command", "codes", "keys"),
    [
        (("vehicle", "car.toml", "--c", "car.h"), {0}, {"name", "values", "filled", "written"}),
        (("formula", "play.toml", "--c", "play.h"), {0}, {"place", "numbers", "settings", "written"}),
        (
            ("simulate", "--maneuver", "straight", "--duration", 5, "--out", "s.csv"),
            {0},
            {"rows", "seed", "written"},
        ),
        (("signals", "log.csv"), {0, 3}, {"signals", "proposal"}),
        (
            ("estimate", "log.csv", "--vehicle", "car.toml", "--out", "e.csv"),
            {0, 3, 4},
            {"usable", "stretches", "written"},
        ),
        (("gap", "check", "log.csv", "--vehicle", "car.toml"), {0, 3, 4}, {"exit_code", "logs"}),
        (("gap", "catalogue"), {0}, {"effects"}),
        (
            ("replay", "log.csv", "--vehicle", "car.toml", "--out", "r.csv", "--report", "r.html"),
            {0},
            {"apart", "written"},
        ),
        pytest.param(
            ("gap", "plan", "--separate", "steering_delay,steering_lag", "--vehicle", "car.toml"),
            {0},
            {"separable", "manoeuvres"},
            marks=pytest.mark.slow,
        ),
        (
            (
                "montecarlo",
                "--study",
                "stress",
                "--cases",
                "nominal",
                "--runs",
                1,
                "--jobs",
                1,
                "--out",
                "study",
            ),
            {0},
            {"study", "written"},
        ),
    ],
    ids=lambda x: " ".join(map(str, x[:2])) if isinstance(x, tuple) else "",
)
def test_a_document_and_nothing_else(command, codes, keys, folder):
    done = tselab_here(*command, "--json", cwd=folder)
    assert done.code in codes, done.err
    assert keys <= set(json.loads(done.out))


def test_settings_are_a_list(folder):
    for more in ((), ("--simulator",)):
        rows = json.loads(tselab_here("settings", *more, "--json", cwd=folder).out)
        assert {"name", "default", "low", "high", "unit", "text"} == set(rows[0]) and len(rows) > 20


def test_every_command_has_it_or_a_reason():
    from tselab.cli import cli

    def commands(group, path=()):
        for name in group.list_commands(click.Context(group)):
            command = group.get_command(click.Context(group), name)
            if isinstance(command, click.Group):
                yield from commands(command, (*path, name))
            else:
                yield " ".join((*path, name)), command

    without = {n for n, c in commands(cli) if not any("--json" in o for p in c.params for o in p.opts)}
    assert without == set(WITHOUT)


def test_a_command_of_gap_that_is_misspelt_is_no_log(folder):
    for word, meant in (("chek", "check"), ("discovr", "discover")):
        done = tselab_here("gap", word, "log.csv", "--vehicle", "car.toml", cwd=folder)
        assert done.code == 2 and f"did you mean 'tselab gap {meant}'?" in done.err
    done = tselab_here("gap", "nothing.csv", "--vehicle", "car.toml", "--out", "found", cwd=folder)
    assert done.code == 2 and "nothing.csv: no such file" in done.err and not (folder / "found").exists()


LOG = ["time", "steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate"]


def simulate(folder, *options, run=tselab_here):
    done = run("simulate", "--out", folder / "log.csv", "--truth", folder / "truth.csv", *options)
    assert done.code == 0, done.err
    return pd.read_csv(folder / "log.csv"), pd.read_csv(folder / "truth.csv")


@pytest.mark.parametrize("name", MANEUVERS)
def test_every_manoeuvre_gives_a_log_that_estimate_reads(name, tmp_path):
    log, truth = simulate(tmp_path, "--maneuver", name, "--duration", 12)
    assert list(log) == LOG
    assert len(log) == len(truth) == 1201
    assert np.isfinite(truth.to_numpy()).all()
    assert truth["true_vel_x"].between(-0.05, 40).all()
    assert len(read_log(tmp_path / "log.csv")) == 1201


@pytest.mark.slow
def test_same_seed_same_bytes_other_seed_other_bytes(tmp_path):
    contents = []
    for i, seed in enumerate((7, 7, 8)):
        (tmp_path / str(i)).mkdir()
        simulate(tmp_path / str(i), "--maneuver", "straight", "--duration", 3, "--seed", seed, run=tselab)
        contents.append((tmp_path / str(i) / "log.csv").read_bytes())
    assert contents[0] == contents[1] != contents[2]


def test_step_steer_reaches_the_yaw_rate_of_the_textbook(tmp_path):
    _, truth = simulate(
        tmp_path, "--maneuver", "step-steer", "--spread", 0, "--noise", 0, "--amplitude", 0.01
    )
    end = truth.iloc[-100:].mean()
    mass, lf, lr, cf, cr = 1900.0, 1.25, 1.5, 1.2e5, 1.4e5
    understeer = mass / (lf + lr) * (lr / cf - lf / cr)  # rad s2/m
    v = end["true_vel_x"]
    assert end["true_yaw_rate"] == pytest.approx(v * 0.01 / (lf + lr + understeer * v**2), rel=0.003)
    assert end["true_accel_y"] == pytest.approx(v * end["true_yaw_rate"], rel=0.003)
    assert v == pytest.approx(20, abs=0.3)


def test_drive_torque_accelerates_mass_and_wheels(tmp_path):
    _, truth = simulate(
        tmp_path,
        "--maneuver",
        "square-waves",
        "--amplitude",
        0,
        "--spread",
        0,
        "--noise",
        0,
        "--duration",
        2.4,
    )
    a = np.polyfit(truth["time"][50:], truth["true_vel_x"][50:], 1)[0]
    assert a == pytest.approx(700 / 0.33 / (1900 + (2.4 + 2.4) / 0.33**2), rel=0.005)


def test_constant_radius_holds_its_radius(tmp_path):
    _, truth = simulate(
        tmp_path, "--maneuver", "constant-radius", "--spread", 0, "--noise", 0, "--amplitude", 80
    )
    later = truth[truth["time"] > 10]
    radius = np.hypot(later["true_vel_x"], later["true_vel_y"]) / later["true_yaw_rate"]
    assert radius.mean() == pytest.approx(80, rel=0.02)
    assert later["true_vel_x"].iloc[-1] == pytest.approx(np.sqrt(4 * 80), rel=0.02)


def test_stop_and_go_stands_still_and_goes_again(tmp_path):
    _, truth = simulate(tmp_path, "--maneuver", "stop-and-go", "--duration", 30)
    speed = truth.set_index("time")["true_vel_x"]
    assert speed.loc[16.5:19.5].abs().max() < 0.02
    assert speed.loc[9] == pytest.approx(12, abs=0.5)
    assert speed.loc[28] == pytest.approx(12, abs=0.5)


def test_road_change_changes_the_truth_from_its_time_on(tmp_path):
    _, truth = simulate(
        tmp_path,
        "--maneuver",
        "straight",
        "--duration",
        6,
        "--road-change",
        "2:0.7",
        "--road-change",
        "4:0.4",
    )
    level = truth["true_cy_front"] / 1.2e5
    assert level[truth["time"] < 1.99].to_numpy() == pytest.approx(1.0)
    assert level[truth["time"].between(2.02, 3.98)].to_numpy() == pytest.approx(0.7)
    assert level[truth["time"] > 4.02].to_numpy() == pytest.approx(0.4)
