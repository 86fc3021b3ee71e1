#!/usr/bin/env bash
# Measure test coverage and mutation score, check MISRA rules, and prove that run-time
# errors cannot occur.
#
#   scripts/dev/proof.sh WHAT [--write] [...]      --write: update the table of results
#     coverage    measure lines, branches and MC/DC of src/ that tests cover. Fails if
#                 code is not covered and not listed as an exception. Takes five minutes;
#                 needs clang 19 or later
#     python [ARGUMENTS]
#                 measure statements and branches of the Python packages that tests cover:
#                 all tests, or those of pytest ARGUMENTS. No minimum is required. Takes
#                 half an hour. Tests of a full disk fail, because the coverage data
#                 cannot be written to the full disk either
#     mutation [--count N] [--seed S] [--all] [--only PART]
#                 insert small faults into the core, and measure the share that unit tests
#                 and golden replay find. 300 faults take half an hour, all faults a day
#     misra [FILE ...]
#                 check MISRA C:2012 with the addon of cppcheck. Fails if a required rule
#                 is violated without a documented deviation. Takes 90 s
#     eva [--format F] [TARGET ...]
#                 analyse tse_prepare, tse_learnt_load and tse_step with EVA of Frama-C.
#                 Fails on an alarm that tests/proof/eva.toml does not explain
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
  *) echo "proof: the first argument must be coverage, python, mutation, misra or eva" >&2; exit 2 ;;
esac
shift
exec .venv/bin/python "tests/proof/$program.py" "$@"
