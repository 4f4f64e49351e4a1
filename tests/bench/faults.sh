#!/usr/bin/env bash
# What callers who do what they should not (faults.py) do to those who do: a message of 300 MB, a gzip
# bomb, 5,000 streams, half-open connections and slow readers, as a Markdown table. The server keeps
# its promise if the p99 of the others stays within 1.5 times what it was just before, none of their
# calls fails, and memory and descriptors are back to where they were 20 s later.
#
#   [SHARED=1] tests/bench/faults.sh MODEL_FOLDER [-- flags of maneuverd]
#
# A run has SECONDS_EACH (10); a row is the median of ROUNDS (3) of two runs, one of them beside the fault. RATE (100) are
# the others' calls a second; FAULTS the faults, of faults.py (messages, one after another, is not among them: no
# promise is made); BIN (build/release/bin) where the programs are. Server and callers have cores of their own, or,
# with SHARED=1, the same; those who are at fault have what time the others leave (SCHED_IDLE), as they would come
# from elsewhere. Ends with status 1 if a promise was not kept.
set -euo pipefail

case "${1:---help}" in
  -h|--help) sed -n '2,15s/^# \{0,1\}//p' "$0"; exit 0 ;;
esac
model=$1
shift
[ "${1:-}" != -- ] || shift
here=$(dirname "$0")
each=${SECONDS_EACH:-10}
rate=${RATE:-100}
rounds=${ROUNDS:-3}

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

# The middle one of several numbers.
median() { tr ' ' '\n' <<<"$*" | sort -g | awk '{ v[NR] = $1 } END { print v[int((NR + 1) / 2)] }'; }

others warm
failed=0
echo "| fault | others' p99 before, ms | beside it, ms | times | not answered | memory before, MB | at most | after | descriptors before | after |"
echo "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|"
for fault in ${FAULTS:-message bomb streams half-open slow}; do
  before=() beside=() times=() missing=0
  memory_before=$(memory VmRSS)
  descriptors_before=$(descriptors)
  echo 5 >"/proc/$server/clear_refs" 2>/dev/null || true
  for _ in $(seq "$rounds"); do
    others before
    chrt --idle 0 /usr/bin/python3 "$here/faults.py" "$MANEUVER_SERVER" "$fault" "$((each + 2))" >"$work/$fault.txt" &
    caller=$!
    others beside
    wait "$caller" || failed=1
    before+=("$(p99 before)") beside+=("$(p99 beside)")
    times+=("$(awk "BEGIN { printf \"%.2f\", ${beside[-1]} / ${before[-1]} }")")
    missing=$((missing + $(not_answered beside)))
  done
  most=$(memory VmHWM)
  for _ in $(seq 20); do
    [ "$(memory VmRSS)" -gt "$((memory_before + 48))" ] || [ "$(descriptors)" -gt "$descriptors_before" ] || break
    sleep 1
  done
  memory_after=$(memory VmRSS)
  descriptors_after=$(descriptors)
  printf '| %s | %.2f | %.2f | %s (%s) | %s | %s | %s | %s | %s | %s |\n' "$fault" "$(median "${before[@]}")" \
    "$(median "${beside[@]}")" "$(median "${times[@]}")" "${times[*]}" "$missing" "$memory_before" "$most" "$memory_after" \
    "$descriptors_before" "$descriptors_after"
  awk "BEGIN { exit !($(median "${times[@]}") <= 1.5 && $missing == 0 && $memory_after <= $memory_before + 48 && $descriptors_after <= $descriptors_before) }" \
    || failed=1
done
echo
for fault in ${FAULTS:-message bomb streams half-open slow}; do echo "- $fault, the last: \`$(cat "$work/$fault.txt")\`"; done
[ $failed -eq 0 ] && echo && echo "All promises were kept." || { echo; echo "**A promise was not kept.**"; exit 1; }
