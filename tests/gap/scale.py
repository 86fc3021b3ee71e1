"""Measure time and memory of `tselab gap run` on many minutes of log.

    python -m tests.gap.scale [--duration SECONDS] [--only CASE ...] [--jobs N]
        [--out FILE]

From the root of the repository. Logs of the generator, of a car with roll and relaxation:
the six of a case as half an hour, with its two held-out ones as ten minutes; and twenty
of 90 s, two of every manoeuvre. The table goes to scripts/results/gap-scale.md. That of
other durations, or of one case, is only printed, unless --out is given.
"""

import argparse
import json
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from scripts.dev.measured import TSELAB, measure_command

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "scripts" / "results" / "gap-scale.md"
HIDDEN = {"body_roll": 1.0, "relaxation": 1.0}
SEED = 3
LONG, SHORT = 300.0, 90.0  # s of each log
VERDICTS = (0, 10, 11, 20)  # exit codes


@dataclass
class Row:
    """Measurements of one case."""

    case: str
    logs: str
    minutes: float  # of the logs that are fitted
    held_out: float  # minutes
    seconds: float
    gigabytes: float
    verdict: str


def write_long_logs(folder: Path, duration: float) -> None:
    """Write the logs of the study's case, longer."""
    from tests.gap.generator import Spec, make_cases

    next(make_cases([Spec("scale", HIDDEN, SEED, duration=duration)])).write(folder)


def write_many_logs(folder: Path, duration: float) -> None:
    """Write every manoeuvre twice: driven for twice as long, and cut."""
    import pandas as pd

    from tests.gap.generator import MANOEUVRES, Spec, make_cases

    each = min(SHORT, duration)
    spec = Spec("scale", HIDDEN, SEED, manoeuvres=tuple(MANOEUVRES), hold_out=(), duration=2.0 * each)
    next(make_cases([spec])).write(folder)
    for path in sorted(folder.glob("log_*.csv")):
        table = pd.read_csv(path)
        for k, part in enumerate((table[table["time"] < each], table[table["time"] >= each]), 1):
            part.to_csv(path.with_name(f"{path.stem}_{k}.csv"), index=False, float_format="%.9g")
        path.unlink()


CASES: dict[str, Callable[[Path, float], None]] = {"long": write_long_logs, "many": write_many_logs}


def run(case: str, duration: float, jobs: int) -> Row:
    """Make the logs of a case and run the command on them."""
    with tempfile.TemporaryDirectory() as name:
        folder, out = Path(name) / "logs", Path(name) / "out"
        # in a process of its own: what this one has in memory when it starts the command
        # counts as the command's
        maker = multiprocessing.get_context("spawn").Process(target=CASES[case], args=(folder, duration))
        maker.start()
        maker.join()
        if maker.exitcode:
            raise RuntimeError(f"{case}: no logs were made")
        logs, held = sorted(folder.glob("log_*.csv")), sorted(folder.glob("hold_out_*.csv"))
        command = [*TSELAB, "gap", "run", *logs, "--vehicle", folder / "car.toml", "--out", out]
        for path in held:
            command += ["--hold-out", path]
        _, seconds, _, memory = measure_command(*command, "--jobs", jobs, codes=VERDICTS, env=os.environ)
        verdict = json.loads((out / "verdict.json").read_text(encoding="utf-8"))
        names = ", ".join(e["id"] for e in verdict["effects"])
        of = f"{len(logs)}, and {len(held)} held out" if held else f"{len(logs)}"
        fitted, held_out = (sum(map(measure_minutes, paths)) for paths in (logs, held))
    return Row(
        case,
        of,
        fitted,
        held_out,
        seconds,
        memory / 1e9,
        verdict["verdict"] + (f": {names}" if names else ""),
    )


def measure_minutes(path: Path) -> float:
    """Return the minutes of a log, by its first and last time."""
    lines = path.read_text(encoding="utf-8").splitlines()
    column = lines[0].split(",").index("time")
    first, last = (float(lines[k].split(",")[column]) for k in (1, -1))
    return (last - first) / 60.0


def make_table(rows: Sequence[Row], jobs: int) -> str:
    """Return the rows as Markdown."""
    lines = [
        f"`python -m tests.gap.scale`: `tselab gap run --jobs {jobs}` on {count_cores()} cores. Hidden "
        f"effects: {' and '.join(HIDDEN)}.",
        "",
        "| case | logs | fitted logs [min] | held-out logs [min] | time [s] | memory [GB] | verdict |",
        "|---|---|---:|---:|---:|---:|---|",
    ]
    for r in rows:
        held_out = f"{r.held_out:.1f}" if r.held_out else "-"
        lines.append(
            f"| {r.case} | {r.logs} | {r.minutes:.1f} | {held_out} | {r.seconds:.0f} | {r.gigabytes:.2f} "
            f"| {r.verdict} |"
        )
    return "\n".join(lines) + "\n"


def count_cores() -> int:
    """Return the cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.gap.scale",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--duration",
        type=float,
        default=LONG,
        help=f"s of a log (%(default)g); of the many at most {SHORT:g}",
    )
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES), help="these cases")
    parser.add_argument("--jobs", type=int, default=2, help="threads of the command (%(default)s)")
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="for the table; default: the whole one's to scripts/results"
    )
    options = parser.parse_args(arguments)
    rows = []
    for case in dict.fromkeys(options.only):
        print(f"{case} ...", file=sys.stderr, flush=True)
        rows.append(run(case, options.duration, options.jobs))
    text = make_table(rows, options.jobs)
    print(text)
    whole = options.duration == LONG and set(options.only) == set(CASES)
    if path := options.out or (TABLE if whole else None):
        path.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
