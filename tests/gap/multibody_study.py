"""The gap workflow on a multi-body car: which effects it names, how far their sizes are from the car's, how far the gap falls on
manoeuvres that were held out.

    python -m tests.gap.multibody_study [--cars 1 2 3] [--jobs N]     from the root of the repository; some minutes a car

Car 1 was looked at while the workflow was made, 2 and 3 were not. Tyres as the package has them but for its errors of camber
(multibody.parameters). Cars that are done are kept in build/multibody; --again starts anew. The table goes to
scripts/results/gap-multibody.md.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from pathlib import Path

from tests.gap.runs import in_processes

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "build" / "multibody"
TABLE = ROOT / "scripts" / "results" / "gap-multibody.md"


def run(car: int) -> dict:
    """One car: its logs, the workflow, what counts."""
    from tests.gap import multibody
    from tse.impl.gap.run.workflow import run as gap
    from tse.impl.results import plain

    folder = FOLDER / f"car{car}"
    done = folder / "result.json"
    if not done.exists():
        if not (folder / "truth.json").exists():  # its last file
            multibody.write(folder, car)
        logs, held = sorted(folder.glob("log_*.csv")), sorted(folder.glob("hold_out_*.csv"))
        verdict = gap(logs, folder / "car.toml", held).as_json()
        done.write_text(
            json.dumps(plain({k: verdict[k] for k in ("effects", "formula", "gap", "verdict", "possible", "words")}))
        )
    return json.loads(done.read_text())


def true_size(truth: dict, effect: str) -> tuple[str, float] | None:
    """Parameter and size of the effect in the car, None: it is not there, or has no one size."""
    found = next((e for e in truth["effects"] if e["id"] == effect), {})
    value = found.get("value")
    return (found["parameter"], float(value)) if isinstance(value, (int, float)) and value else None


def table(results: dict[int, tuple[dict, dict]]) -> str:
    """By car: result and truth -> Markdown."""
    lines = [
        "| car | named: size (the car's) | formula | accel_x, held out | accel_y | yaw_rate |",
        "|---|---|---|---:|---:|---:|",
    ]
    for car, (result, truth) in results.items():
        named = []
        for e in result["effects"]:
            true = true_size(truth, e["id"])
            key = true[0] if true else next(iter(e["parameters"]))
            size = f"{e['parameters'][key]['value']:.3g}"
            named.append(f"{e['id']} {size}" + (f" ({true[1]:.3g})" if true else " (not there)"))
        proposed = (result["formula"] or {}).get("proposed")
        before, after = result["gap"]["held_out"]["before"], result["gap"]["held_out"]["after"]
        falls = [
            f"{before[c]:.2f} -> {after[c]:.2f}, {100 * (after[c] / before[c] - 1):+.0f} %"
            for c in ("accel_x", "accel_y", "yaw_rate")
        ]
        text = f"`{proposed['formula']}` at {proposed['place']}" if proposed else "-"
        lines.append(f"| {car} | {', '.join(named) or '-'} | {text} | {' | '.join(falls)} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.gap.multibody_study", description=__doc__.split("\n")[0])
    parser.add_argument("--cars", type=int, nargs="+", choices=(1, 2, 3), default=[1, 2, 3])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--again", action="store_true")
    options = parser.parse_args()
    if options.again:
        shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True, exist_ok=True)
    found = in_processes(run, options.cars, options.jobs, "car")
    if found is None:
        return 130
    results = dict(zip(options.cars, found, strict=True))
    text = table({c: (r, json.loads((FOLDER / f"car{c}" / "truth.json").read_text())) for c, r in results.items()})
    if len(results) == 3:
        TABLE.write_text(text)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
