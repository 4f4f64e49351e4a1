#!/usr/bin/env bash
# Makes mutated calls to a server with AddressSanitizer and UndefinedBehaviorSanitizer, as .ci/run does.
#
#   tests/fuzz/wire/asan.sh [options of wire.py]       for instance: tests/fuzz/wire/asan.sh --calls 4000 --seed 2
set -euo pipefail
cd "$(dirname "$0")/../../.."

mkdir -p build/fuzz
log=build/fuzz/wire_build.log
if ! { cmake --preset asan && cmake --build --preset asan --target maneuverd write_small_model; } >"$log" 2>&1; then
  tail -n 40 "$log" >&2
  exit 1
fi
export UBSAN_OPTIONS=print_stacktrace=1
/usr/bin/python3 tests/fuzz/wire/wire.py --maneuverd build/asan/bin/maneuverd \
  --small-model build/asan/tests/write_small_model --longest 20 --memory 1000 "$@"
