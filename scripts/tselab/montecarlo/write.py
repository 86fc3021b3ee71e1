"""What a study leaves in its directory: NAME.csv, NAME.md and, with matplotlib, NAME.png."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from tse.impl import __version__
from tse.impl.core import library
from tse.impl.estimate import write_table
from tse.impl.files import atomic
from tselab.montecarlo import findings, pictures, summary
from tselab.montecarlo.engine import Plan
from tselab.montecarlo.summary import Table


def write(plan: Plan, runs: pd.DataFrame, out: Path) -> tuple[str, list[Path]]:
    """Write all files. Returned: the Markdown, and which files."""
    lines = summary.summarise(plan, runs)
    tables = findings.findings(plan, runs, lines)
    if plan.study.base not in ("paper", "robust"):  # their own tables say it all
        tables += [summary.overview(plan, lines), *findings.changes(plan, lines)]
    facts = run_facts(plan, lines)
    text = markdown(plan, facts, tables)
    path = {end: out / f"{plan.study.name}.{end}" for end in ("csv", "md", "png")}
    write_table(lines, path["csv"])
    with atomic(path["md"]) as file:
        file.write(text)
    if not pictures.draw(plan, runs, lines, path["png"]):
        del path["png"]
    return text, list(path.values())


def command(plan: Plan) -> str:
    """What to type for the same result."""
    parts = [f"tselab montecarlo --study {plan.study.name} --runs {plan.runs}"]
    if plan.study.name == "paper":
        parts = [f"tselab paper --runs {plan.runs}"]
    parts += [f"--first-seed {plan.first_seed}"] if plan.first_seed != 1 else []
    parts += [f"--form {plan.form}"] if plan.form != "default" else []
    parts += [f"--set {k}={v:g}" for k, v in {**plan.settings, **plan.sim_settings}.items()]
    parts += [f"--cases {','.join(plan.cases)}"] if plan.cases else []
    return " ".join(parts)


def run_facts(plan: Plan, lines: pd.DataFrame) -> list[tuple[str, str]]:
    """What is needed to repeat it, and what it cost."""
    lib, first = library(), lines.iloc[0]
    seeds = f"seeds {plan.seeds[0]} .. {plan.seeds[-1]}" if plan.runs > 1 else f"seed {plan.first_seed}"
    settings = [f"{k} = {v:g}" for k, v in {**plan.settings, **plan.sim_settings}.items()]
    return [
        ("Runs", f"{plan.runs} of each case, {seeds}"),
        ("Settings", f"form {plan.form}" + "".join(f", {s}" for s in settings)),
        ("Command", f"`{command(plan)}`"),
        ("Library", f"tse {lib.version}, {lib.format}; tselab {__version__}"),
        ("Cost", f"{first['simulate_s'] + first['estimate_s']:.2f} s a run of case {first['case']} and estimator "
         f"{first['estimator']}, {first['simulate_s']:.2f} s of it simulation and scores"),
    ]  # fmt: skip


def markdown(plan: Plan, facts: list[tuple[str, str]], tables: list[Table]) -> str:
    """The result as text."""
    lines = [f"# {plan.study.title}", "", *(f"- {name}: {value}" for name, value in facts)]
    for table in tables:
        lines += ["", table.markdown()]
    return "\n".join([*lines, "", f"Intervals of all values: {plan.study.name}.csv; each run: runs.csv.", ""])
