"""Forms, prices and choices of the search for a formula against numbers by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gap_logs import make_groups, make_parameter, make_prepared
from tse.car.formula import Number, parse
from tse.gaps.catalogue import Own
from tse.gaps.fit import ChannelChange, Fit
from tse.gaps.infer import formula_search as search
from tse.gaps.infer import formula_terms as terms
from tse.gaps.infer.formula_terms import FormulaTerm, Signal, Size
from tse.gaps.problem import STIFFNESS_PARAMETERS, Problem
from tse.library.core import Config

CAR = Config.exact()
DT = np.full(5, 0.1)
PLACES = (*terms.LATERAL, *terms.LONGITUDINAL)


# ---- forms


@pytest.mark.parametrize(
    ("text", "length"),
    [
        ("yaw_rate", 1),
        ("abs(yaw_rate)", 2),
        ("vel_x*vel_x", 2),
        ("(lag(accel_y, T) - accel_y)", 4),
        ("-a/b", 3),
    ],
)
def test_a_form_is_as_long_as_its_operators_and_parentheses(text, length):
    assert FormulaTerm(text, (0, 0)).price == length


def test_a_formula_costs_two_nats_for_each_operation_and_number():
    form = FormulaTerm("soft(yaw_rate/w)", (0, 0), (Size("w", 0.1, 0.01, 1.0, "rad/s", ""),))
    assert search.compute_price(form) == 2.0 * (3 + 1 + 1)
    assert search.compute_price(FormulaTerm("accel_x", (1, -2))) == 2.0 * 2


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("rad", (0, 0)),
        ("1", (0, 0)),
        ("m/s2", (1, -2)),
        ("rad/s", (0, -1)),
        ("rad s2/m", (-1, 2)),
        ("m s2", (1, 2)),
        ("m2/s2", (2, -2)),
        ("1/s", (0, -1)),
        ("m/s/s", (1, -2)),
    ],
)
def test_a_unit_has_the_exponents_of_metre_and_second(unit, exponents):
    assert terms.read_exponents(unit) == exponents
    assert terms.read_exponents(terms.format_unit(exponents)) == exponents


def test_units_are_written_with_powers_and_a_bar():
    shown = {(1, -2): "m/s2", (0, -1): "1/s", (-1, 2): "s2/m", (2, 1): "m2 s", (-1, -1): "1/m/s"}
    assert {e: terms.format_unit(e) for e in shown} == shown


SIGNALS = {
    "yaw_rate": np.array([-0.2, -0.05, 0.0, 0.1, 0.3]),
    "accel_y": np.array([-4.0, -1.0, 0.0, 2.0, 6.0]),
    "accel_x": np.array([-3.0, 0.0, 1.0, 2.0, -1.0]),
    "steer_angle": np.array([0.0, 0.01, 0.02, 0.03, 0.01]),
    "vel_x": np.array([9.0, 18.0, 27.0, 18.0, 9.0]),
    "slip_angle_front": np.zeros(5),
    "slip_angle_rear": np.zeros(5),
}


def soft(x: np.ndarray) -> np.ndarray:
    return x / np.sqrt(1.0 + x * x)


def evaluate(form: FormulaTerm) -> np.ndarray:
    return terms.compute_values(form, SIGNALS, DT)


def test_factors_have_the_values_of_their_texts():
    """Each times the yaw rate: steps at the sizes of their signals, and both signs."""
    found = {}
    for m in terms.make_modulators():
        form = terms._multiply_terms(FormulaTerm("yaw_rate", (0, -1)), m)
        key = (m.text, *(s.value for s in m.sizes))
        assert key not in found
        found[key] = evaluate(form) / np.where(SIGNALS["yaw_rate"] == 0, np.nan, SIGNALS["yaw_rate"])
        wanted = tuple(np.add(m.unit, (0, -1)))
        assert form.unit == wanted and form.sizes == m.sizes
    x = SIGNALS
    expected = {
        ("",): np.ones(5),
        ("(vel_x/v - 1)", 18.0): x["vel_x"] / 18.0 - 1.0,
        ("vel_x*vel_x",): x["vel_x"] ** 2,
        ("accel_x",): x["accel_x"],
        ("(abs(accel_x) + accel_x)",): 2 * np.maximum(x["accel_x"], 0.0),
        ("(abs(accel_x) - accel_x)",): 2 * np.maximum(-x["accel_x"], 0.0),
    }
    for v in (9.0, 16.0, 24.0):
        expected[("(1 + soft((vel_x - v0)/vw))", v, 3.0)] = 1 + soft((x["vel_x"] - v) / 3.0)
    for name, n, sizes in (
        ("accel_y", "a", (2.0, 4.5)),
        ("accel_x", "p", (1.5, 3.5)),
        ("steer_angle", "d", (0.02, 0.06)),
    ):
        expected[(f"abs({name})",)] = np.abs(x[name])
        for at in sizes:
            key = (f"(1 + soft((abs({name}) - {n}0)/{n}w))", at, 0.3 * at)
            expected[key] = 1 + soft((np.abs(x[name]) - at) / (0.3 * at))
    assert list(found.keys() ^ expected.keys()) == []
    for key, values in expected.items():
        there = np.isfinite(found[key])
        np.testing.assert_allclose(found[key][there], values[there], rtol=1e-9, atol=1e-12, err_msg=str(key))


def test_functions_of_a_signal_have_the_values_of_their_texts():
    found = {(f.text, *(s.value for s in f.sizes)): f for f in terms.make_shapes(terms.SIDE)}
    x = SIGNALS["accel_y"]
    square, cube = found[("accel_y*abs(accel_y)",)], found[("accel_y*accel_y*accel_y",)]
    np.testing.assert_allclose(evaluate(square), x * np.abs(x))
    np.testing.assert_allclose(evaluate(cube), x**3)
    assert (square.unit, cube.unit) == ((2, -4), (3, -6))
    assert len(found) == 8
    for w in (0.7, 2.0, 4.5):
        bends, dead = found[("soft(accel_y/w)", w)], found[("(accel_y - max(-w, min(w, accel_y)))", w)]
        np.testing.assert_allclose(evaluate(bends), soft(x / w))
        np.testing.assert_allclose(evaluate(dead), np.sign(x) * np.maximum(np.abs(x) - w, 0.0))
        assert (bends.unit, dead.unit) == ((0, 0), (1, -2))
        assert (bends.sizes[0].low, bends.sizes[0].high) == pytest.approx((0.05 * w, 5.0 * w))
        assert (dead.sizes[0].low, dead.sizes[0].high) == pytest.approx((0.07, 13.5))


def test_memories_are_tried_with_their_signal_and_without():
    found = [(f.text, *(s.value for s in f.sizes)) for f in terms.add_memory(terms.YAW)]
    lags, modes = (0.05, 0.15, 0.4), [(f, d) for f in (1.0, 1.5, 2.2, 3.2) for d in (0.1, 0.35)]
    expected = [("(late(yaw_rate, T) - yaw_rate)", t) for t in (0.02, 0.08)]
    for less in ("", " - yaw_rate"):
        expected += [(f"(lag(yaw_rate, T){less})", t) for t in lags]
        expected += [(f"(second(yaw_rate, f0, D){less})", *x) for x in modes]
    assert sorted(found) == sorted(expected)
    units = {s.name: s.unit for f in terms.add_memory(terms.YAW) for s in f.sizes}
    assert units == {"T": "s", "f0": "Hz", "D": "1"}
    assert all(f.unit == (0, -1) for f in terms.add_memory(terms.YAW))


def test_play_and_limits_of_the_rate_have_units_of_their_signal():
    play, slow = terms.add_play(terms.STEER, (0.005,), (0.1,))
    np.testing.assert_allclose(evaluate(play), [0, -0.005, -0.005, -0.005, 0.005], atol=1e-9)
    np.testing.assert_allclose(evaluate(slow), [0, 0, 0, 0, 0.01], atol=1e-9)  # at most 0.01 in a row
    assert (play.sizes[0].unit, slow.sizes[0].unit) == ("rad", "rad/s")
    assert (slow.sizes[0].low, play.sizes[0].high) == pytest.approx((0.01, 0.05))
    (pull,) = terms.add_play(terms.PULL, (), (3.0,))
    assert pull.sizes[0].unit == "m/s3" and pull.unit == (1, -2) and pull.sizes[0].high == 30.0


@pytest.mark.parametrize("place", PLACES)
def test_every_number_starts_within_its_limits_and_a_place_has_forms_of_its_direction(place):
    forms = terms.list_forms(place)
    assert len(forms) > 40
    assert all(s.low < s.value < s.high for f in forms for s in f.sizes)
    longitudinal = {f.text for f in terms.make_longitudinal_forms()}
    assert ({f.text for f in forms} <= longitudinal) is (place in ("force_x", "accel_x"))


def test_forms_along_the_road_have_no_factor_of_the_acceleration_twice():
    texts = [f.text for f in terms.make_longitudinal_forms()]
    assert not [
        t
        for t in texts
        if t.startswith("accel_x*") and "accel_x" in t[8:] and t.count("*") == 1 and "abs" not in t
    ]
    assert "accel_x*vel_x*vel_x" in texts and "accel_x*abs(accel_y)" in texts and "accel_x" in texts
    units = {f.text: f.unit for f in terms.make_longitudinal_forms()}
    assert (units["vel_x*vel_x"], units["vel_x"], units["accel_y*accel_y"]) == ((2, -2), (1, -1), (2, -4))
    assert (units["accel_y*yaw_rate"], units["yaw_rate*yaw_rate"], units["yaw_rate"]) == (
        (1, -3),
        (0, -2),
        (0, -1),
    )


def test_a_formula_is_a_coefficient_in_the_unit_of_its_place_times_a_form():
    form = FormulaTerm("(lag(yaw_rate, T) - yaw_rate)", (0, -1), (Size("T", 0.15, 0.005, 3.0, "s", "time"),))
    found = terms.make_formula("accel_y", form, -2.5)
    assert (found.place, found.text, found.gain) == ("accel_y", "k*(lag(yaw_rate, T) - yaw_rate)", 1.0)
    assert [(n.name, n.value, n.unit, n.sd) for n in found.numbers] == [
        ("k", -2.5, "m/s", None),
        ("T", 0.15, "s", None),
    ]
    values = found.evaluate(SIGNALS, DT)
    np.testing.assert_allclose(evaluate(form), values / -2.5)
    assert terms.make_formula("yaw_moment", FormulaTerm("accel_y", (1, -2)), 1.0).numbers[0].unit == "1/m"


def test_a_signal_has_the_exponents_of_its_unit():
    assert Signal("x", "m/s2", (1.0,)).unit == (1, -2)
    for s in (*terms.TURNING, terms.SPEED, terms.PULL):
        assert list(s.sizes) == sorted(s.sizes) and s.sizes[0] > 0


# ---- gains, candidates


def test_a_gain_counts_independent_residuals_of_each_channel():
    problem, before = make_groups(("accel_x", [2.0, 2.0, 2.0]), ("accel_y", [3.0, 3.0]))
    after = np.array([1.0, 1.0, 1.0, 6.0, 6.0])
    length = {"accel_x": 1.5, "accel_y": 4.0}
    expected = 0.5 * 3 / 1.5 * np.log(4.0) - 0.5 * 2 / 4.0 * np.log(4.0)
    assert search.compute_worth(problem, before, after, length) == pytest.approx(expected)
    problem.weight[3:] = 0.0
    frame = SimpleNamespace(problem=problem, last=SimpleNamespace(residuals=before), length=length)
    assert search.Frame.compute_worth(frame, after) == pytest.approx(0.5 * 3 / 1.5 * np.log(4.0))


def test_places_need_their_sensors():
    def list_places(*logs):
        return search._list_places(SimpleNamespace(logs=[SimpleNamespace(channels=c) for c in logs]))

    assert list_places(["accel_x", "accel_y", "yaw_rate"]) == list(PLACES)
    assert list_places(["accel_y"], ["yaw_rate"]) == [*terms.LATERAL, "force_x"]
    assert list_places(["accel_x", "yaw_rate"]) == ["force_x", "accel_x"]
    assert list_places(["accel_y"]) == ["force_x"]


def test_candidates_are_the_best_of_different_forms_and_places():
    a, b, c = (FormulaTerm(t, (0, 0)) for t in ("a", "b", "c"))
    again = FormulaTerm("a", (0, 0), (Size("w", 1.0, 0.1, 2.0, "1", ""),))
    listed = [
        (9.0, "yaw_moment", a, 1.0),
        (8.0, "yaw_moment", again, 1.0),  # the same form from another start
        (7.0, "yaw_moment", b, 1.0),
        (6.0, "force_y", a, 1.0),
        (5.0, "yaw_moment", c, 1.0),
        (4.0, "yaw_moment", FormulaTerm("d", (0, 0)), 1.0),  # a fourth at one place
        (3.0, "force_y", b, 1.0),
        (2.0, "accel_y", a, 1.0),
        (1.0, "accel_y", b, 1.0),
    ]
    assert [x[0] for x in search._choose_diverse(listed)] == [9.0, 7.0, 6.0, 5.0, 3.0, 2.0]
    few = [(0.5, "force_y", a, 1.0), (0.0, "force_y", b, 1.0), (-1.0, "accel_y", c, 1.0)]
    assert [x[0] for x in search._choose_diverse(few)] == [0.5]  # nothing that gains nothing


def test_no_channel_dominates_a_fit():
    """Residuals of rms 5 get a fifth of the weight, those below 1 keep theirs."""
    p = Problem([make_prepared(steer=0.01)], CAR)
    e = np.tile([1.0, -1.0], 75) * np.repeat([5.0, 0.5, 1.0], 50)
    last = Fit(list(STIFFNESS_PARAMETERS), {"cy_rear": 0.9}, e, np.zeros((150, 3)))
    frame = search.Frame.of(p, last)
    np.testing.assert_allclose(frame.balanced.weight / p.weight, np.repeat([0.2, 1.0, 1.0], 50))
    assert frame.problem is p and frame.values == {"cy_rear": 0.9} and frame.values is not last.values
    assert frame.full == pytest.approx(50 * (25 - 1)) and frame.length == dict.fromkeys(dict(p.used()), 1.0)
    assert len(frame.at) == 1 and frame.at[0]["steer_angle"] == pytest.approx(0.01)


def test_the_expected_gain_is_that_of_least_squares_beside_the_fit(monkeypatch):
    """The responses are known: one explains, one is what the stiffness does."""
    rng = np.random.default_rng(7)
    problem, noise = make_groups(("accel_y", rng.standard_normal(60)), ("yaw_rate", rng.standard_normal(60)))
    jacobian, response = rng.standard_normal((120, 1)), rng.standard_normal(120)
    e = 4.0 * noise - 0.7 * response
    scale = np.repeat([0.25, 1.0], 60)
    balanced = SimpleNamespace(weight=scale)
    length = {"accel_y": 2.0, "yaw_rate": 1.0}
    last = SimpleNamespace(residuals=e, jacobian=jacobian)
    frame = SimpleNamespace(problem=problem, balanced=balanced, last=last, values={}, at=None, length=length)
    values = [np.column_stack([2.0 * np.ones(30), np.ones(30), np.zeros(30)])] * 2
    asked = []

    def respond(p, v, at, place, forms):
        asked.append((p, place, [f.copy() for f in forms]))
        return np.column_stack([scale * response, scale * jacobian[:, 0], np.zeros(120)])

    monkeypatch.setattr(search, "compute_responses", respond)
    (first, second, third) = search.compute_expected_gain(frame, "yaw_moment", values)
    assert asked[0][0] is balanced and asked[0][1] == "yaw_moment"
    np.testing.assert_allclose(asked[0][2][0], np.column_stack([np.ones(30), np.ones(30), np.zeros(30)]))
    table = np.column_stack([scale * response, scale * jacobian[:, 0]])
    x = np.linalg.lstsq(table, -scale * e, rcond=None)[0]
    q = scale * jacobian[:, 0]
    before = scale * e - q * (q @ (scale * e)) / (q @ q)
    after = scale * e + table @ x
    nats = sum(
        0.5 * 60 / n * np.log((before[m] @ before[m]) / (after[m] @ after[m]))
        for m, n in ((slice(0, 60), 2.0), (slice(60, 120), 1.0))
    )
    assert first == (pytest.approx(nats), pytest.approx(x[0] / 2.0))  # of the form, whose rms is 2
    assert second == third == (pytest.approx(0.0, abs=1e-9), 0.0)


def test_a_form_that_begins_far_worse_is_not_fitted(monkeypatch):
    problem, _ = make_groups(("yaw_rate", [2.0] * 10))
    asked = []
    monkeypatch.setattr(
        search, "refit", lambda frame, formula, limits, cost: asked.append((formula, limits, cost))
    )
    first = 2.0
    problem.compute_residuals = lambda values: np.full(10, first)
    frame = SimpleNamespace(problem=problem, values={}, full=30.0)
    form = FormulaTerm("soft(yaw_rate/w)", (0, 0), (Size("w", 0.1, 0.02, 1.0, "rad/s", ""),))
    search._fit_formula(frame, "yaw_moment", form, -3.0)
    ((formula, limits, cost),) = asked
    assert formula.place == "yaw_moment" and cost == search.compute_price(form)
    assert limits["k"] == pytest.approx((-300.0, 300.0)) and limits["w"] == (0.02, 1.0)
    first = np.sqrt(1 + 302.0)  # the gap is 100 times that without a formula at 300
    assert search._fit_formula(frame, "yaw_moment", form, -3.0) == [] and len(asked) == 1
    first = np.sqrt(1 + 299.0)
    search._fit_formula(frame, "yaw_moment", form, -3.0)
    assert len(asked) == 2
    long = FormulaTerm("*".join(["yaw_rate"] * 30), (0, -30))
    assert search._fit_formula(frame, "yaw_moment", long, 1.0) == []  # for the library


@pytest.mark.parametrize(("value", "start", "scale"), [(-3.0, -1.0, 3.0), (0.5, 0.5, 0.5), (0.0, 0.0, 1e-9)])
def test_a_number_of_a_formula_starts_within_its_limits(value, start, scale):
    p = search._make_parameter("formula_a", "k", value, -1.0, 2.0, "1/s", "a text")
    assert (p.name, p.key, p.unit, p.low, p.high) == ("formula_a", "k", "1/s", -1.0, 2.0)
    assert p.default == start and p.scale == pytest.approx(scale) and p.prior is None and p.strength


def test_a_formula_is_fitted_with_the_stiffness_and_judged_with_all_weights():
    """Of a car with a yaw damper of -2 1/s, the front tyres of which are softer."""
    steer = 0.02 * np.sin(5.0 * 0.01 * np.arange(400))
    noise = {"accel_x": 1e-2, "accel_y": 1e-2, "yaw_rate": 1e-3}
    p = Problem([make_prepared(rows=400, steer=steer, noise=noise)], CAR)
    form = FormulaTerm("yaw_rate", (0, -1))
    p.measure({"cy_front": 0.9} | terms.make_formula("yaw_moment", form, -2.0).settings())
    start = dict.fromkeys((x.name for x in STIFFNESS_PARAMETERS), 1.0)
    e = p.compute_residuals(start)
    last = Fit(list(STIFFNESS_PARAMETERS), start, e, p.compute_jacobian(start, e, STIFFNESS_PARAMETERS))
    frame = search.Frame.of(p, last)
    limits = {"k": (-10.0, 10.0)}
    found = search.refit(frame, terms.make_formula("yaw_moment", form, -1.0), limits, 6.0)
    (k,) = found.formula.numbers
    assert k.value == pytest.approx(-2.0, rel=0.02) and found.limits == limits
    assert found.fit.values["cy_front"] == pytest.approx(0.9, rel=0.02)
    np.testing.assert_allclose(found.fit.residuals, p.compute_residuals(found.values))
    assert found.share > 0.99 and found.price == 6.0
    assert found.nats == pytest.approx(frame.compute_worth(found.fit.residuals) - 6.0)
    parameters = found.fit.parameters
    assert [x.name for x in parameters] == [*start, "formula_a"]
    held = p.holding(found.formula.settings())
    slopes = held.compute_jacobian(found.fit.values, found.fit.residuals, parameters)
    scale = np.abs(slopes).max(axis=0)
    np.testing.assert_allclose(found.fit.jacobian / scale, slopes / scale, atol=0.05)


def test_a_formula_is_fitted_with_balanced_weights_and_its_slopes_are_of_the_noise(monkeypatch):
    """Residuals of accel_x have the rms 5, so they get a fifth of their weight."""
    p, asked = Problem([make_prepared(steer=0.01)], CAR), []
    e = np.tile([1.0, -1.0], 75) * np.repeat([5.0, 0.5, 1.0], 50)
    frame = search.Frame.of(p, Fit(list(STIFFNESS_PARAMETERS), {"cy_rear": 0.9}, e, np.zeros((150, 3))))

    def fit(problem, parameters, start, most):
        asked.append((problem.weight, problem.fixed, start, most))
        return Fit(list(parameters), {"cy_rear": 0.8, "formula_a": -2.0}, e, np.ones((150, 4)))

    monkeypatch.setattr(search, "fit_parameters", fit)
    formula = terms.make_formula("yaw_moment", FormulaTerm("yaw_rate", (0, -1)), -1.0)
    found = search.refit(frame, formula, {"k": (-10.0, 10.0)}, 4.0)
    ((weight, fixed, start, most),) = asked
    np.testing.assert_allclose(weight / p.weight, np.repeat([0.2, 1.0, 1.0], 50))
    assert fixed == {"cy_rear": 0.9} | formula.settings() and most == 15
    assert start == {"cy_rear": 0.9, "formula_a": -1.0}
    np.testing.assert_allclose(found.fit.jacobian[:, 0], np.repeat([5.0, 1.0, 1.0], 50))
    (k,) = found.formula.numbers
    assert k.value == -2.0 and found.fit.values == {"cy_rear": 0.8, "formula_a": -2.0}
    whole = p.compute_residuals({"cy_rear": 0.8} | found.formula.settings())
    np.testing.assert_allclose(found.fit.residuals, whole)


# ---- choice


def make_candidate(nats: float, share: float, k: float = 1.0) -> search.Discovery:
    formula = parse("found", "a title", "yaw_moment", "k*yaw_rate", [Number("k", k, "1/s")])
    fit = Fit([], {"cy_rear": k}, np.zeros(0), np.zeros((0, 0)))
    return search.Discovery(formula, fit, nats, share, 4.0)


@pytest.fixture
def choose(monkeypatch):
    """Return a function: candidates and changes of held-out logs -> the choice."""
    monkeypatch.setattr(search, "_add_sentences", lambda frame, c: c)

    def run(*tried, rms=2.0, held=None):
        problem, e = make_groups(("yaw_rate", [rms] * 10))
        frame = SimpleNamespace(
            problem=problem,
            last=SimpleNamespace(residuals=e),
            values={"cy_rear": 0.0, Own("bank", 0, 0): 0.1},
        )
        if held is None:
            return search._choose_formula(frame, list(tried), None)
        other, _ = make_groups(("yaw_rate", [1.0] * 40))

        def compute_residuals(values):
            assert not any(isinstance(k, Own) for k in values)  # roads of other logs
            size = 3.0 if values["cy_rear"] == 0.0 else held[values["cy_rear"]][0]
            return size * np.tile([1.0, -1.0], 20)

        other.compute_residuals = compute_residuals
        monkeypatch.setattr(search, "compare_models", lambda p, before, after: {
            f"channel {i}": ChannelChange(1.0, 1.0, 0.0, ci)
            for i, ci in enumerate(next(v[1] for v in held.values() if v[0] == after[0]))
        })  # fmt: skip
        return search._choose_formula(frame, list(tried), other)

    return run


def test_the_formula_with_the_largest_gain_is_chosen_if_it_closes_enough(choose):
    small, large, none = (
        make_candidate(5.0, 0.2),
        make_candidate(9.0, 0.15, 2.0),
        make_candidate(30.0, 0.14, 3.0),
    )
    assert choose(none, large, small).formula == large.formula
    found = choose(none, small, large)
    assert found.formula == large.formula
    assert [t["held_out"] for t in found.tried] == [False, True, True]
    assert found.tried[1] == {
        "place": "yaw_moment",
        "formula": "k*yaw_rate",
        "nats": 5.0,
        "share": 0.2,
        "held_out": True,
    }
    dear = choose(none, make_candidate(0.0, 0.9))
    assert dear.formula is None and dear.fit is None and len(dear.tried) == 2
    assert dear.words == ["No formula is proposed: 2 formulas were simulated; none closes enough of the gap."]


@pytest.mark.parametrize(("rms", "there"), [(1.19, False), (1.21, True)])
def test_noise_is_not_explained_by_a_formula(choose, rms, there):
    assert (choose(make_candidate(9.0, 0.5), rms=rms).formula is not None) is there


@pytest.mark.parametrize(
    ("intervals", "there"),
    [
        ([(-0.5, -0.1)], True),
        ([(-0.5, 0.1)], False),  # perhaps no better
        ([(-0.5, -0.1), (0.005, 0.02)], True),  # a little worse
        ([(-0.5, -0.1), (0.02, 0.04)], False),
        ([(0.005, 0.02)], False),
    ],
)
def test_held_out_logs_must_become_better_and_no_channel_worse(choose, intervals, there):
    found = choose(make_candidate(9.0, 0.5), rms=1.0, held={1.0: (1.0, intervals)})
    assert (found.formula is not None) is there
    if not there:
        assert "the held-out logs contradict those that close enough" in found.words[0]


def test_held_out_logs_count_in_the_choice(choose):
    """Twenty independent residuals of three times the noise gain 20 ln 3 nats."""
    better = [(-0.9, -0.1)]
    one, two = make_candidate(9.0, 0.5, 1.0), make_candidate(5.0, 0.5, 2.0)
    found = choose(one, two, held={1.0: (2.9, better), 2.0: (0.5, better)})
    assert found.formula == two.formula
    assert two.changes["channel 0"].ci95 == better[0]
    assert [t["nats"] for t in found.tried] == [9.0, 5.0]  # of the fitted logs
    alike = {1.0: (0.5, better), 2.0: (0.5, better)}
    assert choose(two, one, held=alike).formula == one.formula  # the fitted logs count as well
    dear = choose(make_candidate(-0.1, 0.5), held={1.0: (0.5, better)})
    assert dear.formula is None and not dear.tried[0]["held_out"]  # its price in the fitted logs


def test_nothing_is_fitted_again_where_nothing_was_found():
    nothing = search.Discovery(None, None)
    assert search.refit_on_all(None, None, nothing) is nothing


def test_a_formula_of_an_excerpt_is_fitted_to_all_logs_with_its_limits_and_its_price(monkeypatch):
    c, again, asked = replace(make_candidate(9.0, 0.5), limits={"k": (-3.0, 3.0)}), None, []
    again = replace(make_candidate(99.0, 0.3, 2.0), price=7.0)
    monkeypatch.setattr(search.Frame, "of", lambda problem, last: (problem, last))
    monkeypatch.setattr(search, "refit", lambda *given: asked.append(given) or again)
    monkeypatch.setattr(search, "_add_sentences", lambda frame, c: replace(c, words=[frame]))
    found = search.refit_on_all("all", "last", c)
    assert asked == [(("all", "last"), c.formula, {"k": (-3.0, 3.0)}, 4.0)]
    assert found.formula is again.formula and found.fit is again.fit and found.share == 0.3
    assert (found.nats, found.price, found.words) == (9.0, 4.0, [("all", "last")])


def test_a_formula_is_stated_with_its_sd_and_with_what_was_driven():
    problem, e = make_groups(("yaw_rate", [2.0, -2.0] * 50))
    problem.logs = [SimpleNamespace(name="a"), SimpleNamespace(name="b")]
    c = make_candidate(9.0, 0.567)
    slope = np.linspace(-1.0, 1.0, 100)
    c = replace(c, fit=Fit([make_parameter("formula_a")], {"formula_a": 1.0}, e, slope[:, None]))
    at = [{"yaw_rate": np.linspace(-1.0, 0.0, 501), "dt": np.ones(501), "vel_x": np.ones(501)}]
    at.append({"yaw_rate": np.linspace(0.0, 3.0, 500), "dt": np.ones(500), "vel_x": np.ones(500)})
    frame = SimpleNamespace(problem=problem, at=at)
    found = search._add_sentences(frame, c)
    (k,) = found.formula.numbers
    assert k.sd == pytest.approx(2.0 / np.sqrt(slope @ slope))
    low, high = found.formula.found["driven_yaw_rate"]
    assert (low, high) == pytest.approx((-1.0 + 0.005 * 1000 * 0.002, 3.0 * (1.0 - 5.0 / 499)), abs=1e-2)
    assert found.formula.found["share_of_gap_closed"] == 0.567
    assert list(found.formula.found["logs"]) == ["a", "b"]
    assert "driven_vel_x" not in found.formula.found and "driven_dt" not in found.formula.found
    assert found.words[0].startswith("A formula closes 57 % of the remaining gap: k*yaw_rate, at yaw_moment.")


# ---- the search as a whole


def test_every_form_is_compared_with_its_own_gain_less_its_price(monkeypatch):
    """More forms than are compared at a time; the signals are those of two logs."""
    forms = [FormulaTerm("yaw_rate" + "*vel_x" * (k % 3), (0, 0)) for k in range(70)]
    at = [{"dt": np.ones(2)}, {"dt": np.ones(3)}]
    asked = []

    def gain(frame, place, logs):
        asked.append([x.shape for x in logs])
        return [(float(x), -float(x)) for x in logs[0][0]]

    index = iter(range(1000))
    monkeypatch.setattr(terms, "list_forms", lambda place: forms)
    monkeypatch.setattr(terms, "compute_values", lambda t, s, dt: np.full(len(dt), float(next(index))))
    monkeypatch.setattr(search, "compute_expected_gain", gain)
    found = search.screen_forms(SimpleNamespace(at=at), "force_y")
    assert asked == [[(2, 64), (3, 64)], [(2, 6), (3, 6)]]
    assert [x[2] for x in found] == forms and {x[1] for x in found} == {"force_y"}
    gains = [*range(64), *range(128, 134)]  # of the first log
    expected = [(g - 2.0 * (1 + k % 3 + 1), -g) for k, g in enumerate(gains)]
    assert [(x[0], x[3]) for x in found] == expected


def test_candidates_are_simulated_from_the_best_on_and_the_best_fit_comes_first(monkeypatch):
    a, b = FormulaTerm("a", (0, 0)), FormulaTerm("b", (0, 0))
    screened = {
        "force_y": [(1.0, "force_y", a, 0.1), (7.0, "force_y", b, 0.2)],
        "accel_x": [(4.0, "accel_x", a, 0.3)],
    }
    fitted, said, chosen = [], [], []
    worth = {"force_y b": 2.0, "accel_x a": 5.0, "force_y a": 3.0}

    def fit(frame, place, term, coefficient):
        fitted.append((place, term.text, coefficient))
        return [SimpleNamespace(nats=worth[f"{place} {term.text}"])]

    monkeypatch.setattr(search.Frame, "of", lambda p, last: ("frame", p, last))
    monkeypatch.setattr(search, "_list_places", lambda p: list(screened))
    monkeypatch.setattr(search, "screen_forms", lambda frame, place: screened[place])
    monkeypatch.setattr(search, "_fit_formula", fit)
    monkeypatch.setattr(search, "_choose_formula", lambda *x: chosen.append(x) or "the choice")
    assert search.discover_formula("problem", "last", "held", said.append) == "the choice"
    assert fitted == [("force_y", "b", 0.2), ("accel_x", "a", 0.3), ("force_y", "a", 0.1)]
    ((frame, tried, held),) = chosen
    assert frame == ("frame", "problem", "last") and held == "held"
    assert [c.nats for c in tried] == [5.0, 3.0, 2.0]
    assert said[1:] == [
        f"searching for a formula: fit of candidate {k} of 3, {x}"
        for k, x in ((1, "b at force_y"), (2, "a at accel_x"), (3, "a at force_y"))
    ]
    assert "for 2 quantities of the model" in said[0]
