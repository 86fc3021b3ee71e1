#!/usr/bin/env bash
# Measure computing time, in double and float, with and without AVX2. Print two Markdown
# tables: the time per particle and step for 64 .. 4096 particles, and the time of a row
# of the default filter and of a plain extended Kalman filter (tests/bench/ekf.c). This is
# a benchmark, not a test: only numbers of the same run can be compared.
#
#   scripts/dev/bench.sh rows    print only the second table
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

variants=(double: float:)
if grep -qs '^flags.* avx2 ' /proc/cpuinfo; then variants=(double: double:-mavx2 float: float:-mavx2); fi
columns=() ratios=()
for v in "${variants[@]}"; do
  real=${v%%:*} flag=${v#*:}
  dir=build/bench-$real$flag
  cmake -S . -B "$dir" -DTSE_REAL="$real" -DTSE_MAX_PARTICLES=4096 -DCMAKE_BUILD_TYPE=Release \
    "-DCMAKE_C_FLAGS=$flag" -DTSE_BUILD_TESTS=OFF -DTSE_BUILD_FMU=OFF -DTSE_BUILD_BENCH=ON >/dev/null
  cmake --build "$dir" --target bench >/dev/null
  ratios+=("$("$dir/tests/bench/bench" ratio)")
  [ "${1:-}" = rows ] && continue
  columns+=("$(mktemp)")
  "$dir/tests/bench/bench" >"${columns[-1]}"
done
header="" rule=""
for v in "${variants[@]}"; do
  flag=${v#*:}
  header+=" ${v%%:*}${flag:+, AVX2} |" rule+="---:|"
done
rows() {
  printf '| filter: time per row |%s\n|---|%s\n' "$header" "$rule"
  printf '%s\n' "${ratios[@]}" | awk '
    { as_it_comes = as_it_comes " " $1 " ns |"; ekf = ekf " " $2 " ns |"; ratio = ratio " " $3 " |" }
    END { print "| default |" as_it_comes; print "| plain EKF |" ekf; print "| ratio |" ratio }'
}
if [ "${1:-}" = rows ]; then
  rows
  exit
fi
printf '| particles: time per particle and row |%s\n|---:|%s\n' "$header" "$rule"
paste -d' ' "${columns[@]}" \
  | awk '{ line = "| " $1 " |"; for (i = 2; i <= NF; i += 2) line = line " " $i " ns |"; print line }'
rm -f "${columns[@]}"
printf '\n'
rows
