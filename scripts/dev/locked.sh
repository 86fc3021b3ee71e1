#!/usr/bin/env bash
# Install what a lock file names, to the hash.   scripts/dev/locked.sh PYTHON LOCK.txt
# Exit code 3: this Python or machine has no such files, and the caller may take others. Any other failure stops: a hash that differs, a
# download that breaks off, a registry that is not there - nothing may then be installed without its hash.
set -uo pipefail
python=$1 lock=$2
log=$(mktemp)
trap 'rm -f "$log"' EXIT
"$python" -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes --requirement "$lock" >"$log" 2>&1 && exit 0
cat "$log" >&2
if ! grep -qi 'do not match the hashes\|expected sha256\|hashes are required' "$log" \
    && grep -qi 'no matching distribution found\|requires a different python\|is not a supported wheel' "$log" \
    && ! grep -qi 'connection\|timed out\|retrying\|temporary failure\|http error\|proxyerror\|ssl' "$log"; then
  exit 3
fi
exit 1
