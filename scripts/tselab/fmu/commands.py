"""The commands `tselab fmu ...`."""

from __future__ import annotations

from pathlib import Path

import click

from tselab.errors import UserError

FILE = click.Path(path_type=Path)
PLATFORM_NAMES = ("linux64", "win64", "darwin64", "aarch64-linux", "aarch64-darwin")


@click.group(short_help="Build, check and run FMUs.")
def fmu() -> None:
    """Build, check and run FMUs (FMI 2.0, co-simulation).

    \b
    tselab fmu build --all-platforms --out fmus
    tselab fmu validate fmus/*.fmu
    tselab fmu run fmus/TireStiffnessEstimator.fmu log.csv --vehicle car.toml
    """


@fmu.command(short_help="Build the FMUs of this checkout.")
@click.option("--out", metavar="DIR", type=FILE, default=Path("fmus"), show_default=True, help="Directory; made if needed.")
@click.option("--all-platforms", is_flag=True, help="With binaries of all platforms.")
@click.option("--platform", "chosen", multiple=True, type=click.Choice(PLATFORM_NAMES),
              help="With the binary of this platform; may be repeated.")  # fmt: skip
@click.option("--max-particles", type=click.IntRange(16, 65535), help="Particles that an estimator can hold.  [default: 512]")
def build(out: Path, all_platforms: bool, chosen: tuple[str, ...], max_particles: int | None) -> None:
    """Build the FMUs of this checkout, and the system that connects them.

    \b
    tselab fmu build
    tselab fmu build --all-platforms --out fmus

    Without platforms: the binary of this machine, by its C compiler. The others, and then this one too, are compiled from the
    sources/ that each FMU carries by the Python package ziglang (extra 'platforms'), and run on old systems: linux64 needs
    glibc 2.2.5. The same sources give the same files, byte for byte. Nothing is written before all has been built.
    """
    from tselab.fmu.build import build as run

    if out.exists() and not out.is_dir():
        raise UserError(f"{out}: is a file, a directory is needed")
    wanted = PLATFORM_NAMES if all_platforms else tuple(dict.fromkeys(chosen))
    for file in run(out, wanted, max_particles, lambda text: click.echo(text, err=True)):
        inside = ", ".join(file.binaries)
        click.echo(f"{file.path}: {file.path.stat().st_size:,} bytes{f' ({inside})' if inside else ''}")
