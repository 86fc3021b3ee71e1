#!/usr/bin/env bash
# Everything that a release holds, in one folder: scripts/dev/release.sh VERSION [--out FOLDER] [--only PART,PART] [--platforms TAG,TAG]
# Of the last commit. The same commit gives the same bytes; --twice makes it two times and compares. Parts and platforms: --list.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
scripts/setup.sh release docs
exec .venv/bin/python scripts/dev/release.py "$@"
