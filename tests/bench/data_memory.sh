#!/usr/bin/env bash
# Memory and speed against the size of a dataset: makes datasets of the synthetic town that grow, and
# indexes them, shows them, trains on them and evaluates on a sample of them. Prints Markdown tables of
# times, peak memory and examples a second. With data that do not fit in DATA_MEMORY, memory and
# examples a second should stay flat.
#
#   tests/bench/data_memory.sh [MEGABYTES...]          (default: 10 20 40 80)
#
# DATA_MEMORY (64MB) is passed as --data-memory; EXAMPLES (4000) are those of each epoch; THREADS (1);
# PRESET (lanes). Up to DISTINCT (1000) MB of a dataset are made, which takes about two minutes of a
# core; a larger one has copies of these shards, so that all its bytes are really on the disk. FOLDER
# keeps the distinct shards from one call to the next (default: a temporary folder); a dataset is
# removed once it was measured, unless KEEP=1. BIN (build/release/bin).
set -euo pipefail
case "${1:-}" in
  -h|--help) sed -n '2,16s/^# \{0,1\}//p' "$0"; exit 0 ;;
esac
[ $# -gt 0 ] || set -- 10 20 40 80
bin=${BIN:-$(dirname "$0")/../../build/release/bin}
memory=${DATA_MEMORY:-64MB}
threads=${THREADS:-1}
distinct=${DISTINCT:-1000}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
folder=${FOLDER:-$work}
bytes_each=175000  # of a recording of 20 s

cat >"$work/settings.json" <<END
{"preset": "${PRESET:-lanes}", "examples": {"maxExamples": "${EXAMPLES:-4000}"},
 "optimization": {"pretrainingEpochs": 2, "mixtureEpochs": 1, "jointEpochs": 2}}
END

# Runs a command and notes its peak memory in MB and its seconds. Its output goes to a file.
#   $1: file
measure() {
  local output=$1
  shift
  /usr/bin/time -f '%M %e' -o "$work/time" "$@" >"$output"
  peak=$(awk '{ printf "%.0f", $1 / 1024 }' "$work/time")
  seconds=$(awk '{ printf "%.0f", $2 }' "$work/time")
}

# Prints the last value of a field that a phase reported.
#   $1: log;  $2: phase;  $3: field
last() {
  grep "\"phase\":\"$2\"" "$1" | sed -n "s/.*\"$3\":\"\{0,1\}\([0-9.e+-]*\).*/\1/p" | tail -1
}

# Makes a dataset that repeats the shards of another one until it has so many bytes, or writes a
# sample of one shard.
#   $1: from;  $2: to;  $3: bytes, or "sample"
repeat() {
  python3 - "$1" "$2" "$3" <<'END'
import json, pathlib, shutil, sys

source, target, size = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]), sys.argv[3]
manifest = json.loads((source / "dataset.json").read_text())
scenes = [s for s in manifest["shards"] if s["content"] == "SHARD_CONTENT_SCENARIOS"]
shards, total = [], 0
target.mkdir()
while not shards or (size != "sample" and total < int(size)):
    shard = dict(scenes[len(shards) % len(scenes)])
    shutil.copy(source / shard["file"], target / f"r{len(shards):05}.tfrecord")
    shard["file"] = f"r{len(shards):05}.tfrecord"
    total += int(shard["size_bytes"])
    shards.append(shard)
manifest["shards"] = shards
manifest["recordings"] = str(sum(int(s["records"]) for s in shards))
(target / "dataset.json").write_text(json.dumps(manifest))
END
}

printf '%s\n' "--data-memory $memory, $threads threads, preset ${PRESET:-lanes}, ${EXAMPLES:-4000} examples an epoch"
printf '\n'
printf '%s\n' \
  '| dataset, MB | index, s | index: peak, MB | show, s | show: peak, MB | count and train, s | first training: peak, MB | training, s | training: peak, MB | joint: examples/s | waiting for data | sample: recordings | evaluation, s | evaluation: peak, MB |' \
  '|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|'
for megabytes in "$@"; do
  made=$((megabytes < distinct ? megabytes : distinct))
  town=$folder/town-$made
  [ -d "$town" ] || "$bin/maneuver" synthesize "$town" --threads "$threads" \
    --recordings $((made * 1000000 / bytes_each)) >/dev/null
  data=$town
  if [ "$megabytes" -gt "$made" ]; then
    data=$folder/repeated-$megabytes
    [ -d "$data" ] || repeat "$town" "$data" $((megabytes * 1000000))
  fi
  rm -rf "$data"/.examples-* "$data"/.*.index "$work/sample"
  repeat "$town" "$work/sample" sample
  size=$(du -sm --apparent-size "$data" | cut -f1)

  measure "$work/index.log" "$bin/maneuver" dataset index "$data"
  row="| $size | $seconds | $peak"
  measure "$work/show.log" "$bin/maneuver" dataset show "$data/"
  row="$row | $seconds | $peak"
  train=("$bin/maneuver-trainer" train --settings "$work/settings.json" --dataset "$data"
    --data-memory "$memory" --threads "$threads" --progress json)
  # The first one also counts the examples.
  measure "$work/first.log" "${train[@]}" --output "$work/first-$megabytes"
  row="$row | $seconds | $peak"
  measure "$work/again.log" "${train[@]}" --output "$work/model-$megabytes"
  row="$row | $seconds | $peak"
  row="$row | $(last "$work/again.log" joint examples_per_second | awk '{ printf "%.0f", $1 }')"
  row="$row | $(last "$work/again.log" joint waiting_fraction | awk '{ printf "%.1f %%", 100 * $1 }')"
  measure "$work/evaluation.log" "$bin/maneuver-trainer" evaluate \
    --model "$work/model-$megabytes" --dataset "$work/sample" --data-memory "$memory" \
    --threads "$threads" --progress none
  recordings=$(sed -n 's/.*"recordings": "\([0-9]*\)".*/\1/p' "$work/sample/dataset.json")
  printf '%s | %s | %s | %s |\n' "$row" "$recordings" "$seconds" "$peak"
  rm -rf "$work/first-$megabytes" "$work/model-$megabytes"
  [ "$data" = "$town" ] || [ "${KEEP:-}" = 1 ] || rm -rf "$data"
done
