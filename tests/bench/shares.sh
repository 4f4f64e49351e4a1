#!/usr/bin/env bash
# Whose processor time a saturated server's is: of each sample of `perf`, who called it. Eight targets a call.
#
#   tests/bench/shares.sh MODEL_FOLDER DATASET_FOLDER [flags of maneuver load, such as --register-maps]
#
# SECONDS_EACH (5) how long it is looked at; BIN, SHARED: see measured_server.sh. Needs perf (linux-perf).
set -euo pipefail
case "${1:-}" in
  -h | --help | '') sed -n '2,/^set/s/^# \{0,1\}//p' "$0" | sed '$d'; exit 0 ;;
esac
command -v perf >/dev/null || { echo 'shares.sh needs perf: apt-get install linux-perf' >&2; exit 2; }
model=$1
dataset=$2
shift 2
each=${SECONDS_EACH:-5}
source "$(dirname "$0")/measured_server.sh"

version 1 "$model"
start_server
"$bin/maneuver" model promote measured/1 >/dev/null
"$bin/maneuver" load --dataset "$dataset" --targets 8 --warm-up 1 --duration "$((each + 4))" "$@" \
  --metrics "$metrics" --json "$work/load.json" >/dev/null 2>&1 &
load=$!
sleep 2.5
# What oneDNN compiles has no names and no callers.
perf record -q -F 499 --call-graph dwarf,16384 -o "$work/perf.data" -p "$server" -- sleep "$each" >/dev/null 2>&1
wait "$load"
printf '%.0f targets a second\n' "$(figure "$work/load.json" steps.0.answered_targets_per_second)"
perf script -i "$work/perf.data" --no-inline -F ip,sym 2>/dev/null | awk '
  BEGIN {
    RS = ""
    FS = "\n"
    # The first that any caller is of counts.
    add("reading scenes", "serving::ReadRaster|serving::ReadVectors|SceneReader|Rasterizer|scene::Brush|Raster::Clear")
    add("networks", "maneuver::inference|dnnl|Eigen|^ *[0-9a-f]+ \\[unknown\\]$")
    add("sending, the kernel", "sendmsg")
    add("receiving, the kernel", "recvmsg")
    add("waking and waiting, the kernel", "futex|epoll|schedule|softirq|irqentry")
    add("index of a map", "RoadMap")
    add("checks of a scene", "ValidateScenario|CheckCoordinates|CheckMap|PlanPrediction|FindMaps")
    add("targets counted before parsing", "CountTargets|CountOfRequest")
    add("parsing", "InternalParse|ParseFrom|MergePartial|Deserialize")
    add("answers", "WritePredictions|WriteItems|FrameChange")
    add("serialising", "InternalSerialize|SerializeTo|SerializationTraits|ByteSizeLong")
    add("memory of requests and answers", "Arena|~Prediction|TargetAnswer|OnDone")
    add("gRPC", "grpc")
    add("queue and batches", "BatchScheduler|TargetQueue")
    add("anything else", "")
  }
  function add(name, pattern) { names[++parts] = name; patterns[parts] = pattern }
  {
    ++samples
    for (i = 1; $0 !~ patterns[i]; ++i);
    ++count[i]
    if (i > 2) ++rest
  }
  END {
    for (i = 1; i <= parts; ++i) printf "%5.1f %%  %s\n", 100 * count[i] / samples, names[i]
    printf "%5.1f %%  neither reading scenes nor networks, of %d samples\n", 100 * rest / samples, samples
  }'
