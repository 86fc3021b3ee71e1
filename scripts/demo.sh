#!/usr/bin/env bash
# Simulate a drive, estimate its tyre stiffness and draw the result. Repeat it from an MF4
# with four wheels and latencies. Output: demo-output/.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
scripts/setup.sh mf4
.venv/bin/tselab demo --out demo-output
printf '\nLook at:\n'
find "$PWD/demo-output" -name '*.png' -o -name '*.html' | sort
