"""Run the gap workflow on the real logs in ../shared/data, if they are there.

    python -m tests.gap.real [--data DIR] [--out FILE] [--only LOG ...]

From the root of the repository; some minutes a log. The first two thirds of each log are
fitted, the last third is held out. The effects of these cars are unknown: only the text,
and the gap of the held-out third can be judged. Written to scripts/results/gap-real.md.
"""

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command has it

import pandas as pd

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "data"
RESULTS = ROOT / "scripts" / "results"
FITTED = 2 / 3  # of the rows
JOBS = 2


def make_row(folder: Path) -> str:
    """Return verdict and text of a log, and rms over noise of its last third, before
    and after."""
    from tse.gaps.run.output import write_all
    from tse.gaps.run.workflow import run_workflow

    with tempfile.TemporaryDirectory() as name:
        table = pd.read_csv(folder / "data.csv")
        cut = int(FITTED * len(table))
        parts = {"fitted.csv": table.iloc[:cut], "held_out.csv": table.iloc[cut:]}
        for file, rows in parts.items():
            rows.to_csv(Path(name) / file, index=False)
        start, out = time.perf_counter(), Path(name) / "out"
        out.mkdir()
        before = sum(os.times()[:4])
        result = run_workflow(
            [Path(name) / "fitted.csv"], folder / "vehicle.toml", [Path(name) / "held_out.csv"], JOBS
        )
        write_all(out, result, folder / "vehicle.toml", JOBS)
        seconds, used = time.perf_counter() - start, sum(os.times()[:4]) - before
    falls = [
        f"{c} {x.before:.2f} -> {x.after:.2f} ({100 * x.ci95[0]:+.0f} .. {100 * x.ci95[1]:+.0f} %)"
        for c, x in result.held_out.items()
    ]
    words = " ".join(result.words).replace("|", "\\|")
    verdict, taken = f"{result.verdict}, {result.exit_code}", f"{seconds:.0f} s, {used:.0f} s"
    return f"| {folder.name} | {verdict} | {words} | {'; '.join(falls) or '-'} | {taken} |"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.gap.real", description=__doc__.split("\n")[0])
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--out", type=Path, help="default: the table, if no log is left out")
    parser.add_argument("--only", nargs="*", default=[])
    options = parser.parse_args()
    folders = [f for f in sorted(options.data.glob("*")) if (f / "data.csv").exists()]
    folders = [f for f in folders if not options.only or f.name in options.only]
    if not folders:
        print(f"no logs in {options.data}")
        return 0
    head = (
        "| log | verdict, exit code | text of the verdict | held-out third: rms / noise, before -> after "
        "(95 % interval of the change) | elapsed time, processor time |"
    )
    lines = [head, "|---|---|---|---|---:|"]
    for k, folder in enumerate(folders, 1):
        print(f"{k} of {len(folders)}: {folder.name}", flush=True)
        lines.append(make_row(folder))
        out = options.out or (None if options.only else RESULTS / "gap-real.md")
        if out:
            out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
