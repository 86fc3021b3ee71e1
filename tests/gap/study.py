"""Study the gap workflow on logs with hidden effects: every case of generator/case.py.

    python -m tests.gap.study [--seeds N] [--sizes N] [--only PART ...] [--jobs N]
        [--out DIR]

From the root of the repository. Finished cases are kept in build/gap-study/*.json, so
that an interrupted study continues. Changes of the code are not detected: --again starts
anew. Without options it is one seed of every case at typical size, a quarter of an hour
of two processors, and its table goes to scripts/results/gap.md. The whole study is
--seeds 3 --sizes 3. The table of a part (--only) is only printed, unless --out is given.
"""

import argparse
import json
import math
import shutil
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import numpy as np

from tests.gap.runs import run_in_processes
from tse.library.core import Config
from tselab.montecarlo.summary import compute_clopper_pearson

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "build" / "gap-study"
RESULTS = ROOT / "scripts" / "results"
# Aliases by physics (effects.md, section 3): either name is right.
CLASSES = [{"mass", "yaw_inertia"}, {"imu_scale_ax", "pitch_leak"}, {"conicity", "steering_offset"}]
# Not expected: what a log cannot show without speed or torque, what a stiffness or a bias
# takes up. Listed with the result.
INVISIBLE = {"aero_drag", "rolling_resistance", "steering_compliance", "aligning_moment", "conicity"}
SEEDS, SIZES = 1, 0  # seeds of each case at typical size, at half and double: of the table that is published


def run(spec_json: str) -> dict:
    """Run one case: generate, run the workflow, keep the results."""
    from tests.gap.generator import Spec, make_cases
    from tse.gaps.run.workflow import run_workflow as gap

    spec = Spec(**json.loads(spec_json))
    case = next(make_cases([spec]))
    with tempfile.TemporaryDirectory() as name:
        folder = case.write(Path(name) / "case")
        start = time.perf_counter()
        logs, held = sorted(folder.glob("log_*.csv")), sorted(folder.glob("hold_out_*.csv"))
        result = gap(logs, folder / "car.toml", held)
        seconds = time.perf_counter() - start
    verdict = result.as_json()
    return {
        "name": spec.name,
        "seed": spec.seed,
        "size": spec.size,
        "truth": case.truth["effects"],
        "outside": case.truth["outside"],
        "verdict": verdict["verdict"],
        "exit": result.exit_code,
        "named": verdict["effects"],
        "sensors": [s["id"] for s in verdict["sensors"]],
        "possible": verdict["possible"],
        "closed": verdict["closed"],
        "formula": (verdict["formula"] or {}).get("proposed"),
        "gap": verdict["gap"],
        "undetectable": [d["id"] for d in verdict["undetectable"]],
        "seconds": seconds,
    }


# ---- judging


def get_truth_ids(case: dict) -> list[str]:
    return [e["id"] for e in case["truth"]]


def is_same(a: str, b: str) -> bool:
    return a == b or any(a in c and b in c for c in CLASSES)


def grade(case: dict) -> str:
    """Return right, look-alike (an admitted set holds the truth), extra, wrong, missed,
    outside.

    extra: right, and more names.
    """
    truth, named = get_truth_ids(case), [n["id"] for n in case["named"]]
    if case["verdict"] != "named":
        return "outside" if case["verdict"] == "not_in_catalogue" else "none"
    hit = [t for t in truth if any(is_same(t, n) for n in named)]
    admitted = [t for t in truth if any(t in n["look_alikes"] for n in case["named"])]
    if truth and len(hit) == len(truth):
        return "right" if len(named) == len(truth) else "extra"
    if truth and set(hit) | set(admitted) >= set(truth):
        return "look-alike"
    return "wrong"


def name_group(case: dict) -> str:
    if case["outside"]:
        return "outside the catalogue"
    ids = get_truth_ids(case)
    if not ids:
        return "nothing hidden"
    if len(ids) > 1:
        return "pairs"
    return f"one effect, {case['size']:g} x typical"


def get_size(case: dict) -> tuple[float, float, float, float] | None:
    """Return size, 95 % interval and true size of the first hidden effect; None: not
    named.

    Absolute values: signs of a steering or a bank are conventions.
    """
    if not case["truth"]:
        return None
    e = case["truth"][0]
    mine = next((n for n in case["named"] if n["id"] == e["id"]), None)
    if mine is None:
        return None
    found = next(iter(mine["parameters"].values()))
    true = float(next(iter(e["parameters"].values())))
    if e["id"] == "rear_roll_steer":  # per lateral acceleration: how much the car rolls is not in a log
        found, true = (
            mine["parameters"]["gain"],
            e["parameters"]["k_per_mps2"] / Config.exact().rear_roll_steer_roll,
        )
    if e["id"] == "bank":
        true = e["parameters"]["rms_wander"]
    if not true:
        return None
    value, (low, high) = found["value"], found["ci95"]
    return (value, low, high, abs(true)) if value >= 0 else (-value, -high, -low, abs(true))


def compute_size_error(case: dict) -> float:
    """Return the relative error of the size; NaN: none."""
    size = get_size(case)
    return math.nan if size is None else size[0] / size[3] - 1.0


def format_interval(k: int, n: int) -> str:
    """Return the exact 95 % interval."""
    low, high = compute_clopper_pearson(k, n)
    return f"{100 * low:.0f} .. {100 * high:.0f} %"


def find_worst_held_out(case: dict) -> float:
    return max(case["gap"]["held_out"]["after"].values(), default=math.nan)


def compute_closed_share(case: dict) -> float:
    """Return the share of the energy above noise in held-out logs that the result closes.

    Over all channels, with named or proposed effects.
    """
    before, after = (
        sum(max(0.0, x * x - 1.0) for x in case["gap"]["held_out"][k].values()) for k in ("before", "after")
    )
    return 1.0 - after / before if before > 0 else 0.0


BINS = (0.1, 0.5, 0.9, 0.99, 1.0)  # of stated probabilities


def make_reliability_table(cases: list[dict]) -> list[str]:
    """Return rows of a table: stated probability of an effect, and frequency of its
    presence."""
    stated: list[tuple[float, bool]] = []
    for c in cases:
        truth = get_truth_ids(c)
        stated += [
            (e["probability"], any(is_same(t, e["id"]) for t in truth)) for e in (*c["named"], *c["possible"])
        ]
    lines = [
        "| stated probability | effects | mean stated probability | effects that are there (95 %) |",
        "|---|---:|---:|---|",
    ]
    for low, high in pairwise(BINS):
        mine = [(p, there) for p, there in stated if low <= p < high or (high == 1.0 and p == 1.0)]
        if mine:
            k, n = sum(there for _, there in mine), len(mine)
            mean = np.mean([p for p, _ in mine])
            lines.append(
                f"| {low:g} .. {high:g} | {n} | {100 * mean:.0f} % "
                f"| {100 * k / n:.0f} % ({format_interval(k, n)}) |"
            )
    return lines


def make_tables(cases: list[dict]) -> dict[str, str]:
    """Return the tables as Markdown, by file name."""
    columns = ("right", "extra", "look-alike", "wrong", "outside", "none")
    head = (
        "| hidden | cases | right names | right names and others | right among the look-alikes | "
        "wrong names | not in the catalogue | no names | median error of the size | "
        "held-out rms / noise, median | median time |\n|---|" + "---:|" * 10 + "\n"
    )
    lines = []
    for name in sorted({name_group(c) for c in cases}):
        mine = [c for c in cases if name_group(c) == name]
        count = {k: sum(grade(c) == k for c in mine) for k in columns}
        errors = [abs(e) for e in map(compute_size_error, mine) if math.isfinite(e)]
        error = f"{100 * np.median(errors):.0f} %" if errors else ""
        held = f"{np.median([find_worst_held_out(c) for c in mine]):.2f}"
        seconds = f"{np.median([c['seconds'] for c in mine]):.0f} s"
        counts = " | ".join(str(count[k]) for k in columns)
        lines.append(f"| {name} | {len(mine)} | {counts} | {error} | {held} | {seconds} |")
    visible = [
        c
        for c in cases
        if name_group(c) == "one effect, 1 x typical" and get_truth_ids(c)[0] not in INVISIBLE
    ]
    if visible:
        top = sum(grade(c) in ("right", "extra") for c in visible)
        held = sum(grade(c) in ("right", "extra", "look-alike") for c in visible)
        lines.append("")
        lines.append(
            f"One effect of typical size, {len(visible)} cases: the effect is named in "
            f"{100 * top / len(visible):.0f} % (95 %: {format_interval(top, len(visible))}), and named or "
            f"listed as a look-alike in {100 * held / len(visible):.0f} % "
            f"({format_interval(held, len(visible))}). Not counted: "
            f"{', '.join(sorted(INVISIBLE))}, which are hardly visible in these logs."
        )
    clean = [c for c in cases if name_group(c) == "nothing hidden"]
    if clean:
        k = sum(c["verdict"] != "named" for c in clean)
        lines.append(
            f"\nNothing hidden: no effect is named for {k} of {len(clean)} cars (95 %: "
            f"{format_interval(k, len(clean))})."
        )
    outside = [c for c in cases if c["outside"]]
    if outside:
        k = sum(c["verdict"] == "named" and c["closed"] > 0.5 for c in outside)
        lines.append(
            f"\nEffects outside the catalogue: named effects close more than half of the gap in {k} of "
            f"{len(outside)} cases."
        )
        proposed = [c for c in outside if c.get("formula")]
        half = sum(compute_closed_share(c) > 0.5 for c in proposed)
        lines.append(
            f"\nEffects outside the catalogue: a formula is proposed in {len(proposed)} of {len(outside)} "
            f"cases. It closes more than half of the gap on held-out logs in {half}."
        )
    sizes = [size for c in cases if not c["outside"] and (size := get_size(c)) is not None]
    if sizes:
        k = sum(low <= true <= high for _, low, high, true in sizes)
        near = sum(abs(value / true - 1.0) < 0.25 for value, _, _, true in sizes)
        lines.append(
            f"\nSizes of named effects: the 95 % interval contains the true size in {k} of {len(sizes)} "
            f"({format_interval(k, len(sizes))}); {near} estimates are within 25 % of the true size. The "
            "simulator has other forms of the effects than the catalogue."
        )
    lines += ["", *make_reliability_table([c for c in cases if not c["outside"]])]
    each = [
        "| hidden, seed | verdict: names | error of the size | "
        "largest rms / noise, fitted logs, before -> after | largest rms / noise, held-out logs, after |",
        "|---|---|---:|---|---|",
    ]
    for c in sorted(cases, key=lambda c: (name_group(c), c["name"])):
        named = (
            "; ".join(
                n["id"] + (f" ({', '.join(n['look_alikes'])}?)" if n["look_alikes"] else "")
                for n in c["named"]
            )
            or "-"
        )
        if c["sensors"]:
            named = "; ".join([*([] if named == "-" else [named]), *c["sensors"]])
        if c.get("formula"):
            named += f"; `{c['formula']['formula']}` at {c['formula']['place']}"
        error = compute_size_error(c)
        fit = c["gap"]["fit"]
        change = f"{max(fit['before'].values()):.2f} -> {max(fit['after'].values()):.2f}"
        each.append(
            f"| {c['name']} | {c['verdict']}: {named} | "
            f"{'' if math.isnan(error) else f'{100 * error:+.0f} %'} | {change} "
            f"| {find_worst_held_out(c):.2f} |"
        )
    return {"gap.md": head + "\n".join([*lines, "", *each]) + "\n"}


def choose_cases(seeds: int, only: list[str], sizes: int) -> list:
    """Return the cases of the study by name, with at most this many seeds each.

    `sizes`: at most so many seeds of half and double size, which come last.
    """
    from tests.gap.generator import study

    most = {"clean": 7 * seeds}
    seen: dict[str, int] = {}
    specs = []
    for spec in study():
        kind = spec.name.rsplit("-", 1)[0]
        seen[kind] = seen.get(kind, 0) + 1
        limit = most.get(kind, seeds if spec.size == 1.0 else sizes)
        if seen[kind] <= limit and (not only or any(o in spec.name for o in only)):
            specs.append(spec)
    return sorted(specs, key=lambda s: s.size != 1.0)


def write(found: dict[str, str], whole: bool, out: Path | None) -> list[Path]:
    """Write the tables to the given folder; or to RESULTS, unless they are a part."""
    folder = out or (RESULTS if whole else None)
    if folder is None:
        return []
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in found.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in found]


def run_job(spec_json: str) -> str:
    name = json.loads(spec_json)["name"]
    path = FOLDER / f"{name}.json"
    if not path.exists():
        case = run(spec_json)
        path.with_suffix(".part").write_text(json.dumps(case))
        path.with_suffix(".part").replace(path)
    return name


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.gap.study", description=__doc__.split("\n")[0])
    parser.add_argument(
        "--seeds", type=int, default=SEEDS, help=f"of each case at typical size; default: {SEEDS}"
    )
    parser.add_argument(
        "--sizes", type=int, default=SIZES, help=f"the same at half and double size; default: {SIZES}"
    )
    parser.add_argument(
        "--only", nargs="*", default=[], metavar="PART", help="cases with this in their names"
    )
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--again", action="store_true", help="forget the cases that are done")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="where tables go; default: scripts/results, if it is no part"
    )
    options = parser.parse_args()
    if options.again:
        shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True, exist_ok=True)
    specs = choose_cases(options.seeds, options.only, options.sizes)
    kept = ("name", "effects", "seed", "size")
    texts = [json.dumps({k: getattr(s, k) for k in kept}) for s in specs]
    if run_in_processes(run_job, texts, options.jobs, "case") is None:
        return 130
    cases = [json.loads((FOLDER / f"{s.name}.json").read_text()) for s in specs]
    found = make_tables(cases)
    print("\n".join(found.values()))
    whole = {s.name for s in specs} >= {s.name for s in choose_cases(SEEDS, [], SIZES)}
    written = [str(p) for p in write(found, whole, options.out)]
    print(
        f"written: {', '.join(written)}" if written else "a part of the study: not written (--out DIR)",
        file=sys.stderr,
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
