#!/usr/bin/env bash
# Simulate a drive, estimate the tyre stiffness and draw the result. Do the same with an
# MF4 log that has four wheel speeds, and latencies. Output: demo-output/.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
scripts/setup.sh mf4
.venv/bin/tselab demo --out demo-output
printf '\nPictures and reports:\n'
find "$PWD/demo-output" -name '*.png' -o -name '*.html' | sort
