#!/usr/bin/env bash
# Make the files of a release from the last commit.
#
#   scripts/dev/release.sh VERSION [--out FOLDER] [--only PART,PART] [--platforms TAG,TAG]
#
# The same commit gives the same bytes: --twice makes the release twice and compares the
# files. --list prints the parts and the platforms.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
scripts/setup.sh release docs
exec .venv/bin/python scripts/dev/release.py "$@"
