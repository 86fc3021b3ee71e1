"""The smallest sizes that a verdict says a log could have shown: hidden at half and at twice that size. Seeded."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import pytest

from gap_logs import car, write_log
from tselab.gap import workflow
from tselab.gap.catalogue import catalogue
from tselab.gap.export.output import finite
from tselab.gap.infer.hypotheses import NAME_AT
from tselab.gap.infer.naming import Named, name
from tselab.gap.problem import Problem
from tselab.gap.selftest import make
from tselab.gap.workers import Workers
from tselab.rows import Log
from tselab.vehicle import read_vehicle

STEPS = "steering steps to 3 m/s2, at 20 m/s"
LOG_SEED, HIDE_SEED = 11, 1


@dataclass
class Clean:
    """A log of a car that lacks nothing, and what its verdict says that it could not have shown."""

    folder: Path
    vehicle: Path
    problem: Problem
    read: list[Log]
    undetectable: dict[str, dict]

    def named_when_hidden(self, effect: str, times: float) -> list[Named]:
        told = self.undetectable[effect]
        size = {told["parameter"]: times * told["smallest_detectable"]}
        read, config = workflow.read(
            make(self.problem, self.read, size, self.folder, HIDE_SEED), read_vehicle(self.vehicle)
        )
        workers = Workers()
        return name(workers.problem(workers.prepare(read, config), config), list(catalogue().values())).named


@pytest.fixture(scope="module")
def clean(tmp_path_factory) -> Clean:
    folder = tmp_path_factory.mktemp("detect")
    vehicle = car(folder)
    log = write_log(folder / "steps.csv", vehicle, STEPS, {}, LOG_SEED, seconds=12.0)
    result = workflow.run([log], vehicle, folder / "out")
    assert result.verdict == "none"
    told = json.loads(json.dumps(finite(result.as_json()), allow_nan=False))["undetectable"]
    read, _ = workflow.read([log], read_vehicle(vehicle))
    return Clean(folder, vehicle, result.problem, read, {d["id"]: d for d in told})


@pytest.mark.parametrize("effect", ["steering_ratio", "lateral_load_transfer"])
def test_twice_the_smallest_size_is_named_and_half_of_it_is_not(clean, effect):
    """Nats go with the square of the size: 4 and 1/4 of what a name needs. With a quarter, a class of look-alikes may be above 90 %
    in one noise of ten, as in this one; none of them is by itself."""
    told = clean.undetectable[effect]
    assert told["smallest_detectable"] > told["typical"]
    half = clean.named_when_hidden(effect, 0.5)
    assert all(n.look_alikes and n.probability < NAME_AT and n.effect.id != effect for n in half)
    named = clean.named_when_hidden(effect, 2.0)
    assert [n.effect.id for n in named] == [effect]
    assert named[0].values[told["parameter"]] == pytest.approx(2 * told["smallest_detectable"], rel=0.2)


def test_no_size_is_told_that_the_model_does_not_take(clean):
    """A slope over zero says of the longitudinal relaxation 6.6 m; the limit is 2 m."""
    assert clean.undetectable["longitudinal_relaxation"]["smallest_detectable"] is None
    for e, told in clean.undetectable.items():
        p = next(p for p in catalogue()[e].parameters if p.name == told["parameter"])
        assert told["smallest_detectable"] is None or told["smallest_detectable"] <= max(p.high, -p.low), e
