#!/usr/bin/env bash
# MISRA C:2012 by cppcheck's addon (tests/proof/misra.py): fails on hits of required rules outside the deviations.
#   scripts/misra.sh [--write] [FILE ...]      --write: scripts/results/misra.md anew; about a minute and a half; needs cppcheck
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
exec .venv/bin/python tests/proof/misra.py "$@"
