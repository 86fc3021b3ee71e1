"""Simulate logs of cars with a hidden physical effect.

The four-wheel model shares no code with tse or tselab.

    make_case({"body_roll": 1.0}, seed=3).write("case")
    for case in make_cases(study()): ...

The first line writes log_*.csv, hold_out_*.csv, car.toml and truth.json. The second
simulates every case of the study, many logs at once.
"""

from .case import Case, Spec, make_case, make_cases, study
from .effects import CATALOGUE, EFFECTS, OUTSIDE
from .manoeuvres import CORE, HOLD_OUT, MANOEUVRES

__all__ = [
    "CATALOGUE",
    "CORE",
    "EFFECTS",
    "HOLD_OUT",
    "MANOEUVRES",
    "OUTSIDE",
    "Case",
    "Spec",
    "make_case",
    "make_cases",
    "study",
]
