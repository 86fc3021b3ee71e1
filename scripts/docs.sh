#!/usr/bin/env bash
# The site, into build/site: open build/site/index.html, no server is needed. Takes what README does not hold from the repository's own
# tables. Sets up what it needs (scripts/setup.sh docs), then nothing from the net; about half a minute.
#   scripts/docs.sh              build, warnings are errors
#   scripts/docs.sh --look       and pictures of some pages in light, dark, on a phone and printed, into build/site-look; needs chromium
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
look=
case ${1:-} in
  "") ;;
  --look) look=1 ;;
  *) echo "docs: $1 is not an option; allowed: --look" >&2; exit 2 ;;
esac

python=${TSE_DOCS_PYTHON:-.venv/bin/python}       # another environment, when .venv is not to be touched
[ -n "${TSE_DOCS_PYTHON:-}" ] || scripts/setup.sh docs
"$python" -c 'import material, mkdocstrings_handlers.python, latex2mathml, matplotlib' 2>/dev/null \
  || { echo "docs: mkdocs-material, mkdocstrings, latex2mathml and matplotlib are needed; scripts/setup.sh docs could not install them" >&2; exit 1; }
export PYTHONPATH="$PWD/scripts${PYTHONPATH:+:$PYTHONPATH}" NO_MKDOCS_2_WARNING=1 OPENBLAS_NUM_THREADS=1
"$python" -m docsite.pictures
"$python" scripts/page.py --out "${TSE_SITE_PARTS:-build/site-parts}/try.html"
"$python" -m mkdocs build --quiet --strict --config-file docs/mkdocs.yml
"$python" -m docsite.check build/site
echo "docs: build/site/index.html"
[ -z "$look" ] || "$python" -m docsite.look
