#!/usr/bin/env bash
# Mutation score of the core (tests/proof/mutation.py): how many small faults the unit tests and the golden replay find.
#   scripts/mutation.sh [--write] [--count N] [--seed S] [--all] [--only PART]      300 faults take about half an hour, all of them a day
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
exec .venv/bin/python tests/proof/mutation.py "$@"
