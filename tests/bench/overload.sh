#!/usr/bin/env bash
# What a server does when it is asked for more than it can do, as Markdown tables:
#
#   1. 25, 50, 80, 100 and 300 % of what it can do, then 300 % and what it can do in turn, ROUNDS (5)
#      times. It keeps its promise if at 300 % it still answers at least 90 % of what it does just before
#      and just after (the mean of both; the median of the rounds), its memory stays bounded, and each
#      refused call is told when to come again. Callers hold back as the client library has them; beside
#      it, what is left if they send all.
#   2. Patient callers at 40 % of what it can do by then, alone and beside 10,000 calls that have 1 to
#      5 ms, STORMS (3) times. It keeps its promise if their p99 stays below twice what it was (median).
#      Expired targets are counted by how far they came.
#
#   tests/bench/overload.sh [MODEL_FOLDER] [-- flags of maneuverd]
#
# Without a model one is trained in a minute. SECONDS_EACH (10) is the length of a run; DEADLINE (500)
# what callers of part 1 allow, milliseconds; TARGETS (16) how many vehicles a call asks about, but for
# the storm's, which ask about one; MAPS=1 registers the roads first, so that calls only name them;
# SCENES a dataset folder, in place of the synthetic town; STORM_RATE (1000) the storm's calls a second;
# BIN (build/release/bin) where the programs are. Server and callers have cores of their own, or, with
# SHARED=1, the same. Ends with status 1 if a promise was not kept.
set -euo pipefail

model=
case "${1:---}" in
  -h|--help) sed -n '2,23s/^# \{0,1\}//p' "$0"; exit 0 ;;
  --) [ $# -eq 0 ] || shift ;;
  *) model=$1; shift; [ "${1:-}" != -- ] || shift ;;
esac
each=${SECONDS_EACH:-10}
deadline=${DEADLINE:-500}
targets=${TARGETS:-16}
rounds=${ROUNDS:-5}
storms=${STORMS:-3}
storm_rate=${STORM_RATE:-1000}
scenes=()
[ -z "${SCENES:-}" ] || scenes=(--dataset "$SCENES")
[ -z "${MAPS:-}" ] || scenes+=(--register-maps)

source "$(dirname "$0")/measured_server.sh"
[ -z "$model" ] || version 1 "$model"
start_server "$@"

if [ -n "$model" ]; then
  "$bin/maneuver" model promote measured/1 >&2
else
  "$bin/maneuver" synthesize "$work/town" --recordings 60 >&2
  "$bin/maneuver" dataset upload "$work/town" town >&2
  "$bin/maneuver" train measured --dataset town --epochs 3 --set examples.max_examples=3000 \
    --set optimization.mixture_epochs=20 --set optimization.posterior_epochs=1 >&2
fi

load() { "$bin/maneuver" load --metrics "$metrics" "${scenes[@]}" "$@"; }
# The most memory the server has had, MB. Reading it starts anew.
most_memory() {
  sed -n 's/^VmHWM:[ \t]*\([0-9]*\) kB/\1/p' "/proc/$server/status" | awk '{ printf "%.0f", $1 / 1024 }'
  echo 5 >"/proc/$server/clear_refs" 2>/dev/null || true
}
failed=0
# Says whether a promise was kept: words, then what awk makes of the condition.
promise() {
  if awk "BEGIN { exit !($2) }"; then echo "- kept: $1"; else echo "- **not kept**: $1"; failed=1; fi
}
per() { awk "BEGIN { printf \"%.2f\", ($2 > 0 ? $1 / ($2) : 0) }"; }

echo "$cores cores, of which the server has $server_cores and callers $(taskset -pc $$ | sed 's/.*: //')."
echo "Load of the machine before: $(cut -d' ' -f1-3 /proc/loadavg)."
echo
echo "## Shares of its capacity; callers ask for $targets and allow $deadline ms"
echo
most_memory >"$work/before"
load --rates 25%,50%,80%,100%,300% --targets "$targets" --duration "$each" --deadline "$deadline" --markdown --json "$work/shares.json" || failed=1
refused=$(figure "$work/shares.json" steps.5.ended.RESOURCE_EXHAUSTED)
with_delay=$(figure "$work/shares.json" steps.5.refused_with_delay)
# Into $can: what 32 callers are answered a second, each of whom waits for the answer.
measure_capacity() {
  load --targets "$targets" --duration "$each" --deadline "$deadline" --json "$work/can.json" >/dev/null || failed=1
  can=$(figure "$work/can.json" steps.0.answered_per_second)
}
# overload NAME SEED [flags]: three times $can, into $work/NAME.json. Into $answered what it answers,
# into $share that as a share of what it can do just before and just after.
overload() {
  before=$can
  load --rate "$(awk "BEGIN { print 3 * $can }")" --seed "$2" --targets "$targets" --duration "$each" \
    --deadline "$deadline" --json "$work/$1.json" "${@:3}" >/dev/null || failed=1
  answered=$(figure "$work/$1.json" steps.0.answered_per_second)
  measure_capacity
  share=$(per "$answered" "($before + $can) / 2")
}
echo
echo "| in turn | 32 callers, answered/s | 300 %, answered/s | held back | 32 callers | goodput | 300 %, all sent, answered/s | 32 callers | goodput |"
echo "|---|---:|---:|---:|---:|---:|---:|---:|---:|"
goodput=()
goodput_of_all=()
measure_capacity
for round in $(seq "$rounds"); do
  printf '| %d | %.1f |' "$round" "$can"
  overload does "$((round + 1))"
  goodput+=("$share")
  printf ' %.1f | %d of %d | %.1f | %s |' "$answered" "$(figure "$work/does.json" steps.0.held_back)" \
    "$(figure "$work/does.json" steps.0.calls_due)" "$can" "$share"
  overload all "$((round + 1))" --send-all
  goodput_of_all+=("$share")
  printf ' %.1f | %.1f | %s |\n' "$answered" "$can" "$share"
done
highest=$(most_memory)
median() { printf '%s\n' "$@" | sort -n | sed -n "$((($# + 1) / 2))p"; }
middle=$(median "${goodput[@]}")
echo
promise "goodput at 300 % is $middle of the capacity (at least 0.90)" "$middle >= 0.9"
echo "- from callers who send all it is $(median "${goodput_of_all[@]}")"
promise "the server had at most $highest MB, $(cat "$work/before") MB before" "$highest < 2048"
promise "$with_delay of $refused refused calls were told when to come again" \
  "$with_delay == $refused"

storm_seconds=$(awk "BEGIN { print 10000 / $storm_rate }")
# Measured while the storm is on, not while it begins.
patient() {
  load --rate "$patient_rate" --targets "$targets" --deadline 5000 --seed 2 --warm-up 2 --duration "$storm_seconds" \
    --json "$work/$1.json" >/dev/null
}
echo
echo "## Patient callers, 40 % of its capacity, beside 10,000 calls of 1 to 5 ms in $storm_seconds s"
echo
echo "| patient callers | answered/s | p50 ms | p90 ms | p99 ms | p99.9 ms |"
echo "|---|---:|---:|---:|---:|---:|"
show() {
  file=$work/$1.json
  printf '| %s | %.1f | %.2f | %.2f | %.2f | %.2f |\n' "$1" \
    "$(figure "$file" steps.0.answered_per_second)" "$(figure "$file" steps.0.latency_ms.p50)" \
    "$(figure "$file" steps.0.latency_ms.p90)" "$(figure "$file" steps.0.latency_ms.p99)" \
    "$(figure "$file" steps.0.latency_ms.p99_9)"
}
times=()
for _ in $(seq "$storms"); do
  measure_capacity
  patient_rate=$(awk "BEGIN { print 0.4 * $can }")
  patient alone || failed=1
  patient beside &
  beside=$!
  load --send-all --rate "$storm_rate" --deadline 1-5 --calls 10000 --warm-up 0 --duration 3600 --seed 3 \
    --json "$work/storm.json" >/dev/null || failed=1
  wait "$beside" || failed=1
  show alone
  show beside
  times+=("$(per "$(figure "$work/beside.json" steps.0.latency_ms.p99)" \
    "$(figure "$work/alone.json" steps.0.latency_ms.p99)")")
done
storm() { figure "$work/storm.json" "steps.0.$1"; }
echo
echo "| the last storm | |"
echo "|---|---:|"
echo "| calls | $(storm calls_due) |"
echo "| answered in time | $(storm ended.OK) |"
echo "| expired, for their callers | $(storm ended.DEADLINE_EXCEEDED) |"
echo "| refused | $(storm ended.RESOURCE_EXHAUSTED) |"
echo "| targets that the server dropped on entry | $(storm server.dropped_after.nothing) |"
echo "| ... on leaving the queue | $(storm server.dropped_after.queue) |"
echo "| ... after their raster | $(storm server.dropped_after.raster) |"
echo "| ... that expired in the networks | $(storm server.dropped_after.encode) |"
echo
ratio=$(median "${times[@]}")
promise "the patient callers' p99 was $ratio times what it was without the storm (less than 2)" \
  "$ratio < 2"
[ $failed -eq 0 ]
