"""Change one constant at a time, and compare the names in a few cases of the generator.

    python -m tests.gap.sweep [--only CONSTANT ...] [--jobs N] [--again]

From the root of the repository; two hours on two cores. Names are those of the search
(infer/naming.py), before formulas compete with them. So a case outside the catalogue (a
patch of low grip) shows how a constant changes false names. Finished runs are kept in
build/gap-sweep. The table goes to scripts/results/gap-sweep.md when all constants are
done.
"""

import argparse
import importlib
import json
import shutil
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from tests.gap.runs import change_constant, run_in_processes
from tests.gap.study import is_same

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "build" / "gap-sweep"
TABLE = ROOT / "scripts" / "results" / "gap-sweep.md"
CASES = (
    "clean-108",
    "relaxation-1x-1",
    "lateral_load_transfer-1x-1",
    "body_roll+steering_ratio-1x-2",
    "low_grip_patch-1x-1",
)
# Half and twice, or what is half and twice as probable.
VALUES: dict[str, tuple[float, float]] = {
    "gaps.infer.hypotheses.EXPECTED": (0.5, 2.0),
    "gaps.infer.hypotheses.SENSOR_SHARE": (0.05, 0.2),
    "gaps.infer.hypotheses.EVERY_SHARE": (0.08, 0.3),
    "gaps.infer.hypotheses.LARGER_SD": (0.2, 0.7),
    "identify.fit.MODEL_TIME": (1.0, 4.0),
    "gaps.infer.space.LASTING": (0.33, 1.3),
    "gaps.infer.space.ABSENT": (0.25, 1.0),
    "gaps.infer.excerpt.MAX_SECONDS": (45.0, 180.0),
}


def run(asked: tuple[str, str, float | None]) -> None:
    """Run one case with one constant changed (None: none): names, and probability of
    the truth."""
    from tests.gap.generator import make_cases, study
    from tse.car.vehicle import read_vehicle
    from tse.gaps.catalogue import load_catalogue
    from tse.gaps.fit import fit_parameters
    from tse.gaps.infer.excerpt import choose_excerpt
    from tse.gaps.infer.naming import name_effects
    from tse.gaps.problem import STIFFNESS_PARAMETERS, Problem
    from tse.gaps.run.workflow import read_logs
    from tse.identify.data import prepare_all

    case, constant, value = asked
    path = name_file(case, constant, value)
    if path.exists():
        return
    made = next(make_cases([s for s in study() if s.name == case]))

    with tempfile.TemporaryDirectory() as temporary, ExitStack() as stack:
        if value is not None:
            stack.enter_context(change_constant(constant, value))
        folder = made.write(Path(temporary) / "case")
        logs, config = read_logs(sorted(folder.glob("log_*.csv")), read_vehicle(folder / "car.toml"))
        problem = Problem(prepare_all(logs, config), config)
        found = name_effects(
            choose_excerpt(problem, fit_parameters(problem, STIFFNESS_PARAMETERS, {})),
            list(load_catalogue().values()),
        )
    truth = [e["id"] for e in made.truth["effects"]]
    named = {n.effect.id: (n.probability, n.look_alikes) for n in found.named}
    right = [t for t in truth if any(is_same(t, n) or t in alike for n, (_, alike) in named.items())]
    more = [n for n, (_, alike) in named.items() if not any(is_same(t, n) or t in alike for t in truth)]
    result = {"truth": truth, "right": right, "more": {n: named[n][0] for n in more}}
    path.with_suffix(".part").write_text(json.dumps(result))
    path.with_suffix(".part").replace(path)


def name_file(case: str, constant: str, value: float | None) -> Path:
    return FOLDER / f"{case}_{'as_it_is' if value is None else f'{constant}_{value:g}'}.json"


def is_done(constant: str, value: float | None) -> bool:
    return all(name_file(c, constant, value).exists() for c in CASES)


def make_row(label: str, constant: str, value: float | None, cases: Sequence[str] = CASES) -> str:
    found = [json.loads(name_file(c, constant, value).read_text()) for c in cases]
    there, right = (sum(len(f[k]) for f in found) for k in ("truth", "right"))
    more = [
        f"{n} {100 * p:.0f} % ({c})" for c, f in zip(cases, found, strict=True) for n, p in f["more"].items()
    ]
    return f"| {label} | {right} of {there} | {', '.join(more) or '-'} |"


def make_table(constants_asked: dict[str, tuple[float, float]]) -> str:
    lines = [
        "| constant | right or admitted | superfluous names, their probability, the case |",
        "|---|---|---|",
    ]
    lines.append(make_row("all as they are", "", None))
    for name, values in constants_asked.items():
        for v in values:
            label = f"`{name}` {v:g} in place of {get_constant(name):g}"
            lines.append(make_row(label, name, v) if is_done(name, v) else f"| {label} | not run | |")
    return "\n".join(lines) + "\n"


def get_constant(name: str) -> float:
    module, _, key = name.rpartition(".")
    return getattr(importlib.import_module(f"tse.{module}"), key)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.gap.sweep", description=__doc__.split("\n")[0])
    parser.add_argument(
        "--only",
        nargs="*",
        default=[],
        help="parts of names of constants; the table is printed, and not written",
    )
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--again", action="store_true")
    options = parser.parse_args()
    if options.again:
        shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True, exist_ok=True)
    wanted = {k: v for k, v in VALUES.items() if not options.only or any(o in k for o in options.only)}
    asked: list[tuple[str, str, float | None]] = [(c, "", None) for c in CASES]
    asked += [(c, k, v) for k, values in wanted.items() for v in values for c in CASES]
    run_in_processes(run, asked, options.jobs, "run")  # of what was stopped the table says what was not run
    if not is_done("", None):
        return 130
    text = make_table(wanted)
    if len(wanted) == len(VALUES):
        TABLE.write_text(text)
    print(text)
    return 0 if all(is_done(k, v) for k, values in wanted.items() for v in values) else 130


if __name__ == "__main__":
    sys.exit(main())
