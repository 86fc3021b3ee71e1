"""The rules that stand between a good fit and a name, each on the smallest case that it is there for."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tselab.gap import name, workflow
from tselab.gap.catalogue import catalogue
from tselab.gap.constancy import Variation
from tselab.gap.fit import Fit
from tselab.gap.show import Change

TYPICAL = ("steering_ratio", "body_roll", "relaxation", "steering_offset")


def named(effect: str, times: float) -> name.Named:
    """An effect of so many times the upper end of its typical range."""
    e = catalogue()[effect]
    return name.Named(e, {p.name: times * p.typical_high for p in e.strengths}, {}, 0.3, 100.0)


def test_four_effects_of_which_one_is_implausible_are_a_patchwork():
    assert not workflow._cancels([named(i, 1.0) for i in TYPICAL])
    assert workflow._cancels([*(named(i, 1.0) for i in TYPICAL[:3]), named("steering_offset", 2.1)])
    assert not workflow._cancels([*(named(i, 1.0) for i in TYPICAL[:2]), named("steering_offset", 2.1)])  # three may
    assert not workflow._cancels([*(named(i, 1.0) for i in TYPICAL[:3]), named("bank", 5.0)])  # a road may be steep


def change(before: float, after: float) -> dict[str, Change]:
    return {"accel_y": Change(before, after, after / before - 1.0, (-0.9, -0.1)), "yaw_rate": Change(1.0, 1.0, 0.0, (0.0, 0.0))}


@pytest.mark.parametrize(("before", "after", "fits_only"), [
    (5.0, 1.5, False),  # closes 95 % of 24
    (5.0, 3.0, True),  # closes 67 %
    (1.5, 1.25, False),  # closes 55 % of next to nothing: what is left is near the noise
])  # fmt: skip
def test_held_out_logs_refuse_what_only_fits(before, after, fits_only):
    assert workflow._only_fits(change(before, after)) == fits_only
    assert not workflow._only_fits({})  # none were held out


@pytest.mark.parametrize(("road", "car", "first"), [
    (100.0, 96.0, "rolling_resistance"), (100.0, 90.0, "grade"), (0.0, 0.0, "grade"),
])  # fmt: skip
def test_road_comes_after_an_effect_of_the_car_that_closes_as_much(road, car, first):
    n = 2000  # blocks of one channel, 100 more than the noise in energy at the start
    problem = SimpleNamespace(rows=SimpleNamespace(channel=np.zeros(n, int)), weight=np.ones(n), noise_energy=np.ones(n))

    def left(closes: float) -> Fit:
        return Fit([], {}, np.full(n, np.sqrt(1.0 + (100.0 - closes) / n)), np.zeros((n, 0)))

    tried = [(50.0, catalogue()["grade"], left(road)), (40.0, catalogue()["rolling_resistance"], left(car))]
    assert name._road_last(problem, left(0.0), tried)[0][1].id == first


def test_refusals_by_size_sign_and_limit():
    e = catalogue()["body_roll"]
    gain, *shapes = e.fitted
    problem = SimpleNamespace()

    def why(value: float) -> str | None:
        values = {gain.name: value} | {p.name: p.default for p in shapes}
        return name._refuse(problem, e, Fit(list(e.fitted), values, np.zeros(1), np.zeros((1, len(e.fitted)))), 100.0, 8.0, 0.5)

    assert why(gain.scale) is None
    assert why(0.5 * gain.negligible) == name.NEGLIGIBLE
    assert "wrong sign" in why(-gain.scale)
    assert "limit" in why(gain.high)


def variation(**other: float) -> Variation:
    numbers = {"relative": -0.5, "sigmas": -20.0, "closes": 0.9} | other
    return Variation("steering_ratio", "steering_ratio_change", "speed", at=(10.0, 30.0), values=(0.1, 0.02), **numbers)


def test_variation_contradicts_only_what_it_would_repair():
    assert variation().contradicts
    assert not variation(relative=-0.2).contradicts
    assert not variation(sigmas=-4.0).contradicts
    assert not variation(closes=0.3).contradicts
    assert "0.1 at speed 10 m/s and 0.02 at 30 m/s" in variation().words()
