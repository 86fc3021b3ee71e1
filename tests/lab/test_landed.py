"""The default of an earlier commit, beside today's library in one process."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest

from tselab.core import OUTPUT, STIFFNESS, Config, Filter, library
from tselab.errors import UserError
from tselab.montecarlo import engine, estimators, landed, scores, studies
from tselab.montecarlo.case import Case, drive


@pytest.fixture(scope="module")
def earlier():
    found = shutil.which("git") and subprocess.run(
        ["git", "-C", landed.ROOT, "cat-file", "-e", f"{landed.LANDED}^{{commit}}"], capture_output=True
    )
    if not found or found.returncode:
        pytest.skip("the landed commit is not in this clone's history")
    return landed.library()


def test_two_libraries_keep_their_own_settings_and_layouts(earlier):
    assert earlier is landed.library() is not library()
    config = Config({"mass": 1500.0}, lib=earlier)
    assert config.lib is earlier and "marginalised" in config and config.changed() == {"mass": 1500.0}
    assert Config().lib is library()
    filter_ = Filter(config)
    assert filter_.lib is earlier and filter_.outputs(1).dtype == earlier.dtype(OUTPUT)
    assert len(filter_.snapshot()) == earlier.filter_bytes


def test_settings_that_came_later_are_ignored(earlier):
    config = landed.configure({"mass": 1500.0, "what_came_later": 3.0, "seed": 7})
    assert config.changed() == {"mass": 1500.0, "seed": 7}
    plan = engine.Plan(studies.study("fig2"), 1)
    about = {"initial_cx_front": 0.9, "seed": 7}
    config = engine.configure("landed", plan, about)
    start = {"initial_cy_front": 0.7, "initial_cy_rear": 0.7}
    assert config.changed() == about | start
    paper = engine.Plan(studies.study("fig2"), 1, form="paper")
    assert engine.configure("landed", paper, about).changed() == about | start  # it stays what it was


def test_the_landed_default_estimates_as_it_did(earlier):
    """RMS errors of 15 .. 30 s of this seed as `tselab montecarlo --study fig2` of that commit gave them."""
    plan = engine.Plan(studies.study("fig2"), 1)
    case: Case = plan.study.cases[0]
    d = drive(case, 1, lambda about: engine.configure("tse", plan, about), {})
    estimate = estimators.run("landed", d, engine.configure("landed", plan, d.about))
    row = scores.score(d, case, scores.knowable(d, case), estimate)
    rms = [np.sqrt(row[f"{key}_mean_square"]) for key in STIFFNESS]
    assert rms == pytest.approx([0.581, 0.833, 0.714], abs=0.001)
    assert row["diverged"] == 0


def test_a_clone_without_history_is_told_what_is_missing(monkeypatch, tmp_path):
    monkeypatch.setattr(landed, "ROOT", tmp_path)
    landed.library.cache_clear()
    with pytest.raises(UserError, match=r"'landed' is built from commit 10299f020407.*git fetch --unshallow"):
        landed.library()
    landed.library.cache_clear()
