"""Search of formula and place: forms are chosen in a linearisation, those with the
largest expected gain are simulated with the stiffness and everything named fitted
beside them, complexity has a price, and logs that were held out have the last word.

Worth of a formula, nats: sum over channels of half the independent values of its residual
x ln of how much it falls, so that no channel drowns another; less PRICE for every
operation and number.
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

# nats: of an operation or a number: a library of some hundred forms times places times
# sizes is some 12 nats
PRICE = 2.0
FITTED = 6  # candidates that are simulated
PER_PLACE = 3  # of them at one place, most
MAX_WORSE = 100.0  # of the gap: a form that begins with more explains nothing
MIN_SHARE = 0.15  # of the gap, that a formula must close to be worth reading
# relative rise of a channel of the held-out logs by which it forbids a formula
MIN_HARM = 0.01
MAX_STEPS = 15  # of a fit
CHUNK = 64  # forms that are looked at together: memory
# %: quantiles between which a signal has been are those of HALF % and 100 - HALF %
HALF = 0.5


@dataclass
class Discovery:
    """A formula, fitted: one that was tried, or what a search came to.

    `formula` None: nothing that is worth proposing.
    """

    formula: Formula | None
    fit: Fit | None  # residuals and slopes of the problem as it is
    nats: float = 0.0  # worth, less its price
    share: float = 0.0  # of what was left that it closes
    price: float = 0.0  # nats, of its length
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)  # of its numbers
    changes: dict[str, ChannelChange] = field(default_factory=dict)  # on held-out logs
    tried: list[dict] = field(
        default_factory=list
    )  # place, formula, nats, share, and whether held-out logs confirm it
    words: list[str] = field(default_factory=list)

    @property
    def values(self) -> dict[str, float]:
        """All that a simulation takes."""
        assert self.fit is not None and self.formula is not None
        return self.fit.values | self.formula.settings()


@dataclass
class Frame:
    """What all candidates have in common."""

    problem: Problem
    # each channel's residual is of size one before: none drowns another
    balanced: Problem
    last: Fit
    values: dict[str, float]
    length: dict[str, float]
    at: list[dict[str, np.ndarray]]
    full: float  # energy above the noise, of all channels

    @classmethod
    def of(cls, problem: Problem, last: Fit) -> Frame:
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

    def nats(self, residuals: np.ndarray) -> float:
        return compute_worth(self.problem, self.last.residuals, residuals, self.length)


def compute_worth(
    problem: Problem, before: np.ndarray, after: np.ndarray, length: Mapping[str, float]
) -> float:
    """Return the log likelihood, in nats, that residuals have gained.

    `length` is, of each channel, the blocks that count as one independent block.
    """
    total = 0.0
    for c, mine in problem.used():
        one, two = (float(r[mine] @ r[mine]) for r in (before, after))
        total += 0.5 * mine.sum() / length[c] * np.log(max(one, 1e-300) / max(two, 1e-300))
    return float(total)


def compute_price(term: FormulaTerm) -> float:
    return PRICE * (term.price + len(term.sizes) + 1)


def discover_formula(
    problem: Problem, last: Fit, held: Problem | None = None, say: Callable[[str], None] = lambda _: None
) -> Discovery:
    """Find the formula that explains most of the residuals of a fit.

    `last`: of `problem`, with all that is named; `held`: logs that judge.

    Cost: some ten simulations in full for each of about ten candidates; on the order of a
    minute for minutes of log.
    """
    frame = Frame.of(problem, last)
    places = _list_places(problem)
    say(f"a formula: {sum(len(terms.list_forms(p)) for p in places)} forms at {len(places)} places")
    listed = sorted((x for p in places for x in screen_forms(frame, p)), key=lambda x: -x[0])
    chosen = _choose_diverse(listed)
    tried: list[Discovery] = []
    for k, (_, place, term, coefficient) in enumerate(chosen):
        say(f"a formula: {k + 1} of {len(chosen)}, {term.text} at {place}")
        tried += _fit_formula(frame, place, term, coefficient)
    tried.sort(key=lambda c: -c.nats)
    return _choose_formula(frame, tried, held)


def _list_places(problem: Problem) -> list[str]:
    there = {c for log in problem.logs for c in log.channels}
    lateral = terms.LATERAL if {"accel_y", "yaw_rate"} <= there else ()
    return [p for p in (*lateral, *terms.LONGITUDINAL) if p not in COMPARED_CHANNELS or p in there]


def _choose_diverse(
    listed: list[tuple[float, str, FormulaTerm, float]],
) -> list[tuple[float, str, FormulaTerm, float]]:
    """Return the most promising forms: one size of each form, and several places."""
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


# ---- in the linearisation


def screen_forms(frame: Frame, place: str) -> list[tuple[float, str, FormulaTerm, float]]:
    """Return (nats less price, place, form, coefficient) of every form at a place.

    Everything that is fitted is fitted with it.
    """
    known, found = terms.list_forms(place), []
    for k in range(0, len(known), CHUNK):
        part = known[k : k + CHUNK]
        logs = [np.column_stack([terms.compute_values(t, s, s["dt"]) for t in part]) for s in frame.at]
        for t, (nats, coefficient) in zip(part, compute_expected_gain(frame, place, logs), strict=True):
            found.append((nats - compute_price(t), place, t, coefficient))
    return found


def compute_expected_gain(frame: Frame, place: str, logs: list[np.ndarray]) -> list[tuple[float, float]]:
    """Return (nats, coefficient) of forms by their values, an array (blocks, forms) a
    log.
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


# ---- in full


def _fit_formula(frame: Frame, place: str, term: FormulaTerm, coefficient: float) -> list[Discovery]:
    """Return the formula with everything fitted, in a list.

    The list is empty if the formula does not fit in a program, or makes the residuals
    much worse.
    """
    try:
        formula = terms.make_formula(place, term, coefficient)
    except FormulaError:
        return []
    limits = {n.name: (-100.0 * abs(n.value) - 1e-9, 100.0 * abs(n.value) + 1e-9) for n in formula.numbers}
    limits |= {s.name: (s.low, s.high) for s in term.sizes}
    thrown = frame.problem.residuals(frame.values | formula.settings())
    if compute_excess(frame.problem, thrown) > MAX_WORSE * max(frame.full, 1.0):
        return []
    return [refit(frame, formula, limits, compute_price(term))]


def refit(
    frame: Frame, formula: Formula, limits: Mapping[str, tuple[float, float]], cost: float
) -> Discovery:
    """Fit stiffness, all names and the numbers of a formula together."""
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
        most=MAX_STEPS,
    )
    formula = formula.with_values({p.key: found.values[p.name] for p in own})
    values = frame.values | found.values
    whole = frame.problem.residuals(values | formula.settings())
    back = np.where(
        problem.weight > 0, frame.problem.weight / np.where(problem.weight > 0, problem.weight, 1.0), 0.0
    )
    one = Fit(found.parameters, values, whole, back[:, None] * found.jacobian)
    left = compute_excess(frame.problem, whole)
    share = 1.0 - left / frame.full if frame.full > 0 else 0.0
    return Discovery(formula, one, frame.nats(whole) - cost, share, cost, dict(limits))


def _make_parameter(
    name: str, key: str, value: float, low: float, high: float, unit: str, text: str
) -> CatalogueParameter:
    size = max(abs(value), 1e-9)
    return CatalogueParameter(
        name, key, True, unit, float(np.clip(value, low, high)), low, high, size, size, 0.0, 0, text
    )


# ---- which one


def _choose_formula(frame: Frame, tried: list[Discovery], held: Problem | None) -> Discovery:
    """Return the best formula over all logs that the held-out logs confirm.

    Its numbers are those of the fitted logs. Confirmed: on held-out logs no channel is
    worse by more than MIN_HARM, and some are better. Without held-out logs there must be
    an error left to explain: a library of forms finds one in any noise.
    """
    shown, chosen, best = [], None, 0.0
    shows = held is not None or max(compute_gap(frame.problem, frame.last.residuals).values()) > NOISE_LIMIT
    if held is not None:
        before = held.residuals(drop_log_values(frame.values))
        length = compute_correlation_lengths(held, before)
    for c in tried:
        confirmed, total = shows and c.nats > 0 and c.share >= MIN_SHARE, c.nats
        if confirmed and held is not None:
            after = held.residuals(drop_log_values(c.values))
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
            "the held-out logs contradict them"
            if any(c.changes for c in tried)
            else "none closes enough of the gap"
        )
        words = [f"No formula is proposed: {len(tried)} were simulated; {why}."]
        return Discovery(None, None, tried=shown, words=words)
    return _add_sentences(frame, replace(chosen, tried=shown))


def refit_on_all(problem: Problem, last: Fit, found: Discovery) -> Discovery:
    """Fit the formula to more logs than it was found in.

    `last` is the fit of these logs with all names.
    """
    if found.formula is None:
        return found
    frame = Frame.of(problem, last)
    again = refit(frame, found.formula, found.limits, found.price)
    return _add_sentences(frame, replace(found, formula=again.formula, fit=again.fit, share=again.share))


def _add_sentences(frame: Frame, c: Discovery) -> Discovery:
    """Return the formula with the sentences for a person."""
    formula = _describe_formula(frame, c)
    words = [
        f"A formula closes {100 * c.share:.0f} % of the rest: {formula.text}, at {formula.place}. "
        "It is a fit, not a cause, and valid only in the range that was driven."
    ]
    return replace(c, formula=formula, words=words)


def _describe_formula(frame: Frame, c: Discovery) -> Formula:
    """Return the formula with the sds of its numbers and the ranges of its signals."""
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
