#!/usr/bin/env bash
# Builds unit tests by another preset than `release`, and runs them: each program as one process.
#
#   tests/checks/preset.sh asan|asan-gcc|tsan|portable [--short] [--part I/N] [PROGRAM...]
#
# PROGRAM is the name of a folder's tests: scene, jobs. Without one, those that the presets below name.
# --short leaves out the trainings that take longest. --part runs one in N of the programs, or of the
# shards of their tests: I = 0, 1, ... runs all of them in turn. .ci/run does both.
set -euo pipefail
cd "$(dirname "$0")/../.."

preset=${1:-}
shift || true
seconds=600  # for a program
shards=1     # processes that a program's tests are dealt out to
filter='*'   # of the tests
case "$preset" in
  # The server, the client and what they stand on, and all that reads data.
  asan)
    programs=(kernels locks machine files probability scene artifact inference onnx data commonroad
      nuscenes argoverse waymo mixed_sources town evaluation tags errors security monitoring serving jobs store rpc options client command
      load plot report report_command)
    ;;
  # What uses LibTorch. By GCC, since clang 14 does not compile LibTorch's headers. All of it takes
  # about 11 minutes of two processor cores, half of them for the eleven tests that --short leaves out.
  asan-gcc)
    programs=(learning mixed_training)
    seconds=3600
    shards=4
    long=(RankTrainingTest.LearnsTheSameWeightsToTheBit* WindowedTrainingTest.PredictsHeldOutArcs
      WindowedTrainingTest.ARunThatIsStoppedAnywhere* WindowedTrainingTest.RecordingsThatFit*
      CollapseTest.* BaselinesTest.ARunStoppedAtTheStart* BaselinesTest.BaselinesLearnTheArcs*
      BaselinesTest.BaselinesDoNotChangeTheModel* BaselinesTest.ARunThatStartedFromAModel*
      RecalibrationTest.MendsWrongWidths*)
    [ "${1:-}" != --short ] || filter="*-$(IFS=:; echo "${long[*]}")"
    ;;
  # Libraries with threads, without gRPC, which is not instrumented.
  tsan) programs=(locks machine files monitoring serving jobs store) ;;
  # The kernels as the packages hold them, on each target of this processor and plain, and the answers
  # of small models. Then the hardening that this preset compiles in.
  portable) programs=(kernels inference) ;;
  *) echo "preset: asan, asan-gcc, tsan and portable are known" >&2; exit 2 ;;
esac
[ "${1:-}" != --short ] || shift
part=0/1
[ "${1:-}" != --part ] || { part=$2; shift 2; }
[ $# -eq 0 ] || programs=("$@")
runs=()  # PROGRAM SHARD
i=0
for program in "${programs[@]}"; do
  for ((shard = 0; shard < shards; ++shard)); do
    ((i++ % ${part#*/} != ${part%/*} % ${part#*/})) || runs+=("$program $shard")
  done
done
mapfile -t programs < <(printf '%s\n' "${runs[@]% *}" | uniq)

mkdir -p build/checks
log=build/checks/$preset.log
if ! { cmake --preset "$preset" && cmake --build --preset "$preset" --target "${programs[@]/%/_test}"; } >"$log" 2>&1; then
  tail -n 40 "$log" >&2
  echo "preset: the build of $preset failed; all of it is in $log" >&2
  exit 1
fi

# GCC's ThreadSanitizer knows nothing of what the libraries of Debian do inside. LibTorch allocates so
# often that AddressSanitizer's longer stacks of allocations take a sixth of the time.
export TSAN_OPTIONS=ignore_noninstrumented_modules=1 UBSAN_OPTIONS=print_stacktrace=1
[ "$preset" != asan-gcc ] || export ASAN_OPTIONS=malloc_context_size=3
run() {
  local log=build/checks/$1-$2-$3.log
  GTEST_SHARD_INDEX=$3 timeout "$seconds" "build/$1/tests/$2_test" --gtest_brief=1 --gtest_filter="$filter" >"$log" 2>&1 &&
    return
  grep -v '^20..-..-..T' "$log" | tail -n 60 >&2  # without the servers' log lines
  echo "preset: $2_test failed with $1; all that it said is in $log" >&2
  return 1
}
export seconds filter GTEST_TOTAL_SHARDS=$shards
export -f run
printf '%s\n' "${runs[@]}" | xargs -P "$(nproc)" -L 1 bash -c 'run "$@"' run "$preset" || exit 1
echo "$preset: tests pass: ${programs[*]}"
# The packages' programs, which are not built here, have the same flags.
if [ "$preset" = portable ] && [[ " ${programs[*]} " = *" inference "* ]]; then
  tests/packages/hardening_test.sh build/portable/tests/inference_test
fi
