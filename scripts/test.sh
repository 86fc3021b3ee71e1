#!/usr/bin/env bash
# Run linters, format check, the tests of the C library in several CMake presets, and the
# Python tests. Print a table at the end. Fail if a step fails. A step or test whose tool
# is missing is skipped, and the tool is named.
#
#   scripts/test.sh              run all tests except slow ones, in double with sanitizers
#                                and in fixed point: 8 minutes on two cores. Tests of long
#                                drives run only in fixed point. The first call also
#                                installs Python packages, which takes a minute
#   scripts/test.sh --all        run all presets and also the tests that are marked slow, as
#                                continuous integration does
#   scripts/test.sh PRESET ...   test only these CMake presets, then run the Python tests
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
heavy=()
presets=()
for word in "$@"; do
  case $word in
    --all) heavy=(--all) ;;
    -*) echo "test: unknown option $word; allowed: --all, names of CMake presets" >&2; exit 2 ;;
    *) presets+=("$word") ;;
  esac
done
quick=0
every=(dev release avx2 float fixed small clang-dev clang-release clang-float clang-fixed)
if [ "${#presets[@]}" -eq 0 ]; then
  presets=(dev fixed)
  quick=1
  if [ "${#heavy[@]}" -gt 0 ]; then
    presets=("${every[@]}")
    quick=0
  fi
fi
scripts/setup.sh clients logs || exit 1

jobs=$(getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2)
if [ -z "${CMAKE_GENERATOR:-}" ] && command -v ninja >/dev/null; then export CMAKE_GENERATOR=Ninja; fi

table=()
failed=0
row() { table+=("$(printf '%-9s %-16s %5s  %s' "$1" "$2" "$3" "${4:-}")"); }

step() {                             # step NAME COMMAND ...
  local name=$1 start=$SECONDS
  shift
  printf '\n=== %s\n' "$name"
  if "$@"; then row passed "$name" "$((SECONDS - start)) s"; else
    failed=$((failed + 1))
    row FAILED "$name" "$((SECONDS - start)) s"
  fi
}

skip() { row skipped "$1" "" "$2"; printf '\n=== %s\nskipped: %s\n' "$1" "$2"; }

preset() {                           # configure, build and test one preset
  local cache="build/$1/CMakeCache.txt"
  if [ -f "$cache" ] && { ! grep -qxF "CMAKE_HOME_DIRECTORY:INTERNAL=$PWD" "$cache" \
      || { [ -n "${CMAKE_GENERATOR:-}" ] \
        && ! grep -qxF "CMAKE_GENERATOR:INTERNAL=$CMAKE_GENERATOR" "$cache"; }; }; then
    rm -rf "build/$1"                # made in a different checkout or by a different generator
  fi
  cmake --preset "$1" "-DFETCHCONTENT_SOURCE_DIR_UNITY=$PWD/.venv/share/unity" \
    "-DFETCHCONTENT_SOURCE_DIR_FMI2=$PWD/.venv/share/fmi2" "-DPython3_EXECUTABLE=$PWD/.venv/bin/python" \
    >"/tmp/tse-configure.$$" 2>&1 || { cat "/tmp/tse-configure.$$"; rm -f "/tmp/tse-configure.$$"; return 1; }
  rm -f "/tmp/tse-configure.$$"
  local left=()
  # The quick suite runs tests of long drives once, in fixed point, and compiles the sources
  # as C++ once, in double.
  if [ "$quick" = 1 ]; then
    case $1 in
      dev) left=(--label-exclude long) ;;
      fixed) left=(--label-exclude compiles) ;;
    esac
  fi
  cmake --build --preset "$1" --parallel "$jobs" \
    && ctest --preset "$1" --parallel "$jobs" ${left[@]+"${left[@]}"}
}

ruff() { .venv/bin/ruff check --config scripts/pyproject.toml scripts tests; }
mypy() { .venv/bin/mypy --config-file scripts/pyproject.toml; }
python_tests() {                     # run in several processes; tests/conftest.py assigns tests to them
  # A process that crashes is not restarted: pytest-xdist would repeat the crashing test
  # forever.
  .venv/bin/python -m pytest -c scripts/pyproject.toml --rootdir . \
    ${heavy[@]+"${heavy[@]}"} -n "$((jobs < 4 ? jobs : 4))" --dist loadfile --no-loadscope-reorder \
    --max-worker-restart 0 --durations 25 -r sfE tests
}

step ruff ruff
step format scripts/dev/format.sh --check
step mypy mypy
for name in "${presets[@]}"; do
  case $name in
    clang-*)
      command -v clang >/dev/null && command -v clang++ >/dev/null \
        || { skip "$name" "clang and clang++ are not installed"; continue; } ;;
    avx2)
      grep -qs '^flags.* avx2 .*' /proc/cpuinfo || { skip "$name" "this processor has no AVX2"; continue; } ;;
  esac
  step "$name" preset "$name"
done
[ -n "${CXX:-}" ] || command -v c++ >/dev/null \
  || skip "C++" "no C++ compiler is installed; the sources were compiled as C only"
command -v pkg-config >/dev/null || command -v pkgconf >/dev/null \
  || skip "pkg-config" "not installed; the test of the installed library used CMake only"
step pytest python_tests
[ "${#heavy[@]}" -gt 0 ] || skip "long tests" "scripts/test.sh --all runs them, as CI does"

printf '\n=== summary\n'
printf '%s\n' "${table[@]}"
[ "$failed" -eq 0 ]
