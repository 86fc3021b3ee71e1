#!/usr/bin/env bash
# Install the packages of a lock file by hash.
#
#   scripts/dev/locked.sh PYTHON LOCK.txt
#
# Exit code 3: no files for this Python or machine exist, and the caller may install
# others. Any other failure must stop the caller: a wrong hash, a broken download, a
# missing registry. Nothing may then be installed without its hash.
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
