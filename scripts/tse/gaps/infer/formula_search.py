"""Search for a formula that explains the residuals that the named effects leave, and for
the place of the model at which it acts, such as the yaw moment. Named effects are those
that the search for effects reports as missing in the vehicle file.

A form is a formula without its coefficient (formula_terms.py). All forms at all places
are first compared in a linearised model. Those with the largest expected gain are then
simulated, and stiffness, named effects and the numbers of the formula are fitted
together. Held-out logs, if there are any, decide whether a formula is proposed.

The gain of a formula in nats is a sum over the channels: half the number of independent
residuals, times ln(sum of squares before / sum of squares after). Because of the
logarithm, no channel dominates the others. PRICE is subtracted for each operation and
each number of the formula.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tse.car.formula import Formula, FormulaError
from tse.gaps.catalogue import CatalogueParameter, drop_log_values
from tse.gaps.fit import (
    NOISE_LIMIT,
    ChannelChange,
    Fit,
    compare_models,
    compute_correlation_lengths,
    compute_covariance,
    compute_excess,
    compute_gap,
    fit_parameters,
)
from tse.gaps.infer import formula_terms as terms
from tse.gaps.infer.formula_terms import FormulaTerm
from tse.gaps.problem import Problem
from tse.gaps.respond import compute_responses, compute_signals
from tse.identify.data import COMPARED_CHANNELS

# [nat] Price of each operation and of each number of a formula, subtracted from its gain.
# Among n formulas that only fit noise, the best one gains about ln n. n is the number of
# forms, times places of the model, times start values of the numbers. Here ln n is about
# 12: the price of six operations and numbers.
PRICE = 2.0
FITTED = 6  # max number of candidates, i.e. of formulas that are simulated
PER_PLACE = 3  # max number of candidates that add to the same quantity of the model
# A formula is not fitted if the gap at the start of its fit is more than MAX_WORSE times
# the gap without a formula. The gap is the sum of squared residuals minus the sum
# expected from sensor noise.
MAX_WORSE = 100.0
MIN_SHARE = 0.15  # min share of the gap that a proposed formula closes
# A formula is not proposed if it makes a channel worse in the held-out logs: if the whole
# 95 % interval of the relative increase of the channel's residual rms is above MIN_HARM
MIN_HARM = 0.01
MAX_FORM_EVALUATIONS = 15  # max number of evaluations of the residuals in one fit
# number of forms, i.e. of formulas without coefficient, that are compared at a time. It
# limits the memory that is needed.
FORMS_AT_A_TIME = 64
# [%] A proposed formula is reported together with the range of each of its signals in the
# logs: from percentile HALF to percentile 100 - HALF
HALF = 0.5


@dataclass
class Discovery:
    """A fitted formula: a candidate, or the result of a search.

    `formula` is None if the search found no formula that is worth proposing.
    """

    formula: Formula | None
    # The fit with the formula; None without a formula. It is made with the weights of
    # Frame.balanced, but its residuals are divided by the sd of the sensor noise.
    fit: Fit | None
    nats: float = 0.0  # [nat] gain in ln likelihood by the formula, minus `price`
    # share of the gap that the formula closes. Gap: sum of squared residuals without a
    # formula, minus the sum expected from sensor noise (Frame.full)
    share: float = 0.0
    price: float = 0.0  # [nat] penalty for the length of the formula (compute_price())
    # name of a number of the formula -> lower and upper bound of this number in the fit
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    # channel -> change of the residuals of the held-out logs by the formula
    changes: dict[str, ChannelChange] = field(default_factory=dict)
    # for each simulated candidate a dict with the keys place, formula, nats, share and
    # held_out. The value of held_out is True if the candidate is confirmed
    # (_choose_formula()).
    tried: list[dict] = field(default_factory=list)
    words: list[str] = field(default_factory=list)  # sentences for the user

    @property
    def values(self) -> dict[str, float]:
        """The values of the fit and the settings of the formula, for a simulation."""
        assert self.fit is not None and self.formula is not None
        return self.fit.values | self.formula.settings()


@dataclass
class Frame:
    """Data that the search for a formula needs for every candidate."""

    problem: Problem
    # The problem with smaller weights for channels with large residuals, so that no
    # channel dominates the fit. With these weights, the residuals of each channel have at
    # most the rms 1 in the fit without a formula.
    balanced: Problem
    last: Fit  # the fit without a formula
    values: dict[str, float]  # fitted values of the parameters in `last`
    # channel -> number of consecutive residuals that together have the information of one
    # independent residual (compute_correlation_lengths())
    length: dict[str, float]
    # for each log: name of a signal -> its simulated values (compute_signals())
    at: list[dict[str, np.ndarray]]
    # gap without a formula: sum of squared residuals minus the sum expected from sensor
    # noise (compute_excess())
    full: float

    @classmethod
    def of(cls, problem: Problem, last: Fit) -> Frame:
        """Return the data for the search for a formula. `last` is the fit without a
        formula."""
        balanced = copy.copy(problem)
        balanced.weight = problem.weight.copy()
        for _, mine in problem.used():
            balanced.weight[mine] /= max(1.0, float(np.sqrt(np.mean(last.residuals[mine] ** 2))))
        values = dict(last.values)
        return cls(
            problem,
            balanced,
            last,
            values,
            compute_correlation_lengths(problem, last.residuals),
            compute_signals(problem, values),
            compute_excess(problem, last.residuals),
        )

    def compute_worth(self, residuals: np.ndarray) -> float:
        """Return the gain [nat] of a formula relative to the fit without it (`last`).

        `residuals` are those of the fit with the formula."""
        return compute_worth(self.problem, self.last.residuals, residuals, self.length)


def compute_worth(
    problem: Problem, before: np.ndarray, after: np.ndarray, length: Mapping[str, float]
) -> float:
    """Return the gain in log likelihood [nat] if the residuals change from `before` to
    `after`.

    `length` is the correlation length of the residuals of each channel: the number of
    consecutive residuals that together have the information of one independent residual
    (compute_correlation_lengths()).
    """
    total = 0.0
    for c, mine in problem.used():
        one, two = (float(r[mine] @ r[mine]) for r in (before, after))
        total += 0.5 * mine.sum() / length[c] * np.log(max(one, 1e-300) / max(two, 1e-300))
    return float(total)


def compute_price(term: FormulaTerm) -> float:
    """Return the price [nat] of a formula: PRICE times the sum of the length of its form
    (1 + number of operators and opening parentheses), the number of numbers in the form,
    and 1 for the coefficient."""
    return PRICE * (term.price + len(term.sizes) + 1)


def discover_formula(
    problem: Problem, last: Fit, held: Problem | None = None, say: Callable[[str], None] = lambda _: None
) -> Discovery:
    """Find the formula that best explains the residuals of a fit.

    `last` is the fit of `problem` with all named effects, i.e. those that the search for
    effects reported as missing in the vehicle file. `held` has the held-out logs, which
    decide whether a formula is proposed. None: there are no held-out logs.

    Each of the FITTED candidates needs about ten simulations of all logs. All candidates
    together take about a minute if the logs are a few minutes long.
    """
    frame = Frame.of(problem, last)
    places = _list_places(problem)
    forms = sum(len(terms.list_forms(p)) for p in places)
    say(f"searching for a formula: {forms} formulas for {len(places)} quantities of the model")
    listed = sorted((x for p in places for x in screen_forms(frame, p)), key=lambda x: -x[0])
    chosen = _choose_diverse(listed)
    tried: list[Discovery] = []
    for k, (_, place, term, coefficient) in enumerate(chosen):
        say(f"searching for a formula: fit of candidate {k + 1} of {len(chosen)}, {term.text} at {place}")
        tried += _fit_formula(frame, place, term, coefficient)
    tried.sort(key=lambda c: -c.nats)
    return _choose_formula(frame, tried, held)


def _list_places(problem: Problem) -> list[str]:
    """Return the places of the model at which a formula can be fitted to these logs.

    At the places of terms.LATERAL, such as the yaw moment, a formula can be fitted only
    if the logs have accel_y and yaw_rate. At the output of a sensor, such as accel_x, it
    can be fitted only if the logs have the channel of this sensor.
    """
    there = {c for log in problem.logs for c in log.channels}
    lateral = terms.LATERAL if {"accel_y", "yaw_rate"} <= there else ()
    return [p for p in (*lateral, *terms.LONGITUDINAL) if p not in COMPARED_CHANNELS or p in there]


def _choose_diverse(
    listed: list[tuple[float, str, FormulaTerm, float]],
) -> list[tuple[float, str, FormulaTerm, float]]:
    """Return the candidates with the largest positive gain: at most FITTED in total, and
    at most PER_PLACE at a place. The same form at the same place is returned only once,
    with the best start values of its numbers.

    `listed` has the results of screen_forms(), sorted by falling gain.
    """
    found: list[tuple[float, str, FormulaTerm, float]] = []
    for one in listed:
        _, place, term, _ = one
        same = sum(p == place for _, p, _, _ in found)
        if (
            one[0] > 0
            and same < PER_PLACE
            and not any(p == place and t.text == term.text for _, p, t, _ in found)
        ):
            found.append(one)
        if len(found) == FITTED:
            break
    return found


# ---- comparison of forms (formulas without coefficient) in the linearised model


def screen_forms(frame: Frame, place: str) -> list[tuple[float, str, FormulaTerm, float]]:
    """Return for each form at a place: (expected gain - price [nat], place, form,
    coefficient). A form is a formula without its coefficient.

    The coefficient is fitted to the residuals in the linearised model, together with
    stiffness and named effects. The gain is the increase of the log likelihood. The price
    is the penalty for the length of the form (compute_price()).
    """
    known, found = terms.list_forms(place), []
    for k in range(0, len(known), FORMS_AT_A_TIME):
        part = known[k : k + FORMS_AT_A_TIME]
        logs = [np.column_stack([terms.compute_values(t, s, s["dt"]) for t in part]) for s in frame.at]
        for t, (nats, coefficient) in zip(part, compute_expected_gain(frame, place, logs), strict=True):
            found.append((nats - compute_price(t), place, t, coefficient))
    return found


def compute_expected_gain(frame: Frame, place: str, logs: list[np.ndarray]) -> list[tuple[float, float]]:
    """Return for each form: (expected gain [nat], coefficient), in the linearised model.

    `logs` has one array for each log, with the shape (blocks, forms): the values of the
    forms in each block, i.e. in each interval of 40 ms over which signals are averaged.
    """
    problem, balanced = frame.problem, frame.balanced
    size = np.sqrt(sum(np.sum(x**2, axis=0) for x in logs) / max(sum(len(x) for x in logs), 1))
    size = np.where(np.isfinite(size) & (size > 1e-12), size, np.inf)
    a = compute_responses(balanced, frame.values, frame.at, place, [np.nan_to_num(x / size) for x in logs])
    scale = np.where(
        problem.weight > 0, balanced.weight / np.where(problem.weight > 0, problem.weight, 1.0), 0.0
    )
    target = scale * frame.last.residuals
    q = np.linalg.qr(scale[:, None] * frame.last.jacobian)[0]
    a, target = a - q @ (q.T @ a), target - q @ (q.T @ target)
    power = np.sum(a * a, axis=0)
    x = np.where(power > 1e-9, -(a.T @ target) / np.maximum(power, 1e-9), 0.0)
    nats = np.zeros(a.shape[1])
    for c, mine in problem.used():
        before = float(target[mine] @ target[mine])
        after = np.sum((target[mine, None] + a[mine] * x) ** 2, axis=0)
        nats += 0.5 * mine.sum() / frame.length[c] * np.log(max(before, 1e-300) / np.maximum(after, 1e-300))
    return [(float(n), float(v)) for n, v in zip(nats, x / size, strict=True)]


# ---- fit of candidates with the full simulation


def _fit_formula(frame: Frame, place: str, term: FormulaTerm, coefficient: float) -> list[Discovery]:
    """Fit a formula together with stiffness and named effects. Return a list with the
    result.

    The list is empty if the library does not accept so long a formula, or if the gap at
    the start of the fit is more than MAX_WORSE times the gap without a formula.
    """
    try:
        formula = terms.make_formula(place, term, coefficient)
    except FormulaError:
        return []
    limits = {n.name: (-100.0 * abs(n.value) - 1e-9, 100.0 * abs(n.value) + 1e-9) for n in formula.numbers}
    limits |= {s.name: (s.low, s.high) for s in term.sizes}
    first = frame.problem.compute_residuals(frame.values | formula.settings())
    if compute_excess(frame.problem, first) > MAX_WORSE * max(frame.full, 1.0):
        return []
    return [refit(frame, formula, limits, compute_price(term))]


def refit(
    frame: Frame, formula: Formula, limits: Mapping[str, tuple[float, float]], cost: float
) -> Discovery:
    """Fit stiffness, named effects and the numbers of a formula together. `limits` has
    the lower and upper limit of each number, and `cost` is the price of the formula
    [nat].
    """
    slots = formula.slots
    own = [
        _make_parameter(slots[n.name], n.name, n.value, *limits[n.name], n.unit, n.text)
        for n in formula.numbers
    ]
    problem = frame.balanced.holding(frame.values | formula.settings())
    found = fit_parameters(
        problem,
        [*frame.last.parameters, *own],
        frame.values | {p.name: p.default for p in own},
        most=MAX_FORM_EVALUATIONS,
    )
    formula = formula.with_values({p.key: found.values[p.name] for p in own})
    values = frame.values | found.values
    whole = frame.problem.compute_residuals(values | formula.settings())
    back = np.where(
        problem.weight > 0, frame.problem.weight / np.where(problem.weight > 0, problem.weight, 1.0), 0.0
    )
    one = Fit(found.parameters, values, whole, back[:, None] * found.jacobian)
    left = compute_excess(frame.problem, whole)
    share = 1.0 - left / frame.full if frame.full > 0 else 0.0
    return Discovery(formula, one, frame.compute_worth(whole) - cost, share, cost, dict(limits))


def _make_parameter(
    name: str, key: str, value: float, low: float, high: float, unit: str, text: str
) -> CatalogueParameter:
    size = max(abs(value), 1e-9)
    return CatalogueParameter(
        name, key, True, unit, float(np.clip(value, low, high)), low, high, size, size, 0.0, 0, text
    )


# ---- choice of the formula


def _choose_formula(frame: Frame, tried: list[Discovery], held: Problem | None) -> Discovery:
    """Return the confirmed formula with the largest total gain in fitted and held-out
    logs.

    A confirmed formula has a positive gain after its price, and closes at least MIN_SHARE
    of the gap. In addition:

    - With held-out logs, which are not used in the fit, at least one of their channels
      becomes significantly better (95 % interval), and none becomes significantly worse
      by more than MIN_HARM.
    - Without held-out logs, the fit without the formula leaves in a channel a residual
      rms of more than NOISE_LIMIT times the sensor noise. Smaller residuals are noise,
      and one of so many forms always fits noise.
    """
    shown, chosen, best = [], None, 0.0
    shows = held is not None or max(compute_gap(frame.problem, frame.last.residuals).values()) > NOISE_LIMIT
    if held is not None:
        before = held.compute_residuals(drop_log_values(frame.values))
        length = compute_correlation_lengths(held, before)
    for c in tried:
        confirmed, total = shows and c.nats > 0 and c.share >= MIN_SHARE, c.nats
        if confirmed and held is not None:
            after = held.compute_residuals(drop_log_values(c.values))
            c.changes = compare_models(held, before, after)
            total += compute_worth(held, before, after, length)
            confirmed = all(x.ci95[0] <= MIN_HARM for x in c.changes.values()) and any(
                x.better for x in c.changes.values()
            )
        shown.append(
            {
                "place": c.formula.place,
                "formula": c.formula.text,
                "nats": c.nats,
                "share": c.share,
                "held_out": confirmed,
            }
        )
        if confirmed and total > best:
            chosen, best = c, total
    if chosen is None:
        why = (
            "the held-out logs contradict those that close enough of the gap"
            if any(c.changes for c in tried)
            else "none closes enough of the gap"
        )
        words = [f"No formula is proposed: {len(tried)} formulas were simulated; {why}."]
        return Discovery(None, None, tried=shown, words=words)
    return _add_sentences(frame, replace(chosen, tried=shown))


def refit_on_all(problem: Problem, last: Fit, found: Discovery) -> Discovery:
    """Fit a formula, which was found in an excerpt of the logs, to all logs.

    `problem` has all logs. `last` is the fit to all logs with all named effects, but
    without the formula.
    """
    if found.formula is None:
        return found
    frame = Frame.of(problem, last)
    again = refit(frame, found.formula, found.limits, found.price)
    return _add_sentences(frame, replace(found, formula=again.formula, fit=again.fit, share=again.share))


def _add_sentences(frame: Frame, c: Discovery) -> Discovery:
    """Return the result with sentences for the user that describe the formula."""
    formula = _describe_formula(frame, c)
    words = [
        f"A formula closes {100 * c.share:.0f} % of the remaining gap: {formula.text}, at {formula.place}. "
        "It is a fit and does not identify the cause. It is valid only in the range that was driven."
    ]
    return replace(c, formula=formula, words=words)


def _describe_formula(frame: Frame, c: Discovery) -> Formula:
    """Return the formula with the sd of each number, and with the range of values that
    each of its signals had in the logs.
    """
    slots = c.formula.slots
    sd = dict(
        zip(
            (p.name for p in c.fit.parameters),
            np.sqrt(np.maximum(np.diag(compute_covariance(frame.problem, c.fit)), 0.0)),
            strict=True,
        )
    )
    numbers = tuple(replace(n, sd=float(sd[slots[n.name]])) for n in c.formula.numbers)
    driven = {}
    for name in frame.at[0]:
        if name != "dt" and name in c.formula.text:
            x = np.concatenate([s[name] for s in frame.at])
            driven[name] = [float(np.percentile(x, q)) for q in (HALF, 100.0 - HALF)]
    found: dict = {f"driven_{k}": v for k, v in driven.items()}
    found |= {"share_of_gap_closed": c.share, "logs": [log.name for log in frame.problem.logs]}
    return replace(c.formula, numbers=numbers, found=found)
