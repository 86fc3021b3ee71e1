#!/usr/bin/env bash
# Write the lock files: scripts/lock.txt for scripts/setup.sh and the site,
# scripts/lock-release.txt for releases. Keep their versions if possible;
# scripts/dev/lock.sh --upgrade takes the newest. Needs the program uv.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
command -v uv >/dev/null || { echo "lock: the program uv is needed (Python package uv)" >&2; exit 1; }
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
