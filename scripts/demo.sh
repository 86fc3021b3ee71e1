#!/usr/bin/env bash
# Simulate a drive, estimate its tyre stiffness, draw the result: demo-output/.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
scripts/setup.sh
.venv/bin/tselab demo --out demo-output
printf '\nLook at:\n'
find "$PWD/demo-output" -name '*.png' -o -name '*.html' | sort
