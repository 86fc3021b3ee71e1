#!/usr/bin/env bash
# Frama-C's EVA on tse_prepare, tse_learnt_load and tse_step (tests/proof/eva.py): fails on alarms that its list does not explain.
#   scripts/eva.sh [--write] [--format F] [TARGET ...]      --write: scripts/results/proof.md anew; needs frama-c
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
exec .venv/bin/python tests/proof/eva.py "$@"
