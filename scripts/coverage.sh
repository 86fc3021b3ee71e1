#!/usr/bin/env bash
# What the tests reach: lines, branches and MC/DC of src/ (tests/proof/coverage.py; fails on what is neither covered nor in its list),
# or statements and branches of the Python packages (tests/proof/python_coverage.py).
#   scripts/coverage.sh [--write]            --write: scripts/results/coverage.md anew; about three minutes; needs clang 19 or later
#   scripts/coverage.sh python [--write]     --write: scripts/results/coverage-python.md anew; about half an hour
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
if [ "${1:-}" = python ]; then
  shift
  exec .venv/bin/python tests/proof/python_coverage.py "$@"
fi
exec .venv/bin/python tests/proof/coverage.py "$@"
