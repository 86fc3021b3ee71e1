#!/usr/bin/env bash
# Make all files of a release of the last commit in a folder.
#
#   scripts/dev/release.sh VERSION [--out FOLDER] [--only PART,PART] [--platforms TAG,TAG]
#
# The same commit gives the same bytes; --twice makes the release two times and compares.
# --list names parts and platforms.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
scripts/setup.sh release docs
exec .venv/bin/python scripts/dev/release.py "$@"
