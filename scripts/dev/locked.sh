#!/usr/bin/env bash
# Install the packages of a lock file with pip, which checks their hashes.
#
#   scripts/dev/locked.sh PYTHON LOCK.txt
#
# Exit code 3: the registry has no files of these versions for this Python or machine. The
# caller may then install other versions. Any other exit code except 0 is an error, such
# as a wrong hash, a failed download or an unreachable registry: the caller must stop, and
# must not install packages without checking their hashes.
set -uo pipefail
python=$1 lock=$2
log=$(mktemp)
trap 'rm -f "$log"' EXIT
"$python" -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes \
  --requirement "$lock" >"$log" 2>&1 && exit 0
cat "$log" >&2
if ! grep -qi 'do not match the hashes\|expected sha256\|hashes are required' "$log" \
    && grep -qi 'no matching distribution found\|requires a different python\|is not a supported wheel' \
      "$log" \
    && ! grep -qi 'connection\|timed out\|retrying\|temporary failure\|http error\|proxyerror\|ssl' \
      "$log"; then
  exit 3
fi
exit 1
