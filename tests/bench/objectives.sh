#!/usr/bin/env bash
# Trains the base, the dual and the unified model from several seeds on one dataset folder and
# measures each on another, as docs/reports/learning.md has it. Hours for many seeds: one model takes
# about six minutes on one core. What is there already is kept, so that it can be stopped and called
# again.
#
#   tests/bench/objectives.sh TRAINING_FOLDER TEST_FOLDER OUTPUT_FOLDER [SEED...]
#
# THREADS (default: one for each core) are those of each training; PRESET and TRAINER can be set too.
set -euo pipefail

[ $# -ge 3 ] || { sed -n '2,10s/^# \{0,1\}//p' "$0" >&2; exit 2; }
training=$1 test=$2 output=$3
shift 3
[ $# -gt 0 ] || set -- 1 2 3
trainer=${TRAINER:-$(dirname "$0")/../../build/release/bin/maneuver-trainer}
preset=${PRESET:-compact}
threads=${THREADS:-0}
metrics="ade_ratio fde_ratio min_ade_6 min_ade_6_ratio min_fde_6 min_fde_6_ratio miss_rate_6 nll
  nll_prior coverage_2sigma mean_sigma_ratio effective_actions action_perplexity largest_share
  mutual_information calibration_error nmi_kinematic purity_kinematic nmi"

mkdir -p "$output"
for objective in BASE DUAL UNIFIED; do
  for seed in "$@"; do
    name=$output/${objective,,}-$seed
    if [ ! -f "$name/model.json" ]; then
      printf '{"preset": "%s", "model": {"objective": "OBJECTIVE_%s"}, "seed": %d}\n' \
        "$preset" "$objective" "$seed" >"$name.settings.json"
      "$trainer" train --settings "$name.settings.json" --dataset "$training" --output "$name" \
        --threads "$threads" --progress none
    fi
    "$trainer" evaluate --model "$name" --dataset "$test" --output "$name.report.json" \
      --progress none >"$name.report.txt"
  done
done

# Mean and standard deviation over the seeds, a column for each objective.
value() { sed -n "s/^ *\"$2\": *\([-0-9.e]*\),*$/\1/p" "$1" | head -1; }
printf '%-20s %18s %18s %18s\n' metric base dual unified
for metric in $metrics; do
  printf '%-20s' "$metric"
  for objective in base dual unified; do
    for seed in "$@"; do value "$output/$objective-$seed.report.json" "$metric"; done |
      awk '{ n++; s += $1; q += $1 * $1 }
           END { if (!n) { printf " %18s", "-"; exit }
                 v = n > 1 ? (q - s * s / n) / (n - 1) : 0
                 printf " %9.3f +- %5.3f", s / n, sqrt(v > 0 ? v : 0) }'
  done
  echo
done
