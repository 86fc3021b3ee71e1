#!/usr/bin/env bash
# Measure coverage, mutation score and MISRA deviations, and prove absence of run-time
# errors.
#
#   scripts/dev/proof.sh WHAT [--write] [...]      --write: update the table
#     coverage    lines, branches and MC/DC of src/; fails on code that is neither covered
#                 nor listed; five minutes; needs clang 19 or later
#     python [ARGUMENTS]
#                 statements and branches of the Python packages, by all tests or by
#                 pytest ARGUMENTS; half an hour; there is no limit. Tests of a full disk
#                 fail, because the measurement cannot be written either
#     mutation [--count N] [--seed S] [--all] [--only PART]
#                 share of small faults of the core that unit tests and golden replay
#                 find; 300 faults take half an hour, all a day
#     misra [FILE ...]
#                 MISRA C:2012 by the addon of cppcheck; fails on hits of required rules
#                 without a deviation; 90 s
#     eva [--format F] [TARGET ...]
#                 EVA of Frama-C on tse_prepare, tse_learnt_load, tse_step; fails on
#                 alarms without an explanation
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
    .venv/bin/coverage run -m pytest -c scripts/pyproject.toml --rootdir . -q --dist loadfile \
      --max-worker-restart 0 "$@" || status=$?
    .venv/bin/coverage combine --quiet
    .venv/bin/coverage report --skip-covered
    exit $status ;;
  *) echo "proof: which of coverage, python, mutation, misra, eva?" >&2; exit 2 ;;
esac
shift
exec .venv/bin/python "tests/proof/$program.py" "$@"
