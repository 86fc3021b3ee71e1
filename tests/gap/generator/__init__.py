"""Logs of cars in which a physical effect is hidden, from a four-wheel model that shares no code with tse or tselab.

make_case({"body_roll": 1.0}, seed=3).write("case")     # log_*.csv, hold_out_*.csv, car.toml, truth.json
for case in make_cases(study()): ...                    # every case of the study, many logs at once
"""

from .case import Case, Spec, make_case, make_cases, study
from .effects import CATALOGUE, EFFECTS, OUTSIDE
from .manoeuvres import CORE, HOLD_OUT, MANOEUVRES

__all__ = [
    "CATALOGUE", "CORE", "EFFECTS", "HOLD_OUT", "MANOEUVRES", "OUTSIDE", "Case", "Spec", "make_case", "make_cases", "study",
]  # fmt: skip
