#!/usr/bin/env bash
# Build the site into build/site: open build/site/index.html, no server is needed. Warnings are errors. The pages are the Markdown that git
# holds. Sets up what it needs (scripts/setup.sh docs), then nothing from the net.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
[ $# -eq 0 ] || { echo "docs: $1: there are no options" >&2; exit 2; }

python=${TSE_DOCS_PYTHON:-.venv/bin/python}       # another environment, when .venv is not to be touched
[ -n "${TSE_DOCS_PYTHON:-}" ] || scripts/setup.sh docs
"$python" -c 'import material, latex2mathml' 2>/dev/null \
  || { echo "docs: mkdocs-material and latex2mathml are needed; scripts/setup.sh docs could not install them" >&2; exit 1; }
export PYTHONPATH="$PWD/scripts${PYTHONPATH:+:$PYTHONPATH}" NO_MKDOCS_2_WARNING=1 OPENBLAS_NUM_THREADS=1
"$python" -m mkdocs build --quiet --strict --config-file docs/mkdocs.yml
"$python" scripts/dev/page.py --out build/site/try.html
echo "docs: build/site/index.html"
