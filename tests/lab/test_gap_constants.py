"""The table of the constants of tselab gap: it is what the modules have, all of it, and one of them can be another for a run."""

from __future__ import annotations

import ast
import importlib
import math
from pathlib import Path

import pytest

import tselab
from tests.gap.changed import BY_NAME, changed, imports
from tselab.gap import constants, fit, optional, plan
from tselab.gap.infer import hypotheses, space
from tselab.gap.localise import where

TSELAB = Path(tselab.__file__).parent
FILES = [
    p for folder in ("gap", "identify") for p in sorted((TSELAB / folder).rglob("*.py")) if p.name != "constants.py"
]
# No result depends on them: sizes of pictures, exit codes, the largest file that is read, how long a cluster may take to answer;
# how many arguments a function takes.
NO_CONSTANTS = {"gap.export.pictures", "gap.export.report", "gap.workflow.EXIT",
                "gap.infer.formula.symbolic.FUNCTIONS"}  # fmt: skip
KEYS_ALONE = {("gap.problem", "PRIOR")}  # PROFILES, of its names


def module_of(path):
    return ".".join(path.relative_to(TSELAB).with_suffix("").parts)


def early(tree):
    """Nodes that are evaluated when a module is loaded."""
    waiting = list(tree.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            waiting += [
                *getattr(node, "decorator_list", ()),
                *node.args.defaults,
                *(d for d in node.args.kw_defaults if d),
            ]
            continue
        yield node
        waiting += ast.iter_child_nodes(node)


def numbers(node):
    return [n for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, (int, float))]


def test_modules_have_what_the_table_says_under_the_same_name():
    for c in constants.TABLE:
        assert getattr(importlib.import_module(c.module), c.key) == c.value, c.name
    assert len({c.name for c in constants.TABLE}) == len(constants.TABLE)


def test_every_constant_has_a_unit_and_a_reason():
    assert all(c.unit and c.reason for c in constants.TABLE)


def test_no_module_has_thresholds_that_are_not_in_the_table():
    """Tables of priors and of forms aside, which are of other classes."""
    wrong = []
    for path in FILES:
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if not isinstance(node, (ast.Assign, ast.AnnAssign)) or node.value is None:
                continue
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            made = {n.func.id for n in ast.walk(node.value) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
            if made & {"Parameter", "Unknown", "_late", "Signal"} or not numbers(node.value):
                continue
            for t in target.elts if isinstance(target, ast.Tuple) else [target]:
                names = {module_of(path), f"{module_of(path)}.{t.id}"}
                if t.id.lstrip("_").isupper() and not names & NO_CONSTANTS and "click" not in ast.unparse(node.value):
                    wrong.append(f"{module_of(path)}.{t.id}")
    assert not wrong


def test_nothing_is_read_for_good_when_modules_are_loaded():
    """Else changed() would change half of it."""
    rows = {(c.module, c.key): c for c in constants.TABLE}
    wrong = []
    for path in FILES:
        module, here = f"tselab.{module_of(path)}", {}
        for (m, key), names in imports(str(path)).items():
            here |= {n: rows[m, key] for n in names if (m, key) in rows}
        here |= {c.key: c for c in constants.TABLE if c.module == module}
        for node in early(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load) and node.id in here:
                c = here[node.id]
                if not c.fixed and (module_of(path), node.id) not in KEYS_ALONE:
                    wrong.append(f"{module_of(path)}:{node.lineno} {node.id}")
    assert not wrong


def test_one_is_another_for_a_while_wherever_it_is_read():
    assert space.EPISODE == 30.0
    with changed("space.EPISODE", 60.0):
        assert space.EPISODE == 60.0
        with changed("data.BLOCK", 0.08):
            assert fit.BLOCK == where.BLOCK == space.BLOCK == 0.08
        assert fit.BLOCK == where.BLOCK == space.BLOCK == 0.04 and space.EPISODE == 60.0
    assert space.EPISODE == 30.0


def test_the_same_name_elsewhere_stays():
    with changed("optional.ROUNDS", 6):
        assert (optional.ROUNDS, plan.ROUNDS) == (6, 4)


def test_what_fails_within_leaves_the_table_as_it_was():
    with pytest.raises(ZeroDivisionError), changed("NAME_AT", 0.5):
        assert hypotheses.NAME_AT == 0.5
        raise ZeroDivisionError
    assert hypotheses.NAME_AT == 0.9


def test_a_changed_prior_is_the_prior_that_is_used():
    def odds():
        return next(h.odds for h in hypotheses.hypotheses() if h.id == "gyro_scale")

    assert odds() == pytest.approx(math.log(0.1 / 0.9))
    with changed("SENSOR_SHARE", 0.5):
        assert odds() == 0.0
    with changed("hypotheses.LATE", (0.01, 0.05)):
        late = next(h for h in hypotheses.hypotheses() if h.id == "accel_x_latency")
        assert late.effect.parameters[0].typical_high == 0.05


@pytest.mark.parametrize(("name", "value", "error"), [
    ("space.EPISODE", "6", ValueError), ("search.MOST_STEPS", 2, KeyError), ("infer.search.REFIT", 2.5, ValueError),
    ("noise.MEDIAN", (1.0, 2.0), ValueError), ("problem.PRIOR", {"grade": 0.1}, ValueError), ("SEEM", 1.0, KeyError),
    ("BLOCK", 1.0, KeyError), ("MOST_LATENCY", 0.1, ValueError),
])  # fmt: skip
def test_what_is_no_constant_or_no_value_of_it_is_refused(name, value, error):
    with pytest.raises(error), changed(name, value):
        pass


def test_the_table_for_readers_has_every_constant_once():
    rows = constants.markdown().splitlines()[2:]
    assert [r for r in rows if r.startswith("| **")] and all(r.count(" | ") == 4 for r in rows if r.startswith("| `"))
    assert sorted(r.split("`")[1] for r in rows if r.startswith("| `")) == sorted(BY_NAME)


def test_the_committed_table_is_this_one():
    path = Path(constants.__file__).parents[2] / "results" / "gap-constants.md"
    assert path.read_text(encoding="utf-8") == constants.markdown(), f"python -m tselab.gap.constants > {path}"
