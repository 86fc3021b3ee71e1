#!/usr/bin/env bash
# Looks for inputs that break something: the C targets of tests/fuzz with libFuzzer, address and undefined-behaviour sanitizers, and the
# readers of files (tests/fuzz/readers.py). A table at the end; fails when anything was found, which is then in build/fuzz/found/TARGET.
#   scripts/fuzz.sh [TARGET ...] [--runs N | --seconds S] [--seed N] [--minimise]
#     TARGET        step, settings, learnt, replay, state, fmu_calls_estimator ...; reader_log, reader_vehicle ...; default: all
#     --runs N      inputs of each target, for instance 1000000; default: --seconds 3, about a minute in all
#     --seed N      of libFuzzer's choices, so that --runs does the same again; default: another each time
#     --minimise    then keeps in tests/fuzz/corpus only inputs that reach what no smaller one does, at most 40 of a target
# Without clang and its libFuzzer the C targets are skipped; exit code 77 when nothing could run.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

longest=600                                   # bytes of an input: some 160 rows
kept=40                                       # inputs of a corpus in the repository: all targets together some 100 kB
readers=(log vehicle filter formula learnt stage progress runs archive table)
c_targets=(step settings learnt replay state fmu_calls_estimator fmu_calls_vehicle fmu_state_estimator fmu_state_vehicle)
chosen=() runs="" seconds=3 seed="" minimise=""
while [ $# -gt 0 ]; do
  case $1 in
    --runs | --seconds)
      [[ ${2:-} =~ ^[1-9][0-9]*$ ]] || { echo "fuzz: $1 needs a whole number" >&2; exit 2; }
      if [ "$1" = --runs ]; then runs=$2 seconds=""; else seconds=$2; fi
      shift ;;
    --seed)
      [[ ${2:-} =~ ^[1-9][0-9]*$ ]] || { echo "fuzz: $1 needs a whole number" >&2; exit 2; }
      seed=$2
      shift ;;
    --minimise) minimise=1 ;;
    -*) echo "fuzz: no option $1" >&2; exit 2 ;;
    *) chosen+=("$1") ;;
  esac
  shift
done
[ ${#chosen[@]} -gt 0 ] || chosen=("${c_targets[@]}" "${readers[@]/#/reader_}")
for name in "${chosen[@]}"; do
  [[ " ${c_targets[*]} ${readers[*]/#/reader_} " == *" $name "* ]] || { echo "fuzz: no target $name" >&2; exit 2; }
done

table=() failed=0 ran=0
row() { table+=("$(printf '%-22s %10s %10s  %s' "$@")"); }
binaries=build/fuzz/tests/fuzz
built=""

build() {                                     # once, when the first C target is asked for
  if ! echo 'int LLVMFuzzerTestOneInput(const char *d, long n); int LLVMFuzzerTestOneInput(const char *d, long n) { return n > 0 && !d; }' \
      | clang -fsanitize=fuzzer,address,undefined -x c - -o /dev/null 2>/dev/null; then
    built=no
    return
  fi
  local options=()
  [ -d .venv/share/fmi2 ] && options+=("-DFETCHCONTENT_SOURCE_DIR_FMI2=$PWD/.venv/share/fmi2")
  if [ -z "${CMAKE_GENERATOR:-}" ] && command -v ninja >/dev/null; then export CMAKE_GENERATOR=Ninja; fi
  mkdir -p build/fuzz
  if { cmake --preset fuzz "${options[@]}" && cmake --build --preset fuzz; } >build/fuzz/build.log 2>&1; then built=yes; else
    tail -n 20 build/fuzz/build.log >&2
    built=failed
  fi
}

fuzz() {                                      # one C target
  local name=$1 found=build/fuzz/found/$1 grown=build/fuzz/corpus/$1 given=tests/fuzz/corpus/$1 log=build/fuzz/$1.log limits=()
  mkdir -p "$found" "$grown"
  [ -n "$runs" ] && limits+=("-runs=$runs")
  [ -n "$seconds" ] && limits+=("-max_total_time=$seconds")
  [ -n "$seed" ] && limits+=("-seed=$seed")
  local folders=("$grown")
  [ -d "$given" ] && folders+=("$given")
  [ -d "tests/fuzz/found/$name" ] && folders+=("tests/fuzz/found/$name")
  if "$binaries/fuzz_$name" "${limits[@]}" -max_len=$longest -timeout=20 -rss_limit_mb=2048 -print_final_stats=1 \
      "-artifact_prefix=$found/" "${folders[@]}" >"$log" 2>&1; then
    row "$name" "$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")" "$(ls "$grown" | wc -l)" "nothing found"
  else
    grep -E 'fuzz:|ERROR|runtime error' "$log" | head -n 3
    row "$name" "-" "$(ls "$grown" | wc -l)" "FOUND: $(ls -t "$found" | head -n 1)"
    failed=1
  fi
  if [ -n "$minimise" ] && [ "$failed" = 0 ]; then
    local small="build/fuzz/small/$name"
    rm -rf "$small"
    mkdir -p "$small" "$given"
    "$binaries/fuzz_$name" -merge=1 -max_len=200 "$small" "$grown" "$given" >/dev/null 2>&1
    rm -f "$given"/*
    # those that libFuzzer took first reach the most
    ls -S -r "$small" | awk -v kept=$kept '{ name[NR] = $0 } END { for (i = 1; i <= kept && i <= NR; i++) print name[int((i - 1) * NR / (NR < kept ? NR : kept)) + 1] }' \
      | while read -r file; do cp "$small/$file" "$given/"; done
  fi
}

for name in "${chosen[@]}"; do
  if [[ $name == reader_* ]]; then
    limits=()
    [ -n "$runs" ] && limits+=(--runs "$runs")
    [ -n "$seconds" ] && limits+=(--seconds "$seconds")
    log=build/fuzz/$name.log
    mkdir -p build/fuzz
    if PYTHONPATH=$PWD/scripts .venv/bin/python tests/fuzz/readers.py "${name#reader_}" "${limits[@]}" >"$log" 2>&1; then
      row "$name" "$(sed -n 's/.*"inputs": \([0-9]*\).*/\1/p' "$log")" "-" "nothing found"
    else
      cat "$log"
      row "$name" "-" "-" "FOUND"
      failed=1
    fi
    ran=1
    continue
  fi
  [ -n "$built" ] || build
  case $built in
    yes) fuzz "$name"; ran=1 ;;
    no) row "$name" "-" "-" "skipped: clang with libFuzzer and sanitizers is not installed" ;;
    *) row "$name" "-" "-" "FAILED to build"; failed=1 ;;
  esac
done
printf '%-22s %10s %10s\n' target inputs corpus
printf '%s\n' "${table[@]}"
[ "$failed" = 0 ] || exit 1
[ "$ran" = 1 ] || exit 77
