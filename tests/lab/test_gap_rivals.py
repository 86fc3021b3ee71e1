"""Names against formulas: the probability of a world.

It is tested on drawn residuals, and on a log whose steering ratio depends on speed.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from tse.gaps.catalogue import load_catalogue
from tse.gaps.infer import rivals
from tse.gaps.infer.hypotheses import NAME_AT, SIZE_COST, make_hypotheses
from tse.gaps.infer.naming import Named
from tse.gaps.infer.rivals import Worlds, compute_name_price
from tse.gaps.infer.search import compute_error_duration
from tse.gaps.infer.space import LASTING

ROWS = 3000


def make_one_log_problem():
    """Return a problem of one log with accel_y alone."""
    every = np.ones(ROWS, bool)
    rows = SimpleNamespace(of=lambda channel: every, group=np.zeros(ROWS, int))
    return SimpleNamespace(rows=rows, used=lambda: [("accel_y", every)], noise_energy=np.ones(ROWS), jobs=1)


def fit(rms):
    return SimpleNamespace(residuals=rms * np.random.default_rng(1).standard_normal(ROWS), values={})


def make_naming(rms, *names):
    named = [SimpleNamespace(effect=SimpleNamespace(id=n), probability=1.0, whole=1.0) for n in names]
    return SimpleNamespace(final=fit(rms), named=named)


def make_formula_result(rms, length):
    return SimpleNamespace(fit=fit(rms), values={}, price=2.0 * length, formula=SimpleNamespace(text="k*x"))


def make_worlds(*known):
    w = Worlds(make_one_log_problem(), None)
    for n, *found in known:
        w.add(n, n.final, *found)
    w.weigh()
    return w


def test_a_name_costs_its_prior_odds_and_its_size():
    known = {h.id: h for h in make_hypotheses()}
    assert compute_name_price("mass") == pytest.approx(SIZE_COST - known["mass"].odds)
    assert compute_name_price("mass") > compute_name_price("body_roll") > SIZE_COST  # every car rolls
    assert compute_name_price("grade") == pytest.approx(
        SIZE_COST + np.log(9.0)
    )  # a road is no hypothesis of the search


def test_alike_in_residuals_the_shorter_is_likelier_by_its_price():
    w = make_worlds((make_naming(1.0, "mass"),), (make_naming(1.0, "mass", "body_roll"),))
    assert w.known[0].probability / w.known[1].probability == pytest.approx(
        np.exp(compute_name_price("body_roll"))
    )
    assert w.with_name("mass") == pytest.approx(1.0)
    assert w.find_best() is w.known[0]


def test_near_the_noise_a_square_counts_as_much_as_everywhere_there():
    """As many values of noise as LASTING leaves of them."""
    names = ("body_roll", "relaxation", "cg_shift")
    w = make_worlds((make_naming(1.1, "mass"),), (make_naming(1.0, "mass", *names),))
    ratio = np.log(w.known[1].probability) - np.log(w.known[0].probability)
    fall = 0.21 * float(np.sum(fit(1.0).residuals ** 2))
    assert ratio == pytest.approx(
        0.5 * fall / (1.0 + compute_error_duration() * LASTING**2) - sum(map(compute_name_price, names)),
        rel=1e-6,
    )


def test_a_patchwork_of_names_does_not_stand_beside_a_formula_that_is_shorter():
    """Both leave more than noise, so the part that the names close besides counts little.

    A formula stands.
    """
    names = ("mass", "yaw_inertia", "cg_shift", "rear_roll_steer", "combined_slip", "body_roll")
    empty = make_naming(10.0)
    w = make_worlds((make_naming(2.0, *names),), (empty, make_formula_result(2.5, 5)))
    assert w.with_name("mass") < NAME_AT
    assert w.find_best() is w.known[1]
    assert w.find_best().text == "k*x"


def test_one_name_that_closes_as_much_as_a_formula_stands():
    empty = make_naming(10.0)
    w = make_worlds((make_naming(2.0, "mass"),), (empty, make_formula_result(2.0, 5)))
    assert w.with_name("mass") > NAME_AT
    assert w.known[1].probability / w.known[0].probability == pytest.approx(
        np.exp(compute_name_price("mass") - 10.0 - np.log(4.0))
    )


def test_a_formula_beside_a_name_is_asked_with_both_prices():
    one = make_naming(3.0, "body_roll")
    w = make_worlds(
        (one,),
        (one, make_formula_result(1.0, 5)),
        (make_naming(10.0),),
        (make_naming(10.0), make_formula_result(3.0, 5)),
    )
    assert w.find_best() is w.known[1]
    assert w.with_name("body_roll") > 0.99


def test_held_out_logs_count_as_much_as_those_that_were_fitted():
    """A formula that does nothing for other logs is worth half the nats."""
    other = make_one_log_problem()
    other.compute_residuals = lambda values: values["rms"] * np.random.default_rng(2).standard_normal(ROWS)
    nothing = make_naming(1.3)
    nothing.final.values = {"rms": 1.3}
    works, fails = make_formula_result(1.0, 5), make_formula_result(1.0, 5)
    works.values, fails.values = {"rms": 1.0}, {"rms": 1.3}
    w = Worlds(make_one_log_problem(), other)
    for d in (None, works, fails):
        w.add(nothing, nothing.final, d)
    w.weigh()
    assert w.find_best() is w.known[1]
    assert w.known[2].probability < 1e-6


def test_nothing_is_a_world_too():
    """Neither names nor a formula closed anything, so there is no other world."""
    w = make_worlds((make_naming(9.0),))
    assert w.find_best() is w.known[0]
    assert w.find_best().probability == 1.0


def test_a_name_that_a_formula_makes_doubtful_is_not_kept(monkeypatch):
    """Its probability is that of the search times that of the worlds that have it.

    90 % of 95 % is too little for a name.
    """
    one = make_naming(2.0, "mass")
    one.named[0].whole, one.named[0].probability, one.baseline, one.closed = 0.95, 0.95, fit(10.0), 0.9
    found = SimpleNamespace(fit=fit(2.01), values={}, price=6.0, formula=SimpleNamespace(text="k*x"))
    nothing, kept = make_naming(10.0), []
    monkeypatch.setattr(rivals, "refit_world", lambda _, last: last)
    monkeypatch.setattr(rivals, "replace", lambda n, **changes: SimpleNamespace(**(vars(n) | changes)))
    monkeypatch.setattr(
        rivals,
        "discover_formula",
        lambda _p, last, *_: found if last is nothing.final else SimpleNamespace(formula=None),
    )
    monkeypatch.setattr(rivals, "refit_on_all", lambda _p, _last, discovery: discovery)
    monkeypatch.setattr(
        rivals.name, "drop_names", lambda _p, _n, names, why: kept.append((names, why)) or nothing
    )
    _, names, shown = rivals.explain_remainder(make_one_log_problem(), None, one, lambda _: None)
    share = sum(r["probability"] for r in shown if r["ids"] == ["mass"])
    assert NAME_AT < share < NAME_AT / 0.95
    assert kept[-1] == (frozenset(), "below 90 %") and names is nothing


@pytest.mark.parametrize(("rms", "formulas"), [(2.01, [None, "k*x"]), (1.5, ["k*x", None])])
def test_a_name_is_as_probable_as_in_its_search_times_its_worlds(monkeypatch, rms, formulas):
    """The fits of all worlds are made again, and the likeliest world is shown first."""
    one, nothing = make_naming(99.0, "mass"), make_naming(98.0)
    one.named[0].probability, one.closed, one.baseline, nothing.possible = 0.95, 0.9, fit(10.0), []
    again = {id(one.final): fit(2.0), id(nothing.final): fit(10.0)}
    found = SimpleNamespace(fit=fit(rms), values={}, price=6.0, formula=SimpleNamespace(text="k*x"))
    monkeypatch.setattr(rivals, "refit_world", lambda _, last: again[id(last)])
    monkeypatch.setattr(rivals, "replace", lambda n, **changes: SimpleNamespace(**(vars(n) | changes)))
    monkeypatch.setattr(
        rivals,
        "discover_formula",
        lambda _p, last, *_: found if last is again[id(nothing.final)] else SimpleNamespace(formula=None),
    )
    monkeypatch.setattr(rivals.name, "drop_names", lambda *_: nothing)
    _, naming, shown = rivals.explain_remainder(make_one_log_problem(), None, one, lambda _: None)
    assert [w["formula"] for w in shown] == formulas
    assert [n.effect.id for n in naming.named] == (["mass"] if formulas[0] is None else [])
    for n in naming.named:
        share = shown[0]["probability"]
        assert 0.9 < share < 0.95
        assert n.probability == pytest.approx(0.95 * share) and n.whole == pytest.approx(share)


def test_a_name_that_a_formula_leaves_nothing_of_is_not_kept(monkeypatch):
    """Beside the formula its interval, as wide as before, holds zero."""
    effect = load_catalogue()["gyro_scale"]
    (p,) = effect.strengths
    named = [Named(effect, {p.name: x}, {p.name: (x - 0.01, x + 0.01)}, 0.5, 40.0) for x in (0.02, 0.03)]
    both = SimpleNamespace(named=named)
    found = SimpleNamespace(fit=SimpleNamespace(values={p.name: 0.005}), formula=SimpleNamespace(text="k*x"))
    fewer, kept = SimpleNamespace(named=[], final=None), []
    monkeypatch.setattr(
        rivals.name, "drop_names", lambda _p, _n, names, why: kept.append((names, why)) or fewer
    )
    monkeypatch.setattr(rivals, "refit_on_all", lambda _p, _last, discovery: discovery)
    assert rivals.find_formula_beside(None, both, found) == (found, fewer) and kept == [
        (frozenset(), rivals.INSTEAD)
    ]
    found.fit.values = {p.name: 0.02}
    assert rivals.find_formula_beside(None, both, found) == (found, both)


def test_names_that_close_hardly_anything_are_not_kept(monkeypatch):
    one, nothing, kept = make_naming(9.7, "mass"), make_naming(10.0), []
    one.baseline, one.closed = fit(10.0), 0.07
    monkeypatch.setattr(rivals, "refit_world", lambda _, last: last)
    monkeypatch.setattr(rivals, "replace", lambda n, **changes: SimpleNamespace(**(vars(n) | changes)))
    monkeypatch.setattr(rivals, "discover_formula", lambda *_: SimpleNamespace(formula=None))
    monkeypatch.setattr(
        rivals.name, "drop_names", lambda _p, _n, names, why: kept.append((names, why)) or nothing
    )
    _, names, _ = rivals.explain_remainder(make_one_log_problem(), None, one, lambda _: None)
    assert not names.named and kept == [
        (frozenset(), "the named effects together close less than 20 % of the gap")
    ]


def test_what_is_said_of_a_formula_is_what_is_proposed(monkeypatch):
    """A log is so short that a formula is hardly worth its length.

    Beside the names that stand, the formula is proposed as its own search has judged, in
    the same words. Otherwise it is not proposed, and there are no words.
    """
    short = make_naming(2.0)
    short.baseline, short.closed, short.possible = fit(2.0), 0.0, []
    found = SimpleNamespace(
        fit=fit(1.8), values={}, price=20.0, formula=SimpleNamespace(text="k*x"), words=["A formula"]
    )
    monkeypatch.setattr(rivals, "discover_formula", lambda *_: found)
    monkeypatch.setattr(rivals, "refit_world", lambda _, last: last)
    monkeypatch.setattr(rivals, "replace", lambda n, **changes: SimpleNamespace(**(vars(n) | changes)))
    last, names, shown = rivals.explain_remainder(make_one_log_problem(), None, short, lambda _: None)
    assert last is found and not names.named
    assert [r["formula"] for r in shown] == [None, "k*x"]  # the likelier first
    assert sum(r["probability"] for r in shown) == pytest.approx(1.0)
