#!/usr/bin/env bash
# What a training job on the server's own cores costs those who ask: latencies at half of what the
# server can take, in pairs of runs on one server, without ("off") and with a job that is in its joint
# phase ("on"; between the runs it is cancelled and resumed). The server keeps its promise if the p99
# with it is at most 1.5 times that without (median of the pairs).
#
#   tests/bench/beside_training.sh MODEL_FOLDER [-- flags of maneuverd]
#
# PAIRS (5) of runs of SECONDS_EACH (8); SHARE (0.5) of the capacity; TARGETS (16) how many vehicles a
# call asks about; BIN (build/release/bin) where the programs are. Server and job share their cores;
# callers have others, or, with SHARED=1, the same. Ends with status 1 if the promise was not kept.
set -euo pipefail
case "${1:---help}" in
  -h|--help) sed -n '2,12s/^# \{0,1\}//p' "$0"; exit 0 ;;
esac
model=$1
shift
[ "${1:-}" != -- ] || shift
each=${SECONDS_EACH:-8}
pairs=${PAIRS:-5}
targets=${TARGETS:-16}

source "$(dirname "$0")/measured_server.sh"
version 1 "$model"
start_server "$@"
"$bin/maneuver" model promote measured/1 >&2
"$bin/maneuver" synthesize "$work/town" --recordings 40 >&2
"$bin/maneuver" dataset upload "$work/town" town >&2

load() { "$bin/maneuver" load --metrics "$metrics" --targets "$targets" --duration "$each" --json "$work/load.json" "$@" >/dev/null; }
# Of the one run in load.json.
figure() { sed -n "s/.*\"$1\": *\\([0-9.e+-]*\\),\\{0,1\\}\$/\\1/p" "$work/load.json" | head -1; }
# state or phase of the job.
of_job() {
  "$bin/maneuver" job show "$job" --output json |
    sed -n "s/.*\"$1\": *\"\(JOB_STATE_\)*\([A-Za-z]*\)\".*/\2/p" | head -1
}
# until_job state RUNNING: a minute at most.
until_job() {
  for _ in $(seq 300); do
    [ "$(of_job "$1")" != "$2" ] || return 0
    sleep 0.2
  done
  echo "the job's $1 is $(of_job "$1"), not $2" >&2
  exit 1
}

load
rate=$(awk "BEGIN { print ${SHARE:-0.5} * $(figure answered_per_second) }")
job=$("$bin/maneuver" train beside --dataset town --detach --epochs 10000 --promote never \
  --set optimization.pretraining_epochs=1 --set optimization.mixture_epochs=1 --set examples.max_examples=1000 2>/dev/null)
until_job phase joint

echo "$cores cores, of which server and job have $server_cores and callers $(taskset -pc $$ | sed 's/.*: //')."
echo
echo "| at $rate/s, $targets vehicles a call | p50 ms | p90 ms | p99 ms | answered/s | p99, on by off |"
echo "|---|---:|---:|---:|---:|---:|"
ratios=()
for _ in $(seq "$pairs"); do
  "$bin/maneuver" job cancel "$job" >/dev/null
  until_job state CANCELLED
  load --rate "$rate" --deadline 5000
  off=$(figure p99)
  echo "| off | $(figure p50) | $(figure p90) | $off | $(figure answered_per_second) | |"
  "$bin/maneuver" job resume "$job" --detach >/dev/null
  until_job state RUNNING
  sleep 5  # it reads its recordings and its checkpoint
  load --rate "$rate" --deadline 5000
  on=$(figure p99)
  ratios+=("$(awk "BEGIN { printf \"%.2f\", $on / $off }")")
  echo "| on | $(figure p50) | $(figure p90) | $on | $(figure answered_per_second) | ${ratios[-1]} |"
done
[ "$(of_job state)" = RUNNING ] || { echo "the job ended: nothing was measured beside it" >&2; exit 1; }
"$bin/maneuver" job cancel "$job" >/dev/null
median=$(printf '%s\n' "${ratios[@]}" | sort -n | sed -n "$(((pairs + 1) / 2))p")
echo
if awk "BEGIN { exit !($median <= 1.5) }"; then
  echo "- kept: the p99 with a job was $median times that without (at most 1.5)"
else
  echo "- **not kept**: the p99 with a job was $median times that without (at most 1.5)"
  exit 1
fi
