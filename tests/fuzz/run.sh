#!/usr/bin/env bash
# Fuzzes with libFuzzer, AddressSanitizer and UndefinedBehaviorSanitizer, by clang 14.
#
#   tests/fuzz/run.sh --seconds S | --hours H [--jobs N] [--part I/N] [HARNESS...]
#
# Runs each harness for that long (all of them without a name), N at a time, 1 without --jobs. --part
# takes every N-th of them, beginning with the one of number I modulo N, as .ci/run does. New inputs
# go to build/fuzz/corpus/HARNESS, which the next run begins with. What breaks a harness is
# left in build/fuzz/found/HARNESS-crash-...; replay it with
#
#   build/asan/tests/fuzzer --harness=HARNESS FILE
#
# The exit status is 1 if any harness broke. Once it is mended, add the input, made small by
# `-minimize_crash=1`, to tests/fuzz/corpus/HARNESS, and a unit test.
set -euo pipefail
cd "$(dirname "$0")/../.."

usage() { echo "run: tests/fuzz/run.sh --seconds S | --hours H [--jobs N] [--part I/N] [HARNESS...]" >&2; exit 2; }
seconds= jobs=1 part=0/1 harnesses=()
while [ $# -gt 0 ]; do
  case "$1" in
    --seconds) seconds=${2:?}; shift 2 ;;
    --hours) seconds=$(awk "BEGIN {print int(3600 * ${2:?})}"); shift 2 ;;
    --jobs) jobs=${2:?}; shift 2 ;;
    --part) part=${2:?}; shift 2 ;;
    -*) usage ;;
    *) harnesses+=("$1"); shift ;;
  esac
done
[ -n "$seconds" ] || usage
[ ${#harnesses[@]} -gt 0 ] || mapfile -t harnesses < <(ls tests/fuzz/corpus)
for harness in "${harnesses[@]}"; do
  [ -d "tests/fuzz/corpus/$harness" ] || { echo "run: no harness $harness; there are" $(ls tests/fuzz/corpus) >&2; exit 2; }
done

chosen=()
for ((i = ${part%/*} % ${part#*/}; i < ${#harnesses[@]}; i += ${part#*/})); do chosen+=("${harnesses[i]}"); done

mkdir -p build/fuzz/found
if ! { cmake --preset asan && cmake --build --preset asan --target fuzzer; } >build/fuzz/build.log 2>&1; then
  tail -n 40 build/fuzz/build.log >&2
  exit 1
fi

fuzz() {
  local harness=$1 seconds=$2 log=build/fuzz/$1.log length=4096
  case "$harness" in nuscenes | scenario | stream) length=16384 ;; esac
  mkdir -p "build/fuzz/corpus/$harness"
  if build/asan/tests/fuzzer "--harness=$harness" -max_total_time="$seconds" -max_len="$length" -timeout=20 \
      -rss_limit_mb=3000 -print_final_stats=1 "-artifact_prefix=build/fuzz/found/$harness-" \
      "build/fuzz/corpus/$harness" "tests/fuzz/corpus/$harness" >"$log" 2>&1; then
    awk -v harness="$harness" -v seconds="$seconds" '
      / cov: / {for (i = 1; i < NF; i++) {if ($i == "cov:") edges = $(i + 1); if ($i == "corp:") inputs = $(i + 1)}}
      /number_of_executed_units/ {runs = $2}
      END {printf "%-14s %d s: %d runs, %d edges, %s inputs, nothing found\n", harness, seconds, runs, edges, inputs}' "$log"
  else
    grep -E "^broken:|ERROR:|runtime error|SUMMARY" "$log" | head -n 5 >&2
    echo "$harness: broke; see $log and build/fuzz/found" >&2
    return 1
  fi
}
export -f fuzz
printf '%s\n' "${chosen[@]}" | xargs -P "$jobs" -I '{}' bash -c 'fuzz "$@"' fuzz '{}' "$seconds"
