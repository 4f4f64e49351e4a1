#!/usr/bin/env bash
# What the shadow costs those who call: latencies at half of what a server can take, with
# --shadow-fraction 1, in pairs of runs on one server: `candidate` is the version that answers, so
# that nothing is compared ("off"), then another one ("on").
#
#   tests/bench/shadow.sh MODEL_FOLDER CANDIDATE_FOLDER
#
# PAIRS (5) of runs of SECONDS_EACH (6); SHARE (0.5) of the capacity; BIN (build/release/bin) where
# the programs are. Server and callers share this machine: on a busy one the pairs differ by more
# than the shadow does.
set -euo pipefail
[ $# -eq 2 ] || { sed -n '2,10s/^# \{0,1\}//p' "$0"; exit 2; }
bin=${BIN:-$(dirname "$0")/../../build/release/bin}
each=${SECONDS_EACH:-6}

work=$(mktemp -d)
server=
finish() {
  [ -z "$server" ] || { kill "$server" 2>/dev/null; wait "$server" 2>/dev/null; } || true
  rm -rf "$work"
}
trap finish EXIT
mkdir -p "$work/data/models/measured"
cp -r "$1" "$work/data/models/measured/1"
cp -r "$2" "$work/data/models/measured/2"
# Callers on the same cores have to be punctual: they come first.
nice -n 5 "$bin/maneuverd" --data-dir "$work/data" --listen 127.0.0.1:0 --metrics-listen 127.0.0.1:0 \
  --port-file "$work/ports.json" --shadow-fraction 1 >"$work/maneuverd.out" 2>"$work/maneuverd.log" &
server=$!
for _ in $(seq 300); do
  [ ! -s "$work/ports.json" ] || break
  kill -0 "$server" 2>/dev/null || { cat "$work/maneuverd.log" >&2; exit 1; }
  sleep 0.1
done
MANEUVER_SERVER=$(sed -n 's/.*"grpc": *"\([^"]*\)".*/\1/p' "$work/ports.json")
metrics=$(sed -n 's/.*"metrics": *"\([^"]*\)".*/\1/p' "$work/ports.json")
export MANEUVER_SERVER

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
