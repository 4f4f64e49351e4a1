#!/usr/bin/env bash
# What the shadow costs those who call: latencies at half of what a server can take, with
# --shadow-fraction 1, in pairs of runs on one server: `candidate` is the version that answers, so
# that nothing is compared ("off"), then another one ("on").
#
#   tests/bench/shadow.sh MODEL_FOLDER CANDIDATE_FOLDER
#
# PAIRS (5) of runs of SECONDS_EACH (6); SHARE (0.5) of the capacity; BIN (build/release/bin) where
# the programs are. Server and callers have cores of their own, or, with SHARED=1, the same: on a busy
# machine the pairs differ by more than the shadow does.
set -euo pipefail
[ $# -eq 2 ] || { sed -n '2,10s/^# \{0,1\}//p' "$0"; exit 2; }
each=${SECONDS_EACH:-6}

source "$(dirname "$0")/measured_server.sh"
version 1 "$1"
version 2 "$2"
start_server --shadow-fraction 1

candidate() { "$bin/maneuver" model promote "measured/$1" --alias candidate >&2; }
# load FILE OPTIONS...
load() { "$bin/maneuver" load --warm-up 1 --duration "$each" --json "$@" >&2; }
figure() { python3 -c "import json, sys; print(eval(sys.argv[2], {'s': json.load(open(sys.argv[1]))['steps'][0]}))" "$@"; }

"$bin/maneuver" model promote measured/1 >&2
candidate 1
load "$work/capacity.json"
rate=$(figure "$work/capacity.json" "s['answered_per_second'] * ${SHARE:-0.5}")
echo "| AT $rate/s | p50 ms | p90 ms | p99 ms | ENDED |"
echo "|---|---:|---:|---:|---|"
for _ in $(seq "${PAIRS:-5}"); do
  for version in 1 2; do
    candidate "$version"
    load "$work/run.json" --rate "$rate"
    figure "$work/run.json" "'| %s | %.2f | %.2f | %.2f | %s |' % (
        ['off', 'on'][$version - 1], *(s['latency_ms'][p] for p in ('p50', 'p90', 'p99')), s['ended'])"
  done
done
curl -s "http://$metrics/metrics" | grep -E '^maneuver_shadow_(targets|seconds)'
