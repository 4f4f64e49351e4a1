#!/usr/bin/env bash
# Measures this machine's answers and writes docs/reports/performance.md with its pictures:
#
#   1. maneuver-bench --report: every stage in process, and the machine's yardsticks
#   2. the server over loopback: saturated, at half of its capacity, idle, with one worker and with two,
#      its start and its memory; health checks, if h2load (nghttp2-client) is installed
#   3. the peers in tests/bench/peers whose requirements are installed (see the README there)
#
#   tests/bench/report.sh MODEL_FOLDER [DATASET_FOLDER]
#
# With a dataset, requests ask about its recordings instead of the synthetic town. SECONDS_EACH (10) is
# the length of a measurement; OUT (docs/reports/performance.md) the file; BIN (build/release/bin) the
# folder of the programs, maneuver-bench among them. Nothing else should run meanwhile.
set -euo pipefail

case "${1:---help}" in
  -h|--help) sed -n '2,15s/^# \{0,1\}//p' "$0"; exit 0 ;;
esac
model=$1
dataset=${2:-}
each=${SECONDS_EACH:-10}
here=$(cd "$(dirname "$0")" && pwd)
out=${OUT:-$here/../../docs/reports/performance.md}
pictures=$(dirname "$out")/pictures
source "$here/measured_server.sh"
measured=$("$bin/maneuver-bench" --version)
checkout=$(git -C "$here" describe --always --abbrev=10 2>/dev/null || true)
if [ -n "$checkout" ] && [ "${measured%-dirty}" != "$checkout" ]; then
  echo "report.sh: $bin/maneuver-bench was built from $measured, and the checkout is at $checkout:" \
    "cmake --build --preset release --target maneuver-bench" >&2
  exit 1
fi
scenes=()
[ -z "$dataset" ] || scenes=(--dataset "$dataset")

mkdir -p "$pictures" "$work/pictures"
all_cores=0-$((cores - 1))
load_before=$(cut -d' ' -f1-3 /proc/loadavg)
taskset -c "$all_cores" "$bin/maneuver-bench" --report "$work/bench.md" \
  --pictures "$work/pictures" --model "$model" "${scenes[@]}" --seconds "$each"
cp "$work"/pictures/*.svg "$pictures/"

# The server of a model, ready; again with other flags.
version 1 "$model"
start_server
"$bin/maneuver" model promote measured/1 >&2
stop_server

# load NAME [options]: into $work/NAME.json.
load() {
  local name=$1
  shift
  "$bin/maneuver" load "${scenes[@]}" --warm-up 2 --duration "$each" --json "$work/$name.json" \
    "$@" >/dev/null
}
rate() { awk "BEGIN { print $1 * $2 }"; }
median() { sort -n | awk '{ v[NR] = $1 } END { printf "%.0f", v[int((NR + 1) / 2)] }'; }
ratio() { [ "$1" = - ] && echo - || awk "BEGIN { printf \"%.2f\", ($1) / ($2) }"; }
memory() { awk -v of="$1:" '$1 == of { printf "%.0f", $2 / 1024 }' "/proc/$server/status"; }

own_cores=$server_cores
server_cores=$all_cores
# Milliseconds from the start of the process until it answers that it serves.
for _ in 1 2 3 4 5 6 7; do
  begin=$(date +%s%N)
  start_server
  until "$bin/maneuver" health >/dev/null 2>&1; do :; done
  awk "BEGIN { print ($(date +%s%N) - $begin) / 1e6 }" >>"$work/starts"
  resident=$(memory VmRSS)
  stop_server
done
# Processor time of a process so far, s.
processor_time() { awk -v ticks="$(getconf CLK_TCK)" '{ sub(/.*\) /, ""); print ($12 + $13) / ticks }' "/proc/$1/stat"; }
# saturate NAME WORKERS [options]: what it answers, and what a target takes of the processors, us, of
# the server and of its callers, which share the server's cores.
TIMEFORMAT='%U %S'
saturate() {
  local name=$1 workers=$2
  shift 2
  start_server --workers "$workers"
  before=$(processor_time "$server")
  { time load saturated --targets 8 --metrics "$metrics" "$@" 2>"$work/load.log"; } 2>"$work/callers"
  used=$(awk "BEGIN { print $(processor_time "$server") - $before }")
  answered=$(figure "$work/saturated.json" steps.0.server.targets.answered)
  figure "$work/saturated.json" steps.0.answered_targets_per_second >>"$work/workers.$name"
  figure "$work/saturated.json" bytes_per_request >"$work/bytes.$name"
  awk "BEGIN { print $used / $answered * 1e6 }" >>"$work/server_time.$name"
  awk "{ print (\$1 + \$2) / $answered * 1e6 }" "$work/callers" >>"$work/callers_time.$name"
  stop_server
}
# One worker and two, in turn: whether the second one's targets cost more. And without maps in the requests.
for _ in 1 2 3; do
  saturate 1 1
  saturate 2 2
  saturate registered 1 --register-maps
done
start_server
load saturated --targets 1
stop_server
server_cores=$own_cores
start_server
load own --targets 1 --top-k 4
capacity=$(figure "$work/saturated.json" steps.0.answered_per_second | awk '{ printf "%.0f", $1 }')
# nothing CALLS [options]: p50 and p99 of calls that do nothing, one after the other, ms: gRPC's health
# check, by nghttp2's h2load if it is there.
printf '\0\0\0\0\0' >"$work/empty"
nothing() {
  command -v h2load >/dev/null || { echo - -; return; }
  rm -f "$work/nothing.log"
  h2load -n "$1" -c 1 -m 1 "${@:2}" -d "$work/empty" -H 'content-type: application/grpc' -H 'te: trailers' \
    --log-file="$work/nothing.log" "http://$MANEUVER_SERVER/grpc.health.v1.Health/Check" >/dev/null 2>&1
  cut -f3 "$work/nothing.log" | sort -n |
    awk '{ v[NR] = $1 / 1000 } END { printf "%.3f %.3f\n", v[int((NR + 1) / 2)], v[int((99 * NR + 99) / 100)] }'
}
# As many actions as are described in process.
latency() { figure "$work/$1.json" "steps.0.latency_ms.$2" | awk '{ printf "%.2f", $1 }'; }
load now_and_then --targets 1 --top-k 4 --rate 20
half=$(rate "$(figure "$work/own.json" steps.0.answered_per_second)" 0.5)
for _ in 1 2 3 4 5; do
  load idle --targets 1 --top-k 4 --concurrency 1
  nothing 5000 | cut -d' ' -f1 >>"$work/nothing"
  load half_even --targets 1 --top-k 4 --rate "$half" --arrival constant
  nothing "$(rate "$half" "$each" | cut -d. -f1)" --rps="$half" | cut -d' ' -f2 >>"$work/nothing_half"
  load half_random --targets 1 --top-k 4 --rate "$half"
  idle=$(latency idle p50)
  echo "$idle" >>"$work/idle"
  for arrival in half_even half_random; do
    p99=$(latency "$arrival" p99)
    echo "$p99" >>"$work/$arrival"
    echo "$(ratio "$p99" "$idle")" >>"$work/$arrival.times"
  done
done
most=$(memory VmHWM)
stop_server

middle() { sort -n "$work/$1" | sed -n 3p; }
idle=$(middle idle)
now_and_then=$(latency now_and_then p50)
# The first row of the curve over targets: one target in process, microseconds.
alone=$(awk -F'|' '/^\| targets in the request/ { getline; getline; print $3 + 0; exit }' "$work/bench.md")
# Raster and networks of 8 targets of one scene in process, microseconds a target.
computed=$(awk -F'|' '/^\| (rasterise|read scene|backbone|scene network|heads|distributions) \|/ { sum += $3 } /^\| sum of the stages/ { print sum; exit }' "$work/bench.md")
# rest TIME: which share of it they are not; kilobytes NAME: of a request.
rest() { ratio "$1 - $computed" "$1"; }
kilobytes() { awk '{ printf "%.0f", $1 / 1000 }' "$work/bytes.$1"; }
weights=$(stat -c %s "$model/weights.safetensors" | awk '{ printf "%.0f", $1 / 1048576 }')

# Wraps prose at 120 characters; tables and what programs printed stay as they are.
wrap() {
  awk '/^```/ { fence = !fence }
    fence || /^[|`#!]/ { print; next }
    { while (length > 120) {
        for (cut = 121; cut > 1 && substr($0, cut, 1) != " "; --cut) {}
        if (cut == 1) break
        print substr($0, 1, cut - 1)
        $0 = substr($0, cut + 1)
      }
      print }'
}

{
  echo "# Performance"
  echo
  echo "Written on $(date -u +%F) by \`tests/bench/report.sh MODEL_FOLDER [DATASET_FOLDER]\`, whose head says what it measures."
  echo "Load of the machine before: $load_before. Not covered: a network between callers and server, and more than $cores cores."
  echo
  cat "$work/bench.md"
  echo "## The server over loopback"
  echo
  echo "Calls of Predict by \`maneuver load\`. For the saturated rows and the start, the server has all $cores cores and its callers"
  echo "share the last one. For the latencies each has cores of its own: the server has $own_cores. Half load is half of the"
  echo "calls a second that it can answer on its own cores."
  echo
  echo "| quantity | measured | ratio | target |"
  echo "|---|---:|---:|---:|"
  echo "| saturated, 1 target a call, calls a second | $capacity | | |"
  echo "| one caller who asks again at once, p50, ms; / one target in process | $idle | $(ratio "$idle" "$alone / 1000") | at most 1.3 |"
  echo "| ... health checks instead, which compute nothing, p50, ms | $(middle nothing) | | |"
  echo "| ... at 20 calls a second, p50, ms: cores have slept, caches are cold | $now_and_then | $(ratio "$now_and_then" "$alone / 1000") | |"
  echo "| half load, evenly spaced, p99, ms; / p50 of one caller just before (medians of five) | $(middle half_even) | $(middle half_even.times) | at most 3 |"
  echo "| ... health checks at the same rate, p99, ms; / their p50 one after the other | $(middle nothing_half) | $(ratio "$(middle nothing_half)" "$(middle nothing)") | |"
  echo "| ... half load, random arrivals, p99, ms; / p50 of one caller | $(middle half_random) | $(middle half_random.times) | |"
  echo "| saturated, 8 targets a call, 1 worker, targets a second | $(median <"$work/workers.1") | | |"
  echo "| ... 2 workers; / 1 worker | $(median <"$work/workers.2") | $(ratio "$(median <"$work/workers.2")" "$(median <"$work/workers.1")") | at least 1.8 |"
  echo "| processor time of the server a target, 1 worker, µs | $(median <"$work/server_time.1") | | |"
  echo "| ... 2 workers; / 1 worker | $(median <"$work/server_time.2") | $(ratio "$(median <"$work/server_time.2")" "$(median <"$work/server_time.1")") | |"
  echo "| ... share other than raster and networks ($computed µs in process); requests of $(kilobytes 1) kB | $(rest "$(median <"$work/server_time.1")") | | at most 0.15 |"
  echo "| ... with registered maps, requests of $(kilobytes registered) kB: time, µs; the same share | $(median <"$work/server_time.registered") | $(rest "$(median <"$work/server_time.registered")") | at most 0.15 |"
  echo "| ... of the callers, 2 workers, µs | $(median <"$work/callers_time.2") | | |"
  echo "| start until a health check succeeds, ms | $(median <"$work/starts") | | under 300 |"
  echo "| resident memory after the start, MB | $resident | | under 300 |"
  echo "| ... peak under load, MB; $weights MB of it are weights | $most | | under 300, 150 without the weights |"
  echo
  echo "## Peers"
  echo
  BIN=$bin taskset -c "$all_cores" "$here/peers/all.sh" "$model" ${dataset:+"$dataset"}
} | wrap >"$work/report.md"
mv "$work/report.md" "$out"
echo "$out"
