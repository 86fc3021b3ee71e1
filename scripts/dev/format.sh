#!/usr/bin/env bash
# Format the sources: Python by ruff, C by clang-format, prose by scripts/dev/prose.py.
# .clang-format-ignore lists C files that are laid out by hand.
#
#   scripts/dev/format.sh            change the files
#   scripts/dev/format.sh --check    change nothing; fail and name the wrong files
#
# scripts/lock.txt has the versions: another clang-format formats differently.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
check=
case ${1:-} in
  "") ;;
  --check) check=1 ;;
  *) echo "format: $1 is not an option; allowed: --check" >&2; exit 2 ;;
esac
[ -x .venv/bin/clang-format ] || { echo "format: clang-format is missing: scripts/setup.sh" >&2; exit 1; }
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
