"""The commands `tselab montecarlo` and `tselab paper`."""

from pathlib import Path
from typing import Any

import click

from tse.errors import Error
from tselab.montecarlo import STUDIES
from tselab.options import (
    FILE,
    FIRST_SEED,
    FORM,
    JOBS,
    JSON,
    PROGRESS,
    RESTART,
    Lazy,
    print_json,
    read_key_values,
    show_progress,
)


def _list_studies() -> str:
    return "\n".join(f"{name:<11} {runs:>3} runs  {title}" for name, (runs, title) in STUDIES.items())


@click.command(cls=Lazy, tables=(("Studies, with the default number of runs of each case", _list_studies),))
@click.option("--study", "name", metavar="NAME", required=True, help="Name of the study; list below.")
@click.option(
    "--runs",
    type=click.IntRange(1, 1000000),
    help="Number of runs of each case, each with a seed of its own; default: see the list below.",
)
@JOBS
@click.option(
    "--scheduler", metavar="ADDRESS", help="Run on a Dask cluster instead, for instance tcp://host:8786."
)
@click.option(
    "--out", metavar="DIR", type=FILE, help="Directory; created if needed.  [default: montecarlo-NAME]"
)
@click.option("--cases", metavar="A,B", help="Run only these cases of the study.")
@FIRST_SEED
@FORM
@click.option(
    "--set",
    "pairs",
    metavar="KEY=VALUE",
    multiple=True,
    help="Any setting of filter or simulator; may be repeated. If a case has a value for the same setting, "
    "that value is used.",
)
@RESTART
@PROGRESS
@JSON
def montecarlo(
    name: str,
    runs: int | None,
    jobs: int,
    scheduler: str | None,
    out: Path | None,
    cases: str | None,
    first_seed: int,
    form: str,
    pairs: tuple[str, ...],
    restart: bool,
    progress: bool | None,
    as_json: bool,
) -> None:
    """Run a Monte-Carlo study: simulate drives, and compare the estimates with the truth.

    \b
    tselab montecarlo --study stress --runs 200 --jobs 2
    tselab montecarlo --study peers --runs 20 --cases nominal,noise-3x --out peers
    tselab montecarlo --study stress+ekf --runs 200
    tselab montecarlo --study stress --scheduler tcp://host:8786

    Every finished run is kept in DIR/runs.jsonl, where DIR is the directory of --out.
    After Ctrl-C the same command continues with the remaining runs. With larger --runs or
    more --cases, only the missing runs are done. Runs with different settings or a
    different library are not reused.

    --study NAME+ekf adds an extended Kalman filter to the estimators of the study NAME.
    All estimators get the same simulated logs. NAME+module.function adds a Python
    function of your own. The function receives the log and the settings, and returns
    columns cx_front, cx_front_sd ... (scripts/examples/own_filter.py).

    Writes NAME.csv, NAME.md and runs.csv to DIR.
    """
    from tse import tables

    settings: dict[str, float] = {}
    sim_settings: dict[str, float] = {}
    of_simulator = tables.settings(simulator=True)
    for key, value in read_key_values(pairs).items():
        if key == "seed":
            raise Error("option --set: seed is not allowed: --first-seed and --runs set the seeds")
        tables.check_setting(key, value, source="option --set", simulator=True)
        (sim_settings if key in of_simulator else settings)[key] = value
    wanted = tuple(c.strip() for c in cases.split(",")) if cases is not None else ()
    plan = {"form": form, "settings": settings, "sim_settings": sim_settings, "cases": wanted}
    _run_study(
        name,
        runs,
        first_seed,
        out or Path(f"montecarlo-{name}"),
        plan,
        jobs,
        scheduler,
        restart,
        progress,
        as_json,
    )


def _run_study(
    name: str,
    runs: int | None,
    first_seed: int,
    out: Path,
    plan: dict[str, Any],
    jobs: int,
    scheduler: str | None,
    restart: bool,
    progress: bool | None,
    as_json: bool,
) -> None:
    """Run a study, write its files, and print its tables."""
    from tselab.montecarlo import studies
    from tselab.montecarlo.engine import StudyPlan
    from tselab.montecarlo.engine import run_study as run_all
    from tselab.montecarlo.pictures import write_study

    study = studies.make_study(name, plan.get("cases", ()))
    todo = StudyPlan(study, runs or study.runs, first_seed, **plan)
    rows = run_all(todo, out, jobs, scheduler, restart, show_progress(progress))
    text, files = write_study(todo, rows, out)
    if as_json:
        print_json({"study": name, "text": text, "written": files})
        return
    click.echo(text)
    click.echo(f"Written to {out}: {', '.join(f.name for f in files)}")


@click.command()
@click.option(
    "--runs",
    type=click.IntRange(1, 1000000),
    help="Number of runs of each case, each with a seed of its own.  [default: 200]",
)
@JOBS
@click.option(
    "--out",
    metavar="DIR",
    type=FILE,
    default=Path("paper"),
    show_default=True,
    help="Directory; created if needed.",
)
@FIRST_SEED
@RESTART
@PROGRESS
@JSON
def paper(
    runs: int | None,
    jobs: int,
    out: Path,
    first_seed: int,
    restart: bool,
    progress: bool | None,
    as_json: bool,
) -> None:
    """Reproduce Fig. 1 .. 4 of the paper with three filters, and compare the results with
    the numbers in the paper. The paper is "Tire-Stiffness Estimation by Marginalized
    Adaptive Particle Filter" (2016), from which tse starts.

    \b
    tselab paper
    tselab paper --runs 40 --jobs 2 --out paper

    The three filters are the paper's filter as printed, the same filter with settings
    that keep it from diverging, and the default filter.

    Every finished run is kept in DIR/runs.jsonl, where DIR is the directory of --out.
    After Ctrl-C the same command continues with the remaining runs. The command writes
    paper.csv, paper.md, runs.csv and, if matplotlib is installed, paper.png to DIR.
    """
    _run_study("paper", runs, first_seed, out, {}, jobs, None, restart, progress, as_json)
