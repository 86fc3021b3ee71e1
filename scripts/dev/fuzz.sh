#!/usr/bin/env bash
# Search for inputs with which the C library or a reader of files fails.
#
# libFuzzer runs the C targets of tests/fuzz with address and undefined-behaviour
# sanitizers, in double, float and fixed point. tests/fuzz/readers.py runs the readers.
# Prints a table. If an input makes a target fail, the script fails, too, and writes this
# input to build/fuzz/found/TARGET.
#
#   scripts/dev/fuzz.sh [TARGET ...] [--runs N] [--seconds S] [--seed N] [--minimise]
#                       [--table FILE]
#     TARGET        step, settings, learnt, replay, state, fmu_calls_estimator ...;
#                   float_step, fixed_step ...; reader_log, reader_vehicle ...
#                   Default: all
#     --runs N      number of inputs of each target. Example: 1000000
#     --seconds S   [s] time of each target. If --runs is given, too, a target ends at the
#                   limit that it reaches first. If neither option is given, each target
#                   takes 3 s, and all targets take a minute
#     --seed N      seed of the random numbers: repeats a search with --runs. Default: a
#                   random seed
#     --minimise    reduce the inputs of each target to those that are needed to reach the
#                   same code, keep at most 40 of them, and write these to
#                   tests/fuzz/inputs.hex
#     --table FILE  write the table in Markdown to a file, such as scripts/results/fuzz.md
#
# Without clang and libFuzzer, the C targets are skipped. Exit code 77: no target ran.
set -uo pipefail
asked="$*"
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

max_bytes=600                                 # max size of an input: about 160 rows
kept=40                                       # max number of kept inputs of a target: 100 kB for all
readers=(log vehicle filter formula learnt runs)
core_targets=(step settings learnt replay state)
c_targets=("${core_targets[@]}" fmu_calls_estimator fmu_calls_vehicle fmu_state_estimator fmu_state_vehicle
           "${core_targets[@]/#/float_}" "${core_targets[@]/#/fixed_}")
chosen=() runs="" seconds="" seed="" minimise="" page=""
while [ $# -gt 0 ]; do
  case $1 in
    --runs | --seconds | --seed)
      [[ ${2:-} =~ ^[1-9][0-9]*$ ]] || { echo "fuzz: $1 needs a whole number" >&2; exit 2; }
      printf -v "${1#--}" '%s' "$2"
      shift ;;
    --minimise) minimise=1 ;;
    --table)
      [ -n "${2:-}" ] || { echo "fuzz: --table needs a file" >&2; exit 2; }
      page=$2
      shift ;;
    -*) echo "fuzz: unknown option $1" >&2; exit 2 ;;
    *) chosen+=("$1") ;;
  esac
  shift
done
[ -n "$runs$seconds" ] || seconds=3
[ ${#chosen[@]} -gt 0 ] || chosen=("${c_targets[@]}" "${readers[@]/#/reader_}")
for name in "${chosen[@]}"; do
  [[ " ${c_targets[*]} ${readers[*]/#/reader_} " == *" $name "* ]] \
    || { echo "fuzz: unknown target $name" >&2; exit 2; }
done

table=() lines=() failed=0 ran=0
row() {                                       # row TARGET INPUTS RATE REACHED CORPUS WORD
  table+=("$(printf '%-22s %10s %10s %10s %8s  %s' "$@")")
  lines+=("$(printf '| %s | %s | %s | %s | %s | %s |' "$@")")
}
declare -A built=()

build() {                                     # build PRESET; called before the first target of a preset
  local head='int LLVMFuzzerTestOneInput(const char *d, long n)'
  if ! echo "$head; $head { return n > 0 && !d; }" \
      | clang -fsanitize=fuzzer,address,undefined -x c - -o /dev/null 2>/dev/null; then
    built[$1]=no
    return
  fi
  local options=()
  [ -d .venv/share/fmi2 ] && options+=("-DFETCHCONTENT_SOURCE_DIR_FMI2=$PWD/.venv/share/fmi2")
  if [ -z "${CMAKE_GENERATOR:-}" ] && command -v ninja >/dev/null; then export CMAKE_GENERATOR=Ninja; fi
  mkdir -p "build/$1"
  if { cmake --preset "$1" "${options[@]}" && cmake --build --preset "$1"; } >"build/$1/build.log" 2>&1; then
    built[$1]=yes
  else
    tail -n 20 "build/$1/build.log" >&2
    built[$1]=failed
  fi
}

fuzz() {                                      # fuzz NAME PRESET TARGET: run one C target
  local name=$1 preset=$2 target=$3 limits=()
  local found=build/fuzz/found/$name grown=build/fuzz/corpus/$name
  local given=build/fuzz/given/$target log=build/fuzz/$name.log
  local program=build/$preset/tests/fuzz/fuzz_$target
  mkdir -p "$found" "$grown"
  [ -n "$runs" ] && limits+=("-runs=$runs")
  [ -n "$seconds" ] && limits+=("-max_total_time=$seconds")
  # With a seed, a run must be repeatable. Switch off two methods of libFuzzer that are
  # not: use_cmp uses values that contain addresses, and entropic chooses inputs by their
  # run time.
  [ -n "$seed" ] && limits+=("-seed=$seed" -use_cmp=0 -entropic=0)
  rm -rf "$given"
  python3 tests/fuzz/inputs.py unpack "$target" "$given"
  if "$program" "${limits[@]}" -max_len=$max_bytes -timeout=20 -rss_limit_mb=2048 -print_final_stats=1 \
      "-artifact_prefix=$found/" "$grown" "$given" >"$log" 2>&1; then
    row "$name" "$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")" \
      "$(sed -n 's/^stat::average_exec_per_sec: *//p' "$log")" \
      "$(sed -n 's/.*DONE *cov: \([0-9]*\).*/\1/p' "$log")" "$(ls "$grown" | wc -l)" "nothing found"
  else
    grep -E 'fuzz:|ERROR|runtime error' "$log" | head -n 3
    row "$name" "-" "-" "-" "$(ls "$grown" | wc -l)" "FOUND: $(ls -t "$found" | head -n 1)"
    failed=1
    return
  fi
  if [ -n "$minimise" ] && [ "$name" = "$target" ]; then
    local small=build/fuzz/small/$name chosen=build/fuzz/chosen/$name
    rm -rf "$small" "$chosen"
    mkdir -p "$small" "$chosen"
    "$program" -merge=1 -max_len=200 "$small" "$grown" "$given" >/dev/null 2>&1
    # keep inputs of all sizes: choose them evenly from the list sorted by size
    ls -S -r "$small" | awk -v kept=$kept '
        { name[NR] = $0 }
        END {
          n = NR < kept ? NR : kept
          for (i = 1; i <= n; i++) print name[int((i - 1) * NR / n) + 1]
        }' \
      | while read -r file; do cp "$small/$file" "$chosen/"; done
    python3 tests/fuzz/inputs.py pack "$target" "$chosen"
  fi
}

read_files() {                                # read_files NAME: run one reader
  local name=$1 limits=() log=build/fuzz/$1.log done_ took
  [ -n "$runs" ] && limits+=(--runs "$runs")
  [ -n "$seconds" ] && limits+=(--seconds "$seconds")
  [ -n "$seed" ] && limits+=(--seed "$seed")
  mkdir -p build/fuzz
  if PYTHONPATH=$PWD/scripts .venv/bin/python tests/fuzz/readers.py "${name#reader_}" "${limits[@]}" \
      >"$log" 2>&1; then
    done_=$(sed -n 's/.*"inputs": \([0-9]*\).*/\1/p' "$log")
    took=$(sed -n 's/.*"seconds": \([0-9]*\).*/\1/p' "$log")
    row "$name" "$done_" "$((done_ / (took > 0 ? took : 1)))" "-" "-" "nothing found"
  else
    cat "$log"
    row "$name" "-" "-" "-" "-" "FOUND"
    failed=1
  fi
}

for name in "${chosen[@]}"; do
  if [[ $name == reader_* ]]; then
    read_files "$name"
    ran=1
    continue
  fi
  preset=fuzz target=$name
  case $name in float_* | fixed_*) preset=fuzz-${name%%_*} target=${name#*_} ;; esac
  [ -n "${built[$preset]:-}" ] || build $preset
  case ${built[$preset]} in
    yes) fuzz "$name" $preset "$target"; ran=1 ;;
    no) row "$name" "-" "-" "-" "-" "skipped: clang with libFuzzer and sanitizers is not installed" ;;
    *) row "$name" "-" "-" "-" "-" "FAILED to build"; failed=1 ;;
  esac
done
printf '%-22s %10s %10s %10s %8s\n' target inputs inputs/s edges corpus
printf '%s\n' "${table[@]}"
if [ -n "$page" ]; then
  {
    printf '`scripts/dev/fuzz.sh %s`: each target runs until the limit of inputs or seconds.\n' "$asked"
    printf 'An input has at most %d bytes: a drive of up to 160 rows, a sequence of calls or a file.\n' \
      "$max_bytes"
    printf 'C targets run with the sanitizers for addresses and undefined behaviour. Inputs/s:\n'
    printf 'measured on a shared machine. Edges: branches of the program that libFuzzer reached.\n'
    printf 'Corpus: number of inputs that each reached new edges. Edges and corpus are not counted for\n'
    printf 'the readers, which are in Python. Inputs that found errors are in tests/fuzz/inputs.hex:\n'
    printf 'every run of the tests repeats them.\n\n'
    printf '| target | inputs | inputs/s | edges | corpus | found |\n|---|---:|---:|---:|---:|---|\n'
    printf '%s\n' "${lines[@]}"
  } >"$page"
fi
[ "$failed" = 0 ] || exit 1
[ "$ran" = 1 ] || exit 77
