"""The commands `tselab fmu ...`."""

from __future__ import annotations

from pathlib import Path

import click

from tse.impl.errors import UserError
from tselab.options import FILE, JSON

REALS = ("double", "float", "fixed")
PLATFORM_NAMES = ("linux64", "win64", "darwin64", "aarch64-linux", "aarch64-darwin")


@click.group()
def fmu() -> None:
    """Build FMUs (FMI 2.0 and 3.0, co-simulation), and their parameters for a car.

    \b
    tselab fmu build --all-platforms --out fmus
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
    from tselab.fmu_build import build as run
    from tselab.fmu_platforms import FMI

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
    from tselab.fmu_parameters import parameter_set, parameters_of

    out = out or Path(f"{vehicle_path.stem}.ssv")
    check_writable(out)
    known, vehicle = parameters_of(path), read_vehicle(vehicle_path)
    config, _ = make_config(vehicle, None, None, {}, "default")
    with atomic(out, "wb") as file:
        file.write(parameter_set(known, config, vehicle.name or vehicle_path.stem).encode())
    click.echo(f"Parameter set written to {out}")
