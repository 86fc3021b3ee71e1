"""Every validator that can be had, on one FMU."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from lxml import etree

from tse.impl import __version__
from tse.impl.files import alone
from tselab.fmu import checks
from tselab.fmu.archive import Archive, need_fmpy
from tselab.fmu.platforms import need_lief


@dataclass
class Verdict:
    """What one validator says."""

    validator: str
    version: str
    findings: list[str] = field(default_factory=list)
    skipped: str = ""  # why it did not run


def validate(archive: Archive, say: Callable[[str], None] = lambda _: None) -> list[Verdict]:
    """Run all validators."""
    need_fmpy()
    need_lief()
    return [
        _fmpy(archive),
        _fmutool(archive),
        _schema(archive),
        Verdict("tselab", __version__, checks.check(archive)),
        _vdmcheck(archive, say),
    ]


def fmi_version(archive: Archive) -> str:
    """As its description says; empty where that has no entry."""
    try:
        return etree.fromstring(archive.read("modelDescription.xml")).get("fmiVersion", "")
    except etree.XMLSyntaxError:
        return ""


def package_version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def _fmpy(archive: Archive) -> Verdict:
    from fmpy.validation import validate_fmu

    return Verdict("FMPy validate_fmu", package_version("fmpy"), validate_fmu(str(archive.path)))


TOOLBOX = "fmu_manipulation_toolbox"


def _fmutool(archive: Archive) -> Verdict:
    verdict = Verdict("fmutool -check", package_version("fmu-manipulation-toolbox"))
    if find_spec(TOOLBOX) is None:
        verdict.skipped = "not installed (extra 'fmu')"
        return verdict
    program = f"import sys; from {TOOLBOX}.cli.fmutool import fmutool; sys.exit(fmutool())"
    command = [sys.executable, "-c", program, "-input", str(archive.path), "-check"]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace")
    lines = (done.stdout + done.stderr).splitlines()
    said = [line.partition("|")[2].strip() for line in lines if line.startswith(("ERROR", "CRITICAL", "WARNING"))]
    verdict.findings = [text for text in said if "error(s)" not in text]  # without its sums
    if done.returncode and not verdict.findings:
        verdict.findings = [lines[-1] if lines else f"exit code {done.returncode}"]
    return verdict


def _schema(archive: Archive) -> Verdict:
    """The standard's own XML schemas, which the toolbox carries: of FMI 2.0 and 3.0. FMI 2.0.5 takes some of the latter's files."""
    of_3 = fmi_version(archive).startswith("3.")
    verdict = Verdict("XML schema", "FMI 3.0.2" if of_3 else "FMI 2.0.4")
    if find_spec(TOOLBOX) is None:
        verdict.skipped = "not installed (extra 'fmu')"
        return verdict
    folder = Path(find_spec(TOOLBOX).submodule_search_locations[0]) / "resources"
    pairs = {
        "modelDescription.xml": folder
        / ("fmi-3.0/fmi3ModelDescription.xsd" if of_3 else "fmi-2.0/fmi2ModelDescription.xsd"),
        "terminalsAndIcons/terminalsAndIcons.xml": folder / "fmi-3.0" / "fmi3TerminalsAndIcons.xsd",
        "sources/buildDescription.xml": folder / "fmi-3.0" / "fmi3BuildDescription.xsd",
    }
    for name, schema in pairs.items():
        if name not in archive.names:
            continue
        try:
            tree = etree.fromstring(archive.read(name))
        except etree.XMLSyntaxError as error:
            verdict.findings.append(f"{name}: {error}")
            continue
        rules = etree.XMLSchema(etree.parse(str(schema)))
        if not rules.validate(tree):
            verdict.findings += [f"{name}: line {e.line}: {e.message}" for e in rules.error_log]
    return verdict


# ---- VDMCheck: a formal model of the standard. A program under the GPL: run where it is, never part of tse.

VDMCHECK = "1.1.3"
POM = f"""<project xmlns="http://maven.apache.org/POM/4.0.0">
  <modelVersion>4.0.0</modelVersion><groupId>tse</groupId><artifactId>vdmcheck</artifactId><version>1</version>
  <dependencies><dependency>
    <groupId>org.into-cps.vdmcheck.fmi2</groupId><artifactId>vdmcheck2</artifactId><version>{VDMCHECK}</version>
  </dependency></dependencies>
</project>
"""


def vdmcheck_folder() -> Path:
    return Path(sys.prefix) / "share" / f"vdmcheck-{VDMCHECK}"


def fetch_vdmcheck(say: Callable[[str], None]) -> str:
    """Have Maven bring VDMCheck, once. Returned: why it is not there; empty when it is."""
    folder = vdmcheck_folder()
    if (folder / "vdmcheck2.jar").is_file():
        return ""
    if shutil.which("mvn") is None:
        return "not fetched: Maven (mvn) is not installed"
    with alone(folder.with_name(f"{folder.name}.lock")):
        return "" if (folder / "vdmcheck2.jar").is_file() else _fetch_vdmcheck(folder, say)


def _fetch_vdmcheck(folder: Path, say: Callable[[str], None]) -> str:
    say(f"VDMCheck {VDMCHECK}, by Maven")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, ignore_cleanup_errors=True) as scratch:
        jars = Path(scratch) / "jars"
        (Path(scratch) / "pom.xml").write_text(POM)
        command = ["mvn", "-q", "-B", "-f", str(Path(scratch) / "pom.xml"), "dependency:copy-dependencies",
                   "-DincludeScope=runtime", "-Dmdep.stripVersion=true", f"-DoutputDirectory={jars}"]  # fmt: skip
        try:
            done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=300)
        except subprocess.TimeoutExpired:
            return "not fetched: Maven took longer than 5 minutes"
        if done.returncode:
            return f"not fetched: {next((x for x in done.stdout.splitlines() if 'ERROR' in x), 'Maven failed')[:200]}"
        for name in ("rule-model", "static-model", "vdmcheck2"):  # it looks for its model in files beside it
            with zipfile.ZipFile(jars / f"{name}.jar") as jar:
                jar.extractall(jars, [n for n in jar.namelist() if n.startswith("fmi2")])
        shutil.rmtree(folder, ignore_errors=True)
        jars.rename(folder)
    return ""


def _vdmcheck(archive: Archive, say: Callable[[str], None]) -> Verdict:
    verdict = Verdict("VDMCheck", VDMCHECK)
    if fmi_version(archive).startswith("3."):
        verdict.skipped = "VDMCheck of FMI 3.0 is in no registry"
        return verdict
    if shutil.which("java") is None:
        verdict.skipped = "Java is not installed"
        return verdict
    if reason := fetch_vdmcheck(say):
        verdict.skipped = reason
        return verdict
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / "model.fmu"  # it goes by the ending, and knows ASCII only
        shutil.copyfile(archive.path, plain)
        command = ["java", "-jar", str(vdmcheck_folder() / "vdmcheck2.jar"), str(plain)]
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", env={**os.environ, "LC_ALL": "C"}
        )
    lines = [line.strip() for line in (done.stdout + done.stderr).splitlines() if line.strip()]
    if "No errors found." not in lines:
        verdict.findings = [x for x in lines if x != "Errors found." and not x.startswith("https://")] or [
            "failed without a word"
        ]
    return verdict
