#!/usr/bin/env bash
# maneuverd and the server in Python (server.py) under the same load, in turn, as a Markdown table:
# 32 callers who each wait for their answer, on the servers' own machine.
#
#   tests/bench/peers/server.sh MODEL_FOLDER [DATASET_FOLDER]
#
# SECONDS_EACH (8) is the length of a run, of which there are ROUNDS (3) for each; PYTHON
# (/usr/bin/python3), BIN (build/release/bin). The other server stands idle meanwhile. Both have all cores,
# of which the callers share the last.
set -euo pipefail

case "${1:---help}" in
  -h|--help) sed -n '2,9s/^# \{0,1\}//p' "$0"; exit 0 ;;
esac
model=$1
here=$(cd "$(dirname "$0")" && pwd)
BIN=${BIN:-$here/../../../build/release/bin}
source "$here/../measured_server.sh"
scenes=()
[ -z "${2:-}" ] || scenes=(--dataset "$2")

server_cores=0-$((cores - 1))
version 1 "$model"
start_server
ours=$MANEUVER_SERVER
"$bin/maneuver" model promote measured/1 >&2
taskset -c "$server_cores" nice -n 5 "${PYTHON:-/usr/bin/python3}" "$here/server.py" "$model" \
  >"$work/peer.out" 2>"$work/peer.log" &
peer=$!
trap 'kill "$peer" 2>/dev/null || true; finish' EXIT
for _ in $(seq 600); do
  [ ! -s "$work/peer.out" ] || break
  kill -0 "$peer" 2>/dev/null || { cat "$work/peer.log" >&2; exit 1; }
  sleep 0.1
done
theirs=$(head -1 "$work/peer.out")

median() { sort -n | awk '{ v[NR] = $1 } END { print v[int((NR + 1) / 2)] }'; }
echo "| targets a call | maneuverd, calls/s | p50 ms | in Python, calls/s | p50 ms | maneuverd / in Python |"
echo "|---|---:|---:|---:|---:|---:|"
for targets in 1 8; do
  rm -f "$work"/rate.* "$work"/p50.*
  for _ in $(seq "${ROUNDS:-3}"); do
    for whose in ours theirs; do
      "$bin/maneuver" load --server "${!whose}" "${scenes[@]}" --targets "$targets" --warm-up 2 \
        --duration "${SECONDS_EACH:-8}" --json "$work/load.json" >"$work/load.txt" 2>&1 ||
        { cat "$work/load.txt" >&2; exit 1; }
      figure "$work/load.json" steps.0.answered_per_second >>"$work/rate.$whose"
      figure "$work/load.json" steps.0.latency_ms.p50 >>"$work/p50.$whose"
    done
  done
  paste "$work/rate.ours" "$work/rate.theirs" | awk '{ print $1 / $2 }' >"$work/rate.ratio"
  printf '| %s | %.1f | %.2f | %.1f | %.2f | %.1f |\n' "$targets" \
    "$(median <"$work/rate.ours")" "$(median <"$work/p50.ours")" \
    "$(median <"$work/rate.theirs")" "$(median <"$work/p50.theirs")" "$(median <"$work/rate.ratio")"
done
