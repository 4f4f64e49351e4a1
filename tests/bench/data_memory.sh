#!/usr/bin/env bash
# Memory and speed against the size of a dataset: trains on datasets of the synthetic town that grow,
# evaluates on them, and prints peak memory and examples a second as a Markdown table. With data that
# do not fit in DATA_MEMORY, both columns should stay flat.
#
#   tests/bench/data_memory.sh [MEGABYTES...]          (default: 10 20 40 80)
#
# Sizes up to 20000 make sense: 1 GB takes about two minutes of a core to make. DATA_MEMORY (64MB) is
# passed as --data-memory; EXAMPLES (4000) are those of each epoch; THREADS (1). FOLDER keeps datasets
# from one call to the next (default: a temporary folder); BIN (build/release/bin).
set -euo pipefail
case "${1:-}" in
  -h|--help) sed -n '2,12s/^# \{0,1\}//p' "$0"; exit 0 ;;
esac
[ $# -gt 0 ] || set -- 10 20 40 80
bin=${BIN:-$(dirname "$0")/../../build/release/bin}
memory=${DATA_MEMORY:-64MB}
threads=${THREADS:-1}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
folder=${FOLDER:-$work}
bytes_each=175000  # of a recording of 20 s

cat >"$work/settings.json" <<END
{"preset": "lanes", "examples": {"maxExamples": "${EXAMPLES:-4000}"},
 "optimization": {"pretrainingEpochs": 2, "mixtureEpochs": 1, "jointEpochs": 2}}
END

# Prints the peak memory of a command, MB. Its output goes to a file.
#   $1: file
peak_of() {
  local output=$1
  shift
  /usr/bin/time -f %M -o "$work/peak" "$@" >"$output"
  awk '{ printf "%.0f", $1 / 1024 }' "$work/peak"
}

# Prints the last examples a second that the joint phase reported.
joint_speed() {
  grep '"phase":"joint"' "$1" | sed -n 's/.*"examples_per_second":\([0-9.e+]*\).*/\1/p' | tail -1
}

echo "--data-memory $memory, $threads threads"
echo
echo "| dataset, MB | first training: peak, MB | training: peak, MB | training, examples/s | waiting for data | evaluation: peak, MB | evaluation, s |"
echo "|---:|---:|---:|---:|---:|---:|---:|"
for megabytes in "$@"; do
  town=$folder/town-$megabytes
  [ -d "$town" ] || "$bin/maneuver" synthesize "$town" --threads "$threads" \
    --recordings $((megabytes * 1000000 / bytes_each)) >/dev/null
  train=("$bin/maneuver-trainer" train --settings "$work/settings.json" --dataset "$town"
    --data-memory "$memory" --threads "$threads" --progress json)
  # The first one also makes the index and counts the examples.
  rm -f "$town"/.examples-* "$town"/.*.index
  first=$(peak_of "$work/first.log" "${train[@]}" --output "$work/first-$megabytes")
  again=$(peak_of "$work/again.log" "${train[@]}" --output "$work/model-$megabytes")
  waiting=$(grep '"phase":"joint"' "$work/again.log" |
    sed -n 's/.*"waiting_fraction":\([0-9.e-]*\).*/\1/p' | tail -1)
  begin=$(date +%s)
  evaluated=$(peak_of "$work/evaluation.log" "$bin/maneuver-trainer" evaluate \
    --model "$work/model-$megabytes" --dataset "$town" --data-memory "$memory" \
    --threads "$threads" --progress none)
  end=$(date +%s)
  size=$(du -sm --apparent-size "$town" | cut -f1)
  printf '| %d | %s | %s | %.0f | %.1f %% | %s | %d |\n' "$size" "$first" "$again" \
    "$(joint_speed "$work/again.log")" \
    "$(awk -v share="${waiting:-0}" 'BEGIN { print 100 * share }')" "$evaluated" $((end - begin))
done
