"""Priors of hypotheses, names of effects, and names of roads and formulas against
numbers by hand.
"""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from gap_logs import make_groups, make_parameter, make_prepared
from tse.gaps.catalogue import Effect, Own, load_catalogue
from tse.gaps.fit import Fit
from tse.gaps.infer import hypotheses, naming, rivals, roads
from tse.gaps.infer.hypotheses import Hypothesis, fit_prior, make_hypotheses
from tse.gaps.infer.naming import Named, Naming, Probability
from tse.gaps.problem import STIFFNESS_PARAMETERS, Problem
from tse.identify.knots import Knots
from tse.library.core import Config

KNOWN = load_catalogue()


def make_effect(*parameters, id="mine", occurrence="SENSOR", relatives=()) -> Effect:
    return Effect(id, "a title", "accel_y", relatives, parameters, occurrence)


# ---- hypotheses


WIDTH = np.log(3.0) + np.sqrt(np.pi / 2) * (0.7 + 0.35)  # of 0.1 .. 0.3 with its tails


@pytest.mark.parametrize(
    ("parameter", "away", "density"),
    [
        ({}, 0.1, 0.5 / (0.1 * WIDTH)),
        ({}, -0.2, 0.5 / (0.2 * WIDTH)),
        ({}, 0.3, 0.5 / (0.3 * WIDTH)),
        ({}, 0.05, 0.5 / (0.05 * WIDTH) * np.exp(-0.5 * (np.log(2) / 0.7) ** 2)),
        ({}, 0.6, 0.5 / (0.6 * WIDTH) * np.exp(-0.5 * (np.log(2) / 0.35) ** 2)),
        ({"sign": 1}, 0.2, 0.99 / (0.2 * WIDTH)),
        ({"sign": 1}, -0.2, 0.01 / (0.2 * WIDTH)),
        ({"sign": -1}, -0.2, 0.99 / (0.2 * WIDTH)),
        ({"default": 0.5, "typical": (0.6, 0.8)}, 0.2, 0.5 / (0.2 * WIDTH)),
        ({"typical": (-0.3, -0.1)}, 0.2, 0.5 / (0.2 * WIDTH)),
        (
            {"typical": (0.3, 0.3)},
            0.15,
            0.5 / (0.15 * np.sqrt(np.pi / 2) * (0.15 + 0.35)) * np.exp(-0.5 * (np.log(2) / 0.15) ** 2),
        ),
        ({"typical": (0.0, 0.4)}, 0.1, 0.5 / (0.1 * (np.log(4.0) + np.sqrt(np.pi / 2) * 1.05))),
    ],
)
def test_the_prior_of_a_size_is_flat_in_its_logarithm_with_normal_tails(parameter, away, density):
    p = make_parameter(**parameter)
    assert hypotheses.compute_ln_size_prior(p, away) == pytest.approx(np.log(density))


def test_of_several_strengths_the_one_that_is_large_for_its_kind_has_the_prior_of_a_size():
    small, large = make_parameter("a", (0.1, 0.3)), make_parameter("b", (1.0, 3.0))
    h = Hypothesis(make_effect(small, large), 0.0)
    size = np.log(0.5 / (0.2 * WIDTH))  # a is typical, b half of it
    found = h.compute_ln_prior({"a": 0.2, "b": -1.0})
    assert found == pytest.approx(size + norm.logpdf(-1.0, 0.0, 2.0) - np.log(2))
    size = np.log(0.5 / (2.0 * WIDTH))
    found = h.compute_ln_prior({"a": 0.1, "b": -2.0})
    assert found == pytest.approx(size + norm.logpdf(0.1, 0.0, 0.2) - np.log(2))
    stated = Hypothesis(make_effect(replace(small, default=0.1, prior=0.05), large), 0.0)
    found = stated.compute_ln_prior({"a": 0.2, "b": -1.0})
    assert found == pytest.approx(norm.logpdf(0.2, 0.1, 0.05) + norm.logpdf(-1.0, 0.0, 6.0))


@pytest.mark.parametrize(
    ("parameter", "mean", "sd", "start"),
    [
        ({}, 0.0, 0.6, 0.06),
        ({"sign": -1, "typical": (-0.3, -0.1)}, 0.0, 0.6, -0.06),
        ({"default": 0.5, "typical": (0.6, 0.8)}, 0.5, 1.4, 0.71),
        ({"limits": (-1.0, 0.04)}, 0.0, 0.6, 0.04),
        ({"default": 0.1, "prior": 0.02}, 0.1, 0.02, 0.16),
        ({"strength": False}, 0.2, 0.1, 0.2),
        ({"strength": False, "typical": (-0.1, 0.3)}, 0.1, 0.2, 0.1),
        ({"strength": False, "typical": (0.3, 0.3)}, 0.3, 0.002, 0.3),
    ],
)
def test_the_prior_of_a_fit_and_its_start(parameter, mean, sd, start):
    p = make_parameter(**parameter)
    assert fit_prior(p) == pytest.approx((mean, sd))
    assert hypotheses.choose_start(p) == pytest.approx(start)


def test_a_normal_density():
    assert hypotheses.compute_ln_normal(1.3, 1.0, 0.2) == pytest.approx(norm.logpdf(1.3, 1.0, 0.2))


def test_a_stated_sd_is_about_the_value_of_the_file_and_not_about_the_default():
    """A steering ratio 3 % off with an sd of 2 %, and an exact gyro."""
    vehicle = SimpleNamespace(
        values={
            "steering_ratio_change": 0.03,
            "steer_ratio_sd": 0.02,
            "gyro_scale_sd": 0.0,
            "gyro_scale_error": 0.01,
            "mass_sd": 0.05,  # of the class, not of the file
            "roll_steer_sd": 0.04,
        },
        given_uncertainty={"steer_ratio_sd", "gyro_scale_sd", "roll_steer_sd"},
    )
    found = {p.name: p for e in hypotheses.apply_priors(vehicle) for p in e.parameters}
    ratio, gyro = found["steering_ratio_change"], found["gyro_scale_error"]
    assert (ratio.default, ratio.prior) == (0.03, 0.02)
    assert (gyro.default, gyro.prior) == (0.01, pytest.approx(0.01 * 0.02))  # a percent of what is typical
    roll = found["rear_roll_steer_gain"]
    assert (roll.default, roll.prior) == (0.0, 0.04)
    stated = {"steering_ratio_change", "gyro_scale_error", "rear_roll_steer_gain"}
    unstated = {p.name: p for e in KNOWN.values() for p in e.parameters if p.name not in stated}
    assert {k: p for k, p in found.items() if k not in stated} == unstated
    vehicle.given_uncertainty = {"gyro_scale_sd"}  # 0, as of a simulated car
    assert hypotheses.apply_priors(vehicle) == list(KNOWN.values())


def test_each_kind_of_effect_has_its_prior_odds():
    found = {h.id: h for h in make_hypotheses()}
    some = [e.id for e in KNOWN.values() if e.occurrence == "SOME_CARS"]
    share = 1.0 / len(some)
    for ids, p in ((("gyro_scale",), 0.1), (("body_roll",), 0.15), (some, share)):
        for i in ids:
            assert found[i].odds == pytest.approx(np.log(p / (1 - p))), i
    left_out = {"bank", "grade", "steering_compliance", "aero_drag", "rolling_resistance", "aligning_moment"}
    assert left_out.isdisjoint(found) and left_out < set(KNOWN)
    beside = ["wheel_speed_latency", "accel_x_latency", "accel_y_latency", "superelevation"]
    assert list(found) == [i for i in KNOWN if i not in left_out] + beside
    assert all(found[i].odds == pytest.approx(np.log(0.1 / 0.9)) for i in beside)
    (alone,) = [h for h in make_hypotheses([KNOWN["mass"]]) if h.id == "mass"]
    assert alone.odds == pytest.approx(0.0)  # one of two, as if there were another


def test_delays_and_latencies_have_either_sign():
    found = {h.id: h.effect for h in make_hypotheses()}
    for i in ("imu_delay", "steering_delay"):
        (p,) = found[i].parameters
        assert (p.low, p.high, p.sign) == (-0.1, 0.1, 0)
    assert found["steering_lag"].parameters == KNOWN["steering_lag"].parameters
    for i, channel in (("wheel_speed", "accel_x"), ("accel_x", "accel_x"), ("accel_y", "accel_y")):
        e = found[f"{i}_latency"]
        (p,) = e.strengths
        assert (e.channels, p.name, p.unit, p.sign) == (channel, f"{i}_latency", "s", 0)
        assert (p.low, p.high, p.default, p.negligible) == (-0.1, 0.1, 0.0, 0.003)
        assert (p.typical_low, p.typical_high) == (0.003, 0.02)
    lean = found["superelevation"]
    assert [p.name for p in lean.parameters] == ["bank_superelevation"]
    assert lean.relatives == ("imu_scale_ay", "body_roll")


@pytest.mark.parametrize(("effects", "odds"), [(1, 1.0), (2, 1.0), (10, 9.0)])
def test_an_effect_must_outweigh_its_prior_odds_its_size_and_reach_90_percent(effects, odds):
    assert hypotheses.compute_threshold(effects) == pytest.approx(np.log(odds) + np.log(9.0) + 3.0)


# ---- named effects


def name_lever(x: float, y: float, half: float = 0.1, **more) -> Named:
    values = {"imu_lever_arm_x": x, "imu_lever_arm_y": y}
    ends = {k: (v - half, v + half) for k, v in values.items()}
    return Named(KNOWN["imu_lever_arm"], values, ends, more.pop("share", 0.5), 40.0, **more)


def test_a_name_with_the_values_of_another_fit_keeps_the_widths_of_its_intervals():
    found = name_lever(0.5, 0.2).at({"imu_lever_arm_x": 0.8, "mass_change": 0.1})
    assert found.values == pytest.approx({"imu_lever_arm_x": 0.8, "imu_lever_arm_y": 0.2})
    assert found.ci95["imu_lever_arm_x"] == pytest.approx((0.7, 0.9))
    assert found.ci95["imu_lever_arm_y"] == pytest.approx((0.1, 0.3))


@pytest.mark.parametrize(
    ("x", "y", "nothing"), [(0.05, -0.1, True), (0.5, 0.0, False), (0.0, -0.2, False), (0.3, 0.3, False)]
)
def test_a_name_is_empty_if_no_interval_excludes_the_default(x, y, nothing):
    assert name_lever(x, y).holds_nothing is nothing


def test_the_shape_of_an_effect_does_not_make_its_name_empty():
    roll = Named(
        KNOWN["body_roll"], {}, {"body_roll_gain": (-0.01, 0.01), "body_roll_height": (0.2, 0.4)}, 0, 0
    )
    assert roll.holds_nothing
    moved = make_effect(make_parameter("share", default=1.0))
    assert Named(moved, {}, {"share": (0.9, 1.1)}, 0, 0).holds_nothing
    assert not Named(moved, {}, {"share": (-0.1, 0.1)}, 0, 0).holds_nothing


@pytest.mark.parametrize(
    ("effect", "key", "value", "message"),
    [
        ("steering_delay", "steering_delay_time", -0.01, True),
        ("steering_delay", "steering_delay_time", 0.01, False),
        ("imu_delay", "imu_delay_time", 0.0, False),
        ("steering_lag", "steering_lag_time", 0.019, True),
        ("steering_lag", "steering_lag_time", 0.02, False),
        ("mass", "mass_change", -0.1, False),
        ("accel_y_latency", "accel_y_latency", 0.01, True),
        ("superelevation", "bank_superelevation", 0.1, False),
    ],
)
def test_only_what_a_car_cannot_cause_is_of_the_messages(effect, key, value, message):
    e = next(h.effect for h in make_hypotheses() if h.id == effect)
    found = Named(e, {key: value}, {key: (value - 0.001, value + 0.001)}, 0.5, 40.0)
    assert found.message is message
    assert found.title == (e.early if message and e.early else e.title)


def make_naming(named: list[Named], closed: float) -> Naming:
    nothing = Fit([], {}, np.zeros(0), np.zeros((0, 0)))
    return Naming(nothing, nothing, named, closed, [], [], True)


def name_share(effect: str, share: float) -> Named:
    e = next(
        h.effect for h in (*make_hypotheses(), *(Hypothesis(KNOWN[i], 0) for i in KNOWN)) if h.id == effect
    )
    return Named(e, {}, {}, share, 40.0)


@pytest.mark.parametrize(
    ("shares", "closed", "most"),
    [
        ({"mass": 0.6}, 0.6, True),
        ({"mass": 0.5}, 0.5, False),
        ({"bank": 0.6}, 0.6, False),
        ({"grade": 0.6, "mass": 0.3}, 0.9, True),  # 0.3 of 0.4
        ({"superelevation": 0.6, "mass": 0.15}, 0.75, False),  # 0.15 of 0.4
        ({}, 0.0, False),
    ],
)
def test_roads_do_not_count_where_names_close_most_of_the_gap(shares, closed, most):
    named = [name_share(i, s) for i, s in shares.items()]
    assert make_naming(named, closed).closes_most is most


@pytest.mark.parametrize(
    ("x", "y", "small"),
    [(0.04, -0.04, True), (1.0, 0.0, False), (0.0, -1.0, False), (0.0, 0.0, True), (0.0, 0.05001, False)],
)
def test_an_effect_is_negligible_only_if_each_of_its_sizes_is(x, y, small):
    assert naming.is_negligible(KNOWN["imu_lever_arm"], {"imu_lever_arm_x": x, "imu_lever_arm_y": y}) is small
    moved = make_effect(make_parameter(default=1.0))
    assert naming.is_negligible(moved, {"x": 1.005}) and not naming.is_negligible(moved, {"x": 0.0})


@pytest.mark.parametrize(
    ("x", "y", "within"), [(0.19, -0.19, True), (0.2, 0.0, False), (0.0, -0.2, False), (-0.2, 0.2, False)]
)
def test_an_effect_may_be_absent_only_if_each_of_its_intervals_has_the_default(x, y, within):
    h = Hypothesis(KNOWN["imu_lever_arm"], 0.0)
    sd = dict.fromkeys(("imu_lever_arm_x", "imu_lever_arm_y"), 0.1)
    assert naming.includes_defaults(h, {"imu_lever_arm_x": x, "imu_lever_arm_y": y}, sd) is within


def make_set(evidence: float = 0.0, sd: float = 0.01, **values) -> SimpleNamespace:
    """Return a judged set of the effects whose strengths are given."""
    effects = tuple(h for h in make_hypotheses() if any(p.name in values for p in h.effect.strengths))
    whole = dict.fromkeys((p.name for p in STIFFNESS_PARAMETERS), 1.0) | values
    return SimpleNamespace(
        effects=effects,
        ids=frozenset(h.id for h in effects),
        values=whole,
        evidence=evidence,
        compute_sd=lambda: dict.fromkeys(whole, sd),
    )


def test_one_size_that_matters_makes_an_effect_relevant():
    one = make_set(sd=0.05, imu_lever_arm_x=0.08, imu_lever_arm_y=0.02)
    (h,) = one.effects
    x, y = (norm.cdf(0.05, m, 0.05) - norm.cdf(-0.05, m, 0.05) for m in (0.08, 0.02))
    assert naming.compute_relevance(one, h) == pytest.approx(1.0 - x * y)


def make_search(*sets: tuple[float, SimpleNamespace]) -> SimpleNamespace:
    known = {s.ids: s for _, s in sets}
    probability = {s.ids: p for p, s in sets}
    return SimpleNamespace(compute_probabilities=lambda: probability, list_judged=lambda: known)


def test_the_probability_of_an_effect_is_that_of_its_sets_as_far_as_it_is_relevant():
    half = make_set(sd=1e-6, mass_change=0.03)  # on the edge of what matters
    both = make_set(sd=1e-6, mass_change=0.1, gyro_scale_error=0.001)
    found = Probability(make_search((0.5, half), (0.3, both), (0.2, make_set())), both.ids)
    assert found.effects == pytest.approx({"mass": 0.25 + 0.3, "gyro_scale": 0.0}, abs=1e-9)
    assert found.of_class("yaw_inertia") == pytest.approx(0.0)
    other = Probability(make_search((0.5, half), (0.3, both), (0.2, make_set())), frozenset({"yaw_inertia"}))
    assert other.of_class("yaw_inertia") == pytest.approx(0.8)  # by sets with another effect instead


def test_the_most_probable_sets_are_listed_first_and_at_most_eight():
    strengths = [h.effect.strengths[0].name for h in make_hypotheses()][:10]
    sets = [(0.01 * (k + 1), make_set(**{s: 1.0})) for k, s in enumerate(strengths)]
    found = Probability(make_search(*sets), frozenset()).list_sets()
    assert [s["probability"] for s in found] == pytest.approx([0.01 * k for k in range(10, 2, -1)])
    pair = make_set(mass_change=0.1, gyro_scale_error=0.1)
    few = Probability(make_search((0.998, pair), (0.0011, make_set()), (0.0009, sets[0][1])), frozenset())
    assert few.list_sets() == [
        {"ids": ["gyro_scale", "mass"], "probability": 0.998},
        {"ids": [], "probability": 0.0011},
    ]


def test_the_spread_is_of_the_logarithm_of_the_stiffness_about_the_named_set():
    named = make_set(cy_front=0.9, mass_change=0.1)
    other = make_set(cy_front=0.99, cy_rear=1.2)
    search = make_search((0.7, named), (0.3, other))
    away = np.log([1.0, 0.99 / 0.9, 1.2])
    found = Probability(search, named.ids).compute_spread(search, named)
    np.testing.assert_allclose(found, 0.3 * np.outer(away, away), atol=1e-12)
    np.testing.assert_allclose(naming.compute_ln_stiffness(other), np.log([1.0, 0.99, 1.2]))


def test_a_name_has_the_size_of_its_own_fit_and_the_interval_of_all_effects():
    plain, rough = make_set(sd=0.01, mass_change=0.1), make_set(sd=0.03, mass_change=0.2)
    (h,) = plain.effects
    inertia, gyro = make_set(yaw_inertia_change=0.1), make_set(gyro_scale_error=0.05)
    scale = make_set(imu_scale_ay_error=0.05)
    search = make_search((0.6, plain), (0.1, inertia), (0.28, gyro), (0.01, scale), (0.01, make_set()))
    found = naming._make_sized_name(h, plain, Probability(search, plain.ids), rough)
    assert found.values == {"mass_change": 0.1}
    half = norm.ppf(0.975) * 0.03
    assert found.ci95["mass_change"] == pytest.approx((0.1 - half, 0.1 + half))
    assert found.probability == pytest.approx(0.6) and found.whole == pytest.approx(0.99)
    assert found.look_alikes == ["gyro_scale", "yaw_inertia"]  # the likelier first, and none below 2 %
    alone = naming._make_sized_name(h, plain, Probability(search, plain.ids))
    assert alone.ci95["mass_change"] == pytest.approx((0.1 - half / 3, 0.1 + half / 3))


def test_names_that_are_dropped_are_possible_with_the_reason_and_the_likeliest_first(monkeypatch):
    effects = {"mass": 0.95, "gyro_scale": 0.99, "body_roll": 0.05, "cg_shift": 0.9}
    named = [replace(name_share(i, 0.2), probability=p) for i, p in effects.items()]
    asked = []

    def refit(problem, found, kept, baseline):
        asked.append((problem, kept, baseline))
        return replace(found, named=[n for n in named if n.effect.id == "cg_shift"], closed=0.3)

    monkeypatch.setattr(naming, "_refit_names", refit)
    before = make_naming(named, 0.9)
    before.possible = [{"id": "relaxation", "probability": 0.97, "why": "below 90 %"}]
    found = naming.drop_names(None, before, frozenset({"cg_shift", "gyro_scale"}), "a reason")
    assert found.possible == [
        {"id": "gyro_scale", "probability": 0.99, "why": "its size is negligible"},  # in the new fit
        {"id": "relaxation", "probability": 0.97, "why": "below 90 %"},
        {"id": "mass", "probability": 0.95, "why": "a reason"},
    ]
    assert [n.effect.id for n in found.named] == ["cg_shift"] and found.closed == 0.3
    naming.refit_on_all("all", before, "level")
    assert asked[-1] == ("all", frozenset(effects), "level")


@pytest.fixture(scope="module")
def turned() -> Problem:
    """Four seconds of a car whose gyro reads 3 % too much."""
    steer = 0.02 * np.sin(5.0 * 0.01 * np.arange(400))
    noise = {"accel_x": 1e-3, "accel_y": 1e-3, "yaw_rate": 1e-4}
    p = Problem([make_prepared(rows=400, steer=steer, noise=noise)], Config.exact())
    p.measure({"gyro_scale_error": 0.03})
    return p


def test_names_are_fitted_again_with_shifted_intervals(turned):
    def name_gyro(x):
        return Named(
            KNOWN["gyro_scale"], {"gyro_scale_error": x}, {"gyro_scale_error": (x - 0.02, x + 0.01)}, 1, 1
        )

    heavy = Named(KNOWN["mass"], {"mass_change": 0.1}, {"mass_change": (0.0, 0.2)}, 0.1, 1)
    road = Named(KNOWN["bank"], {"bank_angle": 0.1}, {"bank_angle": (0.0, 0.2)}, 0.1, 1)
    before = make_naming([heavy, name_gyro(0.02), road], 0.2)
    before.final.values = {"gyro_scale_error": 0.02, "mass_change": 0.1, Own("bank", 0, 0): 0.1}
    before.converged = False
    level = Fit([], {}, turned.compute_residuals({}) * 2.0, np.zeros((300, 0)))
    found = naming._refit_names(turned, before, frozenset({"gyro_scale", "mass"}), level)
    assert [n.effect.id for n in found.named] == ["gyro_scale", "bank"]  # no mass is left
    gyro = found.named[0]
    assert gyro.values["gyro_scale_error"] == pytest.approx(0.03, abs=1e-3)
    low, high = gyro.ci95["gyro_scale_error"]
    assert (0.03 - low, high - 0.03) == pytest.approx((0.02, 0.01), abs=1e-3) and found.converged
    assert found.closed == pytest.approx(1.0) and found.baseline is level and found.named[1] is road
    none = naming._refit_names(turned, before, frozenset(), level)
    assert [n.effect.id for n in none.named] == ["bank"] and 0.3 < none.closed < 0.95
    assert set(none.final.values) == {"cx_front", "cy_front", "cy_rear"} and not none.converged


def test_a_fit_of_names_has_their_values_alone():
    """What a set has beside its effects, a little of all others, is not in the fit."""
    judged, asked = make_set(mass_change=0.1), []
    judged.values["gyro_scale_error"] = 0.001
    parameters = [*STIFFNESS_PARAMETERS, *KNOWN["gyro_scale"].strengths, *KNOWN["mass"].strengths]
    judged.space = SimpleNamespace(parameters=parameters)
    problem = SimpleNamespace(
        compute_residuals=lambda values: asked.append(dict(values)) or np.full(2, 3.0),
        compute_jacobian=lambda values, base, of: np.full((2, len(of)), base[0] + values["mass_change"]),
    )
    found = naming.convert_to_fit(problem, judged)
    values = dict.fromkeys(("cx_front", "cy_front", "cy_rear"), 1.0) | {"mass_change": 0.1}
    assert asked == [values] and found.values == values
    assert [p.name for p in found.parameters] == list(values)
    np.testing.assert_array_equal(found.jacobian, np.full((2, 4), 3.1))
    assert naming.convert_to_fit(problem, judged, slopes=False).jacobian.shape == (2, 0)


@pytest.mark.parametrize(
    ("values", "settings"),
    [
        ({"imu_delay_time": 0.03}, {"imu_delay_time": 0.03}),
        (
            {"imu_delay_time": -0.02},
            {"imu_delay_time": 0.0}
            | {f"{c}_latency": 0.02 for c in ("wheel_speed_front", "wheel_speed_rear")},
        ),
        ({"steering_delay_time": 0.05, "cy_rear": 0.9}, {"steering_delay_time": 0.05}),
        ({"steering_delay_time": -0.01}, {"steering_delay_time": 0.0, "steer_angle_latency": 0.014}),
        ({"accel_y_latency": 0.0}, {}),  # that of the file stays
        (
            {"wheel_speed_latency": 0.01, "accel_x_latency": -0.02},
            {"wheel_speed_front_latency": 0.01, "wheel_speed_rear_latency": 0.01, "accel_x_latency": -0.02},
        ),
        (
            {"mass_change": 0.1, "bank_angle": 0.1, "bank_superelevation": 0.2, Own("bank", 0, 0): 0.1},
            {"mass_change": 0.1, "bank_superelevation": 0.2},
        ),
    ],
)
def test_fitted_values_become_settings_of_a_vehicle_file(values, settings):
    """The file has delays of 10 ms and a latency of the steering of 4 ms."""
    given = {"imu_delay_time": 0.01, "steering_delay_time": 0.01, "steer_angle_latency": 0.004}
    p = Problem([make_prepared()], Config.exact(Config.exact().as_dict() | given))
    if values == {"imu_delay_time": -0.02}:
        settings = settings | {"steer_angle_latency": 0.024}
    assert naming.convert_to_settings(p, values) == pytest.approx(settings)


def test_a_road_is_named_by_what_it_closes_in_its_own_channel():
    problem, zero = make_groups(("accel_x", [0.0] * 4), ("accel_y", [0.0] * 4))
    level, on_road = (Fit([], {}, zero + x, np.zeros((8, 0))) for x in (3.0, 3.0))
    on_road.residuals = np.array([2.0] * 4 + [2.98] * 4)
    # gaps on a level road 4 (9 - 1) in each channel; on the road 4 (4 - 1) and 31.52
    both = [roads.FoundRoad(KNOWN[i], 0.01, (0.005, 0.015), 40.0, 0.97) for i in ("grade", "bank")]
    (found,) = naming.name_roads(problem, level, on_road, both)
    assert found.effect.id == "grade" and found.share == pytest.approx(20.0 / 64.0)
    assert found.values == {"grade_angle": 0.01} and found.ci95 == {"grade_angle": (0.005, 0.015)}
    assert (found.evidence, found.probability, found.whole) == (40.0, 0.97, 0.97)
    on_road.residuals = np.array([2.98] * 4 + [2.0] * 4)
    assert [n.effect.id for n in naming.name_roads(problem, level, on_road, both)] == ["bank"]


# ---- roads


def test_a_profile_has_the_size_of_its_waves_and_the_evidence_of_all_roads():
    """Two roads: grades of rms 0.02 and 0.01 about their means, and no bank."""
    road = Knots([], [], [0.0, 0.0], [4, 2], ("bank", "grade"))
    z = np.zeros(12)
    z[4:8] = 0.05 + np.array([0.02, -0.02, 0.02, -0.02])
    z[10:12] = [0.01, -0.01]
    sd = np.where(np.arange(12) < 8, 0.001, 0.002)
    sd[:4] = 1.0
    asked = []

    def compute_evidence(places, values, prior):
        asked.append((places.start, places.stop, prior))
        return 1.5

    equations = SimpleNamespace(compute_road_evidence=compute_evidence)
    found = roads._judge_profile("grade", road, SimpleNamespace(equations=equations, z=z), sd)
    assert asked == [(4, 8, 0.03), (10, 12, 0.03)] and found.effect.id == "grade"
    size = np.sqrt((0.02**2 + 0.01**2) / 2)
    own = np.sqrt((4 * 0.001**2 + 2 * 0.002**2) / 6 / 6)
    assert found.size == pytest.approx(size) and found.nats == 3.0
    assert found.ci95 == pytest.approx((size - 1.96 * own, size + 1.96 * own))
    odds = np.exp(3.0) / 9.0
    assert found.probability == pytest.approx(odds / (1 + odds))
    flat = roads._judge_profile("bank", road, SimpleNamespace(equations=equations, z=z), sd)
    assert flat.size == 0.0 and flat.ci95[0] == 0.0
    equations.compute_road_evidence = lambda *_: 1e4
    sure = roads._judge_profile("grade", road, SimpleNamespace(equations=equations, z=z), sd)
    assert sure.probability == 1.0  # not NaN


def test_profiles_are_placed_on_the_logs_that_were_compared():
    empty, first, second = (
        make_prepared("empty", stretches=[]),
        make_prepared("a"),
        make_prepared("b", speed=30.0),
    )
    road = Knots.lay([first.distance, second.distance], None, ("grade",))
    z = np.array([0.0, 0.01, 0.02, 0.0, 0.03, 0.06, 0.09])
    found = roads._place_logs([empty, first, second], road, z)
    assert [log.name for log in found] == ["empty", "a", "b"] and found[0].road == {}
    np.testing.assert_allclose(found[1].road["grade"], first.distance * 0.01 / 40)
    np.testing.assert_allclose(found[2].road["grade"], second.distance * 0.03 / 40)


def test_a_log_that_has_its_road_is_not_searched_for_one():
    logs = [make_prepared("a"), make_prepared("b", road={"bank": np.zeros(300)})]
    found = roads.find_roads(logs, Config.exact(), None, 1)
    assert found.logs == logs and found.found == [] and found.list_roads() == []


def test_a_profile_that_is_not_found_does_not_act_on_the_car(monkeypatch):
    """Only the grade is likely: the fit goes on without the bank, from its grade."""
    asked = []

    class Car:
        def __init__(self, own, config, prior, jobs, road, lean):
            self.groups, self.road, self.lean = [0], road, lean

    def fit(problem, x, z, say):
        road = problem.road
        asked.append((road.kinds, x, None if z is None else z.tolist(), problem.lean))
        values = 0.001 * np.arange(1.0, len(road) + 1)
        equations = SimpleNamespace(compute_road_sd=lambda: np.zeros(len(road)))
        return SimpleNamespace(equations=equations, z=values, search="x")

    def judge(kind, road, ended, sd):
        sure = kind == "grade"
        return roads.FoundRoad(KNOWN[kind], 0.006 if sure else 0.9, (0, 1), 9.0, 0.95 if sure else 0.85)

    monkeypatch.setattr(roads, "CarProblem", Car)
    monkeypatch.setattr(roads, "make_prior", lambda *_: None)
    monkeypatch.setattr(roads, "fit", fit)
    monkeypatch.setattr(roads, "_judge_profile", judge)
    found = roads.find_roads([make_prepared("a")], Config.exact(), None, 1)
    assert asked == [
        (("bank", "grade"), None, None, False),
        (("grade",), "x", pytest.approx([0.004, 0.005, 0.006]), False),
    ]
    assert [r.effect.id for r in found.found] == ["grade"] and set(found.logs[0].road) == {"grade"}
    monkeypatch.setattr(
        roads, "_judge_profile", lambda kind, *_: roads.FoundRoad(KNOWN[kind], 0.002, (0, 1), 9.0, 0.99)
    )
    none = roads.find_roads([make_prepared("a")], Config.exact(), None, 1)  # sure, but negligible
    assert none.found == [] and none.logs[0].road == {} and none.fit is None


def test_laps_of_a_road_have_one_profile(monkeypatch):
    """Laps are sought in the logs that are compared, and their roads are written."""
    logs = [make_prepared("a"), make_prepared("empty", stretches=[]), make_prepared("b", speed=30.0)]
    laid, sought, made = [], [], []
    laps = SimpleNamespace(
        distance=[log.distance for log in (logs[0], logs[2])], of=[0, 0], path=["way", None, "far"]
    )

    def fit(problem, x, z, say):
        laid.append((problem.road.count, problem.road.road))
        equations = SimpleNamespace(compute_road_sd=lambda: "sd")
        return SimpleNamespace(equations=equations, z=np.arange(float(len(problem.road))), search="x")

    monkeypatch.setattr(roads, "find_laps", lambda read, config: sought.append(read) or laps)
    monkeypatch.setattr(
        roads, "CarProblem", lambda own, c, p, j, road, lean: SimpleNamespace(groups=[0], road=road)
    )
    monkeypatch.setattr(roads, "make_prior", lambda *_: None)
    monkeypatch.setattr(roads, "fit", fit)
    monkeypatch.setattr(roads, "make_profile", lambda *x: made.append(x) or x[0])
    monkeypatch.setattr(
        roads, "_judge_profile", lambda kind, *_: roads.FoundRoad(KNOWN[kind], 0.02, (0, 1), 9.0, 0.99)
    )
    found = roads.find_roads(logs, Config.exact(), None, 1, read=["read a", "read empty", "read b"])
    assert sought == [["read a", "read b"]] and laid == [([4], [0, 0])]  # 89.7 m, as of the longest
    assert [r.effect.id for r in found.found] == ["bank", "grade"]
    at = np.interp(logs[2].distance, [0, 40, 80, 120], [4.0, 5.0, 6.0, 7.0])  # after the bank
    np.testing.assert_allclose(found.logs[2].road["grade"], at)
    assert found.list_roads() == ["way", "far"]
    assert [x[2] for x in made] == [0, 2] and all(x[1] is found.road and x[4] == "sd" for x in made)


def test_laps_share_the_profile_that_is_left_and_lack_no_channel(monkeypatch):
    """Two laps of 59.8 m, in which only the grade is found."""
    logs, given, starts = [make_prepared("a"), make_prepared("b")], [], []
    laps = SimpleNamespace(distance=[log.distance for log in logs], of=[0, 0], path=["way"])

    def make_car(own, config, prior, jobs, road, lean):
        given.append((road.kinds, list(road.count), [log.name for log in own]))
        return SimpleNamespace(groups=[0], road=road)

    def fit(problem, x, z, say):
        starts.append(None if z is None else list(z))
        equations = SimpleNamespace(compute_road_sd=lambda: None)
        return SimpleNamespace(equations=equations, z=np.arange(len(problem.road)) + 1.0, search=None)

    def judge(kind, *_):
        return roads.FoundRoad(KNOWN[kind], 0.02, (0, 1), 9.0, 0.99 if kind == "grade" else 0.5)

    monkeypatch.setattr(
        roads, "add_missing_channels", lambda log: replace(log, path=Path(f"whole {log.name}"))
    )
    monkeypatch.setattr(roads, "find_laps", lambda *_: laps)
    monkeypatch.setattr(roads, "CarProblem", make_car)
    monkeypatch.setattr(roads, "make_prior", lambda *_: None)
    monkeypatch.setattr(roads, "fit", fit)
    monkeypatch.setattr(roads, "_judge_profile", judge)
    found = roads.find_roads(logs, Config.exact(), None, 1, read=["read a", "read b"])
    whole = ["whole a", "whole b"]
    assert given == [(("bank", "grade"), [3], whole), (("grade",), [3], whole)]
    assert starts == [None, [4.0, 5.0, 6.0]] and found.laps is laps
    for log in found.logs:
        np.testing.assert_allclose(log.road["grade"], 1.0 + log.distance / 40)


# ---- names against formulas


@pytest.mark.parametrize(("p", "odds"), [(0.5, 1.0), (0.9, 9.0), (0.2, 0.25)])
def test_ln_odds(p, odds):
    assert rivals.compute_ln_odds(p) == pytest.approx(np.log(odds))


def make_world(probability: float, *names: str, text: str | None = None) -> rivals.World:
    formula = None if text is None else SimpleNamespace(formula=SimpleNamespace(text=text))
    return rivals.World(make_naming([name_share(n, 0.5) for n in names], 0.9), formula, 0.0, [], probability)


def test_the_best_world_has_no_name_that_is_uncertain():
    worlds = rivals.Worlds(None, None)
    both, one, none = (
        make_world(0.5, "mass", "body_roll"),
        make_world(0.41, "mass"),
        make_world(0.09, text="k"),
    )
    worlds.known = [none, both, one]
    assert worlds.with_name("mass") == pytest.approx(0.91)
    assert worlds.with_name("body_roll") == pytest.approx(0.5) and worlds.with_name("cg_shift") == 0
    assert worlds.find_best() is one  # the likeliest has a name that is below 90 %
    assert one.text is None and none.text == "k" and both.names == {"mass", "body_roll"}
    one.probability, none.probability = 0.2, 0.3
    assert worlds.find_best() is none


def test_residuals_of_fitted_and_held_out_logs_count_alike():
    fitted, e = make_groups(("accel_y", [1.0, 3.0]), ("yaw_rate", [5.0, 5.0]))
    held, other = make_groups(("accel_y", [2.0, 2.0, 2.0]))
    held.weight[2] = 0.0
    worlds = rivals.Worlds(fitted, held)
    assert worlds._compute_mean_square([e, other], "accel_y") == (pytest.approx((1 + 9 + 4 + 4) / 4), 4)
    assert worlds._compute_mean_square([e, other], "yaw_rate") == (pytest.approx(25.0), 2)
    assert worlds._compute_mean_square([e, other], "accel_x") == (0.0, 0)
    alone = rivals.Worlds(fitted, None)
    assert alone._compute_mean_square([e], "accel_y") == (pytest.approx(5.0), 2)


def test_a_world_is_fitted_again_with_all_that_it_holds(turned):
    """The gyro's scale is held, and the stiffness fitted."""
    start = dict.fromkeys((p.name for p in STIFFNESS_PARAMETERS), 1.3)
    last = Fit(list(STIFFNESS_PARAMETERS), start | {"gyro_scale_error": 0.03}, np.zeros(0), np.zeros((0, 0)))
    found = rivals.refit_world(turned, last)
    expected = {"cy_front": 1.0, "cy_rear": 1.0, "gyro_scale_error": 0.03}
    assert {k: found.values[k] for k in expected} == pytest.approx(expected, abs=2e-3)
    assert np.std(found.residuals) < 0.02 and turned.fixed == {}


# ---- which effects of the best set have a name


@pytest.fixture
def decide(monkeypatch):
    """Return a function: best set, other sets, fitted sizes and shares -> the naming.

    Fits are replaced: a set has the sizes of `sizes`, and an effect closes `alone` of
    what the other names leave.
    """

    def run(best, *others, sizes=None, alone=None, roads=(), level=None):
        sizes, alone = dict(best.values) | (sizes or {}), alone or {}
        sets = {s.ids: s for _, s in others} | {best.ids: best}
        weights = {s.ids: p for p, s in others}
        weights[best.ids] = 1.0 - sum(weights.values())
        known = {h.id: h for s in sets.values() for h in s.effects}

        def judge(ids, values, like, rough):
            effects = tuple(h for i, h in known.items() if i in ids)
            return sets.get(frozenset(ids)) or replace_set(best, effects)

        def replace_set(s, effects):
            return SimpleNamespace(
                **(vars(s) | {"effects": effects, "ids": frozenset(h.id for h in effects)})
            )

        for s in sets.values():
            s.converged = True
        search = make_search(*((p, sets[i]) for i, p in weights.items()))
        search.run, search.judge = lambda: best, judge
        problem, e = make_groups(("accel_y", [3.0] * 4))
        plain = Fit([], {}, e, np.zeros((4, 0)))
        monkeypatch.setattr(naming, "Search", lambda *_: search)
        monkeypatch.setattr(naming, "fit_plain_car", lambda p: plain)
        run.plain, run.sized, run.roads = plain, [], []

        def fit_alone(problem, effects, values):
            run.sized.append([h.id for h in effects])
            return SimpleNamespace(effects=effects, values=sizes)

        monkeypatch.setattr(naming, "fit_alone", fit_alone)
        monkeypatch.setattr(naming, "name_roads", lambda p, *given: run.roads.append(given) or [])
        monkeypatch.setattr(
            naming, "convert_to_fit", lambda p, s: replace(plain, residuals=e / 3 * np.sqrt(3))
        )

        def make_named(p, s, final, sized, last, h, probability, full):
            rms = 3 if level is None else level.residuals[0]
            assert full == pytest.approx(4 * (rms**2 - 1)) and sized.values is sizes
            item = naming._make_sized_name(h, best, probability)
            item.alone = alone.get(h.id, 0.9)
            return item

        monkeypatch.setattr(naming, "_make_named", make_named)
        return naming.name_effects(problem, [], baseline=level, roads=roads)

    return run


def list_reasons(found: Naming) -> tuple[list[str], dict[str, str]]:
    return [n.effect.id for n in found.named], {p["id"]: p["why"] for p in found.possible}


def test_an_effect_is_named_if_it_or_a_replacement_is_certain(decide):
    best = make_set(sd=1e-3, mass_change=0.1, gyro_scale_error=0.02)
    instead = make_set(sd=1e-3, yaw_inertia_change=0.1, gyro_scale_error=0.02)
    without = make_set(sd=1e-3, mass_change=0.1)
    found = decide(best, (0.3, instead), (0.11, without))
    assert list_reasons(found) == (["mass"], {"gyro_scale": "below 90 %"})  # yaw_inertia is a look-alike
    assert found.possible[0]["probability"] == pytest.approx(0.89)
    assert found.closed == pytest.approx(1.0 - (3 - 1) / (9 - 1)) and found.converged
    assert found.sets[0]["ids"] == ["gyro_scale", "mass"]
    certain = decide(best, (0.3, instead), (0.0999, without))
    assert list_reasons(certain)[0] == ["mass", "gyro_scale"]


def test_a_name_is_lost_by_a_negligible_size_by_a_wide_interval_and_by_a_small_share(decide):
    best = make_set(sd=1e-3, mass_change=0.1, gyro_scale_error=0.02, steering_ratio_change=0.05)
    small = decide(best, sizes={"mass_change": 0.02})
    assert list_reasons(small) == (["steering_ratio", "gyro_scale"], {"mass": "its size is negligible"})
    wide = make_set(sd=0.04, mass_change=0.2, gyro_scale_error=0.07)
    zero = "its 95 % interval includes the case without this effect"
    assert list_reasons(decide(wide)) == (["mass"], {"gyro_scale": zero})
    idle = decide(best, alone={"gyro_scale": 0.04, "mass": 0.045})
    reasons = dict.fromkeys(("mass", "gyro_scale"), "it closes almost nothing")
    assert list_reasons(idle) == (["steering_ratio"], reasons)
    edge = decide(best, alone={"gyro_scale": 0.05})
    assert len(edge.named) == 3
    lean = make_set(sd=1e-3, bank_superelevation=0.1)
    assert list_reasons(decide(lean, alone={"superelevation": 0.0}))[0] == ["superelevation"]


def test_only_what_is_still_named_is_fitted_and_the_gap_is_that_of_the_level_road(decide):
    """The gap on level roads is 4 (16 - 1), and the names leave 4 (3 - 1) of it."""
    best = make_set(sd=1e-3, mass_change=0.1, gyro_scale_error=0.02)
    other = make_set(sd=1e-3, mass_change=0.1, cy_front=0.9)
    level = Fit([], {}, np.full(4, 4.0), np.zeros((4, 0)))
    found = decide(best, (0.2, other), roads=["a road"], level=level)
    assert decide.sized == [["mass"]] and list_reasons(found)[0] == ["mass"]
    assert decide.roads == [(level, decide.plain, ["a road"])] and found.baseline is level
    assert found.closed == pytest.approx(1.0 - 8.0 / 60.0)
    expected = np.zeros((3, 3))
    expected[1, 1] = 0.8 * np.log(0.9) ** 2  # about the set that is named
    np.testing.assert_allclose(found.spread, expected, atol=1e-12)
    decide(best, sizes={"mass_change": 0.01})
    assert [set(ids) for ids in decide.sized] == [{"mass", "gyro_scale"}, {"gyro_scale"}]


def test_what_is_possible_is_listed_from_ten_percent_on_the_likeliest_first(decide):
    best = make_set(sd=1e-3, mass_change=0.1)
    others = [
        (0.09, make_set(sd=1e-3, mass_change=0.1, gyro_scale_error=0.02)),
        (0.2, make_set(sd=1e-3, mass_change=0.1, cg_shift_distance=0.1)),
        (0.3, make_set(sd=1e-3, mass_change=0.1, wheel_radius_change=0.02)),
    ]
    found = decide(best, *others)
    assert list_reasons(found)[0] == ["mass"]
    assert [p["id"] for p in found.possible] == ["wheel_radius", "cg_shift"]
    nothing = decide(make_set(), (0.3, make_set(sd=1e-3, mass_change=0.1)))
    assert list_reasons(nothing) == ([], {"mass": "below 90 %"}) and nothing.closed == 0.0


def test_a_name_closes_what_the_other_names_leave(monkeypatch):
    """In fitted pieces a share of the whole gap, in other pieces of what is left."""
    problem, _ = make_groups(("accel_y", [0.0] * 4), ("yaw_rate", [0.0] * 4))
    final, plain = (
        make_set(30.0, mass_change=0.1, gyro_scale_error=0.1),
        make_set(mass_change=0.1, gyro_scale_error=0.1),
    )
    less, asked = make_set(gyro_scale_error=0.1), []
    without = make_set(18.0, gyro_scale_error=0.1)

    def judge_set(p, others, members, start, like, rough):
        asked.append((tuple(h.id for h in others), list(members), like, rough))
        return less

    residuals = np.array([3.0] * 4 + [1.0] * 4)  # a gap of 32
    held = {id(less): {"accel_y": 44.0, "yaw_rate": 3.0}, id(plain): {"accel_y": 14.0, "yaw_rate": 1.0}}
    monkeypatch.setattr(naming, "judge_set", judge_set)
    monkeypatch.setattr(
        naming, "convert_to_fit", lambda p, j, slopes: Fit([], {}, residuals, np.zeros((8, 0)))
    )
    monkeypatch.setattr(naming, "compute_held_out", lambda j: held[id(j)])
    search = make_search((1.0, final))
    search.judge = lambda ids, values, like, rough: without if ids == {"gyro_scale"} else None
    h = next(h for h in final.effects if h.id == "mass")
    last = Fit([], {}, np.array([2.0] * 4 + [0.5] * 4), np.zeros((8, 0)))  # a gap of 12
    found = naming._make_named(problem, search, final, plain, last, h, Probability(search, final.ids), 40.0)
    assert asked == [(("gyro_scale",), ["gyro_scale"], plain, True)]
    assert found.evidence == 12.0 and found.share == pytest.approx((32.0 - 12.0) / 40.0)
    assert found.alone == pytest.approx(1.0 - 10.0 / 40.0)
    all_of_it = naming._make_named(
        problem, search, final, plain, last, h, Probability(search, final.ids), 20.0
    )
    assert all_of_it.share == pytest.approx((20.0 - 12.0) / 20.0)  # not more than there is
