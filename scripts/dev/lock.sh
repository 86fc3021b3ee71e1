#!/usr/bin/env bash
# Write the lock files, which fix versions and hashes of the Python packages:
# scripts/lock.txt for scripts/setup.sh and the site, scripts/lock-release.txt for
# releases. Versions change only if pyproject.toml needs it; scripts/dev/lock.sh --upgrade
# selects the newest versions. Needs the program uv.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
command -v uv >/dev/null || { echo "lock: uv is not installed: pip install uv" >&2; exit 1; }
for extra in dev release; do
  file=scripts/lock.txt
  same=() extras=(--extra lab --extra dev --extra docs)
  if [ $extra != dev ]; then
    file=scripts/lock-$extra.txt extras=(--extra $extra)
    same=(--constraint scripts/lock.txt)     # the same versions in both files
  fi
  uv pip compile --quiet --universal --python-version 3.10 --generate-hashes \
    --no-emit-index-url --no-emit-find-links \
    --custom-compile-command scripts/dev/lock.sh "${extras[@]}" \
    --output-file $file "${same[@]}" "$@" pyproject.toml
done
