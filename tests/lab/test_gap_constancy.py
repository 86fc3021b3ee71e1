"""A parameter that would have to change with speed is not one of the catalogue: cars whose steering ratio differs between a log at
20 m/s and one at 10 m/s, against cars with one ratio."""

from __future__ import annotations

import pytest

from gap_logs import car, write_log
from tselab.core import Config
from tselab.gap.catalogue import catalogue
from tselab.gap.constancy import variations
from tselab.gap.data import prepare
from tselab.gap.fit import fit
from tselab.gap.problem import STIFFNESS, Problem
from tselab.gap.workflow import run
from tselab.log import read_log
from tselab.vehicle import read_vehicle

DRIVES = {"sweep": 20.0, "steps": 10.0}  # m/s
ONE, TWO = {"sweep": 0.06, "steps": 0.06}, {"sweep": 0.08, "steps": -0.04}


def logs(folder, ratio):
    vehicle = car(folder)
    paths = [
        write_log(folder / f"{d}.csv", vehicle, d, {"steering_ratio_change": ratio[d]}, seed) for seed, d in enumerate(DRIVES, 41)
    ]
    return vehicle, paths


@pytest.mark.parametrize("ratio", [ONE, TWO])
def test_parameter_that_differs_between_speeds_is_seen_with_its_values(tmp_path, ratio):
    vehicle, paths = logs(tmp_path, ratio)
    config = Config(read_vehicle(vehicle).values)
    problem = Problem([prepare(read_log(p), config) for p in paths], config)
    effect = catalogue()["steering_ratio"]
    final = fit(problem, [*STIFFNESS, *effect.fitted], {})
    speed = next(v for v in variations(problem, final, [effect]) if v.condition == "speed")
    assert speed.contradicts == (ratio is TWO)
    if ratio is TWO:
        assert speed.at == pytest.approx((10.0, 20.0), abs=0.5)
        # a linearisation, around a stiffness that took up half of the change of 0.12: a sixth of that
        assert speed.values == pytest.approx((ratio["steps"], ratio["sweep"]), abs=0.02)
    else:
        assert abs(speed.relative) < 0.05


def test_ratio_that_depends_on_speed_gets_no_name(tmp_path):
    vehicle, paths = logs(tmp_path, TWO)
    result = run(paths, vehicle, tmp_path / "out")
    assert result.verdict == "not_in_catalogue" and result.exit_code == 20
    verdict = result.as_json()
    assert verdict["effects"] == [] and verdict["closest"][0]["id"] == "steering_ratio"
    assert any("steering_ratio_change would be" in w and "at speed" in w for w in result.words)
