"""Make the software bill of materials of a release: CycloneDX 1.6, as JSON.

scripts/dev/release.py calls this module. The bill lists:
 - the files of the release, each with its SHA-256;
 - the FMI headers, which are third-party sources in the FMUs;
 - the Python packages that tse and tselab require at run time, directly or through other
   packages, each with its version in scripts/lock.txt.
The C library requires the C standard library only.
"""

import re
import sys
import uuid
from datetime import datetime, timezone
from pathlib import Path

from cyclonedx.model import HashAlgorithm, HashType
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.model.license import DisjunctiveLicense
from cyclonedx.output.json import JsonV1Dot6
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from packageurl import PackageURL

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SPACE = uuid.UUID("5f1c3a52-6e7b-4a43-8f3d-6b8f5ad0e3b1")  # UUID namespace of the bills' serial numbers
# name, version and licence of the third-party sources in the folder sources/ of an FMU
IN_FMUS = ("FMI 2.0.1 headers", "2.0.1", "BSD-2-Clause")


def read_pins(lock: Path) -> dict[str, tuple[str, set[str]]]:
    """Return, for each package of a lock file, its version and the packages that need it.

    If the file has different versions of a package for different Pythons, return the last
    one in the file, which is the newest.
    """
    found: dict[str, tuple[str, set[str]]] = {}
    name = ""
    for line in lock.read_text(encoding="utf-8").splitlines():
        if pin := re.match(r"([A-Za-z0-9._-]+)==(\S+)", line):
            name = pin[1].lower()
            found[name] = (pin[2], found.get(name, ("", set()))[1])
        elif via := re.match(r"    #   (?:via )?(\S+)", line.replace("# via ", "#   ")):
            found[name][1].add(via[1].lower())
    return found


def find_required(lock: Path, direct: list[str]) -> dict[str, tuple[str, set[str]]]:
    """Return the entries of read_pins() for the packages `direct` and their dependencies.

    Dependencies of dependencies are included."""
    all_of_them = read_pins(lock)
    names, before = set(direct) & set(all_of_them), set()
    while names != before:
        before = set(names)
        names |= {n for n, (_, by) in all_of_them.items() if by & names}
    return {n: all_of_them[n] for n in sorted(names)}


def make_bom(folder: Path, version: str, epoch: int, files: dict[str, str]) -> Bom:
    """Return the bill of materials of a release.

    Parameters
    ----------
    folder : Path
        Folder with the sources.
    version : str
        Version of the release.
    epoch : int
        [s] Time of the commit, since 1970.
    files : dict of str to str
        SHA-256 of each file of the release, by name.
    """
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = [*project["dependencies"], *project["optional-dependencies"]["lab"]]
    direct = [re.match(r"[A-Za-z0-9._-]+", d)[0].lower() for d in names]
    made = Bom()
    tse = Component(
        name="tse",
        version=version,
        type=ComponentType.LIBRARY,
        bom_ref=f"tse@{version}",
        description=project["description"],
        licenses=[DisjunctiveLicense(id=project["license"])],
        purl=PackageURL("pypi", name="tse", version=version),
    )
    made.metadata.component = tse
    made.metadata.timestamp = datetime.fromtimestamp(epoch, timezone.utc)
    for name, digest in sorted(files.items()):
        hashes = [HashType(alg=HashAlgorithm.SHA_256, content=digest)]
        tse.components.add(
            Component(name=name, type=ComponentType.FILE, hashes=hashes, bom_ref=f"file:{name}")
        )
    name, of, licence = IN_FMUS
    headers = Component(name=name, version=of, type=ComponentType.LIBRARY, bom_ref="fmi-headers",
                        licenses=[DisjunctiveLicense(id=licence)])  # fmt: skip
    made.components.add(headers)
    made.register_dependency(headers)
    packages = find_required(folder / "scripts" / "lock.txt", direct)
    components = {
        n: Component(
            name=n,
            version=v,
            type=ComponentType.LIBRARY,
            bom_ref=f"{n}@{v}",
            purl=PackageURL("pypi", name=n, version=v),
        )
        for n, (v, _) in packages.items()
    }
    for component in components.values():
        made.components.add(component)
    made.register_dependency(tse, [headers, *(components[n] for n in direct if n in components)])
    for n, component in components.items():
        made.register_dependency(component, [components[m] for m, (_, by) in packages.items() if n in by])
    content = [
        *(f"{n} {d}" for n, d in sorted(files.items())),
        *sorted(c.bom_ref.value for c in components.values()),
    ]
    named = "\n".join([version, str(epoch), *content])
    made.serial_number = uuid.uuid5(SPACE, named)
    return made


def format_json(made: Bom) -> str:
    """Return a bill of materials as JSON.

    Raises
    ------
    ValueError
        The text does not conform to the schema of CycloneDX.
    """
    text = JsonV1Dot6(made).output_as_string(indent=1) + "\n"
    if error := JsonStrictValidator(SchemaVersion.V1_6).validate_str(text):
        raise ValueError(f"the bill of materials does not conform to the schema of CycloneDX: {error}")
    return text
