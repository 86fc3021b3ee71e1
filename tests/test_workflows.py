"""Workflow files of the forge: actions are pinned by commit, what they run is there, and the linter has nothing to say."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def steps(workflow: Path) -> list[dict[str, object]]:
    return [s for job in yaml.safe_load(workflow.read_text(encoding="utf-8"))["jobs"].values() for s in job["steps"]]


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda p: p.stem)
def test_actions_are_pinned_and_scripts_are_there(workflow: Path) -> None:
    text = workflow.read_text(encoding="utf-8")
    used = re.findall(r"uses: (\S+)(.*)", text)
    assert used
    for action, comment in used:
        assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}", action) and re.fullmatch(r" # v\d+\.\d+\.\d+", comment), (
            action
        )
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
