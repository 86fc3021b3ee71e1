#!/usr/bin/env bash
# Run the filter on millions of rows of simulated drives, and check its estimates.
#
#   scripts/dev/soak.sh [ROWS]
#       Run the default filter on drives with events (tests/fuzz/soak.c). Fail if an
#       estimate is not finite, if tse_filter_check() refuses a state, if the filter
#       restarts its state (TSE_W_RECOVERED) although there was no event in the last 15 s,
#       or, in drives without an event or with late rows, if the mean error exceeds the
#       confidence interval. Default: 10,000,000 rows, two minutes on one core. Writes
#       scripts/results/soak.md.
#   scripts/dev/soak.sh --drives [ROWS [FIRST_DRIVE]]
#       Run all filters on long random drives with random settings (tests/fuzz/drives.c),
#       in double, float, fixed point and the small build. Fail if a number is out of
#       range, if tse_filter_check() refuses a state, if the age of the last change does
#       not grow, or if an estimate depends on whether the caller asked for outputs.
#       Default: 10,000,000 rows in each build, 15 minutes on one core. Writes
#       scripts/results/drives.md.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

if [ "${1:-}" = --drives ]; then
  code=0
  table=$(mktemp)
  trap 'rm -f "$table"' EXIT
  for build in double float fixed small; do
    real=$build
    options=()
    [ "$build" != small ] || { real=fixed; options=(-DTSE_SMALL=ON -DTSE_PARTICLES=OFF -DTSE_VELOCITY=OFF); }
    dir=build/drives-$build
    cmake -S . -B "$dir" -DCMAKE_BUILD_TYPE=Release "-DTSE_REAL=$real" -DTSE_MAX_PARTICLES=64 \
      -DTSE_BUILD_TESTS=OFF -DTSE_BUILD_FMU=OFF -DTSE_BUILD_FUZZ=ON ${options[@]+"${options[@]}"} >/dev/null
    cmake --build "$dir" --target drives >/dev/null
    printf '%s: ' "$build"
    "$dir/tests/fuzz/drives" "${2:-10000000}" "${3:-1}" >"$table.$build" || code=$?
    cat "$table.$build"
    counts=$(sed -n 's/^.*: \([0-9]* rows of [0-9]* drives\), found \([0-9]*\)$/\1 | \2/p' "$table.$build")
    printf '| %s | %s |\n' "$build" "$counts" >>"$table"
    rm -f "$table.$build"
  done
  {
    printf '# Long random drives\n\n'
    printf '`scripts/dev/soak.sh --drives %s %s`, commit %s.\n\n' "${2:-10000000}" "${3:-1}" \
      "$(git rev-parse --short=8 HEAD 2>/dev/null || echo unknown)"
    printf 'Random settings, faults, pauses, optional channels and learnt states\n'
    printf '(tests/fuzz/drives.c). Found: number of rows in which a number is out of range,\n'
    printf 'tse_filter_check() refuses the state, a refused row changes the state, the age of the\n'
    printf 'last change does not grow, or an estimate depends on whether the previous row had an\n'
    printf 'output. Drives in which something was found are tests now (tests/fuzz/CMakeLists.txt).\n\n'
    printf '| build | rows | found |\n|---|---|---:|\n'
    cat "$table"
  } >scripts/results/drives.md
  exit $code
fi

rows=${1:-10000000}
dir=build/soak
cmake -S . -B $dir -DCMAKE_BUILD_TYPE=Release -DTSE_MAX_PARTICLES=64 -DTSE_BUILD_TESTS=OFF \
  -DTSE_BUILD_FMU=OFF -DTSE_BUILD_FUZZ=ON >/dev/null
cmake --build $dir --target soak >/dev/null
table=$(mktemp)
trap 'rm -f "$table"' EXIT
code=0
$dir/tests/fuzz/soak "$rows" >"$table" || code=$?
cat "$table"
{
  printf '`scripts/dev/soak.sh %s`: drives of a minute, one event each, default settings, double;\n' "$rows"
  printf 'cars with 0.6 .. 1.2 of the nominal stiffness, 8 .. 40 m/s. Restart: the filter started over\n'
  printf '(status 7). A restart is false if it is more than 5 s after the start and not within 15 s of\n'
  printf 'the event. States refused: by tse_filter_check(). Errors: of the valid cornering stiffness,\n'
  printf 'relative to its constant true value, from the start of the event on.\n\n'
  cat "$table"
} >scripts/results/soak.md
exit $code
