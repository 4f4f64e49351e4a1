#!/usr/bin/env bash
# maneuverd and the server in Python (server.py) under the same load, in turn, as a Markdown table:
# 32 callers who each wait for their answer, on the servers' own machine. If the model reads no raster,
# compares their answers first (those in f32), and lets calls bring their map, then name a registered one.
#
#   tests/bench/peers/server.sh MODEL_FOLDER [DATASET_FOLDER]
#
# SECONDS_EACH (8) is about the length of a turn, of which each server has ROUNDS (3) after one that is not
# counted. TARGETS ("1 8") are targets a call; REMEMBER ("nothing") what the server in Python keeps from
# call to call (server.py --help), one server for each; F32=1 has maneuverd take f32 where it would take
# bf16. SERVER_CORES (all) has the servers, CALLER_CORES (the last) the callers. PYTHON (/usr/bin/python3),
# BIN (build/release/bin). While one server has its turn the others stand idle.
set -euo pipefail

case "${1:---help}" in
  -h|--help) sed -n '2,12s/^# \{0,1\}//p' "$0"; exit 0 ;;
esac
model=$1
here=$(cd "$(dirname "$0")" && pwd)
BIN=${BIN:-$here/../../../build/release/bin}
source "$here/../measured_server.sh"
python=${PYTHON:-/usr/bin/python3}
scenes=()
[ -z "${2:-}" ] || scenes=(--dataset "$2")
[ -z "${CALLER_CORES:-}" ] || taskset -pc "$CALLER_CORES" $$ >/dev/null

server_cores=${SERVER_CORES:-0-$((cores - 1))}
version 1 "$model"
start_server ${F32:+--precision f32}
"$bin/maneuver" model promote measured/1 >&2
names=(ours)
declare -A calls address=([ours]=$MANEUVER_SERVER) process=([ours]=$server)
trap 'kill "${process[@]}" 2>/dev/null || true; finish' EXIT
for remember in ${REMEMBER:-nothing}; do
  taskset -c "$server_cores" nice -n "$niceness" "$python" "$here/server.py" "$model" --remember "$remember" \
    >"$work/$remember.out" 2>"$work/$remember.log" &
  names+=("$remember")
  process[$remember]=$!
  for _ in $(seq 600); do
    [ ! -s "$work/$remember.out" ] || break
    kill -0 "${process[$remember]}" 2>/dev/null || { cat "$work/$remember.log" >&2; exit 1; }
    sleep 0.1
  done
  address[$remember]=$(head -1 "$work/$remember.out")
done

maps=("")
if ! grep -q '"raster"' "$model/model.json"; then
  maps=("" --register-maps)
  if [ -z "${2:-}" ]; then
    :  # no scenes to compare
  elif [ -z "${F32:-}" ] && grep -qw avx512_bf16 /proc/cpuinfo; then
    echo "server.sh: maneuverd answers in bf16, so the answers are not compared; F32=1 compares them" >&2
  else
    "$python" "$here/compare_answers.py" "${address[ours]}" "${address[${names[1]}]}" "$2" >&2
  fi
fi

# processor NAME: seconds of processor time that a server has taken.
processor() { awk -v hertz="$(getconf CLK_TCK)" '{ print ($14 + $15) / hertz }' "/proc/${process[$1]}/stat"; }
# quantile SHARE: of the numbers on standard input.
quantile() { sort -g | awk -v share="$1" '{ v[NR] = $1 } END { print v[1 + int(share * (NR - 1) + 0.5)] }'; }
# load NAME [flags]: calls of a server, into load.json.
load() {
  "$bin/maneuver" load --server "${address[$1]}" "${scenes[@]}" --targets "$targets" $map --warm-up 0 \
    --json "$work/load.json" "${@:2}" >"$work/load.txt" 2>&1 || { cat "$work/load.txt" >&2; exit 1; }
}
# prepare NAME: a turn that is not counted, which fills what the server keeps and says how many calls a
# turn has.
prepare() {
  load "$1" --duration "$((2 * ${SECONDS_EACH:-8}))"
  calls[$1]=$(figure "$work/load.json" steps.0.answered_per_second |
    awk -v seconds="${SECONDS_EACH:-8}" '{ calls = int($1 * seconds); print (calls > 32 ? calls : 32) }')
}
# turn NAME: appends calls a second, p50 and processor time a target to files.
turn() {
  local before
  before=$(processor "$1")
  load "$1" --duration 600 --calls "${calls[$1]}"
  figure "$work/load.json" steps.0.answered_per_second >>"$work/rate.$1"
  figure "$work/load.json" steps.0.latency_ms.p50 >>"$work/p50.$1"
  echo "$before $(processor "$1") $(figure "$work/load.json" steps.0.targets_answered)" |
    awk '{ print 1e3 * ($2 - $1) / $3 }' >>"$work/processor.$1"
}
# ratio KIND DIVIDEND DIVISOR: the median ratio of a round and its middle half.
ratio() {
  paste "$work/$1.$2" "$work/$1.$3" | awk '{ print $1 / $2 }' >"$work/ratio"
  printf '%.1f (%.1f to %.1f)' "$(quantile 0.5 <"$work/ratio")" "$(quantile 0.25 <"$work/ratio")" \
    "$(quantile 0.75 <"$work/ratio")"
}
median() { quantile 0.5 <"$work/$1.$2"; }

echo "| targets a call | maps | Python remembers | maneuverd: calls/s | p50 ms | processor ms a target |" \
  "Python: calls/s | p50 ms | processor ms a target | calls/s, maneuverd / Python |" \
  "processor time, Python / maneuverd |"
echo "|---:|---|---|---:|---:|---:|---:|---:|---:|---:|---:|"
for targets in ${TARGETS:-1 8}; do
  for map in "${maps[@]}"; do
    rm -f "$work"/rate.* "$work"/p50.* "$work"/processor.*
    for name in "${names[@]}"; do prepare "$name"; done
    for _ in $(seq "${ROUNDS:-3}"); do
      for name in "${names[@]}"; do turn "$name"; done
    done
    for name in "${names[@]:1}"; do
      printf '| %s | %s | %s | %.1f | %.2f | %.3f | %.1f | %.2f | %.3f | %s | %s |\n' "$targets" \
        "$([ -n "$map" ] && echo registered || echo "in the call")" "$name" \
        "$(median rate ours)" "$(median p50 ours)" "$(median processor ours)" \
        "$(median rate "$name")" "$(median p50 "$name")" "$(median processor "$name")" \
        "$(ratio rate ours "$name")" "$(ratio processor "$name" ours)"
    done
  done
done
