"""scripts/locked.sh: nothing is installed without its hash because something failed."""

import hashlib
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
LOCKED = ROOT / "scripts" / "locked.sh"
NO_FILES = 3


def code(python: object, lock: Path) -> int:
    return subprocess.run([LOCKED, str(python), lock], capture_output=True, text=True, timeout=120).returncode


@pytest.mark.parametrize(
    ("says", "wanted"),
    [
        ("ERROR: No matching distribution found for numpy==9", NO_FILES),
        ("ERROR: THESE PACKAGES DO NOT MATCH THE HASHES FROM THE REQUIREMENTS FILE.", 1),
        ("ERROR: THESE PACKAGES DO NOT MATCH THE HASHES ...\\nERROR: No matching distribution found for a", 1),
        ("WARNING: Retrying after connection broken\\nERROR: No matching distribution found for numpy==9", 1),
        ("ERROR: HTTP error 503 while getting a.whl", 1),
        ("something that nobody has thought of", 1),
    ],
)
def test_only_files_that_do_not_exist_for_this_python_are_replaced(tmp_path: Path, says: str, wanted: int) -> None:
    python, lock = tmp_path / "python", tmp_path / "lock.txt"
    python.write_text(f"#!/bin/sh\nprintf '{says}\\n' >&2\nexit 1\n")
    python.chmod(0o755)
    lock.touch()
    assert code(python, lock) == wanted


def test_pip_itself_and_a_hash_that_differs(tmp_path: Path) -> None:
    """A package that is made here; without a registry."""
    wheel = tmp_path / "empty_of_tse-1-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr("empty_of_tse-1.dist-info/METADATA", "Metadata-Version: 2.1\nName: empty-of-tse\nVersion: 1\n")
        archive.writestr("empty_of_tse-1.dist-info/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        archive.writestr("empty_of_tse-1.dist-info/RECORD", "")
    right = hashlib.sha256(wheel.read_bytes()).hexdigest()
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "env"], check=True)
    python, lock = tmp_path / "env" / "bin" / "python", tmp_path / "lock.txt"
    for digest, wanted in (("0" * 64, 1), (right, 0)):
        lock.write_text(f"--no-index\n--find-links {tmp_path}\nempty-of-tse==1 --hash=sha256:{digest}\n")
        assert code(python, lock) == wanted
    assert subprocess.run([python, "-m", "pip", "show", "empty-of-tse"], capture_output=True).returncode == 0


def test_setup_goes_on_without_hashes_in_that_case_alone() -> None:
    """Only behind locked.sh's answer, and not in CI."""
    text = (ROOT / "scripts" / "setup.sh").read_text(encoding="utf-8")
    assert text.count("but the newest versions") == 1 and '[ $locked -eq 3 ] && [ -z "${CI:-}" ]' in text
    assert "--requirement scripts/lock" not in text


# ---- Workflow files of the forge: actions are pinned by commit, what they run is there, and the linter has nothing to say.


WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def steps(workflow: Path) -> list[dict[str, object]]:
    return [s for job in yaml.safe_load(workflow.read_text(encoding="utf-8"))["jobs"].values() for s in job["steps"]]


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda p: p.stem)
def test_actions_are_pinned_and_scripts_are_there(workflow: Path) -> None:
    text = workflow.read_text(encoding="utf-8")
    used = re.findall(r"uses: (\S+)(.*)", text)
    assert used
    for action, comment in used:
        assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}", action) and re.fullmatch(r" # v\d+\.\d+\.\d+", comment), action
    for script in re.findall(r"(?:^|\s)((?:scripts/|tests/|\.ci/)[\w./-]+)", text):
        assert (ROOT / script).is_file(), script
    assert yaml.safe_load(text)["permissions"] == {"contents": "read"}


def test_what_is_run_here_is_run_there() -> None:
    runs = {w.stem: " ".join(str(s.get("run", "")) for s in steps(w)) for w in WORKFLOWS}
    assert set(runs) == {"ci", "nightly"}
    assert ".ci/run" in runs["ci"] and "ctest" in runs["ci"] and "pip wheel" in runs["ci"]
    assert all(f"scripts/{s}" in runs["nightly"] for s in ("fuzz.sh", "soak.sh", "proof.sh mutation"))


def test_the_linter_of_the_forge_has_nothing_to_say() -> None:
    linter = shutil.which("actionlint")
    if linter is None:
        pytest.skip("actionlint is not installed (go install github.com/rhysd/actionlint/cmd/actionlint@v1.7.7)")
    done = subprocess.run([linter, "-no-color", *WORKFLOWS], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stdout
