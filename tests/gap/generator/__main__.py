"""Write cases; run it from the root of the repository.

python -m tests.gap.generator --effect body_roll --seed 3 --out DIR
"""

import argparse
from pathlib import Path

from .case import Spec, make_cases, study
from .effects import EFFECTS
from .manoeuvres import HOLD_OUT, MANOEUVRES


def make_table() -> str:
    rows = ["| id | parameter | typical | form here, and what the parameter means |", "|---|---|---|---|"]
    for e in EFFECTS.values():
        sign = "+-" if e.signed else ""
        size = f"{sign}{e.low:.3g} .. {e.high:.3g} {e.unit}" if e.high > e.low else "-"
        rows.append(f"| `{e.id}`{' (outside)' if e.outside else ''} | {e.parameter} | {size} | {e.how} |")
    return "\n".join(rows)


def main() -> None:
    """Run the command line."""
    p = argparse.ArgumentParser(prog="python -m tests.gap.generator", description=__doc__.split("\n")[0])
    p.add_argument(
        "--effect", action="append", default=[], choices=EFFECTS, help="may be repeated; none: a clean car"
    )
    p.add_argument("--size", type=float, default=1.0, help="times the typical size that the seed draws")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--manoeuvre", action="append", choices=MANOEUVRES, help="may be repeated; default: six")
    p.add_argument(
        "--optional", action="store_true", help="log vehicle_speed and wheel_torque_front, _rear, too"
    )
    p.add_argument(
        "--study", action="store_true", help="all cases of the study, each in a folder of its name"
    )
    p.add_argument("--list", action="store_true", help="the names of these cases")
    p.add_argument("--table", action="store_true", help="the effects and how their sizes are defined")
    p.add_argument("--out", type=Path)
    a = p.parse_args()
    if a.list or a.table:
        print("\n".join(s.name for s in study()) if a.list else make_table())
        return
    if a.out is None:
        p.error("--out is missing")
    if a.study:
        for case in make_cases(study()):
            print(case.write(a.out / case.spec.name, a.optional))
        return
    manoeuvres = tuple(a.manoeuvre) if a.manoeuvre else None
    spec = Spec(
        "+".join(a.effect) or "clean", dict.fromkeys(a.effect, 1.0), a.seed, a.size, manoeuvres, HOLD_OUT
    )
    print(next(make_cases([spec])).write(a.out, a.optional))


if __name__ == "__main__":
    main()
