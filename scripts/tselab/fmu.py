"""The commands `tselab fmu ...`."""

import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import click

from tse.errors import Error, NoFile
from tselab.options import FILE, JSON, print_json

# ---- Write the parameters of a vehicle as a parameter set (.ssv) of the standard SSP,
# which tools that connect FMUs can read.

HEAD = """<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet version="1.0" name={name}
    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssv:Parameters>
"""
TAIL = """  </ssv:Parameters>
</ssv:ParameterSet>
"""
# Name of a parameter that only the FMU of the estimator has. A file without this
# parameter is not the FMU of the estimator
EXACT_PARAMETER = "vehicle.exact"


class FmuParameter(NamedTuple):
    """A parameter of an FMU, from its modelDescription.xml."""

    name: str
    kind: str  # type of the parameter in SSP: Real, Integer ...
    start: str  # start value


def read_parameters(fmu: Path) -> list[FmuParameter]:
    """Read the parameters of the FMU of the estimator, for FMI 2.0 or 3.0. Raise Error
    for any other file."""
    try:
        with zipfile.ZipFile(fmu) as archive:
            root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    except FileNotFoundError:
        raise NoFile(f"{fmu}: no such file") from None
    except Exception as error:  # zipfile and ElementTree raise many types
        raise Error(f"{fmu}: is not an FMU: {error}") from None
    found = []
    for variable in root.iterfind("ModelVariables/*"):
        value = variable[0] if variable.tag == "ScalarVariable" else variable
        kind = {"Float64": "Real", "Int32": "Integer"}.get(value.tag, value.tag)
        if variable.get("causality") == "parameter":
            found.append(FmuParameter(variable.get("name", ""), kind, value.get("start", "0")))
    if EXACT_PARAMETER not in [p.name for p in found]:
        raise Error(f"{fmu}: is not the FMU of the estimator: give TireStiffnessEstimator.fmu")
    return found


def format_parameter_set(parameters: Iterable[FmuParameter], settings: Mapping[str, float], name: str) -> str:
    """Return the SSP parameter set of a car. It contains all parameters vehicle.* except
    vehicle.exact. It contains any other parameter only if the value of the car differs
    from the start value in the FMU.

    Parameters
    ----------
    parameters
        Parameters of the FMU.
    settings
        Settings of the car by name. For example, the parameter effects.body_roll.gain has
        the value of the setting body_roll_gain: its name without the part before the
        first dot, and with _ for each further dot.
    name
        Name of the car.
    """
    lines = []
    for p in parameters:
        if p.name == EXACT_PARAMETER:
            # left out, so that it stays false. If it were true, each parameter that is
            # missing in the set would get the value of the default car of the simulator,
            # with an sd of 0, instead of its start value
            continue
        value = settings.get(p.name.partition(".")[2].replace(".", "_"), float(p.start))
        if not p.name.startswith("vehicle.") and value == float(p.start):
            continue
        text = str(int(value)) if p.kind == "Integer" else repr(float(value))
        lines.append(f'    <ssv:Parameter name="{p.name}"><ssv:{p.kind} value="{text}"/></ssv:Parameter>\n')
    return HEAD.format(name=quoteattr(name)) + "".join(lines) + TAIL


REALS = ("double", "float", "fixed")
PLATFORM_NAMES = ("linux64", "win64", "darwin64", "aarch64-linux", "aarch64-darwin")


@click.group()
def fmu() -> None:
    """Build FMUs (FMI 2.0 and 3.0, co-simulation), and write their parameters for a car.

    \b
    tselab fmu build --all-platforms --out fmus
    tselab fmu parameters fmus/TireStiffnessEstimator.fmu --vehicle car.toml
    """


@fmu.command(short_help="Build the FMUs of this checkout.")
@click.option(
    "--out",
    metavar="DIR",
    type=FILE,
    default=Path("fmus"),
    show_default=True,
    help="Directory; created if needed.",
)
@click.option("--all-platforms", is_flag=True, help="Include binaries for all platforms.")
@click.option(
    "--platform",
    "chosen",
    multiple=True,
    type=click.Choice(PLATFORM_NAMES),
    help="Include the binary for this platform; may be repeated.",
)
@click.option(
    "--max-particles",
    type=click.IntRange(16, 65535),
    help="Max number of particles of an estimator.  [default: 512]",
)
@click.option(
    "--real",
    type=click.Choice(REALS),
    default=REALS[0],
    show_default=True,
    help="Number format of the estimator; choose the format that your controller uses. The FMU of the "
    "vehicle always uses double.",
)
@click.option(
    "--fmi",
    type=click.Choice(("2", "3", "both")),
    default="both",
    show_default=True,
    help="Version of FMI: 2.0 (NAME.fmu), 3.0 (NAME-fmi3.fmu), or both.",
)
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
    """Build the FMUs of this checkout, and the SSP system that connects them.

    \b
    tselab fmu build
    tselab fmu build --all-platforms --out fmus
    tselab fmu build --fmi 3
    tselab fmu build --real fixed --out fmus-fixed

    By default, each FMU has only the binary for this machine, made by the C compiler of
    this machine. With --platform or --all-platforms, the Python package ziglang (extra
    'platforms') compiles the binaries of the chosen platforms, from the folder sources/
    of each FMU. These binaries also run on old systems: linux64 needs only glibc 2.2.5.
    The same sources always give the same files, byte for byte. Files are written only
    after everything was built.

    By default there are two files for each model: one for FMI 2.0, which most tools read,
    and one for FMI 3.0, because an FMU can only be of one version. The results of the two
    files are equal bit by bit. The SSP system contains the FMUs for FMI 2.0.
    """
    from tse.files import check_directory
    from tselab.fmu_build import FMI
    from tselab.fmu_build import build as run

    check_directory(out)
    wanted = PLATFORM_NAMES if all_platforms else tuple(dict.fromkeys(chosen))
    versions = FMI if fmi == "both" else (fmi,)
    made = run(out, wanted, max_particles, lambda text: click.echo(text, err=True), real, versions)
    if as_json:
        print_json(
            [{"path": f.path, "bytes": f.path.stat().st_size, "platforms": list(f.binaries)} for f in made]
        )
        return
    for file in made:
        inside = ", ".join(file.binaries)
        click.echo(f"{file.path}: {file.path.stat().st_size:,} bytes{f' ({inside})' if inside else ''}")


@fmu.command(short_help="Write a vehicle as a parameter set of SSP.")
@click.argument("path", metavar="FMU", type=FILE)
@click.option("--vehicle", "vehicle_path", metavar="CAR.toml", type=FILE, required=True, help="Vehicle file.")
@click.option(
    "--out",
    metavar="OUT.ssv",
    type=FILE,
    help="The parameter set; default: name of the vehicle file with .ssv, in the current directory.",
)
def parameters(path: Path, vehicle_path: Path, out: Path | None) -> None:
    """Write a vehicle as a parameter set of SSP (.ssv) for the FMU of the estimator.

    \b
    tselab fmu parameters TireStiffnessEstimator.fmu --vehicle car.toml --out car.ssv

    In a tool that reads SSP systems, use OUT.ssv as the parameters of the estimator,
    instead of resources/vehicle.ssv of StiffnessStudy.ssp. A parameter that is not in
    OUT.ssv keeps its start value: the value for an ordinary car.
    """
    import tse
    from tse.files import check_distinct, check_writable, write_atomically

    out = out or Path(f"{vehicle_path.stem}.ssv")
    check_distinct({"--out": out}, {"the FMU": path, "--vehicle": vehicle_path})
    check_writable(out)
    known, car = read_parameters(path), tse.read_vehicle(vehicle_path)
    settings = tse.Filter(car).settings
    with write_atomically(out, "wb") as file:
        file.write(format_parameter_set(known, settings, car.name or vehicle_path.stem).encode())
    click.echo(f"Parameter set written to {out}")
