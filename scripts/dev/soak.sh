#!/usr/bin/env bash
# Run millions of rows of simulated drives with events through the default filter
# (tests/fuzz/soak.c). Fail on estimates that are not finite, refused states, recoveries
# without a cause, and mean errors above the interval in drives without an event or with
# late rows.
#
#   scripts/dev/soak.sh [ROWS]
#       default 10,000,000: two minutes of one core; writes scripts/results/soak.md
#   scripts/dev/soak.sh --drives [ROWS [FIRST_DRIVE]]
#       long random drives with any settings (tests/fuzz/drives.c) in double, float, fixed
#       point and the small build: numbers out of range, refused states, ages that do not
#       grow, estimates that depend on the output. Default 10,000,000 rows of each: 15
#       minutes of one core; writes scripts/results/drives.md
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
    printf '| %s | %s |\n' "$build" "$(sed -n 's/^.*: \([0-9]* rows of [0-9]* drives\), found \([0-9]*\)$/\1 | \2/p' \
      "$table.$build")" >>"$table"
    rm -f "$table.$build"
  done
  {
    printf '# Long random drives\n\n'
    printf '`scripts/dev/soak.sh --drives %s %s`, commit %s: random settings, faults, pauses,\n' "${2:-10000000}" \
      "${3:-1}" "$(git rev-parse --short=8 HEAD 2>/dev/null || echo unknown)"
    printf 'optional channels and learnt states (tests/fuzz/drives.c). Found: rows in which a number is\n'
    printf 'out of range, the own state is refused, a refused row changes something, an age does not\n'
    printf 'grow, or an estimate depends on whether the row before had an output.\n\n'
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
  printf '`scripts/dev/soak.sh %s`: drives of a minute each, one event in each, default settings\n' "$rows"
  printf 'in double; cars with 0.6 .. 1.2 of the nominal stiffness, 8 .. 40 m/s. False: a recovery\n'
  printf '(status 7) more than 5 s after the start and not within 15 s of the event. Errors are those\n'
  printf 'of valid cornering stiffness against the constant true one, from the start of the event on.\n\n'
  cat "$table"
} >scripts/results/soak.md
exit $code
