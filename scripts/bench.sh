#!/usr/bin/env bash
# Time per particle and step: double and float, baseline and AVX2, 64 .. 4096 particles. A benchmark, not a test:
# compare figures within one run only. Prints a Markdown table.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

variants=(double: float:)
if grep -qs '^flags.* avx2 ' /proc/cpuinfo; then variants=(double: double:-mavx2 float: float:-mavx2); fi
columns=()
for v in "${variants[@]}"; do
  real=${v%%:*} flag=${v#*:}
  dir=build/bench-$real$flag
  cmake -S . -B "$dir" -DTSE_REAL="$real" -DTSE_MAX_PARTICLES=4096 -DCMAKE_BUILD_TYPE=Release "-DCMAKE_C_FLAGS=$flag" \
    -DTSE_BUILD_TESTS=OFF -DTSE_BUILD_BENCH=ON >/dev/null
  cmake --build "$dir" --target bench >/dev/null
  columns+=("$(mktemp)")
  "$dir/tests/bench/bench" >"${columns[-1]}"
done
header="| particles |" rule="|---:|"
for v in "${variants[@]}"; do
  flag=${v#*:}
  header+=" ${v%%:*}${flag:+, AVX2} |" rule+="---:|"
done
printf '%s\n%s\n' "$header" "$rule"
paste -d' ' "${columns[@]}" | awk '{ line = "| " $1 " |"; for (i = 2; i <= NF; i += 2) line = line " " $i " ns |"; print line }'
rm -f "${columns[@]}"
