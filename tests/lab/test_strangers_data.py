"""Nothing that a file says is run: no way of reading in the package makes code of data."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import tse
import tselab
from tselab.fmu.clients import Plan

SOURCES = sorted(p for m in (tse, tselab) for p in Path(str(m.__file__)).parent.rglob("*.py"))
MODULES = {"pickle", "_pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve", "yaml", "code"}
CALLS = {"eval", "exec", "compile", "__import__"}
METHODS = {"read_pickle", "unsafe_load"}


def code_of_data(source: str) -> Iterator[str]:
    """What in a source may run what it reads."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name.split(".")[0] in MODULES)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in MODULES:
            yield node.module or ""
        elif isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            if name in CALLS or name.split(".")[-1] in METHODS:
                yield name
            if any(k.arg == "allow_pickle" and not (isinstance(k.value, ast.Constant) and k.value.value is False)
                   for k in node.keywords):  # fmt: skip
                yield f"{name}(allow_pickle)"


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: "/".join(p.parts[-2:]))
def test_no_source_makes_code_of_data(path):
    assert not list(code_of_data(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    "source",
    ["import pickle", "from pickle import load", "import joblib.parallel", "np.load(f, allow_pickle=True)", "pd.read_pickle(f)",
     "eval(text)"],
)  # fmt: skip
def test_what_makes_code_of_data_is_seen(source):
    assert list(code_of_data(source))


def test_the_plan_of_a_client_comes_back_bit_for_bit():
    values = np.array([0.1, 1 / 3, np.nan, -0.0, 5e-324])
    plan = Plan(
        "model.fmu",
        "{guid}",
        "model",
        1 / 128,
        {"a": values},
        ("x", "y"),
        {"x": "Real", "y": "Boolean"},
        {"x": 1, "y": 2},
    )
    back = Plan.from_json(plan.as_json())
    assert back.inputs["a"].tobytes() == values.tobytes()
    assert back.as_json() == plan.as_json() and back.outputs == plan.outputs and back.step == plan.step
