"""--json of every command that finds something: one document on standard output, and nothing else there."""

from __future__ import annotations

import json

import pytest

from conftest import tselab_here

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
    done = tselab_here("simulate", "--maneuver", "sine-sweep", "--duration", 20, "--out", "log.csv", cwd=folder)
    assert done.code == 0, done.err
    return folder


@pytest.mark.parametrize(
    ("command", "codes", "keys"),
    [
        (("vehicle", "car.toml"), {0}, {"name", "values", "filled"}),
        (("formula", "play.toml", "--c", "play.h"), {0}, {"place", "numbers", "settings", "written"}),
        (("simulate", "--maneuver", "straight", "--duration", 5, "--out", "s.csv"), {0}, {"rows", "seed", "written"}),
        (("signals", "log.csv"), {0, 3}, {"signals", "proposal"}),
        (
            ("estimate", "log.csv", "--vehicle", "car.toml", "--out", "e.csv"),
            {0, 3, 4},
            {"usable", "stretches", "written"},
        ),
        (("gap", "check", "log.csv", "--vehicle", "car.toml"), {0, 3, 4}, {"exit_code", "logs"}),
        (
            ("gap", "plan", "--separate", "steering_delay,steering_lag", "--vehicle", "car.toml"),
            {0},
            {"separable", "manoeuvres"},
        ),
        (("accuracy", "--runs", 2, "--jobs", 1), {0}, {"runs", "text"}),
        (
            ("montecarlo", "--study", "stress", "--cases", "nominal", "--runs", 1, "--jobs", 1, "--out", "study"),
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
    import click

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
