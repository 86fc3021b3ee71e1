"""How much of the Python packages their tests reach: statements and branches by file, also of processes that the tests start.

    scripts/proof.sh python [PYTEST ARGUMENTS]     about half an hour

Nothing is refused for a figure: what a line that no test reaches is worth, nobody can say in general. They are for looking where to
test next. Tests of a full disk fail here, because what is measured cannot be written either.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CONFIG = """[run]
branch = true
parallel = true
patch = subprocess
source = {root}/scripts/tse
  {root}/scripts/tselab
data_file = {data}
"""


def main() -> int:
    arguments = sys.argv[1:] or ["-n", "2", "tests"]
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "coveragerc")
        config.write_text(CONFIG.format(root=ROOT, data=Path(folder, "data")), encoding="utf-8")
        env = {**os.environ, "COVERAGE_RCFILE": str(config)}
        coverage = [sys.executable, "-m", "coverage"]
        pytest = ["-m", "pytest", "-c", "scripts/pyproject.toml", "--rootdir", ".", "-q", "--dist", "loadfile",
                  "--max-worker-restart", "0", *arguments]  # fmt: skip
        ran = subprocess.run([*coverage, "run", f"--rcfile={config}", *pytest], cwd=ROOT, env=env, check=False)
        for step in ("combine", "--quiet"), ("report", "--skip-covered"):
            subprocess.run([*coverage, step[0], f"--rcfile={config}", *step[1:]], cwd=ROOT, env=env, check=True)
    return ran.returncode


if __name__ == "__main__":
    sys.exit(main())
