#!/usr/bin/env bash
# Installs what is missing, builds everything and runs all tests.
#
#   tests/run.sh [ctest options]       for instance: tests/run.sh -R scheduler
#
# MANEUVER_REAL_DATA=FOLDER, with Waymo Open Motion TFRecords, also runs the
# tests on real scenes; without it they say that they were skipped.
set -euo pipefail
cd "$(dirname "$0")/.."

deploy/install-deps.sh --tests
mkdir -p build
cmake --preset release >build/configure.log 2>&1 || { cat build/configure.log >&2; exit 1; }
cmake --build --preset release
# Once ctest has run, it knows by itself how long tests take.
costs=build/release/Testing/Temporary/CTestCostData.txt
if [ ! -e "$costs" ]; then
  mkdir -p "$(dirname "$costs")"
  { sed -nE 's/^([a-z][^ ]*) ([0-9]+)$/\1 1 \2/p' tests/costs.txt; echo ---; } >"$costs"
fi
ctest --preset release --parallel "$(nproc)" "$@"
