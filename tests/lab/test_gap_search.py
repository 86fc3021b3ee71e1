"""The search for sets of effects, its fits, the excerpt of long logs and the smallest
visible sizes, against numbers by hand and against searches over sets of known evidence.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from gap_logs import make_groups, make_parameter, make_prepared
from tse.gaps.catalogue import Effect, load_catalogue
from tse.gaps.fit import Fit
from tse.gaps.infer import detect, excerpt, folds, search
from tse.gaps.infer.hypotheses import choose_start, fit_prior, make_hypotheses
from tse.gaps.infer.space import ABSENT, REACH, Space
from tse.gaps.problem import Problem
from tse.identify.data import FitStretch
from tse.library.core import Config

CAR = Config.exact()
KNOWN = {h.id: h for h in make_hypotheses()}
STIFFNESS = ("cx_front", "cy_front", "cy_rear")


# ---- likelihood and evidence


@pytest.mark.parametrize(
    ("square", "variance"), [(0.5, 23.0), (1.0, 23.0), (1.44, 23.0), (2.0, 51.0), (5.0, 201.0)]
)
def test_what_a_model_leaves_counts_with_the_blocks_of_two_seconds(square, variance):
    """50 blocks of 40 ms; at least the remainder at 1.2 times the noise."""
    assert search.compute_variance(square) == pytest.approx(variance)


@pytest.mark.parametrize("square", [3.0, 10.0])
def test_the_likelihood_of_a_channel_is_that_of_its_docstring_above_the_noise(square):
    there, near = search.compute_ln_likelihood(square, 600), search.compute_ln_likelihood(1.44, 600)
    exact = [-600 / (2 * 50) * np.log(1 + 50 * (s - 1.0)) for s in (square, 1.44)]
    assert there - near == pytest.approx(exact[0] - exact[1])
    below = search.compute_ln_likelihood(0.9, 600)
    assert below - near == pytest.approx(0.5 * 600 * (1.44 - 0.9) / 23.0)
    assert search.compute_ln_likelihood(square, 1200) == pytest.approx(2 * there)


def test_the_prior_of_a_fit_is_replaced_by_that_of_a_size():
    lever, gyro = KNOWN["imu_lever_arm"], KNOWN["gyro_scale"]
    values = {"imu_lever_arm_x": 0.4, "imu_lever_arm_y": -0.1, "gyro_scale_error": 0.02}
    fitted = norm.logpdf(0.4, 0.0, 1.6) + norm.logpdf(-0.1, 0.0, 1.6) + norm.logpdf(0.02, 0.0, 0.06)
    expected = 2 * np.log(0.1 / 0.9) + sum(h.compute_ln_prior(values) for h in (lever, gyro)) - fitted
    assert search.compute_ln_size_odds([lever, gyro], values) == pytest.approx(expected)
    assert search.compute_ln_size_odds([], values) == 0.0


def test_residuals_beyond_the_limit_count_by_their_size_and_not_by_their_square():
    space = SimpleNamespace(groups=[(0, "accel_y"), (0, "yaw_rate"), (1, "accel_y")])
    scales = {"accel_y": SimpleNamespace(rms=0.5), "yaw_rate": SimpleNamespace(rms=2.0)}
    found = SimpleNamespace(
        residuals=[np.array([1.0, -5.0]), np.array([3.0]), np.array([2.0])], scales=scales
    )
    square, count = search._compute_mean_square(space, found, "accel_y")  # the limit is 2
    assert square == pytest.approx((1.0 + 5.0 * 2.0 + 4.0) / 3) and count == 3
    assert search._compute_mean_square(space, found, "yaw_rate") == (pytest.approx(9.0), 1)


def test_slopes_of_another_fit_are_taken_by_name():
    """Of what it has no slope for, the column is 0."""
    table = np.arange(6.0).reshape(2, 3)
    like = SimpleNamespace(
        space=SimpleNamespace(names=("a", "b", "c")), fit=SimpleNamespace(slopes=([table, 10 + table], None))
    )
    found = search._transfer_slopes(SimpleNamespace(names=("c", "new", "a")), like)
    np.testing.assert_array_equal(found[0], [[2, 0, 0], [5, 0, 3]])
    np.testing.assert_array_equal(found[1], [[12, 0, 10], [15, 0, 13]])


def test_the_sd_of_a_value_is_the_root_of_its_own_variance():
    judged = search.Judged((), {"a": 1.0, "b": 2.0}, np.array([[4.0, 1.0], [1.0, 9.0]]), 0.0)
    assert judged.compute_sd() == {"a": 2.0, "b": 3.0}
    assert not judged.converged
    assert replace(judged, fit=SimpleNamespace(converged=True)).converged


def make_up_space(members: list[str], **more) -> SimpleNamespace:
    """Return unknowns of two channels: one stiffness, and sizes of gyro and lever arm.

    The last one is a shape, which neither of the two effects has.
    """
    names = ("cy_front", "gyro_scale_error", "imu_lever_arm_x", "imu_lever_arm_y", "shape")
    parameters = [make_parameter(n, strength=n != "shape") for n in names]

    def compute_prior(ids):
        sd = [0.5, 0.06, 1.6, 1.6, 0.2]
        if "gyro_scale" not in ids:
            sd[1] = 0.001
        if "imu_lever_arm" not in ids:
            sd[2] = sd[3] = 0.02
        return np.array([1.0, 0.0, 0.0, 0.0, 0.3]), np.array(sd)

    asked = (KNOWN["imu_lever_arm"], KNOWN["gyro_scale"])
    mean, sd = compute_prior(members)
    known = {
        "names": names, "parameters": parameters, "asked": asked, "lent": None,
        "effects": tuple(h for h in asked if h.id in members),
        "channels": ("accel_y", "yaw_rate"), "groups": [(0, "accel_y"), (0, "yaw_rate"), (1, "accel_y")],
        "mean": mean, "sd": sd, "information": np.diag(sd**-2.0), "compute_prior": compute_prior,
        "low": np.full(5, -9.0), "high": np.full(5, 9.0),
        "values": lambda x: dict(zip(names, map(float, x), strict=True)),
        "compute_ln_slope": lambda x: np.array([-2.0, 1.0, 1.0, 1.0, 1.0]),
    }  # fmt: skip
    return SimpleNamespace(**(known | more))


def make_up_fit(rng: np.random.Generator, x: list[float]) -> SimpleNamespace:
    """Return a fit with residuals below 1.2 times the noise, but for one of 40."""
    tables = [0.3 * rng.standard_normal((n, 5)) for n in (60, 80, 50)]
    residuals = [0.8 * rng.standard_normal(len(t)) for t in tables]
    residuals[1][7] = 40.0
    scales = {c: SimpleNamespace(rms=0.8 if c == "accel_y" else 0.2) for c in ("accel_y", "yaw_rate")}
    return SimpleNamespace(search=np.array(x), residuals=residuals, slopes=(tables, None), scales=scales)


def test_the_evidence_of_a_fit_is_that_of_laplace(monkeypatch):
    """With likelihood, prior, volume and odds, each computed by scipy."""
    rng, given = np.random.default_rng(3), []
    found = make_up_fit(rng, [0.9, 0.02, 0.4, -0.1, 0.25])
    root = rng.standard_normal((5, 9))
    found.equations = SimpleNamespace(information=root @ root.T)
    found.covariance = np.eye(5)
    space = make_up_space(["gyro_scale", "imu_lever_arm"], at=lambda start: np.full(5, start["x"]))

    def fit(space, x, near, tables):
        given.append((x[0], near, tables))
        return found

    monkeypatch.setattr(search, "Space", lambda *x: given.append(x) or space)
    monkeypatch.setattr(search.engine, "fit", fit)
    like = SimpleNamespace(fit=SimpleNamespace(slopes=("slopes of another fit", None)))
    judged = search.judge_set("problem", space.asked, ["gyro_scale", "imu_lever_arm"], {"x": 3.0}, like)
    assert given == [
        ("problem", space.asked, ["gyro_scale", "imu_lever_arm"], "slopes of another fit"),
        (3.0, True, None),
    ]
    values = space.values(found.search)
    expected = sum(
        search.compute_ln_likelihood(*search._compute_mean_square(space, found, c)) for c in space.channels
    )
    expected += norm.logpdf(found.search, space.mean, space.sd).sum()
    expected += 0.5 * np.log(np.linalg.det(2 * np.pi * np.linalg.inv(root @ root.T)))
    expected += search.compute_ln_size_odds(space.effects, values)
    assert judged.evidence == pytest.approx(expected) and judged.values == values
    assert judged.covariance is found.covariance and judged.fit is found


@pytest.mark.parametrize("ids", [["gyro_scale"], ["imu_lever_arm"], []])
def test_another_set_near_a_fit_is_a_linear_one_of_the_same_residuals(ids):
    """All mean squares are so small that each residual has the variance 23."""
    rng = np.random.default_rng(4)
    fit = make_up_fit(rng, [1.1, 0.02, 0.1, -0.05, 0.25])
    members = frozenset({"gyro_scale", "imu_lever_arm"})
    space = make_up_space(sorted(members))
    judged = SimpleNamespace(space=space, fit=fit, evidence=100.0, ids=members)
    around = search.Around(judged)
    assert around.judge(members).evidence == pytest.approx(100.0)

    def solve(ids):
        mean, sd = space.compute_prior(ids)
        a, y = [], []
        for e, table, (_, c) in zip(fit.residuals, fit.slopes[0], space.groups, strict=True):
            weight = np.minimum(1.0, search.engine.HUBER * fit.scales[c].rms / np.abs(e)) ** 0.5
            a.append(weight[:, None] * table)
            y.append(weight * (table @ fit.search - e))
        # a shape is that of the fit: the effects that are asked for have none in the set
        mean[4], sd[4] = fit.search[4], 1e-6
        both = np.vstack([np.vstack(a) / 23**0.5, np.diag(1 / sd)])
        right = np.concatenate([np.concatenate(y) / 23**0.5, mean / sd])
        x = np.linalg.lstsq(both, right, rcond=None)[0]
        squares = {c: [] for c in space.channels}
        for m, r, (_, c) in zip(a, y, space.groups, strict=True):
            squares[c].append((r - m @ x) ** 2)
        evidence = sum(
            search.compute_ln_likelihood(float(np.concatenate(s).mean()), len(np.concatenate(s)))
            for s in squares.values()
        )
        assert max(np.concatenate(s).mean() for s in squares.values()) < 1.44
        evidence += norm.logpdf(x, mean, sd).sum() - 0.5 * np.linalg.slogdet(both.T @ both)[1]
        effects = [h for h in space.asked if h.id in ids]
        values = space.values(x)
        return evidence + search.compute_ln_size_odds(effects, values), x, np.linalg.inv(both.T @ both)

    found, (evidence, x, covariance) = around.judge(frozenset(ids)), solve(ids)
    np.testing.assert_allclose(list(found.values.values()), x, atol=1e-6)
    assert found.evidence - 100.0 == pytest.approx(evidence - solve(members)[0], abs=1e-3)
    slope = np.array([-2.0, 1.0, 1.0, 1.0, 1.0])
    np.testing.assert_allclose(found.covariance, covariance * np.outer(slope, slope), rtol=1e-5, atol=1e-12)
    assert [h.id for h in found.effects] == ids


# ---- search, over sets whose evidence is known


EFFECTS = ("mass", "gyro_scale", "body_roll", "cg_shift", "relaxation", "imu_scale_ay")


def start_search(monkeypatch, evidence, ids=EFFECTS, fitted=None) -> search.Search:
    """Return a search in which sets have the evidence of a function of their ids.

    `fitted`: the evidence of a set that is fitted, if the approximation of it differs.
    """

    def make(members, evidence) -> search.Judged:
        if len(members) > 8:  # hundreds of pairs, whose values nobody reads
            return SimpleNamespace(evidence=evidence(members), ids=members)
        effects = tuple(KNOWN[i] for i in ids if i in members)
        values = {p.name: 1.0 for h in effects for p in h.effect.fitted}
        return search.Judged(effects, values, np.eye(0), evidence(frozenset(members)))

    def judge_set(problem, asked, members, start, like=None, rough=False):
        fits.append((frozenset(members), dict(start), like, rough))
        return make(members, fitted or evidence)

    class Around:
        def __init__(self, judged):
            pass

        def judge(self, members):
            return make(members, evidence)

    fits: list = []
    monkeypatch.setattr(search, "judge_set", judge_set)
    monkeypatch.setattr(search, "Around", Around)
    found = search.Search(None, [KNOWN[i] for i in ids])
    found.fits = fits
    return found


def add_worth(worth: dict[str, float], pairs: dict[tuple[str, ...], float] | None = None):
    """Return the evidence of sets: the sum of that of effects, and of pairs of them."""

    def compute(ids: frozenset) -> float:
        alone = sum(worth.get(i, -1.0) for i in ids)
        return alone + sum(w for pair, w in (pairs or {}).items() if ids.issuperset(pair))

    return compute


def test_a_climb_takes_the_change_that_raises_the_evidence_most(monkeypatch):
    s = start_search(monkeypatch, add_worth({"mass": 3.0, "body_roll": 5.0, "cg_shift": 0.05}))
    around = search.Around(None)
    assert s._find_best_near(around, frozenset(), 1) == {"body_roll"}
    assert s._find_best_near(around, frozenset(), 2) == {"body_roll", "mass"}
    assert s._find_best_near(around, frozenset(), 9) == {"body_roll", "mass"}  # cg_shift: below 0.1 nats
    assert s._find_best_near(around, frozenset({"gyro_scale"}), 1) == {"body_roll"}  # replaced
    three = frozenset({"gyro_scale", "body_roll", "mass"})
    less = start_search(monkeypatch, add_worth({"mass": 3.0, "body_roll": 5.0}))
    assert less._find_best_near(search.Around(None), three, 1) == {"body_roll", "mass"}


def test_two_effects_that_help_only_together_are_added_at_once(monkeypatch):
    pair = add_worth({"mass": -0.5, "cg_shift": -2.0}, {("mass", "cg_shift"): 9.0})
    s = start_search(monkeypatch, pair)
    assert s._find_best_near(search.Around(None), frozenset(), 1) == {"mass", "cg_shift"}
    little = add_worth({}, {("mass", "cg_shift"): 2.05})  # 0.05 nats together
    s = start_search(monkeypatch, little)
    assert s._find_best_near(search.Around(None), frozenset(), 1) == frozenset()
    one = add_worth(
        {"mass": 1.0, "cg_shift": 1.0, "gyro_scale": 2.3},
        {("mass", "gyro_scale"): -9.0, ("cg_shift", "gyro_scale"): -9.0},
    )
    s = start_search(monkeypatch, one)  # two effects are replaced by one
    assert s._find_best_near(search.Around(None), frozenset({"mass", "cg_shift"}), 1) == {"gyro_scale"}


def test_a_set_has_at_most_twelve_effects(monkeypatch):
    ids = tuple(KNOWN)[:14]
    s = start_search(monkeypatch, len, ids)
    around = search.Around(None)
    assert len(s._find_best_near(around, frozenset(ids[:11]), 1)) == 12
    assert len(s._find_best_near(around, frozenset(ids[:12]), 1)) == 12
    pairs = start_search(monkeypatch, lambda members: 5.0 * (len(members) // 2), ids)
    around = search.Around(None)  # only pairs help, and the eleventh effect is one of them
    assert len(pairs._find_best_near(around, frozenset(ids[:10]), 1)) == 12
    assert len(pairs._find_best_near(around, frozenset(ids[:12]), 1)) == 12


def test_effects_are_taken_away_one_by_one_as_long_as_the_evidence_rises(monkeypatch):
    s = start_search(monkeypatch, add_worth({"mass": 4.0, "gyro_scale": 0.2}))
    found = s._prune(s.judge((), {}))
    assert found.ids == {"mass", "gyro_scale"}
    assert [f[0] for f in s.fits] == [frozenset(), frozenset(EFFECTS), found.ids]
    assert s.fits[1][3]  # with the slopes of the first fit


def test_the_search_finds_a_pair_that_cancels_and_returns_the_best_set(monkeypatch):
    evidence = add_worth(
        {"mass": 4.0, "cg_shift": -20.0, "relaxation": -20.0}, {("cg_shift", "relaxation"): 50.0}
    )
    assert start_search(monkeypatch, evidence).run().ids == {"mass", "cg_shift", "relaxation"}
    three = ("cg_shift", "relaxation", "body_roll")  # of which no two help
    evidence = add_worth(dict.fromkeys(three, -20.0), {three: 90.0})
    assert start_search(monkeypatch, evidence).run().ids == set(three)
    assert start_search(monkeypatch, add_worth({})).run().ids == frozenset()


def test_a_set_that_is_worse_when_it_is_fitted_is_not_taken(monkeypatch):
    near, true = add_worth({"mass": 5.0, "body_roll": 3.0}), add_worth({"mass": -5.0, "body_roll": 3.0})
    s = start_search(monkeypatch, near, fitted=true)
    assert s.run().ids == {"body_roll"}
    assert frozenset({"mass", "body_roll"}) in s.known  # which looked best at first


def test_a_set_is_fitted_once(monkeypatch):
    s = start_search(monkeypatch, add_worth({}))
    first = s.judge(["mass"], {"cy_rear": 0.9})
    assert s.judge({"mass"}, {}) is first
    assert s.fits == [(frozenset({"mass"}), {"cy_rear": 0.9}, None, False)]
    said = []
    s.say = said.append
    s.judge(["mass", "body_roll"], {})
    s.judge([], {})
    assert said == ["trying body_roll, mass", "trying no effect"]


def test_an_effect_is_replaced_by_those_that_the_catalogue_lists_as_similar(monkeypatch):
    """The fit starts without the values of what is replaced."""
    s = start_search(monkeypatch, add_worth({}), ("imu_scale_ay", "body_roll", "gyro_scale", "mass"))
    best = s.judge(["imu_scale_ay", "mass", "gyro_scale"], {})
    found = s._fit_alike(best, {"imu_scale_ay"})  # similar: body_roll, wheel_radius, gyro_scale
    assert [j.ids for j in found] == [{"body_roll", "mass", "gyro_scale"}]
    _, start, like, rough = s.fits[-1]
    assert "imu_scale_ay_error" not in start and start["mass_change"] == 1.0
    assert like is best and not rough
    assert s._fit_alike(best, {"mass"}) == []  # yaw_inertia is not asked for


def test_for_each_effect_of_the_best_set_two_replacements_are_fitted(monkeypatch):
    worth = {"mass": 20.0, "body_roll": 15.0, "cg_shift": 12.0, "gyro_scale": 14.0, "relaxation": 1.0}
    s = start_search(monkeypatch, add_worth(worth))
    best = s.judge(["mass"], {})
    s._fit_rivals(best)
    assert [f[0] for f in s.fits[1:]] == [frozenset(), frozenset({"body_roll"}), frozenset({"gyro_scale"})]
    assert frozenset({"mass", "relaxation"}) in s.near  # approximated only
    far = start_search(monkeypatch, add_worth({"mass": 20.0, "body_roll": 7.9, "cg_shift": 8.1}))
    far._fit_rivals(far.judge(["mass"], {}))
    assert [f[0] for f in far.fits[1:]] == [frozenset(), frozenset({"cg_shift"})]  # 12 nats are far


def test_probabilities_are_of_the_fits_and_of_approximations_where_there_is_no_fit(monkeypatch):
    s = start_search(monkeypatch, add_worth({}))
    m, b = frozenset({"mass"}), frozenset({"body_roll"})
    make = [search.Judged((), {}, np.eye(0), x) for x in (1000.0, 1001.0, 1003.0)]
    s.known, s.near = {m: make[0]}, {m: make[2], b: make[1]}
    found = s.compute_probabilities()
    assert found == pytest.approx({m: 1 / (1 + np.e), b: np.e / (1 + np.e)})
    assert s.list_judged()[m] is make[0]


# ---- unknowns of a fit


ROLL, LEVER, GYRO, RELAXATION = (KNOWN[i] for i in ("body_roll", "imu_lever_arm", "gyro_scale", "relaxation"))


@pytest.fixture(scope="module")
def turning() -> Problem:
    """Three seconds of a slalom, of which one block of accel_y is missing."""
    steer = 0.02 * np.sin(5.0 * 0.01 * np.arange(300))
    gap = np.zeros(300)
    gap[104:108] = np.nan
    noise = {"accel_x": 0.01, "accel_y": 0.01, "yaw_rate": 0.001}
    measured = {"accel_y": gap, "yaw_rate": 0.0}
    p = Problem([make_prepared("a", steer=steer, measured=measured, noise=noise)], CAR)
    p.measure({"gyro_scale_error": 0.02, "cy_front": 0.9})
    return p


def test_the_unknowns_are_stiffness_all_sizes_and_the_shapes_of_the_set(turning):
    s = Space(turning, [ROLL, LEVER, GYRO], ["body_roll"])
    shapes = tuple(p.name for p in ROLL.effect.shapes)
    sizes = ("body_roll_gain", "imu_lever_arm_x", "imu_lever_arm_y", "gyro_scale_error")
    assert s.names == STIFFNESS + sizes + shapes and len(shapes) == 4
    assert [h.id for h in s.effects] == ["body_roll"]
    mean, sd = dict(zip(s.names, s.mean, strict=True)), dict(zip(s.names, s.sd, strict=True))
    assert [(mean[n], sd[n]) for n in STIFFNESS] == [(1.0, 0.5)] * 3
    for p in ROLL.effect.fitted:
        assert (mean[p.name], sd[p.name]) == pytest.approx(fit_prior(p))
    for p in (*LEVER.effect.strengths, *GYRO.effect.strengths):
        assert (mean[p.name], sd[p.name]) == (0.0, pytest.approx(ABSENT * p.negligible))
    np.testing.assert_allclose(s.information, np.diag(s.sd**-2.0))
    with_gyro = dict(zip(s.names, s.compute_prior({"gyro_scale"})[1], strict=True))
    assert with_gyro["gyro_scale_error"] == pytest.approx(0.06)
    assert with_gyro["body_roll_gain"] == pytest.approx(0.0004)
    low, high = dict(zip(s.names, s.low, strict=True)), dict(zip(s.names, s.high, strict=True))
    assert (low["cx_front"], high["cx_front"]) == (0.1, 5.0)
    assert (low["cy_rear"], high["cy_rear"]) == (0.2, 10.0)  # of the compliance
    assert (low["body_roll_gain"], high["body_roll_gain"]) == pytest.approx((-0.02, 0.04))


def test_only_cornering_stiffness_is_searched_as_its_inverse(turning):
    s = Space(turning, [GYRO], [])
    values = np.array([2.0, 0.8, 1.25, 0.01])
    x = s.to_search(values)
    np.testing.assert_allclose(x, [2.0, 1.25, 0.8, 0.01])
    np.testing.assert_allclose(s.to_ln(x), values)
    assert s.values(x) == pytest.approx(dict(zip((*STIFFNESS, "gyro_scale_error"), values, strict=True)))
    h = 1e-6
    slope = (s.to_ln(x + h) - s.to_ln(x - h)) / (2 * h)
    np.testing.assert_allclose(s.compute_ln_slope(x), slope, rtol=1e-6)


def test_a_fit_starts_at_given_values_unless_they_are_negligible(turning):
    s = Space(turning, [ROLL, LEVER, GYRO], ["body_roll", "imu_lever_arm"])
    x, y = LEVER.effect.strengths
    gain, frequency = ROLL.effect.strengths[0], ROLL.effect.shapes[0]

    def start(**values):
        return s.values(s.at(values))

    fresh = start(cy_front=0.8, gyro_scale_error=0.02)
    assert fresh["cy_front"] == pytest.approx(0.8) and fresh["cy_rear"] == 1.0
    assert fresh["gyro_scale_error"] == 0.02  # outside the set: as it is given
    assert fresh["imu_lever_arm_x"] == pytest.approx(choose_start(x)) == pytest.approx(0.15)
    assert fresh["body_roll_gain"] == pytest.approx(choose_start(gain))
    assert fresh["body_roll_frequency"] == pytest.approx(choose_start(frequency)) == pytest.approx(1.6)
    assert start()["gyro_scale_error"] == 0.0
    tiny = start(imu_lever_arm_x=0.01, imu_lever_arm_y=-0.02, body_roll_frequency=2.0)
    assert (tiny["imu_lever_arm_x"], tiny["imu_lever_arm_y"]) == pytest.approx((0.15, choose_start(y)))
    assert tiny["body_roll_frequency"] == pytest.approx(2.0)
    large = start(imu_lever_arm_x=0.01, imu_lever_arm_y=-0.3)
    assert (large["imu_lever_arm_x"], large["imu_lever_arm_y"]) == pytest.approx((0.01, -0.3))
    assert start(cy_front=7.0, body_roll_gain=9.0)["cy_front"] == pytest.approx(5.0)  # within the limits


def test_residuals_are_grouped_by_channel_without_unused_blocks(turning):
    s = Space(turning, [GYRO], [])
    assert s.groups == [(0, "accel_y"), (0, "yaw_rate")] and s.channels == ("accel_y", "yaw_rate")
    assert [len(t) for t in s.time] == [49, 50]
    assert s.time[0][:2] == pytest.approx([1.015, 1.095])
    x = s.at({"cy_front": 0.9})
    whole = turning.compute_residuals({"cy_front": 0.9})
    first, second = s.compute_residuals(x, np.zeros(0))
    np.testing.assert_allclose(first, np.delete(whole[:50], 1))
    np.testing.assert_allclose(second, whole[50:])
    two = Problem([turning.logs[0], make_prepared("b", measured={"yaw_rate": 0.0})], CAR)
    assert Space(two, [GYRO], []).groups == [(0, "accel_y"), (0, "yaw_rate"), (1, "yaw_rate")]


def test_slopes_are_with_respect_to_the_unknowns_and_may_be_lent(turning):
    """Sizes outside the set have wide differences; lent slopes stay as they are."""
    s = Space(turning, [RELAXATION, GYRO], ["gyro_scale"])
    x = s.at({"gyro_scale_error": 0.02, "cy_front": 0.9})
    base = s.compute_residuals(x, np.zeros(0))
    found = s.compute_slopes(x, np.zeros(0), base)
    values, by = s.values(x), s.compute_ln_slope(x)
    whole = turning.compute_residuals(values)
    used = [np.delete(np.arange(50), 1), np.arange(50, 100)]
    for k, (n, p) in enumerate(zip(s.names, s.parameters, strict=True)):
        step = (REACH if n == "relaxation_length" else 1.0) * 0.02 * p.scale
        change = (turning.compute_residuals(values | {n: values[n] + step}) - whole) / step
        for table, mine in zip(found, used, strict=True):
            np.testing.assert_allclose(table[:, k], by[k] * change[mine], rtol=1e-6, atol=1e-6)
    lent = [np.full_like(t, 7.0) for t in found]
    other = Space(turning, [RELAXATION, GYRO], ["gyro_scale"], lent)
    mixed = other.compute_slopes(x, np.zeros(0), base)
    there = [n in (*STIFFNESS, "gyro_scale_error") for n in s.names]
    for table, own in zip(mixed, found, strict=True):
        np.testing.assert_allclose(table[:, there], own[:, there])
        assert np.all(table[:, np.logical_not(there)] == 7.0)
    for table, own in zip(other.compute_own_slopes(x, base), found, strict=True):
        np.testing.assert_allclose(table, own)


def test_a_group_as_a_piece_has_the_signal_in_units_of_the_noise(turning):
    s = Space(turning, [GYRO], [])
    residual = np.arange(50.0)
    piece = s.make_piece(1, residual)
    level = turning.measured[50:] - np.median(turning.measured[50:])
    inside = np.sqrt(np.convolve(level**2, np.ones(25) / 25, "valid")) * turning.weight[50]  # of 1 s
    np.testing.assert_allclose(piece.size[12:38], inside, rtol=1e-6)
    assert piece.residual is residual and piece.time[0] == pytest.approx(1.015)
    np.testing.assert_allclose(s.compute_unit_yaw_rate(1), turning.weight[50:] / 20.0)
    slow = Problem([make_prepared(speed=1.0)], CAR)
    np.testing.assert_allclose(Space(slow, [], []).compute_unit_yaw_rate(2), slow.weight[100:] / 3.0)
    assert [t.shape for t in s.compute_road_slopes(None, None, [residual])] == [(50, 0)]


def test_the_speed_of_a_unit_yaw_rate_is_that_of_the_rear_wheels():
    log = make_prepared()
    log.inputs["wheel_speed_rear"] = np.full(300, 20.0 / 0.36)
    car = Config.exact(CAR.as_dict() | {"wheel_radius_front": 0.3, "wheel_radius_rear": 0.36})
    p = Problem([log], car)
    np.testing.assert_allclose(Space(p, [], []).compute_unit_yaw_rate(2), p.weight[100:] / 20.0)


def test_pieces_of_ten_seconds_are_dealt_to_five_folds():
    assert (folds.FOLDS, folds.FOLD_PIECE_TIME) == (5, 10.0)
    time = np.arange(0.5, 100.0)
    space = SimpleNamespace(
        time=[time, time[:30]],
        channels=("accel_y", "yaw_rate"),
        groups=[(0, "accel_y"), (0, "yaw_rate")],
        information=np.array([[4.0]]),
    )
    rng = np.random.default_rng(5)
    j = [rng.standard_normal((n, 1)) for n in (100, 30)]
    e = [rng.standard_normal(n) for n in (100, 30)]
    sd = {"accel_y": 2.0, "yaw_rate": 0.5}
    fit = SimpleNamespace(
        residuals=e, slopes=(j, None), scales={c: SimpleNamespace(sd=x) for c, x in sd.items()}
    )
    found = folds.compute_held_out(SimpleNamespace(space=space, fit=fit))
    left = {"accel_y": 0.0, "yaw_rate": 0.0}
    for k in range(5):
        out = [(t // 10).astype(int) % 5 == k for t in space.time]
        information, pull = 4.0, 0.0
        for m, a, r, s in zip(out, j, e, sd.values(), strict=True):
            information += float(a[~m, 0] @ a[~m, 0]) / s**2
            pull += float(a[m, 0] @ r[m]) / s**2
        for c, m, a, r in zip(left, out, j, e, strict=True):
            left[c] += float(np.sum((r[m] + a[m, 0] * pull / information) ** 2))
    assert found == pytest.approx(left)


# ---- excerpt


def test_logs_are_long_from_three_minutes_on():
    def make(seconds):
        return SimpleNamespace(logs=[SimpleNamespace(seconds=s) for s in seconds])

    assert not excerpt.is_long(make([90.0, 90.0])) and excerpt.is_long(make([90.0, 91.0]))
    assert not excerpt.is_long(make([]))


def test_pieces_have_fifteen_seconds_and_a_second_without_comparison():
    """A stretch of 35 s and one of 16 s; blocks of 3 rows of 10 ms."""
    used = [np.ones(3500, bool), np.ones(1601, bool)]
    used[0][2000:2300] = False  # rows that are not compared anyway
    cut = [FitStretch(0, 3500, used[0]), FitStretch(4000, 5601, used[1])]
    log = replace(make_prepared(rows=6000), stretches=cut, rows_per_block=3)
    found = excerpt._cut_pieces(log)
    assert [(p.first, p.last) for p in found] == [(0, 1500), (1500, 3000), (3000, 3500), (4000, 5500)]
    for p in found:  # 1 s in whole blocks; 16 s leave a piece of 1 s, which is too short
        assert len(p.used) == p.last - p.first
        assert not p.used[:102].any() and p.used[102] and p.used[-1]
    assert not found[1].used[500:800].any() and found[1].used[499] and found[1].used[800]
    assert used[0][:102].all()  # the stretches of the log are as they were


def test_the_pieces_that_are_chosen_are_those_of_their_logs(monkeypatch):
    """Three logs of 31 s: the second is informative at its end, the third all over."""
    monkeypatch.setattr(excerpt, "MAX_SECONDS", 40.0)
    logs = [make_prepared(n, rows=3100, measured={"yaw_rate": 0.0}) for n in ("a", "b", "c")]
    p = Problem(logs, CAR)
    rows = p.rows
    table = np.full((len(rows.log), 1), 1e-3)
    table[(rows.log == 1) & (rows.time > 17.0)] = 2.0
    table[rows.log == 2] = 1.0
    table[(rows.log == 2) & (rows.time > 17.0)] = 1.5
    table[rows.time % 15.0 < 0.9] = 100.0  # what is not compared does not count
    monkeypatch.setattr(excerpt, "_compute_slopes", lambda *_: table)
    found = excerpt.choose_excerpt(p, None)
    assert [log.name for log in found.logs] == ["b", "c"]
    assert [[(s.first, s.last) for s in log.stretches] for log in found.logs] == [
        [(1500, 3000)],
        [(0, 1500), (1500, 3000)],
    ]


def test_the_length_of_a_piece_is_that_of_what_is_compared(monkeypatch):
    """Of 15 s the first second is not compared, and in the second log 7 s more."""
    used = np.arange(1500) >= 700
    cut = [FitStretch(0, 1500, used)]
    logs = [make_prepared("a", rows=1500), make_prepared("b", rows=1500, stretches=cut)]
    p, given = Problem(logs, CAR), []
    monkeypatch.setattr(excerpt, "is_long", lambda _: True)
    monkeypatch.setattr(excerpt, "_compute_slopes", lambda *_: np.ones((len(p.weight), 2)))
    monkeypatch.setattr(excerpt, "choose_best", lambda *x: given.append(x) or [1])
    assert [log.name for log in excerpt.choose_excerpt(p, None).logs] == ["b"]
    ((information, seconds, limit),) = given
    assert seconds == pytest.approx([14.0, 8.0]) and limit == 90.0
    rows = [3 * 350, 3 * 200]  # blocks of three channels, in units of an sd of 30
    for found, n in zip(information, rows, strict=True):
        np.testing.assert_allclose(found, n / 900.0 * np.ones((2, 2)))


def test_the_slopes_of_a_piece_are_in_units_of_prior_sds_and_end_with_the_residuals(monkeypatch):
    asked = {}

    class Slopes:
        def compute_residuals(self, values):
            return np.full(2, values["cy_rear"])

        def compute_jacobian(self, values, base, parameters, reach):
            asked.update(values=values, base=base, parameters=parameters, reach=reach)
            return np.vstack([np.ones(len(parameters)), np.full(len(parameters), np.nan)])

    values = dict.fromkeys(STIFFNESS, 0.9)
    baseline = Fit([], values, np.array([3.0, 4.0]), np.zeros((2, 0)))
    table = excerpt._compute_slopes(Slopes(), baseline)
    names = [p.name for p in asked["parameters"]]
    assert names[:3] == list(STIFFNESS) and set(names[3:]) == {
        p.name for h in KNOWN.values() for p in h.effect.strengths
    }
    unit = dict(zip(names, table[0], strict=False))
    assert unit["cy_front"] == 0.5 and unit["gyro_scale_error"] == pytest.approx(0.06)
    assert not table[1, :-1].any() and list(table[:, -1]) == [3.0, 4.0]
    assert asked["reach"] == REACH and list(asked["base"]) == [0.9, 0.9]
    assert asked["values"]["body_roll_frequency"] == pytest.approx(1.6) and asked["values"]["cy_rear"] == 0.9


# ---- smallest visible sizes


def make_effect(id: str, *parameters) -> Effect:
    return Effect(id, id, "", (), parameters)


def test_the_smallest_visible_size_is_where_the_likelihood_ratio_outweighs_the_odds():
    """Against numpy's least squares: what the fit can explain is not visible."""
    rng = np.random.default_rng(6)
    problem, e = make_groups(
        ("accel_y", 3.0 * rng.standard_normal(60)), ("yaw_rate", rng.standard_normal(40))
    )
    fitted = rng.standard_normal((100, 2))
    one = make_parameter("one", (0.5, 1.5), (-50.0, 50.0))
    two = [
        make_parameter("far", (0.5, 1.5), (-50.0, 50.0)),
        make_parameter("near", (0.5, 1.5), (-50.0, 50.0)),
    ]
    tight = make_parameter("tight", (0.1, 0.3), (-0.3, 0.5))
    idle, same = make_parameter("idle"), make_parameter("same")
    slopes = {n: rng.standard_normal(100) for n in ("one", "far", "tight")}
    slopes |= {"near": 3.0 * slopes["far"], "idle": np.zeros(100), "same": fitted @ [1.0, 2.0]}
    slopes["one"] += 2.0 * fitted[:, 0]
    asked = {}

    def compute_jacobian(values, base, parameters, reach):
        asked.update(values=values, base=base, reach=reach)
        return np.column_stack([slopes[p.name] for p in parameters])

    problem.strengths = lambda effect: effect.strengths
    problem.compute_jacobian = compute_jacobian
    effects = [make_effect("one", one), make_effect("two", *two)]
    effects += [make_effect(p.name, p) for p in (tight, idle, same)]
    current = Fit([], {"cy_rear": 0.9}, e, fitted)
    found = {d.id: d for d in detect.compute_detectable(problem, current, effects)}
    assert list(found) == ["one", "two", "tight", "idle", "same"]
    assert asked == {"values": current.values, "base": e, "reach": REACH}
    weight = np.ones(100)
    for mine in (slice(0, 60), slice(60, 100)):
        weight[mine] = 1.0 / (1.0 + 50.0 * max(np.mean(e[mine] ** 2) - 1.0, 0.44))
    need = np.log(5 - 1) + np.log(9.0) + 3.0
    for key, parameter in (("one", "one"), ("two", "near")):
        x = slopes[parameter]
        rest = x - fitted @ np.linalg.lstsq(fitted, x, rcond=None)[0]
        power, whole = float(rest @ (weight * rest)), float(x @ (weight * x))
        assert found[key].parameter == parameter
        assert found[key].smallest == pytest.approx(np.sqrt(2 * need / power))
        assert found[key].absorbed == pytest.approx(1.0 - power / whole)
        assert found[key].typical == 1.0 and found[key].unit == "1"
    assert found["one"].absorbed > 0.5 and found["two"].absorbed < 0.2
    assert found["tight"].smallest == np.inf  # it would be beyond its limits
    assert (found["idle"].smallest, found["idle"].absorbed) == (np.inf, 1.0)
    assert found["same"].smallest == np.inf and found["same"].absorbed == pytest.approx(1.0)


@pytest.mark.parametrize(("smallest", "visible"), [(0.9, True), (1.0, True), (1.1, False), (np.inf, False)])
def test_an_effect_is_visible_up_to_its_typical_size(smallest, visible):
    assert detect.Detectable("a", "b", "m", smallest, 1.0, 0.0).visible is visible


def test_the_size_of_a_road_is_the_rms_of_waves_of_400_metres():
    p = Problem([make_prepared(rows=4000)], CAR)  # 800 m, two waves
    knots = p.strengths(load_catalogue()["grade"])
    values = detect._make_wave(np.eye(len(knots)), knots)[:, 0]
    assert np.sqrt(np.mean(values[:20] ** 2)) == pytest.approx(1.0)
    assert values[[0, 5, 10]] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)  # every 200 m
    assert values[2] > 0.5 and values[7] == pytest.approx(-values[2])
    two = p.of([p.logs[0], p.logs[0]]).strengths(load_catalogue()["grade"])
    np.testing.assert_allclose(detect._make_wave(np.eye(len(two)), two)[:, 0], np.tile(values, 2))


def test_a_road_is_visible_as_one_effect():
    """A grade moves accel_x by gravity."""
    p = Problem([make_prepared(rows=2100, measured={"accel_x": 0.0})], CAR)
    nothing = Fit([], {}, p.compute_residuals({}), np.zeros((500, 0)))
    (found,) = detect.compute_detectable(p, nothing, [load_catalogue()["grade"]])
    assert (found.id, found.parameter, found.unit) == ("grade", "grade_angle", "rad")
    need = np.log(2 - 1) + np.log(9.0) + 3.0
    at = p.logs[0].distance
    wave = np.sqrt(2) * np.interp(at, 40 * np.arange(12), np.sin(2 * np.pi * np.arange(12) * 40 / 400))
    slope = p.whiten(9.81 * wave[100:].reshape(-1, 4).mean(axis=1))
    assert found.smallest == pytest.approx(np.sqrt(2 * need * 23.0 / (slope @ slope)), rel=0.1)
