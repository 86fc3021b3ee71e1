#!/usr/bin/env bash
# Format the sources: Python with ruff, C with clang-format, Markdown with
# scripts/dev/prose.py. .clang-format-ignore lists C files that are not formatted.
#
#   scripts/dev/format.sh            change the files
#   scripts/dev/format.sh --check    change nothing; fail and name files that would change
#
# Use the versions in scripts/lock.txt: other versions of clang-format format differently.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
check=
case ${1:-} in
  "") ;;
  --check) check=1 ;;
  *) echo "format: unknown option $1; allowed: --check" >&2; exit 2 ;;
esac
[ -x .venv/bin/clang-format ] \
  || { echo "format: clang-format is not installed: run scripts/setup.sh" >&2; exit 1; }
status=0
.venv/bin/ruff format --quiet ${check:+--check} --config scripts/pyproject.toml scripts tests || {
  status=1
  .venv/bin/ruff format --check --config scripts/pyproject.toml scripts tests 2>/dev/null \
    | grep -v "already" >&2
}
.venv/bin/python scripts/dev/prose.py ${check:+--check} || status=1
find docs/page fmu include scripts src tests \( -name '*.c' -o -name '*.h' \) -print0 \
  | if [ -n "$check" ]; then xargs -0 .venv/bin/clang-format --dry-run --Werror
    else xargs -0 .venv/bin/clang-format -i; fi || status=1
exit $status
