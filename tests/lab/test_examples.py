"""The examples of scripts/examples run, and do what they say."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

import tse

EXAMPLES = Path(__file__).resolve().parents[2] / "scripts" / "examples"


def example(name, *arguments):
    done = subprocess.run([sys.executable, EXAMPLES / name, *map(str, arguments)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_stream_is_followed():
    out = example("stream.py")
    assert "row refused: steer_angle = 7 is outside its range -1.2 .. 1.2 rad" in out
    assert "late channels: {'steer_angle': 0.02} s" in out and "of 0.020 s before" in out
    (now, within), (first, _) = ((float(x), float(by)) for x, by in re.findall(r"cy_front (\d+) \+- (\d+)", out))
    assert abs(first - now) < within  # it was not valid: the next drive starts from the prior again


def test_a_filter_of_ones_own_runs_in_a_study_beside_tse(tmp_path):
    command = [sys.executable, "-m", "tselab", "montecarlo", "--study", "stress+own_filter.random_walk",
               "--cases", "nominal", "--runs", "2", "--jobs", "1",
               "--out", str(tmp_path / "out")]  # fmt: skip
    path = os.pathsep.join(filter(None, [str(EXAMPLES), os.environ.get("PYTHONPATH", "")]))
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env={**os.environ, "PYTHONPATH": path})
    assert done.returncode == 0, done.stderr
    runs = pd.read_csv(tmp_path / "out" / "runs.csv").set_index(["estimator", "seed"])
    assert set(runs.index.get_level_values(0)) == {"tse", "own_filter.random_walk"}
    errors = runs["cy_front_rms"] if "cy_front_rms" in runs else runs[[c for c in runs if c.startswith("cy_front")]].iloc[:, 0]
    assert errors.notna().all()
    assert "own_filter.random_walk" in done.stdout


@pytest.mark.parametrize(
    ("name", "text"),
    [("nowhere.kalman", "no estimator 'nowhere.kalman': No module named 'nowhere'; is the folder of nowhere.py in PYTHONPATH?"),
     ("tse.Nothing", "has no attribute 'Nothing'"), ("tse.STIFFNESS", "is not a function")],
)  # fmt: skip
def test_an_estimator_that_is_not_there_is_refused(name, text):
    from tselab.montecarlo.studies import study

    with pytest.raises(tse.Error) as error:
        study(f"stress+{name}")
    assert text in str(error.value)
