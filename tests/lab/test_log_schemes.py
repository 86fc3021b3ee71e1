"""`tselab signals` finds the right mapping in drawn naming schemes. Seeds below 1000 were looked at while it was made; those here
were not, and if one fails, nothing is tuned to it: other ones are taken, and the rate is said anew."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from log_schemes import draw, wrong
from tests.cars.logs import make_logs
from tse.impl.logs.propose import propose
from tse.impl.logs.readers.recording import Channel, Recording

FRESH = range(2000, 2020)
RIGHT = 19  # of 20
RADIUS, TRACK, RATIO = 0.31, 1.52, 14.8


@pytest.fixture(scope="module")
def clean():
    """Three minutes of a mountain road in a car that tse's model did not make."""
    return pd.DataFrame(make_logs("mountain", minutes=3, cars=1, seed=11)[0].log)


def test_the_right_mapping_in_19_of_20_fresh_schemes(clean):
    found = {}
    for seed in FRESH:
        scheme = draw(seed, clean, RADIUS, TRACK, RATIO)
        channels = {n: Channel(n, clean.time.to_numpy(), x, scheme.units[n]) for n, x in scheme.columns.items()}
        found[seed] = wrong(scheme, propose(Recording(Path("log"), "drawn", channels)), RADIUS)
    bad = {seed: w for seed, w in found.items() if w}
    assert len(FRESH) - len(bad) >= RIGHT, bad
