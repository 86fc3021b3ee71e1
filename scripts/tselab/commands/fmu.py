"""The commands `tselab fmu ...`."""

from __future__ import annotations

import sys
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tse.impl.errors import UserError
from tselab.commands.options import FILE, FORM, JSON, PROGRESS, key_values, reading, show_progress

if TYPE_CHECKING:
    from tse.impl.rows import Reading

REALS = ("double", "float", "fixed")
PLATFORM_NAMES = ("linux64", "win64", "darwin64", "aarch64-linux", "aarch64-darwin")


@click.group()
def fmu() -> None:
    """Build, check and run FMUs (FMI 2.0 and 3.0, co-simulation).

    \b
    tselab fmu build --all-platforms --out fmus
    tselab fmu validate fmus/*.fmu
    tselab fmu run fmus/TireStiffnessEstimator.fmu log.csv --vehicle car.toml
    tselab fmu parameters fmus/TireStiffnessEstimator.fmu --vehicle car.toml
    """


@fmu.command(short_help="Build the FMUs of this checkout.")
@click.option(
    "--out", metavar="DIR", type=FILE, default=Path("fmus"), show_default=True, help="Directory; made if needed."
)
@click.option("--all-platforms", is_flag=True, help="With binaries of all platforms.")
@click.option("--platform", "chosen", multiple=True, type=click.Choice(PLATFORM_NAMES),
              help="With the binary of this platform; may be repeated.")  # fmt: skip
@click.option(
    "--max-particles", type=click.IntRange(16, 65535), help="Particles that an estimator can hold.  [default: 512]"
)
@click.option("--real", type=click.Choice(REALS), default=REALS[0], show_default=True,
              help="Numbers in which the estimator computes, as in your controller; the vehicle always in double.")  # fmt: skip
@click.option("--fmi", type=click.Choice(("2", "3", "both")), default="both", show_default=True,
              help="Version of FMI: 2.0 (X.fmu), 3.0 (X-fmi3.fmu).")  # fmt: skip
@JSON
def build(
    out: Path,
    all_platforms: bool,
    chosen: tuple[str, ...],
    max_particles: int | None,
    real: str,
    fmi: str,
    as_json: bool,
) -> None:
    """Build the FMUs of this checkout, and the system that connects them.

    \b
    tselab fmu build
    tselab fmu build --all-platforms --out fmus
    tselab fmu build --fmi 3
    tselab fmu build --real fixed --out fmus-fixed

    Without platforms: the binary of this machine, by its C compiler. The others, and then this one too, are compiled from the
    sources/ that each FMU carries by the Python package ziglang (extra 'platforms'), and run on old systems: linux64 needs
    glibc 2.2.5. The same sources give the same files, byte for byte. Nothing is written before all has been built.

    Each model for FMI 2.0, which most tools read, and for FMI 3.0: an importer reads one modelDescription.xml, which is of one
    version, so they are two files. Both compute the same bits; the system (SSP) holds those of 2.0.
    """
    from tselab.fmu.build import build as run
    from tselab.fmu.platforms import FMI

    if out.exists() and not out.is_dir():
        raise UserError(f"{out}: is a file, a directory is needed")
    wanted = PLATFORM_NAMES if all_platforms else tuple(dict.fromkeys(chosen))
    versions = FMI if fmi == "both" else (fmi,)
    from tse.impl.results import say_json

    made = run(out, wanted, max_particles, lambda text: click.echo(text, err=True), real, versions)
    if as_json:
        say_json([{"path": f.path, "bytes": f.path.stat().st_size, "platforms": list(f.binaries)} for f in made])
        return
    for file in made:
        inside = ", ".join(file.binaries)
        click.echo(f"{file.path}: {file.path.stat().st_size:,} bytes{f' ({inside})' if inside else ''}")


@fmu.command(short_help="Check FMUs with every validator there is.")
@click.argument("paths", metavar="FMU ...", type=FILE, nargs=-1, required=True)
@click.option("--clients", is_flag=True, help="Also run each FMU in every client that is installed, and compare.")
@click.option("--results", metavar="DIR", type=FILE, help="Write the tables there: fmu_validators.md, fmu_clients.md.")
@JSON
def validate(paths: tuple[Path, ...], clients: bool, results: Path | None, as_json: bool) -> None:
    """Check FMUs, also other people's, with every validator there is.

    \b
    tselab fmu validate fmus/*.fmu
    tselab fmu validate --clients fmus/*.fmu

    \b
    FMPy validate_fmu   the standard's rules, as FMPy reads them
    fmutool -check      the same, as the FMU Manipulation Toolbox does
    XML schema          of the standard, for modelDescription.xml and buildDescription.xml
    tselab              what importers complain about: exported names, libraries and glibc needed, executable stack, platforms,
                        units, descriptions, documentation, licences, and whether sources/ compiles
    VDMCheck            a formal model of the standard, FMI 2.0 only; needs Java, and Maven that fetches it the first time

    --clients: the same run in FMPy, ecos, libcosim (extra 'clients'), and of the binaries for win64 under wine and for
    aarch64-linux under qemu. All values at all steps are compared with FMPy's: more than 1e-9 of an output's largest value is a
    finding.

    Exit code: 0 no findings, 1 findings, 2 a file that is no FMU. What could not run is said, and no finding.
    """
    from tse.impl.results import say_json
    from tse.impl.tables import text_table
    from tselab.fmu import clients as others
    from tselab.fmu.archive import open_archive
    from tselab.fmu.validate import validate as run

    def say(text: str) -> None:
        click.echo(text, err=True)

    if results is not None and not results.is_dir():
        raise UserError(f"{results}: is not a directory")
    archives = [open_archive(path) for path in paths]
    all_verdicts, all_rows, found = {}, [], 0
    documents: list[dict[str, Any]] = []
    echo = (lambda _: None) if as_json else click.echo
    for archive in archives:
        verdicts = all_verdicts[archive.path.name] = run(archive, say)
        documents.append(document := {"fmu": archive.path, "validators": [vars(v) for v in verdicts], "clients": []})
        rows = [["validator", "version", "findings"]]
        rows += [
            [v.validator, v.version, f"skipped: {v.skipped}" if v.skipped else str(len(v.findings))] for v in verdicts
        ]
        echo(f"{archive.path}\n{textwrap.indent(text_table(rows), '  ')}")
        for v in verdicts:
            for text in v.findings:
                echo(f"  {v.validator}: {text}")
        found += sum(len(v.findings) for v in verdicts)
        if clients:
            compared = others.compare(archive.path, say)
            rows = [["client", "version", "run", "largest difference to FMPy"]]
            rows += [[r.client, r.version, r.run, r.text] for r in compared]
            echo("\n" + textwrap.indent(text_table(rows), "  "))
            document["clients"] = [vars(r) for r in compared]
            found += sum(r.is_finding for r in compared)
            all_rows += compared
    if results is not None:
        for path in others.write(results, all_verdicts, all_rows):
            echo(f"Written: {path}")
    if as_json:
        say_json({"findings": found, "fmus": documents})
    if found:
        sys.exit(1)


@fmu.command(short_help="Write a vehicle as a parameter set of SSP.")
@click.argument("path", metavar="FMU", type=FILE)
@click.option("--vehicle", "vehicle_path", metavar="CAR.toml", type=FILE, required=True, help="Vehicle file.")
@click.option(
    "--out", metavar="OUT.ssv", type=FILE, help="Default: the vehicle's name with .ssv, in the current directory."
)
def parameters(path: Path, vehicle_path: Path, out: Path | None) -> None:
    """Write a vehicle as a parameter set of SSP (.ssv) for the estimator.

    \b
    tselab fmu parameters TireStiffnessEstimator.fmu --vehicle car.toml --out car.ssv

    Tools that connect FMUs by SSP take it as the parameters of the estimator, in place of resources/vehicle.ssv of
    StiffnessStudy.ssp. It sets vehicle.calibrated: nothing is left to the class of the car. What is not in it has its start value.
    """
    from tse.impl.config import make_config
    from tse.impl.files import atomic, check_writable
    from tse.impl.vehicle import read_vehicle
    from tselab.fmu.archive import open_archive, read_description
    from tselab.fmu.run import is_estimator, parameter_set

    out = out or Path(f"{vehicle_path.stem}.ssv")
    check_writable(out)
    open_archive(path)
    variables = {v.name: v for v in read_description(path).modelVariables}
    if not is_estimator(variables):
        raise UserError(f"{path}: is not the estimator")
    vehicle = read_vehicle(vehicle_path)
    config, _ = make_config(vehicle, None, None, {}, "default")
    with atomic(out, "wb") as file:
        file.write(parameter_set(variables, config, vehicle.name or vehicle_path.stem).encode())
    click.echo(f"Parameter set written to {out}")


@fmu.command(short_help="Run the estimator FMU over a log.")
@click.argument("path", metavar="FMU", type=FILE)
@click.argument("log_path", metavar="LOG", type=FILE)
@click.option("--vehicle", "vehicle_path", metavar="CAR.toml", type=FILE, required=True, help="Vehicle file.")
@click.option(
    "--config", "config_path", metavar="FILTER.toml", type=FILE, help="Filter settings, as for 'tselab estimate'."
)
@click.option(
    "--out", metavar="EST.csv", type=FILE, help="Default: the log's name with .est.csv, in the current directory."
)
@click.option(
    "--average", metavar="SECONDS", type=float, help="Average the log over blocks of so long first, at most 0.1 s."
)
@reading
@click.option("--seed", type=int, help="Seed of the random numbers.")
@click.option("--particles", type=int, help="Particles in use.")
@click.option("--forgetting", type=float, help="Forgetting factor per sample.")
@FORM
@click.option("--set", "pairs", metavar="KEY=VALUE", multiple=True, help="Any setting; may be repeated.")
@PROGRESS
@JSON
def run(
    path: Path,
    log_path: Path,
    vehicle_path: Path,
    config_path: Path | None,
    out: Path | None,
    average: float | None,
    form: str,
    pairs: tuple[str, ...],
    progress: bool | None,
    reading: Reading,
    as_json: bool,
    **options: Any,
) -> None:
    """Run the estimator FMU over a log.

    \b
    tselab fmu run fmus/TireStiffnessEstimator.fmu log.csv --vehicle car.toml --out est.csv

    EST.csv is the same, byte for byte, as that of 'tselab estimate' with the same options. Ctrl-C stops early and writes the rows
    done so far. Other FMUs run in FMPy: python -m fmpy simulate SingleTrackVehicle.fmu --input-file driver.csv
    """
    from tse.impl.estimate import write_table
    from tse.impl.files import check_distinct, check_writable
    from tse.impl.fleet.single import prepare
    from tselab.fmu import run as runs
    from tselab.fmu.archive import open_archive

    open_archive(path)
    out = out or Path(f"{log_path.stem}.est.csv")
    inputs = {"the FMU": path, "the log": log_path, "--vehicle": vehicle_path, "--config": config_path}
    check_distinct({"--out": out}, inputs)
    check_writable(out)
    prepared = prepare(log_path, vehicle_path, config_path, average, options, form, key_values(pairs), reading)
    for line in prepared.notes:
        click.echo(f"{'warning' if line in prepared.warnings else 'note'}: {line}", err=True)
    done = runs.estimate(path, prepared.log, prepared.config, show_progress(progress))
    write_table(done.table, out)
    if as_json:
        from tse.impl.results import say_json

        say_json(
            {"fmu": path, "rows": len(done.table), "interrupted": done.interrupted, "notes": done.notes, "written": out}
        )
    else:
        for line in done.notes:
            click.echo(f"note: {line}", err=True)
        click.echo(f"{path.name}: {len(done.table)} rows written to {out}")
    if done.interrupted:
        click.echo(f"tselab: stopped by Ctrl-C; {out} holds the rows done", err=True)
        sys.exit(130)
