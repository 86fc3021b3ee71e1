"""Beyond the library: forms that evolve from it (genetic programming, DEAP), by their expected gain in the linearisation.

Trees are of signals without unit (each over a size that drivers reach), so every tree is a form: x over its size becomes a number
with a unit. A tree that fits no program is no form.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tselab.formula import FormulaError
from tselab.gap import constants
from tselab.gap.infer.formula.terms import (
    FRONT,
    KNOWN,
    LATERAL,
    PULL,
    REAR,
    SIDE,
    SPEED,
    STEER,
    YAW,
    Signal,
    Size,
    Term,
    formula,
)

if TYPE_CHECKING:
    from tselab.gap.infer.formula.search import Frame

POPULATION, GENERATIONS, CROSSING, MUTATING, TALLEST, KEPT, NODE_PRICE, ALIKE = constants.of(
    __name__, "POPULATION", "GENERATIONS", "CROSSING", "MUTATING", "TALLEST", "KEPT", "NODE_PRICE", "ALIKE"
)  # fmt: skip
ACROSS = (STEER, YAW, SIDE, FRONT, REAR, SPEED, PULL)
ALONG = (PULL, SPEED, SIDE, STEER, YAW)


def soft(x: np.ndarray) -> np.ndarray:
    return x / np.sqrt(1.0 + x * x)


FUNCTIONS = (
    (np.add, 2, "add"), (np.subtract, 2, "sub"), (np.multiply, 2, "mul"), (np.abs, 1, "abs"), (soft, 1, "soft"),
    (np.maximum, 2, "max"),
)  # fmt: skip


def search(frame: Frame, place: str, library: Sequence[Term], seed: int) -> list[tuple[float, str, Term, float]]:
    """The best forms that evolution finds at a place, as search.screened() lists them. Seeded."""
    from deap import base, gp

    from tselab.gap.infer.formula.search import expected_gain, screened

    rng = random.Random(seed)
    used: tuple[Signal, ...] = ACROSS if place in LATERAL else ALONG
    primitives = gp.PrimitiveSet("form", len(used), prefix="x")
    for function, takes, name in FUNCTIONS:
        primitives.addPrimitive(function, takes, name=name)
    primitives.addTerminal(1.0, name="one")
    primitives.addTerminal(2.0, name="two")
    box = base.Toolbox()
    box.register("grown", gp.genHalfAndHalf, pset=primitives, min_=1, max_=3)
    signals = [np.concatenate([s[x.text] for s in frame.at]) / x.sizes[1] for x in used]
    lengths = np.cumsum([len(s["dt"]) for s in frame.at])[:-1]

    def values(tree: Any) -> np.ndarray:
        with np.errstate(all="ignore"):
            x = np.broadcast_to(np.asarray(gp.compile(tree, primitives)(*signals), float), signals[0].shape)
        return np.clip(np.nan_to_num(x), -1e6, 1e6)

    def judge(trees: list[Any]) -> list[float]:
        table = np.column_stack([values(t) for t in trees])
        found = expected_gain(frame, place, np.split(table, lengths), frame.last)
        return [n - NODE_PRICE * len(t) for (n, _), t in zip(found, trees, strict=True)]

    state = random.getstate()
    random.setstate(rng.getstate())  # DEAP draws from the module's generator
    try:
        trees = [gp.PrimitiveTree(box.grown()) for _ in range(POPULATION)]
        scores = judge(trees)
        for _ in range(GENERATIONS):
            young = [gp.PrimitiveTree(trees[_winner(scores)]) for _ in trees]
            for a, b in zip(young[::2], young[1::2], strict=False):
                if random.random() < CROSSING:
                    gp.cxOnePoint(a, b)
            for t in young:
                if random.random() < MUTATING:
                    gp.mutUniform(t, expr=lambda pset, type_: gp.genFull(pset, 0, 2, type_), pset=primitives)
            young = [t for t in young if t.height <= TALLEST]
            both = list({str(t): t for t in (*trees, *young)}.values())
            fresh = [t for t in both if not any(t is o for o in trees)]
            worth = dict(zip(map(str, trees), scores, strict=True))
            worth |= dict(zip(map(str, fresh), judge(fresh), strict=True)) if fresh else {}
            trees = sorted(both, key=lambda t: -worth[str(t)])[:POPULATION]
            scores = [worth[str(t)] for t in trees]
    finally:
        random.setstate(state)
    known = np.concatenate([s[KNOWN[place][0]] for s in frame.at]) if place in KNOWN else np.zeros(0)
    forms = [f for t in trees[: 4 * KEPT] if not _alike(values(t), known) and (f := _form(t, used)) is not None]
    seen = {t.text for t in library}
    listed = [x for x in screened(frame, place, frame.last, forms) if x[2].text not in seen] if forms else []
    return sorted(listed, key=lambda x: -x[0])[:KEPT]


def _alike(x: np.ndarray, known: np.ndarray) -> bool:
    """Whether a form is a line over what the catalogue has at the place: that was asked for by its name."""
    if not known.size or np.ptp(x) == 0.0 or np.ptp(known) == 0.0:
        return False
    return abs(float(np.corrcoef(x, known)[0, 1])) > ALIKE


def _winner(scores: list[float], rivals: int = 4) -> int:
    return max((random.randrange(len(scores)) for _ in range(rivals)), key=lambda i: scores[i])


def _form(tree: Any, used: Sequence[Signal]) -> Term | None:
    """The tree as a form, with a number for the size of each signal in it; None: it fits no program."""
    sizes: dict[str, Size] = {}

    def leaf(name: str) -> str:
        if name in ("one", "two"):
            return {"one": "1", "two": "2"}[name]
        s = used[int(name[1:])]
        key = f"s{int(name[1:])}"
        sizes[key] = Size(key, s.sizes[1], 0.05 * s.sizes[0], 20.0 * s.sizes[-1], s.units, f"size of {s.text}")
        return f"({s.text}/{key})"

    write: dict[str, Callable[..., str]] = {
        "add": "({} + {})".format, "sub": "({} - {})".format, "mul": "{}*{}".format, "abs": "abs({})".format,
        "soft": "soft({})".format, "max": "max({}, {})".format,
    }  # fmt: skip
    stack: list[str] = []
    for node in reversed(tree):
        stack.append(
            write[node.name](*(stack.pop() for _ in range(node.arity)))
            if node.arity
            else leaf(node.name if node.name in ("one", "two") else node.value)
        )
    term = Term(stack[0], (0, 0), tuple(sizes.values()))
    try:
        formula("front_angle", [term], [{}], [1.0])
    except FormulaError:
        return None
    return term
