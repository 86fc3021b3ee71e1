#!/usr/bin/env bash
# Lines, branches and MC/DC of src/ by the unit tests (tests/proof/coverage.py): fails on what is neither covered nor in its list.
#   scripts/coverage.sh [--write]      --write: scripts/results/coverage.md anew; about three minutes; needs clang 19 or later
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
exec .venv/bin/python tests/proof/coverage.py "$@"
