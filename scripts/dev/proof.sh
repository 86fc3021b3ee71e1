#!/usr/bin/env bash
# What the tests reach, what is proven, what is deviated from:   scripts/dev/proof.sh WHAT [--write] [...]      --write: its table anew
#   coverage              lines, branches and MC/DC of src/; fails on what is neither covered nor in its list; about five minutes; needs
#                         clang 19 or later
#   python [ARGUMENTS]    statements and branches of the Python packages, by all tests or those of pytest ARGUMENTS; half an hour. Nothing is
#                         refused for a figure; tests of a full disk fail, because what is measured cannot be written either
#   mutation [--count N] [--seed S] [--all] [--only PART]
#                         how many small faults of the core the unit tests and the golden replay find; 300 take half an hour, all a day
#   misra [FILE ...]      MISRA C:2012 by cppcheck's addon; fails on hits of required rules outside the deviations; a minute and a half
#   eva [--format F] [TARGET ...]
#                         Frama-C's EVA on tse_prepare, tse_learnt_load, tse_step; fails on alarms that its list does not explain
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
case ${1:-} in
  coverage | mutation | misra | eva) program=$1 ;;
  python)
    shift
    [ $# -gt 0 ] || set -- -n 2 tests
    export COVERAGE_RCFILE=$PWD/scripts/pyproject.toml COVERAGE_DATA=$PWD/build/coverage
    rm -rf "$COVERAGE_DATA"
    status=0
    .venv/bin/coverage run -m pytest -c scripts/pyproject.toml --rootdir . -q --dist loadfile --max-worker-restart 0 "$@" || status=$?
    .venv/bin/coverage combine --quiet
    .venv/bin/coverage report --skip-covered
    exit $status ;;
  *) echo "proof: which of coverage, python, mutation, misra, eva?" >&2; exit 2 ;;
esac
shift
exec .venv/bin/python "tests/proof/$program.py" "$@"
