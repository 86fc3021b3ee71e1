#!/usr/bin/env bash
# Write the lock files anew: scripts/lock.txt, what scripts/setup.sh installs and what builds the site, and scripts/dev/lock-release.txt, what a release is made
# with. Versions that are in them stay where they can; scripts/dev/lock.sh --upgrade takes the newest. Needs the program uv.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
command -v uv >/dev/null || { echo "lock: the program uv is needed (Python package uv)" >&2; exit 1; }
for extra in dev release; do
  file=scripts/lock.txt
  same=() extras=(--extra lab --extra dev --extra docs)
  [ $extra = dev ] || { file=scripts/lock-$extra.txt; extras=(--extra $extra); same=(--constraint scripts/lock.txt); }     # one version of each in both
  uv pip compile --quiet --universal --python-version 3.10 --generate-hashes --no-emit-index-url --no-emit-find-links \
    --custom-compile-command scripts/dev/lock.sh ${extras[@]} --output-file $file "${same[@]}" "$@" pyproject.toml
done
