"""The Python distribution as users install it: from a checkout, without a network."""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

# builds wheels and source archives; continuous integration does, too
pytestmark = pytest.mark.slow

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]
if not (shutil.which("git") and (ROOT / ".git").exists()):
    pytest.skip("git is not installed, or this is no checkout", allow_module_level=True)
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LAB = PROJECT["optional-dependencies"]["lab"]
VERSION = re.search(r'TSE_VERSION "(.+)"', (ROOT / "include" / "tse" / "version.h").read_text())[1]
RELEASE = [sys.executable, ROOT / "scripts" / "dev" / "release.py"]


def run_command(*command, cwd=None, **environment):
    """Run a command; return its output."""
    done = subprocess.run(
        [str(c) for c in command], cwd=cwd, capture_output=True, text=True, env={**os.environ, **environment}
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def list_tracked(folder="."):
    """Return the files that git tracks."""
    return run_command("git", "ls-files", folder, cwd=ROOT).splitlines()


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """Copy the tracked files, as they are now, to another folder."""
    folder = tmp_path_factory.mktemp("clean") / "tse"
    for name in list_tracked():
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes((ROOT / name).read_bytes())
            (folder / name).chmod((ROOT / name).stat().st_mode)
    return folder


@pytest.fixture(scope="module")
def sdist(checkout, tmp_path_factory):
    out = tmp_path_factory.mktemp("sdist")
    code = f"import scikit_build_core.build as b; b.build_sdist({str(out)!r})"
    run_command(sys.executable, "-c", code, cwd=checkout)
    return out / f"tse-{VERSION}.tar.gz"


@pytest.fixture(scope="module")
def wheel(sdist, tmp_path_factory):
    """Build the wheel from the source package alone. --no-index: nothing is fetched."""
    out = tmp_path_factory.mktemp("wheel")
    alone = ("--quiet", "--no-index", "--no-deps", "--no-build-isolation")
    run_command(sys.executable, "-m", "pip", "wheel", *alone, "--wheel-dir", out, sdist)
    (made,) = out.glob("*.whl")
    return made


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    folder = tmp_path_factory.mktemp("installed")
    run_command(
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-index",
        "--no-deps",
        "--target",
        folder,
        wheel,
    )
    return folder


@pytest.mark.slow
def test_the_wheel_is_for_every_python_and_this_system(wheel):
    platform = re.sub(r"[^A-Za-z0-9]", "_", sysconfig.get_platform())
    assert wheel.name == f"tse-{VERSION}-py3-none-{platform}.whl"
    with zipfile.ZipFile(wheel) as file:
        text = file.read(f"tse-{VERSION}.dist-info/WHEEL").decode()
    assert "Root-Is-Purelib: false" in text and f"Tag: py3-none-{platform}" in text


def test_the_wheel_holds_the_packages_the_library_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as file:
        names = {n for n in file.namelist() if not n.endswith("/")}
    libraries = {n for n in names if n.startswith("tse/library/lib/")}
    assert len(libraries) == 1 and Path(libraries.pop()).stem == "libtse"
    code = {
        n.removeprefix("scripts/")
        for n in list_tracked()
        if n.startswith(("scripts/tse/", "scripts/tselab/"))
    }
    assert {n for n in names if not n.startswith(("tse/library/lib/", "tse-"))} == code
    assert {
        "tse/py.typed",
        f"tse-{VERSION}.dist-info/licenses/LICENSE",
        f"tse-{VERSION}.dist-info/licenses/NOTICE",
    } <= names


def test_the_description_has_bounds_and_types(wheel):
    with zipfile.ZipFile(wheel) as file:
        text = file.read(f"tse-{VERSION}.dist-info/METADATA").decode()
        commands = file.read(f"tse-{VERSION}.dist-info/entry_points.txt").decode()
    assert (
        f"Version: {VERSION}\n" in text and "Requires-Python: >=3.10\n" in text and "Typing :: Typed" in text
    )
    plain = [
        line for line in text.splitlines() if line.startswith("Requires-Dist: ") and "extra ==" not in line
    ]
    assert len(plain) == len(PROJECT["dependencies"]) and all(">=" in line for line in plain)
    assert "tselab = tselab.__main__:main" in commands


def test_what_is_installed_works_alone_and_gives_the_same_bytes(installed, tmp_path):
    code = (
        "import sys, pandas, tse; from tse.library.core import find_library; "
        "print(tse.__file__); print(find_library());"
        "tse.estimate(tse.simulate(duration=5).log, {'mass': 1650, 'lf': 1.2, 'lr': 1.5, "
        "'wheel_radius_front': 0.32,"
        "'wheel_radius_rear': 0.32}).to_csv(sys.argv[1])"
    )
    where = run_command(
        sys.executable, "-c", code, tmp_path / "installed.csv", cwd=tmp_path, PYTHONPATH=str(installed)
    ).splitlines()
    assert all(line.startswith(str(installed)) for line in where)
    run_command(
        sys.executable, "-c", code, tmp_path / "here.csv", cwd=tmp_path, PYTHONPATH=str(ROOT / "scripts")
    )
    assert (tmp_path / "installed.csv").read_bytes() == (tmp_path / "here.csv").read_bytes()
    assert VERSION in run_command(
        sys.executable, "-m", "tselab", "--version", cwd=tmp_path, PYTHONPATH=str(installed)
    )


# ---- lock, bill of materials, release


def normalise_name(name):
    """Return the normalised name of a package."""
    return re.sub(r"[-_.]+", "-", name).lower()


def read_bounds(lines):
    """Return the lower bound of each package."""
    return {
        normalise_name(m[1]): m[2]
        for m in (
            re.match(r"([A-Za-z0-9._-]+)(?:\[.*\])?\s*[>=]=([0-9.]+)", line)
            for line in lines
            if line != "tse[lab]"
        )
    }


@pytest.mark.parametrize(("lock", "extra"), [("lock.txt", "dev"), ("lock-release.txt", "release")])
def test_the_lock_names_all_that_is_needed_within_its_bounds_and_by_hash(lock, extra):
    from packaging.version import Version

    text = (ROOT / "scripts" / lock).read_text(encoding="utf-8")
    pins = [(normalise_name(n), v) for n, v in re.findall(r"^([A-Za-z0-9._-]+)==(\S+)", text, re.M)]
    for name, least in read_bounds(
        PROJECT["dependencies"] + LAB + PROJECT["optional-dependencies"][extra]
    ).items():
        versions = [v for n, v in pins if n == name]
        assert versions, f"{name} is not in {lock}: run scripts/dev/lock.sh"
        assert all(Version(v) >= Version(least) for v in versions), name
    assert len(re.findall(r"==.*\\\n    --hash=sha256:", text)) == len(pins)
    assert "://" not in text


@pytest.fixture(scope="module")
def made_twice(checkout, tmp_path_factory):
    """Make the quick parts of a release from two checkouts in two folders."""
    for tool in ("build", "cyclonedx"):
        pytest.importorskip(
            tool, reason=f"{tool}, a tool of releases, is not installed: scripts/setup.sh release"
        )
    git = ["git", "-c", "user.name=tests", "-c", "user.email=tests@localhost"]
    dates = {"GIT_COMMITTER_DATE": "1790000000 +0200", "GIT_AUTHOR_DATE": "1790000000 +0200"}
    made = []
    for place in ("one", "an other"):
        folder = tmp_path_factory.mktemp(place) / "tse"
        run_command("cp", "-r", checkout, folder)
        run_command(*git, "init", "-q", cwd=folder)
        run_command(*git, "add", "-A", cwd=folder)
        run_command(*git, "commit", "-q", "-m", "all", cwd=folder, **dates)
        out = folder.parent / "out"
        run_command(
            sys.executable,
            folder / "scripts" / "dev" / "release.py",
            VERSION,
            "--only",
            "source,sdist,amalgamation,sbom",
            "--out",
            out,
        )
        made.append(out)
    return made


@pytest.mark.slow
def test_the_same_commit_gives_the_same_bytes_wherever_it_lies(made_twice):
    one, other = (
        {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir()}
        for folder in made_twice
    )
    assert one == other
    assert {
        f"tse-{VERSION}.tar.gz",
        f"tse-{VERSION}-source.tar.gz",
        f"tse-{VERSION}.cdx.json",
        "SHA256SUMS",
    } <= set(one)
    sums = dict(line.split("  ")[::-1] for line in (made_twice[0] / "SHA256SUMS").read_text().splitlines())
    assert sums == {name: digest for name, digest in one.items() if name != "SHA256SUMS"}


def test_the_bill_of_materials_names_the_files_and_what_tse_needs(made_twice):
    text = json.loads((made_twice[0] / f"tse-{VERSION}.cdx.json").read_text())
    assert text["bomFormat"] == "CycloneDX" and text["metadata"]["component"]["version"] == VERSION
    files = {c["name"]: c["hashes"][0]["content"] for c in text["metadata"]["component"]["components"]}
    source = f"tse-{VERSION}-source.tar.gz"
    assert files[source] == hashlib.sha256((made_twice[0] / source).read_bytes()).hexdigest()
    names = {c["name"] for c in text["components"]}
    assert (
        set(read_bounds(PROJECT["dependencies"] + LAB)) <= names
        and "pytest" not in names
        and "distributed" not in names
    )


def test_a_release_of_another_version_than_the_sources_say_is_refused(tmp_path):
    pytest.importorskip("build", reason="a tool of releases is not installed: scripts/setup.sh release")
    done = subprocess.run(
        [*RELEASE, "99.0.0", "--only", "source", "--out", tmp_path / "x"], capture_output=True, text=True
    )
    assert done.returncode == 1 and f"include/tse/version.h says version {VERSION}, not 99.0.0" in done.stderr
    assert not (tmp_path / "x").exists()


def test_without_git_a_sentence_says_so(tmp_path):
    pytest.importorskip("build", reason="a tool of releases is not installed: scripts/setup.sh release")
    command = [*RELEASE, VERSION, "--only", "source", "--out", tmp_path / "x"]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "PATH": str(tmp_path)})
    assert done.returncode == 1 and "git is not installed" in done.stderr and "Traceback" not in done.stderr


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    done = subprocess.run(
        [*RELEASE, VERSION, "--only", "source", "--out", tmp_path], capture_output=True, text=True
    )
    assert done.returncode == 1 and "holds files, but no release" in done.stderr
    assert (tmp_path / "thesis.txt").read_text() == "years of work"
