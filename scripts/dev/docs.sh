#!/usr/bin/env bash
# Build the documentation site from the Markdown pages in git, into build/site. Open
# build/site/index.html; no server is needed. A warning is an error. The script installs
# its tools (scripts/setup.sh docs); the build itself needs no network.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
[ $# -eq 0 ] || { echo "docs: unknown option $1; there are no options" >&2; exit 2; }

# TSE_DOCS_PYTHON is a Python that has the tools already. With it, .venv stays unchanged.
python=${TSE_DOCS_PYTHON:-.venv/bin/python}
[ -n "${TSE_DOCS_PYTHON:-}" ] || scripts/setup.sh docs
"$python" -c 'import material, latex2mathml' 2>/dev/null \
  || { echo "docs: mkdocs-material or latex2mathml is not installed: run scripts/setup.sh docs" >&2; exit 1; }
export PYTHONPATH="$PWD/scripts${PYTHONPATH:+:$PYTHONPATH}" NO_MKDOCS_2_WARNING=1 OPENBLAS_NUM_THREADS=1
"$python" -m mkdocs build --quiet --strict --config-file docs/mkdocs.yml
"$python" scripts/dev/page.py --out build/site/try.html
echo "docs: build/site/index.html"
