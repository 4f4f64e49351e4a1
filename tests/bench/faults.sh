#!/usr/bin/env bash
# What callers who do what they should not (faults.py) do to those who do: messages of 300 MB, a gzip
# bomb, 5,000 streams, half-open connections and slow readers, as a Markdown table. The server keeps
# its promise if the p99 of the others stays within 1.5 times what it was just before, none of their
# calls fails, and memory and descriptors are back to where they were 20 s later.
#
#   tests/bench/faults.sh MODEL_FOLDER [-- flags of maneuverd]
#
# SECONDS_EACH (10) is the length of a run; RATE (100) the others' calls a second; FAULTS the faults,
# of faults.py; BIN (build/release/bin) where the programs are. Server and callers have cores of their
# own, or, with SHARED=1, the same; those who are at fault have what time the others leave (SCHED_IDLE),
# as they would come from elsewhere. Ends with status 1 if a promise was not kept.
set -euo pipefail

case "${1:---help}" in
  -h|--help) sed -n '2,13s/^# \{0,1\}//p' "$0"; exit 0 ;;
esac
model=$1
shift
[ "${1:-}" != -- ] || shift
here=$(dirname "$0")
each=${SECONDS_EACH:-10}
rate=${RATE:-100}

source "$here/measured_server.sh"
version 1 "$model"
start_server "$@"
"$bin/maneuver" model promote measured/1 >&2

# VmRSS or VmHWM of the server, MB.
memory() { sed -n "s/^$1:[ \t]*\([0-9]*\) kB/\1/p" "/proc/$server/status" | awk '{ printf "%.0f", $1 / 1024 }'; }
descriptors() { ls "/proc/$server/fd" | wc -l; }
others() {
  "$bin/maneuver" load --rate "$rate" --deadline 5000 --warm-up 1 --duration "$each" --json "$work/$1.json" \
    >/dev/null 2>>"$work/others.log" || true
}
# Of the one run in a file: its p99, and the calls that did not end with OK.
p99() { sed -n 's/.*"p99": *\([0-9.e+-]*\),\{0,1\}$/\1/p' "$work/$1.json" | head -1; }
not_answered() {
  awk '/"ended": *\{/ { inside = 1; next } inside && /\}/ { inside = 0 }
       inside && !/"OK"/ { gsub(/[^0-9]/, "", $2); sum += $2 } END { print sum + 0 }' "$work/$1.json"
}

others warm
failed=0
echo "| fault | others' p99 before, ms | beside it, ms | times | not answered | memory before, MB | at most | after | descriptors before | after |"
echo "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|"
for fault in ${FAULTS:-message bomb streams half-open slow}; do
  others before
  memory_before=$(memory VmRSS)
  descriptors_before=$(descriptors)
  echo 5 >"/proc/$server/clear_refs" 2>/dev/null || true
  chrt --idle 0 /usr/bin/python3 "$here/faults.py" "$MANEUVER_SERVER" "$fault" "$((each + 2))" >"$work/$fault.txt" &
  caller=$!
  others beside
  wait "$caller" || failed=1
  most=$(memory VmHWM)
  for _ in $(seq 20); do
    [ "$(memory VmRSS)" -gt "$((memory_before + 48))" ] || [ "$(descriptors)" -gt "$descriptors_before" ] || break
    sleep 1
  done
  memory_after=$(memory VmRSS)
  descriptors_after=$(descriptors)
  times=$(awk "BEGIN { printf \"%.2f\", $(p99 beside) / $(p99 before) }")
  missing=$(not_answered beside)
  printf '| %s | %.2f | %.2f | %s | %s | %s | %s | %s | %s | %s |\n' "$fault" "$(p99 before)" "$(p99 beside)" "$times" \
    "$missing" "$memory_before" "$most" "$memory_after" "$descriptors_before" "$descriptors_after"
  awk "BEGIN { exit !($times <= 1.5 && $missing == 0 && $memory_after <= $memory_before + 48 && $descriptors_after <= $descriptors_before) }" \
    || failed=1
done
echo
for fault in ${FAULTS:-message bomb streams half-open slow}; do echo "- $fault: \`$(cat "$work/$fault.txt")\`"; done
[ $failed -eq 0 ] && echo && echo "All promises were kept." || { echo; echo "**A promise was not kept.**"; exit 1; }
