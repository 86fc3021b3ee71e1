#!/usr/bin/env bash
# Test the lower bounds of the package versions in pyproject.toml. Install the lowest
# allowed versions into build/bounds. With these versions, run the tests of the API, of
# `tselab estimate` and of the examples. Needs the program uv; run scripts/setup.sh before
# it. Takes a few minutes.
#
#   scripts/dev/bounds.sh [PYTHON]       default: the Python of .venv
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
command -v uv >/dev/null || { echo "bounds: uv is not installed: pip install uv" >&2; exit 1; }
python=${1:-$(.venv/bin/python -c 'import sys; print(sys.executable)')}
rm -rf build/bounds
uv venv --quiet --python "$python" build/bounds
uv pip compile --quiet --resolution lowest-direct --python build/bounds/bin/python \
  --no-header --no-annotate --extra lab pyproject.toml >build/bounds/lowest.txt
uv pip install --quiet --python build/bounds/bin/python -r build/bounds/lowest.txt pytest pytest-xdist
cat build/bounds/lowest.txt
PYTHONPATH=$PWD/scripts build/bounds/bin/python -m pytest -c scripts/pyproject.toml --rootdir . \
  tests/lab/test_api.py tests/lab/test_estimate.py
